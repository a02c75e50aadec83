"""Salvage: what is left of a torn or damaged recording, made into a whole session.

A recording that was cut off (power, `kill -9`) has every chunk up to the last but no index, and
may end within a chunk, or in zeros that the file system never filled. A damaged one fails a
chunk's CRC somewhere. Complete chunks that pass their CRC are kept; what they do not hold is
counted, never guessed.
"""

import io
import itertools
import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
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
    SummaryOffset,
)

from recorder.errors import PomologError, newer_profile
from recorder.files import replacing
from recorder.limits import DEFAULT_LIMITS, Limits
from recorder.mcap_records import (
    CHUNK_PREFIX,
    DAMAGE,
    MAGIC,
    RECORD_PREFIX,
    RawMessage,
    open_mcap,
    parse_chunk,
    reporting_damage,
    unpack_chunk,
)
from recorder.message_writer import MessageWriter
from recorder.metadata import is_sound, without_crc
from recorder.objects import Place
from recorder.profile import IMAGE_TOPICS, PROFILE, RAW_IMAGE_SCHEMA, TOPICS

OUR_SCHEMAS: Final = frozenset(("pomolog.RangeReading", "pomolog.FrameTruth"))

_BLOCK_BYTES: Final = 1 << 20

# a chunk, a message index, metadata or the end of the data, shorter than 4 GiB
_LANDMARK: Final = re.compile(rb"[\x06\x07\x0c\x0f].{4}\0{4}", re.DOTALL)

_OTHER_RECORDS: Final[dict[int, Any]] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}


@dataclass(slots=True)
class Wreck:
    """What a walk through a torn file has found so far."""

    path: Place
    header: Header | None = None
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    schemas: dict[int, str] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    raw_images: bool = False
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
        if self.profile == PROFILE:
            return dict(enumerate(TOPICS, start=1)).get(channel_id)
        return None

    @property
    def profile(self) -> str:
        """The profile by the metadata, which have a CRC; else by our schemas, or the header."""
        if "session" in self.metadata:
            return self.metadata["session"].get("profile", "")
        if not OUR_SCHEMAS.isdisjoint(self.schemas.values()):
            return PROFILE
        return self.header.profile if self.header else ""


def walk(wreck: Wreck, limits: Limits = DEFAULT_LIMITS) -> Iterator[RawMessage]:
    """Yield the messages of every complete chunk, in file order, and count in `wreck` what is lost.

    A chunk is believed if it is sound, any other record if another can begin at its end. Where
    neither is so (a damaged length, a hole of zeros), the next place that looks like a record is
    searched for.

    Raises:
        PomologError: the file cannot be read or is not MCAP.
    """
    with reporting_damage(wreck.path, "salvaging it"), open_mcap(wreck.path) as stream:
        ground = _Ground(stream, stream.seek(0, os.SEEK_END), limits)
        at = 0
        while at < ground.size:
            if ground.read(at, len(MAGIC)) == MAGIC:
                at += len(MAGIC)
                continue
            opcode, end = ground.extent(at)
            sound = False
            if end is not None:
                body = ground.read(at + RECORD_PREFIX.size, end - at - RECORD_PREFIX.size)
                try:
                    yield from _messages(wreck, opcode, body, limits)
                    sound = True
                except DAMAGE:
                    wreck.bytes_lost += len(body) if ground.may_begin(end) else 0
            wreck.chunks_lost += opcode == Opcode.CHUNK and not sound
            if end is not None and (ground.may_begin(end) or (sound and opcode == Opcode.CHUNK)):
                at = end
            else:
                following = ground.next_record(at + 1)
                wreck.bytes_lost += following - at
                at = following


