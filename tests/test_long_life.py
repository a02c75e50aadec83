"""Long life: files of the first profiles are read for ever, and those of later ones say what to do.

`tests/old` was written once, by the first pomolog of these profiles; it is never made again.
"""

import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

import pomolog
from processor.replay import Replayed, replay
from processor.results import LATER, TABLES, read_table
from processor.run_file import read_run
from processor.runs import find_runs, score_runs
from recorder.check import check
from recorder.errors import NewerProfileError
from recorder.metadata import CRC, with_crc
from recorder.salvage import salvage
from recorder.session import Session
from tests.scenes import TINY

OLD = Path(__file__).parent / "old"
SESSION = OLD / "row.mcap"
RESULTS = OLD / "results"


def newer_session(folder: Path) -> Path:
    """The old session as a pomolog of profile 2 might write it, with checksums of its own."""
    with Session(SESSION) as session:
        old, new = session.metadata, {**session.metadata, "profile": "pomolog/2"}
    data = SESSION.read_bytes().replace(b"pomolog/1", b"pomolog/2")
    copy = folder / "newer.mcap"
    copy.write_bytes(data.replace(with_crc(old)[CRC].encode(), with_crc(new)[CRC].encode()))
    return copy


def newer_results(folder: Path) -> Path:
    out = folder / "results"
    shutil.copytree(RESULTS, out)
    about = json.loads((out / "row" / "run.json").read_text())
    (out / "row" / "run.json").write_text(json.dumps({**about, "profile": "pomolog-results/2"}))
    return out


def said(words: Sequence[object], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["pomolog", *map(str, words)])
    with pytest.raises(SystemExit) as exit_:
        pomolog.main()
    return exit_.value.code if isinstance(exit_.value.code, int) else 0


def test_a_session_of_the_first_profile_says_what_it_always_said() -> None:
    assert all(finding.level != "failure" for finding in check(SESSION))
    with Session(SESSION) as session:
        pairs = list(session.pairs())
        assert session.rig.baseline_m == pytest.approx(0.08)
        assert session.rig.rangefinder is not None
        assert session.fingerprint == "bb6c33d7ff6d9e17"
    assert [pair.time_ns for pair in pairs] == [0, 10**9, 2 * 10**9, 3 * 10**9]
    assert [pair.conditions["lighting"] for pair in pairs] == ["front", "front", "back", "back"]
    assert [reading.range_m for pair in pairs for reading in pair.readings] == pytest.approx(
        [0.3605, 0.3615, 0.3625, 0.3635]
    )
    truth = pairs[3].truth
    assert truth is not None
    assert truth.left is not None
    assert truth.apples is not None
    assert [(apple.id, apple.left_visible) for apple in truth.apples] == [(1, 1.0), (2, 0.75)]
    assert sorted(set(truth.left.ravel().tolist())) == [0, 1, 2]


def test_a_session_of_the_first_profile_is_replayed(tmp_path: Path) -> None:
    (done,) = replay([SESSION], tmp_path, TINY, rrd="none")
    assert isinstance(done, Replayed), done
    score = score_runs(find_runs([tmp_path]))["all"]
    assert score.frames == 4
    assert score.pixels is not None
    assert score.pixels.hit == 1.0  # drawn in one red; no method may lose that


def test_results_of_the_first_profile_are_scored_as_they_were() -> None:
    groups = score_runs(find_runs([RESULTS]), "lighting")
    assert {name: group.frames for name, group in groups.items()} == {
        "all": 4, "lighting=front": 2, "lighting=back": 2,
    }  # fmt: skip
    fruit, pixels = groups["all"].fruit, groups["all"].pixels
    assert fruit is not None
    assert pixels is not None
    assert (fruit.tp, fruit.fp, fruit.fn) == (8, 0, 8)
    assert (pixels.tp, pixels.fp, pixels.fn) == (3473, 0, 0)


@pytest.mark.parametrize("name", TABLES)
def test_columns_that_came_later_are_null_in_old_results(name: str) -> None:
    table = read_table(RESULTS / "row", name)
    assert table.schema.equals(TABLES[name])  # a new column must be named in results.LATER
    assert all(table[later].null_count == len(table) for later in LATER[name])


def test_what_run_json_says_is_kept_though_nobody_knows_it_any_more(tmp_path: Path) -> None:
    about = read_run(RESULTS / "row" / "run.json")
    path = tmp_path / "run.json"
    path.write_text(json.dumps({**about, "weather": "fine"}))
    assert read_run(path)["weather"] == "fine"


@pytest.mark.parametrize(
    "words",
    [("info",), ("check",), ("replay", "-o", "OUT"), ("view", "--web"), ("salvage", "-o", "OUT/s")],
    ids=lambda words: words[0],
)
def test_a_newer_session_says_what_to_update(
    words: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    command, *rest = words
    out = [word.replace("OUT", str(tmp_path / "out")) for word in rest]
    assert said([command, newer_session(tmp_path), *out], monkeypatch) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "has profile pomolog/2, newer than this pomolog's pomolog/1; update pomolog" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["score", "view", "compare"])
def test_newer_results_say_what_to_update(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = newer_results(tmp_path)
    (out / "row" / "trace.rrd").write_bytes(b"a recording")
    words = {"compare": ["compare", RESULTS, out], "view": ["view", out, "--web"]}
    assert said(words.get(command, [command, out]), monkeypatch) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "has profile pomolog-results/2, newer than" in line
    assert "update pomolog" in line


def test_newer_results_are_not_taken_for_done(tmp_path: Path) -> None:
    out = newer_results(tmp_path)
    (done,) = replay([SESSION], out, TINY, rrd="none")
    assert isinstance(done, Replayed), done
    assert not done.resumed
    assert read_run(out / "row" / "run.json")["profile"] == "pomolog-results/1"


def test_a_newer_profile_is_told_though_its_checksum_is_one_of_its_own(tmp_path: Path) -> None:
    copy = tmp_path / "newer.mcap"
    copy.write_bytes(SESSION.read_bytes().replace(b"pomolog/1", b"pomolog/2"))
    with pytest.raises(NewerProfileError):
        Session(copy)


def test_a_newer_session_that_is_torn_says_so_to_salvage(tmp_path: Path) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(newer_session(tmp_path).read_bytes()[:-300])
    with pytest.raises(NewerProfileError):
        salvage(torn, tmp_path / "whole.mcap")
