"""Ellipsoids E(centre, P) = {x: (x - centre)' P^-1 (x - centre) <= 1} (paper, 2.3.2).

Sums and intersections have no ellipsoid of their own; each comes with a family of outer
ellipsoids and the member of it that minimises a criterion, ``"trace"``: tr(W P) with
W = I unless given, or ``"volume"``: det P.
"""

import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from .so3 import Array, log

Criterion = Literal["trace", "volume"]


class StateEllipsoid(NamedTuple):
    """E(C_hat, omega_hat, P) on TSO(3): C = C_hat exp(S(zeta)), omega = omega_hat + delta

    with [zeta; delta] in E(0, P) (ueso).
    """

    attitude: Array
    angular_velocity: Array
    shape: Array


class EmptyIntersection(ValueError):
    """The sets contradict each other: some bound is wrong (theory 2)."""


def quadratic_form(point: Array, centre: Array, shape: Array) -> float:
    """(x - centre)' P^-1 (x - centre): at most one inside."""
    offset = point - centre
    return float(offset @ np.linalg.solve(shape, offset))


def state_error(ellipsoid: StateEllipsoid, attitude: Array, angular_velocity: Array) -> Array:
    """x = [zeta; delta omega] of a state about the centre (ueso)."""
    zeta = log(ellipsoid.attitude.T @ attitude)
    return np.concatenate([zeta, angular_velocity - ellipsoid.angular_velocity])


def support(direction: Array, centre: Array, shape: Array) -> float:
    """The maximum of direction'x over the ellipsoid."""
    return float(direction @ centre + np.sqrt(direction @ shape @ direction))


def affine_image(matrix: Array, translation: Array, centre: Array, shape: Array) -> tuple[Array, Array]:
    """The image under x -> matrix x + translation (Pkpf)."""
    return matrix @ centre + translation, matrix @ shape @ matrix.T


def log_volume(shape: Array) -> float:
    """The logarithm of the volume, that of the unit ball included."""
    n = len(shape)
    unit_ball = 0.5 * n * math.log(math.pi) - math.lgamma(0.5 * n + 1.0)
    return unit_ball + 0.5 * float(np.linalg.slogdet(shape)[1])


# Sums. The centre is the sum of the centres; the shapes of the family are
# sum_i P_i / alpha_i with alpha_i > 0, sum_i alpha_i = 1.


def sum_minimum_trace(shapes: Sequence[Array], weight: Array | None = None) -> Array:
    """(sum_i sqrt(tr W P_i)) (sum_i P_i / sqrt(tr W P_i)): Pmkl, theory 7.2.

    Shapes may be singular; zero ones are left out.
    """
    metric = np.eye(len(shapes[0])) if weight is None else weight
    sizes = [math.sqrt(np.trace(metric @ shape)) for shape in shapes]
    terms = [p / size for p, size in zip(shapes, sizes, strict=True) if size > 0.0]
    return np.asarray(sum(sizes) * np.sum(terms, axis=0))


def sum_minimum_volume(shapes: Sequence[Array]) -> Array:
    """The member of the same family that minimises det P.

    log det is concave, so log det P' <= log det P + tr(P^-1 (P' - P)); the minimum of
    the right side over the family is the minimum trace with weight P^-1. Repeating it
    descends to the minimum: as a function of log alpha_i the problem is convex.
    """
    shape = sum_minimum_trace(shapes)
    for _ in range(10_000):
        better = sum_minimum_trace(shapes, np.linalg.inv(shape))
        change = np.linalg.norm(better - shape) / np.linalg.norm(shape)
        shape = better
        if change < 1e-15:
            break
    return shape


# Intersection of E(0, P^m) and E(x^mf, P^f), as the paper has it.


def intersection_gain(shape_m: Array, shape_f: Array, q: float) -> Array:
    """L = P^m (P^m + P^f / q)^-1 (LP), written so that q = 0 is allowed."""
    return q * shape_m @ np.linalg.inv(q * shape_m + shape_f)


def intersection_beta(offset: Array, shape_m: Array, shape_f: Array, q: float) -> float:
    """beta = 1 + q - x^mf' (P^m)^-1 L x^mf (betaq), where (P^m)^-1 L = q (q P^m + P^f)^-1."""
    return float(1.0 + q - q * offset @ np.linalg.solve(q * shape_m + shape_f, offset))


