"""The corners of a ChArUco board, and which dictionary and which of the two patterns it has.

OpenCV changed the pattern of boards with an even number of rows in 4.6; boards printed before are
"legacy". A wrong pattern or size gives corners with wrong numbers and no error, so the markers'
places are held against each other before any corner is believed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from recorder.calibrate.board import NO_CORNERS, Board, Corners
from recorder.calibrate.chessboard import Grey
from recorder.errors import PomologError
from recorder.rig import Floats

FAMILIES: Final = (
    "4X4", "5X5", "6X6", "7X7", "ARUCO_ORIGINAL",
    "APRILTAG_16H5", "APRILTAG_25H9", "APRILTAG_36H10", "APRILTAG_36H11", "ARUCO_MIP_36H12",
)  # fmt: skip
SIZES: Final = (50, 100, 250, 1000)
NEAR: Final = 2.5  # marker sides between the middles of neighbours; a diagonal of squares is 1.9
MISSED: Final = 0.6  # of a square: a neighbour further off than this is numbered otherwise
MISPLACED: Final = 0.2  # of the neighbours may be: tilted and far ones are seen badly
MIN_MARKERS: Final = 4
SURELY: Final = 6  # markers a picture that lie as they should: no chance does that


@dataclass(frozen=True, slots=True)
class Pattern:
    """How a board's markers are drawn.

    Attributes:
        dictionary: OpenCV's name: DICT_4X4_250.
        legacy: the pattern of OpenCV before 4.6.
        misplaced: the share of neighbouring markers that are not where the pattern puts them.
        marker_share: the markers' side as seen, in squares.
    """

    dictionary: str
    legacy: bool
    misplaced: float
    marker_share: float


@dataclass(frozen=True, slots=True, eq=False)
class CharucoFinder:
    """Finds one board of a known pattern."""

    board: Board
    pattern: Pattern

    def __call__(self, grey: Grey) -> Corners:
        """The corners that are seen, any number of them."""
        detector = cv2.aruco.CharucoDetector(_drawn(self.board, self.pattern))
        found = detector.detectBoard(grey)
        if found[0] is None or found[1] is None:
            return NO_CORNERS
        ids = np.asarray(found[1], np.int64).ravel()
        order = np.argsort(ids)
        return Corners(ids[order], np.asarray(found[0], float).reshape(-1, 2)[order])


def charuco_finder(board: Board, samples: Sequence[Grey]) -> CharucoFinder:
    """Find out dictionary and pattern from a few pictures.

    Raises:
        PomologError: no such dictionary, no marker in any picture, or markers that do not lie as on
            this board.
    """
    candidates = _candidates(board)
    seen: dict[str, list[dict[int, Floats]]] = {}
    for name in candidates:
        seen[name] = [_markers(grey, name) for grey in samples]
        if _is_it(board, name, seen[name]):
            break
    best = max(seen, key=lambda name: _fitting(seen[name], board.marker_count))
    if _fitting(seen[best], board.marker_count) < MIN_MARKERS:
        raise PomologError(_no_markers(board, samples, candidates))
    patterns = [_judged(board, best, legacy, seen[best]) for legacy in (False, True)]
    pattern = min(patterns, key=lambda one: one.misplaced)
    if patterns[0].misplaced == patterns[1].misplaced:  # the rim, where they differ, is not seen
        finders = [CharucoFinder(board, one) for one in patterns]
        counts = [sum(len(finder(grey)) for grey in samples) for finder in finders]
        pattern = patterns[int(np.argmax(counts))]
    if not pattern.misplaced < MISPLACED:
        raise PomologError(_wrong_size(board, best, seen[best]))
    return CharucoFinder(board, pattern)


def _is_it(board: Board, name: str, pictures: Sequence[dict[int, Floats]]) -> bool:
    """Whether this dictionary is the board's beyond doubt, so that no other need be tried."""
    return _fitting(pictures, board.marker_count) >= SURELY * len(pictures) and any(
        _judged(board, name, legacy, pictures).misplaced < MISPLACED for legacy in (False, True)
    )


def _candidates(board: Board) -> list[str]:
    """The dictionaries to try: the one that was named, or the smallest of each family."""
    if board.dictionary:
        wanted = board.dictionary.upper().removeprefix("DICT_")
        names = [name for name in _known() if name.removeprefix("DICT_").upper() == wanted]
        if not names and wanted in FAMILIES:
            names = _of_family(wanted, board.marker_count)
        if not names:
            raise PomologError(
                f"no marker dictionary {board.dictionary!r}; give one like 4x4_250, or leave it "
                "out: it is found by trying"
            )
        return names
    return [name for family in FAMILIES for name in _of_family(family, board.marker_count)]


def _known() -> list[str]:
    return [name for name in dir(cv2.aruco) if name.startswith("DICT_")]


def _of_family(family: str, markers: int) -> list[str]:
    known = _known()
    sized = [f"DICT_{family}_{size}" for size in SIZES if size >= markers]
    names = sized if f"DICT_{family}_50" in known else [f"DICT_{family}"]
    return [name for name in names if name in known and _length(name) >= markers][:1]


def _length(name: str) -> int:
    return len(_dictionary(name).bytesList)


def _dictionary(name: str) -> Any:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _drawn(board: Board, pattern: Pattern) -> Any:
    drawn = cv2.aruco.CharucoBoard(
        board.squares, board.square_m, board.marker_m or 0.0, _dictionary(pattern.dictionary)
    )
    drawn.setLegacyPattern(pattern.legacy)
    return drawn


