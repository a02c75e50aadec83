"""The layout: a file that Rerun reads, of views that show what is drawn."""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rerun.blueprint as rrb
import rerun_cli
from rerun.chunk import RrdReader

from processor.locate import Locator
from processor.replay import Replayed, replay
from processor.runs import find_runs
from processor.worst import worst_cases
from recorder.records import RangeReading
from recorder.rig import Rangefinder
from recorder.status import RecorderStatus, StreamStatus
from tests.scenes import apple, small_rig, stereo_session
from viewer.layout import TABS, layout, save_layout, session_layout
from viewer.layout_chosen import side_by_side_layout, worst_layout
from viewer.session_rrd import draw_session_file
from viewer.side_by_side import methods_of, write_side_by_side
from viewer.worst import write_worst


def views(container: Any) -> Iterator[Any]:
    for part in container.contents:
        if hasattr(part, "class_identifier"):
            yield part
        else:
            yield from views(part)


def test_rerun_reads_the_layout(tmp_path: Path) -> None:
    path = tmp_path / "trace.rbl"
    save_layout(path)
    (entry,) = RrdReader(path).blueprints()
    assert entry.application_id == "pomolog"
    binary = Path(rerun_cli.__file__).parent / "rerun"
    done = subprocess.run([binary, "rrd", "verify", path], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_every_view_shows_entities_that_a_recording_has(tmp_path: Path) -> None:
    session = recorded_session(tmp_path / "row.mcap")
    (done,) = replay([session], tmp_path, Locator())
    assert isinstance(done, Replayed)
    check(layout(), drawn_in(done.out / "trace.rrd"))


def test_every_view_of_a_session_alone_shows_entities_that_its_drawing_has(tmp_path: Path) -> None:
    session = recorded_session(tmp_path / "row.mcap")
    draw_session_file(session, tmp_path / "row.rrd")
    check(session_layout(resampled=False), drawn_in(tmp_path / "row.rrd"))


def test_every_view_of_the_worst_cases_shows_entities_that_they_have(tmp_path: Path) -> None:
    (done,) = replay([recorded_session(tmp_path / "row.mcap")], tmp_path, Locator())
    assert isinstance(done, Replayed)
    write_worst(tmp_path / "worst.rrd", worst_cases([done.out]))
    check(worst_layout(), drawn_in(tmp_path / "worst.rrd"))


def test_every_view_of_methods_side_by_side_shows_entities_that_they_have(tmp_path: Path) -> None:
    session = recorded_session(tmp_path / "row.mcap")
    for name in ("a", "b"):
        list(replay([session], tmp_path / name, Locator(), method=name))
    methods = methods_of(find_runs([tmp_path / "a", tmp_path / "b"]))
    write_side_by_side(tmp_path / "both.rrd", methods)
    check(side_by_side_layout([m.name for m in methods]), drawn_in(tmp_path / "both.rrd"))


def test_a_tab_can_be_put_in_front(tmp_path: Path) -> None:
    for number, name in enumerate(TABS):
        tabs = layout(active=name).root_container
        assert tabs.active_tab == number
        assert list(tabs.contents)[number].name == name
    save_layout(tmp_path / "match.rbl", layout(active="Match"))
    assert len(RrdReader(tmp_path / "match.rbl").blueprints()) == 1


def drawn_in(recording: Path) -> set[str]:
    return {chunk.entity_path.lstrip("/") for chunk in RrdReader(recording).store().stream()}


def check(made: rrb.Blueprint, drawn: set[str]) -> None:
    shown = list(views(made.root_container))
    assert shown
    for view in shown:
        if isinstance(view.contents, list):
            assert set(view.contents) <= drawn, view.name
        else:  # everything at or below its origin
            assert any(f"{path}/".startswith(f"{view.origin}/") for path in drawn), view.name


def recorded_session(path: Path) -> Path:
    """As a recorder leaves one: with a beam, a note, and a status that counts a loss."""
    beam = Rangefinder(small_rig().translation_m * 0, small_rig().rotation[2], 0.001)
    lossy = RecorderStatus(
        10, "recording", (StreamStatus("left", 1, dropped=2), StreamStatus("right", 1)), 1, 0, 0, 0,
        None, ("left: 9% overexposed",),
    )  # fmt: skip
    readings = [RangeReading(10, 0.36, 0.001, "ok", "0.36")]
    return stereo_session(
        path, [[apple(1, seen=1.0)]], rig=small_rig(beam), readings=readings, statuses=[lossy]
    )
