"""Results found, read and put into groups."""

import json
from pathlib import Path

import pytest

from processor.locate import Locator
from processor.replay import Replayed, replay
from processor.runs import find_runs, losses, score_runs
from recorder.errors import PomologError
from tests.scenes import apple, stereo_session


def replayed(folder: Path, **lightings: str) -> Path:
    """Results of a session of two drawn pairs for each name and lighting; "" says none."""
    sessions = [
        stereo_session(
            folder / f"{name}.mcap", [[apple(1, 0.01 * i, seen=1.0)] for i in (0, 1)],
            lighting=lighting,
        )
        for name, lighting in lightings.items()
    ]  # fmt: skip
    for done in replay(sessions, folder / "out", Locator(), rrd="none"):
        assert isinstance(done, Replayed), done
    return folder / "out"


def test_runs_are_found_in_a_folder_below_it_and_named_themselves(tmp_path: Path) -> None:
    out = replayed(tmp_path, a="front", b="back")
    assert [run.folder.name for run in find_runs([out])] == ["a", "b"]
    assert [run.folder.name for run in find_runs([out / "b"])] == ["b"]


def test_results_named_twice_count_once(tmp_path: Path) -> None:
    out = replayed(tmp_path, a="front", b="back")
    assert score_runs(find_runs([out, out / "a", out]))["all"].frames == 4


def test_a_group_has_its_conditions_frames_and_all_has_every_one(tmp_path: Path) -> None:
    groups = score_runs(find_runs([replayed(tmp_path, a="front", b="back", c="")]), "lighting")
    assert {name: score.frames for name, score in groups.items()} == {
        "all": 6, "lighting=front": 2, "lighting=back": 2,
    }  # fmt: skip
    for name, score in groups.items():
        assert score.matches is not None, name
        assert score.matches.right == score.frames
        assert score.distance_m is not None
        assert score.distance_m.n == score.frames


def test_counts_of_groups_add_up_to_all(tmp_path: Path) -> None:
    groups = score_runs(find_runs([replayed(tmp_path, a="front", b="back")]), "lighting")
    pixels = {name: score.pixels for name, score in groups.items()}
    parts = [p for name, p in pixels.items() if name != "all" and p is not None]
    assert pixels["all"] is not None
    assert pixels["all"].tp == sum(p.tp for p in parts) > 0


def test_a_condition_that_no_session_has_is_told_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match=r"no session says its colour; they say .*lighting"):
        score_runs(find_runs([replayed(tmp_path, a="front")]), "colour")


def test_a_folder_without_results_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match="no results in"):
        find_runs([tmp_path])


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"profile": "pomolog-results/1"}', "null"])
def test_a_damaged_description_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(PomologError, match=r"run\.json is damaged"):
        find_runs([tmp_path])


def test_results_of_another_version_are_told_from_damage(tmp_path: Path) -> None:
    about = {"profile": "pomolog-results/9", "session": {"metadata": {}}}
    (tmp_path / "run.json").write_text(json.dumps(about))
    with pytest.raises(PomologError, match="pomolog-results/9"):
        find_runs([tmp_path])


def test_what_recorders_lost_is_summed_over_streams_and_sessions(tmp_path: Path) -> None:
    out = replayed(tmp_path, a="front", b="back")
    assert losses(find_runs([out])) is None  # nobody kept a ledger
    for name, ledger in (
        ("a", {"left.dropped": "2", "right.dropped": "1", "left.frames": "90", "pairs": "88"}),
        ("b", {"right.unpaired": "4", "rangefinder.reopened": "1", "ended": "by the operator"}),
    ):
        path = out / name / "run.json"
        about = json.loads(path.read_text())
        about["session"]["ledger"] = ledger
        path.write_text(json.dumps(about))
    found = losses(find_runs([out]))
    assert found is not None
    assert {what: n for what, n in found.items() if n} == {
        "dropped": 3, "unpaired": 4, "reopened": 1,
    }  # fmt: skip


def test_methods_are_a_group_like_any_condition(tmp_path: Path) -> None:
    out = replayed(tmp_path, a="front")
    for done in replay([tmp_path / "a.mcap"], tmp_path / "mine", Locator(), method="mine"):
        assert isinstance(done, Replayed), done
    groups = score_runs(find_runs([out, tmp_path / "mine"]), "method")
    assert {name: score.frames for name, score in groups.items()} == {
        "all": 4, "method=paper": 2, "method=mine": 2,
    }  # fmt: skip
