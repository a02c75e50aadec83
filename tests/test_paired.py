"""Paired differences, held against scipy and statsmodels, and against answers that are known."""

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.power import TTestPower

from processor.measures import MEASURES, WITH_TRUTH, Measure
from processor.paired import Difference, Floats, differences, seed_std, units_needed

A_PAIR = MEASURES["located_per_pair"]
RECALL = MEASURES["fruit_recall"]
RMSE = MEASURES["distance_rmse_mm"]
BIAS = MEASURES["distance_bias_mm"]


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def compared(
    measure: Measure, a: dict[str, Floats], b: dict[str, Floats], units: Floats | None = None
) -> Difference:
    pictures = len(next(iter(a.values())))
    unit_of = np.arange(pictures) if units is None else units.astype(np.intp)
    found = differences([measure], a, b, unit_of, rng())[measure.name]
    assert found is not None
    return found


def counts(located: Floats) -> dict[str, Floats]:
    return {"located": located, "pairs": np.ones(len(located))}


def found_of(tp: Floats, wanted: Floats) -> dict[str, Floats]:
    return {"fruit_tp": tp, "fruit_fn": wanted - tp}


def test_the_test_of_a_mean_is_scipys_paired_t_test() -> None:
    a, b = rng(1).poisson(20, (2, 30)).astype(float)
    ours, theirs = compared(A_PAIR, counts(a), counts(b)), stats.ttest_rel(b, a)
    assert ours.p == pytest.approx(theirs.pvalue)
    assert ours.change == pytest.approx((b - a).mean())
    assert ours.std == pytest.approx((b - a).std(ddof=1))


def test_the_deviation_of_a_ratio_is_scipys_by_the_delta_method_in_many_pictures() -> None:
    wanted = rng(2).integers(5, 40, 400).astype(float)
    a, b = (rng(seed).binomial(wanted.astype(int), 0.8).astype(float) for seed in (3, 4))
    ours = compared(RECALL, found_of(a, wanted), found_of(b, wanted))
    change = (b - a).sum() / wanted.sum()
    linear = (b - a - change * wanted) / wanted.mean()  # of a ratio estimator (Cochran 1977)
    assert ours.std == pytest.approx(linear.std(ddof=1), rel=0.01)  # jackknife: to order 1 / n


def test_the_interval_is_scipys_bootstrap_where_there_are_many_pictures() -> None:
    errors = rng(5).normal(0.002, 0.01, (2, 300))
    a, b = ({"error2_m2": e**2, "errors": np.ones(300)} for e in errors)

    def change(first: Floats, second: Floats, axis: int = -1) -> Floats:
        return np.asarray(
            np.sqrt((second**2).mean(axis=axis)) - np.sqrt((first**2).mean(axis=axis)), np.float64
        )

    theirs = stats.bootstrap(
        (errors[0], errors[1]), change, paired=True, method="percentile", n_resamples=4000,
        rng=rng(6),
    ).confidence_interval  # fmt: skip
    ours = compared(RMSE, a, b)
    width = theirs.high - theirs.low
    # both draw: 2000 and 4000 draws leave the ends uncertain by some percent of the width
    assert ours.interval95 == pytest.approx((theirs.low, theirs.high), abs=0.1 * width)


def test_few_pictures_widen_the_interval_to_that_of_students_t() -> None:
    a, b = rng(7).normal(10, 1, (2, 8))
    ours, theirs = compared(A_PAIR, counts(a), counts(b)), stats.ttest_rel(b, a)
    low, high = ours.interval95
    t_low, t_high = theirs.confidence_interval(0.95)
    assert high - low == pytest.approx(t_high - t_low, rel=0.15)  # of 2000 draws, in their tails


def test_an_error_that_is_the_same_in_every_picture_is_certain() -> None:
    ours = compared(
        BIAS,
        {"error_m": np.zeros(10), "errors": np.full(10, 5.0)},
        {"error_m": np.full(10, 5 * 0.002), "errors": np.full(10, 5.0)},
    )
    assert ours.change == pytest.approx(0.002)
    assert ours.p == pytest.approx(0, abs=1e-12)
    assert ours.interval95 == pytest.approx((0.002, 0.002))


