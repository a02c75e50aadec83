"""Pictures of a bag -> frames and depth: ROS's encodings by name, rows freed of their padding."""

import struct
from collections.abc import Callable
from typing import Any, Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from recorder.errors import PomologError
from recorder.imports.bag_messages import BagImage
from recorder.pictures import MAX_SIDE_PX, identify, verify
from recorder.records import DEPTH_BYTES, Depth, DepthEncoding, Encoding, Frame, Side

Pixels = npt.NDArray[np.uint8]  # (H, W * bytes a pixel)

_COMPRESSED_DEPTH: Final = struct.Struct("<i2f")  # before the PNG: format, and two parameters
_VIDEO: Final = ("264", "265", "hevc", "av1", "vp9")


def _as_bgr(code: int, channels: int) -> Callable[[Pixels], Pixels]:
    def convert(rows: Pixels) -> Pixels:
        shaped = rows if channels == 1 else rows.reshape(len(rows), -1, channels)
        return cast("Pixels", cv2.cvtColor(shaped, code))

    return convert


def _as_it_is(rows: Pixels) -> Pixels:
    return rows


# ROS's (and Foxglove's) encoding -> bytes a pixel, what a session keeps, and how it gets there
_RAW: Final[dict[str, tuple[int, Encoding, Callable[[Pixels], Pixels]]]] = {
    "bgr8": (3, "bgr8", _as_it_is),
    "8UC3": (3, "bgr8", _as_it_is),
    "rgb8": (3, "bgr8", _as_bgr(cv2.COLOR_RGB2BGR, 3)),
    "bgra8": (4, "bgr8", _as_bgr(cv2.COLOR_BGRA2BGR, 4)),
    "rgba8": (4, "bgr8", _as_bgr(cv2.COLOR_RGBA2BGR, 4)),
    "mono8": (1, "bgr8", _as_bgr(cv2.COLOR_GRAY2BGR, 1)),
    "8UC1": (1, "bgr8", _as_bgr(cv2.COLOR_GRAY2BGR, 1)),
    "yuv422_yuy2": (2, "bgr8", _as_bgr(cv2.COLOR_YUV2BGR_YUY2, 2)),
    "yuyv": (2, "bgr8", _as_bgr(cv2.COLOR_YUV2BGR_YUY2, 2)),
    "yuv422": (2, "bgr8", _as_bgr(cv2.COLOR_YUV2BGR_UYVY, 2)),
    "uyvy": (2, "bgr8", _as_bgr(cv2.COLOR_YUV2BGR_UYVY, 2)),
    "bayer_rggb8": (1, "bayer_rggb8", _as_it_is),
    "bayer_bggr8": (1, "bayer_bggr8", _as_it_is),
    "bayer_gbrg8": (1, "bayer_gbrg8", _as_it_is),
    "bayer_grbg8": (1, "bayer_grbg8", _as_it_is),
}
COLOURS: Final = frozenset(name for name in _RAW if name not in ("mono8", "8UC1"))
_DEPTHS: Final[dict[str, DepthEncoding]] = {"16UC1": "16UC1", "mono16": "16UC1", "32FC1": "32FC1"}


def is_depth(image: BagImage) -> bool:
    """Whether a picture holds distances."""
    if image.size_px is None:
        packed = image.encoding.split(";")[0].strip()
        return "compressedDepth" in image.encoding or packed in _DEPTHS
    return image.encoding in _DEPTHS


def picture_size_px(image: BagImage, topic: str) -> tuple[int, int]:
    """(width, height) of a raw or compressed picture, or depth.

    Raises:
        PomologError: it is no picture.
    """
    where = f"a picture of {topic}"
    if image.size_px is not None:
        return image.size_px
    if not image.data or any(word in image.encoding.lower() for word in _VIDEO):
        raise PomologError(
            f"{topic} has {image.encoding[:40] or 'empty'} pictures; export it as JPEG or raw first"
        )
    return identify(_packed(image), where)[1]


def _packed(image: BagImage) -> bytes:
    """The picture file in a compressed message; depth's own transport puts a header before it."""
    start = _COMPRESSED_DEPTH.size if "compressedDepth" in image.encoding else 0
    return image.data[start:]


