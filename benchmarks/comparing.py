"""What `pomolog compare` says where the answer is known: no change, a bias, a loss of fruit.

    python -m benchmarks.comparing sessions/demo.mcap ... -o FOLDER [--method pomolog] [--seeds 12]

Replays the sessions with so many seeds, then plays comparisons: each draws pairs of pictures from
those there are, with replacement, and for each of them two of the runs, one as A, one as B. So A
and B are one method, and any difference that is said is a false alarm, unless it was planted.
"""

import argparse
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.one_line import one_line
from processor.compare.judge import Judged, judge
from processor.compare.pictures import (
    Results,
    error_sums,
    errors_of,
    picture_sums,
    places_of,
    read_results,
)
from processor.compare.sides import open_sides
from processor.measures import COUNTED, WITH_TRUTH
from processor.methods import load_method
from processor.paired import Interval, differences
from processor.replay import replay
from recorder.errors import PomologError
from recorder.progress import progress
from recorder.rig import Floats

Sums = dict[str, Floats]
Plant = Callable[[Sums, np.random.Generator], Sums]

BIAS_M: Final = 0.002
LOSS: Final = 0.01
PAIRS: Final = (10, 20, 50, 100, 200, 500, 1000, 2000)
DRAWS: Final = 400  # of each bootstrap: enough to count how often zero lies within


@dataclass(frozen=True, slots=True)
class Pool:
    """Every run's sums.

    Attributes:
        counted: column -> (runs, pictures).
        common: column -> (runs, runs, pictures): the first run's errors on fruit that both located.
    """

    counted: Sums
    common: Sums

    @property
    def runs(self) -> int:
        """How many seeds there are."""
        return len(self.counted["pairs"])

    @property
    def pictures(self) -> int:
        """How many pairs of pictures there are."""
        return int(self.counted["pairs"].shape[1])


def replay_seeds(sessions: Sequence[Path], out: Path, method: str, seeds: int) -> list[Path]:
    """Replay the sessions with every seed; what is there already is kept."""
    name, locator = load_method(method)
    folders = [out / f"{name}-{seed}" for seed in range(seeds)]
    with progress("replaying", seeds * len(sessions)) as tick:
        for seed, folder in enumerate(folders):
            for done in replay(
                sessions, folder, locator, method=name, seed=seed, rrd="none",
                workers=os.cpu_count() or 1,
            ):  # fmt: skip
                if isinstance(done, PomologError):
                    raise done
                tick()
    return folders


def pool_of(folders: Sequence[Path]) -> Pool:
    """Read the runs."""
    listed = ",".join(map(str, folders))
    sides = open_sides(listed, listed)
    counted, common = [], []
    for session in sides.sessions:
        runs = [read_results(session, repeat.sessions[session]) for repeat in sides.a.repeats]
        counted.append([picture_sums(run) for run in runs])
        common.append([[_common(one, other) for other in runs] for one in runs])
    return Pool(
        {n: np.hstack([[run[n] for run in part] for part in counted]) for n in COUNTED},
        {
            n: np.concatenate([[[o[n] for o in one] for one in part] for part in common], axis=2)
            for n in ("errors", "error_m", "error2_m2")
        },
    )


def _common(one: Results, other: Results) -> Sums:
    ours, theirs = errors_of(one), errors_of(other)
    return error_sums(places_of(one), ours, [key for key in ours if key in theirs])


def trial(
    pool: Pool, pairs: int, plant: Plant, rng: np.random.Generator, *, same_seed: bool = False
) -> list[Judged]:
    """One comparison of the method with itself, something planted in B."""
    places = rng.integers(pool.pictures, size=pairs)
    a = rng.integers(pool.runs, size=pairs)
    b = a if same_seed else (a + rng.integers(1, pool.runs, size=pairs)) % pool.runs
    sides = [
        {n: column[run, places] for n, column in pool.counted.items()}
        | {n: column[run, other, places] for n, column in pool.common.items()}
        for run, other in ((a, b), (b, a))
    ]
    found = differences(
        WITH_TRUTH, sides[0], plant(sides[1], rng), np.arange(pairs), rng, draws=DRAWS
    )
    return judge(WITH_TRUTH, found, {})


def nothing(sums: Sums, _: np.random.Generator) -> Sums:
    """Plant nothing."""
    return sums


