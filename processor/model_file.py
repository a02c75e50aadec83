"""A model on the disk: an .npz of tables and weights, and a .json that says its provenance."""

import hashlib
import json
import struct
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile, ZipFile

import numpy as np

from processor.assign import PAIR_MEASURES, MatchModel
from processor.centres import CentreModel
from processor.colour_table import ENTRIES, ColourModel
from processor.evidence import CLAIM_MEASURES, MEASURES
from processor.fruit import FruitModel
from processor.net import Net
from processor.ranging import RangeModel
from recorder.errors import PomologError
from recorder.files import replacing
from recorder.limits import DEFAULT_LIMITS

FOLDER: Final = Path(__file__).parent / "models"
_PROFILE: Final = "pomolog-model/3"
# what zipfile and NumPy raise on damaged bytes, found by mutating good files
_DAMAGE: Final = (
    OSError, ValueError, KeyError, EOFError, BadZipFile, MemoryError, OverflowError, IndexError,
    NotImplementedError, RuntimeError, SyntaxError, TypeError, struct.error, zlib.error,
)  # fmt: skip
_NETS: Final = {  # and what each is told
    "quality": MEASURES, "choice": MEASURES + CLAIM_MEASURES, "pair": PAIR_MEASURES,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Everything that method `pomolog` learned."""

    name: str
    colours: ColourModel
    fruit: FruitModel
    match: MatchModel
    range: RangeModel


def save_model(model: Model, path: Path, provenance: dict[str, Any]) -> None:
    """Write `path` (.npz), and beside it a .json with where the model comes from.

    Raises:
        PomologError: the files cannot be written.
    """
    arrays: dict[str, Any] = {
        "profile": np.array(_PROFILE),
        "colour": model.colours.colour,
        "context": model.colours.context,
        "radius_scale": np.array(model.range.radius_scale),
        "spread": np.array(model.range.spread),
    }
    if model.fruit.centres is not None:
        arrays["centres"] = np.frombuffer(model.fruit.centres.onnx, np.uint8)
    nets = (model.fruit.quality, model.fruit.choice, model.match.pair)
    for name, net in zip(_NETS, nets, strict=True):
        arrays |= {f"{name}.mean": net.mean, f"{name}.scale": net.scale}
        for number, (weight, bias) in enumerate(zip(net.weights, net.biases, strict=True)):
            arrays |= {f"{name}.weight{number}": weight, f"{name}.bias{number}": bias}
    with replacing(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    with replacing(path.with_suffix(".json")) as part:
        part.write_text(json.dumps({"model": model.name, **provenance}, indent=2) + "\n")


@cache
def load_model(choice: str) -> Model:
    """A model by the name it ships under, or by the path of a .npz.

    Raises:
        PomologError: there is none, or it is damaged.
    """
    path = _path(choice)
    if not path.is_file():
        names = ", ".join(sorted(p.stem for p in FOLDER.glob("*.npz")))
        raise PomologError(f"no model {choice!r}; there are {names}, or give a .npz: pomolog train")
    try:
        with ZipFile(path) as packed:
            unpacked_bytes = sum(entry.file_size for entry in packed.infolist())
        if unpacked_bytes > DEFAULT_LIMITS.record:
            raise ValueError(f"it unpacks to {unpacked_bytes} bytes")
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            return _model(choice, dict(arrays))
    except _DAMAGE as error:
        reason = " ".join(str(error).split())[:200]
        raise PomologError(f"{path} is no model ({reason}); make one with: pomolog train") from None


def model_digest(choice: str) -> str:
    """A short hash of a model's file, which results depend on."""
    return hashlib.sha256(_path(choice).read_bytes()).hexdigest()[:12]


def _path(choice: str) -> Path:
    return Path(choice) if choice.endswith(".npz") else FOLDER / f"{choice}.npz"


def _model(name: str, arrays: dict[str, Any]) -> Model:
    if str(arrays["profile"]) != _PROFILE:
        raise ValueError(f"profile {arrays['profile']}, not {_PROFILE}")
    for table in ("colour", "context"):
        if arrays[table].shape != (ENTRIES,) or arrays[table].dtype != np.uint8:
            raise ValueError(f"table {table} is not {ENTRIES} bytes")
    quality, choice, pair = (_net(part, told, arrays) for part, told in _NETS.items())
    spread = tuple(float(w) for w in arrays["spread"])
    centres = CentreModel(arrays["centres"].tobytes()) if "centres" in arrays else None
    return Model(
        name,
        ColourModel(name, arrays["colour"], arrays["context"]),
        FruitModel(name, quality, choice, centres),
        MatchModel(name, pair),
        RangeModel(name, float(arrays["radius_scale"]), spread),
    )


def _net(name: str, told: int, arrays: dict[str, Any]) -> Net:
    if arrays[f"{name}.mean"].shape != (told,):
        raise ValueError(f"network {name} is not of {told} measures")
    layers = range(sum(key.startswith(f"{name}.weight") for key in arrays))
    return Net(
        arrays[f"{name}.mean"], arrays[f"{name}.scale"],
        tuple(arrays[f"{name}.weight{n}"] for n in layers),
        tuple(arrays[f"{name}.bias{n}"] for n in layers),
    )  # fmt: skip
