"""Potentials of one's own in the guaranteed flow (theory 17.10)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from . import so3
from .so3 import Array

ROUNDING = float(np.finfo(float).eps)


def turned_direction(direction: Array, turn: Array, time: float) -> Array:
    """The unit vector that turns with this angular velocity, by the exponential map."""
    unit = direction / np.linalg.norm(direction)
    return so3.exp(turn * time) @ unit


class Linear(NamedTuple):
    """U = -p' b with b = C' r(t)."""

    moment: Array
    direction: Array
    turn: Array = np.zeros(3)

    def torque(self, attitude: Array, time: float) -> Array:
        return np.cross(self.moment, attitude.T @ turned_direction(self.direction, self.turn, time))

    def torque_jacobian(self, attitude: Array, time: float) -> Array:
        return so3.hat(self.moment) @ so3.hat(attitude.T @ turned_direction(self.direction, self.turn, time))


class Quadratic(NamedTuple):
    """U = b' K b / 2."""

    matrix: Array
    direction: Array
    turn: Array = np.zeros(3)

    def torque(self, attitude: Array, time: float) -> Array:
        b = attitude.T @ turned_direction(self.direction, self.turn, time)
        return np.cross(b, self.matrix @ b)

    def torque_jacobian(self, attitude: Array, time: float) -> Array:
        b = attitude.T @ turned_direction(self.direction, self.turn, time)
        return (so3.hat(b) @ self.matrix - so3.hat(self.matrix @ b)) @ so3.hat(b)


class Stated(NamedTuple):
    """A torque by two functions of (attitude, time), with kappa, mu and alpha of (17.11)."""

    torque: Callable[[Array, float], Array]
    torque_jacobian: Callable[[Array, float], Array]
    curvature: float
    rate: float
    error: float


class Local(NamedTuple):
    """M* + M'* sin(theta) n about the attitude in the middle of a step (17.12)."""

    stated: Stated
    middle: Array  # C*
    time: float  # t*
    value: Array
    derivative: Array

    def forms(self) -> Array:
        """M - M* = sum_i form_i s_i with s_i = C' C* e_i: form_i = -M'* S(e_i) / 2."""
        return np.array([-0.5 * self.derivative @ so3.hat(axis) for axis in np.eye(3)])

    def torque(self, attitude: Array) -> Array:
        """By the antisymmetric part of C*' C, whose vector is sin(theta) n."""
        turn = self.middle.T @ attitude
        odd = 0.5 * (turn - turn.T)
        return self.value + self.derivative @ np.array([odd[2, 1], odd[0, 2], odd[1, 0]])

    def remainder(self, angle: float, duration: float) -> float:
        """(17.13), and rounding."""
        size = float(np.linalg.norm(self.derivative))
        clock = 16.0 * ROUNDING * (abs(self.time) + duration)
        return (
            self.stated.error
            + self.stated.rate * (duration + clock)
            + self.stated.curvature * angle**2
            + size * angle**3 / 6.0
            + 64.0 * ROUNDING * (float(np.linalg.norm(self.value)) + size)
        )


def expanded(stated: Stated, attitude: Array, rate: Array, time: float, h: float) -> Local:
    """About the middle of a step from this attitude, at this rate."""
    middle, now = attitude @ so3.exp(0.5 * h * rate), time + 0.5 * h
    return Local(stated, middle, now, stated.torque(middle, now), stated.torque_jacobian(middle, now))
