"""What became of each fruit: by the truth where there is one, by each other where there is none."""

from typing import Any

import pytest

from processor.compare.changes import Change, Tally, changes, distance_sums
from processor.compare.pictures import Results

Row = dict[str, Any]


def located(
    x_px: float, *, z_m: float = 0.8, frame: int = 0, truth: int | None = None, right: bool = True
) -> Row:
    """A row of apples.parquet; without `right`, a lone fruit of the left view."""
    matched: Row = {"right_x_px": x_px - 50, "right_y_px": 100.0, "right_radius_px": 20.0,
                    "x_m": 0.0, "y_m": 0.0, "z_m": z_m, "right_truth": truth}  # fmt: skip
    return {
        "frame": frame, "left_truth": truth,
        "left_x_px": x_px, "left_y_px": 100.0, "left_radius_px": 20.0,
        **(matched if right else dict.fromkeys(matched)),
    }  # fmt: skip


def true(
    apple: int, match: str | None = "right", error_m: float | None = 0.0, *, seen: bool = True
) -> Row:
    """A row of truth.parquet."""
    return {"frame": 0, "apple_id": apple, "match": match, "error_m": error_m,
            "found_left": seen, "found_right": seen}  # fmt: skip


def results(apples: list[Row], truth: list[Row] | None = None, frames: int = 1) -> Results:
    rows = [{"frame": i, "fruit_tp": None if truth is None else 1} for i in range(frames)]
    return Results("row", rows, truth or [], apples)


def test_fruit_of_the_truth_are_gained_lost_moved_or_as_they_were() -> None:
    a = results(
        [located(100, truth=1), located(200, truth=2), located(300, z_m=0.8, truth=3)],
        [true(1), true(2), true(3, error_m=-0.001), true(4, "missed", None, seen=False)],
    )
    b = results(
        [located(100, truth=1), located(300, z_m=0.81, truth=3), located(400, truth=4)],
        [true(1), true(2, "wrong", None), true(3, error_m=0.009), true(4)],
    )
    tally, found = changes(a, b)
    assert tally == Tally(both=2, gained=1, lost=1, moved=1, seen_gained=2, seen_lost=0)
    apart = found[1].moved_m
    assert apart == pytest.approx(0.01)
    assert found == [
        Change("row", 0, 2, "lost", 200, 100.0, None, 0.0, None),
        Change("row", 0, 3, "moved", 300, 100.0, apart, -0.001, 0.009),
        Change("row", 0, 4, "gained", 400, 100.0, None, None, 0.0),
    ]


def test_a_move_within_the_tolerance_is_none() -> None:
    a, b = (results([located(100, z_m=z, truth=1)], [true(1)]) for z in (0.8, 0.804))
    assert changes(a, b)[0].moved == 0
    assert changes(a, b, moved_m=0.003)[0].moved == 1


def test_an_apple_located_where_it_need_not_be_counts_too() -> None:
    a = results([], [true(1, None, None)])
    b = results([located(100, truth=1)], [true(1, None, 0.002)])
    assert changes(a, b)[0].gained == 1


def test_without_truth_fruit_are_paired_by_their_circles() -> None:
    a = results([located(100), located(200), located(300)])
    b = results([located(104), located(204, z_m=0.81), located(400)])
    tally, found = changes(a, b)
    assert tally == Tally(both=2, gained=1, lost=1, moved=1)
    assert [(one.what, one.x_px, one.apple) for one in found] == [
        ("moved", 204, None), ("lost", 300, None), ("gained", 400, None),
    ]  # fmt: skip


def test_a_fruit_that_is_matched_with_another_circle_is_another() -> None:
    other = located(100)
    other["right_x_px"] -= 60
    tally, _ = changes(results([located(100)]), results([other]))
    assert (tally.both, tally.gained, tally.lost) == (0, 1, 1)


def test_lone_fruit_have_no_place_to_lose() -> None:
    a, b = results([located(100, right=False)]), results([])
    assert changes(a, b) == (Tally(), [])


def test_distances_without_truth_are_of_fruit_that_both_located() -> None:
    far, further = located(300, z_m=2.9), located(300, z_m=3.1)
    a = results([located(100, z_m=0.8), located(500), far, located(100, frame=1)], frames=2)
    b = results([located(100, z_m=0.9), further, located(100, z_m=1.0, frame=1)], frames=2)
    ours, theirs = distance_sums(a, b)
    assert ours["errors"].tolist() == theirs["errors"].tolist() == [1, 1]
    assert ours["distance_m"].tolist() == [0.8, 0.8]
    assert theirs["distance_m"].tolist() == [0.9, 1.0]
