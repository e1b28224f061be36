"""Signs that are stated wrongly: what the angle between two vectors can differ by, and what is said of it; (18.18)."""

import dataclasses
import itertools

import datasets
import numpy as np
import pytest
from elliptude import logs
from elliptude.bounds.gyro import GyroBounds
from elliptude.configuration import Configuration
from elliptude.configuration.findings.axes import axes_in_words
from elliptude.logs.axes import sensor_axes
from elliptude.logs.axes.axes_check import look_at_axes
from elliptude.logs.axes.sensor_axes import VectorStatement
from scipy.spatial.transform import Rotation
from test_axes import EXACT, G, X, broad_configuration, motion, turned

AT_REST = np.array([0.0, 0.0, G]), np.array([0.0, 20.0, -40.0])
ANGLE = float(np.arccos(-2.0 / np.sqrt(5.0)))


@pytest.mark.parametrize("seed", range(8))
def test_the_right_sign_is_within_what_is_stated(seed):
    """All errors at once, each up to its bound: (18.18), no quotient above 1, and the opposite far above."""
    rng = np.random.default_rng(2000 + seed)
    times, rates, attitudes = motion(seed, speed=rng.uniform(0.0, 2.0))
    unit = rng.standard_normal((6, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    shown = rates + 0.02 * unit[0] + 0.01 * rates @ np.linalg.qr(rng.standard_normal((3, 3)))[0]
    gyro = GyroBounds(0.0, bias=0.02, scale_error=0.01 / 0.99)
    late, pulse = 0.005, rng.uniform(0.3, 5.0)
    acceleration = -(pulse**2) * 0.3 * np.sin(pulse * times)[:, None] * unit[1]
    force = (attitudes * Rotation.from_rotvec(late * rates)).inv().apply(AT_REST[0] + acceleration) + 0.2 * unit[2]
    field = attitudes.inv().apply(AT_REST[1] + 5.0 * unit[3]) + 1.0 * unit[4]
    up = VectorStatement(lambda h: min(4.0 * 0.3 / h**2, 0.3 * pulse**2), 0.2, 0.22, 0.0, late)
    disturbed = VectorStatement(lambda _: 5.0, 1.0, 1.02, 0.0, 0.0)
    found = sensor_axes.angle_misfit(times, shown, (force, up), (field, disturbed), gyro, ANGLE, 0.0)
    assert found.as_stated <= 1.0
    assert found.opposite > 2.0
    field[::3] = np.nan  # stamps of its own, and less often
    force[: len(force) // 5] = np.nan
    less = sensor_axes.angle_misfit(times, shown, (force, up), (field, disturbed), gyro, ANGLE, 0.0)
    assert less.as_stated <= 1.0
    assert less.opposite > 2.0
    turned = sensor_axes.angle_misfit(times, shown, (force, up), (-field, disturbed), gyro, ANGLE, 0.0)
    assert turned.as_stated == pytest.approx(less.opposite)
    assert turned.opposite == pytest.approx(less.as_stated)


@pytest.mark.parametrize("name", ["offset", "error", "sensor scale", "reference", "late"])
def test_each_bound_of_the_angle_is_attained(name):
    """One source of error alone, as large as its bound and across the vector in the plane of both."""
    times = np.arange(0.0, 12.0, 0.01)
    still = np.zeros((len(times), 3))
    up, field = np.tile(AT_REST[0], (len(times), 1)), np.tile(AT_REST[1], (len(times), 1))
    field_statement, angle_error, least = EXACT, 0.0, 0.99
    across = np.array([0.0, 40.0, 20.0])  # perpendicular to the field, and as long
    if name in {"offset", "error"}:
        field = field + np.tan(0.2) * across
        size = np.tan(0.2) * np.linalg.norm(across)
        change = {"offset": lambda _: size} if name == "offset" else {"averaged_error": size}
        field_statement = dataclasses.replace(EXACT, **change)
    elif name == "sensor scale":  # (I + K) x with K of norm k turns x by asin(k), and shortens it
        k = np.sin(0.2)
        field = np.tile(AT_REST[1] + k * (np.cos(0.2) * across - np.sin(0.2) * AT_REST[1]), (len(times), 1))
        field_statement, least = dataclasses.replace(EXACT, scale_error=k), 0.75  # k / (1 - k) for k
    elif name == "reference":
        turn = Rotation.from_rotvec([0.1, 0.0, 0.0])
        field, angle_error = turn.apply(field), 0.1
    else:
        field = Rotation.from_rotvec([0.1, 0.0, 0.0]).apply(field)
        rates = still + 5.0 * X
        back = turned(times, rates).inv()
        up, field, still = back.apply(up), back.apply(field), rates
        field_statement = dataclasses.replace(EXACT, time_offset=0.02)
        least = 0.9
    found = sensor_axes.angle_misfit(
        times, still, (up, EXACT), (field, field_statement), GyroBounds(0.0), ANGLE, angle_error
    )
    assert least <= found.as_stated <= 1.0 + 1e-9


def test_a_mean_whose_ball_holds_the_origin_may_point_anywhere():
    """Two vectors along one axis, and a disturbance that turns one of them round: π off, and no less is allowed."""
    times = np.arange(0.0, 6.0, 0.01)
    up = np.tile([0.0, 0.0, G], (len(times), 1))
    disturbed = dataclasses.replace(EXACT, offset=lambda _: 1.2 * G)
    found = sensor_axes.angle_misfit(
        times, np.zeros_like(up), (up, EXACT), (-0.1 * up, disturbed), GyroBounds(0.0), 0.0, 0.0
    )
    assert found.as_stated == pytest.approx(1.0)


def test_a_frame_that_turns_within_a_window():
    """The gyro shows a turn that is none: what is across its axis becomes shorter in the mean, what is along it not."""
    times = np.arange(0.0, 30.0, 0.01)
    up, field = np.tile([G, 0.0, 0.0], (len(times), 1)), np.tile([30.0, 30.0, 0.0], (len(times), 1))
    rates = np.tile([0.2, 0.0, 0.0], (len(times), 1))
    found = sensor_axes.angle_misfit(
        times, rates, (up, EXACT), (field, EXACT), GyroBounds(0.0, bias=0.2), 0.25 * np.pi, 0.0
    )
    assert 0.05 < found.as_stated <= 1.0


def test_windows_begin_where_both_sensors_do():
    """An acceleration that is nothing in the mean over a whole window, and is something over a part of one."""
    times = np.arange(0.0, 30.0, 0.01)
    up, field = np.tile(AT_REST[0], (len(times), 1)), np.tile(AT_REST[1], (len(times), 1))
    up[:, 1] += 2.0 * np.sin(4.0 * np.pi * times)
    up[times < 0.3] = np.nan
    statement = dataclasses.replace(EXACT, averaged_error=0.05)
    found = sensor_axes.angle_misfit(
        times, np.zeros_like(up), (up, statement), (field, EXACT), GyroBounds(0.0), ANGLE, 1e-9
    )
    assert found.as_stated <= 1.0


@datasets.needs_datasets
@pytest.mark.parametrize("trial", ["02", "05", "07", "24", "30"])
def test_signs_of_a_hand_held_sensor(trial):
    """Berlin's field as the stated reference: refused is what has one sign turned, not what has none or both."""
    fields = broad_configuration().model_dump(mode="json", exclude_unset=True)
    del fields["rule"], fields["estimator"]
    fields |= {"reference_frame": "ENU", "start": {"kind": "first_measurement", "bias_bound_deg_per_s": 0.5}}
    fields["flow"] |= {"noise_deg_per_s": 1.0}
    fields["directions"][0]["bound_deg"] = 5.0
    fields["directions"][1] |= {"bound_deg": 10.0, "reference_ut": [0.0, 18.6, -46.0]}
    configuration = Configuration.model_validate(fields)
    log = logs.read_log(datasets.broad(trial), configuration)
    for up, field in itertools.product((1.0, -1.0), repeat=2):
        signed = dataclasses.replace(log, directions=log.directions * np.array([up, field])[:, None])
        wrong = look_at_axes(signed, configuration).wrong
        if up * field > 0.0:
            assert wrong == ()
        else:
            assert [one.sensor for one in wrong] == ["field"]
            said = axes_in_words(-np.eye(3), configuration.directions[1].columns)
            assert f"at_rest = 'down' for 'up', {said} for 'field'" in wrong[0].message
    # At the magnetic equator both signs fit.
    level = dict(fields, directions=[fields["directions"][0], fields["directions"][1] | {"reference_ut": [0, 40, 0]}])
    level = Configuration.model_validate(level)
    log = dataclasses.replace(log, references=np.tile([[0.0, 0.0, G], [0.0, 4e-5, 0.0]], (len(log.times), 1, 1)))
    assert look_at_axes(log, level).wrong == ()
