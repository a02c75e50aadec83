"""What each stage of `pomolog` is worth, and what limits it.

    python -m benchmarks.ablation sessions/segmentation-*-test.mcap sessions/matching-*-test.mcap

Each stage is swapped back to the paper's; then stages are replaced by the truth itself (masks, the
best candidate for each apple, circles), which no method can have, to see where errors begin.
"""

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.one_line import one_line
from processor.count import LEAST_IOU, FrameCounts, count_frame
from processor.discs import LEAST_VISIBLE, disc_iou, true_discs
from processor.fruit import FruitFinder
from processor.locate import Locator
from processor.methods import METHODS
from processor.score import FrameRow, FruitRow, Score, score
from processor.trace import Circles, Cleaning, Floats, Fruit, Look, Mask, Recognition, Seed
from recorder.pictures import decode
from recorder.records import SIDES, Labels, Picture, StereoPair
from recorder.rectify import Rectification, rectify
from recorder.session import Session

STAGES: Final = {
    "recognise": "colour_ratio, area_rule", "circles": "random_ring", "match": "area_in_order",
    "triangulate": "parallel",
}  # fmt: skip
NEVER: Final = 1 - 1e-9  # a probability that no network reaches

Known = dict[str, Any]
"""Of each side: "labels", and "discs" (N, 3) of the apples that count."""
Maker = Callable[[Known], Locator]


@dataclass(slots=True)
class TrueMasks:
    """A recogniser that is told the labels, left first."""

    labels: list[Labels]

    def __call__(self, picture: Picture) -> Recognition:  # noqa: ARG002  # it knows already
        """What is labelled as fruit, that of the next row too."""
        mask = cast("Mask", np.where(self.labels.pop(0) > 0, 255, 0).astype(np.uint8))
        index = np.asarray(cv2.blur(mask, (3, 3)), np.uint8)
        return Recognition(index, mask, calibrated=True)


@dataclass(slots=True)
class BestCandidates:
    """A finder that is told which of its own refined candidates fits each apple best."""

    finder: FruitFinder
    known: Known

    def __call__(self, cleaning: Cleaning, seed: Seed, look: Look) -> Circles:
        """The best candidate for each apple, and no other."""
        candidates = self.finder.propose(cleaning, seed, look).circles
        iou = disc_iou(candidates, self.known["discs"][look.side])
        best = [int(k) for k in iou.argmax(0)] if len(candidates) else []
        fitting = [k for j, k in enumerate(best) if iou[k, j] >= LEAST_IOU]
        return _as_fruit(candidates[fitting])


@dataclass(slots=True)
class TrueCircles:
    """A finder that is told the projected spheres of the apples that count."""

    known: Known

    def __call__(self, cleaning: Cleaning, seed: Seed, look: Look) -> Circles:  # noqa: ARG002
        """The truth."""
        return _as_fruit(self.known["discs"][look.side])


def _as_fruit(circles: Floats) -> Circles:
    fruit = [
        Fruit(0, x, y, radius, None, 0, (0, 0, 1, 1), confidence=1.0)
        for x, y, radius in circles.tolist()
    ]
    return Circles(tuple(fruit), np.empty((0, 5), np.float32))


def variants() -> dict[str, Maker]:
    """Every row of the table: its name and how its locator is made for one pair."""
    ours, paper = METHODS["pomolog"], METHODS["paper"]
    made: dict[str, Maker] = {"pomolog": _always(ours), "paper": _always(paper)}
    for stage, name in STAGES.items():
        back = {stage: getattr(paper, stage)}
        if stage == "recognise":
            back["clean"] = paper.clean
        made[f"{stage} of the paper ({name})"] = _always(replace(ours, **back))
    finder = cast("FruitFinder", ours.circles)
    made["candidates of the network alone"] = _always(
        replace(ours, circles=replace(finder, voted=0))
    )
    made["candidates of edge points alone"] = _always(
        replace(ours, circles=replace(finder, least_centre=NEVER))
    )
    made["told the masks"] = lambda known: replace(ours, recognise=TrueMasks(list(known["labels"])))
    made["told which candidate fits"] = lambda known: replace(
        ours, circles=BestCandidates(finder, known)
    )
    made["told the circles"] = lambda known: replace(ours, circles=TrueCircles(known))
    made["told masks and circles"] = lambda known: replace(
        ours, recognise=TrueMasks(list(known["labels"])), circles=TrueCircles(known)
    )
    return made


