"""`elliptude convert`, as typed: numbers stay what they are, and a file is there in whole or not at all."""

import errno
import itertools
import os
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import recorders
import tomlkit
from elliptude import cli
from elliptude.configuration import read_configuration
from elliptude.io import column_files, tables
from elliptude.io.readers.open import open_log
from elliptude.logs import conversion, read_log
from test_check import files, recording
from test_check import tables as tables_of_check
from typer.testing import CliRunner


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def columns(path):
    file, found = open_log(path), {}
    for name in file.columns:
        cells = [batch[name] for batch in file.batches([name])]
        values = np.concatenate([some.values.astype(float) for some in cells])
        values[np.concatenate([some.empty for some in cells])] = np.nan
        found[name] = values
    return found


def assert_same(a, b):
    assert list(a) == list(b)
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", 20_000)
    monkeypatch.setattr("elliptude.io.readers.parquet.BATCH_ROWS", 300)
    rng = np.random.default_rng(0)
    arrays = {"t": np.cumsum(rng.random(1000)), "gyr": rng.standard_normal((1000, 3)) * 1e-7}
    arrays["gyr"][::5, 1] = np.nan
    np.savez(tmp_path / "log.npz", **arrays)
    return tmp_path / "log.npz"


def test_through_all_formats_and_back(tmp_path, log):
    chain = [log, *(tmp_path / name for name in ("a.csv", "b.parquet", "c.csv", "d.npz", "e.parquet", "f.npz"))]
    for before, after in itertools.pairwise(chain):
        done = run("convert", before, after)
        assert done.exit_code == 0, done.output
        assert done.output.replace("\n", "") == f"{after}: 1000 rows"
        assert_same(columns(log), columns(after))


def test_text_stays_behind_and_names_with_commas_are_quoted(tmp_path):
    (tmp_path / "a.csv").write_text('t,"gyro, x",note\n0,1,a\n1,,b\n')
    assert run("convert", tmp_path / "a.csv", tmp_path / "b.csv").exit_code == 0
    assert (tmp_path / "b.csv").read_text() == 't,"gyro, x"\n0,1\n1,\n'
    assert run("convert", tmp_path / "b.csv", tmp_path / "c.parquet").exit_code == 0
    assert_same(columns(tmp_path / "b.csv"), columns(tmp_path / "c.parquet"))


def test_two_columns_of_one_name(tmp_path):
    """One of them would be lost; what commas at the end of the lines make are none."""
    (tmp_path / "a.csv").write_text("t,x,x\n0,1,2\n")
    done = run("convert", tmp_path / "a.csv", tmp_path / "b.csv")
    assert done.exit_code == 1
    assert "two columns 'x'" in done.output
    assert not (tmp_path / "b.csv").exists()
    (tmp_path / "a.csv").write_text("t,x,,\n0,1,,\n")
    assert run("convert", tmp_path / "a.csv", tmp_path / "b.csv").exit_code == 0
    assert (tmp_path / "b.csv").read_text() == "t,x\n0,1\n"


def test_nanoseconds_keep_their_digits(tmp_path):
    (tmp_path / "a.csv").write_text("t,x\n1700000000123456789,1\n1700000000123456790,2\n")
    for before, after in (("a.csv", "b.parquet"), ("b.parquet", "c.npz"), ("c.npz", "d.csv")):
        assert run("convert", tmp_path / before, tmp_path / after).exit_code == 0
    assert (tmp_path / "d.csv").read_text() == (tmp_path / "a.csv").read_text()


def test_every_format_says_from_which_second_its_times_count(tmp_path):
    label = "elliptude measurements 1; time_s counts from 1700000000 s"
    (tmp_path / "a.csv").write_text(f"# {label}\ntime_s,x\n0.5,1\n0.75,2\n")
    for before, after in (("a.csv", "b.parquet"), ("b.parquet", "c.npz"), ("c.npz", "d.npz"), ("d.npz", "e.csv")):
        assert run("convert", tmp_path / before, tmp_path / after).exit_code == 0
        assert column_files.origin_of(open_log(tmp_path / after)) == 1_700_000_000
        assert_same(columns(tmp_path / "a.csv"), columns(tmp_path / after))
    with np.load(tmp_path / "c.npz") as archive:
        assert archive["elliptude"] == label
    assert (tmp_path / "e.csv").read_text().startswith(f"# {label}\n")


