"""Circle finders against circles that are known exactly, and rings counted one by one."""

from itertools import product

import numpy as np
import pytest

from processor.circles import CIRCLES, HoughCircles, RandomRing
from processor.clean import AreaRule
from processor.trace import Cleaning, Look, Mask, Region
from recorder.rectify import rectify
from tests.scenes import disc_mask, painted, recognised, small_rig

SIZE = (320, 240)
ALL = AreaRule(smallest_share=0, kernel_px=1)
SEED = (0, 0, 0)
# those of one circle a region; test_fruit.py has the one that finds several
CONTOUR_FINDERS = [name for name in CIRCLES if name != "fruit_finder"]


def look() -> Look:
    """A finder's look at an empty picture."""
    mask = disc_mask(size_px=SIZE)
    return Look(painted(mask), recognised(mask), rectify(small_rig()))


def cleaned(mask: Mask) -> Cleaning:
    return ALL(recognised(mask))


def disc(x: float, y: float, radius: float) -> Cleaning:
    return cleaned(disc_mask((x, y, radius), size_px=SIZE))


def contour(*points: tuple[int, int]) -> Region:
    array = np.array(points, np.int32).reshape(-1, 2)
    return Region(len(points), (0, 0, 1, 1), array)


def cleaning(*regions: Region) -> Cleaning:
    return Cleaning(np.zeros((1, 1), np.uint8), regions)


def on_circle(radius: int, x: int = 150, y: int = 120) -> Region:
    """The pixels whose centres are exactly on a circle: any three of them say all of it."""
    span = range(-radius, radius + 1)
    exact = [(x + i, y + j) for i, j in product(span, span) if i * i + j * j == radius * radius]
    return contour(*exact)


def test_a_circle_through_whole_pixels_is_recovered_exactly() -> None:
    (fruit,) = RandomRing()(cleaning(on_circle(50)), SEED).fruit
    # 20 pixels, coordinates of 100: what is left is rounding in the 16th digit
    assert (fruit.x_px, fruit.y_px, fruit.radius_px) == pytest.approx((150, 120, 50), abs=1e-9)
    assert fruit.inliers == 20


@pytest.mark.parametrize("radius", [25, 65])
def test_a_ring_outside_30_to_60_px_is_discarded(radius: int) -> None:
    found = RandomRing()(cleaning(on_circle(radius)), SEED)
    assert found.fruit == ()
    assert found.tried.shape == (0, 5)


def test_both_ends_of_the_window_belong_to_it() -> None:
    found = RandomRing(min_radius_px=50, max_radius_px=50)(cleaning(on_circle(50)), SEED)
    assert len(found.tried) > 300  # of 400: some draw a point twice, some round off
    assert set(found.tried[:, 3].tolist()) == {50.0}


def test_every_tried_ring_is_within_the_window_and_no_more_than_rounds() -> None:
    found = RandomRing()(disc(150, 120, 58), SEED)  # noisy triples lead out of the window
    radii = found.tried[:, 3]
    assert 0 < len(radii) < 400
    assert radii.min() >= 30
    assert radii.max() <= 60


def count_on_ring(region: Region, ring: tuple[float, ...], half_width_px: float) -> int:
    x, y, radius = ring
    return sum(abs(np.hypot(px - x, py - y) - radius) <= half_width_px for px, py in
               region.contour_px.tolist())  # fmt: skip


@pytest.mark.parametrize(
    "rule",
    [
        RandomRing(rounds=60),
        RandomRing(rounds=60, ring_px=1.0),
        RandomRing(rounds=60, ring_px=0.0),
        RandomRing(rounds=60, ring_px=25.0, min_radius_px=5.0),  # wider than its own circle
    ],
)
def test_the_points_on_a_ring_are_those_that_a_loop_counts(rule: RandomRing) -> None:
    blob = disc_mask((150, 120, 45), (190, 130, 30), (110, 80, 10), size_px=SIZE)
    regions = cleaned(blob).regions
    found = rule(cleaned(blob), SEED)
    assert len(found.tried) > 20
    for number, *ring, points in found.tried.tolist():
        # rings are kept in single precision: a point that close to the edge may be either
        slack = 1e-3
        least = count_on_ring(regions[int(number)], tuple(ring), rule.ring_px - slack)
        most = count_on_ring(regions[int(number)], tuple(ring), rule.ring_px + slack)
        assert least <= points <= most


def test_the_fullest_ring_wins() -> None:
    found = RandomRing()(disc(150, 120, 45), SEED)
    (fruit,) = found.fruit
    assert fruit.inliers == found.tried[:, 4].max()
    winner = found.tried[int(np.argmax(found.tried[:, 4]))]
    assert (fruit.x_px, fruit.y_px, fruit.radius_px) == pytest.approx(winner[1:4], rel=1e-6)


def test_points_on_a_line_have_no_circle() -> None:
    assert RandomRing()(cleaning(contour(*((i, 2 * i) for i in range(50)))), SEED).fruit == ()


@pytest.mark.parametrize("points", [1, 2])
def test_fewer_than_three_points_have_no_circle(points: int) -> None:
    region = contour(*((10 * i, 0) for i in range(points)))
    assert RandomRing()(cleaning(region), SEED).fruit == ()


def test_a_region_without_a_circle_leaves_the_others_theirs() -> None:
    found = RandomRing()(cleaning(contour((5, 5)), on_circle(50), on_circle(25)), SEED)
    assert [fruit.region for fruit in found.fruit] == [1]
    assert found.fruit[0].radius_px == pytest.approx(50)


