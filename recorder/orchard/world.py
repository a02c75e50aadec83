"""A grown world: one row of trees near the cameras, rows behind, or a room; its fruit; its light.

What grows depends on the seed alone. Light has its own stream of randomness, so that one tree can
be seen in every light.
"""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from recorder.orchard import apple as apple_shape
from recorder.orchard import leaf as leaf_shape
from recorder.orchard.apple import Apple
from recorder.orchard.camera import CAMERA_HEIGHT_M, rig_pose
from recorder.orchard.engine import Floats, make_mesh
from recorder.orchard.ground import ground_shapes, trellis_shapes
from recorder.orchard.leaf import Blades, LeafPlaces, grow_blades
from recorder.orchard.light import daylight
from recorder.orchard.material import SKINS, Materials, orchard_materials, plastic_fruit
from recorder.orchard.parts import fruit_surface, stem_surface, wood_shapes
from recorder.orchard.room import room_shapes
from recorder.orchard.rows import TREE_PITCH_M, is_small, rows_behind
from recorder.orchard.scene import Scene, Shot
from recorder.orchard.skin import RECIPES
from recorder.orchard.specimen import HungFruit, hang_specimen
from recorder.orchard.tree import Tree, TreeShape, Wood, grow_tree, hang_fruit
from recorder.orchard.wood import Branch

NEAREST_WOOD_M: Final = 0.45  # nothing grows into the lenses
NEAREST_FRUIT_M: Final = 0.62
_BEHIND_SPECIMEN_M: Final = 0.07  # from its skin to the first of the tree
_STREAMS: Final = ("trees", "fruit", "leaves", "paint", "behind", "ground", "trellis", "light",
                   "hung", "wind")  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class FruitMesh:
    """A mesh of whole apples: face f belongs to the apple `first + f // faces_each`, from 0."""

    name: str
    first: int
    count: int
    faces_each: int


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """What Mitsuba is given, and what truth needs to know of it.

    Attributes:
        shapes: Mitsuba's scene, as a dictionary.
        apples: apple n of the labels is `apples[n - 1]`.
        fruit: which meshes hold them.
        sun_direction: (3,) towards the sun, or None.
        swinging: {mesh name: (N, V, 3) points at rest} of what the wind moves.
        swing: (apples + leaves, ...) phases and rates by mesh name, (N, 3): phase, rate, direction.
    """

    shapes: dict[str, Any]
    apples: list[Apple]
    fruit: list[FruitMesh]
    sun_direction: Floats | None
    swinging: dict[str, Floats] = field(default_factory=dict)
    swing: dict[str, Floats] = field(default_factory=dict)

    def offsets_m(self, name: str, time_s: float, reach_m: float) -> Floats:
        """(N, 3) how far the wind has moved each body of a mesh from its rest."""
        phase, rate_hz, azimuth = self.swing[name].T
        sway = reach_m * np.sin(phase + 2 * np.pi * rate_hz * time_s)
        return np.stack([sway * np.cos(azimuth), sway * np.sin(azimuth), 0 * sway], 1)


def grow_world(scene: Scene, shot: Shot) -> World:
    """Grow everything in sight of that shot."""
    seeds = {name: [shot.seed, n] for n, name in enumerate(_STREAMS)}
    rngs = {name: np.random.default_rng(seed) for name, seed in seeds.items()}
    materials = orchard_materials(
        rngs["paint"],
        scene.cultivar,
        dew=scene.dew,
        plastic=scene.place == "room",
        skins=2 if is_small(scene) else SKINS,
    )
    near = _NearRow(scene, shot, rngs)
    shapes: dict[str, Any] = {"type": "scene"}
    trellis: list[Branch] = []
    sun = None
    if scene.place == "orchard":
        made, trellis = trellis_shapes(
            rngs["trellis"], near.row_y_m, -3 * TREE_PITCH_M, near.length_m + 3 * TREE_PITCH_M
        )
        shapes |= made
        shapes |= ground_shapes(rngs["ground"], near.row_y_m, near.length_m)
        trunks = [tree.branches[0].points_m[0, 0] for tree in near.trees]
        shapes |= rows_behind(
            rngs["behind"], scene, materials,
            row_y_m=near.row_y_m, from_x_m=min(trunks), to_x_m=max(trunks),
        )  # fmt: skip
        sky = daylight(rngs["light"], scene.light)
        shapes["light"], sun = sky.emitter, sky.sun_direction
    else:
        shapes |= room_shapes(rngs["ground"])
    return near.world(shapes, trellis, materials, sun)


