"""No command replaces what it reads, or writes two outputs to one file, also with --force."""

import html
import json
import shutil

import numpy as np
import pytest
from elliptude import cli
from elliptude.cli import estimate as estimate_command
from elliptude.cli.outputs import print_table
from elliptude.io.files import FileError
from elliptude.report.estimated.reading import read_run
from rich.table import Table
from typer.testing import CliRunner

HEADER = ",".join(
    ["Time (s)", *(f"Gyroscope {a} (deg/s)" for a in "XYZ"), *(f"Accelerometer {a} (m/s^2)" for a in "XYZ")]
)
LOG = "\n".join([HEADER, *(f"{0.01 * i:.2f},0,0,{0.1 * (i % 2)},0,0,9.8" for i in range(400))]) + "\n"
CONFIG = """
time_column = "Time (s)"
reference_frame = "ENU"
estimator = { mode = "guaranteed" }
[flow]
kind = "gyro"
columns = ["Gyroscope X (deg/s)", "Gyroscope Y (deg/s)", "Gyroscope Z (deg/s)"]
unit = "deg/s"
noise_deg_per_s = 1.0
[[directions]]
name = "up"
kind = "accelerometer"
columns = ["Accelerometer X (m/s^2)", "Accelerometer Y (m/s^2)", "Accelerometer Z (m/s^2)"]
unit = "m/s^2"
bound_deg = 5.0
"""
TABLE = "time_s,qw,qx,qy,qz\n0,1,0,0,0\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text(LOG)
    (tmp_path / "results.csv").symlink_to("log.csv")
    for name in ("config.toml", "estimate.toml", "plan.toml"):
        (tmp_path / name).write_text(CONFIG)
    for name in ("summary.json", "reference.tum", "monitor.csv"):
        (tmp_path / name).write_text(TABLE)
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        ("bounds log.csv --out log.csv", "log.csv"),
        ("bounds log.csv --out ./log.csv", "log.csv"),
        ("bounds log.csv --rule log.csv", "log.csv"),
        ("bounds log.csv config.toml --out config.toml", "config.toml"),
        ("convert log.csv log.csv", "log.csv"),
        ("convert log.csv results.csv", "results.csv"),
        ("calibrate log.csv config.toml --out config.toml", "config.toml"),
        ("estimate log.csv --config config.toml --out .", "results.csv"),
        ("estimate log.csv --config config.toml --out new --report config.toml", "config.toml"),
        ("report results.csv --out results.csv", "results.csv"),
        ("report results.csv --out summary.json", "summary.json"),
        ("compare results.csv reference.tum --tum .", "reference.tum"),
        ("monitor results.csv --estimate monitor.csv --out .", "monitor.csv"),
        ("simulate estimate.toml --out .", "estimate.toml"),
    ],
)
def test_what_is_read_is_not_replaced(folder, arguments, file):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    result = CliRunner().invoke(cli.make_app(), [*arguments.split(), "--force"])
    assert result.exit_code, result.output
    assert before == {path.name: path.read_bytes() for path in folder.iterdir()}
    if not arguments.startswith("simulate"):  # a scenario is read before
        assert f"{file}: not written: it is what the command reads; give the output another name" in result.output


def test_two_outputs_have_two_names(folder):
    arguments = ["bounds", "log.csv", "--out", "new.toml", "--rule", "./new.toml"]
    result = CliRunner().invoke(cli.make_app(), arguments)
    assert result.exit_code == 1
    assert "new.toml: not written: two outputs have this name; give one of them another" in result.output
    assert not (folder / "new.toml").exists()


def test_a_folder_of_results_has_one_table(tmp_path):
    """A table of another format is of an earlier estimation: with both, `report` would not know which one counts."""
    log, config, out = tmp_path / "log.csv", tmp_path / "config.toml", tmp_path / "out"
    log.write_text(LOG)
    config.write_text(CONFIG)
    estimate = ["estimate", str(log), "--config", str(config), "--out", str(out)]
    for extra, kept in (
        ((), "results.csv"), (("--format", "parquet", "--force"), "results.parquet"), (("--force",), "results.csv"),
    ):  # fmt: skip
        done = CliRunner().invoke(cli.make_app(), [*estimate, *extra])
        assert done.exit_code == 0, done.output
        assert [one.name for one in out.glob("results.*")] == [kept]
    (out / "summary.json").unlink()
    (out / "estimate.png").unlink()
    (out / "dropped.csv").unlink()
    (out / "measured.csv").unlink()
    done = CliRunner().invoke(cli.make_app(), [*estimate, "--format", "parquet"])
    assert done.exit_code == 1
    assert "results.csv is there already; --force replaces it" in " ".join(done.output.split())


