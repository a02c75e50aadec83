"""Outlines fitted to rims, and how far apart two of them are."""

import cv2
import numpy as np
import pytest

from processor.rims import Bytes, find_rims, fit_outlines, shift_of_rims
from processor.trace import Floats

SIZE = (320, 240)


def oval(x: float, y: float, radius: float, wider: float = 0.0, lean: float = 0.0) -> Bytes:
    """Evidence of an outline of that mean radius and second harmonic."""
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    angle = np.arctan2(rows - y, columns - x)
    reach = radius * (1 + wider * np.cos(2 * angle) + lean * np.sin(2 * angle))
    beyond = np.hypot(columns - x, rows - y) - reach
    return np.asarray(np.clip(0.5 - beyond / 2, 0, 1) * 255, np.uint8)


def circles(*rows: tuple[float, float, float]) -> Floats:
    return np.array(rows, float).reshape(-1, 3)


def test_a_rim_is_where_evidence_ends() -> None:
    rims = find_rims(oval(160, 120, 50), circles((160, 120, 47)))
    assert rims.seen.all()
    np.testing.assert_allclose(rims.reach_px, 50, atol=0.3)


def test_a_rim_outside_the_picture_is_not_seen() -> None:
    rims = find_rims(oval(10, 120, 50), circles((10, 120, 50)))
    assert rims.seen[0, 0]
    assert not rims.seen[0, rims.seen.shape[1] // 2]


def test_no_circles_give_no_rims() -> None:
    assert find_rims(oval(160, 120, 50), circles()).reach_px.shape == (0, 48)


@pytest.mark.parametrize("wider", [0.0, 0.04, 0.08])
def test_a_rough_circle_becomes_the_outline(wider: float) -> None:
    found = fit_outlines(oval(161.3, 119.6, 50, wider), circles((156, 125, 44)))
    np.testing.assert_allclose(found.circles[0], (161.3, 119.6, 50), atol=0.4)
    assert found.rim[0] > 0.9


def test_a_half_hidden_outline_keeps_its_place_and_says_that_it_is_less_sure() -> None:
    whole = oval(160, 120, 50, 0.04)
    half = whole.copy()
    half[:, 165:] = 0
    start = circles((157, 121, 48))
    sure, unsure = fit_outlines(whole, start), fit_outlines(half, start)
    np.testing.assert_allclose(unsure.circles[0], (160, 120, 50), atol=4)
    assert unsure.covariance[0, 0, 0] > sure.covariance[0, 0, 0]
    assert unsure.rim[0] < sure.rim[0]


def test_the_shift_between_two_outlines_is_found_to_a_fraction_of_a_pixel() -> None:
    left, right = oval(180.4, 120, 45, 0.05), oval(120.1, 120, 45, 0.05)
    found = shift_of_rims(left, right, circles((183, 121, 43)), circles((118, 119, 47)))
    assert found.shift_px[0] == pytest.approx(60.3, abs=0.1)
    assert found.rim[0] > 0.9


def test_outlines_that_lean_differently_keep_their_shift() -> None:
    """The cameras see different rims of a leaning apple."""
    left, right = oval(180, 120, 45, 0.05, 0.03), oval(120, 120, 45, 0.05, -0.01)
    found = shift_of_rims(left, right, circles((180, 120, 45)), circles((120, 120, 45)))
    assert found.shift_px[0] == pytest.approx(60, abs=0.15)


def test_what_one_view_alone_hides_does_not_move_the_shift() -> None:
    left, right = oval(180, 120, 45, 0.05), oval(120, 120, 45, 0.05)
    cv2.rectangle(left, (190, 60), (240, 110), 0, cv2.FILLED)
    found = shift_of_rims(left, right, circles((178, 122, 44)), circles((121, 119, 46)))
    assert found.shift_px[0] == pytest.approx(60, abs=0.5)
    assert found.rim[0] < 0.95
