"""Scores as people read them."""

import pytest
from rich.console import Console

from processor.score import FrameRow, FruitRow, Score, score
from processor.tables import score_table


def printed(*, width: int = 80, **groups: Score) -> str:
    console = Console(width=width, no_color=True)
    with console.capture() as capture:
        console.print(score_table(groups))
    return capture.get()


def cells(text: str, start: str) -> list[list[str]]:
    """The cells of the rows that start so, without the label."""
    rows = (row.strip() for row in text.splitlines())
    return [row.removeprefix(start).split() for row in rows if row.startswith(start)]


def test_what_nobody_knows_prints_not_scored_and_never_0() -> None:
    text = printed(all=score([FrameRow(None, None, None, {"match": 10**6})], []))
    measures = text[: text.index("locate, median")].splitlines()[3:]
    rows = [row for row in measures if row.strip(" ─")]
    assert len(rows) > 20
    assert [row for row in rows if not row.rstrip().endswith("not scored")] == []
    assert cells(text, "locate, median ms a pair") == [["1.0"]]


def test_rates_print_as_percent_and_errors_as_millimetres() -> None:
    frame = FrameRow((925, 53, 22), (895, 67, 38), (3, 1, 0), {"decode": 5 * 10**6, "match": 10**6})
    text = printed(all=score([frame], [FruitRow(0.8, 1.0, "right", -0.0123)]))
    assert cells(text, "hits %") == [["92.5"], ["89.5"]]  # recognised, and cleaned
    assert cells(text, "fruit found") == [["3"]]
    assert cells(text, "false")[-1] == ["1"]
    assert cells(text, "matches right") == [["1"]]
    assert cells(text, "bias mm") == [["-12.3"]]
    assert cells(text, "largest mm") == [["12.3"]]
    assert cells(text, "locate, median ms a pair") == [["1.0"]]  # without decoding


def test_unknown_false_positives_are_not_scored_beside_what_is() -> None:
    text = printed(all=score([FrameRow(None, None, (3, None, 1), {})], []))
    assert cells(text, "fruit found") == [["3"]]
    assert cells(text, "false")[-1] == ["not", "scored"]
    assert cells(text, "missed")[0] == ["1"]


def test_groups_stand_side_by_side() -> None:
    one, two = (score([FrameRow((n, 0, 10 - n), None, None, {})], []) for n in (4, 9))
    assert cells(printed(all=one, front=two), "hits %")[0] == ["40.0", "90.0"]


@pytest.mark.parametrize("width", [80, 200])
def test_five_groups_fit_80_columns_with_their_names_whole(width: int) -> None:
    frame = FrameRow((925, 53, 22), (925, 53, 22), (3, 1, 0), {"match": 10**6})
    scored = score([frame], [FruitRow(0.8, 1.0, "right", -0.0123)])
    names = ("all", "lighting=front", "lighting=back", "lighting=cloudy", "lighting=indoor")
    text = printed(width=width, **dict.fromkeys(names, scored))
    assert text.splitlines()[1].split() == ["all", "front", "back", "cloudy", "indoor"]
    assert "…" not in text
    assert len(cells(text, "its 95 % interval")[0]) == 5


def test_a_row_without_a_single_value_is_left_out_and_its_block_keeps_its_head() -> None:
    frame = FrameRow((925, 53, 22), (925, 53, 22), (3, 1, 0), {})
    found, none = (
        score([frame], [FruitRow(0.8, 1.0, "right", -0.0123)]),
        score([frame], [FruitRow(0.8, 1.0, "missed", None)]),
    )
    assert cells(printed(all=none), "distance errors") == [["-"]]
    assert cells(printed(all=none), "bias mm") == []
    assert cells(printed(all=none, front=found), "bias mm") == [["-", "-12.3"]]


def test_one_pair_is_no_pairs() -> None:
    one, two = (score([FrameRow(None, None, None, {})] * n, []) for n in (1, 2))
    assert printed(one=one, two=two).splitlines()[2].split() == ["1", "pair", "2", "pairs"]
