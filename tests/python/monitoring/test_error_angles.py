"""Largest and least errors in a set against dense samples, a local optimiser from many starts, and closed forms."""

import mpmath
import numpy as np
import pytest
from elliptude.monitoring import error_angles
from elliptude.monitoring.error_angles import _largest_eigenvalue, largest_share
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

TINY = 1e-12


def seen_from_center(z, q0, u):
    """Total, tilt and heading of the truth z against the estimate q0, by rotation matrices alone, rad, (n, 3)."""
    true, estimate = Rotation.from_quat(z, scalar_first=True), Rotation.from_quat(q0, scalar_first=True)
    # Up in the body axes of either; u is up in those of the center.
    ups, up = true.inv().apply(u), estimate.inv().apply(u)
    tilt = np.arctan2(np.linalg.norm(np.cross(ups, up), axis=-1), ups @ up)
    difference = true * estimate.inv()
    # The heading is what is left after the shortest turn that takes one up to the other.
    turned = difference.apply(u)
    axis = np.cross(turned, u)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (turned @ u)[..., None])
    back = Rotation.from_rotvec(np.where(sine > 1e-14, axis / np.maximum(sine, 1e-300), 0.0) * angle)
    return np.stack([difference.magnitude(), tilt, np.abs((back * difference).as_rotvec() @ u)], axis=-1)


def attitudes(directions, half, center_turn=None):
    """Quaternions of Gibbs vectors γ = 2 half @ direction."""
    z = np.concatenate([np.ones((*directions.shape[:-1], 1)), directions @ half.T], axis=-1)
    return z / np.linalg.norm(z, axis=-1, keepdims=True)


def one(rng, *, smallest=-4.0, largest=0.7, reach=1.0):
    """A set with its root (γ = 2 half u), an estimate of either sign, up."""
    axes = Rotation.random(rng=rng).as_matrix()
    half = 0.5 * axes * np.exp(rng.uniform(smallest, largest, 3))
    turn = rng.normal(size=3)
    turn *= reach * rng.uniform() ** 2 * np.pi / np.linalg.norm(turn)
    q0 = Rotation.from_rotvec(turn).as_quat(scalar_first=True) * rng.choice([-1.0, 1.0])
    up = rng.normal(size=3)
    return half, q0, up / np.linalg.norm(up)


def bounds(half, q0, up):
    found = error_angles(q0[None], 4.0 * (half @ half.T)[None], up[None])
    return np.array(found)[:3, 0], np.array(found)[3:6, 0]


def searched(half, q0, up, which, sign, starts):
    """The largest (sign 1) or least (-1) error that a local optimiser finds in the ball |u| ≤ 1."""
    w, v = q0[0], q0[1:]

    def value(u):
        # Quicker than by matrices, which judge what is found.
        x = half @ u
        scalar, vector = w + x @ v, w * x - v + np.cross(v, x)
        about = vector @ up
        across = np.linalg.norm(vector - about * up)
        pairs = ((np.hypot(across, about), abs(scalar)), (across, np.hypot(scalar, about)), (abs(about), abs(scalar)))
        return -sign * 2.0 * np.arctan2(*pairs[which])

    limit = {"type": "ineq", "fun": lambda u: 1.0 - u @ u}
    found = list(starts)
    for u in starts:
        done = minimize(value, u, constraints=[limit], method="SLSQP", options={"ftol": 1e-14, "maxiter": 300})
        found.append(done.x / max(1.0, float(np.linalg.norm(done.x))))
    errors = sign * seen_from_center(attitudes(np.array(found), half), q0, up)[:, which]
    return sign * errors.max()


@pytest.mark.parametrize("seed", range(8))
def test_bounds_hold_for_all_samples_and_are_reached(seed):
    rng = np.random.default_rng(seed)
    half, q0, up = one(rng, reach=[0.3, 1.0][seed % 2])
    largest, least = bounds(half, q0, up)
    directions = rng.normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[::2] *= rng.uniform(size=(100_000, 1)) ** (1 / 3)
    errors = seen_from_center(attitudes(directions, half), q0, up)
    assert (errors.max(axis=0) <= largest + TINY).all()
    assert (errors.min(axis=0) >= least - TINY).all()
    for which in range(3):
        order = np.argsort(errors[:, which])
        most = searched(half, q0, up, which, 1, directions[order[-4:]])
        assert most <= largest[which] + TINY
        assert largest[which] <= 1.001 * most
        # Down to 3e-7 rad, where the cosine of half the angle has no more digits.
        fewest = searched(half, q0, up, which, -1, directions[order[:4]])
        assert fewest >= least[which] - TINY
        assert least[which] >= fewest / 1.001 - 1e-6


