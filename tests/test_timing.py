from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from recorder.check import check
from recorder.cli import app
from recorder.errors import PomologError
from recorder.session import Session
from recorder.session_writer import SessionWriter
from recorder.timing import Verdict, judge, timing_of
from tests.builders import frame, rig

MS = 1_000_000
TICKS = np.arange(60) * 33_333_333 + 10**9
SIZE_PX = (16, 16)


def session(folder: Path, left: Sequence[int] | Any, right: Sequence[int] | Any) -> Path:
    path = folder / "times.mcap"
    with SessionWriter.create(path, rig(SIZE_PX)) as writer:
        for time_ns in left:
            writer.write_frame(frame("left", int(time_ns), size_px=SIZE_PX))
        for time_ns in right:
            writer.write_frame(frame("right", int(time_ns), size_px=SIZE_PX))
    return path


def verdict(folder: Path, left: Any, right: Any) -> Verdict:
    with Session(session(folder, left, right)) as opened:
        found = judge(timing_of(opened))
    assert found is not None
    return found


def jitter(scale_ms: float) -> Any:
    return np.random.default_rng(1).normal(0, scale_ms * MS, len(TICKS))


def test_a_trigger_is_one_moment(tmp_path: Path) -> None:
    found = verdict(tmp_path, TICKS, TICKS + 300_000 + jitter(0.05))
    assert (found.kind, found.sound) == ("together", True)
    assert "of one moment" in found.text


@pytest.mark.parametrize(("skew_ns", "sound"), [(5 * MS, True), (5 * MS + 1, False)])
def test_views_just_as_far_apart_as_allowed_are_pairs(
    tmp_path: Path, skew_ns: int, *, sound: bool
) -> None:
    with Session(session(tmp_path, TICKS, TICKS + skew_ns)) as opened:
        timing = timing_of(opened)
        assert timing.paired.tolist() == [sound] * len(TICKS)
        assert len(opened) == timing.paired.sum()


def test_an_offset_of_the_clocks_is_told_with_what_undoes_it(tmp_path: Path) -> None:
    found = verdict(tmp_path, TICKS, TICKS + 11 * MS + jitter(0.1))
    assert (found.kind, found.sound) == ("offset", False)
    assert "11.0 ms later, always" in found.text
    assert "--offset right=-11.0ms" in found.text
    assert "up to 17 mm of error at 1 m" in found.text  # 0.3 m/s * 11.3 ms / 0.2 m
    near = verdict(tmp_path, TICKS, TICKS - 3 * MS)
    assert (near.kind, near.sound) == ("offset", True)
    assert "earlier" in near.text


def test_free_cameras_wander_over_the_interval(tmp_path: Path) -> None:
    found = verdict(tmp_path, TICKS, np.arange(60) * 34_900_000 + 10**9)
    assert (found.kind, found.sound) == ("free", False)
    assert "trigger them together" in found.text


def test_clocks_that_drift_are_told(tmp_path: Path) -> None:
    found = verdict(tmp_path, TICKS, TICKS + np.linspace(0, 4 * MS, 60))
    assert (found.kind, found.sound) == ("drift", False)
    assert "+4.0 ms over the session" in found.text


def test_a_loose_trigger_is_together_within_its_jitter(tmp_path: Path) -> None:
    found = verdict(tmp_path, TICKS, TICKS + jitter(1.0))
    assert (found.kind, found.sound) == ("together", True)
    assert "together within" in found.text


def test_few_frames_say_little_and_one_view_nothing(tmp_path: Path) -> None:
    assert verdict(tmp_path, TICKS[:2], TICKS[:2] + np.array([2 * MS, 1 * MS])).kind == "few"
    assert verdict(tmp_path, TICKS[:2], []).kind == "lone"


def test_check_tells_the_verdict_even_where_nothing_pairs(tmp_path: Path) -> None:
    path = session(tmp_path, TICKS, TICKS + 18 * MS)
    found = check(path)
    assert found[-1].level == "failure"
    assert "no left and right frames within 5 ms" in found[-1].text
    # 18 ms later, or 15.3 ms before the next: the nearest counts
    (told,) = [finding.text for finding in found if "15.3 ms earlier, always" in finding.text]
    assert "right=15.3ms (or -18.0ms, the next but one)" in told


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_the_plot_is_drawn(tmp_path: Path, ending: str) -> None:
    path = session(tmp_path, np.delete(TICKS, 20), TICKS + jitter(2))
    out = tmp_path / f"gaps.{ending}"
    for _ in range(2):
        before = out.read_bytes() if out.exists() else b""
        result = CliRunner().invoke(app, ["check", str(path), "--plot", str(out)])
        assert result.exit_code == 0, result.output
    assert out.read_bytes() == before  # the same picture each time
    if ending == "png":
        pixels = np.asarray(Image.open(out).convert("RGB"))
        assert pixels.shape[1] == 1080
        blue = (np.abs(pixels.astype(int) - [0, 114, 178]).max(axis=2) < 10).sum()
        red = (np.abs(pixels.astype(int) - [213, 94, 0]).max(axis=2) < 10).sum()
        assert blue > 100
        assert red > 100
    if ending == "svg":
        assert "1 gaps" in out.read_text() or len(out.read_text()) > 5000


def test_a_plot_of_another_ending_is_refused(tmp_path: Path) -> None:
    path = session(tmp_path, TICKS, TICKS)
    result = CliRunner().invoke(app, ["check", str(path), "--plot", str(tmp_path / "x.bmp")])
    assert isinstance(result.exception, PomologError)
    assert ".png, .svg, .pdf" in str(result.exception)
    assert not (tmp_path / "x.bmp").exists()


def test_one_view_has_intervals_and_no_gaps(tmp_path: Path) -> None:
    from recorder.one_view import ONE_VIEW, nominal_camera, one_view_rig

    path = tmp_path / "one.mcap"
    with SessionWriter.create(path, one_view_rig(nominal_camera(SIZE_PX)), ONE_VIEW) as writer:
        for time_ns in TICKS:
            writer.write_frame(frame("left", int(time_ns), size_px=SIZE_PX))
    with Session(path) as opened:
        assert judge(timing_of(opened)) is None
    result = CliRunner().invoke(app, ["check", str(path), "--plot", str(tmp_path / "one.png")])
    assert result.exit_code == 0
    assert (tmp_path / "one.png").exists()
