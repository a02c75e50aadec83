"""Every look that has a reference: what is opened, which tab, at which place."""

from collections.abc import Iterator
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

from tests.visual.headless import Headless, Pixels, headless
from tests.visual.material import results
from viewer.choose import Wish, choose
from viewer.layout import SESSION_TABS, TABS


@dataclass(frozen=True, slots=True)
class Looked:
    """What was seen of one opening: its tabs' pictures, and whatever the viewer complains of."""

    pictures: dict[str, Pixels]
    complaints: list[str]


@dataclass(frozen=True, slots=True)
class Look:
    """One opening, and the tabs to look at."""

    name: str
    folders: tuple[str, ...]
    wish: Wish
    tabs: tuple[str, ...]
    timeline: str = "frame"
    place: int = 1


LOOKS = (
    Look("run", ("paper",), Wish(), TABS),
    Look("worst", ("paper",), Wish(worst=5), ("Worst",), "worst", 1),
    Look("methods", ("paper", "hough"), Wish(), ("Changes", "hough")),
    Look("session", ("row.mcap",), Wish(), tuple(t for t in SESSION_TABS if t != "Recorded")),
)
NAMES = [f"{look.name}-{tab.lower()}" for look in LOOKS for tab in look.tabs]


def look_at_all(folder: Path, driver: Path) -> Iterator[tuple[Look, Looked]]:
    """Open everything once, and look at each tab."""
    results(folder)
    for look in LOOKS:
        own = folder / f"look-{look.name}"
        own.mkdir()
        with chdir(folder):  # paths are shown, and should be the same each time
            opening = choose([Path(name) for name in look.folders], look.wish, own)
        files = [folder / file for file in opening.files]
        with headless(files, driver, own) as viewer:
            yield look, _look(look, viewer)


def _look(look: Look, viewer: Headless) -> Looked:
    pictures = {}
    for tab in look.tabs:
        viewer.front(tab)
        viewer.at(look.timeline, look.place)
        pictures[f"{look.name}-{tab.lower()}"] = viewer.picture()
    return Looked(pictures, viewer.complaints())
