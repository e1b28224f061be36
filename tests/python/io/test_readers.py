"""Formats of logs: their columns, every number as it is in the file, and what is said of files that are at fault."""

import contextlib
import sqlite3
import sys
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import recorders
import scipy.io
from elliptude.io.files import FileError
from elliptude.io.readers.open import open_log
from elliptude.io.readers.text import csv as csv_files
from elliptude.io.readers.text.dialect import Stated


def column(file, name):
    cells = [batch[name] for batch in file.batches([name])]
    return np.concatenate([some.values for some in cells]), np.concatenate([some.empty for some in cells])


def test_csv_comes_in_batches_of_the_same_numbers(tmp_path, monkeypatch):
    numbers = np.random.default_rng(0).standard_normal((5000, 2))
    path = tmp_path / "log.csv"
    rows = "\n".join(f"{a!r},{b!r}" if i % 7 else f"{a!r}," for i, (a, b) in enumerate(numbers.tolist()))
    path.write_text("# a comment\na,b\n" + rows + "\n")
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", 10_000)
    file = open_log(path)
    assert len(list(file.batches(["a"]))) > 10
    np.testing.assert_array_equal(column(file, "a")[0], numbers[:, 0])
    values, empty = column(file, "b")
    np.testing.assert_array_equal(empty, np.arange(5000) % 7 == 0)
    np.testing.assert_array_equal(values[~empty], numbers[~empty, 1])
    assert file.place("b", 4999) == "line 5002, column 2 (b)"


def test_nanoseconds_in_csv_keep_their_digits(tmp_path):
    stamps = 1_700_000_000_123_456_789 + np.arange(3)
    path = tmp_path / "log.csv"
    path.write_text("t,x\n" + "".join(f"{stamp},0.5\n" for stamp in stamps))
    values, _ = column(open_log(path), "t")
    assert values.dtype == np.int64
    np.testing.assert_array_equal(values, stamps)
    path.write_text(path.read_text() + "1700000000123456792.5,1\n")
    with pytest.raises(FileError, match=r"line 5, column 1 \(t\): not a whole number, as the first one"):
        column(open_log(path), "t")


def test_parquet_in_batches(tmp_path, monkeypatch):
    stamps = pa.array(1_700_000_000_123_456_789 + np.arange(1000))
    table = pa.table({"t": stamps, "x": pa.array([None if i % 2 else 0.1 * i for i in range(1000)], pa.float32())})
    pa.parquet.write_table(table, tmp_path / "log.parquet")
    monkeypatch.setattr("elliptude.io.readers.parquet.BATCH_ROWS", 100)
    file = open_log(tmp_path / "log.parquet")
    values, _ = column(file, "t")
    np.testing.assert_array_equal(values, stamps.to_numpy())
    values, empty = column(file, "x")
    np.testing.assert_array_equal(empty, np.arange(1000) % 2 == 1)
    np.testing.assert_array_equal(values[::2], np.float32(0.1 * np.arange(0, 1000, 2)).astype(float))


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz(tmp_path, save):
    gyr = np.random.default_rng(0).standard_normal((5, 3)).astype(np.float32)
    gyr[2, 1] = np.nan
    save(
        tmp_path / "log.npz",
        t=np.arange(5),
        gyr=gyr,
        is_still=np.ones(5, bool),
        mag=np.ones((3, 3)),
        fs=5.0,
        names=["a"],
    )
    file = open_log(tmp_path / "log.npz")
    assert file.columns == ("t", "gyr[0]", "gyr[1]", "gyr[2]", "is_still", "mag[0]", "mag[1]", "mag[2]")
    assert file.stream("t") == file.stream("gyr[2]") != file.stream("mag[0]")
    values, empty = column(file, "gyr[1]")
    np.testing.assert_array_equal(values, gyr[:, 1].astype(float))
    np.testing.assert_array_equal(empty, [False, False, True, False, False])


def test_matlab(tmp_path):
    gyr = np.random.default_rng(0).standard_normal((5, 3))
    contents = {"t": np.arange(5.0)[:, None], "imu": {"gyr": gyr, "fs": 5.0}, "name": "a body", "row": np.ones((1, 5))}
    scipy.io.savemat(tmp_path / "log.mat", contents)
    file = open_log(tmp_path / "log.mat")
    assert set(file.columns) == {"t", "imu.gyr[0]", "imu.gyr[1]", "imu.gyr[2]", "imu.fs", "row"}
    assert file.stream("t") == file.stream("imu.gyr[2]") == file.stream("row") != file.stream("imu.fs")
    np.testing.assert_array_equal(column(file, "imu.gyr[1]")[0], gyr[:, 1])
    np.testing.assert_array_equal(column(file, "t")[0], np.arange(5.0))


