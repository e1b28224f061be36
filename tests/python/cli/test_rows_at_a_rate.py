"""Recordings that have a rate and no times, as MATLAB's files and HDF5 often are."""

import numpy as np
import pytest
import scipy.io
import tomlkit
from elliptude.cli.application import make_app as app
from elliptude.configuration.configuration import Configuration
from elliptude.io.toml import load_toml
from elliptude.logs import log as logs
from pydantic import ValidationError
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

RATE = 200.0
NAMED = (
    *("--gyro", "gyr[0],gyr[1],gyr[2]", "--gyro-unit", "rad/s"),
    *("--accelerometer", "acc[0],acc[1],acc[2]", "--accelerometer-unit", "m/s^2"),
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A hand that lies still for four seconds, and then turns; as MATLAB saves it."""
    times = np.arange(4000) / RATE
    swing = np.clip((times - 4.0) / 2.0, 0.0, 1.0) * 0.8 * np.sin(1.3 * times)
    attitudes = Rotation.from_rotvec(np.outer(swing, [0.6, 0.8, 0.0]))
    rates = np.gradient(swing, times)[:, None] * np.array([0.6, 0.8, 0.0])
    draws = np.random.default_rng(4)
    contents = {
        "gyr": rates + draws.uniform(-1e-3, 1e-3, (4000, 3)),
        "acc": attitudes.inv().apply([0.0, 0.0, 9.807]) + draws.uniform(-0.02, 0.02, (4000, 3)),
    }
    path = tmp_path_factory.mktemp("rate") / "log.mat"
    scipy.io.savemat(path, contents)
    return path


def run(*arguments):
    return CliRunner().invoke(app(), [str(argument) for argument in arguments])


def test_two_commands(recording, tmp_path):
    config = tmp_path / "config.toml"
    outcome = run("bounds", recording, "--row-rate-hz", RATE, *NAMED, "--out", config)
    assert outcome.exit_code == 0, outcome.output
    configuration = Configuration.model_validate(load_toml(config))
    log = logs.read_log(recording, configuration)
    np.testing.assert_allclose(log.times, np.arange(4000) / RATE, rtol=0, atol=1e-12)
    outcome = run("estimate", recording, "--config", config, "--out", tmp_path / "result")
    assert outcome.exit_code == 0, outcome.output
    assert "100 % have a set that holds if the proposed bounds do" in outcome.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((*NAMED, "--time", "gyr[0]", "--row-rate-hz", "200"), "it is in the place of --time"),
        (("--row-rate-hz", "0.5"), "--row-rate-hz"),
        (NAMED, "--time"),
    ],
)
def test_wrong_options(recording, options, message):
    outcome = run("bounds", recording, *options)
    assert outcome.exit_code == 2
    assert message in outcome.output


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time_column": "t"}, "timing.row_rate_hz is for a file without times"),
        ({"timing": {"row_rate_hz": RATE, "repair": True}}, "a repair leaves rows out"),
        ({"timing": {"row_rate_hz": 0.0}}, "row_rate_hz"),
    ],
)
def test_wrong_configurations(changes, message):
    tables = {"flow": {"kind": "gyro", "columns": ["a", "b", "c"], "unit": "rad/s", "noise_deg_per_s": 1.0}}
    tables |= {"timing": {"row_rate_hz": RATE}} | changes
    with pytest.raises(ValidationError, match=message):
        Configuration.model_validate(tomlkit.parse(tomlkit.dumps(tables)).unwrap())


def test_a_repair_counts_no_rows(recording, tmp_path):
    config = tmp_path / "config.toml"
    assert run("bounds", recording, "--row-rate-hz", RATE, *NAMED, "--out", config).exit_code == 0
    outcome = run("estimate", recording, "--config", config, "--out", tmp_path / "result", "--repair")
    assert outcome.exit_code == 2
    assert "a repair leaves rows out" in outcome.output
    assert not (tmp_path / "result").exists()
