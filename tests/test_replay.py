"""Replay: the same rows whoever does the work, resuming after a kill, and flat memory."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest

import processor.replay as module
from processor import slices
from processor.circles import RandomRing
from processor.locate import Locator
from processor.match import AreaInOrder
from processor.recognise import ColourRatio
from processor.replay import Replayed, replay, useful_workers
from processor.results import TABLES, join_tables, read_table, write_tables
from recorder.errors import PomologError
from recorder.files import only_writer
from recorder.records import Frame
from recorder.session import Session
from recorder.session_writer import SessionWriter
from tests.scenes import TINY, apple, small_rig, stereo_session, tiny_rig

RESULTS = {"apples.parquet", "frames.parquet", "truth.parquet", "run.json", "trace.rrd"}
OTHER = Locator(ColourRatio("difference"), circles=TINY.circles)


def tiny_session(path: Path, pairs: int, *, truth: bool = True) -> Path:
    """Pairs of 96 x 72 px, an apple in each but every fifth, which is empty."""
    frames = [[apple(1, 0.01 * (i % 3), seen=1.0)] if i % 5 else [] for i in range(pairs)]
    return stereo_session(path, frames, rig=tiny_rig(), truth=truth)


def run(sessions: Sequence[Path], out: Path, **how: Any) -> list[Replayed]:
    done = list(replay(sessions, out, how.pop("locator", TINY), **how))
    assert all(isinstance(one, Replayed) for one in done), done
    return [one for one in done if isinstance(one, Replayed)]


def values(out: Path, name: str) -> list[dict[str, Any]]:
    """A table's rows without how long anything took."""
    timed = {"decode_ns", "rectify_ns"} | {f"{s}_ns" for s in ("recognise", "clean", "circles")}
    timed |= {"match_ns", "triangulate_ns"}
    rows = read_table(out, name).to_pylist()
    return [{k: v for k, v in row.items() if k not in timed} for row in rows]


@pytest.fixture
def small_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SLICE_PAIRS", 4)


def test_the_results_are_those_of_the_design(tmp_path: Path) -> None:
    session = tiny_session(tmp_path / "row.mcap", 3)
    (done,) = run([session], tmp_path / "out")
    assert done.out == tmp_path / "out" / "row"
    assert (done.session, done.pairs, done.resumed) == (session, 3, False)
    assert {path.name for path in done.out.iterdir()} == RESULTS
    about = json.loads((done.out / "run.json").read_text())
    assert about["locator"]["circles"]["rounds"] == 30
    assert about["session"]["pairs"] == 3
    assert about["versions"]["opencv-python-headless"]
    assert about["seed"] == 0


def test_rows_are_equal_for_one_worker_and_two_and_for_two_runs(tmp_path: Path) -> None:
    session = tiny_session(tmp_path / "row.mcap", 35)  # two slices
    outs = {}
    for name, workers in (("one", 1), ("again", 1), ("two", 2)):
        outs[name] = run([session], tmp_path / name, workers=workers, rrd="none")[0].out
    for table in TABLES:
        first = values(outs["one"], table)
        assert first
        assert values(outs["again"], table) == first
        assert values(outs["two"], table) == first
    assert [row["frame"] for row in values(outs["two"], "frames")] == list(range(35))


@pytest.mark.usefixtures("small_slices")
def test_rows_do_not_depend_on_how_a_session_is_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = tiny_session(tmp_path / "row.mcap", 10)
    cut = run([session], tmp_path / "cut", rrd="none")[0].out
    monkeypatch.setattr(module, "SLICE_PAIRS", 32)
    whole = run([session], tmp_path / "whole", rrd="none")[0].out
    for table in TABLES:
        assert values(cut, table) == values(whole, table)


def test_another_seed_draws_other_rings(tmp_path: Path) -> None:
    session = tiny_session(tmp_path / "row.mcap", 5)
    first, other = (
        run([session], tmp_path / str(seed), seed=seed, rrd="none")[0].out for seed in (0, 1)
    )
    assert values(first, "apples") != values(other, "apples")
    assert json.loads((other / "run.json").read_text())["seed"] == 1


def count_written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    written: list[str] = []

    def counting(folder: Path, rows: Any) -> None:
        written.append(folder.name)
        write_tables(folder, rows)

    monkeypatch.setattr(slices, "write_tables", counting)
    return written


def test_results_that_are_there_are_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = tiny_session(tmp_path / "row.mcap", 3)
    (first,) = run([session], tmp_path / "out")
    before = {p.name: p.stat().st_mtime_ns for p in first.out.iterdir()}
    written = count_written(monkeypatch)
    ticks: list[int] = []
    (again,) = run([session], tmp_path / "out", tick=ticks.append)
    assert again.resumed
    assert sum(ticks) == 3
    assert written == []
    assert {p.name: p.stat().st_mtime_ns for p in first.out.iterdir()} == before


