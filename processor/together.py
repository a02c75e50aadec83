"""One outline for both views of a fruit: the same row, the same size, the same shape."""

from typing import Final

import numpy as np

from processor.rims import SPOKES, WIDER, WIDER_STD, Bytes, find_rims, tukey
from processor.trace import Floats

_SEARCHES: Final = 3
_TIGHTENINGS: Final = 6


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
    trust = np.diag([0.05] * 4 + [WIDER_STD**-2] * 2)
    for search in range(_SEARCHES):
        rims = [
            find_rims(index, state[:, [column, 2, 3]]) for column, index in enumerate((left, right))
        ]
        points = [
            state[:, None, [column, 2]] + side.reach_px[..., None] * SPOKES
            for column, side in enumerate(rims)
        ]
        for tightening in range(_TIGHTENINGS):
            scale = max(0.14 * 0.7 ** (tightening + 3 * search), 0.03) * state[:, 3:4] + 0.5
            normal = np.tile(trust, (count, 1, 1))
            slope = np.zeros((count, 6))
            slope[:, 4:] = (state[:, 4:] - [WIDER, 0.0]) / WIDER_STD**2
            for column, (side, at) in enumerate(zip(rims, points, strict=True)):
                jacobian, off = _linear(state, column, at)
                weighted = jacobian * (tukey(off / scale) * side.seen)[..., None]
                normal += weighted.transpose(0, 2, 1) @ jacobian
                slope += (weighted.transpose(0, 2, 1) @ off[..., None])[..., 0]
            step = -np.linalg.solve(normal, slope[..., None])[..., 0]
            limit = 0.15 * state[:, 3:4]
            step[:, :4] = np.clip(step[:, :4], -limit, limit)
            state = state + step
            state[:, 3] = np.maximum(state[:, 3], 3.0)
    return state[:, [0, 2, 3]], state[:, [1, 2, 3]]


def _linear(state: Floats, column: int, points: Floats) -> tuple[Floats, Floats]:
    """(M, RAYS, 6) derivatives and (M, RAYS) distances of a view's rim points to the outline."""
    away = points - state[:, None, [column, 2]]
    reach = np.linalg.norm(away, axis=2) + 1e-6
    cos, sin = away[..., 0] / reach, away[..., 1] / reach
    cos2, sin2 = cos * cos - sin * sin, 2 * cos * sin
    size = state[:, 3:4]
    shape = 1 + state[:, 4:5] * cos2 + state[:, 5:6] * sin2
    off = reach - size * shape
    nothing = np.zeros_like(cos)
    columns = [nothing, nothing, -sin, -shape, -size * cos2, -size * sin2]
    columns[column] = -cos
    return np.stack(columns, -1), off
