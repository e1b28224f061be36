"""Flows whose sets hold the state of the continuous motion (theory 17.4 to 17.6), in the Gibbs chart."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from . import error_tube, so3
from .error_tube import Tube, Unbounded, Uncertainty, moderate_growth
from .motion_series import ROUNDING, Body, BodyInput, StepTooLong, expand_motion, norm, torque_bounds
from .own_torque import Local, Stated, expanded
from .so3 import Array

LONG_TUBE, SHORT_TUBE = 0.1, 0.01  # by how much u may have moved before a tube begins again


class GibbsSet(NamedTuple):
    """Attitudes C cay(gamma/2) and vectors (a rate or a gyro's bias, rad/s) with [gamma; delta] in E(0, shape)."""

    attitude: Array
    vector: Array
    shape: Array


# A rigid body


def body_steps(duration: float, longest_step: float) -> int:
    """The fewest steps that are no longer than the longest, but for a thousandth."""
    return max(math.ceil(0.999 * duration / longest_step), 1)


class Course(NamedTuple):
    """A way through an interval by tubes."""

    end: GibbsSet
    largest_displacement: float
    tube: Tube

    @property
    def log_volume(self) -> float:
        return 0.5 * float(np.linalg.slogdet(self.end.shape)[1])


def follow(
    body: Body,
    begin: GibbsSet,
    time: float,
    h: float,
    steps: int,
    given: BodyInput,
    uncertainty: Uncertainty,
    longest: float,
) -> Course:
    """One tube after another, each until u has moved by more than ``longest`` (17.4, beginning again)."""
    attitude, rate = so3.nearest_rotation(begin.attitude), begin.vector
    bounds = torque_bounds(body.torques, np.linalg.inv(body.inertia), [sized(stated) for stated in body.stated])
    stiffness = bounds.degree * bounds.largest
    tube = error_tube.start(begin.shape, h, stiffness)
    largest_displacement = 0.0
    for k in range(steps):
        series = expand_motion(body, attitude, rate, time + k * h, h, given)
        displacement = tube.displacement()
        largest_displacement = max(largest_displacement, displacement)
        if displacement > longest:
            tube = error_tube.start(error_tube.shape(tube), h, stiffness)
        tube = error_tube.step(body, series, uncertainty, tube)
        attitude, rate = series.end_attitude, series.end_rate
    return Course(GibbsSet(attitude, rate, error_tube.shape(tube)), largest_displacement, tube)


def sized(stated: Stated) -> Local:
    """A torque with a derivative of the size of kappa, by which the first norm is chosen."""
    return Local(stated, np.eye(3), 0.0, np.zeros(3), stated.curvature * np.eye(3))


def predict_body(
    body: Body,
    begin: GibbsSet,
    time: float,
    duration: float,
    longest_step: float,
    given: BodyInput | None = None,
    uncertainty: Uncertainty | None = None,
) -> GibbsSet:
    """In equal steps; where these have no bound, in three and nine times as many (17.4, the bootstrap)."""
    steps = body_steps(duration, longest_step)
    for finer in (1, 3):
        try:
            return predict_body_in(steps * finer, body, begin, time, duration, given, uncertainty)
        except (Unbounded, StepTooLong):
            continue
    return predict_body_in(9 * steps, body, begin, time, duration, given, uncertainty)


def predict_body_in(
    steps: int,
    body: Body,
    begin: GibbsSet,
    time: float,
    duration: float,
    given: BodyInput | None,
    uncertainty: Uncertainty | None,
) -> GibbsSet:
    """The smaller of the sets of both courses (17.4, beginning again)."""

    def course(longest: float) -> Course | None:
        try:
            return follow(
                body,
                begin,
                time,
                duration / steps,
                steps,
                given or BodyInput(),
                uncertainty or Uncertainty(),
                longest,
            )
        except Unbounded:
            return None

    courses = [course(LONG_TUBE)]
    if steps > 1 and (courses[0] is None or courses[0].largest_displacement > SHORT_TUBE):
        courses.append(course(SHORT_TUBE))
    found = [c for c in courses if c is not None]
    if not found:
        raise Unbounded("no course is bounded")
    return min(found, key=lambda c: c.log_volume).end


def predict_rate(
    body: Body,
    center: Array,
    shape: Array,
    duration: float,
    given: BodyInput | None = None,
    uncertainty: Uncertainty | None = None,
    time: float = 0.0,
) -> tuple[Array, Array]:
    """omega in E(-J^-1 h_w, p^2 J^-2) without an attitude: |(J + D) omega + h_w| grows by torques alone (17.5)."""
    control, wheel = given or BodyInput()
    torque, epsilon = uncertainty or Uncertainty()
    inertia = body.inertia
    locals_ = [expanded(stated, np.eye(3), np.zeros(3), time, 0.0) for stated in body.stated]
    bounds = torque_bounds(body.torques, np.eye(3), locals_)
    stated = sum(float(np.linalg.norm(local.value)) + local.remainder(3.1416, duration) for local in locals_)
    speed = float(np.linalg.norm(center)) + radius(shape)
    momentum = float(np.linalg.norm(inertia @ center + wheel)) + radius(inertia @ shape @ inertia)
    momentum += epsilon * speed
    known = bounds.largest + stated + epsilon * bounds.by_inertia + float(np.linalg.norm(control))
    momentum += duration * (known + radius(torque))
    momentum += epsilon * (momentum + float(np.linalg.norm(wheel))) / (float(body.moments[0]) - epsilon)
    inverse = np.linalg.inv(inertia)
    return -inverse @ wheel, (1.0 + 64.0 * ROUNDING) * momentum**2 * inverse @ inverse


def radius(shape: Array) -> float:
    """A bound of the longest semi-axis."""
    return math.sqrt(norm(shape))


# A gyro


IntervalRate = Literal["first_sample", "mean_of_ends", "mean", "last_sample"]
SEEN_DRIFT = {"first_sample": 0.0, "mean_of_ends": 0.5, "mean": 0.5, "last_sample": 1.0}
"""How much of the drift over an interval its rate has in it."""


class GyroUncertainty(NamedTuple):
    """Bounds of samples omega + bias + v: v in E(0, noise) or scale |sample| beyond, bias' in E(0, drift) (17.6)."""

    noise: Array = np.zeros((3, 3))  # (rad/s)^2
    drift: Array = np.zeros((3, 3))  # (rad/s^2)^2
    scale: float = 0.0
    angular_acceleration: float = 0.0  # bound of |omega'|, rad/s^2
    largest_rate: float | None = None  # bound of |omega|, rad/s


def gyro_transition(rate: Array, h: float) -> Array:
    """The linear part: gamma(h) = F'gamma - h J_r(h omega) (bias - center's), F = exp S(h omega) (17.6)."""
    transition = np.eye(6)
    transition[:3, :3] = so3.exp(h * rate).T
    transition[:3, 3:] = -h * so3.right_jacobian(h * rate)
    return transition


def predict_gyro(
    begin: GibbsSet,
    gyro: Array,
    duration: float,
    uncertainty: GyroUncertainty,
    interval_rate: IntervalRate,
    increment: float | None = None,
) -> GibbsSet:
    """gamma(h) = F'gamma + integral of R(t) delta(t), delta = -(bias - center's) + e(t), part by part (17.6)."""
    h = duration
    rate = gyro - begin.vector
    speed = float(np.linalg.norm(rate))
    transition = gyro_transition(rate, h)

    acceleration = uncertainty.angular_acceleration
    wander, wander_angle = {
        "first_sample": (acceleration * h, acceleration * h**2 / 2.0),
        "mean_of_ends": (acceleration * h / 2.0, acceleration * h**2 / 4.0),
        "mean": (acceleration * h / 2.0, 0.0),
        "last_sample": (acceleration * h, acceleration * h**2 / 2.0),
    }[interval_rate]
    scale = uncertainty.scale * float(np.linalg.norm(gyro))
    noise = radius(uncertainty.noise) + scale
    drift = radius(uncertainty.drift)

    seen = SEEN_DRIFT[interval_rate]
    difference = radius(begin.shape[3:, 3:]) + seen * h * drift + noise + wander
    angle = math.atan(radius(begin.shape[:3, :3]) / 2.0) + 0.5 * h * difference
    if angle >= 1.5:
        raise Unbounded("the set may reach half turns")
    largest = 2.0 * math.tan(angle)

    nonlinear = h * largest * difference * max(0.5, 0.25 * largest)
    turning = speed * h**2 / 4.0 * (noise + wander)
    drifting = drift * h**2 / 4.0 if interval_rate == "mean" else 0.0
    # Rounding of the turn, its Jacobian and the center (17.8).
    slip = (32.0 + 12.0 * speed * h) * ROUNDING
    slipping = slip * (radius(begin.shape[:3, :3]) + h * difference + 1.01 * (1.0 + largest**2 / 4.0))
    ball = wander_angle + nonlinear + turning + drifting + slipping
    terms = [transition @ begin.shape @ transition.T]
    if increment is not None:
        ball += increment
    else:
        ball += h * scale
        turned = so3.exp(0.5 * h * rate).T
        terms.append(_in_attitude(h**2 * turned @ uncertainty.noise @ turned.T))
    if drift > 0.0:
        moved = np.vstack([seen * transition[:3, 3:], np.eye(3)])
        terms.append(h**2 * moved @ uncertainty.drift @ moved.T)
    terms.append(_in_attitude(ball**2 * np.eye(3)))

    shape = moderate_sum(terms)
    return GibbsSet(begin.attitude @ so3.exp(h * rate), begin.vector, (1.0 + 64.0 * ROUNDING) * shape)


def predict_unmeasured(begin: GibbsSet, duration: float, uncertainty: GyroUncertainty) -> GibbsSet:
    """A turn by any angle up to largest_rate * duration, about any axis: gamma moves by no more than in (17.10)."""
    before = radius(begin.shape[:3, :3])
    angle = math.atan(0.5 * before) + 0.5 * (uncertainty.largest_rate or 0.0) * duration
    if uncertainty.largest_rate is None or angle >= 1.5:
        raise Unbounded("the set may reach half turns")
    drifted = np.zeros((6, 6))
    drifted[3:, 3:] = duration**2 * uncertainty.drift
    terms = [begin.shape, _in_attitude((2.0 * math.tan(angle) - before) ** 2 * np.eye(3)), drifted]
    shape = moderate_sum(terms)
    return GibbsSet(begin.attitude, begin.vector, (1.0 + 64.0 * ROUNDING) * shape)


def predict_bias(shape: Array, duration: float, drift: Array) -> Array:
    """The bias without an attitude: a sum with what it drifts by (7.2), as in a prediction."""
    return (1.0 + 64.0 * ROUNDING) * moderate_sum([shape, duration**2 * drift])


def moderate_sum(terms: Sequence[Array]) -> Array:
    """The best shares for the volume, by two steps from those of no others (7.2), as far as moderate (17.9)."""
    first, *others = terms
    blocks = [slice(at, at + 3) for at in range(0, len(first), 3)]
    of_whole = max(
        math.sqrt(sum(np.trace(term[block, block]) for term in others) / np.trace(first[block, block]))
        for block in blocks
    )
    result = first
    for _ in range(2):
        inverse = np.linalg.inv(result)
        sizes = [math.sqrt(max(0.0, float(np.trace(inverse @ term)))) for term in terms]
        growth = sum(sizes[1:]) / sizes[0]
        moderate = moderate_growth(growth, of_whole)
        result = (1.0 + moderate) * first
        for size, term in zip(sizes[1:], others, strict=True):
            if size > 0.0:
                result = result + (1.0 + moderate) * sizes[0] * growth / (moderate * size) * term
    return result


def _in_attitude(shape: Array) -> Array:
    result = np.zeros((6, 6))
    result[:3, :3] = shape
    return result
