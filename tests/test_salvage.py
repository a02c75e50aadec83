import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import Writer

from recorder.errors import PomologError
from recorder.mcap_records import MAGIC, RawMessage, parse_chunk, unpack_chunk
from recorder.profile import TOPICS
from recorder.salvage import salvage, survey
from recorder.session import Session, read_info
from tests.builders import content, session_file
from tests.mcap_files import HandChunk, HandFile, changed, flipped, record, records_in, torn

NAMES = list(TOPICS)


def chunk_ends(whole: Path) -> list[int]:
    return [r.stop for r in records_in(whole) if r.opcode == Opcode.CHUNK]


def messages_of(path: Path, *, without: frozenset[int] = frozenset()) -> list[RawMessage]:
    """The messages of every chunk but some, in file order, read without the code under test."""
    from mcap.records import Message

    found = []
    chunks = [r for r in records_in(path) if r.opcode == Opcode.CHUNK]
    data = path.read_bytes()
    for number, chunk in enumerate(chunks):
        if number in without:
            continue
        found += [
            RawMessage(NAMES[m.channel_id - 1], m.log_time, m.publish_time, m.sequence, m.data)
            for m in unpack_chunk(parse_chunk(data[chunk.body : chunk.stop]))
            if isinstance(m, Message)
        ]
    return found


def salvaged(path: Path) -> list[RawMessage]:
    """What salvage writes, in the order of time; the result must be sound."""
    out = path.with_name("salvaged.mcap")
    salvage(path, out)
    with Session(out) as session:
        session.verify()
        return list(session.messages())


def in_time(messages: list[RawMessage]) -> list[RawMessage]:
    return sorted(messages, key=lambda m: m.log_ns)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five chunks: the rig's, and one for each of four pairs."""
    folder = tmp_path_factory.mktemp("whole")
    return session_file(folder, 4, readings=True, labelled=True, sync_each=True)


@given(at=st.floats(0, 1))
@settings(
    max_examples=150,
    deadline=None,  # a busy machine is no failure
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # files are only overwritten
)
def test_a_session_torn_anywhere_keeps_every_complete_chunk(
    whole: Path, tmp_path: Path, at: float
) -> None:
    size = whole.stat().st_size
    place = min(int(at * size), size - 1)
    path = torn(whole, place)
    kept = sum(end <= place for end in chunk_ends(whole))
    if kept == 0:
        with pytest.raises(PomologError):
            salvage(path, tmp_path / "salvaged.mcap")
        return
    lost = frozenset(range(kept, 5))
    assert salvaged(path) == in_time(messages_of(whole, without=lost))


def test_a_salvaged_session_is_as_good_as_the_part_that_was_recorded(tmp_path: Path) -> None:
    path = session_file(tmp_path, 4, readings=True, labelled=True, sync_each=True)
    wreck = salvage(torn(path, chunk_ends(path)[3] + 10), tmp_path / "out.mcap")
    before, after = content(path), content(tmp_path / "out.mcap")
    about = after["pairs"][0][-1]
    assert about == {"lighting": "front", "cultivar": "Fuji"}
    assert [pair[:-1] for pair in after["pairs"]] == [pair[:-1] for pair in before["pairs"][:3]]
    assert after["rig"] == before["rig"]
    assert after["metadata"] == {**before["metadata"], "salvaged_from": "torn.mcap"}
    assert (wreck.frames, wreck.chunks, wreck.chunks_lost, wreck.bytes_lost) == (6, 4, 0, 10)


@pytest.mark.parametrize("encoding", ["jpeg", "bayer_rggb8", "bgr8"])
def test_frames_of_every_kind_are_salvaged(tmp_path: Path, encoding: str) -> None:
    path = session_file(tmp_path, 2, encoding=encoding)  # type: ignore[arg-type]  # parametrised
    salvage(torn(path, path.stat().st_size - 1), tmp_path / "out.mcap")
    before, after = content(path)["pairs"], content(tmp_path / "out.mcap")["pairs"]
    assert [pair[1] for pair in after] == [pair[1] for pair in before]


