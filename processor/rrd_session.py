"""What a session itself says, drawn: cameras, pictures, truth, the beam, notes, the recorder.

Needs no results, so that a session alone can be looked at. Each function draws at the moment that
is set in the recording; what holds for the whole session is static.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import rerun as rr

from processor.discs import Discs, true_discs
from processor.palette import REJECTED, TRUTH
from processor.rrd_pictures import jpeg, recorded
from recorder.exposure import OVER_LEVEL
from recorder.records import SIDES, Frame, FrameTruth, Picture, Side, StereoPair
from recorder.rectify import Rectification
from recorder.rig import Rangefinder
from recorder.session import Session

RESAMPLED_QUALITY: Final = 85  # about as many bytes as a camera's own JPEG
BEAM_M: Final = 2.0  # drawn length of a beam that met nothing
LOSSES: Final = ("dropped", "missing", "incomplete", "late", "unpaired", "reopened", "faults")

LEGEND: Final = """\
**Colours, the same in every view**

| colour | is |
|---|---|
| blue | truth: an apple as it is known to be |
| orange | estimate: an apple as the method places it |
| purple | a circle without a partner in the other view |
| green | right: a hit, a right match |
| red | wrong: marked or matched where nothing is |
| light blue | missed |
| grey | tried and given up |
"""


def markdown(text: str) -> Any:
    """Text to be shown as Markdown."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def draw_rig(rec: rr.RecordingStream, rectification: Rectification) -> None:
    """The two rectified cameras, where they stand."""
    rec.log("world", rr.ViewCoordinates.RDF, static=True)
    turn = rectification.left.rotation.T
    for side in SIDES:
        view = rectification.view(side)
        along = np.array([rectification.baseline_m if side == "right" else 0.0, 0, 0])
        rec.log(f"world/{side}", rr.Transform3D(translation=turn @ along, mat3x3=turn), static=True)
        rec.log(
            f"world/{side}",
            rr.Pinhole(
                image_from_camera=view.matrix,
                resolution=list(view.camera.size_px),
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=0.15,
            ),
            static=True,
        )


def draw_moment(rec: rr.RecordingStream, frame: int, time_ns: int, first_ns: int) -> None:
    """Set the time of all that is drawn next."""
    rec.set_time("frame", sequence=frame)
    rec.set_time("session_time", duration=np.timedelta64(time_ns - first_ns, "ns"))
    rec.set_time("capture", timestamp=np.datetime64(time_ns, "ns"))


def draw_picture(
    rec: rr.RecordingStream, side: Side, frame: Frame, picture: Picture, *, resampled: bool
) -> None:
    """A view: the recorded bytes, or in their place, not to cost twice, the resampled picture."""
    if resampled:
        rec.log(f"world/{side}/picture", jpeg(picture, quality=RESAMPLED_QUALITY))
    else:
        rec.log(f"world/{side}/picture", recorded(frame, picture))


def draw_exposure(rec: rr.RecordingStream, pictures: Mapping[Side, Picture]) -> None:
    """How much of each view is blown out, in per cent, and how bright it is."""
    samples = [pictures[side][::8, ::8] for side in SIDES]
    over = [float((sample.max(axis=2) >= OVER_LEVEL).mean() * 100) for sample in samples]
    rec.log("health/overexposed", rr.Scalars(over))
    rec.log("health/brightness", rr.Scalars([float(sample.mean()) for sample in samples]))


def draw_truth(rec: rr.RecordingStream, truth: FrameTruth | None, parallel: Rectification) -> None:
    """True apples in both views and in space; nothing where nobody said."""
    for side in SIDES:
        _draw_discs(rec, side, truth, parallel)
    known = () if truth is None else truth.apples or ()
    rec.log(
        "world/truth",
        rr.Ellipsoids3D(
            centers=[a.centre_m for a in known],
            radii=[a.radius_m for a in known],
            colors=TRUTH,
            labels=[f"true {a.id}" for a in known],
            show_labels=False,
        ),
    )


def _draw_discs(
    rec: rr.RecordingStream, side: Side, truth: FrameTruth | None, parallel: Rectification
) -> None:
    discs: Discs | None = None
    if truth is not None:
        labels = truth.labels(side)
        if labels is not None:
            labels = parallel.view(side).labels(labels)
        discs = true_discs(truth, side, labels, parallel)
    if discs is None:  # of the frame before there may have been some
        rec.log(f"world/{side}/truth", rr.Ellipses2D(centers=[], half_sizes=[]))
        return
    shown = [i for i, wanted in enumerate(discs.wanted) if wanted]
    rec.log(
        f"world/{side}/truth",
        rr.Ellipses2D(
            centers=discs.circles[shown, :2],
            half_sizes=discs.circles[shown][:, [2, 2]],
            colors=TRUTH,
            labels=[f"true {discs.ids[i]}" for i in shown],
            show_labels=False,
            line_radii=-1.0,
        ),
    )


