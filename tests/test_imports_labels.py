import base64
import io
import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from typer.testing import CliRunner

from recorder.errors import PomologError
from recorder.imports.cli import app
from recorder.imports.frames import import_frames, picture_pairs, single_pictures
from recorder.imports.labels import READERS, LabelTruth
from recorder.imports.masks import label_session
from recorder.imports.shapes import (
    Shape,
    draw,
    mask_of_runs,
    pack_runs,
    runs_of_mask,
    unpack_runs,
)
from recorder.records import UNCOUNTED, FrameTruth, Outline
from recorder.session import Session
from tests.builders import picture_folders, rig, session_file

SIZE_PX = (64, 48)
SQUARE = [10.0, 6.0, 18.0, 6.0, 18.0, 14.0, 10.0, 14.0]  # x 10 to 18, y 6 to 14: 64 pixels


def stereo(folder: Path, pairs: int = 2) -> Path:
    """A session of pictures left/000.png, right/000.png, ..."""
    out = folder / "s.mcap"
    import_frames(picture_pairs(*picture_folders(folder / "pictures", pairs)), rig(), out)
    return out


def single(folder: Path, count: int = 2) -> Path:
    """A session of one view, of pictures 000.png, ..."""
    out = folder / "one.mcap"
    left, _ = picture_folders(folder / "pictures", count)
    import_frames(single_pictures(left), None, out)
    return out


def labelled(session: Path, tool: str, labels: Path, **how: Any) -> list[FrameTruth | None]:
    out = session.with_name("labelled.mcap")
    with Session(session) as opened:
        label_session(opened, LabelTruth(opened, READERS[tool](labels), **how), out)
    with Session(out) as opened:
        opened.verify()
        return [pair.truth for pair in opened.pairs()]


def refusal(session: Path, tool: str, labels: Path, **how: Any) -> str:
    with pytest.raises(PomologError) as caught:
        labelled(session, tool, labels, **how)
    assert not list(session.parent.glob("labelled.mcap*"))
    line = str(caught.value)
    assert "\n" not in line
    return line


def coco_file(
    folder: Path,
    annotations: Sequence[Mapping[str, Any]],
    names: Sequence[str] = ("left/000.png", "right/000.png"),
    size_px: tuple[int, int] = SIZE_PX,
    categories: Sequence[str] = ("apple",),
) -> Path:
    path = folder / "coco.json"
    width, height = size_px
    images = [
        {"id": i, "file_name": name, "width": width, "height": height}
        for i, name in enumerate(names)
    ]
    kinds = [{"id": i, "name": name} for i, name in enumerate(categories)]
    listed = [{"id": i, "category_id": 0, "iscrowd": 0, **a} for i, a in enumerate(annotations)]
    path.write_text(json.dumps({"images": images, "annotations": listed, "categories": kinds}))
    return path


def square(number: int = 1) -> npt.NDArray[np.uint16]:
    found = np.zeros(SIZE_PX[::-1], np.uint16)
    found[6:14, 10:18] = number
    return found


def only(found: Sequence[FrameTruth | None]) -> FrameTruth:
    """The truth of the first pair, which must be there."""
    assert found[0] is not None
    return found[0]


# pixels


def test_a_polygon_holds_the_pixels_whose_centres_it_holds() -> None:
    whole = Shape(polygons=(np.array(SQUARE).reshape(-1, 2),))
    assert np.array_equal(draw([(1, whole)], SIZE_PX), square())
    shifted = Shape(polygons=(np.array(SQUARE).reshape(-1, 2) + 0.4,))
    assert np.array_equal(draw([(1, shifted)], SIZE_PX), square())
    outside = Shape(polygons=(np.array([[-20.0, -20], [5, -20], [5, 5], [-20, 5]]),))
    assert int((draw([(1, outside)], SIZE_PX) > 0).sum()) == 25
    ring = [np.array([[4.0, 4], [20, 4], [20, 20], [4, 20], [4, 4], [8, 8], [8, 16], [16, 16],
                      [16, 8], [8, 8]])]  # fmt: skip
    assert int((draw([(1, Shape(polygons=tuple(ring)))], SIZE_PX) > 0).sum()) == 16**2 - 8**2


