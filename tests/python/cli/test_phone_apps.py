"""Recordings as phone apps export them, folders and ZIP archives of CSV files: two commands, the truth inside."""

import zipfile

import numpy as np
import pytest
from elliptude.io.files import FileError
from elliptude.io.readers.text.folder import SUM, SensorLogger, open_folder
from test_proposals import FIELD, STEP, attitude, made
from two_commands import app, inside, succeed, two_commands
from typer.testing import CliRunner

START = 1_725_000_000_000_000_000
"""ns since 1970, when the recording began: a whole second, from which the results count."""


def refuse(*arguments):
    done = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    assert done.exit_code in (1, 2), done.output
    assert "Traceback" not in done.output
    return " ".join(done.output.split())


def table_of(times, vectors):
    """A file of Sensor Logger: whole nanoseconds, and the axes from z to x."""
    lines = ["time,seconds_elapsed,z,y,x"]
    for time, (x, y, z) in zip(times, vectors, strict=True):
        lines.append(f"{START + round(1e9 * time)},{time:.9f},{z:.9g},{y:.9g},{x:.9g}")
    return "\n".join(lines) + "\n"


def metadata(platform, standardisation="false"):
    head = "version,device name,recording epoch time,recording time,recording timezone,platform,appVersion,device id,"
    head += "sensors,sampleRateMs,standardisation,platform version"
    return (
        f"{head}\n3,A phone,{START},2024-08-30_06-40-00,Europe/Berlin,{platform},1.64,x,A|B,5|5,{standardisation},1\n"
    )


def gravity_of(recording):
    """What a phone's filter thinks of gravity: the true one, off by some degrees that change."""
    tilted = np.column_stack(
        [0.5 * np.sin(recording.times), 0.4 * np.cos(0.7 * recording.times), 0.0 * recording.times]
    )
    return attitude(recording.times).inv().apply(np.array([0.0, 0.0, 9.80665]) + tilted)


def field_of_its_own():
    """A magnetometer at a rate of its own, with stamps that no other sensor has."""
    times = np.arange(0.00131, 40.0, 0.0101)
    return table_of(times, attitude(times).inv().apply(FIELD) + 0.1 * np.sin(37.0 * times)[:, np.newaxis])


def android(recording):
    """TotalAcceleration is what the accelerometer measures, as Android says."""
    times, forces = recording.times, recording.specific_forces
    return {
        "Accelerometer.csv": table_of(times, forces - gravity_of(recording)),
        "Gravity.csv": table_of(times, gravity_of(recording)),
        "TotalAcceleration.csv": table_of(times, forces),
        "Gyroscope.csv": table_of(times, recording.angular_velocities),
        "Magnetometer.csv": field_of_its_own(),
        "MagnetometerUncalibrated.csv": "",
        "Annotation.csv": "time,seconds_elapsed,text,millisecond_press_duration\n",
        "Metadata.csv": metadata("android"),
    }


def iphone(recording):
    """No TotalAcceleration, and the signs of all acceleration reversed."""
    files = android(recording)
    del files["TotalAcceleration.csv"]
    for name, vectors in (
        ("Accelerometer.csv", recording.specific_forces - gravity_of(recording)),
        ("Gravity.csv", gravity_of(recording)),
    ):
        files[name] = table_of(recording.times, -vectors)
    return files | {
        "Magnetometer.csv": table_of(recording.times, recording.fields),
        "Metadata.csv": metadata("ios"),
    }


def written(place, files):
    """As a folder, or as a ZIP archive with the files in a folder of its own, as a computer packs them."""
    if place.suffix == ".zip":
        with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, text in files.items():
                archive.writestr(f"2024-08-30/{name}", text)
            archive.writestr("__MACOSX/2024-08-30/._Gyroscope.csv", b"\x00\x05\x16\x07")
        return place
    for name, text in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text, encoding="utf-8")
    return place


@pytest.mark.parametrize("name", ["recording", "recording.zip"])
def test_an_iphone(tmp_path, name):
    log = written(tmp_path / name, iphone(made()))
    stated, said, _, results = two_commands(tmp_path, log, "--like", "sensor-logger")
    up = stated["directions"][0]
    assert up["columns"] == [f"{SUM}.{axis}" for axis in "xyz"]
    assert up["at_rest"] == "down"
    assert f"{SUM}.z (m/s^2, down at rest)" in said
    assert "rule" in stated, "all of an iPhone's sensors are sampled together"
    assert np.isfinite(results.largest_angles).mean() > 0.9
    assert inside(results).all()


