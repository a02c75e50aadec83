"""Fruit: circles from edge points and from a network, ranked, refined, and chosen one by one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, cast

import cv2
import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt, Lt

from processor.candidates import Contour, Pairs, vote
from processor.centres import CentreModel, Centres
from processor.evidence import Claims, Evidence, gather
from processor.nearness import (
    FURTHEST_M,
    NEAREST_M,
    PAPERS_FOCAL_PX,
    USUAL_RADIUS_M,
    Nearness,
    see_nearness,
)
from processor.net import Floats32, Net
from processor.partner import see_centres
from processor.rims import Outlines, fit_outlines
from processor.trace import Circles, Cleaning, Floats, Fruit, Look, Seed
from recorder.rectify import Rectification

Bytes = npt.NDArray[np.uint8]

SHORTEST_CONTOUR_PX: Final = 24


@dataclass(frozen=True, slots=True, eq=False)
class FruitModel:
    """What was learned of circles, by `pomolog train`.

    Attributes:
        name: the model's file, without its ending.
        quality: measures of a circle alone -> how well it fits a fruit.
        choice: the same and what better circles leave of it -> the probability that it is a fruit
            that no better circle is.
        centres: the network that sees whole neighbourhoods; None where none was trained.
    """

    name: str
    quality: Net
    choice: Net
    centres: CentreModel | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Proposals:
    """Circles that may be fruit, best first.

    Attributes:
        circles: (N, 3) x, y, radius, refined.
        outlines: their fit.
        evidence: what speaks for them.
        quality: (N,) by the first network.
        tried: (T, 4) every candidate, with its quality before refinement.
        tried_measures: (T, F) what that quality came from.
        centres: what the network said of the view; None without one.
    """

    circles: Floats
    outlines: Outlines
    evidence: Evidence
    quality: Floats32
    tried: Floats
    tried_measures: Floats32
    centres: Centres | None = None


@dataclass(frozen=True, slots=True)
class FruitFinder:
    """As many circles a region as there is evidence for, each with a confidence and a covariance.

    Attributes:
        model: both networks.
        pairs: makes the candidates.
        least_radius_m: of a fruit; with the rig and the range it gives the window in pixels.
        largest_radius_m: of a fruit.
        nearest_m: of fruit to be found.
        furthest_m: of fruit to be found; what is beyond belongs to the next row.
        voted: candidates from edge points that are looked at.
        least_centre: the probability at which the network's circle is a candidate.
        least_quality: candidates that are refined.
        same: two candidates are one where centres and radii differ by less, in radii.
        same_as_good: the same beyond that, times the better one's quality: what surely is a fruit
            needs no second try.
        refined: candidates that are refined at most.
        least_confidence: of fruit that are reported.
    """

    model: FruitModel
    pairs: Pairs = Pairs()
    least_radius_m: Annotated[float, Gt(0)] = 0.028  # a small Gala
    largest_radius_m: Annotated[float, Gt(0)] = 0.052  # a large Fuji
    nearest_m: Annotated[float, Gt(0)] = NEAREST_M
    furthest_m: Annotated[float, Gt(0)] = FURTHEST_M
    voted: Annotated[int, Ge(0)] = 400
    least_centre: Annotated[float, Gt(0), Lt(1)] = 0.05
    least_quality: Annotated[float, Ge(0)] = 0.1
    same: Annotated[float, Ge(0)] = 0.3
    same_as_good: Annotated[float, Ge(0)] = 0.6
    refined: Annotated[int, Ge(1)] = 120
    # best F1 of fruit half visible, and near it of all, in training
    least_confidence: Annotated[float, Ge(0)] = 0.5

    def __post_init__(self) -> None:
        if self.least_radius_m > self.largest_radius_m:
            raise ValueError("least_radius_m is more than largest_radius_m")
        if self.nearest_m >= self.furthest_m:
            raise ValueError("nearest_m is not less than furthest_m")

    def __call__(self, cleaning: Cleaning, seed: Seed, look: Look) -> Circles:
        """Find fruit; each belongs to the region that has most of its circle's box."""
        proposals = self.propose(cleaning, seed, look)
        confidence = choose(proposals, self.model.choice, self.least_confidence)
        chosen = np.flatnonzero(confidence >= self.least_confidence)
        owners = _owners(cleaning, proposals.circles[chosen])
        usual_px = proposals.evidence.usual_px
        per_radius = look.rectification.baseline_m / USUAL_RADIUS_M
        fruit = []
        for place, region in zip(chosen.tolist(), owners, strict=True):
            x, y, radius = proposals.circles[place].tolist()
            owner = cleaning.regions[region]
            fruit.append(
                Fruit(
                    region, x, y, radius,
                    inliers=int(proposals.evidence.own_edge[place].sum()),
                    area_px=owner.area_px,
                    box_px=owner.box_px,
                    confidence=float(confidence[place]),
                    covariance_px2=_triangle(proposals.outlines.covariance[place]),
                    disparity_px=float(usual_px[place]) * per_radius or None,
                )
            )  # fmt: skip
        tried = np.column_stack([np.zeros(len(proposals.tried)), proposals.tried])
        heat = None if proposals.centres is None else proposals.centres.heat()
        return Circles(tuple(fruit), tried.astype(np.float32), heat)

    def radii_px(self, rectification: Rectification) -> tuple[float, float]:
        """The window of radii for this rig."""
        focal_px = rectification.focal_px
        return (
            focal_px * self.least_radius_m / self.furthest_m,
            focal_px * self.largest_radius_m / self.nearest_m,
        )

    def propose(self, cleaning: Cleaning, seed: Seed, look: Look) -> Proposals:
        """Make, rank and refine candidates."""
        index = look.recognition.evidence()
        grey = cast("Bytes", cv2.cvtColor(look.picture, cv2.COLOR_BGR2GRAY))
        window = self.radii_px(look.rectification)
        nearness = see_nearness(look, self.nearest_m, self.furthest_m)
        network = self.model.centres
        centres = partner = None
        if network is not None:
            centres, partner = see_centres(look, network, self.nearest_m, self.furthest_m)
        tried = self._voted(cleaning, seed, look, nearness)
        if centres is not None and cleaning.regions:  # every fruit belongs to one of them
            peaks = centres.peaks(self.least_centre)
            fitting = (peaks[:, 2] > window[0]) & (peaks[:, 2] < window[1])
            tried = np.concatenate([peaks[fitting], tried])
        first = gather(index, grey, tried, nearness, centres, partner)
        quality = self.model.quality(first.measures)
        kept = self._distinct(tried, quality)
        outlines = fit_outlines(index, tried[kept], first.usual_px[kept].astype(float))
        circles = outlines.circles
        circles[:, 2] = np.clip(circles[:, 2], *window)
        evidence = gather(index, grey, circles, nearness, centres, partner)
        again = self.model.quality(evidence.measures)
        order = np.argsort(-again, kind="stable")
        return Proposals(
            circles[order],
            Outlines(circles[order], outlines.covariance[order], outlines.rim[order]),
            evidence.ordered(order),
            again[order],
            np.column_stack([tried, quality]),
            first.measures,
            centres,
        )

    def _voted(
        self, cleaning: Cleaning, seed: Seed, look: Look, nearness: Nearness | None
    ) -> Floats:
        """Candidates from edge points."""
        if not self.voted:
            return np.empty((0, 3))
        scale = look.rectification.focal_px / PAPERS_FOCAL_PX
        contours = _contours(cleaning, SHORTEST_CONTOUR_PX * scale)
        made = self.pairs.scaled(scale)(
            look.recognition.evidence(), contours, self.radii_px(look.rectification),
            np.random.default_rng(seed), nearness,
        )  # fmt: skip
        return vote(made, self.voted)

    def _distinct(self, circles: Floats, quality: Floats32) -> npt.NDArray[np.intp]:
        """Places of candidates good enough to be refined, without near copies of better ones."""
        order = np.argsort(-quality, kind="stable")
        order = order[quality[order] >= self.least_quality]
        if len(order) == 0:
            return order
        x, y, radius = circles[order].T.astype(np.float32)
        reach = self.same + self.same_as_good * quality[order]
        taken: list[int] = []
        free = np.ones(len(order), bool)
        for place in range(len(order)):
            if free[place]:
                taken.append(place)
                if len(taken) == self.refined:
                    break
                away = np.hypot(x - x[place], y - y[place]) + np.abs(radius - radius[place])
                free &= away >= reach[place] * np.minimum(radius, radius[place])
        return order[taken]


