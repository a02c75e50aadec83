"""Starting the viewer: its command, its addresses, what goes wrong."""

import subprocess
import sys
from pathlib import Path

import pytest

from recorder.errors import PomologError
from viewer.open import free_ports, open_viewer


class Started:
    """Stands for the viewer's process."""

    def __init__(self, code: int = 0) -> None:
        self.code = code
        self.commands: list[list[str]] = []

    def __call__(self, command: list[str], **_: object) -> "Started":
        self.commands.append(command)
        return self

    def wait(self) -> int:
        return self.code

    def terminate(self) -> None:
        pass


@pytest.fixture
def without_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")


def started(monkeypatch: pytest.MonkeyPatch, code: int = 0) -> Started:
    viewer = Started(code)
    monkeypatch.setattr(subprocess, "Popen", viewer)
    return viewer


def after(command: list[str], option: str) -> str:
    return command[command.index(option) + 1]


@pytest.mark.usefixtures("without_screen")
def test_without_a_screen_the_viewer_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer = started(monkeypatch)
    with pytest.raises(PomologError, match=r"no screen here .* --web"):
        open_viewer([tmp_path / "trace.rrd"])
    assert viewer.commands == []


@pytest.mark.usefixtures("without_screen")
def test_the_web_viewer_needs_no_screen_and_serves_this_machine_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer, said = started(monkeypatch), list[str]()
    open_viewer([tmp_path / "trace.rrd"], web=True, say=said.append)
    (command,) = viewer.commands
    assert Path(command[0]).is_file()
    assert after(command, "--bind") == "127.0.0.1"
    assert "--serve-web" in command
    assert command[-1] == str(tmp_path / "trace.rrd")
    page, data = after(command, "--web-viewer-port"), after(command, "--port")
    address = f"http://127.0.0.1:{page}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy"
    assert said == [f"open in a browser (Ctrl-C ends it): {address}"]


def test_other_machines_are_served_where_somebody_asks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer, said = started(monkeypatch), list[str]()
    open_viewer([tmp_path / "trace.rrd"], web=True, bind="0.0.0.0", say=said.append)
    assert after(viewer.commands[0], "--bind") == "0.0.0.0"
    assert "127.0.0.1" not in said[0]


def test_the_native_viewer_gets_every_file_and_its_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    viewer = started(monkeypatch)
    open_viewer([tmp_path / "a.rrd", tmp_path / "a.rbl"], memory="2GB")
    (command,) = viewer.commands
    assert command[-2:] == [str(tmp_path / "a.rrd"), str(tmp_path / "a.rbl")]
    assert after(command, "--memory-limit") == "2GB"
    assert after(command, "--bind") == "127.0.0.1"


def test_a_viewer_that_fails_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    started(monkeypatch, code=3)
    with pytest.raises(PomologError, match="exit code 3"):
        open_viewer([tmp_path / "trace.rrd"])


def test_free_ports_differ() -> None:
    assert len(set(free_ports(3))) == 3
