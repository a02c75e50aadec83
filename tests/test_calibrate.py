"""Calibration of cameras that are known: by corners with noise, and by rendered pictures."""

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from recorder.calibrate.adjust import rms_px
from recorder.calibrate.board import Board, Corners, parse_board
from recorder.calibrate.calibration import Calibration, calibrate
from recorder.calibrate.chessboard import find_chessboard
from recorder.calibrate.lens import LensName, turning_point
from recorder.calibrate.report import page
from recorder.calibrate.views import PicturePair, Sighting, sight, why_not
from recorder.errors import PomologError
from recorder.optics import to_pixels
from recorder.rig import Camera, LensModel, Rig
from tests.boards import CHARUCO, CHESSBOARD, Shown, poses, seen, sighting, wide_rig
from tests.builders import real_rig, rotation_of

RIGS: dict[LensModel, Rig] = {
    "plumb_bob": real_rig("plumb_bob", size_px=(480, 360)),
    "rational_polynomial": wide_rig(real_rig("rational_polynomial", size_px=(480, 360))),
    "kannala_brandt": wide_rig(real_rig("kannala_brandt", size_px=(480, 360))),
}
NAMES: dict[LensModel, LensName] = {
    "plumb_bob": "pinhole", "rational_polynomial": "rational", "kannala_brandt": "fisheye",
}  # fmt: skip


def agrees_with(found: Rig, truth: Rig) -> float:
    """The root mean square by which pixels of points all over the left picture differ."""
    width_px, height_px = truth.left.size_px
    x, y = np.meshgrid(np.linspace(0.2, 0.8, 5) * width_px, np.linspace(0.2, 0.8, 5) * height_px)
    matrix = truth.left.matrix
    rays = np.column_stack([
        (x.ravel() - matrix[0, 2]) / matrix[0, 0], (y.ravel() - matrix[1, 2]) / matrix[1, 1],
        np.ones(25),
    ])  # fmt: skip
    points_m = rays * 5 * truth.baseline_m
    off = [
        to_pixels(rig.right, points_m @ rig.rotation.T + rig.translation_m)
        - to_pixels(rig.left, points_m)
        for rig in (found, truth)
    ]
    return rms_px([off[0] - off[1]])


# corners with noise


@pytest.mark.parametrize("lens", RIGS)
def test_known_cameras_are_found_from_noisy_corners(lens: LensModel) -> None:
    rig = RIGS[lens]
    found = calibrate(sighting(rig, count=12), NAMES[lens])
    # 12 views of 54 corners, 0.15 px of noise an axis: what the jackknife says, four times
    for place, side in enumerate(("left", "right")):
        miss_px = found.rig.camera(side).matrix[0, 0] - rig.camera(side).matrix[0, 0]
        assert abs(miss_px) < 4 * found.trust.focal_std_px[place]
        assert found.trust.focal_std_px[place] < 0.01 * rig.camera(side).matrix[0, 0]
    assert abs(found.rig.baseline_m - rig.baseline_m) < 4 * found.trust.baseline_std_m
    assert found.trust.baseline_std_m < 0.005 * rig.baseline_m
    # two axes of 0.15 px
    assert found.fit.stereo_rms_px == pytest.approx(0.15 * np.sqrt(2), rel=0.08)
    assert agrees_with(found.rig, rig) < 0.3  # a pixel's third at any place of both pictures
    assert found.measures.spacing_m.median == pytest.approx(0.025, rel=0.004)
    assert not found.rejected


@pytest.mark.slow
def test_the_standard_deviations_are_as_large_as_the_errors() -> None:
    """The mean square of error over standard deviation is one; 10 draws scatter by a half."""
    rig = RIGS["plumb_bob"]
    squares = []
    for seed in range(10):
        found = calibrate(sighting(rig, count=10, seed=seed), "pinhole")
        error_px = found.rig.left.matrix[0, 0] - rig.left.matrix[0, 0]
        error_m = found.rig.baseline_m - rig.baseline_m
        squares += [
            (error_px / found.trust.focal_std_px[0]) ** 2,
            (error_m / found.trust.baseline_std_m) ** 2,
        ]
    assert 0.2 < np.mean(squares) < 2.5