@dataclass(frozen=True, slots=True)
class _Ground:
    """The bytes of a damaged file, and where in them records can be."""

    stream: BinaryIO
    size: int
    limits: Limits

    def read(self, at: int, length: int) -> bytes:
        self.stream.seek(at)
        return self.stream.read(length)

    def extent(self, at: int) -> tuple[int, int | None]:
        """The opcode at a place, and where its record ends; None if it cannot be one."""
        prefix = self.read(at, RECORD_PREFIX.size)
        if len(prefix) < RECORD_PREFIX.size:
            return 0, None
        opcode, length = RECORD_PREFIX.unpack(prefix)
        end = at + RECORD_PREFIX.size + length
        possible = opcode != 0 and length <= self.limits.record and end <= self.size
        return opcode, end if possible else None

    def may_begin(self, at: int) -> bool:
        """Whether a record, whole or cut off, can begin at a place: random bytes never pass."""
        prefix = self.read(at, RECORD_PREFIX.size)
        if len(prefix) < RECORD_PREFIX.size:
            return True
        opcode, length = RECORD_PREFIX.unpack(prefix)
        known = 0 < opcode <= Opcode.DATA_END and length <= self.limits.record
        return bool(known) or prefix.startswith(MAGIC)

    def next_record(self, start: int) -> int:
        """The next place that looks like a chunk or what follows one; the file's end if none."""
        for block_start in range(start, self.size, _BLOCK_BYTES):
            block = self.read(block_start, _BLOCK_BYTES + RECORD_PREFIX.size - 1)
            found = _LANDMARK.search(block)
            while found:
                at = block_start + found.start()
                if self._fits(at):
                    return at
                found = _LANDMARK.search(block, found.start() + 1)
        return self.size

    def _fits(self, at: int) -> bool:
        opcode, end = self.extent(at)
        if end is None:
            return False
        if opcode == Opcode.CHUNK:
            header = self.read(at + RECORD_PREFIX.size, CHUNK_PREFIX.size)
            if len(header) < CHUNK_PREFIX.size:
                return False
            first_ns, last_ns, _, _, name_bytes = CHUNK_PREFIX.unpack(header)
            rest = end - at - RECORD_PREFIX.size - CHUNK_PREFIX.size - name_bytes - 8
            lengths = self.read(end - rest - 8, 8) if rest >= 0 else b""
            return bool(first_ns <= last_ns) and lengths == rest.to_bytes(8, "little")
        return self.may_begin(end)


def _messages(wreck: Wreck, opcode: int, body: bytes, limits: Limits) -> Iterator[RawMessage]:
    """The messages of one record; of other records `wreck` notes what they say."""
    if opcode == Opcode.CHUNK:
        records = unpack_chunk(parse_chunk(body), limits)
        wreck.chunks += 1
        for item in records:
            if isinstance(item, Schema):
                wreck.schemas[item.id] = item.name
            elif isinstance(item, Channel):
                wreck.topics[item.id] = item.topic
                raw = wreck.schemas.get(item.schema_id) == RAW_IMAGE_SCHEMA
                wreck.raw_images |= raw and item.topic in IMAGE_TOPICS.values()
            elif isinstance(item, Message):
                topic = wreck.topic(item.channel_id)
                if topic not in TOPICS:
                    continue
                wreck.counts[topic] += 1
                times = [t for t in (wreck.start_ns, wreck.end_ns, item.log_time) if t is not None]
                wreck.start_ns, wreck.end_ns = min(times), max(times)
                yield RawMessage(topic, item.log_time, item.publish_time, item.sequence, item.data)
        return
    kind = _OTHER_RECORDS.get(opcode)
    if kind is None:
        raise McapError(f"an unknown record {opcode}")
    stream = ReadDataStream(io.BytesIO(body))
    record = kind.read(stream)
    if stream.count != len(body):
        raise McapError("a record's lengths do not add up")
    if isinstance(record, Header):
        wreck.header = record
    elif isinstance(record, Metadata):
        if not is_sound(record.metadata):
            raise McapError("metadata fail their CRC")
        wreck.metadata[record.name] = without_crc(record.metadata)


def survey(path: Place) -> Wreck:
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
    if wreck.profile.startswith("pomolog/") and wreck.profile != PROFILE:
        raise newer_profile(path, wreck.profile, PROFILE)
    if wreck.chunks and wreck.profile != PROFILE:
        raise PomologError(f"{path} is no pomolog session; salvage cannot judge what is in it")
    if first is None:
        raise PomologError(
            f"nothing to save in {path}: not one complete chunk of session messages; "
            "is it a pomolog session?"
        )
    name = os.fsencode(path.name).decode(errors="replace")  # a file's name need not be text
    metadata = {**wreck.metadata.get("session", {}), "salvaged_from": name}
    raw_images = wreck.raw_images or metadata.get("images") == "raw"
    with replacing(out) as part, part.open("wb") as stream:
        writer = MessageWriter(stream, metadata, raw_images=raw_images)
        for message in itertools.chain((first,), messages):
            writer.copy(message)
        for record in ("pictures", "ledger"):
            if record in wreck.metadata:
                writer.add_metadata(record, wreck.metadata[record])
        writer.finish()
    return wreck
