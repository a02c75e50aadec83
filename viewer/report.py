"""The report: a run, or several side by side, as one page that needs nothing else."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

from processor.methods import METHODS, describe, locator_from, to_toml
from processor.page_parts import Head, document, folded, grid
from processor.runs import Run
from processor.slices import Tick
from processor.worst import WorstCase
from recorder.errors import PomologError
from viewer.report_cases import as_json, cases_shown, worst_of
from viewer.report_columns import Column
from viewer.report_plots import (
    calibration_of_confidence,
    calibration_of_intervals,
    errors_against_range,
    found_by_visibility,
    precision_against_recall,
    stage_times,
)
from viewer.report_scores import at_a_glance, by_condition, by_range, by_visibility
from viewer.report_sessions import distinct, exposure, ledger, lights, sessions_table
from viewer.report_style import STYLE


@dataclass(frozen=True, slots=True)
class Report:
    """A page, and what it says as data.

    Attributes:
        html: the whole page.
        told: its columns with their scores, and its worst cases, ready for JSON.
    """

    html: str
    told: dict[str, Any]


def steps(columns: Sequence[Column], worst: int) -> int:
    """How often `make_report` ticks."""
    return len(_sessions(columns)) + worst * len(columns)


def make_report(
    columns: Sequence[Column],
    outs: Sequence[Path],
    *,
    worst: int = 10,
    moved: Sequence[Path] = (),
    tick: Tick = lambda _: None,
) -> Report:
    """Tell columns of results as one page.

    Args:
        columns: what to tell, side by side.
        outs: the folders that they were read from, as they were named.
        worst: how many worst cases of each column to show.
        moved: files or folders where sessions may lie now.
        tick: called with the number of steps that are done.

    Raises:
        PomologError: results are damaged.
    """
    cases = {column.label: worst_of(column, worst) for column in columns}
    sessions = _sessions(columns)
    body = [
        *_head(columns, sessions),
        *_what(columns, sessions),
        *_scores(columns),
        *_plots(columns),
        *_recording(sessions, moved, tick),
        *_worst(columns, cases, moved, tick),
        *_repeat(columns, outs),
    ]
    told = {
        "columns": [
            {
                "label": column.label,
                "method": column.about["method"],
                "seed": column.about["seed"],
                "sessions": [run.about["session"]["name"] for run in column.runs],
                "groups": {name: asdict(score) for name, score in column.groups.items()},
                "worst": [as_json(case) for case in cases[column.label] or ()],
            }
            for column in columns
        ]
    }
    return Report(document(_title(columns), body, style=STYLE), told)


def _sessions(columns: Sequence[Column]) -> tuple[Run, ...]:
    return distinct([run for column in columns for run in column.runs])


def _title(columns: Sequence[Column]) -> str:
    return f"What {_and([c.label for c in columns])} found"


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _many(count: int, what: str) -> str:
    return f"{count} {what}s" if count != 1 else f"one {what}"


def _head(columns: Sequence[Column], sessions: Sequence[Run]) -> Iterator[str]:
    yield f"<h1>{escape(_title(columns))}</h1>"
    pairs = sum(run.about["session"]["pairs"] for run in sessions)
    names = _and([run.about["session"]["name"] for run in sessions[:3]])
    more = f" and {len(sessions) - 3} more" if len(sessions) > 3 else ""
    names = names.replace(" and ", ", ") if more else names
    yield (
        f'<p class="lead">{_many(pairs, "stereo pair")} of {_many(len(sessions), "session")} '
        f"({escape(names)}{more}), pomolog {escape(columns[0].about['versions']['pomolog'])}.</p>"
    )
    for column in columns:
        yield f'<p class="summary">{_summary(column)}</p>'
    yield "<nav>"
    for name, title in _SECTIONS.items():
        yield f'<a href="#{name}">{title}</a>'
    yield "</nav>"
    yield '<section><h2 id="glance">At a glance</h2>'
    yield at_a_glance(columns)
    yield "</section>"


_SECTIONS: Final = {
    "glance": "At a glance",
    "what": "What was run, on what",
    "score": "Score by lighting, range and visibility",
    "plots": "Plots",
    "recording": "The recorder’s ledger, and exposure",
    "worst": "Worst cases",
    "repeat": "How to repeat it",
}


def _summary(column: Column) -> str:
    """The column in one sentence."""
    score = column.score
    label = f"<b>{escape(column.label)}</b>"
    if score.fruit is None and score.pixels is None:
        found = int(column.frames["left_fruit"].sum() + column.frames["right_fruit"].sum())
        located = int(column.frames["matched"].sum())
        return (
            f"{label} found {found} fruit in single views and located {located}. "
            "<b>Not scored</b>: no session has truth; <code>pomolog label</code> gives it."
        )
    parts = []
    if score.matches is not None:
        m = score.matches
        parts.append(
            f"matched {m.right} of {m.right + m.wrong + m.missed} apples that are at least half "
            f"visible in both views rightly, {m.wrong} wrongly"
        )
    if score.distance_m is not None:
        e = score.distance_m
        parts.append(
            f"gave {e.n} distances with an RMSE of {1000 * e.rmse:.1f} mm "
            f"(largest {1000 * e.max:.0f} mm)"
        )
    if not parts and score.pixels is not None and score.pixels.recall is not None:
        parts.append(f"recognised {100 * score.pixels.recall:.1f} % of the fruit’s pixels")
    return f"{label} {_and(parts)}." if parts else f"{label}: nothing of it could be scored."


def _what(columns: Sequence[Column], sessions: Sequence[Run]) -> Iterator[str]:
    yield f'<section><h2 id="what">{_SECTIONS["what"]}</h2>'
    heads = [Head(h) for h in ("method", "stages", "models", "seed", "drawn", "results")]
    rows = [
        [
            f"<b>{escape(c.label)}</b>",
            escape(", ".join(str(stage["use"]) for stage in c.about["locator"].values())),
            escape(", ".join(f"{n} ({d})" for n, d in c.about["models"].items())) or "none",
            str(c.about["seed"]),
            "yes" if c.about["rrd"] == "full" else "no",
            f"<code>{escape(str(c.runs[0].folder.parent))}</code>",
        ]
        for c in columns
    ]
    yield grid(heads, rows, caption="The methods: recognise, clean, circles, match, triangulate.")
    yield sessions_table(sessions)
    versions = {
        tuple(sorted(run.about["versions"].items())) for column in columns for run in column.runs
    }
    for told in sorted(versions):
        yield (
            '<p class="material"><b>Versions.</b> '
            + escape(", ".join(f"{name} {value}" for name, value in told))
            + ".</p>"
        )
    for column in columns:
        yield folded(
            f"Every parameter of {escape(column.label)}", f"<pre>{escape(_toml(column))}</pre>"
        )
    yield "</section>"


def _toml(column: Column) -> str:
    """The method as a file that `--method` takes."""
    try:
        return to_toml(column.about["method"], locator_from(column.about["locator"]))
    except PomologError as error:
        return f"# cannot be built here: {error}"


def _scores(columns: Sequence[Column]) -> Iterator[str]:
    yield f'<section><h2 id="score">{_SECTIONS["score"]}</h2>'
    if all(column.score.fruit is None for column in columns):
        yield (
            '<p class="notrun"><b>Not scored:</b> no session of these runs says where its apples '
            "are. Give one truth with <code>pomolog label S.mcap --masks DIR -o T.mcap</code> and "
            "replay that.</p></section>"
        )
        return
    if any(column.by for column in columns):
        yield by_condition(columns)
    else:
        yield '<p class="notrun"><b>By lighting:</b> no session says its lighting.</p>'
    yield by_range(columns)
    yield by_visibility(columns)
    yield "</section>"


def _plots(columns: Sequence[Column]) -> Iterator[str]:
    yield f'<section class="plots"><h2 id="plots">{_SECTIONS["plots"]}</h2>'
    if any(column.score.fruit is not None for column in columns):
        yield errors_against_range(columns)
        yield f'<div class="pair-of-plots"><div>{precision_against_recall(columns)}</div>'
        yield f"<div>{calibration_of_confidence(columns)}</div>"
        yield f"<div>{calibration_of_intervals(columns)}</div>"
        yield f"<div>{found_by_visibility(columns)}</div></div>"
    yield stage_times(columns)
    yield "</section>"


def _recording(sessions: Sequence[Run], moved: Sequence[Path], tick: Tick) -> Iterator[str]:
    yield f'<section><h2 id="recording">{_SECTIONS["recording"]}</h2>'
    yield from ledger(sessions)
    found, problems = lights(sessions, moved, tick)
    if found:
        yield exposure(found)
    for problem in problems:
        yield f'<p class="notrun"><b>Exposure not shown:</b> {escape(problem)}</p>'
    yield "</section>"


def _worst(
    columns: Sequence[Column],
    cases: Mapping[str, tuple[WorstCase, ...] | None],
    moved: Sequence[Path],
    tick: Tick,
) -> Iterator[str]:
    yield f'<section><h2 id="worst">{_SECTIONS["worst"]}</h2>'
    yield from cases_shown(columns, cases, moved, tick)
    yield "</section>"


def _repeat(columns: Sequence[Column], outs: Sequence[Path]) -> Iterator[str]:
    yield f'<section><h2 id="repeat">{_SECTIONS["repeat"]}</h2>'
    yield (
        "<p>Sessions, method and seed decide everything but the times. With the sessions above "
        "(the same fingerprints) and the versions above:</p>"
    )
    lines = []
    for column in columns:
        files = " ".join(shlex.quote(run.about["session"]["file"]) for run in column.runs)
        method = column.about["method"]
        if not _is_named(column):
            lines.append(f"# {method}.toml: save what stands under “Every parameter” above")
            method = f"{method}.toml"
        out = shlex.quote(str(column.runs[0].folder.parent))
        lines.append(
            f"pomolog replay {files} -o {out} --method {shlex.quote(method)} "
            f"--seed {column.about['seed']}"
        )
    names = " ".join(shlex.quote(str(out)) for out in outs)
    lines += [f"pomolog score {names}", f"pomolog report {names} -o report.html"]
    yield f"<pre>{escape(chr(10).join(lines))}</pre></section>"


def _is_named(column: Column) -> bool:
    """Whether this pomolog has that very method under its name."""
    known = METHODS.get(column.about["method"])
    return known is not None and _as_json(describe(known)) == column.about["locator"]


def _as_json(value: Any) -> Any:
    """As it would be read back: tuples are lists."""
    if isinstance(value, dict):
        return {key: _as_json(entry) for key, entry in value.items()}
    return [_as_json(entry) for entry in value] if isinstance(value, tuple) else value
