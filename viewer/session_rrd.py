"""A session without results, drawn: its pictures as recorded, truth, notes, the ledger."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from processor.recordings import join_recordings
from processor.rrd import RrdWriter
from recorder.files import replacing
from recorder.rectify import rectify
from recorder.session import Session

Tick = Callable[[int], None]

SLICE_PAIRS: Final = 64  # a slice is held in memory until it is written


def draw_session_file(path: Path, out: Path, tick: Tick = lambda _: None) -> None:
    """Draw a session's pairs, in bounded memory, without looking for fruit.

    Args:
        path: the session.
        out: the recording to write.
        tick: hears of each pair.

    Raises:
        PomologError: the session cannot be read, or `out` not be written.
    """
    with (
        Session(path) as session,
        TemporaryDirectory(dir=out.parent, prefix=".parts-") as folder,
        replacing(out) as whole,
    ):
        session.require_pairs()
        parallel = rectify(session.rig)
        first_ns = int(session.pair_times_ns()[0, 0])
        parts = []
        for start in range(0, len(session), SLICE_PAIRS):
            parts.append(Path(folder) / f"{start:08d}.rrd")
            name = f"{session.name}-{session.fingerprint}-session"
            with RrdWriter(
                parts[-1], name, session.rig, parallel, first_ns=first_ns, name=session.name
            ) as drawing:
                if start == 0:
                    drawing.write_session(session, "as recorded, without results")
                for pair in session.pairs(start, start + SLICE_PAIRS):
                    drawing.write_pair(pair)
                    tick(1)
        join_recordings(parts, whole)
