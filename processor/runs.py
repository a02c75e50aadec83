"""Folders of results, found, read and handed to the score by group."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from processor.judge import JUDGED, judge
from processor.results import STAGES, TABLES, Row, read_table
from processor.run_file import read_run
from processor.score import FrameRow, FruitRow, Score, score
from processor.sureness import Judged
from recorder.errors import PomologError
from recorder.objects import ObjectPath, Place

_KEPT: Final = {"run.json", *(f"{name}.parquet" for name in TABLES)}
_copies: list["TemporaryDirectory[str]"] = []  # gone when this process ends


@dataclass(frozen=True, slots=True)
class Run:
    """One session's results: the folder and its run.json."""

    folder: Path
    about: dict[str, Any]


def find_runs(outs: Sequence[Place]) -> tuple[Run, ...]:
    """Every session's results in the given folders, or below them.

    Those in object storage are copied to a folder of this process, without their drawings.

    Raises:
        PomologError: there are none, or one was made by another version.
    """
    runs: dict[Path, Run] = {}  # named twice, results count once
    for place in outs:
        out = _copy(place) if isinstance(place, ObjectPath) else place
        found = [out] if (out / "run.json").is_file() else []
        found += sorted(path.parent for path in out.glob("*/run.json"))
        if not found:
            raise _no_results(place)
        runs |= {folder.resolve(): Run(folder, read_run(folder / "run.json")) for folder in found}
    return tuple(runs.values())


def _no_results(place: Place) -> PomologError:
    if place.name.endswith(".mcap"):
        now = f"{place} is no folder of results; make one with: pomolog replay {place} -o results"
    elif place.is_file():
        now = f"{place} is a file; results are a folder, give what was -o of pomolog replay"
    else:
        now = f"no results in {place}; make them with: pomolog replay S -o {place}"
    return PomologError(now)


def _copy(out: ObjectPath) -> Path:
    folder = TemporaryDirectory()
    _copies.append(folder)
    for one in out.below():
        below = str(one).removeprefix(f"{str(out).rstrip('/')}/").split("/")
        if len(below) <= 2 and not below[0].startswith(".parts-") and one.name in _KEPT:
            file = Path(folder.name, *below)
            file.parent.mkdir(exist_ok=True)
            one.get(file)
    return Path(folder.name)


@dataclass(slots=True)
class Group:
    """What one group's score is made of."""

    frames: list[FrameRow] = field(default_factory=list)
    fruit: list[FruitRow] = field(default_factory=list)
    judged: dict[str, list[Judged | None]] = field(default_factory=dict)

    def known(self) -> dict[str, list[Judged]]:
        """What was judged, without a kind of which one could not be."""
        whole = {
            what: [one for one in found if one is not None] for what, found in self.judged.items()
        }
        return {what: ones for what, ones in whole.items() if len(ones) == len(self.judged[what])}


def score_runs(runs: Sequence[Run], by: str = "") -> dict[str, Score]:
    """The score of all frames together ("all"), and of each value of a condition.

    Args:
        runs: what to score.
        by: a condition: lighting, cultivar, or whatever the sessions' metadata and notes say;
            or method.

    Raises:
        PomologError: no frame has that condition.
    """
    groups: dict[str, Group] = {"all": Group()}
    known: set[str] = set()
    for run in runs:
        group_of = {}
        for row in read_table(run.folder, "frames").to_pylist():
            conditions = {**dict(row["conditions"]), "method": run.about["method"]}
            known |= conditions.keys()
            names = ["all"] + ([f"{by}={conditions[by]}"] if by in conditions else [])
            group_of[row["frame"]] = names
            for name in names:
                groups.setdefault(name, Group()).frames.append(_frame_row(row))
        truth = read_table(run.folder, "truth").select([*_FRUIT, "apple_id"]).to_pylist()
        for row in truth:
            for name in group_of[row["frame"]]:
                groups[name].fruit.append(_fruit_row(row))
        found = read_table(run.folder, "apples").select(JUDGED).to_pylist()
        for frame, what, one in judge(found, truth):
            for name in group_of[frame]:
                groups[name].judged.setdefault(what, []).append(one)
    if by and len(groups) == 1:
        raise PomologError(f"no session says its {by}; they say {', '.join(sorted(known))}")
    return {name: score(g.frames, g.fruit, g.known()) for name, g in groups.items()}


def _frame_row(row: Row) -> FrameRow:
    return FrameRow(
        pixels=_counts(row, "pixels"),
        pixels_cleaned=_counts(row, "pixels_cleaned"),
        fruit=_counts(row, "fruit"),
        stage_ns={stage: row[f"{stage}_ns"] for stage in STAGES},
    )


def _counts(row: Row, what: str) -> tuple[int, int | None, int] | None:
    if row[f"{what}_tp"] is None:
        return None
    return row[f"{what}_tp"], row[f"{what}_fp"], row[f"{what}_fn"]


# what a fruit's row is made of; the rest of truth.parquet would be a gigabyte of a long session
_FRUIT: Final = (
    "frame", "distance_m", "left_visible", "right_visible", "found_left", "found_right", "match",
    "error_m", "std_m",
)  # fmt: skip


def _fruit_row(row: Row) -> FruitRow:
    seen = [row["left_visible"], row["right_visible"]]
    visible = None if None in seen else min(seen)
    views = tuple((row[f"{side}_visible"], row[f"found_{side}"]) for side in ("left", "right"))
    return FruitRow(row["distance_m"], visible, row["match"], row["error_m"], row["std_m"], views)


# what the recorder's ledger counts as not kept, or not kept well, stream by stream
LOSSES: Final = ("dropped", "missing", "incomplete", "late", "unpaired", "reopened")


def losses(runs: Sequence[Run]) -> dict[str, int] | None:
    """What the recorders of these sessions lost, summed over streams; None: none kept a ledger."""
    ledgers = [run.about["session"].get("ledger") or {} for run in runs]
    if not any(ledgers):
        return None
    totals = dict.fromkeys(LOSSES, 0)
    for ledger in ledgers:
        for key, value in ledger.items():
            loss = key.rpartition(".")[2]
            if loss in totals and value.isdecimal():
                totals[loss] += int(value)
    return totals
