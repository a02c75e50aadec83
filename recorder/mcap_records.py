"""Single MCAP records of files that may be torn, damaged or hostile: every size bounded.

The `mcap` library's readers trust a file's own numbers (a 65 KB chunk may unpack to 2 GiB, and a
flipped bit passes unless asked about), so records are cut out and chunks unpacked here, and only
the parsing of a single record is left to the library. Format: https://mcap.dev/spec.
"""

import io
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, cast

import lz4.frame
import numpy as np
import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord, Message
from mcap.stream_reader import breakup_chunk

from recorder.errors import PomologError, TornFileError
from recorder.limits import DEFAULT_LIMITS, Limits
from recorder.objects import ObjectPath, Place

MAGIC: Final = bytes((137, 77, 67, 65, 80, 48, 13, 10))
RECORD_PREFIX: Final = struct.Struct("<BQ")  # opcode, length: before every record
CHUNK_PREFIX: Final = struct.Struct("<QQQII")  # times, size, CRC, length of the compression's name
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")  # channel, sequence, log and publish time

# What the parsers raise on damaged bytes, found by mutating good files; OSError is a seek to an
# absurd place, or a disk that fails.
DAMAGE: Final = (
    McapError, DecodeError, struct.error, ValueError, KeyError, IndexError, OverflowError,
    OSError, EOFError, RuntimeError, MemoryError, zstandard.ZstdError,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class RawMessage:
    """One message as it lies in the file, not yet decoded."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes = field(repr=False)


SALVAGE: Final = "pomolog salvage {path} -o whole.mcap"  # what mends a session


@contextmanager
def reporting_damage(path: Place, doing: str, remedy: str = SALVAGE) -> Iterator[None]:
    """Turn what parsers raise on damaged bytes into one line that names the file."""
    try:
        yield
    except DAMAGE as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise PomologError(
            f"{path} is damaged ({doing}: {reason[:200]}); try: {remedy.format(path=path)}"
        ) from None


def open_mcap(path: Place) -> BinaryIO:
    """Open a file, or an object, and make sure that it begins as an MCAP does.

    Raises:
        PomologError: no such file, a folder, or something else than MCAP.
    """
    stream = cast("BinaryIO", path.open()) if isinstance(path, ObjectPath) else _open_file(path)
    start = stream.read(len(MAGIC))
    if start == MAGIC:
        return stream
    stream.close()
    if MAGIC.startswith(start):  # also an empty file: cut off before it began
        raise TornFileError(f"{path} is empty; nothing was recorded in it")
    raise PomologError(
        f"{path} is not an MCAP file; import pictures with: pomolog import frames LEFT RIGHT"
    )


def _open_file(path: Path) -> BinaryIO:
    if path.is_dir():
        raise PomologError(f"{path} is a folder, not a session; give one of the .mcap files in it")
    if path.exists() and not path.is_file():  # opening a pipe would wait for its other end
        raise PomologError(f"{path} is not a file; give a session (.mcap)")
    try:
        return path.open("rb")
    except OSError as error:
        raise PomologError(f"cannot read {path}: {error.strerror}; is the name right?") from None


def unpack_chunk(chunk: Chunk, limits: Limits = DEFAULT_LIMITS) -> list[McapRecord]:
    """Decompress a chunk within bounds, check its CRC, and split it into records.

    Raises:
        McapError, ValueError, zstandard.ZstdError: the chunk is damaged, or too large unpacked.
    """
    if chunk.uncompressed_size > limits.chunk:
        raise McapError(
            f"a chunk of {chunk.uncompressed_size} bytes unpacked, more than {limits.chunk}"
        )
    room = chunk.uncompressed_size
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
            unpacked = reader.read(room + 1)
    elif chunk.compression == "lz4":
        unpacked = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=room + 1)
    elif chunk.compression == "":
        unpacked = chunk.data
    else:
        raise McapError(f"unknown compression {chunk.compression[:20]!r}")
    if len(unpacked) != room:
        raise McapError(f"a chunk unpacks to {len(unpacked)} bytes or more instead of {room}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(unpacked)):
        raise McapError("a chunk fails its CRC")
    _hold_against(unpacked, limits)
    plain = Chunk(
        compression="",
        data=unpacked,
        message_start_time=chunk.message_start_time,
        message_end_time=chunk.message_end_time,
        uncompressed_crc=0,
        uncompressed_size=room,
    )
    return breakup_chunk(plain)


def _hold_against(unpacked: bytes, limits: Limits) -> None:
    """Make sure that records fill a chunk exactly, and are not too many."""
    at = records = 0
    while at + RECORD_PREFIX.size <= len(unpacked) and records <= limits.chunk_records:
        at += RECORD_PREFIX.size + RECORD_PREFIX.unpack_from(unpacked, at)[1]
        records += 1
    if records > limits.chunk_records:
        raise McapError(f"a chunk unpacks to more than {limits.chunk_records} records")
    if at != len(unpacked):
        raise McapError("a chunk's records do not fill it")


def read_record(stream: BinaryIO, limits: Limits = DEFAULT_LIMITS) -> tuple[int, bytes]:
    """Read one record's opcode and body.

    Raises:
        EOFError: the file ends within the record.
        McapError: the record is larger than the limit.
    """
    prefix = stream.read(RECORD_PREFIX.size)
    if len(prefix) < RECORD_PREFIX.size:
        raise EOFError("the file ends within a record")
    opcode, length = RECORD_PREFIX.unpack(prefix)
    if length > limits.record:
        raise McapError(f"a record of {length} bytes, more than {limits.record}")
    body = stream.read(length)
    if len(body) < length:
        raise EOFError("the file ends within a record")
    return opcode, body


def parse_chunk(body: bytes) -> Chunk:
    """Parse a chunk record's body; every length inside is held against the body's."""
    if len(body) < CHUNK_PREFIX.size:
        raise McapError("a chunk record is too short")
    chunk: Chunk = Chunk.read(ReadDataStream(io.BytesIO(body)))
    name_bytes = len(chunk.compression.encode())
    if CHUNK_PREFIX.size + name_bytes + 8 + len(chunk.data) != len(body):
        raise McapError("a chunk record's lengths do not add up")
    return chunk


def loose_messages(
    stream: BinaryIO, end: int, expected: Mapping[int, int], limits: Limits = DEFAULT_LIMITS
) -> Iterator[Message]:
    """The messages of a file without chunks (rosbag2's `fastwrite`), in the order of their times.

    Args:
        stream: the file.
        end: where its data end.
        expected: how many messages each wanted channel has.
        limits: bound each record; 16 bytes a message are held.

    Raises:
        McapError, EOFError, struct.error: the file is damaged, or messages are missing.
    """
    times, places = array("Q"), array("Q")
    seen: Counter[int] = Counter()
    stream.seek(len(MAGIC))
    while (place := stream.tell()) < end:
        opcode, body = read_record(stream, limits)
        if opcode != Opcode.MESSAGE:
            continue
        channel_id, _, log_ns, _ = _MESSAGE_HEAD.unpack_from(body)
        if channel_id in expected:
            seen[channel_id] += 1
            times.append(log_ns)
            places.append(place)
    for channel_id, count in expected.items():
        if seen[channel_id] != count:
            raise McapError(f"{seen[channel_id]} messages of a channel, {count} counted")
    for number in np.argsort(np.array(times), kind="stable").tolist():
        stream.seek(places[number])
        _, body = read_record(stream, limits)
        channel_id, sequence, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(body)
        data = body[_MESSAGE_HEAD.size :]
        yield Message(
            channel_id=channel_id, data=data, log_time=log_ns, publish_time=publish_ns,
            sequence=sequence,
        )  # fmt: skip
