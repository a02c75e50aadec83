"""Pictures and videos played as a camera: for rehearsals, demonstrations and tests.

Two such cameras of one rate show their n-th pictures at the same moments, whenever they were
opened, as cameras on one trigger do.
"""

import time
from itertools import count
from pathlib import Path
from threading import Event
from typing import Final

import cv2

from recorder.cameras import Shot, arrival
from recorder.equipment import CameraSettings
from recorder.errors import PomologError
from recorder.pictures import identify, read_picture

SUFFIXES: Final = frozenset((".jpg", ".jpeg", ".png", ".webp"))


class FilesCamera:
    """A folder of JPEG, PNG or WebP pictures in name order (bytes untouched), or a video (BGR).

    The pictures repeat without end.

    Raises:
        PomologError: nothing there, or nothing that can be played.
    """

    def __init__(self, settings: CameraSettings) -> None:
        self._path = Path(settings.device)
        self._period_ns = round(1e9 / settings.rate_hz)
        self._paths = []
        self._video: cv2.VideoCapture | None = None
        self._closed = Event()
        if self._path.is_dir():
            self._paths = sorted(p for p in self._path.iterdir() if p.suffix.lower() in SUFFIXES)
        elif self._path.is_file():
            self._video = cv2.VideoCapture(str(self._path))
            if not self._video.isOpened():
                raise PomologError(
                    f"{self._path} is no video that can be played; "
                    "give a folder of pictures, or an AVI or MP4"
                )
        if not self._paths and self._video is None:
            raise PomologError(f"no pictures to play at {self._path}; is the name right?")
        self._tick = count(time.monotonic_ns() // self._period_ns + 1)
        self._next = next(self._tick)

    def next_shot(self, timeout_s: float) -> Shot | None:
        """Wait for the next picture's moment."""
        due_ns = self._next * self._period_ns
        wait_s = (due_ns - time.monotonic_ns()) / 1e9
        if self._closed.wait(max(0.0, min(wait_s, timeout_s))) or wait_s > timeout_s:
            return None
        tick, self._next = self._next, next(self._tick)
        host_ns, monotonic_ns = arrival()
        if self._video is not None:
            data, size_px = self._frame()
            return Shot(tick, due_ns, host_ns, monotonic_ns, "bgr8", size_px, data)
        path = self._paths[tick % len(self._paths)]
        data = read_picture(path)
        encoding, size_px = identify(data, str(path))
        return Shot(tick, due_ns, host_ns, monotonic_ns, encoding, size_px, data)

    def _frame(self) -> tuple[bytes, tuple[int, int]]:
        assert self._video is not None
        read, picture = self._video.read()
        if not read:  # from the beginning again
            self._video.set(cv2.CAP_PROP_POS_FRAMES, 0)
            read, picture = self._video.read()
        if not read or picture is None:
            raise PomologError(f"{self._path} ends without a picture; does it play elsewhere?")
        return picture.tobytes(), (picture.shape[1], picture.shape[0])

    def trigger(self) -> None:
        """Nothing: files keep their own pace."""

    def close(self) -> None:
        """Let go of the file."""
        self._closed.set()
        if self._video is not None:
            self._video.release()
