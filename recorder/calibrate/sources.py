"""Where board pictures come from: two folders, one folder of both, files, or a session."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

import cv2
import numpy as np

from recorder.calibrate.chessboard import Grey
from recorder.calibrate.views import PicturePair
from recorder.errors import PomologError
from recorder.imports.frames import picture_pairs, pictures_in
from recorder.pictures import decode, identify, read_picture
from recorder.session import Session

MAX_VIEWS: Final = 100  # more tell little more, and take long
_SIDE_WORD: Final = re.compile(r"left|right", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Source:
    """Pairs of board pictures that can be gone through again and again.

    Attributes:
        files: left and right pictures; empty for a session.
        session: a session, or None.
        chosen: the places of the pairs that are looked at.
        total: how many pairs there are.
    """

    files: tuple[tuple[Path, Path], ...]
    session: Path | None
    chosen: tuple[int, ...]
    total: int

    def __call__(self) -> Iterator[PicturePair]:
        """Decode the chosen pairs, one after the other.

        Raises:
            PomologError: a picture cannot be read.
        """
        if self.session is None:
            for place in self.chosen:
                left, right = self.files[place]
                yield PicturePair(left.stem, _read(left), _read(right))
            return
        with Session(self.session) as session:
            for place in self.chosen:
                for pair in session.pairs(place, place + 1):
                    views = (_grey(decode(frame)) for frame in (pair.left, pair.right))
                    yield PicturePair(f"pair {place}", *views)


def source_of(paths: Sequence[Path], max_views: int = MAX_VIEWS) -> Source:
    """What the user named: LEFT/ RIGHT/, one folder with both, files, or a session.

    Raises:
        PomologError: nothing there, pictures without a partner, or an empty session.
    """
    for path in paths:
        if not path.exists():
            raise PomologError(f"no {path}; give two folders of board pictures, or a session")
    if len(paths) == 1 and paths[0].suffix.lower() == ".mcap":
        with Session(paths[0]) as session:
            session.require_pairs()
            total = len(session)
        return Source((), paths[0], _spread(total, max_views), total)
    pairs = _pairs(paths)
    return Source(pairs, None, _spread(len(pairs), max_views), len(pairs))


def _pairs(paths: Sequence[Path]) -> tuple[tuple[Path, Path], ...]:
    if len(paths) == 1 and paths[0].is_dir():
        sides = [paths[0] / "left", paths[0] / "right"]
        if all(side.is_dir() for side in sides):
            return _pairs(sides)
        return _by_name(pictures_in(paths[0]), str(paths[0]))
    if len(paths) > 2 and all(path.is_file() for path in paths):
        return _by_name(paths, "the files")
    if len(paths) != 2:
        raise PomologError(
            "give two folders of board pictures (LEFT/ RIGHT/), one folder with left and right "
            "ones, or a session"
        )
    if all(path.is_dir() for path in paths):
        _require_partners(pictures_in(paths[0]), pictures_in(paths[1]), *map(str, paths))
    return picture_pairs(paths[0], paths[1])


def _by_name(pictures: Sequence[Path], where: str) -> tuple[tuple[Path, Path], ...]:
    """Sort pictures of both views by the word left or right in their names."""
    sides: dict[str, list[Path]] = {"left": [], "right": []}
    for picture in pictures:
        word = _SIDE_WORD.search(picture.name)
        if word is not None:
            sides[word[0].lower()].append(picture)
    if not all(sides.values()):
        raise PomologError(
            f"{where}: no pictures named left... and right...; give two folders: LEFT/ RIGHT/"
        )
    _require_partners(sides["left"], sides["right"], "left", "right")
    return tuple(zip(sides["left"], sides["right"], strict=True))


def _require_partners(
    lefts: Sequence[Path], rights: Sequence[Path], left_name: str, right_name: str
) -> None:
    """Pictures are paired in name order; where their names say otherwise, that would be wrong."""
    keys = [[_SIDE_WORD.sub("", path.stem).lower() for path in side] for side in (lefts, rights)]
    telling = all(len(set(side)) == len(side) for side in keys) and set(keys[0]) & set(keys[1])
    alone = [
        path.name
        for mine, theirs, paths in ((keys[0], keys[1], lefts), (keys[1], keys[0], rights))
        for key, path in zip(mine, paths, strict=True)
        if telling and key not in theirs
    ]
    if len(lefts) != len(rights):
        without = f"; without a partner: {', '.join(alone[:5])}" if alone else ""
        raise PomologError(
            f"{len(lefts)} pictures in {left_name} but {len(rights)} in {right_name}; each view "
            f"needs both{without}"
        )
    if alone:
        raise PomologError(
            f"{left_name} and {right_name} do not hold the same views: {', '.join(alone[:5])} "
            "without a partner of the same name; rename them, or take them away"
        )


def _spread(total: int, most: int) -> tuple[int, ...]:
    """At most so many places, evenly spread."""
    if total <= most:
        return tuple(range(total))
    return tuple(np.unique(np.linspace(0, total - 1, most).round().astype(int)).tolist())


def _read(path: Path) -> Grey:
    data = read_picture(path)
    identify(data, str(path))
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    grey = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if grey is None:
        raise PomologError(f"{path} cannot be decoded; is it complete?")
    return cast("Grey", grey)


def _grey(picture: Grey) -> Grey:
    return cast("Grey", cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
