"""From a scene file to a session: grow, look, render, expose, write; what was made is kept."""

import hashlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from recorder.errors import PomologError
from recorder.orchard.camera import rig_pose
from recorder.orchard.engine import Floats, load_mitsuba
from recorder.orchard.looks import Look, as_kept, load_look, save_look
from recorder.orchard.noise import Image
from recorder.orchard.render import RenderQuality, render_view
from recorder.orchard.scene import Scene, Shot, Split
from recorder.orchard.sensor import CameraSetting, encode_picture, metered_gain, take_picture
from recorder.orchard.truth import beam_range_m, pair_truth, reading, see_labels
from recorder.orchard.world import World, grow_world
from recorder.records import COMPRESSED, SIDES, FrameTruth, Labels, Note
from recorder.rig import Rig
from recorder.session import DEFAULT_MAX_SKEW_NS
from recorder.session_writer import SessionWriter

RENDERER: Final = "1"  # part of what a kept picture is known by; count up when pictures change
START_NS: Final = 1_760_000_000_000_000_000  # of every made session: made again, the same bytes
_STILL_RATE_HZ: Final = 1.0  # of pairs that are not a motion
_PREVIEW_SHARE: Final = 4  # a preview is so many times smaller each way
_PREVIEW_SAMPLES: Final = 4


