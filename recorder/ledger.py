"""The loss ledger: what came, what was kept, and where the rest went, stream by stream."""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np

from recorder.pairing import pair_by_time
from recorder.records import SIDES, Side

# what is counted of a camera, and of a rangefinder
CAMERA_COUNTS: Final = (
    "frames", "bytes", "dropped", "late", "incomplete", "missing", "reopened", "silent_ns",
)  # fmt: skip
RANGEFINDER_COUNTS: Final = ("frames", "dropped", "faults", "reopened")
SETTLED_NS: Final = 1_000_000_000  # a frame's partner comes within this, or not at all
RATE_FRAMES: Final = 32


@dataclass(slots=True)
class StreamLedger:
    """One stream's counters, each written by one thread only; StreamStatus says what they mean."""

    counted: tuple[str, ...] = CAMERA_COUNTS
    frames: int = 0
    bytes: int = 0
    dropped: int = 0
    late: int = 0
    incomplete: int = 0
    missing: int = 0
    reopened: int = 0
    faults: int = 0
    silent_ns: int = 0
    recent_ns: deque[int] = field(default_factory=lambda: deque(maxlen=RATE_FRAMES))

    def counts(self) -> dict[str, int]:
        """The counters by name."""
        return {name: getattr(self, name) for name in self.counted}

    def rate_hz(self, now_ns: int) -> float:
        """Frames a second over the last two seconds or so; 0 once they stop."""
        times_ns = list(self.recent_ns)
        if len(times_ns) < 2 or now_ns - times_ns[-1] > 2_000_000_000:
            return 0.0
        return (len(times_ns) - 1) * 1e9 / max(1, times_ns[-1] - times_ns[0])


def median_interval_ns(times_ns: Iterable[int]) -> int | None:
    """The usual time between frames, or None of fewer than two."""
    gaps = sorted(b - a for a, b in pairwise(times_ns))
    return gaps[len(gaps) // 2] if gaps else None


class PairCounter:
    """Stereo pairs as they are written, by the rule that reading the session will use."""

    def __init__(self, max_skew_ns: int) -> None:
        self.max_skew_ns = max_skew_ns
        self.pairs = 0
        self.unpaired = dict.fromkeys(SIDES, 0)
        self.skew_ns: int | None = None
        self._open: dict[Side, list[int]] = {side: [] for side in SIDES}

    def add(self, side: Side, time_ns: int) -> None:
        """Note a frame."""
        self._open[side].append(time_ns)

    def settle(self, now_ns: int | None = None) -> None:
        """Decide about every frame older than a second, or about all of them at the end."""
        end = np.iinfo(np.int64).max if now_ns is None else now_ns - SETTLED_NS
        times = {side: np.sort(np.asarray(self._open[side], np.int64)) for side in SIDES}
        decided = {side: times[side] < end for side in SIDES}
        partnered = {side: np.zeros(len(times[side]), bool) for side in SIDES}
        for i, j in pair_by_time(times["left"], times["right"], self.max_skew_ns):
            both = decided["left"][i] = decided["right"][j] = bool(decided["left"][i])
            if both:
                partnered["left"][i] = partnered["right"][j] = True
                self.skew_ns = int(times["right"][j] - times["left"][i])
        self.pairs += int(partnered["left"].sum())
        for side in SIDES:
            self.unpaired[side] += int((decided[side] & ~partnered[side]).sum())
            self._open[side] = times[side][~decided[side]].tolist()


def final_ledger(
    counts: Mapping[str, Mapping[str, int]],
    before: Mapping[str, Mapping[str, int]],
    pairs: PairCounter,
    extra: Iterable[tuple[str, str]] = (),
) -> dict[str, str]:
    """The `ledger` metadata of one file: what happened while it was written.

    Args:
        counts: counters by stream at the file's end.
        before: the same at its beginning.
        pairs: the file's own frames, settled.
        extra: further entries, like how the recording ended.
    """
    entries = {
        f"{stream}.{name}": str(value - before.get(stream, {}).get(name, 0))
        for stream, now in counts.items()
        for name, value in now.items()
    }
    entries |= {f"{side}.unpaired": str(count) for side, count in pairs.unpaired.items()}
    return {**entries, "pairs": str(pairs.pairs), **dict(extra)}
