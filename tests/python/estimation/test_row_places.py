"""Where a message says that a row is: the row travels with the data and with the error, and the file is read once."""

import pickle

import elliptude as el
import numpy as np
import pytest
from elliptude import estimation, logs
from elliptude.cli import estimate
from elliptude.configuration import Configuration, read_configuration
from elliptude.io import column_files
from elliptude.io.readers.text.csv import CsvTable
from rich.console import Console
from rich.progress import Progress

CONFIGURATION = """
reference_frame = "ENU"
estimator = { mode = "guaranteed", policy = "POLICY" }

[flow]
kind = "gyro"
columns = ["x", "y", "z"]
noise_deg_per_s = 0.5
estimate_bias = false
bias_deg_per_s = 0.1

[[directions]]
name = "up"
kind = "accelerometer"
columns = ["a", "b", "c"]
unit = "m/s^2"
bound_from = { kind = "acceleration", acceleration_m_per_s2 = 0.5 }

[[directions]]
name = "field"
columns = ["d", "e", "f"]
reference = [0.0, 0.6, -0.8]
bound_deg = 2.0
"""


def contradicting_log(folder, rows, wrong, policy="drop_measurement"):
    """A body at rest, whose accelerometer shows 4 m/s² too much in some rows; with comments above the header."""
    forces = np.full(rows, 9.80665)
    forces[wrong] += 4.0
    constant = {"x": 0.0, "y": 0.0, "z": 0.0, "a": 0.0, "b": 0.0, "d": 0.0, "e": 0.6, "f": -0.8}
    columns = {"time_s": 0.01 * np.arange(rows), "c": forces}
    columns |= {name: np.full(rows, value) for name, value in constant.items()}
    column_files.write_columns(folder / "log.csv", "measurements", columns)
    (folder / "config.toml").write_text(CONFIGURATION.replace("POLICY", policy))
    return folder / "log.csv", read_configuration(folder / "config.toml")


@pytest.fixture
def openings(monkeypatch):
    """A list that grows by one whenever a CSV file is read by the slow reader, which knows its lines."""
    opened = []
    text = CsvTable._text
    monkeypatch.setattr(CsvTable, "_text", lambda self: opened.append(self.path) or text(self))
    return opened


def test_places_of_many_rows_in_one_reading(tmp_path, openings):
    path = tmp_path / "log.csv"
    path.write_text('# a comment\nt,text\n0,"two\nlines"\n\n1,one\n2,one\n\n\n3,"three\n\nlines"\n4,one\n')
    table = CsvTable(path)
    del openings[:]
    assert table.places_of_rows([4, 0, 2, 3, 1, 0, 4]) == [f"line {line}" for line in (13, 4, 7, 12, 6, 4, 13)]
    assert len(openings) == 1
    assert table.places_of_rows([]) == []
    assert table.place("text", 3) == "line 12, column 2 (text)"


@pytest.mark.parametrize("count", [1, 40, 3000])
def test_the_file_is_not_read_again_for_each_contradiction(tmp_path, openings, count):
    wrong = np.linspace(0, 2999, count).astype(int)
    path, configuration = contradicting_log(tmp_path, 3000, wrong)
    with Progress(disable=True) as progress:
        estimate._estimate_pieces(path, configuration, tmp_path, "results.csv", progress, smooth=False, axes="body")
    # The header; the first cells, which say what a column is; the lines of all contradictions, and where a sensor that
    # shows the same numbers from then on began to.
    assert len(openings) <= 3 + (count == 1)
    listed = (tmp_path / "dropped.csv").read_text().splitlines()[2:]
    assert [line.split(",")[1] for line in listed] == [f"line {row + 3}" for row in wrong]


def test_an_error_names_the_line(tmp_path):
    path, configuration = contradicting_log(tmp_path, 30, [17], policy="raise")
    with pytest.raises(
        el.InconsistentMeasurement, match=r"^line 20 \(0\.170000 s\): 'up' contradicts its own"
    ) as caught:
        estimation.estimate(logs.read_log(path, configuration), configuration)
    assert caught.value.row == 17
    assert caught.value.sensor == "up"


def test_progress_says_what_is_done(tmp_path, monkeypatch):
    """Rows are read, then estimated, then written; what takes long is never shown as finished."""
    path, configuration = contradicting_log(tmp_path, 3000, [5])
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", 20_000)
    shown = []
    with Progress(console=Console(quiet=True)) as progress:

        def watched(module, name):
            wanted = getattr(module, name)

            def told(*arguments):
                (task,) = progress.tasks
                shown.append((name, task.description, task.completed, task.finished))
                return wanted(*arguments)

            monkeypatch.setattr(module, name, told)

        watched(estimate, "run_guaranteed")
        watched(estimate, "write_columns")
        watched(estimate, "finish")
        estimate._estimate_pieces(path, configuration, tmp_path, "results.csv", progress, smooth=False, axes="body")
    assert shown == [
        ("run_guaranteed", "Estimating", 3000, False),
        ("write_columns", "Writing", 3000, False),
        ("finish", "Writing", 3000, False),
    ]


