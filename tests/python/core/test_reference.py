"""The NumPy reference against what it does not know: SciPy, mpmath, central differences,
known answers, sampling."""

import itertools

import mpmath
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize
from reference import ellipsoid, gyro, integrator, linearization, measurement, rigid_body, so3, wahba
from reference import filter as attitude_filter
from reference.ellipsoid import StateEllipsoid
from reference.rigid_body import RigidBody, State
from scipy.spatial.transform import Rotation

ROUNDING = 1e-14


def random_rotation(rng):
    return Rotation.random(rng=rng).as_matrix()


def random_shape(rng, n):
    factor = rng.standard_normal((n, n))
    return factor @ factor.T + 0.1 * np.eye(n)


def random_direction(rng, n):
    vector = rng.standard_normal(n)
    return vector / np.linalg.norm(vector)


def points_in(rng, centre, shape, count):
    """Uniform points of an ellipsoid, as rows."""
    n = len(centre)
    ball = rng.standard_normal((count, n))
    ball *= rng.random((count, 1)) ** (1 / n) / np.linalg.norm(ball, axis=1)[:, None]
    return centre + ball @ np.linalg.cholesky(shape).T


def central_difference(function, n, step):
    """The Jacobian at zero, with an error of fourth order in the step."""
    columns = []
    for direction in np.eye(n):
        near = function(step * direction) - function(-step * direction)
        far = function(2 * step * direction) - function(-2 * step * direction)
        columns.append((8 * near - far) / (12 * step))
    return np.array(columns).T


# so3

ROTATION_VECTORS = [
    angle * axis / np.linalg.norm(axis)
    for angle in (0.0, 1e-200, 1e-9, 1e-4, 0.3, 0.999, 1.001, 1.999, 2.001, 3.0)
    for axis in (np.array([1.0, 0.0, 0.0]), np.array([-0.3, 0.5, 0.9]))
]


@pytest.mark.parametrize("zeta", ROTATION_VECTORS)
def test_exp_and_jacobians_against_matrix_exponentials(zeta):
    skew = so3.hat(zeta)
    with mpmath.workdps(40):
        exact = mpmath.expm(mpmath.matrix(skew.tolist()))
        # The corner block of this exponential is the integral of exp(s S), s in (0, 1),
        # which is the left Jacobian.
        block = mpmath.zeros(6)
        block[:3, :3] = mpmath.matrix(skew.tolist())
        block[:3, 3:] = mpmath.eye(3)
        left = mpmath.expm(block)[:3, 3:]
        left_inverse = left**-1
    expected = {
        so3.exp: exact,
        so3.left_jacobian: left,
        so3.right_jacobian: left.T,
        so3.left_jacobian_inverse: left_inverse,
        so3.right_jacobian_inverse: left_inverse.T,
    }
    for function, value in expected.items():
        np.testing.assert_allclose(function(zeta), np.array(value.tolist(), dtype=float), atol=1e-15 * 4)


@pytest.mark.parametrize("zeta", ROTATION_VECTORS)
def test_log_and_cayley_undo(zeta):
    np.testing.assert_allclose(so3.log(so3.exp(zeta)), zeta, atol=ROUNDING)
    angle = np.linalg.norm(zeta)
    axis = zeta / angle if angle > 0 else np.zeros(3)
    c = np.tan(angle / 2) * axis
    np.testing.assert_allclose(so3.cayley(c), so3.exp(zeta), atol=ROUNDING)
    # Near a half turn c grows like 2 / (pi - angle): relative accuracy is what it has.
    np.testing.assert_allclose(so3.cayley_inverse(so3.cayley(c)), c, rtol=1e-13, atol=ROUNDING)


def test_log_against_scipy_up_to_pi():
    rng = np.random.default_rng(1)
    for gap in (1e-1, 1e-4, 1e-8, 1e-12, 0.0):
        zeta = (np.pi - gap) * random_direction(rng, 3)
        result = so3.log(so3.exp(zeta))
        np.testing.assert_allclose(np.linalg.norm(result), np.pi - gap, atol=ROUNDING)
        if gap > 0:
            np.testing.assert_allclose(result, zeta, atol=ROUNDING)
    rotation = random_rotation(rng)
    np.testing.assert_allclose(so3.log(rotation), so3.vee(scipy.linalg.logm(rotation)), atol=1e-13)


def test_quaternions_against_scipy():
    rng = np.random.default_rng(2)
    rotations = [random_rotation(rng) for _ in range(50)]
    rotations += [np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.eye(3)]
    for rotation in rotations:
        quaternion = so3.quaternion_from_rotation(rotation)
        expected = Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)
        assert quaternion[0] >= 0
        assert abs(quaternion @ expected) == pytest.approx(1, abs=1e-15)
        np.testing.assert_allclose(so3.rotation_from_quaternion(3 * quaternion), rotation, atol=ROUNDING)