def draw_beam(rec: rr.RecordingStream, beam: Rangefinder, pair: StereoPair) -> None:
    """Each reading as a line from the instrument to what it met."""
    lengths = [r.range_m for r in pair.readings]
    ends = [beam.origin_m + beam.direction * (BEAM_M if x is None else x) for x in lengths]
    rec.log(
        "world/beam",
        rr.LineStrips3D(
            [[beam.origin_m, end] for end in ends],
            colors=[REJECTED if x is None else TRUTH for x in lengths],
            labels=["no reading" if x is None else f"{x:.3f} m" for x in lengths],
        ),
    )


def draw_pair(rec: rr.RecordingStream, pair: StereoPair) -> None:
    """What is counted of a pair before anybody looks for fruit."""
    skew_ms = (pair.right.time_ns - pair.left.time_ns) / 1e6
    rec.log("health/skew_ms", rr.Scalars(skew_ms))


def draw_session(rec: rr.RecordingStream, session: Session, heading: str) -> None:
    """Once a session: what it is, its ledger, the recorder's state each second, the notes.

    Args:
        rec: the recording.
        session: to be told.
        heading: one line in markdown of what is shown of it.
    """
    rec.log("about", markdown(_about(session, heading)), static=True)
    rec.log("legend", markdown(LEGEND), static=True)
    rec.log("health/ledger", markdown(ledger_table(session.ledger)), static=True)
    times_ns = session.pair_times_ns()[:, 0]
    first_ns = int(times_ns[0]) if len(times_ns) else 0

    def moment(time_ns: int) -> None:
        frame = max(0, int(np.searchsorted(times_ns, time_ns, "right")) - 1)
        draw_moment(rec, frame, time_ns, first_ns)

    for note in session.notes():
        moment(note.time_ns)
        rec.log("health/notes", rr.TextLog(note.text, level="INFO"))
    statuses = list(session.statuses())
    counted = [
        (stream.stream, loss)
        for stream in (statuses[-1].streams if statuses else ())
        for loss in LOSSES
        if getattr(stream, loss)
    ]
    said: tuple[str, ...] = ()
    for status in statuses:
        moment(status.time_ns)
        for name, loss in counted:
            lost = getattr(status.stream(name), loss)
            rec.log(f"health/lost/{name}_{loss}", rr.Scalars(lost))
        for stream in status.streams:
            rec.log(f"health/rate_hz/{stream.stream}", rr.Scalars(stream.rate_hz))
        rec.log("health/queue_mb", rr.Scalars(status.queue_bytes / 1e6))
        for warning in status.warnings:
            if warning not in said:
                rec.log("health/notes", rr.TextLog(warning, level="WARN"))
        said = status.warnings


def _about(session: Session, heading: str) -> str:
    rig = session.rig
    said = {k: v for k, v in session.metadata.items() if k not in ("images", "rig", "profile")}
    lines = [f"**{session.name}**: {heading}", "", "| | |", "|---|---|"]
    lines.append(f"| pairs | {len(session)} |")
    lines.append(f"| baseline | {rig.baseline_m * 1000:.1f} mm |")
    lines.append(f"| focal length, left | {rig.left.matrix[0, 0]:.1f} px |")
    lines.append(f"| focal length, right | {rig.right.matrix[0, 0]:.1f} px |")
    lines.append(f"| rangefinder | {'none' if rig.rangefinder is None else 'yes'} |")
    lines += [f"| {key} | {_cell(value)} |" for key, value in sorted(said.items())]
    return "\n".join(lines)


def ledger_table(ledger: dict[str, str]) -> str:
    """The ledger of a recording as markdown, a row a stream."""
    if not ledger:
        return "**Ledger**\n\nNone was kept: no recorder made this session."
    streams = dict.fromkeys(key.partition(".")[0] for key in ledger if "." in key)
    columns = ("frames", *LOSSES)
    rows = ["**Ledger**: what came, and what was lost", ""]
    rows += ["| stream | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for stream in streams:
        values = (ledger.get(f"{stream}.{column}", "") for column in columns)
        rows.append(f"| {stream} | " + " | ".join(values) + " |")
    rows += ["", *(f"{k}: {_cell(v)}  " for k, v in ledger.items() if "." not in k)]
    return "\n".join(rows)


def _cell(text: str) -> str:
    return text.replace("|", "/").replace("\n", " ")[:200]
