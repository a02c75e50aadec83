"""One file of a recording: written beside its name, renamed when whole."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

from recorder.disk import Ballast, DiskFile, sync_folder
from recorder.errors import PomologError
from recorder.ledger import PairCounter, StreamLedger, final_ledger
from recorder.records import SIDES
from recorder.rig import Rig
from recorder.session_writer import SessionWriter
from recorder.write_queue import Entry


@dataclass(frozen=True, slots=True)
class Split:
    """When a recording goes on in a new file; None is never."""

    seconds: float | None = None
    size_bytes: int | None = None

    @classmethod
    def parse(cls, text: str) -> "Split":
        """Read `5min`, `30s`, `1h`, `500MB` or `2GB`.

        Raises:
            PomologError: something else.
        """
        units = {"s": 1, "min": 60, "h": 3600, "MB": 10**6, "GB": 10**9}
        for unit in sorted(units, key=len, reverse=True):
            number = text.strip().removesuffix(unit).strip()
            if text.strip().endswith(unit) and number.replace(".", "", 1).isdigit():
                value = float(number) * units[unit]
                if value > 0:
                    return cls(size_bytes=round(value)) if "B" in unit else cls(seconds=value)
        raise PomologError(f"--split {text!r} is no time or size; try 5min, 1h, 500MB or 2GB")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What every file of a recording has in common.

    Attributes:
        folder: where its files go.
        name: of the recording, without ending.
        rig: the geometry.
        metadata: lighting, cultivar, site and whatever else is known.
        raw_images: frames are raw instead of compressed.
        max_skew_ns: the limit within which two frames are a pair.
        split: when to go on in a new file; None is never.
        ledgers: every stream's counters.
    """

    folder: Path
    name: str
    rig: Rig
    metadata: Mapping[str, str]
    raw_images: bool
    max_skew_ns: int
    split: Split | None
    ledgers: Mapping[str, StreamLedger]

    def path(self, number: int) -> Path:
        """The name of its n-th file, from 1."""
        return self.folder / f"{self.name}{f'-{number:03}' if self.split else ''}.mcap"


class Segment:
    """A file in progress, `NAME.mcap.part` until `finish`.

    Raises:
        OSError: the disk takes no more.
        PomologError: a file of that name is there already.
    """

    def __init__(self, recording: Recording, number: int, ballast: Ballast) -> None:
        self.path = recording.path(number)
        part = self.path.with_name(f"{self.path.name}.part")
        if self.path.exists() or part.exists():
            raise PomologError(f"{self.path} is there already; give the recording another --name")
        self.file = DiskFile(part, ballast)
        metadata = dict(recording.metadata)
        if recording.split:
            metadata["segment"] = str(number)
        self._writer = SessionWriter(
            cast("BinaryIO", self.file), recording.rig, metadata, raw_images=recording.raw_images
        )
        self._recording = recording
        self._before = {name: ledger.counts() for name, ledger in recording.ledgers.items()}
        self.pairs = PairCounter(recording.max_skew_ns)
        self.start_ns: int | None = None

    def write(self, entry: Entry) -> None:
        """Write an entry and count it."""
        if self.start_ns is None:
            self.start_ns = entry.time_ns
        entry.write(self._writer)
        ledger = self._recording.ledgers.get(entry.stream)
        if ledger is not None:
            ledger.frames += 1
            ledger.bytes += entry.picture_bytes
            ledger.recent_ns.append(entry.time_ns)
        for side in SIDES:
            if entry.stream == side and entry.picture_bytes:
                self.pairs.add(side, entry.time_ns)

    def due(self, now_ns: int) -> bool:
        """Whether the recording should go on in a new file."""
        split = self._recording.split
        if split is None or self.start_ns is None:
            return False
        if split.size_bytes is not None and self.file.tell() >= split.size_bytes:
            return True
        return split.seconds is not None and now_ns - self.start_ns >= split.seconds * 1e9

    def flush(self) -> None:
        """Hand everything to the operating system: it outlives this process there."""
        self._writer.flush()

    def sync(self) -> None:
        """Wait until the disk has everything."""
        self._writer.sync()

    def finish(self, ended: str) -> None:
        """Write ledger and index, and give the file its name."""
        self.pairs.settle()
        counts = {name: ledger.counts() for name, ledger in self._recording.ledgers.items()}
        self._writer.finish(final_ledger(counts, self._before, self.pairs, [("ended", ended)]))
        self.file.close()
        self.file.path.rename(self.path)
        sync_folder(self.path.parent)
