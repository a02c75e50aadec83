import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from recorder.errors import PomologError
from recorder.imports.masks import MaskTruth, label_session
from recorder.records import AppleTruth, FrameTruth
from recorder.salvage import salvage
from recorder.session import Session
from tests.builders import content, labels, session_file
from tests.test_salvage import chunk_ends

APPLE = {
    "id": 1, "centre_m": [0.1, -0.2, 1.3], "radius_m": 0.04,
    "left": {"visible_fraction": 0.9}, "right": {"visible_fraction": 0.5},
}  # fmt: skip


def masks(folder: Path, pairs: int = 3, sides: tuple[str, ...] = ("left", "right")) -> Path:
    """A folder of 16-bit labels, which differ from frame to frame and side to side."""
    for side in sides:
        (folder / "masks" / side).mkdir(parents=True)
        for index in range(pairs):
            place = folder / "masks" / side / f"{index:03d}.png"
            cv2.imwrite(str(place), labels(2 * index + (side == "right")))
    return folder / "masks"


def labelled(tmp_path: Path, truth: MaskTruth, session: Path | None = None) -> list[FrameTruth]:
    with Session(session or session_file(tmp_path)) as opened:
        label_session(opened, truth, tmp_path / "t.mcap")
    with Session(tmp_path / "t.mcap") as opened:
        opened.verify()
        found = [pair.truth for pair in opened.pairs()]
    return [truth for truth in found if truth is not None]


def refusal(tmp_path: Path, folder: Path, apples: Path | None = None) -> str:
    session = session_file(tmp_path)
    with pytest.raises(PomologError) as caught, Session(session) as opened:
        label_session(opened, MaskTruth(folder, apples), tmp_path / "t.mcap")
    assert not list(tmp_path.glob("t.mcap*"))
    line = str(caught.value)
    assert "\n" not in line
    return line


def apples_file(tmp_path: Path, entries: Any) -> Path:
    path = tmp_path / "apples.json"
    path.write_text(entries if isinstance(entries, str) else json.dumps(entries))
    return path


def test_sixteen_bit_labels_are_kept_value_by_value(tmp_path: Path) -> None:
    found = labelled(tmp_path, MaskTruth(masks(tmp_path)))
    assert len(found) == 3
    for index, truth in enumerate(found):
        assert truth.left is not None
        assert truth.right is not None
        assert np.array_equal(truth.left, labels(2 * index))
        assert np.array_equal(truth.right, labels(2 * index + 1))
        assert (truth.apples, truth.partial, truth.identified) == (None, False, True)


def test_one_view_alone_is_allowed(tmp_path: Path) -> None:
    found = labelled(tmp_path, MaskTruth(masks(tmp_path, sides=("right",))))
    assert [(t.left is None, t.right is None) for t in found] == [(True, False)] * 3


def test_labels_find_both_views_of_pairs_with_skew(tmp_path: Path) -> None:
    session = session_file(tmp_path, 3, skew_ns=2_000_000)
    found = labelled(tmp_path, MaskTruth(masks(tmp_path)), session)
    assert [truth.right is not None for truth in found] == [True] * 3


def mask_file(kind: str) -> bytes:
    """An apple as a mask of 8 bits, or of 1 bit as image editors write it."""
    known = (labels() == 1).astype(np.uint8) * 255
    stream = io.BytesIO()
    Image.fromarray(known).convert({"8-bit": "L", "1-bit": "1"}[kind]).save(stream, "PNG")
    return stream.getvalue()


@pytest.mark.parametrize("kind", ["8-bit", "1-bit"])
def test_plain_masks_say_apple_but_not_which(tmp_path: Path, kind: str) -> None:
    folder = masks(tmp_path, sides=("left",))
    for path in (folder / "left").iterdir():
        path.write_bytes(mask_file(kind))
    for truth in labelled(tmp_path, MaskTruth(folder)):
        assert truth.left is not None
        assert truth.left.dtype == np.uint16
        assert np.array_equal(truth.left, (labels() == 1).astype(np.uint16))
        assert not truth.identified


def test_an_empty_mask_says_that_there_is_no_apple(tmp_path: Path) -> None:
    folder = masks(tmp_path, sides=("left",))
    for path in (folder / "left").iterdir():
        cv2.imwrite(str(path), np.zeros((48, 64), np.uint8))
    for truth in labelled(tmp_path, MaskTruth(folder)):
        assert truth.left is not None
        assert not truth.left.any()


