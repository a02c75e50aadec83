"""Corners held against their board, on a rig and a board that are exact."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from recorder.calibrate.board import Corners, parse_board
from recorder.calibrate.fit import Fit
from recorder.calibrate.measures import measure
from recorder.calibrate.views import BoardView
from recorder.rectify import rectify
from tests.builders import rig, rotation_of


def test_every_neighbour_along_rows_and_columns_is_one_square_away() -> None:
    straight = rig((640, 480), focal_px=570.0)
    moved = straight.right.matrix + np.array([[0, 0, 7.0], [0, 0, 0], [0, 0, 0]])
    parallel = rectify(replace(straight, right=replace(straight.right, matrix=moved)))
    assert parallel.disparity_px(0.0, 0.0) == pytest.approx(7.0)
    board = parse_board("chessboard:4x3:25mm")
    places_m = board.points_m @ rotation_of((0.3, -0.4, 0.1)).T + np.array([0.05, -0.03, 0.9])
    ids = np.arange(12)
    left, right = (Corners(ids, parallel.project(s, places_m)) for s in ("left", "right"))
    view = BoardView("a", left, right, (1.0, 1.0), (False, False))
    fitted = Fit(cast("Any", None), (view,), (), {}, {}, 0, 0.0, ((640, 480), (640, 480)))
    found = measure(board, fitted, parallel)
    assert found.row_rms_px == pytest.approx(0.0, abs=1e-9)
    assert found.spacing_m.count == 3 * 3 + 4 * 2
    assert found.spacings_m[:, 1] == pytest.approx(0.025)
    first_m = np.linalg.norm((places_m[0] + places_m[1]) / 2)
    assert found.spacings_m[0, 0] == pytest.approx(first_m)