def test_small_sets_near_and_far_keep_their_digits():
    rng = np.random.default_rng(4)
    for size in (1e-3, 1e-6, 1e-9):
        for _ in range(5):
            half, q0, up = one(rng, smallest=-2.0, largest=0.0)
            turn = size * rng.normal(size=3)
            q0 = Rotation.from_rotvec(turn).as_quat(scalar_first=True)
            largest, _ = bounds(size * half, q0, up)
            # To first order the total is the distance in the plane of Gibbs vectors.
            directions = rng.normal(size=(100_000, 3))
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            gibbs = 2.0 * size * directions @ half.T - turn
            across = gibbs - (gibbs @ up)[:, None] * up
            expected = np.array([*(np.linalg.norm(x, axis=1).max() for x in (gibbs, across)), np.abs(gibbs @ up).max()])
            assert largest == pytest.approx(expected, rel=max(2.0 * size, 2e-3))


def test_the_sign_of_a_quaternion_does_not_matter():
    rng = np.random.default_rng(1)
    for _ in range(20):
        half, q0, up = one(rng)
        for a, b in zip(bounds(half, q0, up), bounds(half, -q0, up), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("widths", [(0.1, 0.02, 0.003), (1e-9, 1e-6, 1.0), (3.0, 20.0, 0.5)])
def test_at_the_center_there_are_closed_forms(widths):
    rng = np.random.default_rng(7)
    axes, up = Rotation.random(rng=rng).as_matrix(), np.array([0.0, 0.6, 0.8])
    shape = axes @ np.diag(np.square(widths)) @ axes.T
    found = error_angles(np.array([[1.0, 0, 0, 0]]), shape[None], up[None])
    assert found.total[0] == pytest.approx(2.0 * np.arctan(0.5 * max(widths)), rel=1e-6)
    assert found.heading[0] == pytest.approx(2.0 * np.arctan(0.5 * np.sqrt(up @ shape @ up)), rel=1e-9)
    across = np.eye(3) - np.outer(up, up)
    # The bound of section 18.6, which leaves out that a turn about up makes the tilt smaller.
    assert found.tilt[0] <= 2.0 * np.arctan(0.5 * np.sqrt(np.linalg.eigvalsh(across @ shape @ across)[-1])) + 1e-9
    assert (found.least_total, found.least_tilt, found.least_heading) == (0, 0, 0)


def test_a_ball_about_the_center_bounds_by_the_sum_of_angles():
    """In a ball of half-angle r a truth r beyond the center is the furthest: the angle of the estimate and r."""
    r, up = 0.3, np.array([0.0, 0.0, 1.0])
    shape = (2.0 * np.tan(0.5 * r)) ** 2 * np.eye(3)
    for angle in (0.0, 0.2, 1.0, 2.5, np.pi - r - 1e-6, np.pi - 0.5 * r, np.pi):
        for axis in ([1.0, 0, 0], [0, 0, 1.0]):
            q0 = Rotation.from_rotvec(angle * np.array(axis)).as_quat(scalar_first=True)
            found = error_angles(q0[None], shape[None], up[None])
            assert found.total[0] == pytest.approx(min(angle + r, np.pi), abs=1e-6)
            assert found.least_total[0] == pytest.approx(max(angle - r, 0.0), abs=1e-6)
            # A turn about x is a tilt, one about z a heading.
            of = found.tilt if axis[0] else found.heading
            least = found.least_tilt if axis[0] else found.least_heading
            assert of[0] == pytest.approx(min(angle + r, np.pi), abs=1e-6)
            assert least[0] == pytest.approx(max(angle - r, 0.0), abs=1e-6)


def test_an_estimate_in_the_set_is_never_proved_wrong():
    """On the boundary too, where rounding decides: for sets of all sizes and any estimate in them."""
    rng = np.random.default_rng(3)
    n = 20_000
    sizes = 10.0 ** rng.uniform(-9, 2, (n, 3))
    axes = Rotation.random(n, rng=rng).as_matrix()
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[::2] *= rng.uniform(size=(n // 2, 1))
    gibbs = np.einsum("nij,nj->ni", axes, sizes * directions)
    z = np.concatenate([np.ones((n, 1)), 0.5 * gibbs], axis=1)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    up = rng.normal(size=(n, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    shapes = np.einsum("nij,nj,nkj->nik", axes, sizes**2, axes)
    found = error_angles(z, 0.5 * (shapes + shapes.swapaxes(1, 2)), up)
    assert not found.least_total.any()
    assert not found.least_tilt.any()
    assert not found.least_heading.any()


def test_a_truth_on_the_edge_of_a_thin_set_is_within_the_bounds():
    rng = np.random.default_rng(13)
    n = 20_000
    sizes = 10.0 ** rng.uniform(-12, 1, (n, 3))
    axes = Rotation.random(n, rng=rng).as_matrix()
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    z = np.concatenate([np.ones((n, 1)), 0.5 * np.einsum("nij,nj->ni", axes, sizes * directions)], axis=1)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    shapes = np.einsum("nij,nj,nkj->nik", axes, sizes**2, axes)
    turns = rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-12, 0.5, (n, 1))
    q0 = Rotation.from_rotvec(turns).as_quat(scalar_first=True)
    up = np.array([0.0, 0.0, 1.0])
    found = error_angles(q0, 0.5 * (shapes + shapes.swapaxes(1, 2)), np.tile(up, (n, 1)))
    difference = Rotation.from_quat(z, scalar_first=True) * Rotation.from_quat(q0, scalar_first=True).inv()
    w, x, y, about = difference.as_quat(scalar_first=True).T
    total = 2.0 * np.arctan2(np.linalg.norm([x, y, about], axis=0), np.abs(w))
    tilt, heading = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, about)), 2.0 * np.arctan2(np.abs(about), np.abs(w))
    slack = 2e-15  # of this test's own quaternions
    assert (total <= found.total + slack).all()
    assert (tilt <= found.tilt + slack).all()
    assert (heading <= found.heading + slack / np.cos(0.5 * tilt)).all()
    assert (total >= found.least_total - slack).all()
    assert (tilt >= found.least_tilt - slack).all()
    assert (heading >= found.least_heading - slack / np.cos(0.5 * tilt)).all()


def test_where_up_may_be_opposite_any_heading_is_possible():
    """A ball seen from an estimate that is turned over, and a set that is large itself."""
    up = np.array([[0.0, 0.0, 1.0]])
    for turn, width in ((np.pi, 0.3), (np.pi - 0.2, 0.3), (1.0, 3.0)):
        q0 = Rotation.from_rotvec([turn, 0.0, 0.0]).as_quat(scalar_first=True)
        found = error_angles(q0[None], (2.0 * np.tan(0.5 * width)) ** 2 * np.eye(3)[None], up)
        assert (found.heading[0], found.least_heading[0]) == (np.pi, 0.0)
    # Beyond the ball it is not: the heading has an end again.
    q0 = Rotation.from_rotvec([np.pi - 0.4, 0.0, 0.0]).as_quat(scalar_first=True)
    assert error_angles(q0[None], (2.0 * np.tan(0.15)) ** 2 * np.eye(3)[None], up).heading[0] < np.pi


def test_the_heading_of_an_estimate_that_is_nearly_upside_down_covers_rounding():
    """Of the center itself, whose heading against q0 is 2 arctan(z/w) to the last digit, however small both are."""
    rng = np.random.default_rng(6)
    n = 20_000
    cosine, angle = 10.0 ** rng.uniform(-15, -1, n), rng.uniform(0.0, 2.0 * np.pi, n)
    about = rng.uniform(0.0, 2.0 * np.pi, n)
    across = np.sqrt(1.0 - cosine**2)
    q0 = np.column_stack(
        [cosine * np.cos(angle), across * np.cos(about), across * np.sin(about), cosine * np.sin(angle)]
    )
    axes = Rotation.random(n, rng=rng).as_matrix()
    shapes = axes @ np.diag([1e-36, 2e-36, 3e-36]) @ axes.swapaxes(1, 2)
    found = error_angles(q0, 0.5 * (shapes + shapes.swapaxes(1, 2)), np.tile([0.0, 0.0, 1.0], (n, 1)))
    heading = 2.0 * np.arctan2(np.abs(q0[:, 3]), np.abs(q0[:, 0]))
    assert (heading <= found.heading + 1e-15).all()
    assert (heading >= found.least_heading - 1e-15).all()
    assert (found.heading[cosine > 1e-6] <= heading[cosine > 1e-6] + 1e-6).all()


def test_a_flat_set_is_one():
    up = np.array([[0.0, 0.0, 1.0]])
    found = error_angles(np.array([[1.0, 0, 0, 0]]), np.diag([0.0, 0.0, 0.04])[None], up)
    assert found.heading[0] == pytest.approx(2.0 * np.arctan(0.1), rel=1e-9)
    assert found.tilt[0] < 1e-6
    point = error_angles(np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3, 3)), up)
    assert max(np.array(point)[:3, 0]) < 1e-6


