"""The commands view and demo."""

from pathlib import Path

import pytest

import viewer.cli
from tests.scenes import apple, stereo_session
from tests.test_processor_cli import Command, assert_one_line


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return Command(monkeypatch, capsys)


def test_view_of_nothing_is_one_line(command: Command, tmp_path: Path) -> None:
    nothing = command("view", tmp_path, "--save", tmp_path / "a.rrd")
    assert_one_line(nothing, "no results in", "pomolog replay")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--kind", "silly", "--worst", 3), "silly?"),
        (("--kind", "range"), "add --worst"),
        (("--tab", "Fruit"), "Overview"),
    ],
)
def test_view_explains_words_it_does_not_know(
    words: tuple[object, ...], said: str, command: Command, tmp_path: Path
) -> None:
    answer = command("view", tmp_path, *words)
    assert answer.code == 2
    assert said in answer.err


def test_view_saves_the_worst_cases_for_somebody_else(command: Command, tmp_path: Path) -> None:
    frames = [[apple(1, z_m=2.0, seen=1.0)]]  # too far for the paper's window of radii
    session = stereo_session(tmp_path / "row.mcap", frames)
    assert command("replay", session, "-o", tmp_path / "out", "--workers", 1).code == 0
    saved = tmp_path / "worst.rrd"
    answer = command("view", tmp_path / "out", "--worst", 5, "--save", saved)
    assert answer.code == 0, answer.err
    assert f"{saved}: " in answer.out
    assert saved.stat().st_size > 10_000


def test_view_without_a_screen_is_one_line(command: Command, tmp_path: Path) -> None:
    session = stereo_session(tmp_path / "row.mcap", [[apple(1)]])
    assert_one_line(command("view", session), "no screen", "--web")


def test_demo_replays_scores_by_lighting_and_says_how_to_look(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = stereo_session(tmp_path / "demo.mcap", [[apple(1, seen=1.0)]], lighting="front")
    monkeypatch.setattr(viewer.cli, "DEMO_SESSION", session)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    out = tmp_path / "out"
    said = command("demo", "-o", out)
    assert said.code == 0, said.err
    for words in ("front", "matches right", f"recording: {out / 'demo/trace.rrd'}", f"view {out}"):
        assert words in said.out
    assert (out / "demo/trace.rbl").is_file()


def test_a_demo_without_the_repository_draws_its_session_once(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewer.cli, "DEMO_SESSION", tmp_path / "demo.mcap")
    said = command("demo", "-o", tmp_path / "out")
    assert said.code == 0
    assert "out.mcap: drawn" in said.err
    assert "method paper on out.mcap, by lighting" in said.out
    assert (tmp_path / "out" / "out" / "trace.rrd").is_file()
    again = command("demo", "-o", tmp_path / "out")
    assert (again.code, again.err) == (0, "")


def test_the_demo_names_a_command_that_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs = tmp_path / "far" / "bin"
    programs.mkdir(parents=True)
    monkeypatch.setattr("sys.executable", str(programs / "python"))
    monkeypatch.chdir(tmp_path)
    assert viewer.cli._beside_python() == f"{programs / 'python'} -m pomolog"
    (programs / "pomolog").touch()
    (tmp_path / "far" / "elsewhere").mkdir()
    assert viewer.cli._beside_python() == "far/bin/pomolog"
    monkeypatch.chdir(programs.parent / "elsewhere")
    assert viewer.cli._beside_python() == str(programs / "pomolog")
