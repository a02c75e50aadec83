"""A drawn session: shaded apples among leaves, seen by both cameras, with exact truth, in a second.

It stands in where no recorded session is at hand, such as `pomolog demo` without the repository.
Photo-like sessions come from the digital orchard.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from recorder.records import SIDES, AppleTruth, Frame, FrameTruth, Labels, Note, Side
from recorder.rig import Floats, Rig, parallel_rig
from recorder.session_writer import SessionWriter

SIZE_PX: Final = (640, 512)
FOCAL_PX: Final = 577.0  # the paper's lens at half its picture
PERIOD_NS: Final = 1_000_000_000
_APPLES: Final = 9
_LEAVES: Final = 420
_SKIN: Final = np.array([38.0, 44.0, 205.0])  # BGR
_LEAF: Final = np.array([46.0, 118.0, 62.0])
_JPEG: Final = [cv2.IMWRITE_JPEG_QUALITY, 92,
                cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]  # fmt: skip
# light -> where it comes from (x right, y down, z forward), how strong, how much from everywhere
_LIGHTS: Final = {
    "front": ((-0.4, -0.6, -0.7), 0.75, 0.45),
    "back": ((0.3, -0.6, 0.75), 0.6, 0.5),
    "cloudy": ((0.0, -1.0, -0.2), 0.3, 0.6),
}


@dataclass(frozen=True, slots=True, eq=False)
class _Leaf:
    outline_m: Floats  # (N, 3) in the left camera's frame
    shade: float


@dataclass(frozen=True, slots=True)
class _Fruit:
    id: int
    centre_m: tuple[float, float, float]
    radius_m: float


def sketch(path: Path, *, pairs: int = 6, seed: int = 0) -> None:
    """Draw a session.

    Args:
        path: the session to write.
        pairs: how many, a second apart, in front, back and cloudy light by turns.
        seed: of what grows.
    """
    rig = parallel_rig(size_px=SIZE_PX, focal_px=FOCAL_PX)
    about = {"cultivar": "drawn", "site": "nowhere", "made_by": "pomolog demo", "seed": str(seed)}
    with SessionWriter.create(path, rig, about) as writer:
        for index in range(pairs):
            time_ns, light = index * PERIOD_NS, list(_LIGHTS)[index % len(_LIGHTS)]
            rng = np.random.default_rng([seed, index])
            fruit, leaves = _grow(rng)
            writer.write_note(Note(time_ns, f"lighting={light}"))
            labels: dict[Side, Labels] = {}
            for side in SIDES:
                picture, labels[side] = _draw(rig, side, fruit, leaves, light)
                noisy = picture + rng.normal(0, 2.0, picture.shape)
                _, data = cv2.imencode(".jpg", noisy.clip(0, 255).astype(np.uint8), _JPEG)
                writer.write_frame(Frame(side, time_ns, "jpeg", data.tobytes(), SIZE_PX, index))
            apples = tuple(_truth(rig, one, labels) for one in fruit)
            writer.write_truth(time_ns, FrameTruth(labels["left"], labels["right"], apples))


def _grow(rng: np.random.Generator) -> tuple[list[_Fruit], list[_Leaf]]:
    """Apples that do not touch, 0.75 to 1.3 m away, and leaves before and behind them."""
    fruit: list[_Fruit] = []
    while len(fruit) < _APPLES:
        depth_m = float(rng.uniform(0.75, 1.3))
        reach_m = 0.4 * depth_m
        at = (float(rng.uniform(-reach_m, reach_m)) + 0.1, float(rng.uniform(-0.8, 0.8)) * reach_m)
        one = _Fruit(len(fruit) + 1, (*at, depth_m), float(rng.uniform(0.033, 0.042)))
        apart = (np.linalg.norm(np.subtract(one.centre_m, other.centre_m)) for other in fruit)
        if all(gap > 0.1 for gap in apart):
            fruit.append(one)
    leaves = []
    for _ in range(_LEAVES):
        depth_m = float(rng.choice([rng.uniform(0.85, 1.25), rng.uniform(1.35, 2.4)], p=[0.2, 0.8]))
        middle = np.array([*rng.uniform(-0.75, 0.75, 2) * depth_m, depth_m])
        along, turn = rng.uniform(0.02, 0.045), rng.uniform(0, 2 * np.pi)
        angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        blade = np.stack([np.cos(angle) * along, np.sin(angle) * np.abs(np.cos(angle / 2)) * along])
        spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        outline = np.column_stack([(spin @ blade).T, rng.normal(0, 0.005, 24)]) + middle
        leaves.append(_Leaf(outline, float(rng.uniform(0.5, 1.15))))
    return fruit, leaves


def _draw(
    rig: Rig, side: Side, fruit: list[_Fruit], leaves: list[_Leaf], light: str
) -> tuple[Floats, Labels]:
    """One view, painted from back to front, and the label of every pixel."""
    height_px, width_px = SIZE_PX[::-1]
    fade = np.linspace(1.0, 0.55, height_px)[:, None, None]
    picture = np.full((height_px, width_px, 3), (205.0, 196.0, 186.0)) * fade
    labels = np.zeros((height_px, width_px), np.uint16)
    shift_m = np.zeros(3) if side == "left" else rig.translation_m
    _, strength, around = _LIGHTS[light]
    things: list[tuple[float, _Leaf | _Fruit]] = [
        *((float(leaf.outline_m[:, 2].mean()), leaf) for leaf in leaves),
        *((one.centre_m[2], one) for one in fruit),
    ]
    for _, thing in sorted(things, key=lambda found: -found[0]):
        if isinstance(thing, _Leaf):
            outline = np.round(_project(thing.outline_m + shift_m)).astype(np.int32)
            colour = _LEAF * thing.shade * (strength + around)
            cv2.fillPoly(picture, [outline], colour.tolist(), cv2.LINE_8)
            cv2.fillPoly(labels, [outline], 0)
        else:
            rows, columns, colours = _skin(thing, shift_m, light)
            picture[rows, columns] = colours
            labels[rows, columns] = thing.id
    return picture, labels


def _project(points_m: Floats) -> Floats:
    """Points (N, 3) of a camera's frame -> pixels (N, 2)."""
    middle_px = (np.array(SIZE_PX) - 1) / 2
    return np.asarray(FOCAL_PX * points_m[:, :2] / points_m[:, 2:] + middle_px)


