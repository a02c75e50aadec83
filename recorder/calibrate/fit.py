"""One lens model fitted to all views: cameras, the step between them, which views to believe."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from recorder.calibrate.adjust import Observed, Solution, adjust, residuals_of, rms_px
from recorder.calibrate.board import Corners
from recorder.calibrate.lens import as_camera, start, turning_point
from recorder.calibrate.views import BoardView, Sighting
from recorder.errors import PomologError
from recorder.records import SIDES, Side
from recorder.rig import Camera, Floats, LensModel

MIN_VIEWS: Final = 3
MIN_TILT: Final = np.deg2rad(6)  # a board's shape changes by the cosine: by half a percent
CONSISTENT: Final = 0.012  # of the picture's width: what a pose from one camera may miss by
OUTLIER_TIMES, OUTLIER_PX = 2.5, 0.15  # a view's rms against the median of all
FAR_CORNER_TIMES, FAR_CORNER_PX = 6.0, 1.0  # a corner's residual against the others' spread
ROUNDS: Final = 6  # of rejecting and fitting again


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A lens model fitted.

    Attributes:
        views: those that were used, without the corners that were left out.
        residuals_px: for each of them, left and right (N, 2) observed minus fitted.
        rejected: name of a view -> why it was not used.
        view_rms_px: of every view that both cameras see, used or not.
        corners_left_out: single corners that lie far off in views that are used.
        untrimmed_rms_px: over the corners of both cameras, those left out included.
    """

    solution: Solution
    views: tuple[BoardView, ...]
    residuals_px: tuple[tuple[Floats, ...], ...]
    rejected: Mapping[str, str]
    view_rms_px: Mapping[str, float]
    corners_left_out: int
    untrimmed_rms_px: float
    sizes_px: tuple[tuple[int, int], tuple[int, int]]

    @property
    def stereo_rms_px(self) -> float:
        """Over the corners of both cameras."""
        return rms_px([part for view in self.residuals_px for part in view])

    def rms_px(self, side: Side) -> float:
        """Over one camera's corners."""
        return rms_px([view[SIDES.index(side)] for view in self.residuals_px])

    @property
    def lens(self) -> LensModel:
        """The model."""
        return self.solution.lens

    def camera(self, side: Side) -> Camera:
        """One camera."""
        place = SIDES.index(side)
        return as_camera(self.solution.cameras[place], self.lens, self.sizes_px[place])

    def reach_px(self, side: Side) -> float:
        """How far from the optical axis the furthest corner is that this camera saw."""
        centre = self.solution.cameras[SIDES.index(side)][2:4]
        corners = np.concatenate([view.corners(side).px for view in self.views])
        return float(np.linalg.norm(corners - centre, axis=1).max())

    def is_sound(self, points_m: Floats) -> bool:
        """Whether no lens turns back before the furthest corner that was seen."""
        widest = [0.0, 0.0]
        step = self.solution.step
        for view, pose in zip(self.views, self.solution.poses, strict=True):
            for place, side in enumerate(SIDES):
                seen = points_m[view.corners(side).ids] @ _matrix(pose).T + pose[3:]
                if place:
                    seen = seen @ _matrix(step).T + step[3:]
                if len(seen):
                    angles = np.arctan2(np.linalg.norm(seen[:, :2], axis=1), seen[:, 2])
                    widest[place] = max(widest[place], float(angles.max()))
        return all(
            turning_point(self.camera(side))[0] > angle
            for side, angle in zip(SIDES, widest, strict=True)
        )


def fit(points_m: Floats, sighting: Sighting, lens: LensModel) -> Fit:
    """Fit one lens model.

    Raises:
        PomologError: too few views that agree with each other.
    """
    views = sighting.whole
    left, right = (_alone(points_m, sighting, side, lens) for side in SIDES)
    steps = [step_between(one, other) for one, other in zip(left.poses, right.poses, strict=True)]
    step, agreeing = _agreement(points_m, views, right, left.poses, steps, sighting.right_size_px)
    _require_tilts(left.poses)
    if len(agreeing) < MIN_VIEWS:
        raise NoAgreementError(steps, views)
    begin = Solution(lens, (left.cameras[0], right.cameras[0]), step, left.poses)
    return _joint(points_m, sighting, begin, agreeing)


