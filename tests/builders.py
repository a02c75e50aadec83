"""What tests are built of: small pictures, rigs, sessions, and folders of pictures and masks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from recorder.records import (
    COMPRESSED,
    AppleTruth,
    Encoding,
    Frame,
    FrameTruth,
    Labels,
    Picture,
    RangeReading,
    Side,
    StereoPair,
)
from recorder.rig import Camera, Floats, LensModel, Rangefinder, Rig, parallel_rig
from recorder.session import Session
from recorder.session_writer import SessionWriter

SIZE_PX = (64, 48)
SECOND_NS = 1_000_000_000
DATA = Path(__file__).parents[2] / "shared" / "data"  # others' pictures, never part of the project


# pictures


def picture(seed: int = 0, size_px: tuple[int, int] = SIZE_PX) -> Picture:
    """(H, W, 3) noise that differs with the seed, in blocks so that it compresses."""
    width_px, height_px = size_px
    coarse = np.random.default_rng(seed).integers(
        0, 256, (height_px // 8 + 1, width_px // 8 + 1, 3), dtype=np.uint8
    )
    return coarse.repeat(8, axis=0).repeat(8, axis=1)[:height_px, :width_px].copy()


def encoded(encoding: Encoding = "png", seed: int = 0, size_px: tuple[int, int] = SIZE_PX) -> bytes:
    """A picture's bytes as a camera or a file has them."""
    bgr = picture(seed, size_px)
    if encoding == "bgr8":
        return bgr.tobytes()
    if encoding.startswith("bayer"):
        return bgr[..., 0].tobytes()
    done, data = cv2.imencode({"jpeg": ".jpg"}.get(encoding, f".{encoding}"), bgr)
    assert done
    return data.tobytes()


def frame(
    side: Side = "left",
    time_ns: int = 0,
    encoding: Encoding = "png",
    *,
    seed: int = 0,
    size_px: tuple[int, int] = SIZE_PX,
    sequence: int = 0,
) -> Frame:
    """One camera's small picture."""
    return Frame(side, time_ns, encoding, encoded(encoding, seed, size_px), size_px, sequence)


def labels(seed: int = 0, size_px: tuple[int, int] = SIZE_PX) -> Labels:
    """Two square apples, 1 and 2, and one that counts neither way."""
    found = np.zeros((size_px[1], size_px[0]), np.uint16)
    found[4:12, 4 + seed : 12 + seed] = 1
    found[20:30, 20:30] = 2
    found[40:44, 40:44] = 65535
    return found


# rigs


def rig(size_px: tuple[int, int] = SIZE_PX, *, focal_px: float = 60.0, beam: bool = False) -> Rig:
    """A small ideal rig."""
    return parallel_rig(
        size_px=size_px, focal_px=focal_px, rangefinder=rangefinder() if beam else None
    )


def rangefinder() -> Rangefinder:
    """A beam between the cameras, slightly aslant."""
    direction = np.array([0.02, -0.01, 1.0])
    return Rangefinder(np.array([0.1, 0.05, -0.02]), direction / np.linalg.norm(direction), 0.002)


DISTORTIONS: Mapping[LensModel, tuple[float, ...]] = {
    "plumb_bob": (-0.11, 0.04, 0.001, -0.0007, -0.01),
    "rational_polynomial": (0.2, -0.05, 0.0004, -0.0006, 0.01, 0.31, -0.02, 0.005),
    "kannala_brandt": (-0.02, 0.006, -0.003, 0.0008),
}


def real_rig(
    lens: LensModel = "plumb_bob", *, size_px: tuple[int, int] = (640, 480), beam: bool = False
) -> Rig:
    """Two different cameras with lenses, toed in by 3 degrees, rolled and shifted a little."""
    width_px, height_px = size_px
    focal_px = 0.9 * width_px
    cameras = [
        Camera(
            size_px,
            np.array(
                [
                    [focal_px * scale, 0, width_px / 2 + dx],
                    [0, focal_px * scale * 1.002, height_px / 2 + dy],
                    [0, 0, 1.0],
                ]
            ),
            np.array(DISTORTIONS[lens]) * scale,
            lens,
        )
        for scale, dx, dy in ((1.0, 3.0, -2.0), (1.01, -4.0, 5.0))
    ]
    rotation = rotation_of((0.01, 0.05, -0.008))
    return Rig(
        cameras[0],
        cameras[1],
        rotation,
        rotation @ np.array([-0.2, 0.004, 0.006]),
        rangefinder() if beam else None,
    )


