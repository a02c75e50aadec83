"""Where the paper is silent: what each choice that it leaves open changes, one at a time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from processor import charts
from processor.clean import AreaRule
from processor.count import count_frame
from processor.experiments.distances import measure_distances
from processor.experiments.item import Item
from processor.experiments.material import Material, describe, for_matching
from processor.experiments.windows import ring_of
from processor.experiments.work import Bench, Row, Sample, array_of
from processor.locate import Locator
from processor.match import AreaInOrder
from processor.page_parts import Column, Figure, Scalar, Table, percent
from processor.recognise import ColourRatio, RedMinusLuma, TwoRedMinusGreenBlue
from processor.score import detection, matches
from processor.trace import Recogniser
from recorder.records import SIDES, counted_fruit
from recorder.rectify import Rectification

LEAST_SPREAD: Final = 0.05  # what does not show in print is no spread
THRESHOLDS: Final = (5, 10, 20, 30, 40, 60, 80)
_INDICES: Final[dict[str, Recogniser]] = {"2R-G-B": TwoRedMinusGreenBlue(), "Y-R": RedMinusLuma()}


@dataclass(frozen=True, slots=True)
class Option:
    """One way to read the paper: the choice it belongs to, its name, whether it is our default."""

    choice: str
    name: str
    ours: bool = False


def locators(rectification: Rectification) -> dict[Option, Locator]:
    """Every option of every choice; all but the window's own take any radius fruit can have.

    With 30 to 60 px most fruit of a near tree have no circle, and nothing else would show.
    """
    base = Locator(circles=ring_of(rectification))
    options = {Option("radius window", "30 to 60 px (Sec. 2.4)", ours=True): Locator(),
               Option("radius window", "from rig, range and fruit"): base}  # fmt: skip
    for reading in ("signed", "absolute", "difference"):
        option = Option("reading of the ratio", reading, reading == "absolute")
        options[option] = replace(base, recognise=ColourRatio(reading))
    for order in ("area_first", "morphology_first"):
        option = Option("area rule and morphology", order.replace("_", " "), order == "area_first")
        options[option] = replace(base, clean=AreaRule(order=order))
    for share, name in ((1 / 8, "1/8 of the largest (Sec. 2.3)"), (1 / 64, "1/64"), (0.0, "none")):
        option = Option("smallest region", name, share == 1 / 8)
        options[option] = replace(base, clean=AreaRule(smallest_share=share))
    for limit in (0.25, 0.5, 1.0):
        option = Option("“similar” areas differ by at most", f"{limit:.0%}", limit == 0.5)
        options[option] = replace(base, match=AreaInOrder(largest_difference=limit))
    for line in (True, False):
        option = Option("reference line", "kept" if line else "dropped", line)
        options[option] = replace(base, match=AreaInOrder(reference_line=line))
    for kept in (True, False):
        option = Option("ordering constraint", "kept" if kept else "dropped", kept)
        options[option] = replace(base, match=AreaInOrder(in_order=kept))
    return options


def measure_options(sample: Sample) -> list[Row]:
    """Pixels, fruit and matches of every option."""
    rows = []
    for option, locator in locators(sample.rectification).items():
        trace = locator(sample.left, sample.right, sample.rectification, sample.seed)
        counts = count_frame(trace, sample.pair.truth, sample.rectification)
        row: Row = {"choice": option.choice, "option": option.name, "ours": option.ours}
        row["match"] = [v.match for v in counts.apples if v.match is not None]
        for what in ("pixels_cleaned", "fruit"):
            found = getattr(counts, what)
            row[what] = None if found is None else [found.tp, found.fp, found.fn]
        rows.append(row)
    return rows


def measure_thresholds(sample: Sample) -> list[Row]:
    """Pixel counts of both rivals at Otsu's and at fixed thresholds."""
    rows = []
    for side in SIDES:
        labels = sample.labels(side)
        if labels is None or sample.pair.truth is None or sample.pair.truth.partial:
            continue
        fruit = counted_fruit(labels)
        background = labels == 0
        for name, rule in _INDICES.items():
            recognition = rule(sample.picture(side))
            inside = np.bincount(recognition.index[fruit], minlength=256)
            outside = np.bincount(recognition.index[background], minlength=256)
            marked = recognition.mask > 0
            tp, fp = int((marked & fruit).sum()), int((marked & background).sum())
            whole = int(inside.sum())
            rows.append({"rule": name, "threshold": "Otsu's", "tp": tp, "fp": fp,
                         "fn": whole - tp})  # fmt: skip
            for threshold in THRESHOLDS:
                tp, fp = int(inside[threshold + 1 :].sum()), int(outside[threshold + 1 :].sum())
                rows.append({"rule": name, "threshold": str(threshold), "tp": tp, "fp": fp,
                             "fn": whole - tp})  # fmt: skip
    return rows


