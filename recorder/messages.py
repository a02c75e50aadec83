"""The session's own protobuf messages, declared here and nowhere else.

Pictures, calibration, transforms and notes use Foxglove's schemas; nobody has schemas for a range
reading or for the truth about apples, so these are ours. They are built at run time, because a
table is easier to read and to keep right than generated code.
"""

from dataclasses import fields
from typing import Any, Final

from google.protobuf import timestamp_pb2
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import Default
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import Timestamp

_F = FieldDescriptorProto
_TYPES: Final = {
    "bool": _F.TYPE_BOOL,
    "double": _F.TYPE_DOUBLE,
    "int64": _F.TYPE_INT64,
    "string": _F.TYPE_STRING,
    "uint32": _F.TYPE_UINT32,
    "uint64": _F.TYPE_UINT64,
}

# message -> {field: type}. A new field goes at the end of its message: the number on the wire is
# the place in this table. "?" may be absent, "*" repeats.
SCHEMAS: Final[dict[str, dict[str, str]]] = {
    "RangeReading": {
        "timestamp": "google.protobuf.Timestamp",
        "range_m": "double?",
        "std_m": "double?",
        "status": "string",
        "raw": "string",
        "apple_id": "uint32?",
    },
    "AppleTruth": {
        "id": "uint32",
        "centre_m": "double*",
        "radius_m": "double",
        "left_visible": "double?",
        "right_visible": "double?",
        "truth_point": "string",
    },
    "Outline": {
        "side": "string",
        "id": "uint32",
        "kind": "string",
        "x_px": "double",
        "y_px": "double",
        "width_px": "double",
        "height_px": "double",
    },
    "FrameTruth": {
        "timestamp": "google.protobuf.Timestamp",
        "apples": "pomolog.AppleTruth*",
        "apples_known": "bool",
        "partial": "bool",
        "identified": "bool",
        "not_shared": "bool",
        "outlined": "string*",
        "outlines": "pomolog.Outline*",
    },
    "FrameStamp": {
        "timestamp": "google.protobuf.Timestamp",
        "stream": "string",
        "frame_id": "uint64?",
        "device_ns": "int64?",
        "host_ns": "int64",
        "monotonic_ns": "int64",
        "status": "string",
    },
    "StreamStatus": {
        "stream": "string",
        "frames": "uint64",
        "bytes": "uint64",
        "dropped": "uint64",
        "late": "uint64",
        "incomplete": "uint64",
        "missing": "uint64",
        "unpaired": "uint64",
        "reopened": "uint64",
        "faults": "uint64",
        "silent_ns": "int64",
        "rate_hz": "double",
        "overexposed": "double?",
        "underexposed": "double?",
        "focus": "double?",
        "drift_ppm": "double?",
    },
    "RecorderStatus": {
        "timestamp": "google.protobuf.Timestamp",
        "state": "string",
        "streams": "pomolog.StreamStatus*",
        "pairs": "uint64",
        "skew_ns": "int64?",
        "queue_bytes": "uint64",
        "disk_free_bytes": "uint64",
        "disk_left_s": "double?",
        "warnings": "string*",
    },
}


def _declare() -> None:
    timestamp_pb2.DESCRIPTOR  # noqa: B018  # loads the file that ours depends on
    file = FileDescriptorProto(
        name="pomolog.proto",
        package="pomolog",
        syntax="proto3",
        dependency=["google/protobuf/timestamp.proto"],
    )
    for message_name, schema in SCHEMAS.items():
        message = file.message_type.add(name=message_name)
        for number, (name, kind) in enumerate(schema.items(), start=1):
            field = message.field.add(name=name, number=number)
            field.label = _F.LABEL_REPEATED if kind.endswith("*") else _F.LABEL_OPTIONAL
            base = kind.rstrip("?*")
            if base in _TYPES:
                field.type = _TYPES[base]
            else:
                field.type = _F.TYPE_MESSAGE
                field.type_name = f".{base}"
            if kind.endswith("?"):  # proto3's way to tell "absent" from "zero"
                field.proto3_optional = True
                field.oneof_index = len(message.oneof_decl)
                message.oneof_decl.add(name=f"_{name}")
    Default().Add(file)


_declare()


def _message_class(name: str) -> Any:  # protobuf's run-time classes have no static type
    return GetMessageClass(Default().FindMessageTypeByName(f"pomolog.{name}"))


RangeReadingMessage: Final = _message_class("RangeReading")
FrameTruthMessage: Final = _message_class("FrameTruth")
AppleTruthMessage: Final = _message_class("AppleTruth")
OutlineMessage: Final = _message_class("Outline")
FrameStampMessage: Final = _message_class("FrameStamp")
StreamStatusMessage: Final = _message_class("StreamStatus")
RecorderStatusMessage: Final = _message_class("RecorderStatus")


def timestamp_of(time_ns: int) -> Timestamp:
    """A time as protobuf has it."""
    seconds, nanos = divmod(time_ns, 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)


def optional(message: Any, name: str) -> Any:
    """A field's value, or None where it is absent."""
    return getattr(message, name) if message.HasField(name) else None


def fields_of(record: Any) -> dict[str, Any]:
    """What a dataclass of ours holds, by the names that its message has too."""
    return {field.name: getattr(record, field.name) for field in fields(record)}