@pytest.mark.parametrize(
    ("command", "ending"),
    [
        ("view results.csv --out name.xyz", ".rrd"),
        ("view results.csv --out name", ".rrd"),
        ("report results.csv --out page.pdf", ".html or .htm"),
        ("estimate log.csv --config config.toml --out out --report page.xyz", ".html or .htm"),
        ("bounds log.csv --out found.xyz", ".toml"),
        ("calibrate log.csv config.toml --out found.xyz", ".toml"),
        ("convert log.csv name.xyz", ".csv, .parquet, .npz"),
    ],
)
def test_a_wrong_ending_is_refused_with_the_right_ones(folder, command, ending):
    """Before the work, and before what another program is missing for."""
    before = sorted(folder.iterdir())
    done = CliRunner().invoke(cli.make_app(), command.split())
    assert done.exit_code == 1, done.output
    said = " ".join(done.output.split())
    assert said.endswith(f"its name must end in {ending}") or said.endswith(f"what is written ends in {ending}"), said
    assert sorted(folder.iterdir()) == before


@pytest.fixture
def estimated(folder):
    """Results of a log in which the accelerometer is left out at times, and the page that `estimate` wrote."""
    (folder / "results.csv").unlink()
    rows = LOG.splitlines()
    for line in range(200, 204):
        rows[line] = rows[line].removesuffix("0,9.8") + "9.8,0"
    # A second without samples.
    rows[301:] = [f"{1.0 + float(time)!r},{rest}" for time, _, rest in (row.partition(",") for row in rows[301:])]
    (folder / "log.csv").write_text("\n".join(rows) + "\n")
    config = CONFIG.replace("noise_deg_per_s", "longest_interval_s = 2.0\nnoise_deg_per_s")
    (folder / "config.toml").write_text(config.replace('"guaranteed"', '"guaranteed", policy = "drop_measurement"'))
    done = run("estimate log.csv --config config.toml --out out --report page.html")
    assert done.exit_code == 0, done.output
    return folder


def run(arguments):
    return CliRunner().invoke(cli.make_app(), arguments.split())


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_report_of_results_is_that_of_their_estimation(estimated, suffix):
    """With what the sensors measured, where there was no sample, and what was left out."""
    done = run(f"estimate log.csv --config config.toml --out out --report page.html --force --format {suffix}")
    assert done.exit_code == 0, done.output
    assert "measured.csv" in done.output
    (measured,) = [one for one in read_run("out")[0].measured if one.name == "up"]
    assert (measured.kind, measured.unit) == ("accelerometer", "m/s²")
    assert len(measured.left_out) == 4
    assert measured.gaps == [(3.0 - 0.01, 4.0)]
    assert run("report out --out again.html --pictures pictures").exit_code == 0
    assert (estimated / "again.html").read_bytes() == (estimated / "page.html").read_bytes()
    assert "What the sensors measured" in (estimated / "page.html").read_text(encoding="utf-8")
    assert (estimated / "pictures" / "measured.png").stat().st_size > 10_000


def test_results_without_what_was_measured_are_shown_as_before(estimated):
    (estimated / "out" / "measured.csv").unlink()
    assert run("report out --out again.html --pictures pictures").exit_code == 0
    assert 'aria-labelledby="h-measured" hidden' in (estimated / "again.html").read_text(encoding="utf-8")
    assert not (estimated / "pictures" / "measured.png").exists()


NOT_DRAWN = "what the sensors measured is not drawn: out/measured.csv: "


def shown_without_measured(folder):
    """What `report` says of what the sensors measured, which it does not draw; the page says the same."""
    done = run("report out --out again.html --pictures pictures --json --force")
    assert done.exit_code == 0, done.output
    json.loads(done.stdout)
    page = (folder / "again.html").read_text(encoding="utf-8")
    assert 'aria-labelledby="h-measured" hidden' in page
    assert (folder / "pictures" / "bands.png").stat().st_size > 10_000
    assert not (folder / "pictures" / "measured.png").exists()
    (said,) = [line for line in done.stderr.splitlines() if line.startswith(NOT_DRAWN)]
    assert html.escape(said) in page
    return said.removeprefix(NOT_DRAWN)


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"# elliptude measured 1\ntime_s,sensor\n0,up\n", "no column 'x'"),
        (b"", "empty, not even a header"),
        (bytes(range(256)), "not text"),
        (b"# elliptude dropped 1\ntime_s\n", "a table of dropped, where one of measured is needed"),
    ],
)
def test_damaged_measurements_are_said_and_all_else_is_drawn(estimated, content, fault):
    (estimated / "out" / "measured.csv").write_bytes(content)
    assert fault in shown_without_measured(estimated)