@pytest.mark.parametrize(
    "change",
    [
        {"locator": OTHER},
        {"seed": 7},
        {"method": "mine"},
        {"rrd": "none"},
    ],
    ids=["locator", "seed", "method", "rrd"],
)
def test_another_method_seed_or_drawing_is_done_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any]
) -> None:
    session = tiny_session(tmp_path / "row.mcap", 2)
    run([session], tmp_path / "out")
    written = count_written(monkeypatch)
    (again,) = run([session], tmp_path / "out", **change)
    assert not again.resumed
    assert len(written) == 1
    assert (again.out / "trace.rrd").exists() == (change.get("rrd") != "none")


def test_a_session_that_changed_is_done_anew(tmp_path: Path) -> None:
    session = tiny_session(tmp_path / "row.mcap", 2)
    run([session], tmp_path / "out")
    tiny_session(session, 3)
    (again,) = run([session], tmp_path / "out")
    assert (again.resumed, again.pairs) == (False, 3)
    assert len(values(again.out, "frames")) == 3


@pytest.mark.parametrize("name", sorted(RESULTS))
def test_a_result_that_was_deleted_is_made_again(name: str, tmp_path: Path) -> None:
    session = tiny_session(tmp_path / "row.mcap", 2)
    (first,) = run([session], tmp_path / "out")
    (first.out / name).unlink()
    (again,) = run([session], tmp_path / "out")
    assert not again.resumed
    assert {path.name for path in again.out.iterdir()} == RESULTS


# Replays row.mcap slowly, in slices of 4 pairs, until it is killed.
SLOW_RUN = """
import sys, time
from pathlib import Path
import processor.replay as module
from tests.scenes import TINY
module.SLICE_PAIRS = 4
if __name__ == "__main__":
    folder, workers = Path(sys.argv[1]), int(sys.argv[2])
    slow = lambda _: time.sleep(0.05)
    list(module.replay([folder / "row.mcap"], folder / "out", TINY, workers=workers, tick=slow))
"""


def start_slow_run(folder: Path, workers: int) -> subprocess.Popen[bytes]:
    script = folder / "slow_run.py"
    script.write_text(SLOW_RUN)
    root = str(Path(__file__).parent.parent)
    return subprocess.Popen(
        [sys.executable, str(script), str(folder), str(workers)],
        env={**os.environ, "PYTHONPATH": root},
    )


def wait_for_parts(out: Path, count: int, process: subprocess.Popen[bytes]) -> list[Path]:
    """The parts that are done as soon as there are that many."""
    for _ in range(1200):
        done = [p for p in sorted(out.glob("row/.parts-*/*")) if p.suffix != ".part"]
        if len(done) >= count:
            return done
        assert process.poll() is None, "it ended before it could be killed"
        time.sleep(0.05)
    raise AssertionError("no part was done in a minute")


@pytest.mark.usefixtures("small_slices")
def test_a_killed_run_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = tiny_session(tmp_path / "row.mcap", 40)
    process = start_slow_run(tmp_path, workers=1)
    parts = wait_for_parts(tmp_path / "out", 2, process)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "out/row/run.json").exists()
    kept = {f: f.stat().st_mtime_ns for part in parts for f in part.iterdir()}

    found: dict[Path, int] = {}

    def joining(folders: Sequence[Path], out: Path) -> None:
        found.update({f: f.stat().st_mtime_ns for f in kept})
        join_tables(folders, out)

    monkeypatch.setattr(slices, "join_tables", joining)
    written = count_written(monkeypatch)
    (done,) = run([session], tmp_path / "out")
    assert found == kept  # completed parts untouched
    assert len(written) <= 10 - len(parts)
    assert {path.name for path in done.out.iterdir()} == RESULTS
    monkeypatch.undo()
    fresh = run([session], tmp_path / "fresh")[0].out
    for table in TABLES:
        assert values(done.out, table) == values(fresh, table)


def test_the_workers_of_a_killed_run_end_with_it(tmp_path: Path) -> None:
    tiny_session(tmp_path / "row.mcap", 100)
    process = start_slow_run(tmp_path, workers=2)
    wait_for_parts(tmp_path / "out", 1, process)
    workers = psutil.Process(process.pid).children(recursive=True)
    assert workers
    process.send_signal(signal.SIGKILL)
    process.wait()
    # a worker notices at once; a loaded machine may take a moment
    _, alive = psutil.wait_procs(workers, timeout=10)
    for orphan in alive:
        orphan.kill()
    assert alive == []


