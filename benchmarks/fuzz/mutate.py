"""Mutations: bytes, the words of a text, and MCAP files whose checksums are mended afterwards."""

import os
import random
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode

from recorder.container import Container
from recorder.mcap_records import RECORD_PREFIX, RawMessage
from recorder.message_writer import MessageWriter
from tests.mcap_files import records_in

ODD_NUMBERS: Final = (
    "0", "-1", "1", "nan", "inf", "-inf", "1e308", "-1e-320", "9" * 25, "9" * 5000, "2147483648",
    "18446744073709551615", "0x10", "1_000", "true", '"x"', "[]", "{}", "null", "1e9", "65535",
)  # fmt: skip
ODD_BYTES: Final = (0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, (1 << 63) - 1)
_NUMBER: Final = re.compile(rb"-?\d+(\.\d*)?(e[-+]?\d+)?")


def flip(data: bytearray, dice: random.Random) -> None:
    """One bit: what storage does to a file."""
    data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)


def _set(data: bytearray, dice: random.Random) -> None:
    data[dice.randrange(len(data))] = dice.randrange(256)


def _number(data: bytearray, dice: random.Random) -> None:
    width = dice.choice((1, 2, 4, 8))
    at = dice.randrange(max(1, len(data) - width))
    data[at : at + width] = (dice.choice(ODD_BYTES) % (1 << 8 * width)).to_bytes(width, "little")


def _cut(data: bytearray, dice: random.Random) -> None:
    at = dice.randrange(len(data))
    del data[at : at + dice.choice((1, 4, 30, 400))]


def _end(data: bytearray, dice: random.Random) -> None:
    del data[dice.randrange(len(data)) :]


def _again(data: bytearray, dice: random.Random) -> None:
    at, length = dice.randrange(len(data)), dice.choice((1, 8, 60, 2000))
    data[at:at] = data[at : at + length] * dice.choice((1, 1, 1, 50))


def _zero(data: bytearray, dice: random.Random) -> None:
    at, length = dice.randrange(len(data)), dice.choice((1, 8, 60, 2000))
    data[at : at + length] = bytes(len(data[at : at + length]))


def _swap(data: bytearray, dice: random.Random) -> None:
    one, other = sorted((dice.randrange(len(data)), dice.randrange(len(data))))
    length = dice.choice((1, 8, 60))
    data[one : one + length], data[other : other + length] = (
        data[other : other + length], data[one : one + length],
    )  # fmt: skip


BYTES: Final[tuple[Callable[[bytearray, random.Random], None], ...]] = (
    flip, flip, _set, _number, _number, _cut, _end, _again, _zero, _swap,
)  # fmt: skip


def mutate_bytes(data: bytes, dice: random.Random) -> bytes:
    """One to eight mutations of any bytes."""
    changed = bytearray(data)
    for _ in range(dice.choice((1, 1, 1, 2, 4, 8))):
        if changed:
            dice.choice(BYTES)(changed, dice)
    return bytes(changed)


def mutate_words(data: bytes, dice: random.Random) -> bytes:
    """The same of a text: odd numbers, lines twice, gone or elsewhere, deep nests; or its bytes."""
    if dice.random() < 0.3:
        return mutate_bytes(data, dice)
    changed = data
    for _ in range(dice.choice((1, 1, 2, 4))):
        kind = dice.randrange(6)
        numbers = list(_NUMBER.finditer(changed))
        if kind <= 2 and numbers:
            one = dice.choice(numbers)
            odd = dice.choice(ODD_NUMBERS).encode()
            changed = changed[: one.start()] + odd + changed[one.end() :]
        elif kind == 5:
            at = dice.randrange(len(changed) + 1)
            changed = changed[:at] + dice.choice((b"[", b"{", b'"', b"&a ")) * 3000 + changed[at:]
        else:
            lines = changed.split(b"\n")
            line = lines.pop(dice.randrange(len(lines)))
            for _ in range(dice.choice((0, 1, 2, 100))):
                lines.insert(dice.randrange(len(lines) + 1), line)
            changed = b"\n".join(lines)
    return changed


def mutate_messages(path: Path, dice: random.Random) -> bytes:
    """A session written anew, every checksum right, with messages that lie."""
    with Container(path) as container:
        messages = list(container.messages())
        metadata = dict(container.metadata())
    for _ in range(dice.choice((1, 1, 2, 4))):
        at = dice.randrange(len(messages))
        messages[at] = _lying(messages[at], messages, dice)
        if dice.random() < 0.2:
            del messages[dice.randrange(len(messages)) : dice.choice((None, len(messages) // 2))]
        if not messages:
            break
    session = metadata.pop("session")
    if dice.random() < 0.3:
        key = dice.choice((*session, "max_skew_ns", "rangefinder_std_m"))
        session[key] = dice.choice((*ODD_NUMBERS, "../../x", "\0", "pomolog/9"))
    with os.fdopen(os.memfd_create("session"), "w+b") as stream:  # a writer syncs its disk
        _write(stream, session, messages, metadata)
        stream.seek(0)
        return stream.read()


def _write(
    stream: BinaryIO,
    session: dict[str, str],
    messages: Sequence[RawMessage],
    metadata: dict[str, dict[str, str]],
) -> None:
    writer = MessageWriter(stream, {k: v for k, v in session.items() if k != "crc32"})
    for message in messages:
        writer.copy(message)
    for name, entries in metadata.items():
        writer.add_metadata(name, entries)
    writer.finish()


def _lying(message: RawMessage, messages: Sequence[RawMessage], dice: random.Random) -> RawMessage:
    topic, log_ns, data = message.topic, message.log_ns, message.data
    kind = dice.randrange(4)
    if kind == 0:
        log_ns = dice.choice((0, log_ns + 1, 10**9, 2**62, 2**63 - 1, dice.randrange(4 * 10**9)))
    elif kind == 1:
        topic = dice.choice(messages).topic
    else:
        data = mutate_bytes(data, dice) if data else b"\1"
    return RawMessage(topic, log_ns, message.publish_ns, message.sequence, data)


def mutate_index(path: Path, dice: random.Random) -> bytes:
    """A session whose index, metadata or message indexes lie, under a right checksum."""
    data = bytearray(path.read_bytes())
    records = records_in(path)
    data_end = next(r for r in records if r.opcode == Opcode.DATA_END)
    aims = (Opcode.MESSAGE_INDEX, Opcode.METADATA, Opcode.CHUNK_INDEX, Opcode.STATISTICS,
            Opcode.CHANNEL, Opcode.SCHEMA, Opcode.METADATA_INDEX, Opcode.FOOTER)  # fmt: skip
    found = [r for r in records if r.opcode in aims and r.stop > r.body]
    for _ in range(dice.choice((1, 1, 2))):
        one = dice.choice(found)
        part = data[one.body : one.stop]
        dice.choice((flip, _set, _number, _swap, _zero))(part, dice)
        data[one.body : one.stop] = part[: one.stop - one.body].ljust(one.stop - one.body, b"\0")
    footer = next(r for r in records if r.opcode == Opcode.FOOTER)
    start = data_end.stop
    struct.pack_into("<I", data, data_end.body, zlib.crc32(data[: data_end.start]))
    crc = zlib.crc32(data[start : footer.start + RECORD_PREFIX.size + 16])
    struct.pack_into("<I", data, footer.stop - 4, crc)
    return bytes(data)
