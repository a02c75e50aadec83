"""MCAP files taken apart, broken and written by hand, for tests of what reads them."""

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from recorder.mcap_records import MAGIC
from recorder.metadata import with_crc


@dataclass(frozen=True, slots=True)
class Record:
    """Where a record lies in a file: its opcode's place, and its body's."""

    opcode: int
    start: int
    body: int
    stop: int


def records_in(path: Path) -> list[Record]:
    """Every record of a whole MCAP file, chunks unopened."""
    data = path.read_bytes()
    found = []
    at = len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, at)
        found.append(Record(opcode, at, at + 9, at + 9 + length))
        at += 9 + length
    return found


def record(path: Path, opcode: Opcode, number: int = 0) -> Record:
    """The nth record of a kind."""
    return [r for r in records_in(path) if r.opcode == opcode][number]


def changed(path: Path, at: int, new: bytes, name: str = "changed.mcap") -> Path:
    """A copy with other bytes from `at` on."""
    data = bytearray(path.read_bytes())
    data[at : at + len(new)] = new
    out = path.with_name(name)
    out.write_bytes(data)
    return out


def flipped(path: Path, at: int, bit: int = 0, name: str = "flipped.mcap") -> Path:
    """A copy with one bit flipped."""
    return changed(path, at, bytes([path.read_bytes()[at] ^ (1 << bit)]), name)


def torn(path: Path, at: int, name: str = "torn.mcap") -> Path:
    """A copy that ends after `at` bytes."""
    out = path.with_name(name)
    out.write_bytes(path.read_bytes()[:at])
    return out


@dataclass(frozen=True, slots=True)
class HandChunk:
    """A chunk written by hand, so that it can lie about itself."""

    messages: Sequence[tuple[int, int, bytes]] = ()  # channel, log time, data
    compression: str = ""
    packed: bytes | None = None  # instead of what the messages pack to
    unpacked_bytes: int | None = None  # claimed
    unpacked_crc: int | None = None  # claimed; 0 says "not checked"
    times_ns: tuple[int, int] | None = None  # claimed first and last


@dataclass(frozen=True, slots=True)
class HandFile:
    """An MCAP file written by hand, record by record; fields overrule what would be true."""

    chunks: Sequence[HandChunk]
    topics: Mapping[int, str] = field(default_factory=lambda: {1: "/left/image", 2: "/right/image"})
    schema: str = "foxglove.CompressedImage"
    metadata: Mapping[str, str] = field(default_factory=lambda: {"profile": "pomolog/1"})
    counts: Mapping[int, int] | None = None
    chunk_count: int | None = None
    profile: str = "pomolog/1"
    index_copies: int = 1  # how often the summary lists each chunk

    def write(self, path: Path) -> Path:
        """Write the file."""
        out = RecordBuilder()
        out.write(MAGIC)
        Header(self.profile, "by hand").write(out)
        body = bytearray(out.end())
        metadata_start = len(body)
        Metadata("session", with_crc(self.metadata)).write(out)
        body += out.end()
        metadata_length = len(body) - metadata_start
        indexes = [_write_chunk(body, chunk) for chunk in self.chunks]
        DataEnd(0).write(out)
        body += out.end()
        summary_start = len(body)
        Schema(id=1, data=b"", encoding="protobuf", name=self.schema).write(out)
        for channel_id, topic in self.topics.items():
            Channel(channel_id, topic, "protobuf", {}, 1).write(out)
        counts: dict[int, int] = {}
        for chunk in self.chunks:
            for channel_id, _, _ in chunk.messages:
                counts[channel_id] = counts.get(channel_id, 0) + 1
        for index in indexes * self.index_copies:
            index.write(out)
        MetadataIndex(offset=metadata_start, length=metadata_length, name="session").write(out)
        known = counts if self.counts is None else dict(self.counts)
        chunk_count = len(indexes) * self.index_copies
        Statistics(
            attachment_count=0,
            channel_count=len(self.topics),
            channel_message_counts=known,
            chunk_count=chunk_count if self.chunk_count is None else self.chunk_count,
            message_count=sum(known.values()),
            message_end_time=0,
            message_start_time=0,
            metadata_count=1,
            schema_count=1,
        ).write(out)
        body += out.end()
        Footer(summary_start=summary_start, summary_offset_start=0, summary_crc=0).write(out)
        body += out.end() + MAGIC
        path.write_bytes(body)
        return path


def _write_chunk(body: bytearray, chunk: HandChunk) -> ChunkIndex:
    out = RecordBuilder()
    places: dict[int, list[tuple[int, int]]] = {}
    for channel_id, time_ns, data in chunk.messages:
        places.setdefault(channel_id, []).append((time_ns, out.count))
        Message(
            channel_id=channel_id, log_time=time_ns, data=data, publish_time=0, sequence=0
        ).write(out)
    plain = out.end()
    packed = plain if chunk.packed is None else chunk.packed
    times = [time_ns for _, time_ns, _ in chunk.messages] or [0]
    first_ns, last_ns = chunk.times_ns or (min(times), max(times))
    start = len(body)
    crc = zlib.crc32(plain) if chunk.unpacked_crc is None else chunk.unpacked_crc
    size = len(plain) if chunk.unpacked_bytes is None else chunk.unpacked_bytes
    Chunk(
        compression=chunk.compression,
        data=packed,
        message_end_time=last_ns,
        message_start_time=first_ns,
        uncompressed_crc=crc,
        uncompressed_size=size,
    ).write(out)
    body += out.end()
    length = len(body) - start
    offsets = {}
    for channel_id, entries in places.items():
        offsets[channel_id] = len(body)
        MessageIndex(channel_id=channel_id, records=entries).write(out)
        body += out.end()
    return ChunkIndex(
        chunk_length=length,
        chunk_start_offset=start,
        compression=chunk.compression,
        compressed_size=len(packed),
        message_end_time=last_ns,
        message_index_length=len(body) - start - length,
        message_index_offsets=offsets,
        message_start_time=first_ns,
        uncompressed_size=size,
    )
