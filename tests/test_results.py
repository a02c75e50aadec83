"""The rows of a run: their columns, their nulls, and the pixels they speak of."""

from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from processor.columns import meaning
from processor.count import FrameCounts, count_frame
from processor.locate import Locator
from processor.results import APPLES, TABLES, Rows, join_tables, read_table, write_tables
from processor.rows import rows_of
from processor.trace import Trace
from recorder.errors import PomologError
from recorder.records import AppleTruth, Frame, FrameTruth, StereoPair
from recorder.rectify import Rectification, rectify
from recorder.rig import Camera, Rig
from tests.scenes import RED, apple, draw, pair_of, red_disc_picture, small_rig

DESIGNED = [
    "session", "frame", "time_ns", "apple", "left_x_px", "left_y_px", "left_radius_px",
    "right_x_px", "right_y_px", "right_radius_px", "disparity_px", "x_m", "y_m", "z_m", "radius_m",
    "surface_range_m", "confidence",
]  # fmt: skip


def pair(index: int = 0) -> StereoPair:
    left = Frame("left", 10**9, "png", b"", (320, 240))
    right = Frame("right", 10**9 + 1000, "png", b"", (320, 240))
    return StereoPair(index, left, right, conditions={"lighting": "front"})


def rows(
    trace: Trace,
    parallel: Rectification,
    counts: FrameCounts = FrameCounts(),  # noqa: B008  # frozen
) -> Rows:
    return rows_of("s", pair(), trace, counts, parallel, 7)


def trace_of(*apples: AppleTruth) -> Trace:
    return Locator()(*pair_of(small_rig(), *apples), rectify(small_rig()))


def test_the_apples_table_has_the_designed_columns_first() -> None:
    assert APPLES.names[: len(DESIGNED)] == DESIGNED


def test_a_located_apple_is_a_row_of_its_trace() -> None:
    trace = trace_of(apple(1))
    (row,) = rows(trace, rectify(small_rig()))["apples"]
    (one,) = trace.apples
    left, right = trace.left.circles.fruit[0], trace.right.circles.fruit[0]
    assert (row["session"], row["frame"], row["time_ns"], row["apple"]) == ("s", 0, 10**9, 0)
    assert (row["x_m"], row["y_m"], row["z_m"]) == one.centre_m
    assert (row["left_x_px"], row["left_y_px"], row["left_radius_px"]) == (
        left.x_px, left.y_px, left.radius_px,
    )  # fmt: skip
    assert row["disparity_px"] == pytest.approx(left.x_px - right.x_px)
    assert row["surface_range_m"] == one.surface_range_m
    assert row["match_cost"] == trace.matching.cost[0]


def test_a_fruit_without_a_partner_has_no_place_and_no_other_side() -> None:
    lone = Locator()(red_disc_picture((160, 120, 40)), red_disc_picture(), rectify(small_rig()))
    (row,) = rows(lone, rectify(small_rig()))["apples"]
    table = pa.Table.from_pylist([row], APPLES).to_pylist()[0]
    without = ["disparity_px", "x_m", "y_m", "z_m", "radius_m", "surface_range_m", "match_cost"]
    without += [name for name in APPLES.names if name.startswith("right_")]
    assert {name: table[name] for name in without} == dict.fromkeys(without)
    assert table["left_x_px"] == pytest.approx(160, abs=5)


def test_a_frame_counts_its_fruit_and_keeps_its_conditions_and_times() -> None:
    trace = trace_of(apple(1))
    (row,) = rows(trace, rectify(small_rig()))["frames"]
    assert (row["left_fruit"], row["right_fruit"], row["matched"]) == (1, 1, 1)
    assert row["skew_ns"] == 1000
    assert row["conditions"] == [("lighting", "front")]
    assert row["decode_ns"] == 7
    assert {f"{stage}_ns" for stage in trace.stage_ns} <= row.keys()
    assert "pixels_tp" not in row  # no truth, no count


