"""Processes that end with the command they work for."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil

WORK = """
import os, time
from processor.pool import processes
if __name__ == "__main__":
    with processes(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 600).result()
"""


def test_a_worker_ends_when_its_command_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "work.py"
    script.write_text(WORK)
    root = str(Path(__file__).parent.parent)
    command = subprocess.Popen(
        [sys.executable, str(script)], env={**os.environ, "PYTHONPATH": root},
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert command.stdout is not None
    worker = psutil.Process(int(command.stdout.readline()))
    command.send_signal(signal.SIGKILL)
    command.wait()
    command.stdout.close()
    _, alive = psutil.wait_procs([worker], timeout=60)  # at once, but for a busy machine
    for orphan in alive:
        orphan.kill()
    assert alive == []
