"""What the other view's network says of a circle."""

import numpy as np
import pytest

from processor.centres import CELL, USUAL_PX, Centres, told
from processor.nearness import USUAL_RADIUS_M
from processor.partner import PARTNER_MEASURES, Partner
from recorder.records import Side
from recorder.rectify import rectify
from recorder.rig import parallel_rig

RIG = rectify(parallel_rig(size_px=(1280, 1024), focal_px=1154.0, baseline_m=0.2))
PITCH_PX = 8.0
RADIUS_PX = 40.0
DISPARITY_PX = RADIUS_PX * 0.2 / USUAL_RADIUS_M  # of an apple of the usual size


def one_fruit(column: int, row: int, radius_px: float = RADIUS_PX) -> Centres:
    """A view of 1280 x 1024 px with one centre."""
    said = np.zeros((5, 128, 160), np.float32)
    said[0] = -6
    said[0, row, column] = 3
    said[1] = np.log(radius_px / (USUAL_PX * PITCH_PX / CELL))
    said[4] = 0.7
    return told(said, PITCH_PX / CELL)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_fruit_of_the_usual_size_has_its_partner_where_it_must_be(side: Side) -> None:
    other = one_fruit(70, 60)
    x, y, _ = other.circles[60, 70]
    away = DISPARITY_PX if side == "left" else -DISPARITY_PX
    circle = np.array([[x + away, y, RADIUS_PX]])
    (measures,) = Partner(other, side, RIG, 1280).measures(circle)
    assert measures == pytest.approx([3, 0, 0, 0, 0.7, 1], abs=0.02)
    (elsewhere,) = Partner(other, side, RIG, 1280).measures(circle + np.array([0, 60, 0]))
    assert elsewhere[0] == pytest.approx(-6)


def test_a_partner_of_another_size_says_so() -> None:
    other = one_fruit(70, 60, 1.2 * RADIUS_PX)
    x, y, _ = other.circles[60, 70]
    circle = np.array([[x + 0.85 * DISPARITY_PX, y + 6, RADIUS_PX]])
    (measures,) = Partner(other, "left", RIG, 1280).measures(circle)
    logit, alike, size, off_row = measures[:4]
    assert logit == pytest.approx(3)
    assert alike == pytest.approx(np.log(1.2), abs=0.01)
    assert size == pytest.approx(-np.log(0.85), abs=0.01)
    assert off_row == pytest.approx(-6 / RADIUS_PX, abs=0.01)


def test_what_the_other_view_cannot_have_is_told_apart() -> None:
    circles = np.array([[20.0, 500.0, RADIUS_PX], [900.0, 500.0, RADIUS_PX]])
    outside, within = Partner(one_fruit(70, 60), "left", RIG, 1280).measures(circles)
    assert outside[-1] == 0  # its partner would lie left of the right picture
    assert within[-1] == 1
    none = Partner(one_fruit(70, 60), "left", RIG, 1280).measures(np.empty((0, 3)))
    assert none.shape == (0, PARTNER_MEASURES)
