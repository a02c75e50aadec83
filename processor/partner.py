"""What the network of centres says in the other view of a circle in this one.

A fruit that both cameras see has a centre in the other view, on the same row, as large, and as far
along it as an apple of that size hangs away. A leaf's gap or two halves of two apples have none.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from processor.centres import CentreModel, Centres
from processor.nearness import USUAL_RADIUS_M, see_both_nearnesses
from processor.net import Floats32
from processor.trace import Floats, Look
from recorder.records import SIDES, Side
from recorder.rectify import Rectification

PARTNER_MEASURES: Final = 6
# times the usual radius: 28 to 54 mm, so close that a hill of the network lies under one of them
_SIZES: Final = np.exp(np.linspace(-0.33, 0.33, 17)).astype(np.float32)
_ROWS: Final = np.array([-0.15, 0.0, 0.15], np.float32)  # radii up and down
_UNLIKE: Final = 4.0  # log odds that a doubled or halved radius costs, times ln 2
_OFF_ROW: Final = 3.0  # log odds that a radius up or down costs


@dataclass(frozen=True, slots=True, eq=False)
class Partner:
    """The other view, seen from this one.

    Attributes:
        centres: what the network says there.
        side: of this view.
        rectification: the rig's.
        width_px: of the view.
    """

    centres: Centres
    side: Side
    rectification: Rectification
    width_px: int

    def measures(self, circles: Floats) -> Floats32:
        """What the other view says of each circle.

        Args:
            circles: (N, 3) x, y, radius.

        Returns:
            (N, PARTNER_MEASURES): the log odds of the best centre where its partner could be; the
            logarithms of that one's radius over the circle's, and of the size that its disparity
            gives over the usual; how far its row is off, in radii; how much of it can be seen; and
            the share of the places searched that the view has.
        """
        x, y, radius = circles.astype(np.float32).T[..., None]
        per_px = np.float32(self.rectification.baseline_m / USUAL_RADIUS_M)
        offset = np.float32(self.rectification.disparity_px(0.0, 0.0))
        sign = np.float32(1 if self.side == "left" else -1)
        columns = x - sign * (radius * per_px / _SIZES - offset)
        there = (columns >= 0) & (columns < self.width_px)
        found = self.centres.at(
            np.tile(columns, len(_ROWS)), np.repeat(y + radius * _ROWS, len(_SIZES), axis=1)
        )
        alike = np.log(np.maximum(found.circles[..., 2], 1) / radius)
        off_row = (found.circles[..., 1] - y) / radius
        worth = found.logit - _UNLIKE * np.abs(alike) - _OFF_ROW * np.abs(off_row)
        best = np.where(np.tile(there, len(_ROWS)), worth, -np.inf).argmax(1)
        of_best = np.arange(len(best)), best
        apart = np.maximum(sign * (x[:, 0] - found.circles[..., 0][of_best]) + offset, 1)
        size = np.log(radius[:, 0] * per_px / apart)
        return np.column_stack([
            found.logit[of_best], alike[of_best].clip(-1, 1), size.clip(-1, 1),
            off_row[of_best].clip(-1, 1), found.visible[of_best], there.mean(1),
        ]).astype(np.float32)  # fmt: skip


def see_centres(
    look: Look, network: CentreModel, nearest_m: float, furthest_m: float
) -> tuple[Centres, Partner | None]:
    """Look at a view, and at the other one where there is one; once for both.

    Args:
        look: the view.
        network: sees centres.
        nearest_m: of what may be seen.
        furthest_m: likewise.
    """
    nearnesses = see_both_nearnesses(look, nearest_m, furthest_m)
    if look.other is None or nearnesses is None:
        return network(look, None), None
    key = (network, nearest_m, furthest_m)
    if key not in look.shared:
        looks = {look.side: look, look.other.side: look.other}
        look.shared[key] = {side: network(looks[side], nearnesses[side]) for side in SIDES}
    both = look.shared[key]
    width_px = look.other.picture.shape[1]
    partner = Partner(both[look.other.side], look.side, look.rectification, width_px)
    return both[look.side], partner
