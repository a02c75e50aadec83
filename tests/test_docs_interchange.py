"""Every command of docs/interchange.md runs, on tiny files laid out as the page says."""

import json
import shlex
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pomolog import COMMANDS
from recorder.session import Session
from tests.bags import START_NS, Ros, small_picture, stereo_bag
from tests.builders import RIG_TOML, SECOND_NS, encoded, labels, picture_folders

PAGE = Path(__file__).parents[1] / "docs" / "interchange.md"
MS = 1_000_000


def commands() -> list[str]:
    """The lines of the page that begin with the command, all of them in blocks."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("pomolog ")]


def bags(folder: Path) -> None:
    stereo_bag(folder).write().rename(folder / "row7")
    stereo_bag(folder, skew_ns=18 * MS).write().rename(folder / "row7-untriggered")
    ros = Ros(folder, "realsense")
    ros.info("/camera/color/camera_info", START_NS, frame_id="color")
    for index in range(2):
        time_ns = START_NS + index * SECOND_NS
        ros.image("/camera/color/image_raw", time_ns, small_picture(index), "rgb8",
                  frame_id="color")  # fmt: skip
        depth = np.full((48, 64), 1200 + index, np.uint16)
        ros.image("/camera/aligned_depth_to_color/image_raw", time_ns, depth, "16UC1",
                  frame_id="color")  # fmt: skip
    ros.write()


def public_sets(folder: Path) -> None:
    minne = folder / "MinneApple" / "detection" / "train"
    for part in ("images", "masks"):
        (minne / part).mkdir(parents=True)
    for index in range(2):
        name = f"20150919_174151_image{index + 1}.png"
        (minne / "images" / name).write_bytes(encoded(seed=index))
        known = labels(index)
        known[known > 255] = 0  # these masks have 8 bits
        cv2.imwrite(str(minne / "masks" / name), known.astype(np.uint8))
    apples = folder / "acfr-fruit-dataset" / "apples"
    for part in ("images", "annotations"):
        (apples / part).mkdir(parents=True)
    for index in range(2):
        (apples / "images" / f"2015110{index}T1.png").write_bytes(encoded(seed=index))
        text = "#item,c-x,c-y,radius,label\n0,20.5,21.25,6.5,1\n1,40,30,5,1\n"
        (apples / "annotations" / f"2015110{index}T1.csv").write_text(text)
    day = folder / "ecopom" / "dataset" / "1_0m" / "HIGH" / "2022_06_17"
    day.mkdir(parents=True)
    for index in (1, 2):
        (day / f"P{index}.png").write_bytes(encoded(seed=index))
        boxes = [
            {"id": n, "description": "7", "geometryType": "rectangle", "tags": [],
             "classTitle": kind, "points": {"exterior": [[8, 7], [18, 19]], "interior": []}}
            for n, kind in enumerate(("Apple_Y5L", "Apple_Man"))
        ]  # fmt: skip
        content = {"description": "", "tags": [], "size": {"height": 48, "width": 64}}
        (day / f"P{index}.json").write_text(json.dumps({**content, "objects": boxes}))
    (day / "desktop.ini").write_text("[.ShellClassInfo]")
    growth = folder / "AppleGrowthVision"
    picture_folders(growth, 2)
    (growth / "rig.toml").write_text(RIG_TOML)
    for side in ("left", "right"):
        (growth / "labels" / side).mkdir(parents=True)
        (growth / "labels" / side / "000.txt").write_text("0 0.25 0.25 0.125 0.5\n")


def drawn_labels(folder: Path) -> None:
    """What a labelling tool gives back of `export frames`: an apple in both views."""
    polygon = [20, 10, 32, 10, 32, 24, 20, 24]
    images = [
        {"id": n, "file_name": f"{side}/000001.png", "width": 64, "height": 48}
        for n, side in enumerate(("left", "right"))
    ]
    drawn = [
        {"id": n, "image_id": n, "category_id": 1, "segmentation": [polygon], "track_id": 4}
        for n in range(2)
    ]
    document = {"images": images, "annotations": drawn, "categories": [{"id": 1, "name": "apple"}]}
    (folder / "labels.json").write_text(json.dumps(document))


def run(line: str) -> None:
    """As the front door does it."""
    program, *words = shlex.split(line)
    assert program == "pomolog", line
    import_module(COMMANDS[words[0]].module).app(args=words, standalone_mode=False)


def truths(path: str) -> list[Any]:
    with Session(Path(path)) as session:
        return [pair.truth for pair in session.pairs()]


@pytest.mark.slow
def test_every_command_of_the_page_runs_and_does_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bags(tmp_path)
    public_sets(tmp_path)
    drawn_labels(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # a pool of workers costs more than it saves
    said: dict[str, str] = {}
    for line in commands():
        run(line)
        said[line] = capsys.readouterr().out
    first = next(text for line, text in said.items() if "import bag row7/" in line)
    assert first.strip() in PAGE.read_text(encoding="utf-8")  # as the page shows it
    assert {p.suffix for p in tmp_path.glob("apples.*")} == {".csv", ".jsonl"}
    for name, pairs in (("loose", 3), ("shifted", 3), ("again", 3), ("tree", 2)):
        with Session(tmp_path / f"{name}.mcap") as session:
            assert len(session) == pairs, name
    unlabelled, known, _ = truths("row7-truth.mcap")
    assert unlabelled is None
    assert int((known.left == 4).sum()) == int((known.right == 4).sum()) == 12 * 14
    minne, *_ = truths("minneapple-truth.mcap")
    assert np.unique(minne.left).tolist() == [0, 1, 2]
    assert (minne.right, minne.shared, minne.partial) == (None, True, False)
    acfr, *_ = truths("acfr-truth.mcap")
    assert [o.kind for o in acfr.left_outlines] == ["circle", "circle"]
    assert acfr.left_outlines[0].width_px == 13.0
    ecopom, *_ = truths("ecopom-truth.mcap")
    assert len(ecopom.left_outlines) == 1
    assert ecopom.partial
    growth, other = truths("growth-truth.mcap")
    assert len(growth.left_outlines) == len(growth.right_outlines) == 1
    assert not growth.shared
    assert other is None  # no label file names it


def test_the_page_has_commands() -> None:
    assert len(commands()) > 15
