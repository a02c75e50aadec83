"""`pomolog calibrate` and `pomolog rig convert` as a user runs them, and others' picture sets."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from recorder.calibrate.cli import app
from recorder.calibrate.sources import source_of
from recorder.errors import PomologError
from recorder.records import SIDES, Frame, RangeReading
from recorder.rig import Rig, load_rig
from recorder.rig_files import write_rig
from recorder.session_writer import SessionWriter
from tests.boards import CHESSBOARD, Shown, poses
from tests.builders import DATA, SECOND_NS, rangefinder, real_rig, rotation_of

RIG = real_rig(size_px=(480, 360), beam=True)
BOARDS = DATA / "opencv_chessboard"


def run(*words: object) -> Result:
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def board_session(path: Path, rig: Rig, count: int = 8) -> Path:
    """A session of a board before the rig, with readings of its beam on the board's plane."""
    found = poses(CHESSBOARD, rig, count, seed=5)
    beam = rangefinder()
    shown = Shown(rig, CHESSBOARD, found)
    with SessionWriter.create(path, rig, {}) as session:
        for index, (pair, pose) in enumerate(zip(shown.pairs, found, strict=True)):
            time_ns = index * SECOND_NS
            for side, grey in zip(SIDES, (pair.left, pair.right), strict=True):
                data = cv2.imencode(".png", cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))[1].tobytes()
                session.write_frame(Frame(side, time_ns, "png", data, rig.left.size_px, index))
            normal = rotation_of(pose[:3].tolist())[:, 2]
            range_m = float(normal @ (pose[3:] - beam.origin_m) / (normal @ beam.direction))
            session.write_reading(RangeReading(time_ns + 1000, range_m, 0.002, "ok", ""))
    return path


@pytest.mark.slow
def test_a_session_of_a_board_gives_cameras_and_beam(tmp_path: Path) -> None:
    session = board_session(tmp_path / "boards.mcap", RIG)
    words = ("calibrate", session, "--board", "chessboard:9x6:25mm", "--rangefinder")
    out, report = tmp_path / "rig.toml", tmp_path / "report.html"
    result = run(*words, "-o", out, "--report", report)
    assert result.exit_code == 0
    assert "8 of 8 views used" in result.stdout
    found = load_rig(out)
    assert found.rangefinder is not None
    assert found.left.matrix[0, 0] == pytest.approx(RIG.left.matrix[0, 0], rel=0.004)
    assert found.baseline_m == pytest.approx(RIG.baseline_m, rel=0.004)
    aim = float(found.rangefinder.direction @ rangefinder().direction)
    assert np.arccos(min(1.0, aim)) < np.deg2rad(1.0)  # 9 mm at half a metre
    assert "The rangefinder" in report.read_text()


def test_a_rig_is_converted_and_back(tmp_path: Path) -> None:
    write_rig(RIG, tmp_path / "rig.toml")
    assert run("rig", "convert", tmp_path / "rig.toml", "-o", tmp_path / "ros").exit_code == 0
    pair = [tmp_path / "ros" / f"{side}.yaml" for side in ("left", "right")]
    result = run("rig", "convert", *pair, "-o", tmp_path / "again.toml")
    assert result.exit_code == 0
    assert result.stdout.strip() == str(tmp_path / "again.toml")
    np.testing.assert_allclose(
        load_rig(tmp_path / "again.toml").translation_m, RIG.translation_m, rtol=0, atol=1e-14
    )
    result = run("rig", "convert", *pair, "-o", tmp_path / "x.yaml", "--to", "opencv")
    assert load_rig(tmp_path / "x.yaml").left.size_px == (480, 360)
    with pytest.raises(PomologError, match="in two of ROS"):
        run("rig", "convert", *pair, pair[0], "-o", tmp_path / "x.toml")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nowhere", "nowhere", "--board", "chessboard:9x6:25mm"), "no nowhere"),
        ((".", "--board", "chessboard:9x6:25mm", "--lens", "wide"), "no lens 'wide'"),
        ((".",), "no board"),
        ((".", "--board", "chessboard:9x6:25mm", "-o", "rig.xml"), "rig.xml"),
        ((".", "--rangefinder"), "labelled session"),
    ],
)
def test_a_mistake_is_told_before_any_work(words: tuple[str, ...], message: str) -> None:
    with pytest.raises(PomologError, match=message):
        run("calibrate", *words)


