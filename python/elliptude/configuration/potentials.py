"""The potentials that a configuration may name, each with the core's potential that it stands for."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

import elliptude
from elliptude.io.toml import Matrix, Model, Positive, Vector


class _Potential(Model):
    @property
    def turns(self) -> bool:
        """Whether its torque depends on the time beside the attitude."""
        return False


class FreeBody(_Potential):
    """No torque."""

    kind: Literal["free"] = "free"

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.FreeBody()


class UniformGravity(_Potential):
    """A pendulum about a fixed point; the reference frame's third axis points down."""

    kind: Literal["uniform_gravity"]
    mass_kg: Positive
    gravity_m_per_s2: Positive
    center_of_mass_m: Vector

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.UniformGravity(self.mass_kg, self.gravity_m_per_s2, self.center_of_mass_m)


class GravityGradient(_Potential):
    """A spacecraft on a circular orbit; the reference frame's first two axes span it, the first points up at time 0."""

    kind: Literal["gravity_gradient"]
    orbit_rate_rad_per_s: Positive

    @property
    def turns(self) -> bool:
        """Whether its torque depends on the time beside the attitude."""
        return True

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.GravityGradient(body, self.orbit_rate_rad_per_s)


class _AlongDirection(_Potential):
    direction: Vector
    """r at time 0, reference axes, of any length."""
    turn_rad_per_s: Vector = (0.0, 0.0, 0.0)
    """Its angular velocity in the reference frame, at right angles to it."""

    @property
    def turns(self) -> bool:
        """Whether its torque depends on the time beside the attitude."""
        return any(self.turn_rad_per_s)

    @model_validator(mode="after")
    def _is_a_potential(self) -> Self:
        elliptude.LinearPotential([0.0, 0.0, 0.0], self.direction, self.turn_rad_per_s)
        return self


class LinearPotential(_AlongDirection):
    """U = −p'C'r: a dipole in a field, a force at a point of a body that is held."""

    kind: Literal["linear"]
    moment_n_m: Vector
    """p, body axes."""

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.LinearPotential(self.moment_n_m, self.direction, self.turn_rad_per_s)


class QuadraticPotential(_AlongDirection):
    """U = ½ b'Kb, b = C'r: the gravity gradient of any mass, an induced dipole."""

    kind: Literal["quadratic"]
    matrix_n_m: Matrix
    """K, symmetric, body axes."""

    @model_validator(mode="after")
    def _has_a_symmetric_matrix(self) -> Self:
        self.build(elliptude.RigidBody([1.0, 1.0, 1.0]))
        return self

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.QuadraticPotential(self.matrix_n_m, self.direction, self.turn_rad_per_s)


AnyTerm: TypeAlias = FreeBody | UniformGravity | GravityGradient | LinearPotential | QuadraticPotential


class SumPotential(_Potential):
    """Potentials that add up."""

    kind: Literal["sum"]
    potentials: Annotated[
        tuple[Annotated[AnyTerm, Field(discriminator="kind")], ...], Field(min_length=1, max_length=8)
    ]

    @property
    def turns(self) -> bool:
        """Whether its torque depends on the time beside the attitude."""
        return any(potential.turns for potential in self.potentials)

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.SumPotential([potential.build(body) for potential in self.potentials])


Potential: TypeAlias = Annotated[AnyTerm | SumPotential, Field(discriminator="kind")]
"""A table with the key ``kind``. CONTRIBUTING.md says where else a new one goes."""