@pytest.mark.parametrize("is_matlab", [False, True])
def test_hdf5(tmp_path, is_matlab):
    """A file of MATLAB since 7.3 has a text before it, and its matrices the other way round."""
    h5py = pytest.importorskip("h5py")
    gyr = np.random.default_rng(0).standard_normal((5, 3)).astype(np.float32)
    path = tmp_path / ("log.mat" if is_matlab else "log.h5")
    with h5py.File(path, "w", userblock_size=512 if is_matlab else 0) as file:
        file["t"] = np.arange(5.0)[None, :] if is_matlab else np.arange(5.0)
        file["imu/gyr"] = gyr.T if is_matlab else gyr
        file["imu/cube"], file["name"] = np.ones((2, 2, 2)), "a body"
        if is_matlab:
            file["t"].attrs["MATLAB_class"] = np.bytes_("double")
    file = open_log(path)
    assert set(file.columns) == {"t", "imu.gyr[0]", "imu.gyr[1]", "imu.gyr[2]"}
    np.testing.assert_array_equal(column(file, "imu.gyr[1]")[0], gyr[:, 1].astype(float))
    np.testing.assert_array_equal(column(file, "t")[0], np.arange(5.0))


def test_rows_at_a_rate(tmp_path, monkeypatch):
    """Times are counted from batch to batch, also where nothing else is read."""
    monkeypatch.setattr(csv_files, "BATCH_BYTES", 200)
    path = tmp_path / "log.csv"
    path.write_text("name,x\n" + "".join(f"a,{row}\n" for row in range(1000)))
    file = open_log(path, Stated(row_rate_hz=250.0))
    assert file.columns == ("name", "x", "row_time_s")
    assert file.place("row_time_s", 3) == "line 5"
    for names in (["row_time_s"], ["row_time_s", "x"]):
        batches = list(file.batches(names))
        assert len(batches) > 1
        times = np.concatenate([batch["row_time_s"].values for batch in batches])
        np.testing.assert_array_equal(times, np.arange(1000) / 250.0)


def test_rows_at_a_rate_that_have_times(tmp_path):
    (tmp_path / "log.csv").write_text("row_time_s,x\n0,1\n")
    with pytest.raises(FileError, match="it has a column row_time_s itself"):
        open_log(tmp_path / "log.csv", Stated(row_rate_hz=250.0))
    recorders.write_ulog(tmp_path / "a.ulg", [("sensor", 0, {"timestamp": np.arange(5), "x": np.ones(5)})])
    with pytest.raises(FileError, match="it has stamps of its own: leave out the rate of its rows"):
        open_log(tmp_path / "a.ulg", Stated(row_rate_hz=250.0))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("log.mat", b"not a MAT file", "not a MAT file"),
        ("log.mat", b"", "not a MAT file"),
        ("log.mat", b"MATLAB 5.0" + b"x" * 300, "not a MAT file, or damaged: copy it again$"),
        ("log.mat", bytes(512) + b"\x89HDF\r\n\x1a\n", "not an HDF5 file"),
        ("log.h5", b"not HDF5", "not an HDF5 file"),
        ("log.npz", b"not an archive", "not an NPZ file"),
        ("log.npz", b"", "not an NPZ file"),
        ("log.ulg", b"not a ULog", "not a ULog: it begins with b'not ' where b'ULog' must stand"),
        ("log.ulg", b"ULog\x01\x12\x35\x01" + b"x" * 30, "a damaged ULog: it cannot be read beyond byte"),
        ("log.ulg", b"ULog\x01\x12\x35\x01", "a damaged ULog: it cannot be read beyond byte 8 of 8; copy it"),
        ("log.bag", b"not a bag", "not a ROS 1 bag: it begins with b'not a ba' where b'#ROSBAG V2.0' must stand"),
        ("log.bag", b"#ROSBAG V2.0\nno", "a ROS 1 bag that is damaged, or was not closed .*: try `rosbag reindex`"),
        ("log.mcap", b"not a bag", "not an MCAP file: it begins with b'not a ba' where"),
        ("log.mcap", b"\x89MCAP0\r\nno", "an MCAP file that is damaged, or was not closed .*: try `mcap recover`"),
        ("log.db3", b"SQLite format 3\x00no", "a ROS 2 bag that is damaged, or was not closed"),
        ("log.parquet", b"not Parquet", "not a Parquet file"),
        ("log.csv.gz", b"\x1f\x8b\x08no", "its compressed content is damaged, or cut off: copy it again"),
        ("log.csv.bz2", b"BZh9no", "its compressed content is damaged, or cut off: copy it again"),
        ("log.csv.zst", b"\x28\xb5\x2f\xfdno", "its compressed content is damaged, or cut off: copy it again"),
    ],
)
def test_other_files(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError, match=message) as caught:
        open_log(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))


