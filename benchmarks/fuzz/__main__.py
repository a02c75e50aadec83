r"""Mutate files of every kind and read them as the commands do; none may crash, hang or lie.

    python -m benchmarks.fuzz 20000 [--seed 1] [--workers 2] [--only rig] [--input 7]

Each input is a number: the same seed and number make the same file. It is read in a process of
its own kind, in which memory is bounded and time is watched. A refusal is a `PomologError`, which
the commands print as one line; an answer is right if it is the sound file's, or, where no checksum
seals the file, whatever the file now says. Everything else is misbehaving: its number is told, and
the command ends with exit 1.
"""

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.fuzz.readers import Fuzz, Report


def table(names: list[str], reports: list[Report]) -> Table:
    """A row a target."""
    shown = Table()
    for column in ("input", "tried", "refused", "same answer", "other answer", "misbehaved",
                   "slowest", "peak memory"):  # fmt: skip
        shown.add_column(column, justify="left" if column == "input" else "right")
    sums = Counter[str]()
    for place, name in enumerate(names):
        mine = [report for report in reports if report[0] % len(names) == place]
        counts = Counter(verdict for _, verdict, *_ in mine)
        bad = sum(n for verdict, n in counts.items() if verdict.isupper())
        row = (len(mine), counts["refused"], counts["same answer"], counts["other answer"], bad)
        sums.update(dict(zip("abcde", row, strict=True)))
        slowest, peak = max((r[3] for r in mine), default=0), max((r[4] for r in mine), default=0)
        shown.add_row(name, *map(str, row), f"{slowest:.2f} s", f"{peak} MB")
    shown.add_row("all", *(str(sums[key]) for key in "abcde"), "", "")
    return shown


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("inputs", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="targets with this in their name")
    parser.add_argument(
        "--input", type=int, help="this one alone, as it is told when it misbehaves"
    )
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        fuzz = Fuzz(Path(folder), words.seed, words.only)
        numbers = [words.input] if words.input is not None else list(range(words.inputs))
        reports = fuzz.run(numbers, words.workers)
    Console(width=120).print(table(fuzz.names, reports))
    bad = [report for report in reports if report[1].isupper()]
    for number, verdict, detail, *_ in sorted(bad)[:40]:
        name = fuzz.names[number % len(fuzz.names)]
        print(f"{verdict} input {number} ({name}): {detail[-1500:]}")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