def intersection_member(offset: Array, shape_m: Array, shape_f: Array, q: float) -> tuple[Array, Array]:
    """x = L x^mf, P = beta (I - L) P^m (xhatP); q = inf gives E^f (theory 7.4).

    (I - L) P^m = ((P^m)^-1 + q (P^f)^-1)^-1, as in the proof of sufcond: it does not cancel.
    """
    if math.isinf(q):
        return offset, shape_f
    information = np.linalg.inv(shape_m) + q * np.linalg.inv(shape_f)
    shape = intersection_beta(offset, shape_m, shape_f, q) * np.linalg.inv(information)
    return intersection_gain(shape_m, shape_f, q) @ offset, 0.5 * (shape + shape.T)


def intersection_multiplier(
    offset: Array,
    shape_m: Array,
    shape_f: Array,
    criterion: Criterion = "trace",
    weight: Array | None = None,
) -> float:
    """The q in [0, inf] that minimises the criterion (paper, below LP).

    It is the partial measurement of everything, H = I and R = P^f, with the end point
    q = inf added (theory 7.4).
    """
    identity = np.eye(len(offset))
    q = measurement_multiplier(shape_m, offset, identity, shape_f, criterion, weight)
    _, at_q = intersection_member(offset, shape_m, shape_f, q)
    size_f = log_size(shape_f, criterion, weight)
    return math.inf if size_f <= log_size(at_q, criterion, weight) else q


def intersection(
    centre_m: Array,
    shape_m: Array,
    centre_f: Array,
    shape_f: Array,
    criterion: Criterion = "trace",
    weight: Array | None = None,
) -> tuple[Array, Array]:
    """The least outer ellipsoid of the intersection (xhatP, betaq, LP)."""
    offset = centre_f - centre_m
    q = intersection_multiplier(offset, shape_m, shape_f, criterion, weight)
    centre, shape = intersection_member(offset, shape_m, shape_f, q)
    return centre_m + centre, shape


def overlap_margin(centre_1: Array, shape_1: Array, centre_2: Array, shape_2: Array) -> float:
    """1 - max_l l (1 - l) d' (l P1 + (1 - l) P2)^-1 d, negative iff disjoint (theory 7).

    The function of l is concave, so its slope is bisected.
    """
    d = centre_2 - centre_1

    def value_and_slope(share: float) -> tuple[float, float]:
        y = np.linalg.solve(share * shape_1 + (1.0 - share) * shape_2, d)
        product = share * (1.0 - share)
        slope = (1.0 - 2.0 * share) * d @ y - product * y @ (shape_1 - shape_2) @ y
        return float(product * d @ y), float(slope)

    low, high = 0.0, 1.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        if value_and_slope(middle)[1] > 0.0:
            low = middle
        else:
            high = middle
    return 1.0 - value_and_slope(0.5 * (low + high))[0]


# Fusion of E(0, P) with a partial measurement y = H x + v, v in E(0, R) (theory 7.4). With
# D = mu G = mu H P H' + R nothing divides by mu, and mu = 0 is allowed.


def measurement_gain(shape: Array, h: Array, r: Array, mu: float) -> Array:
    """K = P H' G^-1 with G = H P H' + R / mu."""
    return mu * np.linalg.solve(mu * h @ shape @ h.T + r, h @ shape).T


def measurement_factor(shape: Array, y: Array, h: Array, r: Array, mu: float) -> float:
    """N = 1 + mu - y'G^-1 y."""
    return float(1.0 + mu - mu * y @ np.linalg.solve(mu * h @ shape @ h.T + r, y))


def measurement_reduction(shape: Array, h: Array, r: Array, mu: float) -> Array:
    """(I - K H) P, written (I - K H) P (I - K H)' + K (R / mu) K', which cannot cancel."""
    if mu == 0.0:
        return shape
    gain = measurement_gain(shape, h, r, mu)
    rest = np.eye(len(shape)) - gain @ h
    return rest @ shape @ rest.T + gain @ r @ gain.T / mu


def measurement_member(shape: Array, y: Array, h: Array, r: Array, mu: float) -> tuple[Array, Array]:
    """x+ = K y, P+ = N (I - K H) P."""
    factor = measurement_factor(shape, y, h, r, mu)
    reduced = measurement_reduction(shape, h, r, mu)
    return measurement_gain(shape, h, r, mu) @ y, factor * reduced


