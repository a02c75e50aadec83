"""The index at the end of an MCAP file: what it says that the file holds, held against itself."""

import hashlib
import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
)

from recorder.errors import TornFileError
from recorder.limits import Limits
from recorder.mcap_records import MAGIC, RECORD_PREFIX, read_record
from recorder.objects import Place

_FOOTER_BYTES: Final = RECORD_PREFIX.size + 20
_DATA_END_BYTES: Final = RECORD_PREFIX.size + 4
_INDEXED: Final[dict[int, Any]] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.STATISTICS: Statistics,
}


@dataclass(frozen=True, slots=True, eq=False)
class Index:
    """What a whole file holds, and where.

    Attributes:
        start: where the index begins in the file, and the data end.
        fingerprint: a short hash of it and of the CRC over all data.
        schemas: by their ids.
        channels: by their ids.
        chunks: in the order of their first messages.
        metadata: as they lie in the file.
        statistics: how many messages there are of each channel.
    """

    start: int
    fingerprint: str
    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    chunks: tuple[ChunkIndex, ...]
    metadata: tuple[MetadataIndex, ...]
    statistics: Statistics


def read_index(
    stream: BinaryIO, size_bytes: int, limits: Limits, path: Place, remedy: str
) -> Index:
    """Read a file's index from its end.

    Args:
        stream: the file.
        size_bytes: all of it.
        limits: bound the index.
        path: for messages.
        remedy: the command that mends a file without one, with its {path}.

    Raises:
        TornFileError: there is none.
        McapError, EOFError, struct.error: it is damaged, or says what cannot be.
    """
    tail_bytes = _FOOTER_BYTES + len(MAGIC)
    stream.seek(max(0, size_bytes - tail_bytes))
    tail = stream.read()
    if len(tail) < tail_bytes or not tail.endswith(MAGIC) or tail[0] != Opcode.FOOTER:
        raise TornFileError(
            f"{path} ends without an index; was recording cut off? try: {remedy.format(path=path)}"
        )
    footer = Footer.read(ReadDataStream(io.BytesIO(tail[RECORD_PREFIX.size :])))
    start = footer.summary_start
    length = size_bytes - tail_bytes - start
    if not _DATA_END_BYTES < start < size_bytes or length < 0:
        raise TornFileError(f"{path} has no index; try: {remedy.format(path=path)}")
    if length > limits.record:
        raise McapError(f"an index of {length} bytes, more than {limits.record}")
    stream.seek(start - _DATA_END_BYTES)  # the CRC over all data stands before the index
    data_end = stream.read(_DATA_END_BYTES)
    summary = stream.read(length)
    footer_start = tail[: RECORD_PREFIX.size + 16]
    if footer.summary_crc not in (0, zlib.crc32(footer_start, zlib.crc32(summary))):
        raise McapError("the index fails its CRC")
    index = _sorted_out(list(_records(summary)), start, data_end + summary)
    _check_places(index)
    return index


def index_times(body: bytes, channel_id: int, chunk: ChunkIndex) -> npt.NDArray[np.uint64]:
    """The times in a message index's body; no CRC covers them, so the chunk's time bounds them.

    Raises:
        McapError, struct.error: it is of another channel or damaged.
    """
    found_id, length = struct.unpack_from("<HI", body)
    if found_id != channel_id:
        raise McapError("a message index of another channel")
    if length != len(body) - 6:
        raise McapError("a message index's lengths do not add up")
    times = np.frombuffer(body, "<u8", offset=6).reshape(-1, 2)[:, 0]
    if len(times) and not (
        chunk.message_start_time <= times.min() and times.max() <= chunk.message_end_time
    ):
        raise McapError("a message index has messages from outside its chunk's time")
    return times


def _records(summary: bytes) -> Iterator[McapRecord]:
    stream = io.BytesIO(summary)
    while stream.tell() < len(summary):
        opcode, body = read_record(stream)
        if opcode in _INDEXED:
            yield _INDEXED[opcode].read(ReadDataStream(io.BytesIO(body)))


def _sorted_out(records: list[McapRecord], start: int, hashed: bytes) -> Index:
    chunks = [one for one in records if isinstance(one, ChunkIndex)]
    statistics = [one for one in records if isinstance(one, Statistics)]
    if not statistics:
        raise McapError("no statistics")
    if statistics[-1].chunk_count != len(chunks):
        raise McapError(f"{len(chunks)} chunks indexed, {statistics[-1].chunk_count} counted")
    return Index(
        start=start,
        fingerprint=hashlib.sha256(hashed).hexdigest()[:16],
        schemas={one.id: one for one in records if isinstance(one, Schema)},
        channels={one.id: one for one in records if isinstance(one, Channel)},
        chunks=tuple(sorted(chunks, key=lambda c: (c.message_start_time, c.chunk_start_offset))),
        metadata=tuple(one for one in records if isinstance(one, MetadataIndex)),
        statistics=statistics[-1],
    )


def _check_places(index: Index) -> None:
    """Every chunk and message index has a place of its own, so that none is read twice."""
    places = sorted(index.chunks, key=lambda chunk: chunk.chunk_start_offset)
    starts = [chunk.chunk_start_offset for chunk in places] + [index.start]
    for chunk, following in zip(places, starts[1:], strict=True):
        end = chunk.chunk_start_offset + chunk.chunk_length
        offsets = chunk.message_index_offsets.values()
        if end > following or not all(end <= offset < following for offset in offsets):
            raise McapError("chunks are indexed one over the other")
