"""Sec. 3.3: the processing cycle, from two encoded pictures to located fruit, stage by stage."""

import platform
from collections.abc import Sequence
from dataclasses import replace
from time import perf_counter_ns
from typing import Final

import numpy as np

from processor import charts
from processor.experiments.item import Claim, Item
from processor.experiments.material import Material, describe
from processor.experiments.work import Bench, Row, Sample
from processor.locate import Locator
from processor.page_parts import Column, Figure, Scalar, Table
from processor.results import STAGES
from recorder.pictures import decode

PAPER_MS: Final = 2350.0  # Sec. 3.3, on a Core 2 Duo of 2.4 GHz
PAPER_HARVEST_MS: Final = 45_000.0
MOST_PAIRS: Final = 12  # of each session: the median needs no more
ROUNDS: Final = 3  # of each pair, after one that warms caches up


def measure_cycle(sample: Sample) -> list[Row]:
    """Stage times of the paper's method, one thread, the same pair several times."""
    locator, rows = Locator(), []
    for number in range(ROUNDS + 1):
        before = perf_counter_ns()
        left, right = decode(sample.pair.left), decode(sample.pair.right)
        decode_ns = perf_counter_ns() - before
        trace = locator(left, right, sample.rectification, sample.seed)
        if number:
            rows.append({"decode": decode_ns, **trace.stage_ns, "size_px": list(left.shape[1::-1])})
    return rows


def cycle(material: Material, bench: Bench) -> tuple[Item, ...]:
    """Measured in this process, one pair after another: two at once would slow each other."""
    sources = tuple(
        replace(s, pairs=s.pairs[:MOST_PAIRS], settings=s.settings[:MOST_PAIRS])
        for s in material.of("matching")
    )
    rows = replace(bench, pool=None).rows(measure_cycle, sources)
    return (report(rows, describe(sources)),)


def report(rows: Sequence[Row], material: str) -> Item:
    """Medians by stage, and their sum's ratio to the paper's cycle."""
    stages = {stage: np.array([r[stage] for r in rows]) / 1e6 for stage in STAGES}
    whole = sum(stages.values(), np.zeros(len(rows)))
    table: list[dict[str, Scalar]] = []
    for name, times in {**stages, "whole cycle": whole}.items():
        low, middle, high = np.percentile(times, [10, 50, 90]).tolist()
        table.append({"stage": name, "median": middle, "p10": low, "p90": high,
                      "share": 100 * middle / float(np.median(whole))})  # fmt: skip
    cycle_ms = float(np.median(whole))
    low, high = np.percentile(whole, [10, 90]).tolist()
    size = "x".join(map(str, rows[0]["size_px"]))
    return Item(
        id="cycle",
        source="Sec. 3.3",
        title="The processing cycle",
        summary=(
            f"Both pictures ({size} px) are decoded and their fruit located in {cycle_ms:.0f} ms "
            f"(one thread of this {platform.machine()} machine), {cycle_ms / PAPER_MS:.3f} of the "
            f"paper's 2350 ms on a Core 2 Duo, and {100 * cycle_ms / PAPER_HARVEST_MS:.1f} % of "
            "its harvesting cycle of 45 s. The machines are many years apart: the ratio says that "
            "the method is cheap, not that it became better."
        ),
        method=f"Decoding and every stage, of both views, one thread, {ROUNDS} rounds of each "
        "pair after one that is thrown away; medians, and the middle 80 %. The paper's cycle "
        "begins with acquisition, which a recorded session cannot repeat.",
        material=material,
        claims=(
            Claim("processing cycle", PAPER_MS, cycle_ms, "ms", 0, low, high, "holds",
                  "the interval is the middle 80 % of the rounds"),
            Claim("ratio to the paper's cycle", 1.0, cycle_ms / PAPER_MS, "", 3, verdict="holds",
                  sentence="another machine, many years younger"),
        ),
        tables=(Table("cycle", "Stage times of both views, ms.", _COLUMNS, table),),
        figures=(Figure("cycle", "Where the time goes: medians by stage.", draw(stages)),),
    )  # fmt: skip


_COLUMNS: Final = {
    "stage": Column("stage"), "median": Column("median", 2), "p10": Column("10 %", 2),
    "p90": Column("90 %", 2), "share": Column("share, %"),
}  # fmt: skip


def draw(stages: dict[str, "np.typing.NDArray[np.float64]"]) -> bytes:
    """One bar, in parts."""
    with charts.drawing(7.0, 1.5) as (sheet, done):
        axes = sheet.subplots()
        start = 0.0
        colours = (*charts.SERIES, charts.GREY)
        for (stage, times), colour in zip(stages.items(), colours, strict=True):
            middle = float(np.median(times))
            axes.barh(0, middle, left=start, color=colour, label=f"{stage} {middle:.1f}")
            start += middle
        axes.set_yticks([])
        axes.set_xlabel("ms a pair")
        sheet.legend(loc="outside upper center", ncols=len(stages), fontsize=7,
                     handlelength=0.9, columnspacing=0.9)  # fmt: skip
    return done[0]
