"""Label files of one picture each: labelme, Supervisely, YOLO, circles (ACFR)."""

import base64
import csv
import io
import math
import zlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any, Final

import cv2
import numpy as np

from recorder.errors import PomologError
from recorder.imports.coco import whole_number
from recorder.imports.json_files import read_json
from recorder.imports.shapes import Mask, PictureLabels, Shape, circle
from recorder.pictures import MAX_SIDE_PX, identify, verify
from recorder.text_files import read_text

_BAD: Final = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError)
_COLUMNS: Final = (("c-x", "c-y", "radius"), ("x", "y", "radius"), ("x", "y", "dx", "dy"))
_WANTED: Final = "columns are x, y, radius (or c-x, c-y, radius), or x, y, dx, dy"
_NO_PICTURES: Final = frozenset(("classes.txt", "obj.names", "train.txt", "test.txt", "val.txt"))


def read_labelme(folder: Path) -> tuple[PictureLabels, ...]:
    """A JSON file a picture, by labelme; `group_id` is the apple's number.

    Raises:
        PomologError: there are none, or one is damaged.
    """
    found = []
    for path in _files(folder, ".json"):
        content = read_json(path)
        try:
            size_px = (int(content["imageWidth"]), int(content["imageHeight"]))
            shapes = tuple(_labelme_shape(s, f"{path}, shape {n}")
                           for n, s in enumerate(content["shapes"]))  # fmt: skip
            name = PurePosixPath(content["imagePath"].replace("\\", "/")).name
        except _BAD as error:
            raise _no_format(path, "labelme", error) from None
        place = PurePosixPath(path.relative_to(folder).as_posix()).parent / name
        found.append(PictureLabels(str(place), shapes, size_px))
    return tuple(found)


def _labelme_shape(shape: Mapping[str, Any], where: str) -> Shape:
    points = np.array(shape["points"], float).reshape(-1, 2)
    group = shape.get("group_id")
    common: dict[str, Any] = {
        "id": None if group is None else whole_number(group, f"{where}, group_id"),
        "category": str(shape["label"]),
        "where": where,
    }
    kind = shape.get("shape_type", "polygon")
    if kind == "polygon":
        return Shape(polygons=(points,), **common)
    if kind == "circle":
        (x, y), rim = points[0].tolist(), points[1]
        return Shape(box=circle(x, y, math.dist((x, y), rim)), kind="circle", **common)
    if kind in ("rectangle", "mask"):
        (x0, y0), (x1, y1) = np.sort(points[:2], axis=0).tolist()
        if kind == "rectangle":
            return Shape(box=(x0, y0, x1 - x0, y1 - y0), **common)
        mask = _png_mask(base64.b64decode(shape["mask"], validate=True), where)
        return Shape(mask=(mask, (round(x0), round(y0))), **common)
    raise PomologError(f"{where}: a {kind!r} has no area; polygons, rectangles, circles have")


def read_supervisely(folder: Path) -> tuple[PictureLabels, ...]:
    """A JSON file a picture, by Supervisely, named like the picture (P1.png.json or P1.json).

    Raises:
        PomologError: there are none, or one is damaged.
    """
    found = []
    for path in _files(folder, ".json"):
        if path.name in ("meta.json", "key_id_map.json"):
            continue
        content = read_json(path)
        try:
            size_px = (int(content["size"]["width"]), int(content["size"]["height"]))
            shapes = tuple(_supervisely_shape(s, f"{path}, object {n}")
                           for n, s in enumerate(content["objects"]))  # fmt: skip
        except _BAD as error:
            raise _no_format(path, "Supervisely", error) from None
        place = path.relative_to(folder).with_suffix("").as_posix()
        found.append(PictureLabels(place, shapes, size_px))
    return tuple(found)


