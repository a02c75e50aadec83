"""The recorder with an operator: keys, notes, ledger, preview, go or no go."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import threading
import time
import tty
from http.client import HTTPConnection
from pathlib import Path

import cv2
import numpy as np
import pytest

from recorder.cameras import Shot
from recorder.capture import Recorder
from recorder.clocks import ClockMap, SessionClock
from recorder.equipment import CaptureSettings, load_equipment
from recorder.errors import PomologError
from recorder.exposure import half_size, look_at
from recorder.keys import Keys, TakeReading
from recorder.ledger import StreamLedger
from recorder.plan import make_plan
from recorder.preflight import preflight, row_residual_px
from recorder.preview import crosshair_px
from recorder.rangefinders.dimetix import with_even_parity
from recorder.records import SIDES, Side
from recorder.rig import Rangefinder, parallel_rig
from recorder.salvage import survey
from recorder.segment import Recording
from recorder.session import Session
from recorder.storage import Storage
from recorder.timeline import Timeline
from recorder.warm_up import settle
from recorder.write_queue import Entry
from tests.line_devices import LineDevice, dimetix_answer
from tests.real_parts import need_module
from tests.rehearsal import rig_with_pictures, start


def stop(recorder: "subprocess.Popen[str]") -> tuple[str, str]:
    recorder.send_signal(signal.SIGINT)
    output, errors = recorder.communicate(timeout=20)
    assert recorder.returncode == 0, errors
    return output, errors


def wait_for(path: Path) -> None:
    end = time.monotonic() + 20
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.02)
    assert path.exists()


class Ticking:
    """A camera of 100 frames a second whose driver has room for 24."""

    def __init__(self, begin_s: float) -> None:
        self._next_s = begin_s
        self.lost = 0

    def next_shot(self, timeout_s: float) -> Shot | None:
        now_s = time.monotonic()
        while now_s - self._next_s > 0.24:
            self._next_s += 0.01
            self.lost += 1
        if self._next_s > now_s:
            if self._next_s - now_s > timeout_s:
                time.sleep(timeout_s)
                return None
            time.sleep(self._next_s - now_s)
        taken_ns = round(self._next_s * 1e9)
        self._next_s += 0.01
        return Shot(None, taken_ns, 0, time.monotonic_ns(), "jpeg", (1, 1), b"x")

    def trigger(self) -> None:
        raise AssertionError

    def close(self) -> None:
        raise AssertionError


def test_no_camera_waits_while_the_other_clock_is_learned(tmp_path: Path) -> None:
    plan = make_plan(rig_with_pictures(tmp_path), tmp_path, about={})
    begin_s = time.monotonic()
    cameras: dict[Side, Ticking] = {"left": Ticking(begin_s), "right": Ticking(begin_s + 1.0)}
    timelines = {str(side): Timeline(SessionClock(0, 0), ClockMap()) for side in SIDES}
    settle(plan, cameras, timelines)
    cameras["left"].next_shot(0.0)
    assert cameras["left"].lost == 0


def wait_until_shown(terminal: int, text: bytes, shown: bytearray) -> None:
    """Add to `shown` what a terminal shows, until that is in what is new."""
    begin, end = len(shown), time.monotonic() + 60  # other work may have the processor
    while text not in shown[begin:]:
        assert time.monotonic() < end, f"{text!r} not in {bytes(shown)!r}"
        shown += os.read(terminal, 4096)


def test_an_operator_at_a_terminal_takes_readings_and_notes(tmp_path: Path) -> None:
    need_module("serial", "serial")
    near, far = pty.openpty()
    tty.setraw(near)
    shown = bytearray()
    with LineDevice(dimetix_answer, start=with_even_parity(b"s0h\r\n"), rate_hz=20) as device:
        more = f'[rangefinder_device]\ndriver = "dimetix"\nport = "{device.path}"\n'
        rig = rig_with_pictures(tmp_path, more=more)
        words = ["record", "--rig", str(rig), "--out", str(tmp_path), "--name", "row"]
        recorder = subprocess.Popen(
            [sys.executable, "-m", "pomolog", *words],
            stdin=far,
            stderr=far,
            stdout=subprocess.DEVNULL,
            env=dict(os.environ) | {"TERM": "xterm", "COLUMNS": "150"},
        )
        os.close(far)
        wait_until_shown(near, b" fps", shown)
        for typed, answer in (
            (b"7 ", b"reading for apple 7"),
            (b"lightong\x7f\x7f\x7fing=back\r", b"lighting=back"),
            (b"2,5 m # apple 3\r", b"2,5 m # apple 3"),
            (b" ", b"reading for the fruit at the crosshair"),
        ):
            os.write(near, typed)
            wait_until_shown(near, answer, shown)
        recorder.send_signal(signal.SIGINT)
        while recorder.poll() is None:
            os.set_blocking(near, False)
            try:
                os.read(near, 4096)
            except (BlockingIOError, OSError):
                time.sleep(0.05)
    os.close(near)
    assert recorder.returncode == 0
    text = shown.decode()
    assert re.search(r"\d+\.\d\|\d+\.\d fps", text)
    assert "no loss" in text
    with Session(tmp_path / "row.mcap") as session:
        named = {r.apple_id: r for r in session.readings() if r.apple_id is not None}
        assert (named[7].range_m, named[7].status) == (1.234, "ok")
        assert (named[3].range_m, named[3].raw) == (2.5, "2,5 m # apple 3")
        notes = [note.text for note in session.notes()]
        assert "reading for apple 7: 1.2340 m" in notes
        assert "reading for the fruit at the crosshair: 1.2340 m" in notes
        assert "lighting=back" in notes
        assert list(session.pairs())[-1].conditions["lighting"] == "back"


def test_the_ledger_is_told_each_second_and_at_the_end(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path, rate_hz=30)
    recorder = start(rig, tmp_path, "--lighting", "front", "--cultivar", "Story", "--json")
    wait_for(tmp_path / "row.mcap.part")
    time.sleep(3.5)
    output, _ = stop(recorder)
    answer = json.loads(output)
    assert answer["files"] == [str(tmp_path / "row.mcap")]
    with Session(tmp_path / "row.mcap") as session:
        statuses = list(session.statuses())
        assert 2 <= len(statuses) <= 6
        assert np.diff([s.time_ns for s in statuses]).min() > 0.5e9
        last = statuses[-1]
        for side in SIDES:
            stream, ledger = last.stream(side), session.ledger
            assert 0 < stream.frames <= int(ledger[f"{side}.frames"])
            assert stream.rate_hz == pytest.approx(30, rel=0.2)
            assert stream.focus is not None
            assert int(ledger[f"{side}.frames"]) == len(session.times_ns(side))
            stamps = [s for s in session.stamps() if s.stream == side]
            assert [s.time_ns for s in stamps] == session.times_ns(side).tolist()
            assert all(s.monotonic_ns > 0 and s.host_ns > 10**18 for s in stamps)
        assert int(session.ledger["pairs"]) == len(session)
        assert session.metadata["cultivar"] == "Story"
        assert json.loads(session.metadata["equipment"])["cameras"]["left"]["driver"] == "files"
    told = subprocess.run(
        [sys.executable, "-m", "pomolog", "info", str(tmp_path / "row.mcap")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "ledger: left.dropped = 0" in told.stdout


def test_a_camera_that_goes_and_comes_back_is_noted(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path)
    recorder = start(rig, tmp_path)
    wait_for(tmp_path / "row.mcap.part")
    time.sleep(1)
    (tmp_path / "right").rename(tmp_path / "away")
    time.sleep(1.5)
    (tmp_path / "away").rename(tmp_path / "right")
    time.sleep(2)
    stop(recorder)
    with Session(tmp_path / "row.mcap") as session:
        assert int(session.ledger["right.reopened"]) == 1
        gap_ns = int(np.diff(session.times_ns("right")).max())
        assert int(session.ledger["right.silent_ns"]) == gap_ns > 1.4e9
        assert int(session.ledger["left.unpaired"]) >= int(session.ledger["right.missing"]) > 15
        assert session.ledger["right.unpaired"] == "0"


def test_the_preview_shows_both_views_to_this_computer_only(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path, size_px=(320, 240))
    recorder = start(rig, tmp_path, "--preview", "--preview-port", "0")
    assert recorder.stderr is not None
    line = recorder.stderr.readline()
    port = int(line.rsplit(":", 1)[1].strip("/\n"))
    time.sleep(1.5)

    def get(path: str, host: str = "127.0.0.1") -> tuple[int, bytes]:
        connection = HTTPConnection("127.0.0.1", port, timeout=5)
        connection.request("GET", path, headers={"Host": f"{host}:{port}"})
        response = connection.getresponse()
        body = response.read()
        connection.close()
        return response.status, body

    assert b"<canvas" in get("/")[1]
    for side in SIDES:
        status, jpeg = get(f"/{side}.jpg?1")
        picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert (status, picture is not None and picture.shape) == (200, (120, 160, 3))
    told = json.loads(get("/status.json")[1])
    assert "fps" in told["line"]
    assert sum(told["histograms"]["left"]) == 160 * 120
    assert get("/etc/passwd")[0] == 404
    assert get("/", host="evil.example")[0] == 403
    stop(recorder)


def scene(shift_rows: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Two views of random blocks, 12 columns and some rows apart."""
    rng = np.random.default_rng(8)
    wide = np.full((240, 360, 3), 90, np.uint8)
    for _ in range(250):
        x, y, size = (int(v) for v in rng.integers((0, 0, 4), (350, 230, 20)))
        wide[y : y + size, x : x + size] = rng.integers(0, 230, 3)
    return wide[:, 12:332], np.roll(wide, shift_rows, axis=0)[:, :320][:, :320]


