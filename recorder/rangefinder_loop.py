"""A rangefinder's thread: asks, listens, and opens a silent device anew."""

import time
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Lock, Thread
from typing import Final

from recorder.equipment import RangefinderSettings
from recorder.errors import PomologError
from recorder.ledger import StreamLedger
from recorder.rangefinders import Answer, Confirmation, open_protocol
from recorder.rangefinders.port import SerialPort

RETRY_S: Final = 0.25
PATIENCE_S: Final = 2.0  # how long a wanted reading may take


class RangefinderLoop:
    """Keeps one serial rangefinder going until it is stopped.

    Args:
        settings: the port and the protocol.
        ledger: its counters.
        silence_s: how long it may say nothing.
        deliver: takes an answer, its arrival on the monotonic clock, whether the operator asked for
            it, and the apple that the operator named.
        tell: takes a line for the operator and the notes.

    Raises:
        PomologError: no such port.
    """

    def __init__(
        self,
        settings: RangefinderSettings,
        ledger: StreamLedger,
        silence_s: float,
        deliver: Callable[[Answer, int, bool, int | None], None],
        tell: Callable[[str], None],
    ) -> None:
        self._settings = settings
        self._ledger = ledger
        self._silence_s = silence_s
        self._deliver = deliver
        self._tell = tell
        self._protocol = open_protocol(settings)
        self._port: SerialPort | None = SerialPort(settings, self._protocol)
        self._confirmation = self._fresh_confirmation()
        self._wanted: tuple[float, int | None] | None = None  # since, apple
        self._lock = Lock()
        self._stopping = Event()
        self._thread = Thread(target=self._run, name="rangefinder", daemon=True)
        self.failure: Exception | None = None

    @property
    def std_m(self) -> float:
        """The standard deviation of one reading, by the manual."""
        return self._protocol.std_m

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, and close the port; also of one that never began."""
        self._stopping.set()
        if self._thread.ident is None:
            self._close()
        else:
            self._thread.join(timeout=5)

    def want(self, apple_id: int | None) -> None:
        """The operator wants the next good reading, for that apple."""
        with self._lock:
            self._wanted = (time.monotonic(), apple_id)

    def _fresh_confirmation(self) -> Confirmation:
        within_m = self._settings.confirm_m
        return Confirmation(self._protocol.confirm_m if within_m is None else within_m)

    def _run(self) -> None:
        try:
            self._talk()
        except Exception as error:  # our own bug: the recording must say so
            self.failure = error
        finally:
            self._close()

    def _talk(self) -> None:
        heard_s, asked_s, started = time.monotonic(), float("-inf"), False
        while not self._stopping.is_set():
            received = b""
            try:
                if self._port is None:
                    raise PomologError("closed")
                if not started:
                    self._port.write(self._protocol.start)
                    started = True
                if self._protocol.ask and time.monotonic() - asked_s >= 1 / self._settings.rate_hz:
                    asked_s = time.monotonic()
                    self._port.write(self._protocol.ask)
                received = self._port.read()
            except PomologError:
                heard_s = float("-inf")
            if received:
                heard_s = time.monotonic()
                for answer in self._protocol.feed(received):
                    self._take(self._confirmation.check(answer))
            elif time.monotonic() - heard_s > self._silence_s:
                self._reopen()
                heard_s, started = time.monotonic(), False
            self._look_at_the_clock()

    def _take(self, answer: Answer) -> None:
        self._ledger.faults += answer.fault
        asked, apple_id = False, None
        with self._lock:
            if self._wanted is not None and answer.range_m is not None:
                asked, apple_id, self._wanted = True, self._wanted[1], None
        self._deliver(answer, time.monotonic_ns(), asked, apple_id)

    def _look_at_the_clock(self) -> None:
        with self._lock:
            if self._wanted is None or time.monotonic() - self._wanted[0] < PATIENCE_S:
                return
            self._wanted = None
        self._tell("no reading: the rangefinder gave none that could be trusted; hold still?")

    def _reopen(self) -> None:
        self._tell(f"rangefinder at {self._settings.port} silent; opening it anew")
        self._close()
        while not self._stopping.is_set():
            protocol = open_protocol(self._settings)
            try:
                self._port = SerialPort(self._settings, protocol)
            except PomologError:
                self._stopping.wait(RETRY_S)
                continue
            self._protocol, self._confirmation = protocol, self._fresh_confirmation()
            self._ledger.reopened += 1
            return

    def _close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with suppress(PomologError):
                port.write(self._protocol.stop)
            port.close()