_TRUTH_POINTS: Final = {
    "depth_error_mm": "depth of the centre against the reading",
    "range_error_mm": "distance of the centre against the reading",
    "error_mm": "front along the beam against the reading",
}
_MEASURES: Final = {
    "pixels": ("hits of pixels, cleaned", "%"), "fruit": ("F1 of fruit", "%"),
    "rate": ("matches that are right", "%"), "found": ("matched rightly of all", "%"),
    "hits": ("hits of pixels", "%"), "median": ("median error of distance", "mm"),
}  # fmt: skip


def ambiguity(material: Material, bench: Bench) -> tuple[Item, ...]:
    """All choices, on the sessions that show what each changes."""
    pictures, pairs = material.of("segmentation"), for_matching(material)
    series = material.of("distance")
    thresholds = bench.rows(measure_thresholds, pictures)
    options = bench.rows(measure_options, pairs)
    readings = bench.rows(measure_distances, series) if series else []
    sources = {s.path: s for s in (*pictures, *pairs, *series)}
    table = option_rows(options) + threshold_rows(thresholds) + truth_rows(readings)
    return (report(table, describe(tuple(sources.values()))),)


def option_rows(rows: Sequence[Row]) -> list[dict[str, Scalar]]:
    """What each option of the locator gives."""
    kinds: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        kinds.setdefault((row["choice"], row["option"]), []).append(row)
    table: list[dict[str, Scalar]] = []
    for (choice, option), mine in kinds.items():
        pixels = detection([tuple(r["pixels_cleaned"]) for r in mine if r["pixels_cleaned"]])
        fruit = detection([tuple(r["fruit"]) for r in mine if r["fruit"]])
        matched = matches(word for r in mine for word in r["match"])
        line = _line(choice, option, mine[0]["ours"])
        line["pixels"] = percent(pixels.hit if pixels else None)
        line["fruit"] = percent(fruit.f1 if fruit else None)
        line["rate"] = percent(matched.rate if matched else None)
        line["found"] = percent(matched.found if matched else None)
        table.append(line)
    return table


def threshold_rows(rows: Sequence[Row]) -> list[dict[str, Scalar]]:
    """The rivals' hits by threshold."""
    table = []
    for rule in _INDICES:
        for threshold in ("Otsu's", *map(str, THRESHOLDS)):
            mine = [r for r in rows if r["rule"] == rule and r["threshold"] == threshold]
            found = detection([(r["tp"], r["fp"], r["fn"]) for r in mine])
            line = _line(f"threshold of {rule}", threshold, threshold == "Otsu's")
            line["hits"] = percent(found.hit if found else None)
            table.append(line)
    return table


def truth_rows(rows: Sequence[Row]) -> list[dict[str, Scalar]]:
    """The median distance error by what is compared with the reading; any radius."""
    mine = [r for r in rows if r["method"] != "paper"]
    table = []
    for key, name in _TRUTH_POINTS.items():
        values = array_of(mine, key)
        if values:
            line = _line("truth point", name, key == "error_mm")
            line["median"] = float(np.median(values))
            table.append(line)
    return table


