"""What is varied: words such as `circles.rounds=5,10,20` -> every combination as a locator."""

import itertools
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from processor.locate import Locator
from processor.methods import STAGES, changed, describe
from recorder.errors import PomologError

MOST_SETTINGS: Final = 2_000  # of a sweep; each is counted on every picture


@dataclass(frozen=True, slots=True)
class Varied:
    """One parameter and its values.

    Attributes:
        stage: of the locator.
        parameter: of the stage; `use` is the stage's alternative.
        values: as TOML has them.
    """

    stage: str
    parameter: str
    values: tuple[Any, ...]

    @property
    def name(self) -> str:
        """As the command line has it."""
        return self.stage if self.parameter == "use" else f"{self.stage}.{self.parameter}"


@dataclass(frozen=True, slots=True)
class Setting:
    """One combination.

    Attributes:
        number: its place in the grid; after them all the method as it was given, if not in it.
        values: name of each varied parameter -> its value, as text.
        locator: ready to run.
        in_grid: whether it is one of the combinations; the method itself need not be.
        is_base: whether it is the method as it was given.
    """

    number: int
    values: dict[str, str]
    locator: Locator
    in_grid: bool = True
    is_base: bool = False


def parse_vary(words: Sequence[str]) -> tuple[Varied, ...]:
    """Read `--vary` words: STAGE=ALTERNATIVE,... or STAGE.PARAMETER=VALUE,...

    Raises:
        PomologError: a word of another form, an unknown stage, or one parameter twice.
    """
    varied = tuple(_parse(word) for word in words)
    names = [one.name for one in varied]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise PomologError(f"--vary {min(twice)} is given twice; put all its values into one")
    return varied


def _parse(word: str) -> Varied:
    name, equals, text = word.partition("=")
    stage, _, parameter = name.strip().partition(".")
    if not equals or not text.strip():
        raise PomologError(f"--vary {word}: give values, such as --vary circles.rounds=5,10,20")
    if stage not in STAGES:
        raise PomologError(f"--vary {word}: no stage {stage!r}; there are {', '.join(STAGES)}")
    values = tuple(_values(text))
    shown = [json.dumps(value, default=str) for value in values]
    if len(set(shown)) < len(shown):
        raise PomologError(
            f"--vary {word}: {max(shown, key=shown.count)} is given twice; give it once"
        )
    return Varied(stage, parameter or "use", values)


def _values(text: str) -> Iterator[Any]:
    """Numbers, truth values, lists and tables as in TOML; whatever is none is text."""
    try:
        yield from tomllib.loads(f"values = [{text}]")["values"]
        return
    except tomllib.TOMLDecodeError:
        pass
    for piece in text.split(","):
        try:
            yield tomllib.loads(f"value = {piece}")["value"]
        except tomllib.TOMLDecodeError:
            yield piece.strip()


def settings_of(base: Locator, varied: Sequence[Varied]) -> tuple[Setting, ...]:
    """Every combination of the values, the last varied fastest, and the method as it is.

    Raises:
        PomologError: too many, or a value that its stage does not take.
    """
    count = 1
    for one in varied:
        count *= len(one.values)
    if count > MOST_SETTINGS:
        raise PomologError(
            f"{count:,} settings are more than the {MOST_SETTINGS:,} of a sweep; vary less at once"
        )
    names = [one.name for one in varied]
    grid = []
    for values in itertools.product(*(one.values for one in varied)):
        table: dict[str, dict[str, Any]] = {}
        for one, value in zip(varied, values, strict=True):
            table.setdefault(one.stage, {})[one.parameter] = value
        grid.append(_locator(base, table, dict(zip(names, values, strict=True))))
    made = [
        Setting(number, _shown(locator, varied), locator, is_base=locator == base)
        for number, locator in enumerate(grid)
    ]
    if not any(one.is_base for one in made):
        made.append(Setting(len(made), _shown(base, varied), base, in_grid=False, is_base=True))
    return tuple(made)


def _locator(base: Locator, table: Mapping[str, Any], values: Mapping[str, Any]) -> Locator:
    try:
        return changed(base, table)
    except PomologError as error:
        said = ", ".join(f"{name}={value}" for name, value in values.items())
        raise PomologError(f"--vary {said}: {error}") from None


def _shown(locator: Locator, varied: Sequence[Varied]) -> dict[str, str]:
    """The varied parameters' values of a locator, as text; a dash where its stage has none."""
    stages = describe(locator)
    found = {one.name: stages[one.stage].get(one.parameter, "-") for one in varied}
    return {name: v if isinstance(v, str) else json.dumps(v) for name, v in found.items()}