def measurement_multiplier(
    shape: Array,
    y: Array,
    h: Array,
    r: Array,
    criterion: Criterion = "trace",
    weight: Array | None = None,
) -> float:
    """The mu >= 0 that minimises the criterion over the family.

    With B = (I - K H) P the slopes are

        N'           = 1 - y'D^-1 R D^-1 y,
        B'           = -P H'D^-1 R D^-1 H P,
        (log det B)' = -tr(D^-1 H P H').

    The criterion's slope is looked at on a dense grid of log mu, so that nothing rests
    on its having one zero only, and bisected wherever it turns from falling to rising.
    Both ends compete as well; the last of the grid stands for infinity.
    """
    metric = np.eye(len(shape)) if weight is None else weight
    projected = h @ shape @ h.T
    margin = overlap_margin(np.zeros(len(y)), projected, y, r)
    if margin <= 0.0:
        raise EmptyIntersection(f"the sets have no interior in common: overlap margin {margin}")

    def slope(mu: float) -> float:
        """N'/N + B'/B in the criterion's sense, times the positive N (and tr W B)."""
        inverse = np.linalg.inv(mu * projected + r)
        factor = measurement_factor(shape, y, h, r, mu)
        factor_slope = 1.0 - float(y @ inverse @ r @ inverse @ y)
        if criterion == "volume":
            return len(shape) * factor_slope - factor * float(np.trace(inverse @ projected))
        half = inverse @ h @ shape
        fall = float(np.trace(metric @ half.T @ r @ half))
        reduced = measurement_reduction(shape, h, r, mu)
        return factor_slope * float(np.trace(metric @ reduced)) - factor * fall

    def size(mu: float) -> float:
        _, bounding = measurement_member(shape, y, h, r, mu)
        return log_size(bounding, criterion, weight)

    ratio = np.trace(r) / np.trace(projected)
    grid = np.geomspace(1e-14 * min(1.0, ratio), 1e14 * max(1.0, ratio), 1000)
    slopes = [slope(mu) for mu in grid]
    candidates = [0.0, float(grid[-1])]
    for i in range(len(grid) - 1):
        if slopes[i] < 0.0 <= slopes[i + 1]:
            candidates.append(_bisect(slope, grid[i], grid[i + 1]))
    return min(candidates, key=size)


def fuse_measurement(
    centre: Array,
    shape: Array,
    y: Array,
    h: Array,
    r: Array,
    criterion: Criterion = "trace",
    weight: Array | None = None,
) -> tuple[Array, Array]:
    """Fuse E(centre, P) with y = H x + v, v in E(0, R) (theory 7.4)."""
    residual = y - h @ centre
    mu = measurement_multiplier(shape, residual, h, r, criterion, weight)
    change, fused = measurement_member(shape, residual, h, r, mu)
    return centre + change, fused


def log_size(shape: Array, criterion: Criterion = "trace", weight: Array | None = None) -> float:
    """log tr(W P) or log det P: what the criterion minimises."""
    if criterion == "volume":
        return float(np.linalg.slogdet(shape)[1])
    metric = np.eye(len(shape)) if weight is None else weight
    return math.log(np.trace(metric @ shape))


def _bisect(slope: Callable[[float], float], low: float, high: float) -> float:
    """The zero of a slope that is negative at ``low``, on a logarithmic scale."""
    for _ in range(100):
        middle = math.sqrt(low * high)
        if slope(middle) < 0.0:
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)


def combine_quadrics(
    matrices: Sequence[Array],
    gradients: Sequence[Array],
    constants: Sequence[float],
    multipliers: Sequence[float],
) -> tuple[Array, Array]:
    """The ellipsoid of sum_k mu_k (y'A_k y + 2 g_k'y - c_k) <= 0 (theory 7, Fusion).

    centre = -A^-1 g and P = (c + g'A^-1 g) A^-1. It bounds the intersection of the
    quadrics only if A is positive definite, which Cholesky decides.
    """
    a = np.tensordot(multipliers, matrices, 1)
    g = np.tensordot(multipliers, gradients, 1)
    np.linalg.cholesky(a)
    centre = -np.linalg.solve(a, g)
    size = float(np.dot(multipliers, constants) - g @ centre)
    if size < 0.0:
        raise EmptyIntersection(f"the sets do not meet: c + g'A^-1 g = {size}")
    return centre, size * np.linalg.inv(a)
