"""What became of each true apple: found in which view, matched with itself or not, how far off."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from processor.discs import LEAST_VISIBLE, Discs
from processor.trace import Apple
from recorder.records import SIDES, AppleTruth, FrameTruth, Side, TruthPoint

LEAST_VISIBLE_TO_MATCH: Final = 0.5  # in both views, of an apple that counts as one to be matched

Verdict = Literal["right", "wrong", "missed"]
Disc = tuple[float, float, float]
"""x, y, radius in rectified pixels."""


@dataclass(frozen=True, slots=True)
class AppleVerdict:
    """What became of one true apple.

    Attributes:
        apple_id: its id.
        distance_m: to its declared truth point.
        left_visible: fraction of its outline seen; None where nobody said.
        right_visible: the same in the right view.
        found_left: a circle of the left view finds it.
        found_right: the same in the right view.
        match: whether its circles were matched; None where it need not be.
        error_m: estimated minus true distance; None unless its own two circles were matched.
        std_m: what the method says of that error; None where it says nothing.
        truth_point: what `distance_m` leads to.
        left_disc: where it is in the left view; None where it is in no part of it.
        right_disc: the same in the right view.
    """

    apple_id: int
    distance_m: float | None
    left_visible: float | None
    right_visible: float | None
    found_left: bool
    found_right: bool
    match: Verdict | None
    error_m: float | None
    std_m: float | None = None
    truth_point: TruthPoint | None = None
    left_disc: Disc | None = None
    right_disc: Disc | None = None


def verdicts_of(
    apples: Sequence[Apple],
    truth: FrameTruth,
    discs: Mapping[Side, Discs],
    found: Mapping[Side, tuple[int | None, ...]],
) -> tuple[AppleVerdict, ...]:
    """What became of every true apple that is in at least one view.

    Args:
        apples: what was located.
        truth: of the frame; its numbers are the same in both views.
        discs: the true apples of each view.
        found: for each circle of each view the place of the disc that it finds.
    """
    known = {a.id: a for a in truth.apples or ()}
    seen = {s: dict(zip(discs[s].ids, discs[s].visible.tolist(), strict=True)) for s in SIDES}
    there = {s: dict(zip(discs[s].ids, discs[s].circles.tolist(), strict=True)) for s in SIDES}
    hit = {s: {discs[s].ids[j] for j in found[s] if j is not None} for s in SIDES}
    right_of, wrong = _matched(apples, discs, found)
    verdicts = []
    for apple_id in sorted(set(discs["left"].ids) | set(discs["right"].ids)):
        visible = [seen[side].get(apple_id, 0.0) for side in SIDES]
        if all(v < LEAST_VISIBLE for v in visible):
            continue
        must_match = not any(v < LEAST_VISIBLE_TO_MATCH for v in visible)
        located, true = right_of.get(apple_id), known.get(apple_id)
        match: Verdict = "right" if located else "wrong" if apple_id in wrong else "missed"
        error_m, std_m = (None, None) if not (located and true) else _error(located, true)
        verdicts.append(
            AppleVerdict(
                apple_id=apple_id,
                distance_m=None if true is None else true.distance_m,
                left_visible=None if math.isnan(visible[0]) else visible[0],
                right_visible=None if math.isnan(visible[1]) else visible[1],
                found_left=apple_id in hit["left"],
                found_right=apple_id in hit["right"],
                match=match if must_match else None,
                error_m=error_m,
                std_m=std_m,
                truth_point=None if true is None else true.truth_point,
                left_disc=_disc(there["left"].get(apple_id)),
                right_disc=_disc(there["right"].get(apple_id)),
            )
        )
    return tuple(verdicts)


def _disc(circle: Sequence[float] | None) -> Disc | None:
    if circle is None or circle[2] <= 0:
        return None
    return circle[0], circle[1], circle[2]


def _matched(
    apples: Sequence[Apple],
    discs: Mapping[Side, Discs],
    found: Mapping[Side, tuple[int | None, ...]],
) -> tuple[dict[int, Apple], set[int]]:
    """Apples whose own two circles were matched, and apples with a circle in another match."""
    right_of: dict[int, Apple] = {}
    wrong: set[int] = set()
    for apple in apples:
        if apple.left is None or apple.right is None:
            continue
        left, right = found["left"][apple.left], found["right"][apple.right]
        ids = (
            None if left is None else discs["left"].ids[left],
            None if right is None else discs["right"].ids[right],
        )
        if ids[0] is not None and ids[0] == ids[1]:
            right_of[ids[0]] = apple
        else:
            wrong |= {i for i in ids if i is not None}
    return right_of, wrong


def _error(apple: Apple, true: AppleTruth) -> tuple[float, float | None]:
    """Estimated minus true distance to the declared truth point, and what is said of it."""
    assert apple.centre_m is not None
    assert apple.surface_range_m is not None
    if true.truth_point == "surface":
        return apple.surface_range_m - true.distance_m, apple.surface_std_m
    return math.hypot(*apple.centre_m) - true.distance_m, apple.range_std_m
