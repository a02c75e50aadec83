"""Outlines of single true apples: what a circle finder gets where recognition made no mistake."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from processor.clean import AreaRule
from processor.discs import Discs, true_discs
from processor.experiments.work import Sample
from processor.trace import Cleaning, Mask, Recognition, Region
from recorder.records import SIDES, Labels, Side, counted_fruit


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """One true apple in one view.

    Attributes:
        side: of the view.
        apple_id: its label.
        circle: x, y, radius of its projected sphere, the truth.
        visible: fraction of it that is seen.
        touches: its seen pixels are connected with another apple's.
        cleaning: its own seen pixels, cleaned; the largest region alone.
    """

    side: Side
    apple_id: int
    circle: tuple[float, float, float]
    visible: float
    touches: bool
    cleaning: Cleaning

    @property
    def region(self) -> Region:
        """Its largest seen part."""
        return self.cleaning.regions[0]

    @property
    def roughness(self) -> float:
        """How far its contour leaves the true circle, as a share of the radius, on average."""
        x, y, radius = self.circle
        away = np.hypot(self.region.contour_px[:, 0] - x, self.region.contour_px[:, 1] - y)
        return float(np.abs(away - radius).mean() / radius)


def outlines(
    sample: Sample, window_px: tuple[float, float], sides: Sequence[Side] = SIDES
) -> Iterator[Outline]:
    """The outlines of all apples whose true radius is in the window, wholly in the picture."""
    for side in sides:
        labels = sample.labels(side)
        discs = discs_of(sample, side, labels)
        if labels is None or discs is None:
            continue
        height, width = labels.shape
        of_fruit = connected(labels)
        for number, apple_id in enumerate(discs.ids):
            x, y, radius = discs.circles[number].tolist()
            inside = radius <= x < width - radius and radius <= y < height - radius
            if not inside or not window_px[0] <= radius <= window_px[1]:
                continue
            mine = labels == apple_id
            cleaning = clean_alone(mine)
            if cleaning is None:
                continue
            yield Outline(
                side,
                apple_id,
                (x, y, radius),
                float(discs.visible[number]),
                len(of_fruit.get(apple_id, ())) > 1,
                cleaning,
            )


def discs_of(sample: Sample, side: Side, labels: Labels | None) -> Discs | None:
    """The true apples of a view; None where nobody said."""
    if sample.pair.truth is None:
        return None
    return true_discs(sample.pair.truth, side, labels, sample.rectification)


def clean_alone(mask: npt.NDArray[np.bool_]) -> Cleaning | None:
    """A mask cleaned by the paper's rule, its largest region alone; None where nothing is left."""
    cleaning = AreaRule()(as_recognition(mask))
    if not cleaning.regions:
        return None
    largest = max(cleaning.regions, key=lambda region: region.area_px)
    return Cleaning(cleaning.mask, (largest,))


def as_recognition(mask: npt.NDArray[np.bool_]) -> Recognition:
    """A true mask, as if it had been recognised."""
    bytes_of: Mask = np.where(mask, 255, 0).astype(np.uint8)
    return Recognition(bytes_of, bytes_of)


def connected(labels: Labels) -> dict[int, frozenset[int]]:
    """For each apple those that its pixels are connected with in the true mask, itself among them.

    An apple in several parts is with the apples of all of them.
    """
    mask = counted_fruit(labels).astype(np.uint8)
    _, parts = cv2.connectedComponents(mask, connectivity=8)
    both = np.stack([parts[mask > 0], labels[mask > 0].astype(np.int32)])
    members: dict[int, set[int]] = {}
    for part, apple in np.unique(both, axis=1).T.tolist():
        members.setdefault(part, set()).add(apple)
    found: dict[int, set[int]] = {}
    for group in members.values():
        for apple in group:
            found.setdefault(apple, set()).update(group)
    return {apple: frozenset(group) for apple, group in found.items()}
