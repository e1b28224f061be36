"""Two files whose times count from different seconds are compared by the clock that both have."""

import dataclasses
import json

import numpy as np
import pytest
import tomlkit
from elliptude import cli
from elliptude.configuration.configuration import Configuration
from elliptude.io import tables
from elliptude.io.column_files import read_columns, time_origin, write_columns
from elliptude.io.files import FileError
from elliptude.logs.conversion import convert_measurements
from elliptude.logs.reference_attitudes import read_reference
from elliptude.proposal.mapping import read_recording
from elliptude.report.estimated.reading import read_run
from elliptude.view.directions import measured_directions
from recorders import write_ulog
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

COUNT, STEP_NS = 301, 10_000_000
FIRST_NS = 1_700_000_000_980_000_000
AXIS = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
RATE = 0.5
SECONDS = 1e-9 * STEP_NS * np.arange(COUNT)
ATTITUDES = Rotation.from_rotvec(RATE * SECONDS[:, None] * AXIS)
STAMPS = FIRST_NS + STEP_NS * np.arange(COUNT)
QUATERNIONS = ATTITUDES.as_quat(canonical=True, scalar_first=True)


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def stated(**changes):
    def of(*names):
        return [f"{name}{axis}" for name in names for axis in "xyz"]

    direction = {"bound_deg": 0.5}
    return {
        "time_column": "time",
        "time_unit": "ns",
        "reference_frame": "ENU",
        "flow": {"kind": "gyro", "columns": of("g"), "noise_deg_per_s": 0.3},
        "directions": [
            {"name": "up", "columns": of("a"), "reference": [0.0, 0.0, 1.0]} | direction,
            {"name": "north", "columns": of("m"), "reference": [1.0, 0.0, 0.0]} | direction,
        ],
        "estimator": {"mode": "guaranteed"},
    } | changes


TRUTH = {"attitude_columns": ["qw", "qx", "qy", "qz"]}


def write_log(folder, name, rows):
    """A log of some rows with whole ns since 1970, and its configuration."""
    measured = [ATTITUDES.inv().apply(reference) for reference in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])]
    values = np.column_stack([np.tile(RATE * AXIS, (COUNT, 1)), *measured])
    lines = [",".join([str(STAMPS[k]), *(repr(float(x)) for x in values[k])]) for k in rows]
    path = folder / f"{name}.csv"
    path.write_text("time,gx,gy,gz,ax,ay,az,mx,my,mz\n" + "\n".join(lines) + "\n")
    (folder / "config.toml").write_text(tomlkit.dumps(stated()))
    return path, folder / "config.toml"


def write_attitudes(folder, first, attitudes=ATTITUDES, later_ns=0):
    """Attitudes with whole ns since 1970, from a row on, and the configuration that says what they are."""
    quaternions = attitudes.as_quat(canonical=True, scalar_first=True)
    lines = [
        ",".join([str(STAMPS[k] + later_ns), *(repr(float(x)) for x in quaternions[k])]) for k in range(first, COUNT)
    ]
    path = folder / "attitudes.csv"
    path.write_text("time,qw,qx,qy,qz\n" + "\n".join(lines) + "\n")
    (folder / "attitudes.toml").write_text(tomlkit.dumps(stated(truth=TRUTH)))
    return path, folder / "attitudes.toml"


