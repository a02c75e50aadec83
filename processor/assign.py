"""Match fruit by one assignment over all of them: row, size, looks, and what size says of range."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, cast

import cv2
import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt, Lt
from scipy.optimize import linear_sum_assignment

from processor.nearness import USUAL_RADIUS_M
from processor.net import Floats32, Net
from processor.trace import Floats, Fruit, Matching, ViewTrace
from recorder.rectify import Rectification

PAIR_MEASURES: Final = 20
_GRID: Final = np.linspace(-0.9, 0.9, 18)
_SPOTS: Final = np.array([(x, y) for y in _GRID for x in _GRID if np.hypot(x, y) <= 0.95])
_NOISE: Final = 2.0  # grey levels; texture below it says nothing


@dataclass(frozen=True, slots=True, eq=False)
class MatchModel:
    """What was learned of pairs, by `pomolog train`.

    Attributes:
        name: the model's file, without its ending.
        pair: measures of a left and a right fruit -> the probability that they are one.
    """

    name: str
    pair: Net


@dataclass(frozen=True, slots=True)
class Assignment:
    """The assignment of left to right fruit that is most probable as a whole.

    No global shift, no order: each pair is judged by its rows, its radii, the likeness of both
    discs, and whether a fruit of that size in pixels can be as far away as that disparity says.
    A fruit may stay alone; a pair must be the best for both of its fruit, and by some margin.

    Attributes:
        model: the network that judges pairs.
        row_slack: rows may differ by this share of the radius, and by two pixels.
        size_ratio: radii may differ by this factor.
        least_radius_m: that disparity and radius may say.
        largest_radius_m: likewise.
        least_probability: of a pair to be matched.
        margin: of log odds to the next best pair of either fruit.
    """

    model: MatchModel
    row_slack: Annotated[float, Gt(0)] = 0.4
    size_ratio: Annotated[float, Ge(1)] = 1.6
    least_radius_m: Annotated[float, Ge(0)] = 0.018
    largest_radius_m: Annotated[float, Gt(0)] = 0.075
    least_probability: Annotated[float, Gt(0), Lt(1)] = 0.5
    margin: Annotated[float, Ge(0)] = 0.0

    def __call__(self, left: ViewTrace, right: ViewTrace, rectification: Rectification) -> Matching:
        """Match the fruit of two rectified views; each fruit at most once.

        The cost of a pair is one minus its probability.
        """
        lefts, rights = left.circles.fruit, right.circles.fruit
        rows, columns, measures = self.judge(left, right, rectification)
        odds = np.full((len(lefts), len(rights)), -np.inf)
        if len(rows):
            share = np.clip(self.model.pair(measures).astype(float), 1e-6, 1 - 1e-6)
            odds[rows, columns] = np.log(share / (1 - share))
        floor = np.log(self.least_probability / (1 - self.least_probability))
        gain = np.maximum(odds - floor, 0)
        chosen = [
            (i, j)
            for i, j in np.column_stack(linear_sum_assignment(gain, maximize=True)).tolist()
            if gain[i, j] > 0 and odds[i, j] - _next_best(odds, i, j) >= self.margin
        ]
        pairs = np.array(chosen, np.intp).reshape(-1, 2)
        cost = 1 / (1 + np.exp(odds[pairs[:, 0], pairs[:, 1]]))
        return Matching(pairs, cost)

    def judge(
        self, left: ViewTrace, right: ViewTrace, rectification: Rectification
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Floats32]:
        """Pairs that geometry allows: (P,) left places, (P,) right places, (P, F) measures."""
        lefts, rights = left.circles.fruit, right.circles.fruit
        a, b = left.circles.as_array(), right.circles.as_array()
        mean = (a[:, None, 2] + b[None, :, 2]) / 2
        ratio = a[:, None, 2] / np.maximum(b[None, :, 2], 1e-6)
        offset = rectification.disparity_px(0.0, 0.0)
        disparity = a[:, None, 0] - b[None, :, 0] + offset
        radius_m = mean * rectification.baseline_m / np.maximum(disparity, 1e-6)
        down = a[:, None, 1] - b[None, :, 1]
        allowed = (
            (disparity > 1)
            & (np.abs(down) < self.row_slack * mean + 2)
            & (np.abs(np.log(ratio)) < np.log(self.size_ratio))
            & (radius_m > self.least_radius_m)
            & (radius_m < self.largest_radius_m)
        )
        rows, columns = np.nonzero(allowed)
        if len(rows) == 0:
            return rows, columns, np.empty((0, PAIR_MEASURES), np.float32)
        looks = _likeness(left, right, rows, columns)
        picked = allowed.nonzero()
        sure = [np.array([_confidence(f) for f in v.circles.fruit]) for v in (left, right)]
        measures = np.column_stack([
            np.abs(down[picked]) / mean[picked], np.minimum(np.abs(down[picked]), 10) / 5,
            np.abs(np.log(ratio[picked])), np.log(radius_m[picked] / USUAL_RADIUS_M),
            np.abs(np.log(radius_m[picked] / USUAL_RADIUS_M)), np.log(mean[picked] / 50),
            *looks.T, np.minimum(sure[0][rows], sure[1][columns]),
            np.maximum(sure[0][rows], sure[1][columns]),
            *_coarsely(lefts, rights, rows, columns, disparity[picked]),
            _in_picture(left)[rows], _in_picture(right)[columns],
        ])  # fmt: skip
        return rows, columns, measures.astype(np.float32)


def _confidence(fruit: Fruit) -> float:
    return 1.0 if fruit.confidence is None else fruit.confidence


def _in_picture(view: ViewTrace) -> Floats:
    """(N,) the share of each circle's width that the picture has; its edge hides the rest."""
    x, _, radius = view.circles.as_array().T
    seen = np.minimum(x + radius, view.picture.shape[1]) - np.maximum(x - radius, 0)
    return cast("Floats", np.clip(seen / (2 * radius), 0, 1))


