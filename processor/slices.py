"""The work of a replay, in pieces that any worker can do: a slice of a session, and a join.

A slice's rows and drawing are written as a part; a session's parts are joined in their order, so
that results do not depend on who did what, or when. Places may be in object storage.
"""

import hashlib
import platform
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter_ns
from typing import Final, Literal

import cv2

from processor.count import count_frame
from processor.locate import Locator
from processor.methods import to_toml
from processor.recordings import join_recordings
from processor.results import TABLES, Rows, join_tables, read_table, write_tables
from processor.rows import rows_of
from processor.trace import sensed_of
from recorder.errors import PomologError
from recorder.files import replacing
from recorder.objects import ObjectPath, Place
from recorder.pictures import decode
from recorder.rectify import rectify
from recorder.session import ImageTimes, Session

LEAST_MATCHES_TO_WARN: Final = 6  # fewer may all be wrong by chance
_LAST: Final = "frames.parquet"  # a part in object storage is whole once this is there
RrdChoice = Literal["full", "none"]
Tick = Callable[[int], None]


def no_tick(_: int) -> None:
    """Nobody wants to know how far it is."""


@dataclass(frozen=True, slots=True)
class Slice:
    """Some pairs of one session and how to replay them; small enough to send to a worker.

    Calling it writes its part; one that is there already is left alone.

    Raises:
        PomologError: the session is damaged or has changed, the part cannot be written, or the
            worker is of another version.
    """

    session: Place
    fingerprint: str  # of the session that was planned with
    image_times: ImageTimes
    start: int
    stop: int
    parts: Place  # where its part goes
    locator: Locator
    method: str  # its name
    seed: int
    rrd: RrdChoice
    versions: tuple[tuple[str, str], ...]  # results are those of one version alone

    def __str__(self) -> str:
        return f"pairs {self.start} to {self.stop - 1} of {self.session}"

    @property
    def pairs(self) -> int:
        """How many pairs it has."""
        return self.stop - self.start

    @property
    def part(self) -> Place:
        """The folder of its part."""
        return self.parts / f"{self.start:08d}-{self.stop:08d}"

    @property
    def done(self) -> bool:
        """Whether its part is there, whole."""
        part = self.part
        return (part / _LAST).is_file() if isinstance(part, ObjectPath) else part.is_dir()

    def __call__(self, tick: Tick = no_tick) -> None:
        """Replay the pairs."""
        if self.done:
            tick(self.pairs)
            return
        if versions() != self.versions:
            ours, theirs = dict(versions()), dict(self.versions)
            what = min(name for name in theirs if ours.get(name) != theirs[name])
            raise PomologError(
                f"worker {platform.node()} has {what} {ours.get(what)}, not {theirs[what]}; "
                "install the same on every worker"
            )
        cv2.setNumThreads(1)  # the workers are the parallelism, and one thread is repeatable
        try:
            with _new_folder(self.part) as folder:
                self._write(folder, tick)
        except PomologError:
            if not self.done:  # a worker that was thought dead may have been quicker
                raise

    def _write(self, folder: Path, tick: Tick) -> None:
        rows: Rows = {name: [] for name in TABLES}
        with Session(self.session, image_times=self.image_times) as session, ExitStack() as stack:
            if session.fingerprint != self.fingerprint:
                raise PomologError(f"{self.session} changed while it was replayed; run it again")
            rectification = rectify(session.rig)
            drawing = None
            if self.rrd == "full":
                from processor.rrd import RrdWriter

                drawing = stack.enter_context(
                    RrdWriter(
                        folder / "trace.rrd",
                        # methods side by side in one window or catalogue are told apart by it
                        f"{session.name}-{session.fingerprint}-{Path(self.method).stem}",
                        session.rig,
                        rectification,
                        first_ns=int(session.pair_times_ns()[0, 0]),
                        name=session.name,
                    )
                )
                if self.start == 0:
                    drawing.write_session(
                        session,
                        f"replayed with method {self.method}",
                        to_toml(self.method, self.locator),
                    )
            for pair in session.pairs(self.start, self.stop):
                before = perf_counter_ns()
                left, right = decode(pair.left), decode(pair.right)
                decode_ns = perf_counter_ns() - before
                sensed = sensed_of(pair, session.rig)
                trace = self.locator(left, right, rectification, (self.seed, pair.index), sensed)
                counts = count_frame(trace, pair.truth, rectification)
                new = rows_of(session.name, pair, trace, counts, rectification, decode_ns)
                for name, table in new.items():
                    rows[name].extend(table)
                if drawing is not None:
                    drawing.write(pair, trace, counts, decode_ns)
                tick(1)
            write_tables(folder, rows)


