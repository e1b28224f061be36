"""A car whose velocity a receiver of satellites measures: up from the log, by a rule and by the sensor's own bounds."""

import json

import numpy as np
import pandas as pd
import pytest
import tomlkit
from elliptude import logs
from elliptude.configuration import Configuration
from elliptude.configuration.rules import rule_for
from elliptude.estimation.direction_rows import direction_rows
from elliptude.io.tables import Result
from inputs import angle_between
from scipy.spatial.transform import Rotation
from two_commands import app
from typer.testing import CliRunner

GRAVITY = 9.807
LARGEST, ERROR, OFFSET = 10.0, 0.4, 0.05
"""Of the acceleration, m/s²; of a velocity, m/s; of its stamp, s."""
SENSORS = {
    "time_column": "time_s",
    "flow": {"kind": "gyro", "columns": ["gx", "gy", "gz"], "unit": "deg/s"},
    "directions": [{"name": "up", "kind": "accelerometer", "columns": ["ax", "ay", "az"], "unit": "m/s^2"}],
    "truth": {"attitude_columns": ["qw", "qx", "qy", "qz"]},
    "estimator": {"mode": "guaranteed"},
}
VELOCITY = {
    "columns": ["ve", "vn", "vu"],
    "time_column": "gps_s",
    "time_unit": "s",
    "delay_s": 0.12,
    "time_offset_bound_s": OFFSET,
    "error_m_per_s": ERROR,
    "largest_acceleration_m_per_s2": LARGEST,
}
BY_RULE = SENSORS | {
    "rule": {"kind": "stated", "anchor_s": 4.0} | rule_for("car").model_dump(mode="json", exclude_none=True)
}
BY_SENSOR = SENSORS | {
    "reference_frame": "ENU",
    "flow": SENSORS["flow"]
    | {"noise_deg_per_s": 0.05, "bias_deg_per_s": 0.05, "estimate_bias": False, "anchor_s": 4.0},
    "directions": [
        SENSORS["directions"][0]
        | {
            "gravity_m_per_s2": GRAVITY,
            "sensor_error": {"error_m_per_s2": 0.1, "averaged_error_m_per_s2": 0.1},
            "bound_from": {
                "kind": "velocity_window",
                "windows_s": [2.0, 4.0, 8.0, 16.0],
                "velocity_m_per_s": 60.0,
                "at": "middle",
            },
        }
    ],
}


