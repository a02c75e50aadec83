"""Recordings taken apart and put together: rows of chosen frames, entities under new names."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk, LazyChunkStream, RrdReader

from processor.rrd import APPLICATION
from recorder.errors import PomologError
from recorder.files import replacing

FRAME: Final = "frame"


def chunks_of(path: Path) -> Iterator[Chunk]:
    """Every chunk of a recording, in the order of the file.

    Raises:
        PomologError: it is no recording, or damaged.
    """
    try:
        yield from RrdReader(path).store().stream()
    except (ValueError, OSError, RuntimeError) as error:
        raise PomologError(
            f"{path} cannot be read as a recording ({error}); replay its session again"
        ) from None


def entity_of(chunk: Chunk) -> str:
    """Its entity's path, without the slash before it."""
    return chunk.entity_path.removeprefix("/")


def stepped(
    chunk: Chunk, steps: Mapping[int, Sequence[int]], timeline: str
) -> Iterator[tuple[int, int, Chunk]]:
    """The rows of chosen frames, each on a timeline of its own and on no other.

    Args:
        chunk: with the timeline `frame`.
        steps: for each chosen frame its places on the new timeline.
        timeline: the new one's name.

    Yields:
        Frame, step and a chunk of that row.
    """
    batch = chunk.to_record_batch()
    frames = batch.column(FRAME).to_pylist()
    for frame, places in steps.items():
        # of several rows of a frame (notes, the recorder's state) the last holds
        rows = [i for i, f in enumerate(frames) if f == frame][-1:]
        for row in rows:
            for step in places:
                yield frame, step, at_step(batch.slice(row, 1), chunk.entity_path, step, timeline)


def at_step(batch: pa.RecordBatch, entity: str, step: int, timeline: str) -> Chunk:
    """One row of a chunk, static or not, moved to a place on another timeline."""
    kept = [
        (field, column)
        for field, column in zip(batch.schema, batch.columns, strict=True)
        if (field.metadata or {}).get(b"rerun:kind") == b"data"
    ]
    fields = [pa.field(timeline, pa.int64()), *(field for field, _ in kept)]
    columns = [pa.array([step], pa.int64()), *(column for _, column in kept)]
    moved = pa.RecordBatch.from_arrays(columns, schema=pa.schema(fields))
    (made,) = Chunk.from_record_batch(moved, index=timeline, entity_path=entity)
    return made


def values(chunk: Chunk, component: str) -> list[Any]:
    """The one row of a component of a chunk of one row; empty where it has none."""
    batch = chunk.to_record_batch()
    if component not in batch.schema.names:
        return []
    return list(batch.column(component).to_pylist()[0] or ())


def rows_by_frame(chunk: Chunk, components: Sequence[str]) -> dict[int, tuple[list[Any], ...]]:
    """A chunk's rows of these components by frame, empty lists where a row has none."""
    batch = chunk.to_record_batch()
    columns = [batch.column(name).to_pylist() for name in components]
    frames = batch.column(FRAME).to_pylist()
    return {
        frame: tuple(list(column[i] or ()) for column in columns) for i, frame in enumerate(frames)
    }


def drawn(entity: str, what: Any, step: int | None, timeline: str) -> Chunk:
    """Something new at a place of a timeline, or static where there is no step.

    Args:
        entity: its path.
        what: a Rerun archetype.
        step: where; None is everywhere.
        timeline: of the step.
    """
    indexes = [] if step is None else [rr.TimeColumn(timeline, sequence=[step])]
    columns = [
        batch.partition([len(batch.as_arrow_array())]) for batch in what.as_component_batches()
    ]
    return Chunk.from_columns(entity, indexes=indexes, columns=columns)


def write_recording(path: Path, chunks: Iterable[Chunk], recording_id: str) -> None:
    """Write chunks as one recording, whole or not at all.

    Raises:
        PomologError: the file cannot be written.
    """
    with replacing(path) as part:
        try:
            LazyChunkStream.from_iter(chunks).write_rrd(
                part, application_id=APPLICATION, recording_id=recording_id
            )
        except (OSError, RuntimeError) as error:
            raise PomologError(f"cannot write {path}: {error}; is the disk full?") from None
