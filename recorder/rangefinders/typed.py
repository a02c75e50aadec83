"""Distances that are typed: by a person, or by a meter that types like a keyboard.

`4,532 m`, `4532 mm`, `3.2 # tree 7`, `1.85 m # apple 3`. What could be read in two ways is refused.
"""

import re
from dataclasses import dataclass
from typing import Final

from recorder.rangefinders import Answer

STD_M: Final = 0.0015  # handheld laser meters: +-1.5 mm
NEAREST_M: Final = 0.03
FARTHEST_M: Final = 200.0
_LINE: Final = re.compile(
    r"(\d{1,6})(?:([.,])(\d{1,4}))?\s*(mm|cm|m)?\s*(?:#\s*(.*))?", re.IGNORECASE
)
_APPLE: Final = re.compile(r"(?:apple\s*)?(\d{1,5})", re.IGNORECASE)
_UNITS_M: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}


@dataclass(frozen=True, slots=True)
class Typed:
    """A line that means a distance, or was meant to."""

    answer: Answer
    apple_id: int | None = None


def read_typed(line: str) -> Typed | None:
    """Read a line; None where it is no distance at all, but a note."""
    text = line.strip()
    if not text[:1].isdigit():
        return None
    found = _LINE.fullmatch(text)
    if found is None:
        return Typed(Answer(None, "fault: no distance", text))
    whole, sign, decimals, unit, comment = found.groups()
    unit = (unit or "").lower()
    if sign == "," and unit != "m" and unit and len(decimals) == 3:
        return Typed(Answer(None, "fault: is the comma a thousands separator?", text))
    if not unit and not sign:
        return Typed(Answer(None, "fault: no unit; m or mm?", text))
    range_m = float(f"{whole}.{decimals or 0}") * _UNITS_M[unit or "m"]
    if not NEAREST_M <= range_m <= FARTHEST_M:
        return Typed(Answer(None, "fault: out of range", text))
    apple = _APPLE.fullmatch((comment or "").strip())
    return Typed(Answer(range_m, "ok", text), int(apple[1]) if apple else None)
