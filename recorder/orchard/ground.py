"""What the trees stand on and between: soil, grass, fallen leaves, posts, wires, a drip line."""

from typing import Any, Final

import numpy as np

from recorder.orchard.engine import Surface, load_mitsuba, make_mesh
from recorder.orchard.leaf import LeafPlaces, grid_faces, grow_blades, paint_atlas
from recorder.orchard.material import colour, glossy, leaf_material, matt, soil_and_grass
from recorder.orchard.noise import Floats, blend, linear, srgb8, unit
from recorder.orchard.wood import Branch, branch_surface

ROW_PITCH_M: Final = 4.0
POST_SPACING_M: Final = 8.0
WIRE_HEIGHTS_M: Final = (0.75, 1.30, 1.85, 2.40)
_HALF_EXTENT_M: Final = 60.0
_GRASS_TILE_M: Final = (2.0, 2.7)  # along the row, across the alley
_BLADES: Final = 22_000  # of grass on one tile
_FALLEN: Final = 1500  # leaves


def ground_shapes(rng: np.random.Generator, row_y_m: float, length_m: float) -> dict[str, Any]:
    """Soil, grass and fallen leaves round a row of trees at that depth, and rows behind it."""
    extent = _HALF_EXTENT_M
    corners = np.array([[-extent, -extent, 0], [extent, -extent, 0],
                        [extent, 2 * extent, 0], [-extent, 2 * extent, 0]])  # fmt: skip
    v = (corners[:, 1] - row_y_m) / ROW_PITCH_M + 0.5  # the bare strip lies under the row
    plane = Surface(
        corners,
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.tile([0.0, 0, 1], (4, 1)),
        np.stack([corners[:, 0] / ROW_PITCH_M, v], 1),
    )
    shapes: dict[str, Any] = {
        "ground": make_mesh("ground", plane, soil_and_grass(rng, 1024, ROW_PITCH_M)),
        "grass": {"type": "shapegroup", "blades": _grass_tile(rng)},
        "fallen": _fallen_leaves(rng, row_y_m),
    }
    for alley in range(3):
        start_y_m = row_y_m + 0.65 + alley * ROW_PITCH_M
        tiles = int(np.ceil((length_m / 2 + 5 + 3 * alley) / _GRASS_TILE_M[0]))
        for i in range(-tiles, tiles):
            at = [i * _GRASS_TILE_M[0] + length_m / 2, start_y_m, 0.0]
            shapes[f"grass_{alley}_{i + tiles}"] = instance("grass", at)
    return shapes


def instance(group: str, at_m: list[float], turn_deg: float = 0, scale: float = 1) -> Any:
    """A copy of a group of shapes, standing there."""
    transform = load_mitsuba().ScalarTransform4f
    place = transform().translate(at_m).rotate([0, 0, 1], turn_deg).scale(scale)
    return {"type": "instance", "group": {"type": "ref", "id": group}, "to_world": place}


def _grass_tile(rng: np.random.Generator) -> Any:
    t = np.linspace(0, 1, 4)[None, :, None]
    s = np.array([-1.0, 1.0])[None, None]

    def draw(low: float, high: float) -> Floats:
        return np.asarray(rng.uniform(low, high, (_BLADES, 1, 1)))

    height, width = rng.gamma(6, 0.013, (_BLADES, 1, 1)), draw(0.0015, 0.003)
    bend, azimuth = draw(0.1, 1.5), draw(0, 2 * np.pi)
    tufts = rng.uniform(0, 1, (_BLADES // 12, 2)) * _GRASS_TILE_M
    roots = tufts[rng.integers(0, len(tufts), _BLADES)] + rng.normal(0, 0.025, (_BLADES, 2))
    roots %= _GRASS_TILE_M
    x, y = 0.7 * height * np.sin(bend * t) * np.ones_like(s), width * (1 - 0.9 * t) * s
    z = height * np.cos(0.8 * bend * t) * t * np.ones_like(s)
    points = np.stack([
        x * np.cos(azimuth) - y * np.sin(azimuth) + roots[:, 0, None, None],
        x * np.sin(azimuth) + y * np.cos(azimuth) + roots[:, 1, None, None],
        z,
    ], -1)  # fmt: skip
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), 0 * azimuth], -1) * np.ones_like(points)
    normals = unit(np.cross(np.gradient(points, axis=1), across))
    uv = np.stack(np.broadcast_arrays(rng.random((_BLADES, 1, 1)) + 0 * s, t), -1)
    uv = np.broadcast_to(uv, (*points.shape[:3], 2))
    faces = grid_faces(4, 2)[None] + (np.arange(_BLADES) * 8)[:, None, None]
    tile = Surface(points.reshape(-1, 3), faces.reshape(-1, 3), normals.reshape(-1, 3),
                   uv.reshape(-1, 2))  # fmt: skip
    return make_mesh("grass_blades", tile, leaf_material(_grass_colours(rng)))


