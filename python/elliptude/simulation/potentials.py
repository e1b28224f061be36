"""The potentials that a scenario may name: their torque by formula, and what they are in a configuration."""

from collections.abc import Callable
from typing import Annotated, Literal, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from elliptude.configuration import potentials
from elliptude.io.toml import Matrix, Model, NonzeroVector, Number, Vector
from elliptude.typing import FloatArray

Torque: TypeAlias = Callable[[float, FloatArray], FloatArray]
"""M(t, C) in N m, body axes (theory, section 5), without the core, which it is to be compared with."""
Positive = Annotated[Number, Field(gt=0)]


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a × b; `numpy.cross` takes ten times as long for one pair."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


class Free(Model):
    """No potential."""

    kind: Literal["free"]

    def configured(self) -> potentials.FreeBody:
        """The same in a configuration."""
        return potentials.FreeBody()

    def weighted_center(self) -> FloatArray:
        """Weight times center of mass, N m, shape (3,)."""
        return np.zeros(3)

    def torque(self, inertia: FloatArray) -> Torque:
        """The torque on a body of this inertia."""
        return lambda time, attitude: np.zeros(3)


class UniformGravity(Model):
    """U = -m g e3' C rho, the third reference axis pointing down: the 3D pendulum."""

    kind: Literal["uniform_gravity"]
    mass: Positive
    gravity: Positive
    center_of_mass: Vector
    """From the pivot, m, body axes."""

    def configured(self) -> potentials.UniformGravity:
        """The same in a configuration."""
        return potentials.UniformGravity(
            kind=self.kind, mass_kg=self.mass, gravity_m_per_s2=self.gravity, center_of_mass_m=self.center_of_mass
        )

    def weighted_center(self) -> FloatArray:
        """Weight times center of mass, N m, shape (3,)."""
        return self.mass * self.gravity * np.array(self.center_of_mass)

    def torque(self, inertia: FloatArray) -> Torque:
        """The torque on a body of this inertia."""
        weighted = self.weighted_center()
        return lambda time, attitude: cross(weighted, attitude[2])


class GravityGradient(Model):
    """U = (3 n^2 / 2) b' J b with b = C' r(t) on a circular orbit."""

    kind: Literal["gravity_gradient"]
    orbit_rate: Positive
    """n in rad/s."""
    radial_direction: Literal["(cos nt, sin nt, 0)"] = "(cos nt, sin nt, 0)"
    """r(t) in reference axes; only for the reader."""

    def configured(self) -> potentials.GravityGradient:
        """The same in a configuration."""
        return potentials.GravityGradient(kind=self.kind, orbit_rate_rad_per_s=self.orbit_rate)

    def weighted_center(self) -> FloatArray:
        """Weight times center of mass, N m, shape (3,)."""
        return np.zeros(3)

    def torque(self, inertia: FloatArray) -> Torque:
        """The torque on a body of this inertia."""
        rate = self.orbit_rate

        def gravity_gradient(time: float, attitude: FloatArray) -> FloatArray:
            radial = np.cos(rate * time) * attitude[0] + np.sin(rate * time) * attitude[1]
            return 3.0 * rate**2 * cross(radial, inertia @ radial)

        return gravity_gradient


class _AlongDirection(Model):
    direction: NonzeroVector
    """r at time 0, reference axes, of any length."""
    turn: Vector = (0.0, 0.0, 0.0)
    """Its angular velocity in the reference frame, rad/s, at right angles to it."""

    @model_validator(mode="after")
    def _turns_in_a_plane(self) -> Self:
        turn, direction = np.array(self.turn), np.array(self.direction)
        if abs(turn @ direction) > 1e-9 * np.linalg.norm(turn) * np.linalg.norm(direction):
            raise ValueError("turn must be at right angles to direction, or zero")
        return self

    def weighted_center(self) -> FloatArray:
        """`elliptude.validation` has no true motion for this potential.

        Raises
        ------
        ValueError
            Always.
        """
        raise ValueError(
            "a linear or quadratic potential can be simulated, but elliptude.validation has no truth of it"
        )

    def seen(self) -> Callable[[float, FloatArray], FloatArray]:
        """The unit vector C'r(t) by Rodrigues' formula, as a function of time and attitude."""
        turn, start = np.array(self.turn), np.array(self.direction) / np.linalg.norm(self.direction)
        rate = float(np.linalg.norm(turn))
        along = cross(turn / rate, start) if rate > 0.0 else np.zeros(3)
        return lambda time, attitude: (np.cos(rate * time) * start + np.sin(rate * time) * along) @ attitude


class LinearPotential(_AlongDirection):
    """U = -p' b with b = C' r(t): a dipole in a field."""

    kind: Literal["linear"]
    moment: Vector
    """p in N m, body axes."""

    def configured(self) -> potentials.LinearPotential:
        """The same in a configuration."""
        return potentials.LinearPotential(
            kind=self.kind, moment_n_m=self.moment, direction=self.direction, turn_rad_per_s=self.turn
        )

    def torque(self, inertia: FloatArray) -> Torque:
        """The torque on a body of this inertia."""
        moment, seen = np.array(self.moment), self.seen()
        return lambda time, attitude: cross(moment, seen(time, attitude))


class QuadraticPotential(_AlongDirection):
    """U = b' K b / 2 with b = C' r(t): the gravity of any mass."""

    kind: Literal["quadratic"]
    matrix: Matrix
    """K in N m, body axes."""

    @model_validator(mode="after")
    def _has_a_symmetric_matrix(self) -> Self:
        self.configured()
        return self

    def configured(self) -> potentials.QuadraticPotential:
        """The same in a configuration."""
        return potentials.QuadraticPotential(
            kind=self.kind, matrix_n_m=self.matrix, direction=self.direction, turn_rad_per_s=self.turn
        )

    def torque(self, inertia: FloatArray) -> Torque:
        """The torque on a body of this inertia."""
        matrix, seen = np.array(self.matrix), self.seen()

        def quadratic(time: float, attitude: FloatArray) -> FloatArray:
            b = seen(time, attitude)
            return cross(b, matrix @ b)

        return quadratic


Potential: TypeAlias = Annotated[
    Free | UniformGravity | GravityGradient | LinearPotential | QuadraticPotential, Field(discriminator="kind")
]