def test_streams_of_a_ulog(tmp_path):
    pytest.importorskip("pyulog")
    stamps = np.arange(1, 6) * 1000
    topics = [("imu", 0, {"timestamp": stamps, "x": stamps}), ("mag", 0, {"timestamp": stamps[:2], "y": stamps[:2]})]
    recorders.write_ulog(tmp_path / "log.ulg", topics)
    done = run("convert", tmp_path / "log.ulg", tmp_path / "log.csv")
    assert done.exit_code == 1
    assert "more than one stream (imu, mag); --stream says which" in done.output.replace("\n", " ")
    assert not (tmp_path / "log.csv").exists()
    assert run("convert", tmp_path / "log.ulg", tmp_path / "log.csv", "--stream", "mag").exit_code == 0
    assert (tmp_path / "log.csv").read_text() == "mag.timestamp,mag.y\n1000,1000\n2000,2000\n"
    assert "no stream 'gps'" in run("convert", tmp_path / "log.ulg", tmp_path / "b.csv", "--stream", "gps").output
    assert run("convert", tmp_path / "log.ulg", tmp_path / "log.npz").exit_code == 0
    with np.load(tmp_path / "log.npz") as archive:
        np.testing.assert_array_equal(archive["imu.timestamp"], stamps)
        np.testing.assert_array_equal(archive["mag.y"], stamps[:2])


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_what_a_configuration_takes(tmp_path, suffix):
    arrays = recording(count=300)
    arrays["mag"][10:20] = np.nan
    log, configuration = files(tmp_path, arrays)
    target = tmp_path / f"measurements.{suffix}"
    done = run("convert", log, target, "--config", configuration)
    assert done.exit_code == 0, done.output
    written, expected = tables.Measurements.read(target), read_log(log, read_configuration(configuration))
    assert written.sensors == ("up", "field")
    np.testing.assert_array_equal(written.times, expected.times)
    np.testing.assert_array_equal(written.angular_velocities, expected.rates)
    np.testing.assert_allclose(written.true_attitudes, expected.true_attitudes, atol=1e-14)
    lengths = np.linalg.norm(expected.directions, axis=2, keepdims=True)
    np.testing.assert_allclose(written.directions, expected.directions / lengths, rtol=1e-15)
    np.testing.assert_allclose(written.references[0], [[0, 0, 1], [0, 0.2**0.5, -(0.8**0.5)]], atol=1e-15)


def test_what_is_there_stays_unless_told(tmp_path, log):
    (tmp_path / "a.csv").write_text("mine")
    done = run("convert", log, tmp_path / "a.csv")
    assert done.exit_code == 1
    assert "--force replaces it" in done.output.replace("\n", " ")
    assert (tmp_path / "a.csv").read_text() == "mine"
    assert run("convert", log, tmp_path / "a.csv", "--force").exit_code == 0
    done = run("convert", log, tmp_path / "a.xlsx")
    assert done.exit_code == 1
    assert "ends in .csv, .parquet, .npz" in done.output.replace("\n", " ")


# --- input at fault, through the command line -------------------------------------------------------------------------

CONFIGURATION = """
time_column = "t"
[flow]
kind = "gyro"
columns = ["x", "y", "z"]
noise_deg_per_s = 1.0
[start]
kind = "given"
attitude_qw_qx_qy_qz = [1.0, 0.0, 0.0, 0.0]
P_diagonal = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
"""


def commands(tmp_path, log):
    (tmp_path / "log.toml").write_text(CONFIGURATION)
    yield "check", log, tmp_path / "log.toml"
    yield "estimate", log, "--config", tmp_path / "log.toml", "--out", tmp_path / "out"
    yield "convert", log, tmp_path / "out.parquet", "--config", tmp_path / "log.toml"
    yield "convert", log, tmp_path / "out.csv"


def assert_refused(tmp_path, done, message):
    assert done.exit_code == 1, done.output
    assert message in done.output.replace("\n", " ").replace("  ", " ")
    assert "Traceback" not in done.output
    assert not [file.name for file in tmp_path.iterdir() if file.name.startswith(("out", "."))]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "empty, not even a header"),
        ("t,x,y,z\n", "a header, but no rows below it"),
        ("t,x,y,z\n0,1,2,3\n1,fast,2,3\n", "line 3, column 2 (x): not a number: 'fast'"),
        ("t,x,y,z\n0,1,2,3\n1,2,3\n", "line 3: 3 columns, but the header has 4"),
    ],
)
def test_files_at_fault(tmp_path, content, message):
    log = tmp_path / "log.csv"
    log.write_text(content)
    for command in commands(tmp_path, log):
        assert_refused(tmp_path, run(*command), message)


def test_no_such_file(tmp_path):
    for command in commands(tmp_path, tmp_path / "log.csv"):
        assert_refused(tmp_path, run(*command), "no such file")


def as_nobody():
    if os.geteuid() == 0:
        os.setegid(65534)
        os.seteuid(65534)


def as_before(user, group):
    os.seteuid(user)
    os.setegid(group)


