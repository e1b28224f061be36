"""The exact free rotor: its closed form against DOP853 and mpmath, the core against the closed form (theory 4.1)."""

import pickle

import elliptude as el
import mpmath
import numpy as np
import pytest
import scipy.integrate
from reference import exact_rotor, so3
from reference.so3 import Array

BODIES = {
    "three moments": [1.0, 2.8, 2.0],
    "thin": [3.0, 2.95, 0.1],
    "oblate": [1.0, 1.0, 1.8],
    "prolate": [2.0, 1.1, 2.0],
    "sphere": [1.5, 1.5, 1.5],
    "flat": [1.0, 2.0, 3.0],
}


def cases(name: str, count: int = 8) -> list[tuple[Array, float, Array]]:
    """Inertias in random axes, times and momenta; among them spins near each axis."""
    rng = np.random.default_rng(len(name))
    found = []
    for k in range(count):
        axes = so3.exp(rng.standard_normal(3))
        direction = rng.standard_normal(3)
        if k >= 5:
            direction = np.eye(3)[k - 5] + 1e-3 * direction
        inertia = axes @ np.diag(BODIES[name]) @ axes.T
        h = float((-1) ** k * rng.uniform(0.1, 4.0))
        found.append((0.5 * (inertia + inertia.T), h, axes @ (direction * BODIES[name])))
    return found


def integrated(inertia: Array, h: float, momentum: Array) -> Array:
    """F from C' = C S(w), J w' = J w cross w by DOP853."""
    inverse = np.linalg.inv(inertia)

    def slope(_: float, state: Array) -> Array:
        rate = inverse @ state[9:]
        turn = state[:9].reshape(3, 3) @ so3.hat(rate)
        return np.concatenate([turn.ravel(), np.cross(state[9:], rate)])

    start = np.concatenate([np.eye(3).ravel(), momentum])
    solution = scipy.integrate.solve_ivp(slope, (0.0, h), start, method="DOP853", rtol=1e-13, atol=1e-13)
    return np.asarray(solution.y[:9, -1].reshape(3, 3))


def core_turn(inertia: Array, h: float, momentum: Array) -> Array:
    """F of the core; backward in time from where the body would have been."""
    body = el.RigidBody(inertia)
    rotor = el.Integrator(body, step=abs(h), free_rotor="exact")
    rate = np.linalg.solve(inertia, momentum)
    if h > 0:
        return np.asarray(rotor.step(np.eye(3), rate)[0])
    # The motion with the opposite rate is the motion backward.
    return np.asarray(rotor.step(np.eye(3), -rate)[0])


@pytest.mark.parametrize("name", BODIES)
def test_closed_form_is_the_differential_equations_solution(name: str) -> None:
    for inertia, h, momentum in cases(name):
        found = exact_rotor.free_turn(inertia, h, momentum)
        np.testing.assert_allclose(found, integrated(inertia, h, momentum), atol=3e-11)
        # the wrong sign of the phase or of the time would be seen
        assert np.abs(found - exact_rotor.free_turn(inertia, -h, momentum)).max() > 1e-2


@pytest.mark.parametrize("name", BODIES)
def test_core_agrees_with_the_closed_form(name: str) -> None:
    for inertia, h, momentum in cases(name):
        expected = exact_rotor.free_turn(inertia, h, momentum)
        np.testing.assert_allclose(core_turn(inertia, h, momentum), expected, atol=2e-12)


def test_functions_of_the_reference_are_jacobis() -> None:
    for a, b, length in [(0.3, 0.7, 1.3), (0.5, 0.1, -2.0), (0.2, 0.2, 0.4), (0.0, 0.6, 3.0)]:
        larger, smaller = max(a, b), min(a, b)
        u, m = mpmath.sqrt(larger) * length, mpmath.mpf(smaller) / larger
        first, second = mpmath.ellipfun("cn", u, m=m), mpmath.ellipfun("dn", u, m=m)
        c, d = (second, first) if a > b else (first, second)
        expected = [float(mpmath.ellipfun("sn", u, m=m) / mpmath.sqrt(larger)), float(c), float(d)]
        np.testing.assert_allclose(exact_rotor.elliptic_functions(a, b, length), expected, atol=1e-14)


def test_linearization_is_the_central_difference_and_keeps_volume() -> None:
    body = el.RigidBody([0.13, 0.28, 0.17])
    rotor = el.Integrator(body, el.UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3]), step=0.01, order=4, free_rotor="exact")
    attitude, rate = el.exp([0.4, -0.2, 0.9]), np.array([3.0, -4.0, 2.0])
    flow = rotor.linearize(attitude, rate, steps=20)
    assert np.linalg.det(flow.state) == pytest.approx(1.0, abs=1e-10)
    change = 1e-5
    for column in range(6):
        ends = []
        for sign in (1.0, -1.0):
            x = np.zeros(6)
            x[column] = sign * change
            end = rotor.linearize(attitude @ el.exp(x[:3]), rate + x[3:], steps=20)
            turn = so3.log(flow.attitude.T @ end.attitude)
            ends.append(np.concatenate([turn, end.angular_velocity - flow.angular_velocity]))
        np.testing.assert_allclose(flow.state[:, column], (ends[0] - ends[1]) / (2 * change), atol=2e-7)


def test_option_is_kept_and_others_are_refused() -> None:
    body = el.RigidBody([1.0, 2.8, 2.0])
    rotor = el.Integrator(body, step=0.1, order=4, free_rotor="exact")
    assert rotor.free_rotor == "exact"
    assert el.Integrator(body, step=0.1).free_rotor == "variational"
    assert repr(rotor).endswith("order=4, free_rotor='exact')")
    again = pickle.loads(pickle.dumps(rotor))
    assert again.free_rotor == "exact"
    with pytest.raises(ValueError, match="free_rotor must be 'variational' or 'exact', not 'moser'"):
        el.Integrator(body, step=0.1, free_rotor="moser")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="rounding leaves nothing of the turn"):
        el.Integrator(body, step=1e20, free_rotor="exact").step(np.eye(3), [1.0, 2.0, 3.0])


def test_bodies_that_advance_together_go_where_each_goes_alone() -> None:
    body = el.RigidBody([1.0, 2.8, 2.0])
    rotor = el.Integrator(body, step=0.5, free_rotor="exact")
    rng = np.random.default_rng(3)
    attitudes, rates = el.exp(rng.standard_normal((5, 3))), rng.standard_normal((5, 3))
    attitudes_after, rates_after = rotor.advance(attitudes, rates, steps=7)
    for k in range(5):
        alone = rotor.trajectory(attitudes[k], rates[k], steps=7)
        np.testing.assert_array_equal(attitudes_after[k], alone.attitudes[-1])
        np.testing.assert_array_equal(rates_after[k], alone.angular_velocities[-1])
