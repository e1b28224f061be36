"""Sensors whose stamps `timing.same_within_s` brings together: a user states it, and sets hold the truth."""

import numpy as np
import pytest
from elliptude import estimation
from elliptude.configuration import Configuration
from elliptude.estimation.direction_rows import direction_rows
from elliptude.io.tables import MEASURED_RATE, measured, own_stamps
from elliptude.logs.conversion import convert_measurements
from elliptude.logs.log import read_log
from inputs import angle_between
from scipy.spatial.transform import Rotation

STEP, COUNT, RATE = 0.01, 600, 1.5
TIMES = STEP * np.arange(COUNT)
LATE = 0.004 * np.sin(np.arange(COUNT)) ** 2


def attitudes_at(times):
    return Rotation.from_rotvec(np.outer(RATE * times, [1.0, 0.0, 0.0]))


def columns(name):
    return [f"{name}[{i}]" for i in range(3)]


def configuration(*directions, **tables):
    given = {
        "time_column": "t",
        "reference_frame": "ENU",
        "flow": {
            "kind": "gyro",
            "columns": columns("gyr"),
            "noise_deg_per_s": 1e-6,
            "largest_rate_deg_per_s": 90.0,
            "earth_rate": "removed",
        },
        "timing": {"same_within_s": 0.0045},
        "directions": list(directions),
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
    }
    return Configuration.model_validate(given | tables)


def star(name, reference, **keys):
    own = {"time_column": "own", "time_unit": "s", "columns": columns(name), "reference": reference}
    return {"name": name, "bound_deg": 0.01} | own | keys


def test_directions_of_a_body_that_turns(tmp_path):
    """The turn between each sample and its row is in the bound, and no more than that."""
    then = attitudes_at(TIMES + LATE).inv()
    references = np.eye(3)[1:]
    shown = {name: then.apply(one) for name, one in zip("ab", references, strict=True)}
    np.savez(tmp_path / "log.npz", t=TIMES, own=TIMES + LATE, gyr=np.tile([RATE, 0.0, 0.0], (COUNT, 1)), **shown)
    stated = configuration(*(star(name, one.tolist()) for name, one in zip("ab", references, strict=True)))
    log = read_log(tmp_path / "log.npz", stated)
    rows = direction_rows(log, stated)
    turned = RATE * LATE[: len(log.times)]
    np.testing.assert_allclose(rows.angles[:-1, 0], np.deg2rad(0.01) + turned[:-1], rtol=1e-3)
    results = estimation.estimate(log, stated)
    true = attitudes_at(log.times)
    errors = (Rotation.from_matrix(results.result.attitudes).inv() * true).magnitude()
    largest = results.result.largest_angles
    assert np.isfinite(largest).all()
    assert (errors <= largest + 1e-9).all()


def test_an_accelerometer_that_is_shaken(tmp_path):
    frequency, acceleration = 10.0 * np.pi, 20.0
    late = 0.004 * (np.cos(frequency * TIMES) > 0.0)
    forces = np.tile([0.0, 0.0, 9.80665], (COUNT, 1))
    forces[:, 0] = acceleration * np.sin(frequency * (TIMES + late))
    np.savez(tmp_path / "log.npz", t=TIMES, own=TIMES + late, gyr=np.zeros((COUNT, 3)), acc=forces)
    window = {"kind": "velocity_window", "velocity_m_per_s": acceleration / frequency, "windows_s": [1.0, 2.0, 4.0]}
    up = {
        "name": "up", "kind": "accelerometer", "columns": columns("acc"), "unit": "m/s^2",
        "time_column": "own", "time_unit": "s", "bound_from": window, "sensor_error": {"error_m_per_s2": 0.1},
    }  # fmt: skip
    stated = configuration(up)
    rows = direction_rows(read_log(tmp_path / "log.npz", stated), stated)
    bounded = np.isfinite(rows.angles[:, 0])
    assert bounded.sum() > 0.9 * COUNT
    true = np.tile([0.0, 0.0, 1.0], (len(rows.angles), 1))
    assert (angle_between(rows.directions[:, 0], true) <= rows.angles[:, 0])[bounded].all()