def monitored(*arguments):
    done = run("monitor", *arguments, "--json")
    assert done.exit_code in {0, 1}, done.output
    assert done.stdout, done.output
    return json.loads(done.stdout)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_an_estimate_that_begins_in_the_next_second(tmp_path, suffix):
    """Each file counts from its first whole second: its attitudes were judged a second off, with a proof."""
    log, config = write_log(tmp_path, "log", range(COUNT))
    estimate, of_estimate = write_attitudes(tmp_path, 2)
    others = ["--estimate", estimate, "--estimate-config", of_estimate]
    found = monitored(log, "--config", config, *others)
    assert (found["judged"], found["rows_with_proof"]) == (COUNT - 2, 0)
    assert found["tilt"]["bound_deg"]["unconditional"]["max"] < 2.0
    # From the table that `estimate` wrote, too, which says what its times count from.
    result = tmp_path / "result"
    assert run("estimate", log, "--config", config, "--out", result, "--format", suffix).exit_code == 0
    table = result / f"results.{suffix}"
    assert time_origin(table) == read_run(result)[0].origin == 1_700_000_000
    assert tables.Result.read(table).origin == 1_700_000_000
    assert json.loads((result / "summary.json").read_text())["time_origin_s"] == 1_700_000_000
    assert time_origin(result / "dropped.csv") == 1_700_000_000
    found = monitored(result, *others, "--frame", "ENU", "--out", tmp_path / "out", "--format", suffix)
    assert (found["judged"], found["rows_with_proof"]) == (COUNT - 2, 0)
    assert found["time_origin_s"] == 1_700_000_000
    assert time_origin(tmp_path / "out" / f"monitor.{suffix}") == 1_700_000_000
    done = run("compare", result, estimate, "--config", of_estimate, "--json")
    assert done.exit_code == 0, done.output
    compared = json.loads(done.stdout)["all"]
    assert (compared["compared"], compared["inside"]) == (COUNT - 2, COUNT - 2)
    # What is wrong by a second is still proved wrong.
    late, _ = write_attitudes(tmp_path, 2, later_ns=1_000_000_000)
    found = monitored(log, "--config", config, "--estimate", late, "--estimate-config", of_estimate)
    assert found["rows_with_proof"] == found["judged"] > 0


@pytest.mark.parametrize("later", [0, 1, 3])
def test_stamps_are_compared_to_the_nanosecond(tmp_path, later):
    estimate, _ = write_attitudes(tmp_path, 2, later_ns=later)
    configuration = Configuration.model_validate(stated(truth=TRUTH))
    reference = read_reference(estimate, configuration, origin=1_700_000_000)
    np.testing.assert_allclose(reference.times, 0.98 + SECONDS[2:] + 1e-9 * later, rtol=0.0, atol=1e-14)
    far = read_reference(estimate, configuration, origin=1_600_000_000)
    np.testing.assert_allclose(far.times - reference.times, 1e8, rtol=0.0, atol=3e-8)
    assert (np.diff(read_reference(estimate, configuration, origin=0).times) > 0.0).all()


def test_results_of_another_log_as_an_estimate(tmp_path):
    """A table of results says what its times count from, wherever it is."""
    log, config = write_log(tmp_path, "log", range(COUNT))
    other, _ = write_log(tmp_path, "other", range(2, COUNT))
    for name, path in (("one", log), ("two", other)):
        assert run("estimate", path, "--config", config, "--out", tmp_path / name).exit_code == 0
    alone = tmp_path / "moved.csv"
    alone.write_bytes((tmp_path / "two" / "results.csv").read_bytes())
    assert (time_origin(tmp_path / "one" / "results.csv"), time_origin(alone)) == (1_700_000_000, 1_700_000_001)
    found = monitored(tmp_path / "one", "--estimate", alone, "--frame", "ENU")
    assert (found["judged"], found["rows_with_proof"]) == (COUNT - 2, 0)


def test_a_table_that_does_not_say_counts_as_the_log(tmp_path):
    """Its times are those of the log's clock, unless its first line says what they count from."""
    log, config = write_log(tmp_path, "log", range(COUNT))
    rows = "\n".join(
        ",".join(map(repr, [float(t), *(float(x) for x in q)]))
        for t, q in zip(0.98 + SECONDS, QUATERNIONS, strict=True)
    )
    table = tmp_path / "table.csv"
    table.write_text(f"time_s,qw,qx,qy,qz\n{rows}\n")
    done = run("monitor", log, "--config", config, "--estimate", table)
    assert done.exit_code == 1
    said = " ".join(done.output.split())
    assert "no row has an estimate at its time" in said
    assert "'# time_s counts from 1700000000 s'" in said
    table.write_text(f"# time_s counts from 1700000000 s\ntime_s,qw,qx,qy,qz\n{rows}\n")
    assert monitored(log, "--config", config, "--estimate", table)["judged"] == COUNT
    absolute = "\n".join(
        f"{stamp // 10**9}.{stamp % 10**9:09d},{','.join(map(repr, map(float, q)))}"
        for stamp, q in zip(STAMPS.tolist(), QUATERNIONS, strict=True)
    )
    table.write_text(f"time_s,qw,qx,qy,qz\n{absolute}\n")
    found = monitored(log, "--config", config, "--estimate", table)
    assert (found["judged"], found["rows_with_proof"]) == (COUNT, 0)
    assert run("estimate", log, "--config", config, "--out", tmp_path / "result").exit_code == 0
    table.write_text(f"time_s,qw,qx,qy,qz\n{rows}\n")
    done = run("compare", tmp_path / "result", table)
    assert done.exit_code == 1
    assert "'# time_s counts from 1700000000 s'" in " ".join(done.output.split())


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_converted_log_keeps_the_clock(tmp_path, kind):
    log, _ = write_log(tmp_path, "log", range(COUNT))
    table = tmp_path / f"table.{kind}"
    convert_measurements(log, table, Configuration.model_validate(stated()))
    assert time_origin(table) == 1_700_000_000
    tables_of = stated(time_column="time_s", time_unit="s")
    tables_of["flow"]["columns"] = list(tables.MEASURED_RATE)
    for one in tables_of["directions"]:
        one["columns"] = list(tables.measured(one["name"]))
    (tmp_path / "converted.toml").write_text(tomlkit.dumps(tables_of))
    estimate, of_estimate = write_attitudes(tmp_path, 2)
    found = monitored(
        table, "--config", tmp_path / "converted.toml", "--estimate", estimate, "--estimate-config", of_estimate
    )
    assert (found["judged"], found["rows_with_proof"]) == (COUNT - 2, 0)


