"""The report's scores: what was counted, with its 95 % intervals, in tables."""

from collections.abc import Callable, Iterator, Sequence
from html import escape
from typing import Final

import numpy as np

from processor.curves import Bools, Floats, f1_of, resampled95, rms_of
from processor.page_parts import NOT_SCORED, Head, grid, shown
from processor.score import (
    FRUIT_VISIBILITY,
    RANGES_M,
    VISIBILITY,
    Detection,
    Errors,
    Interval,
    Matches,
    Score,
    wilson95,
)
from viewer.report_columns import Column

DASH: Final = "–"
MM: Final = 1000.0
_ERRORS: Final = (
    "distances", "bias mm", "RMSE mm", "95th percentile mm", "largest mm", "within interval %",
)  # fmt: skip


def at_a_glance(columns: Sequence[Column]) -> str:
    """Every measure of all pairs, a column a method."""
    heads = [Head("of all pairs", "words"), *(Head(escape(c.label), "n") for c in columns)]
    told = [list(_measures(column)) for column in columns]
    rows = [[name, *(of[place][1] for of in told)] for place, (name, _) in enumerate(told[0])]
    caption = (
        "What was counted over all pairs. Below a value stands its 95&nbsp;% interval: Wilson’s "
        "for shares; for F1 and RMSE by drawing whole pairs again, where there are at least five. "
        "“Within interval” are errors inside the 95&nbsp;% interval that the method itself gives."
    )
    return grid(heads, rows, caption=caption, kind="glance")


def _measures(column: Column) -> Iterator[tuple[str, str]]:
    score = column.score
    everything = np.ones(column.pairs, bool)
    yield "pairs", str(score.frames)
    left, right, located = (
        int(column.frames[name].sum()) for name in ("left_fruit", "right_fruit", "matched")
    )
    yield "circles found, left / right", f"{left} / {right}"
    yield "fruit located", str(located)
    recall = None if score.pixels is None else score.pixels.recall
    yield "pixels: recall %", cell(recall, scored=score.pixels is not None)
    pixels = None if score.pixels is None else score.pixels.f1
    yield (
        "pixels: F1 %",
        cell(pixels, _f1_interval(column, "pixels", everything), scored=_knows_false(score.pixels)),
    )
    for name, text in _fruit_cells(column, score.fruit, everything).items():
        yield f"fruit in single views: {name}", text
    m = score.matches
    counts = NOT_SCORED if m is None else f"{m.right} / {m.wrong} / {m.missed}"
    yield "apples in both views: right / wrong / missed", counts
    yield "matched right, of all %", _found_cell(m)
    rate = None if m is None else m.rate
    yield (
        "matched right, of the matched %",
        cell(rate, None if m is None else m.wilson95, scored=m is not None),
    )
    every_fruit = np.ones(len(column.fruit.pair), bool)
    yield from zip(_ERRORS, _error_cells(column, score.distance_m, every_fruit), strict=True)
    locate = sum(ms for stage, ms in score.time_ms.items() if stage != "decode")
    decode = score.time_ms.get("decode", 0.0)
    times = f"<br><span class='interval'>{locate / decode:.1f} × decoding</span>" if decode else ""
    yield "locate, median ms a pair", f"{locate:.0f}{times}"


def cell(
    value: float | None,
    interval: Interval | None = None,
    *,
    scale: float = 100.0,
    digits: int = 1,
    signed: bool = False,
    scored: bool = True,
) -> str:
    """A value and below it its interval; a dash where there was nothing to divide by."""
    if value is None:
        return DASH if scored else NOT_SCORED
    text = shown(value * scale, digits, signed=signed)
    if interval is None:
        return text
    low, high = (shown(end * scale, digits) for end in interval)
    return f'{text}<br><span class="interval">{low} to {high}</span>'


def _knows_false(d: Detection | None) -> bool:
    return d is not None and d.fp is not None


def _fruit_cells(column: Column, d: Detection | None, pairs: Bools | None) -> dict[str, str]:
    """Recall, precision and F1; `pairs` are those to draw again, None where no draw is fair."""
    if d is None:
        return dict.fromkeys(("recall %", "precision %", "F1 %"), NOT_SCORED)
    known = _knows_false(d)
    drawn = None if pairs is None else _f1_interval(column, "fruit", pairs)
    judged = d.tp + (d.fp or 0)
    return {
        "recall %": cell(d.recall, wilson95(d.tp, d.tp + d.fn)),
        "precision %": cell(d.precision, wilson95(d.tp, judged) if known else None, scored=known),
        "F1 %": cell(d.f1, drawn if known else None, scored=known),
    }


def _found_cell(m: Matches | None) -> str:
    if m is None:
        return NOT_SCORED
    return cell(m.found, wilson95(m.right, m.right + m.wrong + m.missed))


def _f1_interval(column: Column, what: str, pairs: Bools) -> Interval | None:
    sums = np.column_stack([column.frames[f"{what}_{part}"][pairs] for part in ("tp", "fp", "fn")])
    return resampled95(sums[~np.isnan(sums).any(axis=1)], f1_of)


