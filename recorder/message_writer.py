"""Writing an MCAP of the session profile, message by message, onto an open file."""

import os
from collections.abc import Mapping
from typing import Any, BinaryIO, Final

from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from recorder.mcap_records import RawMessage
from recorder.metadata import with_crc
from recorder.profile import PROFILE, RIG_TOPICS, topics_of

CHUNK_BYTES: Final = 4 << 20
_MESSAGE_BYTES: Final = 9 + 22  # of a message record, beside its data


class MessageWriter:
    """Chunks of at most 4 MiB (unless one message is larger), a CRC over every byte.

    Args:
        stream: an empty file opened for writing.
        metadata: written first as the `session` record, so that a torn file still has it.
        raw_images: frames are raw (Bayer or BGR) instead of JPEG, PNG or WebP.
    """

    def __init__(
        self, stream: BinaryIO, metadata: Mapping[str, str], *, raw_images: bool = False
    ) -> None:
        self._stream = stream
        # JPEG and sensor noise do not compress; chunks are closed by hand, before they overflow
        self._mcap = Writer(
            stream,
            chunk_size=2 * CHUNK_BYTES,
            compression=CompressionType.NONE,
            enable_data_crcs=True,
        )
        self._mcap.start(profile=PROFILE, library="pomolog")
        images = "raw" if raw_images else "compressed"
        self.add_metadata("session", {**metadata, "profile": PROFILE, "images": images})
        topics = topics_of(raw_images=raw_images)
        self._pending_bytes = 0  # of the chunk in progress
        self._rig_closed = False
        self._channels = {topic: self._register(topic, kind) for topic, kind in topics.items()}
        self._sequence = dict.fromkeys(topics, 0)

    def _register(self, topic: str, kind: Any) -> int:
        name = kind.DESCRIPTOR.full_name
        schema = build_file_descriptor_set(kind).SerializeToString()
        self._pending_bytes += len(schema) + len(name) + len(topic) + 64  # 64: their fixed parts
        schema_id = self._mcap.register_schema(name=name, encoding="protobuf", data=schema)
        return int(self._mcap.register_channel(topic, "protobuf", schema_id))

    def write(
        self,
        topic: str,
        time_ns: int,
        data: bytes,
        *,
        publish_ns: int | None = None,
        sequence: int | None = None,
    ) -> None:
        """Write one serialised message of a topic of the profile."""
        if not self._rig_closed and topic not in RIG_TOPICS:
            self._rig_closed = True
            self.flush()  # a small first chunk with schemas and rig: little to lose it by
        size = len(data) + _MESSAGE_BYTES
        if self._pending_bytes + size > CHUNK_BYTES:
            self.flush()
        if sequence is None:
            sequence = self._sequence[topic]
        self._sequence[topic] = sequence + 1
        self._mcap.add_message(
            self._channels[topic],
            log_time=time_ns,
            data=data,
            publish_time=time_ns if publish_ns is None else publish_ns,
            sequence=sequence & 0xFFFFFFFF,
        )
        self._pending_bytes += size

    def copy(self, message: RawMessage) -> None:
        """Write a message of another file as it is."""
        self.write(
            message.topic,
            message.log_ns,
            message.data,
            publish_ns=message.publish_ns,
            sequence=message.sequence,
        )

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a metadata record with a checksum of its own: no chunk's CRC covers it."""
        self._mcap.add_metadata(name, with_crc(entries))

    def flush(self) -> None:
        """End the chunk in progress and hand it to the operating system."""
        self._mcap.flush()
        self._pending_bytes = 0

    def sync(self) -> None:
        """Flush, and wait until the disk itself has every byte."""
        self.flush()
        os.fdatasync(self._stream.fileno())

    def finish(self) -> None:
        """Write the index and the footer, and wait for the disk. Nothing may follow."""
        self._mcap.finish()
        self._stream.flush()
        os.fdatasync(self._stream.fileno())
