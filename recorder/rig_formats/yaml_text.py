"""YAML of others, parsed without trust and written so that no digit is lost."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from recorder.errors import PomologError
from recorder.rig import Floats, Rangefinder


def parse(text: str) -> Mapping[str, Any] | None:
    """The mapping that a YAML text holds; None where it is no YAML or no mapping.

    OpenCV's YAML is left to OpenCV: its `%YAML:1.0` and its types are no one else's.
    """
    if text.lstrip().startswith("%YAML") or "!!opencv-" in text:
        return None
    try:
        found = next(iter(yaml.safe_load_all(text)), None)  # `ros2 topic echo` ends with ---
    except (yaml.YAMLError, RecursionError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def dump(content: Mapping[str, Any]) -> str:
    """YAML text, a matrix row a line; floats with all of their digits."""
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=10_000)


def numbers(
    table: Mapping[str, Any], keys: Sequence[str], count: int | None = None, *, where: str = ""
) -> Floats:
    """The finite numbers under the first of `keys` that is there, as (N,) float64.

    A matrix may be a list, rows of lists, or ROS' `{rows, cols, data}`.

    Raises:
        PomologError: none of the keys, not numbers, or not `count` of them.
    """
    key = next((key for key in keys if key in table), None)
    if key is None:
        raise PomologError(f"no {where}{keys[0]}; is it the whole calibration?")
    value = table[key]
    if isinstance(value, dict):
        value = value.get("data")
    try:
        found = np.asarray(value, float).ravel()
    except (TypeError, ValueError):
        raise PomologError(f"{where}{key} is not a list of numbers; calibrate again") from None
    if count is not None and found.size != count:
        raise PomologError(f"{where}{key} has {found.size} numbers; it needs {count}")
    if not np.isfinite(found).all():
        raise PomologError(f"{where}{key} has a number that is not finite; calibrate again")
    return found


def whole_number(table: Mapping[str, Any], keys: Sequence[str], *, where: str = "") -> int:
    """The whole number under the first of `keys` that is there.

    Raises:
        PomologError: none of the keys, or no whole number.
    """
    found = float(numbers(table, keys, 1, where=where)[0])
    if found != int(found):
        raise PomologError(f"{where}{keys[0]} is {found:g}, no whole number; give one")
    return int(found)


def beam_as_table(beam: Rangefinder) -> dict[str, Any]:
    """A rangefinder for a key that other programs pass over."""
    return {
        "origin_m": beam.origin_m.tolist(),
        "direction": beam.direction.tolist(),
        "std_m": float(beam.std_m),
    }


def beam_of_table(table: Mapping[str, Any]) -> Rangefinder | None:
    """A rangefinder that pomolog wrote beside a calibration, or None."""
    beam = table.get("rangefinder")
    if not isinstance(beam, dict):
        return None
    direction = numbers(beam, ("direction",), 3, where="rangefinder.")
    length = float(np.linalg.norm(direction))
    if not length > 0:
        raise PomologError("rangefinder.direction must not be zero; give its x, y, z")
    return Rangefinder(
        numbers(beam, ("origin_m",), 3, where="rangefinder."),
        direction / length,
        float(numbers(beam, ("std_m",), 1, where="rangefinder.")[0]),
    )
