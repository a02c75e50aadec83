"""Texts of others: read within bounds, and every fault of a file one line."""

import tomllib
from pathlib import Path
from typing import Any

from recorder.errors import PomologError
from recorder.limits import DEFAULT_LIMITS, VARIABLE


def read_text(path: Path, kind: str = "a label file", limit: str = "text") -> str:
    """A text file, with a byte order mark or without.

    Args:
        path: the file.
        kind: what it should be, for who gave another one.
        limit: which of `Limits` bounds it.

    Raises:
        PomologError: it cannot be read, is too large, or is no text.
    """
    require_size(path, limit)
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise PomologError(f"cannot read {path}: {error.strerror}; is the name right?") from None
    except UnicodeDecodeError:
        raise PomologError(f"{path} is not {kind}: it is no text; is it the right file?") from None


def read_toml(path: Path, now: str) -> dict[str, Any]:
    """A TOML file's table; `now` says to the user what to do where it is none.

    Raises:
        PomologError: no such file, too large, or no TOML.
    """
    text = read_text(path, "TOML")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise PomologError(f"{path} is not TOML: it is nested too deeply; {now}") from None
    except ValueError as error:  # not of that form, a number of thousands of digits
        raise PomologError(f"{path} is not TOML: {str(error)[:200]}; {now}") from None


def require_size(path: Path, limit: str = "text") -> None:
    """Refuse a text that is too large before it is read; `limit` is one of `Limits`.

    Raises:
        PomologError: it is, or there is no such file, or a folder of that name.
    """
    if path.is_dir():
        raise PomologError(f"{path} is a folder; give the file itself")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise PomologError(f"cannot read {path}: {error.strerror}; is the name right?") from None
    most: int = getattr(DEFAULT_LIMITS, limit)
    if size > most:
        raise PomologError(
            f"{path} has {size} bytes, more than {most}; is it the right file? "
            f"{VARIABLE}={limit}=1GB allows it"
        )
