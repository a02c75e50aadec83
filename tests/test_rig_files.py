"""Every format of a rig: what is written is read back number by number, and mistakes are told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recorder.equipment import load_equipment
from recorder.errors import PomologError
from recorder.rig import Camera, LensModel, Rig, load_rig, parallel_rig
from recorder.rig_files import Format, as_format, format_of, write_rig
from tests.builders import DISTORTIONS, RIG_TOML, rangefinder, real_rig, rig_file, rotation_of

RAW_OPENCV = "%YAML:1.0\n---\n"

# Kalibr's own example of a chain, with a third number format: integers among floats
KALIBR = """
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.9999, 0.0, 0.01414178, -0.110073]
  - [0.0, 1.0, 0.0, 0.0004]
  - [-0.01414178, 0.0, 0.9999, -0.0008]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05]
  distortion_model: radtan
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""

# as camera_calibration writes it, five decimals and all
ROS_LEFT = """image_width: 640
image_height: 480
camera_name: narrow_stereo/left
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0, 320.25, 0, 501.5, 240.75, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.1, 0.01, 0.001, -0.002, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [0.99875, 0.0, 0.04998, 0.0, 1.0, 0.0, -0.04998, 0.0, 0.99875]
projection_matrix:
  rows: 3
  cols: 4
  data: [480, 0, 300, 0, 0, 480, 240, 0, 0, 0, 1, 0]
"""
ROS_RIGHT = (
    ROS_LEFT.replace("left", "right")
    .replace("0.04998", "0.0", 2)
    .replace("-0.0,", "0.0,")
    .replace("0.99875", "1.0")
    .replace("240, 0, 0, 0, 1", "240, 0, 0, 0, 1")
    .replace("[480, 0, 300, 0,", "[480, 0, 300, -96,")
)

# `ros2 topic echo --once /left/camera_info`
ECHO = """header:
  stamp: {sec: 1, nanosec: 2}
  frame_id: left
height: 480
width: 640
distortion_model: plumb_bob
d: [0.1, 0.2, 0.003, 0.004, 0.5]
k: [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0]
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [500.0, 0.0, 320.0, SHIFT, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
---
"""


def odd_rigs() -> dict[str, Rig]:
    """Rigs of every lens, turned, shifted, with unequal cameras, and with a beam."""
    rigs: dict[str, Rig] = {
        "paper's": parallel_rig(),
        "paper's with a beam": parallel_rig(rangefinder=rangefinder()),
        "plumb_bob": real_rig(beam=True),
        "rational": real_rig("rational_polynomial"),
        "fisheye": real_rig("kannala_brandt", beam=True),
    }
    real = rigs["plumb_bob"]
    short = np.array(DISTORTIONS["plumb_bob"][:4])
    rigs["four numbers"] = replace(
        real, left=replace(real.left, distortion=short), right=replace(real.right, distortion=short)
    )
    rigs["turned by thirds"] = replace(
        real, rotation=rotation_of((0.1 / 3, -0.2 / 3, 0.5 / 3)), rangefinder=None
    )
    tiny = np.array([1e-17, -3e-300, 1 / 3, 2e-7, 0.1])
    rigs["tiny numbers"] = replace(real, left=replace(real.left, distortion=tiny))
    unequal = real.right.matrix.copy()
    unequal[0, 2] += 1 / 7
    rigs["unequal centres"] = replace(real, right=replace(real.right, matrix=unequal))
    prism = np.linspace(-0.01, 0.01, 12)
    rational = rigs["rational"]
    rigs["thin prism"] = replace(rational, left=replace(rational.left, distortion=prism))
    return rigs


RIGS = odd_rigs()


