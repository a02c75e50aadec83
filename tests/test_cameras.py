"""Cameras through their real drivers: pylon's emulation, MJPEG over HTTP, folders, videos."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from recorder.cameras import Camera, Shot, open_camera
from recorder.equipment import CameraSettings
from recorder.errors import PomologError
from recorder.session import Session
from tests.real_parts import need_module
from tests.rehearsal import rig_with_pictures, start


def jpegs(count: int = 5) -> list[bytes]:
    rng = np.random.default_rng(2)
    pictures = rng.integers(0, 256, (count, 48, 64, 3), np.uint8)
    return [cv2.imencode(".jpg", picture)[1].tobytes() for picture in pictures]


class MjpegServer:
    """An MJPEG camera on loopback: multipart/x-mixed-replace, as IP cameras serve it."""

    def __init__(self, rate_hz: float = 30.0) -> None:
        self.pictures = jpegs()
        self.cut_short = self.silent = False
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                number = 0
                try:
                    while not outer.ended.is_set():
                        if not outer.silent:
                            self._send(outer.pictures[number % len(outer.pictures)])
                            number += 1
                        time.sleep(1 / rate_hz)
                except OSError:
                    return

            def _send(self, picture: bytes) -> None:
                if outer.cut_short:
                    picture = picture[: len(picture) // 2]
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n"
                self.wfile.write(head.encode() + b"\r\n" + picture + b"\r\n")

            def log_message(self, *_: Any) -> None:
                pass

        self.ended = threading.Event()
        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.server.server_port}/"


@contextmanager
def mjpeg() -> Iterator[MjpegServer]:
    need_module("av", "av")
    camera = MjpegServer()
    thread = threading.Thread(target=camera.server.serve_forever, daemon=True)
    thread.start()
    try:
        yield camera
    finally:
        camera.ended.set()
        camera.server.shutdown()
        camera.server.server_close()


def take(settings: CameraSettings, count: int) -> list[Shot]:
    camera = open_camera(settings)
    try:
        shots = [camera.next_shot(1.0) for _ in range(count)]
    finally:
        camera.close()
    return [shot for shot in shots if shot is not None]


def test_mjpeg_is_stored_byte_for_byte() -> None:
    with mjpeg() as camera:
        shots = take(CameraSettings("av", camera.url), 6)
        assert len(shots) == 6
        for shot in shots:
            assert shot.data in camera.pictures
            assert (shot.encoding, shot.size_px) == ("jpeg", (64, 48))
        assert [shot.frame_id for shot in shots] == list(range(1, 7))


def test_two_mjpeg_cameras_are_recorded_byte_for_byte(tmp_path: Path) -> None:
    with mjpeg() as camera:
        rig = rig_with_pictures(tmp_path, size_px=(64, 48), capture="max_skew_ms = 20.0")
        text = rig.read_text().replace('"files"', '"av"')
        for side in ("left", "right"):
            text = text.replace(f"{tmp_path}/{side}", camera.url)
        rig.write_text(text)
        recorder = start(rig, tmp_path, "--duration", "2")
        _, errors = recorder.communicate(timeout=30)
        assert (recorder.returncode, errors) == (0, "")
        with Session(tmp_path / "row.mcap") as session:
            assert len(session) > 10
            for pair in session.pairs():
                assert pair.left.data in camera.pictures
                assert pair.right.data in camera.pictures


def test_a_jpeg_cut_short_is_incomplete() -> None:
    with mjpeg() as camera:
        camera.cut_short = True
        for shot in take(CameraSettings("av", camera.url), 3):
            assert not shot.complete
            assert shot.data == b""


def drain(camera: Camera) -> None:
    """Take shots for five seconds."""
    end_s = time.monotonic() + 5
    while time.monotonic() < end_s:
        camera.next_shot(0.1)


def test_an_mjpeg_camera_that_falls_silent_blocks_nobody() -> None:
    with mjpeg() as camera:
        opened = open_camera(CameraSettings("av", camera.url))
        assert opened.next_shot(1.0) is not None
        camera.silent = True
        begun_s = time.monotonic()
        with pytest.raises(PomologError, match="is gone"):
            drain(opened)
        assert time.monotonic() - begun_s < 4
        opened.close()


def test_an_address_that_serves_nothing_is_one_line() -> None:
    need_module("av", "av")
    with pytest.raises(PomologError, match="no MJPEG camera at"):
        open_camera(CameraSettings("av", "http://127.0.0.1:9/"))


PYLON = """
import sys
from dataclasses import replace
from recorder.cameras import open_camera
from recorder.equipment import CameraSettings
from recorder.errors import PomologError
import cv2, numpy as np

