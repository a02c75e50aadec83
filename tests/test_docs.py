"""The documents: every link leads somewhere, and the site of them is built without a warning."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCUMENTS = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "sessions" / "README.md"]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_relative_link_leads_to_a_file(document: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)", document.read_text(encoding="utf-8"))
    files = [link for link in links if "://" not in link]
    missing = [link for link in files if not (document.parent / link).exists()]
    assert not missing


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    made = subprocess.run(
        [sys.executable, "-m", "sphinx", "-b", "html", "-nWq", "--keep-going", "-d",
         tmp_path / "doctrees", "docs", tmp_path / "site"],
        capture_output=True, text=True, cwd=ROOT, check=False,
    )  # fmt: skip
    assert not made.returncode, made.stderr
    commands = (tmp_path / "site/reference/commands.html").read_text(encoding="utf-8")
    assert "pomolog import frames" in commands
