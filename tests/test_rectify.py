import cv2
import numpy as np
import pytest

from recorder.errors import PomologError
from recorder.records import SIDES, UNCOUNTED, Side
from recorder.rectify import rectify
from recorder.rig import Camera, Floats, LensModel, Rig, load_rig, parallel_rig
from tests.builders import DATA, labels, picture, real_rig, rotation_of

LENSES: list[LensModel] = ["plumb_bob", "rational_polynomial", "kannala_brandt"]


def points() -> Floats:
    """(N, 3) places in front of the left camera, in metres."""
    generator = np.random.default_rng(3)
    return generator.uniform((-0.35, -0.3, 0.9), (0.45, 0.3, 2.5), (200, 3))


def through_the_lens(rig: Rig, side: Side, points_m: Floats) -> Floats:
    """Project points by the true camera, by its own formulas and no code under test."""
    seen = points_m if side == "left" else points_m @ rig.rotation.T + rig.translation_m
    camera = rig.camera(side)
    x, y = (seen[:, :2] / seen[:, 2:]).T
    r2 = x * x + y * y
    d = camera.distortion
    if camera.lens == "kannala_brandt":
        r = np.sqrt(r2)
        t = np.arctan(r)
        bent = t * (1 + d[0] * t**2 + d[1] * t**4 + d[2] * t**6 + d[3] * t**8)
        x, y = x * bent / r, y * bent / r
    else:
        k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(d, (0, 8 - len(d)))
        radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
        x, y = (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        )
    return np.column_stack([x, y, np.ones_like(x)]) @ camera.matrix[:2].T


def rigs() -> dict[str, Rig]:
    found: dict[str, Rig] = {str(lens): real_rig(lens) for lens in LENSES}
    straight = real_rig()
    found["toed in, straight lenses"] = Rig(
        Camera(straight.left.size_px, straight.left.matrix),
        Camera(straight.right.size_px, straight.right.matrix),
        straight.rotation,
        straight.translation_m,
    )
    story = DATA / "story_orchard" / "rig_opencv.yaml"
    if story.exists():
        found["story orchard"] = load_rig(story)
    return found


REAL = rigs()


def test_the_real_trees_rig_is_among_those_tested() -> None:
    if "story orchard" not in REAL:
        pytest.skip(f"NOT TESTED: no {DATA / 'story_orchard'}")


# an ideal rig


def test_an_ideal_rig_gives_the_same_objects_back() -> None:
    parallel = rectify(parallel_rig(size_px=(64, 48)))
    recorded, known = picture(), labels()
    circles, places = np.array([[3.0, 4.0, 5.0]]), np.array([[3.0, 4.0]])
    for view in (parallel.left, parallel.right):
        assert view.picture(recorded) is recorded
        assert view.labels(known) is known
        assert view.to_recorded(places) is places
        assert view.circles_to_recorded(circles) is circles
    assert parallel.focal_px == parallel_rig().left.matrix[0, 0]


def test_a_rig_parallel_to_a_thousandth_of_a_pixel_is_ideal() -> None:
    ideal = parallel_rig()
    for turn_rad, is_ideal in ((1e-8, True), (1e-5, False)):
        rotation = rotation_of((0, turn_rad, 0))
        rig = Rig(ideal.left, ideal.right, rotation, ideal.translation_m)
        assert (rectify(rig).left.maps is None) == is_ideal


def test_unequal_principal_points_do_not_move_the_distance() -> None:
    ideal = parallel_rig()
    matrix = ideal.right.matrix.copy()
    matrix[0, 2] += 12.5
    rig = Rig(ideal.left, Camera(ideal.right.size_px, matrix), np.eye(3), ideal.translation_m)
    parallel = rectify(rig)
    assert parallel.right.maps is None  # columns may differ, rows correspond
    left, right = (through_the_lens(rig, side, points()) for side in SIDES)
    disparity_px = [
        parallel.disparity_px(a, b) for a, b in zip(left[:, 0], right[:, 0], strict=True)
    ]
    z_m = parallel.focal_px * parallel.baseline_m / np.array(disparity_px)
    assert np.allclose(z_m, points()[:, 2], rtol=1e-12)  # double precision


