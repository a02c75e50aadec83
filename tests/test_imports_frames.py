from pathlib import Path

import cv2
import pytest

from recorder.errors import PomologError
from recorder.imports.frames import import_frames, picture_pairs, pictures_in
from recorder.records import Encoding
from recorder.session import Session, read_info
from tests.builders import SECOND_NS, encoded, picture, picture_folders, rig


def imported(tmp_path: Path, left: Path, right: Path, **options: object) -> Path:
    out = tmp_path / "s.mcap"
    import_frames(picture_pairs(left, right), rig(), out, **options)  # type: ignore[arg-type]
    return out


def refusal(tmp_path: Path, left: Path, right: Path, **options: object) -> str:
    """The one line of an import that fails, which must leave no file."""
    with pytest.raises(PomologError) as caught:
        imported(tmp_path, left, right, **options)
    assert not list(tmp_path.glob("s.mcap*"))
    return str(caught.value)


@pytest.mark.parametrize("kind", ["png", "jpeg"])
def test_pictures_are_kept_byte_for_byte_in_name_order(tmp_path: Path, kind: Encoding) -> None:
    left, right = picture_folders(tmp_path, 12, kind=kind)  # type: ignore[arg-type]
    with Session(imported(tmp_path, left, right)) as session:
        pairs = list(session.pairs())
    assert len(pairs) == 12
    for index, pair in enumerate(pairs):
        assert pair.left.data == encoded(kind, 2 * index)
        assert pair.right.data == encoded(kind, 2 * index + 1)
        assert pair.left.encoding == kind
        assert (pair.left.sequence, pair.time_ns) == (index, index * SECOND_NS)


def test_folders_are_paired_by_order_not_by_name(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 2)
    for index, name in enumerate(("b.png", "a.PNG")):
        (right / f"{1 - index:03d}.png").rename(right / name)
    (left / "notes.txt").write_text("not a picture")
    (left / ".hidden").write_text("nor this")
    pairs = picture_pairs(left, right)
    assert [(a.name, b.name) for a, b in pairs] == [("000.png", "a.PNG"), ("001.png", "b.png")]
    # "a.PNG" was 000, so that order and content agree
    with Session(imported(tmp_path, left, right)) as session:
        assert [pair.right.data for pair in session.pairs()] == [encoded(seed=1), encoded(seed=3)]


def test_two_files_are_one_pair(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 1)
    out = imported(tmp_path, left / "000.png", right / "000.png")
    assert read_info(out).pairs == 1


def test_png_jpeg_and_webp_may_be_mixed(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 1)
    (left / "001.jpg").write_bytes(encoded("jpeg", 5))
    (right / "001.webp").write_bytes(encoded("webp", 6))
    with Session(imported(tmp_path, left, right)) as session:
        kinds = [(pair.left.encoding, pair.right.encoding) for pair in session.pairs()]
    assert kinds == [("png", "png"), ("jpeg", "webp")]


def test_a_pictures_format_is_told_by_its_bytes_not_by_its_name(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 1)
    (left / "000.png").write_bytes(encoded("jpeg"))
    with Session(imported(tmp_path, left, right)) as session:
        (pair,) = session.pairs()
    assert (pair.left.encoding, pair.left.data) == ("jpeg", encoded("jpeg"))


@pytest.mark.parametrize(
    ("rate_hz", "step_ns"), [(1.0, SECOND_NS), (30.0, 33_333_333), (0.5, 2 * SECOND_NS)]
)
def test_the_rate_sets_the_times(tmp_path: Path, rate_hz: float, step_ns: int) -> None:
    left, right = picture_folders(tmp_path, 3)
    with Session(imported(tmp_path, left, right, rate_hz=rate_hz)) as session:
        assert session.pair_times_ns().tolist() == [[i * step_ns] * 2 for i in range(3)]


def test_one_word_for_the_light_goes_to_the_metadata(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 2)
    with Session(
        imported(tmp_path, left, right, lighting=["back"], metadata={"site": "x"})
    ) as session:
        assert session.metadata["lighting"] == "back"
        assert session.metadata["site"] == "x"
        assert list(session.notes()) == []