def test_polygons_agree_with_opencvs_test_of_each_pixels_centre() -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        angles = np.sort(rng.uniform(0, 2 * np.pi, 12))
        radii = rng.uniform(6, 15, 12)
        points = np.column_stack([32 + radii * np.cos(angles), 24 + radii * np.sin(angles)])
        points = points.astype(np.float32).astype(float)
        ours = draw([(1, Shape(polygons=(points,)))], SIZE_PX) > 0
        contour = points.astype(np.float32)
        theirs = [
            [cv2.pointPolygonTest(contour, (x + 0.5, y + 0.5), measureDist=False) > 0
             for x in range(64)]
            for y in range(48)
        ]  # fmt: skip
        assert np.array_equal(ours, theirs)


def test_of_two_that_overlap_the_smaller_has_the_pixel() -> None:
    big = Shape(polygons=(np.array([[4.0, 4], [24, 4], [24, 24], [4, 24]]),))
    small = Shape(polygons=(np.array(SQUARE).reshape(-1, 2),))
    for order in ([(1, big), (2, small)], [(2, small), (1, big)]):
        labels = draw(order, SIZE_PX)
        assert int((labels == 2).sum()) == 64
        assert int((labels == 1).sum()) == 400 - 64


@given(
    st.lists(st.booleans(), min_size=12, max_size=12), st.sampled_from([(3, 4), (4, 3), (1, 12)])
)
def test_run_lengths_come_back(values: list[bool], size: tuple[int, int]) -> None:
    mask = np.array(values).reshape(size)
    runs = runs_of_mask(mask)
    assert np.array_equal(mask_of_runs(runs, size, ""), mask)
    assert unpack_runs(pack_runs(runs), "") == runs


@given(st.lists(st.integers(0, 10**7), min_size=1, max_size=20))
def test_packed_run_lengths_come_back(runs: list[int]) -> None:
    assert unpack_runs(pack_runs(runs), "") == runs


def test_packed_run_lengths_are_those_of_cocoapi() -> None:
    # pycocotools' own: mask.encode(np.asfortranarray(square() > 0))["counts"]
    assert pack_runs(runs_of_mask(square() > 0)) == "V?8X10000000000000jT2"


# COCO


def test_cocos_polygons_are_labels_with_their_numbers_in_both_views(tmp_path: Path) -> None:
    coco = coco_file(
        tmp_path,
        [
            {"image_id": 0, "segmentation": [SQUARE], "bbox": [10, 6, 8, 8], "apple_id": 7},
            {"image_id": 1, "segmentation": [SQUARE], "attributes": {"track_id": "7"}},
        ],
    )
    found = labelled(stereo(tmp_path), "coco", coco)
    truth = only(found)
    assert found[1] is None  # nobody labelled it
    assert truth.left is not None
    assert truth.right is not None
    assert np.array_equal(truth.left, square(7))
    assert np.array_equal(truth.right, square(7))
    assert (truth.shared, truth.partial, truth.apples) == (True, False, None)


def test_cocos_run_lengths_are_labels_and_a_crowd_counts_neither_way(tmp_path: Path) -> None:
    runs = runs_of_mask(square() > 0)
    crowd = np.zeros(SIZE_PX[::-1], bool)
    crowd[30:40, 30:50] = True
    coco = coco_file(
        tmp_path,
        [
            {"image_id": 0, "segmentation": {"size": [48, 64], "counts": runs}},
            {"image_id": 0, "iscrowd": 1,
             "segmentation": {"size": [48, 64], "counts": pack_runs(runs_of_mask(crowd))}},
        ],
    )  # fmt: skip
    truth = only(labelled(stereo(tmp_path), "coco", coco, partial=True))
    assert truth.left is not None
    assert truth.right is not None
    assert np.array_equal(truth.left, square() + crowd * np.uint16(UNCOUNTED))
    assert not truth.right.any()  # listed without labels: there are none
    assert (truth.shared, truth.partial) == (False, True)


