"""The recorder's commands: thin, they turn words into calls and results into lines."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recorder.commands import AsJson, SessionArgument, SessionOutput, command_group
from recorder.errors import PomologError, TornFileError
from recorder.words import counted

if TYPE_CHECKING:
    from recorder.capture import Recorder
    from recorder.check import Finding
    from recorder.plan import Plan
    from recorder.status import RecorderStatus

app = command_group()


@app.command(epilog="Example: pomolog info sessions/demo.mcap")
def info(
    session: Annotated[
        str, typer.Argument(metavar="S", help="A session (.mcap), or s3://, gs://.")
    ],
    as_json: AsJson = False,
) -> None:
    """Say what a session holds; of a torn one, what can be saved."""
    from recorder.objects import as_place
    from recorder.profile import PROFILE
    from recorder.salvage import survey
    from recorder.session import SessionInfo, read_info

    try:
        found = read_info(as_place(session))
    except TornFileError as torn:
        wreck = survey(as_place(session))
        if not wreck.chunks or wreck.profile != PROFILE:
            raise
        found = SessionInfo(
            profile=wreck.metadata.get("session", {}).get("profile", ""),
            frames=wreck.frames,
            pairs=min(wreck.counts["/left/image"], wreck.counts["/right/image"]),
            topics=dict(wreck.counts),
            start_ns=wreck.start_ns,
            end_ns=wreck.end_ns,
            metadata=wreck.metadata.get("session", {}),
            ledger=wreck.metadata.get("ledger", {}),
            whole=False,
        )
        typer.echo(f"pomolog: {torn}", err=True)
    if as_json:
        print(json.dumps(asdict(found), indent=2))
        return
    seconds = ((found.end_ns or 0) - (found.start_ns or 0)) / 1e9
    print(f"{session}: {found.profile}, {'whole' if found.whole else 'TORN'}")
    one_view = found.metadata.get("views") == "left"
    views = "one view" if one_view else counted(found.pairs, "stereo pair")
    print(f"  {views}, {counted(found.frames, 'frame')}, {seconds:.1f} s")
    for topic, count in sorted(found.topics.items()):
        print(f"  {topic:20} {count:7}")
    for title, entries in (("about", found.metadata), ("ledger", found.ledger)):
        for key, value in sorted(entries.items()):
            long = f"... ({len(value)} characters; see them with --json)"
            print(f"  {title}: {key} = {value if len(value) <= 200 else long}")


@app.command(epilog="Example: pomolog check sessions/demo.mcap --plot gaps.png")
def check(
    session: SessionArgument,
    plot: Annotated[
        Path | None, typer.Option(help="Draw intervals and left-right gaps (.png, .svg, .pdf).")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Read all of a session: checksums, pictures, rates, gaps, skew. Exit 1 if it is not sound."""
    from recorder.check import check as look
    from recorder.progress import progress
    from recorder.session import Session, read_info

    if plot is not None:
        from recorder.timing import judge, timing_of
        from recorder.timing_plot import draw_timing

        with Session(session) as opened:
            timing = timing_of(opened)
        draw_timing(timing, judge(timing), plot, session.name)
    try:
        pairs = read_info(session).pairs
    except PomologError:
        pairs = 0  # the check itself says what is wrong
    with progress("checking", pairs) as tick:
        findings = look(session, tick)
    failed = any(finding.level == "failure" for finding in findings)
    if as_json:
        print(json.dumps({"sound": not failed, "findings": [asdict(f) for f in findings]}))
    for finding in findings:
        if finding.level != "failure" and not as_json:
            print(f"{finding.level:8} {finding.text}")
    for finding in findings:
        if finding.level == "failure":
            raise PomologError(finding.text)


@app.command(epilog="Example: pomolog salvage torn.mcap -o whole.mcap")
def salvage(
    torn: Annotated[Path, typer.Argument(metavar="TORN", help="A torn or damaged session.")],
    out: SessionOutput,
) -> None:
    """Make a whole session of what a torn or damaged one still has."""
    from recorder.files import require_ending
    from recorder.salvage import salvage as save

    require_ending(out, ".mcap")
    wreck = save(torn, out)
    frames, chunks = counted(wreck.frames, "frame"), counted(wreck.chunks, "complete chunk")
    print(f"{out}: {frames} from {chunks}")
    print(f"lost: {counted(wreck.chunks_lost, 'damaged chunk')}, {wreck.bytes_lost} bytes in all")


