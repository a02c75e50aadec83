"""How pictures look in numbers, so that made ones can be held against real ones."""

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from recorder.records import Picture

QUANTILES: Final = (0.1, 0.5, 0.9)
FEATURES: Final = ("R-G", "(R-G)/(G-B)", "saturation", "edge")
_RATIO_LIMIT: Final = 20.0  # a ratio beyond this says no more than that G is near B


def colour_features(picture: Picture) -> dict[str, npt.NDArray[np.float64]]:
    """Each (H, W): R-G, (R-G)/(G-B) clipped to +-20, saturation 0..1, gradient of luminance.

    Args:
        picture: (H, W, 3) BGR.
    """
    blue, green, red = (picture[..., c].astype(float) for c in range(3))
    gap = green - blue
    ratio = np.divide(red - green, gap, out=np.full_like(gap, np.nan), where=gap != 0)
    top = picture.max(-1).astype(float)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float32)
    across, down = (cv2.Sobel(grey, cv2.CV_32F, dx, 1 - dx) / 8 for dx in (1, 0))
    return {
        "R-G": red - green,
        "(R-G)/(G-B)": np.clip(ratio, -_RATIO_LIMIT, _RATIO_LIMIT),
        "saturation": np.where(top > 0, (top - picture.min(-1)) / np.maximum(top, 1), 0),
        "edge": np.hypot(across, down).astype(float),
    }


def summary(
    pictures: list[tuple[Picture, npt.NDArray[np.bool_]]],
) -> dict[str, tuple[float, float, float]]:
    """The 10th, 50th and 90th percentile of every feature over the chosen pixels of all pictures.

    Args:
        pictures: each picture with the (H, W) pixels of it that count.
    """
    gathered: dict[str, list[npt.NDArray[np.float64]]] = {name: [] for name in FEATURES}
    for picture, chosen in pictures:
        for name, plane in colour_features(picture).items():
            gathered[name].append(plane[chosen])
    return {name: _quantiles(np.concatenate(values)) for name, values in gathered.items()}


def _quantiles(values: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    low, middle, high = np.nanquantile(values, QUANTILES)
    return float(low), float(middle), float(high)
