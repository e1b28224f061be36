"""The estimator: flow update, filtering, convergence (paper, sections 3.1, 3.3, 3.4).

``first_order=False`` is the paper as printed, which moves a set from one centre to
another without turning its shape; ``first_order=True`` keeps the right Jacobian of the
move (theory 10).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import ellipsoid, so3
from .ellipsoid import Criterion, StateEllipsoid
from .integrator import NO_TORQUE
from .linearization import linearize_flow
from .measurement import LinearMeasurement, Measurement, measured_ellipsoid
from .rigid_body import RigidBody, State
from .so3 import Array


class Prediction(NamedTuple):
    """E^f, the transition A^f that made its shape, and its time."""

    ellipsoid: StateEllipsoid
    transition: Array
    time: float


class Fusion(NamedTuple):
    """The fused ellipsoid, and its shape before the move to its own centre."""

    ellipsoid: StateEllipsoid
    shape_before_move: Array
    multiplier: float


class Cycle(NamedTuple):
    """One prediction, one measurement, and what came of them."""

    prediction: Prediction
    measured: StateEllipsoid
    fusion: Fusion
    convergence: "Convergence"


class Convergence(NamedTuple):
    """Diagnostics of the convergence theorem (sufcond; theory 11)."""

    transition_norm: float  # |A^f|, Frobenius
    chi: float  # sqrt(6 + 30 kappa(P^m))
    least_eigenvalue: float  # of (P^m)^-1 P^f
    contraction: float  # the theorem holds for every c above it, if it is below one
    trace_ratio: float  # tr P / tr P_0, as measured


def predict(
    body: RigidBody,
    estimate: StateEllipsoid,
    time: float,
    h: float,
    steps: int,
    order: int = 2,
    control: ArrayLike = NO_TORQUE,
) -> Prediction:
    """Flow update: centre by findf, updateR, updatePi; P^f = A^f P (A^f)' (Pkpf)."""
    start = State(estimate.attitude, estimate.angular_velocity, time)
    end, transition, _ = linearize_flow(body, start, h, steps, order, control)
    shape = transition @ estimate.shape @ transition.T
    predicted = StateEllipsoid(end.attitude, end.angular_velocity, shape)
    return Prediction(predicted, transition, end.time)


def centre_offset(measured: StateEllipsoid, predicted: StateEllipsoid) -> Array:
    """x^mf = [zeta^mf; delta omega^mf] (errz, errPi)."""
    return ellipsoid.state_error(measured, predicted.attitude, predicted.angular_velocity)


def recentred_shape(offset: Array, shape: Array) -> Array:
    """The predicted shape seen from the measured centre (theory 10).

    log(exp(a) exp(zeta)) = a + J_r^-1(a) zeta to first order; the paper has a + zeta
    (ellRmf).
    """
    return _turned(so3.right_jacobian_inverse(offset[:3]), shape)


def moved(centre: StateEllipsoid, change: Array, shape: Array, first_order: bool) -> StateEllipsoid:
    """The ellipsoid E(change, shape) about ``centre``, about its own centre.

    The centre by nattes and nveles. As exp(zeta_hat + d) = exp(zeta_hat) exp(J_r d) to
    first order, the shape becomes G P G' with G = diag(J_r(zeta_hat), I) (theory 10); the
    paper leaves it (nunmat).
    """
    zeta, delta = change[:3], change[3:]
    if first_order:
        shape = _turned(so3.right_jacobian(zeta), shape)
    return StateEllipsoid(centre.attitude @ so3.exp(zeta), centre.angular_velocity + delta, shape)


def fuse(
    measured: StateEllipsoid,
    predicted: StateEllipsoid,
    first_order: bool,
    criterion: Criterion = "trace",
    weight: Array | None = None,
) -> Fusion:
    """Outer ellipsoid of the intersection of E^m and E^f (filter, xhatP, nattes)."""
    offset = centre_offset(measured, predicted)
    shape_f = recentred_shape(offset, predicted.shape) if first_order else predicted.shape
    q = ellipsoid.intersection_multiplier(offset, measured.shape, shape_f, criterion, weight)
    change, shape = ellipsoid.intersection_member(offset, measured.shape, shape_f, q)
    return Fusion(moved(measured, change, shape, first_order), shape, q)


def fuse_linear(
    predicted: StateEllipsoid,
    measurement: LinearMeasurement,
    first_order: bool,
    criterion: Criterion = "trace",
    weight: Array | None = None,
) -> Fusion:
    """Fuse a partial measurement in the error about the predicted centre (theory 10)."""
    y, h, r = measurement
    mu = ellipsoid.measurement_multiplier(predicted.shape, y, h, r, criterion, weight)
    change, shape = ellipsoid.measurement_member(predicted.shape, y, h, r, mu)
    return Fusion(moved(predicted, change, shape, first_order), shape, mu)


def convergence(transition: Array, shape_m: Array, shape_f: Array, q: float, trace_ratio: float) -> Convergence:
    """|A^f| < sqrt(c (q + lambda_min) / (6 chi (1 + q))), solved for c (sufcond)."""
    norm = float(np.linalg.norm(transition))
    chi = math.sqrt(6.0 + 30.0 * float(np.linalg.cond(shape_m)))
    eigenvalues = np.linalg.eigvals(np.linalg.solve(shape_m, shape_f))
    least = float(np.min(eigenvalues.real))
    ratio = 1.0 if math.isinf(q) else (1.0 + q) / (q + least)
    return Convergence(norm, chi, least, 6.0 * chi * ratio * norm**2, trace_ratio)


def cycle(
    body: RigidBody,
    estimate: StateEllipsoid,
    time: float,
    h: float,
    steps: int,
    measurement: Measurement,
    first_order: bool,
    order: int = 2,
    control: ArrayLike = NO_TORQUE,
    criterion: Criterion = "trace",
    weight: Array | None = None,
) -> Cycle:
    """Predict to the time of the measurement, measure, fuse (filtatt1)."""
    prediction = predict(body, estimate, time, h, steps, order, control)
    measured = measured_ellipsoid(measurement, weight)
    fusion = fuse(measured, prediction.ellipsoid, first_order, criterion, weight)
    diagnostics = convergence(
        prediction.transition,
        measured.shape,
        prediction.ellipsoid.shape,
        fusion.multiplier,
        float(np.trace(fusion.shape_before_move) / np.trace(estimate.shape)),
    )
    return Cycle(prediction, measured, fusion, diagnostics)


def _turned(block: Array, shape: Array) -> Array:
    """G P G' with G = diag(block, I)."""
    g = np.eye(6)
    g[:3, :3] = block
    return g @ shape @ g.T
