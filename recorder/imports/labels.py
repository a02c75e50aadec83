"""Labels of others -> truth: which picture is which frame, and what the labels can say."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Final

from recorder.errors import PomologError
from recorder.imports.coco import read_coco
from recorder.imports.cvat import read_cvat
from recorder.imports.label_files import (
    in_pixels,
    read_circles,
    read_labelme,
    read_supervisely,
    read_yolo,
)
from recorder.imports.shapes import PictureLabels, Shape, draw
from recorder.objects import Place
from recorder.records import SIDES, UNCOUNTED, FrameTruth, Labels, Outline, Side, StereoPair
from recorder.session import Session

READERS: Final[dict[str, Callable[[Path], tuple[PictureLabels, ...]]]] = {
    "coco": read_coco,
    "labelme": read_labelme,
    "cvat": read_cvat,
    "supervisely": read_supervisely,
    "yolo": read_yolo,
    "circles": read_circles,
}
_FRUIT: Final = ("apple", "fruit", "manzana", "apfel", "pomme", "mela")
_INDEX: Final = re.compile(r"[0-9]{6}")  # what `pomolog export frames` calls its pictures


@dataclass(frozen=True, slots=True)
class Labelled:
    """What became of the labels."""

    pictures: int  # of the session that have labels
    of: int
    shapes: int
    with_pixels: bool  # False: boxes or circles, so that no pixels can be scored
    shared: bool  # the same numbers in both views
    lone: int  # labelled pictures without a partner, which no pair has

    def __str__(self) -> str:
        parts = [f"{self.shapes} labels in {self.pictures} of {self.of} pictures"]
        if not self.with_pixels:
            parts.append("boxes or circles, so no pixels are scored")
        if not self.shared and self.pictures:
            parts.append("no numbers, so no matches are scored")
        if self.lone:
            parts.append(f"{self.lone} labelled pictures have no partner and are left out")
        return "; ".join(parts)


class LabelTruth:
    """The truth of a session's pairs from labels of their pictures.

    Args:
        session: whose pictures they are.
        pictures: their labels, from one of `READERS`.
        view: the view of all of them; None: their names say it.
        category: keep only this class; None: the only one, or those of fruit.
        partial: unlabelled fruit exist, so that fruit found elsewhere are no mistakes.

    Raises:
        PomologError: a label is of no picture of the session, or of which view is unknown, or a
            picture's size is another.
    """

    def __init__(
        self,
        session: Session,
        pictures: Sequence[PictureLabels],
        *,
        view: Side | None = None,
        category: str | None = None,
        partial: bool = False,
    ) -> None:
        kept = _of_category(pictures, category)
        shapes = [shape for picture in kept for shape in picture.shapes]
        self._partial = partial
        self._pixels = all(shape.has_pixels for shape in shapes)
        numbered = bool(shapes) and all(shape.id for shape in shapes if not shape.uncounted)
        self._shared = numbered or session.one_view  # a view alone has nobody to share with
        if not numbered and any(shape.id for shape in shapes):
            raise PomologError(
                "some labels have an apple's number and some have none; "
                "give all of them numbers, the same in both views, or none"
            )
        places = _Places(session, view)
        self._found: dict[tuple[Side, int], PictureLabels] = {}
        lone = 0
        for picture in kept:
            side, pair = places.of(picture)
            if pair is None:
                lone += 1
                continue
            if (side, pair) in self._found:
                raise PomologError(
                    f"{picture.name}: the {side} picture {pair} is labelled twice; leave one out"
                )
            self._found[side, pair] = picture
        if not self._found:
            raise PomologError(
                f"no labels for the pictures of {session.path}; are they of another session?"
            )
        of = len(session) * (1 if session.one_view else 2)
        self.summary = Labelled(len(self._found), of, len(shapes), self._pixels, self._shared, lone)

    def require(self, pairs: int, session: Place) -> None:
        """Every label has found its picture already."""

    def truth(self, pair: StereoPair) -> FrameTruth | None:
        """The truth of one pair; None where nobody labelled it.

        Raises:
            PomologError: labels are of another size than their picture.
        """
        truth = FrameTruth(partial=self._partial, shared=self._shared)
        known = False
        for side in SIDES:
            picture = self._found.get((side, pair.index))
            if picture is None:
                continue
            known = True
            truth = replace(
                truth,
                partial=truth.partial or picture.partial,
                identified=truth.identified and picture.identified,
            )
            size_px = pair.frame(side).size_px
            whole = _of_size(picture, size_px)
            numbered = _numbered(whole.shapes)
            if self._pixels:
                truth = _with_labels(truth, side, draw(numbered, size_px))
            else:
                outlines = tuple(shape.outline(side, number) for number, shape in numbered)
                _refuse_twins(outlines, picture.name)
                truth = _with_outlines(truth, side, outlines)
        return truth if known else None


def _refuse_twins(outlines: Sequence[Outline], name: str) -> None:
    numbers = Counter(outline.id for outline in outlines if outline.id != UNCOUNTED)
    twice = [number for number, count in numbers.items() if count > 1]
    if twice:
        raise PomologError(
            f"{name}: apple {min(twice)} has two boxes in one picture; leave one out"
        )


def _with_labels(truth: FrameTruth, side: Side, labels: Labels) -> FrameTruth:
    return replace(truth, left=labels) if side == "left" else replace(truth, right=labels)


def _with_outlines(truth: FrameTruth, side: Side, outlines: tuple[Outline, ...]) -> FrameTruth:
    if side == "left":
        return replace(truth, left_outlines=outlines)
    return replace(truth, right_outlines=outlines)


def _of_category(
    pictures: Sequence[PictureLabels], wanted: str | None
) -> tuple[PictureLabels, ...]:
    """Only the shapes of one class; which one must be said where nobody can know."""
    counts = Counter(shape.category for picture in pictures for shape in picture.shapes)
    if wanted is not None:
        if wanted not in counts:
            known = ", ".join(sorted(counts)) or "none"
            raise PomologError(f"--category {wanted}: no such class; there are {known}")
        keep = {wanted}
    elif len(counts) > 1:
        keep = {name for name in counts if any(word in name.lower() for word in _FRUIT)}
        if len(keep) != 1:
            known = ", ".join(f"{name} ({count})" for name, count in sorted(counts.items()))
            raise PomologError(f"which class is the apples'? say --category; there are {known}")
    else:
        keep = set(counts)
    return tuple(
        replace(picture, shapes=tuple(s for s in picture.shapes if s.category in keep))
        for picture in pictures
    )


def _of_size(picture: PictureLabels, size_px: tuple[int, int]) -> PictureLabels:
    if picture.fractions:
        return in_pixels(picture, size_px)
    if picture.size_px not in (None, size_px):
        assert picture.size_px is not None
        raise PomologError(
            f"the labels of {picture.name} are of {picture.size_px[0]} x {picture.size_px[1]} px, "
            f"its picture is of {size_px[0]} x {size_px[1]}; label the picture as recorded"
        )
    return picture


def _numbered(shapes: Sequence[Shape]) -> list[tuple[int, Shape]]:
    """Shapes with the numbers of their apples, given or in order; a number may have several."""
    taken = {shape.number for shape in shapes}
    fresh = (number for number in range(1, UNCOUNTED) if number not in taken)
    return [(UNCOUNTED if s.uncounted else s.id or s.number or next(fresh), s) for s in shapes]


class _Places:
    """Where labelled pictures are in a session."""

    def __init__(self, session: Session, view: Side | None) -> None:
        self._session = session
        self._view = view
        self._names: dict[Side, dict[str, int]] = {}
        for side in SIDES:
            listed = session.names(side)
            self._names[side] = {PurePosixPath(n).stem: i for i, n in enumerate(listed)}
            if len(self._names[side]) < len(listed):
                raise PomologError(
                    f"{session.path} has several {side} pictures of one name; label it before "
                    "joining them, or give masks in order: --masks"
                )
        times = session.pair_times_ns()
        self._pairs: dict[Side, dict[int, int]] = {
            side: {int(t): pair for pair, t in enumerate(times[:, column])}
            for column, side in enumerate(SIDES)
        }

    def of(self, picture: PictureLabels) -> tuple[Side, int | None]:
        """The view and the pair of a labelled picture; no pair has a lone frame."""
        path = PurePosixPath(picture.name)
        stem = _stem(path)
        side = self._view or _said_side(path) or self._only_side(stem, picture.name)
        times = self._session.times_ns(side)
        index = picture.frame
        if index is None and self._names[side]:
            index = self._names[side].get(stem)
        elif index is None and _INDEX.fullmatch(stem):
            index = int(stem)
        elif index is None and stem.isdecimal() and int(stem) in self._pairs[side]:
            return side, self._pairs[side][int(stem)]
        if index is None or not 0 <= index < len(times):
            raise PomologError(
                f"no {side} picture {picture.name} in {self._session.path}; {self._known(side)}"
            )
        return side, self._pairs[side].get(int(times[index]))

    def _only_side(self, stem: str, name: str) -> Side:
        if self._session.one_view:
            return "left"
        holders = [side for side in SIDES if stem in self._names[side]]
        if len(holders) == 1:
            return holders[0]
        raise PomologError(
            f"of which view is {name}? put left/ or right/ before the names, or say --view"
        )

    def _known(self, side: Side) -> str:
        names = self._session.names(side)
        if names:
            return f"its pictures are {names[0]} to {names[-1]}"
        return (
            "name them by number (000000, ...) or time in ns, as "
            f"`pomolog export frames {self._session.path} -o DIR` does"
        )


def _stem(path: PurePosixPath) -> str:
    """The name without the ending of a picture; other dots stay."""
    endings = (".png", ".jpg", ".jpeg", ".webp")
    return path.stem if path.suffix.lower() in endings else path.name


def _said_side(path: PurePosixPath) -> Side | None:
    """The view that a folder's or the file's name says."""
    words = {word for part in path.parts for word in re.split(r"[^a-z]+", part.lower())}
    said: list[Side] = [side for side in SIDES if side in words]
    return said[0] if len(said) == 1 else None
