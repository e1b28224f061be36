"""The view where Rerun is missing, and the parts of it that need no Rerun."""

import sys
import types

import numpy as np
import pytest
from elliptude import cli, view
from elliptude.configuration.configuration import read_configuration
from elliptude.io.files import FileError
from elliptude.io.spool import recording
from elliptude.report.estimated.reading import read_run
from elliptude.report.run import magnification_to
from elliptude.view import directions, stream
from typer.testing import CliRunner


def run_cli(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


@pytest.mark.parametrize("option", ["--log", "--config"])
def test_log_and_configuration_belong_together(simulated, option):
    done = run_cli("view", simulated[2], option, simulated[0], "--out", "x.rrd")
    assert done.exit_code == 2
    assert "give both, or none" in done.output


@pytest.mark.parametrize("version", [None, "0.40.1", "1", "of another project"])
def test_rerun_is_missing_or_too_old(simulated, tmp_path, monkeypatch, version):
    """Said before the work, with the remedy; PyPI has another project whose module has this name."""
    module = None
    if version is not None:
        module = types.ModuleType("rerun")
        module.__version__, module.__path__ = version, []
        monkeypatch.setitem(sys.modules, "rerun.blueprint", types.ModuleType("rerun.blueprint"))
    monkeypatch.setitem(sys.modules, "rerun", module)
    if version == "1":
        assert stream.sdk() is module
        return
    done = run_cli("view", simulated[2], "--out", tmp_path / "view.rrd")
    assert done.exit_code == 1
    said = "a view needs Rerun: pip" if version is None else f"a view needs Rerun 0.41 or newer, not {version}: pip"
    assert f"{said} install --upgrade 'elliptude[rerun]'" in " ".join(done.output.split())
    assert list(tmp_path.iterdir()) == []


def test_a_direction_is_shown_until_the_next_one_is_overdue():
    times = np.arange(12.0)
    measured = np.isin(times, [2, 4, 6, 11])  # usually each 2 s
    found = directions.latest_rows(times, measured, np.arange(12))
    assert found.tolist() == [-1, -1, 2, 2, 4, 4, 6, 6, 6, 6, -1, 11]
    assert directions.latest_rows(times, measured, np.array([1, 3])).tolist() == [-1, 2]
    assert directions.latest_rows(times, times == 5.0, np.array([4, 5, 6])).tolist() == [-1, 5, -1]
    assert directions.latest_rows(times, times < 0.0, np.array([4, 5])).tolist() == [-1, -1]


def test_directions_are_moved_away_from_their_references():
    reference = np.array([[0.0, 0.0, 1.0]] * 3)
    pointed = np.array([[np.sin(0.1), 0.0, np.cos(0.1)], [0.0, 0.0, 1.0], [0.0, np.sin(2.0), np.cos(2.0)]])
    moved = directions.moved_away(pointed, reference, 5)
    np.testing.assert_allclose(moved[0], [np.sin(0.5), 0.0, np.cos(0.5)], atol=1e-12)
    np.testing.assert_allclose(moved[1], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(moved[2], [0.0, 0.0, -1.0], atol=1e-12)  # half a turn at most
    np.testing.assert_allclose(directions.moved_away(pointed, reference, 1), pointed, atol=1e-12)


def test_the_largest_magnification_that_fits():
    assert [magnification_to(0.75, np.array([angle])) for angle in (0.8, 0.375, 0.3, 1e-6)] == [1, 2, 2, 50_000]


def test_measured_directions_of_a_missing_log(simulated, tmp_path):
    _, config, result = simulated
    run, _ = read_run(result)
    with pytest.raises(FileError, match=r"missing\.csv"):
        view.measured_directions(recording(tmp_path / "missing.csv"), read_configuration(config), run)
