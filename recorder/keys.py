"""The operator's keyboard: keys while a terminal is there, whole lines from a pipe.

On a terminal, the space bar takes a reading for the fruit at the crosshair, a number and the space
bar one for that apple; anything else is a line, ended by Enter: a distance or a note. From a pipe,
`r` and `r 7` take readings.
"""

import os
import re
import select
import termios
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Self, TextIO

_WANTED: Final = re.compile(r"r(?:\s+(\d{1,5}))?")
_ERASE: Final = ("\x7f", "\x08")


@dataclass(frozen=True, slots=True)
class TakeReading:
    """The operator wants a reading."""

    apple_id: int | None


class Keys:
    """Reads what is typed, without waiting. Use it as a context manager.

    Args:
        stream: standard input, whatever it is.

    Attributes:
        line: what is typed so far, to be shown.
    """

    def __init__(self, stream: TextIO) -> None:
        self.line = ""
        self._saved: list[Any] | None = None
        try:
            self._descriptor: int | None = stream.fileno()
        except (OSError, ValueError):  # a test runner's, or none at all
            self._descriptor = None

    def __enter__(self) -> Self:
        descriptor = self._descriptor
        if descriptor is not None and os.isatty(descriptor):
            if _in_background(descriptor):
                self._descriptor = None  # reading would stop the process
            else:
                self._saved = termios.tcgetattr(descriptor)
                tty.setcbreak(descriptor)
        return self

    def __exit__(self, *_: object) -> None:
        if self._saved is not None and self._descriptor is not None:
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._saved)

    def poll(self, timeout_s: float) -> Iterator[TakeReading | str]:
        """What was typed within that time: wishes for readings, and whole lines."""
        if self._descriptor is None:
            select.select([], [], [], timeout_s)
            return
        if not select.select([self._descriptor], [], [], timeout_s)[0]:
            return
        received = os.read(self._descriptor, 4096)
        if not received:
            self._descriptor = None  # the pipe has ended; the recording goes on
            return
        for key in received.decode("utf-8", "replace"):
            yield from self._key(key)

    def _key(self, key: str) -> Iterator[TakeReading | str]:
        on_terminal = self._saved is not None
        if key in "\r\n":
            line, self.line = self.line.strip(), ""
            wanted = _WANTED.fullmatch(line)
            if wanted:
                yield TakeReading(int(wanted[1]) if wanted[1] else None)
            elif line:
                yield line
        elif on_terminal and key == " " and (not self.line or self.line.isdigit()):
            apple, self.line = self.line, ""
            yield TakeReading(int(apple) if apple else None)
        elif key in _ERASE:
            self.line = self.line[:-1]
        elif key.isprintable():
            self.line += key


def _in_background(descriptor: int) -> bool:
    try:
        return os.tcgetpgrp(descriptor) != os.getpgrp()
    except OSError:  # a terminal, but not the one that controls us
        return False
