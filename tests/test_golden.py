"""Replaying the demo gives what it gave; see tests/golden/update.py."""

import json
from pathlib import Path
from typing import Any

import pytest

from processor.methods import METHODS
from tests.golden.update import (
    APPLE_FIELDS,
    COMMAND,
    FRAME_FIELDS,
    REFERENCE,
    Golden,
    measure,
    read,
    write,
)

Fields = dict[str, tuple[float, str]]

pytestmark = pytest.mark.xdist_group("golden")  # one replay of the demo serves all of them


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Golden:
    return measure(tmp_path_factory.mktemp("golden"))


def differences(
    found: list[list[Any]], wanted: list[list[Any]], fields: Fields, *, relative: bool
) -> list[str]:
    """What is out of its field's tolerance, a line each."""
    if len(found) != len(wanted):
        return [f"{len(found)} rows, not {len(wanted)}"]
    said = []
    for number, (row, reference) in enumerate(zip(found, wanted, strict=True)):
        tolerances = {"frame": (0.0, "a count"), **fields}
        for (name, (tolerance, _)), new, old in zip(
            tolerances.items(), row, reference, strict=True
        ):
            both = new is not None and old is not None
            limit = tolerance * abs(old) if relative and both else tolerance
            if new != old and not (both and abs(new - old) <= limit):
                said.append(f"row {number} {name}: {new}, not {old}")
    return said


def fail_where(different: list[str], what: str) -> None:
    if different:
        shown = "\n  ".join(different[:10])
        pytest.fail(
            f"{what} moved in {len(different)} places:\n  {shown}\n"
            f"if that is meant, update the reference with: {COMMAND}"
        )


def test_the_reference_has_every_named_method() -> None:
    fail_where(sorted(read()["frames"].keys() ^ METHODS.keys()), "the methods")


@pytest.mark.parametrize("method", METHODS)
def test_the_demos_counts_are_the_references(method: str, measured: Golden) -> None:
    found, wanted = measured["frames"][method], read()["frames"].get(method, [])
    fail_where(differences(found, wanted, FRAME_FIELDS, relative=True), f"{method}'s counts")


def test_the_papers_apples_in_the_demo_are_the_references(measured: Golden) -> None:
    different = differences(measured["apples"], read()["apples"], APPLE_FIELDS, relative=False)
    fail_where(different, "the apples")


def test_a_difference_is_told_with_the_command_that_updates_the_reference() -> None:
    wanted = read()["apples"]
    moved = [list(row) for row in wanted]
    moved[3][1] = (moved[3][1] or 0.0) + 0.01
    different = differences(moved, wanted, APPLE_FIELDS, relative=False)
    assert len(different) == 1
    assert different[0].startswith("row 3 left_x_px: ")
    with pytest.raises(pytest.fail.Exception, match=COMMAND):
        fail_where(different, "the apples")


def test_a_field_that_vanished_or_a_row_too_many_is_a_difference() -> None:
    fields = {"z_m": (1e-5, "")}
    assert differences([[0, None]], [[0, 0.7]], fields, relative=False)
    assert differences([[0, 0.7]], [[0, None]], fields, relative=False)
    assert differences([[0, 0.7], [0, 0.8]], [[0, 0.7]], fields, relative=False)
    assert not differences([[0, 0.700009]], [[0, 0.7]], fields, relative=False)


def test_writing_the_reference_anew_changes_nothing_that_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = REFERENCE.read_text()
    monkeypatch.setattr("tests.golden.update.REFERENCE", tmp_path / "demo.json")
    write({"frames": {}, "apples": [[0, 1.5]]})
    assert (tmp_path / "demo.json").read_text().startswith('{"frames"')
    write(json.loads(text))
    assert (tmp_path / "demo.json").read_text() == text
    assert len(text) < 100_000
