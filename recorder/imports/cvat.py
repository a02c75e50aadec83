"""CVAT's XML 1.1: pictures, or the tracks of a video."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, Final

import numpy as np

from recorder.errors import PomologError
from recorder.imports.coco import IDENTITIES, whole_number
from recorder.imports.shapes import Mask, PictureLabels, Shape, circle
from recorder.text_files import require_size

_SHAPES: Final = ("polygon", "box", "mask", "ellipse")
_NAMES: Final = (*IDENTITIES, "id", "apple")  # of an attribute that gives the apple's number


def read_cvat(path: Path) -> tuple[PictureLabels, ...]:
    """Read CVAT for images or for video; a track's number, or an attribute `id`, is the apple's.

    Raises:
        PomologError: it cannot be read, or is none of CVAT's.
    """
    root = _parse(path)
    tracks = root.findall("track")
    try:
        if tracks:
            return _from_tracks(root, path)
        return tuple(
            PictureLabels(
                image.attrib["name"].replace("\\", "/"),
                tuple(
                    _shape(e, e.attrib["label"], _number(e, f"{path}, {e.tag} {n}"), path, n)
                    for n, e in enumerate(image)
                    if e.tag in _SHAPES
                ),
                (int(image.attrib["width"]), int(image.attrib["height"])),
            )
            for image in root.findall("image")
        )
    except (KeyError, ValueError) as error:
        raise PomologError(f"{path} is no XML of CVAT: {error}; export it as CVAT 1.1") from None


def _parse(path: Path) -> ET.Element:
    require_size(path)
    try:
        text = path.read_bytes()
    except OSError as error:
        raise PomologError(f"cannot read {path}: {error.strerror}; is the name right?") from None
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise PomologError(
            f"{path} defines entities, which no XML of CVAT does; export it as CVAT 1.1"
        )
    try:
        root = ET.fromstring(text)  # without entities there is no bomb
    except (ET.ParseError, LookupError, ValueError) as error:  # also an unknown encoding
        raise PomologError(f"{path} is not XML: {error}; export it as CVAT 1.1") from None
    if root.tag != "annotations" or not (root.findall("image") or root.findall("track")):
        raise PomologError(f"{path} has no images and no tracks; export it as CVAT 1.1")
    return root


def _from_tracks(root: ET.Element, path: Path) -> tuple[PictureLabels, ...]:
    """A picture a frame of the video; an apple that is outside is not in it."""
    size = root.find(".//original_size")
    size_px = (
        None
        if size is None
        else (int(size.findtext("width", "0")), int(size.findtext("height", "0")))
    )
    length = int(root.findtext(".//task/size", "0") or 0)
    pictures: dict[int, list[Shape]] = {number: [] for number in range(min(length, 1 << 20))}
    for number, track in enumerate(root.findall("track")):
        for element in track:
            if element.tag not in _SHAPES or element.attrib.get("outside") == "1":
                continue
            frame = int(element.attrib["frame"])
            apple = int(track.attrib["id"]) + 1  # CVAT counts tracks from 0
            shape = _shape(element, track.attrib["label"], apple, path, number)
            pictures.setdefault(frame, []).append(shape)
    return tuple(
        PictureLabels(f"{frame:06d}", tuple(shapes), size_px, frame)
        for frame, shapes in sorted(pictures.items())
    )


def _number(element: ET.Element, where: str) -> int | None:
    known = {a.attrib.get("name", ""): a.text for a in element.findall("attribute")}
    for name in _NAMES:
        if known.get(name):
            return whole_number(known[name], f"{where}, {name}")
    group = element.attrib.get("group_id")
    return whole_number(group, f"{where}, group_id") if group else None


def _shape(element: ET.Element, label: str, apple: int | None, path: Path, number: int) -> Shape:
    value = element.attrib
    where = f"{path}, {element.tag} {number}"
    common: dict[str, Any] = {"id": apple, "category": label, "where": where}
    if element.tag == "polygon":
        points = [pair.split(",") for pair in value["points"].split(";")]
        return Shape(polygons=(np.array(points, float),), **common)
    if element.tag == "box":
        x0, y0, x1, y1 = (float(value[key]) for key in ("xtl", "ytl", "xbr", "ybr"))
        return Shape(box=(x0, y0, x1 - x0, y1 - y0), **common)
    if element.tag == "ellipse":
        x, y, rx, ry = (float(value[key]) for key in ("cx", "cy", "rx", "ry"))
        box = circle(x, y, rx) if rx == ry else (x - rx, y - ry, 2 * rx, 2 * ry)
        return Shape(box=box, kind="circle" if rx == ry else "box", **common)
    return Shape(mask=_mask(value, where), **common)


def _mask(value: dict[str, str], where: str) -> tuple[Mask, tuple[int, int]]:
    """Run lengths row by row within a box, background first."""
    runs = np.array(value["rle"].split(","), np.int64)
    left, top, width, height = (int(value[key]) for key in ("left", "top", "width", "height"))
    if (runs < 0).any() or runs.sum() != width * height or width * height > 1 << 28:
        raise PomologError(
            f"{where}: run lengths do not fill {width} x {height} px; export it again"
        )
    filled = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return filled.reshape(height, width), (left, top)
