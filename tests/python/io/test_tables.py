"""Tables: every bit comes back, a bad file is refused with the place, nothing is left half-written."""

import dataclasses
import errno
import gzip
import os
import resource
import stat
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from elliptude.io import column_files, tables
from elliptude.io.files import FileError, replacing, write_json
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

FORMATS = ["csv", "parquet"]


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def measurements(rng, count=7, rate=True, truth=True):
    directions = rng.standard_normal((count, 2, 3))
    directions[2, 0] = directions[3] = np.nan
    rates = rng.standard_normal((count, 3)) * 1e-7
    rates[0] = np.nan
    return tables.Measurements(
        times=np.cumsum(rng.random(count)),
        sensors=("sun", "field_2"),
        directions=directions,
        references=rng.standard_normal((count, 2, 3)),
        angular_velocities=rates if rate else None,
        true_quaternions=rng.standard_normal((count, 4)) if truth else None,
        true_angular_velocities=rng.standard_normal((count, 3)) if truth else None,
    )


def results(rng, vector="rate", truth=True, count=5, **more):
    shapes = rng.standard_normal((count, 6, 6))
    shapes = shapes @ shapes.transpose(0, 2, 1)
    return tables.Result(
        times=np.arange(1.0, count + 1),
        quaternions=rng.standard_normal((count, 4)),
        vector=vector,
        vectors=rng.standard_normal((count, 3)),
        shapes=0.5 * (shapes + shapes.transpose(0, 2, 1)),
        half_widths=rng.random((count, 6)),
        largest_angles=rng.random(count),
        used=("sun field_2", "", "sun", "", "rate"),
        refused=("", "", "field_2 rate", "sun", ""),
        shares=np.array([0.0, np.nan, 0.5, np.nan, 1.0]),
        margins=np.array([0.1, np.nan, -0.5, 0.25, 1.0]),
        errors=rng.standard_normal((count, 6)) if truth else None,
        forms=np.array([0.1, np.nan, 2.0, 0.5, 1.0]) if truth else None,
        **more,
    )


def assert_same_bits(table, other):
    for field in dataclasses.fields(table):
        a, b = getattr(table, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert a.shape == b.shape, field.name
            assert np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes(), field.name
        else:
            assert a == b, field.name


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("options", [{}, {"rate": False}, {"truth": False}, {"rate": False, "truth": False}])
def test_measurements_come_back(tmp_path, rng, suffix, options):
    written = measurements(rng, **options)
    written.write(tmp_path / f"log.{suffix}")
    assert_same_bits(written, tables.Measurements.read(tmp_path / f"log.{suffix}"))


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("options", [{}, {"vector": "bias"}, {"truth": False}])
def test_results_come_back(tmp_path, rng, suffix, options):
    written = results(rng, **options)
    written.write(tmp_path / f"results.{suffix}")
    assert_same_bits(written, tables.Result.read(tmp_path / f"results.{suffix}"))


def test_roll_pitch_and_yaw_come_back_also_without_an_attitude(tmp_path, rng):
    angles = rng.standard_normal((5, 9))
    angles[2, 6:] = angles[3] = np.nan
    written = results(rng, roll_pitch_yaw=angles)
    written.write(tmp_path / "results.csv")
    assert_same_bits(written, tables.Result.read(tmp_path / "results.csv"))
    names = column_files.column_names(tmp_path / "results.csv", "results")
    first = names.index("roll")
    assert names[first : first + 9] == (
        *("roll", "roll_from", "roll_to", "pitch", "pitch_from", "pitch_to"),
        *("yaw", "yaw_from", "yaw_to"),
    )
    np.testing.assert_array_equal(
        column_files.read_columns(tmp_path / "results.csv", optional=[("yaw_to",)])["yaw_to"], angles[:, 8]
    )


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # a busy machine is no fault
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1))
def test_every_number_comes_back(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("numbers") / "log.csv"
    columns = {"time_s": np.arange(float(len(numbers))), "x": np.array(numbers)}
    column_files.write_columns(path, "measurements", columns)
    back = column_files.read_columns(path, numbers=["x"])
    assert back["x"].tobytes() == columns["x"].tobytes()


def test_columns_of_results(tmp_path, rng):
    results(rng).write(tmp_path / "results.csv")
    names = column_files.column_names(tmp_path / "results.csv", "results")
    assert names[:9] == ("time_s", "qw", "qx", "qy", "qz", "wx", "wy", "wz", "P11")
    assert len([name for name in names if name.startswith("P")]) == 21
    assert (tmp_path / "results.csv").read_text().startswith("# elliptude results 1\ntime_s,qw,")
    written, columns = (
        results(np.random.default_rng(1)),
        column_files.read_columns(tmp_path / "results.csv", numbers=["P24"]),
    )
    np.testing.assert_array_equal(columns["P24"], written.shapes[:, 1, 3])


def test_other_readers(tmp_path, rng):
    """As docs/tables.md says."""
    log = measurements(rng, rate=False)
    log.write(tmp_path / "log.csv")
    table = np.genfromtxt(tmp_path / "log.csv", delimiter=",", skip_header=1, names=True)
    np.testing.assert_array_equal(table["sun_by"], log.directions[:, 0, 1])


def test_quaternions_and_attitudes():
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 2])
    quaternion = tables.quaternions_from_attitudes(turn.as_matrix()[None])
    np.testing.assert_allclose(quaternion, [[np.sqrt(0.5), 0, 0, np.sqrt(0.5)]], atol=1e-15)
    np.testing.assert_allclose(tables.attitudes_from_quaternions(quaternion)[0], turn.as_matrix(), atol=1e-15)


