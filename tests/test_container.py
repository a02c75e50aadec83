import contextlib
import os
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from recorder.container import Container
from recorder.errors import PomologError, TornFileError
from recorder.limits import Limits
from recorder.session import Session
from tests.builders import DATA, content, encoded, session_file
from tests.mcap_files import HandChunk, HandFile, changed, flipped, record, records_in, torn

MIB = 1 << 20


def everything(path: Path) -> None:
    """Whatever a reader can ask of a file."""
    content(path)
    with Session(path) as session:
        session.verify()


def refusal(path: Path, read: Callable[[Path], Any] = everything) -> str:
    """The one line that reading ends with; any other exception fails the test."""
    with pytest.raises(PomologError) as caught:
        read(path)
    line = str(caught.value)
    assert "\n" not in line
    assert path.name in line or "/image" in line
    assert len(line) < 600
    return line


@contextlib.contextmanager
def memory_below(mib: int) -> Iterator[None]:
    """Fail if the block makes this process's peak grow by more."""
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    before = _status_mib("VmRSS")
    yield
    assert _status_mib("VmHWM") - before < mib


def _status_mib(key: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith(key))


# what is no session at all


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    assert "is the name right?" in refusal(tmp_path / "no.mcap")


def test_a_folder_is_no_session(tmp_path: Path) -> None:
    assert "is a folder" in refusal(tmp_path)


def test_an_empty_file_is_torn_before_it_began(tmp_path: Path) -> None:
    (tmp_path / "s.mcap").write_bytes(b"")
    with pytest.raises(TornFileError, match="is empty"):
        Session(tmp_path / "s.mcap")


@pytest.mark.parametrize("data", [b"hello", encoded("png"), b"\0" * 1000, b"\x89MCAP1\r\n" * 9])
def test_another_file_is_not_mcap(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "s.mcap").write_bytes(data)
    assert "is not an MCAP file" in refusal(tmp_path / "s.mcap")


def test_a_pipe_is_refused_instead_of_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "s.mcap")
    assert "not a file" in refusal(tmp_path / "s.mcap")


def bags_of_others() -> list[Path]:
    bags = sorted((DATA / "rosbag2_mcap").rglob("*.mcap"))
    if not bags:
        pytest.skip(f"NOT TESTED: no ROS 2 bags in {DATA / 'rosbag2_mcap'}")
    assert len(bags) >= 20
    return bags


def test_bags_of_others_are_read_as_the_mcap_library_reads_them() -> None:
    for bag in bags_of_others():
        with bag.open("rb") as stream:
            expected = [
                (channel.topic, message.log_time, message.sequence, message.data)
                for _, channel, message in make_reader(stream).iter_messages()
            ]
        with Container(bag) as container:
            found = [(m.topic, m.log_ns, m.sequence, m.data) for m in container.messages()]
            container.verify()
            for topic in container.counts():
                times = sorted(time_ns for name, time_ns, _, _ in expected if name == topic)
                assert container.times_ns(topic).tolist() == times
        assert found == expected, bag


def test_bags_of_others_are_no_sessions() -> None:
    for bag in bags_of_others():
        assert "no pomolog session" in refusal(bag) or "no index" in refusal(bag), bag


# torn at every kind of place


