import csv
import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from processor.cli import app
from processor.export import export_results
from processor.replay import replay
from processor.results import TABLES, read_table
from processor.runs import find_runs
from recorder.errors import PomologError
from tests.scenes import TINY, apple, stereo_session, tiny_rig


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    frames = [[apple(1, 0.01 * number, seen=1.0)] for number in range(3)]
    sessions = [
        stereo_session(folder / name, frames, rig=tiny_rig(), lighting="front")
        for name in ("a.mcap", "b.mcap")
    ]
    for outcome in replay(sessions, folder / "out", TINY, rrd="none"):
        assert not isinstance(outcome, PomologError), outcome
    return folder / "out"


def values(text: str, kind: Any) -> Any:
    """A cell of CSV as Parquet has it."""
    if text == "":
        return None
    if kind == "bool":
        return text == "True"
    return {"int32": int, "int64": int, "double": float}.get(kind, str)(text)


@pytest.mark.parametrize("table", ["apples", "truth"])
def test_csv_and_json_lines_have_every_value(results: Path, tmp_path: Path, table: str) -> None:
    runs = find_runs([results])
    rows = [row for run in runs for row in read_table(run.folder, table).to_pylist()]
    assert rows
    assert export_results(runs, tmp_path / "x.csv", table) == len(rows)
    with (tmp_path / "x.csv").open(newline="") as stream:
        kinds = {field.name: str(field.type) for field in TABLES[table]}
        found = [
            {name: values(cell, kinds[name]) for name, cell in row.items()}
            for row in csv.DictReader(stream)
        ]
    assert found == rows
    export_results(runs, tmp_path / "x.jsonl", table)
    lines = (tmp_path / "x.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in lines] == rows


def test_frames_keep_their_conditions(results: Path, tmp_path: Path) -> None:
    export_results(find_runs([results]), tmp_path / "x.jsonl", "frames")
    first = json.loads((tmp_path / "x.jsonl").read_text().splitlines()[0])
    assert first["conditions"] == {"lighting": "front"}


def test_coco_detections_are_the_circles_in_the_pictures(results: Path, tmp_path: Path) -> None:
    (run,) = find_runs([results / "a"])
    count = export_results([run], tmp_path / "x.coco.json")
    found = json.loads((tmp_path / "x.coco.json").read_text())
    assert len(found) == count
    rows = read_table(run.folder, "apples").to_pylist()
    circles = [
        (2 * row["frame"] + place, row[f"{side}_x_px"], row[f"{side}_radius_px"])
        for row in rows
        for place, side in enumerate(("left", "right"))
        if row[f"{side}_x_px"] is not None
    ]
    assert circles
    for detection, (image, x, radius) in zip(found, circles, strict=True):
        left, _, width, height = detection["bbox"]
        assert detection["image_id"] == image
        assert width == height == 2 * radius
        assert left + width / 2 == pytest.approx(x + 0.5)  # COCO counts from the pixel's corner
        assert 0 <= detection["score"] <= 1


def test_what_cannot_be_exported_is_said(results: Path, tmp_path: Path) -> None:
    runs = find_runs([results])
    with pytest.raises(PomologError, match="one session, not 2"):
        export_results(runs, tmp_path / "x.coco.json")
    with pytest.raises(PomologError, match="ends in none of"):
        export_results(runs, tmp_path / "x.xlsx")
    assert not list(tmp_path.iterdir())


def test_the_command(results: Path, tmp_path: Path) -> None:
    out = tmp_path / "apples.csv"
    words = ["export", "results", str(results), "-o", str(out)]
    result = CliRunner().invoke(app, [*words, "--json"])
    assert json.loads(result.stdout)["rows"] == len(out.read_text().splitlines()) - 1
    assert CliRunner().invoke(app, [*words, "--table", "pears"]).exit_code == 2