def to_frame(image: BagImage, side: Side, time_ns: int, sequence: int, topic: str) -> Frame:
    """A picture as a session keeps it: JPEG, PNG, WebP and Bayer byte for byte, else BGR.

    Raises:
        PomologError: an encoding that we cannot read, or other bytes than it needs.
    """
    where = f"a picture of {topic}"
    if image.size_px is None:
        if is_depth(image):
            raise PomologError(f"{topic} holds depth, not pictures; give it with --depth {topic}")
        picture_size_px(image, topic)
        before, _, after = image.encoding.partition(";")
        if before.strip().startswith("bayer") and not after.strip().endswith(("bgr8", "rgb8")):
            raise PomologError(
                f"{topic} holds a Bayer mosaic packed as if it were grey ({image.encoding[:40]}); "
                "record its raw topic, or its colours"
            )
        encoding, size_px = identify(image.data, where)
        verify(image.data, where)
        return Frame(side, time_ns, encoding, image.data, size_px, sequence)
    if image.encoding in _DEPTHS:
        raise PomologError(f"{topic} holds depth, not pictures; give it with --depth {topic}")
    if image.encoding not in _RAW:
        raise PomologError(
            f"{topic} has encoding {image.encoding[:40]!r}; known are {', '.join(_RAW)}"
        )
    bytes_each, encoding, convert = _RAW[image.encoding]
    try:
        kept = convert(_rows(image, bytes_each, where))
    except cv2.error:  # an odd width in a picture whose columns share their colour
        raise PomologError(f"{where} is no {image.encoding} picture; is it damaged?") from None
    return Frame(side, time_ns, encoding, kept.tobytes(), image.size_px, sequence)


def to_depth(image: BagImage, time_ns: int, topic: str) -> Depth:
    """A depth picture as a session keeps it; uncompressed, its values as they were.

    Raises:
        PomologError: no depth, or other bytes than it needs.
    """
    if image.size_px is None and is_depth(image):
        return _unpacked(image, time_ns, topic)
    if image.size_px is None or image.encoding not in _DEPTHS:
        raise PomologError(
            f"{topic} has encoding {image.encoding[:40]!r}, which is no depth; "
            "16UC1 (mm) and 32FC1 (m) are"
        )
    encoding = _DEPTHS[image.encoding]
    rows = _rows(image, DEPTH_BYTES[encoding], f"a depth picture of {topic}")
    if image.big_endian:
        kind = ">u2" if encoding == "16UC1" else ">f4"
        rows = np.ascontiguousarray(rows).view(kind).byteswap().view(np.uint8)
    return Depth(time_ns, encoding, rows.tobytes(), image.size_px)


def _rows(image: BagImage, bytes_each: int, where: str) -> Pixels:
    """(H, W * bytes a pixel) without the padding at the end of each row."""
    assert image.size_px is not None
    width_px, height_px = image.size_px
    step = image.step or width_px * bytes_each
    possible = 0 < width_px <= MAX_SIDE_PX and 0 < height_px <= MAX_SIDE_PX
    if not possible or step < width_px * bytes_each or len(image.data) != step * height_px:
        raise PomologError(
            f"{where} has {len(image.data)} bytes for {width_px} x {height_px} px of "
            f"{image.encoding} in rows of {image.step}; is it damaged?"
        )
    rows = np.frombuffer(image.data, np.uint8).reshape(height_px, step)
    return rows[:, : width_px * bytes_each]


def _unpacked(image: BagImage, time_ns: int, topic: str) -> Depth:
    """compressed_depth_image_transport: a PNG of millimetres, or of quantised inverse metres."""
    where = f"a depth picture of {topic}"
    png = _packed(image)
    inverse = image.encoding.startswith("32FC1")
    plain = "compressedDepth" not in image.encoding
    if not png or "rvl" in image.encoding.lower() or (inverse and plain):
        raise PomologError(f"{where} is packed as {image.encoding[:40]!r}; PNG can be read")
    encoding, size_px = identify(png, where)
    verify(png, where)
    steps = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if encoding != "png" or steps is None or steps.dtype != np.uint16 or steps.ndim != 2:
        raise PomologError(f"{where} is no 16-bit PNG; is it damaged?")
    if inverse:
        _, first, second = _COMPRESSED_DEPTH.unpack_from(image.data)
        with np.errstate(all="ignore"):
            metres = np.where(steps > 0, first / (steps.astype(float) - second), np.nan)
        return Depth(time_ns, "32FC1", metres.astype("<f4").tobytes(), size_px)
    return Depth(time_ns, "16UC1", cast("Any", steps).astype("<u2").tobytes(), size_px)