@pytest.mark.skipif(sys.platform == "win32", reason="permissions are others there")
def test_no_permission_to_read(tmp_path):
    user, group = os.geteuid(), os.getegid()
    log = tmp_path / "log.csv"
    log.write_text("t,x,y,z\n0,1,2,3\n")
    given = list(commands(tmp_path, log))
    log.chmod(0)
    app = cli.make_app()
    for command in given:
        as_nobody()
        try:
            done = CliRunner().invoke(app, [str(argument) for argument in command])
        finally:
            as_before(user, group)
        assert_refused(tmp_path, done, "no permission")


def test_no_permission_to_write(tmp_path, log):
    user, group = os.geteuid(), os.getegid()
    folder = tmp_path / "closed"
    folder.mkdir()
    folder.chmod(0o555)
    app = cli.make_app()
    as_nobody()
    try:
        done = CliRunner().invoke(app, ["convert", str(log), str(folder / "out.csv")])
    finally:
        as_before(user, group)
    assert done.exit_code == 1
    assert "no permission" in done.output
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("suffix", conversion.SUFFIXES)
def test_full_disk(tmp_path, suffix):
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "log.npz", t=np.arange(50_000.0), x=rng.random((50_000, 3)))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        done = run("convert", tmp_path / "log.npz", tmp_path / f"out{suffix}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert_refused(tmp_path, done, os.strerror(errno.EFBIG))


def test_full_disk_while_estimating(tmp_path):
    log, configuration = files(tmp_path, recording(count=1000))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        done = run("estimate", log, "--config", configuration, "--out", tmp_path / "result")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert_refused(tmp_path, done, os.strerror(errno.EFBIG))
    assert not (tmp_path / "result").exists()


def test_interrupt_while_estimating(tmp_path):
    log, configuration = files(tmp_path, recording(count=60_000))
    program = [sys.executable, "-c", "from elliptude.cli import main; main()"]
    process = subprocess.Popen(
        [*program, "estimate", log, "--config", configuration, "--out", tmp_path / "result"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60.0
    while not list(tmp_path.glob("result/.results*")) and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert not (tmp_path / "result" / "summary.json").exists()
    assert not list(tmp_path.glob("result/.*"))


@pytest.mark.parametrize("suffix", conversion.SUFFIXES)
def test_interrupt(tmp_path, suffix):
    """Control-C in the midst of writing: exit code 130, and nothing is left."""
    count = 300_000
    columns = {
        "t": np.arange(float(count)),
        **dict(zip("xyz", np.random.default_rng(0).random((3, count)), strict=True)),
    }
    column_files.write_columns(tmp_path / "log.csv", "measurements", columns)
    program = [sys.executable, "-c", "from elliptude.cli import main; main()"]
    target = tmp_path / f"out{suffix}"
    # An archive is written at the end: the interrupt comes while the log is read.
    process = subprocess.Popen(
        [*program, "convert", tmp_path / "log.csv", target], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60.0
    while not list(tmp_path.glob(".out*")) and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert [file.name for file in tmp_path.iterdir()] == ["log.csv"]


# --- the same log in every format -------------------------------------------------------------------------------------


def test_estimates_do_not_depend_on_the_format(tmp_path):
    pytest.importorskip("rosbags")
    arrays = recording(count=400)
    del arrays["q"]
    arrays["t"] = np.arange(400) / 100.0
    arrays["mag"][1::2] = np.nan  # as the bag has it
    log, _ = files(tmp_path, arrays)
    for name in ("log.csv", "log.parquet"):
        assert run("convert", log, tmp_path / name).exit_code == 0
    stamps = np.round(arrays["t"] * 1e9).astype(np.int64).tolist()
    recorders.write_bag(tmp_path / "bag", "mcap", stamps, arrays["gyr"], arrays["acc"], arrays["mag"])
    of_bag = ["/imu/data.angular_velocity", "/imu/data.linear_acceleration", "/imu/mag.magnetic_field"]
    results = []
    for name in ("log.npz", "log.csv", "log.parquet", "bag"):
        configuration = tables_of_check()
        del configuration["truth"]
        if name == "bag":
            del configuration["time_column"]
            for sensor, field in zip((configuration["flow"], *configuration["directions"]), of_bag, strict=True):
                sensor["columns"] = [f"{field}.{axis}" for axis in "xyz"]
        (tmp_path / "estimate.toml").write_text(tomlkit.dumps(configuration))
        out = tmp_path / f"out-{name}"
        done = run("estimate", tmp_path / name, "--config", tmp_path / "estimate.toml", "--out", out)
        assert done.exit_code == 0, done.output
        results.append((out / "results.csv").read_text())
    assert results[0].count("\n") == 402
    assert "up field" in results[0]
    assert all(other == results[0] for other in results)
