"""What every layout is made of: views of one kind each, and the window around tabs."""

from typing import Final

import rerun.blueprint as rrb

from recorder.records import Side

BEHIND: Final = rrb.EyeControls3D(
    position=(0.9, -0.7, -0.9), look_target=(0.1, 0.0, 1.1), eye_up=(0.0, -1.0, 0.0)
)


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


def pictured(side: Side, name: str, *layers: str) -> rrb.Spatial2DView:
    """Layers of a view, by their names below it, the lowest first."""
    contents = [f"world/{side}/{layer}" for layer in layers]
    return rrb.Spatial2DView(origin=f"world/{side}", contents=contents, name=name)


def in_space(*, results: bool = True) -> rrb.Spatial3DView:
    """The apples from behind the cameras, a little from above."""
    known = ("truth", "beam", "left", "right")
    return rrb.Spatial3DView(
        origin="world",
        contents=[f"world/{what}" for what in (("apples", *known) if results else known)],
        name="In space: orange estimates, blue truth" if results else "In space: blue truth",
        line_grid=False,
        eye_controls=BEHIND,
    )


def curves(origin: str, name: str) -> rrb.TimeSeriesView:
    """Numbers over time."""
    return rrb.TimeSeriesView(origin=origin, name=name)


def document(origin: str, name: str) -> rrb.TextDocumentView:
    """A text."""
    return rrb.TextDocumentView(origin=origin, name=name)