def scene_rig(folder: Path, shift_rows: int = 0) -> Path:
    rig = rig_with_pictures(folder, size_px=(320, 240), pictures=1)
    for side, view in zip(SIDES, scene(shift_rows), strict=True):
        cv2.imwrite(str(folder / side / "0.png"), view)
        (folder / side / "0.jpg").unlink()
    return rig


def test_a_check_says_go(tmp_path: Path) -> None:
    rig = scene_rig(tmp_path)
    out = tmp_path / "out"
    done = start(rig, out, "--check")
    output, errors = done.communicate(timeout=60)
    assert (done.returncode, errors) == (0, "")
    assert output.splitlines()[-1] == "go"
    for word in ("frames a second", "skew", "focus", "epipolar residual 0.", "disk", "room for"):
        assert word in output
    assert list(out.iterdir()) == []


def test_a_check_says_no_go_for_a_calibration_that_is_not_the_rigs(tmp_path: Path) -> None:
    done = start(scene_rig(tmp_path, shift_rows=6), tmp_path, "--check", "--json")
    output, _ = done.communicate(timeout=60)
    answer = json.loads(output)
    assert (done.returncode, answer["go"]) == (1, False)
    failures = [f["text"] for f in answer["findings"] if f["level"] == "failure"]
    assert len(failures) == 1
    assert "epipolar residual" in failures[0]


