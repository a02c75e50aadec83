"""The session: one recording of an orchard as one MCAP file, opened for reading.

`recorder.profile` says what lies in it; `recorder.container` reads the file and trusts nothing.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, Self, TypeVar

import numpy as np
import numpy.typing as npt

from recorder.assembly import READING_WINDOW_NS, Assembly
from recorder.container import Container
from recorder.errors import PomologError
from recorder.limits import DEFAULT_LIMITS, Limits
from recorder.mcap_records import RawMessage, reporting_damage
from recorder.metadata import session_records
from recorder.objects import Place
from recorder.pairing import pair_by_time
from recorder.profile import (
    IMAGE_TOPICS,
    RAW_IMAGE_SCHEMA,
    RIG_TOPICS,
    TOPICS,
    decode_depth,
    decode_note,
    decode_reading,
    decode_rig,
    decode_transforms,
)
from recorder.records import (
    SIDES,
    Depth,
    Note,
    RangeReading,
    Side,
    StereoPair,
)
from recorder.rig import USUAL_STD_M, Rig
from recorder.status import (
    FrameStamp,
    RecorderStatus,
    decode_stamp,
    decode_status,
)

ImageTimes = dict[Side, npt.NDArray[np.int64]]
_Kind = TypeVar("_Kind")

DEFAULT_MAX_SKEW_NS: Final = 5_000_000  # at 300 mm/s a skew of 5 ms costs 7.5 mm at 1 m


@dataclass(frozen=True, slots=True)
class SessionInfo:
    """What a session holds, from its index alone."""

    profile: str
    frames: int  # pictures of both views
    pairs: int
    topics: dict[str, int]
    start_ns: int | None
    end_ns: int | None
    metadata: dict[str, str]
    ledger: dict[str, str]
    whole: bool


class Session:
    """A session opened for reading, in bounded memory. Use it as a context manager.

    Args:
        path: the session's file.
        limits: what the file may ask of this machine's memory.
        image_times: as `image_times` of this file gave them, so that a worker on a slice of it
            need not read every chunk's index again.

    Attributes:
        max_skew_ns: frames further apart than this are no pair.

    Raises:
        TornFileError: the recording was cut off; `pomolog salvage` makes it whole.
        PomologError: no session, damaged, or of a newer profile.
    """

    def __init__(
        self,
        path: Place,
        limits: Limits = DEFAULT_LIMITS,
        image_times: ImageTimes | None = None,
    ) -> None:
        self.path = path
        self._container = Container(path, limits)
        self._rig: Rig | None = None
        self._notes: list[Note] | None = None  # that set a condition
        try:
            topics = self._container.counts()
            self._records = session_records(self._container.metadata(), path, topics)
            self._image_times = image_times or {
                side: self._container.times_ns(topic) for side, topic in IMAGE_TOPICS.items()
            }
            with reporting_damage(path, "its metadata"):
                self.max_skew_ns = int(self.metadata.get("max_skew_ns", DEFAULT_MAX_SKEW_NS))
            if self.one_view:
                self._image_times["right"] = self._image_times["left"]
            self._pairs = pair_by_time(
                self._image_times["left"], self._image_times["right"], self.max_skew_ns
            )
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._container.close()

    def __len__(self) -> int:
        """The number of stereo pairs."""
        return len(self._pairs)

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    @property
    def metadata(self) -> dict[str, str]:
        """The `session` record without its checksum."""
        return self._records.session

    @property
    def ledger(self) -> dict[str, str]:
        """The recorder's final counts, empty where none were kept."""
        return self._records.ledger

    @property
    def one_view(self) -> bool:
        """Whether there is only a left camera; its pairs then have a black right frame."""
        return self._records.one_view

    def names(self, side: Side) -> tuple[str, ...]:
        """What the pictures were called where they came from, in time order; empty if unsaid."""
        return tuple(self.picture_names.get(side, "").splitlines())

    @property
    def picture_names(self) -> dict[str, str]:
        """The metadata record behind `names`, for copies of the session."""
        return self._records.pictures

    @property
    def rig(self) -> Rig:
        """The rig that the session was recorded with.

        Raises:
            PomologError: there is no calibration, or it is none that a rig can have.
        """
        if self._rig is None:
            self._rig = self._read_rig()
        return self._rig

    @property
    def size_bytes(self) -> int:
        """How large the file is."""
        return self._container.size_bytes

    @property
    def fingerprint(self) -> str:
        """A short hash that changes when anything in the file does: its CRCs and its index."""
        return self._container.index.fingerprint

    def info(self) -> SessionInfo:
        """Counts and times, from the index."""
        counts = {topic: n for topic, n in self._container.counts().items() if n}
        statistics = self._container.index.statistics
        return SessionInfo(
            profile=self.metadata["profile"],
            frames=sum(counts.get(topic, 0) for topic in IMAGE_TOPICS.values()),
            pairs=0 if self.one_view else len(self),
            topics=counts,
            start_ns=statistics.message_start_time if counts else None,
            end_ns=statistics.message_end_time if counts else None,
            metadata=self.metadata,
            ledger=self.ledger,
            whole=True,
        )

    @property
    def image_times(self) -> ImageTimes:
        """Each camera's (N,) sorted times, for whoever opens this file again."""
        return self._image_times

    def times_ns(self, side: Side) -> npt.NDArray[np.int64]:
        """The (N,) sorted times of one camera's frames, paired or not."""
        return self._image_times[side]

    def pair_times_ns(self) -> npt.NDArray[np.int64]:
        """The (P, 2) left and right times of every stereo pair."""
        left, right = (self._image_times[side][self._pairs[:, i]] for i, side in enumerate(SIDES))
        return np.column_stack([left, right])

    def pairs(self, start: int = 0, stop: int | None = None) -> Iterator[StereoPair]:
        """Yield stereo pairs `start` to `stop` (not included) in time order.

        Raises:
            PomologError: a view has no frames at all, or the file is damaged.
        """
        self.require_pairs()
        _ = self.rig, self._conditions(0)  # now: a stream of object storage holds one place's bytes
        times = self.pair_times_ns()
        stop = len(times) if stop is None else min(stop, len(times))
        if start >= stop:
            return
        whole = start == 0 and stop == len(times)
        window = (None, None) if whole else (
            int(times[start].min()) - READING_WINDOW_NS,
            int(times[stop - 1].max()) + READING_WINDOW_NS + 1,
        )  # fmt: skip
        with reporting_damage(self.path, "reading its messages"):
            assembly = Assembly(
                self.path,
                self._container,
                self.rig,
                times,
                {IMAGE_TOPICS[side]: set(self._image_times[side].tolist()) for side in SIDES},
                self.one_view,
                self.max_skew_ns,
                self._conditions,
            )
            yield from assembly.pairs(start, stop, window)

    def _conditions(self, time_ns: int) -> dict[str, str]:
        """What the metadata says of the session, and the notes since then."""
        if self._notes is None:
            self._notes = [note for note in self.notes() if note.condition]
        return self._records.conditions(time_ns, self._notes)

    def readings(self) -> Iterator[RangeReading]:
        """Every answer of the rangefinder, near a pair or not."""
        return self._decoded("/rangefinder", "its readings", decode_reading)

    def depths(self) -> Iterator[Depth]:
        """Every depth picture, near a pair or not."""
        return self._decoded("/depth", "its depth", decode_depth)

    def notes(self) -> Iterator[Note]:
        """The operator's notes."""
        return self._decoded("/notes", "its notes", decode_note)

    def stamps(self) -> Iterator[FrameStamp]:
        """Device, host and monotonic times of every frame, where a recorder kept them."""
        return self._decoded("/recorder/stamps", "its frame stamps", decode_stamp)

    def statuses(self) -> Iterator[RecorderStatus]:
        """The recorder's state, second by second, where it kept it."""
        return self._decoded("/recorder/status", "its recorder's status", decode_status)

    def _decoded(
        self, topic: str, what: str, decode: Callable[[RawMessage], _Kind]
    ) -> Iterator[_Kind]:
        with reporting_damage(self.path, what):
            yield from map(decode, self._container.messages((topic,)))

    def messages(self) -> Iterator[RawMessage]:
        """Every message of the profile's topics as it lies there, in time order."""
        return self._container.messages(tuple(TOPICS))

    def schema(self, topic: str) -> str:
        """The schema's name of a topic."""
        return self._container.schema_name(topic) or ""

    @property
    def raw_images(self) -> bool:
        """Whether the frames are raw (Bayer or BGR)."""
        return self._container.schema_name("/left/image") == RAW_IMAGE_SCHEMA

    def verify(self) -> None:
        """Hold every byte against every checksum, and decode nothing.

        Raises:
            PomologError: at the first thing that does not agree.
        """
        self._container.verify()

    def require_pairs(self) -> None:
        """Make sure that there is something to replay.

        Raises:
            PomologError: a view has no frames, or no two frames are of one time.
        """
        counts = {side: len(self._image_times[side]) for side in SIDES}
        for side in SIDES:  # of one view, the right times are the left ones
            if counts[side] == 0:
                raise PomologError(
                    f"no {IMAGE_TOPICS[side]} among the {sum(counts.values())} frames of "
                    f"{self.path}; were both cameras recorded?"
                )
        if len(self._pairs) == 0:
            raise PomologError(
                f"no left and right frames within {self.max_skew_ns / 1e6:g} ms in {self.path}; "
                f"see their gaps with: pomolog check {self.path} --plot gaps.png"
            )

    def _read_rig(self) -> Rig:
        with reporting_damage(self.path, "its calibration"):
            found = list(self._container.messages(RIG_TOPICS))
            calibrations = {m.topic: m for m in reversed(found) if m.topic != "/tf"}
            transforms = decode_transforms([m for m in found if m.topic == "/tf"])
            missing = [topic for topic in RIG_TOPICS[:2] if topic not in calibrations]
            missing += ["/tf of the right camera"] if "right" not in transforms else []
            if missing:
                raise PomologError(
                    f"no {missing[0]} in {self.path}; import its pictures again with --rig rig.toml"
                )
            std_m = float(self.metadata.get("rangefinder_std_m", USUAL_STD_M))
            return decode_rig(calibrations, transforms, std_m)


def read_info(path: Place) -> SessionInfo:
    """What a session holds; opens and closes it."""
    with Session(path) as session:
        return session.info()
