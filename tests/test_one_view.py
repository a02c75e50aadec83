"""Sessions of one camera, with and without depth: written, read, looked after, salvaged, scored."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from typer.testing import CliRunner

from processor.replay import replay
from processor.runs import find_runs, score_runs
from recorder.check import check
from recorder.cli import app
from recorder.imports.cli import app as imports
from recorder.imports.labels import LabelTruth
from recorder.imports.masks import MaskTruth, label_session
from recorder.imports.shapes import PictureLabels, Shape
from recorder.message_writer import MessageWriter
from recorder.one_view import ONE_VIEW, nominal_camera, one_view_rig
from recorder.pictures import decode
from recorder.records import AppleTruth, Depth, Encoding, Frame, FrameTruth
from recorder.salvage import salvage
from recorder.session import Session
from recorder.session_writer import SessionWriter
from tests.builders import SECOND_NS, frame, picture_folders
from tests.mcap_files import records_in, torn
from tests.scenes import TINY, apple, draw, tiny_rig
from tests.scenes import encoded as drawn
from tests.test_profile import rerun_columns

SIZE_PX = (64, 48)


def one_view(folder: Path, count: int = 3, *, encoding: Encoding = "png", late_ns: int = 0) -> Path:
    """Pictures a second apart, each in a chunk of its own, with depth."""
    path = folder / "one.mcap"
    raw = encoding not in ("png", "jpeg")
    rig = one_view_rig(nominal_camera(SIZE_PX))
    with SessionWriter.create(path, rig, ONE_VIEW, raw_images=raw) as writer:
        writer.add_metadata("pictures", {"left": "\n".join(f"{n}.png" for n in range(count))})
        for index in range(count):
            time_ns = index * SECOND_NS
            writer.write_frame(frame("left", time_ns, encoding, seed=index))
            steps = np.full(SIZE_PX[::-1], 1000 + index, "<u2")
            writer.write_depth(Depth(time_ns + late_ns, "16UC1", steps.tobytes(), SIZE_PX))
            writer.sync()
    return path


def test_a_session_of_one_view_reads_with_a_black_right_one(tmp_path: Path) -> None:
    with Session(one_view(tmp_path)) as session:
        assert session.one_view
        pairs = list(session.pairs())
        assert (len(session), session.info().pairs, session.info().frames) == (3, 0, 3)
    for index, pair in enumerate(pairs):
        assert decode(pair.left).any()
        assert not decode(pair.right).any()
        assert pair.right.size_px == pair.left.size_px
        assert pair.depth is not None
        assert (pair.depth.metres() == (1000 + index) / 1000).all()


def test_rerun_opens_depth_natively(tmp_path: Path) -> None:
    columns = rerun_columns(one_view(tmp_path))
    assert {"Image:buffer", "Image:format"} <= columns["/depth"]


def test_depth_belongs_to_the_picture_of_its_moment_only(tmp_path: Path) -> None:
    with Session(one_view(tmp_path, late_ns=4_000_000)) as session:
        assert all(pair.depth is not None for pair in session.pairs())
    path = one_view(tmp_path, late_ns=6_000_000)
    with Session(path) as session:
        assert all(pair.depth is None for pair in session.pairs())
    texts = [(f.level, f.text) for f in check(path)]
    assert ("warning", "3 depth pictures, 0 of them at a left picture's moment") in texts


@pytest.mark.parametrize("late_ms", [(1, 3), (3, 1), (-1, 3), (-3, 1)])
def test_of_two_depth_pictures_the_nearer_is_taken(
    tmp_path: Path, late_ms: tuple[int, int]
) -> None:
    path = tmp_path / "one.mcap"
    with SessionWriter.create(path, one_view_rig(nominal_camera(SIZE_PX)), ONE_VIEW) as writer:
        writer.write_frame(frame("left", SECOND_NS))
        for late in late_ms:
            steps = np.full(SIZE_PX[::-1], 1000 + late, "<u2")
            time_ns = SECOND_NS + late * 1_000_000
            writer.write_depth(Depth(time_ns, "16UC1", steps.tobytes(), SIZE_PX))
    with Session(path) as session:
        (pair,) = session.pairs()
    assert pair.depth is not None
    assert pair.depth.time_ns == SECOND_NS + min(late_ms, key=abs) * 1_000_000


def test_no_apple_is_visible_in_a_view_that_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    with SessionWriter.create(path, one_view_rig(nominal_camera(SIZE_PX)), ONE_VIEW) as writer:
        writer.write_frame(frame("left", 0))
        seen = AppleTruth(1, (0.1, -0.05, 1.2), 0.04, left_visible=1.0, right_visible=0.75)
        writer.write_truth(0, FrameTruth(None, None, (seen,)))
    with Session(path) as session:
        (pair,) = session.pairs()
    assert pair.truth is not None
    assert pair.truth.apples == (replace(seen, right_visible=0.0),)


def test_depth_of_another_size_than_the_left_picture_is_a_failure(tmp_path: Path) -> None:
    sound, small = one_view(tmp_path), tmp_path / "small.mcap"
    size_px = (32, 24)
    with SessionWriter.create(small, one_view_rig(nominal_camera(size_px)), ONE_VIEW) as writer:
        steps = np.full(size_px[::-1], 1000, "<u2")
        writer.write_depth(Depth(SECOND_NS, "16UC1", steps.tobytes(), size_px))
    with Session(sound) as one, Session(small) as other, (tmp_path / "x.mcap").open("wb") as stream:
        mixed = MessageWriter(stream, one.metadata)  # a session's own writer refuses such depth
        for message in (*one.messages(), *(m for m in other.messages() if m.topic == "/depth")):
            mixed.copy(message)
        mixed.finish()
    texts = [(f.level, f.text) for f in check(tmp_path / "x.mcap")]
    assert ("failure", "1 of 4 depth pictures are not of the left's size") in texts


def test_check_and_info_tell_one_view_and_its_depth(tmp_path: Path) -> None:
    path = one_view(tmp_path)
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0
    assert "one view, its calibration known" in result.stdout
    assert "3 depth pictures, 3 of them at a left picture's moment" in result.stdout
    assert "right" not in result.stdout
    result = CliRunner().invoke(app, ["info", str(path)])
    assert "one view, 3 frames" in result.stdout
    result = CliRunner().invoke(app, ["info", str(path), "--json"])
    assert json.loads(result.stdout)["topics"]["/depth"] == 3


@pytest.mark.parametrize("encoding", ["png", "bgr8"])
def test_depth_and_names_are_salvaged_and_do_not_make_pictures_raw(
    tmp_path: Path, encoding: Encoding
) -> None:
    whole = one_view(tmp_path, encoding=encoding)
    chunks = [r.stop for r in records_in(whole) if r.opcode == Opcode.CHUNK]
    wreck = salvage(torn(whole, chunks[-2] + 5), tmp_path / "saved.mcap")
    assert wreck.counts["/depth"] == 2
    with Session(tmp_path / "saved.mcap") as session:
        session.verify()
        assert session.raw_images == (encoding == "bgr8")
        assert session.one_view
        assert session.names("left") == ("0.png", "1.png", "2.png")
        assert [pair.depth is not None for pair in session.pairs()] == [True, True]


def test_pictures_alone_are_imported_with_a_nominal_camera(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 2)
    out = tmp_path / "s.mcap"
    result = CliRunner().invoke(imports, ["import", "frames", str(left), "-o", str(out)])
    assert result.stdout == f"{out}: 2 pictures of one view\n"
    with Session(out) as session:
        assert session.metadata["calibration"] == "nominal"
        assert session.names("left") == ("000.png", "001.png")
        assert session.rig.left.size_px == SIZE_PX
    words = ["import", "frames", str(left), str(right), "-o", str(out)]
    assert CliRunner().invoke(imports, words).exit_code == 2  # two views need their calibration


def test_the_left_view_is_scored_and_nothing_else(tmp_path: Path) -> None:
    rig = tiny_rig()
    picture, labels = draw(rig, "left", [apple(1, 0.0, seen=1.0)])
    path = tmp_path / "one.mcap"
    with SessionWriter.create(path, one_view_rig(rig.left), ONE_VIEW) as writer:
        writer.write_frame(Frame("left", 0, "png", drawn(picture), rig.left.size_px))
    rows, columns = np.nonzero(labels == 1)
    box = (float(columns.min()), float(rows.min()), float(np.ptp(columns) + 1.0), 20.0)
    boxes = [PictureLabels("left/000000", (Shape(box=box),))]
    with Session(path) as session:
        label_session(session, LabelTruth(session, boxes), tmp_path / "boxes.mcap")
    masks = tmp_path / "masks"
    masks.mkdir()
    (masks / "0.png").write_bytes(drawn((labels == 1).astype(np.uint8) * 3))
    with Session(path) as session:
        label_session(session, MaskTruth(masks, instances=True), tmp_path / "masks.mcap")
    sessions = [tmp_path / "boxes.mcap", tmp_path / "masks.mcap"]
    list(replay(sessions, tmp_path / "r", TINY, rrd="none"))
    for name, pixels in (("boxes", False), ("masks", True)):
        score = score_runs(find_runs([tmp_path / "r" / name]))["all"]
        assert (score.pixels is not None) == pixels
        assert score.fruit is not None
        assert (score.fruit.tp, score.fruit.fp, score.fruit.fn) == (1, 0, 0)
        assert score.matches is None
        assert score.distance_m is None