@app.command(epilog="Example: pomolog simulate segmentation-front --fraction 0.1 -o S.mcap")
def simulate(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file, or a set's name.")],
    out: SessionOutput,
    preview: Annotated[
        bool, typer.Option("--preview", help="A quarter as wide and high: seconds, not minutes.")
    ] = False,
    fraction: Annotated[
        float, typer.Option(min=0.0001, max=1.0, help="Make only this share, evenly spread.")
    ] = 1.0,
    split: Annotated[str, typer.Option(help="Only these worlds: train, test, or both.")] = "both",
    cache: Annotated[
        Path | None, typer.Option(help="Keep rendered pairs here, for other exposures and names.")
    ] = None,
) -> None:
    """Make a session in the digital orchard: photo-like pictures with exact truth."""
    from recorder.files import require_ending
    from recorder.orchard.scene import as_split, load_scene, shots
    from recorder.orchard.simulate import preview_of
    from recorder.orchard.simulate import simulate as make
    from recorder.progress import progress

    require_ending(out, ".mcap")
    asked = preview_of(load_scene(scene)) if preview else load_scene(scene)
    todo = shots(asked, fraction, as_split(split))
    with progress("simulating", len(todo)) as tick:
        make(asked, todo, out, cache=cache, tick=tick)
    print(f"{out}: {counted(len(todo), 'stereo pair')}")


@app.command(
    epilog="Example: pomolog record --rig rig.toml --out day1/ --lighting front --split 5min"
)
def record(
    rig: Annotated[Path, typer.Option(help="rig.toml that names cameras; see docs/recording.md.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder for the recording.")],
    lighting: Annotated[str, typer.Option(help="front, back, cloudy, indoor, ...")] = "",
    cultivar: Annotated[str, typer.Option(help="The apples' variety.")] = "",
    site: Annotated[str, typer.Option(help="Where this is.")] = "",
    name: Annotated[str, typer.Option(help="The file's name; the date and time if left out.")] = "",
    split: Annotated[str, typer.Option(help="A new file every 5min, 1h, 500MB, 2GB, ...")] = "",
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds; until Ctrl-C if left out.")
    ] = None,
    preview: Annotated[bool, typer.Option("--preview", help="A page with both views.")] = False,
    preview_port: Annotated[int, typer.Option(min=0, max=65535)] = 8765,
    check: Annotated[
        bool, typer.Option("--check", help="Try everything, record nothing; go or no go.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Record both cameras and the rangefinder until Ctrl-C; nothing is lost silently.

    While recording: the space bar takes a reading for the fruit at the crosshair, a number and the
    space bar one for that apple; a typed distance (4,532 m # apple 7) is a reading, any other line
    a note, key=value a condition from then on.
    """
    from rich.console import Console

    from recorder.field import record as run
    from recorder.plan import make_plan
    from recorder.status_line import losses, status_line

    about = {"lighting": lighting, "cultivar": cultivar, "site": site}
    plan = make_plan(rig, out, name=name, split=split, about=about)
    if check:
        _preflight(plan, as_json)
        return
    console = Console(stderr=True)

    def show(status: "RecorderStatus", recorder: "Recorder", typing: str) -> None:
        if console.is_terminal:
            last = recorder.messages[-1] if recorder.messages else ""
            line = "  ".join((status_line(status), last, f"> {typing}" if typing else ""))
            sys.stderr.write(f"\r\x1b[K{line[: max(20, console.width - 1)]}")
            sys.stderr.flush()

    recorder = run(
        plan,
        duration_s=duration,
        preview_port=preview_port if preview else None,
        show=show,
        announce=lambda line: typer.echo(line, err=True),
    )
    if console.is_terminal:
        sys.stderr.write("\r\x1b[K")  # what follows begins its own line
    status = recorder.status()
    if as_json:
        files = [str(path) for path in recorder.files]
        print(json.dumps({"files": files, "status": asdict(status)}))
        return
    for path in recorder.files:
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
    left, right = (status.stream(side) for side in ("left", "right"))
    print(f"{counted(status.pairs, 'pair')}, {losses(left, right)}")


def _preflight(plan: "Plan", as_json: bool) -> None:
    """Print what `--check` finds; exit 1 on no go."""
    from recorder.preflight import preflight

    def tell(finding: "Finding") -> None:
        if not as_json:
            print(f"{finding.level:8} {finding.text}", flush=True)

    findings = preflight(plan, tell)
    failed = [finding for finding in findings if finding.level == "failure"]
    if as_json:
        print(json.dumps({"go": not failed, "findings": [asdict(f) for f in findings]}))
        raise typer.Exit(1 if failed else 0)
    if failed:
        raise PomologError(f"no go: {failed[0].text}")
    print("go")
