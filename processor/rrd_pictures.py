"""Pictures for recordings, small: recorded bytes as they are, indices, masks beside the truth.

A recording costs at most 1.3 times what was recorded, so all but the recorded pictures together
may cost a third of one: indices are halved, masks have two bits a pixel.
"""

import io
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr
from PIL import Image

from processor.palette import ESTIMATE, FALSE, HIT, MISSED, Colour
from processor.trace import Mask, Recognition
from recorder.records import COMPRESSED, UNCOUNTED, Frame, Labels, Picture

MEDIA_TYPES: Final = {"jpeg": "image/jpeg", "png": "image/png", "webp": "image/webp"}
INDEX_SHARE: Final = 0.5  # of the picture's size; an index is looked at, not measured
JOINED_WIDTH_PX: Final = 420  # of a view in the picture of both
COVER: Final = 190  # of 255: what is under a mask still shows

_OVER: Final = 1.0  # pictures lie at -10, rings and lines at 10 and above
# what a pixel of a mask is; two bits hold no more
CLEAR, RIGHT, WRONG, LACKING = range(4)


def recorded(frame: Frame, picture: Picture) -> Any:
    """The recorded bytes as they are, where a viewer can read them.

    Args:
        frame: as recorded.
        picture: the same decoded, for raw formats.
    """
    if frame.encoding in COMPRESSED:
        return rr.EncodedImage(contents=frame.data, media_type=MEDIA_TYPES[frame.encoding])
    return jpeg(picture, quality=90)


def jpeg(picture: npt.NDArray[np.uint8], *, quality: int) -> Any:
    """A (H, W[, 3]) BGR picture as JPEG."""
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg")


def index_picture(recognition: Recognition) -> Any:
    """The colour index at half size, dark to bright; one that is no probability is small.

    So it is shown as its square root, by the same scale in every frame.
    """
    index = cv2.resize(
        recognition.index, None, fx=INDEX_SHARE, fy=INDEX_SHARE, interpolation=cv2.INTER_AREA
    )
    if not recognition.calibrated:
        index = cv2.LUT(index, _ROOT)
    coloured = cv2.applyColorMap(np.asarray(index, np.uint8), cv2.COLORMAP_INFERNO)
    return jpeg(np.asarray(coloured, np.uint8), quality=50)


_ROOT: Final = np.sqrt(np.arange(256) * 255.0).astype(np.uint8)


def mask_picture(mask: Mask, labels: Labels | None, *, partial: bool) -> Any:
    """A mask: hit, false and missed apart where the truth is known, else the estimate alone.

    Args:
        mask: of a view.
        labels: its truth; None: nobody said.
        partial: unlabelled fruit exist, so that none of the mask is false.
    """
    marked = mask.view(bool) if mask.dtype == bool else mask > 0
    colours = (HIT, ESTIMATE if labels is None or partial else FALSE, MISSED)
    classes = np.where(marked, WRONG, CLEAR).astype(np.uint8)
    if labels is not None:
        fruit = (labels > 0) & (labels < UNCOUNTED)
        classes[fruit] = np.where(marked[fruit], RIGHT, LACKING)
        classes[labels == UNCOUNTED] = CLEAR  # counts neither way
    return rr.EncodedImage(
        contents=two_bit_png(classes, colours), media_type="image/png", draw_order=_OVER
    )


def two_bit_png(classes: npt.NDArray[np.uint8], colours: tuple[Colour, Colour, Colour]) -> bytes:
    """(H, W) classes 0 to 3 as a palette PNG, class 0 clear, the others in their colours."""
    image = Image.fromarray(classes).convert("L")
    image.putpalette(bytes((0, 0, 0, *(part for colour in colours for part in colour))))
    data = io.BytesIO()
    # runs of equal bytes (zlib's strategy 3) are what a mask has, and searching for more is slow
    image.save(
        data, "png", bits=2, compress_level=1, compress_type=3,
        transparency=bytes((0, COVER, COVER, COVER)),
    )  # fmt: skip
    return data.getvalue()


def joined_picture(left: Picture, right: Picture) -> tuple[Any, float]:
    """Both views side by side, small; and how much smaller they are."""
    share = min(1.0, JOINED_WIDTH_PX / left.shape[1])
    small = [
        cv2.resize(view, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        for view in (left, right)
    ]
    return jpeg(np.hstack(small).astype(np.uint8, copy=False), quality=55), share
