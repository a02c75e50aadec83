"""Scores as tables for people: percent and millimetres."""

from collections.abc import Mapping

from rich import box
from rich.table import Table

from processor.score import Detection, Errors, Interval, Matches, Score
from processor.sureness import Curve
from recorder.words import counted

NOT_SCORED = "not scored"  # the truth does not say
NOTHING = "-"  # it does, but there was none


def score_table(groups: Mapping[str, Score]) -> Table:
    """Groups side by side, a column each; fits 80 columns up to five groups."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 0))
    table.add_column("", no_wrap=True)
    for name, score in groups.items():
        value = name.partition("=")[2] or name
        table.add_column(f"{value}\n{counted(score.frames, 'pair')}", justify="right", min_width=9)
    columns = [_lines(score) for score in groups.values()]
    for number, (label, _) in enumerate(columns[0]):
        if not label:
            table.add_section()
            continue
        values = [lines[number][1] for lines in columns]
        if not label.startswith(" ") or set(values) != {NOTHING}:  # a row of dashes tells nobody
            table.add_row(label, *values)
    return table


def _lines(score: Score) -> list[tuple[str, str]]:
    separator = [("", "")]
    time = sum(ms for stage, ms in score.time_ms.items() if stage != "decode")
    return (
        _pixels("recognised pixels", score.pixels)
        + separator
        + _pixels("cleaned pixels", score.pixels_cleaned)
        + separator
        + _fruit(score.fruit)
        + [
            (f"  {name.replace('%', ' %')} visible: F1 %", _percent(found, "f1"))
            for name, found in score.fruit_by_visibility.items()
        ]
        + _curve(score.by_confidence["fruit"], score.fruit is None)
        + separator
        + _matches(score.matches)
        + _curve(score.by_confidence["matches"], score.matches is None)
        + separator
        + _errors(score.distance_m, NOT_SCORED if score.matches is None else NOTHING)
        + _by_visibility(score, NOT_SCORED if score.matches is None else NOTHING)
        + separator
        + [("locate, median ms a pair", f"{time:.1f}")]
    )


def _pixels(name: str, d: Detection | None) -> list[tuple[str, str]]:
    measures = {
        "hits": "hit",
        "false positives": "false_positive",
        "false negatives": "false_negative",
        "precision": "precision",
        "recall": "recall",
        "F1": "f1",
    }
    rates = [(f"  {label} %", _percent(d, field)) for label, field in measures.items()]
    return [(name, "" if d else NOT_SCORED), *rates]


def _fruit(d: Detection | None) -> list[tuple[str, str]]:
    return [
        ("fruit found", _count(d, "tp")),
        ("  false", _count(d, "fp")),
        ("  missed", _count(d, "fn")),
        ("  precision %", _percent(d, "precision")),
        ("  recall %", _percent(d, "recall")),
        ("  F1 %", _percent(d, "f1")),
    ]


def _matches(m: Matches | None) -> list[tuple[str, str]]:
    interval = None if m is None else m.wilson95
    return [
        ("matches right", _count(m, "right")),
        ("  wrong", _count(m, "wrong")),
        ("  missed", _count(m, "missed")),
        ("  rate %", _percent(m, "rate")),
        (
            "  its 95 % interval",
            _range(interval) if interval else _unknown(m),
        ),
        ("  found %", _percent(m, "found")),
    ]


def _range(interval: Interval) -> str:
    """Two percents in nine characters, which a column has."""
    low, high = (f"{end * 100:.1f}" for end in interval)
    return f"{low}-{high}".replace("100.0", "100")


def _errors(e: Errors | None, unknown: str) -> list[tuple[str, str]]:
    labels = {
        "bias": ("bias", "+.1f"),
        "rmse": ("RMSE", ".1f"),
        "p95": ("95th percentile", ".1f"),
        "max": ("largest", ".1f"),
    }
    rows = [("distance errors", unknown if e is None else str(e.n))]
    for field, (label, form) in labels.items():
        value = unknown if e is None else format(getattr(e, field) * 1e3, form)
        rows.append((f"  {label} mm", value))
    return rows


def _by_visibility(score: Score, unknown: str) -> list[tuple[str, str]]:
    """RMSE, and how many of the 95 % intervals hold, by what the worse view sees."""
    rows = []
    for name, found in score.distance_m_by_visibility.items():
        label = name.replace("%", " %")
        rmse = unknown if found is None else f"{found.rmse * 1e3:.1f}"
        rows.append((f"  {label} visible: RMSE mm", rmse))
    for name, share in score.covered95.items():
        label = "all" if name == "all" else name.replace("%", " % visible")
        rows.append((f"  covered, {label} %", unknown if share is None else f"{share * 100:.1f}"))
    return rows


def _curve(curve: Curve | None, unscored: bool) -> list[tuple[str, str]]:
    """Average precision, and how far what is said is from what is right."""
    unknown = NOT_SCORED if unscored else NOTHING
    measures = (
        ("average precision %", "average_precision"),
        ("confidence off by %", "calibration_error"),
    )
    rows = []
    for label, field in measures:
        value = None if curve is None else getattr(curve, field)
        rows.append((f"  {label}", unknown if value is None else f"{value * 100:.1f}"))
    return rows


def _percent(measures: Detection | Matches | None, field: str) -> str:
    value = None if measures is None else getattr(measures, field)
    return _unknown(measures) if value is None else f"{value * 100:.1f}"


def _unknown(measures: Detection | Matches | None) -> str:
    """Nobody can say; or there is nothing to divide by."""
    unlabelled = isinstance(measures, Detection) and measures.fp is None
    return NOT_SCORED if measures is None or unlabelled else NOTHING


def _count(measures: Detection | Matches | None, field: str) -> str:
    value = None if measures is None else getattr(measures, field)
    return NOT_SCORED if value is None else str(value)
