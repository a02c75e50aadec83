"""The recorder's commands: thin, they turn words into calls and results into lines."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recorder.errors import PomologError, TornFileError

if TYPE_CHECKING:
    from recorder.capture import Recorder
    from recorder.check import Finding
    from recorder.plan import Plan
    from recorder.status import RecorderStatus

app = typer.Typer(
    add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip

SessionArgument = Annotated[Path, typer.Argument(metavar="S", help="A session (.mcap).")]
Output = Annotated[Path, typer.Option("--out", "-o", help="The session to write.")]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")]


@app.callback()
def _recorder() -> None:
    """Record sessions, make them, and look after them."""


@app.command(epilog="Example: pomolog info sessions/demo.mcap")
def info(session: SessionArgument, as_json: AsJson = False) -> None:
    """Say what a session holds; of a torn one, what can be saved."""
    from recorder.profile import PROFILE
    from recorder.salvage import survey
    from recorder.session import SessionInfo, read_info

    try:
        found = read_info(session)
    except TornFileError as torn:
        wreck = survey(session)
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
    views = "one view" if one_view else f"{found.pairs} stereo pairs"
    print(f"  {views}, {found.frames} frames, {seconds:.1f} s")
    for topic, count in sorted(found.topics.items()):
        print(f"  {topic:20} {count:7}")
    for title, entries in (("about", found.metadata), ("ledger", found.ledger)):
        for key, value in sorted(entries.items()):
            print(f"  {title}: {key} = {value}")


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
    out: Output,
) -> None:
    """Make a whole session of what a torn or damaged one still has."""
    from recorder.salvage import salvage as save

    wreck = save(torn, out)
    print(f"{out}: {wreck.frames} frames from {wreck.chunks} complete chunks")
    print(f"lost: {wreck.chunks_lost} damaged chunks, {wreck.bytes_lost} bytes in all")


@imports.callback()
def _imports() -> None:
    """Make a session from pictures or recordings of others."""


@imports.command(
    epilog="Example: pomolog import frames left/ right/ --rig rig.toml --lighting front -o S.mcap"
)
def frames(
    left: Annotated[Path, typer.Argument(metavar="LEFT", help="A picture, or a folder of them.")],
    out: Output,
    right: Annotated[
        Path | None,
        typer.Argument(metavar="[RIGHT]", help="The same of the right view; or one view alone."),
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(help="rig.toml, OpenCV YAML, ROS pair or Kalibr camchain; two views need it."),
    ] = None,
    rate: Annotated[float, typer.Option(min=1e-3, max=1e4, help="Pairs a second.")] = 1.0,
    lighting: Annotated[
        str, typer.Option(help="front, back, cloudy, indoor, ...; or one a pair: front,back,...")
    ] = "",
    cultivar: Annotated[str, typer.Option(help="The apples' variety.")] = "",
    site: Annotated[str, typer.Option(help="Where it was recorded.")] = "",
) -> None:
    """Import PNG, JPEG or WebP pictures, byte for byte; folders are paired in name order."""
    from recorder.imports.frames import import_frames, picture_pairs, single_pictures
    from recorder.progress import progress
    from recorder.rig import load_rig

    if right is not None and rig is None:
        raise typer.BadParameter("two views need their calibration", param_hint="--rig")
    pairs = single_pictures(left) if right is None else picture_pairs(left, right)
    about = {"cultivar": cultivar, "site": site}
    metadata = {key: value for key, value in about.items() if value}
    with progress("importing", len(pairs)) as tick:
        import_frames(
            pairs,
            load_rig(rig) if rig else None,
            out,
            rate_hz=rate,
            metadata={**metadata, "made_by": "import frames"},
            lighting=lighting.split(",") if lighting else (),
            tick=tick,
        )
    print(f"{out}: {len(pairs)} {'stereo pairs' if right else 'pictures of one view'}")


@imports.command(epilog="Example: pomolog import bag row7/ --tolerance 10ms -o row7.mcap")
def bag(
    source: Annotated[Path, typer.Argument(metavar="BAG", help="An MCAP file, or its folder.")],
    out: Output,
    left: Annotated[str, typer.Option(help="The left view's topic.")] = "",
    right: Annotated[str, typer.Option(help="The right view's; - for one view only.")] = "",
    left_info: Annotated[str, typer.Option(help="The left calibration's topic.")] = "",
    right_info: Annotated[str, typer.Option(help="The right calibration's.")] = "",
    ranges: Annotated[str, typer.Option("--range", help="The rangefinder's topic.")] = "",
    depth: Annotated[str, typer.Option(help="Depth aligned to the left view.")] = "",
    rig: Annotated[Path | None, typer.Option(help="Instead of the bag's calibrations.")] = None,
    times: Annotated[str, typer.Option(help="header or arrival; guessed if left out.")] = "",
    offset: Annotated[
        list[str] | None, typer.Option(help="right=-12ms, range=0.3s, ...: added to its times.")
    ] = None,
    tolerance: Annotated[str, typer.Option(help="Largest skew of a pair: 10ms.")] = "",
    lighting: Annotated[str, typer.Option(help="front, back, cloudy, indoor, ...")] = "",
    cultivar: Annotated[str, typer.Option(help="The apples' variety.")] = "",
    site: Annotated[str, typer.Option(help="Where it was recorded.")] = "",
    as_json: AsJson = False,
) -> None:
    """Import a ROS 2 (rosbag2) or Foxglove MCAP; says first which topic it takes for what.

    Without flags the topics are guessed from their names and first messages; a flag overrules the
    guess, and - says that there is none. One view and depth make a session of one view.
    """
    from recorder.imports.bag import Bag
    from recorder.imports.bag_roles import assign_roles
    from recorder.imports.bag_session import import_bag
    from recorder.imports.durations import read_duration_ns, read_offsets_ns
    from recorder.progress import progress
    from recorder.rig import load_rig

    if times not in ("", "header", "arrival"):
        raise typer.BadParameter("header or arrival", param_hint="--times")
    offsets_ns = read_offsets_ns(offset or [])
    tolerance_ns = read_duration_ns(tolerance, "--tolerance") if tolerance else None
    if tolerance_ns is not None and tolerance_ns < 0:
        raise typer.BadParameter("not negative", param_hint="--tolerance")
    found = Bag(source)
    wanted = {
        "left": left, "right": right, "left_info": left_info, "right_info": right_info,
        "range": ranges, "depth": depth,
    }  # fmt: skip
    roles = assign_roles(found, {role: topic for role, topic in wanted.items() if topic})
    if not as_json:
        for role, name in roles.items():
            topic = found.topics[name]
            print(f"--{role:10} {name}  ({topic.schema}, {topic.count} messages)", flush=True)
    about = {"lighting": lighting, "cultivar": cultivar, "site": site}
    total = sum(found.topics[name].count for role, name in roles.items() if "-" not in role)
    with progress("importing", total) as tick:
        done = import_bag(
            found,
            roles,
            out,
            rig=load_rig(rig) if rig else None,
            times="header" if times == "header" else "arrival" if times else None,
            offsets_ns=offsets_ns,
            tolerance_ns=tolerance_ns,
            metadata={key: value for key, value in about.items() if value},
            tick=tick,
        )
    if as_json:
        print(json.dumps({"roles": dict(roles.items()), "out": str(out), **asdict(done)}, indent=2))
        return
    for line in (*done.remarks, *done.advice()):
        typer.echo(f"pomolog: {line}", err=True)
    print(f"{out}: {done.summary()}")


@app.command(epilog="Example: pomolog label S.mcap --coco labels.json --partial -o T.mcap")
def label(
    session: SessionArgument,
    out: Output,
    masks: Annotated[
        Path | None, typer.Option(help="A folder with left/*.png and right/*.png, in order.")
    ] = None,
    apples: Annotated[Path | None, typer.Option(help="Centres and radii (JSON).")] = None,
    instances: Annotated[
        bool, typer.Option("--instances", help="8-bit masks hold a number an apple.")
    ] = False,
    coco: Annotated[Path | None, typer.Option(help="COCO's JSON: polygons, RLE, boxes.")] = None,
    labelme: Annotated[Path | None, typer.Option(help="A folder of labelme's JSON.")] = None,
    cvat: Annotated[Path | None, typer.Option(help="CVAT's XML 1.1, images or video.")] = None,
    supervisely: Annotated[
        Path | None, typer.Option(help="A folder of Supervisely's JSON.")
    ] = None,
    yolo: Annotated[Path | None, typer.Option(help="A folder of YOLO's text files.")] = None,
    circles: Annotated[
        Path | None, typer.Option(help="CSV of circles or boxes; or a folder of them (ACFR).")
    ] = None,
    view: Annotated[str, typer.Option(help="left or right, where names do not say it.")] = "",
    category: Annotated[str, typer.Option(help="The apples' class, where there are more.")] = "",
    partial: Annotated[
        bool, typer.Option("--partial", help="Unlabelled fruit exist: score no false positives.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Give a session truth: masks and apples in the order of its frames, or labels by name.

    Labels find their pictures by the names that these had when imported, or that `pomolog export
    frames` gave them. Boxes and circles say no pixels, so none are scored; an apple has the same
    number in both views, or matches are not scored. See docs/interchange.md.
    """
    from recorder.imports.labels import READERS, LabelTruth
    from recorder.imports.masks import MaskTruth, Truth, label_session
    from recorder.progress import progress
    from recorder.session import Session

    given = {
        "masks": masks, "coco": coco, "labelme": labelme, "cvat": cvat,
        "supervisely": supervisely, "yolo": yolo, "circles": circles,
    }  # fmt: skip
    sources = {tool: path for tool, path in given.items() if path is not None}
    if len(sources) != 1:
        raise typer.BadParameter(f"give one of --{', --'.join(given)}", param_hint="labels")
    if view not in ("", "left", "right"):
        raise typer.BadParameter("left or right", param_hint="--view")
    if masks is None and (apples is not None or instances):
        raise typer.BadParameter("only with --masks", param_hint="--apples, --instances")
    ((tool, path),) = sources.items()
    with Session(session) as opened, progress("labelling", len(opened)) as tick:
        labels: Truth
        if tool == "masks":
            labels = MaskTruth(path, apples, partial=partial, instances=instances)
            told = {"pictures": len(opened)}
            line = f"truth for {len(opened)} stereo pairs"
        else:
            labels = LabelTruth(
                opened,
                READERS[tool](path),
                view="left" if view == "left" else "right" if view else None,
                category=category or None,
                partial=partial,
            )
            told = asdict(labels.summary)
            line = str(labels.summary)
        label_session(opened, labels, out, tick)
    print(json.dumps({"out": str(out), **told}) if as_json else f"{out}: {line}")


@app.command(epilog="Example: pomolog simulate segmentation-front --fraction 0.1 -o S.mcap")
def simulate(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file, or a set's name.")],
    out: Output,
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
    from recorder.orchard.scene import as_split, load_scene, shots
    from recorder.orchard.simulate import preview_of
    from recorder.orchard.simulate import simulate as make
    from recorder.progress import progress

    asked = preview_of(load_scene(scene)) if preview else load_scene(scene)
    todo = shots(asked, fraction, as_split(split))
    with progress("simulating", len(todo)) as tick:
        make(asked, todo, out, cache=cache, tick=tick)
    print(f"{out}: {len(todo)} stereo pairs")


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
    status = recorder.status()
    if as_json:
        files = [str(path) for path in recorder.files]
        print(json.dumps({"files": files, "status": asdict(status)}))
        return
    for path in recorder.files:
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
    left, right = (status.stream(side) for side in ("left", "right"))
    print(f"{status.pairs} pairs, {losses(left, right)}")


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
