"""The potentials that a configuration may name, each with the core's potential that it stands for."""

import decimal
from decimal import Decimal
from fractions import Fraction
from typing import Annotated, Literal, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

import elliptude
from elliptude.io.toml import Matrix, Model, Number, Positive, Vector
from elliptude.typing import FloatArray

_WHOLE_TURN = Decimal(
    "6.283185307179586476925286766559005768394338798750211641949889184615632812572417997256069650684234136"
)
"""2π to a hundred digits, which is enough for the largest angle that a configuration may state."""


class _Potential(Model):
    @property
    def turns(self) -> bool:
        """Whether its torque depends on the time beside the attitude."""
        return False

    def lacks_time(self, origin: int) -> bool:
        """Whether it turns, but nothing says where it points in a log whose times count from a second of the file."""
        return False

    def counted_from(self, origin: int) -> Self:
        """The same in a file whose times count from a second of this one's.

        Raises
        ------
        ValueError
            If the time that it is stated for is no number there.
        """
        return self


class FreeBody(_Potential):
    """No torque."""

    kind: Literal["free"] = "free"

    def build(self, body: elliptude.RigidBody, origin: int = 0) -> elliptude.Potential:
        """The core's potential, of which the file's second ``origin`` is time 0."""
        return elliptude.FreeBody()


class UniformGravity(_Potential):
    """A pendulum about a fixed point; the reference frame's third axis points down."""

    kind: Literal["uniform_gravity"]
    mass_kg: Positive
    gravity_m_per_s2: Positive
    center_of_mass_m: Vector

    def build(self, body: elliptude.RigidBody, origin: int = 0) -> elliptude.Potential:
        """The core's potential, of which the file's second ``origin`` is time 0."""
        return elliptude.UniformGravity(self.mass_kg, self.gravity_m_per_s2, self.center_of_mass_m)


class _Turning(_Potential):
    stated_at_s: Annotated[Number, Field(ge=-1e10, le=1e10)] | None = None
    """The time of the file, s, that its direction is stated for; 0 if left out, from which times must count then."""

    def lacks_time(self, origin: int) -> bool:
        """As of any potential."""
        return self.turns and self.stated_at_s is None and origin != 0

    def counted_from(self, origin: int) -> Self:
        """As of any potential."""
        if not self.turns or origin == 0:
            return self
        stated = self.stated_at_s or 0.0
        if Fraction(stated) - origin != Fraction(stated - origin):
            raise ValueError(
                f"flow.potential.stated_at_s: {stated!r} s, counted from {origin} s, has more digits than a number "
                "holds: state the direction for a whole second"
            )
        return self.model_copy(update={"stated_at_s": stated - origin})

    def _turned(self, turn: Vector, origin: int) -> tuple[float, float]:
        """Cosine and sine of how far it has turned at a second of the file; theory, section 5."""
        with decimal.localcontext(decimal.Context(prec=160)):
            squares = sum((Decimal(component) ** 2 for component in turn), Decimal(0))
            angle = squares.sqrt() * (origin - Decimal(self.stated_at_s or 0.0))
            # Of a large angle a double has no digit that counts.
            left = float(angle.remainder_near(_WHOLE_TURN))
        return float(np.cos(left)), float(np.sin(left))


class GravityGradient(_Turning):
    """A spacecraft on a circular orbit; the reference frame's first two axes span it, the first points up at time 0."""

    kind: Literal["gravity_gradient"]
    orbit_rate_rad_per_s: Positive

    @property
    def turns(self) -> bool:
        """Whether its torque depends on the time beside the attitude."""
        return True

    def build(self, body: elliptude.RigidBody, origin: int = 0) -> elliptude.Potential:
        """The core's potential, of which the file's second ``origin`` is time 0."""
        cosine, sine = self._turned((0.0, 0.0, self.orbit_rate_rad_per_s), origin)
        orbit = [[cosine, 0.0 - sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]
        return elliptude.GravityGradient(body, self.orbit_rate_rad_per_s, orbit)


class _AlongDirection(_Turning):
    direction: Vector
    """r at time 0, or ``stated_at_s``, reference axes, of any length."""
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

    def _direction_at(self, origin: int) -> FloatArray:
        """The direction at a second of the file, of any length, shape (3,)."""
        start, turn = np.array(self.direction), np.array(self.turn_rad_per_s)
        cosine, sine = self._turned(self.turn_rad_per_s, origin)
        if sine == 0.0 and cosine == 1.0:
            return start
        # Of numbers of any size; across the turn, as the core takes the direction.
        axis = turn / np.abs(turn).max()
        axis /= np.linalg.norm(axis)
        along = np.cross(axis, start / np.abs(start).max())
        turned: FloatArray = cosine * np.cross(along, axis) + sine * along
        return turned


class LinearPotential(_AlongDirection):
    """U = −p'C'r: a dipole in a field, a force at a point of a body that is held."""

    kind: Literal["linear"]
    moment_n_m: Vector
    """p, body axes."""

    def build(self, body: elliptude.RigidBody, origin: int = 0) -> elliptude.Potential:
        """The core's potential, of which the file's second ``origin`` is time 0."""
        return elliptude.LinearPotential(self.moment_n_m, self._direction_at(origin), self.turn_rad_per_s)


class QuadraticPotential(_AlongDirection):
    """U = ½ b'Kb, b = C'r: the gravity gradient of any mass, an induced dipole."""

    kind: Literal["quadratic"]
    matrix_n_m: Matrix
    """K, symmetric, body axes."""

    @model_validator(mode="after")
    def _has_a_symmetric_matrix(self) -> Self:
        self.build(elliptude.RigidBody([1.0, 1.0, 1.0]))
        return self

    def build(self, body: elliptude.RigidBody, origin: int = 0) -> elliptude.Potential:
        """The core's potential, of which the file's second ``origin`` is time 0."""
        return elliptude.QuadraticPotential(self.matrix_n_m, self._direction_at(origin), self.turn_rad_per_s)


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

    def lacks_time(self, origin: int) -> bool:
        """As of any potential."""
        return any(potential.lacks_time(origin) for potential in self.potentials)

    def counted_from(self, origin: int) -> Self:
        """As of any potential."""
        return self.model_copy(update={"potentials": tuple(one.counted_from(origin) for one in self.potentials)})

    def build(self, body: elliptude.RigidBody, origin: int = 0) -> elliptude.Potential:
        """The core's potential, of which the file's second ``origin`` is time 0."""
        return elliptude.SumPotential([potential.build(body, origin) for potential in self.potentials])


Potential: TypeAlias = Annotated[AnyTerm | SumPotential, Field(discriminator="kind")]
"""A table with the key ``kind``. CONTRIBUTING.md says where else a new one goes."""