class _NearRow:
    """The trees before the cameras, with their fruit, and what hangs in front of them."""

    def __init__(self, scene: Scene, shot: Shot, rngs: dict[str, np.random.Generator]) -> None:
        self.scene, self.rngs = scene, rngs
        self.recipe = RECIPES[scene.cultivar]
        self.hung: HungFruit | None = None
        self.row_y_m, self.free_to_m = scene.trees.depth_m, NEAREST_WOOD_M
        motion = scene.motion
        self.length_m = motion.speed_m_s * motion.pairs / motion.rate_hz if motion else 0.0
        if scene.specimen and shot.range_m:
            pose = rig_pose(scene.make_rig(), 0.0)
            self.hung = hang_specimen(rngs["hung"], scene.specimen, shot.range_m, self.recipe, pose)
            reach_m = max(a.centre_m[1] + a.reach_m for a in self.hung.apples)
            self.free_to_m = reach_m + _BEHIND_SPECIMEN_M
            self.row_y_m = max(self.row_y_m, self.free_to_m + 0.35)
        self.trees = self._grow(rngs["trees"])

    def _grow(self, rng: np.random.Generator) -> list[Tree]:
        indoors = self.scene.place == "room"
        shape = TreeShape(height_m=2.2 if indoors else 2.7,
                          leaf_density=self.scene.trees.leaf_density)  # fmt: skip
        xs = [-0.42, 0.72, *np.arange(0.72 + TREE_PITCH_M, self.length_m + 0.9, TREE_PITCH_M)]
        return [
            grow_tree(rng, x + rng.uniform(-0.1, 0.1), self.row_y_m + rng.uniform(-0.06, 0.06),
                      shape)
            for x in xs
        ]  # fmt: skip

    def _fruit(self, wood: Wood) -> list[Apple]:
        rng = self.rngs["fruit"]
        nearest_m = max(NEAREST_FRUIT_M, self.free_to_m + 0.05)
        apples: list[Apple] = []
        for tree in self.trees:
            # spurs that the cameras see bear first, as a picker would stand before a good place
            seen = [self._exposure(spur.tip_m) * rng.random() for spur in tree.spurs]
            spurs = [tree.spurs[i] for i in np.argsort(seen)[::-1]]
            apples += hang_fruit(
                rng, spurs, wood, self.recipe, self.scene.trees.fruit,
                grid=apple_shape.NEAR_GRID, allowed=lambda c: bool(c[1] > nearest_m),
                others=tuple(apples),
            )  # fmt: skip
        return apples

    def _exposure(self, at_m: Floats) -> float:
        middle = np.clip(at_m[0], 0.1, 0.1 + self.length_m)
        x, z, y = at_m[0] - middle, at_m[2] - CAMERA_HEIGHT_M, at_m[1] - self.row_y_m + 0.20
        return float(np.exp(-((x / 0.6) ** 2) - (z / 0.55) ** 2 - (y / 0.35) ** 2))

    def _in_front(self, points_m: Floats) -> bool:
        return bool(points_m[..., 1].min() > self.free_to_m)

    def world(
        self,
        shapes: dict[str, Any],
        trellis: list[Branch],
        materials: Materials,
        sun: Floats | None,
    ) -> World:
        """Everything near as meshes, added to `shapes`."""
        grown = [b for t in self.trees for b in t.branches if self._in_front(b.points_m)]
        hung = self.hung
        hung_fruit = hung.apples if hung else []
        wood = grown + (hung.branches if hung else [])
        on_trees = self._fruit(Wood(wood + trellis)) if self.scene.trees.fruit else []
        indoors = self.scene.place == "room"
        skin = plastic_fruit(self.rngs["paint"]) if indoors and on_trees else materials.skin
        rng = self.rngs["fruit"]
        fruit: list[FruitMesh] = []
        swinging, swing = {}, {}
        for name, first, apples, material in (
            ("hung_fruit", 0, hung_fruit, materials.skin),
            ("fruit", len(hung_fruit), on_trees, skin),
        ):
            if apples:
                shapes[name] = make_mesh(name, fruit_surface(rng, apples), material)
                faces_each = len(apples[0].surface.faces)
                fruit.append(FruitMesh(name, first, len(apples), faces_each))
                swinging[name] = np.stack([a.surface.points_m for a in apples])
        everything = hung_fruit + on_trees
        blades = self._leaves(everything, hung)
        shapes["leaves"] = make_mesh("leaves", blades.surface(), materials.leaf)
        swinging["leaves"] = blades.points_m
        for name, points in swinging.items():
            wind = self.rngs["wind"]
            swing[name] = np.stack([wind.uniform(0, 6.28, len(points)),
                                    wind.uniform(0.8, 1.6, len(points)),
                                    wind.normal(0.3, 0.3, len(points))], 1)  # fmt: skip
        shapes |= wood_shapes(rng, wood, materials, "near")
        if everything:
            shapes["stems"] = make_mesh("stems", stem_surface(rng, everything), materials.stem)
        return World(shapes, everything, fruit, sun, swinging, swing)

    def _leaves(self, apples: list[Apple], hung: HungFruit | None) -> Blades:
        places = LeafPlaces.joined([tree.leaves for tree in self.trees])
        blades = grow_blades(self.rngs["leaves"], places, leaf_shape.NEAR_GRID)
        keep = (blades.points_m[..., 1] > self.free_to_m).all(1)
        keep &= ~_inside_fruit(blades.points_m, apples)
        grown = blades.where(keep)
        return Blades.joined([hung.leaves, grown]) if hung else grown


def _inside_fruit(points_m: Floats, apples: list[Apple]) -> Any:
    """(N,) which of N blades reach into a fruit."""
    from scipy.spatial import cKDTree

    if not apples:
        return np.zeros(len(points_m), bool)
    index: Any = cKDTree(np.array([a.centre_m for a in apples]))
    distance, nearest = index.query(points_m.reshape(-1, 3))
    reach = np.array([a.reach_m for a in apples])[nearest]
    return (distance < reach * 0.98).reshape(len(points_m), -1).any(1)
