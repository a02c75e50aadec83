"""The paper's method and its rivals on a real tree, against a depth picture.

    python -m benchmarks.real_tree ../shared/data/story_orchard [--choose sessions/demo.mcap]

Two colour frames of one tree of red 'Story' apples, 50 mm apart, with masks of 26 labelled apples
and a time-of-flight depth picture. Only the labelled apples count, so nothing here is a false
positive. One combination of the baselines is chosen on the rendered session alone; the best that
hindsight finds on the tree itself stands beside it as a bound, not as a result.
"""

import argparse
import itertools
import tempfile
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, cast

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.one_line import one_line
from processor.circles import HoughCircles, RandomRing
from processor.clean import AreaRule
from processor.count import count_frame
from processor.experiments.story import LEFT, RIGHT, Labelled, read_truth
from processor.locate import Locator
from processor.match import AreaInOrder
from processor.methods import METHODS
from processor.recognise import ColourRatio, RedMinusLuma, TwoRedMinusGreenBlue
from processor.rows import rows_of
from processor.trace import CircleFinder, Cleaner, Matcher, Recogniser
from recorder.imports.frames import import_frames
from recorder.pictures import decode
from recorder.records import Labels, StereoPair, counted_fruit
from recorder.rectify import Rectification, rectify
from recorder.rig import load_rig
from recorder.session import Session

FITTED: Final = RandomRing(min_radius_px=15, max_radius_px=110)  # 80 mm fruit, 0.4 to 2 m


def baselines() -> dict[str, Locator]:
    """Every combination of the paper's alternatives and its rivals."""
    recognisers: dict[str, Recogniser] = {
        "signed": ColourRatio("signed"),
        "difference": ColourRatio("difference"),
        "absolute": ColourRatio("absolute"),
        "2R-G-B": TwoRedMinusGreenBlue(),
        "Y-R": RedMinusLuma(),
    }
    cleaners: dict[str, Cleaner] = {
        "area first": AreaRule(),
        "morphology first": AreaRule(order="morphology_first"),
        "1/1000 rule": AreaRule(smallest_share=1 / 1000, order="morphology_first"),
    }
    circles: dict[str, CircleFinder] = {
        "ring 30-60": RandomRing(),
        "ring 15-110": FITTED,
        "Hough": HoughCircles(min_radius_px=15, max_radius_px=110),
    }
    matchers: dict[str, Matcher] = {
        "order + line": AreaInOrder(),
        "order": AreaInOrder(reference_line=False),
        "area": AreaInOrder(in_order=False, reference_line=False),
    }
    options = itertools.product(
        recognisers.items(), cleaners.items(), circles.items(), matchers.items()
    )
    return {
        ", ".join((r, c, k, m)): Locator(recognise=a, clean=b, circles=d, match=e)
        for (r, a), (c, b), (k, d), (m, e) in options
    }


def choose(pairs: Iterable[StereoPair], rectification: Rectification) -> tuple[str, Locator]:
    """The baselines' combination that places most apples by a right match; fewer wrong on a tie."""
    decoded = [(pair, decode(pair.left), decode(pair.right)) for pair in pairs]
    gains = {}
    for name, locator in baselines().items():
        right = wrong = 0
        for pair, left_picture, right_picture in decoded:
            trace = locator(left_picture, right_picture, rectification, (0, pair.index))
            verdicts = count_frame(trace, pair.truth, rectification).apples
            right += sum(v.error_m is not None for v in verdicts)
            wrong += sum(v.match == "wrong" for v in verdicts)
        gains[name] = (right, -wrong)
    best = max(gains, key=lambda name: gains[name])
    return best, baselines()[best]


@dataclass(slots=True)
class Outcome:
    """What one method did on the tree."""

    marked: float  # share of the left picture that was recognised
    covered: float  # share of the labelled apples' pixels
    found: tuple[int, int]  # left, right
    right: int
    wrong: int
    place_mm: dict[bool, list[float]]  # occluded -> triangulated place minus the depth picture
    front_mm: dict[bool, list[float]]  # occluded -> that less the radius, minus the depth picture


