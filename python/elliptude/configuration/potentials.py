"""The potentials that a configuration may name, each with the core's potential that it stands for."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

import elliptude
from elliptude.io.toml import Model, Positive, Vector


class FreeBody(Model):
    """No torque."""

    kind: Literal["free"] = "free"

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.FreeBody()


class UniformGravity(Model):
    """A pendulum about a fixed point; the reference frame's third axis points down."""

    kind: Literal["uniform_gravity"]
    mass_kg: Positive
    gravity_m_per_s2: Positive
    center_of_mass_m: Vector

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.UniformGravity(self.mass_kg, self.gravity_m_per_s2, self.center_of_mass_m)


class GravityGradient(Model):
    """A spacecraft on a circular orbit; the reference frame's first two axes span it, the first points up at time 0."""

    kind: Literal["gravity_gradient"]
    orbit_rate_rad_per_s: Positive

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.GravityGradient(body, self.orbit_rate_rad_per_s)


Potential: TypeAlias = Annotated[FreeBody | UniformGravity | GravityGradient, Field(discriminator="kind")]
"""A table with the key ``kind``. CONTRIBUTING.md says where else a new one goes."""
