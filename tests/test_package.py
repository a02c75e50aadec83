"""The wheel: what is in it, and that it runs the demo far from the repository."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DATA = {".npz", ".json", ".toml", ".py", ""}  # beside code: models with their provenance, scenes


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", out],
        cwd=ROOT, check=True, capture_output=True,
    )  # fmt: skip
    (made,) = out.glob("*.whl")
    return made


def test_the_wheel_holds_the_packages_the_front_door_and_their_data(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = [n for n in archive.namelist() if ".dist-info/" not in n]
    assert {n.split("/")[0] for n in names} == {"recorder", "processor", "viewer", "pomolog.py"}
    assert {Path(n).suffix for n in names} <= DATA
    code = {str(p.relative_to(ROOT)) for d in ("recorder", "processor", "viewer")
            for p in (ROOT / d).rglob("*") if p.suffix in DATA and p.is_file()}  # fmt: skip
    assert set(names) == code | {"pomolog.py"}


@pytest.mark.slow
def test_the_wheel_runs_the_demo_far_from_the_repository(wheel: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    environ = os.environ | {"PYTHONPATH": str(tmp_path / "installed")}
    ran = subprocess.run(
        [sys.executable, "-c", "import pomolog; print(pomolog.__file__); pomolog.main()", "demo"],
        cwd=tmp_path, env=environ, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not ran.returncode, ran.stderr
    assert str(tmp_path / "installed") in ran.stdout
    assert (tmp_path / "results" / "demo" / "demo" / "trace.rrd").is_file()


def make(tmp_path: Path, python: str) -> subprocess.CompletedProcess[str]:
    """`make demo` with a program for Python, and a place for .venv that nobody uses."""
    program = tmp_path / "python"
    program.write_text(python, encoding="utf-8")
    program.chmod(0o755)
    environ = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}  # `make test` sets
    return subprocess.run(
        ["make", "demo", f"PYTHON={program}", f"VENV={tmp_path / 'venv'}"],
        cwd=ROOT, env=environ, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("lacks", "advice"),
    [("version_info", "make PYTHON=python3.12"), ("ensurepip", "sudo apt install python3-venv")],
)
def test_a_python_that_will_not_do_is_one_line_before_anything_is_made(
    lacks: str, advice: str, tmp_path: Path
) -> None:
    made = make(tmp_path, f'#!/bin/sh\ncase "$*" in *{lacks}*) exit 1;; esac\n')
    assert made.returncode
    assert made.stdout.count("\n") == 1
    assert advice in made.stdout
    assert not (tmp_path / "venv").exists()


def test_a_venv_that_was_not_finished_is_taken_away(tmp_path: Path) -> None:
    python = 'case "$*" in *-m\\ venv*) mkdir -p $3/bin; touch $3/bin/python; exit 1;; esac'
    assert make(tmp_path, f"#!/bin/sh\n{python}\n").returncode
    assert not (tmp_path / "venv").exists()
