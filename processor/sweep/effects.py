"""What a sweep says: each parameter's main effect, the best setting on train, its worth on test."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from processor.compare.judge import Judged, judge
from processor.curves import resampled95
from processor.measures import MEASURED, Floats, Measure
from processor.paired import Interval, differences
from processor.sweep.settings import Setting
from processor.sweep.splits import Split, Splits

Row = Mapping[str, Any]
Sums = dict[str, Floats]


@dataclass(frozen=True, slots=True)
class Level:
    """One value of one parameter, over all settings that have it.

    Attributes:
        value: as text.
        settings: how many have it.
        train: their mean; None where none could be scored.
        worst: of them, on train.
        best: of them, on train.
        test: their mean on test.
    """

    value: str
    settings: int
    train: float | None
    worst: float | None
    best: float | None
    test: float | None


@dataclass(frozen=True, slots=True)
class Worth:
    """One setting's value on both splits, in the measure's own unit; None where not scored."""

    setting: Setting
    train: float | None
    test: float | None
    train95: Interval | None
    test95: Interval | None
    locate_ms: float


@dataclass(frozen=True, slots=True)
class Found:
    """What a sweep found.

    Attributes:
        measure: what settings were judged by.
        train: each setting's value on train, in their order; NaN where not scored.
        test: the same on test.
        effects: parameter -> its levels, the parameter with the largest effect first.
        best: on train; None where nothing could be scored.
        base: the method as it was given.
        ranking: the settings of the grid, best first on train.
        on_test: the best held against the base on test; None where they are one, or not scored.
        pairs: of each split.
    """

    measure: Measure
    train: Floats
    test: Floats
    effects: dict[str, tuple[Level, ...]]
    best: Worth | None
    base: Worth
    ranking: tuple[int, ...]
    on_test: Judged | None
    pairs: dict[Split, int]


def find(
    measure: Measure, settings: Sequence[Setting], rows: Sequence[Row], splits: Splits
) -> Found:
    """Choose on train, and look at test.

    Args:
        measure: what to choose by.
        settings: in their order.
        rows: one a setting and pair.
        splits: which pairs are train.
    """
    sums = {name: sums_of(measure, len(settings), rows, splits, name) for name in _SPLITS}
    values = {name: _values(measure, sums[name], len(settings)) for name in _SPLITS}
    base = next(one.number for one in settings if one.is_base)
    worse = measure.worsening(np.zeros(len(settings)), values["train"])
    grid = [one.number for one in settings if one.in_grid and np.isfinite(worse[one.number])]
    ranking = tuple(sorted(grid, key=lambda number: (worse[number], number)))
    worths = {
        number: _worth(measure, settings[number], rows, sums, values)
        for number in {base, *ranking[:1]}
    }
    best = worths[ranking[0]] if ranking else None
    return Found(
        measure=measure,
        train=values["train"],
        test=values["test"],
        effects=_effects(measure, settings, values),
        best=best,
        base=worths[base],
        ranking=ranking,
        on_test=_on_test(measure, base, best, rows, splits, sums["test"]),
        pairs={name: sum(split == name for split in splits.of.values()) for name in _SPLITS},
    )


_SPLITS: tuple[Split, Split] = ("train", "test")


def sums_of(
    measure: Measure, settings: int, rows: Sequence[Row], splits: Splits, split: Split
) -> Sums:
    """Column -> (settings, pictures) of one split, what a measure needs; NaN: nobody counted."""
    keys = [key for key, name in splits.of.items() if name == split]
    place = {key: number for number, key in enumerate(keys)}
    sums = {name: np.full((settings, len(keys)), np.nan) for name in measure.sums}
    for row in rows:
        at = place.get((row["session"], row["frame"]))
        if at is None:
            continue
        for name in measure.sums:
            value = _errors(name, row["errors_m"]) if name in MEASURED else row[name]
            sums[name][row["setting"], at] = np.nan if value is None else value
    return sums


def _errors(name: str, errors_m: Sequence[float]) -> float:
    powers = {"errors": 0, "error_m": 1, "error2_m2": 2}
    return float(sum(error ** powers[name] for error in errors_m))


def _values(measure: Measure, sums: Sums, settings: int) -> Floats:
    """(settings,) over all pictures together; NaN where there is nothing to divide by."""
    table = np.stack([sums[name] for name in measure.sums], axis=-1)
    if not table.size:
        return np.full(settings, np.nan)
    known = np.asarray(np.isfinite(table).all(axis=2))
    return measure.value(np.where(known[:, :, None], table, 0.0).sum(axis=1))


def _worth(
    measure: Measure,
    setting: Setting,
    rows: Sequence[Row],
    sums: Mapping[Split, Sums],
    values: Mapping[Split, Floats],
) -> Worth:
    mine = [row["locate_ns"] for row in rows if row["setting"] == setting.number]
    ends: dict[Split, Interval | None] = {}
    for name in _SPLITS:
        own = np.stack([sums[name][column][setting.number] for column in measure.sums], axis=-1)
        ends[name] = resampled95(own[np.isfinite(own).all(axis=1)], measure.value)
    return Worth(
        setting,
        _known(values["train"][setting.number]),
        _known(values["test"][setting.number]),
        ends["train"],
        ends["test"],
        float(np.median(mine)) / 1e6,
    )


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _effects(
    measure: Measure, settings: Sequence[Setting], values: Mapping[Split, Floats]
) -> dict[str, tuple[Level, ...]]:
    """Each value's mean over all settings of the grid that have it: the others' mean with it."""
    grid = [one for one in settings if one.in_grid]
    effects = {}
    for name in settings[0].values:
        groups: dict[str, list[int]] = {}
        for one in grid:
            groups.setdefault(one.values[name], []).append(one.number)
        effects[name] = tuple(_level(measure, v, group, values) for v, group in groups.items())
    return dict(sorted(effects.items(), key=lambda item: -_reach(item[1])))


def _level(
    measure: Measure, value: str, group: Sequence[int], values: Mapping[Split, Floats]
) -> Level:
    train, test = (values[name][list(group)] for name in _SPLITS)
    known = train[np.isfinite(train)]
    order = sorted(known.tolist(), key=lambda v: float(measure.worsening(np.array(0.0), v)))
    return Level(
        value,
        len(group),
        _mean(train),
        order[-1] if order else None,
        order[0] if order else None,
        _mean(test),
    )


def _mean(values: Floats) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None


def _reach(levels: Sequence[Level]) -> float:
    """How far a parameter moves the mean."""
    means = [level.train for level in levels if level.train is not None]
    return max(means) - min(means) if means else 0.0


def _on_test(
    measure: Measure,
    base: int,
    best: Worth | None,
    rows: Sequence[Row],
    splits: Splits,
    sums: Sums,
) -> Judged | None:
    """The best against the method as it was, on pictures that had no part in the choice."""
    if best is None or best.setting.is_base or best.test is None:
        return None
    both = base, best.setting.number
    if measure.sums[-1] == "errors":
        a, b = _common_errors(measure, both, rows, splits)
    else:
        a, b = ({name: table[number] for name, table in sums.items()} for number in both)
    units = np.arange(len(next(iter(a.values()))))
    found = differences([measure], a, b, units, np.random.default_rng(0))
    return judge([measure], found, {})[0]


def _common_errors(
    measure: Measure, numbers: tuple[int, int], rows: Sequence[Row], splits: Splits
) -> tuple[Sums, Sums]:
    """Errors of fruit that both located, as `compare` has them."""
    located: dict[tuple[str, int], list[dict[int, float]]] = {
        key: [{}, {}] for key, split in splits.of.items() if split == "test"
    }
    for row in rows:
        key = row["session"], row["frame"]
        if key in located and row["setting"] in numbers:
            mine = dict(zip(row["apples"], row["errors_m"], strict=True))
            located[key][numbers.index(row["setting"])] = mine
    sides: list[Sums] = []
    for side in (0, 1):
        common = [[both[side][i] for i in both[0] if i in both[1]] for both in located.values()]
        sides.append(
            {name: np.array([_errors(name, errors) for errors in common]) for name in measure.sums}
        )
    return sides[0], sides[1]
