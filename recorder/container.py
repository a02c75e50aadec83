"""A whole MCAP file, read by its index and trusted in nothing: places, times, counts and CRCs.

`recorder.mcap_index` reads the index, `recorder.mcap_records` single records within bounds.
"""

import heapq
import io
import zlib
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Final, cast

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    ChunkIndex,
    DataEnd,
    Header,
    McapRecord,
    Message,
    Metadata,
)

from recorder.limits import DEFAULT_LIMITS, Limits
from recorder.mcap_index import index_times, read_index
from recorder.mcap_records import (
    MAGIC,
    RECORD_PREFIX,
    SALVAGE,
    RawMessage,
    loose_messages,
    open_mcap,
    parse_chunk,
    read_record,
    reporting_damage,
    unpack_chunk,
)
from recorder.objects import FETCH_BYTES, ObjectReader, Place

CHUNKS_AT_ONCE: Final = 4  # of 4 MiB: asked of object storage side by side
MANY_IN_A_CHUNK: Final = 16  # messages of a topic; more need one more request
_HELD_BYTES: Final = 400  # what a message in memory takes beside its data


class Container:
    """A whole MCAP file, read by its index. Use it as a context manager.

    Args:
        path: the file.
        limits: what it may ask of this machine's memory.
        remedy: the command that mends such a file, with its {path}.

    Attributes:
        index: what the file says that it holds.
        header: its first record.
        size_bytes: all of it.

    Raises:
        TornFileError: the file ends without an index.
        PomologError: not MCAP, damaged, or beyond the limits.
    """

    def __init__(self, path: Place, limits: Limits = DEFAULT_LIMITS, remedy: str = SALVAGE) -> None:
        self.path = path
        self.limits = limits
        self._remedy = remedy
        self._stream = open_mcap(path)
        try:
            self.size_bytes = self._stream.seek(0, io.SEEK_END)
            with self._reporting("its index"):
                self.index = read_index(self._stream, self.size_bytes, limits, path, remedy)
            with self._reporting("its header"):
                self.header = self._read_header()
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> "Container":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def _reporting(self, doing: str) -> AbstractContextManager[None]:
        return reporting_damage(self.path, doing, self._remedy)

    def counts(self) -> dict[str, int]:
        """Messages by topic, as the file's own statistics have them."""
        counts: Counter[str] = Counter()
        for channel_id, channel in self.index.channels.items():
            counts[channel.topic] += self.index.statistics.channel_message_counts.get(channel_id, 0)
        return dict(counts)

    def schema_name(self, topic: str) -> str | None:
        """The schema of a topic, or None where the file has no such topic."""
        for channel in self.index.channels.values():
            if channel.topic == topic:
                schema = self.index.schemas.get(channel.schema_id)
                return schema.name if schema else ""
        return None

    def times_ns(self, topic: str) -> npt.NDArray[np.int64]:
        """The log times of one topic, sorted, from the indexes alone: no message is read.

        Raises:
            PomologError: an index is damaged, or the file was written without them.
        """
        wanted = self._wanted((topic,))
        times = [np.empty(0, np.uint64)]
        with self._reporting("its message index"):
            self._announce(
                [
                    (offset, RECORD_PREFIX.size + 6 + 16 * MANY_IN_A_CHUNK)
                    for chunk_index in self.index.chunks
                    for i, offset in chunk_index.message_index_offsets.items()
                    if i in wanted
                ]
            )
            for chunk_index in self.index.chunks:
                for channel_id, offset in chunk_index.message_index_offsets.items():
                    if channel_id not in wanted:
                        continue
                    self._stream.seek(offset)
                    opcode, body = read_record(self._stream, self.limits)
                    if opcode != Opcode.MESSAGE_INDEX:
                        raise McapError("no message index where one should be")
                    times.append(index_times(body, channel_id, chunk_index))
            found = np.sort(np.concatenate(times))
            expected = self.counts().get(topic, 0)
            if len(found) != expected:
                raise McapError(f"{len(found)} {topic} messages indexed, {expected} counted")
            if len(found) and found[-1] > np.iinfo(np.int64).max:
                raise McapError(f"a {topic} message of the year 2262 or later")
            return found.astype(np.int64)

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        stop_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """Yield messages of `start_ns <= log time < stop_ns` in the order of their log times.

        A run over all times is held against the file's statistics at its end.

        Raises:
            PomologError: a chunk is damaged or too large, or messages are missing.
        """
        with self._reporting("reading messages"):
            if self.index.chunks or not self.index.statistics.message_count:
                yield from self._messages(topics, start_ns, stop_ns)
                return
            wanted = self._wanted(topics)
            counts = self.index.statistics.channel_message_counts
            expected = {i: counts.get(i, 0) for i in wanted}
            for message in loose_messages(self._stream, self.index.start, expected, self.limits):
                late = stop_ns is not None and message.log_time >= stop_ns
                if not late and (start_ns is None or message.log_time >= start_ns):
                    yield self._raw(message)

    def _messages(
        self, topics: Collection[str] | None, start_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        wanted = self._wanted(topics)
        seen: Counter[int] = Counter()
        waiting: list[tuple[int, int, int, Message]] = []  # log time, chunk, place in chunk
        held = 0
        chunks = [c for c in self.index.chunks if self._may_hold(c, wanted, start_ns, stop_ns)]
        for number, chunk_index in enumerate(chunks):
            if number % CHUNKS_AT_ONCE == 0:
                coming = chunks[number : number + CHUNKS_AT_ONCE]
                self._announce([(c.chunk_start_offset, c.chunk_length) for c in coming])
            while waiting and waiting[0][0] < chunk_index.message_start_time:
                *_, message = heapq.heappop(waiting)
                held -= len(message.data) + _HELD_BYTES
                yield self._raw(message)
            for place, record in enumerate(self._chunk(chunk_index)):
                if not isinstance(record, Message) or record.channel_id not in wanted:
                    if isinstance(record, Message) and record.channel_id not in self.index.channels:
                        raise McapError(f"a message of unknown channel {record.channel_id}")
                    continue
                seen[record.channel_id] += 1
                if start_ns is not None and record.log_time < start_ns:
                    continue
                if stop_ns is not None and record.log_time >= stop_ns:
                    continue
                heapq.heappush(waiting, (record.log_time, number, place, record))
                held += len(record.data) + _HELD_BYTES
            if held > self.limits.overlap:
                raise McapError(f"chunks overlap in time by more than {self.limits.overlap} bytes")
        while waiting:
            *_, message = heapq.heappop(waiting)
            yield self._raw(message)
        if start_ns is None and stop_ns is None:
            expected = self.index.statistics.channel_message_counts
            lost = sum(expected.get(i, 0) for i in wanted) - sum(seen.values())
            if lost:
                raise McapError(f"{abs(lost)} messages {'missing' if lost > 0 else 'too many'}")

    def _wanted(self, topics: Collection[str] | None) -> set[int]:
        """The channels of some topics, or of all."""
        return {i for i, c in self.index.channels.items() if topics is None or c.topic in topics}

    def _announce(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Say what is read next: object storage is asked for all of it at once, within bounds."""
        if isinstance(self._stream, ObjectReader) and sum(n for _, n in ranges) <= FETCH_BYTES:
            self._stream.announce(ranges)

    def _raw(self, message: Message) -> RawMessage:
        return RawMessage(
            self.index.channels[message.channel_id].topic,
            message.log_time,
            message.publish_time,
            message.sequence,
            message.data,
        )

    @staticmethod
    def _may_hold(
        index: ChunkIndex, wanted: set[int], start_ns: int | None, stop_ns: int | None
    ) -> bool:
        if start_ns is not None and index.message_end_time < start_ns:
            return False
        if stop_ns is not None and index.message_start_time >= stop_ns:
            return False
        return not index.message_index_offsets or not wanted.isdisjoint(index.message_index_offsets)

    def _chunk(self, index: ChunkIndex) -> list[McapRecord]:
        self._stream.seek(index.chunk_start_offset)
        opcode, body = read_record(self._stream, self.limits)
        if opcode != Opcode.CHUNK or RECORD_PREFIX.size + len(body) != index.chunk_length:
            raise McapError("no chunk where the index has one")
        chunk = parse_chunk(body)
        records = unpack_chunk(chunk, self.limits)
        times = [record.log_time for record in records if isinstance(record, Message)]
        if times and not (
            index.message_start_time <= min(times) and max(times) <= index.message_end_time
        ):
            raise McapError("a chunk holds messages from outside its time")
        return records

    def metadata(self) -> dict[str, dict[str, str]]:
        """Every metadata record by name; the last one of a name counts."""
        found: dict[str, dict[str, str]] = {}
        with self._reporting("its metadata"):
            for index in self.index.metadata:
                self._stream.seek(index.offset)
                opcode, body = read_record(self._stream, self.limits)
                if opcode != Opcode.METADATA:
                    raise McapError("no metadata where the index has some")
                record = Metadata.read(ReadDataStream(io.BytesIO(body)))
                if record.name != index.name:
                    raise McapError(f"other metadata than {index.name!r} where the index has them")
                found[record.name] = dict(record.metadata)
        return found

    def verify(self) -> None:
        """Read every byte once and hold it against every checksum that the file has.

        Raises:
            PomologError: at the first thing that does not agree.
        """
        with self._reporting("checking all of it"):
            self._stream.seek(len(MAGIC))
            crc = zlib.crc32(MAGIC)
            while True:
                opcode, body = read_record(self._stream, self.limits)
                if opcode == Opcode.DATA_END:
                    break
                if opcode == Opcode.CHUNK:
                    unpack_chunk(parse_chunk(body), self.limits)
                crc = zlib.crc32(body, zlib.crc32(RECORD_PREFIX.pack(opcode, len(body)), crc))
            expected = DataEnd.read(ReadDataStream(io.BytesIO(body))).data_section_crc
            if expected not in (0, crc) or self._stream.tell() != self.index.start:
                raise McapError("the data before the index fail their CRC")
            for _ in self._messages(None, None, None):
                pass

    def _read_header(self) -> Header:
        self._stream.seek(len(MAGIC))
        opcode, body = read_record(self._stream, self.limits)
        if opcode != Opcode.HEADER:
            raise McapError("the first record is no header")
        return cast("Header", Header.read(ReadDataStream(io.BytesIO(body))))
