"""`pomolog report`: one page of a run or several, its values those of the score."""

import re
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from processor.methods import METHODS
from processor.replay import replay
from recorder.records import SIDES, Frame, FrameTruth, Note
from recorder.session_writer import SessionWriter
from recorder.status import RecorderStatus, StreamStatus
from tests.browser import opened
from tests.scenes import apple, draw, encoded, small_rig, stereo_session
from tests.test_processor_cli import Command, assert_one_line
from viewer.report import make_report, steps
from viewer.report_columns import columns_of
from viewer.report_plots import MOST_POINTS, curve_of, errors_against_range

NEAR = [apple(1, -0.03, seen=1.0), apple(2, 0.07, z_m=0.5, seen=0.7)]
FAR = [apple(1, seen=1.0), apple(2, 0.05, 0.05, z_m=0.9, seen=1.0)]  # of 18 px: paper's leaves it
FRAMES = [NEAR, FAR, NEAR, FAR, NEAR, FAR]


class Page(HTMLParser):
    """What a page has: its tables as text, its ids, what it would load, its pictures' words."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self.captions: list[str] = []
        self.ids: list[str] = []
        self.loads: list[str] = []
        self.pictures: list[str] = []
        self.headed = 0
        self._into: list[str] | None = None
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        named = {key: value or "" for key, value in attrs}
        self.ids += [named["id"]] if "id" in named else []
        self.loads += [named[k] for k in ("src", "href", "xlink:href") if k in named]
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
            self._into = self.tables[-1][-1]
            self.headed += tag == "th" and named.get("scope") == "col"
        elif tag == "caption":
            self.captions.append("")
            self._into = self.captions
        elif tag == "br" and self._into:
            self._into[-1] += " "
        elif tag == "img":
            self.pictures.append(named.get("alt", ""))
        elif tag == "svg" and named.get("role") == "img":
            self.pictures.append(named.get("aria-label", ""))

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th", "caption"):
            self._into = None

    def handle_data(self, data: str) -> None:
        if self._into:
            self._into[-1] += data

    def row(self, name: str, table: int = 0) -> list[str]:
        return next(row[1:] for row in self.tables[table] if row and row[0] == name)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("sessions")
    return [
        stereo_session(folder / "sunny.mcap", FRAMES, lighting="front"),
        stereo_session(folder / "dull & grey.mcap", FRAMES[:2], lighting="cloudy"),
    ]


@pytest.fixture(scope="module")
def outs(sessions: list[Path], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    made = []
    for method in ("paper", "pomolog"):
        out = tmp_path_factory.mktemp(method)
        tuple(replay(sessions, out, METHODS[method], method=method, rrd="none"))
        made.append(out)
    return made


@pytest.fixture(scope="module")
def html(outs: list[Path]) -> str:
    return make_report(columns_of(outs), outs, worst=6).html


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return Command(monkeypatch, capsys)


def values(cell: str) -> list[float]:
    return [float(v) for v in re.findall(r"[+-]?\d+\.?\d*", cell.replace("−", "-"))]


def test_the_values_are_the_scores(html: str, outs: list[Path], command: Command) -> None:
    page = Page(html)
    for place, out in enumerate(outs):
        score = command("score", out, "--json").json["groups"]["all"]
        said = {name: values(page.row(name)[place]) for name in (
            "pairs", "pixels: F1 %", "fruit in single views: recall %", "matched right, of all %",
            "fruit in single views: precision %", "apples in both views: right / wrong / missed",
            "distances", "bias mm", "RMSE mm", "largest mm",
        )}  # fmt: skip
        m, e = score["matches"], score["distance_m"]
        assert said["pairs"] == [8]
        assert said["pixels: F1 %"][0] == pytest.approx(100 * score["pixels"]["f1"], abs=0.051)
        for name in ("recall", "precision"):
            value = said[f"fruit in single views: {name} %"][0]
            assert value == pytest.approx(100 * score["fruit"][name], abs=0.051)
        assert said["apples in both views: right / wrong / missed"] == [
            m["right"], m["wrong"], m["missed"],
        ]  # fmt: skip
        assert said["distances"] == [e["n"]]
        for name, key in (("bias mm", "bias"), ("RMSE mm", "rmse"), ("largest mm", "max")):
            assert said[name][0] == pytest.approx(1000 * e[key], abs=0.051)


def test_shares_stand_with_their_wilson_interval(
    html: str, outs: list[Path], command: Command
) -> None:
    matches = command("score", outs[1], "--json").json["groups"]["all"]["matches"]
    cell = values(Page(html).row("matched right, of the matched %")[1])
    assert cell == pytest.approx(
        [100 * v for v in (matches["rate"], *matches["wilson95"])], abs=0.1
    )


def test_rows_by_lighting_range_and_visibility_are_the_scores(
    html: str, outs: list[Path], command: Command
) -> None:
    page = Page(html)
    groups = command("score", outs[0], "--by", "lighting", "--json").json["groups"]
    (table,) = (t for t in page.tables if t[0][0] == "lighting")
    sunny = next(row for row in table if row[:2] == ["front", "paper"])
    assert values(sunny[2]) == [6]
    assert values(sunny[3])[0] == pytest.approx(
        100 * groups["lighting=front"]["fruit"]["recall"], abs=0.051
    )
    (table,) = (t for t in page.tables if t[0][0] == "range")
    near = next(row for row in table if row[:2] == ["0.4–0.7 m", "paper"])
    by_range = groups["all"]["distance_m_by_range"]["0.4-0.7 m"]
    assert values(near[4]) == [by_range["n"]]
    assert values(near[6])[0] == pytest.approx(1000 * by_range["rmse"], abs=0.051)
    fruit = next(t for t in page.tables if t[0][:3] == ["seen", "method", "recall %"])
    seen = groups["all"]["fruit_by_visibility"]["50-100%"]
    told = next(row for row in fruit if row[:2] == ["50–100%", "paper"])
    assert values(told[2])[0] == pytest.approx(100 * seen["recall"], abs=0.051)


def test_circles_of_the_curve_are_those_that_the_score_counts(outs: list[Path]) -> None:
    for column in columns_of(outs):
        fruit = column.score.fruit
        assert fruit is not None
        assert int(column.circles.true.sum()) == fruit.tp
        assert int((~column.circles.true).sum()) == fruit.fp
        assert column.circles.wanted == fruit.tp + fruit.fn
    paper, pomolog = columns_of(outs)
    assert curve_of(paper) is None  # it has no confidence
    curve = curve_of(pomolog)
    assert curve is not None
    assert curve.recall[-1] == pytest.approx(pomolog.score.fruit and pomolog.score.fruit.recall)


def test_methods_stand_side_by_side_and_never_share_a_column(
    html: str, outs: list[Path], sessions: list[Path], tmp_path: Path
) -> None:
    assert Page(html).tables[0][0] == ["of all pairs", "paper", "pomolog"]
    tuple(replay(sessions[:1], tmp_path, METHODS["paper"], method="paper", rrd="none"))
    other = replace(METHODS["paper"], match=METHODS["area-only"].match)
    tuple(replay(sessions[1:], tmp_path, other, method="paper", rrd="none"))
    assert len(columns_of([tmp_path])) == 2
    labels = [column.label for column in columns_of([outs[0], tmp_path])]
    assert len(set(labels)) == 3
    assert all(label.startswith("paper (") for label in labels)
    assert len(columns_of([outs[0], outs[0] / "sunny"])) == 1  # named twice, counted once


def test_the_page_needs_nothing_else_and_is_small(html: str) -> None:
    page = Page(html)
    assert all(load.startswith(("#", "data:")) for load in page.loads)
    assert not re.search(r"@import|<script|<link(?! rel=\"icon\" href=\"data:)", html)
    assert not re.search(r"url\((?!#)", html)
    assert len(html.encode()) < 5_000_000


def test_the_page_can_be_read_aloud(html: str) -> None:
    page = Page(html)
    assert len(page.ids) == len(set(page.ids))
    assert {load[1:] for load in page.loads if load.startswith("#")} <= set(page.ids)
    assert len(page.pictures) > 12
    assert all(len(words) > 20 for words in page.pictures)
    folded = html.count("<details>")
    assert len(page.captions) + folded >= len(page.tables)
    assert page.headed > 40
    assert '<html lang="en">' in html


def test_names_of_files_are_text_and_no_markup(html: str) -> None:
    assert "dull &amp; grey" in html
    assert "dull & grey" not in html


@pytest.mark.slow
def test_worst_cases_have_pictures_and_a_command_each(
    outs: list[Path], command: Command, tmp_path: Path
) -> None:
    told = command("report", *outs, "-o", tmp_path / "r.html", "--worst", "3", "--json").json
    cases = told["columns"][0]["worst"]
    assert len(cases) == 3
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert told["bytes"] == len(page.encode())
    for case in cases:
        assert f"--frame {case['frame']} -o sheet.png" in page
        assert case["why"] in page
    jpegs = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', page)
    assert len(jpegs) == 3 + len(told["columns"][1]["worst"])


@pytest.mark.slow
def test_a_session_that_is_gone_costs_the_pictures_alone(
    sessions: list[Path], outs: list[Path], html: str, tmp_path: Path
) -> None:
    away = tmp_path / "away.mcap"
    sessions[0].rename(away)
    try:
        columns = columns_of(outs[:1])
        gone = make_report(columns, outs[:1], worst=4).html
        found = make_report(columns, outs[:1], worst=4, moved=[away]).html
    finally:
        away.rename(sessions[0])
    assert "Pictures not shown:" in gone
    assert "--session FILE" in gone
    assert Page(gone).row("RMSE mm")[0] == Page(html).row("RMSE mm")[0]
    assert "not shown:" not in found


def test_without_truth_the_page_says_not_scored_and_shows_the_run(
    command: Command, tmp_path: Path
) -> None:
    session = stereo_session(tmp_path / "row.mcap", FRAMES[:2], truth=False)
    out = tmp_path / "out"
    command("replay", session, "-o", out, "--rrd", "none", "--workers", "1")
    assert command("report", out, "-o", tmp_path / "r.html").code == 0
    html = (tmp_path / "r.html").read_text(encoding="utf-8")
    page = Page(html)
    assert page.row("RMSE mm") == page.row("pixels: F1 %") == ["not scored"]
    assert page.row("pairs") == ["2"]
    assert html.count("Not scored") >= 3
    assert {"figure-times", "figure-exposure"} <= set(page.ids)
    assert "figure-errors" not in page.ids


def test_partial_truth_scores_no_false_circles(tmp_path: Path) -> None:
    rig = small_rig()
    with SessionWriter.create(tmp_path / "row.mcap", rig) as writer:
        drawn = {side: draw(rig, side, NEAR) for side in SIDES}
        for side in SIDES:
            writer.write_frame(Frame(side, 0, "png", encoded(drawn[side][0]), (320, 240), 0))
        truth = FrameTruth(drawn["left"][1], drawn["right"][1], tuple(NEAR), partial=True)
        writer.write_truth(0, truth)
    tuple(replay([tmp_path / "row.mcap"], tmp_path / "out", METHODS["pomolog"], rrd="none"))
    columns = columns_of([tmp_path / "out"])
    assert columns[0].circles.wanted is None
    page = Page(make_report(columns, [tmp_path / "out"], worst=2).html)
    assert page.row("fruit in single views: precision %") == ["not scored"]
    assert "figure-precision-recall" not in page.ids
    assert "figure-errors" in page.ids


def recorded(path: Path) -> Path:
    """As the recorder leaves a session: statuses, a ledger, and a change of light."""
    rig = small_rig()
    with path.open("wb") as stream:
        writer = SessionWriter(stream, rig)
        writer.write_note(Note(0, "lighting=front"))
        for number in range(3):
            time_ns = number * 10**9
            for side in SIDES:
                data = encoded(draw(rig, side, NEAR)[0])
                writer.write_frame(Frame(side, time_ns, "png", data, (320, 240), number))
            views = tuple(
                StreamStatus(side, number, overexposed=0.07 * number, underexposed=0.3)
                for side in SIDES
            )
            told = RecorderStatus(time_ns, "recording", views, number, 0, 0, 10**9, None)
            writer.write_status(told)
        writer.finish({
            "left.frames": "3", "left.dropped": "4", "left.silent_ns": "2500000000",
            "rangefinder.frames": "9", "rangefinder.faults": "1", "pairs": "3",
            "ended": "by <hand>",
        })  # fmt: skip
    return path


def test_the_recorders_ledger_and_its_look_at_exposure_are_told(tmp_path: Path) -> None:
    tuple(replay([recorded(tmp_path / "day.mcap")], tmp_path, METHODS["paper"], rrd="none"))
    html = make_report(columns_of([tmp_path]), [tmp_path]).html
    page = Page(html)
    (ledger,) = (t for t in page.tables if t[0][:3] == ["session", "stream", "kept"])
    left, rangefinder = (dict(zip(ledger[0], row, strict=True)) for row in ledger[1:])
    assert (left["kept"], left["dropped"], left["silent s"]) == ("3", "4", "2.5")
    assert (rangefinder["kept"], rangefinder["dropped"], rangefinder["faults"]) == ("9", "–", "1")
    assert "ended: by &lt;hand&gt;" in html
    (light,) = (t for t in page.tables if t[0][:2] == ["session", "looked at"])
    assert light[1] == [
        "day", "the recorder, each second", "7.00", "14.00", "2 of 3", "30.00", "30.00", "3 of 3",
    ]  # fmt: skip


def test_exposure_is_measured_in_the_pictures_where_no_recorder_did(tmp_path: Path) -> None:
    rig = small_rig()
    with SessionWriter.create(tmp_path / "row.mcap", rig) as writer:
        for number, level in enumerate((255, 128, 0)):
            for side in SIDES:
                data = encoded(np.full((240, 320, 3), level, np.uint8))
                writer.write_frame(Frame(side, number * 10**9, "png", data, (320, 240), number))
    tuple(replay([tmp_path / "row.mcap"], tmp_path / "out", METHODS["paper"], rrd="none"))
    page = Page(make_report(columns_of([tmp_path / "out"]), [tmp_path / "out"]).html)
    (light,) = (t for t in page.tables if t[0][:2] == ["session", "looked at"])
    assert light[1][2:] == ["0.00", "100.00", "1 of 3", "0.00", "100.00", "1 of 3"]


def test_a_plot_of_very_many_stays_small_and_keeps_the_worst(outs: list[Path]) -> None:
    column = columns_of(outs)[1]
    generator = np.random.default_rng(0)
    errors = generator.normal(0, 0.01, 50_000)
    errors[777] = 0.5
    many = replace(
        column,
        fruit=replace(
            column.fruit,
            pair=np.zeros(50_000, np.int64),
            distance_m=generator.uniform(0.4, 1.5, 50_000),
            visible=np.ones(50_000),
            error_m=errors,
            std_m=np.full(50_000, 0.01),
            match=np.full(50_000, "right", object),
        ),
    )
    figure = errors_against_range([many])
    assert len(figure) < 400_000
    assert f"50000 distances ({MOST_POINTS} of them drawn)" in figure
    assert "500.0" in figure  # the largest, in the plot's numbers


def test_how_to_repeat_it_names_the_sessions_method_and_seed(html: str, outs: list[Path]) -> None:
    commands = html[html.index('id="repeat"') :]
    assert f"pomolog replay &#x27;dull &amp; grey.mcap&#x27; sunny.mcap -o {outs[0]}" in commands
    assert "--method pomolog --seed 0" in commands


def test_a_method_of_ones_own_is_printed_whole(sessions: list[Path], tmp_path: Path) -> None:
    mine = replace(METHODS["paper"], circles=replace(METHODS["paper"].circles, rounds=77))  # type: ignore[type-var]
    tuple(replay(sessions[:1], tmp_path, mine, method="mine", rrd="none"))
    html = make_report(columns_of([tmp_path]), [tmp_path], worst=0).html
    assert "rounds = 77" in html
    assert "--method mine.toml --seed 0" in html


@pytest.mark.slow
def test_steps_are_ticked_one_by_one(outs: list[Path]) -> None:
    columns = columns_of(outs)
    ticks: list[int] = []
    make_report(columns, outs, worst=2, tick=ticks.append)
    assert sum(ticks) == steps(columns, 2) == 2 + 2 * 2


@pytest.mark.slow
def test_the_same_results_give_the_same_page(html: str, outs: list[Path]) -> None:
    assert make_report(columns_of(outs), outs, worst=6).html == html


def test_wrong_input_is_one_line_and_leaves_nothing(
    command: Command, outs: list[Path], tmp_path: Path
) -> None:
    page = tmp_path / "r.html"
    assert_one_line(command("report", tmp_path, "-o", page), "no results in", "pomolog replay")
    assert_one_line(
        command("report", outs[0], "-o", page, "--by", "weather"), "weather", "lighting"
    )
    assert_one_line(command("report", outs[0], "-o", tmp_path), "it is a folder")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_browser_shows_the_page_without_complaint(html: str, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    page.write_text(html, encoding="utf-8")
    document, complaints = opened(page, tmp_path / "profile")
    assert not complaints
    assert document.count("<figure") == html.count("<figure")


@pytest.mark.slow
def test_a_browsers_complaint_would_be_heard(tmp_path: Path) -> None:
    page = tmp_path / "wrong.html"
    page.write_text("<script>nothing_of_this_name()</script>", encoding="utf-8")
    assert opened(page, tmp_path / "profile")[1]
