"""Fig. 8: distance errors by condition and range, and what became of every reading."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from processor import charts
from processor.experiments.distances import (
    CONDITIONS,
    METHODS,
    PAPER_LIMIT_MM,
    TRUTHS,
    Measurements,
    condition_of,
    measurements,
)
from processor.experiments.item import Claim, Item, Verdict
from processor.experiments.work import Row, array_of
from processor.page_parts import Column, Figure, Scalar, Table

if TYPE_CHECKING:
    from processor.charts import Axes


def figure_8(rows: Sequence[Row], material: str) -> Item:
    """Errors by condition and range, and what became of every reading."""
    by_truth = {error: measurements(rows, error) for error in TRUTHS}
    table = [_condition_row(method, c, rows) for method in METHODS for c in CONDITIONS.values()]
    table = [row for row in table if row]
    means = [v for by_range in by_truth["error_mm"].values() for v in by_range.values()]
    exact = [v for by_range in by_truth["located_mm"].values() for v in by_range.values()]
    worst = max(map(abs, means)) if means else None
    within = 100 * sum(abs(v) < PAPER_LIMIT_MM for v in means) / len(means) if means else None
    worst_exact = max(map(abs, exact)) if exact else None
    mine = [r for r in rows if r["method"] == METHODS[0]]
    located = sum(r.get("error_mm") is not None for r in mine)
    wide = [r for r in rows if r["method"] == METHODS[1]]
    located_wide = sum(r.get("error_mm") is not None for r in wide)
    blocked = sum(bool(r.get("blocked")) for r in wide)
    beside = sum(r.get("beside_it_mm") is not None for r in wide)
    naive = array_of(wide, "depth_error_mm")
    gap = float(np.median(naive)) if naive else None
    verdict: Verdict = "not scored" if worst is None else (
        "holds" if worst < PAPER_LIMIT_MM else "in part" if (within or 0) >= 90 else "does not hold"
    )  # fmt: skip
    return Item(
        id="fig8",
        source="Fig. 8, Sec. 3.3",
        title="Distance error from 400 to 1500 mm",
        summary=(
            f"With the paper's window of 30 to 60 px, {located} of {len(mine)} readings meet "
            f"their apple; with a window from rig and range, {located_wide} of {len(wide)}. Of "
            f"the {len(means)} measurements (means at one range), {within or 0:.0f} % are within "
            f"20 mm of the rangefinder; the worst is {worst or 0:.0f} mm off. Compared as the "
            f"paper seems to, the depth of the circles' centre against the reading of the front, "
            f"the error would be {gap or 0:+.0f} mm in the median, the apple's radius. In {beside} "
            "pictures the apple that touches the measured one was located instead of it: a "
            "region gets one circle."
        ),
        method=(
            "A reading belongs to the apple that the operator named, or else to the located "
            "apple whose sphere its beam meets first; the predicted range along the beam to that "
            "sphere's front is compared with the reading. Readings whose apple was not located "
            "stand in the table. A reading more than 10 mm short of the true front met something "
            "before the apple (a leaf): it is kept, and counted. The exact place is the other "
            "truth: of the apple, or of one that touches it where that was located instead (the "
            "paper does not say which of two adjacent fruits it measured). Figure: any radius."
        ),
        material=material,
        claims=(
            Claim("largest error of a measurement", PAPER_LIMIT_MM, worst, "mm", 1,
                  verdict=verdict, sentence="the paper: all less than 20 mm"),
            Claim("measurements within 20 mm", 100.0, within, "%", 1, verdict=verdict,
                  sentence=f"{blocked} of {len(wide)} beams met something before their apple"),
            Claim("largest error against the exact place", PAPER_LIMIT_MM, worst_exact, "mm", 1,
                  verdict="not scored" if worst_exact is None else
                  "holds" if worst_exact < PAPER_LIMIT_MM else "does not hold",
                  sentence="without the rangefinder's own part in it"),
            Claim("readings whose apple is located, 30 to 60 px", 100.0,
                  100 * located / len(mine) if mine else None, "%", 0,
                  verdict="holds" if mine and located == len(mine) else "does not hold",
                  sentence="30 to 60 px are about 770 to 1540 mm with this lens, not 400"),
        ),
        tables=(
            Table("fig8", "Readings and errors by condition.", _COLUMNS, table),
            Table("fig8_ranges", "Mean error at each range against the rangefinder, mm; "
                  "any radius.", _range_columns(by_truth["error_mm"]),
                  _range_rows(by_truth["error_mm"])),
            Table("fig8_exact", "Mean error at each range against the exact place, mm; any "
                  "radius.", _range_columns(by_truth["located_mm"]),
                  _range_rows(by_truth["located_mm"])),
        ),
        figures=(Figure("fig8", "Errors against range, in five conditions. (a) Against the "
                        "rangefinder, (b) against the exact place. The band is the paper's "
                        "20 mm.", draw(by_truth)),),
    )  # fmt: skip


_COLUMNS: Final = {
    "method": Column("method"), "condition": Column("condition"),
    "readings": Column("readings", 0), "compared": Column("compared", 0),
    "not_located": Column("apple not located", 0), "no_echo": Column("no echo", 0),
    "blocked": Column("something before it", 0), "beside": Column("its neighbour located", 0),
    "bias": Column("bias, mm"),
    "rmse": Column("RMSE, mm"), "worst": Column("largest, mm"),
    "within": Column("within 20 mm, %", 0), "exact_bias": Column("exact: bias, mm"),
    "exact_rmse": Column("RMSE, mm"),
}  # fmt: skip


def _condition_row(method: str, condition: str, rows: Sequence[Row]) -> dict[str, Scalar]:
    mine = [r for r in rows if r["method"] == method and condition_of(r) == condition]
    if not mine:
        return {}
    errors, exact = np.array(array_of(mine, "error_mm")), np.array(array_of(mine, "located_mm"))
    return {
        "method": method,
        "condition": condition,
        "readings": len(mine),
        "compared": len(errors),
        "not_located": sum(
            r["belongs"] in ("named apple not located", "no located apple") for r in mine
        ),
        "no_echo": sum(r["belongs"] == "no echo" for r in mine),
        "blocked": sum(bool(r.get("blocked")) for r in mine),
        "beside": sum(r.get("beside_it_mm") is not None for r in mine),
        "bias": float(errors.mean()) if len(errors) else None,
        "rmse": float(np.sqrt((errors**2).mean())) if len(errors) else None,
        "worst": float(np.abs(errors).max()) if len(errors) else None,
        "within": 100 * float((np.abs(errors) < PAPER_LIMIT_MM).mean()) if len(errors) else None,
        "exact_bias": float(exact.mean()) if len(exact) else None,
        "exact_rmse": float(np.sqrt((exact**2).mean())) if len(exact) else None,
    }


def _range_columns(by_condition: Measurements) -> dict[str, Column]:
    return {"range": Column("range, mm", 0)} | {name: Column(name) for name in by_condition}


def _range_rows(by_condition: Measurements) -> list[dict[str, Scalar]]:
    ranges = sorted({near for by_range in by_condition.values() for near in by_range})
    return [
        {"range": near, **{name: by_range.get(near) for name, by_range in by_condition.items()}}
        for near in ranges
    ]


def draw(by_truth: dict[str, Measurements]) -> bytes:
    """A panel for each truth."""
    with charts.drawing(7.0, 3.4) as (sheet, done):
        panels = sheet.subplots(1, 2, sharey=True)
        for axes, (error, truth), letter in zip(panels, TRUTHS.items(), "ab", strict=True):
            _draw_errors(axes, by_truth[error])
            axes.set_title(f"({letter}) against the {truth}")
            axes.set_xlabel("range, mm")
        panels[0].set_ylabel("error, mm")
        handles, labels = panels[0].get_legend_handles_labels()
        if handles:
            sheet.legend(handles, labels, loc="outside lower center", ncols=3)
    return done[0]


def _draw_errors(axes: "Axes", by_condition: Measurements) -> None:
    axes.axhspan(-PAPER_LIMIT_MM, PAPER_LIMIT_MM, color="#eeeeee", lw=0)
    axes.axhline(0, color=charts.GREY, lw=0.8)
    for number, condition in enumerate(CONDITIONS.values()):
        by_range = by_condition.get(condition, {})
        if by_range:
            axes.plot(list(by_range), list(by_range.values()), label=condition,
                      color=charts.SERIES[number], marker=charts.MARKERS[number])  # fmt: skip
    axes.set_xlim(350, 1550)
