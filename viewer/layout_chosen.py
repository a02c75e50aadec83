"""Layouts of what was chosen from results: the worst cases, and methods side by side."""

from collections.abc import Sequence
from typing import Final

import rerun.blueprint as rrb

from recorder.records import SIDES
from viewer.layout import MAKERS, TABS
from viewer.views import BEHIND, blueprint, curves, document, pictured

CLOSE: Final = rrb.VisualBounds2D(x_range=(0.0, 480.0), y_range=(0.0, 480.0))


def worst_layout(*, active: str = "") -> rrb.Blueprint:
    """The usual tabs behind one of the worst cases, stepped through case by case."""
    views = rrb.Horizontal(
        *(
            rrb.Spatial2DView(
                origin=f"worst/{side}",
                name=f"{side.capitalize()}, close: orange estimates, blue truth",
                visual_bounds=CLOSE,
            )
            for side in SIDES
        ),
        *(
            pictured(
                side, f"{side.capitalize()}: the case marked", "picture", "truth", "fruit", "worst"
            )
            for side in SIDES
        ),
    )
    texts = rrb.Horizontal(
        document("worst/list", "Worst cases"), document("worst/case", "This case"),
        column_shares=[2, 1],
    )  # fmt: skip
    worst = rrb.Vertical(views, texts, row_shares=[3, 2], name="Worst")
    names = ("Worst", *TABS)
    others = (MAKERS[name](True) for name in TABS)
    place = names.index(active) if active else 0
    return blueprint(worst, *others, active=place, timeline="worst")


def side_by_side_layout(methods: Sequence[str], *, active: str = "") -> rrb.Blueprint:
    """Changes from the first method to each other, and a tab a method."""
    tabs: dict[str, rrb.Container] = {}
    for other in methods[1:]:
        name = "Changes" if len(methods) == 2 else f"Changes to {other}"
        tabs[name] = _changes(methods[0], other, name)
    tabs |= {method: _method(method) for method in methods}
    place = list(tabs).index(active) if active in tabs else 0
    return blueprint(*tabs.values(), active=place)


def _changes(before: str, after: str, name: str) -> rrb.Container:
    title = (
        f"from {before} to {after}: green gained, red lost, orange moved, thin: no apple; blue true"
    )
    pictures = rrb.Horizontal(
        *(
            pictured(side, f"{side.capitalize()}, {title}", "picture", "truth", f"changes/{after}")
            for side in SIDES
        )
    )
    texts = rrb.Tabs(
        document(f"changes/{after}/table", "Changes in this frame"),
        document("about", "In all frames"),
        document("legend", "Colours"),
    )
    errors = rrb.Vertical(
        curves(f"changes/{after}/count", "Changes a frame"),
        *(curves(f"error_mm/{m}", f"{m}: errors of distance, mm") for m in (before, after)),
    )
    return rrb.Vertical(
        pictures, rrb.Horizontal(texts, errors, column_shares=[3, 2]), row_shares=[3, 2], name=name
    )


def _method(method: str) -> rrb.Container:
    found = ("picture", "truth", f"{method}/fruit", f"{method}/numbers")
    return rrb.Vertical(
        rrb.Horizontal(
            *(
                pictured(s, f"{s.capitalize()}: orange located, purple alone, blue true", *found)
                for s in SIDES
            ),
            *(
                pictured(s, f"{s.capitalize()}: green hit, red false, blue missed",
                      "picture", f"{method}/mask")
                for s in SIDES
            ),
        ),
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="world",
                contents=[f"world/{method}/apples", "world/truth", "world/left", "world/right"],
                name="In space: orange estimates, blue truth",
                line_grid=False,
                eye_controls=BEHIND,
            ),
            rrb.Vertical(
                curves(f"verdict/{method}", "How the true apples' matches fared"),
                curves(f"time_ms/{method}", "Time a stage, ms"),
            ),
            rrb.Tabs(
                document(f"range/{method}/table", "Apples of this frame"),
                document(f"method/{method}", "Method"),
            ),
        ),
        row_shares=[3, 2],
        name=method,
    )  # fmt: skip
