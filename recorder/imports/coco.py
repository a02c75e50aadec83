"""COCO's JSON: polygons, run lengths and boxes by picture."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from recorder.errors import PomologError
from recorder.imports.json_files import read_json, wrong_entry
from recorder.imports.shapes import PictureLabels, Shape, cropped, mask_of_runs, unpack_runs
from recorder.pictures import MAX_SIDE_PX
from recorder.records import OutlineKind

_Length = Annotated[int, Field(gt=0, le=MAX_SIDE_PX)]
IDENTITIES = ("apple_id", "track_id", "instance_id", "object_id")  # where tools keep them


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow", allow_inf_nan=False)


class _Runs(_Part):
    size: tuple[_Length, _Length]
    counts: list[int] | str


class _Picture(_Part):
    id: int | str
    file_name: str
    width: _Length | None = None
    height: _Length | None = None
    labelled: bool = True  # this and the next two are our own, see recorder/exports/coco.py
    partial: bool = False
    identified: bool = True

    @property
    def size_px(self) -> tuple[int, int] | None:
        """(width, height), where the file says both."""
        return (self.width, self.height) if self.width and self.height else None


class _Category(_Part):
    id: int | str
    name: str


class _Annotation(_Part):
    image_id: int | str
    category_id: int | str = ""
    segmentation: _Runs | list[list[float]] | None = None
    bbox: tuple[float, float, float, float] | None = None
    iscrowd: int = 0
    attributes: dict[str, Any] = {}
    outline: OutlineKind = "box"  # our own: the box is around a circle
    label: int | None = None  # our own: its number in this picture


class _File(_Part):
    images: list[_Picture]
    annotations: list[_Annotation]
    categories: list[_Category] = []


def read_coco(path: Path) -> tuple[PictureLabels, ...]:
    """Read a COCO file; annotations without a segmentation are boxes.

    Raises:
        PomologError: it cannot be read, or is no COCO.
    """
    found = _parse(path)
    pictures = {picture.id: picture for picture in found.images}
    if len(pictures) < len(found.images):
        raise PomologError(f"{path}: an image's id stands twice; export it again")
    names = {category.id: category.name for category in found.categories}
    shapes: dict[int | str, list[Shape]] = {key: [] for key in pictures}
    for number, annotation in enumerate(found.annotations):
        where = f"{path}, annotation {number}"
        if annotation.image_id not in pictures:
            raise PomologError(f"{where}: no image {annotation.image_id}; export it again")
        name = names.get(annotation.category_id, str(annotation.category_id))
        size_px = pictures[annotation.image_id].size_px
        shapes[annotation.image_id].append(_shape(annotation, name, size_px, where))
    return tuple(
        PictureLabels(
            picture.file_name.replace("\\", "/"),
            tuple(shapes[key]),
            picture.size_px,
            partial=picture.partial,
            identified=picture.identified,
        )
        for key, picture in pictures.items()
        if picture.labelled or shapes[key]
    )


def _parse(path: Path) -> _File:
    try:
        return _File.model_validate(read_json(path))
    except ValidationError as error:
        raise wrong_entry(path, error, "is it COCO (images, annotations)?") from None


def _shape(
    annotation: _Annotation, category: str, size_px: tuple[int, int] | None, where: str
) -> Shape:
    common: dict[str, Any] = {
        "id": _identity(annotation, where),
        "number": None if annotation.iscrowd else annotation.label,
        "category": category,
        "uncounted": bool(annotation.iscrowd),
        "where": where,
    }
    segmentation = annotation.segmentation
    if isinstance(segmentation, _Runs):
        counts = segmentation.counts
        runs = unpack_runs(counts, where) if isinstance(counts, str) else counts
        if size_px is not None and segmentation.size != size_px[::-1]:
            raise PomologError(
                f"{where}: run lengths of another size than its image's; export it again"
            )
        return Shape(mask=cropped(mask_of_runs(runs, segmentation.size, where)), **common)
    if segmentation:
        if any(len(part) % 2 for part in segmentation):
            raise PomologError(f"{where}: a polygon has an x without its y; export it again")
        parts = tuple(np.array(part, float).reshape(-1, 2) for part in segmentation)
        return Shape(polygons=parts, **common)
    if annotation.bbox is None:
        raise PomologError(f"{where} has neither a segmentation nor a bbox; label it again")
    return Shape(box=annotation.bbox, kind=annotation.outline, **common)


def _identity(annotation: _Annotation, where: str) -> int | None:
    """The apple's number, among the annotation's own keys or its attributes (CVAT)."""
    known = {**(annotation.model_extra or {}), **annotation.attributes}
    for key in IDENTITIES:
        if known.get(key) is not None:
            return whole_number(known[key], f"{where}, {key}")
    return None


def whole_number(value: Any, where: str) -> int:
    """A whole number, or its text.

    Raises:
        PomologError: it is none.
    """
    try:
        number = int(value)
        if isinstance(value, float) and number != value:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise PomologError(f"{where}: {str(value)[:40]!r} is no whole number; give one") from None
    return number