def _line(choice: str, option: str, ours: bool) -> dict[str, Scalar]:  # a flag of the row
    return {"choice": choice, "option": option, "ours": "default" if ours else "",
            **dict.fromkeys(_MEASURES)}  # fmt: skip


def spreads(table: Sequence[dict[str, Scalar]]) -> list[dict[str, Scalar]]:
    """For each choice the range of every measure over its options, widest first."""
    found: list[dict[str, Scalar]] = []
    for choice in dict.fromkeys(str(row["choice"]) for row in table):
        mine = [row for row in table if row["choice"] == choice]
        for key, (name, unit) in _MEASURES.items():
            known = [(v, str(r["option"])) for r in mine if isinstance(v := r[key], float)]
            if len(known) < 2:
                continue
            (low, worst), (high, best) = min(known), max(known)
            if high - low < LEAST_SPREAD:
                continue
            default = next((r[key] for r in mine if r["ours"]), None)
            found.append({
                "choice": choice, "measure": f"{name}, {unit}", "default": default, "lowest": low,
                "lowest_by": worst, "highest": high, "highest_by": best, "spread": high - low,
            })  # fmt: skip
    return sorted(found, key=lambda row: -float(row["spread"] or 0))


def report(table: Sequence[dict[str, Scalar]], material: str) -> Item:
    """The choices, and the spread of the result."""
    found = spreads(table)
    shares = [row for row in found if str(row["measure"]).endswith("%")]
    widest = ", ".join(
        f"{row['choice']} ({float(row['spread'] or 0):.0f} points of {row['measure']})".replace(
            ", %)", ")"
        )
        for row in shares[:3]
    )
    return Item(
        id="ambiguity",
        source="throughout",
        title="Where the paper is silent: the choices, and the spread of the result",
        summary=(
            f"What the paper leaves open changes more than what it compares: widest are {widest}. "
            "A figure of this method says little without its choices."
        ),
        method=(
            "Each choice alone, from the defaults; all but the window's own take any radius that "
            "fruit can have (with 30 to 60 px most near fruit have no circle, and nothing else "
            "would show). Recognition by pixels of the cleaned mask (the rivals' thresholds: of "
            "the raw one), fruit by circles of IoU 0.5, matches of fruit half visible in both "
            "views. No option was chosen by these figures."
        ),
        material=material,
        tables=(
            Table("ambiguity", "The spread of the result over the readings of each choice.",
                  _SPREADS, found),
            Table("ambiguity_options", "Every option.", _OPTIONS, table),
        ),
        figures=(Figure("ambiguity", "The spread over the options of each choice; the dot is the "
                        "default.", draw(shares)),),
    )  # fmt: skip


_SPREADS: Final = {
    "choice": Column("choice"), "measure": Column("result"), "default": Column("default"),
    "lowest": Column("lowest"), "lowest_by": Column("with"), "highest": Column("highest"),
    "highest_by": Column("with"), "spread": Column("spread"),
}  # fmt: skip
_OPTIONS: Final = {
    "choice": Column("choice"), "option": Column("option"), "ours": Column("")
} | {key: Column(f"{name}, {unit}") for key, (name, unit) in _MEASURES.items()}  # fmt: skip


def draw(shares: Sequence[dict[str, Scalar]]) -> bytes:
    """A bar a choice and measure, from lowest to highest."""
    shown = [row for row in shares if float(row["spread"] or 0) >= 0.5][:16]
    with charts.drawing(7.0, 0.9 + 0.23 * len(shown)) as (sheet, done):
        axes = sheet.subplots()
        for place, row in enumerate(shown):
            low, high = float(row["lowest"] or 0), float(row["highest"] or 0)
            axes.barh(place, high - low, left=low, color=charts.SKY, height=0.6)
            if isinstance(row["default"], float):
                axes.plot(row["default"], place, "o", color="black", ms=4)
        axes.set_yticks(range(len(shown)), [f"{r['choice']}: {r['measure']}" for r in shown])
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.set_xlim(0, 100)
        axes.set_xlabel("%")
    return done[0]
