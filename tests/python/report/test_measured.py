"""Tests of the pictures of what sensors measured."""

from types import SimpleNamespace

import numpy as np
import pytest
from elliptude.report import figures
from elliptude.report.estimated import curves, drawn, measured


def samples(count, piece):
    """Samples of 100 Hz in pieces, with an extreme of a single sample and a second without any."""
    times = 0.01 * np.arange(count)
    times[count // 2 :] += 1.0
    values = np.stack([np.sin(times), np.cos(times), np.zeros(count)], axis=1)
    values[7 * count // 9, 2] = 40.0
    values[count // 3, 1] = -50.0
    kept = measured._Samples()
    for begin in range(0, count, piece):
        rows = slice(begin, begin + piece)
        kept.add(times[rows], values[rows])
    return times, values, kept


@pytest.mark.parametrize(("count", "piece"), [(900, 900), (90_000, 90_000), (90_000, 700)])
def test_extremes_and_gaps_stay_and_memory_does_not_grow(count, piece):
    times, values, kept = samples(count, piece)
    assert len(kept.times) <= measured.LIMIT
    shown, drawn_values, ((begin, end),) = kept.with_gaps()
    assert (begin, end) == pytest.approx((times[count // 2 - 1], times[count // 2]))
    np.testing.assert_array_equal(np.nanmax(drawn_values, axis=0), values.max(axis=0))
    np.testing.assert_array_equal(np.nanmin(drawn_values, axis=0), values.min(axis=0))
    assert np.isnan(drawn_values[(shown > begin) & (shown < end)]).all()
    assert (np.diff(shown) > 0.0).all()


def test_rows_without_a_sample_are_no_gaps():
    """A sensor at a tenth of the rows has none."""
    times = 0.01 * np.arange(1000)
    values = np.full((1000, 3), np.nan)
    values[::10] = 1.0
    kept = measured._Samples()
    kept.add(times, values)
    assert len(kept.times) == 100
    assert kept.with_gaps()[2] == []


def test_times_left_out_are_few_and_of_their_sensor():
    left = measured.Measured(SimpleNamespace(directions=[], flow=None))
    left.add_left_out_at((0.001 * k, "field") for k in range(100_000))
    left.add_left_out_at([(3.0, "up")])
    assert left._times_left_out("up").tolist() == [3.0]
    times = left._times_left_out("field")
    assert len(times) <= measured.LIMIT
    assert np.diff(times).max() < 0.2
    assert left._times_left_out("gyro").size == 0


def test_a_panel_has_the_axes_the_gap_and_the_marks():
    times, values, kept = samples(900, 900)
    sensor = measured.MeasuredSensor("magnetometer", "µT", *kept.with_gaps(), np.array([1.0, 2.0]))
    panel = figures.new_figure(2.0).add_subplot()
    drawn.draw_measured(panel, sensor)
    assert panel.get_ylabel() == "magnetometer\n(µT)"
    lines = {line.get_label(): line for line in panel.lines}
    assert set(lines) == {"x", "y", "z", drawn.LEFT_OUT}
    assert np.nanmin(lines["y"].get_ydata()) == values[:, 1].min()
    assert lines[drawn.LEFT_OUT].get_xdata().tolist() == [1.0, 2.0]
    (shade,) = [one for one in panel.collections if one.get_label() == drawn.NO_SAMPLE]
    assert shade.get_paths()[0].get_extents().x0 == times[449]


def test_the_page_has_a_panel_for_each_sensor():
    """With the same extremes, a gap without a line, and marks below the curves."""
    _, values, kept = samples(900, 900)
    sensor = measured.MeasuredSensor("magnetometer", "µT", *kept.with_gaps(), np.array([1.0, 2.0]))
    gyro = measured.MeasuredSensor("gyro", "deg/s", *kept.with_gaps(), np.empty(0))
    plot = curves.measured_plot(SimpleNamespace(times=np.array([0.0, 10.0])), [gyro, sensor])
    assert plot["layout"]["yaxis2"]["title"]["text"] == "magnetometer<br>(µT)"
    assert [trace["name"] for trace in plot["data"] if trace.get("showlegend")] == ["x", "y", "z", drawn.LEFT_OUT]
    y = [trace for trace in plot["data"] if trace["name"] == "y"]
    assert [min(one for one in trace["y"] if one is not None) for trace in y] == [values[:, 1].min()] * 2
    assert None in y[1]["y"]
    (marks,) = [trace for trace in plot["data"] if trace["name"] == drawn.LEFT_OUT]
    assert marks["yaxis"] == "y2"
    assert max(marks["y"]) < values.min()
    assert [shape["yref"] for shape in plot["layout"]["shapes"]] == ["y domain", "y2 domain"]
