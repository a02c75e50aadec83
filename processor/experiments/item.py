"""One item of the paper, reproduced: its claims beside ours, its tables, figures and sentences."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from processor.page_parts import Column, Figure, Table

Verdict = Literal["holds", "in part", "does not hold", "not in the paper", "not scored"]


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
