"""What survives: kills, power cuts, full disks. Real processes, a real ext4."""

import fcntl
import os
import re
import signal
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from recorder.check import check
from recorder.disk import Ballast, DiskFile
from recorder.errors import PomologError
from recorder.ledger import PairCounter
from recorder.records import SIDES
from recorder.salvage import salvage
from recorder.segment import Split
from recorder.session import Session
from recorder.write_queue import Entry, WriteQueue
from tests.real_parts import missing, need_root
from tests.rehearsal import rig_with_pictures, start

EXT4_IOC_SHUTDOWN = 0x8004587D  # _IOR('X', 125, u32), Linux: fs/ext4/ext4.h
NO_LOG_FLUSH = 2  # as if the power had gone


@contextmanager
def ext4(folder: Path, megabytes: int) -> Iterator[Path]:
    """A fresh ext4 of that size."""
    need_root("mounting an ext4")
    image, mount = folder / "disk.img", folder / "disk"
    mount.mkdir()
    with image.open("wb") as stream:
        stream.truncate(megabytes << 20)
    subprocess.run(["mkfs.ext4", "-q", "-m", "0", str(image)], check=True)
    done = subprocess.run(
        ["mount", "-o", "loop", str(image), str(mount)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        missing(f"cannot mount a loop device here ({done.stderr.strip()})")
    try:
        yield mount
    finally:
        subprocess.run(["umount", str(mount)], check=False)


def wait_for(path: Path, size_bytes: int = 0) -> None:
    end = time.monotonic() + 60  # other work may have the processor
    while time.monotonic() < end:
        if path.exists() and path.stat().st_size >= size_bytes:
            return
        time.sleep(0.02)
    raise AssertionError(f"{path} has not come")


def test_a_recording_ended_by_a_signal_is_whole(tmp_path: Path) -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        folder = tmp_path / number.name
        recorder = start(rig_with_pictures(folder), folder)
        wait_for(folder / "row.mcap.part", 300_000)  # pictures of both cameras
        recorder.send_signal(number)
        _, errors = recorder.communicate(timeout=20)
        assert (recorder.returncode, errors) == (0, "")
        assert not (folder / "row.mcap.part").exists()
        assert [f for f in check(folder / "row.mcap") if f.level == "failure"] == []


@pytest.mark.parametrize("after_s", [0.4, 1.3])
def test_a_killed_recording_loses_at_most_the_pair_in_flight(
    tmp_path: Path, after_s: float
) -> None:
    rig = rig_with_pictures(tmp_path, size_px=(640, 480))
    recorder = start(rig, tmp_path)
    part = tmp_path / "row.mcap.part"
    wait_for(part, 500_000)  # the first pictures are there
    time.sleep(after_s)
    recorder.kill()
    killed_ns = time.time_ns()
    recorder.communicate()
    wreck = salvage(part, tmp_path / "whole.mcap")
    with Session(tmp_path / "whole.mcap") as session:
        assert len(session) * 2 <= wreck.frames
        last_ns = int(session.pair_times_ns().max())
    assert (killed_ns - last_ns) * 15 / 1e9 < 2 + 1  # one in flight, one not yet due; and our clock


@pytest.mark.slow
def test_a_power_cut_costs_less_than_a_second(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path / "rig", size_px=(640, 480))
    with ext4(tmp_path, 512) as disk:
        recorder = start(rig, disk / "day")
        part = disk / "day" / "row.mcap.part"
        wait_for(part)
        time.sleep(3)
        descriptor = os.open(disk, os.O_RDONLY)
        fcntl.ioctl(descriptor, EXT4_IOC_SHUTDOWN, struct.pack("I", NO_LOG_FLUSH))
        cut_ns = time.time_ns()
        os.close(descriptor)
        _, errors = recorder.communicate(timeout=20)
        assert recorder.returncode == 1
        assert len(errors.splitlines()) == 1
        assert "the disk fails" in errors
        subprocess.run(["umount", str(disk)], check=True)
        subprocess.run(["mount", "-o", "loop", str(tmp_path / "disk.img"), str(disk)], check=True)
        wreck = salvage(part, tmp_path / "whole.mcap")
        promised = re.search(r"(\d+) frames for sure", errors)
        assert promised is not None
        assert wreck.frames >= int(promised[1]) > 40
    with Session(tmp_path / "whole.mcap") as session:
        assert len(session) > 20
        lost_s = (cut_ns - int(session.pair_times_ns().max())) / 1e9
    assert lost_s < 1.0  # 0.5 s between syncs, and a loaded machine's delay


@pytest.mark.slow
def test_a_full_disk_ends_the_recording_whole_with_one_line(tmp_path: Path) -> None:
    rig = rig_with_pictures(
        tmp_path / "rig", size_px=(640, 480), reserve_mb=0, capture="ballast_mb = 12.0"
    )
    with ext4(tmp_path, 64) as disk:
        recorder = start(rig, disk / "day", "--json")
        output, errors = recorder.communicate(timeout=60)
        assert (recorder.returncode, output) == (1, "")
        assert len(errors.splitlines()) == 1
        assert "disk full" in errors
        session_path = disk / "day" / "row.mcap"
        assert [f for f in check(session_path) if f.level == "failure"] == []
        with Session(session_path) as session:
            assert session.ledger["ended"] == "disk full"
            for side in SIDES:
                assert len(session.times_ns(side)) == int(session.ledger[f"{side}.frames"]) > 30
        assert sorted(p.name for p in (disk / "day").iterdir()) == ["row.mcap"]


@pytest.mark.slow
def test_recording_ends_in_good_order_before_the_disk_is_full(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path / "rig", size_px=(640, 480), reserve_mb=30)
    with ext4(tmp_path, 80) as disk:
        recorder = start(rig, disk / "day")
        _, errors = recorder.communicate(timeout=60)
        assert recorder.returncode == 1
        assert "disk nearly full" in errors
        with Session(disk / "day" / "row.mcap") as session:
            assert session.ledger["ended"] == "disk nearly full"
            assert session.ledger["left.dropped"] == "0"
        recorder = start(rig, disk / "day", "--name", "next")
        _, errors = recorder.communicate(timeout=60)
        assert recorder.returncode == 1
        assert "free for" in errors


def test_segments_never_part_a_pair_and_add_up(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path, rate_hz=30)
    recorder = start(rig, tmp_path, "--split", "0.5s", "--lighting", "front")
    wait_for(tmp_path / "row-001.mcap.part")
    assert recorder.stdin is not None
    recorder.stdin.write("lighting = back\n")
    recorder.stdin.flush()
    wait_for(tmp_path / "row-004.mcap.part")
    recorder.send_signal(signal.SIGINT)
    recorder.communicate(timeout=20)
    sequences = []
    paths = sorted(tmp_path.glob("row-*.mcap"))
    assert len(paths) >= 4
    for number, path in enumerate(paths, start=1):
        with Session(path) as session:
            assert session.metadata["segment"] == str(number)
            assert session.metadata["lighting"] == ("front" if number == 1 else "back")
            assert int(session.ledger["pairs"]) == len(session)
            if path != paths[-1] and number > 1:
                assert session.ledger["left.unpaired"] == session.ledger["right.unpaired"] == "0"
            sequences += [pair.left.sequence for pair in session.pairs()]
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))


