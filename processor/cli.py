"""The processor's commands: replay and score."""

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recorder.commands import AsJson, SessionArgument, command_group
from recorder.errors import PomologError
from recorder.words import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recorder.objects import Place

app = command_group()

exports = typer.Typer(no_args_is_help=True)
app.add_typer(
    exports,
    name="export",
    help="Give sessions and results to other tools.",
    epilog="Example: pomolog export bag S.mcap -o ros/S.mcap",
)


@app.command(epilog="Example: pomolog replay sessions/demo.mcap -o results --method paper")
def replay(
    sessions: Annotated[
        list[str], typer.Argument(metavar="S...", help="Sessions (.mcap), or s3://, gs://.")
    ],
    out: Annotated[
        str, typer.Option("--out", "-o", metavar="PATH", help="Folder for the results, or s3://.")
    ],
    method: Annotated[str, typer.Option(help="A name (pomolog methods), or a .toml.")] = "paper",
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0 is one a core.")] = 0,
    cluster: Annotated[
        str, typer.Option(metavar="ADDR", help="A Dask scheduler: tcp://10.0.0.1:8786.")
    ] = "",
    seed: Annotated[int, typer.Option(min=0, help="Of every random number.")] = 0,
    rrd: Annotated[str, typer.Option(help="full: draw recordings; none: rows only.")] = "full",
    as_json: AsJson = False,
) -> None:
    """Run a locator on sessions and keep every intermediate; run again, it goes on."""
    from processor.methods import load_method
    from processor.replay import replay as run
    from processor.replay import useful_workers
    from recorder.objects import as_place
    from recorder.progress import progress

    if rrd not in ("full", "none"):
        raise typer.BadParameter("full or none", param_hint="--rrd")
    name, locator = load_method(method)
    places = [as_place(words) for words in sessions]
    done, errors = [], []
    pairs = _count_pairs(places)
    with progress("replaying", sum(pairs)) as tick:
        for outcome in run(
            places,
            as_place(out),
            locator,
            method=name,
            seed=seed,
            workers=workers or useful_workers(pairs),
            cluster=cluster,
            rrd="full" if rrd == "full" else "none",
            tick=tick,
        ):
            if isinstance(outcome, PomologError):
                errors.append(outcome)
            else:
                done.append(outcome)
    if as_json:
        rows = [
            {"session": str(r.session), "out": str(r.out), "pairs": r.pairs, "seconds": r.seconds}
            for r in done
        ]
        print(json.dumps({"sessions": rows}, indent=2))
    else:
        for r in done:
            if r.warning:
                typer.echo(f"pomolog: warning: {r.warning}", err=True)
            how = "there already" if r.resumed else f"{r.seconds:.1f} s"
            print(f"{r.session}: {counted(r.pairs, 'pair')} -> {r.out} ({how})")
    if len(errors) > 1:
        for error in errors:
            typer.echo(f"pomolog: {' '.join(str(error).split())}", err=True)
        raise PomologError(
            f"{len(errors)} of {len(places)} sessions failed, {len(done)} are done; "
            "mend what is said above and run it again, it goes on"
        )
    if errors:
        others = f" ({len(done)} of {len(places)} sessions are done)" if done else ""
        raise PomologError(f"{errors[0]}{others}")


@app.command(epilog="Example: pomolog methods paper > mine.toml")
def methods(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="Print this one as TOML.")] = "",
) -> None:
    """List the named methods, or print one with all its parameters, to start your own from."""
    from processor.methods import LIMITS, METHODS, describe, load_method, to_toml

    if name:
        print(to_toml(*load_method(name)))
        return
    for known, locator in METHODS.items():
        stages = describe(locator)
        uses = ", ".join(stages[s]["use"] for s in ("recognise", "circles", "match"))
        limit = f"; {LIMITS[known]}" if known in LIMITS else ""
        print(f"{known:18} {uses}{limit}")


def _count_pairs(sessions: "Sequence[Place]") -> list[int]:
    """Of each session that can be opened; another says what is wrong when its turn comes."""
    from recorder.session import read_info

    counts = []
    for path in sessions:
        try:
            counts.append(read_info(path).pairs)
        except PomologError:
            continue
    return counts


@app.command(epilog="Example: pomolog score results --by lighting")
def score(
    out: Annotated[
        list[str], typer.Argument(metavar="OUT...", help="Folders of results, or s3://, gs://.")
    ],
    by: Annotated[str, typer.Option(help="Group by lighting, cultivar, ...; or method.")] = "",
    as_json: AsJson = False,
) -> None:
    """Hits, false positives, matches and distance errors of a run, from its counts."""
    from processor.runs import find_runs, losses, score_runs
    from recorder.objects import as_place

    runs = find_runs([as_place(words) for words in out])
    groups, lost = score_runs(runs, by), losses(runs)
    methods = sorted({str(run.about["method"]) for run in runs})
    if len(methods) > 1 and by != "method":
        typer.echo(
            f"pomolog: warning: {', '.join(methods)} are summed; apart: --by method", err=True
        )
    if as_json:
        scores = {name: asdict(score) for name, score in groups.items()}
        print(json.dumps({"groups": scores, "ledger": lost}, indent=2))
        return
    from rich.console import Console

    from processor.tables import score_table

    if by == "method" and len(methods) > 1:
        del groups["all"]  # methods summed say nothing of any
    Console().print(score_table(groups))
    if lost is not None:
        print("the recorder's ledger: " + ", ".join(f"{n} {what}" for what, n in lost.items()))