def test_truncated_npz(tmp_path):
    np.savez_compressed(tmp_path / "whole.npz", t=np.random.default_rng(0).random(10_000))
    content = (tmp_path / "whole.npz").read_bytes()
    (tmp_path / "log.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(FileError, match="not an NPZ file"):
        open_log(tmp_path / "log.npz")
    (tmp_path / "log.npz").write_bytes(content[:2000] + bytes(1000) + content[3000:])
    with pytest.raises(FileError, match="not an NPZ file"):
        column(open_log(tmp_path / "log.npz"), "t")


def test_npz_of_another_compression(tmp_path):
    """What zipfile raises then is no `BadZipFile`."""
    np.savez(tmp_path / "log.npz", t=np.arange(3.0))
    content = bytearray((tmp_path / "log.npz").read_bytes())
    content[content.index(b"PK\x01\x02") + 10] = 2
    (tmp_path / "log.npz").write_bytes(content)
    with pytest.raises(FileError, match="an NPZ file, but of a kind or compression that is not read"):
        open_log(tmp_path / "log.npz")


def test_npz_that_says_it_is_wider_than_memory(tmp_path):
    with (tmp_path / "t.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (0, 10**12)})
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.write(tmp_path / "t.npy", "t.npy")
    assert open_log(tmp_path / "log.npz").columns == ()


def test_ulog_that_pyulog_reads_for_ever(tmp_path):
    """Cut in a message of the definitions, after a damaged one: it then goes back further than it went."""
    pytest.importorskip("pyulog")
    content = (
        "554c6f670112350100000000000000001d00466d3a75696e7436345f742074696d657374616d703b666c6f61743b0400410000006d"
        "0400410101006d0e00440000ffffff00ffffffffffffffffffff00000000"
    )
    (tmp_path / "log.ulg").write_bytes(bytes.fromhex(content))
    with pytest.raises(FileError, match=r"a damaged ULog: it cannot be read beyond byte \d+ of 83"):
        open_log(tmp_path / "log.ulg")


def test_ulog(tmp_path):
    pytest.importorskip("pyulog")
    stamps = np.array([1_000_000, 1_005_000, 1_010_000])
    rates = np.random.default_rng(0).standard_normal((3, 3))
    mag = np.random.default_rng(1).standard_normal((2, 3))
    recorders.write_ulog(
        tmp_path / "log.ulg",
        [
            ("sensor_combined", 0, {"timestamp": stamps, "gyro_rad": rates}),
            ("sensor_mag", 0, {"timestamp": stamps[:2], "x": mag[:, 0]}),
            ("sensor_mag", 1, {"timestamp": stamps[1:], "x": mag[:, 1]}),
        ],
    )
    file = open_log(tmp_path / "log.ulg")
    assert set(file.columns) == {
        "sensor_combined.timestamp",
        *(f"sensor_combined.gyro_rad[{i}]" for i in range(3)),
        *("sensor_mag.timestamp", "sensor_mag.x", "sensor_mag:1.timestamp", "sensor_mag:1.x"),
    }
    assert file.stamps(file.stream("sensor_mag:1.x")) == ("sensor_mag:1.timestamp", "us")
    np.testing.assert_array_equal(column(file, "sensor_mag:1.timestamp")[0], stamps[1:])
    np.testing.assert_array_equal(column(file, "sensor_mag:1.x")[0], np.float32(mag[:, 1]).astype(float))
    np.testing.assert_array_equal(column(file, "sensor_combined.gyro_rad[2]")[0], np.float32(rates[:, 2]).astype(float))


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "sqlite3 file", "mcap", "mcap file"])
def test_bags(tmp_path, kind, monkeypatch):
    pytest.importorskip("rosbags")
    rng = np.random.default_rng(0)
    stamps = 1_700_000_000_123_456_789 + 5_000_000 * np.arange(6)
    rates, forces, fields = rng.standard_normal((3, 6, 3))
    path = tmp_path / ("log.bag" if kind == "ros1" else "log")
    recorders.write_bag(path, kind.removesuffix(" file"), stamps.tolist(), rates, forces, fields)
    if kind.endswith(" file"):
        path = path / {"mcap file": "log.mcap", "sqlite3 file": "log.db3"}[kind]
    monkeypatch.setattr("elliptude.io.readers.rosbag.BATCH_ROWS", 4)
    file = open_log(path)
    assert "/imu/data.orientation_covariance[8]" in file.columns
    assert file.stamps(file.stream("/imu/mag.magnetic_field.x")) == ("/imu/mag.header.stamp", "ns")
    np.testing.assert_array_equal(column(file, "/imu/data.header.stamp")[0], stamps)
    np.testing.assert_array_equal(column(file, "/imu/data.bag_time")[0], stamps + 2_000_000)
    np.testing.assert_array_equal(column(file, "/imu/data.angular_velocity.y")[0], rates[:, 1])
    np.testing.assert_array_equal(column(file, "/imu/mag.magnetic_field.z")[0], fields[::2, 2])