def assert_same(found: Rig, wanted: Rig, atol: float) -> None:
    """Every number of two rigs, value by value; absent numbers of a lens are zeros."""
    for side in ("left", "right"):
        one, other = found.camera(side), wanted.camera(side)
        assert one.size_px == other.size_px
        assert one.lens == other.lens
        np.testing.assert_array_equal(one.matrix, other.matrix)
        count = max(len(one.distortion), len(other.distortion))
        mine, theirs = (np.pad(d, (0, count - len(d))) for d in (one.distortion, other.distortion))
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_allclose(found.rotation, wanted.rotation, rtol=0, atol=atol)
    np.testing.assert_allclose(found.translation_m, wanted.translation_m, rtol=0, atol=atol)
    assert (found.rangefinder is None) == (wanted.rangefinder is None)
    if found.rangefinder is not None and wanted.rangefinder is not None:
        np.testing.assert_array_equal(found.rangefinder.origin_m, wanted.rangefinder.origin_m)
        # a direction is made one unit long again when it is read
        np.testing.assert_allclose(
            found.rangefinder.direction, wanted.rangefinder.direction, rtol=0, atol=1e-15
        )
        assert found.rangefinder.std_m == wanted.rangefinder.std_m


# ROS keeps the step only within its rectification: a product of three rotations in doubles
FORMATS: dict[Format, tuple[str, float]] = {
    "pomolog": ("rig.toml", 0.0),
    "opencv": ("rig.yaml", 0.0),
    "ros": ("pair", 1e-14),
    "kalibr": ("camchain.yaml", 0.0),
}
KALIBR_LACKS = {"plumb_bob", "rational", "tiny numbers", "unequal centres", "thin prism",
                "turned by thirds"}  # fmt: skip


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("to", FORMATS)
def test_a_rig_comes_back_from_its_file_number_by_number(
    tmp_path: Path, to: Format, name: str
) -> None:
    file, atol = FORMATS[to]
    path = tmp_path / file
    if to == "kalibr" and name in KALIBR_LACKS:
        with pytest.raises(PomologError, match="radtan has k1, k2, p1 and p2 alone"):
            write_rig(RIGS[name], path)
        assert not list(tmp_path.iterdir())
        return
    written = write_rig(RIGS[name], path)
    assert all(one.is_file() for one in written)
    assert len(written) == (2 if to == "ros" else 1)
    assert_same(load_rig(path), RIGS[name], atol)


@pytest.mark.parametrize("lens", ["plumb_bob", "kannala_brandt"])
def test_a_rig_survives_all_formats_in_a_row(tmp_path: Path, lens: LensModel) -> None:
    real = real_rig(lens, beam=True)
    four = [replace(c, distortion=c.distortion[:4]) for c in (real.left, real.right)]
    wanted = replace(real, left=four[0], right=four[1])
    found = wanted
    for turn in range(3):
        for to, (file, _) in FORMATS.items():
            path = tmp_path / f"{turn}" / file
            write_rig(found, path, to)
            found = load_rig(path)
    assert_same(found, wanted, 1e-13)  # three times ROS


def test_an_existing_rig_toml_keeps_its_equipment(tmp_path: Path) -> None:
    equipment = """[cameras.left] # the one with the scratch
driver = "aravis"
device = "one"
region_px = [0, 0,
  64, 48]

[cameras.right]
driver = "aravis"
device = "two"

[capture]
max_skew_ms = 3.0
"""
    path = rig_file(tmp_path, RIG_TOML + "\n" + equipment)
    before = load_equipment(path)
    write_rig(real_rig(beam=True), path)
    assert load_equipment(path) == before
    assert "the one with the scratch" in path.read_text()
    assert_same(load_rig(path), real_rig(beam=True), 0.0)
    write_rig(real_rig(), path)  # and again
    assert load_equipment(path) == before


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    path = rig_file(tmp_path, KALIBR, "camchain.yaml")
    with pytest.raises(PomologError, match="rational_polynomial"):
        write_rig(real_rig("rational_polynomial"), path)
    assert path.read_text() == KALIBR
    assert [p.name for p in tmp_path.iterdir()] == ["camchain.yaml"]


# others' files


def test_a_kalibr_chain_is_read(tmp_path: Path) -> None:
    found = load_rig(rig_file(tmp_path, KALIBR, "calib.yaml"))
    assert found.left.size_px == (752, 480)
    assert found.left.matrix.tolist() == [[458.654, 0, 367.215], [0, 457.296, 248], [0, 0, 1]]
    assert found.right.distortion.tolist() == [-0.28368365, 0.07451284, -0.00010473, -3.555907e-05]
    assert found.translation_m.tolist() == [-0.110073, 0.0004, -0.0008]
    assert found.rotation[0, 2] == 0.01414178
    fisheye = load_rig(rig_file(tmp_path, KALIBR.replace("radtan", "equidistant"), "fish.yaml"))
    assert fisheye.left.lens == "kannala_brandt"


