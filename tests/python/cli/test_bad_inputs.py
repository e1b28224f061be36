"""Bad input, by the command line: one message with place and remedy, in our own words, and nothing half-written."""

import functools
import gzip
import os

import numpy as np
import pytest
import recorders
from elliptude import cli
from typer.testing import CliRunner

HEADER = "t,wx,wy,wz,ax,ay,az,mx,my,mz"
ROWS = tuple(f"{0.01 * i:.2f},0,0,0,0,0,9.8,0,18,-42" for i in range(400))
CONFIG = """
time_column = "t"
reference_frame = "ENU"
flow = { kind = "gyro", columns = ["wx", "wy", "wz"], unit = "deg/s", noise_deg_per_s = 1.0 }
estimator = { mode = "guaranteed" }
[[directions]]
name = "up"
kind = "accelerometer"
columns = ["ax", "ay", "az"]
unit = "m/s^2"
bound_deg = 5.0
[[directions]]
name = "field"
kind = "magnetometer"
columns = ["mx", "my", "mz"]
unit = "uT"
reference_ut = [0.0, 18.0, -42.0]
bound_deg = 5.0
"""
NOT_OURS = (
    "Traceback", "Extra inputs", "Input should", "Input tag", "Field required", "discriminator", "Tuple should",
    "String should", "pydantic", "Invalid argument", "Errno", "ArrowInvalid", "CSV parse", "Parquet magic",
    "at line", "end of document", "Unclosed", "pyulog can", "rosbags can",
    "numpy", "pickle", "NoneType", "codec can't", "Value error", "KeyError", "Is a directory", "Not a directory",
)  # fmt: skip
"""Words of Python and of libraries."""


def lines(changes, *, header=HEADER, more=()):
    return "\n".join([header, *(changes.get(i, row) for i, row in enumerate(ROWS)), *more]) + "\n"


def cell(i, column, content):
    cells = ROWS[i].split(",")
    cells[column] = content
    return {i: ",".join(cells)}


