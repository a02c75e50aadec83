"""Triangulation of places that are known exactly."""

import math

import cv2
import numpy as np
import pytest

from processor.trace import Apple, Fruit
from processor.triangulate import Parallel
from recorder.rectify import Rectification, rectify
from recorder.rig import Camera, Rig
from tests.scenes import fruit, matching, small_rig, view

Point = tuple[float, float, float]


def seen(point: Point, radius_m: float, parallel: Rectification) -> tuple[Fruit, Fruit]:
    """The circles that parallel cameras would see of a sphere, were its outline its centre's."""
    where = [parallel.project(side, np.array([point]))[0] for side in ("left", "right")]
    depth_m = (parallel.left.rotation @ np.array(point))[2]
    radius_px = parallel.focal_px * radius_m / depth_m
    left, right = (fruit(float(x), float(y), radius_px=radius_px) for x, y in where)
    return left, right


def placed(point: Point, rig: Rig, radius_m: float = 0.04) -> Apple:
    parallel = rectify(rig)
    left, right = seen(point, radius_m, parallel)
    (one,) = Parallel()(view(left), view(right), matching((0, 0)), parallel)
    return one


def rig_with(*, yaw: float = 0.0, shift_px: float = 0.0) -> Rig:
    """small_rig with the right camera turned, or its middle elsewhere."""
    plain = small_rig()
    matrix = plain.right.matrix + np.array([[0, 0, shift_px], [0, 0, 0], [0, 0, 0]])
    rotation, _ = cv2.Rodrigues(np.array([0.01, yaw, -0.02]) if yaw else np.zeros(3))
    centre = np.array([0.06, 0.001, -0.002]) if yaw else np.array([0.06, 0.0, 0.0])
    right = Camera(plain.right.size_px, matrix)
    return Rig(plain.left, right, np.asarray(rotation, float), -rotation @ centre)


@pytest.mark.parametrize("point", [(0.0, 0.0, 0.4), (0.1, -0.05, 0.7), (-0.3, 0.2, 1.5)])
@pytest.mark.parametrize(
    "rig", [small_rig(), rig_with(shift_px=12.5), rig_with(yaw=0.05)], ids=["ideal", "cx", "turned"]
)
def test_a_known_place_is_found_again(point: Point, rig: Rig) -> None:
    one = placed(point, rig)
    assert one.centre_m == pytest.approx(point, abs=1e-9)
    assert one.radius_m == pytest.approx(0.04)
    assert one.surface_range_m == pytest.approx(math.hypot(*point) - 0.04)
    assert (one.left, one.right) == (0, 0)


def test_the_depth_is_focal_length_times_baseline_over_disparity() -> None:
    left, right = view(fruit(200, 120)), view(fruit(140, 120))
    (one,) = Parallel()(left, right, matching((0, 0)), rectify(small_rig()))
    assert one.disparity_px == pytest.approx(60)
    assert one.centre_m is not None
    assert one.centre_m[2] == pytest.approx(400 * 0.06 / 60)


@pytest.mark.parametrize(("right_x_px", "is_placed"), [(199, True), (199.5, False), (205, False)])
def test_a_match_of_no_positive_disparity_is_no_apple(right_x_px: float, is_placed: bool) -> None:
    left, right = view(fruit(200)), view(fruit(right_x_px))
    found = Parallel()(left, right, matching((0, 0)), rectify(small_rig()))
    if is_placed:
        assert [(a.left, a.right) for a in found] == [(0, 0)]
    else:
        assert found == (Apple(0, None), Apple(None, 0))


def test_a_match_at_infinity_is_no_apple_even_where_any_disparity_will_do() -> None:
    same = view(fruit(200))
    found = Parallel(min_disparity_px=0.0)(same, same, matching((0, 0)), rectify(small_rig()))
    assert found == (Apple(0, None), Apple(None, 0))


def test_fruit_alone_follow_the_matched_without_a_place() -> None:
    left = view(fruit(150), fruit(200), fruit(250))
    right = view(fruit(100), fruit(130))
    found = Parallel()(left, right, matching((1, 1)), rectify(small_rig()))
    assert [(a.left, a.right) for a in found] == [(1, 1), (0, None), (2, None), (None, 0)]
    assert all(a.centre_m is None and a.disparity_px is None for a in found[1:])


def outline_middle_px(x_m: float, z_m: float, radius_m: float, focal_px: float) -> float:
    """Half way between the two rays that touch a sphere on the camera's level, in pixels."""
    towards, half = math.atan2(x_m, z_m), math.asin(radius_m / math.hypot(x_m, z_m))
    return focal_px * (math.tan(towards - half) + math.tan(towards + half)) / 2


@pytest.mark.parametrize("z_m", [0.4, 0.7, 1.0, 1.5])
@pytest.mark.parametrize("x_m", [-0.1, 0.0, 0.25])
def test_the_middles_of_two_outlines_meet_r_squared_over_z_before_the_centre(
    x_m: float, z_m: float
) -> None:
    """A sphere's outline is f X Z / (Z^2 - R^2) off the axis, so f B / d is (Z^2 - R^2) / Z."""
    rig, radius_m = small_rig(), 0.04
    parallel = rectify(rig)
    middle = parallel.left.matrix[0, 2]
    left, right = (
        view(fruit(middle + outline_middle_px(x, z_m, radius_m, 400.0)))
        for x in (x_m, x_m - rig.baseline_m)
    )
    (one,) = Parallel()(left, right, matching((0, 0)), parallel)
    assert one.centre_m is not None
    assert one.centre_m[2] == pytest.approx(z_m - radius_m**2 / z_m, abs=1e-12)
    assert one.centre_m[0] == pytest.approx(x_m, abs=1e-12)  # sideways the two biases cancel
