"""Fig. 6: the variance of 100 radii against the rounds of the random ring method."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from processor import charts
from processor.circles import RandomRing
from processor.experiments.item import Claim, Item
from processor.experiments.material import Material, Source, describe
from processor.experiments.outlines import outlines
from processor.experiments.work import samples
from processor.page_parts import Column, Figure, Scalar, Table

ROUNDS: Final = (5, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 200, 400, 600, 800, 1000, 1500)
REPEATS: Final = 100  # Sec. 3.2
CLOSE_TO_0_PX2: Final = 1.0  # a variance below is "close to 0": the radius is good to a pixel
PAPER_FLAT: Final = 400
CLEAR: Final = 60.0  # percent seen, of a fruit that is "clearly seen"
MM_PER_PX: Final = 1500.0**2 / (6 / 5.2e-3 * 200)  # of range at 1500 mm: Z^2 / (f B)
WINDOW_PX: Final = (33.0, 57.0)  # of the true radius: well within 30 to 60 px
# class of contour -> least and most of it that is seen
CLASSES: Final = {
    "whole": (0.97, 1.01), "four fifths": (0.75, 0.85), "two thirds": (0.62, 0.72),
    "half": (0.45, 0.55), "a third": (0.28, 0.38),
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One contour's radii.

    Attributes:
        name: its class.
        visible: how much of the fruit it shows.
        points: of the contour.
        true: x, y, radius.
        circles: (len(ROUNDS), REPEATS, 3) x, y, radius; NaN where no ring was valid.
    """

    name: str
    visible: float
    points: int
    true: tuple[float, float, float]
    circles: npt.NDArray[np.float64]

    @property
    def variance_px2(self) -> npt.NDArray[np.float64]:
        """(len(ROUNDS),) of the radius, over the repeats that gave a circle."""
        return np.asarray(np.nanvar(self.circles[:, :, 2], axis=1, ddof=1))

    @property
    def flat_from(self) -> int | None:
        """The rounds from which the variance stays close to 0; None: it never does."""
        above = np.flatnonzero(~(self.variance_px2 < CLOSE_TO_0_PX2))
        if not len(above):
            return ROUNDS[0]
        return ROUNDS[above[-1] + 1] if above[-1] + 1 < len(ROUNDS) else None


def contour_rounds(material: Material, rng: np.random.Generator) -> tuple[Item, ...]:
    """Fig. 6 on one contour of each class, the first that the sessions have, and a drawn circle."""
    sources = material.of("matching", "segmentation")
    contours = [("drawn circle", 1.0, (60.0, 60.0, 45.0), drawn_circle(45.0)), *choose(sources)]
    curves = [
        Curve(name, visible, len(contour), true, repeat(contour, rng))
        for name, visible, true, contour in contours
    ]
    return (report(curves, describe(sources)),)