def preview_of(scene: Scene) -> Scene:
    """The same scene, a quarter as wide and high and with fewer light paths."""
    width_px, height_px = (max(32, side // _PREVIEW_SHARE) for side in scene.camera.size_px)
    share = width_px / scene.camera.size_px[0]
    focal_px = scene.rig.focal_px and scene.rig.focal_px * share
    return scene.model_copy(update={
        "camera": scene.camera.model_copy(update={"size_px": (width_px, height_px)}),
        "rig": scene.rig.model_copy(update={"focal_px": focal_px}),
        "render": scene.render.model_copy(update={"samples": _PREVIEW_SAMPLES}),
    })  # fmt: skip


def simulate(
    scene: Scene,
    todo: list[Shot],
    out: Path,
    *,
    cache: Path | None = None,
    metadata: dict[str, str] | None = None,
    tick: Callable[[], None] = lambda: None,
) -> None:
    """Make a session of those shots; pairs that are kept already are not rendered again.

    Args:
        scene: what to make.
        todo: its shots, or some of them.
        out: the session.
        cache: where rendered pairs are kept. None: beside `out` until it is whole, so that a
            killed run resumes.
        metadata: what else the session says of itself.
        tick: called after each pair.

    Raises:
        PomologError: Mitsuba or LLVM is missing, no apple is in view, or the disk is full.
    """
    load_mitsuba()
    rig = scene.make_rig()
    about = {**session_metadata(scene, todo), **(metadata or {})}
    raw = scene.camera.encoding not in COMPRESSED
    period_ns, skew_ns = frame_times(scene)
    if skew_ns > DEFAULT_MAX_SKEW_NS:
        about["max_skew_ns"] = str(2 * skew_ns)
    kept = cache or out.with_name(f"{out.name}.pairs")
    with SessionWriter.create(out, rig, about, raw_images=raw) as writer:
        studio = _Studio(scene, rig, kept)
        for index, shot in enumerate(todo):
            look = studio.look(shot)
            if not scene.motion and not _any_apple(look.truth):
                raise _no_apple(scene, shot)
            time_ns = START_NS + index * period_ns
            _write(writer, scene, rig, shot, look, index, time_ns, skew_ns)
            tick()
    if cache is None:
        shutil.rmtree(kept, ignore_errors=True)


def frame_times(scene: Scene) -> tuple[int, int]:
    """Nanoseconds between pairs, and how much later the right picture is taken than the left."""
    rate_hz = scene.motion.rate_hz if scene.motion else _STILL_RATE_HZ
    skew_s = scene.motion.skew_s if scene.motion else 0.0
    return round(1e9 / rate_hz), round(1e9 * skew_s)


def session_metadata(scene: Scene, todo: list[Shot]) -> dict[str, str]:
    """What the session says of itself."""
    splits: set[Split] = {shot.split for shot in todo}
    entries = {
        "made_by": "simulate",
        "site": "digital orchard",
        "scene": scene.name,
        "scene_hash": scene.digest,
        "seed": str(scene.seed),
        "lighting": "indoor" if scene.place == "room" else scene.light,
        "cultivar": scene.cultivar,
        "split": splits.pop() if len(splits) == 1 else "both",
    }
    if len(scene.exposures_ev) > 1:
        entries["exposures_ev"] = ", ".join(f"{ev:+g}" for ev in scene.exposures_ev)
    if scene.specimen:
        entries["occlusion"] = scene.specimen.hidden_by
    return entries


def _any_apple(truth: FrameTruth) -> bool:
    return any((a.left_visible or 0) + (a.right_visible or 0) > 0 for a in truth.apples or ())


def _no_apple(scene: Scene, shot: Shot) -> PomologError:
    key = "specimen.range_m" if scene.specimen else "trees.fruit"
    return PomologError(
        f"scene {scene.name}: no apple is in view of either camera with seed {shot.seed}; "
        f"change [{key}] or [seed]"
    )


class _Studio:
    """Grows worlds and looks at them, one at a time; the last is kept for the next shot."""

    def __init__(self, scene: Scene, rig: Rig, cache: Path) -> None:
        self._scene, self._rig, self._cache = scene, rig, cache
        self._seen: tuple[str, Look] | None = None
        self._grown: tuple[tuple[int, float | None], World, Any] | None = None

    def look(self, shot: Shot) -> Look:
        """The shot's light and truth: remembered, kept on the disk, or rendered now."""
        key = look_key(self._scene, shot)
        if self._seen is None or self._seen[0] != key:
            kept = self._cache / f"{key}.npz"
            look = load_look(kept) if kept.is_file() else None
            if look is None:
                look = self._render(shot)
                save_look(kept, look)
            self._seen = (key, look)
        return self._seen[1]

    def _world(self, shot: Shot) -> tuple[World, Any]:
        place = (shot.seed, shot.range_m)
        if self._grown is None or self._grown[0] != place:
            self._grown = None  # let go of the old one before growing the next
            world = grow_world(self._scene, shot)
            self._grown = (place, world, load_mitsuba().load_dict(world.shapes))
        return self._grown[1], self._grown[2]

    def _render(self, shot: Shot) -> Look:
        world, scene = self._world(shot)
        motion = self._scene.motion
        period_ns, skew_ns = frame_times(self._scene)
        quality = RenderQuality(
            self._scene.render.samples, self._scene.render.bounces, shot.range_m or 0.95
        )
        lights: list[Image] = []
        labels: list[Labels] = []
        skins: list[list[Floats]] = []
        range_m, poses = None, []
        for n, side in enumerate(SIDES):
            time_s = (shot.step * period_ns + n * skew_ns) / 1e9 if motion else 0.0
            pose = rig_pose(self._rig, motion.speed_m_s * time_s if motion else 0.0)
            skins.append(_blow(world, scene, time_s, motion.wind_m if motion else 0.0))
            view = pose.view(side)
            labels.append(see_labels(scene, view, world.fruit))
            if side == "left":
                range_m = beam_range_m(scene, pose)
            seed = (shot.seed * 4099 + shot.step * 2 + n) % 1_000_003
            lights.append(as_kept(render_view(scene, view, quality, seed)))
            poses.append(pose)
        truth = pair_truth((poses[0], poses[1]), (labels[0], labels[1]), world.apples,
                           (skins[0], skins[1]))  # fmt: skip
        return Look((lights[0], lights[1]), truth, range_m, world.sun_direction)


def _blow(world: World, scene: Any, time_s: float, wind_m: float) -> list[Floats]:
    """Move what the wind moves, in Mitsuba's scene; each apple's skin as it is then."""
    rest = [apple.surface.points_m for apple in world.apples]
    if wind_m == 0:
        return rest
    parameters = load_mitsuba().traverse(scene)
    for name, points_m in world.swinging.items():
        moved = points_m + world.offsets_m(name, time_s, wind_m)[:, None]
        parameters[f"{name}.vertex_positions"] = moved.astype(np.float32).ravel()
        for mesh in world.fruit:
            if mesh.name == name:
                rest[mesh.first : mesh.first + mesh.count] = list(moved)
    parameters.update()
    return rest


def look_key(scene: Scene, shot: Shot) -> str:
    """What a rendered pair is known by: everything that shapes its light, and nothing else."""
    others = {"name", "worlds", "seed", "exposures_ev", "rangefinder", "camera"}
    settings = scene.model_dump_json(exclude=others)
    beam = scene.rangefinder.model_dump_json(include={"origin_m", "direction"})
    shot_part = f"{shot.seed} {shot.range_m} {shot.step} {scene.camera.size_px}"
    whole = f"{RENDERER} {settings} {beam} {shot_part}"
    return hashlib.sha256(whole.encode()).hexdigest()[:24]


def _write(
    writer: SessionWriter,
    scene: Scene,
    rig: Rig,
    shot: Shot,
    look: Look,
    index: int,
    time_ns: int,
    skew_ns: int,
) -> None:
    """Expose one look and write its frames, reading, truth and note."""
    pose = rig_pose(rig, 0.0)
    gain = metered_gain(look.light[0])  # both cameras follow the left one's meter
    for n, side in enumerate(SIDES):
        own = scene.camera.left if side == "left" else scene.camera.right
        setting = CameraSetting(own.ev + shot.ev, own.white_balance)
        rng = np.random.default_rng([shot.seed, shot.step, n, round(1000 * (shot.ev + 8))])
        picture = take_picture(
            look.light[n], pose.view(side), gain, setting, rng, look.sun_direction
        )
        camera = scene.camera
        writer.write_frame(encode_picture(
            picture, side, time_ns + n * skew_ns, index, camera.encoding, camera.jpeg_quality
        ))  # fmt: skip
    writer.write_truth(time_ns, look.truth)
    for instant in _readings(scene, shot, look, time_ns):
        writer.write_reading(instant)
    for text in _notes(scene, shot):
        writer.write_note(Note(time_ns, text))


def _readings(scene: Scene, shot: Shot, look: Look, time_ns: int) -> Iterator[Any]:
    rng = np.random.default_rng([shot.seed, shot.step, 77])
    beam = scene.rangefinder
    yield reading(rng, time_ns, look.range_m, std_m=beam.std_m, reach_m=beam.reach_m,
                  apple_id=1 if scene.specimen else None)  # fmt: skip


def _notes(scene: Scene, shot: Shot) -> Iterator[str]:
    if shot.range_m is not None:
        yield f"apple 1 hung at {shot.range_m * 1000:.0f} mm"
    if len(scene.exposures_ev) > 1:
        yield f"exposure {shot.ev:+g} EV"
