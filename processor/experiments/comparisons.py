"""Table 2: four t-tests as the paper made them, and what it takes to say that errors are alike."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy import stats

from processor import charts
from processor.experiments.distance_figure import figure_8
from processor.experiments.distances import TRUTHS, Measurements, measure_distances
from processor.experiments.distances import measurements as measured
from processor.experiments.item import Claim, Item, Verdict
from processor.experiments.material import Material, describe
from processor.experiments.work import Bench, Row
from processor.page_parts import Column, Figure, Scalar, Table
from processor.statistics import (
    TTest,
    detectable_effect,
    equivalence_p,
    holm,
    paired,
    t_table,
    unpaired,
)

# Table 2: pair of conditions -> its t and whether the paper calls it significant
PAPER: Final = {
    ("indoor no occlusion", "outdoor front lighting"): (0.12, False),
    ("outdoor front lighting", "outdoor back lighting"): (-0.86, False),
    ("indoor no occlusion", "indoor with occlusion"): (3.24, True),
    ("indoor no occlusion", "indoor adjacent fruits"): (1.01, False),
}
PAPER_N: Final = 12  # ranges in each condition
ENOUGH_N: Final = 9  # three quarters of them; of fewer, a "no" says nothing
PAPER_DF: Final = 22
MARGIN_MM: Final = 10.0  # half of the paper's 20 mm: errors that differ by less are alike


def distances(material: Material, bench: Bench) -> tuple[Item, ...]:
    """Fig. 8 and Table 2, from the same measurements."""
    sources = material.of("distance")
    rows = bench.rows(measure_distances, sources)
    if not rows:
        reason = "these sessions have no rangefinder readings"
        return (Item("fig8", "Fig. 8", "Distance error", not_run=reason),
                Item("table2", "Table 2", "Are the errors alike?", not_run=reason))  # fmt: skip
    about = describe(sources)
    return figure_8(rows, about), table_2(rows, about)


def table_2(rows: Sequence[Row], material: str) -> Item:
    """The four comparisons, unpaired and paired, against both truths."""
    by_truth = {truth: measured(rows, error) for error, truth in TRUTHS.items()}
    tables = {truth: compared(by_condition) for truth, by_condition in by_truth.items()}
    absolute = compared({
        condition: {near: abs(error) for near, error in by_range.items()}
        for condition, by_range in by_truth["exact place"].items()
    })  # fmt: skip
    claims, chosen = [], []
    for place, names in enumerate(PAPER):
        truth = _better_supported({truth: table[place] for truth, table in tables.items()})
        chosen.append(tables[truth][place])
        claims.append(_claim("t", names, chosen[-1], f"against the {truth}"))
    claims += [
        _claim("t of absolute errors", names, row, "against the exact place")
        for names, row in zip(PAPER, absolute, strict=True)
    ]
    alike = sum(isinstance(r["p_tost"], float) and r["p_tost"] < 0.05 for r in chosen)
    tested = sum(r["p_tost"] is not None for r in chosen)
    smallest = detectable_effect(PAPER_N)
    return Item(
        id="table2",
        source="Table 2",
        title="Do light, occlusion and neighbours change the error?",
        summary=(
            "The paper concludes that light and neighbours do not matter from t-tests of 12 "
            f"against 12 measurements. Such a test finds a difference of {smallest:.1f} standard "
            "deviations in four cases of five, and smaller ones mostly not: its “no” is weak. "
            f"Here {alike} of the {tested} comparisons that can be made are shown to be alike "
            f"within {MARGIN_MM:.0f} mm by an equivalence test."
        ),
        method=(
            "A measurement is the mean error of the readings at one range, signed, any radius, "
            "against the rangefinder or, where that leaves fewer than nine, the exact place. "
            "As the paper made it: Student's t-test of two independent groups (df = 22 with 12 "
            "ranges each, t table 2.07). Properly: the ranges are the same, so the test is paired "
            "(df = 11, t table 2.20); four tests together need Holm's correction; and “alike” "
            "needs two one-sided tests (TOST) within 10 mm, here paired. Signed errors compare "
            "means alone; what hides a fruit makes errors larger either way, so absolute errors "
            "are compared too (the paper does not say which it took). d: Cohen's, d_z: of the "
            "paired differences, both with Hedges' correction."
        ),
        material=material,
        claims=tuple(claims),
        tables=(
            *(Table(f"table2_{'rangefinder' if truth == 'rangefinder' else 'exact'}",
                    f"The four comparisons, errors against the {truth}.", _COLUMNS, table)
              for truth, table in tables.items()),
            Table("table2_absolute", "The four comparisons of absolute errors, against the exact "
                  "place: what hides a fruit spreads its errors and need not move their mean.",
                  _COLUMNS, absolute),
            Table("table2_paper", "What the paper's own t-values say, at df = 22.",
                  _PAPERS, papers_own()),
        ),
        figures=(Figure("table2", "Differences of mean error with their 95 % intervals, paired "
                        "(filled) and unpaired (open); inside the band they are alike within "
                        "10 mm.", draw(by_truth)),),
    )  # fmt: skip


def _claim(what: str, names: tuple[str, str], row: dict[str, Scalar], against: str) -> Claim:
    """Whether a test finds significant what the paper found significant."""
    t, significant = PAPER[names]
    mine = row["t"]
    assert mine is None or isinstance(mine, float)
    few = _smaller_n(row) < ENOUGH_N and row["significant"] == "no"
    verdict: Verdict = (
        "not scored" if mine is None or few
        else "holds" if (row["significant"] == "yes") == significant else "does not hold"
    )  # fmt: skip
    sentence = (
        f"{against}, n = {row['n_first']} and {row['n_second']}: significant "
        f"{row['significant']} (the paper: {'yes' if significant else 'no'})"
        + (", too few to tell" if few else "")
        if mine is not None else "a condition has fewer than two measurements"
    )  # fmt: skip
    return Claim(f"{what}, {names[0]} / {names[1]}", t, mine, "", 2, verdict=verdict,
                 sentence=sentence)  # fmt: skip


def _better_supported(rows: Mapping[str, dict[str, Scalar]]) -> str:
    """The rangefinder, as in the paper; the exact place where too few readings can be compared."""
    first, second = rows
    return first if _smaller_n(rows[first]) >= ENOUGH_N else max(
        (first, second), key=lambda truth: _smaller_n(rows[truth])
    )  # fmt: skip


def _smaller_n(row: dict[str, Scalar]) -> int:
    return min(int(row["n_first"] or 0), int(row["n_second"] or 0))


def compared(by_condition: Measurements) -> list[dict[str, Scalar]]:
    """A row a comparison; Holm's correction over those that can be made."""
    rows = [_compare(*names, by_condition) for names in PAPER]
    for p, corrected in (("p", "p_holm"), ("p_paired", "p_paired_holm")):
        known = [row for row in rows if row[p] is not None]
        values = [v for row in known if isinstance(v := row[p], float)]
        for row, value in zip(known, holm(values), strict=True):
            row[corrected] = value
    return rows


