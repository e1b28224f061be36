"""Tests of the pictures of what sensors measured."""

from types import SimpleNamespace

import numpy as np
import pytest
from elliptude.configuration import Configuration
from elliptude.io.files import FileError
from elliptude.logs.log import read_log
from elliptude.report import figures
from elliptude.report.estimated import curves, drawn, measured, stored

RESULTS = "c099142bc3186ded72786ba27e9ea6d2"


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "results.csv"
    path.write_bytes(b"results")
    return path


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


def field(kept, left_out):
    return stored.MeasuredSensor("field", "magnetometer", "µT", *kept.with_gaps(), left_out)


@pytest.mark.parametrize(("count", "piece"), [(900, 900), (90_000, 90_000), (90_000, 700), (900_000, 45_000)])
def test_extremes_and_gaps_stay_and_memory_does_not_grow(count, piece):
    times, values, kept = samples(count, piece)
    assert min(count, measured.LIMIT // 4) <= len(kept.times) <= measured.LIMIT
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


def test_times_are_those_at_which_each_sensor_was_sampled(tmp_path):
    """Where `timing.same_within_s` brings stamps together, too; also those at which it was left out."""
    times = 0.01 * np.arange(400)
    own = times + 0.004 * np.sin(np.arange(400)) ** 2
    up = np.stack([np.sin(own), np.zeros(400), np.cos(own)], axis=1)
    np.savez(tmp_path / "log.npz", t=times, own=own, gyr=np.zeros((400, 3)), up=up)
    star = {"name": "up", "bound_deg": 1.0, "reference": [0.0, 0.0, 1.0], "time_column": "own", "time_unit": "s"}
    flow = {"kind": "gyro", "columns": [f"gyr[{i}]" for i in range(3)], "noise_deg_per_s": 1.0}
    given = {"time_column": "t", "timing": {"same_within_s": 0.0045}, "flow": flow | {"earth_rate": "removed"}}
    given |= {"directions": [star | {"columns": [f"up[{i}]" for i in range(3)]}], "estimator": {"mode": "guaranteed"}}
    configuration = Configuration.model_validate(given)
    log = read_log(tmp_path / "log.npz", configuration)
    kept = measured.Measured(configuration)
    kept.add(log.since(0))
    kept.add_left_out_at([(float(log.times[7]), "up"), (float(log.times[9]), "gyro"), (float(log.times[11]), "up")])
    gyro, sensor = kept.sensors()
    np.testing.assert_allclose(gyro.times, times[: len(log.times)], atol=1e-12)
    np.testing.assert_allclose(sensor.times, own[: len(log.times)], atol=1e-12)
    np.testing.assert_allclose(sensor.values[:, 0], np.sin(sensor.times), atol=1e-12)
    np.testing.assert_allclose(sensor.left_out, own[[7, 11]], atol=1e-12)
    np.testing.assert_allclose(gyro.left_out, times[[9]], atol=1e-12)


def test_a_panel_has_the_axes_the_gap_and_the_marks():
    times, values, kept = samples(900, 900)
    sensor = field(kept, np.array([1.0, 2.0]))
    panel = figures.new_figure(2.0).add_subplot()
    drawn.draw_measured(panel, sensor)
    drawn.begin_measured(panel)
    assert panel.get_ylabel() == "field\nmagnetometer\n(µT)"
    assert [text.get_text() for text in panel.get_legend().get_texts()] == ["x", "y", "z"]
    lines = {line.get_label(): line for line in panel.lines}
    assert set(lines) == {"_x", "_y", "_z", drawn.LEFT_OUT}
    assert np.nanmin(lines["_y"].get_ydata()) == values[:, 1].min()
    assert lines[drawn.LEFT_OUT].get_xdata().tolist() == [1.0, 2.0]
    (shade,) = [one for one in panel.collections if one.get_label() == drawn.NO_SAMPLE]
    assert shade.get_paths()[0].get_extents().x0 == times[449]


def test_the_page_has_a_panel_for_each_sensor():
    """With the same extremes, a gap without a line, and marks below the curves."""
    _, values, kept = samples(900, 900)
    sensor = field(kept, np.array([1.0, 2.0]))
    gyro = stored.MeasuredSensor("gyro", "", "deg/s", *kept.with_gaps(), np.empty(0))
    plot = curves.measured_plot(SimpleNamespace(times=np.array([0.0, 10.0]), measured=(gyro, sensor)))
    assert plot["layout"]["yaxis"]["title"]["text"] == "gyro<br>(deg/s)"
    assert plot["layout"]["yaxis2"]["title"]["text"] == "field<br>magnetometer<br>(µT)"
    assert [trace["name"] for trace in plot["data"] if trace.get("showlegend")] == ["x", "y", "z", drawn.LEFT_OUT]
    y = [trace for trace in plot["data"] if trace["name"] == "y"]
    assert [min(one for one in trace["y"] if one is not None) for trace in y] == [values[:, 1].min()] * 2
    assert None in y[1]["y"]
    (marks,) = [trace for trace in plot["data"] if trace["name"] == drawn.LEFT_OUT]
    assert marks["yaxis"] == "y2"
    assert max(marks["y"]) < values.min()
    assert [shape["yref"] for shape in plot["layout"]["shapes"]] == ["y domain", "y2 domain"]


def test_axes_are_named_beside_the_title_and_not_over_the_curves():
    _, _, kept = samples(900, 900)
    run = SimpleNamespace(
        times=np.array([0.0, 10.0]),
        measured=(field(kept, np.empty(0)), field(kept, np.ones(1))),
        bounds_from_recording=None,
    )
    figure = drawn.measured_figure(run, "Hand")
    figure.canvas.draw()
    first, second = figure.axes
    box, legend = first.get_window_extent(), first.get_legend().get_window_extent()
    assert legend.y0 >= box.y1 - 3.0
    title = first.title.get_window_extent()
    assert title.x1 < legend.x0
    assert second.get_legend() is None
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [drawn.NO_SAMPLE, drawn.LEFT_OUT]


def equal(one, other):
    assert (one.name, one.kind, one.unit, one.gaps) == (other.name, other.kind, other.unit, other.gaps)
    for name in ("times", "values", "left_out"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize(("count", "piece"), [(900, 900), (90_000, 700)])
def test_what_is_stored_comes_back_bit_by_bit(tmp_path, table, count, piece):
    """The order of sensors, gaps, and times at which a sensor was left out, that of a sample or not."""
    times, _, kept = samples(count, piece)
    gyro = stored.MeasuredSensor("gyro", "", "deg/s", *kept.with_gaps(), np.empty(0))
    sensors = [gyro, field(kept, np.array([times[3], times[count // 2 - 1], times[-1] + 1.0]))]
    path = tmp_path / stored.MEASURED
    stored.write_measured(path, sensors, table, 1_700_000_000)
    assert path.read_text(encoding="utf-8").startswith(
        f"# elliptude measured 1; time_s counts from 1700000000 s\n# of the results {RESULTS}\n"
        "time_s,sensor,kind,unit,what,x,y,z\n"
    )
    found = stored.read_measured(path, table)
    assert len(found) == 2
    for one, other in zip(found, sensors, strict=True):
        equal(one, other)
    assert len(found[0].gaps) == 1


def test_a_gap_whose_first_sample_was_not_kept_comes_back(tmp_path, table):
    """Many gaps of the same length: of most groups of samples not all that are beside one are kept."""
    kept = measured._Samples()
    times = np.cumsum(np.where(np.arange(40_000) % 5 == 0, 0.1, 0.01))
    kept.add(times, np.random.default_rng(1).standard_normal((40_000, 3)))
    sensor = field(kept, np.empty(0))
    assert len(sensor.gaps) > 100
    stored.write_measured(tmp_path / stored.MEASURED, [sensor], table)
    (found,) = stored.read_measured(tmp_path / stored.MEASURED, table)
    equal(found, sensor)


def test_no_sensor_is_stored_as_an_empty_table(tmp_path, table):
    stored.write_measured(tmp_path / stored.MEASURED, [], table)
    assert stored.read_measured(tmp_path / stored.MEASURED, table) == ()


HEADER = f"# elliptude measured 1\n# of the results {RESULTS}\ntime_s,sensor,kind,unit,what,x,y,z\n"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (HEADER + "0,up,,,sample,1,2,3\n1,up,,,seen,1,2,3\n", "row 2 below the header: 'seen', not sample, gap or"),
        (HEADER + "0,up,,,sample,1,2,3\n1,,,,sample,1,2,3\n", "row 2 below the header: no name of a sensor"),
        (HEADER + "0,up,,,sample,,,\n", "row 1 below the header: a sample without x y z"),
        (HEADER + "0,up,,,sample,1,,3\n", r"line 4, column 6 \(x\): a number, but x y z are empty only together"),
        (HEADER + "0,up,,,sample,1,nan,3\n", r"line 4, column 7 \(y\): not a finite number"),
        (HEADER + "1,up,,,sample,1,2,3\n0,up,,,sample,1,2,3\n", r"line 5, column 1 \(time_s\): before the time of"),
        (HEADER + "1,up,,,sample,1,2,3\n1,up,,,gap,,,\n", "sensor up: no sample after the gap at 1.000000 s"),
        (HEADER + "1,up,,,left_out,,,\n", "sensor up: no sample"),
        (HEADER.replace(",kind", "") + "0,up,,sample,1,2,3\n", "kind"),
        (HEADER.replace(RESULTS[:4], "0000") + "1,up,,,sample,1,2,3\n", "not of results.csv as it is now"),
        ("# elliptude measured 1\n" + HEADER.splitlines()[-1] + "\n1,up,,,sample,1,2,3\n", "not of results.csv"),
        ("# elliptude measured 2\ntime_s\n", "version 2 of the format"),
        ("# elliptude dropped 1\ntime_s\n", "a table of dropped, where one of measured is needed"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_stored_file_is_said_with_its_place(tmp_path, table, text, fault):
    path = tmp_path / stored.MEASURED
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match=fault):
        stored.read_measured(path, table)


def test_times_of_different_sensors_need_not_be_in_order(tmp_path, table):
    path = tmp_path / stored.MEASURED
    path.write_text(HEADER + "5,up,,,sample,1,2,3\n1,field,,,sample,1,2,3\n", encoding="utf-8")
    assert [one.name for one in stored.read_measured(path, table)] == ["up", "field"]


@pytest.mark.parametrize(("count", "is_marked"), [(1, True), (20, True), (900, False)])
def test_few_samples_are_marked(count, is_marked):
    """A single one would be invisible, on the page too."""
    kept = measured._Samples()
    kept.add(0.1 * np.arange(count), np.ones((count, 3)))
    sensor = field(kept, np.empty(0))
    panel = figures.new_figure(2.0).add_subplot()
    drawn.draw_measured(panel, sensor)
    assert [line.get_marker() for line in panel.lines] == (["o"] if is_marked else ["None"]) * 3
    plot = curves.measured_plot(SimpleNamespace(times=np.array([0.0, 10.0]), measured=(sensor,)))
    assert {trace["mode"] for trace in plot["data"]} == {"lines+markers" if is_marked else "lines"}