def turning(tmp_path, true_at, **truth):
    """Two star trackers that are right, at the stamps of a gyro; and an attitude to compare with at others."""
    then = attitudes_at(TIMES).inv()
    references = np.eye(3)[1:]
    shown = {name: then.apply(one) for name, one in zip("ab", references, strict=True)}
    true = attitudes_at(true_at).as_quat(scalar_first=True)
    own, rates = TIMES + LATE, np.tile([RATE, 0.0, 0.0], (COUNT, 1))
    np.savez(tmp_path / "log.npz", t=TIMES, own=own, gyr=rates, true=true, bias=np.zeros((COUNT, 3)), **shown)
    stars = [
        {"name": name, "bound_deg": 0.01, "columns": columns(name), "reference": one.tolist()}
        for name, one in zip("ab", references, strict=True)
    ]
    stated = configuration(
        *stars,
        flow={
            "kind": "gyro", "columns": columns("gyr"), "noise_deg_per_s": 1e-6, "largest_rate_deg_per_s": 90.0,
            "bias_deg_per_s": 0.01, "estimate_bias": True, "earth_rate": "removed",
        },
        truth={"attitude_columns": [f"true[{i}]" for i in range(4)], "vector_columns": columns("bias")} | truth,
    )  # fmt: skip
    return estimation.estimate(read_log(tmp_path / "log.npz", stated), stated)


def test_a_truth_of_other_times_is_compared_as_such(tmp_path):
    """It is right, and the body turns by up to 0.34 degrees from a row to it."""
    found = turning(tmp_path, TIMES + LATE, time_column="own", time_unit="s")
    errors = np.linalg.norm(found.result.errors[:, :3], axis=1)
    assert np.nanmax(errors) > np.deg2rad(0.3)
    assert np.nanmax(found.result.forms) <= 1.0
    assert not found.vector_is_compared
    wrong = turning(tmp_path, TIMES + LATE + 0.003, time_column="own", time_unit="s")
    assert np.nanmax(wrong.result.forms) > 1.0
    assert turning(tmp_path, TIMES).vector_is_compared


def test_a_truth_whose_stamps_may_be_off(tmp_path):
    assert np.nanmax(turning(tmp_path, TIMES + LATE, time_offset_bound_s=0.004).result.forms) <= 1.0
    assert np.nanmax(turning(tmp_path, TIMES + LATE, time_offset_bound_s=0.002).result.forms) > 1.0


def test_a_rate_of_a_body_is_of_its_own_time(tmp_path):
    """Torques may turn it between its stamp and the row."""
    then = attitudes_at(TIMES).inv()
    shown = {name: then.apply(one) for name, one in zip("ab", np.eye(3)[1:], strict=True)}
    rates = np.tile([RATE, 0.0, 0.0], (COUNT, 1))
    np.savez(tmp_path / "log.npz", t=TIMES, own=TIMES + LATE + 0.001, rate=rates, **shown)
    stars = [
        {"name": name, "bound_deg": 0.01, "columns": columns(name), "reference": one.tolist()}
        for name, one in zip("ab", np.eye(3)[1:], strict=True)
    ]
    rate = {"columns": columns("rate"), "bound_deg_per_s": 0.1, "time_column": "own", "time_unit": "s"}
    body = {"kind": "rigid_body", "inertia_kg_m2": [1.0, 1.0, 1.0], "step_s": 0.01, "largest_rate_deg_per_s": 90.0}
    stated = configuration(*stars, flow=body, rate=rate, reference_frame="J2000")
    with pytest.raises(ValueError, match=r"rate: timing.same_within_s moves its stamps by up to 0\.00[45]"):
        estimation.estimate(read_log(tmp_path / "log.npz", stated), stated)
    stated = configuration(*stars, flow=body, rate=rate, reference_frame="J2000", timing={})
    assert np.isfinite(estimation.estimate(read_log(tmp_path / "log.npz", stated), stated).result.largest_angles).all()


