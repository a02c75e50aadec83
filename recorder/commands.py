"""How every module of commands begins: one kind of group, and the options that many share."""

from pathlib import Path
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")]
SessionArgument = Annotated[Path, typer.Argument(metavar="S", help="A session (.mcap).")]
SessionOutput = Annotated[Path, typer.Option("--out", "-o", help="The session to write.")]


def command_group() -> typer.Typer:
    """A group whose commands the front door shows: `-h` works, a bug shows its plain traceback.

    Completion is the front door's own, for all groups together.
    """
    group = typer.Typer(
        add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )  # fmt: skip
    group.callback()(_keep_names)
    return group


def _keep_names() -> None:
    """Without a callback, a group of one command would be that command and take no name."""
