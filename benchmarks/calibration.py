"""Calibration against what others published, and a real tree's rig against its own pictures.

python -m benchmarks.calibration ../shared/data
"""

import argparse
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.one_line import one_line
from processor.experiments.story import LEFT, RIGHT
from recorder.calibrate.board import parse_board
from recorder.calibrate.calibration import Calibration, calibrate
from recorder.calibrate.sources import source_of
from recorder.calibrate.views import sight
from recorder.rectify import rectify
from recorder.rig import Floats, load_rig

RATIO: Final = 0.7  # Lowe's, 2004, Sec. 7.1: it keeps nine in ten right matches
DEPTH_PX: Final = 8.0  # a tree moves in the wind, and 18 minutes lie between the pictures
EPIPOLAR_PX: Final = 1.5  # RANSAC's, on a geometry of its own, not on the rig's


def charuco(data: Path) -> Calibration:
    """The ChArUco pairs; published: 575 px, 75.0 mm, 0.34 px."""
    folder = data / "charuco_stereo"
    source = source_of([folder / "left", folder / "right"])
    return calibrate(sight(parse_board("charuco:31x16:49.33mm:38.46mm"), source))


def chessboard(data: Path) -> Calibration:
    """OpenCV's chessboards; its own calibration leaves 0.217 px."""
    source = source_of([data / "opencv_chessboard"])
    return calibrate(sight(parse_board("chessboard:9x6:25mm"), source))


def tree_rows_px(folder: Path) -> Floats:
    """(N,) right row minus left row of points matched between two pictures of a real tree.

    SIFT in both pictures as they were recorded, Lowe's ratio both ways, the depth picture for the
    disparity, and RANSAC with a fundamental matrix of its own; the rig's rows choose nothing.
    """
    rig = load_rig(folder / "rig_opencv.yaml")
    parallel = rectify(rig)
    greys = [
        _picture(folder / f"{name}_colour.png", cv2.IMREAD_GRAYSCALE) for name in (LEFT, RIGHT)
    ]
    finder = cv2.SIFT.create(nfeatures=6000)
    (lefts, a), (rights, b) = (finder.detectAndCompute(grey, None) for grey in greys)
    back = {(m.trainIdx, m.queryIdx) for m in _ratio(b, a)}
    both = [(m.queryIdx, m.trainIdx) for m in _ratio(a, b) if (m.queryIdx, m.trainIdx) in back]
    left_px = np.array([lefts[q].pt for q, _ in both])
    right_px = np.array([rights[t].pt for _, t in both])
    depth_mm = _picture(folder / f"{LEFT}_depth_mm.png", cv2.IMREAD_UNCHANGED)
    x, y = np.rint(left_px).astype(int).T
    z_m = depth_mm[y, x] / 1e3
    seen, other = parallel.left.from_recorded(left_px), parallel.right.from_recorded(right_px)
    disparity_px = seen[:, 0] - other[:, 0] + parallel.disparity_px(0.0, 0.0)
    with np.errstate(divide="ignore"):
        expected_px = parallel.focal_px * parallel.baseline_m / z_m
    near = (z_m > 0) & (np.abs(disparity_px - expected_px) < DEPTH_PX)
    _, agreeing = cv2.findFundamentalMat(
        left_px[near], right_px[near], cv2.USAC_MAGSAC, EPIPOLAR_PX, 0.999, 10000
    )
    kept = np.flatnonzero(near)[np.asarray(agreeing).ravel() > 0]
    return np.asarray(other[kept, 1] - seen[kept, 1], float)


def _picture(path: Path, flags: int) -> cv2.typing.MatLike:
    picture = cv2.imread(str(path), flags)
    assert picture is not None, path
    return picture


def _ratio(queries: cv2.typing.MatLike, trains: cv2.typing.MatLike) -> list[cv2.DMatch]:
    pairs = cv2.BFMatcher().knnMatch(queries, trains, k=2)
    return [first for first, second in pairs if first.distance < RATIO * second.distance]


def table(sets: dict[str, Calibration]) -> Table:
    """One set a row."""
    shown = Table(title="Calibrations")
    for column in ("set", "views", "lens", "f left, px", "B, mm", "rms, px", "rows, px",
                   "spacing, mm: true, median, MAD"):  # fmt: skip
        shown.add_column(column, justify="left" if column in ("set", "lens") else "right")
    for name, one in sets.items():
        spacing, trust = one.measures.spacing_m, one.trust
        shown.add_row(
            name,
            f"{len(one.fit.views)} of {len(one.sighting.views)}",
            one.fit.lens,
            f"{one.rig.left.matrix[0, 0]:.2f} ± {trust.focal_std_px[0]:.2f}",
            f"{one.rig.baseline_m * 1e3:.2f} ± {trust.baseline_std_m * 1e3:.2f}",
            f"{one.fit.stereo_rms_px:.3f} ({one.fit.untrimmed_rms_px:.3f})",
            f"{one.measures.row_rms_px:.3f}",
            f"{one.sighting.board.square_m * 1e3:g}, {spacing.median * 1e3:.3f}, "
            f"{spacing.mad * 1e3:.3f}",
        )
    return shown


@one_line
def main() -> None:
    """Print the table and the tree's rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("data", type=Path)
    data: Path = parser.parse_args().data
    Console(width=150).print(table({"ChArUco": charuco(data), "chessboard": chessboard(data)}))
    rows = tree_rows_px(data / "story_orchard")
    print(
        f"real tree: {len(rows)} matched points, rows off by {np.median(np.abs(rows)):.2f} px "
        f"(median), {np.sqrt((rows**2).mean()):.2f} px (rms), {np.median(rows):+.2f} px on average"
    )


if __name__ == "__main__":
    main()
