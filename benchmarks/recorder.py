r"""What recording costs, and whether anything is lost: two software GigE cameras, real UDP.

Run in a network namespace (no privileges needed):

    unshare -rn bash -c 'ip link set lo up; ip addr add 127.0.0.2/8 dev lo; \
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
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from recorder.records import SIDES
from recorder.session import Session
from tests.fake_gige import HEADER
from tests.gige_scene import LEFT, RIG, RIGHT, start_camera


@dataclass(slots=True)
class Verdict:
    """What the files say, held against the true moments that the pictures carry."""

    sums: Counter[str] = field(default_factory=Counter)
    skews_ms: list[float] = field(default_factory=list)
    errors_ms: list[float] = field(default_factory=list)  # of a frame's time, with its transfer
    wrong_pairs: int = 0  # not the right frame nearest in truth
    missed_pairs: int = 0  # unpaired, though truly together within half the limit


def judge(path: Path, verdict: Verdict) -> None:
    """Add a finished file's ledger and timing, and delete the file."""
    with Session(path) as session:
        ledger = session.ledger
        verdict.sums.update({k: int(v) for k, v in ledger.items() if v.lstrip("-").isdigit()})
        zero_ns = int(session.metadata["clock_zero_ns"])
        true_ns: dict[str, dict[int, int]] = {side: {} for side in SIDES}
        for message in session.messages():
            for side in SIDES:
                if message.topic == f"/{side}/image":
                    picture = RawImage.FromString(message.data).data
                    true_ns[side][message.log_ns] = int(HEADER.unpack_from(picture)[0])
        for side in SIDES:
            verdict.errors_ms += [(t - zero_ns - true) / 1e6 for t, true in true_ns[side].items()]
        times = session.pair_times_ns()
        verdict.skews_ms += ((times[:, 1] - times[:, 0]) / 1e6).tolist()
        rights = np.sort(np.asarray(list(true_ns["right"].values())))
        paired = set(times[:, 0].tolist())
        for left_ns, right_ns in times.tolist():
            left, right = true_ns["left"][left_ns], true_ns["right"][right_ns]
            verdict.wrong_pairs += bool(np.abs(rights - left).min() < abs(right - left))
        half_limit_ns = int(session.metadata["max_skew_ns"]) // 2
        for time_ns, true in true_ns["left"].items():
            if time_ns not in paired and np.abs(rights - true).min() < half_limit_ns:
                verdict.missed_pairs += 1
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
    verdict = Verdict()
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
            judge(path, verdict)
    output, _ = recorder.communicate()
    for path in sorted(folder.glob("bench-*.mcap")):
        judge(path, verdict)
    for camera in cameras:
        camera.send_signal(signal.SIGKILL)
        camera.wait()
    assert begun is not None
    share = (last[1] - begun[1]) / (last[0] - begun[0])
    steady_mb = memory_mb[5:-5]
    quarter = max(1, len(steady_mb) // 4)
    print(f"exit {recorder.returncode}, {seconds:g} s at {rate_hz:g} fps x 2, 1280 x 1024 Bayer")
    print(f"CPU share of one core: {share:.1%}")
    print(
        f"memory: {statistics.median(steady_mb[:quarter]):.0f} MB in the first quarter, "
        f"{statistics.median(steady_mb[-quarter:]):.0f} MB in the last, most {max(memory_mb):.0f}"
    )
    sums = verdict.sums
    for name in ("frames", "dropped", "missing", "incomplete", "late", "unpaired", "reopened"):
        print(f"{name:11} left {sums[f'left.{name}']:6}  right {sums[f'right.{name}']:6}")
    print(f"pairs       {sums['pairs']}")
    skews_ms, errors_ms = np.asarray(verdict.skews_ms), np.asarray(verdict.errors_ms)
    print(f"pairs that are wrong {verdict.wrong_pairs}, missed {verdict.missed_pairs}")
    print(
        f"skew: median {np.median(skews_ms):+.2f} ms, 99 % {np.percentile(abs(skews_ms), 99):.2f}"
    )
    low, middle, high = np.percentile(errors_ms, (1, 50, 99))
    print(f"frame times less true times: 1 % {low:.2f} ms, 50 % {middle:.2f}, 99 % {high:.2f}")
    drifts = [s.get("drift_ppm") for s in json.loads(output)["status"]["streams"]] if output else []
    print(f"drift found: {drifts[:2]} ppm")


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]), Path(sys.argv[3]))
