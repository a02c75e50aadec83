"""One frame of a run, located again: what the results say, with every intermediate beside it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from processor.columns import circle_columns
from processor.count import FrameCounts, count_frame
from processor.locate import Locator
from processor.methods import locator_from, models_of
from processor.results import Row, read_table
from processor.rows import rows_of
from processor.runs import Run
from processor.trace import Trace, sensed_of
from recorder.errors import PomologError
from recorder.pictures import decode
from recorder.records import StereoPair
from recorder.rectify import Rectification, rectify
from recorder.session import Session

SAME_PX = 0.05  # of circles: another machine's arithmetic moves them by less


@dataclass(frozen=True, slots=True, eq=False)
class Retraced:
    """One frame of a run, with all that was recorded, found and counted of it."""

    pair: StereoPair
    trace: Trace
    counts: FrameCounts
    rectification: Rectification
    apples: tuple[Row, ...]  # as in the run's apples.parquet
    truth: tuple[Row, ...]  # as in its truth.parquet


def session_of(run: Run, moved: Sequence[Path] = (), *, or_where_it_lay: bool = True) -> Path:
    """The file that a run was made of, as it was then.

    Args:
        run: the run.
        moved: files or folders where it may lie now.
        or_where_it_lay: look there too.

    Raises:
        PomologError: it is not there, or it is another one by now.
    """
    told = run.about["session"]
    lay = Path(run.about.get("path") or told["file"])
    places = [path / told["file"] if path.is_dir() else path for path in moved]
    places += [lay] if or_where_it_lay else []
    there = [path for path in places if path.is_file()]
    if not there:
        raise PomologError(
            f"the session of {run.folder} is not at {places[0]}; "
            "say where it lies now: --session FILE"
        )
    for path in there:
        with Session(path) as session:
            if session.fingerprint == told["fingerprint"]:
                return path
    raise PomologError(
        f"{there[0]} is not the session that {run.folder} was made of, or has changed since; "
        "name the right one with --session FILE, or replay this one again"
    )


def locator_of(run: Run) -> Locator:
    """The method that a run was made with, every parameter as it was.

    Raises:
        PomologError: a model of it is gone, or has learned something else since.
    """
    locator = locator_from(run.about["locator"])
    for name, digest in models_of(locator).items():
        then = run.about["models"].get(name)
        if digest != then:
            raise PomologError(
                f"model {name} is not the one that {run.folder} was made with "
                f"({digest}, then {then}); replay it again"
            )
    return locator


def retrace(run: Run, frame: int, moved: Sequence[Path] = ()) -> Retraced:
    """Locate one frame again, with the run's method and seed.

    Args:
        run: the run.
        frame: which pair of its session.
        moved: where the session lies now; empty: where it lay.

    Raises:
        PomologError: the session or a model is gone or changed, there is no such frame, or this
            version of the code finds something else than the run did.
    """
    pairs = run.about["session"]["pairs"]
    if not 0 <= frame < pairs:
        raise PomologError(
            f"no frame {frame} in {run.folder}; "
            + ("its only frame is 0" if pairs == 1 else f"it has frames 0 to {pairs - 1}")
        )
    path = session_of(run, moved, or_where_it_lay=not moved)
    locator = locator_of(run)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # as the run did: one thread is repeatable
    try:
        with Session(path) as session:
            rectification = rectify(session.rig)
            (pair,) = session.pairs(frame, frame + 1)
        seed = (run.about["seed"], frame)
        pictures = decode(pair.left), decode(pair.right)
        trace = locator(*pictures, rectification, seed, sensed_of(pair, session.rig))
    finally:
        cv2.setNumThreads(threads)
    counts = count_frame(trace, pair.truth, rectification)
    rows = rows_of(run.about["session"]["name"], pair, trace, counts, rectification, 0)
    apples, truth = (rows_of_frame(run.folder, table, frame) for table in ("apples", "truth"))
    if not _same(apples, rows["apples"]):
        raise PomologError(
            f"frame {frame} of {run.folder} comes out otherwise with this version of pomolog "
            f"than when it was replayed; replay {path} again"
        )
    return Retraced(pair, trace, counts, rectification, apples, truth)


def rows_of_frame(folder: Path, table: str, frame: int) -> tuple[Row, ...]:
    """The rows of one frame of a run's table."""
    found = read_table(folder, table)  # its frames are in order
    start, stop = np.searchsorted(found["frame"].to_numpy(), [frame, frame + 1]).tolist()
    return tuple(found.slice(start, stop - start).to_pylist())


def _same(told: tuple[Row, ...], found: list[Row]) -> bool:
    names = (*circle_columns("left"), *circle_columns("right"))
    return len(told) == len(found) and all(
        _close(before.get(name), now.get(name))
        for before, now in zip(told, found, strict=True)
        for name in names
    )


def _close(before: Any, now: Any) -> bool:
    if before is None or now is None:
        return before is now
    return math.isclose(before, now, rel_tol=0, abs_tol=SAME_PX)
