"""A dirty CSV file takes two commands and no TOML by hand; noisy sensors, no rest, bags and drones' logs likewise."""

import dataclasses
import tomllib

import numpy as np
import pytest
import recorders
from elliptude.configuration import read_configuration
from elliptude.io.tables import Result
from test_proposals import made
from two_commands import HEADER, columns_of, dirty, inside, succeed, two_commands

STEP = 0.005


def test_a_dirty_csv_takes_two_commands(tmp_path):
    recording = made()
    log = tmp_path / "dirty.csv"
    log.write_text(dirty(recording))
    stated, said, summary, results = two_commands(tmp_path, log, "--repair")
    assert stated["csv"] == {"delimiter": ";", "decimal": ","}
    assert stated["timing"] == {"repair": True}
    faults = {fault["what"]: fault["count"] for fault in summary["repaired"]}
    assert faults == {
        "lines without the 10 columns of the header": 1,
        "lines with words such as NaN or null": 3,
        "rows that repeat the row above": 2,
        "rows without the gyro": 3,
    }
    for fault in summary["repaired"]:
        assert f"repaired: {fault['said']}" in said
    # The gap of 0.2 s, and two more where rows with NaN were.
    assert summary["gaps"]["count"] == 3
    assert len(results.times) == len(recording.times) - 40
    assert np.isfinite(results.largest_angles).mean() > 0.9
    assert inside(results).all()


def test_what_a_repair_leaves_out_makes_sets_no_smaller(tmp_path):
    """The same bounds over the clean log: the dirty one has fewer sets and no smaller ones in the gaps."""
    recording = made()
    log, clean = tmp_path / "dirty.csv", tmp_path / "clean.csv"
    log.write_text(dirty(recording))
    np.savetxt(clean, columns_of(recording), fmt="%.9g", delimiter=",", header=",".join(HEADER), comments="")
    two_commands(tmp_path, log, "--repair")
    text = (tmp_path / "config.toml").read_text()
    config = tmp_path / "clean.toml"
    config.write_text(text[: text.index("[csv]")] + text[text.index("[estimator]") :])
    read_configuration(config)
    succeed("estimate", clean, "--config", config, "--out", tmp_path / "clean")
    whole, left = Result.read(tmp_path / "clean" / "results.csv"), Result.read(tmp_path / "result" / "results.csv")
    for row in (1502, 3000, 4001):
        after = recording.times[row + 40 * (row == 3000)]
        angles = [one.largest_angles[np.argmin(np.abs(one.times - after))] for one in (whole, left)]
        assert np.isnan(angles[1]) or angles[1] >= angles[0]


def test_rows_are_the_logs_and_samples_are_the_gyros(tmp_path):
    """A repair leaves two samples of the gyro out, and keeps their rows, in which the others measured."""
    recording = made()
    columns = columns_of(recording)
    columns[[3000, 4000], 2] = np.inf
    log = tmp_path / "log.csv"
    np.savetxt(log, columns, fmt="%.9g", delimiter=",", header=",".join(HEADER), comments="")
    _, said, summary, results = two_commands(tmp_path, log, "--repair")
    count = len(recording.times)
    assert summary["rows"] == len(results.times) == count
    assert f"{log.name}: {count - 2} samples of the gyro, " in said
    assert f"{log.name}: {count} rows; " in said


def test_a_noisy_gyro_rests_too(tmp_path):
    recording = made()
    noise = np.deg2rad(1.4) * np.random.default_rng(3).standard_normal(recording.angular_velocities.shape)
    noisy = dataclasses.replace(recording, angular_velocities=recording.angular_velocities + noise)
    log = tmp_path / "noisy.csv"
    np.savetxt(log, columns_of(noisy), fmt="%.9g", delimiter=",", header=",".join(HEADER), comments="")
    stated, _, _, results = two_commands(tmp_path, log)
    # Five times the noise of an axis, and what the sensor has by itself.
    assert 6.0 <= stated["rule"]["rest"]["rate_deviation_deg_per_s"] <= 8.0
    assert "bounds_from_recording" in stated  # nothing of this is unconditional until someone has a reason for it
    assert np.isfinite(results.largest_angles).all()
    assert inside(results).all()


def test_a_log_without_a_rest_runs_and_says_why_there_is_none(tmp_path):
    recording = made()
    moving = (recording.times > 6.0) & (recording.times < 19.5)
    rows = columns_of(recording)[moving]
    rows[:, 0] -= rows[0, 0]
    log = tmp_path / "log.csv"
    np.savetxt(log, rows, fmt="%.9g", delimiter=",", header=",".join(HEADER), comments="")
    stated, said, _, results = two_commands(tmp_path, log)
    assert "No rest: in the quietest 0.5 s, from " in said
    assert "the gyro deviates from its mean by " in said
    assert "rule" not in stated
    assert np.isfinite(results.largest_angles).mean() > 0.9


