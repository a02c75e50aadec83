import numpy as np
import pytest

from recorder.optics import to_pixels, to_rays
from recorder.rig import Camera, LensModel
from tests.builders import real_rig


@pytest.mark.parametrize("lens", ["plumb_bob", "rational_polynomial", "kannala_brandt"])
def test_a_pixel_comes_back_from_its_ray(lens: LensModel) -> None:
    camera = real_rig(lens).left
    x, y = np.meshgrid(np.linspace(0, 639, 17), np.linspace(0, 479, 13))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    back = to_pixels(camera, to_rays(camera, pixels))
    np.testing.assert_allclose(back, pixels, rtol=0, atol=1e-6)  # what Newton's method ends at


def test_a_wide_lens_is_inverted_up_to_its_corners() -> None:
    """OpenCV's own five rounds miss by whole pixels here."""
    matrix = np.array([[575.0, 0, 630], [0, 575, 382], [0, 0, 1]])
    lens = np.array([2.783, 0.378, 0, 0, -0.0186, 3.139, 1.165, -0.0249])
    camera = Camera((1280, 800), matrix, lens, "rational_polynomial")
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rays = np.column_stack([2.2 * np.cos(angles), 2.2 * np.sin(angles), np.ones(24)])
    pixels = to_pixels(camera, rays)
    np.testing.assert_allclose(to_rays(camera, pixels), rays, rtol=0, atol=1e-6)


def test_a_pixel_that_no_ray_meets_has_none() -> None:
    matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    turning = Camera((640, 480), matrix, np.array([-0.5, 0, 0, 0, 0]))
    # r - 0.5 r^3 never exceeds 0.5443
    rays = to_rays(turning, np.array([[320.0 + 280, 240], [320.0 + 100, 240]]))
    assert np.isnan(rays[0, :2]).all()
    assert np.isfinite(rays[1]).all()


def test_nothing_maps_to_nothing() -> None:
    camera = real_rig().left
    assert to_rays(camera, np.empty((0, 2))).shape == (0, 3)
    assert to_pixels(camera, np.empty((0, 3))).shape == (0, 2)