def rotation_of(turn_rad: Sequence[float]) -> Floats:
    """The (3, 3) matrix of a rotation vector."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn_rad, float))[0], float)


# sessions


def truth(seed: int = 0, *, apples: Sequence[AppleTruth] | None = None, **flags: Any) -> FrameTruth:
    """Labels in both views and, if given, apples."""
    listed = None if apples is None else tuple(apples)
    return replace(FrameTruth(labels(seed), labels(seed + 1), listed), **flags)


def session_file(
    folder: Path,
    pairs: int = 3,
    *,
    name: str = "s.mcap",
    with_rig: Rig | None = None,
    encoding: Encoding = "png",
    skew_ns: int = 0,
    readings: bool = False,
    labelled: bool = False,
    metadata: Mapping[str, str] | None = None,
    sync_each: bool = False,
) -> Path:
    """A session of small pairs a second apart; each in a chunk of its own with `sync_each`."""
    path = folder / name
    camera_rig = with_rig or rig()
    raw = encoding not in COMPRESSED
    about = {"lighting": "front", "cultivar": "Fuji"} if metadata is None else metadata
    with SessionWriter.create(path, camera_rig, about, raw_images=raw) as session:
        for index in range(pairs):
            time_ns = index * SECOND_NS
            for side, shift_ns in (("left", 0), ("right", skew_ns)):
                session.write_frame(
                    frame(
                        "left" if side == "left" else "right",
                        time_ns + shift_ns,
                        encoding,
                        seed=2 * index + (side == "right"),
                        size_px=camera_rig.left.size_px,
                        sequence=index,
                    )
                )
            if readings:
                session.write_reading(
                    RangeReading(time_ns + 1000, 1.5 + index, 0.001, "ok", f"g0g+{index:08d}")
                )
            if labelled:
                apple = AppleTruth(1, (0.1, -0.05, 1.2 + index), 0.04, 1.0, 0.75)
                session.write_truth(time_ns, truth(index, apples=[apple]))
            if sync_each:
                session.sync()
    return path


def content(path: Path) -> dict[str, Any]:
    """All that a session says, in values that compare with ==.

    Raises:
        PomologError: it cannot be read.
    """
    with Session(path) as session:
        return {
            "metadata": session.metadata,
            "ledger": session.ledger,
            "info": session.info(),
            "rig": session.rig.digest,
            "readings": list(session.readings()),
            "notes": list(session.notes()),
            "pairs": [pair_content(pair) for pair in session.pairs()],
        }


def pair_content(pair: StereoPair) -> tuple[Any, ...]:
    """All that a pair says, in values that compare with ==."""
    frames = tuple(
        (f.side, f.time_ns, f.encoding, f.data, f.size_px, f.sequence)
        for f in (pair.left, pair.right)
    )
    known = pair.truth and (
        None if pair.truth.left is None else pair.truth.left.tobytes(),
        None if pair.truth.right is None else pair.truth.right.tobytes(),
        pair.truth.apples,
        pair.truth.partial,
        pair.truth.identified,
    )
    return pair.index, frames, pair.readings, known, dict(pair.conditions)


# files of masks and pictures


def picture_folders(
    folder: Path,
    pairs: int = 2,
    *,
    kind: Literal["png", "jpeg"] = "png",
    size_px: tuple[int, int] = SIZE_PX,
) -> tuple[Path, Path]:
    """Two folders of pictures with names in order."""
    sides = (folder / "left", folder / "right")
    for place, side in enumerate(sides):
        side.mkdir(parents=True)
        for index in range(pairs):
            data = encoded(kind, 2 * index + place, size_px)
            (side / f"{index:03d}.{'jpg' if kind == 'jpeg' else 'png'}").write_bytes(data)
    return sides


RIG_TOML = """
[left]
size_px = [64, 48]
focal_px = 60.0

[right]
size_px = [64, 48]
focal_px = 60.0

[stereo]
translation_m = [-0.2, 0.0, 0.0]
"""


def rig_file(folder: Path, text: str = RIG_TOML, name: str = "rig.toml") -> Path:
    """A rig on disk."""
    path = folder / name
    path.write_text(text)
    return path
