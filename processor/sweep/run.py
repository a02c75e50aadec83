"""Every setting on every pair of pictures: in slices that are kept, so a killed sweep goes on.

A pair is decoded once and goes down the tree of `processor.sweep.tree` with all settings.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from processor.count import FrameCounter, FrameCounts
from processor.experiments.material import Source
from processor.experiments.work import Row, Sample, Tick, open_bench
from processor.locate import Locator
from processor.methods import describe, models_of
from processor.sweep.settings import Setting
from processor.sweep.tree import locate_all
from processor.trace import Trace
from recorder.errors import PomologError
from recorder.rectify import rectify
from recorder.session import Session

SLICE_SETTINGS: Final = 96  # pairs times settings of one slice: about ten seconds


@dataclass(frozen=True, slots=True)
class EverySetting:
    """Measures one pair with every setting; small enough to send to a worker."""

    locators: tuple[Locator, ...]
    seed: int
    key: str

    @property
    def __name__(self) -> str:
        """Names the kept rows: another grid or seed has others."""
        return self.key

    def __call__(self, sample: Sample) -> list[Row]:
        """A row a setting."""
        traces = locate_all(
            self.locators, sample.left, sample.right, sample.rectification,
            (self.seed, sample.pair.index),
        )  # fmt: skip
        count = FrameCounter(sample.pair.truth, sample.rectification)
        rows = [{"setting": place} | row_of(trace, count(trace)) for place, trace in traces]
        return sorted(rows, key=lambda row: row["setting"])


def row_of(trace: Trace, counts: FrameCounts) -> Row:
    """What a sweep keeps of one trace."""
    verdicts = [one.match for one in counts.apples]
    located = [one for one in counts.apples if one.error_m is not None]
    row: Row = {
        "circles": len(trace.left.circles.fruit) + len(trace.right.circles.fruit),
        "located": sum(apple.centre_m is not None for apple in trace.apples),
        "apples": [one.apple_id for one in located],
        "errors_m": [one.error_m for one in located],
        "locate_ns": sum(trace.stage_ns.values()),
        **{verdict: verdicts.count(verdict) for verdict in ("right", "wrong", "missed")},
    }
    for what in ("pixels", "fruit"):
        counted = getattr(counts, what)
        for part in ("tp", "fp", "fn"):
            row[f"{what}_{part}"] = None if counted is None else getattr(counted, part)
    return row


def open_sources(paths: Sequence[Path]) -> tuple[Source, ...]:
    """Look into sessions.

    Raises:
        PomologError: one cannot be read or has no pairs, or two have one name.
    """
    sources = []
    for path in paths:
        with Session(path) as session:
            session.require_pairs()
            rectify(session.rig)  # a rig that cannot be used is said before anything is done
            pairs = tuple(range(len(session)))
            split = session.metadata.get("split", "")
            sources.append(
                Source(path, session.name, pairs, len(pairs), session.fingerprint, split,
                       tuple({} for _ in pairs))
            )  # fmt: skip
    names = [source.name for source in sources]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise PomologError(f"two sessions are named {min(twice)}; give one, or rename one")
    return tuple(sources)


def run(
    settings: Sequence[Setting],
    sources: Sequence[Source],
    out: Path,
    *,
    seed: int = 0,
    workers: int = 1,
    tick: Tick = lambda _: None,
) -> list[Row]:
    """The rows of every setting and pair; what was measured before is read.

    Args:
        settings: of the method.
        sources: the sessions.
        out: keeps the slices, below `.slices`.
        seed: of every random number.
        workers: processes; 1 works here.
        tick: called with the number of pairs that are done.

    Raises:
        PomologError: a session is damaged, or the slices cannot be kept.
    """
    measure = every_setting(settings, seed)
    pairs = max(1, SLICE_SETTINGS // len(settings))
    with open_bench(out / ".slices", workers, tick, pairs) as bench:
        rows = bench.rows(measure, sources)
        bench.clean(measure, sources)
    return rows


def every_setting(settings: Sequence[Setting], seed: int) -> EverySetting:
    """The measurement of these settings."""
    locators = tuple(setting.locator for setting in settings)
    about = [seed, *([describe(one), models_of(one)] for one in locators)]
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()
    return EverySetting(locators, seed, digest[:12])
