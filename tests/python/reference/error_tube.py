"""The tube of errors y = [gamma; delta] about a motion, with all that is left out bounded (theory 17.4, 17.5).

y = Y(s) u with a polynomial Y; u moves by a quadratic map of where it began, by pushes within ellipsoids, and by a rest
that is bounded in norm. Quadratic and cubic maps are full tensors; a quadratic map G of R^6 is bounded by the norm of
the matrix that acts on u u', which is G with its last two indices taken as one.
"""

import math
from typing import NamedTuple

import numpy as np

from . import so3
from .motion_series import (
    LEVI_CIVITA,
    ROUNDING,
    Body,
    MotionSeries,
    norm,
    sum_of_shapes,
    symmetrized,
    torque_jacobian_coefficient,
    torque_term,
)
from .so3 import Array

FRAME_ORDER = 4  # of Y within a step
JACOBIAN_TERMS = 4  # of the torque's Jacobian


class Unbounded(ValueError):
    """The bounds do not close: the set is too large, or the step too long."""


class Uncertainty(NamedTuple):
    """What is not known of a body: a torque in E(0, torque), (N m)^2, and the inertia, by its spectral norm, kg m^2."""

    torque: Array = np.zeros((3, 3))
    inertia: float = 0.0


class Tube(NamedTuple):
    """y = Y (u0 + q(u0) + p + r), u0 in {set v : |v| <= 1}, p in the sum of the pushes' ellipsoids, |r| <= rest."""

    frame: Array  # Y
    set: Array
    second_order: Array  # q, (6, 6, 6)
    pushes: tuple[Array, ...]
    rest: float

    def displacement(self) -> float:
        """How far u may have moved from u0."""
        pushed = sum(math.sqrt(np.trace(push)) for push in self.pushes)
        return quadratic_norm(self.second_order) + pushed + self.rest


def quadratic_norm(quadratic: Array) -> float:
    """A bound b with |G(u, v)| <= b |u||v|."""
    return norm(quadratic.reshape(len(quadratic), -1))


def start(shape: Array, h: float, stiffness: float) -> Tube:
    """A tube from the ellipsoid of this shape.

    Y Y' is the shape, each block wider by a hundredth of its trace and by what the other block moves it in four steps
    of h: delta by h, gamma by h times the ``stiffness`` of the torque, 1/s^2. Any such Y will do. Both factors are
    Cholesky's, of the shape with a diagonal that is larger by 84 epsilon (17.7).
    """
    raised = shape + 84.0 * ROUNDING * np.diag(np.diag(shape))
    attitude, rate = float(np.trace(shape[:3, :3])), float(np.trace(shape[3:, 3:]))
    wider = [0.01 * attitude + (4.0 * h) ** 2 * rate] * 3 + [0.01 * rate + (4.0 * h * stiffness) ** 2 * attitude] * 3
    frame = np.linalg.cholesky(raised + np.diag(wider))
    return Tube(frame, np.linalg.solve(frame, np.linalg.cholesky(raised)), np.zeros((6, 6, 6)), (), 0.0)


# The linear part


def linear_coefficients(body: Body, series: MotionSeries) -> tuple[Array, Array]:
    """A_k of the linear part of (17.1), (17.2) with four terms of the torque's Jacobian, and J^-1 times that alone."""
    count = len(series.rate)
    stiffness = np.zeros((count, 3, 3))
    for torque, directions in zip(series.torques, series.directions, strict=True):
        for k in range(JACOBIAN_TERMS):
            stiffness[k] += np.linalg.solve(body.inertia, torque_jacobian_coefficient(torque, directions, k))
    a = np.zeros((count, 6, 6))
    a[0, :3, 3:] = np.eye(3)
    for k in range(count):
        a[k, :3, :3] = -so3.hat(series.rate[k])
        a[k, 3:, :3] = stiffness[k]
        gyroscopic = so3.hat(series.momentum[k]) - so3.hat(series.rate[k]) @ body.inertia
        a[k, 3:, 3:] = np.linalg.solve(body.inertia, gyroscopic)
    return a, stiffness


