"""How the pixels of pictures look in numbers: of apples, and of everything else."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from processor.recognise import ColourRatio
from recorder.errors import PomologError
from recorder.records import Labels, Picture, counted_fruit

QUANTILES: Final = (0.1, 0.5, 0.9)
RATIO_LIMIT: Final = 20.0  # a ratio beyond this says no more than that G is near B
BINS: Final = 60

Plane = npt.NDArray[np.float32]
Labelled = tuple[Picture, Labels]
"""A picture and its (H, W) labels: 0 is no apple, 65535 counts neither way."""


def red_minus_green(picture: Picture) -> Plane:
    """(H, W) R - G, grey levels."""
    return _channel(picture, 2) - _channel(picture, 1)


def ratio(picture: Picture) -> Plane:
    """(H, W) the paper's (R - G) / (G - B), clipped to +-20; NaN where G = B."""
    gap = _channel(picture, 1) - _channel(picture, 0)
    nowhere = np.full_like(gap, np.nan)
    found = np.divide(red_minus_green(picture), gap, out=nowhere, where=gap != 0)
    return cast("Plane", np.clip(found, -RATIO_LIMIT, RATIO_LIMIT))


def saturation(picture: Picture) -> Plane:
    """(H, W) 1 - least / greatest channel; 0 of black."""
    top = picture.max(-1).astype(np.float32)
    return cast(
        "Plane", np.divide(top - picture.min(-1), top, out=np.zeros_like(top), where=top > 0)
    )


def edge(picture: Picture) -> Plane:
    """(H, W) gradient of luminance, grey levels a pixel."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    across, down = (cv2.Sobel(grey, cv2.CV_32F, dx, 1 - dx) / 8 for dx in (1, 0))
    return cast("Plane", np.hypot(across, down))


def _channel(picture: Picture, number: int) -> Plane:
    return picture[..., number].astype(np.float32)


@dataclass(frozen=True, slots=True)
class Feature:
    """A number that every pixel has; `span` of it is drawn, with `decimals` it is printed."""

    of: Callable[[Picture], Plane]
    span: tuple[float, float]
    decimals: int


FEATURES: Final = {
    "R-G": Feature(red_minus_green, (-80, 220), 0),
    "(R-G)/(G-B)": Feature(ratio, (-6, 6), 1),
    "saturation": Feature(saturation, (0, 1), 2),
    "edge": Feature(edge, (0, 40), 1),
}
PIXELS: Final[dict[str, Callable[[Labels], npt.NDArray[np.bool_]]]] = {
    "apple": counted_fruit,
    "other": lambda labels: np.asarray(labels == 0),
}


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """One feature of all pixels of one kind.

    Attributes:
        quantiles: the 10th, 50th and 90th percentile.
        shares: (60,) of all pixels, in equal bins of the feature's span; those beyond are in none.
    """

    quantiles: tuple[float, float, float]
    shares: npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """What all pixels of one kind look like: each feature, and the share that the rule keeps."""

    spreads: Mapping[str, Spread]
    kept: float


def summary(name: str, pictures: Sequence[Labelled], kind: str) -> Summary:
    """Measure the pixels of one kind, "apple" or "other", of a set of this name.

    Raises:
        PomologError: there are none.
    """
    chosen = [PIXELS[kind](labels) for _, labels in pictures]
    total = sum(int(mask.sum()) for mask in chosen)
    if total == 0:
        raise PomologError(f"{name}: no pixel is labelled as {kind}; are all its labels there?")
    spreads = {}
    for key, feature in FEATURES.items():  # one at a time, as hundreds of pictures are large
        values = np.concatenate(
            [feature.of(picture)[mask] for (picture, _), mask in zip(pictures, chosen, strict=True)]
        )
        low, middle, high = np.nanquantile(values, QUANTILES).tolist()
        shares = np.histogram(values, BINS, feature.span)[0] / total
        spreads[key] = Spread((low, middle, high), shares)
    rule = ColourRatio("signed")
    kept = sum(
        np.count_nonzero(rule(picture).mask[mask])
        for (picture, _), mask in zip(pictures, chosen, strict=True)
    )
    return Summary(spreads, kept / total)


def cells(found: Summary) -> list[str]:
    """What the table says of one summary: percentiles of each feature, and what the rule keeps."""
    texts = [
        " / ".join(f"{q:.{feature.decimals}f}" for q in found.spreads[key].quantiles)
        for key, feature in FEATURES.items()
    ]
    return [*texts, f"{found.kept * 100:.0f} %"]
