"""Reading colours through learned tables."""

import cv2
import numpy as np
import pytest

from processor.colour_table import ENTRIES, ColourModel, ColourTable, pack, read_table
from tests.scenes import LEAF, RED, disc_mask, painted


def table_of(*colours: tuple[int, int, int]) -> np.ndarray:
    """255 for those colours, 0 for every other."""
    table = np.zeros(ENTRIES, np.uint8)
    table[pack(np.array([colours], np.uint8))] = 255
    return table


def identity() -> np.ndarray:
    """A context table that repeats what is close to a pixel."""
    entries = np.arange(ENTRIES)
    return ((entries >> 5 & 63) * 255 // 63).astype(np.uint8)


def test_a_packed_colour_has_five_six_and_five_bits() -> None:
    assert pack(np.array([[[255, 0, 0]]], np.uint8))[0, 0] == 31
    assert pack(np.array([[[0, 255, 0]]], np.uint8))[0, 0] == 63 << 5
    assert pack(np.array([[[0, 0, 255]]], np.uint8))[0, 0] == 31 << 11


def test_reading_a_table_is_indexing() -> None:
    rng = np.random.default_rng(0)
    table = rng.integers(0, 256, ENTRIES, dtype=np.uint8)
    packed = rng.integers(0, ENTRIES, (7, 9), dtype=np.uint16)
    np.testing.assert_array_equal(read_table(table, packed), table[packed])


def test_a_learned_colour_is_recognised_and_another_is_not() -> None:
    mask = disc_mask((60, 60, 30), size_px=(160, 120))
    stage = ColourTable(ColourModel("test", table_of(RED), identity()))
    found = stage(painted(mask))
    inner = cv2.erode(mask, np.ones((7, 7), np.uint8)) > 0
    outer = cv2.dilate(mask, np.ones((7, 7), np.uint8)) == 0
    assert found.mask[inner].all()
    assert not found.mask[outer].any()
    assert found.calibrated
    assert (
        not ColourTable(ColourModel("t", table_of(LEAF), identity()))(painted(mask))
        .mask[inner]
        .any()
    )


def test_the_surroundings_are_means_over_three_widths() -> None:
    evidence = np.zeros((128, 128), np.uint8)
    evidence[:, 64:] = 255
    wide, close, near = cv2.split(
        ColourTable(ColourModel("t", *[identity()] * 2)).surroundings(evidence, 1)
    )
    assert close[64, 66] == near[64, 71] == 255
    assert close[64, 61] == near[64, 57] == 0
    assert 0 < near[64, 60] < 128
    assert 0 < wide[64, 45] < wide[64, 60] < wide[64, 85] < 255


def test_a_large_picture_is_read_at_half_its_size_and_answered_at_its_own() -> None:
    stage = ColourTable(ColourModel("t", *[identity()] * 2), halved_from_px=900_000)
    large = np.zeros((1000, 1000, 3), np.uint8)
    large[:, 500:] = 255
    assert stage.smooth(large).shape == (500, 500, 3)
    found = stage(large)
    assert found.index.shape == found.mask.shape == (1000, 1000)
    edge = np.flatnonzero(np.diff(found.mask[500].astype(int)))
    assert edge.tolist() == [499]  # where it is
    assert stage.smooth(large[:600, :600]).shape == (600, 600, 3)


@pytest.mark.parametrize("size_px", [100, 1000])
def test_pixels_that_were_clipped_are_named(size_px: int) -> None:
    picture = np.full((size_px, size_px, 3), 120, np.uint8)
    third = size_px // 3
    picture[:third] = 0
    picture[-third:, :, 2] = 255  # one channel is enough: its colour is no longer the fruit's
    found = ColourTable(ColourModel("t", *[identity()] * 2), halved_from_px=900_000)(
        picture
    ).clipped
    assert found is not None
    assert found.shape == (size_px, size_px)
    assert (found[: third - 4] == 255).all()
    assert (found[third + 4 : -third - 4] == 0).all()
    assert (found[4 - third :] == 255).all()
