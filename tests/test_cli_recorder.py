import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import pomolog
from recorder.session import Session, read_info
from tests.builders import DATA, RIG_TOML, encoded, labels, picture_folders, rig_file, session_file
from tests.mcap_files import flipped, torn

ROOT = Path(__file__).parents[1]
COMMANDS = [["info"], ["check"], ["salvage"], ["label"], ["import"], ["import", "frames"]]


class Done(NamedTuple):
    code: int
    out: str
    err: str


def run(capfd: pytest.CaptureFixture[str], *words: object) -> Done:
    """Run a command as `pomolog WORDS` does, in this process."""
    before, old = sys.argv, signal.getsignal(signal.SIGTERM)
    sys.argv = ["pomolog", *map(str, words)]
    try:
        with pytest.raises(SystemExit) as stopped:
            pomolog.main()
    finally:
        sys.argv = before
        signal.signal(signal.SIGTERM, old)
    code = stopped.value.code
    return Done(code if isinstance(code, int) else int(code is not None), *capfd.readouterr())


def refused(done: Done) -> str:
    """The one line of a command that failed as expected."""
    assert done.code == 1, done
    lines = done.err.splitlines()
    assert len(lines) == 1, done
    assert lines[0].startswith("pomolog: ")
    return lines[0]


def document(done: Done) -> Any:
    """The one JSON document on stdout, and nothing else there."""
    return json.loads(done.out)


# the front door


def test_no_command_shows_them_all_and_is_wrong_usage(capfd: pytest.CaptureFixture[str]) -> None:
    done = run(capfd)
    assert done.code == 2
    assert all(f"  {name}" in done.out for name in pomolog.COMMANDS)
    assert run(capfd, "--help") == Done(0, done.out, "")


def test_an_unknown_command_is_wrong_usage(capfd: pytest.CaptureFixture[str]) -> None:
    done = run(capfd, "infos")
    assert done.code == 2
    assert done.err == "pomolog: no command 'infos'; see: pomolog --help\n"


def test_the_version_is_told(capfd: pytest.CaptureFixture[str]) -> None:
    from importlib.metadata import version

    assert run(capfd, "--version") == Done(0, f"pomolog {version('pomolog')}\n", "")


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_commands_help_has_an_example(
    capfd: pytest.CaptureFixture[str], words: Sequence[str]
) -> None:
    for option in ("--help", "-h"):
        done = run(capfd, *words, option)
        assert done.code == 0
        text = " ".join(done.out.split())
        assert f"Example: pomolog {' '.join(words)} " in text


