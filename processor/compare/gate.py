"""A gate: limits that B must keep, from a TOML file; fails closed where the data cannot say.

[fruit_recall]
min = 0.85             # of B
not_worse_by = 0.005   # than A

[distance_rmse_mm]
max = 15
not_worse_by = 1
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from processor.compare.comparison import Comparison
from processor.compare.judge import Judged
from processor.measures import MEASURES, Measure
from processor.paired import units_needed
from recorder.errors import PomologError
from recorder.text_files import read_toml

LIMITS: Final = ("min", "max")
RULES: Final = (*LIMITS, "not_worse_by")
MATTERS: Final = "matters"
TIME: Final = "time_ms"  # judged by limits alone: a machine's load is no property of a method
UNSURE: Final = "when_unsure"
LARGEST: Final = 1e12
UNSURE_WORDS: Final = ("fail", "pass")


@dataclass(frozen=True, slots=True)
class Rule:
    """One limit, in the unit that the measure's name says."""

    measure: str
    kind: str  # min, max or not_worse_by
    limit: float


@dataclass(frozen=True, slots=True)
class Gate:
    """The limits of a file.

    Attributes:
        rules: in their order.
        pass_when_unsure: what becomes of a rule that the data cannot decide.
        matters: measure -> smallest difference of interest, in the measure's own unit.
    """

    rules: tuple[Rule, ...]
    pass_when_unsure: bool = False
    matters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Checked:
    """A rule, held against a comparison.

    Attributes:
        rule: which.
        passed: whether B may go on.
        unsure: the data are too few to say, so that `passed` is what the gate's file chose.
        line: what was found, in one line.
    """

    rule: Rule
    passed: bool
    unsure: bool
    line: str

    @property
    def name(self) -> str:
        """Of the rule, as the file has it."""
        return f"{self.rule.measure}.{self.rule.kind}"


def load_gate(path: Path) -> Gate:
    """Read a gate's file.

    Raises:
        PomologError: it cannot be read, or has a key or a value that no gate has.
    """
    table = read_toml(path, "see one with: pomolog compare --help")
    values = tuple(_values(path, table))
    rules = tuple(value for value in values if value.kind != MATTERS)
    matters = {v.measure: v.limit / MEASURES[v.measure].written for v in values if v not in rules}
    unsure = table.get(UNSURE, "fail")
    if unsure not in UNSURE_WORDS:
        raise PomologError(f"{path}: {UNSURE} = {unsure!r}; choose {' or '.join(UNSURE_WORDS)}")
    if not rules:
        raise PomologError(f"{path} has no limit; give one, such as: [fruit_recall] min = 0.85")
    return Gate(rules, unsure == "pass", matters)


def _values(path: Path, table: Mapping[str, Any]) -> Iterator[Rule]:
    for name, limits in table.items():
        if name == UNSURE:
            continue
        if name not in MEASURES and name != TIME:
            known = ", ".join((*MEASURES, TIME, UNSURE))
            raise PomologError(f"{path}: no measure {name!r}; there are {known}")
        if not isinstance(limits, Mapping):
            raise PomologError(f"{path}: {name} must be a table: [{name}], then min, max, ...")
        kinds = LIMITS if name == TIME else (*RULES, MATTERS)
        for kind, limit in limits.items():
            if kind not in kinds:
                raise PomologError(f"{path}: [{name}] has no {kind!r}; it has {', '.join(kinds)}")
            yield Rule(
                name, kind, _number(f"{path}: [{name}] {kind} = {limit!r}", name, kind, limit)
            )


def _number(said: str, name: str, kind: str, limit: Any) -> float:
    number = isinstance(limit, int | float) and not isinstance(limit, bool)
    if not number or not abs(limit) < LARGEST:
        raise PomologError(f"{said} is no number to work with; give a finite one")
    if kind == "not_worse_by" and limit < 0:
        raise PomologError(f"{said} is negative; give 0 or more")
    if kind == MATTERS and limit <= 0:
        raise PomologError(f"{said} must be more than 0: no data could show less")
    if name in MEASURES and MEASURES[name].is_rate and not 0 <= limit <= 1:
        raise PomologError(f"{said} is no share; 85 % is written 0.85")
    return float(limit)


def check(gate: Gate, comparison: Comparison) -> list[Checked]:
    """Hold every rule against what was found."""
    judged = {one.measure.name: one for one in comparison.judged}
    return [_check(rule, gate, judged.get(rule.measure), comparison) for rule in gate.rules]


def _check(rule: Rule, gate: Gate, judged: Judged | None, comparison: Comparison) -> Checked:
    if rule.measure == TIME:
        return _limit(rule, comparison.time_ms[1], None)
    measure = MEASURES[rule.measure]
    if judged is None or judged.difference is None:
        have = "no truth says it" if judged else "it is only judged where there is no truth"
        if judged is None and measure.better != "unknown":
            have = "the sessions have no truth"
        line = f"{rule.measure} is not scored: {have}"
        return Checked(rule, gate.pass_when_unsure, True, line)
    if rule.kind in ("min", "max"):
        return _limit(rule, judged.difference.b * measure.written, measure)
    return _not_worse(rule, gate, judged, comparison)


def _limit(rule: Rule, value: float, measure: Measure | None) -> Checked:
    size = abs(value) if measure and measure.better == "nearer zero" else value
    passed = size >= rule.limit if rule.kind == "min" else size <= rule.limit
    digits, unit = _form(measure)
    limit = f"{rule.limit:g}{unit}"
    asked = f"at least {limit} is asked" if rule.kind == "min" else f"at most {limit} is allowed"
    line = f"{rule.measure} = {value:.{digits}f}{unit}; {asked}"
    return Checked(rule, passed, False, line)


def _form(measure: Measure | None) -> tuple[int, str]:
    """Digits after the point, and the unit, of what a gate writes."""
    if measure is None:
        return 1, " ms"
    return (4, "") if measure.is_rate else (measure.digits, f" {measure.unit}")


def _not_worse(rule: Rule, gate: Gate, judged: Judged, comparison: Comparison) -> Checked:
    """Non-inferiority: the one-sided 95 % limit of how much worse B may be is within the limit."""
    found, measure = judged.difference, judged.measure
    assert found is not None
    digits, unit = _form(measure)
    low, high = (end * measure.written for end in found.worsening90)
    worse = found.worsening * measure.written
    word = "changed" if measure.better == "unknown" else "worse" if worse > 0 else "better"
    line = f"{rule.measure} is {word} by {abs(worse):.{digits}f}{unit}"
    allowed = f"{rule.limit:g}{unit} is allowed"
    if found.identical:
        return Checked(rule, True, False, f"{rule.measure} is the same in every picture")
    if high <= rule.limit:
        most = f"worse by {max(high, 0):.{digits}f} at most"
        return Checked(rule, True, False, f"{line} ({most}); {allowed}")
    if low > rule.limit:
        return Checked(rule, False, False, f"{line} (by {low:.{digits}f} at least); {allowed}")
    may = f"may be worse by {high:.{digits}f}" if math.isfinite(high) else "may be worse"
    line = f"{line}, but {may}; {allowed}: too little data to say"
    if found.std and rule.limit:
        needed = units_needed(found.std, rule.limit / measure.written)
        line += f", {unit_words(comparison.unit, needed)} would do"
    return Checked(rule, gate.pass_when_unsure, True, line)


def unit_words(unit: str, count: int) -> str:
    """So many pairs, or sessions."""
    return f"about {count:,} {unit}{'' if count == 1 else 's'}"