@pytest.mark.parametrize("words", ["left.yaml", "right.yaml", "left.yaml,right.yaml", "."])
def test_a_ros_pair_is_read_by_any_of_its_names(tmp_path: Path, words: str) -> None:
    rig_file(tmp_path, ROS_LEFT, "left.yaml")
    rig_file(tmp_path, ROS_RIGHT, "right.yaml")
    left, comma, right = words.partition(",")
    path = Path(f"{tmp_path / left},{tmp_path / right}") if comma else tmp_path / words
    found = load_rig(path)
    assert found.left.matrix.tolist() == [[500.5, 0, 320.25], [0, 501.5, 240.75], [0, 0, 1]]
    assert found.left.distortion.tolist() == [-0.1, 0.01, 0.001, -0.002, 0]
    assert found.baseline_m == pytest.approx(0.2, rel=1e-12)
    # rectified = R1 left, right = rectified: a turn of 0.05 about y, to five decimals
    np.testing.assert_allclose(found.rotation, rotation_of((0, 0.05, 0)), atol=1e-5)
    np.testing.assert_allclose(found.translation_m, (-0.2, 0, 0), atol=1e-12)


def test_what_ros2_topic_echo_prints_is_read(tmp_path: Path) -> None:
    rig_file(tmp_path, ECHO.replace("SHIFT", "0.0"), "my_left_info.yaml")
    rig_file(tmp_path, ECHO.replace("SHIFT", "-60.0"), "my_right_info.yaml")
    found = load_rig(tmp_path / "my_left_info.yaml")
    assert found.translation_m.tolist() == [-0.12, 0, 0]
    assert found.right.distortion.tolist() == [0.1, 0.2, 0.003, 0.004, 0.5]


def test_the_numbers_of_a_ros_pair_are_ros_own(tmp_path: Path) -> None:
    import yaml

    rig = real_rig("kannala_brandt")
    left, right = write_rig(rig, tmp_path / "pair")
    contents = [yaml.safe_load(path.read_text()) for path in (left, right)]
    assert [c["distortion_model"] for c in contents] == ["equidistant"] * 2
    turns = [np.reshape(c["rectification_matrix"]["data"], (3, 3)) for c in contents]
    shift = contents[1]["projection_matrix"]["data"]
    # the definition in sensor_msgs/CameraInfo: rectified = R camera, P[3] = -fx' B
    assert shift[3] == pytest.approx(-shift[0] * rig.baseline_m, rel=1e-12)
    point = np.array([0.1, -0.2, 1.5])
    seen = rig.rotation @ point + rig.translation_m
    np.testing.assert_allclose(
        turns[1] @ seen, turns[0] @ point - [rig.baseline_m, 0, 0], atol=1e-12
    )


def test_opencv_reads_what_is_written_for_it(tmp_path: Path) -> None:
    import cv2

    rig = real_rig("rational_polynomial")
    write_rig(rig, tmp_path / "rig.yaml")
    storage = cv2.FileStorage(str(tmp_path / "rig.yaml"), cv2.FILE_STORAGE_READ)
    assert np.array_equal(storage.getNode("M2").mat(), rig.right.matrix)
    assert np.array_equal(storage.getNode("D1").mat().ravel(), rig.left.distortion)
    projected = storage.getNode("Q").mat() @ [100.0, 80.0, 12.0, 1.0]
    left, right = (storage.getNode(key).mat() for key in ("P1", "P2"))
    assert left[0, 2] == right[0, 2]
    assert projected[2] / projected[3] == pytest.approx(left[0, 0] * rig.baseline_m / 12.0)