def run(*arguments):
    outcome = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    assert outcome.exit_code == 0, outcome.output
    return outcome.output


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A minute in a car at 100 Hz, after a rest of 6 s: it speeds up, brakes, takes curves, pitches and rolls."""
    draws, step = np.random.default_rng(7), 0.01
    times = step * np.arange(6000)
    on_road = np.clip((times - 6.0) / 2.0, 0.0, 1.0)
    speed = on_road * (14.0 + 9.0 * np.sin(0.45 * times))
    course = on_road * 1.4 * np.sin(0.21 * times)
    velocities = np.stack([speed * np.cos(course), speed * np.sin(course), 0.3 * on_road * np.sin(times)], axis=1)
    accelerations = np.gradient(velocities, times, axis=0)
    assert np.linalg.norm(accelerations, axis=1).max() < LARGEST
    tilts = np.stack([course, 0.06 * on_road * np.sin(1.3 * times), 0.05 * on_road * np.sin(1.7 * times)], axis=1)
    attitudes = Rotation.from_euler("ZYX", tilts)
    turns = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec() / step
    rates = np.concatenate([turns[:1], 0.5 * (turns[1:] + turns[:-1]), turns[-1:]])
    forces = attitudes.inv().apply(accelerations + np.array([0.0, 0.0, GRAVITY]))
    forces += 0.05 * np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    table = dict(zip(("time_s", "gx", "gy", "gz"), (times, *np.rad2deg(rates).T), strict=True))
    table |= dict(zip(("ax", "ay", "az"), forces.T, strict=True))
    table |= dict(zip(("qw", "qx", "qy", "qz"), attitudes.as_quat(scalar_first=True).T, strict=True))
    # The receiver's stamps are late, and off from that; its errors are at their bound, in one way for half of the time.
    stamps = np.arange(0.303, times[-1] - 0.2, 0.2)
    shown = stamps - 0.12 + OFFSET * draws.choice([-1.0, 1.0], len(stamps))
    way = np.where(stamps < 30.0, 1.0, -1.0)[:, None] * draws.normal(size=3)
    way *= ERROR / np.linalg.norm(way, axis=1, keepdims=True)
    measured = np.stack([np.interp(shown, times, velocities[:, i]) for i in range(3)], axis=1) + way
    rows = np.arange(len(stamps)) * 20
    for name, values in zip(("gps_s", "ve", "vn", "vu"), (stamps, *measured.T), strict=True):
        table[name] = np.full(len(times), np.nan)
        table[name][rows] = values
    path = tmp_path_factory.mktemp("drive") / "drive.csv"
    pd.DataFrame(table).to_csv(path, index=False, float_format="%.9f")
    return path


@pytest.mark.parametrize("stated", [BY_RULE, BY_SENSOR], ids=["rule", "sensor"])
def test_up_is_known_better_by_the_velocity(drive, stated):
    found = {}
    for name, extra in (("with", {"velocity": VELOCITY}), ("without", {})):
        configuration = Configuration.model_validate(stated | extra)
        log = logs.read_log(drive, configuration)
        rows = direction_rows(log, configuration)
        known = np.isfinite(log.true_attitudes[:, 0, 0]) & np.isfinite(rows.angles[:, 0])
        ups = log.true_attitudes[known][:, 2]
        off = [angle_between(one, up) for one, up in zip(rows.directions[known, 0], ups, strict=True)]
        assert (np.array(off) <= rows.angles[known, 0]).all()
        assert not rows.contradictions
        moving = known & (log.times > 12.0) & (log.times < 50.0)
        found[name] = np.rad2deg(np.minimum(rows.angles[moving, 0], np.pi)).mean()
    # 2 v/T is 70 degrees over 15 s by the rule, and 50 over 16 s by the sensor's own speed.
    assert found["with"] < 0.5 * found["without"]


def test_rows_of_the_receiver_are_rows_of_the_log(drive):
    configuration = Configuration.model_validate(BY_RULE | {"velocity": VELOCITY})
    log = logs.read_log(drive, configuration)
    there = np.isfinite(log.velocities[:, 0])
    assert there.sum() > 280
    assert np.isnan(log.directions[there][:, 0]).all()
    np.testing.assert_allclose(log.times[there][0], 0.183, atol=1e-9)


def test_an_estimate_of_up_by_the_velocity(drive, tmp_path):
    """Up has a bound at each row, also at those of the receiver, and the truth is within it."""
    widths = {}
    for name, extra in (("with", {"velocity": VELOCITY}), ("without", {})):
        config, out = tmp_path / f"{name}.toml", tmp_path / name
        config.write_text(tomlkit.dumps(BY_RULE | extra))
        run("estimate", drive, "--config", config, "--out", out)
        results, summary = Result.read(out / "results.csv"), json.loads((out / "summary.json").read_text())
        at_rest = summary["sizes"]["at_rest"]["rows"]
        assert at_rest == pytest.approx(600.0, abs=60.0)
        assert summary["up_claim_share_of_rows"]["unconditional"] == 1.0
        truth = pd.read_csv(drive)
        ups = Rotation.from_quat(truth[["qw", "qx", "qy", "qz"]], scalar_first=True).as_matrix()[:, 2]
        at = np.searchsorted(truth["time_s"], results.times + 1e-9, side="right") - 1
        same = np.abs(truth["time_s"].to_numpy()[at] - results.times) < 1e-6
        off = np.array([angle_between(*pair) for pair in zip(results.ups[same], ups[at[same]], strict=True)])
        assert (off <= results.up_bounds[same]).all()
        widths[name] = np.rad2deg(results.up_bounds).mean()
    assert widths["with"] < 0.6 * widths["without"], widths


def test_a_repair_leaves_the_rows_without_a_fix(drive, tmp_path):
    """Most rows have no stamp of the receiver, and are none the worse for it."""
    table = pd.read_csv(drive)
    table.loc[3000, "ax"] = np.nan
    table.to_csv(tmp_path / "drive.csv", index=False)
    config, out = tmp_path / "drive.toml", tmp_path / "out"
    config.write_text(tomlkit.dumps(BY_RULE | {"velocity": VELOCITY}))
    run("estimate", tmp_path / "drive.csv", "--config", config, "--out", out, "--repair")
    assert len(Result.read(out / "results.csv").times) > 5900
    repaired = json.loads((out / "summary.json").read_text())["repaired"]
    assert [one["count"] for one in repaired] == [1]


def test_stamps_of_the_receiver_in_nanoseconds(drive, tmp_path):
    table = pd.read_csv(drive)
    begin = 1_700_000_000_000_000_000
    for name in ("time_s", "gps_s"):
        table[name] = begin + (1e9 * table[name]).round().astype("Int64")
    table.to_csv(tmp_path / "drive.csv", index=False)
    own = VELOCITY | {"time_unit": "ns"}
    stated = BY_RULE | {"time_unit": "ns", "timing": {"origin": "first"}, "velocity": own}
    configuration = Configuration.model_validate(stated)
    log = logs.read_log(tmp_path / "drive.csv", configuration)
    assert np.isfinite(log.velocities[:, 0]).sum() > 280


def test_a_speed_that_the_velocity_refutes(drive):
    slow = rule_for("car").model_dump(mode="json", exclude_none=True)
    slow["motion"]["velocity_m_per_s"] = 5.0
    stated = SENSORS | {"rule": {"kind": "stated", "anchor_s": 4.0} | slow, "velocity": VELOCITY}
    configuration = Configuration.model_validate(stated)
    with pytest.raises(ValueError, match="the rule states a speed of at most 5 m/s, but the measured velocity changes"):
        direction_rows(logs.read_log(drive, configuration), configuration)


def test_a_velocity_that_never_counts(drive):
    configuration = Configuration.model_validate(BY_RULE | {"velocity": VELOCITY | {"delay_s": 1e6}})
    with pytest.raises(ValueError, match="velocity: ve, vn, vu were measured at no row between the gyro's"):
        direction_rows(logs.read_log(drive, configuration), configuration)


def test_samples_of_the_accelerometer_without_the_gyro_count(drive, tmp_path):
    """A rule's windows are of all that the accelerometer shows, also where the gyro is read half as often."""
    table = pd.read_csv(drive)
    table.loc[1::2, ["gx", "gy", "gz"]] = np.nan
    table.to_csv(tmp_path / "drive.csv", index=False)
    rule = rule_for("car").model_dump(mode="json", exclude_none=True)
    rule["gyro"]["longest_interval_s"] = 0.03
    stated = SENSORS | {"rule": {"kind": "stated", "anchor_s": 4.0} | rule, "timing": {"largest_gap_s": 0.05}}
    configuration = Configuration.model_validate(stated)
    log = logs.read_log(tmp_path / "drive.csv", configuration)
    assert log.gyro_times is not None
    assert np.isfinite(direction_rows(log, configuration).directions[:, 0, 0]).mean() > 0.99


