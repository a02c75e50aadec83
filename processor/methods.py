"""Named methods: which alternative each stage takes, as a name or as a TOML file."""

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Final, get_type_hints

from pydantic import TypeAdapter, ValidationError

from processor.assign import Assignment, MatchModel
from processor.circles import CIRCLES, HoughCircles
from processor.clean import CLEAN, SizeFloor
from processor.colour_table import ColourModel, ColourTable
from processor.fruit import FruitFinder, FruitModel
from processor.locate import Locator
from processor.match import MATCH, AreaInOrder
from processor.model_file import Model, load_model, model_digest
from processor.ranging import OutlineRange, RangeModel
from processor.recognise import RECOGNISE, ColourRatio, RedMinusLuma, TwoRedMinusGreenBlue
from processor.triangulate import TRIANGULATE
from recorder.errors import PomologError
from recorder.text_files import read_toml

# stage -> name of an alternative -> its class; the stages in the locator's order
STAGES: Final[dict[str, Mapping[str, type[Any]]]] = {
    "recognise": RECOGNISE,
    "clean": CLEAN,
    "circles": CIRCLES,
    "match": MATCH,
    "triangulate": TRIANGULATE,
}

# what a stage learned -> the part of a model that has it
MODEL_PARTS: Final[dict[Any, str]] = {
    ColourModel: "colours",
    FruitModel: "fruit",
    MatchModel: "match",
    RangeModel: "range",
}
DEFAULT_MODEL: Final = "pomolog-4"


def learned(model: Model) -> Locator:
    """Method `pomolog` with that model."""
    return Locator(
        recognise=ColourTable(model.colours),
        clean=SizeFloor(),
        circles=FruitFinder(model.fruit),
        match=Assignment(model.match),
        triangulate=OutlineRange(model.range),
    )


def hurried(model: Model) -> Locator:
    """Method `pomolog-fast`: colours read at half the size, candidates of the network alone."""
    return replace(
        learned(model),
        recognise=ColourTable(model.colours, halved_from_px=900_000),
        circles=FruitFinder(model.fruit, voted=0),
    )


METHODS: Final[dict[str, Locator]] = {
    "paper": Locator(),
    "pomolog": learned(load_model(DEFAULT_MODEL)),
    "pomolog-fast": hurried(load_model(DEFAULT_MODEL)),
    "paper-signed": Locator(recognise=ColourRatio("signed")),
    "paper-difference": Locator(recognise=ColourRatio("difference")),
    "paper-absolute": Locator(recognise=ColourRatio("absolute")),
    "2r-g-b": Locator(recognise=TwoRedMinusGreenBlue()),
    "y-r": Locator(recognise=RedMinusLuma()),
    "hough": Locator(circles=HoughCircles()),
    "no-reference-line": Locator(match=AreaInOrder(reference_line=False)),
    "area-only": Locator(match=AreaInOrder(in_order=False, reference_line=False)),
}

# what a method cannot do, for people who choose one
LIMITS: Final[dict[str, str]] = {
    "pomolog": "for red and bi-coloured apples, not for green or yellow ones",
    "pomolog-fast": "the same, in less time",
}


def load_method(choice: str) -> tuple[str, Locator]:
    """A method by its name, or from a TOML file; gives its name and the locator.

    A file starts from a named method (`base`, default `paper`) and has a table for each stage
    that differs: `use` names the alternative, every other key is one of its parameters.

    Raises:
        PomologError: no such method or file, or a key or value that its stage does not have.
    """
    if choice in METHODS:
        return choice, METHODS[choice]
    if not choice.endswith(".toml"):
        names = ", ".join(METHODS)
        raise PomologError(f"no method {choice!r}; choose {names}, or give a .toml file")
    path = Path(choice)
    table = read_toml(path, "see one with: pomolog methods paper")
    try:
        return path.stem, locator_from(table)
    except PomologError as error:
        raise PomologError(f"{path}: {error}") from None


def locator_from(table: Mapping[str, Any]) -> Locator:
    """Build a locator from a method's table, as `describe` gives it or as TOML has it.

    Raises:
        PomologError: an unknown base, stage, alternative, parameter, or a value of a wrong kind.
    """
    base = table.get("base", "paper")
    if not isinstance(base, str) or base not in METHODS:
        raise PomologError(f"base = {base!r} is no method; choose {', '.join(METHODS)}")
    unknown = set(table) - {"base", "name", *STAGES}
    if unknown:
        raise PomologError(f"no stage [{min(unknown)}]; the stages are {', '.join(STAGES)}")
    return changed(METHODS[base], table)


