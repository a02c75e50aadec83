"""Apple leaves: their shapes, where they hang, and the atlas their blades are painted from."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from recorder.orchard.engine import Floats, Surface
from recorder.orchard.noise import Image, blend, field, linear, srgb8, unit

ATLAS_SIDE: Final = 4  # blades in a row, and rows, of the atlas
BLADE_PX: Final = (192, 128)  # of one blade in the atlas: (rows along the midrib, columns)
NEAR_GRID: Final = (12, 7)  # vertices of one blade (along, across)
FAR_GRID: Final = (4, 3)  # of a blade some metres away
LENGTH_M: Final = (0.055, 0.098)  # of an apple's leaf blade


@dataclass(frozen=True, slots=True, eq=False)
class LeafPlaces:
    """Where leaves grow: (N, 3) base points, (N, 3) directions along the blade, (N, 3) ups."""

    bases_m: Floats
    directions: Floats
    ups: Floats

    @staticmethod
    def joined(parts: "list[LeafPlaces]") -> "LeafPlaces":
        """All of them, in order."""
        return LeafPlaces(
            np.concatenate([p.bases_m for p in parts]),
            np.concatenate([p.directions for p in parts]),
            np.concatenate([p.ups for p in parts]),
        )

    def __len__(self) -> int:
        return len(self.bases_m)


@dataclass(frozen=True, slots=True, eq=False)
class Blades:
    """N leaf blades of one grid: (N, V, 3) points and normals, (N, V, 2) uv, (F, 3) faces."""

    points_m: Floats
    normals: Floats
    uv: Floats
    faces: npt.NDArray[np.int64]

    @staticmethod
    def joined(parts: "list[Blades]") -> "Blades":
        """All of them, in order; their grids are equal."""
        return Blades(
            np.concatenate([p.points_m for p in parts]),
            np.concatenate([p.normals for p in parts]),
            np.concatenate([p.uv for p in parts]),
            parts[0].faces,
        )

    def where(self, keep: npt.NDArray[np.bool_]) -> "Blades":
        """Only those."""
        return Blades(self.points_m[keep], self.normals[keep], self.uv[keep], self.faces)

    def surface(self) -> Surface:
        """One mesh of all of them; blade n owns faces n*F .. (n+1)*F."""
        count, vertices = self.points_m.shape[:2]
        faces = self.faces[None] + (np.arange(count) * vertices)[:, None, None]
        return Surface(
            self.points_m.reshape(-1, 3),
            faces.reshape(-1, 3),
            self.normals.reshape(-1, 3),
            self.uv.reshape(-1, 2),
        )


def grid_faces(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """The (F, 3) triangles of a grid of vertices, row by row."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    k = (i * columns + j).ravel()
    lower = np.stack([k, k + columns, k + 1], 1)
    upper = np.stack([k + 1, k + columns, k + columns + 1], 1)
    return np.stack([lower, upper], 1).reshape(-1, 3).astype(np.int64)


