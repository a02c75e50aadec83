"""Cleaning against the paper's Sec. 2.3, rule by rule, on masks of a few pixels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from processor.clean import AreaRule, Order, SizeFloor
from processor.trace import Mask
from tests.scenes import disc_mask, recognised

EIGHT = np.ones((3, 3), bool)
ALL = AreaRule(smallest_share=0, kernel_px=1)  # no rule but filling and tracing
SIZE_ONLY = AreaRule(kernel_px=1)


def mask_of(*boxes: tuple[int, int, int, int], size_px: tuple[int, int] = (64, 64)) -> Mask:
    """Boxes of x, y, width, height."""
    mask = np.zeros((size_px[1], size_px[0]), np.uint8)
    for x, y, width, height in boxes:
        mask[y : y + height, x : x + width] = 255
    return mask


def areas(rule: AreaRule, mask: Mask) -> list[int]:
    return sorted(region.area_px for region in rule(recognised(mask)).regions)


def test_a_region_of_exactly_an_eighth_of_the_largest_is_kept() -> None:
    assert areas(SIZE_ONLY, mask_of((0, 0, 16, 16), (30, 0, 8, 4))) == [32, 256]


def test_a_region_of_one_pixel_less_than_an_eighth_is_dropped() -> None:
    mask = mask_of((0, 0, 16, 16), (30, 0, 8, 4))
    mask[0, 30] = 0
    assert areas(SIZE_ONLY, mask) == [256]


def test_the_paper_weighs_regions_before_it_opens_them_and_its_other_reading_after() -> None:
    # a square of 25 px with a whisker of 8 px that opening removes: 33 px is above an eighth of
    # 256, 25 px is below
    mask = mask_of((0, 0, 16, 16), (30, 10, 5, 5), (35, 12, 8, 1))
    assert areas(AreaRule(), mask) == [25, 256]
    assert areas(AreaRule(order="morphology_first"), mask) == [256]


def test_opening_removes_what_no_3_by_3_square_fits_into() -> None:
    assert areas(AreaRule(smallest_share=0), mask_of((5, 5, 3, 3), (20, 20, 2, 30))) == [9]


@pytest.mark.parametrize(("gap_px", "regions"), [(2, 1), (3, 2)])
def test_closing_joins_regions_not_more_than_two_pixels_apart(gap_px: int, regions: int) -> None:
    mask = mask_of((10, 10, 10, 10), (20 + gap_px, 10, 10, 10))
    assert len(areas(AreaRule(), mask)) == regions


def test_the_order_is_opening_then_closing() -> None:
    # opening first removes the thin bridge, and two 3 px wide gaps stay open
    mask = mask_of((10, 10, 10, 10), (23, 10, 10, 10), (20, 14, 3, 1))
    assert areas(AreaRule(), mask) == [100, 100]


def test_a_highlight_inside_a_fruit_is_filled_and_counts_to_its_area() -> None:
    mask = mask_of((10, 10, 20, 20))
    mask[15:20, 15:20] = 0
    cleaning = AreaRule()(recognised(mask))
    assert cleaning.mask[17, 17] == 255
    assert [region.area_px for region in cleaning.regions] == [400]


def test_a_fruit_within_a_ring_becomes_part_of_it() -> None:
    mask = disc_mask((32, 32, 30), size_px=(64, 64)) - disc_mask((32, 32, 20), size_px=(64, 64))
    mask |= disc_mask((32, 32, 10), size_px=(64, 64))
    cleaning = ALL(recognised(mask))
    assert len(cleaning.regions) == 1
    np.testing.assert_array_equal(cleaning.mask, disc_mask((32, 32, 30), size_px=(64, 64)))


def test_squares_that_touch_at_a_corner_are_one_region() -> None:
    assert areas(ALL, mask_of((10, 10, 5, 5), (15, 15, 5, 5))) == [50]


def test_a_region_at_the_pictures_border_keeps_all_its_pixels() -> None:
    mask = mask_of((0, 0, 10, 64), (50, 54, 14, 10))
    assert areas(AreaRule(), mask) == [140, 640]


def test_an_empty_mask_has_no_regions() -> None:
    for order in ("area_first", "morphology_first"):
        cleaning = AreaRule(order=order)(recognised(mask_of()))
        assert cleaning.regions == ()
        assert not cleaning.mask.any()


def test_a_full_mask_is_one_region() -> None:
    assert areas(AreaRule(), mask_of((0, 0, 64, 64))) == [64 * 64]


masks = arrays(np.bool_, (14, 17)).map(lambda a: a.astype(np.uint8) * np.uint8(255))


@settings(max_examples=150, deadline=None)
@given(masks)
def test_holes_are_filled_as_a_flood_from_outside_fills_the_background(mask: Mask) -> None:
    cleaning = ALL(recognised(mask))
    np.testing.assert_array_equal(cleaning.mask > 0, ndimage.binary_fill_holes(mask > 0))


@settings(max_examples=150, deadline=None)
@given(masks)
def test_regions_are_the_8_connected_components_with_their_pixel_counts(mask: Mask) -> None:
    cleaning = ALL(recognised(mask))
    labels, count = ndimage.label(cleaning.mask, EIGHT)
    expected = sorted(np.bincount(labels.ravel(), minlength=count + 1)[1:].tolist())
    assert sorted(region.area_px for region in cleaning.regions) == expected


@settings(max_examples=150, deadline=None)
@given(masks)
def test_contours_are_the_8_connected_boundary_pixels_of_their_region(mask: Mask) -> None:
    cleaning = ALL(recognised(mask))
    filled = cleaning.mask > 0
    inside = ndimage.binary_erosion(filled)  # all 4 neighbours are fruit; outside is not
    boundary = {(int(x), int(y)) for y, x in np.argwhere(filled & ~inside)}
    traced = {(x, y) for r in cleaning.regions for x, y in r.contour_px.tolist()}
    assert traced == boundary
    for region in cleaning.regions:
        assert region.contour_px.dtype == np.int32
        steps = np.diff(region.contour_px, axis=0, append=region.contour_px[:1])
        assert np.abs(steps).max(initial=0) <= 1
        x, y, width, height = region.box_px
        low, high = region.contour_px.min(axis=0), region.contour_px.max(axis=0)
        assert (x, y) == tuple(low.tolist())
        assert (x + width - 1, y + height - 1) == tuple(high.tolist())


@settings(max_examples=100, deadline=None)
@given(masks, st.sampled_from(["area_first", "morphology_first"]))
def test_the_rules_are_those_of_scipy_one_after_the_other(mask: Mask, order: Order) -> None:
    def drop(fruit: Mask) -> Mask:
        labels, count = ndimage.label(fruit, EIGHT)
        sizes = np.bincount(labels.ravel(), minlength=count + 1)
        sizes[0] = 0
        kept = sizes * 8 >= sizes.max()
        kept[0] = False
        return np.asarray(kept[labels], np.uint8)

    def open_close(fruit: Mask) -> Mask:
        # beyond the border an erosion sees fruit and a dilation none: the border erases nothing
        def erode(a: Mask) -> Mask:
            return np.asarray(ndimage.minimum_filter(a, 3, mode="constant", cval=1))

        def dilate(a: Mask) -> Mask:
            return np.asarray(ndimage.maximum_filter(a, 3, mode="constant", cval=0))

        return erode(dilate(dilate(erode(fruit))))

    steps = (drop, open_close) if order == "area_first" else (open_close, drop)
    fruit = (mask > 0).astype(np.uint8)
    for step in steps:
        fruit = step(fruit)
    found = AreaRule(order=order)(recognised(mask)).mask > 0
    np.testing.assert_array_equal(found, ndimage.binary_fill_holes(fruit))


def test_cleaning_leaves_the_recognised_mask_as_it_is() -> None:
    mask = disc_mask((30, 30, 15), (5, 5, 1), size_px=(64, 64))
    before = mask.copy()
    AreaRule()(recognised(mask))
    np.testing.assert_array_equal(mask, before)


def test_the_size_floor_keeps_a_small_region_beside_a_large_one_and_drops_specks() -> None:
    mask = disc_mask((100, 100, 60), (250, 60, 8), (250, 160, 2), size_px=(320, 240))
    found = SizeFloor()(recognised(mask))
    assert len(found.regions) == 2
    assert not found.mask[158:163, 248:253].any()
    assert {region.area_px for region in found.regions} == {
        int((disc_mask(disc, size_px=(320, 240)) > 0).sum())
        for disc in ((100, 100, 60), (250, 60, 8))
    }


def test_the_size_floor_keeps_a_leafs_hole_and_fills_a_highlight() -> None:
    mask = disc_mask((100, 100, 60), size_px=(320, 240))
    mask[90:110, 90:110] = 0
    mask[70:74, 70:74] = 0
    found = SizeFloor()(recognised(mask)).mask
    assert not found[95:105, 95:105].any()
    assert found[70:74, 70:74].all()