def test_two_topics_of_one_log(tmp_path):
    """The estimate's topic begins later than the sensors', and counts from its own first second by itself."""
    stamps = STAMPS // 1000
    up, north = (ATTITUDES.inv().apply(reference) for reference in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    topics = [
        ("sensors", 0, {"timestamp": stamps, "g": np.tile(RATE * AXIS, (COUNT, 1)), "a": up, "m": north}),
        ("attitude", 0, {"timestamp": stamps[2:], "q": QUATERNIONS[2:]}),
    ]
    log = tmp_path / "flight.ulg"
    write_ulog(log, topics)
    whole = stated(timing={"origin": "first"})
    del whole["time_column"], whole["time_unit"]
    for table, name in ((whole["flow"], "g"), *zip(whole["directions"], "am", strict=True)):
        table["columns"] = [f"sensors.{name}[{i}]" for i in range(3)]
    whole["truth"] = {"attitude_columns": [f"attitude.q[{i}]" for i in range(4)]}
    config = tmp_path / "flight.toml"
    config.write_text(tomlkit.dumps(whole))
    found = monitored(log, "--config", config, "--estimate", log, "--estimate-config", config)
    assert (found["judged"], found["rows_with_proof"]) == (COUNT - 2, 0)
    assert run("estimate", log, "--config", config, "--out", tmp_path / "result").exit_code == 0
    done = run("compare", tmp_path / "result", log, "--config", config, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["all"]["inside"] == COUNT - 2
    # Bounds are proposed from the truth at the gyro's times.
    configuration = Configuration.model_validate(whole)
    recording, origin = read_recording(log, configuration)
    assert origin == 1_700_000_000
    known = np.isfinite(recording.attitudes[:, 0])
    assert known.sum() == COUNT - 2
    off = Rotation.from_quat(recording.attitudes[known], scalar_first=True).inv() * ATTITUDES[2:]
    assert np.rad2deg(off.magnitude().max()) < 0.01
    # Directions on the sphere are those of the rows, and of no other recording.
    run_of, _ = read_run(tmp_path / "result")
    np.testing.assert_allclose(measured_directions(log, configuration, run_of).directions[:, 0], up, atol=1e-6)
    with pytest.raises(FileError, match="not of this log"):
        measured_directions(log, configuration, dataclasses.replace(run_of, origin=5))


def test_tables_without_an_origin_have_the_line_they_had(tmp_path):
    path = tmp_path / "results.csv"
    columns = {"time_s": np.arange(3.0)}
    write_columns(path, "results", columns)
    assert path.read_text().splitlines()[0] == "# elliptude results 1"
    write_columns(path, "results", columns, origin=5)
    assert path.read_text().splitlines()[0] == "# elliptude results 1; time_s counts from 5 s"
    assert len(read_columns(path)["time_s"]) == 3
    assert time_origin(path) == 5
    path.write_text("time_s,x\n0,1\n")
    assert time_origin(path) == 0
