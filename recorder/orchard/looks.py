"""A look: what one moment's pair shows before any exposure, and keeping it on the disk."""

import json
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from recorder.files import replacing
from recorder.orchard.engine import Floats
from recorder.orchard.noise import Image
from recorder.records import AppleTruth, FrameTruth

_BRIGHTEST: float = float(np.finfo(np.float16).max)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What was cast and rendered of one moment.

    Attributes:
        light: the left and the right view, linear.
        truth: labels and apples.
        range_m: where the beam ends, before the instrument's noise; None: nowhere.
        sun_direction: (3,) in the world, for the flare; None: no sun.
    """

    light: tuple[Image, Image]
    truth: FrameTruth
    range_m: float | None
    sun_direction: Floats | None


def as_kept(light: Image) -> Image:
    """Light rounded to half floats, finer than any camera's noise: as `save_look` keeps it."""
    return np.minimum(light, _BRIGHTEST).astype(np.float16).astype(np.float32)


def save_look(path: Path, look: Look) -> None:
    """Keep a look on the disk."""
    about = {
        "apples": [asdict(apple) for apple in look.truth.apples or ()],
        "range_m": look.range_m,
        "sun_direction": None if look.sun_direction is None else look.sun_direction.tolist(),
    }
    light = [as_kept(plane).astype(np.float16) for plane in look.light]
    labels = [np.asarray(plane, np.uint16) for plane in (look.truth.left, look.truth.right)]
    with replacing(path) as part, part.open("wb") as stream:
        np.savez_compressed(
            stream,
            about=np.frombuffer(json.dumps(about).encode(), np.uint8),
            light_left=light[0],
            light_right=light[1],
            labels_left=labels[0],
            labels_right=labels[1],
        )


def load_look(path: Path) -> Look | None:
    """A kept look; None where the file is damaged, so that it is made again."""
    try:
        with np.load(path, allow_pickle=False) as kept:
            about = json.loads(kept["about"].tobytes())
            light = tuple(kept[f"light_{side}"].astype(np.float32) for side in ("left", "right"))
            labels = (kept["labels_left"], kept["labels_right"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    apples = tuple(
        AppleTruth(**{**apple, "centre_m": tuple(apple["centre_m"])}) for apple in about["apples"]
    )
    sun = about["sun_direction"]
    return Look(
        (light[0], light[1]),
        FrameTruth(labels[0], labels[1], apples),
        about["range_m"],
        None if sun is None else np.array(sun),
    )
