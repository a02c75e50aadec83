"""Circles through pairs of contour points, and their votes."""

import cv2
import numpy as np

from processor.candidates import Contour, Pairs, vote
from processor.trace import Floats, Mask
from tests.scenes import disc_mask

SIZE = (320, 240)
WINDOW = (10.0, 80.0)


def made(mask: Mask) -> Floats:
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    plain: list[Contour] = [np.asarray(c, np.int32)[:, 0] for c in contours]
    return Pairs()(np.asarray(cv2.blur(mask, (3, 3))), plain, WINDOW, np.random.default_rng(0))


def nearest(circles: Floats, wanted: tuple[float, float, float]) -> float:
    return float(np.abs(circles - np.array(wanted)).max(1).min())


def test_a_disc_gives_circles_near_itself_and_the_best_voted_is_it() -> None:
    voted = vote(made(disc_mask((150, 120, 45), size_px=SIZE)), 10)
    assert np.abs(voted[0] - (150, 120, 45)).max() < 3


def test_two_touching_discs_each_have_a_circle() -> None:
    voted = vote(made(disc_mask((110, 120, 40), (180, 120, 40), size_px=SIZE)), 40)
    assert nearest(voted, (110, 120, 40)) < 4
    assert nearest(voted, (180, 120, 40)) < 4


def test_circles_outside_the_window_are_not_made() -> None:
    radii = made(disc_mask((150, 120, 45), size_px=SIZE))[:, 2]
    assert radii.min() > WINDOW[0]
    assert radii.max() < WINDOW[1]


def test_the_pictures_edge_is_no_rim() -> None:
    voted = vote(made(disc_mask((0, 120, 45), size_px=SIZE)), 5)
    assert np.abs(voted[0] - (0, 120, 45)).max() < 4


def test_no_contours_give_no_circles() -> None:
    assert made(np.zeros(SIZE[::-1], np.uint8)).shape == (0, 3)
    assert vote(np.empty((0, 3)), 5).shape == (0, 3)
