"""Board pictures -> a rig, and everything that is known of how good it is."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import cv2
import numpy as np

from recorder.calibrate.beam import BeamFit
from recorder.calibrate.choose import Choice, choose
from recorder.calibrate.fit import Fit
from recorder.calibrate.lens import LensName, turning_point
from recorder.calibrate.measures import Measures, measure
from recorder.calibrate.trust import Trust, trust
from recorder.calibrate.views import Sighting, why_not
from recorder.records import SIDES, Side
from recorder.rectify import rectify
from recorder.rig import Floats, Rangefinder, Rig

FEW_VIEWS: Final = 8
COVERED: Final = 0.6  # of the picture's cells should have corners
CELLS: Final = (8, 6)  # across and down
BAD_RMS: Final = 1.0 / 1280  # of the picture's width
UNSURE: Final = 0.01  # of focal length or baseline
MARKER_OFF: Final = 0.1  # a marker's outline is seen a little smaller than it is printed
PLAUSIBLE_BASELINE_M: Final = (0.01, 1.5)
SPACING_OFF: Final = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A rig and how it was found.

    Attributes:
        rejected: name of a view -> why it was not used.
        warnings: what is suspicious, a sentence each.
        beam: the rangefinder, where it was asked for.
    """

    rig: Rig
    sighting: Sighting
    choice: Choice
    measures: Measures
    trust: Trust
    rejected: Mapping[str, str]
    warnings: tuple[str, ...]
    beam: BeamFit | None = None

    @property
    def fit(self) -> Fit:
        """The lens model that was taken."""
        return self.choice.fit

    def with_beam(self, beam: BeamFit) -> "Calibration":
        """The same with a rangefinder in the rig."""
        return replace(self, rig=replace(self.rig, rangefinder=beam.rangefinder), beam=beam)

    def with_rangefinder(self, rangefinder: Rangefinder) -> "Calibration":
        """The same with a rangefinder that was known before."""
        return replace(self, rig=replace(self.rig, rangefinder=rangefinder))

    def as_json(self) -> dict[str, Any]:
        """What `calibrate --json` prints."""
        spacing = self.measures.spacing_m
        sides: dict[str, Any] = {
            side: {
                "focal_px": float(self.rig.camera(side).matrix[0, 0]),
                "rms_px": self.fit.rms_px(side),
                "focal_std_px": self.trust.focal_std_px[place],
            }
            for place, side in enumerate(SIDES)
        }
        return {
            "baseline_m": self.rig.baseline_m,
            "baseline_std_m": self.trust.baseline_std_m,
            **sides,
            "stereo_rms_px": self.fit.stereo_rms_px,
            "rectified_row_px": self.measures.row_rms_px,
            "views_used": len(self.fit.views),
            "views_rejected": len(self.rejected),
            "rejected": [{"view": name, "why": why} for name, why in self.rejected.items()],
            "lens": self.fit.lens,
            "lens_rms_px": dict(self.choice.rms_px),
            "corners_left_out": self.fit.corners_left_out,
            "spacing": {
                "true_m": self.sighting.board.square_m,
                "median_m": _or_none(spacing.median),
                "mad_m": _or_none(spacing.mad),
                "count": spacing.count,
            },
            "expected_error": [
                {"range_m": one.range_m, "calibration_std_m": _or_none(one.calibration_m)}
                for one in self.trust.errors
            ],
            "warnings": list(self.warnings),
            **({"rangefinder": self.beam.as_json()} if self.beam else {}),
        }


def calibrate(sighting: Sighting, lens: LensName | None = None) -> Calibration:
    """Fit, reject, measure.

    Args:
        sighting: what both cameras saw of the board.
        lens: the model to fit; None takes the plainest that fits.

    Raises:
        PomologError: too few views, views that do not agree, mirrored or swapped cameras, no lens
            that fits, or a rig that cannot be.
    """
    choice = choose(sighting, lens)
    rig = _rig_of(choice.fit)
    measures = measure(sighting.board, choice.fit, rectify(rig))
    trusted = trust(sighting.board.points_m, choice.fit, rig)
    rejected = {
        view.name: why_not(view, sighting) or choice.fit.rejected[view.name]
        for view in sighting.views
        if not view.whole or view.name in choice.fit.rejected
    }
    found = Calibration(rig, sighting, choice, measures, trusted, rejected, ())
    return replace(found, warnings=tuple(_warnings(found)))