def test_the_plain_lens_is_taken_where_it_fits() -> None:
    found = calibrate(sighting(RIGS["plumb_bob"]))
    assert found.fit.lens == "plumb_bob"
    assert "plain model fits" in found.choice.sentence
    assert set(found.choice.rms_px) == {"plumb_bob", "rational_polynomial", "kannala_brandt"}


def fisheye_rig() -> Rig:
    """160 degrees across, which a plain lens cannot follow."""
    matrix = np.array([[170.0, 0, 241], [0, 171, 178], [0, 0, 1]])
    lens = np.array([0.05, -0.01, 0.004, -0.001])
    camera = Camera((480, 360), matrix, lens, "kannala_brandt")
    return Rig(camera, camera, rotation_of((0.01, 0.02, -0.005)), np.array([-0.07, 0.001, 0.002]))


def test_a_richer_lens_is_taken_and_said_where_the_plain_one_does_not_fit() -> None:
    rig = fisheye_rig()
    big = replace(CHESSBOARD, square_m=0.04)
    found = calibrate(sighting(rig, board=big, count=16))
    assert found.fit.lens in ("kannala_brandt", "rational_polynomial")
    assert found.choice.rms_px["plumb_bob"] > 1.2 * found.fit.untrimmed_rms_px
    assert "plumb_bob" in found.choice.sentence
    assert found.rig.left.matrix[0, 0] == pytest.approx(170, rel=0.01)
    assert found.rig.baseline_m == pytest.approx(rig.baseline_m, rel=0.01)


def spoil(one: Sighting, place: int, change: Callable[[Corners], Corners]) -> Sighting:
    """A sighting with one view's right corners changed."""
    views = list(one.views)
    views[place] = replace(views[place], right=change(views[place].right))
    return replace(one, views=tuple(views))


def test_a_view_that_moved_between_the_pictures_is_named_and_left_out() -> None:
    clean = sighting(RIGS["plumb_bob"])
    bad = spoil(clean, 4, lambda c: replace(c, px=c.px + np.array([6.0, 4.0])))
    found = calibrate(bad, "pinhole")
    assert list(found.rejected) == ["view04"]
    assert "px" in found.rejected["view04"]
    assert len(found.fit.views) == 11
    assert found.fit.stereo_rms_px < 0.25
    assert found.as_json()["views_rejected"] == 1


def test_a_quarter_of_bad_views_is_left_out() -> None:
    bad = sighting(RIGS["plumb_bob"])
    for place, shift in ((1, 5.0), (5, -40.0), (8, 3.0)):
        bad = spoil(bad, place, lambda c, s=shift: replace(c, px=c.px + s))  # type: ignore[misc]
    found = calibrate(bad, "pinhole")
    assert sorted(found.rejected) == ["view01", "view05", "view08"]


def test_single_corners_in_the_wrong_place_are_left_out() -> None:
    def change(corners: Corners) -> Corners:
        px = corners.px.copy()
        px[7] += (9.0, -5.0)
        return replace(corners, px=px)

    clean = sighting(RIGS["plumb_bob"])
    found = calibrate(spoil(clean, 3, change), "pinhole")
    assert found.fit.corners_left_out == 1
    assert not found.rejected
    assert found.fit.untrimmed_rms_px > found.fit.stereo_rms_px


def test_corners_that_only_one_camera_sees_count_too() -> None:
    clean = sighting(RIGS["plumb_bob"])
    for place in range(6):
        clean = spoil(clean, place, lambda c: Corners(c.ids[20:], c.px[20:]))
    found = calibrate(clean, "pinhole")
    assert sum(len(part) for view in found.fit.residuals_px for part in view) == 12 * 108 - 6 * 20
    assert not found.rejected


def test_swapped_cameras_are_told() -> None:
    clean = sighting(RIGS["plumb_bob"])
    views = tuple(replace(v, left=v.right, right=v.left) for v in clean.views)
    with pytest.raises(PomologError, match="swapped"):
        calibrate(replace(clean, views=views))


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_mirrored_camera_is_told(side: str) -> None:
    """Corners of a mirrored picture, numbered as the finder numbers them: front side first."""

    def mirror(corners: Corners) -> Corners:
        px = np.column_stack([479 - corners.px[:, 0], corners.px[:, 1]])
        return Corners(corners.ids, px.reshape(6, 9, 2)[::-1].reshape(-1, 2))

    clean = sighting(RIGS["plumb_bob"])
    views = tuple(
        replace(v, left=mirror(v.left)) if side == "left" else replace(v, right=mirror(v.right))
        for v in clean.views
    )
    with pytest.raises(PomologError, match=f"the {side} pictures are mirrored"):
        calibrate(replace(clean, views=views))


