"""Scenes with two software GigE cameras, played inside a network namespace of their own.

python -m tests.gige_scene SCENE OUT SECONDS: starts the cameras, records with the real command, and
leaves OUT/scene.mcap. The tests that call this judge the session.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

LEFT, RIGHT = "127.0.0.2", "127.0.0.3"
FAKETIME = Path("/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1")

RIG = """
[left]
size_px = [{width}, {height}]
focal_px = 600.0
[right]
size_px = [{width}, {height}]
focal_px = 600.0
[stereo]
translation_m = [-0.2, 0.0, 0.0]
[capture]
max_skew_ms = 20.0  # software cameras wake when the scheduler lets them
reserve_mb = 50.0
silence_s = {silence_s}
[cameras.left]
driver = "aravis"
device = "127.0.0.2"
region_px = [0, 0, {width}, {height}]
packet_bytes = 8192
rate_hz = {rate_hz}
{left}
[cameras.right]
driver = "aravis"
device = "127.0.0.3"
region_px = [0, 0, {width}, {height}]
packet_bytes = 8192
rate_hz = {rate_hz}
{right}
"""


def environment(faketime: str | None = None, file: Path | None = None) -> dict[str, str]:
    """This environment, with libfaketime's lies about the wall clock alone."""
    lies: dict[str, str] = {}
    if faketime is not None or file is not None:
        lies = {"LD_PRELOAD": str(FAKETIME), "DONT_FAKE_MONOTONIC": "1", "FAKETIME_NO_CACHE": "1"}
    if faketime is not None:
        lies["FAKETIME"] = faketime
    if file is not None:
        lies["FAKETIME_TIMESTAMP_FILE"] = str(file)
    return dict(os.environ) | lies


def start_camera(
    address: str, *, lost: float = 0.0, env: Mapping[str, str] | None = None
) -> "subprocess.Popen[bytes]":
    camera = subprocess.Popen(
        [sys.executable, "-m", "tests.fake_gige", address, str(lost)],
        stdout=subprocess.PIPE,
        env=env,
    )
    assert camera.stdout is not None
    assert camera.stdout.readline() == b"ready\n", f"no fake camera at {address}"
    return camera


def start_recorder(
    rig: Path, out: Path, env: Mapping[str, str] | None = None
) -> "subprocess.Popen[bytes]":
    words = ["record", "--rig", str(rig), "--out", str(out), "--name", "scene", "--json"]
    return subprocess.Popen(
        [sys.executable, "-m", "pomolog", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        env=env,
    )


def play(scene: str, out: Path, seconds: float) -> int:
    out.mkdir(parents=True, exist_ok=True)
    rig = out / "rig.toml"
    left = right = ""
    size = {"width": 640, "height": 480, "rate_hz": 30.0 if scene == "plain" else 15.0}
    lost, camera_env, recorder_env = 0.0, None, None
    clock = out / "clock"
    if scene == "lossy":
        lost = 0.003
    if scene == "exposure":
        left = "features = { ExposureTimeAbs = 5000.0, GainRaw = 2 }"
    if scene == "triggered":
        left = right = 'trigger = "software"'
    if scene == "drift":
        camera_env = environment("+1000000s x1.0002")
        clock.write_text("+0")
        recorder_env = environment(file=clock)
    if scene == "full-size":
        size = {"width": 1280, "height": 1024, "rate_hz": 15.0}
    # A camera that a busy machine holds up is not gone, and each frame's id still accounts for it.
    silence_s = 2.0 if scene == "killed" else 20.0
    rig.write_text(RIG.format(left=left, right=right, silence_s=silence_s, **size))
    cameras = [start_camera(LEFT, lost=lost), start_camera(RIGHT, env=camera_env)]
    recorder = start_recorder(rig, out, recorder_env)
    part = out / "scene.mcap.part"
    while not part.exists() and recorder.poll() is None:
        time.sleep(0.05)
    time.sleep(seconds / 2)
    if scene == "killed":
        cameras[1].kill()
        cameras[1].wait()
        time.sleep(2.5)
        cameras[1] = start_camera(RIGHT)
    if scene == "drift":
        clock.write_text("+3600s")  # the wall clock steps by an hour
    time.sleep(seconds / 2)
    recorder.send_signal(signal.SIGINT)
    code = recorder.wait(30)
    for camera in cameras:
        camera.kill()
        camera.wait()
    return code


if __name__ == "__main__":
    sys.exit(play(sys.argv[1], Path(sys.argv[2]), float(sys.argv[3])))