def test_android(tmp_path):
    log = written(tmp_path / "recording.zip", android(made()))
    stated, _, _, results = two_commands(tmp_path, log, "--like", "sensor-logger")
    up = stated["directions"][0]
    assert up["columns"] == [f"TotalAcceleration.{axis}" for axis in "xyz"]
    assert "at_rest" not in up
    assert "rule" not in stated, "the sensors have stamps of their own"
    assert "timing" in stated
    assert np.isfinite(results.largest_angles).mean() > 0.5
    assert inside(results).all()


def test_the_sum_is_what_the_accelerometer_measured(tmp_path):
    """Of the rows that both files have; those of one alone are left out."""
    recording = made()
    files = iphone(recording)
    lines = files["Gravity.csv"].splitlines()
    files["Gravity.csv"] = "\n".join(lines[:100] + lines[103:]) + "\n"
    file = open_folder(written(tmp_path / "recording", files))
    assert isinstance(file, SensorLogger)
    (batch,) = file.batches([f"{SUM}.time", f"{SUM}.x", f"{SUM}.y", f"{SUM}.z"])
    kept = np.delete(np.arange(len(recording.times)), [99, 100, 101])
    np.testing.assert_array_equal(
        batch[f"{SUM}.time"].values, [START + round(1e9 * time) for time in recording.times[kept]]
    )
    summed = np.column_stack([batch[f"{SUM}.{axis}"].values for axis in "xyz"])
    np.testing.assert_allclose(summed, -recording.specific_forces[kept], atol=2e-7)
    files["Gravity.csv"] = table_of(recording.times + 0.25 * STEP, gravity_of(recording))
    with pytest.raises(FileError, match=r"Gravity\.csv has the stamps of 0 of the 8000 rows"):
        list(open_folder(written(tmp_path / "recording", files)).batches([f"{SUM}.x"]))
    files["Gravity.csv"] = "\n".join([*lines[:50], lines[49], *lines[50:]]) + "\n"
    with pytest.raises(FileError, match=r"Gravity\.csv, line 51, column 1 \(time\): not after"):
        list(open_folder(written(tmp_path / "recording", files)).batches([f"{SUM}.x"]))


def test_acceleration_without_gravity(tmp_path):
    files = iphone(made())
    del files["Gravity.csv"]
    log = written(tmp_path / "recording", files)
    assert "Accelerometer.csv is the acceleration without gravity" in refuse("bounds", log, "--like", "sensor-logger")
    named = ["--gyro", "Gyroscope.x,Gyroscope.y,Gyroscope.z", "--gyro-unit", "rad/s"]
    named += ["--accelerometer", "Accelerometer.x,Accelerometer.y,Accelerometer.z", "--accelerometer-unit", "m/s^2"]
    # What the file's name does not say is suspicious: nothing states yet how far the sensor may be off.
    said = succeed("bounds", log, *named, "--out", tmp_path / "config.toml")
    assert "suspicious: up: its median norm is" in said
    assert "or it is without gravity, as linear or user acceleration is" in said


@pytest.mark.parametrize(
    ("platform", "standardisation", "expected"),
    [("android", "false", "up"), ("Android", "", "up"), ("ios", "true", "up"), ("iOS", "false", "down")],
)
def test_the_sign_by_metadata(tmp_path, platform, standardisation, expected):
    files = iphone(made()) | {"Metadata.csv": metadata(platform, standardisation)}
    log = written(tmp_path / "recording", files)
    assert ("down at rest" in succeed("bounds", log, "--like", "sensor-logger")) == (expected == "down")


@pytest.mark.parametrize("said", [None, metadata("ios", ""), metadata("", "false")])
def test_a_sign_that_nothing_says_is_not_guessed(tmp_path, said):
    files = iphone(made())
    del files["Metadata.csv"]
    log = written(tmp_path / "recording", files if said is None else files | {"Metadata.csv": said})
    message = refuse("bounds", log, "--like", "sensor-logger")
    assert "Metadata.csv does not say the" in message
    assert "--at-rest" in message
    assert "down at rest" in succeed("bounds", log, "--like", "sensor-logger", "--at-rest", "down")
    assert "down at rest" not in succeed("bounds", log, "--like", "sensor-logger", "--at-rest", "up")


