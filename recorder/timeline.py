"""Where a camera's frames lie in the session's time."""

from recorder.cameras import BUFFERS, Shot
from recorder.clocks import ClockMap, SessionClock

LATE_NS = 100_000_000  # a frame that arrives so long after its exposure is late
HELD_FRAMES = BUFFERS + 16  # a clock that never settles may hold back no more


class Timeline:
    """One camera's frames, placed by their device times on the session's clock.

    Where the map between the clocks is not settled yet (a camera just opened anew), frames are held
    back, then given all at once: none is lost, and none gets a time from a map that still wobbles.

    Args:
        clock: the session's.
        clock_map: the camera's own, or one that PTP lets both cameras share.
    """

    def __init__(self, clock: SessionClock, clock_map: ClockMap) -> None:
        self._clock = clock
        self._map = clock_map
        self._held: list[Shot] = []
        self._last_ns = 0

    @property
    def drift_ppm(self) -> float:
        """What the camera's clock gains on the computer's."""
        return self._map.drift_ppm

    def note(self, shot: Shot) -> bool:
        """Learn from a shot that will not be kept; whether the map is settled now."""
        if shot.device_ns is None:
            return True
        self._map.add(shot.device_ns, shot.monotonic_ns)
        return self._map.settled

    def restart(self) -> list[tuple[Shot, int]]:
        """Begin again with a camera opened anew; gives what was still held."""
        freed = self._free()
        self._map.restart()
        return freed

    def place(self, shot: Shot) -> list[tuple[Shot, int]]:
        """Note a shot; gives the shots whose session times are known now."""
        if shot.device_ns is not None:
            self._map.add(shot.device_ns, shot.monotonic_ns)
        self._held.append(shot)
        waiting = shot.device_ns is not None and not self._map.settled
        return [] if waiting and len(self._held) < HELD_FRAMES else self._free()

    def _free(self) -> list[tuple[Shot, int]]:
        held, self._held = self._held, []
        return [(shot, self._time_ns(shot)) for shot in held]

    def _time_ns(self, shot: Shot) -> int:
        """A frame's session time; times of one camera always grow, whatever the map learns."""
        exposed_ns = shot.monotonic_ns
        if shot.device_ns is not None:
            exposed_ns = self._map.monotonic_ns(shot.device_ns)
        self._last_ns = max(self._clock.time_ns(exposed_ns), self._last_ns + 1)
        return self._last_ns

    def late(self, shot: Shot, time_ns: int) -> bool:
        """Whether a shot arrived long after its exposure."""
        return self._clock.time_ns(shot.monotonic_ns) - time_ns > LATE_NS
