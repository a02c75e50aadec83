"""Matched circles -> places in space (paper, Sec. 2.1 and 3.3)."""

import math
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge

from processor.ranging import OutlineRange
from processor.trace import Apple, Fruit, Matching, Sensed, Triangulator, ViewTrace
from processor.with_reading import DepthRange, FusedRange, ReadingRange
from recorder.rectify import Rectification


@dataclass(frozen=True, slots=True)
class Parallel:
    """Z = f B / d from the circles' centres, as parallel cameras have it.

    The circles are the fruit's outline, so the place is Z_c - R^2 / Z_c, 1.6 mm short of an 80 mm
    apple's centre at 1 m. The paper does not correct for that, and neither does this.

    Attributes:
        min_disparity_px: matches of less are dropped: behind infinity there is no apple.
    """

    min_disparity_px: Annotated[float, Ge(0)] = 1.0

    def __call__(
        self,
        left: ViewTrace,
        right: ViewTrace,
        matching: Matching,
        rectification: Rectification,
        sensed: Sensed = Sensed(),  # noqa: ARG002, B008  # stereo alone; frozen
    ) -> tuple[Apple, ...]:
        """Place every match; fruit alone, or in an impossible match, follow without a place."""
        apples = []
        lefts, rights = left.circles.fruit, right.circles.fruit
        alone_left = set(range(len(lefts)))
        alone_right = set(range(len(rights)))
        for i, j in matching.pairs.tolist():
            apple = self._place(i, j, lefts[i], rights[j], rectification)
            if apple is not None:
                alone_left.remove(i)
                alone_right.remove(j)
                apples.append(apple)
        apples += [Apple(i, None) for i in sorted(alone_left)]
        apples += [Apple(None, j) for j in sorted(alone_right)]
        return tuple(apples)

    def _place(
        self, i: int, j: int, left: Fruit, right: Fruit, rectification: Rectification
    ) -> Apple | None:
        disparity_px = rectification.disparity_px(left.x_px, right.x_px)
        if disparity_px <= 0 or disparity_px < self.min_disparity_px:
            return None
        matrix = rectification.left.matrix
        z_m = rectification.focal_px * rectification.baseline_m / disparity_px
        x_m = (left.x_px - matrix[0, 2]) / matrix[0, 0] * z_m
        y_m = (left.y_px - matrix[1, 2]) / matrix[1, 1] * z_m
        centre = rectification.to_left_frame(np.array([[x_m, y_m, z_m]]))[0].tolist()
        radius_m = (left.radius_px + right.radius_px) / 2 / rectification.focal_px * z_m
        return Apple(
            left=i,
            right=j,
            disparity_px=disparity_px,
            centre_m=(centre[0], centre[1], centre[2]),
            radius_m=radius_m,
            surface_range_m=math.hypot(*centre) - radius_m,
        )


TRIANGULATE: Final[dict[str, type[Triangulator]]] = {
    "parallel": Parallel,
    "outline_range": OutlineRange,
    "reading_range": ReadingRange,
    "depth_range": DepthRange,
    "fused_range": FusedRange,
}
