"""Curves and intervals of what was counted: numbers in, points out. Knows no stage and no file."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.stats import norm

from processor.score import Interval, wilson95
from processor.statistics import drawn_again
from processor.sureness import average_precision

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

LEAST_PAIRS: Final = 5  # fewer, drawn again and again, say nothing of the next ones
DRAWS: Final = 1000
NOMINAL: Final = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
CONFIDENCE_BINS: Final = 10


@dataclass(frozen=True, slots=True)
class Share:
    """A share of things counted, where something was said of them.

    Attributes:
        at: what was said: a nominal coverage, or the mean confidence.
        hits: how many of them are so.
        n: how many there are.
    """

    at: float
    hits: int
    n: int

    @property
    def observed(self) -> float:
        """Hits / n."""
        return self.hits / self.n

    @property
    def interval(self) -> Interval:
        """Its 95 % Wilson interval."""
        found = wilson95(self.hits, self.n)
        assert found is not None
        return found


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionRecall:
    """Precision and recall of the circles that are at least so confident.

    Attributes:
        confidence: (K,) falling.
        precision: (K,) of the circles above it.
        recall: (K,) of the fruit that should be found.
        average: the average precision, as the score has it.
    """

    confidence: Floats
    precision: Floats
    recall: Floats
    average: float


def precision_recall(confidence: Floats, true: Bools, wanted: int) -> PrecisionRecall | None:
    """What every threshold of the confidence would give.

    Args:
        confidence: (N,) of each circle that is right or false.
        true: (N,) whether it is right.
        wanted: how many fruit should be found.

    Returns:
        None where there are no circles, or nothing to find.
    """
    if not len(confidence) or not wanted:
        return None
    order = np.argsort(-confidence, kind="stable")
    falling, hits = confidence[order], np.cumsum(true[order])
    last = np.append(falling[1:] != falling[:-1], True)  # equal ones stand or fall together
    counted = np.arange(1, len(falling) + 1)[last]
    precision, recall = hits[last] / counted, hits[last] / wanted
    average = average_precision(confidence, true, wanted) or 0.0
    return PrecisionRecall(falling[last], precision, recall, average)


def coverage(errors_m: Floats, std_m: Floats) -> tuple[Share, ...]:
    """How many errors lie within the interval that was said to hold a given share of them.

    Args:
        errors_m: (N,) errors.
        std_m: (N,) their stated standard deviations.

    Returns:
        A share for each of `NOMINAL`; empty without errors.
    """
    if not len(errors_m):
        return ()
    sizes = np.abs(errors_m)
    return tuple(
        Share(level, int((sizes <= norm.ppf(0.5 + level / 2) * std_m).sum()), len(sizes))
        for level in NOMINAL
    )


def reliability(confidence: Floats, true: Bools) -> tuple[Share, ...]:
    """Of circles that are about so confident, how many are right; bins of equal width.

    Args:
        confidence: (N,) in [0, 1].
        true: (N,) whether each is right.
    """
    places = np.minimum((confidence * CONFIDENCE_BINS).astype(int), CONFIDENCE_BINS - 1)
    shares = []
    for place in range(CONFIDENCE_BINS):
        mine = places == place
        if mine.any():
            shares.append(Share(float(confidence[mine].mean()), int(true[mine].sum()), mine.sum()))
    return tuple(shares)


def resampled95(
    sums: npt.ArrayLike, statistic: Callable[[Floats], Floats], seed: int = 0
) -> Interval | None:
    """A statistic's 95 % interval, by drawing whole pairs again: fruit of one pair go together.

    Args:
        sums: (P, K), for each pair what the statistic sums over pairs.
        statistic: (D, K) sums -> (D,) values, NaN where they cannot be divided.
        seed: of the draws.

    Returns:
        None of fewer than `LEAST_PAIRS` pairs that have anything.
    """
    known = np.asarray(sums, float)
    known = known[known.any(axis=1)] if known.size else known
    if len(known) < LEAST_PAIRS:
        return None
    return drawn_again(known, statistic, np.random.default_rng(seed), DRAWS)


def f1_of(sums: Floats) -> Floats:
    """F1 of (D, 3) sums of hits, false positives and false negatives."""
    return np.asarray(2 * sums[:, 0] / (2 * sums[:, 0] + sums[:, 1] + sums[:, 2]))


def rms_of(sums: Floats) -> Floats:
    """The root mean square of (D, 2) sums of squares and counts."""
    return np.asarray(np.sqrt(sums[:, 0] / sums[:, 1]))
