"""Wood: branches as curves with a thickness, their bark, and how near something is to them."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from recorder.orchard.engine import Floats, Surface
from recorder.orchard.leaf import grid_faces
from recorder.orchard.noise import blend, field, linear, srgb8, step, unit

BARK_ROUGHNESS: Final = 0.05  # burrs and ridges, as a share of a branch's radius
_CLEARANCE_STEP_M: Final = 0.006  # between the points that stand for a branch
_MAX_RINGS: Final = 300  # of one branch's mesh


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """A branch: (N, 3) points along it, (N,) radii, and how many sides its mesh has."""

    points_m: Floats
    radii_m: Floats
    sides: int
    rough: bool = False


def curve(
    rng: np.random.Generator,
    start_m: npt.ArrayLike,
    direction: npt.ArrayLike,
    length_m: float,
    count: int,
    *,
    droop: float,
    wobble: float,
) -> Floats:
    """(count, 3) points of a twig that starts there, sags by its weight and wanders a little."""
    points = [np.asarray(start_m, float)]
    heading = unit(direction)
    pace_m = length_m / (count - 1)
    for kick in wobble * rng.standard_normal((count - 1, 3)):
        heading = unit(heading + np.array([0, 0, -droop * pace_m]) + kick)
        points.append(points[-1] + heading * pace_m)
    return np.array(points)


def along(points_m: Floats, share: float) -> tuple[Floats, Floats]:
    """The point at that share (0..1) of a curve, and the direction there."""
    place = share * (len(points_m) - 1)
    i = min(int(place), len(points_m) - 2)
    chord = points_m[i + 1] - points_m[i]
    return points_m[i] + (place - i) * chord, unit(chord)


def clearance_points(branches: list[Branch]) -> tuple[Floats, Floats]:
    """Points along all branches, close together, and the wood's radius at each (with burrs)."""
    points, radii = [], []
    for branch in branches:
        length_m = np.linalg.norm(np.diff(branch.points_m, axis=0), axis=1).sum()
        count = max(2, int(length_m / _CLEARANCE_STEP_M))
        place = np.linspace(0, len(branch.points_m) - 1, count)
        whole = np.arange(len(branch.points_m))
        points.append(np.stack([np.interp(place, whole, p) for p in branch.points_m.T], 1))
        burr = 1 + 3 * BARK_ROUGHNESS * branch.rough
        radii.append(np.interp(place, whole, branch.radii_m) * burr)
    return np.concatenate(points), np.concatenate(radii)


def branch_surface(rng: np.random.Generator, branch: Branch) -> Surface:
    """A tube round the branch, with burrs and ridges as real geometry where it is rough."""
    points, radii = branch.points_m, branch.radii_m
    if branch.rough:
        points, radii = _resampled(points, radii)
    tangent = unit(np.gradient(points, axis=0))
    a = unit(np.cross(tangent, np.array([0.31, 0.82, 0.47])))
    b = np.cross(tangent, a)
    phi = np.linspace(0, 2 * np.pi, branch.sides + 1)
    spokes = np.cos(phi)[None, :, None] * a[:, None] + np.sin(phi)[None, :, None] * b[:, None]
    thickness = np.repeat(radii[:, None], branch.sides + 1, 1)
    if branch.rough:
        rings = (len(points), branch.sides)
        bumps = 0.6 * field(rng, rings, (2.5, 0.8)) + 0.25 * field(rng, rings, 1.0)
        bumps = bumps + 0.6 * field(rng, (len(points), 4), (3, 1))[:, :1]
        thickness[:, :-1] *= 1 + BARK_ROUGHNESS * np.clip(bumps, -3, 3)
        thickness[:, -1] = thickness[:, 0]
    skin = points[:, None] + spokes * thickness[..., None]
    walked = np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()
    v = np.concatenate([[0], walked]) * 8  # the bark's texture repeats each 125 mm
    uv = np.stack(np.broadcast_arrays(phi[None] / (2 * np.pi), v[:, None]), -1)
    return Surface(
        skin.reshape(-1, 3),
        grid_faces(len(points), branch.sides + 1),
        _skin_normals(skin, spokes) if branch.rough else spokes.reshape(-1, 3),
        uv.reshape(-1, 2),
    )


def _resampled(points_m: Floats, radii_m: Floats) -> tuple[Floats, Floats]:
    from scipy.ndimage import gaussian_filter1d

    length_m = np.linalg.norm(np.diff(points_m, axis=0), axis=1).sum()
    rings = int(np.clip(length_m / (radii_m[0] * 0.35), len(points_m), _MAX_RINGS))
    place, whole = np.linspace(0, len(points_m) - 1, rings), np.arange(len(points_m))
    fine = np.stack([np.interp(place, whole, p) for p in points_m.T], 1)
    smooth = gaussian_filter1d(fine, rings / len(points_m) * 0.8, axis=0, mode="nearest")
    return smooth, np.interp(place, whole, radii_m)


def _skin_normals(skin: Floats, spokes: Floats) -> Floats:
    around = np.gradient(skin, axis=1)
    around[:, 0] = around[:, -1] = skin[:, 1] - skin[:, -2]
    normals = unit(np.cross(around, np.gradient(skin, axis=0)))
    inward = (normals * spokes).sum(-1, keepdims=True) < 0
    return np.asarray(np.where(inward, -normals, normals)).reshape(-1, 3)


def paint_bark(
    rng: np.random.Generator,
    dark: tuple[int, int, int],
    bright: tuple[int, int, int],
    size: tuple[int, int] = (512, 256),
) -> npt.NDArray[np.uint8]:
    """Bark between two sRGB colours, with furrows and lichen; (H, W, 3), wraps both ways."""
    grain = 0.5 * field(rng, size, (20, 2.5)) + 0.5 * field(rng, size, 1.2)
    grain = grain + 0.35 * field(rng, size, (2, 15)) + 0.6 * field(rng, size, 12)
    bark = blend(linear(dark), linear(bright), step(1.3 * grain))
    bark = bark * (1 + 0.12 * field(rng, size, 0.8))[..., None]
    lichen = step((field(rng, size, 7) + 0.5 * field(rng, size, 1.5) - 1.7) * 5)
    return srgb8(blend(bark, linear([150, 152, 132]), 0.6 * lichen))
