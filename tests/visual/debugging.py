"""Plant the faults of docs/debugging.md, and take its pictures: `make docs-pictures`."""

import os
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from processor.methods import load_method, to_toml
from processor.replay import Replayed, replay
from recorder.errors import PomologError
from tests.visual.faults import knocked, overexposed, swapped, wrong_field
from tests.visual.headless import Pixels, headless
from tests.visual.needs import vulkan
from viewer.choose import Wish, choose

ROOT = Path(__file__).parent.parent.parent
DEMO = ROOT / "sessions" / "demo.mcap"
PICTURES = ROOT / "docs" / "pictures"
WINDOW_PX = (1500, 940)
WIDTH_PX = 1000
SUN = (3, 4, 5)  # the frames that are exposed too long


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture of the story: what is opened, and which tab at which frame."""

    name: str
    folders: tuple[str, ...]
    wish: Wish
    tab: str
    timeline: str = "frame"
    place: int = 2


SHOTS = (
    Shot("overview", ("good",), Wish(), "Overview"),
    Shot("worst", ("good",), Wish(worst=10), "Worst", "worst", 1),
    Shot("knocked", ("knocked",), Wish(), "Range"),
    Shot("swapped", ("swapped",), Wish(), "Match"),
    Shot("sun", ("sun",), Wish(), "Health", place=SUN[-1]),
    Shot("wrong-field", ("paper", "mine"), Wish(), "Changes"),
    Shot("wrong-field-circles", ("mine",), Wish(), "Circles"),
)


def plant(folder: Path) -> None:
    """Make every fault in a folder, and replay it as the story does."""
    sessions = {
        "good": DEMO,
        "knocked": knocked(DEMO, folder / "knocked.mcap"),
        "swapped": swapped(DEMO, folder / "swapped.mcap"),
        "sun": overexposed(DEMO, folder / "sun.mcap", SUN),
        "paper": DEMO,
        "mine": DEMO,
    }
    _, paper = load_method("paper")
    mine = folder / "mine.toml"
    mine.write_text(wrong_field(to_toml("paper", paper)), encoding="utf-8")
    methods = {"paper": "paper", "mine": str(mine)}
    for name, session in sessions.items():
        called, locator = load_method(methods.get(name, "pomolog"))
        workers = os.cpu_count() or 1
        for done in replay([session], folder / name, locator, method=called, workers=workers):
            if isinstance(done, PomologError):
                raise done
            assert isinstance(done, Replayed)
            if done.warning:
                print(f"warning: {done.warning}")


def main() -> None:
    """Take every picture."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    driver = vulkan()
    with TemporaryDirectory() as made:
        folder = Path(made)
        plant(folder)
        for shot in SHOTS:
            own = folder / f"shot-{shot.name}"
            own.mkdir()
            with chdir(folder):
                opening = choose([Path(name) for name in shot.folders], shot.wish, own)
            files = [folder / file for file in opening.files]
            with headless(files, driver, own, WINDOW_PX) as viewer:
                viewer.front(shot.tab)
                viewer.at(shot.timeline, shot.place)
                _keep(PICTURES / f"{shot.name}.jpg", viewer.picture())
            print(PICTURES / f"{shot.name}.jpg")


def _keep(path: Path, picture: Pixels) -> None:
    height_px = round(picture.shape[0] * WIDTH_PX / picture.shape[1])
    small = cv2.resize(picture, (WIDTH_PX, height_px), interpolation=cv2.INTER_AREA)
    turned = cv2.cvtColor(small, cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(path), turned, [cv2.IMWRITE_JPEG_QUALITY, 80])


if __name__ == "__main__":
    main()
