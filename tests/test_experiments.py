"""`pomolog paper`: every item on drawn sessions, resumed, and its page."""

import json
import re
from pathlib import Path

import cv2
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from processor.cli import app
from processor.experiments.causes import CAUSES
from processor.experiments.material import find_material, sample
from processor.experiments.paper import ITEMS, Made, chosen_items, make_paper, pairs_to_look_at
from processor.experiments.segmentation import picture_hits
from processor.experiments.work import key_of
from processor.page_parts import shown
from recorder.errors import PomologError
from tests.orchard_sets import hung, row_of, write_set, write_sets

ALL = chosen_items("", real=False)


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_sets(tmp_path_factory.mktemp("sessions"))


@pytest.fixture(scope="module")
def made(sets: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Made, Path]:
    out = tmp_path_factory.mktemp("paper")
    return make_paper(find_material(sets), out, only=ALL), out


def claims(made: Made, item: str) -> dict[str, float | None]:
    return {c.what: c.ours for i in made.items if i.id == item for c in i.claims}


def rows(made: Made, table: str) -> list[dict[str, object]]:
    return [dict(row) for i in made.items for t in i.tables if t.name == table for row in t.rows]


def test_every_item_is_run_in_the_papers_order(made: tuple[Made, Path]) -> None:
    assert tuple(item.id for item in made[0].items) == ITEMS
    assert not [item.not_run for item in made[0].items if item.not_run]
    assert all(item.summary and item.method and item.material for item in made[0].items)


def test_drawn_discs_are_segmented_matched_and_placed(made: tuple[Made, Path]) -> None:
    assert (claims(made[0], "table1")["front: hits"] or 0) > 97
    assert claims(made[0], "pictures")["pictures correctly segmented"] == 100
    matches = claims(made[0], "matching")
    assert matches["fruit matched rightly, of all visible in both"] == 100
    assert (claims(made[0], "fig8")["largest error of a measurement"] or 99) < 10


def test_table_1_has_the_papers_denominator(made: tuple[Made, Path]) -> None:
    for row in rows(made[0], "table1"):
        parts = [row[key] for key in ("hits", "false_positive", "false_negative")]
        assert sum(float(str(part)) for part in parts) == pytest.approx(100)


def test_table_2_compares_what_there_is_and_says_what_there_is_not(
    made: tuple[Made, Path],
) -> None:
    by_pair = {row["pair"]: row for row in rows(made[0], "table2_rangefinder")}
    done = by_pair["indoor no occlusion / outdoor front lighting"]
    assert (done["n_first"], done["n_second"], done["n_paired"]) == (3, 3, 3)
    assert by_pair["indoor no occlusion / indoor with occlusion"]["t"] is None


def test_exposure_follows_the_notes(made: tuple[Made, Path]) -> None:
    stops = {row["ev"] for row in rows(made[0], "exposure")}
    assert stops == {-2.0, 0.0, 2.0}


def test_the_page_holds_every_item_and_figure_in_itself(made: tuple[Made, Path]) -> None:
    items, out = made
    page = (out / "paper.html").read_text(encoding="utf-8")
    figures = [figure.name for item in items.items for figure in item.figures]
    assert page.count("data:image/png;base64,") == len(figures) > 8
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    assert all(f'id="{item.id}"' in page for item in items.items)
    for name in figures:
        picture = cv2.imread(str(out / "figures" / f"{name}.png"))
        assert picture is not None
        assert picture.shape[1] > 1000


def test_tables_are_parquet_and_markdown(made: tuple[Made, Path]) -> None:
    items, out = made
    for table in (table for item in items.items for table in item.tables):
        read = pq.read_table(out / "tables" / f"{table.name}.parquet")
        assert read.num_rows == len(table.rows)
        text = (out / "tables" / f"{table.name}.md").read_text(encoding="utf-8")
        assert text.count("\n|") == len(table.rows) + 2


def test_paper_json_has_each_value_beside_the_papers(made: tuple[Made, Path]) -> None:
    document = json.loads((made[1] / "paper.json").read_text(encoding="utf-8"))
    table = next(item for item in document["items"] if item["id"] == "table1")
    hits = next(claim for claim in table["claims"] if claim["what"] == "front: hits")
    assert hits["paper"] == 92.5
    assert hits["difference"] == pytest.approx(hits["ours"] - 92.5)