@pytest.mark.parametrize(("shift", "word"), [(1, "later"), (-1, "earlier")])
def test_pairs_that_are_one_off_are_told(shift: int, word: str) -> None:
    clean = sighting(RIGS["plumb_bob"])
    rights = [view.right for view in clean.views]
    rights = rights[-shift:] + rights[:-shift]
    views = tuple(replace(v, right=r) for v, r in zip(clean.views, rights, strict=True))
    with pytest.raises(PomologError, match=f"do not belong together.*{word}"):
        calibrate(replace(clean, views=views))


def test_pairs_in_disorder_are_told() -> None:
    clean = sighting(RIGS["plumb_bob"])
    order = [5, 9, 3, 11, 0, 10, 1, 4, 2, 7, 6, 8]
    views = tuple(
        replace(v, right=clean.views[i].right) for v, i in zip(clean.views, order, strict=True)
    )
    with pytest.raises(PomologError, match="do not agree on where the right camera is"):
        calibrate(replace(clean, views=views))


def test_too_few_views_are_told_and_few_are_warned_of() -> None:
    few = sighting(RIGS["plumb_bob"], count=2)
    with pytest.raises(PomologError, match="too few views: both cameras see the board in 2 of 2"):
        calibrate(few)
    found = calibrate(sighting(RIGS["plumb_bob"], count=5), "pinhole")
    assert any("only 5 views" in line for line in found.warnings)


def test_a_square_of_the_wrong_size_is_warned_of() -> None:
    wrong = replace(CHESSBOARD, square_m=0.25)  # centimetres taken for ...
    found = calibrate(replace(sighting(RIGS["plumb_bob"]), board=wrong), "pinhole")
    assert found.rig.baseline_m == pytest.approx(2.0, rel=0.02)
    assert any("baseline of" in line and "unit" in line for line in found.warnings)


def test_a_board_at_one_angle_alone_is_told() -> None:
    rig = RIGS["plumb_bob"]
    clean = sighting(rig, count=8)
    generator = np.random.default_rng(1)
    views = []
    for view in clean.views:
        pose = np.concatenate([[0, 0, 0], generator.uniform((-0.15, -0.1, 0.55), (0, 0, 0.6))])
        corners = [
            Corners(np.arange(54), px + generator.normal(0, 0.15, px.shape))
            for px in (seen(CHESSBOARD, pose, rig, side) for side in ("left", "right"))
        ]
        views.append(replace(view, left=corners[0], right=corners[1]))
    with pytest.raises(PomologError, match="seen at one angle"):
        calibrate(replace(clean, views=tuple(views)), "pinhole")


def test_the_expected_error_grows_with_the_distance() -> None:
    found = calibrate(sighting(RIGS["plumb_bob"]), "pinhole")
    errors = [error.calibration_m for error in found.trust.errors]
    assert all(a < b for a, b in pairwise(errors))
    metre = next(error for error in found.trust.errors if error.range_m == 1.0)
    rig = found.rig
    # Z^2 / (f B) for a pixel
    assert metre.matching_m[1] == pytest.approx(1 / (rig.left.matrix[0, 0] * rig.baseline_m))


def test_a_lens_that_turns_back_is_seen() -> None:
    matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    turning = Camera((640, 480), matrix, np.array([-0.5, 0, 0, 0, 0]))
    # r - 0.5 r^3 turns at r = sqrt(2 / 3)
    angle, radius_px = turning_point(turning)
    assert np.tan(angle) == pytest.approx(np.sqrt(2 / 3), abs=2e-3)  # a table of 2000 angles
    assert radius_px == pytest.approx(500 * np.sqrt(2 / 3) * (2 / 3), rel=1e-3)
    assert turning_point(Camera((640, 480), matrix)) == (np.inf, np.inf)


