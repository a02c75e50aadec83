"""What is mutated, how, and what a reader may say to it: refuse it, or give a right answer."""

import hashlib
import json
import random
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz.mutate import mutate_bytes, mutate_index, mutate_messages, mutate_words
from processor.compare.comparison import compare
from processor.compare.document import as_document
from processor.compare.sides import open_sides
from processor.methods import DEFAULT_MODEL
from processor.model_file import FOLDER, load_model
from processor.replay import replay
from processor.run_file import read_run, run_text
from processor.runs import find_runs, losses, score_runs
from recorder.check import check
from recorder.errors import PomologError
from recorder.imports.masks import MaskTruth, label_session
from recorder.orchard.scene import load_scene, shots
from recorder.pictures import decode
from recorder.rectify import rectify
from recorder.rig import load_rig
from recorder.salvage import salvage
from recorder.session import Session
from tests.builders import content, pair_content
from tests.scenes import TINY


@dataclass(frozen=True, slots=True)
class Target:
    """A kind of file.

    Attributes:
        name: as the table has it.
        make: writes a mutated one into a folder; gives its path.
        judge: reads it as the commands do; its answer, to be compared with that to a sound file.
        sealed: whether checksums cover it, so that another answer is a silent wrong one.
    """

    name: str
    make: Callable[[Path, Path, random.Random], Path]
    judge: Callable[[Path, Path], str]
    sealed: bool


def _session(mutate: Callable[[Path, random.Random], bytes]) -> Callable[..., Path]:
    def make(sound: Path, folder: Path, dice: random.Random) -> Path:
        path = folder / "s.mcap"
        path.write_bytes(mutate(sound / dice.choice(("plain.mcap", "row.mcap")), dice))
        return path

    return make


def _text(name: str) -> Callable[..., Path]:
    def make(sound: Path, folder: Path, dice: random.Random) -> Path:
        path = folder / name
        path.write_bytes(mutate_words((sound / name).read_bytes(), dice))
        return path

    return make


def read_session(path: Path, _: Path) -> str:
    """All that a session says, its pictures decoded, its rig rectified, its check."""
    found = content(path)
    with Session(path) as session:
        rectify(session.rig)
        for pair in session.pairs():
            decode(pair.left), decode(pair.right)
        list(session.stamps()), list(session.statuses())
    check(path)
    return _digest(found)


def replay_session(path: Path, folder: Path) -> str:
    """Its results and their score."""
    (done,) = replay([path], folder / "out", TINY, rrd="none")
    if isinstance(done, PomologError):
        if "a bug of pomolog" in str(done):
            raise AssertionError(str(done))
        raise done
    return _score(folder / "out")


def salvage_session(path: Path, folder: Path, sound: Path) -> str:
    """Whether all that a salvage saved of a damaged file is in a sound one."""
    known = set()
    for file in (sound / "plain.mcap", sound / "row.mcap"):
        with Session(file) as session:
            known |= {frame for pair in session.pairs() for frame in pair_content(pair)[1]}
    salvage(path, folder / "whole.mcap")
    with Session(folder / "whole.mcap") as session:
        session.require_pairs()
        saved = {frame for pair in session.pairs() for frame in pair_content(pair)[1]}
    return "all of it is sound" if saved <= known else "it invents"


def _score(out: Path) -> str:
    runs = find_runs([out])
    scores = {name: asdict(score) for name, score in score_runs(runs, "").items()}
    return _digest([_without_times(scores), losses(runs)])


def _without_times(value: Any) -> Any:
    """No run takes the same time."""
    if isinstance(value, dict):
        return {k: _without_times(v) for k, v in value.items() if not k.endswith(("_ms", "_ns"))}
    return value


def _results(name: str) -> Callable[..., Path]:
    def make(sound: Path, folder: Path, dice: random.Random) -> Path:
        shutil.copytree(sound / "results" / "row", folder / "out" / "row")
        path = folder / "out" / "row" / name
        path.write_bytes(mutate_bytes(path.read_bytes(), dice))
        return folder / "out"

    return make


def _any_result(sound: Path, folder: Path, dice: random.Random) -> Path:
    names = ("apples.parquet", "frames.parquet", "truth.parquet", "run.json")
    return _results(dice.choice(names))(sound, folder, dice)


def _compare(out: Path, sound: Path) -> str:
    """What compare says of a run against the sound one."""
    found = compare(open_sides(str(sound / "results"), str(out)), unit="pair", moved_m=5e-3)
    document = as_document(found, None)
    return _digest(json.dumps(_without_times(document["measures"]), sort_keys=True))


