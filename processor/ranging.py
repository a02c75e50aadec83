"""Places of matched fruit from their outlines, with what perspective does to a round thing."""

import math
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from annotated_types import Gt

from processor.likeness import shift_of_skins
from processor.net import Floats32
from processor.rims import Bytes, RimShift, shift_of_rims
from processor.together import fit_together
from processor.trace import Apple, Floats, Matching, Sensed, ViewTrace
from recorder.rectify import Rectification

# standard deviations for a radius of 45 px, from the training pairs
OUTLINE_STD: Final = 2.0
SKIN_STD: Final = 1.5


@dataclass(frozen=True, slots=True)
class RangeModel:
    """How far estimates are off, by `pomolog train`.

    Attributes:
        name: the model's file, without its ending.
        radius_scale: an apple's radius over its outline's mean radius.
        spread: weights of `measures` that give the log of the disparity's standard deviation.
    """

    name: str
    radius_scale: float = 1.0
    spread: tuple[float, ...] = (-0.5, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Disparities:
    """Disparities of M matched fruit.

    Attributes:
        disparity_px: (M,) of the outlines' middles.
        measures: (M, 6) what their error depends on.
        shift: what was compared.
    """

    disparity_px: Floats
    measures: Floats32
    shift: RimShift


@dataclass(frozen=True, slots=True)
class OutlineRange:
    """Z from the shift between two outlines of one fruit, fused with the likeness of its skin.

    Both outlines are sampled at the same angles, so that what they have in common, an apple's
    own shape and the error of its colour, cancels; what only one view sees is left out. The
    middle of a sphere's outline lies at (Z^2 - R^2) / Z, which is undone. A 95 % interval is 1.96
    standard deviations either way; the model that gives them was fitted so that it covers.

    Attributes:
        model: of the errors.
        min_disparity_px: matches of less are dropped: behind infinity there is no apple.
    """

    model: RangeModel
    min_disparity_px: Annotated[float, Gt(0)] = 1.0

    def __call__(
        self,
        left: ViewTrace,
        right: ViewTrace,
        matching: Matching,
        rectification: Rectification,
        sensed: Sensed = Sensed(),  # noqa: ARG002, B008  # stereo alone; frozen
    ) -> tuple[Apple, ...]:
        """Place every match; fruit alone, or in an impossible match, follow without a place."""
        lefts, rights = left.circles.fruit, right.circles.fruit
        found = measure(left, right, matching, rectification)
        spread = np.exp(found.measures @ np.array(self.model.spread))
        apples = []
        alone_left, alone_right = set(range(len(lefts))), set(range(len(rights)))
        for row, (i, j) in enumerate(matching.pairs.tolist()):
            if found.disparity_px[row] < self.min_disparity_px:
                continue
            alone_left.remove(i)
            alone_right.remove(j)
            middle = found.shift.middle_px[row]
            sure = 1 - float(matching.cost[row])
            apples.append(
                self._place(
                    (i, j), middle, float(found.disparity_px[row]), float(spread[row]), sure,
                    rectification,
                )
            )  # fmt: skip
        apples += [Apple(i, None, confidence=lefts[i].confidence) for i in sorted(alone_left)]
        apples += [Apple(None, j, confidence=rights[j].confidence) for j in sorted(alone_right)]
        return tuple(apples)

    def _place(
        self,
        places: tuple[int, int],
        middle_px: Floats,
        disparity_px: float,
        disparity_std_px: float,
        confidence: float,
        rectification: Rectification,
    ) -> Apple:
        matrix = rectification.left.matrix
        focal_px = rectification.focal_px
        outline_z_m = focal_px * rectification.baseline_m / disparity_px
        slope = (middle_px[:2] - matrix[:2, 2]) / matrix[[0, 1], [0, 1]]
        slant = math.hypot(1, *slope.tolist())
        # off the axis a sphere's outline is an ellipse, longer by the slant one way
        radius_px = float(middle_px[2]) * self.model.radius_scale * 2 / (1 + slant)
        radius_m = radius_px / focal_px * outline_z_m
        z_m = outline_z_m / 2 + math.sqrt(outline_z_m**2 / 4 + radius_m**2)
        radius_m = radius_px / focal_px * math.sqrt(max(z_m**2 - radius_m**2, 0.0))
        rectified = np.array([slope[0] * outline_z_m, slope[1] * outline_z_m, z_m])
        # errors: of the disparity along the ray, of the middle across it
        z_std_m = disparity_std_px * outline_z_m / disparity_px
        across_m = max(0.02 * float(middle_px[2]), 0.5) / focal_px * z_m
        ray = rectified / z_m
        covariance = z_std_m**2 * np.outer(ray, ray) + across_m**2 * np.diag([1.0, 1.0, 0.0])
        turn = rectification.left.rotation
        centre = rectification.to_left_frame(rectified[None])[0]
        covariance = turn.T @ covariance @ turn
        range_m = float(np.linalg.norm(centre))
        towards = centre / range_m
        range_std_m = math.sqrt(float(towards @ covariance @ towards))
        radius_std_m = radius_m * math.hypot(0.03, 0.7 / radius_px, z_std_m / z_m)
        return Apple(
            left=places[0],
            right=places[1],
            disparity_px=disparity_px,
            centre_m=(float(centre[0]), float(centre[1]), float(centre[2])),
            radius_m=radius_m,
            surface_range_m=range_m - radius_m,
            confidence=confidence,
            covariance_m2=tuple(covariance[np.triu_indices(3)].tolist()),
            radius_std_m=radius_std_m,
            range_std_m=range_std_m,
            surface_std_m=math.hypot(range_std_m, radius_std_m),
        )


def measure(
    left: ViewTrace, right: ViewTrace, matching: Matching, rectification: Rectification
) -> Disparities:
    """Measure the disparity of every match three ways, and fuse them robustly.

    Rims compared ray by ray are the best where both views see the same rim; one outline for both
    holds where they see different parts; skins compared hold where little rim is left.
    """
    a, b = (
        np.array([(f.x_px, f.y_px, f.radius_px) for f in fruit]).reshape(-1, 3)
        for fruit in (
            [left.circles.fruit[i] for i in matching.pairs[:, 0].tolist()],
            [right.circles.fruit[j] for j in matching.pairs[:, 1].tolist()],
        )
    )
    evidence = left.recognition.evidence(), right.recognition.evidence()
    shift = _best_shift(*evidence, a, b)
    together = fit_together(*evidence, a, b)
    by_outline = together[0][:, 0] - together[1][:, 0]
    by_skin, likeness = shift_of_skins(
        left, right, shift.middle_px, shift.shift_px, rectification.focal_px
    )
    size = np.maximum(shift.middle_px[:, 2], 1.0) / 45
    stds = np.stack([
        np.hypot(shift.std_px, 0.15) / np.clip(shift.rim, 0.05, 1),
        OUTLINE_STD * size,
        SKIN_STD * size / np.clip(likeness, 0.05, 1),
    ])  # fmt: skip
    ways = np.stack([shift.shift_px, by_outline, by_skin])
    fused = np.median(ways, axis=0) if len(a) else np.empty(0)
    weights = 1 / stds**2
    for _ in range(8):  # Cauchy's weights: one way that fails alone is left behind
        weights = 1 / stds**2 / (1 + ((ways - fused) / (2 * stds)) ** 2)
        fused = (weights * ways).sum(0) / weights.sum(0)
    measures = np.column_stack([
        np.ones(len(fused)), -np.log(weights.sum(0)) / 2, shift.rim,
        np.minimum(np.abs(ways[0] - ways[1]) / size / 45, 0.3) * 10,
        np.minimum(np.abs(ways[0] - ways[2]) / size / 45, 0.3) * 10,
        np.log(size),
    ])  # fmt: skip
    offset = rectification.disparity_px(0.0, 0.0)
    return Disparities(fused + offset, measures.astype(np.float32), shift)


def _best_shift(left: Bytes, right: Bytes, a: Floats, b: Floats) -> RimShift:
    """Compare rims from the mean of both circles, and from each; the one that most rays agree to.

    Where leaves deceived one view's circle, the other's row and size are the better start.
    """
    lend_b, lend_a = b.copy(), a.copy()
    lend_b[:, 0], lend_a[:, 0] = a[:, 0], b[:, 0]
    count = len(a)
    # all starts at once: there are few fruit, and numpy's cost is by the call
    tried = shift_of_rims(
        left, right, np.concatenate([a, lend_b, a]), np.concatenate([b, b, lend_a])
    )
    best = tried.rim.reshape(3, count).argmax(0) * count + np.arange(count)
    return RimShift(*(getattr(tried, field)[best] for field in RimShift.__slots__))
