"""How right a method is where it says that it is sure: precision and recall by confidence.

Pure arithmetic, as the score; knows no stage and no file.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

# confidences that a robot may ask for, least first
ASKED: Final = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99)
BINS: Final = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0)


@dataclass(frozen=True, slots=True)
class Judged:
    """One thing that a method found, how sure it was, and whether it was right."""

    confidence: float
    right: bool


@dataclass(frozen=True, slots=True)
class Operation:
    """What a robot gets that takes only what is at least so sure; a rate of nothing is None."""

    confidence: float
    n: int
    precision: float | None
    recall: float | None


@dataclass(frozen=True, slots=True)
class Reliability:
    """Finds whose confidence is in a bin: how many, how sure on average, how many right."""

    least: float
    below: float
    n: int
    said: float | None
    right: float | None


@dataclass(frozen=True, slots=True)
class Curve:
    """Precision and recall by confidence.

    Attributes:
        n: finds that were judged.
        wanted: how many there are to be found.
        average_precision: the mean, over what is wanted, of the best precision that still
            reaches it; what is never found counts 0.
        operations: at fixed confidences.
        reliability: in bins of confidence.
        calibration_error: mean difference of what was said and what was right, over the finds.
    """

    n: int
    wanted: int
    average_precision: float | None
    operations: tuple[Operation, ...]
    reliability: tuple[Reliability, ...]
    calibration_error: float | None


def curve(judged: Sequence[Judged], wanted: int) -> Curve:
    """Sort finds by confidence and divide.

    Finds of one confidence cannot be told apart, so the curve takes all of them or none.
    """
    said = np.array([j.confidence for j in judged], float)
    right = np.array([j.right for j in judged], float)
    bins = tuple(_reliability(said, right, least, below) for least, below in pairwise(BINS))
    gaps = [abs((b.said or 0.0) - (b.right or 0.0)) * b.n for b in bins]
    return Curve(
        n=len(said),
        wanted=wanted,
        average_precision=average_precision(said, right, wanted),
        operations=tuple(_operation(said, right, wanted, asked) for asked in ASKED),
        reliability=bins,
        calibration_error=sum(gaps) / len(said) if len(said) else None,
    )


def average_precision(said: np.ndarray, right: np.ndarray, wanted: int) -> float | None:
    """The area below precision over recall, each precision the best of its recall or more.

    As PASCAL VOC has it since 2010.

    Args:
        said: (N,) confidences.
        right: (N,) whether each is right.
        wanted: how many there are to be found.
    """
    if not wanted:
        return None
    if not len(said):
        return 0.0
    order = np.argsort(-said, kind="stable")
    hits = np.cumsum(right[order])
    taken = np.arange(1, len(order) + 1)
    last = np.append(np.diff(said[order]) != 0, True)  # of each confidence
    precision, recall = (hits / taken)[last], (hits / wanted)[last]
    best = np.maximum.accumulate(precision[::-1])[::-1]
    return float((best * np.diff(recall, prepend=0.0)).sum())


def _operation(said: np.ndarray, right: np.ndarray, wanted: int, asked: float) -> Operation:
    sure = said >= asked
    n, hits = int(sure.sum()), float(right[sure].sum())
    return Operation(asked, n, hits / n if n else None, hits / wanted if wanted else None)


def _reliability(said: np.ndarray, right: np.ndarray, least: float, below: float) -> Reliability:
    """The last bin has its upper end too."""
    some = (said >= least) & ((said < below) | (below == BINS[-1]))
    n = int(some.sum())
    if n == 0:
        return Reliability(least, below, 0, None, None)
    return Reliability(least, below, n, float(said[some].mean()), float(right[some].mean()))