def test_nearest_rotation():
    rng = np.random.default_rng(3)
    matrix = so3.exp([0.4, 2.0, -1.0]) + 0.1 * rng.standard_normal((3, 3))
    polar, _ = scipy.linalg.polar(matrix)
    np.testing.assert_allclose(so3.nearest_rotation(matrix), polar, atol=ROUNDING)
    reflected = so3.nearest_rotation(-matrix)
    assert np.linalg.det(reflected) == pytest.approx(1)
    for _ in range(100):
        other = reflected @ so3.exp(rng.standard_normal(3))
        assert np.linalg.norm(other + matrix) > np.linalg.norm(reflected + matrix)


# ellipsoid


def test_margin_known_answers_and_brute_force():
    ball, origin = np.eye(3), np.zeros(3)
    for distance, margin in ((1.0, 0.75), (2.0, 0.0), (2.2, -0.21)):
        offset = np.array([distance, 0.0, 0.0])
        assert ellipsoid.overlap_margin(origin, ball, offset, ball) == pytest.approx(margin, abs=ROUNDING)
    rng = np.random.default_rng(4)
    for _ in range(20):
        p1, p2, d = random_shape(rng, 3), random_shape(rng, 3), rng.normal(size=3)
        brute = scipy.optimize.minimize_scalar(
            lambda s, p1=p1, p2=p2, d=d: 1 - s * (1 - s) * d @ np.linalg.inv(s * p1 + (1 - s) * p2) @ d,
            bounds=(0, 1),
            method="bounded",
            options={"xatol": 1e-12},
        ).fun
        assert ellipsoid.overlap_margin(origin, p1, d, p2) == pytest.approx(brute, abs=1e-13)


def test_intersection_known_answers():
    ball, origin = np.eye(3), np.zeros(3)
    offset = np.array([1.0, 0.0, 0.0])
    centre, shape = ellipsoid.intersection(origin, ball, offset, ball)
    np.testing.assert_allclose(centre, [0.5, 0, 0], atol=ROUNDING)
    np.testing.assert_allclose(shape, 0.75 * ball, atol=ROUNDING)
    with pytest.raises(ellipsoid.EmptyIntersection):
        ellipsoid.intersection(origin, ball, 2.2 * offset, ball)

    origin = np.zeros(2)
    p1, p2, p3 = np.diag([4.0, 1]), np.diag([1.0, 4]), np.diag([1.0, 9])
    for criterion in ("trace", "volume"):
        _, shape = ellipsoid.intersection(origin, p1, origin, p2, criterion)
        np.testing.assert_allclose(shape, 1.6 * np.eye(2), atol=ROUNDING)
    _, shape = ellipsoid.intersection(origin, p1, origin, p3)
    assert np.trace(shape) == pytest.approx(3.36536439505, abs=1e-11)
    np.testing.assert_allclose(np.diag(shape), [1.75411076, 1.61125363], atol=1e-8)
    _, shape = ellipsoid.intersection(origin, p1, origin, p3, "volume")
    assert np.log(np.linalg.det(shape)) == pytest.approx(1.037171007, abs=1e-9)


@pytest.mark.parametrize("criterion", ["trace", "volume"])
def test_intersection_contains_and_is_least(criterion):
    rng = np.random.default_rng(5)
    weight = random_shape(rng, 6)
    for _ in range(5):
        p1, p2 = random_shape(rng, 6), random_shape(rng, 6)
        offset = 0.5 * np.linalg.cholesky(p1) @ random_direction(rng, 6)
        centre, shape = ellipsoid.intersection(np.zeros(6), p1, offset, p2, criterion, weight)
        points = points_in(rng, np.zeros(6), p1, 5000)
        for point in points:
            if ellipsoid.quadratic_form(point, offset, p2) <= 1:
                assert ellipsoid.quadratic_form(point, centre, shape) <= 1 + 1e-12

        def printed_size(log_q, p1=p1, p2=p2, offset=offset):
            """The size by xhatP, betaq and LP exactly as the paper prints them."""
            q = np.exp(log_q)
            gain = p1 @ np.linalg.inv(p1 + p2 / q)
            beta = 1 + q - offset @ np.linalg.inv(p1) @ gain @ offset
            member = beta * (np.eye(6) - gain) @ p1
            return ellipsoid.log_size(member, criterion, weight)

        least = min(
            scipy.optimize.minimize_scalar(printed_size, bounds=bounds).fun
            for bounds in itertools.pairwise(np.linspace(-25, 25, 11))
        )
        least = min(
            least,
            ellipsoid.log_size(p1, criterion, weight),
            ellipsoid.log_size(p2, criterion, weight),
        )
        assert ellipsoid.log_size(shape, criterion, weight) == pytest.approx(least, abs=1e-9)


