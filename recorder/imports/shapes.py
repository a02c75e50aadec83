"""What labelling tools draw: polygons, masks, boxes and circles, and the pixels that they cover.

Coordinates are of the labelling tools: (0, 0) is the upper left corner of the first pixel, whose
centre is (0.5, 0.5). Sessions count from the first pixel's centre, half a pixel less.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from recorder.errors import PomologError
from recorder.records import UNCOUNTED, Labels, Outline, OutlineKind, Side
from recorder.rig import Floats

Mask = npt.NDArray[np.bool_]

LARGEST_PX: Final = 1e6  # no picture is as large; a coordinate beyond it is damage
HALF_PX: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One labelled thing in one picture.

    Exactly one of the first three says where it is.

    Attributes:
        polygons: each (N, 2) float64 x, y; together they are one thing.
        mask: its pixels and where they begin, (x, y) of the left upper one.
        box: x, y, width, height.
        kind: of the box: itself, or the square around a circle.
        id: the apple's number, the same in all pictures; None where nobody said.
        number: its number in this picture alone; None where nobody said.
        category: its class.
        uncounted: a crowd, or fruit to be ignored: it counts neither way.
        where: the file and place of the label, for messages.
    """

    polygons: tuple[Floats, ...] = ()
    mask: tuple[Mask, tuple[int, int]] | None = None
    box: tuple[float, float, float, float] | None = None
    kind: OutlineKind = "box"
    id: int | None = None
    number: int | None = None
    category: str = ""
    uncounted: bool = False
    where: str = ""

    def __post_init__(self) -> None:
        numbers = [np.asarray(self.box or (), float), *self.polygons]
        if not all((np.abs(part) < LARGEST_PX).all() for part in numbers):
            raise PomologError(
                f"{self.where}: a coordinate is not finite, or absurdly large; label it again"
            )
        if self.box is not None and min(self.box[2:]) < 0:
            raise PomologError(f"{self.where}: a box of negative width or height; label it again")
        if any(part.ndim != 2 or part.shape[1] != 2 or len(part) < 3 for part in self.polygons):
            raise PomologError(f"{self.where}: a polygon needs three points or more")
        for known in (self.id, self.number):
            if known is not None and not 0 < known < UNCOUNTED:
                raise PomologError(f"{self.where}: id {known}; ids go from 1 to {UNCOUNTED - 1}")

    @property
    def has_pixels(self) -> bool:
        """Whether it says which pixels it covers."""
        return self.box is None

    def bounds(self) -> tuple[float, float, float, float]:
        """x, y, width, height of all of it."""
        if self.box is not None:
            return self.box
        if self.mask is not None:
            rows, columns = np.nonzero(self.mask[0])
            if len(rows) == 0:
                return float(self.mask[1][0]), float(self.mask[1][1]), 0.0, 0.0
            x, y = self.mask[1][0] + columns.min(), self.mask[1][1] + rows.min()
            return float(x), float(y), float(np.ptp(columns)) + 1, float(np.ptp(rows)) + 1
        points = np.concatenate(self.polygons)
        (x, y), (width, height) = points.min(axis=0).tolist(), np.ptp(points, axis=0).tolist()
        return x, y, width, height

    def outline(self, side: Side, apple_id: int) -> Outline:
        """Its box or circle as a session keeps it."""
        x, y, width, height = self.bounds()
        number = UNCOUNTED if self.uncounted else apple_id
        return Outline(side, number, self.kind, x - HALF_PX, y - HALF_PX, width, height)


@dataclass(frozen=True, slots=True, eq=False)
class PictureLabels:
    """All labels of one picture; no shapes: somebody looked, and there is nothing."""

    name: str  # as the tool has it, folders with slashes
    shapes: tuple[Shape, ...]
    size_px: tuple[int, int] | None = None  # None: the file does not say
    frame: int | None = None  # its number in a video, where that is all that is known
    fractions: bool = False  # coordinates are fractions of the picture's width and height
    partial: bool = False  # unlabelled fruit exist
    identified: bool = True  # False: the pixels are of apples, but nobody said which are one


def circle(x: float, y: float, radius: float) -> tuple[float, float, float, float]:
    """The square around a circle, as a shape's box."""
    return x - radius, y - radius, 2 * radius, 2 * radius


