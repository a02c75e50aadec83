"""A sweep for people: Markdown, a page with the chart in it; and for programs: JSON."""

from collections.abc import Iterator, Sequence
from html import escape
from typing import Any, Final

from processor.compare.report import points, table
from processor.measures import Measure
from processor.page_parts import Head, document, grid, picture_figure
from processor.paired import Interval
from processor.sweep.effects import Found, Worth
from processor.sweep.settings import Setting
from processor.sweep.splits import Splits

TOP: Final = 10
Section = tuple[str, str, list[str], list[list[str]]]  # heading, words below, heads, rows


def summary(found: Found, splits: Splits) -> list[str]:
    """What was found, in sentences."""
    m = found.measure
    pairs = f"{found.pairs['train']} pairs are train, {found.pairs['test']} test."
    lines = [f"Split: {splits.said} {pairs}"]
    if found.best is None:
        return [*lines, f"{m.name} is not scored on train: nothing to choose by. Is there truth?"]
    same = " (the method as it was given)" if found.best.setting.is_base else ""
    lines.append(f"Best on train by {m.name}: {_words(found.best.setting)}{same}.")
    lines.append(f"Its value: {_value(found.best.train, found.best.train95, m)} on train, "
                 f"{_value(found.best.test, found.best.test95, m)} on test.")  # fmt: skip
    if found.on_test is not None and found.on_test.difference is not None:
        one = found.on_test.difference
        low, high = (f"{end * m.scale:+.{m.digits}f}" for end in one.interval95)
        lines.append(
            f"Against the method as it was, on test: {points(one.change, m, '+')} "
            f"({low} to {high}; {_p(found.on_test.p_holm)}): {found.on_test.verdict}."
        )
    return lines


def _p(value: float | None) -> str:
    """The p-value, which the verdict goes by; the interval is for the eye."""
    if value is None:
        return "too few pairs for a test"
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}"


def _words(setting: Setting) -> str:
    return ", ".join(f"{name} = {value}" for name, value in setting.values.items())


def _value(value: float | None, ends: Interval | None, m: Measure) -> str:
    if value is None:
        return "not scored"
    text = f"{value * m.scale:.{m.digits}f} {m.unit}"
    if ends is None:
        return text
    return f"{text} ({ends[0] * m.scale:.{m.digits}f} to {ends[1] * m.scale:.{m.digits}f})"


def sections(found: Found, settings: Sequence[Setting]) -> Iterator[Section]:
    """The tables."""
    m = found.measure

    def cell(value: float | None) -> str:
        return "not scored" if value is None else f"{value * m.scale:.{m.digits}f}"

    rows = []
    for name, levels in found.effects.items():
        rows += [
            [name, level.value, str(level.settings), cell(level.train), cell(level.worst),
             cell(level.best), cell(level.test)]
            for level in levels
        ]  # fmt: skip
    words = (
        f"{m.title}, {m.unit}: the mean over all settings that have the value, the parameter with "
        "the largest effect on train first."
    )
    yield (
        "Main effects",
        words,
        ["parameter", "value", "settings", "train", "worst", "best", "test"],
        rows,
    )
    chosen = [settings[number] for number in found.ranking[:TOP]]
    chosen += [] if found.base.setting in chosen else [found.base.setting]
    yield (
        "Settings",
        f"The best of {len(found.ranking)} on train, and the method as it was given.",
        ["setting", *settings[0].values, "train", "test"],
        [
            [
                f"{one.number}{' (as given)' if one.is_base else ''}", *one.values.values(),
                *(cell(_known(values[one.number])) for values in (found.train, found.test)),
            ]
            for one in chosen
        ],
    )  # fmt: skip


def _known(value: float) -> float | None:
    return None if value != value else float(value)  # noqa: PLR0124  # a NaN is not itself


def as_markdown(found: Found, settings: Sequence[Setting], splits: Splits) -> str:
    """The report; its chart lies beside it."""
    lines = ["# Sweep", "", *(f"- {line}" for line in summary(found, splits)), ""]
    lines += ["![Main effects](effects.png)", ""]
    for heading, words, heads, rows in sections(found, settings):
        lines += [f"## {heading}", "", words, "", *table(heads, rows, left=(0, 1)), ""]
    return "\n".join(lines)


def as_page(found: Found, settings: Sequence[Setting], splits: Splits, chart: bytes) -> str:
    """One HTML file with the chart inside."""
    caption = "The mean of all settings with that value; a grey dot is one setting on train."
    body = ["<h1>Sweep</h1>"]
    body += [f'<p class="summary">{escape(line)}</p>' for line in summary(found, splits)]
    body.append(picture_figure(chart, caption, alt="Main effects"))
    for heading, words, heads, rows in sections(found, settings):
        numeric = [all(_is_number(row[i]) for row in rows) for i in range(len(heads))]
        columns = [Head(escape(h), "n" * n) for h, n in zip(heads, numeric, strict=True)]
        cells = ([escape(cell) for cell in row] for row in rows)
        body += [f"<h2>{heading}</h2>", f"<p>{escape(words)}</p>", grid(columns, cells)]
    return document("Sweep", body)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text in ("-", "not scored")
    return True


def as_document(found: Found, settings: Sequence[Setting], splits: Splits) -> dict[str, Any]:
    """The sweep as one JSON document, values in the unit that the measure's name says."""
    m = found.measure

    def scaled(value: float | None) -> float | None:
        return None if value is None else value * m.written

    def worth(one: Worth) -> dict[str, Any]:
        return {
            "setting": one.setting.number,
            "values": one.setting.values,
            "train": scaled(one.train),
            "test": scaled(one.test),
            "train95": one.train95 and [scaled(end) for end in one.train95],
            "test95": one.test95 and [scaled(end) for end in one.test95],
            "locate_ms": one.locate_ms,
        }

    on_test = None
    if found.on_test is not None and found.on_test.difference is not None:
        d = found.on_test.difference
        on_test = {
            "verdict": found.on_test.verdict,
            "change": scaled(d.change),
            "interval95": [scaled(end) for end in d.interval95],
            "p": d.p,
        }
    return {
        "measure": m.name,
        "settings": len(settings),
        "pairs": dict(found.pairs),
        "split": splits.said,
        "effects": {
            name: [
                {"value": level.value, "settings": level.settings, "train": scaled(level.train),
                 "test": scaled(level.test)}
                for level in levels
            ]
            for name, levels in found.effects.items()
        },
        "best": None if found.best is None else worth(found.best),
        "base": worth(found.base),
        "best_against_base_on_test": on_test,
    }  # fmt: skip
