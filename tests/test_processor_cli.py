"""The commands replay and score: what they print, and how they exit."""

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import pomolog
from processor.methods import METHODS, load_method
from tests.scenes import apple, stereo_session


class Said(NamedTuple):
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


class Command:
    """`pomolog ...` in this process."""

    def __init__(self, patch: pytest.MonkeyPatch, capture: pytest.CaptureFixture[str]) -> None:
        self._patch, self._capture = patch, capture

    def __call__(self, *words: object) -> Said:
        self._patch.setattr(sys, "argv", ["pomolog", *map(str, words)])
        with pytest.raises(SystemExit) as exit_:
            pomolog.main()
        out, err = self._capture.readouterr()
        code = exit_.value.code
        return Said(code if isinstance(code, int) else 0, out, err)


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return Command(monkeypatch, capsys)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return stereo_session(
        tmp_path / "row.mcap", [[apple(1, seen=1.0)], [apple(1, 0.02, seen=1.0)]], lighting="front"
    )


def assert_one_line(said: Said, *words: str) -> None:
    assert said.code == 1
    assert said.err.startswith("pomolog: ")
    assert said.err.count("\n") == 1
    for word in words:
        assert word in said.err


def test_replay_says_what_it_did(command: Command, session: Path, tmp_path: Path) -> None:
    said = command("replay", session, "-o", tmp_path / "out", "--workers", 1)
    assert said.code == 0
    assert said.out.startswith(f"{session}: 2 pairs -> {tmp_path / 'out' / 'row'} (")
    again = command("replay", session, "-o", tmp_path / "out", "--workers", 1)
    assert "(there already)" in again.out


def test_replay_json_is_one_document_of_the_designed_form(
    command: Command, session: Path, tmp_path: Path
) -> None:
    said = command("replay", session, "-o", tmp_path / "out", "--workers", 1, "--json")
    (row,) = said.json["sessions"]
    assert said.json.keys() == {"sessions"}
    assert row.keys() == {"session", "out", "pairs", "seconds"}
    assert (row["session"], row["out"]) == (str(session), str(tmp_path / "out/row"))
    assert row["pairs"] == 2
    assert row["seconds"] > 0
    assert said.err == ""


def test_a_method_is_a_name_or_a_file(command: Command, session: Path, tmp_path: Path) -> None:
    method = tmp_path / "fast.toml"
    method.write_text("[circles]\nrounds = 20\n")
    for choice, rounds in (("paper", 400), (method, 20)):
        out = tmp_path / f"out-{rounds}"
        said = command(
            "replay", session, "-o", out, "--method", choice, "--rrd", "none", "--workers", 1
        )
        assert said.code == 0
        about = json.loads((out / "row/run.json").read_text())
        assert about["locator"]["circles"]["rounds"] == rounds
        assert not (out / "row/trace.rrd").exists()


def test_a_printed_method_is_a_file_to_start_from(command: Command, tmp_path: Path) -> None:
    listed = command("methods").out
    assert [line.split()[0] for line in listed.splitlines()] == list(METHODS)
    for name, locator in METHODS.items():
        method = tmp_path / f"{name}.toml"
        method.write_text(command("methods", name).out)
        assert load_method(str(method)) == (name, locator)
    assert_one_line(command("methods", "best"), "'best'")


@pytest.mark.parametrize("content", [b"", b"text", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(500)])
def test_what_is_no_whole_session_is_one_line(
    content: bytes, command: Command, tmp_path: Path
) -> None:
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)
    said = command("replay", path, "-o", tmp_path / "out", "--workers", 1)
    assert_one_line(said, "bad.mcap")
    assert not (tmp_path / "out/bad").exists()