def test_a_whole_session_comes_through_with_its_ledger(tmp_path: Path) -> None:
    from recorder.session_writer import SessionWriter
    from tests.builders import frame, rig

    with (tmp_path / "s.mcap").open("wb") as stream:
        writer = SessionWriter(stream, rig(), {"site": "row 3"})
        writer.write_frame(frame("left"))
        writer.write_frame(frame("right"))
        writer.finish({"left.dropped": "3"})
    wreck = salvage(tmp_path / "s.mcap", tmp_path / "out.mcap")
    assert (wreck.chunks_lost, wreck.bytes_lost) == (0, 0)
    before, after = content(tmp_path / "s.mcap"), content(tmp_path / "out.mcap")
    assert [pair[1:4] for pair in after["pairs"]] == [pair[1:4] for pair in before["pairs"]]
    assert after["ledger"] == {"left.dropped": "3"}


# damaged in the middle


def test_a_damaged_middle_chunk_is_lost_alone_and_counted(whole: Path, tmp_path: Path) -> None:
    chunk = record(whole, Opcode.CHUNK, 2)
    path = flipped(whole, (chunk.body + chunk.stop) // 2)
    assert salvaged(path) == in_time(messages_of(whole, without=frozenset({2})))
    wreck = salvage(path, tmp_path / "out.mcap")
    assert (wreck.chunks, wreck.chunks_lost) == (4, 1)
    assert wreck.bytes_lost == chunk.stop - chunk.body


def test_a_damaged_record_header_costs_no_other_chunk(whole: Path) -> None:
    chunk = record(whole, Opcode.CHUNK, 2)
    rest = in_time(messages_of(whole, without=frozenset({2})))
    for at in range(chunk.start, chunk.start + 9):
        for bit in range(8):
            path = flipped(whole, at, bit)
            assert salvaged(path) == rest, (at - chunk.start, bit)
            assert survey(path).bytes_lost > 0, (at - chunk.start, bit)


def test_a_damaged_message_index_costs_no_chunk(whole: Path) -> None:
    everything = in_time(messages_of(whole))
    index = record(whole, Opcode.MESSAGE_INDEX, 5)
    for at in range(index.start, index.stop):
        path = flipped(whole, at, at % 8)
        assert salvaged(path) == everything, at - index.start


def test_an_end_in_the_middle_does_not_hide_the_rest(whole: Path) -> None:
    # a message index (7) is one flipped bit from the end of data (15)
    index = record(whole, Opcode.MESSAGE_INDEX, 3)
    assert salvaged(flipped(whole, index.start, 3)) == in_time(messages_of(whole))


def test_the_lost_first_chunk_costs_the_rig_and_nothing_else(whole: Path) -> None:
    chunk = record(whole, Opcode.CHUNK, 0)  # holds schemas, channels and the rig
    path = flipped(torn(whole, whole.stat().st_size - 100), (chunk.body + chunk.stop) // 2)
    assert salvaged(path) == in_time(messages_of(whole, without=frozenset({0})))
    with (
        Session(path.with_name("salvaged.mcap")) as session,
        pytest.raises(PomologError, match="no /left/calibration"),
    ):
        list(session.pairs())


@pytest.mark.parametrize("encoding", ["png", "bgr8"])
def test_frames_keep_their_kind_where_the_metadata_are_lost(tmp_path: Path, encoding: str) -> None:
    path = session_file(tmp_path, 2, encoding=encoding)  # type: ignore[arg-type]  # parametrised
    metadata = record(path, Opcode.METADATA)
    salvage(flipped(path, metadata.body + 30), tmp_path / "out.mcap")
    before, after = content(path)["pairs"], content(tmp_path / "out.mcap")["pairs"]
    assert [pair[1] for pair in after] == [pair[1] for pair in before]


def test_a_tail_of_zeros_after_a_power_cut_is_skipped(whole: Path) -> None:
    end = chunk_ends(whole)[2]
    path = torn(whole, end)
    with path.open("r+b") as stream:
        stream.truncate(end + (64 << 20))  # as a file system leaves it; fast, or this test is slow
    assert salvaged(path) == in_time(messages_of(whole, without=frozenset({3, 4})))
    assert survey(path).bytes_lost == 64 << 20


def test_a_hole_of_zeros_costs_only_the_chunks_that_it_touches(whole: Path) -> None:
    one, two = record(whole, Opcode.CHUNK, 1), record(whole, Opcode.CHUNK, 2)
    middle = (one.body + one.stop) // 2
    path = changed(whole, middle, bytes(two.body + 50 - middle))
    assert salvaged(path) == in_time(messages_of(whole, without=frozenset({1, 2})))


def test_two_recordings_behind_one_another_do_not_hide_what_is_there(whole: Path) -> None:
    data = whole.read_bytes()
    path = whole.with_name("two.mcap")
    path.write_bytes(data + data)
    assert len(salvaged(path)) == 2 * len(messages_of(whole))


@given(at=st.floats(0, 1), new=st.binary(min_size=1, max_size=40))
@settings(
    max_examples=150,
    deadline=None,  # a busy machine is no failure
)
def test_what_is_salvaged_was_recorded_and_no_untouched_chunk_is_lost(
    whole: Path, at: float, new: bytes
) -> None:
    place = min(int(at * whole.stat().st_size), whole.stat().st_size - len(new))
    path = changed(whole, place, new)
    chunks = [r for r in records_in(whole) if r.opcode == Opcode.CHUNK]
    touched = frozenset(
        number
        for number, chunk in enumerate(chunks)
        if chunk.start < place + len(new) and place < chunk.stop
    )
    if place < len(MAGIC):
        return  # no MCAP file any more, which test_container covers
    found = salvaged(path)
    recorded = messages_of(whole)
    assert all(message in recorded for message in found)
    for message in messages_of(whole, without=touched):
        assert message in found


# what salvage refuses


def test_salvage_refuses_to_overwrite_the_torn_file(whole: Path) -> None:
    path = torn(whole, chunk_ends(whole)[2])
    before = path.read_bytes()
    link = path.with_name("link.mcap")
    link.unlink(missing_ok=True)
    link.symlink_to(path)
    for out in (path, path.parent / "." / path.name, link):
        with pytest.raises(PomologError, match="is the torn file itself"):
            salvage(path, out)
    assert path.read_bytes() == before


def test_nothing_to_save_leaves_nothing(whole: Path, tmp_path: Path) -> None:
    path = torn(whole, chunk_ends(whole)[0] - 1)
    with pytest.raises(PomologError, match="nothing to save"):
        salvage(path, tmp_path / "out.mcap")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["missing", "folder", "empty", "text"])
def test_what_is_no_recording_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "torn.mcap"
    if kind == "folder":
        path.mkdir()
    elif kind != "missing":
        path.write_bytes(b"" if kind == "empty" else b"hello")
    with pytest.raises(PomologError):
        salvage(path, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize(
    ("profile", "words"), [("ros2", "no pomolog session"), ("pomolog/2", "newer")]
)
def test_recordings_of_another_profile_are_not_taken_for_ours(
    tmp_path: Path, profile: str, words: str
) -> None:
    path = tmp_path / "bag.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile)
        schema = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", b"")
        channel = writer.register_channel("/tf", "cdr", schema)
        writer.add_message(channel, 0, b"another's transform", 0)
        writer.finish()
    with pytest.raises(PomologError, match=words):
        salvage(path, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_a_bomb_among_the_chunks_is_lost_alone(tmp_path: Path) -> None:
    import zstandard

    bomb = HandChunk([(1, 0, b"")], "zstd", zstandard.compress(bytes(300 << 20)), 300 << 20, 0)
    path = HandFile([HandChunk([(1, 0, b"a")]), bomb, HandChunk([(1, 1, b"b")])]).write(
        tmp_path / "torn.mcap"
    )
    assert [message.data for message in salvaged(path)] == [b"a", b"b"]
    assert survey(path).chunks_lost == 1


def test_an_absurd_length_does_not_stop_salvage(whole: Path) -> None:
    chunk = record(whole, Opcode.CHUNK, 2)
    path = changed(whole, chunk.start + 1, struct.pack("<Q", 2**63))
    assert salvaged(path) == in_time(messages_of(whole, without=frozenset({2})))


# info of a torn file


def test_a_survey_counts_what_salvage_would_keep(whole: Path, tmp_path: Path) -> None:
    path = torn(whole, chunk_ends(whole)[3] + 20)
    wreck = survey(path)
    salvage(path, tmp_path / "out.mcap")
    info = read_info(tmp_path / "out.mcap")
    assert dict(wreck.counts) == info.topics
    assert (wreck.frames, wreck.start_ns, wreck.end_ns) == (info.frames, info.start_ns, info.end_ns)