def test_a_row_of_units_and_times_of_day(tmp_path):
    recording = made()
    start = np.datetime64("2024-05-01T12:00:00", "ns")
    stamps = start + np.rint(recording.times * 1e9).astype("timedelta64[ns]")
    header = "time\tgx\tgy\tgz\tax\tay\taz\tmx\tmy\tmz\n[ns]" + "\t[°/s]" * 3 + "\t[g]" * 3 + "\t[µT]" * 3
    lines = [
        f"{stamp}Z\t" + "\t".join(f"{value:.9g}" for value in row[1:])
        for stamp, row in zip(stamps, columns_of(recording), strict=True)
    ]
    log = tmp_path / "log.tsv"
    log.write_text("\n".join([header, *lines]) + "\n")
    stated, _, _, results = two_commands(tmp_path, log)
    assert stated["csv"] == {"delimiter": "\t", "units_row": True}
    assert (stated["time_unit"], stated["timing"]) == ("ns", {"origin": "first"})
    np.testing.assert_allclose(results.times, recording.times, atol=1e-9)
    assert inside(results).all()


@pytest.mark.parametrize(("zone", "begin"), [("Z", "2024-05-01T12:00:00"), ("", "1970-01-01T00:00:07")])
def test_times_of_day_beside_headers_with_units(tmp_path, zone, begin):
    """Two commands do, also where a clock was never set: its times of day are those of 1970."""
    recording = made()
    stamps = np.datetime64(begin, "ns") + np.rint(recording.times * 1e9).astype("timedelta64[ns]")
    lines = [
        f"{stamp}{zone}," + ",".join(f"{value:.9g}" for value in row[1:])
        for stamp, row in zip(stamps, columns_of(recording), strict=True)
    ]
    log = tmp_path / "log.csv"
    log.write_text("\n".join([",".join(["timestamp", *HEADER[1:]]), *lines]) + "\n")
    stated, _, _, results = two_commands(tmp_path, log)
    assert (stated["time_column"], stated["time_unit"]) == ("timestamp", "ns")
    np.testing.assert_allclose(results.times - results.times[0], recording.times - recording.times[0], atol=1e-9)


def flight(recording):
    """Stamps of a ULog, and topics whose sensors have stamps of their own."""
    stamps = np.rint(1e6 * recording.times).astype(int) + 10_000_000
    imu = {
        "timestamp": stamps,
        "gyro_rad": recording.angular_velocities,
        "accelerometer_m_s2": recording.specific_forces,
    }
    mag = {"timestamp": stamps[1::4] + 1700, "magnetometer_ga": recording.fields[1::4] / 100.0}
    return stamps, [("sensor_combined", 0, imu), ("vehicle_magnetometer", 0, mag)]


def test_like_px4(tmp_path):
    pytest.importorskip("pyulog")
    log = tmp_path / "log.ulg"
    recorders.write_ulog(log, flight(made())[1])
    stated, _, _, results = two_commands(tmp_path, log, "--like", "px4")
    # The magnetometer never has the gyro's stamp.
    assert stated["timing"]["same_within_s"] == pytest.approx(0.45 * STEP, rel=0.05)
    assert np.isfinite(results.largest_angles).any()
    assert "velocity" not in stated


def test_like_px4_with_a_receiver_of_satellites(tmp_path):
    """Something that turns in the hand and goes nowhere: the receiver says so, and up is known better by that."""
    pytest.importorskip("pyulog")
    stamps, topics = flight(made())
    still = np.zeros(len(stamps[1::20]))
    gps = {"timestamp": stamps[1::20] + 1300} | {f"vel_{axis}_m_s": still for axis in "ned"}
    log = tmp_path / "log.ulg"
    found = {}
    for name, more in (("with", [("vehicle_gps_position", 0, gps)]), ("without", [])):
        recorders.write_ulog(log, topics + more)
        folder = tmp_path / name
        folder.mkdir()
        stated, _, _, results = two_commands(folder, log, "--like", "px4", "--carried", "drone")
        found[name] = np.nanmean(results.up_bounds)
        assert ("velocity" in stated) == (name == "with")
    stated = tomllib.loads((tmp_path / "with" / "config.toml").read_text())
    assert stated["timing"]["same_within_s"] > 0.0
    assert stated["velocity"]["time_offset_bound_s"] == pytest.approx(0.11, rel=0.01)
    assert found["with"] < np.deg2rad(31.0), found
    assert found["without"] > np.deg2rad(44.0), found


@pytest.mark.parametrize("options", [("--like", "ros"), ("--gyro",)])
def test_like_ros(tmp_path, options):
    pytest.importorskip("rosbags")
    recording = made()
    stamps = (np.rint(1e9 * recording.times[:3000]).astype(int) + 1_700_000_000_000_000_000).tolist()
    log = tmp_path / "log"
    rows = slice(0, 3000)
    recorders.write_bag(
        log, "mcap", stamps, recording.angular_velocities[rows], recording.specific_forces[rows],
        1e-6 * recording.fields[rows],
    )  # fmt: skip
    if options == ("--gyro",):
        names = {
            "gyro": "data.angular_velocity",
            "accelerometer": "data.linear_acceleration",
            "magnetometer": "mag.magnetic_field",
        }
        units = {"gyro": "rad/s", "accelerometer": "m/s^2", "magnetometer": "T"}
        options = [
            part
            for sensor, name in names.items()
            for part in (
                f"--{sensor}",
                ",".join(f"/imu/{name}.{axis}" for axis in "xyz"),
                f"--{sensor}-unit",
                units[sensor],
            )
        ]
    _, _, summary, results = two_commands(tmp_path, log, *options)
    assert summary["repaired"] == []
    assert 0.0 <= results.times[0] < 1.0
    assert np.isfinite(results.largest_angles).any()
