"""The multiplicative Kalman filter against integration by SciPy, central differences and least squares."""

import elliptude
import numpy as np
import pytest
from elliptude.estimation.best.multiplicative_filter import MultiplicativeFilter
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

INERTIA = np.array([[1.0, 0.1, 0.0], [0.1, 2.0, 0.2], [0.0, 0.2, 2.5]])
BODY = elliptude.RigidBody(INERTIA)
ARM, WEIGHT = np.array([0.1, -0.2, 0.3]), 2.0 * 9.81
POTENTIAL = elliptude.UniformGravity(2.0, 9.81, ARM)
NOTHING = np.zeros(3)
CONTROL, WHEELS = np.array([0.3, -0.2, 0.5]), np.array([0.5, -1.0, 0.8])


def drawn(seed=0):
    """Some estimate with a full covariance."""
    draws = np.random.default_rng(seed)
    root = 0.1 * draws.normal(size=(6, 6))
    return MultiplicativeFilter(Rotation.random(rng=draws).as_matrix(), draws.normal(size=3), root @ root.T)


def moved(attitude, vector, error):
    """The state with an error."""
    return attitude @ Rotation.from_rotvec(error[:3]).as_matrix(), vector + error[3:]


def error_of(attitude, vector, estimate):
    """The error of a state about an estimate."""
    turn = Rotation.from_matrix(estimate.attitude.T @ attitude).as_rotvec()
    return np.concatenate([turn, vector - estimate.vector])


def by_scipy(attitude, rate, duration, wheels, torque=NOTHING):
    """The continuous motion: C' = C S(ω), J ω' = (J ω + h) × ω + M + u; gravity is along the third reference axis."""

    def slope(_, state):
        matrix, omega = state[:9].reshape(3, 3), state[9:]
        pull = WEIGHT * np.cross(ARM, matrix[2])
        moment = np.cross(INERTIA @ omega + wheels, omega) + pull + CONTROL + torque
        turning = np.cross(matrix, omega)  # a row c of C becomes c S(ω), that is c × ω
        return np.concatenate([turning.ravel(), np.linalg.solve(INERTIA, moment)])

    end = solve_ivp(slope, (0.0, duration), [*attitude.ravel(), *rate], method="DOP853", rtol=1e-12, atol=1e-12).y[
        :, -1
    ]
    return end[:9].reshape(3, 3), end[9:]


def differences(motion, estimate, after, width=1e-4):
    """Central differences of a motion in the error about an estimate."""
    columns = []
    for unit in np.eye(6):
        ends = [
            error_of(*motion(*moved(estimate.attitude, estimate.vector, sign * width * unit)), after)
            for sign in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * width))
    return np.array(columns).T


def test_gyro_against_differences():
    """Ĉ and Φ; noise of the rate adds what moving the rate does, drift adds to the bias."""
    begin, after = drawn(1), drawn(1)
    sample, interval = np.array([0.5, -1.0, 2.0]), 0.3

    def motion(attitude, bias, of_rate=NOTHING):
        return attitude @ Rotation.from_rotvec(interval * (sample + of_rate - bias)).as_matrix(), bias

    transition = after.predict_gyro(sample, interval, 0.02, 0.05)
    np.testing.assert_allclose(after.attitude, motion(begin.attitude, begin.vector)[0], atol=1e-14)
    np.testing.assert_allclose(transition, differences(motion, begin, after), atol=1e-7)
    of_rate = np.array(
        [error_of(*motion(begin.attitude, begin.vector, 1e-4 * unit), after)[:3] / 1e-4 for unit in np.eye(3)]
    ).T
    added = np.zeros((6, 6))
    added[:3, :3] = 0.02**2 * of_rate @ of_rate.T
    added[3:, 3:] = (0.05 * interval) ** 2 * np.eye(3)
    np.testing.assert_allclose(after.covariance, transition @ begin.covariance @ transition.T + added, atol=1e-7)


@pytest.mark.parametrize("wheels", [np.zeros(3), WHEELS], ids=["none", "wheels"])
def test_rigid_body_against_scipy(wheels):
    """State, Φ and what an unknown torque adds, within the error of the integrator's steps."""
    begin, after = drawn(2), drawn(2)
    duration, steps, unknown = 0.2, 40, np.diag([0.01, 0.02, 0.03])
    integrator = elliptude.Integrator(BODY, POTENTIAL, step=duration / steps, order=4)
    if wheels.any():
        transition = after.predict_with_wheels(integrator, steps, 0.0, CONTROL, unknown, wheels)
    else:
        transition = after.predict_rigid_body(integrator, steps, 0.0, CONTROL, unknown)

    def motion(attitude, rate, torque=NOTHING):
        return by_scipy(attitude, rate, duration, wheels, torque)

    attitude, rate = motion(begin.attitude, begin.vector)
    tolerance = 2e-5 if wheels.any() else 1e-9
    np.testing.assert_allclose(error_of(attitude, rate, after), np.zeros(6), atol=tolerance)
    np.testing.assert_allclose(transition, differences(motion, begin, after), atol=1e-5 if wheels.any() else 1e-6)
    of_torque = np.array(
        [
            error_of(*motion(begin.attitude, begin.vector, 1e-4 * unit), after)
            - error_of(*motion(begin.attitude, begin.vector, -1e-4 * unit), after)
            for unit in np.eye(3)
        ]
    ).T / (2e-4)
    expected = transition @ begin.covariance @ transition.T + of_torque @ unknown @ of_torque.T
    np.testing.assert_allclose(after.covariance, expected, atol=1e-5)


