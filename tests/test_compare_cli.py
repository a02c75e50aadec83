"""`pomolog compare`, from results to report, JSON, JUnit and exit."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pyarrow.parquet as pq
import pytest

from processor.circles import RandomRing
from processor.replay import Replayed, replay
from processor.results import read_table, write_tables
from tests.scenes import TINY, apple, stereo_session, tiny_rig
from tests.test_processor_cli import Command, assert_one_line

PAIRS = 12
Row = dict[str, Any]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return Command(monkeypatch, capsys)


def replayed(folder: Path, out: str, *names: str, seed: int = 0, truth: bool = True) -> Path:
    """Results of sessions of two apples a pair, no two pairs alike."""
    frames = [
        [apple(1, -0.06 + 0.002 * i, seen=1.0), apple(2, 0.06, 0.001 * i, 0.5, seen=1.0)]
        for i in range(PAIRS)
    ]
    sessions = [
        stereo_session(folder / f"{name}.mcap", frames, rig=tiny_rig(), truth=truth)
        for name in names or ("row",)
    ]
    rougher = replace(
        TINY, circles=RandomRing(rounds=12, ring_px=1.0, min_radius_px=5, max_radius_px=20)
    )
    for done in replay(sessions, folder / out, rougher, method="mine", seed=seed, rrd="none"):
        assert isinstance(done, Replayed), done
    return folder / out


def edited(results: Path, name: str, table: str, change: Callable[[Row], Row | None]) -> Path:
    """A copy of one session's results with every row of a table changed, or dropped."""
    out = results.with_name(name)
    shutil.copytree(results, out)
    rows = {n: read_table(out / "row", n).to_pylist() for n in ("apples", "frames", "truth")}
    rows[table] = [row for row in map(change, rows[table]) if row is not None]
    write_tables(out / "row", rows)
    about = json.loads((out / "row/run.json").read_text())
    (out / "row/run.json").write_text(json.dumps({**about, "method": name, "seed": 77}))
    return out


def longer(row: Row) -> Row:
    """2 mm further away."""
    return row | {"error_m": None if row["error_m"] is None else row["error_m"] + 0.002}


def test_a_run_against_itself_shows_no_difference(command: Command, tmp_path: Path) -> None:
    out = replayed(tmp_path, "a")
    said = command("compare", out, out, "--json")
    assert said.code == 0
    assert said.json["same_run"]
    assert said.json["pairs"] == PAIRS
    verdicts = {one["verdict"] for one in said.json["measures"].values()}
    assert verdicts == {"no difference shown"}
    assert said.json["fruit"]["gained"] == said.json["fruit"]["lost"] == 0
    frames = read_table(out / "row", "frames").to_pylist()
    false = sum(row["fruit_fp"] for row in frames)
    assert said.json["false_circles"] == {"a": false, "b": false}
    assert "the same run" in command("compare", out, out).out


def test_a_change_of_the_code_that_changes_no_result_passes_a_gate(
    command: Command, tmp_path: Path
) -> None:
    out, gate = replayed(tmp_path, "a"), tmp_path / "gate.toml"
    gate.write_text("[fruit_recall]\nnot_worse_by = 0.001\n[distance_rmse_mm]\nnot_worse_by = 0")
    said = command("compare", out, edited(out, "tidied", "truth", dict), "--gate", gate, "--json")
    assert said.code == 0
    assert not said.json["same_run"]
    assert {one["verdict"] for one in said.json["measures"].values()} == {"no difference shown"}
    assert any("in every picture" in note for note in said.json["notes"])


def test_another_seed_of_one_method_is_no_better_and_no_worse(
    command: Command, tmp_path: Path
) -> None:
    runs = [replayed(tmp_path, f"seed{seed}", seed=seed) for seed in range(4)]
    said = command("compare", f"{runs[0]},{runs[1]}", f"{runs[2]},{runs[3]}", "--json")
    assert {one["verdict"] for one in said.json["measures"].values()} <= {
        "no difference shown", "too little data", "not scored",
    }  # fmt: skip
    assert said.json["a"]["seeds"] == [0, 1]
    rmse = said.json["measures"]["distance_rmse_mm"]
    assert all(std > 0 for std in rmse["seed_std"])
    assert said.json["fruit_by_seed"]["both"] > 0
    alone = command("compare", runs[0], runs[2], "--json").json
    assert alone["measures"]["distance_rmse_mm"]["seed_std"] == [None, None]
    assert any("One run a side" in note for note in alone["notes"])


