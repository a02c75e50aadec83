"""Salvage: what is left of a torn or damaged recording, made into a whole session.

A recording that was cut off (power, `kill -9`) has every chunk up to the last but no index, and
may end within a chunk. A damaged one fails a chunk's CRC somewhere. Complete chunks that pass
their CRC are kept; what they do not hold is counted, never guessed.
"""

import io
import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Message, Metadata

from recorder.container import (
    DAMAGE,
    DEFAULT_LIMITS,
    Limits,
    RawMessage,
    open_mcap,
    parse_chunk,
    read_record,
    unpack_chunk,
)
from recorder.errors import PomologError
from recorder.files import replacing
from recorder.message_writer import MessageWriter, metadata_crc
from recorder.profile import IMAGE_TOPICS, PROFILE, TOPICS


@dataclass(slots=True)
class Wreck:
    """What a walk through a torn file has found so far."""

    path: Path
    header: Header | None = None
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    chunks: int = 0
    chunks_lost: int = 0
    bytes_lost: int = 0
    start_ns: int | None = None
    end_ns: int | None = None

    @property
    def frames(self) -> int:
        """Pictures of both views."""
        return sum(self.counts[topic] for topic in IMAGE_TOPICS.values())

    def topic(self, channel_id: int) -> str | None:
        """A channel's topic; where its record is lost, the profile's fixed order says it."""
        if channel_id in self.topics:
            return self.topics[channel_id]
        if self.header is not None and self.header.profile == PROFILE:
            return dict(enumerate(TOPICS, start=1)).get(channel_id)
        return None


def walk(wreck: Wreck, limits: Limits = DEFAULT_LIMITS) -> Iterator[RawMessage]:
    """Yield the messages of every complete chunk, in file order, and count in `wreck` what is lost.

    Raises:
        PomologError: the file cannot be read or is not MCAP.
    """
    size = wreck.path.stat().st_size if wreck.path.is_file() else 0
    with open_mcap(wreck.path) as stream:
        while True:
            start = stream.tell()
            try:
                opcode, body = read_record(stream, limits)
            except (EOFError, McapError):
                wreck.bytes_lost += size - start
                return
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            try:
                yield from _messages(wreck, opcode, body, limits)
            except DAMAGE:
                wreck.chunks_lost += opcode == Opcode.CHUNK
                wreck.bytes_lost += len(body)


def _messages(wreck: Wreck, opcode: int, body: bytes, limits: Limits) -> Iterator[RawMessage]:
    """The messages of one record; other records are noted in `wreck`."""
    record_stream = ReadDataStream(io.BytesIO(body))
    if opcode == Opcode.HEADER:
        wreck.header = Header.read(record_stream)
    elif opcode == Opcode.METADATA:
        record = Metadata.read(record_stream)
        entries = {key: value for key, value in record.metadata.items() if key != "crc32"}
        if record.metadata.get("crc32") == metadata_crc(entries):
            wreck.metadata[record.name] = entries
    elif opcode == Opcode.CHUNK:
        records = unpack_chunk(parse_chunk(body), limits)
        wreck.chunks += 1
        for item in records:
            if isinstance(item, Channel):
                wreck.topics[item.id] = item.topic
            elif isinstance(item, Message):
                topic = wreck.topic(item.channel_id)
                if topic not in TOPICS:
                    continue
                wreck.counts[topic] += 1
                times = [t for t in (wreck.start_ns, wreck.end_ns, item.log_time) if t is not None]
                wreck.start_ns, wreck.end_ns = min(times), max(times)
                yield RawMessage(topic, item.log_time, item.publish_time, item.sequence, item.data)


def survey(path: Path) -> Wreck:
    """Walk through a torn file and only count."""
    wreck = Wreck(path)
    for _ in walk(wreck):
        pass
    return wreck


def salvage(path: Path, out: Path) -> Wreck:
    """Write every complete chunk's messages to a whole session.

    Returns:
        What was found and what was lost.

    Raises:
        PomologError: nothing is left to save, it is no pomolog session, or `out` is the same file.
    """
    if out.exists() and path.exists() and out.samefile(path):
        raise PomologError(f"{out} is the torn file itself; give -o another name")
    wreck = Wreck(path)
    messages = walk(wreck)
    first = next(messages, None)  # by then the header and the session's metadata are read
    if first is None:
        raise PomologError(
            f"nothing to save in {path}: not one complete chunk of session messages; "
            "is it a pomolog session?"
        )
    metadata = {**wreck.metadata.get("session", {}), "salvaged_from": path.name}
    raw_images = metadata.get("images") == "raw"
    with replacing(out) as part, part.open("wb") as stream:
        writer = MessageWriter(stream, metadata, raw_images=raw_images)
        for message in itertools.chain((first,), messages):
            writer.copy(message)
        if "ledger" in wreck.metadata:
            writer.add_metadata("ledger", wreck.metadata["ledger"])
        writer.finish()
    return wreck