def test_measurements_of_other_results_are_not_drawn(estimated):
    """Of an earlier run of the same log, or of another recording with the same times."""
    (estimated / "other").mkdir()
    earlier = ("bound_deg = 5.0", "bound_deg = 6.0", "config.toml")
    for before, after, name in (earlier, ("0.1,0,0,9.8", "0.2,0,0.1,9.8", "log.csv")):
        changed = estimated / "other" / name
        changed.write_text((estimated / name).read_text().replace(before, after))
        files = {one: f"other/{one}" if one == name else one for one in ("log.csv", "config.toml")}
        done = run(f"estimate {files['log.csv']} --config {files['config.toml']} --out other/out --force")
        assert done.exit_code == 0, done.output
        assert read_run("other/out")[0].measured
        shutil.copy("other/out/measured.csv", "out/measured.csv")
        assert "not of results.csv as it is now" in shown_without_measured(estimated)


def test_what_was_measured_is_not_replaced_without_force_nor_by_what_is_made_of_it(estimated):
    kept = (estimated / "out" / "measured.csv").read_bytes()
    done = run("estimate log.csv --config config.toml --out out")
    assert done.exit_code == 1
    for name in ("results.csv", "dropped.csv", "estimate.png", "summary.json"):
        (estimated / "out" / name).unlink()
    done = run("estimate log.csv --config config.toml --out out")
    assert "out/measured.csv is there already; --force replaces it" in done.output
    assert (estimated / "out" / "measured.csv").read_bytes() == kept


def test_a_new_table_has_no_measurements_of_an_older_one(estimated, monkeypatch):
    """If writing ends between the two."""

    def no_space(*_):
        raise FileError("dropped.csv: no space left on device")

    monkeypatch.setattr(estimate_command, "write_columns", no_space)
    assert run("estimate log.csv --config config.toml --out out --force").exit_code == 1
    assert {one.name for one in (estimated / "out").iterdir()} == {"results.csv", "estimate.png"}


def test_a_table_is_as_wide_as_the_terminal_or_as_its_cells_must_be(monkeypatch, capsys):
    table = Table()
    for heading in ("what may be broken", "number"):
        table.add_column(heading, no_wrap=heading == "number")
    table.add_row("words and words and words and words", "12345 678901 345678 012345")
    for width in (20, 50, 200):
        monkeypatch.setenv("COLUMNS", str(width))
        print_table(table)
        printed = capsys.readouterr().out
        assert "…" not in printed
        assert "12345 678901 345678 012345" in printed
        assert max(map(len, printed.splitlines())) <= max(width, 45)


def test_bounds_cuts_nothing_at_eighty_columns(tmp_path):
    """A statement has a line of its own, its reason is below it, and all tables fit."""
    rng = np.random.default_rng(7)
    times = 0.01 * np.arange(3000)
    rates = np.where(times[:, None] > 12.0, 20.0 * np.sin(times)[:, None], 0.0) * [0.0, 0.0, 1.0]
    sensors = np.column_stack([rates, np.tile([0.0, 0.0, 9.81], (3000, 1))]) + rng.normal(0.0, 0.02, (3000, 6))
    np.savetxt(tmp_path / "log.csv", np.column_stack([times, sensors]), delimiter=",", header=HEADER, comments="")
    arguments = ["bounds", str(tmp_path / "log.csv"), "--out", str(tmp_path / "config.toml")]
    done = CliRunner().invoke(cli.make_app(), arguments, env={"COLUMNS": "80"})
    assert done.exit_code == 0, done.output
    assert "…" not in done.output
    lines = done.output.splitlines()
    begin = next(i for i, line in enumerate(lines) if line.startswith("  gyro.largest_rate_deg_per_s = "))
    reason = [line for line in lines[begin + 1 : begin + 6] if line.startswith("      ")]
    assert len(reason) == 5
    assert max(map(len, reason)) <= 80
    assert "      for the reason of gyro.largest_rate_deg_per_s" in lines
    rule = next(i for i, line in enumerate(lines) if line.startswith("──"))
    assert len(lines[rule]) <= 80
