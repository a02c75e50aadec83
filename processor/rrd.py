"""Draw finished traces into a Rerun recording (.rrd): the only place here that knows Rerun.

Entities: `world` is the left camera's optical frame. `world/left` and `world/right` are the
rectified cameras, with their picture, colour index, masks, contours, rings and fruit below them;
`world/apples`, `world/truth` and `world/beam` are in space; `match`, `time_ms` and `count` are
curves. Truth is blue, estimates are orange, in every view.
"""

from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun_bindings

from processor.count import Discs, true_discs
from processor.trace import Circles, Mask, Trace, ViewTrace
from recorder.records import COMPRESSED, SIDES, Frame, FrameTruth, Side, StereoPair
from recorder.rectify import Rectification
from recorder.rig import Rig

APPLICATION: Final = "pomolog"
MEDIA_TYPES: Final = {"jpeg": "image/jpeg", "png": "image/png", "webp": "image/webp"}
ESTIMATE: Final = (255, 140, 0)
TRUTH: Final = (0, 120, 255)
FAINT: Final = (255, 220, 120, 60)
ALONE: Final = (200, 80, 200)  # fruit without a partner
REFERENCE: Final = (255, 255, 0)
RINGS_SHOWN: Final = 1500  # of each view; more hide what is under them and cost megabytes
FAR_M: Final = 10.0  # places beyond are wrong matches; one of them would shrink all the rest
BEAM_M: Final = 2.0  # drawn length of a beam that met nothing
_JPEG: Final = [cv2.IMWRITE_JPEG_QUALITY, 90]
_PNG: Final = [
    cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_BILEVEL, 1,
]  # fmt: skip


