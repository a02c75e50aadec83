"""Recordings, read back: every intermediate of both views, in order, with the recorded bytes."""

import io
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import rerun as rr
import rerun_cli
from PIL import Image
from rerun.chunk import RrdReader

import processor.replay as module
from processor.count import FrameCounts, count_frame
from processor.locate import Locator
from processor.palette import ESTIMATE, FALSE
from processor.recordings import join_recordings
from processor.replay import Replayed, replay
from processor.rrd import RrdWriter
from processor.rrd_pictures import known_fruit, mask_picture
from processor.trace import Trace
from recorder.errors import PomologError
from recorder.pictures import decode
from recorder.records import (
    SIDES,
    UNCOUNTED,
    FrameTruth,
    Labels,
    RangeReading,
    StereoPair,
)
from recorder.rectify import rectify
from recorder.rig import Camera, Rangefinder, Rig
from recorder.session import Session
from tests.scenes import TINY, apple, small_rig, stereo_session, tiny_rig
from viewer.session_rrd import draw_session_file

BEAM = Rangefinder(np.array([0.0, 0.05, 0.0]), np.array([0.0, 0.0, 1.0]), 0.001)
OF_A_VIEW = (
    "picture", "mask", "cleaned", "contours", "tried", "fruit", "numbers", "truth",
)  # fmt: skip
OF_A_FRAME = (
    "world/left/reference_line", "world/apples", "world/truth", "world/beam",
    "index/left", "index/right", "match/views", "match/circles", "match/lines", "match/table",
    "match/projection/left", "match/projection/right", "match/correlation",
    "range/errors", "range/intervals", "range/readings", "range/table",
    "count", "verdict", "false", "time_ms",
    "health/overexposed", "health/brightness", "health/skew_ms",
)  # fmt: skip


@pytest.fixture(autouse=True)
def _strict() -> Iterator[None]:
    """Rerun only warns of bad arguments unless it is told to be strict."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def rerun(*words: object) -> subprocess.CompletedProcess[str]:
    binary = Path(rerun_cli.__file__).parent / "rerun"
    return subprocess.run(
        [binary, "rrd", *map(str, words)], capture_output=True, text=True, check=False
    )


class Recording:
    """All columns of a recording: entity -> column -> rows in the order of the file."""

    def __init__(self, path: Path) -> None:
        self.columns: dict[str, dict[str, list[Any]]] = {}
        self.frames: dict[str, list[int]] = {}
        for chunk in RrdReader(path).store().stream():
            batch = chunk.to_record_batch()
            entity = chunk.entity_path.lstrip("/")
            columns = self.columns.setdefault(entity, {})
            for name in batch.schema.names:
                rows = batch.column(name)
                if name == "frame":
                    self.frames.setdefault(entity, []).extend(rows.to_pylist())
                elif ":" in name:
                    columns.setdefault(name, []).extend(rows.to_pylist())

    def at(self, entity: str, column: str, frame: int) -> Any:
        return self.columns[entity][column][self.frames[entity].index(frame)]

    def blob(self, entity: str, frame: int) -> bytes:
        return bytes(self.at(entity, "EncodedImage:blob", frame)[0])


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording]:
    """A session of three pairs (an apple, none, another) with a beam, and its recording."""
    folder = tmp_path_factory.mktemp("drawn")
    frames = [[apple(1, seen=1.0)], [], [apple(2, 0.02, seen=1.0), apple(3, -0.09, seen=1.0)]]
    readings = [
        RangeReading(10, 0.36, 0.001, "ok", "0.36"),
        RangeReading(1_000_000_010, None, None, "no signal", "E"),
    ]
    session = stereo_session(
        folder / "row.mcap", frames, rig=small_rig(BEAM), encoding="jpeg", readings=readings
    )
    (done,) = replay([session], folder, Locator())
    assert isinstance(done, Replayed), done
    return session, Recording(done.out / "trace.rrd")


def test_every_intermediate_of_both_views_is_there_for_every_frame(
    drawn: tuple[Path, Recording],
) -> None:
    recording = drawn[1]
    for entity in (*(f"world/{s}/{what}" for s in SIDES for what in OF_A_VIEW), *OF_A_FRAME):
        assert recording.frames[entity] == [0, 1, 2], entity


def test_the_recorded_jpegs_are_passed_through_byte_for_byte(
    drawn: tuple[Path, Recording],
) -> None:
    with Session(drawn[0]) as session:
        for pair in session.pairs():
            for side, frame in (("left", pair.left), ("right", pair.right)):
                assert drawn[1].blob(f"world/{side}/picture", pair.index) == frame.data


def classes_of(png: bytes) -> npt.NDArray[np.uint8]:
    """A mask's classes: 0 nothing, 1 hit, 2 false, 3 missed."""
    return np.asarray(Image.open(io.BytesIO(png)))