# --- other programs' files --------------------------------------------------------------------------------------------

HEADER = "time_s,x,y,note\n"


def write(tmp_path, text, name="log.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read(path):
    return column_files.read_columns(path, numbers=["x"], optional=[("y",)])


@pytest.mark.parametrize(
    "text",
    [
        HEADER + "0,1,,a\n1,2,3,b\n",
        "# a comment\n\n# another\n" + HEADER + "0,1,,a\n\n1,2,3,b\n\n",
        "\ufeff" + HEADER + "0,1,,a\n1,2,3,b",
        (HEADER + "0,1,,a\n1,2,3,b\n").replace("\n", "\r\n"),
        'note,"y","x",time_s\n"a, b",,1,0\nb,3.0e0, 2,+1\n'.replace("+1", "1"),
    ],
)
def test_csv_of_other_programs(tmp_path, text):
    columns = read(write(tmp_path, text))
    np.testing.assert_array_equal(columns["time_s"], [0, 1])
    np.testing.assert_array_equal(columns["x"], [1, 2])
    np.testing.assert_array_equal(columns["y"], [np.nan, 3])
    assert set(columns) == {"time_s", "x", "y"}


def test_compressed_csv(tmp_path):
    path = write(tmp_path, gzip.compress((HEADER + "0,1,,a\n1,2,3,b\n").encode()), "log.csv.gz")
    np.testing.assert_array_equal(read(path)["x"], [1, 2])
    path = write(tmp_path, gzip.compress((HEADER + "0,1,,a\n1,zwei,3,b\n").encode()), "bad.csv.gz")
    with pytest.raises(FileError, match=r"bad\.csv\.gz: line 3, column 2 \(x\): not a number: 'zwei'"):
        read(path)
    path = write(tmp_path, b"not gzip at all", "not.csv.gz")
    with pytest.raises(FileError, match=r"not\.csv\.gz: "):
        read(path)


def test_parquet_of_other_programs(tmp_path):
    table = pa.table(
        {"time_s": pa.array([0, 1]), "x": pa.array([1, 2], pa.float32()), "y": [None, 3.0], "note": ["a", "b"]}
    )
    pa.parquet.write_table(table, tmp_path / "log.parquet")
    columns = read(tmp_path / "log.parquet")
    np.testing.assert_array_equal(columns["time_s"], [0.0, 1.0])
    np.testing.assert_array_equal(columns["y"], [np.nan, 3.0])
    assert columns["x"].dtype == np.float64
    with pytest.raises(FileError, match="column 'note' is of type string, not of numbers"):
        column_files.read_columns(tmp_path / "log.parquet", numbers=["note"])
    with pytest.raises(FileError, match="row 1, column 'y': empty"):
        column_files.read_columns(tmp_path / "log.parquet", numbers=["y"])
    pa.parquet.write_table(table.set_column(1, "x", [[1.0, np.inf]]), tmp_path / "log.parquet")
    with pytest.raises(FileError, match="row 2, column 'x': not a finite number"):
        read(tmp_path / "log.parquet")
    with pytest.raises(FileError, match=r"log\.parquet: not a Parquet file"):
        read(write(tmp_path, "time_s,x\n", "log.parquet"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty, not even a header"),
        ("# elliptude measurements 1\n\n", "empty, not even a header"),
        (HEADER, "a header, but no rows below it"),
        ("time_s,y\n0,1\n", "no column 'x'; the columns are time_s, y"),
        ("time_s,x,x,y\n0,1,1,1\n", "two columns 'x'"),
        ("t;x;y\n0;1;2\n", "no column 'time_s'; the columns are t, x, y"),
        (HEADER + "0,1,,\n1,fast,,\n", "line 3, column 2 (x): not a number: 'fast'"),
        (HEADER + "\n\n0,1,,\n\n1,2,0x10,\n", "line 6, column 3 (y): not a number: '0x10'"),
        ("# c\n" + HEADER + "0,1,,\n1,1_000,,\n", "line 4, column 2 (x): not a number: '1_000'"),
        (HEADER + "0,1,,\n1,2,3\n", "line 3: 3 columns, but the header has 4"),
        (HEADER + "0,1,,\n1,2,3,4,5\n", "line 3: 5 columns, but the header has 4"),
        (HEADER + "0,1,,\n1,nan,,\n", "line 3, column 2 (x): not a finite number"),
        (HEADER + "0,1,NaN,\n", "line 2, column 3 (y): not a finite number; leave empty what is not known: 'NaN'"),
        (HEADER + "0,1,-inf,\n", "line 2, column 3 (y): not a finite number"),
        (HEADER + "0,1,1e400,\n", "line 2, column 3 (y): not a finite number; leave empty what is not known: '1e400'"),
        (HEADER + "0,1,,\n\n1,,,\n", "line 4, column 2 (x): empty"),
        (HEADER + "0,1,,\n,1,,\n", "line 3, column 1 (time_s): empty"),
        (HEADER + "0,1,,\n2,1,,\n2,1,,\n", "line 4, column 1 (time_s): not after the time of the row before: '2'"),
        (HEADER + '0,1,,"two\nlines"\n1,x,,\n', "not a number: 'x'"),
        (HEADER.encode() + b"0,\xff\x00,,\n", "line 2, column 2 (x): not a number"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "not text"),
    ],
)
def test_bad_csv_is_refused_with_its_place(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(FileError) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_parts_of_a_direction_are_empty_only_together(tmp_path, rng):
    log = measurements(rng, count=5)
    log.directions[4, 1, 2] = np.nan
    log.write(tmp_path / "log.csv")
    with pytest.raises(
        FileError, match=r"line 7, column 15 \(field_2_bx\): a number, but field_2_bx field_2_by field_2_bz"
    ):
        tables.Measurements.read(tmp_path / "log.csv")


def test_kind_and_version(tmp_path, rng):
    for suffix in FORMATS:
        path = tmp_path / f"log.{suffix}"
        measurements(rng).write(path)
        with pytest.raises(FileError, match="a table of measurements, where one of results is needed"):
            tables.Result.read(path)
    csv = tmp_path / "log.csv"
    csv.write_text(csv.read_text().replace("measurements 1", "measurements 2", 1))
    with pytest.raises(FileError, match="version 2 of the format; this elliptude reads up to version 1"):
        tables.Measurements.read(csv)
    with pytest.raises(FileError, match="version 2"):
        column_files.read_columns(csv)
    csv.write_text(csv.read_text().split("\n", 1)[1])
    assert tables.Measurements.read(csv).sensors == ("sun", "field_2")


def test_no_such_file(tmp_path):
    for path in (tmp_path / "none.csv", tmp_path / "none.parquet"):
        with pytest.raises(FileError, match="no such file"):
            read(path)
    with pytest.raises(FileError, match="a folder, where a table is needed"):
        read(tmp_path)


def test_large_log_is_read_fast_and_its_last_line_found(tmp_path):
    count = 200_000
    columns = {"time_s": np.arange(float(count)), "x": np.random.default_rng(0).standard_normal(count)}
    path = tmp_path / "log.csv"
    column_files.write_columns(path, "measurements", columns)
    np.testing.assert_array_equal(column_files.read_columns(path, numbers=["x"])["x"], columns["x"])
    with path.open("a") as file:
        file.write("200000,oops\n")
    with pytest.raises(FileError, match=r"line 200003, column 2 \(x\)"):
        column_files.read_columns(path, numbers=["x"])


# --- writing ----------------------------------------------------------------------------------------------------------


def test_infinity_and_unknown_suffix_are_not_written(tmp_path):
    with pytest.raises(ValueError, match="column x: a table holds no infinite numbers"):
        column_files.write_columns(tmp_path / "log.csv", "measurements", {"x": np.array([np.inf])})
    with pytest.raises(FileError, match=r"a table's name ends in \.csv or \.parquet"):
        column_files.write_columns(tmp_path / "log.xlsx", "measurements", {"x": np.array([1.0])})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_failed_write_leaves_what_was_there(tmp_path, failure):
    path = tmp_path / "log.csv"

    def fail():
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise failure

    with pytest.raises(failure):
        fail()
    assert list(tmp_path.iterdir()) == []
    path.write_text("old")
    with pytest.raises(failure):
        fail()
    assert [file.name for file in tmp_path.iterdir()] == ["log.csv"]
    assert path.read_text() == "old"


def test_killed_write_leaves_nothing_under_the_final_name(tmp_path):
    program = f"""
import os, signal
from elliptude.io.files import replacing
with replacing({str(tmp_path / "log.csv")!r}) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == -9
    assert not (tmp_path / "log.csv").exists()


@pytest.mark.parametrize("suffix", FORMATS)
def test_full_disk_is_a_clear_error(tmp_path, suffix):
    columns = {"time_s": np.random.default_rng(0).random(100_000)}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(FileError, match=rf"log\.{suffix}: not written: .*{os.strerror(errno.EFBIG)}"):
            column_files.write_columns(tmp_path / f"log.{suffix}", "measurements", columns)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


def test_written_files_have_the_permissions_of_any_other(tmp_path):
    write_json(tmp_path / "a.json", {"x": [1]})
    (tmp_path / "b.json").write_text("")
    assert stat.S_IMODE((tmp_path / "a.json").stat().st_mode) == stat.S_IMODE((tmp_path / "b.json").stat().st_mode)
    assert (tmp_path / "a.json").read_text() == '{\n  "x": [\n    1\n  ]\n}\n'
    with pytest.raises(FileError, match="not written: no such file or folder"):
        write_json(tmp_path / "none" / "a.json", {})


def test_spaces_about_names_do_not_matter(tmp_path):
    path = write(tmp_path, "time_s, x\n0, 1\n1, 2\n")
    np.testing.assert_array_equal(column_files.read_columns(path, numbers=["x"])["x"], [1.0, 2.0])


def test_the_columns_there_are_without_a_space(tmp_path):
    with pytest.raises(FileError, match="no column 'y'; the columns are time_s, x"):
        column_files.read_columns(write(tmp_path, "time_s, x\n0, 1\n"), numbers=["y"])
