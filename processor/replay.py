"""Replay sessions through a locator: sessions -> slices -> parts -> results.

The work is (session, slice of its pairs), of all sessions together; `processor.slices` does it,
`processor.workers` says where. A run that was killed goes on with the slices that are missing.
"""

import hashlib
import json
import os
import shutil
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Final

from processor.locate import Locator
from processor.methods import describe, models_of
from processor.results import TABLES
from processor.run_file import RESULTS_PROFILE, read_run, run_text
from processor.slices import Join, Joined, RrdChoice, Slice, Tick, no_tick, table_digests, versions
from processor.workers import Job, Result, hire
from recorder.errors import PomologError
from recorder.files import only_writer, writable, write_text
from recorder.objects import ObjectPath, Place
from recorder.rectify import rectify
from recorder.session import Session

SLICE_PAIRS: Final = 32  # a slice is lost when a run is killed; a pair takes about 0.1 s


@dataclass(frozen=True, slots=True)
class Replayed:
    """What became of one session."""

    session: Place
    out: Any  # a Path, or an ObjectPath where the caller gave one
    pairs: int
    seconds: float  # from its first slice to its results; other sessions' work may lie between
    resumed: bool  # its results were there already
    warning: str | None = None  # what looks wrong with the session as a whole


Outcome = Replayed | PomologError


def replay(
    sessions: Sequence[Place],
    out: Place,
    locator: Locator,
    *,
    method: str = "paper",
    seed: int = 0,
    workers: int = 1,
    cluster: str = "",
    rrd: RrdChoice = "full",
    tick: Tick = no_tick,
) -> Iterator[Outcome]:
    """Replay sessions; give what became of each, in their order.

    Args:
        sessions: files or objects of different names.
        out: gets a folder for each session.
        locator: the method.
        method: its name, kept in run.json.
        seed: of every random number.
        workers: processes; 1 replays here.
        cluster: the address of a Dask scheduler whose workers do it instead.
        rrd: draw recordings, or not.
        tick: called with the number of pairs that are done.

    Yields:
        For each session its result, or the error that stopped it; the rest go on.

    Raises:
        PomologError: two sessions have one name, one has a name that no folder can have, or no
            cluster answers.
    """
    names = [path.stem for path in sessions]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise PomologError(f"two sessions are named {min(twice)}; rename one, or use two --out")
    if {"", ".", ".."} & set(names):  # "...mcap" would write beside the output folder
        bad = next(path for path in sessions if path.stem in ("", ".", ".."))
        raise PomologError(f"{bad} has no name for its results; rename it")
    if cluster:  # its workers have working directories of their own
        sessions = [p.absolute() if isinstance(p, Path) else p for p in sessions]
        out = out.absolute() if isinstance(out, Path) else out
    with hire(workers, cluster, tick) as crew:
        waiting = deque(
            _Run(path, out / path.stem, locator, method, seed, rrd, tick) for path in sessions
        )
        begun: deque[_Run] = deque()
        try:
            while waiting or begun:
                while begun and (outcome := begun[0].outcome) is not None:
                    begun.popleft()
                    yield outcome
                while crew.room > 0 and (job := _next_job(begun, waiting)):
                    crew.submit(job)
                if any(run.under_way for run in begun):
                    job, result = crew.next_done()
                    next(run for run in begun if run.owns(job)).take(job, result)
        finally:
            for run in begun:
                run.close()


