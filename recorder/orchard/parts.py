"""Grown things as meshes: many apples, stems or branches made one surface."""

from typing import Any, Final

import numpy as np

from recorder.orchard.apple import Apple
from recorder.orchard.engine import Surface, make_mesh
from recorder.orchard.material import SKINS, Materials
from recorder.orchard.wood import Branch, branch_surface

_THICK_M: Final = 0.007  # wood this thick has bark, thinner a twig's skin


def fruit_surface(rng: np.random.Generator, apples: list[Apple]) -> Surface:
    """All those apples as one mesh, each with one of the atlas's skins."""
    surfaces = []
    for fruit in apples:
        uv = np.clip(fruit.surface.uv, 0.002, 0.998)
        uv = (uv + np.array([int(rng.integers(SKINS)), 0])) / [SKINS, 1]
        surfaces.append(Surface(fruit.surface.points_m, fruit.surface.faces,
                                fruit.surface.normals, uv))  # fmt: skip
    return Surface.joined(surfaces)


def stem_surface(rng: np.random.Generator, apples: list[Apple], sides: int = 7) -> Surface:
    """Their stems, each from its cavity's floor in a bow to its spur."""
    s = np.linspace(0, 1, 9)[:, None]
    radii = np.concatenate([np.linspace(0.0015, 0.0012, 7), [0.0016, 0.0022]])
    stems = []
    for fruit in apples:
        start = fruit.cavity_m - fruit.axis * 0.001
        bow = start + fruit.axis * 0.6 * np.linalg.norm(fruit.spur_m - start)
        points = (1 - s) ** 2 * start + 2 * s * (1 - s) * bow + s**2 * fruit.spur_m
        stems.append(branch_surface(rng, Branch(points, radii, sides)))
    return Surface.joined(stems)


def wood_shapes(
    rng: np.random.Generator, branches: list[Branch], materials: Materials, tag: str
) -> dict[str, Any]:
    """Branches as two meshes: bark on the thick ones, a smooth skin on twigs."""
    thick = [branch_surface(rng, b) for b in branches if b.radii_m[0] > _THICK_M]
    thin = [branch_surface(rng, b) for b in branches if b.radii_m[0] <= _THICK_M]
    shapes = {}
    for name, parts, material in (("wood", thick, materials.bark), ("twigs", thin, materials.twig)):
        if parts:
            shapes[f"{tag}_{name}"] = make_mesh(f"{tag}_{name}", Surface.joined(parts), material)
    return shapes