# a real rig


@pytest.mark.parametrize("name", REAL)
def test_rectified_rows_are_equal_and_z_is_f_b_over_d(name: str) -> None:
    parallel = rectify(REAL[name])
    assert parallel.left.maps is not None
    left, right = (parallel.project(side, points()) for side in SIDES)
    assert np.abs(left[:, 1] - right[:, 1]).max() < 1e-6  # a millionth: OpenCV solves iteratively
    disparity_px = [
        parallel.disparity_px(a, b) for a, b in zip(left[:, 0], right[:, 0], strict=True)
    ]
    z_m = parallel.focal_px * parallel.baseline_m / np.array(disparity_px)
    in_rectified_m = points() @ parallel.left.rotation.T
    assert np.allclose(z_m, in_rectified_m[:, 2], rtol=1e-9)  # as the rows
    assert np.allclose(parallel.to_left_frame(in_rectified_m), points(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("side", SIDES)
def test_rectified_points_go_back_through_the_true_lens(name: str, side: Side) -> None:
    parallel = rectify(REAL[name])
    back = parallel.view(side).to_recorded(parallel.project(side, points()))
    truth = through_the_lens(REAL[name], side, points())
    assert np.abs(back - truth).max() < 0.01  # a hundredth of a pixel is 0.2 mm at 2 m
    assert np.abs(truth - parallel.project(side, points())).max() > 1  # the lens did matter


@pytest.mark.parametrize("name", REAL)
def test_a_resampled_picture_shows_things_where_they_project_to(name: str) -> None:
    parallel = rectify(REAL[name])
    for side in SIDES:
        width_px, height_px = REAL[name].left.size_px
        place = np.array([[0.02, 0.03, 1.5]])
        x, y = through_the_lens(REAL[name], side, place)[0]
        rows, columns = np.mgrid[:height_px, :width_px]
        blob = 255 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 6.0**2))
        recorded = np.dstack([blob] * 3).astype(np.uint8)
        seen = parallel.view(side).picture(recorded)[..., 0].astype(float)
        assert seen.shape == (height_px, width_px)
        found = np.array([(seen * columns).sum(), (seen * rows).sum()]) / seen.sum()
        # remap's tables are of 1/32 px, and a blob is not quite round any more
        assert np.abs(found - parallel.project(side, place)[0]).max() < 0.1