def changed(locator: Locator, table: Mapping[str, Any]) -> Locator:
    """A locator with the stages of a method's table in place of its own.

    Raises:
        PomologError: an unknown alternative or parameter, or a value of a wrong kind.
    """
    for stage, alternatives in STAGES.items():
        if stage in table:
            current = getattr(locator, stage)
            chosen = _alternative(stage, alternatives, current, table[stage])
            locator = replace(locator, **{stage: chosen})
    return locator


def _alternative(
    stage: str, alternatives: Mapping[str, type[Any]], current: Any, table: Any
) -> Any:
    if not isinstance(table, Mapping):
        raise PomologError(f"[{stage}] must be a table with `use` and parameters")
    use = table.get("use", _name_of(alternatives, current))
    if not isinstance(use, str) or use not in alternatives:
        raise PomologError(f"[{stage}] use = {use!r}; there are {', '.join(alternatives)}")
    kind = alternatives[use]
    given = {key: value for key, value in table.items() if key != "use"}
    hints = get_type_hints(kind, include_extras=True)
    for key, value in given.items():
        if key not in hints:
            raise PomologError(f"[{stage}] {use} has no {key!r}; it has {', '.join(hints)}")
        if isinstance(value, float) and not math.isfinite(value):
            raise PomologError(
                f"[{stage}] {key}: {value} is no number to work with; give a finite one"
            )
    values = {key: _value(f"[{stage}] {key}", hints[key], value) for key, value in given.items()}
    models = {key: _part(DEFAULT_MODEL, hint) for key, hint in hints.items() if hint in MODEL_PARTS}
    try:
        if isinstance(current, kind):
            return replace(current, **values)
        return kind(**{**models, **values})
    except ValueError as error:  # values that do not go together
        raise PomologError(f"[{stage}] {error}; change one of them") from None


def _value(place: str, hint: Any, value: Any) -> Any:
    """A parameter of a stage, checked; a model is named, or is the path of a .npz."""
    if hint in MODEL_PARTS:
        if not isinstance(value, str):
            raise PomologError(f"{place}: give the name or the .npz of a model")
        return _part(value, hint)
    try:
        return TypeAdapter(hint).validate_python(value)
    except ValidationError as error:
        first = error.errors()[0]
        inner = ".".join(map(str, first["loc"]))
        raise PomologError(
            f"{place}{'.' if inner else ''}{inner}: {first['msg']}; change it"
        ) from None


def _part(choice: str, hint: Any) -> Any:
    return getattr(load_model(choice), MODEL_PARTS[hint])


def _name_of(alternatives: Mapping[str, type[Any]], chosen: Any) -> str:
    return next(name for name, kind in alternatives.items() if kind is type(chosen))


def describe(locator: Locator) -> dict[str, dict[str, Any]]:
    """Every stage's alternative and every parameter, ready for JSON; a model by its name."""
    return {
        stage: {
            "use": _name_of(alternatives, getattr(locator, stage)),
            **_plain(getattr(locator, stage)),
        }
        for stage, alternatives in STAGES.items()
    }


def _plain(value: Any) -> Any:
    if type(value) in MODEL_PARTS:
        return value.name
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    return value


def models_of(locator: Locator) -> dict[str, str]:
    """The models that a locator uses, each with a hash of what it learned."""
    stages = [getattr(locator, stage) for stage in STAGES]
    names = {stage.model.name for stage in stages if hasattr(stage, "model")}
    return {name: model_digest(name) for name in sorted(names)}


def to_toml(name: str, locator: Locator) -> str:
    """A method as TOML that `load_method` reads back; a parameter that is None is left out."""
    lines = [f"# {name}; every parameter with its value"]
    for stage, table in describe(locator).items():
        lines += ["", f"[{stage}]"]
        lines += [f"{key} = {_toml(value)}" for key, value in table.items() if value is not None]
    return "\n".join(lines)


def _toml(value: Any) -> str:
    """A JSON string, number, list or truth value is a TOML one; a table is not."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + " }"
    return json.dumps(value)
