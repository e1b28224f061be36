"""Potentials of one's own in the guaranteed flow (theory 17.10).

Their torques against central differences, the sets against motions by SciPy's DOP853, and against the built-in
potentials where they say the same.
"""

import gc
import pickle
import weakref

import elliptude as el
import numpy as np
import pytest
import scipy.integrate
from inputs import direction, rotation
from inputs import inertia as random_inertia
from reference import own_torque, so3
from reference.rigid_body import GravityGradient

DEGREE = np.pi / 180


class Cubic:
    """U = c (a'b)^3 with b = C' e3, of third degree: the second derivative along a turn is at most 9 * 2c / sqrt 3."""

    def __init__(self, axis, strength):
        self.axis, self.strength = axis, strength

    def energy(self, attitude, time):
        return self.strength * (self.axis @ attitude[2]) ** 3

    def torque(self, attitude, time):
        return -3.0 * self.strength * (self.axis @ attitude[2]) ** 2 * np.cross(self.axis, attitude[2])

    def torque_jacobian(self, attitude, time):
        b = attitude[2]
        along, across = self.axis @ b, np.cross(self.axis, b)
        turned = so3.hat(self.axis) @ so3.hat(b)
        return -3.0 * self.strength * (2.0 * along * np.outer(across, across) + along**2 * turned)

    def torque_curvature_bound(self):
        return 0.5 * 9.0 * 1.1548 * self.strength


def stated(torque, rate=0.0, error=1e-14):
    return el.StatedTorque(torque, rate=rate, error=error)


def predicted(potential, attitude, rate, shape, duration, body, step=0.02):
    flow = el.GuaranteedRigidBodyFlow(body, potential, step=step)
    filter_ = el.GuaranteedFilter(flow, el.StateEllipsoid(attitude, rate, shape, chart="gibbs"))
    filter_.predict(duration)
    return filter_.ellipsoid


