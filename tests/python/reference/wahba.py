"""Attitude determination from directions: Wahba's problem (paper, section 2.1).

Directions are (m, 3) arrays of unit rows: ``reference`` the known e^i, ``body`` the
measured b^i; ``weights`` has m entries.
"""

import numpy as np

from . import so3
from .so3 import Array


def attitude_profile(reference: Array, body: Array, weights: Array) -> Array:
    """L = E W B' (paper, below san2006)."""
    return reference.T @ np.diag(weights) @ body


def cost(attitude: Array, reference: Array, body: Array, weights: Array) -> float:
    """sum_i w_i |e^i - C b^i|^2 / 2 (wahba, with the trace put right in theory 8)."""
    residual = reference.T - attitude @ body.T
    return 0.5 * float(np.trace(residual @ np.diag(weights) @ residual.T))


def solve_svd(reference: Array, body: Array, weights: Array) -> Array:
    """The constrained minimiser U diag(1, 1, det U det V) V' (theory 8)."""
    return so3.nearest_rotation(attitude_profile(reference, body, weights))


def davenport_matrix(profile: Array) -> Array:
    """The K with q'K q = tr(L' C(q)) = sum_i w_i e^i.C b^i (theory 8)."""
    matrix = np.empty((4, 4))
    matrix[0, 0] = np.trace(profile)
    matrix[0, 1:] = matrix[1:, 0] = 2.0 * so3.vee(profile)
    matrix[1:, 1:] = profile + profile.T - np.trace(profile) * np.eye(3)
    return matrix


def solve_davenport(reference: Array, body: Array, weights: Array) -> Array:
    """Davenport's q-method: the top eigenvector of K (theory 8)."""
    matrix = davenport_matrix(attitude_profile(reference, body, weights))
    _, vectors = np.linalg.eigh(matrix)
    return so3.rotation_from_quaternion(vectors[:, -1])


def solve_foam(reference: Array, body: Array, weights: Array) -> Array:
    """Markley's matrix by (8.6), with the largest root of (8.5) from NumPy's polynomials."""
    profile = attitude_profile(reference, body, weights)
    square, determinant = float(np.sum(profile**2)), float(np.linalg.det(profile))
    u, values, v = np.linalg.svd(profile)
    cofactors = np.linalg.det(u) * np.linalg.det(v) * u @ np.diag(np.prod(values) / values) @ v
    quartic = [1.0, 0.0, -2.0 * square, -8.0 * determinant, square**2 - 4.0 * float(np.sum(cofactors**2))]
    root = float(np.max(np.roots(quartic).real))
    kappa = 0.5 * (root**2 - square)
    matrix = (kappa + square) * profile + root * cofactors - profile @ profile.T @ profile
    return np.asarray(matrix / (kappa * root - determinant))


def solve_qr(reference: Array, body: Array, weights: Array) -> Array:
    """The paper's C = S L, S = Q sqrt((R R')^-1) Q', L = Q R (soln, LQR, meaRex).

    It is a rotation only if det L > 0 (theory 8), which is asked for here. The sign of
    Q, which the paper wants in SO(3), cancels.
    """
    profile = attitude_profile(reference, body, weights)
    if not np.linalg.det(profile) > 0.0:
        raise ValueError("the QR formula needs det L > 0")
    q, r = np.linalg.qr(profile)
    values, vectors = np.linalg.eigh(r @ r.T)
    root_of_inverse = vectors @ np.diag(1.0 / np.sqrt(values)) @ vectors.T
    return np.asarray(q @ root_of_inverse @ q.T @ profile)


def with_cross_product(reference: Array, body: Array) -> tuple[Array, Array]:
    """Two directions and their cross products, as unit vectors (paper, below wahba)."""
    third = (np.cross(directions[0], directions[1]) for directions in (reference, body))
    e3, b3 = (vector / np.linalg.norm(vector) for vector in third)
    return np.vstack([reference, e3]), np.vstack([body, b3])


def condition(attitude: Array, reference: Array, body: Array, weights: Array) -> float:
    """Largest over smallest eigenvalue of tr(A) I - A, A = C'L (zetakpm).

    A is symmetric at the solution. This is the matrix that zetakpm inverts.
    """
    a = attitude.T @ attitude_profile(reference, body, weights)
    values = np.linalg.eigvalsh(np.trace(a) * np.eye(3) - 0.5 * (a + a.T))
    return float(values[-1] / values[0])