def test_check_lists_the_velocity(drive, tmp_path):
    config = tmp_path / "drive.toml"
    config.write_text(tomlkit.dumps(BY_RULE | {"velocity": VELOCITY}))
    said = json.loads(run("check", drive, config, "--json"))
    (found,) = [one for one in said["sensors"] if one["name"] == "the velocity"]
    assert found["unit"] == "m/s"
    assert found["rate_hz"] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"error_m_per_s": -1.0}, "velocity.error_m_per_s"),
        ({"largest_acceleration_m_per_s2": None}, "velocity.largest_acceleration_m_per_s2"),
        ({"unit": "mph"}, "velocity.unit"),
    ],
)
def test_wrong_velocities_are_refused_by_name(drive, tmp_path, changes, message):
    velocity = {key: value for key, value in (VELOCITY | changes).items() if value is not None}
    config = tmp_path / "drive.toml"
    config.write_text(tomlkit.dumps(BY_RULE | {"velocity": velocity}))
    outcome = CliRunner().invoke(app(), ["check", str(drive), str(config)])
    assert outcome.exit_code != 0
    assert message in outcome.output


def test_a_velocity_without_windows_is_refused():
    sensors = [SENSORS["directions"][0] | {"bound_deg": 5.0}]
    without = BY_SENSOR | {"directions": sensors, "velocity": VELOCITY}
    with pytest.raises(ValueError, match=r"velocity: is for an accelerometer with bound_from.kind = 'velocity_window'"):
        Configuration.model_validate(without)


def test_a_measured_velocity_is_enough_for_windows(drive):
    """Nothing else need be known of how the vehicle moves; without it, something must be."""
    sensor = BY_SENSOR["directions"][0]
    silent = {key: value for key, value in sensor["bound_from"].items() if key != "velocity_m_per_s"}
    alone = BY_SENSOR | {"directions": [sensor | {"bound_from": silent}]}
    with pytest.raises(ValueError, match=r"needs one or more of velocity_m_per_s, .*, or a measured \[velocity\]"):
        Configuration.model_validate(alone)
    configuration = Configuration.model_validate(alone | {"velocity": VELOCITY})
    log = logs.read_log(drive, configuration)
    rows = direction_rows(log, configuration)
    known = np.isfinite(rows.angles[:, 0])
    assert known[log.gyro_rows][1000:5000].mean() > 0.99
    ups = log.true_attitudes[known][:, 2]
    errors = np.arccos(np.clip(np.einsum("ij,ij->i", rows.directions[known, 0], ups), -1.0, 1.0))
    assert (errors <= rows.angles[known, 0]).all()
