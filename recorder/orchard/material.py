"""What the surfaces of the orchard are made of, as Mitsuba materials."""

from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from recorder.orchard.engine import load_mitsuba, load_part, texture
from recorder.orchard.leaf import paint_atlas
from recorder.orchard.noise import field, linear, srgb8
from recorder.orchard.skin import RECIPES, SKIN_PX, Cultivar, paint_skin, plastic_skin
from recorder.orchard.wood import paint_bark

SKINS: Final = 6  # different fruit of one scene
_LEAF: Final = "pomolog_leaf"
_DOWN: Final = (0.285, 0.320, 0.235)  # linear colour of the pale hairs under an apple leaf
_DOWN_SHARE: Final = 0.42
_LIGHT_THROUGH: Final = (0.42, 0.75, 0.24)  # of a leaf's own colour, what comes out behind it
_THROUGH_SHARE: Final = 0.35  # of the sampled directions that leave by the other side
_GLOSS: Final = 0.30  # a leaf's gloss: the GGX width of its wax
_GLOSS_BELOW: Final = 0.25  # how much of that gloss the hairy underside has


@dataclass(frozen=True, slots=True)
class Materials:
    """One scene's materials, each ready for `make_mesh`."""

    skin: Any
    leaf: Any
    bark: Any
    twig: Any
    stem: Any


def orchard_materials(
    rng: np.random.Generator,
    cultivar: Cultivar,
    *,
    dew: bool = False,
    plastic: bool = False,
    skins: int = SKINS,
) -> Materials:
    """Paint so many different skins, leaves and bark; `plastic` for an artificial tree's leaves."""
    mi = load_mitsuba()
    recipe = RECIPES[cultivar]
    painted = [paint_skin(rng, recipe) for _ in range(skins)]
    atlas = np.concatenate([painted[i % skins] for i in range(SKINS)], axis=1)
    bark = paint_bark(rng, (92, 80, 68), (138, 126, 112))
    twig = paint_bark(rng, (84, 62, 50), (128, 100, 84), (256, 128))
    return Materials(
        skin=_skin_material(rng, atlas, recipe.roughness, dew=dew),
        leaf=leaf_material(paint_atlas(rng, plastic=plastic)),
        bark=mi.load_dict(matt(texture(bark))),
        twig=mi.load_dict(glossy(texture(twig), 0.6)),
        stem=mi.load_dict(matt(colour([112, 92, 48]))),
    )


def plastic_fruit(rng: np.random.Generator) -> Any:
    """The skin of artificial fruit."""
    return _skin_material(rng, np.concatenate([plastic_skin(rng)] * SKINS, 1), 0.22, dew=False)


def colour(srgb: npt.ArrayLike) -> dict[str, Any]:
    """An even colour, from sRGB 0..255."""
    return {"type": "rgb", "value": linear(srgb).tolist()}


def matt(reflectance: dict[str, Any]) -> dict[str, Any]:
    """A rough surface, the same from both sides."""
    return {"type": "twosided", "b": {"type": "diffuse", "reflectance": reflectance}}


def glossy(base: dict[str, Any], roughness: float) -> dict[str, Any]:
    """A painted, waxed or plastic surface, the same from both sides."""
    surface = {"type": "principled", "base_color": base, "roughness": roughness, "specular": 0.4}
    return {"type": "twosided", "b": surface}


def leaf_material(atlas: npt.NDArray[np.uint8]) -> Any:
    """A leaf: waxy above, pale and hairy below, and the light that comes through it yellow-green.

    Mitsuba's thin material has one colour for both sides, so this is our own.
    """
    _register_leaf()
    return load_mitsuba().load_dict({"type": _LEAF, "upper": texture(atlas)})


def _skin_material(
    rng: np.random.Generator, atlas: npt.NDArray[np.uint8], roughness: float, *, dew: bool
) -> Any:
    mi = load_mitsuba()
    surface: dict[str, Any] = {
        "type": "principled",
        "base_color": texture(atlas),
        "roughness": roughness,
        "specular": 0.5,
        "flatness": 0.25,
        "clearcoat": 1.0 if dew else 0.3,
        "clearcoat_gloss": 0.95 if dew else 0.8,
    }
    if not dew:
        return mi.load_dict(surface)
    drops = np.concatenate([_dew_drops(rng)] * SKINS, 1)
    height = {"type": "bitmap", "bitmap": mi.Bitmap(drops[..., None]), "raw": True}
    return mi.load_dict({"type": "bumpmap", "arbitrary": height, "scale": 1.0, "bsdf": surface})


