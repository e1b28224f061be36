"""Text of MT Manager without SampleTimeFine: its time of day, or its counter of packets at the rate that it states.

The header is that of files that people publish: lines with the start, the update rate and the filter, then columns of
which a device fills in those that it sends.
"""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from elliptude.configuration import read_configuration
from elliptude.io.files import FileError
from elliptude.io.readers.open import open_log
from elliptude.logs.log import read_log
from test_proposals import FIELD, made
from two_commands import app, inside, succeed, two_commands
from typer.testing import CliRunner

STRENGTH = float(np.linalg.norm(FIELD))
RATE = 200.0
SENSORS = [f"{sensor}_{axis}" for sensor in ("Acc", "Gyr", "Mag") for axis in "XYZ"]
TIMES = ["UTC_Nano", "UTC_Year", "UTC_Month", "UTC_Day", "UTC_Hour", "UTC_Minute", "UTC_Second", "UTC_Valid"]
NEW_YEAR = datetime(2023, 12, 31, 23, 59, 55, tzinfo=UTC)


def refuse(*arguments):
    done = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    assert done.exit_code == 1, done.output
    return " ".join(done.output.split())


def time_of_day(stamp):
    """The cells of a time of day, which Python's own calendar divides."""
    micro, nano = divmod(round(stamp * 1e9), 1000)
    at = NEW_YEAR + timedelta(microseconds=micro)
    return [at.microsecond * 1000 + nano, at.year, at.month, at.day, at.hour, at.minute, at.second, 7]


def exported(recording, *, rate="200.0Hz", counters=None, with_utc=False, fine=True, leave_out=()):
    """The text of a recording, without some of its packets."""
    head = ["// Start Time: Unknown", *([f"// Update Rate: {rate}"] * (rate is not None))]
    head += ["// Filter Profile: human (46.1)", "// Option Flags: AHS Disabled ICC Disabled"]
    columns = ["PacketCounter", *(["SampleTimeFine"] * fine), *TIMES, *SENSORS]
    lines = [*head, "\t".join(columns)]
    rows = np.column_stack([recording.specific_forces, recording.angular_velocities, recording.fields / STRENGTH])
    counters = 60000 + np.arange(len(rows)) if counters is None else counters
    for i, (count, time, row) in enumerate(zip(counters, recording.times, rows, strict=True)):
        if i not in leave_out:
            stamp = [str(cell) for cell in time_of_day(time)] if with_utc else [""] * len(TIMES)
            cells = [f"{count % 65536:05d}", *([""] * fine), *stamp, *(f"{value:.6f}" for value in row)]
            lines.append("\t".join(cells))
    return "\n".join(lines) + "\n"


def write(folder, text):
    log = folder / "MT_0200-000_00B42B50.txt"
    log.write_text(text)
    return log


def times_of(folder, log, *options):
    """The times of a log by the configuration that `bounds` writes for it."""
    succeed("bounds", log, "--like", "xsens", *options, "--out", folder / "read.toml")
    read = read_log(log, read_configuration(folder / "read.toml"))
    return read.origin + read.times, read


@pytest.mark.parametrize("fine", [True, False])
def test_packets_at_the_rate_of_the_header(tmp_path, fine):
    """The counter begins anew at 65536, and packets that were lost are a gap of as many steps."""
    recording = made()
    log = write(tmp_path, exported(recording, fine=fine, leave_out=range(700, 703)))
    stated, said, _, results = two_commands(tmp_path, log, "--like", "xsens")
    assert "time: packet_time_s (s)" in said
    assert stated["time_column"] == "packet_time_s"
    assert "csv" not in stated or "packet_rate_hz" not in stated["csv"]  # another file may have another rate
    expected = np.delete(60000 + np.arange(len(recording.times)), range(700, 703)) / RATE
    np.testing.assert_allclose(results.times, expected[-len(results.times) :], atol=1e-9)
    results.times[:] -= 300.0
    assert inside(results).all()


def test_the_time_of_day_goes_before_the_counter(tmp_path):
    """Over the end of a year; nanoseconds are kept."""
    recording = made()
    times, read = times_of(tmp_path, write(tmp_path, exported(recording, with_utc=True)))
    assert read.origin == int(NEW_YEAR.timestamp())
    np.testing.assert_allclose(read.times, recording.times, atol=1e-9)
    np.testing.assert_allclose(times - NEW_YEAR.timestamp(), recording.times, atol=1e-6)


def test_the_user_states_the_rate(tmp_path):
    recording = made()
    log = write(tmp_path, exported(recording, rate=None))
    assert "--packet-rate-hz" in refuse("bounds", log, "--like", "xsens")
    times, _ = times_of(tmp_path, log, "--packet-rate-hz", "50")
    np.testing.assert_allclose(np.diff(times), 0.02, atol=1e-9)
    assert read_configuration(tmp_path / "read.toml").csv.packet_rate_hz == 50.0
    # It goes before the header, which programs that convert files fill in as they like.
    (tmp_path / "other").mkdir()
    times, _ = times_of(tmp_path / "other", write(tmp_path / "other", exported(recording)), "--packet-rate-hz", "50")
    np.testing.assert_allclose(np.diff(times), 0.02, atol=1e-9)