@dataclass(frozen=True, slots=True)
class Joined:
    """What a join found out."""

    digests: dict[str, str]  # table -> SHA-256 of its file
    warning: str | None  # what looks wrong with the session as a whole


@dataclass(frozen=True, slots=True)
class Join:
    """A session's parts, in order, and where their results go.

    Raises:
        PomologError: a part is not there or damaged, or the results cannot be written.
    """

    session: Place
    parts: tuple[Place, ...]
    out: Place
    rrd: RrdChoice

    def __str__(self) -> str:
        return f"the results of {self.session}"

    @property
    def pairs(self) -> int:
        """None: they are counted with their slices."""
        return 0

    def __call__(self, _: Tick = no_tick) -> Joined:
        """Join the parts."""
        with ExitStack() as stack:
            parts = [stack.enter_context(_here(part, self.rrd)) for part in self.parts]
            out = self.out
            if isinstance(out, ObjectPath):
                out = Path(stack.enter_context(TemporaryDirectory()))
            _join(parts, out, self.rrd)
            if isinstance(self.out, ObjectPath):
                for file in sorted(out.iterdir()):
                    (self.out / file.name).put(file)
            return Joined(table_digests(out), _warning(self.session, out))


def _join(parts: list[Path], out: Path, rrd: RrdChoice) -> None:
    join_tables(parts, out)
    trace = out / "trace.rrd"
    if rrd == "none":
        trace.unlink(missing_ok=True)  # an older run's drawing would not be of these results
        return
    with replacing(trace) as part:
        if len(parts) == 1:
            shutil.copyfile(parts[0] / "trace.rrd", part)  # a kill now must lose nothing
            return
        join_recordings([folder / "trace.rrd" for folder in parts], part)


@contextmanager
def _new_folder(place: Place) -> Iterator[Path]:
    """Give an empty local folder; it is at `place` afterwards, whole, or not at all."""
    if isinstance(place, Path):
        with replacing(place) as part:
            part.mkdir()
            yield part
        return
    with TemporaryDirectory() as folder:
        yield Path(folder)
        for file in sorted(Path(folder).iterdir(), key=lambda f: (f.name == _LAST, f.name)):
            (place / file.name).put(file)


@contextmanager
def _here(part: Place, rrd: RrdChoice) -> Iterator[Path]:
    """A part's folder on this machine."""
    if isinstance(part, Path):
        yield part
        return
    with TemporaryDirectory() as folder:
        names = [f"{name}.parquet" for name in TABLES]
        for name in [*names, *(["trace.rrd"] if rrd == "full" else [])]:
            (part / name).get(Path(folder) / name)
        yield Path(folder)


def table_digests(out: Place) -> dict[str, str]:
    """The SHA-256 of each table's file; of those that are not there, none."""
    files = {name: out / f"{name}.parquet" for name in TABLES}
    return {
        name: hashlib.sha256(file.read_bytes()).hexdigest()
        for name, file in files.items()
        if file.is_file()
    }


def _warning(session: Place, out: Path) -> str | None:
    """What looks wrong with a whole session, though no single frame can know it."""
    frames = read_table(out, "frames")
    matches, located = (sum(frames[name].to_pylist()) for name in ("matches", "matched"))
    if matches >= LEAST_MATCHES_TO_WARN and located < matches / 2:
        return (
            f"{matches - located} of {matches} matches in {session} have the fruit further right "
            "in the right view, which no apple can be; are the two views swapped?"
        )
    return None


@cache
def versions() -> tuple[tuple[str, str], ...]:
    """What results depend on beside the session and the method: libraries, Python, our source."""
    names = ("pomolog", "numpy", "opencv-python-headless", "scipy", "rerun-sdk")
    return (
        *((name, version(name)) for name in names),
        ("python", platform.python_version()),
        ("source", source_digest()),
    )


def source_digest() -> str:
    """A hash of our own code: who changes a stage and replays wants new results."""
    digest = hashlib.sha256()
    for package in ("recorder", "processor"):
        for file in sorted((Path(__file__).parent.parent / package).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
