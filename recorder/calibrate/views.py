"""Pairs of pictures -> the corners that each camera sees, and why where it sees none."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from recorder.calibrate.board import Board, Corners
from recorder.calibrate.charuco import (
    CharucoFinder,
    Pattern,
    charuco_finder,
    has_markers_mirrored,
)
from recorder.calibrate.chessboard import Grey, find_chessboard, other_size
from recorder.errors import PomologError
from recorder.records import SIDES, Side

SAMPLES: Final = 6  # pictures that tell a ChArUco board's dictionary and pattern
MIN_CORNERS: Final = 12  # of one view: a pose and a lens want more than a square
MIN_SPREAD: Final = 0.02  # of the second to the first direction: fewer rows than two are a line
DARK, FLAT = 12.0, 6.0  # mean and standard deviation of grey values of an empty picture
BLUR_SHARE: Final = 0.15  # of the median sharpness of the others


@dataclass(frozen=True, slots=True, eq=False)
class PicturePair:
    """One position of the board before both cameras, decoded."""

    name: str  # what a user knows it by
    left: Grey
    right: Grey


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """What both cameras see of the board in one position."""

    name: str
    left: Corners
    right: Corners
    sharpness: tuple[float, float]  # variance of the Laplacian, left and right
    empty: tuple[bool, bool]  # nothing but one grey value

    def corners(self, side: Side) -> Corners:
        """What one camera sees."""
        return self.left if side == "left" else self.right

    @property
    def whole(self) -> bool:
        """Whether both cameras see enough of it."""
        return _enough(self.left) and _enough(self.right)


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """All views of one board.

    Attributes:
        left_size_px, right_size_px: (width, height) of every picture of a side.
        pattern: of a ChArUco board, as it was found.
    """

    board: Board
    views: tuple[BoardView, ...]
    left_size_px: tuple[int, int]
    right_size_px: tuple[int, int]
    pattern: Pattern | None = None

    def size_px(self, side: Side) -> tuple[int, int]:
        """(width, height) of one side's pictures."""
        return self.left_size_px if side == "left" else self.right_size_px

    @property
    def shown(self) -> str:
        """The board as it was found, in a user's words."""
        if self.pattern is None:
            return str(self.board)
        old = ", legacy pattern" if self.pattern.legacy else ""
        return f"{self.board} ({self.pattern.dictionary}{old})"

    @property
    def whole(self) -> tuple[BoardView, ...]:
        """The views that both cameras see enough of."""
        return tuple(view for view in self.views if view.whole)


Pairs = Callable[[], Iterable[PicturePair]]
"""Gives the pairs again each time it is called, so that they need not be kept."""


def sight(board: Board, pairs: Pairs, tick: Callable[[], None] = lambda: None) -> Sighting:
    """Find the board in every pair of pictures.

    Args:
        board: what is looked for.
        pairs: called once for a chessboard, twice for a ChArUco board.
        tick: called after each pair.

    Raises:
        PomologError: pictures of different sizes, or no board anywhere.
    """
    finder = _charuco(board, pairs) if board.kind == "charuco" else None
    views: list[BoardView] = []
    sizes: list[tuple[int, int]] = []
    sharpest: dict[str, tuple[float, Grey]] = {}
    for pair in pairs():
        here = [_size(pair.left), _size(pair.right)]
        if sizes and here != sizes:
            place = int(here[0] == sizes[0])
            raise PomologError(
                f"the {SIDES[place]} picture of {pair.name} is {here[place][0]} x "
                f"{here[place][1]} px, those before it {sizes[place][0]} x {sizes[place][1]}; "
                "a camera has one size"
            )
        sizes = here
        left, right = (
            finder(grey) if finder else find_chessboard(grey, board)
            for grey in (pair.left, pair.right)
        )
        sharpness = _sharpness(pair.left), _sharpness(pair.right)
        empty = _is_empty(pair.left), _is_empty(pair.right)
        views.append(BoardView(pair.name, left, right, sharpness, empty))
        for side, grey, sharp in zip(SIDES, (pair.left, pair.right), sharpness, strict=True):
            if side not in sharpest or sharp > sharpest[side][0]:
                sharpest[side] = (sharp, grey)
        tick()
    if not views:
        raise PomologError("no pictures to calibrate from; are the folders right?")
    found = Sighting(board, tuple(views), sizes[0], sizes[1], finder.pattern if finder else None)
    for side in SIDES:
        if not any(len(view.corners(side)) for view in views):
            raise PomologError(_no_board(found, side, sharpest[side][1], finder))
    return found


def _charuco(board: Board, pairs: Pairs) -> CharucoFinder:
    """The finder for the pattern that pictures from all over the set show."""
    samples: list[Grey] = []
    step = 1
    for place, pair in enumerate(pairs()):
        if place % step:
            continue
        grey = pair.left if len(samples) % 2 else pair.right
        if not _is_empty(grey):
            samples.append(grey)
        if len(samples) == 2 * SAMPLES:
            samples, step = samples[::2], 2 * step
    if not samples:
        raise PomologError(f"no {board} in the pictures: they are empty; was a lens covered?")
    return charuco_finder(board, samples[:SAMPLES])


def why_not(view: BoardView, sighting: Sighting) -> str:
    """What is wrong with a view's pictures, in a user's words; "" where nothing can be told."""
    for place, side in enumerate(SIDES):
        corners = view.corners(side)
        if _enough(corners) and not view.whole:
            continue
        usual = float(np.median([other.sharpness[place] for other in sighting.views]))
        if view.empty[place]:
            return f"the {side} picture is empty"
        if view.sharpness[place] < BLUR_SHARE * usual:
            return f"the {side} picture is blurred"
        if len(corners) and not view.whole:
            return f"only {len(corners)} corners in the {side} picture"
    unseen = [side for side in SIDES if not _enough(view.corners(side))]
    if not unseen:
        return ""
    return f"no board in the {unseen[0]} picture" if len(unseen) == 1 else "no board in either"


def _enough(corners: Corners) -> bool:
    if len(corners) < MIN_CORNERS:
        return False
    long, short = np.linalg.svd(corners.px - corners.px.mean(axis=0), compute_uv=False)
    return bool(short > MIN_SPREAD * long)


def _no_board(sighting: Sighting, side: Side, sharpest: Grey, finder: CharucoFinder | None) -> str:
    """What to say where a camera never sees the board."""
    where = f"no {sighting.board} in any of the {len(sighting.views)} {side} pictures"
    if all(view.empty[SIDES.index(side)] for view in sighting.views):
        return f"{where}: they are empty"
    if finder is not None:
        if has_markers_mirrored(sharpest, finder):
            return f"{where}, but in their mirror images: the {side} pictures are mirrored"
        return f"{where}; does that camera see the board?"
    other = other_size(sharpest, sighting.board)
    if other is not None:
        return f"{where}, but one of {other[0]}x{other[1]}; count its inner corners again"
    return f"{where}; the numbers are of inner corners: a board of 10x7 squares is 9x6"


def _size(grey: Grey) -> tuple[int, int]:
    return grey.shape[1], grey.shape[0]


def _is_empty(grey: Grey) -> bool:
    return bool(grey.std() < FLAT or grey.mean() < DARK)


def _sharpness(grey: Grey) -> float:
    return float(cv2.Laplacian(grey, cv2.CV_64F).var())
