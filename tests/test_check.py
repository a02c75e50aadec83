from pathlib import Path

import pytest

from recorder.check import Finding, check
from recorder.records import Frame, RangeReading
from recorder.session_writer import SessionWriter
from tests.builders import SECOND_NS, SIZE_PX, encoded, frame, real_rig, rig, session_file
from tests.mcap_files import flipped, torn


def texts(findings: tuple[Finding, ...], level: str) -> list[str]:
    return [finding.text for finding in findings if finding.level == level]


def test_a_sound_session_passes_with_what_was_looked_at(tmp_path: Path) -> None:
    steps = []
    path = session_file(tmp_path, 4, readings=True, labelled=True, skew_ns=2_000_000)
    found = check(path, lambda: steps.append(1))
    assert len(steps) == 4
    assert {finding.level for finding in found} == {"ok"}
    told = "\n".join(texts(found, "ok"))
    for words in (
        "every checksum agrees",
        "200.0 mm baseline, as recorded",
        "left: 1.00 frames a second, no gap",
        "right: 1.00 frames a second, no gap",
        "skew: median 2.00 ms, at most 2.00",
        "4 pairs decode",
        "truth for 4 of 4 pairs",
        "4 range readings, 4 of them near a pair",
    ):
        assert words in told


def test_a_real_rig_is_told_to_be_resampled(tmp_path: Path) -> None:
    path = session_file(tmp_path, 1, with_rig=real_rig(size_px=SIZE_PX))
    assert any("resampled to parallel views" in text for text in texts(check(path), "ok"))


def test_gaps_and_lone_frames_are_warnings(tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    with SessionWriter.create(path, rig()) as writer:
        for index in (0, 1, 2, 5, 6):
            writer.write_frame(frame("left", index * SECOND_NS))
            if index != 6:
                writer.write_frame(frame("right", index * SECOND_NS))
        writer.write_reading(RangeReading(4 * SECOND_NS, 1.0, None, "ok", ""))
    found = check(path)
    assert texts(found, "warning") == [
        "1 of 5 left frames have no partner",
        "left: 1.00 frames a second, 1 gaps, the longest 3.00 s",
        "right: 1.00 frames a second, 1 gaps, the longest 3.00 s",
    ]
    assert "1 range readings, 0 of them near a pair" in texts(found, "ok")
    assert texts(found, "failure") == []


@pytest.mark.parametrize(("last_s", "gaps"), [(3.4, 0), (3.6, 1)])
def test_a_gap_is_half_an_interval_more_than_the_usual(
    tmp_path: Path, last_s: float, gaps: int
) -> None:
    with SessionWriter.create(tmp_path / "s.mcap", rig()) as writer:
        for time_s in (0, 1, 2, last_s):
            writer.write_frame(frame("left", int(time_s * SECOND_NS)))
            writer.write_frame(frame("right", int(time_s * SECOND_NS)))
    warnings = texts(check(tmp_path / "s.mcap"), "warning")
    assert sum("1 gaps, the longest 1.60 s" in text for text in warnings) == 2 * gaps
    assert len(warnings) == 2 * gaps


def test_one_pair_has_no_rate(tmp_path: Path) -> None:
    assert texts(check(session_file(tmp_path, 1)), "warning") == []


@pytest.mark.parametrize("encoding", ["jpeg", "png"])
def test_a_picture_that_its_camera_cut_short_is_a_failure(tmp_path: Path, encoding: str) -> None:
    # OpenCV fills up a torn JPEG with grey and says nothing
    whole = encoded(encoding, size_px=(200, 160))  # type: ignore[arg-type]  # parametrised
    with SessionWriter.create(tmp_path / "s.mcap", rig((200, 160))) as writer:
        for side, data in (("left", whole), ("right", whole[: len(whole) * 3 // 4])):
            writer.write_frame(Frame(side, 0, encoding, data, (200, 160)))  # type: ignore[arg-type]
    (line,) = texts(check(tmp_path / "s.mcap"), "failure")
    assert "the right frame at 0 ns" in line
    assert "is it complete?" in line


def test_what_cannot_be_opened_is_one_failure(tmp_path: Path) -> None:
    whole = session_file(tmp_path, 2)
    size = whole.stat().st_size
    for path, words in (
        (tmp_path / "no.mcap", "cannot read"),
        (tmp_path, "is a folder"),
        (torn(whole, size // 2), "pomolog salvage"),
        (flipped(whole, size // 2), "is damaged"),
        (session_file(tmp_path, 0, name="empty.mcap"), "no /left/calibration"),
    ):
        (finding,) = check(path)
        assert finding.level == "failure"
        assert words in finding.text


def test_a_flipped_byte_that_no_reader_needs_is_found_all_the_same(tmp_path: Path) -> None:
    path = session_file(tmp_path, 1)
    at = path.read_bytes().index(b"pomolog", 30)  # in the header
    (finding,) = check(flipped(path, at))
    assert finding.level == "failure"


def test_the_demo_session_is_sound() -> None:
    path = Path(__file__).parents[1] / "sessions" / "demo.mcap"
    found = check(path)
    assert {finding.level for finding in found} == {"ok"}
