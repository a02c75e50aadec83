"""A comparison for people: Markdown that also reads well as it is."""

import math
from collections.abc import Iterator, Sequence
from typing import Final

from processor.compare.changes import Change, Tally
from processor.compare.comparison import Comparison
from processor.compare.gate import Checked, unit_words
from processor.compare.judge import Judged
from processor.compare.sides import Side
from processor.measures import Measure

MOST_SHOWN: Final = 10  # fruit and parameters in the report; --fruit writes every fruit


def as_markdown(comparison: Comparison, checked: Sequence[Checked] = ()) -> str:
    """The report."""
    return "\n".join(
        (
            "# A against B",
            "",
            *_sides(comparison),
            "",
            *_measures(comparison),
            "",
            *_fruit(comparison),
            *_notes(comparison),
            *_gate(checked),
            "",
        )
    )


def _sides(c: Comparison) -> Iterator[str]:
    for side in (c.sides.a, c.sides.b):
        seeds = [repeat.seed for repeat in side.repeats]
        folders = ", ".join(f"`{repeat.folder}`" for repeat in side.repeats)
        said = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {', '.join(map(str, seeds))}"
        yield f"- {side.name}: {folders}, method {side.method}, {said}"
    sessions = len(c.sides.sessions)
    yield f"- {c.pairs} pairs of {sessions} session{'' if sessions == 1 else 's'} on both sides"
    changed = list(_parameters(c.sides.a, c.sides.b))
    if changed:
        shown = "; ".join(changed[:MOST_SHOWN])
        more = len(changed) - MOST_SHOWN
        yield f"- what differs: {shown}{f'; {more} more' if more > 0 else ''}"


def _parameters(a: Side, b: Side) -> Iterator[str]:
    """stage.parameter: A's value -> B's."""
    for stage, ours in a.locator.items():
        theirs = b.locator.get(stage, {})
        if ours.get("use") != theirs.get("use"):
            yield f"{stage}: {ours.get('use')} -> {theirs.get('use')}"
            continue
        for key in dict.fromkeys([*ours, *theirs]):
            if ours.get(key) != theirs.get(key):
                yield f"{stage}.{key}: {ours.get(key)} -> {theirs.get(key)}"


def _measures(c: Comparison) -> Iterator[str]:
    heads = ("measure", "A", "B", "change", "95 % interval", "p", f"{c.unit}s", "verdict")
    rows = [[*_row(one, c.unit)] for one in c.judged]
    a_ms, b_ms = (f"{ms:.1f} ms" for ms in c.time_ms)
    rows.append(["time to locate, median", a_ms, b_ms, _percent(c.time_ms), "", "", "",
                 "not judged: it is the machine's too"])  # fmt: skip
    yield from table(heads, rows, left=(0, 7))
    yield ""
    groups: dict[str, list[str]] = {}
    for one in c.judged:
        groups.setdefault(points(one.matters, one.measure), []).append(one.measure.name)
    matters = "; ".join(f"{size} of {', '.join(names)}" for size, names in groups.items())
    yield (
        f"What matters at least: {matters}. Verdicts: paired t-tests over {c.unit}s, corrected by "
        'Holm, at 5 %; "no difference shown" where the 90 % interval lies within what matters.'
    )


def _percent(values: tuple[float, float]) -> str:
    return "" if not values[0] else f"{100 * (values[1] / values[0] - 1):+.0f} %"


def _row(one: Judged, unit: str) -> Iterator[str]:
    m, d = one.measure, one.difference
    yield m.title
    if d is None:
        yield from ("", "", "", "", "", "", one.verdict)
        return
    yield from (_shown(d.a, m), _shown(d.b, m), points(d.change, m, "+"))
    low, high = d.interval95
    finite = math.isfinite(low) and math.isfinite(high)
    yield " to ".join(_number(end * m.scale, m, "+") for end in d.interval95) if finite else ""
    yield "" if one.p_holm is None else "<0.001" if one.p_holm < 0.001 else f"{one.p_holm:.3f}"
    yield str(d.units)
    needed = ""
    if one.verdict == "too little data" and one.units_needed:
        needed = f"; {unit_words(unit, one.units_needed)} would find what matters"
    yield f"{one.verdict}{f', by {one.size}' if one.size else ''}{needed}"