def test_boxes_say_no_pixels_and_are_kept_number_by_number(tmp_path: Path) -> None:
    boxes = [[10.25, 6.5, 8.0, 9.125], [0, 0, 3, 4]]
    coco = coco_file(tmp_path, [{"image_id": 0, "bbox": box, "segmentation": []} for box in boxes])
    truth = only(labelled(stereo(tmp_path), "coco", coco))
    assert (truth.left, truth.right, truth.right_outlines) == (None, None, ())
    assert truth.left_outlines == (
        Outline("left", 1, "box", 9.75, 6.0, 8.0, 9.125),
        Outline("left", 2, "box", -0.5, -0.5, 3.0, 4.0),
    )


def test_boxes_among_polygons_make_all_of_them_boxes(tmp_path: Path) -> None:
    coco = coco_file(
        tmp_path,
        [{"image_id": 0, "segmentation": [SQUARE]}, {"image_id": 0, "bbox": [30, 30, 5, 5]}],
    )
    truth = only(labelled(stereo(tmp_path), "coco", coco))
    assert truth.left is None
    assert truth.left_outlines is not None
    assert truth.left_outlines[0] == Outline("left", 1, "box", 9.5, 5.5, 8.0, 8.0)


# names


def test_labels_find_their_pictures_by_name_whatever_their_order(tmp_path: Path) -> None:
    names = ["sub/right/001.png", "left/001.png"]
    coco = coco_file(
        tmp_path,
        [{"image_id": 0, "segmentation": [SQUARE], "apple_id": 3},
         {"image_id": 1, "segmentation": [SQUARE], "apple_id": 4}],
        names,
    )  # fmt: skip
    found = labelled(stereo(tmp_path), "coco", coco)
    assert found[0] is None
    assert found[1] is not None
    assert found[1].left is not None
    assert found[1].right is not None
    assert (found[1].left.max(), found[1].right.max()) == (4, 3)


def test_of_recorded_sessions_numbers_and_times_are_names(tmp_path: Path) -> None:
    session = session_file(tmp_path, 3)
    labels = [{"image_id": 0, "segmentation": [SQUARE], "apple_id": 3}]
    found = labelled(session, "coco", coco_file(tmp_path, labels, ["left/000001.png"]))
    assert [t is not None for t in found] == [False, True, False]
    found = labelled(session, "coco", coco_file(tmp_path, labels, ["left/2000000000.jpg"]))
    assert [t is not None for t in found] == [False, False, True]
    line = refusal_of_existing(session, coco_file(tmp_path, labels, ["left/1.png"]))
    assert "pomolog export frames" in line


def refusal_of_existing(session: Path, coco: Path, **how: Any) -> str:
    session.with_name("labelled.mcap").unlink(missing_ok=True)
    return refusal(session, "coco", coco, **how)


def test_names_that_say_no_view_ask_for_it(tmp_path: Path) -> None:
    session = stereo(tmp_path)
    coco = coco_file(tmp_path, [{"image_id": 0, "segmentation": [SQUARE]}], ["000.png"])
    assert "say --view" in refusal(session, "coco", coco)
    truth = only(labelled(session, "coco", coco, view="right"))
    assert truth.left is None
    assert truth.right is not None
    one = single(tmp_path / "one")
    assert only(labelled(one, "coco", coco)).left is not None