@pytest.mark.parametrize("mode", ["first_order", "paper"])
def test_a_truth_beside_its_rows_is_refused_where_nothing_bounds_the_turn(tmp_path, mode):
    """A body that turns by 86 degrees a second is 0.3 degrees away in 4 ms, which is no error of the estimate."""
    then = attitudes_at(TIMES + LATE)
    shown = {name: attitudes_at(TIMES).inv().apply(one) for name, one in zip("ab", np.eye(3)[1:], strict=True)}
    arrays = {"t": TIMES, "own": TIMES + LATE, "gyr": np.tile([RATE, 0.0, 0.0], (COUNT, 1)), **shown}
    np.savez(tmp_path / "log.npz", q=then.as_quat(scalar_first=True), **arrays)
    stars = [
        star(name, one.tolist(), bound_deg=0.5, time_column="t") for name, one in zip("ab", np.eye(3)[1:], strict=True)
    ]
    truth = {"attitude_columns": [f"q[{i}]" for i in range(4)], "time_column": "own", "time_unit": "s"}
    start = {"kind": "first_measurement", "bias_bound_deg_per_s": 0.1}
    tables = {"truth": truth, "start": start, "estimator": {"mode": mode}}
    stated = configuration(*stars, **tables)
    with pytest.raises(ValueError, match=r"truth: timing.same_within_s moves its stamps by up to 0\.00.*guaranteed"):
        estimation.estimate(read_log(tmp_path / "log.npz", stated), stated)
    # With a row for each stamp of the truth the estimates are compared where they are.
    stated = configuration(*stars, timing={}, **tables)
    result = estimation.estimate(read_log(tmp_path / "log.npz", stated), stated).result
    assert np.isfinite(result.forms).sum() > 500
    assert np.nanmax(np.linalg.norm(result.errors[:, :3], axis=1)) < np.deg2rad(0.1)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_converted_logs_keep_own_stamps(tmp_path, suffix):
    """A table of measurements says when each sensor measured, so that an estimate from it is the same."""
    then, count = attitudes_at(TIMES + LATE).inv(), 200
    shown = {name: then.apply(one)[:count] for name, one in zip("ab", np.eye(3)[1:], strict=True)}
    shown["b"][::3] = np.nan
    rates = np.tile([RATE, 0.0, 0.0], (count, 1))
    np.savez(tmp_path / "log.npz", t=TIMES[:count], own=(TIMES + LATE)[:count], gyr=rates, **shown)
    stated = configuration(*(star(name, one.tolist()) for name, one in zip("ab", np.eye(3)[1:], strict=True)))
    stated = stated.model_copy(update={"timing": stated.timing.model_copy(update={"not_a_number": "missing"})})
    table = tmp_path / f"table{suffix}"
    convert_measurements(tmp_path / "log.npz", table, stated)
    again = configuration(
        *(
            star(name, one.tolist(), columns=measured(name), time_column=own_stamps(name))
            for name, one in zip("ab", np.eye(3)[1:], strict=True)
        ),
        time_column="time_s",
        flow=stated.flow.model_dump(exclude_unset=True) | {"columns": MEASURED_RATE},
    )
    logs = read_log(tmp_path / "log.npz", stated), read_log(table, again)
    np.testing.assert_array_equal(*(log.times for log in logs))
    np.testing.assert_allclose(*(log.offsets for log in logs), atol=1e-12)
    assert np.abs(logs[1].offsets).max() > 0.003
    angles = [
        estimation.estimate(log, one).result.largest_angles for log, one in zip(logs, (stated, again), strict=True)
    ]
    np.testing.assert_allclose(*angles, rtol=1e-9)
