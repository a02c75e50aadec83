"""Sec. 3.3 and Fig. 4: fruit matched from left to right, and the cause of each that is not."""

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from processor import charts
from processor.circles import RandomRing
from processor.count import FrameCounts, count_frame
from processor.experiments.causes import CAUSES, PAPERS_CAUSES, causes
from processor.experiments.item import Claim, Item, Verdict
from processor.experiments.material import Material, Source, describe, for_matching
from processor.experiments.outlines import as_recognition, discs_of
from processor.experiments.windows import ring_of
from processor.experiments.work import Bench, Row, Sample, samples
from processor.locate import Locator, Stopwatch
from processor.match import AreaInOrder
from processor.page_parts import Column, Figure, Scalar, Table, percent
from processor.score import matches, wilson95
from processor.trace import Look, Matching, Trace, ViewTrace
from recorder.records import SIDES, Labels, Side, counted_fruit
from recorder.rectify import Rectification

if TYPE_CHECKING:
    from processor.charts import Axes

PAPER_RIGHT: Final = 308  # Sec. 3.3: 323 pairs of apples, 15 of them incorrectly matched
PAPER_ALL: Final = 323
ENOUGH: Final = 100  # matches: with fewer, even 95 % of them leave room for 89 %
METHODS: Final = (
    "paper", "paper, any radius", "no reference line", "area alone", "true masks, any radius",
)  # fmt: skip


def locator_of(method: str, rectification: Rectification) -> Locator:
    """The locator of a method's name; those after the first look for any radius fruit can have."""
    if method == "paper":
        return Locator()
    matcher = {
        "no reference line": AreaInOrder(reference_line=False),
        "area alone": AreaInOrder(in_order=False, reference_line=False),
    }.get(method, AreaInOrder())
    return Locator(circles=ring_of(rectification), match=matcher)


def locate(method: str, sample: Sample) -> Trace | None:
    """Locate a pair; "true masks" takes the labels for what was recognised, if there are any."""
    locator = locator_of(method, sample.rectification)
    if not method.startswith("true masks"):
        return locator(sample.left, sample.right, sample.rectification, sample.seed)
    views = []
    for number, side in enumerate(SIDES):
        labels = sample.labels(side)
        if labels is None:
            return None
        recognition = as_recognition(counted_fruit(labels))
        cleaning = locator.clean(recognition)
        picture = sample.picture(side)
        look = Look(picture, recognition, sample.rectification)
        fitted = locator.circles(cleaning, (*sample.seed, number), look)
        views.append(ViewTrace(picture, recognition, cleaning, fitted))
    matching = locator.match(views[0], views[1], sample.rectification)
    apples = locator.triangulate(views[0], views[1], matching, sample.rectification)
    return Trace(views[0], views[1], matching, apples, Stopwatch().laps)


def measure_matches(sample: Sample) -> list[Row]:
    """What became of each apple that is half visible in both views, by method, and why."""
    rows = []
    for method in METHODS:
        trace = locate(method, sample)
        if trace is None:
            continue
        counts = count_frame(trace, sample.pair.truth, sample.rectification)
        why = _causes(method, sample, trace, counts)
        rows += [
            {
                "method": method, "apple": verdict.apple_id, "match": verdict.match,
                "cause": why.get(verdict.apple_id), "distance_m": verdict.distance_m,
                "found": verdict.found_left and verdict.found_right,
            }
            for verdict in counts.apples if verdict.match is not None
        ]  # fmt: skip
    return rows


def _causes(method: str, sample: Sample, trace: Trace, counts: FrameCounts) -> dict[int, str]:
    locator = locator_of(method, sample.rectification)
    matcher, finder = locator.match, locator.circles
    assert isinstance(matcher, AreaInOrder)
    assert isinstance(finder, RandomRing)
    labels: dict[Side, Labels] = {}
    discs = {}
    for side in SIDES:
        mine = sample.labels(side)
        seen = discs_of(sample, side, mine)
        if mine is None or seen is None:
            return {}
        labels[side], discs[side] = mine, seen
    window_px = finder.min_radius_px, finder.max_radius_px
    return causes(trace, counts, labels, discs, matcher, window_px)


