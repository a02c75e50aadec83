import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from recorder.container import Container
from recorder.errors import PomologError, TornFileError
from recorder.message_writer import CHUNK_BYTES, MessageWriter
from recorder.pictures import decode
from recorder.profile import encode_frame
from recorder.records import (
    SIDES,
    AppleTruth,
    Encoding,
    Frame,
    FrameTruth,
    Note,
    RangeReading,
    StereoPair,
)
from recorder.session import Session, read_info
from recorder.session_writer import SessionWriter
from tests.builders import (
    SECOND_NS,
    SIZE_PX,
    content,
    encoded,
    frame,
    labels,
    pair_content,
    real_rig,
    rig,
    session_file,
    truth,
)
from tests.mcap_files import HandChunk, HandFile


def only_pair(path: Path) -> StereoPair:
    with Session(path) as session:
        (pair,) = session.pairs()
    return pair


# what is written is what is read


@pytest.mark.parametrize("encoding", ["jpeg", "png", "webp", "bayer_rggb8", "bgr8"])
def test_a_frame_comes_back_byte_for_byte(tmp_path: Path, encoding: Encoding) -> None:
    path = session_file(tmp_path, 2, encoding=encoding)
    with Session(path) as session:
        pairs = list(session.pairs())
        assert session.raw_images == (encoding in ("bayer_rggb8", "bgr8"))
    for index, pair in enumerate(pairs):
        for place, found in enumerate((pair.left, pair.right)):
            assert found.data == encoded(encoding, 2 * index + place)
            assert found.encoding == encoding
            assert found.size_px == SIZE_PX
            assert found.time_ns == index * SECOND_NS
            assert found.sequence == index
            assert found.side == ("left", "right")[place]
            assert decode(found).shape == (48, 64, 3)


@pytest.mark.parametrize("lens", ["plumb_bob", "rational_polynomial", "kannala_brandt"])
def test_a_rig_with_lenses_rotation_and_rangefinder_comes_back(tmp_path: Path, lens: str) -> None:
    before = real_rig(lens, size_px=SIZE_PX, beam=True)  # type: ignore[arg-type]  # parametrised
    with Session(session_file(tmp_path, 1, with_rig=before)) as session:
        after = session.rig
    for one, other in ((before.left, after.left), (before.right, after.right)):
        assert one.size_px == other.size_px
        assert one.lens == other.lens
        assert np.array_equal(one.matrix, other.matrix)
        assert np.array_equal(one.distortion, other.distortion)
    # a rotation passes through a quaternion of doubles: a few units in the last place
    assert np.allclose(before.rotation, after.rotation, rtol=0, atol=1e-14)
    assert np.allclose(before.translation_m, after.translation_m, rtol=0, atol=1e-14)
    assert before.rangefinder is not None
    assert after.rangefinder is not None
    assert np.array_equal(before.rangefinder.origin_m, after.rangefinder.origin_m)
    # the beam's turn is found by a singular value decomposition: about 1e-9 of a radian
    assert np.allclose(before.rangefinder.direction, after.rangefinder.direction, atol=1e-8)
    assert after.rangefinder.std_m == 0.002


def test_a_beam_along_the_optical_axis_comes_back(tmp_path: Path) -> None:
    straight = rig(beam=True)
    assert straight.rangefinder is not None
    straight.rangefinder.direction[:] = (0, 0, 1)
    with Session(session_file(tmp_path, 1, with_rig=straight)) as session:
        assert session.rig.rangefinder is not None
        assert np.allclose(session.rig.rangefinder.direction, (0, 0, 1), atol=1e-12)


def test_a_rig_without_rangefinder_comes_back_without(tmp_path: Path) -> None:
    with Session(session_file(tmp_path, 1)) as session:
        assert session.rig.rangefinder is None


def test_readings_come_back_with_what_is_absent_absent(tmp_path: Path) -> None:
    readings = [
        RangeReading(0, 1.25, 0.001, "ok", "g0g+00012500"),
        RangeReading(1, None, None, "no echo", "g0@E255"),
        RangeReading(2, 0.0, 0.0, "ok", "", apple_id=0),
        RangeReading(3, 2.5, None, "ok", "äpfel\n", apple_id=7),
    ]
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        for reading in readings:
            writer.write_reading(reading)
    with Session(tmp_path / "s.mcap") as session:
        assert list(session.readings()) == readings