def test_partial_is_kept(tmp_path: Path) -> None:
    found = labelled(tmp_path, MaskTruth(masks(tmp_path), partial=True))
    assert [truth.partial for truth in found] == [True] * 3


def test_labelling_keeps_all_else_as_it_was(tmp_path: Path) -> None:
    session = session_file(tmp_path, 3, readings=True, skew_ns=1000, sync_each=True)
    before = content(session)
    labelled(tmp_path, MaskTruth(masks(tmp_path)), session)
    after = content(tmp_path / "t.mcap")
    for key in ("metadata", "ledger", "rig", "readings", "notes"):
        assert after[key] == before[key]
    assert [pair[:3] for pair in after["pairs"]] == [pair[:3] for pair in before["pairs"]]


def test_unpaired_frames_are_kept_and_get_no_truth(tmp_path: Path) -> None:
    from recorder.session_writer import SessionWriter
    from tests.builders import SECOND_NS, frame, rig

    session = tmp_path / "s.mcap"
    with SessionWriter.create(session, rig()) as writer:
        for index in (0, 1, 2):
            writer.write_frame(frame("left", index * SECOND_NS, seed=index))
            if index != 1:
                writer.write_frame(frame("right", index * SECOND_NS, seed=index))
    found = labelled(tmp_path, MaskTruth(masks(tmp_path, 2)), session)
    assert [np.array_equal(t.left, labels(2 * i)) for i, t in enumerate(found)] == [True, True]  # type: ignore[arg-type]  # fails if None
    with Session(tmp_path / "t.mcap") as opened:
        assert len(opened.times_ns("left")) == 3


def test_older_truth_is_replaced(tmp_path: Path) -> None:
    session = session_file(tmp_path, 3, labelled=True)
    found = labelled(tmp_path, MaskTruth(masks(tmp_path, sides=("left",))), session)
    assert [(truth.right, truth.apples) for truth in found] == [(None, None)] * 3


def test_a_session_can_be_labelled_in_place(tmp_path: Path) -> None:
    session = session_file(tmp_path)
    with Session(session) as opened:
        label_session(opened, MaskTruth(masks(tmp_path)), session)
    with Session(session) as opened:
        assert [pair.truth is not None for pair in opened.pairs()] == [True] * 3


# apples


def test_apples_are_kept_with_what_is_unsaid_unsaid(tmp_path: Path) -> None:
    entries = [
        [APPLE, {"id": 2, "centre_m": [0, 0, 1], "radius_m": 0.03, "colour": "red"}],
        [],
        [
            {**APPLE, "id": 65534, "left": None, "truth_point": "surface"},
            {**APPLE, "right": {}},
        ],
    ]
    found = labelled(tmp_path, MaskTruth(masks(tmp_path), apples_file(tmp_path, entries)))
    assert [truth.apples for truth in found] == [
        (
            AppleTruth(1, (0.1, -0.2, 1.3), 0.04, 0.9, 0.5),
            AppleTruth(2, (0.0, 0.0, 1.0), 0.03, None, None),
        ),
        (),
        (
            AppleTruth(65534, (0.1, -0.2, 1.3), 0.04, 0.0, 0.5, "surface"),  # null: not in view
            AppleTruth(1, (0.1, -0.2, 1.3), 0.04, 0.9, None),  # in view, how much is unsaid
        ),
    ]


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("", "is not JSON"),
        ({}, "must be a list"),
        ([[APPLE], [], {}], "(2)"),
        ([[APPLE], []], "2 frames, but"),
        ([[APPLE], [], [], []], "4 frames, but"),
        ([[{**APPLE, "id": 0}], [], []], "(0, 0, id)"),
        ([[{**APPLE, "id": 65535}], [], []], "(0, 0, id)"),
        ([[], [{**APPLE, "radius_m": -1}], []], "(1, 0, radius_m)"),
        ([[{**APPLE, "radius_m": 40}], [], []], "(0, 0, radius_m)"),
        ([[{**APPLE, "centre_m": [0, 0]}], [], []], "(0, 0, centre_m"),
        ('[[{"id": 1, "centre_m": [0, 0, NaN], "radius_m": 0.04}], [], []]', "(0, 0, centre_m, 2)"),
        ([[{**APPLE, "left": {"visible_fraction": 2}}], [], []], "(0, 0, left, visible_fraction)"),
        ('[[{"id":1,"centre_m":[0,0,1],"radius_m":0.04,"left":{"visible_fraction":NaN}}],[],[]]',
         "(0, 0, left, visible_fraction)"),
        ([[{**APPLE, "truth_point": "stem"}], [], []], "(0, 0, truth_point)"),
        ([[], [APPLE, APPLE], []], "frame 1: an apple's id stands twice"),
    ],
)  # fmt: skip
def test_a_mistake_in_the_list_of_apples_is_told_by_its_place(
    tmp_path: Path, entries: Any, words: str
) -> None:
    assert words in refusal(tmp_path, masks(tmp_path), apples_file(tmp_path, entries))


