"""Two software GigE cameras over real UDP, recorded by the real command."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from recorder.cameras import stored_encoding
from recorder.check import check
from recorder.errors import PomologError
from recorder.records import SIDES
from recorder.session import Session
from recorder.status import FrameStamp
from tests.fake_gige import HEADER, expected
from tests.gige_scene import FAKETIME, LEFT, RIGHT
from tests.real_parts import missing, need_aravis

ADDRESS = {"left": LEFT, "right": RIGHT}
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("gige")]


def play(scene: str, out: Path, seconds: float) -> Path:
    need_aravis()
    setup = f"ip link set lo up; ip addr add {LEFT}/8 dev lo; ip addr add {RIGHT}/8 dev lo; "
    run = f"exec {sys.executable} -m tests.gige_scene {scene} {out} {seconds}"
    done = subprocess.run(
        ["unshare", "-rn", "--pid", "--fork", "--kill-child", "bash", "-c", setup + run],
        cwd=Path(__file__).parent.parent,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return out / "scene.mcap"


def stamps_of(session: Session, side: str) -> list[FrameStamp]:
    return [stamp for stamp in session.stamps() if stamp.stream == side]


def true_ns(data: bytes) -> int:
    """When the picture was really taken, on this computer's monotonic clock."""
    return int(HEADER.unpack_from(data)[0])


def test_every_pixel_arrives_as_it_was_sent_and_ids_wrap_without_a_loss(tmp_path: Path) -> None:
    with Session(play("plain", tmp_path, 7)) as session:
        frames = 0
        for pair in session.pairs():
            for frame in (pair.left, pair.right):
                assert frame.data == expected(ADDRESS[frame.side], frame.data)
                frames += 1
        assert frames > 200
        for side in SIDES:
            ids = [stamp.frame_id for stamp in stamps_of(session, side)]
            assert ids == sorted(ids, key=lambda i: ((i or 0) + 1000) % 0xFFFF)
            assert 0xFFFF in ids
            assert 1 in ids
            assert 0 not in ids
            ledger = session.ledger
            assert (ledger[f"{side}.missing"], ledger[f"{side}.dropped"]) == ("0", "0")
            assert int(ledger[f"{side}.frames"]) == len(session.times_ns(side)) == len(ids)


def test_a_frame_that_lost_packets_is_counted_and_never_kept(tmp_path: Path) -> None:
    with Session(play("lossy", tmp_path, 6)) as session:
        ledger = session.ledger
        stamps = stamps_of(session, "left")
        first, last = stamps[0].frame_id or 0, stamps[-1].frame_id or 0
        kept, incomplete, missed = (
            int(ledger[f"left.{name}"]) for name in ("frames", "incomplete", "missing")
        )
        assert incomplete + missed > 0
        assert kept + incomplete + missed == (last - first) % 0xFFFF + 1
        assert [s.status == "complete" for s in stamps].count(False) == incomplete
        assert len(session.times_ns("left")) == kept
        for pair in session.pairs():
            assert pair.left.data == expected(LEFT, pair.left.data)


def test_a_camera_killed_and_revived_leaves_its_exact_gap_in_the_ledger(tmp_path: Path) -> None:
    path = play("killed", tmp_path, 6)
    with Session(path) as session:
        gaps = np.diff(session.times_ns("right"))
        assert session.ledger["right.reopened"] == "1"
        assert int(session.ledger["right.silent_ns"]) == gaps.max()
        assert gaps.max() > 2.5e9
        usual = np.median(gaps)
        assert abs(int(session.ledger["right.missing"]) - (gaps.max() / usual - 1)) <= 1
        assert session.ledger["left.reopened"] == "0"
        assert any("right camera back after" in note.text for note in session.notes())
        for pair in session.pairs():
            assert abs(true_ns(pair.left.data) - true_ns(pair.right.data)) < 33e6
        last = session.times_ns("right")[-1]
        assert session.pair_times_ns()[-1, 1] > last - 1e9  # pairs again, to the end
    assert [finding for finding in check(path) if finding.level == "failure"] == []


def test_a_drifting_camera_clock_and_a_stepping_wall_clock_mispair_nothing(tmp_path: Path) -> None:
    if not FAKETIME.exists():
        missing("no libfaketime")
    with Session(play("drift", tmp_path, 14)) as session:
        stamps = {side: stamps_of(session, side) for side in SIDES}
        device = {stamp.time_ns: stamp.device_ns or 0 for stamp in stamps["right"]}
        epoch_ns = min(device.values())
        assert epoch_ns - (stamps["left"][0].device_ns or 0) > 900_000e9  # another epoch
        walls = np.diff([stamp.host_ns for stamp in stamps["left"]])
        assert walls.max() > 3500e9  # it really steps
        times = np.concatenate([session.times_ns(side) for side in SIDES])
        assert times.max() - times.min() < 60e9  # and the session's time does not
        truth: dict[str, list[int]] = {side: [] for side in SIDES}
        ticks = []
        for pair in session.pairs():
            ticks.append(device[pair.right.time_ns] - epoch_ns)
            for frame in (pair.left, pair.right):
                truth[frame.side].append(true_ns(frame.data))
        true = np.asarray(truth["right"]) - truth["right"][0]
        ppm = (np.polyfit(true, np.asarray(ticks), 1)[0] - 1) * 1e6
        assert ppm == pytest.approx(200, abs=60)  # it really drifts
        apart = np.abs(np.diff(list(truth.values()), axis=0))
        assert apart.max() < 33e6  # never the neighbour's frame, 67 ms away
        assert len(session) > 0.9 * len(stamps["left"])


def test_exposure_time_reaches_the_sensor(tmp_path: Path) -> None:
    with Session(play("exposure", tmp_path, 3)) as session:
        pair = next(session.pairs())
        left, right = (
            np.frombuffer(frame.data, np.uint8)[16:].mean() for frame in (pair.left, pair.right)
        )
        assert left / right == pytest.approx(0.5, abs=0.01)  # 5 ms against 10 ms


def test_a_software_trigger_takes_both_pictures_at_once(tmp_path: Path) -> None:
    with Session(play("triggered", tmp_path, 4)) as session:
        rate_hz = 1e9 / np.median(np.diff(session.times_ns("left")))
        assert rate_hz == pytest.approx(15, rel=0.3)
        assert len(session) > 20


def test_a_camera_that_is_not_there_is_one_line() -> None:
    need_aravis()
    code = (
        "from recorder.cameras import open_camera\n"
        "from recorder.equipment import CameraSettings\n"
        "open_camera(CameraSettings('aravis', '127.0.0.9'))\n"
    )
    done = subprocess.run(
        ["unshare", "-rn", "bash", "-c", f'ip link set lo up; exec {sys.executable} -c "{code}"'],
        cwd=Path(__file__).parent.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "no camera 127.0.0.9" in done.stderr.splitlines()[-1]


def test_a_format_that_a_session_cannot_keep_is_refused() -> None:
    with pytest.raises(PomologError, match="set pixel_format"):
        stored_encoding("Mono8", "x")
