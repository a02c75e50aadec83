"""Precision and recall by confidence, by hand."""

import pytest

from processor.sureness import Curve, Judged, curve


def of(*found: tuple[float, bool], wanted: int) -> Curve:
    return curve([Judged(*one) for one in found], wanted)


def test_a_perfect_order_has_an_average_precision_of_what_it_finds() -> None:
    found = of((0.9, True), (0.8, True), (0.3, False), wanted=4)
    assert found.average_precision == pytest.approx(2 / 4)


def test_a_mistake_before_a_hit_costs_the_hits_after_it() -> None:
    # recall 1/2 at precision 1, recall 1 at precision 2/3
    found = of((0.9, True), (0.8, False), (0.7, True), wanted=2)
    assert found.average_precision == pytest.approx(1 / 2 * 1 + 1 / 2 * 2 / 3)


def test_a_recall_has_the_best_precision_that_still_reaches_it() -> None:
    # the first find is wrong, so precision rises to 2/3 where both are found
    found = of((0.9, False), (0.8, True), (0.7, True), wanted=2)
    assert found.average_precision == pytest.approx(2 / 3)


def test_a_find_just_as_sure_as_asked_is_taken() -> None:
    found = of((0.5, True), (0.4999, False), wanted=1)
    rates = {o.confidence: (o.n, o.precision) for o in found.operations}
    assert rates[0.5] == (1, 1.0)


def test_finds_of_one_confidence_count_together_in_whatever_order() -> None:
    one = of((0.5, True), (0.5, False), wanted=1)
    assert one.average_precision == pytest.approx(1 / 2)
    assert one == of((0.5, False), (0.5, True), wanted=1)


def test_who_asks_for_the_sure_gets_fewer_and_better() -> None:
    found = of((0.96, True), (0.91, True), (0.55, False), (0.2, True), wanted=5)
    rates = {o.confidence: (o.n, o.precision, o.recall) for o in found.operations}
    assert rates[0.0] == (4, 3 / 4, 3 / 5)
    assert rates[0.5] == (3, 2 / 3, 2 / 5)
    assert rates[0.95] == (1, 1.0, 1 / 5)
    assert rates[0.99] == (0, None, 0.0)


def test_honest_confidences_have_no_calibration_error() -> None:
    honest = of(*[(0.75, True)] * 3, (0.75, False), wanted=4)
    assert honest.calibration_error == pytest.approx(0.0)
    boasting = of(*[(1.0, True)] * 3, (1.0, False), wanted=4)
    assert boasting.calibration_error == pytest.approx(0.25)
    assert boasting.reliability[-1].n == 4  # certainty is in the last bin


def test_nothing_found_is_not_nothing_wanted() -> None:
    assert of(wanted=3).average_precision == 0.0
    assert of(wanted=0).average_precision is None
    assert of(wanted=0).operations[0].recall is None
