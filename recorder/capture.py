"""The field loop: cameras and a rangefinder in, whole sessions out, every loss counted.

Each device has a thread, the disk has one; this puts them together, and says each second how it is.
"""

import time
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Final, Self

from recorder.camera_loop import CameraLoop
from recorder.cameras import Camera, Shot, open_camera
from recorder.clocks import ClockMap, SessionClock
from recorder.errors import PomologError
from recorder.exposure import Exposure, look_at
from recorder.ledger import RANGEFINDER_COUNTS, StreamLedger
from recorder.plan import Plan
from recorder.rangefinder_loop import RangefinderLoop
from recorder.rangefinders import Answer, Confirmation
from recorder.rangefinders.typed import STD_M, read_typed
from recorder.records import COMPRESSED, SIDES, Frame, Note, RangeReading, Side
from recorder.reporter import Reporter
from recorder.segment import Recording
from recorder.session_writer import SessionWriter
from recorder.status import FrameStamp, RecorderStatus
from recorder.storage import Storage
from recorder.timeline import Timeline
from recorder.warm_up import first_shot, settle
from recorder.write_queue import Entry

LOOK_S: Final = 0.5  # exposure and focus, twice a second


class Recorder:
    """A recording in progress. Use it as a context manager; leaving it finishes the file.

    Args:
        plan: what to record.

    Attributes:
        latest: the newest complete shot of each camera.
        exposures: what the last look at each camera found.
        last_reading: of the rangefinder, with a distance.
        messages: the last lines for the operator.

    Raises:
        PomologError: a device cannot be opened, or the disk not written to.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.latest: dict[Side, Shot] = {}
        self.exposures: dict[Side, Exposure] = {}
        self.last_reading: RangeReading | None = None
        self.messages: list[str] = []
        self._clock = SessionClock.start()
        self._conditions = dict(plan.metadata)
        self._ledgers: dict[str, StreamLedger] = {side: StreamLedger() for side in SIDES}
        self._ledgers["rangefinder"] = StreamLedger(RANGEFINDER_COUNTS)
        self._rangefinder: RangefinderLoop | None = None
        self._looked_at: dict[Side, Shot] = {}
        device = plan.equipment.rangefinder_device
        typed = device is not None and device.driver == "typed"
        self._typed_twice = Confirmation((typed and device and device.confirm_m) or 0.0)
        self._stopping = Event()
        cameras: dict[Side, Camera] = {}
        try:
            for side in SIDES:
                cameras[side] = open_camera(plan.equipment.cameras[side])
            if device is not None and not typed:
                self._rangefinder = RangefinderLoop(
                    device,
                    self._ledgers["rangefinder"],
                    plan.equipment.capture.silence_s,
                    self._take_answer,
                    self.tell,
                )
            self._timelines = self._make_timelines()
            raw = {first_shot(plan, cameras, side).encoding not in COMPRESSED for side in SIDES}
            if len(raw) > 1:
                raise PomologError(
                    "one camera gives raw pictures and the other JPEG; give both the same driver "
                    "and pixel_format"
                )
            self._storage = Storage(self._recording(raw_images=raw.pop()), plan.equipment.capture)
        except BaseException:
            for camera in cameras.values():
                camera.close()
            if self._rangefinder is not None:
                self._rangefinder.stop()
            raise
        settle(plan, cameras, self._timelines)
        self._reporter = Reporter(plan, self._ledgers, self._storage, self._timelines)
        self._loops = self._camera_loops(cameras)
        self._begin()

    def _recording(self, *, raw_images: bool) -> Recording:
        capture = self.plan.equipment.capture
        self._conditions |= {
            "max_skew_ns": str(capture.max_skew_ns),
            "clock_zero_ns": str(self._clock.wall_ns - self._clock.monotonic_ns),
        }
        return Recording(
            folder=self.plan.folder,
            name=self.plan.name,
            rig=self.plan.rig,
            metadata=self._conditions,  # shared: a note sets a condition for the files to come
            raw_images=raw_images,
            max_skew_ns=capture.max_skew_ns,
            split=self.plan.split,
            ledgers=self._ledgers,
        )

    def _make_timelines(self) -> dict[str, Timeline]:
        shared = ClockMap() if self.plan.equipment.capture.clock == "shared" else None
        return {side: Timeline(self._clock, shared or ClockMap()) for side in SIDES}

    def _camera_loops(self, cameras: Mapping[Side, Camera]) -> dict[Side, CameraLoop]:
        capture = self.plan.equipment.capture
        return {
            side: CameraLoop(
                side,
                self.plan.equipment.cameras[side],
                cameras[side],
                self._timelines[side],
                self._ledgers[side],
                capture.silence_s,
                partial(self._deliver, side),
                self.tell,
            )
            for side in SIDES
        }

    def _begin(self) -> None:
        begin_ns = self._clock.now_ns()
        for loop in self._loops.values():
            loop.start(begin_ns)
        if self._rangefinder is not None:
            self._rangefinder.start()
        self._triggering: Thread | None = None
        if any(c.trigger == "software" for c in self.plan.equipment.cameras.values()):
            self._triggering = Thread(target=self._trigger, name="trigger", daemon=True)
            self._triggering.start()

    def _trigger(self) -> None:
        """Both cameras, as close together as a computer can."""
        period_s = 1 / self.plan.equipment.cameras["left"].rate_hz
        due_s = time.monotonic()
        while not self._stopping.is_set():
            for loop in self._loops.values():
                loop.trigger()
            due_s = max(due_s + period_s, time.monotonic())
            self._stopping.wait(due_s - time.monotonic())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self.stop("stopped" if kind is None else "error")
        except PomologError:
            if kind is None:
                raise

    @property
    def files(self) -> tuple[Path, ...]:
        """The whole files so far."""
        return tuple(self._storage.files)

    @property
    def ended(self) -> bool:
        """Whether the recording ended by itself: a full disk, or a fault of ours."""
        return not self._storage.running or any(self._failures())

    def _failures(self) -> Iterator[Exception]:
        """Bugs of ours that ended a device's thread."""
        for loop in (*self._loops.values(), self._rangefinder):
            if loop is not None and loop.failure is not None:
                yield loop.failure

    def stop(self, why: str = "stopped") -> None:
        """Let go of the devices and finish the file.

        Raises:
            PomologError: the disk was full or failed.
        """
        self._stopping.set()
        if self._triggering is not None:
            self._triggering.join()
        for loop in self._loops.values():
            loop.ask_to_stop()  # both at once, so that the last pair is whole
        for loop in self._loops.values():
            loop.stop()
        if self._rangefinder is not None:
            self._rangefinder.stop()
        self._storage.stop(why)
        for failure in self._failures():
            raise failure

    def _deliver(self, side: Side, shot: Shot, time_ns: int) -> None:
        stamp = FrameStamp(
            time_ns, side, shot.frame_id, shot.device_ns, shot.host_ns, shot.monotonic_ns,
            shot.status,
        )  # fmt: skip

        def write(session: SessionWriter) -> None:
            if shot.complete:
                number = shot.frame_id or 0
                frame = Frame(side, time_ns, shot.encoding, shot.data, shot.size_px, number)
                session.write_frame(frame)
            session.write_stamp(stamp)

        if shot.complete:
            self.latest[side] = shot
        stream = side if shot.complete else "stamps"
        self._storage.put(Entry(time_ns, stream, len(shot.data), write))

    def _take_answer(
        self, answer: Answer, monotonic_ns: int, asked: bool, apple_id: int | None
    ) -> None:
        std_m = self._rangefinder.std_m if self._rangefinder else None
        self._write_reading(answer, self._clock.time_ns(monotonic_ns), std_m, apple_id)
        if asked:
            name = "the fruit at the crosshair" if apple_id is None else f"apple {apple_id}"
            self.tell(f"reading for {name}: {answer.range_m:.4f} m")

    def _write_reading(
        self, answer: Answer, time_ns: int, std_m: float | None, apple_id: int | None
    ) -> None:
        reading = RangeReading(
            time_ns,
            answer.range_m,
            std_m if answer.range_m is not None else None,
            answer.status,
            answer.raw,
            apple_id,
        )
        if reading.range_m is not None:
            self.last_reading = reading
        self._storage.put(Entry(time_ns, "rangefinder", 0, lambda s: s.write_reading(reading)))

    def take_reading(self, apple_id: int | None = None) -> None:
        """Take the next good reading for the fruit at the crosshair, or for the apple named."""
        if self._rangefinder is None:
            self.tell("no rangefinder to ask; type the distance, like: 4,532 m")
        else:
            self._rangefinder.want(apple_id)

    def typed(self, line: str) -> None:
        """A line that the operator, or a meter that types, has entered: a distance or a note."""
        text = line.strip()
        if not text:
            return
        found = read_typed(text)
        if found is None:
            self.tell(text)
            return
        now_ns = self._clock.now_ns()
        answer = self._typed_twice.check(found.answer)
        self._ledgers["rangefinder"].faults += answer.fault
        self._write_reading(answer, now_ns, STD_M, found.apple_id)
        if answer.range_m is None:
            self.tell(f"not taken ({answer.status.removeprefix('fault: ')}): {text}")
        elif "#" in text:
            self.tell(text)

    def tell(self, line: str) -> None:
        """Keep a line in the notes and show it to the operator."""
        note = Note(self._clock.now_ns(), line)
        if note.condition:
            key, value = note.condition
            self._conditions[key] = value
        self.messages = [*self.messages[-4:], line]
        self._storage.put(Entry(note.time_ns, "notes", 0, lambda s: s.write_note(note)))

    def look(self) -> None:
        """Judge the newest picture of each camera; call it about twice a second."""
        for side, shot in list(self.latest.items()):
            if self._looked_at.get(side) is not shot:
                self._looked_at[side] = shot
                self.exposures[side] = look_at(shot)

    def report(self) -> RecorderStatus:
        """Say how it is, and write that into the file; call it each second."""
        status = self.status()
        self._storage.put(Entry(status.time_ns, "status", 0, lambda s: s.write_status(status)))
        return status

    def status(self) -> RecorderStatus:
        """How it is right now."""
        gone = tuple(side for side, loop in self._loops.items() if loop.gone)
        return self._reporter.status(
            self._clock.now_ns(), self.exposures, gone, "ended" if self.ended else "recording"
        )