def test_a_check_names_every_camera_that_is_missing(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path)
    rig.write_text(rig.read_text().replace(f"{tmp_path}/left", "/nowhere"))
    plan = make_plan(rig, tmp_path / "out", about={})
    failures = [f.text for f in preflight(plan) if f.level == "failure"]
    assert failures == ["no pictures to play at /nowhere; is the name right?"]


def test_pictures_of_another_size_than_the_rigs_are_refused(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path)
    rig.write_text(rig.read_text().replace("size_px = [160, 120]", "size_px = [320, 240]"))
    recorder = start(rig, tmp_path / "out")
    _, errors = recorder.communicate(timeout=30)
    assert recorder.returncode == 1
    assert "the left camera gives 160 x 120 px, the rig's calibration is of 320 x 240" in errors


def test_a_rig_that_is_refused_lets_go_of_its_rangefinder(tmp_path: Path) -> None:
    need_module("serial", "serial")
    with LineDevice(dimetix_answer) as device:
        more = f'[rangefinder_device]\ndriver = "dimetix"\nport = "{device.path}"\n'
        rig = rig_with_pictures(tmp_path, more=more)
        rig.write_text(rig.read_text().replace("size_px = [160, 120]", "size_px = [320, 240]"))
        for _ in range(2):
            with pytest.raises(PomologError, match="160 x 120 px"):
                Recorder(make_plan(rig, tmp_path / "out", about={}))


def test_rows_are_compared_after_rectification() -> None:
    rig = parallel_rig(size_px=(320, 240), focal_px=300.0)
    level = row_residual_px(rig, *scene())
    shifted = row_residual_px(rig, *scene(5))
    assert level is not None
    assert shifted is not None
    assert level < 0.5
    assert 4 < shifted < 6
    blank = np.full((240, 320, 3), 50, np.uint8)
    assert row_residual_px(rig, blank, blank) is None


def bayer(picture: np.ndarray) -> Shot:
    height, width, _ = picture.shape
    mosaic = np.empty((height, width), np.uint8)
    for y, x, channel in ((0, 0, 2), (0, 1, 1), (1, 0, 1), (1, 1, 0)):
        mosaic[y::2, x::2] = picture[y::2, x::2, channel]
    return Shot(0, 0, 0, 0, "bayer_rggb8", (width, height), mosaic.tobytes())


