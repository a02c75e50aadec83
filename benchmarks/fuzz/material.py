"""The sound files that are mutated: a session, results, rigs, a scene, masks and apples."""

import json
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from processor.replay import Replayed, replay
from recorder.records import RangeReading
from tests.builders import RIG_TOML, session_file
from tests.scenes import TINY, apple, stereo_session, tiny_rig

_OPENCV: Final = """%YAML:1.0
---
image_width: 640
image_height: 480
""" + "".join(
    f"""{key}: !!opencv-matrix
   rows: {rows}
   cols: {columns}
   dt: d
   data: [ {values} ]
"""
    for key, rows, columns, values in (
        ("M1", 3, 3, "570., 0., 320., 0., 571., 240., 0., 0., 1."),
        ("D1", 1, 5, "-0.1, 0.02, 0., 0., 0."),
        ("M2", 3, 3, "572., 0., 318., 0., 573., 242., 0., 0., 1."),
        ("D2", 1, 5, "-0.1, 0.03, 0., 0., 0."),
        ("R", 3, 3, "1., 0., 0., 0., 1., 0., 0., 0., 1."),
        ("T", 3, 1, "-0.2, 0., 0."),
    )
)
_SCENE: Final = """name = "mine"
seed = 31
worlds = 3
light = "back"
cultivar = "gala"
exposures_ev = [-1.0, 0.0]

[trees]
fruit = 30
leaf_density = 1.5

[camera]
size_px = [640, 512]
jpeg_quality = 90

[camera.left]
ev = 0.5

[rig]
focal_px = 577.0
baseline_m = 0.2
toe_in_deg = 1.0

[motion]
pairs = 4
rate_hz = 5.0
"""


def material(folder: Path) -> None:
    """The sound files that everything is mutated from."""
    folder.mkdir(parents=True)
    session_file(folder, 3, name="plain.mcap", readings=True, labelled=True, sync_each=True)
    frames = [[apple(1, 0.01 * i, seen=1.0), apple(2, -0.03, seen=0.8)] for i in range(3)]
    reading = RangeReading(1_000_000_000, 0.36, 0.001, "ok", "g0g+00003600")
    stereo_session(
        folder / "row.mcap", frames, rig=tiny_rig(), lighting="front", readings=[reading]
    )
    (done,) = replay([folder / "row.mcap"], folder / "results", TINY, rrd="none")
    assert isinstance(done, Replayed), done
    (folder / "rig.toml").write_text(RIG_TOML)
    (folder / "rig.yaml").write_text(_OPENCV)
    (folder / "scene.toml").write_text(_SCENE)
    for side in ("left", "right"):
        (folder / "masks" / side).mkdir(parents=True)
        for number in range(3):
            mask = np.zeros((72, 96), np.uint16)
            mask[20:40, 30 : 50 + number] = 1 + number
            cv2.imwrite(str(folder / "masks" / side / f"{number}.png"), mask)
    apples = [
        {"id": 1, "centre_m": [0.0, 0.01, 0.4], "radius_m": 0.04, "left": {"visible_fraction": 0.5}}
    ]
    (folder / "apples.json").write_text(json.dumps([apples, [], apples], indent=1))
