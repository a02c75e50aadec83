"""Clocks mapped by the lower envelope, frame ids that wrap, session time that never steps."""

import numpy as np
import pytest

from recorder.cameras import Shot
from recorder.clocks import ClockMap, FrameCounter, SessionClock
from recorder.timeline import HELD_FRAMES, LATE_NS, Timeline

MS = 1_000_000
SECOND = 1_000_000_000


def shot(device_ns: int | None, monotonic_ns: int) -> Shot:
    return Shot(1, device_ns, 0, monotonic_ns, "jpeg", (1, 1), b"x")


@pytest.mark.parametrize("drift_ppm", [-200, 0, 200])
def test_drift_is_found_and_late_arrivals_say_nothing(drift_ppm: int) -> None:
    rng = np.random.default_rng(7)
    clock = ClockMap()
    worst_ns = 0.0
    for frame in range(15 * 120):
        host_ns = 10**15 + frame * SECOND // 15
        device_ns = round((host_ns - 10**15) * (1 + drift_ppm * 1e-6)) + 5 * SECOND
        delay_ns = int(2 * MS + rng.exponential(8 * MS))  # a busy computer
        clock.add(device_ns, host_ns + delay_ns)
        if frame > 15:
            worst_ns = max(worst_ns, abs(clock.monotonic_ns(device_ns) - host_ns - 2 * MS))
    assert clock.drift_ppm == pytest.approx(drift_ppm, abs=20)
    assert worst_ns < 5 * MS  # the skew that a pair may have
    assert clock.restarts == 0


def test_a_device_clock_set_anew_is_noticed() -> None:
    clock = ClockMap()
    for start_ns in (10**15, 0):  # a camera that lost its power counts from zero
        for frame in range(20):
            clock.add(start_ns + frame * SECOND // 15, 10**18 + start_ns + frame * SECOND // 15)
    assert clock.restarts == 1
    assert clock.monotonic_ns(SECOND) == pytest.approx(10**18 + SECOND, abs=MS)


def test_the_session_clock_follows_the_monotonic_one() -> None:
    clock = SessionClock(wall_ns=1_000 * SECOND, monotonic_ns=5 * SECOND)
    assert clock.time_ns(7 * SECOND) == 1_002 * SECOND


@pytest.mark.parametrize(
    ("ids", "missing"),
    [
        ([1, 2, 3], 0),
        ([1, 2, 5], 2),
        ([65534, 65535, 1, 2], 0),  # GigE Vision skips 0
        ([65534, 2], 2),
        ([70_000, 70_001, 70_003], 1),
        ([5, 5], 0),
        ([900, 1], 0),  # counted anew
        ([0, 1, 2], 0),  # USB3 Vision
        ([None, None], 0),
    ],
)
def test_frame_ids_tell_what_is_missing(ids: list[int | None], missing: int) -> None:
    counter = FrameCounter()
    assert sum(counter.missing_before(i) for i in ids) == missing


def test_frames_wait_for_the_clock_but_not_for_ever() -> None:
    timeline = Timeline(SessionClock(0, 0), ClockMap())
    placed = [timeline.place(shot(i * 10 * MS, i * 10 * MS + 3 * MS)) for i in range(10)]
    assert [len(p) for p in placed] == [0] * 9 + [10]
    unsettled = Timeline(SessionClock(0, 0), ClockMap())
    jumps = [unsettled.place(shot(abs(i % 2) * 10**15, i * 10 * MS)) for i in range(HELD_FRAMES)]
    assert len(jumps[-1]) == HELD_FRAMES


def test_frames_that_waited_in_a_driver_do_not_set_the_clock() -> None:
    """A computer that stalls takes what its driver held all at once, when it is long exposed."""
    timeline = Timeline(SessionClock(0, 0), ClockMap())
    stall_ns, interval_ns = 600 * MS, SECOND // 30
    placed = [
        (frame.device_ns, time_ns)
        for i in range(40)
        for frame, time_ns in timeline.place(shot(i * interval_ns, max(stall_ns, i * interval_ns)))
    ]
    assert [device_ns for device_ns, _ in placed] == [i * interval_ns for i in range(40)]
    assert max(abs(time_ns - (device_ns or 0)) for device_ns, time_ns in placed) < MS


def test_times_of_one_camera_always_grow() -> None:
    timeline = Timeline(SessionClock(0, 0), ClockMap())
    rng = np.random.default_rng(1)
    times = [
        time_ns
        for i in range(300)
        for _, time_ns in timeline.place(shot(i * MS, i * MS + int(rng.exponential(30 * MS))))
    ]
    assert len(times) == 300
    assert (np.diff(times) > 0).all()


def test_a_camera_without_a_clock_is_placed_by_arrival_and_is_never_late() -> None:
    timeline = Timeline(SessionClock(100, 0), ClockMap())
    ((placed, time_ns),) = timeline.place(shot(None, 77))
    assert time_ns == 177
    assert not timeline.late(placed, time_ns)


def test_a_frame_long_after_its_exposure_is_late() -> None:
    timeline = Timeline(SessionClock(0, 0), ClockMap())
    for i in range(20):
        timeline.place(shot(i * SECOND // 15, i * SECOND // 15))
    ((late, time_ns),) = timeline.place(shot(2 * SECOND, 2 * SECOND + LATE_NS + 50 * MS))
    assert timeline.late(late, time_ns)