LOGS = {
    "empty file": ("", "empty, not even a header"),
    "only blank lines": ("\n\n\n", "empty, not even a header"),
    "header alone": (HEADER + "\n", "a header, but no rows below it"),
    "no header": ("\n".join(ROWS), "its first line has numbers; the names of the columns must stand there"),
    "letters": (lines(cell(7, 1, "fast")), "(wx): not a number: 'fast'; empty the cell, or delete the line"),
    "decimal comma beside points": (lines(cell(7, 1, '"0,5"')), "line 9, column 2 (wx): not a number; [csv] decimal"),
    "one decimal point among commas": (
        "t;wx\n" + "0,5;1\n" * 3 + "0.5;1,5\n", "'0,5' has a decimal comma and '0.5' a decimal point",
    ),
    "thousands": ("t;wx\n1;1,000\n2;2,000\n", "does '1,000' mean 1.000 or 1000?"),
    "two delimiters": ("t,a;b,c\n1,2;3,4\n", "separated by ',' or 2 columns separated by ';'"),
    "short line": (lines({7: "0.07,0,0"}), "line 9: 3 columns, but the header has 10"),
    "long line": (lines({7: ROWS[7] + ",1"}), "line 9: 11 columns, but the header has 10"),
    "cut off": (lines({}, more=("4.0,0,0",)), "line 402: 3 columns"),
    "NaN": (lines(cell(7, 1, "NaN")), "samples of the gyro"),
    "infinite": (lines(cell(7, 1, "inf")), "samples of the gyro that are infinite: 1 (line 9)"),
    "1e300": (lines(cell(7, 1, "1e300")), "line 9, column 2 (wx): 1e+300, which no sensor measures"),
    "1e400": (lines(cell(7, 1, "1e400")), "line 9, column 2 (wx): not a finite number"),
    "empty time": (lines(cell(7, 0, "")), "line 9, column 1 (t): empty"),
    "empty gyro": (lines(cell(7, 1, "") | {}), "line 9"),
    "half a vector": (lines(cell(7, 4, "")), "samples of up with empty components: 1 (line 9)"),
    "zero vector": (lines({7: "0.07,0,0,0,0,0,0,0,18,-42"}), "'up' has no direction"),
    "repeated": (lines({7: ROWS[6]}), "rows that repeat the row above: 1 (line 9)"),
    "repeated with other values": (lines(cell(7, 0, "0.06") | {}), "line 9, column 1 (t): not after the time of"),
    "backward": (lines(cell(7, 0, "0.01")), "line 9, column 1 (t): not after the time of the row before"),
    "set back": (lines({}, more=[row.replace(",0", ",1", 1) for row in ROWS[100:300]]), "the clock was set back here"),
    "times of day among numbers": (lines(cell(7, 0, "2024-05-01T12:00:00Z")), "line 9, column 1 (t): not a number"),
    "no time of day": (
        "t,wx,wy,wz,ax,ay,az,mx,my,mz\n2024-05-01T12:00:00Z" + ROWS[0][4:] + "\nnoon" + ROWS[1][4:] + "\n",
        "line 3, column 1 (t): not a time of day",
    ),
    "misspelt column": (lines({}, header=HEADER.replace("wx", "Wxx")), "no column 'wx'"),
    "two columns of one name": (lines({}, header=HEADER.replace("wx", "wy")), "no column 'wx'"),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "log.csv"),
    "zeros": (b"\0" * 1000, "log.csv"),
    "open quote": (lines(cell(7, 1, '"0')), "line 9: text in quotes that goes on to line 401, and leaves 2 columns"),
    "broken gzip": (
        gzip.compress(b"t,wx\n1,2\n" * 999)[:50],
        "log.csv.gz: its compressed content is damaged, or cut off: copy it again",
    ),
    "no MAT": (b"MATLAB 5.0" + b"x" * 300, "not a MAT file, or damaged: copy it again"),
    "no Parquet": (b"PAR1 no more", "not a Parquet file, or damaged"),
    "no NPZ": (b"PK\x03\x04 no more", "not an NPZ file"),
    "no ULog": (b"PK\x03\x04 no more", "not a ULog: it begins with b'PK\\x03\\x04' where b'ULog' must stand"),
    "cut ULog": (b"ULog\x01\x12\x35\x01\0", "a damaged ULog: it cannot be read beyond byte 9 of 9; copy it"),
    "damaged ULog": (b"ULog\x01\x12\x35\x01" + b"x" * 30, "a damaged ULog: it cannot be read beyond byte"),
    "no bag": (b"no bag at all", "not a ROS 1 bag: it begins with b'no bag a' where b'#ROSBAG V2.0' must stand"),
    "cut bag": (b"#ROSBAG V2.0\n" + bytes(9), "a ROS 1 bag that is damaged, or was not closed when the"),
    "no MCAP": (b"no MCAP at all", "not an MCAP file"),
    "cut MCAP": (b"\x89MCAP0\r\n" + bytes(9), "try `mcap recover`"),
    "no SQLite": (b"no SQLite at all", "not a ROS 2 bag"),
}  # fmt: skip