def test_a_bias_of_2_mm_is_found(command: Command, tmp_path: Path) -> None:
    out = replayed(tmp_path, "a")
    said = command("compare", out, edited(out, "biased", "truth", longer), "--json")
    bias = said.json["measures"]["distance_bias_mm"]
    assert bias["verdict"] in ("worse", "better", "differs")
    assert bias["change"] == pytest.approx(2)
    assert bias["interval95"] == pytest.approx([2, 2])
    assert bias["size"] == "more than matters"


def test_lost_fruit_are_found_and_listed(command: Command, tmp_path: Path) -> None:
    out = replayed(tmp_path, "a")

    def losing(row: Row) -> Row:
        gone = {"found_left": False, "found_right": False, "match": "missed", "error_m": None}
        return row | gone if row["apple_id"] == 2 and row["frame"] % 3 else row

    listed = tmp_path / "fruit.parquet"
    said = command("compare", out, edited(out, "lossy", "truth", losing), "--fruit", listed)
    assert said.code == 0
    assert "worse" in said.out
    rows = pq.read_table(listed).to_pylist()
    assert {(row["what"], row["apple"]) for row in rows} == {("lost", 2)}
    assert len(rows) == 8
    assert f"{len(rows)} lost" in said.out


def test_without_truth_fruit_are_paired_by_each_other(command: Command, tmp_path: Path) -> None:
    runs = [replayed(tmp_path, f"seed{seed}", seed=seed, truth=False) for seed in range(2)]
    said = command("compare", *runs, "--json")
    assert set(said.json["measures"]) == {
        "fruit_per_pair", "located_per_pair", "distance_mean_mm",
    }  # fmt: skip
    assert said.json["fruit"]["both"] > PAIRS
    assert said.json["fruit"]["seen_gained"] is None
    assert any("no truth" in note for note in said.json["notes"])


def test_a_gate_fails_with_a_line_for_each_limit(command: Command, tmp_path: Path) -> None:
    out = replayed(tmp_path, "a")
    gate, junit = tmp_path / "gate.toml", tmp_path / "junit.xml"
    gate.write_text(
        "[distance_bias_mm]\nnot_worse_by = 0.5\n[fruit_recall]\nmin = 0.9\nmax = 0.0\n"
    )
    biased = edited(out, "biased", "truth", longer)
    said = command("compare", out, biased, "--gate", gate, "--junit", junit)
    assert said.code == 1
    lines = said.err.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("pomolog: gate: ") for line in lines)
    assert "distance_bias_mm" in lines[0]
    suite = ET.fromstring(junit.read_text())  # our own file
    assert (suite.tag, suite.get("tests"), suite.get("failures")) == ("testsuite", "3", "2")
    cases = {case.get("name"): [part.tag for part in case] for case in suite}
    assert cases == {
        "distance_bias_mm.not_worse_by": ["failure"], "fruit_recall.min": [],
        "fruit_recall.max": ["failure"],
    }  # fmt: skip


def test_a_gate_that_holds_exits_with_0(command: Command, tmp_path: Path) -> None:
    out = replayed(tmp_path, "a")
    gate = tmp_path / "gate.toml"
    gate.write_text("[fruit_recall]\nmin = 0.5\nnot_worse_by = 0.01\n[time_ms]\nmax = 1e6\n")
    said = command("compare", out, out, "--gate", gate, "--json")
    assert (said.code, said.err) == (0, "")
    assert said.json["gate"]["passed"]
    assert [rule["rule"] for rule in said.json["gate"]["rules"]] == [
        "fruit_recall.min", "fruit_recall.not_worse_by", "time_ms.max",
    ]  # fmt: skip


