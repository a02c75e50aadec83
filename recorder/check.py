"""Is a session fit to work with? Every checksum, every picture's size, rates, gaps and skew."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from recorder.errors import PomologError
from recorder.pictures import decode, verify
from recorder.records import COMPRESSED, SIDES
from recorder.rectify import rectify
from recorder.session import Session

Level = Literal["ok", "warning", "failure"]

GAP_FACTOR = 1.5  # a frame later than this many intervals means that one was lost


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    level: Level
    text: str


def check(path: Path, tick: Callable[[], None] = lambda: None) -> tuple[Finding, ...]:
    """Look at everything in a session that can be wrong.

    Args:
        path: the session.
        tick: called after each pair.

    Returns:
        What was found, in the order in which it was looked at; a file that cannot be opened at
        all is one failure.
    """
    try:
        with Session(path) as session:
            return tuple(_findings(session, tick))
    except PomologError as error:
        return (Finding("failure", str(error)),)


def _findings(session: Session, tick: Callable[[], None]) -> list[Finding]:
    session.verify()
    size_mb = session.path.stat().st_size / 1e6
    findings = [Finding("ok", f"every checksum agrees ({size_mb:.1f} MB)")]
    parallel = rectify(session.rig)
    resampled = "as recorded" if parallel.left.maps is None else "resampled to parallel views"
    findings.append(
        Finding("ok", f"a rig of {session.rig.baseline_m * 1000:.1f} mm baseline, {resampled}")
    )
    findings += _timing(session)
    labelled = readings = 0
    for pair in session.pairs():
        for frame in (pair.left, pair.right):
            if frame.encoding in COMPRESSED:  # OpenCV decodes half a picture and says nothing
                verify(frame.data, f"the {frame.side} frame at {frame.time_ns} ns")
            decode(frame)
        labelled += pair.truth is not None
        readings += len(pair.readings)
        tick()
    findings.append(Finding("ok", f"{len(session)} pairs decode"))
    findings.append(Finding("ok", f"truth for {labelled} of {len(session)} pairs"))
    total = session.info().topics.get("/rangefinder", 0)
    findings.append(Finding("ok", f"{total} range readings, {readings} of them near a pair"))
    return findings


def _timing(session: Session) -> list[Finding]:
    findings = []
    for side in SIDES:
        times = session.times_ns(side)
        unpaired = len(times) - len(session)
        if unpaired:
            findings.append(
                Finding("warning", f"{unpaired} of {len(times)} {side} frames have no partner")
            )
        gaps = np.diff(times)
        if len(gaps) == 0:
            continue
        usual = float(np.median(gaps))
        lost = int((gaps > GAP_FACTOR * usual).sum())
        rate = f"{side}: {1e9 / usual:.2f} frames a second" if usual else f"{side}: no rate"
        if lost:
            text = f"{rate}, {lost} gaps, the longest {gaps.max() / 1e9:.2f} s"
            findings.append(Finding("warning", text))
        else:
            findings.append(Finding("ok", f"{rate}, no gap"))
    skew_ms = np.abs(np.diff(session.pair_times_ns(), axis=1)) / 1e6
    if len(skew_ms):
        text = (
            f"left to right skew: median {np.median(skew_ms):.2f} ms, at most {skew_ms.max():.2f}"
        )
        findings.append(Finding("ok", text))
    return findings
