"""The report's plots: errors, precision against recall, what intervals and confidence hold."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from processor import charts
from processor.charts import LINE, SOFT, drawing_for_page
from processor.curves import (
    PrecisionRecall,
    Share,
    coverage,
    precision_recall,
    reliability,
)
from processor.page_parts import Head, drawing_figure, folded, grid, shown
from processor.palette import ESTIMATE, STAGES, as_hex
from viewer.report_columns import Column

if TYPE_CHECKING:
    from processor.charts import Axes

MOST_POINTS: Final = 1500  # of a method in a plot: more hide each other and weigh megabytes
ALLOWED_MM: Final = 20.0  # the paper's claim of a distance's error
# a method's own colour, line and marker; none is the truth's blue
_COLOURS: Final = (as_hex(ESTIMATE), charts.GREEN, charts.PURPLE, charts.GREY)
_LINES: Final = ("-", "--", "-.", ":")


@dataclass(frozen=True, slots=True)
class Look:
    """How a method is drawn in every plot."""

    colour: str
    line: str
    marker: str


def look(number: int) -> Look:
    """Of the column in that place; from the fifth on, colours come again with other markers."""
    return Look(
        _COLOURS[number % len(_COLOURS)],
        _LINES[number % len(_LINES)],
        charts.MARKERS[number % len(charts.MARKERS)],
    )


def errors_against_range(columns: Sequence[Column]) -> str:
    """Every distance error over its true distance."""
    told, rows = [], []
    with drawing_for_page(7.6, 3.4) as (sheet, done):
        axes = sheet.subplots()
        axes.axhspan(-ALLOWED_MM, ALLOWED_MM, color=LINE, alpha=0.45, lw=0)
        axes.axhline(0, color=SOFT, lw=0.8)
        for number, column in enumerate(columns):
            fruit, style = column.fruit, look(number)
            known = ~np.isnan(fruit.error_m) & ~np.isnan(fruit.distance_m)
            distance, error = fruit.distance_m[known], 1000 * fruit.error_m[known]
            if not len(error):
                continue
            kept = _worst_and_even(np.abs(error))
            axes.plot(
                distance[kept], error[kept], ls="", marker=style.marker, ms=3.2, mew=0,
                alpha=0.65, color=style.colour, label=column.label,
            )  # fmt: skip
            inside = float(np.mean(np.abs(error) <= ALLOWED_MM))
            part = f" ({len(kept)} of them drawn)" if len(kept) < len(error) else ""
            told.append(
                f"{column.label}: {len(error)} distances{part}, "
                f"{100 * inside:.0f} % within ±{ALLOWED_MM:g} mm"
            )
            size = np.abs(error)
            rows.append(
                [escape(column.label), str(len(error)), *(shown(float(v)) for v in (
                    distance.min(), distance.max(), np.median(error), np.median(size), size.max(),
                ))]
            )  # fmt: skip
        axes.set_xlabel("true distance, m")
        axes.set_ylabel("estimated − true, mm")
        _robust_limits(axes, columns)
        _legend(axes, columns)
    if not told:
        return _nothing("Error against range", "no distance of these runs has a true one")
    caption = (
        f"Error against range. {'; '.join(told)}; the band is what the paper allows a distance. "
        "Errors beyond the axis stand at its edge."
    )
    heads = ["method", "distances", "nearest m", "furthest m", "median mm", "median size mm",
             "largest mm"]  # fmt: skip
    return drawing_figure(done[0], "errors", caption) + _numbers(heads, rows)


def _worst_and_even(sizes: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> list[int]:
    """Which to draw where there are too many: the largest fifth of them, and the rest evenly."""
    if len(sizes) <= MOST_POINTS:
        return list(range(len(sizes)))
    order = np.argsort(-sizes, kind="stable")
    worst = order[: MOST_POINTS // 5]
    rest = np.sort(order[MOST_POINTS // 5 :])
    even = rest[np.linspace(0, len(rest) - 1, MOST_POINTS - len(worst)).astype(int)]
    return sorted({*worst.tolist(), *even.tolist()})


def _robust_limits(axes: "Axes", columns: Sequence[Column]) -> None:
    """An axis for nearly all errors; the few beyond are put to its edge, where they are seen."""
    errors = np.concatenate([c.fruit.error_m[~np.isnan(c.fruit.error_m)] for c in columns]) * 1000
    if not len(errors):
        return
    limit = max(1.6 * float(np.percentile(np.abs(errors), 98)), 1.5 * ALLOWED_MM)
    for line in axes.get_lines():
        values = np.asarray(line.get_ydata(), float)
        line.set_ydata(np.clip(values, -0.985 * limit, 0.985 * limit))
    axes.set_ylim(-limit, limit)


def precision_against_recall(columns: Sequence[Column]) -> str:
    """What every threshold of the confidence would give; a point where there is none."""
    told, rows = [], []
    with drawing_for_page(4.4, 3.6) as (sheet, done):
        axes = sheet.subplots()
        for number, column in enumerate(columns):
            style, fruit = look(number), column.score.fruit
            if fruit is None or fruit.precision is None or fruit.recall is None:
                continue
            curve = curve_of(column)
            if curve is not None:
                axes.plot(curve.recall, curve.precision, color=style.colour, ls=style.line)
                told.append(f"{column.label}: average precision {100 * curve.average:.1f} %")
                rows += list(_curve_rows(column.label, curve))
            else:
                told.append(f"{column.label} gives no confidence, so it has one point")
                place = (shown(100 * v) for v in (fruit.precision, fruit.recall))
                rows.append([escape(column.label), "none given", *place])
            axes.plot(
                [fruit.recall], [fruit.precision], color=style.colour, ls=style.line,
                marker=style.marker, ms=7, label=column.label,
            )  # fmt: skip
        axes.set(xlim=(0, 1.01), ylim=(0, 1.01), xlabel="recall", ylabel="precision")
        _legend(axes, columns)
    if not told:
        return _nothing(
            "Precision and recall", "the truth does not say which circles are right and which false"
        )
    caption = (
        f"Precision and recall of circles in single views, over every threshold of their "
        f"confidence that is kept. {'; '.join(told)}. The marker is the run as it is."
    )
    heads = ["method", "confidence at least", "precision %", "recall %"]
    return drawing_figure(done[0], "precision-recall", caption) + _numbers(heads, rows)


def curve_of(column: Column) -> PrecisionRecall | None:
    """The column's curve; None without confidences or without a known number of fruit."""
    circles = column.circles
    if circles.wanted is None or not len(circles.true) or np.isnan(circles.confidence).any():
        return None
    return precision_recall(circles.confidence, circles.true, circles.wanted)


