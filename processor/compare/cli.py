"""The command compare."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from recorder.commands import AsJson, command_group
from recorder.errors import PomologError

app = command_group()


@app.command(
    epilog="Example: pomolog compare results/main results/new --gate gate.toml --junit g.xml"
)
def compare(
    a: Annotated[str, typer.Argument(metavar="A", help="Results: the reference; A1,A2: repeats.")],
    b: Annotated[str, typer.Argument(metavar="B", help="Results: the candidate; B1,B2: repeats.")],
    gate: Annotated[Path | None, typer.Option(help="Limits (TOML) that B must keep.")] = None,
    unit: Annotated[str, typer.Option(help="What is independent: pair, or session.")] = "pair",
    moved_mm: Annotated[float, typer.Option(min=0, help="Fruit further apart moved.")] = 5.0,
    markdown: Annotated[Path | None, typer.Option(help="Write the report there too.")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML there.")] = None,
    fruit: Annotated[Path | None, typer.Option(help="Write each changed fruit (Parquet).")] = None,
    as_json: AsJson = False,
) -> None:
    """What B gains and loses against A, and whether the data can tell it from chance.

    A and B are folders that pomolog replay -o made, of the same sessions. Commas between folders
    name repeats with other seeds: A1,A2 B1,B2. With --gate, exit 1 where B fails it.
    """
    from processor.compare.comparison import compare as hold
    from processor.compare.document import as_document
    from processor.compare.gate import check, load_gate
    from processor.compare.junit import as_junit
    from processor.compare.report import as_markdown
    from processor.compare.sides import open_sides
    from processor.results import CHANGES, write_table
    from recorder.files import write_text

    if unit not in ("pair", "session"):
        raise typer.BadParameter("pair or session", param_hint="--unit")
    limits = None if gate is None else load_gate(gate)
    found = hold(
        open_sides(a, b),
        unit="pair" if unit == "pair" else "session",
        moved_m=moved_mm / 1e3,
        matters={} if limits is None else limits.matters,
    )
    checked = None if limits is None else check(limits, found)
    report = as_markdown(found, checked or ())
    if markdown is not None:
        write_text(markdown, report)
    if junit is not None:
        write_text(junit, as_junit(found, checked))
    if fruit is not None:
        write_table(fruit, [asdict(one) for one in found.changes], CHANGES)
    print(json.dumps(as_document(found, checked), indent=2) if as_json else report)
    failed = [f"gate: {one.line}" for one in checked or () if not one.passed]
    for line in failed[:-1]:
        typer.echo(f"pomolog: {line}", err=True)
    if failed:
        raise PomologError(failed[-1])
