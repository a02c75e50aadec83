"""UVC cameras and MJPEG streams through PyAV: the camera's own JPEG, byte for byte.

FFmpeg's demuxers alone are used (mpjpeg over HTTP, video4linux2 with MJPEG); nothing is decoded.
"""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final

from recorder.cameras import Shot, arrival
from recorder.equipment import CameraSettings
from recorder.errors import PomologError
from recorder.pictures import identify

OPEN_TIMEOUT_S: Final = 5.0
READ_TIMEOUT_S: Final = 1.0  # as long as a camera may be silent


def _library() -> Any:
    try:
        import av
    except ImportError:
        raise PomologError(
            "the driver av is not installed; try: pip install 'pomolog[av]'"
        ) from None
    return av


class AvCamera:
    """A URL that serves MJPEG (multipart/x-mixed-replace), or /dev/videoN.

    A UVC camera's controls (exposure_time_absolute, gain, ...) are v4l2's, not GenICam's: set them
    with v4l2-ctl; `features` here are options of FFmpeg's demuxer (video_size, input_format).

    Raises:
        PomologError: nothing answers there, or it sends no pictures.
    """

    def __init__(self, settings: CameraSettings) -> None:
        self._av = _library()
        self._errors = (self._av.FFmpegError, OSError, ValueError)
        self._device = settings.device
        v4l = settings.device.startswith("/dev/")
        options = {name: str(value) for name, value in settings.features.items()}
        if v4l:
            options = {"input_format": "mjpeg", "framerate": f"{settings.rate_hz:g}"} | options
        try:
            self._container = self._av.open(
                settings.device,
                format="video4linux2" if v4l else "mpjpeg",
                options=options,
                timeout=(OPEN_TIMEOUT_S, READ_TIMEOUT_S),
            )
            self._stream = self._container.streams.video[0]
        except (*self._errors, IndexError) as error:
            raise PomologError(
                f"no MJPEG camera at {settings.device} ({error}); does it play in ffplay?"
            ) from None
        # v4l2 stamps frames with the monotonic clock at exposure; HTTP carries no times
        self._stamped = v4l
        self._frames = 0
        self._packets: Iterator[Any] = self._container.demux(self._stream)

    def next_shot(self, timeout_s: float) -> Shot | None:  # noqa: ARG002  # FFmpeg has its own
        """Wait for a picture, at most a second: then the camera counts as gone.

        Raises:
            PomologError: the stream has ended, broken, or been silent for a second.
        """
        try:
            packet = next(self._packets, None)
        except self._errors as error:
            raise PomologError(
                f"camera {self._device} is gone ({error}); it is opened again"
            ) from None
        if packet is None or packet.size == 0:
            raise PomologError(f"camera {self._device} has ended its stream; it is opened again")
        host_ns, monotonic_ns = arrival()
        data = bytes(packet)
        self._frames += 1
        whole = data.startswith(b"\xff\xd8") and data.rstrip(b"\0").endswith(b"\xff\xd9")
        device_ns = None
        if self._stamped and packet.pts is not None:
            device_ns = int(packet.pts * packet.time_base * 1_000_000_000)
        encoding, size_px = identify(data, "a picture") if whole else ("jpeg", (0, 0))
        return Shot(
            self._frames, device_ns, host_ns, monotonic_ns, encoding, size_px,
            data if whole else b"", "complete" if whole else "cut short",
        )  # fmt: skip

    def trigger(self) -> None:
        """Nothing: such cameras run by themselves."""

    def close(self) -> None:
        """Close the stream."""
        with suppress(*self._errors):
            self._container.close()
