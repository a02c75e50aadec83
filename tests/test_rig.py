from pathlib import Path

import numpy as np
import pytest

from recorder.errors import PomologError
from recorder.rig import Camera, Rig, load_rig, parallel_rig
from tests.builders import DATA, RIG_TOML, rangefinder, real_rig, rig_file, rotation_of

OPENCV = """%YAML 1.2
---
image_width: 640
image_height: 480
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 320., 0., 501., 240., 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, 0.2, 0.003, 0.004, 0.5 ]
M2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 502., 0., 321., 0., 503., 241., 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 8
   cols: 1
   dt: d
   data: [ 1., 2., 3., 4., 5., 6., 7., 8. ]
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ -0.2, 0.001, 0.002 ]
"""
SHORT_T = "rows: 2\n   cols: 1\n   dt: d\n   data: ["


def refusal(folder: Path, text: str, name: str = "rig.toml") -> str:
    path = rig_file(folder, text, name)
    with pytest.raises(PomologError) as caught:
        load_rig(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ")
    assert len(line.splitlines()) == 1
    return line


# our TOML


def test_a_focal_length_in_millimetres_is_divided_by_the_pixel_pitch(tmp_path: Path) -> None:
    text = RIG_TOML.replace("focal_px = 60.0", "focal_mm = 6\npixel_pitch_um = 5.2")
    found = load_rig(rig_file(tmp_path, text))
    # 6 mm over 5.2 um, in double precision
    assert found.left.matrix[0, 0] == pytest.approx(6000 / 5.2, rel=1e-15)
    assert found.left.matrix[1, 1] == found.left.matrix[0, 0]


def test_everything_that_a_toml_says_is_in_the_rig(tmp_path: Path) -> None:
    found = load_rig(
        rig_file(
            tmp_path,
            """
            [left]
            size_px = [640, 480]
            focal_px = [500.0, 501.0]
            centre_px = [320.0, 241.0]
            distortion = [0.1, 0.2, 0.003, 0.004]
            [right]
            size_px = [640, 480]
            focal_px = 502
            lens = "kannala_brandt"
            distortion = [0.1, 0.2, 0.3, 0.4]
            [stereo]
            translation_m = [-0.2, 0.01, 0.0]
            rotation = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
            [rangefinder]
            origin_m = [0.1, 0.0, 0.0]
            direction = [0.0, 3.0, 4.0]
            std_m = 0.002
            [cameras]  # of another part of pomolog
            driver = "aravis"
            """,
        )
    )
    assert found.left.matrix.tolist() == [[500, 0, 320], [0, 501, 241], [0, 0, 1]]
    assert found.left.distortion.tolist() == [0.1, 0.2, 0.003, 0.004]
    assert found.left.lens == "plumb_bob"
    assert found.right.matrix.tolist() == [[502, 0, 319.5], [0, 502, 239.5], [0, 0, 1]]
    assert found.right.lens == "kannala_brandt"
    assert found.translation_m.tolist() == [-0.2, 0.01, 0.0]
    assert found.rotation.tolist() == [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert found.rangefinder is not None
    assert found.rangefinder.direction.tolist() == pytest.approx([0, 0.6, 0.8])
    assert found.rangefinder.std_m == 0.002


def test_the_centre_is_the_middle_of_the_pixels_unless_said(tmp_path: Path) -> None:
    found = load_rig(rig_file(tmp_path))
    assert found.left.matrix[:2, 2].tolist() == [31.5, 23.5]
    assert found.rangefinder is None


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("focal_px = 60.0\n\n[r", "\n[r", r"[left]"),
        ("focal_px = 60.0\n\n[r", "focal_mm = 6\n\n[r", "[left]"),
        ("focal_px = 60.0\n\n[r", "focal_px = 60.0\nfocal_mm = 6\n\n[r", "[left]"),
        ("focal_px = 60.0\n\n[r", "focal_px = -60.0\n\n[r", "[left.focal_px"),
        ("focal_px = 60.0\n\n[r", "focal_px = 0\n\n[r", "[left.focal_px"),
        ("focal_px = 60.0\n\n[r", "focal_px = [60.0, 0.0]\n\n[r", "[left.focal_px"),
        ("focal_px = 60.0\n\n[r", "focal_px = nan\n\n[r", "[left.focal_px"),
        ("focal_px = 60.0\n\n[r", 'focal_px = "long"\n\n[r', "[left.focal_px"),
        ("size_px = [64, 48]\nfocal_px = 60.0\n\n[s", "focal_px = 60.0\n\n[s", "[right.size_px]"),
        ("size_px = [64, 48]\nfocal_px = 60.0\n\n[s", "size_px = [0, 48]\n[s", "[right.size_px.0]"),
        ("[stereo]", "distortion = [1.0]\n[stereo]", "[right]"),
        ("[stereo]", 'lens = "fisheye"\n[stereo]', "[right.lens]"),
        ("[stereo]", "focal = 6\n[stereo]", "[right.focal]"),
        ("[stereo]\ntranslation_m = [-0.2, 0.0, 0.0]", "", "[stereo]"),
        ("-0.2, 0.0, 0.0", "-0.2, 0.0", "[stereo.translation_m]"),
        ("-0.2, 0.0, 0.0", "-inf, 0.0, 0.0", "[stereo.translation_m.0]"),
        ("-0.2, 0.0, 0.0]", "-0.2, 0.0, 0.0]\nrotation = [[1.0]]", "[stereo.rotation"),
        ("0.0]\n", "0.0]\n[rangefinder]\nstd_m = 0.001\n", "[rangefinder.origin_m]"),
        (
            "0.0]\n",
            "0.0]\n[rangefinder]\norigin_m = [0, 0, 0]\ndirection = [0, 0, 0]\n",
            "[rangefinder",
        ),
    ],
)
def test_a_mistake_in_a_toml_is_named_by_its_key(
    tmp_path: Path, old: str, new: str, key: str
) -> None:
    assert old in RIG_TOML
    assert key in refusal(tmp_path, RIG_TOML.replace(old, new))


