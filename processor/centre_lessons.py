"""What the network of centres is shown and asked: lessons shrunk, turned, cropped, exposed anew."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from processor.centres import (
    CELL,
    OUTPUTS,
    USUAL_PX,
    coarse_view,
    seen_by_network,
)
from processor.discs import LEAST_VISIBLE
from processor.lessons import Lesson, expose, looks_at
from processor.nearness import FURTHEST_M, NEAREST_M, Nearness, see_nearness
from processor.net import Floats32
from processor.trace import Floats, Recogniser
from recorder.records import UNCOUNTED, Picture

Flags = npt.NDArray[np.bool_]

DOUBTFUL: Final = 0.3  # of a place's pixels: nobody can say
WIDE: Final = 0.16  # of a radius: the hill about a centre
BLIND: Final = 0.12  # of the turns: no other view says how large fruit are


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One picture as the network sees it, and its truth.

    Attributes:
        name: of the lesson.
        small: (h, w, 3) BGR.
        near: (h, w) the usual radius there in its pixels; 0 where nobody knows.
        discs: (N, 4) x, y, radius in its pixels, visible fraction.
        doubtful: (h / CELL, w / CELL) where nothing is asked.
        fold: of its scene.
        real: photographed.
    """

    name: str
    small: Picture
    near: Floats32
    discs: Floats
    doubtful: Flags
    fold: int
    real: bool


def examples(groups: Sequence[tuple[Lesson, ...]], recognise: Recogniser) -> list[Example]:
    """Both views of pairs, which say how large fruit are in each other, and single pictures."""
    made = []
    for group in groups:
        for lesson, look in zip(group, looks_at(group, recognise), strict=True):
            made.append(example(lesson, see_nearness(look, NEAREST_M, FURTHEST_M)))
    return made


def example(lesson: Lesson, nearness: Nearness | None) -> Example:
    """Shrink a lesson."""
    small, near = coarse_view(lesson.picture, lesson.rectification, nearness)
    height, width = small.shape[:2]
    across, down = width / lesson.labels.shape[1], height / lesson.labels.shape[0]
    half = np.array([0.5, 0.5, 0, 0])  # coordinates are of pixels' middles
    discs = (lesson.discs + half) * [across, down, across, 1] - half
    unknown = (lesson.labels == UNCOUNTED).astype(np.float32)
    size = (-(-width // CELL), -(-height // CELL))
    doubtful = np.asarray(cv2.resize(unknown, size, interpolation=cv2.INTER_AREA)) > DOUBTFUL
    return Example(lesson.name, small, near, discs, doubtful, lesson.fold, lesson.real)


def turn(
    one: Example, rng: np.random.Generator, crop_px: tuple[int, int]
) -> tuple[Floats32, Floats32]:
    """Expose, tint, flip, scale and crop an example at random.

    Args:
        one: the example.
        rng: decides.
        crop_px: height and width of what is seen of it.

    Returns:
        (h, w, INPUTS) what the network sees, and what it should say: see `wanted_of`.
    """
    small, near, doubtful = one.small, one.near, one.doubtful
    discs = one.discs.copy()
    height, width = crop_px
    if rng.random() < 0.7:
        small = expose(small, rng.uniform(-1.6, 1.6))
    noise = rng.normal(0, rng.uniform(0, 3), small.shape)
    small = np.clip(small * rng.uniform(0.93, 1.07, 3) + noise, 0, 255).astype(np.uint8)
    if rng.random() < 0.5:
        small, near, doubtful = small[:, ::-1], near[:, ::-1], doubtful[:, ::-1]
        discs[:, 0] = small.shape[1] - 1 - discs[:, 0]
    scale = float(np.exp(rng.uniform(-0.5, 0.5) if one.real else rng.uniform(-0.25, 0.25)))
    left, top = (
        rng.uniform(*sorted((0.0, whole - part / scale)))
        for whole, part in ((small.shape[1], width), (small.shape[0], height))
    )
    small = _cropped(small, scale, (left, top), (width, height), cv2.INTER_LINEAR)
    near = _cropped(near, scale, (left, top), (width, height), cv2.INTER_NEAREST)
    near = near * scale * (rng.random() > BLIND) * np.exp(rng.normal(0, 0.02))
    cells = (width // CELL, height // CELL)
    known = (~doubtful).astype(np.uint8)
    known = _cropped(known, scale, (left / CELL, top / CELL), cells, cv2.INTER_NEAREST)
    middles = (discs[:, :2] + 0.5 - [left, top]) * scale - 0.5
    moved = np.column_stack([middles, discs[:, 2] * scale, discs[:, 3]])
    seen = seen_by_network(small, near.astype(np.float32))
    return np.ascontiguousarray(seen.transpose(1, 2, 0)), wanted_of(moved, known > 0)


def _cropped(
    plane: npt.NDArray[Any], scale: float, at: tuple[float, float], size: tuple[int, int], how: int
) -> npt.NDArray[Any]:
    """(h, w, ...) of a plane from a place on, enlarged; its edge goes on outside."""
    shift = [(0.5 - start) * scale - 0.5 for start in at]
    matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    whole = np.ascontiguousarray(plane)
    return np.asarray(
        cv2.warpAffine(whole, matrix, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
    )


def wanted_of(discs: Floats, known: Flags) -> Floats32:
    """What the network should say.

    Args:
        discs: (N, 4) x, y, radius, visible fraction; of which some lie outside.
        known: (h, w) the places where anything can be said.

    Returns:
        (h, w, 8): a hill at each fruit's centre, 1 on its top; where the tops are; where anything
        else would be wrong; how much a place's circle matters; and its log radius, x and y to the
        centre in radii and visible fraction.
    """
    height, width = known.shape
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    hill, top, sure = (np.zeros((height, width), np.float32) for _ in range(3))
    asked = known.astype(np.float32)
    circle = np.zeros((height, width, OUTPUTS - 1), np.float32)
    for x, y, radius, visible in discs.tolist():
        column, row, size = (x + 0.5) / CELL - 0.5, (y + 0.5) / CELL - 0.5, radius / CELL
        place = round(row), round(column)
        if not (0 <= place[0] < height and 0 <= place[1] < width):
            continue
        squared = (columns - column) ** 2 + (rows - row) ** 2
        if visible < LEAST_VISIBLE:
            asked[squared < (0.6 * size) ** 2] = 0
            continue
        rise = np.exp(-squared / (2 * max(0.7, WIDE * size) ** 2))
        rise[place] = 1
        top[place] = 1
        mine = (rise > 0.3) & (rise > sure)
        sure[mine] = rise[mine]
        told = [np.full_like(rise, np.log(max(radius, 1) / USUAL_PX)), (column - columns) / size,
                (row - rows) / size, np.full_like(rise, visible)]  # fmt: skip
        circle[mine] = np.stack(told, -1)[mine]
        np.maximum(hill, rise, out=hill)
    asked[top > 0] = 0
    return np.concatenate([np.stack([hill, top, asked, sure], -1), circle], -1)
