r"""What recording costs, and whether anything is lost: two software GigE cameras, real UDP.

Run in a network namespace (no privileges needed):

    unshare -rn bash -c 'ip link set lo up; ip addr add 127.0.0.2/8 dev lo; \\
      ip addr add 127.0.0.3/8 dev lo; exec python -m benchmarks.recorder 600 15 /somewhere'

Arguments: seconds, frames a second, a folder. Prints the CPU share of one core, the memory over
time, and the ledgers' sums. Files are split by the minute, judged and deleted, so that ten minutes
(24 GB) need little room.
"""

import json
import signal
import statistics
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import psutil

from recorder.session import Session
from tests.gige_scene import LEFT, RIG, RIGHT, start_camera


def judge(path: Path, sums: Counter[str], skews_ms: list[float]) -> None:
    """Add a finished file's ledger, and delete the file."""
    with Session(path) as session:
        sums.update({k: int(v) for k, v in session.ledger.items() if v.lstrip("-").isdigit()})
        times = session.pair_times_ns()
        skews_ms += ((times[:, 1] - times[:, 0]) / 1e6).tolist()
    path.unlink()


def main(seconds: float, rate_hz: float, folder: Path) -> None:
    """Record, watch the process, and print the table."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = folder / "rig.toml"
    rig.write_text(RIG.format(width=1280, height=1024, rate_hz=rate_hz, left="", right=""))
    cameras = [start_camera(LEFT), start_camera(RIGHT)]
    words = ["record", "--rig", str(rig), "--out", str(folder), "--split", "60s", "--name", "bench"]
    recorder = subprocess.Popen(
        [sys.executable, "-m", "pomolog", *words, "--duration", str(seconds), "--json"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
    )
    process = psutil.Process(recorder.pid)
    sums: Counter[str] = Counter()
    skews_ms: list[float] = []
    memory_mb: list[float] = []
    begun = None
    while recorder.poll() is None:
        time.sleep(1)
        try:
            used = process.cpu_times()
            memory_mb.append(process.memory_info().rss / 1e6)
        except psutil.NoSuchProcess:
            break
        if begun is None and len(memory_mb) == 5:  # started, imports paid for
            begun = (time.monotonic(), used.user + used.system)
        last = (time.monotonic(), used.user + used.system)
        for path in sorted(folder.glob("bench-*.mcap")):
            judge(path, sums, skews_ms)
    output, _ = recorder.communicate()
    for path in sorted(folder.glob("bench-*.mcap")):
        judge(path, sums, skews_ms)
    for camera in cameras:
        camera.send_signal(signal.SIGKILL)
        camera.wait()
    assert begun is not None
    share = (last[1] - begun[1]) / (last[0] - begun[0])
    steady_mb = memory_mb[5:]
    quarter = max(1, len(steady_mb) // 4)
    print(f"exit {recorder.returncode}, {seconds:g} s at {rate_hz:g} fps x 2, 1280 x 1024 Bayer")
    print(f"CPU share of one core: {share:.1%}")
    print(
        f"memory: {statistics.median(steady_mb[:quarter]):.0f} MB in the first quarter, "
        f"{statistics.median(steady_mb[-quarter:]):.0f} MB in the last, most {max(memory_mb):.0f}"
    )
    for name in ("frames", "dropped", "missing", "incomplete", "late", "unpaired", "reopened"):
        print(f"{name:11} left {sums[f'left.{name}']:6}  right {sums[f'right.{name}']:6}")
    print(f"pairs       {sums['pairs']}")
    if skews_ms:
        worst = max(abs(s) for s in skews_ms)
        print(f"skew: median {statistics.median(skews_ms):+.2f} ms, at most {worst:.2f}")
    drifts = [s.get("drift_ppm") for s in json.loads(output)["status"]["streams"]] if output else []
    print(f"drift found: {drifts[:2]} ppm")


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]), Path(sys.argv[3]))
