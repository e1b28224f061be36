"""Rigid body in an attitude-dependent potential (paper, section 2.3.1; theory 5)."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from .so3 import Array, hat


class Potential(Protocol):
    """A potential energy U(C, t) and what follows from it."""

    def energy(self, attitude: Array, time: float) -> float:
        """U(C, t)."""

    def gradient(self, attitude: Array, time: float) -> Array:
        """The 3x3 matrix of partial derivatives of U by the entries of C."""

    def torque(self, attitude: Array, time: float) -> Array:
        """The moment M in body axes, in closed form."""

    def torque_jacobian(self, attitude: Array, time: float) -> Array:
        """dM/dzeta under C exp(S(zeta)), in closed form."""


@dataclass(frozen=True)
class Free:
    """No potential."""

    def energy(self, attitude: Array, time: float) -> float:
        return 0.0

    def gradient(self, attitude: Array, time: float) -> Array:
        return np.zeros((3, 3))

    def torque(self, attitude: Array, time: float) -> Array:
        return np.zeros(3)

    def torque_jacobian(self, attitude: Array, time: float) -> Array:
        return np.zeros((3, 3))


@dataclass(frozen=True)
class UniformGravity:
    """U = -m g e3' C rho with e3 pointing down: the 3D pendulum (theory 5)."""

    mass: float
    gravity: float
    centre_of_mass: Array

    def energy(self, attitude: Array, time: float) -> float:
        return -self._weight() * float(attitude[2] @ self.centre_of_mass)

    def gradient(self, attitude: Array, time: float) -> Array:
        down = np.array([0.0, 0.0, 1.0])
        return -self._weight() * np.outer(down, self.centre_of_mass)

    def torque(self, attitude: Array, time: float) -> Array:
        return self._weight() * np.cross(self.centre_of_mass, attitude[2])

    def torque_jacobian(self, attitude: Array, time: float) -> Array:
        return self._weight() * hat(self.centre_of_mass) @ hat(attitude[2])

    def _weight(self) -> float:
        return self.mass * self.gravity


@dataclass(frozen=True)
class GravityGradient:
    """U = (3 n^2 / 2) b' J b with b = C' r(t), on a circular orbit (theory 5).

    The reference frame is inertial; the radial direction turns in its first plane,
    r(t) = (cos n t, sin n t, 0).
    """

    inertia: Array
    orbit_rate: float

    def radial_direction(self, time: float) -> Array:
        angle = self.orbit_rate * time
        return np.array([np.cos(angle), np.sin(angle), 0.0])

    def energy(self, attitude: Array, time: float) -> float:
        b = attitude.T @ self.radial_direction(time)
        return 1.5 * self.orbit_rate**2 * float(b @ self.inertia @ b)

    def gradient(self, attitude: Array, time: float) -> Array:
        r = self.radial_direction(time)
        return 3.0 * self.orbit_rate**2 * np.outer(r, r) @ attitude @ self.inertia

    def torque(self, attitude: Array, time: float) -> Array:
        b = attitude.T @ self.radial_direction(time)
        return 3.0 * self.orbit_rate**2 * np.cross(b, self.inertia @ b)

    def torque_jacobian(self, attitude: Array, time: float) -> Array:
        b = attitude.T @ self.radial_direction(time)
        turned = hat(b) @ self.inertia - hat(self.inertia @ b)
        return 3.0 * self.orbit_rate**2 * turned @ hat(b)


class RigidBody(NamedTuple):
    """An inertia matrix and the potential that the body moves in."""

    inertia: Array
    potential: Potential


class State(NamedTuple):
    """Attitude C, angular velocity in body axes, and the time."""

    attitude: Array
    angular_velocity: Array
    time: float


def nonstandard_inertia(inertia: Array) -> Array:
    """J_d = tr(J) I / 2 - J (paper, below updatew0)."""
    return 0.5 * float(np.trace(inertia)) * np.eye(3) - inertia


def kinetic_energy(inertia: Array, angular_velocity: Array) -> float:
    """omega' J omega / 2."""
    return 0.5 * float(angular_velocity @ inertia @ angular_velocity)


def total_energy(body: RigidBody, state: State) -> float:
    """Kinetic plus potential energy."""
    kinetic = kinetic_energy(body.inertia, state.angular_velocity)
    return kinetic + body.potential.energy(state.attitude, state.time)


def spatial_angular_momentum(inertia: Array, state: State) -> Array:
    """C J omega, in the reference frame."""
    return state.attitude @ inertia @ state.angular_velocity


def torque_from_gradient(attitude: Array, gradient: Array) -> Array:
    """M = sum_i r_i cross v_i over the rows of C and dU/dC (paper, below Rdot)."""
    return np.asarray(sum(np.cross(r, v) for r, v in zip(attitude, gradient, strict=True)))