def test_intersection_end_points():
    small, large, origin = np.eye(3), 1e3 * np.eye(3), np.zeros(3)
    offset = np.array([0.1, 0.0, 0.0])
    assert ellipsoid.intersection_multiplier(offset, small, large) == 0.0
    assert ellipsoid.intersection_multiplier(offset, large, small) == np.inf
    centre, shape = ellipsoid.intersection(origin, large, offset, small)
    np.testing.assert_array_equal(centre, offset)
    np.testing.assert_array_equal(shape, small)


def test_sum_contains_and_is_least():
    shapes = [np.diag([4.0, 1]), np.diag([1.0, 9])]
    trace = np.trace(ellipsoid.sum_minimum_trace(shapes))
    assert trace == pytest.approx((5**0.5 + 10**0.5) ** 2, abs=1e-13)

    rng = np.random.default_rng(6)
    shapes = [random_shape(rng, 3) for _ in range(3)] + [np.zeros((3, 3))]
    shapes.append(np.outer([1.0, 2, 3], [1.0, 2, 3]))  # a segment
    weight = random_shape(rng, 3)
    outer = {
        "trace": ellipsoid.sum_minimum_trace(shapes, weight),
        "volume": ellipsoid.sum_minimum_volume(shapes),
    }
    origin = np.zeros(3)
    for criterion, shape in outer.items():
        for _ in range(200):
            direction = random_direction(rng, 3)
            exact = sum(ellipsoid.support(direction, origin, p) for p in shapes)
            assert ellipsoid.support(direction, origin, shape) >= exact * (1 - 1e-14)

        def size(log_share, criterion=criterion):
            share = np.exp(log_share) / np.sum(np.exp(log_share))
            terms = [p / s for p, s in zip(shapes[:3] + shapes[4:], share, strict=True)]
            return ellipsoid.log_size(sum(terms), criterion, weight)

        least = scipy.optimize.minimize(size, np.zeros(4), tol=1e-12).fun
        assert ellipsoid.log_size(shape, criterion, weight) == pytest.approx(least, abs=1e-9)
        assert ellipsoid.log_size(shape, criterion, weight) <= least + 1e-13


def test_affine_image_and_log_volume():
    rng = np.random.default_rng(7)
    shape, matrix = random_shape(rng, 3), rng.standard_normal((3, 3))
    centre, image = ellipsoid.affine_image(matrix, np.ones(3), np.ones(3), shape)
    for point in points_in(rng, np.ones(3), shape, 20):
        assert ellipsoid.quadratic_form(matrix @ point + 1, centre, image) == pytest.approx(
            ellipsoid.quadratic_form(point, np.ones(3), shape)
        )
    assert ellipsoid.log_volume(np.diag([4.0, 9, 25])) == pytest.approx(np.log(4 / 3 * np.pi * 30))


def test_combined_quadrics_are_the_paper_family():
    rng = np.random.default_rng(8)
    p1, p2 = random_shape(rng, 4), random_shape(rng, 4)
    offset, q = 0.3 * random_direction(rng, 4), 0.7
    i1, i2 = np.linalg.inv(p1), np.linalg.inv(p2)
    quadrics = ([i1, i2], [np.zeros(4), -i2 @ offset], [1, 1 - offset @ i2 @ offset])
    combined = ellipsoid.combine_quadrics(*quadrics, [1.0, q])
    for ours, papers in zip(combined, ellipsoid.intersection_member(offset, p1, p2, q), strict=True):
        np.testing.assert_allclose(ours, papers, atol=1e-12)
    with pytest.raises(np.linalg.LinAlgError):
        ellipsoid.combine_quadrics(*quadrics, [1.0, -10.0])
    far = 100 * offset
    with pytest.raises(ellipsoid.EmptyIntersection):
        ellipsoid.combine_quadrics([i1, i2], [np.zeros(4), -i2 @ far], [1, 1 - far @ i2 @ far], [1.0, q])


# rigid_body, integrator, linearization

PRINCIPAL = np.diag([1.0, 2.8, 2.0])
SKEWED = so3.exp([0.3, -0.5, 0.8]) @ PRINCIPAL @ so3.exp([0.3, -0.5, 0.8]).T
POTENTIALS = {
    "free": rigid_body.Free(),
    "uniform gravity": rigid_body.UniformGravity(1.0, 9.81, np.array([0.1, -0.2, 0.3])),
    "gravity gradient": rigid_body.GravityGradient(SKEWED, 1.3),
}
CONTROL = (0.3, -0.2, 0.4)
START = State(so3.exp([1.0, 0.4, -0.3]), np.array([0.9, -0.5, 1.2]), 0.7)


