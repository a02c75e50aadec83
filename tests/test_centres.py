"""The network of centres: what it is shown and asked, how it is written, what it says."""

from dataclasses import replace
from pathlib import Path
from threading import Event

import cv2
import numpy as np
import pytest

from processor.centre_lessons import Example, example, turn, wanted_of
from processor.centre_net import OnArrays, first_weights, network, to_onnx
from processor.centres import CELL, INPUTS, USUAL_PX, CentreModel, Centres, near_px, told
from processor.lessons import Lesson
from processor.nearness import Nearness
from processor.net import Floats32
from processor.trace import Look, Recognition
from processor.train_centres import CROP_PX, learn_centres, train_centres
from recorder.errors import PomologError
from recorder.records import UNCOUNTED
from recorder.rectify import rectify
from recorder.rig import parallel_rig

PAPERS = rectify(parallel_rig())


def centres(logit: Floats32, radius: float = 40.0, pitch_px: float = 8.0) -> Centres:
    """What a network says that thinks every centre is where it is asked."""
    said = np.zeros((5, *logit.shape), np.float32)
    said[0] = logit
    said[1] = np.log(radius / (USUAL_PX * pitch_px / CELL))
    return told(said, pitch_px / CELL)


@pytest.mark.parametrize("size_px", [(64, 48), (160, 104)])
def test_opencv_says_what_jax_says(size_px: tuple[int, int]) -> None:
    weights = first_weights(7)
    weights["head"] = (10 * weights["head"][0], weights["head"][1])  # small at first
    width, height = size_px
    seen = np.random.default_rng(1).standard_normal((1, height, width, INPUTS)).astype(np.float32)
    wanted = np.asarray(network(OnArrays(weights), seen))[0].transpose(2, 0, 1)
    read = cv2.dnn.readNetFromONNX(np.frombuffer(to_onnx(weights, (96, 96)), np.uint8))
    read.setInput(np.ascontiguousarray(seen.transpose(0, 3, 1, 2)))
    assert np.ptp(wanted) > 1
    np.testing.assert_allclose(read.forward()[0], wanted, atol=1e-3)  # float32, other orders


@pytest.mark.parametrize("size_px", [(1280, 1024), (1000, 700)])
def test_a_picture_of_any_size_has_a_place_for_each_cell(size_px: tuple[int, int]) -> None:
    width, height = size_px
    picture = np.full((height, width, 3), 90, np.uint8)
    nothing = np.zeros((height, width), np.uint8)
    look = Look(picture, Recognition(nothing, nothing), PAPERS)
    said = CentreModel(to_onnx(first_weights(0), (64, 64)))(look, None)
    assert said.circles.shape == (*said.logit.shape, 3)
    assert said.logit.shape[1] * said.pitch_px == pytest.approx(width, abs=said.pitch_px)
    assert said.logit.shape[0] * said.pitch_px == pytest.approx(height, abs=said.pitch_px)


def test_a_peak_is_where_nothing_around_is_higher() -> None:
    logit = np.full((20, 30), -6.0, np.float32)
    logit[5, 7], logit[5, 8], logit[12, 20], logit[0, 0] = 2.0, 1.0, -1.0, -4.0
    found = centres(logit).peaks(0.05)
    np.testing.assert_allclose(found, [[7 * 8 + 3.5, 5 * 8 + 3.5, 40], [20 * 8 + 3.5, 99.5, 40]])


def test_a_circle_is_told_its_centre_and_the_best_one_near_it() -> None:
    logit = np.full((20, 30), -6.0, np.float32)
    logit[5, 7] = 2.0
    there, beside, smaller = centres(logit).measures(
        np.array([[59.5, 43.5, 40.0], [69.5, 43.5, 40.0], [59.5, 43.5, 20.0]])
    )
    np.testing.assert_allclose(there, [2, 2, 0, 0, 0], atol=1e-5)
    np.testing.assert_allclose(beside, [-6, 2, 0, 10 / 40, 0], atol=1e-5)
    np.testing.assert_allclose(smaller[2], np.log(2), atol=1e-5)


def test_how_near_it_is_becomes_a_size_in_the_small_picture() -> None:
    nearness = Nearness(np.full((128, 160), 80, np.float32), 8, 0.5)
    small = np.zeros((256, 320, 3), np.uint8)
    assert near_px(nearness, small, 4.0) == pytest.approx(np.full((256, 320), 10.0))
    assert not near_px(None, small, 4.0).any()


def test_a_hill_stands_on_each_fruit_and_nothing_is_asked_of_doubtful_ones() -> None:
    known = np.ones((30, 40), bool)
    known[20:, :] = False
    wanted = wanted_of(np.array([[21.0, 15.0, 8.0, 0.9], [61.0, 15.0, 8.0, 0.05]]), known)
    hill, top, asked, sure = (wanted[..., k] for k in range(4))
    column, row = (21.5 / CELL - 0.5, 15.5 / CELL - 0.5)
    place = round(row), round(column)
    assert hill[place] == top[place] == 1
    assert top.sum() == 1  # what is hardly seen is no centre, and no mistake either
    assert asked[7, 30] == asked[25, 3] == asked[place] == 0
    assert asked[7, 20] == 1
    assert sure[place] == 1
    log_radius, x, y, visible = wanted[(*place, slice(4, None))]
    assert log_radius == pytest.approx(np.log(8 / USUAL_PX))
    assert (x, y) == pytest.approx(((column - place[1]) / 4, (row - place[0]) / 4))
    assert visible == pytest.approx(0.9)