def png_of(drawn: Any) -> bytes:
    return bytes(drawn.blob.as_arrow_array().to_pylist()[0])


def test_a_mask_tells_hits_from_mistakes_and_leaves_out_what_counts_neither_way() -> None:
    mask = np.array([[255, 255, 0, 0, 255]], np.uint8)
    labels = np.array([[3, 0, 3, 0, UNCOUNTED]], np.uint16)

    def shown(known: Labels | None, *, partial: bool = False) -> list[int]:
        fruit = None if known is None else known_fruit(known)
        drawn = mask_picture(mask, fruit, partial=partial)
        return [int(n) for n in classes_of(png_of(drawn))[0]]

    assert shown(labels) == [1, 2, 3, 0, 0]
    assert shown(None) == [2, 2, 0, 0, 2]


@pytest.mark.parametrize("partial", [False, True])
def test_what_may_be_unlabelled_fruit_is_not_in_the_colour_of_mistakes(partial: bool) -> None:
    mask, labels = np.full((8, 8), 255, np.uint8), np.zeros((8, 8), np.uint16)
    drawn = mask_picture(mask, known_fruit(labels), partial=partial)
    colour = Image.open(io.BytesIO(png_of(drawn))).convert("RGBA").getpixel((0, 0))
    assert isinstance(colour, tuple)
    assert colour[:3] == (ESTIMATE if partial else FALSE)


def test_masks_are_drawn_pixel_for_pixel(drawn: tuple[Path, Recording]) -> None:
    with Session(drawn[0]) as session:
        for pair in session.pairs():
            trace = Locator()(
                decode(pair.left), decode(pair.right), rectify(session.rig), (0, pair.index)
            )
            for side in SIDES:
                view = trace.view(side)
                for name, mask in (
                    ("mask", view.recognition.mask), ("cleaned", view.cleaning.mask),
                ):  # fmt: skip
                    classes = classes_of(drawn[1].blob(f"world/{side}/{name}", pair.index))
                    np.testing.assert_array_equal(np.isin(classes, (1, 2)), mask > 0)


def test_circles_contours_and_places_are_those_of_the_trace(
    drawn: tuple[Path, Recording],
) -> None:
    recording = drawn[1]
    with Session(drawn[0]) as session:
        pair = next(iter(session.pairs()))
        trace = Locator()(decode(pair.left), decode(pair.right), rectify(session.rig), (0, 0))
    (fruit,) = trace.left.circles.fruit
    centre = recording.at("world/left/fruit", "Ellipses2D:centers", 0)
    assert np.asarray(centre) == pytest.approx(np.array([[fruit.x_px, fruit.y_px]]), rel=1e-6)
    half = recording.at("world/left/fruit", "Ellipses2D:half_sizes", 0)
    assert np.asarray(half) == pytest.approx(np.full((1, 2), fruit.radius_px), rel=1e-6)
    tried = recording.at("world/left/tried", "Ellipses2D:centers", 0)
    assert np.asarray(tried) == pytest.approx(trace.left.circles.tried[:, 1:3])
    (contour,) = recording.at("world/left/contours", "LineStrips2D:strips", 0)
    outline = np.asarray(contour, np.float32)
    assert len(outline) < len(trace.left.cleaning.regions[0].contour_px) / 3
    for x, y in trace.left.cleaning.regions[0].contour_px.tolist():
        assert abs(cv2.pointPolygonTest(outline, (x, y), True)) <= 1.01  # thinned to a pixel
    place = recording.at("world/apples", "Ellipsoids3D:centers", 0)
    assert np.asarray(place) == pytest.approx(np.array([trace.apples[0].centre_m]), rel=1e-6)
    line = recording.at("world/left/reference_line", "LineStrips2D:strips", 0)
    assert line[0][0][0] == trace.matching.reference_px
    bars = recording.at("match/correlation", "BarChart:values", 0)
    shown = np.asarray(bars[0]["buffer"] if isinstance(bars[0], dict) else bars[0])
    assert shown.size