def test_a_true_apple_is_a_row_and_its_circles_name_it() -> None:
    known = apple(9, seen=1.0)
    left, right = (draw(small_rig(), side, [known])[1] for side in ("left", "right"))
    trace = trace_of(known)
    parallel = rectify(small_rig())
    counts = count_frame(trace, FrameTruth(left, right, (known,)), parallel)
    found = rows(trace, parallel, counts)
    (truth,) = found["truth"]
    assert (truth["apple_id"], truth["match"]) == (9, "right")
    assert (found["apples"][0]["left_truth"], found["apples"][0]["right_truth"]) == (9, 9)
    assert found["frames"][0]["fruit_tp"] == 2


def test_pixels_of_a_distorted_rig_are_those_of_the_recorded_picture() -> None:
    plain = small_rig()
    lens = np.array([-0.25, 0.05, 0.0, 0.0, 0.0])
    rotation, _ = cv2.Rodrigues(np.array([0.0, 0.03, 0.02]))
    rig = Rig(
        Camera(plain.left.size_px, plain.left.matrix, lens),
        Camera(plain.right.size_px, plain.right.matrix, lens),
        np.asarray(rotation, float),
        -rotation @ np.array([0.06, 0.0, 0.0]),
    )
    there = [apple(1, 0.09, 0.05, 0.4)]  # off the axis, where the lens bends
    recorded = draw(rig, "left", there)[0]
    trace = Locator()(recorded, draw(rig, "right", there)[0], rectify(rig))
    (row,) = rows(trace, rectify(rig))["apples"]
    y, x = np.nonzero((recorded == RED).all(axis=2))
    # the middle of what was drawn, but for a ring of 5 px and the oval that a sphere is off-axis
    assert (row["left_x_px"], row["left_y_px"]) == pytest.approx((x.mean(), y.mean()), abs=3)
    assert row["left_radius_px"] == pytest.approx(np.sqrt(len(x) / np.pi), abs=3)
    rectified = trace.left.circles.fruit[0]
    assert abs(rectified.x_px - x.mean()) > 6  # which the rectified picture's are not


def test_empty_tables_are_written_with_their_columns(tmp_path: Path) -> None:
    write_tables(tmp_path, {name: [] for name in TABLES})
    for name, schema in TABLES.items():
        table = read_table(tmp_path, name)
        assert table.num_rows == 0
        assert table.schema.equals(schema)


def test_parts_are_joined_in_their_order(tmp_path: Path) -> None:
    trace = trace_of(apple(1))
    parts = []
    for number in (3, 1, 2):
        part = tmp_path / str(number)
        part.mkdir()
        found = rows_of("s", pair(number), trace, FrameCounts(), rectify(small_rig()), 0)
        write_tables(part, found)
        parts.append(part)
    join_tables(parts, tmp_path)
    assert read_table(tmp_path, "frames")["frame"].to_pylist() == [3, 1, 2]
    assert read_table(tmp_path, "apples")["frame"].to_pylist() == [3, 1, 2]


def test_a_table_that_is_not_there_or_damaged_or_old_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match=r"no .*apples\.parquet; make it with"):
        read_table(tmp_path, "apples")
    (tmp_path / "apples.parquet").write_bytes(b"PAR1 but not much more")
    with pytest.raises(PomologError, match="damaged"):
        read_table(tmp_path, "apples")
    pq.write_table(pa.table({"session": ["s"]}), tmp_path / "apples.parquet")
    with pytest.raises(PomologError, match="no column apple; it was made by another version"):
        read_table(tmp_path, "apples")


def test_every_column_says_what_it_means_in_the_file_too(tmp_path: Path) -> None:
    for name, schema in TABLES.items():
        assert not [field.name for field in schema if not meaning(field.name)]
        path = tmp_path / f"{name}.parquet"
        pq.write_table(schema.empty_table(), path)
        kept = pq.read_schema(path)
        assert all(field.metadata[b"meaning"] for field in kept)
    assert meaning("left_radius_px") != meaning("left_x_px")
    assert meaning("unheard") is None
