"""The report: everything that was measured of a calibration, in one HTML file without others."""

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Final

import numpy as np

from recorder.calibrate.calibration import CELLS, Calibration, coverage
from recorder.calibrate.measures import measure_by_place
from recorder.calibrate.plots import Plot, bars
from recorder.calibrate.trust import MATCHING_PX
from recorder.files import write_text
from recorder.records import SIDES
from recorder.rig import Camera

ARROWS: Final = 100  # how much longer than the residuals their arrows are

STYLE: Final = """
:root { color-scheme: light dark; --ink: #1c1e21; --soft: #5b6168; --line: #d9dce0;
  --ground: #fff; --card: #f6f7f8; --a: #0072b2; --b: #d55e00; --warn: #8a5a00; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e7e9; --soft: #a2a8b0; --line: #3a3f46;
  --ground: #16181b; --card: #1f2226; --a: #56b4e9; --b: #f0904c; --warn: #e0b15c; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 1rem/1.55 Charter, "Iowan Old Style", Georgia, "DejaVu Serif", serif; }
main { max-width: 62rem; margin: 0 auto; padding: 2.2rem 1.4rem 4rem; }
h1 { font-size: 1.8rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .3rem; padding-top: .9rem;
  border-top: 1px solid var(--line); }
p { margin: .5rem 0; max-width: 46rem; } .soft { color: var(--soft); font-size: .9rem; }
.warning { background: var(--card); border-left: 4px solid var(--warn); padding: .5rem .9rem; }
.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(20rem, 1fr)); gap: 1rem; }
.scroll { overflow-x: auto; }
figure { margin: .8rem 0; } figcaption { color: var(--soft); font-size: .88rem; }
table { border-collapse: collapse; margin: .8rem 0; font: .86rem/1.4 Arial, "DejaVu Sans",
  sans-serif; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .7rem; border-bottom: 1px solid var(--line); text-align: right; }
th:first-child, td:first-child, td.words { text-align: left; }
svg { width: 100%; height: auto; font: 11px Arial, "DejaVu Sans", sans-serif; }
svg text { fill: var(--soft); } svg .label { fill: var(--ink); }
svg .grid { stroke: var(--line); stroke-width: .7; } svg .a { fill: var(--a); fill-opacity: .55; }
svg .b { fill: var(--b); } svg .line { fill: none; stroke-width: 1.5; }
svg .line.a { stroke: var(--a); } svg .line.b { stroke: var(--b); }
svg .line.c { stroke: var(--soft); stroke-dasharray: 4 3; }
svg .cell { fill: var(--a); } svg .bar { fill: var(--a); } svg .bad { fill: var(--b); }
@media print { main { max-width: none; } h2 { break-after: avoid; }
  figure { break-inside: avoid; } }
"""


def write_report(found: Calibration, path: Path) -> None:
    """Write the page.

    Raises:
        PomologError: it cannot be written there.
    """
    write_text(path, page(found))


def page(found: Calibration) -> str:
    """The whole page."""
    sections = (_head, _numbers, _beam, _coverage, _residuals, _views, _rows, _spacings, _errors)
    body = "\n".join(line for section in sections for line in section(found))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Calibration: {escape(str(found.sighting.board))}</title>"
        f"<style>{STYLE}</style></head><body><main>\n{body}\n</main></body></html>\n"
    )


def _head(found: Calibration) -> Iterator[str]:
    rig, trust = found.rig, found.trust
    yield "<h1>Calibration of a stereo rig</h1>"
    yield (
        f"<p>Board {escape(found.sighting.shown)}; {len(found.fit.views)} of "
        f"{len(found.sighting.views)} views used. The cameras are "
        f"<b>{rig.baseline_m * 1e3:.2f} ± {trust.baseline_std_m * 1e3:.2f} mm</b> apart, the left "
        f"focal length is <b>{rig.left.matrix[0, 0]:.1f} ± {trust.focal_std_px[0]:.1f} px</b>; "
        f"what the model leaves of the corners is <b>{found.fit.stereo_rms_px:.2f} px</b>. "
        f"{escape(found.choice.sentence[0].upper() + found.choice.sentence[1:])}.</p>"
    )
    for line in found.warnings:
        yield f'<p class="warning">{escape(line[0].upper() + line[1:])}.</p>'
    if not found.warnings:
        yield "<p>Nothing is suspicious.</p>"


