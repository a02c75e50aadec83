"""An apple tree: trunk, laterals, shoots and spurs; where its leaves grow and its fruit hangs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from recorder.orchard.apple import Apple, grow_apple
from recorder.orchard.engine import Floats
from recorder.orchard.leaf import LeafPlaces
from recorder.orchard.noise import unit
from recorder.orchard.skin import Recipe
from recorder.orchard.wood import Branch, along, clearance_points, curve

GAP_M: Final = 0.001  # least air between a fruit and wood
_SKIN_STRIDE: Final = 3  # of a fruit's vertices, one in so many is asked: each 5 degrees
_CORE: Final = 0.8  # of a fruit's half width: what is nearer than this is surely inside it
_TRIES: Final = 6  # to hang one fruit clear of everything
_CLUSTER_SIZES: Final = ((1, 2, 3), (0.50, 0.34, 0.16))  # fruit on a spur, and how often
_WIDTH_SPREAD: Final = 0.06  # of the fruit on one tree


@dataclass(frozen=True, slots=True)
class TreeShape:
    """A young spindle tree.

    Attributes:
        height_m: of the leader.
        laterals: branches that leave the leader.
        leaf_density: leaves, as a multiple of a sparse tree's.
        near: whether a camera comes close enough to see burrs and veins.
    """

    height_m: float = 2.7
    laterals: int = 30
    leaf_density: float = 1.9
    near: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Spur:
    """A short fruiting shoot: its tip, which fruit hang from."""

    tip_m: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """What grew: wood, where leaves are, and the spurs that may bear."""

    branches: list[Branch]
    leaves: LeafPlaces
    spurs: list[Spur]


class _Growth:
    """The lists that one tree grows into."""

    def __init__(self, rng: np.random.Generator, shape: TreeShape) -> None:
        self.rng, self.shape = rng, shape
        self.branches: list[Branch] = []
        self.spurs: list[Spur] = []
        self.bases: list[Floats] = []
        self.directions: list[Floats] = []
        self.ups: list[Floats] = []

    def leaves(self, at_m: Floats, heading: Floats, count: int, forward: float) -> None:
        rng = self.rng
        for _ in range(count):
            out = unit(heading * forward + 0.75 * rng.standard_normal(3) + np.array([0, 0, 0.25]))
            self.bases.append(at_m + out * rng.uniform(0.008, 0.03))
            self.directions.append(out)
            self.ups.append(unit(np.array([0, 0, 1.0]) + 0.45 * rng.standard_normal(3)))

    def shoot(self, at_m: Floats, side: Floats, heading: Floats) -> None:
        """A leafy extension shoot, rising."""
        rng, near = self.rng, self.shape.near
        length_m = rng.uniform(0.06, 0.26)
        rise = unit(side + 0.5 * heading + np.array([0, 0, 0.55]))
        points = curve(rng, at_m, rise, length_m, 6, droop=0.3, wobble=0.08)
        self.branches.append(Branch(points, np.linspace(0.0026, 0.0013, 6), 6 if near else 3))
        count = max(2, int(length_m / 0.024 * self.shape.leaf_density))
        for i in range(count):
            self.leaves(*along(points, (i + 0.7) / count), 1, 0.55)

    def spur(self, at_m: Floats, side: Floats) -> None:
        """A fruiting spur with its rosette of leaves."""
        rng = self.rng
        tip = at_m + side * rng.uniform(0.006, 0.02)
        points = np.array([at_m, (at_m + tip) / 2, tip])
        radii = np.array([0.0028, 0.003, 0.0026])
        self.branches.append(Branch(points, radii, 6 if self.shape.near else 3))
        self.spurs.append(Spur(tip))
        self.leaves(tip, side, int(rng.poisson(3.4 * self.shape.leaf_density)), 0.4)

    def lateral(self, base_m: Floats, azimuth: float, rise: float, length_m: float) -> None:
        rng, near = self.rng, self.shape.near
        heading = [
            np.cos(azimuth) * np.cos(rise),
            0.8 * np.sin(azimuth) * np.cos(rise),  # trained flat, along the row
            np.sin(rise),
        ]
        points = curve(rng, base_m, heading, length_m, 16, droop=1.0, wobble=0.05)
        radii = np.linspace(0.0095, 0.0028, 16) * rng.uniform(0.8, 1.2)
        self.branches.append(Branch(points, radii, 12 if near else 4, rough=near))
        count = int(length_m / 0.05)
        for i in range(count):
            share = (i + rng.random()) / count
            if share < 0.12:
                continue
            at, forward = along(points, share)
            side = unit(np.cross(forward, rng.standard_normal(3)))
            if rng.random() < 0.34:
                self.shoot(at, side, forward)
            else:
                self.spur(at, side)


def grow_tree(rng: np.random.Generator, x_m: float, y_m: float, shape: TreeShape) -> Tree:
    """Grow a tree at that place of the row (x along the row, y away from the camera, z up)."""
    growth = _Growth(rng, shape)
    lean = [rng.normal(0, 0.03), rng.normal(0, 0.03), 1]
    trunk = curve(rng, [x_m, y_m, -0.02], lean, shape.height_m, 40, droop=0, wobble=0.035)
    radii = np.linspace(0.030, 0.009, 40) * rng.uniform(0.85, 1.15)
    growth.branches.append(Branch(trunk, radii, 26 if shape.near else 7, rough=shape.near))
    azimuth = rng.uniform(0, 2 * np.pi)
    for i in range(shape.laterals):
        share = (i + rng.random()) / shape.laterals
        azimuth += 2.4 + rng.normal(0, 0.3)  # the golden angle, as buds are set
        base = trunk[np.argmin(np.abs(trunk[:, 2] - (0.5 + share * (shape.height_m - 0.6))))]
        length_m = (0.85 - 0.5 * share) * rng.uniform(0.75, 1.15)
        growth.lateral(base, azimuth, rng.uniform(-0.15, 0.55), length_m)
    leaves = LeafPlaces(np.array(growth.bases), np.array(growth.directions), np.array(growth.ups))
    return Tree(growth.branches, leaves, growth.spurs)


class Wood:
    """All wood of a scene, to ask whether a fruit would touch it."""

    def __init__(self, branches: list[Branch]) -> None:
        from scipy.spatial import cKDTree

        self._points_m, self._radii_m = clearance_points(branches)
        self._index: Any = cKDTree(self._points_m)
        self._thickest_m = float(self._radii_m.max())

    def reaches(self, centre_m: Floats, radius_m: float) -> bool:
        """Whether the middle of any of it comes so near to that point: a quick first question."""
        return bool(self._index.query(centre_m)[0] < radius_m)

    def touches(self, apple: Apple) -> bool:
        """Whether any of the wood is nearer than `GAP_M` to the fruit's skin.

        Held against the skin's own points, so that a spur above the stem cavity may come close.
        """
        near = self._index.query_ball_point(
            apple.centre_m, apple.reach_m + self._thickest_m + GAP_M
        )
        if not near:
            return False
        offsets = self._points_m[near] - apple.centre_m
        gaps = np.linalg.norm(offsets, axis=1) - skin_reach(apple, offsets)
        return bool((gaps < self._radii_m[near] + GAP_M).any())


def skin_reach(apple: Apple, offsets_m: Floats) -> Floats:
    """How far the skin is from the fruit's centre in the direction of each (N, 3) offset."""
    spokes = apple.surface.points_m[::_SKIN_STRIDE] - apple.centre_m
    lengths = np.linalg.norm(spokes, axis=1)
    towards = unit(offsets_m) @ (spokes / lengths[:, None]).T
    return np.asarray(lengths[towards.argmax(1)])