def test_what_wheels_do_converges_with_the_step():
    """Twice the steps, a quarter of the error: the order of a midpoint."""
    begin = drawn(3)
    attitude, rate = by_scipy(begin.attitude, begin.vector, 0.2, WHEELS)
    sizes = []
    for steps in (10, 20):
        after = drawn(3)
        integrator = elliptude.Integrator(BODY, POTENTIAL, step=0.2 / steps, order=4)
        after.predict_with_wheels(integrator, steps, 0.0, CONTROL, np.zeros((3, 3)), WHEELS)
        sizes.append(np.linalg.norm(error_of(attitude, rate, after)))
    assert 3.5 < sizes[0] / sizes[1] < 4.5


def test_update_against_least_squares():
    """The least of prior and measurements together, for errors so small that all is linear, and its covariance."""
    before = drawn(4)
    before.covariance *= 1e-6
    draws = np.random.default_rng(5)
    references = Rotation.random(3, rng=draws).apply([0.0, 0.0, 1.0])
    deviations, rate_covariance = np.array([1e-4, 2e-4, np.inf]), 1e-8 * np.diag([1.0, 2.0, 3.0])
    attitude, vector = moved(before.attitude, before.vector, 1e-4 * draws.normal(size=6))
    directions = np.array([Rotation.from_rotvec(1e-4 * draws.normal(size=3)).apply(attitude.T @ e) for e in references])
    rate = vector + 1e-4 * draws.normal(size=3)
    of_rate = np.linalg.inv(np.linalg.cholesky(rate_covariance))
    of_prior = np.linalg.inv(np.linalg.cholesky(before.covariance))

    def residuals(error):
        there, omega = moved(before.attitude, before.vector, error)
        of_directions = [(b - there.T @ e) / s for b, e, s in zip(directions, references, deviations, strict=True)]
        return np.concatenate([of_prior @ error, *of_directions, of_rate @ (rate - omega)])

    found = least_squares(residuals, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=1e-4, diff_step=1e-6)
    after = MultiplicativeFilter(before.attitude, before.vector, before.covariance)
    square = after.update(directions, references, deviations**-2.0, rate, np.linalg.inv(rate_covariance))
    best = moved(before.attitude, before.vector, found.x)
    np.testing.assert_allclose(error_of(*best, after), np.zeros(6), atol=1e-7)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    np.testing.assert_allclose(after.covariance, covariance, atol=2e-3 * np.abs(covariance).max())
    # What is left of the cost is what was not expected.
    assert float(square) == pytest.approx(2.0 * found.cost, rel=1e-3)


def test_covariances_go_with_the_attitude():
    """After a large correction errors are seen from the new attitude."""
    estimate = drawn(6)
    error, covariance = np.array([0.4, -0.3, 0.8, 0.1, 0.2, 0.3]), estimate.covariance
    old = MultiplicativeFilter(estimate.attitude, estimate.vector, covariance)
    estimate.move(error, covariance)
    width = 1e-5
    columns = [
        (
            error_of(*moved(old.attitude, old.vector, error + width * unit), estimate)
            - error_of(*moved(old.attitude, old.vector, error - width * unit), estimate)
        )
        / (2.0 * width)
        for unit in np.eye(6)
    ]
    reset = np.array(columns).T
    np.testing.assert_allclose(estimate.covariance, reset @ covariance @ reset.T, atol=1e-8)


def test_many_runs_are_as_one_each():
    singles = [drawn(seed) for seed in range(4)]
    many = MultiplicativeFilter(*(np.array([getattr(one, name) for one in singles]) for name in vars(singles[0])))
    draws = np.random.default_rng(7)
    samples, references = draws.normal(size=(4, 3)), np.eye(3)[:2]
    directions = Rotation.random(8, rng=draws).apply([1.0, 0.0, 0.0]).reshape(4, 2, 3)
    integrator = elliptude.Integrator(BODY, POTENTIAL, step=0.01, order=4)
    squares = []
    for one, sample, measured in zip(singles, samples, directions, strict=True):
        one.predict_gyro(sample, 0.1, 0.1, 0.1)
        one.predict_rigid_body(integrator, 3, 0.0, CONTROL, np.eye(3))
        squares.append(one.update(measured, references, np.array([3.0, 4.0]), sample, np.eye(3)))
    many.predict_gyro(samples, 0.1, 0.1, 0.1)
    many.predict_rigid_body(integrator, 3, 0.0, CONTROL, np.eye(3))
    found = many.update(directions, references, np.tile([3.0, 4.0], (4, 1)), samples, np.eye(3))
    np.testing.assert_allclose(found, squares, rtol=1e-10)
    for name in vars(many):
        np.testing.assert_allclose(getattr(many, name), [getattr(one, name) for one in singles], atol=1e-12)
