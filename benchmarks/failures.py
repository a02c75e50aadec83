"""The worst failures of `pomolog` on sessions with truth, as pictures and as Markdown.

    python -m benchmarks.failures S.mcap... --out docs/pictures

Kinds take turns (missed, false, wrong match, range), the worst of each first. In the pictures blue
is true, orange was found and located, purple was found without a partner.
"""

import argparse
import tempfile
from pathlib import Path

from benchmarks.one_line import one_line
from processor.methods import METHODS
from processor.replay import replay
from processor.runs import find_runs
from processor.worst import worst_cases
from recorder.errors import PomologError
from recorder.files import replacing
from viewer.strips import strips


@one_line
def main() -> None:
    """Replay, rank, draw, and print what a page shows of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("sessions", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=10)
    words = parser.parse_args()
    words.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for outcome in replay(
            words.sessions, Path(folder), METHODS["pomolog"], method="pomolog", rrd="none"
        ):
            if isinstance(outcome, PomologError):
                raise outcome
        runs = find_runs([Path(folder)])
        cases = worst_cases([run.folder for run in runs], words.count)
        for strip in strips(runs, cases):
            if strip.jpeg is None:
                raise PomologError(strip.problem)
            name = f"failure-{strip.place + 1}.jpg"
            with replacing(words.out / name) as part:
                part.write_bytes(strip.jpeg)
            case = strip.case
            print(f"{strip.place + 1}. *{case.kind}*, {case.how_much}: {case.why}")
            print(f"   (`{case.session}`, frame {case.frame}).\n")
            print(f"   ![{strip.alt}]({words.out.name}/{name})\n")


if __name__ == "__main__":
    main()
