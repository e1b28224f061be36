"""Axes that are stated wrongly: what a right choice can differ by, which choice fits, and what is said."""

import dataclasses
import itertools
import tomllib

import datasets
import numpy as np
import pytest
from elliptude import logs
from elliptude.bounds.gyro import GyroBounds
from elliptude.configuration import Configuration
from elliptude.configuration.findings.axes import axes_in_words
from elliptude.configuration.sensors import rotation_of_axes
from elliptude.logs import Log
from elliptude.logs.axes import sensor_axes
from elliptude.logs.axes.axes_check import look_at_axes
from elliptude.logs.axes.sensor_axes import ROTATIONS, VectorStatement, misfits
from scipy.spatial.transform import Rotation

G = 9.81
X = np.array([1.0, 0.0, 0.0])
EVERY = [
    np.array(signs)[:, None] * np.eye(3)[list(order)]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
]
WRONG = [matrix for matrix in EVERY if abs(np.trace(matrix)) < 3.0]
EXACT = VectorStatement(lambda _: 0.0, 0.0, 0.0, 0.0, 0.0)


def turned(times, rates):
    """Attitudes, the rate constant in a step."""
    steps = Rotation.from_rotvec(np.diff(times)[:, None] * 0.5 * (rates[1:] + rates[:-1]))
    attitudes = [Rotation.identity()]
    for step in steps:
        attitudes.append(attitudes[-1] * step)
    return Rotation.concatenate(attitudes)


def motion(seed, duration=40.0, step=0.02, speed=1.0):
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, duration, step)
    rates = np.zeros((len(times), 3))
    for axis, k in itertools.product(range(3), range(1, 4)):
        rates[:, axis] += speed * np.sin(2.0 * np.pi * rng.uniform(0.03, 0.2) * k * times + rng.uniform(0.0, 6.0)) / k
    return times, rates, turned(times, rates)


# --- what a right choice can differ by --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(12))
def test_the_right_axes_are_within_what_is_stated(seed):
    """All errors at once, at random and each up to its bound: section 18.7, no quotient above 1."""
    rng = np.random.default_rng(1000 + seed)
    times, rates, attitudes = motion(seed, speed=rng.uniform(0.2, 3.0))
    unit = rng.standard_normal((8, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    noise, bias, scale = np.deg2rad(1.0), np.deg2rad(0.25), 0.02
    matrix = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    shown = rates + scale * rates @ matrix + bias * unit[0]
    shown += noise * np.sin(rng.uniform(0.1, 5.0) * times)[:, None] * unit[1]
    # A place within 0.6 m, no faster than 3 m/s; its acceleration.
    pulse = min(rng.uniform(0.3, 5.0), 5.0)
    place = 0.6 * np.sin(pulse * times)[:, None] * unit[2]
    acceleration = -(pulse**2) * place
    error, late = 0.2, 0.005
    force = (attitudes * Rotation.from_rotvec(late * rates)).inv().apply(np.array([0.0, 0.0, G]) + acceleration)
    force = force + 0.01 * force @ np.linalg.qr(rng.standard_normal((3, 3)))[0] + error * unit[3]
    statement = VectorStatement(
        # |p| <= 0.6 in a ball: 4 p / h^2; and from the speed, 4 v / 2h.
        offset=lambda h: min(4.0 * 0.6 / h**2, 2.0 * 3.0 / h),
        error=error,
        averaged_error=error + 0.02,
        scale_error=0.01,
        time_offset=late,
        length=G,
    )
    gyro = GyroBounds(noise, bias, 0.0, scale / (1.0 - scale))
    quotients = misfits(times, shown, force, gyro, statement)
    assert quotients[0] <= 1.0
    assert quotients[0] < 0.5 * quotients[1:].max()


def alone(name):
    """One source of error as large as its bound, all others nothing: rates, vectors, gyro, statement."""
    times = np.arange(0.0, 12.0, 0.01)
    still, vector = np.zeros((len(times), 3)), np.tile([0.0, 0.0, G], (len(times), 1))
    exact = GyroBounds(0.0)
    half_turn = np.where((times > 5.5) & (times < 6.5), np.pi, 0.0)[:, None] * X
    turn = turned(times, half_turn)
    if name == "bias":
        return times, still + 0.1 * X, vector, GyroBounds(0.0, bias=0.1), EXACT
    if name == "noise":
        return times, still + 0.1 * X, vector, GyroBounds(0.1), EXACT
    if name == "scale":
        rates = still + 0.4 * X
        return times, rates * 0.9, turned(times, rates).inv().apply(vector), GyroBounds(0.0, scale_error=0.1), EXACT
    if name == "error":
        shown = turn.inv().apply(vector) + np.array([0.0, 0.0, 0.3])
        return times, half_turn, shown, exact, dataclasses.replace(EXACT, averaged_error=0.3)
    if name == "sensor scale":
        shown = turn.inv().apply(vector) @ np.diag([1.0, 1.0, 1.03])
        shown[times > 6.0, 2] *= 0.97 / 1.03
        return times, half_turn, shown, exact, dataclasses.replace(EXACT, scale_error=0.03)
    if name == "offset":
        pushed = vector + np.where(times > 6.0, 1.0, -1.0)[:, None] * [0.5, 0.0, 0.0]
        return times, still, pushed, exact, dataclasses.replace(EXACT, offset=lambda _: 0.5)
    if name == "late":
        rates = np.where(times > 6.0, 1.0, -1.0)[:, None] * X
        late = turned(times, rates) * Rotation.from_rotvec(0.02 * rates)
        return times, rates, late.inv().apply(vector), exact, dataclasses.replace(EXACT, time_offset=0.02)
    assert name == "length"
    shown = vector * (1.0 + np.where(times > 6.0, 0.0, 0.02))[:, None]
    statement = dataclasses.replace(EXACT, length=G, length_error=0.02 * G, averaged_error=0.01 * G)
    return times, still, shown, exact, statement


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("bias", 0.9), ("noise", 0.9), ("scale", 0.9), ("error", 0.95), ("sensor scale", 0.9),
        ("offset", 0.95), ("late", 0.9), ("length", 0.6),
    ],
)  # fmt: skip
def test_each_bound_is_attained(name, least):
    """Halved or left out, the term would not cover what the source of error does."""
    times, rates, vectors, gyro, statement = alone(name)
    assert least <= misfits(times, rates, vectors, gyro, statement)[0] <= 1.0 + 1e-9


