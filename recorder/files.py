"""Writing beside the name and renaming: a killed run leaves no half-written file."""

import errno
import fcntl
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
        PomologError: the folder cannot be made, written to, or is full; `path` is a folder or a
            device.
    """
    with writable(path):
        if not path.name or path.is_dir():
            raise PomologError(f"cannot write {path}: it is a folder; give -o/--out a name in it")
        if path.exists() and not path.is_file():  # renaming would replace the device itself
            raise PomologError(f"cannot write {path}: it is no file; give -o/--out another name")
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


def require_ending(path: Path, *endings: str) -> None:
    """Refuse a name that says another kind of file; one without an ending says nothing wrong.

    Raises:
        PomologError: it does.
    """
    if path.suffix and path.suffix.lower() not in endings:
        raise PomologError(f"{path} should end in {' or '.join(endings)}; give such a name")


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all.

    Raises:
        PomologError: as `replacing`.
    """
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """Turn the operating system's refusal to write `path` into one line for the user."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        if error.errno in (errno.EEXIST, errno.ENOTDIR):
            reason = f"{_file_in_the_way(path)} is a file, not a folder"
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        now = "make room, or choose" if full else "choose"
        raise PomologError(
            f"cannot write {path}: {reason}; {now} another place with -o/--out"
        ) from error


def _file_in_the_way(path: Path) -> Path:
    """The part of a path that should be a folder and is a file."""
    return next((part for part in (path, *path.parents) if part.is_file()), path)


@contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Hold a lock on a folder, so that two runs don't write the same results.

    Raises:
        PomologError: another process holds it.
    """
    lock = folder / ".lock"
    with writable(folder), lock.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise PomologError(
                f"another run is writing {folder}; wait for it, or choose another -o/--out"
            ) from None
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)