class NoAgreementError(PomologError):
    """The views do not agree on where the right camera is."""

    def __init__(self, steps: Sequence[Floats], views: Sequence[BoardView]) -> None:
        turns = np.rad2deg([np.linalg.norm(step[:3]) for step in steps])
        shifts_mm = 1e3 * np.array([step[3:] for step in steps])
        spread_mm = float(np.linalg.norm(shifts_mm - np.median(shifts_mm, axis=0), axis=1).max())
        super().__init__(
            f"the {len(views)} views do not agree on where the right camera is: by up to "
            f"{spread_mm:.0f} mm and {np.ptp(turns):.1f} degrees; do the pictures belong together, "
            "and did neither board nor cameras move between them?"
        )


def _require_tilts(poses: Sequence[Floats]) -> None:
    """Refuse boards that all face one way: size and distance cannot be told apart then.

    Raises:
        PomologError: no two of them are `MIN_TILT` apart.
    """
    normals = np.array([_matrix(pose)[:, 2] for pose in poses])
    middle = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
    widest = float(np.arccos(np.clip(normals @ middle, -1, 1)).max())
    if widest < MIN_TILT:
        raise PomologError(
            f"the board is seen at one angle (all within {np.rad2deg(widest):.1f} degrees), which "
            "does not tell the focal length; tilt it by 20 to 45 degrees in all directions"
        )


def step_between(left_pose: Floats, right_pose: Floats) -> Floats:
    """(6,) the step from the left to the right camera that two poses of one board say."""
    left, right = (_matrix(pose) for pose in (left_pose, right_pose))
    turn = right @ left.T
    return np.concatenate([_vector(turn), right_pose[3:] - turn @ left_pose[3:]])


def _alone(points_m: Floats, sighting: Sighting, side: Side, lens: LensModel) -> Solution:
    """One camera by itself."""
    corners = [view.corners(side) for view in sighting.whole]
    numbers, poses = start(points_m, corners, sighting.size_px(side), lens)
    seen = [Observed((one,)) for one in corners]
    begin = Solution(lens, (numbers,), np.zeros(6), tuple(poses))
    placed = adjust(points_m, begin, seen, robust=True, only_cameras=True, rounds=30)
    return adjust(points_m, placed, seen, robust=True)


def _agreement(
    points_m: Floats,
    views: Sequence[BoardView],
    right: Solution,
    left_poses: Sequence[Floats],
    steps: Sequence[Floats],
    size_px: tuple[int, int],
) -> tuple[Floats, tuple[int, ...]]:
    """The view's step that most other views agree with, and which do: seen in the right picture."""
    allowed_px = CONSISTENT * size_px[0]
    best: tuple[tuple[int, float], Floats, tuple[int, ...]] = ((0, 0.0), steps[0], ())
    for step in steps:
        turn = _matrix(step)
        poses = tuple(
            np.concatenate([_vector(turn @ _matrix(pose)), turn @ pose[3:] + step[3:]])
            for pose in left_poses
        )
        moved = replace(right, poses=poses)
        seen = [Observed((view.right,)) for view in views]
        misses = [rms_px(list(one)) for one in residuals_of(points_m, moved, seen)]
        agreeing = tuple(i for i, miss in enumerate(misses) if miss < allowed_px)
        key = (len(agreeing), -float(np.median(misses)))
        if key > best[0]:
            best = (key, step, agreeing)
    return best[1], best[2]