def _error_cells(column: Column, errors: Errors | None, fruit: Bools) -> list[str]:
    """The cells of `_ERRORS` for some of the fruit."""
    if errors is None:
        unknown = NOT_SCORED if column.score.matches is None else DASH
        return ["0" if unknown == DASH else unknown, *[unknown] * (len(_ERRORS) - 1)]
    located = fruit & ~np.isnan(column.fruit.error_m)
    errors_m, std_m = column.fruit.error_m[located], column.fruit.std_m[located]
    said = ~np.isnan(std_m)
    within = int((np.abs(errors_m[said]) <= 1.96 * std_m[said]).sum())
    n = int(said.sum())
    return [
        str(errors.n),
        cell(errors.bias, scale=MM, signed=True),
        cell(errors.rmse, _rms_interval(column, located), scale=MM),
        cell(errors.p95, scale=MM),
        cell(errors.max, scale=MM),
        cell(within / n, wilson95(within, n)) if n else "none said",
    ]


def _rms_interval(column: Column, located: Bools) -> Interval | None:
    pair, error_m = column.fruit.pair[located], column.fruit.error_m[located]
    squares = np.bincount(pair, error_m**2, minlength=column.pairs)
    counts = np.bincount(pair, minlength=column.pairs)
    return resampled95(np.column_stack([squares, counts]), rms_of)


def by_condition(columns: Sequence[Column]) -> str:
    """A row each value of the condition and method."""
    by = next(column.by for column in columns if column.by)
    names = dict.fromkeys(n for c in columns for n in c.groups if n != "all")

    def row(column: Column, name: str) -> list[str] | None:
        score = column.groups.get(name)
        if score is None:
            return None
        pairs = column.group_of == name.partition("=")[2]
        fruit = pairs[column.fruit.pair]
        return [
            str(score.frames),
            *_fruit_cells(column, score.fruit, pairs).values(),
            _found_cell(score.matches),
            *_some_errors(column, score.distance_m, fruit),
        ]

    heads = ["pairs", "recall %", "precision %", "F1 %", "matched right %", *_SOME]
    labels = {name: name.partition("=")[2] for name in names}
    caption = (
        f"By {escape(by)}: fruit found in single views, apples at least half visible in both views "
        "that were matched with themselves, and the errors of the distances."
    )
    return _table(columns, labels, by, heads, row, caption)


_SOME: Final = ("distances", "RMSE mm", "largest mm", "within interval %")


def _some_errors(column: Column, errors: Errors | None, fruit: Bools) -> list[str]:
    cells = dict(zip(_ERRORS, _error_cells(column, errors, fruit), strict=True))
    return [cells[name] for name in _SOME]


def by_range(columns: Sequence[Column]) -> str:
    """A row each class of distance and method."""
    caption = (
        "By the apples’ true distance: how many at least half visible in both views were matched "
        "right, and the errors of the distances."
    )
    return _by_class(
        columns, RANGES_M, "range", lambda c: c.fruit.distance_m,
        lambda score: score.distance_m_by_range, caption,
    )  # fmt: skip


def by_visibility(columns: Sequence[Column]) -> str:
    """Two tables: fruit in single views, then apples and distances."""

    def row(column: Column, name: str) -> list[str]:
        return list(_fruit_cells(column, column.score.fruit_by_visibility[name], None).values())

    heads = ["recall %", "precision %", "F1 %"]
    caption = (
        "By how much a view sees of the fruit, in single views. False circles belong to no fruit, "
        "so they count in every class."
    )
    labels = {name: name.replace("-", "–") for name, *_ in FRUIT_VISIBILITY}
    first = _table(columns, labels, "seen", heads, row, caption)
    caption = (
        "By how much the worse of the two views sees: matching asks for apples at least half "
        "visible; distances are of all whose own two circles were matched."
    )
    second = _by_class(
        columns, VISIBILITY, "seen", lambda c: c.fruit.visible,
        lambda score: score.distance_m_by_visibility, caption,
    )  # fmt: skip
    return first + second


def _by_class(
    columns: Sequence[Column],
    classes: Sequence[tuple[str, float, float]],
    what: str,
    value_of: Callable[[Column], Floats],
    errors_of: Callable[[Score], dict[str, Errors | None]],
    caption: str,
) -> str:
    ends = {name: (least, below) for name, least, below in classes}

    def row(column: Column, name: str) -> list[str] | None:
        least, below = ends[name]
        values = value_of(column)
        mine = (values >= least) & (values < below)
        words = column.fruit.match[mine]
        asked = int(sum(word is not None for word in words))
        right = int((words == "right").sum())
        errors = errors_of(column.score)[name]
        if not asked and errors is None:
            return None
        found = cell(right / asked, wilson95(right, asked)) if asked else DASH
        return [str(asked), found, *_error_cells(column, errors, mine)]

    heads = ["apples to match", "matched right %", *_ERRORS]
    labels = {name: name.replace("-", "–") for name in ends}
    return _table(columns, labels, what, heads, row, caption)


def _table(
    columns: Sequence[Column],
    labels: dict[str, str],
    what: str,
    heads: Sequence[str],
    row: Callable[[Column, str], list[str] | None],
    caption: str,
) -> str:
    """A table of classes; with several methods a row each, the class named once."""
    several = len(columns) > 1
    listed = []
    for name, label in labels.items():
        told = [(column, row(column, name)) for column in columns]
        kept = [(column, cells) for column, cells in told if cells is not None]
        for number, (column, cells) in enumerate(kept):
            first = "" if number else escape(label)
            listed.append([first, *([escape(column.label)] if several else []), *cells])
    if not listed:
        return f'<p class="method">{caption} There is none.</p>'
    names = [Head(escape(what)), *([Head("method")] if several else [])]
    return grid([*names, *(Head(h, "n") for h in heads)], listed, caption=caption, kind="classes")
