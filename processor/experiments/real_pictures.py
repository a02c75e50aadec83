"""The same method on real pictures: one labelled tree in two views, and boxed crops of many."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from processor import charts
from processor.circles import RandomRing
from processor.clean import AreaRule
from processor.count import count_frame
from processor.discs import disc_iou
from processor.experiments import story
from processor.experiments.item import Claim, Item
from processor.experiments.segmentation import RULES
from processor.experiments.windows import ring_of
from processor.locate import Locator
from processor.page_parts import Column, Figure, Scalar, Table, percent
from processor.trace import Floats, Recogniser
from recorder.errors import PomologError
from recorder.records import Picture, counted_fruit
from recorder.rectify import rectify

LEAST_IOU: Final = 0.5
CROP_RADII_PX: Final = (12.0, 120.0)  # of the boxed fruit: half sides 15 to 100 px


@dataclass(frozen=True, slots=True)
class Kind:
    """A folder that can be measured: its name, what it must have, and the item's name."""

    folder: str
    needs: str
    id: str


TREE: Final = Kind("story_orchard", "apples_truth.csv", "real-tree")
CROPS: Final = Kind("applebbch81", "labels", "real-crops")


def find_real(folder: Path) -> dict[str, Path]:
    """Which of the known kinds lie in a folder, or are it: item -> folder.

    Raises:
        PomologError: none.
    """
    found = {}
    for kind in (TREE, CROPS):
        for place in (folder, folder / kind.folder):
            if (place / kind.needs).exists():
                found[kind.id] = place
    if not found:
        raise PomologError(
            f"no known real pictures in {folder}; --real takes a folder with {TREE.folder} "
            f"({TREE.needs}) or {CROPS.folder} ({CROPS.needs}/)"
        )
    return found


def real_tree(folder: Path) -> Item:
    """Recall in masks, share marked, and depth of matched fruit on the real tree."""
    rig, left, right = story.read_pair(folder)
    labelled = story.read_truth(folder, rig.left)
    rectification = rectify(rig)
    assert labelled.truth.left is not None
    labels = rectification.left.labels(labelled.truth.left)
    rows: list[dict[str, Scalar]] = []
    depths: dict[str, list[float]] = {}
    masks = {}
    for name, rule in RULES.items():
        locators = {"30-60": Locator(recognise=rule),
                    "any": Locator(recognise=rule, circles=ring_of(rectification))}  # fmt: skip
        for window, locator in locators.items():
            trace = locator(left, right, rectification, (0, 0))
            counts = count_frame(trace, labelled.truth, rectification)
            mask = trace.left.recognition.mask > 0
            masks[name] = trace.left.recognition.mask
            errors = [1e3 * v.error_m for v in counts.apples if v.error_m is not None]
            depths[f"{name}, {window}"] = errors
            rows.append({
                "rule": name, "window": window, "marked": 100 * float(mask.mean()),
                "covered": 100 * float(mask[counted_fruit(labels)].mean()),
                "apples": len(counts.apples),
                "found": sum(v.found_left for v in counts.apples),
                "matched": len(errors),
                "median": float(np.median(errors)) if errors else None,
                "mad": float(np.median(np.abs(np.array(errors) - np.median(errors))))
                if errors else None,
            })  # fmt: skip
    picture = rectification.left.picture(left)
    ours = next(r for r in rows if (r["rule"], r["window"]) == ("absolute", "30-60"))
    best = max(rows, key=lambda r: int(r["matched"] or 0))
    return Item(
        id="real-tree",
        source="real pictures",
        title="A real tree of red ‘Story’ apples at noon",
        summary=(
            f"The rule (absolute) marks {float(ours['marked'] or 0):.0f} % of the picture and "
            f"{float(ours['covered'] or 0):.0f} % of the labelled apples' pixels: on a real tree "
            "in hard sun the red of leaves, wood and soil joins the fruit into a few regions, "
            f"and {ours['matched']} of {ours['apples']} labelled apples are located with the "
            f"paper's window; at best {best['matched']} ({best['rule']}, {best['window']})."
        ),
        method=(
            "Two views 50 mm apart, masks of 26 labelled apples, depth from a time-of-flight "
            "camera. Only labelled fruit count, so nothing here is a false positive; the share of "
            "the picture that is marked says how much is. The depth error is the front's distance "
            "against the depth camera's. Nothing was tuned on this tree."
        ),
        material=f"{story.LEFT} left, {story.RIGHT} right; not part of any split",
        claims=(
            Claim("recall of apple pixels, sun in front", 97.7,
                  float(ours["covered"] or 0), "%", 1, verdict="holds"
                  if float(ours["covered"] or 0) > 95.7 else "does not hold",
                  sentence="the paper's is what its Table 1 implies"),
            Claim("picture marked", None, float(ours["marked"] or 0), "%"),
        ),
        tables=(Table("real_tree", "By rule and radius window (px).", _TREE, rows),),
        figures=(Figure("real_tree", "The rectified left view, and what each rule marks.",
                        draw_masks(picture, masks)),),
    )  # fmt: skip


_TREE: Final = {
    "rule": Column("rule"), "window": Column("window"), "marked": Column("picture marked, %"),
    "covered": Column("apple pixels, %"), "apples": Column("apples", 0),
    "found": Column("circle, left", 0), "matched": Column("matched rightly", 0),
    "median": Column("depth, median error mm", 0), "mad": Column("MAD, mm", 0),
}  # fmt: skip


