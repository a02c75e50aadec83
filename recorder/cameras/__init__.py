"""Cameras behind one small protocol: open, take what comes, close."""

import time
from dataclasses import dataclass, field
from importlib import import_module
from typing import Final, Protocol, cast

import cv2
import numpy as np

from recorder.equipment import CameraDriver, CameraSettings
from recorder.errors import PomologError
from recorder.records import Encoding

# The pixel formats of GenICam's SFNC and PFNC that a session can keep without loss of meaning.
PIXEL_FORMATS: Final[dict[str, Encoding]] = {
    "BayerRG8": "bayer_rggb8",
    "BGR8": "bgr8",
    "RGB8": "bgr8",  # turned round on arrival
}
BUFFERS: Final = 24  # 32 MB of 1280 x 1024 pictures: 0.8 s of a stalled computer at 30 fps


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """What a camera delivered: a picture, or what is left of one.

    Attributes:
        frame_id: the camera's own count, where it has one.
        device_ns: exposure on the camera's clock, where it has one.
        host_ns: arrival by the computer's wall clock, which may step.
        monotonic_ns: arrival by its monotonic clock.
        data: the picture's bytes, untouched; empty where it is incomplete.
        status: "complete", or the driver's word for what is wrong with it.
    """

    frame_id: int | None
    device_ns: int | None
    host_ns: int
    monotonic_ns: int
    encoding: Encoding
    size_px: tuple[int, int]
    data: bytes = field(repr=False)
    status: str = "complete"

    @property
    def complete(self) -> bool:
        """Whether the whole picture is there."""
        return self.status == "complete"


class Camera(Protocol):
    """An open camera. One thread takes the shots; another may trigger."""

    def next_shot(self, timeout_s: float) -> Shot | None:
        """Wait for a shot; None where none came in time.

        Raises:
            PomologError: the camera is gone.
        """
        ...

    def trigger(self) -> None:
        """Ask for one picture (software trigger); nothing where the camera runs by itself.

        Raises:
            PomologError: the camera is gone.
        """
        ...

    def close(self) -> None:
        """Let go of the camera; a camera that is gone closes without a word."""
        ...


# driver -> (module, its class)
DRIVERS: Final[dict[CameraDriver, tuple[str, str]]] = {
    "aravis": ("recorder.cameras.aravis", "AravisCamera"),
    "pylon": ("recorder.cameras.pylon", "PylonCamera"),
    "av": ("recorder.cameras.av", "AvCamera"),
    "files": ("recorder.cameras.files", "FilesCamera"),
}


def open_camera(settings: CameraSettings) -> Camera:
    """Open a camera and start it.

    Raises:
        PomologError: no such camera, a setting it refuses, or a library that is not installed.
    """
    module, name = DRIVERS[settings.driver]
    return cast("Camera", getattr(import_module(module), name)(settings))


def stored_encoding(pixel_format: str, device: str) -> Encoding:
    """The session's name of a camera's pixel format.

    Raises:
        PomologError: a format that a session cannot keep.
    """
    if pixel_format not in PIXEL_FORMATS:
        raise PomologError(
            f"camera {device} gives {pixel_format}, which a session cannot keep; "
            f"set pixel_format to one of {', '.join(PIXEL_FORMATS)}"
        )
    return PIXEL_FORMATS[pixel_format]


def as_bgr(rgb: bytes, size_px: tuple[int, int]) -> bytes:
    """RGB8 pixels turned round: a session keeps BGR8."""
    picture = np.frombuffer(rgb, np.uint8).reshape(size_px[1], size_px[0], 3)
    return cv2.cvtColor(picture, cv2.COLOR_RGB2BGR).tobytes()


def no_trigger(device: str, reason: str) -> PomologError:
    """What a driver says of a camera that was asked for a picture and refused."""
    return PomologError(f"camera {device} takes no trigger ({reason}); is it still plugged in?")


def arrival() -> tuple[int, int]:
    """Wall and monotonic time of arrival: now.

    Drivers stamp arrival by the wall clock, which may step at that very moment; the thread that
    waits for the picture is late by a millisecond at times, which the clock's map forgives.
    """
    return time.time_ns(), time.monotonic_ns()