def _run_file(sound: Path, folder: Path, dice: random.Random) -> Path:
    """A run.json that somebody wrote: any words, under a right checksum."""
    shutil.copytree(sound / "results" / "row", folder / "out" / "row")
    path = folder / "out" / "row" / "run.json"
    text = mutate_words(json.dumps(read_run(path), indent=2).encode(), dice)
    try:
        path.write_text(run_text(json.loads(text)))
    except (ValueError, TypeError, RecursionError):
        path.write_bytes(text)
    return folder / "out"


def _read_rig(path: Path, _: Path) -> str:
    rig = load_rig(path)
    parallel = rectify(rig)
    assert np.isfinite(parallel.baseline_m)
    return rig.digest


def _read_scene(path: Path, _: Path) -> str:
    scene = load_scene(path)
    rig = scene.make_rig()
    rectify(rig)
    return _digest([rig.digest, len(shots(scene))])


def _masks(sound: Path, folder: Path, dice: random.Random) -> Path:
    shutil.copytree(sound / "masks", folder / "masks")
    path = folder / "masks" / dice.choice(("left", "right")) / f"{dice.randrange(3)}.png"
    path.write_bytes(mutate_bytes(path.read_bytes(), dice))
    return folder / "masks"


def _label(masks: Path, apples: Path | None, sound: Path, folder: Path) -> str:
    with Session(sound / "row.mcap") as session:
        label_session(session, MaskTruth(masks, apples), folder / "labelled.mcap")
    with Session(folder / "labelled.mcap") as session:
        return _digest([pair_content(pair)[3] for pair in session.pairs()])


def _model(sound: Path, folder: Path, dice: random.Random) -> Path:
    del sound
    path = folder / "mine.npz"
    path.write_bytes(mutate_bytes((FOLDER / f"{DEFAULT_MODEL}.npz").read_bytes(), dice))
    return path


def _read_model(path: Path, _: Path) -> str:
    load_model.cache_clear()
    model = load_model(str(path))
    return hashlib.sha256(model.colours.colour.tobytes()).hexdigest()


def _digest(value: Any) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()


def targets(sound: Path) -> tuple[Target, ...]:
    """Every target; those that need a sound session beside the mutated file have it bound."""
    return (
        Target("session, bytes", _session(lambda p, d: mutate_bytes(p.read_bytes(), d)),
               read_session, sealed=True),
        Target("session, lying index", _session(mutate_index), read_session, sealed=False),
        Target("session, lying messages", _session(mutate_messages), read_session, sealed=False),
        Target("session, bytes: replay and score",
               _session(lambda p, d: mutate_bytes(p.read_bytes(), d)), replay_session, sealed=True),
        Target("session, lying messages: replay and score", _session(mutate_messages),
               replay_session, sealed=False),
        Target("session, bytes: salvage",
               _session(lambda p, d: mutate_bytes(p.read_bytes(), d)),
               lambda p, f: salvage_session(p, f, sound), sealed=True),
        Target("rig.toml", _text("rig.toml"), _read_rig, sealed=False),
        Target("rig, OpenCV YAML", _text("rig.yaml"), _read_rig, sealed=False),
        Target("scene.toml", _text("scene.toml"), _read_scene, sealed=False),
        Target("label pictures", _masks, lambda p, f: _label(p, None, sound, f), sealed=False),
        Target("apples.json", _text("apples.json"),
               lambda p, f: _label(sound / "masks", p, sound, f), sealed=False),
        *(
            Target(f"results, {name}", _results(name), lambda p, _: _score(p), sealed=True)
            for name in ("frames.parquet", "truth.parquet", "run.json")
        ),
        Target("results, lying run.json", _run_file, lambda p, _: _score(p), sealed=False),
        Target("results, bytes: compare", _any_result, lambda p, _: _compare(p, sound),
               sealed=True),
        Target("results, lying run.json: compare", _run_file, lambda p, _: _compare(p, sound),
               sealed=False),
        Target("model (.npz)", _model, _read_model, sealed=True),
    )  # fmt: skip


def sound_answers(sound: Path, folder: Path) -> dict[str, set[str]]:
    """What each target's reader says to each of the files that it is mutated from."""

    def fresh() -> Path:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        return folder

    sessions = [sound / name for name in ("plain.mcap", "row.mcap")]
    files: dict[str, list[Path]] = {
        "session": sessions, "rig.toml": [sound / "rig.toml"], "rig, OpenCV": [sound / "rig.yaml"],
        "scene": [sound / "scene.toml"], "label": [sound / "masks"],
        "apples": [sound / "apples.json"], "results": [sound / "results"],
        "model": [FOLDER / f"{DEFAULT_MODEL}.npz"],
    }  # fmt: skip
    return {
        target.name: {
            target.judge(file, fresh())
            for start, found in files.items()
            if target.name.startswith(start)
            for file in found
        }
        for target in targets(sound)
    }