def test_truth_is_drawn_in_space_and_in_both_views(drawn: tuple[Path, Recording]) -> None:
    recording = drawn[1]
    places = recording.at("world/truth", "Ellipsoids3D:centers", 2)
    assert np.asarray(places) == pytest.approx(np.array([[0.02, 0, 0.4], [-0.09, 0, 0.4]]))
    for side, shift_px in (("left", 0.0), ("right", 60.0)):
        discs = recording.at(f"world/{side}/truth", "Ellipses2D:centers", 2)
        middle = np.array([159.5 - shift_px, 119.5])
        expected = middle + np.array([[20.0, 0.0], [-90.0, 0.0]])
        assert np.asarray(discs) == pytest.approx(expected, abs=1e-4)


def test_the_beam_ends_where_it_was_reflected_and_is_faint_without_an_answer(
    drawn: tuple[Path, Recording],
) -> None:
    recording = drawn[1]
    hit = recording.at("world/beam", "LineStrips3D:strips", 0)
    np.testing.assert_allclose(hit, [[[0, 0.05, 0], [0, 0.05, 0.36]]], rtol=1e-6)
    assert recording.at("world/beam", "LineStrips3D:labels", 0) == ["0.360 m"]
    assert recording.at("world/beam", "LineStrips3D:labels", 1) == ["no reading"]
    assert recording.at("world/beam", "LineStrips3D:strips", 2) == []


def test_the_cameras_stand_where_the_rig_has_them(drawn: tuple[Path, Recording]) -> None:
    columns = drawn[1].columns
    assert columns["world/right"]["Transform3D:translation"][0] == [pytest.approx([0.06, 0, 0])]
    focal_px = columns["world/left"]["Pinhole:image_from_camera"][0][0][0]
    assert focal_px == pytest.approx(400.0)


def pair_and_trace(session: Path) -> tuple[Session, list[tuple[StereoPair, Trace]]]:
    opened = Session(session)
    parallel = rectify(opened.rig)
    return opened, [
        (pair, TINY(decode(pair.left), decode(pair.right), parallel)) for pair in opened.pairs()
    ]


def test_a_frame_without_truth_does_not_show_that_of_the_frame_before(tmp_path: Path) -> None:
    session, ((known, first), (unknown, second)) = pair_and_trace(
        stereo_session(tmp_path / "row.mcap", [[apple(1, seen=1.0)], []], rig=tiny_rig())
    )
    unknown = StereoPair(1, unknown.left, unknown.right, truth=None)
    with RrdWriter(
        tmp_path / "trace.rrd", "id", session.rig, rectify(session.rig), first_ns=0, name="row"
    ) as drawing:
        drawing.write(known, first, FrameCounts(), 0)
        drawing.write(unknown, second, FrameCounts(), 0)
    session.close()
    recording = Recording(tmp_path / "trace.rrd")
    for entity, column in (
        ("world/truth", "Ellipsoids3D:centers"),
        ("world/left/truth", "Ellipses2D:centers"),
        ("world/right/truth", "Ellipses2D:centers"),
    ):
        assert len(recording.at(entity, column, 0)) == 1
        assert recording.at(entity, column, 1) == []


def test_truth_without_apples_or_labels_is_drawn_as_nothing(tmp_path: Path) -> None:
    session, ((pair, trace),) = pair_and_trace(
        stereo_session(tmp_path / "row.mcap", [[]], rig=tiny_rig())
    )
    pair = StereoPair(0, pair.left, pair.right, truth=FrameTruth())
    with RrdWriter(
        tmp_path / "trace.rrd", "id", session.rig, rectify(session.rig), first_ns=0, name="row"
    ) as drawing:
        drawing.write(pair, trace, FrameCounts(), 0)
    session.close()
    recording = Recording(tmp_path / "trace.rrd")
    assert recording.at("world/left/truth", "Ellipses2D:centers", 0) == []


