"""The statistics of the paper's tables, held against scipy, statsmodels and printed tables."""

import math

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.power import TTestIndPower, TTestPower
from statsmodels.stats.proportion import proportion_confint
from statsmodels.stats.weightstats import ttost_ind, ttost_paired

from processor.experiments.comparisons import MARGIN_MM, compared, papers_own, table_2
from processor.experiments.distances import METHODS
from processor.experiments.work import Row
from processor.score import wilson95
from processor.statistics import (
    bootstrap_shares,
    detectable_effect,
    equivalence_p,
    holm,
    paired,
    t_table,
    unpaired,
)

CLEAR = [3.1, -2.4, 5.0, 7.7, 1.2, 4.9, 9.3, 6.1, 8.8, 12.0, 10.4, 13.9]
LEAVES = [6.0, 1.1, 9.2, 8.1, 4.4, 9.9, 15.0, 9.3, 16.1, 14.2, 18.8, 19.7]


def test_the_papers_308_of_323_have_a_wilson_interval_of_92_5_to_97_2_percent() -> None:
    interval = wilson95(308, 323)
    assert interval is not None
    assert [round(100 * end, 1) for end in interval] == [92.5, 97.2]
    assert interval == pytest.approx(proportion_confint(308, 323, method="wilson"))


def test_the_t_table_is_the_papers_2_07_at_22_and_2_20_at_11_degrees_of_freedom() -> None:
    assert round(t_table(22), 2) == 2.07
    assert round(t_table(11), 2) == 2.20


def test_unpaired_is_students_test_of_12_and_12_with_22_degrees_of_freedom() -> None:
    ours, theirs = unpaired(CLEAR, LEAVES), stats.ttest_ind(CLEAR, LEAVES)
    assert ours is not None
    assert (ours.t, ours.p, ours.df) == pytest.approx((theirs.statistic, theirs.pvalue, 22))
    interval = theirs.confidence_interval(0.95)
    assert (ours.low, ours.high) == pytest.approx((interval.low, interval.high))


def test_paired_is_the_test_of_the_differences_with_11_degrees_of_freedom() -> None:
    ours, theirs = paired(CLEAR, LEAVES), stats.ttest_rel(CLEAR, LEAVES)
    assert ours is not None
    assert (ours.t, ours.p, ours.df) == pytest.approx((theirs.statistic, theirs.pvalue, 11))
    interval = theirs.confidence_interval(0.95)
    assert (ours.low, ours.high) == pytest.approx((interval.low, interval.high))


def test_a_difference_hidden_by_range_is_significant_when_the_ranges_are_paired() -> None:
    apart, together = unpaired(CLEAR, LEAVES), paired(CLEAR, LEAVES)
    assert apart is not None
    assert together is not None
    assert not apart.p < 0.01
    assert together.p < 0.001


def test_effect_sizes_are_cohens_d_and_d_z_with_hedges_correction() -> None:
    apart, together = unpaired(CLEAR, LEAVES), paired(CLEAR, LEAVES)
    assert apart is not None
    assert together is not None
    pooled = math.sqrt((np.var(CLEAR, ddof=1) + np.var(LEAVES, ddof=1)) / 2)
    assert apart.effect == pytest.approx((np.mean(CLEAR) - np.mean(LEAVES)) / pooled)
    differences = np.subtract(CLEAR, LEAVES)
    assert together.effect == pytest.approx(differences.mean() / differences.std(ddof=1))
    assert apart.effect_unbiased == pytest.approx(apart.effect * (1 - 3 / 87))


@pytest.mark.parametrize("margin", [2.0, 5.0, 10.0])
def test_equivalence_is_statsmodels_tost(margin: float) -> None:
    apart, together = unpaired(CLEAR, LEAVES), paired(CLEAR, LEAVES)
    assert apart is not None
    assert together is not None
    theirs = ttost_ind(np.array(CLEAR), np.array(LEAVES), -margin, margin)[0]
    assert equivalence_p(apart, margin) == pytest.approx(theirs)
    theirs = ttost_paired(np.array(CLEAR), np.array(LEAVES), -margin, margin)[0]
    assert equivalence_p(together, margin) == pytest.approx(theirs)


def test_equal_means_are_equivalent_though_their_t_is_0() -> None:
    test = paired([1.0, 2.0, 3.0, 4.0], [2.0, 1.0, 4.0, 3.0])
    assert test is not None
    assert test.t == 0
    assert equivalence_p(test, 10.0) < 0.05 < equivalence_p(test, 0.1)


