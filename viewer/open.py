"""Open recordings in Rerun's viewer: a window of its own, or served to a browser."""

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

from processor.recordings import rerun_binary
from recorder.errors import PomologError

LOOPBACK = "127.0.0.1"
EVERYWHERE = ("0.0.0.0", "::")


def open_viewer(
    files: Sequence[Path],
    *,
    web: bool = False,
    bind: str = LOOPBACK,
    memory: str = "",
    frame: int | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Open files in the native viewer, or serve them to a browser, and wait.

    Args:
        files: the layout, then recordings.
        web: serve instead of a window.
        bind: the address to serve on; this machine's own unless somebody asks for more.
        memory: what the viewer may hold, like "4GB"; beyond it the oldest data go.
        frame: to open at, in a window.
        say: hears the address to open in a browser.

    Raises:
        PomologError: there is no screen for the native viewer, it could not start, or a browser
            is to open at a frame.
    """
    if web and frame is not None:
        raise PomologError(
            "a browser opens at the beginning; leave --frame and --time out, or use --worst"
        )
    require_screen(files[-1], web=web)
    port, page_port = free_ports(2)
    command = [str(rerun_binary()), "--bind", bind, "--port", str(port)]
    if web:
        command += ["--serve-web", "--web-viewer-port", str(page_port)]
        # beyond a limit the oldest data go, so it is the user's to set one
        command += ["--server-memory-limit", memory or "90%"]
        say(f"open in a browser (Ctrl-C ends it): {page_address(bind, page_port, port)}")
    elif memory:
        command += ["--memory-limit", memory]
    try:
        quiet = {**os.environ, "RUST_LOG": os.environ.get("RUST_LOG", "error")}
        viewer = subprocess.Popen([*command, *map(str, files)], env=quiet)
    except OSError as error:
        raise PomologError(
            f"cannot start the viewer {command[0]}: {error.strerror}; install pomolog again"
        ) from None
    if frame is not None and not web:
        threading.Thread(target=go_to, args=(port, frame), daemon=True).start()
    try:
        code = viewer.wait()
    finally:
        viewer.terminate()
    if code > 0:
        raise PomologError(
            f"the viewer stopped with exit code {code}; "
            "see its lines above, and --web needs no screen"
        )


def page_address(bind: str, page_port: int, port: int) -> str:
    """Where a browser finds the viewer, and where the viewer finds its data."""
    host = socket.gethostname() if bind in EVERYWHERE else bind
    data = quote(f"rerun+http://{host}:{port}/proxy", safe="")
    return f"http://{host}:{page_port}/?url={data}"


def require_screen(what: Path, *, web: bool) -> None:
    """Say at once, before any work, that a window needs a screen.

    Raises:
        PomologError: there is none.
    """
    has_screen = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if not web and sys.platform == "linux" and not has_screen:
        raise PomologError(f"no screen here for the viewer; use: pomolog view {what} --web")


def go_to(port: int, frame: int, patience_s: float = 60.0) -> None:
    """Set the time of a viewer that is starting, once it has something to show."""
    from rerun.experimental import ViewerClient

    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        # whatever is wrong with a viewer that is still starting, the next moment may be better
        with suppress(Exception):
            client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            client.set_time("frame", sequence=frame, play_state="paused")
            return
        time.sleep(0.3)


def free_ports(count: int) -> list[int]:
    """Ports that nobody listens on."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for one in sockets:
            one.bind((LOOPBACK, 0))
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()
