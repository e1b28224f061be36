"""What functions of the core return: named tuples and classes of arrays."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elliptude._core import Ellipsoid, cayley_inverse, log
from elliptude.results.shown import equal
from elliptude.typing import AttitudeLike, Chart, FloatArray, SupportsAsMatrix


class PrincipalAxes(NamedTuple):
    """The semi-axes of an ellipsoid, longest first."""

    lengths: FloatArray
    """Shape (n,)."""
    directions: FloatArray
    """Unit vectors as columns, shape (n, n)."""


class Intersection(NamedTuple):
    """An ellipsoid that contains an intersection, and the share of each set in it."""

    ellipsoid: Ellipsoid
    share: float
    """0 is the first set alone, 1 the second."""


class Trajectory(NamedTuple):
    """States of a rigid body at n + 1 times."""

    times: FloatArray
    """In s, shape (n + 1,)."""
    attitudes: FloatArray
    """From body to reference axes, shape (n + 1, 3, 3)."""
    angular_velocities: FloatArray
    """In rad/s, body axes, shape (n + 1, 3)."""


class FlowLinearization(NamedTuple):
    """The state at the end of some steps, and the first-order effect on [ζ; δω] there.

    ζ is the error rotation vector on the body side, C = Ĉ exp(S(ζ)).
    """

    attitude: FloatArray
    """From body to reference axes, shape (..., 3, 3)."""
    angular_velocity: FloatArray
    """In rad/s, body axes, shape (..., 3)."""
    state: FloatArray
    """A, the effect of [ζ; δω] at the start, shape (..., 6, 6)."""
    control: FloatArray
    """B, the effect of a change of the control torque, shape (..., 6, 3)."""


class WahbaSolution(NamedTuple):
    """The attitude that fits directions best."""

    attitude: FloatArray
    """From body to reference axes, shape (..., 3, 3)."""
    cost: np.float64 | FloatArray
    """½ Σ wᵢ ‖eᵢ − C b̃ᵢ‖² of unit directions, shape (...)."""
    condition: np.float64 | FloatArray
    """Largest over smallest curvature of the cost, shape (...)."""


@dataclass(frozen=True)
class WahbaSet:
    """Ellipsoids of attitude errors that contain the truth, about the attitudes that fit directions best.

    The errors are coordinates of Ĉᵀ C, and the ellipsoids' centers are zero.
    """

    attitude: FloatArray
    """Ĉ, the Wahba solution for the weights, from body to reference axes, shape (..., 3, 3)."""
    shape: FloatArray
    """P in rad² of {x : xᵀ P⁻¹ x ≤ 1}, shape (..., 3, 3)."""
    chart: Chart
    """Whether x is ζ, with Ĉᵀ C = exp(S(ζ)), or γ = 2 tan(θ/2) n of the same turn."""
    margin: np.float64 | FloatArray
    """The margin: 1 for directions that fit exactly, 0 where they barely agree, shape (...)."""
    weights: FloatArray
    """Weights of the directions, given or found, shape (..., m)."""

    def largest_angle(self) -> np.float64 | FloatArray:
        """The largest attitude error in each set, rad, shape (...)."""
        longest = np.sqrt(np.linalg.eigvalsh(self.shape)[..., -1])
        angle: np.float64 | FloatArray = longest if self.chart == "exponential" else 2.0 * np.arctan(0.5 * longest)
        return angle

    def contains(self, attitude: AttitudeLike) -> np.bool_ | NDArray[np.bool_]:
        """Whether each attitude C, from body to reference axes, is in its set, shape (...)."""
        matrices = np.asarray(attitude.as_matrix() if isinstance(attitude, SupportsAsMatrix) else attitude)
        turn = np.swapaxes(self.attitude, -1, -2) @ matrices
        error = log(turn) if self.chart == "exponential" else 2.0 * cayley_inverse(turn)
        form = np.sum(error * np.linalg.solve(self.shape, error[..., None])[..., 0], axis=-1)
        inside: np.bool_ | NDArray[np.bool_] = form <= 1.0
        return inside


class Extent(NamedTuple):
    """How far a state ellipsoid reaches."""

    half_widths_body: FloatArray
    """Half-widths of the attitude error ζ (rad) and of the vector beside it (rad/s), along body axes, shape (6,)."""
    half_widths_reference: FloatArray
    """Half-widths of ζ along reference axes, rad, shape (3,)."""
    largest_angle: float
    """The largest ‖ζ‖ in the set, rad."""
    largest_angle_axis: FloatArray
    """Unit vector in body axes: the turn that is known least, shape (3,)."""
    greatest_uncertainty: FloatArray
    """Unit eigenvector of P to its largest eigenvalue, shape (6,)."""

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are equal."""
        return equal(self, other)

    def __ne__(self, other: object) -> bool:
        """Whether any number differs."""
        return not equal(self, other)
