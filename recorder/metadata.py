"""What a session says of itself: its metadata records, each held against its own checksum.

No chunk's CRC covers a metadata record, so each keeps one beside its entries, under `crc32`.
"""

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from recorder.errors import PomologError, newer_profile
from recorder.objects import Place
from recorder.one_view import ONE_VIEW
from recorder.profile import PROFILE
from recorder.records import Note

CRC: Final = "crc32"
# metadata that says how the file is made, not what was recorded
NOT_CONDITIONS: Final = frozenset((
    "profile", "images", "rig", "rangefinder_std_m", "max_skew_ns", "made_by", "salvaged_from",
    "clock_zero_ns", "segment", "equipment", "views", "calibration", "imported_from",
))  # fmt: skip


@dataclass(frozen=True, slots=True)
class SessionRecords:
    """The metadata records of a session, without their checksums.

    Attributes:
        session: profile, conditions, and how the file is made.
        ledger: the recorder's final counts; empty where none were kept.
        pictures: by view, what the pictures were called, a line each; empty where unsaid.
    """

    session: dict[str, str]
    ledger: dict[str, str]
    pictures: dict[str, str]

    @property
    def one_view(self) -> bool:
        """Whether there is only a left camera."""
        return all(self.session.get(key) == value for key, value in ONE_VIEW.items())

    def conditions(self, time_ns: int, notes: Iterable[Note]) -> dict[str, str]:
        """What holds at a time: what was said of the whole session, and by notes until then."""
        said = {k: v for k, v in self.session.items() if k not in NOT_CONDITIONS}
        return said | dict(
            note.condition for note in notes if note.condition and note.time_ns <= time_ns
        )


def with_crc(entries: Mapping[str, str]) -> dict[str, str]:
    """Entries as a file keeps them, their checksum among them."""
    plain = without_crc(entries)
    return {**plain, CRC: _crc(plain)}


def without_crc(entries: Mapping[str, str]) -> dict[str, str]:
    """Entries as somebody gave them."""
    return {key: value for key, value in entries.items() if key != CRC}


def is_sound(entries: Mapping[str, str]) -> bool:
    """Whether entries have a checksum and pass it."""
    return entries.get(CRC) == _crc(without_crc(entries))


def session_records(
    found: Mapping[str, Mapping[str, str]], path: Place, topics: Iterable[str]
) -> SessionRecords:
    """The records of a file that is a session of ours.

    Args:
        found: every metadata record by its name.
        path: for messages.
        topics: of the file, to say what it is where it is no session.

    Raises:
        PomologError: no session, damaged, or of a newer profile.
    """
    # before its checksum is looked at: a newer profile may have another
    profile = found.get("session", {}).get("profile", "")
    if profile.startswith("pomolog/") and profile != PROFILE:
        raise newer_profile(path, profile, PROFILE)
    ours = {name: found.get(name, {}) for name in ("session", "ledger", "pictures")}
    damaged = PomologError(
        f"{path} is damaged (its metadata fails its CRC); try: pomolog salvage {path} -o whole.mcap"
    )
    if any(CRC in entries and not is_sound(entries) for entries in ours.values()):
        raise damaged
    if profile != PROFILE:
        raise PomologError(
            f"{path} is an MCAP file but no pomolog session "
            f"(topics: {', '.join(sorted(topics)[:8]) or 'none'}); "
            "others' recordings become one with: pomolog import bag"
        )
    if not all(CRC in entries for entries in found.values()):
        raise damaged  # a checksum is lost: a session's metadata always have one
    return SessionRecords(**{name: without_crc(entries) for name, entries in ours.items()})


def _crc(plain: Mapping[str, str]) -> str:
    text = "\0".join(f"{key}={plain[key]}" for key in sorted(plain))
    return f"{zlib.crc32(text.encode()):08x}"
