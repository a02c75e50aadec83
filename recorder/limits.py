"""What a file may ask of this machine: all bounds on sessions, pictures and texts of others.

`POMOLOG_LIMITS="chunk=512MB,text=100MB"` in the environment changes them, for workers too.
"""

import os
import re
from dataclasses import dataclass, fields
from typing import Final

from recorder.errors import PomologError

VARIABLE: Final = "POMOLOG_LIMITS"
_UNITS: Final = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30}
_ENTRY: Final = re.compile(r"\s*([a-z_]+)\s*=\s*(\d{1,12})\s*([KMG]?)B?\s*")


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds in bytes, but for those that count something else."""

    record: int = 256 << 20  # of a session's file
    chunk: int = 256 << 20  # of one chunk, unpacked
    overlap: int = 1 << 30  # of unpacked chunks that overlap in time, held together
    chunk_records: int = 1 << 19  # of one chunk: empty messages pack to nothing, but not in memory
    picture_px: int = 1 << 26  # pixels of a picture; rectifying it takes 16 bytes each
    calibration: int = 1 << 20  # of a YAML of a rig: it has kilobytes, and YAML is read slowly
    text: int = 64 << 20  # of a TOML, JSON or XML file; as objects it takes some twenty times more


def limits_from(words: str) -> Limits:
    """The limits with those that `words` change.

    Raises:
        PomologError: no such limit, or no number.
    """
    known = [field.name for field in fields(Limits)]
    changed = {}
    for entry in filter(str.strip, words.split(",")):
        found = _ENTRY.fullmatch(entry)
        if found is None or found[1] not in known:
            raise PomologError(
                f"{VARIABLE} has {entry.strip()!r}; it is like chunk=512MB, with {', '.join(known)}"
            )
        changed[found[1]] = int(found[2]) * _UNITS[found[3]]
    return Limits(**changed)


DEFAULT_LIMITS: Final = limits_from(os.environ.get(VARIABLE, ""))