def grow_blades(
    rng: np.random.Generator,
    places: LeafPlaces,
    grid: tuple[int, int],
    length_m: tuple[float, float] = LENGTH_M,
) -> Blades:
    """Fold, curl, twist and wave a blade at every place.

    A blade is made along x with its upper side to z, then turned where it grows. The rows of its
    edge step in and out a little, as the saw teeth of an apple leaf do.
    """
    count = len(places)
    along, across = grid

    def draw(low: float, high: float) -> Floats:
        return np.asarray(rng.uniform(low, high, (count, 1, 1)))

    t = np.linspace(0, 1, along)[None, :, None]
    s = np.linspace(-1, 1, across)[None, None, :]
    length = draw(*length_m)
    half_width = draw(0.23, 0.31) * length
    outline = np.sin(np.pi * np.clip(t, 0, 1) ** 0.82) ** 0.8 * (1 - 0.25 * t**4)
    outline[:, [0, -1]] = 0.02
    outline = outline * (1 + 0.045 * (-1.0) ** np.arange(along)[None, :, None] * (along > 8))
    fold, curl, twist = draw(0.05, 0.75), draw(-0.3, 1.9), rng.normal(0, 0.45, (count, 1, 1))
    wave = np.sin(2 * np.pi * t * draw(1.5, 3) + draw(0, 6.28) + np.where(s > 0, 1.3, 0))
    y = half_width * outline * s * np.cos(fold)
    z = half_width * outline * (np.abs(s) * np.sin(fold) + 0.16 * s**2 * wave)
    turn = twist * t
    y, z = y * np.cos(turn) - z * np.sin(turn), y * np.sin(turn) + z * np.cos(turn)
    bend = curl * t
    safe = np.where(np.abs(curl) > 1e-3, curl, 1)
    rib_x = length * np.where(np.abs(curl) > 1e-3, np.sin(bend) / safe, t)
    rib_z = -length * np.where(np.abs(curl) > 1e-3, (1 - np.cos(bend)) / safe, 0)
    x, z = rib_x + z * np.sin(bend), rib_z + z * np.cos(bend)
    points = np.stack(np.broadcast_arrays(x, y, z), -1)
    normals = unit(np.cross(np.gradient(points, axis=1), np.gradient(points, axis=2)))
    cell = rng.integers(0, ATLAS_SIDE, (2, count, 1, 1))
    u = (cell[0] + 0.04 + 0.92 * (s + 1) / 2) / ATLAS_SIDE + 0 * t
    v = (cell[1] + 0.02 + 0.96 * t) / ATLAS_SIDE + 0 * s
    frames, vertices = _frames(places), along * across
    turned = np.einsum("nij,nvj->nvi", frames, points.reshape(count, vertices, 3))
    return Blades(
        turned + places.bases_m[:, None],
        np.einsum("nij,nvj->nvi", frames, normals.reshape(count, vertices, 3)),
        np.stack([u, v], -1).reshape(count, vertices, 2),
        grid_faces(along, across),
    )


def _frames(places: LeafPlaces) -> Floats:
    """(N, 3, 3) rotations from a blade's own frame to the world."""
    x = unit(places.directions)
    y = unit(np.cross(places.ups, x))
    return np.stack([x, y, np.cross(x, y)], -1)


def paint_atlas(rng: np.random.Generator, *, plastic: bool = False) -> npt.NDArray[np.uint8]:
    """Sixteen upper sides: veins, blotches, an ageing blade here and there."""
    rows, columns = BLADE_PX
    atlas = np.zeros((ATLAS_SIDE * rows, ATLAS_SIDE * columns, 3), np.uint8)
    for i in range(ATLAS_SIDE):
        for j in range(ATLAS_SIDE):
            blade = _paint_blade(rng, plastic=plastic)
            atlas[i * rows : (i + 1) * rows, j * columns : (j + 1) * columns] = srgb8(blade)
    return atlas


def _paint_blade(rng: np.random.Generator, *, plastic: bool) -> Image:
    rows, columns = BLADE_PX
    y = np.linspace(0, 1, rows)[:, None]
    x = np.linspace(-1, 1, columns)[None]
    dark, bright = ([44, 92, 44], [66, 122, 58]) if plastic else ([54, 84, 50], [92, 118, 62])
    colour = blend(linear(dark), linear(bright), float(rng.random()))
    if not plastic and rng.random() < 0.06:
        colour = linear([138, 136, 58])  # a blade turning yellow
    mottle = 1 + 0.10 * field(rng, BLADE_PX, 10) + 0.05 * field(rng, BLADE_PX, 1.3)
    blade = np.asarray(mottle[..., None] * colour, np.float32)
    phase = (y - 0.42 * np.abs(x) ** 1.15) * 8.5
    side_veins = np.exp(-(((phase - np.round(phase)) / 0.07) ** 2)) * np.clip(1.1 - np.abs(x), 0, 1)
    midrib = np.exp(-((x / 0.035) ** 2)) * np.ones_like(y)
    blade *= (1 - 0.10 * np.cos(2 * np.pi * phase))[..., None].astype(np.float32)
    veins = np.clip(midrib * 0.75 + side_veins * 0.30, 0, 1)
    blade = blend(blade, linear([158, 168, 96]), veins)
    if not plastic:
        spots = np.zeros(BLADE_PX, np.float32)
        for _ in range(int(rng.integers(0, 8))):
            at = (int(rng.integers(columns)), int(rng.integers(rows)))
            shade = float(rng.uniform(0.3, 0.9))
            cv2.circle(spots, at, int(rng.integers(1, 4)), (shade,), -1, cv2.LINE_AA)
        blade = blend(blade, linear([112, 78, 40]), cv2.GaussianBlur(spots, (0, 0), 1.0))
    return blade