@pytest.mark.filterwarnings("error")
def test_extreme_sets():
    up = np.array([[0.0, 0.0, 1.0]])
    q0 = Rotation.from_rotvec([0.5, 0.0, 0.2]).as_quat(scalar_first=True)[None]
    for size in (1e18, 1e150, 1e300):
        for shape in (size * np.eye(3), np.diag([1e-300, 1.0, size])):
            found = np.array(error_angles(q0, shape[None], up))[:, 0]
            assert np.isfinite(found).all()
            assert found[0] > 3.0
    tiny = np.array(error_angles(q0, 1e-300 * np.eye(3)[None], up))[:, 0]
    np.testing.assert_allclose(tiny[:3], tiny[3:6], atol=1e-6)
    endless = np.array(error_angles(q0, np.full((1, 3, 3), np.inf), up))
    assert np.isnan(endless).all()


def test_rows_without_a_set_or_an_estimate_are_empty():
    q0 = np.array([[1.0, 0, 0, 0], [np.nan] * 4, [1.0, 0, 0, 0]])
    shapes = np.array([np.full((3, 3), np.nan), np.eye(3), np.eye(3)])
    found = np.array(error_angles(q0, shapes, np.tile([0.0, 0.0, 1.0], (3, 1))))
    assert np.isnan(found[:, :2]).all()
    assert np.isfinite(found[:, 2]).all()
    without_up = error_angles(q0, shapes)
    assert np.isfinite(without_up.total[2])
    assert np.isnan([without_up.tilt[2], without_up.heading[2], without_up.least_heading[2]]).all()


