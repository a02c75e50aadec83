"""The recorder's status, gathered from those who count."""

from collections.abc import Mapping
from dataclasses import replace

from recorder.disk import free_bytes
from recorder.exposure import Exposure
from recorder.ledger import StreamLedger
from recorder.plan import Plan
from recorder.records import SIDES, Side
from recorder.status import RecorderStatus, StreamStatus
from recorder.storage import Storage
from recorder.timeline import Timeline


class Reporter:
    """Puts a status together.

    Args:
        plan: where the disk is, and its reserve.
        ledgers: every stream's counters.
        storage: pairs and the queue.
        timelines: the cameras' clocks.
    """

    def __init__(
        self,
        plan: Plan,
        ledgers: Mapping[str, StreamLedger],
        storage: Storage,
        timelines: Mapping[str, Timeline],
    ) -> None:
        self._plan = plan
        self._ledgers = ledgers
        self._storage = storage
        self._timelines = timelines
        self._begun: tuple[int, int] | None = None  # time, bytes: for the disk's minutes

    def status(
        self, now_ns: int, exposures: Mapping[Side, Exposure], gone: tuple[Side, ...], state: str
    ) -> RecorderStatus:
        """The status of that moment."""
        free = free_bytes(self._plan.folder)
        streams = tuple(self._stream(name, now_ns, exposures) for name in self._ledgers)
        warnings = [w for side, found in exposures.items() for w in found.warnings(side)]
        warnings += [f"{side} camera is gone" for side in gone]
        return RecorderStatus(
            time_ns=now_ns,
            state=state,
            streams=streams,
            pairs=self._storage.pairs,
            skew_ns=self._storage.skew_ns,
            queue_bytes=self._storage.queue.waiting_bytes,
            disk_free_bytes=free,
            disk_left_s=self._disk_left_s(now_ns, sum(s.bytes for s in streams), free),
            warnings=tuple(warnings),
        )

    def _stream(self, name: str, now_ns: int, exposures: Mapping[Side, Exposure]) -> StreamStatus:
        ledger = self._ledgers[name]
        status = StreamStatus(name, **ledger.counts(), rate_hz=ledger.rate_hz(now_ns))
        if name not in SIDES:
            return status
        exposure = exposures.get(name)
        return replace(
            status,
            unpaired=self._storage.unpaired(name),
            drift_ppm=self._timelines[name].drift_ppm,
            overexposed=exposure.overexposed if exposure else None,
            underexposed=exposure.underexposed if exposure else None,
            focus=exposure.focus if exposure else None,
        )

    def _disk_left_s(self, now_ns: int, written: int, free: int) -> float | None:
        """By the pictures' bytes of the whole recording so far; the rest hardly counts."""
        if self._begun is None and written:
            self._begun = (now_ns, written)
        if self._begun is None or now_ns - self._begun[0] < 1_000_000_000:
            return None
        rate = (written - self._begun[1]) * 1e9 / (now_ns - self._begun[0])
        reserve = self._plan.equipment.capture.reserve_mb * 1e6
        return max(0.0, free - reserve) / rate if rate > 0 else None
