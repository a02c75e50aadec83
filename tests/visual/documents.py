"""Take the pictures of README, docs/report.md and docs/calibration.md: `make docs-pictures`."""

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import cv2
import numpy as np

from processor.methods import load_method
from processor.replay import Replayed, replay
from recorder.calibrate.board import parse_board
from recorder.calibrate.calibration import calibrate
from recorder.calibrate.report import write_report
from recorder.calibrate.sources import source_of
from recorder.calibrate.views import sight
from tests.builders import DATA
from tests.visual.debugging import DEMO, ROOT
from tests.visual.needs import browser
from viewer.sheet import make_sheet

SHEET: Final = ROOT / "docs" / "sheet.jpg"
SHEET_FRAME: Final = 3  # against the light: apples of every fate
SHEET_WIDTH_PX: Final = 1300
CALIBRATION: Final = ROOT / "docs" / "calibration-report.png"
BOARD: Final = "charuco:31x16:49.33mm:38.46mm"
PAGE_PX: Final = (1000, 1020)  # down to where the board was seen


def take_sheet(path: Path, folder: Path) -> None:
    """The sheet of one frame of the demo under the paper's method, made small."""
    name, locator = load_method("paper")
    (done,) = replay([DEMO], folder, locator, method=name, rrd="none")
    assert isinstance(done, Replayed), done
    png = np.frombuffer(make_sheet(done.out, SHEET_FRAME).png, np.uint8)
    sheet = cv2.imdecode(png, cv2.IMREAD_COLOR)
    assert sheet is not None
    height_px = round(sheet.shape[0] * SHEET_WIDTH_PX / sheet.shape[1])
    small = cv2.resize(sheet, (SHEET_WIDTH_PX, height_px), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_JPEG_QUALITY, 85])


def take_calibration(path: Path, folder: Path, pictures: Path) -> None:
    """The head of the report on others' pictures of a board, as a browser shows it."""
    sighting = sight(parse_board(BOARD), source_of([pictures / "left", pictures / "right"], 100))
    page = folder / "calibration.html"
    write_report(calibrate(sighting), page)
    subprocess.run(
        [
            browser(page.name), "--headless", "--disable-gpu", "--no-sandbox", "--hide-scrollbars",
            f"--user-data-dir={folder / 'profile'}", f"--screenshot={path}",
            f"--window-size={PAGE_PX[0]},{PAGE_PX[1]}", page.as_uri(),
        ],
        check=True, capture_output=True, timeout=300,
    )  # fmt: skip


def main() -> None:
    """Take both; the second needs others' pictures, which are no part of the project."""
    with TemporaryDirectory() as made:
        folder = Path(made)
        take_sheet(SHEET, folder)
        print(SHEET)
        pictures = DATA / "charuco_stereo"
        if not pictures.is_dir():
            print(f"{CALIBRATION} stays as it is: no {pictures}")
            return
        take_calibration(CALIBRATION, folder, pictures)
        print(CALIBRATION)


if __name__ == "__main__":
    main()
