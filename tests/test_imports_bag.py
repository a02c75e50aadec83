import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores
from typer.testing import CliRunner

from recorder.errors import PomologError
from recorder.imports.bag import Bag
from recorder.imports.bag_roles import Roles, assign_roles
from recorder.imports.bag_session import Imported, import_bag
from recorder.imports.cli import app
from recorder.pictures import decode
from recorder.rig import parallel_rig
from recorder.session import Session
from recorder.session_writer import SessionWriter
from tests.bags import FORWARD, START_NS, Ros, foxglove_bag, small_picture, stereo_bag
from tests.builders import DATA, SECOND_NS, encoded, session_file
from tests.mcap_files import changed, record
from tests.real_parts import missing

MS = 1_000_000


def imported(source: Path, out: Path, **how: Any) -> Imported:
    bag = Bag(source)
    return import_bag(bag, assign_roles(bag, how.pop("topics", {})), out, **how)


def refusal(source: Path, **how: Any) -> str:
    out = source.parent / "refused.mcap"
    with pytest.raises(PomologError) as caught:
        imported(source, out, **how)
    assert not list(out.parent.glob("refused.mcap*"))
    line = str(caught.value)
    assert "\n" not in line
    return line


# pictures, value by value


def as_raw(encoding: str, bgr: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """What a driver publishes of a picture."""
    codes = {
        "rgb8": cv2.COLOR_BGR2RGB, "rgba8": cv2.COLOR_BGR2RGBA, "bgra8": cv2.COLOR_BGR2BGRA,
        "mono8": cv2.COLOR_BGR2GRAY,
    }  # fmt: skip
    if encoding.startswith("bayer"):
        return bgr[..., 0]
    made = cv2.cvtColor(bgr, codes[encoding]) if encoding in codes else bgr
    return np.asarray(made, np.uint8)


def expected(encoding: str, sent: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
    """The picture that pomolog must show of it."""
    back = {
        "rgb8": cv2.COLOR_RGB2BGR, "rgba8": cv2.COLOR_RGBA2BGR, "bgra8": cv2.COLOR_BGRA2BGR,
        "mono8": cv2.COLOR_GRAY2BGR, "bayer_rggb8": cv2.COLOR_BayerRGGB2BGR,
        "bayer_bggr8": cv2.COLOR_BayerBGGR2BGR, "bayer_gbrg8": cv2.COLOR_BayerGBRG2BGR,
        "bayer_grbg8": cv2.COLOR_BayerGRBG2BGR,
    }  # fmt: skip
    return sent if encoding == "bgr8" else cv2.cvtColor(sent, back[encoding])


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    "encoding",
    ["rgb8", "bgr8", "rgba8", "bgra8", "mono8",
     "bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"],
)  # fmt: skip
def test_every_encoding_arrives_pixel_by_pixel(tmp_path: Path, encoding: str, padding: int) -> None:
    sent = [as_raw(encoding, small_picture(n)) for n in (0, 1)]
    ros = stereo_bag(tmp_path, 0)
    for side, pixels in zip(("left", "right"), sent, strict=True):
        topic = f"/stereo/{side}/image_raw"
        ros.image(topic, START_NS, pixels, encoding, frame_id=f"{side}_optical", padding=padding)
    imported(ros.write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        (pair,) = session.pairs()
    for frame, pixels in zip((pair.left, pair.right), sent, strict=True):
        assert np.array_equal(decode(frame), expected(encoding, pixels))


def test_bayer_keeps_its_colours(tmp_path: Path) -> None:
    # a red plane in each of the four mosaics; a swapped pattern would be blue or green
    for encoding, red in (
        ("bayer_rggb8", (0, 0)), ("bayer_bggr8", (1, 1)),
        ("bayer_gbrg8", (1, 0)), ("bayer_grbg8", (0, 1)),
    ):  # fmt: skip
        mosaic = np.zeros((48, 64), np.uint8)
        mosaic[red[0] :: 2, red[1] :: 2] = 200
        folder = tmp_path / encoding
        folder.mkdir()
        ros = stereo_bag(folder, 1, encoding=encoding, pixels=(mosaic, mosaic))
        imported(ros.write(), folder / "s.mcap")
        with Session(folder / "s.mcap") as session:
            (pair,) = session.pairs()
        assert decode(pair.left)[20, 20].tolist() == [0, 0, 200]


@pytest.mark.parametrize("kind", ["jpeg", "png"])
def test_compressed_pictures_stay_byte_for_byte(tmp_path: Path, kind: Any) -> None:
    ros = stereo_bag(tmp_path, 0)
    sent = {side: encoded(kind, n) for n, side in enumerate(("left", "right"))}
    for side, data in sent.items():
        topic = f"/stereo/{side}/image_raw/compressed"
        ros.compressed(topic, START_NS, data, f"rgb8; {kind} compressed bgr8", f"{side}_optical")
    imported(ros.write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        (pair,) = session.pairs()
    assert (pair.left.data, pair.right.data) == (sent["left"], sent["right"])


# times, readings, the rig


def test_header_times_pair_the_views_not_the_arrival(tmp_path: Path) -> None:
    ros = stereo_bag(tmp_path, 0)
    for index in range(3):
        for side, late_ns in (("left", 3 * MS), ("right", 40 * MS)):
            ros.image(
                f"/stereo/{side}/image_raw", START_NS + index * SECOND_NS, small_picture(index),
                "bgr8", frame_id=f"{side}_optical", late_ns=late_ns,
            )  # fmt: skip
    folder = ros.write()
    done = imported(folder, tmp_path / "s.mcap")
    assert (done.pairs, done.times, done.nearest_ns) == (3, "header", 0)
    with Session(tmp_path / "s.mcap") as session:
        assert session.times_ns("left").tolist() == [START_NS + i * SECOND_NS for i in range(3)]
    done = imported(folder, tmp_path / "a.mcap", times="arrival")
    assert (done.pairs, done.nearest_ns) == (0, 37 * MS)


def test_headers_without_times_mean_times_of_arrival_and_that_is_said(tmp_path: Path) -> None:
    ros = stereo_bag(tmp_path, 2)
    ros.image("/stereo/left/image_raw", 0, small_picture(0), "rgb8", late_ns=START_NS - MS)
    done = imported(ros.write(), tmp_path / "s.mcap")
    assert done.times == "arrival"
    assert "/stereo/left/image_raw has none in its headers" in done.remarks[0]


@pytest.mark.parametrize(("apart_s", "times"), [(9, "header"), (11, "arrival")])
def test_headers_of_two_clocks_mean_times_of_arrival_and_that_is_said(
    tmp_path: Path, apart_s: int, times: str
) -> None:
    ros = stereo_bag(tmp_path, 2)
    ahead_ns = apart_s * SECOND_NS
    picture, late_ns = small_picture(0), -ahead_ns - MS
    ros.image("/stereo/left/image_raw", START_NS + ahead_ns, picture, "rgb8", late_ns=late_ns)
    done = imported(ros.write(), tmp_path / "s.mcap")
    assert done.times == times
    said = f"times of arrival: the headers' clocks are {apart_s} s apart"
    assert (said in done.remarks) == (times == "arrival")


def test_an_offset_shifts_a_stream_and_a_tolerance_stays_with_the_session(tmp_path: Path) -> None:
    folder = stereo_bag(tmp_path, 4, skew_ns=18 * MS).write()
    lone = imported(folder, tmp_path / "lone.mcap")
    assert lone.pairs == 0
    (line,) = lone.advice()
    assert "the nearest is usually 18.0 ms later" in line
    assert "--offset right=-18.0ms" in line
    assert "--tolerance 27ms" in line
    shifted = imported(folder, tmp_path / "shifted.mcap", offsets_ns={"right": -18 * MS})
    assert (shifted.pairs, list(shifted.advice())) == (4, [])
    loose = imported(folder, tmp_path / "loose.mcap", tolerance_ns=27 * MS)
    assert (loose.pairs, loose.tolerance_ns) == (4, 27 * MS)
    strict = imported(folder, tmp_path / "strict.mcap", tolerance_ns=0)
    assert (strict.pairs, strict.tolerance_ns) == (0, 0)
    for name, skew_ns in (("shifted", 0), ("loose", 18 * MS)):
        with Session(tmp_path / f"{name}.mcap") as session:
            assert np.diff(session.pair_times_ns()).ravel().tolist() == [skew_ns] * 4


def test_a_stream_of_another_clock_is_merged_where_its_offset_puts_it(tmp_path: Path) -> None:
    ros = stereo_bag(tmp_path, 3)
    hour_ns = 3600 * SECOND_NS
    for index in range(3):
        ros.range("/other", START_NS + index * SECOND_NS + hour_ns, 2.0 + index)
    topics = {"range": "/other"}
    imported(ros.write(), tmp_path / "s.mcap", topics=topics, offsets_ns={"range": -hour_ns})
    with Session(tmp_path / "s.mcap") as session:
        session.verify()
        assert [[r.range_m for r in pair.readings] for pair in session.pairs()] == [[2], [3], [4]]


@pytest.mark.parametrize("store", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
def test_ranges_of_either_release_are_readings(tmp_path: Path, store: Stores) -> None:
    more = () if store is Stores.ROS2_HUMBLE else (0.25,)  # the newer one has a variance
    ros = Ros(tmp_path, store=store)
    ros.info("/left/camera_info", START_NS)
    ros.image("/left/image", START_NS, small_picture(0), "bgr8")
    for index, value in enumerate((1.25, -math.inf, math.inf, math.nan, 0.1, 31.0)):
        ros.range("/laser", START_NS + index, value, "laser", *more)
    imported(ros.write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        readings = list(session.readings())
    assert [r.range_m for r in readings] == [1.25, None, None, None, None, None]
    assert [r.status for r in readings] == [
        "ok", "too near", "nothing met", "invalid", "too near", "nothing met",
    ]  # fmt: skip
    assert float(readings[4].raw) == pytest.approx(0.1, abs=1e-8)  # float32


def test_the_beam_lies_where_the_transforms_put_it(tmp_path: Path) -> None:
    imported(stereo_bag(tmp_path).write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        beam = session.rig.rangefinder
        assert beam is not None
        assert np.allclose(beam.origin_m, [0.1, 0.05, -0.02])
        assert np.allclose(beam.direction, [0, 0, 1], atol=1e-12)  # x of its frame looks ahead
        assert session.rig.baseline_m == pytest.approx(0.2)
        assert len(list(session.readings())) == 3


def test_a_scan_of_one_beam_is_a_rangefinder_and_one_of_many_is_not(tmp_path: Path) -> None:
    ros = stereo_bag(tmp_path, 2)
    ros.scan("/lidar", START_NS, [1.0, 2.0, 3.0])
    folder = ros.write()
    assert assign_roles(Bag(folder), {}).range == "/laser"
    assert "3 beams" in refusal(folder, topics={"range": "/lidar"})
    one = Ros(tmp_path, "one")
    one.info("/left/camera_info", START_NS)
    one.image("/left/image", START_NS, small_picture(0), "bgr8")
    one.tf_static(START_NS, ("left_optical", "laser", (0, 0, 0, *FORWARD)))
    one.scan("/lidar", START_NS, [1.5], angle=math.pi / 2)
    imported(one.write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        (reading,) = session.readings()
        assert reading.range_m == 1.5
        beam = session.rig.rangefinder
        assert beam is not None
        assert np.allclose(beam.direction, [-1, 0, 0], atol=1e-7)  # y of its frame is left


def test_cameras_without_a_projection_take_their_places_from_the_transforms(tmp_path: Path) -> None:
    ros = stereo_bag(tmp_path, 1, baseline_m=0.0)
    ros.tf_static(
        START_NS,
        ("mast", "left_optical", (0.3, 0.1, 1.0, 0, 0, 0, 1)),
        ("mast", "right_optical", (0.375, 0.1, 1.0, 0, 0, 0, 1)),
    )
    imported(ros.write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        assert np.allclose(session.rig.translation_m, [-0.075, 0, 0])


@pytest.mark.parametrize(
    ("lens", "coefficients", "kept"),
    [
        ("plumb_bob", 5, "plumb_bob"),
        ("rational_polynomial", 8, "rational_polynomial"),
        ("equidistant", 4, "kannala_brandt"),
        ("plumb_bob", 8, "rational_polynomial"),
    ],
)
def test_lenses_keep_their_coefficients(
    tmp_path: Path, lens: str, coefficients: int, kept: str
) -> None:
    known = [0.01 * (i + 1) for i in range(coefficients)]
    ros = Ros(tmp_path)
    for side, shift in (("left", 0.0), ("right", -12.0)):
        ros.info(
            f"/{side}/camera_info", START_NS, shift=shift, lens=lens, distortion=known,
            frame_id=side,
        )  # fmt: skip
        ros.image(f"/{side}/image_raw", START_NS, small_picture(0), "bgr8", frame_id=side)
    imported(ros.write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        for side in ("left", "right"):
            assert session.rig.camera(side).distortion.tolist() == known
            assert session.rig.camera(side).lens == kept


def test_rectified_pictures_take_the_projection_as_their_camera(tmp_path: Path) -> None:
    ros = Ros(tmp_path)
    for side, shift in (("left", 0.0), ("right", -12.0)):
        ros.info(
            f"/{side}/camera_info", START_NS, shift=shift, distortion=[0.1] * 5, frame_id="left"
        )
        ros.image(f"/{side}/image_rect_color", START_NS, small_picture(0), "bgr8", frame_id="left")
    imported(ros.write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        assert session.rig.left.straight
        assert session.rig.baseline_m == pytest.approx(0.2)


# depth, and one view


def rgbd_bag(folder: Path, depth: npt.NDArray[Any], encoding: str, *, big: bool = False) -> Path:
    ros = Ros(folder)
    ros.info("/camera/color/camera_info", START_NS, frame_id="color")
    for index in range(2):
        time_ns = START_NS + index * SECOND_NS
        picture = small_picture(index)
        ros.image("/camera/color/image_raw", time_ns, picture, "rgb8", frame_id="color")
        ros.image(
            "/camera/aligned_depth_to_color/image_raw", time_ns + MS, depth, encoding,
            frame_id="color", padding=6, big_endian=big,
        )  # fmt: skip
        wide = np.zeros((40, 60), np.uint16)
        ros.image("/camera/depth/image_rect_raw", time_ns, wide, "16UC1", frame_id="depth")
    return ros.write()


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(("encoding", "kind"), [("16UC1", "u2"), ("32FC1", "f4")])
def test_an_rgbd_bag_is_one_view_with_depth(
    tmp_path: Path, encoding: str, kind: str, big: bool
) -> None:
    depth = np.random.default_rng(1).integers(1, 4000, (48, 64)).astype(kind)
    depth = depth if kind == "u2" else depth / np.float32(1000)
    depth[:4] = 0
    done = imported(rgbd_bag(tmp_path, depth, encoding, big=big), tmp_path / "s.mcap")
    assert (done.left, done.right, done.depths) == (2, 0, 2)
    with Session(tmp_path / "s.mcap") as session:
        session.verify()
        assert session.one_view
        assert session.info().pairs == 0
        assert session.info().topics["/depth"] == 2
        pairs = list(session.pairs())
    assert len(pairs) == 2
    for pair in pairs:
        assert pair.depth is not None
        assert pair.depth.encoding == encoding
        assert np.array_equal(np.frombuffer(pair.depth.data, f"<{kind}"), depth.ravel())
        metres = pair.depth.metres()
        assert np.isnan(metres[:4]).all()
        assert np.allclose(metres[4:], depth[4:] / (1000 if kind == "u2" else 1))
        assert not decode(pair.right).any()


@pytest.mark.parametrize("kind", ["16UC1", "32FC1"])
def test_packed_depth_is_unpacked(tmp_path: Path, kind: str) -> None:
    # compressed_depth_image_transport: a header, then a PNG
    steps = np.random.default_rng(2).integers(0, 3000, (48, 64), dtype=np.uint16)
    png = cv2.imencode(".png", steps)[1].tobytes()
    first, second = 100.0, -5.0
    header = np.array([0], "<i4").tobytes() + np.array([first, second], "<f4").tobytes()
    ros = Ros(tmp_path)
    ros.info("/camera/color/camera_info", START_NS)
    ros.image("/camera/color/image_raw", START_NS, small_picture(0), "bgr8")
    ros.compressed(
        "/camera/depth/image_raw/compressedDepth", START_NS, header + png,
        f"{kind}; compressedDepth png", "left_optical",
    )  # fmt: skip
    imported(ros.write(), tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        (depth,) = session.depths()
    if kind == "16UC1":
        assert depth.data == steps.tobytes()
    else:
        found = depth.metres()
        assert np.array_equal(np.isnan(found), steps == 0)
        assert np.allclose(found[steps > 0], first / (steps[steps > 0] + 5.0), rtol=1e-6)


def test_depth_in_a_plain_png_is_depth_and_no_picture(tmp_path: Path) -> None:
    steps = np.random.default_rng(2).integers(0, 3000, (48, 64), dtype=np.uint16)
    png = cv2.imencode(".png", steps)[1].tobytes()
    ros = Ros(tmp_path)
    ros.info("/color/camera_info", START_NS)
    ros.image("/color/image_raw", START_NS, small_picture(0), "bgr8")
    ros.compressed("/depth/image/compressed", START_NS, png, "16UC1; png compressed ",
                   "left_optical")  # fmt: skip
    folder = ros.write()
    imported(folder, tmp_path / "s.mcap")
    with Session(tmp_path / "s.mcap") as session:
        (depth,) = session.depths()
    assert depth.data == steps.tobytes()
    assert "holds depth" in refusal(folder, topics={"left": "/depth/image/compressed"})


def test_a_mosaic_packed_as_a_grey_jpeg_is_no_picture(tmp_path: Path) -> None:
    # what compressed_image_transport makes of Bayer: its colours would be lost without a word
    grey = cv2.imencode(".jpg", small_picture(0)[..., 0])[1].tobytes()
    for kind, refused in (
        ("bayer_rggb8; jpeg compressed ", True),
        ("bayer_rggb8; jpeg compressed bgr8", False),
    ):
        ros = Ros(tmp_path, f"bag{refused}")
        ros.info("/left/camera_info", START_NS)
        ros.compressed("/left/image_raw/compressed", START_NS, grey, kind, "left_optical")
        folder = ros.write()
        if refused:
            assert "a Bayer mosaic packed as if it were grey" in refusal(folder)
        else:
            assert imported(folder, tmp_path / "s.mcap").left == 1


def test_depth_that_is_not_aligned_is_not_taken_for_aligned(tmp_path: Path) -> None:
    folder = rgbd_bag(tmp_path, np.ones((40, 60), np.uint16), "16UC1")
    assert assign_roles(Bag(folder), {}).depth is None
    line = refusal(folder, topics={"depth": "/camera/depth/image_rect_raw"})
    assert "60 x 40 px" in line
    assert "aligned to the left camera" in line


# which topic is what


def roles_of(folder: Path, *names: str, **wanted: str) -> Roles:
    ros = Ros(folder, f"roles{len(list(folder.iterdir()))}")
    for name in names:
        grey = "infra" in name
        pixels = small_picture(0)[..., 0] if grey else small_picture(0)
        ros.image(name, START_NS, pixels, "mono8" if grey else "bgr8")
    return assign_roles(Bag(ros.write()), wanted)


def test_pairs_are_guessed_from_their_names(tmp_path: Path) -> None:
    for left, right in (
        ("/stereo/left/image_raw", "/stereo/right/image_raw"),
        ("/zed/zed_node/left/image_rect_color", "/zed/zed_node/right/image_rect_color"),
        ("/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"),
        ("/cam0/image_raw", "/cam1/image_raw"),
        ("/camera_1/image", "/camera_2/image"),
        ("/img_left", "/img_right"),
        ("/leftcam/left_image", "/rightcam/right_image"),
    ):
        found = roles_of(tmp_path, right, left)
        assert (found.left, found.right) == (left, right)


def test_colour_is_guessed_before_grey_and_one_camera_alone_is_one_view(tmp_path: Path) -> None:
    found = roles_of(
        tmp_path, "/infra1/image", "/infra2/image", "/color_left/image", "/color_right/image"
    )
    assert (found.left, found.right) == ("/color_left/image", "/color_right/image")
    found = roles_of(tmp_path, "/front/image")
    assert (found.left, found.right) == ("/front/image", None)


def test_where_no_guess_is_sound_the_flags_are_asked_for(tmp_path: Path) -> None:
    names = ("/north/image", "/south/image")
    with pytest.raises(PomologError, match="say --left TOPIC --right TOPIC"):
        roles_of(tmp_path, *names)
    found = roles_of(tmp_path, *names, left=names[0], right=names[1])
    assert (found.left, found.right) == names
    assert roles_of(tmp_path, *names, left=names[1]).right is None
    with pytest.raises(PomologError, match="no messages of /up"):
        roles_of(tmp_path, *names, left="/up")
    with pytest.raises(PomologError, match="two flags name one topic"):
        roles_of(tmp_path, *names, left=names[0], right=names[0])


# Foxglove


@pytest.mark.parametrize("as_json", [False, True])
def test_foxgloves_recordings_arrive_byte_for_byte(tmp_path: Path, as_json: bool) -> None:
    sent = {
        s: [encoded("jpeg", 2 * i + n) for i in range(3)] for n, s in ((0, "left"), (1, "right"))
    }
    source = foxglove_bag(tmp_path / "f.mcap", sent, as_json=as_json)
    done = imported(source, tmp_path / "s.mcap")
    assert (done.pairs, done.times) == (3, "header")
    with Session(tmp_path / "s.mcap") as session:
        pairs = list(session.pairs())
        assert session.rig.baseline_m == pytest.approx(0.2)
    assert [p.left.data for p in pairs] == sent["left"]
    assert [p.right.data for p in pairs] == sent["right"]
    assert [p.time_ns for p in pairs] == [START_NS + i * SECOND_NS for i in range(3)]


# what cannot be imported


def genuine_bags() -> list[Path]:
    return sorted((DATA / "rosbag2_mcap").rglob("*.mcap"))


def test_every_genuine_bag_without_cameras_is_answered_with_its_topics() -> None:
    bags = genuine_bags()
    if not bags:
        missing("no genuine bags at ../shared/data/rosbag2_mcap")
    assert len(bags) == 20
    for path in bags:
        for source in {path, path.parent}:
            result = CliRunner().invoke(app, ["import", "bag", str(source), "-o", "x.mcap"])
            assert isinstance(result.exception, PomologError), source
            line = str(result.exception)
            assert "no camera topics" in line
            assert all(name in line for name in Bag(source).topics)
    assert not Path("x.mcap").exists()


def test_bad_input_is_one_line_each(tmp_path: Path) -> None:
    ours = session_file(tmp_path, 1)
    assert "a pomolog session already" in refusal(ours)
    (tmp_path / "old.db3").write_bytes(b"SQLite format 3")
    assert "ros2 bag convert" in refusal(tmp_path / "old.db3")
    empty = tmp_path / "folder"
    empty.mkdir()
    assert "no .mcap file" in refusal(empty)
    (empty / "x_0.mcap.zstd").write_bytes(b"\x28\xb5\x2f\xfd")
    assert "zstd -d" in refusal(empty)
    text = tmp_path / "text.mcap"
    text.write_text("hello")
    assert "not an MCAP file" in refusal(text)
    folder = stereo_bag(tmp_path, 2).write()
    (file,) = folder.glob("*.mcap")
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(file.read_bytes()[:-200])
    assert "mcap recover" in refusal(torn)
    assert "right, range or depth" in refusal(folder, offsets_ns={"depth": 5})
    assert "before time 0" in refusal(folder, offsets_ns={"right": -2 * START_NS})
    assert "cannot be read as that" in refusal(folder, topics={"left": "/laser"})


def test_what_a_picture_lacks_is_said(tmp_path: Path) -> None:
    def with_picture(name: str, pixels: npt.NDArray[Any], encoding: str) -> Path:
        ros = Ros(tmp_path, name)
        ros.info("/left/camera_info", START_NS)
        ros.image("/left/image", START_NS, pixels, encoding)
        return ros.write()

    deep = with_picture("deep", np.zeros((48, 64, 3), np.uint16), "rgb16")
    assert "encoding 'rgb16'; known are" in refusal(deep)
    short = with_picture("short", np.zeros((48, 64), np.uint8), "bgr8")
    assert "is it damaged?" in refusal(short)
    other = with_picture("other", small_picture(0)[:40], "bgr8")
    assert "64 x 40 px" in refusal(other)
    video = Ros(tmp_path, "video")
    video.info("/left/camera_info", START_NS)
    video.compressed("/left/image/compressed", START_NS, b"\0\0\1", "h264")
    assert "h264" in refusal(video.write())
    two = Ros(tmp_path, "two")
    for side in ("left", "right"):
        two.image(f"/{side}/image", START_NS, small_picture(0), "bgr8")
    folder = two.write()
    assert "no calibration of the left camera" in refusal(folder)
    rig = parallel_rig(size_px=(64, 48), focal_px=60.0)
    assert imported(folder, tmp_path / "ok.mcap", rig=rig).pairs == 1


def test_a_bag_without_calibration_of_its_only_view_says_that_it_is_nominal(tmp_path: Path) -> None:
    ros = Ros(tmp_path)
    ros.image("/front/image", START_NS, small_picture(0), "bgr8")
    done = imported(ros.write(), tmp_path / "s.mcap")
    assert "nominal" in done.remarks[0]
    with Session(tmp_path / "s.mcap") as session:
        assert session.metadata["calibration"] == "nominal"


# mutations: a damaged bag is one line, or what it was


def attempt(source: Path, out: Path) -> tuple[str, Imported | None]:
    """What is said of a bag, or what became of it; anything but our own error escapes."""
    try:
        return "", imported(source, out)
    except PomologError as error:
        return str(error), None


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_mutated_bag_is_a_line_or_a_session(tmp_path: Path, data: st.DataObject) -> None:
    place = tmp_path / "good"
    if not place.exists():
        place.mkdir()
        stereo_bag(place, 2).write()
    (good,) = (place / "bag").glob("*.mcap")
    whole = bytearray(good.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(8, len(whole) - 9))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.one_of(st.none(), st.integers(8, len(whole))))
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(whole[:cut])
    out = tmp_path / "out.mcap"
    out.unlink(missing_ok=True)
    line, done = attempt(bad, out)
    assert "\n" not in line
    if done is None:
        assert not list(tmp_path.glob("out.mcap*"))
        return
    with Session(out) as session:
        session.verify()
        assert session.times_ns("left").size == done.left


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_mutated_message_is_damage_and_nothing_else(tmp_path: Path, data: st.DataObject) -> None:
    # within a chunk whose CRC was written after the damage: only the decoders stand in the way
    if not (tmp_path / "bag").exists():
        stereo_bag(tmp_path, 1).write()
    bag = Bag(tmp_path / "bag")
    messages = list(bag.messages(tuple(bag.topics)))
    hit = data.draw(st.integers(0, len(messages) - 1))
    with (tmp_path / "bad.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2")
        for number, message in enumerate(messages):
            topic = bag.topics[message.topic]
            schema_id = writer.register_schema(topic.schema, "ros2msg", b"")
            channel = writer.register_channel(topic.name, "cdr", schema_id)
            body = bytearray(message.data)
            if number == hit:
                for _ in range(data.draw(st.integers(1, 3))):
                    place = data.draw(st.integers(0, min(300, len(body)) - 1))
                    body[place] = data.draw(st.integers(0, 255))
                body = body[: data.draw(st.integers(0, len(body)))]
            writer.add_message(channel, message.log_ns, bytes(body), message.log_ns)
        writer.finish()
    (tmp_path / "out.mcap").unlink(missing_ok=True)
    line, done = attempt(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    assert "\n" not in line
    assert (tmp_path / "out.mcap").exists() == (done is not None)


# the command


def test_the_command_shows_its_guess_first(tmp_path: Path) -> None:
    folder = stereo_bag(tmp_path, 2).write()
    out = tmp_path / "s.mcap"
    words = ["import", "bag", str(folder), "-o", str(out), "--lighting", "front"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0] == "--left       /stereo/left/image_raw  (sensor_msgs/Image, 2 messages)"
    assert lines[-1] == (f"{out}: 2 stereo pairs, 2 range readings, at the times of their headers")
    with Session(out) as session:
        assert session.metadata["lighting"] == "front"
    result = CliRunner().invoke(app, [*words, "--json"])
    document = json.loads(result.stdout)
    assert document["pairs"] == 2
    assert document["roles"]["range"] == "/laser"


def test_wrong_words_of_the_command_are_said(tmp_path: Path) -> None:
    folder = str(stereo_bag(tmp_path, 1).write())
    for words, line in (
        (["--tolerance", "5"], "no duration; give a number and its unit: 12ms"),
        (["--offset", "12ms"], "right=-12ms"),
        (["--offset", "left=12ms"], "can be shifted"),
    ):
        result = CliRunner().invoke(app, ["import", "bag", folder, "-o", "x.mcap", *words])
        assert isinstance(result.exception, PomologError)
        assert line in str(result.exception)
    result = CliRunner().invoke(app, ["import", "bag", folder, "-o", "x.mcap", "--times", "now"])
    assert result.exit_code == 2


def test_a_split_bag_is_one_recording(tmp_path: Path) -> None:
    first, second = Ros(tmp_path, "a"), Ros(tmp_path, "b")
    for number, ros in enumerate((first, second)):
        for side, shift in (("left", 0.0), ("right", -12.0)):
            if number == 0:
                ros.info(f"/{side}/camera_info", START_NS, shift=shift, frame_id=side)
            time_ns = START_NS + number * SECOND_NS
            ros.image(f"/{side}/image", time_ns, small_picture(number), "bgr8", frame_id=side)
    both = tmp_path / "both"
    both.mkdir()
    for number, ros in enumerate((second, first)):  # the names are against the order of time
        (file,) = ros.write().glob("*.mcap")
        file.rename(both / f"both_{number}.mcap")
    assert imported(both, tmp_path / "s.mcap").pairs == 2


def test_a_bag_without_chunks_is_read_in_the_order_of_time(tmp_path: Path) -> None:
    # rosbag2's preset `fastwrite`; messages here stand in the wrong order
    bag = Bag(stereo_bag(tmp_path, 3).write())
    with (tmp_path / "loose.mcap").open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("ros2")
        for message in reversed(list(bag.messages(tuple(bag.topics)))):
            topic = bag.topics[message.topic]
            schema_id = writer.register_schema(topic.schema, "ros2msg", b"")
            channel = writer.register_channel(topic.name, "cdr", schema_id)
            writer.add_message(channel, message.log_ns, message.data, message.log_ns)
        writer.finish()
    loose = Bag(tmp_path / "loose.mcap")
    times = [message.log_ns for message in loose.messages(tuple(loose.topics))]
    assert times == sorted(times)
    assert len(times) == sum(topic.count for topic in bag.topics.values())
    assert imported(tmp_path / "loose.mcap", tmp_path / "s.mcap").pairs == 3
    for number, opcode in ((1, b"\x7f"), (4, b"\x7f")):  # a record of no known kind
        at = record(tmp_path / "loose.mcap", Opcode.MESSAGE, number).start
        assert "counted" in refusal(changed(tmp_path / "loose.mcap", at, opcode))


def test_a_writer_refuses_depth_of_another_size(tmp_path: Path) -> None:
    from recorder.records import Depth

    with (
        pytest.raises(PomologError, match="is it aligned"),
        SessionWriter.create(tmp_path / "s.mcap", parallel_rig(size_px=(64, 48))) as writer,
    ):
        writer.write_depth(Depth(0, "16UC1", bytes(8), (2, 2)))
