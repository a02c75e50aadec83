"""Measure pairs of pictures: in slices, on all cores, each slice kept so that a killed run goes on.

A measurement is a function from one `Sample` to rows of plain numbers. Its rows are kept in a
file whose name is a hash of all that they depend on: the function, this program's source, the
session's fingerprint and the pairs of the slice.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import cv2

from processor.experiments.material import Source
from processor.pool import processes
from processor.slices import versions
from recorder.errors import PomologError
from recorder.files import write_text
from recorder.pictures import decode
from recorder.records import Labels, Picture, Side, StereoPair
from recorder.rectify import Rectification, rectify
from recorder.session import Session

SLICE_PAIRS: Final = 6  # some seconds of work: all that a killed run loses on a core
Row = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One stereo pair, decoded, with what is known of it.

    Attributes:
        session: its session's name.
        pair: as it was recorded.
        left: (H, W, 3) BGR as recorded.
        right: the same of the right camera.
        rectification: the rig's.
        settings: what notes say: exposure_ev, hung_mm.
        beam: origin and direction (3,) of the rangefinder in metres, or None.
    """

    session: str
    pair: StereoPair
    left: Picture
    right: Picture
    rectification: Rectification
    settings: dict[str, float]
    beam: tuple[Any, Any] | None

    def picture(self, side: Side) -> Picture:
        """The rectified picture of that side."""
        recorded = self.left if side == "left" else self.right
        return self.rectification.view(side).picture(recorded)

    def labels(self, side: Side) -> Labels | None:
        """The rectified truth labels of that side; None where there are none."""
        truth = self.pair.truth
        recorded = None if truth is None else truth.labels(side)
        return None if recorded is None else self.rectification.view(side).labels(recorded)

    @property
    def seed(self) -> tuple[int, int]:
        """(run seed, frame) of the random numbers."""
        return 0, self.pair.index


Measure = Callable[[Sample], list[Row]]
Tick = Callable[[int], None]


def samples(source: Source, places: Sequence[int] | None = None) -> Iterator[Sample]:
    """Decode pairs of a session, those of `places` (by default all that the source uses)."""
    settings = dict(zip(source.pairs, source.settings, strict=True))
    with Session(source.path) as session:
        rectification = rectify(session.rig)
        finder = session.rig.rangefinder
        beam = None if finder is None else (finder.origin_m, finder.direction)
        for place in source.pairs if places is None else places:
            for pair in session.pairs(place, place + 1):
                yield Sample(
                    session=source.name,
                    pair=pair,
                    left=decode(pair.left),
                    right=decode(pair.right),
                    rectification=rectification,
                    settings=settings.get(place, {}),
                    beam=beam,
                )


@dataclass(frozen=True, slots=True)
class _Job:
    measure: Measure
    source: Source
    places: tuple[int, ...]
    out: Path


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """Where measurements are made and kept.

    Attributes:
        folder: of the kept rows.
        pool: of processes; None measures here.
        tick: called with the number of pairs that are done.
        slice_pairs: what one process does at once, and a killed run loses.
    """

    folder: Path
    pool: ProcessPoolExecutor | None = None
    tick: Tick = lambda _: None
    slice_pairs: int = SLICE_PAIRS

    def rows(self, measure: Measure, sources: Sequence[Source]) -> list[Row]:
        """The rows of all pairs, in order; what was measured before is read."""
        jobs = list(self._jobs(measure, sources))
        todo = [job for job in jobs if not job.out.is_file()]
        self.tick(sum(len(job.places) for job in jobs if job not in todo))
        if self.pool is None:
            for job in todo:
                _run(job)
                self.tick(len(job.places))
        else:
            started = {self.pool.submit(_run, job): job for job in todo}
            try:
                for done in as_completed(started):
                    done.result()
                    self.tick(len(started[done].places))
            except BrokenProcessPool:
                raise PomologError(
                    "a worker was killed, perhaps for want of memory; run the same command again "
                    "with fewer --workers, it goes on"
                ) from None
            except BaseException:
                for future in started:
                    future.cancel()
                raise
        return [row for job in jobs for row in json.loads(job.out.read_text(encoding="utf-8"))]

    def clean(self, measure: Measure, sources: Sequence[Source]) -> None:
        """Throw away what was kept of other measurements than this one."""
        kept = {job.out for job in self._jobs(measure, sources)}
        for file in set(self.folder.glob("*.json")) - kept:
            file.unlink(missing_ok=True)

    def _jobs(self, measure: Measure, sources: Sequence[Source]) -> Iterator[_Job]:
        name = f"{measure.__module__.rpartition('.')[2]}-{measure.__name__}"
        for source in sources:
            for start in range(0, len(source.pairs), self.slice_pairs):
                places = source.pairs[start : start + self.slice_pairs]
                key = key_of(name, source.fingerprint, source.name, places)
                yield _Job(measure, source, places, self.folder / f"{name}-{key}.json")


@contextmanager
def open_bench(
    folder: Path, workers: int, tick: Tick = lambda _: None, slice_pairs: int = SLICE_PAIRS
) -> Iterator[Bench]:
    """A bench with so many processes; one measures in this process."""
    if workers <= 1:
        yield Bench(folder, None, tick, slice_pairs)
        return
    with processes(workers) as pool:
        yield Bench(folder, pool, tick, slice_pairs)


def _run(job: _Job) -> None:
    """Measure one slice and keep its rows."""
    cv2.setNumThreads(1)  # the workers are the parallelism, and one thread is repeatable
    rows: list[Row] = []
    for one in samples(job.source, job.places):
        about = {
            "session": one.session,
            "scene": job.source.scene,
            "split": job.source.split,
            "frame": one.pair.index,
            "lighting": one.pair.conditions.get("lighting", "not said"),
            "occlusion": one.pair.conditions.get("occlusion", "none"),
            **one.settings,
        }
        rows += [{**about, **row} for row in job.measure(one)]
    write_text(job.out, json.dumps(rows))


def key_of(*parts: object) -> str:
    """A short hash of what a result depends on, this program's source and libraries among it."""
    text = json.dumps([versions(), *map(repr, parts)])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def array_of(rows: Sequence[Row], key: str) -> list[float]:
    """The values of a column that are not None."""
    return [cast("float", row[key]) for row in rows if row.get(key) is not None]
