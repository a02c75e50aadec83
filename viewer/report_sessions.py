"""The report's sessions: what they are, how they were exposed, what their recorders lost."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from processor import charts
from processor.charts import SOFT, drawing_for_page
from processor.page_parts import Head, drawing_figure, folded, grid, shown
from processor.results import read_table
from processor.retrace import session_of
from processor.runs import LOSSES, Run
from processor.slices import Tick
from recorder.cameras import Shot
from recorder.errors import PomologError
from recorder.exposure import OVER_SHARE, UNDER_SHARE, look_at
from recorder.records import SIDES, Frame
from recorder.rig import Floats
from recorder.session import Session

LOOKED_AT: Final = 240  # pairs whose exposure is measured, over all sessions
LEAST_LOOKED_AT: Final = 4  # of each session
LONG: Final = 15  # rows of a table that is folded on the screen
_EPOCH_2000_NS: Final = 946_684_800 * 10**9  # clocks before it were never set
_SAID: Final = ("lighting", "cultivar", "site", "split", "occlusion", "made_by", "equipment")


def distinct(runs: Sequence[Run]) -> tuple[Run, ...]:
    """A run of each session: several methods may have run on one."""
    found: dict[str, Run] = {}
    for run in runs:
        found.setdefault(run.about["session"]["fingerprint"], run)
    return tuple(found.values())


def sessions_table(runs: Sequence[Run]) -> str:
    """What each session says of itself."""
    told = [run.about["session"] for run in runs]
    keys = [key for key in _SAID if any(key in session["metadata"] for session in told)]
    rows = []
    for run, session in zip(runs, told, strict=True):
        frames = read_table(run.folder, "frames")
        skews = np.abs(frames["skew_ns"].to_numpy()) / 1e6
        rows.append([
            escape(session["file"]),
            str(session["pairs"]),
            *(escape(session["metadata"].get(key, "–")) for key in keys),
            _when(frames["time_ns"][0].as_py()),
            shown(float(skews.max()), 2),
            f"<code>{escape(session['fingerprint'])}</code>",
        ])  # fmt: skip
    heads = [
        Head("session"), Head("pairs", "n"), *(Head(escape(key.replace("_", " "))) for key in keys),
        Head("begins (UTC)"), Head("largest skew ms", "n"), Head("fingerprint"),
    ]  # fmt: skip
    caption = (
        "The sessions, as they say it themselves; a condition that changes within a session is in "
        "the score by that condition. The skew is between the two cameras."
    )
    return _long(heads, rows, caption)


def _when(time_ns: int) -> str:
    if time_ns < _EPOCH_2000_NS:
        return "not said"
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M}"


def _long(heads: Sequence[Head], rows: Sequence[Sequence[str]], caption: str) -> str:
    if len(rows) <= LONG:
        return grid(heads, rows, caption=caption)
    return folded(f"{caption} ({len(rows)} rows)", grid(heads, rows))


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """How the pictures of one session are exposed.

    Attributes:
        name: of the session.
        pairs: how many it has.
        at: (N,) the pairs that were looked at.
        over: (N,) their share of blown-out pixels, the worse of the views.
        under: (N,) their share of black pixels.
        source: who looked: the recorder, each second, or the report, at some of the pictures.
    """

    name: str
    pairs: int
    at: npt.NDArray[np.int64]
    over: Floats
    under: Floats
    source: str


def lights(
    runs: Sequence[Run], moved: Sequence[Path], tick: Tick = lambda _: None
) -> tuple[list[Light], list[str]]:
    """The exposure of each session, and for those that cannot be opened, why."""
    found, problems = [], []
    for run in runs:
        try:
            with Session(session_of(run, moved)) as session:
                found.append(_light(session, max(LEAST_LOOKED_AT, LOOKED_AT // len(runs))))
        except PomologError as error:
            problems.append(str(error))
        tick(1)
    return found, problems


def _light(session: Session, most: int) -> Light:
    times = session.pair_times_ns()[:, 0]
    said = [
        (status.time_ns, [status.stream(side) for side in SIDES]) for status in session.statuses()
    ]
    known = [
        (time_ns, [(s.overexposed, s.underexposed) for s in streams])
        for time_ns, streams in said
        if all(s.overexposed is not None and s.underexposed is not None for s in streams)
    ]
    if known:
        at = np.clip(np.searchsorted(times, [t for t, _ in known]), 0, len(times) - 1)
        shares = np.array([views for _, views in known], float).max(axis=1)
        source = "the recorder, each second"
    else:
        at = np.unique(np.linspace(0, len(times) - 1, min(most, len(times))).astype(np.int64))
        shares = np.array([_looked(session, int(index)) for index in at])
        every = len(at) == len(times)
        source = "all of its pictures" if every else f"{len(at)} of its pairs, evenly"
    return Light(session.name, len(times), at, shares[:, 0], shares[:, 1], source)


def _looked(session: Session, index: int) -> tuple[float, float]:
    """Blown-out and black shares of one pair, the worse of its views."""
    (pair,) = session.pairs(index, index + 1)
    found = [look_at(_shot(frame)) for frame in (pair.left, pair.right)]
    return max(e.overexposed for e in found), max(e.underexposed for e in found)


def _shot(frame: Frame) -> Shot:
    return Shot(None, None, 0, 0, frame.encoding, frame.size_px, frame.data)


def exposure(found: Sequence[Light]) -> str:
    """Blown-out and black pixels over all sessions, one after another."""
    starts = np.cumsum([0, *(light.pairs for light in found)])
    rows = []
    with drawing_for_page(7.6, 3.3) as (sheet, done):
        over, under = sheet.subplots(2, 1, sharex=True)
        for light, start in zip(found, starts, strict=False):
            for axes, shares, colour in (
                (over, light.over, charts.RED),
                (under, light.under, SOFT),
            ):
                axes.plot(start + light.at, 100 * shares, color=colour, marker=".", ms=3, lw=1)
            rows.append([
                escape(light.name), light.source, *_spread(light.over, OVER_SHARE),
                *_spread(light.under, UNDER_SHARE),
            ])  # fmt: skip
        for axes, share, name in (
            (over, OVER_SHARE, "blown out %"), (under, UNDER_SHARE, "black %"),
        ):  # fmt: skip
            axes.axhline(100 * share, color=SOFT, lw=0.8, ls="--")
            axes.set_ylabel(name)
            axes.set_ylim(bottom=0)
            for start in starts[1:-1]:
                axes.axvline(start - 0.5, color=charts.LINE, lw=0.8)
        under.xaxis.get_major_locator().set_params(integer=True)
        under.set_xlabel("pair, sessions one after another")
    caption = (
        f"Exposure: pixels at or above 250 (above) and at or below 5 (below), the worse of both "
        f"views; dashed, where the recorder warns ({100 * OVER_SHARE:g} % and "
        f"{100 * UNDER_SHARE:g} %)."
    )
    heads = [Head("session"), Head("looked at"), *(Head(h, "n") for h in (
        "blown out: median %", "most %", "too many", "black: median %", "most %", "too many",
    ))]  # fmt: skip
    table = _long(heads, rows, "Exposure by session; “too many” counts those beyond the warning.")
    return drawing_figure(done[0], "exposure", caption) + table


def _spread(shares: Floats, limit: float) -> list[str]:
    beyond = int((shares > limit).sum())
    return [
        shown(float(100 * np.median(shares)), 2), shown(float(100 * shares.max()), 2),
        f"{beyond} of {len(shares)}",
    ]  # fmt: skip


def ledger(runs: Sequence[Run]) -> Iterator[str]:
    """What each recorder counted, stream by stream."""
    kept = [run for run in runs if run.about["session"].get("ledger")]
    if not kept:
        yield (
            '<p class="notrun"><b>The recorder’s ledger:</b> there is none; these sessions were '
            "not made by <code>pomolog record</code>.</p>"
        )
        return
    rows: list[list[str]] = []
    others: list[list[str]] = []
    for run in kept:
        name, entries = run.about["session"]["file"], run.about["session"]["ledger"]
        streams = dict.fromkeys(key.partition(".")[0] for key in entries if "." in key)
        for stream in streams:
            told = [entries.get(f"{stream}.{what}") for what in ("frames", *LOSSES, "faults")]
            silent = entries.get(f"{stream}.silent_ns")
            rows.append([
                escape(name), escape(stream), *("–" if t is None else _count(t) for t in told),
                "–" if silent is None else _seconds(silent),
            ])  # fmt: skip
        rest = {key: value for key, value in entries.items() if "." not in key}
        others.append([escape(name), escape(", ".join(f"{k}: {v}" for k, v in rest.items()))])
    heads = [Head("session"), Head("stream"), *(
        Head(h, "n") for h in ("kept", *LOSSES, "faults", "silent s")
    )]  # fmt: skip
    caption = (
        "The recorder’s ledger: frames or readings kept, and every one that was not, or not well. "
        "A dash: not counted of that stream."
    )
    yield _long(heads, rows, caption)
    yield _long([Head("session"), Head("besides", "words")], others, "What else the ledgers say.")
    if len(kept) < len(runs):
        yield f"<p>{len(runs) - len(kept)} of the sessions have no ledger.</p>"


def _count(value: Any) -> str:
    text = escape(str(value))
    return f"<b>{text}</b>" if text.isdecimal() and int(text) else text


def _seconds(nanoseconds: str) -> str:
    return shown(int(nanoseconds) / 1e9) if nanoseconds.isdecimal() else escape(nanoseconds)
