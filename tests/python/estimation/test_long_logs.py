"""Logs in pieces: the same results as in one, whatever the pieces; what an interrupt leaves behind."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from elliptude import cli, estimation, logs, simulation
from elliptude.configuration import Configuration
from elliptude.estimation.summary import Summary
from elliptude.io import column_files, tables
from elliptude.io.files import FileError
from elliptude.logs import plausibility
from elliptude.report import thinning
from elliptude.report.estimated import picture
from elliptude.simulation import scenarios
from elliptude.simulation.configured import configuration_tables
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

FIELDS = [field.name for field in dataclasses.fields(tables.Result)]


def pieces(log, sizes):
    """The log cut into pieces of these sizes, the last one of what is left."""
    ends = np.minimum(np.cumsum([*sizes, len(log.times)]), len(log.times))
    begin = 0
    for end in ends:
        arrays = {k: v[begin:end] for k, v in vars(log).items() if isinstance(v, np.ndarray)}
        if end > begin:
            yield dataclasses.replace(log, **arrays)
        begin = end


def joined(parts):
    def of(name):
        values = [getattr(part, name) for part in parts]
        if values[0] is None or isinstance(values[0], str | int):
            return values[0]
        return (
            np.concatenate(values)
            if isinstance(values[0], np.ndarray)
            else [text for value in values for text in value]
        )

    return tables.Result(**{name: of(name) for name in FIELDS})


def assert_same(results, expected, tolerance=0.0):
    for name in FIELDS:
        actual, wanted = getattr(results, name), getattr(expected, name)
        if isinstance(wanted, np.ndarray):
            size = np.nanmax(np.abs(wanted), initial=0.0)
            np.testing.assert_allclose(actual, wanted, rtol=0.0, atol=tolerance * size, err_msg=name)
        else:
            assert actual == wanted, name


def flat(value, key=""):
    """The numbers in dictionaries and lists, by where they are."""
    if not isinstance(value, dict | list):
        return {key: value}
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return {name: number for part, inner in items for name, number in flat(inner, f"{key}.{part}").items()}


def gyro_log(rows=200, seed=0):
    """A body that turns, with a gyro and two directions, of which the second is there every third row."""
    draws = np.random.default_rng(seed)
    times = 0.02 * np.arange(rows)
    rates = np.column_stack([np.sin(times), 0.5 * np.cos(2.0 * times), 0.3 + 0.0 * times])
    turn, attitudes = Rotation.identity(), []
    for k in range(rows):
        attitudes.append(turn.as_matrix())
        if k + 1 < rows:
            turn = turn * Rotation.from_rotvec(0.01 * (rates[k] + rates[k + 1]))
    attitudes = np.array(attitudes)
    vectors = np.tile([[0.0, 0.0, 1.0], [0.0, 0.6, -0.8]], (rows, 1, 1))
    directions = np.einsum("nji,nmj->nmi", attitudes, vectors) + 0.01 * draws.uniform(-1, 1, (rows, 2, 3))
    directions[np.arange(rows) % 3 != 0, 1] = np.nan
    directions[:4] = np.nan
    return logs.Log(times, directions, vectors, rates=rates + 0.002, true_attitudes=attitudes)


GYRO = {
    "flow": {"kind": "gyro", "columns": ["x", "y", "z"], "noise_deg_per_s": 0.5, "drift_deg_per_s2": 0.01},
    "directions": [
        {"name": name, "columns": [f"{name}{axis}" for axis in "xyz"], "reference": [0, 0, 1], "bound_deg": 2.0}
        for name in ("up", "field")
    ],
    "start": {"kind": "first_measurement", "bias_bound_deg_per_s": 1.0},
    "truth": {"attitude_columns": ["qw", "qx", "qy", "qz"]},
}


@pytest.mark.parametrize("sizes", [[100], [1] * 199, [3, 2, 1, 50], [7] * 40])
@pytest.mark.parametrize("rate", ["mean_of_ends", "first_sample"])
def test_gyro_in_pieces(sizes, rate):
    log = gyro_log()
    configuration = Configuration.model_validate(GYRO | {"flow": GYRO["flow"] | {"interval_rate": rate}})
    whole = estimation.estimate(log, configuration).result
    assert len(whole.times) == 194  # from the first row with both directions
    parts = list(estimation.PieceEstimator(configuration).run(pieces(log, sizes)))
    # Each piece begins with a step of no length, which rounds; forms and shares have what that does to a minimum.
    assert_same(joined(parts), whole, 1e-7)
    np.testing.assert_allclose(joined(parts).quaternions, whole.quaternions, rtol=0.0, atol=1e-12)
    summary, expected = Summary(), Summary()
    for part in parts:
        summary.add(part)
    expected.add(whole)
    said, wanted = (s.to_dict(configuration, vector_is_compared=False, elapsed=0.0) for s in (summary, expected))
    numbers, expected_numbers = flat(said), flat(wanted)
    assert numbers.keys() == expected_numbers.keys()
    for key, value in expected_numbers.items():
        assert numbers[key] == (pytest.approx(value, rel=1e-7) if isinstance(value, float) else value), key


@pytest.mark.parametrize("kind", ["given", "first_measurement"])
def test_rigid_body_in_pieces(kind):
    scenario = scenarios.load("pendulum").model_copy(update={"measurements": 8})
    simulated = simulation.simulate(scenario, directions="two", bound_deg=7.0, seed=3)
    configured = configuration_tables(scenario, simulated)
    if kind == "given":
        qw, qx, qy, qz = simulated.measurements.true_quaternions[0]
        configured["start"] = {
            "kind": "given", "attitude_qw_qx_qy_qz": [qw, qx, qy, qz], "P_diagonal": [0.1] * 6,
            "rate_rad_per_s": simulated.measurements.true_angular_velocities[0].tolist(),
        }  # fmt: skip
    configuration = Configuration.model_validate(json.loads(json.dumps(configured, default=float)))
    log = logs.log_of(simulated.measurements)
    whole = estimation.estimate(log, configuration).result
    parts = list(estimation.PieceEstimator(configuration).run(pieces(log, [1, 3, 2])))
    assert_same(joined(parts), whole)


def test_no_start_in_any_piece():
    log = gyro_log()
    log = dataclasses.replace(log, directions=np.full_like(log.directions, np.nan))
    with pytest.raises(ValueError, match="no row has two directions"):
        list(estimation.PieceEstimator(Configuration.model_validate(GYRO)).run(pieces(log, [50, 50])))


def test_a_fault_in_a_later_piece_is_named_by_its_time():
    log = gyro_log()
    directions = log.directions.copy()
    directions[150, 0] = [1.0, 0.0, 0.0]
    log = dataclasses.replace(log, directions=directions)
    with pytest.raises(ValueError, match=r"^3\.000000 s: "):
        list(estimation.PieceEstimator(Configuration.model_validate(GYRO)).run(pieces(log, [100, 20])))


# --- from the file ----------------------------------------------------------------------------------------------------


def write_log(folder, rows, wrong_unit=False):
    log = gyro_log(rows)
    columns = {"time_s": log.times}
    for names, values in (("xyz", log.rates), ("abc", log.directions[:, 0]), ("def", log.directions[:, 1])):
        columns |= dict(zip(names, values.T, strict=True))
    quaternions = Rotation.from_matrix(log.true_attitudes).as_quat(scalar_first=True)
    columns |= dict(zip(tables.QUATERNION, quaternions.T, strict=True))
    column_files.write_columns(folder / "log.csv", "measurements", columns)
    unit = "deg/s" if wrong_unit else "rad/s"
    (folder / "config.toml").write_text(
        f"""
        flow = {{ kind = "gyro", columns = ["x", "y", "z"], unit = "{unit}", noise_deg_per_s = 0.5 }}
        directions = [
            {{ name = "up", columns = ["a", "b", "c"], reference = [0.0, 0.0, 1.0], bound_deg = 2.0 }},
            {{ name = "field", columns = ["d", "e", "f"], reference = [0.0, 0.6, -0.8], bound_deg = 2.0 }},
        ]
        start = {{ kind = "first_measurement", bias_bound_deg_per_s = 1.0 }}
        truth = {{ attitude_columns = ["qw", "qx", "qy", "qz"] }}
        """
    )
    return folder / "log.csv", folder / "config.toml"


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_the_command_in_pieces(tmp_path, monkeypatch, suffix):
    log, config = write_log(tmp_path, 3000)
    whole = run("estimate", log, "--config", config, "--out", tmp_path / "whole", "--format", suffix, "--json")
    assert whole.exit_code == 0, whole.output
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", 30_000)
    monkeypatch.setattr(plausibility, "BLOCK_ROWS", 500)
    monkeypatch.setattr(thinning, "LIMIT", 400)
    parts = run("estimate", log, "--config", config, "--out", tmp_path / "parts", "--format", suffix, "--json")
    assert parts.exit_code == 0, parts.output
    table = f"results.{suffix}"
    results, expected = (tables.Result.read(tmp_path / folder / table) for folder in ("parts", "whole"))
    assert_same(results, expected, 1e-7)
    said, wanted = json.loads(parts.stdout), json.loads(whole.stdout)
    assert said["inside_share_of_rows"] == wanted["inside_share_of_rows"]
    assert said["rows"] == wanted["rows"] == 2994


def test_a_wrong_unit_is_found_before_anything_is_written(tmp_path, monkeypatch):
    log, config = write_log(tmp_path, 3000, wrong_unit=True)
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", 30_000)
    monkeypatch.setattr(plausibility, "BLOCK_ROWS", 500)
    done = run("estimate", log, "--config", config, "--out", tmp_path / "new" / "out")
    assert done.exit_code == 1
    assert "as if its radians were declared as degrees" in done.output.replace("\n", " ")
    assert not (tmp_path / "new").exists()


def test_plausible_pieces_looks_on_until_the_log_moves(monkeypatch):
    """At rest for the first 100 rows; the fault shows in the second block."""
    moving, configuration = gyro_log(400), Configuration.model_validate(GYRO)
    directions = moving.directions.copy()
    directions[:100] = directions[6]
    rates = np.where(np.arange(400)[:, None] < 100, 0.0, np.rad2deg(moving.rates))
    log = dataclasses.replace(moving, directions=directions, rates=rates)
    monkeypatch.setattr(plausibility, "BLOCK_ROWS", 100)
    passed = []
    with pytest.raises(FileError, match="as if its degrees were declared as radians"):
        passed.extend(plausibility.plausible_pieces(pieces(log, [50] * 8), configuration, "log"))
    assert len(passed) == 0 or sum(len(piece.times) for piece in passed) <= 200


def test_thinned_keeps_every_escape_that_a_pixel_would(monkeypatch):
    monkeypatch.setattr(thinning, "LIMIT", 100)
    log, configuration = gyro_log(2000), Configuration.model_validate(GYRO)
    results = estimation.estimate(log, configuration).result
    forms = np.zeros(len(results.times))
    forms[[17, 900, 1871]] = [3.0, 5.0, 4.0]
    results = dataclasses.replace(results, forms=forms)
    thinned = thinning.Thinned()
    for begin in range(0, len(forms), 77):
        rows = np.arange(begin, min(begin + 77, len(forms)))
        thinned.add(thinning.chosen(results, rows))
    kept = thinned.result()
    assert 50 <= len(kept.times) <= 100
    assert (np.diff(kept.times) > 0.0).all()
    np.testing.assert_array_equal(np.sort(kept.forms)[-3:], [3.0, 4.0, 5.0])
    figure = picture.estimate_figure(kept, "thinned", inside_share=0.9985)
    assert any("inside: 99.85 %" in axes.get_title() for axes in figure.axes)


def test_a_table_that_fails_in_the_background_is_not_written(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("old")

    def write_both():
        with column_files.writing_columns(path, "results") as write:
            write({"time_s": np.arange(3.0)})
            write({"time_s": np.array([3.0, np.inf])})

    with pytest.raises(ValueError, match="no infinite numbers"):
        write_both()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk(tmp_path, monkeypatch):
    log, config = write_log(tmp_path, 500)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(column_files.pa.csv, "write_csv", full)
    done = run("estimate", log, "--config", config, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "no space left" in done.output.replace("\n", " ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("which", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_leaves_nothing_half_written(tmp_path, which):
    log, config = write_log(tmp_path, 60_000)
    out = tmp_path / "out"
    program = [sys.executable, "-c", "from elliptude.cli import main; main()"]
    running = subprocess.Popen(
        [*program, "estimate", log, "--config", config, "--out", out], stderr=subprocess.PIPE, env=os.environ.copy()
    )
    until = time.monotonic() + 120.0
    while time.monotonic() < until and running.poll() is None and not (out.is_dir() and any(out.iterdir())):
        time.sleep(0.01)
    running.send_signal(which)
    _, errors = running.communicate(timeout=300)
    assert b"Traceback" not in errors
    assert running.returncode != 0
    assert not out.exists()
