"""A comparison for programs: one JSON document, every measure in the unit that its name says."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from processor.compare.comparison import Comparison
from processor.compare.gate import Checked
from processor.compare.judge import Judged
from processor.compare.sides import Side


def as_document(comparison: Comparison, checked: Sequence[Checked] | None) -> dict[str, Any]:
    """The comparison as one JSON document; every measure in the unit that its name says."""
    c = comparison
    return {
        "a": _side_document(c.sides.a),
        "b": _side_document(c.sides.b),
        "same_run": c.sides.same,
        "sessions": list(c.sides.sessions),
        "left_out": list(c.sides.left_out),
        "pairs": c.pairs,
        "unit": c.unit,
        "measures": {one.measure.name: _measure_document(one) for one in c.judged},
        "fruit": asdict(c.tally),
        "fruit_by_seed": None if c.by_seed is None else asdict(c.by_seed),
        "false_circles": None if c.false is None else {"a": c.false[0], "b": c.false[1]},
        "time_ms": {"a": c.time_ms[0], "b": c.time_ms[1]},
        "notes": list(c.notes),
        "gate": None if checked is None else {
            "passed": all(one.passed for one in checked),
            "rules": [
                {"rule": one.name, "limit": one.rule.limit, "passed": one.passed,
                 "unsure": one.unsure, "line": one.line}
                for one in checked
            ],
        },
    }  # fmt: skip


def _side_document(side: Side) -> dict[str, Any]:
    return {
        "folders": [str(repeat.folder) for repeat in side.repeats],
        "method": side.method,
        "seeds": [repeat.seed for repeat in side.repeats],
    }


def _measure_document(one: Judged) -> dict[str, Any]:
    m, d = one.measure, one.difference
    about: dict[str, Any] = {
        "verdict": one.verdict,
        "size": one.size or None,
        "better": m.better,
        "matters": one.matters * m.written,
        "units_needed": one.units_needed,
        "p_holm": one.p_holm,
    }
    if d is None:
        return about
    ends = {"interval95": d.interval95, "interval90": d.interval90,
            "worsening95": d.worsening95, "worsening90": d.worsening90}  # fmt: skip
    return about | {
        "a": d.a * m.written,
        "b": d.b * m.written,
        "change": d.change * m.written,
        "worsening": d.worsening * m.written,
        **{name: [_finite(end * m.written) for end in pair] for name, pair in ends.items()},
        "units": d.units,
        "std": None if d.std is None else d.std * m.written,
        "p": d.p,
        "seed_std": [None if s is None else s * m.written for s in one.seed_std],
    }


def _finite(value: float) -> float | None:
    """JSON has no infinity: an interval without an end is null there."""
    return value if math.isfinite(value) else None
