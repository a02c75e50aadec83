"""Writing beside the name and renaming: a killed run leaves no half-written file."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from recorder.errors import PomologError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path`; rename it there on success, remove it on failure.

    Raises:
        PomologError: the folder cannot be made, written to, or is full.
    """
    if not path.name:
        raise PomologError(f"cannot write {path}: it is a folder; give -o/--out a name in it")
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    with writable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield part
            part.replace(path)
        except BaseException:
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                part.unlink(missing_ok=True)
            raise


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """Turn the operating system's refusal to write `path` into one line for the user."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise PomologError(
            f"cannot write {path}: {reason}; make room or choose another place with -o/--out"
        ) from error
