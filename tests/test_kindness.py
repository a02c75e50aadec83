"""What a newcomer types wrongly, for every command: one line, exit 1, and nothing left behind."""

import json
import os
import pty
import re
import select
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from pomolog import COMMANDS
from recorder.rig_files import write_rig
from recorder.session import Session
from tests.builders import encoded
from tests.test_long_life import RESULTS, SESSION, newer_results, newer_session
from tests.test_processor_cli import Command, Said, assert_one_line

ROOT = Path(__file__).parent.parent

# every way to give a command something to read (IN) and a name to write (OUT)
READS_SESSION = (
    "info IN",
    "check IN",
    "salvage IN -o OUT.mcap",
    "label IN --masks masks -o OUT.mcap",
    "label IN --coco coco.json -o OUT.mcap",
    "export frames IN -o OUT",
    "export bag IN -o OUT.mcap",
    "replay IN -o OUT",
    "sweep IN --vary circles.rounds=5 -o OUT",
    "train IN --network-rounds 0 -o OUT.npz",
    "calibrate IN --rangefinder -o OUT.toml",
    "view IN --save OUT.rrd",
)
READS_RESULTS = (
    "score IN",
    "compare IN results",
    "compare results IN",
    "report IN -o OUT.html",
    "sheet IN --frame 0 -o OUT.png",
    "export results IN -o OUT.csv",
)
READS_OTHER = (
    "record --rig IN --out OUT",
    "import frames IN IN --rig rig.toml -o OUT.mcap",
    "import frames pictures pictures --rig IN -o OUT.mcap",
    "import bag IN -o OUT.mcap",
    "rig convert IN -o OUT.yaml",
    "calibrate IN pictures --board chessboard:9x6:25mm -o OUT.toml",
    "simulate IN -o OUT.mcap",
    "label good.mcap --masks IN -o OUT.mcap",
    "label good.mcap --masks masks --apples IN -o OUT.mcap",
    "label good.mcap --coco IN -o OUT.mcap",
    "label good.mcap --labelme IN -o OUT.mcap",
    "label good.mcap --cvat IN -o OUT.mcap",
    "label good.mcap --supervisely IN -o OUT.mcap",
    "label good.mcap --yolo IN -o OUT.mcap",
    "label good.mcap --circles IN -o OUT.mcap",
    "replay good.mcap -o OUT --method IN",
    "methods IN",
    "compare results results --gate IN",
    "paper --sessions IN -o OUT",
    "demo --method IN -o OUT",
)
WRITES = (
    "import frames pictures pictures --rig rig.toml -o OUT",
    "import bag good.mcap -o OUT",
    "label good.mcap --masks masks -o OUT",
    "salvage good.mcap -o OUT",
    "simulate segmentation-front -o OUT",
    "export results results -o OUT",
    "train good.mcap --network-rounds 0 -o OUT",
    "rig convert rig.toml -o OUT",
    "calibrate pictures pictures --board chessboard:9x6:25mm -o OUT",
    "calibrate pictures pictures --board chessboard:9x6:25mm --report OUT",
    "check good.mcap --plot OUT",
    "view good.mcap --save OUT",
    "report results -o OUT",
    "sheet results/row --frame 0 -o OUT",
)
NO_INPUT = ("missing.mcap", "folder", "notes.txt", "empty", "pictures/0.png")