def _skin(
    one: _Fruit, shift_m: Floats, light: str
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Floats]:
    """The pixels whose ray meets the sphere, rows and columns (N,), and their colours (N, 3)."""
    centre = np.asarray(one.centre_m) + shift_m
    x, y = _project(centre[None])[0]
    reach = FOCAL_PX * one.radius_m / (centre[2] - one.radius_m) + 1
    columns, rows = np.meshgrid(
        np.arange(max(0, int(x - reach)), min(SIZE_PX[0], int(x + reach) + 1)),
        np.arange(max(0, int(y - reach)), min(SIZE_PX[1], int(y + reach) + 1)),
    )
    middle_px = (np.array(SIZE_PX) - 1) / 2
    rays = np.stack([(columns - middle_px[0]) / FOCAL_PX, (rows - middle_px[1]) / FOCAL_PX,
                     np.ones(columns.shape)], -1)  # fmt: skip
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = rays @ centre
    inside = one.radius_m**2 - (centre @ centre - along**2)
    met = inside > 0
    hit = rays[met] * (along[met] - np.sqrt(inside[met]))[:, None]
    normal = (hit - centre) / one.radius_m
    direction, strength, around = _LIGHTS[light]
    towards = np.array(direction) / np.linalg.norm(direction)
    lit = (normal @ towards).clip(0, 1)
    mirrored = 2 * lit[:, None] * normal - towards
    shine = (-(mirrored * rays[met]).sum(1)).clip(0, 1) ** 30
    colours = _SKIN * (around + strength * lit)[:, None] + 160 * strength * shine[:, None]
    return rows[met], columns[met], colours


def _truth(rig: Rig, one: _Fruit, labels: dict[Side, Labels]) -> AppleTruth:
    """The apple with the share of its outline that each view shows."""
    shares = []
    for side in SIDES:
        shift_m = np.zeros(3) if side == "left" else rig.translation_m
        x, y, z = np.asarray(one.centre_m) + shift_m
        # a sphere's outline: an ellipse whose area follows from the cone of rays that touch it
        flat = z**2 - one.radius_m**2
        whole_px = np.pi * FOCAL_PX**2 * one.radius_m**2 * np.sqrt(
            (x**2 + y**2 + z**2 - one.radius_m**2) / flat**3
        )  # fmt: skip
        shares.append(float(min(1.0, (labels[side] == one.id).sum() / whole_px)))
    return AppleTruth(one.id, one.centre_m, one.radius_m, shares[0], shares[1])