def test_holm_is_statsmodels_holm() -> None:
    for p_values in ([0.01, 0.04, 0.03, 0.005], [0.906, 0.399, 0.0038, 0.323], [0.2], []):
        theirs = multipletests(p_values, method="holm")[1] if p_values else []
        assert holm(p_values) == pytest.approx(list(theirs))


def test_the_detectable_effect_has_the_power_that_statsmodels_gives_it() -> None:
    power = TTestIndPower().power(detectable_effect(12), 12, 0.05)
    assert power == pytest.approx(0.8, abs=1e-4)
    power = TTestPower().power(detectable_effect(12, pairs=True), 12, 0.05)
    assert power == pytest.approx(0.8, abs=1e-4)


def test_the_papers_own_table_keeps_its_one_significant_pair_after_holm() -> None:
    rows = papers_own()
    significant = [row["pair"] for row in rows if float(str(row["p_holm"])) < 0.05]
    assert significant == ["indoor no occlusion / indoor with occlusion"]
    assert [round(float(str(row["p"])), 3) for row in rows] == [0.906, 0.399, 0.004, 0.323]


def test_values_without_spread_and_single_values_have_no_test() -> None:
    assert unpaired([1.0], [2.0, 3.0]) is None
    assert paired([1.0, 2.0], [2.0, 3.0]) is None
    assert paired([], []) is None


def test_table_2_pairs_only_ranges_that_both_conditions_have() -> None:
    ranges = range(400, 1600, 100)
    clear = dict(zip(ranges, CLEAR, strict=True))
    leaves = dict(zip(ranges, LEAVES, strict=True))
    del leaves[400]
    row = compared({"indoor no occlusion": clear, "indoor with occlusion": leaves})[2]
    assert (row["n_first"], row["n_second"], row["n_paired"]) == (12, 11, 11)
    expected = stats.ttest_rel(CLEAR[1:], LEAVES[1:])
    assert row["t_paired"] == pytest.approx(expected.statistic)
    both = np.array(CLEAR[1:]), np.array(LEAVES[1:])
    theirs = ttost_paired(*both, -MARGIN_MM, MARGIN_MM)[0]
    assert row["p_tost"] == pytest.approx(theirs)


def test_table_2_turns_to_the_exact_place_where_too_few_readings_can_be_compared() -> None:
    def rows(condition: str, read: int) -> list[Row]:
        errors = zip(range(400, 1600, 100), CLEAR, strict=True)
        return [
            {"method": METHODS[1], "scene": f"distance-{condition}", "hung_mm": near,
             "located_mm": error, "error_mm": error if i < read else None}
            for i, (near, error) in enumerate(errors)
        ]  # fmt: skip

    item = table_2([*rows("indoor-clear", 12), *rows("indoor-fruit", 3)], "drawn")
    said = {claim.what: claim for claim in item.claims}
    beside = said["t, indoor no occlusion / indoor adjacent fruits"]
    assert beside.verdict == "holds"
    assert beside.ours == pytest.approx(0)
    assert "exact place, n = 12 and 12" in str(beside.sentence)
    light = said["t, indoor no occlusion / outdoor front lighting"]
    assert light.verdict == "not scored"


def test_a_condition_without_measurements_leaves_its_comparisons_unscored() -> None:
    rows = compared({"indoor no occlusion": {400: 1.0, 500: 2.0}})
    assert [(row["t"], row["p_holm"]) for row in rows] == [(None, None)] * 4


def test_the_bootstrap_is_of_sums_and_covers_the_share() -> None:
    rng = np.random.default_rng(1)
    wholes = rng.integers(500, 1500, 60)
    parts = rng.binomial(wholes, 0.7)
    interval = bootstrap_shares(parts, wholes, np.random.default_rng(2))
    assert interval is not None
    low, high = interval
    share = parts.sum() / wholes.sum()
    assert low < share < high
    error = np.sqrt(((parts - share * wholes) ** 2).sum()) / wholes.sum()
    assert high - low == pytest.approx(2 * 1.96 * error, rel=0.15)


def test_one_pair_has_no_bootstrap_interval() -> None:
    assert bootstrap_shares([3], [4], np.random.default_rng(0)) is None
