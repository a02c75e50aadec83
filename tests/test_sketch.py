"""The drawn session: exact truth, and apples that the locator can find."""

from pathlib import Path

import numpy as np
import pytest

from processor.discs import true_discs
from recorder.check import check
from recorder.records import SIDES
from recorder.rectify import rectify
from recorder.session import Session
from recorder.sketch import FOCAL_PX, sketch


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sketch") / "drawn.mcap"
    sketch(path, pairs=3)
    return path


def test_a_drawn_session_is_sound_and_has_the_lights_by_turns(drawn: Path) -> None:
    assert all(finding.level == "ok" for finding in check(drawn))
    with Session(drawn) as session:
        assert [p.conditions["lighting"] for p in session.pairs()] == ["front", "back", "cloudy"]


def test_labels_lie_within_the_projected_outline_and_fill_it_where_all_is_seen(drawn: Path) -> None:
    with Session(drawn) as session:
        rectification = rectify(session.rig)
        for pair in session.pairs():
            assert pair.truth is not None
            assert pair.truth.apples
            for side in SIDES:
                labels = pair.truth.left if side == "left" else pair.truth.right
                discs = true_discs(pair.truth, side, labels, rectification)
                assert discs is not None
                assert labels is not None
                for apple, (x, y, radius) in zip(pair.truth.apples, discs.circles, strict=True):
                    rows, columns = np.nonzero(labels == apple.id)
                    # off the axis the outline is an ellipse, longer by the slant of its ray
                    slant = np.hypot(1, np.hypot(x - 319.5, y - 255.5) / FOCAL_PX)
                    assert (np.hypot(columns - x, rows - y) <= slant * radius + 2).all()
                    seen = apple.left_visible if side == "left" else apple.right_visible
                    assert seen is not None
                    whole_px = np.pi * radius**2
                    assert len(rows) == pytest.approx(seen * whole_px, rel=slant - 0.95, abs=12)


def test_some_apples_are_whole_and_some_partly_hidden(drawn: Path) -> None:
    with Session(drawn) as session:
        seen = [a.left_visible for p in session.pairs() if p.truth for a in p.truth.apples or ()]
    assert max(s for s in seen if s is not None) > 0.99
    assert any(0.2 < s < 0.9 for s in seen if s is not None)


def test_the_same_seed_draws_the_same(drawn: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.mcap"
    sketch(again, pairs=1)
    with Session(drawn) as one, Session(again) as other:
        first, second = (next(s.pairs(stop=1)) for s in (one, other))
    assert first.left.data == second.left.data
