"""Fruit from regions, by the model that ships."""

from dataclasses import replace

import numpy as np
import pytest

from processor.clean import SizeFloor
from processor.fruit import FruitFinder
from processor.methods import METHODS
from processor.trace import Circles, Look
from recorder.rectify import rectify
from tests.scenes import Disc, disc_mask, recognised, rounded, small_rig

SIZE = (320, 240)


def finder() -> FruitFinder:
    stage = METHODS["pomolog"].circles
    assert isinstance(stage, FruitFinder)
    return replace(stage, nearest_m=0.25)


def found(*discs: Disc) -> Circles:
    recognition = recognised(disc_mask(*discs, size_px=SIZE))
    look = Look(rounded(*discs, size_px=SIZE), recognition, rectify(small_rig()))
    return finder()(SizeFloor()(recognition), (0, 0, 0), look)


@pytest.mark.parametrize("radius", [25.0, 40.0, 55.0])
def test_a_disc_is_one_fruit(radius: float) -> None:
    (one,) = found((150, 120, radius)).fruit
    assert (one.x_px, one.y_px, one.radius_px) == pytest.approx((150, 120, radius), abs=1.5)
    assert one.confidence is not None
    assert one.confidence > 0.5
    assert one.covariance_px2 is not None
    assert len(one.covariance_px2) == 6


def test_two_that_touch_are_two() -> None:
    two = found((110, 120, 40), (186, 120, 40)).as_array()
    assert np.sort(two[:, 0]) == pytest.approx([110, 186], abs=4)


def test_what_nothing_recognises_is_no_fruit_whatever_the_network_says() -> None:
    recognition = recognised(disc_mask(size_px=SIZE))
    look = Look(rounded((150, 120, 40), size_px=SIZE), recognition, rectify(small_rig()))
    eager = replace(finder(), least_centre=1e-6, least_quality=0.0, least_confidence=0.0)
    assert eager(SizeFloor()(recognition), (0, 0, 0), look).fruit == ()


def test_a_picture_without_fruit_has_none() -> None:
    assert found().fruit == ()
    assert found().tried.shape == (0, 5)


def test_the_window_follows_from_the_rig_and_the_fruit() -> None:
    least, largest = finder().radii_px(rectify(small_rig()))
    assert least == pytest.approx(400 * 0.028 / 1.9)
    assert largest == pytest.approx(400 * 0.052 / 0.25)


def test_the_same_seed_finds_the_same() -> None:
    once, again = (found((110, 120, 40), (186, 130, 45)).as_array() for _ in range(2))
    np.testing.assert_array_equal(once, again)
