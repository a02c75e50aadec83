"""Two sides of the same pictures: how far apart a measure is, and how far that may be chance.

The unit of independence is a stereo pair of pictures, or a session: what lies in it is drawn
again as a whole. Numbers in, numbers out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import stats

from processor.measures import Measure
from processor.statistics import DRAWS, LEVEL, t_table

Floats = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]
Sums = Mapping[str, Floats]  # column -> (pictures,) sums of each; NaN where nobody counted
Interval = tuple[float, float]

AT_ONCE: Final = 100  # bootstrap draws held in memory together
POWER: Final = 0.8
RECOMBINED: Final = 500  # runs put together of repeats


@dataclass(frozen=True, slots=True)
class Difference:
    """One measure on both sides, in its own unit; `change` is B minus A.

    Attributes:
        a: the value of A, over all units together.
        b: the same of B.
        units: that have something counted on either side.
        change: b - a.
        interval95: of the change; units drawn again, ends widened for few units.
        interval90: the same at 90 %: what two one-sided tests at 5 % need.
        worsening: by how much B is worse; negative where it is better.
        worsening95: its interval.
        worsening90: the same at 90 %.
        std: of one unit's contribution to the change; None with one unit.
        p: of the paired t-test over units that the change is zero; None with one unit.
        identical: every picture's sums are the same on both sides.
    """

    a: float
    b: float
    units: int
    change: float
    interval95: Interval
    interval90: Interval
    worsening: float
    worsening95: Interval
    worsening90: Interval
    std: float | None
    p: float | None
    identical: bool = False


def differences(
    measures: Sequence[Measure],
    a: Sums,
    b: Sums,
    unit_of: Places,
    rng: np.random.Generator,
    draws: int = DRAWS,
) -> dict[str, Difference | None]:
    """Hold every measure of B against A's.

    Args:
        measures: which.
        a: the sums of A by picture.
        b: the sums of B, of the same pictures.
        unit_of: (pictures,) which unit each belongs to, counted from 0.
        rng: of the bootstrap's draws.
        draws: how many.

    Returns:
        None for a measure that has nothing to divide by on either side.
    """
    tables = {m.name: _table(m, a, b, unit_of) for m in measures}
    drawn = _drawn(measures, tables, rng, draws)
    return {
        m.name: _difference(m, tables[m.name], drawn[m.name], identical=_identical(m, a, b))
        for m in measures
    }


def _identical(measure: Measure, a: Sums, b: Sums) -> bool:
    return all(np.array_equal(a[name], b[name], equal_nan=True) for name in measure.sums)


def _table(measure: Measure, a: Sums, b: Sums, unit_of: Places) -> Floats:
    """(units, 2, sums); a picture that was not counted on either side adds nothing."""
    table = np.stack(
        [np.stack([side[name] for name in measure.sums], axis=-1) for side in (a, b)], axis=1
    )
    known = np.isfinite(table).all(axis=(1, 2))
    added = np.zeros((int(unit_of.max()) + 1, *table.shape[1:]))
    np.add.at(added, unit_of[known], table[known])
    return added


def _drawn(
    measures: Sequence[Measure],
    tables: Mapping[str, Floats],
    rng: np.random.Generator,
    draws: int,
) -> dict[str, Floats]:
    """(draws, 2) values of both sides with units drawn again, the same ones for all measures."""
    units = len(next(iter(tables.values())))
    found: dict[str, list[Floats]] = {m.name: [] for m in measures}
    for start in range(0, draws, AT_ONCE):
        size = min(AT_ONCE, draws - start)
        times = rng.multinomial(units, np.full(units, 1 / units), size=size).astype(float)
        for m in measures:
            found[m.name].append(m.value(np.tensordot(times, tables[m.name], axes=1)))
    return {name: np.concatenate(values) for name, values in found.items()}


def _difference(
    measure: Measure, table: Floats, drawn: Floats, *, identical: bool
) -> Difference | None:
    counted = table[(table != 0).any(axis=(1, 2))]
    a, b = map(float, measure.value(table.sum(axis=0)))
    if not np.isfinite([a, b]).all():
        return None
    units = len(counted)
    std = _std(measure, counted)
    error = None if std is None else std / np.sqrt(units)
    changes = drawn[:, 1] - drawn[:, 0]
    worse = measure.worsening(drawn[:, 0], drawn[:, 1])
    worsening = float(measure.worsening(np.array(a), np.array(b)))
    floor = _one_fruit(measure, table)
    return Difference(
        a=a,
        b=b,
        units=units,
        change=b - a,
        interval95=_interval(b - a, changes, units, LEVEL, floor),
        interval90=_interval(b - a, changes, units, 2 * LEVEL, floor),
        worsening=worsening,
        worsening95=_interval(worsening, worse, units, LEVEL, floor),
        worsening90=_interval(worsening, worse, units, 2 * LEVEL, floor),
        std=std,
        p=None if error is None else _p(b - a, max(error, floor), units),
        identical=identical,
    )


def _std(measure: Measure, counted: Floats) -> float | None:
    """The deviation of the units' jackknife pseudo-values of the change (Tukey 1958).

    Of a plain mean it is the deviation of the paired differences themselves.
    """
    units = len(counted)
    if units < 2:
        return None
    without = measure.value(counted.sum(axis=0) - counted)  # (units, 2)
    changes = without[:, 1] - without[:, 0]
    if not np.isfinite(changes).all():
        return None  # all that was counted lies in one unit
    return float((units - 1) * changes.std(ddof=1))


def _one_fruit(measure: Measure, table: Floats) -> float:
    """What one fruit counted otherwise changes: the least noise that a rate can be said to have.

    Without it, identical counts of a dozen fruit would pass for proof of equality.
    """
    return 1.0 / float(table.sum(axis=(0, 2)).max()) if measure.is_rate else 0.0


def _interval(value: float, drawn: Floats, units: int, level: float, floor: float) -> Interval:
    """The percentile interval, expanded for few units (Hesterberg 2015, Sec. 4.3)."""
    if units < 2:
        return -np.inf, np.inf
    critical = t_table(units - 1, level)
    tail = 100 * float(stats.norm.cdf(-np.sqrt(units / (units - 1)) * critical))
    low, high = (float(np.nanpercentile(drawn, at)) for at in (tail, 100 - tail))
    least = critical * floor
    return min(low, value - least), max(high, value + least)


def _p(change: float, error: float, units: int) -> float:
    if error == 0:
        return 1.0 if change == 0 else 0.0
    return float(2 * stats.t.sf(abs(change) / error, units - 1))


def units_needed(std: float, least: float) -> int:
    """Units that a paired t-test at 95 % needs to find a change of `least` with 80 % power."""
    level, power = (float(stats.norm.ppf(share)) for share in (1 - LEVEL / 2, POWER))
    normal = ((level + power) * std / least) ** 2
    return max(2, int(np.ceil(normal + level**2 / 2)))  # Guenther 1981: t instead of normal


def seed_std(measure: Measure, runs: Sequence[Sums], rng: np.random.Generator) -> float | None:
    """How much the seed alone moves one run's value: a standard deviation; None for one run.

    Each picture draws its own numbers, so that any run's share of any picture makes a run that
    could have been: repeats are put together anew, which needs only a few of them.
    """
    if len(runs) < 2:
        return None
    table = np.stack([np.stack([run[name] for name in measure.sums], axis=-1) for run in runs])
    known = np.isfinite(table).all(axis=(0, 2))
    table = table[:, known]
    places = np.arange(table.shape[1])
    values = [
        float(measure.value(table[rng.integers(len(runs), size=len(places)), places].sum(axis=0)))
        for _ in range(RECOMBINED)
    ]
    if not np.isfinite(values).all():
        return None
    return float(np.std(values, ddof=1) * np.sqrt(len(runs) / (len(runs) - 1)))
