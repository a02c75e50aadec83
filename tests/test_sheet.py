"""`pomolog sheet`: every stage of one frame in one picture, drawn where it must be."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from processor.methods import METHODS
from processor.palette import ALONE, ESTIMATE, FALSE, HIT, MISSED, REJECTED, TRUTH, VERDICTS, Colour
from processor.replay import replay
from processor.rims import Bytes
from recorder.records import SIDES, UNCOUNTED, Frame, FrameTruth
from recorder.rig import Camera, Rig
from recorder.session_writer import SessionWriter
from tests.scenes import apple, draw, encoded, painted, small_rig, stereo_session
from tests.test_processor_cli import Command, assert_one_line
from viewer.report_columns import columns_of
from viewer.sheet import Sheet, make_sheet
from viewer.sheet_panels import against_truth, brightened, match_colours, match_verdict
from viewer.sheet_table import MOST_ROWS, height_px, missed, told

STAGES = {"recorded", "index", "mask", "cleaned", "circles", "match"}
# the second apple is too small for the paper's window of radii: missed
FRAMES = [[apple(1, -0.03, seen=1.0), apple(2, 0.06, 0.05, z_m=0.9, seen=1.0)]]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return Command(monkeypatch, capsys)


def replayed(tmp_path: Path, frames: Any = FRAMES, method: str = "paper", **how: Any) -> Path:
    session = stereo_session(tmp_path / "row.mcap", frames, **how)
    tuple(replay([session], tmp_path / "out", METHODS[method], method=method, rrd="none"))
    return tmp_path / "out" / "row"


def unpaired(tmp_path: Path, how: str, method: str = "paper") -> Path:
    """Results of a session whose labels name apples apart in each view, or in one view alone."""
    rig = small_rig()
    drawn = {side: draw(rig, side, FRAMES[0]) for side in SIDES}
    with SessionWriter.create(tmp_path / "row.mcap", rig) as writer:
        for side in SIDES:
            writer.write_frame(Frame(side, 0, "png", encoded(drawn[side][0]), (320, 240), 0))
        right = drawn["right"][1] if how == "apart" else None
        writer.write_truth(0, FrameTruth(drawn["left"][1], right, shared=how != "apart"))
    locator = METHODS[method]
    tuple(replay([tmp_path / "row.mcap"], tmp_path / "out", locator, method=method, rrd="none"))
    return tmp_path / "out" / "row"


def pixels_of(sheet: Sheet) -> Bytes:
    """RGB."""
    found = cv2.imdecode(np.frombuffer(sheet.png, np.uint8), cv2.IMREAD_COLOR)
    assert found is not None
    return np.asarray(found[..., ::-1], np.uint8)


def panel(sheet: Sheet, name: str, side: str = "left") -> Bytes:
    (box,) = (p["box_px"] for p in sheet.told["panels"] if (p["name"], p["side"]) == (name, side))
    x, y, width, height = box
    return pixels_of(sheet)[y : y + height, x : x + width]


def count(pixels: Bytes, colour: Colour, slack: int = 12) -> int:
    return int((np.abs(pixels.astype(int) - colour) <= slack).all(axis=2).sum())


def at(pixels: Bytes, x_px: float, y_px: float) -> list[int]:
    """The pixel there, in pixels of the 320 x 240 picture."""
    scale = pixels.shape[1] / 320
    return [int(v) for v in pixels[round(y_px * scale), round(x_px * scale)]]


@pytest.mark.parametrize("method", ["paper", "pomolog"])
def test_every_stage_has_a_panel_of_both_views(method: str, tmp_path: Path) -> None:
    sheet = make_sheet(replayed(tmp_path, method=method), 0)
    shown = {(p["name"], p["side"]) for p in sheet.told["panels"]}
    assert {(name, side) for name in STAGES for side in ("left", "right")} <= shown
    assert (("correlation", "both") in shown) == (method == "paper")
    height, width = pixels_of(sheet).shape[:2]
    assert [width, height] == sheet.told["size_px"]
    for one in sheet.told["panels"]:
        x, y, across, down = one["box_px"]
        assert 0 <= x < x + across <= width
        assert 0 <= y < y + down <= height
        if one["name"] != "index":
            assert panel(sheet, one["name"], one["side"]).std() > 5, one["name"]


def test_what_was_hit_and_missed_has_its_colour_where_the_apple_is(tmp_path: Path) -> None:
    sheet = make_sheet(replayed(tmp_path), 0)
    mask = panel(sheet, "mask")
    # apple 1 at 159.5 - 30, apple 2 at 159.5 + 27, 119.5 + 22
    assert at(mask, 129.5, 119.5) == list(HIT)
    cleaned = panel(sheet, "cleaned")
    assert at(cleaned, 129.5, 119.5) == list(HIT)
    assert count(cleaned, FALSE) == 0
    assert count(panel(sheet, "recorded"), HIT) == 0


def test_circles_and_truth_are_drawn_where_they_are(tmp_path: Path) -> None:
    sheet = make_sheet(replayed(tmp_path), 0)
    circles = panel(sheet, "circles")
    assert count(circles, ESTIMATE) > 200
    scale = circles.shape[1] / 320
    around = circles[:, round((186.2 - 25) * scale) : round((186.2 + 25) * scale)]
    assert count(around, TRUTH) > 60  # the small one, that has no circle of its own
    assert sheet.told["missed"] == [2]
    (found,) = sheet.told["apples"]
    assert found["verdict"] == "right"
    assert found["true_m"] == pytest.approx(np.hypot(0.03, 0.4))
    assert abs(found["error_m"]) < 0.02


def test_matches_are_joined_over_both_views_in_the_colour_of_the_verdict(tmp_path: Path) -> None:
    sheet = make_sheet(replayed(tmp_path), 0)
    boxes = {p["side"]: p["box_px"] for p in sheet.told["panels"] if p["name"] == "match"}
    left_end = boxes["left"][0] + boxes["left"][2]
    gap = pixels_of(sheet)[
        boxes["left"][1] : boxes["left"][1] + boxes["left"][3], left_end : boxes["right"][0]
    ]
    assert count(gap, VERDICTS["right"], slack=60) >= gap.shape[1]  # a line crosses from the left
    assert count(gap, VERDICTS["wrong"], slack=60) == 0


def test_without_truth_there_is_no_verdict(tmp_path: Path) -> None:
    sheet = make_sheet(replayed(tmp_path, truth=False), 0)
    assert not sheet.told["scored"]
    assert sheet.told["missed"] == []
    for name in STAGES:
        assert not any(count(panel(sheet, name), c, slack=3) for c in (HIT, FALSE, MISSED)), name
    assert count(panel(sheet, "circles"), TRUTH) == 0
    assert at(panel(sheet, "mask"), 129.5, 119.5) == [255, 255, 255]
    assert count(panel(sheet, "match"), ESTIMATE) > 200


@pytest.mark.parametrize("how", ["apart", "one view"])
def test_truth_that_does_not_pair_the_views_gives_matches_no_verdict(
    how: str, tmp_path: Path
) -> None:
    sheet = make_sheet(unpaired(tmp_path, how), 0)
    assert sheet.told["scored"]
    assert not sheet.told["matches_scored"]
    assert [row["verdict"] for row in sheet.told["apples"]] == [None]
    assert count(panel(sheet, "match"), ESTIMATE) > 100
    assert not any(count(panel(sheet, "match"), c, slack=3) for c in VERDICTS.values())
    assert at(panel(sheet, "mask"), 129.5, 119.5) == list(HIT)


def test_a_report_draws_no_curve_of_circles_that_the_truth_does_not_name(tmp_path: Path) -> None:
    (column,) = columns_of([unpaired(tmp_path, "apart", "pomolog")])
    assert column.score.fruit is not None
    assert column.circles.wanted is None


def test_a_frame_without_fruit_is_drawn_too(tmp_path: Path) -> None:
    for method in ("paper", "pomolog"):
        sheet = make_sheet(replayed(tmp_path / method, [[]], method), 0)
        assert sheet.told["apples"] == []
        assert count(panel(sheet, "circles"), ESTIMATE) == 0


def test_a_rig_that_is_not_parallel_shows_what_was_recorded_and_what_was_rectified(
    tmp_path: Path,
) -> None:
    rig = small_rig()
    bent = Rig(
        replace(rig.left, distortion=np.array([-0.3, 0.1, 0.0, 0.0, 0.0])),
        rig.right, rig.rotation, rig.translation_m, None,
    )  # fmt: skip
    assert isinstance(bent.left, Camera)
    sheet = make_sheet(replayed(tmp_path, rig=bent), 0)
    recorded, rectified = panel(sheet, "recorded"), panel(sheet, "circles")
    assert recorded.shape == rectified.shape
    apple_px = draw(bent, "left", FRAMES[0])[1] == 1
    row, column = (int(v.mean()) for v in np.nonzero(apple_px))
    assert at(recorded, column, row)[0] > 150  # the apple is red where it was recorded


def test_partial_truth_marks_what_nobody_labelled_as_neither() -> None:
    labels = np.zeros((4, 4), np.uint16)
    labels[0], labels[1] = 1, UNCOUNTED
    mask = np.full((4, 4), 255, np.uint8)
    mask[0, 0] = 0
    picture = painted(mask)
    whole = against_truth(picture, mask, labels, partial=False)[..., ::-1]
    colours = [tuple(whole[place].tolist()) for place in ((0, 0), (0, 1), (1, 0), (2, 0))]
    assert colours == [MISSED, HIT, REJECTED, FALSE]
    partly = against_truth(picture, mask, labels, partial=True)[..., ::-1]
    assert tuple(partly[2, 0].tolist()) == REJECTED


def test_a_dark_index_is_brightened_and_a_bright_one_left_alone() -> None:
    dark = np.zeros((100, 100), np.uint8)
    dark[:10] = 51
    shown, gain = brightened(dark)
    assert (int(shown.max()), gain) == (255, 5.0)
    bright = np.where(dark > 0, 255, 0).astype(np.uint8)
    assert brightened(bright) == (bright, 1.0)
    assert brightened(np.zeros((9, 9), np.uint8))[0].max() == 0


@pytest.mark.parametrize(
    ("ids", "false", "verdict"),
    [
        ((1, 1), (False, False), "right"),
        ((1, 2), (False, False), "wrong"),
        ((1, None), (False, True), "wrong"),
        ((None, None), (True, True), "false"),
        ((None, None), (False, True), "not counted"),
        ((None, None), (None, None), "not counted"),
    ],
)
def test_a_match_has_one_verdict(ids: Any, false: Any, verdict: str) -> None:
    row = dict(zip(("left_truth", "right_truth"), ids, strict=True))
    row |= dict(zip(("left_false", "right_false"), false, strict=True))
    assert match_verdict(row) == verdict
    colour = {"right": HIT, "not counted": REJECTED}.get(verdict, FALSE)
    assert match_colours([{"apple": 3, **row}], scored=True) == {3: colour}


def test_the_table_has_matched_apples_and_names_the_missed() -> None:
    alone = {"apple": 1, "left_x_px": 3.0, "right_x_px": None, "left_truth": 4}
    both = {
        "apple": 0, "left_x_px": 3.0, "right_x_px": 1.0, "left_truth": 4, "right_truth": 5,
        "left_false": False, "right_false": False,
    }  # fmt: skip
    (row,) = told([both, alone], [{"apple_id": 4, "distance_m": 1.0, "error_m": 0.1}])
    assert (row["verdict"], row["true"], row["true_m"]) == ("wrong", "4 / 5", None)
    true = {"apple_id": 9, "match": "missed", "found_left": True, "found_right": False}
    assert missed([true, {**true, "match": "right"}]) == ["9 (found in the left view alone)"]
    assert height_px([row] * 500) - height_px([row] * MOST_ROWS) < 40


def test_the_command_writes_a_png_and_says_what_is_on_it(command: Command, tmp_path: Path) -> None:
    out = replayed(tmp_path, FRAMES * 2)
    picture = tmp_path / "s.png"
    said = command("sheet", out, "--frame", 1, "-o", picture, "--json").json
    assert (said["frame"], said["session"], said["method"]) == (1, "row", "paper")
    assert said["sheet"] == str(picture)
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert json.dumps(said["apples"])
    before = picture.read_bytes()
    assert command("sheet", out.parent, "--frame", 1, "-o", picture).code == 0  # the only session
    assert picture.read_bytes() == before


def test_wrong_input_is_one_line_and_leaves_nothing(command: Command, tmp_path: Path) -> None:
    out = replayed(tmp_path)
    picture = tmp_path / "s.png"
    assert_one_line(command("sheet", out, "--frame", 7, "-o", picture), "no frame 7", "0")
    stereo_session(tmp_path / "two.mcap", FRAMES)
    tuple(replay([tmp_path / "two.mcap"], out.parent, METHODS["paper"], rrd="none"))
    assert_one_line(command("sheet", out.parent, "--frame", 0, "-o", picture), "2 sessions", "two")
    (tmp_path / "row.mcap").unlink()
    assert_one_line(command("sheet", out, "--frame", 0, "-o", picture), "row.mcap", "--session")
    assert not list(tmp_path.glob("s.png*"))


def test_fruit_without_a_partner_has_its_own_colour(tmp_path: Path) -> None:
    # 60 px of disparity at 0.4 m: this one is beyond the right view's edge
    frames = [[apple(1, -0.14, seen=None), apple(2, 0.05, seen=1.0)]]
    sheet = make_sheet(replayed(tmp_path, frames, "pomolog"), 0)
    assert count(panel(sheet, "circles"), ALONE) > 100