class LinearPart(NamedTuple):
    """Y over a step, Y(s) = Y(h/2) (I + W(s)) (17.4, within a step)."""

    middle: Array  # Y(h/2)
    end: Array
    inverse: Array  # Y(h/2)^-1
    by_attitude: float  # norm of the first three columns of the inverse
    by_rate: float  # and of the last
    attitude: float  # r_gamma
    rate: float  # r_delta
    odd_change: float  # w_1
    change: float  # w
    error: float  # of the integral of Y(h/2)^-1 E_Y


def linear_part(body: Body, series: MotionSeries, frame: Array) -> LinearPart:
    """Y' = A Y to the fourth order, and what is left of it."""
    h = series.h
    a, stiffness = linear_coefficients(body, series)
    y = [frame]
    for k in range(FRAME_ORDER + 1):
        y.append(np.asarray(sum(a[j] @ y[k - j] for j in range(k + 1))) / (k + 1))
    first_error = (FRAME_ORDER + 1) * y.pop()  # the coefficient of s^4 in A Y, which Y' lacks

    def at(s: float) -> Array:
        return np.asarray(sum(y_k * s**k for k, y_k in enumerate(y)))

    middle = at(0.5 * h)
    slope = np.asarray(sum(k * y[k] * (0.5 * h) ** (k - 1) for k in range(1, FRAME_ORDER + 1)))
    inverse = np.linalg.inv(middle)
    by_attitude, by_rate = norm(inverse[:, :3]), norm(inverse[:, 3:])
    upper = [float(np.linalg.norm(y_k[:3])) for y_k in y]
    lower = [float(np.linalg.norm(y_k[3:])) for y_k in y]
    odd_change = norm(inverse @ slope) * 0.5 * h
    curvature = sum(
        k * (k - 1) * h ** (k - 2) * (by_attitude * upper[k] + by_rate * lower[k]) for k in range(2, FRAME_ORDER + 1)
    )
    change = odd_change + 0.5 * curvature * (0.5 * h) ** 2
    if not change < 0.5:
        raise Unbounded("Y changes too much in a step")
    attitude, rate = norm(middle[:3]), norm(middle[3:])

    # E_Y: the coefficient of s^4 as it is, the products beyond by Frobenius norms, the rest of the Jacobian by (17.3).
    least_moment, _, greatest_moment = body.moments
    upper_rest = lower_rest = 0.0
    for j in range(len(a)):
        rate_norm, momentum_norm = np.linalg.norm(series.rate[j]), np.linalg.norm(series.momentum[j])
        gyroscopic = (momentum_norm + greatest_moment * rate_norm) / least_moment
        for i in range(FRAME_ORDER + 1):
            if i + j > FRAME_ORDER:
                power = h ** (i + j + 1) / (FRAME_ORDER + 2)
                upper_rest += power * rate_norm * upper[i]
                lower_rest += power * (gyroscopic * lower[i] + np.linalg.norm(stiffness[j]) * upper[i])
    bounds = series.acceleration
    jacobian_tail = bounds.degree * bounds.largest * series.tail(JACOBIAN_TERMS, bounds.degree, bounds.turn_rate)
    lower_rest += jacobian_tail * h / (JACOBIAN_TERMS + 1) * attitude * (1.0 + change)
    error = float(np.linalg.norm(inverse @ first_error)) * h ** (FRAME_ORDER + 1) / (FRAME_ORDER + 1)
    error += by_attitude * float(upper_rest) + by_rate * float(lower_rest)
    error += 256.0 * ROUNDING * (by_attitude * attitude + by_rate * rate) * (1.0 + change)
    attitude_now, rate_now = attitude * (1.0 + change), rate * (1.0 + change)
    of_rates = (series.gyroscopic_size + greatest_moment / least_moment * rate_now) * rate_now
    of_torque = series.stiffness_size * attitude_now * (1.0 + attitude_now)
    error += 128.0 * ROUNDING * h * by_rate * (of_rates + of_torque)
    return LinearPart(
        middle, at(h), inverse, by_attitude, by_rate, attitude, rate, float(odd_change), float(change), error
    )


# The terms of second and third order in the middle of the step


def torque_forms(body: Body, series: MotionSeries, order: int) -> Array:
    """The terms of an order in gamma of J^-1 M in the middle of the step, from eight terms of the directions (17.3)."""
    total = np.zeros((3,) * (order + 1))
    for torque, directions in zip(series.torques, series.directions, strict=True):
        direction = (0.5 * series.h) ** np.arange(len(directions)) @ directions
        total += torque_term(torque, direction, order)
    return np.tensordot(np.linalg.inv(body.inertia), total, 1)


