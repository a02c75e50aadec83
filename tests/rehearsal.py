"""Rehearsals: the real `pomolog record` on folders of pictures, in a process of its own."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

RIG = """
[left]
size_px = [{width}, {height}]
focal_px = 600.0
[right]
size_px = [{width}, {height}]
focal_px = 600.0
[stereo]
translation_m = [-0.2, 0.0, 0.0]
[rangefinder]
origin_m = [0.1, 0.0, 0.0]
[cameras.left]
driver = "files"
device = "{folder}/left"
rate_hz = {rate_hz}
[cameras.right]
driver = "files"
device = "{folder}/right"
rate_hz = {rate_hz}
[capture]
reserve_mb = {reserve_mb}
{capture}
"""


def rig_with_pictures(
    folder: Path,
    *,
    size_px: tuple[int, int] = (160, 120),
    rate_hz: float = 15.0,
    reserve_mb: float = 1.0,
    capture: str = "",
    more: str = "",
    pictures: int = 4,
) -> Path:
    """A rig.toml whose cameras play numbered pictures of noise."""
    width, height = size_px
    rng = np.random.default_rng(5)
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
        for number in range(pictures):
            noise = rng.integers(0, 256, (height, width, 3), np.uint8)
            cv2.imwrite(str(folder / side / f"{number}.jpg"), noise)
    rig = folder / "rig.toml"
    rig.write_text(
        RIG.format(
            width=width,
            height=height,
            folder=folder,
            rate_hz=rate_hz,
            reserve_mb=reserve_mb,
            capture=capture,
        )
        + more
    )
    return rig


def start(rig: Path, out: Path, *more: str) -> "subprocess.Popen[str]":
    """Start a recording named `row`; one that a failed test forgets does not fill the disk."""
    asked = ["record", "--rig", str(rig), "--out", str(out), "--name", "row"]
    words = [*asked, "--duration", "90", *more]
    return subprocess.Popen(
        [sys.executable, "-m", "pomolog", *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
