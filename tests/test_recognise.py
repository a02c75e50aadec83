"""Recognition against the paper's formulas, computed in floating point for every colour."""

import numpy as np
import numpy.typing as npt
import pytest

from processor.recognise import (
    ColourRatio,
    Reading,
    RedMinusLuma,
    TwoRedMinusGreenBlue,
)
from processor.trace import Recogniser
from recorder.records import Picture
from tests.scenes import LEAF, RED, red_disc_picture

Bools = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]


def all_colours_with(red: int) -> Picture:
    green, blue = np.mgrid[:256, :256].astype(np.uint8)
    return np.stack([blue, green, np.full_like(blue, red)], axis=-1)


def by_the_formula(reading: Reading, blue: Floats, green: Floats, red: Floats) -> Bools:
    if reading == "difference":
        return (red - green > 0) & (red - green > green - blue)
    if reading == "absolute":
        return (red - green > 0) & (red - green > np.abs(green - blue))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (red - green) / (green - blue)
    return (red - green > 0) & np.isfinite(ratio) & (ratio > 1)


@pytest.mark.parametrize("reading", ["signed", "difference", "absolute"])
def test_each_reading_is_its_formula_for_all_16_million_colours(reading: Reading) -> None:
    rule = ColourRatio(reading)
    for red in range(256):
        picture = all_colours_with(red)
        blue, green, _ = np.moveaxis(picture.astype(np.float64), -1, 0)
        expected = by_the_formula(reading, blue, green, np.full_like(blue, red))
        found = rule(picture)
        np.testing.assert_array_equal(found.mask, expected * np.uint8(255))
        np.testing.assert_array_equal(found.index, np.maximum(red - green, 0))


@pytest.mark.parametrize(
    ("blue", "green", "red", "signed", "difference", "absolute"),
    [
        (40, 40, 200, False, True, True),  # G = B: the ratio is undefined
        (40, 40, 40, False, False, False),  # grey: R - G > 0 fails
        (60, 40, 50, False, True, False),  # B > G, R - G = 10 < |G - B| = 20
        (60, 40, 90, False, True, True),  # B > G, R - G = 50 > 20
        (20, 60, 100, False, False, False),  # R - G = G - B: the ratio is 1, not above
        (20, 60, 101, True, True, True),
        (0, 255, 255, False, False, False),  # R = G
        (255, 0, 1, False, True, False),  # the bluest of reds
    ],
)
def test_the_readings_differ_where_green_is_not_above_blue(
    blue: int, green: int, red: int, signed: bool, difference: bool, absolute: bool
) -> None:
    pixel = np.array([[[blue, green, red]]], np.uint8)
    answers = {"signed": signed, "difference": difference, "absolute": absolute}
    readings: tuple[Reading, ...] = ("signed", "difference", "absolute")
    assert {r: bool(ColourRatio(r)(pixel).mask[0, 0]) for r in readings} == answers


def test_2r_minus_g_minus_b_is_its_formula_clipped_for_every_colour() -> None:
    rule = TwoRedMinusGreenBlue(threshold=40)
    for red in range(256):
        picture = all_colours_with(red)
        blue, green, _ = np.moveaxis(picture.astype(np.int64), -1, 0)
        found = rule(picture)
        index = np.clip(2 * red - green - blue, 0, 255)
        np.testing.assert_array_equal(found.index, index)
        np.testing.assert_array_equal(found.mask, (index > 40) * np.uint8(255))


def test_red_minus_luma_is_its_formula_clipped_for_every_colour() -> None:
    rule = RedMinusLuma(threshold=40)
    for red in range(0, 256, 3):
        picture = all_colours_with(red)
        blue, green, _ = np.moveaxis(picture.astype(np.float64), -1, 0)
        found = rule(picture)
        luma = 0.299 * red + 0.587 * green + 0.114 * blue
        # OpenCV computes luma in fixed point and rounds it: half a grey level, and a bit
        assert np.abs(found.index - np.maximum(red - luma, 0)).max() <= 0.51
        np.testing.assert_array_equal(found.mask, (found.index > 40) * np.uint8(255))


def otsu_by_trying_all(index: npt.NDArray[np.uint8]) -> int:
    values = index.ravel().astype(np.float64)

    def between(cut: int) -> float:
        low, high = values[values <= cut], values[values > cut]
        if not len(low) or not len(high):
            return 0.0
        return float(len(low) * len(high) * (low.mean() - high.mean()) ** 2)

    return max(range(256), key=between)


@pytest.mark.parametrize("rule", [TwoRedMinusGreenBlue(), RedMinusLuma()])
def test_otsus_threshold_separates_the_two_classes_best(
    rule: TwoRedMinusGreenBlue | RedMinusLuma,
) -> None:
    random = np.random.default_rng(4)
    picture = red_disc_picture((60, 40, 30), size_px=(120, 80)).astype(np.int16)
    noisy = np.clip(picture + random.normal(0, 12, picture.shape), 0, 255).astype(np.uint8)
    found = rule(noisy)
    cut = otsu_by_trying_all(found.index)
    np.testing.assert_array_equal(found.mask, (found.index > cut) * np.uint8(255))
    assert found.mask[40, 60] == 255
    assert found.mask[5, 5] == 0


@pytest.mark.parametrize("kind", [TwoRedMinusGreenBlue, RedMinusLuma])
def test_a_fixed_threshold_of_zero_is_not_otsus(
    kind: type[TwoRedMinusGreenBlue] | type[RedMinusLuma],
) -> None:
    picture = np.array([[[10, 10, 20], [10, 10, 250]]], np.uint8)  # both redder than grey
    assert kind(threshold=0.0)(picture).mask.tolist() == [[255, 255]]
    assert kind()(picture).mask.tolist() == [[0, 255]]


def test_red_is_fruit_and_a_leaf_is_not_by_every_rule() -> None:
    picture = np.array([[RED, LEAF]], np.uint8)
    readings: tuple[Reading, ...] = ("signed", "difference", "absolute")
    rules: list[Recogniser] = [ColourRatio(reading) for reading in readings]
    for rule in (*rules, TwoRedMinusGreenBlue(), RedMinusLuma()):
        assert rule(picture).mask.tolist() == [[255, 0]]


def test_recognition_leaves_the_picture_as_it_is() -> None:
    picture = red_disc_picture((20, 20, 10), size_px=(40, 40))
    before = picture.copy()
    for rule in (ColourRatio(), TwoRedMinusGreenBlue(), RedMinusLuma()):
        rule(picture)
    np.testing.assert_array_equal(picture, before)
