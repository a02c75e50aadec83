"""What a model learns from."""

from pathlib import Path

import numpy as np
import pytest

from processor.lessons import boxed, expose, lesson_pairs, read_boxes
from recorder.errors import PomologError
from tests.scenes import apple, stereo_session


def test_an_exposure_of_no_stops_changes_nothing_and_a_longer_one_clips() -> None:
    picture = np.full((2, 2, 3), 120, np.uint8)
    assert expose(picture, 0) is picture
    assert expose(picture, 1)[0, 0, 0] > 120 > expose(picture, -1)[0, 0, 0]
    assert (expose(picture, 5) == 255).all()


def test_a_pairs_lessons_have_labels_and_the_same_apple_in_the_same_row(tmp_path: Path) -> None:
    path = stereo_session(tmp_path / "s.mcap", [[apple(1), apple(2, 0.1, 0.02, 0.6)]])
    ((left, right),) = lesson_pairs([path])
    disparity = left.discs[:, 0] - right.discs[:, 0]
    assert disparity == pytest.approx([60, 40])
    assert set(np.unique(left.labels)) == {0, 1, 2}


def test_half_the_size_is_the_same_scene(tmp_path: Path) -> None:
    path = stereo_session(tmp_path / "s.mcap", [[apple(1)]])
    ((left, _),) = lesson_pairs([path])
    half = left.halved()
    assert half.picture.shape == (120, 160, 3)
    assert half.discs[0, 2] == left.discs[0, 2] / 2
    assert half.rectification.focal_px == left.rectification.focal_px / 2


def test_a_session_without_truth_teaches_nothing(tmp_path: Path) -> None:
    path = stereo_session(tmp_path / "s.mcap", [[apple(1)]], truth=False)
    with pytest.raises(PomologError, match="pomolog label"):
        list(lesson_pairs([path]))


def test_boxes_are_read_in_pixels_and_no_file_means_no_fruit(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("0 0.5 0.25 0.1 0.2\n")
    np.testing.assert_allclose(read_boxes(path, (200, 100)), [[100, 25, 20, 20]])
    assert read_boxes(tmp_path / "b.txt", (200, 100)).shape == (0, 4)
    with pytest.raises(PomologError, match="images"):
        boxed(tmp_path, "train")
