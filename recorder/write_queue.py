"""The bounded queue between those who record and the one who writes."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from threading import Condition
from typing import Final

from recorder.session_writer import SessionWriter

MAX_SMALL: Final = 100_000  # readings, notes and statuses: minutes of them, some 20 MB


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """Something to write.

    Attributes:
        time_ns: its session time.
        stream: whose it is: "left", "right", "rangefinder", "notes", "status".
        picture_bytes: a picture's size; 0 for what is small and never dropped.
        write: puts it into a session.
    """

    time_ns: int
    stream: str
    picture_bytes: int
    write: Callable[[SessionWriter], None]


class WriteQueue:
    """Pictures up to a limit of bytes, the newest kept; small things beside them.

    Args:
        limit_bytes: pictures waiting at most.
        on_drop: told, one at a time, of every entry that is given up.
    """

    def __init__(self, limit_bytes: int, on_drop: Callable[[Entry], None]) -> None:
        self._limit_bytes = limit_bytes
        self._on_drop = on_drop
        self._pictures: deque[Entry] = deque()
        self._small: deque[Entry] = deque()
        self._changed = Condition()
        self._bytes = 0
        self._open = True

    @property
    def waiting_bytes(self) -> int:
        """Bytes of pictures waiting."""
        return self._bytes

    def put(self, entry: Entry) -> None:
        """Add an entry; when the queue is full, the oldest pictures make room for it."""
        with self._changed:
            if not self._open or (not entry.picture_bytes and len(self._small) >= MAX_SMALL):
                self._on_drop(entry)
            elif entry.picture_bytes:
                self._pictures.append(entry)
                self._bytes += entry.picture_bytes
                while self._bytes > self._limit_bytes and len(self._pictures) > 1:
                    oldest = self._pictures.popleft()
                    self._bytes -= oldest.picture_bytes
                    self._on_drop(oldest)
            else:
                self._small.append(entry)
            self._changed.notify()

    def get(self, timeout_s: float) -> Entry | None:
        """The next entry, or None when none came in time or the queue is closed and empty."""
        with self._changed:
            if not self._pictures and not self._small and self._open:
                self._changed.wait(timeout_s)
            if self._small:
                return self._small.popleft()
            if self._pictures:
                entry = self._pictures.popleft()
                self._bytes -= entry.picture_bytes
                return entry
            return None

    @property
    def finished(self) -> bool:
        """Whether it is closed and nothing waits."""
        with self._changed:
            return not self._open and not self._pictures and not self._small

    def close(self) -> None:
        """Take nothing more; what waits can still be got."""
        with self._changed:
            self._open = False
            self._changed.notify_all()

    def abandon(self) -> None:
        """Close, and drop what waits: the disk takes no more."""
        self.close()
        with self._changed:
            for entry in (*self._small, *self._pictures):
                self._on_drop(entry)
            self._small.clear()
            self._pictures.clear()
            self._bytes = 0
