"""Run the experiments one after another; what was done before is taken as it is."""

import json
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np

from processor.experiments.ambiguity import ambiguity
from processor.experiments.comparisons import distances
from processor.experiments.cycle import cycle
from processor.experiments.exposure import exposure
from processor.experiments.item import Item
from processor.experiments.line_profile import line_profile
from processor.experiments.matching import matching
from processor.experiments.material import Material
from processor.experiments.page import as_markdown, page
from processor.experiments.real_pictures import CROPS, TREE, find_real, real_crops, real_tree
from processor.experiments.rings import circles
from processor.experiments.rounds import contour_rounds
from processor.experiments.segmentation import segmentation
from processor.experiments.segmentation_pictures import figure_5
from processor.experiments.store import read_items, write_items
from processor.experiments.work import Bench, Tick, key_of, open_bench
from recorder.errors import PomologError
from recorder.files import writable, write_text

Generator = np.random.Generator


@dataclass(frozen=True, slots=True)
class Experiment:
    """What gives some items, and the sets of sessions that it needs.

    Attributes:
        name: of its kept result.
        items: their ids, sources and titles.
        needs: the sets, at least one session of each.
        looks_at: all sets that it uses where they exist; its results depend on those alone.
        run: from sessions to items.
    """

    name: str
    items: tuple[tuple[str, str, str], ...]
    needs: tuple[str, ...]
    looks_at: tuple[str, ...]
    run: Callable[[Material, Bench, Generator], tuple[Item, ...]]


def _segmentation(material: Material, bench: Bench, rng: Generator) -> tuple[Item, ...]:
    """Table 1 with Fig. 5 before its own figure."""
    first, *rest = segmentation(material, bench, rng)
    pictures = figure_5(material.of("segmentation"))
    return replace(first, figures=(pictures, *first.figures)), *rest


EXPERIMENTS: Final = (
    Experiment("line-profile", (("fig2", "Fig. 2", "Line profile across a fruit"),),
               ("segmentation",), ("segmentation",), lambda m, b, _: line_profile(m, b)),
    Experiment("segmentation",
               (("table1", "Fig. 5, Table 1", "Fruit pixels recognised, by lighting"),
                ("pictures", "Sec. 3.1", "Pictures “correctly segmented”")),
               ("segmentation",), ("segmentation",), _segmentation),
    Experiment("rounds", (("fig6", "Fig. 6", "How many rounds the random ring method needs"),),
               ("matching",), ("matching", "segmentation"),
               lambda m, _, rng: contour_rounds(m, rng)),
    Experiment("circles", (("fig7", "Fig. 7", "Random ring against Hough's transform"),),
               ("matching",), ("matching", "segmentation"), lambda m, b, _: circles(m, b)),
    Experiment("matching",
               (("matching", "Fig. 4, Sec. 3.3", "Fruit matched from left to right"),),
               ("matching",), ("matching", "segmentation"), lambda m, b, _: matching(m, b)),
    Experiment("distances",
               (("fig8", "Fig. 8", "Distance error from 400 to 1500 mm"),
                ("table2", "Table 2", "Do light, occlusion and neighbours change the error?")),
               ("distance",), ("distance",), lambda m, b, _: distances(m, b)),
    Experiment("cycle", (("cycle", "Sec. 3.3", "The processing cycle"),),
               ("matching",), ("matching",), lambda m, b, _: cycle(m, b)),
    Experiment("exposure", (("exposure", "Sec. 3.3", "Over- and under-exposure"),),
               ("exposure",), ("exposure",), exposure),
    Experiment("ambiguity",
               (("ambiguity", "throughout", "Where the paper is silent"),),
               ("segmentation", "matching"),
               ("segmentation", "matching", "distance"), lambda m, b, _: ambiguity(m, b)),
)  # fmt: skip
ITEMS: Final = tuple(item[0] for experiment in EXPERIMENTS for item in experiment.items)
REAL_ITEMS: Final = (TREE.id, CROPS.id)
HOW_TO_MAKE: Final = {
    "segmentation": "segmentation-front", "matching": "matching-front",
    "distance": "distance-indoor-clear", "exposure": "exposure-front",
}  # fmt: skip


