"""The viewer's commands: view, report, sheet and demo."""

import json
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recorder.commands import AsJson, command_group
from recorder.errors import PomologError

if TYPE_CHECKING:
    from processor.worst import Kind

app = command_group()

DEMO_SESSION = Path(__file__).parent.parent / "sessions" / "demo.mcap"


@app.command(epilog="Example: pomolog view results --worst 10")
def view(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="OUT...|S", help="Results (several: side by side), or a session."),
    ],
    worst: Annotated[int, typer.Option(min=0, help="Step through this many worst cases.")] = 0,
    kind: Annotated[
        str, typer.Option(help="Of worst cases: missed, false, wrong match, range; comma between.")
    ] = "",
    frame: Annotated[int | None, typer.Option(min=0, help="Open at this frame.")] = None,
    time: Annotated[
        float | None, typer.Option(min=0, help="Open at this second of the session.")
    ] = None,
    apple: Annotated[int | None, typer.Option(help="Step through a true apple's cases.")] = None,
    session: Annotated[str, typer.Option(help="Where results have several: this one.")] = "",
    tab: Annotated[str, typer.Option(help="In front: Overview, Recognise, Circles, ...")] = "",
    web: Annotated[bool, typer.Option("--web", help="Serve to a browser on this machine.")] = False,
    bind: Annotated[
        str, typer.Option(help="With --web: the address to serve on; 0.0.0.0 is the whole network.")
    ] = "127.0.0.1",
    save: Annotated[
        Path | None, typer.Option(help="Write a recording with its layout (.rrd), open nothing.")
    ] = None,
    memory: Annotated[str, typer.Option(help="What the viewer may hold, like 4GB.")] = "",
) -> None:
    """Open results (or a session without any) in Rerun, laid out by question."""
    from tempfile import TemporaryDirectory

    from viewer.choose import Wish, choose
    from viewer.choose import save as save_opening
    from viewer.open import open_viewer, require_screen

    if kind and not worst and apple is None:
        raise typer.BadParameter("of which cases? add --worst 10", param_hint="--kind")
    wish = Wish(worst, _kinds(kind), frame, time, apple, session, _tab(tab))
    if save is None:
        require_screen(paths[0], web=web)
    with TemporaryDirectory(prefix="pomolog-view-") as folder:
        opening = choose(paths, wish, Path(folder))
        if save is not None:
            save_opening(opening, save)
            print(f"{save}: {save.stat().st_size / 1e6:.1f} MB; open it with: rerun {save}")
            return
        open_viewer(
            opening.files, web=web, bind=bind, memory=memory, frame=opening.frame, say=print
        )


def _kinds(said: str) -> "tuple[Kind, ...]":
    from processor.worst import KINDS

    asked = [word.strip() for word in said.split(",") if word.strip()]
    unknown = [word for word in asked if word not in KINDS]
    if unknown:
        raise typer.BadParameter(f"{unknown[0]}? it is {', '.join(KINDS)}", param_hint="--kind")
    return tuple(kind for kind in KINDS if not asked or kind in asked)


def _tab(said: str) -> str:
    from viewer.layout import MAKERS

    names = {name.lower(): name for name in (*MAKERS, "Worst", "Changes")}
    if said and said.lower() not in names:
        known = ", ".join(names.values())
        raise typer.BadParameter(f"{said}? there are {known}", param_hint="--tab")
    return names.get(said.lower(), "")


@app.command(epilog="Example: pomolog report results -o report.html")
def report(
    out: Annotated[list[Path], typer.Argument(metavar="OUT...", help="Folders of results.")],
    page: Annotated[Path, typer.Option("--out", "-o", help="The page to write (.html).")],
    by: Annotated[str, typer.Option(help="Score by this condition; if none, lighting.")] = "",
    worst: Annotated[int, typer.Option(min=0, help="Worst cases to show, of each method.")] = 10,
    session: Annotated[
        list[Path] | None, typer.Option(help="Where a session lies now; a file or a folder.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """One page to send: what was run, the score, plots, the ledger, the worst cases in pictures."""
    from recorder.files import replacing, require_ending
    from recorder.progress import progress
    from viewer.report import make_report, steps
    from viewer.report_columns import columns_of

    require_ending(page, ".html", ".htm")
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
    as_json: AsJson = False,
) -> None:
    """Every stage of one frame in one picture; the frame is located again, as the run did it."""
    from recorder.files import replacing, require_ending
    from viewer.sheet import make_sheet

    require_ending(picture, ".png")
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
    from rich.console import Console

    from processor.methods import load_method
    from processor.replay import replay
    from processor.runs import find_runs, score_runs
    from processor.tables import score_table
    from recorder.progress import progress
    from recorder.session import read_info
    from viewer.layout import lay_out

    session = DEMO_SESSION if DEMO_SESSION.is_file() else _drawn(out)
    name, locator = load_method(method)
    with progress("replaying", read_info(session).pairs) as tick:
        for outcome in replay([session], out, locator, method=name, tick=tick):
            if isinstance(outcome, PomologError):
                raise outcome
    groups = score_runs(find_runs([out]), "lighting")
    console = Console()
    console.print(f"method {name} on {session.name}, by lighting:")
    console.print(score_table(groups))
    recordings = [run.folder / "trace.rrd" for run in find_runs([out])]
    lay_out(recordings)
    for recording in recordings:
        console.print(f"recording: {recording}", soft_wrap=True, highlight=False)
    command = "pomolog" if shutil.which("pomolog") else _beside_python()
    sheet = f"{command} sheet {recordings[0].parent} --frame 3 -o sheet.png"
    for what, words in (("look at it with", f"{command} view {out}"), ("or one picture", sheet)):
        console.print(f"{what + ':':17} {words}", soft_wrap=True, highlight=False)


def _beside_python() -> str:
    """What to type where no activated environment has the command."""
    script = Path(sys.executable).with_name("pomolog")
    if not script.is_file():
        return f"{sys.executable} -m pomolog"
    return str(script.relative_to(Path.cwd()) if script.is_relative_to(Path.cwd()) else script)


def _drawn(out: Path) -> Path:
    """A drawn session beside the results: pomolog is installed without its sessions."""
    from recorder.sketch import sketch

    session = out.with_name(f"{out.name}.mcap")
    if not session.is_file():
        sketch(session)
        typer.echo(f"{session}: drawn, for the recorded sessions are not here", err=True)
    return session
