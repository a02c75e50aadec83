"""Every error that a user can meet says what to do now."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parent.parent
# how a line says what now: a second half, a question, a command, or what there is to choose from
NOW = re.compile(
    r"[;?]|try:|\bgive\b|choose|must be|\bneed|there are|it has|takes|no go:|only|see docs"
)
# these need not, and why
NEED_NOT = {
    "closed": "the loop that raises it catches it",
    "--vary {said}: {error}": "passes on an error, which says it",
}


def reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference", ROOT / "docs" / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_error_says_what_now() -> None:
    silent, excused = [], set()
    for path, line, message in reference().messages():
        words = re.sub(r"\{[^{}]*\}", "", message).strip(" :.,()")
        if message in NEED_NOT:
            excused.add(message)
        elif words and not NOW.search(message):
            silent.append(f"{path.relative_to(ROOT)}:{line}: {message}")
    assert not silent, "\n".join(silent)
    assert excused == NEED_NOT.keys(), "gone from the code; take it out here too"
