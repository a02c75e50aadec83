"""Apple skins: a recipe for each cultivar, and the painter that follows it."""

from dataclasses import dataclass
from typing import Final, Literal

import cv2
import numpy as np
import numpy.typing as npt

from recorder.orchard.noise import Image, blend, field, linear, srgb8, step

Cultivar = Literal["fuji", "dark-red", "gala", "granny-smith", "golden-delicious", "unripe"]

SKIN_PX: Final = (384, 768)  # rows from stem to calyx, columns around
Colour = tuple[int, int, int]  # sRGB


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a cultivar's skin looks.

    Attributes:
        ground: the two ground colours between which a fruit varies.
        blush: the two blush colours, light to deep.
        cover: lowest and highest blush of a fruit; 2 covers nearly all, -2 nearly nothing.
        stripes: how much the blush breaks into stripes from stem to calyx.
        sun_side: how much redder the side is that the sun found.
        lenticels: dots on a fruit.
        dot: the colour of a lenticel.
        russet: how far the rusty patch spreads from the stem, as a share of the height.
        bloom: the pale wax that dulls the colour, 0..1.
        roughness: of the skin's gloss.
        height_ratio: lowest and highest height over width.
        width_m: mean greatest width.
    """

    ground: tuple[Colour, Colour]
    blush: tuple[Colour, Colour]
    cover: tuple[float, float]
    stripes: float
    sun_side: float
    lenticels: int
    dot: Colour
    russet: float = 0.05
    bloom: float = 0.05
    roughness: float = 0.36
    height_ratio: tuple[float, float] = (0.82, 0.93)
    width_m: float = 0.080


RECIPES: Final[dict[Cultivar, Recipe]] = {
    "fuji": Recipe(
        ground=((196, 186, 98), (214, 178, 102)), blush=((192, 54, 62), (146, 24, 44)),
        cover=(1.5, 3.3), stripes=0.5, sun_side=0.8, lenticels=1100, dot=(226, 190, 150),
    ),
    "dark-red": Recipe(
        ground=((206, 130, 96), (196, 100, 84)), blush=((196, 36, 66), (134, 16, 42)),
        cover=(2.6, 4.2), stripes=0.25, sun_side=0.4, lenticels=900, dot=(206, 150, 130),
        russet=0.03, bloom=0.12, roughness=0.30, height_ratio=(0.88, 1.0), width_m=0.077,
    ),
    "gala": Recipe(
        ground=((226, 198, 104), (230, 178, 92)), blush=((214, 82, 52), (178, 44, 40)),
        cover=(0.6, 2.2), stripes=0.9, sun_side=0.9, lenticels=700, dot=(238, 210, 150),
        height_ratio=(0.86, 0.98), width_m=0.071,
    ),
    "granny-smith": Recipe(
        ground=((128, 162, 56), (148, 178, 70)), blush=((150, 120, 70), (140, 90, 64)),
        cover=(-5.0, -3.0), stripes=0.15, sun_side=0.9, lenticels=1300, dot=(206, 218, 160),
        russet=0.03, height_ratio=(0.84, 0.94), width_m=0.078,
    ),
    "golden-delicious": Recipe(
        ground=((204, 196, 82), (222, 204, 98)), blush=((218, 160, 90), (206, 130, 84)),
        cover=(-4.5, -2.0), stripes=0.1, sun_side=1.2, lenticels=1500, dot=(166, 140, 74),
        russet=0.07, height_ratio=(0.88, 1.0), width_m=0.076,
    ),
    "unripe": Recipe(
        ground=((122, 148, 62), (148, 166, 80)), blush=((168, 104, 74), (150, 66, 58)),
        cover=(-2.2, -0.4), stripes=0.4, sun_side=1.3, lenticels=900, dot=(196, 206, 150),
        bloom=0.15, width_m=0.066,
    ),
}  # fmt: skip


def paint_skin(rng: np.random.Generator, recipe: Recipe) -> npt.NDArray[np.uint8]:
    """One fruit's skin, (384, 768, 3) sRGB; row 0 is the stem, columns wrap round the fruit."""
    rows, columns = SKIN_PX
    v = np.linspace(0, 1, rows, dtype=np.float32)[:, None]
    u = np.linspace(0, 1, columns, endpoint=False, dtype=np.float32)[None]

    def noise(down: float, around: float) -> Image:
        return field(rng, SKIN_PX, (down, around), wrap_rows=False)

    stripes = 0.55 * noise(60, 8) + 0.5 * noise(40, 3) + 0.35 * noise(18, 1.3)
    broad, mid, fine = noise(35, 45), noise(7, 9), noise(0.8, 0.9)
    blush = rng.uniform(*recipe.cover) + recipe.sun_side * np.cos(2 * np.pi * (u - rng.random()))
    blush = blush + 0.5 * broad + 0.62 * recipe.stripes * stripes + 0.16 * mid
    blush = blush - 1.5 * np.exp(-((v / 0.09) ** 2)) - 0.8 * np.exp(-(((1 - v) / 0.10) ** 2))
    ground = blend(linear(recipe.ground[0]), linear(recipe.ground[1]), step(broad + 0.3 * mid))
    deep = step(0.9 * blush + 0.8 * recipe.stripes * stripes - 1.0)
    red = blend(linear(recipe.blush[0]), linear(recipe.blush[1]), deep)
    skin = blend(ground, red, 0.97 * step(1.9 * blush))
    skin = skin * (1 + 0.03 * fine + 0.05 * mid)[..., None]
    russet = step((recipe.russet + 0.012 * broad + 0.008 * stripes - v) * 180)
    skin = blend(skin, linear([150, 118, 62]), 0.85 * russet)
    skin = blend(skin, linear([70, 58, 34]), step((v - 0.975) * 200) * np.ones_like(u))
    skin = blend(skin, linear(recipe.dot), 0.55 * _lenticels(rng, recipe.lenticels))
    haze = recipe.bloom * step(1.5 * broad + mid)
    return srgb8(blend(skin, linear([176, 160, 170]), haze))


def _lenticels(rng: np.random.Generator, count: int) -> Image:
    """Dots, denser and smaller towards the calyx, round on the fruit and so wider at its poles."""
    rows, columns = SKIN_PX
    dots = np.zeros(SKIN_PX, np.float32)
    theta = np.arccos(rng.uniform(-1, 1, count))
    shown = rng.random(count) < 0.35 + 0.65 * theta / np.pi
    for angle, x in zip(theta[shown], rng.random(count)[shown] * columns, strict=True):
        radius_px = rng.uniform(0.5, 1.2)
        wide_px = min(radius_px / max(float(np.sin(angle)), 0.15), 6)
        at = (int(x * 16), int(angle / np.pi * rows * 16))
        axes = (int(wide_px * 16), int(radius_px * 16))
        shade = (float(rng.uniform(0.25, 0.8)),)
        cv2.ellipse(dots, at, axes, 0, 0, 360, shade, -1, cv2.LINE_AA, 4)
    return np.asarray(cv2.GaussianBlur(dots, (0, 0), 0.5), np.float32)


def plastic_skin(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """The evenly red skin of an artificial fruit."""
    red = np.ones((*SKIN_PX, 1), np.float32) * linear([178 + int(rng.integers(-8, 8)), 26, 30])
    v = np.linspace(0, 1, SKIN_PX[0], dtype=np.float32)[:, None]
    yellow = step(1.8 * (field(rng, SKIN_PX, 30) - 1.1) - 3 * np.abs(v - 0.5) + 0.4)
    return srgb8(blend(red, linear([214, 150, 60]), 0.6 * yellow))
