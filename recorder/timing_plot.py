"""A picture of when the frames came: intervals, and gaps between the views."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from recorder.errors import PomologError
from recorder.files import replacing
from recorder.timing import GAP_FACTOR, Timing, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ENDINGS: Final = (".png", ".svg", ".pdf")
COLOURS: Final = {"left": "#0072B2", "right": "#D55E00"}  # as everywhere
_GOOD, _BAD, _SOFT = "#009E73", "#D53228", "#6e6e6e"
_STYLE: Final[Any] = {
    "font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.color": "#e3e3e3", "axes.axisbelow": True, "svg.hashsalt": "pomolog",
}  # fmt: skip


def draw_timing(timing: Timing, verdict: Verdict | None, out: Path, title: str) -> None:
    """Write the picture; its name's ending says how.

    Raises:
        PomologError: another ending than .png, .svg or .pdf, or it cannot be written.
    """
    if out.suffix.lower() not in ENDINGS:
        raise PomologError(f"--plot {out}: give a name that ends in {', '.join(ENDINGS)}")
    import matplotlib as mpl  # 0.3 s to import
    from matplotlib.figure import Figure

    both = verdict is not None
    with mpl.rc_context(_STYLE):
        sheet = Figure(figsize=(9, 5.6 if both else 3.2), layout="constrained", dpi=120)
        axes = sheet.subplots(2 if both else 1, 1, sharex=True, squeeze=False)[:, 0]
        start_ns = min((int(t[0]) for t in timing.times_ns.values() if len(t)), default=0)
        _intervals(axes[0], timing, start_ns)
        if verdict is not None:
            _gaps(axes[1], timing, start_ns)
        axes[-1].set_xlabel("time in the session, s")
        sheet.suptitle(title, x=0.01, ha="left", fontweight="bold")
        if verdict is not None:
            colour = _GOOD if verdict.sound else _BAD
            axes[1].set_title(_wrapped(verdict.text), loc="left", color=colour, fontsize=9)
        with replacing(out) as part:
            sheet.savefig(part, format=out.suffix.lower().lstrip("."), metadata=_metadata(out))


def _metadata(out: Path) -> dict[str, Any] | None:
    """The same picture whenever it is drawn."""
    dated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    return dated.get(out.suffix.lower())


def _wrapped(text: str, width: int = 110) -> str:
    lines, line = [], ""
    for word in text.split():
        if len(line) + len(word) > width:
            lines.append(line)
            line = ""
        line = f"{line} {word}".strip()
    return "\n".join([*lines, line])


def _intervals(axes: "Axes", timing: Timing, start_ns: int) -> None:
    """Each view's intervals, and those that lost a frame ringed."""
    for side, times in timing.times_ns.items():
        intervals = timing.intervals_ms(side)
        if len(intervals) == 0:
            continue
        at_s = (times[1:] - start_ns) / 1e9
        usual = float(np.median(intervals))
        axes.plot(
            at_s, intervals, ".-", markersize=4, linewidth=0.6, color=COLOURS[side],
            label=f"{side}, usually {usual:.1f} ms",
        )  # fmt: skip
        lost = intervals > GAP_FACTOR * usual
        if lost.any():
            axes.plot(
                at_s[lost], intervals[lost], "o", markersize=9, markerfacecolor="none",
                color=_BAD, label=f"{side}: {int(lost.sum())} gaps",
            )  # fmt: skip
    axes.set_ylabel("from frame to frame, ms")
    axes.set_ylim(bottom=0)
    axes.set_title("intervals", loc="left", fontsize=9)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, frameon=False, ncols=4,
            borderaxespad=0,
        )  # fmt: skip


def _gaps(axes: "Axes", timing: Timing, start_ns: int) -> None:
    """Right minus left of frames nearest to each other, and what still is a pair."""
    at_s = (timing.near_ns[:, 0] - start_ns) / 1e9
    limit = timing.limit_ms
    axes.axhspan(-limit, limit, color=_GOOD, alpha=0.1, linewidth=0, label=f"pairs: {limit:g} ms")
    for chosen, colour, words in (
        (timing.paired, COLOURS["left"], "paired"),
        (~timing.paired, _BAD, "too far apart"),
    ):
        if chosen.any():
            axes.plot(
                at_s[chosen], timing.gaps_ms[chosen], ".", markersize=5, color=colour,
                label=f"{int(chosen.sum())} {words}",
            )  # fmt: skip
    axes.axhline(0, color=_SOFT, linewidth=0.8)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.22 * (high - low))  # room for the legend
    axes.set_ylabel("right minus left, ms")
    axes.legend(loc="upper right", fontsize=8, framealpha=0.9, ncols=3)
