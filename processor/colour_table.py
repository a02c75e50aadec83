"""Recognise fruit by two learned tables: what a pixel's colour says, then what surrounds it."""

from dataclasses import dataclass
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from processor.trace import Recognition
from recorder.records import Picture

Bytes = npt.NDArray[np.uint8]
Packed = npt.NDArray[np.uint16]
"""(H, W) uint16: three channels packed into 5 + 6 + 5 bits."""

ENTRIES: Final = 1 << 16  # of a table: 5 + 6 + 5 bits
_READS_16_BITS: Final = int(cv2.__version__.partition(".")[0]) >= 5  # cv2.LUT reads uint16 since 5


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
    """

    model: ColourModel
    near_px: int = 13
    wide_px: int = 61
    threshold: int = 127

    def __call__(self, picture: Picture) -> Recognition:
        """Read both tables; the index shown is 255 times the probability of fruit."""
        evidence = read_table(self.model.colour, pack(cv2.GaussianBlur(picture, (3, 3), 0)))
        surroundings = pack(self.surroundings(evidence))
        index = cast("Bytes", cv2.blur(read_table(self.model.context, surroundings), (3, 3)))
        _, mask = cv2.threshold(index, self.threshold, 255, cv2.THRESH_BINARY)
        return Recognition(index, cast("Bytes", mask), calibrated=True)

    def surroundings(self, evidence: Bytes) -> Picture:
        """(H, W, 3) means of (H, W) evidence: wide, close, near; the order gives close 6 bits."""
        height, width = evidence.shape
        close = cv2.blur(evidence, (3, 3))
        near = cv2.blur(evidence, (self.near_px, self.near_px))
        # a quarter of the size is enough for a mean over 61 pixels, and costs a sixteenth
        small = cv2.resize(close, (width // 4, height // 4), interpolation=cv2.INTER_NEAREST)
        side = max(1, self.wide_px // 4)
        wide = cv2.resize(cv2.blur(small, (side, side)), (width, height))
        return cast("Picture", cv2.merge([wide, close, near]))


def pack(picture: cv2.typing.MatLike) -> Packed:
    """Pack (H, W, 3) uint8 into 5, 6 and 5 bits, (H, W) uint16, in one pass."""
    packed = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2BGR565))
    return packed.view(np.uint16)[..., 0]


def read_table(table: Bytes, packed: Packed) -> Bytes:
    """(H, W) uint8 entries of a (65536,) table."""
    if _READS_16_BITS:
        return cast("Bytes", cv2.LUT(packed, table))
    return cast("Bytes", np.take(table, packed))