def drawn(x: float, y: float, radius: float) -> Example:
    rows, columns = np.mgrid[:256, :320]
    inside = np.hypot(columns - x, rows - y) < radius
    small = np.where(inside[..., None], (20, 20, 220), (20, 120, 20)).astype(np.uint8)
    near = np.where(inside, radius, 0).astype(np.float32)
    discs = np.array([[x, y, radius, 1.0]])
    return Example("drawn/0/left", small, near, discs, np.zeros((128, 160), bool), 0, False)


def test_however_an_example_is_turned_the_truth_goes_with_it() -> None:
    rng, seen_at_all = np.random.default_rng(3), 0
    for _ in range(40):
        seen, wanted = turn(drawn(160, 128, 20), rng, CROP_PX)
        red = seen[..., 2] - seen[..., 1] > 0.2
        tops = np.argwhere(wanted[..., 1] == 1)
        if len(tops) == 0 or red[0].any() or red[-1].any() or red[:, 0].any() or red[:, -1].any():
            continue
        seen_at_all += 1
        (row, column), rows_columns = tops[0], np.argwhere(red)
        log_radius, x, y, _ = wanted[(row, column, slice(4, None))]
        radius = USUAL_PX * np.exp(log_radius)
        assert radius == pytest.approx(np.sqrt(red.sum() / np.pi), rel=0.03)
        middle = (
            np.array([row + y * radius / CELL, column + x * radius / CELL]) + 0.5
        ) * CELL - 0.5
        assert middle == pytest.approx(rows_columns.mean(0), abs=0.4)
        near = seen[..., 3][red].mean()
        if near > 0.1:  # not one of those that know no other view
            assert (near - 1) * 2 == pytest.approx(log_radius, abs=0.15)
    assert seen_at_all > 20


def test_a_lesson_is_shrunk_with_its_discs_and_doubts() -> None:
    labels = np.zeros((1024, 1280), np.uint16)
    labels[:80, :80] = UNCOUNTED
    lesson = Lesson(
        "s/0/left", np.zeros((1024, 1280, 3), np.uint8), labels,
        np.array([[639.5, 511.5, 80.0, 0.7]]), PAPERS,
    )  # fmt: skip
    coarser = 1280 / example(lesson, None).small.shape[1]
    made = example(lesson, None)
    np.testing.assert_allclose(
        made.discs, [[640 / coarser - 0.5, 512 / coarser - 0.5, 80 / coarser, 0.7]], rtol=2e-3
    )
    assert made.doubtful[2, 2]
    assert not made.doubtful[60, 60]


@pytest.mark.slow
def test_networks_that_are_done_are_not_trained_again(tmp_path: Path) -> None:
    shown = [
        replace(drawn(100 + 8 * k, 100, 20), name=f"scene{k}/0/left", fold=k % 2) for k in range(4)
    ]
    lines: list[str] = []
    first = learn_centres(shown, tmp_path / "kept", 1, lines.append)
    assert [line.endswith("is done") for line in lines] == [False] * 3
    assert len({model.onnx for model in (first.whole, *first.without) if model}) == 3
    again = learn_centres(shown, tmp_path / "kept", 1, lines.append)
    assert [line.endswith("is done") for line in lines[3:]] == [True] * 3
    assert again.whole is not None
    assert first.whole is not None
    assert again.whole.onnx == first.whole.onnx


def test_training_ends_where_it_is_stopped() -> None:
    stopping = Event()
    stopping.set()
    with pytest.raises(PomologError, match="begin it again"):
        train_centres([drawn(100, 100, 20)], rounds=1, stopping=stopping)


@pytest.mark.slow
def test_a_network_learns_where_drawn_fruit_are() -> None:
    rng = np.random.default_rng(5)
    shown = [drawn(*rng.uniform((60, 60, 14), (260, 196, 28))) for _ in range(64)]
    lines: list[str] = []
    model = train_centres(shown, rounds=20, crop_px=(96, 128), say=lines.append)
    first, last = (float(line.rpartition(" ")[2]) for line in lines)
    assert last < first
    one = drawn(130, 90, 22)
    picture = one.small.repeat(4, 0).repeat(4, 1)
    nothing = np.zeros(picture.shape[:2], np.uint8)
    nearness = Nearness(4 * one.near[::2, ::2], 8, 1.0)
    said = model(Look(picture, Recognition(nothing, nothing), PAPERS), nearness)
    best = said.circles[np.unravel_index(said.logit.argmax(), said.logit.shape)]
    assert best == pytest.approx([4 * 130.5 - 0.5, 4 * 90.5 - 0.5, 88], abs=20)