def _coarsely(
    lefts: Sequence[Fruit],
    rights: Sequence[Fruit],
    rows: npt.NDArray[np.intp],
    columns: npt.NDArray[np.intp],
    disparity_px: Floats,
) -> Floats:
    """How far each pair's disparity is from what is coarsely seen at either fruit.

    Returns:
        (4, P): for each view the logarithm of their ratio, and whether it is known.
    """
    found = []
    for fruit, places in ((lefts, rows), (rights, columns)):
        coarse = np.array([f.disparity_px or 0.0 for f in fruit])[places]
        if not coarse.any():  # by a finder that does not look: nothing is contradicted
            coarse = disparity_px
        known = coarse > 0
        ratio = np.where(known, disparity_px / np.where(known, coarse, 1.0), 1.0)
        found += [np.minimum(np.abs(np.log(ratio)), 0.5), known.astype(float)]
    return np.stack(found)


def _next_best(odds: Floats, i: int, j: int) -> float:
    """The best log odds of another pair with either fruit."""
    others = np.concatenate([np.delete(odds[i], j), np.delete(odds[:, j], i)])
    return float(others.max()) if len(others) else -np.inf


def _likeness(
    left: ViewTrace,
    right: ViewTrace,
    rows: npt.NDArray[np.intp],
    columns: npt.NDArray[np.intp],
) -> Floats:
    """(P, 6): correlation of brightness and of two colour differences, colours, overlap."""
    one, shown_one = _discs(left)
    two, shown_two = _discs(right)
    a, b = one[rows], two[columns]
    both = (shown_one[rows] * shown_two[columns])[..., None]
    count = np.maximum(both.sum(1), 1)
    mean_a, mean_b = (a * both).sum(1) / count, (b * both).sum(1) / count
    a, b = (a - mean_a[:, None]) * both, (b - mean_b[:, None]) * both
    noise = _NOISE**2 * count  # discs without texture are alike, not unlike
    alike = ((a * b).sum(1) + noise) / (np.sqrt((a * a).sum(1) * (b * b).sum(1)) + noise)
    either = np.maximum(shown_one[rows], shown_two[columns]).sum(1)
    colour = np.abs(mean_a - mean_b)[:, 1:].sum(1) / 20
    return np.column_stack(
        [
            alike,
            np.abs(mean_a - mean_b)[:, 0] / 40,
            colour,
            both[..., 0].sum(1) / np.maximum(either, 1),
        ]
    )


def _discs(view: ViewTrace) -> tuple[Floats32, Floats32]:
    """(N, S, 3) brightness and colour at spots of each disc, and (N, S) which show fruit."""
    circles = view.circles.as_array()
    if len(circles) == 0:
        return np.empty((0, len(_SPOTS), 3), np.float32), np.empty((0, len(_SPOTS)), np.float32)
    x = (circles[:, :1] + circles[:, 2:] * _SPOTS[:, 0]).astype(np.float32)
    y = (circles[:, 1:2] + circles[:, 2:] * _SPOTS[:, 1]).astype(np.float32)
    border: Sequence[float] = (0,)
    seen = cv2.remap(view.picture, x, y, cv2.INTER_LINEAR).astype(np.float32)
    index = cv2.remap(
        view.recognition.evidence(), x, y, cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT, borderValue=border,
    )  # fmt: skip
    blue, green, red = (seen[..., k] for k in range(3))
    looks = np.stack([(red + green + blue) / 3, red - green, green - blue], -1)
    return looks, cast("Floats32", (np.asarray(index) > 127).astype(np.float32))
