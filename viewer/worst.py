"""A recording of the worst cases alone: a step a case, its place in both views, a list of all."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from processor.palette import ESTIMATE, KINDS, TRUTH
from processor.rrd_session import markdown
from processor.worst import WorstCase
from recorder.errors import PomologError
from recorder.records import SIDES, Side
from viewer.chunks import at_step, chunks_of, drawn, entity_of, stepped, values, write_recording

TIMELINE: Final = "worst"
CROP_RADII: Final = 4.0  # seen around a case, in its radii
CROP_PX: Final = 480  # of a crop's side
# of each session its own, where several are shown
OWN_OF_SESSION: Final = ("world", "about", "health/ledger")
RINGS: Final = {"truth": TRUTH, "fruit": ESTIMATE}

Circle = tuple[float, float, float]
Rings = dict[str, Circle]  # by what stands on a ring: "true 7", or a located apple's number


@dataclass(slots=True)
class Scene:
    """What is drawn of one step, as it passes: each view's picture and rings."""

    pictures: dict[Side, bytes] = field(default_factory=dict)
    rings: dict[tuple[Side, str], Rings] = field(default_factory=dict)


def write_worst(out: Path, cases: Sequence[WorstCase]) -> None:
    """Write the recording of these cases, step 1 the worst.

    Args:
        out: the .rrd to write.
        cases: of runs that have recordings.

    Raises:
        PomologError: a run has no recording, or it is damaged.
    """
    if not cases:
        raise PomologError("nothing is wrong anywhere in these results; open them without --worst")
    write_recording(out, _chunks(cases), "worst")


def case_list(cases: Sequence[WorstCase]) -> str:
    """All cases as a markdown table, and how to open the whole recording at one."""
    several = len({case.folder for case in cases}) > 1
    lines = ["**The worst cases**, a step of the timeline `worst` each", ""]
    lines += ["| step | session, frame | what | how much | why |", "|--:|---|---|---|---|"]
    for step, case in enumerate(cases, 1):
        what = f"{case.kind}: {_named(case)}"
        where = f"{case.folder if several else case.session}, {case.frame}"
        lines.append(f"| {step} | {where} | {what} | {case.how_much} | {case.why} |")
    first = cases[0]
    lines += ["", "With the frames before and after:", ""]
    lines.append(f"`pomolog view {first.folder} --frame {first.frame}`")
    return "\n".join(lines)


def case_text(step: int, case: WorstCase) -> str:
    """One case in markdown."""
    words = (
        f"**{step}. {case.kind}: {_named(case)}**",
        f"{case.how_much}. {case.why[0].upper()}{case.why[1:]}.",
        f"Session {case.session}, frame {case.frame}. Severity {case.severity:.2f} of 1.",
        f"`pomolog view {case.folder} --frame {case.frame}`",
    )
    return "\n\n".join(words)


def _named(case: WorstCase) -> str:
    parts = [] if case.apple is None else [f"located apple {case.apple}"]
    parts += [] if case.apple_id is None else [f"true apple {case.apple_id}"]
    return ", ".join(parts)


def _chunks(cases: Sequence[WorstCase]) -> Iterator[Chunk]:
    yield drawn("worst/list", markdown(case_list(cases)), None, TIMELINE)
    scenes = {step: Scene() for step in range(1, len(cases) + 1)}
    folders = list(dict.fromkeys(case.folder for case in cases))
    for folder in folders:
        steps: dict[int, list[int]] = {}
        for step, case in enumerate(cases, 1):
            if case.folder == folder:
                steps.setdefault(case.frame, []).append(step)
        yield from _of_run(
            folder, steps, scenes, alone=len(folders) == 1, first=folder == folders[0]
        )
    for step, case in enumerate(cases, 1):
        yield drawn("worst/case", markdown(case_text(step, case)), step, TIMELINE)
        for side in SIDES:
            yield from _close_up(step, side, case, scenes[step])