def test_exposure_and_focus_are_judged_on_the_green_of_any_encoding() -> None:
    sharp = np.random.default_rng(3).integers(20, 200, (64, 64, 3), np.uint8)
    burnt, dark, soft = sharp.copy(), sharp.copy(), cv2.GaussianBlur(sharp, (0, 0), 12)
    burnt[:16] = 255
    dark[:32] = 0
    for picture, warning in ((burnt, "25% over"), (dark, "50% under"), (soft, "out of focus")):
        for shot in (
            bayer(picture),
            Shot(0, 0, 0, 0, "bgr8", (64, 64), picture.tobytes()),
            Shot(0, 0, 0, 0, "png", (64, 64), cv2.imencode(".png", picture)[1].tobytes()),
        ):
            (found,) = look_at(shot).warnings("left")
            assert warning in found
    assert look_at(bayer(sharp)).warnings("left") == ()
    red = np.zeros((8, 8, 3), np.uint8)
    red[:, :, 2] = 200
    assert half_size(bayer(red)).tolist() == red[::2, ::2].tolist()


def test_the_crosshair_lies_where_the_beam_meets_the_fruit() -> None:
    beam = Rangefinder(np.array([0.1, 0.05, 0.0]), np.array([0.0, 0.0, 1.0]), 0.001)
    rig = parallel_rig(size_px=(640, 480), focal_px=600.0, baseline_m=0.2, rangefinder=beam)
    assert crosshair_px(rig, "left", 2.0) == pytest.approx((319.5 + 30, 239.5 + 15))
    assert crosshair_px(rig, "right", 2.0) == pytest.approx((319.5 - 30, 239.5 + 15))
    assert crosshair_px(parallel_rig(), "left", 2.0) is None


def test_a_pipe_gives_lines_and_its_end_ends_nothing() -> None:
    near, far = os.pipe()
    with os.fdopen(near) as stream, Keys(stream) as keys:
        os.write(far, b"r\nr 12\n tree 7 \n\n3.2 m")
        os.close(far)
        found = [*keys.poll(1.0), *keys.poll(0.1), *keys.poll(0.0)]
    assert found == [TakeReading(None), TakeReading(12), "tree 7"]


BAD = {
    "[cameras.right]\ndriver = 'files'\ndevice = 'x'\n": "no [cameras.left]",
    "[cameras.left]\ndriver = 'webcam'\ndevice = 'x'\n": "[cameras.left.driver]",
    "[cameras.left]\ndriver = 'files'\n": "[cameras.left.device]",
    "[cameras.left]\ndriver = 'files'\ndevice = 'x'\nfps = 3\n": "[cameras.left.fps]",
    "[capture]\nmax_skew_ms = -1\n": "[capture.max_skew_ms]",
    "[capture]\nqueue_mb = nan\n": "[capture.queue_mb]",
    "[cameras\n": "not TOML",
}


@pytest.mark.parametrize("text", BAD)
def test_a_rig_that_cannot_be_opened_is_one_line(tmp_path: Path, text: str) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(text)
    with pytest.raises(PomologError, match=re.escape(BAD[text])):
        load_equipment(rig)


def nothing_yet(folder: Path) -> Recording:
    return Recording(
        folder=folder,
        name="row",
        rig=parallel_rig(),
        metadata={},
        raw_images=True,
        max_skew_ns=5_000_000,
        split=None,
        ledgers={side: StreamLedger() for side in SIDES},
    )


def test_a_bug_while_writing_surfaces_and_leaves_what_can_be_salvaged(tmp_path: Path) -> None:
    storage = Storage(nothing_yet(tmp_path), CaptureSettings(reserve_mb=0))

    def broken(_: object) -> None:
        raise ValueError("ours")

    storage.put(Entry(1, "left", 10, broken))
    with pytest.raises(ValueError, match="ours"):
        storage.stop()
    assert (tmp_path / "row.mcap.part").exists()
    assert not storage.running


def test_a_stalled_disk_never_fills_the_memory(tmp_path: Path) -> None:
    recording = nothing_yet(tmp_path)
    storage = Storage(recording, CaptureSettings(reserve_mb=0, queue_mb=8))
    stalled = threading.Event()

    def stall(_: object) -> None:
        stalled.wait(10)

    storage.put(Entry(0, "left", 1, stall))
    time.sleep(0.2)
    for number in range(1, 101):
        storage.put(Entry(number, "left", 1_000_000, lambda _: None))
        assert storage.queue.waiting_bytes <= 8_000_000
    stalled.set()
    storage.stop()
    ledger = recording.ledgers["left"]
    assert (ledger.dropped, ledger.frames) == (92, 9)
    assert not survey(tmp_path / "row.mcap").frames