def test_nothing_is_known_over_a_gap():
    """Whatever the body did in it."""
    times, rates, attitudes = motion(3)
    vectors = attitudes.inv().apply([0.0, 0.0, G])
    kept = (times < 15.0) | (times > 19.3)
    quotients = misfits(
        times[kept], rates[kept], vectors[kept], GyroBounds(0.001), dataclasses.replace(EXACT, averaged_error=0.05)
    )
    assert quotients[0] <= 1.0
    assert quotients[1:].min() > 1.0


def test_a_stamp_far_ahead_costs_nothing():
    """Cells are as many as there are rows, not as there are seconds."""
    times, rates, attitudes = motion(3)
    vectors = attitudes.inv().apply([0.0, 0.0, G])
    statement = dataclasses.replace(EXACT, averaged_error=0.05)
    late = np.where(times < 15.0, times, times + 1e9)
    quotients = misfits(late, rates, vectors, GyroBounds(0.001), statement)
    assert quotients[0] <= 1.0
    assert quotients[1:].min() > 1.0


def test_a_slow_sensor_and_missing_rows():
    times, rates, attitudes = motion(4)
    vectors = attitudes.inv().apply([0.0, 20.0, -40.0])
    vectors[np.arange(len(times)) % 25 > 0] = np.nan
    statement = dataclasses.replace(EXACT, averaged_error=6.0)
    quotients = misfits(times, rates, vectors, GyroBounds(0.001), statement)
    assert quotients[0] <= 1.0
    assert quotients[1:].min() > 1.0
    vectors[1:] = np.nan
    assert misfits(times, rates, vectors, GyroBounds(0.001), statement) is None


# --- which choice fits ------------------------------------------------------------------------------------------------


def tables():
    return {
        "reference_frame": "ENU",
        "flow": {"kind": "gyro", "columns": ["wx", "wy", "wz"], "noise_deg_per_s": 1.0},
        "directions": [
            {
                "name": "up",
                "kind": "accelerometer",
                "columns": ["ax", "ay", "az"],
                "unit": "m/s^2",
                "bound_deg": 5.0,
            },
            {
                "name": "field",
                "kind": "magnetometer",
                "columns": ["mx", "my", "mz"],
                "unit": "uT",
                "reference_ut": [0.0, 20.0, -40.0],
                "bound_deg": 8.0,
            },
        ],
        "start": {"kind": "first_measurement", "bias_bound_deg_per_s": 0.1},
    }


def configuration(**changes):
    return Configuration.model_validate(tables() | changes)


def references(directions):
    """What `tables` states."""
    return np.tile([[0.0, 0.0, G], [0.0, 2e-5, -4e-5]], (len(directions), 1, 1))[:, : directions.shape[1]]


