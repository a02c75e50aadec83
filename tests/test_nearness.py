"""Sizes from a coarse look at both views."""

import cv2
import numpy as np
import pytest

from processor.nearness import USUAL_RADIUS_M, see_nearness
from processor.recognise import ColourRatio
from processor.trace import Look, look_both_ways
from recorder.records import Picture
from recorder.rectify import Rectification, rectify
from recorder.rig import parallel_rig

RIG = rectify(parallel_rig(size_px=(640, 512), focal_px=577.0, baseline_m=0.2))


def texture(seed: int, shape: tuple[int, int]) -> Picture:
    noise = np.random.default_rng(seed).integers(0, 256, (*shape, 3)).astype(np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), 3), np.uint8)


def looks(disparity_px: int, rig: Rectification = RIG) -> tuple[Look, ...]:
    """A textured wall at that disparity, both views."""
    noise = texture(0, (512, 640 + disparity_px)).astype(float)
    wall = 255 * (noise - noise.min()) / np.ptp(noise)
    pictures = [
        np.ascontiguousarray(wall[:, :640], np.uint8),
        np.ascontiguousarray(wall[:, disparity_px:], np.uint8),
    ]
    return look_both_ways(pictures, [ColourRatio()(p) for p in pictures], rig)


@pytest.mark.parametrize("disparity_px", [80, 140])
@pytest.mark.parametrize("side", [0, 1])
def test_a_wall_says_how_large_an_apple_before_it_is(disparity_px: int, side: int) -> None:
    found = see_nearness(looks(disparity_px)[side], 0.38, 1.9)
    assert found is not None
    middle = np.full(1, 320.0 if side == 0 else 200.0)
    wanted = disparity_px * USUAL_RADIUS_M / 0.2
    # a sixteenth of a pixel of four, and the neighbours' smoothing
    assert found.radius_px(middle, np.full(1, 250.0)) == pytest.approx(wanted, rel=0.05)


def test_what_only_one_view_shows_is_unknown() -> None:
    found = see_nearness(looks(140)[0], 0.38, 1.9)
    assert found is not None
    left_edge = found.disparity_px[:, : 100 // found.coarser]
    assert (left_edge == 0).mean() > 0.9  # its partner lies outside the right picture


def test_both_views_share_one_matching() -> None:
    left, right = looks(80)
    see_nearness(left, 0.38, 1.9)
    assert left.shared is right.shared
    known = dict(left.shared)
    see_nearness(right, 0.38, 1.9)
    assert left.shared == known


def test_one_view_alone_says_nothing() -> None:
    picture = texture(1, (64, 64))
    (alone,) = look_both_ways([picture], [ColourRatio()(picture)], RIG)
    assert see_nearness(alone, 0.38, 1.9) is None
