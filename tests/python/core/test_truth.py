"""The compiled truth against SciPy's DOP853, conserved quantities and known motions."""

import time

import numpy as np
import pytest
from elliptude import _truth, simulation
from elliptude.simulation import scenarios
from inputs import inertia, rotation
from reference import so3
from scipy.integrate import solve_ivp

ORBIT_RATE = 1.1
WEIGHTED_CENTER = np.array([0.4, -0.3, 2.5])
WHEELS = np.array([0.2, -0.5, 0.3])


def dop853(times, attitude, rate, acceleration):
    """C and ω by SciPy; `acceleration(t, C, ω, interval)` is ω'."""

    def motion(at, state, interval):
        c, omega = state[:9].reshape(3, 3), state[9:]
        return np.concatenate([(c @ so3.hat(omega)).ravel(), acceleration(at, c, omega, interval)])

    states = [np.concatenate([attitude.ravel(), rate])]
    for k in range(len(times) - 1):
        solution = solve_ivp(motion, times[k : k + 2], states[-1], method="DOP853", rtol=1e-12, atol=1e-12, args=(k,))
        states.append(solution.y[:, -1])
    states = np.array(states)
    return states[:, :9].reshape(-1, 3, 3), states[:, 9:]


@pytest.mark.parametrize("seed", range(6))
def test_motion_is_that_of_dop853(seed):
    rng = np.random.default_rng(seed)
    body, attitude, rate = inertia(rng), rotation(rng), rng.standard_normal(3)
    times = 0.3 + np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.6, 5))])
    torque = 0.3 * rng.standard_normal((5, 3))

    def acceleration(at, c, omega, interval):
        radial = c.T @ [np.cos(ORBIT_RATE * at), np.sin(ORBIT_RATE * at), 0.0]
        moment = np.cross(WEIGHTED_CENTER / 10, c.T @ [0.0, 0.0, 1.0])
        moment = moment + 3 * ORBIT_RATE**2 * np.cross(radial, body @ radial)
        return np.linalg.solve(body, moment + torque[interval] - np.cross(omega, body @ omega + WHEELS / 5))

    attitudes, rates = _truth.motion(
        times,
        attitude,
        rate,
        body,
        weighted_center=WEIGHTED_CENTER / 10,
        orbit_rate=ORBIT_RATE,
        wheel_momentum=WHEELS / 5,
        torque=torque,
    )
    expected = dop853(times, attitude, rate, acceleration)
    np.testing.assert_allclose(attitudes, expected[0], atol=1e-10)
    np.testing.assert_allclose(rates, expected[1], atol=1e-9)
    np.testing.assert_allclose(attitudes @ attitudes.swapaxes(1, 2), np.broadcast_to(np.eye(3), (6, 3, 3)), atol=2e-15)


@pytest.mark.parametrize("eccentricity", [0.001, 0.3, 0.9])
def test_eccentric_orbit(eccentricity):
    rng = np.random.default_rng(8)
    body, attitude, rate = inertia(rng), rotation(rng), rng.standard_normal(3)
    times = np.array([0.0, 0.4, 1.5, 4.0, 7.0])
    # The orbit itself, as Newton has it: at its perigee at time 0, with a semi-major axis of 1.
    start = [1.0 - eccentricity, 0.0, 0.0, ORBIT_RATE * np.sqrt((1.0 + eccentricity) / (1.0 - eccentricity))]
    orbit = solve_ivp(
        lambda _, s: [*s[2:], *(-(ORBIT_RATE**2) * s[:2] / np.hypot(*s[:2]) ** 3)],
        (0.0, times[-1]),
        start,
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
        dense_output=True,
    ).sol

    def acceleration(at, c, omega, interval):
        place = np.append(orbit(at)[:2], 0.0)
        radius = np.linalg.norm(place)
        radial = c.T @ place / radius
        moment = 3 * ORBIT_RATE**2 / radius**3 * np.cross(radial, body @ radial)
        return np.linalg.solve(body, moment - np.cross(omega, body @ omega))

    attitudes, rates = _truth.motion(times, attitude, rate, body, orbit_rate=ORBIT_RATE, eccentricity=eccentricity)
    expected = dop853(times, attitude, rate, acceleration)
    np.testing.assert_allclose(attitudes[:3], expected[0][:3], atol=1e-8)
    np.testing.assert_allclose(rates[:3], expected[1][:3], atol=1e-7)
    circle, _ = _truth.motion(times, attitude, rate, body, orbit_rate=ORBIT_RATE)
    assert np.abs(circle - attitudes).max() > 1e-4


def test_in_long_double_to_the_last_digit():
    body, rate = np.diag([1.0, 2.8, 2.0]), np.array([0.0, 3.0, 0.0])
    of_body, _ = _truth.motion([0.0, 100.0], np.eye(3), rate, body, precise=True)  # about a principal axis
    given, _ = _truth.rotation([0.0, 100.0], np.eye(3), rate, [[0.0, 0.0, 0.0]], precise=True)
    for attitudes in (of_body, given):
        np.testing.assert_allclose(attitudes[1], so3.exp(100.0 * rate), atol=1e-15)
    # Energy and momentum of a tumbling body to the rounding of the results.
    times = np.linspace(0.0, 20.0, 11)
    attitudes, rates = _truth.motion(times, np.eye(3), [0.3, 0.2, 5.0], body, precise=True)
    momentum = np.einsum("nij,nj->ni", attitudes, rates @ body)
    np.testing.assert_allclose(momentum, momentum[:1] + 0 * momentum, atol=2e-14)
    single, _ = _truth.motion(times, np.eye(3), [0.3, 0.2, 5.0], body)
    np.testing.assert_allclose(single, attitudes, atol=1e-10)
    assert (single != attitudes).any()


