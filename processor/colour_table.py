"""Recognise fruit by two learned tables: what a pixel's colour says, then what surrounds it."""

from dataclasses import dataclass
from typing import Annotated, Final, cast

import cv2
import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Le

from processor.trace import Recognition
from recorder.records import Picture

Bytes = npt.NDArray[np.uint8]
Packed = npt.NDArray[np.uint16]
"""(H, W) uint16: three channels packed into 5 + 6 + 5 bits."""

ENTRIES: Final = 1 << 16  # of a table: 5 + 6 + 5 bits
BRIGHTEST: Final = 248  # of a mean of pixels: from there on, most of them were clipped
DARKEST: Final = 7  # all channels up to there: likewise; both at the edge of five bits


@dataclass(frozen=True, slots=True, eq=False)
class ColourModel:
    """What was learned of colours, by `pomolog train`.

    Attributes:
        name: the model's file, without its ending.
        colour: (65536,) uint8, 255 times the probability of fruit for a packed BGR colour.
        context: (65536,) uint8, the same for a packed triple of means of `colour` around a pixel.
    """

    name: str
    colour: Bytes
    context: Bytes


@dataclass(frozen=True, slots=True)
class ColourTable:
    """One table read per pixel for its colour, and one for the evidence around it.

    The first table cannot tell a red leaf from an apple, or an apple's yellow cheek from a leaf;
    the second sees how much evidence there is within a pixel, within a leaf's width, and within an
    apple's, and learned what that means. Both were learned over a range of exposures.

    Attributes:
        model: both tables.
        near_px: side of the box for evidence around a pixel; about a far apple's radius.
        wide_px: side of the box for evidence around a fruit; about a fruit's diameter.
        threshold: fruit where the smoothed probability is above this share of 255.
        halved_from_px: pictures of so many pixels are read at half their size, in a quarter of the
            time; None: never.
    """

    model: ColourModel
    near_px: Annotated[int, Ge(1)] = 13
    wide_px: Annotated[int, Ge(1)] = 61
    threshold: Annotated[int, Ge(0), Le(255)] = 127
    halved_from_px: Annotated[int, Ge(1)] | None = None

    def __call__(self, picture: Picture) -> Recognition:
        """Read both tables; the index shown is 255 times the probability of fruit."""
        height, width = picture.shape[:2]
        seen = self.smooth(picture)
        packed = pack(seen)
        evidence = read_table(self.model.colour, packed)
        surroundings = pack(self.surroundings(evidence, width / evidence.shape[1]))
        found = read_table(self.model.context, surroundings)
        if found.shape == (height, width):
            index = cast("Bytes", cv2.blur(found, (3, 3)))
        else:
            index = cast("Bytes", cv2.resize(found, (width, height)))
        _, mask = cv2.threshold(index, self.threshold, 255, cv2.THRESH_BINARY)
        return Recognition(
            index, cast("Bytes", mask), calibrated=True, clipped=clipped(packed, (width, height))
        )

    def smooth(self, picture: cv2.typing.MatLike) -> Picture:
        """What colours are read of: a large picture at half its size, a small one blurred."""
        height, width = picture.shape[:2]
        if self.halved_from_px is not None and height * width >= self.halved_from_px:
            size_px = (width // 2, height // 2)
            return cast("Picture", cv2.resize(picture, size_px, interpolation=cv2.INTER_AREA))
        return cast("Picture", cv2.GaussianBlur(picture, (3, 3), 0))

    def surroundings(self, evidence: Bytes, shrunk: float) -> Picture:
        """(H, W, 3) means of (H, W) evidence: wide, close, near; the order gives close 6 bits.

        Args:
            evidence: of every pixel that was read.
            shrunk: by how much the picture was larger than it.
        """
        height, width = evidence.shape
        close = cv2.blur(evidence, (3, 3)) if shrunk == 1 else evidence
        near_px = 2 * round((self.near_px / shrunk - 1) / 2) + 1
        near = cv2.blur(evidence, (near_px, near_px))
        # a quarter of the size is enough for a mean over 61 pixels, and costs a sixteenth
        coarser = max(1, round(4 / shrunk))
        small = cv2.resize(
            close, (width // coarser, height // coarser), interpolation=cv2.INTER_NEAREST
        )
        side = max(1, self.wide_px // 4)
        wide = cv2.resize(cv2.blur(small, (side, side)), (width, height))
        return cast("Picture", cv2.merge([wide, close, near]))


def clipped(packed: Packed, size_px: tuple[int, int]) -> Bytes:
    """255 where a channel is at its upper end, or all are at their lower; of that size."""
    lost = read_table(_CLIPPED, packed)
    if lost.shape[::-1] == size_px:
        return lost
    return cast("Bytes", cv2.resize(lost, size_px, interpolation=cv2.INTER_NEAREST))


def pack(picture: cv2.typing.MatLike) -> Packed:
    """Pack (H, W, 3) uint8 into 5, 6 and 5 bits, (H, W) uint16, in one pass."""
    packed = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2BGR565))
    return packed.view(np.uint16)[..., 0]


def read_table(table: Bytes, packed: Packed) -> Bytes:
    """(H, W) uint8 entries of a (65536,) table."""
    return cast("Bytes", cv2.LUT(packed, table))


def _clipped_entries() -> Bytes:
    """(65536,) 255 at packed colours that were clipped."""
    entry = np.arange(ENTRIES)
    blue, green, red = entry & 31, entry >> 5 & 63, entry >> 11
    over = (np.maximum(blue, red) >= BRIGHTEST >> 3) | (green >= BRIGHTEST >> 2)
    under = (np.maximum(blue, red) <= DARKEST >> 3) & (green <= DARKEST >> 2)
    return np.where(over | under, np.uint8(255), np.uint8(0))


_CLIPPED: Final = _clipped_entries()