@pytest.mark.parametrize(
    "known",
    [
        FrameTruth(),
        FrameTruth(left=labels()),
        FrameTruth(right=labels()),
        FrameTruth(labels(), labels(1), (), partial=True),
        FrameTruth(labels(), labels(1), identified=False),
        FrameTruth(
            labels(),
            labels(1),
            (
                AppleTruth(1, (0.1, -0.2, 1.3), 0.04),
                AppleTruth(2, (0, 0, 2), 0.03, 0.0, 1.0, "surface"),
                AppleTruth(65534, (-1, 1, 9), 0.05, None, 0.5),
            ),
        ),
    ],
    ids=["nothing", "left", "right", "no apples, partial", "masks", "apples"],
)
def test_truth_comes_back_with_what_is_unsaid_unsaid(tmp_path: Path, known: FrameTruth) -> None:
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        writer.write_frame(frame("left"))
        writer.write_frame(frame("right"))
        writer.write_truth(0, known)
    found = only_pair(tmp_path / "s.mcap").truth
    assert found is not None
    for one, other in ((known.left, found.left), (known.right, found.right)):
        assert (one is None) == (other is None)
        if one is not None:
            assert np.array_equal(one, other)  # type: ignore[arg-type]  # not None by the line above
            assert other is not None
            assert other.dtype == np.uint16
    assert (known.apples, known.partial, known.identified) == (
        found.apples, found.partial, found.identified,
    )  # fmt: skip


def test_a_pair_of_which_nobody_said_anything_has_no_truth(tmp_path: Path) -> None:
    assert only_pair(session_file(tmp_path, 1)).truth is None


def test_truth_finds_both_views_of_a_pair_with_skew(tmp_path: Path) -> None:
    for skew_ns in (3_000_000, -3_000_000):
        path = tmp_path / "s.mcap"
        with SessionWriter.create(path, rig()) as writer:
            writer.write_frame(frame("left", SECOND_NS))
            writer.write_frame(frame("right", SECOND_NS + skew_ns))
            writer.write_truth(SECOND_NS, truth())
        found = only_pair(path).truth
        assert found is not None
        assert np.array_equal(found.left, labels(0))  # type: ignore[arg-type]  # fails if None
        assert np.array_equal(found.right, labels(1))  # type: ignore[arg-type]  # as above


def test_notes_come_back_and_set_conditions_from_their_time_on(tmp_path: Path) -> None:
    notes = [Note(0, "lighting=back"), Note(SECOND_NS, "a bird = nice"), Note(SECOND_NS, "wind=3")]
    with SessionWriter.create(tmp_path / "s.mcap", rig(), {"lighting": "front"}) as writer:
        for note in notes:
            writer.write_note(note)
        for index in range(3):
            writer.write_frame(frame("left", index * SECOND_NS - (index == 1)))
            writer.write_frame(frame("right", index * SECOND_NS))
    with Session(tmp_path / "s.mcap") as session:
        assert list(session.notes()) == notes
        said = [dict(pair.conditions) for pair in session.pairs()]
    assert said == [
        {"lighting": "back"},
        {"lighting": "back"},  # a nanosecond before the note
        {"lighting": "back", "wind": "3"},
    ]


@pytest.mark.parametrize(
    ("text", "condition"),
    [
        ("lighting=back", ("lighting", "back")),
        (" lighting = back light ", ("lighting", "back light")),
        ("a=b=c", ("a", "b=c")),
        ("two words=x", None),
        ("lighting=", None),
        ("=back", None),
        ("a remark", None),
        ("", None),
    ],
)
def test_a_note_of_key_and_value_is_a_condition(
    text: str, condition: tuple[str, str] | None
) -> None:
    assert Note(0, text).condition == condition


def test_metadata_come_back_without_our_own_checksum(tmp_path: Path) -> None:
    about = {"lighting": "front", "cultivar": "Gölden, Delicious", "site": "row 3\nwest", "x": ""}
    with Session(session_file(tmp_path, 1, metadata=about)) as session:
        assert {key: session.metadata[key] for key in about} == about
        assert session.metadata["profile"] == "pomolog/1"
        assert session.metadata["rig"] == rig().digest
        assert "crc32" not in session.metadata
        assert session.ledger == {}
        (pair,) = session.pairs()
        assert pair.conditions == about


