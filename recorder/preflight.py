"""Before the row: open everything, take ten frames, and say go or no go."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from recorder.cameras import Camera, Shot, open_camera
from recorder.check import Finding, Level
from recorder.clocks import ClockMap, SessionClock
from recorder.disk import free_bytes
from recorder.errors import PomologError
from recorder.exposure import look_at
from recorder.ledger import StreamLedger
from recorder.pairing import pair_by_time
from recorder.pictures import decode
from recorder.plan import Plan
from recorder.rangefinder_loop import RangefinderLoop
from recorder.rangefinders import Answer
from recorder.records import SIDES, Frame, Picture, Side
from recorder.rectify import rectify
from recorder.rig import Rig
from recorder.timeline import Timeline
from recorder.warm_up import first_shot

FRAMES: Final = 10
PATIENCE_S: Final = 2.0
RATE_TOLERANCE: Final = 0.1
GOOD_ROWS_PX: Final = 1.0  # a calibrated pair agrees in its rows by less than a pixel
BAD_ROWS_PX: Final = 3.0  # the locator's matching loses its partner here
MIN_MATCHES: Final = 20
MAX_ROWS_PX: Final = 40.0  # matches further apart are mistaken, whatever the calibration
SPEED_BYTES: Final = 64_000_000
MARGIN: Final = 1.5  # the disk should take so much more than the cameras give

Placed = list[tuple[Shot, int]]
Say = Callable[[Level, str], None]


def preflight(plan: Plan, tell: Callable[[Finding], None] = lambda _: None) -> tuple[Finding, ...]:
    """Try every device and the disk; nothing is recorded.

    Args:
        plan: as for recording.
        tell: called with each finding as it is made.

    Returns:
        All findings; a "failure" among them means no go.
    """
    findings: list[Finding] = []

    def found(level: Level, text: str) -> None:
        findings.append(Finding(level, text))
        tell(findings[-1])

    shots = _shots(plan, found)
    if shots is not None:
        for side in SIDES:
            _judge_stream(plan, side, shots[side], found)
        _judge_pairs(plan, shots, found)
    _judge_rangefinder(plan, found)
    rate = sum(_bytes_per_s(placed) for placed in shots.values()) if shots else 0.0
    _judge_disk(plan, rate, found)
    return tuple(findings)


def _shots(plan: Plan, found: Say) -> dict[Side, Placed] | None:
    clock = SessionClock.start()
    with ExitStack() as stack:
        cameras: dict[Side, Camera] = {}
        failed = False
        for side in SIDES:
            try:
                cameras[side] = stack.enter_context(
                    closing(open_camera(plan.equipment.cameras[side]))
                )
                first_shot(plan, cameras, side)
            except PomologError as error:
                failed = True
                found("failure", str(error))
        if failed:
            return None
        with ThreadPoolExecutor(len(SIDES)) as pool:
            taken = pool.map(lambda side: _take(plan, side, cameras[side], clock), SIDES)
            return dict(zip(SIDES, taken, strict=True))


def _take(plan: Plan, side: Side, camera: Camera, clock: SessionClock) -> Placed:
    timeline = Timeline(clock, ClockMap())
    software = plan.equipment.cameras[side].trigger == "software"
    placed: Placed = []
    until_s = time.monotonic() + PATIENCE_S + 3 * FRAMES / plan.equipment.cameras[side].rate_hz
    while len(placed) < FRAMES and time.monotonic() < until_s:
        if software:
            camera.trigger()
        shot = camera.next_shot(0.5)
        if shot is not None:
            placed += timeline.place(shot)
    return placed + timeline.restart()


def _judge_stream(plan: Plan, side: Side, placed: Placed, found: Say) -> None:
    whole = [shot for shot, _ in placed if shot.complete]
    if len(whole) < FRAMES:
        found("failure", f"{side}: {len(whole)} of {FRAMES} frames came whole")
    if len(whole) < 2:
        return
    wanted_hz = plan.equipment.cameras[side].rate_hz
    interval_ns = float(np.median(np.diff([time_ns for _, time_ns in placed])))
    rate_hz = 1e9 / max(interval_ns, 1.0)
    trigger = plan.equipment.cameras[side].trigger
    kept = trigger != "off" or abs(rate_hz / wanted_hz - 1) < RATE_TOLERANCE
    found(
        "ok" if kept else "warning",
        f"{side}: {rate_hz:.2f} frames a second of {wanted_hz:g} wanted",
    )
    exposure = look_at(whole[-1])
    text = (
        f"{side}: {exposure.overexposed:.1%} overexposed, {exposure.underexposed:.1%} "
        f"underexposed, focus {exposure.focus:.0f}"
    )
    found("warning" if exposure.warnings(side) else "ok", text)


def _judge_pairs(plan: Plan, shots: dict[Side, Placed], found: Say) -> None:
    whole = {side: [(s, t) for s, t in placed if s.complete] for side, placed in shots.items()}
    times = {side: np.asarray([t for _, t in whole[side]], np.int64) for side in SIDES}
    limit_ns = plan.equipment.capture.max_skew_ns
    pairs = pair_by_time(times["left"], times["right"], limit_ns)
    if len(pairs) < FRAMES // 2:
        every = pair_by_time(times["left"], times["right"], 10**12)
        apart = np.abs(times["left"][every[:, 0]] - times["right"][every[:, 1]]) / 1e6
        apart_ms = float(np.median(apart)) if len(apart) else float("nan")
        found(
            "failure",
            f"only {len(pairs)} pairs within {limit_ns / 1e6:g} ms (frames are {apart_ms:.1f} ms "
            "apart); use a hardware trigger, or raise max_skew_ms in [capture]",
        )
        return
    skew_ms = (times["right"][pairs[:, 1]] - times["left"][pairs[:, 0]]) / 1e6
    found("ok", f"skew {np.median(skew_ms):+.2f} ms, at most {np.abs(skew_ms).max():.2f}")
    left, right = whole["left"][pairs[-1][0]][0], whole["right"][pairs[-1][1]][0]
    residual = row_residual_px(plan.rig, _picture("left", left), _picture("right", right))
    if residual is None:
        found("warning", "too little to match between the views; the calibration is not proved")
        return
    level: Level = (
        "ok" if residual < GOOD_ROWS_PX else "warning" if residual < BAD_ROWS_PX else "failure"
    )
    found(level, f"epipolar residual {residual:.2f} px against the calibration (median of rows)")


def _picture(side: Side, shot: Shot) -> Picture:
    return decode(Frame(side, shot.monotonic_ns, shot.encoding, shot.data, shot.size_px))


def row_residual_px(rig: Rig, left: Picture, right: Picture) -> float | None:
    """By how many rows the same points differ in the rectified views; 0 for a true calibration.

    Returns:
        The median over matched features; None where too few match.
    """
    parallel = rectify(rig)
    finder = cv2.ORB.create(2000)
    found = [
        finder.detectAndCompute(
            cv2.cvtColor(parallel.view(side).picture(picture), cv2.COLOR_BGR2GRAY), None
        )
        for side, picture in zip(SIDES, (left, right), strict=True)
    ]
    if any(descriptors is None for _, descriptors in found):
        return None
    (left_points, left_words), (right_points, right_words) = found
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(left_words, right_words)
    rows = np.asarray(
        [left_points[m.queryIdx].pt[1] - right_points[m.trainIdx].pt[1] for m in matches]
    )
    near = rows[np.abs(rows) < MAX_ROWS_PX]
    return float(np.median(np.abs(near))) if len(near) >= MIN_MATCHES else None


def _judge_rangefinder(plan: Plan, found: Say) -> None:
    device = plan.equipment.rangefinder_device
    if device is None or device.driver == "typed":
        return
    answers: list[Answer] = []
    try:
        loop = RangefinderLoop(
            device,
            StreamLedger(),
            plan.equipment.capture.silence_s,
            lambda answer, *_: answers.append(answer),
            lambda _: None,
        )
    except PomologError as error:
        found("failure", str(error))
        return
    loop.start()
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s and not any(a.range_m is not None for a in answers):
        time.sleep(0.05)
    loop.stop()
    good = [a.range_m for a in answers if a.range_m is not None]
    if good:
        found("ok", f"rangefinder: {good[-1]:.3f} m")
    elif answers:
        found("warning", f"rangefinder: {answers[-1].status} ({answers[-1].raw})")
    else:
        found("failure", f"the rangefinder at {device.port} says nothing; are its settings right?")


def _bytes_per_s(placed: Placed) -> float:
    if len(placed) < 2:
        return 0.0
    seconds = (placed[-1][1] - placed[0][1]) / 1e9
    return sum(len(shot.data) for shot, _ in placed[1:]) / max(seconds, 1e-3)


def _judge_disk(plan: Plan, needed: float, found: Say) -> None:
    folder = plan.folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        speed = disk_speed(folder)
    except OSError as error:
        found("failure", f"cannot write to {folder}: {error.strerror}")
        return
    room = free_bytes(folder) - plan.equipment.capture.reserve_mb * 1e6
    level: Level = "ok" if speed > MARGIN * needed else "warning" if speed > needed else "failure"
    found(level, f"disk {speed / 1e6:.0f} MB/s, {needed / 1e6:.0f} MB/s needed")
    if room <= 0:
        found("failure", f"no room on the disk of {folder} beyond the reserve")
    elif needed:
        minutes = room / needed / 60
        found("ok" if minutes > 10 else "warning", f"room for {minutes:.0f} minutes")


def disk_speed(folder: Path) -> float:
    """Bytes a second that the disk really takes, by 64 MB with fdatasync."""
    path = folder / f".pomolog.{os.getpid()}.speed"
    block = os.urandom(1 << 20)
    descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
    try:
        path.unlink()
        begun_s = time.monotonic()
        written = 0
        while written < SPEED_BYTES:
            written += os.write(descriptor, block)
        os.fdatasync(descriptor)
        return written / (time.monotonic() - begun_s)
    finally:
        os.close(descriptor)
