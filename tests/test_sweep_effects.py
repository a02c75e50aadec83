"""Main effects, the choice on train and its worth on test, on rows whose answer is known."""

from typing import Any

import pytest

from processor.locate import Locator
from processor.measures import MEASURES
from processor.sweep.effects import Found, find
from processor.sweep.settings import parse_vary, settings_of
from processor.sweep.splits import Split, Splits

SETTINGS = settings_of(
    Locator(), parse_vary(["circles.rounds=100,400", "match.in_order=true,false"])
)
PAIRS = 20  # of each split


def row(setting: int, frame: int, tp: int, *, errors_m: tuple[float, ...] = ()) -> dict[str, Any]:
    """Of ten fruit `tp` are found, and nothing else."""
    return {
        "setting": setting, "session": "row", "frame": frame, "locate_ns": 1_000_000 * setting,
        "fruit_tp": tp, "fruit_fp": 0, "fruit_fn": 10 - tp,
        "apples": list(range(len(errors_m))), "errors_m": list(errors_m),
    }  # fmt: skip


def splits() -> Splits:
    of: dict[tuple[str, int], Split] = {
        ("row", i): "train" if i < PAIRS else "test" for i in range(2 * PAIRS)
    }
    return Splits(of, "said")


def found(train: list[int], test: list[int], name: str = "fruit_recall") -> Found:
    """Each setting's hits on every train pair, and on every test pair."""
    rows = [
        row(setting, frame, hits[setting] + (frame % 2))
        for hits, frames in ((train, range(PAIRS)), (test, range(PAIRS, 2 * PAIRS)))
        for frame in frames
        for setting in range(len(SETTINGS))
    ]
    return find(MEASURES[name], SETTINGS, rows, splits())


def test_the_best_is_chosen_on_train_alone() -> None:
    one = found([5, 6, 3, 4], [3, 4, 8, 9])
    assert one.best is not None
    assert one.best.setting.values == {"circles.rounds": "100", "match.in_order": "false"}
    assert [one.best.train, one.best.test] == pytest.approx([0.65, 0.45])
    assert one.ranking == (1, 0, 3, 2)
    assert one.pairs == {"train": PAIRS, "test": PAIRS}


def test_on_test_it_is_held_against_the_method_as_it_was() -> None:
    one = found([5, 6, 3, 4], [3, 6, 4, 5])
    base = next(s for s in SETTINGS if s.is_base)
    assert base.values == {"circles.rounds": "400", "match.in_order": "true"}
    assert one.on_test is not None
    assert one.on_test.verdict == "better"
    assert one.on_test.difference is not None
    assert one.on_test.difference.change == pytest.approx(0.2)


def test_the_method_itself_needs_no_comparison() -> None:
    one = found([1, 2, 9, 4], [1, 2, 9, 4])
    assert one.best is not None
    assert one.best.setting.is_base
    assert one.on_test is None


def test_a_main_effect_is_the_mean_over_all_settings_with_that_value() -> None:
    one = found([5, 7, 1, 3], [5, 7, 1, 3])
    assert list(one.effects) == ["circles.rounds", "match.in_order"]  # the larger effect first
    levels = one.effects["circles.rounds"]
    assert [level.value for level in levels] == ["100", "400"]
    assert [level.train for level in levels] == pytest.approx([0.65, 0.25])
    assert [level.worst for level in levels] == pytest.approx([0.55, 0.15])
    assert [level.best for level in levels] == pytest.approx([0.75, 0.35])
    assert [level.train for level in one.effects["match.in_order"]] == pytest.approx([0.35, 0.55])


def test_of_equal_settings_the_first_is_taken() -> None:
    one = found([5, 5, 5, 5], [5, 5, 5, 5])
    assert one.best is not None
    assert one.best.setting.number == 0


def test_distances_are_compared_on_fruit_that_both_located() -> None:
    errors = {0: (0.01, 0.02), 1: (0.02, 0.03), 2: (0.02, 0.03, 0.5), 3: (0.03, 0.03)}
    rows = [
        row(setting, frame, 5, errors_m=tuple(e + 0.001 * (frame % 3) for e in errors[setting]))
        for frame in range(2 * PAIRS)
        for setting in errors
    ]
    one = find(MEASURES["distance_rmse_mm"], SETTINGS, rows, splits())
    assert one.best is not None
    assert one.best.setting.number == 0
    assert one.on_test is not None
    assert one.on_test.verdict == "better"
    assert one.on_test.difference is not None
    assert one.on_test.difference.change == pytest.approx(-0.01, rel=0.05)  # not by the 0.5 m


def test_without_truth_there_is_nothing_to_choose_by() -> None:
    nothing = {"fruit_tp": None, "fruit_fp": None, "fruit_fn": None}
    rows = [row(s, f, 0) | nothing for f in range(2 * PAIRS) for s in range(len(SETTINGS))]
    one = find(MEASURES["fruit_f1"], SETTINGS, rows, splits())
    assert (one.best, one.ranking, one.on_test) == (None, (), None)
    assert one.base.train is None