# the report and the JSON


@pytest.fixture(scope="module")
def found() -> Calibration:
    bad = spoil(
        sighting(RIGS["plumb_bob"]), 4, lambda c: replace(c, px=c.px + np.array([6.0, 4.0]))
    )
    return calibrate(bad)


def test_the_json_has_the_form_that_others_rely_on(found: Calibration) -> None:
    said = json.loads(json.dumps(found.as_json(), allow_nan=False))
    assert said["baseline_m"] == found.rig.baseline_m
    assert said["left"]["focal_px"] == found.rig.left.matrix[0, 0]
    assert {"focal_px", "rms_px"} <= set(said["right"])
    assert said["stereo_rms_px"] == found.fit.stereo_rms_px
    assert said["rectified_row_px"] == found.measures.row_rms_px
    assert (said["views_used"], said["views_rejected"]) == (11, 1)
    assert said["rejected"][0]["view"] == "view04"


def test_the_report_says_everything_and_needs_no_other_file(found: Calibration) -> None:
    text = page(found)
    for words in ("Where the board was seen", "by place", "by view", "Rectified rows",
                  "Known lengths", "distance error to expect", "view04", "1500"):  # fmt: skip
        assert words in text
    assert "src=" not in text
    assert "http" not in text
    assert "nan" not in text.lower().replace("nano", "")
    assert len(text) < 1_500_000


# pictures


@pytest.mark.slow
@pytest.mark.parametrize("lens", RIGS)
def test_known_cameras_are_found_from_rendered_pictures(lens: LensModel) -> None:
    rig = RIGS[lens]
    shown = Shown(rig, CHESSBOARD, poses(CHESSBOARD, rig, 9, seed=5))
    found = calibrate(sight(CHESSBOARD, shown), NAMES[lens])
    assert len(found.fit.views) >= 8  # of 9; squares of ten pixels are not always found
    assert found.fit.stereo_rms_px < 0.12  # squares of 20 px, blurred by 0.6 px, noise of 1.5
    assert found.rig.left.matrix[0, 0] == pytest.approx(rig.left.matrix[0, 0], rel=0.004)
    assert found.rig.baseline_m == pytest.approx(rig.baseline_m, rel=0.004)
    assert agrees_with(found.rig, rig) < 0.3
    assert found.measures.row_rms_px < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("legacy", [False, True])
def test_a_charuco_board_is_found_in_either_pattern_and_partly_hidden(legacy: bool) -> None:
    rig = RIGS["plumb_bob"]
    board = parse_board("charuco:8x6:30mm:22mm")  # an even number of rows: two patterns exist
    shown = Shown(rig, board, poses(board, rig, 6, seed=2), legacy=legacy)
    hidden = shown.pairs[1].left.copy()
    px = seen(board, poses(board, rig, 6, seed=2)[1], rig, "left")
    x, y = np.rint(px[:10].mean(axis=0)).astype(int)
    hidden[: y + 5, : x + 5] = 90  # a corner of the board is behind something
    shown.pairs[1] = replace(shown.pairs[1], left=hidden)
    here = sight(board, shown)
    assert here.pattern is not None
    assert here.pattern.legacy == legacy
    assert here.pattern.dictionary.startswith("DICT_4X4")
    assert here.pattern.marker_share == pytest.approx(22 / 30, rel=0.08)  # seen small
    assert 0 < len(here.views[1].left) < 35
    found = calibrate(here, "pinhole")
    assert len(found.fit.views) == 6
    # six views of a small board: to what they themselves say, and to one and a half percent
    assert abs(found.rig.baseline_m - rig.baseline_m) < 4 * found.trust.baseline_std_m
    assert found.rig.baseline_m == pytest.approx(rig.baseline_m, rel=0.015)


def one_pair(board: Board = CHESSBOARD, count: int = 1) -> Shown:
    rig = RIGS["plumb_bob"]
    return Shown(rig, board, poses(board, rig, count, seed=5))


