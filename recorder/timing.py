"""When the frames came: intervals of each view, gaps between the views, and what they mean."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from recorder.pairing import pair_by_time
from recorder.records import SIDES, Side
from recorder.rig import Floats
from recorder.session import Session

GAP_FACTOR: Final = 1.5  # a frame later than this many intervals means that one was lost
SPEED_M_S: Final = 0.3  # a walking robot's, by which a skew is told as an error of distance
AT_M: Final = 1.0  # the distance of an apple for the same
MS: Final = 1e6

Kind = Literal["together", "offset", "drift", "free", "lone", "few"]

_MOMENT_MS: Final = 1.0  # a trigger's two exposures begin closer than this
_FREE_SHARE: Final = 0.2  # of an interval: uniform gaps of free cameras have a spread of 0.37
_LEAST_GAPS: Final = 5  # fewer say nothing about how cameras run


@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """The times of a session's frames.

    Attributes:
        times_ns: (N,) of each view, sorted; a session of one view has the left alone.
        near_ns: (G, 2) left and right times of frames that are nearest to each other, at whatever
            distance.
        paired: (G,) which of them are close enough to be a pair.
        limit_ms: the largest skew of a pair.
        baseline_m: of the rig, to tell what a skew costs.
    """

    times_ns: dict[Side, npt.NDArray[np.int64]]
    near_ns: npt.NDArray[np.int64]
    paired: npt.NDArray[np.bool_]
    limit_ms: float
    baseline_m: float

    @property
    def gaps_ms(self) -> Floats:
        """(G,) right minus left."""
        return np.asarray(np.diff(self.near_ns, axis=1)[:, 0] / MS, float)

    def intervals_ms(self, side: Side) -> Floats:
        """(N - 1,) from each frame of a view to the next."""
        return np.asarray(np.diff(self.times_ns[side]) / MS, float)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the gaps between the views say of how they were taken."""

    kind: Kind
    sound: bool
    text: str


def timing_of(session: Session) -> Timing:
    """The times of a session, from its index alone."""
    sides = SIDES[:1] if session.one_view else SIDES
    times = {side: session.times_ns(side) for side in sides}
    near = np.empty((0, 2), np.int64)
    if not session.one_view:
        places = pair_by_time(times["left"], times["right"], np.iinfo(np.int64).max)
        near = np.column_stack([times["left"][places[:, 0]], times["right"][places[:, 1]]])
    paired = np.abs(np.diff(near, axis=1)[:, 0]) <= session.max_skew_ns
    return Timing(times, near, paired, session.max_skew_ns / MS, session.rig.baseline_m)


def judge(timing: Timing) -> Verdict | None:
    """Whether left and right were taken together, and what to do if not; None for one view."""
    if "right" not in timing.times_ns:
        return None
    gaps = timing.gaps_ms
    if len(gaps) == 0:
        return Verdict("lone", sound=False, text="no right frame for any left one")
    largest = float(np.abs(gaps).max())
    if largest <= _MOMENT_MS:
        return Verdict(
            "together", sound=True, text=f"both views are of one moment, {largest:.2f} ms at most"
        )
    return _judge_skewed(timing, largest)


def _judge_skewed(timing: Timing, largest_ms: float) -> Verdict:
    """What a skew that can be seen is: free cameras, drifting clocks, an offset, or jitter."""
    gaps = timing.gaps_ms
    middle = float(np.median(gaps))
    spread = float(1.4826 * np.median(np.abs(gaps - middle)))
    cost_mm = AT_M * SPEED_M_S * largest_ms / timing.baseline_m  # z v t / B, of an apple at z
    cost = f"at {SPEED_M_S:g} m/s up to {cost_mm:.0f} mm of error at {AT_M:g} m"
    sound = bool(timing.paired.all())
    many = len(gaps) >= _LEAST_GAPS
    if many and spread > _FREE_SHARE * float(np.median(timing.intervals_ms("left"))):
        text = f"the cameras run freely: the gap wanders by {spread:.1f} ms, {cost}"
        return Verdict("free", sound=False, text=f"{text}; trigger them together")
    drift, rest = _drift(timing) if many else (0.0, 0.0)
    if abs(drift) > max(3 * rest, _MOMENT_MS):
        text = f"the clocks drift: the gap changes by {drift:+.1f} ms over the session, {cost}"
        remedy = "record with one clock, or import pieces, each with its --offset"
        return Verdict("drift", sound=False, text=f"{text}; {remedy}")
    if abs(middle) > max(3 * spread, _MOMENT_MS):
        when = "later" if middle > 0 else "earlier"
        text = f"the right view is {abs(middle):.1f} ms {when}, always (spread {spread:.2f} ms)"
        remedy = "if that is a clock's offset: pomolog import bag ... --offset "
        shift = f"right={-middle:.1f}ms"
        interval = float(np.median(timing.intervals_ms("left"))) if many else 0.0
        if abs(middle) > interval / 4 > 0:  # the partner may be the neighbour on the other side
            shift += f" (or {np.copysign(interval, middle) - middle:+.1f}ms, the next but one)"
        return Verdict("offset", sound, f"{text}, {cost}; {remedy}{shift}")
    text = f"both views are together within {largest_ms:.1f} ms, {cost}"
    return Verdict("together" if many else "few", sound, text)


def _drift(timing: Timing) -> tuple[float, float]:
    """How much the gap changes over the session, and the spread about that line; milliseconds."""
    at = (timing.near_ns[:, 0] - timing.near_ns[0, 0]).astype(float)
    if at[-1] == 0:
        return 0.0, 0.0
    at /= at[-1]
    slope, start = np.polyfit(at, timing.gaps_ms, 1)
    rest = timing.gaps_ms - start - slope * at
    return float(slope), float(1.4826 * np.median(np.abs(rest - np.median(rest))))
