"""Fruit found in photographs with boxes, by `paper` and by `pomolog`.

    python -m benchmarks.photographs ../shared/data/applebbch81

Boxes of the pictures whose names hash to the test half; the model that ships learned from the other
half. A circle's box finds a labelled box where their IoU is at least a half, one to one.
"""

import argparse
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import linear_sum_assignment

from benchmarks.one_line import one_line
from processor.lessons import Lesson, boxed, read_boxes
from processor.locate import Locator
from processor.methods import METHODS
from processor.score import detection
from processor.trace import Floats, Look

LEAST_IOU: Final = 0.5


def circles_of(locator: Locator, lesson: Lesson) -> Floats:
    """(N, 3) the circles of one picture; a locator's own stages up to there."""
    recognition = locator.recognise(lesson.picture)
    cleaning = locator.clean(recognition)
    look = Look(lesson.picture, recognition, lesson.rectification)
    return locator.circles(cleaning, (0, 0, 0), look).as_array()


def count(circles: Floats, boxes: Floats, size_px: tuple[int, int]) -> tuple[int, int, int]:
    """True positives, false positives and false negatives, of boxes cut at the picture's edge."""
    found = np.column_stack([circles[:, :2] - circles[:, 2:], circles[:, :2] + circles[:, 2:]])
    found = np.clip(found, 0, [*size_px, *size_px])
    wanted = np.column_stack([boxes[:, :2] - boxes[:, 2:] / 2, boxes[:, :2] + boxes[:, 2:] / 2])
    first = np.maximum(found[:, None, :2], wanted[None, :, :2])
    last = np.minimum(found[:, None, 2:], wanted[None, :, 2:])
    shared = np.maximum(last - first, 0).prod(2)
    areas = [np.maximum(b[:, 2:] - b[:, :2], 0).prod(1) for b in (found, wanted)]
    iou = shared / np.maximum(areas[0][:, None] + areas[1] - shared, 1e-9)
    rows, columns = linear_sum_assignment(np.where(iou >= LEAST_IOU, iou, 0), maximize=True)
    tp = int((iou[rows, columns] >= LEAST_IOU).sum())
    return tp, len(circles) - tp, len(boxes) - tp


@one_line
def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--part", default="test", choices=("train", "test"))
    words = parser.parse_args()
    cv2.setNumThreads(1)
    lessons = boxed(words.folder, words.part)
    shown = Table(title=f"{len(lessons)} photographs, boxes at IoU {LEAST_IOU}")
    for column in ("method", "F1 %", "precision %", "recall %"):
        shown.add_column(column, justify="left" if column == "method" else "right")
    for name in ("paper", "2r-g-b", "pomolog"):
        counts = []
        for lesson in lessons:
            height, width = lesson.labels.shape
            boxes = read_boxes(words.folder / "labels" / f"{lesson.name}.txt", (width, height))
            counts.append(count(circles_of(METHODS[name], lesson), boxes, (width, height)))
        found = detection(counts)
        assert found is not None
        rates = (found.f1, found.precision, found.recall)
        shown.add_row(name, *("-" if r is None else f"{r * 100:.1f}" for r in rates))
    Console(width=80).print(shown)


if __name__ == "__main__":
    main()
