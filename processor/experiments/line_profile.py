"""Fig. 2: red, green, blue, their difference and ratio along a line across a fruit."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from processor import charts
from processor.discs import true_discs
from processor.experiments.item import Claim, Item
from processor.experiments.material import Material, describe
from processor.experiments.work import Bench, Row, Sample, samples
from processor.page_parts import Column, Figure, Scalar, Table, percent
from recorder.records import Picture, counted_fruit

if TYPE_CHECKING:
    from processor.charts import Axes

LEAST_VISIBLE: Final = 0.9  # of the fruit that a line is drawn across
REACH: Final = 2.5  # radii that the line goes either way
RATIO_SHOWN: Final = 6.0  # the ratio has no bounds; the axis has


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """The pixels of one line.

    Attributes:
        picture: (h, w, 3) BGR, around the line.
        row: of the line in that picture.
        red: (w,) along the line.
        green: (w,).
        blue: (w,).
        fruit: (w,) bool: a counted apple's pixel.
        ends: first and last pixel of the fruit that the line was drawn for, M and N.
        background: (w,) bool: no apple's pixel.
    """

    picture: Picture
    row: int
    red: npt.NDArray[np.int64]
    green: npt.NDArray[np.int64]
    blue: npt.NDArray[np.int64]
    fruit: npt.NDArray[np.bool_]
    ends: tuple[int, int]
    background: npt.NDArray[np.bool_]

    @property
    def ratio(self) -> npt.NDArray[np.float64]:
        """(R - G) / (G - B), the paper's; NaN at G = B."""
        below = (self.green - self.blue).astype(float)
        below[below == 0] = np.nan
        return np.asarray((self.red - self.green) / below)


def measure_profiles(sample: Sample) -> list[Row]:
    """What the rule's two conditions say along a line through each picture's clearest fruit."""
    profile = profile_of(sample)
    if profile is None:
        return []
    red_green, green_blue = profile.red - profile.green, profile.green - profile.blue
    first = red_green > 0
    tests = {
        "first": first,
        "signed": first & (green_blue > 0) & (red_green > green_blue),
        "absolute": first & (red_green > np.abs(green_blue)),
        "difference": first & (red_green > green_blue),
    }
    row: Row = {"fruit": int(profile.fruit.sum()), "background": int(profile.background.sum())}
    for name, passed in tests.items():
        row[f"fruit_{name}"] = int((passed & profile.fruit).sum())
        row[f"background_{name}"] = int((passed & profile.background).sum())
    row["bluer"] = int((profile.fruit & (green_blue <= 0)).sum())
    return [row]


def profile_of(sample: Sample) -> Profile | None:
    """The line through the largest fruit of the left view that is all but whole."""
    truth, labels = sample.pair.truth, sample.labels("left")
    if truth is None or labels is None:
        return None
    discs = true_discs(truth, "left", labels, sample.rectification)
    if discs is None:
        return None
    height, width = labels.shape
    best: tuple[int, float, float, float] | None = None
    for apple, (x, y, radius), visible in zip(
        discs.ids, discs.circles.tolist(), discs.visible.tolist(), strict=True
    ):
        inside = radius < x < width - radius and radius < y < height - radius
        if visible >= LEAST_VISIBLE and inside and (best is None or radius > best[3]):
            best = (apple, x, y, radius)
    if best is None:
        return None
    apple, x, y, radius = best
    row = round(y)
    left, right = max(0, round(x - REACH * radius)), min(width, round(x + REACH * radius))
    top, bottom = max(0, round(y - 1.4 * radius)), min(height, round(y + 1.4 * radius))
    picture = sample.picture("left")
    line = picture[row, left:right].astype(np.int64)
    names = labels[row, left:right]
    own = np.flatnonzero(names == apple)
    if not len(own):
        return None
    return Profile(
        picture=picture[top:bottom, left:right],
        row=row - top,
        red=line[:, 2],
        green=line[:, 1],
        blue=line[:, 0],
        fruit=counted_fruit(names),
        ends=(int(own[0]), int(own[-1])),
        background=names == 0,
    )


def line_profile(material: Material, bench: Bench) -> tuple[Item, ...]:
    """Fig. 2 on the first picture that has a whole fruit, and its claims over all of them."""
    sources = material.of("segmentation")
    rows = bench.rows(measure_profiles, sources)
    drawn = None
    for source in sources:
        drawn = next((p for p in map(profile_of, samples(source)) if p is not None), None)
        if drawn is not None:
            break
    if drawn is None:
        return (Item("fig2", "Fig. 2", "Line profile across a fruit",
                     not_run="no fruit is 90 % visible in these sessions"),)  # fmt: skip
    return (report(rows, drawn, describe(sources)),)


