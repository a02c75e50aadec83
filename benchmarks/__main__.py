"""Ratios of whole steps, measured side by side in one run: `docs/performance.md` explains each.

    python -m benchmarks

Machines differ and are noisy, so nothing here is a limit in seconds: every figure is the median,
over rounds, of one step's time divided by another's in the same round.
"""

import argparse
import itertools
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Final

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.growth import replays
from benchmarks.material import JPEG
from benchmarks.start import help_start
from processor.methods import METHODS
from recorder.pictures import decode
from recorder.records import Frame, StereoPair
from recorder.rectify import rectify
from recorder.session import Session

PAPER_CYCLE_MS: Final = 2350  # Sec. 3.3, on a Core 2 Duo of 2.4 GHz
TIMED: Final = ("paper", "pomolog", "pomolog-fast")

Step = Callable[[], object]


def steps(pair: StereoPair, session: Session) -> dict[str, Step]:
    """What is timed, each on both views of one pair."""
    left, right = decode(pair.left), decode(pair.right)
    jpegs = [_as_jpeg(frame) for frame in (pair.left, pair.right)]
    greys = [cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) for picture in (left, right)]
    rectification = rectify(session.rig)
    matcher = cv2.StereoSGBM.create(0, 640, 5)
    return {
        "decode": lambda: [decode(jpeg) for jpeg in jpegs],
        "paper": lambda: METHODS["paper"](left, right, rectification, (0, pair.index)),
        "pomolog": lambda: METHODS["pomolog"](left, right, rectification, (0, pair.index)),
        "pomolog-fast": lambda: METHODS["pomolog-fast"](
            left, right, rectification, (0, pair.index)
        ),
        "HoughCircles": lambda: [_hough(grey) for grey in greys],
        "StereoSGBM": lambda: matcher.compute(*greys),
    }


def _as_jpeg(frame: Frame) -> Frame:
    _, data = cv2.imencode(".jpg", decode(frame), JPEG)
    return Frame(frame.side, frame.time_ns, "jpeg", data.tobytes(), frame.size_px)


def _hough(grey: cv2.typing.MatLike) -> object:
    return cv2.HoughCircles(
        grey, cv2.HOUGH_GRADIENT, 1, 30, param1=100, param2=30, minRadius=30, maxRadius=60
    )


def measure(session_path: Path, rounds: int) -> dict[str, list[float]]:
    """Seconds of every step, round by round; the steps of a round follow each other."""
    seconds: dict[str, list[float]] = {}
    with Session(session_path) as session:
        for pair in session.pairs():
            timed = steps(pair, session)
            for number in range(rounds + 1):
                for name, step in timed.items():
                    if number == 0 and name == "StereoSGBM":
                        continue  # slow, and needs no warming up
                    start = perf_counter()
                    step()
                    if number:  # the first round warms caches up
                        seconds.setdefault(name, []).append(perf_counter() - start)
    return seconds


def main() -> None:
    """Measure and print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--session", type=Path, default=Path("sessions/demo.mcap"))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--pairs", type=int, default=128, help="of the replays")
    words = parser.parse_args()
    cv2.setNumThreads(1)
    seconds = measure(words.session, words.rounds)
    ratios = help_start() | located(seconds)
    with tempfile.TemporaryDirectory() as folder:
        ratios |= replays(Path(folder), words.session, words.pairs, words.rounds)
    shown = Table(title=f"{words.session}, medians of {words.rounds} rounds")
    for column in ("ratio", "median", "10% to 90%"):
        shown.add_column(column, justify="left" if column == "ratio" else "right")
    for name, found in ratios.items():
        low, high = np.percentile(found, [10, 90])
        digits = 3 if low < 0.1 else 2
        shown.add_row(name, f"{median(found):.{digits}f}", f"{low:.{digits}f} - {high:.{digits}f}")
    Console(width=100).print(shown)


def located(seconds: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
    """What finding apples costs beside what others do with the same pictures; less is better."""
    peers = (("decode", "JPEG decode"), ("HoughCircles",) * 2, ("StereoSGBM",) * 2)
    ratios = {
        f"locate ({method}) / {below}": [
            a / b for a, b in zip(seconds[method], seconds[name], strict=True)
        ]
        for method, (name, below) in itertools.product(TIMED, peers)
    }
    for method in TIMED:
        ratios[f"decode + locate ({method}) / the paper's cycle of 2350 ms"] = [
            (a + b) * 1e3 / PAPER_CYCLE_MS
            for a, b in zip(seconds[method], seconds["decode"], strict=True)
        ]
    return ratios


if __name__ == "__main__":
    main()
