"""Colours in numbers: what counts as apple, what the page of the orchard says, what is drawn."""

import sys
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks import colours
from benchmarks.colours import PictureSet, measure, rendered, without_rim
from benchmarks.features import cells, summary
from processor.experiments.story import read_truth
from recorder.errors import PomologError
from recorder.records import UNCOUNTED, Labels, Picture
from tests.builders import rig

PAGE = Path(__file__).parent.parent / "docs" / "orchard.md"
DARK_RED = PictureSet("dark red, front", "tab:purple", partial(rendered, "cultivar-dark-red.mcap"))


def red_beside_green() -> tuple[Picture, Labels]:
    """Fruit on the left, a leaf on the right, and a column between them that nobody can tell."""
    picture = np.zeros((40, 40, 3), np.uint8)
    picture[:, :20], picture[:, 20:] = (40, 50, 180), (40, 110, 60)
    labels = np.zeros((40, 40), np.uint16)
    labels[:, :15], labels[:, 15:25] = 7, UNCOUNTED
    return picture, labels


def red_fruit() -> PictureSet:
    return PictureSet("drawn", "tab:red", lambda: [red_beside_green()])


def test_colour_features_tell_red_fruit_from_green_leaves() -> None:
    found = measure([red_fruit()])
    apple, leaf = (found[kind]["drawn"] for kind in ("apple", "other"))
    for name, value in {"R-G": 130, "(R-G)/(G-B)": 13, "saturation": 7 / 9, "edge": 0}.items():
        assert apple.spreads[name].quantiles == pytest.approx((value,) * 3)
    assert leaf.spreads["R-G"].quantiles == (-50, -50, -50)
    assert (apple.kept, leaf.kept) == (1, 0)


def test_pixels_that_nobody_can_tell_are_neither_apple_nor_other() -> None:
    picture, labels = red_beside_green()
    picture[:, 18:22] = (250, 130, 10)
    for kind, median in (("apple", 130), ("other", -50)):
        found = summary("drawn", [(picture, labels)], kind).spreads["R-G"]
        assert found.quantiles == (median,) * 3


def test_a_ratio_where_green_is_blue_is_in_no_bin_and_in_no_percentile() -> None:
    picture, labels = red_beside_green()
    picture[:20] = (90, 90, 120)
    found = summary("drawn", [(picture, labels)], "apple").spreads["(R-G)/(G-B)"]
    assert found.quantiles == pytest.approx((13, 13, 13))
    picture[20:] = (90, 100, 120)
    found = summary("drawn", [(picture, labels)], "apple").spreads["(R-G)/(G-B)"]
    assert found.shares.sum() == pytest.approx(0.5)


def test_a_drawn_outline_counts_neither_way_two_pixels_to_both_sides() -> None:
    labels = np.zeros((9, 30), np.uint16)
    labels[:, :15] = 7
    row = without_rim(labels)[4]
    assert row[:13].tolist() == [7] * 13
    assert row[13:17].tolist() == [UNCOUNTED] * 4
    assert not row[17:].any()


def test_a_set_without_labels_is_one_line_that_names_it() -> None:
    picture, labels = red_beside_green()
    with pytest.raises(PomologError, match="Story: no pixel is labelled as apple"):
        summary("Story", [(picture, labels * 0)], "apple")


def test_the_orchards_page_shows_what_the_command_gives() -> None:
    shown = [line for line in PAGE.read_text().splitlines() if f"| {DARK_RED.name} " in line]
    assert len(shown) == 2
    for line, (kind, found) in zip(shown, measure([DARK_RED]).items(), strict=True):
        first, name, *written = (cell.strip() for cell in line.strip("|").split("|"))
        assert (first, name) == (kind, DARK_RED.name)
        for said, given in zip(written, cells(found[name]), strict=True):
            digit = 0.1 ** len(given.partition(" ")[0].partition(".")[2])
            # another decoder of JPEG may move the last digit by one
            assert numbers(said) == pytest.approx(numbers(given), rel=0, abs=1.01 * digit)


def numbers(cell: str) -> list[float]:
    return [float(number) for number in cell.removesuffix(" %").split(" / ")]


def test_the_plot_is_drawn_unless_real_pictures_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(colours, "RENDERED", (red_fruit(),))
    path = tmp_path / "colours.png"
    words = ["colours", "--plot", str(path)]
    monkeypatch.setattr(sys, "argv", [*words, "--real", str(tmp_path)])
    colours.main()
    said = capsys.readouterr().out
    assert f"left out: no story_orchard and no applebbch81 in {tmp_path}" in said
    assert f"{path} stays as it is" in said
    assert not path.exists()
    monkeypatch.setattr(sys, "argv", words)
    colours.main()
    assert "| apple  | drawn    | 130 / 130 / 130 |" in capsys.readouterr().out
    drawn = cv2.imread(str(path))
    assert drawn is not None
    assert drawn.shape == (550, 1200, 3)


@pytest.mark.parametrize("name", ["colours.svg", ""])
def test_a_plot_of_another_kind_or_name_is_refused_before_the_work(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(colours, "measure", lambda _: pytest.fail("worked all the same"))
    monkeypatch.setattr(sys, "argv", ["colours", "--plot", str(tmp_path / name)])
    with pytest.raises(SystemExit, match=name or "is a folder"):
        colours.main()


def test_a_mask_of_the_real_tree_that_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "apples_truth.csv").write_text("frame,fruit_id\n")
    (tmp_path / "125309_mask.png").write_bytes(b"cut off")
    with pytest.raises(PomologError, match=r"cannot read .*125309_mask\.png; is it there"):
        read_truth(tmp_path, rig().left)
