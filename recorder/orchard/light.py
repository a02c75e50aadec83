"""Daylight: a sky with or without a sun, painted on one map round the scene.

The sun is a small bright disc on the same map as the sky: sampled together they give half the
noise of two lamps. Directions are the world's: x along the row, y away from the camera, z up.
"""

from dataclasses import dataclass
from typing import Any, Final, Literal

import cv2
import numpy as np

from recorder.orchard.engine import Floats, load_mitsuba, load_part
from recorder.orchard.noise import Image, blend, field, step

Light = Literal["front", "back", "cloudy", "dusk", "lamps"]

_MAP_PX: Final = (1024, 2048)  # 0.18 degrees a pixel, so that the sun's disc is round
_SKY_PX: Final = (256, 512)
_SUN_RADIUS_RAD: Final = np.radians(0.45)  # a little hazier than the sun's own 0.27 degrees
_GLOW: Final = 0.05  # share of the sun's light that haze spreads round it
_GLOW_RADIUS_RAD: Final = np.radians(4.0)


@dataclass(frozen=True, slots=True)
class Sun:
    """Where the sun stands and how it shines.

    Attributes:
        elevation_deg: above the horizon, give or take 4.
        azimuth_deg: from straight ahead of the camera, give or take 12.
        strength: its light on a surface that faces it, as a multiple of the sky's on the ground.
        colour: linear, its balance with the sky.
    """

    elevation_deg: float
    azimuth_deg: float
    strength: float
    colour: tuple[float, float, float]


_NOON: Final = (1.0, 0.94, 0.84)
SUNS: Final[dict[Light, Sun]] = {
    "front": Sun(40, 205, 6.0, _NOON),  # behind the camera
    "back": Sun(36, 18, 6.0, _NOON),  # behind the trees
    "dusk": Sun(6, 250, 1.6, (1.0, 0.60, 0.30)),  # low, from the side
}


@dataclass(frozen=True, slots=True, eq=False)
class Daylight:
    """The emitter round the scene, and (3,) where its sun is (None: overcast)."""

    emitter: dict[str, Any]
    sun_direction: Floats | None


def daylight(rng: np.random.Generator, light: Light) -> Daylight:
    """The sky of that light; the sun's place and the clouds vary with `rng`."""
    if light not in SUNS:
        return Daylight(_emitter(_overcast(rng)), None)
    sun = SUNS[light]
    elevation = np.radians(sun.elevation_deg + rng.uniform(-1, 1) * min(4, sun.elevation_deg / 3))
    azimuth = np.radians(sun.azimuth_deg + rng.uniform(-12, 12))
    towards = _direction(elevation, azimuth)
    sky = _with_clouds(rng, _clear_sky(towards))
    return Daylight(_emitter(_with_sun(sky, towards, sun)), towards)


def _direction(elevation: Any, azimuth: Any) -> Floats:
    flat = np.cos(elevation)
    parts = (np.sin(azimuth) * flat, np.cos(azimuth) * flat, np.sin(elevation))
    return np.stack(np.broadcast_arrays(*parts), -1)


def _map_directions(size_px: tuple[int, int]) -> Floats:
    """(rows, columns, 3) where each pixel of a sky map lies."""
    columns = size_px[1]
    azimuth = (np.arange(columns) + 0.5) / columns * 2 * np.pi
    return _direction(_elevations(size_px), azimuth[None])


def _elevations(size_px: tuple[int, int]) -> Floats:
    """(rows, 1) above the horizon, of a sky map's rows."""
    rows = size_px[0]
    return (np.pi / 2 - (np.arange(rows) + 0.5) / rows * np.pi)[:, None]


def _solid_angles(size_px: tuple[int, int]) -> Floats:
    """(rows, 1) of one pixel, in steradians."""
    rows, columns = size_px
    polar = (np.arange(rows) + 0.5) / rows * np.pi
    return np.asarray((np.sin(polar) * np.pi / rows * 2 * np.pi / columns)[:, None])