def _of_run(
    folder: Path, steps: dict[int, list[int]], scenes: dict[int, Scene], *, alone: bool, first: bool
) -> Iterator[Chunk]:
    for chunk in chunks_of(folder / "trace.rrd"):
        entity = entity_of(chunk)
        own = any(entity == name or entity.startswith(f"{name}/") for name in OWN_OF_SESSION)
        if chunk.is_static and not alone and own:
            for step in (step for places in steps.values() for step in places):
                yield at_step(chunk.to_record_batch(), chunk.entity_path, step, TIMELINE)
        elif chunk.is_static:
            if first:
                yield chunk
        else:
            for _, step, row in stepped(chunk, steps, TIMELINE):
                _gather(scenes[step], entity, row)
                yield row


def _gather(scene: Scene, entity: str, row: Chunk) -> None:
    for side in SIDES:
        if entity == f"world/{side}/picture":
            scene.pictures[side] = bytes(values(row, "EncodedImage:blob")[0])
        for what in RINGS:
            if entity == f"world/{side}/{what}":
                scene.rings[side, what] = rings_of(
                    values(row, "Ellipses2D:labels"),
                    values(row, "Ellipses2D:centers"),
                    values(row, "Ellipses2D:half_sizes"),
                )


def rings_of(labels: Sequence[str], centres: Sequence[Any], halves: Sequence[Any]) -> Rings:
    """Drawn rings by their names: "true 7" of truth, "3" of a located apple "3: 1.234 m"."""
    return {
        label.partition(":")[0]: (centre[0], centre[1], half[0])
        for label, centre, half in zip(labels, centres, halves, strict=True)
        if label
    }


def _close_up(step: int, side: Side, case: WorstCase, scene: Scene) -> Iterator[Chunk]:
    """What is around a case in one view; nothing where the view does not have it."""
    root = f"worst/{side}"
    ring = scene.rings.get((side, "fruit"), {}).get(str(case.apple))
    ring = ring or scene.rings.get((side, "truth"), {}).get(f"true {case.apple_id}")
    mark = rr.Ellipses2D(
        centers=[] if ring is None else [ring[:2]],
        half_sizes=[] if ring is None else [(ring[2] * 1.25,) * 2],
        colors=KINDS[case.kind], line_radii=-2.5, labels=case.how_much, show_labels=False,
    )  # fmt: skip
    yield drawn(f"world/{side}/worst", mark, step, TIMELINE)
    if ring is None or side not in scene.pictures:
        blank = np.full((CROP_PX, CROP_PX, 3), 128, np.uint8)  # of one size: it is a video
        yield drawn(f"{root}/picture", _jpeg(blank), step, TIMELINE)
        for what in RINGS:
            nothing = rr.Ellipses2D(centers=[], half_sizes=[])
            yield drawn(f"{root}/{what}", nothing, step, TIMELINE)
        return
    crop, scale, corner = _crop(scene.pictures[side], ring)
    yield drawn(f"{root}/picture", _jpeg(crop), step, TIMELINE)
    for what, colour in RINGS.items():
        near = [
            ((x - corner[0]) * scale, (y - corner[1]) * scale, r * scale)
            for x, y, r in scene.rings.get((side, what), {}).values()
            if max(abs(x - ring[0]), abs(y - ring[1])) < CROP_RADII * ring[2]
        ]
        shown = rr.Ellipses2D(
            centers=[(x, y) for x, y, _ in near], half_sizes=[(r, r) for *_, r in near],
            colors=colour, line_radii=-1.5,
        )  # fmt: skip
        yield drawn(f"{root}/{what}", shown, step, TIMELINE)


def _crop(encoded: bytes, ring: Circle) -> tuple[Any, float, tuple[float, float]]:
    """The picture around a ring, how much it is enlarged, and its corner in the picture."""
    picture = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    x, y, radius = ring
    side_px = 2 * CROP_RADII * radius
    scale, corner = CROP_PX / side_px, (x - side_px / 2, y - side_px / 2)
    turn = np.array([[scale, 0, -corner[0] * scale], [0, scale, -corner[1] * scale]])
    crop = cv2.warpAffine(picture, turn, (CROP_PX, CROP_PX), borderValue=(128, 128, 128))
    return crop, scale, corner


def _jpeg(picture: Any) -> Any:
    _, data = cv2.imencode(".jpg", picture)
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg")