@pytest.fixture(params=POTENTIALS)
def body(request):
    return RigidBody(SKEWED, POTENTIALS[request.param])


def perturbed(state, x):
    """The state whose error about ``state`` is x = [zeta; delta omega]."""
    attitude = state.attitude @ so3.exp(x[:3])
    return State(attitude, state.angular_velocity + x[3:], state.time)


def error(centre, state):
    zeta = so3.log(centre.attitude.T @ state.attitude)
    return np.concatenate([zeta, state.angular_velocity - centre.angular_velocity])


def continuous_end(body, state, duration, control=integrator.NO_TORQUE):
    packed = np.concatenate([state.attitude.ravel(), state.angular_velocity])
    solution = scipy.integrate.solve_ivp(
        integrator.continuous_rate,
        (state.time, state.time + duration),
        packed,
        method="DOP853",
        rtol=1e-13,
        atol=1e-14,
        args=(body, control),
    ).y[:, -1]
    return State(solution[:9].reshape(3, 3), solution[9:], state.time + duration)


def test_torque_is_what_the_energy_says(body):
    potential, attitude, time = body.potential, START.attitude, START.time
    gradient = potential.gradient(attitude, time)
    torque = potential.torque(attitude, time)
    skew = gradient.T @ attitude - attitude.T @ gradient
    np.testing.assert_allclose(so3.hat(torque), skew, atol=ROUNDING)
    np.testing.assert_allclose(rigid_body.torque_from_gradient(attitude, gradient), torque, atol=ROUNDING)
    slope = central_difference(lambda zeta: potential.energy(attitude @ so3.exp(zeta), time), 3, 1e-3)
    np.testing.assert_allclose(-slope, torque, atol=1e-11)
    jacobian = central_difference(lambda zeta: potential.torque(attitude @ so3.exp(zeta), time), 3, 1e-3)
    np.testing.assert_allclose(jacobian, potential.torque_jacobian(attitude, time), atol=1e-10)


def test_rigid_body_figures():
    np.testing.assert_allclose(rigid_body.nonstandard_inertia(PRINCIPAL), np.diag([1.9, 0.1, 0.9]))
    assert rigid_body.kinetic_energy(PRINCIPAL, np.array([1.0, 2, 3])) == 15.1
    body = RigidBody(PRINCIPAL, POTENTIALS["uniform gravity"])
    state = State(np.eye(3), np.array([1.0, 2, 3]), 0.0)
    assert rigid_body.total_energy(body, state) == pytest.approx(15.1 - 9.81 * 0.3)


def test_relative_attitude_solves_findf0_three_ways():
    j_d = rigid_body.nonstandard_inertia(SKEWED)
    for h in (1e-3, 0.1, 0.3):
        a = SKEWED @ START.angular_velocity
        solutions = [
            solve(SKEWED, a, h)
            for solve in (
                integrator.relative_attitude_exponential,
                integrator.relative_attitude_cayley,
                integrator.relative_attitude_matrix,
            )
        ]
        for relative in solutions:
            np.testing.assert_allclose(relative @ j_d - j_d @ relative.T, h * so3.hat(a), atol=ROUNDING)
            np.testing.assert_allclose(relative, solutions[0], atol=ROUNDING)
            np.testing.assert_allclose(relative.T @ relative, np.eye(3), atol=ROUNDING)


@pytest.mark.parametrize(
    "solve",
    [
        integrator.relative_attitude_exponential,
        integrator.relative_attitude_cayley,
        integrator.relative_attitude_matrix,
    ],
)
def test_spin_about_a_principal_axis(solve):
    """sin(turn) = h |omega|: solvable up to one (theory 4)."""
    a = PRINCIPAL @ np.array([0.0, 9.9, 0.0])
    np.testing.assert_allclose(so3.log(solve(PRINCIPAL, a, 0.1)), [0, np.arcsin(0.99), 0], atol=1e-13)
    with pytest.raises(integrator.StepTooLong):
        solve(PRINCIPAL, a, 0.12)


@pytest.mark.parametrize("order", [2, 4, 6, 8])
def test_order_of_convergence_with_control(body, order):
    duration = 1.2
    exact = continuous_end(body, START, duration, CONTROL)
    steps = {2: (40, 80), 4: (24, 48), 6: (12, 24), 8: (6, 12)}[order]
    sizes = []
    for count in steps:
        end = integrator.integrate(body, START, duration / count, count, order, CONTROL)
        assert end.time == pytest.approx(exact.time)
        sizes.append(np.linalg.norm(error(exact, end)))
    assert sizes[1] > 1e-12  # above the rounding of either
    assert np.log2(sizes[0] / sizes[1]) == pytest.approx(order, abs=0.5)


