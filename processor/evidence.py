"""What speaks for a circle being a fruit, in numbers: its rim, its inside, and who claims it."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from processor.centres import CENTRE_MEASURES, Centres
from processor.nearness import Nearness
from processor.net import Floats32
from processor.partner import PARTNER_MEASURES, Partner
from processor.trace import Floats

Bytes = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]

RAYS: Final = 32
_ANGLES: Final = np.arange(RAYS) * (2 * np.pi / RAYS)
_SPOKES: Final = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1).astype(np.float32)
# shares of the radius; rings come first in every array, so that each is in one piece
_SHARES: Final = np.array([0.2, 0.4, 0.6, 0.75, 0.88, 1.12, 1.3], np.float32)[:, None, None]
_INNER: Final = 4  # the ring just inside the rim
_OUTER: Final = 5  # the ring just outside
_RIM: Final = np.array([0.9, 0.97, 1.03, 1.1], np.float32)[
    :, None, None
]  # where grey levels are compared
MEASURES: Final = 23 + CENTRE_MEASURES + PARTNER_MEASURES  # of a circle alone
CLAIM_MEASURES: Final = 8  # more, of what better circles leave of it
_DISC: Final = 5  # the first rings sample a circle's inside
POINTS: Final = RAYS * _DISC
_SPARSE: Final = 5  # one in so many points is asked how near it is


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Measures of N circles.

    Attributes:
        measures: (N, F), for the network that ranks them.
        fruit: (N, P) which of the points inside each circle look like fruit.
        points_px: (2, N, P) x and y of those points.
        own_edge: (N, RAYS) where evidence ends at the rim.
        rim_px: (2, N, RAYS) x and y of the rim.
        usual_px: (N,) the radius that an apple has there; 0 where nobody knows.
    """

    measures: Floats32
    fruit: Flags
    points_px: Floats32
    own_edge: Flags
    rim_px: Floats32
    usual_px: Floats32

    def ordered(self, order: npt.NDArray[np.intp]) -> "Evidence":
        """The same circles in another order, or some of them."""
        return Evidence(
            self.measures[order], self.fruit[order], self.points_px[:, order],
            self.own_edge[order], self.rim_px[:, order], self.usual_px[order],
        )  # fmt: skip


