"""What a report stands side by side: the runs of one method in one folder, and their rows."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from processor.discs import LEAST_VISIBLE
from processor.results import STAGES, read_table
from processor.runs import Run, find_runs, score_runs
from processor.score import Score
from recorder.records import SIDES
from recorder.rig import Floats

USUAL: Final = "lighting"  # what the paper's tables are by

Bools = npt.NDArray[np.bool_]
Tables = dict[str, Any]
"""One run's tables by name."""


@dataclass(frozen=True, slots=True, eq=False)
class Circles:
    """The circles of single views that are right or false; those that count neither way are left.

    Attributes:
        confidence: (N,) NaN where the method gives none.
        true: (N,) whether each finds an apple that should be found.
        wanted: how many should be found; None where nobody can know which circles are right, and
            which are false.
        seen: (M,) the visible fraction of each true apple in each view, where somebody said.
        found: (M,) whether a circle of that view finds it.
    """

    confidence: Floats
    true: npt.NDArray[np.bool_]
    wanted: int | None
    seen: Floats
    found: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Fruit:
    """The true apples, a place a fruit; NaN where nobody said, or nothing was located.

    Attributes:
        pair: (N,) which pair each is of, counted over the column.
        distance_m: (N,) true distances.
        visible: (N,) fraction seen by the worse of the views.
        error_m: (N,) estimated minus true distance.
        std_m: (N,) what the method says of that.
        match: (N,) "right", "wrong", "missed", or None where it need not be matched.
    """

    pair: npt.NDArray[np.int64]
    distance_m: Floats
    visible: Floats
    error_m: Floats
    std_m: Floats
    match: npt.NDArray[np.object_]


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One method on the sessions of one folder.

    Attributes:
        label: what it is called on the page.
        runs: its sessions' results.
        groups: "all" and each value of the condition -> its score.
        by: the condition; empty where no session says one.
        group_of: (P,) the value of the condition at each pair; "" where nobody says.
        frames: name of a count of frames.parquet -> (P,) over all pairs, NaN where unknown.
        circles: of single views.
        fruit: that are true.
    """

    label: str
    runs: tuple[Run, ...]
    groups: dict[str, Score]
    by: str
    group_of: npt.NDArray[np.str_]
    frames: dict[str, Floats]
    circles: Circles
    fruit: Fruit

    @property
    def score(self) -> Score:
        """Of all pairs."""
        return self.groups["all"]

    @property
    def pairs(self) -> int:
        """How many pairs."""
        return self.score.frames

    @property
    def about(self) -> dict[str, Any]:
        """What run.json says of its first session: the method is the same in all."""
        return self.runs[0].about


def columns_of(outs: Sequence[Path], by: str = "") -> tuple[Column, ...]:
    """Read folders of results; runs of different methods never share a column.

    Args:
        outs: folders of results.
        by: the condition to group by; empty: by lighting, where sessions say theirs.

    Raises:
        PomologError: there are no results, one is damaged, or no session says that condition.
    """
    gathered: dict[tuple[Path, str], list[Run]] = {}
    seen: set[Path] = set()
    for out in outs:
        for run in find_runs([out]):
            if run.folder.resolve() not in seen:
                seen.add(run.folder.resolve())
                gathered.setdefault((out, _method_key(run)), []).append(run)
    columns = [_column(tuple(runs), by or USUAL) for runs in gathered.values()]
    if by and not any(column.by for column in columns):
        score_runs([run for column in columns for run in column.runs], by)  # says what they say
    return tuple(_named(columns, [out for out, _ in gathered]))


def _method_key(run: Run) -> str:
    told = {key: run.about.get(key) for key in ("method", "locator", "models", "seed")}
    return json.dumps(told, sort_keys=True)


def _named(columns: Sequence[Column], outs: Sequence[Path]) -> Iterator[Column]:
    """Told apart by method, or else by folder, or else by number."""
    methods = [column.about["method"] for column in columns]
    labels = [
        method if methods.count(method) == 1 else f"{method} ({out.resolve().name})"
        for method, out in zip(methods, outs, strict=True)
    ]
    for number, (column, label) in enumerate(zip(columns, labels, strict=True)):
        yield replace(column, label=label if labels.count(label) == 1 else f"{label} {number + 1}")


def _column(runs: tuple[Run, ...], by: str) -> Column:
    tables = [
        {name: read_table(run.folder, name) for name in ("frames", "apples", "truth")}
        for run in runs
    ]
    conditions = [dict(row) for t in tables for row in t["frames"]["conditions"].to_pylist()]
    by = by if any(by in said for said in conditions) else ""
    names = [f"{what}_{part}" for what in ("pixels", "fruit") for part in ("tp", "fp", "fn")]
    names += [f"{stage}_ns" for stage in STAGES]
    names += ["left_fruit", "right_fruit", "matched", "skew_ns", "time_ns"]
    frames = {
        name: np.concatenate([_numbers(table["frames"], name) for table in tables])
        for name in names
    }
    groups = score_runs(runs, by)
    group_of = np.array([said.get(by, "") for said in conditions])
    return Column("", runs, groups, by, group_of, frames, _circles(tables, frames), _fruit(tables))


def _numbers(table: Any, name: str) -> Floats:
    """A column as floats, null as NaN."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False), np.float64)


