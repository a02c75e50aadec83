"""Every alternative and every named method, and their way through TOML."""

import json
import tomllib
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest

from processor.circles import RandomRing
from processor.locate import Locator
from processor.methods import METHODS, STAGES, describe, load_method, locator_from, to_toml
from processor.recognise import ColourRatio, TwoRedMinusGreenBlue
from processor.trace import Beam, Sensed
from recorder.errors import PomologError
from recorder.records import Depth
from recorder.rectify import rectify
from tests.scenes import apple, located, pair_of, small_rig

ALTERNATIVES = [(stage, name) for stage, table in STAGES.items() for name in table]


def assert_finds_the_apple(locator: Locator) -> None:
    front = Beam(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.36, 0.001)
    depth = Depth(0, "32FC1", np.full((240, 320), 0.36, "<f4").tobytes(), (320, 240))
    sensed = Sensed((front,), depth)  # for stages that want it
    trace = locator(*pair_of(small_rig(), apple(1)), rectify(small_rig()), sensed=sensed)
    ((_, _, z_m),) = located(trace)
    # 4 px of 60 px disparity: what two circles of a 5 px ring may be off
    assert z_m == pytest.approx(0.4, rel=4 / 60)


@pytest.mark.parametrize(("stage", "name"), ALTERNATIVES)
def test_every_alternative_of_every_stage_locates_an_apple(stage: str, name: str) -> None:
    assert_finds_the_apple(locator_from({stage: {"use": name}}))


@pytest.mark.parametrize("name", METHODS)
def test_every_named_method_locates_an_apple(name: str) -> None:
    chosen, locator = load_method(name)
    assert chosen == name
    assert_finds_the_apple(locator)


@pytest.mark.parametrize("name", METHODS)
def test_a_method_survives_its_description_and_json(name: str) -> None:
    described = describe(METHODS[name])
    assert locator_from(described) == METHODS[name]
    assert locator_from(json.loads(json.dumps(described))) == METHODS[name]


@pytest.mark.parametrize("name", METHODS)
def test_a_method_survives_toml(name: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(to_toml(name, METHODS[name]))
    assert tomllib.loads(path.read_text()).keys() == STAGES.keys()
    assert load_method(str(path)) == ("mine", METHODS[name])


def test_the_papers_numbers_are_the_defaults() -> None:
    assert describe(METHODS["paper"]) == {
        "recognise": {"use": "colour_ratio", "reading": "absolute"},
        "clean": {
            "use": "area_rule",
            "smallest_share": 1 / 8,
            "kernel_px": 3,
            "order": "area_first",
        },
        "circles": {
            "use": "random_ring",
            "rounds": 400,
            "ring_px": 5.0,
            "min_radius_px": 30.0,
            "max_radius_px": 60.0,
        },
        "match": {
            "use": "area_in_order",
            "largest_difference": 0.5,
            "in_order": True,
            "reference_line": True,
        },
        "triangulate": {"use": "parallel", "min_disparity_px": 1.0},
    }


def test_a_table_changes_what_it_names_and_keeps_the_rest_of_its_base() -> None:
    made = locator_from({"base": "2r-g-b", "circles": {"rounds": 50}})
    assert made == Locator(recognise=TwoRedMinusGreenBlue(), circles=RandomRing(rounds=50))


def test_a_parameter_alone_keeps_the_bases_other_parameters() -> None:
    made = locator_from({"base": "paper-signed", "recognise": {}})
    assert made.recognise == ColourRatio("signed")


def test_another_alternative_starts_from_its_own_defaults() -> None:
    made = locator_from({"recognise": {"use": "two_red_minus_green_blue", "threshold": 40}})
    assert made.recognise == TwoRedMinusGreenBlue(40.0)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"base": "best"}, "'best'"),
        ({"base": ["paper"]}, "base"),
        ({"colour": {}}, "[colour]"),
        ({"clean": 3}, "[clean]"),
        ({"clean": {"use": "magic"}}, "'magic'"),
        ({"clean": {"use": ["area_rule"]}}, "[clean] use"),
        ({"circles": {"round": 5}}, "'round'"),
        ({"circles": {"rounds": "many"}}, "[circles] rounds"),
        ({"circles": {"rounds": 2.5}}, "[circles] rounds"),
        ({"circles": {"rounds": -1}}, "[circles] rounds"),
        ({"circles": {"ring_px": float("nan")}}, "[circles] ring_px"),
        ({"circles": {"max_radius_px": float("inf")}}, "[circles] max_radius_px"),
        ({"circles": {"use": "hough", "votes": 0}}, "[circles] votes"),
        ({"circles": {"use": "hough", "canny": 0}}, "[circles] canny"),
        ({"circles": {"use": "hough", "min_radius_px": 0}}, "[circles] min_radius_px"),
        ({"circles": {"use": "hough", "margin_px": -1}}, "[circles] margin_px"),
        ({"clean": {"kernel_px": 0}}, "[clean] kernel_px"),
        ({"clean": {"smallest_share": -0.1}}, "[clean] smallest_share"),
        ({"match": {"largest_difference": -0.1}}, "[match] largest_difference"),
        ({"triangulate": {"min_disparity_px": -1}}, "[triangulate] min_disparity_px"),
        ({"recognise": {"reading": "literal"}}, "[recognise] reading"),
    ],
)
def test_an_error_names_the_key(table: dict[str, Any], words: str) -> None:
    with pytest.raises(PomologError) as caught:
        locator_from(table)
    assert words in str(caught.value)


def test_an_unknown_method_is_told_the_names() -> None:
    with pytest.raises(PomologError, match="paper-signed"):
        load_method("papre")


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "No such file"), (b"[clean", "not TOML"), (b"\xff\xfe", "not TOML"), (b"x = 1", "[x]")],
)
def test_a_bad_method_file_is_named(content: bytes | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(PomologError) as caught:
        load_method(str(path))
    assert str(path) in str(caught.value)
    assert words in str(caught.value)


EDGES = (-1, 0, 0.03, 1, 300)
NUMBERS = sorted(
    (stage, use, key)
    for stage, alternatives in STAGES.items()
    for use, kind in alternatives.items()
    for key, hint in get_type_hints(kind).items()
    if hint in (int, float)
)


@pytest.mark.parametrize(("stage", "use", "key"), NUMBERS)
def test_a_number_at_its_edge_works_or_is_refused(stage: str, use: str, key: str) -> None:
    rig = small_rig()
    pictures, rectification = pair_of(rig, apple(1)), rectify(rig)
    refused = []
    for value in EDGES:
        try:
            locator = locator_from({"base": "pomolog", stage: {"use": use, key: value}})
        except PomologError as error:
            refused.append(str(error))
        else:
            locator(*pictures, rectification)
    assert all(key in line for line in refused)
    assert len(refused) < len(EDGES)
