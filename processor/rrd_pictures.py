"""Pictures for recordings, small: recorded bytes as they are, indices, masks beside the truth.

A recording costs at most 1.3 times what was recorded, so all but the recorded pictures together
may cost a third of one: indices are halved, masks have two bits a pixel.
"""

import struct
import zlib
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr

from processor.palette import ESTIMATE, FALSE, HIT, MISSED, Colour
from processor.trace import Mask, Recognition
from recorder.records import COMPRESSED, UNCOUNTED, Frame, Labels, Picture, counted_fruit

MEDIA_TYPES: Final = {"jpeg": "image/jpeg", "png": "image/png", "webp": "image/webp"}
INDEX_SHARE: Final = 0.5  # of the picture's size; an index is looked at, not measured
JOINED_WIDTH_PX: Final = 420  # of a view in the picture of both, or as near as whole pixels allow
COVER: Final = 225  # of 255: what is under a mask still shows, and does not change its colour

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


def heat_picture(heat: npt.NDArray[np.uint8]) -> Any:
    """(h, w) how likely a fruit's centre is there, dark to bright."""
    coloured = cv2.applyColorMap(heat, cv2.COLORMAP_INFERNO)
    return jpeg(np.asarray(coloured, np.uint8), quality=75)


_ROOT: Final = np.sqrt(np.arange(256) * 255.0).astype(np.uint8)


def known_fruit(labels: Labels) -> npt.NDArray[np.uint8]:
    """(H, W): 2 where fruit is known to be, 4 where it counts neither way, else 0."""
    fruit = counted_fruit(labels)
    uncounted = labels == UNCOUNTED
    return np.asarray(fruit.view(np.uint8) << 1 | uncounted.view(np.uint8) << 2, np.uint8)


def mask_picture(mask: Mask, known: npt.NDArray[np.uint8] | None, *, partial: bool) -> Any:
    """A mask: hit, false and missed apart where the truth is known, else the estimate alone.

    Args:
        mask: of a view.
        known: its truth, as `known_fruit` has it; None: nobody said.
        partial: unlabelled fruit exist, so that none of the mask is false.
    """
    colours = (HIT, ESTIMATE if known is None or partial else FALSE, MISSED)
    marked = mask & 1
    classes = cv2.LUT(marked if known is None else marked | known, _CLASS)
    png = two_bit_png(np.asarray(classes, np.uint8), colours)
    return rr.EncodedImage(contents=png, media_type="image/png", draw_order=_OVER)


# by marked (1), fruit (2), and counts neither way (4)
_CLASS: Final = np.zeros(256, np.uint8)
_CLASS[:4] = (CLEAR, WRONG, LACKING, RIGHT)


def two_bit_png(classes: npt.NDArray[np.uint8], colours: tuple[Colour, Colour, Colour]) -> bytes:
    """(H, W) classes 0 to 3 as a palette PNG, class 0 clear, the others in their colours.

    Written here (PNG, ISO 15948), because OpenCV has no palettes and Pillow takes 10 ms for each.
    """
    height, width = classes.shape
    wide = np.pad(classes, ((0, 0), (0, -width % 4)))
    rows = np.zeros((height, 1 + wide.shape[1] // 4), np.uint8)  # each begins with "no filter"
    rows[:, 1:] = wide[:, ::4] << 6 | wide[:, 1::4] << 4 | wide[:, 2::4] << 2 | wide[:, 3::4]
    # runs of equal bytes are what a mask has, and searching for more is slow
    packer = zlib.compressobj(1, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_RLE)
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 2, 3, 0, 0, 0)),
        (b"PLTE", bytes((0, 0, 0, *(part for colour in colours for part in colour)))),
        (b"tRNS", bytes((0, COVER, COVER, COVER))),
        (b"IDAT", packer.compress(rows.tobytes()) + packer.flush()),
        (b"IEND", b""),
    )
    png = b"\x89PNG\r\n\x1a\n"
    for name, body in parts:
        crc = zlib.crc32(name + body)
        png += struct.pack(">I", len(body)) + name + body + struct.pack(">I", crc)
    return png


def joined_picture(left: Picture, right: Picture) -> tuple[Any, float]:
    """Both views side by side, small; and how much smaller they are."""
    share = 1.0 / max(1, round(left.shape[1] / JOINED_WIDTH_PX))  # whole pixels are quick to sum
    small = [
        cv2.resize(view, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        for view in (left, right)
    ]
    return jpeg(np.hstack(small).astype(np.uint8, copy=False), quality=55), share
