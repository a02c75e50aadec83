"""Rates and intervals by hand; what nobody knows is None and never 0."""

from statistics import NormalDist

import pytest

from processor.score import (
    Detection,
    FrameRow,
    FruitRow,
    detection,
    errors,
    matches,
    score,
    wilson95,
)
from processor.sureness import Judged


def frame(
    pixels: tuple[int, int | None, int] | None = None,
    fruit: tuple[int, int | None, int] | None = None,
    ms: float = 1.0,
) -> FrameRow:
    return FrameRow(pixels, pixels, fruit, {"match": round(ms * 1e6)})


# the paper's Table 1: hits, false positives and false negatives of each lighting, in percent
TABLE_1 = {
    "front": ((925, 53, 22), (94.6, 97.7, 96.1)),
    "back": ((895, 67, 38), (93.0, 95.9, 94.5)),
    "cloudy": ((979, 12, 9), (98.8, 99.1, 98.9)),
}


@pytest.mark.parametrize("lighting", TABLE_1)
def test_the_rows_of_table_1_share_one_denominator(lighting: str) -> None:
    (tp, fp, fn), implied = TABLE_1[lighting]
    assert tp + fp + fn == 1000
    found = detection([(tp, fp, fn)])
    assert found is not None
    assert (found.hit, found.false_positive, found.false_negative) == (
        tp / 1000, fp / 1000, fn / 1000,
    )  # fmt: skip
    assert found.iou == found.hit
    measured = (found.precision, found.recall, found.f1)
    # the precision, recall and F1 that the row implies, to its own decimal
    assert [round(100 * (m or 0), 1) for m in measured] == list(implied)


def test_rates_come_from_summed_counts_and_are_never_averaged() -> None:
    found = detection([(1, 0, 0), (1, 1, 7)])
    assert found is not None
    assert (found.tp, found.fp, found.fn) == (2, 1, 7)
    assert found.hit == 2 / 10
    assert found.precision == 2 / 3
    assert found.recall == 2 / 9
    assert found.f1 == 4 / 12


def test_nothing_counted_is_none() -> None:
    assert detection([]) is None
    assert matches([]) is None
    assert errors([]) is None
    assert wilson95(0, 0) is None


def test_false_positives_that_one_frame_does_not_know_are_unknown_for_all() -> None:
    found = detection([(3, None, 1), (2, 5, 0)])
    assert found == Detection(5, None, 1, None, None, None, None, 5 / 6, None, None)


def test_a_rate_without_a_denominator_is_none() -> None:
    assert detection([(0, 0, 0)]) == Detection(0, 0, 0, *[None] * 7)
    missed = detection([(0, 0, 4)])
    assert missed is not None
    assert missed.recall == 0.0  # four were asked for: this is a measured nothing
    assert missed.precision is None


def wilson_by_hand(successes: int, trials: int) -> tuple[float, float]:
    z = NormalDist().inv_cdf(0.975)
    p = successes / trials
    middle = p + z * z / (2 * trials)
    half = z * ((p * (1 - p) + z * z / (4 * trials)) / trials) ** 0.5
    return (middle - half) / (1 + z * z / trials), (middle + half) / (1 + z * z / trials)


def test_the_papers_308_of_323_are_925_to_972_per_mille() -> None:
    found = matches(["right"] * 308 + ["wrong"] * 15)
    assert found is not None
    assert found.rate == pytest.approx(308 / 323)
    assert found.wilson95 is not None
    assert [round(100 * end, 1) for end in found.wilson95] == [92.5, 97.2]


@pytest.mark.parametrize(("successes", "trials"), [(0, 1), (1, 1), (3, 10), (308, 323)])
def test_the_interval_is_wilsons(successes: int, trials: int) -> None:
    assert wilson95(successes, trials) == pytest.approx(wilson_by_hand(successes, trials))


def test_the_match_rate_leaves_the_missed_out_and_found_does_not() -> None:
    found = matches(["right", "right", "right", "wrong", "missed", "missed"])
    assert found is not None
    assert (found.right, found.wrong, found.missed) == (3, 1, 2)
    assert found.rate == 3 / 4
    assert found.found == 3 / 6


def test_nothing_but_missed_has_no_rate() -> None:
    found = matches(["missed"])
    assert found is not None
    assert found.rate is None
    assert found.wilson95 is None
    assert found.found == 0.0


def test_errors_by_hand() -> None:
    found = errors([0.003, -0.004, 0.0, 0.005])
    assert found is not None
    assert found.n == 4
    assert found.bias == pytest.approx(0.001)
    assert found.rmse == pytest.approx((0.00005 / 4) ** 0.5)
    assert found.max == pytest.approx(0.005)
    assert found.p95 == pytest.approx(0.004 + 0.85 * 0.001)  # between the two largest sizes