def test_a_second_run_measures_nothing_and_says_the_same(
    made: tuple[Made, Path], sets: Path
) -> None:
    before = {path: path.stat().st_mtime_ns for path in (made[1] / "kept").rglob("*.json")}
    ticks: list[int] = []
    again = make_paper(find_material(sets), made[1], only=ALL, tick=ticks.append)
    assert again.document == made[0].document
    assert all(path.stat().st_mtime_ns == written for path, written in before.items())
    assert sum(ticks) == pairs_to_look_at(find_material(sets), ALL)


def test_a_killed_run_goes_on_and_ends_as_an_undisturbed_one(
    made: tuple[Made, Path], sets: Path, tmp_path: Path
) -> None:
    wanted = chosen_items("table1,pictures,matching", real=False)
    left = iter(range(3))

    def dies(_: int) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_paper(find_material(sets), tmp_path, only=wanted, tick=dies)
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "kept" / "rows").iterdir()}
    assert kept
    again = make_paper(find_material(sets), tmp_path, only=wanted)
    assert all(path.stat().st_mtime_ns == mtime for path, mtime in kept.items())
    for name in ("table1", "matching"):
        assert claims(again, name) == claims(made[0], name)


def test_another_session_is_measured_again(tmp_path: Path) -> None:
    folder = tmp_path / "sessions"
    folder.mkdir()
    only = chosen_items("pictures", real=False)
    for depths in ((0.6, 0.7), (0.6, 0.65)):
        write_set(folder / "segmentation-front.mcap", [row_of(*depths)] * 2)
        made = make_paper(find_material(folder), tmp_path / "out", only=only)
    found = list((tmp_path / "out" / "kept" / "rows").glob("segmentation-*"))
    assert len(found) == 2
    assert claims(made, "pictures")


def test_missing_sessions_are_said_with_the_command_that_makes_them(tmp_path: Path) -> None:
    write_set(tmp_path / "segmentation-front.mcap", [row_of(0.6, 0.7)] * 2)
    result = CliRunner().invoke(
        app, ["paper", "-o", str(tmp_path / "out"), "--sessions", str(tmp_path), "--only", "fig2"]
    )
    assert result.exit_code == 0
    expected = "Fig. 8: not run: no distance sessions; make them with: pomolog simulate"
    assert expected in result.output
    assert "Table 1: not run: not asked for (--only)" in result.output
    assert "Not run" in (tmp_path / "out" / "paper.html").read_text(encoding="utf-8")


def test_json_is_the_only_thing_on_stdout(tmp_path: Path) -> None:
    write_set(tmp_path / "segmentation-front.mcap", [row_of(0.6, 0.7)] * 2)
    words = ["paper", "-o", str(tmp_path / "out"), "--sessions", str(tmp_path), "--only", "fig2"]
    result = CliRunner().invoke(app, [*words, "--json", "--workers", "1"])
    assert json.loads(result.stdout)["items"][0]["id"] == "fig2"


def test_an_unknown_item_is_refused_with_those_there_are() -> None:
    with pytest.raises(PomologError, match="no item 'table9'; --only takes fig2, table1"):
        chosen_items("table1,table9", real=False)
    with pytest.raises(PomologError, match="--real DIR"):
        chosen_items("real-tree", real=False)


def test_a_folder_without_known_real_pictures_is_refused_before_any_work(
    sets: Path, tmp_path: Path
) -> None:
    with pytest.raises(PomologError, match="no known real pictures"):
        make_paper(find_material(sets), tmp_path / "out", only=ALL, real=tmp_path)
    assert not (tmp_path / "out").exists()


def test_a_folder_without_sessions_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match="pomolog simulate"):
        find_material(tmp_path)


