"""The viewer's commands: view, report, sheet and demo."""

import json
import shutil
from pathlib import Path
from typing import Annotated

import typer

from recorder.errors import PomologError

app = typer.Typer(
    add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip

DEMO_SESSION = Path(__file__).parent.parent / "sessions" / "demo.mcap"


@app.callback()
def _viewer() -> None:
    """Open runs and sessions."""


@app.command(epilog="Example: pomolog view results")
def view(
    path: Annotated[Path, typer.Argument(metavar="OUT|S", help="Results, or a session.")],
    web: Annotated[bool, typer.Option("--web", help="Serve to a browser on this machine.")] = False,
) -> None:
    """Open results (or a session without any) in Rerun, laid out by question."""
    from viewer.open import lay_out, open_viewer, recordings

    open_viewer(lay_out(recordings(path)), web=web)


@app.command(epilog="Example: pomolog report results -o report.html")
def report(
    out: Annotated[list[Path], typer.Argument(metavar="OUT...", help="Folders of results.")],
    page: Annotated[Path, typer.Option("--out", "-o", help="The page to write (.html).")],
    by: Annotated[str, typer.Option(help="Score by this condition; if none, lighting.")] = "",
    worst: Annotated[int, typer.Option(min=0, help="Worst cases to show, of each method.")] = 10,
    session: Annotated[
        list[Path] | None, typer.Option(help="Where a session lies now; a file or a folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """One page to send: what was run, the score, plots, the ledger, the worst cases in pictures."""
    from recorder.files import replacing
    from recorder.progress import progress
    from viewer.report import make_report, steps
    from viewer.report_columns import columns_of

    columns = columns_of(out, by)
    with replacing(page) as part:
        with progress("reporting", steps(columns, worst)) as tick:
            made = make_report(columns, out, worst=worst, moved=session or (), tick=tick)
        part.write_text(made.html, encoding="utf-8")
    size = page.stat().st_size
    if as_json:
        print(json.dumps({"report": str(page), "bytes": size, **made.told}, indent=2))
    else:
        print(f"{page}: {size / 1e6:.1f} MB")


@app.command(epilog="Example: pomolog sheet results/demo --frame 3 -o sheet.png")
def sheet(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Results of one session.")],
    frame: Annotated[int, typer.Option(min=0, help="Which pair of the session.")],
    picture: Annotated[Path, typer.Option("--out", "-o", help="The picture to write (.png).")],
    session: Annotated[
        Path | None, typer.Option(help="Where the session lies now; a file or a folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Every stage of one frame in one picture; the frame is located again, as the run did it."""
    from recorder.files import replacing
    from viewer.sheet import make_sheet

    with replacing(picture) as part:
        made = make_sheet(out, frame, [session] if session else ())
        part.write_bytes(made.png)
    if as_json:
        print(json.dumps({"sheet": str(picture), **made.told}, indent=2))
    else:
        print(f"{picture}: {' x '.join(map(str, made.told['size_px']))} px")


@app.command(epilog="Example: pomolog demo")
def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")] = Path(
        "results/demo"
    ),
    method: Annotated[str, typer.Option(help="A named method, or a .toml file.")] = "paper",
) -> None:
    """Replay the session that comes with pomolog, score it by lighting, say how to look at it."""
    import os

    from rich.console import Console

    from processor.methods import load_method
    from processor.replay import replay
    from processor.runs import find_runs, score_runs
    from processor.tables import score_table
    from recorder.progress import progress
    from recorder.session import read_info
    from viewer.open import lay_out, recordings

    session = DEMO_SESSION if DEMO_SESSION.is_file() else _drawn(out)
    name, locator = load_method(method)
    workers = os.cpu_count() or 1
    with progress("replaying", read_info(session).pairs) as tick:
        for outcome in replay([session], out, locator, method=name, workers=workers, tick=tick):
            if isinstance(outcome, PomologError):
                raise outcome
    groups = score_runs(find_runs([out]), "lighting")
    console = Console()
    console.print(f"method {name} on {session.name}, by lighting:")
    console.print(score_table(groups))
    found = recordings(out)
    lay_out(found)
    for recording in found:
        console.print(f"recording: {recording}", soft_wrap=True, highlight=False)
    command = "pomolog" if shutil.which("pomolog") else ".venv/bin/pomolog"
    console.print(f"look at it with:  {command} view {out}", soft_wrap=True, highlight=False)


def _drawn(out: Path) -> Path:
    """A drawn session beside the results: pomolog is installed without its sessions."""
    from recorder.sketch import sketch

    session = out.with_name(f"{out.name}.mcap")
    if not session.is_file():
        sketch(session)
        typer.echo(f"{session}: drawn, for the recorded sessions are not here", err=True)
    return session
