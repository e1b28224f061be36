"""How CSV files are written: what is found out, and what two readings fit."""

import codecs

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from elliptude.io.files import FileError
from elliptude.io.readers.open import open_log
from elliptude.io.readers.text.dialect import Stated

NUMBERS = [[0.5, 1.25, -3.0], [0.75, 2.5, 4e-3]]


def write(tmp_path, content):
    path = tmp_path / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def rows_of(file):
    batches = list(file.batches(file.columns))
    return np.column_stack([np.concatenate([batch[name].values for batch in batches]) for name in file.columns])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("t,x,y\n0.5,1.25,-3\n0.75,2.5,4e-3\n", {}),
        ("t;x;y\n0.5;1.25;-3\n0.75;2.5;4e-3\n", {"delimiter": ";"}),
        ("t;x;y\n0,5;1,25;-3\n0,75;2,5;4e-3", {"delimiter": ";", "decimal": ","}),
        ("t\tx\ty\n0.5\t1.25\t-3\n0.75\t2.5\t4e-3\n", {"delimiter": "\t"}),
        ("  t   x\ty \n\n 0.5  1.25   -3\n0.75\t2.5  4e-3 \n", {"delimiter": " "}),
        ("t x y\r\n0,5 1,25 -3\r\n0,75 2,5 4e-3\r\n", {"delimiter": " ", "decimal": ","}),
        ('t,x,y\n"0,5","1,25",-3\n"0,75","2,5",4e-3\n', {"decimal": ","}),
        ("sep=;\nt;x;y\n0.5;1.25;-3\n0.75;2.5;4e-3\n", {"delimiter": ";"}),
        ("t;x;y\n[s];[°/s];[µT]\n0,5;1,25;-3\n0,75;2,5;4e-3\n", {"delimiter": ";", "decimal": ",", "units_row": True}),
        (codecs.BOM_UTF8 + b"t,x,y\n0.5,1.25,-3\n0.75,2.5,4e-3\n", {}),
        ("t;x;y\n0,5;1,25;-3\n0,75;2,5;4e-3\n".encode("utf-16"), {"decimal": ",", "encoding": "utf-16"}),
        ("t,x,y\n0.5,1.25,-3\n0.75,2.5,4e-3\n".encode("utf-16-le"), {"encoding": "utf-16-le"}),
    ],
)  # fmt: skip
def test_a_dialect_is_found(tmp_path, content, expected):
    file = open_log(write(tmp_path, content))
    assert file.columns == ("t", "x", "y")
    assert {name: value for name, value in vars(file.dialect).items() if name in expected} == expected
    np.testing.assert_array_equal(rows_of(file), NUMBERS)
    # The slow reading, which finds the places of faults, finds the last row in the last line.
    with file._text() as text:
        last = max(number for number, line in enumerate(text, start=1) if line.strip())
    assert file.place("y", 1) == f"line {last}, column 3 (y)"


@pytest.mark.parametrize(
    ("content", "label"),
    [
        ("#t,x,y\n0.5,1.25,-3\n0.75,2.5,4e-3\n", ""),
        ("# a drone\n# t x y\n0.5 1.25 -3\n0.75 2.5 4e-3\n", "a drone"),
        ("// t;x;y\n\n0,5;1,25;-3\n0,75;2,5;4e-3\n", ""),
    ],
)
def test_a_header_in_a_comment(tmp_path, content, label):
    """NumPy's `savetxt` writes it so, and the recordings of EuRoC have it."""
    file = open_log(write(tmp_path, content))
    assert (file.columns, file.label) == (("t", "x", "y"), label)
    np.testing.assert_array_equal(rows_of(file), NUMBERS)
    assert file.place("y", 1) == f"line {len(content.splitlines())}, column 3 (y)"


@pytest.mark.parametrize("comment", ["# only two", "# 1,2,3", "# a drone, on a table, in a room, at night", "#"])
def test_a_comment_that_is_no_header(tmp_path, comment):
    with pytest.raises(FileError, match="its first line has numbers"):
        open_log(write(tmp_path, f"{comment}\n0.5,1.25,-3\n0.75,2.5,4e-3\n"))


def test_a_latin_1_header_keeps_its_units(tmp_path):
    assert open_log(write(tmp_path, "t;w (°/s)\n0,5;1\n".encode("latin-1"))).columns == ("t", "w (°/s)")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t;x\n0;1,234\n1;2,345\n", "does '1,234' mean 1.234 or 1234?"),
        ("a,b;c,d\n1,2;3,4\n", "3 columns separated by ',' or 2 columns separated by ';'?"),
        ("t;x\n0.5;1,5\n", "'1,5' has a decimal comma and '0.5' a decimal point"),
        ("0.1,1\n0.2,2\n", "its first line has numbers"),
    ],
)
def test_two_readings_are_not_chosen_between(tmp_path, text, message):
    with pytest.raises(FileError) as caught:
        open_log(write(tmp_path, text))
    assert str(tmp_path / "log.csv") in str(caught.value)
    assert message in str(caught.value)


def test_what_is_stated_is_not_found_out(tmp_path):
    file = open_log(write(tmp_path, "t;x\n0;1,234\n1;2,345\n"), Stated(decimal=","))
    np.testing.assert_array_equal(rows_of(file), [[0.0, 1.234], [1.0, 2.345]])
    file = open_log(write(tmp_path, "a,b;c,d\n1,2;3,4\n"), Stated(delimiter=";", decimal=","))
    np.testing.assert_array_equal(rows_of(file), [[1.2, 3.4]])


def test_columns_that_are_counted_have_names(tmp_path):
    assert open_log(write(tmp_path, ",0,1\n0,0.5,1.5\n")).columns == ("", "0", "1")


def test_a_text_of_digits_and_commas_is_no_decimal_comma(tmp_path):
    file = open_log(write(tmp_path, 't,x,note\n0.5,1.5,"3,4"\n'))
    assert file.dialect.decimal == "."
    assert not file.holds_numbers("note")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("2024-05-01T12:00:00.000000001Z", "2024-05-01T12:00:00.000000006Z"),
        ("2024-05-01T14:00:00.000000001+02:00", "2024-05-01T14:00:00.000000006+02:00"),
        ("2024-05-01 12:00:00.000000001", "2024-05-01 12:00:00.000000006"),
    ],
)
def test_times_of_day_are_nanoseconds(tmp_path, first, second):
    file = open_log(write(tmp_path, f"t,x\n{first},1\n{second},2\n"))
    assert (file.time_unit("t"), file.time_unit("x")) == ("ns", None)
    (batch,) = file.batches(["t"])
    assert batch["t"].values.tolist() == [1714564800000000001, 1714564800000000006]


def test_a_time_of_day_of_another_kind_is_refused(tmp_path):
    file = open_log(write(tmp_path, "t,x\n2024-05-01T12:00:00Z,1\n2024-05-01T12:00:01,2\n"))
    with pytest.raises(FileError, match=r"line 3, column 1 \(t\): not a time of day as the first one"):
        list(file.batches(["t"]))


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_parquet_time_stamps_are_nanoseconds(tmp_path, unit, zone):
    ticks = {"ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    stamps = pa.array([1714564800 * ticks + 5, None], pa.timestamp(unit, tz=zone))
    pa.parquet.write_table(pa.table({"t": stamps}), tmp_path / "log.parquet")
    file = open_log(tmp_path / "log.parquet")
    (batch,) = file.batches(["t"])
    assert file.time_unit("t") == "ns"
    assert batch["t"].values[0] == 1714564800 * 10**9 + 5 * 10**9 // ticks
    assert batch["t"].empty.tolist() == [False, True]