def _curve_rows(label: str, curve: PrecisionRecall) -> Iterator[list[str]]:
    """Where the confidence passes a tenth, for who wants numbers."""
    for tenth in range(9, -1, -1):
        above = np.flatnonzero(curve.confidence >= tenth / 10)
        if len(above):
            last = above[-1]
            values = (curve.precision[last], curve.recall[last])
            yield [escape(label), f"{tenth / 10:.1f}", *(shown(float(100 * v)) for v in values)]
            if len(above) == len(curve.confidence):
                return


def calibration_of_intervals(columns: Sequence[Column]) -> str:
    """Of intervals said to hold a share of the errors: how many do."""
    shares = {}
    for column in columns:
        fruit = column.fruit
        said = ~np.isnan(fruit.error_m) & ~np.isnan(fruit.std_m)
        shares[column.label] = coverage(fruit.error_m[said], fruit.std_m[said])
    return _calibration(
        columns, shares, "intervals", "Intervals of distances", "share said", "share within",
        "no method says how far off its distances may be, or none was held against a true one",
        "above the line they are too wide, below it too narrow",
    )  # fmt: skip


def calibration_of_confidence(columns: Sequence[Column]) -> str:
    """Of circles that are said to be fruit with a confidence: how many are."""
    shares = {}
    for column in columns:
        circles = column.circles
        said = ~np.isnan(circles.confidence)
        known = circles.wanted is not None
        shares[column.label] = (
            reliability(circles.confidence[said], circles.true[said]) if known else ()
        )
    return _calibration(
        columns, shares, "confidence", "Confidence of circles", "confidence said", "share right",
        "no method says how sure it is of a circle, or nobody knows which are right",
        "above the line it is too modest, below it too sure",
    )  # fmt: skip


