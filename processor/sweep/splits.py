"""Which pictures a setting is chosen on (train), and which say what it is worth (test)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from processor.experiments.material import Source
from recorder.errors import PomologError

Split = Literal["train", "test"]

TEST_SHARE: Final = 3  # the last third of a session
RULE: Final = (
    "the last third of each session's pairs in time is test, the rest train; of sessions of fewer "
    "than three pairs, every third one is test"
)


@dataclass(frozen=True, slots=True)
class Splits:
    """Who is what.

    Attributes:
        of: (session, pair) -> its split.
        said: how they were split, for people.
        reused: the sessions say that all of them are of one split, and were split all the same.
    """

    of: dict[tuple[str, int], Split]
    said: str
    reused: bool = False


def split_up(sources: Sequence[Source], train: Sequence[Path], test: Sequence[Path]) -> Splits:
    """Tell train from test.

    Args:
        sources: all sessions.
        train: those that the user calls train.
        test: those that the user calls test; the rest say themselves, or are cut by `RULE`.

    Raises:
        PomologError: a session is called both.
    """
    asked = dict.fromkeys(train, "train") | dict.fromkeys(test, "test")
    both = set(train) & set(test)
    if both:
        raise PomologError(f"{min(both)} is named with --train and with --test; choose one")
    of: dict[tuple[str, int], Split] = {}
    cut = []
    named = []
    for source in sources:
        split = asked.get(source.path, source.split)
        if split in ("train", "test"):
            named.append((source, split))
        else:
            cut.append(source)
    kinds = {split for _, split in named}
    reused = len(kinds) == 1 and not cut
    if reused:
        cut, named = list(sources), []
    for source, split in named:
        whole: Split = "train" if split == "train" else "test"
        of |= {(source.name, pair): whole for pair in source.pairs}
    of |= _cut(cut)
    return Splits(of, _said(len(named), len(cut), kinds, reused=reused), reused)


def _cut(sources: Sequence[Source]) -> dict[tuple[str, int], Split]:
    found: dict[tuple[str, int], Split] = {}
    short = 0
    for source in sources:
        pairs = len(source.pairs)
        if pairs < TEST_SHARE:
            short += 1
            whole: Split = "test" if short % TEST_SHARE == 0 else "train"
            found |= {(source.name, pair): whole for pair in source.pairs}
            continue
        first_test = pairs - pairs // TEST_SHARE
        for place, pair in enumerate(source.pairs):
            found[source.name, pair] = "test" if place >= first_test else "train"
    return found


def _said(named: int, cut: int, kinds: set[str], *, reused: bool) -> str:
    if reused:
        return (
            f"All {cut} sessions are of the {min(kinds)} split, so they were split here: {RULE}. "
            "They can no longer serve as a test of what was chosen on them; give other sessions "
            "with --train and --test."
        )
    parts = []
    if named:
        many = f"{named} sessions say their split"
        parts.append(many if named > 1 else "1 session says its split")
    if cut:
        parts.append(f"{cut} session{'s' if cut > 1 else ''} without one: {RULE}")
    return "; ".join(parts) + "."