def test_what_does_not_fit_is_said(tmp_path: Path) -> None:
    session = stereo(tmp_path)
    polygon = {"image_id": 0, "segmentation": [SQUARE]}
    for annotations, how, words in (
        ([polygon], {"names": ["left/900.png"]}, "its pictures are 000.png to 001.png"),
        ([polygon], {"size_px": (32, 24)}, "of 32 x 24 px, its picture is of 64 x 48"),
        ([polygon, {**polygon, "apple_id": 2}], {}, "some labels have an apple's number"),
        ([{**polygon, "image_id": 9}], {}, "no image 9"),
        ([{**polygon, "segmentation": [[1, 2, 3]]}], {}, "an x without its y"),
        ([{**polygon, "segmentation": [[1, 2, 3, 4]]}], {}, "three points"),
        ([{**polygon, "apple_id": 0}], {}, "ids go from 1 to 65534"),
        ([{**polygon, "apple_id": "x"}], {}, "no whole number"),
        ([{"image_id": 0}], {}, "neither a segmentation nor a bbox"),
        ([{"image_id": 0, "bbox": [1, 2, -3, 4]}], {}, "negative width"),
        ([{"image_id": 0, "bbox": [1e9, 2, 3, 4]}], {}, "absurdly large"),
        ([{"image_id": 0, "segmentation": {"size": [48, 64], "counts": [5]}}], {}, "do not fill"),
        ([{"image_id": 0, "segmentation": {"size": [48, 64], "counts": "~"}}], {}, "compressed"),
        ([{"image_id": 0, "segmentation": {"size": [1, 5], "counts": [5]}}], {}, "another size"),
        ([polygon, {**polygon, "category_id": 1}], {"categories": ["stem", "leaf"]}, "--category"),
        ([{"image_id": 0, "bbox": [1, 2, 3, 4], "apple_id": 5}] * 2, {}, "two boxes"),
    ):
        coco = coco_file(tmp_path, annotations, **how)
        assert words in refusal(session, "coco", coco), words
    for text, words in ((b"{", "not JSON"), (b"[]", "is it COCO"), (b"\xff", "not JSON")):
        (tmp_path / "bad.json").write_bytes(text)
        assert words in refusal(session, "coco", tmp_path / "bad.json")
    assert "cannot read" in refusal(session, "coco", tmp_path / "none.json")


def test_a_class_is_chosen_or_asked_for(tmp_path: Path) -> None:
    session = stereo(tmp_path)
    labels = [
        {"image_id": 0, "segmentation": [SQUARE], "category_id": 0},
        {"image_id": 0, "bbox": [30, 30, 9, 9], "category_id": 1},
    ]
    coco = coco_file(tmp_path, labels, categories=["Apple_red", "trunk"])
    truth = only(labelled(session, "coco", coco))
    assert truth.left is not None  # the trunk's box does not make the apples boxes
    truth = only(labelled(session, "coco", coco, category="trunk"))
    assert truth.left_outlines is not None
    assert len(truth.left_outlines) == 1


# the other tools


def labelme_file(folder: Path, name: str, shapes: Sequence[Mapping[str, Any]]) -> Path:
    place = folder / f"{name}.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(
        json.dumps({
            "version": "5.4.1", "flags": {}, "shapes": list(shapes), "imageData": None,
            "imagePath": f"..\\pictures\\{Path(name).name}.png", "imageWidth": 64,
            "imageHeight": 48,
        })
    )  # fmt: skip
    return folder


def png_text(mask: npt.NDArray[Any]) -> str:
    stream = io.BytesIO()
    Image.fromarray(mask.astype(np.uint8) * 255).save(stream, "PNG")
    return base64.b64encode(stream.getvalue()).decode()


def test_labelme_arrives_with_its_groups_as_numbers(tmp_path: Path) -> None:
    points = np.array(SQUARE).reshape(-1, 2).tolist()
    folder = tmp_path / "labels"
    labelme_file(
        folder, "left/000",
        [{"label": "apple", "points": points, "group_id": 5, "shape_type": "polygon"}],
    )  # fmt: skip
    labelme_file(
        folder, "right/000",
        [{"label": "apple", "points": [[12, 8], [15, 11]], "group_id": 5, "shape_type": "mask",
          "mask": png_text(np.eye(4, dtype=bool))}],
    )  # fmt: skip
    truth = only(labelled(stereo(tmp_path), "labelme", folder))
    assert truth.left is not None
    assert truth.right is not None
    assert np.array_equal(truth.left, square(5))
    rows, columns = np.nonzero(truth.right == 5)
    assert (rows.tolist(), columns.tolist()) == ([8, 9, 10, 11], [12, 13, 14, 15])
    assert truth.shared


