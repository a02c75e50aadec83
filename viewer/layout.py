"""The viewer's layout: a Rerun blueprint of our own, a tab for each question."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import rerun.blueprint as rrb

from processor.rrd import APPLICATION
from recorder.records import SIDES, Side

# Overview: what is there?  Recognise: which pixels, rightly?  Circles: which of the tried?
# Match: which is which?  Range: how far, how sure?  Health: can the recording be trusted?
TABS: Final = ("Overview", "Recognise", "Circles", "Match", "Range", "Health")
SESSION_TABS: Final = ("Overview", "Health")  # of a session without results

CHART: Final = rrb.VisualBounds2D(x_range=(150.0, 2050.0), y_range=(-680.0, 680.0))
WHOLE_RUN: Final = [
    rrb.VisibleTimeRange(
        timeline,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.infinite(),
    )
    for timeline in ("frame", "session_time", "capture")
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
    made = {name: MAKERS[name](tabs != SESSION_TABS) for name in tabs}
    active = active or tabs[0]
    return blueprint(*made.values(), active=tabs.index(active), timeline=timeline)


def blueprint(
    *tabs: rrb.Container | rrb.View, active: int = 0, timeline: str = "frame"
) -> rrb.Blueprint:
    """Tabs in a window of which they have all but the slider of time."""
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=active),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=timeline, state="collapsed", play_state="paused"),
        auto_views=False,
    )


def save_layout(path: Path, made: rrb.Blueprint | None = None) -> None:
    """Write a layout, the usual one where none is given, as a blueprint file (.rbl)."""
    (made or layout()).save(APPLICATION, path)


def _overview(results: bool) -> rrb.Container:
    layers = ("picture", "truth", "fruit", "numbers") if results else ("picture", "truth")
    title = ": orange located, purple alone, blue true" if results else ": truth in blue"
    pictures = rrb.Horizontal(*(_view(s, f"{s.capitalize()}{title}", *layers) for s in SIDES))
    if not results:
        below = [_space(), _document("about", "Session"), _document("legend", "Colours")]
        return rrb.Vertical(
            pictures, rrb.Horizontal(*below, column_shares=[2, 1, 1]), row_shares=[3, 2],
            name="Overview",
        )  # fmt: skip
    curves = rrb.Vertical(
        _curves("verdict", "How the true apples' matches fared"),
        _curves("error_mm", "Errors of distance, mm"),
    )
    texts = rrb.Tabs(
        _document("range/table", "Apples of this frame"),
        _document("about", "Session"),
        _document("legend", "Colours"),
    )
    return rrb.Vertical(
        pictures,
        rrb.Horizontal(_space(), curves, texts, column_shares=[3, 3, 3]),
        row_shares=[3, 2],
        name="Overview",
    )


def _recognise(_results: bool) -> rrb.Container:
    views = []
    for side in SIDES:
        name = side.capitalize()
        views += [
            _view(side, f"{name}: truth in blue", "picture", "truth"),
            rrb.Spatial2DView(origin=f"index/{side}", name=f"{name}: colour index"),
            _view(side, f"{name}: green hit, red false, blue missed", "picture", "mask"),
            _view(side, f"{name}: the same, cleaned", "picture", "cleaned"),
        ]
    return rrb.Grid(*views, grid_columns=4, name="Recognise")


def _circles(_results: bool) -> rrb.Container:
    title = "grey tried, orange or purple chosen, blue true"
    return rrb.Horizontal(
        *(
            _view(
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
            _document("match/table", "Matches: cost, 0 best"),
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
                _curves("error_mm", "Errors of distance, mm"),
                _curves("health/row_px", "Rows between partners, px: 0 where the rig is true"),
            ),
            row_shares=[3, 1],
        ),
        rrb.Vertical(_document("range/table", "Apples of this frame"), _space()),
        column_shares=[3, 2],
        name="Range",
    )


def _health(results: bool) -> rrb.Container:
    times = [_curves("time_ms", "Time a stage, ms")] if results else []
    return rrb.Horizontal(
        rrb.Vertical(
            _curves("health/overexposed", "Blown out, % of each view"),
            _curves("health/brightness", "Brightness"),
            *times,
        ),
        rrb.Vertical(
            _curves("health/skew_ms", "Skew: right after left, ms"),
            _curves("health/lost", "Lost since the beginning"),
            _curves("health/rate_hz", "Pictures and readings a second"),
        ),
        rrb.Vertical(
            _document("health/ledger", "Ledger"),
            rrb.TextLogView(origin="health/notes", name="Notes and warnings"),
        ),
        name="Health",
    )


MAKERS: Final[dict[str, Callable[[bool], rrb.Container]]] = {
    "Overview": _overview,
    "Recognise": _recognise,
    "Circles": _circles,
    "Match": _match,
    "Range": _range,
    "Health": _health,
}


def _view(side: Side, name: str, *layers: str) -> rrb.Spatial2DView:
    contents = [f"world/{side}/{layer}" for layer in layers]
    return rrb.Spatial2DView(origin=f"world/{side}", contents=contents, name=name)


def _space() -> rrb.Spatial3DView:
    """The apples from behind the cameras, a little from above."""
    return rrb.Spatial3DView(
        origin="world",
        contents=["world/apples", "world/truth", "world/beam", "world/left", "world/right"],
        name="In space: orange estimates, blue truth",
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=(0.9, -0.7, -0.9), look_target=(0.1, 0.0, 1.1), eye_up=(0.0, -1.0, 0.0)
        ),
    )


def _curves(origin: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, name=name)


def _document(origin: str, name: str) -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin=origin, name=name)
