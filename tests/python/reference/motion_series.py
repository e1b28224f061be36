"""The motion of the guaranteed flow's center as power series, and the torque's expansion (theory 17.1 to 17.3).

A torque is here a form of first or second degree in the direction s = C'r(t) of a vector that turns in the reference
frame. It follows that all of its expansions come from those of s, in time from the series of C, and in the attitude
error gamma = 2 tan(theta/2) n from the terms by which a turn moves a vector.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import so3
from .ellipsoid import sum_minimum_trace
from .own_torque import Linear, Local, Quadratic, Stated, expanded, turned_direction
from .rigid_body import Free, GravityGradient, Potential, UniformGravity
from .so3 import Array

ORDER = 8  # of the rate's polynomial (17.2)
DIRECTION_TERMS = 8  # of a direction's series, of which the torque's forms in the middle of a step are made (17.3)
ATTITUDE_TERMS = 40  # of the attitude's series: the theory sums the quaternion's to s^9, this to rounding
ROUNDING = float(np.finfo(float).eps)

LEVI_CIVITA = np.array([so3.hat(-axis) for axis in np.eye(3)])  # a cross b = einsum("iab,a,b", LEVI_CIVITA, a, b)


# Norms and sums of shapes


def norm(matrix: Array) -> float:
    """A bound of the largest singular value by mean and deviation of the squares of all (Samuelson's inequality).

    The theory asks for a bound of the spectral norm. This one is the core's, and the sets depend on it.
    """
    squares = np.linalg.svd(matrix, compute_uv=False) ** 2
    mean = float(np.mean(squares))
    variance = float(np.mean((squares - mean) ** 2)) + 64.0 * ROUNDING * mean**2  # and the rounding of both means
    return float(np.sqrt(mean + np.sqrt((len(squares) - 1) * variance)))


def sum_of_shapes(shapes: Sequence[Array]) -> Array:
    """The ellipsoid of least trace about a sum (7.1); none, or points, are a point."""
    if all(np.trace(shape) == 0.0 for shape in shapes):
        return np.zeros_like(shapes[0])
    return sum_minimum_trace(shapes)


# Torques


class DirectionTorque(NamedTuple):
    """M_i = form_ia s_a or form_iab s_a s_b, s = C'r(t), r(t) = cos(n t) axes_0 + sin(n t) axes_1."""

    form: Array  # (3, 3) or (3, 3, 3), symmetric in all but the first index
    axes: Array  # (2, 3)
    turn_rate: float  # n, rad/s
    by_inertia: float  # how much an error of the inertia changes it, 1/s^2
    products: float = 0.0  # length of the products that it is made of, where they may cancel

    @property
    def degree(self) -> int:
        return self.form.ndim - 1


def direction_torque(potential: Potential | Linear | Quadratic | Stated) -> DirectionTorque | None:
    """m g rho x s for uniform gravity, 3 n^2 s x J s for the gravity gradient (theory 5)."""
    match potential:
        case UniformGravity(mass, gravity, centre_of_mass):
            down = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
            return DirectionTorque(mass * gravity * so3.hat(centre_of_mass), down, 0.0, 0.0)
        case GravityGradient(inertia, orbit_rate):
            strength = 3.0 * orbit_rate**2
            form = strength * np.einsum("iac,cb->iab", LEVI_CIVITA, inertia)
            return DirectionTorque(symmetrized(form, 2), np.eye(3)[:2], orbit_rate, strength)
        case Linear(moment, direction, turn):
            return DirectionTorque(so3.hat(moment), quarter_turns(direction, turn), float(np.linalg.norm(turn)), 0.0)
        case Quadratic(matrix, direction, turn):
            form = symmetrized(np.einsum("iac,cb->iab", LEVI_CIVITA, matrix), 2)
            size = float(np.linalg.norm(matrix))
            return DirectionTorque(form, quarter_turns(direction, turn), float(np.linalg.norm(turn)), 0.0, size)
        case Free():
            return None
    raise TypeError(f"the torque of {potential} is not known as a form of a direction")


def quarter_turns(direction: Array, turn: Array) -> Array:
    """A direction at time 0, and a quarter of a turn later; zero if it stands still."""
    rate = float(np.linalg.norm(turn))
    later = turned_direction(direction, turn, 0.5 * np.pi / rate) if rate > 0.0 else np.zeros(3)
    return np.array([turned_direction(direction, turn, 0.0), later])


def local_torques(local: Local) -> list[DirectionTorque]:
    """The three terms of (17.12), without the part that is constant in body axes."""
    return [
        DirectionTorque(form, np.array([local.middle[:, i], np.zeros(3)]), 0.0, 0.0)
        for i, form in enumerate(local.forms())
    ]


def symmetrized(tensor: Array, count: int) -> Array:
    """The mean over the orders of the last ``count`` indices."""
    first = tensor.ndim - count
    orders = list(itertools.permutations(range(first, tensor.ndim)))
    return np.asarray(sum(np.transpose(tensor, (*range(first), *order)) for order in orders) / len(orders))


def turned(direction: Array, order: int) -> Array:
    """The term of this order in gamma of cay(gamma/2)'s, as a tensor (17.3):

    s + s x gamma + (gamma (gamma.s) - s |gamma|^2) / 2 - |gamma|^2 s x gamma / 4 + ...
    """
    identity = np.eye(3)
    match order:
        case 0:
            return direction
        case 1:
            return so3.hat(direction)
        case 2:
            outer = np.einsum("aj,k->ajk", identity, direction) - np.einsum("a,jk->ajk", direction, identity)
            return symmetrized(0.5 * outer, 2)
        case 3:
            return symmetrized(-0.25 * np.einsum("jk,al->ajkl", identity, so3.hat(direction)), 3)
    raise ValueError(f"no term of order {order}")


def torque_term(torque: DirectionTorque, direction: Array, order: int) -> Array:
    """The term of this order in gamma of M(cay(gamma/2)), as a symmetric tensor (17.3)."""
    if torque.degree == 1:
        return np.tensordot(torque.form, turned(direction, order), 1)
    total = np.zeros((3,) * (order + 1))
    for i in range(order + 1):
        half = np.tensordot(torque.form, turned(direction, i), ([1], [0]))  # the other s is now the second index
        total += np.tensordot(half, turned(direction, order - i), ([1], [0]))
    return symmetrized(total, order) if order > 1 else total


class TorqueBounds(NamedTuple):
    """What is known of T M at every attitude and time (17.3)."""

    shape: Array  # of an ellipsoid that holds it
    largest: float  # its greatest length, at most
    degree: int
    turn_rate: float
    by_inertia: float


def torque_bounds(torques: Sequence[DirectionTorque], transform: Array, locals_: Sequence[Local] = ()) -> TorqueBounds:
    """T S(m) s is in the ellipsoid of T S(m) S(m)'T', forms F without a trace in that of (2/3) T F F'T' (17.3).

    A sum has the sum of the sizes, the largest degree and the largest rate. An expansion about an attitude is at most
    sqrt(3/2) T M'* (17.10).
    """
    shapes, norms = [np.zeros((3, 3))], [0.0]
    matrices = [
        (transform @ torque.form.reshape(3, -1)) * (1.0 if torque.degree == 1 else math.sqrt(2.0 / 3.0))
        for torque in torques
    ]
    matrices += [math.sqrt(1.5) * transform @ local.derivative for local in locals_]
    for rows in matrices:
        shapes.append(rows @ rows.T)
        norms.append(norm(rows))
    return TorqueBounds(
        sum_of_shapes(shapes),
        sum(norms),
        max([torque.degree for torque in torques] + [1 for _ in locals_], default=0),
        max((torque.turn_rate for torque in torques), default=0.0),
        sum(torque.by_inertia for torque in torques),
    )


# The body and its motion


class Body(NamedTuple):
    """Inertia, kg m^2, and the potentials whose torques add up."""

    inertia: Array
    potentials: tuple[Potential | Linear | Quadratic | Stated, ...] = ()

    @property
    def torques(self) -> list[DirectionTorque]:
        found = (direction_torque(p) for p in self.potentials if not isinstance(p, Stated))
        return [torque for torque in found if torque is not None]

    @property
    def stated(self) -> list[Stated]:
        """The torques that are expanded anew in each step."""
        return [potential for potential in self.potentials if isinstance(potential, Stated)]

    @property
    def moments(self) -> Array:
        """The principal moments of inertia, smallest first."""
        return np.linalg.eigvalsh(self.inertia)


class BodyInput(NamedTuple):
    """What acts over a whole interval: a control torque, N m, and the momentum of a wheel, N m s."""

    control_torque: Array = np.zeros(3)
    wheel_momentum: Array = np.zeros(3)


class StepTooLong(ValueError):
    """The series says nothing of the attitude at the end of the step."""


class MotionSeries(NamedTuple):
    """The center over one step of length h: omega(s) = sum omega_k s^k, and what it lacks of the motion (17.2)."""

    h: float
    rate: Array  # omega_k, (9, 3)
    momentum: Array  # of J omega + h_w
    torques: list[DirectionTorque]
    locals: list[Local]  # expansions of stated torques, whose terms are among the torques
    directions: list[Array]  # s_k of each torque, (8, 3)
    wheel_momentum: Array
    control_torque: Array
    end_attitude: Array
    end_rate: Array
    acceleration: TorqueBounds  # of J^-1 M
    largest_torque: float  # of M
    largest_rate: float  # sum |omega_k| h^k
    attitude_error: float  # angle, rad
    rate_defect: float  # rad/s
    gyroscopic_size: float  # of the products that J^-1 is applied to, over the least moment, 1/s
    stiffness_size: float  # 1/s^2

    def tail(self, first: int, growth: float, turn_rate: float) -> float:
        """(17.3) at s = h, of a series with |a(z)| <= exp(growth (sum |omega_k||z|^k + turn_rate) |z|)."""
        return tail(self.rate, self.h, first, growth, turn_rate)


def attitude_series(attitude: Array, rate: Array, terms: int) -> Array:
    """C_k of C' = C S(omega): (k + 1) C_(k+1) = sum_i C_(k-i) S(omega_i)."""
    series = [attitude]
    for k in range(terms - 1):
        product = sum(series[k - i] @ so3.hat(rate[i]) for i in range(min(k, len(rate) - 1) + 1))
        series.append(np.asarray(product) / (k + 1))
    return np.array(series)


def reference_series(torque: DirectionTorque, time: float, terms: int) -> Array:
    """r_k of cos(n t) axes_0 + sin(n t) axes_1 about a time: each derivative is n times a quarter turn on."""
    n = torque.turn_rate
    phases = n * time + 0.5 * np.pi * np.arange(terms)
    factors = np.array([n**k / math.factorial(k) for k in range(terms)])
    return factors[:, None] * (np.outer(np.cos(phases), torque.axes[0]) + np.outer(np.sin(phases), torque.axes[1]))


def direction_series(torque: DirectionTorque, attitudes: Array, time: float) -> Array:
    """s_k = sum_i C_i' r_(k-i)."""
    references = reference_series(torque, time, len(attitudes))
    return np.array([sum(attitudes[i].T @ references[k - i] for i in range(k + 1)) for k in range(len(attitudes))])


def product_coefficient(a: Array, b: Array, k: int, product: Callable[[Array, Array], Array]) -> Array:
    """Coefficient k of the product of two series."""
    return np.asarray(sum(product(a[i], b[k - i]) for i in range(k + 1)))


def torque_coefficient(torque: DirectionTorque, directions: Array, k: int) -> Array:
    """M_k."""
    if torque.degree == 1:
        return torque.form @ directions[k]
    return product_coefficient(directions, directions, k, lambda a, b: np.einsum("iab,a,b->i", torque.form, a, b))


def torque_jacobian_coefficient(torque: DirectionTorque, directions: Array, k: int) -> Array:
    """Coefficient k of dM/dgamma."""
    if torque.degree == 1:
        return torque.form @ so3.hat(directions[k])
    return product_coefficient(
        directions, directions, k, lambda a, b: 2.0 * np.einsum("iab,aj,b->ij", torque.form, so3.hat(a), b)
    )


def tail(rate: Array, h: float, first: int, growth: float, turn_rate: float) -> float:
    """sum_(k >= first) |a_k| h^k by Cauchy's estimate on |z| = kappa h (17.3).

    Any kappa > 1 will do. The core takes first / (growth (sup |omega| + turn_rate) h), within 2 and 64, and halves it,
    down to 2, until the exponent is at most ``first``.
    """
    norms = np.linalg.norm(rate, axis=1)
    powers = np.arange(len(norms))

    def exponent(kappa: float) -> float:
        radius = kappa * h
        return growth * (float(norms @ radius**powers) + turn_rate) * radius

    speed = exponent(1.0)
    kappa = min(max(first / speed, 2.0), 64.0) if speed > 0.0 else 64.0
    while exponent(kappa) > first and kappa > 2.0:
        kappa = max(0.5 * kappa, 2.0)
    if exponent(kappa) > 700.0:  # beyond all numbers
        return math.inf
    return math.exp(exponent(kappa)) / (kappa**first * (1.0 - 1.0 / kappa))


def expand_motion(
    body: Body, attitude: Array, angular_velocity: Array, time: float, h: float, given: BodyInput
) -> MotionSeries:
    """(k + 1) J omega_(k+1) = M_k + u [k = 0] - sum_i omega_i x (J omega + h_w)_(k-i), and the defect (17.2)."""
    inertia, known = body.inertia, body.torques
    locals_ = [expanded(stated, attitude, angular_velocity, time, h) for stated in body.stated]
    torques = known + [torque for local in locals_ for torque in local_torques(local)]
    rate = np.zeros((ORDER + 1, 3))
    momentum = np.zeros((ORDER + 1, 3))
    rate[0] = angular_velocity
    momentum[0] = inertia @ rate[0] + given.wheel_momentum
    for k in range(ORDER):
        attitudes = attitude_series(attitude, rate[: k + 1], k + 1)
        change = -product_coefficient(rate, momentum, k, np.cross)
        for torque in torques:
            change = change + torque_coefficient(torque, direction_series(torque, attitudes, time), k)
        if k == 0:
            change = change + given.control_torque + sum((local.value for local in locals_), np.zeros(3))
        rate[k + 1] = np.linalg.solve(inertia, change / (k + 1))
        momentum[k + 1] = inertia @ rate[k + 1]

    attitudes = attitude_series(attitude, rate, ATTITUDE_TERMS)
    powers = h ** np.arange(ATTITUDE_TERMS)
    acceleration = torque_bounds(known, np.linalg.inv(inertia), locals_)
    fixed = sum(float(np.linalg.norm(local.value)) for local in locals_)
    largest_torque = torque_bounds(known, np.eye(3), locals_).largest + fixed
    products = sum(torque.products for torque in known)
    norms, momentum_norms = np.linalg.norm(rate, axis=1), np.linalg.norm(momentum, axis=1)
    largest_rate = float(norms @ powers[: ORDER + 1])

    # The coefficients of d from the eighth on: products of the polynomials, and what is left of the torque's series.
    rest = sum(
        norms[i] * momentum_norms[j] * powers[i + j]
        for i in range(ORDER + 1)
        for j in range(ORDER + 1)
        if i + j >= ORDER
    )
    least_moment, _, greatest_moment = body.moments
    rest = rest / least_moment
    rest += acceleration.largest * tail(rate, h, ORDER, acceleration.degree, acceleration.turn_rate)
    gyroscopic_size = (greatest_moment * largest_rate + float(np.linalg.norm(given.wheel_momentum))) / least_moment
    angle = 1.0 + abs(acceleration.turn_rate * time)
    stiffness_size = (largest_torque + products + acceleration.by_inertia * greatest_moment) * angle / least_moment
    control = float(np.linalg.norm(given.control_torque)) / least_moment
    slopes = largest_rate * gyroscopic_size + stiffness_size + control
    change = (largest_rate - float(norms[0])) * greatest_moment / least_moment
    rounding = ROUNDING * (32.0 * largest_rate + 64.0 * (change + slopes * h))

    attitude_error = 4.5 * tail(rate, h, ORDER + 2, 0.5, 0.0) + 32.0 * ROUNDING
    if attitude_error >= 1e-3:
        raise StepTooLong(f"the angle may be wrong by {attitude_error} rad")
    return MotionSeries(
        h=h,
        rate=rate,
        momentum=momentum,
        torques=torques,
        locals=locals_,
        directions=[direction_series(torque, attitudes[:DIRECTION_TERMS], time) for torque in torques],
        wheel_momentum=given.wheel_momentum,
        control_torque=given.control_torque,
        end_attitude=so3.nearest_rotation(np.tensordot(powers, attitudes, 1)),
        end_rate=powers[: ORDER + 1] @ rate,
        acceleration=acceleration,
        largest_torque=largest_torque,
        largest_rate=largest_rate,
        attitude_error=attitude_error,
        rate_defect=float(rest) * h / (ORDER + 1) + rounding,
        gyroscopic_size=gyroscopic_size,
        stiffness_size=stiffness_size,
    )


# The errors


def error_rates(
    body: Body,
    center_attitude: Array,
    center_rate: Array,
    time: float,
    wheel_momentum: Array,
    error: Array,
    disturbance: ArrayLike = (0.0, 0.0, 0.0),
) -> Array:
    """The derivatives of gamma and delta, exactly (17.1, 17.2), under the unknown torque less the defect."""
    gamma, delta = error[:3], error[3:]
    inertia = body.inertia
    attitude = center_attitude @ so3.cayley(0.5 * gamma)
    torque = np.asarray(disturbance, dtype=float)
    for potential in body.potentials:
        torque = torque + potential.torque(attitude, time) - potential.torque(center_attitude, time)
    gamma_rate = (
        -np.cross(center_rate, gamma) + delta + 0.5 * np.cross(gamma, delta) + 0.25 * gamma * float(gamma @ delta)
    )
    gyroscopic = so3.hat(inertia @ center_rate + wheel_momentum) - so3.hat(center_rate) @ inertia
    delta_rate = np.linalg.solve(inertia, gyroscopic @ delta + torque - np.cross(delta, inertia @ delta))
    return np.concatenate([gamma_rate, delta_rate])
