"""Counts in, rates and intervals out. Sums counts and divides last; knows no stage and no file."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from scipy.stats import binomtest

from processor.sureness import Curve, Judged, curve

Interval = tuple[float, float]

# (name, least, below): fruit by how much of it the worse of the two views sees, and by distance
VISIBILITY: Final = (("10-50%", 0.1, 0.5), ("50-90%", 0.5, 0.9), ("90-100%", 0.9, np.inf))
FRUIT_VISIBILITY: Final = (("10-50%", 0.1, 0.5), ("50-100%", 0.5, np.inf))
RANGES_M: Final = (
    ("below 0.4 m", 0.0, 0.4), ("0.4-0.7 m", 0.4, 0.7), ("0.7-1.0 m", 0.7, 1.0),
    ("1.0-1.5 m", 1.0, 1.5), ("above 1.5 m", 1.5, np.inf),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Detection:
    """Rates of something found or not; None where a count that it needs is unknown or zero.

    Attributes:
        tp: hits.
        fp: false positives; None where unlabelled fruit exist.
        fn: false negatives.
        hit: tp / (tp + fp + fn), the paper's "hits" (Table 1), which is the IoU.
        false_positive: fp over the same denominator.
        false_negative: fn over the same denominator.
        precision: tp / (tp + fp).
        recall: tp / (tp + fn).
        f1: 2 tp / (2 tp + fp + fn).
        iou: the same as hit, by its usual name.
    """

    tp: int
    fp: int | None
    fn: int
    hit: float | None
    false_positive: float | None
    false_negative: float | None
    precision: float | None
    recall: float | None
    f1: float | None
    iou: float | None


def detection(counts: Iterable[tuple[int, int | None, int]]) -> Detection | None:
    """Sum (tp, fp, fn) over frames and divide; None where nothing was counted."""
    listed = list(counts)
    if not listed:
        return None
    tp, fn = sum(c[0] for c in listed), sum(c[2] for c in listed)
    fp = _known_sum([c[1] for c in listed])
    everything = None if fp is None else tp + fp + fn
    return Detection(
        tp=tp,
        fp=fp,
        fn=fn,
        hit=_share(tp, everything),
        false_positive=_share(fp, everything),
        false_negative=_share(fn, everything),
        precision=_share(tp, None if fp is None else tp + fp),
        recall=_share(tp, tp + fn),
        f1=_share(2 * tp, None if everything is None else everything + tp),
        iou=_share(tp, everything),
    )


def _known_sum(counts: Sequence[int | None]) -> int | None:
    """A sum of which no part may be unknown."""
    known = [count for count in counts if count is not None]
    return sum(known) if len(known) == len(counts) else None


def _share(part: int | None, whole: int | None) -> float | None:
    return None if part is None or not whole else part / whole


@dataclass(frozen=True, slots=True)
class Matches:
    """How the fruit that should be matched were matched.

    Attributes:
        right: matched with themselves.
        wrong: matched with something else.
        missed: not matched.
        rate: right / (right + wrong); the paper's 308 / 323 may be this one or `found`.
        wilson95: its Wilson score interval.
        found: right / (right + wrong + missed).
    """

    right: int
    wrong: int
    missed: int
    rate: float | None
    wilson95: Interval | None
    found: float | None


def matches(verdicts: Iterable[str]) -> Matches | None:
    """Count verdicts "right", "wrong" and "missed"; None where there are none."""
    listed = list(verdicts)
    if not listed:
        return None
    right, wrong, missed = (listed.count(word) for word in ("right", "wrong", "missed"))
    return Matches(
        right=right,
        wrong=wrong,
        missed=missed,
        rate=_share(right, right + wrong),
        wilson95=wilson95(right, right + wrong),
        found=_share(right, right + wrong + missed),
    )


def wilson95(successes: int, trials: int) -> Interval | None:
    """The 95 % Wilson score interval of a rate; None without a trial."""
    if trials == 0:
        return None
    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True, slots=True)
class Errors:
    """Distance errors, estimated minus true, in metres; `p95` and `max` are of their size."""

    n: int
    bias: float
    rmse: float
    p95: float
    max: float


def errors(values_m: Sequence[float]) -> Errors | None:
    """Summarise errors; None where there are none."""
    if not values_m:
        return None
    values = np.asarray(values_m, float)
    size = np.abs(values)
    return Errors(
        n=len(values),
        bias=float(values.mean()),
        rmse=float(np.sqrt((values**2).mean())),
        p95=float(np.percentile(size, 95)),
        max=float(size.max()),
    )


@dataclass(frozen=True, slots=True)
class FruitRow:
    """What the score needs of one true apple; see `processor.count.AppleVerdict`."""

    distance_m: float | None
    visible: float | None  # in the worse of the two views
    match: str | None
    error_m: float | None
    std_m: float | None = None  # what the method says of the error
    views: tuple[tuple[float | None, bool], ...] = ()  # each view's visible fraction; found there?


@dataclass(frozen=True, slots=True)
class Score:
    """One group's score. A measure is None where its truth is missing: "not scored", never 0."""

    frames: int
    pixels: Detection | None
    pixels_cleaned: Detection | None
    fruit: Detection | None
    matches: Matches | None
    distance_m: Errors | None
    distance_m_by_visibility: dict[str, Errors | None]
    distance_m_by_range: dict[str, Errors | None]
    time_ms: dict[str, float]
    fruit_by_visibility: dict[str, Detection | None]  # false ones count in every class
    covered95: dict[str, float | None]  # share of errors within 1.96 standard deviations
    by_confidence: dict[str, Curve | None]  # "fruit", "matches"; None where no method or truth says