def test_what_is_no_such_recording(tmp_path):
    assert "--like sensor-logger" in refuse("bounds", written(tmp_path / "recording", iphone(made())))
    plain = tmp_path / "log.csv"
    plain.write_text("t,gx,gy,gz\n0,1,2,3\n")
    assert "no recording of Sensor Logger" in refuse("bounds", plain, "--like", "sensor-logger")
    assert "goes with columns by name or --like" in refuse("bounds", plain, "--at-rest", "up")
    damaged = tmp_path / "damaged.zip"
    damaged.write_bytes(b"PK\x03\x04 and no more")
    assert "not a ZIP archive, or cut off" in refuse("bounds", damaged)
    with zipfile.ZipFile(tmp_path / "empty.zip", "w") as archive:
        archive.writestr("readme.txt", "nothing")
    assert "no CSV file in it" in refuse("bounds", tmp_path / "empty.zip")


def test_an_archive_writes_nowhere_else(tmp_path):
    with zipfile.ZipFile(tmp_path / "evil.zip", "w") as archive:
        archive.writestr("../../Gyroscope.csv", "t,x\n0,1\n")
    file = open_folder(tmp_path / "evil.zip")
    assert file.columns == ("Gyroscope.t", "Gyroscope.x")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["evil.zip"]


def test_two_files_of_one_sensor_are_not_guessed(tmp_path):
    for name in ("Gyroscope.csv", "Gyroscope.CSV"):
        (tmp_path / name).write_text("t,x\n0,1\n")
    with pytest.raises(FileError, match=r"Gyroscope.CSV and Gyroscope.csv: two files of one sensor"):
        open_folder(tmp_path)
    with zipfile.ZipFile(tmp_path / "twice.zip", "w") as archive:
        archive.writestr("Gyroscope.csv", "t,x\n0,1\n")
        archive.writestr("./Gyroscope.csv", "t,x\n0,2\n")
    with pytest.raises(FileError, match=r"twice.zip: Gyroscope.csv is in it twice"):
        open_folder(tmp_path / "twice.zip")