CONFIGS = {
    "a list without an end": ("flow = [1, 2", "line 1, column 13: not TOML: a list that begins with [ does not end"),
    "no value": ("flow =\n", "line 1, column 7: not TOML: no value: numbers have a decimal point"),
    "a unit behind a number": ("bound = 1 deg\n", "line 1, column 11: not TOML: something is left over: numbers have"),
    "decimal comma": ("bound = 0,5\n", "a decimal point and no unit, text stands in quotes: 'bound = 0,5'"),
    "text without quotes": ("unit = deg\n", "text stands in quotes, lists in [ ]: 'unit = deg'"),
    "name with a space": ("time column = 3\n", "line 1, column 6: not TOML: a name is followed by = and a value"),
    "name twice": ("a = 1\na = 2\n", "line 2, column 6: not TOML: this name has a value already"),
    "table twice": ("[a]\nb = 1\n[a]\n", "line 3, column 3: not TOML: this table stands here a second time"),
    "table without an end": ("[a\n", "line 1, column 3: not TOML: the name of a table ends with ]"),
    "list of tables without an end": ("[[a]\n", "line 1, column 4: not TOML: the name of a table ends with ]"),
    "inline table without an end": ("a = { b = 1\n", "not TOML: a table that begins with { does not end with }"),
    "text without an end": ('a = "b\n', "line 1, column 7: not TOML: text in quotes does not end"),
    "backslash": ('a = "C:\\dir"\n', "in double quotes a backslash begins a special character"),
    "no name": ("= 1\n", "line 1, column 1: not TOML: a line is name = value, [table] or # comment"),
    "no such character": ('a = "\x01"\n', "a character that cannot be shown"),
    "thousands of digits": ("a = " + "9" * 5000, "not TOML: a number has thousands of digits"),
    "hundreds deep": ("a = " + "[" * 3000, "hundreds deep"),
    "misspelt key": (CONFIG.replace("noise_deg", "nose_deg"), "no such key, did you mean 'noise_deg_per_s'?"),
    "misspelt table": (CONFIG.replace("estimator =", "estimater ="), "no such key, did you mean 'estimator'?"),
    "no flow": (CONFIG.replace("flow =", "#"), "flow: missing"),
    "unknown kind": (CONFIG.replace('"gyro"', '"gryo"'), "kind must be 'gyro' or 'rigid_body', not 'gryo', did"),
    "no kind": (CONFIG.replace('kind = "gyro", ', ""), "kind: missing, must be 'gyro' or 'rigid_body'"),
    "unknown unit": (CONFIG.replace('"deg/s"', '"degrees"'), "flow.unit: must be 'rad/s' or 'deg/s', not 'degrees'"),
    "no reference direction": (
        CONFIG.replace('kind = "accelerometer"', "reference = [0, 0, 0]").replace('unit = "m/s^2"', ""),
        "config.toml: directions[0].reference: must be a vector of positive length; that of [0, 0, 0] is 0, and it "
        "points nowhere",
    ),
    "no reference field": (
        CONFIG.replace("[0.0, 18.0, -42.0]", "[0, 0, 0]"), "directions[1].reference_ut: must be a vector of positive",
    ),
    "a field whose square is none": (
        CONFIG.replace("[0.0, 18.0, -42.0]", "[1e-300, 0, 0]"),
        "directions[1].reference_ut: must be at least 1e-130 µT long, where the core holds its square, "
        "not [1e-300, 0, 0]",
    ),
    "a direction whose square is none": (
        CONFIG.replace('kind = "accelerometer"', "reference = [0, 0, -1e-131]").replace('unit = "m/s^2"', ""),
        "directions[0].reference: must be at least 1e-130 long, where the core holds its square, not [0, 0, -1e-131]",
    ),
    "no gravity to speak of": (
        CONFIG.replace('unit = "m/s^2"', 'unit = "m/s^2"\ngravity_m_per_s2 = 1e-310', 1),
        "directions[0].gravity_m_per_s2: must be at least 1e-09, not 1e-310",
    ),
    "short reference direction": (
        CONFIG.replace('kind = "accelerometer"', "reference = [0, 1]").replace('unit = "m/s^2"', ""),
        "config.toml: directions[0].reference[2]: missing: the list has too few values",
    ),
    "no time of the Sun": (
        CONFIG.replace('kind = "accelerometer"', 'reference = {kind = "sun"}').replace('unit = "m/s^2"', ""),
        "config.toml: directions[0].reference.time_zero: missing",
    ),
    "unknown field unit": (CONFIG.replace('"uT"', '"kT"'), "uT is microtesla; nT is nanotesla), not 'kT'"),
    "field unit spelled out": (CONFIG.replace('"uT"', '"gauss"'), "mT is millitesla; G is gauss; mG is milligauss"),
    "text for a number": (CONFIG.replace("per_s = 1.0", 'per_s = "1"'), "noise_deg_per_s: must be a number, not '1'"),
    "negative": (CONFIG.replace("per_s = 1.0", "per_s = -1"), "noise_deg_per_s: must be more than 0, not -1"),
    "infinite bound": (CONFIG.replace("per_s = 1.0", "per_s = inf"), "noise_deg_per_s: must be finite, not inf"),
    "too large": (CONFIG.replace("bound_deg = 5.0", "bound_deg = 500"), "bound_deg: must be less than 180, not 500"),
    "two columns": (CONFIG.replace('"wx", "wy", "wz"', '"wx", "wy"'), "flow.columns[2]: missing"),
    "four columns": (CONFIG.replace('"wx",', '"wx", "w",'), "flow.columns: must have 3 values, not 4"),
    "the same column twice": (CONFIG.replace('"wx", "wy"', '"wy", "wy"'), "must name different columns"),
    "text for a list": (CONFIG.replace('["wx", "wy", "wz"]', '"wx"'), "flow.columns: must be a list, not 'wx'"),
    "number for a table": ("flow = 3", "flow: must be a table, not 3"),
    "unknown delimiter": (CONFIG + '[csv]\ndelimiter = "x"\n', "csv.delimiter: must be ',', ';'"),
    "unknown encoding": (CONFIG + '[csv]\nencoding = "klingon"\n', "csv.encoding: must be the name of an encoding"),
    "no bound": (CONFIG.replace("bound_deg = 5.0", ""), "bound"),
    "no column": (CONFIG.replace('"ax"', '"AX "'), "did you mean 'ax'?"),
    "not UTF-8": (CONFIG.encode("utf-16"), "not UTF-8 text"),
    "no stamps": (CONFIG.replace('"t"', '"time"'), "no column 'time'"),
    "no time unit": (CONFIG.replace('"t"\n', '"t"\ntime_unit = "min"\n'), "must be 's', 'ms', '0.1ms', 'us' or 'ns'"),
}  # fmt: skip