def test_a_torn_session_is_named_on_the_page_and_the_rest_goes_on(tmp_path: Path) -> None:
    write_set(tmp_path / "segmentation-front.mcap", [row_of(0.6, 0.7)] * 2)
    whole = (tmp_path / "segmentation-front.mcap").read_bytes()
    (tmp_path / "segmentation-back.mcap").write_bytes(whole[: len(whole) // 2])
    material = find_material(tmp_path)
    assert [source.name for source in material.sources] == ["segmentation-front"]
    made = make_paper(material, tmp_path / "out", only=chosen_items("fig2", real=False))
    assert made.items[0].summary
    assert "salvage" in (tmp_path / "out" / "paper.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("count", "fraction", "together", "expected"),
    [
        (6, 1.0, 1, (0, 1, 2, 3, 4, 5)),
        (6, 0.5, 1, (0, 2, 4)),
        (6, 0.01, 1, (0,)),
        (10, 0.5, 5, (0, 1, 2, 3, 4)),
        (7, 1.0, 5, (0, 1, 2, 3, 4, 5, 6)),
    ],
)
def test_a_sample_is_even_and_keeps_together_what_belongs_together(
    count: int, fraction: float, together: int, expected: tuple[int, ...]
) -> None:
    assert sample(count, fraction, together) == expected


def test_what_is_kept_is_of_one_version_of_this_program(monkeypatch: pytest.MonkeyPatch) -> None:
    before = key_of("rounds", (0, 1))
    assert key_of("rounds", (0, 1)) == before != key_of("rounds", (0, 2))
    monkeypatch.setattr("processor.experiments.work.versions", lambda: (("source", "changed"),))
    assert key_of("rounds", (0, 1)) != before


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (1.25, "1.2"), (-0.04, "0.0"), (-3.0, "−3.0"), (True, "yes"), (7, "7")],
)
def test_cells_read_well(value: float | None, text: str) -> None:
    assert shown(value) == text


def test_a_picture_without_fruit_and_marks_has_no_hits() -> None:
    assert picture_hits({"tp": 0, "fp": 0, "fn": 0}) is None
    assert picture_hits({"tp": 8, "fp": 1, "fn": 1}) == 0.8


def test_causes_name_the_papers_own_and_end_with_one_that_always_holds() -> None:
    names = list(CAUSES)
    assert names[1:3] == ["merged with other fruit in one view", "split in one view"]
    assert names[-1] == "order"


def cause_rows(tmp_path: Path, pairs: list[tuple[object, ...]]) -> dict[object, dict[str, object]]:
    write_set(tmp_path / "matching-front.mcap", pairs)  # type: ignore[arg-type]
    made = make_paper(
        find_material(tmp_path), tmp_path / "out", only=chosen_items("matching", real=False)
    )
    return {row["cause"]: row for row in rows(made, "matching_causes")}


def test_a_fruit_too_near_for_the_window_is_missed_for_that_reason(tmp_path: Path) -> None:
    found = cause_rows(tmp_path, [(hung(0.4, radius_m=0.07),), (hung(0.42, radius_m=0.07),)])
    assert found["radius outside the window"]["missed"] == 2


def test_fruit_that_touch_in_one_view_alone_are_merged_in_one_view(tmp_path: Path) -> None:
    # the farther one hides behind the nearer one's edge in the left view, and is clear of it in
    # the right view, whose camera stands 200 mm aside
    near, far = hung(0.6, 0.08, 0.0, 1), hung(0.75, 0.17, 0.0, 2)
    found = cause_rows(tmp_path, [(near, far)])
    merged = found["merged with other fruit in one view"]
    assert int(str(merged["wrong_any"])) + int(str(merged["missed_any"])) >= 1


def test_of_two_touching_apples_the_located_one_is_held_against_its_own_place(
    tmp_path: Path,
) -> None:
    # one region, one circle: that of the nearer apple, where the operator named the other
    pair = (hung(0.66, 0.1, number=1), hung(0.6, 0.13, number=2))
    write_set(tmp_path / "distance-indoor-fruit.mcap", [pair] * 2, named=1)
    made = make_paper(
        find_material(tmp_path), tmp_path / "out", only=chosen_items("fig8", real=False)
    )
    row = rows(made, "fig8")[-1]
    assert (row["readings"], row["compared"], row["beside"]) == (2, 0, 2)
    assert (
        abs(float(str(row["exact_bias"]))) < 25
    )  # 2 px of a ring over two discs; the other stands 54 mm behind


REAL = Path(__file__).parents[2] / "shared" / "data"


@pytest.mark.skipif(not REAL.is_dir(), reason=f"no real pictures in {REAL}")
def test_the_real_tree_is_measured_where_it_is_at_hand(tmp_path: Path) -> None:
    write_set(tmp_path / "segmentation-front.mcap", [row_of(0.6, 0.7)] * 2)
    made = make_paper(
        find_material(tmp_path),
        tmp_path / "out",
        only=chosen_items("real-tree", real=True),
        real=REAL / "story_orchard",
    )
    table = {(row["rule"], row["window"]): row for row in rows(made, "real_tree")}
    assert float(str(table["signed", "any"]["covered"])) < 10
    assert float(str(table["absolute", "any"]["covered"])) > 90
    assert float(str(table["absolute", "any"]["marked"])) > 20
