"""The layout: a file that Rerun reads, of views that show what is drawn."""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rerun_cli
from rerun.chunk import RrdReader

from processor.locate import Locator
from processor.replay import Replayed, replay
from recorder.rig import Rangefinder
from tests.scenes import apple, small_rig, stereo_session
from viewer.layout import layout, save_layout


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
    beam = Rangefinder(small_rig().translation_m * 0, small_rig().rotation[2], 0.001)
    session = stereo_session(tmp_path / "row.mcap", [[apple(1, seen=1.0)]], rig=small_rig(beam))
    (done,) = replay([session], tmp_path, Locator())
    assert isinstance(done, Replayed)
    chunks = RrdReader(done.out / "trace.rrd").store().stream()
    drawn = {chunk.entity_path.lstrip("/") for chunk in chunks}
    shown = list(views(layout().root_container))
    assert shown
    for view in shown:
        if isinstance(view.contents, list):
            assert set(view.contents) <= drawn, view.name
        else:  # everything at or below its origin
            assert any(f"{path}/".startswith(f"{view.origin}/") for path in drawn), view.name
