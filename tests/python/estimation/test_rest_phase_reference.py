"""A magnetometer's reference by a phase of rest: how far it may be off by the errors of the sensors that showed it."""

import numpy as np
import pytest
from elliptude import estimation
from elliptude.bounds.rest import mean_at_rest
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.configuration import Configuration
from elliptude.estimation.direction_rows import direction_rows
from elliptude.logs import log as logs
from elliptude.logs.rest_phase import reference_error
from scipy.spatial.transform import Rotation

G = 9.80665
FIELD = np.array([0.0, 18.0, -45.0])
STRENGTH = float(np.linalg.norm(FIELD))
OFF, OFF_UT = 0.2, 1.0
PHYSICAL = (
    {
        "bound_from": {"kind": "acceleration", "acceleration_m_per_s2": 0.0},
        "sensor_error": {"error_m_per_s2": OFF},
    },
    {"bound_from": {"kind": "field", "disturbance_ut": 0.0}, "sensor_error": {"error_ut": OFF_UT}},
)
BY_ANGLE = (
    {"bound_deg": float(np.rad2deg(np.arcsin(OFF / G)))},
    {"bound_deg": float(np.rad2deg(np.arcsin(OFF_UT / STRENGTH)))},
)
REST = {"kind": "rest_phase", "from_s": 0.0, "to_s": 2.0, "declination_deg": 0.0}


def configured(up=PHYSICAL[0], field=PHYSICAL[1], *, rest=REST, mode="guaranteed", **others):
    start = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [0.1] * 6}
    return Configuration.model_validate(
        {
            "time_column": "t",
            "reference_frame": "ENU",
            "flow": {"kind": "gyro", "columns": [f"gyr[{i}]" for i in range(3)], "noise_deg_per_s": 0.02},
            "directions": [
                {"name": "up", "kind": "accelerometer", "columns": [f"acc[{i}]" for i in range(3)], "unit": "m/s^2"}
                | up,
                {"name": "field", "kind": "magnetometer", "columns": [f"mag[{i}]" for i in range(3)], "unit": "uT"}
                | {"reference": rest}
                | field,
            ],
            "estimator": {"mode": mode} | ({"policy": "drop_measurement"} if mode == "guaranteed" else {}),
            "truth": {"attitude_columns": [f"q[{i}]" for i in range(4)], "error_deg": 0.01},
        }
        | ({"start": start} if mode == "first_order" else {})
        | others
    )


def recorded(tmp_path, acc_off, mag_off, *, turn=(0.0, 0.0, np.pi), first=None, count=900):
    """A rest of 2.5 s, and then a turn; the sensors are off by these vectors, in body axes at the first row."""
    times = 0.01 * np.arange(count)
    share = np.clip((times - 2.5) / 3.0, 0.0, 1.0)
    angle = share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi)
    axis = np.asarray(turn)
    rates = np.where((share > 0.0) & (share < 1.0), (1.0 - np.cos(2.0 * np.pi * share)) / 3.0, 0.0)[:, None] * axis
    true = (first or Rotation.identity()) * Rotation.from_rotvec(angle[:, None] * axis)
    np.savez(
        tmp_path / "log.npz",
        t=times,
        gyr=rates,
        acc=true.inv().apply([0.0, 0.0, G]) + acc_off,
        mag=true.inv().apply(FIELD) + mag_off,
        q=true.as_quat(scalar_first=True),
    )
    return tmp_path / "log.npz"


def error_of(path, configuration):
    log = logs.read_log(path, configuration)
    return log, reference_error(configuration.directions[1], configuration, log.rests[1])


@pytest.mark.parametrize(("up", "field"), [PHYSICAL, BY_ANGLE], ids=["physical", "angles"])
@pytest.mark.parametrize("turned", ["about up", "about any axis"])
def test_sets_hold_where_the_same_offsets_make_the_reference(tmp_path, up, field, turned):
    """The offsets turn with the body, so that what they did to the reference is wrong twice after half a turn."""
    rng = np.random.default_rng(3)
    first, turn, acc_off, mag_off = None, (0.0, 0.0, np.pi), [0.0, -0.999 * OFF, 0.0], [0.999 * OFF_UT, 0.0, 0.0]
    if turned == "about any axis":
        first, (turn, acc_off, mag_off) = Rotation.random(random_state=3), rng.normal(size=(3, 3))
        turn, acc_off, mag_off = (
            length * vector / np.linalg.norm(vector)
            for length, vector in ((np.pi, turn), (0.999 * OFF, acc_off), (0.999 * OFF_UT, mag_off))
        )
    configuration = configured(up, field)
    path = recorded(tmp_path, acc_off, mag_off, turn=turn, first=first)
    estimated = estimation.estimate(logs.read_log(path, configuration), configuration)
    said = estimation.summarize(estimated, configuration)
    assert said["claim_share_of_rows"]["unconditional"] == 1.0
    assert said["inside_share_of_unconditional_rows"] == 1.0