def test_labels_are_resampled_without_new_values_and_uncounted_outside() -> None:
    rig = real_rig()
    width_px, height_px = rig.left.size_px
    known = np.ones((height_px, width_px), np.uint16)
    known[:, width_px // 2 :] = 40_000
    seen = rectify(rig).right.labels(known)
    assert seen.dtype == np.uint16
    assert set(np.unique(seen).tolist()) == {1, 40_000, UNCOUNTED}


@pytest.mark.parametrize("name", REAL)
def test_a_circle_goes_back_to_where_its_rim_is(name: str) -> None:
    view = rectify(REAL[name]).left
    width_px, height_px = REAL[name].left.size_px
    x, y, radius = view.circles_to_recorded(np.array([[width_px / 2, height_px / 2, 20.0]]))[0]
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    rim = np.array([width_px / 2, height_px / 2]) + 20 * np.stack(
        [np.cos(angles), np.sin(angles)], axis=1
    )
    outline = view.to_recorded(rim)
    assert np.hypot(*(outline.mean(axis=0) - (x, y))) < 0.2  # an oval's middle, to its curvature
    area_px = cv2.contourArea(outline.astype(np.float32))
    assert np.sqrt(area_px / np.pi) == pytest.approx(radius, rel=0.005)  # eight spokes, not all


def test_nothing_maps_to_nothing() -> None:
    view = rectify(real_rig()).left
    assert view.to_recorded(np.empty((0, 2))).shape == (0, 2)
    assert view.circles_to_recorded(np.empty((0, 3))).shape == (0, 3)


def test_a_rig_is_rectified_once() -> None:
    rig = real_rig()
    assert rectify(rig) is rectify(rig)


# rigs that cannot be made parallel


def test_views_of_different_size_are_refused() -> None:
    one, other = parallel_rig(size_px=(64, 48)), parallel_rig(size_px=(64, 40))
    with pytest.raises(PomologError, match=r"left view is .*64, 48.* right .*64, 40"):
        rectify(Rig(one.left, other.right, one.rotation, one.translation_m))


def test_one_camera_above_the_other_is_refused() -> None:
    ideal = parallel_rig()
    with pytest.raises(PomologError, match="cannot be made parallel"):
        rectify(Rig(ideal.left, ideal.right, np.eye(3), np.array([-0.01, -0.2, 0])))


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("turn_rad", [1.0, 1.6, 2.5, np.pi - 0.01])
def test_cameras_that_face_apart_are_refused(lens: LensModel, turn_rad: float) -> None:
    real = real_rig(lens)
    rotation = rotation_of((0, turn_rad, 0))
    translation_m = np.array([-0.2, 0, 0])
    with pytest.raises(PomologError, match="cannot be made parallel"):
        rectify(Rig(real.left, real.right, rotation, translation_m))


def test_lenses_of_two_kinds_are_refused() -> None:
    pinhole, fisheye = real_rig(), real_rig("kannala_brandt")
    with pytest.raises(PomologError, match="kannala_brandt"):
        rectify(Rig(pinhole.left, fisheye.right, pinhole.rotation, pinhole.translation_m))


def test_a_lens_of_no_numbers_at_all_is_straight() -> None:
    real = real_rig()
    bare = Camera(real.left.size_px, real.left.matrix, np.zeros(0))
    assert bare.straight
    rig = Rig(bare, bare, real.rotation, real.translation_m)
    parallel = rectify(rig)
    back = parallel.left.to_recorded(parallel.project("left", points()))
    assert np.abs(back - through_the_lens(rig, "left", points())).max() < 0.01  # as above


@pytest.mark.parametrize("name", REAL)
def test_hardly_anything_of_the_view_is_lost(name: str) -> None:
    size_px = REAL[name].left.size_px
    white = np.full((size_px[1], size_px[0], 3), 255, np.uint8)
    parallel = rectify(REAL[name])
    for side in SIDES:
        filled = (parallel.view(side).picture(white)[..., 0] > 0).mean()
        assert filled > 0.5, side  # at 3 degrees of toe-in most of the picture is still there


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("side", SIDES)
def test_recorded_points_are_rectified_to_where_they_came_from(name: str, side: Side) -> None:
    view = rectify(REAL[name]).view(side)
    width, height = view.camera.size_px
    inner = np.array([(x, y) for x in (0.3, 0.5, 0.7) for y in (0.35, 0.6)]) * (width, height)
    assert view.from_recorded(view.to_recorded(inner)) == pytest.approx(inner, abs=0.05)


@pytest.mark.parametrize("name", REAL)
def test_a_circle_comes_back_from_the_recorded_picture_with_its_radius(name: str) -> None:
    view = rectify(REAL[name]).left
    width, height = view.camera.size_px
    circle = np.array([[0.4 * width, 0.6 * height, 6.0]])
    back = view.circles_from_recorded(view.circles_to_recorded(circle))
    assert back == pytest.approx(circle, abs=0.1)  # the mean stretch is not the same both ways


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("side", SIDES)
def test_the_projection_shows_a_place_where_the_true_camera_does(name: str, side: Side) -> None:
    rectified = rectify(REAL[name])
    places = points()[:20]
    in_left_view = places @ rectified.left.rotation.T
    seen = np.column_stack([in_left_view, np.ones(len(places))]) @ rectified.projection(side).T
    recorded = rectified.view(side).to_recorded(seen[:, :2] / seen[:, 2:])
    assert recorded == pytest.approx(through_the_lens(REAL[name], side, places), abs=0.05)