class RrdWriter:
    """One recording, drawn frame by frame, held in memory and written when the context ends.

    Args:
        path: the .rrd to write; nothing is written when the context ends with an error.
        recording_id: parts of one session share it, so that they can be joined.
        rig: drawn once.
        rectification: the rig's.
        first_ns: where the session's own clock starts.
        name: shown in the viewer.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        recording_id: str,
        rig: Rig,
        rectification: Rectification,
        *,
        first_ns: int,
        name: str,
    ) -> None:
        self._rec = rr.RecordingStream(APPLICATION, recording_id=recording_id)
        self._rec.set_log_time_enabled(False)
        self._rec.set_log_tick_enabled(False)
        # Rerun's own file sink hangs for ever on a full disk, so the file is written here
        self._path = path
        self._encoded = rr.binary_stream(self._rec)
        self._rec.send_recording_name(name)
        self._rig = rig
        self._rectification = rectification
        self._first_ns = first_ns
        self._draw_rig()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        data = self._encoded.read()
        self._rec.disconnect()
        del self._encoded
        # Rerun keeps every recording of the process, two threads and a megabyte each, until it is
        # asked to let go of those that nobody holds; a long session has hundreds of slices
        del self._rec
        rerun_bindings.flush_and_cleanup_orphaned_recordings()
        if kind is None:
            self._path.write_bytes(data or b"")

    def write(self, pair: StereoPair, trace: Trace, decode_ns: int) -> None:
        """Draw one frame."""
        self._rec.set_time("frame", sequence=pair.index)
        since = np.timedelta64(pair.time_ns - self._first_ns, "ns")
        self._rec.set_time("session_time", duration=since)
        self._rec.set_time("capture", timestamp=np.datetime64(pair.time_ns, "ns"))
        for side, frame in zip(SIDES, (pair.left, pair.right), strict=True):
            self._draw_view(side, frame, trace.view(side), trace)
            self._draw_discs(side, pair.truth)
        self._draw_match(trace)
        self._draw_space(pair, trace)
        self._draw_numbers(pair, trace, decode_ns)

    def _log(self, path: str, what: Any, *, static: bool = False) -> None:
        self._rec.log(path, what, static=static)

    def _draw_rig(self) -> None:
        self._log("world", rr.ViewCoordinates.RDF, static=True)
        turn = self._rectification.left.rotation.T
        for side in SIDES:
            view = self._rectification.view(side)
            along = np.array([self._rectification.baseline_m if side == "right" else 0.0, 0, 0])
            self._log(
                f"world/{side}", rr.Transform3D(translation=turn @ along, mat3x3=turn), static=True
            )
            self._log(
                f"world/{side}",
                rr.Pinhole(
                    image_from_camera=view.matrix,
                    resolution=list(view.camera.size_px),
                    camera_xyz=rr.ViewCoordinates.RDF,
                    image_plane_distance=0.15,
                ),
                static=True,
            )

    def _draw_view(self, side: Side, frame: Frame, view: ViewTrace, trace: Trace) -> None:
        root = f"world/{side}"
        if self._rectification.view(side).maps is None:
            self._log(f"{root}/picture", _recorded(frame, view))
        else:  # the recorded picture has pixels of its own, so it stands beside the camera
            self._log(f"recorded/{side}", _recorded(frame, view))
            self._log(f"{root}/picture", _jpeg(view.picture))
        self._log(f"{root}/index", _jpeg(view.recognition.index))
        self._log(f"{root}/mask", _png(view.recognition.mask))
        self._log(f"{root}/cleaned", _png(view.cleaning.mask))
        contours = [region.contour_px for region in view.cleaning.regions]
        self._log(f"{root}/contours", rr.LineStrips2D(contours, radii=-0.5, colors=(0, 255, 120)))
        self._log(f"{root}/tried", _rings(view.circles.tried))
        self._draw_fruit(side, view.circles, trace)

    def _draw_fruit(self, side: Side, circles: Circles, trace: Trace) -> None:
        """The winning circles, numbered as the apples are; purple where nobody matched them."""
        names, colours = {}, {}
        for number, apple in enumerate(trace.apples):
            place = apple.left if side == "left" else apple.right
            if place is None:
                continue
            metres = "" if apple.surface_range_m is None else f" {apple.surface_range_m:.3f} m"
            names[place] = f"{number}{metres}"
            colours[place] = ALONE if apple.centre_m is None else ESTIMATE
        array = circles.as_array()
        order = range(len(array))
        self._log(
            f"world/{side}/fruit",
            rr.Ellipses2D(
                centers=array[:, :2],
                half_sizes=array[:, [2, 2]],
                colors=[colours.get(i, ALONE) for i in order],
                labels=[names.get(i, "") for i in order],
                show_labels=True,
                line_radii=-1.5,
            ),
        )
        if side == "left":
            line = trace.matching.reference_px
            height = trace.left.picture.shape[0]
            strips = [] if line is None else [[(line, 0), (line, height)]]
            self._log("world/left/reference_line", rr.LineStrips2D(strips, colors=REFERENCE))

    def _draw_discs(self, side: Side, truth: FrameTruth | None) -> None:
        discs: Discs | None = None
        if truth is not None:
            labels = truth.left if side == "left" else truth.right
            if labels is not None:
                labels = self._rectification.view(side).labels(labels)
            discs = true_discs(truth, side, labels, self._rectification)
        if discs is None:  # of the frame before there may have been some
            self._log(f"world/{side}/truth", rr.Ellipses2D(centers=[], half_sizes=[]))
            return
        shown = [i for i, wanted in enumerate(discs.wanted) if wanted]
        self._log(
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

    def _draw_match(self, trace: Trace) -> None:
        matching = trace.matching
        if matching.correlation.size:
            left, right = matching.projections.astype(np.float32)
            self._log("match/projection/left", rr.BarChart(left))
            self._log("match/projection/right", rr.BarChart(right))
            self._log("match/correlation", rr.BarChart(matching.correlation.astype(np.float32)))
        # in the left view, a line from each fruit to where its partner is in the right one
        lefts, rights = trace.left.circles.as_array(), trace.right.circles.as_array()
        strips = [[lefts[i, :2], rights[j, :2]] for i, j in matching.pairs.tolist()]
        self._log("world/left/matches", rr.LineStrips2D(strips, colors=ESTIMATE, radii=-0.7))

    def _draw_space(self, pair: StereoPair, trace: Trace) -> None:
        placed = [
            (number, apple.centre_m, apple.radius_m or 0.0)
            for number, apple in enumerate(trace.apples)
            if apple.centre_m is not None and max(map(abs, apple.centre_m)) < FAR_M
        ]
        self._log(
            "world/apples",
            rr.Ellipsoids3D(
                centers=[centre for _, centre, _ in placed],
                radii=[radius for *_, radius in placed],
                colors=ESTIMATE,
                labels=[str(n) for n, *_ in placed],
                fill_mode="solid",
            ),
        )
        known = () if pair.truth is None else pair.truth.apples or ()
        self._log(
            "world/truth",
            rr.Ellipsoids3D(
                centers=[a.centre_m for a in known],
                radii=[a.radius_m for a in known],
                colors=TRUTH,
                labels=[f"true {a.id}" for a in known],
                show_labels=False,
            ),
        )
        if self._rig.rangefinder is not None:
            self._draw_beam(pair)

    def _draw_beam(self, pair: StereoPair) -> None:
        beam = self._rig.rangefinder
        assert beam is not None
        lengths = [r.range_m for r in pair.readings]
        ends = [beam.origin_m + beam.direction * (BEAM_M if x is None else x) for x in lengths]
        self._log(
            "world/beam",
            rr.LineStrips3D(
                [[beam.origin_m, end] for end in ends],
                colors=[FAINT if x is None else TRUTH for x in lengths],
                labels=["no reading" if x is None else f"{x:.3f} m" for x in lengths],
            ),
        )

    def _draw_numbers(self, pair: StereoPair, trace: Trace, decode_ns: int) -> None:
        for stage, spent_ns in {"decode": decode_ns, **trace.stage_ns}.items():
            self._log(f"time_ms/{stage}", rr.Scalars(spent_ns / 1e6))
        counts = {
            "left_fruit": len(trace.left.circles.fruit),
            "right_fruit": len(trace.right.circles.fruit),
            "matched": sum(a.centre_m is not None for a in trace.apples),
            "readings": len(pair.readings),
        }
        for name, count in counts.items():
            self._log(f"count/{name}", rr.Scalars(count))


def _recorded(frame: Frame, view: ViewTrace) -> Any:
    """The recorded bytes as they are, where a viewer can read them."""
    if frame.encoding in COMPRESSED:
        return rr.EncodedImage(contents=frame.data, media_type=MEDIA_TYPES[frame.encoding])
    return _jpeg(view.picture)


def _jpeg(picture: Any) -> Any:
    _, data = cv2.imencode(".jpg", picture, _JPEG)
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg")


def _png(mask: Mask) -> Any:
    """A mask as a 1-bit PNG: 20 to 30 KB where raw bytes are a megabyte."""
    _, data = cv2.imencode(".png", mask, _PNG)
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/png", opacity=0.6)


def _rings(tried: npt.NDArray[np.float32]) -> Any:
    """Evenly chosen of the tried rings; thousands would hide the picture."""
    step = max(1, -(-len(tried) // RINGS_SHOWN))
    shown = tried[::step]
    return rr.Ellipses2D(
        centers=shown[:, 1:3], half_sizes=shown[:, [3, 3]], colors=FAINT, line_radii=-0.3
    )
