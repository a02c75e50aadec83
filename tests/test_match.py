"""Matching against the paper's Sec. 2.5, on views made by hand and on all small alignments."""

from itertools import combinations

import numpy as np
import pytest

from processor.match import AreaInOrder
from processor.trace import Floats, Fruit, Mask
from tests.scenes import disc_mask, fruit, view

NO_LINE = AreaInOrder(reference_line=False)
SIZE = (320, 240)


def pairs(rule: AreaInOrder, left: list[Fruit], right: list[Fruit]) -> list[tuple[int, int]]:
    return [(i, j) for i, j in rule(view(*left), view(*right)).pairs.tolist()]


@pytest.mark.parametrize(
    ("row_px", "matched"), [(89.9, False), (90.0, True), (109.9, True), (110.0, False)]
)
def test_a_partners_centre_lies_in_the_rows_of_the_left_fruits_region(
    row_px: float, matched: bool
) -> None:
    asked = fruit(200, 100, height_px=20)  # rows 90 to 109
    assert pairs(NO_LINE, [asked], [fruit(150, row_px)]) == ([(0, 0)] if matched else [])


def test_the_band_is_as_high_as_the_left_region_not_the_right_one() -> None:
    tall, low = fruit(200, 100, height_px=60), fruit(150, 120, height_px=10)
    assert pairs(NO_LINE, [tall], [low]) == [(0, 0)]
    assert pairs(NO_LINE, [low], [tall]) == []


def test_of_several_in_the_band_the_one_of_the_nearest_area_is_taken() -> None:
    right = [fruit(100, area_px=250), fruit(130, area_px=290), fruit(160, area_px=350)]
    assert pairs(NO_LINE, [fruit(200, area_px=300)], right) == [(0, 1)]


@pytest.mark.parametrize(("area_px", "matched"), [(150, True), (149, False), (600, True)])
def test_areas_that_differ_by_more_than_half_the_larger_are_no_match(
    area_px: int, matched: bool
) -> None:
    found = pairs(NO_LINE, [fruit(200, area_px=300)], [fruit(150, area_px=area_px)])
    assert found == ([(0, 0)] if matched else [])


def test_order_decides_between_fruit_of_similar_area() -> None:
    # the paper's P and Q (Fig. 4): by area alone P goes with Q' and Q with P'
    left = [fruit(150, area_px=300), fruit(250, area_px=310)]
    right = [fruit(50, area_px=309), fruit(150, area_px=301)]
    assert pairs(NO_LINE, left, right) == [(0, 0), (1, 1)]
    free = AreaInOrder(in_order=False, reference_line=False)
    assert pairs(free, left, right) == [(0, 1), (1, 0)]


def test_a_fruit_seen_by_one_camera_only_stays_alone() -> None:
    left = [fruit(100, area_px=600), fruit(150, area_px=300), fruit(250, area_px=900)]
    right = [fruit(50, area_px=310), fruit(150, area_px=880)]
    assert pairs(NO_LINE, left, right) == [(1, 0), (2, 1)]


def test_fruit_may_come_in_any_order() -> None:
    left = [fruit(250, area_px=900), fruit(100, area_px=600), fruit(150, area_px=300)]
    right = [fruit(150, area_px=880), fruit(50, area_px=310)]
    assert pairs(NO_LINE, left, right) == [(2, 1), (0, 0)]


def test_the_cost_of_a_match_is_its_difference_of_area() -> None:
    found = NO_LINE(view(fruit(200, area_px=300)), view(fruit(150, area_px=400)))
    assert found.cost.tolist() == [0.25]


def shifted(mask: Mask, shift_px: int) -> Mask:
    return np.roll(mask, shift_px, axis=1)


def test_the_reference_line_is_the_shift_between_the_views() -> None:
    right = disc_mask((40, 60, 20), (120, 150, 30), size_px=SIZE)
    found = AreaInOrder()(view(mask=shifted(right, 70)), view(mask=right))
    assert found.reference_px == 70


def test_fruit_left_of_the_reference_line_is_ignored_and_on_it_is_asked() -> None:
    right = disc_mask((40, 60, 20), (120, 150, 30), size_px=SIZE)
    left = shifted(right, 70)
    beside, on = fruit(69.9, 100), fruit(70.0, 100)
    found = AreaInOrder()(view(on, beside, mask=left), view(fruit(10, 100), mask=right))
    assert found.ignored_left == (1,)
    assert found.pairs.tolist() == [[0, 0]]


