"""What people see: every tab beside its reference, no complaints, the web viewer in a browser."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.visual.browser import Browser
from tests.visual.compare import COMMAND, TOLERATED, difference, read, small
from tests.visual.looks import NAMES, Looked, look_at_all
from tests.visual.material import recorded
from tests.visual.needs import browser, vulkan

LEAF_RGB = (60, 110, 30)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("visual")]


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Looked:
    """Every look, each opening once."""
    driver = vulkan()
    folder = tmp_path_factory.mktemp("visual")
    looks = [looked for _, looked in look_at_all(folder, driver)]
    pictures = {name: picture for looked in looks for name, picture in looked.pictures.items()}
    return Looked(pictures, [line for looked in looks for line in looked.complaints])


def test_no_view_complains(seen: Looked) -> None:
    assert seen.complaints == []


@pytest.mark.parametrize("name", NAMES)
def test_a_tab_looks_as_its_reference(name: str, seen: Looked, tmp_path: Path) -> None:
    picture = small(seen.pictures[name])
    share = difference(picture, read(name))
    if share > TOLERATED:
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture[..., ::-1])
        pytest.fail(
            f"{name} differs in {share:.2%} of its pixels; it is {tmp_path / name}.png. "
            f"If that is meant, make the references anew and look at them: {COMMAND}"
        )


def test_another_tab_another_frame_or_a_ring_less_would_be_noticed() -> None:
    """The tolerance is no excuse: what it must catch is far beyond it."""
    for one in NAMES:
        for other in NAMES:
            assert one == other or difference(read(one), read(other)) > 3 * TOLERATED
    picture = read("run-circles")
    orange = (picture[..., 0] > 120) & (picture[..., 1] > 70) & (picture[..., 2] < 70)
    assert orange.mean() > 0.001
    rings = cv2.dilate(orange.astype(np.uint8), np.ones((3, 3), np.uint8))
    without = np.where(rings[..., None] > 0, LEAF_RGB, picture)
    assert difference(picture, without.astype(np.uint8)) > TOLERATED


def test_the_references_are_small() -> None:
    sizes = [file.stat().st_size for file in Path(__file__).parent.glob("visual/references/*.jpg")]
    assert len(sizes) == len(NAMES)
    assert sum(sizes) < 400_000


def test_the_web_viewer_shows_a_session_without_errors(tmp_path: Path) -> None:
    chromium = browser()
    session = recorded(tmp_path / "row.mcap")
    command = [sys.executable, "-u", "-m", "pomolog", "view", str(session), "--web"]
    root = Path(__file__).parent.parent
    with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, text=True) as serving:
        try:
            assert serving.stdout is not None
            address = serving.stdout.readline().rpartition(" ")[2].strip()
            assert address.startswith("http://127.0.0.1:")
            with Browser(chromium, tmp_path / "profile") as page:
                page.open(f"{address}&renderer=webgl")
                page.wait_for(lambda picture: share_of_red(picture) > 0.02)
                assert page.errors() == []
        finally:
            serving.terminate()


def share_of_red(picture: np.ndarray) -> float:
    """Of the drawn apples' red, in all of the page."""
    red = (picture[..., 0] > 150) & (picture[..., 1] < 80) & (picture[..., 2] < 80)
    return float(red.mean())
