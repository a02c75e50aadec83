"""Encoded pictures: what they are before they are decoded, and decoding them."""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

import cv2
import numpy as np

from recorder.errors import PomologError
from recorder.limits import DEFAULT_LIMITS, VARIABLE
from recorder.records import COMPRESSED, Encoding, Frame, Picture

if TYPE_CHECKING:
    from PIL import Image

MAX_SIDE_PX = 16384  # larger than any camera on a robot; bounds what a hostile header can ask for
PNG_END = b"\0\0\0\0IEND\xaeB`\x82"

# GenICam's BayerRG8 is OpenCV's `BayerRGGB`; the older name `BayerRG` swaps red and blue
_MOSAICS: Final[dict[Encoding, int]] = {
    "bayer_rggb8": cv2.COLOR_BayerRGGB2BGR,
    "bayer_bggr8": cv2.COLOR_BayerBGGR2BGR,
    "bayer_gbrg8": cv2.COLOR_BayerGBRG2BGR,
    "bayer_grbg8": cv2.COLOR_BayerGRBG2BGR,
}


def read_picture(path: Path) -> bytes:
    """A picture's file, not yet looked at.

    Raises:
        PomologError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise PomologError(f"cannot read {path}: {error.strerror}; is it still there?") from None


def identify(data: bytes, where: str) -> tuple[Encoding, tuple[int, int]]:
    """Read format and (width, height) from a picture's header, without decoding it.

    Raises:
        PomologError: not a PNG, JPEG or WebP picture, or absurdly large.
    """
    try:
        with _opened(data) as header:
            width_px, height_px = header.size
            encoding = cast("Encoding", (header.format or "").lower())
    except (OSError, ValueError, SyntaxError):
        raise PomologError(f"{where} is not a PNG, JPEG or WebP picture; is it damaged?") from None
    if max(width_px, height_px) > MAX_SIDE_PX:
        raise PomologError(
            f"{where} claims {width_px} x {height_px} px, more than {MAX_SIDE_PX} a side; "
            "is it damaged?"
        )
    if width_px * height_px > DEFAULT_LIMITS.picture_px:
        raise PomologError(
            f"{where} claims {width_px} x {height_px} px, more than {DEFAULT_LIMITS.picture_px} "
            f"in all; is it damaged? ({VARIABLE}, see docs/withstand.md)"
        )
    return encoding, (width_px, height_px)


def verify(data: bytes, where: str) -> None:
    """Decode strictly, so that a picture cut short is refused before it is kept.

    OpenCV pads a truncated JPEG with grey and says nothing; Pillow does not.

    Raises:
        PomologError: the picture ends early or is damaged.
    """
    try:
        with _opened(data) as picture:
            if picture.format == "PNG" and PNG_END not in data:
                raise ValueError("it has no end")  # Pillow does without, OpenCV does not
            picture.verify()  # a PNG's checksums
        with _opened(data) as picture:
            picture.load()
    except (OSError, ValueError, SyntaxError) as error:
        raise PomologError(f"{where} cannot be decoded ({error}); is it complete?") from None


@contextmanager
def _opened(data: bytes) -> "Iterator[Image.Image]":
    from PIL import Image  # 20 ms to import; only files need it

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a broken tag is no matter of ours, and no line on stderr
        warnings.simplefilter("error", Image.DecompressionBombWarning)  # more than 89 megapixels
        try:
            with Image.open(io.BytesIO(data), formats=("JPEG", "PNG", "WEBP")) as picture:
                yield picture
        except (Image.DecompressionBombWarning, Image.DecompressionBombError):
            raise ValueError("it claims more pixels than a camera has") from None


def decode(frame: Frame) -> Picture:
    """Decode a recorded frame to (H, W, 3) uint8 BGR.

    Raises:
        PomologError: the bytes are not the picture that they claim to be.
    """
    width_px, height_px = frame.size_px
    buffer = np.frombuffer(frame.data, np.uint8)
    where = f"the {frame.side} frame at {frame.time_ns} ns"
    picture: Picture | None
    if frame.encoding in COMPRESSED:
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        try:
            picture = cast("Picture | None", cv2.imdecode(buffer, flags))
        except cv2.error:  # no bytes at all
            picture = None
    elif frame.encoding in _MOSAICS and buffer.size == width_px * height_px:
        mosaic = buffer.reshape(height_px, width_px)
        picture = cast("Picture", cv2.cvtColor(mosaic, _MOSAICS[frame.encoding]))
    elif frame.encoding == "bgr8" and buffer.size == 3 * width_px * height_px:
        picture = buffer.reshape(height_px, width_px, 3)
    else:
        picture = None
    if picture is None or picture.shape != (height_px, width_px, 3):
        raise PomologError(
            f"{where} is no {width_px} x {height_px} {frame.encoding} picture; is it damaged?"
        )
    return picture