def test_a_group_is_scored_by_what_its_frames_know() -> None:
    found = score(
        [frame(pixels=(8, 1, 1), ms=1), frame(fruit=(2, 0, 1), ms=3), frame(ms=9)],
        [
            FruitRow(0.5, 0.95, "right", 0.002),
            FruitRow(1.2, 0.6, "wrong", None),
            FruitRow(0.9, 0.3, None, -0.004),
        ],
    )
    assert found.frames == 3
    assert found.pixels is not None
    assert found.pixels.hit == 0.8
    assert found.fruit is not None
    assert found.fruit.recall == 2 / 3
    assert found.matches is not None
    assert (found.matches.right, found.matches.wrong) == (1, 1)
    assert found.distance_m is not None
    assert found.distance_m.n == 2
    assert found.time_ms == {"match": 3.0}  # the median


def test_errors_are_told_by_visibility_and_by_range() -> None:
    fruit = [
        FruitRow(0.39, 0.1, None, 0.001),
        FruitRow(0.4, 0.5, None, 0.002),
        FruitRow(1.5, 0.9, None, 0.003),
        FruitRow(1.49, 1.0, None, 0.004),
        FruitRow(1.0, None, None, 0.005),  # nobody said how visible
    ]
    found = score([], fruit)
    by_visibility = {k: e and e.bias for k, e in found.distance_m_by_visibility.items()}
    assert by_visibility == pytest.approx({"10-50%": 0.001, "50-90%": 0.002, "90-100%": 0.0035})
    by_range = {k: e and e.n for k, e in found.distance_m_by_range.items()}
    assert by_range == {
        "below 0.4 m": 1, "0.4-0.7 m": 1, "0.7-1.0 m": None, "1.0-1.5 m": 2, "above 1.5 m": 1,
    }  # fmt: skip


def test_fruit_is_found_by_what_each_view_sees_of_it_and_false_ones_count_in_every_class() -> None:
    fruit = [
        FruitRow(1.0, 0.1, None, None, None, ((0.1, True), (0.49, False))),
        FruitRow(1.0, 0.09, None, None, None, ((0.09, True), (0.5, True))),
        FruitRow(1.0, None, None, None, None, ((1.0, False), (None, True))),
    ]
    found = score([frame(fruit=(2, 3, 1)), frame(), frame(fruit=(0, 1, 0))], fruit)
    counts = {k: d and (d.tp, d.fp, d.fn) for k, d in found.fruit_by_visibility.items()}
    assert counts == {"10-50%": (1, 4, 1), "50-100%": (1, 4, 1)}


def test_fruit_by_visibility_is_known_as_far_as_its_frames_and_views_are() -> None:
    seen = [FruitRow(1.0, 1.0, None, None, None, ((1.0, True), (0.9, True)))]
    partial = score([frame(fruit=(1, 2, 0)), frame(fruit=(1, None, 0))], seen)
    clearly = partial.fruit_by_visibility["50-100%"]
    assert clearly is not None
    assert (clearly.tp, clearly.fp, clearly.fn) == (2, None, 0)
    assert partial.fruit_by_visibility["10-50%"] is None  # nobody is half hidden
    assert set(score([frame()], seen).fruit_by_visibility.values()) == {None}  # not counted
    assert set(score([frame(fruit=(1, 0, 0))], []).fruit_by_visibility.values()) == {None}


def test_an_interval_covers_errors_of_either_sign_up_to_196_standard_deviations() -> None:
    fruit = [
        FruitRow(1.0, 1.0, None, 0.0195, 0.01),
        FruitRow(1.0, 1.0, None, -0.0195, 0.01),
        FruitRow(1.0, 1.0, None, -0.0197, 0.01),
        FruitRow(1.0, 0.6, None, 1.96 * 0.5, 0.5),  # at its very end
        FruitRow(1.0, 0.6, None, 0.001, None),  # no interval was given
    ]
    found = score([], fruit)
    assert found.covered95 == {
        "all": 0.75, "10-50%": None, "50-90%": 1.0, "90-100%": pytest.approx(2 / 3),
    }  # fmt: skip


def test_recall_by_confidence_is_of_all_that_should_be_found() -> None:
    frames = [frame(fruit=(2, 1, 3)), frame()]
    fruit = [FruitRow(1.0, 1.0, "right", None), FruitRow(1.0, 1.0, "missed", None),
             FruitRow(1.0, 0.2, None, None)]  # fmt: skip
    sure = {"fruit": [Judged(0.9, True)] * 2, "matches": [Judged(0.9, True)]}
    curves = score(frames, fruit, sure).by_confidence
    assert {what: one and one.wanted for what, one in curves.items()} == {"fruit": 5, "matches": 2}
    assert score([frame()], [], sure).by_confidence == {"fruit": None, "matches": None}


def test_a_session_without_truth_is_not_scored() -> None:
    found = score([frame(), frame()], [])
    assert found.frames == 2
    nothing = (found.pixels, found.pixels_cleaned, found.fruit, found.matches, found.distance_m)
    assert nothing == (None,) * 5
    assert set(found.distance_m_by_range.values()) == {None}


def test_no_frames_at_all_are_a_score_of_nothing() -> None:
    found = score([], [])
    assert (found.frames, found.time_ms, found.pixels) == (0, {}, None)
