"""One frame of a run, located again: the same as it was, or one line that says why not."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import processor.retrace
from processor.locate import Locator
from processor.methods import METHODS
from processor.replay import Replayed, replay
from processor.retrace import locator_of, retrace, session_of
from processor.runs import Run, find_runs
from recorder.errors import PomologError
from tests.scenes import apple, located, stereo_session

FRAMES = [[apple(1, seen=1.0)], [apple(1, 0.02, z_m=0.45, seen=1.0), apple(2, -0.05, seen=1.0)]]


def run_of(tmp_path: Path, method: str = "paper", seed: int = 0) -> Run:
    session = stereo_session(tmp_path / "row.mcap", FRAMES)
    (done,) = replay(
        [session], tmp_path / "out", METHODS[method], method=method, seed=seed, rrd="none"
    )
    assert isinstance(done, Replayed)
    (run,) = find_runs([done.out])
    return run


@pytest.mark.parametrize(("method", "seed"), [("paper", 0), ("paper", 7), ("pomolog", 0)])
def test_a_frame_comes_out_as_it_was(method: str, seed: int, tmp_path: Path) -> None:
    found = retrace(run_of(tmp_path, method, seed), 1)
    assert found.pair.index == 1
    places = [(r["x_m"], r["y_m"], r["z_m"]) for r in found.apples if r["z_m"] is not None]
    assert places
    assert np.array(located(found.trace)) == pytest.approx(np.array(places))
    assert [row["apple_id"] for row in found.truth] == [1, 2]


@pytest.mark.parametrize("frame", [-1, 2, 99])
def test_a_frame_that_is_not_there_is_one_line(frame: int, tmp_path: Path) -> None:
    with pytest.raises(PomologError, match=rf"no frame {frame} .* frames 0 to 1"):
        retrace(run_of(tmp_path), frame)


def test_a_session_that_moved_is_found_where_it_is_said_to_be(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    elsewhere = tmp_path / "away" / "renamed.mcap"
    elsewhere.parent.mkdir()
    (tmp_path / "row.mcap").rename(elsewhere)
    with pytest.raises(PomologError, match=r"is not at .*row.mcap; say where .* --session FILE"):
        retrace(run, 0)
    assert retrace(run, 0, [elsewhere]).pair.index == 0
    elsewhere.rename(elsewhere.with_name("row.mcap"))
    assert retrace(run, 0, [elsewhere.parent]).pair.index == 0


def test_another_session_in_its_place_is_refused(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    other = stereo_session(tmp_path / "other.mcap", [[apple(3)]])
    with pytest.raises(PomologError, match=r"other.mcap is not the session .* changed since"):
        retrace(run, 0, [other])
    other.rename(tmp_path / "row.mcap")
    with pytest.raises(PomologError, match="replay this one again"):
        retrace(run, 0)


def test_where_it_lay_is_looked_at_besides_for_several_runs(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    other = stereo_session(tmp_path / "other.mcap", [[apple(3)]])
    assert session_of(run, [other]) == tmp_path / "row.mcap"


def test_a_method_of_its_own_is_built_as_it_was(tmp_path: Path) -> None:
    session = stereo_session(tmp_path / "row.mcap", FRAMES)
    locator = replace(Locator(), circles=replace(Locator().circles, rounds=50))  # type: ignore[type-var]
    tuple(replay([session], tmp_path / "out", locator, method="mine", rrd="none"))
    (run,) = find_runs([tmp_path / "out"])
    assert locator_of(run) == locator
    assert retrace(run, 0).apples


def test_a_model_that_learned_something_else_since_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = run_of(tmp_path, "pomolog")
    monkeypatch.setattr(processor.retrace, "models_of", lambda _: {"pomolog-1": "other"})
    with pytest.raises(PomologError, match=r"model pomolog-1 is not the one .* replay it again"):
        retrace(run, 0)


def test_results_that_this_code_does_not_give_are_refused(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    about = json.loads((run.folder / "run.json").read_text())
    about["seed"] = 99  # stands for code that draws otherwise
    (run.folder / "run.json").write_text(json.dumps(about))
    (changed,) = find_runs([run.folder])
    with pytest.raises(PomologError, match=r"frame 1 .* comes out otherwise .* again"):
        retrace(changed, 1)
