"""How soon `pomolog --help` is there: over a bare interpreter of the same round."""

import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import Final

PAIRS: Final = 15  # a start takes 20 ms, so that single ones say more of the machine than of us


def help_start(pairs: int = PAIRS) -> dict[str, list[float]]:
    """The ratio of each pair of starts; they take turns in who is first."""
    script = Path(sys.executable).with_name("pomolog")
    front = [str(script)] if script.is_file() else [sys.executable, "-m", "pomolog"]
    bare, ours = [sys.executable, "-c", "pass"], [*front, "--help"]
    ratios = []
    for number in range(pairs + 1):
        turn = (bare, ours) if number % 2 else (ours, bare)
        seconds = {words[-1]: _seconds(words) for words in turn}
        if number:  # the first pair reads the files that the others find in memory
            ratios.append(seconds["--help"] / seconds["pass"])
    return {"pomolog --help / a bare interpreter": ratios}


def _seconds(words: list[str]) -> float:
    start = perf_counter()
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - start