@dataclass(frozen=True, slots=True)
class FrameRow:
    """What the score needs of one frame: (tp, fp, fn) each, None where nobody could count."""

    pixels: tuple[int, int | None, int] | None
    pixels_cleaned: tuple[int, int | None, int] | None
    fruit: tuple[int, int | None, int] | None
    stage_ns: dict[str, int]


def score(
    frames: Sequence[FrameRow],
    fruit: Sequence[FruitRow],
    judged: Mapping[str, Sequence[Judged]] = MappingProxyType({}),
) -> Score:
    """Score one group of frames, the true apples in them, and what was found.

    Args:
        frames: with their counts.
        fruit: true apples.
        judged: "fruit" (circles of both views) and "matches", with their confidences; absent where
            the method has none, or nobody can know what is false.
    """
    asked = {
        "fruit": sum(f.fruit[0] + f.fruit[2] for f in frames if f.fruit is not None),
        "matches": sum(f.match is not None for f in fruit),
    }
    located = [f for f in fruit if f.error_m is not None]
    return Score(
        frames=len(frames),
        pixels=detection(f.pixels for f in frames if f.pixels is not None),
        pixels_cleaned=detection(f.pixels_cleaned for f in frames if f.pixels_cleaned is not None),
        fruit=detection(f.fruit for f in frames if f.fruit is not None),
        matches=matches(f.match for f in fruit if f.match is not None),
        distance_m=_errors_of(located),
        distance_m_by_visibility={
            name: _errors_of([f for f in located if _within(f.visible, least, below)])
            for name, least, below in VISIBILITY
        },
        distance_m_by_range={
            name: _errors_of([f for f in located if _within(f.distance_m, least, below)])
            for name, least, below in RANGES_M
        },
        time_ms=_medians_ms(frames),
        fruit_by_visibility={
            name: _found_of(frames, fruit, least, below) for name, least, below in FRUIT_VISIBILITY
        },
        covered95={
            name: _covered([f for f in located if _within(f.visible, least, below)])
            for name, least, below in (("all", 0.0, np.inf), *VISIBILITY)
        },
        by_confidence={
            what: curve(judged[what], wanted) if what in judged and wanted else None
            for what, wanted in asked.items()
        },
    )


def _found_of(
    frames: Sequence[FrameRow], fruit: Sequence[FruitRow], least: float, below: float
) -> Detection | None:
    """Fruit found by how much a view sees of them, in that view itself."""
    hits = [found for f in fruit for seen, found in f.views if _within(seen, least, below)]
    counted = [f.fruit for f in frames if f.fruit is not None]
    if not hits or not counted:
        return None
    fp = _known_sum([c[1] for c in counted])
    return detection([(sum(hits), fp, len(hits) - sum(hits))])


def _covered(fruit: Iterable[FruitRow]) -> float | None:
    within = [
        abs(f.error_m) <= 1.96 * f.std_m
        for f in fruit
        if f.error_m is not None and f.std_m is not None
    ]
    return _share(sum(within), len(within))


def _errors_of(fruit: Iterable[FruitRow]) -> Errors | None:
    return errors([f.error_m for f in fruit if f.error_m is not None])


def _within(value: float | None, least: float, below: float) -> bool:
    return value is not None and least <= value < below


def _medians_ms(frames: Sequence[FrameRow]) -> dict[str, float]:
    stages = frames[0].stage_ns if frames else {}
    return {stage: float(np.median([f.stage_ns[stage] for f in frames]) / 1e6) for stage in stages}
