"""A session -> a bag of ROS 2 (MCAP, CDR): what their tools read, and what ours need beside it."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from scipy.spatial.transform import Rotation

from recorder.errors import PomologError
from recorder.files import replacing
from recorder.imports.bag import OURS, RECORDS
from recorder.imports.bag_ours import AS_JSON, LABELS, to_json
from recorder.mcap_records import RawMessage
from recorder.metadata import with_crc
from recorder.profile import decode_depth, decode_frame, decode_reading
from recorder.records import COMPRESSED, SIDES
from recorder.rig import Floats, LensModel, Rig
from recorder.rig_formats.ros import NAMES
from recorder.ros2 import BagWriter
from recorder.session import Session

_LAST_S: Final = 2**31 - 1  # of ROS's times
_INFRARED: Final = 1  # sensor_msgs/Range: a laser is the nearer of its two kinds of radiation
_SPOT_RAD: Final = 0.001  # about what a laser's beam is wide


def export_bag(session: Session, out: Path, tick: Callable[[], None] = lambda: None) -> int:
    """Write a session as a bag: one MCAP file, or a folder as rosbag2 makes it.

    Args:
        session: the session.
        out: ending in .mcap the file, otherwise the folder.
        tick: called after each picture.

    Returns:
        The number of messages.

    Raises:
        PomologError: the session is damaged, or `out` cannot be written or is the session.
    """
    if isinstance(session.path, Path) and out.exists() and out.samefile(session.path):
        raise PomologError(f"{out} is the session itself; give -o another name")
    folder = out.suffix != ".mcap"
    file = f"{out.name}_0.mcap"
    with replacing(out) as part:
        if folder:
            part.mkdir()
        with (part / file if folder else part).open("wb") as stream:
            bag = BagWriter(stream)
            _write(session, bag, tick)
            bag.finish()
        if folder:
            (part / "metadata.yaml").write_text(bag.metadata_yaml(file), encoding="utf-8")
    return sum(count for _, count in bag.counts().values())


def _write(session: Session, bag: BagWriter, tick: Callable[[], None]) -> None:
    records = {"session": session.metadata}
    records |= {"pictures": session.picture_names} if session.picture_names else {}
    records |= {"ledger": session.ledger} if session.ledger else {}
    for name, entries in records.items():
        bag.add_metadata(f"{RECORDS}{name}", with_crc(entries))
    start_ns = session.info().start_ns or 0
    _write_transforms(session.rig, bag, start_ns)
    calibrations: dict[str, RawMessage] = {}
    for message in session.messages():
        topic, time_ns, sequence = message.topic, message.log_ns, message.sequence
        if topic in ("/left/image", "/right/image"):
            _write_image(session, message, bag)
            side = topic.split("/")[1]
            info = _camera_info(calibrations[side], time_ns)  # with each picture, as drivers do
            bag.write(f"/{side}/camera_info", "sensor_msgs/CameraInfo", time_ns, info, sequence)
            tick()
        elif topic in ("/left/calibration", "/right/calibration"):
            calibrations.setdefault(topic.split("/")[1], message)
        elif topic == "/depth":
            depth = decode_depth(message)
            image = _image("left", time_ns, depth.size_px, depth.encoding, depth.data)
            bag.write("/depth", "sensor_msgs/Image", time_ns, image, sequence)
        elif topic in LABELS:
            labels = CompressedImage.FromString(message.data)
            fields = {
                "header": _header(topic.rsplit("/", 1)[-1], time_ns),
                "format": "png",
                "data": labels.data,
            }
            bag.write(topic, "sensor_msgs/CompressedImage", time_ns, fields, sequence)
        elif topic in AS_JSON:
            if topic == "/rangefinder":
                beam = _range(message, session.rig)
                bag.write("/rangefinder", "sensor_msgs/Range", time_ns, beam, sequence)
            text = {"data": to_json(message)}
            bag.write(f"{OURS}{topic}", "std_msgs/String", time_ns, text, sequence)


def _write_image(session: Session, message: RawMessage, bag: BagWriter) -> None:
    side = SIDES[message.topic == "/right/image"]
    frame = decode_frame(side, message, session.schema(message.topic))
    if frame.encoding in COMPRESSED:
        topic, name = f"/{side}/image_raw/compressed", "sensor_msgs/CompressedImage"
        header = _header(side, message.log_ns)
        fields = {"header": header, "format": frame.encoding, "data": frame.data}
    else:
        topic, name = f"/{side}/image_raw", "sensor_msgs/Image"
        fields = _image(side, message.log_ns, frame.size_px, frame.encoding, frame.data)
    bag.write(topic, name, message.log_ns, fields, message.sequence)


def _write_transforms(rig: Rig, bag: BagWriter, time_ns: int) -> None:
    """The cameras' optical frames `left` and `right`; the beam is the x axis of `rangefinder`."""
    poses = [("right", -rig.rotation.T @ rig.translation_m, rig.rotation.T)]
    if rig.rangefinder is not None:
        along, _ = Rotation.align_vectors(rig.rangefinder.direction[None], [[1.0, 0.0, 0.0]])
        poses.append(("rangefinder", rig.rangefinder.origin_m, along.as_matrix()))
    transforms = [_transform(child, origin, turn, time_ns) for child, origin, turn in poses]
    bag.write("/tf_static", "tf2_msgs/TFMessage", time_ns, {"transforms": transforms})


def _transform(child: str, origin_m: Floats, turn: Floats, time_ns: int) -> dict[str, Any]:
    quaternion = Rotation.from_matrix(turn).as_quat().tolist()
    return {
        "header": _header("left", time_ns),
        "child_frame_id": child,
        "transform": {
            "translation": dict(zip("xyz", origin_m.tolist(), strict=True)),
            "rotation": dict(zip("xyzw", quaternion, strict=True)),
        },
    }


def _header(frame_id: str, time_ns: int) -> dict[str, Any]:
    seconds, nanos = divmod(time_ns, 1_000_000_000)
    if seconds > _LAST_S:
        raise PomologError(
            f"a message at {time_ns} ns is later than 2038, which ROS cannot say; "
            "was the clock right?"
        )
    return {"stamp": {"sec": seconds, "nanosec": nanos}, "frame_id": frame_id}


def _image(
    frame_id: str, time_ns: int, size_px: tuple[int, int], encoding: str, data: bytes
) -> dict[str, Any]:
    return {
        "header": _header(frame_id, time_ns),
        "height": size_px[1],
        "width": size_px[0],
        "encoding": encoding,
        "is_bigendian": 0,
        "step": len(data) // size_px[1],
        "data": data,
    }


def _camera_info(calibration: RawMessage, time_ns: int) -> dict[str, Any]:
    known = CameraCalibration.FromString(calibration.data)
    return {
        "header": _header(known.frame_id, time_ns),
        "height": known.height,
        "width": known.width,
        "distortion_model": NAMES[cast("LensModel", known.distortion_model)],
        "d": list(known.D),
        "k": list(known.K),
        "r": list(known.R),
        "p": list(known.P),
    }


def _range(message: RawMessage, rig: Rig) -> Mapping[str, Any]:
    reading = decode_reading(message)
    std_m = reading.std_m or (rig.rangefinder.std_m if rig.rangefinder else 0.0)
    return {
        "header": _header("rangefinder", message.log_ns),
        "radiation_type": _INFRARED,
        "field_of_view": _SPOT_RAD,
        "min_range": 0.0,
        "max_range": float(np.finfo(np.float32).max),
        "range": float("nan") if reading.range_m is None else reading.range_m,
        "variance": std_m**2,
    }
