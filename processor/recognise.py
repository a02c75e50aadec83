"""Recognise fruit by colour (paper, Sec. 2.2): the rule in its three readings, and its rivals."""

from dataclasses import dataclass
from typing import Final, Literal, cast

import cv2
import numpy as np
import numpy.typing as npt

from processor.colour_table import ColourTable
from processor.trace import Mask, Recogniser, Recognition
from recorder.records import Picture

Reading = Literal["signed", "difference", "absolute"]


@dataclass(frozen=True, slots=True)
class ColourRatio:
    """The paper's rule: apple where R - G > 0 and (R - G) / (G - B) > 1 (Sec. 2.2, Abstract).

    The ratio is undefined at G = B and negative where B > G, and the paper does not say what
    then. Its words, "the difference between R and G was clearly greater than that between G and
    B", compare sizes of differences, so that reading is the default.

    Attributes:
        reading: "signed" takes the ratio literally (undefined is no apple, so G > B is needed);
            "difference" multiplies it out to R - G > G - B, true wherever R > G and B > G;
            "absolute" compares R - G with |G - B|.
    """

    reading: Reading = "absolute"

    def __call__(self, picture: Picture) -> Recognition:
        """Apply the rule to a (H, W, 3) BGR picture; the index shown is R - G.

        Saturating 8-bit arithmetic is exact here: a negative R - G becomes 0 and can exceed
        nothing, and a negative G - B becomes 0, which every positive R - G exceeds.
        """
        blue, green, red = cv2.split(picture)
        red_green = cv2.subtract(red, green)
        if self.reading == "absolute":
            mask = cv2.compare(red_green, cv2.absdiff(green, blue), cv2.CMP_GT)
        else:
            green_blue = cv2.subtract(green, blue)
            mask = cv2.compare(red_green, green_blue, cv2.CMP_GT)
            if self.reading == "signed":
                mask = cv2.bitwise_and(mask, cv2.compare(green, blue, cv2.CMP_GT))
        return Recognition(_bytes(red_green), _bytes(mask))


@dataclass(frozen=True, slots=True)
class TwoRedMinusGreenBlue:
    """The indicator 2R - G - B (Sec. 2.2), clipped to 0..255 and cut at a threshold.

    Attributes:
        threshold: apple above it; None lets Otsu's method choose. The paper gives no number.
    """

    threshold: float | None = None

    def __call__(self, picture: Picture) -> Recognition:
        """Apply the indicator to a (H, W, 3) BGR picture."""
        weights = np.array([[-1.0, -1.0, 2.0]], np.float32)
        index = cv2.transform(picture, weights)
        return Recognition(_bytes(index), _cut(_bytes(index), self.threshold))


@dataclass(frozen=True, slots=True)
class RedMinusLuma:
    """The indicator Y - R (Sec. 3.1), with its sign turned so that fruit is bright.

    Attributes:
        threshold: apple where R - Y is above it; None lets Otsu's method choose. The paper gives
            no number.
    """

    threshold: float | None = None

    def __call__(self, picture: Picture) -> Recognition:
        """Apply the indicator to a (H, W, 3) BGR picture; luma is that of ITU-R BT.601."""
        luma = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        index = cv2.subtract(cv2.extractChannel(picture, 2), luma)
        return Recognition(_bytes(index), _cut(_bytes(index), self.threshold))


def _cut(index: npt.NDArray[np.uint8], threshold: float | None) -> Mask:
    otsu = cv2.THRESH_OTSU if threshold is None else 0
    _, mask = cv2.threshold(index, threshold or 0, 255, cv2.THRESH_BINARY | otsu)
    return _bytes(mask)


def _bytes(array: object) -> npt.NDArray[np.uint8]:
    """OpenCV's stubs do not say that 8 bits in are 8 bits out."""
    return cast("npt.NDArray[np.uint8]", array)


RECOGNISE: Final[dict[str, type[Recogniser]]] = {
    "colour_ratio": ColourRatio,
    "two_red_minus_green_blue": TwoRedMinusGreenBlue,
    "red_minus_luma": RedMinusLuma,
    "colour_table": ColourTable,
}
