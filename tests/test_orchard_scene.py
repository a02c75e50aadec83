"""The scene file is checked before anything grows; a missing library is one line."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from recorder.cli import app
from recorder.errors import PomologError
from recorder.orchard import engine
from recorder.orchard.apple import NEAR_GRID, Apple, grow_apple
from recorder.orchard.camera import pixel_slopes, rig_pose
from recorder.orchard.scene import SETS_FOLDER, Scene, Shot, load_scene, shots
from recorder.orchard.sensor import CameraSetting, encode_picture, metered_gain, take_picture
from recorder.orchard.simulate import look_key
from recorder.orchard.skin import RECIPES
from recorder.orchard.specimen import hang_specimen
from recorder.orchard.tree import Spur, TreeShape, Wood, grow_tree, hang_fruit, overlap
from recorder.orchard.truth import reading
from recorder.orchard.wood import Branch
from recorder.pictures import decode


def scene_file(folder: Path, text: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(f'name = "a"\nseed = 1\n{text}')
    return path


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("ligth = 'front'", r"\[ligth\] is no key of a scene"),
        ("[trees]\nfruits = 3", r"\[trees.fruits\] is no key of a scene"),
        ("light = 'noon'", r"\[light\] .*'front'"),
        ("[trees]\nfruit = 0", r"\[trees.fruit\] is 0 .* no apple in view"),
        ("[specimen]\nrange_m = [400.0]", r"\[specimen.range_m.0\] .*less than or equal to 3"),
        ("[specimen]\nrange_m = [0.3]\n[rig]\nbaseline_m = 0.6", r"\[specimen.range_m\] .*in view"),
        ("light = 'lamps'", r"\[light\] 'lamps' does not shine"),
        ("seed = 2", r"is not TOML"),
        ("[camera.left]\nev = 90", r"\[camera.left.ev\] .*\(given: 90"),
        ("exposures_ev = []", r"\[exposures_ev\]"),
        ("[motion]\npairs = 2\n[specimen]\nrange_m = [1.0]", r"\[motion\] and \[specimen\]"),
    ],
)
def test_a_bad_scene_is_one_line_that_names_the_key(
    tmp_path: Path, text: str, complaint: str
) -> None:
    with pytest.raises(PomologError, match=complaint) as error:
        load_scene(scene_file(tmp_path, text))
    assert "\n" not in str(error.value)


def test_an_unknown_scene_lists_those_that_come_with_it() -> None:
    with pytest.raises(PomologError, match=r"no scene file nowhere.*segmentation-front"):
        load_scene(Path("nowhere"))


def test_every_set_that_comes_with_it_is_sound_and_named_as_its_file() -> None:
    sets = {path.stem: load_scene(Path(path.stem)) for path in SETS_FOLDER.glob("*.toml")}
    assert all(scene.name == name for name, scene in sets.items())
    counts = {name: len(shots(scene)) for name, scene in sets.items()}
    assert sum(n for name, n in counts.items() if name.startswith("segmentation-")) == 160
    assert sum(n for name, n in counts.items() if name.startswith("matching-")) == 45
    assert sum(n for name, n in counts.items() if name.startswith("distance-")) == 12 * 5 * 3
    starts = sorted((s.seed, len({shot.seed for shot in shots(s)})) for s in sets.values())
    shared = [(a, b) for (a, n), (b, _) in pairwise(starts) if a != b and a + n > b]
    assert not shared, "two sets share some of their seeds"


def test_a_fraction_is_spread_evenly_and_splits_do_not_share_a_seed() -> None:
    scene = load_scene(Path("distance-indoor-clear"))
    assert [shot.range_m for shot in shots(scene, 1 / 9)] == [0.4, 0.7, 1.0, 1.3]
    train, test = shots(scene, split="train"), shots(scene, split="test")
    assert len(train) + len(test) == len(shots(scene))
    assert not {s.seed for s in train} & {s.seed for s in test}
    assert {s.split for s in test} == {"test"}


def test_a_split_without_worlds_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match="has no test pairs"):
        shots(load_scene(scene_file(tmp_path, "")), split="test")


def test_what_does_not_change_the_light_does_not_change_a_kept_picture(tmp_path: Path) -> None:
    scene = load_scene(scene_file(tmp_path, ""))
    key = look_key(scene, Shot(1))
    same = scene.model_copy(update={"name": "b", "exposures_ev": [1.0], "worlds": 7})
    assert look_key(same, Shot(1, ev=2.0)) == key
    assert look_key(scene.model_copy(update={"light": "back"}), Shot(1)) != key
    assert look_key(scene, Shot(2)) != key


def test_without_mitsuba_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("drjit", "mitsuba"):
        monkeypatch.setitem(sys.modules, name, None)
    engine.load_mitsuba.cache_clear()
    result = CliRunner().invoke(
        app, ["simulate", str(scene_file(tmp_path, "")), "-o", str(tmp_path / "s.mcap")]
    )
    engine.load_mitsuba.cache_clear()
    assert isinstance(result.exception, PomologError)
    assert r"pip install 'pomolog[orchard]'" in str(result.exception)
    assert not (tmp_path / "s.mcap").exists()


@pytest.mark.parametrize("name", ["libLLVM-14.so.1", "libLLVM.so.18.1"])
def test_an_unfit_llvm_is_refused_before_it_is_loaded(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_bytes(b"would abort the process")
    monkeypatch.setattr(engine, "_LLVM_FOLDERS", (str(tmp_path),))
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    with pytest.raises(PomologError, match=r"LLVM 19, which is not here \(found only 1[48]\)"):
        engine.find_llvm()
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / name))
    with pytest.raises(PomologError, match="apt-get install libllvm19"):
        engine.find_llvm()


def test_the_scene_file_is_read_without_mitsuba() -> None:
    code = (
        "import sys, recorder.orchard.simulate; from recorder.orchard.scene import load_scene\n"
        "from pathlib import Path; load_scene(Path('row')); print('mitsuba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def apple(centre_m: tuple[float, float, float], width_m: float = 0.08) -> Apple:
    return grow_apple(
        np.random.default_rng(1),
        width_m=width_m,
        height_ratio=0.88,
        centre_m=np.array(centre_m),
        axis=np.array([0, 0, 1.0]),
        spur_m=np.array(centre_m) + np.array([0, 0, 0.06]),
        grid=NEAR_GRID,
    )


def test_an_apples_centre_is_its_centroid_and_its_radius_its_volumes() -> None:
    fruit = apple((1.0, 2.0, 3.0))
    assert np.allclose(fruit.surface.points_m.mean(0), (1, 2, 3), atol=0.004)
    assert 0.036 < fruit.radius_m < 0.040
    assert fruit.reach_m < 0.044
    outwards = (fruit.surface.normals * (fruit.surface.points_m - fruit.centre_m)).sum(1)
    assert np.mean(outwards > 0) > 0.95  # inwards only in the cavity


def test_fruit_hang_clear_of_wood_and_of_each_other() -> None:
    rng = np.random.default_rng(3)
    tree = grow_tree(rng, 0.0, 1.2, TreeShape())
    wood = Wood(tree.branches)
    fruit = hang_fruit(rng, tree.spurs, wood, RECIPES["fuji"], 25, grid=NEAR_GRID)
    assert len(fruit) >= 15
    trunk = tree.branches[0]
    for one in fruit:
        skin = one.surface.points_m
        gaps = np.linalg.norm(skin[:, None] - trunk.points_m[None], axis=2) - trunk.radii_m
        assert gaps.min() > 0
        assert not wood.touches(one)
    assert not any(overlap(a, b) for i, a in enumerate(fruit) for b in fruit[:i])


def test_a_fruit_through_a_branch_touches_it() -> None:
    branch = Branch(np.array([[-1.0, 0, 0], [1.0, 0, 0]]), np.full(2, 0.01), 8)
    assert Wood([branch]).touches(apple((0.0, 0.0, 0.040)))
    assert not Wood([branch]).touches(apple((0.0, 0.0, 0.06)))
    assert overlap(apple((0, 0, 0)), apple((0.07, 0, 0)))
    assert not overlap(apple((0, 0, 0)), apple((0.085, 0, 0)))
    assert not hang_fruit(
        np.random.default_rng(0), [Spur(np.array([0, 0, 0.05]))], Wood([branch]),
        RECIPES["fuji"], 0, grid=NEAR_GRID,
    )  # fmt: skip


@pytest.mark.parametrize("fraction", [0.2, 0.5])
def test_leaves_hang_before_the_apple_that_they_shall_hide(fraction: float) -> None:
    text = {"hidden_by": "leaves", "hidden_fraction": fraction, "range_m": [0.8]}
    scene = Scene.model_validate({"name": "a", "seed": 1, "specimen": text})
    assert scene.specimen is not None
    pose = rig_pose(scene.make_rig(), 0.0)
    hung = hang_specimen(np.random.default_rng(5), scene.specimen, 0.8, RECIPES["fuji"], pose)
    nearest_m = hung.leaves.points_m[..., 1].min(1)
    assert (nearest_m < hung.apples[0].centre_m[1] - hung.apples[0].reach_m).any()
    centre = pose.to_left(hung.apples[0].centre_m[None])[0]
    assert np.allclose(centre, (0.1, 0.0, 0.8), atol=1e-12)


def test_rays_through_pixels_project_back_onto_them_with_any_lens() -> None:
    rig = {"distortion": [-0.2, 0.08, 0.001, -0.002, 0.01], "toe_in_deg": 2.0, "roll_deg": 0.5,
           "vertical_offset_m": 0.003}  # fmt: skip
    camera = {"size_px": [96, 64]}
    scene = Scene.model_validate({"name": "a", "seed": 1, "rig": rig, "camera": camera})
    pose = rig_pose(scene.make_rig(), 0.3)
    for side in ("left", "right"):
        view = pose.view(side)
        slopes = pixel_slopes(view.camera)
        looks = np.concatenate([slopes, np.ones((len(slopes), 1))], 1) @ view.rotation.T
        x, y = np.meshgrid(np.arange(96), np.arange(64))
        again = view.project(view.centre_m + 1.7 * looks)
        assert np.abs(again - np.stack([x.ravel(), y.ravel()], 1)).max() < 1e-4
    assert pose.rig.translation_m[0] < 0  # the right camera is on the right


def test_a_picture_follows_exposure_and_keeps_colour_in_every_encoding() -> None:
    scene = Scene.model_validate({"name": "a", "seed": 1, "camera": {"size_px": [64, 48]}})
    view = rig_pose(scene.make_rig(), 0.0).view("left")
    light = np.ones((48, 64, 3), np.float32) * np.array([0.5, 0.2, 0.1], np.float32)

    def shot(ev: float) -> np.ndarray:
        setting = CameraSetting(ev=ev)
        return take_picture(light, view, metered_gain(light), setting, np.random.default_rng(0))

    dark, plain, bright = (shot(ev) for ev in (-2.0, 0.0, 2.0))
    assert dark.mean() < plain.mean() < bright.mean()
    red, green, blue = (int(plain[..., c].mean()) for c in (2, 1, 0))
    assert red > green > blue
    for encoding in ("jpeg", "png", "bayer_rggb8", "bgr8"):
        frame = encode_picture(plain, "left", 0, 0, encoding, 95)
        assert (
            np.abs(decode(frame)[8:-8, 8:-8].mean((0, 1)) - plain[8:-8, 8:-8].mean((0, 1))).max()
            < 3
        )
    with pytest.raises(PomologError, match=r"\[camera.encoding\]"):
        encode_picture(plain, "left", 0, 0, "webp", 95)


def test_a_reading_has_the_instruments_noise_and_says_when_nothing_answers() -> None:
    rng = np.random.default_rng(0)
    many = [
        reading(rng, 0, 1.0, std_m=0.002, reach_m=5, apple_id=1).range_m or 0 for _ in range(400)
    ]
    assert 0.0017 < np.std(many) < 0.0023
    assert abs(np.mean(many) - 1.0) < 0.0005
    silent = reading(rng, 0, None, std_m=0.002, reach_m=5, apple_id=None)
    assert (silent.range_m, silent.status) == (None, "no echo")
    assert reading(rng, 0, 9.0, std_m=0.002, reach_m=5, apple_id=None).range_m is None
    assert reading(rng, 0, 0.5, std_m=1e-9, reach_m=5, apple_id=None).raw == "g0g+00005000"
