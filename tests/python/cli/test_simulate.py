"""`elliptude simulate` and `elliptude scenarios`, as typed."""

import json
import signal
import subprocess
import sys
import time
from importlib import resources

import numpy as np
import pytest
from elliptude import cli, simulation
from elliptude.configuration import read_configuration
from elliptude.io.tables import Measurements
from elliptude.simulation import scenarios
from typer.testing import CliRunner

PROGRAM = [sys.executable, "-c", "from elliptude.cli import main; main()"]


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def test_version_and_scenarios():
    version = run("--version")
    assert version.exit_code == 0
    assert version.output.strip().count(".") == 2
    listed = run("scenarios")
    assert listed.exit_code == 0
    assert "orbit: Spacecraft under gravity gradient" in listed.output
    data = json.loads(run("scenarios", "--json").stdout)
    assert [scenario["name"] for scenario in data] == list(scenarios.names())


@pytest.mark.parametrize("scenario", scenarios.names())
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_simulate(tmp_path, scenario, suffix):
    out = tmp_path / "new" / "folder"
    done = run("simulate", scenario, "--out", out, "--format", suffix, "--directions", "three", "--seed", 5)
    assert done.exit_code == 0, done.output
    assert str(out / f"measurements.{suffix}") in done.output.replace("\n", "")
    expected = simulation.simulate(scenarios.load(scenario), seed=5, directions="three", bound_deg=7.0)
    log = Measurements.read(out / f"measurements.{suffix}")
    np.testing.assert_array_equal(log.directions, expected.measurements.directions)
    np.testing.assert_array_equal(log.true_quaternions, expected.measurements.true_quaternions)
    assert {file.name for file in out.iterdir()} == {f"measurements.{suffix}", "estimate.toml", "summary.json"}
    summary = json.loads((out / "summary.json").read_text())
    assert summary["files"] == [{"seed": 5, "measurements": f"measurements.{suffix}"}]
    assert summary["direction_bound_rad"] == np.deg2rad(7.0)
    assert summary["scenario"]["name"] == scenario


@pytest.mark.parametrize("scenario", ["orbit", "pendulum", "free"])
def test_what_is_written_serves_the_guaranteed_mode_too(tmp_path, scenario):
    assert run("simulate", scenario, "--out", tmp_path).exit_code == 0
    config = tmp_path / "estimate.toml"
    config.write_text(config.read_text() + '\n[estimator]\nmode = "guaranteed"\n')
    done = run("estimate", tmp_path / "measurements.csv", "--config", config, "--out", tmp_path / "result")
    assert done.exit_code == 0, done.output
    assert "unconditional 100 %" in done.output.replace("\n", " ")


def test_own_scenario_many_seeds_and_json(tmp_path):
    own = tmp_path / "mine.toml"
    with scenarios.resources.as_file(scenarios._BUILT_IN / "free.toml") as file:
        own.write_text(file.read_text())
    options = ["--seeds", 3, "--seed", 8, "--noise", "common", "--bound-deg", 0.3, "--json"]
    done = run("simulate", own, "--out", tmp_path / "out", *options)
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["noise"] == "common"
    assert [file["seed"] for file in summary["files"]] == [8, 9, 10]
    logs = [Measurements.read(tmp_path / "out" / file["measurements"]) for file in summary["files"]]
    np.testing.assert_array_equal(logs[0].true_quaternions, logs[2].true_quaternions)
    assert np.all(logs[0].directions != logs[2].directions)


@pytest.mark.parametrize("scenario", scenarios.names())
def test_configuration_fits_the_measurements(tmp_path, scenario):
    assert run("simulate", scenario, "--out", tmp_path, "--directions", "three", "--bound-deg", 1).exit_code == 0
    configuration = read_configuration(tmp_path / "estimate.toml")
    names = (tmp_path / "measurements.csv").read_text().splitlines()[1].split(",")
    assert configuration.time_column in names
    assert len(configuration.directions) == 3
    for direction in configuration.directions:
        assert set(direction.columns) <= set(names)
        np.testing.assert_allclose(direction.bound(), np.eye(3) * np.deg2rad(1.0) ** 2, rtol=1e-15)
    assert set(configuration.rate.columns) <= set(names)
    assert set(configuration.truth.attitude_columns) | set(configuration.truth.vector_columns) <= set(names)


def test_nothing_is_replaced_unless_asked(tmp_path):
    assert run("simulate", "free", "--out", tmp_path).exit_code == 0
    before = (tmp_path / "measurements.csv").read_text()
    again = run("simulate", "free", "--out", tmp_path, "--seed", 1)
    assert again.exit_code == 1
    assert "is there already; --force replaces it" in again.stderr
    assert (tmp_path / "measurements.csv").read_text() == before
    assert run("simulate", "free", "--out", tmp_path, "--seed", 1, "--force").exit_code == 0
    assert (tmp_path / "measurements.csv").read_text() != before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate"], "Missing argument"),
        (["simulate", "orbit"], "--out"),
        (["simulate", "moon", "--out", "x"], "no scenario"),
        (["simulate", "orbit", "--out", "x", "--directions", "seven"], "'seven' is not one of two, three, five"),
        (["simulate", "orbit", "--out", "x", "--noise", "loud"], "loud"),
        (["simulate", "orbit", "--out", "x", "--bound-deg", "0"], "--bound-deg"),
        (["simulate", "orbit", "--out", "x", "--seeds", "0"], "--seeds"),
        (["simulate", "orbit", "--out", "x", "--format", "xlsx"], "xlsx"),
        (["fly"], "fly"),
    ],
)
def test_wrong_command_line(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    failed = run(*arguments)
    assert failed.exit_code == 2
    assert words in " ".join(failed.stderr.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


def test_wrong_file_is_an_error_without_a_traceback(tmp_path):
    own = tmp_path / "mine.toml"
    own.write_text("step = 'long'\n")
    done = subprocess.run(
        [*PROGRAM, "simulate", str(own), "--out", str(tmp_path / "out")], check=False, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith(f"error: {own}: inertia: missing; ")
    assert "step: must be a number" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    failed = run("simulate", "free", "--out", tmp_path / "file" / "out")
    assert failed.exit_code == 1
    first = tmp_path / "file" / "out" / "measurements.csv"
    assert failed.stderr == f"error: {first}: not written: within a file, where a folder is needed\n"


def test_interrupt(tmp_path):
    process = subprocess.Popen(
        [*PROGRAM, "simulate", "pendulum", "--out", str(tmp_path), "--seeds", "100000"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not (tmp_path / "measurements_seed1.csv").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=300)
    assert process.returncode == 130
    assert output == ""
    assert "Traceback" not in errors
    names = [file.name for file in tmp_path.iterdir()]
    assert "summary.json" not in names
    assert not [name for name in names if name.endswith(".tmp")]
    for name in names:
        Measurements.read(tmp_path / name)


def test_without_the_extra(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "typer", None)
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    assert "typer, which is not installed: pip install 'elliptude[cli]'" in str(stopped.value)


def test_a_motion_beyond_all_numbers(tmp_path):
    text = (resources.files("elliptude") / "data" / "scenarios" / "orbit.toml").read_text()
    (tmp_path / "own.toml").write_text(text.replace("orbit_rate = 1.0", "orbit_rate = 1e39"))
    done = run("simulate", tmp_path / "own.toml", "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "could not be integrated" in done.output
    assert run("simulate", "orbit", "--out", tmp_path / "out", "--seeds", 10**30).exit_code == 2


def test_a_closed_pipe_ends_without_a_word():
    command = [sys.executable, "-c", "from elliptude.cli import main; main()", "scenarios", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 1
