"""Files of strangers: an error line or a right answer; `benchmarks.fuzz` tries thousands."""

import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fuzz.material import material
from benchmarks.fuzz.targets import sound_answers, targets
from processor.replay import replay
from processor.results import TABLES, read_table
from processor.run_file import read_run, run_text
from recorder.errors import PomologError
from recorder.imports.json_files import read_json
from recorder.imports.masks import MaskTruth
from recorder.limits import Limits, limits_from
from recorder.rig import load_rig
from recorder.text_files import read_toml
from tests.builders import RIG_TOML, content, rig_file, session_file
from tests.mcap_files import changed
from tests.scenes import TINY, apple, stereo_session, tiny_rig

SETTINGS = settings(
    max_examples=40,
    deadline=None,  # the machine may be busy
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # files are written over
)
JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=8,
)


REFUSED = object()


def heard(read: Callable[[], Any]) -> Any:
    """What a reader answers, or REFUSED where it does in one line."""
    try:
        return read()
    except PomologError as error:
        line = " ".join(str(error).split())
        if not 0 < len(line) < 1000:
            raise AssertionError(line) from error
        return REFUSED


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sound") / "sound"
    material(folder)
    return folder


@pytest.mark.slow
def test_a_few_mutated_files_of_every_kind_are_refused_or_read_rightly(
    sound: Path, tmp_path: Path
) -> None:
    answers = sound_answers(sound, tmp_path / "first")
    assert all(answers.values())
    for target in targets(sound):
        for number in range(6):
            folder = tmp_path / f"{target.name}{number}".replace("/", "")
            folder.mkdir()
            path = target.make(sound, folder, random.Random(f"test {number}"))
            answer = heard(partial(target.judge, path, folder))
            right = answers[target.name] | {REFUSED}
            assert answer in right or not target.sealed, (target.name, number)


@SETTINGS
@given(
    edits=st.lists(st.tuples(st.floats(0, 0.999), st.binary(min_size=1, max_size=9)), min_size=1)
)
def test_a_session_with_other_bytes_is_refused_or_says_the_same(
    edits: list[tuple[float, bytes]], sound: Path
) -> None:
    path = sound / "plain.mcap"
    for place, new in edits[:6]:
        path = changed(path, int(place * path.stat().st_size), new, "edited.mcap")
    found = heard(lambda: content(path))
    assert found is REFUSED or found == content(sound / "plain.mcap")


@SETTINGS
@given(value=JSON_VALUES, place=st.integers(0, 6))
def test_any_json_is_a_list_of_apples_or_refused(value: Any, place: int, sound: Path) -> None:
    frames = json.loads((sound / "apples.json").read_text())
    frames[0][0][("id", "centre_m", "radius_m", "left", "right", "truth_point", "x")[place]] = value
    path = sound / "any.json"
    path.write_text(json.dumps(frames))
    heard(lambda: MaskTruth(sound / "masks", path))


@SETTINGS
@given(
    key=st.sampled_from(("profile", "session", "method", "seed", "tables", "x")), value=JSON_VALUES
)
def test_any_run_file_is_read_or_refused(key: str, value: Any, sound: Path) -> None:
    about = read_run(sound / "results/row/run.json")
    path = sound / "any-run.json"
    path.write_text(run_text({**about, key: value}))
    found = heard(lambda: read_run(path))
    assert found is REFUSED or found["session"]["metadata"]["lighting"] == "front"


@SETTINGS
@given(
    old=st.sampled_from(RIG_TOML.split()), new=st.text(st.characters(codec="utf-8"), max_size=30)
)
def test_any_words_in_a_rig_are_a_rig_or_refused(old: str, new: str, sound: Path) -> None:
    path = rig_file(sound, RIG_TOML.replace(old, new), "any.toml")
    heard(lambda: load_rig(path))


@pytest.mark.parametrize(
    "text", ["a = " + "[" * 3000, "a = " + "9" * 5000, "a = 1\na = 2", "\0"], ids=range(4)
)
def test_a_toml_that_parsers_choke_on_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text(text)
    with pytest.raises(PomologError, match=r"x\.toml is not TOML: .*; look at it"):
        read_toml(path, "look at it")


@pytest.mark.parametrize("text", ["[" * 3000, "9" * 5000, "{", "\0", "\x80"], ids=range(5))
def test_a_json_that_parsers_choke_on_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(PomologError, match=r"x\.json is not JSON: "):
        read_json(path)