def test_identical_counts_of_a_dozen_fruit_prove_nothing_and_of_many_do() -> None:
    for fruit, at_most in ((1.0, 0.3), (1000.0, 0.0005)):
        same = found_of(np.full(12, fruit), np.full(12, fruit))
        low, high = compared(RECALL, same, same).interval95
        assert -low == high
        assert 0 < high < at_most
    assert high < RECALL.matters


def test_a_bias_from_one_side_of_zero_to_the_other_is_no_worse() -> None:
    ones = np.full(40, 5.0)
    errors = rng(8).normal(0, 0.0005, 40)
    ours = compared(
        BIAS,
        {"error_m": ones * (errors - 0.001), "errors": ones},
        {"error_m": ones * (errors + 0.001), "errors": ones},
    )
    assert ours.change == pytest.approx(0.002)
    assert ours.p == pytest.approx(0, abs=1e-9)
    low, high = ours.worsening95
    assert low < 0 < high


def test_pictures_that_one_side_did_not_count_add_nothing() -> None:
    a = found_of(np.array([4.0, 3.0, np.nan]), np.full(3, 5.0))
    b = found_of(np.array([5.0, 3.0, 5.0]), np.full(3, 5.0))
    ours = compared(RECALL, a, b)
    assert (ours.a, ours.b, ours.units) == (0.7, 0.8, 2)


def test_sessions_are_drawn_as_wholes() -> None:
    per_session = rng(9).normal(0, 1, 10).repeat(20)
    zero = counts(np.full(200, 10.0))
    shifted = counts(10.0 + per_session)
    by_pair = compared(A_PAIR, zero, shifted)
    by_session = compared(A_PAIR, zero, shifted, np.arange(10).repeat(20).astype(float))
    assert (by_pair.units, by_session.units) == (200, 10)
    assert by_session.change == pytest.approx(by_pair.change)
    wider = np.ptp(by_session.interval95) / np.ptp(by_pair.interval95)
    assert wider > 3  # twenty alike count as one: the root of 20 is 4.5


def test_what_has_nothing_to_divide_by_is_none() -> None:
    nothing = {n: np.zeros(3) for m in WITH_TRUTH for n in m.sums}
    found = differences(WITH_TRUTH, nothing, nothing, np.arange(3), rng())
    assert found == dict.fromkeys(found)


def test_one_picture_has_no_interval_and_no_test() -> None:
    ours = compared(A_PAIR, counts(np.array([3.0])), counts(np.array([5.0])))
    assert ours.p is None
    assert ours.interval95 == (-np.inf, np.inf)


@pytest.mark.parametrize("effect", [0.1, 0.3, 0.8])
def test_the_units_needed_are_those_of_statsmodels(effect: float) -> None:
    theirs = TTestPower().solve_power(effect_size=effect, alpha=0.05, power=0.8)
    assert units_needed(1.0, effect) == pytest.approx(theirs, abs=1.5)


def test_the_seeds_noise_is_that_of_runs_that_could_have_been() -> None:
    pictures = rng(10).normal(20, 5, 100)  # what differs between pictures is not the seed's
    noise = rng(11).normal(0, 1, (4, 100))
    found = seed_std(A_PAIR, [counts(pictures + n) for n in noise], rng())
    assert found == pytest.approx(1 / np.sqrt(100), rel=0.2)  # of 300 degrees of freedom: 4 %
    assert seed_std(A_PAIR, [counts(pictures)], rng()) is None


@pytest.mark.slow
def test_false_alarms_of_a_method_against_itself_are_near_five_in_a_hundred() -> None:
    draw = rng(12)
    alarms = 0
    for _ in range(1000):
        wanted = draw.integers(3, 30, 20)
        a, b = (draw.binomial(wanted, 0.7).astype(float) for _ in range(2))
        found = differences(
            [RECALL], found_of(a, wanted.astype(float)), found_of(b, wanted.astype(float)),
            np.arange(20), draw, draws=10,
        )[RECALL.name]  # fmt: skip
        assert found is not None
        assert found.p is not None
        alarms += found.p < 0.05
    assert 30 <= alarms <= 75  # 50 give or take 7 (SD), and a ratio of few pictures is not normal