def recorded(seed=0, sensors=2, speed=1.0):
    times, rates, attitudes = motion(seed, duration=60.0, speed=speed)
    rng = np.random.default_rng(seed)
    up = attitudes.inv().apply([0.0, 0.0, G]) + 0.1 * rng.standard_normal((len(times), 3))
    field = attitudes.inv().apply([0.0, 2e-5, -4e-5]) + 5e-7 * rng.standard_normal((len(times), 3))
    directions = np.stack([up, field], axis=1)[:, :sensors]
    return Log(times, directions, references(directions), rates)


def with_axes(log, matrix, *, sensor=None, gyro=False):
    directions = log.directions.copy()
    if sensor is not None:
        directions[:, sensor] = directions[:, sensor] @ matrix.T
    return dataclasses.replace(log, directions=directions, rates=log.rates @ matrix.T if gyro else log.rates)


def undone(fitting, matrix):
    """Whether the axes that fit take the vectors back."""
    return np.array_equal(np.round(fitting @ matrix), np.eye(3))


def test_the_rotations_are_half_of_all_signed_permutations():
    assert len(ROTATIONS) == 24
    assert np.array_equal(ROTATIONS[0], np.eye(3))
    signed = {tuple(sign * matrix.ravel()) for matrix in ROTATIONS for sign in (1.0, -1.0)}
    assert signed == {tuple(matrix.ravel()) for matrix in EVERY}


@pytest.mark.parametrize(("sensor", "name"), [(0, "up"), (1, "field")])
def test_wrong_axes_of_a_vector(sensor, name):
    log = recorded()
    assert look_at_axes(log, configuration()).wrong == ()
    assert look_at_axes(log, configuration()).is_told
    for matrix in EVERY:
        verdict = look_at_axes(with_axes(log, matrix, sensor=sensor), configuration())
        if np.trace(matrix) == 3.0:
            assert verdict.wrong == ()
            continue
        (wrong,) = verdict.wrong
        if np.trace(matrix) == -3.0:  # turns alike, but is not as far from the other vector
            assert wrong.sensor == "field"
            assert "at_rest = 'down' for 'up'" in wrong.message
            continue
        assert wrong.sensor == name
        ((quotient, axes),) = wrong.fitting
        assert quotient <= 1.0 < wrong.quotient
        assert undone(axes, matrix) or undone(-axes, matrix)


def test_wrong_axes_of_the_gyro():
    log = recorded()
    for matrix in EVERY[1:]:
        (wrong,) = look_at_axes(with_axes(log, matrix, gyro=True), configuration()).wrong
        assert wrong.sensor == "the gyro"
        ((_, axes),) = wrong.fitting
        assert undone(axes, matrix)


def test_a_gyro_and_one_vector():
    """Which of both is wrong cannot be told, unless the turn is mirrored."""
    one = configuration().model_copy(update={"directions": configuration().directions[:1]})
    log = recorded(sensors=1)
    for matrix in EVERY[1::5]:
        (wrong,) = look_at_axes(with_axes(log, matrix, gyro=True), one).wrong
        if np.linalg.det(matrix) < 0.0:
            assert wrong.sensor == "the gyro"
            assert undone(wrong.fitting[0][1], matrix)
        else:
            assert wrong.sensor == "up"
            assert f"those of the gyro are wrong, and {axes_in_words(matrix.T, ('wx', 'wy', 'wz'))}" in wrong.message


def test_two_sensors_with_wrong_axes_of_their_own():
    log = with_axes(with_axes(recorded(), EVERY[9], sensor=0), EVERY[20], sensor=1)
    first, second = look_at_axes(log, configuration()).wrong
    assert (first.sensor, second.sensor) == ("up", "field")
    assert any(undone(sign * first.fitting[0][1], EVERY[9]) for sign in (1, -1))
    assert any(undone(sign * second.fitting[0][1], EVERY[20]) for sign in (1, -1))


def test_stated_axes_are_composed_with():
    """What is named is what the configuration must say, not what must be done beside it."""
    stated = ("y", "-x", "z")
    directions = tables()["directions"]
    directions[0]["axes"] = stated
    log = with_axes(recorded(), rotation_of_axes(stated), sensor=0)  # and the sensor's axes are the body's
    (wrong,) = look_at_axes(log, configuration(directions=directions)).wrong
    assert np.array_equal(wrong.fitting[0][1], np.eye(3))
    assert 'axes = ["x", "y", "z"]' in wrong.message


# --- where nothing is sure --------------------------------------------------------------------------------------------


def test_a_log_that_does_not_turn():
    """A gyro that is not calibrated shows a turn that is none."""
    times = np.arange(0.0, 60.0, 0.02)
    rng = np.random.default_rng(0)
    up = np.array([0.0, 0.0, G]) + 0.05 * rng.standard_normal((len(times), 3))
    field = np.array([0.0, 2e-5, -4e-5]) + 5e-7 * rng.standard_normal((len(times), 3))
    directions = np.stack([up, field], axis=1)
    rates = np.deg2rad([3.0, 2.0, -1.0]) + 1e-3 * rng.standard_normal((len(times), 3))
    for jerk in (0.0, 0.8):  # too much for a rest to be seen
        forces = directions.copy()
        forces[:, 0] += jerk * np.sin(60.0 * times)[:, None] * [0.6, 0.0, 0.8]
        verdict = look_at_axes(Log(times, forces, references(directions), rates), configuration())
        assert verdict.wrong == ()
        assert not verdict.is_told


