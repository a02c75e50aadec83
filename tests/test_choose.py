"""What `pomolog view` opens: found or made, at the frame asked for, or refused in one line."""

from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from processor.replay import Replayed, replay
from recorder.errors import PomologError
from recorder.records import Note
from recorder.session_writer import SessionWriter
from tests.scenes import TINY, apple, stereo_session, tiny_rig
from viewer.choose import Opening, Wish, choose, save

FRAMES = [[apple(1, seen=1.0)], [apple(2, 0.02, seen=1.0)], [apple(3, z_m=2.0, seen=1.0)]]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two methods on one session of three pairs, the third with an apple too small to find."""
    folder = tmp_path_factory.mktemp("results")
    session = stereo_session(folder / "row.mcap", FRAMES, rig=tiny_rig())
    for method, locator in (("one", TINY), ("two", TINY)):
        (done,) = replay([session], folder / method, locator, method=method)
        assert isinstance(done, Replayed)
    return folder


def entities(recording: Path) -> dict[str, list[Any]]:
    """Each entity's timelines."""
    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(recording).store().stream():
        found.setdefault(chunk.entity_path.lstrip("/"), []).extend(chunk.timeline_names)
    return found


def chosen(tmp_path: Path, *paths: Path, **wish: Any) -> Opening:
    return choose(paths, Wish(**wish), tmp_path)


def test_results_are_opened_whole_with_a_layout_beside_them(results: Path, tmp_path: Path) -> None:
    opening = chosen(tmp_path, results / "one")
    recording = results / "one/row/trace.rrd"
    assert opening == Opening((tmp_path / "layout.rbl", recording))
    assert recording.with_suffix(".rbl").stat().st_size > 1000


@pytest.mark.parametrize(
    ("names", "wish"), [(("one",), {}), (("one",), {"worst": 2}), (("one", "two"), {})]
)
def test_the_layout_is_read_before_any_recording(
    names: tuple[str, ...], wish: dict[str, Any], results: Path, tmp_path: Path
) -> None:
    """The other way round the viewer keeps its own views, on a busy machine one time in five."""
    files = chosen(tmp_path, *(results / name for name in names), **wish).files
    assert [file.suffix for file in files] == [".rbl", *[".rrd"] * (len(files) - 1)]


@pytest.mark.parametrize(("wish", "frame"), [({"frame": 2}, 2), ({"time_s": 1.2}, 1)])
def test_a_frame_is_asked_for_by_number_or_by_time(
    wish: dict[str, Any], frame: int, results: Path, tmp_path: Path
) -> None:
    assert chosen(tmp_path, results / "one", **wish).frame == frame


def test_the_worst_cases_are_steps_of_a_recording_of_their_own(
    results: Path, tmp_path: Path
) -> None:
    opening = chosen(tmp_path, results / "one", worst=2)
    found = entities(opening.files[-1])
    assert found["worst/list"] == []  # static
    for entity in ("worst/case", "worst/left/picture", "world/left/picture", "world/right/worst"):
        assert set(found[entity]) == {"worst"}, entity


def test_a_true_apples_cases_are_all_of_it(results: Path, tmp_path: Path) -> None:
    opening = chosen(tmp_path, results / "one", apple=3)
    texts = [
        str(batch.column("TextDocument:text").to_pylist())
        for chunk in RrdReader(opening.files[-1]).store().stream()
        if chunk.entity_path == "/worst/case"
        for batch in [chunk.to_record_batch()]
    ]
    assert len(texts) == 1
    assert "missed: true apple 3" in texts[0]


def test_two_methods_stand_side_by_side_in_one_recording(results: Path, tmp_path: Path) -> None:
    opening = chosen(tmp_path, results / "one", results / "two", frame=1)
    found = entities(opening.files[-1])
    assert opening.frame == 1
    for entity in ("world/left/one/fruit", "world/left/two/fruit", "world/one/apples"):
        assert "frame" in found[entity], entity
    assert "world/left/picture" in found  # shared, once
    assert {"changes/two/table", "world/right/changes/two"} <= found.keys()
    (entry,) = RrdReader(opening.files[-1]).recordings()
    assert entry.application_id == "pomolog"


def test_a_session_without_results_has_its_pictures_truth_notes_and_ledger(tmp_path: Path) -> None:
    session = stereo_session(tmp_path / "row.mcap", FRAMES, rig=tiny_rig())
    opening = chosen(tmp_path, session)
    found = entities(opening.files[-1])
    for entity in ("world/left/picture", "world/truth", "health/ledger", "health/skew_ms", "about"):
        assert entity in found
    assert not any("fruit" in entity for entity in found)


