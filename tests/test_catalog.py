"""The worked examples of docs/catalog.md, run as they stand there."""

import contextlib
import importlib.util
import io
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from processor.replay import Replayed, replay
from tests.scenes import TINY, apple, stereo_session, tiny_rig

PAGE = Path(__file__).parent.parent / "docs" / "catalog.md"


@pytest.fixture
def results(tmp_path: Path) -> Iterator[Path]:
    """Two methods' runs on one session of two pairs, where the page looks for them."""
    if importlib.util.find_spec("datafusion") is None:
        message = "NOT TESTED: docs/catalog.md; install the extra catalog"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    frames = [[apple(1, seen=1.0)], [apple(2, 0.02, seen=1.0)]]
    session = stereo_session(tmp_path / "row.mcap", frames, rig=tiny_rig())
    for method in ("one", "two"):
        (done,) = replay([session], tmp_path / "results" / method, TINY, method=method)
        assert isinstance(done, Replayed)
    with contextlib.chdir(tmp_path):
        yield tmp_path


@pytest.mark.usefixtures("results")
@pytest.mark.filterwarnings("ignore")  # of other people's libraries
def test_every_example_runs_and_says_something_of_both_methods() -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 4
    names: dict[str, Any] = {}
    said = []
    try:
        for block in blocks:
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(block, str(PAGE), "exec"), names)  # our own page
            said.append(printed.getvalue())
    finally:
        if "server" in names:
            names["server"].shutdown()
    assert all(f"-{method}" in said[1] for method in ("one", "two"))  # where it is most wrong
    assert "blown_out" in said[2]
    assert said[3].count("row-") == 2
