"""Scores as people read them."""

import pytest
from rich.console import Console

from processor.score import FrameRow, FruitRow, Score, score
from processor.tables import score_table, wide_console


def printed(*, width: int = 120, **groups: Score) -> str:
    console = Console(width=width, no_color=True)
    with console.capture() as capture:
        console.print(score_table(groups))
    return capture.get()


def line(text: str, start: str) -> list[str]:
    (found,) = (row for row in text.splitlines() if start in row)
    return [cell.strip() for cell in found.strip("│").split("│")]


def test_what_nobody_knows_prints_not_scored_and_never_0() -> None:
    text = printed(all=score([FrameRow(None, None, None, {"match": 10**6})], []))
    rows = [r for r in text.splitlines() if "│" in r and "pairs" not in r and "locate" not in r]
    values = [r.strip("│").split("│")[1].strip() for r in rows[1:] if r.strip("│ ")]
    assert set(values) == {"not scored"}
    assert line(text, "locate, median")[1] == "1.0"


def test_rates_print_as_percent_and_errors_as_millimetres() -> None:
    frame = FrameRow((925, 53, 22), (925, 53, 22), (3, 1, 0), {"decode": 5 * 10**6, "match": 10**6})
    text = printed(all=score([frame], [FruitRow(0.8, 1.0, "right", -0.0123)]))
    assert line(text, "pixels hits")[1] == "92.5"
    assert line(text, "fruit found")[1] == "3 / 1 / 0"
    assert line(text, "matches right")[1] == "1 / 0 / 0"
    assert line(text, "bias")[1] == "-12.3"
    assert line(text, "largest")[1] == "+12.3"
    assert line(text, "locate, median")[1] == "1.0"  # without decoding


def test_unknown_false_positives_print_as_a_question() -> None:
    text = printed(all=score([FrameRow(None, None, (3, None, 1), {})], []))
    assert line(text, "fruit found")[1] == "3 / ? / 1"
    assert line(text, "fruit precision")[1] == "not scored"


def test_groups_stand_side_by_side() -> None:
    one, two = (score([FrameRow((n, 0, 10 - n), None, None, {})], []) for n in (4, 9))
    assert line(printed(all=one, front=two), "pixels hits")[1:] == ["40.0", "90.0"]


def test_a_groups_name_is_whole_on_a_narrow_terminal() -> None:
    names = ("all", "lighting=front", "lighting=back", "lighting=cloudy", "lighting=indoor")
    text = printed(width=80, **{name: score([], []) for name in names})
    for word in ("front", "back", "cloudy", "indoor"):
        assert word in text


def test_in_a_pipe_no_row_of_the_table_is_wrapped(capsys: pytest.CaptureFixture[str]) -> None:
    names = ("all", "lighting=front", "lighting=back", "lighting=cloudy", "lighting=indoor")
    wide_console().print(score_table({name: score([], []) for name in names}))
    assert "matches right / wrong / missed" in capsys.readouterr().out
