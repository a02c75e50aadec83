"""A whole model learned from a small session."""

import json
from pathlib import Path

import pytest

from processor.methods import learned
from processor.model_file import load_model
from processor.teach import teach
from recorder.errors import PomologError
from recorder.rectify import rectify
from recorder.session_writer import SessionWriter
from tests.scenes import apple, located, pair_of, small_rig, stereo_session


@pytest.mark.slow
def test_a_model_learned_of_drawn_apples_locates_one(tmp_path: Path) -> None:
    frames = [[apple(1, 0.02 * k - 0.05, 0.02 * (k % 3) - 0.02, 0.4 + 0.02 * k)] for k in range(6)]
    path = stereo_session(tmp_path / "train.mcap", frames)
    out = tmp_path / "mine.npz"
    lines: list[str] = []
    teach([path], None, out, network_rounds=1, say=lines.append)
    assert any("round 1 of 1" in line for line in lines)
    said = json.loads(out.with_suffix(".json").read_text())
    assert (said["model"], said["sessions"][0]["pairs"]) == ("mine", 6)
    assert "jax" in said["versions"]
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [
        "mine.json", "mine.npz", "train.mcap"
    ]  # fmt: skip
    locator = learned(load_model(str(out)))
    trace = locator(*pair_of(small_rig(), apple(1)), rectify(small_rig()))
    assert any(z_m == pytest.approx(0.4, rel=4 / 60) for _, _, z_m in located(trace))


def test_without_an_apple_in_both_views_nothing_can_be_learned_of_matching(tmp_path: Path) -> None:
    path = stereo_session(tmp_path / "train.mcap", [[apple(1, -0.2, 0.0, 0.5)]])
    with pytest.raises(PomologError, match="more sessions"):
        teach([path], None, tmp_path / "mine.npz", network_rounds=0)
    assert not (tmp_path / "mine.npz").exists()


@pytest.mark.parametrize("split", ["test", "both"])
def test_a_session_with_pairs_of_the_test_split_is_refused(split: str, tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    with SessionWriter.create(path, small_rig(), {"split": split}):
        pass
    with pytest.raises(PomologError, match="--split train"):
        teach([path], None, tmp_path / "mine.npz", network_rounds=0)


def test_a_model_has_its_own_ending(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match=r"\.npz"):
        teach([], None, tmp_path / "mine.txt")


def test_what_a_network_needs_is_asked_for_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("processor.train_centres.find_spec", lambda _: None)
    with pytest.raises(PomologError, match=r"pomolog\[train\].*--network-rounds 0"):
        teach([tmp_path / "s.mcap"], None, tmp_path / "mine.npz")
