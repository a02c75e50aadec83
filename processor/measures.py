"""What versions of a method are compared by: each measure a function of sums over pictures."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Better = Literal["more", "less", "nearer zero", "unknown"]

RATE: Final = 0.005  # half a percent point: one fruit in two hundred
LENGTH_M: Final = 0.001  # the rangefinder that distances are held against is good to 1 mm


@dataclass(frozen=True, slots=True)
class Measure:
    """One measure.

    Attributes:
        name: in gates and JSON.
        title: for people.
        sums: the columns that it needs.
        value: sums (..., len(sums)) -> value (...); NaN where there is nothing to divide by.
        better: which way.
        matters: the smallest difference of interest, in the value's own unit.
        scale: from the value to what people read.
        unit: what people read it in; "%" of what is a share.
        digits: after the point, for people.
    """

    name: str
    title: str
    sums: tuple[str, ...]
    value: Callable[[Floats], Floats]
    better: Better
    matters: float
    scale: float = 100.0
    unit: str = "%"
    digits: int = 2

    @property
    def is_rate(self) -> bool:
        """Whether it is a share of something counted."""
        return self.unit == "%"

    @property
    def written(self) -> float:
        """From the value to what gates and JSON have: shares stay shares, the rest as people read.

        Names say it: fruit_recall is 0.85, distance_rmse_mm is 15.
        """
        return 1.0 if self.is_rate else self.scale

    def worsening(self, a: Floats, b: Floats) -> Floats:
        """By how much B is worse than A; of what nobody can call better, the size of the change."""
        if self.better == "more":
            return a - b
        if self.better == "less":
            return b - a
        return np.abs(b) - np.abs(a) if self.better == "nearer zero" else np.abs(b - a)


def _divided(part: Floats, whole: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(whole > 0, part / whole, np.nan))


def _share(sums: Floats) -> Floats:
    """The first of the sums as a share of all of them."""
    return _divided(sums[..., 0], sums.sum(axis=-1))


def _f1(sums: Floats) -> Floats:
    tp = sums[..., 0]
    return _divided(2 * tp, tp + sums.sum(axis=-1))


def _mean(sums: Floats) -> Floats:
    """The first sum by the second."""
    return _divided(sums[..., 0], sums[..., 1])


def _root_mean(sums: Floats) -> Floats:
    return np.sqrt(np.maximum(_mean(sums), 0.0))


def _length(name: str, title: str, total: str, better: Better) -> Measure:
    value = _root_mean if total == "error2_m2" else _mean
    return Measure(
        name, title, (total, "errors"), value, better, LENGTH_M, scale=1e3, unit="mm"
    )  # fmt: skip


# Errors are summed over fruit that both sides located: other fruit are no fair comparison.
WITH_TRUTH: Final = (
    Measure("pixels_f1", "pixel F1 of the recognised masks",
            ("pixels_tp", "pixels_fp", "pixels_fn"), _f1, "more", RATE),
    Measure("fruit_precision", "fruit precision", ("fruit_tp", "fruit_fp"), _share, "more", RATE),
    Measure("fruit_recall", "fruit recall", ("fruit_tp", "fruit_fn"), _share, "more", RATE),
    Measure("fruit_f1", "fruit F1", ("fruit_tp", "fruit_fp", "fruit_fn"), _f1, "more", RATE),
    Measure("match_rate", "matches right / (right + wrong)",
            ("right", "wrong"), _share, "more", RATE),
    Measure("match_found", "matches right / (right + wrong + missed)",
            ("right", "wrong", "missed"), _share, "more", RATE),
    _length("distance_bias_mm", "distance, mean error", "error_m", "nearer zero"),
    _length("distance_rmse_mm", "distance, RMSE", "error2_m2", "less"),
)  # fmt: skip
# Without truth a difference can be shown, but not which side is better.
WITHOUT_TRUTH: Final = (
    Measure("fruit_per_pair", "circles a pair, both views", ("circles", "pairs"), _mean,
            "unknown", 0.1, scale=1, unit="a pair"),
    Measure("located_per_pair", "located apples a pair", ("located", "pairs"), _mean,
            "unknown", 0.1, scale=1, unit="a pair"),
    _length("distance_mean_mm", "distance, mean", "distance_m", "unknown"),
)  # fmt: skip
MEASURES: Final = {measure.name: measure for measure in (*WITH_TRUTH, *WITHOUT_TRUTH)}
# every column a measure may need; counted picture by picture, and on fruit that both located
COUNTED: Final = (
    "pairs", "circles", "located", "pixels_tp", "pixels_fp", "pixels_fn",
    "fruit_tp", "fruit_fp", "fruit_fn", "right", "wrong", "missed",
)  # fmt: skip
MEASURED: Final = ("errors", "error_m", "error2_m2", "distance_m")