def test_opencv_is_never_given_a_matrix_that_lies(sound: Path, tmp_path: Path) -> None:
    """Its reader ends in a damaged heap, so this runs in a process of its own."""
    text = (sound / "rig.yaml").read_text()
    lies = (
        text.replace("   cols: 1\n", ""),
        text.replace("rows: 3\n   cols: 3", "rows: 3\n   cols: 1"),
        text.replace("rows: 3", "rows: 30000"), text.replace("570., 0.,", ""),
        text.replace("dt: d", "dt: 4d"), text.replace("rows: 1\n", "sizes: [ 1, 5 ]\n"),
    )  # fmt: skip
    for number, lie in enumerate(lies):
        assert lie != text
        rig_file(tmp_path, lie, f"{number}.yaml")
    code = (
        "import sys\nfrom pathlib import Path\nfrom recorder.rig import load_rig\n"
        "from recorder.errors import PomologError\n"
        "for path in sorted(Path(sys.argv[1]).glob('*.yaml')):\n"
        "    try: load_rig(path)\n"
        "    except PomologError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.count("not an OpenCV YAML to trust") == len(lies)


def test_a_flipped_bit_in_a_table_is_never_another_number(sound: Path, tmp_path: Path) -> None:
    whole = (sound / "results/row/frames.parquet").read_bytes()
    expected = read_table(sound / "results/row", "frames")
    dice = random.Random(4)
    refused = 0
    for _ in range(150):
        data = bytearray(whole)
        data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        (tmp_path / "frames.parquet").write_bytes(data)
        found = heard(lambda: read_table(tmp_path, "frames"))
        refused += found is REFUSED
        assert found is REFUSED or found.equals(expected)
    assert refused > 50  # the others are of what nobody reads: statistics, padding


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_as_replay_wrote_it_or_rewritten_knowingly(
    name: str, sound: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "row"
    shutil.copytree(sound / "results/row", folder)
    path = folder / f"{name}.parquet"
    whole, table = path.read_bytes(), read_table(folder, name)
    for _ in range(60):  # of the footer, which has no checksum of its own
        data = bytearray(whole)
        data[random.randrange(len(data) * 2 // 3, len(data) - 4)] ^= 1 << random.randrange(8)
        path.write_bytes(data)
        found = heard(lambda: read_table(folder, name))
        assert found is REFUSED or found.equals(table)
    pq.write_table(table.slice(0, 1), path)
    assert len(read_table(folder, name)) == 1


def test_damaged_results_are_not_taken_for_done(tmp_path: Path) -> None:
    session = session_of_two(tmp_path / "row.mcap")
    list(replay([session], tmp_path / "out", TINY, rrd="none"))
    table = tmp_path / "out/row/apples.parquet"
    table.write_bytes(table.read_bytes()[:-1] + b"X")
    (again,) = replay([session], tmp_path / "out", TINY, rrd="none")
    assert not isinstance(again, PomologError)
    assert not again.resumed
    for name in TABLES:
        read_table(tmp_path / "out/row", name)


def test_a_run_file_that_a_program_rewrote_is_read_and_a_damaged_one_is_not(
    sound: Path, tmp_path: Path
) -> None:
    text = (sound / "results/row/run.json").read_text()
    path = tmp_path / "run.json"
    path.write_text(text.replace('"seed": 0', '"seed": 1'))
    with pytest.raises(PomologError, match="damaged"):
        read_run(path)
    path.write_text(json.dumps({**json.loads(text), "seed": 1}))
    assert read_run(path)["seed"] == 1


@pytest.mark.parametrize("name", ["...mcap", "..mcap"])
def test_no_sessions_name_leads_out_of_the_output_folder(name: str, tmp_path: Path) -> None:
    session = session_of_two(tmp_path / "in" / name)
    before = sorted(tmp_path.rglob("*"))
    if session.stem in (".", ".."):
        with pytest.raises(PomologError, match="has no name for its results; rename it"):
            list(replay([session], tmp_path / "deep/out", TINY, rrd="none"))
        assert sorted(tmp_path.rglob("*")) == before
        return
    list(replay([session], tmp_path / "deep/out", TINY, rrd="none"))
    new = [path for path in tmp_path.rglob("*") if path not in before]
    assert new
    assert all(path.is_relative_to(tmp_path / "deep") for path in new)


def test_limits_are_changed_in_one_place() -> None:
    assert limits_from("") == Limits()
    assert limits_from("chunk=512MB, text=1G,record=77").chunk == 512 << 20
    assert limits_from("chunk=512MB, text=1G,record=77").record == 77
    for words in ("chunks=1", "chunk", "chunk=-1", "chunk=1TB", "chunk=x"):
        with pytest.raises(PomologError, match="POMOLOG_LIMITS has"):
            limits_from(words)


def test_a_limit_is_for_every_command(tmp_path: Path) -> None:
    session = session_file(tmp_path)
    for words, said in (("record=100", "more than 100"), ("rubbish", "POMOLOG_LIMITS has")):
        done = subprocess.run(
            [sys.executable, "-m", "pomolog", "info", str(session)],
            env={**os.environ, "POMOLOG_LIMITS": words},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 1
        assert said in done.stderr
        assert done.stderr.count("\n") == 1


def session_of_two(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return stereo_session(path, [[apple(1, seen=1.0)]] * 2, rig=tiny_rig())
