"""Scores as tables for people: percent and millimetres."""

from collections.abc import Mapping

from rich.table import Table

from processor.score import Detection, Errors, Matches, Score

NOT_SCORED = "not scored"


def score_table(groups: Mapping[str, Score]) -> Table:
    """Groups side by side, a column each."""
    table = Table(show_header=True, header_style="bold")
    table.add_column("")
    for name, score in groups.items():
        table.add_column(f"{name}\n{score.frames} pairs", justify="right")
    columns = [_lines(score) for score in groups.values()]
    for number, (label, _) in enumerate(columns[0]):
        if not label:
            table.add_section()
            continue
        table.add_row(label, *(lines[number][1] for lines in columns))
    return table


def _lines(score: Score) -> list[tuple[str, str]]:
    separator = [("", "")]
    time = sum(ms for stage, ms in score.time_ms.items() if stage != "decode")
    return (
        _pixels("pixels", score.pixels)
        + separator
        + _pixels("cleaned", score.pixels_cleaned)
        + separator
        + _fruit(score.fruit)
        + separator
        + _matches(score.matches)
        + separator
        + _errors(score.distance_m)
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
    return [(f"{name} {label} %", _percent(d, field)) for label, field in measures.items()]


def _fruit(d: Detection | None) -> list[tuple[str, str]]:
    counts = NOT_SCORED if d is None else f"{d.tp} / {'?' if d.fp is None else d.fp} / {d.fn}"
    return [
        ("fruit found / false / missed", counts),
        ("fruit precision %", _percent(d, "precision")),
        ("fruit recall %", _percent(d, "recall")),
        ("fruit F1 %", _percent(d, "f1")),
    ]


def _matches(m: Matches | None) -> list[tuple[str, str]]:
    counts = NOT_SCORED if m is None else f"{m.right} / {m.wrong} / {m.missed}"
    interval = None if m is None else m.wilson95
    return [
        ("matches right / wrong / missed", counts),
        ("match rate %", _percent(m, "rate")),
        (
            "  95 % interval (Wilson)",
            f"{interval[0] * 100:.1f} - {interval[1] * 100:.1f}" if interval else NOT_SCORED,
        ),
        ("matches found %", _percent(m, "found")),
    ]


def _errors(e: Errors | None) -> list[tuple[str, str]]:
    labels = {"bias": "bias", "rmse": "RMSE", "p95": "95th percentile", "max": "largest"}
    rows = [("distance errors", NOT_SCORED if e is None else str(e.n))]
    for field, label in labels.items():
        value = NOT_SCORED if e is None else f"{getattr(e, field) * 1e3:+.1f}"
        rows.append((f"  {label} mm", value))
    return rows


def _percent(measures: Detection | Matches | None, field: str) -> str:
    value = None if measures is None else getattr(measures, field)
    return NOT_SCORED if value is None else f"{value * 100:.1f}"