@pytest.mark.parametrize("order", [2, 4, 6, 8])
def test_stages_are_symmetric_and_complete(order):
    stages = integrator.composition_stages(order)
    assert len(stages) == {2: 1, 4: 5, 6: 9, 8: 17}[order]
    assert stages == stages[::-1]
    assert sum(stages) == pytest.approx(1, abs=1e-15)
    # Every order above two needs the sum of the odd powers to vanish.
    for power in range(3, order, 2):
        assert sum(s**power for s in stages) == pytest.approx(0, abs=1e-15)


def test_conservation_on_a_free_body():
    body = RigidBody(SKEWED, rigid_body.Free())
    end = integrator.integrate(body, START, 0.05, 400)
    np.testing.assert_allclose(
        rigid_body.spatial_angular_momentum(SKEWED, end),
        rigid_body.spatial_angular_momentum(SKEWED, START),
        atol=1e-13,  # 400 steps of rounding
    )
    np.testing.assert_allclose(end.attitude.T @ end.attitude, np.eye(3), atol=1e-13)
    energy = rigid_body.total_energy(body, START)
    assert rigid_body.total_energy(body, end) == pytest.approx(energy, rel=0.05**2)


@pytest.mark.parametrize("order", [2, 4, 8])
def test_linearization_against_central_differences(body, order):
    flow = linearization.linearize_flow(body, START, 0.1, 2, order, CONTROL)
    end = integrator.integrate(body, START, 0.1, 2, order, CONTROL)
    np.testing.assert_array_equal(flow.state.attitude, end.attitude)

    def moved(start, control):
        return error(end, integrator.integrate(body, start, 0.1, 2, order, control))

    transition = central_difference(lambda x: moved(perturbed(START, x), CONTROL), 6, 1e-3)
    np.testing.assert_allclose(flow.transition, transition, atol=1e-10)
    control_effect = central_difference(lambda change: moved(START, CONTROL + change), 3, 1e-3)
    np.testing.assert_allclose(flow.control_effect, control_effect, atol=1e-10)
    assert np.linalg.det(flow.transition) == pytest.approx(1, abs=1e-13)


# wahba


