"""The distance series' subject: an apple hung before the tree, bare, behind leaves, by a fruit."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from recorder.orchard.apple import NEAR_GRID, Apple, grow_apple
from recorder.orchard.camera import RigPose, View
from recorder.orchard.engine import Floats
from recorder.orchard.leaf import NEAR_GRID as LEAF_GRID
from recorder.orchard.leaf import Blades, LeafPlaces, grow_blades
from recorder.orchard.noise import unit
from recorder.orchard.scene import Specimen
from recorder.orchard.skin import Recipe
from recorder.orchard.tree import overlap
from recorder.orchard.wood import Branch, curve
from recorder.records import SIDES

_HANG_M: Final = 0.9  # length of the twig that it hangs from
_CANDIDATES: Final = 240  # leaves tried in front of it
_TOLERANCE: Final = 0.04  # of the hidden fraction


@dataclass(frozen=True, slots=True, eq=False)
class HungFruit:
    """The fruit of the series (the measured one first), its twig, and leaves before it."""

    apples: list[Apple]
    branches: list[Branch]
    leaves: Blades


def hang_specimen(
    rng: np.random.Generator, wanted: Specimen, range_m: float, recipe: Recipe, pose: RigPose
) -> HungFruit:
    """Hang an apple midway between both cameras, its centre at that depth."""
    middle_m = pose.rig.baseline_m / 2
    centre = pose.to_world(np.array([[middle_m, 0.0, range_m]]))[0]
    ratio = float(np.mean(recipe.height_ratio))
    width_m = recipe.width_m * rng.uniform(0.97, 1.06)
    spur = centre + np.array([0.0, 0.004, width_m / 2 * ratio + 0.02])
    measured = grow_apple(
        rng,
        width_m=width_m,
        height_ratio=ratio,
        centre_m=centre,
        axis=unit(np.array([0.1, 0.1, 1.0]) * [*rng.standard_normal(2), 1]),
        spur_m=spur,
        grid=NEAR_GRID,
    )
    rise = curve(rng, spur, [rng.normal(0, 0.2), 0.25, 1], _HANG_M, 14, droop=0, wobble=0.03)
    twig = Branch(rise, np.linspace(0.0026, 0.006, 14), 10)
    apples, leaves = [measured], grow_blades(rng, _spur_leaves(rng, spur), LEAF_GRID)
    if wanted.hidden_by == "fruit":
        apples.append(_neighbour(rng, measured, recipe))
    if wanted.hidden_by == "leaves":
        cover = _covering_leaves(rng, measured, pose, wanted.hidden_fraction)
        leaves = Blades.joined([leaves, cover])
    return HungFruit(apples, [twig], leaves)


def _spur_leaves(rng: np.random.Generator, spur_m: Floats) -> LeafPlaces:
    """A few leaves above the fruit, rising away from the cameras, that hide nothing of it."""
    count = 5
    out = unit(rng.normal(0, 1, (count, 3)) * [1, 0.4, 0.2] + [0, 0.3, 0.9])
    bases = spur_m + out * rng.uniform(0.02, 0.05, (count, 1))
    return LeafPlaces(bases, out, unit(rng.normal(0, 0.5, (count, 3)) + np.array([0, -1, 0.6])))


def _neighbour(rng: np.random.Generator, first: Apple, recipe: Recipe) -> Apple:
    """A second fruit that touches the first and covers a side of it, for both cameras."""
    side = float(rng.choice([-1.0, 1.0]))
    for gap in np.linspace(0.92, 1.4, 25):  # towards the cameras and aside, until just clear
        aside = np.array([side * 0.62, -0.78, rng.uniform(-0.12, 0.12)])
        centre = first.centre_m + unit(aside) * gap * 2 * first.radius_m
        second = grow_apple(
            rng,
            width_m=recipe.width_m * 0.97,
            height_ratio=float(np.mean(recipe.height_ratio)),
            centre_m=centre,
            axis=unit([0.15 * side, 0.1, 1.0]),
            spur_m=first.spur_m + np.array([0, 0, 0.03]),
            grid=NEAR_GRID,
        )
        if not overlap(first, second):
            break
    return second


def _covering_leaves(
    rng: np.random.Generator, apple: Apple, pose: RigPose, fraction: float
) -> Blades:
    """Leaves just before the fruit that hide that fraction of its outline, the views averaged.

    Leaves are tried in turn and kept where they bring the hidden share nearer to what is wanted.
    """
    count = _CANDIDATES
    across = rng.uniform(-1.1, 1.1, (count, 2)) * apple.reach_m
    before = apple.reach_m + rng.uniform(0.012, 0.035, count)
    bases = apple.centre_m + np.stack([across[:, 0], -before, across[:, 1] + 0.03], 1)
    downwards = unit(rng.normal(0, 0.6, (count, 3)) * [1, 0.25, 1] + [0, -0.1, -0.6])
    ups = unit(rng.normal(0, 0.3, (count, 3)) + np.array([0, -1.0, 0.35]))
    blades = grow_blades(rng, LeafPlaces(bases, downwards, ups), LEAF_GRID)
    clear = np.linalg.norm(blades.points_m - apple.centre_m, axis=2).min(1) > apple.reach_m
    views = [pose.view(side) for side in SIDES]
    outlines = [_outline(view, apple) for view in views]
    hidden = [np.zeros_like(outline[0]) for outline in outlines]
    kept: list[int] = []
    reached = 0.0
    for n in np.flatnonzero(clear):
        tried = [
            mask | _leaf_mask(view, blades.points_m[n], blades.faces, corner, mask.shape)
            for view, mask, (_, corner) in zip(views, hidden, outlines, strict=True)
        ]
        share = float(np.mean([
            (mask & outline).sum() / outline.sum()
            for mask, (outline, _) in zip(tried, outlines, strict=True)
        ]))  # fmt: skip
        if reached < share <= fraction + _TOLERANCE:
            kept.append(int(n))
            hidden, reached = tried, share
        if reached >= fraction - _TOLERANCE / 2:
            break
    chosen = np.zeros(count, bool)
    chosen[kept] = True
    return blades.where(chosen)


Mask = npt.NDArray[np.uint8]


def _outline(view: View, apple: Apple) -> tuple[Mask, Floats]:
    """The apple's outline as a filled picture, and the pixel of its first corner."""
    seen = view.project(apple.surface.points_m)
    corner = np.floor(seen.min(0)) - 2
    size = np.ceil(seen.max(0) - corner).astype(int) + 4
    mask = np.zeros((size[1], size[0]), np.uint8)
    hull = cv2.convexHull((seen - corner).astype(np.float32))
    cv2.fillConvexPoly(mask, np.round(hull).astype(np.int32), (1,))
    return mask, np.asarray(corner)


def _leaf_mask(
    view: View,
    points_m: Floats,
    faces: npt.NDArray[np.int64],
    corner: Floats,
    size: tuple[int, ...],
) -> Mask:
    mask = np.zeros(size, np.uint8)
    pixels = np.round(view.project(points_m) - corner).astype(np.int32)
    for triangle in pixels[faces]:
        cv2.fillConvexPoly(mask, triangle, (1,))
    return mask