def _emitter(sky: Image) -> dict[str, Any]:
    mi = load_mitsuba()
    upright = mi.ScalarTransform4f().rotate([1, 0, 0], 90)  # Mitsuba's maps have y up
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(sky)), "to_world": upright}


def _overcast(rng: np.random.Generator) -> Image:
    """The CIE overcast sky, three times brighter overhead than at the horizon, with clouds."""
    elevation = _elevations(_SKY_PX)
    clouds = 1 + 0.16 * field(rng, _SKY_PX, (10, 26), wrap_rows=False)
    clouds = clouds + 0.07 * field(rng, _SKY_PX, (4, 9), wrap_rows=False)
    bright = (1 + 2 * np.sin(np.maximum(elevation, 0))) / 3 * clouds
    sky = np.where(elevation > 0, bright, 0.12)[..., None] * np.array([0.97, 0.99, 1.03])
    return np.asarray(np.maximum(sky, 0), np.float32)


def _clear_sky(towards_sun: Floats) -> Image:
    """A clear sky without its sun, by Mitsuba's sky model."""
    dr = load_part("drjit")

    mi = load_mitsuba()
    model = {"type": "sunsky", "sun_direction": towards_sun.tolist(), "turbidity": 3.2,
             "albedo": 0.2, "sun_scale": 0.0}  # fmt: skip
    emitter = mi.load_dict({"type": "scene", "sky": model}).environment()
    look = _map_directions(_SKY_PX).reshape(-1, 3).astype(np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, len(look))
    si.wi = mi.Vector3f(*(-mi.Float(np.ascontiguousarray(look[:, k])) for k in range(3)))
    radiance = np.maximum(np.array(emitter.eval(si)).T.reshape(*_SKY_PX, 3), 0)
    return np.asarray(np.nan_to_num(radiance), np.float32)


def _with_clouds(rng: np.random.Generator, sky: Image) -> Image:
    rows = _SKY_PX[0]
    widths = [rows / k for k in (7, 16, 36, 80, 160)]
    wisps = sum(w**0.75 * field(rng, _SKY_PX, (0.55 * w, w), wrap_rows=False) for w in widths)
    wisps = wisps / np.std(wisps)
    elevation = _elevations(_SKY_PX)
    cover = step((wisps - rng.uniform(0.6, 2.0)) * 3.2) * np.clip(elevation / 0.15, 0, 1) * 0.8
    bright = sky[: rows // 2].mean() * np.array([1.5, 1.5, 1.55])
    lit = bright * (1 + 0.15 * field(rng, _SKY_PX, (12, 24), wrap_rows=False))[..., None]
    return blend(sky, np.maximum(lit, 0), cover)


def _with_sun(sky: Image, towards: Floats, sun: Sun) -> Image:
    looks = _map_directions(_SKY_PX)
    on_ground = sky * np.maximum(looks[..., 2:], 0) * _solid_angles(_SKY_PX)[..., None]
    power = sun.strength * float(on_ground.sum((0, 1)).mean()) * np.array(sun.colour)
    whole = cv2.resize(sky, _MAP_PX[::-1], interpolation=cv2.INTER_LINEAR)
    angle = np.arccos(np.clip(_map_directions(_MAP_PX) @ towards, -1, 1))
    solid = _solid_angles(_MAP_PX)
    disc = np.clip((_SUN_RADIUS_RAD - angle) / (np.pi / _MAP_PX[0]) + 0.5, 0, 1)
    glow = np.exp(-((angle / _GLOW_RADIUS_RAD) ** 2)) * (angle < 4 * _GLOW_RADIUS_RAD)
    for shape, share in ((disc, 1 - _GLOW), (glow, _GLOW)):
        density = shape / (shape * solid).sum()
        whole = whole + share * density[..., None] * power
    return np.asarray(whole, np.float32)