def test_a_file_that_is_no_toml_says_where(tmp_path: Path) -> None:
    assert "line 3" in refusal(tmp_path, "[left]\nsize_px = [64, 48]\nfocal_px =\n")


def test_a_binary_file_is_no_toml(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_bytes(b"\xff\xfe\0")
    with pytest.raises(PomologError, match="not TOML"):
        load_rig(tmp_path / "rig.toml")


@pytest.mark.parametrize("name", ["rig.toml", "rig.yaml", "rig.json", "rig"])
def test_a_rig_that_is_not_there_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(PomologError, match=name):
        load_rig(tmp_path / name)


def test_a_folder_is_no_rig(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").mkdir()
    with pytest.raises(PomologError, match="no rig at"):
        load_rig(tmp_path / "rig.toml")


# OpenCV's YAML


@pytest.mark.parametrize("name", ["rig.yaml", "rig.yml", "RIG.YML"])
def test_an_opencv_yaml_is_read(tmp_path: Path, name: str) -> None:
    found = load_rig(rig_file(tmp_path, OPENCV, name))
    assert found.left.size_px == found.right.size_px == (640, 480)
    assert found.left.matrix.tolist() == [[500, 0, 320], [0, 501, 240], [0, 0, 1]]
    assert found.left.distortion.tolist() == [0.1, 0.2, 0.003, 0.004, 0.5]
    assert found.left.lens == "plumb_bob"
    assert found.right.distortion.tolist() == [1, 2, 3, 4, 5, 6, 7, 8]
    assert found.right.lens == "rational_polynomial"
    assert found.translation_m.tolist() == [-0.2, 0.001, 0.002]
    assert np.array_equal(found.rotation, np.eye(3))


def test_four_numbers_a_lens_are_refused_unless_a_name_says_which_lens(tmp_path: Path) -> None:
    four = "rows: 1\n   cols: 4\n   dt: d\n   data: [ 0.1, 0.02, 0.003, 0.004 ]"
    five, eight = (OPENCV.partition(f"D{n}: !!opencv-matrix\n   ")[2] for n in (1, 2))
    text = OPENCV
    for lens in (five, eight):
        text = text.replace(lens[: lens.index("]") + 1], four)
    assert "lens1 and lens2" in refusal(tmp_path, text, "rig.yaml")
    for lens in ("plumb_bob", "kannala_brandt"):
        named = f"{text}lens1: {lens}\nlens2: {lens}\n"
        assert load_rig(rig_file(tmp_path, named, "rig.yaml")).left.lens == lens
    ideal = text.replace("0.1, 0.02, 0.003, 0.004", "0., 0., 0., 0.")
    assert load_rig(rig_file(tmp_path, ideal, "rig.yaml")).left.straight


def test_the_real_trees_rig_is_read() -> None:
    path = DATA / "story_orchard" / "rig_opencv.yaml"
    if not path.exists():
        pytest.skip(f"NOT TESTED: no {path}")
    # by its README: a baseline of 50.0 mm
    assert load_rig(path).baseline_m == pytest.approx(0.05, abs=5e-5)


@pytest.mark.parametrize("key", ["M1", "D1", "M2", "D2", "R", "T", "image_width", "image_height"])
def test_a_key_that_is_missing_from_an_opencv_yaml_is_named(tmp_path: Path, key: str) -> None:
    assert key in refusal(tmp_path, OPENCV.replace(f"\n{key}:", f"\nno{key}:"), "rig.yaml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (OPENCV, "hello", "not an OpenCV YAML"),
        (OPENCV, "", "not an OpenCV YAML"),
        (OPENCV, "%YAML 1.2\n---\nM1: [ 1\n", "not an OpenCV YAML"),
        (OPENCV, "%YAML 1.2\n---\nM1: 5\nD1: 5\n", "not an OpenCV YAML"),
        ("data: [ 500.,", "data: [", "not an OpenCV YAML"),
        ("data: [ 500.,", "data: [ .nan,", "not finite"),
        ("data: [ 500.,", "data: [ -500.,", "focal"),
        ("data: [ 500.,", "data: [ 0.,", "focal"),
        ("rows: 3\n   cols: 1\n   dt: d\n   data: [ -0.2,", SHORT_T, "T has"),
        ("cols: 5\n   dt: d\n   data: [ 0.1,", "cols: 4\n   dt: d\n   data: [", None),
        ("cols: 5\n   dt: d\n   data: [ 0.1, 0.2,", "cols: 3\n   dt: d\n   data: [",
         "3 distortion coefficients"),
        ("image_width: 640", "image_width: -640", "image_width"),
        ("image_width: 640", "image_width: wide", "image_width"),
    ],
)  # fmt: skip
def test_a_mistake_in_an_opencv_yaml_is_told(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, words: str | None
) -> None:
    assert old in OPENCV
    text = OPENCV.replace(old, new, 1)
    if words is None:
        assert load_rig(rig_file(tmp_path, text, "rig.yaml")).left.distortion.size == 4
    else:
        line = refusal(tmp_path, text, "rig.yaml")
        assert words in line
        assert "exception" not in line
        assert "/modules/" not in line
    assert capfd.readouterr().err == ""  # OpenCV itself must not add lines of its own


# numbers that no rig can have


def test_a_translation_in_millimetres_is_noticed(tmp_path: Path) -> None:
    line = refusal(tmp_path, OPENCV.replace("-0.2,", "-200.0,"), "rig.yaml")
    assert "200 m" in line
    assert "must be in metres" in line


def test_no_translation_at_all_is_noticed(tmp_path: Path) -> None:
    assert "baseline" in refusal(tmp_path, RIG_TOML.replace("-0.2,", "0.0,"))


def test_swapped_cameras_are_noticed(tmp_path: Path) -> None:
    assert "swapped" in refusal(tmp_path, RIG_TOML.replace("-0.2,", "0.2,"))


@pytest.mark.parametrize(
    "rotation",
    [
        np.eye(3) * 1.01,
        np.zeros((3, 3)),
        np.diag([1.0, 1.0, -1.0]),  # a mirror: orthogonal, but no rotation
        -np.eye(3),
        np.full((3, 3), np.nan),
        np.triu(np.ones((3, 3))),
    ],
)
def test_a_matrix_that_is_no_rotation_is_noticed(rotation: np.ndarray) -> None:
    camera = parallel_rig().left
    with pytest.raises(PomologError, match="no rotation matrix"):
        Rig(camera, camera, rotation, np.array([-0.2, 0, 0]))


@pytest.mark.parametrize("place", [(0, 0), (1, 1)])
@pytest.mark.parametrize("value", [0.0, -500.0, np.nan, np.inf])
def test_a_camera_without_a_positive_focal_length_is_noticed(
    place: tuple[int, int], value: float
) -> None:
    good = parallel_rig()
    matrix = good.left.matrix.copy()
    matrix[place] = value
    with pytest.raises(PomologError, match="focal length"):
        Rig(good.left, Camera((1280, 1024), matrix), good.rotation, good.translation_m)


@pytest.mark.parametrize("size_px", [(0, 10), (10, -1), (2**32 - 1, 2**32 - 1), (16385, 10)])
def test_a_camera_of_an_impossible_size_is_noticed(size_px: tuple[int, int]) -> None:
    with pytest.raises(PomologError, match="no camera has"):
        parallel_rig(size_px=size_px)


def test_nan_translations_are_noticed() -> None:
    camera = parallel_rig().left
    with pytest.raises(PomologError, match="baseline"):
        Rig(camera, camera, np.eye(3), np.array([-0.2, np.nan, 0]))


# the digest


def test_the_digest_tells_rigs_apart_and_does_not_change() -> None:
    rigs = [
        parallel_rig(),
        parallel_rig(baseline_m=0.201),
        parallel_rig(focal_px=1000),
        parallel_rig(rangefinder=rangefinder()),
        real_rig(),
        real_rig("rational_polynomial"),
        real_rig(beam=True),
    ]
    digests = [one.digest for one in rigs]
    assert len(set(digests)) == len(rigs)
    assert [real_rig().digest, parallel_rig().digest] == [digests[4], digests[0]]
    # every session keeps it, so it must stay the same from version to version
    assert parallel_rig().digest == "2e279e7d34fa419d"


def test_the_papers_rig_has_the_papers_numbers() -> None:
    found = parallel_rig()
    assert found.baseline_m == pytest.approx(0.2)
    assert found.left.size_px == (1280, 1024)
    assert np.array_equal(found.rotation, rotation_of((0, 0, 0)))
