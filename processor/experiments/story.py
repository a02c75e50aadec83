"""A real tree of red 'Story' apples: its labels, places and callipers, as its folder has them."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from recorder.errors import PomologError
from recorder.records import AppleTruth, FrameTruth, Labels, Picture
from recorder.rig import Camera, Rig, load_rig

LEFT: Final = "125309"
RIGHT: Final = "123505"
BALLS: Final = "BALL"  # two white balls are labelled too; they are no apples
INNER: Final = 0.4  # of a mask's radius: there the depth is the fruit's front, within 2 mm


@dataclass(frozen=True, slots=True)
class Labelled:
    """The tree's truth: the pair's, and which apples something hides."""

    truth: FrameTruth
    occluded: dict[int, bool]


def read_pair(folder: Path) -> tuple[Rig, Picture, Picture]:
    """The rig and both colour pictures, left first.

    Raises:
        PomologError: one of them cannot be read.
    """
    rig = load_rig(folder / "rig_opencv.yaml")
    pictures = [_read(folder / f"{frame}_colour.png", cv2.IMREAD_COLOR) for frame in (LEFT, RIGHT)]
    return rig, pictures[0].astype(np.uint8), pictures[1].astype(np.uint8)


def _read(path: Path, flags: int = cv2.IMREAD_UNCHANGED) -> cv2.typing.MatLike:
    picture = cv2.imread(str(path), flags)
    if picture is None:
        raise PomologError(f"cannot read {path}; is it there, and a whole PNG?")
    return picture


def read_truth(folder: Path, camera: Camera) -> Labelled:
    """Labels from masks and boxes, places from the depth picture, radii from callipers.

    Raises:
        PomologError: a mask or the depth picture cannot be read.
    """
    with (folder / "apples_truth.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if not row["fruit_id"].startswith(BALLS)]
    labels = {frame: _labels(folder, frame, rows) for frame in (LEFT, RIGHT)}
    depth = _read(folder / f"{LEFT}_depth_mm.png")
    apples = []
    for row in rows:
        if row["frame"] != LEFT:
            continue
        number = int(row["fruit_id"])
        radius_m = (float(row["caliper_axis1_mm"]) + float(row["caliper_axis2_mm"])) / 4e3
        pixel = np.array([[float(row["mask_centroid_x"]), float(row["mask_centroid_y"])]])
        z_m = _front_m(depth, labels[LEFT] == number, pixel[0])
        if z_m is None or not np.isfinite(radius_m):
            continue
        ray = cv2.undistortPoints(pixel, camera.matrix, camera.distortion).ravel()
        front = np.array([ray[0], ray[1], 1.0]) * z_m
        centre = front * (1 + radius_m / np.linalg.norm(front))
        x, y, z = centre.tolist()
        apples.append(AppleTruth(number, (x, y, z), radius_m, truth_point="surface"))
    occluded = {int(row["fruit_id"]): row["occluded"] == "YES" for row in rows}
    truth = FrameTruth(labels[LEFT], labels[RIGHT], tuple(apples), partial=True)
    return Labelled(truth, occluded)


def _labels(folder: Path, frame: str, rows: list[dict[str, str]]) -> Labels:
    """Each labelled apple's own pixels: its mask within its box."""
    mask = _read(folder / f"{frame}_mask.png")
    labels = np.zeros(mask.shape, np.uint16)
    for row in rows:
        if row["frame"] != frame:
            continue
        x, y, w, h = (int(row[f"box_{key}"]) for key in "xywh")
        box = np.s_[y : y + h, x : x + w]
        labels[box][(mask[box] > 0) & (labels[box] == 0)] = int(row["fruit_id"])
    return labels


def _front_m(depth: Any, mine: Any, centre: Any) -> float | None:
    rows, columns = np.nonzero(mine)
    radius = np.sqrt(len(rows) / np.pi)
    near = np.hypot(columns - centre[0], rows - centre[1]) < INNER * radius
    values = depth[rows[near], columns[near]]
    values = values[values > 0]
    return float(np.median(values)) / 1e3 if len(values) else None