def _tests(
    first: str, second: str, by_condition: Measurements
) -> tuple[TTest | None, TTest | None]:
    a, b = by_condition.get(first, {}), by_condition.get(second, {})
    common = sorted(set(a) & set(b))
    return (
        unpaired(list(a.values()), list(b.values())),
        paired([a[near] for near in common], [b[near] for near in common]),
    )


def _compare(first: str, second: str, by_condition: Measurements) -> dict[str, Scalar]:
    apart, together = _tests(first, second, by_condition)
    row: dict[str, Scalar] = {
        "pair": f"{first} / {second}",
        "n_first": len(by_condition.get(first, {})),
        "n_second": len(by_condition.get(second, {})),
        "t_paper": PAPER[first, second][0],
        **dict.fromkeys(_UNPAIRED),
        **dict.fromkeys(_PAIRED),
    }
    if apart is not None:
        row |= {
            "t": apart.t, "t_table": apart.t_table, "p": apart.p, "d": apart.effect_unbiased,
            "significant": "yes" if apart.significant else "no",
        }  # fmt: skip
    if together is not None:
        row |= {
            "n_paired": together.n, "difference": together.difference, "low": together.low,
            "high": together.high, "t_paired": together.t, "t_paired_table": together.t_table,
            "p_paired": together.p, "d_z": together.effect_unbiased,
            "p_tost": equivalence_p(together, MARGIN_MM),
        }  # fmt: skip
    return row


