"""What speaks for a circle being a fruit, in numbers: its rim, its inside, and who claims it."""

from dataclasses import dataclass
from typing import Final, cast

import numpy as np
import numpy.typing as npt

from processor.net import Floats32
from processor.trace import Floats

Bytes = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]

RAYS: Final = 32
_ANGLES: Final = np.arange(RAYS) * (2 * np.pi / RAYS)
_SPOKES: Final = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1).astype(np.float32)
_SHARES: Final = np.array([0.2, 0.4, 0.6, 0.75, 0.88, 1.12, 1.3], np.float32)  # of the radius
_INNER: Final = 4  # the ring just inside the rim
_OUTER: Final = 5  # the ring just outside
_RIM: Final = np.array([0.9, 0.97, 1.03, 1.1], np.float32)  # where grey levels are compared
MEASURES: Final = 20  # of a circle alone
CLAIM_MEASURES: Final = 8  # more, of what better circles leave of it
_DISC: Final = (0, 1, 2, 3, 4)  # the rings that sample a circle's inside
POINTS: Final = RAYS * len(_DISC)


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Measures of N circles.

    Attributes:
        measures: (N, F), for the network that ranks them.
        fruit: (N, P) which of the points inside each circle look like fruit.
        points_px: (N, P, 2) those points.
        own_edge: (N, RAYS) where evidence ends at the rim.
        rim_px: (N, RAYS, 2) the rim.
    """

    measures: Floats32
    fruit: Flags
    points_px: Floats32
    own_edge: Flags
    rim_px: Floats32


def gather(index: Bytes, grey: Bytes, circles: Floats) -> Evidence:
    """Sample evidence and grey levels on rings of each circle.

    Args:
        index: (H, W) evidence of fruit.
        grey: (H, W) grey levels: one apple before another shows there only.
        circles: (N, 3) x, y, radius.
    """
    height, width = index.shape
    place = circles.astype(np.float32)
    spokes = place[:, None, 2:] * _SPOKES
    points = place[:, None, None, :2] + spokes[:, :, None] * _SHARES[:, None]
    sampled = _sample(index, points).astype(np.float32) / 255
    inside = (points >= 0).all(-1) & (points[..., 0] < width) & (points[..., 1] < height)
    rim = _sample(grey, place[:, None, None, :2] + spokes[:, :, None] * _RIM[:, None])
    levels = rim.astype(np.float32) @ np.array([1, 1, -1, -1], np.float32)
    edge = np.minimum(np.abs(levels) * (3 / 255), 1)
    inner, outer = sampled[..., _INNER], sampled[..., _OUTER]
    visible = (inside[..., _INNER] & inside[..., _OUTER]).astype(np.float32)
    rays = np.maximum(visible.sum(1), 1)
    own = inner * (1 - outer) * visible
    hidden = (1 - inner) * (1 - outer) * visible
    shared = inner * outer * visible
    beyond = (1 - inner) * outer * visible
    flags = own > 0.5
    total = np.maximum(own.sum(1), 1e-3)
    lean = np.hypot(own @ _SPOKES[:, 0], own @ _SPOKES[:, 1]) / total
    within = np.maximum(inside.sum(1), 1)
    rings = (sampled * inside).sum(1) / within
    measures = np.column_stack([
        own.sum(1) / rays, hidden.sum(1) / rays, (shared * (1 - edge)).sum(1) / rays,
        (shared * edge).sum(1) / rays, beyond.sum(1) / rays, (own * edge).sum(1) / rays,
        lean, (flags & np.roll(flags, 1, 1)).mean(1),
        (flags & np.roll(flags, RAYS // 2, 1)).mean(1),
        flags.reshape(len(flags), 4, RAYS // 4).any(2).mean(1),
        rings, np.sqrt(rings[:, 1] * rings[:, 3]),
        np.log(np.maximum(place[:, 2], 1) / 50), inside[..., _INNER].mean(1),
    ])  # fmt: skip
    count = len(place)
    return Evidence(
        measures.astype(np.float32),
        ((sampled > 0.5) & inside)[:, :, _DISC].reshape(count, POINTS),
        points[:, :, _DISC].reshape(count, POINTS, 2),
        flags,
        place[:, None, :2] + spokes,
    )


def _sample(plane: Bytes, points: Floats32) -> Bytes:
    """The nearest pixel's value at (..., 2) points; the picture's edge goes on outside."""
    height, width = plane.shape
    places = np.rint(points).astype(np.int32)
    columns = np.clip(places[..., 0], 0, width - 1)
    rows = np.clip(places[..., 1], 0, height - 1)
    return cast("Bytes", plane.ravel()[rows * width + columns])


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
            away = self.evidence.points_px[rows] - np.array([x, y], np.float32)
            self.fruit[rows] &= (away * away).sum(-1) > (1.02 * radius) ** 2
            away = self.evidence.rim_px[rows] - np.array([x, y], np.float32)
            self.edge[rows] &= np.abs(np.sqrt((away * away).sum(-1)) - radius) > 0.1 * radius

    def measures(self, some: npt.NDArray[np.intp], quality: Floats32) -> Floats32:
        """(n, F) what a circle still has that no accepted one explains, beside its quality."""
        others = self.accepted[None, :]
        none = not self.accepted.any()
        iou = np.zeros(len(some)) if none else (self.iou[some] * others).max(1)
        inside = np.zeros(len(some)) if none else (self.within[some] * others).max(1)
        around = np.zeros(len(some)) if none else (self.within.T[some] * others).max(1)
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
