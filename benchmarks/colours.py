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


Curve = tuple[str, tuple[int, int, int], list[tuple[Picture, npt.NDArray[np.bool_]]]]
"""A name, a BGR colour, and pictures with the pixels of them that count."""

_SPANS: Final = {"R-G": (-80, 200), "(R-G)/(G-B)": (-6, 6), "saturation": (0, 1), "edge": (0, 40)}
_PANEL_PX: Final = (180, 300)  # rows, columns of one histogram
_BINS: Final = 60


def histogram_row(title: str, curves: list[Curve]) -> Picture:
    """One panel a feature, side by side: the share of pixels in each bin, a line for each curve."""
    gathered = {
        name: [
            np.concatenate([colour_features(picture)[name][chosen] for picture, chosen in pictures])
            for _, _, pictures in curves
        ]
        for name in FEATURES
    }
    return np.hstack(
        [_panel(f"{title}: {name}", name, gathered[name], curves) for name in FEATURES]
    )


def _panel(
    title: str, name: str, values: list[npt.NDArray[np.float64]], curves: list[Curve]
) -> Picture:
    rows, columns = _PANEL_PX
    panel = np.full((rows + 40, columns, 3), 255, np.uint8)
    low, high = _SPANS[name]
    shares = [
        np.histogram(np.clip(v[~np.isnan(v)], low, high), _BINS, (low, high))[0] for v in values
    ]
    heights = [share / max(share.sum(), 1) for share in shares]
    top = max(0.01, *(float(np.sort(h)[-3]) for h in heights)) * 1.1
    x = np.linspace(8, columns - 8, _BINS)
    for (label, colour, _), height, n in zip(curves, heights, range(len(curves)), strict=True):
        y = rows + 18 - np.minimum(height / top, 1) * (rows - 10)
        line = np.stack([x, y], 1).round().astype(np.int32)
        cv2.polylines(panel, [line], False, colour, 1, cv2.LINE_AA)
        at = (columns - 120, 36 + 15 * n)
        cv2.putText(panel, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)
    black = (0, 0, 0)
    cv2.putText(panel, title, (8, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, black, 1, cv2.LINE_AA)
    for text, place in ((f"{low:g}", 8), (f"{high:g}", columns - 34)):
        at = (place, rows + 34)
        cv2.putText(panel, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.36, black, 1, cv2.LINE_AA)
    return panel