def coverage(found: Calibration, side: Side) -> Floats:
    """(6, 8) how many corners of the used views lie in each cell of the picture."""
    width_px, height_px = found.rig.camera(side).size_px
    px = np.concatenate([view.corners(side).px for view in found.fit.views])
    counts, _, _ = np.histogram2d(
        px[:, 1], px[:, 0], bins=CELLS[::-1], range=((0, height_px), (0, width_px))
    )
    return np.asarray(counts, float)


def _rig_of(fitted: Fit) -> Rig:
    turn = np.asarray(cv2.Rodrigues(fitted.solution.step[:3])[0], float)
    return Rig(fitted.camera("left"), fitted.camera("right"), turn, fitted.solution.step[3:].copy())


def _warnings(found: Calibration) -> list[str]:
    """Whatever a careful person would look at again."""
    said = []
    fitted, rig = found.fit, found.rig
    if len(fitted.views) < FEW_VIEWS:
        said.append(
            f"only {len(fitted.views)} views: 10 to 20 in many positions and tilts tell more"
        )
    low_m, high_m = PLAUSIBLE_BASELINE_M
    if not low_m <= rig.baseline_m <= high_m:
        said.append(
            f"a baseline of {rig.baseline_m * 1e3:g} mm is unusual: is the square's side right, "
            "and in the right unit?"
        )
    limit_px = BAD_RMS * rig.left.size_px[0]
    if fitted.stereo_rms_px > limit_px:
        said.append(
            f"the corners are off by {fitted.stereo_rms_px:.2f} px (good: below {limit_px:.1f}): "
            "is the board flat and still, is another --lens better?"
        )
    for place, side in enumerate(SIDES):
        std_px, focal_px = found.trust.focal_std_px[place], rig.camera(side).matrix[0, 0]
        if std_px > UNSURE * focal_px:
            said.append(
                f"the {side} focal length is only known to {std_px:.1f} px "
                f"({100 * std_px / focal_px:.1f} %): tilt the board more, come closer"
            )
        filled = float((coverage(found, side) > 0).mean())
        if filled < COVERED:
            said.append(
                f"corners fill only {100 * filled:.0f} % of the {side} picture: show the board in "
                "its corners too"
            )
        corner_px = float(np.hypot(*rig.camera(side).size_px)) / 2
        if filled >= COVERED and turning_point(rig.camera(side))[1] < corner_px:
            said.append(
                f"beyond {fitted.reach_px(side):.0f} px from the middle of the {side} picture no "
                "corner was seen, and the lens model is not valid up to the picture's corners"
            )
    if found.trust.baseline_std_m > UNSURE * rig.baseline_m:
        said.append(
            f"the baseline is only known to {found.trust.baseline_std_m * 1e3:.2f} mm: more views, "
            "the board closer"
        )
    spacing, square_m = found.measures.spacing_m, found.sighting.board.square_m
    if spacing.count and abs(spacing.median / square_m - 1) > SPACING_OFF:
        said.append(
            f"corners measure {spacing.median * 1e3:.2f} mm apart, the board's are "
            f"{square_m * 1e3:g} mm"
        )
    said += _of_the_markers(found.sighting)
    return said


def _of_the_markers(sighting: Sighting) -> list[str]:
    board, pattern = sighting.board, sighting.pattern
    if pattern is None or board.marker_m is None:
        return []
    told = board.marker_m / board.square_m
    if abs(pattern.marker_share / told - 1) <= MARKER_OFF:
        return []
    seen = f"the markers look {pattern.marker_share:.2f} of a square wide"
    return [f"{seen}, --board says {told:.2f}: measure both again"]


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
