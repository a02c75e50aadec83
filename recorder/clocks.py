"""Clocks: a camera's own time mapped to the computer's, and one session time that never steps.

A frame arrives some milliseconds after its exposure, sooner or later as the network and the
scheduler please, but never too early. So the line under all (device time, host minus device time)
points is the clock: the earliest arrivals tell offset and drift, the late ones say nothing
(Moon, Skelly, Towsley: Estimation and removal of clock skew from network delay measurements, 1999).
"""

import time
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from typing import Final, Self

SETTLED_FRAMES: Final = 10  # by then one of them arrived promptly
FALL_NS: Final = 5_000_000  # a line that still falls by so much says that frames had been waiting
MAX_DRIFT: Final = 500e-6  # no crystal is worse; a steeper line is noise of a short beginning
BUCKET_NS: Final = 1_000_000_000  # the earliest arrival of each second is enough
MEMORY_BUCKETS: Final = 120  # two minutes: drift follows the camera's temperature
STEP_NS: Final = 1_000_000_000  # a device clock that leaves its line by more was set anew


@dataclass(frozen=True, slots=True)
class SessionClock:
    """The session's time: the wall clock's date at the start, the monotonic clock ever after.

    A step of the wall clock during a recording (NTP, daylight saving, an operator) moves nothing.
    """

    wall_ns: int
    monotonic_ns: int

    @classmethod
    def start(cls) -> Self:
        """Read both clocks at one moment."""
        return cls(time.time_ns(), time.monotonic_ns())

    def time_ns(self, monotonic_ns: int) -> int:
        """The session time of a moment on the monotonic clock."""
        return self.wall_ns + monotonic_ns - self.monotonic_ns

    def now_ns(self) -> int:
        """The session time of now."""
        return self.time_ns(time.monotonic_ns())


class ClockMap:
    """One camera's clock against the computer's monotonic one.

    Attributes:
        restarts: how often the device's clock was found set anew.
    """

    def __init__(self) -> None:
        self.restarts = 0
        self._forget()

    def _forget(self) -> None:
        # (device time, host minus device) of the earliest arrival in each second
        self._buckets: deque[tuple[int, int]] = deque(maxlen=MEMORY_BUCKETS)
        self._last_ns: int | None = None
        self._frames = 0  # since the line fell
        self._offset_ns = 0.0  # at `_origin_ns`
        self._slope = 0.0
        self._origin_ns = 0

    def restart(self) -> None:
        """Begin again: the camera was opened anew, and its clock may have been, too."""
        self._forget()

    @property
    def settled(self) -> bool:
        """Whether enough frames have come to trust the line.

        Frames that had waited in a driver come all at once, each less late than the one before.
        """
        return self._frames >= SETTLED_FRAMES

    @property
    def drift_ppm(self) -> float:
        """How much the device's clock gains on the computer's; 0 until it is known."""
        return -self._slope * 1e6

    def add(self, device_ns: int, monotonic_ns: int) -> None:
        """Note a frame: its device time, and when it had arrived."""
        offset_ns = monotonic_ns - device_ns
        if self._last_ns is not None:
            fallen_ns = self._predict(device_ns) - offset_ns
            if device_ns < self._last_ns - STEP_NS or fallen_ns > STEP_NS:
                self._forget()
                self.restarts += 1
            elif fallen_ns > FALL_NS:
                self._frames = 0
        self._last_ns = max(device_ns, self._last_ns or device_ns)
        self._frames += 1
        if self._buckets and device_ns // BUCKET_NS <= self._buckets[-1][0] // BUCKET_NS:
            if offset_ns >= self._buckets[-1][1]:
                return
            self._buckets[-1] = (device_ns, offset_ns)
        else:
            self._buckets.append((device_ns, offset_ns))
        self._fit()

    def monotonic_ns(self, device_ns: int) -> int:
        """The moment on the computer's monotonic clock, less the shortest transfer seen."""
        return device_ns + round(self._predict(device_ns))

    def _predict(self, device_ns: int) -> float:
        return self._offset_ns + self._slope * (device_ns - self._origin_ns)

    def _fit(self) -> None:
        """The line under all points that is nearest to them: the hull's edge under their middle."""
        self._origin_ns = self._buckets[0][0]
        points = [(time_ns - self._origin_ns, offset) for time_ns, offset in self._buckets]
        hull: list[tuple[int, int]] = []
        for point in points:
            while len(hull) > 1 and _above(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        self._slope = 0.0
        if len(hull) > 1:
            middle = sum(time_ns for time_ns, _ in points) / len(points)
            place = min(bisect_right(hull, middle, key=lambda p: p[0]), len(hull) - 1)
            (t0, o0), (t1, o1) = hull[place - 1], hull[place]
            self._slope = max(-MAX_DRIFT, min(MAX_DRIFT, (o1 - o0) / (t1 - t0)))
        self._offset_ns = min(offset - self._slope * time_ns for time_ns, offset in hull)


def _above(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])


class FrameCounter:
    """A camera's frame ids: how many frames each new one says were lost before it.

    GigE Vision 1 counts 16 bits and skips 0 (after 65535 comes 1); GigE Vision 2 and USB3 Vision
    count 64 bits.
    """

    def __init__(self) -> None:
        self._last: int | None = None

    def restart(self) -> None:
        """Begin again: the camera was opened anew."""
        self._last = None

    def missing_before(self, frame_id: int | None) -> int:
        """Frames lost between the last id and this one; 0 where a camera counts nothing."""
        last, self._last = self._last, frame_id
        if last is None or frame_id is None:
            return 0
        if frame_id > last:
            return frame_id - last - 1
        if last <= 0xFFFF and last - frame_id > 0x7FFF:
            return (frame_id - last) % 0xFFFF - 1
        return 0  # the same again, or counted anew