def report(rows: Sequence[Row], drawn: Profile, material: str) -> Item:
    """The item from every line's counts and one line to draw."""
    total = {key: sum(r[key] for r in rows) for key in rows[0] if key not in _ABOUT}
    shares: list[dict[str, Scalar]] = [
        {
            "condition": label,
            "fruit": percent(total[f"fruit_{key}"] / max(1, total["fruit"])),
            "background": percent(total[f"background_{key}"] / max(1, total["background"])),
        }
        for key, label in _TESTS.items()
    ]
    bluer = 100 * total["bluer"] / max(1, total["fruit"])
    first, signed = shares[0], shares[1]
    return Item(
        id="fig2",
        source="Fig. 2, Sec. 2.2",
        title="Line profile across a fruit",
        summary=(
            f"R exceeds G on {first['fruit']:.0f} % of the fruit's pixels along the lines, and on "
            f"{first['background']:.0f} % of the background's, which is why the paper adds the "
            f"ratio. Taken literally, the ratio fails where B ≥ G, which is {bluer:.0f} % of the "
            f"fruit's pixels here: {signed['fruit']:.0f} % remain."
        ),
        method=f"A row of pixels through the largest fruit that is at least {LEAST_VISIBLE:.0%} "
        f"visible in each left picture ({len(rows)} lines); the figure shows the first of them. "
        "The fruit between M and N is what the truth labels say.",
        material=material,
        claims=(
            Claim("fruit pixels with R > G", 100.0, _number(first["fruit"]), "%", 1,
                  verdict="holds" if _number(first["fruit"]) > 95 else "in part",
                  sentence="the paper: “could be recognized completely by R − G”"),
            Claim("background pixels with R > G", None, _number(first["background"]), "%", 1,
                  sentence="the paper: “some error recognitions”"),
            Claim("fruit pixels kept by the literal ratio", 100.0, _number(signed["fruit"]), "%", 1,
                  verdict="holds" if _number(signed["fruit"]) > 95 else "does not hold",
                  sentence="the ratio is undefined at G = B and negative below"),
        ),
        tables=(
            Table("fig2", "Pixels along the lines that meet each condition, %.",
                  {"condition": Column("condition"), "fruit": Column("of the fruit"),
                   "background": Column("of the background")}, shares),
        ),
        figures=(
            Figure("fig2", "Line profile: the picture with its line, R, G and B, their "
                   "difference, and the ratio with its cutoff at 1. M and N are the fruit's ends; "
                   "the strips say where each reading of the rule sees fruit.", draw(drawn)),
        ),
    )  # fmt: skip


_ABOUT: Final = frozenset(
    ("session", "scene", "split", "frame", "lighting", "occlusion", "exposure_ev", "hung_mm")
)
_TESTS: Final = {
    "first": "R − G > 0", "signed": "and ratio > 1, signed",
    "absolute": "and R − G > |G − B|", "difference": "and R − G > G − B",
}  # fmt: skip


def _number(value: Scalar) -> float:
    assert isinstance(value, float)
    return value


def draw(profile: Profile) -> bytes:
    """The picture above its curves, as Fig. 2 has them."""
    place = np.arange(len(profile.red))
    first, last = profile.ends
    height, width = profile.picture.shape[:2]
    tall = 5.9 * height / width  # the panels' width in inches: the picture keeps its shape
    with charts.drawing(7.0, tall + 4.6) as (sheet, done):
        panels = sheet.subplots(4, 1, height_ratios=[tall, 1.5, 1.1, 1.5], sharex=True)
        rgb = profile.picture[..., ::-1]
        panels[0].imshow(rgb, aspect="auto")
        panels[0].axhline(profile.row, color="white", lw=1.2)
        panels[0].set_title("(a) picture and line")
        panels[0].set_yticks([])
        panels[0].grid(visible=False)
        for values, colour, name in (
            (profile.red, charts.RED, "R"), (profile.green, charts.GREEN, "G"),
            (profile.blue, charts.BLUE, "B"),
        ):  # fmt: skip
            panels[1].plot(place, values, color=colour, label=name, lw=1.1)
        panels[1].set_ylim(0, 255)
        panels[1].set_title("(b) R, G, B")
        panels[1].legend(ncols=3, loc="upper right")
        panels[2].plot(place, profile.red - profile.green, color="black", lw=1.0)
        panels[2].axhline(0, color=charts.GREY, lw=0.8)
        panels[2].set_title("(c) R − G")
        _draw_ratio(panels[3], profile, place)
        for axes in panels:
            for end in (first, last):
                axes.axvline(end, color=charts.GREY, ls="--", lw=0.9)
        for end, name in ((first, "M"), (last, "N")):
            panels[0].annotate(name, (end, 0), xytext=(2, -10), textcoords="offset points",
                               color="white", weight="bold")  # fmt: skip
        panels[3].set_xlabel("pixel along the line")
    return done[0]


def _draw_ratio(axes: "Axes", profile: Profile, place: npt.NDArray[np.int64]) -> None:
    ratio = np.clip(profile.ratio, -RATIO_SHOWN, RATIO_SHOWN)
    axes.plot(place, ratio, ".", color=charts.PURPLE, ms=2.5)
    axes.axhline(1, color=charts.GREY, lw=0.8)
    red_green, green_blue = profile.red - profile.green, profile.green - profile.blue
    strips = {
        "signed": (green_blue > 0) & (red_green > green_blue),
        "absolute": red_green > np.abs(green_blue),
        "difference": (red_green > green_blue) & (red_green > 0),
    }
    for number, (name, passed) in enumerate(strips.items()):
        level = RATIO_SHOWN + 1.2 + 1.3 * number
        axes.plot(place[passed], np.full(passed.sum(), level), "s", ms=2.5,
                  color=charts.SERIES[number])  # fmt: skip
        axes.annotate(name, (1.002, level), xycoords=("axes fraction", "data"), fontsize=7,
                      va="center", color=charts.SERIES[number])  # fmt: skip
    axes.set_ylim(-RATIO_SHOWN - 0.5, RATIO_SHOWN + 4.8)
    axes.set_yticks([-6, -3, 0, 1, 3, 6])
    axes.set_title("(d) (R − G) / (G − B), cut off at 6, and where each reading sees fruit")
