"""Several methods' results on one session as siblings in one recording, their changes marked."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import rerun as rr
from rerun.chunk import Chunk

from processor.palette import CHANGES
from processor.results import read_table
from processor.rrd_session import markdown
from processor.runs import Run
from recorder.errors import PomologError
from recorder.records import SIDES, Side
from viewer.changes import Change, changes
from viewer.chunks import (
    FRAME,
    chunks_of,
    drawn,
    entity_of,
    rows_by_frame,
    write_recording,
)
from viewer.worst import Rings, rings_of

# what a method draws; all else is the session's own, the same for every method
OF_METHOD: Final = frozenset(
    f"world/{side}/{what}"
    for side in SIDES
    for what in ("mask", "cleaned", "contours", "tried", "fruit", "numbers", "reference_line")
) | {
    "world/apples", "range/errors", "range/intervals", "range/readings", "range/table", "verdict",
    "false", "error_mm", "count", "time_ms", "match/lines", "match/circles", "match/table",
    "health/row_px", "method",
}  # fmt: skip
LEFT_OUT: Final = ("index", "match/projection", "match/correlation", "about")
_ELLIPSES: Final = ("Ellipses2D:labels", "Ellipses2D:centers", "Ellipses2D:half_sizes")


@dataclass(frozen=True, slots=True)
class Method:
    """One method's results on the session."""

    name: str  # as its entities have it
    folder: Path


def methods_of(runs: Sequence[Run]) -> tuple[Method, ...]:
    """The methods to lay side by side, under names that differ.

    Raises:
        PomologError: the runs are of different sessions.
    """
    first = runs[0].about["session"]
    for run in runs[1:]:
        other = run.about["session"]
        if other["fingerprint"] != first["fingerprint"]:
            raise PomologError(
                f"{runs[0].folder} is of session {first['name']}, {run.folder} of another "
                f"({other['name']}); side by side stand results of one session"
            )
    names = [_plain(run.about["method"]) for run in runs]
    if len(set(names)) < len(names):
        names = [f"{name}-{place}" for place, name in enumerate(names, 1)]
    return tuple(Method(name, run.folder) for name, run in zip(names, runs, strict=True))


def _plain(name: str) -> str:
    plain = "".join(c if c.isalnum() else "-" for c in Path(name).stem)
    return plain.strip("-") or "method"


def sibling(entity: str, method: str) -> str:
    """Where an entity of a method stands: beside the other methods', below what they share."""
    parent, _, name = entity.rpartition("/")
    return f"{parent}/{method}/{name}" if parent else f"{entity}/{method}"


def write_side_by_side(out: Path, methods: Sequence[Method]) -> None:
    """Write the recording of all methods; changes are from the first to each other.

    Raises:
        PomologError: a recording is missing or damaged.
    """
    names = "-".join(method.name for method in methods)
    write_recording(out, _chunks(methods), f"{methods[0].folder.name}-{names}")


def _chunks(methods: Sequence[Method]) -> Iterator[Chunk]:
    rings: dict[tuple[str, Side], dict[int, Rings]] = {}
    for place, method in enumerate(methods):
        for chunk in chunks_of(method.folder / "trace.rrd"):
            entity = entity_of(chunk)
            for side in SIDES:
                if entity == f"world/{side}/fruit" and not chunk.is_static:
                    found = rings.setdefault((method.name, side), {})
                    for frame, row in rows_by_frame(chunk, _ELLIPSES).items():
                        found[frame] = rings_of(*row)
            if entity in OF_METHOD:
                yield chunk.with_entity_path(f"/{sibling(entity, method.name)}")
            elif place == 0 and not any(entity.startswith(left) for left in LEFT_OUT):
                yield chunk
    yield drawn("about", markdown(_summary(methods)), None, FRAME)
    frames = read_table(methods[0].folder, "frames")["frame"].to_pylist()
    for other in methods[1:]:
        found_changes = changes(methods[0].folder, other.folder)
        by_frame = {frame: [c for c in found_changes if c.frame == frame] for frame in frames}
        for frame, listed in by_frame.items():
            table = markdown(_change_table(methods[0].name, other.name, listed))
            yield drawn(f"changes/{other.name}/table", table, frame, FRAME)
            counts = [sum(c.kind == kind for c in listed) for kind in CHANGES]
            yield drawn(f"changes/{other.name}/count", rr.Scalars(counts), frame, FRAME)
            for side in SIDES:
                sources = [
                    rings.get((m.name, side), {}).get(frame, {}) for m in (methods[0], other)
                ]
                marks = _marks(listed, sources[0], sources[1])
                yield drawn(f"world/{side}/changes/{other.name}", marks, frame, FRAME)
        style = rr.SeriesLines(names=list(CHANGES), colors=list(CHANGES.values()))
        yield drawn(f"changes/{other.name}/count", style, None, FRAME)


def _marks(listed: Sequence[Change], before: Mapping[str, Any], after: Mapping[str, Any]) -> Any:
    shown = []
    for change in listed:
        source, number = (before, change.before) if change.after is None else (after, change.after)
        if str(number) in source:
            shown.append((source[str(number)], change))
    return rr.Ellipses2D(
        centers=[ring[:2] for ring, _ in shown],
        half_sizes=[(ring[2] * 1.2,) * 2 for ring, _ in shown],
        colors=[CHANGES[change.kind] for _, change in shown],
        labels=[f"{change.kind}: {change.what}" for _, change in shown],
        show_labels=False,
        line_radii=[-1.0 if change.mistake else -2.5 for _, change in shown],
    )


def _change_table(before: str, after: str, listed: Sequence[Change]) -> str:
    lines = [f"**From {before} to {after}**: {_sums(listed)}", ""]
    lines += [f"| what | {before} | {after} | which |", "|---|--:|--:|---|"]
    for change in sorted(listed, key=lambda c: list(CHANGES).index(c.kind)):
        was = "" if change.before is None else str(change.before)
        now = "" if change.after is None else str(change.after)
        lines.append(f"| {change.kind} | {was} | {now} | {change.what} |")
    return "\n".join(lines)


def _summary(methods: Sequence[Method]) -> str:
    lines = [f"**{methods[0].folder.name}**: {' and '.join(m.name for m in methods)}", ""]
    for other in methods[1:]:
        listed = changes(methods[0].folder, other.folder)
        lines.append(f"From {methods[0].name} to {other.name}: {_sums(listed)}.  ")
        for kind in CHANGES:
            of_kind = [c for c in listed if c.kind == kind]
            true = sum(c.apple_id is not None for c in of_kind)
            lines.append(f"- {len(of_kind)} {kind}, {true} of them true apples")
    return "\n".join(lines)


def _sums(listed: Sequence[Change]) -> str:
    return ", ".join(f"{sum(c.kind == kind for c in listed)} {kind}" for kind in CHANGES)