@pytest.mark.parametrize("name", ["free", "orbit", "pendulum"])
def test_scenarios_are_those_of_the_simulation(name):
    scenario = scenarios.load(name)
    expected = simulation.truth(scenario)
    potential = scenario.potential
    arguments = {}
    if name == "pendulum":
        arguments["weighted_center"] = potential.mass * potential.gravity * np.array(potential.center_of_mass)
    if name == "orbit":
        arguments["orbit_rate"] = potential.orbit_rate
    # Later, chaos is what one would see.
    rows = 21
    attitudes, rates = _truth.motion(
        expected.times[:rows], expected.attitudes[0], scenario.rate0, scenario.inertia_matrix, **arguments
    )
    np.testing.assert_allclose(attitudes, expected.attitudes[:rows], atol=2e-9)
    np.testing.assert_allclose(rates, expected.angular_velocities[:rows], atol=2e-9)


@pytest.mark.parametrize("seed", range(4))
def test_given_acceleration(seed):
    rng = np.random.default_rng(seed)
    attitude, rate, accelerations = rotation(rng), rng.standard_normal(3), rng.standard_normal((4, 3))
    times = np.linspace(0.0, 2.0, 5)
    attitudes, rates = _truth.rotation(times, attitude, rate, accelerations)
    expected = dop853(times, attitude, rate, lambda at, c, omega, interval: accelerations[interval])
    np.testing.assert_allclose(attitudes, expected[0], atol=1e-11)
    np.testing.assert_allclose(rates[-1], rate + 0.5 * accelerations.sum(axis=0), atol=1e-13)
    # About one axis the angle is known in closed form.
    axis = np.array([0.6, 0.0, 0.8])
    attitudes, _ = _truth.rotation([0.0, 1.5], np.eye(3), 2.0 * axis, [-0.7 * axis])
    np.testing.assert_allclose(attitudes[1], so3.exp((2.0 * 1.5 - 0.5 * 0.7 * 1.5**2) * axis), atol=2e-15)


def test_a_spin_about_a_principal_axis_and_a_long_free_motion():
    body = np.diag([1.0, 2.8, 2.0])
    attitudes, rates = _truth.motion([0.0, 100.0], np.eye(3), [0.0, 3.0, 0.0], body)
    np.testing.assert_allclose(attitudes[1], so3.exp([0.0, 300.0, 0.0]), atol=1e-12)
    times = np.linspace(0.0, 200.0, 41)
    attitudes, rates = _truth.motion(times, np.eye(3), [0.01, 0.01, 5.0], body)
    momentum = np.einsum("nij,nj->ni", attitudes, rates @ body)
    energy = 0.5 * np.einsum("ni,ni->n", rates @ body, rates)
    np.testing.assert_allclose(momentum, momentum[:1] + 0 * momentum, atol=2e-11)
    np.testing.assert_allclose(energy, energy[0], rtol=2e-12)


def test_a_batch_is_its_items_bit_for_bit_and_fast():
    rng = np.random.default_rng(0)
    count = 500
    attitudes0 = np.array([rotation(rng) for _ in range(count)])
    rates0, torque = rng.standard_normal((count, 3)), 0.1 * rng.standard_normal((count, 20, 3))
    times, body = 0.6 * np.arange(21), np.diag([1.0, 2.8, 2.0])
    begin = time.perf_counter()
    attitudes, rates = _truth.motion(times, attitudes0, rates0, body, orbit_rate=1.0, torque=torque)
    assert time.perf_counter() - begin < 5.0  # 10 000 intervals, 0.15 s on one core of 2024
    assert attitudes.shape == (count, 21, 3, 3)
    assert rates.shape == (count, 21, 3)
    for i in (0, 137, count - 1):
        one = _truth.motion(times, attitudes0[i], rates0[i], body, orbit_rate=1.0, torque=torque[i])
        np.testing.assert_array_equal(one[0], attitudes[i])
        np.testing.assert_array_equal(one[1], rates[i])


def test_bad_arguments():
    body = np.eye(3)
    with pytest.raises(ValueError, match=r"times must increase, but times\[1\] is 0 s after 0 s"):
        _truth.motion([0.0, 0.0], np.eye(3), np.zeros(3), body)
    with pytest.raises(ValueError, match=r"attitude must be a rotation"):
        _truth.motion([0.0, 1.0], 2 * np.eye(3), np.zeros(3), body)
    with pytest.raises(ValueError, match=r"torque must have the shape \(\.\.\., 1, 3\)"):
        _truth.motion([0.0, 1.0], np.eye(3), np.zeros(3), body, torque=np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"angular_acceleration must have the shape"):
        _truth.rotation([0.0, 1.0], np.eye(3), np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match=r"eccentricity must be from 0 to 0\.9, not 0\.95"):
        _truth.motion([0.0, 1.0], np.eye(3), np.zeros(3), body, orbit_rate=1.0, eccentricity=0.95)
    with pytest.raises(ArithmeticError, match=r"the motion\[1\] cannot be integrated from 0 s to 1 s"):
        _truth.motion([0.0, 1.0], np.eye(3), [[1.0, 2.0, 3.0], [1e200, 1e200, 0.0]], np.diag([1.0, 2.0, 2.5]))