def test_without_the_reference_line_nothing_is_ignored_and_none_is_sought() -> None:
    right = disc_mask((40, 60, 20), size_px=SIZE)
    left = shifted(right, 70)
    found = NO_LINE(view(fruit(10, 100), mask=left), view(fruit(5, 100), mask=right))
    assert found.ignored_left == ()
    assert found.pairs.tolist() == [[0, 0]]
    assert found.reference_px is None
    assert found.projections.shape == (2, 0)
    assert found.correlation.shape == (0,)


def test_the_projections_count_the_pixels_of_every_column() -> None:
    left = disc_mask((40, 60, 20), size_px=SIZE)
    right = disc_mask((100, 150, 30), size_px=SIZE)
    found = AreaInOrder()(view(mask=left), view(mask=right))
    expected = [[int((mask[:, j] > 0).sum()) for j in range(320)] for mask in (left, right)]
    assert found.projections.tolist() == expected


def test_the_correlation_is_the_papers_third_equation() -> None:
    random = np.random.default_rng(0)
    left, right = ((random.random((8, 40)) < 0.3) * np.uint8(255) for _ in range(2))
    found = AreaInOrder()(view(mask=left), view(mask=right))
    s_l, s_r = (found.projections[i] for i in (0, 1))
    width = 40
    for n in range(width):
        r_n = sum(s_r[j] * s_l[j + n] for j in range(width) if j + n < width) / width
        assert found.correlation[n] == pytest.approx(r_n)
    assert len(found.correlation) == width


def test_empty_views_have_no_match() -> None:
    for rule in (AreaInOrder(), AreaInOrder(in_order=False)):
        for left, right in (([], []), ([fruit(100)], []), ([], [fruit(100)])):
            found = rule(view(*left), view(*right))
            assert found.pairs.shape == (0, 2)
            assert found.cost.shape == (0,)


def gain_of(chosen: list[tuple[int, int]], difference: Floats) -> float:
    return float(sum(0.5 - difference[i, j] for i, j in chosen))


def best_gain_by_trying_all(difference: Floats) -> float:
    """The most that any choice of pairs without a crossing gains."""
    rows, columns = difference.shape
    best = 0.0
    for size in range(1, min(rows, columns) + 1):
        for lefts in combinations(range(rows), size):
            for rights in combinations(range(columns), size):
                chosen = list(zip(lefts, rights, strict=True))
                if all(difference[i, j] <= 0.5 for i, j in chosen):
                    best = max(best, gain_of(chosen, difference))
    return best


@pytest.mark.parametrize("seed", range(60))
def test_the_alignment_is_the_best_of_all_that_keep_the_order(seed: int) -> None:
    random = np.random.default_rng(seed)

    def some(count: int) -> list[Fruit]:
        columns = np.sort(random.uniform(0, 320, count))
        rows, areas = random.integers(85, 116, count), random.integers(100, 400, count)
        return [
            fruit(x, y, area_px=area)
            for x, y, area in zip(columns.tolist(), rows.tolist(), areas.tolist(), strict=True)
        ]

    left, right = some(int(random.integers(1, 6))), some(int(random.integers(1, 6)))
    difference = np.full((len(left), len(right)), np.inf)
    for i, a in enumerate(left):
        for j, b in enumerate(right):
            if a.box_px[1] <= b.y_px < a.box_px[1] + a.box_px[3]:
                difference[i, j] = abs(a.area_px - b.area_px) / max(a.area_px, b.area_px)
    found = pairs(NO_LINE, left, right)
    assert found == sorted(found)  # no crossing
    assert len({i for i, _ in found}) == len({j for _, j in found}) == len(found)
    # a billionth a pair lets a pair of no gain be a pair all the same
    assert gain_of(found, difference) == pytest.approx(
        best_gain_by_trying_all(difference), abs=1e-8
    )


def test_without_order_each_fruit_still_has_one_partner() -> None:
    free = AreaInOrder(in_order=False, reference_line=False)
    left = [fruit(100, area_px=300), fruit(200, area_px=305)]
    assert pairs(free, left, [fruit(150, area_px=301)]) == [(0, 0)]
