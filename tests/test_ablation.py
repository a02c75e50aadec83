"""The benchmarks that take stages out, and that hold ways to a range side by side."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.ablation import measure
from benchmarks.range_ways import errors_of
from recorder.records import RangeReading
from recorder.rig import Rangefinder
from tests.scenes import apple, small_rig, stereo_session


@pytest.mark.slow
def test_who_is_told_the_circles_misses_none(tmp_path: Path) -> None:
    path = stereo_session(tmp_path / "s.mcap", [[apple(1), apple(2, 0.09, 0.05, 0.45)]])
    found = measure([path])
    told = found["told masks and circles"]
    assert told.fruit is not None
    assert (told.fruit.tp, told.fruit.fp, told.fruit.fn) == (4, 0, 0)
    assert told.pixels is not None
    assert told.pixels.f1 == 1.0
    assert found["paper"].frames == found["pomolog"].frames == 1


def test_every_way_is_held_against_the_apple_that_the_beam_ends_on(tmp_path: Path) -> None:
    beam = Rangefinder(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.001)
    reading = RangeReading(0, 0.36, 0.001, "ok", "0.36")
    path = stereo_session(
        tmp_path / "s.mcap", [[apple(1), apple(2, 0.09, 0.05, 0.45)]], rig=small_rig(beam),
        readings=[reading],
    )  # fmt: skip
    found, met = errors_of([path])
    assert met == 1
    assert {way: len(errors) for way, errors in found.items()} == {
        "parallel": 1, "outline_range": 1, "reading_range": 1, "depth_range": 0, "fused_range": 1,
    }  # fmt: skip
    ((error_m, std_m),) = found["reading_range"]
    assert abs(error_m) < 0.005  # a drawn sphere's front is not an apple's, 4.5 % of its radius
    assert std_m is not None