def test_a_session_cut_anywhere_is_torn_or_refused(tmp_path: Path) -> None:
    whole = session_file(tmp_path, 2, readings=True, sync_each=True)
    size = whole.stat().st_size
    places = {0, 4, 8, 9, size - 1, size - 8, size - 9, size - 20, size - 37}
    for one in records_in(whole):
        places |= {one.start, one.start + 1, one.body, (one.body + one.stop) // 2, one.stop - 1}
    for at in sorted(places - {size}):
        path = torn(whole, at)
        with pytest.raises(TornFileError):
            everything(path)
        refusal(path)


def test_a_torn_session_says_how_to_salvage_it(tmp_path: Path) -> None:
    whole = session_file(tmp_path)
    path = torn(whole, whole.stat().st_size // 2)
    assert f"try: pomolog salvage {path} -o" in refusal(path)


def test_a_session_with_more_behind_its_end_is_refused(tmp_path: Path) -> None:
    path = session_file(tmp_path)
    path.write_bytes(path.read_bytes() + b"more")
    refusal(path)


# a byte flipped


def test_a_byte_flipped_in_a_picture_fails_the_chunk(tmp_path: Path) -> None:
    whole = session_file(tmp_path, 1)
    chunk = record(whole, Opcode.CHUNK, 1)
    assert "a chunk fails its CRC" in refusal(flipped(whole, (chunk.body + chunk.stop) // 2))


def test_a_byte_flipped_in_the_index_fails_the_index(tmp_path: Path) -> None:
    whole = session_file(tmp_path, 1)
    for opcode in (Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.METADATA_INDEX, Opcode.FOOTER):
        one = record(whole, opcode)
        refusal(flipped(whole, (one.body + one.stop) // 2))


def test_a_byte_flipped_in_the_metadata_fails_their_checksum(tmp_path: Path) -> None:
    whole = session_file(tmp_path, 1)
    at = whole.read_bytes().index(b"front")
    assert "its metadata fails its CRC" in refusal(flipped(whole, at))


def test_metadata_whose_checksum_was_lost_are_refused(tmp_path: Path) -> None:
    whole = session_file(tmp_path, 1)
    at = whole.read_bytes().index(b"crc32")  # a key that nobody asks for
    assert "metadata" in refusal(flipped(whole, at))


def test_a_ledger_under_another_name_is_not_simply_absent(tmp_path: Path) -> None:
    from recorder.session_writer import SessionWriter
    from tests.builders import frame, rig

    with (tmp_path / "s.mcap").open("wb") as stream:
        writer = SessionWriter(stream, rig())
        writer.write_frame(frame("left"))
        writer.write_frame(frame("right"))
        writer.finish({"left.dropped": "3"})
    at = (tmp_path / "s.mcap").read_bytes().index(b"ledger")
    assert "metadata" in refusal(flipped(tmp_path / "s.mcap", at))


def test_a_byte_flipped_in_a_message_index_moves_no_frame(tmp_path: Path) -> None:
    whole = session_file(tmp_path, 3)
    right = content(whole)
    for number in (-1, -2):  # of the right and the left images
        one = record(whole, Opcode.MESSAGE_INDEX, number)
        for at in range(one.start, one.stop):
            for bit in (0, 3, 7):
                path = flipped(whole, at, bit)
                with contextlib.suppress(PomologError):
                    assert content(path) == right


def test_no_flipped_byte_at_all_passes_the_check(tmp_path: Path) -> None:
    whole = session_file(tmp_path, 2)
    size = whole.stat().st_size
    # some of all, and more of what surrounds messages
    places = set(range(0, size, 41)) | set(range(0, 400, 3)) | set(range(size - 150, size))
    for at in sorted(places):
        path = flipped(whole, at, at % 8)
        with pytest.raises(PomologError), Session(path) as session:
            session.verify()


# hostile numbers


@pytest.mark.parametrize("length", [2**63 - 1, 2**64 - 1, 1 << 40, (256 << 20) + 1])
@pytest.mark.parametrize("opcode", [Opcode.HEADER, Opcode.CHUNK, Opcode.METADATA])
def test_an_absurd_record_length_is_refused(tmp_path: Path, opcode: Opcode, length: int) -> None:
    whole = session_file(tmp_path, 1)
    one = record(whole, opcode)
    with memory_below(64):
        refusal(changed(whole, one.start + 1, length.to_bytes(8, "little")))


def pack(compression: str, data: bytes) -> bytes:
    return zstandard.compress(data) if compression == "zstd" else lz4.frame.compress(data)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("claim", [1000, 255 << 20, 1 << 30, 2**63])
def test_a_chunk_that_unpacks_to_a_gigabyte_is_refused(
    tmp_path: Path, compression: str, claim: int
) -> None:
    piece = pack(compression, bytes(64 * MIB))
    if compression == "zstd":
        packer = zstandard.ZstdCompressor().compressobj(size=1 << 30)
        packed = b"".join(packer.compress(bytes(64 * MIB)) for _ in range(16)) + packer.flush()
    else:
        with lz4.frame.LZ4FrameCompressor() as lz4_packer:
            packed = lz4_packer.begin()
            packed += b"".join(lz4_packer.compress(bytes(64 * MIB)) for _ in range(16))
            packed += lz4_packer.flush()
    assert len(piece) < len(packed) < 5 * MIB
    bomb = HandChunk([(1, 0, b"")], compression, packed, claim, 0)
    path = HandFile([bomb]).write(tmp_path / "s.mcap")
    with memory_below(600):  # a chunk may claim 256 MiB, and twice that while it is unpacked
        line = refusal(path)
    assert "unpack" in line


@pytest.mark.parametrize(("count", "chunks"), [(5_000_000, 1), (100_000, 8)])
def test_a_chunk_of_millions_of_empty_messages_is_refused(
    tmp_path: Path, count: int, chunks: int
) -> None:
    message = b"\x05" + (22).to_bytes(8, "little") + (1).to_bytes(2, "little") + bytes(20)
    plain = message * count
    packed = zstandard.compress(plain)
    bomb = HandChunk([(1, 0, b"")], "zstd", packed, len(plain), zlib.crc32(plain))
    path = HandFile([bomb] * chunks, counts={1: chunks * count}).write(tmp_path / "s.mcap")
    assert path.stat().st_size < MIB
    with memory_below(450):

        def read(path: Path) -> None:
            with Container(path, Limits(overlap=64 * MIB)) as container:
                for _ in container.messages():
                    pass

        refusal(path, read)


def test_chunks_that_overlap_beyond_the_limit_are_refused(tmp_path: Path) -> None:
    chunks = [HandChunk([(1, 1000 + i, bytes(MIB))], times_ns=(0, 2000)) for i in range(8)]
    path = HandFile(chunks).write(tmp_path / "s.mcap")

    def read(limit: int) -> int:
        with Container(path, Limits(overlap=limit)) as container:
            return len(list(container.messages()))

    assert read(9 * MIB) == 8
    with pytest.raises(PomologError, match="overlap in time by more than"):
        read(4 * MIB)


def test_chunks_that_do_not_overlap_need_no_room(tmp_path: Path) -> None:
    path = HandFile([HandChunk([(1, i, bytes(MIB))]) for i in range(8)]).write(tmp_path / "s.mcap")
    with Container(path, Limits(overlap=3 * MIB)) as container:
        assert [message.log_ns for message in container.messages()] == list(range(8))


def test_a_chunk_count_that_disagrees_is_refused(tmp_path: Path) -> None:
    chunk = HandChunk([(1, 0, b"x")])
    path = HandFile([chunk], chunk_count=2).write(tmp_path / "s.mcap")
    assert "1 chunks indexed, 2 counted" in refusal(path)


@pytest.mark.parametrize(("counted", "word"), [(1, "too many"), (3, "missing"), (2**63, "missing")])
def test_a_message_count_that_disagrees_is_refused(tmp_path: Path, counted: int, word: str) -> None:
    path = HandFile(
        [HandChunk([(3, 0, b"x"), (3, 1, b"y")])], {3: "/notes"}, counts={3: counted}
    ).write(tmp_path / "s.mcap")
    with Container(path) as container, pytest.raises(PomologError, match=word):
        list(container.messages())
    with Container(path) as container, pytest.raises(PomologError, match="counted"):
        container.times_ns("/notes")


def test_one_chunk_listed_many_times_is_refused(tmp_path: Path) -> None:
    chunk = HandChunk([(1, i, b"x") for i in range(1000)])
    path = HandFile([chunk], counts={1: 10_000_000}, index_copies=10_000).write(tmp_path / "s.mcap")
    with memory_below(64):
        refusal(path)


def test_a_chunk_without_message_indexes_listed_twice_is_refused(tmp_path: Path) -> None:
    path = HandFile([HandChunk()], index_copies=2).write(tmp_path / "s.mcap")
    with pytest.raises(PomologError, match="one over the other"):
        Container(path)


def test_a_message_index_that_says_another_length_is_refused(tmp_path: Path) -> None:
    whole = HandFile([HandChunk([(1, 0, b"x")])], {1: "/notes"}).write(tmp_path / "s.mcap")
    length_at = record(whole, Opcode.MESSAGE_INDEX).body + 2
    path = changed(whole, length_at, (32).to_bytes(4, "little"))
    with Container(path) as container, pytest.raises(PomologError, match="do not add up"):
        container.times_ns("/notes")


def test_a_range_begins_with_the_last_message_of_a_chunk(tmp_path: Path) -> None:
    chunks = [HandChunk([(1, 0, b"a"), (1, 10, b"b")]), HandChunk([(1, 20, b"c")])]
    path = HandFile(chunks, {1: "/notes"}).write(tmp_path / "s.mcap")
    with Container(path) as container:
        found = [m.data for m in container.messages(start_ns=10, stop_ns=20)]
    assert found == [b"b"]


def test_a_message_from_outside_its_chunks_time_is_refused(tmp_path: Path) -> None:
    path = HandFile([HandChunk([(1, 50, b"x")], times_ns=(0, 10))]).write(tmp_path / "s.mcap")
    with Container(path) as container, pytest.raises(PomologError, match="outside its time"):
        list(container.messages())


def test_a_message_of_a_channel_that_nobody_declared_is_refused(tmp_path: Path) -> None:
    path = HandFile([HandChunk([(1, 0, b"y"), (9, 0, b"x")])], {1: "/notes"}).write(
        tmp_path / "s.mcap"
    )
    with Container(path) as container, pytest.raises(PomologError, match="unknown channel 9"):
        list(container.messages())


def test_an_unknown_compression_is_refused(tmp_path: Path) -> None:
    path = HandFile([HandChunk([(1, 0, b"x")], "rar")]).write(tmp_path / "s.mcap")
    with Container(path) as container, pytest.raises(PomologError, match="compression 'rar'"):
        list(container.messages())


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_an_honest_compressed_chunk_is_read(tmp_path: Path, compression: str) -> None:
    messages = [(1, i, bytes([i]) * 1000) for i in range(50)]
    plain = b"".join(
        b"\x05"
        + (22 + len(data)).to_bytes(8, "little")
        + channel.to_bytes(2, "little")
        + bytes(4)
        + time_ns.to_bytes(8, "little")
        + bytes(8)
        + data
        for channel, time_ns, data in messages
    )
    chunk = HandChunk(messages, compression, pack(compression, plain))
    with Container(HandFile([chunk]).write(tmp_path / "s.mcap")) as container:
        assert [m.data for m in container.messages()] == [data for _, _, data in messages]


@pytest.mark.parametrize("compression", list(CompressionType))
def test_files_of_the_mcap_library_are_read(tmp_path: Path, compression: CompressionType) -> None:
    with (tmp_path / "s.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=2000, compression=compression)
        writer.start()
        channel = writer.register_channel("/a", "raw", 0)
        for i in range(100):
            writer.add_message(channel, i, bytes([i]) * 100, i)
        writer.finish()
    with Container(tmp_path / "s.mcap") as container:
        assert [m.data[0] for m in container.messages(start_ns=10, stop_ns=20)] == [*range(10, 20)]
        assert container.times_ns("/a").tolist() == list(range(100))
        container.verify()


def test_a_sparse_giant_does_not_fill_the_memory(tmp_path: Path) -> None:
    # an honest index at the end of 8 GiB of nothing, in which a chunk claims to lie
    path = session_file(tmp_path, 1)
    data = path.read_bytes()
    chunk = record(path, Opcode.CHUNK)
    summary_start = record(path, Opcode.DATA_END).stop
    gap = 8 << 30
    inside = bytearray(data[: chunk.body + 36])
    inside[chunk.body + 32 : chunk.body + 36] = (0).to_bytes(4, "little")
    inside += gap.to_bytes(8, "little")
    out = tmp_path / "giant.mcap"
    footer = record(path, Opcode.FOOTER)
    end = bytearray(data[footer.start :])
    end[9:17] = (gap + len(inside) + 13).to_bytes(8, "little")
    end[25:29] = bytes(4)
    with out.open("wb") as stream:
        stream.write(inside)
        stream.truncate(gap + len(inside))
        stream.seek(0, os.SEEK_END)
        stream.write(b"\x0f" + (4).to_bytes(8, "little") + bytes(4))
        stream.write(data[summary_start : footer.start] + bytes(end))

    def verify(path: Path) -> None:
        with Container(path) as container:
            container.verify()

    with memory_below(64):
        refusal(out, verify)


# anything at all

Mutation = Callable[[bytes], bytes]


@st.composite
def mutations(draw: st.DrawFn) -> Mutation:
    """A thing that happens to files."""
    at = draw(st.floats(0, 1, exclude_max=True))
    length = draw(st.sampled_from([1, 1, 1, 2, 4, 8, 16, 100, 1000]))
    new = draw(st.binary(min_size=1, max_size=16))
    bit = draw(st.integers(0, 7))
    kind = draw(st.sampled_from(["flip", "overwrite", "fill", "cut", "drop", "insert", "double"]))

    def mutate(data: bytes) -> bytes:
        place = int(at * len(data))
        before, after = data[:place], data[place:]
        return {
            "flip": before + bytes([after[0] ^ (1 << bit)]) + after[1:],
            "overwrite": before + new + after[len(new) :],
            "fill": before + bytes([new[0]]) * min(length, len(after)) + after[length:],
            "cut": before,
            "drop": before + after[length:],
            "insert": before + new + after,
            "double": before + after[:length] + after,
        }[kind]

    return mutate


@pytest.fixture(scope="module")
def victim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small session with everything in it."""
    folder = tmp_path_factory.mktemp("victim")
    return session_file(folder, 3, readings=True, labelled=True, sync_each=True, skew_ns=1000)


@given(mutate=mutations())
@settings(
    max_examples=600,
    deadline=None,  # a busy machine is no failure
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # the folder is only overwritten
)
def test_whatever_happens_to_a_session_it_is_refused_or_right(
    victim: Path, tmp_path: Path, mutate: Mutation
) -> None:
    path = tmp_path / "victim.mcap"
    path.write_bytes(mutate(victim.read_bytes()))
    try:
        found = content(path)
    except PomologError:
        return
    assert found == content(victim)


LIMITED = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
from recorder.errors import PomologError
from recorder.session import Session
try:
    Session(Path(sys.argv[1])).verify()
except PomologError as error:
    print(error)
"""


def test_too_little_memory_for_a_file_is_one_line_too(tmp_path: Path) -> None:
    plain = bytes(200 * MIB)
    chunk = HandChunk([(1, 0, b"")], "zstd", zstandard.compress(plain), len(plain), 0)
    path = HandFile([chunk] * 3).write(tmp_path / "s.mcap")
    command = [sys.executable, "-c", LIMITED, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
