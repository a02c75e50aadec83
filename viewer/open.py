"""Open recordings in Rerun's viewer."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from processor.recordings import rerun_binary
from recorder.errors import PomologError
from recorder.files import replacing


def recordings(path: Path) -> tuple[Path, ...]:
    """What there is to open at `path`: a session, a recording, or a folder of results.

    Raises:
        PomologError: nothing there can be opened.
    """
    if path.is_file() and path.suffix in (".mcap", ".rrd"):
        return (path,)
    if path.is_file():
        raise PomologError(f"{path} is no session, recording or folder of results")
    found = [path / "trace.rrd"] if (path / "trace.rrd").is_file() else []
    found += sorted(path.glob("*/trace.rrd"))
    if not found:
        raise PomologError(
            f"no recording in {path}; make one with: pomolog replay S.mcap -o {path} --rrd full"
        )
    return tuple(found)


def lay_out(files: Sequence[Path]) -> tuple[Path, ...]:
    """Put our layout beside each recording; give the files to open, one layout for all of them."""
    from viewer.layout import save_layout

    layouts = []
    for file in files:
        if file.suffix == ".rrd":
            with replacing(file.with_suffix(".rbl")) as part:
                save_layout(part)
            layouts.append(file.with_suffix(".rbl"))
    return (*files, *layouts[:1])


def open_viewer(files: Sequence[Path], *, web: bool = False) -> None:
    """Open files in the native viewer, or serve them to a browser on this machine, and wait.

    Raises:
        PomologError: there is no screen for the native viewer, or it could not start.
    """
    binary = rerun_binary()
    has_screen = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if not web and sys.platform == "linux" and not has_screen:
        raise PomologError(f"no screen here for the viewer; use: pomolog view {files[0]} --web")
    command = [str(binary), "--bind", "127.0.0.1", *(["--serve-web"] if web else [])]
    try:
        done = subprocess.run([*command, *map(str, files)], check=False)
    except OSError as error:
        raise PomologError(f"cannot start the viewer {binary}: {error.strerror}") from None
    if done.returncode > 0:
        raise PomologError(f"the viewer stopped with exit code {done.returncode}")
