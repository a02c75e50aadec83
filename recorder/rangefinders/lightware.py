"""LightWare SF11, SF20, LW20 and kin, as text or as binary packets.

Text (SF11/C manual; LW20/SF20 product manual, "Legacy commands"): `d` is answered `98.67`, `?LD`
`?LD 98.67`, `?LDF,0` `ld,0:23.67`, in metres, without a checksum. Binary (LW20 command
documentation, LW24 product guide): 0xAA, flags (payload length << 6), id, data, CRC-16-CCITT.
"""

import re
import struct
from typing import Final, Literal

from recorder.rangefinders import Answer, Lines

_DISTANCE: Final = re.compile(r"(?:\?LD |ld(?:,\d)?:)?(-?\d{1,3}\.\d\d)(?: ?m)?")
_LOST_M: Final = frozenset((130.0, 160.0, 230.0, 250.0))  # each model's word for "no signal"

START_BYTE: Final = 0xAA
DISTANCE_OUTPUT: Final = 27  # uint32 of bits; bit 0: first return, raw
DISTANCE_DATA: Final = 44  # int16, cm
MAX_PAYLOAD_BYTES: Final = 64  # what this recorder asks for is shorter; the format allows 1023
_HEADER: Final = struct.Struct("<BH")


class LightWareText:
    """Asked again and again with the old `d`, which every model understands."""

    baud = 115200
    parity: Literal["none", "even"] = "none"
    std_m = 0.1  # SF11/C, LW20: accuracy +-0.1 m
    confirm_m = 0.1
    start = b""
    ask = b"d"
    stop = b""

    def __init__(self) -> None:
        self._lines = Lines(_read)

    def feed(self, received: bytes) -> list[Answer]:
        """The answers that are complete with these further bytes."""
        return self._lines.feed(received)


def _read(line: str) -> Answer:
    found = _DISTANCE.fullmatch(line.strip())
    if found is None:
        return Answer(None, "fault: no answer", line)
    range_m = float(found[1])
    if range_m <= 0 or range_m in _LOST_M:
        return Answer(None, "no signal", line)
    return Answer(range_m, "ok", line)


class LightWareBinary:
    """Asked for command 44 (distance data) again and again."""

    baud = 115200
    parity: Literal["none", "even"] = "none"
    std_m = 0.1
    confirm_m = 0.0  # a CRC proves it
    stop = b""

    def __init__(self) -> None:
        first_return = struct.pack("<I", 1)
        self.start = packet(DISTANCE_OUTPUT, first_return, write=True)
        self.ask = packet(DISTANCE_DATA)
        self._pending = b""

    def feed(self, received: bytes) -> list[Answer]:
        """The answers that are complete with these further bytes."""
        self._pending += received
        answers: list[Answer] = []
        skipped = b""
        while True:
            start = self._pending.find(START_BYTE)
            cut = len(self._pending) if start < 0 else start
            skipped, self._pending = skipped + self._pending[:cut], self._pending[cut:]
            if len(self._pending) < _HEADER.size:
                break
            length = _HEADER.unpack_from(self._pending)[1] >> 6
            end = _HEADER.size + length + 2
            if not 1 <= length <= MAX_PAYLOAD_BYTES:
                skipped, self._pending = skipped + self._pending[:1], self._pending[1:]
                continue
            if len(self._pending) < end:
                break
            body, crc = self._pending[: end - 2], self._pending[end - 2 : end]
            if int.from_bytes(crc, "little") != crc16(body):
                answers.append(Answer(None, "fault: CRC", self._pending[:end].hex(" ")))
                self._pending = self._pending[1:]  # the true start may lie within
                continue
            self._pending = self._pending[end:]
            answers += _distance(body)
        if skipped:
            answers.append(Answer(None, "fault: no packet", skipped.hex(" ")))
        return answers


def _distance(body: bytes) -> list[Answer]:
    if body[3] != DISTANCE_DATA or len(body) < 6:
        return []  # the echo of a setting
    distance_cm = int.from_bytes(body[4:6], "little", signed=True)
    range_m = distance_cm / 100
    if range_m <= 0 or range_m in _LOST_M:
        return [Answer(None, "no signal", body.hex(" "))]
    return [Answer(range_m, "ok", body.hex(" "))]


def packet(command: int, payload: bytes = b"", *, write: bool = False) -> bytes:
    """A packet of the binary protocol."""
    flags = (1 + len(payload)) << 6 | write
    body = _HEADER.pack(START_BYTE, flags) + bytes((command,)) + payload
    return body + crc16(body).to_bytes(2, "little")


def crc16(body: bytes) -> int:
    """CRC-16-CCITT, polynomial 0x1021, beginning with 0."""
    crc = 0
    for byte in body:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc
