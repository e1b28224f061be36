"""The states between an integrator's steps, against SciPy: its Hermite polynomials, and DOP853 with dense output."""

from __future__ import annotations

import elliptude as el
import numpy as np
import pytest
import scipy.integrate
import scipy.interpolate
import scipy.spatial.transform
from numpy.typing import NDArray

Array = NDArray[np.float64]

INERTIA = np.diag([0.13, 0.28, 0.17])
MOMENT = 9.81 * np.array([0.0, 0.0, 0.3])  # m g ρ
ATTITUDE = scipy.spatial.transform.Rotation.from_rotvec([2.0, 0.3, -0.4]).as_matrix()
RATE = np.array([1.5, -2.5, 0.8])


def acceleration(attitude: Array, rate: Array) -> Array:
    return np.asarray(np.linalg.solve(INERTIA, np.cross(INERTIA @ rate, rate) + np.cross(MOMENT, attitude.T[:, 2])))


def slope(_: float, y: Array) -> Array:
    attitude, rate = y[:9].reshape(3, 3), y[9:]
    spin = np.array([[0, -rate[2], rate[1]], [rate[2], 0, -rate[0]], [-rate[1], rate[0], 0]])
    return np.concatenate([(attitude @ spin).ravel(), acceleration(attitude, rate)])


def pendulum(step: float) -> el.Integrator:
    gravity = el.UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3])
    return el.Integrator(el.RigidBody(INERTIA), gravity, step=step, order=6, free_rotor="exact")


def test_states_at_any_times_are_those_of_dop853() -> None:
    times = np.sort(np.random.default_rng(4).uniform(2.0, 5.0, 200))
    found = pendulum(0.02).trajectory_at(ATTITUDE, RATE, times, time=2.0)
    start = np.concatenate([ATTITUDE.ravel(), RATE])
    truth = scipy.integrate.solve_ivp(slope, (2.0, 5.0), start, method="DOP853", t_eval=times, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found.times, times)
    np.testing.assert_allclose(found.attitudes.reshape(-1, 9), truth.y[:9].T, atol=2e-8)
    np.testing.assert_allclose(found.angular_velocities, truth.y[9:].T, atol=2e-6)


def test_between_two_steps_it_is_the_hermite_polynomial_of_degree_five() -> None:
    step = 0.05
    ends = pendulum(step).trajectory(ATTITUDE, RATE, steps=1)
    data = []
    for attitude, rate in zip(ends.attitudes, ends.angular_velocities, strict=True):

        def gibbs(t: float, attitude: Array = attitude, rate: Array = rate) -> Array:
            """The Gibbs vector along the motion that has this state, rate and acceleration at t = 0."""
            turn = scipy.spatial.transform.Rotation.from_rotvec(rate * t + acceleration(attitude, rate) * t**2 / 2)
            q = (scipy.spatial.transform.Rotation.from_matrix(ATTITUDE.T @ attitude) * turn).as_quat()
            return np.asarray(q[:3] / q[3])

        d = 1e-4
        first = (gibbs(d) - gibbs(-d)) / (2 * d)
        second = (gibbs(d) - 2 * gibbs(0.0) + gibbs(-d)) / d**2
        data.append([gibbs(0.0), first, second])
    polynomial = scipy.interpolate.BPoly.from_derivatives([0.0, step], data)
    times = np.linspace(0.0, step, 11)
    found = pendulum(step).trajectory_at(ATTITUDE, RATE, times)
    for attitude, time in zip(found.attitudes, times, strict=True):
        q = scipy.spatial.transform.Rotation.from_matrix(ATTITUDE.T @ attitude).as_quat()
        np.testing.assert_allclose(q[:3] / q[3], polynomial(time), atol=2e-10)


def test_times_at_steps_are_the_trajectory() -> None:
    integrator = pendulum(0.01)
    steps = integrator.trajectory(ATTITUDE, RATE, steps=70_000, control_torque=[0.01, 0.0, -0.02])
    found = integrator.trajectory_at(ATTITUDE, RATE, steps.times[::10], control_torque=[0.01, 0.0, -0.02])
    np.testing.assert_array_equal(found.attitudes, steps.attitudes[::10])
    np.testing.assert_array_equal(found.angular_velocities, steps.angular_velocities[::10])
    early = integrator.trajectory_at(ATTITUDE, RATE, [0.0, 0.0])
    np.testing.assert_array_equal(early.attitudes, [ATTITUDE, ATTITUDE])


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.5, 0.4], r"times\[1\] must not be before 0.5 s, but is 0.4 s"),
        ([-0.1], r"times\[0\] must not be before 0.0? ?s, but is -0.1 s"),
        ([], r"times must have the shape \(n,\) with at least one time"),
        (0.5, r"times must have the shape \(n,\) with at least one time"),
        ([0.1, np.nan], "times"),
        ([1e300], "steps of 0.01 s"),
    ],
)
def test_bad_times_are_refused(times: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pendulum(0.01).trajectory_at(ATTITUDE, RATE, times)  # type: ignore[arg-type]


def test_a_step_that_turns_too_far_is_refused_where_a_time_lies_within_it() -> None:
    spin = el.Integrator(el.RigidBody(INERTIA), step=2.0, free_rotor="exact")
    assert spin.trajectory_at(np.eye(3), RATE, [2.0, 4.0]).attitudes.shape == (2, 3, 3)
    with pytest.raises(ValueError, match="right angle"):
        spin.trajectory_at(np.eye(3), RATE, [2.0, 3.0])