def noisy_directions(rng, count, noise):
    attitude = random_rotation(rng)
    reference = np.array([random_direction(rng, 3) for _ in range(count)])
    body = np.array([so3.exp(noise * rng.normal(size=3)) @ b for b in reference @ attitude])
    return reference, body, rng.uniform(0.5, 2, count)


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("noise", [1e-3, 0.3])
def test_attitude_against_scipy(count, noise):
    rng = np.random.default_rng(count)
    for _ in range(10):
        directions = noisy_directions(rng, count, noise)
        solution = wahba.solve_svd(*directions)
        expected, rssd = Rotation.align_vectors(*directions)
        np.testing.assert_allclose(solution, expected.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(wahba.solve_davenport(*directions), solution, atol=1e-12)
        assert wahba.cost(solution, *directions) == pytest.approx(rssd**2 / 2)


def test_qr_formula_and_its_precondition():
    rng = np.random.default_rng(9)
    reference, body, weights = noisy_directions(rng, 4, 0.1)
    np.testing.assert_allclose(
        wahba.solve_qr(reference, body, weights),
        wahba.solve_svd(reference, body, weights),
        atol=1e-12,
    )
    with pytest.raises(ValueError, match="det L"):
        wahba.solve_qr(reference, -body, weights)
    np.testing.assert_allclose(
        wahba.solve_davenport(reference, -body, weights),
        wahba.solve_svd(reference, -body, weights),
        atol=1e-12,
    )


def test_cross_product_direction_and_condition():
    rng = np.random.default_rng(10)
    reference, body, _ = noisy_directions(rng, 2, 0.0)
    e, b = wahba.with_cross_product(reference, body)
    attitude = wahba.solve_qr(e, b, np.ones(3))
    np.testing.assert_allclose(attitude @ b.T, e.T, atol=1e-13)
    axes = np.eye(3)
    assert wahba.condition(axes, axes, axes, np.ones(3)) == pytest.approx(1)
    # A = diag(1, 1, 0), so tr(A) I - A = diag(1, 1, 2).
    assert wahba.condition(axes, axes[:2], axes[:2], np.ones(2)) == pytest.approx(2)


# measurement


def test_direction_sensitivities_against_central_differences():
    rng = np.random.default_rng(11)
    reference, body, weights = noisy_directions(rng, 4, 0.2)
    attitude = wahba.solve_svd(reference, body, weights)
    sensitivities = measurement.direction_sensitivities(attitude, reference, body, weights)
    for i, sensitivity in enumerate(sensitivities):

        def turned(nu, i=i):
            true = body.copy()
            true[i] = so3.exp(nu) @ body[i]
            return so3.log(attitude.T @ wahba.solve_svd(reference, true, weights))

        np.testing.assert_allclose(sensitivity, central_difference(turned, 3, 1e-3), atol=1e-10)


def test_measured_ellipsoid_known_answer():
    """Three axes with S = s^2 I and T = t^2 I, by hand.

    A^i = -(I - e_i e_i') / 2, so that A^i S A^i' = s^2/4 (I - e_i e_i') has trace s^2/2, and
    T has trace 3 t^2.
    """
    s, t, axes = 0.1, 0.3, np.eye(3)
    measured = measurement.measured_ellipsoid(
        measurement.Measurement(axes, axes, np.ones(3), np.array(3 * [s**2 * axes]), np.ones(3), t**2 * axes)
    )
    expected = np.diag(3 * [1.5 * s**2 + 1.5**0.5 * s * t] + 3 * [t**2 + 1.5**0.5 * s * t])
    np.testing.assert_allclose(measured.attitude, axes, atol=ROUNDING)
    np.testing.assert_allclose(measured.angular_velocity, np.ones(3))
    np.testing.assert_allclose(measured.shape, expected, atol=1e-16)


def test_linear_direction_matches_the_error_model():
    """y - H x is in E(0, R) on its boundary when nu is on that of E(0, S), up to second order."""
    rng = np.random.default_rng(12)
    size, centre, e = 1e-5, random_rotation(rng), random_direction(rng, 3)
    bound = size**2 * random_shape(rng, 3)
    for _ in range(20):
        zeta = size * rng.normal(size=3)
        b_true = (centre @ so3.exp(zeta)).T @ e
        # A turn about b itself changes nothing: of the nu with one effect take that of least form.
        shift = np.linalg.svd(b_true[None, :])[2][1:].T @ rng.normal(size=2)
        best = shift - b_true * (b_true @ np.linalg.solve(bound, shift)) / (b_true @ np.linalg.solve(bound, b_true))
        nu = best / np.sqrt(ellipsoid.quadratic_form(best, np.zeros(3), bound))
        linear = measurement.linear_direction(centre, e, so3.exp(-nu) @ b_true, bound)
        noise = linear.y - linear.h @ np.concatenate([zeta, np.zeros(3)])
        assert noise @ np.linalg.solve(linear.r, noise) == pytest.approx(1, abs=1e-3)


# filter


def test_prediction_carries_the_boundary(body):
    rng = np.random.default_rng(13)
    size = 1e-6
    estimate = StateEllipsoid(START.attitude, START.angular_velocity, size**2 * random_shape(rng, 6))
    prediction = attitude_filter.predict(body, estimate, START.time, 0.1, 5, 4, CONTROL)
    for _ in range(10):
        x = np.linalg.cholesky(estimate.shape) @ random_direction(rng, 6)
        end = integrator.integrate(body, perturbed(START, x), 0.1, 5, 4, CONTROL)
        x_end = ellipsoid.state_error(prediction.ellipsoid, end.attitude, end.angular_velocity)
        form = ellipsoid.quadratic_form(x_end, np.zeros(6), prediction.ellipsoid.shape)
        assert form == pytest.approx(1, abs=1e-4)  # the second order is of the size


def fusion_case(rng, scale):
    """Two ellipsoids far apart in attitude for their size, and a truth inside both."""
    truth = State(random_rotation(rng), rng.normal(size=3), 0.0)
    sets = []
    for spread in (1.0, 3.0):
        centre_error = 0.6 * rng.normal(size=6) * scale * spread
        shape = np.outer(centre_error, centre_error) * 1.5 + (scale * spread) ** 2 * random_shape(rng, 6) * 0.1
        centre = perturbed(truth, -centre_error)
        sets.append(StateEllipsoid(centre.attitude, centre.angular_velocity, shape))
    return truth, sets


def test_moving_the_centre_is_right_to_first_order():
    """The error of the paper's move is of the product of the sizes, ours of the square."""
    rng = np.random.default_rng(14)
    a, direction = np.array([0.3, -0.4, 0.5]), random_direction(rng, 3)
    centre = StateEllipsoid(np.eye(3), np.zeros(3), np.eye(6))
    errors = []
    for size in (1e-3, 1e-4):
        zeta = size * direction
        x = np.concatenate([zeta, np.zeros(3)])
        segment = np.outer(x, x)
        # Seen from the measured centre, then moved to the predicted one: back to itself.
        seen = attitude_filter.recentred_shape(np.concatenate([a, np.zeros(3)]), segment)
        exact = so3.log(so3.exp(a) @ so3.exp(zeta)) - a
        errors.append(np.linalg.norm(seen[:3, :3] - np.outer(exact, exact)) / size**2)
        back = attitude_filter.moved(centre, np.concatenate([a, np.zeros(3)]), seen, True)
        np.testing.assert_allclose(back.shape, segment, atol=1e-15 * size**2 * 10)
        np.testing.assert_allclose(back.attitude, so3.exp(a), atol=ROUNDING)
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.05)
    paper_error = np.linalg.norm(np.outer(exact, exact) - segment[:3, :3]) / size**2
    assert paper_error > 0.1