def _numbers(found: Calibration) -> Iterator[str]:
    yield "<h2>The cameras</h2>"
    rows = []
    for place, side in enumerate(SIDES):
        camera = found.rig.camera(side)
        rows.append([
            side, f"{camera.size_px[0]} x {camera.size_px[1]}",
            f"{camera.matrix[0, 0]:.2f} ± {found.trust.focal_std_px[place]:.2f}",
            f"{camera.matrix[1, 1]:.2f}", f"{camera.matrix[0, 2]:.1f}, {camera.matrix[1, 2]:.1f}",
            camera.lens, f"{found.fit.rms_px(side):.3f}",
        ])  # fmt: skip
    heads = ["camera", "picture, px", "f across, px", "f down, px", "centre, px", "lens", "rms, px"]
    yield _table(heads, rows)
    turn_deg = np.rad2deg(np.linalg.norm(found.fit.solution.step[:3]))
    x, y, z = found.rig.translation_m * 1e3
    yield (
        f"<p>From left to right: {x:.2f}, {y:.2f}, {z:.2f} mm and {turn_deg:.2f} degrees. "
        "± are standard deviations: every view was left out in turn and all fitted again.</p>"
    )


def _beam(found: Calibration) -> Iterator[str]:
    if found.beam is None:
        return
    beam = found.beam.rangefinder
    yield "<h2>The rangefinder</h2>"
    rows = [
        [axis, f"{1e3 * beam.origin_m[i]:.1f} ± {1e3 * found.beam.origin_std_m[i]:.1f}",
         f"{beam.direction[i]:+.5f}"]
        for i, axis in enumerate(("x, right", "y, down", "z, forward"))
    ]  # fmt: skip
    yield _table(["left camera's frame", "origin, mm", "direction"], rows)
    yield (
        f"<p>Estimated: {found.beam.estimated}, the direction to "
        f"{np.rad2deg(found.beam.angle_std_rad):.2f} degrees. {found.beam.used} readings are off "
        f"by {1e3 * found.beam.rms_m:.1f} mm (rms); {len(found.beam.left_out)} met "
        "something else.</p>"
    )


def _coverage(found: Calibration) -> Iterator[str]:
    yield "<h2>Where the board was seen</h2><div class='two'>"
    for side in SIDES:
        camera = found.rig.camera(side)
        plot = _picture_plot(camera)
        counts = coverage(found, side)
        step_px = np.array(camera.size_px) / CELLS
        usual = max(float(np.median(counts)), 1.0)
        for row, column in np.ndindex(*counts.shape):
            corner = np.array([column, row]) * step_px
            share = 0.35 * min(1.0, float(counts[row, column]) / usual)
            plot.cell(corner.tolist(), (corner + step_px).tolist(), share)
        plot.dots(np.concatenate([view.corners(side).px for view in found.fit.views]))
        filled = 100 * float((counts > 0).mean())
        yield _figure(plot, f"{side}: corners in {filled:.0f} % of {counts.size} cells")
    yield "</div>"


def _residuals(found: Calibration) -> Iterator[str]:
    yield "<h2>What the model leaves, by place</h2>"
    yield (
        f"<p class='soft'>Mean residual of each cell, {ARROWS} times enlarged. Arrows that turn "
        "with the place in an orderly way mean that the lens model does not fit, or that the "
        "board is bent.</p><div class='two'>"
    )
    for place, side in enumerate(SIDES):
        plot = _picture_plot(found.rig.camera(side))
        px = np.concatenate([view.corners(side).px for view in found.fit.views])
        left = np.concatenate([view[place] for view in found.fit.residuals_px])
        for middle, mean in measure_by_place(px, left, found.rig.camera(side).size_px):
            plot.arrow(middle.tolist(), (middle + ARROWS * mean).tolist())
        reach = max(1e-3, float(np.percentile(np.abs(left), 99.5)))
        cloud = Plot((-reach, reach), (-reach, reach), "across, px", "down, px", 300, 280)
        cloud.dots(np.clip(left, -reach, reach), radius=1.1)
        yield _figure(plot, f"{side}: {found.fit.rms_px(side):.3f} px rms")
        yield _figure(cloud, f"{side}: the residuals themselves")
    yield "</div>"


def _views(found: Calibration) -> Iterator[str]:
    yield "<h2>What the model leaves, by view</h2>"
    rows = [
        (view.name, found.fit.view_rms_px.get(view.name, np.nan), view.name in found.rejected)
        for view in found.sighting.views
    ]
    yield f"<figure>{bars(rows, 'px')}</figure>"
    if found.rejected:
        table = [[name, why] for name, why in found.rejected.items()]
        yield _table(["not used", "why"], table, words=True)
    if found.fit.corners_left_out:
        yield (
            f"<p class='soft'>{found.fit.corners_left_out} single corners lie far off and were "
            f"left out; with them it is {found.fit.untrimmed_rms_px:.3f} px.</p>"
        )


