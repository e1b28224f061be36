"""Types of arguments and results, for annotations."""

from typing import Literal, Protocol, SupportsFloat, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]

Chart: TypeAlias = Literal["exponential", "gibbs"]
"""Coordinates of an attitude error: ζ with Ĉᵀ C = exp(S(ζ)), or γ = 2 tan(θ/2) n of the same turn."""


@runtime_checkable
class SupportsAsMatrix(Protocol):
    """Anything that returns its rotation matrix, such as SciPy's ``Rotation``."""

    def as_matrix(self) -> NDArray[np.float64]:
        """The rotation matrix, shape (3, 3) or (N, 3, 3)."""


AttitudeLike: TypeAlias = ArrayLike | SupportsAsMatrix
"""An attitude from body to reference axes, shape (..., 3, 3): an array, or SciPy's ``Rotation``."""


class TorqueLike(Protocol):
    """A torque of your own, written in Python, for `elliptude.StatedTorque`.

    The attitude comes as an array of shape (3, 3), from body to reference axes, the time in s.
    """

    def torque(self, attitude: NDArray[np.float64], time: float, /) -> ArrayLike:
        """The torque M in N m, body axes, shape (3,)."""

    def torque_jacobian(self, attitude: NDArray[np.float64], time: float, /) -> ArrayLike:
        """The torque's derivative ∂M/∂ζ in N m/rad, shape (3, 3), where C = Ĉ exp(S(ζ))."""


class PotentialLike(Protocol):
    """A potential of your own, written in Python.

    The attitude comes as an array of shape (3, 3), from body to reference axes, the time in s. A method
    ``torque_curvature_bound()`` may promise a bound, as `elliptude.Potential.torque_curvature_bound` does.
    """

    def energy(self, attitude: NDArray[np.float64], time: float, /) -> SupportsFloat:
        """The energy U(C, t) in J."""

    def torque(self, attitude: NDArray[np.float64], time: float, /) -> ArrayLike:
        """The torque M in N m, body axes, shape (3,)."""

    def torque_jacobian(self, attitude: NDArray[np.float64], time: float, /) -> ArrayLike:
        """The torque's derivative ∂M/∂ζ in N m/rad, shape (3, 3), where C = Ĉ exp(S(ζ))."""
