"""One item of the paper, reproduced: its claims beside ours, its tables, figures and sentences."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

Scalar = str | int | float | bool | None
Verdict = Literal["holds", "in part", "does not hold", "not in the paper", "not scored"]

NOT_SCORED = "not scored"


@dataclass(frozen=True, slots=True)
class Claim:
    """One number of the paper beside ours.

    Attributes:
        what: what is measured.
        paper: the paper's value; None where it gives none.
        ours: ours; None where nothing could be scored.
        unit: "%", "mm", "ms", or nothing.
        digits: after the point, where it is shown.
        low: the lower end of our 95 % interval.
        high: its upper end.
        verdict: whether the paper's statement holds here.
        sentence: what it means, in plain words.
    """

    what: str
    paper: float | None
    ours: float | None
    unit: str = ""
    digits: int = 1
    low: float | None = None
    high: float | None = None
    verdict: Verdict = "not in the paper"
    sentence: str = ""

    @property
    def difference(self) -> float | None:
        """Ours minus the paper's."""
        return None if self.paper is None or self.ours is None else self.ours - self.paper


@dataclass(frozen=True, slots=True)
class Column:
    """A table's column: its heading and how many digits its numbers show after the point."""

    label: str
    digits: int = 1


@dataclass(frozen=True, slots=True)
class Table:
    """Rows for people and for Parquet; None is "not scored", a dash in print.

    Attributes:
        name: of its files.
        caption: one sentence.
        columns: key -> column.
        rows: one mapping a row; keys that are no column go to Parquet alone.
    """

    name: str
    caption: str
    columns: Mapping[str, Column]
    rows: Sequence[Mapping[str, Scalar]]


@dataclass(frozen=True, slots=True)
class Figure:
    """A drawn figure. `png` is empty once it has been written to the disk."""

    name: str
    caption: str
    png: bytes = b""


@dataclass(frozen=True, slots=True)
class Item:
    """One item of the paper.

    Attributes:
        id: what `--only` calls it.
        source: where the paper has it.
        title: what it shows.
        summary: the plain sentence.
        method: how it was measured here, criteria and choices.
        material: which sessions, how many pairs, which split.
        claims: numbers beside the paper's.
        tables: for people and Parquet.
        figures: drawn.
        not_run: why it could not be run and what would help; empty where it was run.
    """

    id: str
    source: str
    title: str
    summary: str = ""
    method: str = ""
    material: str = ""
    claims: tuple[Claim, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    not_run: str = ""

    def as_json(self) -> dict[str, Any]:
        """Everything but the pictures, ready for JSON."""
        bare = replace(self, figures=tuple(replace(figure, png=b"") for figure in self.figures))
        told = asdict(bare)
        for figure in told["figures"]:
            del figure["png"]
        for claim, record in zip(self.claims, told["claims"], strict=True):
            record["difference"] = claim.difference
        return told


def item_from_json(told: Mapping[str, Any]) -> Item:
    """An item from what `as_json` gave, its figures without their pictures."""
    claims = [{k: v for k, v in claim.items() if k != "difference"} for claim in told["claims"]]
    tables = [
        Table(
            table["name"],
            table["caption"],
            {key: Column(**column) for key, column in table["columns"].items()},
            table["rows"],
        )
        for table in told["tables"]
    ]
    plain = {key: told[key] for key in ("id", "source", "title", "summary", "method", "material")}
    return Item(
        **plain,
        claims=tuple(Claim(**claim) for claim in claims),
        tables=tuple(tables),
        figures=tuple(Figure(**figure) for figure in told["figures"]),
        not_run=told["not_run"],
    )


def shown(value: Scalar, digits: int = 1, *, signed: bool = False) -> str:
    """A table's cell: numbers with their digits, a dash where nothing was scored."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        text = format(value, f"{'+' if signed else ''}.{digits}f")
        return text.replace("-", "−") if any(c in "123456789" for c in text) else text.lstrip("-")
    return f"{value:+d}" if signed and isinstance(value, int) else str(value)


def percent(share: float | None) -> float | None:
    """A share as percent; None stays None."""
    return None if share is None else 100.0 * share


def millimetres(metres: float | None) -> float | None:
    """Metres as millimetres; None stays None."""
    return None if metres is None else 1000.0 * metres
