"""Durations as people type them: 12ms, -0.3s, 250us."""

import re
from collections.abc import Sequence
from typing import Final

from recorder.errors import PomologError

_UNITS_NS: Final = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000, "min": 60 * 10**9}


def read_duration_ns(text: str, option: str) -> int:
    """A number with its unit, in nanoseconds.

    Raises:
        PomologError: no number, or no unit that we know.
    """
    found = re.fullmatch(r"([+-]?[0-9]+(?:\.[0-9]+)?) ?(ns|us|ms|s|min)", text.strip())
    if found is None:
        raise PomologError(f"{option}: {text!r} is no duration; give a number and its unit: 12ms")
    return round(float(found[1]) * _UNITS_NS[found[2]])


def read_offsets_ns(texts: Sequence[str]) -> dict[str, int]:
    """`role=duration` by role.

    Raises:
        PomologError: not of that form, or a role twice.
    """
    offsets: dict[str, int] = {}
    for text in texts:
        role, sign, duration = text.partition("=")
        if not sign or role in offsets:
            raise PomologError(
                f"--offset: {text!r}; give each of right, range, depth once: right=-12ms"
            )
        offsets[role] = read_duration_ns(duration, "--offset")
    return offsets