def useful_workers(pairs: Sequence[int]) -> int:
    """As many as there are cores, or slices if they are fewer.

    For a single slice that is this process: it starts at once, and tells of each pair.

    Args:
        pairs: how many each session has.
    """
    slices = sum(-(-count // SLICE_PAIRS) for count in pairs)
    return max(1, min(os.cpu_count() or 1, slices))


def _next_job(begun: "deque[_Run]", waiting: "deque[_Run]") -> Job | None:
    """The next job of the earliest session that has one; sessions are opened as they are needed."""
    for run in begun:
        if run.jobs:
            return run.start_job()
    while waiting:
        begun.append(waiting.popleft())
        begun[-1].begin()
        if begun[-1].jobs:
            return begun[-1].start_job()
        if begun[0].outcome is not None:
            return None  # it can be told at once
    return None


class _Run:
    """One session on its way to results: planned, sliced, joined, described."""

    def __init__(
        self,
        path: Place,
        out: Place,
        locator: Locator,
        method: str,
        seed: int,
        rrd: RrdChoice,
        tick: Tick,
    ) -> None:
        self._path, self._out, self._rrd, self._tick = path, out, rrd, tick
        self._locator, self._method, self._seed = locator, method, seed
        self._about: dict[str, Any] = {}
        self._slices: list[Slice] = []
        self._missing = 0  # slices that are not done
        self._parts: Place = out
        self._lock = ExitStack()
        self._started = perf_counter()
        self._failures: list[tuple[int, PomologError]] = []  # where in the session, what
        self.jobs: deque[Job] = deque()
        self.under_way = 0
        self.outcome: Outcome | None = None

    def owns(self, job: Job) -> bool:
        """Whether a job is of this session."""
        return job.session == self._path

    def begin(self) -> None:
        """Open the session and plan its slices, unless its results are there."""
        self._started = perf_counter()
        try:
            self._plan()
        except PomologError as error:
            self.close()
            self.outcome = error

    def _plan(self) -> None:
        with Session(self._path) as session:
            session.require_pairs()
            rig = session.rig
            pairs, times, fingerprint = len(session), session.image_times, session.fingerprint
            self._about = _description(session, self._locator, self._method, self._seed, self._rrd)
        rectify(rig)  # a rig that cannot be used is said before anything is written
        if _done(self._out, self._about):
            self._tick(pairs)
            seconds = perf_counter() - self._started
            self.outcome = Replayed(self._path, self._out, pairs, seconds, resumed=True)
            return
        self._parts = self._out / f".parts-{self._about['key']}"
        if isinstance(self._out, Path):
            with writable(self._out):
                self._out.mkdir(parents=True, exist_ok=True)
            self._lock.enter_context(only_writer(self._out))
        _clear(self._out, self._parts)
        self._slices = [
            Slice(
                self._path, fingerprint, times, start, min(start + SLICE_PAIRS, pairs),
                self._parts, self._locator, self._method, self._seed, self._rrd, versions(),
            )
            for start in range(0, pairs, SLICE_PAIRS)
        ]  # fmt: skip
        self._missing = len(self._slices)
        self.jobs.extend(self._slices)

    def start_job(self) -> Job:
        """Take the next job."""
        self.under_way += 1
        return self.jobs.popleft()

    def take(self, job: Job, result: Result) -> None:
        """What became of a job: more work, the end, or the end of this session."""
        self.under_way -= 1
        try:
            if isinstance(result, PomologError):
                self._failures.append((job.start if isinstance(job, Slice) else 0, result))
                self.jobs.clear()
            elif isinstance(result, Joined):
                self._finish(result)
            else:
                self._missing -= 1
                if not self._missing:
                    parts = tuple(piece.part for piece in self._slices)
                    self.jobs.append(Join(self._path, parts, self._out, self._rrd))
        except PomologError as error:
            self._failures.append((0, error))
        if self._failures and not self.under_way:
            self.close()
            self.outcome = min(self._failures, key=lambda failure: failure[0])[1]

    def _finish(self, joined: Joined) -> None:
        seconds = perf_counter() - self._started
        # where it lay is for who wants to see a frame again; the results don't depend on it
        path = self._path.resolve() if isinstance(self._path, Path) else self._path
        told = {**self._about, "path": str(path), "seconds": round(seconds, 3)}
        text = run_text({**told, "tables": joined.digests})
        if isinstance(self._out, ObjectPath):
            (self._out / "run.json").write_bytes(text.encode())
        else:
            write_text(self._out / "run.json", text)
        _remove(self._parts)
        self.close()
        self.outcome = Replayed(
            self._path, self._out, self._about["session"]["pairs"], seconds,
            resumed=False, warning=joined.warning,
        )  # fmt: skip

    def close(self) -> None:
        """Let go of the output folder."""
        self._lock.close()


def _clear(out: Place, parts: Place) -> None:
    """Take away what a killed run, or one of another method, left in an output folder."""
    if isinstance(out, ObjectPath):
        stale = [one for one in out.below() if f"{out}/.parts-" in str(one)]
        for one in stale:
            if not str(one).startswith(f"{parts}/"):
                one.unlink()
        (out / "run.json").unlink()
        return
    assert isinstance(parts, Path)
    with writable(out):
        for old in out.glob(".parts-*"):
            if old != parts:
                shutil.rmtree(old)
        for unfinished in out.glob("*.part"):  # a killed run was joining its parts
            unfinished.unlink()
        parts.mkdir(exist_ok=True)
        (out / "run.json").unlink(missing_ok=True)  # what it spoke of is about to change


def _remove(parts: Place) -> None:
    if isinstance(parts, Path):
        shutil.rmtree(parts)
        return
    for one in parts.below():
        one.unlink()


def _description(
    session: Session, locator: Locator, method: str, seed: int, rrd: RrdChoice
) -> dict[str, Any]:
    """What run.json says; `key` is a hash of all that the results depend on."""
    run = {
        "profile": RESULTS_PROFILE,
        "method": method,
        "locator": describe(locator),
        "models": models_of(locator),
        "seed": seed,
        "rrd": rrd,
        "session": {
            "name": session.name,
            "file": session.path.name,
            "fingerprint": session.fingerprint,
            "pairs": len(session),
            "metadata": session.metadata,
            "ledger": session.ledger,
        },
        "versions": dict(versions()),
    }
    key = hashlib.sha256(json.dumps(run, sort_keys=True).encode()).hexdigest()[:12]
    return {**run, "key": key}


def _done(out: Place, run: dict[str, Any]) -> bool:
    """Whether `out` already has the results of exactly this run, undamaged."""
    path = out / "run.json"
    try:
        if not path.is_file() or (found := read_run(path)).get("key") != run["key"]:
            return False
    except PomologError:
        return False  # damaged, or of another version
    whole = run["rrd"] == "none" or (out / "trace.rrd").is_file()
    tables = found.get("tables", {})
    return whole and len(tables) == len(TABLES) and tables == table_digests(out)
