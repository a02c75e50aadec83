"""`pomolog calibrate` and `pomolog rig`: words into calls, results into lines."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recorder.commands import AsJson, command_group

if TYPE_CHECKING:
    from recorder.calibrate.beam import BeamFit
    from recorder.calibrate.calibration import Calibration

app = command_group()
rigs = typer.Typer(no_args_is_help=True)
app.add_typer(
    rigs,
    name="rig",
    help="Convert a calibration from one format to another.",
    epilog="Example: pomolog rig convert camchain.yaml -o rig.toml",
)


@app.command(
    epilog="Example: pomolog calibrate left/ right/ --board charuco:31x16:49.33mm:38.46mm "
    "-o rig.toml --report report.html"
)
def calibrate(
    pictures: Annotated[
        list[Path],
        typer.Argument(
            metavar="LEFT RIGHT | S",
            help="Two folders of board pictures, one folder with both, or a session (.mcap).",
        ),
    ],
    board: Annotated[
        str | None,
        typer.Option(
            help="chessboard:9x6:25mm (inner corners, square) or charuco:31x16:49.33mm:38.46mm"
            "[:4x4_250] (squares, square, marker, dictionary)."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="The rig: rig.toml, rig.yaml (OpenCV), a folder (ROS), ..."
        ),
    ] = None,
    lens: Annotated[
        str, typer.Option(help="pinhole, rational, fisheye; auto takes the plainest that fits.")
    ] = "auto",
    report: Annotated[
        Path | None, typer.Option(help="An HTML page of all that was measured.")
    ] = None,
    rangefinder: Annotated[
        bool,
        typer.Option(
            "--rangefinder",
            help="Also find the beam, by a session's readings on the board; without --board, by "
            "its readings on known apples.",
        ),
    ] = False,
    views: Annotated[
        int, typer.Option(min=3, help="Look at so many pairs at most, evenly spread.")
    ] = 100,
    as_json: AsJson = False,
) -> None:
    """Calibrate two cameras by pictures of a flat board, and say how far to trust the result.

    Show the board in 10 to 20 positions: near and far, tilted, in every corner of both pictures.
    """
    from recorder.calibrate.beam import fit_beam
    from recorder.calibrate.board import FORM, parse_board
    from recorder.calibrate.calibration import calibrate as run
    from recorder.calibrate.lens import as_lens
    from recorder.calibrate.readings import beam_of_file, known_beam, readings_on_board
    from recorder.calibrate.report import write_report
    from recorder.calibrate.sources import source_of
    from recorder.calibrate.views import sight
    from recorder.errors import PomologError
    from recorder.files import require_ending
    from recorder.progress import progress
    from recorder.rig_files import format_of, write_rig

    if board is None and rangefinder:
        _beam_by_apples(pictures, out, as_json=as_json)
        return
    if board is None:
        raise PomologError(f"no board; give --board {FORM}")
    wanted, model = parse_board(board), as_lens(lens)
    if out is not None:
        format_of(out)  # a wrong name is told before the work, not after it
    if report is not None:
        require_ending(report, ".html", ".htm")
    source = source_of(pictures, views)
    if rangefinder and source.session is None:
        raise PomologError("--rangefinder needs a session with readings, not pictures alone")
    with progress("finding the board", len(source.chosen)) as tick:
        sighting = sight(wanted, source, tick)
    found = run(sighting, model)
    if source.session is not None and rangefinder:
        readings = readings_on_board(source.session, found.fit)
        found = found.with_beam(fit_beam(readings, known_beam(source.session)))
    kept = beam_of_file(out) if out and not found.beam else None
    if kept is not None:
        found = found.with_rangefinder(kept)
        typer.echo(f"the rangefinder of {out} stays as it was; --rangefinder finds it", err=True)
    for line in found.warnings:
        typer.echo(f"warning: {line}", err=True)
    written = write_rig(found.rig, out) if out else ()
    if report:
        write_report(found, report)
    if as_json:
        print(json.dumps(found.as_json(), indent=2))
        return
    _tell(found)
    for path in (*written, *([report] if report else [])):
        print(path)
    if not out:
        print("nothing is written; give -o rig.toml to keep it")


def _tell(found: "Calibration") -> None:
    """The result in a few lines."""
    from recorder.records import SIDES

    rig, trust, spacing = found.rig, found.trust, found.measures.spacing_m
    used, total = len(found.fit.views), len(found.sighting.views)
    print(f"{found.sighting.shown}: {used} of {total} views used; {found.choice.sentence}")
    for name, why in found.rejected.items():
        print(f"  not used: {name}: {why}")
    for place, side in enumerate(SIDES):
        print(
            f"  {side:5} f = {rig.camera(side).matrix[0, 0]:.2f} ± {trust.focal_std_px[place]:.2f} "
            f"px, corners off by {found.fit.rms_px(side):.3f} px"
        )
    print(
        f"  B = {rig.baseline_m * 1e3:.3f} ± {trust.baseline_std_m * 1e3:.3f} mm, corners of both "
        f"off by {found.fit.stereo_rms_px:.3f} px, rectified rows by "
        f"{found.measures.row_rms_px:.3f} px"
    )
    if spacing.count:
        print(
            f"  corners {spacing.median * 1e3:.3f} mm apart (MAD {spacing.mad * 1e3:.3f} mm, "
            f"{spacing.count} spacings), the board's {found.sighting.board.square_m * 1e3:g} mm"
        )
    errors = ", ".join(
        f"{error.range_m * 1e3:.0f} mm: {error.calibration_m * 1e3:.1f}" for error in trust.errors
    )
    print(f"  distance error to expect of the calibration alone, mm: {errors}")
    if found.beam:
        print(_beam_line(found.beam))


def _beam_line(beam: "BeamFit") -> str:
    """A rangefinder in a line."""
    place = ", ".join(
        f"{1e3 * value:.1f} ± {1e3 * std:.1f}"
        for value, std in zip(beam.rangefinder.origin_m, beam.origin_std_m, strict=True)
    )
    aim = ", ".join(f"{value:.4f}" for value in beam.rangefinder.direction)
    return (
        f"  rangefinder ({beam.estimated} estimated): origin {place} mm, direction {aim} ± "
        f"{math.degrees(beam.angle_std_rad):.2f} degrees; {beam.used} readings off by "
        f"{1e3 * beam.rms_m:.1f} mm, {len(beam.left_out)} met something else"
    )


def _beam_by_apples(pictures: list[Path], out: Path | None, *, as_json: bool) -> None:
    """Find the beam of a labelled session, whose cameras stay as they are."""
    from dataclasses import replace

    from recorder.calibrate.beam import fit_beam
    from recorder.calibrate.readings import readings_on_apples
    from recorder.errors import PomologError
    from recorder.rig_files import write_rig
    from recorder.session import Session

    if len(pictures) != 1 or pictures[0].suffix.lower() != ".mcap":
        raise PomologError(
            "--rangefinder without --board needs one labelled session (.mcap), "
            f"not {' '.join(map(str, pictures))}"
        )
    with Session(pictures[0]) as session:
        rig = session.rig
    beam = fit_beam(readings_on_apples(pictures[0]), rig.rangefinder)
    written = write_rig(replace(rig, rangefinder=beam.rangefinder), out) if out else ()
    if as_json:
        print(json.dumps({"rangefinder": beam.as_json()}, indent=2))
        return
    print(_beam_line(beam))
    for path in written:
        print(path)


@rigs.command(epilog="Example: pomolog rig convert left.yaml right.yaml -o rig.toml")
def convert(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="IN...",
            help="rig.toml, OpenCV YAML, Kalibr camchain, or a ROS pair: two files or a folder.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="rig.toml, rig.yaml (OpenCV), camchain.yaml (Kalibr), a folder (ROS).",
        ),
    ],
    to: Annotated[
        str, typer.Option(help="pomolog, opencv, ros, kalibr; by the name of -o if left out.")
    ] = "",
) -> None:
    """Convert between rig.toml, OpenCV's stereo YAML, ROS camera_info pairs and Kalibr camchains.

    No number is rounded. What a format has no place for is refused, never dropped.
    """
    from recorder.errors import PomologError
    from recorder.rig_files import as_format, read_rig, write_rig

    if len(files) > 2:
        raise PomologError(f"{len(files)} files; a rig is in one, or in two of ROS")
    rig = read_rig(files[0] if len(files) == 1 else Path(f"{files[0]},{files[1]}"))
    for path in write_rig(rig, out, as_format(to) if to else None):
        print(path)
