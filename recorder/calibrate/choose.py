"""Which lens model: the plainest that fits, and what to say where none does."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from recorder.calibrate.board import Board, Corners
from recorder.calibrate.fit import MIN_VIEWS, Fit, NoAgreementError, fit
from recorder.calibrate.lens import LENSES, LensName
from recorder.calibrate.views import BoardView, Sighting, why_not
from recorder.errors import PomologError
from recorder.records import SIDES, Side
from recorder.rig import Floats, LensModel

CLEARLY_BETTER: Final = 0.95  # of the rms: a richer lens must gain a twentieth to be believed


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A lens model and why it was taken.

    Attributes:
        rms_px: of every model that was tried.
        sentence: why it was taken, in a user's words.
    """

    fit: Fit
    rms_px: Mapping[LensModel, float]
    sentence: str


def choose(sighting: Sighting, lens: LensName | None = None) -> Choice:
    """Fit one lens model, or all three and take the plainest that fits.

    Args:
        sighting: the views.
        lens: the model to fit; None to choose.

    Raises:
        PomologError: too few views, views that do not agree, mirrored or swapped cameras, or no
            lens that fits.
    """
    _require_views(sighting)
    points_m = sighting.board.points_m
    wanted = [LENSES[lens]] if lens else list(LENSES.values())
    fits: list[Fit] = []
    failure: PomologError | None = None
    for model in wanted:
        try:
            fits.append(fit(points_m, sighting, model))
        except PomologError as error:
            failure = failure or error
    if isinstance(failure, NoAgreementError) and not fits:
        raise PomologError(_explained(points_m, sighting, wanted[0]) or str(failure)) from None
    sound = [one for one in fits if one.is_sound(points_m)]
    if not fits:
        assert failure is not None
        raise failure
    if not sound:
        raise PomologError(
            f"no lens model fits: {fits[0].lens} turns back within the picture; show the board "
            "closer to the picture's corners, or give another --lens"
        )
    best = sound[0]
    for other in sound[1:]:
        if other.untrimmed_rms_px < CLEARLY_BETTER * best.untrimmed_rms_px:
            best = other
    _require_sides(best, sighting.board)
    rms_px = {one.lens: one.untrimmed_rms_px for one in fits}
    return Choice(best, rms_px, _why(best, fits, sound, asked=lens is not None))


def _require_views(sighting: Sighting) -> None:
    if len(sighting.whole) >= MIN_VIEWS:
        return
    reasons = [
        f"{view.name}: {why_not(view, sighting)}" for view in sighting.views if not view.whole
    ]
    shown = "; ".join(reasons[:4]) + (f"; and {len(reasons) - 4} more" if len(reasons) > 4 else "")
    raise PomologError(
        f"too few views: both cameras see the board in {len(sighting.whole)} of "
        f"{len(sighting.views)}, and {MIN_VIEWS} are the least (10 or more are good)"
        + (f"; {shown}" if shown else "")
    )


def _require_sides(best: Fit, board: Board) -> None:
    """Say where the right camera is on the left, or nowhere that a camera can be."""
    baseline_m = float(np.linalg.norm(best.solution.step[3:]))
    if best.solution.step[3] > 0:
        mirrored = " or all pictures mirrored" if board.kind == "chessboard" else ""
        raise PomologError(
            f"the right camera is {baseline_m * 1e3:.1f} mm to the left of the left one: are the "
            f"two folders swapped{mirrored}?"
        )


def _why(best: Fit, fits: Sequence[Fit], sound: Sequence[Fit], *, asked: bool) -> str:
    others = [
        f"{one.lens} {one.untrimmed_rms_px:.2f}" + ("" if one in sound else " (and turns back)")
        for one in fits
        if one is not best
    ]
    here = f"lens {best.lens}"
    if asked:
        return f"{here}, as asked"
    if best is fits[0]:
        return f"{here}: the plain model fits as well as any ({', '.join(others)} px)"
    return f"{here}: it leaves {best.untrimmed_rms_px:.2f} px; {', '.join(others)} px"


def _explained(points_m: Floats, sighting: Sighting, lens: LensModel) -> str:
    """A mistake that would make the views agree, in a user's words; "" where none does."""
    for side in reversed(SIDES):
        if sighting.board.kind != "chessboard":
            break  # a mirrored marker is not found at all
        for turned in (False, True):
            views = tuple(_mirrored(view, side, sighting, turned=turned) for view in sighting.whole)
            found = _tried(points_m, replace(sighting, views=views), lens)
            if found is not None and found.solution.step[3] < 0:
                return f"the {side} pictures are mirrored: only then do the views agree"
    whole = sighting.whole
    for shift in (1, -1):
        pairs = list(zip(whole[max(0, -shift) :], whole[max(0, shift) :], strict=False))
        views = tuple(replace(one, right=other.right) for one, other in pairs)
        if len(views) >= MIN_VIEWS and _tried(points_m, replace(sighting, views=views), lens):
            when = "later" if shift > 0 else "earlier"
            return (
                f"the pairs do not belong together: each left picture fits the right one that "
                f"comes {when}; is one missing?"
            )
    return ""


def _tried(points_m: Floats, sighting: Sighting, lens: LensModel) -> Fit | None:
    try:
        found = fit(points_m, sighting, lens)
    except PomologError:
        return None
    return found if len(found.views) > len(sighting.whole) / 2 else None


def _mirrored(view: BoardView, side: Side, sighting: Sighting, *, turned: bool) -> BoardView:
    """A chessboard view with one picture mirrored back and its corners numbered anew."""
    board = sighting.board
    corners = view.corners(side)
    width_px = sighting.size_px(side)[0]
    flipped = np.column_stack([width_px - 1 - corners.px[:, 0], corners.px[:, 1]])
    grid = flipped.reshape(board.rows, board.columns, 2)[::-1]
    if turned:
        grid = grid[::-1, ::-1]
    again = Corners(corners.ids, grid.reshape(-1, 2))
    return replace(view, left=again) if side == "left" else replace(view, right=again)