def endings(name):
    known = {
        "broken gzip": ".csv.gz",
        "no Parquet": ".parquet",
        "no NPZ": ".npz",
        "no SQLite": ".db3",
        "no MAT": ".mat",
    }
    words = {"ULog": ".ulg", "bag": ".bag", "MCAP": ".mcap"}
    return known.get(name) or words.get(name.rpartition(" ")[2], ".csv")


@functools.cache
def app():
    return cli.make_app()


def refused(folder, *arguments, exit_code=1):
    """The one message of a command that must not end well, and leave nothing behind."""
    before = sorted(folder.rglob("*"))
    done = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    assert isinstance(done.exception, SystemExit | None), done.exception
    assert done.exit_code == exit_code, done.output
    said = done.stderr
    for word in NOT_OURS:
        assert word not in said + done.stdout
    assert sorted(folder.rglob("*")) == before
    if exit_code == 1:
        assert said.count("error: ") == 1, said
        assert said.startswith("error: ")
    return " ".join(said.split())


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def estimate(folder, log, config):
    return refused(folder, "estimate", log, "--config", config, "--out", folder / "out")


def test_the_good_ones_are_good(tmp_path):
    log, config = write(tmp_path / "log.csv", lines({})), write(tmp_path / "config.toml", CONFIG)
    assert CliRunner().invoke(app(), ["check", str(log), str(config)]).exit_code == 0


def test_there_are_many():
    assert len(LOGS) + len(CONFIGS) >= 55


@pytest.mark.parametrize("name", LOGS)
def test_a_bad_log(tmp_path, name):
    content, message = LOGS[name]
    log = write(tmp_path / f"log{endings(name)}", content)
    said = estimate(tmp_path, log, write(tmp_path / "config.toml", CONFIG))
    assert message in said
    assert log.name in said


@pytest.mark.parametrize("name", CONFIGS)
def test_a_bad_configuration(tmp_path, name):
    content, message = CONFIGS[name]
    config = write(tmp_path / "config.toml", content)
    said = estimate(tmp_path, write(tmp_path / "log.csv", lines({})), config)
    assert message in said
    assert config.name in said or "log.csv" in said


@pytest.mark.parametrize("name", [name for name in CONFIGS if "reference direction" in name or "Sun" in name])
def test_of_a_list_and_a_table_only_the_one_that_stands_there_is_spoken_of(tmp_path, name):
    config = write(tmp_path / "config.toml", CONFIGS[name][0])
    said = estimate(tmp_path, write(tmp_path / "log.csv", lines({})), config)
    assert "must be a table" not in said
    assert "must be a list" not in said


def test_bad_files_and_options(tmp_path):
    log, config = write(tmp_path / "log.csv", lines({})), write(tmp_path / "config.toml", CONFIG)
    assert "none.csv: no such file" in estimate(tmp_path, tmp_path / "none.csv", config)
    assert "none.toml: no such file" in estimate(tmp_path, log, tmp_path / "none.toml")
    (tmp_path / "folder").mkdir()
    assert "folder: a folder without CSV files, and no ROS 2 bag" in estimate(tmp_path, tmp_path / "folder", config)
    assert "a folder, where a file is needed" in estimate(tmp_path, log, tmp_path)
    within = refused(tmp_path, "estimate", log, "--config", config, "--out", log / "out")
    assert "within a file, where a folder is needed" in within
    assert "none" in refused(tmp_path, "bounds", log, "--like", "none", exit_code=2)
    assert "a unit must be stated" in refused(tmp_path, "bounds", log, "--time", "t", "--gyro", "wx,wy,wz", exit_code=2)
    units = ("--gyro-unit", "deg/s")
    assert "3 columns, not 2" in refused(tmp_path, "bounds", log, "--time", "t", "--gyro", "wx,wy", *units, exit_code=2)
    columns = refused(tmp_path, "bounds", log, "--time", "t", "--gyro", "wx,wy,Wz1", *units)
    assert "no column 'Wz1', did you mean 'wz'?" in columns
    assert "its columns do not state sensor, axis and unit" in refused(tmp_path, "bounds", log)
    write(tmp_path / "out.toml", "")
    existing = refused(tmp_path, "bounds", log, config, "--out", tmp_path / "out.toml")
    assert "there already; --force replaces it" in existing