def _dew_drops(rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """The height of drops on one skin, in the bump map's own unit (about metres)."""
    rows, columns = SKIN_PX
    y, x = np.mgrid[-6:7, -6:7]
    height = np.zeros(SKIN_PX, np.float32)
    for _ in range(900):
        radius_px = rng.uniform(1.5, 5.5)
        cap = np.sqrt(np.clip(radius_px**2 - x**2 - y**2, 0, None)) * 8e-5
        row, column = int(rng.integers(6, rows - 7)), int(rng.integers(6, columns - 7))
        patch = height[row - 6 : row + 7, column - 6 : column + 7]
        np.maximum(patch, cap, out=patch)
    return height


def soil_and_grass(rng: np.random.Generator, rows_px: int, pitch_m: float) -> Any:
    """The ground: a bare strip under each row of trees, grass between; v spans one row pitch."""
    size = (rows_px, rows_px)
    grain = 0.5 * field(rng, size, 20) + 0.5 * field(rng, size, 4.5) + 0.6 * field(rng, size, 1)
    soil = _mottled(rng, (104, 84, 66), (158, 132, 104), grain, 0.15)
    grass = _mottled(rng, (74, 90, 46), (132, 134, 78), 1.2 * grain, 0.2)
    from_row_m = np.abs((np.arange(rows_px) / rows_px - 0.5) * pitch_m)[:, None]
    edge_m = 0.62 + 0.10 * field(rng, size, 15)
    bare = 1 / (1 + np.exp(-(edge_m - from_row_m) * 14))
    return load_mitsuba().load_dict(
        matt(texture(srgb8(grass * (1 - bare[..., None]) + soil * bare[..., None])))
    )


def _mottled(
    rng: np.random.Generator,
    dark: tuple[int, int, int],
    bright: tuple[int, int, int],
    grain: npt.NDArray[np.float32],
    speckle: float,
) -> npt.NDArray[np.float32]:
    share = (1 / (1 + np.exp(-grain)))[..., None]
    mixed = linear(dark) * (1 - share) + linear(bright) * share
    speckled = mixed * (1 + speckle * field(rng, grain.shape[:2], 0.8))[..., None]
    return np.asarray(speckled, np.float32)


@cache
def _register_leaf() -> None:
    """Tell Mitsuba of the leaf material, once."""
    dr = load_part("drjit")

    mi = load_mitsuba()

    class Leaf(mi.BSDF):  # type: ignore[misc,name-defined]  # mitsuba is loaded late, so it has no types here
        """Diffuse reflection of two colours, diffuse transmission and a waxy gloss."""

        def __init__(self, properties: Any) -> None:
            mi.BSDF.__init__(self, properties)
            self.upper = properties["upper"]
            sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            reflect = mi.BSDFFlags.DiffuseReflection | sides
            through = mi.BSDFFlags.DiffuseTransmission | sides
            self.m_components = [reflect, through]
            self.m_flags = reflect | through

        def traverse(self, callback: Any) -> None:
            callback.put("upper", self.upper, mi.ParamFlags.Differentiable)

        def _colours(self, si: Any, active: Any) -> tuple[Any, Any]:
            blade = self.upper.eval(si, active)
            down = mi.Color3f(*_DOWN)
            below = blade * (1 - _DOWN_SHARE) + down * _DOWN_SHARE
            facing = dr.select(mi.Frame3f.cos_theta(si.wi) > 0, blade, below)
            return facing, blade * mi.Color3f(*_LIGHT_THROUGH)

        def sample(
            self, context: Any, si: Any, lobe: Any, point: Any, active: Any = True
        ) -> tuple[Any, Any]:
            out = mi.warp.square_to_cosine_hemisphere(point)
            above = mi.Frame3f.cos_theta(si.wi) > 0
            through = lobe < _THROUGH_SHARE
            out.z = dr.select(above ^ through, out.z, -out.z)
            drawn = mi.BSDFSample3f()
            drawn.wo = out
            drawn.eta = 1.0
            drawn.pdf = self.pdf(context, si, out, active)
            drawn.sampled_component = dr.select(through, mi.UInt32(1), mi.UInt32(0))
            drawn.sampled_type = dr.select(
                through,
                mi.UInt32(+mi.BSDFFlags.DiffuseTransmission),
                mi.UInt32(+mi.BSDFFlags.DiffuseReflection),
            )
            good = active & (drawn.pdf > 0)
            value = self.eval(context, si, out, good) / dr.maximum(drawn.pdf, 1e-9)
            return drawn, dr.select(good, value, 0)

        def eval(self, context: Any, si: Any, out: Any, active: Any = True) -> Any:  # noqa: ARG002
            cos_in, cos_out = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(out)
            back, through = self._colours(si, active)
            same_side = cos_in * cos_out > 0
            half = dr.normalize(si.wi + out)
            alpha2 = _GLOSS**4
            spread = alpha2 / dr.maximum(
                dr.pi * dr.square(dr.square(half.z) * (alpha2 - 1) + 1), 1e-6
            )
            grazing = dr.clip(dr.dot(si.wi, half), 0.05, 1)
            fresnel = 0.035 + 0.965 * (1 - grazing) ** 5
            wax = dr.select(cos_in > 0, 1.0, _GLOSS_BELOW)
            gloss = wax * spread * fresnel / (4 * dr.square(grazing))  # Kelemen's visibility
            value = dr.select(same_side, back / dr.pi + gloss, through / dr.pi)
            return dr.select(active, value * dr.abs(cos_out), 0)

        def pdf(self, context: Any, si: Any, out: Any, active: Any = True) -> Any:  # noqa: ARG002
            cos_in, cos_out = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(out)
            share = dr.select(cos_in * cos_out > 0, 1 - _THROUGH_SHARE, _THROUGH_SHARE)
            return dr.select(active, dr.abs(cos_out) / dr.pi * share, 0)

        def eval_pdf(self, context: Any, si: Any, out: Any, active: Any = True) -> tuple[Any, Any]:
            return self.eval(context, si, out, active), self.pdf(context, si, out, active)

        def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
            return self._colours(si, active)[0]

    mi.register_bsdf(_LEAF, Leaf)
