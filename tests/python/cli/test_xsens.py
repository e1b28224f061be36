"""Text as MT Manager exports it, and magnetometers that show the field in units of its strength."""

import re

import numpy as np
import pytest
from elliptude.configuration import read_configuration
from elliptude.io.files import FileError
from elliptude.io.readers.text.csv import CsvTable
from elliptude.io.tables import Result
from test_proposals import FIELD, made
from two_commands import HEADER, app, columns_of, inside, succeed, two_commands
from typer.testing import CliRunner

STRENGTH = float(np.linalg.norm(FIELD))
"""µT; where the sensor was normalized the field was as strong as in the recording."""
SENSORS = ["Acc_X", "Acc_Y", "Acc_Z", "Gyr_X", "Gyr_Y", "Gyr_Z", "Mag_X", "Mag_Y", "Mag_Z"]


def refuse(*arguments):
    done = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    assert done.exit_code in (1, 2), done.output
    return " ".join(done.output.split())


def exported(recording, *, mark="\t", tick=1e-4, stamped=True):
    """A counter that begins anew at 65536, empty columns, and a magnetometer at each second row."""
    lines = ["// General information:", "//  MT Manager version: 2022.2.0", "// Coordinate system: ENU"]
    lines.append(mark.join(["PacketCounter", "SampleTimeFine", "Year", "Month", *SENSORS]))
    rows = np.column_stack([recording.specific_forces, recording.angular_velocities, recording.fields / STRENGTH])
    for i, (time, row) in enumerate(zip(recording.times, rows, strict=True)):
        cells = [f"{value:.6f}" for value in row[:6]]
        cells += [f"{value:.6f}" if i % 2 == 0 else "" for value in row[6:]]
        stamp = str(round((time + 3600.0) / tick)) if stamped else ""
        lines.append(mark.join([f"{(60000 + i) % 65536:05d}", stamp, "", "", *cells]))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("mark", ["\t", ";", ","])
def test_an_export_of_mt_manager(tmp_path, mark):
    log = tmp_path / "MT_00B42D4F-000.txt"
    log.write_text(exported(made(), mark=mark))
    assert CsvTable(log).columns[:2] == ("PacketCounter", "SampleTimeFine")
    stated, said, _, results = two_commands(tmp_path, log, "--like", "xsens")
    assert "time: SampleTimeFine (0.1ms)" in said
    assert "Mag_Z (normalized, 1 is 20 µT)" in said
    assert stated["directions"][1]["unit_ut"] == 20.0
    assert np.isfinite(results.largest_angles).mean() > 0.5
    results.times[:] -= 3600.0
    assert inside(results).all()


def test_an_export_that_cannot_be_read_so(tmp_path):
    log = tmp_path / "log.txt"
    log.write_text(exported(made(), stamped=False))
    assert "SampleTimeFine is empty; PacketCounter counts packets" in refuse("bounds", log, "--like", "xsens")
    log.write_text(exported(made(), tick=1e-6))
    said = refuse("bounds", log, "--like", "xsens")
    assert "steps of 0.5 s if it counted 0.1 ms" in said
    assert "DOT" in said


def normalized(folder, strength=STRENGTH):
    """The same log with the field in µT and in units of a strength."""
    recording = made()
    columns = columns_of(recording)
    for name, scale in (("ut", 1.0), ("normalized", strength)):
        columns[:, 7:] = recording.fields / scale
        header = ["t", *(f"{sensor}{axis}" for sensor in "gam" for axis in "xyz")]
        np.savetxt(folder / f"{name}.csv", columns, fmt="%.12g", delimiter=",", header=",".join(header), comments="")
    options = "--time t --gyro gx,gy,gz --gyro-unit deg/s --accelerometer ax,ay,az --accelerometer-unit g"
    return [*options.split(), "--magnetometer", "mx,my,mz", "--magnetometer-unit"]


def widths(folder):
    """The largest angles of what `estimate` wrote, and all of it."""
    found = Result.read(folder / "result" / "results.csv")
    return found.largest_angles, found


