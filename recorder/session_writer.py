"""Writing a session: the rig once, then frames, readings, truth and notes as they come."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Self

from recorder.errors import PomologError
from recorder.files import replacing
from recorder.mcap_records import RawMessage
from recorder.message_writer import MessageWriter
from recorder.profile import (
    IMAGE_TOPICS,
    encode_depth,
    encode_frame,
    encode_note,
    encode_reading,
    encode_rig,
)
from recorder.records import COMPRESSED, Depth, Frame, FrameTruth, Note, RangeReading
from recorder.rig import Rig
from recorder.status import FrameStamp, RecorderStatus, encode_stamp, encode_status
from recorder.truth_messages import encode_truth


class SessionWriter:
    """Write a session: the rig once, then frames, readings, truth and notes as they come.

    Args:
        stream: an empty file opened for writing; `SessionWriter.create` opens one by name.
        rig: written as calibration and transforms before the first message.
        metadata: lighting, cultivar, site, made_by and whatever else is known.
        raw_images: frames are raw (Bayer or BGR) instead of JPEG, PNG or WebP.
    """

    def __init__(
        self,
        stream: BinaryIO,
        rig: Rig,
        metadata: Mapping[str, str] | None = None,
        *,
        raw_images: bool = False,
    ) -> None:
        self._rig = rig
        self._rig_written = False
        self._raw_images = raw_images
        known = {**(metadata or {}), "rig": rig.digest}
        if rig.rangefinder is not None:
            known["rangefinder_std_m"] = repr(rig.rangefinder.std_m)
        self._out = MessageWriter(stream, known, raw_images=raw_images)

    @classmethod
    @contextmanager
    def create(
        cls,
        path: Path,
        rig: Rig,
        metadata: Mapping[str, str] | None = None,
        *,
        raw_images: bool = False,
    ) -> Iterator[Self]:
        """Open a session by name; it appears there when all of it is on the disk.

        Raises:
            PomologError: the file cannot be written.
        """
        with replacing(path) as part, part.open("wb") as stream:
            writer = cls(stream, rig, metadata, raw_images=raw_images)
            yield writer
            writer.finish()

    def write_frame(self, frame: Frame) -> None:
        """Write a frame; its bytes stay as they are.

        Raises:
            PomologError: its size is not the calibration's, or raw and compressed are mixed.
        """
        size_px = self._rig.camera(frame.side).size_px
        if frame.size_px != size_px:
            raise PomologError(
                f"a {frame.side} picture of {frame.size_px[0]} x {frame.size_px[1]} px, but the "
                f"rig's {frame.side} camera has {size_px[0]} x {size_px[1]}; is it the right rig?"
            )
        if (frame.encoding not in COMPRESSED) != self._raw_images:
            raise PomologError(
                "raw and compressed frames cannot be mixed in one session; write two"
            )
        topic = IMAGE_TOPICS[frame.side]
        self._write(topic, frame.time_ns, encode_frame(frame), frame.sequence)

    def write_reading(self, reading: RangeReading) -> None:
        """Write an answer of the rangefinder."""
        self._write("/rangefinder", reading.time_ns, encode_reading(reading))

    def write_truth(self, time_ns: int, truth: FrameTruth) -> None:
        """Write what is known of the fruit in the pair of that (left frame's) time."""
        for topic, message in encode_truth(time_ns, truth):
            self._write(topic, time_ns, message)

    def write_depth(self, depth: Depth) -> None:
        """Write a depth picture.

        Raises:
            PomologError: it is not of the left camera's size, pixel by pixel.
        """
        size_px = self._rig.left.size_px
        if depth.size_px != size_px:
            raise PomologError(
                f"a depth picture of {depth.size_px[0]} x {depth.size_px[1]} px, but the left "
                f"picture has {size_px[0]} x {size_px[1]}; is it aligned to the left camera?"
            )
        self._write("/depth", depth.time_ns, encode_depth(depth))

    def copy(self, message: RawMessage) -> None:
        """Write a message of another session as it is."""
        self._begin(message.log_ns)
        self._out.copy(message)

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Keep a record: `ledger`, or `pictures`, what they were called (a line each, by side)."""
        self._out.add_metadata(name, entries)

    def write_note(self, note: Note) -> None:
        """Write a line that the operator typed."""
        self._write("/notes", note.time_ns, encode_note(note))

    def write_stamp(self, stamp: FrameStamp) -> None:
        """Write what the recorder knows of a frame's times, beside the frame."""
        self._write("/recorder/stamps", stamp.time_ns, encode_stamp(stamp))

    def write_status(self, status: RecorderStatus) -> None:
        """Write the recorder's own state of that moment."""
        self._write("/recorder/status", status.time_ns, encode_status(status))

    def _write(self, topic: str, time_ns: int, message: Any, sequence: int | None = None) -> None:
        self._begin(time_ns)
        self._out.write(topic, time_ns, message.SerializeToString(), sequence=sequence)

    def _begin(self, time_ns: int) -> None:
        """The rig stands before the first message."""
        if not self._rig_written:
            self._rig_written = True
            for topic, message in encode_rig(self._rig, time_ns):
                self._out.write(topic, time_ns, message.SerializeToString())

    def flush(self) -> None:
        """End the chunk in progress and hand it to the operating system."""
        self._out.flush()

    def sync(self) -> None:
        """Wait until the disk has everything written so far."""
        self._out.sync()

    def finish(self, ledger: Mapping[str, str] | None = None) -> None:
        """Write the recorder's final counts, where it kept any, and the index."""
        if ledger:
            self._out.add_metadata("ledger", ledger)
        self._out.finish()
