"""The verdicts: what is shown, what is shown to be alike, and what the data cannot say."""

from dataclasses import replace

import numpy as np
import pytest
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.weightstats import ttost_paired

from processor.compare.judge import LEAST_UNITS, Judged, judge
from processor.measures import MEASURES, Measure
from processor.paired import Difference, differences

RECALL = MEASURES["fruit_recall"]  # half a point matters
BIAS = MEASURES["distance_bias_mm"]
A_PAIR = MEASURES["located_per_pair"]


def difference(
    change: float, half: float, p: float, units: int = 50, *, worse: float | None = None
) -> Difference:
    """A change with an interval of `half` on either side; the 90 % one is narrower."""
    worsening = -change if worse is None else worse
    return Difference(
        a=0.8,
        b=0.8 + change,
        units=units,
        change=change,
        interval95=(change - half, change + half),
        interval90=(change - 0.84 * half, change + 0.84 * half),
        worsening=worsening,
        worsening95=(worsening - half, worsening + half),
        worsening90=(worsening - 0.84 * half, worsening + 0.84 * half),
        std=half,
        p=p,
    )


def judged(found: Difference | None, measure: Measure = RECALL) -> Judged:
    return judge([measure], {measure.name: found}, {})[0]


def test_a_change_that_is_shown_is_better_or_worse_by_its_direction() -> None:
    assert judged(difference(0.03, 0.01, 0.001)).verdict == "better"
    assert judged(difference(-0.03, 0.01, 0.001)).verdict == "worse"


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_change_that_is_shown_says_whether_it_matters(sign: int) -> None:
    assert judged(difference(sign * 0.03, 0.01, 0.001)).size == "more than matters"
    assert judged(difference(sign * 0.003, 0.001, 0.001)).size == "less than matters"
    assert judged(difference(sign * 0.005, 0.003, 0.001)).size == ""


def test_no_difference_needs_an_interval_within_what_matters() -> None:
    assert judged(difference(0.001, 0.003, 0.6)).verdict == "no difference shown"
    unsure = judged(difference(0.001, 0.02, 0.6))
    assert unsure.verdict == "too little data"
    assert unsure.units_needed is not None
    assert unsure.units_needed > 50


def test_a_handful_of_pictures_is_too_little_whatever_they_say() -> None:
    few = judged(difference(0.3, 0.01, 1e-6, units=LEAST_UNITS - 1))
    assert (few.verdict, few.p_holm) == ("too little data", None)
    assert judged(difference(0.3, 0.01, 1e-6, units=LEAST_UNITS)).verdict == "better"


def test_what_was_not_counted_is_not_scored() -> None:
    assert judged(None).verdict == "not scored"


def test_without_truth_a_change_only_differs() -> None:
    assert judged(difference(3.0, 1.0, 0.001, worse=3.0), A_PAIR).verdict == "differs"


def test_a_bias_is_worse_only_where_it_is_further_from_zero() -> None:
    across = difference(0.002, 0.0003, 1e-6, worse=0.0001)
    assert judged(across, BIAS).verdict == "differs"
    assert judged(replace(across, worsening95=(0.001, 0.002)), BIAS).verdict == "worse"
    assert judged(replace(across, worsening95=(-0.002, -0.001)), BIAS).verdict == "better"


def test_p_values_are_corrected_by_holm_for_all_measures_together() -> None:
    p_values = {"fruit_recall": 0.03, "fruit_precision": 0.004, "fruit_f1": 0.2}
    measures = [MEASURES[name] for name in p_values]
    found = {name: difference(-0.03, 0.02, p) for name, p in p_values.items()}
    ours = judge(measures, found, {})
    theirs = multipletests(list(p_values.values()), method="holm")[1]
    assert [one.p_holm for one in ours] == pytest.approx(list(theirs))
    assert [one.verdict for one in ours] == ["too little data", "worse", "too little data"]


def test_a_difference_of_interest_can_be_another() -> None:
    found = {RECALL.name: difference(0.001, 0.008, 0.6)}
    assert judge([RECALL], found, {})[0].verdict == "too little data"
    assert judge([RECALL], found, {RECALL.name: 0.02})[0].verdict == "no difference shown"


@pytest.mark.parametrize("spread", [0.1, 0.2, 0.7, 1.0])
def test_no_difference_is_said_where_statsmodels_two_one_sided_tests_say_it(spread: float) -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(0, spread, 60)
    a, b = np.full(60, 10.0), 10.0 + noise - noise.mean()
    ours, theirs = ({"located": side, "pairs": np.ones(60)} for side in (a, b))
    found = differences([A_PAIR], ours, theirs, np.arange(60), rng)
    p = ttost_paired(b, a, -A_PAIR.matters, A_PAIR.matters)[0]
    alike = judge([A_PAIR], found, {})[0].verdict == "no difference shown"
    assert alike == (p < 0.05)
    assert not 0.03 < p < 0.08, "too near the limit for a bootstrap to agree"
