"""The front door: help without heavy imports, completion, versions, unknown words."""

import os
import subprocess
import sys
from importlib import import_module

import pytest

from benchmarks.start import help_start
from pomolog import COMMANDS


def run(*words: str, **environ: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "pomolog", *words],
        capture_output=True, text=True, check=False, env=os.environ | environ,
    )  # fmt: skip


def test_help_names_every_command_and_no_words_are_wrong_usage() -> None:
    shown = run("--help")
    assert not shown.returncode
    assert all(f"  {name} " in shown.stdout for name in COMMANDS)
    assert run().returncode == 2
    assert "no command 'fly'" in run("fly").stderr


def test_help_loads_nothing_that_only_commands_need() -> None:
    heavy = {"numpy", "cv2", "typer", "rerun", "importlib.metadata"}
    code = (
        "import sys; sys.argv = ['pomolog', '--help']; import pomolog\n"
        "try: pomolog.main()\n"
        "except SystemExit: print(*sorted(sys.modules))"
    )
    before = run_python("import sys; print(*sorted(sys.modules))")
    loaded = run_python(code)
    assert not (loaded - before) & heavy


def test_the_benchmark_of_the_start_compares_two_starts() -> None:
    ((name, ratios),) = help_start(2).items()
    assert "--help" in name
    assert len(ratios) == 2
    assert min(ratios) > 0


def run_python(code: str) -> set[str]:
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(ran.stdout.split())


@pytest.mark.parametrize(
    ("typed", "word", "offered"),
    [("pomolog sal", "1", "salvage"), ("pomolog replay --meth", "2", "--method"),
     ("pomolog import fr", "2", "frames")],
)  # fmt: skip
def test_the_shell_completes_commands_and_options(typed: str, word: str, offered: str) -> None:
    asked = run(_POMOLOG_COMPLETE="complete_bash", COMP_WORDS=typed, COMP_CWORD=word)
    assert asked.stdout.split() == [offered]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_ends_its_help_with_an_example(name: str) -> None:
    app = import_module(COMMANDS[name].module).app
    group = next((g for g in app.registered_groups if g.name == name), None)
    inside = app.registered_commands if group is None else group.typer_instance.registered_commands
    asked = [c for c in inside if group or (c.name or c.callback.__name__.strip("_")) == name]
    assert asked
    assert all("Example" in (command.epilog or "") for command in asked)