def test_a_pendulum():
    """Gravity and motion together point along the rod, which does not turn in the body: no quarter turn explains it."""
    times = np.arange(0.0, 60.0, 0.01)
    angle = 0.5 * np.sin(np.sqrt(G / 1.0) * times)
    rates = np.gradient(angle, times)[:, None] * X
    along = G * np.cos(angle) + np.gradient(angle, times) ** 2
    directions = np.zeros((len(times), 1, 3))
    directions[:, 0, 2] = along
    one = configuration().model_copy(update={"directions": configuration().directions[:1]})
    assert look_at_axes(Log(times, directions, references(directions), rates), one).wrong == ()


@pytest.mark.parametrize("hard_iron", [30e-6, 60e-6, 300e-6])
def test_a_magnetometer_that_is_not_calibrated(hard_iron):
    log = recorded(5)
    log.directions[:, 1] += hard_iron * np.array([0.6, 0.0, 0.8])
    assert look_at_axes(log, configuration()).wrong == ()


def test_a_wrong_unit_is_no_wrong_axis():
    for factor in (np.deg2rad(1.0), np.rad2deg(1.0)):
        log = recorded(6)
        log = dataclasses.replace(log, rates=factor * log.rates)
        assert look_at_axes(log, configuration()).wrong == ()
    log = recorded(6)
    log.directions[:, 0] /= G
    assert look_at_axes(log, configuration()).wrong == ()


# --- what is said -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("matrix", EVERY)
def test_axes_in_words_are_what_a_configuration_takes(matrix):
    """Any of the 48, left-handed ones by the order of columns."""
    said = tomllib.loads(axes_in_words(matrix, ("a", "b", "c")).replace("], axes", "]\naxes"))
    columns = said.get("columns", ["a", "b", "c"])
    directions = tables()["directions"]
    directions[0] |= {"columns": columns, "axes": said["axes"]}
    sensor = configuration(directions=directions).directions[0]
    vector = {"a": 1.0, "b": 2.0, "c": 4.0}
    shown = rotation_of_axes(sensor.axes) @ [vector[name] for name in sensor.columns]
    np.testing.assert_array_equal(shown, matrix @ [1.0, 2.0, 4.0])


# --- recordings -------------------------------------------------------------------------------------------------------


def broad_configuration():
    def columns(name):
        return [f"{name}[{i}]" for i in range(3)]

    return Configuration.model_validate(
        {
            "time_column": "t",
            "rule": {"kind": "hand_held"},
            "flow": {"kind": "gyro", "columns": columns("gyr")},
            "directions": [
                {"name": "up", "kind": "accelerometer", "columns": columns("acc"), "unit": "m/s^2"},
                {"name": "field", "kind": "magnetometer", "columns": columns("mag"), "unit": "uT"},
            ],
            "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
        }
    )


@datasets.needs_datasets
@pytest.mark.parametrize("trial", ["02", "05", "07", "24", "30"])
def test_a_hand_held_sensor(trial):
    """As it is, and with some of its axes wrong; benchmarks/wrong_axes.py counts all."""
    log = logs.read_log(datasets.broad(trial), broad_configuration())
    assert look_at_axes(log, broad_configuration()).wrong == ()
    for sensor, name in enumerate(("up", "field")):
        for matrix in WRONG[3 * sensor :: 11]:
            for wrong in look_at_axes(with_axes(log, matrix, sensor=sensor), broad_configuration()).wrong:
                assert (wrong.sensor, wrong.is_sure) == (name, True)
                axes = wrong.fitting[0][1]
                assert undone(axes, matrix) or undone(-axes, matrix)


def test_all_that_is_compared_is_bounded():
    """The tables of windows, distances and cells are what the documentation says."""
    assert sensor_axes._CELL_S * max(sensor_axes._HALF_LENGTHS) == 6.0
    assert min(sensor_axes._DISTANCES) == 2


def test_a_matrix_of_axes_with_few_digits_is_brought_to_the_nearest_rotation():
    angle = np.deg2rad(30.0)
    exact = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    written = tuple(tuple(row) for row in np.round(exact, 4) * (1.0 + 4e-5))
    found = rotation_of_axes(written)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=4e-16)
    np.testing.assert_allclose(found, exact, atol=5e-5)
