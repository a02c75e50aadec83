"""A verdict per measure: better, worse, no difference shown, or too little data.

A change is *shown* where the paired t-test over pictures says so, corrected by Holm for all the
measures that are judged together. Where it is not, "no difference shown" needs proof too: two
one-sided tests (the 90 % interval) that the change is smaller than what matters. Without either,
the data are too few to say, and how many would do is estimated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from processor.measures import Measure
from processor.paired import Difference, units_needed
from processor.statistics import LEVEL, holm

Verdict = Literal[
    "better", "worse", "differs", "no difference shown", "too little data", "not scored"
]
Size = Literal["", "more than matters", "less than matters"]

LEAST_UNITS: Final = 6  # with fewer, a t-test leans on a normal spread that nobody can see


@dataclass(frozen=True, slots=True)
class Judged:
    """One measure, judged.

    Attributes:
        measure: which.
        matters: the smallest difference of interest, in the measure's own unit.
        difference: both sides; None where nothing could be scored.
        p_holm: the corrected p-value; None where there was no test.
        verdict: of B against A.
        size: of a change that is shown, whether all of its interval is beyond what matters or
            within it; empty where it is neither.
        units_needed: about how many units would find a change that matters, four times in five.
        seed_std: how much the seed alone moves one run's value, of A and of B; None with one run.
    """

    measure: Measure
    matters: float
    difference: Difference | None
    p_holm: float | None
    verdict: Verdict
    size: Size = ""
    units_needed: int | None = None
    seed_std: tuple[float | None, float | None] = (None, None)


def judge(
    measures: Sequence[Measure],
    found: Mapping[str, Difference | None],
    matters: Mapping[str, float],
) -> list[Judged]:
    """Judge measures together.

    Args:
        measures: which, in their order.
        found: what `differences` found of each.
        matters: smallest differences of interest, where they are not the measures' own.
    """
    p_values = {
        name: difference.p
        for name, difference in found.items()
        if difference and difference.p is not None and difference.units >= LEAST_UNITS
    }
    corrected = dict(zip(p_values, holm(list(p_values.values())), strict=True))
    return [
        _judge(m, found[m.name], corrected.get(m.name), matters.get(m.name, m.matters))
        for m in measures
    ]


def _judge(
    measure: Measure, difference: Difference | None, p_holm: float | None, matters: float
) -> Judged:
    if difference is None:
        return Judged(measure, matters, None, None, "not scored")
    needed = None
    if difference.std is not None:
        needed = max(LEAST_UNITS, units_needed(difference.std, matters))
    if p_holm is None:
        return Judged(measure, matters, difference, None, "too little data", "", needed)
    low, high = difference.interval90
    if p_holm < LEVEL:
        verdict, size = _direction(measure, difference), _size(difference, matters)
        return Judged(measure, matters, difference, p_holm, verdict, size, needed)
    if -matters < low and high < matters:
        return Judged(measure, matters, difference, p_holm, "no difference shown", "", needed)
    return Judged(measure, matters, difference, p_holm, "too little data", "", needed)


def _direction(measure: Measure, difference: Difference) -> Verdict:
    if measure.better == "unknown":
        return "differs"
    if measure.better == "nearer zero":  # from one side of zero to the other is neither
        low, high = difference.worsening95
        return "worse" if low > 0 else "better" if high < 0 else "differs"
    return "worse" if difference.worsening > 0 else "better"


def _size(difference: Difference, matters: float) -> Size:
    low, high = difference.interval95
    if low >= matters or high <= -matters:
        return "more than matters"
    return "less than matters" if -matters < low and high < matters else ""