def second_order_rates(body: Body, series: MotionSeries) -> Array:
    """N_2 of y' in the middle of the step: gamma x delta / 2, -J^-1 (delta x J delta) and the torque's, (6, 6, 6)."""
    n = np.zeros((6, 6, 6))
    n[:3, :3, 3:] = 0.5 * LEVI_CIVITA
    n[3:, 3:, 3:] = -np.einsum("li,iac,cb->lab", np.linalg.inv(body.inertia), LEVI_CIVITA, body.inertia)
    n[3:, :3, :3] = torque_forms(body, series, 2)
    return symmetrized(n, 2)


def in_frame(quadratic: Array, frame: Array, inverse: Array) -> Array:
    """Y^-1 N(Y u, Y u)."""
    return np.einsum("li,iab,aj,bk->ljk", inverse, quadratic, frame, frame, optimize=True)


def cubic_pushes(body: Body, series: MotionSeries, linear: LinearPart) -> list[Array]:
    """Ellipsoids of the terms of third order for |u| <= 1, in the middle of the step (17.4 a, b).

    gamma (gamma.delta) / 4 is in m/4 times that of gamma, m the norm of the form gamma.delta. The torque's cubic forms
    of u act on u u u, of length one: K K' with the tensor's last indices taken as one.
    """
    upper, lower = linear.middle[:3], linear.middle[3:]
    form = 0.5 * (upper.T @ lower + lower.T @ upper)
    by_attitude = 0.25 * norm(form) * linear.inverse[:, :3] @ upper
    cubic = np.einsum("iabc,aj,bk,cl->ijkl", torque_forms(body, series, 3), upper, upper, upper, optimize=True)
    by_torque = linear.inverse[:, 3:] @ cubic.reshape(3, -1)
    return [by_attitude @ by_attitude.T, by_torque @ by_torque.T]


# What is not known


def unknown_torque(
    body: Body, series: MotionSeries, uncertainty: Uncertainty, largest_attitude: float, largest_difference: float
) -> Array:
    """The unknown torque, and the inertia's error as one: in a ball of epsilon (Omega^2 + g_J + A) (17.5).

    What stated torques lack in their expansions is one more ball (17.13, 17.14).
    """
    epsilon = uncertainty.inertia
    turned = 0.5 * series.h * (2.0 * series.largest_rate - float(np.linalg.norm(series.rate[0]))) + 32.0 * ROUNDING
    lacking = sum(local.remainder(turned + largest_attitude, 0.5 * series.h) for local in series.locals)
    unknown = sum_of_shapes([uncertainty.torque, lacking**2 * np.eye(3)])
    if epsilon == 0.0:
        return unknown
    least_moment, _, greatest_moment = body.moments
    omega = series.largest_rate + 2.0 * largest_difference
    gradient = series.acceleration.by_inertia
    acceleration = (
        (0.5 * (greatest_moment - least_moment) + epsilon) * omega**2
        + float(np.linalg.norm(series.wheel_momentum)) * omega
        + series.largest_torque
        + epsilon * gradient
        + float(np.linalg.norm(series.control_torque))
        + math.sqrt(np.trace(unknown))
    ) / (least_moment - epsilon)
    ball = epsilon * (omega**2 + gradient + acceleration)
    return sum_of_shapes([unknown, ball**2 * np.eye(3)])


# One step


def step(body: Body, series: MotionSeries, uncertainty: Uncertainty, tube: Tube) -> Tube:
    """The tube at the end of the step that the series is of (17.4)."""
    if series.locals:
        # What their expansions lack is less if the errors move less.
        try:
            return step_within(body, series, uncertainty, tube, tube.displacement() + 0.05)
        except Unbounded:
            pass
    return step_within(body, series, uncertainty, tube, 1.0)


