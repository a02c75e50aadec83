"""What there is to learn from: pictures with labels and discs, from sessions and from boxes."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, cast

import cv2
import numpy as np

from processor.crossfit import FOLDS
from processor.discs import true_discs
from processor.trace import Floats, Look, Recogniser, look_both_ways
from recorder.errors import PomologError
from recorder.pictures import decode
from recorder.records import SIDES, UNCOUNTED, Labels, Picture
from recorder.rectify import Rectification, rectify
from recorder.rig import parallel_rig
from recorder.session import Session

SURE_INSIDE: Final = 0.75  # of a box, as an ellipse: fruit for certain
SURE_OUTSIDE: Final = 1.25  # beyond it no part of that fruit


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """One picture and its truth.

    Attributes:
        name: the session and pair, or the picture's file.
        picture: rectified.
        labels: (H, W) as in a session; 65535 where nobody can say.
        discs: (N, 4) x, y, radius of the fruit in it, and the fraction that is visible.
        rectification: of its rig.
        real: photographed, not rendered.
    """

    name: str
    picture: Picture
    labels: Labels
    discs: Floats
    rectification: Rectification
    real: bool = False

    @property
    def fold(self) -> int:
        """Which fold its scene is in, by a hash: both views and every size are in the same."""
        scene = self.name.rpartition("/")[0] or self.name
        return hashlib.sha256(scene.encode()).digest()[1] % FOLDS

    def halved(self) -> "Lesson":
        """The same by a camera of half the pixels each way."""
        height, width = self.labels.shape
        size_px = (width // 2, height // 2)
        rig = parallel_rig(
            size_px=size_px, focal_px=self.rectification.focal_px / 2,
            baseline_m=self.rectification.baseline_m,
        )  # fmt: skip
        picture = cv2.resize(self.picture, size_px, interpolation=cv2.INTER_AREA)
        labels = cv2.resize(self.labels, size_px, interpolation=cv2.INTER_NEAREST)
        discs = self.discs * [0.5, 0.5, 0.5, 1.0] - [0.25, 0.25, 0, 0]
        return replace(
            self, picture=cast("Picture", picture), labels=cast("Labels", labels), discs=discs,
            rectification=rectify(rig),
        )  # fmt: skip

    def exposed(self, stops: float) -> "Lesson":
        """The same scene exposed so many stops longer, clipped as a camera clips."""
        return replace(self, picture=expose(self.picture, stops))


def looks_at(group: Sequence[Lesson], recognise: Recogniser) -> tuple[Look, ...]:
    """Looks at both views of a pair, that know of each other, or at one picture alone."""
    pictures = [lesson.picture for lesson in group]
    recognitions = [recognise(picture) for picture in pictures]
    return look_both_ways(pictures, recognitions, group[0].rectification)


def expose(picture: Picture, stops: float) -> Picture:
    """Expose a picture (sRGB, IEC 61966-2-1) so many stops longer; what was clipped stays lost."""
    if stops == 0:
        return picture
    levels = np.arange(256) / 255
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    linear = np.clip(linear * 2**stops, 0, 1)
    shown = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    return cast("Picture", cv2.LUT(picture, np.round(shown * 255).astype(np.uint8)))


def lesson_pairs(paths: Iterable[Path]) -> Iterator[tuple[Lesson, Lesson]]:
    """Both views of every labelled pair of the sessions; discs of one row are of one apple.

    Raises:
        PomologError: a session is damaged, or none of its pairs has labels and apples.
    """
    for path in paths:
        found = False
        with Session(path) as session:
            rectification = rectify(session.rig)
            for pair in session.pairs():
                truth = pair.truth
                if truth is None or truth.left is None or truth.right is None or not truth.apples:
                    continue
                found = True
                views = []
                for side, frame, recorded in zip(
                    SIDES, (pair.left, pair.right), (truth.left, truth.right), strict=True
                ):
                    view = rectification.view(side)
                    labels = view.labels(recorded)
                    discs = true_discs(truth, side, labels, rectification)
                    assert discs is not None
                    named = np.column_stack([discs.circles, discs.visible])
                    name = f"{session.name}/{pair.index}/{side}"
                    picture = view.picture(decode(frame))
                    views.append(Lesson(name, picture, labels, named, rectification))
                yield views[0], views[1]
        if not found:
            raise PomologError(
                f"{path} has no pair with labels and apples to learn from; try: pomolog label"
            )


def boxed(folder: Path, part: str) -> list[Lesson]:
    """Photographs with YOLO boxes, one part of them: "train" or "test", by a hash of their names.

    Raises:
        PomologError: there are none.
    """
    lessons = []
    rectification = rectify(parallel_rig())  # gives the window of sizes, nothing else
    for path in sorted((folder / "images").glob("*.jpg")):
        first = hashlib.sha256(path.stem.encode()).digest()[0]
        if (first % 2 == 0) != (part == "train"):
            continue
        picture = cv2.imread(str(path))
        if picture is None:
            raise PomologError(f"cannot read {path}; is it a whole JPEG?")
        boxes = read_boxes(folder / "labels" / f"{path.stem}.txt", picture.shape[1::-1])
        labels = np.zeros(picture.shape[:2], np.uint16)
        for share, value in ((SURE_OUTSIDE, UNCOUNTED), (SURE_INSIDE, 1)):
            for x, y, width, height in boxes.tolist():
                shape = ((x, y), (width * share, height * share), 0)
                cv2.ellipse(labels, shape, value, cv2.FILLED)
        discs = np.column_stack([boxes[:, :2], boxes[:, 2:].mean(1) / 2, np.ones(len(boxes))])
        lessons.append(
            Lesson(path.stem, cast("Picture", picture), labels, discs, rectification, real=True)
        )
    if not lessons:
        raise PomologError(f"no images/*.jpg in {folder}; boxes are labels/NAME.txt beside them")
    return lessons


def read_boxes(path: Path, size_px: Sequence[int]) -> Floats:
    """(N, 4) x, y of the middle, width and height in pixels; no file means no fruit."""
    if not path.is_file():
        return np.empty((0, 4))
    rows = [line.split()[1:5] for line in path.read_text().splitlines() if line.strip()]
    return np.array(rows, float).reshape(-1, 4) * [size_px[0], size_px[1], *size_px[:2]]