def bias(sums: Sums, _: np.random.Generator) -> Sums:
    """Every distance is longer by 2 mm."""
    longer = sums["error_m"] + BIAS_M * sums["errors"]
    squares = sums["error2_m2"] + 2 * BIAS_M * sums["error_m"] + BIAS_M**2 * sums["errors"]
    return sums | {"error_m": longer, "error2_m2": squares}


def loss(sums: Sums, rng: np.random.Generator) -> Sums:
    """Each fruit that was found, and each that was matched rightly, is lost once in a hundred."""
    known = np.nan_to_num(sums["fruit_tp"]).astype(int)
    lost, unmatched = rng.binomial(known, LOSS), rng.binomial(sums["right"].astype(int), LOSS)
    return sums | {
        "fruit_tp": sums["fruit_tp"] - lost,
        "fruit_fn": sums["fruit_fn"] + lost,
        "right": sums["right"] - unmatched,
        "missed": sums["missed"] + unmatched,
    }


def _shown(judged: Sequence[Judged], *names: str) -> bool:
    shown = ("better", "worse", "differs")
    return any(one.verdict in shown for one in judged if one.measure.name in names)


def _worse(judged: Sequence[Judged], *names: str) -> bool:
    return any(one.verdict == "worse" for one in judged if one.measure.name in names)


def _alone(judged: Sequence[Judged]) -> list[bool]:
    """Each measure's own test, uncorrected."""
    found = [one.difference for one in judged]
    return [d.p < 0.05 for d in found if d is not None and d.p is not None and d.std]


def _covers(judged: Sequence[Judged]) -> list[bool]:
    """Whether each measure's interval has the true change, which is none."""
    found = [one.difference for one in judged]
    ends: list[Interval] = [d.interval95 for d in found if d is not None and d.std]
    return [low <= 0 <= high for low, high in ends]


def rows(pool: Pool, trials: int, seed: int, tick: Callable[[], None]) -> Iterator[list[str]]:
    """A row for each number of pairs."""
    names = [measure.name for measure in WITH_TRUTH]
    for pairs in PAIRS:
        rng = np.random.default_rng((seed, pairs))
        alarms: list[bool] = []
        alone: list[bool] = []
        covers: list[bool] = []
        biased: list[bool] = []
        lost: list[bool] = []
        lost_alone: list[bool] = []
        equal: list[bool] = []
        for _ in range(trials):
            judged = trial(pool, pairs, nothing, rng)
            alarms.append(_shown(judged, *names))
            alone += _alone(judged)
            covers += _covers(judged)
            equal += [one.verdict == "no difference shown" for one in judged]
            biased.append(_shown(trial(pool, pairs, bias, rng), "distance_bias_mm"))
            lost.append(_worse(trial(pool, pairs, loss, rng), "fruit_recall", "match_found"))
            judged = trial(pool, pairs, loss, rng, same_seed=True)
            lost_alone.append(_worse(judged, "fruit_recall", "match_found"))
            tick()
        shares = (alarms, alone, covers, equal, biased, lost, lost_alone)
        yield [f"{pairs:,}", *(f"{100 * np.mean(share):.1f}" for share in shares)]


@one_line
def main() -> None:
    """Replay, play and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("sessions", type=Path, nargs="+")
    parser.add_argument("--out", "-o", type=Path, required=True)
    parser.add_argument("--method", default="paper")
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--trials", type=int, default=400)
    words = parser.parse_args()
    pool = pool_of(replay_seeds(words.sessions, words.out, words.method, words.seeds))
    matched = pool.counted["right"].sum(axis=1).mean() / pool.pictures
    shown = Table(
        title=f"{words.method}: {pool.pictures} pairs of pictures, {pool.runs} seeds, "
        f"{matched:.1f} right matches a pair, {words.trials} trials a row; percent of trials"
    )
    for column in (
        "pairs", "any false alarm", "p < 0.05 of one measure", "95 % interval has 0",
        '"no difference shown"', "2 mm bias found", "1 % loss found",
        "1 % loss, one seed",
    ):  # fmt: skip
        shown.add_column(column, justify="right")
    with progress("comparing", words.trials * len(PAIRS)) as tick:
        for row in rows(pool, words.trials, 0, tick):
            shown.add_row(*row)
    Console(width=110).print(shown)


if __name__ == "__main__":
    main()