def test_a_truth_half_a_turn_away_is_within_the_bounds():
    """The three terms of a form are nearly one there, and what rounding takes counts by its root."""
    rng = np.random.default_rng(0)
    n = 20_000
    sizes = np.sort(10.0 ** rng.uniform(-5, 1.5, (n, 3)), axis=1)
    inside = rng.normal(size=(n, 3))
    inside *= 0.9 * rng.uniform(size=(n, 1)) / np.linalg.norm(inside, axis=1, keepdims=True)
    truth = np.concatenate([np.ones((n, 1)), 0.5 * sizes * inside], axis=1)
    truth /= np.linalg.norm(truth, axis=1, keepdims=True)
    q0 = rng.normal(size=(n, 4))
    q0 -= (q0 * truth).sum(axis=1, keepdims=True) * truth
    q0 /= np.linalg.norm(q0, axis=1, keepdims=True)
    total = error_angles(q0, sizes[:, :, None] ** 2 * np.eye(3)).total
    # Found otherwise: twice the angle between the quaternions, which is half a turn but for rounding.
    assert (total >= np.pi - 4.0 * np.abs((q0 * truth).sum(axis=1)) - 1e-14).all()


def test_largest_eigenvalues_are_never_too_small():
    """Where two of them are one, too, and where all are, or nearly."""
    draws = np.random.default_rng(8)
    values = 10.0 ** draws.uniform(-12.0, 0.0, (5000, 3)) * [1.0, 1e-3, 1e-6]
    values[1000:2000, 1] = values[1000:2000, 0]
    values[2000:3000, 1] = values[2000:3000, 0] * (1.0 + 10.0 ** draws.uniform(-16.0, -4.0, 1000))
    values[3000:4000, 1:] = values[3000:4000, :1] * (1.0 + 1e-15 * draws.integers(-2, 3, (1000, 2)))
    values[4000:, 1] = values[4000:, 0]
    values[4000:, 2] = values[4000:, 0] * (1.0 - 10.0 ** draws.uniform(-16.0, 0.0, 1000))
    axes = Rotation.random(5000, rng=draws).as_matrix()
    forms = np.einsum("nij,nj,nkj->nik", axes, values, axes)
    forms = 0.5 * (forms + forms.swapaxes(1, 2))
    found = _largest_eigenvalue([forms[:, j, k] for j in range(3) for k in range(j + 1)])
    with mpmath.workdps(40):
        exact = [max(mpmath.eigsy(mpmath.matrix(form.tolist()), eigvals_only=True)) for form in forms[::5]]
        assert all(one >= right for one, right in zip(found[::5], exact, strict=True))
    right, mean = values.max(axis=1), values.mean(axis=1)
    spread = np.sqrt(((values - mean[:, None]) ** 2).sum(axis=1) / 6.0)
    epsilon = np.finfo(float).eps
    assert (found >= right * (1.0 - 16.0 * epsilon)).all()
    assert (found <= right * (1.0 + 80.0 * epsilon) + 10.0 * np.sqrt(epsilon * spread * mean)).all()


