"""The recorder's status as one line for the operator."""

from recorder.records import SIDES
from recorder.status import RecorderStatus, StreamStatus


def status_line(status: RecorderStatus) -> str:
    """Rates, pairs, skew, losses, queue, minutes of disk left, and what to look at."""
    left, right = (status.stream(side) for side in SIDES)
    parts = [f"{left.rate_hz:.1f}|{right.rate_hz:.1f} fps", f"{status.pairs} pairs"]
    if status.skew_ns is not None:
        parts.append(f"skew {status.skew_ns / 1e6:+.2f} ms")
    parts.append(losses(left, right))
    parts.append(f"queue {status.queue_bytes / 1e6:.0f} MB")
    if status.disk_left_s is not None:
        parts.append(f"disk {status.disk_left_s / 60:.0f} min")
    readings = status.stream("rangefinder")
    if readings.frames:
        parts.append(f"{readings.frames} readings")
    parts += [f"! {warning}" for warning in status.warnings]
    return "  ".join(parts)


def losses(*streams: StreamStatus) -> str:
    """What was lost, by kind; "no loss" where nothing was."""
    kinds = ("missing", "incomplete", "dropped", "unpaired", "late")
    counts = {kind: sum(getattr(stream, kind) for stream in streams) for kind in kinds}
    return ", ".join(f"{n} {kind}" for kind, n in counts.items() if n) or "no loss"
