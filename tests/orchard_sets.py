"""Sets of drawn sessions for the experiments: red discs before green, with exact truth."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from processor.discs import true_discs
from recorder.records import SIDES, AppleTruth, Frame, FrameTruth, Note, RangeReading
from recorder.rectify import rectify
from recorder.rig import Rangefinder, parallel_rig
from recorder.session_writer import SessionWriter

SIZE_PX = (640, 512)
RIG = parallel_rig(
    size_px=SIZE_PX,
    focal_px=577.0,
    rangefinder=Rangefinder(np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), 0.001),
)
RED = (50, 40, 190)
GREEN = (60, 120, 70)


def hung(
    z_m: float, x_m: float = 0.1, y_m: float = 0.0, number: int = 1, radius_m: float = 0.04
) -> AppleTruth:
    """An apple wholly seen, by default midway between the cameras."""
    return AppleTruth(number, (x_m, y_m, z_m), radius_m, 1.0, 1.0)


def row_of(*depths_m: float) -> tuple[AppleTruth, ...]:
    """Apples side by side that neither touch nor cross over."""
    return tuple(
        hung(z, 0.1 + 0.16 * (i - (len(depths_m) - 1) / 2), 0.02 * i, i + 1)
        for i, z in enumerate(depths_m)
    )


def write_set(
    path: Path,
    pairs: Sequence[tuple[AppleTruth, ...]],
    about: Mapping[str, str] | None = None,
    *,
    notes: Sequence[str] = (),
    gains: Sequence[float] = (),
    named: int | None = None,
) -> Path:
    """A session of drawn pairs, one a second; the beam reads the front of the first apple.

    Args:
        path: its file; the scene is the file's name.
        pairs: the apples of each pair.
        about: metadata.
        notes: one a pair.
        gains: of each pair's brightness.
        named: the apple that the operator names.
    """
    rectification = rectify(RIG)
    metadata = {"scene": path.stem, "lighting": "front", "split": "test", **(about or {})}
    with SessionWriter.create(path, RIG, metadata) as writer:
        for index, apples in enumerate(pairs):
            time_ns = 1_000_000_000 * (index + 1)
            labels = {side: np.zeros(SIZE_PX[::-1], np.uint16) for side in SIDES}
            for number, side in enumerate(SIDES):
                discs = true_discs(FrameTruth(apples=apples), side, None, rectification)
                assert discs is not None
                picture = np.full((*SIZE_PX[::-1], 3), GREEN, np.uint8)
                rng = np.random.default_rng([index, number, *path.stem.encode()])
                for apple, (x, y, radius) in zip(apples, discs.circles.tolist(), strict=True):
                    centre, size = (round(x), round(y)), round(radius)
                    cv2.circle(picture, centre, size, RED, cv2.FILLED)
                    cv2.circle(labels[side], centre, size, apple.id, cv2.FILLED)
                noisy = picture * (gains[index] if gains else 1.0)
                noisy = noisy + rng.normal(0, 4, picture.shape)
                _, data = cv2.imencode(".png", noisy.clip(0, 255).astype(np.uint8))
                writer.write_frame(Frame(side, time_ns, "png", data.tobytes(), SIZE_PX))
            writer.write_truth(time_ns, FrameTruth(labels["left"], labels["right"], apples))
            front_m = apples[0].centre_m[2] - apples[0].radius_m
            writer.write_reading(RangeReading(time_ns, front_m, 0.001, "ok", "", named))
            for text in notes[index : index + 1]:
                writer.write_note(Note(time_ns, text))
    return path


def write_sets(folder: Path) -> Path:
    """One small session of every set."""
    write_set(folder / "segmentation-front.mcap", [row_of(0.6, 0.65, 0.7), row_of(0.62, 0.7)])
    write_set(
        folder / "segmentation-back.mcap", [row_of(0.7, 0.72), row_of(0.6)], {"lighting": "back"}
    )
    write_set(folder / "matching-front.mcap", [row_of(0.6, 0.62, 0.61), row_of(0.66, 0.7)])
    ranges = (0.5, 0.6, 0.7)
    for name, light, y_m in (("indoor-clear", "indoor", 0.0), ("outdoor-front", "front", 0.0113)):
        write_set(
            folder / f"distance-{name}.mcap",
            [(hung(z, y_m=y_m),) for z in ranges],
            {"lighting": light},
            notes=[f"apple 1 hung at {z * 1000:.0f} mm" for z in ranges],
            named=1,
        )
    write_set(
        folder / "exposure-front.mcap",
        [row_of(0.6, 0.7)] * 3,
        {"exposures_ev": "-2, +0, +2"},
        notes=["exposure -2 EV", "exposure +0 EV", "exposure +2 EV"],
        gains=(0.25, 1.0, 4.0),
    )
    return folder
