"""Recordings as files: Rerun's own program, and joining the parts of one recording with it."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from recorder.errors import PomologError


def rerun_binary() -> Path:
    """Rerun's program itself; the `rerun` on the path is a Python script that starts it."""
    import rerun_cli

    return Path(rerun_cli.__file__).parent / "rerun"


def join_recordings(parts: Sequence[Path], out: Path) -> None:
    """Join recordings of one id, in order, without decoding them.

    Raises:
        PomologError: Rerun's own tool could not.
    """
    command = [str(rerun_binary()), "rrd", "route", *map(str, parts), "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        reason = " ".join(done.stderr.split())[-300:]
        raise PomologError(
            f"cannot join the recordings of {out.parent}: {reason}; is the disk full?"
        )
