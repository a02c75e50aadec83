"""A recording's file on a disk that may fill up at any moment.

After a failed write nobody knows how much of a record reached the file, so the MCAP writer above
must never see one: a ballast of blocks kept aside is given back when the disk is full, the write
goes on, and `full` says that it is time to end in good order.
"""

import errno
import os
import time
from pathlib import Path
from typing import Final

FULL: Final = frozenset((errno.ENOSPC, errno.EDQUOT))
RETRIES: Final = 40  # of 50 ms: a journal may first have to commit what was given back


class Ballast:
    """Blocks of a disk kept aside, by a file without a name: a killed recorder leaves none behind.

    Args:
        folder: any folder on that disk.
        size_bytes: how much.

    Raises:
        OSError: there is not even room for this.
    """

    def __init__(self, folder: Path, size_bytes: int) -> None:
        path = folder / f".pomolog.{os.getpid()}.ballast"
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
        self._descriptor: int | None = descriptor
        try:
            path.unlink()
            os.posix_fallocate(descriptor, 0, size_bytes)
        except BaseException:
            self.free()
            raise

    def free(self) -> bool:
        """Give the blocks back; False when that was done before."""
        if self._descriptor is None:
            return False
        os.close(self._descriptor)
        self._descriptor = None
        return True


class DiskFile:
    """A new file, written without a buffer of ours. Everything an MCAP writer asks of a stream.

    Args:
        path: must not exist.
        ballast: given back when the disk is full.

    Attributes:
        full: the disk was full once; end the file now.

    Raises:
        OSError: the file cannot be made, or (from `write`) the disk fails for good.
    """

    def __init__(self, path: Path, ballast: Ballast) -> None:
        self.path = path
        self.full = False
        self._ballast = ballast
        self._size = 0
        self._descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
        sync_folder(path.parent)  # so that a power cut leaves the name, too

    def write(self, data: bytes) -> int:
        """Write all of it."""
        view = memoryview(data)
        retries = RETRIES
        while view:
            try:
                written = os.write(self._descriptor, view)
            except OSError as error:
                if error.errno not in FULL:
                    raise
                if self._ballast.free():
                    self.full = True
                    sync_folder(self.path.parent)  # commits the journal: the blocks are free
                elif self.full and retries:
                    retries -= 1
                    time.sleep(0.05)
                else:
                    raise
                continue
            self._size += written
            view = view[written:]
        return len(data)

    def tell(self) -> int:
        """Bytes written so far."""
        return self._size

    def flush(self) -> None:
        """Nothing waits here."""

    def fileno(self) -> int:
        """The operating system's handle, for fdatasync."""
        return self._descriptor

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)


def sync_folder(folder: Path) -> None:
    """Make the names in a folder as lasting as the files."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def free_bytes(folder: Path) -> int:
    """Room on the folder's disk for a user like this one."""
    stat = os.statvfs(folder)
    return stat.f_bavail * stat.f_frsize
