"""What a new user's first files lack, and what is said of it: the place, and what to do."""

import dataclasses

import elliptude as el
import numpy as np
import pytest
from elliptude.configuration import rules
from elliptude.io.files import FileError
from elliptude.io.readers.base import require_columns
from elliptude.io.readers.open import open_log
from elliptude.io.readers.text.dialect import Stated
from test_proposals import made
from two_commands import HEADER, app, columns_of, succeed
from typer.testing import CliRunner

RULE = rules.__file__.replace("configuration/rules/__init__.py", "data/bounds/hand_held.toml")


def refuse(*arguments):
    done = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    assert done.exit_code == 1, done.output
    return " ".join(done.output.split())


def write(folder, header, rows):
    log = folder / "first.csv"
    np.savetxt(log, rows, delimiter=",", header=",".join(header), comments="", fmt="%.9g")
    return log


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({0: "Clock"}, "no columns state times, such as 'Time (s)'"),
        (
            {1: "Gyroscope X (rpm)"},
            "'rpm' of 'Gyroscope X (rpm)' is no unit of the gyroscope (rad/s, deg/s)",
        ),
        ({1: "Rate X", 2: "Rate Y", 3: "Rate Z"}, "no columns state a gyroscope's three axes with their unit"),
        ({0: "Clock", 1: "X"}, "no columns state times, such as 'Time (s)' or a gyroscope's three axes"),
        ({9: HEADER[8]}, f"two columns are called {HEADER[8]!r}"),
        ({9: "Time (ms)"}, "'Time (s)' and 'Time (ms)' are two columns of times"),
        (
            {i: f"Gyr {'xyz'[i - 7]} (deg/s)" for i in (7, 8, 9)},
            "two sensors of a kind state their axes: which one counts?",
        ),
    ],
)
def test_what_a_header_lacks(tmp_path, changed, said):
    header = [changed.get(i, name) for i, name in enumerate(HEADER)]
    message = refuse("bounds", write(tmp_path, header, columns_of(made())[:50]))
    assert "first.csv: its columns do not state sensor, axis and unit" in message
    assert f"beside 'Time (s)' does ({said}" in message
    assert "--time, --gyro, --gyro-unit" in message


def test_one_column_may_be_several(tmp_path):
    log = write(tmp_path, HEADER, columns_of(made())[:50])
    assert "it is one column, 'Time" in refuse("bounds", log, "--delimiter", "semicolon")
    said = "(Gyroscope X (deg/s)): not a number; [csv] decimal = '.' in a configuration reads a decimal point"
    assert said in refuse("bounds", log, "--decimal", "comma")


def test_a_sensor_in_an_unknown_unit_is_passed_over_and_named(tmp_path):
    header = [name.replace("(g)", "(mm/s^2)") for name in HEADER]
    said = succeed("bounds", write(tmp_path, header, columns_of(made())))
    for axis in "XYZ":
        assert f"passed over: 'mm/s^2' of 'Accelerometer {axis} (mm/s^2)' is no unit of the accelerometer" in said
    assert "passed over" not in succeed("bounds", write(tmp_path, HEADER, columns_of(made())))


def test_files_that_are_no_log(tmp_path):
    (tmp_path / "photo.csv").write_bytes(bytes(range(256)) * 20)
    assert "photo.csv: not text, but its name is not that of another format" in refuse("bounds", tmp_path / "photo.csv")
    (tmp_path / "empty").mkdir()
    assert "empty: a folder without CSV files, and no ROS 2 bag" in refuse("bounds", tmp_path / "empty")
    log = write(tmp_path, HEADER, columns_of(made())[:1])
    assert "fewer than 3 samples of the gyro, and it has 1" in refuse("bounds", log)


def test_a_rule_in_the_place_of_a_configuration(tmp_path):
    log = write(tmp_path, HEADER, columns_of(made())[:50])
    said = refuse("estimate", log, "--config", RULE, "--out", tmp_path / "out")
    assert "hand_held.toml: a rule for bounds, and no configuration; one names it by [rule] with kind = 'file'" in said


def test_a_field_in_another_unit(tmp_path):
    """µT whose header says nT: `bounds` says which unit would fit. Nothing that is stated rules a weak field out."""
    log = write(tmp_path, [name.replace("uT", "nT") for name in HEADER], columns_of(made()))
    said = succeed("bounds", log, "--out", tmp_path / "config.toml")
    assert "field: its median norm is 45.7 nT, which is not the Earth's field (2e+04 to 7e+04 nT)" in said
    assert "it would be in uT: name the columns by options, and say --magnetometer-unit uT" in said
    assert (tmp_path / "config.toml").exists()


