"""The potentials that a scenario may name: their torque by formula, and what they are in a configuration."""

from collections.abc import Callable
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from elliptude.configuration import potentials
from elliptude.io.toml import Model, Number, Vector
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


Potential: TypeAlias = Annotated[Free | UniformGravity | GravityGradient, Field(discriminator="kind")]
