"""The thread that writes: a bounded queue in, whole files out, the disk held to its word.

Every half second the disk itself must have everything (fdatasync), so that a power cut costs no
more than that. A stall of the disk fills the queue, never the memory.
"""

import time
from pathlib import Path
from threading import Thread
from typing import Final

from recorder.disk import Ballast, free_bytes
from recorder.equipment import CaptureSettings
from recorder.errors import PomologError
from recorder.ledger import median_interval_ns
from recorder.records import SIDES, Side
from recorder.segment import Recording, Segment
from recorder.write_queue import Entry, WriteQueue

CUT_WAIT_NS: Final = 1_000_000_000  # how long a new file waits for the last frames of the old one
IDLE_S: Final = 0.005  # a pair is handed to the system when nothing has come for so long
FLUSH_S: Final = 0.05  # and small things alone no more often than this
LOOK_S: Final = 0.25  # how often the free space is looked at


class Storage:
    """Writes a recording in its own thread.

    Args:
        recording: what its files have in common.
        settings: queue, sync, reserve and ballast.

    Attributes:
        queue: where entries go.
        files: whole files so far.
        acknowledged: frames that the disk had at the last sync.
        failure: why it ended by itself; None while all is well.

    Raises:
        PomologError: the disk is too full to begin, or not writable.
    """

    def __init__(self, recording: Recording, settings: CaptureSettings) -> None:
        self._recording = recording
        self._settings = settings
        self.queue = WriteQueue(round(settings.queue_mb * 1e6), self._count_dropped)
        self.files: list[Path] = []
        self.acknowledged = 0
        self.failure: Exception | None = None
        self._ended = "stopped"
        self._settled_pairs = 0
        self._settled_unpaired = dict.fromkeys(SIDES, 0)
        self._held: list[Entry] = []
        self._cut_ns: int | None = None
        self._newest_ns = dict.fromkeys(SIDES, 0)
        folder = recording.folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            needed_mb = settings.reserve_mb + settings.ballast_mb
            if free_bytes(folder) < needed_mb * 1e6:
                raise PomologError(
                    f"less than {needed_mb:g} MB free for {folder}; make room, or lower "
                    "reserve_mb in [capture]"
                )
            self._ballast = Ballast(folder, round(settings.ballast_mb * 1e6))
            self._segment = Segment(recording, 1, self._ballast)
        except OSError as error:
            raise PomologError(
                f"cannot record to {folder}: {error.strerror}; choose another place with --out"
            ) from None
        self._number = 1
        self._thread = Thread(target=self._run, name="storage", daemon=True)
        self._thread.start()

    @property
    def pairs(self) -> int:
        """Stereo pairs written so far, a second behind."""
        return self._settled_pairs + self._segment.pairs.pairs

    @property
    def skew_ns(self) -> int | None:
        """Right minus left of the last pair."""
        return self._segment.pairs.skew_ns

    def unpaired(self, side: Side) -> int:
        """Frames of that side without a partner so far."""
        return self._settled_unpaired[side] + self._segment.pairs.unpaired[side]

    @property
    def running(self) -> bool:
        """Whether the thread still writes."""
        return self._thread.is_alive()

    def put(self, entry: Entry) -> None:
        """Hand over something to write; never waits."""
        self.queue.put(entry)

    def stop(self, ended: str = "stopped") -> None:
        """Write what waits, finish the file, and end the thread.

        Raises:
            PomologError: the disk was full or failed; the message says what is left.
        """
        if not self._thread.is_alive() and self.failure is None and self.queue.finished:
            return
        self._ended = ended if self.failure is None else self._ended
        self.queue.close()
        self._thread.join()
        self._ballast.free()
        if self.failure is not None:
            raise self.failure

    def _count_dropped(self, entry: Entry) -> None:
        ledger = self._recording.ledgers.get(entry.stream)
        if ledger is not None:
            ledger.dropped += 1

    def _run(self) -> None:
        try:
            self._write_all()
            if self._segment.file.full:  # nothing that still waits fits
                self._ended = "disk full"
                self.queue.abandon()
            for entry in self._held:
                self._segment.write(entry)
            self._finish_segment(self._ended)
            if self._segment.file.full:
                self._end_early("disk full", "its ballast let the file end well")
        except OSError as error:
            self.failure = PomologError(
                f"the disk fails ({error.strerror}); {self._segment.file.path} holds what was "
                f"written, {self.acknowledged} frames for sure; "
                f"try: pomolog salvage {self._segment.file.path} -o {self._segment.path}"
            )
        except Exception as error:  # raised where the recording is stopped
            self.failure = error
        finally:
            self.queue.abandon()

    def _write_all(self) -> None:
        settings, queue = self._settings, self.queue
        sync_s = flush_s = look_s = time.monotonic()
        picture = False  # one is not yet handed over
        while not queue.finished:
            entry = queue.get(IDLE_S if picture else FLUSH_S)
            if entry is not None:
                self._write(entry)
                picture |= entry.picture_bytes > 0
            now_s = time.monotonic()
            if entry is None and (picture or now_s - flush_s >= FLUSH_S):
                flush_s, picture = now_s, False
                self._segment.flush()
            if now_s - sync_s >= settings.sync_s:
                sync_s = now_s
                self._segment.sync()
                self.acknowledged = self._frames()
            if now_s - look_s >= LOOK_S:
                look_s = now_s
                self._segment.pairs.settle(max(self._newest_ns.values()))
                left = free_bytes(self._recording.folder)
                if left < settings.reserve_mb * 1e6 and not self._segment.file.full:
                    self._end_early("disk nearly full", f"{left / 1e6:.0f} MB left")
                    queue.close()
            if self._segment.file.full:
                self._end_early("disk full", "its ballast let the file end well")
                return

    def _end_early(self, ended: str, why: str) -> None:
        if self.failure is None:
            self._ended = ended
            self.failure = PomologError(
                f"recording ended: {ended} ({why}); {self._segment.path} is whole up to here; "
                "make room and start again"
            )

    def _frames(self) -> int:
        return sum(self._recording.ledgers[side].frames for side in SIDES)

    def _write(self, entry: Entry) -> None:
        """Write an entry into the file that it belongs to."""
        for side in SIDES:
            if entry.stream == side:
                self._newest_ns[side] = max(self._newest_ns[side], entry.time_ns)
        if self._cut_ns is None and self._segment.due(entry.time_ns):
            self._cut_ns = self._next_cut_ns()
        if self._cut_ns is None or entry.time_ns < self._cut_ns:
            self._segment.write(entry)
            return
        self._held.append(entry)
        passed = min(self._newest_ns.values()) >= self._cut_ns
        if passed or entry.time_ns - self._cut_ns > CUT_WAIT_NS:
            held, self._held, self._cut_ns = self._held, [], None
            self._finish_segment("split")
            self._number += 1
            self._segment = Segment(self._recording, self._number, self._ballast)
            for waiting in held:
                self._segment.write(waiting)

    def _next_cut_ns(self) -> int:
        """Half a frame after the newest picture, so that no pair is cut in two."""
        interval_ns = median_interval_ns(self._recording.ledgers["left"].recent_ns)
        return max(self._newest_ns.values()) + (interval_ns or 2 * self._recording.max_skew_ns) // 2

    def _finish_segment(self, ended: str) -> None:
        pairs = self._segment.pairs
        self._segment.finish(ended)
        self.acknowledged = self._frames()
        self._settled_pairs += pairs.pairs
        for side in SIDES:
            self._settled_unpaired[side] += pairs.unpaired[side]
        pairs.pairs = 0
        pairs.unpaired = dict.fromkeys(SIDES, 0)
        self.files.append(self._segment.path)
