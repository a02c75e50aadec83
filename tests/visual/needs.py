"""What these tests need of the machine: its absence is said loudly, and fails where CI=true."""

import os
import shutil
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
LAVAPIPE = "lvp_icd"  # Mesa's Vulkan on the processor


def vulkan() -> Path:
    """Mesa's software Vulkan driver."""
    folders = [Path(f"{root}/vulkan/icd.d") for root in ("/usr/share", "/etc", "/usr/local/share")]
    found = [file for folder in folders for file in sorted(folder.glob(f"{LAVAPIPE}*.json"))]
    if not found:
        _missing("the viewer's pictures", "mesa-vulkan-drivers")
    return found[0]


def browser(what: str = "the web viewer") -> str:
    """A Chromium, for what is to be looked at."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        _missing(what, "chromium")
    assert found is not None
    return found


def _missing(what: str, package: str) -> None:
    message = f"NOT TESTED: {what}; install {package}"
    if os.environ.get("CI") == "true":
        pytest.fail(message)
    pytest.skip(message)
