"""Where a rangefinder's beam leaves and where it goes, from readings on surfaces that are known.

The board is a plane of known place, a true apple a ball. A reading is the way along the beam from
its origin to the surface, so moving the origin along the beam is the instrument's offset: five
unknowns, all told by boards at several tilts. Boards that are all alike tell fewer, and then fewer
are estimated, and that is said.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from scipy.optimize import least_squares

from recorder.errors import PomologError
from recorder.rig import Floats, Rangefinder

MIN_READINGS: Final = 6
LEAST_STD_M: Final = 0.001  # the surface itself is not known better
TILTS_RAD: Final = np.deg2rad((-12.0, 0.0, 12.0))  # of the beams that a fit starts from
OUTLIER_TIMES: Final = 5.0
SURE_ORIGIN_M: Final = 0.01  # 10 mm at the origin are 10 mm on the fruit
SURE_ANGLE_RAD: Final = np.deg2rad(0.5)  # 9 mm at a metre
LEVELS: Final = {5: "origin and direction", 3: "direction and offset", 1: "offset"}


class Surface(Protocol):
    """Something that a beam meets."""

    def distance_m(self, origin_m: Floats, direction: Floats) -> float:
        """Along a beam of unit direction, to this surface."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A board: normal @ x = offset_m, in the left camera's frame."""

    normal: Floats
    offset_m: float

    def distance_m(self, origin_m: Floats, direction: Floats) -> float:
        """To the plane; far away for a beam along it."""
        slope = float(self.normal @ direction)
        return (self.offset_m - float(self.normal @ origin_m)) / (
            slope if abs(slope) > 1e-6 else 1e-6
        )


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """An apple."""

    centre_m: Floats
    radius_m: float

    def distance_m(self, origin_m: Floats, direction: Floats) -> float:
        """To its front; beside it, on from its rim by as much as it is missed by."""
        way = self.centre_m - origin_m
        along = float(way @ direction)
        missed_m = float(np.linalg.norm(way - along * direction))
        inside = self.radius_m**2 - missed_m**2
        return along - (float(np.sqrt(inside)) if inside > 0 else self.radius_m - missed_m)


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """One answer of the rangefinder and the surface that it met."""

    name: str
    surface: Surface
    range_m: float
    std_m: float


@dataclass(frozen=True, slots=True, eq=False)
class BeamFit:
    """A beam found.

    Attributes:
        estimated: which of its numbers the readings told: one of LEVELS.
        origin_std_m: (3,), 0 where it was not estimated.
        angle_std_rad: of the direction, in its less certain sense; 0 where not estimated.
        rms_m: of the readings that were used.
        left_out: names of the pairs whose reading met something else.
    """

    rangefinder: Rangefinder
    estimated: str
    origin_std_m: Floats
    angle_std_rad: float
    rms_m: float
    used: int
    left_out: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """For `calibrate --json`."""
        return {
            "origin_m": self.rangefinder.origin_m.tolist(),
            "direction": self.rangefinder.direction.tolist(),
            "origin_std_m": self.origin_std_m.tolist(),
            "direction_std_deg": float(np.rad2deg(self.angle_std_rad)),
            "estimated": self.estimated,
            "rms_m": self.rms_m,
            "readings_used": self.used,
            "readings_left_out": list(self.left_out),
        }


def fit_beam(readings: Sequence[Reading], known: Rangefinder | None) -> BeamFit:
    """Estimate as much of the beam as the readings tell.

    Args:
        readings: on boards or apples in several places and tilts.
        known: the beam by a ruler; what the readings do not tell is left as it is there.

    Raises:
        PomologError: too few readings, or they tell too little and nothing is known otherwise.
    """
    if len(readings) < MIN_READINGS:
        raise PomologError(
            f"{len(readings)} readings on known surfaces do not tell where the rangefinder is; "
            f"{MIN_READINGS} are the least: hold the board into the beam at several tilts"
        )
    best: BeamFit | None = None
    for level in LEVELS:
        if level < 5 and known is None:
            break
        best = _fit(readings, known, level)
        if _is_sure(best):
            return best
    assert best is not None
    raise PomologError(
        f"{best.used} readings do not tell where the rangefinder is (its direction to "
        f"{np.rad2deg(best.angle_std_rad):.1f} degrees, its origin to "
        f"{1e3 * best.origin_std_m.max():.0f} mm); hold the board into the beam at more tilts and "
        "distances"
        + ("" if known else ", or write [rangefinder] by a ruler into the session's rig")
    )