def overlap(a: Apple, b: Apple) -> bool:
    """Whether one fruit's skin reaches into the other."""
    gap = b.centre_m - a.centre_m
    if np.linalg.norm(gap) > a.reach_m + b.reach_m:
        return False
    for inner, outer in ((a, b), (b, a)):
        offsets = inner.surface.points_m[::_SKIN_STRIDE] - outer.centre_m
        near = np.linalg.norm(offsets, axis=1) < outer.reach_m
        if (
            near.any()
            and (
                np.linalg.norm(offsets[near], axis=1) < skin_reach(outer, offsets[near]) + GAP_M / 2
            ).any()
        ):
            return True
    return False


def hang_fruit(
    rng: np.random.Generator,
    spurs: list[Spur],
    wood: Wood,
    recipe: Recipe,
    count: int,
    *,
    grid: tuple[int, int],
    allowed: Callable[[Floats], bool] = lambda _: True,
    others: tuple[Apple, ...] = (),
) -> list[Apple]:
    """Hang up to `count` fruit from those spurs in their order, clear of wood and each other.

    `others` are fruit that hang already; they are not returned.
    """
    apples: list[Apple] = []
    for spur in spurs:
        if len(apples) >= count:
            break
        size = int(rng.choice(_CLUSTER_SIZES[0], p=_CLUSTER_SIZES[1]))
        first: Apple | None = None
        for _ in range(size):
            taken = [*others, *apples]
            apple = _try_hanging(rng, spur, first, wood, recipe, taken, grid, allowed)
            if apple is not None:
                apples.append(apple)
                first = first or apple
    return apples


def _try_hanging(
    rng: np.random.Generator,
    spur: Spur,
    first: Apple | None,
    wood: Wood,
    recipe: Recipe,
    others: list[Apple],
    grid: tuple[int, int],
    allowed: Callable[[Floats], bool],
) -> Apple | None:
    """One fruit on that spur, the first below its tip, others beside the first; None: no room."""
    ratio = rng.uniform(*recipe.height_ratio)
    width_m = recipe.width_m * float(np.clip(rng.normal(1, _WIDTH_SPREAD), 0.85, 1.15))
    for _ in range(_TRIES):
        if first is None:
            below_m = width_m / 2 * ratio + rng.uniform(0.006, 0.020)
            centre = spur.tip_m + np.array([*rng.normal(0, 0.010, 2), -below_m])
        else:
            beside = unit([*rng.standard_normal(2), rng.normal(-0.1, 0.35)])
            centre = first.centre_m + beside * (first.radius_m + width_m / 2) * 1.03
        core_m = _CORE * width_m / 2 * min(1.0, ratio)
        if not allowed(centre) or wood.reaches(centre, core_m):
            continue
        if any(np.linalg.norm(a.centre_m - centre) < _CORE * a.radius_m + core_m for a in others):
            continue
        upwards = unit(spur.tip_m + np.array([0, 0, 0.02]) - centre)
        apple = grow_apple(
            rng,
            width_m=width_m,
            height_ratio=ratio,
            centre_m=centre,
            axis=unit(upwards + 0.25 * rng.standard_normal(3)),
            spur_m=spur.tip_m,
            grid=grid,
        )
        near = (a for a in others if np.linalg.norm(a.centre_m - centre) < 0.14)
        if not wood.touches(apple) and not any(overlap(apple, other) for other in near):
            return apple
    return None