def draw(shapes: Sequence[tuple[int, Shape]], size_px: tuple[int, int]) -> Labels:
    """Label pixels of shapes with their numbers; where two overlap, the smaller has the pixel.

    A pixel belongs to a polygon that holds its centre, holes by the even-odd rule.
    """
    width_px, height_px = size_px
    labels = np.zeros((height_px, width_px), np.uint16)
    masks = [(number, *_pixels(shape, size_px)) for number, shape in shapes]
    for number, mask, (x, y) in sorted(masks, key=lambda item: -int(item[1].sum())):
        window = labels[y : y + mask.shape[0], x : x + mask.shape[1]]
        window[mask[: window.shape[0], : window.shape[1]]] = number
    return labels


def _pixels(shape: Shape, size_px: tuple[int, int]) -> tuple[Mask, tuple[int, int]]:
    """A shape's mask and the pixel where it begins, cut to the picture."""
    if shape.mask is not None:
        mask, start = shape.mask
        cut = max(0, -start[0]), max(0, -start[1])
        return mask[cut[1] :, cut[0] :], (start[0] + cut[0], start[1] + cut[1])
    x, y, width, height = shape.bounds()
    x0, y0 = (int(np.clip(np.floor(v), 0, size_px[i])) for i, v in enumerate((x, y)))
    x1, y1 = (
        int(np.clip(np.ceil(v), 0, size_px[i])) for i, v in enumerate((x + width, y + height))
    )
    return _fill(shape.polygons, (x0, y0), (max(0, x1 - x0), max(0, y1 - y0))), (x0, y0)


def _fill(polygons: Sequence[Floats], start: tuple[int, int], size: tuple[int, int]) -> Mask:
    """Pixels whose centres are in an odd number of polygons; a part's own even-odd rule holds."""
    columns, rows = start[0] + np.arange(size[0]) + HALF_PX, start[1] + np.arange(size[1]) + HALF_PX
    mask = np.zeros((size[1], size[0]), bool)
    for polygon in polygons:
        part = np.zeros_like(mask)
        for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            crossed = (y0 <= rows) != (y1 <= rows)
            if not crossed.any():
                continue
            at = x0 + (rows[crossed] - y0) * (x1 - x0) / (y1 - y0)
            part[crossed] ^= columns[None, :] >= at[:, None]
        mask |= part
    return mask


# run lengths


def mask_of_runs(runs: Sequence[int], size: tuple[int, int], where: str) -> Mask:
    """COCO's run lengths, column by column, background first, as an (H, W) mask.

    Args:
        runs: alternating counts.
        size: (height, width).
        where: for messages.

    Raises:
        PomologError: they do not fill the picture exactly.
    """
    counts = np.asarray(runs, np.int64)
    if (counts < 0).any() or int(counts.sum()) != size[0] * size[1]:
        raise PomologError(
            f"{where}: run lengths do not fill {size[1]} x {size[0]} px; export it again"
        )
    values = np.arange(len(counts)) % 2 == 1
    return np.repeat(values, counts).reshape(size[::-1]).T


def cropped(mask: Mask) -> tuple[Mask, tuple[int, int]]:
    """The part that holds all of a mask, and where it begins: a file has thousands."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return np.zeros((0, 0), bool), (0, 0)
    y, x = int(rows[0]), int(columns[0])
    return mask[y : rows[-1] + 1, x : columns[-1] + 1].copy(), (x, y)


def runs_of_mask(mask: Mask) -> list[int]:
    """The reverse of `mask_of_runs`."""
    flat = np.concatenate([[False], mask.T.ravel()])
    changes = np.flatnonzero(np.diff(flat.astype(np.int8)))
    edges = np.concatenate([[0], changes, [mask.size]])
    return [int(n) for n in np.diff(edges)]


def unpack_runs(text: str, where: str) -> list[int]:
    """COCO's compressed counts: 5 bits a character, from the third on as differences.

    Source: `rleFrString` of cocoapi's maskApi.c.
    """
    runs: list[int] = []
    value = shift = 0
    for character in text.encode("ascii", "replace"):
        if not 48 <= character < 112 or shift > 60:
            raise PomologError(f"{where}: no compressed run lengths; export it again")
        bits = character - 48
        value |= (bits & 0x1F) << shift
        shift += 5
        if bits & 0x20:
            continue
        if bits & 0x10:
            value |= -1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = shift = 0
    return runs


def pack_runs(runs: Sequence[int]) -> str:
    """The reverse of `unpack_runs`."""
    packed = bytearray()
    for place, run in enumerate(runs):
        value = run - runs[place - 2] if place > 2 else run
        while True:
            bits = value & 0x1F
            value >>= 5
            more = value != -1 if bits & 0x10 else value != 0
            packed.append(48 + (bits | 0x20 if more else bits))
            if not more:
                break
    return packed.decode()