def _number(value: float, m: Measure, sign: str = "") -> str:
    text = f"{value:{sign}.{m.digits}f}"
    return text if float(text) else text.lstrip("+-")  # zero has no sign


def _shown(value: float, m: Measure) -> str:
    return f"{_number(value * m.scale, m)} {m.unit}".replace(" a pair", "")


def points(value: float, m: Measure, sign: str = "") -> str:
    """A difference; of percents it is points."""
    unit = "points" if m.is_rate else m.unit
    return f"{_number(value * m.scale, m, sign)} {unit}".replace(" a pair", "")


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int]) -> list[str]:
    """A Markdown table whose columns are aligned for those who read it as it is."""
    widths = [max(len(row[i]) for row in (heads, *rows)) for i in range(len(heads))]
    sides = ["<" if i in left else ">" for i in range(len(heads))]

    def line(cells: Sequence[str]) -> str:
        padded = (f"{c:{s}{w}}" for c, s, w in zip(cells, sides, widths, strict=True))
        return f"| {' | '.join(padded)} |"

    rule = (
        f"{'-' * (w + 1)}{'-' if s == '<' else ':'}" for s, w in zip(sides, widths, strict=True)
    )
    return [line(heads), f"|{'|'.join(rule)}|", *map(line, rows)]


def _fruit(c: Comparison) -> Iterator[str]:
    yield "## Fruit"
    yield ""
    yield f"{_tally(c.tally)}."
    if c.false is not None:
        yield f"Circles where no fruit is: {c.false[0]:.0f} in A, {c.false[1]:.0f} in B."
    if c.by_seed is not None:
        yield f"By the seed alone, from A's first run to its second: {_tally(c.by_seed)}."
    largest = _most_changed(c.changes)
    if largest:
        yield ""
        yield "Where most changed: " + "; ".join(largest) + "."


def _tally(t: Tally) -> str:
    views = ""
    if t.seen_gained is not None:
        views = f"; circles on true apples: {t.seen_gained} gained, {t.seen_lost} lost"
    return (
        f"{t.both} fruit located by both, {t.gained} gained, {t.lost} lost, {t.moved} moved{views}"
    )


def _most_changed(changes: Sequence[Change]) -> list[str]:
    pairs: dict[tuple[str, int], dict[str, int]] = {}
    for one in changes:
        counts = pairs.setdefault((one.session, one.frame), {"gained": 0, "lost": 0, "moved": 0})
        counts[one.what] += 1
    order = sorted(pairs, key=lambda key: (-sum(pairs[key].values()), key))
    return [
        f"{session} pair {frame} ("
        + ", ".join(f"{n} {what}" for what, n in pairs[session, frame].items() if n)
        + ")"
        for session, frame in order[:MOST_SHOWN]
    ]


def _notes(c: Comparison) -> Iterator[str]:
    seeds = [
        f"{one.measure.name} {' and '.join(points(s, one.measure) for s in one.seed_std if s)}"
        for one in c.judged
        if any(one.seed_std)
    ]
    if not c.notes and not seeds:
        return
    yield from ("", "## Notes", "")
    yield from (f"- {note}" for note in c.notes)
    if seeds:
        yield f"- The seed alone moves one run's value by (SD, A and B): {', '.join(seeds)}."


def _gate(checked: Sequence[Checked]) -> Iterator[str]:
    if not checked:
        return
    yield from ("", "## Gate", "")
    for one in checked:
        word = "passed" if one.passed else "FAILED"
        yield f"- {word}: {one.line}"