def _supervisely_shape(shape: Mapping[str, Any], where: str) -> Shape:
    common: dict[str, Any] = {"category": str(shape["classTitle"]), "where": where}
    kind = shape["geometryType"]
    if kind == "bitmap":
        packed = base64.b64decode(shape["bitmap"]["data"], validate=True)
        x, y = shape["bitmap"]["origin"]
        return Shape(mask=(_png_mask(_inflated(packed, where), where), (int(x), int(y))), **common)
    exterior = np.array(shape["points"]["exterior"], float).reshape(-1, 2)
    if kind == "rectangle":
        # both corners are pixels of the box
        (x0, y0), (x1, y1) = np.sort(exterior[:2], axis=0).tolist()
        return Shape(box=(x0, y0, x1 - x0 + 1, y1 - y0 + 1), **common)
    if kind == "polygon":
        if shape["points"]["interior"]:
            raise PomologError(f"{where}: a polygon with holes; convert it to a bitmap there")
        return Shape(polygons=(exterior + 0.5,), **common)  # its points are pixels' centres
    raise PomologError(f"{where}: a {kind!r} has no area; rectangles, polygons, bitmaps have")


def read_yolo(folder: Path) -> tuple[PictureLabels, ...]:
    """A text file a picture: class, then a box (centre, size) or a polygon, in its fractions.

    The classes' names come from `classes.txt` or `obj.names`, where there is one.

    Raises:
        PomologError: there are none, or a line is none of theirs.
    """
    names = next(
        (read_text(p).split() for n in ("classes.txt", "obj.names") for p in folder.rglob(n)), []
    )
    found = []
    for path in _files(folder, ".txt"):
        if path.name.lower() in _NO_PICTURES:
            continue
        shapes = []
        for number, line in enumerate(read_text(path).splitlines(), start=1):
            if not line.strip():
                continue
            where = f"{path}, line {number}"
            try:
                kind, *values = line.split()
                fractions = [float(value) for value in values]
                category = names[int(kind)] if names else str(int(kind))
            except (ValueError, IndexError):
                raise PomologError(
                    f"{where} is no label of YOLO: {line.strip()[:60]!r}; "
                    "one is a class and its numbers"
                ) from None
            shapes.append(_yolo_shape(fractions, category, where))
        place = path.relative_to(folder).with_suffix("").as_posix()
        found.append(PictureLabels(place, tuple(shapes), fractions=True))
    return tuple(found)


def _yolo_shape(fractions: list[float], category: str, where: str) -> Shape:
    """A shape in fractions of the picture; `in_pixels` makes it whole."""
    if not all(-0.5 <= value <= 1.5 for value in fractions):
        raise PomologError(f"{where}: a value is far outside 0 to 1; YOLO's are fractions")
    if len(fractions) == 4:
        x, y, width, height = fractions
        box = (x - width / 2, y - height / 2, width, height)
        return Shape(box=box, category=category, where=where)
    if len(fractions) < 6 or len(fractions) % 2:
        raise PomologError(
            f"{where} has {len(fractions)} numbers; a box has 4, a polygon 6 or more"
        )
    points = np.array(fractions).reshape(-1, 2)
    return Shape(polygons=(points,), category=category, where=where)


def in_pixels(picture: PictureLabels, size_px: tuple[int, int]) -> PictureLabels:
    """A picture's fractions as pixels of a picture of that size."""
    scale = np.array(size_px, float)
    shapes = []
    for shape in picture.shapes:
        box = shape.box
        if box is not None:
            (x, y), (width, height) = box[:2] * scale, box[2:] * scale
            box = (float(x), float(y), float(width), float(height))
        polygons = tuple(part * scale for part in shape.polygons)
        shapes.append(Shape(polygons, None, box, category=shape.category, where=shape.where))
    return PictureLabels(picture.name, tuple(shapes), size_px)


