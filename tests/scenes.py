"""Builders of the smallest things that the locator's tests look at: discs, pictures, sessions.

Apples are spheres drawn through the rig's own pinholes and lenses, ray by ray, so that the truth
is exact: a pixel is fruit where its ray meets the sphere.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from processor.circles import RandomRing
from processor.locate import Locator
from processor.trace import Circles, Cleaning, Fruit, Mask, Matching, Recognition, Trace, ViewTrace
from recorder.records import (
    SIDES,
    AppleTruth,
    Encoding,
    Frame,
    FrameTruth,
    Labels,
    Picture,
    RangeReading,
    Side,
    TruthPoint,
)
from recorder.rig import Rangefinder, Rig, parallel_rig
from recorder.session_writer import SessionWriter
from recorder.status import RecorderStatus

# BGR. Fruit by all readings of the rule (R - G = 160, G - B = 10) and both other indicators
RED: Final = (30, 40, 200)
LEAF: Final = (30, 110, 60)  # R < G: fruit by none

Bools = npt.NDArray[np.bool_]
Disc = tuple[float, float, float]  # x, y, radius in pixels


def small_rig(rangefinder: Rangefinder | None = None) -> Rig:
    """320 x 240 px: an 80 mm apple at 0.4 m has a radius of 40 px and a disparity of 60."""
    return parallel_rig(
        size_px=(320, 240), focal_px=400.0, baseline_m=0.06, rangefinder=rangefinder
    )


def tiny_rig(rangefinder: Rangefinder | None = None) -> Rig:
    """96 x 72 px, for many pairs: an 80 mm apple at 0.4 m has a radius of 10 px, disparity 20."""
    return parallel_rig(size_px=(96, 72), focal_px=100.0, baseline_m=0.08, rangefinder=rangefinder)


# The paper's method for tiny_rig's pictures.
TINY: Final = Locator(circles=RandomRing(rounds=30, ring_px=1.0, min_radius_px=5, max_radius_px=20))


def disc_mask(*discs: Disc, size_px: tuple[int, int]) -> Mask:
    """255 on every pixel whose centre lies within a disc."""
    rows, columns = np.mgrid[: size_px[1], : size_px[0]]
    mask = np.zeros((size_px[1], size_px[0]), np.uint8)
    for x, y, radius in discs:
        mask[np.hypot(columns - x, rows - y) <= radius] = 255
    return mask


def painted(mask: Mask) -> Picture:
    """A picture that is red where the mask is set and a leaf elsewhere."""
    return np.where(mask[..., None] > 0, np.array(RED, np.uint8), np.array(LEAF, np.uint8))


def rounded(*discs: Disc, size_px: tuple[int, int]) -> Picture:
    """Red discs before leaves, shaded as a ball is: a flat one is no apple to a network."""
    width, height = size_px
    rows, columns = np.mgrid[:height, :width]
    picture = np.tile(np.array(LEAF, float), (height, width, 1))
    for x, y, radius in discs:
        away = np.hypot(columns - x, rows - y) / radius
        shade = 0.35 + 0.65 * np.sqrt(np.clip(1 - away**2, 0, 1))
        picture = np.where(away[..., None] <= 1, shade[..., None] * np.array(RED), picture)
    return picture.astype(np.uint8)


def red_disc_picture(*discs: Disc, size_px: tuple[int, int] = (320, 240)) -> Picture:
    """Red discs before leaves."""
    return painted(disc_mask(*discs, size_px=size_px))


def recognised(mask: Mask) -> Recognition:
    """A recogniser's answer that says `mask`."""
    return Recognition(mask, mask)


def apple(
    number: int,
    x_m: float = 0.0,
    y_m: float = 0.0,
    z_m: float = 0.4,
    *,
    radius_m: float = 0.04,
    seen: float | None = None,
    truth_point: TruthPoint = "centre",
) -> AppleTruth:
    """An apple; `seen` is its visible fraction in both views."""
    return AppleTruth(number, (x_m, y_m, z_m), radius_m, seen, seen, truth_point)