def chosen_items(words: str, *, real: bool) -> frozenset[str]:
    """The items that `--only` names; all where it is empty.

    Raises:
        PomologError: a name that is no item.
    """
    known = (*ITEMS, *REAL_ITEMS)
    asked = [word.strip() for word in words.split(",") if word.strip()]
    for word in asked:
        if word not in known:
            raise PomologError(f"no item {word!r}; --only takes {', '.join(known)}")
        if word in REAL_ITEMS and not real:
            raise PomologError(f"{word} needs real pictures; give their folder with --real DIR")
    return frozenset(asked or known)


def run_paper(
    material: Material,
    bench: Bench,
    out: Path,
    *,
    only: frozenset[str],
    real: Path | None = None,
) -> Iterator[Item]:
    """Give every item in the paper's order: measured now, taken as kept, or said why not.

    Args:
        material: the sessions.
        bench: where pairs are measured.
        out: gets tables and figures, and keeps the items.
        only: the items that are wanted.
        real: a folder of real pictures.
    """
    for experiment in EXPERIMENTS:
        asked = any(name in only for name, _, _ in experiment.items)
        missing = [s for s in experiment.needs if not material.of(s)]
        if missing:
            yield from (_not_run(item, missing[0]) for item in experiment.items)
            continue
        sources = material.of(*experiment.looks_at)
        key = key_of(experiment.name, [(s.name, s.fingerprint, s.pairs) for s in sources])
        items = read_items(out, experiment.name, key)
        if items is not None and asked:
            bench.tick(sum(len(source.pairs) for source in sources))
        if items is None and asked:
            seed = zlib.crc32(experiment.name.encode())  # the same whatever runs before it
            items = experiment.run(material, bench, np.random.default_rng(seed))
            items = write_items(out, experiment.name, key, items)
        if items is None:
            reason = "not asked for (--only)"
            yield from (Item(*item, not_run=reason) for item in experiment.items)
        else:
            yield from items
    if real is not None:
        yield from _run_real(real, out, only)


def pairs_to_look_at(material: Material, only: frozenset[str]) -> int:
    """How many pairs the wanted experiments look at, one after another: for the progress bar."""
    return sum(
        len(source.pairs)
        for experiment in EXPERIMENTS
        if any(name in only for name, _, _ in experiment.items)
        for source in material.of(*experiment.looks_at)
    )


def _not_run(item: tuple[str, str, str], missing: str) -> Item:
    how = f"pomolog simulate {HOW_TO_MAKE[missing]} -o sessions/{HOW_TO_MAKE[missing]}.mcap"
    return Item(*item, not_run=f"no {missing} sessions; make them with: {how}")


def _run_real(folder: Path, out: Path, only: frozenset[str]) -> Iterator[Item]:
    runs: Mapping[str, Callable[[Path], Item]] = {TREE.id: real_tree, CROPS.id: real_crops}
    for name, place in find_real(folder).items():
        if name not in only:
            continue
        files = sorted((str(p), p.stat().st_size) for p in place.rglob("*") if p.is_file())
        key = key_of(name, files)
        items = read_items(out, name, key)
        yield from items or write_items(out, name, key, (runs[name](place),))


@dataclass(frozen=True, slots=True)
class Made:
    """What was made: the items, and paper.json's text."""

    items: tuple[Item, ...]
    document: str


def make_paper(
    material: Material,
    out: Path,
    *,
    only: frozenset[str],
    fraction: float = 1.0,
    real: Path | None = None,
    workers: int = 1,
    tick: Tick = lambda _: None,
) -> Made:
    """Run what is asked for and write the page, paper.json, paper.md, tables and figures.

    Raises:
        PomologError: a session is damaged, real pictures are missing, or the disk is full.
    """
    if real is not None:
        find_real(real)  # said before minutes of work, not after
    with writable(out):
        out.mkdir(parents=True, exist_ok=True)
    with open_bench(out / "kept" / "rows", workers, tick) as bench:
        items = tuple(run_paper(material, bench, out, only=only, real=real))
    about = {
        "version": version("pomolog"),
        "folder": str(material.folder),
        "fraction": fraction,
        "sessions": [
            {"name": s.name, "set": s.scene, "used": len(s.pairs), "pairs": s.total,
             "split": s.split, "fingerprint": s.fingerprint}
            for s in material.sources
        ],
        "refused": list(material.refused),
    }  # fmt: skip
    document = json.dumps({**about, "items": [i.as_json() for i in items]}, indent=1) + "\n"
    texts = {"paper.json": document, "paper.md": as_markdown(items)}
    texts["paper.html"] = page(items, about, out)
    for name, text in texts.items():
        write_text(out / name, text)
    return Made(items, document)