# mistakes


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (KALIBR.replace("cam1:", "cam2:"), "cam0 (left) and cam1 (right)"),
        (KALIBR + "cam2: {}\n", "cam0, cam1, cam2"),
        (KALIBR.replace("pinhole", "omni", 1), "camera_model is omni"),
        (KALIBR.replace("radtan", "fov", 1), "distortion_model is fov"),
        (KALIBR.replace("T_cn_cnm1", "T_cam_imu"), "no cam1.T_cn_cnm1"),
        (KALIBR.replace("-0.110073", "-110.073"), "must be in metres"),
        (KALIBR.replace("-0.110073", "0.110073"), "swapped"),
        (KALIBR.replace("-0.110073", ".nan"), "not finite"),
        (KALIBR.replace("[752, 480]", "[752]", 1), "resolution has 1 numbers"),
        (KALIBR.replace("458.654", "wide"), "not a list of numbers"),
        (KALIBR.replace("cam0:", "cam0: 5\ncamX:"), "cam0"),
        ("a: 1\n", "neither a Kalibr camchain"),
        ("[1, 2]\n", "not an OpenCV YAML"),
        ("a: &a [*a]\n", ""),
        (ROS_LEFT, "name both with a comma"),
    ],
)
def test_a_mistake_in_a_yaml_is_told_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = rig_file(tmp_path, text, "calib.yaml")
    with pytest.raises(PomologError) as caught:
        load_rig(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("-96", "0", "no baseline"),
        ("-96", "96", "swapped"),
        ("-96", "-96000", "must be in metres"),
        ("plumb_bob", "fov", "distortion_model is fov"),
        ("cols: 5\n  data: [-0.1,", "cols: 5\n  data: [-0.1, 1, 1,", "7 distortion coefficients"),
        ("projection_matrix", "projection", "no ROS camera_info"),
        ("data: [1.0, 0.0", "data: [2.0, 0.0", "no rotation"),
        ("image_width: 640", "image_width: 640.5", "no whole number"),
        ("data: [500.5, 0,", "data: [500.5, 3,", "skew"),
    ],
)
def test_a_mistake_in_a_ros_pair_is_told(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in ROS_RIGHT
    rig_file(tmp_path, ROS_LEFT, "left.yaml")
    rig_file(tmp_path, ROS_RIGHT.replace(old, new), "right.yaml")
    with pytest.raises(PomologError, match=words):
        load_rig(tmp_path / "left.yaml")


def test_exchanged_ros_files_are_told(tmp_path: Path) -> None:
    rig_file(tmp_path, ROS_RIGHT, "left.yaml")
    rig_file(tmp_path, ROS_LEFT, "right.yaml")
    with pytest.raises(PomologError, match="are they exchanged"):
        load_rig(tmp_path)


def test_a_ros_file_alone_is_told(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match=r"no right\.yaml beside it"):
        load_rig(rig_file(tmp_path, ROS_LEFT, "left.yaml"))
    with pytest.raises(PomologError, match="one left and one right"):
        load_rig(tmp_path)


def test_views_of_different_size_have_no_opencv_file(tmp_path: Path) -> None:
    real = real_rig()
    rig = replace(real, left=Camera((320, 240), real.left.matrix))
    with pytest.raises(PomologError, match="one size"):
        write_rig(rig, tmp_path / "rig.yaml")
    write_rig(rig, tmp_path / "rig.toml")
    assert load_rig(tmp_path / "rig.toml").left.size_px == (320, 240)


@pytest.mark.parametrize(
    ("name", "to"),
    [
        ("rig.toml", "pomolog"), ("rig.yaml", "opencv"), ("rig.yml", "opencv"), ("pair", "ros"),
        ("cam_left.yaml", "ros"), ("camchain-day1.yaml", "kalibr"), ("a.yaml,b.yaml", "ros"),
    ],
)  # fmt: skip
def test_the_name_says_the_format(tmp_path: Path, name: str, to: Format) -> None:
    assert format_of(tmp_path / name) == to


def test_a_name_that_says_nothing_is_told(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match="--to"):
        format_of(tmp_path / "rig.xml")
    with pytest.raises(PomologError, match="pomolog, opencv, ros, kalibr"):
        as_format("matlab")


def test_a_ros_pair_is_named_after_one_of_its_files(tmp_path: Path) -> None:
    written = write_rig(real_rig(), tmp_path / "cam_right_7.yaml")
    assert [path.name for path in written] == ["cam_left_7.yaml", "cam_right_7.yaml"]
    assert_same(load_rig(tmp_path / "cam_left_7.yaml"), real_rig(), 1e-14)