def found_by_visibility(columns: Sequence[Column]) -> str:
    """Of the fruit that a view sees so much of: how many it finds."""
    shares = {c.label: reliability(c.circles.seen, c.circles.found) for c in columns}
    return _calibration(
        columns, shares, "visibility", "Fruit by how much is seen", "share seen", "share found",
        "nobody says how much of the fruit is seen",
        "in single views, of fruit at least a tenth visible", diagonal=False,
    )  # fmt: skip


def _calibration(
    columns: Sequence[Column],
    shares: dict[str, tuple[Share, ...]],
    name: str,
    title: str,
    across: str,
    up: str,
    absent: str,
    meaning: str,
    *,
    diagonal: bool = True,
) -> str:
    rows = []
    with drawing_for_page(4.4, 3.6) as (sheet, done):
        axes = sheet.subplots()
        if diagonal:
            axes.plot([0, 1], [0, 1], color=SOFT, lw=0.8)
        for number, column in enumerate(columns):
            found, style = shares[column.label], look(number)
            if not found:
                continue
            ends = np.array([share.interval for share in found])
            at, seen = [s.at for s in found], np.array([s.observed for s in found])
            axes.errorbar(
                at, seen, yerr=np.abs(ends.T - seen), color=style.colour, ls=style.line,
                marker=style.marker, capsize=2, elinewidth=0.9, label=column.label,
            )  # fmt: skip
            rows += [
                [escape(column.label), shown(100 * s.at), str(s.n), shown(100 * s.observed),
                 f"{shown(100 * s.interval[0])} to {shown(100 * s.interval[1])}"]
                for s in found
            ]  # fmt: skip
        axes.set(xlim=(0, 1.01), ylim=(0, 1.01), xlabel=across, ylabel=up)
        _legend(axes, columns)
    if not rows:
        return _nothing(title, absent)
    silent = [column.label for column in columns if not shares[column.label]]
    quiet = f" {', '.join(silent)} says nothing of it." if silent else ""
    caption = f"{title}: {up} against {across}, with 95 % intervals; {meaning}.{quiet}"
    heads = ["method", f"{across} %", "how many", f"{up} %", "its 95 % interval"]
    return drawing_figure(done[0], name, caption) + _numbers(heads, rows)


def stage_times(columns: Sequence[Column]) -> str:
    """Medians of the stages' times, end to end."""
    stages = list(columns[0].score.time_ms)
    with drawing_for_page(7.6, 0.9 + 0.42 * len(columns)) as (sheet, done):
        axes = sheet.subplots()
        for place, column in enumerate(columns):
            start = 0.0
            for stage in stages:
                spent = column.score.time_ms[stage]
                axes.barh(
                    place, spent, left=start, height=0.62, color=as_hex(STAGES[stage]),
                    label=None if place else stage,
                )  # fmt: skip
                start += spent
        axes.set_yticks(range(len(columns)), [column.label for column in columns])
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("median ms a pair, both views")
        sheet.legend(loc="outside upper center", ncols=len(stages))
    rows = [
        [escape(c.label), *(shown(float(c.score.time_ms[s])) for s in stages),
         shown(float(sum(c.score.time_ms.values())))]
        for c in columns
    ]  # fmt: skip
    caption = "Time a stage: the median over all pairs, on the machine that replayed them."
    table = grid(
        [Head("method"), *(Head(f"{s} ms", "n") for s in [*stages, "all"])], rows,
        caption="Median time a stage and pair, both views together.",
    )  # fmt: skip
    return drawing_figure(done[0], "times", caption) + table


def _numbers(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A plot's numbers, for who cannot see it or wants them."""
    first, *rest = heads
    table = grid([Head(first), *(Head(h, "n") for h in rest)], rows)
    return folded("The numbers of this plot", table)


def _legend(axes: "Axes", columns: Sequence[Column]) -> None:
    if len(columns) > 1 and axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best")


def _nothing(title: str, why: str) -> str:
    return f'<p class="notrun"><b>{escape(title)}:</b> not scored; {escape(why)}.</p>'
