"""The README and the guides: every command in them runs, in order, in a folder of its own.

A block of `sh` is run. One that cannot be run here (it needs cameras, or an hour) stands after
`<!-- not run: why -->`. No block with a command may be neither.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ELSEWHERE = {"interchange.md", "catalog.md"}  # need what their own tests make
GUIDES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
GUIDES = [guide for guide in GUIDES if guide.name not in ELSEWHERE]
BLOCK = re.compile(
    r"(?P<excuse><!-- not run: [^>]+ -->\n+)?^```(?P<language>\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


def blocks(guide: Path) -> list[re.Match[str]]:
    return list(BLOCK.finditer(guide.read_text(encoding="utf-8")))


def in_language(guide: Path, language: str) -> list[str]:
    """The blocks to run."""
    return [b["text"] for b in blocks(guide) if b["language"] == language and not b["excuse"]]


def with_blocks(language: str) -> pytest.MarkDecorator:
    """Run a test for each guide that has blocks of that language to run."""
    having = [guide for guide in GUIDES if in_language(guide, language)]
    return pytest.mark.parametrize("guide", having, ids=lambda path: path.name)


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.name)
def test_every_block_of_commands_is_run_or_says_why_not(guide: Path) -> None:
    text = guide.read_text(encoding="utf-8")
    commands = [
        b for b in blocks(guide) if re.search(r"^(pomolog|make|python) ", b["text"], re.MULTILINE)
    ]
    assert not [b["text"] for b in commands if b["language"] != "sh" and not b["excuse"]]
    assert not re.search(r"^    (pomolog|make|python) ", text, re.MULTILINE), (
        "a block without its fence"
    )


@pytest.mark.parametrize(
    "guide", [g for g in GUIDES if in_language(g, "python")], ids=lambda p: p.name
)
def test_the_examples_in_python_run_one_after_the_other(guide: Path, tmp_path: Path) -> None:
    (tmp_path / "sessions").symlink_to(ROOT / "sessions")
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-c", "\n".join(in_language(guide, "python"))],
        cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert not ran.returncode, ran.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "guide", [g for g in GUIDES if in_language(g, "sh")], ids=lambda path: path.name
)
def test_the_commands_run_one_after_the_other(guide: Path, tmp_path: Path) -> None:
    (tmp_path / "sessions").symlink_to(ROOT / "sessions")
    programs = tmp_path / "programs"
    programs.mkdir()
    for name, words in (("pomolog", "-m pomolog"), ("python", "")):
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n', encoding="utf-8")
        program.chmod(0o755)
    environ = os.environ | {
        "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "COLUMNS": "100",
    }  # fmt: skip
    ran = subprocess.run(
        ["bash", "-ex", "-c", "\n".join(in_language(guide, "sh"))],
        cwd=tmp_path, env=environ, capture_output=True, text=True, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert not ran.returncode, f"{ran.stdout}\n{ran.stderr}"