def _always(locator: Locator) -> Maker:
    return lambda _: locator


def known_of(pair: StereoPair, rectification: Rectification) -> Known:
    """The truth of a pair as rectified views see it."""
    assert pair.truth is not None
    labels, discs = [], {}
    for side, recorded in zip(SIDES, (pair.truth.left, pair.truth.right), strict=True):
        assert recorded is not None
        seen = rectification.view(side).labels(recorded)
        found = true_discs(pair.truth, side, seen, rectification)
        assert found is not None
        labels.append(seen)
        discs[side] = found.circles[found.visible >= LEAST_VISIBLE]
    return {"labels": labels, "discs": discs}


def rows_of(counts: FrameCounts) -> tuple[FrameRow, list[FruitRow]]:
    """What the score needs of one frame."""
    pixels, cleaned, fruit = (
        None if c is None else (c.tp, c.fp, c.fn)
        for c in (counts.pixels, counts.pixels_cleaned, counts.fruit)
    )
    rows = []
    for v in counts.apples:
        seen = (v.left_visible, v.right_visible)
        worse = None if None in seen else min(s for s in seen if s is not None)
        views = ((v.left_visible, v.found_left), (v.right_visible, v.found_right))
        rows.append(FruitRow(v.distance_m, worse, v.match, v.error_m, v.std_m, views))
    return FrameRow(pixels, cleaned, fruit, {}), rows


def measure(sessions: Iterable[Path]) -> dict[str, Score]:
    """The score of every variant."""
    made = variants()
    frames: dict[str, list[FrameRow]] = {name: [] for name in made}
    fruit: dict[str, list[FruitRow]] = {name: [] for name in made}
    for path in sessions:
        with Session(path) as session:
            rectification = rectify(session.rig)
            for pair in session.pairs():
                pictures = decode(pair.left), decode(pair.right)
                for name, make in made.items():
                    locator = make(known_of(pair, rectification))
                    trace = locator(*pictures, rectification, (0, pair.index))
                    row, apples = rows_of(count_frame(trace, pair.truth, rectification))
                    frames[name].append(row)
                    fruit[name] += apples
    return {name: score(frames[name], fruit[name]) for name in made}


def _percent(rate: float | None) -> str:
    return "-" if rate is None else f"{100 * rate:.1f}"


@one_line
def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("sessions", type=Path, nargs="+")
    words = parser.parse_args()
    cv2.setNumThreads(1)
    shown = Table(title=f"{len(words.sessions)} sessions")
    columns = (
        "", "pixel F1", "fruit F1, half visible", "10-50 %", "match rate", "found",
        "RMSE mm, 90-100 % visible", "50-90 %",
    )  # fmt: skip
    for column in columns:
        shown.add_column(column, justify="right" if column else "left")
    for name, found in measure(words.sessions).items():
        fruit = found.fruit_by_visibility
        detections = (found.pixels, fruit["50-100%"], fruit["10-50%"])
        matched = found.matches
        errors = (found.distance_m_by_visibility[v] for v in ("90-100%", "50-90%"))
        shown.add_row(
            name,
            *(_percent(d.f1 if d else None) for d in detections),
            *(_percent(r) for r in ((matched.rate, matched.found) if matched else (None, None))),
            *(f"{1e3 * e.rmse:.1f} ({e.n})" if e else "-" for e in errors),
        )
    Console(width=150).print(shown)


if __name__ == "__main__":
    main()
