"""Ways to a range, side by side, on the apples that a rangefinder's beam ends on.

    python -m benchmarks.range_ways sessions/distance-*.mcap

Every way gets the same circles and matches of `pomolog`; errors are of the centre's distance. The
paper claims less than 20 mm for stereo from 400 to 1500 mm. A way without its instrument has none.
"""

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.one_line import one_line
from processor.count import count_frame
from processor.locate import Locator
from processor.methods import METHODS, locator_from
from processor.trace import sensed_of
from processor.with_reading import fruit_at
from recorder.pictures import decode
from recorder.rectify import rectify
from recorder.session import Session

WAYS = ("parallel", "outline_range", "reading_range", "depth_range", "fused_range")

Found = dict[str, list[tuple[float, float | None]]]
"""A way's errors and what it says of them, in metres."""


def ways() -> dict[str, Locator]:
    """`pomolog` with each way in turn."""
    return {way: locator_from({"base": "pomolog", "triangulate": {"use": way}}) for way in WAYS}


def errors_of(sessions: Iterable[Path]) -> tuple[Found, int]:
    """Every way's errors on apples with a reading, and how many readings met a found fruit."""
    found: Found = {way: [] for way in WAYS}
    met = 0
    for path in sessions:
        with Session(path) as session:
            rectification = rectify(session.rig)
            for pair in session.pairs():
                sensed = sensed_of(pair, session.rig)
                pictures = decode(pair.left), decode(pair.right)
                trace = METHODS["pomolog"](*pictures, rectification, (0, pair.index), sensed)
                places = {
                    fruit_at(b, trace.left.circles.fruit, rectification) for b in sensed.beams
                }
                names = count_frame(trace, pair.truth, rectification).found_left
                ids = {names[place] for place in places if place is not None and names}
                met += len(ids - {None})
                for way, locator in ways().items():
                    apples = locator.triangulate(
                        trace.left, trace.right, trace.matching, rectification, sensed
                    )
                    counts = count_frame(replace(trace, apples=apples), pair.truth, rectification)
                    found[way] += [
                        (v.error_m, v.std_m)
                        for v in counts.apples
                        if v.apple_id in ids and v.error_m is not None
                    ]
    return found, met


@one_line
def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("sessions", type=Path, nargs="+")
    words = parser.parse_args()
    cv2.setNumThreads(1)
    found, met = errors_of(words.sessions)
    shown = Table(title=f"{met} found apples that a beam ends on; errors of their centres, mm")
    for column in ("way", "n", "bias", "median", "RMSE", "largest", "in 95 % interval"):
        shown.add_column(column, justify="left" if column == "way" else "right")
    for way, pairs in found.items():
        if not pairs:
            shown.add_row(way, "0", *"-----")
            continue
        e = np.array([error for error, _ in pairs]) * 1e3
        covered = [abs(error) <= 1.96 * std for error, std in pairs if std is not None]
        shown.add_row(
            way, str(len(e)), f"{e.mean():+.1f}", f"{np.median(np.abs(e)):.1f}",
            f"{np.sqrt((e**2).mean()):.1f}", f"{np.abs(e).max():.1f}",
            f"{np.mean(covered):.0%}" if covered else "-",
        )  # fmt: skip
    Console(width=100).print(shown)


if __name__ == "__main__":
    main()
