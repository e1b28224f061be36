"""The NumPy reference of the guaranteed estimator against what it does not know (SciPy's integrator, polynomial fits,
sampling, identities of rotations), and the C++ core against the reference.

The core is compared in the metric of the expected shape P = L L': the entries of L^-1 P_found L'^-1 - I, so that a set
that is thin in some direction is as exact there. The reference makes the same choices where the theory leaves one open
(norms, shares of sums, circles of Cauchy's estimate) and adds the same terms for rounding. What remains is the rounding
of operations, about 1e-14 for these sets, and in long steps that the core sums the quaternion's series to s^9 and the
reference the attitude's to rounding: the centers then differ by up to 1e-12 over tens of steps, and what is calculated
along them by a little more.
"""

import math

import elliptude as el
import numpy as np
import pytest
import scipy.integrate
from inputs import assert_close, direction, rotation
from inputs import inertia as random_inertia
from inputs import shape as random_shape
from reference import ellipsoid, error_tube, guaranteed_flow, motion_series, quadrics, so3, wahba
from reference.error_tube import Unbounded, Uncertainty
from reference.guaranteed_flow import GibbsSet, GyroUncertainty
from reference.motion_series import Body, BodyInput, StepTooLong
from reference.own_torque import Linear, Quadratic, Stated
from reference.rigid_body import GravityGradient, UniformGravity
from scipy.spatial.transform import Rotation

RELATIVE = 1e-10  # see above
DEGREE = math.pi / 180
KINDS = ["free", "pendulum", "orbit", "both", "own"]  # with a torque that is expanded as it is
ALL_KINDS = [*KINDS, "stated"]


def make_body(rng, kind):
    inertia = 2.0 * random_inertia(rng)
    potentials = []
    if kind in ("pendulum", "both"):
        potentials.append(UniformGravity(1.3, 2.0, 0.4 * direction(rng)))
    if kind in ("orbit", "both"):
        potentials.append(GravityGradient(inertia, rng.uniform(0.5, 1.2)))
    if kind == "own":
        axis = direction(rng)
        turn = rng.uniform(0.3, 1.0) * np.cross(axis, direction(rng))
        potentials.append(Linear(0.5 * direction(rng), axis, turn))
        potentials.append(Quadratic(inertia + 3.0 * np.eye(3), direction(rng)))
    if kind == "stated":
        torque = Quadratic(inertia, *np.eye(3)[[0, 2]] * [[1.0], [0.7]])
        potentials.append(UniformGravity(1.3, 2.0, 0.4 * direction(rng)))
        potentials.append(
            Stated(torque.torque, torque.torque_jacobian, float(np.ptp(np.linalg.eigvalsh(inertia))), 0.1, 1e-4)
        )
    return Body(inertia, tuple(potentials))


def core_flow(body, step, uncertainty):
    core_body = el.RigidBody(body.inertia)

    def in_core(potential):
        match potential:
            case UniformGravity(mass, gravity, centre_of_mass):
                return el.UniformGravity(mass, gravity, centre_of_mass)
            case Linear(moment, axis, turn):
                return el.LinearPotential(moment, 3.0 * axis, turn)
            case Quadratic(matrix, axis, turn):
                return el.QuadraticPotential(matrix, axis, turn)
            case Stated():
                return el.StatedTorque(
                    potential, curvature=potential.curvature, rate=potential.rate, error=potential.error
                )
        return el.GravityGradient(core_body, potential.orbit_rate)

    potentials = [in_core(potential) for potential in body.potentials]
    return el.GuaranteedRigidBodyFlow(
        core_body,
        el.SumPotential(potentials) if potentials else el.FreeBody(),
        step=step,
        unknown_torque=uncertainty.torque,
        inertia_error=uncertainty.inertia,
    )


def assert_same_shape(found, expected, relative=RELATIVE):
    inverse = np.linalg.inv(np.linalg.cholesky(expected))
    np.testing.assert_allclose(inverse @ found @ inverse.T, np.eye(len(expected)), rtol=0, atol=relative)


def assert_same_set(found, expected, relative=RELATIVE):
    assert_close(found.attitude, expected.attitude, relative=0.1 * relative)
    assert_close(found.vector, expected.vector, relative=0.1 * relative, size=1.0)
    assert_same_shape(found.shape, expected.shape, relative)


def polynomial_terms(function, size, order, points=24):
    """The coefficients of a vector function of one number at zero, up to an order, by a fit on Chebyshev's points."""
    nodes = size * np.cos(np.pi * (np.arange(points) + 0.5) / points)
    values = np.array([function(x) for x in nodes])
    fit = np.polynomial.polynomial.polyfit(nodes / size, values, 14)
    return fit[: order + 1] / size ** np.arange(order + 1)[:, None]


# --- the motion's series ---------------------------------------------------------------------------------------------


def integrated(function, begin, h, rtol=3e-14):
    solution = scipy.integrate.solve_ivp(function, (0, h), begin, method="DOP853", rtol=rtol, atol=1e-16)
    return solution.y[:, -1]


def true_motion(body, attitude, rate, time, h, given, torque=(0, 0, 0)):
    """Euler's equations over a time h."""

    def slope(s, state):
        c, w = state[:9].reshape(3, 3), state[9:]
        moment = given.control_torque + np.asarray(torque) - np.cross(w, body.inertia @ w + given.wheel_momentum)
        for potential in body.potentials:
            moment = moment + potential.torque(c, time + s)
        return np.concatenate([(c @ so3.hat(w)).ravel(), np.linalg.solve(body.inertia, moment)])

    end = integrated(slope, np.concatenate([attitude.ravel(), rate]), h)
    return so3.nearest_rotation(end[:9].reshape(3, 3)), end[9:]


def random_motion(seed, kind, h):
    rng = np.random.default_rng(seed)
    body = make_body(rng, kind)
    given = BodyInput(0.2 * rng.standard_normal(3), 0.2 * rng.standard_normal(3))
    attitude, rate, time = rotation(rng), rng.standard_normal(3), 0.8
    return rng, body, given, attitude, rate, time, motion_series.expand_motion(body, attitude, rate, time, h, given)


def rate_at(series, s):
    return s ** np.arange(9) @ series.rate


def defect_at(body, series, given, attitude, time, s):
    """J^-1 d, d = J omega' + omega x (J omega + h_w) - M(C) - u of the center (17.1)."""
    powers = np.arange(1, 9)
    w, slope = rate_at(series, s), powers * s ** (powers - 1) @ series.rate[1:]
    torque = given.control_torque + sum((p.torque(attitude, time + s) for p in body.potentials), np.zeros(3))
    return slope + np.linalg.solve(body.inertia, np.cross(w, body.inertia @ w + given.wheel_momentum) - torque)


