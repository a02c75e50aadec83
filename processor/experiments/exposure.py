"""Sec. 3.3: hits and false positives against exposure; the paper only says it fails."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from processor import charts
from processor.experiments.item import Claim, Item, Verdict
from processor.experiments.material import LIGHTS, Material, describe
from processor.experiments.segmentation import RULE_OF_METHOD, measure_pixels
from processor.experiments.work import Bench, Row
from processor.page_parts import Column, Figure, Scalar, Table, percent, shown
from processor.score import detection
from processor.statistics import bootstrap_shares

RULES: Final = ("signed", "difference", "absolute", "2R-G-B", "Y-R")
NOTICED: Final = 5.0  # points of hits lost that count as "did not work well"


def exposure(material: Material, bench: Bench, rng: np.random.Generator) -> tuple[Item, ...]:
    """The curve over all exposure sessions."""
    sources = material.of("exposure")
    rows = bench.rows(measure_pixels, sources)
    rows = [r for r in rows if r["fp"] is not None and r.get("exposure_ev") is not None]
    if not rows:
        return (Item("exposure", "Sec. 3.3", "Over- and under-exposure",
                     not_run="no note of these sessions says an exposure"),)  # fmt: skip
    return (report(rows, describe(sources), rng),)


def report(rows: Sequence[Row], material: str, rng: np.random.Generator) -> Item:
    """Hits and false positives by light, rule and exposure."""
    lights = [light for light in LIGHTS if any(r["lighting"] == light for r in rows)]
    stops = sorted({float(r["exposure_ev"]) for r in rows})
    table = [
        _row(light, rule, stop, rows, rng) for light in lights for rule in RULES for stop in stops
    ]
    claims, lost = [], []
    for light in lights:
        mine = {
            float(r["ev"] or 0): float(r["hits"] or 0)
            for r in table
            if r["light"] == light and r["rule"] == RULE_OF_METHOD
        }
        metered = mine[min(mine, key=abs)]
        for stop in (stops[0], stops[-1]):
            change = mine[stop] - metered
            lost.append(change)
            holds: Verdict = "holds" if change < -NOTICED else "does not hold"
            name = f"{light}: change of hits at {_signed(stop)} EV"
            said = "the paper: it “did not work well”, without a number"
            claims.append(Claim(name, None, change, "points", verdict=holds, sentence=said))
    worst, best = min(lost), max(lost)
    return Item(
        id="exposure",
        source="Sec. 3.3",
        title="Over- and under-exposure",
        summary=(
            f"From metered exposure to {_signed(stops[0])} and {_signed(stops[-1])} EV the hits "
            f"of the paper's rule change by {_signed(best)} to {_signed(worst)} points, by light "
            "and end. Where a channel is clipped, the differences that the rule lives on are gone."
        ),
        method="The same rendered light exposed at every step, so that nothing but exposure "
        f"differs; pixels summed over both views. “Did not work well” is taken as more than "
        f"{NOTICED:.0f} points of hits lost.",
        material=material,
        claims=tuple(claims),
        tables=(Table("exposure", "Hits and false positives by exposure, %.", _COLUMNS, table),),
        figures=(Figure("exposure", "Hits (above) and false positives (below) against exposure.",
                        draw(table, lights)),),
    )  # fmt: skip


def _signed(value: float) -> str:
    return shown(round(float(value), 1), 0, signed=True)


_COLUMNS: Final = {
    "light": Column("light"), "rule": Column("rule"), "ev": Column("EV"),
    "pictures": Column("pictures", 0), "hits": Column("hits"), "low": Column("from"),
    "high": Column("to"), "false_positive": Column("false pos."), "recall": Column("recall"),
    "precision": Column("precision"),
}  # fmt: skip


def _row(
    light: str, rule: str, stop: float, rows: Sequence[Row], rng: np.random.Generator
) -> dict[str, Scalar]:
    mine = [
        r for r in rows
        if r["lighting"] == light and r["rule"] == rule and r["exposure_ev"] == stop
    ]  # fmt: skip
    found = detection([(r["tp"], r["fp"], r["fn"]) for r in mine])
    pairs: dict[tuple[str, int], list[int]] = {}
    for r in mine:
        total = pairs.setdefault((r["session"], r["frame"]), [0, 0])
        total[0] += r["tp"]
        total[1] += r["tp"] + r["fp"] + r["fn"]
    sums = list(pairs.values())
    interval = bootstrap_shares([s[0] for s in sums], [s[1] for s in sums], rng) or (None, None)
    nothing = (None,) * 4
    hits, false, recall, precision = (
        (found.hit, found.false_positive, found.recall, found.precision) if found else nothing
    )
    return {
        "light": light, "rule": rule, "ev": stop, "pictures": len(mine),
        "hits": percent(hits), "low": percent(interval[0]),
        "high": percent(interval[1]), "false_positive": percent(false),
        "recall": percent(recall), "precision": percent(precision),
    }  # fmt: skip


def draw(table: Sequence[dict[str, Scalar]], lights: Sequence[str]) -> bytes:
    """Hits above, false positives below, a column a light."""
    with charts.drawing(7.0, 3.8) as (sheet, done):
        panels = sheet.subplots(2, len(lights), sharex=True, sharey="row", squeeze=False)
        for column, light in enumerate(lights):
            for number, rule in enumerate(RULES):
                mine = [r for r in table if r["light"] == light and r["rule"] == rule]
                stops = [float(r["ev"] or 0) for r in mine]
                for line, what in enumerate(("hits", "false_positive")):
                    values = [v if isinstance(v := r[what], float) else np.nan for r in mine]
                    panels[line][column].plot(
                        stops, values, color=charts.SERIES[number], label=rule,
                        marker=charts.MARKERS[number], lw=2 if rule == RULE_OF_METHOD else 1.1,
                    )  # fmt: skip
            panels[0][column].set_title(light)
            panels[1][column].set_xlabel("exposure, EV from metered")
        panels[0][0].set_ylabel("hits, %")
        panels[1][0].set_ylabel("false positives, %")
        for axes in panels.ravel():
            axes.set_ylim(0, 100)
        handles, labels = panels[0][0].get_legend_handles_labels()
        sheet.legend(handles, labels, loc="outside lower center", ncols=len(RULES))
    return done[0]