def test_without_a_gate_junit_has_a_case_a_measure(command: Command, tmp_path: Path) -> None:
    out, junit = replayed(tmp_path, "a"), tmp_path / "junit.xml"
    assert command("compare", out, out, "--junit", junit).code == 0
    suite = ET.fromstring(junit.read_text())
    assert [case.get("name") for case in suite][:2] == ["pixels_f1", "fruit_precision"]


def test_the_report_is_written_as_it_is_printed(command: Command, tmp_path: Path) -> None:
    out, report = replayed(tmp_path, "a"), tmp_path / "new/compare.md"
    said = command("compare", out, out, "--markdown", report)
    assert report.read_text().strip() == said.out.strip()
    widths = {len(line) for line in said.out.splitlines() if line.startswith("|")}
    assert len(widths) == 1


def test_sessions_of_one_side_alone_are_left_out_and_said(command: Command, tmp_path: Path) -> None:
    a = replayed(tmp_path, "a", "row", "old")
    b = replayed(tmp_path, "b", "row", "new", seed=1)
    said = command("compare", a, b, "--json")
    assert said.json["sessions"] == ["row"]
    assert set(said.json["left_out"]) == {"old", "new"}
    assert any("Left out" in note for note in said.json["notes"])
    assert said.json["pairs"] == PAIRS


def test_no_session_in_common_is_one_line(command: Command, tmp_path: Path) -> None:
    a, b = replayed(tmp_path, "a", "old"), replayed(tmp_path, "b", "new")
    assert_one_line(command("compare", a, b), "no session is on both sides", "old", "new")


def test_another_recording_of_the_same_name_is_one_line(command: Command, tmp_path: Path) -> None:
    a = replayed(tmp_path, "a")
    b = replayed(tmp_path, "b", truth=False)
    assert_one_line(command("compare", a, b), "row", "not the same recording", "other truth")


def test_repeats_must_be_of_one_method_and_of_other_seeds(command: Command, tmp_path: Path) -> None:
    a, same = replayed(tmp_path, "a"), replayed(tmp_path, "same")
    assert_one_line(command("compare", f"{a},{same}", a), "seed 0", "--seed")
    other = edited(a, "other", "truth", longer)
    path = other / "row/run.json"
    about = json.loads(path.read_text())
    about["locator"]["circles"]["rounds"] = 7
    path.write_text(json.dumps(about))
    assert_one_line(command("compare", f"{a},{other}", a), "other parameters")


def test_what_differs_between_the_methods_is_said(command: Command, tmp_path: Path) -> None:
    a = replayed(tmp_path, "a")
    other = edited(a, "other", "truth", longer)
    path = other / "row/run.json"
    about = json.loads(path.read_text())
    about["locator"]["circles"]["rounds"] = 7
    path.write_text(json.dumps(about))
    assert "circles.rounds: 12 -> 7" in command("compare", a, other).out


def test_results_that_do_not_fit_together_are_one_line(command: Command, tmp_path: Path) -> None:
    a = replayed(tmp_path, "a")
    short = edited(a, "short", "frames", lambda row: row if row["frame"] else None)
    assert_one_line(command("compare", a, short), "row", "replay it again")
    (short / "row/truth.parquet").write_bytes(b"PAR1")
    assert_one_line(command("compare", a, short), "truth.parquet")


@pytest.mark.parametrize("text", ["{}", '{"name": "row"}', '{"name": "row", "metadata": {}}'])
def test_a_description_without_what_compare_needs_is_one_line(
    text: str, command: Command, tmp_path: Path
) -> None:
    a = replayed(tmp_path, "a")
    path = a / "row/run.json"
    about = json.loads(path.read_text())
    path.write_text(json.dumps({**about, "session": json.loads(text)}))
    assert_one_line(command("compare", a, a), "run.json is damaged")
    path.write_text(json.dumps({**about, "locator": {"circles": 5}}))
    assert_one_line(command("compare", a, a), "run.json is damaged")


def test_wrong_usage_of_compare_exits_with_2(command: Command, tmp_path: Path) -> None:
    assert command("compare", tmp_path).code == 2
    assert command("compare", tmp_path, tmp_path, "--unit", "tree").code == 2
    assert_one_line(command("compare", tmp_path, tmp_path), "no results in")
    assert_one_line(command("compare", ",", tmp_path), "A names no folder")