def draw(rig: Rig, side: Side, apples: Sequence[AppleTruth]) -> tuple[Picture, Labels]:
    """What that camera records of the apples, and their labels; the nearer ones hide the others."""
    camera = rig.camera(side)
    width_px, height_px = camera.size_px
    rows, columns = np.mgrid[:height_px, :width_px]
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64)[:, None]
    flat = cv2.undistortPoints(pixels, camera.matrix, camera.distortion).reshape(-1, 2)
    ahead = np.column_stack([flat, np.ones(len(flat))])
    rays = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    labels = np.zeros(len(rays), np.uint16)
    for one in sorted(apples, key=lambda a: -float(np.linalg.norm(a.centre_m))):
        centre = np.asarray(one.centre_m)
        if side == "right":
            centre = rig.rotation @ centre + rig.translation_m
        along = rays @ centre
        labels[(along > 0) & (centre @ centre - along**2 <= one.radius_m**2)] = one.id
    image = labels.reshape(height_px, width_px)
    return painted((image > 0).astype(np.uint8)), image


def pair_of(rig: Rig, *apples: AppleTruth) -> tuple[Picture, Picture]:
    """Both views of the apples."""
    return draw(rig, "left", apples)[0], draw(rig, "right", apples)[0]


def encoded(picture: Picture, encoding: Encoding = "png") -> bytes:
    """A picture as its camera would send it."""
    done, data = cv2.imencode(f".{encoding}", picture)
    assert done
    return data.tobytes()


def stereo_session(
    path: Path,
    frames: Sequence[Sequence[AppleTruth]],
    *,
    rig: Rig | None = None,
    truth: bool = True,
    lighting: str = "",
    encoding: Encoding = "png",
    readings: Sequence[RangeReading] = (),
    statuses: Sequence[RecorderStatus] = (),
) -> Path:
    """A session with one pair a second, the apples of each drawn and, with `truth`, told."""
    rig = rig or small_rig()
    metadata = {"lighting": lighting} if lighting else {}
    drawn: dict[tuple[Side, tuple[AppleTruth, ...]], tuple[bytes, Labels]] = {}
    with SessionWriter.create(path, rig, metadata) as writer:
        for number, apples in enumerate(frames):
            time_ns = number * 1_000_000_000
            labels = {}
            for side in SIDES:
                key = (side, tuple(apples))
                if key not in drawn:
                    picture, seen = draw(rig, side, apples)
                    drawn[key] = encoded(picture, encoding), seen
                data, labels[side] = drawn[key]
                size_px = rig.camera(side).size_px
                writer.write_frame(Frame(side, time_ns, encoding, data, size_px, number))
            if truth:
                known = FrameTruth(labels["left"], labels["right"], tuple(apples))
                writer.write_truth(time_ns, known)
        for reading in readings:
            writer.write_reading(reading)
        for status in statuses:
            writer.write_status(status)
    return path


def fruit(
    x_px: float,
    y_px: float = 100.0,
    *,
    radius_px: float = 10.0,
    area_px: int = 300,
    height_px: int = 20,
) -> Fruit:
    """A circle whose region's box has its centre in the circle's."""
    box = (round(x_px - radius_px), round(y_px - height_px / 2), round(2 * radius_px), height_px)
    return Fruit(0, x_px, y_px, radius_px, 50, area_px, box)


def circles(*fruit: Fruit) -> Circles:
    """Fruit that nobody had to try for."""
    return Circles(tuple(fruit), np.empty((0, 5), np.float32))


def view(
    *found: Fruit, mask: Mask | None = None, size_px: tuple[int, int] = (320, 240)
) -> ViewTrace:
    """A view with that fruit; its mask is empty unless given."""
    if mask is None:
        mask = np.zeros((size_px[1], size_px[0]), np.uint8)
    return ViewTrace(painted(mask), recognised(mask), Cleaning(mask, ()), circles(*found))


def matching(*pairs: tuple[int, int]) -> Matching:
    """Those matches, without a cost."""
    return Matching(np.array(pairs, np.intp).reshape(-1, 2), np.zeros(len(pairs)))


def located(trace: Trace) -> list[tuple[float, float, float]]:
    """The places of the apples that have one."""
    return [one.centre_m for one in trace.apples if one.centre_m is not None]