folder, = sys.argv[1:]
features = {"TestImageSelector": "Off", "ImageFileMode": "On", "ImageFilename": folder}
settings = CameraSettings(
    "pylon", "0815-0000", rate_hz=20.0, region_px=(0, 0, 64, 48), features=features
)
camera = open_camera(settings)
other = open_camera(replace(settings, device="0815-0001"))
picture = cv2.imread(folder + "/a.png")
mosaic = np.empty(picture.shape[:2], np.uint8)
for y, x, channel in ((0, 0, 2), (0, 1, 1), (1, 0, 1), (1, 1, 0)):  # R G / G B of BGR
    mosaic[y::2, x::2] = picture[y::2, x::2, channel]
ids = []
for each in (camera, other):
    for _ in range(5):
        shot = each.next_shot(2.0)
        assert shot is not None and shot.complete, shot
        assert shot.encoding == "bayer_rggb8" and shot.size_px == (64, 48)
        assert shot.data == mosaic.tobytes()
        assert shot.device_ns is None  # the emulation stamps nothing
        ids.append(shot.frame_id)
    each.close()
assert ids[:5] == sorted(ids[:5]), ids
camera = open_camera(settings)
camera._camera.ForceFailedBufferCount.Value = 2
camera._camera.ForceFailedBuffer.Execute()
shots = [camera.next_shot(2.0) for _ in range(12)]
camera.close()
assert any(shot and not shot.complete and shot.data == b"" for shot in shots), shots
camera = open_camera(replace(settings, trigger="software"))
assert camera.next_shot(0.3) is None
camera.trigger()
assert camera.next_shot(2.0) is not None
camera.close()
for wrong in (
    replace(settings, device="nobody"),
    replace(settings, features={"NoSuchFeature": 1}),
    replace(settings, pixel_format="NoSuchFormat"),
):
    try:
        open_camera(wrong)
    except PomologError as error:
        print(error)
    else:
        raise AssertionError(wrong)
"""


def test_pylon_plays_known_pictures_bit_exact_and_reports_failed_buffers(tmp_path: Path) -> None:
    need_module("pypylon", "pylon")
    noise = np.random.default_rng(4).integers(0, 256, (48, 64, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), noise)
    done = subprocess.run(  # a process of its own: the emulation is asked for before the import
        [sys.executable, "-c", PYLON, str(tmp_path)],
        env=dict(os.environ) | {"PYLON_CAMEMU": "2"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split(" ")[0] for line in lines] == ["no", "camera", "camera"]


def test_a_folder_plays_its_bytes_in_name_order(tmp_path: Path) -> None:
    pictures = jpegs(3)
    for number, picture in enumerate(pictures):
        (tmp_path / f"{number}.jpg").write_bytes(picture)
    shots = take(CameraSettings("files", str(tmp_path), rate_hz=50), 7)
    numbers = [pictures.index(shot.data) for shot in shots]
    assert all((b - a) % 3 == 1 for a, b in pairwise(numbers))
    intervals = np.diff([shot.device_ns or 0 for shot in shots])
    assert set(intervals) == {20_000_000}


def test_two_folders_show_the_same_moment(tmp_path: Path) -> None:
    for number, picture in enumerate(jpegs(5)):
        (tmp_path / f"{number}.jpg").write_bytes(picture)
    settings = CameraSettings("files", str(tmp_path), rate_hz=50)
    first, second = open_camera(settings), open_camera(settings)
    seen = [
        {s.device_ns: s.data for _ in range(6) if (s := c.next_shot(1.0))} for c in (first, second)
    ]
    common = seen[0].keys() & seen[1].keys()
    assert len(common) >= 1
    assert all(seen[0][time_ns] == seen[1][time_ns] for time_ns in common)


def test_a_video_plays_on_and_on(tmp_path: Path) -> None:
    path = tmp_path / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for level in (40, 120, 200):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    shots = take(CameraSettings("files", str(path), rate_hz=50), 5)
    levels = [round(float(np.frombuffer(shot.data, np.uint8).mean()), -1) for shot in shots]
    assert levels == [40, 120, 200, 40, 120]
    assert shots[0].encoding == "bgr8"


@pytest.mark.parametrize("name", ["nothing-here", "empty"])
def test_nothing_to_play_is_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(PomologError, match="no pictures to play"):
        open_camera(CameraSettings("files", str(tmp_path / name)))
