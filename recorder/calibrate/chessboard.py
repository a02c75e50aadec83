"""The inner corners of a chessboard, to parts of a pixel, always in the same order."""

from dataclasses import replace
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from recorder.calibrate.board import NO_CORNERS, Board, Corners
from recorder.rig import Floats

Grey = npt.NDArray[np.uint8]
"""(H, W) uint8."""

LOOK_PX: Final = 1280  # a board that is found at all is found in a picture so long; it is quicker
WINDOW_SHARE: Final = 0.25  # of a square: cornerSubPix must not see the next corner
WINDOWS_PX: Final = (2, 15)
QUARTER: Final = 0.28  # of a square from a corner: inside the squares around it, cut ones too
LIKE, MOST = 0.5, 0.75  # of the board's own contrast; of the corners of a row
_CLASSIC: Final = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_SECOND: Final = cv2.CALIB_CB_NORMALIZE_IMAGE


def find_chessboard(grey: Grey, board: Board) -> Corners:
    """All inner corners, or none.

    A chessboard partly out of the picture cannot be numbered, and one that goes on beyond the
    corners asked for is another board.
    """
    size = (board.columns, board.rows)
    longest = max(grey.shape)
    small = grey
    scale = min(1.0, LOOK_PX / longest)
    if scale < 1:
        small = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    found: Any
    ok, found = cv2.findChessboardCorners(small, size, flags=_CLASSIC)
    if not ok:
        ok, found = cv2.findChessboardCornersSB(small, size, flags=_SECOND)
    if not ok:
        return NO_CORNERS
    # pixel centres are integers: a picture's scale acts on corners of pixels, not on centres
    rough = (np.asarray(found, float).reshape(-1, 2) + 0.5) / scale - 0.5
    grid = _in_order(refine(grey, rough, board.columns).reshape(board.rows, board.columns, 2), grey)
    if goes_on(grey, grid):
        return NO_CORNERS
    return Corners(np.arange(board.columns * board.rows), grid.reshape(-1, 2))


def goes_on(grey: Grey, grid: Floats) -> bool:
    """Whether a (rows, columns, 2) grid has another row of corners beside one of its four."""
    contrast = np.median(np.abs(_saddles(grey, grid[1:-1, 1:-1], grid[1:-1, 2:], grid[2:, 1:-1])))
    for lines in (grid, grid[::-1], np.swapaxes(grid, 0, 1), np.swapaxes(grid, 0, 1)[::-1]):
        beyond = 3 * lines[0] - 3 * lines[1] + lines[2]  # as its neighbours curve
        along = np.concatenate([beyond[1:], 2 * beyond[-1:] - beyond[-2:-1]])
        found = _saddles(grey, beyond, along, 2 * beyond - lines[0])
        signs = np.where(np.arange(len(found)) % 2, 1, -1)
        if abs(np.sum(signs * np.sign(found) * (np.abs(found) > LIKE * contrast))) > MOST * len(
            found
        ):
            return True
    return False


def _saddles(grey: Grey, middles: Floats, along: Floats, across: Floats) -> Floats:
    """How much opposite quarters around (..., 2) places are alike and neighbouring ones differ.

    `along` and `across` are the next places in the two directions. 0 outside of the picture, and
    where opposite quarters differ.
    """
    u, v = QUARTER * (along - middles), QUARTER * (across - middles)
    a, b, c, d = (_sampled(grey, middles + s * u + t * v) for s, t in
                  ((1, 1), (-1, -1), (1, -1), (-1, 1)))  # fmt: skip
    contrast = (a + b - c - d) / 2
    unlike = np.maximum(np.abs(a - b), np.abs(c - d))
    return np.where(np.isfinite(contrast) & (unlike < np.abs(contrast)), contrast, 0.0)


def _sampled(grey: Grey, places_px: Floats) -> Floats:
    """The picture's values at (..., 2) places, nan outside of it."""
    x, y = np.moveaxis(np.rint(places_px).astype(int), -1, 0)
    height_px, width_px = grey.shape
    inside = (x >= 0) & (y >= 0) & (x < width_px) & (y < height_px)
    values = np.full(x.shape, np.nan)
    values[inside] = cv2.blur(grey, (3, 3))[y[inside], x[inside]]
    return values


def other_size(grey: Grey, board: Board) -> tuple[int, int] | None:
    """The size of the chessboard that is seen where `board` is not, or None."""
    # larger ones first: a part of a board is sometimes taken for a board
    steps = [(dx, dy) for dx in (1, 0, -1) for dy in (1, 0, -1) if dx or dy]
    for across, down in steps:
        other = replace(board, columns=board.columns + across, rows=board.rows + down)
        if min(other.columns, other.rows) >= 3 and len(find_chessboard(grey, other)):
            return other.columns, other.rows
    return None


def refine(grey: Grey, rough: Floats, columns: int) -> Floats:
    """Move (N, 2) corners of a whole grid to the saddle points of the picture."""
    grid = rough.reshape(-1, columns, 2)
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)]
    side_px = float(np.percentile(np.concatenate(steps), 10))
    window_px = int(np.clip(WINDOW_SHARE * side_px, *WINDOWS_PX))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start = rough.astype(np.float32).reshape(-1, 1, 2)
    moved = cv2.cornerSubPix(grey, start, (window_px, window_px), (-1, -1), criteria)
    return np.asarray(moved, float).reshape(-1, 2)


def _in_order(grid: Floats, grey: Grey) -> Floats:
    """Turn a (rows, columns, 2) grid so that both cameras number the corners alike.

    The board's front is seen, so its x axis turns clockwise into its y axis; of the two ways that
    remain, a board of unequal colours at opposite ends starts at a black square, another one with
    its x axis to the right.
    """
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:
        grid = grid[::-1]
    rows, columns = grid.shape[:2]
    if (rows + columns) % 2:
        first, last = (
            _brightness(grey, grid, *place) for place in ((0, 0), (rows - 2, columns - 2))
        )
        return grid[::-1, ::-1] if first > last else grid
    middle_along = grid[:, -1].mean(axis=0) - grid[:, 0].mean(axis=0)
    return grid[::-1, ::-1] if middle_along[0] < 0 else grid


def _brightness(grey: Grey, grid: Floats, row: int, column: int) -> float:
    """The mean grey value in the middle half of one square between four corners."""
    square = grid[row : row + 2, column : column + 2].reshape(4, 2)
    middle = square.mean(axis=0)
    outline = (middle + 0.5 * (square - middle))[[0, 1, 3, 2]]
    mask = np.zeros(grey.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint(outline).astype(np.int32), 1)
    inside = grey[mask > 0]
    return float(inside.mean()) if inside.size else 0.0
