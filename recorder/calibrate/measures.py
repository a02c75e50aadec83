"""What the rectified views say: rows that should agree, spacings that are known."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from recorder.calibrate.board import Board
from recorder.calibrate.fit import Fit
from recorder.calibrate.views import BoardView
from recorder.rectify import Rectification
from recorder.rig import Floats

BANDS: Final = 4  # of distance, with as many spacings each
PLACES: Final = (12, 8)  # across and down


@dataclass(frozen=True, slots=True)
class Spread:
    """Values as their middle and the median of how far they are from it."""

    count: int
    median: float
    mad: float


@dataclass(frozen=True, slots=True)
class Band:
    """The spacings of neighbouring corners in a band of distances, metres."""

    near_m: float
    far_m: float
    spacing_m: Spread


@dataclass(frozen=True, slots=True, eq=False)
class Measures:
    """Of all corners that both cameras see.

    Attributes:
        rows_px: (N, 3): x and y in the left rectified picture, right row minus left row.
        spacings_m: (S, 2): distance from the left camera, and the spacing measured there.
    """

    rows_px: Floats
    spacings_m: Floats

    @property
    def row_rms_px(self) -> float:
        """The root mean square of the rows' differences."""
        return float(np.sqrt((self.rows_px[:, 2] ** 2).mean()))

    @property
    def row_median_px(self) -> float:
        """The median of the rows' absolute differences."""
        return float(np.median(np.abs(self.rows_px[:, 2])))

    @property
    def spacing_m(self) -> Spread:
        """Of all spacings."""
        return _spread(self.spacings_m[:, 1])

    def bands(self) -> tuple[Band, ...]:
        """The spacings by distance."""
        if len(self.spacings_m) == 0:
            return ()
        edges = np.quantile(self.spacings_m[:, 0], np.linspace(0, 1, BANDS + 1))
        bands = []
        for near_m, far_m in pairwise(edges):
            inside = (self.spacings_m[:, 0] >= near_m) & (self.spacings_m[:, 0] <= far_m)
            bands.append(Band(float(near_m), float(far_m), _spread(self.spacings_m[inside, 1])))
        return tuple(bands)


def measure(board: Board, fitted: Fit, rectification: Rectification) -> Measures:
    """Rectify, triangulate, and hold against the board."""
    rows, spacings = [], []
    for view in fitted.views:
        here_rows, here_spacings = _of_view(board, view, rectification)
        rows.append(here_rows)
        spacings.append(here_spacings)
    return Measures(np.concatenate(rows), np.concatenate(spacings))


def _of_view(board: Board, view: BoardView, rectification: Rectification) -> tuple[Floats, Floats]:
    ids, left_px, right_px = view.left.shared(view.right)
    left = rectification.left.from_recorded(left_px)
    right = rectification.right.from_recorded(right_px)
    seen = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    ids, left, right = ids[seen], left[seen], right[seen]
    rows = np.column_stack([left, right[:, 1] - left[:, 1]])
    disparities_px = left[:, 0] - right[:, 0] + rectification.disparity_px(0.0, 0.0)
    depth_m = rectification.focal_px * rectification.baseline_m / disparities_px
    matrix = rectification.left.matrix
    places_m = np.column_stack([(left - matrix[:2, 2]) / matrix[[0, 1], [0, 1]], np.ones(len(ids))])
    places_m *= depth_m[:, None]
    where = {int(one): place for place, one in enumerate(ids)}
    spacings = []
    for one, place in where.items():
        beside = [one + 1] if (one + 1) % board.columns else []
        for other in (*beside, one + board.columns):
            if other in where:
                pair = places_m[[place, where[other]]]
                spacings.append(
                    (np.linalg.norm(pair.mean(axis=0)), np.linalg.norm(pair[1] - pair[0]))
                )
    return rows, np.array(spacings, float).reshape(-1, 2)


def measure_by_place(
    px: Floats, residuals_px: Floats, size_px: tuple[int, int]
) -> list[tuple[Floats, Floats]]:
    """The mean place and mean residual of each cell of the picture that has corners."""
    cells = np.floor(px / np.array(size_px) * PLACES).astype(int)
    found = []
    for cell in np.unique(cells, axis=0):
        inside = (cells == cell).all(axis=1)
        if inside.sum() >= 3:  # a mean of fewer says nothing
            found.append((px[inside].mean(axis=0), residuals_px[inside].mean(axis=0)))
    return found


def _spread(values: Floats) -> Spread:
    if len(values) == 0:
        return Spread(0, np.nan, np.nan)
    middle = float(np.median(values))
    return Spread(len(values), middle, float(np.median(np.abs(values - middle))))