def turned_center(series, attitude, s):
    """C' = C S(omega) with the series' rate."""
    end = integrated(lambda t, c: (c.reshape(3, 3) @ so3.hat(rate_at(series, t))).ravel(), attitude.ravel(), s)
    return end.reshape(3, 3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", KINDS)
def test_the_series_is_a_motion_but_for_its_defect(kind, seed):
    """17.2: the center turns at its rate, lacks no more of Euler's equation than it says, and is near the motion."""
    h = 0.1
    _, body, given, attitude, rate, time, series = random_motion(seed, kind, h)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    impulse = sum(
        0.5 * h * weight * np.linalg.norm(defect_at(body, series, given, turned_center(series, attitude, s), time, s))
        for s, weight in zip(0.5 * h * (nodes + 1), weights, strict=True)
    )
    assert 1e-6 * series.rate_defect < impulse <= series.rate_defect
    np.testing.assert_allclose(series.end_attitude, turned_center(series, attitude, h), atol=1e-13)
    np.testing.assert_allclose(series.end_rate, rate_at(series, h), atol=1e-15)
    end = true_motion(body, attitude, rate, time, h, given)
    np.testing.assert_allclose(series.end_attitude, end[0], atol=1e-12 + 10 * impulse)
    np.testing.assert_allclose(series.end_rate, end[1], atol=1e-12 + 10 * impulse)


@pytest.mark.parametrize("kind", KINDS)
def test_tails_bound_what_is_left_of_series(kind):
    """17.3, of the torque and of its directions, whose next thirty coefficients are known."""
    for seed in range(4):
        h = 0.1
        _, body, _, attitude, _, time, series = random_motion(seed, kind, h)
        attitudes = motion_series.attitude_series(attitude, series.rate, 40)
        powers = h ** np.arange(40)
        for torque in body.torques:
            directions = motion_series.direction_series(torque, attitudes, time)
            rest = sum(np.linalg.norm(directions[k]) * powers[k] for k in range(8, 40))
            assert rest <= series.tail(8, 1.0, torque.turn_rate)
            bounds = motion_series.torque_bounds([torque], np.eye(3))
            for first, terms in ((4, motion_series.torque_jacobian_coefficient), (8, motion_series.torque_coefficient)):
                rest = sum(np.linalg.norm(terms(torque, directions, k), 2) * powers[k] for k in range(first, 40))
                largest = bounds.largest * (bounds.degree if first == 4 else 1)
                assert 0 < rest <= largest * series.tail(first, bounds.degree, bounds.turn_rate)


@pytest.mark.parametrize("kind", KINDS[1:])
def test_the_torque_and_its_expansion_are_within_their_bounds(kind):
    """17.3: the torque at every attitude, its terms, and what is left of them in every direction."""
    rng = np.random.default_rng(5)
    body = make_body(rng, kind)
    transform = np.linalg.inv(body.inertia)
    bounds = motion_series.torque_bounds(body.torques, transform)
    p = bounds.degree
    fullest = np.zeros(4)
    for _ in range(1000):
        attitude, time, gamma = rotation(rng), rng.uniform(0, 9), direction(rng) * 10 ** rng.uniform(-1, 1)
        length = np.linalg.norm(gamma)
        v = direction(rng)
        width = math.sqrt(v @ bounds.shape @ v)
        parts = [np.zeros(3)] * 4
        for torque in body.torques:
            s = motion_series.direction_series(torque, attitude[None], time)[0]
            for order in range(4):
                term = motion_series.torque_term(torque, s, order)
                for _ in range(order):
                    term = term @ gamma
                parts[order] = parts[order] + transform @ term
        end = attitude @ so3.cayley(0.5 * gamma)
        exact = transform @ sum(potential.torque(end, time) for potential in body.potentials)
        rest = exact - sum(parts)
        assert np.linalg.norm(parts[0]) <= bounds.largest * (1 + 1e-12)
        limits = [1, p * length, 0.5 * p**2 * length**2, 0.375 * p**2 * length**3]
        shares = [abs(v @ part) / (width * limit) for part, limit in zip(parts, limits, strict=True)]
        fullest = np.maximum(fullest, shares)
        rest_limit = p**3 / 8 * length**4 * (1 + 0.625 * length)
        assert abs(v @ rest) <= width * rest_limit * (1 + 1e-9) + 1e-13
    assert (fullest <= 1 + 1e-9).all()
    assert (fullest > 0.2).all()  # the bounds are not idle


# --- the errors and the tube -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_the_errors_equations_are_the_true_motion(kind):
    """17.1 and 17.2, with a torque that is not known, about a center that is a motion only up to its defect."""
    h = 0.1
    rng, body, given, attitude, rate, time, series = random_motion(3, kind, h)
    begin = np.concatenate([0.5 * rng.standard_normal(3), 0.5 * rng.standard_normal(3)])
    torque = 0.1 * rng.standard_normal(3)

    def slope(s, state):
        c, error, w = state[:9].reshape(3, 3), state[9:], rate_at(series, s)
        defect = body.inertia @ defect_at(body, series, given, c, time, s)
        rates = motion_series.error_rates(body, c, w, time + s, given.wheel_momentum, error, torque - defect)
        return np.concatenate([(c @ so3.hat(w)).ravel(), rates])

    end = integrated(slope, np.concatenate([attitude.ravel(), begin]), h)
    c = so3.nearest_rotation(end[:9].reshape(3, 3)) @ so3.cayley(0.5 * end[9:12])
    start = attitude @ so3.cayley(0.5 * begin[:3]), rate + begin[3:]
    expected = true_motion(body, *start, time, h, given, torque)
    np.testing.assert_allclose(c, expected[0], atol=1e-12)
    np.testing.assert_allclose(series.end_rate + end[12:], expected[1], atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_the_terms_of_the_errors_equations(kind):
    """The linear part at the start of the step, N_2 and the cubic terms in its middle: a fit of the exact equations."""
    h = 0.1
    rng, body, given, attitude, rate, time, series = random_motion(4, kind, h)
    powers = (0.5 * h) ** np.arange(40)
    middle = so3.nearest_rotation(np.tensordot(powers, motion_series.attitude_series(attitude, series.rate, 40), 1))
    middle_rate = powers[:9] @ series.rate
    linear, _ = error_tube.linear_coefficients(body, series)
    quadratic = error_tube.second_order_rates(body, series)
    cubic_torque = error_tube.torque_forms(body, series, 3)
    for _ in range(5):
        y = direction(rng, 6)
        here, there = (
            polynomial_terms(
                lambda x, y=y, at=at: motion_series.error_rates(body, *at, given.wheel_momentum, x * y), 0.3, 3
            )
            for at in ((attitude, rate, time), (middle, middle_rate, time + 0.5 * h))
        )
        np.testing.assert_allclose(here[1], linear[0] @ y, atol=1e-9)
        np.testing.assert_allclose(there[2], np.einsum("iab,a,b->i", quadratic, y, y), atol=1e-8)
        cubic = np.zeros(6)
        cubic[:3] = 0.25 * y[:3] * (y[:3] @ y[3:])
        cubic[3:] = np.einsum("iabc,a,b,c->i", cubic_torque, y[:3], y[:3], y[:3])
        np.testing.assert_allclose(there[3], cubic, atol=1e-7)


def exact_errors(body, begin, time, h, steps, given, error, torque):
    """The error y about the tube's center after some steps, by integrating both motions."""
    start = begin.attitude @ so3.cayley(0.5 * error[:3]), begin.vector + error[3:]
    end = true_motion(body, *start, time, steps * h, given, torque)
    center = true_motion(body, begin.attitude, begin.vector, time, steps * h, given)
    return np.concatenate([2.0 * so3.cayley_inverse(center[0].T @ end[0]), end[1] - center[1]])


@pytest.mark.parametrize("size", [1e-3, 0.05, 0.2])
@pytest.mark.parametrize("kind", KINDS)
def test_the_tube_holds_the_errors(kind, size):
    """y = Y (u0 + q(u0) + p + r) of exact errors: two orders as they are, and what is left in its bounds."""
    steps, h, time = 4, 0.02, 0.3
    rng = np.random.default_rng(7)
    body = make_body(rng, kind)
    given = BodyInput(0.2 * rng.standard_normal(3), 0.2 * rng.standard_normal(3))
    begin = GibbsSet(rotation(rng), rng.standard_normal(3), size**2 * random_shape(rng, 6, 0.01, 1.0))
    uncertainty = Uncertainty((0.01 * size) ** 2 * np.eye(3))
    course = guaranteed_flow.follow(body, begin, time, h, steps, given, uncertainty, math.inf)
    bounds = motion_series.torque_bounds(body.torques, np.linalg.inv(body.inertia))
    first = error_tube.start(begin.shape, h, bounds.degree * bounds.largest)
    tube, inverse, whole = course.tube, np.linalg.inv(course.tube.frame), np.linalg.cholesky(course.end.shape)
    pushed = motion_series.sum_of_shapes(tube.pushes)
    fullest = 0.0
    for _ in range(8):
        u, torque = first.set @ direction(rng, 6), 0.01 * size * direction(rng)
        q = np.einsum("ijk,j,k->i", tube.second_order, u, u)
        error = exact_errors(body, begin, time, h, steps, given, first.frame @ u, torque)
        assert np.linalg.norm(np.linalg.solve(whole, error)) <= 1
        left = inverse @ error - u - q
        for w in (left / np.linalg.norm(left), direction(rng, 6)):
            reach = math.sqrt(w @ pushed @ w) + tube.rest
            assert w @ left <= reach + 1e-11 / size
            fullest = max(fullest, w @ left / reach)
    assert fullest > 0.2  # the bounds are not idle
    # Without the torque, the terms of first and second order in the errors alone.
    y = first.frame @ u / size
    terms = polynomial_terms(
        lambda x: exact_errors(body, begin, time, h, steps, given, x * y, np.zeros(3)), 0.1, 2, points=16
    )
    np.testing.assert_allclose(inverse @ terms[1] * size, u, atol=1e-7)
    np.testing.assert_allclose(inverse @ terms[2] * size**2, q, atol=2e-3 * np.linalg.norm(q))


def test_both_ways_to_an_ellipsoid_hold_the_quadratic_map():
    """17.4, the shape, without pushes and rest: the boundary of the ball, and points inside, moved by q."""
    rng = np.random.default_rng(8)
    used = 0
    for _ in range(30):
        q = motion_series.symmetrized(rng.standard_normal((6, 6, 6)), 2) * 10 ** rng.uniform(-3, -1.2)
        set_ = np.linalg.cholesky(random_shape(rng, 6, 0.2, 1.0))
        tube = error_tube.Tube(np.eye(6), set_, q, (), 0.0)
        v = np.array([direction(rng, 6) for _ in range(300)])
        points = np.concatenate([v, 0.7 * v]) @ set_.T
        moved = points + np.einsum("ijk,nj,nk->ni", q, points, points)
        inverse = np.linalg.inv(error_tube.shape(tube))
        assert np.einsum("ni,ij,nj->n", moved, inverse, moved).max() <= 1
        larger = error_tube.enlarged_set(np.einsum("li,ijk,ja,kb->lab", np.linalg.inv(set_), q, set_, set_))
        if larger is not None:
            used += 1
            whitened = moved @ np.linalg.inv(set_).T
            assert np.einsum("ni,ij,nj->n", whitened, np.linalg.inv(larger), whitened).max() <= 1
    assert used > 10


# --- the core's rigid body against the reference ---------------------------------------------------------------------


class Prediction:
    """A random prediction: size, condition, steps, inputs and what is not known, over orders of magnitude."""

    def __init__(self, seed, kind, size=None, steps=None, step=None, uncertain=None):
        rng = np.random.default_rng([seed, ALL_KINDS.index(kind)])
        self.body = make_body(rng, kind)
        self.size = size if size is not None else 10 ** rng.uniform(math.log10(1e-3 * DEGREE), math.log10(7 * DEGREE))
        shape = self.size**2 * random_shape(rng, 6, 10 ** rng.uniform(-3, 0), 1.0)
        units = np.diag([1.0] * 3 + [10 ** rng.uniform(-1, 0.5)] * 3)  # a rate of another size than the angle
        self.begin = GibbsSet(rotation(rng), rng.standard_normal(3), units @ shape @ units)
        self.step = step if step is not None else 10 ** rng.uniform(-2.5, -1.2)
        self.steps = steps if steps is not None else int(np.exp(rng.uniform(0, np.log(40.999))))
        self.time = rng.uniform(-5, 5)
        acts = rng.random(4) < 0.5
        self.given = BodyInput(
            0.3 * rng.standard_normal(3) * acts[0], np.array([0.3, -0.2, 0.4]) * rng.standard_normal(3) * acts[1]
        )
        uncertain = acts[2:] if uncertain is None else [uncertain] * 2
        torque = (0.1 * self.size) ** 2 * random_shape(rng, 3, 0.1, 1.0) * uncertain[0]
        least = float(np.linalg.eigvalsh(self.body.inertia)[0])
        self.uncertainty = Uncertainty(torque, 0.1 * self.size * least * uncertain[1])

    def expected(self):
        end = self.time + (self.steps - 0.5) * self.step
        return guaranteed_flow.predict_body(
            self.body, self.begin, self.time, end - self.time, self.step, self.given, self.uncertainty
        )

    def course(self, longest):
        h = (self.steps - 0.5) * self.step / self.steps
        return guaranteed_flow.follow(
            self.body, self.begin, self.time, h, self.steps, self.given, self.uncertainty, longest
        )

    def found(self):
        begin = el.StateEllipsoid(self.begin.attitude, self.begin.vector, self.begin.shape, chart="gibbs")
        filter_ = el.GuaranteedFilter(core_flow(self.body, self.step, self.uncertainty), begin, time=self.time)
        filter_.predict(
            self.time + (self.steps - 0.5) * self.step,
            control_torque=self.given.control_torque,
            wheel_momentum=self.given.wheel_momentum,
        )
        return filter_.ellipsoid


@pytest.mark.parametrize("kind", ALL_KINDS)
@pytest.mark.parametrize("seed", range(14))
def test_predictions(seed, kind):
    prediction = Prediction(seed, kind)
    found = prediction.found()
    try:
        expected = prediction.expected()
    except Unbounded:
        assert found is None
        return
    assert_same_set(found, expected)


@pytest.mark.parametrize("kind", ALL_KINDS)
@pytest.mark.parametrize("size", [1e-3 * DEGREE, 0.3 * DEGREE, 7 * DEGREE])
@pytest.mark.parametrize("steps", [1, 6])
def test_predictions_of_every_size(kind, size, steps):
    """Without what is not known, which would be most of what is added to the set; the largest show every term."""
    prediction = Prediction(1, kind, size, steps, uncertain=False)
    assert_same_set(prediction.found(), prediction.expected())


@pytest.mark.parametrize(("kind", "seed", "step"), [("free", 7, 0.5), ("pendulum", 6, 0.5), ("orbit", 7, 0.3)])
def test_predictions_over_a_long_step(kind, seed, step):
    """In which what series leave out is not small: the core's attitude may err, by no more than it says."""
    prediction = Prediction(seed, kind, size=1e-2, steps=1, step=step, uncertain=False)
    found, expected = prediction.found(), prediction.expected()
    begin, h = prediction.begin, 0.5 * step
    series = motion_series.expand_motion(
        prediction.body, begin.attitude, begin.vector, prediction.time, h, prediction.given
    )
    assert 1e-12 < np.linalg.norm(so3.log(found.attitude.T @ expected.attitude)) <= series.attitude_error
    assert_close(found.vector, expected.vector)
    assert_same_shape(found.shape, expected.shape, relative=1e-12)


def test_steps_of_which_the_series_says_nothing():
    prediction = Prediction(4, "pendulum", size=1e-3, steps=1, step=12.0, uncertain=False)
    with pytest.raises(StepTooLong):
        prediction.expected()
    with pytest.raises(ValueError, match="step of the flow is too long"):
        prediction.found()


def test_the_terms_for_rounding():
    """17.7: of a thin set over a step of 10 us, they are above 1e-11 of it, and what the reference rounds is not."""
    rng = np.random.default_rng(6)
    for _ in range(10):
        body = make_body(rng, "free")
        vectors = Rotation.random(2, rng=rng).as_matrix()
        root = np.block([[vectors[0], np.zeros((3, 3))], [np.zeros((3, 3)), vectors[1]]])
        shape = root @ np.diag([1e-4, 1e-6, 1e-8] * 2) @ root.T
        begin = GibbsSet(rotation(rng), rng.standard_normal(3), 0.5 * (shape + shape.T))
        start = el.StateEllipsoid(begin.attitude, begin.vector, begin.shape, chart="gibbs")
        filter_ = el.GuaranteedFilter(core_flow(body, 1e-5, Uncertainty()), start)
        filter_.predict(1e-5)
        expected = guaranteed_flow.predict_body(body, begin, 0.0, 1e-5, 1e-5)
        assert_same_set(filter_.ellipsoid, expected, relative=5e-12)


def test_predictions_take_every_way():
    """Among the cases: the short tubes' set, the long tubes' although the short were tried, and a set beyond bounds."""
    courses = {"long": 0, "short": 0}
    for kind in KINDS:
        for seed in range(3):
            prediction = Prediction(seed, kind, 0.03, 12)
            long, short = (prediction.course(longest) for longest in (0.1, 0.01))
            if long.largest_displacement > 0.01:
                smaller = short if short.log_volume < long.log_volume else long
                courses["short" if smaller is short else "long"] += 1
                assert_same_set(prediction.found(), smaller.end)
    assert min(courses.values()) > 0
    too_large = Prediction(0, "pendulum", 1.5, 40)
    with pytest.raises(Unbounded):
        too_large.expected()
    assert too_large.found() is None


@pytest.mark.parametrize("kind", ALL_KINDS)
def test_the_rate_without_an_attitude(kind):
    rng = np.random.default_rng(2)
    body = make_body(rng, kind)
    given = BodyInput(rng.standard_normal(3), rng.standard_normal(3))
    uncertainty = Uncertainty(0.1 * random_shape(rng, 3), 0.1 * float(body.moments[0]))
    rate, bound = rng.standard_normal(3), random_shape(rng, 3, 0.01, 0.1)
    filter_ = el.GuaranteedFilter(core_flow(body, 0.1, uncertainty))
    filter_.update(angular_velocity=rate, rate_bound=bound)
    filter_.predict(0.7, control_torque=given.control_torque, wheel_momentum=given.wheel_momentum)
    center, shape = guaranteed_flow.predict_rate(body, rate, bound, 0.7, given, uncertainty)
    assert_close(filter_._vector[0], center, relative=1e-13)
    assert_same_shape(filter_._vector[1], shape)


# --- the gyro --------------------------------------------------------------------------------------------------------

INTERVAL_RATES = ["first_sample", "mean_of_ends", "mean", "last_sample"]


def core_gyro_flow(uncertainty, interval_rate, longest_interval=None):
    return el.GuaranteedGyroFlow(
        uncertainty.noise,
        uncertainty.drift,
        scale=uncertainty.scale,
        angular_acceleration=uncertainty.angular_acceleration,
        interval_rate=interval_rate,
        longest_interval=longest_interval,
        largest_rate=uncertainty.largest_rate,
    )


def test_intervals_that_no_bound_of_a_gyro_speaks_of():
    unbounded = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        size = 10 ** rng.uniform(-4, 0.5)
        begin = GibbsSet(rotation(rng), rng.standard_normal(3), size**2 * random_shape(rng, 6, 1e-2, 1.0))
        drift = (0.05 * size) ** 2 * random_shape(rng, 3) * (seed % 3 > 0)
        uncertainty = GyroUncertainty(drift=drift, largest_rate=None if seed % 10 == 0 else 10 ** rng.uniform(-1, 0.5))
        duration, rate = 10 ** rng.uniform(-2, 0), rng.standard_normal(3)
        filter_ = el.GuaranteedFilter(
            core_gyro_flow(uncertainty, "mean_of_ends", longest_interval=1e-3),
            el.StateEllipsoid(begin.attitude, begin.vector, begin.shape, chart="gibbs"),
        )
        filter_.predict(duration, gyro=rate if seed % 2 else np.full(3, np.nan))
        try:
            expected = guaranteed_flow.predict_unmeasured(begin, duration, uncertainty)
        except Unbounded:
            assert filter_.ellipsoid is None
            unbounded += 1
            continue
        assert_same_set(filter_.ellipsoid, expected)
    assert 5 < unbounded < 30


def test_how_far_any_turn_moves_a_gibbs_vector():
    """(17.10): the composition of any two rotations, and equality about one axis."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        first, turn = rng.uniform(0.01, 1.5), rng.uniform(0.01, 1.5)
        axis, gamma = direction(rng), 2.0 * math.tan(0.5 * first) * direction(rng)
        bound = 2.0 * (math.tan(0.5 * (first + turn)) - math.tan(0.5 * first))
        for about in (axis, gamma / np.linalg.norm(gamma)):
            moved = 2.0 * so3.cayley_inverse(so3.cayley(0.5 * gamma) @ so3.exp(turn * about)) - gamma
            assert np.linalg.norm(moved) <= bound * (1 + 1e-12)
        assert np.linalg.norm(moved) == pytest.approx(bound, rel=1e-10)


@pytest.mark.parametrize("interval_rate", INTERVAL_RATES)
def test_gyro_predictions(interval_rate):
    unbounded = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        size = 10 ** rng.uniform(-4, 1.2)
        shape = size**2 * random_shape(rng, 6, 10 ** rng.uniform(-3, 0), 1.0)
        units = np.diag([1.0] * 3 + [10 ** rng.uniform(-2, 0)] * 3)
        begin = GibbsSet(rotation(rng), 0.1 * rng.standard_normal(3), units @ shape @ units)
        present = rng.random(5) < 0.6
        uncertainty = GyroUncertainty(
            (0.1 * size) ** 2 * random_shape(rng, 3) * present[0],
            (0.05 * size) ** 2 * random_shape(rng, 3) * present[1],
            0.01 * present[2],
            size * present[3],
        )
        increment = None if present[4] else 0.01 * size
        duration, gyro = 10 ** rng.uniform(-2, 0), rng.standard_normal(3)
        filter_ = el.GuaranteedFilter(
            core_gyro_flow(uncertainty, interval_rate),
            el.StateEllipsoid(begin.attitude, begin.vector, begin.shape, chart="gibbs"),
        )
        filter_.predict(duration, gyro=gyro, increment=increment)
        try:
            expected = guaranteed_flow.predict_gyro(begin, gyro, duration, uncertainty, interval_rate, increment)
        except Unbounded:
            assert filter_.ellipsoid is None
            unbounded += 1
            bias = guaranteed_flow.predict_bias(begin.shape[3:, 3:], duration, uncertainty.drift)
            assert_same_shape(filter_._vector[1], bias)
            continue
        assert_same_set(filter_.ellipsoid, expected)
    assert 0 < unbounded < 20


def test_the_linear_part_of_the_gyros_errors():
    """17.6, of turns at constant rates, which are known."""
    rng = np.random.default_rng(1)
    for _ in range(10):
        rate, h, y = rng.standard_normal(3), 10 ** rng.uniform(-2, 0.3), direction(rng, 6)

        def error(x, rate=rate, h=h, y=y):
            end = so3.cayley(0.5 * x * y[:3]) @ so3.exp(h * (rate - x * y[3:]))
            return 2 * so3.cayley_inverse(so3.exp(h * rate).T @ end)

        expected = (guaranteed_flow.gyro_transition(rate, h) @ y)[:3]
        np.testing.assert_allclose(polynomial_terms(error, 0.05, 1)[1], expected, atol=1e-10)


@pytest.mark.parametrize("interval_rate", INTERVAL_RATES)
def test_gyro_sets_hold_what_they_are_about(interval_rate):
    """17.6: rates, biases and noise that use up their bounds, from the boundary of the set, by integration."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        h, acceleration, drift, noise = 0.3, 0.2, 0.02, 0.01
        shape = random_shape(rng, 6, 1e-4, 4e-4)
        begin = GibbsSet(rotation(rng), 0.1 * rng.standard_normal(3), shape)
        uncertainty = GyroUncertainty(noise**2 * np.eye(3), drift**2 * np.eye(3), 0.0, acceleration)
        start_rate, turn = rng.standard_normal(3), acceleration * direction(rng)
        y = np.linalg.cholesky(shape) @ direction(rng, 6)
        attitude, bias = begin.attitude @ so3.cayley(0.5 * y[:3]), begin.vector + y[3:]
        bias_slope, error = drift * direction(rng), noise * direction(rng)
        end = integrated(
            lambda t, c, w=start_rate, a=turn: (c.reshape(3, 3) @ so3.hat(w + a * t)).ravel(), attitude.ravel(), h
        )
        middle = guaranteed_flow.SEEN_DRIFT[interval_rate] * h
        sample = start_rate + turn * middle + bias + bias_slope * middle + error
        predicted = guaranteed_flow.predict_gyro(begin, sample, h, uncertainty, interval_rate)
        gamma = 2.0 * so3.cayley_inverse(predicted.attitude.T @ so3.nearest_rotation(end.reshape(3, 3)))
        error = np.concatenate([gamma, bias + bias_slope * h - predicted.vector])
        assert error @ np.linalg.solve(predicted.shape, error) <= 1


# --- quadrics --------------------------------------------------------------------------------------------------------


def test_what_the_slacks_of_quadrics_are():
    """16.1 to 16.3: a cone's by the angle, an attitude's by the error about it, a direction's angle by sampling."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        center, gamma = rotation(rng), rng.standard_normal(3)
        attitude = center @ so3.cayley(0.5 * gamma)
        e, b, r = direction(rng), direction(rng), rng.uniform(0.01, 3)
        angle = math.acos(np.clip(attitude.T @ e @ b, -1, 1))
        cone = quadrics.cone(center, 2 * e, 3 * b, r)
        expected = (1 + gamma @ gamma / 4) * (1 - (math.sin(angle / 2) / math.sin(r / 2)) ** 2)
        assert quadrics.slack(cone, gamma) == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert quadrics.slack(cone, gamma) <= 1 + gamma @ gamma / 4

        measured, bound = center @ so3.cayley(0.5 * rng.standard_normal(3)), random_shape(rng, 3, 0.01, 1)
        quadric = quadrics.attitude_quadric(center, measured, bound)
        seen = 2 * so3.cayley_inverse(measured.T @ attitude)
        longest = math.sqrt(np.linalg.eigvalsh(bound)[-1])
        tau = 2 * math.tan(longest / 2) / longest
        weight = 1 + so3.cayley_inverse(center.T @ measured) @ gamma / 2
        form = seen @ np.linalg.solve(tau**2 * bound, seen)
        assert quadrics.slack(quadric, gamma) == pytest.approx(weight**2 * (1 - form), rel=1e-9, abs=1e-7)
        inside = np.linalg.cholesky(bound) @ direction(rng) * rng.uniform()
        state = 2 * so3.cayley_inverse(center.T @ measured @ so3.exp(inside))
        assert quadrics.slack(quadric, state) >= -1e-9 * (1 + state @ state)

        s = random_shape(rng, 3, 0.01, 1)
        turned = so3.exp(np.linalg.cholesky(s) @ direction(rng)) @ b
        assert math.acos(np.clip(turned @ b, -1, 1)) <= quadrics.angle_bound(b, s) + 1e-9
        h = rng.standard_normal((2, 6))
        shape = random_shape(rng, 6, 0.01, 1)
        y = np.linalg.cholesky(shape) @ direction(rng, 6)
        zeta = so3.log(so3.cayley(0.5 * y[:3]))
        v = np.linalg.cholesky(bound[:2, :2]) @ direction(rng, 2)
        linear = quadrics.linear_quadric(h @ np.concatenate([zeta, y[3:]]) + v, h, bound[:2, :2], shape)
        assert quadrics.slack(linear, y) >= 0


@pytest.mark.parametrize("criterion", ["volume", "trace"])
def test_the_objective_of_fusion(criterion):
    """16.5: its slope and curvature by differences, its minimum by the sizes of members, its scale."""
    rng = np.random.default_rng(2)
    for _ in range(5):
        shapes = [random_shape(rng, 6) for _ in range(4)]
        some = [quadrics.ellipsoid_quadric(0.3 * rng.standard_normal(6), shape) for shape in shapes]
        weight = random_shape(rng, 6) if criterion == "trace" else None
        mu = rng.uniform(0.2, 1.0, 4)
        eps = 1e-5
        slope, curvature = (f(some, mu, criterion, weight) for f in (quadrics.gradient, quadrics.hessian))
        for k, unit in enumerate(np.eye(4)):
            ends = [quadrics.objective(some, mu + sign * eps * unit, criterion, weight) for sign in (1, -1)]
            assert (ends[0] - ends[1]) / (2 * eps) == pytest.approx(slope[k], rel=1e-6, abs=1e-6)
            ends = [quadrics.gradient(some, mu + sign * eps * unit, criterion, weight) for sign in (1, -1)]
            np.testing.assert_allclose((ends[0] - ends[1]) / (2 * eps), curvature[k], rtol=1e-6, atol=1e-6)
        best = quadrics.best_multipliers(some, np.ones(4), criterion, weight)
        least = quadrics.log_size(quadrics.family_member(some, best)[1], criterion, weight)
        for _ in range(30):
            other = quadrics.family_member(some, rng.exponential(size=4))[1]
            assert quadrics.log_size(other, criterion, weight) >= least - 1e-12
        assert quadrics.level(quadrics.combined(some, best)) == pytest.approx(6, rel=1e-8)


def test_a_set_put_about_its_own_center():
    """16.3: the Gibbs vector seen from another, and every state of the set in the recentred one."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        about = GibbsSet(rotation(rng), rng.standard_normal(3), np.eye(6))
        center, shape = 0.7 * rng.standard_normal(6), random_shape(rng, 6, 1e-3, 0.3)
        moved = quadrics.recentred(about, center, shape)
        for _ in range(50):
            y = center + np.linalg.cholesky(shape) @ direction(rng, 6)
            attitude, vector = about.attitude @ so3.cayley(0.5 * y[:3]), about.vector + y[3:]
            g = so3.cayley_inverse(moved.attitude.T @ attitude)
            np.testing.assert_allclose(quadrics.moved_error(0.5 * y[:3], 0.5 * center[:3]), g, atol=1e-9 * (1 + g @ g))
            error = np.concatenate([2 * g, vector - moved.vector])
            assert error @ np.linalg.solve(moved.shape, error) <= 1


# --- the core's fusion against the reference -------------------------------------------------------------------------


def standing_flow():
    return el.GuaranteedRigidBodyFlow(el.RigidBody(np.eye(3)), step=0.1)


def before_recentring(about, found):
    """The center and the shape in the coordinates about a set's center, of a result about its own: 16.3 undone."""
    g = so3.cayley_inverse(about.attitude.T @ found.attitude)
    center = np.concatenate([2 * g, found.vector - about.vector])
    inverse = np.eye(6)
    inverse[:3, :3] = np.linalg.inv((np.eye(3) - so3.hat(g)) / (1 + g @ g))
    shape = found.shape
    for _ in range(60):  # what recentring adds is a small part of the shape, and known the better the shape is known
        e = math.sqrt(g @ (inverse @ shape @ inverse.T)[:3, :3] @ g) / (2 * (1 + g @ g))
        factor = e / (1 - e)
        shape = shape + found.shape - quadrics.with_attitude_added(shape, factor)
    return center, inverse @ shape @ inverse.T


class Fusion:
    """A truth, a prediction about it, and measurements of some kinds that hold for it."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        size = 10 ** rng.uniform(-3, -0.7)
        shape = size**2 * random_shape(rng, 6, 10 ** rng.uniform(-3, -1), 1.0)
        self.prediction = GibbsSet(rotation(rng), rng.standard_normal(3), shape)
        self.error = np.linalg.cholesky(shape) @ direction(rng, 6) * rng.uniform()
        attitude = self.prediction.attitude @ so3.cayley(0.5 * self.error[:3])
        vector = self.prediction.vector + self.error[3:]
        self.given = {}
        count = int(rng.integers(0, 5))
        if count > 0:
            bounds = size * 10 ** rng.uniform(-1, 0.5, count)
            body = [direction(rng) for _ in range(count)]
            turns = [rng.uniform(0.3, 1) * r * np.cross(b, direction(rng)) for r, b in zip(bounds, body, strict=True)]
            self.given["directions"] = [Rotation.from_rotvec(t).apply(b) for t, b in zip(turns, body, strict=True)]
            self.given["reference"] = [attitude @ b for b in body]
            self.given["bounds"] = bounds
        if rng.random() < 0.5 or count == 0:
            bound = (size * 10 ** rng.uniform(-1, 0.3)) ** 2 * random_shape(rng, 3, 0.1, 1.0)
            self.given["angular_velocity"] = vector + 0.9 * np.linalg.cholesky(bound) @ direction(rng)
            self.given["rate_bound"] = bound
        if rng.random() < 0.4:
            bound = (size * 10 ** rng.uniform(-1, 0.3)) ** 2 * random_shape(rng, 3, 0.1, 1.0)
            self.given["attitude"] = attitude @ so3.exp(0.9 * np.linalg.cholesky(bound) @ direction(rng))
            self.given["attitude_bound"] = bound

    def measured(self, about):
        """The quadrics about a center, in the core's order."""
        some = [
            quadrics.of_attitude(quadrics.cone(about.attitude, e, b, r))
            for e, b, r in zip(*(self.given.get(k, []) for k in ("reference", "directions", "bounds")), strict=True)
        ]
        if "angular_velocity" in self.given:
            offset = self.given["angular_velocity"] - about.vector
            some.append(quadrics.of_vector(quadrics.ellipsoid_quadric(offset, self.given["rate_bound"])))
        if "attitude" in self.given:
            measured, bound = self.given["attitude"], self.given["attitude_bound"]
            some.append(quadrics.of_attitude(quadrics.attitude_quadric(about.attitude, measured, bound)))
        return some

    def start(self):
        p = self.prediction
        return el.StateEllipsoid(p.attitude, p.vector, p.shape, chart="gibbs")


def assert_member(some, center, shape, relative=1e-8):
    """A set is the bound that some multipliers give, which are found: with N = 1, sum mu_k A_k = P^-1 is linear.

    The core makes sets wider for rounding by about 100 epsilon times the square of how much sharper a measurement is
    than the prediction (16.6), here up to 1e-10.
    """
    root = np.linalg.cholesky(shape)
    columns = np.array([(root.T @ q.a @ root).ravel() for q in some]).T
    multipliers = np.linalg.lstsq(columns, np.eye(len(shape)).ravel(), rcond=None)[0]
    np.testing.assert_allclose(columns @ multipliers, np.eye(len(shape)).ravel(), atol=relative)
    assert multipliers.min() >= -relative * multipliers.max()
    assert quadrics.level(quadrics.combined(some, multipliers)) == pytest.approx(1, abs=relative)
    expected = quadrics.family_member(some, multipliers)[0]
    np.testing.assert_allclose(np.linalg.solve(root, center), np.linalg.solve(root, expected), atol=relative)
    return multipliers


def assert_near_best(some, multipliers, shape, criterion, weight=None):
    """That log det P, or n log tr(W P), is above its least by no more than the core promises: 1e-3 in F (16.5)."""
    start = np.maximum(multipliers, 1e-3 * multipliers.max())  # any will do
    best = quadrics.best_multipliers(some, start, criterion, weight)
    slope = best * quadrics.gradient(some, best, criterion, weight)
    assert slope.min() > -1e-6  # of a convex function: what is left of the minimum is at most the sum
    assert slope.sum() < 1e-6
    least = quadrics.log_size(quadrics.family_member(some, best)[1], criterion, weight)
    gap = quadrics.log_size(shape, criterion, weight) - least
    assert -1e-9 <= gap <= 1e-3
    return gap


@pytest.mark.parametrize("criterion", ["volume", "trace", "weighted_trace"])
def test_fusions_are_near_the_best_of_their_family(criterion):
    alone, gaps = 0, []
    for seed in range(60):
        fusion = Fusion(seed)
        weight = np.diag([4.0, 1, 1, 0.3, 0.3, 2]) if criterion == "weighted_trace" else None
        filter_ = el.GuaranteedFilter(standing_flow(), fusion.start(), criterion=criterion, weight=weight)
        update = filter_.update(**fusion.given)
        found, about = filter_.ellipsoid, fusion.prediction
        measured = fusion.measured(about)
        some = [quadrics.ellipsoid_quadric(np.zeros(6), about.shape), *measured]
        # The margin is not below what the truth leaves of each constraint as given.
        assert update.margin >= min(quadrics.slack(q, fusion.error) for q in some) - 1e-9
        kind = "volume" if criterion == "volume" else "trace"
        if np.array_equal(found.shape, about.shape):
            # n s_k(0) >= tr(A_k): no measurement makes F smaller from the prediction alone, or by next to nothing.
            only = np.array([6.0, *[0.0] * len(measured)])
            alone += quadrics.gradient(some, only, kind, weight).min() >= -1e-9
            assert_near_best(some, only, about.shape, kind, weight)
            continue
        center, shape = before_recentring(about, found)
        multipliers = assert_member(some, center, shape)
        gaps.append(assert_near_best(some, multipliers, shape, kind, weight))
        expected = quadrics.recentred(about, *quadrics.family_member(some, multipliers))
        assert_same_set(found, expected, relative=1e-8)
    assert 0 < alone < 15
    assert np.max(gaps) > 1e-6


def wahba_center(fusion):
    """Where the coordinates begin without a prediction: at Wahba's solution with weights 1/tr(bound), and the rate."""
    e, b, r = (np.array(fusion.given[k]) for k in ("reference", "directions", "bounds"))
    return GibbsSet(wahba.solve_svd(e, b, 1 / r**2), fusion.given["angular_velocity"], np.eye(6))


def test_margins():
    """16.5: not below min N / sum mu, for two ellipsoids (7.8), and negative if that is."""
    disjoint = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        fusion = Fusion(seed)
        prediction = fusion.prediction
        bound = prediction.shape[3, 3] * random_shape(rng, 3, 0.1, 1.0)
        offset = np.linalg.cholesky(prediction.shape[3:, 3:]) @ direction(rng) * rng.uniform(1.0, 2.5)
        least = ellipsoid.overlap_margin(np.zeros(3), prediction.shape[3:, 3:], offset, bound)
        filter_ = el.GuaranteedFilter(standing_flow(), fusion.start())
        rate = {"angular_velocity": prediction.vector + offset, "rate_bound": bound}
        if least < 0:
            disjoint += 1
            with pytest.raises(el.InconsistentMeasurement) as caught:
                filter_.update(**rate)
            assert least - 1e-9 <= caught.value.margin < 0
        else:
            assert filter_.update(**rate).margin >= least - 1e-9
    assert 10 < disjoint < 50


def test_fusions_without_a_prediction():
    tried = 0
    for seed in range(200):
        fusion = Fusion(seed)
        if not {"directions", "angular_velocity"} <= set(fusion.given) or "attitude" in fusion.given:
            continue
        if len(fusion.given["directions"]) < 2:
            continue
        filter_ = el.GuaranteedFilter(standing_flow())
        if filter_.update(**fusion.given).claim == "none":
            continue
        about = wahba_center(fusion)
        some = fusion.measured(about)
        center, shape = before_recentring(about, filter_.ellipsoid)
        multipliers = assert_member(some, center, shape, relative=1e-7)
        assert_near_best(some, multipliers, shape, "volume")
        tried += 1
    assert tried > 20


def test_a_vector_that_is_not_estimated():
    """16.7: the attitude's quadrics by themselves in three dimensions, and the vector's bound beside them."""
    for seed in range(40):
        fusion = Fusion(seed)
        given = {k: v for k, v in fusion.given.items() if k not in ("angular_velocity", "rate_bound")}
        if not given:
            continue
        fusion.given = given
        about = fusion.prediction
        vector, bound = about.vector + 0.01, 1e-4 * np.diag([1.0, 2.0, 3.0])
        filter_ = el.GuaranteedFilter(
            el.GuaranteedGyroFlow(1e-3), fusion.start(), vector_bound=(vector, bound), estimate_vector=False
        )
        filter_.update(**given)
        center, shape = before_recentring(about, filter_.ellipsoid)
        if np.array_equal(filter_.ellipsoid.attitude, about.attitude):
            assert_same_shape(shape[:3, :3], about.shape[:3, :3], relative=1e-8)
        else:
            some = [quadrics.ellipsoid_quadric(np.zeros(3), about.shape[:3, :3])]
            some += [quadrics.Quadric(q.a[:3, :3], q.g[:3], q.c) for q in fusion.measured(about)]
            multipliers = assert_member(some, center[:3], shape[:3, :3])
            assert_near_best(some, multipliers, shape[:3, :3], "volume")
        assert_close(filter_.ellipsoid.vector, vector, relative=1e-13)
        assert_same_shape(filter_.ellipsoid.shape[3:, 3:], bound, relative=1e-12)
        assert not filter_.ellipsoid.shape[:3, 3:].any()


def test_linear_measurements():
    for seed in range(30):
        fusion, rng = Fusion(seed), np.random.default_rng(seed)
        about, rows = fusion.prediction, int(rng.integers(1, 4))
        h = rng.standard_normal((rows, 6))
        bound = 0.3 * h @ about.shape @ h.T + 1e-3 * about.shape[0, 0] * np.eye(rows)
        zeta = so3.log(so3.cayley(0.5 * fusion.error[:3]))
        y = h @ np.concatenate([zeta, fusion.error[3:]]) + 0.5 * np.linalg.cholesky(bound) @ direction(rng, rows)
        filter_ = el.GuaranteedFilter(standing_flow(), fusion.start())
        filter_.update_linear(y, h, bound)
        if np.array_equal(filter_.ellipsoid.shape, about.shape):
            continue
        some = [
            quadrics.ellipsoid_quadric(np.zeros(6), about.shape),
            quadrics.linear_quadric(y, h, bound, about.shape),
        ]
        center, shape = before_recentring(about, filter_.ellipsoid)
        assert_near_best(some, assert_member(some, center, shape), shape, "volume")


def worn(rng, attitude):
    """An attitude stored with half the digits: a rotation times a stretch, of which it is the nearest."""
    stretch = 7e-9 * rng.choice([-1, 1], (3, 3))
    return attitude @ (np.eye(3) + np.triu(stretch) + np.triu(stretch, 1).T)


def test_a_start_from_an_attitude_with_half_the_digits():
    """A filter that knows nothing begins its coordinates at the measured attitude, which cones take for a rotation."""
    rng = np.random.default_rng(0)
    r = 1e-6
    for _ in range(30):
        truth = rotation(rng)
        measured = worn(rng, truth @ so3.exp(3e-4 * direction(rng)))
        reference = Rotation.random(rng=rng).as_matrix()
        exact = reference @ truth
        across = np.cross(exact, rng.standard_normal((3, 3)))
        turns = 0.999 * r * across / np.linalg.norm(across, axis=1)[:, None]
        body = Rotation.from_rotvec(turns).apply(exact)
        filter_ = el.GuaranteedFilter(el.GuaranteedGyroFlow(1e-3), vector_bound=0.01, estimate_vector=False)
        filter_.update(body, reference, r, attitude=measured, attitude_bound=1e-3)
        assert filter_.ellipsoid.contains(truth, np.zeros(3))


def test_an_attitude_with_half_the_digits_far_from_the_prediction():
    rng = np.random.default_rng(1)
    r = 1e-5
    for _ in range(200):
        center = rotation(rng)
        measured = center @ so3.exp(0.8 * direction(rng))
        truth = measured @ so3.exp((1 - 1e-9) * r * direction(rng))
        start = el.StateEllipsoid(center, np.zeros(3), np.eye(6), chart="gibbs")
        # Only the attitude, so that the set is as small as the measurement.
        flow = el.GuaranteedGyroFlow(1e-3)
        filter_ = el.GuaranteedFilter(flow, start, vector_bound=1e-6, estimate_vector=False)
        filter_.update(attitude=worn(rng, measured), attitude_bound=r)
        assert filter_.ellipsoid.contains(truth, np.zeros(3))


def test_updates_alone_leave_the_center_a_rotation():
    rng = np.random.default_rng(2)
    truth = rotation(rng)
    start = el.StateEllipsoid(truth @ so3.exp(0.3 * direction(rng)), np.zeros(3), np.eye(6), chart="gibbs")
    filter_ = el.GuaranteedFilter(standing_flow(), start)
    moved = 0
    for k in range(600):
        before = filter_.ellipsoid.attitude
        # Ever sharper, so that each one moves the center.
        bound = 0.5 * 0.98**k
        filter_.update(attitude=truth @ so3.exp(0.5 * bound * direction(rng)), attitude_bound=bound)
        moved += not np.array_equal(filter_.ellipsoid.attitude, before)
    attitude = filter_.ellipsoid.attitude
    assert moved > 500
    assert np.abs(attitude.T @ attitude - np.eye(3)).max() < 4 * np.finfo(float).eps


@pytest.mark.parametrize("ratio", [1e-3, 1e-5, 1e-6])
def test_thin_sets_become_wider_alike(ratio):
    """17.9: of sets as thin as these the share of least volume is not the one that is taken."""
    rng = np.random.default_rng(round(-10 * np.log10(ratio)))
    axes = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    shape = axes @ np.diag((0.05 * ratio ** np.linspace(0, 1, 6)) ** 2) @ axes.T
    shape = 0.5 * (shape + shape.T)
    attitude, vector, rate = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3), rng.normal(size=3)
    uncertainty = GyroUncertainty()
    expected = guaranteed_flow.predict_gyro(GibbsSet(attitude, vector, shape), rate, 0.01, uncertainty, "mean")
    filter_ = el.GuaranteedFilter(
        el.GuaranteedGyroFlow(0.0, interval_rate="mean"), el.StateEllipsoid(attitude, vector, shape, chart="gibbs")
    )
    filter_.predict(0.01, gyro=rate)
    assert_same_shape(filter_.ellipsoid.shape, expected.shape, relative=1e-4)
