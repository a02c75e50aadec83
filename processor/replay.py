"""Replay sessions through a locator: traces -> rows and recordings, in slices that can resume.

The work is (session, slice of its pairs). A slice's rows and drawing are written as parts and
joined in order, so that the results do not depend on the number of workers, and a run that was
killed goes on with the slices that are missing.
"""

import hashlib
import json
import platform
import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, perf_counter_ns
from typing import Any, Final, Literal

import cv2

from processor.count import count_frame
from processor.locate import Locator
from processor.methods import describe, models_of, to_toml
from processor.pool import processes
from processor.recordings import join_recordings
from processor.results import TABLES, Rows, join_tables, read_table, rows_of, write_tables
from processor.trace import sensed_of
from recorder.errors import PomologError
from recorder.files import only_writer, replacing, writable
from recorder.pictures import decode
from recorder.rectify import rectify
from recorder.session import Session

SLICE_PAIRS: Final = 32  # a slice is lost when a run is killed; a pair takes about 0.1 s
LEAST_MATCHES_TO_WARN: Final = 6  # fewer may all be wrong by chance
RESULTS_PROFILE: Final = "pomolog-results/1"
RrdChoice = Literal["full", "none"]

Tick = Callable[[int], None]


@dataclass(frozen=True, slots=True)
class Job:
    """A slice of one session and how to replay it; small enough to send to a worker."""

    session: Path
    start: int
    stop: int
    parts: Path  # where its part goes
    locator: Locator
    method: str  # its name
    seed: int
    rrd: RrdChoice

    @property
    def part(self) -> Path:
        """The folder of this slice's part; it exists when the slice is done."""
        return self.parts / f"{self.start:08d}-{self.stop:08d}"


@dataclass(frozen=True, slots=True)
class Replayed:
    """What became of one session."""

    session: Path
    out: Path
    pairs: int
    seconds: float
    resumed: bool  # its results were there already
    warning: str | None = None  # what looks wrong with the session as a whole


def replay(
    sessions: Sequence[Path],
    out: Path,
    locator: Locator,
    *,
    method: str = "paper",
    seed: int = 0,
    workers: int = 1,
    rrd: RrdChoice = "full",
    tick: Tick = lambda _: None,
) -> Iterator[Replayed | PomologError]:
    """Replay sessions one after another; give what became of each.

    Args:
        sessions: files of different names.
        out: gets a folder for each session.
        locator: the method.
        method: its name, kept in run.json.
        seed: of every random number.
        workers: processes; 1 replays here.
        rrd: draw recordings, or not.
        tick: called with the number of pairs that are done.

    Yields:
        For each session its result, or the error that stopped it; the rest go on.

    Raises:
        PomologError: two sessions have one name.
    """
    names = [path.stem for path in sessions]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise PomologError(f"two sessions are named {min(twice)}; rename one, or use two --out")
    with ExitStack() as stack:
        pool = None
        if workers > 1:
            pool = stack.enter_context(processes(workers))
        for path in sessions:
            try:
                yield _replay_session(path, out / path.stem, locator, method, seed, pool, rrd, tick)
            except PomologError as error:
                yield error
            except BrokenProcessPool:
                yield PomologError(
                    f"a worker on {path} was killed, perhaps for want of memory; "
                    "run the same command again with fewer --workers, it goes on"
                )


def _replay_session(
    path: Path,
    out: Path,
    locator: Locator,
    method: str,
    seed: int,
    pool: ProcessPoolExecutor | None,
    rrd: RrdChoice,
    tick: Tick,
) -> Replayed:
    started = perf_counter()
    with Session(path) as session:
        pairs = len(session)
        session.require_pairs()
        rig = session.rig
        run = _description(session, locator, method, seed, rrd)
    rectify(rig)  # a rig that cannot be used is said before anything is written
    if _done(out, run):
        tick(pairs)
        return Replayed(path, out, pairs, perf_counter() - started, resumed=True)
    with writable(out):
        out.mkdir(parents=True, exist_ok=True)
    with only_writer(out):
        parts = _write_results(path, out, run, locator, pool, tick)
        seconds = perf_counter() - started
        with replacing(out / "run.json") as part:
            # where it lay is for who wants to see a frame again; the results don't depend on it
            told = {**run, "path": str(path.resolve()), "seconds": round(seconds, 3)}
            part.write_text(json.dumps(told, indent=2) + "\n")
        shutil.rmtree(parts)
    return Replayed(path, out, pairs, seconds, resumed=False, warning=_warning(path, out))


