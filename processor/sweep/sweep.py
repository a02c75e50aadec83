"""A sweep, from sessions to a folder: one Parquet file, a report, the best setting as a method."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from processor.experiments.material import Source
from processor.experiments.work import Tick
from processor.measures import Measure
from processor.methods import to_toml
from processor.results import Row, sweep_schema, write_table
from processor.sweep.chart import draw_effects
from processor.sweep.effects import Found, find
from processor.sweep.report import as_document, as_markdown, as_page
from processor.sweep.run import run
from processor.sweep.settings import Setting
from processor.sweep.splits import Splits
from recorder.errors import PomologError
from recorder.files import only_writer, replacing, writable, write_text

MOST_ROWS: Final = 1_000_000  # they are held in memory together: a kilobyte or two each


@dataclass(frozen=True, slots=True)
class Swept:
    """A sweep, done.

    Attributes:
        found: what it says.
        splits: train and test.
        document: for JSON.
    """

    found: Found
    splits: Splits
    document: dict[str, Any]


def sweep(
    settings: tuple[Setting, ...],
    sources: Sequence[Source],
    splits: Splits,
    measure: Measure,
    out: Path,
    *,
    seed: int = 0,
    workers: int = 1,
    tick: Tick = lambda _: None,
) -> Swept:
    """Run every setting on every pair, and write what was found.

    Args:
        settings: of the method.
        sources: the sessions.
        splits: which pairs are train.
        measure: what the best is chosen by.
        out: gets sweep.parquet, sweep.md, sweep.html, effects.png and best.toml.
        seed: of every random number.
        workers: processes; 1 works here.
        tick: called with the number of pairs that are done.

    Raises:
        PomologError: too many rows, a session is damaged, or `out` cannot be written.
    """
    pairs = sum(source.total for source in sources)
    if len(settings) * pairs > MOST_ROWS:
        raise PomologError(
            f"{len(settings):,} settings of {pairs:,} pairs are more than {MOST_ROWS:,} rows; vary "
            "less at once, or give fewer sessions"
        )
    with writable(out):
        out.mkdir(parents=True, exist_ok=True)
    with only_writer(out):
        rows = run(settings, sources, out, seed=seed, workers=workers, tick=tick)
        found = find(measure, settings, rows, splits)
        write_table(
            out / "sweep.parquet",
            [_with_values(row, settings, splits) for row in rows],
            sweep_schema(list(settings[0].values)),
        )
        chart = draw_effects(found, settings)
        with replacing(out / "effects.png") as part:
            part.write_bytes(chart)
        write_text(out / "sweep.md", as_markdown(found, settings, splits))
        write_text(out / "sweep.html", as_page(found, settings, splits, chart))
        if found.best is not None:
            write_text(out / "best.toml", to_toml("best", found.best.setting.locator) + "\n")
    return Swept(found, splits, as_document(found, settings, splits))


def _with_values(row: Row, settings: Sequence[Setting], splits: Splits) -> Row:
    split = splits.of[row["session"], row["frame"]]
    return row | settings[row["setting"]].values | {"split": split}
