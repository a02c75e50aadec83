"""The comparison itself: read both sides, sum, judge, and say what became of each fruit."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from processor.compare.changes import MOVED_M, Change, Tally, changes, distance_sums
from processor.compare.judge import Judged, judge
from processor.compare.pictures import (
    Pictures,
    Results,
    each_session,
    error_sums,
    joined,
    locate_ms,
    mean_errors,
    means,
    picture_sums,
    places_of,
)
from processor.compare.sides import Sides
from processor.measures import WITH_TRUTH, WITHOUT_TRUTH, Floats, Measure
from processor.paired import Places, differences, seed_std
from recorder.errors import PomologError

Unit = Literal["pair", "session"]

ALIKE: Final = 1.5  # intervals so much wider by session say that a session's pairs are alike
LEAST_SESSIONS: Final = 6  # fewer say nothing about how much sessions differ


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """B held against A.

    Attributes:
        sides: what was compared.
        unit: what counts as independent.
        pairs: of pictures that both have.
        judged: the measures, with truth or without.
        tally: what became of the fruit, from A's first run to B's.
        changes: fruit by fruit.
        by_seed: the same from A's first run to its second: what the seed alone changes; None with
            one run.
        false: circles where no fruit is, of A and B (means over repeats); None: nobody can know.
        time_ms: the median time to locate, of A and B.
        notes: what a reader must know, a sentence each.
    """

    sides: Sides
    unit: Unit
    pairs: int
    judged: tuple[Judged, ...]
    tally: Tally
    changes: tuple[Change, ...]
    by_seed: Tally | None
    false: tuple[float, float] | None
    time_ms: tuple[float, float]
    notes: tuple[str, ...]


def compare(
    sides: Sides,
    *,
    unit: Unit = "pair",
    moved_m: float = MOVED_M,
    matters: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Comparison:
    """Compare two sides, picture by picture.

    Args:
        sides: what `open_sides` found.
        unit: what counts as independent: each pair of pictures, or each session as a whole.
        moved_m: fruit further apart than this have moved.
        matters: measure -> smallest difference of interest, where it is not the measure's own.
        seed: of the bootstrap.

    Raises:
        PomologError: results are damaged, or some have truth and some have not.
    """
    parts: list[Pictures] = []
    kept: list[Change] = []
    total, by_seed = Tally(), Tally()
    for a, b in each_session(sides):
        parts.append(read_pictures(a, b))
        counted, found = changes(a[0], b[0], moved_m)
        total += counted
        kept += found
        if len(a) > 1:
            by_seed += changes(a[0], a[1], moved_m)[0]
    pictures = _together(parts)
    measures = WITH_TRUTH if pictures.has_truth else WITHOUT_TRUTH
    judged = judge_pictures(pictures, measures, unit, matters or {}, seed)
    if sides.same or _identical(judged):
        judged = [_equal(one) for one in judged]
    return Comparison(
        sides=sides,
        unit=unit,
        pairs=len(pictures.keys),
        judged=tuple(judged),
        tally=total,
        changes=tuple(kept),
        by_seed=by_seed if len(sides.a.repeats) > 1 else None,
        false=_false(pictures),
        time_ms=(float(np.median(pictures.time_ms[0])), float(np.median(pictures.time_ms[1]))),
        notes=tuple(_notes(sides, pictures, judged, unit, seed)),
    )


def read_pictures(a: Sequence[Results], b: Sequence[Results]) -> Pictures:
    """One session's sums: A's runs and B's, of the same pictures."""
    place = places_of(a[0])
    runs = [[picture_sums(run) for run in side] for side in (a, b)]
    truth = any(row["fruit_tp"] is not None or row["pixels_tp"] is not None for row in a[0].frames)
    sums = [means(side) for side in runs]
    if truth:
        errors = [mean_errors(side) for side in (a, b)]
        both = [key for key in errors[0] if key in errors[1]]
        nothing = {"distance_m": np.zeros(len(place))}
        measured = [error_sums(place, side, both) | nothing for side in errors]
    else:
        measured = _paired_distances(a, b)
    return Pictures(
        keys=[(a[0].session, row["frame"]) for row in a[0].frames],
        a=sums[0] | measured[0],
        b=sums[1] | measured[1],
        runs_a=runs[0],
        runs_b=runs[1],
        has_truth=truth,
        time_ms=(locate_ms(a), locate_ms(b)),
    )


def _paired_distances(a: Sequence[Results], b: Sequence[Results]) -> list[dict[str, Floats]]:
    """Distances of fruit that both located, run by run in their order, averaged over the runs."""
    summed = [distance_sums(one, other) for one, other in zip(a, b, strict=False)]
    nothing = dict.fromkeys(("error_m", "error2_m2"), np.zeros(len(a[0].frames)))
    return [
        {name: np.mean([pair[number][name] for pair in summed], axis=0) for name in summed[0][0]}
        | nothing
        for number in (0, 1)
    ]


