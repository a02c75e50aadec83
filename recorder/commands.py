"""How every module of commands begins: one kind of group, so that all commands behave alike."""

import typer


def command_group() -> typer.Typer:
    """A group whose commands the front door shows: `-h` works, a bug shows its plain traceback.

    Completion is the front door's own, for all groups together.
    """
    return typer.Typer(
        add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )  # fmt: skip
