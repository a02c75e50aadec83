"""The board that is held before the cameras, and how a user writes it down.

chessboard:9x6:25mm                  inner corners, side of a square
charuco:31x16:49.33mm:38.46mm[:4x4]  squares, side of a square, side of a marker, dictionary
"""

import re
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from recorder.errors import PomologError
from recorder.rig import Floats

Ints = npt.NDArray[np.int64]

FORM: Final = "chessboard:9x6:25mm or charuco:31x16:49.33mm:38.46mm"
UNITS_M: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
SQUARES_M: Final = (1e-3, 1.0)  # a square outside of this is a unit mistaken, not a board
MAX_SQUARES: Final = 100  # a side; more is a slip of the keyboard


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """What one camera sees of the board.

    Attributes:
        ids: (N,) int64, rising; corner `row * columns + column` of the board.
        px: (N, 2) float64, x and y, to parts of a pixel.
    """

    ids: Ints
    px: Floats

    def __len__(self) -> int:
        """The number of corners."""
        return len(self.ids)

    def shared(self, other: "Corners") -> tuple[Ints, Floats, Floats]:
        """The ids that both see, and where each sees them."""
        ids, mine, theirs = np.intersect1d(self.ids, other.ids, return_indices=True)
        return ids, self.px[mine], other.px[theirs]


NO_CORNERS: Final = Corners(np.empty(0, np.int64), np.empty((0, 2)))


@dataclass(frozen=True, slots=True)
class Board:
    """A flat board of squares.

    Attributes:
        columns: inner corners in a row.
        rows: inner corners in a column.
        square_m: the side of a square.
        marker_m: the side of a ChArUco marker, None on a chessboard.
        dictionary: of the markers, in a user's words; "" where it is to be found out.
    """

    kind: Literal["chessboard", "charuco"]
    columns: int
    rows: int
    square_m: float
    marker_m: float | None = None
    dictionary: str = ""

    @property
    def points_m(self) -> Floats:
        """(N, 3) places of the inner corners on the board, row by row, z = 0."""
        rows, columns = np.mgrid[: self.rows, : self.columns]
        flat = np.column_stack([columns.ravel(), rows.ravel(), np.zeros(columns.size)])
        return np.asarray(flat * self.square_m, float)

    @property
    def squares(self) -> tuple[int, int]:
        """The number of squares across and down."""
        return self.columns + 1, self.rows + 1

    @property
    def marker_count(self) -> int:
        """How many markers a ChArUco board of this size has."""
        across, down = self.squares
        return across * down // 2

    def __str__(self) -> str:
        """As a user writes it."""
        square = f"{self.square_m * 1e3:g}mm"
        if self.marker_m is None:
            return f"chessboard:{self.columns}x{self.rows}:{square}"
        across, down = self.squares
        name = f":{self.dictionary}" if self.dictionary else ""
        return f"charuco:{across}x{down}:{square}:{self.marker_m * 1e3:g}mm{name}"


def parse_board(text: str) -> Board:
    """Read a board from a user's words.

    Raises:
        PomologError: another form, a length without its unit, or a size that no board has.
    """
    kind, *rest = text.strip().split(":")
    if kind not in ("chessboard", "charuco") or not rest:
        raise PomologError(f"no board {text!r}; give --board {FORM}")
    if kind == "chessboard" and len(rest) == 2:
        columns, rows = _count(rest[0], text)
        return Board("chessboard", columns, rows, _length_m(rest[1], text))
    if kind == "charuco" and len(rest) in (3, 4):
        across, down = _count(rest[0], text)
        square_m, marker_m = (_length_m(word, text) for word in rest[1:3])
        if not marker_m < square_m:
            raise PomologError(
                f"--board {text}: a marker is smaller than its square; give the square's side first"
            )
        name = rest[3] if len(rest) == 4 else ""
        return Board("charuco", across - 1, down - 1, square_m, marker_m, name)
    raise PomologError(f"--board {text}: give {FORM}")


def _count(words: str, text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)[xX](\d+)", words)
    if found is None or not all(3 <= int(side) <= MAX_SQUARES for side in found.groups()):
        raise PomologError(
            f"--board {text}: {words!r} is no number of squares or corners; give it like 9x6, "
            f"3 to {MAX_SQUARES} a side"
        )
    return int(found[1]), int(found[2])


def _length_m(words: str, text: str) -> float:
    found = re.fullmatch(r"(\d+(?:\.\d+)?|\.\d+)\s*(mm|cm|m)", words.strip())
    if found is None:
        raise PomologError(
            f"--board {text}: {words!r} is no length; give it with its unit: 25mm, 2.5cm or 0.025m"
        )
    length_m = float(found[1]) * UNITS_M[found[2]]
    low_m, high_m = SQUARES_M
    if not low_m <= length_m <= high_m:
        meant = " were millimetres meant?" if length_m > high_m else " were metres meant?"
        raise PomologError(
            f"--board {text}: {words} is {length_m:g} m, and squares and markers are "
            f"{low_m * 1e3:g} mm to {high_m:g} m;{meant}"
        )
    return length_m