def choose(proposals: Proposals, net: Net, least_confidence: float) -> Floats32:
    """Take proposals best first; each must be worth it with what better ones left of it.

    Those that overlap no better one that is still undecided are decided together.

    Returns:
        (N,) confidence; a proposal that was passed over keeps what it had then.
    """
    count = len(proposals.circles)
    confidence = np.zeros(count, np.float32)
    if count == 0:
        return confidence
    claims = Claims.none(proposals.circles, proposals.evidence)
    rival = np.tril(claims.within + claims.within.T > 0.02, -1)  # a better one that overlaps
    undecided = np.ones(count, bool)
    while undecided.any():
        now = np.flatnonzero(undecided & ~(rival & undecided[None, :]).any(1))
        confidence[now] = net(claims.measures(now, proposals.quality))
        claims.accept(now[confidence[now] >= least_confidence])
        undecided[now] = False
    return confidence


def _contours(cleaning: Cleaning, shortest_px: float) -> list[Contour]:
    """All boundaries of the cleaned mask, those of holes too: a leaf before an apple makes one."""
    contours, _ = cv2.findContours(cleaning.mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return [cast("Contour", c[:, 0]) for c in contours if len(c) > shortest_px]


def _owners(cleaning: Cleaning, circles: Floats) -> list[int]:
    """For each circle the region whose box has most of it."""
    boxes = np.array([region.box_px for region in cleaning.regions], float).reshape(-1, 4)
    owners = []
    for x, y, radius in circles.tolist():
        width = np.minimum(boxes[:, 0] + boxes[:, 2], x + radius) - np.maximum(
            boxes[:, 0], x - radius
        )
        height = np.minimum(boxes[:, 1] + boxes[:, 3], y + radius) - np.maximum(
            boxes[:, 1], y - radius
        )
        owners.append(int(np.argmax(np.maximum(width, 0) * np.maximum(height, 0))))
    return owners


def _triangle(matrix: Floats) -> tuple[float, ...]:
    """The upper triangle of a symmetric matrix, row by row."""
    rows: Sequence[Sequence[float]] = matrix.tolist()
    return tuple(value for number, row in enumerate(rows) for value in row[number:])