def moved(torque, inertia, attitude, rate, duration):
    """The state at the end, by DOP853."""

    def slope(time, y):
        c, omega = y[:9].reshape(3, 3), y[9:]
        momentum = np.cross(omega, inertia @ omega)
        return np.concatenate([(c @ so3.hat(omega)).ravel(), np.linalg.solve(inertia, torque(c, time) - momentum)])

    start = np.concatenate([attitude.ravel(), rate])
    end = scipy.integrate.solve_ivp(slope, (0.0, duration), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return so3.nearest_rotation(end[:9].reshape(3, 3)), end[9:]


def form_of(ellipsoid, attitude, rate):
    """Of a true state in a set with the Gibbs vector's coordinates; 1 at the rim."""
    turn = ellipsoid.attitude.T @ attitude
    odd = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    error = np.concatenate([2.0 * odd / (1.0 + np.trace(turn)), rate - ellipsoid.vector])
    return float(error @ np.linalg.solve(ellipsoid.shape, error))


@pytest.mark.parametrize("turning", [False, True])
def test_torques_against_differences_of_the_energy(turning):
    rng = np.random.default_rng(3)
    for _ in range(10):
        axis = direction(rng)
        turn = 0.7 * np.cross(axis, direction(rng)) if turning else None
        attitude, time = rotation(rng), rng.uniform(0.0, 9.0)
        matrix = random_inertia(rng)
        for potential, reference in (
            (
                el.LinearPotential([1, 2, 3], 5.0 * axis, turn),
                own_torque.Linear(np.array([1, 2, 3]), axis, *[turn] * turning),
            ),
            (el.QuadraticPotential(matrix, axis, turn), own_torque.Quadratic(matrix, axis, *[turn] * turning)),
        ):
            slopes = []
            for unit in np.eye(3):
                ends = [potential.energy(attitude @ so3.exp(h * unit), time) for h in (1e-5, -1e-5)]
                slopes.append(-(ends[0] - ends[1]) / 2e-5)
                turned = [potential.torque(attitude @ so3.exp(h * unit), time) for h in (1e-5, -1e-5)]
                difference = (turned[0] - turned[1]) / 2e-5
                np.testing.assert_allclose(potential.torque_jacobian(attitude, time) @ unit, difference, atol=1e-8)
            np.testing.assert_allclose(potential.torque(attitude, time), slopes, atol=1e-8)
            np.testing.assert_allclose(potential.torque(attitude, time), reference.torque(attitude, time), atol=1e-13)
            for _ in range(20):  # the bound of the curvature
                zeta = rng.uniform(0.0, 3.0) * direction(rng)
                rest = (
                    potential.torque(attitude @ so3.exp(zeta), time)
                    - potential.torque(attitude, time)
                    - potential.torque_jacobian(attitude, time) @ zeta
                )
                assert np.linalg.norm(rest) <= potential.torque_curvature_bound() * (zeta @ zeta) * (1 + 1e-9) + 1e-13


def test_built_in_potentials_as_ones_own_give_the_same_sets():
    rng = np.random.default_rng(4)
    body = el.RigidBody(random_inertia(rng))
    gravity = el.UniformGravity(1.3, 2.0, [0.1, -0.2, 0.3])
    gradient = el.GravityGradient(body, 0.8)
    own = [
        el.LinearPotential(2.6 * np.array([0.1, -0.2, 0.3]), [0, 0, 1]),
        el.QuadraticPotential(3 * 0.8**2 * body.inertia, [1, 0, 0], [0, 0, 0.8]),
    ]
    attitude, rate, shape = rotation(rng), rng.standard_normal(3), 0.05**2 * np.eye(6)
    for potential, same in (
        (gravity, own[0]),
        (gradient, own[1]),
        (el.SumPotential([gravity, gradient]), el.SumPotential(own)),
    ):
        expected = predicted(potential, attitude, rate, shape, 0.3, body)
        found = predicted(same, attitude, rate, shape, 0.3, body)
        root = np.linalg.inv(np.linalg.cholesky(expected.shape))
        np.testing.assert_allclose(root @ found.shape @ root.T, np.eye(6), atol=1e-10)
        np.testing.assert_allclose(found.attitude, expected.attitude, atol=1e-14)


@pytest.mark.parametrize("kind", ["cubic", "own", "gradient"])
def test_the_truth_never_leaves(kind):
    rng = np.random.default_rng(8)
    worst = 0.0
    for _ in range(6):
        inertia = random_inertia(rng)
        body = el.RigidBody(inertia)
        axis = direction(rng)
        if kind == "cubic":
            torque = Cubic(axis, 0.3)
            potential = stated(torque)
        elif kind == "own":
            terms = [
                own_torque.Linear(0.4 * direction(rng), axis, 0.7 * np.cross(axis, direction(rng))),
                own_torque.Quadratic(inertia, direction(rng)),
            ]
            potential = el.SumPotential(
                [
                    el.LinearPotential(terms[0].moment, axis, terms[0].turn),
                    el.QuadraticPotential(inertia, terms[1].direction),
                ]
            )
            torque = terms
        else:
            torque = GravityGradient(inertia, 0.6)
            potential = stated(
                el.GravityGradient(body, 0.6), rate=2 * 0.6 * 3 * 0.6**2 * np.ptp(np.linalg.eigvalsh(inertia))
            )
        attitude, rate = rotation(rng), rng.standard_normal(3)
        size = 10 ** rng.uniform(-3, -1)
        ellipsoid = predicted(potential, attitude, rate, size**2 * np.eye(6), 0.4, body)

        def whole(c, t, torque=torque):
            return sum(one.torque(c, t) for one in torque) if isinstance(torque, list) else torque.torque(c, t)

        for _ in range(12):
            error = size * direction(rng, 6) if rng.random() < 0.5 else size * np.eye(6)[rng.integers(6)]
            start = attitude @ so3.cayley(0.5 * error[:3])
            worst = max(worst, form_of(ellipsoid, *moved(whole, inertia, start, rate + error[3:], 0.4)))
    assert 0.5 < worst <= 1.0


def test_a_failing_function_fails_the_prediction():
    class Failing(Cubic):
        def torque(self, attitude, time):
            raise KeyError("no such table")

    body = el.RigidBody(np.eye(3))
    arguments = [np.eye(3), np.zeros(3), 1e-4 * np.eye(6), 0.1, body]
    with pytest.raises(KeyError, match="no such table"):
        predicted(stated(Failing(np.eye(3)[0], 1.0)), *arguments)
    assert predicted(stated(Cubic(np.eye(3)[0], 1.0)), *arguments) is not None  # nothing is left of it

    class Wrong(Cubic):
        def torque_jacobian(self, attitude, time):
            return np.zeros(3)

    with pytest.raises(ValueError, match=r"torque_jacobian\(attitude, time\).*\(3, 3\)"):
        predicted(stated(Wrong(np.eye(3)[0], 1.0)), *arguments)


def test_what_must_be_stated():
    class Plain:
        def torque(self, attitude, time):
            return np.zeros(3)

        def torque_jacobian(self, attitude, time):
            return np.zeros((3, 3))

    with pytest.raises(ValueError, match="curvature must be given"):
        el.StatedTorque(Plain(), rate=0.0, error=0.0)
    for name in ("rate", "error", "curvature"):
        with pytest.raises(ValueError, match=f"{name} must not be negative"):
            el.StatedTorque(Plain(), **{"rate": 0.0, "error": 0.0, "curvature": 0.0, name: -1.0})
    with pytest.raises(TypeError, match="rate"):
        el.StatedTorque(Plain(), error=0.0, curvature=0.0)
    with pytest.raises(TypeError, match="no method torque"):
        el.StatedTorque(object(), rate=0.0, error=0.0, curvature=0.0)
    with pytest.raises(ValueError, match="at right angles"):
        el.LinearPotential([1, 0, 0], [1, 0, 0], [1, 0, 0])
    with pytest.raises(ValueError, match="direction"):
        el.QuadraticPotential(np.eye(3), [0, 0, 0])
    with pytest.raises(ValueError, match="matrix"):
        el.QuadraticPotential([[1, 2, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 1])
    plain = el.StatedTorque(Plain(), rate=0.0, error=0.0, curvature=0.0)
    with pytest.raises(AttributeError, match="energy"):
        plain.energy(np.eye(3))


def test_they_can_be_stored_and_shown():
    linear = el.LinearPotential([1, 2, 3], [0, 0, 2], [0.1, 0, 0])
    quadratic = el.QuadraticPotential(np.diag([1, 2, 3]), [0, 1, 0])
    stated_ = el.StatedTorque(quadratic, rate=0.5, error=1e-12)
    both = el.SumPotential([linear, quadratic])
    attitude = so3.exp([0.3, -0.2, 0.9])
    for potential in (linear, quadratic, stated_, both):
        again = pickle.loads(pickle.dumps(potential))
        np.testing.assert_array_equal(again.torque(attitude, 2.0), potential.torque(attitude, 2.0))
        assert type(potential).__name__ in repr(potential)
    assert stated_.curvature == quadratic.torque_curvature_bound()
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), 1e-4 * np.eye(6), chart="gibbs")
    filter_ = el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(el.RigidBody(np.eye(3)), both, step=0.1), start)
    restored = el.GuaranteedFilter.from_dict(filter_.to_dict())
    filter_.predict(1.0)
    restored.predict(1.0)
    np.testing.assert_array_equal(restored.ellipsoid.shape, filter_.ellipsoid.shape)


