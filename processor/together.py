"""One outline for both views of a fruit: the same row, the same size, the same shape."""

from typing import Final

import numpy as np

from processor.rims import (
    SLOPES,
    SPOKES,
    TIGHTENINGS,
    WIDER,
    WIDER_STD,
    Bytes,
    distances,
    find_rims,
    tukey,
)
from processor.trace import Floats

_SEARCHES: Final = 2
# for each view: what moves a rim point's distance, columns left and right first
_SLOPES: Final = [np.insert(SLOPES, 1 - column, 0.0, axis=1) for column in range(2)]
_SQUARES: Final = [(s[:, :, None] * s[:, None, :]).reshape(len(s), -1) for s in _SLOPES]


def fit_together(
    left: Bytes, right: Bytes, left_circles: Floats, right_circles: Floats
) -> tuple[Floats, Floats]:
    """Fit both views' rims at once: columns are free, row, radius and second harmonic are shared.

    Where leaves hide one half in one view and the other half in the other, each view alone is
    free to slide; together they are not.

    Args:
        left: (H, W) evidence of the left view.
        right: the same of the right view.
        left_circles: (M, 3) x, y, radius.
        right_circles: (M, 3) of their partners.

    Returns:
        (M, 3) circles of the left and of the right view, of equal rows and radii.
    """
    count = len(left_circles)
    # columns left and right, row, radius, and the second harmonic's two parts
    state = np.column_stack([
        left_circles[:, 0], right_circles[:, 0], (left_circles[:, 1] + right_circles[:, 1]) / 2,
        (left_circles[:, 2] + right_circles[:, 2]) / 2, np.full(count, WIDER), np.zeros(count),
    ])  # fmt: skip
    for search in range(_SEARCHES):
        rims = [
            find_rims(index, state[:, [column, 2, 3]]) for column, index in enumerate((left, right))
        ]
        points = [
            state[:, None, [column, 2]] + side.reach_px[..., None] * SPOKES
            for column, side in enumerate(rims)
        ]
        for tightening in range(TIGHTENINGS):
            size = state[:, 3:4]
            scale = max(0.14 * 0.6 ** (tightening + 3 * search), 0.03) * size + 0.5
            bent = 1 / (WIDER_STD * state[:, 3]) ** 2
            normal = np.zeros((count, 6, 6))
            normal[:, range(6), range(6)] = np.stack([np.full(count, 0.05)] * 4 + [bent] * 2, -1)
            slope = np.zeros((count, 6))
            slope[:, 4:] = (bent * state[:, 3])[:, None] * (state[:, 4:] - [WIDER, 0.0])
            for column, (side, at) in enumerate(zip(rims, points, strict=True)):
                away = at - state[:, None, [column, 2]]
                off = distances(away[..., 0], away[..., 1], size, state[:, 4:])
                weights = tukey(off / scale) * side.seen
                normal += (weights @ _SQUARES[column]).reshape(count, 6, 6)
                slope += (weights * off) @ _SLOPES[column]
            step = -np.linalg.solve(normal, slope[..., None])[..., 0]
            step[:, :4] = np.clip(step[:, :4], -0.15 * size, 0.15 * size)
            step[:, 4:] /= size
            state = state + step
            state[:, 3] = np.maximum(state[:, 3], 3.0)
    return state[:, [0, 2, 3]], state[:, [1, 2, 3]]