# --- errors that know their row ---------------------------------------------------------------------------------------


def test_errors_of_a_row_know_it_and_are_pickled():
    for error in (
        el.RowError("too long", 12),
        el.InconsistentMeasurement("no common point", -0.5, 1.5, "sun", 12),
    ):
        copy = pickle.loads(pickle.dumps(error))
        assert str(copy) == str(error) == f"row 12: {error.args[0]}"
        placed = error.at("line 40 (1.5 s)")
        assert str(placed) == f"line 40 (1.5 s): {error.args[0]}"
        assert type(placed) is type(error)
        assert placed.row == 12
    assert str(el.InconsistentMeasurement("no common point", -0.5)) == "no common point"


def gyro_rows(count=20):
    return {"times": 0.1 * np.arange(count), "gyro": np.zeros((count, 3))}


def test_a_fault_in_a_row_of_the_guaranteed_filter_has_the_row():
    rows = gyro_rows()
    rows["times"][13] = 0.0
    with pytest.raises(el.RowError, match=r"^row 13: times must not go backwards") as caught:
        el.GuaranteedFilter(el.GuaranteedGyroFlow(0.01), time=0.0).run(**rows)
    assert caught.value.row == 13


def test_a_fault_in_a_row_of_the_filter_has_the_row():
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), 1e-4 * np.eye(6))
    rows = gyro_rows()
    rows["times"][13] = 0.0
    with pytest.raises(el.RowError, match=r"^row 13: times must not go backwards") as caught:
        el.AttitudeFilter(el.GyroFlow(1e-6 * np.eye(3)), start, time=0.0).run(**rows)
    assert caught.value.row == 13
    directions = np.tile([[0.0, 0.0, 1.0]], (20, 1, 1))
    directions[7, 0] = [1.0, 0.0, 0.0]
    with pytest.raises(el.InconsistentMeasurement, match=r"^row 7: measurement at 0\.7 s contradicts") as contradiction:
        el.AttitudeFilter(el.GyroFlow(1e-6 * np.eye(3)), start, time=0.0).run(
            **gyro_rows(), directions=directions, reference=[[0.0, 0.0, 1.0]], bounds=[0.01]
        )
    assert contradiction.value.row == 7


@pytest.mark.parametrize(("argument", "what"), [("turns", "turns"), ("turn_bounds", "turn_bounds")])
def test_a_fault_of_a_row_that_is_reached_from_an_anchor_has_the_row(tmp_path, monkeypatch, argument, what):
    """The whole log goes to the core in one call, which says in which row it is stuck."""
    text = CONFIGURATION.replace("POLICY", "raise")
    text = text.replace("noise_deg_per_s", 'anchor_s = 0.1\ninterval_rate = "mean_of_ends"\nnoise_deg_per_s')
    path, _ = contradicting_log(tmp_path, 30, [])
    (tmp_path / "config.toml").write_text(text)
    configuration = read_configuration(tmp_path / "config.toml")
    usual = el.GuaranteedFilter.run_turns

    def with_a_fault(self, times, turns, turn_bounds, **named):
        given = {"turns": turns.copy(), "turn_bounds": turn_bounds.copy()}
        given[argument][19] = -1e300
        return usual(self, times, **given, **named)

    monkeypatch.setattr(el.GuaranteedFilter, "run_turns", with_a_fault)
    with pytest.raises(el.RowError) as caught:
        estimation.estimate(logs.read_log(path, configuration), configuration)
    assert caught.value.row == 19
    assert str(caught.value).startswith(f"line 22 (0.190000 s): {what}[19] ")


def test_a_message_that_speaks_of_rows_is_left_as_it_is():
    """The row is not looked for in the text."""
    log = logs.Log(times=np.arange(3.0), directions=np.zeros((3, 0, 3)), references=np.zeros((3, 0, 3)))

    def fails(*_):
        raise ValueError("a sensor named 'at row 2' is not there")

    fields = {
        "flow": {"kind": "gyro", "columns": ["x", "y", "z"], "noise_deg_per_s": 1.0},
        "directions": [{"name": "up", "columns": ["a", "b", "c"], "reference": [0, 0, 1], "bound_deg": 1.0}],
        "estimator": {"mode": "guaranteed"},
    }
    with pytest.raises(ValueError, match=r"^a sensor named 'at row 2' is not there$"):
        estimation.estimate(log, Configuration.model_validate(fields), fails)
