"""The worst cases of runs: what is one, how bad it is, and in which order they come."""

from pathlib import Path
from typing import Any

import pytest

import processor.worst
from processor.locate import Locator
from processor.replay import Replayed, replay
from processor.results import Rows, write_tables
from processor.worst import WorstCase, worst_cases
from recorder.errors import PomologError
from tests.scenes import apple, stereo_session

Row = dict[str, Any]


def key(frame: int = 0) -> Row:
    return {"session": "row", "frame": frame, "time_ns": frame * 10**9}


def located(
    left: int | None, right: int | None, *, x_m: float = 0.0, z_m: float | None = 0.5, **more: Any
) -> Row:
    """An apple of two circles on the true apples of those ids; None: on no fruit at all."""
    row = key() | {"apple": 0, "x_m": x_m, "y_m": 0.0, "z_m": z_m, "confidence": 0.9}
    for side, apple_id in (("left", left), ("right", right)):
        row |= {f"{side}_{what}_px": 10.0 for what in ("x", "y", "radius")}
        row |= {f"{side}_truth": apple_id, f"{side}_false": apple_id is None}
    return row | more


def alone(apple_id: int | None, confidence: float | None = 0.9) -> Row:
    row = located(apple_id, None, z_m=None, confidence=confidence)
    gone = {name: None for name in row if name.startswith("right_")}
    return row | gone | {"x_m": None, "y_m": None}


def true(
    apple_id: int, match: str | None, *, seen: float | None = 1.0, error_m: float | None = None,
    found: str = "", **more: Any,
) -> Row:  # fmt: skip
    return key() | {
        "apple_id": apple_id, "distance_m": 0.5, "truth_point": "centre", "match": match,
        "left_visible": seen, "right_visible": seen, "error_m": error_m,
        "found_left": "left" in found, "found_right": "right" in found,
        "left_x_px": 50.0, "left_y_px": 60.0, "left_radius_px": 9.0,
    } | more  # fmt: skip


def results(folder: Path, apples: list[Row], truth: list[Row], *, told: bool = True) -> Path:
    folder.mkdir(exist_ok=True)
    frames = [key() | ({"fruit_tp": 0} if told else {})]
    tables: Rows = {"apples": apples, "frames": frames, "truth": truth}
    write_tables(folder, tables)
    return folder


def only(cases: tuple[WorstCase, ...]) -> WorstCase:
    (case,) = cases
    return case


@pytest.mark.parametrize(
    ("found", "why"),
    [
        ("", "found in neither view"),
        ("left", "found in the left view alone"),
        ("left right", "found in both views, and not matched"),
    ],
)
def test_a_missed_apple_is_as_bad_as_much_of_it_is_seen(
    found: str, why: str, tmp_path: Path
) -> None:
    missed = true(7, "missed", seen=0.8, found=found, right_visible=0.6)
    case = only(worst_cases([results(tmp_path, [], [missed])]))
    assert (case.kind, case.apple_id, case.apple) == ("missed", 7, None)
    assert (case.severity, case.how_much, case.why) == (0.6, "60% seen", why)
    assert (case.left_px, case.right_px) == ((50.0, 60.0, 9.0), None)


def test_an_apple_that_one_view_hides_is_missed_where_the_other_does_not_find_it(
    tmp_path: Path,
) -> None:
    row = true(7, None, right_visible=0.2)
    case = only(worst_cases([results(tmp_path, [], [row])]))
    assert (case.kind, case.severity) == ("missed", 0.5)
    assert not worst_cases([results(tmp_path, [], [row | {"found_left": True}])])
    assert not worst_cases([results(tmp_path, [], [row | {"left_visible": 0.4}])])


def test_a_missed_apple_of_which_nobody_said_how_much_is_seen_is_half_as_bad(
    tmp_path: Path,
) -> None:
    case = only(worst_cases([results(tmp_path, [], [true(1, "missed", seen=None)])]))
    assert (case.severity, case.how_much) == (0.5, "nobody said how much is seen")


def test_a_fruit_where_none_is_is_false_and_worse_with_a_place(tmp_path: Path) -> None:
    cases = worst_cases([results(tmp_path, [alone(None), located(None, None)], [])])
    assert [(c.kind, c.severity) for c in cases] == [("false", 0.9), ("false", 0.45)]
    assert "0.500 m" in cases[0].why


