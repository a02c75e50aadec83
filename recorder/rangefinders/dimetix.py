"""Dimetix DLS-C and FLS-C: mm-class, the one to trust as truth.

Technical reference manual, chapter "Command set": `sNh` starts tracking, each answer is
`gNh+xxxxxxxx` in 0.1 mm, an error `gN@Ezzz`. The factory's line is 19200 baud, 7 data bits, even
parity; read as 8 bits its parity can be checked, and counted, here.
"""

import re
from typing import Final, Literal

from recorder.rangefinders import Answer, Lines

_DISTANCE: Final = re.compile(r"g\d[gh]\+(\d{8})")
_ERROR: Final = re.compile(r"g\d@(E\d{3})")
_ACKNOWLEDGED: Final = re.compile(r"g\d\?")
_TENTHS_OF_MM: Final = 10_000


class Dimetix:
    """A device with ID 0 in tracking mode.

    Args:
        parity: "even" checks and strips the eighth bit.
    """

    baud = 19200
    std_m = 0.001  # DLS-C 15: +-1 mm at 2 sigma; FLS-C 10 the same
    confirm_m = 0.005  # ASCII without a checksum, and parity misses half of the burst errors
    ask = b""

    def __init__(self, parity: Literal["none", "even"] = "even") -> None:
        self.parity: Literal["none", "even"] = parity
        coded = with_even_parity if parity == "even" else bytes
        self.start = coded(b"s0c\r\ns0h\r\n")
        self.stop = coded(b"s0c\r\n")
        self._lines = Lines(_read)

    def feed(self, received: bytes) -> list[Answer]:
        """The answers that are complete with these further bytes."""
        if self.parity == "none":
            return self._lines.feed(received)
        bad = frozenset(i for i, byte in enumerate(received) if byte.bit_count() % 2)
        return self._lines.feed(bytes(byte & 0x7F for byte in received), bad)


def with_even_parity(text: bytes) -> bytes:
    """Seven-bit characters with their parity in the eighth bit."""
    return bytes(byte | (byte.bit_count() % 2) << 7 for byte in text)


def _read(line: str) -> Answer | None:
    if found := _DISTANCE.fullmatch(line):
        tenths = int(found[1])
        return Answer(tenths / _TENTHS_OF_MM, "ok", line)
    if found := _ERROR.fullmatch(line):
        return Answer(None, found[1], line)
    return None if _ACKNOWLEDGED.fullmatch(line) else Answer(None, "fault: no answer", line)
