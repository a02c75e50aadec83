"""The laboratory: a room with lamps, a window and furniture, for the indoor experiments."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from recorder.orchard.engine import load_mitsuba, texture
from recorder.orchard.material import colour, glossy
from recorder.orchard.noise import blend, field, linear, srgb8, step

_TEXTURE_PX: Final = (512, 512)
_BACK_WALL_M: Final = 3.4
_HALF_WIDTH_M: Final = 3.2
_LAMP: Final = (9.6, 9.3, 8.4)  # radiance, against the window's
_WINDOW: Final = (2.6, 3.0, 3.6)

Box = tuple[tuple[float, float, float], tuple[float, float, float], tuple[int, int, int], float]
FURNITURE: Final[dict[str, Box]] = {
    "cabinet": ((-1.9, 2.9, 0), (-1.0, 3.38, 1.75), (128, 138, 146), 0.35),
    "drawers": ((-0.95, 2.95, 0), (-0.35, 3.38, 1.05), (64, 88, 128), 0.4),
    "desk": ((0.6, 2.6, 0.70), (2.4, 3.3, 0.74), (156, 118, 78), 0.4),
    "desk_leg_left": ((0.65, 2.7, 0), (0.70, 3.2, 0.7), (60, 60, 62), 0.4),
    "desk_leg_right": ((2.3, 2.7, 0), (2.35, 3.2, 0.7), (60, 60, 62), 0.4),
    "monitor": ((1.2, 2.95, 0.86), (1.75, 2.99, 1.2), (22, 22, 24), 0.2),
    "carton": ((1.9, 2.8, 0.74), (2.2, 3.1, 0.98), (178, 140, 96), 0.8),
}  # low corner, high corner (m), sRGB, roughness


def room_shapes(rng: np.random.Generator) -> dict[str, Any]:
    """Walls, floor, ceiling, furniture, four lamps and a window."""
    transform = load_mitsuba().ScalarTransform4f
    walls = {
        "wall_back": ([0, _BACK_WALL_M, 1.5], [1, 0, 0], 90),
        "wall_front": ([0, -3, 1.5], [1, 0, 0], -90),
        "wall_left": ([-_HALF_WIDTH_M, 1, 1.5], [0, 1, 0], 90),
        "wall_right": ([_HALF_WIDTH_M, 1, 1.5], [0, 1, 0], -90),
    }
    plaster = glossy(_tiled(_plaster(rng), 2), 0.85)
    shapes: dict[str, Any] = {
        name: _panel(transform().translate(at).rotate(axis, angle).scale([4, 4, 1]), plaster)
        for name, (at, axis, angle) in walls.items()
    }
    shapes["floor"] = _panel(
        transform().translate([0, 1, 0]).scale([4, 4, 1]), glossy(_tiled(_floor(rng), 3), 0.3)
    )
    shapes["ceiling"] = _panel(
        transform().translate([0, 1, 2.9]).rotate([1, 0, 0], 180).scale([4, 4, 1]),
        glossy(colour([230, 230, 226]), 0.9),
    )
    for name, (low, high, srgb, roughness) in FURNITURE.items():
        middle, half = np.add(low, high) / 2, np.subtract(high, low) / 2
        place = transform().translate(middle.tolist()).scale(half.tolist())
        material = glossy(colour(srgb), roughness)
        shapes[name] = {"type": "cube", "to_world": place, "bsdf": material}
    hung = transform().translate([0.3, _BACK_WALL_M - 0.01, 1.7]).rotate([1, 0, 0], 90)
    shapes["poster"] = _panel(hung.scale([0.38, 0.5, 1]), glossy(texture(_poster(rng)), 0.5))
    for i, (x, y) in enumerate(((-1.2, 0.2), (1.2, 0.2), (-1.2, 2.2), (1.2, 2.2))):
        place = transform().translate([x, y, 2.88]).rotate([1, 0, 0], 180).scale([0.6, 0.15, 1])
        shapes[f"lamp_{i}"] = _lamp(place, _LAMP)
    place = transform().translate([-3.15, 0.6, 1.6]).rotate([0, 1, 0], 90).scale([0.7, 0.9, 1])
    shapes["window"] = _lamp(place, _WINDOW)
    return shapes


def _panel(place: Any, material: dict[str, Any]) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": place, "bsdf": material}


def _lamp(place: Any, radiance: tuple[float, float, float]) -> dict[str, Any]:
    light = {"type": "area", "radiance": {"type": "rgb", "value": list(radiance)}}
    return {"type": "rectangle", "to_world": place, "emitter": light}


def _tiled(picture: npt.NDArray[np.uint8], times: int) -> dict[str, Any]:
    repeat = load_mitsuba().ScalarTransform3f().scale([times, times])
    return {**texture(picture), "to_uv": repeat}


def _plaster(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    relief = 0.03 * field(rng, _TEXTURE_PX, 20) + 0.02 * field(rng, _TEXTURE_PX, 1.2)
    return srgb8(linear([214, 210, 202]) * (1 + relief)[..., None])


def _floor(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    y, x = np.mgrid[: _TEXTURE_PX[0], : _TEXTURE_PX[1]]
    joint = ((x % 128 < 2) | (y % 128 < 2)).astype(float)
    tile = linear([168, 160, 150]) * (1 + 0.06 * field(rng, _TEXTURE_PX, 6))[..., None]
    return srgb8(blend(tile, linear([110, 104, 96]), joint))


def _poster(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """A printed sheet of soft shapes in blues and greens: not grey, and nowhere red as fruit is."""
    green, blue = (0.30 * step(1.2 * field(rng, (256, 256), 30)) + 0.1 for _ in range(2))
    return srgb8(np.stack([0.5 * np.minimum(green, blue), green, blue], -1))
