"""Where fruit are, by a small convolutional network: at every place a probability and a circle.

Colour says which pixels are fruit and rims say where one ends; a network that sees a whole
neighbourhood also says which of the pieces between leaves are one apple. It is trained by
`pomolog train` (`train_centres.py`) and run by OpenCV.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from processor.nearness import PAPERS_FOCAL_PX, Nearness, shrunk
from processor.net import Floats32
from processor.trace import Floats, Look
from recorder.records import Picture
from recorder.rectify import Rectification

COARSER: Final = 4  # times, with the paper's lens: how much smaller the picture is that it sees
CELL: Final = 2  # of its pixels for each place of its answer
MULTIPLE: Final = 8  # its input's sides are multiples of that
INPUTS: Final = 4  # blue, green, red, how large an apple is there
OUTPUTS: Final = 5  # logit, log radius, x and y to the centre in radii, visible fraction
USUAL_PX: Final = 10.0  # of its pixels: radii are told as logarithms of multiples of that
CENTRE_MEASURES: Final = 5
_NEAR: Final = np.array([-0.35, -0.18, 0.0, 0.18, 0.35], np.float32)  # radii about a centre


@dataclass(frozen=True, slots=True, eq=False)
class Centres:
    """What the network says of one view.

    Attributes:
        logit: (h, w) log odds that a fruit's centre is there.
        circles: (h, w, 3) x, y, radius of that fruit, in the picture's pixels.
        visible: (h, w) how much of it can be seen.
        pitch_px: of the picture, from one place to the next.
    """

    logit: Floats32
    circles: Floats32
    visible: Floats32
    pitch_px: float

    def heat(self) -> npt.NDArray[np.uint8]:
        """(h, w) 255 times the probabilities, for people."""
        return np.round(255 / (1 + np.exp(-self.logit))).astype(np.uint8)

    def peaks(self, least: float) -> Floats:
        """(P, 3) circles where the probability is highest among neighbours, and at least that."""
        highest = cv2.dilate(self.logit, np.ones((3, 3), np.uint8))
        rows, columns = np.nonzero((self.logit >= highest) & (self.logit > _logit(least)))
        return self.circles[rows, columns].astype(float)

    def measures(self, circles: Floats) -> Floats32:
        """What it says of each circle.

        Args:
            circles: (N, 3) x, y, radius.

        Returns:
            (N, CENTRE_MEASURES): the log odds of a centre there; the highest nearby; and where
            that is, the logarithm of its radius over the circle's, how far off its centre is, in
            radii, and how much of it can be seen.
        """
        x, y, radius = circles.astype(np.float32).T
        there = self.logit[self._places(x, y)]
        columns = x[:, None] + radius[:, None] * np.tile(_NEAR, len(_NEAR))
        rows = y[:, None] + radius[:, None] * np.repeat(_NEAR, len(_NEAR))
        near = self._places(columns, rows)
        best = self.logit[near].argmax(1)
        chosen = tuple(axis[np.arange(len(best)), best] for axis in near)
        told = self.circles[chosen]
        away = np.hypot(told[:, 0] - x, told[:, 1] - y) / radius
        return np.column_stack([
            there, self.logit[chosen], np.log(np.maximum(told[:, 2], 1) / radius).clip(-1, 1),
            np.minimum(away, 2), self.visible[chosen],
        ]).astype(np.float32)  # fmt: skip

    def at(self, x: Floats32, y: Floats32) -> "Centres":
        """What it says at points (...); its edge goes on outside."""
        places = self._places(x, y)
        return Centres(
            self.logit[places], self.circles[places], self.visible[places], self.pitch_px
        )

    def _places(
        self, x: Floats32, y: Floats32
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        height, width = self.logit.shape
        row, column = ((axis / self.pitch_px).astype(np.intp) for axis in (y, x))
        return row.clip(0, height - 1), column.clip(0, width - 1)


@dataclass(frozen=True, slots=True, eq=False)
class CentreModel:
    """A trained network.

    Attributes:
        onnx: its file (ONNX 1.x): (1, INPUTS, H, W) -> (1, OUTPUTS, H / CELL, W / CELL).
    """

    onnx: bytes

    def __call__(self, look: Look, nearness: Nearness | None) -> Centres:
        """Look at one view."""
        small, near = coarse_view(look.picture, look.rectification, nearness)
        height, width = small.shape[:2]
        seen = np.zeros(
            (INPUTS, -height % MULTIPLE + height, -width % MULTIPLE + width), np.float32
        )
        seen[:, :height, :width] = seen_by_network(small, near)
        network = _network(self.onnx)
        network.setInput(seen[None])
        said = network.forward()[0, :, : -(-height // CELL), : -(-width // CELL)]
        return told(said, look.picture.shape[1] / width)


def coarse_view(
    picture: Picture, rectification: Rectification, nearness: Nearness | None
) -> tuple[Picture, Floats32]:
    """The picture as small as the network sees it, and the usual radius there; (h, w) both."""
    coarser = COARSER * rectification.focal_px / PAPERS_FOCAL_PX
    height, width = picture.shape[:2]
    size_px = (max(1, round(width / coarser)), max(1, round(height / coarser)))
    small = shrunk(picture, size_px)
    return small, near_px(nearness, small, coarser)


def near_px(nearness: Nearness | None, small: Picture, coarser: float) -> Floats32:
    """(h, w) the radius that an apple has there in the small picture's pixels, or 0."""
    height, width = small.shape[:2]
    if nearness is None:
        return np.zeros((height, width), np.float32)
    radius = nearness.disparity_px * np.float32(nearness.radius_per_px / coarser)
    resized = cv2.resize(radius, (width, height), interpolation=cv2.INTER_NEAREST)
    return cast("Floats32", resized)


def seen_by_network(small: Picture, near: Floats32) -> Floats32:
    """(INPUTS, h, w) of a small picture and of the usual radius there (0 unknown)."""
    size = np.where(near > 0, np.log(np.maximum(near, 0.25) / USUAL_PX) / 2 + 1, 0)
    colours = small.transpose(2, 0, 1) * np.float32(1 / 255) - np.float32(0.35)
    return np.concatenate([colours, size[None]]).astype(np.float32)


def told(said: Floats32, coarser: float) -> Centres:
    """What (OUTPUTS, h, w) mean in a picture that is so many times as large as the small one."""
    height, width = said.shape[1:]
    radius = np.exp(np.clip(said[1], -4, 4)) * np.float32(USUAL_PX * coarser)
    pitch_px = CELL * coarser
    middle = (pitch_px - 1) / 2
    x = np.arange(width, dtype=np.float32) * pitch_px + middle + said[2] * radius
    y = np.arange(height, dtype=np.float32)[:, None] * pitch_px + middle + said[3] * radius
    return Centres(said[0], np.stack([x, y, radius], -1).astype(np.float32), said[4], pitch_px)


@cache
def _network(onnx: bytes) -> Any:
    """One a process; OpenCV's own copy cannot be given to another."""
    content = np.frombuffer(onnx, np.uint8)
    # the new engine takes a third longer
    return cv2.dnn.readNetFromONNX(content, engine=cv2.dnn.ENGINE_CLASSIC)


def _logit(probability: float) -> float:
    return float(np.log(probability / (1 - probability)))
