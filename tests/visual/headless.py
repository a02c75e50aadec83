"""Rerun's viewer without a window, on a Vulkan driver that needs no graphics card."""

import io
import os
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image
from rerun.experimental import ViewerClient

from processor.recordings import rerun_binary
from viewer.open import free_ports

SIZE_PX = (1200, 800)
TOP_PX = 72  # the viewer's own bar and its passing notes, which are not ours
ALIKE = 3  # shots in a row that differ in nothing: the viewer is at rest
PATIENCE_S = 120.0  # on a busy machine; a quiet one needs a second

Pixels = npt.NDArray[np.uint8]


class Headless:
    """A viewer that has opened files."""

    def __init__(self, client: ViewerClient) -> None:
        self._client = client
        self._stale = b""  # the window before the tab was changed
        until = time.monotonic() + PATIENCE_S
        # Rerun's own views are called by their entity; whoever asks for the layout before ours is
        # read is given theirs for good
        while not (names := self._names()) or any("/" in name for name in names):
            assert time.monotonic() < until, f"the viewer does not show our views: {names}"
            time.sleep(0.3)

    def _names(self) -> list[str]:
        return [view.name for view in self._client.get_state().views]

    def front(self, tab: str) -> None:
        """Put a tab in front, once the layout is there."""
        until = time.monotonic() + PATIENCE_S
        while True:
            parts = self._client.get_blueprint(of="recording").blueprint
            boxes: dict[str, Any] = {
                path: part["ContainerBlueprint"]
                for path, part in parts.items()
                if "ContainerBlueprint" in part
            }
            names = {str(box.get("display_name")): path for path, box in boxes.items()}
            if tab in names:
                break
            assert time.monotonic() < until, f"no tab {tab} among {sorted(names)}"
            time.sleep(0.2)
        for box in boxes.values():
            for path in box["contents"]:  # with a slash before it, or without: both occur
                if path.strip("/") == names[tab].strip("/") and box.get("active_tab") != path:
                    box["active_tab"] = path
                    self._stale = self._client.take_screenshot()
                    self._client.set_blueprint(parts, of="recording")
                    return

    def at(self, timeline: str, place: int) -> None:
        """Go to a place of a timeline."""
        self._client.set_time(timeline, sequence=place, play_state="paused")

    def picture(self) -> Pixels:
        """The window below its bar, once it has come to rest, (H, W, 3) RGB."""
        until = time.monotonic() + PATIENCE_S
        last, alike = self._stale, 0
        while time.monotonic() < until:
            shot = self._client.take_screenshot()
            alike = alike + 1 if shot == last and shot != self._stale else 0
            if alike == ALIKE:
                return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"))[TOP_PX:]
            last = shot
            time.sleep(0.3)
        raise AssertionError("the viewer does not come to rest")

    def complaints(self) -> list[str]:
        """What the views report, and what the viewer logs beside its lack of a graphics card."""
        state = self._client.get_state()
        said = [f"{view.name}: {view.reports}" for view in state.views if view.reports]
        said += [
            entry.message
            for entry in self._client.get_logs()
            if entry.level in ("WARN", "ERROR") and "oftware rasterizer" not in entry.message
        ]
        return said


@contextmanager
def headless(
    files: Sequence[Path], driver: Path, folder: Path, size_px: tuple[int, int] = SIZE_PX
) -> Iterator[Headless]:
    """A viewer of these files; its own folder keeps its state."""
    (port,) = free_ports(1)
    command = [
        str(rerun_binary()), "--headless", "--bind", "127.0.0.1", "--port", str(port),
        "--window-size", f"{size_px[0]}x{size_px[1]}", *map(str, files),
    ]  # fmt: skip
    environment = {
        **os.environ, "VK_ICD_FILENAMES": str(driver), "XDG_RUNTIME_DIR": str(folder),
        "HOME": str(folder),
    }  # fmt: skip
    with (folder / "viewer.log").open("wb") as log:
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
        try:
            yield Headless(_connected(port, process))
        finally:
            process.kill()
            process.wait()


def _connected(port: int, process: subprocess.Popen[bytes]) -> ViewerClient:
    until = time.monotonic() + PATIENCE_S
    while True:
        assert process.poll() is None, f"the viewer ended with {process.returncode}"
        try:
            return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        except (ConnectionError, RuntimeError, ValueError):
            assert time.monotonic() < until, "the viewer does not answer"
            time.sleep(0.2)
