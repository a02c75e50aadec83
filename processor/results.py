"""The tables of a run's results, as Parquet: what they are, written and read."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from processor.columns import circle_columns, meaning
from processor.run_file import read_run
from recorder.errors import PomologError
from recorder.files import replacing
from recorder.records import SIDES

STAGES: Final = (
    "decode", "rectify", "recognise", "clean", "circles", "match", "triangulate",
)  # fmt: skip
_KEY: Final = [("session", pa.string()), ("frame", pa.int32()), ("time_ns", pa.int64())]
COUNTED: Final = ("pixels", "pixels_cleaned", "fruit")
_F64: Final = pa.float64()
GROUP_ROWS: Final = 1 << 16
_WRITING: Final[dict[str, Any]] = {"write_page_checksum": True}  # else a flipped bit is a number
_JOINED: Final = "1.0"  # Parquet's version in finished tables, which tells them from rewritten ones
AXES: Final = ("xx", "xy", "xz", "yy", "yz", "zz")

# A row a located apple; null where there is none: an unmatched fruit has no range. Pixels are in
# the recorded picture, metres in the left camera's optical frame.
APPLES: Final = pa.schema(
    [
        *_KEY,
        ("apple", pa.int32()),
        *((name, _F64) for side in SIDES for name in circle_columns(side)),
        ("disparity_px", _F64),
        ("x_m", _F64),
        ("y_m", _F64),
        ("z_m", _F64),
        ("radius_m", _F64),
        ("surface_range_m", _F64),
        ("confidence", _F64),
        ("range_std_m", _F64),  # of the centre's distance; 1.96 of it is a 95 % interval
        ("surface_std_m", _F64),
        ("radius_std_m", _F64),
        *((f"cov_{axes}_m2", _F64) for axes in AXES),  # of the centre
        *((f"{side}_confidence", _F64) for side in SIDES),
        *((f"{side}_{what}", pa.int32()) for side in SIDES for what in ("inliers", "area_px")),
        *((f"{side}_truth", pa.int64()) for side in SIDES),
        *((f"{side}_false", pa.bool_()) for side in SIDES),  # null where nobody can know
        ("match_cost", _F64),
    ]
)
# A row a frame: counts and stage times.
FRAMES: Final = pa.schema(
    [
        *_KEY,
        ("left_fruit", pa.int32()),
        ("right_fruit", pa.int32()),
        ("matches", pa.int32()),  # of circles; impossible ones have no place
        ("matched", pa.int32()),  # with a place
        ("reference_px", pa.int32()),
        ("readings", pa.int32()),
        ("skew_ns", pa.int64()),
        ("conditions", pa.map_(pa.string(), pa.string())),  # lighting, cultivar, ... at that time
        *((f"{what}_{part}", pa.int64()) for what in COUNTED for part in ("tp", "fp", "fn")),
        *((f"{stage}_ns", pa.int64()) for stage in STAGES),
    ]
)
# A row a true apple that counts; its outline in pixels as recorded, null where it is out of view.
TRUTH: Final = pa.schema(
    [
        *_KEY,
        ("apple_id", pa.int64()),
        ("distance_m", _F64),
        ("left_visible", _F64),
        ("right_visible", _F64),
        ("found_left", pa.bool_()),
        ("found_right", pa.bool_()),
        ("match", pa.string()),
        ("error_m", _F64),
        ("std_m", _F64),
        ("truth_point", pa.string()),  # what distance_m leads to: "centre" or "surface"
        *((name, _F64) for side in SIDES for name in circle_columns(side)),
    ]
)
# A row a fruit that one run gained, lost or moved against another (`compare --fruit`).
CHANGES: Final = pa.schema(
    [
        ("session", pa.string()),
        ("frame", pa.int32()),
        ("apple", pa.int64()),  # of the truth; null where fruit are paired by each other
        ("what", pa.string()),
        ("x_px", _F64),  # in the recorded left picture
        ("y_px", _F64),
        ("moved_m", _F64),
        ("a_error_m", _F64),
        ("b_error_m", _F64),
    ]
)
# A row a setting of a sweep and a frame; the varied parameters are columns of their own.
SWEEP: Final = pa.schema(
    [
        ("setting", pa.int32()),
        ("session", pa.string()),
        ("frame", pa.int32()),
        ("split", pa.string()),
        ("lighting", pa.string()),
        ("circles", pa.int32()),  # of both views
        ("located", pa.int32()),
        *(
            (f"{what}_{part}", pa.int64())
            for what in ("pixels", "fruit")
            for part in ("tp", "fp", "fn")
        ),
        *((verdict, pa.int32()) for verdict in ("right", "wrong", "missed")),
        ("apples", pa.list_(pa.int64())),  # true ones that were located
        ("errors_m", pa.list_(_F64)),  # of their distances
        ("locate_ns", pa.int64()),  # as if the setting had run alone
    ]
)


def _explained(schema: pa.Schema) -> pa.Schema:
    """The schema with each column's meaning in its metadata, which the files keep."""
    return pa.schema(
        [field.with_metadata({"meaning": meaning(field.name) or ""}) for field in schema]
    )


