"""Object storage (s3://, gs://): a path there, what reads it like a file, and putting files there.

fsspec does the talking; where its address and keys come from is the storage's own matter
(`AWS_ENDPOINT_URL`, `~/.aws`, `GOOGLE_APPLICATION_CREDENTIALS`). See docs/scale.md.
"""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, Self

from recorder.errors import PomologError

EXTRAS: Final = {"s3": "s3", "gs": "gs"}  # scheme -> the extra that has its library
READ_AHEAD_BYTES: Final = 1 << 16  # a request costs as much as 64 KB of its answer
FETCH_BYTES: Final = 32 << 20  # asked for at once and held; eight chunks, so that requests overlap


@dataclass(frozen=True, slots=True)
class ObjectPath:
    """An object's address, or a folder of them, with what is needed here of `pathlib.Path`."""

    url: str

    def __post_init__(self) -> None:
        bucket, _, key = self.url.partition("://")[2].partition("/")
        if not bucket or ".." in key.split("/"):
            raise PomologError(f"{self.url} is no address; it is like s3://bucket/folder/row.mcap")

    def __str__(self) -> str:
        return self.url

    def __truediv__(self, name: str) -> Self:
        return type(self)(f"{self.url.rstrip('/')}/{name}")

    @property
    def name(self) -> str:
        """Its last part."""
        return self.url.rstrip("/").rpartition("/")[2]

    @property
    def stem(self) -> str:
        """Its last part without its ending."""
        return Path(self.name).stem

    def open(self) -> "ObjectReader":
        """Open it for reading.

        Raises:
            PomologError: there is no such object, or the storage cannot be reached.
        """
        with _reaching(self):
            return ObjectReader(self, int(self._files().info(self.url)["size"]))

    def is_file(self) -> bool:
        """Whether there is such an object."""
        with _reaching(self):
            return bool(self._files().isfile(self.url))

    def read_bytes(self) -> bytes:
        """All of it."""
        with _reaching(self):
            return bytes(self._files().cat_file(self.url))

    def ranges(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        """The bytes of each (start, stop), asked for side by side."""
        starts, stops = zip(*ranges, strict=True)
        with _reaching(self):
            found = self._files().cat_ranges([self.url] * len(ranges), list(starts), list(stops))
            return [bytes(part) for part in found]

    def write_bytes(self, data: bytes) -> None:
        """Put an object there; it is there whole or not at all."""
        with _reaching(self):
            self._files().pipe_file(self.url, data)

    def put(self, file: Path) -> None:
        """Put a local file there."""
        with _reaching(self):
            self._files().put_file(str(file), self.url)

    def get(self, file: Path) -> None:
        """Copy it to a local file."""
        with _reaching(self):
            self._files().get_file(self.url, str(file))

    def below(self) -> list[Self]:
        """Every object below this folder."""
        scheme = self.url.partition("://")[0]
        with _reaching(self):
            return [type(self)(f"{scheme}://{key}") for key in self._files().find(self.url)]

    def unlink(self) -> None:
        """Take it away, if it is there."""
        with _reaching(self):
            if self._files().isfile(self.url):
                self._files().rm_file(self.url)

    def _files(self) -> Any:
        return _file_system(self.url.partition("://")[0])


Place = Path | ObjectPath


def as_place(words: str) -> Place:
    """What somebody typed: an address in object storage, or a path.

    Raises:
        PomologError: an address of a kind that is not known here.
    """
    scheme, found, _ = words.partition("://")
    if not found:
        return Path(words)
    if scheme not in EXTRAS:
        raise PomologError(f"{words}: only s3:// and gs:// are known; or give a path")
    return ObjectPath(words)


class ObjectReader(io.RawIOBase):
    """An object as a stream: asks for what is read, a little more, and what was announced."""

    def __init__(self, path: ObjectPath, size: int) -> None:
        super().__init__()
        self._path = path
        self._size = size
        self._at = 0
        self._held: list[tuple[int, bytes]] = []  # (offset, bytes), announced
        self._near: tuple[int, bytes] = (0, b"")  # the last thing that was not

    def announce(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Fetch each (offset, length) now, side by side, and let go of what was held."""
        bounds = [(max(0, at), min(at + length, self._size)) for at, length in ranges]
        bounds = [(start, stop) for start, stop in bounds if start < stop]
        self._held = []
        if bounds:
            parts = self._path.ranges(bounds)
            self._held = [(start, part) for (start, _), part in zip(bounds, parts, strict=True)]

    def readable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def tell(self) -> int:
        """Where the next read begins."""
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go somewhere; beyond the end there is nothing to read."""
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        if base + offset < 0:
            raise ValueError(f"a seek to {base + offset}")
        self._at = base + offset
        return self._at

    def read(self, size: int = -1) -> bytes:
        """So many bytes, or all that are left."""
        stop = self._size if size < 0 else min(self._size, self._at + size)
        if stop <= self._at:
            return b""
        start, self._at = self._at, stop
        for offset, part in (*self._held, self._near):
            if offset <= start and stop <= offset + len(part):
                return part[start - offset : stop - offset]
        ahead = min(self._size, max(stop, start + READ_AHEAD_BYTES))
        (data,) = self._path.ranges([(start, ahead)])
        if len(data) < stop - start:
            raise PomologError(f"{self._path} changed while it was read; try again")
        self._near = (start, data)
        return data[: stop - start]


@contextmanager
def _reaching(path: ObjectPath) -> Iterator[None]:
    """Turn whatever the storage's library raises into a line; each has exceptions of its own."""
    try:
        yield
    except PomologError:
        raise
    except FileNotFoundError:
        raise PomologError(f"no {path} there; is the address right?") from None
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise PomologError(
            f"cannot reach {path}: {reason}; are its address and keys set? see docs/scale.md"
        ) from error


@cache
def _file_system(scheme: str) -> Any:
    try:
        import fsspec

        # listings change under us, by other workers
        return fsspec.filesystem(scheme, use_listings_cache=False)
    except ImportError:
        raise PomologError(
            f"{scheme}:// needs a library of its own; install it: "
            f"pip install 'pomolog[{EXTRAS[scheme]}]'"
        ) from None
