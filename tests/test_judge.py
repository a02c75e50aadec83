"""Which finds count for confidence, and which of them are right."""

from typing import Any

from processor.judge import judge
from processor.sureness import Judged


def apple(**given: Any) -> dict[str, Any]:
    row = {"frame": 0, "confidence": 0.8, "z_m": 1.0}
    for side in ("left", "right"):
        row |= {f"{side}_x_px": 5.0, f"{side}_confidence": 0.6, f"{side}_truth": 7}
        row[f"{side}_false"] = False
    return row | given


def true(**given: Any) -> dict[str, Any]:
    row = {"frame": 0, "apple_id": 7, "left_visible": 0.9, "right_visible": 0.9, "match": "right"}
    return row | given


def judged(found: dict[str, Any], *truth: dict[str, Any]) -> list[tuple[str, Judged | None]]:
    return [(what, one) for _, what, one in judge([found], truth)]


def test_a_right_match_is_two_right_circles_and_a_right_match() -> None:
    circle = ("fruit", Judged(0.6, True))
    assert judged(apple(), true()) == [circle, circle, ("matches", Judged(0.8, True))]


def test_a_hardly_visible_apple_counts_neither_way() -> None:
    assert judged(apple(), true(left_visible=0.05, match=None)) == [("fruit", Judged(0.6, True))]
    assert judged(apple()) == []  # in neither view is a tenth of it visible


def test_a_lone_circle_where_nothing_is_is_wrong() -> None:
    alone = apple(right_x_px=None, z_m=None, left_truth=None, left_false=True)
    assert judged(alone) == [("fruit", Judged(0.6, False))]


def test_a_circle_on_fruit_of_the_next_row_is_passed_over() -> None:
    assert judged(apple(right_x_px=None, z_m=None, left_truth=None)) == []


def test_two_apples_matched_with_each_other_are_wrong() -> None:
    mixed = apple(right_truth=8)
    assert judged(mixed, true(match="wrong"), true(apple_id=8, match="wrong"))[-1] == (
        "matches", Judged(0.8, False),
    )  # fmt: skip


def test_a_match_of_two_circles_on_no_fruit_is_wrong_unless_one_counts_neither_way() -> None:
    nowhere = apple(left_truth=None, right_truth=None, left_false=True, right_false=True)
    assert judged(nowhere)[-1] == ("matches", Judged(0.8, False))
    assert judged(nowhere | {"right_false": False}) == [("fruit", Judged(0.6, False))]


def test_what_nobody_can_know_is_none() -> None:
    unlabelled = apple(left_truth=None, right_truth=None, left_false=None, right_false=None)
    assert judged(unlabelled) == [("fruit", None), ("fruit", None), ("matches", None)]
    assert judged(apple(left_confidence=None), true())[0] == ("fruit", None)