def test_an_archive_of_windows_may_have_backslashes(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name, text in (
            ("run\\Gyroscope.csv", "t,x\n0,1\n"),
            ("run\\meta\\time.csv", "event,experiment time\nSTART,0\n"),
        ):
            member = zipfile.ZipInfo("named below")
            member.filename = name
            archive.writestr(member, text)
    assert open_folder(tmp_path / "a.zip").columns == ("Gyroscope.t", "Gyroscope.x")


# --- phyphox ----------------------------------------------------------------------------------------------------------

PHYPHOX = {"Gyroscope": "Gyroscope {} (rad/s)", "Accelerometer": "Acceleration {} (m/s^2)"}
PHYPHOX |= {"Linear Acceleration": "Linear Acceleration {} (m/s^2)", "Magnetometer": "Magnetic field {} (µT)"}


def test_names_in_an_archive_may_begin_with_a_dot(tmp_path):
    """As libarchive writes them for `./*`."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr(zipfile.ZipInfo("./Gyroscope.csv"), "time,x\n1,2\n")
    assert open_folder(tmp_path / "a.zip").columns == ("Gyroscope.time", "Gyroscope.x")


def phyphox(recording, *, mark=",", decimal=".", pauses=()):
    vectors = {
        "Gyroscope": recording.angular_velocities,
        "Accelerometer": recording.specific_forces,
        "Linear Acceleration": recording.specific_forces - gravity_of(recording),
        "Magnetometer": recording.fields,
    }
    files = {"meta/device.csv": '"property","value"\n"version","1.2.0"\n'}
    for stem, header in PHYPHOX.items():
        head = mark.join(f'"{name}"' for name in ("Time (s)", *map(header.format, "xyz")))
        rows = np.column_stack([recording.times, vectors[stem]])
        lines = [mark.join(f"{value:.9E}".replace(".", decimal) for value in row) for row in rows]
        files[f"{stem}.csv"] = "\n".join([head, *lines]) + "\n"
    events = [("START", 0.0, 1.77e9)]
    for at in pauses:
        events += [("PAUSE", at, 1.77e9 + at), ("START", at, 1.77e9 + at + 5.0)]
    events.append(("PAUSE", recording.times[-1], 1.78e9))
    head = '"event","experiment time","system time","system time text"'
    files["meta/time.csv"] = "\n".join([head, *(f'"{a}",{b:.9E},{c:.3f},"-"' for a, b, c in events)]) + "\n"
    return files


@pytest.mark.parametrize(("mark", "decimal"), [(",", "."), (";", ","), ("\t", ".")])
def test_phyphox_needs_no_preset(tmp_path, mark, decimal):
    log = written(tmp_path / "recording.zip", phyphox(made(), mark=mark, decimal=decimal))
    stated, said, _, results = two_commands(tmp_path, log)
    assert stated["directions"][0]["columns"] == [f"Accelerometer.Acceleration {axis} (m/s^2)" for axis in "xyz"]
    assert "Linear Acceleration" not in said
    assert np.isfinite(results.largest_angles).mean() > 0.9
    assert inside(results).all()


@pytest.mark.parametrize("zone", ["Z", ""])
def test_times_of_day_in_the_files_of_a_folder(tmp_path, zone):
    """Two commands do; each file has its own stamps, and the results count from the first."""
    recording = made()
    stamps = np.datetime64("2026-05-01T12:00:00", "ns") + np.rint(recording.times * 1e9).astype("timedelta64[ns]")
    files = phyphox(recording)
    for stem in PHYPHOX:
        head, *rows = files[f"{stem}.csv"].splitlines()
        lines = [f"{stamp}{zone},{row.partition(',')[2]}" for stamp, row in zip(stamps, rows, strict=True)]
        files[f"{stem}.csv"] = "\n".join([head.replace('"Time (s)"', "Time"), *lines]) + "\n"
    stated, said, _, results = two_commands(tmp_path, written(tmp_path / "recording", files))
    assert "time: the file's own stamps" in said
    assert stated["timing"]["origin"] == "first"
    np.testing.assert_allclose(results.times, recording.times, atol=1e-9)
    assert np.isfinite(results.largest_angles).mean() > 0.9
    assert inside(results).all()


def test_a_pause_of_phyphox_is_refused(tmp_path):
    """Its stamps go on as if no time had gone by; the body may have turned meanwhile."""
    log = written(tmp_path / "recording.zip", phyphox(made(), pauses=[12.5]))
    assert "it was paused at 12.5 s (meta/time.csv)" in refuse("bounds", log)


def test_faults_of_a_file_have_its_name(tmp_path):
    files = phyphox(made())
    lines = files["Gyroscope.csv"].splitlines()
    lines[1000] = lines[1000].replace(lines[1000].split(",")[2], "NaN")
    files["Gyroscope.csv"] = "\n".join([*lines, "1,2"]) + "\n"
    log = written(tmp_path / "recording", files)
    message = refuse("bounds", log)
    assert f"{log}/Gyroscope.csv: line {len(lines) + 1}: 2 columns" in message
    _, _, summary, results = two_commands(tmp_path, log, "--repair")
    places = {fault["what"]: fault["places"] for fault in summary["repaired"]}
    assert places["lines without the 4 columns of the header"] == [f"Gyroscope.csv, line {len(lines) + 1}"]
    assert places["lines with words such as NaN or null"] == ["Gyroscope.csv, line 1001"]
    assert inside(results).all()


def test_two_sensors_of_a_kind_are_not_guessed(tmp_path):
    files = phyphox(made())
    files["Second gyro.csv"] = files["Gyroscope.csv"]
    assert "do not state sensor" in refuse("bounds", written(tmp_path / "recording", files))


def test_a_folder_is_checked_and_converted(tmp_path):
    log = written(tmp_path / "recording", iphone(made()))
    succeed("bounds", log, "--like", "sensor-logger", "--out", tmp_path / "config.toml")
    assert f"{log}: 0 errors" in succeed("check", log, tmp_path / "config.toml")
    succeed("convert", log, tmp_path / "out.csv", "--config", tmp_path / "config.toml")
    assert (tmp_path / "out.csv").read_text().count("\n") == len(made().times) + 2
