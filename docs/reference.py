"""The reference pages, made from the code that they describe."""

import ast
import inspect
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import MISSING, Field, fields
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.testing import CliRunner

from pomolog import COMMANDS
from processor.columns import meaning
from processor.methods import METHODS, STAGES
from processor.results import TABLES
from recorder.errors import PomologError
from recorder.messages import SCHEMAS
from recorder.profile import MEANINGS, PROFILE, TOPICS

ROOT = Path(__file__).parent.parent
PACKAGES = ("recorder", "processor", "viewer")
ERRORS = {PomologError.__name__} | {kind.__name__ for kind in PomologError.__subclasses__()}
MADE = "<!-- Made from the code by docs/reference.py. -->"


def write(folder: Path) -> None:
    """Write every page into `folder`; one whose text is as it was keeps its time."""
    folder.mkdir(exist_ok=True)
    for name, page in PAGES.items():
        path, text = folder / f"{name}.md", "\n".join((MADE, *page(), ""))
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def session() -> Iterator[str]:
    """The topics of a session, and the fields of our own messages."""
    yield f"# The session profile `{PROFILE}`"
    yield "\nOne MCAP file; see also [the architecture](../architecture.md#the-session).\n"
    yield from table(
        ("topic", "schema", "meaning"),
        (
            (f"`{topic}`", f"`{kind.DESCRIPTOR.full_name}`", MEANINGS[topic])
            for topic, kind in TOPICS.items()
        ),
    )
    yield "\nMessages of our own (`?` may be absent, `*` repeats):\n"
    for message, columns in SCHEMAS.items():
        yield f"## pomolog.{message}\n"
        yield from table(("field", "type"), ((f"`{c}`", f"`{t}`") for c, t in columns.items()))


def results() -> Iterator[str]:
    """The columns of every Parquet file that `replay` writes."""
    yield "# The columns of results"
    yield "\n`pomolog replay S.mcap -o OUT` writes these files into `OUT/S/`, beside `run.json`."
    for name, schema in TABLES.items():
        yield f"\n## {name}.parquet\n"
        rows = ((f"`{f.name}`", f"`{f.type}`", meaning(f.name) or "") for f in schema)
        yield from table(("column", "type", "meaning"), rows)


def commands() -> Iterator[str]:
    """Every command as its own help has it."""
    yield "# Commands"
    yield (
        "\nExit code 0: done. 1: an expected failure; one line says what, where and what now. "
        "2: wrong usage."
    )
    for name, front in COMMANDS.items():
        app = import_module(front.module).app
        groups = {group.name: group.typer_instance for group in app.registered_groups}
        inner = groups[name].registered_commands if name in groups else []
        for words in [[name, _name(child)] for child in inner] or [[name]]:
            yield f"\n## pomolog {' '.join(words)}\n"
            yield f"```text\n{_help(app, words)}\n```"


def _name(command: Any) -> str:
    return str(command.name or command.callback.__name__.strip("_").replace("_", "-"))


def _help(app: typer.Typer, words: list[str]) -> str:
    """The help as a terminal of 96 columns shows it."""
    plain = {"COLUMNS": "96", "NO_COLOR": "1", "TERM": "dumb"}
    shown = CliRunner().invoke(app, [*words, "--help"], env=plain, prog_name="pomolog")
    if shown.exit_code:
        raise RuntimeError(f"pomolog {' '.join(words)} --help: {shown.output}")
    lines = [line.rstrip() for line in shown.output.splitlines()]
    return re.sub(r"\n{2,}", "\n\n", "\n".join(lines)).strip()


def methods() -> Iterator[str]:
    """Every method, and every alternative of a stage with its parameters and their sources."""
    yield "# Methods and their parameters"
    yield "\nA method names an alternative for each stage; `pomolog methods NAME` prints it.\n"
    yield from table(
        ("method", *STAGES),
        (
            (f"`{name}`", *(f"`{type(getattr(locator, stage)).__name__}`" for stage in STAGES))
            for name, locator in METHODS.items()
        ),
    )
    for stage, alternatives in STAGES.items():
        yield f"\n## {stage}"
        for name, kind in alternatives.items():
            yield f"\n### {name}\n"
            text, meanings = _split(inspect.cleandoc(kind.__doc__ or ""))
            yield text
            sources = _comments(kind)
            rows = [
                (f"`{f.name}`", _default(f), meanings.get(f.name, ""), sources.get(f.name, ""))
                for f in fields(kind)
            ]
            yield from table(("parameter", "default", "meaning", "source"), rows) if rows else ()


def _split(docstring: str) -> tuple[str, dict[str, str]]:
    """A class docstring without its `Attributes:`, and what they say of each field."""
    text, _, attributes = docstring.partition("Attributes:\n")
    entries = re.split(r"^    (?=\w+: )", attributes, flags=re.MULTILINE)[1:]
    pairs = (entry.split(": ", 1) for entry in entries)
    return text, {name: " ".join(meaning.split()) for name, meaning in pairs}


def errors() -> Iterator[str]:
    """Every error that a user can meet, by the file that says it."""
    yield "# Errors"
    yield (
        "\nAn expected failure is one line on stderr (what, where, what now) and exit code 1. "
        "What stands in braces is filled in. Anything else that is printed is a bug of ours.\n"
    )
    by_file: dict[Path, list[str]] = {}
    for path, _, message in messages():
        by_file.setdefault(path.relative_to(ROOT), []).append(message)
    for path, found in by_file.items():
        yield f"\n## {path}\n"
        yield from (f"- `{message}`" for message in found)


def messages() -> Iterator[tuple[Path, int, str]]:
    """Every message of a PomologError in the code: its file, line, and words."""
    for path in sorted(p for d in PACKAGES for p in (ROOT / d).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and _is_error(node.func) and node.args:
                yield path, node.lineno, _text(node.args[0])


def _is_error(called: ast.expr) -> bool:
    return isinstance(called, ast.Name) and called.id in ERRORS


def _text(message: ast.expr) -> str:
    if isinstance(message, ast.Constant):
        return str(message.value)
    if isinstance(message, ast.JoinedStr):
        return "".join(_text(part) for part in message.values)
    inner = message.value if isinstance(message, ast.FormattedValue) else message
    return "{" + ast.unparse(inner) + "}"


def _default(parameter: "Field[Any]") -> str:
    if parameter.default is MISSING:
        return "learned"
    text = repr(parameter.default)
    return f"`{text}`" if len(text) <= 60 else f"`{type(parameter.default).__name__}(...)`"


def _comments(kind: type) -> dict[str, str]:
    """What stands behind a field in its class: the source of its default."""
    lines = inspect.getsource(kind).splitlines()
    found = (re.match(r"\s+(\w+): .+?\s{2}# (.+)$", line) for line in lines)
    return {match[1]: match[2] for match in found if match}


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """A Markdown table."""
    yield f"\n| {' | '.join(head)} |"
    yield f"|{'---|' * len(head)}"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
    yield ""


PAGES = {
    "session": session, "results": results, "commands": commands, "methods": methods,
    "errors": errors,
}  # fmt: skip
