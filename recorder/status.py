"""What the recorder says of itself in a session: a stamp a frame, a status each second."""

from dataclasses import dataclass, fields
from typing import Any

from recorder.mcap_records import RawMessage
from recorder.messages import (
    FrameStampMessage,
    RecorderStatusMessage,
    StreamStatusMessage,
    fields_of,
    timestamp_of,
)


@dataclass(frozen=True, slots=True)
class FrameStamp:
    """The times of one frame, as they were read, beside the time it was given.

    Attributes:
        time_ns: the frame's time in the session.
        stream: "left" or "right".
        frame_id: the camera's own count; None where it has none.
        device_ns: exposure on the camera's clock; None where it has none.
        host_ns: arrival by the computer's wall clock.
        monotonic_ns: arrival by its monotonic clock.
        status: "complete"; of any other status there is no picture.
    """

    time_ns: int
    stream: str
    frame_id: int | None
    device_ns: int | None
    host_ns: int
    monotonic_ns: int
    status: str


@dataclass(frozen=True, slots=True)
class StreamStatus:
    """One stream's counts since the recording began.

    Attributes:
        stream: "left", "right" or "rangefinder".
        frames: pictures or readings in the file.
        bytes: their size.
        dropped: pictures given up because the disk was too slow.
        late: pictures that came more than 100 ms after their exposure.
        incomplete: pictures that lost packets, or that were cut short.
        missing: pictures that never came, by their ids, or by the rate while the camera was gone.
        unpaired: pictures without a partner of their time.
        reopened: how often the device was opened anew.
        faults: answers of the rangefinder that failed a checksum or made no sense.
        silent_ns: the sum of the gaps in which the device was gone.
        rate_hz: pictures or readings a second, lately.
        overexposed: the share of pixels at or above 250.
        underexposed: the share of pixels at or below 5.
        focus: the variance of the Laplacian; it compares pictures of one scene.
        drift_ppm: what the device's clock gains on the computer's.
    """

    stream: str
    frames: int = 0
    bytes: int = 0
    dropped: int = 0
    late: int = 0
    incomplete: int = 0
    missing: int = 0
    unpaired: int = 0
    reopened: int = 0
    faults: int = 0
    silent_ns: int = 0
    rate_hz: float = 0.0
    overexposed: float | None = None
    underexposed: float | None = None
    focus: float | None = None
    drift_ppm: float | None = None


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """The recorder at one moment.

    Attributes:
        time_ns: of the session.
        state: "recording", or why it ends.
        streams: each stream's counts.
        pairs: stereo pairs so far.
        skew_ns: right minus left of the last pair; None before the first.
        queue_bytes: pictures that wait for the disk.
        disk_free_bytes: room on the disk.
        disk_left_s: how long that lasts at the rate of now; None while nothing is written.
        warnings: what the operator should look at, in words.
    """

    time_ns: int
    state: str
    streams: tuple[StreamStatus, ...]
    pairs: int
    skew_ns: int | None
    queue_bytes: int
    disk_free_bytes: int
    disk_left_s: float | None
    warnings: tuple[str, ...] = ()

    def stream(self, name: str) -> StreamStatus:
        """The stream of that name; an empty one where there is none."""
        return next((s for s in self.streams if s.stream == name), StreamStatus(name))


def _plain(message: Any, kind: type) -> dict[str, Any]:
    """A message's fields by name, absent ones as None."""
    present = {f.name for f in message.DESCRIPTOR.fields if f.has_presence}
    names = [field.name for field in fields(kind) if field.name != "time_ns"]
    return {
        name: None if name in present and not message.HasField(name) else getattr(message, name)
        for name in names
    }


def encode_stamp(stamp: FrameStamp) -> Any:
    """A stamp as its message."""
    entries = fields_of(stamp)
    return FrameStampMessage(timestamp=timestamp_of(entries.pop("time_ns")), **entries)


def decode_stamp(message: RawMessage) -> FrameStamp:
    """Read a stamp back."""
    found = FrameStampMessage.FromString(message.data)
    return FrameStamp(time_ns=message.log_ns, **_plain(found, FrameStamp))


def encode_status(status: RecorderStatus) -> Any:
    """A status as its message."""
    entries = fields_of(status) | {
        "streams": [StreamStatusMessage(**fields_of(stream)) for stream in status.streams]
    }
    return RecorderStatusMessage(timestamp=timestamp_of(entries.pop("time_ns")), **entries)


def decode_status(message: RawMessage) -> RecorderStatus:
    """Read a status back."""
    found = RecorderStatusMessage.FromString(message.data)
    streams = tuple(StreamStatus(**_plain(stream, StreamStatus)) for stream in found.streams)
    entries = _plain(found, RecorderStatus) | {
        "streams": streams,
        "warnings": tuple(found.warnings),
    }
    return RecorderStatus(time_ns=message.log_ns, **entries)