def test_with_the_true_strength_it_is_a_sensor_in_microtesla(tmp_path):
    options = normalized(tmp_path)
    found = {}
    for name, unit in (("ut", ["uT"]), ("normalized", ["normalized", "--field-ut", f"{STRENGTH:.17g}"])):
        (tmp_path / name).mkdir()
        two_commands(tmp_path / name, tmp_path / f"{name}.csv", *options, *unit)
        found[name], _ = widths(tmp_path / name)
    np.testing.assert_allclose(found["normalized"], found["ut"], rtol=1e-4)


def test_with_less_the_truth_is_inside_and_sets_are_wider(tmp_path):
    options = normalized(tmp_path)
    means = []
    for strength in (STRENGTH, 0.6 * STRENGTH):
        folder = tmp_path / f"{strength:.0f}"
        folder.mkdir()
        two_commands(folder, tmp_path / "normalized.csv", *options, "normalized", "--field-ut", f"{strength:.6g}")
        angles, results = widths(folder)
        assert inside(results).all()
        assert np.isfinite(angles).mean() > 0.9
        means.append(np.nanmean(angles))
    assert means[1] > 1.1 * means[0]


def test_the_options_belong_together(tmp_path):
    options = normalized(tmp_path)
    log = tmp_path / "normalized.csv"
    assert "a normalized magnetometer needs --field-ut" in refuse("bounds", log, *options, "normalized")
    assert "there is none (--magnetometer-unit" in refuse("bounds", log, *options, "uT", "--field-ut", "45")
    assert "--field-ut" in refuse("bounds", log, *options, "normalized", "--field-ut", "0.5")
    succeed("bounds", log, *options, "normalized", "--field-ut", "45", "--out", tmp_path / "c.toml")
    assert "the configuration says it" in refuse("bounds", log, tmp_path / "c.toml", "--field-ut", "45")
    said = refuse("calibrate", log, tmp_path / "c.toml", "--out", tmp_path / "calibration.toml")
    assert "strength_ut is stated in µT, and a normalized magnetometer does not measure that" in said
    wrong = tmp_path / "wrong.csv"
    wrong.write_text((tmp_path / "ut.csv").read_text())
    assert "a normalized field is about 1: is it normalized?" in succeed_or_not("check", wrong, tmp_path / "c.toml")


def succeed_or_not(*arguments):
    done = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    return " ".join(done.output.split())


CONFIGURATION = f"""
time_column = "{HEADER[0]}"
reference_frame = "ENU"
estimator.mode = "guaranteed"
[flow]
kind = "gyro"
columns = {HEADER[1:4]}
noise_deg_per_s = 1.0
[[directions]]
name = "field"
kind = "magnetometer"
columns = {HEADER[7:10]}
"""


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ('unit = "normalized"\nbound_deg = 5.0\nreference_ut = [0, 20, -40]', "unit_ut, how many µT"),
        ('unit = "uT"\nunit_ut = 45.0\nbound_deg = 5.0\nreference_ut = [0, 20, -40]', "unit_ut, how many µT"),
        (
            'unit = "normalized"\nunit_ut = 0.0\nbound_deg = 5.0\nreference_ut = [0, 20, -40]',
            "unit_ut: must be more than 0",
        ),
        (
            'unit = "normalized"\nunit_ut = 45.0\nreference_ut = [0, 20, -40]\n'
            'bound_from = {kind = "field", disturbance_ut = 5}',
            "sensor_error.scale_error: missing",
        ),
        ('unit = "normalized"\nunit_ut = 45.0\nbound_deg = 5.0\nreference_ut = [0, 20, -40]', None),
        (
            'unit = "normalized"\nunit_ut = 45.0\nreference_ut = [0, 20, -40]\nsensor_error.scale_error = 0.1\n'
            'bound_from = {kind = "field", disturbance_ut = 5}',
            None,
        ),
    ],
)
def test_what_must_be_stated(tmp_path, keys, fault):
    config = tmp_path / "config.toml"
    config.write_text(CONFIGURATION + keys)
    if fault is None:
        read_configuration(config)
        return
    with pytest.raises(FileError, match=re.escape(fault)):
        read_configuration(config)
