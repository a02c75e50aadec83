"""The front door: one command, a line for each sub-command, and nothing heavy imported."""

import os
import signal
import sys
from importlib import import_module
from io import TextIOWrapper
from typing import Final, NamedTuple

from recorder.errors import PomologError


class Command(NamedTuple):
    """A sub-command: the module whose `app` has it, and its line in the help."""

    module: str
    summary: str


COMMANDS: Final[dict[str, Command]] = {
    "record": Command("recorder.cli", "record cameras and a rangefinder in the field"),
    "import": Command("recorder.imports.cli", "make a session from pictures, or from a bag"),
    "label": Command("recorder.imports.cli", "give a session truth: masks, boxes, circles, apples"),
    "calibrate": Command("recorder.calibrate.cli", "make a rig of pictures of a board"),
    "rig": Command("recorder.calibrate.cli", "convert calibrations: ours, OpenCV, ROS, Kalibr"),
    "simulate": Command("recorder.cli", "make a session in the digital orchard"),
    "info": Command("recorder.cli", "say what a session holds"),
    "check": Command("recorder.cli", "read all of a session and say whether it is sound"),
    "salvage": Command("recorder.cli", "make a whole session of a torn one"),
    "replay": Command("processor.cli", "run the locator on sessions and keep every intermediate"),
    "methods": Command("processor.cli", "list the methods, or print one as TOML"),
    "train": Command("processor.cli", "learn a model for method pomolog"),
    "score": Command("processor.cli", "hits, false positives, matches and distance errors"),
    "compare": Command("processor.compare.cli", "run against run: better, worse, or not known"),
    "export": Command("processor.cli", "give a session or results to ROS, labelling tools, tables"),
    "sweep": Command("processor.sweep.cli", "try many settings: best on train, worth on test"),
    "paper": Command("processor.cli", "every table and figure of the paper, beside ours"),
    "view": Command("viewer.cli", "open a run, or a session, in Rerun"),
    "report": Command("viewer.cli", "one page to send: score, plots, worst cases in pictures"),
    "sheet": Command("viewer.cli", "every stage of one frame in one picture"),
    "demo": Command("viewer.cli", "all of it, on a session that comes with pomolog"),
}


COMPLETION: Final = ("--install-completion", "--show-completion")


def usage() -> str:
    """The text of `pomolog --help`."""
    lines = [f"  {name:10} {command.summary}" for name, command in COMMANDS.items()]
    return "\n".join(
        (
            "Usage: pomolog COMMAND [OPTIONS] [ARGUMENTS]",
            "",
            "Record an orchard once. Replay it for ever: every stage of the fruit locator",
            "visible, scored and comparable.",
            "",
            "Commands:",
            *lines,
            "",
            "Example: pomolog replay sessions/demo.mcap -o results",
            "Each command has its own help: pomolog replay --help",
            "Commands and options complete themselves after: pomolog --install-completion",
        )
    )


def main() -> None:
    """Run one sub-command. Exit 0 done, 1 an expected failure, 2 wrong usage."""
    words = sys.argv[1:]
    if "_POMOLOG_COMPLETE" in os.environ or (words[:1] and words[0] in COMPLETION):
        _complete()
    if not words or words[0] in ("-h", "--help", "help"):
        print(usage())
        sys.exit(0 if words else 2)
    if words[0] == "--version":
        from importlib.metadata import version

        print(f"pomolog {version('pomolog')}")
        sys.exit(0)
    command = COMMANDS.get(words[0])
    if command is None:
        print(f"pomolog: no command {words[0]!r}; see: pomolog --help", file=sys.stderr)
        sys.exit(2)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file's name need not be text
    signal.signal(signal.SIGINT, _stop)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that half-written files go
    try:
        import_module(command.module).app(args=words, prog_name="pomolog")
    except PomologError as error:
        print(f"pomolog: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(1)


def _complete() -> None:
    """Let typer answer the shell, or install what asks it, with all commands in one app."""
    import typer

    whole = typer.Typer(rich_markup_mode=None)
    for module in dict.fromkeys(command.module for command in COMMANDS.values()):
        part = import_module(module).app
        whole.registered_commands += part.registered_commands
        whole.registered_groups += part.registered_groups
    whole(prog_name="pomolog")


def _stop(*_: object) -> None:
    print("pomolog: stopped", file=sys.stderr)
    sys.exit(130)


if __name__ == "__main__":
    main()