def _write_results(
    path: Path,
    out: Path,
    run: dict[str, Any],
    locator: Locator,
    pool: ProcessPoolExecutor | None,
    tick: Tick,
) -> Path:
    """Replay the slices that are missing, and join all of them; give the folder of the parts."""
    pairs, rrd = run["session"]["pairs"], run["rrd"]
    parts = out / f".parts-{run['key']}"
    with writable(out):
        for stale in out.glob(".parts-*"):
            if stale != parts:
                shutil.rmtree(stale)
        for unfinished in out.glob("*.part"):  # a killed run was joining its parts
            unfinished.unlink()
        parts.mkdir(exist_ok=True)
        (out / "run.json").unlink(missing_ok=True)  # what it spoke of is about to change
    jobs = [
        Job(
            path,
            start,
            min(start + SLICE_PAIRS, pairs),
            parts,
            locator,
            run["method"],
            run["seed"],
            rrd,
        )
        for start in range(0, pairs, SLICE_PAIRS)
    ]
    if pool is None:
        for job in jobs:
            run_slice(job, tick)
    else:
        for job, _ in zip(jobs, pool.map(run_slice, jobs), strict=True):
            tick(job.stop - job.start)
    _join(jobs, out, rrd)
    return parts


def _warning(path: Path, out: Path) -> str | None:
    """What looks wrong with a whole session, though no single frame can know it."""
    frames = read_table(out, "frames")
    matches, located = (sum(frames[name].to_pylist()) for name in ("matches", "matched"))
    if matches >= LEAST_MATCHES_TO_WARN and located < matches / 2:
        return (
            f"{matches - located} of {matches} matches in {path} have the fruit further right in "
            "the right view, which no apple can be; are the two views swapped?"
        )
    return None


def _description(
    session: Session, locator: Locator, method: str, seed: int, rrd: RrdChoice
) -> dict[str, Any]:
    """What run.json says; `key` is a hash of all that the results depend on."""
    versions = {
        name: version(name)
        for name in ("pomolog", "numpy", "opencv-python-headless", "scipy", "rerun-sdk")
    }
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
        "versions": {**versions, "python": platform.python_version(), "source": _source_digest()},
    }
    key = hashlib.sha256(json.dumps(run, sort_keys=True).encode()).hexdigest()[:12]
    return {**run, "key": key}


@cache
def _source_digest() -> str:
    """A hash of our own code: who changes a stage and replays wants new results."""
    digest = hashlib.sha256()
    for package in ("recorder", "processor"):
        for file in sorted((Path(__file__).parent.parent / package).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def _done(out: Path, run: dict[str, Any]) -> bool:
    """Whether `out` already has the results of exactly this run."""
    try:
        found = json.loads((out / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    wanted = [f"{name}.parquet" for name in TABLES]
    wanted += ["trace.rrd"] if run["rrd"] == "full" else []
    return bool(
        isinstance(found, dict)
        and found.get("key") == run["key"]
        and all((out / name).is_file() for name in wanted)
    )


def run_slice(job: Job, tick: Tick = lambda _: None) -> None:
    """Replay one slice into its part; one that is there already is left alone.

    Raises:
        PomologError: the session is damaged, or the part cannot be written.
    """
    cv2.setNumThreads(1)  # the workers are the parallelism, and one thread is repeatable
    if job.part.is_dir():
        tick(job.stop - job.start)
        return
    rows: Rows = {name: [] for name in TABLES}
    with replacing(job.part) as part, Session(job.session) as session, ExitStack() as stack:
        part.mkdir()
        rectification = rectify(session.rig)
        drawing = None
        if job.rrd == "full":
            from processor.rrd import RrdWriter

            drawing = stack.enter_context(
                RrdWriter(
                    part / "trace.rrd",
                    # methods side by side in one window or catalogue are told apart by it
                    f"{session.name}-{session.fingerprint}-{Path(job.method).stem}",
                    session.rig,
                    rectification,
                    first_ns=int(session.pair_times_ns()[0, 0]),
                    name=session.name,
                )
            )
            if job.start == 0:
                drawing.write_session(
                    session,
                    f"replayed with method {job.method}",
                    to_toml(job.method, job.locator),
                )
        for pair in session.pairs(job.start, job.stop):
            before = perf_counter_ns()
            left, right = decode(pair.left), decode(pair.right)
            decode_ns = perf_counter_ns() - before
            sensed = sensed_of(pair, session.rig)
            trace = job.locator(left, right, rectification, (job.seed, pair.index), sensed)
            counts = count_frame(trace, pair.truth, rectification)
            new = rows_of(session.name, pair, trace, counts, rectification, decode_ns)
            for name, table in new.items():
                rows[name].extend(table)
            if drawing is not None:
                drawing.write(pair, trace, counts, decode_ns)
            tick(1)
        write_tables(part, rows)


def _join(jobs: Sequence[Job], out: Path, rrd: RrdChoice) -> None:
    join_tables([job.part for job in jobs], out)
    trace = out / "trace.rrd"
    if rrd == "none":
        trace.unlink(missing_ok=True)  # an older run's drawing would not be of these results
        return
    with replacing(trace) as part:
        if len(jobs) == 1:
            shutil.copyfile(jobs[0].part / "trace.rrd", part)  # a kill now must lose nothing
            return
        join_recordings([job.part / "trace.rrd" for job in jobs], part)