def drawn_circle(radius_px: float) -> npt.NDArray[np.int32]:
    """The contour pixels of a perfect disc."""
    canvas = np.zeros((121, 121), np.uint8)
    rows, columns = np.mgrid[:121, :121]
    canvas[np.hypot(rows - 60, columns - 60) <= radius_px] = 255
    contours, _ = cv2.findContours(canvas, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return contours[0][:, 0, :].astype(np.int32)


def choose(
    sources: Sequence[Source],
) -> list[tuple[str, float, tuple[float, float, float], npt.NDArray[np.int32]]]:
    """The first contour of each class in the order of the sessions: none by its result."""
    found = {}
    for source in sources:
        for sample in samples(source):
            for mine in outlines(sample, WINDOW_PX, ("left",)):
                for name, (least, below) in CLASSES.items():
                    if name not in found and least <= mine.visible < below:
                        contour = mine.region.contour_px
                        found[name] = (name, mine.visible, mine.circle, contour)
            if len(found) == len(CLASSES):
                break
    return [found[name] for name in CLASSES if name in found]


def repeat(contour: npt.NDArray[np.int32], rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """(len(ROUNDS), REPEATS, 3): the fullest ring of each repeat, drawn anew for each."""
    result = np.full((len(ROUNDS), REPEATS, 3), np.nan)
    for place, rounds in enumerate(ROUNDS):
        draws = rng.random((REPEATS, rounds, 3))
        rings = RandomRing(rounds=rounds).rings([contour] * REPEATS, draws)
        for number, tried in enumerate(rings):
            if len(tried):
                result[place, number] = tried[int(np.argmax(tried[:, 3])), :3]
    return result


def report(curves: Sequence[Curve], material: str) -> Item:
    """Where each contour's variance flattens, and what is left of it at n = 400."""
    at_400 = ROUNDS.index(400)
    rows: list[dict[str, Scalar]] = []
    for curve in curves:
        radii, columns = curve.circles[at_400, :, 2], curve.circles[at_400, :, 0]
        rows.append({
            "contour": curve.name,
            "visible": 100 * curve.visible,
            "points": curve.points,
            "true_radius": curve.true[2],
            "flat_from": curve.flat_from,
            "variance_5": float(curve.variance_px2[0]),
            "variance_400": float(curve.variance_px2[at_400]),
            "variance_1500": float(curve.variance_px2[-1]),
            "sd_400": float(np.nanstd(radii, ddof=1)),
            "bias_400": float(np.nanmean(radii) - curve.true[2]),
            "sd_x_400": float(np.nanstd(columns, ddof=1)),
            "failed_5": int(np.isnan(curve.circles[0, :, 2]).sum()),
        })  # fmt: skip
    done = [c for c in curves if c.flat_from is not None and c.flat_from <= PAPER_FLAT]
    needed = sorted(c.flat_from or 2 * ROUNDS[-1] for c in curves)
    middle = needed[len(needed) // 2]
    flat = float(middle) if middle <= ROUNDS[-1] else None
    spread = max(float(r["sd_x_400"] or 0) for r in rows if float(r["visible"] or 0) > CLEAR)
    range_mm = MM_PER_PX * np.sqrt(2) * spread  # both views' circles wander
    never = [c.name for c in curves if c.flat_from is None]
    return Item(
        id="fig6",
        source="Fig. 6, Sec. 3.2",
        title="How many rounds the random ring method needs",
        summary=(
            f"The variance of the radius falls steeply, and at the paper's n = 400 it is below "
            f"1 px² for {len(done)} of {len(curves)} contours"
            + (f"; for {' and '.join(never)} it is not even at n = 1500" if never else "")
            + f". But the centre of clearly seen fruit still wanders by up to {spread:.1f} px (SD) "
            "from one run to the next, because the winner is one of many almost equally full "
            f"rings of 10 px width: at 1500 mm that alone is {range_mm:.0f} mm of range (SD), "
            "most of the paper's 20 mm."
        ),
        method=(
            f"{REPEATS} circles for each n, each from new draws, on the outline of single fruit "
            "as the truth labels show it (so that recognition has no part in it), radius within "
            f"{WINDOW_PX[0]:.0f} to {WINDOW_PX[1]:.0f} px; the first contour of each class in the "
            "order of the sessions. “Close to 0” is taken as a variance that stays below 1 px²."
        ),
        material=material,
        claims=(
            Claim(
                "contours whose variance is close to 0 at n = 400", 100.0,
                100 * len(done) / len(curves), "%", 0,
                verdict="holds" if len(done) == len(curves) else "in part",
                sentence=f"{len(done)} of {len(curves)}; the paper shows one contour",
            ),
            Claim("rounds from which it is, middle contour", PAPER_FLAT, flat, "", 0,
                  verdict="holds" if flat is not None and flat <= PAPER_FLAT else "in part",
                  sentence="400 is enough for most" if flat is not None and flat <= PAPER_FLAT
                  else "more than 400"),
            Claim("SD of the centre's column at n = 400, clearly seen fruit", None, spread, "px", 2,
                  sentence="one run of the method against another, on the same contour"),
        ),
        tables=(Table("fig6", "The contours of Fig. 6.", _COLUMNS, rows),),
        figures=(Figure("fig6", "Variance of 100 radii against the rounds n, by contour; the "
                        "line marks the paper's choice of 400.", draw(curves)),),
    )  # fmt: skip


_COLUMNS: Final = {
    "contour": Column("contour"), "visible": Column("visible, %", 0),
    "points": Column("points", 0), "true_radius": Column("true radius, px"),
    "flat_from": Column("flat from n", 0), "variance_5": Column("variance at 5, px²"),
    "variance_400": Column("at 400", 3), "variance_1500": Column("at 1500", 3),
    "sd_400": Column("SD of radius at 400, px", 2), "bias_400": Column("bias, px", 2),
    "sd_x_400": Column("SD of x at 400, px", 2), "failed_5": Column("no circle at 5, of 100", 0),
}  # fmt: skip


def draw(curves: Sequence[Curve]) -> bytes:
    """The curves, plain and with a logarithmic axis where the plain one shows nothing."""
    with charts.drawing(7.0, 3.0) as (sheet, done):
        plain, logarithmic = sheet.subplots(1, 2)
        for number, curve in enumerate(curves):
            style = {
                "color": charts.SERIES[number % 6],
                "marker": charts.MARKERS[number % 6],
                "label": f"{curve.name}",
            }
            plain.plot(ROUNDS, curve.variance_px2, **style)
            logarithmic.loglog(ROUNDS, np.maximum(curve.variance_px2, 1e-4), **style)
        for axes in (plain, logarithmic):
            axes.axvline(PAPER_FLAT, color=charts.GREY, ls="--", lw=0.9)
            axes.set_xlabel("rounds n")
        plain.set_ylabel("variance of the radius, px²")
        plain.set_title("(a) as the paper draws it")
        logarithmic.set_title("(b) both axes logarithmic")
        plain.legend()
    return done[0]
