"""Workers: a pool and a real Dask cluster give the same bytes, and outlive what kills them."""

import os
import random
import signal
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import distributed
import pytest

import processor.replay as module
from processor.locate import Locator
from processor.replay import Outcome, Replayed, replay
from processor.results import TABLES, read_table
from processor.slices import versions
from recorder.errors import PomologError
from tests.scenes import TINY, apple, stereo_session, tiny_rig


@pytest.fixture(autouse=True)
def small_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SLICE_PAIRS", 4)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A scheduler and two worker processes, each with a nanny that starts it anew."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as found:
        yield found


def sessions_in(folder: Path, *pairs: int) -> list[Path]:
    """Sessions of so many pairs, apples at other places in each."""
    return [
        stereo_session(
            folder / f"row{number}.mcap",
            [[apple(1, 0.01 * (i % 3 - number), seen=1.0)] for i in range(count)],
            rig=tiny_rig(),
        )
        for number, count in enumerate(pairs)
    ]


def done(sessions: Sequence[Path], out: Path, **how: Any) -> list[Replayed]:
    outcomes = list(replay(sessions, out, how.pop("locator", TINY), rrd="none", **how))
    assert all(isinstance(one, Replayed) for one in outcomes), outcomes
    return [one for one in outcomes if isinstance(one, Replayed)]


def bits(out: Path) -> dict[str, Any]:
    """Every table's bytes; of the frames, whose stages take other times, all other columns."""
    found: dict[str, Any] = {}
    for folder in sorted(out.iterdir()):
        for name in TABLES:
            file = folder / f"{name}.parquet"
            found[f"{folder.name}/{name}"] = file.read_bytes()
        frames = read_table(folder, "frames")
        timed = [name for name in frames.column_names if name.endswith("_ns")]
        timed = [name for name in timed if name not in ("time_ns", "skew_ns")]
        found[f"{folder.name}/frames"] = frames.drop_columns(timed)
    return found


@dataclass(frozen=True, slots=True)
class Fatal:
    """A recogniser that kills its worker: at every picture, or while a file is there."""

    until_gone: Path | None = None

    def __call__(self, picture: Any) -> Any:
        if self.until_gone is None:
            os.kill(os.getpid(), signal.SIGKILL)
        elif self.until_gone.is_file():
            self.until_gone.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        return TINY.recognise(picture)


@dataclass(frozen=True, slots=True)
class FatalAbove:
    """A recogniser that kills its worker at pictures higher than so many rows."""

    rows: int

    def __call__(self, picture: Any) -> Any:
        if len(picture) > self.rows:
            os.kill(os.getpid(), signal.SIGKILL)
        return TINY.recognise(picture)


@dataclass(frozen=True, slots=True)
class Slow:
    """A recogniser that takes its time."""

    seconds: float

    def __call__(self, picture: Any) -> Any:
        time.sleep(self.seconds)
        return TINY.recognise(picture)


def with_recogniser(recognise: Any) -> Locator:
    return Locator(recognise, circles=TINY.circles)