def test_sample_time_fine_goes_before_all(tmp_path):
    """A file that has it is read as before, with no column more."""
    text = exported(made(), with_utc=True).splitlines()
    begin = next(i for i, line in enumerate(text) if line.startswith("PacketCounter"))
    for i in range(begin + 1, len(text)):
        cells = text[i].split("\t")
        cells[1] = str(100 * (i - begin))
        text[i] = "\t".join(cells)
    log = write(tmp_path, "\n".join(text) + "\n")
    assert open_log(log).columns == tuple(text[begin].split("\t"))
    times, _ = times_of(tmp_path, log)
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": None}, "PacketCounter counts packets, and no line above the header states their rate"),
        ({"rate": "0.0Hz"}, "PacketCounter counts packets, and no line above the header states their rate"),
        ({"counters": 60000 + 2 * np.arange(8000)}, "PacketCounter goes up by 2 from row to row"),
    ],
)
def test_what_says_no_time_is_refused(tmp_path, change, message):
    said = refuse("bounds", write(tmp_path, exported(made(), **change)), "--like", "xsens")
    assert message in said
    assert "MT_0200-000_00B42B50.txt: " in said


def test_nothing_that_counts(tmp_path):
    recording = made()
    text = exported(recording).replace("PacketCounter", "Packet")
    said = refuse("bounds", write(tmp_path, text), "--like", "xsens")
    assert (
        "SampleTimeFine is empty, and there is neither a time of day (UTC_Year to UTC_Nano) nor PacketCounter" in said
    )
    assert "MT Manager" in said
    said = refuse("bounds", write(tmp_path, text), "--like", "xsens", "--packet-rate-hz", "100")
    assert "packet_rate_hz is of the column PacketCounter, and there is none" in said


def test_a_packet_that_is_late_is_found_by_its_line(tmp_path):
    recording = made()
    counters = 60000 + np.arange(len(recording.times))
    counters[[9, 10]] = counters[[10, 9]]
    log = write(tmp_path, exported(recording, counters=counters))
    assert "line 16, column 1 (PacketCounter): not after the time of the row before" in refuse(
        "bounds", log, "--like", "xsens"
    )


@pytest.mark.parametrize(("column", "cell"), [(3, ""), (4, "13"), (3, "0"), (6, "nan")])
def test_a_row_without_a_time_of_day_is_found_by_its_line(tmp_path, column, cell):
    lines = exported(made(), with_utc=True).splitlines()
    cells = lines[20].split("\t")
    cells[column] = cell
    lines[20] = "\t".join(cells)
    log = write(tmp_path, "\n".join(lines) + "\n")
    said = refuse("bounds", log, "--like", "xsens")
    assert "line 21, columns UTC_Year to UTC_Nano (a time of day): empty" in said
    said = succeed("bounds", log, "--like", "xsens", "--repair", "--out", tmp_path / "repaired.toml")
    assert "line 21" in said


def test_columns_of_times_are_columns_like_any_other(tmp_path):
    """By name, converted, and read again."""
    recording = made()
    log = write(tmp_path, exported(recording, with_utc=True))
    options = ["--time", "packet_time_s", "--gyro", "Gyr_X,Gyr_Y,Gyr_Z", "--gyro-unit", "rad/s"]
    options += ["--accelerometer", "Acc_X,Acc_Y,Acc_Z", "--accelerometer-unit", "m/s^2"]
    succeed("bounds", log, *options, "--out", tmp_path / "named.toml")
    succeed("convert", log, tmp_path / "converted.parquet")
    plain = open_log(tmp_path / "converted.parquet")
    assert {"utc_ns", "packet_time_s"} <= set(plain.columns)
    (batch,) = plain.batches(["utc_ns", "packet_time_s"])
    np.testing.assert_allclose(batch["packet_time_s"].values, 300.0 + recording.times, atol=1e-9)
    begin = int(NEW_YEAR.timestamp()) * 10**9
    np.testing.assert_allclose((batch["utc_ns"].values - begin) / 1e9, recording.times, atol=1e-9)
    misspelt = (tmp_path / "named.toml").read_text().replace('"packet_time_s"', '"packet_time"')
    (tmp_path / "misspelt.toml").write_text(misspelt)
    with pytest.raises(FileError, match="no column 'packet_time', did you mean 'packet_time_s'"):
        read_log(log, read_configuration(tmp_path / "misspelt.toml"))


def test_the_words_of_older_files(tmp_path):
    """Their header says Sample rate and Counter."""
    recording = made()
    text = exported(recording, fine=False)
    text = text.replace("Update Rate: 200.0Hz", "Sample rate: 200.0Hz").replace("PacketCounter", "Counter")
    times, read = times_of(tmp_path, write(tmp_path, text))
    np.testing.assert_allclose(times, (60000 + np.arange(len(recording.times))) / RATE, atol=1e-9)
    assert "column 1 (Counter)" in read.file.place("packet_time_s", 3)
    (tmp_path / "log.csv").write_text("Counter,x\n1,2\n3,4\n")
    assert open_log(tmp_path / "log.csv").columns == ("Counter", "x")
