"""The main effects of a sweep as one picture."""

import numpy as np

from processor.charts import drawing
from processor.sweep.effects import Found, Level
from processor.sweep.settings import Setting

MOST_PANELS: int = 8  # parameters with smaller effects are in the table alone
A_ROW: int = 4
# split, colour, mark, line
_SPLITS = (("train", "#0b62a8", "o", "-"), ("test", "#c2571a", "s", "--"))


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
            line = _are_numbers(levels)  # between names there is nothing to draw a line along
            for split, colour, mark, style in _SPLITS:
                means = [getattr(level, split) for level in levels]
                values = [np.nan if v is None else v * m.scale for v in means]
                panel.plot(
                    places, values, mark + style * line, color=colour, label=f"mean, {split}"
                )
            panel.set_xticks(places, [_short(level.value) for level in levels])
            if _long(levels):
                panel.tick_params(axis="x", labelrotation=25)
                for label in panel.get_xticklabels():
                    label.set_horizontalalignment("right")
            panel.set_xlim(-0.4, len(levels) - 0.6)
            panel.set_xlabel(name)
        for row in panels:
            row[0].set_ylabel(f"{m.title}, {m.unit}")
        handles, labels = panels.flat[0].get_legend_handles_labels()
        sheet.legend(handles, labels, loc="outside upper left", ncols=3)
    return done[0]


def _are_numbers(levels: tuple[Level, ...]) -> bool:
    return all(level.value.replace(".", "").replace("-", "").isdigit() for level in levels)


def _short(value: str) -> str:
    return value if len(value) < 18 else f"{value[:16]}…"


def _long(levels: tuple[Level, ...]) -> bool:
    return sum(len(_short(level.value)) for level in levels) > 22
