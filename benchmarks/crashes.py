r"""What a kill, a power cut and a full disk cost, on real processes and a real ext4.

    python -m benchmarks.crashes FOLDER [--kills 20]

Pictures are 1280 x 1024 raw Bayer at 15 fps x 2 from two software GigE cameras, so run it in a
network namespace; mounting needs root, and without it only the kills are done:

    sudo unshare -n bash -c 'ip link set lo up; ip addr add 127.0.0.2/8 dev lo; \
      ip addr add 127.0.0.3/8 dev lo; exec python -m benchmarks.crashes /somewhere'
"""

import argparse
import fcntl
import os
import random
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from recorder.check import check
from recorder.records import SIDES
from recorder.salvage import salvage
from recorder.session import Session
from tests.fake_gige import HEADER
from tests.gige_scene import LEFT, RIG, RIGHT, start_camera

EXT4_IOC_SHUTDOWN = 0x8004587D
NO_LOG_FLUSH = 2
FIRST_BYTES = 3_000_000  # the first pair is in the file


@contextmanager
def ext4(folder: Path, megabytes: int) -> Iterator[Path]:
    """A fresh ext4 of that size."""
    image, mount = folder / "disk.img", folder / "disk"
    mount.mkdir(exist_ok=True)
    with image.open("wb") as stream:
        stream.truncate(megabytes << 20)
    subprocess.run(["mkfs.ext4", "-q", "-m", "0", str(image)], check=True)
    subprocess.run(["mount", "-o", "loop", str(image), str(mount)], check=True)
    try:
        yield mount
    finally:
        subprocess.run(["umount", str(mount)], check=False)
        image.unlink()


def start(rig: Path, out: Path) -> "subprocess.Popen[str]":
    """Start the recorder and wait until it records."""
    words = ["record", "--rig", str(rig), "--out", str(out), "--name", "row"]
    recorder = subprocess.Popen(
        [sys.executable, "-m", "pomolog", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    part = out / "row.mcap.part"
    while not part.exists() or part.stat().st_size < FIRST_BYTES:
        assert recorder.poll() is None, recorder.communicate()
        time.sleep(0.01)
    return recorder


def lost_pairs(path: Path, until_ns: int) -> tuple[int, float]:
    """Pairs in a session, and the seconds between its last pair's true moment and that moment."""
    with Session(path) as session:
        last = 0
        for pair in session.pairs(max(0, len(session) - 1)):
            last = int(HEADER.unpack_from(pair.left.data)[0])
        return len(session), (until_ns - last) / 1e9


def kills(rig: Path, folder: Path, times: int) -> None:
    """Kill the recorder at random moments."""
    chance = random.Random(4)
    waits = []
    for number in range(times):
        out = folder / f"kill{number}"
        recorder = start(rig, out)
        time.sleep(chance.uniform(0.3, 5.0))
        recorder.kill()
        killed_ns = time.monotonic_ns()
        recorder.communicate()
        salvage(out / "row.mcap.part", out / "whole.mcap")
        failures = [f for f in check(out / "whole.mcap") if f.level == "failure"]
        pairs, wait_s = lost_pairs(out / "whole.mcap", killed_ns)
        waits.append(wait_s)
        lost = int(max(0.0, wait_s - 0.02) * 15)  # taken more than 20 ms before: delivered
        print(
            f"kill {number}: {pairs} pairs, last {wait_s * 1e3:.0f} ms before, {lost} lost, "
            f"{len(failures)} failures",
            flush=True,
        )
        for path in out.iterdir():
            path.unlink()
    print(f"most {max(waits) * 1e3:.0f} ms, that is {max(waits) * 15:.1f} frame intervals")


def power_cuts(rig: Path, folder: Path, times: int) -> None:
    """Cut the power of the disk."""
    for number in range(times):
        with ext4(folder, 1500) as disk:
            recorder = start(rig, disk / "day")
            time.sleep(4 + number * 0.17)
            descriptor = os.open(disk, os.O_RDONLY)
            fcntl.ioctl(descriptor, EXT4_IOC_SHUTDOWN, struct.pack("I", NO_LOG_FLUSH))
            cut_ns = time.monotonic_ns()
            os.close(descriptor)
            _, errors = recorder.communicate()
            subprocess.run(["umount", str(disk)], check=True)
            image = folder / "disk.img"
            subprocess.run(["mount", "-o", "loop", str(image), str(disk)], check=True)
            wreck = salvage(disk / "day" / "row.mcap.part", folder / "whole.mcap")
        pairs, lost_s = lost_pairs(folder / "whole.mcap", cut_ns)
        print(
            f"power cut {number}: {wreck.frames} frames, {pairs} pairs, {lost_s:.2f} s lost; "
            f"exit {recorder.returncode}"
        )
        print(f"  {errors.strip()}", flush=True)


def full_disk(rig: Path, folder: Path) -> None:
    """Fill the disk."""
    with ext4(folder, 300) as disk:
        recorder = start(rig, disk / "day")
        _, errors = recorder.communicate()
        failures = [f for f in check(disk / "day" / "row.mcap") if f.level == "failure"]
        with Session(disk / "day" / "row.mcap") as session:
            written = [int(session.ledger[f"{side}.frames"]) for side in SIDES]
            print(
                f"full disk: exit {recorder.returncode}, {len(session)} pairs, {sum(written)} "
                f"frames written, {session.info().frames} readable, {len(failures)} failures"
            )
        print(f"  {errors.strip()}", flush=True)


def main() -> None:
    """All three."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--cuts", type=int, default=5)
    arguments = parser.parse_args()
    folder: Path = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    rig = folder / "rig.toml"
    text = RIG.format(width=1280, height=1024, rate_hz=15.0, left="", right="")
    rig.write_text(text.replace("reserve_mb = 50.0", "reserve_mb = 0.0"))
    cameras = [start_camera(LEFT), start_camera(RIGHT)]
    try:
        kills(rig, folder, arguments.kills)
        if os.geteuid() == 0:
            power_cuts(rig, folder, arguments.cuts)
            full_disk(rig, folder)
    finally:
        for camera in cameras:
            camera.kill()
            camera.wait()


if __name__ == "__main__":
    main()
