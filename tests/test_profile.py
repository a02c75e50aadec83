import subprocess
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from recorder.container import Container
from recorder.profile import MEANINGS, TOPICS, encode_rig
from recorder.records import Encoding, Note
from recorder.rectify import rectify
from recorder.session_writer import SessionWriter
from tests.builders import frame, rangefinder, real_rig, rig, session_file


def rerun_columns(session: Path) -> dict[str, set[str]]:
    """What Rerun's own command makes of a session: the columns of each entity."""
    import rerun_cli

    binary = Path(rerun_cli.__file__).parent / "rerun"
    out = session.with_suffix(".rrd")
    for words in (["mcap", "convert", str(session), "-o", str(out)], ["rrd", "print", str(out)]):
        done = subprocess.run([binary, *words], capture_output=True, text=True, check=True)
    found: dict[str, set[str]] = {}
    for line in done.stdout.splitlines():
        if " - data columns: [" in line:
            entity, columns = line.split(" - ")[-2:]
            words = columns.removeprefix("data columns: [").removesuffix("]").split()
            found.setdefault(entity, set()).update(words)
    return found


@pytest.mark.parametrize(
    ("encoding", "image"),
    [
        ("jpeg", "EncodedImage:blob"),
        ("png", "EncodedImage:blob"),
        ("bgr8", "Image:buffer"),
        ("bayer_rggb8", "Image:buffer"),
    ],
)
def test_rerun_opens_a_session_natively(tmp_path: Path, encoding: Encoding, image: str) -> None:
    path = session_file(
        tmp_path, 2, encoding=encoding, with_rig=rig(beam=True), readings=True, labelled=True
    )
    columns = rerun_columns(path)
    for side in ("left", "right"):
        assert image in columns[f"/{side}/image"]
        assert {"Pinhole:image_from_camera", "Pinhole:resolution"} <= columns[
            f"/{side}/calibration"
        ]
        assert "EncodedImage:blob" in columns[f"/truth/{side}"]
    assert {"Transform3D:translation", "Transform3D:quaternion"} <= columns["/tf"]


def test_others_schemas_are_foxgloves_and_only_our_own_are_ours(tmp_path: Path) -> None:
    wanted = {
        "/left/image": "foxglove.CompressedImage",
        "/right/image": "foxglove.CompressedImage",
        "/left/calibration": "foxglove.CameraCalibration",
        "/right/calibration": "foxglove.CameraCalibration",
        "/tf": "foxglove.FrameTransform",
        "/rangefinder": "pomolog.RangeReading",
        "/truth/left": "foxglove.CompressedImage",
        "/truth/right": "foxglove.CompressedImage",
        "/truth/apples": "pomolog.FrameTruth",
        "/notes": "foxglove.Log",
    }
    with Container(session_file(tmp_path, 1)) as container:
        assert {topic: container.schema_name(topic) for topic in wanted} == wanted
        assert [channel.topic for channel in container.index.channels.values()] == list(TOPICS)
        assert all(s.encoding == "protobuf" for s in container.index.schemas.values())
        assert all(c.message_encoding == "protobuf" for c in container.index.channels.values())
        assert container.header.profile == "pomolog/1"


def test_raw_frames_have_foxgloves_raw_schema(tmp_path: Path) -> None:
    with Container(session_file(tmp_path, 1, encoding="bgr8")) as container:
        assert container.schema_name("/left/image") == "foxglove.RawImage"
        assert container.schema_name("/truth/left") == "foxglove.CompressedImage"


def test_a_channels_number_says_its_topic_for_ever() -> None:
    # salvage names channels by their place; a new topic goes at the end of this list
    assert list(TOPICS) == [
        "/left/image", "/right/image", "/left/calibration", "/right/calibration", "/tf",
        "/rangefinder", "/truth/left", "/truth/right", "/truth/apples", "/notes",
        "/recorder/status", "/recorder/stamps", "/depth",
    ]  # fmt: skip


def test_anyone_can_decode_a_session_by_the_schemas_inside_it(tmp_path: Path) -> None:
    path = session_file(tmp_path, 2, readings=True, labelled=True, encoding="jpeg")
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        found = {c.topic: m for _, c, _, m in reader.iter_decoded_messages()}  # the last of each
    image = found["/left/image"]
    assert (image.format, image.frame_id, image.timestamp.seconds) == ("jpeg", "left", 1)
    assert (found["/rangefinder"].range_m, found["/rangefinder"].status) == (2.5, "ok")
    (apple,) = found["/truth/apples"].apples
    assert (apple.id, list(apple.centre_m), apple.right_visible) == (1, [0.1, -0.05, 2.2], 0.75)


def test_a_time_of_seconds_and_nanoseconds_is_kept(tmp_path: Path) -> None:
    time_ns = 1_763_000_000_123_456_789
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        writer.write_frame(frame("left", time_ns))
        writer.write_note(Note(time_ns + 1, "x"))
    with (tmp_path / "s.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        stamps = [
            (message.log_time, decoded.timestamp.seconds * 10**9 + decoded.timestamp.nanos)
            for _, _, message, decoded in reader.iter_decoded_messages()
        ]
    assert stamps == [(time_ns, time_ns)] * 4 + [(time_ns + 1, time_ns + 1)]


@pytest.mark.parametrize("ideal", [True, False])
def test_calibrations_hold_the_rectification_and_the_right_p3_is_minus_f_b(ideal: bool) -> None:
    one = rig() if ideal else real_rig()
    calibrations = {
        topic: message
        for topic, message in encode_rig(one, 0)
        if isinstance(message, CameraCalibration)
    }
    parallel = rectify(one)
    left, right = calibrations["/left/calibration"], calibrations["/right/calibration"]
    assert left.P[3] == 0
    assert right.P[3] == pytest.approx(-parallel.focal_px * one.baseline_m)
    assert (right.width, right.height) == one.right.size_px
    assert np.allclose(np.reshape(left.R, (3, 3)), parallel.left.rotation)
    # ROS's rule for a rectified pair: P_right [X 1] projects a point of the rectified left frame
    point = np.array([0.1, 0.05, 2.0, 1.0])
    u, _, w = np.reshape(right.P, (3, 4)) @ point
    seen = parallel.project("right", point[None, :3] @ parallel.left.rotation)
    assert seen[0, 0] == pytest.approx(u / w)


def test_transforms_place_the_right_camera_and_the_beam_in_the_left_frame() -> None:
    one = real_rig(beam=True)
    transforms = {
        message.child_frame_id: message
        for _, message in encode_rig(one, 0)
        if isinstance(message, FrameTransform)
    }
    assert {t.parent_frame_id for t in transforms.values()} == {"left"}
    place = transforms["right"].translation
    centre_m = -one.rotation.T @ one.translation_m
    assert [place.x, place.y, place.z] == pytest.approx(centre_m.tolist())
    assert place.x > 0.19  # the right camera is on the right
    origin = transforms["rangefinder"].translation
    assert [origin.x, origin.y, origin.z] == pytest.approx(rangefinder().origin_m.tolist())


def test_every_topic_says_what_it_means_in_the_order_of_the_topics() -> None:
    assert list(MEANINGS) == list(TOPICS)
