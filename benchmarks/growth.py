"""How replay grows: the cost of a pair from ten to thousands, two workers, and bare decoding.

    python -m benchmarks.growth [--most 2000] [--size 640x512] [--rounds 3] [--plot growth.png]

The pairs are those of a session again and again, as JPEG 4:4:4 at quality 95, without truth. A
pair's cost is processor time, which other work on the machine does not lengthen much; ratios are
of runs that follow each other, and medians of the rounds.
"""

import argparse
import multiprocessing
import resource
import shutil
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final

import cv2
from rich.console import Console
from rich.table import Table

from benchmarks.material import many_pairs
from benchmarks.one_line import one_line
from processor.methods import METHODS
from processor.replay import SLICE_PAIRS, Replayed, replay
from processor.slices import RrdChoice
from recorder.pictures import decode
from recorder.session import Session

SIZES: Final = (10, 32, 100, 320, 1000, 2000)


@dataclass(frozen=True, slots=True)
class Cost:
    """What one run took, in seconds."""

    wall_s: float
    cpu_s: float


def decode_slice(path: Path, start: int, stop: int) -> None:
    """Only what nobody can do without: read the pairs and decode them."""
    cv2.setNumThreads(1)
    with Session(path) as session:
        for pair in session.pairs(start, stop):
            decode(pair.left), decode(pair.right)


def timed(work: Callable[[], object]) -> Cost:
    """Run it; children count with their processor time once they have ended."""

    def cpu_s() -> float:
        usages = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(usage.ru_utime + usage.ru_stime for usage in usages)

    cpu, wall = cpu_s(), time.perf_counter()
    work()
    return Cost(time.perf_counter() - wall, cpu_s() - cpu)


def replayed(session: Path, workers: int, rrd: RrdChoice = "none") -> None:
    """Replay it with the paper's method into a folder that is taken away again."""
    with tempfile.TemporaryDirectory(dir=session.parent) as out:
        (done,) = replay([session], Path(out), METHODS["paper"], workers=workers, rrd=rrd)
        assert isinstance(done, Replayed), done


def _replayed_often(session: Path, times: int) -> None:
    for _ in range(times):
        replayed(session, 1)


def decoded(session: Path, pairs: int, workers: int) -> None:
    """Decode all of it in the same slices with as many processes."""
    starts = range(0, pairs, SLICE_PAIRS)
    if workers == 1:
        for start in starts:
            decode_slice(session, start, min(start + SLICE_PAIRS, pairs))
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        stops = [min(start + SLICE_PAIRS, pairs) for start in starts]
        list(pool.map(decode_slice, [session] * len(starts), starts, stops))


def growth(folder: Path, source: Path, words: argparse.Namespace) -> list[tuple[int, list[float]]]:
    """Milliseconds of processor time a pair, for every size, round by round."""
    sizes = [count for count in SIZES if count <= words.most]
    sessions = {n: many_pairs(source, folder / f"s{n}.mcap", n, words.size) for n in sizes}
    replayed(sessions[sizes[0]], 1)  # warms up
    found: dict[int, list[float]] = {count: [] for count in sizes}
    for _ in range(words.rounds):
        for count, session in sessions.items():
            repeats = max(1, 64 // count)  # a few pairs alone are over before the clock has ticked
            cost = timed(partial(_replayed_often, session, repeats))
            found[count].append(cost.cpu_s / repeats / count * 1e3)
    return list(found.items())


def replays(
    folder: Path, source: Path, pairs: int, rounds: int, size_px: tuple[int, int] | None = None
) -> dict[str, list[float]]:
    """Ratios of replays of the same pairs (method paper), round by round.

    Args:
        folder: gets the sessions, in the size of `source` unless `size_px` says another.
        source: whose pairs are taken again and again.
        pairs: how many of them.
        rounds: how often everything is run.
        size_px: (width, height).
    """
    session = many_pairs(source, folder / "many.mcap", pairs, size_px)
    few = many_pairs(source, folder / "few.mcap", SIZES[0], size_px)
    ratios: dict[str, list[float]] = {}
    for _ in range(rounds):
        costs = {
            (what, workers): timed(work)
            for workers in (1, 2)
            for what, work in (
                ("decode", partial(decoded, session, pairs, workers)),
                ("replay", partial(replayed, session, workers)),
            )
        }
        bare, full = costs["decode", 1], costs["replay", 1]
        drawn, short = (
            timed(partial(replayed, session, 1, "full")),
            timed(partial(replayed, few, 1)),
        )
        found = {
            "replay / bare decoding, pairs a second, 1 worker": bare.wall_s / full.wall_s,
            "the same with 2 workers": costs["decode", 2].wall_s / costs["replay", 2].wall_s,
            "the same, by processor time": bare.cpu_s / full.cpu_s,
            "replay with 2 workers / 1, pairs a second": full.wall_s / costs["replay", 2].wall_s,
            "replay with a recording / without, processor time": drawn.cpu_s / full.cpu_s,
            f"a pair of {pairs} / a pair of {SIZES[0]}, processor time": (full.cpu_s / pairs)
            / (short.cpu_s / SIZES[0]),
        }
        for name, ratio in found.items():
            ratios.setdefault(name, []).append(ratio)
    return ratios


def plot(costs: list[tuple[int, list[float]]], path: Path) -> None:
    """The cost of a pair over the number of pairs."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
    for count, found in costs:
        axes.plot([count] * len(found), found, "o", color="0.7", markersize=4)
    axes.plot([n for n, _ in costs], [median(found) for _, found in costs], "o-", color="tab:blue")
    axes.set(
        xscale="log", xlabel="pairs in the session", ylabel="processor time a pair, ms",
        ylim=(0, 1.4 * max(median(found) for _, found in costs)),
    )  # fmt: skip
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


@one_line
def main() -> None:
    """Measure, print and plot."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--session", type=Path, default=Path("sessions/demo.mcap"))
    parser.add_argument("--most", type=int, default=SIZES[-1])
    parser.add_argument("--pairs", type=int, default=256, help="of the ratios")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--size", default=(640, 512), type=lambda w: tuple(int(side) for side in w.split("x"))
    )
    parser.add_argument("--plot", type=Path)
    words = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="growth"))
    try:
        costs = growth(folder, words.session, words) if words.most else []
        ratios = (
            replays(folder, words.session, words.pairs, words.rounds, words.size)
            if words.pairs
            else {}
        )
    finally:
        shutil.rmtree(folder)
    size = "x".join(map(str, words.size))
    shown = Table(title=f"method paper, {size}, rows only, medians of {words.rounds} rounds")
    for column in ("pairs in the session", "processor time a pair", "lowest to highest"):
        shown.add_column(column, justify="right")
    for count, found in costs:
        spread = f"{min(found):.2f} - {max(found):.2f} ms"
        shown.add_row(str(count), f"{median(found):.2f} ms", spread)
    console = Console(width=100)
    if costs:
        console.print(shown)
    for name, found in ratios.items():
        console.print(f"{name}: {median(found):.2f} ({min(found):.2f} - {max(found):.2f})")
    if words.plot:
        plot(costs, words.plot)


if __name__ == "__main__":
    main()