def matching(material: Material, bench: Bench) -> tuple[Item, ...]:
    """Matches and causes over all matching sessions, and one pair drawn as Fig. 4 has it."""
    sources = for_matching(material)
    rows = bench.rows(measure_matches, sources)
    if not rows:
        reason = "no apple of these sessions is half visible in both views"
        return (Item("matching", "Fig. 4, Sec. 3.3", "Matching", not_run=reason),)
    return (report(rows, draw_pair(sources[0]), describe(sources)),)


def report(rows: Sequence[Row], picture: bytes, material: str) -> Item:
    """The table of methods, of causes, and the claim beside 308 of 323."""
    by_method = [_method_row(m, [r for r in rows if r["method"] == m]) for m in METHODS]
    by_method = [row for row in by_method if row]
    ours = matches(r["match"] for r in rows if r["method"] == "paper")
    assert ours is not None
    low, high = wilson95(PAPER_RIGHT, PAPER_ALL) or (None, None)
    interval = ours.wilson95 or (None, None)
    total = ours.right + ours.wrong + ours.missed
    found_interval = wilson95(ours.right, total) or (None, None)
    rate, found = percent(ours.rate), percent(ours.found)
    assert low is not None
    assert high is not None
    holds: Verdict = "not scored" if rate is None else (
        "does not hold" if (interval[1] or 0) < low
        else "holds" if rate >= 95 and ours.right + ours.wrong >= ENOUGH else "not scored"
    )  # fmt: skip
    failed = [r for r in rows if r["method"] == "paper" and r["match"] != "right"]
    wrong = [r for r in failed if r["match"] == "wrong"]
    why = Counter(r["cause"] for r in failed)
    named = sum(r["cause"] in PAPERS_CAUSES for r in wrong)
    main = ", ".join(f"{cause} ({n})" for cause, n in why.most_common(3))
    return Item(
        id="matching",
        source="Fig. 4, Sec. 3.3",
        title="Fruit matched from left to right",
        summary=(
            f"Of {total} fruit at least half visible in both views, the paper's method matches "
            f"{ours.right} rightly, {ours.wrong} wrongly, and {ours.missed} not at all. Of those "
            f"that it matches, {rate or 0:.0f} % are right (the paper: 95.4 %, Wilson interval "
            f"{100 * low:.1f} to {100 * high:.1f} %); of all that could be matched, "
            f"{found or 0:.0f} %. The paper does not say which of the two it counted. Most fail "
            f"before matching begins: {main}."
        ),
        method=(
            "An apple counts where at least half of its outline is seen in both views. Right: its "
            "own two circles were matched; wrong: one of them was matched with something else; "
            "missed: neither. The cause is the first that applies, in the order of the table. "
            "“Any radius” takes the window from rig, range and fruit size instead of 30 to 60 px; "
            "“true masks” gives the method the labels in place of what it recognised."
        ),
        material=material,
        claims=(
            Claim("matches that are right", 100 * PAPER_RIGHT / PAPER_ALL, rate, "%", 1,
                  percent(interval[0]), percent(interval[1]), holds,
                  f"of {ours.right + ours.wrong} matches; the paper's own interval is "
                  f"{100 * low:.1f} to {100 * high:.1f} %"),
            Claim("fruit matched rightly, of all visible in both", 100 * PAPER_RIGHT / PAPER_ALL,
                  found, "%", 1, percent(found_interval[0]), percent(found_interval[1]),
                  "holds" if (found or 0) >= 95 else "does not hold",
                  "if the 323 were all that could have been matched"),
            Claim("wrong matches with the paper's cause", None,
                  percent(named / len(wrong)) if wrong else None, "%", 0,
                  sentence="merged or split in one view, which the paper calls the main reason"),
        ),
        tables=(
            Table("matching", "Fruit at least half visible in both views, by method.", _METHODS,
                  by_method),
            Table("matching_wrong", "Every wrong match of the paper's method, and its cause.",
                  _WRONG, [_wrong_row(row) for row in wrong]),
            Table("matching_causes", "Why fruit were matched wrongly, or not at all.",
                  _CAUSES, _cause_rows(rows)),
        ),
        figures=(Figure("fig4", "One pair as Fig. 4 has it: the left view with circles and the "
                        "reference line, the right view, both cleaned masks, and their vertical "
                        "projections. Matches have one number; red ones are wrong.", picture),),
    )  # fmt: skip


