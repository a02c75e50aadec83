"""GigE Vision and USB3 Vision cameras through Aravis (the paper's kind of camera).

Feature names are GenICam SFNC; frame ids are the camera's (16 bits in GigE Vision 1). Needs
Aravis' typelib (Debian: gir1.2-aravis-0.8) and PyGObject.
"""

import time
from contextlib import suppress
from threading import Event
from typing import Any, Final

from recorder.cameras import BUFFERS, Shot, arrival, as_bgr, no_trigger, stored_encoding
from recorder.equipment import CameraSettings, Feature
from recorder.errors import PomologError

HEARTBEAT_S: Final = 4.0  # GigE Vision cameras give up a dead program after 3 s, unless told else
SETTLE_S: Final = 0.2  # until a camera that was running has noticed that it was stopped


def _library() -> Any:
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
    except (ImportError, ValueError) as error:
        raise PomologError(
            f"the driver aravis is not installed ({error}); try: apt install gir1.2-aravis-0.8 "
            "libgirepository1.0-dev libcairo2-dev pkg-config gcc; pip install 'pomolog[aravis]'"
        ) from None
    return Aravis


class AravisCamera:
    """One camera, opened by address, serial number or "Vendor-Model-Serial", and started.

    Raises:
        PomologError: no such camera, or a feature that it refuses.
    """

    def __init__(self, settings: CameraSettings) -> None:
        self._aravis = _library()
        self._patience = Event()  # never set: waits that no stepping clock disturbs
        from gi.repository import GLib

        self._error: type[Exception] = GLib.Error
        self._device = settings.device
        self._software = settings.trigger == "software"
        self._camera = self._open()
        try:
            self._configure(settings)
            self._start()
        except self._error as error:
            self.close()
            raise PomologError(
                f"camera {settings.device} refuses its settings ({_reason(error)}); "
                f"see what it has: arv-tool-0.8 -a {settings.device} features"
            ) from None
        except PomologError:
            self.close()
            raise

    def _open(self) -> Any:
        """Open the device; one that a dead program still controls is waited for."""
        until_s = time.monotonic() + HEARTBEAT_S
        while True:
            try:
                camera = self._aravis.Camera.new(self._device)
            except self._error as error:
                raise PomologError(
                    f"no camera {self._device} ({_reason(error)}); see what is there: arv-tool-0.8"
                ) from None
            if not camera.is_gv_device() or camera.get_device().is_controller():
                return camera
            if time.monotonic() > until_s:
                raise PomologError(
                    f"camera {self._device} is in use by another program; close that first"
                )
            del camera  # opened anew, because only then its heartbeat is kept up
            self._patience.wait(0.3)

    def _configure(self, settings: CameraSettings) -> None:
        camera = self._camera
        with suppress(self._error):  # a program that died left it running, its features locked
            camera.stop_acquisition()
        self._patience.wait(SETTLE_S)
        if settings.region_px is not None:
            camera.set_region(*settings.region_px)
        camera.set_pixel_format_from_string(settings.pixel_format)
        self._encoding = stored_encoding(camera.get_pixel_format_as_string(), self._device)
        self._swap = settings.pixel_format == "RGB8"
        if camera.is_gv_device():
            if settings.packet_bytes is not None:
                camera.gv_set_packet_size(settings.packet_bytes)
            else:
                camera.gv_auto_packet_size()
        for name, value in settings.features.items():
            self._set(name, value)
        if settings.trigger == "off":
            camera.clear_triggers()
            camera.set_frame_rate(settings.rate_hz)
        else:
            camera.set_trigger("Software" if self._software else settings.trigger)
        camera.set_acquisition_mode(self._aravis.AcquisitionMode.CONTINUOUS)

    def _set(self, name: str, value: Feature) -> None:
        if not self._camera.is_feature_available(name):
            raise PomologError(
                f"camera {self._device} has no feature {name}; "
                f"see what it has: arv-tool-0.8 -a {self._device} features"
            )
        setters = {
            bool: self._camera.set_boolean,
            int: self._camera.set_integer,
            float: self._camera.set_float,
            str: self._camera.set_string,
        }
        setters[type(value)](name, value)

    def _start(self) -> None:
        self._stream = self._camera.create_stream(None, None)
        if self._stream is None:
            raise PomologError(f"camera {self._device} gives no stream; is another program on it?")
        payload = self._camera.get_payload()
        for _ in range(BUFFERS):
            self._stream.push_buffer(self._aravis.Buffer.new_allocate(payload))
        self._camera.start_acquisition()

    def next_shot(self, timeout_s: float) -> Shot | None:
        """Wait for a shot; None where none came in time."""
        buffer = self._stream.timeout_pop_buffer(round(timeout_s * 1e6))
        if buffer is None:
            return None
        host_ns, monotonic_ns = arrival()
        status = buffer.get_status()
        whole = status == self._aravis.BufferStatus.SUCCESS
        size_px = (buffer.get_image_width(), buffer.get_image_height()) if whole else (0, 0)
        data = bytes(buffer.get_image_data()) if whole else b""
        if self._swap and whole:
            data = as_bgr(data, size_px)
        shot = Shot(
            frame_id=buffer.get_frame_id(),
            device_ns=buffer.get_timestamp() or None,
            host_ns=host_ns,
            monotonic_ns=monotonic_ns,
            encoding=self._encoding,
            size_px=size_px,
            data=data,
            status="complete" if whole else str(status.value_nick),
        )
        self._stream.push_buffer(buffer)
        return shot

    def trigger(self) -> None:
        """Send TriggerSoftware."""
        if not self._software:
            return
        try:
            self._camera.software_trigger()
        except self._error as error:
            raise no_trigger(self._device, _reason(error)) from None

    def close(self) -> None:
        """Stop the camera, if it still listens, and let go of it."""
        with suppress(self._error):
            self._camera.stop_acquisition()
        self._stream = None  # ends its thread
        self._camera = None


def _reason(error: Exception) -> str:
    return str(getattr(error, "message", error))
