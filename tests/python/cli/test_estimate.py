"""`elliptude estimate` and `elliptude demo`, as typed."""

import json
import re
import stat
import subprocess
import sys

import numpy as np
import pytest
from elliptude import cli, estimation, logs, simulation
from elliptude.cli import demo
from elliptude.configuration import Configuration, read_configuration
from elliptude.io.tables import Result
from elliptude.simulation import scenarios
from elliptude.simulation.configured import configuration_tables
from typer.testing import CliRunner


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


@pytest.fixture
def simulated(tmp_path):
    folder = tmp_path / "simulated"
    done = run("simulate", "pendulum", "--directions", "two", "--out", folder)
    assert done.exit_code == 0, done.output
    return folder


def estimate(folder, out, *options, log="measurements.csv"):
    return run("estimate", folder / log, "--config", folder / "estimate.toml", "--out", out, *options)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_estimate(tmp_path, simulated, suffix):
    out = tmp_path / "new" / "folder"
    done = estimate(simulated, out, "--format", suffix)
    assert done.exit_code == 0, done.output
    assert "60 rows, 60 updates, 0 refused" in done.output
    assert "inside at 100 % of rows" in done.output
    assert {file.name for file in out.iterdir()} == {
        f"results.{suffix}",
        "measured.csv",
        "estimate.png",
        "summary.json",
    }
    for file in out.iterdir():
        assert str(file) in done.output.replace("\n", "")
    results = Result.read(out / f"results.{suffix}")
    configuration = read_configuration(simulated / "estimate.toml")
    expected = estimation.estimate(logs.read_log(simulated / "measurements.csv", configuration), configuration)
    np.testing.assert_array_equal(results.shapes, expected.result.shapes)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["updates"] == 60
    assert summary["results"] == f"results.{suffix}"
    assert summary["title"] == "measurements.csv"


def test_json(tmp_path, simulated):
    done = estimate(simulated, tmp_path / "out", "--json")
    assert json.loads(done.stdout) == json.loads((tmp_path / "out" / "summary.json").read_text())


def test_nothing_is_replaced_without_force(tmp_path, simulated):
    out = tmp_path / "out"
    out.mkdir()
    (out / "estimate.png").write_text("mine")
    done = estimate(simulated, out)
    assert done.exit_code == 1
    assert "--force" in done.output
    assert (out / "estimate.png").read_text() == "mine"
    assert estimate(simulated, out, "--force").exit_code == 0
    assert (out / "estimate.png").read_bytes().startswith(b"\x89PNG")


def spoiled(folder, old, new):
    file = folder / "measurements.csv"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def test_a_bad_cell_is_named_by_line_and_column(tmp_path, simulated):
    lines = (simulated / "measurements.csv").read_text().splitlines()
    cells = lines[5].split(",")
    place = lines[1].split(",").index("direction2_by")
    cells[place] = "x7"
    lines[5] = ",".join(cells)
    (simulated / "measurements.csv").write_text("\n".join(lines) + "\n")
    done = estimate(simulated, tmp_path / "out")
    assert done.exit_code == 1
    assert "line 6" in done.output
    assert "direction2_by" in done.output
    assert "Traceback" not in done.output
    assert not (tmp_path / "out").exists()


def test_what_is_wrong_with_a_configuration(tmp_path, simulated):
    text = (simulated / "estimate.toml").read_text()
    (simulated / "estimate.toml").write_text(text.replace("bound_deg_per_s", "bound_per_s"))
    done = estimate(simulated, tmp_path / "out")
    assert done.exit_code == 1
    assert "rate.bound_per_s" in done.output
    assert not (tmp_path / "out").exists()


def test_sets_that_do_not_meet(tmp_path, simulated):
    text = (simulated / "estimate.toml").read_text()
    (simulated / "estimate.toml").write_text(text.replace("bound_deg = 7.0", "bound_deg = 0.1"))
    done = estimate(simulated, tmp_path / "out")
    assert done.exit_code == 1
    assert "measurements.csv" in done.output
    assert "do not meet" in done.output or "no common point" in done.output
    assert not (tmp_path / "out").exists()


def test_the_command_line_at_fault(tmp_path, simulated):
    assert run("estimate", simulated / "measurements.csv", "--out", tmp_path / "out").exit_code == 2
    assert estimate(simulated, tmp_path / "out", "--format", "xlsx").exit_code == 2


def test_a_folder_that_cannot_be_written(tmp_path, simulated):
    (tmp_path / "out").write_text("a file")
    done = estimate(simulated, tmp_path / "out" / "deeper")
    assert done.exit_code == 1
    assert "Traceback" not in done.output


def test_a_figure_that_fails_leaves_no_summary(tmp_path, simulated, monkeypatch):
    out = tmp_path / "out"
    assert estimate(simulated, out).exit_code == 0

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("elliptude.report.figures.save", full)
    done = estimate(simulated, out, "--force")
    assert done.exit_code == 1
    assert "no space left" in done.output
    assert not (out / "summary.json").exists()
    assert not [file for file in out.iterdir() if file.name.startswith(".")]


