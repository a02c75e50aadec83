"""One apple's shape: an oblate solid with a stem cavity, a calyx basin, five lobes and a lean."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from recorder.orchard.engine import Floats, Surface
from recorder.orchard.leaf import grid_faces
from recorder.orchard.noise import unit

NEAR_GRID: Final = (56, 80)  # vertices (pole to pole, around)
FAR_GRID: Final = (12, 16)


@dataclass(frozen=True, slots=True, eq=False)
class Apple:
    """An apple and where it hangs.

    Attributes:
        centre_m: (3,), the centroid of its volume, in the world.
        radius_m: of the sphere of the same volume.
        reach_m: the furthest point of its skin from the centre.
        axis: (3,), unit, from the calyx to the stem.
        spur_m: (3,), where its stem leaves the wood.
        surface: its skin in the world.
    """

    centre_m: Floats
    radius_m: float
    reach_m: float
    axis: Floats
    spur_m: Floats
    surface: Surface
    cavity_m: Floats  # (3,) the floor of the stem cavity


def grow_apple(
    rng: np.random.Generator,
    *,
    width_m: float,
    height_ratio: float,
    centre_m: Floats,
    axis: Floats,
    spur_m: Floats,
    grid: tuple[int, int],
) -> Apple:
    """Shape an apple of that greatest width and hang it with its centroid at `centre_m`."""
    solid, cavity = _solid(rng, height_ratio, grid)
    solid, cavity = solid * (width_m / 2), cavity * (width_m / 2)
    faces = grid_faces(*grid)
    centroid, volume = _centroid_and_volume(solid.reshape(-1, 3), faces)
    solid, cavity = solid - centroid, cavity - centroid
    up = unit(axis)
    x = unit(np.cross(up, unit(rng.standard_normal(3))))
    turn = np.stack([x, np.cross(up, x), up], -1)
    theta, phi = np.linspace(0, 1, grid[0]), np.linspace(0, 1, grid[1])
    uv = np.stack(np.meshgrid(phi, theta, indexing="xy"), -1)
    surface = Surface(
        solid.reshape(-1, 3) @ turn.T + centre_m,
        faces,
        _normals(solid).reshape(-1, 3) @ turn.T,
        uv.reshape(-1, 2),
    )
    return Apple(
        centre_m=np.asarray(centre_m, float),
        radius_m=float((3 * volume / (4 * np.pi)) ** (1 / 3)),
        reach_m=float(np.linalg.norm(solid, axis=-1).max()),
        axis=up,
        spur_m=np.asarray(spur_m, float),
        surface=surface,
        cavity_m=turn @ cavity + centre_m,
    )


def _solid(
    rng: np.random.Generator, height_ratio: float, grid: tuple[int, int]
) -> tuple[Floats, Floats]:
    """The (rows, columns, 3) skin of an apple one unit in half width, and its cavity's floor."""
    theta = np.linspace(0, np.pi, grid[0])[:, None]
    phi = np.linspace(0, 2 * np.pi, grid[1])[None]
    phase = rng.uniform(0, 2 * np.pi, 5)
    s, c = np.sin(theta), np.cos(theta)
    rho = s**0.9 * (1 + rng.uniform(0.03, 0.09) * c)  # broader at the shoulders
    cavity_depth, cavity_width = rng.uniform(0.22, 0.32), rng.uniform(0.26, 0.36)
    basin_depth, basin_width = rng.uniform(0.13, 0.20), rng.uniform(0.26, 0.34)
    z = height_ratio * np.sign(c) * np.abs(c) ** 0.92 * np.ones_like(phi)
    z = z - np.where(c > 0, cavity_depth * np.exp(-((rho / cavity_width) ** 2)), 0)
    z = z + np.where(c < 0, basin_depth * np.exp(-((rho / basin_width) ** 2)), 0)
    lobes = 0.018 * (theta / np.pi) ** 3 * np.cos(5 * phi + phase[0])  # five, towards the calyx
    for order, height in ((1, 0.012), (2, 0.010), (3, 0.008)):
        lobes = lobes + height * s * np.cos(order * phi + phase[order])
    rho = rho * (1 + lobes)
    rho = rho / rho.max()
    z = z + 0.03 * rho * np.cos(phi + phase[4])  # lopsided shoulders
    solid = np.stack([rho * np.cos(phi), rho * np.sin(phi), z], -1)
    solid[:, -1] = solid[:, 0]
    return solid, solid[0, 0]


def _normals(solid: Floats) -> Floats:
    around = np.gradient(solid, axis=1)
    around[:, 0] = around[:, -1] = solid[:, 1] - solid[:, -2]
    normals = unit(np.cross(np.gradient(solid, axis=0), around))
    normals[0], normals[-1] = (0, 0, 1), (0, 0, -1)
    inward = np.sum(normals * solid) < 0
    return np.asarray(-normals if inward else normals)


def _centroid_and_volume(points_m: Floats, faces: np.ndarray) -> tuple[Floats, float]:
    """Of a closed mesh, summed over the tetrahedra from the origin to each face."""
    a, b, c = (points_m[faces[:, k]] for k in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    total = float(volumes.sum())
    centroid = (volumes[:, None] * (a + b + c) / 4).sum(0) / total
    return np.asarray(centroid), abs(total)