@pytest.mark.parametrize("pairs", [3, 6])
@pytest.mark.usefixtures("small_slices")
def test_a_run_killed_while_it_was_joining_goes_on(
    pairs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = tiny_session(tmp_path / "row.mcap", pairs)
    out = tmp_path / "out/row"

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(shutil, "rmtree", killed)  # the last thing of all
    with pytest.raises(KeyboardInterrupt):
        run([session], tmp_path / "out")
    (out / "run.json").unlink()  # as if it had been killed just before that
    (out / "trace.rrd.1234.part").write_bytes(b"half a recording")
    monkeypatch.undo()
    monkeypatch.setattr(module, "SLICE_PAIRS", 4)
    written = count_written(monkeypatch)
    (done,) = run([session], tmp_path / "out")
    assert written == []
    assert {path.name for path in done.out.iterdir()} == RESULTS


def test_parts_of_another_method_are_thrown_away(tmp_path: Path) -> None:
    session = tiny_session(tmp_path / "row.mcap", 2)
    stale = tmp_path / "out/row/.parts-0123456789ab/00000000-00000002"
    stale.mkdir(parents=True)
    (done,) = run([session], tmp_path / "out")
    assert {path.name for path in done.out.iterdir()} == RESULTS


def poisoned(path: Path) -> Path:
    """A session whose third picture starts like a PNG and is none."""
    whole = tiny_session(path.with_name("whole.mcap"), 4)
    with Session(whole) as session, SessionWriter.create(path, session.rig) as writer:
        for pair in session.pairs():
            for frame in (pair.left, pair.right):
                data = frame.data[:60] if pair.index == 2 else frame.data
                writer.write_frame(
                    Frame(frame.side, frame.time_ns, frame.encoding, data, frame.size_px)
                )
    whole.unlink()
    return path


@pytest.mark.parametrize("workers", [1, 2])
def test_a_bad_session_is_reported_and_the_others_go_on(workers: int, tmp_path: Path) -> None:
    good = [tiny_session(tmp_path / f"good{i}.mcap", 3) for i in (1, 2)]
    flipped = tiny_session(tmp_path / "flipped.mcap", 3)
    data = bytearray(flipped.read_bytes())
    data[len(data) // 3] ^= 0xFF
    flipped.write_bytes(data)
    (tmp_path / "text.mcap").write_text("no session")
    bad = [poisoned(tmp_path / "poisoned.mcap"), flipped, tmp_path / "text.mcap"]
    sessions = [good[0], *bad, good[1]]
    done = list(replay(sessions, tmp_path / "out", TINY, workers=workers, rrd="none"))
    assert [isinstance(one, Replayed) for one in done] == [True, False, False, False, True]
    for error in done[1:4]:
        assert isinstance(error, PomologError)
        assert "\n" not in str(error)
    assert "2000000000 ns" in str(done[1])  # where the bad picture is
    for path in bad:
        assert not (tmp_path / "out" / path.stem / "run.json").exists()
        assert not list((tmp_path / "out").glob(f"{path.stem}/*.parquet"))


def test_two_sessions_of_one_name_are_refused(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    with pytest.raises(PomologError, match="two sessions are named row"):
        list(replay([tmp_path / "a/row.mcap", tmp_path / "b/row.mcap"], tmp_path / "out", TINY))


def test_a_worker_that_is_killed_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = tiny_session(tmp_path / "row.mcap", 2)
    monkeypatch.setattr("processor.pool._end_with_parent", os.abort)
    (error,) = replay([session], tmp_path / "out", TINY, workers=2)
    assert isinstance(error, PomologError)
    assert "--workers" in str(error)


def test_an_output_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    session = tiny_session(tmp_path / "row.mcap", 1)
    (tmp_path / "out").write_text("a file, no folder")
    (error,) = replay([session], tmp_path / "out", TINY)
    assert isinstance(error, PomologError)
    assert "cannot write" in str(error)


def test_pictures_without_an_apple_give_short_tables(tmp_path: Path) -> None:
    session = stereo_session(tmp_path / "empty.mcap", [[], []], rig=tiny_rig())
    (done,) = run([session], tmp_path / "out")
    assert values(done.out, "apples") == []
    assert [row["fruit_fn"] for row in values(done.out, "frames")] == [0, 0]


def test_a_session_without_truth_has_no_counts(tmp_path: Path) -> None:
    session = stereo_session(tmp_path / "bare.mcap", [[apple(1)]], truth=False)
    (done,) = run([session], tmp_path / "out", locator=Locator())
    (frame,) = values(done.out, "frames")
    assert frame["matched"] == 1
    assert {k: v for k, v in frame.items() if k.endswith(("_tp", "_fp", "_fn"))} == dict.fromkeys(
        f"{what}_{part}"
        for what in ("pixels", "pixels_cleaned", "fruit")
        for part in ("tp", "fp", "fn")
    )
    assert values(done.out, "truth") == []
    assert {row["left_truth"] for row in values(done.out, "apples")} == {None}


def test_the_paper_finds_a_drawn_apple_with_its_truth(tmp_path: Path) -> None:
    session = stereo_session(tmp_path / "one.mcap", [[apple(4, 0.02, seen=1.0)]], rig=small_rig())
    (done,) = run([session], tmp_path / "out", locator=Locator())
    (row,) = values(done.out, "truth")
    assert (row["apple_id"], row["match"], row["found_left"]) == (4, "right", True)
    # 4 px of the 60 px disparity, what two circles of a 5 px ring may be off
    assert abs(row["error_m"]) < 0.4 * 4 / 60


# Replays row.mcap and prints the resident megabytes after each pair.
MEASURED_RUN = """
import sys
from pathlib import Path
import psutil
from processor.replay import replay
from tests.scenes import TINY
folder, me, mb = Path(sys.argv[1]), psutil.Process(), []
tick = lambda _: mb.append(me.memory_info().rss / 1e6)
list(replay([folder / "row.mcap"], folder / "out", TINY, tick=tick))
print(max(mb[:150]), max(mb[-150:]), len(mb), me.num_threads())
"""


def test_memory_stays_flat_over_500_pairs(tmp_path: Path) -> None:
    tiny_session(tmp_path / "row.mcap", 500, truth=False)
    root = str(Path(__file__).parent.parent)
    done = subprocess.run(
        [sys.executable, "-c", MEASURED_RUN, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": root}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    early_mb, late_mb, pairs, threads = map(float, done.stdout.split())
    assert pairs == 500
    # Once a few slices have passed, what a slice needs is there and is used again; the allocator
    # breathes by a few megabytes. Keeping anything of each pair, only a picture of it (41 KB for
    # both views), or a megabyte of each of the 11 slices between, would show.
    assert late_mb - early_mb < 8
    assert threads < 32  # a recording that is not let go of keeps two


@pytest.mark.parametrize("workers", [1, 2])
def test_a_disk_that_fills_up_while_drawing_is_one_line_and_ends(
    workers: int, small_disk: Path, tmp_path: Path
) -> None:
    session = tiny_session(tmp_path / "row.mcap", 3)
    (small_disk / "filler").write_bytes(bytes((1 << 20) - 3 * 4096))  # room for rows, not pictures
    (outcome,) = replay([session], small_disk / "out", TINY, workers=workers)
    assert isinstance(outcome, PomologError)
    assert "No space left on device; make room" in str(outcome)
    left = [path.name for path in (small_disk / "out").rglob("*") if path.is_file()]
    assert left == []


def test_a_folder_that_another_run_is_writing_is_left_to_it(tmp_path: Path) -> None:
    session = tiny_session(tmp_path / "row.mcap", 1)
    folder = tmp_path / "out" / "row"
    folder.mkdir(parents=True)
    with only_writer(folder):
        (outcome,) = replay([session], tmp_path / "out", TINY)
    assert isinstance(outcome, PomologError)
    assert "another run is writing" in str(outcome)
    (done,) = run([session], tmp_path / "out")
    assert not done.resumed


def test_swapped_views_are_suspected(tmp_path: Path) -> None:
    apples = [apple(1, -0.05, seen=1.0), apple(2, 0.06, 0.03, seen=1.0)]
    right_way = stereo_session(tmp_path / "right.mcap", [apples] * 4)
    with Session(right_way) as session:
        swapped = tmp_path / "swapped.mcap"
        with SessionWriter.create(swapped, session.rig) as writer:
            for pair in session.pairs():
                writer.write_frame(replace(pair.right, side="left"))
                writer.write_frame(replace(pair.left, side="right"))
    plain = Locator(match=AreaInOrder(reference_line=False), circles=RandomRing())
    good, bad = (run([s], tmp_path / "out", locator=plain)[0] for s in (right_way, swapped))
    assert good.warning is None
    assert bad.warning is not None
    assert "are the two views swapped?" in bad.warning


def test_changed_code_makes_new_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = tiny_session(tmp_path / "row.mcap", 1)
    run([session], tmp_path / "out")
    assert run([session], tmp_path / "out")[0].resumed
    monkeypatch.setattr(module, "versions", lambda: (("source", "edited"),))
    monkeypatch.setattr(slices, "versions", lambda: (("source", "edited"),))
    assert not run([session], tmp_path / "out")[0].resumed


def test_no_more_workers_than_slices_and_none_beside_us_for_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    assert [useful_workers(pairs) for pairs in ([], [7], [32], [33], [7, 7, 7], [1000])] == [
        1, 1, 1, 2, 3, 4,
    ]  # fmt: skip