_HASH = "RIHS01_6f48accbdeb78064156ce12e71c79115603209be05ac5be791d37e5b1ad10753"
"""What ROS 2 knows messages of one float64 x of this name by."""


def test_bag_that_does_not_say_what_is_in_its_messages(tmp_path):
    """As older ROS 2 bags, of a message type that is nobody else's."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    enums = pytest.importorskip("rosbags.rosbag2.enums")
    bag = tmp_path / "bag"
    with rosbag2.Writer(bag, version=8, storage_plugin=enums.StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/own", "my_msgs/msg/Own", msgdef="float64 x\n", rihs01=_HASH)
        writer.write(connection, 1, b"\0\1\0\0" + bytes(8))
    assert "/own.x" in open_log(bag).columns
    with contextlib.closing(sqlite3.connect(bag / "bag.db3")) as base:
        base.execute("delete from message_definitions")
        base.commit()
    with pytest.raises(FileError, match=r"bag: topic /own: the bag does not say what .* of type my_msgs/msg/Own"):
        open_log(bag)
    (bag / "metadata.yaml").write_text("no: metadata\n")
    with pytest.raises(FileError, match=r"bag: a folder of a ROS 2 bag that is not whole: its metadata.yaml"):
        open_log(bag)


@pytest.mark.parametrize(
    ("package", "extra", "name"),
    [("pyulog", "ulog", "a.ulg"), ("rosbags.highlevel", "ros", "a.bag"), ("h5py", "hdf5", "a.h5")],
)
def test_an_extra_that_is_not_installed_is_named(tmp_path, monkeypatch, package, extra, name):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(FileError, match=rf"pip install 'elliptude\[{extra}\]'"):
        open_log(tmp_path / name)


@pytest.mark.parametrize("ending", ["gz", "bz2", "zst"])
def test_a_compressed_file_that_is_cut_off_or_damaged(tmp_path, ending):
    """Wherever it ends; also where what is left is many pieces of text."""
    text = b"t,wx\n" + b"".join(b"%d.25,%d\n" % (i, hash((i, 7)) % 10**9) for i in range(300_000))
    codec = {"gz": "gzip", "bz2": "bz2", "zst": "zstd"}[ending]
    whole = pa.BufferOutputStream()
    with pa.CompressedOutputStream(whole, codec) as stream:
        stream.write(text)
    data = whole.getvalue().to_pybytes()
    path = tmp_path / f"cut.csv.{ending}"
    for count in (3, 20, 2000, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:count])
        with pytest.raises(FileError, match=r"its compressed content is damaged, or cut off: copy it again$"):
            for _ in open_log(path).batches(["t", "wx"]):
                pass
    if ending == "zst":  # without a checksum it does not show
        return
    path.write_bytes(data[:300] + bytes(300) + data[600:])
    with pytest.raises(FileError, match=r"its compressed content is damaged, or cut off: copy it again$"):
        for _ in open_log(path).batches(["t", "wx"]):
            pass