def test_a_list_of_apples_that_is_not_there_is_named(tmp_path: Path) -> None:
    line = refusal(tmp_path, masks(tmp_path), tmp_path / "no.json")
    assert "cannot read" in line
    assert "no.json" in line


def test_a_list_of_apples_that_is_no_text_is_named(tmp_path: Path) -> None:
    (tmp_path / "apples.json").write_bytes(b"\xff\xfe\x00")
    assert "is not JSON" in refusal(tmp_path, masks(tmp_path), tmp_path / "apples.json")


# masks that do not fit


@pytest.mark.parametrize("count", [2, 4])
def test_as_many_masks_as_pairs_are_needed(tmp_path: Path, count: int) -> None:
    line = refusal(tmp_path, masks(tmp_path, count))
    assert f"has {count} frames" in line
    assert "has 3 stereo pairs" in line


def test_a_folder_without_left_or_right_is_refused(tmp_path: Path) -> None:
    assert "no left or right folder of masks" in refusal(tmp_path, tmp_path)


def test_a_folder_of_no_masks_is_refused(tmp_path: Path) -> None:
    (tmp_path / "masks" / "left").mkdir(parents=True)
    assert "no PNG" in refusal(tmp_path, tmp_path / "masks")


def half(data: bytes) -> bytes:
    return data[: len(data) // 2]


def flipped(data: bytes) -> bytes:
    return data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 1]) + data[len(data) // 2 + 1 :]


def png(mask: Any) -> bytes:
    done, data = cv2.imencode(".png", mask)
    assert done
    return data.tobytes()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is not a PNG"),
        (b"hello", "is not a PNG"),
        (half(png(labels())), "is it complete?"),
        (png(labels())[:-20], "is it complete?"),
        (flipped(png(labels())), "is it complete?"),
        (png(np.zeros((48, 64, 3), np.uint8)), "is no mask"),
        (png(np.zeros((40, 64), np.uint16)), "is 64 x 40 px, its picture 64 x 48"),
        (png(np.zeros((64, 48), np.uint16)), "is 48 x 64 px, its picture 64 x 48"),
        (png(np.full((48, 64), 7, np.uint8)), "other values than 0 and 255"),
    ],
    ids=["empty", "text", "half", "no end", "flipped", "colour", "small", "turned", "values"],
)
def test_a_mask_that_does_not_fit_is_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], data: bytes, words: str
) -> None:
    folder = masks(tmp_path)
    (folder / "right" / "001.png").write_bytes(data)
    line = refusal(tmp_path, folder)
    assert line.startswith(str(folder / "right" / "001.png"))
    assert words in line
    assert capfd.readouterr().err == ""  # OpenCV itself must not add lines of its own


def test_a_jpeg_is_no_mask(tmp_path: Path) -> None:
    folder = masks(tmp_path, sides=("left",))
    cv2.imwrite(str(folder / "left" / "000.jpg"), (labels() == 1).astype(np.uint8) * 255)
    (folder / "left" / "000.png").unlink()
    assert "000.jpg is no mask" in refusal(tmp_path, folder)


def test_a_labelled_session_keeps_its_rig_in_a_small_first_chunk(tmp_path: Path) -> None:
    session, out = session_file(tmp_path), tmp_path / "labelled.mcap"
    with Session(session) as opened:
        label_session(opened, MaskTruth(masks(tmp_path)), out)
    first, *_ = chunk_ends(out)
    data = out.read_bytes()
    (tmp_path / "torn.mcap").write_bytes(data[: first + 10])
    wreck = salvage(tmp_path / "torn.mcap", tmp_path / "whole.mcap")
    assert set(wreck.counts) == {"/left/calibration", "/right/calibration", "/tf"}
