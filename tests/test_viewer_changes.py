"""What one method locates otherwise than another: gained, lost and moved."""

from pathlib import Path
from typing import Any

import pytest

from processor.results import write_tables
from viewer.changes import Change, changes

Row = dict[str, Any]


def located(apple: int, x_px: float, *, z_m: float = 0.5, true: int | None = None) -> Row:
    row: Row = {"session": "row", "frame": 0, "time_ns": 0, "apple": apple}
    row |= {"x_m": 0.0, "y_m": 0.0, "z_m": z_m}
    for side in ("left", "right"):
        row |= {f"{side}_x_px": x_px, f"{side}_y_px": 50.0, f"{side}_radius_px": 10.0}
        row |= {f"{side}_truth": true, f"{side}_false": true is None}
    return row


def run(folder: Path, *apples: Row, errors: dict[int, float] | None = None) -> Path:
    folder.mkdir()
    key = {"session": "row", "frame": 0, "time_ns": 0}
    truth = [key | {"apple_id": i, "error_m": e} for i, e in (errors or {}).items()]
    write_tables(folder, {"apples": list(apples), "frames": [key], "truth": truth})
    return folder


def between(tmp_path: Path, old: list[Row], new: list[Row], **errors: Any) -> tuple[Change, ...]:
    before = run(tmp_path / "old", *old, errors=errors.get("was"))
    return changes(before, run(tmp_path / "new", *new, errors=errors.get("now")))


def test_what_both_locate_alike_is_no_change(tmp_path: Path) -> None:
    one = located(0, 100.0, true=4)
    assert between(tmp_path, [one], [one | {"apple": 7, "z_m": 0.5005}]) == ()


def test_what_the_second_alone_locates_is_gained_and_the_first_alone_lost(tmp_path: Path) -> None:
    lost, gained = between(tmp_path, [located(2, 30.0)], [located(5, 200.0, true=4)])
    assert (lost.kind, lost.before, lost.after, lost.what) == (
        "lost", 2, None, "where no apple is",
    )  # fmt: skip
    assert (gained.kind, gained.before, gained.after) == ("gained", None, 5)
    assert (gained.apple_id, gained.what) == (4, "true apple 4")
    assert (lost.mistake, gained.mistake) == (True, False)


def test_an_apple_placed_elsewhere_has_moved_and_says_both_errors(tmp_path: Path) -> None:
    old, new = located(0, 100.0, true=4), located(1, 101.0, z_m=0.53, true=4)
    (moved,) = between(tmp_path, [old], [new], was={4: -0.035}, now={4: -0.005})
    assert (moved.kind, moved.before, moved.after) == ("moved", 0, 1)
    assert moved.moved_m == pytest.approx(0.03)
    assert moved.what == "true apple 4: 30 mm away, error -35 -> -5 mm"


def test_a_fruit_without_a_place_is_no_located_apple(tmp_path: Path) -> None:
    assert between(tmp_path, [], [located(0, 100.0) | {"z_m": None}]) == ()