def test_where_nobody_can_know_nothing_is_false(tmp_path: Path) -> None:
    partial = located(None, None, left_false=None, right_false=None)
    uncounted = located(None, None, left_false=False)
    assert not worst_cases([results(tmp_path, [partial, uncounted], [])])


def test_a_wrong_match_is_as_bad_as_its_place_is_off(tmp_path: Path) -> None:
    rows = [true(1, "wrong"), true(2, "wrong")]
    case = only(worst_cases([results(tmp_path, [located(1, 2, z_m=0.55)], rows)]))
    assert (case.kind, case.apple, case.apple_id) == ("wrong match", 0, 1)
    assert case.error_m == pytest.approx(0.05)
    assert case.severity == pytest.approx(0.5)
    assert (case.how_much, case.why) == ("50 mm too far", "left is apple 1, right is apple 2")


def test_a_wrong_match_is_held_against_what_the_truth_measured(tmp_path: Path) -> None:
    row = located(1, None, z_m=0.5, surface_range_m=0.46, right_false=False)
    surface = true(1, "wrong", truth_point="surface", distance_m=0.45)
    assert only(worst_cases([results(tmp_path, [row], [surface])])).how_much == "10 mm too far"


def test_an_impossible_match_is_wholly_wrong(tmp_path: Path) -> None:
    row = located(1, None, z_m=None, x_m=0.0)
    case = only(worst_cases([results(tmp_path, [row], [true(1, "wrong")])]))
    assert (case.severity, case.how_much) == (1.0, "no place in space")


def test_a_distance_error_says_whether_its_interval_holds_it(tmp_path: Path) -> None:
    row = true(1, "right", error_m=-0.03, std_m=0.01, found="left right")
    case = only(worst_cases([results(tmp_path, [located(1, 1)], [row])]))
    assert (case.kind, case.how_much, case.error_m) == ("range", "30 mm too near", -0.03)
    assert case.why == "at 0.500 m, outside its 95 % interval of ±20 mm"
    assert case.severity == pytest.approx(0.3)


def test_kinds_take_turns_and_mild_cases_come_last(tmp_path: Path) -> None:
    rows = [true(i, "missed", seen=0.9) for i in range(3)]
    rows += [true(8, "right", error_m=0.05), true(9, "right", error_m=0.001)]
    own = [located(8, 8), located(9, 9)]
    cases = worst_cases([results(tmp_path, own, rows)])
    assert [c.kind for c in cases] == ["missed", "range", "missed", "missed", "range"]
    assert [c.kind for c in worst_cases([tmp_path], 2)] == ["missed", "range"]
    assert {c.kind for c in worst_cases([tmp_path], kinds=["missed"])} == {"missed"}


def test_few_of_very_many_are_the_first_of_all_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = [0.001 * (i * 37 % 101) for i in range(101)]
    rows = [true(i, "right", error_m=error) for i, error in enumerate(errors)]
    rows += [true(200 + i, "missed", seen=0.5 + i / 100) for i in range(40)]
    folder = results(tmp_path, [located(i, i) for i in range(101)], rows)
    everything = worst_cases([folder])
    monkeypatch.setattr(processor.worst, "_SPARE", 3)
    for count in (1, 7, 60):
        assert worst_cases([folder], count) == everything[:count]


def test_without_truth_there_is_no_worst(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match=r"no truth .* pomolog label"):
        worst_cases([results(tmp_path, [alone(None, None) | {"left_false": None}], [], told=False)])
    assert worst_cases([results(tmp_path, [], [])]) == ()  # held against truth, and nothing wrong


def test_a_replayed_session_has_its_missed_apple_where_it_is(tmp_path: Path) -> None:
    far = apple(2, 0.02, z_m=1.0, seen=1.0)  # of 16 px, which the paper's window leaves out
    session = stereo_session(tmp_path / "row.mcap", [[apple(1, seen=1.0)], [far]])
    (done,) = replay([session], tmp_path, Locator(), rrd="none")
    assert isinstance(done, Replayed)
    case = only(worst_cases([done.out], kinds=["missed"]))
    assert (case.session, case.frame, case.apple_id) == ("row", 1, 2)
    assert case.left_px == pytest.approx((159.5 + 400 * 0.02, 119.5, 16.0))
    assert case.folder == done.out
