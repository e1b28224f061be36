"""From a recording to a calibration to sharper sets: the command, and what `estimate` makes of what it writes."""

import json
import tomllib

import numpy as np
import pytest
import tomlkit
from elliptude import estimation, logs
from elliptude.bounds.samples import VectorSensorBounds, accelerometer_bounds
from elliptude.calibration.calibrate import calibrate, sha256_of
from elliptude.cli.application import make_app
from elliptude.configuration import read_configuration, rules
from elliptude.configuration.calibration import AccelerometerCalibration, calibrated_bounds, read_statements
from elliptude.configuration.configuration import Configuration
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

FIELD = np.array([0.0, 18.0, -45.0])
GRAVITY = np.array([0.0, 0.0, 9.807])
FORCE_OFFSET, FIELD_OFFSET = np.array([0.12, -0.08, 0.06]), np.array([0.5, 0.4, -0.5])
FORCE_SENSOR = np.eye(3) + 0.004 * np.array([[1.0, 0.5, 0.0], [0.0, -1.0, 0.3], [0.2, 0.0, 0.5]])
FIELD_SENSOR = np.eye(3) + 0.005 * np.array([[-1.0, 0.0, 0.4], [0.2, 1.0, 0.0], [0.0, 0.3, 0.2]])


def recording(seed=0, poses=14, disturbance=0.0):
    """A minute or so at 100 Hz: a rest, turns to poses and rests there; with the errors of the sensors above."""
    rng = np.random.default_rng(seed)
    rates = [np.zeros((300, 3))]
    for _ in range(poses):
        turn = Rotation.random(random_state=rng.integers(1 << 30)).as_rotvec()
        bell = np.sin(np.linspace(0.0, np.pi, 150)) ** 2
        rates += [turn * bell[:, None] / (0.01 * bell.sum()), np.zeros((150, 3))]
    rates = np.concatenate(rates)
    times = 0.01 * np.arange(len(rates))
    turns = Rotation.from_rotvec(0.005 * (rates[1:] + rates[:-1]))
    attitude = Rotation.identity()
    attitudes = [attitude]
    for turn in turns:
        attitude = attitude * turn
        attitudes.append(attitude)
    attitudes = Rotation.concatenate(attitudes)
    count = len(times)
    field = FIELD + disturbance * np.column_stack([np.sin(times), np.cos(times), 0.0 * times])
    force = attitudes.inv().apply(GRAVITY) @ FORCE_SENSOR.T + FORCE_OFFSET + rng.uniform(-0.05, 0.05, (count, 3))
    measured = attitudes.inv().apply(field) @ FIELD_SENSOR.T + FIELD_OFFSET + rng.uniform(-0.3, 0.3, (count, 3))
    return {
        "t": times,
        "gyr": rates * 1.003 + np.deg2rad([0.3, -0.2, 0.1]) + np.deg2rad(rng.uniform(-0.1, 0.1, (count, 3))),
        "acc": force,
        "mag": np.roll(measured, 1, axis=0),  # late by 10 ms
        "q": attitudes.as_quat(scalar_first=True),
    }


def configuration(**changes):
    return {
        "time_column": "t",
        "rule": {"kind": "hand_held", "anchor_s": 4.0},
        "flow": {"kind": "gyro", "columns": [f"gyr[{i}]" for i in range(3)]},
        "directions": [
            {"name": "up", "kind": "accelerometer", "columns": [f"acc[{i}]" for i in range(3)], "unit": "m/s^2"},
            {"name": "field", "kind": "magnetometer", "columns": [f"mag[{i}]" for i in range(3)], "unit": "uT"},
        ],
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
        "truth": {"attitude_columns": [f"q[{i}]" for i in range(4)], "error_deg": 0.1},
    } | changes