def run(
    locator: Locator, pair: StereoPair, labelled: Labelled, rectification: Rectification
) -> Outcome:
    """Locate, count, and compare with the depth picture."""
    pictures = decode(pair.left), decode(pair.right)
    trace = locator(*pictures, rectification, (0, 0))
    counts = count_frame(trace, labelled.truth, rectification)
    rows = rows_of("story", pair, trace, counts, rectification, 0)["apples"]
    mask = trace.left.recognition.mask > 0
    left_labels = rectification.left.labels(cast("Labels", labelled.truth.left))
    fruit = counted_fruit(left_labels)
    place_mm: dict[bool, list[float]] = defaultdict(list)
    front_mm: dict[bool, list[float]] = defaultdict(list)
    radius_mm = {row.get("left_truth"): 1e3 * (row["radius_m"] or 0.0) for row in rows}
    for verdict in counts.apples:
        if verdict.error_m is not None:
            hidden = labelled.occluded[verdict.apple_id]
            front_mm[hidden].append(verdict.error_m * 1e3)
            place_mm[hidden].append(verdict.error_m * 1e3 + radius_mm[verdict.apple_id])
    wrong = sum(
        1
        for row in rows
        if row.get("disparity_px") is not None
        and row["left_truth"] != row["right_truth"]
        and (row["left_truth"] is not None or row["right_truth"] is not None)
    )
    return Outcome(
        float(mask.mean()),
        float(mask[fruit].mean()),
        (sum(v.found_left for v in counts.apples), sum(v.found_right for v in counts.apples)),
        sum(v.error_m is not None for v in counts.apples),
        wrong,
        place_mm,
        front_mm,
    )


def table(outcomes: dict[str, Outcome], labelled: Labelled) -> Table:
    """One method a row; distances as n, median and median absolute deviation."""
    apples = labelled.truth.apples or ()
    hidden = sum(labelled.occluded[apple.id] for apple in apples)
    shown = Table(title=f"{len(apples)} labelled apples, {hidden} of them occluded")
    for column in (
        "method", "picture marked %", "apple pixels %", "found left / right", "matched right",
        "wrong", "un-occluded: place; front, mm", "occluded: place; front, mm",
    ):  # fmt: skip
        shown.add_column(column, justify="left" if column == "method" else "right")
    for name, o in outcomes.items():
        shown.add_row(
            name,
            f"{o.marked * 100:.1f}",
            f"{o.covered * 100:.1f}",
            f"{o.found[0]} / {o.found[1]}",
            str(o.right),
            str(o.wrong),
            *(
                f"{_spread(o.place_mm.get(hidden, []))}; {_spread(o.front_mm.get(hidden, []))}"
                for hidden in (False, True)
            ),
        )
    return shown


def _spread(values: list[float]) -> str:
    if not values:
        return "0"
    median = float(np.median(values))
    mad = float(np.median(np.abs(np.asarray(values) - median)))
    return f"{len(values)}, {median:+.0f}, {mad:.0f}"


@one_line
def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--choose", type=Path, default=Path("sessions/demo.mcap"))
    words = parser.parse_args()
    folder: Path = words.folder
    rig = load_rig(folder / "rig_opencv.yaml")
    labelled = read_truth(folder, rig.left)
    with Session(words.choose) as session:
        chosen_name, chosen = choose(session.pairs(), rectify(session.rig))
    fitted = {
        f"{reading}, ring 15-110": Locator(recognise=ColourRatio(reading), circles=FITTED)
        for reading in ("signed", "difference", "absolute")
    }
    methods = {
        "paper, signed": Locator(recognise=ColourRatio("signed")),
        "paper, difference": Locator(recognise=ColourRatio("difference")),
        "paper, absolute": Locator(),
        **fitted,
        "pomolog": METHODS["pomolog"],
        f"chosen on the rendered session: {chosen_name}": chosen,
    }
    with tempfile.TemporaryDirectory() as work:
        path = Path(work) / "story.mcap"
        pictures = (folder / f"{LEFT}_colour.png", folder / f"{RIGHT}_colour.png")
        import_frames((pictures,), rig, path, lighting=("front",))
        with Session(path) as session:
            pair = next(session.pairs())
            rectification = rectify(session.rig)
    known = replace(pair, truth=labelled.truth)
    name, oracle = choose([known], rectification)
    methods[f"best on this tree, hindsight: {name}"] = oracle
    outcomes = {name: run(m, pair, labelled, rectification) for name, m in methods.items()}
    Console(width=170).print(table(outcomes, labelled))


if __name__ == "__main__":
    main()