def has_markers_mirrored(grey: Grey, finder: CharucoFinder) -> bool:
    """Whether the board's markers are seen in a picture's mirror image."""
    mirrored = np.ascontiguousarray(grey[:, ::-1])
    count = _fitting([_markers(mirrored, finder.pattern.dictionary)], finder.board.marker_count)
    return count >= MIN_MARKERS


def _markers(grey: Grey, name: str) -> dict[int, Floats]:
    """The (4, 2) corners of every marker in a picture, by its number."""
    corners, ids, _ = cv2.aruco.ArucoDetector(_dictionary(name)).detectMarkers(grey)
    if ids is None or len(ids) == 0:
        return {}
    return {
        int(number): np.asarray(square, float).reshape(4, 2)
        for number, square in zip(np.ravel(ids), corners, strict=True)
    }


def _fitting(pictures: Sequence[dict[int, Floats]], count: int) -> int:
    """How many markers have numbers that the board has, less those that it has not."""
    numbers = [number for markers in pictures for number in markers]
    return sum(1 if number < count else -1 for number in numbers)


def _judged(
    board: Board, name: str, legacy: bool, pictures: Sequence[dict[int, Floats]]
) -> Pattern:
    """How well neighbouring markers lie where the pattern puts them."""
    guess = Pattern(name, legacy, np.inf, 0.0)
    drawn = _drawn(board, guess)
    numbers: list[int] = np.asarray(drawn.getIds()).ravel().tolist()
    outlines = np.asarray(drawn.getObjPoints(), float).reshape(-1, 4, 3)[..., :2] / board.square_m
    places = dict(zip(numbers, outlines, strict=True))
    offsets: list[Floats] = []
    wanted: list[Floats] = []
    for markers in pictures:
        known = {number: px for number, px in markers.items() if number in places}
        for number, px in known.items():
            middle = places[number].mean(axis=0)
            # the marker's own four corners give the board's plane around it
            plane = cv2.getPerspectiveTransform(
                px.astype(np.float32), places[number].astype(np.float32)
            )
            for other in _neighbours(number, known):
                offsets.append(_through(plane, known[other].mean(axis=0)[None])[0] - middle)
                wanted.append(places[other].mean(axis=0) - middle)
    if not offsets:
        return guess
    seen, told = np.array(offsets), np.array(wanted)
    scale = float(np.median(np.linalg.norm(told, axis=1) / np.linalg.norm(seen, axis=1)))
    missed = np.linalg.norm(scale * seen - told, axis=1)
    return Pattern(
        name, legacy, float((missed > MISSED).mean()),
        scale * (board.marker_m or 0.0) / board.square_m,
    )  # fmt: skip


def _neighbours(number: int, known: dict[int, Floats]) -> list[int]:
    """The markers that the picture shows beside one."""
    middle = known[number].mean(axis=0)
    side_px = float(np.linalg.norm(known[number][0] - known[number][1]))
    away = {n: float(np.linalg.norm(px.mean(axis=0) - middle)) for n, px in known.items()}
    near = sorted((px, n) for n, px in away.items() if n != number and px < NEAR * side_px)
    return [n for _, n in near[:4]]


def _through(plane: npt.NDArray[Any], points: Floats) -> Floats:
    return np.asarray(cv2.perspectiveTransform(points[:, None, :], plane), float)[:, 0, :]


def _no_markers(board: Board, samples: Sequence[Grey], tried: Sequence[str]) -> str:
    """What to say where the board's markers are nowhere: mirrored, another dictionary, or none."""
    where = f"no marker of {board} in the {len(samples)} pictures that were tried"
    for name in tried:
        mirrored = [_markers(np.ascontiguousarray(grey[:, ::-1]), name) for grey in samples]
        if _fitting(mirrored, board.marker_count) >= MIN_MARKERS:
            return f"{where}, but there are in their mirror images: the pictures are mirrored"
    others = [
        name
        for family in FAMILIES
        for name in _of_family(family, 1)[-1:]
        if name not in tried and sum(len(_markers(grey, name)) for grey in samples) >= MIN_MARKERS
    ]
    if others:
        return f"{where}, but of {', '.join(others)}; is it another board, or another dictionary?"
    return f"{where}; is it another board, or a chessboard?"


def _wrong_size(board: Board, name: str, pictures: Sequence[dict[int, Floats]]) -> str:
    """What to say where markers are seen but lie as on a board of another size."""
    across, down = board.squares
    fits: dict[int, float] = {}
    for width in range(max(3, across - 3), across + 4):
        other = Board(board.kind, width - 1, down - 1, board.square_m, board.marker_m)
        for legacy in (False, True):
            fits[width] = min(
                fits.get(width, np.inf), _judged(other, name, legacy, pictures).misplaced
            )
    best = min(fits, key=lambda width: fits[width])
    line = f"the markers do not lie as on a board of {across}x{down} squares"
    exchanged = Board(board.kind, down - 1, across - 1, board.square_m, board.marker_m)
    if _judged(exchanged, name, legacy=False, pictures=pictures).misplaced < MISPLACED:
        return f"{line}; are the two numbers exchanged?"
    if best != across and fits[best] < MISPLACED:
        return f"{line}, but as on one that is {best} wide; count the squares across again"
    return f"{line}; count its squares again, and measure its markers"
