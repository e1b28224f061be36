"""No command replaces what it reads, or writes two outputs to one file, also with --force."""

import pytest
from elliptude import cli
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
