"""A session's truth as COCO: run lengths of its labels, boxes of its outlines, apples' numbers."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from recorder.imports.shapes import HALF_PX, pack_runs, runs_of_mask
from recorder.records import SIDES, UNCOUNTED, Frame, FrameTruth, Outline, Side, StereoPair

APPLE: Final = {"id": 1, "name": "apple", "supercategory": "fruit"}


def image_id(pair: int, side: Side) -> int:
    """The number of a picture in all that we export of one session."""
    return 2 * pair + SIDES.index(side)


class CocoFile:
    """A COCO document in the making; what it cannot say stands in keys of ours at each image.

    `labelled` false: nobody looked at it. `partial`: unlabelled fruit exist. `identified` false:
    the pixels are of apples, but nobody said which are one. Numbers (`apple_id`) are the same in
    both views; where they are not, there are only those of each view (`label`).
    """

    def __init__(self) -> None:
        self._images: list[dict[str, Any]] = []
        self._annotations: list[dict[str, Any]] = []

    def add(self, pair: StereoPair, frame: Frame, file_name: str) -> None:
        """One picture and what its pair's truth says of it."""
        truth, number = pair.truth, image_id(pair.index, frame.side)
        labels = None if truth is None else truth.labels(frame.side)
        outlines = None if truth is None else truth.outlines(frame.side)
        image: dict[str, Any] = {
            "id": number,
            "file_name": file_name,
            "width": frame.size_px[0],
            "height": frame.size_px[1],
            "frame": pair.index,
            "time_ns": frame.time_ns,
            "labelled": labels is not None or outlines is not None,
        }
        if truth is not None:
            image |= {"partial": truth.partial, "identified": truth.identified}
        self._images.append(image)
        if truth is not None and labels is not None:
            for value in np.unique(labels[labels > 0]).tolist():
                self._add_mask(number, value, labels == value, truth)
        elif truth is not None:
            for outline in outlines or ():
                self._add_outline(number, outline, truth)

    def _add_mask(self, number: int, value: int, mask: Any, truth: FrameTruth) -> None:
        rows, columns = np.nonzero(mask)
        x, y = int(columns.min()), int(rows.min())
        box = [x, y, int(columns.max()) - x + 1, int(rows.max()) - y + 1]
        runs = {"size": list(mask.shape), "counts": pack_runs(runs_of_mask(mask))}
        self._add(number, value, truth, box, segmentation=runs, area=len(rows))

    def _add_outline(self, number: int, outline: Outline, truth: FrameTruth) -> None:
        x, y = outline.x_px + HALF_PX, outline.y_px + HALF_PX
        box = [x, y, outline.width_px, outline.height_px]
        area = outline.width_px * outline.height_px
        self._add(number, outline.id, truth, box, segmentation=[], area=area, outline=outline.kind)

    def _add(
        self, number: int, value: int, truth: FrameTruth, box: Sequence[float], **more: Any
    ) -> None:
        counted = value != UNCOUNTED
        named = {"apple_id": value} if counted and truth.shared and truth.identified else {}
        self._annotations.append({
            "id": len(self._annotations) + 1,
            "image_id": number,
            "category_id": APPLE["id"],
            "bbox": list(box),
            "label": value,
            "iscrowd": int(not counted),
            **named,
            **more,
        })  # fmt: skip

    @property
    def labels(self) -> int:
        """How many annotations there are."""
        return len(self._annotations)

    def document(self) -> dict[str, Any]:
        """The whole document."""
        info = {"description": "exported by pomolog", "version": "1"}
        return {
            "info": info,
            "images": self._images,
            "annotations": self._annotations,
            "categories": [APPLE],
        }