def read_circles(path: Path) -> tuple[PictureLabels, ...]:
    """Circles (x, y, radius) or boxes (x, y, dx, dy) as CSV: a file a picture (ACFR), or one file.

    A file's columns are known by its head: `c-x`, `c-y`, `radius`, or `x`, `y`, `radius`, or `x`,
    `y`, `dx`, `dy`; one file of all has `image` too, and perhaps `id`.

    Raises:
        PomologError: there are none, or a line is none of theirs.
    """
    files = [path] if path.is_file() else _files(path, ".csv")
    root = path.parent if path.is_file() else path
    pictures: dict[str, list[Shape]] = {}
    for file in files:
        rows = _cells(file)
        if not rows:
            raise PomologError(f"{file} is empty; its first line must name the columns")
        head = [word.lstrip("#").lower() for word in rows[0]]
        if not any(set(columns) <= set(head) for columns in _COLUMNS):
            raise PomologError(f"{file}: its columns are {', '.join(head)[:80]}; {_WANTED}")
        own = file.relative_to(root).with_suffix("").as_posix()
        if "image" not in head:
            pictures.setdefault(own, [])
        for number, row in enumerate(rows[1:], start=2):
            if not any(row):
                continue
            where = f"{file}, line {number}"
            cells = dict(zip(head, row, strict=False))
            name = cells.get("image", own)
            shapes = pictures.setdefault(name, [])
            if "image" in head and not any(cells.get(key) for key in ("radius", "dx")):
                continue  # a picture that has none
            shapes.append(_circle_shape(cells, where))
    return tuple(PictureLabels(name, tuple(shapes)) for name, shapes in pictures.items())


def _cells(path: Path) -> list[list[str]]:
    """The rows of a CSV, their cells on one line each."""
    try:
        rows = list(csv.reader(io.StringIO(read_text(path))))
    except csv.Error as error:
        raise PomologError(f"{path} is no CSV: {error}; export it again") from None
    return [[" ".join(cell.split()) for cell in row] for row in rows]


def _circle_shape(cells: Mapping[str, str], where: str) -> Shape:
    try:
        x, y = (float(cells[f"c-{axis}" if "c-x" in cells else axis]) for axis in "xy")
        if "radius" in cells:
            box, kind = circle(x, y, float(cells["radius"])), "circle"
        else:
            box, kind = (x, y, float(cells["dx"]), float(cells["dy"])), "box"
    except (KeyError, ValueError):
        raise PomologError(f"{where}: no circle; {_WANTED}") from None
    number = cells.get("id")
    return Shape(
        box=box,
        kind="circle" if kind == "circle" else "box",
        id=whole_number(number, f"{where}, id") if number else None,
        category=cells.get("label", ""),
        where=where,
    )


def _files(folder: Path, suffix: str) -> list[Path]:
    if not folder.is_dir():
        raise PomologError(f"{folder} is no folder of label files; is the name right?")
    found = sorted(path for path in folder.rglob(f"*{suffix}") if path.is_file())
    if not found:
        raise PomologError(f"no {suffix} files in {folder}; is it the right folder?")
    return found


def _no_format(path: Path, tool: str, error: Exception) -> PomologError:
    if isinstance(error, KeyError):
        return PomologError(f"{path} is no file of {tool}: it has no {error}; export it again")
    return PomologError(f"{path} is no file of {tool}: {error}; export it again")


def _inflated(packed: bytes, where: str) -> bytes:
    try:
        unpacked = zlib.decompressobj().decompress(packed, 1 << 24)
    except zlib.error:
        raise PomologError(f"{where}: its bitmap is damaged; export it again") from None
    return unpacked


def _png_mask(png: bytes, where: str) -> Mask:
    _, size_px = identify(png, where)
    if max(size_px) > MAX_SIDE_PX:
        raise PomologError(
            f"{where}: a mask of {size_px[0]} x {size_px[1]} px; a side has {MAX_SIDE_PX} at most"
        )
    verify(png, where)
    mask = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if mask is None:
        raise PomologError(f"{where}: its mask is no PNG; export it again")
    return np.asarray(mask if mask.ndim == 2 else mask[..., -1]) > 0