_UNPAIRED: Final = ("t", "t_table", "significant", "p", "p_holm", "d")
_PAIRED: Final = (
    "n_paired", "difference", "low", "high", "t_paired", "t_paired_table", "p_paired",
    "p_paired_holm", "d_z", "p_tost",
)  # fmt: skip
_COLUMNS: Final = {
    "pair": Column("sample pair"), "n_first": Column("n", 0), "n_second": Column("n", 0),
    "t_paper": Column("paper's t", 2), "t": Column("t", 2), "t_table": Column("t table", 2),
    "significant": Column("significant"), "p_holm": Column("p, Holm", 3), "d": Column("d", 2),
    "n_paired": Column("pairs", 0), "difference": Column("difference, mm"),
    "low": Column("from"), "high": Column("to"), "t_paired": Column("paired t", 2),
    "t_paired_table": Column("t table", 2), "p_paired_holm": Column("p, Holm", 3),
    "d_z": Column("d_z", 2), "p_tost": Column("TOST p, 10 mm", 3),
}  # fmt: skip
_PAPERS: Final = {
    "pair": Column("sample pair"), "t": Column("t", 2), "t_table": Column("t table", 2),
    "p": Column("p", 3), "p_holm": Column("p, Holm", 3), "d": Column("d", 2),
}  # fmt: skip


def papers_own() -> list[dict[str, Scalar]]:
    """The p-values, Holm's, and effect sizes that follow from the paper's t-values alone."""
    p_values = [float(2 * stats.t.sf(abs(t), PAPER_DF)) for t, _ in PAPER.values()]
    return [
        {
            "pair": " / ".join(names),
            "t": t,
            "t_table": t_table(PAPER_DF),
            "p": p,
            "p_holm": corrected,
            "d": float(t * np.sqrt(2 / PAPER_N)),
        }
        for (names, (t, _)), p, corrected in zip(
            PAPER.items(), p_values, holm(p_values), strict=True
        )
    ]


def draw(by_truth: dict[str, Measurements]) -> bytes:
    """The comparisons' intervals, a panel a truth."""
    ends = [
        abs(end)
        for by_condition in by_truth.values()
        for names in PAPER
        for test in _tests(*names, by_condition)
        if test is not None
        for end in (test.low, test.high)
    ]
    reach = float(np.clip(1.05 * max(ends, default=0.0), 2 * MARGIN_MM, 120.0))
    with charts.drawing(7.0, 3.0) as (sheet, done):
        panels = sheet.subplots(1, 2, sharey=True, sharex=True)
        for axes, (truth, by_condition) in zip(panels, by_truth.items(), strict=True):
            axes.axvspan(-MARGIN_MM, MARGIN_MM, color="#eeeeee", lw=0)
            axes.axvline(0, color=charts.GREY, lw=0.8)
            for place, names in enumerate(PAPER):
                tests = _tests(*names, by_condition)
                for test, aside, fill in zip(tests, (0.14, -0.14), ("white", charts.BLUE),
                                             strict=True):  # fmt: skip
                    if test is not None:
                        axes.errorbar(
                            test.difference, place + aside, color=charts.BLUE, marker="o", mfc=fill,
                            xerr=[[test.difference - test.low], [test.high - test.difference]],
                            capsize=2, lw=1.2,
                        )  # fmt: skip
            axes.set_title(f"against the {truth}")
            axes.set_xlabel("difference of mean error, mm")
            axes.set_yticks(range(len(PAPER)), [f"{a} /\n{b}" for a, b in PAPER])
            axes.set_ylim(len(PAPER) - 0.5, -0.5)
            axes.set_xlim(-reach, reach)
    return done[0]
