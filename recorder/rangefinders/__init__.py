"""Rangefinders: bytes in, answers out. What fails a checksum is counted and kept, never guessed."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Final, Literal, Protocol, cast

from recorder.equipment import RangefinderDriver, RangefinderSettings
from recorder.errors import PomologError

MAX_LINE_BYTES: Final = 64  # no answer is longer: beyond it the line end was lost


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer of an instrument.

    Attributes:
        range_m: the distance; None where it gave none.
        status: "ok", the instrument's own word for what went wrong, or "fault: ..." where the bytes
            themselves are bad.
        raw: what it sent; bytes beyond ASCII as hexadecimal escapes.
    """

    range_m: float | None
    status: str
    raw: str

    @property
    def fault(self) -> bool:
        """Whether the bytes were bad (as against an honest "no signal")."""
        return self.status.startswith("fault")


class LineProtocol(Protocol):
    """How one family of instruments talks.

    Attributes:
        baud: factory setting.
        parity: factory setting.
        std_m: of one reading, by the manual.
        confirm_m: how closely two answers must agree where nothing else proves them; 0 where a
            checksum does.
        start: sent once, to begin.
        ask: sent at the polling rate; empty where the instrument talks by itself.
        stop: sent at the end.
    """

    baud: int
    parity: Literal["none", "even"]
    std_m: float
    confirm_m: float
    start: bytes
    ask: bytes
    stop: bytes

    def feed(self, received: bytes) -> list[Answer]:
        """The answers that are complete with these further bytes."""
        ...


# driver -> (module, its class); `typed` has no line of bytes, see recorder.rangefinders.typed
PROTOCOLS: Final[dict[RangefinderDriver, tuple[str, str]]] = {
    "dimetix": ("recorder.rangefinders.dimetix", "Dimetix"),
    "lightware": ("recorder.rangefinders.lightware", "LightWareText"),
    "lightware-binary": ("recorder.rangefinders.lightware", "LightWareBinary"),
    "benewake": ("recorder.rangefinders.benewake", "Benewake"),
}


def open_protocol(settings: RangefinderSettings) -> LineProtocol:
    """The protocol of a driver, fresh.

    Raises:
        PomologError: a parity for a device that has none.
    """
    module, name = PROTOCOLS[settings.driver]
    arguments = {"parity": settings.parity} if settings.parity else {}
    try:
        return cast("LineProtocol", getattr(import_module(module), name)(**arguments))
    except TypeError:
        raise PomologError(f"a {settings.driver} rangefinder has no parity; leave it out") from None


def printable(raw: bytes) -> str:
    """Bytes as text that any file can keep."""
    return raw.decode("ascii", "backslashreplace").rstrip("\r\n")


class Lines:
    """Cuts a stream of bytes into lines and reads each; bad parity and endless lines are faults.

    Args:
        read: makes an answer of a line; None of a line that answers nothing.
    """

    def __init__(self, read: Callable[[str], Answer | None]) -> None:
        self._read = read
        self._pending = b""

    def feed(self, received: bytes, bad: frozenset[int] = frozenset()) -> list[Answer]:
        """The answers of the lines that end in these bytes.

        Args:
            received: further bytes.
            bad: places in `received` of bytes that are known to be wrong.
        """
        marked = bytes(0xFF if i in bad else byte for i, byte in enumerate(received))
        *lines, self._pending = (self._pending + marked).split(b"\n")
        if len(self._pending) > MAX_LINE_BYTES:
            lines.append(self._pending)
            self._pending = b""
        answers = (self._line(line.strip(b"\r")) for line in lines)
        return [answer for answer in answers if answer is not None]

    def _line(self, line: bytes) -> Answer | None:
        if not line:
            return None
        if len(line) > MAX_LINE_BYTES or not line.isascii():
            return Answer(None, "fault: garbled", printable(line))
        return self._read(line.decode("ascii"))


class Confirmation:
    """For protocols without a checksum: a distance stands when another one agrees with it.

    A flipped digit looks like a distance; two answers flipped the same way do not happen.

    Args:
        within_m: how closely; 0 lets everything pass.
    """

    def __init__(self, within_m: float) -> None:
        self._within_m = within_m
        self._before: deque[float] = deque(maxlen=2)

    def check(self, answer: Answer) -> Answer:
        """The answer, or the same without its distance where nothing confirms it."""
        if answer.range_m is None or not self._within_m:
            return answer
        range_m = answer.range_m
        confirmed = any(abs(range_m - other) <= self._within_m for other in self._before)
        self._before.append(range_m)
        return answer if confirmed else replace(answer, range_m=None, status="unconfirmed")
