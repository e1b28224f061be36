"""Measurements as quadrics of [gamma; delta], their fusion, and the move of a set to its own center (theory 16).

What a measurement says of the attitude is a quadratic form of the quaternion q = (1, gamma/2) of the error, from which
the quadric of gamma is read. Nothing is done about rounding: measurements must not be sharper than the prediction by
many powers of ten.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.optimize

from . import so3, wahba
from .ellipsoid import Criterion
from .guaranteed_flow import GibbsSet
from .so3 import Array


class Quadric(NamedTuple):
    """y'A y + 2 g'y <= c."""

    a: Array
    g: Array
    c: float


def slack(quadric: Quadric, y: Array) -> float:
    """c - y'A y - 2 g'y."""
    return float(quadric.c - y @ quadric.a @ y - 2.0 * quadric.g @ y)


# Measurements


def angle_bound(body: Array, bound: Array) -> float:
    """The root of the largest eigenvalue of Pi S Pi, Pi = I - b b' (16.1)."""
    b = body / np.linalg.norm(body)
    across = np.eye(3) - np.outer(b, b)
    return math.sqrt(np.linalg.eigvalsh(across @ bound @ across)[-1])


def of_quaternion(form: Array) -> Quadric:
    """q'Q q >= 0 of q = (1, gamma/2) as a quadric of gamma."""
    return Quadric(-0.25 * form[1:, 1:], -0.5 * form[0, 1:], float(form[0, 0]))


def cone(center: Array, reference: Array, body: Array, angle: float) -> Quadric:
    """angle(C'e, b) <= r: q'(K - cos r I) q >= 0 with Davenport's K of (center'e) b' (15.1, 16.2), over 1 - cos r.

    The real part of K - I is -|center'e - b|^2 / 2, and 1 - cos r = 2 sin^2(r/2): neither cancels for a sharp cone.
    """
    b = body / np.linalg.norm(body)
    predicted = center.T @ reference / np.linalg.norm(reference)
    versine = 2.0 * math.sin(0.5 * angle) ** 2
    form = wahba.davenport_matrix(np.outer(predicted, b)) - np.eye(4)
    form[0, 0] = -0.5 * float(np.sum((predicted - b) ** 2))
    return of_quaternion(form / versine + np.eye(4))


def attitude_quadric(center: Array, measured: Array, bound: Array) -> Quadric:
    """gamma~'M gamma~ <= 1 about the measured attitude, M^-1 = tau_1^2 bound, seen from the center (16.2, 16.3).

    The error's quaternion about the measured attitude is that about the center, multiplied from the left by the
    conjugate of (1, g^): gamma~ is twice its vector part (x) over its real part (w), and the form w^2 - 4 x'M x.
    """
    angle = math.sqrt(np.linalg.eigvalsh(bound)[-1])
    tau = 2.0 * math.tan(0.5 * angle) / angle
    g = so3.cayley_inverse(center.T @ measured)
    product = np.eye(4)
    product[0, 1:], product[1:, 0] = g, -g
    product[1:, 1:] -= so3.hat(g)
    form = np.zeros((4, 4))
    form[0, 0] = 1.0
    form[1:, 1:] = -4.0 * np.linalg.inv(tau**2 * bound)
    return of_quaternion(product.T @ form @ product)


def ellipsoid_quadric(center: Array, shape: Array) -> Quadric:
    """(y - center)'P^-1 (y - center) <= 1."""
    a = np.linalg.inv(shape)
    return Quadric(a, -a @ center, float(1.0 - center @ a @ center))


def of_attitude(quadric: Quadric) -> Quadric:
    """What a quadric of gamma says of [gamma; delta]."""
    a = np.zeros((6, 6))
    a[:3, :3] = quadric.a
    return Quadric(a, np.concatenate([quadric.g, np.zeros(3)]), quadric.c)


def of_vector(quadric: Quadric) -> Quadric:
    """What a quadric of delta says of [gamma; delta]."""
    a = np.zeros((6, 6))
    a[3:, 3:] = quadric.a
    return Quadric(a, np.concatenate([np.zeros(3), quadric.g]), quadric.c)


def linear_quadric(y: Array, h: Array, bound: Array, predicted_shape: Array) -> Quadric:
    """y = H [zeta; delta] + v, v in E(0, bound): H's image of zeta - gamma, in (1 - 1/tau_1) E(0, P) of the attitude,
    added to the bound with the best share for the volume to first order (16.2, 16.3)."""
    largest = math.sqrt(np.linalg.eigvalsh(predicted_shape[:3, :3])[-1])
    rest = 1.0 - 2.0 * math.atan(0.5 * largest) / largest
    added = rest**2 * h[:, :3] @ predicted_shape[:3, :3] @ h[:, :3].T
    p = math.sqrt(np.trace(np.linalg.solve(bound, added)) / len(y))
    wider = (1.0 + p) * bound + (1.0 + 1.0 / p) * added if p > 0.0 else bound
    information = np.linalg.inv(wider)
    return Quadric(h.T @ information @ h, -h.T @ information @ y, float(1.0 - y @ information @ y))


# Fusion (16.5)


def combined(quadrics: Sequence[Quadric], multipliers: Array) -> Quadric:
    """sum mu_k (A_k, g_k, c_k)."""
    return Quadric(
        np.tensordot(multipliers, [q.a for q in quadrics], 1),
        np.tensordot(multipliers, [q.g for q in quadrics], 1),
        float(np.dot(multipliers, [q.c for q in quadrics])),
    )


def level(quadric: Quadric) -> float:
    """N = c + g'A^-1 g, the greatest slack of a quadric with A > 0."""
    return float(quadric.c + quadric.g @ np.linalg.solve(quadric.a, quadric.g))


