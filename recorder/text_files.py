"""Texts of others: within bounds, and every fault of a TOML one line."""

import tomllib
from pathlib import Path
from typing import Any

from recorder.errors import PomologError
from recorder.limits import DEFAULT_LIMITS, VARIABLE


def read_toml(path: Path, now: str) -> dict[str, Any]:
    """A TOML file's table; `now` says to the user what to do where it is none.

    Raises:
        PomologError: no such file, too large, or no TOML.
    """
    require_size(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PomologError(f"cannot read {path}: {error.strerror}; is the name right?") from None
    except RecursionError:
        raise PomologError(f"{path} is not TOML: it is nested too deeply; {now}") from None
    except ValueError as error:  # not UTF-8, not of that form, a number of thousands of digits
        raise PomologError(f"{path} is not TOML: {str(error)[:200]}; {now}") from None


def require_size(path: Path) -> None:
    """Refuse a text that is too large before it is read.

    Raises:
        PomologError: it is, or there is no such file.
    """
    try:
        size = path.stat().st_size
    except OSError as error:
        raise PomologError(f"cannot read {path}: {error.strerror}; is the name right?") from None
    if size > DEFAULT_LIMITS.text:
        raise PomologError(
            f"{path} has {size} bytes, more than {DEFAULT_LIMITS.text}; is it the right file? "
            f"{VARIABLE}=text=1GB allows it"
        )