def gather(
    index: Bytes,
    grey: Bytes,
    circles: Floats,
    nearness: Nearness | None = None,
    centres: Centres | None = None,
    partner: Partner | None = None,
) -> Evidence:
    """Sample evidence and grey levels on rings of each circle.

    Args:
        index: (H, W) evidence of fruit.
        grey: (H, W) grey levels: one apple before another shows there only.
        circles: (N, 3) x, y, radius.
        nearness: what the other view says of sizes, where there is one.
        centres: what the network says of the view, where there is one.
        partner: what it says of the other view, where there is one.
    """
    height, width = index.shape
    x, y, radius = circles.astype(np.float32).T[..., None]
    count = len(circles)
    across, down = radius * _SPOKES[:, 0], radius * _SPOKES[:, 1]
    points_x, points_y = x + _SHARES * across, y + _SHARES * down
    sampled = _sample(index, points_x, points_y).astype(np.float32) * np.float32(1 / 255)
    inside = (points_x >= 0) & (points_y >= 0) & (points_x < width) & (points_y < height)
    sampled *= inside
    rim = _sample(grey, x + _RIM * across, y + _RIM * down).astype(np.int16)
    levels = np.abs(rim[0] + rim[1] - rim[2] - rim[3])
    edge = np.minimum(levels * np.float32(3 / 255), 1)
    inner, outer = sampled[_INNER], sampled[_OUTER]
    visible = inside[_INNER] & inside[_OUTER]
    rays = np.maximum(visible.sum(1), 1)
    both = inner * outer * visible
    own, beyond = inner * visible - both, outer * visible - both
    hidden = visible - own - beyond - both
    own_at_edge, shared_at_edge = own * edge, both * edge
    flags = own > 0.5
    sums = {name: part.sum(1) for name, part in (
        ("own", own), ("hidden", hidden), ("both", both), ("beyond", beyond),
        ("own_at_edge", own_at_edge), ("shared_at_edge", shared_at_edge),
    )}  # fmt: skip
    lean = np.hypot(own @ _SPOKES[:, 0], own @ _SPOKES[:, 1]) / np.maximum(sums["own"], 1e-3)
    rings = (sampled.sum(2) / np.maximum(inside.sum(2), 1)).T
    measures = np.column_stack([
        sums["own"] / rays, sums["hidden"] / rays,
        (sums["both"] - sums["shared_at_edge"]) / rays, sums["shared_at_edge"] / rays,
        sums["beyond"] / rays, sums["own_at_edge"] / rays,
        lean, (flags & np.roll(flags, 1, 1)).mean(1),
        (flags & np.roll(flags, RAYS // 2, 1)).mean(1),
        flags.reshape(count, 4, RAYS // 4).any(2).mean(1),
        rings, np.sqrt(rings[:, 1] * rings[:, 3]),
        np.log(np.maximum(radius[:, 0], 1) / 50), inside[_INNER].mean(1),
    ])  # fmt: skip
    fruit = (sampled[:_DISC] > 0.5).transpose(1, 0, 2).reshape(count, POINTS)
    inside_x, inside_y = (
        part[:_DISC].transpose(1, 0, 2).reshape(count, POINTS) for part in (points_x, points_y)
    )
    said, usual_px = _said_of_size(radius[:, 0], fruit, (inside_x, inside_y), nearness)
    said_of_centres = [
        np.zeros((count, columns), np.float32) if network is None else network.measures(circles)
        for network, columns in ((centres, CENTRE_MEASURES), (partner, PARTNER_MEASURES))
    ]
    return Evidence(
        np.column_stack([measures, said, *said_of_centres]).astype(np.float32),
        fruit,
        np.stack([inside_x, inside_y]),
        flags,
        np.stack([x + across, y + down]),
        usual_px,
    )


def _said_of_size(
    radius: Floats32, fruit: Flags, at: tuple[Floats32, Floats32], nearness: Nearness | None
) -> tuple[Floats, Floats32]:
    """What nearness says of each circle's size.

    Returns:
        (N, 3) the share of fruit points whose nearness is known, the radius over what their median
        says (as a logarithm, 0 where nobody knows), and the share of them that say the same; and
        (N,) that median.
    """
    if nearness is None or len(radius) == 0:
        return np.zeros((len(radius), 3)), np.zeros(len(radius), np.float32)
    some = fruit[:, ::_SPARSE]
    said = nearness.radius_px(*(axis[:, ::_SPARSE] for axis in at)) * some
    known = (said > 0).sum(1)
    ranked = np.sort(said, 1)  # unknown ones come first
    middle = ranked[np.arange(len(said)), said.shape[1] - 1 - known // 2]
    ratio = np.where(known > 0, np.log(radius / np.maximum(middle, 1)), 0)
    alike = np.abs(said - middle[:, None]) < 0.08 * middle[:, None]
    said_of = [
        known / np.maximum(some.sum(1), 1), np.clip(ratio, -1, 1),
        alike.sum(1) / np.maximum(known, 1),
    ]  # fmt: skip
    return np.column_stack(said_of), np.where(known > 0, middle, 0).astype(np.float32)


def _sample(plane: Bytes, x: Floats32, y: Floats32) -> Bytes:
    """The nearest pixel's value at (...) points; the picture's edge goes on outside."""
    height, width = plane.shape
    columns = (x + np.float32(0.5)).astype(np.int32)
    rows = (y + np.float32(0.5)).astype(np.int32)
    np.clip(columns, 0, width - 1, out=columns)
    np.clip(rows, 0, height - 1, out=rows)
    rows *= width
    rows += columns
    return plane.ravel().take(rows)


def disc_overlap(circles: Floats) -> tuple[Floats, Floats]:
    """(N, N) intersection over union, and the share of circle i that lies within circle j."""
    count, radius = len(circles), circles[:, 2]
    area = np.pi * radius**2
    apart = np.hypot(*(circles[:, None, :2] - circles[None, :, :2]).transpose(2, 0, 1))
    first, second = np.nonzero(apart < radius[:, None] + radius)  # few of all pairs
    d, r, s = np.maximum(apart[first, second], 1e-9), radius[first], radius[second]
    a = np.arccos(np.clip((d * d + r * r - s * s) / (2 * d * r), -1, 1))
    b = np.arccos(np.clip((d * d + s * s - r * r) / (2 * d * s), -1, 1))
    lens = np.zeros((count, count))
    lens[first, second] = r * r * (a - np.sin(2 * a) / 2) + s * s * (b - np.sin(2 * b) / 2)
    return lens / (area[:, None] + area[None, :] - lens), lens / area[:, None]


@dataclass(slots=True)
class Claims:
    """Which evidence better circles have taken already, for N circles in order of quality."""

    circles: Floats
    evidence: Evidence
    iou: Floats
    within: Floats
    fruit: Flags  # (N, P) fruit points that no accepted circle has
    edge: Flags  # (N, RAYS) rim points that lie on no accepted circle's rim
    accepted: Flags  # (N,)

    @classmethod
    def none(cls, circles: Floats, evidence: Evidence) -> "Claims":
        """Nothing is taken yet."""
        iou, within = disc_overlap(circles)
        empty = np.zeros(len(circles), bool)
        return cls(
            circles, evidence, iou, within, evidence.fruit.copy(), evidence.own_edge.copy(), empty
        )

    def accept(self, some: npt.NDArray[np.intp]) -> None:
        """Give circles their evidence."""
        self.accepted[some] = True
        for x, y, radius in self.circles[some].tolist():
            touched = np.hypot(self.circles[:, 0] - x, self.circles[:, 1] - y) < (
                radius + 1.4 * self.circles[:, 2]
            )
            rows = np.flatnonzero(touched)
            across, down = (axis[rows] for axis in self.evidence.points_px)
            self.fruit[rows] &= (across - x) ** 2 + (down - y) ** 2 > (1.02 * radius) ** 2
            across, down = (axis[rows] for axis in self.evidence.rim_px)
            away = np.abs(np.hypot(across - x, down - y) - radius)
            self.edge[rows] &= away > 0.1 * radius

    def measures(self, some: npt.NDArray[np.intp], quality: Floats32) -> Floats32:
        """(n, F) what a circle still has that no accepted one explains, beside its quality."""
        taken = np.flatnonzero(self.accepted)
        if len(taken):
            of_taken = np.ix_(some, taken)
            iou, inside = self.iou[of_taken].max(1), self.within[of_taken].max(1)
            around = self.within[np.ix_(taken, some)].max(0)
        else:
            iou = inside = around = np.zeros(len(some))
        evidence = self.evidence
        left = self.fruit[some].mean(1)
        edge = self.edge[some].mean(1)
        score = np.clip(quality[some], 1e-4, 1 - 1e-4)
        return np.column_stack([
            np.log(score / (1 - score)), iou, inside, around, left, edge,
            left / np.maximum(evidence.fruit[some].mean(1), 0.02),
            edge / np.maximum(evidence.own_edge[some].mean(1), 0.02),
            evidence.measures[some],
        ]).astype(np.float32)  # fmt: skip
