"""Sets that are thin in some direction, against truths in 40 digits: what rounding may do must be in the set too."""

import elliptude as el
import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation


def nearest_rotation(matrix):
    """The rotation that a stored center stands for, in the digits of the context."""
    rotation = mpmath.matrix(np.asarray(matrix).tolist())
    for _ in range(6):  # Newton's iteration for the polar factor doubles the digits
        rotation = (rotation + (rotation**-1).T) / 2
    return rotation


def skew(v):
    return mpmath.matrix([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def cayley(gamma):
    """The rotation with the Gibbs coordinates γ = 2 tan(θ/2) n."""
    s = skew(gamma / 2)
    return mpmath.eye(3) + 2 / (1 + (gamma.T * gamma)[0] / 4) * (s + s * s)


def gibbs(rotation):
    trace = rotation[0, 0] + rotation[1, 1] + rotation[2, 2]
    return (2 / (1 + trace)) * mpmath.matrix(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )


def exponential(v):
    angle = mpmath.norm(v)
    s = skew(v)
    return mpmath.eye(3) + mpmath.sin(angle) / angle * s + (1 - mpmath.cos(angle)) / angle**2 * (s * s)


def form(ellipsoid, attitude, bias):
    """The value of yᵀP⁻¹y of a truth: at most one inside."""
    gamma = gibbs(nearest_rotation(ellipsoid.attitude).T * attitude)
    y = mpmath.matrix([*gamma, *(bias - mpmath.matrix(ellipsoid.vector.tolist()))])
    return (y.T * mpmath.lu_solve(mpmath.matrix(ellipsoid.shape.tolist()), y))[0]


def thin_set(rng, thin):
    """Attitudes of 0.5 rad by `thin` of it, off the axes; a bias within 1e-9 rad/s."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    attitude = axes @ np.diag([0.25, 0.25 * thin, 0.25 * thin**2]) @ axes.T
    shape = np.diag([1e-18] * 6)
    shape[:3, :3] = (attitude + attitude.T) / 2
    shape[np.diag_indices(6)] *= 1 + 1e-14  # positive definite in double, too
    rotation = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    return el.StateEllipsoid(rotation, rng.normal(size=3), shape, chart="gibbs")


def truths_on_the_boundary(ellipsoid):
    """A truth at each end of two axes of the set, wide and thin, and one between."""
    shape = mpmath.matrix(ellipsoid.shape.tolist())
    values, vectors = mpmath.eigsy(shape)
    center = nearest_rotation(ellipsoid.attitude)
    for weights in ([0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 0, 1], [0, 0, 0, 0.6, 0, 0.8], [0.1, 0.1, 0.1, 0.5, 0.5, 0.68]):
        unit = mpmath.matrix(weights) / mpmath.norm(mpmath.matrix(weights))
        y = vectors * mpmath.matrix([mpmath.sqrt(values[i]) * unit[i] for i in range(6)])
        yield center * cayley(y[:3]), mpmath.matrix(ellipsoid.vector.tolist()) + y[3:]


@pytest.mark.parametrize("thin", [1e-3, 1e-5, 1e-7, 3e-8])
@pytest.mark.parametrize("steps", [1, 200])
def test_an_ideal_gyro_keeps_the_truth_in_a_thin_set(thin, steps):
    rng = np.random.default_rng([round(-10 * np.log10(thin)), steps])
    worst = 0.0
    with mpmath.workdps(40):
        for _ in range(10 if steps == 1 else 2):
            start = thin_set(rng, thin)
            rate, h = rng.normal(size=3), 2.0**-10
            for attitude, bias in truths_on_the_boundary(start):
                filter_ = el.GuaranteedFilter(el.GuaranteedGyroFlow(0.0, interval_rate="mean"), start)
                for k in range(steps):
                    filter_.predict((k + 1) * h, gyro=rate)
                turn = exponential(h * steps * (mpmath.matrix(rate.tolist()) - bias))
                worst = max(worst, form(filter_.ellipsoid, attitude * turn, bias))
    assert 0 < worst <= 1


@pytest.mark.parametrize("angle", [1e3, 1e4])
def test_a_turn_of_many_times_around_is_in_the_set(angle):
    rng = np.random.default_rng(3)
    worst = 0.0
    with mpmath.workdps(40):
        for _ in range(30):
            rotation = Rotation.from_quat(rng.normal(size=4)).as_matrix()
            start = el.StateEllipsoid(rotation, rng.normal(size=3), np.diag([1e-32] * 3 + [1e-60] * 3), chart="gibbs")
            rate = rng.normal(size=3)
            rate *= angle / np.linalg.norm(rate)
            filter_ = el.GuaranteedFilter(el.GuaranteedGyroFlow(0.0, interval_rate="mean"), start)
            filter_.predict(1.0, gyro=rate)
            bias = mpmath.matrix(start.vector.tolist())
            end = nearest_rotation(rotation) * exponential(mpmath.matrix(rate.tolist()) - bias)
            worst = max(worst, form(filter_.ellipsoid, end, bias))
    assert 0 < worst <= 1
