"""Is a session fit to work with? Every checksum, every picture's size, rates, gaps and skew."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from recorder.errors import PomologError
from recorder.pictures import decode, verify
from recorder.records import COMPRESSED
from recorder.rectify import rectify
from recorder.session import Session
from recorder.timing import GAP_FACTOR, judge, timing_of

Level = Literal["ok", "warning", "failure"]


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
    size_mb = session.size_bytes / 1e6
    findings = [Finding("ok", f"every checksum agrees ({size_mb:.1f} MB)")]
    parallel = rectify(session.rig)
    resampled = "as recorded" if parallel.left.maps is None else "resampled to parallel views"
    rig = f"a rig of {session.rig.baseline_m * 1000:.1f} mm baseline"
    if session.one_view:
        nominal = session.metadata.get("calibration") == "nominal"
        rig = f"one view, its calibration {'nominal' if nominal else 'known'}"
    findings.append(Finding("ok", f"{rig}, {resampled}"))
    findings += _timing(session)
    try:
        session.require_pairs()
    except PomologError as error:  # what is known of their times has been said
        return [*findings, Finding("failure", str(error))]
    labelled = readings = depths = 0
    for pair in session.pairs():
        for frame in (pair.left,) if session.one_view else (pair.left, pair.right):
            if frame.encoding in COMPRESSED:  # OpenCV decodes half a picture and says nothing
                verify(frame.data, f"the {frame.side} frame at {frame.time_ns} ns")
            decode(frame)
        labelled += pair.truth is not None
        readings += len(pair.readings)
        depths += pair.depth is not None
        tick()
    things = "pictures" if session.one_view else "pairs"
    findings.append(Finding("ok", f"{len(session)} {things} decode"))
    findings.append(Finding("ok", f"truth for {labelled} of {len(session)} {things}"))
    total = session.info().topics.get("/rangefinder", 0)
    findings.append(Finding("ok", f"{total} range readings, {readings} of them near a pair"))
    if session.info().topics.get("/depth"):
        findings.append(_depth(session, depths))
    return findings


def _depth(session: Session, near: int) -> Finding:
    """How many depth pictures there are, of what sizes, and whether each has a left picture."""
    wrong = total = 0
    for depth in session.depths():
        total += 1
        wrong += depth.size_px != session.rig.left.size_px
    if wrong:
        return Finding("failure", f"{wrong} of {total} depth pictures are not of the left's size")
    text = f"{total} depth pictures, {near} of them at a left picture's moment"
    return Finding("ok" if near == total else "warning", text)


def _timing(session: Session) -> list[Finding]:
    timing = timing_of(session)
    findings = []
    for side, times in timing.times_ns.items():
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
    verdict = judge(timing)
    if verdict is None:
        return findings
    if len(skew_ms):
        text = (
            f"left to right skew: median {np.median(skew_ms):.2f} ms, at most {skew_ms.max():.2f}"
        )
        findings.append(Finding("ok", text))
    findings.append(Finding("ok" if verdict.sound else "warning", verdict.text))
    return findings
