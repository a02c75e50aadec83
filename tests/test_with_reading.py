"""Ranges from a reading alone, and fused with stereo."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from processor.methods import METHODS
from processor.trace import Apple, Beam, Matching, Sensed, Trace, sensed_of
from processor.with_reading import FRONTS, DepthRange, FusedRange, ReadingRange, along_ray, fruit_at
from recorder.records import Depth, RangeReading
from recorder.rectify import rectify
from recorder.rig import Rangefinder
from recorder.session import Session
from tests.scenes import apple, fruit, matching, pair_of, small_rig, stereo_session, view

PARALLEL = rectify(small_rig())
AHEAD = np.array([0.0, 0.0, 1.0])


def beam(range_m: float, x_m: float = 0.0, std_m: float = 0.001) -> Beam:
    return Beam(np.array([x_m, 0.0, 0.0]), AHEAD, range_m, std_m)


def traced(range_m: float | None) -> Trace:
    beams = () if range_m is None else (beam(range_m),)
    return METHODS["pomolog"](*pair_of(small_rig(), apple(1)), PARALLEL, sensed=Sensed(beams))


def refused(trace: Trace, range_m: float) -> Apple:
    stage = METHODS["pomolog"].triangulate
    fused = FusedRange(stage.model)  # type: ignore[attr-defined]  # its class has one
    return fused(trace.left, trace.right, trace.matching, PARALLEL, Sensed((beam(range_m),)))[0]


@pytest.mark.parametrize(("x_m", "beam_x_m"), [(0.0, 0.0), (0.05, 0.05), (0.05, 0.03)])
def test_a_circle_and_a_reading_give_the_sphere(x_m: float, beam_x_m: float) -> None:
    """An 80 mm sphere at 0.4 m whose front the beam meets, also off its middle."""
    deep_m = math.sqrt(0.04**2 - (x_m - beam_x_m) ** 2)
    slant = math.hypot(x_m / 0.4, 1)
    there = fruit(159.5 + 400 * x_m / 0.4, 119.5, radius_px=40 * slant)
    found = along_ray(there, beam(0.4 - FRONTS * deep_m, beam_x_m), PARALLEL)
    assert found is not None
    # the outline's middle is not where the centre is seen: half a millimetre at this angle
    assert found.centre_m == pytest.approx((x_m, 0.0, 0.4), abs=1.5e-3)
    assert found.radius_m == pytest.approx(0.04, abs=5e-4)


def test_a_reading_belongs_to_the_circle_that_it_ends_in() -> None:
    found = (fruit(100.0), fruit(159.5, 119.5), fruit(165.0, 119.5))
    assert fruit_at(beam(0.36), found, PARALLEL) == 1
    assert fruit_at(beam(0.36, x_m=1.0), found, PARALLEL) is None
    assert fruit_at(beam(0.36), (), PARALLEL) is None


@pytest.mark.parametrize(("radii", "place"), [(0.95, 0), (1.05, None), (-0.95, 0), (-1.05, None)])
def test_a_reading_just_beside_a_circle_is_of_something_else(
    radii: float, place: int | None
) -> None:
    found = (fruit(159.5, 119.5, radius_px=40),)
    beside_m = radii * 40 * 0.36 / PARALLEL.focal_px
    assert fruit_at(beam(0.36, x_m=beside_m), found, PARALLEL) == place


def test_a_leaf_before_the_fruit_makes_it_too_small_to_be_one() -> None:
    left = view(fruit(159.5, 119.5, radius_px=40))
    args = left, view(), Matching(np.empty((0, 2), np.intp), np.empty(0)), PARALLEL
    near, right = (ReadingRange()(*args, Sensed((beam(r),))) for r in (0.12, 0.36))
    assert [one.centre_m for one in near] == [None]
    assert right[0].centre_m == pytest.approx((0.0, 0.0, 0.4), abs=3e-3)


def test_without_a_reading_there_is_no_place_and_no_fruit_is_lost() -> None:
    left, right = view(fruit(160), fruit(200)), view(fruit(100))
    found = ReadingRange()(left, right, matching((0, 0)), PARALLEL)
    assert [(one.left, one.right, one.centre_m) for one in found] == [
        (0, None, None), (1, None, None), (None, 0, None),
    ]  # fmt: skip


def test_a_fused_range_lies_between_both_and_is_surer_than_either() -> None:
    trace = traced(None)
    stereo = trace.apples[0]
    assert stereo.centre_m is not None
    assert stereo.range_std_m is not None
    fused = refused(trace, 0.36)
    by_reading = along_ray(trace.left.circles.fruit[0], beam(0.36), PARALLEL)
    assert fused.centre_m is not None
    assert by_reading is not None
    assert by_reading.centre_m is not None
    assert fused.range_std_m is not None
    ranges = sorted(math.hypot(*one.centre_m or ()) for one in (stereo, by_reading))
    assert ranges[0] <= math.hypot(*fused.centre_m) <= ranges[1]
    assert fused.range_std_m < min(stereo.range_std_m, by_reading.range_std_m or 0.0)


@pytest.mark.parametrize("std_m", [0.0005, 0.001, 0.02])
def test_the_surer_of_two_ranges_weighs_more(std_m: float) -> None:
    trace = traced(None)
    sensed = Sensed((beam(0.355, std_m=std_m),))
    fused = FusedRange(METHODS["pomolog"].triangulate.model)  # type: ignore[attr-defined]
    found = fused(trace.left, trace.right, trace.matching, PARALLEL, sensed)[0]
    by_reading = along_ray(trace.left.circles.fruit[0], sensed.beams[0], PARALLEL)
    assert by_reading is not None
    both = [trace.apples[0], by_reading]
    ranges_m = [math.hypot(*one.centre_m or ()) for one in both]
    weights = [(one.range_std_m or math.nan) ** -2 for one in both]
    assert abs(ranges_m[0] - ranges_m[1]) > 1e-3  # else any weights would do
    mean_m = float(np.average(ranges_m, weights=weights))
    assert math.hypot(*found.centre_m or ()) == pytest.approx(mean_m, abs=1e-9)
    assert found.range_std_m == pytest.approx(sum(weights) ** -0.5)


def test_a_reading_of_something_else_changes_nothing() -> None:
    trace = traced(None)
    assert refused(trace, 0.2) == trace.apples[0]


@pytest.mark.parametrize(("share", "taken"), [(0.99, False), (1.01, True)])
def test_a_reading_is_taken_up_to_the_gate(share: float, *, taken: bool) -> None:
    trace = traced(None)
    stereo, read = trace.apples[0], along_ray(trace.left.circles.fruit[0], beam(0.355), PARALLEL)
    assert read is not None
    apart_m = math.hypot(*stereo.centre_m or ()) - math.hypot(*read.centre_m or ())
    both_m = math.hypot(stereo.range_std_m or math.nan, read.range_std_m or math.nan)
    model = METHODS["pomolog"].triangulate.model  # type: ignore[attr-defined]
    fused = FusedRange(model, gate=share * abs(apart_m) / both_m)
    args = trace.left, trace.right, trace.matching, PARALLEL, Sensed((beam(0.355),))
    assert (fused(*args)[0] != stereo) == taken


def test_a_fused_place_is_as_sure_along_its_ray_as_its_range_and_as_stereo_across() -> None:
    trace = traced(None)
    stereo, fused = trace.apples[0], refused(trace, 0.36)
    towards = np.array(fused.centre_m) / math.hypot(*fused.centre_m or ())
    across = np.cross(towards, (0.0, 1.0, 0.0))
    before, after = (whole(one.covariance_m2 or ()) for one in (stereo, fused))
    gained = (stereo.range_std_m or math.nan) ** 2 - (fused.range_std_m or math.nan) ** 2
    assert towards @ (before - after) @ towards == pytest.approx(gained)
    assert across @ (before - after) @ across == pytest.approx(0.0, abs=1e-15)


def whole(upper: tuple[float, ...]) -> npt.NDArray[np.float64]:
    """A covariance of its upper triangle."""
    matrix = np.zeros((3, 3))
    matrix[np.triu_indices(3)] = upper
    return matrix + np.triu(matrix, 1).T


def depth_of(*metres: float) -> Depth:
    """A depth picture for small_rig: its columns in so many equal parts."""
    columns = np.repeat(metres, 320 // len(metres))
    return Depth(0, "32FC1", np.tile(columns, (240, 1)).astype("<f4").tobytes(), (320, 240))


def test_a_depth_picture_places_every_fruit_that_it_sees() -> None:
    left = view(fruit(79.5, 119.5, radius_px=40), fruit(239.5, 119.5, radius_px=40))
    args = left, view(), matching(), PARALLEL
    both = DepthRange()(*args, Sensed(depth=depth_of(0.36, 0.36)))
    assert [one.left for one in both if one.centre_m] == [0, 1]
    assert both[0].centre_m is not None
    assert both[0].centre_m[2] == pytest.approx(0.4, abs=3e-3)
    one_blind = DepthRange()(*args, Sensed(depth=depth_of(0.36, math.nan)))
    assert [one.left for one in one_blind if one.centre_m] == [0]
    assert [one.centre_m for one in DepthRange()(*args)] == [None, None]


def test_a_sessions_instruments_are_read_from_its_pairs(tmp_path: Path) -> None:
    known = Rangefinder(np.zeros(3), AHEAD, 0.002)
    there = RangeReading(10**6, 0.5, None, "ok", "0.5")
    no_echo = RangeReading(2 * 10**6, None, None, "no echo", "?")
    for rangefinder, ranges in ((known, [0.5]), (None, [])):
        rig = small_rig(rangefinder)
        path = stereo_session(
            tmp_path / f"{len(ranges)}.mcap", [[apple(1)]], rig=rig, readings=[there, no_echo]
        )
        with Session(path) as session:
            (pair,) = session.pairs()
            sensed = sensed_of(pair, session.rig)
        assert [beam.range_m for beam in sensed.beams] == ranges
        assert [beam.std_m for beam in sensed.beams] == [0.002] * len(ranges)
        assert sensed.depth is None