def _grass_colours(rng: np.random.Generator) -> Any:
    """A strip of blades' colours, straw among them."""
    green = blend(linear([74, 102, 44]), linear([126, 140, 72]), rng.random((1, 256)))
    straw = rng.random((1, 256)) < 0.15
    strip = blend(green, linear([172, 160, 110]), straw)
    return srgb8(np.repeat(strip, 4, axis=0))


def _fallen_leaves(rng: np.random.Generator, row_y_m: float) -> Any:
    row = ROW_PITCH_M * rng.integers(0, 2, _FALLEN)
    bases = np.stack([
        rng.uniform(-4, 4, _FALLEN),
        np.clip(rng.normal(row_y_m, 0.9, _FALLEN), 0.3, 9) + row,
        rng.uniform(0.003, 0.02, _FALLEN),
    ], 1)  # fmt: skip
    directions = rng.standard_normal((_FALLEN, 3)) * [1, 1, 0.15]
    ups = np.array([0, 0, 1.0]) + 0.3 * rng.standard_normal((_FALLEN, 3))
    blades = grow_blades(rng, LeafPlaces(bases, unit(directions), unit(ups)), (5, 3))
    brown = srgb8(linear(paint_atlas(rng)) * np.array([1.9, 1.05, 0.9]))
    return make_mesh("fallen_leaves", blades.surface(), leaf_material(brown))


def trellis_shapes(
    rng: np.random.Generator, row_y_m: float, from_x_m: float, to_x_m: float
) -> tuple[dict[str, Any], list[Branch]]:
    """Posts, wires and the drip line of a row; also as branches, for fruit to keep clear of."""
    mi = load_mitsuba()
    behind_m = row_y_m + 0.07  # wires are stapled to the posts, behind the trunks
    first_m = from_x_m + rng.uniform(0, POST_SPACING_M)
    posts = [
        Branch(np.array([[x, behind_m + 0.05, -0.1], [x, behind_m + 0.05, 2.9]]),
               np.full(2, 0.045), 20)
        for x in np.arange(first_m, to_x_m, POST_SPACING_M)
    ]  # fmt: skip
    xs = np.linspace(from_x_m, to_x_m, 24)

    def line(height_m: float, radius_m: float, sag_m: float) -> Branch:
        heights = height_m - sag_m * np.abs(np.sin(np.pi * (xs - first_m) / POST_SPACING_M))
        points = np.stack([xs, np.full_like(xs, behind_m), heights], 1)
        return Branch(points, np.full(len(xs), radius_m), 8)

    wires = [line(height, 0.0014, 0.01) for height in WIRE_HEIGHTS_M]
    drip = line(0.42, 0.008, 0.05)
    concrete = mi.load_dict(matt(colour([172, 168, 160])))
    steel = mi.load_dict(glossy(colour([150, 152, 154]), 0.35))
    black = mi.load_dict(glossy(colour([34, 34, 36]), 0.5))
    shapes = {
        "wires": _tubes(rng, "wires", wires, steel),
        "drip_line": _tubes(rng, "drip_line", [drip], black),
    }
    if posts:
        shapes["posts"] = _tubes(rng, "posts", posts, concrete)
    return shapes, [*posts, *wires, drip]


def _tubes(rng: np.random.Generator, name: str, branches: list[Branch], material: Any) -> Any:
    return make_mesh(name, Surface.joined([branch_surface(rng, b) for b in branches]), material)