@pytest.mark.parametrize("first_order", [False, True])
@pytest.mark.parametrize("criterion", ["trace", "volume"])
def test_fusion_contains_the_truth_of_small_sets(first_order, criterion):
    rng = np.random.default_rng(15)
    for _ in range(10):
        truth, (measured, predicted) = fusion_case(rng, 1e-6)
        x_m = ellipsoid.state_error(measured, truth.attitude, truth.angular_velocity)
        x_f = ellipsoid.state_error(predicted, truth.attitude, truth.angular_velocity)
        assert ellipsoid.quadratic_form(x_m, np.zeros(6), measured.shape) < 1
        assert ellipsoid.quadratic_form(x_f, np.zeros(6), predicted.shape) < 1
        fused = attitude_filter.fuse(measured, predicted, first_order, criterion)
        x = ellipsoid.state_error(fused.ellipsoid, truth.attitude, truth.angular_velocity)
        # What is left out is of second order: the size times the flatness of the sets.
        assert ellipsoid.quadratic_form(x, np.zeros(6), fused.ellipsoid.shape) < 1 + 1e-4
        size = ellipsoid.log_size(fused.shape_before_move, criterion)
        if criterion == "trace":  # theory 11: not of the volume of the recentred sets
            assert size <= min(np.log(np.trace(measured.shape)), np.log(np.trace(predicted.shape))) + 1e-4


@pytest.mark.parametrize("criterion", ["trace", "volume"])
def test_partial_measurement(criterion):
    rng = np.random.default_rng(16)
    for rows in (1, 2, 6, 8):
        shape, r, h = random_shape(rng, 6), random_shape(rng, rows), rng.normal(size=(rows, 6))
        inside = points_in(rng, np.zeros(6), shape, 1)[0]
        y = h @ inside + 0.7 * np.linalg.cholesky(r) @ random_direction(rng, rows)
        centre, fused = ellipsoid.fuse_measurement(np.ones(6), shape, y + h @ np.ones(6), h, r, criterion)
        for x in points_in(rng, inside, 0.1 * shape, 2000):
            consistent = ellipsoid.quadratic_form(y - h @ x, np.zeros(rows), r) <= 1
            if consistent and ellipsoid.quadratic_form(x, np.zeros(6), shape) <= 1:
                assert ellipsoid.quadratic_form(x + 1, centre, fused) <= 1 + 1e-12

        def size(log_mu, shape=shape, y=y, h=h, r=r):
            """The information form, as a combination of quadrics (theory 7)."""
            i, j = np.linalg.inv(shape), np.linalg.inv(r)
            matrices, gradients = [i, h.T @ j @ h], [np.zeros(6), -h.T @ j @ y]
            constants, multipliers = [1.0, 1 - y @ j @ y], [1.0, np.exp(log_mu)]
            _, member = ellipsoid.combine_quadrics(matrices, gradients, constants, multipliers)
            return ellipsoid.log_size(member, criterion)

        least = min(
            scipy.optimize.minimize_scalar(size, bounds=bounds).fun
            for bounds in itertools.pairwise(np.linspace(-20, 20, 9))
        )
        assert ellipsoid.log_size(fused, criterion) == pytest.approx(least, abs=1e-9)
        far = y + 10 * np.sqrt(np.trace(r) + np.trace(h @ shape @ h.T))
        with pytest.raises(ellipsoid.EmptyIntersection):
            ellipsoid.measurement_multiplier(shape, far, h, r, criterion)