def test_labelmes_circles_and_rectangles_are_outlines(tmp_path: Path) -> None:
    folder = labelme_file(
        tmp_path / "labels", "left/000",
        [
            {"label": "apple", "points": [[20, 20], [23, 24]], "shape_type": "circle"},
            {"label": "apple", "points": [[30, 9], [10, 5]], "shape_type": "rectangle"},
        ],
    )  # fmt: skip
    truth = only(labelled(stereo(tmp_path), "labelme", folder))
    assert truth.left_outlines == (
        Outline("left", 1, "circle", 14.5, 14.5, 10.0, 10.0),
        Outline("left", 2, "box", 9.5, 4.5, 20.0, 4.0),
    )
    bad = labelme_file(
        tmp_path / "bad", "left/000",
        [{"label": "apple", "points": [[1, 2]], "shape_type": "point"}],
    )  # fmt: skip
    (tmp_path / "labelled.mcap").unlink()
    assert "no area" in refusal(tmp_path / "s.mcap", "labelme", bad)


def test_supervisely_arrives(tmp_path: Path) -> None:
    folder = tmp_path / "ann"
    folder.mkdir()
    mask = square()[6:14, 10:18] > 0
    packed = zlib.compress(base64.b64decode(png_text(mask)))
    objects = [
        {"classTitle": "apple", "geometryType": "bitmap",
         "bitmap": {"data": base64.b64encode(packed).decode(), "origin": [10, 6]}},
        {"classTitle": "apple", "geometryType": "polygon",
         "points": {"exterior": [[30, 30], [39, 30], [39, 39], [30, 39]], "interior": []}},
    ]  # fmt: skip
    content = {"description": "", "tags": [], "size": {"height": 48, "width": 64}}
    (folder / "000.png.json").write_text(json.dumps({**content, "objects": objects}))
    session = single(tmp_path)
    truth = only(labelled(session, "supervisely", folder))
    assert truth.left is not None
    assert np.array_equal(truth.left == 1, square() > 0)
    assert int((truth.left == 2).sum()) == 81  # 9 x 9 between the centres of its corners
    boxes = [{"classTitle": "apple", "geometryType": "rectangle",
              "points": {"exterior": [[188, 47], [10, 19]], "interior": []}}]  # fmt: skip
    (folder / "000.png.json").write_text(json.dumps({**content, "objects": boxes}))
    truth = only(labelled(session, "supervisely", folder))
    assert truth.left_outlines == (Outline("left", 1, "box", 9.5, 18.5, 179.0, 29.0),)
    (folder / "000.png.json").write_text("{}")
    session.with_name("labelled.mcap").unlink()
    assert "no file of Supervisely: it has no 'size'" in refusal(session, "supervisely", folder)


CVAT = """<?xml version="1.0" encoding="utf-8"?>
<annotations><version>1.1</version>
<image id="0" name="left/000.png" width="64" height="48">
  <polygon label="apple" points="10.00,6.00;18.00,6.00;18.00,14.00;10.00,14.00" occluded="0">
    <attribute name="id">9</attribute></polygon>
  <mask label="apple" rle="1, 2, 1, 2" left="30" top="20" width="3" height="2" group_id="2"/>
</image>
<image id="1" name="right/000.png" width="64" height="48">
  <polygon label="apple" points="10,6;18,6;18,14;10,14"><attribute name="id">9</attribute></polygon>
</image></annotations>
"""

