"""`pomolog sweep`, from sessions to its folder; killed, it goes on."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from processor.methods import load_method
from tests.scenes import apple, stereo_session, tiny_rig
from tests.test_processor_cli import Command, assert_one_line

METHOD = """
[circles]
rounds = 30
ring_px = 1.0
min_radius_px = 5.0
max_radius_px = 20.0
"""
VARY = ("--vary", "circles.rounds=5,30", "--vary", "recognise=colour_ratio,red_minus_luma")


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return Command(monkeypatch, capsys)


def session(folder: Path, name: str = "row", pairs: int = 6, *, truth: bool = True) -> Path:
    frames = [[apple(1, -0.03 + 0.01 * i, seen=1.0)] for i in range(pairs)]
    return stereo_session(folder / f"{name}.mcap", frames, rig=tiny_rig(), truth=truth)


@pytest.fixture
def method(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(METHOD)
    return path


def test_a_sweep_is_one_table_a_report_and_a_method(
    command: Command, method: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    said = command(
        "sweep", session(tmp_path), *VARY, "-o", out, "--method", method, "--workers", 1, "--json"
    )
    assert (said.code, said.err) == (0, "")
    rows = pq.read_table(out / "sweep.parquet").to_pylist()
    assert len(rows) == 4 * 6
    assert {row["circles.rounds"] for row in rows} == {"5", "30"}
    assert [row["split"] for row in rows if row["setting"] == 0] == ["train"] * 4 + ["test"] * 2
    assert {path.name for path in out.iterdir() if not path.name.startswith(".")} == {
        "sweep.parquet", "sweep.md", "sweep.html", "effects.png", "best.toml",
    }  # fmt: skip
    best = said.json["best"]
    assert best["values"].keys() == {"circles.rounds", "recognise"}
    assert 0 <= best["train"] <= 1
    name, locator = load_method(str(out / "best.toml"))
    assert name == "best"
    assert str(locator.circles.rounds) == best["values"]["circles.rounds"]  # type: ignore[attr-defined]
    assert "data:image/png;base64," in (out / "sweep.html").read_text()
    assert said.json["split"] in (out / "sweep.md").read_text()


def test_its_rows_are_those_of_replay(command: Command, method: Path, tmp_path: Path) -> None:
    row = session(tmp_path)
    out = tmp_path / "out"
    command("sweep", row, "--vary", "circles.rounds=5,30", "-o", out, "--method", method,
            "--workers", 1, "--seed", 3)  # fmt: skip
    command("replay", row, "-o", tmp_path / "r", "--method", method, "--rrd", "none",
            "--workers", 1, "--seed", 3)  # fmt: skip
    frames = pq.read_table(tmp_path / "r/row/frames.parquet").to_pylist()
    swept = [r for r in pq.read_table(out / "sweep.parquet").to_pylist() if r["setting"] == 1]
    for name in ("pixels_tp", "pixels_fp", "fruit_tp", "fruit_fp", "fruit_fn"):
        assert [r[name] for r in swept] == [r[name] for r in frames]
    truth = pq.read_table(tmp_path / "r/row/truth.parquet").to_pylist()
    errors = [r["error_m"] for r in truth if r["error_m"] is not None]
    assert errors
    assert [e for r in swept for e in r["errors_m"]] == errors


@pytest.mark.slow
def test_two_workers_find_what_one_finds(command: Command, method: Path, tmp_path: Path) -> None:
    row = session(tmp_path, pairs=30)
    tables = []
    for workers in (1, 2):
        out = tmp_path / f"out{workers}"
        words = [row, *VARY, "-o", out, "--method", method, "--workers", workers]
        assert command("sweep", *words).code == 0
        tables.append(pq.read_table(out / "sweep.parquet").drop_columns("locate_ns"))
    assert tables[0].equals(tables[1])


# Sweeps row.mcap slowly, a pair at a time, until it is killed.
SLOW_RUN = """
import sys, time
import processor.sweep.run as module
module.SLICE_SETTINGS = 1
whole = module.EverySetting.__call__
def slowly(self, sample):
    time.sleep(0.1)
    return whole(self, sample)
