"""Train and test: as sessions say, as the user says, or by the stated rule."""

from pathlib import Path

import pytest

from processor.experiments.material import Source
from processor.sweep.splits import split_up
from recorder.errors import PomologError


def source(name: str, pairs: int, split: str = "") -> Source:
    return Source(Path(f"{name}.mcap"), name, tuple(range(pairs)), pairs, "f", split,
                  tuple({} for _ in range(pairs)))  # fmt: skip


def test_sessions_say_their_split() -> None:
    splits = split_up([source("a", 2, "train"), source("b", 2, "test")], (), ())
    assert splits.of == {("a", 0): "train", ("a", 1): "train", ("b", 0): "test", ("b", 1): "test"}
    assert "2 sessions say their split" in splits.said


def test_the_user_says_it_better() -> None:
    sources = [source("a", 1, "test"), source("b", 1, "train")]
    splits = split_up(sources, [Path("a.mcap")], [Path("b.mcap")])
    assert splits.of == {("a", 0): "train", ("b", 0): "test"}


def test_a_session_that_says_nothing_is_cut_in_time() -> None:
    splits = split_up([source("a", 7)], (), ())
    assert [splits.of["a", i] for i in range(7)] == ["train"] * 5 + ["test"] * 2
    assert "last third" in splits.said


def test_of_short_sessions_every_third_is_test() -> None:
    splits = split_up([source(name, 1, "both") for name in "abcd"], (), ())
    assert [splits.of[name, 0] for name in "abcd"] == ["train", "train", "test", "train"]


def test_sessions_of_one_split_alone_are_cut_and_can_test_no_more() -> None:
    splits = split_up([source("a", 3, "test"), source("b", 3, "test")], (), ())
    assert splits.reused
    assert set(splits.of.values()) == {"train", "test"}
    assert "no longer serve as a test" in splits.said


def test_a_session_cannot_be_both() -> None:
    with pytest.raises(PomologError, match="with --train and with --test"):
        split_up([source("a", 1)], [Path("a.mcap")], [Path("a.mcap")])
