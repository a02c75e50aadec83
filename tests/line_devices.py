"""Rangefinders on a pty: they talk as the manuals say, with faults on the line where wanted.

Every answer of a device is a known distance, so that a false reading can be told from a lost one.
"""

import os
import random
import threading
import time
import tty
from collections.abc import Callable
from types import TracebackType
from typing import Self

from recorder.rangefinders.dimetix import with_even_parity
from recorder.rangefinders.lightware import DISTANCE_DATA, packet

Damage = Callable[[random.Random, bytes], bytes]


def _flip(rng: random.Random, sent: bytes) -> bytes:
    place = rng.randrange(len(sent))
    return sent[:place] + bytes((sent[place] ^ 1 << rng.randrange(8),)) + sent[place + 1 :]


def _drop(rng: random.Random, sent: bytes) -> bytes:
    place = rng.randrange(len(sent))
    return sent[:place] + sent[place + 1 :]


def _insert(rng: random.Random, sent: bytes) -> bytes:
    place = rng.randrange(len(sent))
    return sent[:place] + bytes((rng.randrange(256),)) + sent[place:]


def _replace(rng: random.Random, sent: bytes) -> bytes:
    place = rng.randrange(len(sent))
    return sent[:place] + bytes((rng.randrange(256),)) + sent[place + 1 :]


def _cut(rng: random.Random, sent: bytes) -> bytes:
    return sent[: rng.randrange(1, len(sent))]


DAMAGES: tuple[Damage, ...] = (_flip, _drop, _insert, _replace, _cut)


class LineDevice:
    """A device at the far end of a pty. Use it as a context manager.

    Args:
        answer: the bytes of a distance in metres.
        hear: what it is asked with; empty: it talks by itself.
        start: what makes it talk, where something must.
        distance_m: what the n-th answer measures.
        faults: the share of answers damaged on the line.
        rate_hz: how fast it talks by itself.
    """

    def __init__(
        self,
        answer: Callable[[float], bytes],
        *,
        hear: bytes = b"",
        start: bytes = b"",
        distance_m: Callable[[int], float] = lambda _: 1.234,
        faults: float = 0.0,
        rate_hz: float = 100.0,
        seed: int = 1,
    ) -> None:
        self._answer = answer
        self._hear = hear
        self._start = start
        self._distance_m = distance_m
        self._faults = faults
        self._rate_hz = rate_hz
        self._random = random.Random(seed)
        self._near, self._far = os.openpty()
        tty.setraw(self._near)
        tty.setraw(self._far)
        self.path = os.ttyname(self._far)
        self.sent: list[float] = []
        self.damaged = 0
        self.silent = threading.Event()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()
        os.close(self._near)
        os.close(self._far)

    def _run(self) -> None:
        os.set_blocking(self._near, False)
        heard, talking = b"", not self._start
        while not self._ended.is_set():
            try:
                heard += os.read(self._near, 1024)
            except BlockingIOError:
                time.sleep(0.002)
            if self._start and self._start in heard:
                talking, heard = True, b""
            if self._hear:
                while self._hear in heard:
                    heard = heard.split(self._hear, 1)[1]
                    self._say()
            elif talking:
                self._say()
                time.sleep(1 / self._rate_hz)

    def _say(self) -> None:
        if self.silent.is_set():
            return
        distance_m = self._distance_m(len(self.sent))
        message = self._answer(distance_m)
        if self._random.random() < self._faults:
            self.damaged += 1
            message = self._random.choice(DAMAGES)(self._random, message)
        self.sent.append(distance_m)
        try:
            os.write(self._near, message)
        except BlockingIOError:
            return  # nobody listens


def dimetix_answer(distance_m: float) -> bytes:
    return with_even_parity(b"g0h+%08d\r\n" % round(distance_m * 10_000))


def lightware_answer(distance_m: float) -> bytes:
    return b"%.2f\r\n" % distance_m


def lightware_packet(distance_m: float) -> bytes:
    return packet(DISTANCE_DATA, round(distance_m * 100).to_bytes(2, "little", signed=True))


def benewake_frame(distance_m: float, strength: int = 800) -> bytes:
    body = b"YY" + round(distance_m * 100).to_bytes(2, "little")
    body += strength.to_bytes(2, "little") + b"\x00\x08"
    return body + bytes((sum(body) & 0xFF,))
