"""What several tests need of the machine: it is made here, or its absence is said loudly."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest


def must(done: subprocess.CompletedProcess[str], what: str) -> None:
    """Skip loudly where a test cannot be made; continuous integration must not skip it."""
    if done.returncode:
        message = f"NOT TESTED: {what}: {done.stderr.strip()}"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    if os.geteuid() != 0 and os.environ.get("CI") != "true":
        pytest.skip("NOT TESTED: a full disk; mounting one needs root")
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)]
    must(subprocess.run(command, capture_output=True, text=True, check=False), "a full disk")
    yield place
    subprocess.run(["umount", str(place)], check=True)
