"""The whole locator on drawn stereo pairs."""

import math

import cv2
import numpy as np
import pytest

from processor.circles import HoughCircles, RandomRing
from processor.locate import Locator
from processor.match import AreaInOrder
from processor.trace import Trace
from recorder.rectify import rectify
from recorder.rig import Camera, Rig
from tests.scenes import LEAF, apple, draw, located, pair_of, red_disc_picture, small_rig

PARALLEL = rectify(small_rig())
STAGES = ("rectify", "recognise", "clean", "circles", "match", "triangulate")


def depth_tolerance_m(z_m: float) -> float:
    """The depth that 4 px of disparity are worth: each circle may be off by 2 px of its 5 px ring.

    dZ = Z^2 dd / (f B), with small_rig's f = 400 px and B = 0.06 m.
    """
    return z_m**2 * 4 / (400 * 0.06)


def test_an_apple_is_found_where_it_is() -> None:
    trace = Locator()(*pair_of(small_rig(), apple(1, 0.03, -0.01, 0.4)), PARALLEL)
    ((x_m, y_m, z_m),) = located(trace)
    assert z_m == pytest.approx(0.4, abs=depth_tolerance_m(0.4))
    assert (x_m, y_m) == pytest.approx((0.03, -0.01), abs=0.01)  # the same 4 px, sideways


def test_each_apple_finds_its_own_partner() -> None:
    apples = [apple(1, -0.06, -0.06, 0.4), apple(2, 0.09, 0.05, 0.45)]
    trace = Locator()(*pair_of(small_rig(), *apples), PARALLEL)
    depths = sorted(z for _, _, z in located(trace))
    assert depths == [
        pytest.approx(a.centre_m[2], abs=depth_tolerance_m(a.centre_m[2])) for a in apples
    ]


def test_pictures_without_an_apple_give_an_empty_trace() -> None:
    for colour in (LEAF, (0, 0, 0), (255, 255, 255)):
        picture = np.full((240, 320, 3), colour, np.uint8)
        trace = Locator()(picture, picture, PARALLEL)
        assert trace.apples == ()
        assert trace.left.circles.fruit == ()


def test_an_apple_in_one_view_only_is_kept_without_a_place() -> None:
    empty = red_disc_picture()
    seen = red_disc_picture((160, 120, 40))
    (one,) = Locator()(seen, empty, PARALLEL).apples
    assert (one.left, one.right, one.centre_m) == (0, None, None)
    (other,) = Locator()(empty, seen, PARALLEL).apples
    assert (other.left, other.right, other.centre_m) == (None, 0, None)


def numbers(trace: Trace) -> list[object]:
    return [
        trace.apples,
        trace.left.circles.fruit,
        trace.right.circles.fruit,
        trace.left.circles.tried.tolist(),
        trace.matching.pairs.tolist(),
        trace.matching.reference_px,
    ]


def test_the_same_pictures_and_seed_give_the_same_trace() -> None:
    pictures = pair_of(small_rig(), apple(1), apple(2, 0.09, 0.05, 0.45))
    first = numbers(Locator()(*pictures, PARALLEL, (3, 7)))
    Locator()(*pair_of(small_rig(), apple(1, 0.05)), PARALLEL, (3, 8))  # another frame between
    assert numbers(Locator()(*pictures, PARALLEL, (3, 7))) == first


def test_another_seed_or_frame_or_side_draws_other_rings() -> None:
    same = red_disc_picture((160, 120, 40))
    trace = Locator()(same, same, PARALLEL, (0, 0))
    assert not np.array_equal(trace.left.circles.tried, trace.right.circles.tried)
    for seed in ((1, 0), (0, 1)):
        other = Locator()(same, same, PARALLEL, seed)
        assert not np.array_equal(trace.left.circles.tried, other.left.circles.tried)


def test_locating_leaves_the_pictures_as_they_are() -> None:
    left, right = pair_of(small_rig(), apple(1))
    before = left.copy(), right.copy()
    Locator()(left, right, PARALLEL)
    np.testing.assert_array_equal(left, before[0])
    np.testing.assert_array_equal(right, before[1])


def test_every_stage_is_timed() -> None:
    trace = Locator()(*pair_of(small_rig(), apple(1)), PARALLEL)
    assert tuple(trace.stage_ns) == STAGES
    assert all(ns >= 0 for ns in trace.stage_ns.values())


def test_the_repr_is_the_whole_configuration() -> None:
    text = repr(Locator(circles=RandomRing(rounds=7)))
    for word in ("ColourRatio(reading='absolute')", "rounds=7", "smallest_share=0.125"):
        assert word in text


def test_the_right_circles_through_a_distorted_turned_rig_give_the_right_place() -> None:
    plain = small_rig()
    lens = np.array([-0.2, 0.05, 0.001, -0.001, 0.0])
    rotation, _ = cv2.Rodrigues(np.array([0.01, 0.03, -0.02]))
    rig = Rig(
        Camera(plain.left.size_px, plain.left.matrix, lens),
        Camera(plain.right.size_px, plain.right.matrix, lens),
        np.asarray(rotation, float),
        -rotation @ np.array([0.06, 0.001, -0.002]),
    )
    there = apple(1, 0.04, 0.02, 0.4)
    trace = Locator()(draw(rig, "left", [there])[0], draw(rig, "right", [there])[0], rectify(rig))
    (place,) = located(trace)
    assert math.dist(place, there.centre_m) < depth_tolerance_m(0.4) + 0.01


@pytest.mark.parametrize("finder", [RandomRing(), HoughCircles()])
def test_touching_apples_are_one_region_and_so_at_most_one_fruit(
    finder: RandomRing | HoughCircles,
) -> None:
    """The paper's own limit (Fig. 7, apple B): a cluster's contour wins one ring."""
    cluster = red_disc_picture((130, 120, 40), (190, 120, 40))
    trace = Locator(circles=finder, match=AreaInOrder(reference_line=False))(
        cluster, cluster, PARALLEL
    )
    assert len(trace.left.circles.fruit) == 1