def _is_sure(found: BeamFit) -> bool:
    return (
        found.used >= MIN_READINGS
        and bool((found.origin_std_m < SURE_ORIGIN_M).all())
        and found.angle_std_rad < SURE_ANGLE_RAD
    )


def _fit(readings: Sequence[Reading], known: Rangefinder | None, level: int) -> BeamFit:
    """Estimate 5, 3 or 1 of a beam's numbers, robustly."""
    origin_m = known.origin_m if known else np.zeros(3)
    forward = known.direction if known else np.array([0.0, 0, 1])
    beside = np.linalg.svd(forward[None])[2][1:]  # two directions across the beam

    def beam(unknowns: Floats) -> tuple[Floats, Floats]:
        """Offset along the beam, two slopes, two shifts across: as many as there are."""
        offset_m, *more = np.pad(unknowns, (0, 5 - len(unknowns)))
        turned = forward + more[0] * beside[0] + more[1] * beside[1]
        direction = turned / np.linalg.norm(turned)
        shift_m = more[2] * beside[0] + more[3] * beside[1]
        return origin_m + shift_m + offset_m * direction, direction

    def misses(unknowns: Floats, some: Sequence[Reading]) -> Floats:
        origin, direction = beam(unknowns)
        return np.array(
            [
                (one.surface.distance_m(origin, direction) - one.range_m)
                / max(one.std_m, LEAST_STD_M)
                for one in some
            ]
        )

    tilts = TILTS_RAD if level > 1 and known is None else (0.0,)
    starts = [np.array([0.0, across, down, 0, 0][:level]) for across in tilts for down in tilts]
    tries = [
        least_squares(misses, start, args=(readings,), loss="cauchy", x_scale=0.05)
        for start in starts
    ]
    best = min(tries, key=lambda one: float(one.cost))
    left = np.abs(misses(best.x, readings))
    spread = max(1.0, 1.4826 * float(np.median(left)))
    used = [one for one, off in zip(readings, left, strict=True) if off <= OUTLIER_TIMES * spread]
    final = least_squares(misses, best.x, args=(used,), x_scale=0.05)
    jacobian = np.asarray(final.jac, float)
    freedom = max(1, len(used) - level)
    noise = max(1.0, 2 * float(final.cost) / freedom)  # never surer than the instrument itself
    covariance = noise * np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12)
    # a direction that no reading tells has no pull at all, and pinv would call it certain
    strength = np.linalg.eigvalsh(jacobian.T @ jacobian)
    if strength[0] < 1e-9 * strength[-1]:
        covariance = covariance + np.eye(level)
    origin, direction = beam(final.x)
    slopes = np.array(
        [(beam(final.x + step)[0] - origin) / 1e-6 for step in 1e-6 * np.eye(level)]
    ).T
    angle = np.sqrt(np.linalg.eigvalsh(covariance[1:3, 1:3])[-1]) if level > 1 else 0.0
    std_m = known.std_m if known else float(np.median([one.std_m for one in used]))
    return BeamFit(
        Rangefinder(origin, direction, std_m),
        LEVELS[level],
        np.sqrt(np.diag(slopes @ covariance @ slopes.T)),
        float(angle),
        float(np.sqrt(np.mean([
            (one.surface.distance_m(origin, direction) - one.range_m) ** 2 for one in used
        ]))),
        len(used),
        tuple(one.name for one in readings if not any(one is other for other in used)),
    )  # fmt: skip
