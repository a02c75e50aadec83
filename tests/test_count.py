"""The counting rules, each on the smallest frame that shows it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from processor.count import Counts, FrameCounts, count_frame, count_pixels
from processor.discs import disc_iou
from processor.trace import Apple, Fruit, Mask, Trace
from processor.verdicts import AppleVerdict
from recorder.records import UNCOUNTED, AppleTruth, FrameTruth, Labels, Outline, TruthPoint
from recorder.rectify import rectify
from tests.scenes import apple, disc_mask, draw, fruit, matching, small_rig, view

RIG = small_rig()
PARALLEL = rectify(RIG)
SIZE = RIG.left.size_px
NOTHING = np.zeros((SIZE[1], SIZE[0]), np.uint8)


def labels_of(*discs: tuple[int, float, float, float]) -> Labels:
    """Labels of discs (id, x, y, radius); the later hide the earlier."""
    labels = np.zeros((SIZE[1], SIZE[0]), np.uint16)
    for number, x, y, radius in discs:
        labels[disc_mask((x, y, radius), size_px=SIZE) > 0] = number
    return labels


def circle_on(true: AppleTruth, side: str, dx_px: float = 0.0) -> Fruit:
    """The circle that finds an apple, moved sideways."""
    where = PARALLEL.project("left" if side == "left" else "right", np.array([true.centre_m]))
    radius_px = PARALLEL.focal_px * true.radius_m / true.centre_m[2]
    return fruit(float(where[0, 0]) + dx_px, float(where[0, 1]), radius_px=radius_px)


def place_of(true: AppleTruth, left: int, right: int, *, too_far_m: float = 0.0) -> Apple:
    """A located apple on the line of sight of a true one."""
    x, y, z = true.centre_m
    range_m = math.hypot(x, y, z)
    by = 1 + too_far_m / range_m
    centre = (x * by, y * by, z * by)
    return Apple(left, right, 60.0, centre, true.radius_m, math.hypot(*centre) - true.radius_m)


def trace_of(
    left: list[Fruit],
    right: list[Fruit],
    apples: list[Apple] | None = None,
    *,
    mask: Mask = NOTHING,
) -> Trace:
    return Trace(
        view(*left, mask=mask), view(*right, mask=mask), matching(), tuple(apples or ()), {}
    )


def counted(trace: Trace, truth: FrameTruth | None) -> FrameCounts:
    return count_frame(trace, truth, PARALLEL)


def matched(
    true: AppleTruth, *, dx_px: float = 0.0, too_far_m: float = 0.0
) -> tuple[FrameCounts, AppleVerdict]:
    """One apple whose two circles were matched."""
    trace = trace_of(
        [circle_on(true, "left", dx_px)],
        [circle_on(true, "right", dx_px)],
        [place_of(true, 0, 0, too_far_m=too_far_m)],
    )
    counts = counted(trace, FrameTruth(apples=(true,)))
    return counts, counts.apples[0]


# pixels: Table 1


def test_pixels_are_hits_false_positives_and_false_negatives() -> None:
    mask = np.array([[255, 255, 0, 0]], np.uint8)
    labels = np.array([[7, 0, 7, 0]], np.uint16)
    assert count_pixels(mask, labels) == Counts(1, 1, 1)


def test_pixels_of_uncounted_fruit_count_neither_way() -> None:
    mask = np.array([[255, 0, 255]], np.uint8)
    labels = np.array([[UNCOUNTED, UNCOUNTED, 1]], np.uint16)
    assert count_pixels(mask, labels) == Counts(1, 0, 0)


def test_of_partial_labels_nobody_knows_the_false_positives() -> None:
    mask = np.array([[255, 255, 0]], np.uint8)
    labels = np.array([[1, 0, 1]], np.uint16)
    assert count_pixels(mask, labels, partial=True) == Counts(1, None, 1)


def test_both_views_pixels_are_summed_recognised_and_cleaned_apart() -> None:
    labels = labels_of((1, 100, 100, 10))
    area = int((labels > 0).sum())
    whole = view(mask=(labels > 0).astype(np.uint8) * np.uint8(255))
    cleaned_away = replace(whole, cleaning=view().cleaning)
    found = counted(Trace(whole, cleaned_away, matching(), (), {}), FrameTruth(labels, labels))
    assert found.pixels == Counts(2 * area, 0, 0)
    assert found.pixels_cleaned == Counts(area, 0, area)


def test_one_labelled_view_is_counted_alone_and_judges_no_matches() -> None:
    labels = labels_of((1, 100, 100, 10))
    found = counted(trace_of([fruit(100, 100)], []), FrameTruth(left=labels))
    assert found.pixels == Counts(0, 0, int((labels > 0).sum()))
    assert found.fruit == Counts(1, 0, 0)
    assert found.apples == ()
    assert found.apples == ()


def test_plain_masks_score_pixels_only() -> None:
    labels = labels_of((1, 100, 100, 10))
    truth = FrameTruth(labels, labels, identified=False)
    found = counted(trace_of([fruit(100, 100)], []), truth)
    assert found.pixels is not None
    assert found.fruit is None


def test_without_truth_nothing_is_counted() -> None:
    assert counted(trace_of([fruit(100)], [fruit(40)]), None) == FrameCounts()


# discs


@pytest.mark.parametrize(
    ("disc", "other"),
    [
        ((100, 100, 40), (100, 100, 40)),
        ((100, 100, 40), (120, 110, 40)),
        ((100, 100, 40), (110, 100, 20)),  # one in the other
        ((100, 100, 40), (125, 100, 20)),
        ((100, 100, 30), (170, 100, 40)),  # touching
        ((100, 100, 30), (220, 100, 40)),  # apart
    ],
)
def test_the_iou_of_discs_is_that_of_their_pixels(
    disc: tuple[float, float, float], other: tuple[float, float, float]
) -> None:
    iou = disc_iou(np.array([disc], float), np.array([other], float))[0, 0]
    a, b = (disc_mask(d, size_px=SIZE) > 0 for d in (disc, other))
    # discs of thousands of pixels: counting whole ones is right to about the rim's share
    assert iou == pytest.approx((a & b).sum() / (a | b).sum(), abs=0.01)


def test_discs_without_size_overlap_nothing() -> None:
    none = np.array([[5.0, 5.0, 0.0]])
    assert disc_iou(none, none)[0, 0] == 0.0
    assert disc_iou(none, np.array([[5.0, 5.0, 10.0]]))[0, 0] == 0.0
    assert disc_iou(np.empty((0, 3)), none).shape == (0, 1)


# equal discs a distance d apart have an IoU of 1/2 at d = 0.5298... r
HALF = 0.5298


@pytest.mark.parametrize(("share", "found"), [(HALF - 0.01, True), (HALF + 0.01, False)])
def test_a_circle_finds_an_apple_from_an_iou_of_a_half(share: float, found: bool) -> None:
    true = apple(1, seen=1.0)
    counts, verdict = matched(true, dx_px=share * 40)
    assert (verdict.found_left, verdict.found_right) == (found, found)
    assert counts.fruit == (Counts(2, 0, 0) if found else Counts(0, 2, 2))


def test_two_circles_on_one_apple_are_a_find_and_a_mistake() -> None:
    true = apple(1, seen=1.0)
    near, far = circle_on(true, "left", 2), circle_on(true, "left", 6)
    counts = counted(trace_of([far, near], []), FrameTruth(apples=(true,)))
    assert counts.fruit == Counts(1, 1, 1)  # the other view misses it
    assert counts.found_left == (None, 1)  # the nearer one


def test_an_apple_less_than_a_tenth_visible_counts_neither_way() -> None:
    hidden = apple(1, seen=0.09)
    found, missed = (
        counted(trace_of(circles, []), FrameTruth(apples=(hidden,)))
        for circles in ([circle_on(hidden, "left")], [])
    )
    assert found.fruit == missed.fruit == Counts(0, 0, 0)
    assert found.apples == missed.apples == ()
    assert matched(apple(1, seen=0.1))[0].fruit == Counts(2, 0, 0)


def test_a_circle_that_fits_two_apples_finds_the_visible_one() -> None:
    behind, before = apple(1, 0.0, 0.0, 0.44, radius_m=0.044, seen=0.0), apple(2, 0.004, seen=1.0)
    on_the_hidden = circle_on(behind, "left")
    counts = counted(trace_of([on_the_hidden], []), FrameTruth(apples=(behind, before)))
    assert counts.found_left == (2,)


@pytest.mark.parametrize(("dx_px", "found"), [(7.0, 2), (1.0, 1)])
def test_of_two_apples_in_line_a_circle_finds_the_one_that_is_seen_unless_it_fits_the_other(
    dx_px: float, found: int
) -> None:
    hidden = replace(apple(1, 0.0, 0.0, 0.6), left_visible=0.15)
    before = replace(apple(2, 16.0 * 0.6 / PARALLEL.focal_px, 0.0, 0.6), left_visible=1.0)
    truth = FrameTruth(apples=(hidden, before))
    counts = counted(trace_of([circle_on(hidden, "left", dx_px)], []), truth)
    assert counts.found_left == (found,)


def test_a_circle_on_uncounted_fruit_is_no_mistake() -> None:
    true = apple(1, -0.08, seen=1.0)
    labels = labels_of((UNCOUNTED, 250, 120, 30))
    truth = FrameTruth(labels, labels, (true,))
    here = [circle_on(true, "left"), fruit(250, 120, radius_px=30)]
    assert counted(trace_of(here, []), truth).fruit == Counts(1, 0, 1)
    elsewhere = [circle_on(true, "left"), fruit(250, 30, radius_px=30)]
    assert counted(trace_of(elsewhere, []), truth).fruit == Counts(1, 1, 1)


def test_a_circle_out_of_the_picture_is_on_no_uncounted_fruit() -> None:
    labels = np.full((SIZE[1], SIZE[0]), UNCOUNTED, np.uint16)
    truth = FrameTruth(labels, labels, ())
    outside = [fruit(-80, 100, radius_px=30), fruit(100, -80, radius_px=30)]
    assert counted(trace_of(outside, []), truth).fruit == Counts(0, 2, 0)


def test_with_partial_truth_false_fruit_are_unknown() -> None:
    true = apple(1, seen=1.0)
    truth = FrameTruth(apples=(true,), partial=True)
    counts = counted(trace_of([circle_on(true, "left"), fruit(20, 20)], []), truth)
    assert counts.fruit == Counts(1, None, 1)


def test_no_apples_at_all_is_truth_too() -> None:
    counts = counted(trace_of([fruit(100)], []), FrameTruth(apples=()))
    assert counts.fruit == Counts(0, 1, 0)


def test_labels_alone_give_the_discs_that_enclose_them() -> None:
    left, right = labels_of((5, 200, 100, 30)), labels_of((5, 140, 100, 30))
    trace = trace_of(
        [fruit(200, 100, radius_px=30)],
        [fruit(140, 100, radius_px=30)],
        [Apple(0, 0, 60.0, (0.0, 0.0, 0.4), 0.04, 0.36)],
    )
    counts = counted(trace, FrameTruth(left, right))
    assert counts.fruit == Counts(2, 0, 0)
    (verdict,) = counts.apples
    assert (verdict.apple_id, verdict.match) == (5, "right")
    assert verdict.distance_m is None
    assert verdict.error_m is None


def test_visibility_that_nobody_said_is_read_from_the_labels() -> None:
    true = AppleTruth(1, (0.0, 0.0, 0.4), 0.04)
    picture = draw(RIG, "left", [true])[1]
    half = picture.copy()
    half[:, SIZE[0] // 2 :] = 0
    counts = counted(trace_of([], []), FrameTruth(half, picture, (true,)))
    # a sphere's outline is a little larger than its centre's disc: half of it counts 1 % more
    assert counts.apples[0].left_visible == pytest.approx(0.5, abs=0.02)
    assert counts.apples[0].right_visible == pytest.approx(1.0, abs=0.02)


def test_an_apple_whose_label_no_picture_can_have_is_not_seen() -> None:
    true = AppleTruth(70_000, (0.0, 0.0, 0.4), 0.04)
    labels = labels_of()
    assert counted(trace_of([], []), FrameTruth(labels, labels, (true,))).apples == ()


@pytest.mark.parametrize("z_m", [0.0, -0.4])
def test_an_apple_at_or_behind_the_camera_is_not_asked_for(z_m: float) -> None:
    true = AppleTruth(1, (0.0, 0.0, z_m), 0.04)
    assert counted(trace_of([], []), FrameTruth(apples=(true,))).fruit == Counts(0, 0, 0)


def test_an_apple_beside_the_picture_is_not_asked_for() -> None:
    true = AppleTruth(1, (5.0, 0.0, 0.4), 0.04)  # nobody said how visible, and no labels say it
    counts = counted(trace_of([], []), FrameTruth(apples=(true,)))
    assert counts.fruit == Counts(0, 0, 0)
    assert counts.apples == ()


# matches


def test_two_circles_of_one_apple_matched_are_right() -> None:
    assert matched(apple(1, seen=1.0))[1].match == "right"


def test_found_in_both_views_but_not_matched_is_missed() -> None:
    true = apple(1, seen=1.0)
    trace = trace_of(
        [circle_on(true, "left")], [circle_on(true, "right")], [Apple(0, None), Apple(None, 0)]
    )
    (verdict,) = counted(trace, FrameTruth(apples=(true,))).apples
    assert verdict.match == "missed"
    assert verdict.error_m is None


def test_not_found_is_missed() -> None:
    (verdict,) = counted(trace_of([], []), FrameTruth(apples=(apple(1, seen=1.0),))).apples
    assert verdict.match == "missed"


def test_circles_of_two_apples_matched_are_wrong_for_both() -> None:
    one, other = apple(1, -0.06, seen=1.0), apple(2, 0.06, seen=1.0)
    trace = trace_of([circle_on(one, "left")], [circle_on(other, "right")], [place_of(one, 0, 0)])
    verdicts = counted(trace, FrameTruth(apples=(one, other))).apples
    assert [v.match for v in verdicts] == ["wrong", "wrong"]
    assert [v.error_m for v in verdicts] == [None, None]


def test_an_apple_matched_with_a_false_circle_is_wrong() -> None:
    true = apple(1, seen=1.0)
    trace = trace_of([circle_on(true, "left")], [fruit(20, 20)], [place_of(true, 0, 0)])
    (verdict,) = counted(trace, FrameTruth(apples=(true,))).apples
    assert verdict.match == "wrong"


@pytest.mark.parametrize(("seen", "match"), [(0.49, None), (0.5, "right")])
def test_an_apple_less_than_half_visible_need_not_be_matched(
    seen: float, match: str | None
) -> None:
    verdict = matched(apple(1, seen=seen), too_far_m=0.01)[1]
    assert verdict.match == match
    assert verdict.error_m == pytest.approx(0.01)  # where it was, its distance counts


def test_an_apple_that_only_one_view_shows_has_its_verdict() -> None:
    lone = replace(apple(1, seen=0.9), right_visible=0.05)
    (verdict,) = counted(trace_of([circle_on(lone, "left")], []), FrameTruth(apples=(lone,))).apples
    assert (verdict.found_left, verdict.found_right, verdict.match) == (True, False, None)
    unseen = replace(lone, left_visible=0.05)
    assert counted(trace_of([], []), FrameTruth(apples=(unseen,))).apples == ()


def test_an_apple_half_visible_in_one_view_only_need_not_be_matched() -> None:
    true = AppleTruth(1, (0.0, 0.0, 0.4), 0.04, left_visible=1.0, right_visible=0.3)
    assert matched(true)[1].match is None


# distances


@pytest.mark.parametrize("truth_point", ["centre", "surface"])
@pytest.mark.parametrize("too_far_m", [0.0, 0.013, -0.007])
def test_the_error_is_to_the_declared_truth_point(
    truth_point: TruthPoint, too_far_m: float
) -> None:
    true = apple(1, 0.03, 0.02, 0.4, seen=1.0, truth_point=truth_point)
    verdict = matched(true, too_far_m=too_far_m)[1]
    range_m = math.hypot(0.03, 0.02, 0.4)
    assert verdict.distance_m == pytest.approx(
        range_m - (0.04 if truth_point == "surface" else 0.0)
    )
    assert verdict.error_m == pytest.approx(too_far_m, abs=1e-12)


@pytest.mark.parametrize(("truth_point", "error_m"), [("centre", 0.0), ("surface", -0.005)])
def test_an_estimated_radius_that_is_wrong_shows_at_the_surface_only(
    truth_point: TruthPoint, error_m: float
) -> None:
    true = apple(1, seen=1.0, truth_point=truth_point)
    big = Apple(0, 0, 60.0, true.centre_m, 0.045, 0.4 - 0.045)
    trace = trace_of([circle_on(true, "left")], [circle_on(true, "right")], [big])
    (verdict,) = counted(trace, FrameTruth(apples=(true,))).apples
    assert verdict.error_m == pytest.approx(error_m, abs=1e-12)


@pytest.mark.parametrize(("truth_point", "std_m"), [("centre", 0.003), ("surface", 0.004)])
def test_what_is_said_of_an_error_is_of_the_declared_truth_point(
    truth_point: TruthPoint, std_m: float
) -> None:
    true = apple(1, seen=1.0, truth_point=truth_point)
    said = replace(place_of(true, 0, 0), range_std_m=0.003, surface_std_m=0.004)
    trace = trace_of([circle_on(true, "left")], [circle_on(true, "right")], [said])
    assert counted(trace, FrameTruth(apples=(true,))).apples[0].std_m == std_m


def test_boxes_and_circles_count_fruit_but_no_pixels() -> None:
    outlines = (
        Outline("left", 1, "box", 90, 92, 20, 16),  # an apple half behind a leaf
        Outline("left", 2, "circle", 150, 90, 20, 20),
        Outline("left", UNCOUNTED, "box", 20, 20, 20, 20),
    )
    truth = FrameTruth(left_outlines=outlines, right_outlines=(), shared=False)
    circles = [fruit(100, 100), fruit(30, 30), fruit(60, 200)]
    found = counted(trace_of(circles, []), truth)
    assert found.pixels is None
    assert found.fruit == Counts(tp=1, fp=1, fn=1)
    assert found.apples == ()
    partial = counted(trace_of(circles, []), replace(truth, partial=True))
    assert partial.fruit == Counts(tp=1, fp=None, fn=1)


def test_numbers_of_one_view_only_judge_no_matches() -> None:
    labels = labels_of((1, 100, 100, 10))
    trace = trace_of([fruit(100, 100)], [fruit(100, 100)])
    shared = counted(trace, FrameTruth(labels, labels))
    alone = counted(trace, FrameTruth(labels, labels, shared=False))
    assert len(shared.apples) == 1
    assert alone.apples == ()
    assert alone.fruit == shared.fruit == Counts(2, 0, 0)
