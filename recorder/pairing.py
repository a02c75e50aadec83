"""Stereo pairs from two streams of times."""

import numpy as np
import numpy.typing as npt

Times = npt.NDArray[np.int64]


def pair_by_time(left_ns: Times, right_ns: Times, max_skew_ns: int) -> npt.NDArray[np.intp]:
    """Pair the frames that are each other's nearest in time and not further apart than the limit.

    Args:
        left_ns: (L,) sorted times of the left frames.
        right_ns: (R,) sorted times of the right frames.
        max_skew_ns: the largest difference that still counts as one moment.

    Returns:
        (P, 2) places in `left_ns` and `right_ns`, in time order; each frame at most once.
    """
    if len(left_ns) == 0 or len(right_ns) == 0:
        return np.empty((0, 2), np.intp)
    to_right = _nearest(left_ns, right_ns)
    to_left = _nearest(right_ns, left_ns)
    left = np.arange(len(left_ns))
    mutual = to_left[to_right] == left
    close = np.abs(left_ns - right_ns[to_right]) <= max_skew_ns
    chosen = left[mutual & close]
    return np.column_stack([chosen, to_right[chosen]])


def _nearest(times_ns: Times, others_ns: Times) -> npt.NDArray[np.intp]:
    """The place in `others_ns` of the time nearest to each of `times_ns`; the earlier on a tie."""
    after = np.clip(np.searchsorted(others_ns, times_ns), 1, max(1, len(others_ns) - 1))
    if len(others_ns) == 1:
        return np.zeros(len(times_ns), np.intp)
    before = after - 1
    later_is_nearer = others_ns[after] - times_ns < times_ns - others_ns[before]
    return np.where(later_is_nearer, after, before)