def log_size(shape: Array, criterion: Criterion, weight: Array | None = None) -> float:
    """log det P, or n log tr(W P)."""
    if criterion == "volume":
        return float(np.linalg.slogdet(shape)[1])
    metric = np.eye(len(shape)) if weight is None else weight
    return len(shape) * math.log(np.trace(metric @ shape))


def objective(
    quadrics: Sequence[Quadric], multipliers: Array, criterion: Criterion, weight: Array | None = None
) -> float:
    """F(mu) = N - log det A, or N + n log tr(W A^-1) (16.4); infinite unless A > 0."""
    whole = combined(quadrics, multipliers)
    if np.linalg.eigvalsh(whole.a)[0] <= 0.0:
        return math.inf
    return level(whole) + log_size(np.linalg.inv(whole.a), criterion, weight)


def size_metric(inverse: Array, criterion: Criterion, weight: Array | None = None) -> Array:
    """V = A^-1, or n A^-1 W A^-1 / tr(W A^-1), with d F = s - tr(V dA) (16.5)."""
    if criterion == "volume":
        return inverse
    metric = np.eye(len(inverse)) if weight is None else weight
    return np.asarray(len(inverse) * inverse @ metric @ inverse / np.trace(metric @ inverse))


def gradient(
    quadrics: Sequence[Quadric], multipliers: Array, criterion: Criterion, weight: Array | None = None
) -> Array:
    """d_k F = s_k(u^) - tr(V A_k) (16.5)."""
    whole = combined(quadrics, multipliers)
    inverse = np.linalg.inv(whole.a)
    v = size_metric(inverse, criterion, weight)
    center = -inverse @ whole.g
    return np.array([slack(q, center) - np.sum(v * q.a) for q in quadrics])


def hessian(
    quadrics: Sequence[Quadric], multipliers: Array, criterion: Criterion, weight: Array | None = None
) -> Array:
    """2 r_j'A^-1 r_k + tr(A^-1 A_j A^-1 A_k), or + 2 tr(A^-1 A_j V A_k) - tr(V A_j) tr(V A_k) / n (16.5)."""
    whole = combined(quadrics, multipliers)
    inverse = np.linalg.inv(whole.a)
    v = size_metric(inverse, criterion, weight)
    matrices = np.array([q.a for q in quadrics])
    slopes = matrices @ (-inverse @ whole.g) + np.array([q.g for q in quadrics])
    traces = np.einsum("ab,jbc,cd,kda->jk", inverse, matrices, v, matrices, optimize=True)
    if criterion == "trace":
        by_size = np.einsum("ab,jab->j", v, matrices)
        traces = traces + traces.T - np.outer(by_size, by_size) / len(inverse)
    return np.asarray(2.0 * slopes @ inverse @ slopes.T + traces)


def best_multipliers(
    quadrics: Sequence[Quadric], start: Array, criterion: Criterion, weight: Array | None = None
) -> Array:
    """The minimiser of F over mu > 0, by Newton's steps in log mu, from a start with A > 0 and N > 0."""

    def value(x: Array) -> float:
        return objective(quadrics, np.exp(x), criterion, weight)

    def slope(x: Array) -> Array:
        mu = np.exp(x)
        return mu * gradient(quadrics, mu, criterion, weight)

    def curvature(x: Array) -> Array:
        mu = np.exp(x)
        return np.outer(mu, mu) * hessian(quadrics, mu, criterion, weight) + np.diag(slope(x))

    n = len(quadrics[0].g)
    x = np.log(start * n / level(combined(quadrics, start)))
    result = scipy.optimize.minimize(value, x, jac=slope, hess=curvature, method="trust-exact", options={"gtol": 1e-10})
    return np.exp(result.x)


def family_member(quadrics: Sequence[Quadric], multipliers: Array) -> tuple[Array, Array]:
    """Center -A^-1 g and shape N A^-1 of the bound that multipliers give (7.3)."""
    whole = combined(quadrics, multipliers)
    return -np.linalg.solve(whole.a, whole.g), level(whole) * np.linalg.inv(whole.a)


# Recentring (16.3)


def moved_error(g: Array, g_hat: Array) -> Array:
    """The Gibbs vector g seen from g^ (16.3)."""
    return (g - g_hat - np.cross(g_hat, g)) / (1.0 + g_hat @ g)


def recentred(about: GibbsSet, center: Array, shape: Array) -> GibbsSet:
    """The errors E(center, shape) about a set's center, about their own: E(0, Q), and what sigma adds (16.3)."""
    g = 0.5 * center[:3]
    scale = 1.0 + g @ g
    b = np.eye(6)
    b[:3, :3] = (np.eye(3) - so3.hat(g)) / scale
    q = b @ shape @ b.T
    e = math.sqrt(g @ shape[:3, :3] @ g) / (2.0 * scale)
    if e >= 1.0:
        raise ValueError("the set may reach half turns about its center")
    return GibbsSet(about.attitude @ so3.cayley(g), about.vector + center[3:], with_attitude_added(q, e / (1.0 - e)))


def with_attitude_added(shape: Array, factor: float) -> Array:
    """A bound of the sum of E(0, P) and E(0, factor^2 P) of the attitude alone, which the core takes 65/64 times larger
    for the sake of rounding: (1 + p) P + (1 + 1/p) R with p^2 = tr(P^-1 R)/n (16.3)."""
    added = np.zeros_like(shape)
    added[:3, :3] = 65.0 / 64.0 * factor**2 * shape[:3, :3]
    p = math.sqrt(np.trace(np.linalg.solve(shape, added)) / len(shape))
    return (1.0 + p) * shape + (1.0 + 1.0 / p) * added if p > 0.0 else shape