def test_check_names_all_faults(tmp_path):
    config = write(tmp_path / "config.toml", CONFIG)
    log = write(tmp_path / "log.csv", lines(cell(7, 1, "NaN") | {20: ROWS[19]} | cell(30, 4, "")))
    done = CliRunner().invoke(app(), ["check", str(log), str(config)])
    assert done.exit_code == 1
    said = " ".join(done.output.split())
    for part in (
        "words such as NaN or null: 1 (line 9)",
        "repeat the row above: 1 (line 22)",
        "--repair leaves them out",
    ):
        assert part in said
    done = CliRunner().invoke(app(), ["check", str(log), str(config), "--repair"])
    assert "repaired: rows that repeat the row above: 1 (line 22), left out" in done.output
    assert done.exit_code == 0, done.output


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("time", ["1e300", "-1e300", "1e308", "1e17", "-1e17", "2e10", "-2e10"])
@pytest.mark.parametrize("i", [0, 399])
def test_a_stamp_that_is_no_time(tmp_path, time, i):
    log = write(tmp_path / "log.csv", lines(cell(i, 0, time)))
    config = write(tmp_path / "config.toml", CONFIG)
    for command in (("estimate", log, "--config", config, "--out", tmp_path / "out"), ("bounds", log, config)):
        said = refused(tmp_path, *command)
        assert f"line {i + 2}, column 1 (t): the time {float(time):g} s: is its unit right?" in said
        assert "?." not in said


SAMPLES = {"t": np.arange(9) / 100.0, "acc": np.ones((9, 3)), "mag": np.ones((9, 3))}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "no column 'gyr[0]'; it has no columns"),
        ({"t": 1.0, "gyr": 2.0}, "no column 'gyr[0]': array gyr has the shape (); it has no columns"),
        (SAMPLES, "no column 'gyr[0]'; the columns are t, acc[0], acc[1], acc[2], mag[0], mag[1], mag[2]"),
        (SAMPLES | {"gyr": np.ones(9)}, "no column 'gyr[0]': array gyr has the shape (9,); the columns are t, "),
        (SAMPLES | {"gyr": np.ones((9, 3), object)}, "no column 'gyr[0]': array gyr holds objects, not numbers"),
        (
            SAMPLES | {"gyr": np.ones((9, 3), complex)},
            "no column 'gyr[0]': array gyr holds complex numbers, not numbers",
        ),
        (SAMPLES | {"gyr": np.ones((9, 3), str)}, "no column 'gyr[0]': array gyr holds text, not numbers"),
        (
            SAMPLES | {"t": np.arange(30), "gyr": np.ones((3, 30))},
            "'gyr[0]' and 't' have not the same rows: array gyr has the shape (3, 30): transpose it, so that a row is "
            "a sample; array t has the shape (30,)",
        ),
    ],
)
def test_arrays_that_do_not_fit_the_preset(tmp_path, arrays, message):
    np.savez(tmp_path / "log.npz", **arrays)
    assert f"log.npz: {message}" in refused(tmp_path, "bounds", tmp_path / "log.npz", "--like", "broad")


