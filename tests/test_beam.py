"""The rangefinder as truth: whose reading it is, and what the located apple predicts."""

import numpy as np
import pytest

from processor.beam import compare, front_range_m
from processor.trace import Apple
from recorder.records import RangeReading

ORIGIN = np.array([0.1, 0.0, 0.0])
AHEAD = np.array([0.0, 0.0, 1.0])
BEAM = (ORIGIN, AHEAD)


def apple(x_m: float, z_m: float, y_m: float = 0.0) -> Apple:
    return Apple(0, 0, 200.0, (x_m, y_m, z_m), 0.04, z_m - 0.04)


def reading(range_m: float | None, named: int | None = None) -> RangeReading:
    return RangeReading(0, range_m, 0.001, "ok", "", named)


def test_a_beam_through_the_centre_meets_the_front_one_radius_before_it() -> None:
    assert front_range_m(ORIGIN, AHEAD, np.array([0.1, 0, 1.0]), 0.04) == pytest.approx(0.96)


def test_a_beam_beside_the_centre_meets_the_sphere_later() -> None:
    front_m = front_range_m(ORIGIN, AHEAD, np.array([0.124, 0.0, 1.0]), 0.04)
    assert front_m == pytest.approx(1.0 - 0.032)  # 24, 32, 40: a right triangle


def test_a_beam_that_passes_or_leaves_the_sphere_behind_meets_nothing() -> None:
    assert front_range_m(ORIGIN, AHEAD, np.array([0.15, 0, 1.0]), 0.04) is None
    assert front_range_m(ORIGIN, AHEAD, np.array([0.1, 0, -1.0]), 0.04) is None


def test_a_slanted_beam_is_measured_along_itself() -> None:
    slanted = np.array([0.6, 0.0, 0.8])
    centre = ORIGIN + slanted * 1.5
    assert front_range_m(ORIGIN, slanted, centre, 0.04) == pytest.approx(1.46)


def test_a_reading_belongs_to_the_first_apple_that_its_beam_meets() -> None:
    apples = [apple(0.5, 0.7), apple(0.1, 1.3), apple(0.1, 0.9)]
    found = compare(reading(0.865), BEAM, apples)
    assert (found.belongs, found.apple) == ("met", 2)
    assert found.error_m == pytest.approx(-0.005)


def test_the_operators_word_comes_before_the_beam() -> None:
    apples = [apple(0.1, 1.3), apple(0.1, 0.9)]
    found = compare(reading(1.25, named=7), BEAM, apples, named=0)
    assert (found.belongs, found.apple) == ("named", 0)
    assert found.error_m == pytest.approx(0.01)


def test_a_named_apple_that_was_not_located_is_said_and_no_other_takes_its_place() -> None:
    found = compare(reading(0.86, named=7), BEAM, [apple(0.1, 0.9)])
    assert (found.belongs, found.apple, found.error_m) == ("named apple not located", None, None)


def test_a_beam_that_just_misses_a_named_apple_meets_it_at_its_rim() -> None:
    found = compare(reading(0.9, named=1), BEAM, [apple(0.145, 0.9)], named=0)
    assert found.error_m == pytest.approx(0.0)
    assert found.beside_m == pytest.approx(0.045)


def test_a_reading_that_meets_no_located_apple_is_counted_as_such() -> None:
    lone = Apple(0, None)
    found = compare(reading(2.0), BEAM, [lone, apple(0.5, 0.9)])
    assert (found.belongs, found.reading_m, found.error_m) == ("no located apple", 2.0, None)


def test_no_echo_is_no_distance() -> None:
    assert compare(reading(None), BEAM, [apple(0.1, 0.9)]).belongs == "no echo"