@pytest.mark.parametrize(
    "words",
    [
        ["info"],
        ["info", "a.mcap", "b.mcap"],
        ["info", "a.mcap", "--jsn"],
        ["salvage", "a.mcap"],
        ["import"],
        ["import", "bagpipe"],
        ["import", "frames", "a", "b", "-o", "c.mcap"],
        ["import", "frames", "a", "b", "--rig", "r.toml", "-o", "c", "--rate", "0"],
        ["import", "frames", "a", "b", "--rig", "r.toml", "-o", "c", "--rate", "fast"],
        ["label", "a.mcap", "-o", "b.mcap"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_exit_2(capfd: pytest.CaptureFixture[str], words: Sequence[str]) -> None:
    done = run(capfd, *words)
    assert done.code == 2
    assert "Traceback" not in done.err


def test_looking_into_a_session_loads_neither_rerun_nor_the_processor(tmp_path: Path) -> None:
    path = session_file(tmp_path)
    script = (
        "import sys, pomolog\n"
        "try: pomolog.main()\n"
        "except SystemExit as stop: assert not stop.code\n"
        "loaded = {name.split('.')[0] for name in sys.modules}\n"
        "assert not loaded & {'rerun', 'processor', 'viewer', 'pyarrow'}, loaded\n"
    )
    for words in (["info", path], ["check", path], ["salvage", path, "-o", tmp_path / "t.mcap"]):
        subprocess.run([sys.executable, "-c", script, *map(str, words)], check=True, cwd=ROOT)


# info


def test_info_as_json_has_the_promised_keys(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = session_file(tmp_path, 3, readings=True)
    done = run(capfd, "info", path, "--json")
    assert (done.code, done.err) == (0, "")
    found = document(done)
    assert set(found) == {
        "profile", "frames", "pairs", "topics", "start_ns", "end_ns", "metadata", "ledger", "whole",
    }  # fmt: skip
    assert (found["profile"], found["frames"], found["pairs"]) == ("pomolog/1", 6, 3)
    assert found["whole"] is True
    assert found["topics"]["/rangefinder"] == 3
    assert (found["start_ns"], found["end_ns"]) == (0, 2_000_001_000)
    assert found["metadata"]["lighting"] == "front"
    assert found["ledger"] == {}


def test_info_tells_people_the_same(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    done = run(capfd, "info", session_file(tmp_path, 3))
    assert (done.code, done.err) == (0, "")
    for words in ("pomolog/1, whole", "3 stereo pairs, 6 frames, 2.0 s", "about: lighting = front"):
        assert words in done.out


def test_info_of_a_torn_file_says_what_can_be_saved(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = session_file(tmp_path, 3, sync_each=True)
    path = torn(whole, whole.stat().st_size // 2)
    done = run(capfd, "info", path, "--json")
    found = document(done)
    assert set(found) == set(document(run(capfd, "info", whole, "--json")))
    assert found["whole"] is False
    assert found["profile"] == "pomolog/1"
    assert 0 < found["frames"] < 6
    assert found["pairs"] == found["frames"] // 2
    assert f"try: pomolog salvage {path}" in done.err
    assert done.err.count("\n") == 1
    assert done.code == 0
    assert "TORN" in run(capfd, "info", path).out


def test_info_of_a_file_torn_before_its_first_chunk_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = torn(session_file(tmp_path), 100)
    done = run(capfd, "info", path, "--json")
    assert done.out == ""
    assert str(path) in refused(done)


def test_info_of_what_is_no_session_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.txt").write_text("hello")
    for path, words in (
        (tmp_path / "no.mcap", "cannot read"),
        (tmp_path, "is a folder"),
        (tmp_path / "a.txt", "is not an MCAP file"),
    ):
        for option in ([], ["--json"]):
            done = run(capfd, "info", path, *option)
            assert words in refused(done)
            assert done.out == ""


# check


def test_check_of_a_sound_session(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = session_file(tmp_path, 3)
    done = run(capfd, "check", path)
    assert (done.code, done.err) == (0, "")
    assert all(line.startswith("ok ") for line in done.out.splitlines())
    done = run(capfd, "check", path, "--json")
    assert (done.code, done.err) == (0, "")
    found = document(done)
    assert found["sound"] is True
    assert all(set(finding) == {"level", "text"} for finding in found["findings"])


def test_check_of_a_damaged_session_is_one_line_and_exit_1(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = session_file(tmp_path, 3)
    path = flipped(whole, whole.stat().st_size // 2)
    assert "is damaged" in refused(run(capfd, "check", path))
    done = run(capfd, "check", path, "--json")
    assert "is damaged" in refused(done)
    assert document(done)["sound"] is False


# salvage


def test_salvage_says_what_was_saved_and_what_was_lost(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = session_file(tmp_path, 3, sync_each=True)
    path, out = torn(whole, whole.stat().st_size // 2), tmp_path / "out.mcap"
    done = run(capfd, "salvage", path, "-o", out)
    assert (done.code, done.err) == (0, "")
    frames = read_info(out).frames
    assert f"{out}: {frames} frames from" in done.out
    assert "bytes in all" in done.out


def test_salvage_of_nothing_is_one_line_and_leaves_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = torn(session_file(tmp_path), 100)
    before = sorted(tmp_path.iterdir())
    assert "nothing to save" in refused(run(capfd, "salvage", path, "-o", tmp_path / "out.mcap"))
    assert "the torn file itself" in refused(run(capfd, "salvage", path, "-o", path))
    assert sorted(tmp_path.iterdir()) == before


# import frames


def test_frames_are_imported_with_all_that_was_said(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    left, right = picture_folders(tmp_path, 3)
    out = tmp_path / "new" / "s.mcap"
    done = run(
        capfd, "import", "frames", left, right, "--rig", rig_file(tmp_path), "-o", out,
        "--lighting", "front,front,back", "--cultivar", "Fuji", "--site", "row 3", "--rate", "2",
    )  # fmt: skip
    assert done == Done(0, f"{out}: 3 stereo pairs\n", "")
    with Session(out) as session:
        assert session.metadata["cultivar"] == "Fuji"
        assert session.metadata["site"] == "row 3"
        assert session.metadata["made_by"] == "import frames"
        assert [pair.conditions["lighting"] for pair in session.pairs()] == [
            "front", "front", "back",
        ]  # fmt: skip
        assert session.pair_times_ns()[:, 0].tolist() == [0, 500_000_000, 1_000_000_000]


def test_the_real_tree_is_imported_with_its_calibration(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = DATA / "story_orchard"
    if not folder.is_dir():
        pytest.skip(f"NOT TESTED: no {folder}")
    left, right = folder / "125309_colour.png", folder / "123505_colour.png"
    out = tmp_path / "s.mcap"
    done = run(
        capfd, "import", "frames", left, right, "--rig", folder / "rig_opencv.yaml", "-o", out
    )
    assert done.code == 0
    with Session(out) as session:
        (pair,) = session.pairs()
        assert pair.left.data == left.read_bytes()
        assert pair.right.data == right.read_bytes()
        assert session.rig.baseline_m == pytest.approx(0.05, abs=5e-5)  # 50.0 mm by its README


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: (f / "right" / "000.png").unlink(), "2 pictures in"),
        (lambda f: (f / "right" / "001.png").write_bytes(encoded("png")[:-30]), "is it complete?"),
        (lambda f: (f / "left" / "001.png").write_bytes(b"x"), "is not a PNG"),
        (lambda f: (f / "left" / "001.png").write_bytes(encoded(size_px=(64, 40))), "one size"),
        (lambda f: rig_file(f, RIG_TOML.replace("-0.2", "0.2")), "swapped"),
        (lambda f: rig_file(f, RIG_TOML.replace("focal_px", "focal")), "[left"),
        (lambda f: (f / "rig.toml").unlink(), "no rig at"),
    ],
)
def test_an_import_that_fails_is_one_line_and_leaves_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], spoil: Any, words: str
) -> None:
    left, right = picture_folders(tmp_path, 2)
    rig = rig_file(tmp_path)
    spoil(tmp_path)
    out = tmp_path / "out" / "s.mcap"
    done = run(capfd, "import", "frames", left, right, "--rig", rig, "-o", out)
    assert words in refused(done)
    assert done.out == ""
    assert not out.parent.exists() or list(out.parent.iterdir()) == []


def test_an_output_that_cannot_be_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    left, right = picture_folders(tmp_path, 1)
    for out in ("/proc/s.mcap", tmp_path / "rig.toml" / "s.mcap", "."):
        done = run(capfd, "import", "frames", left, right, "--rig", rig_file(tmp_path), "-o", out)
        assert "cannot write" in refused(done)


@pytest.mark.parametrize(("kill", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_command_that_is_stopped_leaves_nothing(
    tmp_path: Path, kill: signal.Signals, code: int
) -> None:
    left, right = picture_folders(tmp_path, 1)
    for side in (left, right):
        for index in range(1, 3000):
            os.link(side / "000.png", side / f"{index:04d}.png")
    out = tmp_path / "out" / "s.mcap"
    command = [
        sys.executable, "-m", "pomolog", "import", "frames", left, right,
        "--rig", rig_file(tmp_path), "-o", out,
    ]  # fmt: skip
    with subprocess.Popen(
        list(map(str, command)), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as importing:
        deadline = time.monotonic() + 30
        while not (out.parent.is_dir() and list(out.parent.iterdir())):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        importing.send_signal(kill)
        stdout, stderr = importing.communicate(timeout=30)
    assert importing.returncode == code, stderr
    assert "Traceback" not in stderr
    assert stdout == ""
    assert list(out.parent.iterdir()) == []


# label


def label_words(tmp_path: Path, *more: object) -> list[object]:
    import cv2

    for side in ("left", "right"):
        (tmp_path / "masks" / side).mkdir(parents=True)
        for index in range(2):
            cv2.imwrite(str(tmp_path / "masks" / side / f"{index}.png"), labels(index))
    return [
        "label", session_file(tmp_path, 2), "--masks", tmp_path / "masks",
        "-o", tmp_path / "t.mcap", *more,
    ]  # fmt: skip


def test_a_session_is_labelled(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    apples = tmp_path / "apples.json"
    apples.write_text('[[{"id": 1, "centre_m": [0, 0, 1], "radius_m": 0.04}], []]')
    done = run(capfd, *label_words(tmp_path, "--apples", apples, "--partial"))
    assert done == Done(0, f"{tmp_path}/t.mcap: truth for 2 stereo pairs\n", "")
    with Session(tmp_path / "t.mcap") as session:
        for index, pair in enumerate(session.pairs()):
            assert pair.truth is not None
            assert pair.truth.left is not None
            assert np.array_equal(pair.truth.left, labels(index))
            assert pair.truth.apples is not None
            assert len(pair.truth.apples) == 1 - index
            assert pair.truth.partial


def test_labels_that_do_not_fit_are_one_line_and_leave_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = label_words(tmp_path)
    (tmp_path / "masks" / "left" / "1.png").write_bytes(encoded("png", size_px=(64, 48))[:-20])
    assert "is it complete?" in refused(run(capfd, *words))
    (tmp_path / "masks" / "left" / "1.png").unlink()
    assert "has 1 frames" in refused(run(capfd, *words))
    assert not list(tmp_path.glob("t.mcap*"))


# in a pipe


def test_a_command_in_a_pipe_shows_no_progress_and_no_colour(tmp_path: Path) -> None:
    left, right = picture_folders(tmp_path, 5)
    words = [
        "import", "frames", left, right, "--rig", rig_file(tmp_path), "-o", tmp_path / "s.mcap",
    ]  # fmt: skip
    command = [sys.executable, "-m", "pomolog", *map(str, words)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout == f"{tmp_path}/s.mcap: 5 stereo pairs\n"


def test_a_pipe_that_closes_early_shows_no_traceback(tmp_path: Path) -> None:
    path = session_file(tmp_path)
    done = subprocess.run(
        f"{sys.executable} -m pomolog info {path} | true",
        shell=True, cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr


def test_names_that_are_no_text_show_no_traceback(tmp_path: Path) -> None:
    path = session_file(tmp_path)
    odd = os.fsencode(tmp_path) + b"/\xff\xfe.mcap"
    os.rename(os.fsencode(path), odd)  # noqa: PTH104  # a name that is no text needs bytes
    words: list[list[bytes]] = [
        [b"info", odd],
        [b"salvage", odd, b"-o", os.fsencode(tmp_path / "t.mcap")],
    ]
    for some in words:
        command = [os.fsencode(sys.executable), b"-m", b"pomolog", *some]
        strict = {**os.environ, "PYTHONIOENCODING": "utf-8:strict"}  # as on most people's machines
        done = subprocess.run(command, cwd=ROOT, capture_output=True, check=False, env=strict)
        assert done.returncode == 0, (some, done)
        assert b"Traceback" not in done.stderr
