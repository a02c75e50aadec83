"""Results read picture by picture: the sums that measures are made of, side by side."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from processor.columns import circle_columns
from processor.compare.sides import Sides
from processor.measures import COUNTED, MEASURED
from processor.results import STAGES, Row, read_table
from processor.runs import Run
from recorder.errors import PomologError
from recorder.rig import Floats

_COUNTS: Final = tuple(name for name in COUNTED if name.rpartition("_")[2] in ("tp", "fp", "fn"))

# table -> the columns read of it: a season has millions of rows
_READ: Final = {
    "frames": ["frame", "left_fruit", "right_fruit", "matched", *_COUNTS,
               *(f"{stage}_ns" for stage in STAGES)],
    "truth": ["frame", "apple_id", "found_left", "found_right", "match", "error_m"],
    "apples": ["frame", "left_truth", "right_truth", "x_m", "y_m", "z_m",
               *circle_columns("left"), *circle_columns("right")],
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """One run's results of one session.

    Attributes:
        session: its name.
        frames: a row a pair of pictures, in their order.
        truth: a row a true apple.
        apples: a row a located apple.
    """

    session: str
    frames: list[Row]
    truth: list[Row]
    apples: list[Row]


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Both sides' sums, picture by picture.

    Attributes:
        keys: (session, frame) of each picture.
        a: column -> (P,), means over A's repeats; NaN where nobody counted.
        b: the same of B.
        runs_a: the same of each run of A alone, errors over all fruit that it located.
        runs_b: the same of B's.
        has_truth: whether any picture has truth.
        time_ms: what each picture of A's runs and of B's took to locate, without decoding.
    """

    keys: list[tuple[str, int]]
    a: dict[str, Floats]
    b: dict[str, Floats]
    runs_a: list[dict[str, Floats]]
    runs_b: list[dict[str, Floats]]
    has_truth: bool
    time_ms: tuple[Floats, Floats]


def read_results(session: str, run: Run) -> Results:
    """Read one session's tables.

    Raises:
        PomologError: a table is missing or damaged, or speaks of pictures that are not there.
    """
    tables = {
        name: read_table(run.folder, name).select(columns).to_pylist()
        for name, columns in _READ.items()
    }
    places = {row["frame"] for row in tables["frames"]}
    for name in ("truth", "apples"):
        strange = {row["frame"] for row in tables[name]} - places
        if strange:
            raise PomologError(
                f"{run.folder}/{name}.parquet has pair {min(map(str, strange))}, frames.parquet "
                "has not; replay it again"
            )
    if len(places) < len(tables["frames"]):
        raise PomologError(f"{run.folder}/frames.parquet has a pair twice; replay it again")
    return Results(session, **tables)


def each_session(sides: Sides) -> Iterator[tuple[list[Results], list[Results]]]:
    """Session after session: the results of A's runs and of B's, of the same pictures.

    Raises:
        PomologError: the runs of one session speak of different pictures.
    """
    for session in sides.sessions:
        both = [
            [read_results(session, repeat.sessions[session]) for repeat in side.repeats]
            for side in (sides.a, sides.b)
        ]
        places = [[row["frame"] for row in run.frames] for side in both for run in side]
        if any(other != places[0] for other in places[1:]):
            raise PomologError(
                f"the results of session {session} are not of the same pairs; replay it again"
            )
        yield both[0], both[1]


def picture_sums(results: Results) -> dict[str, Floats]:
    """The sums of one run's pictures, its errors over all fruit that it located."""
    sums = {name: _column(results.frames, name) for name in _COUNTS}
    sums["pairs"] = np.ones(len(results.frames))
    sums["circles"] = _column(results.frames, "left_fruit") + _column(results.frames, "right_fruit")
    sums["located"] = _column(results.frames, "matched")
    place = places_of(results)
    for verdict in ("right", "wrong", "missed"):
        frames = (row["frame"] for row in results.truth if row["match"] == verdict)
        sums[verdict] = tally(place, ((frame, 1.0) for frame in frames))
    errors = errors_of(results)
    sums |= error_sums(place, errors, errors)
    sums["distance_m"] = np.zeros(len(results.frames))
    return sums


def places_of(results: Results) -> dict[int, int]:
    """Frame -> its place among the pictures."""
    return {row["frame"]: place for place, row in enumerate(results.frames)}


def errors_of(results: Results) -> dict[tuple[int, int], tuple[float, float]]:
    """(frame, apple) -> its error and its square, of each true apple that was located."""
    return {
        (row["frame"], row["apple_id"]): (row["error_m"], row["error_m"] ** 2)
        for row in results.truth
        if row["error_m"] is not None
    }


def error_sums(
    place: Mapping[int, int],
    errors: Mapping[tuple[int, int], tuple[float, float]],
    chosen: Iterable[tuple[int, int]],
) -> dict[str, Floats]:
    """The sums of the chosen fruit's errors, picture by picture."""
    listed = list(chosen)
    return {
        "errors": tally(place, ((frame, 1.0) for frame, _ in listed)),
        "error_m": tally(place, ((key[0], errors[key][0]) for key in listed)),
        "error2_m2": tally(place, ((key[0], errors[key][1]) for key in listed)),
    }


def tally(place: Mapping[int, int], values: Iterable[tuple[int, float]]) -> Floats:
    """Add (frame, value)s up by picture."""
    total = np.zeros(len(place))
    for frame, value in values:
        total[place[frame]] += value
    return total


def _column(rows: Sequence[Row], name: str) -> Floats:
    return np.array([np.nan if row[name] is None else row[name] for row in rows], float)


def mean_errors(runs: Sequence[Results]) -> dict[tuple[int, int], tuple[float, float]]:
    """(frame, apple) -> mean error and mean square, over the repeats that located it."""
    found: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for run in runs:
        for key, error in errors_of(run).items():
            found.setdefault(key, []).append(error)
    return {
        key: (sum(e for e, _ in values) / len(values), sum(s for _, s in values) / len(values))
        for key, values in found.items()
    }


def means(runs: Sequence[Mapping[str, Floats]]) -> dict[str, Floats]:
    """Column by column the mean over repeats."""
    return {name: np.mean([run[name] for run in runs], axis=0) for name in COUNTED}


def locate_ms(runs: Iterable[Results]) -> Floats:
    """The time of all stages but decoding, of each picture of all runs."""
    stages = [f"{stage}_ns" for stage in STAGES if stage != "decode"]
    return np.array([sum(row[s] or 0 for s in stages) / 1e6 for run in runs for row in run.frames])


def joined(parts: Sequence[Mapping[str, Floats]]) -> dict[str, Floats]:
    """Sessions' columns, one after another."""
    return {name: np.concatenate([part[name] for part in parts]) for name in (*COUNTED, *MEASURED)}
