"""Benewake TFmini, TF02 and TF03: frames of 9 bytes at 100 Hz, good to some 5 cm.

Manual: 59 59, distance (cm, little endian), strength, two more bytes, and the low byte of the sum
of the eight before. Convenient, but too coarse to be truth.
"""

from typing import Final, Literal

from recorder.rangefinders import Answer

FRAME_BYTES: Final = 9
HEADER: Final = b"\x59\x59"
# each model's words for "no signal": TFmini 0 and 65532 to 65535, TF02 2200, TF02-Pro 4500,
# TF03 18000 (all cm)
_LOST_CM: Final = frozenset((0, 2200, 4500, 18000, 65532, 65533, 65534, 65535))


class Benewake:
    """A device that talks by itself.

    A sum of one byte lets one bad frame of 256 pass, so a frame stands only when the next one
    begins right behind it.
    """

    baud = 115200
    parity: Literal["none", "even"] = "none"
    std_m = 0.05
    confirm_m = 0.0
    start = b""
    ask = b""
    stop = b""

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, received: bytes) -> list[Answer]:
        """The answers that are complete with these further bytes, one frame behind."""
        self._pending += received
        answers: list[Answer] = []
        skipped = b""
        while len(self._pending) >= FRAME_BYTES + len(HEADER):
            frame, then = self._pending[:FRAME_BYTES], self._pending[FRAME_BYTES:]
            summed = sum(frame[:-1]) & 0xFF == frame[-1]
            if frame.startswith(HEADER) and summed and then.startswith(HEADER):
                if skipped:
                    answers.append(Answer(None, "fault: checksum", skipped.hex(" ")))
                    skipped = b""
                answers.append(_read(frame))
                self._pending = then
            else:  # one byte, not nine: the true start may lie within
                skipped, self._pending = skipped + self._pending[:1], self._pending[1:]
        if skipped:
            answers.append(Answer(None, "fault: checksum", skipped.hex(" ")))
        return answers


def _read(frame: bytes) -> Answer:
    distance_cm = int.from_bytes(frame[2:4], "little")
    if distance_cm in _LOST_CM:
        return Answer(None, "no signal", frame.hex(" "))
    return Answer(distance_cm / 100, "ok", frame.hex(" "))
