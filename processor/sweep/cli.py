"""The command sweep."""

import json
import os
from pathlib import Path
from typing import Annotated

import typer

from recorder.commands import AsJson, command_group
from recorder.errors import PomologError

app = command_group()


@app.command(epilog="Example: pomolog sweep S.mcap --vary circles.rounds=5,10,20 -o out")
def sweep(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")],
    vary: Annotated[list[str], typer.Option(help="STAGE=ALTERNATIVE,... or STAGE.PARAMETER=...")],
    sessions: Annotated[list[Path] | None, typer.Argument(metavar="S...", help="Sessions.")] = None,
    method: Annotated[str, typer.Option(help="What is varied: a name, or a .toml.")] = "paper",
    measure: Annotated[str, typer.Option(help="What the best is chosen by.")] = "fruit_f1",
    train: Annotated[list[Path] | None, typer.Option(help="A session to choose on.")] = None,
    test: Annotated[list[Path] | None, typer.Option(help="A session to report on.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of every random number.")] = 0,
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0 is one a core.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Try every combination of values; choose the best on train, say its worth on test.

    Stages that settings share are computed once. Killed and run again, it goes on.
    """
    from processor.measures import WITH_TRUTH
    from processor.methods import load_method
    from processor.sweep.run import open_sources
    from processor.sweep.settings import parse_vary, settings_of
    from processor.sweep.splits import split_up
    from processor.sweep.sweep import sweep as run
    from recorder.progress import progress

    measures = {one.name: one for one in WITH_TRUTH}
    if measure not in measures:
        raise PomologError(f"no measure {measure!r}; choose by {', '.join(measures)}")
    if bool(train) != bool(test):
        raise PomologError("give both --train and --test, or neither")
    paths = list(dict.fromkeys([*(sessions or ()), *(train or ()), *(test or ())]))
    if not paths:
        raise typer.BadParameter("no sessions", param_hint="S...")
    settings = settings_of(load_method(method)[1], parse_vary(vary))
    sources = open_sources(paths)
    splits = split_up(sources, train or (), test or ())
    with progress("sweeping", sum(source.total for source in sources)) as tick:
        done = run(
            settings, sources, splits, measures[measure], out,
            seed=seed, workers=workers or os.cpu_count() or 1, tick=tick,
        )  # fmt: skip
    if as_json:
        print(json.dumps(done.document, indent=2))
        return
    from processor.sweep.report import summary

    for line in summary(done.found, splits):
        print(line)
    print(f"the page: {out / 'sweep.html'}; rows: {out / 'sweep.parquet'}")
