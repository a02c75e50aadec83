"""The viewer's layout: a Rerun blueprint of our own."""

from pathlib import Path

import rerun.blueprint as rrb

from processor.rrd import APPLICATION
from recorder.records import SIDES

IN_SPACE = ("apples", "truth", "beam", "left", "left/picture", "right")


def layout() -> rrb.Blueprint:
    """Tabs by question: what was found, what looked like fruit, which circles, which matches."""
    overview = rrb.Horizontal(
        rrb.Vertical(*(_view(side, "picture", "fruit", "truth") for side in SIDES)),
        rrb.Spatial3DView(
            origin="world",
            contents=[f"world/{what}" for what in IN_SPACE],
            name="In space",
        ),
        name="Overview",
    )
    recognise = rrb.Grid(
        *(_view(side, what) for what in ("index", "mask", "cleaned") for side in SIDES),
        grid_columns=2,
        name="Recognise",
    )
    circles = rrb.Horizontal(
        *(_view(side, "picture", "contours", "tried", "fruit", "truth") for side in SIDES),
        name="Circles",
    )
    match = rrb.Vertical(
        rrb.Horizontal(
            _view("left", "picture", "fruit", "matches", "reference_line"),
            _view("right", "picture", "fruit"),
        ),
        rrb.Horizontal(
            rrb.BarChartView(origin="match/projection/left", name="Projection, left"),
            rrb.BarChartView(origin="match/projection/right", name="Projection, right"),
            rrb.BarChartView(origin="match/correlation", name="Correlation"),
        ),
        row_shares=[2, 1],
        name="Match",
    )
    numbers = rrb.Vertical(
        rrb.TimeSeriesView(origin="count", name="Fruit and matches"),
        rrb.TimeSeriesView(origin="time_ms", name="Stage times, ms"),
        name="Numbers",
    )
    return rrb.Blueprint(
        rrb.Tabs(overview, recognise, circles, match, numbers),
        rrb.TimePanel(timeline="frame", state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )


def _view(side: str, *layers: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        origin=f"world/{side}",
        contents=[f"world/{side}/{layer}" for layer in layers],
        name=f"{side.capitalize()}: {', '.join(layers).replace('_', ' ')}",
    )


def save_layout(path: Path) -> None:
    """Write the layout as a blueprint file (.rbl)."""
    layout().save(APPLICATION, path)
