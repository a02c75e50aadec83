"""`pomolog import` and `pomolog label`: words into calls, results into lines."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from recorder.commands import AsJson, SessionArgument, SessionOutput, command_group
from recorder.words import counted

app = command_group()
imports = typer.Typer(no_args_is_help=True)
app.add_typer(
    imports,
    name="import",
    help="Make a session from pictures or recordings of others.",
    epilog="Example: pomolog import frames left/ right/ --rig rig.toml -o S.mcap",
)


@imports.command(
    epilog="Example: pomolog import frames left/ right/ --rig rig.toml --lighting front -o S.mcap"
)
def frames(
    left: Annotated[Path, typer.Argument(metavar="LEFT", help="A picture, or a folder of them.")],
    out: SessionOutput,
    right: Annotated[
        Path | None,
        typer.Argument(metavar="RIGHT", help="The same of the right view; or one view alone."),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="rig.toml, OpenCV, ROS or Kalibr file; two views need it.")
    ] = None,
    rate: Annotated[float, typer.Option(min=1e-3, max=1e4, help="Pairs a second.")] = 1.0,
    lighting: Annotated[
        str, typer.Option(help="front, back, cloudy, indoor, ...; or one a pair: front,back,...")
    ] = "",
    cultivar: Annotated[str, typer.Option(help="The apples' variety.")] = "",
    site: Annotated[str, typer.Option(help="Where it was recorded.")] = "",
) -> None:
    """Import PNG, JPEG or WebP pictures, byte for byte; folders are paired in name order."""
    from recorder.files import require_ending
    from recorder.imports.frames import import_frames, picture_pairs, single_pictures
    from recorder.progress import progress
    from recorder.rig import load_rig

    if right is not None and rig is None:
        raise typer.BadParameter("two views need their calibration", param_hint="--rig")
    require_ending(out, ".mcap")
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
    views = "stereo pair" if right else "picture"
    print(f"{out}: {counted(len(pairs), views)}{'' if right else ' of one view'}")


@imports.command(epilog="Example: pomolog import bag row7/ --tolerance 10ms -o row7.mcap")
def bag(
    source: Annotated[Path, typer.Argument(metavar="BAG", help="An MCAP file, or its folder.")],
    out: SessionOutput,
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
    from recorder.files import require_ending
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
    require_ending(out, ".mcap")
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
    out: SessionOutput,
    masks: Annotated[
        Path | None,
        typer.Option(help="left/*.png and right/*.png, in order; or *.png of one view."),
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
    from recorder.files import require_ending
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
    require_ending(out, ".mcap")
    ((tool, path),) = sources.items()
    with Session(session) as opened, progress("labelling", len(opened)) as tick:
        labels: Truth
        if tool == "masks":
            labels = MaskTruth(path, apples, partial=partial, instances=instances)
            told = {"pictures": len(opened)}
            line = f"truth for {len(opened)} {'pictures' if opened.one_view else 'stereo pairs'}"
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