CVAT_VIDEO = """<annotations><meta><task><size>2</size><original_size><width>64</width>
<height>48</height></original_size></task></meta>
<track id="0" label="apple">
  <box frame="0" outside="0" xtl="10" ytl="6" xbr="18" ybr="14.5"/>
  <box frame="1" outside="1" xtl="10" ytl="6" xbr="18" ybr="14.5"/></track>
<track id="1" label="apple">
  <ellipse frame="1" outside="0" cx="20" cy="20" rx="5" ry="5"/></track></annotations>
"""


def test_cvat_arrives_with_its_numbers(tmp_path: Path) -> None:
    path = tmp_path / "cvat.xml"
    path.write_text(CVAT)
    truth = only(labelled(stereo(tmp_path), "cvat", path))
    assert truth.left is not None
    assert truth.right is not None
    wanted = square(9)
    wanted[20, 31:33] = 2
    wanted[21, 31:33] = 2
    assert np.array_equal(truth.left, wanted)
    assert np.array_equal(truth.right, square(9))
    assert truth.shared


def test_cvats_tracks_are_apples_of_the_frames(tmp_path: Path) -> None:
    path = tmp_path / "video.xml"
    path.write_text(CVAT_VIDEO)
    first, second = labelled(single(tmp_path), "cvat", path)
    assert first is not None
    assert second is not None
    assert first.left_outlines == (Outline("left", 1, "box", 9.5, 5.5, 8.0, 8.5),)
    assert second.left_outlines == (Outline("left", 2, "circle", 14.5, 14.5, 10.0, 10.0),)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<annotations", "not XML"),
        ("<a/>", "no images and no tracks"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><annotations/>', "defines entities"),
        ('<annotations><image id="0" name="a" width="1"/></annotations>', "'height'"),
        (CVAT.replace("18.00,6.00", "18.00"), "no XML of CVAT"),
        (CVAT.replace("1, 2, 1, 2", "1, 2, 1"), "do not fill"),
    ],
)
def test_bad_xml_is_a_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "cvat.xml"
    path.write_text(text)
    assert words in refusal(stereo(tmp_path), "cvat", path)


def test_yolos_boxes_and_polygons_are_in_the_pictures_pixels(tmp_path: Path) -> None:
    labels = tmp_path / "labels"
    for side in ("left", "right"):
        (labels / side).mkdir(parents=True)
    (labels / "left" / "000.txt").write_text("0 0.25 0.25 0.125 0.5\n\n0 0.5 0.5 0.25 0.25\n")
    (labels / "right" / "000.txt").write_text("")
    session = stereo(tmp_path)
    truth = only(labelled(session, "yolo", labels))
    assert truth.left_outlines == (
        Outline("left", 1, "box", 11.5, -0.5, 8.0, 24.0),
        Outline("left", 2, "box", 23.5, 17.5, 16.0, 12.0),
    )
    assert truth.right_outlines == ()
    fractions = np.array(SQUARE).reshape(-1, 2) / SIZE_PX
    line = " ".join(f"{v:.17g}" for v in fractions.ravel())
    (labels / "left" / "000.txt").write_text(f"3 {line}\n1 {line}\n")
    (labels / "classes.txt").write_text("leaf stem trunk apple")
    truth = only(labelled(session, "yolo", labels))
    assert truth.left is not None
    assert np.array_equal(truth.left, square())
    session.with_name("labelled.mcap").unlink()
    for text, words in (
        ("0 5 5 1 1", "fractions"), ("0 .5 .5 .1", "3 numbers"), ("apple .5 .5 .1 .1", "no label"),
        ("99 .5 .5 .1 .1", "no label"), ("0 nan .5 .1 .1", "fractions"),
    ):  # fmt: skip
        (labels / "left" / "000.txt").write_text(text)
        assert words in refusal(session, "yolo", labels)