@pytest.mark.parametrize(("up", "field"), [PHYSICAL, BY_ANGLE], ids=["physical", "angles"])
def test_the_error_is_attained_by_both_sensors_at_once(tmp_path, up, field):
    """Gravity and the field are each turned as far as they can be, in their plane, and away from one another."""

    def turned_by(vector, error, sign):
        angle = sign * np.arcsin(error / np.linalg.norm(vector))
        return np.cos(angle) * Rotation.from_rotvec([angle, 0.0, 0.0]).apply(vector) - vector

    path = recorded(tmp_path, turned_by([0.0, 0.0, G], OFF, 1.0), turned_by(FIELD, OFF_UT, -1.0))
    log, error = error_of(path, configured(up, field))
    shown = 1e6 * log.references[0, 1]
    angle = np.arccos(shown @ FIELD / np.linalg.norm(shown) / STRENGTH)
    assert 0.999 * error.angle <= angle <= error.angle * (1.0 + 1e-9)
    rows, base = direction_rows(log, configured(up, field)), direction_rows(log, configured(up, field | STATED_EXACT))
    np.testing.assert_allclose(rows.angles[:, 1] - base.angles[:, 1], error.angle, rtol=0.02)


def test_a_rest_is_as_long_as_its_stamps_leave_it(tmp_path):
    """The body speeds up from one way to the other in it; its stamps may come closer by twice their offset."""
    speed, offset = 0.5, 0.1
    acceleration = 2.0 * speed / (2.0 - 2.0 * offset)
    up = {
        "bound_from": {"kind": "velocity_window", "windows_s": [1.0], "velocity_m_per_s": speed},
        "sensor_error": {"error_m_per_s2": 1e-9},
    }
    path = recorded(tmp_path, [0.0, acceleration, 0.0], np.zeros(3))
    exact = {"bound_from": {"kind": "field", "disturbance_ut": 0.0}, "sensor_error": {"error_ut": 1e-9}}
    log, error = error_of(path, configured(up | {"time_offset_bound_s": offset}, exact))
    shown = 1e6 * log.references[0, 1]
    angle = np.arccos(shown @ FIELD / np.linalg.norm(shown) / STRENGTH)
    assert 0.99 * error.angle <= angle <= error.angle * (1.0 + 1e-9)


STATED_EXACT = {"reference_error_deg": 0.0}


def test_the_strength_is_as_wrong_as_the_sensor(tmp_path):
    """The field is shown too short; its direction is right."""
    field = {"bound_from": {"kind": "field", "disturbance_ut": 0.0}}
    field |= {"sensor_error": {"error_ut": 1.0, "scale_error": 0.1}}
    path = recorded(tmp_path, np.zeros(3), FIELD * (0.9 - 1.0 / STRENGTH - 1.0))
    log, error = error_of(path, configured(field=field))
    off = STRENGTH - 1e6 * np.linalg.norm(log.references[0, 1])
    assert 0.999 * error.strength <= off <= error.strength * (1.0 + 1e-9)
    stated = {"bound_from": {"kind": "field", "disturbance_ut": 0.0, "strength_error_ut": 0.25}}
    _, error = error_of(path, configured(field=field | stated))
    assert error.strength == 0.25


def test_what_is_stated_takes_its_place(tmp_path):
    """And is counted once."""
    path = recorded(tmp_path, np.zeros(3), np.zeros(3))
    stated = BY_ANGLE[1] | {"reference_error_deg": 3.0}
    log, error = error_of(path, configured(BY_ANGLE[0], stated))
    assert np.rad2deg(error.angle) == pytest.approx(3.0)
    rows = direction_rows(log, configured(BY_ANGLE[0], stated))
    np.testing.assert_allclose(np.rad2deg(rows.angles[:, 1]), 3.0 + BY_ANGLE[1]["bound_deg"])