module.EverySetting.__call__ = slowly
import pomolog
sys.argv[1:1] = ["sweep"]
pomolog.main()
"""


@pytest.mark.slow
def test_a_killed_sweep_goes_on_where_it_was(
    command: Command, method: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row, out = session(tmp_path, pairs=12), tmp_path / "out"
    words = [row, *VARY, "-o", out, "--method", method, "--workers", 1]
    root = Path(__file__).parent.parent
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_RUN, *map(str, words)],
        env={**os.environ, "PYTHONPATH": str(root)},
    )  # fmt: skip
    for _ in range(1200):
        kept = list(out.glob(".slices/*.json"))
        if len(kept) >= 3:
            break
        assert process.poll() is None, "it ended before it could be killed"
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (out / "sweep.parquet").exists()
    kept = list(out.glob(".slices/*.json"))
    times = {file: file.stat().st_mtime_ns for file in kept}
    assert 3 <= len(kept) < 12
    monkeypatch.setattr("processor.sweep.run.SLICE_SETTINGS", 1)
    assert command("sweep", *words).code == 0
    assert {file: file.stat().st_mtime_ns for file in kept} == times
    fresh = tmp_path / "fresh"
    assert command("sweep", *words[:5], "-o", fresh, *words[7:]).code == 0
    ours, theirs = (
        pq.read_table(o / "sweep.parquet").drop_columns("locate_ns") for o in (out, fresh)
    )
    assert ours.equals(theirs)


def test_a_worker_that_is_killed_is_one_line(
    command: Command, method: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("processor.pool._end_with_parent", os.abort)
    said = command("sweep", session(tmp_path), *VARY, "-o", tmp_path / "out", "--method", method,
                   "--workers", 2)  # fmt: skip
    assert_one_line(said, "a worker was killed", "--workers")


def test_another_grid_throws_the_old_slices_away(
    command: Command, method: Path, tmp_path: Path
) -> None:
    row, out = session(tmp_path), tmp_path / "out"
    for rounds in ("5,30", "5,10"):
        assert command("sweep", row, "--vary", f"circles.rounds={rounds}", "-o", out,
                       "--method", method, "--workers", 1).code == 0  # fmt: skip
    assert len(list(out.glob(".slices/*.json"))) == 1
    assert set(pq.read_table(out / "sweep.parquet")["circles.rounds"].to_pylist()) == {
        "5", "10", "30",  # the method's own is run too
    }  # fmt: skip


def test_train_and_test_can_be_sessions(command: Command, method: Path, tmp_path: Path) -> None:
    a, b = session(tmp_path, "a"), session(tmp_path, "b", 3)
    said = command("sweep", "--train", a, "--test", b, *VARY, "-o", tmp_path / "out",
                   "--method", method, "--workers", 1, "--json")  # fmt: skip
    assert said.json["pairs"] == {"train": 6, "test": 3}
    assert_one_line(
        command("sweep", "--train", a, *VARY, "-o", tmp_path / "out"), "both --train and --test"
    )


def test_a_sweep_without_truth_keeps_its_rows_and_says_why_it_chose_none(
    command: Command, method: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    said = command("sweep", session(tmp_path, truth=False), *VARY, "-o", out, "--method", method,
                   "--workers", 1)  # fmt: skip
    assert said.code == 0
    assert "Is there truth?" in said.out
    assert not (out / "best.toml").exists()
    assert pq.read_table(out / "sweep.parquet").num_rows == 24


def test_bad_words_are_one_line_and_write_nothing(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row, out = session(tmp_path), tmp_path / "out"
    assert_one_line(command("sweep", row, "--vary", "circles.round=5", "-o", out), "'round'")
    assert_one_line(
        command("sweep", row, *VARY, "-o", out, "--measure", "beauty"), "'beauty'", "fruit_f1"
    )
    with monkeypatch.context() as patch:
        patch.setattr("processor.sweep.sweep.MOST_ROWS", 5 * 6 - 1)
        assert_one_line(command("sweep", row, *VARY, "-o", out), "5 settings of 6 pairs")
    assert_one_line(command("sweep", tmp_path / "no.mcap", *VARY, "-o", out), "no.mcap")
    assert_one_line(command("sweep", row, tmp_path / "x" / ".." / "row.mcap", *VARY, "-o", out))
    assert command("sweep", *VARY, "-o", out).code == 2
    assert command("sweep", row, "-o", out).code == 2
    assert not out.exists()
