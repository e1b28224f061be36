"""Physical bounds against truths made at their edge: none outside, and the edge is reached."""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import (
    DirectionBounds,
    VectorSensorBounds,
    accelerometer_bounds,
    angle_excess,
    angle_to_center,
    magnetometer_bounds,
)
from elliptude.bounds.stamps import shift, time_offset_angles
from elliptude.bounds.windows import (
    MotionBounds,
    WindowBounds,
    cross_bounds,
    field_bounds_over_windows,
    gravity_bounds_over_windows,
)
from inputs import angle_between
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

G = 9.80665
UP = np.array([0.0, 0.0, 1.0])


def unit(draws, *shape):
    vectors = draws.standard_normal((*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


# --- one sample -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("alpha", [0.01, 1.0, 5.0, 9.0])
@pytest.mark.parametrize("length", [4.0, 9.0, 9.80665, 11.0, 18.0])
def test_angle_is_the_formula_of_the_law_of_cosines(alpha, length):
    angle, excess = angle_to_center(length, G, alpha)
    if abs(length - G) > alpha:
        assert np.isnan(angle)
        assert excess == pytest.approx(abs(length - G) - alpha)
    else:
        assert excess == 0.0
        assert angle == pytest.approx(np.arccos((length**2 + G**2 - alpha**2) / (2 * length * G)), abs=1e-7)


def test_small_angles_keep_their_digits():
    # arccos of the formula has no digits left here.
    angle, _ = angle_to_center(1.0, 1.0, 1e-9)
    assert angle == pytest.approx(1e-9, rel=1e-5)


@pytest.mark.parametrize("unit", [1e-300, 1e-160, 1e-5, 1e160, 1e300])
def test_the_unit_makes_no_difference(unit):
    """Squares of lengths may be too large or too small for a number where the lengths are not."""
    lengths, radii, error = np.array([0.9, 1.0, 1.1, 2.0]), np.array([0.15, 1e-5, 0.3, 1e-3]), 0.05
    angles, excess = angle_to_center(lengths, 1.0, radii, error)
    scaled, scaled_excess = angle_to_center(unit * lengths, unit, unit * radii, unit * error)
    np.testing.assert_allclose(scaled, angles, rtol=1e-9)
    np.testing.assert_allclose(scaled_excess, unit * excess, rtol=1e-9)
    assert angles[1] >= 1e-5
    # What is no number in the unit of the magnitude is no direction.
    assert angle_to_center(1e300, 1e-300, 1.0)[1] > 0.0
    assert angle_to_center(1e300, 1e-300, 2e300)[0] == np.pi


def test_beyond_the_sum_of_the_lengths_nothing_is_known():
    np.testing.assert_array_equal(angle_to_center(2.0, G, [2.0 + G, 30.0, np.inf])[0], np.pi)
    assert angle_to_center(2.0, G, 2.0 + G - 1e-6)[0] < np.pi
    assert angle_to_center(0.0, G, G)[0] == np.pi
    assert angle_to_center(0.0, G, 9.0)[1] > 0.0


@pytest.mark.parametrize("error", [0.0, 0.03, 2.0, 9.0])
def test_uncertain_magnitude_against_a_scan(error):
    draws = np.random.default_rng(1)
    for length, radius in zip(draws.uniform(0.1, 20.0, 200), draws.uniform(0.0, 15.0, 200), strict=True):
        magnitudes = np.linspace(G - error, G + error, 20001)
        cosines = (length**2 + magnitudes**2 - radius**2) / (2.0 * length * magnitudes)
        angle, excess = angle_to_center(length, G, radius, error)
        if cosines.min() > 1.0:
            assert excess > 0.0
            assert np.isnan(angle)
        else:
            assert excess == 0.0
            assert angle == pytest.approx(np.arccos(max(cosines.min(), -1.0)), abs=1e-3)


def test_accelerometer_with_errors_of_its_own():
    """Truth and errors drawn on and inside their bounds: never outside, and close to the edge."""
    draws = np.random.default_rng(2)
    count, alpha, gravity_error = 400_000, 4.0, 0.03
    sensor = VectorSensorBounds(error=0.3, scale_error=0.05, misalignment=0.02)
    up = unit(draws, count)
    gravity = draws.uniform(G - gravity_error, G + gravity_error, count)
    # Half of the draws push perpendicular to the force, as far as they may, with all errors in one direction.
    sideways = np.cross(up, unit(draws, count))
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    push = np.where(draws.random((count, 1)) < 0.5, unit(draws, count), sideways * 0.9 - up * draws.random((count, 1)))
    push /= np.linalg.norm(push, axis=1, keepdims=True)
    force = gravity[:, None] * up + alpha * push
    # K f of any direction and length up to k ‖f‖ is possible: K = k p fᵀ/‖f‖.
    measured = force + (0.05 * np.linalg.norm(force, axis=1)[:, None] + 0.3) * push
    turns = Rotation.from_rotvec(0.02 * np.cross(up, push) / np.linalg.norm(np.cross(up, push), axis=1, keepdims=True))
    measured = turns.apply(measured)
    bounds = accelerometer_bounds(measured, alpha, gravity=G, gravity_error=gravity_error, sensor=sensor)
    assert not bounds.contradicted.any()
    error = angle_between(bounds.directions, up)
    ratio = error / bounds.angles
    assert ratio.max() <= 1.0
    assert ratio.max() > 0.98


def test_accelerometer_is_sharp():
    """The tangent: ‖f‖² = g² - α², the largest angle that α makes, arcsin(α/g)."""
    alpha = 3.0
    angle = np.arcsin(alpha / G)
    force = np.sqrt(G**2 - alpha**2) * np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    assert np.linalg.norm(force - G * UP) == pytest.approx(alpha)
    assert accelerometer_bounds(force, alpha).angles[0] == pytest.approx(angle, rel=1e-9)


def test_contradictions_are_told_by_row():
    forces = np.array([[0.0, 0.0, G], [0.0, 0.0, 12.0], [np.nan, 0.0, G], [0.0, 0.0, 8.0], [0.0, 0.0, np.inf]])
    bounds = accelerometer_bounds(forces, 1.0)
    np.testing.assert_array_equal(bounds.contradicted, [False, True, False, True, False])
    np.testing.assert_allclose(bounds.excess, [0.0, 12.0 - G - 1.0, 0.0, G - 8.0 - 1.0, 0.0], rtol=1e-9)
    np.testing.assert_array_equal(np.isnan(bounds.angles), [False, True, True, True, True])
    np.testing.assert_array_equal(bounds.informative, [True, False, False, False, False])


def test_magnetometer_with_a_disturbance():
    draws = np.random.default_rng(3)
    strength, disturbance = 43.0, 5.0
    sensor = VectorSensorBounds(error=4.0, scale_error=0.01)
    field = unit(draws, 200_000)
    measured = strength * field + disturbance * unit(draws, 200_000)
    measured += (4.0 + 0.01 * np.linalg.norm(measured, axis=1)[:, None]) * unit(draws, 200_000)
    bounds = magnetometer_bounds(measured, disturbance, strength=strength, sensor=sensor)
    assert not bounds.contradicted.any()
    assert (angle_between(bounds.directions, field) <= bounds.angles).all()
    # One error alone, at right angles to what is measured: arcsin(d/B).
    angle = np.arcsin(disturbance / strength)
    row = np.sqrt(strength**2 - disturbance**2) * np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    assert magnetometer_bounds(row, disturbance, strength=strength).angles[0] == pytest.approx(angle)


def test_dip():
    """The measured angle between two directions may differ from the true one by both bounds, and no more."""
    first = accelerometer_bounds([[0.0, 0.0, G]] * 3, 1.0)
    angle = np.deg2rad(150.0)
    measured = angle + np.array([0.9, 1.0, 1.1]) * 0.2
    fields = np.column_stack([np.sin(measured), np.zeros(3), np.cos(measured)])
    second = magnetometer_bounds(fields, 0.0, strength=1.0)
    excess = angle_excess(first, second, angle, angle_error=0.2 - first.angles[0])
    np.testing.assert_allclose(excess, [0.0, 0.0, 0.02], atol=1e-7)


def test_cross_product_of_field_and_up():
    """Up, field and reference wrong by as much as they may be: the third direction holds, close to its edge."""
    draws = np.random.default_rng(9)
    count, reference_error, radius, tilt = 200_000, 2.0, 3.0, np.deg2rad(3.0)
    shown = np.array([0.0, 16.0, -40.0])  # what the reference field is taken for
    turns = draws.uniform(0.0, 2.0 * np.pi, count)
    reference = shown + reference_error * np.column_stack([np.zeros(count), np.cos(turns), np.sin(turns)])
    east = np.array([1.0, 0.0, 0.0])
    push = np.where(draws.random((count, 1)) < 0.5, unit(draws, count), [0.0, 1.0, 0.0])
    axis = np.where(draws.random((count, 1)) < 0.5, unit(draws, count), [0.0, 1.0, 0.0])
    up = Rotation.from_rotvec(tilt * axis).apply(UP)
    fields = reference + radius * push
    lengths = np.linalg.norm(fields, axis=1)
    zero, none = np.zeros(count), np.full(count, 0.5)
    bounds = cross_bounds(
        DirectionBounds(up, np.full(count, tilt), zero),
        WindowBounds(fields / lengths[:, None], none, zero, none, lengths, np.full(count, radius + reference_error)),
        shown,
        in_plane_error=reference_error,
    )
    assert not bounds.contradicted.any()
    ratio = angle_between(bounds.directions, east) / bounds.angles
    assert ratio.max() <= 1.0
    assert ratio.max() > 0.8


# --- gyro and time ----------------------------------------------------------------------------------------------------


def test_gyro_error_of_an_instant_is_attained():
    bounds = GyroBounds(noise=0.01, bias=0.02, drift=0.001, scale_error=0.1)
    # (1 - k) ω - (b + v), all in one direction: the rate that shows least.
    true = 2.0
    shown = 0.9 * true - (0.01 + 0.02 + 0.001 * 5.0)
    assert bounds.rate_error(shown, elapsed=5.0) == pytest.approx(true - shown)


def turned(rate, duration):
    """The rotation that a rate (a function of time) makes, by SciPy's DOP853."""

    def derivative(t, q):
        w = rate(t)
        return 0.5 * np.concatenate([[-q[1:] @ w], q[0] * w + np.cross(q[1:], w)])

    end = solve_ivp(derivative, (0.0, duration), [1.0, 0.0, 0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    return Rotation.from_quat(end, scalar_first=True)


@pytest.mark.parametrize("frequency", [0.0, 3.0, 20.0])
@pytest.mark.parametrize("speed", [0.0, 1.0, 6.0])
def test_angle_over_a_window_with_an_increment_bound(frequency, speed):
    """Noise that turns at a frequency: its integral stays small, and the turn's error below the bound."""
    draws = np.random.default_rng(4)
    noise, duration = 0.2, 2.0
    increment = noise * duration if frequency == 0.0 else min(2.0 * noise / frequency, noise * duration)
    scale = 0.02 if speed else 0.0  # or the bound allows for a turn that is not made
    bounds = GyroBounds(noise=noise, bias=0.01, scale_error=scale, increment=increment)
    times = np.linspace(0.0, duration, 401)
    largest = 0.0
    for _ in range(10):
        axis, first, bias = unit(draws), unit(draws), unit(draws)
        if frequency == 0.0:  # all errors in one direction
            bias = first
        second = np.cross(first, unit(draws))
        second /= np.linalg.norm(second)

        def rate(t, axis=axis):
            return speed * np.array([np.cos(t), np.sin(t), 0.5]) @ Rotation.from_rotvec(axis).as_matrix()

        def error(t, first=first, second=second, bias=bias, rate=rate):
            turning = np.cos(frequency * t) * first + np.sin(frequency * t) * second
            return noise * turning + 0.01 * bias + scale * rate(t)

        def shown(t, rate=rate, error=error):
            return rate(t) + error(t)

        off = (turned(shown, duration) * turned(rate, duration).inv()).magnitude()
        bound = bounds.window_angle(times, [shown(t) for t in times])
        assert off <= bound
        largest = max(largest, off / bound)
    if frequency == 0.0 and speed == 0.0:
        assert largest > 0.99


def test_increment_beats_the_noise_bound_over_long_windows():
    bounds = GyroBounds(noise=1e-4, increment=1e-4)
    assert bounds.noise_rate(0.5, 0.0) == pytest.approx(1e-4)
    assert bounds.noise_rate(100.0, 0.07) == pytest.approx(1e-6 * 1.07 * (1.0 + 0.5e-2))


@pytest.mark.parametrize("duration", [0.004, 0.3, 2.0])
@pytest.mark.parametrize("seed", range(3))
def test_anchored_turns_hold(seed, duration):
    """Noise that turns, a bias and a scale error: the true turn from the anchor, as a rate, within the noise bound."""
    draws = np.random.default_rng(seed)
    times = np.cumsum(draws.uniform(0.004, 0.006, 800))
    true_rates = np.array([tumbling(t) for t in times])
    attitudes = [Rotation.identity()]
    for step, rate in zip(np.diff(times), 0.5 * (true_rates[1:] + true_rates[:-1]), strict=True):
        attitudes.append(attitudes[-1] * Rotation.from_rotvec(step * rate))
    attitudes = Rotation.concatenate(attitudes)
    axis, start = unit(draws), unit(draws)
    noise = 0.1 * Rotation.from_rotvec(30.0 * times[:, None] * axis).apply(start)
    gyro = GyroBounds(noise=0.1, bias=0.01, drift=0.002, scale_error=0.01, increment=2.0 * 0.1 / 30.0 + 0.1 * 0.006)
    bias = 0.01 + 0.002 * (times - times[0])[:, None]
    # The component of the noise along its axis does not turn: none of it is left in.
    noise -= (noise @ axis)[:, None] * axis
    turns = gyro.anchored_turns(times, 1.01 * true_rates + bias * unit(draws) + noise, duration)
    rows = np.arange(1, 800)
    assert (turns.anchors[rows] < rows).all()
    spans = times[rows] - times[turns.anchors[rows]]
    assert (spans <= max(duration, 0.006) + 1e-9).all()
    relative = (attitudes[turns.anchors[rows]].inv() * attitudes[rows]).as_rotvec()
    error = np.linalg.norm(relative / spans[:, None] - turns.rates[rows], axis=1)
    assert (error <= turns.noise[rows]).all()
    assert (error / turns.noise[rows]).max() > 0.3
    if duration == 2.0:
        longest = spans > 1.9
        assert (
            turns.noise[rows][longest] < 0.6 * gyro.rate_error(np.linalg.norm(true_rates, axis=1)[rows][longest])
        ).all()


def test_scale_errors_cancel_where_a_turn_goes_back():
    """One matrix K: the turn there and back leaves nothing of first order, and a spin leaves k times the angle."""
    times = np.linspace(0.0, 4.0, 801)
    swinging = np.zeros((801, 3))
    swinging[:, 0] = 2.0 * np.sin(np.pi * times)  # two periods, 2.55 rad there and back in each
    gyro = GyroBounds(noise=0.0, scale_error=0.02)
    turns = gyro.anchored_turns(times, swinging, 4.0)
    linear = 0.02 / 0.98 * np.trapezoid(np.abs(swinging[:, 0]), times)
    bounds = turns.noise * (times - times[turns.anchors])
    assert bounds[-1] < 0.06 * linear
    # Truths: any K on its bound; K is that of the measured rate here, K' = K (I + K)^-1.
    draws = np.random.default_rng(8)
    largest = 0.0
    for _ in range(30):
        left, right = Rotation.random(2, random_state=draws.integers(1 << 30)).as_matrix()
        matrix = 0.02 * left @ np.diag(draws.choice([-1.0, 1.0], 3)) @ right
        true = np.linalg.solve(np.eye(3) + matrix, swinging.T).T
        middles = 0.5 * (true[1:] + true[:-1]), 0.5 * (swinging[1:] + swinging[:-1])
        attitudes = [Rotation.identity(), Rotation.identity()]
        for n, (real, shown) in enumerate(zip(*middles, strict=True)):
            step = times[n + 1] - times[n]
            attitudes = [a * Rotation.from_rotvec(step * w) for a, w in zip(attitudes, (real, shown), strict=True)]
            error = (attitudes[1].inv() * attitudes[0]).magnitude()
            assert error <= bounds[n + 1] + 1e-12
            largest = max(largest, error / bounds[n + 1])
    assert largest > 0.4


def test_time_offset():
    times = np.arange(0.0, 4.0, 0.01)
    rates = np.zeros((400, 3))
    rates[:, 1] = 2.0 * np.sin(5.0 * times)
    angles = time_offset_angles(times, rates, 0.1)
    # Brute force on a fine grid, and the turn itself.
    fine = np.linspace(-0.1, 0.1, 201)
    speeds = np.abs(2.0 * np.sin(5.0 * (times[:, None] + fine)))
    inner = slice(20, -20)
    assert (angles >= 0.1 * speeds.max(axis=1) - 2e-4)[inner].all()
    assert (angles <= 0.1 * np.abs(2.0 * np.sin(5.0 * (times[:, None] + np.linspace(-0.11, 0.11, 221)))).max(axis=1))[
        inner
    ].all()
    turn = np.abs(0.4 * (np.cos(5.0 * times) - np.cos(5.0 * (times + 0.1))))
    assert (turn <= angles + 1e-9)[inner].all()
    with_gyro = time_offset_angles(
        times, rates, 0.1, gyro=GyroBounds(0.01, scale_error=0.02), angular_acceleration=10.0
    )
    assert (with_gyro > angles).all()
    assert np.isfinite(with_gyro).all()
    rates[200] = np.nan
    missing = np.flatnonzero(np.isnan(time_offset_angles(times, rates, 0.1)))
    assert set(range(190, 211)) <= set(missing) <= set(range(189, 212))


def test_shift_puts_late_values_back():
    times = np.array([0.0, 0.1, 0.2, 0.31, 0.4])
    values = 10.0 * (times - 0.1)  # of the time 0.1 s before
    shifted, left = shift(times, values, 0.1)
    np.testing.assert_allclose(shifted, [0.0, 1.0, 2.1, np.nan, np.nan], atol=1e-12)
    np.testing.assert_allclose(left[:3], [0.0, 0.0, 0.01], atol=1e-12)


# --- windows ----------------------------------------------------------------------------------------------------------


def recording(duration=4.0, step=0.005, *, rate=None, acceleration=None):
    """Times, attitudes, specific forces and rates of a motion given as functions of time."""
    times = np.arange(0.0, duration + 0.5 * step, step)
    rates = np.zeros((len(times), 3)) if rate is None else np.array([rate(t) for t in times])
    turns = Rotation.from_rotvec(0.5 * step * (rates[1:] + rates[:-1]))
    attitudes = [Rotation.identity()]
    for turn in turns:
        attitudes.append(attitudes[-1] * turn)
    attitudes = Rotation.concatenate(attitudes)
    accelerations = np.zeros((len(times), 3)) if acceleration is None else np.array([acceleration(t) for t in times])
    return times, attitudes, attitudes.inv().apply(G * UP + accelerations), rates


def tumbling(t):
    return np.array([1.5 * np.sin(2.0 * t), 1.0 * np.cos(3.0 * t), 0.7])


@pytest.mark.parametrize("at", ["end", "middle"])
def test_speed_bound_is_attained(at):
    """From -v to v in one window, across up: the angle is arctan of 2v/T over g; the bound is arcsin of it."""
    times, attitudes, forces, rates = recording(rate=tumbling, acceleration=lambda t: np.array([0.5, 0.0, 0.0]))
    motion = MotionBounds(velocity=1.0)  # a = 0.5 for 4 s
    bounds = gravity_bounds_over_windows(times, forces, rates, [4.0], motion=motion, gyro=GyroBounds(0.0), at=at)
    row = -1 if at == "end" else 400
    error = angle_between(bounds.directions, attitudes.inv().apply(UP))
    assert (error <= bounds.angles)[1:-1].all()  # at the very ends there may be no window
    assert bounds.durations[row] == pytest.approx(4.0)
    assert error[row] == pytest.approx(np.arctan(0.5 / G), rel=1e-6)
    assert 0.99 < error[row] / bounds.angles[row] <= 1.0
    assert not bounds.contradicted.any()


@pytest.mark.parametrize("at", ["end", "middle"])
def test_position_bound_is_attained(at):
    """A constant acceleration that goes from one end of the ball to the other and back: 16 p/T²."""
    times, attitudes, forces, rates = recording(rate=tumbling, acceleration=lambda t: np.array([0.5, 0.0, 0.0]))
    motion = MotionBounds(position=0.5)  # x = t²/4 from -2 to 2: 0 to 1
    bounds = gravity_bounds_over_windows(times, forces, rates, [4.0], motion=motion, gyro=GyroBounds(0.0), at=at)
    row = -1 if at == "end" else 400
    error = angle_between(bounds.directions, attitudes.inv().apply(UP))
    assert (error <= bounds.angles)[1:-1].all()  # at the very ends there may be no window
    assert 0.99 < error[row] / bounds.angles[row] <= 1.0
    # A tenth of the ball, and the same data prove the bound wrong where the push is along gravity.
    times, _, forces, rates = recording(rate=tumbling, acceleration=lambda t: np.array([0.0, 0.0, 0.5]))
    bounds = gravity_bounds_over_windows(
        times, forces, rates, [4.0], motion=MotionBounds(position=0.05), gyro=GyroBounds(0.0), at=at
    )
    assert bounds.contradicted[row]
    assert np.isnan(bounds.angles[row])
    assert bounds.excess[row] == pytest.approx(0.45, rel=1e-3)


def smooth_motion(draws, position, duration):
    """Position, velocity and acceleration as functions of time, within a ball of the radius."""
    frequencies, phases = draws.uniform(0.5, 12.0, (4, 3)), draws.uniform(0.0, 2.0 * np.pi, (4, 3))
    fine = np.linspace(0.0, duration, 4001)

    def derivative(t, order):
        angle = frequencies * np.asarray(t)[..., None, None] + phases + order * np.pi / 2.0
        return (frequencies**order * np.sin(angle)).sum(axis=-2)

    scale = position / np.linalg.norm(derivative(fine, 0), axis=1).max()
    speed = scale * np.linalg.norm(derivative(fine, 1), axis=1).max()
    return speed, lambda t: scale * derivative(t, 2)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("at", ["end", "middle"])
def test_windows_hold_for_motion_with_all_errors(seed, at):
    draws = np.random.default_rng(seed)
    speed, acceleration = smooth_motion(draws, 0.4, 6.0)
    times, attitudes, forces, rates = recording(6.0, rate=tumbling, acceleration=acceleration)
    # Errors on their bounds: bias and scale of the gyro, noise that turns slowly, the accelerometer's offset and scale.
    gyro = GyroBounds(noise=0.02, bias=0.01, scale_error=0.02)
    sensor = VectorSensorBounds(error=0.2, scale_error=0.01)
    shown = (
        1.02 * rates + 0.01 * unit(draws) + 0.02 * Rotation.from_rotvec(times[:, None] * unit(draws)).apply(unit(draws))
    )
    measured = 1.01 * forces + 0.2 * unit(draws)
    # Stamps of the accelerometer 3 ms late.
    late = np.column_stack([np.interp(times - 0.003, times, column) for column in measured.T])
    bounds = gravity_bounds_over_windows(
        times, late, shown, [0.5, 1.0, 2.0, 4.0], motion=MotionBounds(speed, 0.4), gyro=gyro, sensor=sensor,
        time_offset=0.003, at=at,
    )  # fmt: skip
    assert not bounds.contradicted.any()
    error = angle_between(bounds.directions, attitudes.inv().apply(UP))
    measured_rows = np.isfinite(bounds.angles)
    assert measured_rows[1:].all()
    assert (error <= bounds.angles)[measured_rows].all()
    assert np.nanmedian(bounds.angles) < 0.5


@pytest.mark.parametrize("at", ["end", "middle"])
def test_gyro_bias_is_attained(at):
    """A still sensor and a gyro that shows a turn: the mean lies half the turn off at the end, not in the middle."""
    times, _, forces, rates = recording(2.0)
    shown = rates + np.array([0.05, 0.0, 0.0])
    bounds = gravity_bounds_over_windows(
        times, forces, shown, [2.0], motion=MotionBounds(acceleration=0.0), gyro=GyroBounds(0.0, bias=0.05), at=at
    )
    error = angle_between(bounds.directions, UP)
    assert (error[1:] <= bounds.angles[1:]).all()
    if at == "end":
        assert error[-1] / bounds.angles[-1] > 0.6  # triangular weights were chosen, or equal ones: both half
        assert error[-1] == pytest.approx(0.05, rel=0.01)


def test_windows_against_direct_sums():
    """Weighted means by a loop, with uneven steps."""
    draws = np.random.default_rng(7)
    times = np.cumsum(draws.uniform(0.005, 0.02, 300))
    rates, vectors = draws.standard_normal((2, 300, 3))
    attitudes = [Rotation.identity()]
    for n in range(299):
        step = times[n + 1] - times[n]
        attitudes.append(attitudes[-1] * Rotation.from_rotvec(0.5 * step * (rates[n] + rates[n + 1])))
    in_frame = np.array([a.apply(v) for a, v in zip(attitudes, vectors, strict=True)])
    bounds = field_bounds_over_windows(
        times, vectors, rates, [0.8], disturbance=300.0, gyro=GyroBounds(0.0), strength=200.0
    )
    for row in (20, 150, 299):
        start = np.searchsorted(times, times[row] - 0.8)
        mean = attitudes[row].inv().apply(np.trapezoid(in_frame[start : row + 1], times[start : row + 1], axis=0))
        np.testing.assert_allclose(bounds.directions[row], mean / np.linalg.norm(mean), atol=1e-12)


def test_gaps_and_missing_rows_break_windows():
    times, _, forces, rates = recording(2.0)
    times = np.where(np.arange(len(times)) >= 200, times + 1.0, times)
    forces[300] = np.nan
    bounds = gravity_bounds_over_windows(
        times, forces, rates, [0.5], motion=MotionBounds(velocity=0.1), gyro=GyroBounds(0.01), maximum_step=0.1
    )
    measured = np.isfinite(bounds.angles)
    np.testing.assert_array_equal(measured[[0, 99, 199, 299, 399]], [False, True, True, True, False])
    # No window reaches over the gap (rows 200 to 300) or the missing row (300 to 400), whose ends are 100 rows apart.
    assert not measured[200:300].any() or (bounds.durations[measured] <= 0.5 + 1e-9).all()
    assert not measured[300:400].any()


def test_long_recordings_in_blocks(monkeypatch):
    times, _, forces, rates = recording(
        8.0, rate=tumbling, acceleration=lambda t: np.array([np.sin(5.0 * t), 0.0, 0.0])
    )
    arguments = {"motion": MotionBounds(1.0, 0.5), "gyro": GyroBounds(0.01, 0.01, 1e-3, 0.01, 0.01)}
    for at in ("end", "middle"):
        whole = gravity_bounds_over_windows(times, forces, rates, [0.5, 1.0, 3.0], at=at, **arguments)
        with monkeypatch.context() as patch:
            patch.setattr("elliptude.bounds.window_averages._BLOCK_ROWS", 97)
            pieces = gravity_bounds_over_windows(times, forces, rates, [0.5, 1.0, 3.0], at=at, **arguments)
        np.testing.assert_allclose(pieces.angles, whole.angles, atol=1e-9)
        np.testing.assert_allclose(pieces.directions, whole.directions, atol=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: angle_to_center(1.0, G, -1.0), "radius must be at least 0"),
        (lambda: angle_to_center(1.0, G, 1.0, G), "magnitude_error from 0 to below it"),
        (lambda: accelerometer_bounds(np.zeros((3, 2)), 1.0), r"specific_forces must have shape \(N, 3\)"),
        (lambda: accelerometer_bounds(np.ones((3, 3)), np.nan), "radius"),
        (lambda: GyroBounds(noise=-1.0), "noise must be finite and at least 0, not -1.0"),
        (lambda: GyroBounds(noise=1.0, scale_error=1.0), "scale_error must be from 0 to below 1, not 1.0"),
        (lambda: GyroBounds(noise=1.0, increment=np.nan), "increment must be at least 0, not nan"),
        (lambda: MotionBounds(velocity=-2.0), "velocity must be at least 0, not -2.0"),
        (lambda: time_offset_angles([0.0, 0.0], np.zeros((2, 3)), 0.1), "times must increase; row 1 does not"),
        (lambda: time_offset_angles([0.0, np.nan], np.zeros((2, 3)), 0.1), "times must be finite; row 1 is not"),
        (
            lambda: gravity_bounds_over_windows(
                [0.0, 1.0], np.ones((2, 3)), np.ones((2, 3)), [0.0], motion=MotionBounds(), gyro=GyroBounds(0.0)
            ),
            "durations must be positive",
        ),
    ],
)
def test_bad_arguments(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_stamp_that_is_off_after_the_gyro_has_drifted():
    """The gyro shows nothing, and the body turns as its bias has drifted since it was known."""
    times, drift, offset = np.array([0.0, 499.9, 500.0, 500.1]), 1e-4, 0.01
    gyro = GyroBounds(noise=0.0, bias=0.0, drift=drift)
    angles = time_offset_angles(times, np.zeros((4, 3)), offset, gyro=gyro)
    assert angles[2] >= drift * 500.0 * offset
    assert angles[2] <= 1.001 * drift * 500.1 * offset
    later = time_offset_angles(times, np.zeros((4, 3)), offset, gyro=gyro, bias_known=-500.0)
    assert later[2] >= drift * 1000.0 * offset
