"""The report's worst cases: what is wrong, by how much, why, both views, how to see more."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any, Final

from processor.page_parts import picture_figure
from processor.runs import Run
from processor.slices import Tick
from processor.worst import WorstCase, worst_cases
from recorder.errors import PomologError
from viewer.report_columns import Column
from viewer.strips import Strip, strips

PICTURES_BYTES: Final = 3_000_000  # before they are coded as text: a mail takes a page of 5 MB


def as_json(case: WorstCase) -> dict[str, Any]:
    """A case, ready for JSON."""
    return {**asdict(case), "folder": str(case.folder)}


def worst_of(column: Column, count: int) -> tuple[WorstCase, ...] | None:
    """A column's worst cases; None where there is no truth to say what is worst."""
    try:
        return worst_cases([run.folder for run in column.runs], count)
    except PomologError:
        if column.score.fruit is not None:
            raise
        return None


def cases_shown(
    columns: Sequence[Column],
    cases: Mapping[str, tuple[WorstCase, ...] | None],
    moved: Sequence[Path],
    tick: Tick = lambda _: None,
) -> Iterator[str]:
    """Each column's worst cases, in words and pictures.

    Args:
        columns: that they are of.
        cases: by the column's label; None where nothing says what is worst.
        moved: where to look for sessions before where they lay.
        tick: called with the number of cases that are drawn.
    """
    yield (
        "<p>Both views of the place, as recorded: <span class='true'>blue is true</span>, "
        "<span class='found'>orange was found and located</span>, purple was found without a "
        "partner; the bold outlines are what the case is about. Kinds take turns, the worst of "
        "each first.</p>"
    )
    room = PICTURES_BYTES // len(columns)
    for column in columns:
        if len(columns) > 1:
            yield f"<h3>{escape(column.label)}</h3>"
        found = cases[column.label]
        if found is None:
            yield (
                '<p class="notrun"><b>Not scored:</b> no truth of single apples says which cases '
                "are worst.</p>"
            )
            continue
        if not found:
            yield "<p>Nothing was missed, false, wrongly matched or measured.</p>"
        drawn = strips(column.runs, found, moved, tick)
        for problem in dict.fromkeys(strip.problem for strip in drawn if strip.problem):
            yield f'<p class="notrun"><b>Pictures not shown:</b> {escape(problem)}</p>'
        yield '<div class="cases">'
        yield from _shown(drawn, column, room)
        yield "</div>"


def _shown(found: Sequence[Strip], column: Column, room: int) -> Iterator[str]:
    by_folder = {run.folder: run for run in column.runs}
    for strip in found:
        room -= len(strip.jpeg or b"")
        yield _case(strip, by_folder[strip.case.folder], with_picture=room > 0)


def _case(strip: Strip, run: Run, *, with_picture: bool) -> str:
    case = strip.case
    names = [f"apple {case.apple_id}"] if case.apple_id is not None else []
    names += [f"found {case.apple}"] if case.apple is not None else []
    what = f"{case.kind}: {', '.join(names)}" if names else case.kind
    folder = shlex.quote(str(case.folder))
    sheet = f"pomolog sheet {folder} --frame {case.frame} -o sheet.png"
    commands = [f"pomolog view {folder} --frame {case.frame}"] if _drawn(run) else []
    commands.append(sheet)
    picture = ""
    if strip.jpeg is not None and with_picture:
        caption = f"{case.session}, frame {case.frame}: left and right view."
        picture = picture_figure(strip.jpeg, caption, alt=strip.alt, kind="jpeg")
    elif strip.jpeg is not None:
        picture = "<p class='material'>No picture: the page would grow beyond 5 MB.</p>"
    return (
        f'<div class="case"><h4>{strip.place + 1}. {escape(what)}, {escape(case.how_much)}</h4>'
        f"<p>{escape(case.why)}; frame {case.frame} of {escape(case.session)}.</p>{picture}"
        f"<p>{'<br>'.join(f'<code>{escape(line)}</code>' for line in commands)}</p></div>"
    )


def _drawn(run: Run) -> bool:
    return (run.folder / "trace.rrd").is_file()
