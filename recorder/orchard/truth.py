"""Exact truth of one stereo pair: whose skin each pixel sees, where fruit are, the beam's end."""

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np

from recorder.orchard.apple import Apple
from recorder.orchard.camera import RigPose, View
from recorder.orchard.engine import Floats, load_mitsuba, load_part, rays
from recorder.orchard.rows import BEHIND_ENDING
from recorder.orchard.world import FruitMesh
from recorder.records import UNCOUNTED, AppleTruth, FrameTruth, Labels, RangeReading

_NEAREST_M: Final = 0.05  # a fruit nearer than this to a camera has no outline there


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A fruit's outline in one view: pixels inside it (also beyond the picture's edge)."""

    area_px: int
    touches_picture: bool


def see_labels(scene: Any, view: View, fruit: list[FruitMesh]) -> Labels:
    """(H, W) uint16: for the ray through every pixel's centre, the apple it meets first."""
    dr, mi = load_part("drjit"), load_mitsuba()
    width_px, height_px = view.camera.size_px
    slopes = view.slopes()
    looks = np.concatenate([slopes, np.ones((len(slopes), 1))], 1) @ view.rotation.T
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    si = scene.ray_intersect(rays(view.centre_m, looks), ray_flags=mi.RayFlags.Minimal,
                             coherent=True)  # fmt: skip
    shapes = np.array(dr.reinterpret_array(mi.UInt32, si.shape))
    faces = np.array(si.prim_index).astype(np.int64)
    labels = np.zeros(len(shapes), np.uint16)
    meshes = {mesh.name: mesh for mesh in fruit}
    for handle in np.unique(shapes[shapes > 0]):
        name = dr.reinterpret_array(mi.ShapePtr, mi.UInt32(int(handle)))[0].id()
        here = shapes == handle
        if name in meshes:
            mesh = meshes[name]
            labels[here] = 1 + mesh.first + faces[here] // mesh.faces_each
        elif name.endswith(BEHIND_ENDING):
            labels[here] = UNCOUNTED
    return labels.reshape(height_px, width_px)


def outline(view: View, skin_m: Floats) -> Outline:
    """The pixels whose centres a fruit would cover if nothing stood before it.

    An apple's silhouette is convex to within its own cavity's rim, so that it is the convex hull
    of its projected skin.
    """
    if view.depths_m(skin_m).min() < _NEAREST_M:
        return Outline(0, touches_picture=False)
    seen = view.project(skin_m)
    hull = cv2.convexHull(seen.astype(np.float32)).reshape(-1, 2).astype(float)
    width_px, height_px = view.camera.size_px
    low, high = hull.min(0), hull.max(0)
    touches = bool((high >= 0).all() and (low <= [width_px - 1, height_px - 1]).all())
    rows = np.arange(np.ceil(low[1]), np.floor(high[1]) + 1)
    a, b = hull, np.roll(hull, -1, axis=0)
    rise = np.where(a[:, 1] == b[:, 1], np.nan, b[:, 1] - a[:, 1])
    share = (rows[:, None] - a[None, :, 1]) / rise
    crossing = np.where((share >= 0) & (share <= 1), a[:, 0] + share * (b[:, 0] - a[:, 0]), np.nan)
    first, last = np.nanmin(crossing, axis=1), np.nanmax(crossing, axis=1)
    area = np.maximum(np.floor(last) - np.ceil(first) + 1, 0).sum()
    return Outline(int(area), touches)


def pair_truth(
    poses: tuple[RigPose, RigPose],
    labels: tuple[Labels, Labels],
    apples: list[Apple],
    skins_m: tuple[list[Floats], list[Floats]],
) -> FrameTruth:
    """Centres, radii and visible fractions of every apple whose outline reaches into a view.

    Args:
        poses: the rig at the left and at the right exposure.
        labels: of the left and the right view.
        apples: at rest.
        skins_m: each apple's skin at the left and at the right exposure.
    """
    views = (poses[0].view("left"), poses[1].view("right"))
    counts = [np.bincount(plane.ravel(), minlength=UNCOUNTED + 1) for plane in labels]
    found = []
    for n, apple in enumerate(apples):
        outlines = [outline(view, skins[n]) for view, skins in zip(views, skins_m, strict=True)]
        if not any(o.touches_picture for o in outlines):
            continue
        seen = [
            round(min(1.0, float(count[n + 1]) / o.area_px), 4) if o.area_px else 0.0
            for count, o in zip(counts, outlines, strict=True)
        ]
        moved = skins_m[0][n].mean(0) - apple.surface.points_m.mean(0)
        centre = poses[0].to_left((apple.centre_m + moved)[None])[0]
        x, y, z = (round(float(value), 7) for value in centre)
        found.append(
            AppleTruth(n + 1, (x, y, z), round(apple.radius_m, 7), seen[0], seen[1], "centre")
        )
    return FrameTruth(labels[0], labels[1], tuple(found))


def beam_range_m(scene: Any, pose: RigPose) -> float | None:
    """How far the rangefinder's beam goes until it meets something; None: nothing."""
    beam = pose.rig.rangefinder
    if beam is None:
        return None
    mi = load_mitsuba()
    origin = pose.to_world(beam.origin_m[None])[0]
    direction = pose.to_world(beam.direction[None])[0] - pose.left_m
    si = scene.ray_intersect(rays(origin, direction[None]), ray_flags=mi.RayFlags.Minimal,
                             coherent=True)  # fmt: skip
    range_m = float(np.array(si.t)[0])
    return range_m if np.isfinite(range_m) else None


def reading(
    rng: np.random.Generator,
    time_ns: int,
    range_m: float | None,
    *,
    std_m: float,
    reach_m: float,
    apple_id: int | None,
) -> RangeReading:
    """What the instrument says of that range: noise, tenths of millimetres, or no echo."""
    if range_m is None or range_m > reach_m:
        return RangeReading(time_ns, None, None, "no echo", "g0@E255")
    measured_m = max(0.0, round(range_m + rng.normal(0, std_m), 4))
    raw = f"g0g{round(measured_m * 1e4):+09d}"
    return RangeReading(time_ns, measured_m, std_m, "ok", raw, apple_id)