def test_a_missing_session_and_an_unknown_method_are_one_line(
    command: Command, session: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert_one_line(command("replay", tmp_path / "no.mcap", "-o", out, "--workers", 1), "no.mcap")
    assert_one_line(command("replay", session, "-o", out, "--method", "best"), "'best'")
    assert not out.exists()


def test_good_sessions_are_done_beside_a_bad_one_and_the_exit_says_so(
    command: Command, session: Path, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(b"text")
    said = command("replay", bad, session, "-o", tmp_path / "out", "--workers", 1, "--json")
    assert_one_line(said, "bad.mcap")
    assert [row["session"] for row in said.json["sessions"]] == [str(session)]


@pytest.mark.parametrize(
    "words",
    [
        ("replay",),
        ("replay", "S.mcap"),
        ("replay", "S.mcap", "-o", "out", "--workers", "-1"),
        ("replay", "S.mcap", "-o", "out", "--rrd", "some"),
        ("replay", "S.mcap", "-o", "out", "--nonsense"),
        ("score", "--by"),
    ],
)
def test_wrong_usage_exits_with_2(
    words: tuple[str, ...], command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command(*words).code == 2
    assert list(tmp_path.iterdir()) == []


RATES = {"tp", "fp", "fn", "precision", "recall", "f1"}
FORM = {
    "pixels": RATES | {"hit", "false_positive", "false_negative", "iou"},
    "pixels_cleaned": RATES | {"hit", "false_positive", "false_negative", "iou"},
    "fruit": RATES,
    "matches": {"right", "wrong", "missed", "rate", "wilson95", "found"},
    "distance_m": {"n", "bias", "rmse", "p95", "max"},
}


def test_score_json_has_the_designed_form(command: Command, session: Path, tmp_path: Path) -> None:
    command("replay", session, "-o", tmp_path / "out", "--rrd", "none", "--workers", 1)
    said = command("score", tmp_path / "out", "--by", "lighting", "--json")
    assert said.code == 0
    assert said.err == ""
    assert said.json.keys() == {"groups", "ledger"}
    assert said.json["ledger"] is None  # nobody recorded it
    assert list(said.json["groups"]) == ["all", "lighting=front"]
    for group in said.json["groups"].values():
        assert group["frames"] == 2
        for measure, keys in FORM.items():
            assert keys <= group[measure].keys(), measure
        assert group["matches"]["right"] == 2
        assert len(group["matches"]["wilson95"]) == 2
        assert set(group["time_ms"]) == {
            "decode", "rectify", "recognise", "clean", "circles", "match", "triangulate",
        }  # fmt: skip


def test_score_without_truth_says_null_in_json_and_not_scored_to_people(
    command: Command, tmp_path: Path
) -> None:
    bare = stereo_session(tmp_path / "bare.mcap", [[apple(1)]], truth=False)
    command("replay", bare, "-o", tmp_path / "out", "--rrd", "none", "--workers", 1)
    group = command("score", tmp_path / "out", "--json").json["groups"]["all"]
    assert group["frames"] == 1
    assert {measure: group[measure] for measure in FORM} == dict.fromkeys(FORM)
    assert "not scored" in command("score", tmp_path / "out").out


def test_score_of_nothing_is_one_line(command: Command, tmp_path: Path) -> None:
    assert_one_line(command("score", tmp_path), "no results in")


def test_score_by_what_nobody_said_is_one_line(
    command: Command, session: Path, tmp_path: Path
) -> None:
    command("replay", session, "-o", tmp_path / "out", "--rrd", "none", "--workers", 1)
    assert_one_line(command("score", tmp_path / "out", "--by", "weather"), "weather", "lighting")


def test_methods_that_are_summed_are_said_and_can_be_kept_apart(
    command: Command, session: Path, tmp_path: Path
) -> None:
    outs = [tmp_path / method for method in ("paper", "area-only")]
    for out in outs:
        command("replay", session, "-o", out, "--method", out.name, "--rrd", "none")
    summed = command("score", *outs)
    assert summed.code == 0
    assert summed.err == "pomolog: warning: area-only, paper are summed; apart: --by method\n"
    apart = command("score", *outs, "--by", "method")
    assert apart.err == ""
    assert apart.out.split()[:2] == ["paper", "area-only"]
    assert command("score", outs[0]).err == ""
