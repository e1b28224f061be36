"""Gaps between rows: no curve, band or lane goes on there, in no picture, and they are hatched."""

import dataclasses
import json
import re

import numpy as np
import pytest
import tomlkit
from elliptude import estimation
from elliptude.report import breaks, figures, run_figures
from elliptude.report.curves import plots_over_time
from elliptude.report.estimated import picture
from elliptude.report.estimated.reading import read_run
from elliptude.report.thinning import chosen_rows
from test_gaps import simulation, without  # noqa: F401
from test_guaranteed_run import configured, gyro_log, run
from test_run_figures import angled, full_run, legend_of

GAP = (3.0, 4.2)


def with_a_gap(run):
    """Rows 0.1 s apart, but for a gap of 1.5 s after row 9."""
    times = 0.1 * np.arange(50.0)
    times[10:] += 1.4
    return dataclasses.replace(run, times=times, longest_step=0.15, prediction_used=np.ones(50))


def crossings(times, values, begin, end):
    """Lines of a curve that lead over the middle of a span."""
    times, values = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    middle = 0.5 * (begin + end)
    over = (times[:-1] - middle) * (times[1:] - middle) < 0.0
    return int((over & np.isfinite(values[:-1]) & np.isfinite(values[1:])).sum())


def hatched(panel):
    shades = [one for one in panel.collections if one.get_label() == figures.NO_SAMPLE]
    return [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for one in shades for path in one.get_paths()]


@pytest.mark.parametrize("draw", [run_figures.angles_figure, run_figures.bands_figure, run_figures.size_figure])
def test_nothing_is_drawn_in_a_gap(draw):
    run = with_a_gap(angled(full_run()))
    begin, end = run.times[9], run.times[10]
    figure = draw(run, "Run")
    *panels, strip = figure.axes
    for panel in panels:
        curves = [line for line in panel.lines if len(line.get_xdata()) > 2]
        assert curves
        assert sum(crossings(*line.get_data(), begin, end) for line in curves) == 0
        assert hatched(panel) == [pytest.approx((begin, end))]
        middle = 0.5 * (begin + end)
        bands = [one for one in panel.collections if one.get_label() in ("bound", "where it may be", "")]
        for path in (path for band in bands for path in band.get_paths()):
            assert not path.vertices[:, 0].min() < middle < path.vertices[:, 0].max()
    bars = [path.vertices[:, 0] for one in strip.collections for path in one.get_paths()]
    assert bars
    assert not any(bar.min() < begin + 0.2 and bar.max() > begin + 0.2 for bar in bars)
    assert figures.NO_SAMPLE in legend_of(figure)
    # A log that says nothing of its gaps has none, nor has one whose rows are all near.
    for other in (dataclasses.replace(run, longest_step=None), dataclasses.replace(run, longest_step=1.6)):
        assert not any(hatched(panel) for panel in draw(other, "Run").axes)


def test_the_page_has_no_number_in_a_gap():
    run = with_a_gap(angled(full_run()))
    begin, end = run.times[9], run.times[10]
    drawn = breaks.broken(run, breaks.gaps_of(run))
    plots = plots_over_time(drawn, chosen_rows(drawn, 500), "truth", run.refusal_spells())
    assert {"angles", "size", "bands", "strip"} <= set(plots)
    for name in ("angles", "size", "bands"):
        for trace in plots[name]["data"]:
            x, y = ([np.nan if one is None else one for one in trace[axis]] for axis in "xy")
            assert crossings(x, y, begin, end) == 0
        assert any(s["x0"] == begin and s["x1"] == end for s in plots[name]["layout"]["shapes"])
    for trace in plots["strip"]["data"]:
        if trace["type"] == "bar":
            for base, width in zip(trace["base"], trace["x"], strict=True):
                assert base >= end or base + width < begin + 0.2


def test_estimate_breaks_its_pictures_at_gaps_of_the_gyro(tmp_path):
    """From the statement of the configuration to the picture and the page, also where rows are thinned."""
    log = without(gyro_log(4, 160, noise=0.001), GAP)
    configuration = configured({"noise_deg_per_s": np.rad2deg(0.001), "largest_rate_deg_per_s": 60.0})
    result = estimation.estimate(log, configuration).result
    steps = breaks.LongSteps()
    for rows in np.split(np.arange(len(log.times)), [7, 60, 61, 100]):
        steps.add(result.times[rows])
    gaps = steps.gaps(0.075)
    assert gaps == [(pytest.approx(GAP[0]), pytest.approx(GAP[1]))]
    assert steps.gaps(1.2) == steps.gaps(None) == []
    figure = picture.estimate_figure(result, "Log", gaps=gaps)
    for panel in figure.axes:
        assert sum(crossings(*line.get_data(), *GAP) for line in panel.lines if len(line.get_xdata()) > 2) == 0
        assert hatched(panel) == [pytest.approx(GAP)]
    assert figures.NO_SAMPLE in legend_of(figure)
    whole = picture.estimate_figure(result, "Log")
    assert any(crossings(*line.get_data(), *GAP) for panel in whole.axes for line in panel.lines[:1])


def test_the_summary_says_which_steps_are_gaps(simulation, tmp_path):  # noqa: F811
    simulated = simulation.simulate(3, [(10.0, 1.9)])
    path, config, out, page = (tmp_path / name for name in ("log.npz", "config.toml", "out", "report.html"))
    simulation.write(simulated, path)
    (tmp_path / "map.toml").write_text(tomlkit.dumps(simulation.tables(simulated)))
    assert run("bounds", path, tmp_path / "map.toml", "--out", config).exit_code == 0
    done = run("estimate", path, "--config", config, "--out", out, "--report", page)
    assert done.exit_code == 0, done.output
    read, _ = read_run(out)
    assert read.longest_step == 0.015
    ((begin, end),) = breaks.gaps_of(read)
    assert begin == pytest.approx(10.0, abs=0.011)
    assert end == pytest.approx(11.9, abs=0.011)
    plots = json.loads(re.search(r'<script[^>]*id="data"[^>]*>(.*?)</script>', page.read_text(), re.S)[1])["plots"]
    for name in ("angles", "size", "bands"):
        for trace in plots[name]["data"]:
            x, y = ([np.nan if one is None else one for one in trace[axis]] for axis in "xy")
            assert crossings(x, y, begin, end) == 0


def test_a_row_that_stands_alone_is_marked():
    run = angled(full_run())
    alone = np.ones(50, dtype=bool)
    alone[30] = False
    for values in (run.quaternions, run.shapes, run.half_widths, run.largest_angles, run.roll_pitch_yaw):
        values[alone] = np.nan
    for draw in (run_figures.angles_figure, run_figures.size_figure, run_figures.bands_figure):
        for panel in draw(run, "Run").axes[:-1]:
            marked = [line for line in panel.lines if line.get_marker() == "o"]
            assert marked
            assert all(line.get_xdata()[line.get_markevery()].tolist() == [run.times[30]] for line in marked)


def test_a_lane_is_broken_where_its_run_is():
    run = with_a_gap(full_run())
    drawn = breaks.broken(run, breaks.gaps_of(run))
    for most in (3, 50, 500):
        found = breaks.pieces_between_gaps(drawn, most, float(run.times[-1]))
        rows = np.concatenate([np.arange(51)[piece.rows] for piece in found])
        assert rows.tolist() == [row for row in range(51) if row != 10]
        assert all(not drawn.in_gap[piece.rows].any() for piece in found)
        (last,) = [piece for piece in found if piece.rows.stop == 10]
        assert last.end == pytest.approx(1.0)
        assert found[-1].end == run.times[-1]