def step_within(body: Body, series: MotionSeries, uncertainty: Uncertainty, tube: Tube, most: float) -> Tube:
    """If u moves by less than ``most`` from where it began."""
    h = series.h
    linear = linear_part(body, series, tube.frame)
    w1, w = linear.odd_change, linear.change
    bounds = series.acceleration
    p, turn_rate = bounds.degree, bounds.turn_rate

    # How a form of the torque changes within half a step, in parts of its bound (17.5), and what the directions lack.
    rate_norms = np.linalg.norm(series.rate, axis=1)
    rate_change = sum(k * h ** (k - 1) * rate_norms[k] for k in range(1, len(rate_norms)))
    turn = p * (series.largest_rate + turn_rate) * 0.5 * h
    turn_2 = 0.5 * (turn**2 + p * float(rate_change) * (0.5 * h) ** 2)
    missing_direction = series.tail(8, 1.0, turn_rate) / 2**8
    missing = p * missing_direction * (1.0 + missing_direction)

    # Second order (17.7). f(x) is the series that majorises G_s.
    g_middle = in_frame(second_order_rates(body, series), linear.middle, linear.inverse)
    b = quadratic_norm(g_middle)
    torque_form = 0.5 * p**2 * linear.by_rate * bounds.largest * linear.attitude**2
    d1, d2 = turn * torque_form, turn_2 * torque_form
    stretch, shrink = 1.0 + w, 1.0 / (1.0 - w)
    f1 = stretch**2 * shrink * (b + d1 + d2)
    odd = 3.0 * w1 * b + d1
    lacking = stretch**2 * shrink * missing * torque_form
    quadrature = h / 3.0 * (f1 - b - odd) + h * lacking
    integral = h * b + 0.5 * h * odd + quadrature  # B
    fastest = f1 + lacking  # g(1)

    # Pushes, in the middle's metric and for |u| <= 1: the unknown torque, third order, fourth order.
    by_torque = linear.inverse[:, 3:] @ np.linalg.inv(body.inertia)
    attitude = linear.attitude * stretch * (1.0 + most)
    unknown = by_torque @ unknown_torque(body, series, uncertainty, attitude, linear.rate * stretch) @ by_torque.T
    cubic = cubic_pushes(body, series, linear)
    fourth_size = p**3 / 8.0 * linear.attitude**4
    fourth = fourth_size**2 * linear.inverse[:, 3:] @ bounds.shape @ linear.inverse[:, 3:].T
    unknown_size = math.sqrt(np.trace(unknown))
    cubic_size = sum(math.sqrt(np.trace(push)) for push in cubic)
    fourth_length = math.sqrt(np.trace(fourth))
    cubic_form = 0.375 * p**2 * linear.by_rate * bounds.largest * linear.attitude**3  # c

    before = tube.displacement()
    tangent = 0.501 * series.attitude_error  # of half the angle by which the center changes at the end, and more

    def moved(eta: float) -> tuple[float, float, float, float]:
        """The rest, F(eta), and the means of phi_3 rho^3 and phi_4 rho^4 (1 + 5/8 |gamma|)."""
        rho = 1.0 + eta
        gibbs = 0.5 * linear.attitude * stretch * rho
        left = 1.0 - tangent * gibbs
        if left <= 0.5:
            return math.inf, math.inf, math.inf, math.inf
        jump = 2.0 * tangent * (1.0 + gibbs**2) / left
        impulses = shrink * (rho * linear.error + linear.by_rate * series.rate_defect + linear.by_attitude * jump)
        fifth = 1.0 + 0.625 * (2.0 * gibbs)
        speed = fastest * rho**2 + shrink * (
            unknown_size
            + stretch**3 * rho**3 * (cubic_size + cubic_form * (turn + turn_2 + missing))
            + stretch**4 * rho**4 * fifth * fourth_length
        )
        e0 = before + impulses
        e1 = e0 + speed * h
        middle = 0.5 * (e0 + e1)

        def at_ends(power: int) -> float:
            return stretch**power * 0.5 * ((1.0 + e0) ** power + (1.0 + e1) ** power)

        rest = quadrature + impulses
        rest += integral * (2.0 * middle + middle**2) + fastest * speed**2 * h**3 / 12.0  # (17.8)
        rest += h * cubic_form * 0.5 * turn * (at_ends(3) * shrink - 1.0)  # (c), the odd part
        rest += h * cubic_form * (0.5 * turn_2 + missing) * at_ends(3) * shrink
        in_metric = unknown_size + cubic_size * at_ends(3) + fourth_length * fifth * at_ends(4)
        rest += h * 0.5 * w * shrink * in_metric
        cubes = 0.5 * ((1.0 + middle) ** 3 + at_ends(3))  # (17.9)
        fourths = 0.5 * fifth * ((1.0 + middle) ** 4 + at_ends(4))
        return rest, e1, cubes, fourths

    # The bootstrap: an eta with F(eta) <= eta.
    eta = before + integral
    for _ in range(6):
        rest, displacement, cubes, fourths = moved(eta)
        if displacement <= eta < most:
            break
        eta = 1.02 * displacement
    else:
        raise Unbounded("the bootstrap does not close")

    pushes = [unknown, *(cubes**2 * push for push in cubic), fourths**2 * fourth]
    return Tube(
        linear.end,
        tube.set,
        tube.second_order + h * g_middle,
        (*tube.pushes, *(h**2 * push for push in pushes)),
        tube.rest + rest,
    )


