"""A rangefinder's beam that is known, found again from readings on boards and on apples."""

import numpy as np
import pytest

from recorder.calibrate.beam import Ball, Plane, Reading, Surface, fit_beam
from recorder.errors import PomologError
from recorder.rig import Floats, Rangefinder
from tests.builders import rangefinder, rotation_of

STD_M = 0.002


def read_on(surfaces: list[Surface], beam: Rangefinder, seed: int = 0) -> list[Reading]:
    """What the beam reads on each surface, with the noise of the instrument."""
    noise = np.random.default_rng(seed).normal(0, STD_M, len(surfaces))
    return [
        Reading(f"pair {i}", one, one.distance_m(beam.origin_m, beam.direction) + noise[i], STD_M)
        for i, one in enumerate(surfaces)
    ]


def boards(count: int, tilt_rad: float, seed: int = 1) -> list[Surface]:
    """Boards at 0.5 to 2 m, tilted by up to `tilt_rad` about both axes."""
    generator = np.random.default_rng(seed)
    found: list[Surface] = []
    for _ in range(count):
        turn = [*generator.uniform(-tilt_rad, tilt_rad, 2), 0.0]
        normal = rotation_of(turn)[:, 2]
        found.append(Plane(normal, float(normal @ [0.05, 0.0, generator.uniform(0.5, 2.0)])))
    return found


def balls(beam: Rangefinder, count: int, seed: int = 2) -> list[Surface]:
    """Apples that the beam meets, not always in the middle."""
    generator = np.random.default_rng(seed)
    found: list[Surface] = []
    for _ in range(count):
        middle = beam.origin_m + generator.uniform(0.6, 2.0) * beam.direction
        found.append(
            Ball(middle + generator.uniform(-0.02, 0.02, 3), generator.uniform(0.035, 0.045))
        )
    return found


def off(found: Rangefinder, truth: Rangefinder) -> tuple[float, Floats]:
    """The angle between two beams, and the difference of their origins."""
    angle = float(np.linalg.norm(np.cross(found.direction, truth.direction)))
    return angle, np.abs(found.origin_m - truth.origin_m)


def test_tilted_boards_tell_origin_and_direction() -> None:
    truth = rangefinder()
    found = fit_beam(read_on(boards(25, 0.6), truth), None)
    angle, origin_m = off(found.rangefinder, truth)
    assert found.estimated == "origin and direction"
    assert angle < 4 * found.angle_std_rad
    assert (origin_m < 4 * found.origin_std_m).all()
    assert found.angle_std_rad < np.deg2rad(0.5)
    assert found.rms_m == pytest.approx(STD_M, rel=0.5)
    assert found.used == 25


def test_readings_beside_the_board_are_left_out() -> None:
    truth = rangefinder()
    readings = read_on(boards(25, 0.6), truth)
    for place in (3, 11, 12):
        one = readings[place]
        readings[place] = Reading(one.name, one.surface, one.range_m + 0.8, one.std_m)
    found = fit_beam(readings, None)
    assert found.left_out == ("pair 3", "pair 11", "pair 12")
    assert off(found.rangefinder, truth)[0] < np.deg2rad(1)


def test_boards_that_are_all_alike_do_not_tell_where_the_beam_is() -> None:
    with pytest.raises(PomologError, match=r"at more tilts and distances.*by a ruler"):
        fit_beam(read_on(boards(25, 0.0), rangefinder()), None)


def test_boards_that_are_all_alike_correct_the_offset_of_a_known_beam() -> None:
    truth = rangefinder()
    by_ruler = Rangefinder(truth.origin_m - 0.013 * truth.direction, truth.direction, 0.002)
    found = fit_beam(read_on(boards(25, 0.0), truth), by_ruler)
    assert found.estimated == "offset"
    assert found.angle_std_rad == 0
    assert off(found.rangefinder, truth)[1].max() < 4 * STD_M / 5  # the mean of 25
    assert found.rangefinder.std_m == 0.002


def test_apples_tell_the_direction_of_a_beam_whose_origin_is_known() -> None:
    truth = rangefinder()
    start = np.array([0.0, 0, 1])
    by_ruler = Rangefinder(truth.origin_m, start, 0.002)
    found = fit_beam(read_on(balls(truth, 25), truth), by_ruler)
    assert found.estimated in ("origin and direction", "direction and offset")
    assert off(found.rangefinder, truth)[0] < max(4 * found.angle_std_rad, 1e-3)


def test_few_readings_are_told() -> None:
    with pytest.raises(PomologError, match=r"5 readings .* 6 are the least"):
        fit_beam(read_on(boards(5, 0.6), rangefinder()), None)


def test_a_beam_beside_a_ball_is_pulled_towards_it() -> None:
    ball = Ball(np.array([0.0, 0, 1]), 0.04)
    ahead = np.array([0.0, 0, 1])
    assert ball.distance_m(np.zeros(3), ahead) == pytest.approx(0.96)
    rim = ball.distance_m(np.array([0.04, 0, 0]), ahead)
    past = ball.distance_m(np.array([0.05, 0, 0]), ahead)
    assert rim == pytest.approx(1.0)
    assert past == pytest.approx(1.01)
