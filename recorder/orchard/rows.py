"""Everything behind the trees that matter: the same coarse stretches of row, copied."""

from typing import Any, Final

import numpy as np

from recorder.orchard import apple, leaf
from recorder.orchard.engine import make_mesh
from recorder.orchard.ground import ROW_PITCH_M, instance
from recorder.orchard.leaf import LeafPlaces, grow_blades
from recorder.orchard.material import Materials
from recorder.orchard.parts import fruit_surface, wood_shapes
from recorder.orchard.scene import Scene
from recorder.orchard.skin import RECIPES
from recorder.orchard.tree import TreeShape, Wood, grow_tree, hang_fruit

TREE_PITCH_M: Final = 1.15
BEHIND_ENDING: Final = "_fruit"  # of the names of meshes of fruit that nobody is asked to find
_BACK_TREES: Final = 4  # in one repeated stretch of a row behind
_SMALL_PX: Final = 400  # a picture narrower than this shows little of what is behind


def is_small(scene: Scene) -> bool:
    """Whether the pictures are so small that what nobody is asked to find may be simpler."""
    return scene.camera.size_px[0] < _SMALL_PX


def rows_behind(
    rng: np.random.Generator,
    scene: Scene,
    materials: Materials,
    *,
    row_y_m: float,
    from_x_m: float,
    to_x_m: float,
) -> dict[str, Any]:
    """The rest of the row, rows behind it and the one behind the cameras: stretches, repeated.

    Args:
        rng: of the trees.
        scene: how much fruit they bear, and of what cultivar.
        materials: the scene's.
        row_y_m: how far the near row's trunks are from the cameras.
        from_x_m: the near row's first trunk.
        to_x_m: its last.
    """
    shapes: dict[str, Any] = {}
    near = ("stretch_0", 1.6, (0.06, 0.10), leaf.FAR_GRID)
    far = ("stretch_1", 0.75, (0.09, 0.14), (3, 2))  # fewer and larger leaves cost less
    nearest = far[0] if is_small(scene) else near[0]
    for name, leaf_density, leaf_m, grid in (far,) if is_small(scene) else (near, far):
        shapes[name] = {
            "type": "shapegroup",
            **_stretch(rng, scene, materials, name, leaf_density, leaf_m, grid),
        }
    length_m = _BACK_TREES * TREE_PITCH_M
    beyond_m = (TREE_PITCH_M + length_m) / 2
    places = [(nearest, x, row_y_m) for x in (from_x_m - beyond_m, to_x_m + beyond_m)]
    middle_m, driven_m = (from_x_m + to_x_m) / 2, to_x_m - from_x_m - TREE_PITCH_M
    for row in range(1, 5):
        count = 2 + row + int(np.ceil(driven_m / length_m))
        for i in range(count):
            x = (i - (count - 1) / 2) * length_m + middle_m + rng.uniform(-0.4, 0.4)
            places.append((nearest if row == 1 else far[0], x, row_y_m + ROW_PITCH_M * row))
    places += [(far[0], i * length_m, row_y_m - ROW_PITCH_M) for i in (-0.5, 0.5)]
    for n, (group, x, y) in enumerate(places):
        turn, scale = 180.0 * int(rng.integers(2)), float(rng.uniform(0.96, 1.06))
        shapes[f"copy_{n}"] = instance(group, [float(x), float(y), 0.0], turn, scale)
    return shapes


def _stretch(
    rng: np.random.Generator,
    scene: Scene,
    materials: Materials,
    name: str,
    leaf_density: float,
    length_m: tuple[float, float],
    grid: tuple[int, int],
) -> dict[str, Any]:
    """Four trees round the origin, coarse enough for where they stand."""
    shape = TreeShape(leaf_density=leaf_density, near=False)
    xs = (np.arange(_BACK_TREES) - (_BACK_TREES - 1) / 2) * TREE_PITCH_M
    trees = [grow_tree(rng, x + rng.normal(0, 0.08), rng.normal(0, 0.05), shape) for x in xs]
    branches = [b for tree in trees for b in tree.branches if b.sides > 3]
    blades = grow_blades(rng, LeafPlaces.joined([t.leaves for t in trees]), grid, length_m)
    shapes = wood_shapes(rng, branches, materials, name)
    shapes[f"{name}_leaves"] = make_mesh(f"{name}_leaves", blades.surface(), materials.leaf)
    count = min(scene.trees.fruit, 10 if is_small(scene) else 40)
    if count and scene.specimen is None:
        wood = Wood(branches)
        apples = []
        for tree in trees:
            spurs = [tree.spurs[i] for i in rng.permutation(len(tree.spurs))]
            apples += hang_fruit(rng, spurs, wood, RECIPES[scene.cultivar], count,
                                 grid=apple.FAR_GRID)  # fmt: skip
        surface = fruit_surface(rng, apples)
        shapes[f"{name}_fruit"] = make_mesh(f"{name}_fruit", surface, materials.skin)
    return shapes