def share_at(basis, squares, x):
    """The bound of (18.21) for m = 1/(1 + e^-x), by NumPy's eigenvalues."""
    growth = np.exp(x)[:, None]
    weights = np.concatenate([1.0 + growth, squares / (squares + growth / (1.0 + growth))], axis=1)
    return np.linalg.eigvalsh(np.einsum("nij,ni,nik->njk", basis, weights, basis))[:, -1]


@pytest.mark.parametrize(
    ("thin", "thick", "reach"), [(-9, 2, 3.1), (-3, 0, 0.3), (-9, -6, 1e-6), (-1, -1, 3.14), (-4, 1, 3)]
)
def test_the_largest_share_is_the_least_of_all_multipliers(thin, thick, reach):
    """Beside a search that knows nothing of slopes, where two eigenvalues are the largest too."""
    draws = np.random.default_rng(5)
    n = 400
    squares = 0.25 * 10.0 ** (2.0 * draws.uniform(thin, thick, (n, 3)))
    squares[: n // 4, 1] = squares[: n // 4, 0]
    turns = draws.normal(size=(n, 3))
    turns *= reach * draws.uniform(size=(n, 1)) / np.linalg.norm(turns, axis=1, keepdims=True)
    turns[: n // 4] *= [1.0, 0.0, 0.0]
    turns[n // 4 : n // 3] = 0.0
    q = Rotation.from_rotvec(turns).as_quat(scalar_first=True)
    # Orthonormal columns across each: a basis of what is left, in part along the axes.
    for count in (1, 2, 3):
        columns = np.linalg.qr(np.concatenate([q[:, :, None], draws.normal(size=(n, 4, 3))], axis=2))[0]
        basis = columns[:, :, :1] if count == 1 else columns[:, :, 1 : count + 1]
        found = largest_share(basis, squares)
        low, high = np.full(n, -40.0), np.full(n, 40.0)
        golden = 0.5 * (np.sqrt(5.0) - 1.0)
        least = np.ones(n)
        for _ in range(60):
            left, right = high - golden * (high - low), low + golden * (high - low)
            at_left, at_right = (share_at(basis, squares, x) for x in (left, right))
            least = np.minimum(least, np.minimum(at_left, at_right))
            low, high = np.where(at_left <= at_right, low, left), np.where(at_left <= at_right, right, high)
        assert (found >= least * (1.0 - 1e-7)).all()
        # Of three columns the eigenvalue may be 10 √ε too large where two are the largest, section 18.8.
        assert (found <= least * (1.0 + (2e-7 if count == 3 else 1e-8))).all()