def test_a_distorted_rigs_pictures_are_resampled_and_not_there_twice(tmp_path: Path) -> None:
    session = stereo_session(
        tmp_path / "row.mcap", [[apple(1)]], rig=distorted_rig(), encoding="jpeg"
    )
    (done,) = replay([session], tmp_path, Locator())
    assert isinstance(done, Replayed)
    recording = Recording(done.out / "trace.rrd")
    with Session(session) as opened:
        (pair,) = opened.pairs()
        expected = rectify(opened.rig).left.picture(decode(pair.left))
    shown = cv2.imdecode(
        np.frombuffer(recording.blob("world/left/picture", 0), np.uint8), cv2.IMREAD_COLOR
    )
    assert shown is not None
    assert np.abs(shown.astype(int) - expected).mean() < 3  # JPEG's own loss
    assert not any(entity.startswith("recorded") for entity in recording.columns)


def test_a_distorted_session_alone_shows_the_recorded_bytes_too(tmp_path: Path) -> None:
    session = stereo_session(
        tmp_path / "row.mcap", [[apple(1)]], rig=distorted_rig(), encoding="jpeg"
    )
    draw_session_file(session, tmp_path / "row.rrd")
    recording = Recording(tmp_path / "row.rrd")
    with Session(session) as opened:
        (pair,) = opened.pairs()
    assert recording.blob("recorded/left", 0) == pair.left.data
    assert recording.blob("recorded/right", 0) == pair.right.data
    assert recording.blob("world/left/picture", 0) != pair.left.data


def distorted_rig() -> Rig:
    plain = small_rig()
    lens = Camera(plain.left.size_px, plain.left.matrix, np.array([-0.2, 0.05, 0.0, 0.0, 0.0]))
    return Rig(lens, lens, plain.rotation, plain.translation_m)


def test_a_recording_costs_at_most_1_3_times_the_recorded_pictures(tmp_path: Path) -> None:
    demo = Path(__file__).parent.parent / "sessions" / "demo.mcap"
    with Session(demo) as session:
        parallel, recorded = rectify(session.rig), 0
        out = tmp_path / "trace.rrd"
        with RrdWriter(out, "id", session.rig, parallel, first_ns=0, name="demo") as drawing:
            for pair in session.pairs(0, 3):
                recorded += len(pair.left.data) + len(pair.right.data)
                trace = Locator()(decode(pair.left), decode(pair.right), parallel, (0, pair.index))
                drawing.write(pair, trace, count_frame(trace, pair.truth, parallel), 0)
    assert out.stat().st_size <= 1.3 * recorded


@pytest.fixture
def in_slices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The recording of ten tiny pairs that were replayed in slices of three."""
    monkeypatch.setattr(module, "SLICE_PAIRS", 3)
    frames = [[apple(1, 0.005 * i, seen=1.0)] for i in range(10)]
    session = stereo_session(tmp_path / "row.mcap", frames, rig=tiny_rig())
    (done,) = replay([session], tmp_path, TINY)
    assert isinstance(done, Replayed), done
    return tmp_path / "row" / "trace.rrd"


def test_slices_are_joined_in_the_order_of_the_frames(in_slices: Path) -> None:
    recording = Recording(in_slices)
    for entity, frames in recording.frames.items():
        assert sorted(frames) == list(range(10)), entity
    (entry,) = RrdReader(in_slices).recordings()  # one recording, not one a slice
    assert entry.application_id == "pomolog"
    assert entry.recording_id.startswith("row-")


def test_joined_slices_pass_reruns_own_verification(in_slices: Path) -> None:
    done = rerun("verify", in_slices)
    assert done.returncode == 0, done.stderr
    # and that is no empty promise: without its footer the file would not pass
    in_slices.write_bytes(in_slices.read_bytes()[:-100])
    assert rerun("verify", in_slices).returncode != 0


def test_joined_slices_say_what_one_slice_says(
    in_slices: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SLICE_PAIRS", 32)
    (done,) = replay(
        [in_slices.parent.parent / "row.mcap"], in_slices.parent.parent / "whole", TINY
    )
    assert isinstance(done, Replayed)
    joined, whole = Recording(in_slices), Recording(done.out / "trace.rrd")
    assert joined.columns.keys() == whole.columns.keys()
    for entity, frames in whole.frames.items():
        if entity == "time_ms":
            continue  # no two runs take equally long
        for column, rows in whole.columns[entity].items():
            if len(rows) != len(frames):
                continue  # static
            for frame in frames:
                assert joined.at(entity, column, frame) == whole.at(entity, column, frame)


def test_what_cannot_be_joined_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "no.rrd").write_bytes(b"not a recording")
    with pytest.raises(PomologError, match="cannot join the recordings"):
        join_recordings([tmp_path / "no.rrd"], tmp_path / "out.rrd")
