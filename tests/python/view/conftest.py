"""What the tests of the view share."""

import pytest
from elliptude import cli
from typer.testing import CliRunner


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    """A log whose truth is known, its configuration, and its results in the guaranteed mode."""
    folder = tmp_path_factory.mktemp("simulated")
    assert run("simulate", "orbit", "--directions", "three", "--out", folder / "log").exit_code == 0
    with (folder / "log" / "estimate.toml").open("a") as file:
        file.write('\n[estimator]\nmode = "guaranteed"\n')
    log, config = folder / "log" / "measurements.csv", folder / "log" / "estimate.toml"
    assert run("estimate", log, "--config", config, "--out", folder / "result").exit_code == 0
    return log, config, folder / "result"
