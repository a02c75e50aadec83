"""The sheet: every stage of one frame in one picture, for who has no screen to open a run on."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any, Final

import numpy as np

from processor.discs import Discs, true_discs
from processor.palette import (
    ALONE,
    ESTIMATE,
    FALSE,
    HIT,
    MISSED,
    REJECTED,
    TRUTH,
    Colour,
)
from processor.palette import (
    SIDES as SIDE_COLOURS,
)
from processor.results import Row
from processor.retrace import Retraced, retrace
from processor.runs import Run, find_runs
from processor.trace import ViewTrace
from recorder.errors import PomologError
from recorder.pictures import decode
from recorder.records import SIDES, Picture, Side
from viewer.canvas import INK, SOFT, Canvas, Panel
from viewer.sheet_panels import (
    CONTOUR,
    REFERENCE,
    TRIED,
    against_truth,
    brightened,
    draw_circles,
    draw_curves,
    draw_matches,
    match_colours,
)
from viewer.sheet_table import ROW_PX, draw_table, height_px, missed, told

VIEW_PX: Final = 520  # width of one view
GAP_PX: Final = 12
MARGIN_PX: Final = 24
LABEL_PX: Final = 26  # above each panel
HEAD_PX: Final = 118
CURVE_PX: Final = 150
WIDTH_PX: Final = 4 * VIEW_PX + 3 * GAP_PX + 2 * MARGIN_PX


@dataclass(frozen=True, slots=True)
class Sheet:
    """A sheet, and what is on it as data.

    Attributes:
        png: the picture.
        told: session, frame, method, its panels with their boxes in pixels, its apples.
    """

    png: bytes
    told: dict[str, Any]


def make_sheet(out: Path, frame: int, moved: Sequence[Path] = ()) -> Sheet:
    """Locate a frame of a run again and draw every stage of it.

    Args:
        out: the results of one session.
        frame: which pair of the session.
        moved: where the session lies now; empty: where it lay.

    Raises:
        PomologError: no results, or of several sessions; what `retrace` raises.
    """
    run = _only_run(out)
    found = retrace(run, frame, moved)
    drawing = _Drawing(run, found)
    return Sheet(drawing.canvas.png(), drawing.told)


def _only_run(out: Path) -> Run:
    runs = find_runs([out])
    if len(runs) > 1:
        names = ", ".join(run.folder.name for run in runs[:4]) + (", ..." if len(runs) > 4 else "")
        raise PomologError(
            f"{out} has results of {len(runs)} sessions ({names}); name one: {runs[0].folder}"
        )
    return runs[0]


class _Drawing:
    """A sheet while it is drawn, from the top down."""

    def __init__(self, run: Run, found: Retraced) -> None:
        self.run, self.found, self.trace = run, found, found.trace
        truth = found.pair.truth
        self.scored = found.counts.fruit is not None
        self.partial = truth is not None and truth.partial
        recorded = {side: None if truth is None else truth.labels(side) for side in SIDES}
        self.labels = {
            side: None if labels is None else found.rectification.view(side).labels(labels)
            for side, labels in recorded.items()
        }
        self.discs: dict[Side, Discs | None] = {
            side: None if truth is None
            else true_discs(truth, side, self.labels[side], found.rectification)
            for side in SIDES
        }  # fmt: skip
        # whether the truth says which circles of the two views are one apple
        self.paired = truth is not None and truth.shared and None not in self.discs.values()
        self.masked = any(labels is not None for labels in self.labels.values())
        self.rows = told(found.apples, found.truth)
        self.panels: list[dict[str, Any]] = []
        self.y = HEAD_PX
        views = [self._recorded(side) for side in SIDES] + [v.picture for v in self._views()]
        self.view_px: int = max(round(p.shape[0] * VIEW_PX / p.shape[1]) for p in views)
        self.missed = self._lines(missed(found.truth))
        self.canvas = Canvas(WIDTH_PX, self._height())
        self._head()
        self._stages()
        self._curves()
        self._table()

    def _views(self) -> tuple[ViewTrace, ViewTrace]:
        return self.trace.left, self.trace.right

    def _recorded(self, side: Side) -> Picture:
        """As it was recorded; the trace has it already where nothing had to be rectified."""
        if self.found.rectification.view(side).maps is None:
            return self.trace.view(side).picture
        return decode(self.found.pair.frame(side))

    def _has_curves(self) -> bool:
        return bool(self.trace.matching.correlation.size)

    def _height(self) -> int:
        stages = 3 * (self.view_px + LABEL_PX + GAP_PX)
        curves = CURVE_PX + LABEL_PX + GAP_PX if self._has_curves() else 0
        table = LABEL_PX + height_px(self.rows) + ROW_PX * (len(self.missed) + 1)
        return HEAD_PX + stages + curves + table + MARGIN_PX

    def _lines(self, words: Sequence[str]) -> list[str]:
        if not self.paired:
            return []
        text = f"Missed, of the true apples to be matched: {', '.join(words) or 'none'}."
        return wrap(text, 230)

    def _head(self) -> None:
        about, pair = self.run.about, self.found.pair
        name = about["session"]["name"]
        self.canvas.text(
            MARGIN_PX, 18, f"{name}, frame {pair.index}", size=28, bold=True, colour=INK
        )
        said = ", ".join(f"{key} {pair.conditions[key]}" for key in ("lighting", "cultivar")
                         if key in pair.conditions)  # fmt: skip
        located = sum(apple.centre_m is not None for apple in self.trace.apples)
        circles = " and ".join(str(len(view.circles.fruit)) for view in self._views())
        words = (
            f"method {about['method']}, seed {about['seed']}, pomolog "
            f"{about['versions']['pomolog']}" + (f"; {said}" if said else "")
            + f". {circles} circles left and right, {located} located. {self._verdict()}"
        )  # fmt: skip
        self.canvas.text(MARGIN_PX, 56, words, size=16, colour=SOFT)
        self._legend()

    def _verdict(self) -> str:
        if not self.scored:
            return "Not scored: no truth of single apples."
        if not self.paired:
            return "Matches not scored: the truth does not pair the apples of the two views."
        matches = [row["match"] for row in self.found.truth]
        right, wrong, none = (matches.count(word) for word in ("right", "wrong", "missed"))
        asked = right + wrong + none
        return f"Of {asked} apples to be matched {right} right, {wrong} wrong, {none} missed."

    def _legend(self) -> None:
        entries: list[tuple[str, Colour]] = [("found", ESTIMATE), ("without a partner", ALONE)]
        if self.scored:
            entries.insert(0, ("true", TRUTH))
        if self.scored or self.masked:
            matches = (", matched right", ", matched wrong") if self.paired else ("", "")
            entries.append(("hit" + matches[0], HIT))
            if self.paired or not self.partial:
                entries.append(("false" + matches[1], FALSE))
            entries += [("missed", MISSED), ("counts neither way", REJECTED)]
        entries += [("contour", CONTOUR), ("tried ring", TRIED)]
        if self.trace.matching.reference_px is not None:
            entries.append(("reference line", REFERENCE))
        x = MARGIN_PX
        for words, colour in entries:
            self.canvas.fill(x, 88, 18, 14, colour)
            self.canvas.text(x + 24, 95, words, size=14, anchor="lm")
            x += 24 + 9 * len(words) + 26

    def _stages(self) -> None:
        straight = all(self.found.rectification.view(side).maps is None for side in SIDES)
        views = {side: self.trace.view(side) for side in SIDES}
        as_recorded = "as recorded" if straight else "as recorded; all else is rectified"
        self._pair(0, "recorded", as_recorded, {s: self._recorded(s) for s in SIDES})
        index = {side: brightened(views[side].recognition.index) for side in SIDES}
        gain = max(gain for _, gain in index.values())
        words = "brighter is more like fruit" + (f" (shown {gain:.1f} x)" if gain > 1 else "")
        self._pair(1, "index", words, {side: index[side][0] for side in SIDES})
        self._next_row()
        for place, name in ((0, "mask"), (1, "cleaned")):
            masks = {
                side: views[side].recognition.mask if name == "mask" else views[side].cleaning.mask
                for side in SIDES
            }
            shown = {
                side: against_truth(
                    views[side].picture, masks[side], self.labels[side], partial=self.partial
                )
                for side in SIDES
            }
            self._pair(place, name, "against truth" if self.masked else "no truth", shown)
        self._next_row()
        pictures = {side: views[side].picture for side in SIDES}
        words = "contours, tried rings, winners" + (", truth" if self.scored else "")
        circles = self._pair(0, "circles", words, pictures)
        for side, panel in circles.items():
            draw_circles(panel, self.trace, side, self.discs[side])
        matched = self._pair(1, "match", "the same number is the same apple", pictures)
        colours = match_colours(self.found.apples, scored=self.paired)
        draw_matches(self.canvas, matched, self.found, colours)
        self._next_row()

    def _pair(
        self, place: int, name: str, words: str, pictures: dict[Side, Any]
    ) -> dict[Side, Panel]:
        """A stage of both views, in the left or the right half of the row."""
        panels: dict[Side, Panel] = {}
        for number, side in enumerate(SIDES):
            x = MARGIN_PX + (2 * place + number) * (VIEW_PX + GAP_PX)
            label = f"{name.capitalize()}: {words}" if number == 0 else ""
            self.canvas.text(x, self.y + 5, label, size=15, bold=True)
            if number:
                self.canvas.text(x + VIEW_PX, self.y + 5, "left | right", size=14, colour=SOFT,
                                 anchor="ra")  # fmt: skip
            picture = pictures[side]
            panels[side] = self.canvas.panel(
                x, self.y + LABEL_PX, picture, VIEW_PX / picture.shape[1]
            )
            self._note(name, side, panels[side])
        return panels

    def _note(self, name: str, side: str, panel: Panel) -> None:
        box = [panel.x, panel.y, *panel.size_px]
        self.panels.append({"name": name, "side": side, "box_px": box})

    def _next_row(self) -> None:
        self.y += LABEL_PX + self.view_px + GAP_PX

    def _curves(self) -> None:
        """What the reference line was sought with."""
        if not self._has_curves():
            return
        matching = self.trace.matching
        width = 2 * VIEW_PX + GAP_PX
        blank = np.full((CURVE_PX, width), 255, np.uint8)
        left, right = matching.projections
        widest = int(np.argmax(matching.correlation)) / max(1, len(matching.correlation) - 1)
        for place, name, words, curves, mark in (
            (0, "projections", "fruit pixels of each column", {"left": left, "right": right}, None),
            (1, "correlation", "of both projections, by shift",
             {"correlation": matching.correlation}, widest),
        ):  # fmt: skip
            x = MARGIN_PX + place * (width + GAP_PX)
            title = f"{name.capitalize()}: {words}"
            self.canvas.text(x, self.y + 5, title, size=15, bold=True)
            if name == "projections":
                for number, side in enumerate(SIDES):
                    self.canvas.text(x + width - 60 * (1 - number), self.y + 5, side, size=14,
                                     colour=SIDE_COLOURS[side], anchor="ra")  # fmt: skip
            panel = self.canvas.panel(x, self.y + LABEL_PX, blank, 1.0)
            draw_curves(panel, curves, mark)
            self._note(name, "both", panel)
        self.y += LABEL_PX + CURVE_PX + GAP_PX

    def _table(self) -> None:
        title = "Range: every matched apple" + ("" if self.rows else "; there is none")
        self.canvas.text(MARGIN_PX, self.y + 5, title, size=15, bold=True)
        end = draw_table(
            self.canvas, MARGIN_PX, self.y + LABEL_PX + 6, self.rows, scored=self.paired
        )
        for number, line in enumerate(self.missed):
            self.canvas.text(MARGIN_PX, end + 6 + number * ROW_PX, line, size=14, colour=SOFT)

    @property
    def told(self) -> dict[str, Any]:
        """What is on the sheet."""
        about = self.run.about
        return {
            "session": about["session"]["name"],
            "frame": self.found.pair.index,
            "method": about["method"],
            "seed": about["seed"],
            "scored": self.scored,
            "matches_scored": self.paired,
            "size_px": [self.canvas.pixels.shape[1], self.canvas.pixels.shape[0]],
            "panels": self.panels,
            "apples": [_plain(row, scored=self.paired) for row in self.rows],
            "missed": [row["apple_id"] for row in self.found.truth if row["match"] == "missed"],
        }


def _plain(row: Row, *, scored: bool) -> Row:
    keys = ("apple", "disparity_px", "x_m", "y_m", "z_m", "surface_range_m", "confidence",
            "match_cost")  # fmt: skip
    verdict = ("verdict", "true_m", "error_m")
    return {key: row[key] for key in keys} | {key: row[key] if scored else None for key in verdict}