TABLES: Final[dict[str, pa.Schema]] = {
    "apples": _explained(APPLES), "frames": _explained(FRAMES), "truth": _explained(TRUTH),
}  # fmt: skip
# Columns that came after the first results of this profile: older tables are read with nulls there.
LATER: Final[dict[str, frozenset[str]]] = {
    "apples": frozenset(f"{side}_false" for side in SIDES),
    "frames": frozenset(),
    "truth": frozenset(("truth_point", *circle_columns("left"), *circle_columns("right"))),
}  # fmt: skip

Row = dict[str, Any]
Rows = dict[str, list[Row]]


def write_tables(folder: Path, rows: Rows) -> None:
    """Write every table of `rows` to `folder`, an empty one too, each whole or not at all."""
    for name, schema in TABLES.items():
        with replacing(folder / f"{name}.parquet") as part:
            pq.write_table(pa.Table.from_pylist(rows[name], schema), part, **_WRITING)


def write_table(path: Path, rows: Sequence[Row], schema: pa.Schema | None = None) -> None:
    """Write plain rows as one Parquet file; without a schema, its columns as the rows have them."""
    with replacing(path) as part:
        pq.write_table(pa.Table.from_pylist(list(rows), schema), part)


def sweep_schema(varied: Sequence[str]) -> pa.Schema:
    """The columns of a sweep that varies these parameters; their values are text."""
    schema = SWEEP
    for place, name in enumerate(varied, 1):
        schema = schema.insert(place, pa.field(name, pa.string()))
    return schema


def join_tables(folders: Sequence[Path], out: Path) -> None:
    """Concatenate the tables of `folders`, in their order, into `out`.

    The file's bytes depend on the rows alone, not on how they were cut: its row groups are of
    `GROUP_ROWS` rows each, and each is one piece in memory.
    """
    for name, schema in TABLES.items():
        with (
            replacing(out / f"{name}.parquet") as part,
            pq.ParquetWriter(part, schema, version=_JOINED, **_WRITING) as writer,
        ):
            waiting = schema.empty_table()
            for folder in folders:
                waiting = pa.concat_tables([waiting, read_table(folder, name)])
                while len(waiting) >= GROUP_ROWS:
                    writer.write_table(waiting.slice(0, GROUP_ROWS).combine_chunks())
                    waiting = waiting.slice(GROUP_ROWS)
            if len(waiting):
                writer.write_table(waiting.combine_chunks())


def read_table(folder: Path, name: str) -> pa.Table:
    """Read one table of a run.

    Raises:
        PomologError: it is not there or not one of ours.
    """
    path = folder / f"{name}.parquet"
    if not path.is_file():
        raise PomologError(f"no {path}; make it with: pomolog replay S.mcap -o OUT")
    try:
        _require_as_written(folder, name)
        table = pq.read_table(path, page_checksum_verification=True)
        missing = set(TABLES[name].names) - set(table.column_names)
        for later in missing & LATER[name]:
            nulls = pa.nulls(len(table), TABLES[name].field(later).type)
            table = table.append_column(later, nulls)
        if missing := missing - LATER[name]:
            raise PomologError(
                f"{path} has no column {min(missing)}; it was made by another version, "
                "replay it again"
            )
        return table.select(TABLES[name].names).cast(TABLES[name])
    except (pa.ArrowException, OSError, ValueError, MemoryError, OverflowError) as error:
        reason = " ".join(str(error).split())[-160:]
        raise PomologError(f"{path} is damaged ({reason}); replay it again") from None


def _require_as_written(folder: Path, name: str) -> None:
    """Refuse a table that was damaged since replay wrote it; pages have checksums, footers none.

    One that a program has rewritten, knowing what it did, is taken as it is.
    """
    path, run = folder / f"{name}.parquet", folder / "run.json"
    told = read_run(run).get("tables", {}).get(name) if run.is_file() else None
    if told is None or told == hashlib.sha256(path.read_bytes()).hexdigest():
        return
    footer = pq.read_metadata(path)
    if footer.format_version == _JOINED and footer.created_by.startswith("parquet-cpp-arrow"):
        raise ValueError("it is not what replay wrote")