def folders(folder: Path, lefts: list[str], rights: list[str]) -> list[Path]:
    for side, names in (("left", lefts), ("right", rights)):
        (folder / side).mkdir()
        for name in names:
            cv2.imwrite(str(folder / side / name), np.zeros((9, 9), np.uint8))
    return [folder / "left", folder / "right"]


def test_a_picture_without_a_partner_is_named(tmp_path: Path) -> None:
    paths = folders(tmp_path, ["left1.png", "left2.png", "left3.png"], ["right1.png", "right3.png"])
    with pytest.raises(PomologError, match=r"3 pictures .* 2 .*without a partner: left2\.png"):
        source_of(paths)


def test_as_many_pictures_of_other_views_are_not_paired(tmp_path: Path) -> None:
    paths = folders(tmp_path, ["left1.png", "left2.png"], ["right1.png", "right3.png"])
    with pytest.raises(PomologError, match="do not hold the same views: left2"):
        source_of(paths)


def test_pictures_of_both_views_are_taken_from_one_folder_or_from_two(tmp_path: Path) -> None:
    paths = folders(tmp_path, ["a1.png", "a2.png"], ["b1.png", "b2.png"])
    assert source_of(paths).total == source_of([tmp_path]).total == 2
    flat = tmp_path / "flat"
    flat.mkdir()
    for name in ("Left10.png", "Left2.png", "Right10.png", "Right2.png", "notes.txt"):
        (flat / name).write_bytes((tmp_path / "left" / "a1.png").read_bytes())
    pairs = source_of([flat]).files
    assert [[p.name for p in pair] for pair in pairs] == [
        ["Left2.png", "Right2.png"], ["Left10.png", "Right10.png"],
    ]  # fmt: skip


def test_many_pairs_are_thinned_evenly(tmp_path: Path) -> None:
    names = [f"{i}.png" for i in range(9)]
    assert source_of(folders(tmp_path, names, names), 5).chosen == (0, 2, 4, 6, 8)


# others' pictures


def needs(path: Path) -> None:
    if not path.exists():
        pytest.skip(f"NOT TESTED: no {path}")


@pytest.mark.slow
def test_opencvs_chessboards_are_calibrated_as_well_as_by_opencv(tmp_path: Path) -> None:
    needs(BOARDS)
    write_rig(RIG, tmp_path / "rig.toml")  # by a ruler; its beam is to stay
    result = run("calibrate", BOARDS, "--board", "chessboard:9x6:25mm", "--json",
                 "-o", tmp_path / "rig.toml")  # fmt: skip
    said = json.loads(result.stdout)
    assert said["views_used"] == 13
    assert said["stereo_rms_px"] <= 0.217  # OpenCV's own, by the set's README
    assert said["spacing"]["median_m"] == pytest.approx(0.025, rel=0.005)
    written = load_rig(tmp_path / "rig.toml")
    assert written.baseline_m == said["baseline_m"]
    assert written.rangefinder is not None
    assert "stays as it was" in result.stderr


@pytest.mark.slow
def test_one_spoilt_picture_is_named_and_moves_little(tmp_path: Path) -> None:
    needs(BOARDS)
    for path in BOARDS.glob("*.jpg"):
        shutil.copy(path, tmp_path)
    shutil.copy(tmp_path / "right08.jpg", tmp_path / "right07.jpg")
    said = json.loads(run("calibrate", tmp_path, "--board", "chessboard:9x6:25mm", "--json").stdout)
    assert [one["view"] for one in said["rejected"]] == ["left07"]
    assert said["baseline_m"] == pytest.approx(0.08319, rel=0.005)  # of all thirteen


@pytest.mark.slow
def test_the_charuco_pairs_give_what_was_published() -> None:
    folder = DATA / "charuco_stereo"
    needs(folder)
    result = run("calibrate", folder / "left", folder / "right", "--json",
                 "--board", "charuco:31x16:49.33mm:38.46mm")  # fmt: skip
    said = json.loads(result.stdout)
    assert said["left"]["focal_px"] == pytest.approx(575, rel=0.01)
    assert said["baseline_m"] == pytest.approx(0.0750, rel=0.01)
    assert said["stereo_rms_px"] < 0.34
    assert said["spacing"]["median_m"] == pytest.approx(0.04933, rel=0.002)
    assert said["lens"] == "rational_polynomial"


@pytest.mark.slow
def test_the_real_trees_rows_agree() -> None:
    folder = DATA / "story_orchard"
    needs(folder)
    from benchmarks.calibration import tree_rows_px

    rows = tree_rows_px(folder)
    assert len(rows) > 50
    assert np.median(np.abs(rows)) < 0.7