@app.command(epilog="Example: pomolog paper -o results/paper")
def paper(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for page, tables, figures.")],
    sessions: Annotated[
        Path, typer.Option(help="Folder of sessions, named by set as the digital orchard does.")
    ] = Path("sessions"),
    fraction: Annotated[
        float, typer.Option(min=0.001, max=1, help="Of each session's pairs, evenly.")
    ] = 1.0,
    only: Annotated[str, typer.Option(help="Items, comma between: table1,fig8, ...")] = "",
    real: Annotated[
        Path | None, typer.Option(help="Folder of real pictures to run what can be run on.")
    ] = None,
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0 is one a core.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Every table and figure of the paper, beside ours; killed and run again, it goes on."""
    from processor.experiments.material import find_material
    from processor.experiments.paper import chosen_items, make_paper, pairs_to_look_at
    from recorder.progress import progress

    asked = chosen_items(only, real=real is not None)
    material = find_material(sessions, fraction)
    with progress("reproducing", pairs_to_look_at(material, asked)) as tick:
        made = make_paper(
            material, out, only=asked, fraction=fraction, real=real,
            workers=workers or os.cpu_count() or 1, tick=tick,
        )  # fmt: skip
    if as_json:
        print(made.document, end="")
        return
    for item in made.items:
        state = f"not run: {item.not_run}" if item.not_run else item.summary
        print(f"{item.source}: {state}")
    print(f"the page: {out / 'paper.html'}")


@app.command(epilog="Example: pomolog train train.mcap --boxes photographs -o mine.npz")
def train(
    sessions: Annotated[list[Path], typer.Argument(metavar="S...", help="Labelled sessions.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The model to write (.npz).")],
    boxes: Annotated[Path | None, typer.Option(help="Photographs: images/, labels/.")] = None,
    network_rounds: Annotated[
        int, typer.Option(min=0, help="Passes to train the network of centres; 0 leaves it out.")
    ] = 100,
    as_json: AsJson = False,
) -> None:
    """Learn a model for method `pomolog`; an hour, most of it for a network (needs JAX).

    Use it with `model = "mine.npz"` in every stage of a method that has a model.
    """
    from processor.teach import teach

    def say(line: str) -> None:
        typer.echo(line, err=True)

    model = teach(sessions, boxes, out, network_rounds=network_rounds, say=say)
    if as_json:
        print(json.dumps({"model": model.name, "out": str(out)}, indent=2))
    else:
        print(f"{out}, its provenance in {out.with_suffix('.json')}")


@exports.command("bag", epilog="Example: pomolog export bag sessions/demo.mcap -o demo-ros.mcap")
def export_bag(
    session: SessionArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="X.mcap, or a bag's folder.")],
    as_json: AsJson = False,
) -> None:
    """Write a session as a ROS 2 bag (rosbag2, MCAP); `pomolog import bag` makes it whole again."""
    from recorder.exports.bag import export_bag as export
    from recorder.progress import progress
    from recorder.session import Session

    with Session(session) as opened, progress("exporting", opened.info().frames) as tick:
        count = export(opened, out, tick)
    if as_json:
        print(json.dumps({"out": str(out), "messages": count}))
    else:
        print(f"{out}: {count} messages")


@exports.command("frames", epilog="Example: pomolog export frames S.mcap -o pictures/")
def export_frames(
    session: SessionArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to make.")],
    as_json: AsJson = False,
) -> None:
    """Write a session's pictures (and depth) with its truth as COCO, for labelling tools.

    Label them there, export COCO (or labelme, CVAT, YOLO) and bring the labels back with
    `pomolog label S --coco FILE`: pictures find their frames by name.
    """
    from recorder.exports.frames import export_frames as export
    from recorder.progress import progress
    from recorder.session import Session

    with Session(session) as opened, progress("exporting", len(opened)) as tick:
        done = export(opened, out, tick)
    if as_json:
        print(json.dumps({"out": str(out), **asdict(done)}))
    else:
        depth = f", {done.depths} depth pictures" if done.depths else ""
        print(f"{out}: {counted(done.pictures, 'picture')}, {counted(done.labels, 'label')}{depth}")


@exports.command("results", epilog="Example: pomolog export results results/demo -o apples.csv")
def export_results(
    results: Annotated[list[Path], typer.Argument(metavar="OUT...", help="Folders of results.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="X.csv, X.jsonl or X.coco.json.")],
    table: Annotated[str, typer.Option(help="apples, frames or truth.")] = "apples",
    as_json: AsJson = False,
) -> None:
    """Write results as CSV, JSON lines, or COCO detections."""
    from processor.export import export_results as export
    from processor.results import TABLES
    from processor.runs import find_runs

    if table not in TABLES:
        raise typer.BadParameter(", ".join(TABLES), param_hint="--table")
    count = export(find_runs(results), out, table)
    print(json.dumps({"out": str(out), "rows": count}) if as_json else f"{out}: {count} rows")