def _circles(tables: Sequence[Tables], frames: dict[str, Floats]) -> Circles:
    verdicts = [_verdicts(table, side) for table in tables for side in SIDES]
    confidence, right, false = (np.concatenate(parts) for parts in zip(*verdicts, strict=True))
    counted = ~np.isnan(frames["fruit_tp"])
    # truth of one view, or of views that name apples apart, is counted but names no circle's apple
    known = counted.any() and [right.sum(), false.sum()] == [
        frames[name][counted].sum() for name in ("fruit_tp", "fruit_fp")
    ]
    wanted = int((frames["fruit_tp"] + frames["fruit_fn"])[counted].sum()) if known else None
    judged = right | false
    truths = [table["truth"] for table in tables for _ in SIDES]
    views = list(zip(truths, SIDES * len(tables), strict=True))
    seen = np.concatenate([_numbers(truth, f"{side}_visible") for truth, side in views])
    found = np.concatenate(
        [truth[f"found_{side}"].to_numpy(zero_copy_only=False) for truth, side in views]
    )
    said = ~np.isnan(seen) & (seen >= LEAST_VISIBLE)
    return Circles(confidence[judged], right[judged], wanted, seen[said], found[said].astype(bool))


def _verdicts(tables: Tables, side: str) -> tuple[Floats, Bools, Bools]:
    """Of each circle of a view: its confidence, whether it is right, whether it is false."""
    truth, apples = tables["truth"], tables["apples"]
    named = (truth[name].to_pylist() for name in ("frame", "apple_id", f"{side}_visible"))
    wanted = {
        (frame, apple_id)
        for frame, apple_id, seen in zip(*named, strict=True)
        if seen is None or seen >= LEAST_VISIBLE
    }
    finds = zip(apples["frame"].to_pylist(), apples[f"{side}_truth"].to_pylist(), strict=True)
    right = np.array([find in wanted for find in finds], bool)
    false = np.array([bool(false) for false in apples[f"{side}_false"].to_pylist()], bool)
    return _numbers(apples, f"{side}_confidence"), right, false


def _fruit(tables: Sequence[Tables]) -> Fruit:
    truths = [table["truth"] for table in tables]
    starts = np.cumsum([0, *(len(table["frames"]) for table in tables)])[:-1]
    columns = {
        name: np.concatenate([_numbers(truth, name) for truth in truths])
        for name in ("frame", "distance_m", "left_visible", "right_visible", "error_m", "std_m")
    }
    of_run = np.concatenate(
        [np.full(len(truth), start) for truth, start in zip(truths, starts, strict=True)]
    )
    return Fruit(
        pair=(of_run + columns["frame"]).astype(np.int64),
        distance_m=columns["distance_m"],
        visible=np.minimum(columns["left_visible"], columns["right_visible"]),
        error_m=columns["error_m"],
        std_m=columns["std_m"],
        match=np.array([word for truth in truths for word in truth["match"].to_pylist()], object),
    )
