"""Is a picture fit for the locator? Exposure and focus, in half a millisecond.

Over- and under-exposed pictures defeated the paper's method, so the operator hears of them while
something can still be done.
"""

from dataclasses import dataclass
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from recorder.cameras import Shot
from recorder.records import Picture

OVER_LEVEL: Final = 250
UNDER_LEVEL: Final = 5
OVER_SHARE: Final = 0.02  # more blown-out pixels than this: apples lose their colour
UNDER_SHARE: Final = 0.20
BLUR_FOCUS: Final = 4.0  # below it, not even sensor noise is sharp

Grey = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """What a look at one picture found.

    Attributes:
        overexposed: the share of pixels at or above 250.
        underexposed: the share of pixels at or below 5.
        focus: the variance of the Laplacian.
        histogram: (32,) counts of green levels, for the preview.
    """

    overexposed: float
    underexposed: float
    focus: float
    histogram: npt.NDArray[np.int64]

    def warnings(self, side: str) -> tuple[str, ...]:
        """What the operator should hear."""
        found = []
        if self.overexposed > OVER_SHARE:
            found.append(f"{side}: {self.overexposed:.0%} overexposed")
        if self.underexposed > UNDER_SHARE:
            found.append(f"{side}: {self.underexposed:.0%} underexposed")
        if self.focus < BLUR_FOCUS:
            found.append(f"{side}: out of focus")
        return tuple(found)


def green_plane(shot: Shot) -> Grey:
    """One green value of each 2 x 2 pixels: (H / 2, W / 2) uint8.

    A JPEG is decoded at half size, which its transform gives almost for nothing.
    """
    width_px, height_px = shot.size_px
    if shot.encoding == "bayer_rggb8":
        mosaic = np.frombuffer(shot.data, np.uint8).reshape(height_px, width_px)
        return mosaic[0::2, 1::2]
    return half_size(shot)[:, :, 1]


def half_size(shot: Shot) -> Picture:
    """The picture at half its size, (H / 2, W / 2, 3) BGR, as a preview shows it."""
    width_px, height_px = shot.size_px
    buffer = np.frombuffer(shot.data, np.uint8)
    if shot.encoding == "bayer_rggb8":  # a pixel of each colour in every 2 x 2: no interpolation
        mosaic = buffer.reshape(height_px, width_px)
        red, green, blue = mosaic[0::2, 0::2], mosaic[0::2, 1::2], mosaic[1::2, 1::2]
        rows, columns = height_px // 2, width_px // 2
        return np.dstack([plane[:rows, :columns] for plane in (blue, green, red)])
    if shot.encoding == "bgr8":
        return buffer.reshape(height_px, width_px, 3)[::2, ::2]
    picture = cv2.imdecode(buffer, cv2.IMREAD_REDUCED_COLOR_2)
    if picture is None:  # whole by its markers, damaged inside
        return np.zeros((height_px // 2, width_px // 2, 3), np.uint8)
    return cast("Picture", picture)


def look_at(shot: Shot) -> Exposure:
    """Judge one complete picture."""
    green = np.ascontiguousarray(green_plane(shot))
    histogram = cv2.calcHist([green], [0], None, [256], [0, 256]).ravel().astype(np.int64)
    return Exposure(
        overexposed=float(histogram[OVER_LEVEL:].sum() / green.size),
        underexposed=float(histogram[: UNDER_LEVEL + 1].sum() / green.size),
        focus=float(cv2.Laplacian(green, cv2.CV_16S).var()),
        histogram=histogram.reshape(32, 8).sum(axis=1),
    )
