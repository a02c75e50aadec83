import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from processor.cli import app
from recorder.errors import PomologError
from recorder.exports.bag import export_bag
from recorder.imports.bag import Bag
from recorder.imports.bag_roles import assign_roles
from recorder.imports.bag_session import import_bag
from recorder.one_view import ONE_VIEW, nominal_camera, one_view_rig
from recorder.profile import encode_rig
from recorder.records import Depth, Encoding, Note, RangeReading
from recorder.rig import LensModel
from recorder.ros2 import MESSAGES, definition
from recorder.session import Session
from recorder.session_writer import SessionWriter
from recorder.status import FrameStamp
from tests.builders import DISTORTIONS, SECOND_NS, content, frame, real_rig, rig, session_file
from tests.test_profile import rerun_columns

SIZE_PX = (64, 48)


def exported(session: Path, out: Path) -> Path:
    with Session(session) as opened:
        export_bag(opened, out)
    return out


def back(bag: Path, out: Path) -> Path:
    opened = Bag(bag)
    import_bag(opened, assign_roles(opened, {}), out)
    return out


def ros_messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Read by an implementation that is not ours, with the definitions in the file."""
    with AnyReader([path]) as reader:
        for connection, time_ns, raw in reader.messages():
            yield connection.topic, time_ns, reader.deserialize(raw, connection.msgtype)


def rich_session(folder: Path, encoding: Encoding, lens: LensModel = "plumb_bob") -> Path:
    """A session with everything that a session can hold."""
    path = folder / "rich.mcap"
    camera_rig = real_rig(lens, size_px=SIZE_PX, beam=True)
    about = {"lighting": "front", "site": "Jork", "max_skew_ns": "7000000", "made_by": "test"}
    with SessionWriter.create(
        path, camera_rig, about, raw_images=encoding not in ("jpeg", "png")
    ) as writer:
        for index in range(3):
            time_ns = 1_700_000_000 * SECOND_NS + index * SECOND_NS + 123_456_789
            left = frame(time_ns=time_ns, encoding=encoding, seed=2 * index, sequence=40 + index)
            right = frame(
                "right", time_ns + 6_000_000, encoding, seed=2 * index + 1, sequence=90 + index
            )
            writer.write_frame(left)
            writer.write_frame(right)
            steps = np.random.default_rng(index).integers(0, 65536, SIZE_PX[::-1], dtype="<u2")
            writer.write_depth(Depth(time_ns, "16UC1", steps.tobytes(), SIZE_PX))
            writer.write_stamp(
                FrameStamp(time_ns, "left", 40 + index, 2**60 + index, time_ns, index, "ok")
            )
            known = RangeReading(
                time_ns + 5, 1 / 3 + index, 0.001, "ok", "g0g+0001\n", index or None
            )
            writer.write_reading(known)
            writer.write_reading(RangeReading(time_ns + 9, None, None, "too near", "ümlaut"))
        writer.write_note(Note(time_ns, "lighting=back"))
    return path


@pytest.mark.parametrize("encoding", ["jpeg", "png", "bgr8", "bayer_rggb8", "bayer_grbg8"])
def test_a_session_comes_back_from_a_bag_value_by_value(tmp_path: Path, encoding: Encoding) -> None:
    session = rich_session(tmp_path, encoding)
    returned = back(exported(session, tmp_path / "ros.mcap"), tmp_path / "back.mcap")
    before, after = content(session), content(returned)
    for key in ("readings", "notes", "pairs", "ledger"):
        assert after[key] == before[key], key
    assert {**after["metadata"], "rig": ""} == {**before["metadata"], "rig": ""}
    assert after["info"].topics == before["info"].topics
    with Session(session) as one, Session(returned) as other:
        assert list(one.stamps()) == list(other.stamps())
        assert [d.data for d in one.depths()] == [d.data for d in other.depths()]
        # 1e-12: a rotation became a quaternion and back, which costs the last bits
        for field in ("rotation", "translation_m"):
            assert np.allclose(getattr(one.rig, field), getattr(other.rig, field), atol=1e-12)
        assert one.rig.left.matrix.tolist() == other.rig.left.matrix.tolist()
        assert one.rig.rangefinder is not None
        assert other.rig.rangefinder is not None
        beams = one.rig.rangefinder, other.rig.rangefinder
        assert np.allclose(beams[0].direction, beams[1].direction, atol=1e-12)
        assert beams[0].origin_m.tolist() == beams[1].origin_m.tolist()
        assert beams[0].std_m == beams[1].std_m


@pytest.mark.parametrize("lens", ["plumb_bob", "rational_polynomial", "kannala_brandt"])
def test_lenses_come_back(tmp_path: Path, lens: LensModel) -> None:
    session = session_file(tmp_path, 1, with_rig=real_rig(lens, size_px=(640, 480)))
    returned = back(exported(session, tmp_path / "ros.mcap"), tmp_path / "back.mcap")
    with Session(session) as one, Session(returned) as other:
        for side in ("left", "right"):
            assert other.rig.camera(side).lens == lens
            found = other.rig.camera(side).distortion.tolist()
            assert found == one.rig.camera(side).distortion.tolist()
            assert len(found) == len(DISTORTIONS[lens])


def test_truth_comes_back(tmp_path: Path) -> None:
    session = session_file(tmp_path, 2, labelled=True, readings=True, with_rig=rig(beam=True))
    returned = back(exported(session, tmp_path / "ros.mcap"), tmp_path / "back.mcap")
    assert content(returned)["pairs"] == content(session)["pairs"]


def test_one_view_with_depth_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    camera = nominal_camera(SIZE_PX)
    with SessionWriter.create(path, one_view_rig(camera), ONE_VIEW) as writer:
        writer.write_frame(frame(time_ns=5))
        metres = np.linspace(0, 2, 64 * 48).astype("<f4")
        writer.write_depth(Depth(5, "32FC1", metres.tobytes(), SIZE_PX))
        writer.add_metadata("pictures", {"left": "IMG_7.png"})
    returned = back(exported(path, tmp_path / "ros.mcap"), tmp_path / "back.mcap")
    assert content(returned)["pairs"] == content(path)["pairs"]
    with Session(returned) as session:
        assert session.one_view
        assert session.names("left") == ("IMG_7.png",)
        (depth,) = session.depths()
        assert depth.data == metres.tobytes()


def test_another_reader_finds_the_values_of_the_session(tmp_path: Path) -> None:
    session = rich_session(tmp_path, "bgr8")
    found: dict[str, list[tuple[int, Any]]] = {}
    for topic, time_ns, message in ros_messages(exported(session, tmp_path / "ros.mcap")):
        found.setdefault(topic, []).append((time_ns, message))
    with Session(session) as opened:
        pairs, camera_rig = list(opened.pairs()), opened.rig
        calibrations = {m.frame_id: m for t, m in encode_rig(camera_rig, 0) if "calib" in t}
    for side in ("left", "right"):
        frames = [pair.left if side == "left" else pair.right for pair in pairs]
        images = found[f"/{side}/image_raw"]
        infos = found[f"/{side}/camera_info"]
        for wanted, (time_ns, image), (_, info) in zip(frames, images, infos, strict=True):
            stamp = image.header.stamp
            assert stamp.sec * SECOND_NS + stamp.nanosec == time_ns == wanted.time_ns
            assert (info.header.stamp, info.header.frame_id) == (stamp, side)
            assert (image.width, image.height, image.encoding) == (64, 48, "bgr8")
            assert (image.step, bytes(image.data)) == (192, wanted.data)
            assert info.k.tolist() == camera_rig.camera(side).matrix.ravel().tolist()
            assert info.d.tolist() == camera_rig.camera(side).distortion.tolist()
            # 1e-9: rectified anew here from a rig whose last bits a quaternion cost
            assert np.allclose(info.p, calibrations[side].P, atol=1e-9)
            assert np.allclose(info.r, calibrations[side].R, atol=1e-9)
    distances = [m.range for _, m in found["/rangefinder"]]
    assert distances[0] == np.float32(1 / 3)
    assert np.isnan(distances[1])
    ((_, tree),) = found["/tf_static"]
    assert [t.child_frame_id for t in tree.transforms] == ["right", "rangefinder"]
    place = tree.transforms[0].transform.translation
    seen = -camera_rig.rotation.T @ camera_rig.translation_m
    assert [place.x, place.y, place.z] == seen.tolist()
    depth = found["/depth"][0][1]
    assert depth.encoding == "16UC1"
    assert json.loads(found["/pomolog/notes"][0][1].data)["message"] == "lighting=back"


def test_rerun_opens_the_bag_natively(tmp_path: Path) -> None:
    columns = rerun_columns(exported(rich_session(tmp_path, "jpeg"), tmp_path / "ros.mcap"))
    for side in ("left", "right"):
        assert "EncodedImage:blob" in columns[f"/{side}/image_raw/compressed"]
        assert "Pinhole:image_from_camera" in columns[f"/{side}/camera_info"]
    assert "Transform3D:quaternion" in columns["/tf_static"]
    assert {"DepthImage:buffer", "DepthImage:format"} <= columns["/depth"]


def test_times_after_2038_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "late.mcap"
    with SessionWriter.create(path, rig()) as writer:
        for side in ("left", "right"):
            writer.write_frame(replace(frame(time_ns=2**31 * SECOND_NS), side=side))
    with pytest.raises(PomologError, match="later than 2038"):
        exported(path, tmp_path / "ros.mcap")
    assert not list(tmp_path.glob("ros*"))


def test_a_folder_is_a_bag_as_rosbag2_makes_it(tmp_path: Path) -> None:
    out = exported(session_file(tmp_path, 2), tmp_path / "row7")
    with Reader(out) as reader:
        assert reader.message_count == sum(c.msgcount for c in reader.connections)
        assert reader.duration == 1 * SECOND_NS + 1  # rosbags counts the last nanosecond
        static = next(c for c in reader.connections if c.topic == "/tf_static")
        (quality,) = static.ext.offered_qos_profiles  # type: ignore[union-attr]  # of ROS 2
        assert quality.durability.name == "TRANSIENT_LOCAL"
        assert quality.reliability.name == "RELIABLE"
    assert len(Bag(out).topics) == 5


def test_our_definitions_are_those_of_ros() -> None:
    from rosbags.typesys import get_types_from_msg

    known = get_typestore(Stores.ROS2_JAZZY).fielddefs
    older = get_typestore(Stores.ROS2_HUMBLE).fielddefs
    for name in MESSAGES:
        full = name.replace("/", "/msg/")
        for newest, store in ((True, known), (False, older)):
            text = definition(name, newest=newest)
            found = get_types_from_msg(text, full)
            assert found[full][1] == store[full][1], name


def test_the_command_exports_and_refuses(tmp_path: Path) -> None:
    session = session_file(tmp_path, 2)
    out = tmp_path / "ros.mcap"
    result = CliRunner().invoke(app, ["export", "bag", str(session), "-o", str(out), "--json"])
    assert json.loads(result.stdout) == {"out": str(out), "messages": 9}
    result = CliRunner().invoke(app, ["export", "bag", str(session), "-o", str(session)])
    assert isinstance(result.exception, PomologError)
    assert "the session itself" in str(result.exception)
    assert session.stat().st_size > 1000
    result = CliRunner().invoke(app, ["export", "bag", str(out), "-o", str(tmp_path / "x.mcap")])
    assert "no pomolog session" in str(result.exception)


def test_a_reading_keeps_what_ros_has_no_field_for(tmp_path: Path) -> None:
    session = session_file(tmp_path, 1, readings=True, with_rig=rig(beam=True))
    with Session(session) as opened:
        (reading,) = opened.readings()
    assert reading == replace(reading, raw="g0g+00000000")
    returned = back(exported(session, tmp_path / "ros.mcap"), tmp_path / "back.mcap")
    with Session(returned) as opened:
        assert list(opened.readings()) == [reading]