def test_a_sessions_notes_are_shown(tmp_path: Path) -> None:
    drawn = stereo_session(tmp_path / "row.mcap", FRAMES[:1], rig=tiny_rig())
    noted = tmp_path / "noted.mcap"
    from recorder.session import Session

    with Session(drawn) as session, SessionWriter.create(noted, tiny_rig()) as writer:
        for pair in session.pairs():
            writer.write_frame(pair.left)
            writer.write_frame(pair.right)
        writer.write_note(Note(0, "lighting=front"))
    assert "health/notes" in entities(chosen(tmp_path, noted).files[-1])


def test_a_saved_recording_holds_its_layout(results: Path, tmp_path: Path) -> None:
    out = tmp_path / "view.rrd"
    save(chosen(tmp_path, results / "one"), out)
    reader = RrdReader(out)
    assert len(reader.recordings()) == len(reader.blueprints()) == 1


@pytest.mark.parametrize(
    ("path", "wish", "said"),
    [
        ("one", {"frame": 9}, r"no frame 9; it has 0 to 2"),
        ("one", {"time_s": 60.0}, r"no second 60; it lasts 2 s"),
        ("one", {"apple": 77}, r"no true apple 77"),
        ("one", {"session": "orchard"}, r"no session orchard .* there are row"),
        ("nowhere", {}, r"no .*nowhere; give a session"),
        ("", {}, r"a frame of which session|no results|no recording"),
        ("row.mcap", {"worst": 3}, r"no worst cases .* pomolog replay"),
        ("row.mcap", {"frame": 4}, r"no frame 4; it has 0 to 2"),
        ("one/row/apples.parquet", {}, r"is no session, recording or folder"),
    ],
)
def test_what_cannot_be_opened_is_one_line(
    path: str, wish: dict[str, Any], said: str, results: Path, tmp_path: Path
) -> None:
    with pytest.raises(PomologError, match=said):
        chosen(tmp_path, results / path, **wish)


def test_results_of_different_sessions_do_not_stand_side_by_side(
    results: Path, tmp_path: Path
) -> None:
    other = stereo_session(tmp_path / "row.mcap", FRAMES[:1], rig=tiny_rig())  # of the same name
    (done,) = replay([other], tmp_path / "other", TINY)
    assert isinstance(done, Replayed)
    with pytest.raises(PomologError, match="results of one session"):
        chosen(tmp_path, results / "one", tmp_path / "other")
    elsewhere = stereo_session(tmp_path / "elsewhere.mcap", FRAMES[:1], rig=tiny_rig())
    (done,) = replay([elsewhere], tmp_path / "third", TINY)
    with pytest.raises(PomologError, match="no session in common"):
        chosen(tmp_path, results / "one", tmp_path / "third")
    with pytest.raises(PomologError, match="side by side stand folders"):
        chosen(tmp_path, results / "one", elsewhere)
    with pytest.raises(PomologError, match="worst cases are of one folder"):
        chosen(tmp_path, results / "one", results / "two", worst=3)


def test_a_run_without_a_recording_says_how_to_make_one(results: Path, tmp_path: Path) -> None:
    (done,) = replay([results / "row.mcap"], tmp_path / "bare", TINY, rrd="none")
    assert isinstance(done, Replayed)
    with pytest.raises(PomologError, match=r"no recording in .* --rrd full"):
        chosen(tmp_path, tmp_path / "bare")


def test_a_damaged_recording_is_one_line(results: Path, tmp_path: Path) -> None:
    (done,) = replay([results / "row.mcap"], tmp_path / "torn", TINY)
    assert isinstance(done, Replayed)
    recording = done.out / "trace.rrd"
    recording.write_bytes(b"RRF2" + b"\0" * 100)
    with pytest.raises(PomologError, match=r"trace\.rrd cannot be read as a recording"):
        chosen(tmp_path, tmp_path / "torn", worst=3)


def test_what_a_saved_file_cannot_keep_is_refused(results: Path, tmp_path: Path) -> None:
    with pytest.raises(PomologError, match="leave --frame"):
        save(chosen(tmp_path, results / "one", frame=1), tmp_path / "view.rrd")
    with pytest.raises(PomologError, match=r"should end in \.rrd"):
        save(chosen(tmp_path, results / "one"), tmp_path / "view.mcap")
    assert not (tmp_path / "view.rrd").exists()