# The shape in the end


def enlarged_set(second_order: Array) -> Array | None:
    """About {v + q(v) : |v| <= 1}, or none: the second way of theory 17.4, (17.19), with q seen on the set itself."""
    symmetric = symmetrized(second_order, 3)
    k = symmetric.reshape(6, -1)  # v'q(v) = v'K w
    growth = k @ k.T
    mean = np.trace(growth) / 6.0
    whole = 1.0 + quadratic_norm(second_order - symmetric) ** 2
    lambda_ = mean + math.sqrt(mean * (mean + whole))
    metric = np.eye(6) - (growth / lambda_ if lambda_ > 0.0 else 0.0)
    if np.linalg.eigvalsh(metric)[0] <= 0.0:
        return None
    return (whole + lambda_) * np.linalg.inv(metric)


def moderate_growth(share: float, of_whole: float) -> float:
    """A share that is no more than a hundredth, or five times what is added against the whole set (17.9)."""
    return min(share, max(0.01, 5.0 * of_whole))


def shape(tube: Tube) -> Array:
    """An ellipsoid about all y that the tube allows (17.4, the shape). Its sums hold with any shares."""
    inverse = np.linalg.inv(tube.set)
    on_set = np.einsum("ijk,ja,kb->iab", tube.second_order, tube.set, tube.set)

    def share(whitened: float) -> float:
        return math.sqrt(whitened / 6.0) if whitened > 0.0 else 1.0

    # (i) q in the ellipsoid of F'F, and a sum; (ii) the set itself a little larger, if that adds
    # at most 0.6 as much, in v and in u.
    widths = np.sum(tube.set**2, axis=0)
    rows = on_set.reshape(6, -1)
    seen = (inverse @ rows) @ (inverse @ rows).T
    size = moderate_growth(share(float(np.trace(seen))), math.sqrt(widths @ np.diag(seen) / widths.sum()))
    ball = (1.0 + size) * np.eye(6) + (1.0 + 1.0 / size) * seen if np.any(rows) else np.eye(6)
    if np.any(rows) and size > 0.002:
        larger = enlarged_set(np.tensordot(inverse, on_set, 1))
        if larger is not None and all(
            weights @ (np.diag(larger) - 1.0) < 0.6 * weights @ (np.diag(ball) - 1.0)
            for weights in (np.ones(6), widths)
        ):
            ball = larger
    result = tube.set @ ball @ tube.set.T

    whole = math.sqrt(widths.sum())
    rest_share = moderate_growth(
        tube.rest * float(np.linalg.norm(inverse)) / math.sqrt(6.0), math.sqrt(6.0) * tube.rest / whole
    )
    if rest_share > 0.0:
        result = (1.0 + rest_share) * result + (1.0 + 1.0 / rest_share) * tube.rest**2 * np.eye(6)
    pushed = sum_of_shapes(tube.pushes) if tube.pushes else np.zeros((6, 6))
    if np.any(pushed):
        push_share = share(float(np.trace(inverse @ pushed @ inverse.T)))
        push_share = moderate_growth(push_share, math.sqrt(np.trace(pushed)) / whole)
        result = (1.0 + push_share) * result + (1.0 + 1.0 / push_share) * pushed

    # Rounding (17.7).
    magnitude = (np.abs(tube.frame) @ np.sqrt(np.diag(result))) ** 2
    return tube.frame @ result @ tube.frame.T + 128.0 * ROUNDING * np.diag(magnitude)
