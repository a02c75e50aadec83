"""Disparity from appearance: both views of a skin agree where its sphere is at the right place."""

from typing import Final, cast

import cv2
import numpy as np

from processor.net import Floats32
from processor.rims import Bytes
from processor.trace import Floats, ViewTrace

_GRID: Final = np.linspace(-0.8, 0.8, 12)
_SPOTS: Final = np.array([(x, y) for y in _GRID for x in _GRID if np.hypot(x, y) <= 0.82])
_BULGE: Final = np.sqrt(1 - (_SPOTS**2).sum(1))  # of a unit sphere towards the camera, at a spot
FLATTER: Final = 0.8  # of a sphere's bulge; shine moves with the viewer and lies behind the skin
_FRUIT: Final = 140  # evidence of spots that are compared
_FEWEST: Final = 12  # spots that both views must show
_SEARCHES: Final = ((8.0, 1.0), (1.0, 0.25))  # span and step, in pixels


def shift_of_skins(
    left: ViewTrace, right: ViewTrace, circles: Floats, shift_px: Floats, focal_px: float
) -> tuple[Floats, Floats]:
    """Search the shift at which both views of each fruit correlate best, to part of a pixel.

    Args:
        left: the left view.
        right: the right view.
        circles: (M, 3) of the left view.
        shift_px: (M,) where to search.
        focal_px: of the rectified cameras.

    Returns:
        (M,) shifts of the fruit's middles, and (M,) the correlation there; -1 where too little
        is seen in both.
    """
    count = len(circles)
    best, peak = shift_px.astype(float).copy(), np.full(count, -1.0)
    if count == 0:
        return best, peak
    x = circles[:, :1] + circles[:, 2:] * _SPOTS[:, 0]
    y = circles[:, 1:2] + circles[:, 2:] * _SPOTS[:, 1]
    seen = _sample(left.picture, x, y)[:, None]
    fruit = _sample(left.recognition.evidence(), x, y) > _FRUIT
    # a spot that bulges by b is nearer, its shift larger by 1 / (1 - b R / Z)
    nearer = 1 / (1 - circles[:, 2:] / focal_px * FLATTER * _BULGE)
    places = np.arange(count)
    for span, step in _SEARCHES:
        tried = best[:, None] + np.arange(-span, span + step / 2, step)
        columns = x[:, None] - tried[..., None] * nearer[:, None]
        rows = np.broadcast_to(y[:, None], columns.shape)
        both = fruit[:, None] & (_sample(right.recognition.evidence(), columns, rows) > _FRUIT)
        score = _correlation(seen, _sample(right.picture, columns, rows), both)
        score[both.sum(-1) < _FEWEST] = -1
        at = np.clip(score.argmax(1), 1, score.shape[1] - 2)
        before, peak, after = (score[places, at + k] for k in (-1, 0, 1))
        bend = np.maximum(2 * peak - before - after, 1e-6)
        best = tried[places, at] + step * np.clip((after - before) / (2 * bend), -1, 1)
    return best, peak


def _sample(plane: Bytes, x: Floats, y: Floats) -> Floats32:
    shape = (-1, x.shape[-1])
    found = cv2.remap(
        plane, x.reshape(shape).astype(np.float32), y.reshape(shape).astype(np.float32),
        cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0, 0),
    )  # fmt: skip
    return cast("Floats32", found.reshape(*x.shape, *plane.shape[2:]).astype(np.float32))


def _correlation(one: Floats32, other: Floats32, both: np.ndarray) -> Floats:
    """(M, H) of (M, 1, S, 3) and (M, H, S, 3) at the spots (M, H, S) that both show."""
    weight = both[..., None].astype(np.float32)
    total = weight.sum(2, keepdims=True) + 1e-6
    a = (one - (weight * one).sum(2, keepdims=True) / total) * weight
    b = (other - (weight * other).sum(2, keepdims=True) / total) * weight
    power = (a * a).sum((2, 3)) * (b * b).sum((2, 3))
    return np.asarray((a * b).sum((2, 3)) / np.sqrt(power + 1e-6), float)
