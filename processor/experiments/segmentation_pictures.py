"""Fig. 5: one picture of each light as the rival indices and the paper's rule see it."""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from processor import charts
from processor.experiments.material import Source
from processor.experiments.segmentation import RULE_OF_METHOD, RULES
from processor.experiments.work import Sample, samples
from processor.page_parts import Figure
from processor.trace import Mask
from recorder.records import UNCOUNTED, Labels, Picture, counted_fruit
from recorder.session import Session

SHOWN: Final = {"Y-R": "(b) Y-R", "2R-G-B": "(c) 2R-G-B", RULE_OF_METHOD: "(d) the paper's rule"}
HIT: Final = (255, 255, 255)
FALSE: Final = (40, 80, 230)  # BGR: marked, but no fruit
MISSED: Final = (225, 140, 40)  # fruit, but not marked
UNSURE: Final = (110, 110, 110)  # marked, and counts neither way
WIDTH_PX: Final = 480


def figure_5(sources: Sequence[Source]) -> Figure:
    """The first left picture of each light, whatever it shows."""
    chosen: dict[str, Sample] = {}
    for source in sources:
        for place, light in _lights(source):
            if light not in chosen:
                chosen[light] = next(samples(source, [place]))
    return Figure(
        "fig5",
        "The first picture of each light: (a) as recorded, (b) Y-R and (c) 2R-G-B with Otsu's "
        f"threshold, (d) the paper's rule ({RULE_OF_METHOD} reading). White: fruit that was "
        "marked; red: marked, but no fruit; blue: fruit that was not marked; grey: marked, but "
        "of the row behind, which counts neither way.",
        draw(chosen),
    )


def _lights(source: Source) -> list[tuple[int, str]]:
    """The light of every used pair, without decoding its pictures."""
    with Session(source.path) as session:
        return [
            (place, pair.conditions.get("lighting", "not said"))
            for place in source.pairs
            for pair in session.pairs(place, place + 1)
        ]


def judged(mask: Mask, labels: Labels) -> Picture:
    """(H, W, 3): hits, false positives and misses of a mask in their colours, on black."""
    marked, fruit = mask > 0, counted_fruit(labels)
    result = np.zeros((*labels.shape, 3), np.uint8)
    result[marked & fruit] = HIT
    result[marked & (labels == 0)] = FALSE
    result[~marked & fruit] = MISSED
    result[marked & (labels == UNCOUNTED)] = UNSURE
    return result


def draw(chosen: dict[str, Sample]) -> bytes:
    """A row a light, a column a rule."""
    with charts.drawing(7.0, 0.2 + 1.42 * len(chosen)) as (sheet, done):
        panels = sheet.subplots(len(chosen), 1 + len(SHOWN), squeeze=False)
        for number, (light, sample) in enumerate(chosen.items()):
            picture, labels = sample.picture("left"), sample.labels("left")
            row, first = panels[number], number == 0
            charts.show_picture(row[0], _small(picture), "(a) original" if first else "")
            row[0].text(-0.04, 0.5, light, rotation=90, va="center", ha="right",
                        transform=row[0].transAxes)  # fmt: skip
            for axes, (rule, title) in zip(row[1:], SHOWN.items(), strict=True):
                mask = RULES[rule](picture).mask
                seen = np.dstack([mask] * 3) if labels is None else judged(mask, labels)
                charts.show_picture(axes, _small(seen), title if first else "")
    return done[0]


def _small(picture: Picture) -> Picture:
    height, width = picture.shape[:2]
    size = WIDTH_PX, round(WIDTH_PX * height / width)
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
