"""What is to be opened: a session, a recording, runs, methods side by side, the worst cases."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from processor.recordings import join_recordings
from processor.results import read_table
from processor.run_file import read_run
from processor.runs import Run, find_runs
from processor.worst import KINDS, Kind, WorstCase, worst_cases
from recorder.errors import NewerProfileError, PomologError
from recorder.files import replacing
from recorder.session import read_info


@dataclass(frozen=True, slots=True)
class Wish:
    """What the user asks to see of it.

    Attributes:
        worst: how many of the worst cases; 0 is the whole.
        kinds: of worst cases.
        frame: to open at, or whose worst cases are meant.
        time_s: the same, in seconds since the session's first pair.
        apple: the true apple whose cases are meant.
        session: of which session, where results have several.
        tab: in front.
    """

    worst: int = 0
    kinds: tuple[Kind, ...] = KINDS
    frame: int | None = None
    time_s: float | None = None
    apple: int | None = None
    session: str = ""
    tab: str = ""


@dataclass(frozen=True, slots=True)
class Opening:
    """Files to open, and where.

    The layout comes first: a recording that is read before it is shown in the viewer's own views,
    and stays so.
    """

    files: tuple[Path, ...]
    frame: int | None = None


def choose(paths: Sequence[Path], wish: Wish, folder: Path) -> Opening:
    """Find or make what is to be opened.

    Args:
        paths: a session, a recording, or one or more folders of results.
        wish: what to see of it.
        folder: for what has to be made first.

    Raises:
        PomologError: nothing there can be opened, or it does not have what is asked for.
    """
    first = paths[0]
    for path in paths:
        _refuse_newer(path)
    if len(paths) == 1 and first.is_file():
        if wish != Wish(frame=wish.frame, tab=wish.tab):
            raise PomologError(
                f"{first} has no worst cases or apples of its own; give a folder of results, "
                f"made with: pomolog replay S.mcap -o OUT"
            )
        return _file(first, wish, folder)
    for path in paths:
        if path.is_file():
            raise PomologError(f"{path} is a file; side by side stand folders of results")
    if len(paths) > 1:
        return _side_by_side(paths, wish, folder)
    return _results(first, wish, folder)


def _refuse_newer(path: Path) -> None:
    """Refuse what a newer pomolog wrote; the viewer itself copes with what is torn or damaged."""
    try:
        if path.suffix == ".mcap" and path.is_file():
            read_info(path)
        for about in (path / "run.json", path.parent / "run.json", *path.glob("*/run.json")):
            if about.is_file():
                read_run(about)
    except NewerProfileError:
        raise
    except PomologError:
        return


def save(opening: Opening, out: Path) -> None:
    """Write what would be opened, its layout with it, as one recording.

    Raises:
        PomologError: it cannot be written, or a frame is asked for, which no file can keep.
    """
    if opening.frame is not None:
        raise PomologError("a saved recording opens at its beginning; leave --frame and --time out")
    if out.suffix != ".rrd":
        raise PomologError(f"{out} should end in .rrd, or no viewer opens it; give such a name")
    with replacing(out) as part:
        join_recordings(opening.files, part)


def _file(path: Path, wish: Wish, folder: Path) -> Opening:
    from viewer.layout import layout, save_layout, session_layout

    rbl = folder / "layout.rbl"
    if path.suffix == ".rrd":
        save_layout(rbl, layout(active=wish.tab))
        return Opening((rbl, path), wish.frame)
    if path.suffix != ".mcap":
        raise PomologError(
            f"{path} is no session, recording or folder of results; is the name right?"
        )
    from recorder.progress import progress
    from recorder.rectify import rectify
    from recorder.session import Session
    from viewer.session_rrd import draw_session_file

    with Session(path) as session:
        pairs = len(session)
        session.require_pairs()
        parallel = rectify(session.rig)
    _check_frame(path, wish.frame, pairs)
    resampled = any(view.maps is not None for view in (parallel.left, parallel.right))
    drawn = folder / f"{path.stem}.rrd"
    with progress("drawing", pairs) as tick:
        draw_session_file(path, drawn, tick)
    save_layout(rbl, session_layout(resampled=resampled, active=wish.tab))
    return Opening((rbl, drawn), wish.frame)


def _results(path: Path, wish: Wish, folder: Path) -> Opening:
    from viewer.layout import lay_out, layout, save_layout
    from viewer.layout_chosen import worst_layout
    from viewer.worst import write_worst

    runs = _drawn_runs(path, wish.session)
    rbl = folder / "layout.rbl"
    if wish.worst or wish.apple is not None:
        drawn = folder / "worst.rrd"
        write_worst(drawn, _cases(runs, wish))
        save_layout(rbl, worst_layout(active=wish.tab))
        return Opening((rbl, drawn))
    frame = _frame(runs, wish)
    recordings = tuple(run.folder / "trace.rrd" for run in runs)
    with suppress(PomologError):  # others' results may be read-only
        lay_out(recordings)
    save_layout(rbl, layout(active=wish.tab))
    return Opening((rbl, *recordings), frame)


def _drawn_runs(path: Path, session: str) -> tuple[Run, ...]:
    if not path.is_dir():
        raise PomologError(f"no {path}; give a session, or a folder of results")
    runs = find_runs([path])
    if session:
        known = ", ".join(run.about["session"]["name"] for run in runs)
        runs = tuple(run for run in runs if run.about["session"]["name"] == session)
        if not runs:
            raise PomologError(f"no session {session} in {path}; there are {known}")
    for run in runs:
        if not (run.folder / "trace.rrd").is_file():
            raise PomologError(
                f"no recording in {run.folder}; make one with: "
                f"pomolog replay S.mcap -o {run.folder.parent} --rrd full"
            )
    return runs


def _cases(runs: Sequence[Run], wish: Wish) -> tuple[WorstCase, ...]:
    frame = _frame(runs, wish)
    cases = worst_cases([run.folder for run in runs], kinds=wish.kinds)
    if frame is not None:
        cases = tuple(case for case in cases if case.frame == frame)
    if wish.apple is not None:
        cases = tuple(case for case in cases if case.apple_id == wish.apple)
        if not cases:
            raise PomologError(
                f"no true apple {wish.apple} that could be located in {runs[0].folder}"
                f"{'' if frame is None else f', frame {frame}'}; leave --apple out to see all"
            )
    return cases[: wish.worst] if wish.worst else cases


def _frame(runs: Sequence[Run], wish: Wish) -> int | None:
    """The frame asked for by its number or time, where it is there."""
    if wish.frame is None and wish.time_s is None:
        return None
    if len(runs) > 1:
        names = ", ".join(run.about["session"]["name"] for run in runs)
        raise PomologError(f"a frame of which session? add --session with one of {names}")
    if wish.frame is not None:
        _check_frame(runs[0].folder, wish.frame, runs[0].about["session"]["pairs"])
        return wish.frame
    assert wish.time_s is not None
    table = read_table(runs[0].folder, "frames")
    times = table["time_ns"].to_pylist()
    wanted = times[0] + wish.time_s * 1e9
    if not times[0] - 1e9 <= wanted <= times[-1] + 1e9:
        length = (times[-1] - times[0]) / 1e9
        raise PomologError(f"{runs[0].folder} has no second {wish.time_s:g}; it lasts {length:g} s")
    nearest = min(range(len(times)), key=lambda i: abs(times[i] - wanted))
    return int(table["frame"].to_pylist()[nearest])


def _check_frame(what: Path, frame: int | None, pairs: int) -> None:
    if frame is not None and not 0 <= frame < pairs:
        raise PomologError(f"{what} has no frame {frame}; it has 0 to {pairs - 1}")


def _side_by_side(paths: Sequence[Path], wish: Wish, folder: Path) -> Opening:
    from viewer.layout import save_layout
    from viewer.layout_chosen import side_by_side_layout
    from viewer.side_by_side import methods_of, write_side_by_side

    if wish.worst or wish.apple is not None:
        raise PomologError("the worst cases are of one folder of results; give one OUT")
    runs = [_drawn_runs(path, wish.session) for path in paths]
    shared = set.intersection(*({r.about["session"]["name"] for r in found} for found in runs))
    if not shared:
        raise PomologError(
            f"{' and '.join(map(str, paths))} have no session in common; replay one with both"
        )
    if len(shared) > 1:
        raise PomologError(
            f"{len(shared)} sessions in common; add --session with one of "
            f"{', '.join(sorted(shared))}"
        )
    chosen = [run for found in runs for run in found if run.about["session"]["name"] in shared]
    methods = methods_of(chosen)
    frame = _frame(chosen[:1], wish)
    drawn, rbl = folder / "side-by-side.rrd", folder / "layout.rbl"
    write_side_by_side(drawn, methods)
    save_layout(rbl, side_by_side_layout([m.name for m in methods], active=wish.tab))
    return Opening((rbl, drawn), frame)