@pytest.fixture
def undescribed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages of these tests have no name in the table of alternatives."""
    monkeypatch.setattr(
        module, "describe", lambda locator: {"recognise": {"use": repr(locator.recognise)}}
    )
    monkeypatch.setattr(module, "models_of", lambda _: {})


@pytest.mark.slow
def test_any_workers_any_slices_and_any_order_give_the_same_bytes(
    tmp_path: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions = sessions_in(tmp_path, 10, 3, 9)
    done(sessions, tmp_path / "one", workers=1)
    expected = bits(tmp_path / "one")
    assert len(read_table(tmp_path / "one/row0", "apples")) > 0
    for workers in (2, 3):
        done(sessions, tmp_path / f"{workers}", workers=workers)
        assert bits(tmp_path / f"{workers}") == expected
    done(sessions, tmp_path / "cluster", cluster=cluster.scheduler_address)
    assert bits(tmp_path / "cluster") == expected
    monkeypatch.setattr(module, "SLICE_PAIRS", 3)
    shuffled = random.Random(3).sample(sessions, len(sessions))
    outcomes = done(shuffled, tmp_path / "cut", workers=2)
    assert [one.session for one in outcomes] == shuffled
    assert bits(tmp_path / "cut") == expected


@pytest.mark.slow
@pytest.mark.usefixtures("undescribed")
def test_a_cluster_loses_a_worker_in_the_middle_and_gives_the_same_bytes(
    tmp_path: Path, cluster: Any
) -> None:
    sessions = sessions_in(tmp_path, 12, 12)
    done(sessions, tmp_path / "one", workers=1)
    killed: list[int] = []

    slow = with_recogniser(Slow(0.05))
    client = distributed.Client(cluster, set_as_default=False)
    pids = list(client.run(os.getpid).values())

    def kill(pairs: int) -> None:
        if pairs and not killed:
            killed.append(pids[0])
            os.kill(pids[0], signal.SIGKILL)

    done(sessions, tmp_path / "far", cluster=cluster.scheduler_address, locator=slow, tick=kill)
    assert killed
    assert pids[0] not in client.run(os.getpid).values()
    client.close()
    assert bits(tmp_path / "far") == bits(tmp_path / "one")


@pytest.mark.usefixtures("undescribed")
def test_a_slice_whose_worker_died_is_done_again(tmp_path: Path) -> None:
    sessions = sessions_in(tmp_path, 9)
    once = tmp_path / "once"
    once.touch()
    done(sessions, tmp_path / "two", workers=2, locator=with_recogniser(Fatal(once)))
    assert not once.exists()
    done(sessions, tmp_path / "one")
    assert bits(tmp_path / "two") == bits(tmp_path / "one")


@pytest.mark.slow
@pytest.mark.usefixtures("undescribed")
@pytest.mark.parametrize("far", [False, True], ids=["pool", "cluster"])
def test_a_session_that_kills_every_worker_is_reported_and_the_others_go_on(
    far: bool, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, last = sessions_in(tmp_path, 5, 6)
    bad = stereo_session(tmp_path / "bad.mcap", [[apple(1)]] * 2)  # 320 x 240 px
    how: dict[str, Any] = {"workers": 2}
    if far:
        cluster = request.getfixturevalue("cluster")
        how = {"cluster": cluster.scheduler_address}
        # at the first death all that the worker had is given up, the innocent as well
        monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)
    outcomes: list[Outcome] = list(
        replay(
            [first, bad, last], tmp_path / "out", with_recogniser(FatalAbove(100)), rrd="none",
            **how,
        )
    )  # fmt: skip
    assert [isinstance(one, Replayed) for one in outcomes] == [True, False, True]
    assert "pairs 0 to 1 of" in str(outcomes[1])
    assert "every worker on it was killed" in str(outcomes[1])
    assert not (tmp_path / "out/bad/run.json").exists()


@dataclass(frozen=True, slots=True)
class Mistaken:
    """A recogniser with a bug."""

    def __call__(self, picture: Any) -> Any:
        if len(picture) > 100:
            raise ZeroDivisionError("halves of nothing")
        return TINY.recognise(picture)


@pytest.mark.usefixtures("undescribed")
def test_a_bug_on_one_session_names_its_place_and_the_others_go_on(tmp_path: Path) -> None:
    (good,) = sessions_in(tmp_path, 2)
    bad = stereo_session(tmp_path / "bad.mcap", [[apple(1)]])
    outcomes = list(replay([bad, good], tmp_path / "out", with_recogniser(Mistaken()), rrd="none"))
    assert "a bug of pomolog (ZeroDivisionError: halves of nothing in" in str(outcomes[0])
    assert "test_workers.py:" in str(outcomes[0])
    assert isinstance(outcomes[1], Replayed)


def test_a_worker_of_another_version_does_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions = sessions_in(tmp_path, 1)
    other = (("numpy", "1.0"), *(v for v in versions() if v[0] != "numpy"))
    monkeypatch.setattr(module, "versions", lambda: other)
    (outcome,) = replay(sessions, tmp_path / "out", TINY)
    assert "has numpy 2" in str(outcome)
    assert "install the same on every worker" in str(outcome)


def test_a_session_that_changes_under_a_run_is_not_mixed(tmp_path: Path) -> None:
    (session,) = sessions_in(tmp_path, 6)
    (other,) = sessions_in(tmp_path / "other", 7)

    def swap(_: int) -> None:
        if other.exists():
            other.replace(session)

    (outcome,) = replay([session], tmp_path / "out", TINY, rrd="none", tick=swap)
    assert isinstance(outcome, PomologError)
    assert "changed while it was replayed" in str(outcome)


def test_no_scheduler_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("processor.cluster.CONNECT_S", 1)
    sessions = sessions_in(tmp_path, 1)
    with pytest.raises(PomologError, match=r"no Dask scheduler at tcp://127\.0\.0\.1:1 "):
        list(replay(sessions, tmp_path / "out", TINY, cluster="tcp://127.0.0.1:1"))