def test_circles_are_kept_value_by_value(tmp_path: Path) -> None:
    path = tmp_path / "circles.csv"
    path.write_text(
        "image,x,y,radius,id\nleft/000.png,20.5,20.25,5,3\nright/000.png,15,20,4.5,3\n"
        "left/001.png,,,,\n"
    )
    first, second = labelled(stereo(tmp_path), "circles", path)
    assert first is not None
    assert second is not None
    assert first.shared
    assert first.left_outlines == (Outline("left", 3, "circle", 15.0, 14.75, 10.0, 10.0),)
    assert first.right_outlines == (Outline("right", 3, "circle", 10.0, 15.0, 9.0, 9.0),)
    assert second.left_outlines == ()
    assert second.right_outlines is None


def test_bad_circles_are_a_line(tmp_path: Path) -> None:
    session = stereo(tmp_path)
    path = tmp_path / "circles.csv"
    for text, words in (
        ("", "is empty"),
        ("image,x,y,radius\nleft/000.png,a,2,3\n", "no circle"),
        ("image,x,y\nleft/000.png,1,2\n", "columns are"),
        ("image,x,y,radius\nleft/000.png,1,2,nan\n", "not finite"),
        ("image,x,y,radius\nleft/000.png,1,2,-3\n", "negative"),
    ):
        path.write_text(text)
        assert words in refusal(session, "circles", path)


# any damage is a line


GOOD = {
    "coco": json.dumps({
        "images": [{"id": 0, "file_name": "000.png", "width": 64, "height": 48}],
        "annotations": [
            {"id": 1, "image_id": 0, "category_id": 0, "segmentation": [SQUARE]},
            {"id": 2, "image_id": 0, "category_id": 0,
             "segmentation": {"size": [48, 64], "counts": pack_runs(runs_of_mask(square() > 0))}},
        ],
        "categories": [{"id": 0, "name": "apple"}],
    }),
    "cvat": CVAT.replace("left/", "").replace("right/000", "001"),
    "circles": "image,x,y,radius,id\n000,20.5,20.25,5,3\n001,15,20,4.5,3\n",
}  # fmt: skip


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_mutated_label_files_are_a_line_or_labels(tmp_path: Path, data: st.DataObject) -> None:
    session = tmp_path / "one.mcap"
    if not session.exists():
        single(tmp_path)
    tool = data.draw(st.sampled_from(sorted(GOOD)))
    text = bytearray(GOOD[tool].encode())
    for _ in range(data.draw(st.integers(1, 3))):
        text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "labels.file"
    path.write_bytes(text)
    with Session(session) as opened:
        (pair,) = opened.pairs(0, 1)
        try:
            truth = LabelTruth(opened, READERS[tool](path)).truth(pair)
        except PomologError as error:
            truth = None
            line = str(error)
            assert "\n" not in line  # either is right, but for this
    assert truth is None or truth.left is not None or truth.left_outlines is not None


# the command


def test_the_command_labels_and_says_what_labels_cannot_say(tmp_path: Path) -> None:
    session, out = stereo(tmp_path), tmp_path / "t.mcap"
    boxes = [{"image_id": 0, "bbox": [10, 6, 8, 8]}, {"image_id": 1, "bbox": [1, 6, 8, 8]}]
    words = ["label", str(session), "--coco", str(coco_file(tmp_path, boxes)), "-o", str(out)]
    result = CliRunner().invoke(app, words)
    assert result.stdout == (
        f"{out}: 2 labels in 2 of 4 pictures; boxes or circles, so no pixels are scored; "
        "no numbers, so no matches are scored\n"
    )
    result = CliRunner().invoke(app, [*words, "--json"])
    assert json.loads(result.stdout)["with_pixels"] is False


@pytest.mark.parametrize(
    "words", [[], ["--coco", "a", "--yolo", "b"], ["--coco", "a", "--instances"], ["--view", "up"]]
)
def test_wrong_usage_of_the_command(tmp_path: Path, words: list[str]) -> None:
    result = CliRunner().invoke(app, ["label", str(stereo(tmp_path)), "-o", "t.mcap", *words])
    assert result.exit_code == 2
