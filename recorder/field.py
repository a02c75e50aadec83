"""A recording with an operator: keys, signals, a look at the pictures, a report each second."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import Event
from typing import Final

from recorder.capture import LOOK_S, Recorder
from recorder.keys import Keys, TakeReading
from recorder.plan import Plan
from recorder.status import RecorderStatus

REPORT_S: Final = 1.0
POLL_S: Final = 0.1
SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # SIGHUP: the ssh line broke


def record(
    plan: Plan,
    *,
    duration_s: float | None = None,
    preview_port: int | None = None,
    show: Callable[[RecorderStatus, Recorder, str], None] = lambda *_: None,
    announce: Callable[[str], None] = lambda _: None,
) -> Recorder:
    """Record until a signal, the duration or a full disk ends it; the files are whole then.

    Args:
        plan: what to record.
        duration_s: how long; None is until a signal.
        preview_port: where the preview page is served, on loopback; 0 chooses; None is nowhere.
        show: called each second with the status, the recorder, and what is being typed.
        announce: called with a line once there is something to say.

    Returns:
        The recorder, stopped.

    Raises:
        PomologError: a device cannot be opened, or the disk was full or failed.
    """
    with ExitStack() as stack:
        stopped = stack.enter_context(_until_signalled())
        recorder = stack.enter_context(Recorder(plan))
        if preview_port is not None:
            from recorder.preview import Preview

            preview = stack.enter_context(Preview(recorder, preview_port))
            announce(f"preview at {preview.address}")
        keys = stack.enter_context(Keys(sys.stdin))
        begun_s = time.monotonic()
        looked_s = reported_s = begun_s
        while not stopped.is_set() and not recorder.ended:
            for event in keys.poll(POLL_S):
                if isinstance(event, TakeReading):
                    recorder.take_reading(event.apple_id)
                else:
                    recorder.typed(event)
            now_s = time.monotonic()
            if now_s - looked_s >= LOOK_S:
                looked_s = now_s
                recorder.look()
            if now_s - reported_s >= REPORT_S:
                reported_s = now_s
                show(recorder.report(), recorder, keys.line)
            if duration_s is not None and now_s - begun_s >= duration_s:
                break
    return recorder


@contextmanager
def _until_signalled() -> Iterator[Event]:
    """An event that SIGINT, SIGTERM and SIGHUP set; a second one of them ends us at once."""
    stopped = Event()

    def on_signal(number: int, _: object) -> None:
        if stopped.is_set():
            signal.default_int_handler(number, None)
        stopped.set()

    before = {number: signal.signal(number, on_signal) for number in SIGNALS}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
