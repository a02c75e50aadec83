"""The viewer's layout: a Rerun blueprint of our own, a tab for each question."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

import rerun.blueprint as rrb

from processor.rrd import APPLICATION
from recorder.files import replacing
from recorder.records import SIDES
from viewer.views import blueprint, curves, document, in_space, pictured

# Overview: what is there?  Recognise: which pixels, rightly?  Circles: which of the tried?
# Match: which is which?  Range: how far, how sure?  Health: can the recording be trusted?
TABS: Final = ("Overview", "Recognise", "Circles", "Match", "Range", "Health")
SESSION_TABS: Final = ("Overview", "Recorded", "Health")  # of a session without results

CHART: Final = rrb.VisualBounds2D(x_range=(150.0, 2050.0), y_range=(-680.0, 680.0))
WHOLE_RUN: Final = [
    rrb.VisibleTimeRange(
        timeline,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.infinite(),
    )
    for timeline in ("frame", "session_time", "capture", "worst")
]


def layout(
    *, tabs: tuple[str, ...] = TABS, active: str = "", timeline: str = "frame"
) -> rrb.Blueprint:
    """The tabs asked for.

    Args:
        tabs: some of TABS.
        active: the one in front; the first where empty.
        timeline: the one to step through.
    """
    return _of(tabs, active, timeline, results=True)


def session_layout(*, resampled: bool, active: str = "") -> rrb.Blueprint:
    """The tabs of a session without results.

    Args:
        resampled: its pictures are not shown as recorded, so that they get a tab of their own.
        active: the tab in front.
    """
    tabs = tuple(name for name in SESSION_TABS if resampled or name != "Recorded")
    return _of(tabs, active, "frame", results=False)


def _of(tabs: Sequence[str], active: str, timeline: str, *, results: bool) -> rrb.Blueprint:
    made = [MAKERS[name](results) for name in tabs]
    return blueprint(*made, active=tabs.index(active or tabs[0]), timeline=timeline)


def save_layout(path: Path, made: rrb.Blueprint | None = None) -> None:
    """Write a layout, the usual one where none is given, as a blueprint file (.rbl)."""
    (made or layout()).save(APPLICATION, path)


def lay_out(recordings: Iterable[Path]) -> None:
    """Put our layout beside each recording, so that Rerun alone opens it so too.

    Raises:
        PomologError: it cannot be written there.
    """
    for recording in recordings:
        with replacing(recording.with_suffix(".rbl")) as part:
            save_layout(part)


def _overview(results: bool) -> rrb.Container:
    layers = ("picture", "truth", "fruit", "numbers") if results else ("picture", "truth")
    title = ": orange located, purple alone, blue true" if results else ": truth in blue"
    pictures = rrb.Horizontal(*(pictured(s, f"{s.capitalize()}{title}", *layers) for s in SIDES))
    if not results:
        known = document("about", "Session"), document("legend", "Colours")
        below = rrb.Horizontal(in_space(results=False), *known, column_shares=[2, 1, 1])
        return rrb.Vertical(pictures, below, row_shares=[3, 2], name="Overview")
    fared = rrb.Vertical(
        curves("verdict", "How the true apples' matches fared"),
        curves("error_mm", "Errors of distance, mm"),
    )
    texts = rrb.Tabs(
        document("range/table", "Apples of this frame"),
        document("about", "Session"),
        document("method", "Method"),
        document("legend", "Colours"),
    )
    below = rrb.Horizontal(in_space(), fared, texts)
    return rrb.Vertical(pictures, below, row_shares=[3, 2], name="Overview")


def _recorded(_results: bool) -> rrb.Container:
    """The pictures as they left a camera whose lens bends them."""
    return rrb.Horizontal(
        *(
            rrb.Spatial2DView(origin=f"recorded/{side}", name=f"{side.capitalize()}, as recorded")
            for side in SIDES
        ),
        name="Recorded",
    )


def _recognise(_results: bool) -> rrb.Container:
    views = []
    for side in SIDES:
        name = side.capitalize()
        views += [
            pictured(side, f"{name}: truth in blue", "picture", "truth"),
            rrb.Spatial2DView(origin=f"index/{side}", name=f"{name}: colour index"),
            pictured(side, f"{name}: green hit, red false, blue missed", "picture", "mask"),
            pictured(side, f"{name}: the same, cleaned", "picture", "cleaned"),
        ]
    return rrb.Grid(*views, grid_columns=4, name="Recognise")


def _circles(_results: bool) -> rrb.Container:
    title = "grey tried, orange or purple chosen, blue true"
    return rrb.Horizontal(
        *(
            pictured(
                side, f"{side.capitalize()}: {title}",
                "picture", "contours", "tried", "truth", "fruit", "numbers",
            )
            for side in SIDES
        ),
        name="Circles",
    )  # fmt: skip


def _match(_results: bool) -> rrb.Container:
    return rrb.Vertical(
        rrb.Spatial2DView(
            origin="match",
            contents=["match/views", "match/circles", "match/lines"],
            name="Left and right: green right, red wrong, orange unknown; purple alone",
        ),
        rrb.Horizontal(
            rrb.Vertical(
                rrb.BarChartView(
                    origin="match/projection/left", name="Paper: fruit a column, left"
                ),
                rrb.BarChartView(
                    origin="match/projection/right", name="Paper: fruit a column, right"
                ),
            ),
            rrb.BarChartView(
                origin="match/correlation", name="Paper: their correlation by shift, px"
            ),
            document("match/table", "Matches: cost, 0 best"),
            column_shares=[2, 2, 2],
        ),
        row_shares=[3, 2],
        name="Match",
    )


def _range(_results: bool) -> rrb.Container:
    return rrb.Horizontal(
        rrb.Vertical(
            rrb.Spatial2DView(
                origin="range",
                contents=[
                    f"range/{what}"
                    for what in ("axes", "scale", "limit", "intervals", "errors", "readings")
                ],
                name="Error against range, all frames: orange truth's, blue rangefinder's",
                time_ranges=WHOLE_RUN,
                visual_bounds=CHART,
            ),
            rrb.Horizontal(
                curves("error_mm", "Errors of distance, mm"),
                curves("health/row_px", "Rows between partners, px: 0 where the rig is true"),
            ),
            row_shares=[3, 1],
        ),
        rrb.Vertical(document("range/table", "Apples of this frame"), in_space()),
        column_shares=[3, 2],
        name="Range",
    )


def _health(results: bool) -> rrb.Container:
    times = [curves("time_ms", "Time a stage, ms")] if results else []
    return rrb.Horizontal(
        rrb.Vertical(
            curves("health/overexposed", "Blown out, % of each view"),
            curves("health/brightness", "Brightness"),
            *times,
        ),
        rrb.Vertical(
            curves("health/skew_ms", "Skew: right after left, ms"),
            curves("health/lost", "Lost since the beginning"),
            curves("health/rate_hz", "Pictures and readings a second"),
        ),
        rrb.Vertical(
            document("health/ledger", "Ledger"),
            rrb.TextLogView(origin="health/notes", name="Notes and warnings"),
        ),
        name="Health",
    )


MAKERS: Final[dict[str, Callable[[bool], rrb.Container]]] = {
    "Overview": _overview,
    "Recorded": _recorded,
    "Recognise": _recognise,
    "Circles": _circles,
    "Match": _match,
    "Range": _range,
    "Health": _health,
}