def test_with_an_attitude_only_the_field_and_the_attitude_count(tmp_path):
    path = recorded(tmp_path, np.zeros(3), np.zeros(3))
    rest = {key: value for key, value in REST.items() if key != "declination_deg"}
    rest |= {"attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "attitude_error_deg": 0.5}
    _, error = error_of(path, configured({"bound_deg": 40.0}, rest=rest))
    assert error.angle == pytest.approx(np.arcsin(OFF_UT / STRENGTH) + np.deg2rad(0.5), rel=1e-9)
    aligned = PHYSICAL[1] | {"alignment_error_deg": 0.25}
    aligned |= {"sensor_error": aligned["sensor_error"] | {"misalignment_deg": 0.5}}
    _, error = error_of(path, configured(field=aligned, rest=rest))
    assert error.angle == pytest.approx(np.arcsin(OFF_UT / STRENGTH) + np.deg2rad(1.25), rel=1e-9)


def test_how_fast_the_body_moves_in_the_rest_counts(tmp_path):
    """As fast as at other times, unless it is stated of the rest."""
    path = recorded(tmp_path, np.zeros(3), np.zeros(3))
    of_field = np.arcsin(OFF_UT / STRENGTH)

    def tilt(bound, **rest):
        up = {"bound_from": bound, "sensor_error": {"error_m_per_s2": 0.0}}
        return 2.0 * G * np.sin(0.5 * (error_of(path, configured(up, rest=REST | rest))[1].angle - of_field))

    moving = {"kind": "velocity_window", "windows_s": [1.0], "velocity_m_per_s": 3.0}
    assert tilt(moving) == pytest.approx(2.0 * 3.0 / 2.0)
    assert tilt(moving, velocity_m_per_s=0.05) == pytest.approx(2.0 * 0.05 / 2.0)
    accelerating = {"kind": "acceleration", "acceleration_m_per_s2": 0.5}
    assert tilt(accelerating) == pytest.approx(0.5)
    assert tilt(accelerating, velocity_m_per_s=0.0) == pytest.approx(0.0, abs=1e-6)
    place = {"kind": "velocity_window", "windows_s": [1.0], "position_m": 1.0}
    with pytest.raises(ValueError, match=r"leaves it open .*: state reference_error_deg, .*velocity_m_per_s"):
        tilt(place)


def test_a_reference_whose_errors_nobody_stated_is_refused():
    up, field = PHYSICAL
    silent = {key: value for key, value in field.items() if key != "sensor_error"}
    both = "sensor_error.error_ut of 'field' and sensor_error.error_m_per_s2 of 'up', or else reference_error_deg and"
    with pytest.raises(ValueError, match=f"{both} bound_from.strength_error_ut"):
        configured({key: value for key, value in up.items() if key != "sensor_error"}, silent)
    with pytest.raises(ValueError, match=r"state sensor_error.error_ut of 'field', or else bound_from.strength_error"):
        configured(up, silent | {"reference_error_deg": 1.0})
    configured(up, BY_ANGLE[1], mode="first_order")
    with pytest.raises(ValueError, match="attitude_error_deg: belongs to attitude_qw_qx_qy_qz"):
        configured(rest=REST | {"attitude_error_deg": 1.0})


def test_a_rest_that_contradicts_gravity_is_refused(tmp_path):
    path = recorded(tmp_path, [0.0, 0.0, 1.0], np.zeros(3))
    configuration = configured()
    with pytest.raises(ValueError, match=r"in the rest phase 'up' shows a specific force of 10\.8"):
        direction_rows(logs.read_log(path, configuration), configuration)


def test_no_mean_reaches_across_lost_samples():
    times = np.r_[np.arange(0.0, 0.305, 0.01), np.arange(1.0, 1.605, 0.01)]
    vectors = np.where(times[:, None] < 0.5, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    sensor = VectorSensorBounds(error=0.5, averaged_error=0.1, averaged_over=0.6)
    mean, error, lasted = mean_at_rest(times, vectors, sensor, longest_step=0.015)
    np.testing.assert_allclose(mean, [0.0, 1.0, 0.0], atol=1e-12)
    assert (error, lasted) == (pytest.approx(0.1), pytest.approx(0.6))
    mean, _, lasted = mean_at_rest(times, vectors, sensor)
    assert lasted == pytest.approx(1.6)