_METHODS: Final = {
    "method": Column("method"), "fruit": Column("fruit", 0), "right": Column("right", 0),
    "wrong": Column("wrong", 0), "missed": Column("missed", 0),
    "rate": Column("right of matched, %"), "low": Column("from"), "high": Column("to"),
    "found": Column("right of all, %"), "circles": Column("circle in both views, %"),
}  # fmt: skip
_CAUSES: Final = {
    "cause": Column("cause"), "wrong": Column("paper: wrong", 0),
    "missed": Column("missed", 0), "wrong_any": Column("any radius: wrong", 0),
    "missed_any": Column("missed", 0), "wrong_true": Column("true masks: wrong", 0),
    "missed_true": Column("missed", 0),
}  # fmt: skip


_WRONG: Final = {
    "session": Column("session"), "frame": Column("pair", 0), "apple": Column("apple", 0),
    "distance": Column("distance, mm", 0), "cause": Column("cause"),
}  # fmt: skip


def _wrong_row(row: Row) -> dict[str, Scalar]:
    away = row["distance_m"]
    return {**row, "distance": None if away is None else 1e3 * away}


def _method_row(method: str, rows: Sequence[Row]) -> dict[str, Scalar]:
    counted = matches(r["match"] for r in rows)
    if counted is None:
        return {}
    interval = counted.wilson95 or (None, None)
    return {
        "method": method, "fruit": len(rows), "right": counted.right, "wrong": counted.wrong,
        "missed": counted.missed, "rate": percent(counted.rate), "low": percent(interval[0]),
        "high": percent(interval[1]), "found": percent(counted.found),
        "circles": 100 * sum(r["found"] for r in rows) / len(rows),
    }  # fmt: skip


def _cause_rows(rows: Sequence[Row]) -> list[dict[str, Scalar]]:
    columns = {"": "paper", "_any": "paper, any radius", "_true": "true masks, any radius"}
    table: list[dict[str, Scalar]] = []
    for cause in CAUSES:
        line: dict[str, Scalar] = {"cause": cause}
        for ending, method in columns.items():
            for verdict in ("wrong", "missed"):
                line[f"{verdict}{ending}"] = sum(
                    r["cause"] == cause and r["method"] == method and r["match"] == verdict
                    for r in rows
                )
        table.append(line)
    return table


def draw_pair(source: Source) -> bytes:
    """The first pair of the first session, by the paper's method with any radius."""
    sample = next(samples(source))
    trace = locate("paper, any radius", sample)
    assert trace is not None
    counts = count_frame(trace, sample.pair.truth, sample.rectification)
    with charts.drawing(7.0, 6.6) as (sheet, done):
        panels = sheet.subplots(3, 2, height_ratios=[3, 3, 1.5])
        for column, side in enumerate(SIDES):
            view = trace.view(side)
            above, below = f"({'ab'[column]}) {side} view", f"({'cd'[column]}) {side}, cleaned"
            charts.show_picture(panels[0][column], view.picture, above)
            charts.show_picture(panels[1][column], view.cleaning.mask, below)
            _draw_projection(panels[2][column], trace.matching, column)
        _draw_matches(panels[0], trace, counts)
        if trace.matching.reference_px is not None:
            for axes in (panels[0][0], panels[1][0]):
                axes.axvline(trace.matching.reference_px, color="white", ls="--", lw=1)
    return done[0]


def _draw_projection(axes: "Axes", matching: Matching, column: int) -> None:
    axes.plot(matching.projections[column], color=charts.BLUE, lw=0.9)
    axes.set_title("(e) vertical projections" if column == 0 else "")
    axes.set_xlabel("column, px")
    if column == 0 and matching.reference_px is not None:
        axes.axvline(matching.reference_px, color=charts.RED, ls="--", lw=1)


def _draw_matches(panels: Sequence["Axes"], trace: Trace, counts: FrameCounts) -> None:
    for number, (i, j) in enumerate(trace.matching.pairs.tolist(), start=1):
        ids = counts.found_left[i], counts.found_right[j]
        right = ids[0] is not None and ids[0] == ids[1]
        for axes, side, place in ((panels[0], "left", i), (panels[1], "right", j)):
            fruit = trace.view(side).circles.fruit[place]
            colour = "white" if right else "#ff5040"
            charts.outline(axes, (fruit.x_px, fruit.y_px, fruit.radius_px), colour)
            axes.text(fruit.x_px, fruit.y_px, str(number), color=colour, fontsize=7, ha="center",
                      va="center", weight="bold")  # fmt: skip
