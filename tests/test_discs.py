"""True apples as discs of a view: how large they are, and which of them are asked for."""

import numpy as np
import pytest

from processor.discs import true_discs
from recorder.records import SIDES, AppleTruth, FrameTruth, Side
from recorder.rectify import rectify
from tests.builders import real_rig
from tests.scenes import small_rig


@pytest.mark.parametrize("side", SIDES)
def test_a_disc_is_as_large_as_its_sphere_is_wide_across_the_view(side: Side) -> None:
    parallel = rectify(real_rig())
    apple = AppleTruth(1, (0.3, -0.1, 0.8), 0.04)
    found = true_discs(FrameTruth(apples=(apple,)), side, None, parallel)
    assert found is not None
    across = parallel.to_left_frame(np.array([[1.0, 0.0, 0.0]]))[0]
    ends = parallel.project(side, np.array([apple.centre_m, apple.centre_m + 0.04 * across]))
    assert found.circles[0] == pytest.approx((*ends[0], np.linalg.norm(ends[1] - ends[0])))


@pytest.mark.parametrize(("beyond_px", "asked"), [(-1.0, True), (39.0, True), (41.0, False)])
def test_a_disc_that_reaches_into_the_picture_is_asked_for(beyond_px: float, asked: bool) -> None:
    parallel = rectify(small_rig())  # 320 px wide
    x_m = 0.4 * (320 + beyond_px - parallel.left.matrix[0, 2]) / parallel.focal_px
    apple = AppleTruth(1, (x_m, 0.0, 0.4), 0.1 * 400 / parallel.focal_px * 0.4)
    found = true_discs(FrameTruth(apples=(apple,)), "left", None, parallel)
    assert found is not None
    assert found.circles[0, 2] == pytest.approx(40.0)
    assert found.wanted.tolist() == [asked]
