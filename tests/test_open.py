"""Finding what to open, and starting the viewer with it."""

import subprocess
import sys
from pathlib import Path

import pytest

from recorder.errors import PomologError
from viewer.layout import save_layout
from viewer.open import lay_out, open_viewer, recordings


def recording(path: Path) -> Path:
    """A file of that name: finding it does not read it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"RRF2")
    return path


def test_recordings_are_found_in_a_folder_and_below_it(tmp_path: Path) -> None:
    files = [recording(tmp_path / name / "trace.rrd") for name in ("b", "a")]
    assert recordings(tmp_path) == (files[1], files[0])
    assert recordings(tmp_path / "b") == (files[0],)


@pytest.mark.parametrize("name", ["row.mcap", "mine.rrd"])
def test_a_session_or_a_recording_is_opened_itself(name: str, tmp_path: Path) -> None:
    path = recording(tmp_path / name)
    assert recordings(path) == (path,)


@pytest.mark.parametrize("name", ["", "nowhere", "notes.txt"])
def test_where_nothing_can_be_opened_is_one_line(name: str, tmp_path: Path) -> None:
    if name == "notes.txt":
        recording(tmp_path / name)
    with pytest.raises(PomologError, match=r"no (recording in|session, recording)"):
        recordings(tmp_path / name)


def test_each_recording_gets_a_layout_beside_it_and_one_is_opened(tmp_path: Path) -> None:
    files = tuple(recording(tmp_path / name / "trace.rrd") for name in ("a", "b"))
    assert lay_out(files) == (*files, tmp_path / "a/trace.rbl")
    save_layout(tmp_path / "expected.rbl")
    for file in files:
        assert file.with_suffix(".rbl").stat().st_size > 1000


def test_a_session_is_opened_without_a_layout(tmp_path: Path) -> None:
    session = recording(tmp_path / "row.mcap")
    assert lay_out([session]) == (session,)
    assert list(tmp_path.iterdir()) == [session]


@pytest.fixture
def without_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")


class Started:
    """Stands for the viewer's process."""

    def __init__(self, code: int = 0) -> None:
        self.code = code
        self.commands: list[list[str]] = []

    def __call__(self, command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        self.commands.append(command)
        return subprocess.CompletedProcess(command, self.code)


@pytest.mark.usefixtures("without_screen")
def test_without_a_screen_the_viewer_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started = Started()
    monkeypatch.setattr(subprocess, "run", started)
    with pytest.raises(PomologError, match=r"no screen here .* --web"):
        open_viewer([tmp_path / "trace.rrd"])
    assert started.commands == []


@pytest.mark.usefixtures("without_screen")
def test_the_web_viewer_needs_no_screen_and_serves_this_machine_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started = Started()
    monkeypatch.setattr(subprocess, "run", started)
    open_viewer([tmp_path / "trace.rrd"], web=True)
    (command,) = started.commands
    assert command[1:] == ["--bind", "127.0.0.1", "--serve-web", str(tmp_path / "trace.rrd")]
    assert Path(command[0]).is_file()


def test_the_native_viewer_gets_every_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    started = Started()
    monkeypatch.setattr(subprocess, "run", started)
    open_viewer([tmp_path / "a.rrd", tmp_path / "a.rbl"])
    assert started.commands[0][1:] == [
        "--bind", "127.0.0.1", str(tmp_path / "a.rrd"), str(tmp_path / "a.rbl"),
    ]  # fmt: skip


def test_a_viewer_that_fails_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(subprocess, "run", Started(code=3))
    with pytest.raises(PomologError, match="exit code 3"):
        open_viewer([tmp_path / "trace.rrd"])
