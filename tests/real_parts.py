"""What a machine may lack: tests skip with a loud reason, and fail where CI=true."""

import os
import shutil
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from typing import NoReturn

import pytest


def missing(reason: str) -> NoReturn:
    """Skip, or fail on CI: there everything is installed."""
    if os.environ.get("CI") == "true":
        pytest.fail(f"{reason}; CI must not skip this: see .ci/run")
    pytest.skip(f"NOT TESTED: {reason}")


def need_module(module: str, extra: str) -> None:
    if find_spec(module) is None:
        missing(f"{module} is not installed (pip install 'pomolog[{extra}]')")


def need_root(what: str) -> None:
    if os.geteuid() != 0:
        missing(f"{what} needs root")


@cache
def _aravis_works() -> str:
    code = "import gi; gi.require_version('Aravis', '0.8'); from gi.repository import Aravis"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def need_aravis() -> None:
    """Aravis with its Python binding, and network namespaces to put cameras into."""
    if reason := _aravis_works():
        missing(f"no Aravis ({reason})")
    if shutil.which("unshare") is None or shutil.which("ip") is None:
        missing("no unshare or ip for a network namespace")
    done = subprocess.run(["unshare", "-rn", "true"], capture_output=True, check=False)
    if done.returncode:
        missing(f"no network namespaces here ({done.stderr.decode().strip()})")