def test_a_recording_never_overwrites_another(tmp_path: Path) -> None:
    rig = rig_with_pictures(tmp_path)
    (tmp_path / "row.mcap").write_bytes(b"yesterday")
    recorder = start(rig, tmp_path)
    _, errors = recorder.communicate(timeout=20)
    assert recorder.returncode == 1
    assert "is there already" in errors
    assert (tmp_path / "row.mcap").read_bytes() == b"yesterday"


def entry(number: int, picture_bytes: int = 100) -> Entry:
    return Entry(number, "left" if picture_bytes else "notes", picture_bytes, lambda _: None)


def test_a_full_queue_drops_the_oldest_pictures_counts_them_and_keeps_every_note() -> None:
    dropped: list[int] = []
    queue = WriteQueue(500, lambda gone: dropped.append(gone.time_ns))
    for number in range(20):
        queue.put(entry(number))
        queue.put(entry(1000 + number, 0))
    assert queue.waiting_bytes == 500
    queue.close()
    queue.put(entry(99))  # too late: counted, too
    kept = []
    while not queue.finished:
        got = queue.get(0.0)
        assert got is not None
        kept.append(got.time_ns)
    assert kept == [*range(1000, 1020), *range(15, 20)]
    assert dropped == [*range(15), 99]


def test_a_write_that_meets_a_full_disk_is_finished_from_the_ballast(tmp_path: Path) -> None:
    with ext4(tmp_path, 40) as disk:
        ballast = Ballast(disk, 12_000_000)
        file = DiskFile(disk / "file", ballast)
        block = os.urandom(1_000_000)
        written = 0
        while not file.full:
            written += file.write(block)
        written += file.write(block * 5)
        file.close()
        assert (disk / "file").read_bytes() == block * (written // len(block))


@pytest.mark.parametrize(
    ("text", "split"),
    [
        ("5min", Split(seconds=300)),
        ("1h", Split(seconds=3600)),
        ("1.5s", Split(seconds=1.5)),
        ("500MB", Split(size_bytes=500_000_000)),
        ("2 GB", Split(size_bytes=2_000_000_000)),
    ],
)
def test_split_is_a_time_or_a_size(text: str, split: Split) -> None:
    assert Split.parse(text) == split


@pytest.mark.parametrize("text", ["5", "min", "-5min", "0s", "5 parsecs", ""])
def test_any_other_split_is_refused(text: str) -> None:
    with pytest.raises(PomologError, match="no time or size"):
        Split.parse(text)


def test_pairs_are_counted_as_the_session_will_pair_them() -> None:
    pairs = PairCounter(max_skew_ns=5)
    second = 1_000_000_000
    for i in range(10):
        pairs.add("left", i * second)
        if i != 4:
            pairs.add("right", i * second + (3 if i != 7 else 8))
        pairs.settle(i * second)
    pairs.settle()
    assert (pairs.pairs, pairs.unpaired) == (8, {"left": 2, "right": 1})
    assert pairs.skew_ns == 3
