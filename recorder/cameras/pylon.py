"""Basler cameras through pypylon, Basler's own driver.

With PYLON_CAMEMU=2 in the environment before the first import, pylon serves two emulated cameras.
"""

from contextlib import suppress
from typing import Any

from recorder.cameras import BUFFERS, Shot, arrival, as_bgr, no_trigger, stored_encoding
from recorder.equipment import CameraSettings, Feature
from recorder.errors import PomologError


def _library() -> Any:
    try:
        from pypylon import pylon
    except ImportError:
        raise PomologError(
            "the driver pylon is not installed; try: pip install 'pomolog[pylon]'"
        ) from None
    return pylon


class PylonCamera:
    """One Basler camera, opened by serial number, address or user-defined name, and started.

    Raises:
        PomologError: no such camera, or a feature that it refuses.
    """

    def __init__(self, settings: CameraSettings) -> None:
        self._pylon = _library()
        from pypylon import genicam

        self._error: type[Exception] = genicam.GenericException
        self._device = settings.device
        self._software = settings.trigger == "software"
        factory = self._pylon.TlFactory.GetInstance()
        found = [d for d in factory.EnumerateDevices() if settings.device in _names(d)]
        if not found:
            raise PomologError(
                f"no Basler camera {settings.device}; give a serial number, an address or its "
                "user-defined name"
            )
        try:
            self._camera = self._pylon.InstantCamera(factory.CreateDevice(found[0]))
            self._camera.Open()
        except self._error as error:
            raise PomologError(
                f"camera {settings.device} cannot be opened ({_reason(error)}); "
                "is another program on it?"
            ) from None
        try:
            self._configure(settings)
            self._camera.MaxNumBuffer.Value = BUFFERS
            self._camera.StartGrabbing(self._pylon.GrabStrategy_OneByOne)
        except self._error as error:
            self.close()
            raise PomologError(
                f"camera {settings.device} refuses its settings ({_reason(error)}); "
                "try them in the pylon Viewer"
            ) from None
        except PomologError:
            self.close()
            raise

    def _configure(self, settings: CameraSettings) -> None:
        camera = self._camera
        if settings.region_px is not None:
            x, y, width, height = settings.region_px
            camera.Width.Value, camera.Height.Value = width, height
            camera.OffsetX.Value, camera.OffsetY.Value = x, y
        camera.PixelFormat.Value = settings.pixel_format
        self._encoding = stored_encoding(camera.PixelFormat.Value, self._device)
        self._swap = settings.pixel_format == "RGB8"
        if settings.packet_bytes is not None:
            self._set("GevSCPSPacketSize", settings.packet_bytes)
        for name, value in settings.features.items():
            self._set(name, value)
        self._set("TriggerSelector", "FrameStart")
        self._set("TriggerMode", "Off" if settings.trigger == "off" else "On")
        if settings.trigger == "off":
            self._set("AcquisitionFrameRateEnable", True)
            rates = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")  # SFNC; GigE before it
            self._set(next((n for n in rates if self._has(n)), rates[0]), settings.rate_hz)
        else:
            self._set("TriggerSource", "Software" if self._software else settings.trigger)

    def _has(self, name: str) -> bool:
        return self._camera.GetNodeMap().GetNode(name) is not None

    def _set(self, name: str, value: Feature) -> None:
        if not self._has(name):
            raise PomologError(
                f"camera {self._device} has no feature {name}; see what it has in the pylon Viewer"
            )
        getattr(self._camera, name).Value = value

    def next_shot(self, timeout_s: float) -> Shot | None:
        """Wait for a shot; None where none came in time.

        Raises:
            PomologError: the camera is gone.
        """
        try:
            result = self._camera.RetrieveResult(
                round(timeout_s * 1000), self._pylon.TimeoutHandling_Return
            )
        except self._error as error:
            raise PomologError(
                f"camera {self._device} is gone ({_reason(error)}); it is opened again"
            ) from None
        if not result.IsValid():
            return None
        host_ns, monotonic_ns = arrival()
        try:
            whole = result.GrabSucceeded()
            size_px = (result.Width, result.Height) if whole else (0, 0)
            data = bytes(result.GetBuffer()) if whole else b""
            if self._swap and whole:
                data = as_bgr(data, size_px)
            return Shot(
                frame_id=result.BlockID if result.BlockID < 2**63 else None,
                device_ns=result.TimeStamp or None,
                host_ns=host_ns,
                monotonic_ns=monotonic_ns,
                encoding=self._encoding,
                size_px=size_px,
                data=data,
                status="complete" if whole else (result.GetErrorDescription() or "incomplete"),
            )
        finally:
            result.Release()

    def trigger(self) -> None:
        """Send TriggerSoftware."""
        if not self._software:
            return
        try:
            self._camera.ExecuteSoftwareTrigger()
        except self._error as error:
            raise no_trigger(self._device, _reason(error)) from None

    def close(self) -> None:
        """Stop the camera, if it still listens, and let go of it."""
        with suppress(self._error):
            self._camera.StopGrabbing()
        with suppress(self._error):
            self._camera.Close()


def _names(device: Any) -> tuple[str, ...]:
    getters = ("GetSerialNumber", "GetIpAddress", "GetUserDefinedName", "GetFriendlyName")
    return tuple(getattr(device, getter)() for getter in getters if hasattr(device, getter))


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())