def test_a_seed_gives_the_same_rings_and_another_seed_others() -> None:
    region = disc(150, 120, 45)
    first, again, other = (RandomRing()(region, seed) for seed in ((1, 2, 0), (1, 2, 0), (1, 3, 0)))
    np.testing.assert_array_equal(first.tried, again.tried)
    assert first.fruit == again.fruit
    assert not np.array_equal(first.tried, other.tried)


def test_a_regions_rings_do_not_depend_on_the_other_regions() -> None:
    mine = on_circle(50)
    alone = RandomRing()(cleaning(mine, contour((0, 0))), SEED)
    crowd = RandomRing()(cleaning(mine, on_circle(45), on_circle(39)), SEED)
    np.testing.assert_array_equal(alone.tried, crowd.tried[crowd.tried[:, 0] == 0])


@pytest.mark.parametrize("seed", range(10))
def test_a_half_hidden_disc_keeps_its_centre_and_radius(seed: int) -> None:
    mask = disc_mask((150, 120, 45), size_px=SIZE)
    mask[:, 150:] = 0  # a straight leaf's edge over the right half
    (fruit,) = RandomRing()(cleaned(mask), (seed, 0, 0)).fruit
    # the ring is 10 px wide: a circle moved so far from the edge still has the whole arc in it,
    # and more of the edge; its radius shrinks with that
    assert (fruit.x_px, fruit.y_px) == pytest.approx((150, 120), abs=10)
    assert fruit.radius_px == pytest.approx(45, abs=10)
    assert fruit.radius_px < 45


@pytest.mark.parametrize("seed", range(10))
def test_a_narrower_ring_places_a_half_hidden_disc_better(seed: int) -> None:
    mask = disc_mask((150, 120, 45), size_px=SIZE)
    mask[:, 150:] = 0
    (fruit,) = RandomRing(ring_px=1.0)(cleaned(mask), (seed, 0, 0)).fruit
    # twice the ring, as above; the contour runs half a pixel inside the outline
    assert (fruit.x_px, fruit.y_px) == pytest.approx((150, 120), abs=2)
    assert fruit.radius_px == pytest.approx(44.5, abs=2)


def test_more_rounds_make_the_radius_steadier() -> None:
    """The paper's Fig. 6: the variance of 100 fits falls with the rounds and is flat at 400.

    That needs an irregular contour. Of a clean disc's contour every point lies in the 10 px wide
    ring of nearly any three, the first of the equals wins, and more rounds change nothing.
    """
    rows, columns = np.mgrid[:240, :320]
    around = np.arctan2(rows - 120, columns - 150)
    outline_px = 45 + 3 * np.sin(3 * around) + 3 * np.sin(5 * around + 1)
    within = np.hypot(columns - 150, rows - 120) <= outline_px
    region = cleaned(within * np.uint8(255))

    def variance(rounds: int) -> float:
        rule = RandomRing(rounds=rounds)
        radii = [f.radius_px for s in range(100) for f in rule(region, (s, 0, 0)).fruit]
        return float(np.var(radii))

    few, usual, many = variance(5), variance(400), variance(1500)
    assert few > 10 * usual
    assert usual - many < (few - usual) / 10


def test_a_winner_carries_its_regions_area_and_box() -> None:
    region = disc(150, 120, 45)
    (fruit,) = RandomRing()(region, SEED).fruit
    assert fruit.area_px == region.regions[0].area_px
    assert fruit.box_px == region.regions[0].box_px


@pytest.mark.parametrize("radius", [35.0, 45.0, 55.0])
def test_hough_finds_a_disc_within_a_pixel_or_two(radius: float) -> None:
    (fruit,) = HoughCircles()(disc(150, 120, radius), SEED).fruit
    # an accumulator of whole pixels, and edges half a pixel outside the contour
    assert (fruit.x_px, fruit.y_px) == pytest.approx((150, 120), abs=2)
    assert fruit.radius_px == pytest.approx(radius, abs=2)


def test_hough_finds_nothing_in_a_speck() -> None:
    assert HoughCircles()(disc(150, 120, 8), SEED).fruit == ()


def test_hough_keeps_the_centre_of_a_disc_at_the_pictures_border() -> None:
    (fruit,) = HoughCircles()(disc(0, 120, 45), SEED).fruit
    # its straight edge at the border votes too
    assert (fruit.x_px, fruit.y_px) == pytest.approx((0, 120), abs=5)


@pytest.mark.parametrize("name", CONTOUR_FINDERS)
def test_a_finder_gives_at_most_one_circle_a_region_and_changes_nothing(name: str) -> None:
    three = cleaned(disc_mask((60, 60, 40), (200, 60, 40), (150, 180, 40), size_px=SIZE))
    contours = [region.contour_px.copy() for region in three.regions]
    found = CIRCLES[name]()(three, SEED, look())
    assert [fruit.region for fruit in found.fruit] == [0, 1, 2]
    for region, before in zip(three.regions, contours, strict=True):
        np.testing.assert_array_equal(region.contour_px, before)


@pytest.mark.parametrize("name", CONTOUR_FINDERS)
def test_a_picture_without_regions_has_no_fruit(name: str) -> None:
    found = CIRCLES[name]()(cleaning(), SEED, look())
    assert found.fruit == ()
    assert found.tried.shape == (0, 5)
    assert found.as_array().shape == (0, 3)