def real_crops(folder: Path) -> Item:
    """Share marked, recall within boxes, and circles against boxes, over all crops."""
    crops = list(read_crops(folder))
    ring = RandomRing(min_radius_px=CROP_RADII_PX[0], max_radius_px=CROP_RADII_PX[1])
    rows = [_crop_row(name, rule, crops, ring) for name, rule in RULES.items()]
    ours = next(r for r in rows if r["rule"] == "absolute")
    bare = [picture for picture, boxes in crops if not len(boxes)]
    return Item(
        id="real-crops",
        source="real pictures",
        title="Crops of real orchards, with boxes",
        summary=(
            f"In {len(crops)} crops with {ours['boxes']} boxed apples the rule (absolute) marks "
            f"{float(ours['inside'] or 0):.0f} % of what is inside the boxes' ellipses and "
            f"{float(ours['outside'] or 0):.0f} % of what is outside all boxes; "
            f"{float(ours['recall'] or 0):.0f} % of the boxes get a circle."
        ),
        method=(
            "The disc of a box is the circle of its mean half side; a circle finds it at IoU 0.5, "
            f"one to one. Radius window {CROP_RADII_PX[0]:.0f} to {CROP_RADII_PX[1]:.0f} px. Small "
            "apples of the row behind are often not boxed: circles beside boxes are counted, and "
            f"are not all mistakes. {len(bare)} crops show no apple."
        ),
        material=f"{len(crops)} crops of 640 px; not part of any split",
        claims=(
            Claim("pixels marked in the boxes' ellipses", None, float(ours["inside"] or 0), "%",
                  sentence="an ellipse holds leaves and stalks too"),
            Claim("boxes with a circle", None, float(ours["recall"] or 0), "%"),
        ),
        tables=(Table("real_crops", "By rule.", _CROPS, rows),),
    )  # fmt: skip


_CROPS: Final = {
    "rule": Column("rule"), "crops": Column("crops", 0), "boxes": Column("boxes", 0),
    "inside": Column("marked inside, %"), "outside": Column("outside, %"),
    "bare": Column("in crops without apples, %"), "found": Column("boxes found", 0),
    "recall": Column("recall, %"), "others": Column("circles beside boxes", 0),
}  # fmt: skip


def read_crops(folder: Path) -> Iterator[tuple[Picture, Floats]]:
    """Each crop and its (N, 4) boxes x, y, width, height in pixels, the centre first.

    Raises:
        PomologError: a crop that cannot be read.
    """
    for path in sorted((folder / "images").iterdir()):
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if picture is None:
            raise PomologError(f"{path} is no picture; remove it or give another --real DIR")
        height, width = picture.shape[:2]
        told = folder / "labels" / f"{path.stem}.txt"
        lines = told.read_text().splitlines() if told.is_file() else []
        boxes = np.array([[float(word) for word in line.split()[1:5]] for line in lines if line])
        yield picture.astype(np.uint8), boxes.reshape(-1, 4) * [width, height, width, height]


def _crop_row(
    name: str, rule: Recogniser, crops: Sequence[tuple[Picture, Floats]], ring: RandomRing
) -> dict[str, Scalar]:
    inside, outside, bare = np.zeros(2, int), np.zeros(2, int), np.zeros(2, int)
    found = others = total = 0
    for number, (picture, boxes) in enumerate(crops):
        recognition = rule(picture)
        marked = recognition.mask > 0
        ellipses, covered = _areas(marked.shape, boxes)
        inside += (int(marked[ellipses].sum()), int(ellipses.sum()))
        outside += (int(marked[~covered].sum()), int((~covered).sum()))
        if not len(boxes):
            bare += (int(marked.sum()), marked.size)
        circles = ring(AreaRule()(recognition), (0, number, 0)).as_array()
        discs = np.column_stack([boxes[:, :2], boxes[:, 2:].mean(axis=1) / 2])
        hit = _one_to_one(disc_iou(circles, discs))
        found, total = found + hit, total + len(boxes)
        others += len(circles) - hit
    return {
        "rule": name, "crops": len(crops), "boxes": total,
        "inside": percent(inside[0] / inside[1]) if inside[1] else None,
        "outside": percent(outside[0] / outside[1]) if outside[1] else None,
        "bare": percent(bare[0] / bare[1]) if bare[1] else None,
        "found": found, "recall": 100 * found / total if total else None, "others": others,
    }  # fmt: skip


def _areas(
    shape: tuple[int, ...], boxes: Floats
) -> tuple["np.typing.NDArray[np.bool_]", "np.typing.NDArray[np.bool_]"]:
    """Pixels in the boxes' ellipses, and pixels in any box."""
    ellipses, covered = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    for x, y, width, height in boxes.tolist():
        centre, axes = (round(x), round(y)), (round(width / 2), round(height / 2))
        cv2.ellipse(ellipses, centre, axes, 0, 0, 360, 1, cv2.FILLED)
        covered[max(0, round(y - height / 2)) : round(y + height / 2) + 1,
                max(0, round(x - width / 2)) : round(x + width / 2) + 1] = 1  # fmt: skip
    return ellipses > 0, covered > 0


def _one_to_one(iou: Floats) -> int:
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(np.where(iou >= LEAST_IOU, iou, 0.0), maximize=True)
    return int((iou[rows, columns] >= LEAST_IOU).sum())


def draw_masks(picture: Picture, masks: dict[str, "np.typing.NDArray[np.uint8]"]) -> bytes:
    """The picture and each rule's mask, a quarter as large."""
    small = cv2.resize(picture, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    with charts.drawing(7.0, 2.9) as (sheet, done):
        panels = sheet.subplots(2, 3).ravel()
        charts.show_picture(panels[0], small.astype(np.uint8), "left view")
        for axes, (name, mask) in zip(panels[1:], masks.items(), strict=True):
            less = cv2.resize(mask, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
            charts.show_picture(axes, less.astype(np.uint8), name)
    return done[0]
