"""Models on the disk."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processor.model_file import load_model, model_digest, save_model
from recorder.errors import PomologError


def test_a_model_written_is_the_model_read(tmp_path: Path) -> None:
    shipped = load_model("pomolog-4")
    path = tmp_path / "mine.npz"
    save_model(shipped, path, {"made_by": "a test"})
    again = load_model(str(path))
    np.testing.assert_array_equal(again.colours.colour, shipped.colours.colour)
    np.testing.assert_array_equal(again.match.pair.weights[0], shipped.match.pair.weights[0])
    assert again.range.spread == shipped.range.spread
    assert '"made_by": "a test"' in path.with_suffix(".json").read_text()
    assert len(model_digest(str(path))) == 12


@pytest.mark.parametrize("content", [b"", b"text", b"PK\x03\x04"])
def test_what_is_no_model_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(PomologError, match="is no model"):
        load_model(str(path))


def test_a_model_of_other_measures_is_refused(tmp_path: Path) -> None:
    shipped = load_model("pomolog-4")
    path = tmp_path / "other.npz"
    odd = replace(shipped, match=replace(shipped.match, pair=shipped.fruit.quality))
    save_model(odd, path, {})
    with pytest.raises(PomologError, match=r"network pair is not of \d+ measures"):
        load_model(str(path))


def test_an_unknown_name_lists_the_known() -> None:
    with pytest.raises(PomologError, match="pomolog-4"):
        load_model("best")


def test_the_shipped_model_says_where_it_comes_from() -> None:
    path = Path(__file__).parents[1] / "processor" / "models" / "pomolog-4.json"
    said = path.read_text()
    assert "fingerprint" in said
    assert '"split": "test"' not in said