def test_the_ledger_comes_back(tmp_path: Path) -> None:
    with (tmp_path / "s.mcap").open("wb") as stream:
        writer = SessionWriter(stream, rig())
        writer.write_frame(frame())
        writer.finish({"left.dropped": "3", "right.late": "0"})
    info = read_info(tmp_path / "s.mcap")
    assert info.ledger == {"left.dropped": "3", "right.late": "0"}


def test_info_counts_what_the_session_holds(tmp_path: Path) -> None:
    info = read_info(session_file(tmp_path, 4, readings=True, labelled=True))
    assert (info.profile, info.frames, info.pairs, info.whole) == ("pomolog/1", 8, 4, True)
    assert info.topics == {
        "/left/image": 4, "/right/image": 4, "/left/calibration": 1, "/right/calibration": 1,
        "/tf": 1, "/rangefinder": 4, "/truth/left": 4, "/truth/right": 4, "/truth/apples": 4,
    }  # fmt: skip
    assert (info.start_ns, info.end_ns) == (0, 3 * SECOND_NS + 1000)


def test_a_session_of_nothing_has_no_times(tmp_path: Path) -> None:
    info = read_info(session_file(tmp_path, 0))
    assert (info.frames, info.pairs, info.start_ns, info.end_ns, info.topics) == (
        0, 0, None, None, {},
    )  # fmt: skip


def test_the_fingerprint_changes_with_a_byte_of_a_picture(tmp_path: Path) -> None:
    one = session_file(tmp_path, 1, name="one.mcap", encoding="bgr8")
    with SessionWriter.create(
        tmp_path / "other.mcap", rig(), {"lighting": "front", "cultivar": "Fuji"}, raw_images=True
    ) as writer:
        writer.write_frame(frame("left", encoding="bgr8"))
        data = bytearray(encoded("bgr8", 1))
        data[-1] ^= 1
        writer.write_frame(Frame("right", 0, "bgr8", bytes(data), SIZE_PX))
    with Session(one) as a, Session(tmp_path / "other.mcap") as b, Session(one) as again:
        assert a.fingerprint != b.fingerprint
        assert a.fingerprint == again.fingerprint


# pairs


