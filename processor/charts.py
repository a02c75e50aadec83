"""How figures look: one palette, PNG or SVG out. The object interface alone: no global state."""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes  # noqa: PLC0414  # for modules that draw
    from matplotlib.figure import Figure as Sheet

# Okabe and Ito's palette: told apart by every kind of colour sight
BLUE: Final = "#0072B2"
ORANGE: Final = "#E69F00"
GREEN: Final = "#009E73"
RED: Final = "#D55E00"
PURPLE: Final = "#CC79A7"
SKY: Final = "#56B4E9"
GREY: Final = "#6e6e6e"
SERIES: Final = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY)
INK: Final = "#1c1e21"  # of SVG, that a page puts its own inks for: processor.page_parts.INKS
SOFT: Final = "#5b6168"
LINE: Final = "#d9dce0"
MARKERS: Final = ("o", "s", "^", "D", "v", "P")

_STYLE: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.4,
    "lines.markersize": 4,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}
_ON_A_PAGE: Final[Any] = {  # a page has a ground of its own, light or dark
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": SOFT,
    "axes.titlecolor": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "grid.color": LINE,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "svg.hashsalt": "pomolog",  # the same numbers give the same file
}
DPI: Final = 160


@contextmanager
def drawing(width_in: float = 7.0, height_in: float = 3.2) -> Iterator[tuple["Sheet", list[bytes]]]:
    """A sheet to draw on; after the block, its PNG is the list's one element."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Sheet

    done: list[bytes] = []
    with mpl.rc_context(_STYLE):
        sheet = Sheet(figsize=(width_in, height_in), layout="constrained")
        yield sheet, done
        buffer = io.BytesIO()
        # no date and no version: the same numbers give the same file
        sheet.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
        done.append(buffer.getvalue())


@contextmanager
def drawing_for_page(
    width_in: float = 7.0, height_in: float = 3.2
) -> Iterator[tuple["Sheet", list[str]]]:
    """A sheet to draw on; after the block, its SVG is the list's one element.

    Its axes have the inks INK, SOFT and LINE, which `page_parts.drawing_figure` turns into the
    page's own.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure as Sheet

    done: list[str] = []
    with mpl.rc_context(_STYLE | _ON_A_PAGE):
        sheet = Sheet(figsize=(width_in, height_in), layout="constrained")
        yield sheet, done
        buffer = io.StringIO()
        sheet.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
        done.append(buffer.getvalue())


def show_picture(axes: "Axes", picture: npt.NDArray[np.uint8], title: str = "") -> None:
    """A BGR or grey picture without axes."""
    if picture.ndim == 3:
        axes.imshow(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    else:
        axes.imshow(picture, cmap="gray", vmin=0, vmax=255)
    axes.set_axis_off()
    if title:
        axes.set_title(title)


def outline(
    axes: "Axes", circle: Sequence[float], colour: str, label: str = "", style: str = "-"
) -> None:
    """A circle x, y, radius in the axes' pixels."""
    from matplotlib.patches import Circle

    x, y, radius = circle
    axes.add_patch(
        Circle((x, y), radius, fill=False, color=colour, lw=1.4, ls=style, label=label or None)
    )


def font_file(*, bold: bool = False) -> Path:
    """The type that figures are set in, for who draws text on pictures."""
    import matplotlib as mpl

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return Path(mpl.get_data_path()) / "fonts" / "ttf" / name