def run(*arguments):
    return CliRunner().invoke(make_app(), [str(argument) for argument in arguments], env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording, its configuration, its calibration and a configuration that uses it."""
    path = tmp_path_factory.mktemp("calibrate")
    np.savez(path / "log.npz", **recording())
    (path / "log.toml").write_text(tomlkit.dumps(configuration()))
    (path / "calibrated.toml").write_text(tomlkit.dumps(configuration(calibration={"file": "found.toml"})))
    # Each pose lies on a table.
    statements = read_statements().model_dump(mode="json", exclude_none=True)
    statements["accelerometer"] |= {"velocity_m_per_s": 0.005, "acceleration_m_per_s2": 0.05}
    (path / "table.toml").write_text(tomlkit.dumps(statements))
    known = ("--statements", path / "table.toml", "--disturbance-ut", 0.1)
    done = run("calibrate", path / "log.npz", path / "log.toml", "--out", path / "found.toml", *known)
    assert done.exit_code == 0, done.output
    return path


def test_the_true_offsets_are_within_what_is_left(folder):
    table = tomlkit.parse((folder / "found.toml").read_text())["calibration"]
    assert table["recording"] == "log.npz"
    assert table["recording_sha256"] == sha256_of(folder / "log.npz")
    force, field, _ = table["sensors"]
    assert force["poses"] >= 14
    matrix = np.array(force["matrix"])
    left = np.linalg.norm(matrix @ (FORCE_OFFSET - np.array(force["offset_m_per_s2"])))
    assert left <= force["averaged_error_m_per_s2"] - 0.03 < 0.5 * 0.2
    left = np.linalg.norm(np.array(field["matrix"]) @ (FIELD_OFFSET - np.array(field["offset_ut"])))
    assert left <= field["averaged_error_ut"] - 0.3 < 1.0


def test_stamps_of_a_truth_make_no_rows(folder):
    """What is calibrated is seen as it would be without something to compare with."""
    np.savez(folder / "late.npz", own=recording()["t"] + 0.004, **recording())
    truth = configuration()["truth"] | {"time_column": "own", "time_unit": "s"}
    (folder / "late.toml").write_text(tomlkit.dumps(configuration(truth=truth)))
    known = ("--statements", folder / "table.toml", "--disturbance-ut", 0.1)
    done = run("calibrate", folder / "late.npz", folder / "late.toml", "--out", folder / "of_late.toml", *known)
    assert done.exit_code == 0, done.output
    found, other = (tomlkit.parse((folder / name).read_text()).unwrap() for name in ("of_late.toml", "found.toml"))
    assert found["calibration"]["sensors"] == other["calibration"]["sensors"]


def test_estimate_uses_it_and_the_truth_stays_inside(folder):
    """A calibration holds for another recording of the same sensors."""
    np.savez(folder / "other.npz", **recording(seed=1, disturbance=1.0))
    widths = []
    for name in ("log.toml", "calibrated.toml"):
        stated = read_configuration(folder / name)
        estimated = estimation.estimate(logs.read_log(folder / "other.npz", stated), stated)
        summary = estimation.summarize(estimated, stated)
        assert summary["inside_share_of_unconditional_rows"] == 1.0
        assert summary["claim_share_of_rows"]["unconditional"] == 1.0
        assert summary["calibrated"] == (["up", "field"] if name == "calibrated.toml" else [])
        widths.append(summary["sizes"]["at_rest"]["half_width_reference_deg"]["mean"])
    assert all(calibrated < 0.95 * plain for plain, calibrated in zip(*widths, strict=True))


def test_samples_are_corrected_as_they_are_read(folder):
    plain, corrected = (
        logs.read_log(folder / "log.npz", read_configuration(folder / name)) for name in ("log.toml", "calibrated.toml")
    )
    force = tomlkit.parse((folder / "found.toml").read_text())["calibration"]["sensors"][0]
    expected = (plain.directions[:, 0] - np.array(force["offset_m_per_s2"])) @ np.array(force["matrix"]).T
    np.testing.assert_allclose(corrected.directions[:, 0], expected, atol=1e-12)
    lengths = [np.abs(np.linalg.norm(log.directions[:300, 0], axis=1).mean() - 9.807) for log in (plain, corrected)]
    assert lengths[1] < lengths[0]


def test_a_rule_that_says_more_is_kept(folder):
    """Where the statement is smaller than what the calibration leaves, nothing is corrected."""
    stated = read_configuration(folder / "calibrated.toml")
    rule = stated.rule.rule()
    small = rule.accelerometer.model_copy(update={"averaged_error_m_per_s2": 0.0, "scale_error": 0.0})
    tables = configuration(calibration={"file": str(folder / "found.toml")})
    tables["rule"] = {"kind": "stated"} | rule.model_copy(update={"accelerometer": small}).model_dump(
        mode="json", exclude_none=True
    )
    (folder / "small.toml").write_text(tomlkit.dumps(tables))
    exact = read_configuration(folder / "small.toml")
    assert exact.correction_of(exact.directions[0]) is None
    assert exact.correction_of(exact.directions[1]) is not None
    assert exact.calibrated_rule().accelerometer == small
    assert exact.calibrated_rule().magnetometer.averaged_error_ut < rule.magnetometer.averaged_error_ut


def test_a_calibration_that_is_not_used_is_said(folder, tmp_path):
    stated = read_configuration(folder / "calibrated.toml")
    assert stated.calibrations_not_used() == {}
    found = tomllib.loads((folder / "found.toml").read_text())
    found["calibration"]["sensors"][0] |= {"error_m_per_s2": 0.9, "averaged_error_m_per_s2": 0.3034}
    (tmp_path / "found.toml").write_text(tomlkit.dumps(found))
    (tmp_path / "log.toml").write_text((folder / "calibrated.toml").read_text())
    own = read_configuration(tmp_path / "log.toml").rule.rule().accelerometer.averaged_error_m_per_s2
    said = f"the calibration of 'up' is not used: it leaves 0.303 m/s^2, the rule says {own:.3g} m/s^2"
    done = run("estimate", folder / "log.npz", "--config", tmp_path / "log.toml", "--out", tmp_path / "out")
    assert said in " ".join(done.output.split())
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["calibrations_not_used"] == [said]
    assert f"warning: up: {said}" in " ".join(run("check", folder / "log.npz", tmp_path / "log.toml").output.split())


def test_a_calibration_that_corrects_nothing_changes_no_statement(folder):
    """A rule that is wider than the statements of the calibration has its reasons, such as a sensor that vibrates."""
    found = tomlkit.parse((folder / "found.toml").read_text()).unwrap()
    for sensor in found["calibration"]["sensors"]:
        for name in ("offset_m_per_s2", "offset_ut"):
            if name in sensor:
                sensor[name] = [0.0, 0.0, 0.0]
        sensor["matrix"] = np.eye(3).tolist()
    (folder / "nothing.toml").write_text(tomlkit.dumps(found))
    tables = configuration(calibration={"file": str(folder / "nothing.toml")})
    (folder / "wide.toml").write_text(tomlkit.dumps(tables))
    stated = read_configuration(folder / "wide.toml")
    assert stated.corrected_sensors() == []
    assert stated.calibrated_rule() == stated.rule.rule()


def test_sensors_without_a_rule_are_corrected_too(folder):
    tables = configuration(calibration={"file": "found.toml"}, reference_frame="ENU")
    del tables["rule"]
    tables["flow"] |= {"noise_deg_per_s": 1.0, "bias_deg_per_s": 0.5}
    tables["directions"][0] |= {
        "bound_from": {"kind": "acceleration", "acceleration_m_per_s2": 0.2},
        "sensor_error": {"error_m_per_s2": 0.6, "averaged_error_m_per_s2": 0.2, "scale_error": 0.01},
    }
    tables["directions"][1] |= {"bound_deg": 5.0, "reference_ut": FIELD.tolist()}
    (folder / "stated.toml").write_text(tomlkit.dumps(tables))
    stated = read_configuration(folder / "stated.toml")
    bounds = stated.sensor_bounds(stated.directions[0])
    assert bounds.averaged_error < 0.2
    # An angle is stated of samples as they are.
    assert stated.correction_of(stated.directions[1]) is None


def test_an_offset_goes_with_the_scale_error_that_it_was_found_beside():
    """What is scale and what is offset is for a statement to say: two ways to take one sensor apart are not mixed."""
    found = AccelerometerCalibration(
        kind="accelerometer", name="up", columns=("ax", "ay", "az"), unit="m/s^2", scale_error=0.01,
        offset_m_per_s2=(0.1, 0.0, 0.0), error_m_per_s2=0.01, averaged_error_m_per_s2=0.01, averaged_over_s=2.0,
    )  # fmt: skip
    left = calibrated_bounds(found, VectorSensorBounds(error=0.25, averaged_error=0.25))
    assert (left.error, left.scale_error, left.averaged_over) == (0.01, 0.01, 2.0)
    # A sensor whose axes are turned by what is left of the scale, and that has the offset: the raw sample is as stated.
    sample = 9.807 * np.array([1.0, 0.00999, 0.0]) + np.array([0.1, 0.0, 0.0])
    assert np.linalg.norm(sample - [9.807, 0.0, 0.0]) < 0.25
    bounds = accelerometer_bounds((sample - found.offset())[None], 0.0, gravity=9.807, sensor=left)
    assert np.arccos(bounds.directions[0, 0]) <= bounds.angles[0]
    assert calibrated_bounds(found, VectorSensorBounds(error=0.05, averaged_error=0.05)) is None


def test_what_a_gyro_was_calibrated_with_is_used_with_what_was_found(folder):
    """A scale error is left beside the noise that the calibration was told, if that is more than the rule's."""
    tables = configuration()
    rates = {"kind": "gyro", "name": "the gyro", "columns": tables["flow"]["columns"], "unit": "rad/s"}
    rates |= {"matrix": (0.99 * np.eye(3)).tolist(), "scale_error": 0.001}
    for told in ({}, {"noise_deg_per_s": 7.0, "bias_deg_per_s": 0.1, "increment_deg": 9.0}, {"noise_deg_per_s": 7.0}):
        found = {"recording": "x", "recording_sha256": "0", "sensors": [rates | told]}
        gyro = Configuration.model_validate(tables | {"calibration": found}).calibrated_rule().gyro
        plain = Configuration.model_validate(tables).rule.rule().gyro
        assert gyro.noise_deg_per_s >= 0.99 * max(plain.noise_deg_per_s, told.get("noise_deg_per_s", 0.0))
        assert gyro.bias_deg_per_s >= 0.99 * max(plain.bias_deg_per_s, told.get("bias_deg_per_s", 0.0))
        if told and "increment_deg" not in told:
            assert gyro.increment_deg is None
        else:
            assert gyro.increment_deg >= 0.99 * max(plain.increment_deg, told.get("increment_deg", 0.0))
        # What noise turns by itself is the same behind a matrix, but of other noise nothing was said.
        person = {"rule": {"kind": "stated"} | rules.rule_for("person").model_dump(mode="json", exclude_none=True)}
        gyro = Configuration.model_validate(tables | person | {"calibration": found}).calibrated_rule().gyro
        assert gyro.noise_turn_deg == (None if told else 2.5)
        assert (gyro.bias_change_deg_per_s is None) == bool(told)
        assert (gyro.bounds().noise_turn == np.inf) == bool(told)


def test_a_gyro_of_which_much_is_stated(folder):
    """Slow turns by up to half a turn between rests on a table, with an accelerometer that is nearly exact."""
    arrays = recording(seed=2, poses=40)
    rng = np.random.default_rng(3)
    attitudes = Rotation.from_quat(arrays["q"], scalar_first=True)
    count = len(arrays["t"])
    arrays["acc"] = attitudes.inv().apply(GRAVITY) + rng.uniform(-0.01, 0.01, (count, 3))
    rates = (arrays["gyr"] - arrays["gyr"][:300].mean(axis=0)) / 1.003
    scale = np.array([[0.012, 0.003, 0.0], [-0.002, -0.01, 0.002], [0.0, 0.001, 0.008]])
    bias = np.deg2rad([0.3, -0.2, 0.1])
    rates[np.linalg.norm(rates, axis=1) < 0.005] = 0.0
    arrays["gyr"] = rates @ (np.eye(3) + scale).T + bias
    np.savez(folder / "turns.npz", **arrays)
    statements = read_statements().model_dump(mode="json", exclude_none=True)
    statements["accelerometer"] |= {
        "offset_m_per_s2": 0.01, "scale_error": 0.0005, "noise_m_per_s2": 0.02, "averaged_noise_m_per_s2": 0.002,
        "velocity_m_per_s": 0.001, "acceleration_m_per_s2": 0.01,
    }  # fmt: skip
    statements["gyro"] = {
        "noise_deg_per_s": 0.3, "bias_deg_per_s": 0.02, "scale_error": 0.02, "increment_deg": 0.02,
    }  # fmt: skip
    (folder / "fine.toml").write_text(tomlkit.dumps(statements))
    done = run(
        "calibrate", folder / "turns.npz", folder / "log.toml", "--out", folder / "gyro.toml", "--statements",
        folder / "fine.toml",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    gyro = tomlkit.parse((folder / "gyro.toml").read_text())["calibration"]["sensors"][2]
    left = np.linalg.norm(np.array(gyro["matrix"]) @ (np.eye(3) + scale) - np.eye(3), 2)
    assert left <= gyro["scale_error"] < 0.02
    (folder / "with_gyro.toml").write_text(tomlkit.dumps(configuration(calibration={"file": "gyro.toml"})))
    plain, stated = read_configuration(folder / "log.toml"), read_configuration(folder / "with_gyro.toml")
    assert "the gyro" in stated.corrected_sensors()
    rule = stated.calibrated_rule()
    assert rule.gyro.scale_error == gyro["scale_error"]
    assert rule.gyro.noise_deg_per_s >= 1.0 * np.linalg.norm(gyro["matrix"], 2)
    raw, corrected = (logs.read_log(folder / "turns.npz", one) for one in (plain, stated))
    np.testing.assert_allclose(corrected.rates, raw.rates @ np.array(gyro["matrix"]).T, atol=1e-12)
    widths = []
    for one in (plain, stated):
        summary = estimation.summarize(estimation.estimate(logs.read_log(folder / "turns.npz", one), one), one)
        assert summary["inside_share_of_unconditional_rows"] == 1.0
        widths.append(summary["sizes"]["moving"]["half_width_reference_deg"]["mean"][2])
    assert widths[1] < widths[0]


def test_bounds_are_of_samples_as_they_are(folder):
    """The table stays in what `bounds` writes, and `estimate` chooses between both."""
    out = folder / "proposed.toml"
    done = run("bounds", folder / "log.npz", folder / "calibrated.toml", "--out", out)
    assert done.exit_code == 0, done.output
    assert tomlkit.parse(out.read_text())["calibration"] == {"file": "found.toml"}
    plain = run("bounds", folder / "log.npz", folder / "log.toml", "--json")
    corrected = run("bounds", folder / "log.npz", folder / "calibrated.toml", "--json")
    assert plain.stdout == corrected.stdout


def test_figures_as_json(folder):
    done = run(
        "calibrate", folder / "log.npz", folder / "log.toml", "--out", folder / "again.toml", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    force, field, gyro = json.loads(done.stdout)
    assert gyro["turns"] == 14
    assert gyro["scale_error"] == 0.02
    assert gyro["remarks"] == [
        "the gyro: 14 turns between rests, which add nothing to what is stated of it; nothing is corrected"
    ]
    assert force["undetermined"] == []
    assert np.all(np.array(force["lowest_offset"]) <= FORCE_OFFSET)
    assert np.all(np.array(force["highest_offset"]) >= FORCE_OFFSET)
    # By default the field may be off by more than the offset: nothing follows, and that is said.
    assert field["undetermined"] == ["x", "y", "z"]
    assert field["stated_disturbance"] == 5.0
    assert any("may hide any offset of 1 uT" in remark for remark in field["remarks"])


def test_one_pose_determines_little():
    arrays = recording(poses=0)
    stated = configuration()
    from elliptude.configuration import Configuration

    configured = Configuration.model_validate(stated)
    log = logs.Log(
        times=arrays["t"],
        directions=np.stack([arrays["acc"], 1e-6 * arrays["mag"]], axis=1),
        references=np.zeros((len(arrays["t"]), 2, 3)),
        rates=arrays["gyr"],
    )
    force, field, gyro = calibrate(log, configured, read_statements())
    assert gyro.left.turns == 0
    assert "no two rests" in gyro.remarks()[0]
    assert force.left.poses == 1
    assert set(force.undetermined) >= {"x", "y"}
    assert not force.left.is_correction
    assert force.remarks()[0].startswith("up: 1 pose with errors as stated, which leave the offset along x, y")
    assert not field.left.is_correction


def test_the_correction_itself_is_said(folder):
    done = run(
        "calibrate", folder / "log.npz", folder / "log.toml", "--out", folder / "said.toml", "--statements",
        folder / "table.toml", "--disturbance-ut", 0.1,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    force, field, gyro = tomlkit.parse((folder / "said.toml").read_text())["calibration"]["sensors"]
    for sensor, unit in ((force, "m/s^2"), (field, "uT")):
        offset = sensor["offset_ut" if unit == "uT" else "offset_m_per_s2"]
        subtracted = ", ".join(f"{value:.3g}" for value in offset)
        assert f"{sensor['name']}: from a sample ({subtracted}) {unit} is subtracted; the true offset is" in done.output
        for axis, value in zip("xyz", offset, strict=True):
            assert any(axis in line.split() and f"{value:.3g}" in line.split() for line in done.output.splitlines())
    assert gyro["matrix"] == np.eye(3).tolist()
    assert "the gyro: 14 turns between rests, which add nothing" in done.output


def test_noise_of_later_logs_is_a_statement_of_its_own(folder):
    """An engine adds noise to every later log, and nothing to what the recording on the table shows."""
    found = []
    for factor in (1.0, 3.0):
        statements = tomlkit.parse((folder / "table.toml").read_text()).unwrap()
        for name, unit in (("accelerometer", "m_per_s2"), ("magnetometer", "ut")):
            statements[name][f"later_noise_{unit}"] *= factor
            statements[name][f"later_averaged_noise_{unit}"] *= factor
        (folder / "engine.toml").write_text(tomlkit.dumps(statements))
        done = run(
            "calibrate", folder / "log.npz", folder / "log.toml", "--out", folder / "engine_found.toml", "--force",
            "--statements", folder / "engine.toml", "--disturbance-ut", 0.1,
        )  # fmt: skip
        assert done.exit_code == 0, done.output
        found.append(tomlkit.parse((folder / "engine_found.toml").read_text())["calibration"]["sensors"])
    for quiet, noisy, unit, noise in zip(*(one[:2] for one in found), ("m_per_s2", "ut"), (0.4, 3.0), strict=True):
        assert quiet["matrix"] == noisy["matrix"]
        assert quiet[f"offset_{unit}"] == noisy[f"offset_{unit}"]
        assert noisy[f"error_{unit}"] - quiet[f"error_{unit}"] >= 2.0 * noise * (1.0 - 1e-12)
        np.testing.assert_allclose(noisy[f"error_{unit}"] - quiet[f"error_{unit}"], 2.0 * noise, rtol=0.05)
    assert found[0][2] == found[1][2]  # the gyro is calibrated from the recording alone


def test_two_tables_of_one_sensor_are_refused(folder):
    found = tomlkit.parse((folder / "found.toml").read_text()).unwrap()
    found["calibration"]["sensors"].append(found["calibration"]["sensors"][1])
    (folder / "twice.toml").write_text(tomlkit.dumps(found))
    (folder / "with_twice.toml").write_text(tomlkit.dumps(configuration(calibration={"file": "twice.toml"})))
    done = run("check", folder / "log.npz", folder / "with_twice.toml")
    assert done.exit_code == 1
    assert "sensors: [1] and [3] are of the same columns, mag[0], mag[1], mag[2]" in done.output


def test_no_rest_is_long_enough(folder):
    statements = read_statements().model_dump(mode="json", exclude_none=True)
    statements["accelerometer"]["rest_s"] = 1e6
    (folder / "long.toml").write_text(tomlkit.dumps(statements))
    done = run(
        "calibrate", folder / "log.npz", folder / "log.toml", "--out", folder / "none.toml", "--statements",
        folder / "long.toml",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "up: the recording has no pose of it that counts; it stays as stated" in done.output
    assert "the gyro: the recording has no two rests" in done.output


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"axes": ["y", "-x", "z"]}, "calibrated with another axes"),
        ({"unit": "g"}, "calibrated with another unit or at_rest"),
        ({"columns": ["mag[0]", "acc[1]", "acc[2]"]}, None),
    ],
)
def test_a_calibration_of_another_sensor(folder, change, message):
    tables = configuration(calibration={"file": "found.toml"})
    tables["directions"][0] |= change
    (folder / "other.toml").write_text(tomlkit.dumps(tables))
    done = run("check", folder / "log.npz", folder / "other.toml")
    if message is None:  # it is of the magnetometer still
        assert "calibration" not in done.output
    else:
        assert done.exit_code == 1
        assert message in done.output


def test_bad_input_is_named(folder):
    out = folder / "bad.toml"

    def failed(*arguments, code=1):
        done = run("calibrate", *arguments, "--out", out)
        assert done.exit_code == code, done.output
        assert done.exception is None or isinstance(done.exception, SystemExit)
        assert not out.exists()
        return done.output

    log, stated = folder / "log.npz", folder / "log.toml"
    assert "no such file" in failed(folder / "none.npz", stated).lower()
    assert "--disturbance-ut" in failed(log, stated, "--disturbance-ut", "nan", code=2)
    assert "--disturbance-ut" in failed(log, stated, "--disturbance-ut", "-1", code=2)
    tables = configuration(reference_frame="ENU")
    del tables["rule"]
    tables["flow"] |= {"noise_deg_per_s": 1.0}
    tables["directions"][0]["bound_deg"] = tables["directions"][1]["bound_deg"] = 5.0
    tables["directions"][1]["reference_ut"] = FIELD.tolist()
    (folder / "without.toml").write_text(tomlkit.dumps(tables))
    assert "rule: missing" in failed(log, folder / "without.toml")
    (folder / "statements.toml").write_text("[accelerometer]\noffset_m_per_s2 = -1.0\n")
    assert "accelerometer.offset_m_per_s2" in failed(log, stated, "--statements", folder / "statements.toml")
    huge = read_statements().model_dump(mode="json", exclude_none=True)
    huge["magnetometer"]["offset_ut"] = 1e300
    (folder / "statements.toml").write_text(tomlkit.dumps(huge))
    assert "magnetometer.offset_ut" in failed(log, stated, "--statements", folder / "statements.toml")
    arrays = recording()
    arrays["mag"][500] = 1e20
    np.savez(folder / "huge.npz", **arrays)
    assert "'field': no parameters agree with the sample at 5.000 s" in failed(folder / "huge.npz", stated)
    swapped = configuration()
    swapped["directions"][0]["axes"] = ["y", "-x", "z"]
    (folder / "swapped.toml").write_text(tomlkit.dumps(swapped))
    assert "axes" in failed(log, folder / "swapped.toml")
    arrays = recording()
    arrays["gyr"] = arrays["gyr"][400:]
    for name in ("t", "acc", "mag", "q"):
        arrays[name] = arrays[name][400:]
    np.savez(folder / "turning.npz", **arrays)
    assert "starts with a rest" in failed(folder / "turning.npz", stated)
    arrays = recording()
    arrays["acc"][1000:1400] *= 1.1
    np.savez(folder / "liar.npz", **arrays)
    message = failed(folder / "liar.npz", stated)
    assert "'up': no parameters agree with the samples at" in message
    (folder / "lost.toml").write_text(tomlkit.dumps(configuration(calibration={"file": "nowhere.toml"})))
    done = run("check", log, folder / "lost.toml")
    assert done.exit_code == 1
    assert "nowhere.toml" in done.output
    (folder / "found.toml").exists()
    done = run("calibrate", log, stated, "--out", folder / "found.toml")
    assert done.exit_code == 1
    assert "there already" in done.output
