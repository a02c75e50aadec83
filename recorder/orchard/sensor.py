"""The camera behind the lens: light to electrons to bytes, with everything it adds on the way."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from recorder.errors import PomologError
from recorder.orchard.camera import View
from recorder.orchard.engine import Floats
from recorder.orchard.noise import Image, srgb8
from recorder.records import Encoding, Frame, Picture, Side

_FULL_WELL_E: Final = 9000.0  # electrons; a 5.2 um CMOS pixel of its time
_READ_NOISE_E: Final = 9.0
_RESPONSE_SPREAD: Final = 0.006  # from pixel to pixel
_BLACK: Final = 64  # of the 12-bit converter
_WHITE: Final = 4095
_LENS_BLUR_PX: Final = 0.5
_CROSSTALK: Final = np.array([[0.72, 0.24, 0.04], [0.10, 0.78, 0.12], [0.02, 0.22, 0.76]])
_FLARE: Final = ((0.010, 12.0), (0.012, 60.0))  # (share of the light, spread in px at 1280 px)
_VEIL: Final = 0.05  # of a picture's mean light, laid over it when the sun stands in the lens
_VEIL_ANGLE_RAD: Final = 0.7
_METERED: Final = 0.20  # mean that automatic exposure aims at, of full scale
_METER_DISCOUNT: Final = 88  # percentile above which light counts no more: the sky


@dataclass(frozen=True, slots=True)
class CameraSetting:
    """How a camera is set: exposure beside what the meter wants, and white balance."""

    ev: float = 0.0
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)


def metered_gain(light: Image) -> float:
    """The gain that automatic exposure chooses: weighted to the middle, the sky discounted."""
    luminance = light @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    height_px, width_px = luminance.shape
    y, x = np.mgrid[:height_px, :width_px]
    weight = np.exp(-(((x / width_px - 0.5) / 0.45) ** 2) - ((y / height_px - 0.55) / 0.4) ** 2)
    counted = np.minimum(luminance, np.percentile(luminance, _METER_DISCOUNT))
    return _METERED / max(float((counted * weight).sum() / weight.sum()), 1e-9)


def take_picture(
    light: Image,
    view: View,
    gain: float,
    setting: CameraSetting,
    rng: np.random.Generator,
    sun_direction: Floats | None = None,
) -> Picture:
    """(H, W, 3) uint8 BGR from linear light.

    Flare and veil, vignetting, lens blur, a Bayer mosaic with shot and read noise, clipping,
    demosaicing, colour correction, white balance, gamma.
    """
    exposed = np.maximum(light, 0) * (gain * 2.0**setting.ev)
    exposed = _with_flare(exposed, view, sun_direction)
    exposed = cv2.GaussianBlur(exposed, (0, 0), _LENS_BLUR_PX) * _vignette(view)[..., None]
    sensed = exposed @ _CROSSTALK.T.astype(np.float32)
    electrons = np.clip(_mosaic(np.asarray(sensed, np.float32)), 0, 4) * _FULL_WELL_E
    electrons = rng.poisson(electrons).astype(np.float32)
    electrons *= 1 + _RESPONSE_SPREAD * rng.standard_normal(electrons.shape, np.float32)
    electrons += _READ_NOISE_E * rng.standard_normal(electrons.shape, np.float32)
    counts = np.clip(electrons / _FULL_WELL_E * _WHITE + _BLACK, 0, _WHITE).astype(np.uint16)
    bgr = cv2.cvtColor(counts, cv2.COLOR_BayerRGGB2BGR)
    rgb = (bgr[..., ::-1].astype(np.float32) - _BLACK) / (_WHITE - _BLACK)
    rgb = rgb @ np.linalg.inv(_CROSSTALK).T.astype(np.float32)
    rgb *= np.array(setting.white_balance, np.float32)
    return np.ascontiguousarray(srgb8(rgb)[..., ::-1])


def _with_flare(light: Image, view: View, sun_direction: Floats | None) -> Image:
    """Light scattered in the lens: halos round what is bright, and a veil when the sun is near."""
    width_px = light.shape[1]
    bright = np.minimum(light, 8.0)
    flared = light * (1 - sum(share for share, _ in _FLARE))
    for share, spread_px in _FLARE:
        shrunk = cv2.resize(bright, None, fx=0.125, fy=0.125, interpolation=cv2.INTER_AREA)
        halo = cv2.GaussianBlur(shrunk, (0, 0), max(spread_px * width_px / 1280 / 8, 0.3))
        flared += share * cv2.resize(halo, light.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    if sun_direction is not None:
        angle = np.arccos(np.clip(view.rotation[:, 2] @ sun_direction, -1, 1))
        veil = _VEIL * np.exp(-((angle / _VEIL_ANGLE_RAD) ** 2)) * bright.mean()
        flared += np.float32(veil) * np.array([1.05, 1.0, 0.92], np.float32)
    return np.asarray(flared, np.float32)


def _vignette(view: View) -> Image:
    """The natural fall-off of light towards the corners, a little weaker than cos^4."""
    height_px, width_px = view.camera.size_px[1], view.camera.size_px[0]
    squared = (view.slopes() ** 2).sum(1).reshape(height_px, width_px)
    return np.asarray((1 / (1 + squared)) ** 1.2, np.float32)


def _mosaic(rgb: Image) -> Image:
    """(H, W): what an RGGB sensor keeps of (H, W, 3) RGB."""
    raw = np.empty(rgb.shape[:2], np.float32)
    for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        raw[row::2, column::2] = rgb[row::2, column::2, channel]
    return raw


def encode_picture(
    picture: Picture, side: Side, time_ns: int, sequence: int, encoding: Encoding, quality: int
) -> Frame:
    """A picture as a recorder keeps it: JPEG 4:4:4, PNG, or raw.

    Raises:
        PomologError: the encoding is none that a made session has.
    """
    size_px = (picture.shape[1], picture.shape[0])
    if encoding == "jpeg":  # 4:4:4, because chroma subsampling moves R-G
        options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
                   cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]  # fmt: skip
        data = cv2.imencode(".jpg", picture, options)[1].tobytes()
    elif encoding == "png":
        data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 6])[1].tobytes()
    elif encoding == "bayer_rggb8":
        data = _mosaic(picture[..., ::-1].astype(np.float32)).astype(np.uint8).tobytes()
    elif encoding == "bgr8":
        data = picture.tobytes()
    else:
        raise PomologError(f"[camera.encoding] {encoding!r} is not made; take jpeg or png")
    return Frame(side, time_ns, encoding, data, size_px, sequence)
