"""The two sides of a comparison: which runs they are, and the sessions that both have."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processor.runs import Run, find_runs
from recorder.errors import PomologError


@dataclass(frozen=True, slots=True)
class Repeat:
    """One run of a method: a folder of results, its sessions by name."""

    folder: Path
    sessions: dict[str, Run]

    @property
    def about(self) -> dict[str, Any]:
        """What run.json says of any of its sessions; method and seed are those of all."""
        return next(iter(self.sessions.values())).about

    @property
    def seed(self) -> int:
        """Of every random number."""
        return int(self.about["seed"])


@dataclass(frozen=True, slots=True)
class Side:
    """One version of a method: its runs, which differ in their seed alone."""

    name: str  # A or B
    repeats: tuple[Repeat, ...]

    @property
    def method(self) -> str:
        """The method's name, as replay was told."""
        return str(self.repeats[0].about["method"])

    @property
    def locator(self) -> dict[str, dict[str, Any]]:
        """Every stage and parameter."""
        return dict(self.repeats[0].about["locator"])

    def run(self, session: str) -> Run:
        """The first run's results of that session."""
        return self.repeats[0].sessions[session]


@dataclass(frozen=True, slots=True)
class Sides:
    """Both sides, cut down to what they have in common.

    Attributes:
        a: the reference.
        b: the candidate.
        sessions: the names of the sessions that every run has.
        left_out: sessions that only some of the runs have.
    """

    a: Side
    b: Side
    sessions: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether both are one run: the same method, seed, code and pictures."""
        left, right = ([_depends(r, self.sessions) for r in s.repeats] for s in (self.a, self.b))
        return left == right


def open_sides(a: str, b: str) -> Sides:
    """Find the runs of both sides.

    Args:
        a: a folder of results, or several with commas between: repeats with other seeds.
        b: the same.

    Raises:
        PomologError: no results; results that do not belong together; no session in common, or
            one whose recordings differ.
    """
    first, second = _side("A", a), _side("B", b)
    repeats = [*first.repeats, *second.repeats]
    everything = list(dict.fromkeys(name for r in repeats for name in r.sessions))
    common = tuple(n for n in everything if all(n in r.sessions for r in repeats))
    if not common:
        ours, theirs = (", ".join(sorted(s.repeats[0].sessions)) for s in (first, second))
        raise PomologError(
            f"no session is on both sides: A has {ours}; B has {theirs}; "
            "replay the same sessions on both"
        )
    for name in common:
        _check_same_recording(name, [r.sessions[name] for r in repeats])
    return Sides(first, second, common, tuple(n for n in everything if n not in common))


def _side(name: str, words: str) -> Side:
    whole = Path(words)
    folders = [whole] if whole.exists() else [Path(w.strip()) for w in words.split(",") if w]
    if not folders:
        raise PomologError(f"{name} names no folder; give results that pomolog replay -o made")
    side = Side(name, tuple(_repeat(folder) for folder in folders))
    for repeat in side.repeats[1:]:
        if _method_of(repeat.about) != _method_of(side.repeats[0].about):
            raise PomologError(
                f"{repeat.folder} is of method {repeat.about['method']} with other parameters or "
                f"code than {folders[0]}; repeats of one side may differ in their seed alone"
            )
    seeds = [repeat.seed for repeat in side.repeats]
    if len(set(seeds)) < len(seeds):
        raise PomologError(
            f"two repeats of {name} have seed {max(seeds, key=seeds.count)}, so they are one run; "
            "make another with: pomolog replay --seed N"
        )
    return side


def _repeat(folder: Path) -> Repeat:
    sessions: dict[str, Run] = {}
    for run in find_runs([folder]):
        name = str(run.about["session"]["name"])
        if name in sessions:
            raise PomologError(
                f"{folder} has results of session {name} twice: {sessions[name].folder} and "
                f"{run.folder}; give one of them"
            )
        sessions[name] = run
    first, *others = sessions.values()
    for other in others:
        same = ([*_method_of(r.about), r.about["seed"]] for r in (first, other))
        if len({json.dumps(one, sort_keys=True) for one in same}) > 1:
            raise PomologError(
                f"{folder} has results of several methods, seeds or versions "
                f"({first.folder.name}, {other.folder.name}); replay all sessions the same way"
            )
    return Repeat(folder, sessions)


def _method_of(about: dict[str, Any]) -> list[Any]:
    """What makes a version of the method: its stages, models, and the code."""
    return [about["locator"], about.get("models"), about["versions"]["source"]]


def _depends(repeat: Repeat, sessions: Sequence[str]) -> list[Any]:
    """All that the results of these sessions depend on."""
    prints = [repeat.sessions[n].about["session"]["fingerprint"] for n in sessions]
    return [_method_of(repeat.about), repeat.about["versions"], repeat.seed, prints]


def _check_same_recording(name: str, runs: Sequence[Run]) -> None:
    first = runs[0]
    for other in runs[1:]:
        if other.about["session"]["fingerprint"] != first.about["session"]["fingerprint"]:
            raise PomologError(
                f"session {name} is not the same recording in {first.folder} and {other.folder}: "
                "other pictures or other truth; replay one file on both sides"
            )
