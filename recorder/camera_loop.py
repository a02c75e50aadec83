"""A camera's thread: takes what comes, counts what does not, and opens a silent camera anew."""

import time
from collections.abc import Callable
from threading import Event, Thread
from typing import Final

from recorder.cameras import Camera, Shot, open_camera
from recorder.clocks import FrameCounter
from recorder.equipment import CameraSettings
from recorder.errors import PomologError
from recorder.ledger import StreamLedger, median_interval_ns
from recorder.timeline import Timeline

POLL_S: Final = 0.1
RETRY_S: Final = 0.25


class CameraLoop:
    """Keeps one camera going until it is stopped.

    Args:
        side: "left" or "right", for messages.
        settings: what to open; also what to open again.
        camera: the camera, open.
        timeline: where its frames go.
        ledger: its counters.
        silence_s: how long it may say nothing.
        deliver: takes a shot and its session time, in this thread.
        tell: takes a line for the operator and the notes.
    """

    def __init__(
        self,
        side: str,
        settings: CameraSettings,
        camera: Camera,
        timeline: Timeline,
        ledger: StreamLedger,
        silence_s: float,
        deliver: Callable[[Shot, int], None],
        tell: Callable[[str], None],
    ) -> None:
        self._side = side
        self._settings = settings
        self._camera: Camera | None = camera
        self._timeline = timeline
        self._ledger = ledger
        self._silence_s = silence_s
        self._deliver = deliver
        self._tell = tell
        self._ids = FrameCounter()
        self._last_ns: int | None = None  # session time of the last complete frame
        self._begin_ns = 0
        self._gone = False
        self._stopping = Event()
        self._thread = Thread(target=self._run, name=f"camera {side}", daemon=True)
        self.failure: Exception | None = None

    @property
    def gone(self) -> bool:
        """Whether the camera is silent and being opened anew."""
        return self._gone

    def start(self, begin_ns: int) -> None:
        """Begin with the frames exposed from that session time on, so that both cameras do."""
        self._begin_ns = begin_ns
        self._thread.start()

    def ask_to_stop(self) -> None:
        """Take no further shots."""
        self._stopping.set()

    def stop(self) -> None:
        """Deliver what is held, and close the camera."""
        self._stopping.set()
        self._thread.join(timeout=10)

    def trigger(self) -> None:
        """Trigger the camera; one that is gone misses it."""
        camera = self._camera
        if camera is not None:
            try:
                camera.trigger()
            except PomologError:
                return  # its silence will tell

    def _run(self) -> None:
        try:
            self._watch()
        except Exception as error:  # our own bug: the recording must say so, not go on with one eye
            self.failure = error
        finally:
            for shot, time_ns in self._timeline.restart():
                self._hand_over(shot, time_ns)
            self._close()

    def _watch(self) -> None:
        heard_s = time.monotonic()
        while not self._stopping.is_set():
            try:
                shot = self._camera.next_shot(POLL_S) if self._camera else None
            except PomologError:
                shot, heard_s = None, float("-inf")  # gone, and it says so
            if shot is not None:
                heard_s = time.monotonic()
                self._take(shot)
            elif time.monotonic() - heard_s > self._silence_s:
                self._reopen()
                heard_s = time.monotonic()

    def _reopen(self) -> None:
        self._gone = True
        self._tell(f"{self._side} camera silent; opening it anew")
        for shot, time_ns in self._timeline.restart():
            self._hand_over(shot, time_ns)
        self._ids.restart()
        self._close()
        while not self._stopping.is_set():
            try:
                self._camera = open_camera(self._settings)
            except PomologError:
                self._stopping.wait(RETRY_S)
                continue
            self._ledger.reopened += 1
            return

    def _take(self, shot: Shot) -> None:
        self._ledger.missing += self._ids.missing_before(shot.frame_id)
        for placed, time_ns in self._timeline.place(shot):
            self._hand_over(placed, time_ns)

    def _hand_over(self, shot: Shot, time_ns: int) -> None:
        if time_ns < self._begin_ns:
            return  # waited in the driver since before the recording began
        self._ledger.incomplete += not shot.complete
        self._ledger.late += self._timeline.late(shot, time_ns)
        if self._last_ns is not None and shot.complete and self._gone:
            self._note_gap(time_ns - self._last_ns)
        if shot.complete:
            self._gone = False
            self._last_ns = time_ns
        self._deliver(shot, time_ns)

    def _note_gap(self, gap_ns: int) -> None:
        """The gap between the last frame before and the first one after, as it is in the file."""
        usual_ns = median_interval_ns(list(self._ledger.recent_ns))
        usual_ns = usual_ns or round(1e9 / self._settings.rate_hz)
        missing = max(0, round(gap_ns / usual_ns) - 1)
        self._ledger.silent_ns += gap_ns
        self._ledger.missing += missing
        self._tell(f"{self._side} camera back after {gap_ns / 1e9:.3f} s; {missing} frames missing")

    def _close(self) -> None:
        camera, self._camera = self._camera, None
        if camera is not None:
            camera.close()
