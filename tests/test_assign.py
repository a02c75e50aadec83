"""Matching by assignment, and ranging by outlines, by the model that ships."""

import math

import pytest

from processor.methods import METHODS
from processor.trace import Trace
from recorder.rectify import rectify
from tests.scenes import apple, pair_of, small_rig


def located(*places: tuple[float, float, float]) -> Trace:
    rig = small_rig()
    apples = [apple(n + 1, *place) for n, place in enumerate(places)]
    return METHODS["pomolog"](*pair_of(rig, *apples), rectify(rig))


@pytest.mark.parametrize("place", [(0.03, 0.0, 0.45), (0.05, 0.03, 0.6)])
def test_a_sphere_is_placed_within_its_own_interval(place: tuple[float, float, float]) -> None:
    (one,) = (a for a in located(place).apples if a.centre_m is not None)
    assert one.centre_m is not None
    assert one.range_std_m is not None
    error_m = math.hypot(*one.centre_m) - math.hypot(*place)
    assert abs(error_m) < 0.006
    assert abs(error_m) < 1.96 * one.range_std_m
    assert one.radius_m == pytest.approx(0.04, rel=0.08)
    assert one.covariance_m2 is not None
    assert all(one.covariance_m2[k] > 0 for k in (0, 3, 5))


def test_fruit_at_two_depths_are_matched_each_with_itself() -> None:
    """One shift for the whole picture cannot: the disparities are 53 and 34 px."""
    trace = located((-0.05, 0.0, 0.45), (0.1, 0.02, 0.7))
    depths = sorted(a.centre_m[2] for a in trace.apples if a.centre_m is not None)
    assert depths == pytest.approx([0.45, 0.7], abs=0.02)


def test_fruit_that_one_camera_sees_stays_alone() -> None:
    trace = located((-0.2, 0.0, 0.5), (0.1, 0.0, 0.5))
    assert sum(a.centre_m is not None for a in trace.apples) == 1
    assert all(a.confidence is not None for a in trace.apples)