def test_a_filter_with_a_torque_by_functions_is_stored_by_pickle():
    flow = el.GuaranteedRigidBodyFlow(el.RigidBody(np.eye(3)), stated(Cubic(np.eye(3)[0], 1.0)), step=0.1)
    filter_ = el.GuaranteedFilter(flow, el.StateEllipsoid(np.eye(3), np.zeros(3), 1e-4 * np.eye(6), chart="gibbs"))
    with pytest.raises(TypeError, match=r"StatedTorque cannot be stored as JSON; use pickle"):
        filter_.to_dict()
    restored = pickle.loads(pickle.dumps(filter_))
    filter_.predict(0.3)
    restored.predict(0.3)
    np.testing.assert_array_equal(restored.ellipsoid.shape, filter_.ellipsoid.shape)


def test_a_filter_and_a_torque_that_refer_to_each_other_are_freed():
    torque = Cubic(np.eye(3)[0], 1.0)
    flow = el.GuaranteedRigidBodyFlow(el.RigidBody(np.eye(3)), stated(torque), step=0.1)
    torque.flow = flow
    seen = weakref.ref(torque)
    del torque, flow
    gc.collect()
    assert seen() is None


class FailsAt:
    """A constant torque whose functions raise at one of their calls."""

    def __init__(self, call):
        self.calls, self.call = 0, call

    def _count(self):
        self.calls += 1
        if self.calls == self.call:
            raise KeyError("at this call")

    def torque(self, attitude, time):
        self._count()
        return np.array([0.0, 0.0, 0.1])

    def torque_jacobian(self, attitude, time):
        self._count()
        return np.zeros((3, 3))


def started(torque, policy):
    stated = el.StatedTorque(torque, curvature=0.5, rate=0.0, error=0.0)
    flow = el.GuaranteedRigidBodyFlow(el.RigidBody([1.0, 2.0, 2.5]), stated, step=0.1)
    estimator = el.GuaranteedFilter(flow, policy=policy)
    up_and_north = [[0, 0, 1], [0, 1, 0]]
    estimator.update(up_and_north, up_and_north, 0.02, angular_velocity=[0, 0.2, 0], rate_bound=0.02)
    return estimator


@pytest.mark.parametrize("policy", ["raise", "drop_measurement"])
def test_what_a_torque_raises_is_raised_at_any_call_and_only_there(policy):
    counting = FailsAt(0)
    started(counting, policy).predict(0.5)
    assert counting.calls > 5
    for call in range(1, counting.calls + 1):
        estimator = started(FailsAt(call), policy)
        before = estimator.time, estimator.ellipsoid.shape
        with pytest.raises(KeyError, match="at this call"):
            estimator.predict(0.5)
        assert estimator.time == before[0]
        np.testing.assert_array_equal(estimator.ellipsoid.shape, before[1])
        started(FailsAt(0), policy).predict(0.5)  # another one has nothing to do with it
