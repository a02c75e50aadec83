"""Plots as SVG text, drawn in the page's own colours so that they follow its light and dark."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Final

import numpy as np

from recorder.rig import Floats

MARGINS: Final = (58, 12, 14, 40)  # left, right, top, bottom
MOST_DOTS: Final = 2500  # more dots make a heavy page, not a clearer one


@dataclass(slots=True)
class Plot:
    """One set of axes.

    Attributes:
        x_range, y_range: what the axes show; y may fall, as a picture's rows do.
        width, height: of the drawing, in its own units.
    """

    x_range: tuple[float, float]
    y_range: tuple[float, float]
    x_label: str = ""
    y_label: str = ""
    width: int = 460
    height: int = 280
    body: list[str] = field(default_factory=list)

    def x(self, value: float) -> float:
        """Where a value lies across."""
        left, right, _, _ = MARGINS
        share = (value - self.x_range[0]) / (self.x_range[1] - self.x_range[0])
        return left + share * (self.width - left - right)

    def y(self, value: float) -> float:
        """Where a value lies down."""
        _, _, top, bottom = MARGINS
        share = (value - self.y_range[0]) / (self.y_range[1] - self.y_range[0])
        return self.height - bottom - share * (self.height - top - bottom)

    def dots(self, points: Floats, kind: str = "a", radius: float = 1.4) -> None:
        """(N, 2) points as dots of one kind of colour; evenly thinned where there are many."""
        for x, y in points[:: max(1, -(-len(points) // MOST_DOTS))]:
            self.body.append(
                f'<circle class="{kind}" cx="{self.x(x):.1f}" cy="{self.y(y):.1f}" r="{radius}"/>'
            )

    def line(self, points: Iterable[tuple[float, float]], kind: str = "a") -> None:
        """A polyline."""
        path = " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in points)
        self.body.append(f'<polyline class="line {kind}" points="{path}"/>')

    def arrow(self, start: Sequence[float], end: Sequence[float], kind: str = "b") -> None:
        """A line with a dot where it begins."""
        self.line([(start[0], start[1]), (end[0], end[1])], kind)
        self.body.append(
            f'<circle class="{kind}" cx="{self.x(start[0]):.1f}" cy="{self.y(start[1]):.1f}" '
            'r="2"/>'
        )

    def cell(self, corner: Sequence[float], opposite: Sequence[float], share: float) -> None:
        """A filled rectangle, the fuller the larger `share` (0 to 1)."""
        xs = sorted((self.x(corner[0]), self.x(opposite[0])))
        ys = sorted((self.y(corner[1]), self.y(opposite[1])))
        self.body.append(
            f'<rect class="cell" x="{xs[0]:.1f}" y="{ys[0]:.1f}" width="{xs[1] - xs[0]:.1f}" '
            f'height="{ys[1] - ys[0]:.1f}" fill-opacity="{share:.2f}"/>'
        )

    def text(self, x: float, y: float, words: str, anchor: str = "start") -> None:
        """Words at a place."""
        self.body.append(
            f'<text x="{self.x(x):.1f}" y="{self.y(y):.1f}" text-anchor="{anchor}">'
            f"{escape(words)}</text>"
        )

    def svg(self, title: str) -> str:
        """The drawing."""
        left, right, top, bottom = MARGINS
        low, far = self.height - bottom, self.width - right
        view = f"0 0 {self.width} {self.height}"
        parts = [f'<svg viewBox="{view}" role="img" aria-label="{escape(title)}">']
        for value in ticks(*self.x_range):
            x = self.x(value)
            parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{top}" y2="{low}"/>')
            parts.append(f'<text x="{x:.1f}" y="{low + 14}" text-anchor="middle">{value:g}</text>')
        for value in ticks(*self.y_range):
            y = self.y(value)
            parts.append(f'<line class="grid" x1="{left}" x2="{far}" y1="{y:.1f}" y2="{y:.1f}"/>')
            parts.append(
                f'<text x="{left - 6}" y="{y + 3.5:.1f}" text-anchor="end">{value:g}</text>'
            )
        middle = (left + far) / 2
        parts.append(
            f'<text class="label" x="{middle:.0f}" y="{self.height - 6}" text-anchor="middle">'
            f"{escape(self.x_label)}</text>"
        )
        parts.append(
            f'<text class="label" transform="translate(13 {(top + low) / 2:.0f}) rotate(-90)" '
            f'text-anchor="middle">{escape(self.y_label)}</text>'
        )
        return "".join((*parts, *self.body, "</svg>"))


def ticks(start: float, end: float, count: int = 6) -> list[float]:
    """Round values between two ends."""
    low, high = sorted((start, end))
    rough = (high - low) / count
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(min((s for s in (1, 2, 5, 10) if s * power >= rough), default=10) * power)
    values = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    return [float(round(value, 10)) + 0.0 for value in values]  # no -0


def bars(rows: Sequence[tuple[str, float, bool]], unit: str, width: int = 640) -> str:
    """Horizontal bars: name, value, and whether it stands out."""
    most = max((value for _, value, _ in rows if np.isfinite(value)), default=1.0)
    height = 20 * len(rows) + 6
    parts = [f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="by view">']
    for place, (name, value, bad) in enumerate(rows):
        y = 20 * place + 4
        length = (width - 290) * (value / most if np.isfinite(value) else 0)
        parts.append(f'<text x="205" y="{y + 11}" text-anchor="end">{escape(name[-34:])}</text>')
        parts.append(
            f'<rect class="{"bad" if bad else "bar"}" x="212" y="{y}" width="{length:.1f}" '
            'height="14"/>'
        )
        shown = f"{value:.2f} {unit}" if np.isfinite(value) else "none"
        parts.append(f'<text x="{218 + length:.1f}" y="{y + 11}">{shown}</text>')
    return "".join((*parts, "</svg>"))
