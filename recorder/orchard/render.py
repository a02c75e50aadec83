"""One camera's picture as linear light: light paths through every pixel, then denoising."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from recorder.orchard.camera import View
from recorder.orchard.engine import Floats, load_mitsuba, load_part
from recorder.orchard.noise import Image

APERTURE_RADIUS_M: Final = 0.0007  # of a 6 mm lens at about f/4
_SAMPLES_A_PASS: Final = 4  # bounds memory: 1.3 million pixels x 4 paths at once
_GUIDE_SAMPLES: Final = 4  # rays a pixel for the denoiser's albedo and normals
_ROULETTE_FROM: Final = 2  # bounces after which dim paths may end: leaves absorb most light
_BRIGHTEST: Final = 40.0  # of one path, as a multiple of the picture's mean: stops fireflies


@dataclass(frozen=True, slots=True)
class RenderQuality:
    """How much work goes into one picture."""

    samples: int
    bounces: int
    focus_m: float = 0.95


def render_view(scene: Any, view: View, quality: RenderQuality, seed: int) -> Image:
    """(H, W, 3) float32 linear sRGB radiance; the same arguments give the same picture.

    Args:
        scene: a loaded Mitsuba scene.
        view: the camera.
        quality: samples and bounces.
        seed: of the light paths.
    """
    lens = _Lens(view, quality.focus_m)
    light = _paths(scene, lens, quality, seed)
    albedo, normals = _guides(scene, lens, seed)
    return _denoised(light, albedo, normals)


class _Lens:
    """Rays from a small lens through every pixel; the tables are made once a view."""

    def __init__(self, view: View, focus_m: float) -> None:
        mi = load_mitsuba()
        width_px, height_px = view.camera.size_px
        slopes = view.slopes().reshape(height_px, width_px, 2)
        per_column = np.asarray(np.gradient(slopes, axis=1)).reshape(-1, 2)
        per_row = np.asarray(np.gradient(slopes, axis=0)).reshape(-1, 2)
        self.size_px = (width_px, height_px)
        self._centres = mi.Point2f(*map(_floats, slopes.reshape(-1, 2).T))
        self._per_column = mi.Vector2f(*map(_floats, per_column.T))
        self._per_row = mi.Vector2f(*map(_floats, per_row.T))
        axes = np.eye(4)
        axes[:3, :3], axes[:3, 3] = view.rotation, view.centre_m
        self._world = mi.Transform4f(axes)
        self._focus_m = mi.Float(focus_m)
        # numbers that a compiled kernel must not contain, or each view would compile its own
        load_part("drjit").make_opaque(self._world, self._focus_m)

    def rays(self, samples: int, seed: int) -> tuple[Any, Any]:
        """`samples` rays for every pixel, pixel by pixel, and the sampler that made them."""
        dr = load_part("drjit")

        mi = load_mitsuba()
        count = self.size_px[0] * self.size_px[1] * samples
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count)
        pixel = dr.arange(mi.UInt32, count) // samples
        within = sampler.next_2d() - 0.5
        slope = dr.gather(mi.Point2f, self._centres, pixel)
        slope += dr.gather(mi.Vector2f, self._per_column, pixel) * within.x
        slope += dr.gather(mi.Vector2f, self._per_row, pixel) * within.y
        lens = mi.warp.square_to_uniform_disk_concentric(sampler.next_2d()) * APERTURE_RADIUS_M
        start = mi.Point3f(lens.x, lens.y, 0)
        focus = mi.Point3f(slope.x, slope.y, 1) * self._focus_m
        direction = dr.normalize(self._world @ mi.Vector3f(focus - start))
        ray = mi.RayDifferential3f(mi.Ray3f(self._world @ start, direction))
        return ray, sampler

    def picture(self, per_sample: Any, samples: int) -> Image:
        """Means over each pixel's samples as an (H, W, 3) picture."""
        dr = load_part("drjit")

        width_px, height_px = self.size_px
        planes = [np.array(dr.block_sum(c, samples)) / samples for c in per_sample]
        return np.asarray(np.stack(planes, -1).reshape(height_px, width_px, 3), np.float32)


def _floats(values: Floats) -> Any:
    return load_mitsuba().Float(np.ascontiguousarray(values, np.float32))


def _paths(scene: Any, lens: _Lens, quality: RenderQuality, seed: int) -> Image:
    dr = load_part("drjit")

    mi = load_mitsuba()
    integrator = mi.load_dict(
        {"type": "path", "max_depth": quality.bounces, "rr_depth": _ROULETTE_FROM}
    )
    total = np.zeros((*lens.size_px[::-1], 3), np.float32)
    done, part, ceiling = 0, 0, mi.Float(0)
    while done < quality.samples:
        samples = min(_SAMPLES_A_PASS, quality.samples - done)
        ray, sampler = lens.rays(samples, seed * 1009 + part)
        light, _, _ = integrator.sample(scene, sampler, ray, None, True)
        light = dr.select(dr.isfinite(light), light, 0)
        dr.eval(light)
        if part == 0:
            mean = np.array(dr.mean(dr.minimum(dr.mean(light), 1e3))).ravel()[0]
            ceiling = dr.opaque(mi.Float, max(_BRIGHTEST * float(mean), 1e-3))
        light = dr.minimum(light, ceiling)
        total = total + lens.picture(light, samples) * samples
        done += samples
        part += 1
    return np.asarray(total / quality.samples, np.float32)


def _guides(scene: Any, lens: _Lens, seed: int) -> tuple[Image, Image]:
    """Albedo and normals at the first surface: they cost a tenth and keep edges sharp."""
    dr = load_part("drjit")

    mi = load_mitsuba()
    ray, _ = lens.rays(_GUIDE_SAMPLES, seed * 1009 + 500)
    flags = mi.RayFlags.UV | mi.RayFlags.ShadingFrame
    si = scene.ray_intersect(ray, ray_flags=flags, coherent=True)
    hit = si.is_valid()
    albedo = dr.select(hit, si.bsdf(ray).eval_diffuse_reflectance(si, hit), 1.0)
    normal = dr.select(hit, mi.Vector3f(si.sh_frame.n), 0.0)
    dr.eval(albedo, normal)
    return lens.picture(albedo, _GUIDE_SAMPLES), lens.picture(normal, _GUIDE_SAMPLES)


def _denoised(light: Image, albedo: Image, normals: Image) -> Image:
    oidn = load_part("mitsuba_oidn")

    albedo = np.ascontiguousarray(np.clip(np.nan_to_num(albedo), 0, 1))
    smooth = oidn.denoise(np.ascontiguousarray(light), albedo, np.ascontiguousarray(normals),
                          hdr=True)  # fmt: skip
    return np.asarray(np.maximum(np.array(smooth), 0), np.float32)
