"""Draw finished traces into a Rerun recording (.rrd).

Entities: `world` is the left camera's optical frame. `world/left` and `world/right` are the
rectified cameras, with their picture, masks, contours, rings and fruit below them; `world/apples`,
`world/truth` and `world/beam` are in space; `index` has the colour index of each view, `match` both
views joined by their matches; `range`, `count`, `verdict`, `error_mm`, `health` and `time_ms` are
numbers. Colours are those of `processor.palette` in every view.
"""

from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun_bindings

from processor.count import FrameCounts
from processor.palette import ALONE, ESTIMATE, REJECTED
from processor.rrd_match import draw_match
from processor.rrd_numbers import draw_charts, draw_numbers
from processor.rrd_pictures import (
    heat_picture,
    index_picture,
    known_fruit,
    mask_picture,
    recorded,
)
from processor.rrd_session import (
    draw_beam,
    draw_exposure,
    draw_moment,
    draw_pair,
    draw_picture,
    draw_rig,
    draw_session,
    draw_truth,
    markdown,
)
from processor.trace import Circles, Trace
from recorder.pictures import decode
from recorder.records import SIDES, Side, StereoPair
from recorder.rectify import Rectification
from recorder.rig import Rig
from recorder.session import Session

APPLICATION: Final = "pomolog"
CONTOUR: Final = (0, 200, 160)
RINGS_SHOWN: Final = 400  # of each view; more hide what is under them and cost megabytes
FAR_M: Final = 10.0  # places beyond are wrong matches; one of them would shrink all the rest
# a chunk costs 2 KB beside what is in it, and a frame has forty; so several frames share one
_BATCHES: Final = rr.ChunkBatcherConfig(flush_tick=3600, flush_num_bytes=8 << 20)


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
        self._rec = rr.RecordingStream(
            APPLICATION, recording_id=recording_id, batcher_config=_BATCHES
        )
        self._rec.set_log_time_enabled(False)
        self._rec.set_log_tick_enabled(False)
        # Rerun's own file sink hangs for ever on a full disk, so the file is written here
        self._path = path
        self._encoded = rr.binary_stream(self._rec)
        self._rec.send_recording_name(name)
        self._rig = rig
        self._rectification = rectification
        self._first_ns = first_ns
        draw_rig(self._rec, rectification)
        draw_charts(self._rec)

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

    def write_session(self, session: Session, heading: str, method: str = "") -> None:
        """Draw what the session says of itself as a whole: once, in its first part.

        Args:
            session: to be told.
            heading: one line of what is shown of it.
            method: every parameter, as TOML; empty where nobody looks for fruit.
        """
        draw_session(self._rec, session, heading)
        if method:
            self._rec.log("method", markdown(f"```\n{method}\n```"), static=True)

    def write(self, pair: StereoPair, trace: Trace, counts: FrameCounts, decode_ns: int) -> None:
        """Draw one frame with all that was found in it."""
        self._draw_pair(pair, {side: trace.view(side).picture for side in SIDES})
        for side in SIDES:
            self._draw_view(side, pair, trace)
        draw_match(self._rec, trace, counts)
        self._draw_apples(trace)
        draw_numbers(self._rec, self._rig, pair, trace, counts, decode_ns)

    def write_pair(self, pair: StereoPair) -> None:
        """Draw one frame in which nobody has looked for fruit yet."""
        shot = {side: decode(pair.frame(side)) for side in SIDES}
        pictures = {side: self._rectification.view(side).picture(shot[side]) for side in SIDES}
        self._draw_pair(pair, pictures)
        for side in SIDES:  # with pixels of its own, so it stands beside the camera
            if self._rectification.view(side).maps is not None:
                self._rec.log(f"recorded/{side}", recorded(pair.frame(side), shot[side]))

    def _draw_pair(self, pair: StereoPair, pictures: dict[Side, Any]) -> None:
        draw_moment(self._rec, pair.index, pair.time_ns, self._first_ns)
        for side in SIDES:
            resampled = self._rectification.view(side).maps is not None
            draw_picture(self._rec, side, pair.frame(side), pictures[side], resampled=resampled)
        draw_exposure(self._rec, pictures)
        draw_truth(self._rec, pair.truth, self._rectification)
        if self._rig.rangefinder is not None:
            draw_beam(self._rec, self._rig.rangefinder, pair)
        draw_pair(self._rec, pair)

    def _draw_view(self, side: Side, pair: StereoPair, trace: Trace) -> None:
        root, view, truth = f"world/{side}", trace.view(side), pair.truth
        labels = None if truth is None else truth.labels(side)
        known = None
        if labels is not None:
            known = known_fruit(self._rectification.view(side).labels(labels))
        partial = truth is not None and truth.partial
        self._rec.log(f"index/{side}", index_picture(view.recognition))
        for name, mask in (("mask", view.recognition.mask), ("cleaned", view.cleaning.mask)):
            self._rec.log(f"{root}/{name}", mask_picture(mask, known, partial=partial))
        contours = [_thinned(region.contour_px) for region in view.cleaning.regions]
        self._rec.log(f"{root}/contours", rr.LineStrips2D(contours, radii=-0.5, colors=CONTOUR))
        self._rec.log(f"{root}/tried", _rings(view.circles.tried))
        if view.circles.heat is not None:
            self._rec.log(f"centres/{side}", heat_picture(view.circles.heat))
        self._draw_fruit(side, view.circles, trace)

    def _draw_fruit(self, side: Side, circles: Circles, trace: Trace) -> None:
        """The winning circles, and at their rims, not over the fruit, the apples' numbers."""
        numbers, ranges, colours = {}, {}, {}
        for number, apple in enumerate(trace.apples):
            place = apple.left if side == "left" else apple.right
            if place is None:
                continue
            far = "" if apple.surface_range_m is None else f": {apple.surface_range_m:.3f} m"
            numbers[place], ranges[place] = str(number), f"{number}{far}"
            colours[place] = ALONE if apple.centre_m is None else ESTIMATE
        array = circles.as_array()
        order = range(len(array))
        shades = [colours.get(i, ALONE) for i in order]
        self._rec.log(
            f"world/{side}/fruit",
            rr.Ellipses2D(
                centers=array[:, :2],
                half_sizes=array[:, [2, 2]],
                colors=shades,
                labels=[ranges.get(i, "") for i in order],
                show_labels=False,
                line_radii=-1.5,
            ),
        )
        placed = [i for i in order if colours.get(i) == ESTIMATE]
        self._rec.log(
            f"world/{side}/numbers",
            rr.Points2D(
                array[placed, :2] + array[placed, 2:] * (0.0, 1.0),
                radii=-1.0,
                colors=ESTIMATE,
                labels=[numbers[i] for i in placed],
                show_labels=True,
            ),
        )

    def _draw_apples(self, trace: Trace) -> None:
        placed = [
            (number, apple.centre_m, apple.radius_m or 0.0)
            for number, apple in enumerate(trace.apples)
            if apple.centre_m is not None and max(map(abs, apple.centre_m)) < FAR_M
        ]
        self._rec.log(
            "world/apples",
            rr.Ellipsoids3D(
                centers=[centre for _, centre, _ in placed],
                radii=[radius for *_, radius in placed],
                colors=ESTIMATE,
                labels=[str(n) for n, *_ in placed],
                show_labels=False,
                fill_mode="solid",
            ),
        )


def _thinned(contour_px: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """A contour within a pixel of what it was, by a fifth of its points."""
    return np.asarray(cv2.approxPolyDP(contour_px[:, None], 1.0, True), np.int32)[:, 0]


def _rings(tried: npt.NDArray[np.float32]) -> Any:
    """Evenly chosen of the tried rings; thousands would hide the picture."""
    step = max(1, -(-len(tried) // RINGS_SHOWN))
    shown = tried[::step]
    return rr.Ellipses2D(
        centers=shown[:, 1:3], half_sizes=shown[:, [3, 3]], colors=(*REJECTED, 90), line_radii=-0.4
    )