def test_a_word_a_pair_is_kept_as_notes_where_it_changes(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 4)
    words = ["front", "front", "back", "front"]
    with Session(imported(tmp_path, left, right, lighting=words)) as session:
        assert [(note.time_ns, note.text) for note in session.notes()] == [
            (0, "lighting=front"),
            (2 * SECOND_NS, "lighting=back"),
            (3 * SECOND_NS, "lighting=front"),
        ]
        assert [pair.conditions["lighting"] for pair in session.pairs()] == words
        assert [pair.conditions["lighting"] for pair in session.pairs(2, 4)] == words[2:]


def test_one_step_is_told_a_pair(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 3)
    steps = []
    imported(tmp_path, left, right, tick=lambda: steps.append(1))
    assert len(steps) == 3


# what is refused


def test_as_many_words_as_neither_one_nor_the_pairs_are_refused(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 3)
    assert "2 words for the lighting of 3 pairs" in refusal(
        tmp_path, left, right, lighting=["front", "back"]
    )


def test_folders_of_different_length_are_refused(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 3)
    (right / "001.png").unlink()
    line = refusal(tmp_path, left, right)
    assert f"3 pictures in {left} but 2 in {right}" in line


def test_a_folder_without_pictures_is_refused(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 1)
    (right / "000.png").unlink()
    assert f"no PNG, JPEG or WebP pictures in {right}" in refusal(tmp_path, left, right)


@pytest.mark.parametrize("missing", ["LEFT", "RIGHT"])
def test_a_place_that_is_not_there_is_named(tmp_path: Path, missing: str) -> None:
    left, right = picture_folders(tmp_path, 1)
    sides = (tmp_path / "no", right) if missing == "LEFT" else (left, tmp_path / "no")
    assert f"no {missing} pictures at {tmp_path / 'no'}" in refusal(tmp_path, *sides)


def test_a_picture_beside_a_folder_is_refused(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 1)
    assert "two pictures, or two folders" in refusal(tmp_path, left / "000.png", right)


@pytest.mark.parametrize("part", [0.3, 0.95])
@pytest.mark.parametrize("kind", ["png", "jpeg"])
def test_a_picture_cut_short_is_refused(tmp_path: Path, kind: Encoding, part: float) -> None:
    left, right = picture_folders(tmp_path, 2, kind=kind)  # type: ignore[arg-type]
    victim = sorted(right.iterdir())[1]
    victim.write_bytes(victim.read_bytes()[: int(part * victim.stat().st_size)])
    line = refusal(tmp_path, left, right)
    assert line.startswith(str(victim))
    assert "is it complete?" in line


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 2)
    (left / "000.png").write_bytes(b"")
    assert f"{left / '000.png'} is not a PNG" in refusal(tmp_path, left, right)


def test_a_folder_with_a_pictures_name_is_refused(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 1)
    (left / "000.png").unlink()
    (left / "000.png").mkdir()
    assert "cannot read" in refusal(tmp_path, left, right)


def test_left_and_right_of_different_size_are_refused(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 2)
    (right / "001.png").write_bytes(encoded(size_px=(64, 40)))
    line = refusal(tmp_path, left, right)
    assert "is 64 x 48 px and" in line
    assert "64 x 40; left and right must be of one size" in line


def test_pictures_of_another_size_than_the_rigs_are_refused(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 1, size_px=(64, 40))
    line = refusal(tmp_path, left, right)
    assert "64 x 40 px, but the rig's left camera has 64 x 48" in line


def test_a_file_that_was_there_stays_when_an_import_fails(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 2)
    out = imported(tmp_path, left, right)
    before = out.read_bytes()
    (right / "001.png").write_bytes(b"x")
    with pytest.raises(PomologError):
        imported(tmp_path, left, right)
    assert out.read_bytes() == before


def test_names_are_in_the_order_of_their_numbers_and_letters(tmp_path: Path) -> None:
    names = ["B2.webp", "B10.webp", "a.jpeg", "9.png", "10.png"]
    for name in reversed(names):
        cv2.imwrite(str(tmp_path / name), picture())
    assert [path.name for path in pictures_in(tmp_path)] == names