def test_pairs_are_made_by_time_and_the_unpaired_left_out(tmp_path: Path) -> None:
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        for time_ns in (0, 1 * SECOND_NS, 2 * SECOND_NS):
            writer.write_frame(frame("left", time_ns, seed=time_ns // SECOND_NS))
        for time_ns in (2 * SECOND_NS + 4_000_000, 4_000_000, SECOND_NS + 6_000_000):
            writer.write_frame(frame("right", time_ns, seed=10 + time_ns // SECOND_NS))
    with Session(tmp_path / "s.mcap") as session:
        assert len(session) == 2  # the middle two are 6 ms apart, more than 5
        assert session.pair_times_ns().tolist() == [
            [0, 4_000_000], [2 * SECOND_NS, 2 * SECOND_NS + 4_000_000],
        ]  # fmt: skip
        assert session.times_ns("left").tolist() == [0, SECOND_NS, 2 * SECOND_NS]
        pairs = list(session.pairs())
    assert [pair.index for pair in pairs] == [0, 1]
    assert [pair.left.data for pair in pairs] == [encoded(seed=0), encoded(seed=2)]
    assert [pair.right.data for pair in pairs] == [encoded(seed=10), encoded(seed=12)]


def test_the_largest_skew_can_be_set_in_the_metadata(tmp_path: Path) -> None:
    path = session_file(tmp_path, 2, skew_ns=7_000_000, metadata={"max_skew_ns": "7000000"})
    with Session(path) as session:
        assert len(session) == 2


def test_slices_of_pairs_are_the_whole(tmp_path: Path) -> None:
    path = session_file(
        tmp_path, 5, readings=True, labelled=True, skew_ns=2_000_000, sync_each=True
    )
    with Session(path) as session:
        whole = [pair_content(pair) for pair in session.pairs()]
        assert len(whole) == 5
        for start in range(6):
            for stop in range(start, 7):
                part = [pair_content(pair) for pair in session.pairs(start, stop)]
                assert part == whole[start:stop]


def test_slices_of_a_fast_session_are_the_whole(tmp_path: Path) -> None:
    # 100 pairs a second: the windows of neighbouring pairs overlap fifty times
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        for index in range(30):
            writer.write_frame(frame("left", index * 10_000_000))
            writer.write_frame(frame("right", index * 10_000_000 + 1_000_000))
            writer.write_reading(RangeReading(index * 10_000_000 + 6_000_000, 1.0, 0.1, "ok", ""))
    with Session(tmp_path / "s.mcap") as session:
        whole = [pair_content(pair) for pair in session.pairs()]
        parts = [
            pair_content(p) for start in range(0, 30, 7) for p in session.pairs(start, start + 7)
        ]
    assert parts == whole
    # the reading 6 ms after a left frame is nearer to the next one, but for the last
    assert [len(pair[2]) for pair in whole] == [0] + [1] * 28 + [2]


def test_a_reading_belongs_to_the_nearest_pair_within_half_a_second(tmp_path: Path) -> None:
    half = SECOND_NS // 2
    times = [half - 1, half, 3 * half - 1, 3 * half + 1, 7 * half, 7 * half + 1]
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        for index in range(1, 4):
            writer.write_frame(frame("left", index * SECOND_NS))
            writer.write_frame(frame("right", index * SECOND_NS))
        for time_ns in times:
            writer.write_reading(RangeReading(time_ns, 1.0, None, "ok", ""))
    with Session(tmp_path / "s.mcap") as session:
        near = [[reading.time_ns for reading in pair.readings] for pair in session.pairs()]
        assert len(list(session.readings())) == 6
    assert near == [[half, 3 * half - 1], [3 * half + 1], [7 * half]]


def test_messages_written_out_of_order_are_read_in_the_order_of_time(tmp_path: Path) -> None:
    order = [5, 0, 3, 1, 4, 2]
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        for index in order:
            writer.write_frame(frame("left", index * SECOND_NS, seed=index))
            writer.write_frame(frame("right", index * SECOND_NS, seed=index))
            writer.sync()  # each in its own chunk, so that chunks are out of order too
    with Session(tmp_path / "s.mcap") as session:
        times = [message.log_ns for message in session.messages()]
        assert times == sorted(times)
        assert [pair.left.data for pair in session.pairs()] == [encoded(seed=i) for i in range(6)]


def test_no_chunk_is_larger_than_4_mib(tmp_path: Path) -> None:
    large = rig((1024, 700), focal_px=900)
    path = session_file(tmp_path, 3, with_rig=large, encoding="bgr8")  # 2.1 MB a frame
    with SessionWriter.create(tmp_path / "small.mcap", rig()) as writer:
        for index in range(70_000):  # many small messages, whose headers weigh as much as they do
            writer.write_note(Note(index, "leaf " * 8))
    for file in (path, tmp_path / "small.mcap"):
        with Container(file) as container:
            sizes = [index.uncompressed_size for index in container.index.chunks]
        assert len(sizes) > 1
        assert max(sizes) <= CHUNK_BYTES == 4 * 1024 * 1024


READER = """
import resource, sys
from pathlib import Path
from recorder.session import Session
path, stop = Path(sys.argv[1]), int(sys.argv[2])
with Session(path) as session:
    count = sum(len(pair.left.data) > 0 for pair in session.pairs(0, stop))
print(count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def test_reading_a_long_session_takes_no_more_memory_than_a_short_one(tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    large = rig((1024, 700), focal_px=900)
    left, right = (frame(s, 0, "bgr8", size_px=(1024, 700)) for s in ("left", "right"))
    with SessionWriter.create(path, large, raw_images=True) as writer:
        for index in range(40):  # 172 MB
            for one in (left, right):
                time_ns = index * SECOND_NS
                writer.write_frame(Frame(one.side, time_ns, "bgr8", one.data, one.size_px))
    peaks_mib = []
    for stop in (2, 40):
        command = [sys.executable, "-c", READER, str(path), str(stop)]
        found = subprocess.run(command, check=True, capture_output=True, text=True)
        count, peak_kib = map(int, found.stdout.split())
        assert count == stop
        peaks_mib.append(peak_kib / 1024)
    # a few chunks are under way at once; all 40 pairs would be 172 MB
    assert peaks_mib[1] - peaks_mib[0] < 40


# what a session refuses


def test_a_frame_of_another_size_than_the_rigs_is_refused(tmp_path: Path) -> None:
    with (
        pytest.raises(PomologError, match=r"64 x 40 px, but the rig's left camera has 64 x 48"),
        SessionWriter.create(tmp_path / "s.mcap", rig()) as writer,
    ):
        writer.write_frame(frame(size_px=(64, 40)))
    assert list(tmp_path.iterdir()) == []


def test_raw_and_compressed_frames_do_not_mix(tmp_path: Path) -> None:
    with (
        pytest.raises(PomologError, match="cannot be mixed"),
        SessionWriter.create(tmp_path / "s.mcap", rig()) as writer,
    ):
        writer.write_frame(frame("left", encoding="bgr8"))


@pytest.mark.parametrize("missing", ["left", "right"])
def test_a_view_without_frames_is_named(tmp_path: Path, missing: str) -> None:
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        writer.write_frame(frame("right" if missing == "left" else "left"))
    with Session(tmp_path / "s.mcap") as session:
        assert len(session) == 0
        with pytest.raises(PomologError, match=rf"no /{missing}/image among the 1 frames of .*s"):
            list(session.pairs())


def test_frames_that_never_meet_are_told_apart_from_missing_ones(tmp_path: Path) -> None:
    path = session_file(tmp_path, 2, skew_ns=SECOND_NS // 3)
    with (
        Session(path) as session,
        pytest.raises(PomologError, match="frames within 5 ms"),
    ):
        list(session.pairs())


def test_a_session_without_calibration_says_so(tmp_path: Path) -> None:
    with (tmp_path / "s.mcap").open("wb") as stream:
        writer = MessageWriter(stream, {})
        for side in SIDES:
            writer.write(f"/{side}/image", 0, encode_frame(frame(side)).SerializeToString())
        writer.finish()
    with (
        Session(tmp_path / "s.mcap") as session,
        pytest.raises(PomologError, match=r"no /left/calibration in .*s\.mcap; import .* --rig"),
    ):
        list(session.pairs())


def test_a_picture_of_another_size_than_its_calibration_is_refused(tmp_path: Path) -> None:
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        writer.write_frame(frame("left"))
        writer._write("/right/image", 0, encode_frame(frame("right", size_px=(64, 40))))
    with Session(tmp_path / "s.mcap") as session, pytest.raises(PomologError, match="64 x 40"):
        list(session.pairs())


def test_a_newer_profile_asks_for_a_newer_pomolog(tmp_path: Path) -> None:
    path = HandFile([HandChunk()], metadata={"profile": "pomolog/2"}).write(tmp_path / "s.mcap")
    with pytest.raises(PomologError, match=r"profile pomolog/2, newer .* update pomolog"):
        Session(path)


def test_another_mcap_is_no_session_and_its_topics_are_told(tmp_path: Path) -> None:
    path = HandFile([HandChunk()], {1: "/imu"}, metadata={}, profile="ros2").write(
        tmp_path / "s.mcap"
    )
    with pytest.raises(PomologError, match=r"no pomolog session \(topics: /imu\)"):
        Session(path)


def test_a_writer_that_fails_leaves_nothing(tmp_path: Path) -> None:
    with (
        pytest.raises(ZeroDivisionError),
        SessionWriter.create(tmp_path / "s.mcap", rig()) as writer,
    ):
        writer.write_frame(frame("left", 1 // int(writer is None)))
    assert list(tmp_path.iterdir()) == []


def test_what_was_synced_survives_a_cut(tmp_path: Path) -> None:
    stream = (tmp_path / "torn.mcap").open("wb")
    writer = SessionWriter(stream, rig())
    writer.write_frame(frame("left"))
    writer.write_frame(frame("right"))
    writer.sync()
    so_far = (tmp_path / "torn.mcap").read_bytes()  # before the stream is closed
    stream.close()
    (tmp_path / "cut.mcap").write_bytes(so_far)
    with pytest.raises(TornFileError, match=r"try: pomolog salvage .*cut\.mcap"):
        Session(tmp_path / "cut.mcap")
    from recorder.salvage import salvage

    salvage(tmp_path / "cut.mcap", tmp_path / "whole.mcap")
    assert only_pair(tmp_path / "whole.mcap").right.data == encoded()


def test_a_closed_session_holds_no_file(tmp_path: Path) -> None:
    path = session_file(tmp_path, 1)
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(3):
        content(path)
        with pytest.raises(PomologError):
            Session(tmp_path)
    assert len(list(Path("/proc/self/fd").iterdir())) == before
