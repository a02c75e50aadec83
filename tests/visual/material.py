"""What is looked at: a small session that looks the same on every machine, replayed twice."""

from dataclasses import replace
from pathlib import Path

from processor.circles import HoughCircles
from processor.count import count_frame
from processor.locate import Locator
from processor.methods import to_toml
from processor.replay import Replayed, replay
from processor.rrd import RrdWriter
from recorder.pictures import decode
from recorder.records import AppleTruth, RangeReading
from recorder.rectify import rectify
from recorder.rig import Rangefinder
from recorder.session import Session
from recorder.status import RecorderStatus, StreamStatus
from tests.scenes import apple, small_rig, stereo_session

SECOND_NS = 1_000_000_000
STAGE_NS = {
    "rectify": 1_000_000, "recognise": 6_000_000, "clean": 3_000_000, "circles": 20_000_000,
    "match": 2_000_000, "triangulate": 1_000_000,
}  # fmt: skip  # of every frame: how long it really took is different each time


def apples(number: int) -> list[AppleTruth]:
    """Two in full sight, one too far for the paper's window, one that comes nearer."""
    return [
        apple(1, -0.06, -0.05, 0.42, seen=1.0),
        apple(2, 0.01, 0.0, 0.46, seen=1.0),
        apple(3, 0.12, -0.09, 1.0, seen=1.0),
        apple(4, -0.06, 0.08, 0.52 - 0.03 * number, seen=1.0),
    ]


def recorded(path: Path) -> Path:
    """Four pairs with a beam, and what a recorder says of losing frames."""
    rig = small_rig()
    beam = Rangefinder(rig.translation_m * 0, rig.rotation[2], 0.001)
    statuses = [
        RecorderStatus(
            second * SECOND_NS, "recording",
            (StreamStatus("left", second, dropped=second, rate_hz=1.0),
             StreamStatus("right", second, rate_hz=1.0)),
            second, 100_000, 0, 10**9, None, ("left: 3% overexposed",) if second == 2 else (),
        )
        for second in range(4)
    ]  # fmt: skip
    readings = [RangeReading(i * SECOND_NS, 0.421, 0.001, "ok", "0.421") for i in range(4)]
    return stereo_session(
        path, [apples(i) for i in range(4)], rig=small_rig(beam), encoding="jpeg",
        readings=readings, statuses=statuses,
    )  # fmt: skip


def results(folder: Path) -> tuple[Path, Path, Path]:
    """The session, the results of the paper's method on it, and those of another circle finder."""
    session = recorded(folder / "row.mcap")
    made = []
    for name, locator in (("paper", Locator()), ("hough", Locator(circles=HoughCircles()))):
        (done,) = replay([session], folder / name, locator, method=name)
        assert isinstance(done, Replayed), done
        _draw_again(session, locator, name, done.out / "trace.rrd")
        made.append(folder / name)
    return session, made[0], made[1]


def _draw_again(path: Path, locator: Locator, method: str, out: Path) -> None:
    """The recording as replay draws it, but for its stage times."""
    with Session(path) as session:
        parallel = rectify(session.rig)
        with RrdWriter(
            out, f"row-{session.fingerprint}", session.rig, parallel, first_ns=0, name="row"
        ) as drawing:
            toml = to_toml(method, locator)
            drawing.write_session(session, f"replayed with method {method}", toml)
            for pair in session.pairs():
                pictures = decode(pair.left), decode(pair.right)
                trace = locator(*pictures, parallel, (0, pair.index))
                trace = replace(trace, stage_ns=STAGE_NS)
                counts = count_frame(trace, pair.truth, parallel)
                drawing.write(pair, trace, counts, 4_000_000)