def _together(parts: Sequence[Pictures]) -> Pictures:
    truth = {part.has_truth for part in parts if part.keys}
    if len(truth) > 1:
        named = {has: next(p.keys[0][0] for p in parts if p.has_truth == has) for has in truth}
        raise PomologError(
            f"session {named[True]} has truth and {named[False]} has none; "
            "compare them apart: pomolog compare A/SESSION B/SESSION"
        )
    if not truth:
        raise PomologError("the results have no pictures; replay sessions that have some")
    first = parts[0]
    return Pictures(
        keys=[key for part in parts for key in part.keys],
        a=joined([part.a for part in parts]),
        b=joined([part.b for part in parts]),
        runs_a=[joined([part.runs_a[i] for part in parts]) for i in range(len(first.runs_a))],
        runs_b=[joined([part.runs_b[i] for part in parts]) for i in range(len(first.runs_b))],
        has_truth=truth.pop(),
        time_ms=(
            np.concatenate([part.time_ms[0] for part in parts]),
            np.concatenate([part.time_ms[1] for part in parts]),
        ),
    )


def _false(pictures: Pictures) -> tuple[float, float] | None:
    both = [float(np.sum(side["fruit_fp"])) for side in (pictures.a, pictures.b)]
    return (both[0], both[1]) if np.isfinite(both).all() else None


def _identical(judged: Sequence[Judged]) -> bool:
    """Whether no measure differs in any picture: a change of the code that changes no result."""
    known = [one.difference for one in judged if one.difference is not None]
    return bool(known) and all(one.identical for one in known)


def _equal(one: Judged) -> Judged:
    return one if one.difference is None else replace(one, verdict="no difference shown")


def units_of(pictures: Pictures, unit: Unit) -> Places:
    """(P,) the unit that each picture belongs to."""
    if unit == "pair":
        return np.arange(len(pictures.keys))
    names = list(dict.fromkeys(session for session, _ in pictures.keys))
    return np.array([names.index(session) for session, _ in pictures.keys])


def judge_pictures(
    pictures: Pictures,
    measures: Sequence[Measure],
    unit: Unit,
    matters: Mapping[str, float],
    seed: int,
) -> list[Judged]:
    """Judge both sides' sums, with what the seed alone does beside."""
    rng = np.random.default_rng(seed)
    found = differences(measures, pictures.a, pictures.b, units_of(pictures, unit), rng)
    judged = judge(measures, found, matters)
    return [
        replace(
            one,
            seed_std=(
                seed_std(one.measure, pictures.runs_a, rng),
                seed_std(one.measure, pictures.runs_b, rng),
            ),
        )
        for one in judged
    ]


def _notes(
    sides: Sides, pictures: Pictures, judged: Sequence[Judged], unit: Unit, seed: int
) -> Iterable[str]:
    if sides.same:
        yield "A and B are the same run: one method, one seed, one version, the same pictures."
    elif _identical(judged):
        yield "Every measure is the same on both sides in every picture."
    if sides.left_out:
        yield (
            f"Left out, because not every run has them: {', '.join(sides.left_out)}. "
            f"Compared: {', '.join(sides.sessions)}."
        )
    versions = {side.repeats[0].about["versions"]["source"] for side in (sides.a, sides.b)}
    if sides.a.locator == sides.b.locator and len(versions) > 1:
        yield "Both sides have the same method and parameters; the code between them differs."
    if len(sides.a.repeats) == len(sides.b.repeats) == 1:
        yield (
            "One run a side. Random rings are drawn anew for each picture, so that the intervals "
            "contain their noise; how much of them it is, only repeats can say: replay with other "
            "--seed, and compare A1,A2 B1,B2."
        )
    if unit == "pair":
        yield from _alike(pictures, judged, seed)
    if not pictures.has_truth:
        yield (
            "There is no truth: a difference can be shown, but not which side is better. "
            "Fruit are paired by each other: circles that overlap with an IoU of at least 0.5 in "
            "both views."
        )


def _alike(pictures: Pictures, judged: Sequence[Judged], seed: int) -> Iterable[str]:
    """Whether the pairs of one session resemble each other too much to count one by one."""
    unit_of = units_of(pictures, "session")
    measures = [one.measure for one in judged if one.difference is not None]
    if int(unit_of.max()) + 1 < LEAST_SESSIONS or not measures:
        return
    rng = np.random.default_rng(seed)
    whole = differences(measures, pictures.a, pictures.b, unit_of, rng, draws=1)
    wider = {}
    for one in judged:
        ours, theirs = one.difference, whole.get(one.measure.name)
        if ours is None or theirs is None or not ours.std or not theirs.std:
            continue
        ratio = theirs.std / theirs.units**0.5 / (ours.std / ours.units**0.5)
        if theirs.units >= LEAST_SESSIONS and ratio > ALIKE:
            wider[one.measure.name] = ratio
    if wider:
        times = ", ".join(f"{name} {ratio:.1f}" for name, ratio in wider.items())
        yield (
            "Pairs of one session resemble each other: by session the intervals would be wider "
            f"({times} times); see --unit session."
        )