def test_arrays():
    recording = dataclasses.replace(made())
    arrays = (recording.angular_velocities, recording.specific_forces, recording.fields * 1e-6)
    for statements in ("foot", "foot.toml"):
        with pytest.raises(
            ValueError, match=f"statements: '{statements}' is none of 'hand', .*, 'recording', and there"
        ):
            el.ahrs(recording.times, *arrays, statements=statements)
    with pytest.raises(ValueError, match="questions: 'turns' is none of reference_turns"):
        el.ahrs(recording.times, *arrays, questions="turns")
    asked = el.ahrs(recording.times, *arrays, questions="reference_turns")
    assert any(name.startswith("turn") for name in asked.columns)
    times = recording.times.copy()
    times[500] = 2.49
    with pytest.raises(ValueError, match=r"time\[500\] is 2\.49, not after time\[499\], 2\.495: times must increase"):
        el.ahrs(times, *arrays)


def with_lines(folder, change):
    log = write(folder, HEADER, columns_of(made()))
    header, *rows = log.read_text().splitlines()
    log.write_text("\n".join(change(header, rows)) + "\n")
    return log


def test_a_header_in_the_middle(tmp_path):
    log = with_lines(tmp_path, lambda header, rows: [header, *rows[:500], header, *rows[500:]])
    assert "first.csv: line 502: the header again: delete this line or" in refuse("bounds", log)


def test_rows_in_reverse_order(tmp_path):
    log = with_lines(tmp_path, lambda header, rows: [header, *rows[::-1]])
    for options in ([], ["--repair"]):
        message = refuse("bounds", log, *options)
        assert "the times in 'Time (s)' fall from the first row to the last: the rows are in reverse order" in message
        assert "Cut the file" not in message


@pytest.mark.parametrize(("first", "name"), [(4, "up"), (7, "field")])
def test_a_sensor_without_a_measurement(tmp_path, first, name):
    def without(row):
        return ",".join("" if first <= i < first + 3 else cell for i, cell in enumerate(row.split(",")))

    log = with_lines(tmp_path, lambda header, rows: [header, *map(without, rows)])
    message = refuse("bounds", log)
    assert (
        f"first.csv: {name!r} ({', '.join(HEADER[first : first + 3])}) is measured at no row: leave it out" in message
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--truth", "qw,qx,qy,qz"], "--truth: goes with columns by name"),
        (["--time-unit", "ms"], "--time-unit: goes with columns by name"),
        (["--time-unit", "s"], "--time-unit: goes with columns by name"),
        (["--gyro-unit", "rad/s"], "--gyro-unit: goes with --gyro, which names the columns"),
        (["--accelerometer-unit", "g"], "--accelerometer-unit: goes with --accelerometer, which names the columns"),
        (
            ["--time", HEADER[0], "--gyro", ",".join(HEADER[1:4]), "--gyro-unit", "deg/s", "--magnetometer-unit", "G"],
            "--magnetometer-unit: goes with --magnetometer, which names the columns",
        ),
    ],
)
def test_an_option_that_would_count_for_nothing(tmp_path, options, said):
    log = write(tmp_path, HEADER, columns_of(made()))
    done = CliRunner().invoke(app(), ["bounds", str(log), *options], env={"COLUMNS": "300"})
    assert done.exit_code == 2, done.output
    assert f"Invalid value for {said}" in done.output


def test_files_that_are_nearly_a_log(tmp_path):
    """A format that is not read, times that are none of ISO 8601, a header that is one column: what would be read."""
    for ending in ("json", "jsonl"):
        path = tmp_path / f"log.{ending}"
        path.write_text('{"t": 0}\n')
        assert "JSON is not read, but CSV, Parquet, NPZ" in refuse("bounds", path)
    header = ",".join(["time", *(f"Gyroscope {axis} (deg/s)" for axis in "XYZ")])
    for stamp in ("23:59:50.{:03d}", "03/29/2026 00:59:50.{:03d}"):
        path = tmp_path / "log.csv"
        path.write_text("\n".join([header, *(f"{stamp.format(k)},0,0,0" for k in range(5))]))
        iso = "ISO 8601, such as 2026-03-29T23:59:50.000"
        assert f"without a unit 'time' is read if it has dates and times of {iso}" in refuse("bounds", path)
        columns = header.removeprefix("time,")
        said = refuse("bounds", path, "--time", "time", "--gyro", columns, "--gyro-unit", "deg/s")
        named = "of dates and times those of ISO 8601 are read, such as 2026-03-29T23:59:50.000"
        assert f"not a number: '{stamp.format(0)}'; {named}" in said
    with pytest.raises(FileError, match=r"the whole header is one column, 't;x': csv\.delimiter says what separates"):
        require_columns(open_log(one_column(tmp_path), Stated(delimiter=",")), ["t"])


def one_column(folder):
    path = folder / "one.csv"
    path.write_text("t;x\n0;1\n1;2\n")
    return path
