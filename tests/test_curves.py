"""Curves and intervals: precision-recall, calibration, intervals by drawing pairs again."""

import numpy as np
import pytest

from processor.curves import (
    DRAWS,
    coverage,
    f1_of,
    precision_recall,
    reliability,
    resampled95,
    rms_of,
)


def test_precision_and_recall_fall_and_rise_as_the_threshold_falls() -> None:
    curve = precision_recall(
        np.array([0.6, 0.9, 0.8, 0.7]), np.array([False, True, True, True]), wanted=4
    )
    assert curve is not None
    assert curve.confidence.tolist() == [0.9, 0.8, 0.7, 0.6]
    assert curve.precision.tolist() == [1.0, 1.0, 1.0, 0.75]
    assert curve.recall.tolist() == [0.25, 0.5, 0.75, 0.75]
    assert curve.average == pytest.approx(0.75)


def test_a_report_and_a_score_mean_the_same_by_average_precision() -> None:
    said, right = np.array([0.9, 0.8, 0.7, 0.6]), np.array([True, False, False, True])
    curve = precision_recall(said, right, wanted=2)
    assert curve is not None
    assert curve.precision.tolist() == pytest.approx([1, 1 / 2, 1 / 3, 1 / 2])
    assert curve.average == pytest.approx((1 + 1 / 2) / 2)
    rising = precision_recall(said, ~right, wanted=2)  # a lower threshold is more precise
    assert rising is not None
    assert rising.average == pytest.approx(2 / 3)


def test_circles_of_one_confidence_stand_or_fall_together() -> None:
    curve = precision_recall(np.array([0.5, 0.5, 0.5]), np.array([True, False, False]), wanted=1)
    assert curve is not None
    assert (curve.precision.tolist(), curve.recall.tolist()) == ([pytest.approx(1 / 3)], [1.0])


def test_without_circles_or_fruit_there_is_no_curve() -> None:
    nothing = np.empty(0)
    assert precision_recall(nothing, nothing.astype(bool), wanted=3) is None
    assert precision_recall(np.array([0.5]), np.array([False]), wanted=0) is None


def test_honest_intervals_cover_what_they_say() -> None:
    generator = np.random.default_rng(1)
    std_m = generator.uniform(0.001, 0.02, 20_000)
    for share in coverage(generator.normal(0, std_m), std_m):
        assert share.observed == pytest.approx(share.at, abs=0.012)
        assert share.interval[0] < share.observed < share.interval[1]


def test_intervals_half_as_wide_as_they_should_be_are_seen() -> None:
    generator = np.random.default_rng(1)
    said = {s.at: s.observed for s in coverage(generator.normal(0, 2, 5000), np.ones(5000))}
    assert said[0.95] < 0.72
    assert coverage(np.empty(0), np.empty(0)) == ()


def test_confidence_is_binned_and_held_against_what_was_right() -> None:
    shares = reliability(np.array([0.05, 0.92, 0.98, 1.0]), np.array([False, True, False, True]))
    assert [(s.hits, s.n) for s in shares] == [(0, 1), (2, 3)]
    assert shares[1].at == pytest.approx((0.92 + 0.98 + 1.0) / 3)


def test_pairs_that_agree_give_a_narrow_interval_and_pairs_that_differ_a_wide_one() -> None:
    alike = resampled95([(9, 1, 1)] * 20, f1_of)
    assert alike is not None
    assert list(alike) == pytest.approx([0.9, 0.9])
    mixed = resampled95([(10, 0, 0), (1, 9, 9)] * 10, f1_of)
    assert mixed is not None
    assert mixed[0] < 0.45
    assert mixed[1] > 0.65


def test_an_interval_covers_the_true_value_about_as_often_as_it_says() -> None:
    generator = np.random.default_rng(3)
    held = 0
    for _ in range(60):
        errors = generator.normal(0, 1, (40, 5))
        sums = np.column_stack([(errors**2).sum(axis=1), np.full(40, 5)])
        interval = resampled95(sums, rms_of)
        assert interval is not None
        held += interval[0] <= 1 <= interval[1]
    assert held >= 50  # of 60: 57 are expected, and fewer than 50 are not seen once in 1000


def test_too_few_pairs_give_no_interval_and_empty_ones_do_not_count() -> None:
    assert resampled95([(1, 1)] * 4, rms_of) is None
    assert resampled95([(1, 1)] * 4 + [(0, 0)] * 9, rms_of) is None
    assert resampled95(np.empty((0, 2)), rms_of) is None
    assert DRAWS % 50 == 0
