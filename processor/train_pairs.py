"""Learn which fruit of two views are one, and how far off their places are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from processor.assign import Assignment, MatchModel
from processor.clean import SizeFloor
from processor.colour_table import ColourModel, ColourTable
from processor.count import LEAST_IOU, SEEN_WORTH
from processor.crossfit import cross_fit
from processor.discs import LEAST_VISIBLE, disc_iou
from processor.fruit import FruitFinder, FruitModel
from processor.lessons import Lesson, looks_at
from processor.net import Floats32, Net
from processor.ranging import Disparities, RangeModel, measure
from processor.trace import Floats, Matching, ViewTrace
from processor.train import on_uncounted
from recorder.errors import PomologError

Say = Callable[[str], None]

LARGEST_ERROR_PX = 6.0  # beyond it a place is a blunder, not a spread


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Both views of a pair with their fruit, and the true apple of each.

    Attributes:
        lessons: left and right.
        views: with circles.
        apples: for each view the row of each fruit's disc; -1 none, -2 one that does not count.
    """

    lessons: tuple[Lesson, Lesson]
    views: tuple[ViewTrace, ViewTrace]
    apples: tuple[Floats, Floats]


def see(
    pairs: Sequence[tuple[Lesson, Lesson]],
    colours: ColourModel,
    fruit: Sequence[FruitModel],
    stops: Sequence[float] = (0.0, -1.0, 1.0),
) -> list[Seen]:
    """Find the fruit of every pair, at several exposures, by the model that never saw its fold."""
    recognise, clean = ColourTable(colours), SizeFloor()
    found = []
    for number, pair in enumerate(pairs):
        finder = FruitFinder(fruit[pair[0].fold])
        for stop in stops:
            lessons = (pair[0].exposed(stop), pair[1].exposed(stop))
            views = []
            for side, look in enumerate(looks_at(lessons, recognise)):
                cleaning = clean(look.recognition)
                circles = finder(cleaning, (number, side), look)
                views.append(ViewTrace(look.picture, look.recognition, cleaning, circles))
            apples = [_apples(v, lesson) for v, lesson in zip(views, lessons, strict=True)]
            found.append(Seen(lessons, (views[0], views[1]), (apples[0], apples[1])))
    return found


def _apples(view: ViewTrace, lesson: Lesson) -> Floats:
    circles = view.circles.as_array()
    apples = np.full(len(circles), -1)
    if len(circles) == 0:
        return apples
    apples[on_uncounted(circles, lesson.labels, lesson.real)] = -2
    if len(lesson.discs):
        iou = disc_iou(circles, lesson.discs[:, :3])
        best = np.where(iou >= LEAST_IOU, iou + SEEN_WORTH * lesson.discs[:, 3], 0).argmax(1)
        hit = iou.max(1) >= LEAST_IOU
        apples[hit] = np.where(lesson.discs[best[hit], 3] >= LEAST_VISIBLE / 2, best[hit], -2)
    return apples


def learn_matches(seen: Sequence[Seen], name: str, say: Say = lambda _: None) -> MatchModel:
    """Learn from every pair that geometry allows whether it is one apple.

    Raises:
        PomologError: no apple was found in both views.
    """
    nothing = np.zeros(1, np.float32)
    judge = Assignment(MatchModel(name, Net(nothing, nothing, (), ())))
    measures: list[Floats32] = []
    right: list[Floats] = []
    folds: list[npt.NDArray[np.int64]] = []
    for pair in seen:
        rows, columns, gained = judge.judge(*pair.views, pair.lessons[0].rectification)
        a, b = pair.apples[0][rows], pair.apples[1][columns]
        counted = (a != -2) & (b != -2)
        measures.append(gained[counted])
        right.append(((a == b) & (a >= 0))[counted].astype(float))
        folds.append(np.full(int(counted.sum()), pair.lessons[0].fold))
    x, y, f = np.concatenate(measures), np.concatenate(right), np.concatenate(folds)
    say(f"{len(y)} pairs, {int(y.sum())} right")
    if not y.any():
        raise PomologError(
            "too few apples were found in both views to learn matching from; give more sessions"
        )
    fitted = cross_fit(x, y, f, hidden=(16, 8), rounds=50)
    return MatchModel(name, fitted.whole)


def learn_range(seen: Sequence[Seen], name: str, say: Say = lambda _: None) -> RangeModel:
    """Fit the spread of disparities so that 95 % intervals cover, and the radii's scale."""
    measures, errors, scales = [], [], []
    for pair in seen:
        found, wanted, radius_share = _true_disparities(pair)
        measures.append(found.measures)
        errors.append(found.disparity_px - wanted)
        scales.append(radius_share)
    x, e = np.concatenate(measures).astype(float), np.concatenate(errors)
    clipped = np.minimum(np.abs(e), LARGEST_ERROR_PX)

    def cost(weights: Floats) -> float:
        spread = np.clip(x @ weights, -4, 3)
        heavy = 2 * np.log1p((clipped / np.exp(spread)) ** 2 / 3)  # Student's t, 3 degrees
        return float((spread + heavy).mean() + 1e-3 * (weights**2).sum())

    start = np.zeros(x.shape[1])
    weights = minimize(cost, start, method="BFGS").x
    reach = np.abs(e) / np.exp(np.clip(x @ weights, -4, 3))
    weights[0] += np.log(np.quantile(reach, 0.95) / 1.96)
    covered = float((np.abs(e) <= 1.96 * np.exp(x @ weights)).mean())
    say(f"{len(e)} places, median error {np.median(np.abs(e)):.2f} px, {covered:.1%} covered")
    return RangeModel(
        name, float(np.median(np.concatenate(scales))), tuple(float(w) for w in weights)
    )


def _true_disparities(pair: Seen) -> tuple[Disparities, Floats, Floats]:
    """What is measured of true pairs, and the disparity that a sphere's outline has there."""
    left, right = pair.apples
    both = [(i, j) for i, a in enumerate(left) for j, b in enumerate(right) if a == b and a >= 0]
    places = np.array(both, np.intp).reshape(-1, 2)
    rectification = pair.lessons[0].rectification
    matching = Matching(places, np.zeros(len(places)))
    found = measure(pair.views[0], pair.views[1], matching, rectification)
    rows = left[places[:, 0]].astype(int)
    a, b = pair.lessons[0].discs[rows], pair.lessons[1].discs[rows]
    offset = rectification.disparity_px(0.0, 0.0)
    disparity = a[:, 0] - b[:, 0] + offset
    share = (a[:, 2] + b[:, 2]) / 2 / rectification.focal_px  # R / Z
    return found, disparity / (1 - share**2), (a[:, 2] + b[:, 2]) / 2 / found.shift.middle_px[:, 2]