@pytest.fixture
def command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Command:
    """Commands in a folder with good things to read, and bad ones."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    shutil.copy(SESSION, "good.mcap")
    shutil.copytree(RESULTS, "results")
    with Session(SESSION) as session:
        write_rig(session.rig, Path("rig.toml"))
    for folder in ("folder", "masks/left", "pictures"):
        Path(folder).mkdir(parents=True)
    mask = cv2.imencode(".png", np.zeros((72, 96), np.uint16))[1].tobytes()
    for index in range(4):
        Path(f"masks/left/{index}.png").write_bytes(mask)
    Path("pictures/0.png").write_bytes(encoded(seed=1))
    Path("notes.txt").write_text("row 3, cloudy\n", encoding="utf-8")
    Path("coco.json").write_text(json.dumps({"images": [], "annotations": []}), encoding="utf-8")
    Path("empty").touch()
    return Command(monkeypatch, capsys)


def typed(line: str, given: str, out: str = "made") -> list[str]:
    return [word.replace("IN", given).replace("OUT", out) for word in line.split()]


def test_every_command_is_tried() -> None:
    lines = (*READS_SESSION, *READS_RESULTS, *READS_OTHER, *WRITES)
    assert {line.split()[0] for line in lines} == set(COMMANDS)


@pytest.mark.parametrize("line", [*READS_SESSION, *READS_RESULTS, *READS_OTHER])
def test_what_is_no_input_is_one_line_that_names_it(line: str, command: Command) -> None:
    for given in NO_INPUT:
        said = command(*typed(line, given))
        assert_one_line(said, Path(given).name)
        assert not said.out
        assert not list(Path().glob("made*"))


def test_a_session_where_results_are_wanted_says_how_to_make_them(command: Command) -> None:
    for line in READS_RESULTS:
        assert_one_line(command(*typed(line, "good.mcap")), "pomolog replay good.mcap -o results")


@pytest.mark.parametrize("line", READS_SESSION)
def test_a_session_of_a_newer_version_says_to_update(
    line: str, command: Command, tmp_path: Path
) -> None:
    newer_session(tmp_path)
    assert_one_line(command(*typed(line, "newer.mcap")), "newer.mcap", "update pomolog")
    assert not list(Path().glob("made*"))


@pytest.mark.parametrize("line", [*READS_RESULTS, "view IN --save OUT.rrd"])
def test_results_of_a_newer_version_say_to_update(
    line: str, command: Command, tmp_path: Path
) -> None:
    (tmp_path / "later").mkdir()
    newer_results(tmp_path / "later")
    assert_one_line(command(*typed(line, "later/results")), "row/run.json", "update pomolog")
    assert not list(Path().glob("made*"))


@pytest.mark.parametrize("line", WRITES)
def test_a_name_of_another_kind_of_file_is_refused_before_the_work(
    line: str, command: Command
) -> None:
    said = command(*typed(line, "", "made.docx"))
    assert_one_line(said, "made.docx")
    assert re.search(r"\.(mcap|csv|npz|yaml|html|png|rrd)\b", said.err)
    assert not list(Path().glob("made*"))


@pytest.mark.parametrize("line", ["replay good.mcap -o OUT", "salvage good.mcap -o OUT/s.mcap"])
def test_a_file_where_a_folder_should_be_is_named(line: str, command: Command) -> None:
    assert_one_line(command(*typed(line, "", "notes.txt")), "notes.txt is a file, not a folder")


# what serves each extra, and the module that is missing without it
EXTRAS = {
    "aravis": ("record --rig aravis.toml --out OUT", "gi"),
    "pylon": ("record --rig pylon.toml --out OUT", "pypylon"),
    "av": ("record --rig av.toml --out OUT", "av"),
    "serial": ("record --rig serial.toml --out OUT", "serial"),
    "orchard": ("simulate segmentation-front -o OUT.mcap", "mitsuba"),
    "cluster": ("replay good.mcap -o OUT --cluster tcp://127.0.0.1:1", "distributed"),
    "train": ("train good.mcap -o OUT.npz", "jax"),
    "s3": ("info s3://orchard/row.mcap", "s3fs"),
    "gs": ("info gs://orchard/row.mcap", "gcsfs"),
}
NO_COMMAND = {"dev", "catalog"}  # tools of ours; queries of one's own (docs/catalog.md)


def test_every_extra_is_tried() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert EXTRAS.keys() | NO_COMMAND == project["optional-dependencies"].keys()


@pytest.mark.usefixtures("command")
@pytest.mark.parametrize("extra", EXTRAS)
def test_a_missing_extra_is_one_line_that_names_it(extra: str) -> None:
    line, module = EXTRAS[extra]
    rig = Path("rig.toml").read_text(encoding="utf-8")
    driver, device = (extra, "x") if extra in ("aravis", "pylon", "av") else ("files", "pictures")
    for side in ("left", "right"):
        rig += f'\n[cameras.{side}]\ndriver = "{driver}"\ndevice = "{device}"\nrate_hz = 5.0\n'
    if extra == "serial":
        rig += '\n[rangefinder_device]\ndriver = "benewake"\nport = "/dev/x"\n'
    Path(f"{extra}.toml").write_text(rig, encoding="utf-8")
    ran = subprocess.run(
        [sys.executable, "-c",
         f"import sys; sys.modules[{module!r}] = None; import pomolog; pomolog.main()",
         *typed(line, "")],
        capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert_one_line(Said(ran.returncode, ran.stdout, ran.stderr), f"pip install 'pomolog[{extra}]'")
    assert not list(Path().glob("made/*"))


# all help there is, and a score: what a terminal shows in colour
SHOW = """
import sys, pomolog
for words in (*([name, "--help"] for name in pomolog.COMMANDS), ["score", sys.argv[1]]):
    sys.argv = ["pomolog", *words]
    try: pomolog.main()
    except SystemExit as ended: assert not ended.code, words
"""
ESCAPE, COLOUR = "\x1b[", re.compile(r"\x1b\[(\d+;)*(3|4|9|10)\d(;\d+)*m")


def plain_environ(**more: str) -> dict[str, str]:
    told = ("NO_COLOR", "FORCE_COLOR", "PY_COLORS", "GITHUB_ACTIONS", "TTY_COMPATIBLE")
    return (
        {k: v for k, v in os.environ.items() if k not in told} | {"TERM": "xterm-256color"} | more
    )


def on_a_terminal(**environ: str) -> str:
    """What all of it writes to a terminal."""
    ours, theirs = pty.openpty()
    shown = subprocess.Popen(  # it reads like a person's terminal, so `run` cannot
        [sys.executable, "-c", SHOW, RESULTS], stdout=theirs, stderr=theirs,
        stdin=subprocess.DEVNULL, env=plain_environ(**environ),
    )  # fmt: skip
    os.close(theirs)
    text = b""
    while select.select([ours], [], [])[0]:
        try:
            text += os.read(ours, 65536)
        except OSError:  # its other end is closed
            break
    os.close(ours)
    assert not shown.wait(), text.decode()
    return text.decode()


def test_a_terminal_shows_colours_unless_no_color_says_not_to() -> None:
    assert COLOUR.search(on_a_terminal())
    quiet = on_a_terminal(NO_COLOR="1")
    assert "matches right" in quiet
    assert not COLOUR.search(quiet)


def test_what_is_no_terminal_gets_neither_colours_nor_other_escapes(command: Command) -> None:
    for words in (*([name, "--help"] for name in COMMANDS), ["score", "results"]):
        said = command(*words)
        assert said.code == 0
        assert ESCAPE not in said.out + said.err, words
