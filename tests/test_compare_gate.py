"""Gates: what a file may say, what passes, and what the data cannot decide."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from processor.compare.comparison import Comparison
from processor.compare.gate import Checked, Gate, Rule, check, load_gate
from processor.compare.judge import Judged
from processor.compare.sides import Repeat, Side, Sides
from processor.measures import MEASURES
from processor.paired import Difference
from processor.runs import Run
from recorder.errors import PomologError


def side(name: str, seed: int) -> Side:
    about = {"method": "paper", "seed": seed, "locator": {}, "versions": {"source": "x"},
             "session": {"fingerprint": "f"}}  # fmt: skip
    return Side(name, (Repeat(Path(name), {"row": Run(Path(name), about)}),))


def comparison(
    name: str, worsening: float, half: float, *, b: float = 0.9, better: float = -1.0
) -> Comparison:
    """One measure, its worsening known to plus or minus `half` at 90 %."""
    change = better * worsening
    ends = (worsening - half, worsening + half)
    found = Difference(
        a=b - change, b=b, units=50, change=change, interval95=ends, interval90=ends,
        worsening=worsening, worsening95=ends, worsening90=ends, std=4 * half, p=0.5,
    )  # fmt: skip
    measure = MEASURES[name]
    one = Judged(measure, measure.matters, found, 0.5, "too little data")
    sides = Sides(side("A", 0), side("B", 1), ("row",), ())
    from processor.compare.changes import Tally

    return Comparison(sides, "pair", 50, (one,), Tally(), (), None, None, (40.0, 60.0), ())


def checked(rule: Rule, found: Comparison, *, unsure: bool = False) -> Checked:
    (one,) = check(Gate((rule,), unsure), found)
    return one


def test_a_file_says_limits_and_what_becomes_of_doubt(tmp_path: Path) -> None:
    path = tmp_path / "gate.toml"
    path.write_text(
        'when_unsure = "pass"\n[fruit_recall]\nmin = 0.85\nnot_worse_by = 0.01\n[time_ms]\nmax = 90'
    )
    rules = (Rule("fruit_recall", "min", 0.85), Rule("fruit_recall", "not_worse_by", 0.01),
             Rule("time_ms", "max", 90.0))  # fmt: skip
    assert load_gate(path) == Gate(rules, pass_when_unsure=True)


def test_a_file_may_say_what_matters(tmp_path: Path) -> None:
    path = tmp_path / "gate.toml"
    path.write_text("[distance_rmse_mm]\nmatters = 2\nmax = 15\n[fruit_recall]\nmatters = 0.02")
    found = load_gate(path)
    assert found.rules == (Rule("distance_rmse_mm", "max", 15),)
    assert found.matters == pytest.approx({"distance_rmse_mm": 0.002, "fruit_recall": 0.02})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[fruit_recal]\nmin = 0.8", ["fruit_recal", "fruit_recall", "distance_rmse_mm"]),
        ("[fruit_recall]\nleast = 0.8", ["'least'", "min, max, not_worse_by, matters"]),
        ("[fruit_recall]\nmin = 85", ["85 % is written 0.85"]),
        ("[fruit_recall]\nmin = 'high'", ["'high'", "no number"]),
        ("[fruit_recall]\nmin = true", ["True", "no number"]),
        ("[fruit_recall]\nmin = nan", ["nan", "no number"]),
        (f"[distance_rmse_mm]\nmin = 1{'0' * 400}", ["no number"]),
        ("[fruit_recall]\nmatters = 0", ["more than 0"]),
        ("[distance_rmse_mm]\nnot_worse_by = -1", ["negative"]),
        ("[time_ms]\nnot_worse_by = 1", ["min, max"]),
        ("fruit_recall = 0.8", ["[fruit_recall]"]),
        ("when_unsure = 'ask'\n[fruit_recall]\nmin = 0.8", ["'ask'", "fail or pass"]),
        ("", ["no limit"]),
        ("[", ["not TOML"]),
    ],
)
def test_what_no_gate_has_is_one_line(text: str, words: list[str], tmp_path: Path) -> None:
    path = tmp_path / "gate.toml"
    path.write_text(text)
    with pytest.raises(PomologError) as error:
        load_gate(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)
    for word in words:
        assert word in str(error.value)


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match=r"no\.toml"):
        load_gate(tmp_path / "no.toml")


@pytest.mark.parametrize(
    ("kind", "limit", "passed"),
    [("min", 0.85, True), ("min", 0.95, False), ("max", 0.95, True), ("max", 0.85, False)],
)
def test_limits_are_held_against_b(kind: str, limit: float, passed: bool) -> None:
    one = checked(Rule("fruit_recall", kind, limit), comparison("fruit_recall", 0.0, 0.001, b=0.9))
    assert one.passed is passed
    assert "0.9000" in one.line


def test_lengths_are_in_the_unit_of_their_name() -> None:
    found = comparison("distance_rmse_mm", 0.0, 0.001, b=0.012, better=1.0)
    assert checked(Rule("distance_rmse_mm", "max", 15), found).passed
    assert not checked(Rule("distance_rmse_mm", "max", 11), found).passed


def test_a_bias_is_limited_on_both_sides_of_zero() -> None:
    found = comparison("distance_bias_mm", 0.0, 0.001, b=-0.004)
    assert not checked(Rule("distance_bias_mm", "max", 3), found).passed
    assert checked(Rule("distance_bias_mm", "max", 5), found).passed


@pytest.mark.parametrize(
    ("worsening", "half", "passed", "unsure"),
    [
        (-0.02, 0.01, True, False),  # better
        (0.002, 0.002, True, False),  # worse, but never by more than is allowed
        (0.03, 0.01, False, False),  # worse by more
        (0.004, 0.003, False, True),  # perhaps
        (-0.001, 0.02, False, True),
    ],
)
def test_not_worse_by_wants_proof(
    worsening: float, half: float, passed: bool, unsure: bool
) -> None:
    rule = Rule("fruit_recall", "not_worse_by", 0.005)
    one = checked(rule, comparison("fruit_recall", worsening, half))
    assert (one.passed, one.unsure) == (passed, unsure)
    assert ("too little data" in one.line) is unsure
    assert checked(rule, comparison("fruit_recall", worsening, half), unsure=True).passed is (
        passed or unsure
    )


def test_what_is_the_same_in_every_picture_is_not_worse() -> None:
    found = comparison("fruit_recall", 0.0, 0.1)
    (one,) = found.judged
    assert one.difference is not None
    same = replace(one, difference=replace(one.difference, identical=True))
    rule = Rule("fruit_recall", "not_worse_by", 0.005)
    assert not checked(rule, found).passed
    assert checked(rule, replace(found, judged=(same,))).passed


def test_a_measure_without_truth_fails_and_says_so() -> None:
    one = checked(Rule("fruit_recall", "min", 0.5), comparison("located_per_pair", 0.0, 0.1))
    assert (one.passed, one.unsure) == (False, True)
    assert "no truth" in one.line


def test_time_is_limited_in_milliseconds() -> None:
    found: Any = comparison("fruit_recall", 0.0, 0.001)
    assert checked(Rule("time_ms", "max", 61), found).passed
    assert not checked(Rule("time_ms", "max", 59), found).passed
