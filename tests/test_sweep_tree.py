"""Many locators on one pair: the same traces as one by one, with shared stages called once."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from processor.circles import RandomRing
from processor.clean import AreaRule
from processor.locate import Locator
from processor.match import AreaInOrder
from processor.methods import METHODS
from processor.recognise import ColourRatio, RedMinusLuma
from processor.sweep.settings import parse_vary, settings_of
from processor.sweep.tree import locate_all
from processor.trace import Trace
from processor.triangulate import Parallel
from recorder.rectify import rectify
from tests.scenes import apple, pair_of, small_rig

SEED = (3, 7)
RIG = small_rig()
PAIR = pair_of(RIG, apple(1, -0.05, 0.0, 0.45), apple(2, 0.07, 0.02, 0.5))


def assert_same(ours: Trace, theirs: Trace) -> None:
    for side in ("left", "right"):
        one, other = ours.view(side), theirs.view(side)
        np.testing.assert_array_equal(one.recognition.mask, other.recognition.mask)
        np.testing.assert_array_equal(one.cleaning.mask, other.cleaning.mask)
        assert one.circles.fruit == other.circles.fruit
    np.testing.assert_array_equal(ours.matching.pairs, theirs.matching.pairs)
    assert ours.apples == theirs.apples
    assert ours.stage_ns.keys() == theirs.stage_ns.keys()


def test_every_method_gives_the_trace_that_it_gives_alone() -> None:
    rectification = rectify(RIG)
    locators = list(METHODS.values())
    found = dict(locate_all(locators, *PAIR, rectification, SEED))
    assert sorted(found) == list(range(len(locators)))
    for place, locator in enumerate(locators):
        assert_same(found[place], locator(*PAIR, rectification, SEED))


def test_shared_stages_are_called_once_a_view(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: Counter[str] = Counter()

    def count(kind: type[Any]) -> None:
        whole = kind.__call__

        def counting(self: Any, *arguments: Any) -> Any:
            calls[kind.__name__] += 1
            return whole(self, *arguments)

        monkeypatch.setattr(kind, "__call__", counting)

    for kind in (ColourRatio, RedMinusLuma, AreaRule, RandomRing, AreaInOrder, Parallel):
        count(kind)
    words = ["recognise=colour_ratio,red_minus_luma", "circles.rounds=5,10,20",
             "match.in_order=true,false"]  # fmt: skip
    settings = settings_of(Locator(circles=RandomRing(rounds=5)), parse_vary(words))
    found = list(locate_all([one.locator for one in settings], *PAIR, rectify(RIG), SEED))
    assert len(found) == len(settings) == 12
    assert calls == {
        "ColourRatio": 2, "RedMinusLuma": 2,  # a view each
        "AreaRule": 2 * 2,  # of each recognition
        "RandomRing": 2 * 2 * 3,
        "AreaInOrder": 2 * 3 * 2, "Parallel": 2 * 3 * 2,
    }  # fmt: skip


def test_a_leafs_stage_times_are_those_of_its_branch() -> None:
    settings = settings_of(Locator(), parse_vary(["match.in_order=true,false"]))
    locators = [one.locator for one in settings]
    first, second = (t for _, t in locate_all(locators, *PAIR, rectify(RIG), SEED))
    for stage in ("rectify", "recognise", "clean", "circles"):
        assert first.stage_ns[stage] == second.stage_ns[stage] > 0