def test_empty_and_blurred_pictures_are_told_apart() -> None:
    shown = one_pair(count=4)
    black, soft = (
        np.full((360, 480), 3, np.uint8),
        cv2.GaussianBlur(shown.pairs[1].right, (0, 0), 9),
    )
    shown.pairs[0] = replace(shown.pairs[0], left=black)
    shown.pairs[1] = replace(shown.pairs[1], right=np.asarray(soft, np.uint8))
    here = sight(CHESSBOARD, shown)
    reasons = [why_not(view, here) for view in here.views]
    assert reasons == ["the left picture is empty", "the right picture is blurred", "", ""]


def test_a_chessboard_of_another_size_is_told_with_its_size() -> None:
    with pytest.raises(PomologError, match="but one of 9x6"):
        sight(replace(CHESSBOARD, columns=8), one_pair())
    with pytest.raises(PomologError, match="but one of 9x6"):
        sight(replace(CHESSBOARD, rows=7), one_pair())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("charuco:9x5:30mm:22mm", "as on one that is 8 wide"),
        ("charuco:5x8:30mm:22mm", "exchanged"),
        ("charuco:8x5:30mm:22mm:5x5", "4X4"),
        ("charuco:8x5:30mm:22mm:9x9", "no marker dictionary"),
    ],
)
def test_another_charuco_board_is_told(text: str, words: str) -> None:
    with pytest.raises(PomologError, match=words):
        sight(parse_board(text), one_pair(CHARUCO, 2))


def test_mirrored_markers_are_told() -> None:
    shown = one_pair(CHARUCO, 2)
    shown.pairs = [replace(p, right=np.ascontiguousarray(p.right[:, ::-1])) for p in shown.pairs]
    with pytest.raises(PomologError, match="the right pictures are mirrored"):
        sight(CHARUCO, shown)


def test_pictures_of_two_sizes_are_told() -> None:
    shown = one_pair(count=2)
    shown.pairs[1] = PicturePair("small", shown.pairs[1].left, shown.pairs[1].right[:100])
    with pytest.raises(PomologError, match=r"right picture of small is 480 x 100 px"):
        sight(CHESSBOARD, shown)


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_a_chessboard_is_numbered_alike_however_it_is_turned(turn: int) -> None:
    rig = RIGS["plumb_bob"]
    pose = np.array([0.1, -0.2, 0.05, -0.12, -0.08, 0.5])
    flat = Shown(rig, CHESSBOARD, [pose]).pairs[0].left
    turned = np.ascontiguousarray(np.rot90(flat, turn))
    corners = find_chessboard(turned, CHESSBOARD)
    (x, y), (height, width) = corners.px.T, turned.shape
    back = [(x, y), (height - 1 - y, x), (width - 1 - x, height - 1 - y), (y, width - 1 - x)][turn]
    np.testing.assert_allclose(
        np.column_stack(back), seen(CHESSBOARD, pose, rig, "left"), rtol=0, atol=0.2
    )


# the board, as a user writes it


def test_a_board_is_read_as_it_is_written() -> None:
    for text in ("chessboard:9x6:25mm", "charuco:31x16:49.33mm:38.46mm:4x4_250"):
        assert str(parse_board(text)) == text
    assert parse_board("charuco:31x16:4.933cm:0.03846m").square_m == pytest.approx(0.04933)
    assert parse_board("charuco:31x16:49.33mm:38.46mm").columns == 30
    np.testing.assert_allclose(parse_board("chessboard:9x6:25mm").points_m[10], (0.025, 0.025, 0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "give --board"), ("circles:9x6:25mm", "give --board"), ("chessboard", "give --board"),
        ("chessboard:9x6", "give chessboard"), ("chessboard:9:25mm", "like 9x6"),
        ("chessboard:9x2:25mm", "like 9x6"), ("chessboard:900x6:25mm", "like 9x6"),
        ("chessboard:9x6:25", "with its unit"), ("chessboard:9x6:-25mm", "with its unit"),
        ("chessboard:9x6:25m", "were millimetres meant"),
        ("chessboard:9x6:0.025mm", "were metres meant"),
        ("charuco:31x16:49.33mm", "give chessboard"),
        ("charuco:31x16:38.46mm:49.33mm", "smaller than its square"),
    ],
)  # fmt: skip
def test_a_mistake_in_the_board_is_told(text: str, words: str) -> None:
    with pytest.raises(PomologError, match=words):
        parse_board(text)