def _rows(found: Calibration) -> Iterator[str]:
    rows = found.measures.rows_px
    yield "<h2>Rectified rows</h2>"
    if len(rows) == 0:
        yield "<p>No corner is seen by both cameras.</p>"
        return
    yield (
        f"<p>After rectification a corner should be in one row of both pictures. It is off by "
        f"{found.measures.row_rms_px:.3f} px (rms), {found.measures.row_median_px:.3f} px (median) "
        f"over {len(rows)} corners.</p>"
    )
    reach = max(1e-3, float(np.percentile(np.abs(rows[:, 2]), 99.5)))
    yield "<div class='two'>"
    for axis, label in ((0, "column of the left rectified picture, px"), (1, "row, px")):
        low, high = (float(v) for v in np.percentile(rows[:, axis], [0.5, 99.5]))
        plot = Plot((low, high), (-reach, reach), label, "right row - left row, px")
        inside = (rows[:, axis] > low) & (rows[:, axis] < high)
        plot.dots(np.clip(rows[inside][:, [axis, 2]], (low, -reach), (high, reach)))
        yield _figure(plot, "")
    yield "</div>"


def _spacings(found: Calibration) -> Iterator[str]:
    square_mm = found.sighting.board.square_m * 1e3
    spacings = found.measures.spacings_m
    yield "<h2>Known lengths, measured</h2>"
    if len(spacings) == 0:
        yield "<p>No two neighbouring corners are seen by both cameras.</p>"
        return
    whole = found.measures.spacing_m
    yield (
        f"<p>Neighbouring corners, located by both cameras, are {whole.median * 1e3:.3f} mm apart "
        f"(median of {whole.count}; median absolute deviation {whole.mad * 1e3:.3f} mm). On the "
        f"board they are {square_mm:g} mm apart.</p>"
    )
    off = 1e3 * spacings * [1, 1] - [0, square_mm]
    reach = max(1e-3, float(np.percentile(np.abs(off[:, 1]), 99)))
    ends = (float(off[:, 0].min()), float(off[:, 0].max()))
    plot = Plot(ends, (-reach, reach), "distance, mm", "measured - true, mm", 640, 260)
    plot.dots(np.clip(off, (ends[0], -reach), (ends[1], reach)))
    bands = found.measures.bands()
    plot.line(
        [((b.near_m + b.far_m) * 500, b.spacing_m.median * 1e3 - square_mm) for b in bands], "b"
    )
    yield _figure(plot, "Each pair of corners; the line is the median by distance.")
    yield _table(
        ["distance, mm", "spacings", "median, mm", "off by, %", "MAD, mm"],
        [
            [
                f"{band.near_m * 1e3:.0f} to {band.far_m * 1e3:.0f}", f"{band.spacing_m.count}",
                f"{band.spacing_m.median * 1e3:.3f}",
                f"{100 * (band.spacing_m.median * 1e3 / square_mm - 1):+.2f}",
                f"{band.spacing_m.mad * 1e3:.3f}",
            ]
            for band in bands
        ],
    )  # fmt: skip


def _errors(found: Calibration) -> Iterator[str]:
    errors = found.trust.errors
    yield "<h2>The distance error to expect</h2>"
    yield (
        "<p>Points all over the left picture, located with the rig and with each rig that one view "
        "was left out of: what the calibration alone contributes (one standard deviation). Beside "
        "it what a match that is off by some pixels costs: Z² / (f B) times the error.</p>"
    )
    heads = ["distance, mm", "calibration, mm"]
    heads += [f"match off by {px:g} px, mm" for px in MATCHING_PX]
    yield _table(
        heads,
        [
            [f"{e.range_m * 1e3:.0f}", f"{e.calibration_m * 1e3:.2f}"]
            + [f"{m * 1e3:.2f}" for m in e.matching_m]
            for e in errors
        ],
    )
    top = max(max(e.matching_m[0], np.nan_to_num(e.calibration_m)) for e in errors) * 1.1e3
    ends = (errors[0].range_m * 1e3, errors[-1].range_m * 1e3)
    plot = Plot(ends, (0, top), "distance, mm", "standard deviation, mm", 640, 260)
    plot.line([(e.range_m * 1e3, e.calibration_m * 1e3) for e in errors], "a")
    plot.line([(e.range_m * 1e3, e.matching_m[0] * 1e3) for e in errors], "b")
    yield _figure(
        plot, f"Blue: the calibration alone. Orange: a match that is off by {MATCHING_PX[0]:g} px."
    )


def _picture_plot(camera: Camera) -> Plot:
    """Axes as wide and high as a picture, rows downwards."""
    width_px, height_px = camera.size_px
    height = round(390 * height_px / width_px) + 54
    return Plot((0, width_px), (height_px, 0), "column, px", "row, px", 460, height)


def _figure(plot: Plot, caption: str) -> str:
    words = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{plot.svg(caption)}{words}</figure>"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, words: bool = False) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in heads)
    kind = ' class="words"' if words else ""
    body = "".join(
        "<tr>" + "".join(f"<td{kind}>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<div class='scroll'>{table}</div>"
