"""What there is to measure on: sessions by the set they were made for, and samples of them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from recorder.errors import PomologError
from recorder.records import Note
from recorder.session import Session

# set -> how the names of its sessions begin, and of those that stand in where there are none
SETS: Final[dict[str, tuple[str, ...]]] = {
    "segmentation": ("segmentation", "demo"),
    "matching": ("matching", "demo"),
    "distance": ("distance",),
    "exposure": ("exposure",),
}
PAPER_PAIRS: Final = 45  # Sec. 3.3, of the matching experiment
LIGHTS: Final = ("front", "back", "cloudy")
# how the notes of rendered sessions say what is no condition of `key=value`
_EXPOSURE: Final = re.compile(r"exposure(?:_ev)?\s*=?\s*([+-]?\d+(?:\.\d+)?)")
_HUNG: Final = re.compile(r"hung at (\d+(?:\.\d+)?) mm")


@dataclass(frozen=True, slots=True)
class Source:
    """One session and which of its pairs are measured on.

    Attributes:
        path: its file.
        scene: the set's own name, such as segmentation-front.
        pairs: the places of its pairs that are used.
        total: how many pairs it has.
        fingerprint: changes when anything in the file does.
        split: train, test or both; "unsplit" where the session does not say.
        settings: for each used pair what notes say: exposure_ev, hung_mm.
    """

    path: Path
    scene: str
    pairs: tuple[int, ...]
    total: int
    fingerprint: str
    split: str
    settings: tuple[dict[str, float], ...] = field(default=())

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem


@dataclass(frozen=True, slots=True)
class Material:
    """All sessions of a folder, and those that could not be used."""

    folder: Path
    sources: tuple[Source, ...]
    refused: tuple[str, ...] = ()

    def of(self, *sets: str) -> tuple[Source, ...]:
        """The sessions of sets, by their names' beginning; stand-ins where a set has none."""
        chosen: dict[Path, Source] = {}
        for name in sets:
            for prefix in SETS[name]:
                found = [s for s in self.sources if s.scene.startswith(prefix)]
                found.sort(key=_place)
                if found:
                    chosen |= {source.path: source for source in found}
                    break
        return tuple(chosen.values())


def _place(source: Source) -> int:
    """The paper's order of lights: front, back, cloudy; others before them, as they come."""
    return max((n for n, light in enumerate(LIGHTS, 1) if light in source.scene), default=0)


def for_matching(material: Material) -> tuple[Source, ...]:
    """The matching sessions; where they have fewer pairs than the paper's 45, segmentation's too.

    Both are rows of trees with the truth of every apple; a sample of one set alone is too small.
    """
    found = material.of("matching")
    enough = sum(len(source.pairs) for source in found) >= PAPER_PAIRS
    return found if enough else material.of("matching", "segmentation")


def find_material(folder: Path, fraction: float = 1.0) -> Material:
    """Open every session of a folder and choose an even sample of each.

    Args:
        folder: with `.mcap` files, named by set as the digital orchard names them.
        fraction: of each session's pairs; what belongs together (the exposures of one tree) stays.

    Raises:
        PomologError: no such folder, or no session in it.
    """
    if not folder.is_dir():
        raise PomologError(f"no folder {folder}; give one with sessions: --sessions DIR")
    paths = sorted(folder.glob("*.mcap"))
    if not paths:
        raise PomologError(f"no .mcap in {folder}; make sessions with: pomolog simulate SET")
    sources, refused = [], []
    for path in paths:
        try:
            sources.append(_open(path, fraction))
        except PomologError as error:
            refused.append(" ".join(str(error).split()))
    return Material(folder, tuple(s for s in sources if s.pairs), tuple(refused))


def _open(path: Path, fraction: float) -> Source:
    with Session(path) as session:
        session.require_pairs()
        about = session.metadata
        exposures = [e for e in about.get("exposures_ev", "").split(",") if e.strip()]
        pairs = sample(len(session), fraction, max(1, len(exposures)))
        said: dict[int, dict[str, float]] = {}
        for note in session.notes():
            said.setdefault(note.time_ns, {}).update(_settings(note))
        times_ns = session.pair_times_ns()[:, 0].tolist()
        return Source(
            path=path,
            scene=about.get("scene", path.stem),
            pairs=pairs,
            total=len(session),
            fingerprint=session.fingerprint,
            split=about.get("split", "unsplit"),
            settings=tuple(said.get(times_ns[place], {}) for place in pairs),
        )


def _settings(note: Note) -> dict[str, float]:
    patterns = {"exposure_ev": _EXPOSURE, "hung_mm": _HUNG}
    found = {key: pattern.search(note.text) for key, pattern in patterns.items()}
    return {key: float(match[1]) for key, match in found.items() if match}


def sample(count: int, fraction: float, together: int = 1) -> tuple[int, ...]:
    """Places of an even sample, at least one group, whole groups of neighbours.

    Args:
        count: how many there are.
        fraction: of them that are wanted, above 0.
        together: neighbours that belong together.
    """
    groups = max(1, count // together)
    wanted = min(groups, max(1, round(fraction * groups)))
    starts = [int(i * groups / wanted) * together for i in range(wanted)]
    places = [start + i for start in starts for i in range(together)]
    if wanted == groups:
        places = list(range(count))
    return tuple(place for place in places if place < count)


def describe(sources: Sequence[Source]) -> str:
    """Which sessions, how many pairs of them, and their split, for people."""
    parts = []
    for source in sources:
        used = len(source.pairs)
        share = f"{used}" if used == source.total else f"{used} of {source.total}"
        parts.append(f"{source.name} ({share} pairs, {source.split})")
    return ", ".join(parts)
