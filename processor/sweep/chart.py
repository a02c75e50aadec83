"""The main effects of a sweep as one picture."""

import numpy as np

from processor.experiments.charts import drawing
from processor.sweep.effects import Found
from processor.sweep.settings import Setting

MOST_PANELS: int = 8  # parameters with smaller effects are in the table alone
A_ROW: int = 4


def draw_effects(found: Found, settings: tuple[Setting, ...]) -> bytes:
    """A PNG: a panel a parameter, the mean of each value on train and test, a dot each setting."""
    m = found.measure
    shown = list(found.effects.items())[:MOST_PANELS]
    rows = -(-len(shown) // A_ROW)
    columns = min(len(shown), A_ROW)
    with drawing(max(4.2, 2.6 * columns), 2.9 * rows + 0.3) as (sheet, done):
        panels = sheet.subplots(rows, columns, squeeze=False, sharey=True)
        for panel in panels.flat[len(shown) :]:
            panel.set_axis_off()
        for panel, (name, levels) in zip(panels.flat, shown, strict=False):
            places = np.arange(len(levels))
            for place, level in enumerate(levels):
                label = None if place else "each setting, train"
                mine = [s.number for s in settings if s.in_grid and s.values[name] == level.value]
                panel.plot(
                    np.full(len(mine), place), found.train[mine] * m.scale,
                    ".", color="#b9c2cb", zorder=1, label=label,
                )  # fmt: skip
            for split, colour, style in (("train", "#0b62a8", "o-"), ("test", "#c2571a", "s--")):
                means = [getattr(level, split) for level in levels]
                values = [np.nan if v is None else v * m.scale for v in means]
                panel.plot(places, values, style, color=colour, label=f"mean, {split}")
            panel.set_xticks(places, [_short(level.value) for level in levels])
            panel.tick_params(axis="x", labelrotation=30 if _long(levels) else 0)
            panel.set_xlabel(name)
        for row in panels:
            row[0].set_ylabel(f"{m.name.removesuffix('_mm')}, {m.unit}")
        panels.flat[0].legend()
    return done[0]


def _short(value: str) -> str:
    return value if len(value) < 18 else f"{value[:16]}…"


def _long(levels: tuple[object, ...]) -> bool:
    return sum(len(_short(getattr(level, "value", ""))) for level in levels) > 22