def _joint(points_m: Floats, sighting: Sighting, begin: Solution, agreeing: Sequence[int]) -> Fit:
    """Both cameras at once; views and corners far off are left out until nothing changes."""
    views = sighting.whole
    used = tuple(agreeing)
    kept: dict[int, BoardView] = dict(enumerate(views))
    solution = begin
    misses = np.zeros(len(views))
    for _ in range(ROUNDS):
        some = replace(solution, poses=tuple(solution.poses[i] for i in used))
        seen = [_observed(kept[i]) for i in used]
        some = adjust(points_m, adjust(points_m, some, seen, robust=True), seen)
        poses = list(solution.poses)
        for i, pose in zip(used, some.poses, strict=True):
            poses[i] = pose
        for i in set(range(len(views))) - set(used):
            alone = replace(some, poses=(poses[i],))
            poses[i] = adjust(points_m, alone, [_observed(views[i])], only_poses=True).poses[0]
        solution = replace(some, poses=tuple(poses))
        residuals = residuals_of(points_m, solution, [_observed(view) for view in views])
        before = (used, {i: (len(kept[i].left), len(kept[i].right)) for i in used})
        kept = _without_far_corners(views, residuals, used)
        trimmed = residuals_of(points_m, solution, [_observed(kept[i]) for i in range(len(views))])
        misses = np.array([rms_px(list(one)) for one in trimmed])
        used = _believed(misses, used)
        if before == (used, {i: (len(kept[i].left), len(kept[i].right)) for i in used}):
            break
    if len(used) < MIN_VIEWS:
        raise PomologError(
            f"only {len(used)} of {len(views)} views agree with each other; take pictures anew, "
            "the board flat and still"
        )
    believed = float(np.median(misses[list(used)]))
    left_out = sum(
        len(views[i].left) + len(views[i].right) - len(kept[i].left) - len(kept[i].right)
        for i in used
    )
    return Fit(
        replace(solution, poses=tuple(solution.poses[i] for i in used)),
        tuple(kept[i] for i in used),
        tuple(trimmed[i] for i in used),
        {
            views[i].name: f"its corners are off by {misses[i]:.2f} px, the others' by "
            f"{believed:.2f}; did the board move or bend, or is it blurred?"
            for i in range(len(views))
            if i not in used
        },
        {view.name: float(miss) for view, miss in zip(views, misses, strict=True)},
        left_out,
        rms_px([part for i in used for part in residuals[i]]),
        (sighting.left_size_px, sighting.right_size_px),
    )


def _believed(misses: Floats, used: Sequence[int]) -> tuple[int, ...]:
    """The views whose rms is like the others'; those that were used before set the measure."""
    usual = misses[list(used)]
    middle = float(np.median(usual))
    spread = 1.4826 * float(np.median(np.abs(usual - middle)))
    limit = max(OUTLIER_TIMES * middle, middle + OUTLIER_PX, middle + 6 * spread)
    return tuple(i for i, miss in enumerate(misses) if miss <= limit)


def _without_far_corners(
    views: Sequence[BoardView], residuals: Sequence[tuple[Floats, ...]], used: Sequence[int]
) -> dict[int, BoardView]:
    """Each view without the corners that were found in the wrong place."""
    lengths = np.concatenate([np.linalg.norm(part, axis=1) for i in used for part in residuals[i]])
    spread = float(np.median(lengths)) / 1.1774  # the median of Rayleigh's distribution
    limit = max(FAR_CORNER_TIMES * spread, FAR_CORNER_PX)
    kept = {}
    for i, (view, parts) in enumerate(zip(views, residuals, strict=True)):
        near = [np.linalg.norm(part, axis=1) <= limit for part in parts]
        few = any(keep.mean() < 0.8 for keep in near)  # then it is the view that is wrong
        kept[i] = view if few else replace(
            view,
            left=Corners(view.left.ids[near[0]], view.left.px[near[0]]),
            right=Corners(view.right.ids[near[1]], view.right.px[near[1]]),
        )  # fmt: skip
    return kept


def _observed(view: BoardView) -> Observed:
    return Observed((view.left, view.right))


def _matrix(pose: Floats) -> Floats:
    return np.asarray(cv2.Rodrigues(pose[:3])[0], float)


def _vector(turn: Floats) -> Floats:
    return np.asarray(cv2.Rodrigues(turn)[0], float).ravel()