def test_a_ulog_without_a_sample(tmp_path):
    fields = {"timestamp": np.empty(0, int), "gyro_rad": np.empty((0, 3))}
    recorders.write_ulog(tmp_path / "log.ulg", [("sensor_combined", 0, fields)])
    nothing = "': no topic has a sample: the log ends before the first one; it has no columns"
    said = refused(tmp_path, "bounds", tmp_path / "log.ulg", "--like", "px4")
    assert f"log.ulg: no column 'sensor_combined.gyro_rad[0]{nothing}" in said
    named = ("--gyro", "a.x,a.y,a.z", "--gyro-unit", "rad/s", "--time", "a.t")
    assert f"log.ulg: no column 'a.x{nothing}" in refused(tmp_path, "bounds", tmp_path / "log.ulg", *named)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("flow = 3", "flow.kind = 'gyro' is needed"),
        ("flow = { kind = 'gyro', columns = 3 }", "flow.columns: must be a list, not 3"),
        (CONFIG.replace("[[directions]]", "[directions]", 1).split("[[")[0], "directions: must be a list"),
        (CONFIG.replace('"t"', "3"), "time_column: must be text in quotes, not 3"),
    ],
)
def test_bounds_of_a_bad_configuration(tmp_path, content, message):
    config = write(tmp_path / "config.toml", content)
    assert message in refused(tmp_path, "bounds", write(tmp_path / "log.csv", lines({})), config)


@pytest.mark.parametrize("unit", ["T", "G", "nT"])
def test_bounds_of_a_field_in_another_unit_are_suspicious(tmp_path, unit):
    """Nothing is stated yet that rules such a field out."""
    log = write(tmp_path / "log.csv", lines({}))
    config = write(tmp_path / "config.toml", CONFIG.replace('"uT"', f'"{unit}"'))
    done = CliRunner().invoke(app(), [str(one) for one in ("bounds", log, config, "--out", tmp_path / "out.toml")])
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert f"suspicious: field: its median norm is 45.69 {unit}, which is not the Earth's field (" in said
    assert '; it would be in uT: write unit = "uT"' in said


UNREADABLE = {
    "a quote": (lines(cell(7, 0, '"0.07'), more=ROWS * 20), "line 9: text in quotes that does not end, or a cell of"),
    "a header whose line does not end": (HEADER, "a header, but no rows below it"),
    "a gzip": (gzip.compress(lines({}).encode()), "log.csv: compressed: give it a name that ends in .csv.gz"),
    "no ZIP": (b"PK\x03\x04 no more", "log.zip: not a ZIP archive, or cut off: copy it again"),
    "no NPZ": (b"PK\x03\x04 no more", "log.npz: not an NPZ file, or cut off: copy it again"),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_a_file_that_cannot_be_read_is_spoken_of_in_our_words(tmp_path, name):
    content, message = UNREADABLE[name]
    log = write(tmp_path / f"log.{name[3:].lower() if name.startswith('no') else 'csv'}", content)
    said = estimate(tmp_path, log, write(tmp_path / "config.toml", CONFIG))
    assert message in said
    assert "field limit" not in said
    assert "zip file" not in said


def test_a_mark_of_the_byte_order_is_no_fault(tmp_path):
    config = write(tmp_path / "config.toml", b"\xef\xbb\xbf" + CONFIG.encode())
    done = CliRunner().invoke(app(), ["check", str(write(tmp_path / "log.csv", lines({}))), str(config)])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("noise_deg_per_s = 1.0", "noise_deg_per_s = [1, 2]", "flow.noise_deg_per_s: must be a number, not [1, 2]"),
        ("noise_deg_per_s = 1.0", "noise_deg_per_s = 2020-01-01", "must be a number, not 2020-01-01"),
        (
            "[[directions]]",
            "[rule]\nkind = 'hand_held'\n[rule.gyro]\nnoise_deg_per_s = 1.0\n[[directions]]",
            "rule.gyro: no such key with kind = 'hand_held'; kind = 'stated' takes it",
        ),
    ],
)
def test_a_value_of_another_kind(tmp_path, old, new, message):
    config = write(tmp_path / "config.toml", CONFIG.replace(old, new, 1))
    assert message in estimate(tmp_path, write(tmp_path / "log.csv", lines({})), config)


def test_outputs_of_another_kind(tmp_path):
    log, config = write(tmp_path / "log.csv", lines({})), write(tmp_path / "config.toml", CONFIG)
    os.mkfifo(tmp_path / "pipe.toml")
    said = refused(tmp_path, "bounds", log, config, "--out", tmp_path / "pipe.toml", "--force")
    assert "pipe.toml: not written: it is there, and no file: a device or a pipe" in said
    said = refused(tmp_path, "bounds", log, config, "--out", tmp_path / "c.csv")
    assert "c.csv: not written: its name must end in .toml" in said
    report = ("estimate", log, "--config", config, "--out", tmp_path / "out", "--report", tmp_path / "r.txt")
    assert "r.txt: not written: its name must end in .html or .htm" in refused(tmp_path, *report)