def test_as_a_program_without_a_terminal(tmp_path, simulated):
    program = [sys.executable, "-c", "from elliptude.cli import main; main()"]
    arguments = [simulated / "measurements.csv", "--config", simulated / "estimate.toml", "--out", tmp_path / "out"]
    done = subprocess.run([*program, "estimate", *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    # No progress bar: nothing, or plain lines on a slow machine.
    assert all(re.fullmatch(r"\w+ [\d,]+ rows, \d+ s so far", line) for line in done.stderr.splitlines()), done.stderr
    assert stat.S_IMODE((tmp_path / "out" / "results.csv").stat().st_mode) & stat.S_IRGRP


@pytest.mark.parametrize("name", ["orbit", "pendulum"])
@pytest.mark.parametrize("directions", ["three", "two"])
def test_scenarios_with_many_seeds(name, directions):
    """The issue's figure for the orbit: mean error after the 6th update at most 3.5 degrees."""
    scenario = scenarios.load(name)
    truth = simulation.truth(scenario)
    estimations = []
    for seed in range(100):
        simulated = simulation.measure(scenario, truth, seed=seed, directions=directions, bound_deg=7.0)
        tables = configuration_tables(scenario, simulated)
        tables["estimator"] = {"mode": "paper", "when_sets_do_not_meet": "skip"}
        configuration = Configuration.model_validate(tables)
        estimations.append(estimation.estimate(logs.log_of(simulated.measurements), configuration))
    line = demo._line(name, "first_order", estimations, 0.0)
    assert line.error_deg <= 3.5
    assert line.inside >= 0.99
    assert line.refused == 0


def test_demo(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "_SEEDS", 3)
    for _ in range(2):  # what is there is replaced
        done = run("demo", "--out", tmp_path / "demo")
        assert done.exit_code == 0, done.output
    text = done.output
    for case in (
        "orbit, three directions",
        "pendulum, two directions",
        "Fermi, Sun alone",
        "Fermi, Sun + synthetic star",
    ):
        assert case in text
    assert "…" not in text
    named = [line for line in text.splitlines() if line.startswith(str(tmp_path))]
    assert named
    for line in named:
        assert (tmp_path / "demo" / line).stat().st_size > 0
    lines = json.loads((tmp_path / "demo" / "demo.json").read_text())
    assert len(lines) == 11
    first = {line["case"]: line for line in reversed(lines)}
    assert [name for name, line in first.items() if line["mode"] != "guaranteed"] == ["Fermi, Sun alone"]
    for line in lines:
        if line["mode"] == "guaranteed":
            assert (line["inside"], line["refused"]) == (1.0, 0)
            assert line["inside_at_worst"] in (1.0, None)
            assert line["error_deg"] < line["bound_deg"] < 20.0
    assert all(line["elapsed_s"] < 60.0 for line in lines)
    fermi = [line for line in lines if line["case"].startswith("Fermi")]
    assert [line["inside"] for line in fermi] == [1.0, 1.0, 1.0]
    # The files are a log and a configuration like anybody's.
    for place in ("fermi/sun", "fermi/sun-and-star-guaranteed", "pendulum-two-guaranteed"):
        again = estimate(tmp_path / "demo" / place, tmp_path / "again", "--json", "--force")
        assert again.exit_code == 0, again.output
        assert json.loads(again.stdout)["inside_share_of_rows"] == 1.0
        kept = tmp_path / "demo" / place / "measured.csv"
        assert kept.read_text() == (tmp_path / "again" / "measured.csv").read_text()


def changed_cell(folder, line, column, cell):
    lines = (folder / "measurements.csv").read_text().splitlines()
    cells = lines[line - 1].split(",")
    cells[lines[1].split(",").index(column)] = cell
    lines[line - 1] = ",".join(cells)
    (folder / "measurements.csv").write_text("\n".join(lines) + "\n")


def test_a_truth_beyond_all_numbers(tmp_path, simulated):
    changed_cell(simulated, 6, "wx", "1e300")
    done = estimate(simulated, tmp_path / "out")
    assert done.exit_code == 1
    assert "measurements.csv: line 6, column 6 (wx)" in "".join(done.output.splitlines())
    assert "1e+300" in done.output
    assert not (tmp_path / "out").exists()


def test_a_direction_that_is_zero(tmp_path, simulated):
    for axis in "xyz":
        changed_cell(simulated, 6, f"direction1_b{axis}", "0")
    done = estimate(simulated, tmp_path / "out")
    assert done.exit_code == 1
    assert "line 6, column 9 (direction1_bx): 'direction1' has no direction" in done.output.replace("\n", "")
    assert not (tmp_path / "out").exists()
