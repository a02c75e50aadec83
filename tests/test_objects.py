"""Object storage: sessions and results in a real S3 server on this machine."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pytest
from moto.server import ThreadedMotoServer

import processor.replay as module
from processor.replay import Replayed, replay
from processor.results import TABLES
from processor.runs import find_runs, score_runs
from recorder.errors import PomologError
from recorder.objects import ObjectPath, ObjectReader, as_place
from recorder.session import Session, read_info
from tests.scenes import TINY, apple, stereo_session, tiny_rig
from tests.test_workers import bits


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """The address of an S3 server."""
    found = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    found.start()
    host, port = found.get_host_and_port()
    yield f"http://{host}:{port}"
    found.stop()


@pytest.fixture
def bucket(server: str, monkeypatch: pytest.MonkeyPatch, request: Any) -> Iterator[ObjectPath]:
    """A new bucket, its address and keys where a worker finds them too."""
    for name, value in (
        ("AWS_ENDPOINT_URL", server),
        ("AWS_ACCESS_KEY_ID", "somebody"),
        ("AWS_SECRET_ACCESS_KEY", "something"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
    ):
        monkeypatch.setenv(name, value)
    name = f"b{abs(hash(request.node.name))}"
    files = fsspec.filesystem("s3", use_listings_cache=False)
    files.mkdir(name)
    yield ObjectPath(f"s3://{name}")
    files.rm(name, recursive=True)


def kept(bucket: ObjectPath, session: Path) -> ObjectPath:
    place = bucket / "season" / session.name
    place.put(session)
    return place


def row(path: Path, pairs: int = 6) -> Path:
    frames = [[apple(1, 0.01 * (i % 3), seen=1.0)] for i in range(pairs)]
    return stereo_session(path, frames, rig=tiny_rig())


def names(folder: ObjectPath) -> set[str]:
    return {str(one).removeprefix(f"{folder}/") for one in folder.below()}


def test_a_session_reads_the_same_there_as_here(bucket: ObjectPath, tmp_path: Path) -> None:
    here = row(tmp_path / "row.mcap")
    there = kept(bucket, here)
    assert read_info(there) == read_info(here)
    with Session(here) as near, Session(there) as far:
        assert far.name == "row"
        assert far.fingerprint == near.fingerprint
        for one, other in zip(near.pairs(2, 5), far.pairs(2, 5), strict=True):
            assert (one.left.data, one.right.data) == (other.left.data, other.right.data)
            assert (one.index, one.time_ns) == (other.index, other.time_ns)
        far.verify()


def test_a_slice_asks_for_little_more_than_its_chunks(
    bucket: ObjectPath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = kept(bucket, row(tmp_path / "row.mcap", 300))
    asked: list[int] = []
    requests = ObjectPath.ranges

    def counting(self: ObjectPath, ranges: Any) -> list[bytes]:
        asked.extend(stop - start for start, stop in ranges)
        return requests(self, ranges)

    monkeypatch.setattr(ObjectPath, "ranges", counting)
    with Session(there) as session:
        times, size_bytes = session.image_times, session.size_bytes
    asked.clear()
    with Session(there, image_times=times) as session:
        assert len(list(session.pairs(0, 300))) == 300
    assert size_bytes < sum(asked) < 1.2 * size_bytes + 4 * (1 << 16)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_results_there_have_the_bytes_of_results_here(
    workers: int, bucket: ObjectPath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SLICE_PAIRS", 4)
    here = row(tmp_path / "row.mcap")
    (near,) = replay([here], tmp_path / "near", TINY)
    (far,) = replay([kept(bucket, here)], bucket / "out", TINY, workers=workers)
    assert isinstance(near, Replayed), near
    assert isinstance(far, Replayed), far
    assert names(bucket / "out") == {f"row/{path.name}" for path in near.out.iterdir()}
    for name in names(bucket / "out"):
        copy = tmp_path / "copy" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        (bucket / "out" / name).get(copy)
    assert bits(tmp_path / "copy") == bits(tmp_path / "near")
    assert score_runs(find_runs([tmp_path / "copy"]))["all"].frames == 6
    (again,) = replay([kept(bucket, here)], bucket / "out", TINY)
    assert isinstance(again, Replayed)
    assert again.resumed


def test_a_run_that_was_killed_goes_on_with_the_parts_that_are_there(
    bucket: ObjectPath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SLICE_PAIRS", 2)
    there = kept(bucket, row(tmp_path / "row.mcap"))
    ticks: list[int] = []

    def kill(pairs: int) -> None:
        ticks.append(pairs)
        if len(ticks) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(replay([there], bucket / "out", TINY, rrd="none", tick=kill))
    left = names(bucket / "out")
    assert len(left) == len(TABLES)  # one part
    assert not any("run.json" in name for name in left)
    ticks.clear()
    (done,) = replay([there], bucket / "out", TINY, rrd="none", tick=ticks.append)
    assert isinstance(done, Replayed)
    assert ticks == [2, 1, 1, 1, 1]  # the first slice at once
    assert names(bucket / "out") == {"row/run.json", *(f"row/{name}.parquet" for name in TABLES)}


def test_scores_are_read_from_there(bucket: ObjectPath, tmp_path: Path) -> None:
    there = kept(bucket, row(tmp_path / "row.mcap"))
    list(replay([there], bucket / "out", TINY, rrd="none"))
    assert score_runs(find_runs([bucket / "out"]))["all"].frames == 6


def test_what_is_not_there_is_one_line(bucket: ObjectPath) -> None:
    with pytest.raises(PomologError, match=r"no s3://.*/none.mcap there"):
        read_info(bucket / "none.mcap")


def test_a_storage_that_does_not_answer_is_one_line(
    bucket: ObjectPath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def down(*_: object) -> None:
        raise RuntimeError("Could not connect to the endpoint URL")

    reader = ObjectReader(bucket / "row.mcap", 1 << 20)
    monkeypatch.setattr(ObjectPath, "_files", down)
    with pytest.raises(PomologError, match=r"cannot reach s3://.*: Could not connect"):
        reader.read(10)


@pytest.mark.parametrize("words", ["s3://", "s3:///x", "s3://b/../x", "ftp://b/x", "http://b/x"])
def test_an_address_of_another_kind_is_refused(words: str) -> None:
    with pytest.raises(PomologError):
        as_place(words)
    assert as_place("row.mcap") == Path("row.mcap")


def test_a_reader_gives_what_a_file_gives(bucket: ObjectPath, tmp_path: Path) -> None:
    data = bytes(range(256)) * 1000
    (bucket / "x").write_bytes(data)
    (tmp_path / "x").write_bytes(data)
    stream = (bucket / "x").open()
    stream.announce([(10, 20), (200_000, 90_000)])
    with (tmp_path / "x").open("rb") as file:
        for offset, size in ((0, 3), (12, 5), (100, 70_000), (255_000, 9000), (256_001, 5)):
            assert stream.seek(offset) == file.seek(offset)
            assert stream.read(size) == file.read(size)
            assert stream.tell() == offset + min(size, max(0, 256_000 - offset))
