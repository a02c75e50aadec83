"""Smooth random fields and colour arithmetic: what every texture of the orchard is painted with."""

from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]
"""(H, W) or (H, W, 3) float32; colours are linear sRGB."""

_COARSE_SIGMA = 2.0  # a field is drawn so small that its blur is this wide, then enlarged
_BORDER = 4  # pixels of wrapped border: a cubic filter looks at most two beyond an edge


def field(
    rng: np.random.Generator,
    size: tuple[int, int],
    sigma: tuple[float, float] | float,
    *,
    wrap_rows: bool = True,
) -> Image:
    """A smooth random field of mean 0 and standard deviation 1 that wraps round.

    It is drawn small and enlarged: a wide Gaussian on a large texture would take seconds.

    Args:
        rng: where its randomness comes from.
        size: (rows, columns).
        sigma: the width of its features in pixels, (down, across) or both.
        wrap_rows: whether it also wraps from the last row to the first.

    Returns:
        (rows, columns) float32.
    """
    from scipy.ndimage import gaussian_filter

    rows, columns = size
    sigma_rows, sigma_columns = (sigma, sigma) if isinstance(sigma, int | float) else sigma
    small_rows = max(4, round(rows / max(1.0, sigma_rows / _COARSE_SIGMA)))
    small_columns = max(4, round(columns / max(1.0, sigma_columns / _COARSE_SIGMA)))
    rows_mode: Literal["wrap", "reflect"] = "wrap" if wrap_rows else "reflect"
    drawn = gaussian_filter(
        rng.standard_normal((small_rows, small_columns), np.float32),
        (sigma_rows * small_rows / rows, sigma_columns * small_columns / columns),
        mode=(rows_mode, "wrap"),
    )
    if (small_rows, small_columns) != size:
        drawn = np.pad(drawn, ((_BORDER, _BORDER), (0, 0)), mode="wrap" if wrap_rows else "edge")
        drawn = np.pad(drawn, ((0, 0), (_BORDER, _BORDER)), mode="wrap")
        y = (np.arange(rows, dtype=np.float32) + 0.5) * small_rows / rows - 0.5 + _BORDER
        x = (np.arange(columns, dtype=np.float32) + 0.5) * small_columns / columns - 0.5 + _BORDER
        grid_x, grid_y = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
        drawn = np.asarray(cv2.remap(drawn, grid_x, grid_y, cv2.INTER_CUBIC), np.float32)
    result: Image = ((drawn - drawn.mean()) / max(float(drawn.std()), 1e-9)).astype(np.float32)
    return result


def linear(srgb: npt.ArrayLike) -> Image:
    """Linear light of sRGB values 0..255 (IEC 61966-2-1)."""
    c = np.asarray(srgb, np.float32) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32)


def srgb8(light: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """The sRGB bytes of linear light, clipped to 0..1 (IEC 61966-2-1)."""
    c = np.clip(np.asarray(light, np.float32), 0, 1)
    curved = np.where(c <= 0.0031308, c * 12.92, 1.055 * c ** (1 / 2.4) - 0.055)
    return (curved * 255 + 0.5).astype(np.uint8)


def step(x: npt.ArrayLike) -> Image:
    """The logistic function: a soft step from 0 to 1."""
    return (1 / (1 + np.exp(-np.clip(np.asarray(x, np.float32), -60, 60)))).astype(np.float32)


def blend(a: npt.ArrayLike, b: npt.ArrayLike, share: npt.ArrayLike) -> Image:
    """`a` where `share` is 0, `b` where it is 1; `share` is a number or one plane (H, W)."""
    weight = np.asarray(share, np.float32)
    first, second = np.asarray(a, np.float32), np.asarray(b, np.float32)
    if weight.ndim == 2:
        weight = weight[..., None]  # a, b are colours, or pictures of them
    return (first * (1 - weight) + second * weight).astype(np.float32)


def unit(vectors: npt.ArrayLike) -> Floats:
    """(..., 3) vectors made one long."""
    v = np.asarray(vectors, np.float64)
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.maximum(length, 1e-12), np.float64)
