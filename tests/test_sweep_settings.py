"""What `--vary` may say, and the settings it makes."""

import pytest

from processor.locate import Locator
from processor.methods import METHODS
from processor.sweep.settings import MOST_SETTINGS, parse_vary, settings_of
from recorder.errors import PomologError


def test_every_combination_is_a_setting_and_the_method_itself_is_one_of_them() -> None:
    made = settings_of(Locator(), parse_vary(["circles.rounds=5,400", "recognise=colour_ratio"]))
    assert [(one.values, one.is_base, one.in_grid) for one in made] == [
        ({"circles.rounds": "5", "recognise": "colour_ratio"}, False, True),
        ({"circles.rounds": "400", "recognise": "colour_ratio"}, True, True),
    ]
    assert [one.locator.circles.rounds for one in made] == [5, 400]  # type: ignore[attr-defined]


def test_a_method_outside_the_grid_comes_after_it() -> None:
    made = settings_of(Locator(), parse_vary(["circles.rounds=5,10"]))
    assert [(one.number, one.is_base, one.in_grid) for one in made] == [
        (0, False, True), (1, False, True), (2, True, False),
    ]  # fmt: skip
    assert made[2].locator == Locator()
    assert made[2].values == {"circles.rounds": "400"}


def test_an_alternative_and_its_parameter_go_together() -> None:
    made = settings_of(Locator(), parse_vary(["circles=hough", "circles.votes=4,8"]))
    assert [one.values["circles.votes"] for one in made] == ["4.0", "8.0", "-"]  # rings have none
    assert made[0].values["circles"] == "hough"


def test_values_are_those_of_toml_and_else_text() -> None:
    (one,) = parse_vary(["match.in_order=true,false"])
    assert one.values == (True, False)
    (two,) = parse_vary(["clean.order=area_first,kernel_first"])
    assert two.values == ("area_first", "kernel_first")
    (three,) = parse_vary(["x.y=[1,2],[3,4]".replace("x.y", "circles.ring_px")])
    assert three.values == ([1, 2], [3, 4])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["circles.rounds"], "give values"),
        (["circles.rounds="], "give values"),
        (["circle.rounds=5"], "'circle'"),
        (["circles.rounds=5,5"], "twice"),
        (["circles.rounds=5", "circles.rounds=6"], "twice"),
    ],
)
def test_words_of_another_form_are_one_line(words: list[str], said: str) -> None:
    with pytest.raises(PomologError, match=said):
        parse_vary(words)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["circles.round=5"], "'round'"),
        (["circles=hoof"], "hoof"),
        (["circles.rounds=0"], "circles.rounds=0"),
        (["circles.rounds=many"], "many"),
        (["circles=hough", "circles.rounds=5"], "hough has no 'rounds'"),
        (["recognise.model=none.npz", "recognise=colour_table"], "none"),
    ],
)
def test_values_that_a_stage_does_not_take_are_one_line(words: list[str], said: str) -> None:
    with pytest.raises(PomologError, match=said) as error:
        settings_of(Locator(), parse_vary(words))
    assert "\n" not in str(error.value)


def test_too_many_settings_are_one_line() -> None:
    many = ",".join(map(str, range(1, 102)))
    words = [f"circles.rounds={many}", f"circles.ring_px={many}"]
    with pytest.raises(PomologError, match=f"{101 * 101:,} settings .* {MOST_SETTINGS:,}"):
        settings_of(Locator(), parse_vary(words))


def test_a_learned_method_can_be_varied_too() -> None:
    made = settings_of(METHODS["pomolog"], parse_vary(["circles.least_confidence=0.3,0.5"]))
    assert made[0].locator.recognise is METHODS["pomolog"].recognise
