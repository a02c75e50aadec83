import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from processor.cli import app
from recorder.errors import PomologError
from recorder.exports.frames import export_frames
from recorder.imports.coco import read_coco
from recorder.imports.frames import import_frames, picture_pairs, single_pictures
from recorder.imports.labels import LabelTruth
from recorder.imports.masks import label_session
from recorder.one_view import ONE_VIEW, nominal_camera, one_view_rig
from recorder.pictures import decode
from recorder.records import Depth, Encoding, FrameTruth, Outline
from recorder.rig import load_rig
from recorder.session import Session
from recorder.session_writer import SessionWriter
from tests.builders import (
    SECOND_NS,
    frame,
    labels,
    pair_content,
    real_rig,
    rig,
    session_file,
    truth,
)

OUTLINES = (
    Outline("left", 7, "box", 3.25, -0.5, 10.5, 12.0),
    Outline("left", 9, "circle", 20.0, 20.125, 8.0, 8.0),
    Outline("left", 65535, "box", 40.0, 30.0, 5.0, 6.0),
)


def exported(session: Path, out: Path) -> Path:
    with Session(session) as opened:
        export_frames(opened, out)
    return out


def returned(folder: Path, out: Path) -> Path:
    """A session of an exported folder, labelled by its COCO."""
    plain = out.with_name("plain.mcap")
    pairs = picture_pairs(folder / "left", folder / "right")
    import_frames(pairs, load_rig(folder / "rig.toml"), plain)
    with Session(plain) as session:
        label_session(session, LabelTruth(session, read_coco(folder / "coco.json")), out)
    return out


def with_truths(path: Path, truths: Sequence[FrameTruth | None]) -> Path:
    with SessionWriter.create(path, rig()) as writer:
        for index, known in enumerate(truths):
            for side in ("left", "right"):
                made = frame(time_ns=index * SECOND_NS, seed=index, sequence=index)
                writer.write_frame(replace(made, side=side))
            if known is not None:
                writer.write_truth(index * SECOND_NS, known)
    return path


def content_of(path: Path) -> list[tuple[Any, ...]]:
    with Session(path) as session:
        return [
            (*pair_content(pair), pair.truth and (pair.truth.shared, pair.truth.left_outlines,
                                                  pair.truth.right_outlines))
            for pair in session.pairs()
        ]  # fmt: skip


@pytest.mark.parametrize(
    "truths",
    [
        [truth(0), None, truth(1, partial=True)],
        [truth(0, shared=False), FrameTruth(labels(1), None, shared=False)],
        [FrameTruth(np.minimum(labels(0), 1), identified=False, shared=False)],
        [
            FrameTruth(left_outlines=OUTLINES, right_outlines=()),
            FrameTruth(left_outlines=OUTLINES[:1], partial=True),
        ],
        [FrameTruth(left_outlines=OUTLINES, shared=False)],
    ],
    ids=["labels", "not shared", "plain masks", "outlines", "outlines not shared"],
)
def test_labels_come_back_value_by_value(
    tmp_path: Path, truths: Sequence[FrameTruth | None]
) -> None:
    session = with_truths(tmp_path / "s.mcap", truths)
    folder = exported(session, tmp_path / "out")
    assert content_of(returned(folder, tmp_path / "back.mcap")) == content_of(session)


@pytest.mark.parametrize("encoding", ["jpeg", "png", "webp", "bgr8", "bayer_gbrg8"])
def test_pictures_come_back(tmp_path: Path, encoding: Encoding) -> None:
    session = session_file(tmp_path, 2, encoding=encoding, labelled=True)
    back = returned(exported(session, tmp_path / "out"), tmp_path / "back.mcap")
    with Session(session) as one, Session(back) as other:
        for before, after in zip(one.pairs(), other.pairs(), strict=True):
            assert np.array_equal(decode(before.left), decode(after.left))
            assert np.array_equal(decode(before.right), decode(after.right))
            if encoding in ("jpeg", "png", "webp"):
                assert before.left.data == after.left.data


def test_the_rig_comes_beside(tmp_path: Path) -> None:
    session = session_file(tmp_path, 1, with_rig=real_rig(size_px=(64, 48)))
    with Session(session) as opened:
        known = opened.rig.digest
    assert load_rig(exported(session, tmp_path / "out") / "rig.toml").digest == known


@pytest.mark.parametrize(("kind", "code"), [("<u2", "16UC1"), ("<f4", "32FC1")])
def test_depth_is_written_value_by_value(tmp_path: Path, kind: str, code: Any) -> None:
    depth = np.linspace(0, 3, 64 * 48).reshape(48, 64)
    values = (depth * 1000).astype(kind) if kind == "<u2" else depth.astype(kind)
    camera = nominal_camera((64, 48))
    with SessionWriter.create(tmp_path / "s.mcap", one_view_rig(camera), ONE_VIEW) as writer:
        writer.write_frame(frame())
        writer.write_depth(Depth(0, code, values.tobytes(), (64, 48)))
    folder = exported(tmp_path / "s.mcap", tmp_path / "out")
    assert not (folder / "right").exists()
    (path,) = (folder / "depth").iterdir()
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None
    assert np.array_equal(found, values)
    import_frames(single_pictures(folder / "left"), None, tmp_path / "one.mcap")


def test_coco_says_what_was_not_looked_at(tmp_path: Path) -> None:
    folder = exported(with_truths(tmp_path / "s.mcap", [None, truth(0)]), tmp_path / "out")
    document = json.loads((folder / "coco.json").read_text())
    assert [image["labelled"] for image in document["images"]] == [False, False, True, True]
    assert [image["file_name"] for image in document["images"]][2] == "left/000001.png"
    first = document["annotations"][0]
    assert (first["bbox"], first["area"], first["apple_id"]) == ([4, 4, 8, 8], 64, 1)
    crowds = [a for a in document["annotations"] if a["iscrowd"]]
    assert len(crowds) == 2
    assert all("apple_id" not in crowd for crowd in crowds)


def test_the_command(tmp_path: Path) -> None:
    session = session_file(tmp_path, 2, labelled=True)
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["export", "frames", str(session), "-o", str(out)])
    assert result.stdout == f"{out}: 4 pictures, 12 labels\n"
    result = CliRunner().invoke(app, ["export", "frames", str(session), "-o", str(out)])
    assert isinstance(result.exception, PomologError)
    assert "it is a folder" in str(result.exception)
