"""How pictures look in numbers: those of the digital orchard held against real ones.

    python -m benchmarks.colours [--real ../shared/data] [--plot docs/orchard-colours.png]

Over all pixels of apples, and over all of everything else: the 10th, 50th and 90th percentile of
each feature, and how many pixels the paper's rule, taken literally, calls apple. Ours are the left
views of recorded sessions. The real pictures are others' and no part of the project: a set that is
not in the folder is left out of the table, and the plot is then not drawn.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, cast

import cv2
import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks.features import BINS, FEATURES, PIXELS, Labelled, Summary, cells, summary
from benchmarks.one_line import one_line
from processor.experiments.real_pictures import CROPS, TREE
from processor.experiments.story import read_pair, read_truth
from processor.lessons import boxed, lesson_pairs
from recorder.errors import PomologError
from recorder.files import replacing, require_ending
from recorder.progress import progress
from recorder.records import UNCOUNTED, Labels, counted_fruit

RIM_PX: Final = 2  # outlines drawn by hand run over leaves here, and leave fruit out there
SESSIONS: Final = Path(__file__).parent.parent / "sessions"


@dataclass(frozen=True, slots=True)
class PictureSet:
    """Pictures of one kind, read when they are wanted, and how their line is drawn."""

    name: str
    colour: str
    read: Callable[[], list[Labelled]]


def rendered(name: str) -> list[Labelled]:
    """The left views of a recorded session."""
    pairs = lesson_pairs([SESSIONS / name])
    return [(left.picture, left.labels) for left, _ in pairs]


def tree(folder: Path) -> list[Labelled]:
    """Two frames of a real tree; of its many fruit only 26 have masks."""
    rig, *pictures = read_pair(folder)
    truth = read_truth(folder, rig.left).truth
    return [
        (picture, without_rim(cast("Labels", labels)))
        for picture, labels in zip(pictures, (truth.left, truth.right), strict=True)
    ]


def without_rim(labels: Labels) -> Labels:
    """The same with 65535 where fruit begins: 2 px to either side."""
    fruit = counted_fruit(labels).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * RIM_PX + 1, 2 * RIM_PX + 1))
    rim = cv2.morphologyEx(fruit, cv2.MORPH_GRADIENT, disc) > 0
    return np.where(rim, np.uint16(UNCOUNTED), labels)


def photographs(folder: Path) -> list[Labelled]:
    """Photographs with boxes: apple is a box's inner ellipse, else is what lies beyond an outer."""
    lessons = [lesson for part in ("train", "test") for lesson in boxed(folder, part)]
    return [(lesson.picture, lesson.labels) for lesson in lessons]


RENDERED: Final = tuple(
    PictureSet(name, colour, partial(rendered, f"{session}.mcap"))
    for name, colour, session in (
        ("Fuji, front", "tab:red", "segmentation-front-test"),
        ("Fuji, back", "tab:blue", "segmentation-back-test"),
        ("Fuji, cloudy", "tab:green", "segmentation-cloudy-test"),
        ("dark red, front", "tab:purple", "cultivar-dark-red"),
    )
)
REAL: Final = (
    ("Story (real)", "black", TREE, tree),
    ("AppleBBCH81 (real)", "0.6", CROPS, photographs),
)


def real_sets(folder: Path) -> tuple[tuple[PictureSet, ...], tuple[str, ...]]:
    """The real sets that the folder has, and the names of those that it has not."""
    there = {kind: (folder / kind.folder / kind.needs).exists() for _, _, kind, _ in REAL}
    found = tuple(
        PictureSet(name, colour, partial(read, folder / kind.folder))
        for name, colour, kind, read in REAL
        if there[kind]
    )
    return found, tuple(kind.folder for kind, is_there in there.items() if not is_there)


Summaries = dict[str, dict[str, Summary]]
"""Kind of pixels -> name of the set -> what they look like."""


def measure(sets: Sequence[PictureSet]) -> Summaries:
    """Measure every set, holding the pictures of one at a time.

    Raises:
        PomologError: a session or picture is missing or damaged.
    """
    summaries: Summaries = {kind: {} for kind in PIXELS}
    with progress("measuring", len(sets)) as tick:
        for one in sets:
            pictures = one.read()
            for kind, found in summaries.items():
                found[one.name] = summary(one.name, pictures, kind)
            tick()
    return summaries


def table(summaries: Summaries) -> Table:
    """A line a kind of pixels and set of pictures, as Markdown: docs/orchard.md shows it."""
    shown = Table(box=box.MARKDOWN)
    for column in ("pixels", "pictures", *FEATURES, "rule keeps"):
        shown.add_column(column, no_wrap=True)
    for kind, of_sets in summaries.items():
        for name, found in of_sets.items():
            shown.add_row(kind, name, *cells(found))
    return shown


def plot(summaries: Summaries, sets: Sequence[PictureSet], path: Path) -> None:
    """A panel a kind of pixels and feature: the share of pixels in each bin, a line a set.

    Raises:
        PomologError: the file cannot be written.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, rows = plt.subplots(
        len(summaries), len(FEATURES), figsize=(12, 5.5), layout="constrained"
    )
    for axes_row, (kind, of_sets) in zip(rows, summaries.items(), strict=True):
        for axes, (name, feature) in zip(axes_row, FEATURES.items(), strict=True):
            edges = np.linspace(*feature.span, BINS + 1)
            for one in sets:
                shares = of_sets[one.name].spreads[name].shares * 100
                axes.plot((edges[1:] + edges[:-1]) / 2, shares, color=one.colour, label=one.name)
            axes.set(title=f"{kind}: {name}", xlim=feature.span, ylim=(0, None))
            axes.grid(alpha=0.3)
        axes_row[0].set_ylabel(f"% of pixels, in each of {BINS} bins")
    handles, names = rows[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(sets), frameon=False)
    with replacing(path) as part:
        figure.savefig(part, dpi=100, format="png")
    plt.close(figure)


@one_line
def main() -> None:
    """Measure, print and plot."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--real", type=Path, help="folder of story_orchard and applebbch81")
    parser.add_argument("--plot", type=Path, help="PNG of the histograms")
    words = parser.parse_args()
    cv2.setNumThreads(1)
    if words.plot:
        require_ending(words.plot, ".png")
        if words.plot.is_dir():
            raise PomologError(f"--plot {words.plot} is a folder; give it a name in there")
    real, missing = real_sets(words.real) if words.real else ((), ())
    sets = (*real, *RENDERED)
    summaries = measure(sets)
    Console(width=140).print(table(summaries))
    if missing:
        kept = f"; {words.plot} stays as it is" if words.plot else ""
        print(f"left out: no {' and no '.join(missing)} in {words.real}{kept}")
    elif words.plot:
        plot(summaries, sets, words.plot)
        print(words.plot)


if __name__ == "__main__":
    main()
