"""What `pomolog record` is to open: the tables of rig.toml beyond the geometry.

`[cameras.left]`, `[cameras.right]`, `[rangefinder_device]` and `[capture]`; docs/recording.md shows
each of them.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config

from recorder.errors import PomologError
from recorder.records import Side
from recorder.text_files import read_toml

CameraDriver = Literal["aravis", "pylon", "av", "files"]
RangefinderDriver = Literal["dimetix", "lightware", "lightware-binary", "benewake", "typed"]
Feature = bool | int | float | str

_STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)
Positive = Annotated[float, Field(gt=0)]


@with_config(_STRICT)
@dataclass(frozen=True, slots=True)
class CameraSettings:
    """`[cameras.left]` and `[cameras.right]`.

    Attributes:
        device: an address, serial number or name (aravis, pylon); a URL or /dev/videoN (av); a
            folder of pictures or a video (files).
        pixel_format: a GenICam SFNC name: BayerRG8, BGR8 or RGB8.
        trigger: "off" (the camera runs by itself), "software", or a line: "Line1".
        rate_hz: AcquisitionFrameRate; also the pace of files and of the software trigger.
        region_px: x, y, width, height on the sensor; the camera's own where absent.
        packet_bytes: GevSCPSPacketSize; jumbo frames need a network that carries them.
        features: further GenICam features by name, set in this order before the start.
    """

    driver: CameraDriver
    device: str
    pixel_format: str = "BayerRG8"
    trigger: str = "off"
    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 15.0
    region_px: tuple[int, int, int, int] | None = None
    packet_bytes: Annotated[int, Field(ge=576, le=65535)] | None = None
    features: dict[str, Feature] = field(default_factory=dict)


@with_config(_STRICT)
@dataclass(frozen=True, slots=True)
class RangefinderSettings:
    """`[rangefinder_device]`.

    Attributes:
        port: a serial port: /dev/ttyUSB0. A typed one reads the operator's terminal.
        baud: the line's speed; the device's factory setting where absent.
        parity: "none", or "even": then it is checked here, because the operating system drops
            bytes of wrong parity without a count.
        confirm_m: two answers in a row must agree within this, for protocols without a checksum.
        rate_hz: how often a device that only answers is asked.
    """

    driver: RangefinderDriver
    port: str = ""
    baud: Annotated[int, Field(gt=0)] | None = None
    parity: Literal["none", "even"] | None = None
    confirm_m: Annotated[float, Field(ge=0)] | None = None
    rate_hz: Annotated[float, Field(gt=0, le=200)] = 10.0


@with_config(_STRICT)
@dataclass(frozen=True, slots=True)
class CaptureSettings:
    """`[capture]`.

    Attributes:
        max_skew_ms: how far apart the two pictures of a pair may be exposed.
        clock: "own" where each camera's clock runs by itself; "shared" where PTP keeps them
            together, so that one map serves both.
        silence_s: a camera or rangefinder that says nothing for so long is opened anew.
        queue_mb: pictures that wait for the disk; beyond it the oldest are dropped and counted.
        sync_s: how often the disk itself must have everything.
        reserve_mb: recording ends in good order when the disk has less than this left.
        ballast_mb: kept aside for the end of the file should the disk fill up all the same.
    """

    max_skew_ms: Positive = 5.0
    clock: Literal["own", "shared"] = "own"
    silence_s: Annotated[float, Field(ge=0.2, le=60)] = 1.0
    queue_mb: Annotated[float, Field(ge=8)] = 512.0
    sync_s: Annotated[float, Field(ge=0.05, le=10)] = 0.5
    reserve_mb: Annotated[float, Field(ge=0)] = 512.0
    ballast_mb: Annotated[float, Field(ge=12)] = 16.0

    @property
    def max_skew_ns(self) -> int:
        """The skew limit in nanoseconds."""
        return round(self.max_skew_ms * 1e6)


@with_config(ConfigDict(extra="ignore"))
@dataclass(frozen=True, slots=True)
class Equipment:
    """Everything to open, and how to record it."""

    cameras: dict[Side, CameraSettings] = field(default_factory=dict)
    rangefinder_device: RangefinderSettings | None = None
    capture: CaptureSettings = CaptureSettings()


def load_equipment(path: Path) -> Equipment:
    """Read the recording tables of a rig.toml.

    Raises:
        PomologError: not a readable TOML, a camera missing, or a value that cannot be.
    """
    if path.suffix.lower() != ".toml":
        raise PomologError(
            f"{path} says nothing of cameras; write a rig.toml with [cameras.left] and "
            "[cameras.right], see docs/recording.md"
        )
    try:
        equipment = TypeAdapter(Equipment).validate_python(read_toml(path, "see docs/recording.md"))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise PomologError(f"{path}: [{key}] {first['msg']}; see docs/recording.md") from None
    missing = [side for side in ("left", "right") if side not in equipment.cameras]
    if missing:
        raise PomologError(f"{path}: no [cameras.{missing[0]}]; see docs/recording.md")
    device = equipment.rangefinder_device
    if device is not None and device.driver != "typed" and not device.port:
        raise PomologError(f'{path}: [rangefinder_device] needs a port, like "/dev/ttyUSB0"')
    return equipment
