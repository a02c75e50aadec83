"""A page opened in headless Chromium, and what the browser complains of."""

import subprocess
from pathlib import Path

from tests.visual.needs import browser


def opened(page: Path, profile: Path) -> tuple[str, list[str]]:
    """The document as the browser has it, and every line of its console.

    Skips loudly where there is no browser; continuous integration must have one.
    """
    command = [
        browser(page.name), "--headless", "--disable-gpu", "--no-sandbox",
        "--enable-logging=stderr",
        f"--user-data-dir={profile}", "--dump-dom", page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]
