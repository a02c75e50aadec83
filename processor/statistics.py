"""Tests, effect sizes, equivalence and bootstrap intervals: numbers in, numbers out.

`scipy.stats` does the distributions. Groups are arrays without gaps; a test of fewer than two
values, or of values without any spread, has no answer and is None.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import optimize, stats

Floats = npt.NDArray[np.float64]

LEVEL: Final = 0.05  # Table 2: "at the significance level of 95%"
DRAWS: Final = 2000  # of a bootstrap: its 95 % limits then move by less than a tenth of their width
_DRAWN_AT_ONCE: Final = 100  # 30 minutes have 18000 pairs, and every draw a number of each


@dataclass(frozen=True, slots=True)
class TTest:
    """A two-sided t-test of a difference of means.

    Attributes:
        n: values, of the smaller group.
        difference: mean of the first minus mean of the second, in the values' unit.
        low: lower end of its 95 % interval.
        high: upper end.
        t: the statistic.
        df: degrees of freedom.
        t_table: the size of t that is significant at 95 %.
        p: the two-sided p-value.
        effect: Cohen's d (pooled SD) where unpaired, d_z (SD of the differences) where paired.
        effect_unbiased: the same by Hedges' correction for small groups; None below three degrees
            of freedom, where nothing is left of it.
    """

    n: int
    difference: float
    low: float
    high: float
    t: float
    df: float
    t_table: float
    p: float
    effect: float
    effect_unbiased: float | None

    @property
    def significant(self) -> bool:
        """Whether |t| exceeds the table's value."""
        return abs(self.t) > self.t_table


def t_table(df: float, level: float = LEVEL) -> float:
    """The two-sided critical value of t: 2.07 at 22 degrees of freedom, as in Table 2."""
    return float(stats.t.ppf(1 - level / 2, df))


def unpaired(first: Sequence[float], second: Sequence[float]) -> TTest | None:
    """Student's t-test of two groups of equal variance, as Table 2 has it (12 + 12, df = 22)."""
    a, b = np.asarray(first, float), np.asarray(second, float)
    if min(len(a), len(b)) < 2:
        return None
    df = len(a) + len(b) - 2
    pooled = np.sqrt(((len(a) - 1) * a.var(ddof=1) + (len(b) - 1) * b.var(ddof=1)) / df)
    return _t_test(a.mean() - b.mean(), pooled, np.sqrt(1 / len(a) + 1 / len(b)), df,
                   min(len(a), len(b)))  # fmt: skip


def paired(first: Sequence[float], second: Sequence[float]) -> TTest | None:
    """The t-test of paired values, by their differences: the same ranges in two conditions."""
    differences = np.asarray(first, float) - np.asarray(second, float)
    n = len(differences)
    if n < 2:
        return None
    return _t_test(differences.mean(), differences.std(ddof=1), 1 / np.sqrt(n), n - 1, n)


def _t_test(difference: float, deviation: float, scale: float, df: int, n: int) -> TTest | None:
    if deviation == 0:
        return None
    error = float(deviation * scale)
    t = float(difference) / error
    critical = t_table(df)
    effect = float(difference / deviation)
    return TTest(
        n=n,
        difference=float(difference),
        low=float(difference - critical * error),
        high=float(difference + critical * error),
        t=t,
        df=float(df),
        t_table=critical,
        p=float(2 * stats.t.sf(abs(t), df)),
        effect=effect,
        effect_unbiased=effect * (1 - 3 / (4 * df - 1)) if df >= 3 else None,
    )


def equivalence_p(test: TTest, margin: float) -> float:
    """The p-value of two one-sided tests (TOST): that the means differ by less than `margin`.

    Below 0.05 the means are equivalent within the margin; the converse of a t-test, whose
    "no significant difference" says nothing about how far apart the means may be.
    """
    error = test.difference / test.t if test.t else (test.high - test.low) / (2 * test.t_table)
    from_below = stats.t.sf((test.difference + margin) / error, test.df)
    from_above = stats.t.cdf((test.difference - margin) / error, test.df)
    return float(max(from_below, from_above))


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down correction: p-values that hold for all of them together."""
    order = np.argsort(p_values)
    corrected = np.empty(len(p_values))
    largest = 0.0
    for rank, place in enumerate(order.tolist()):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[place]))
        corrected[place] = largest
    return [float(p) for p in corrected]


def detectable_effect(n: int, *, power: float = 0.8, pairs: bool = False) -> float:
    """The effect size that a t-test of n values (a group, or pairs) finds with that power."""
    df = n - 1 if pairs else 2 * n - 2
    scale = np.sqrt(n) if pairs else np.sqrt(n / 2)
    critical = t_table(df)

    def lacking(effect: float) -> float:
        beyond = stats.nct.sf(critical, df, effect * scale)
        return float(beyond + stats.nct.cdf(-critical, df, effect * scale)) - power

    enough = 1.0
    while lacking(enough) < 0:
        enough *= 1.5  # far beyond the effect sought, the distribution has no numbers any more
    return float(optimize.brentq(lacking, 1e-3, enough))


def bootstrap_shares(
    parts: npt.ArrayLike, wholes: npt.ArrayLike, rng: np.random.Generator, draws: int = DRAWS
) -> tuple[float, float] | None:
    """The 95 % interval of sum(parts) / sum(wholes), whole pairs of pictures drawn again.

    Args:
        parts: (P,) counts, one a pair of pictures: both views of a tree stay together, because
            they are not independent.
        wholes: (P,) the counts that they are shares of.
        rng: of the draws.
        draws: how many.

    Returns:
        The percentile interval; None with fewer than two pairs or an empty whole.
    """
    part, whole = np.asarray(parts, float), np.asarray(wholes, float)
    if len(part) < 2 or whole.sum() == 0:
        return None
    return drawn_again(
        np.column_stack([part, whole]), lambda sums: sums[:, 0] / sums[:, 1], rng, draws
    )


def drawn_again(
    sums: Floats,
    statistic: Callable[[Floats], Floats],
    rng: np.random.Generator,
    draws: int = DRAWS,
) -> tuple[float, float]:
    """The 95 % percentile interval of a statistic of sums, whole pairs of pictures drawn again.

    Args:
        sums: (P, K), for each pair what the statistic sums over pairs; at least one pair.
        statistic: (D, K) sums -> (D,) values; where they cannot be divided they are left out.
        rng: of the draws.
        draws: how many.
    """
    even = np.full(len(sums), 1 / len(sums))
    parts = [min(_DRAWN_AT_ONCE, draws - done) for done in range(0, draws, _DRAWN_AT_ONCE)]
    drawn = np.concatenate([rng.multinomial(len(sums), even, size=part) @ sums for part in parts])
    with np.errstate(divide="ignore", invalid="ignore"):
        values = statistic(drawn)
    low, high = np.percentile(values[np.isfinite(values)], [2.5, 97.5])
    return float(low), float(high)