def test_partial_measurement_of_everything_is_the_intersection():
    rng = np.random.default_rng(17)
    _, (measured, predicted) = fusion_case(rng, 0.1)
    offset = attitude_filter.centre_offset(measured, predicted)
    linear = measurement.LinearMeasurement(offset, np.eye(6), predicted.shape)
    for ours, theirs in zip(
        attitude_filter.fuse_linear(measured, linear, False).ellipsoid,
        attitude_filter.fuse(measured, predicted, False).ellipsoid,
        strict=True,
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_convergence_diagnostics():
    shape_m, shape_f, q = np.diag([1.0, 2, 3, 4, 5, 6]), 12 * np.eye(6), 0.5
    report = attitude_filter.convergence(2 * np.eye(6), shape_m, shape_f, q, 0.25)
    assert report.transition_norm == pytest.approx(24**0.5)
    assert report.chi == pytest.approx(186**0.5)
    assert report.least_eigenvalue == pytest.approx(2)
    # At c = contraction the theorem's inequality (sufcond) is an equality.
    c = report.contraction
    assert (c * (q + 2) / (6 * 186**0.5 * (1 + q))) ** 0.5 == pytest.approx(24**0.5)
    assert attitude_filter.convergence(np.eye(6), shape_m, shape_f, np.inf, 1.0).contraction == pytest.approx(
        36 * 186**0.5
    )
    # Theory 7: with P^m = I, q = 0 and det A = 1 it needs P^f > 216 P^m.
    for ratio, holds in ((215.9, False), (216.1, True)):
        report = attitude_filter.convergence(np.eye(6), np.eye(6), ratio * np.eye(6), 0.0, 1.0)
        assert (report.contraction < 1) == holds


@pytest.mark.parametrize("first_order", [False, True])
def test_cycles_keep_the_truth(first_order):
    """The scenario "orbit" with three directions at 0.1 degree, truth from DOP853."""
    rng = np.random.default_rng(18)
    bound, h, steps = np.radians(0.1), 2 * np.pi / 300, 30
    body = RigidBody(PRINCIPAL, rigid_body.GravityGradient(PRINCIPAL, 1.0))
    truth = State(so3.exp([np.radians(105), 0, 0]), np.array([2.316, 0.446, -0.591]), 0.0)
    angles, rates = 2 * (np.pi / 2) ** 2, 2 * (np.pi / 6) ** 2
    estimate = StateEllipsoid(np.eye(3), np.array([2.116, 0.5466, -0.8915]), np.diag(3 * [angles] + 3 * [rates]))
    axes, ball = np.eye(3), bound**2 * np.eye(3)
    for _ in range(8):
        start, truth = truth.time, continuous_end(body, truth, h * steps)
        noise = points_in(rng, np.zeros(3), ball, 4)
        directions = np.array([so3.exp(-nu) @ b for nu, b in zip(noise, truth.attitude, strict=False)])
        measured = measurement.Measurement(
            axes, directions, np.ones(3), np.array(3 * [ball]), truth.angular_velocity - noise[3], ball
        )
        result = attitude_filter.cycle(body, estimate, start, h, steps, measured, first_order, 4)
        assert result.prediction.time == pytest.approx(truth.time)
        estimate = result.fusion.ellipsoid
        x = ellipsoid.state_error(estimate, truth.attitude, truth.angular_velocity)
        assert ellipsoid.quadratic_form(x, np.zeros(6), estimate.shape) < 1
        assert np.trace(estimate.shape) < np.trace(result.measured.shape) * (1 + 1e-3)
    # By then the prediction is worth something.
    assert np.trace(estimate.shape) < 0.8 * np.trace(result.measured.shape)


# gyro


def test_gyro_linearization_against_central_differences():
    rng = np.random.default_rng(19)
    state, reading, h = gyro.GyroState(random_rotation(rng), rng.normal(size=3)), rng.normal(size=3), 0.4
    end = gyro.step(state, reading, h)

    def moved(x):
        """A true state off the centre by x[:6], with the gyro's noise v = x[6:]."""
        true = gyro.GyroState(state.attitude @ so3.exp(x[:3]), state.bias + x[3:6])
        rate = reading - true.bias - x[6:]
        return np.concatenate([so3.log(end.attitude.T @ true.attitude @ so3.exp(h * rate)), true.bias - end.bias])

    expected = central_difference(moved, 9, 1e-3)
    np.testing.assert_allclose(gyro.transition(state, reading, h), expected[:, :6], atol=1e-10)
    np.testing.assert_allclose(gyro.noise_effect(state, reading, h), expected[:, 6:], atol=1e-10)


def test_gyro_prediction_contains_the_truth():
    rng = np.random.default_rng(20)
    h, size = 0.1, 1e-4
    readings = rng.normal(size=(20, 3))
    shape, noise, drift = (size**2 * s for s in (random_shape(rng, 6), np.eye(3), 0.01 * np.eye(3)))
    centre = gyro.GyroState(random_rotation(rng), rng.normal(size=3))
    end, end_shape = gyro.predict(centre, shape, readings, h, noise, drift)
    largest = 0.0
    for _ in range(50):
        x = np.linalg.cholesky(shape) @ random_direction(rng, 6)
        attitude, bias = centre.attitude @ so3.exp(x[:3]), centre.bias + x[3:]
        steady = size * random_direction(rng, 3)
        for reading in readings:
            attitude = attitude @ so3.exp(h * (reading - bias - steady))
            bias = bias + 0.1 * steady
        x = np.concatenate([so3.log(end.attitude.T @ attitude), bias - end.bias])
        largest = max(largest, ellipsoid.quadratic_form(x, np.zeros(6), end_shape))
    assert 0.3 < largest <= 1
