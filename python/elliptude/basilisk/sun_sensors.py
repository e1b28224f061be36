"""A direction to the Sun from cosine sensors, with a bound of its error."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.arguments import require_not_negative, vector_rows
from elliptude.typing import FloatArray

_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)


class SunSensors:
    """Coarse Sun sensors, each of which shows the cosine of the Sun's angle from its normal, as Basilisk's do.

    A sensor that sees the Sun shows f (n · s) + e: n is its normal, s the direction to the Sun, f a brightness that is
    the same for all (penumbra, distance), and ‖e‖ is at most `bound`. One that does not see it shows at most `bound`.
    Those that show more than `bound` therefore see it. The least-squares solution d of m of these, whose normals are
    the rows of H, is off from f s by at most r = √m bound / σ, where σ is the least singular value of H. So the
    direction is off by at most arcsin(r / ‖d‖).

    Parameters
    ----------
    normals : (m, 3) array_like
        Unit vectors in body axes.
    bound : float
        How far each cosine may be off: noise, bias, albedo and the angle (rad) of a misaligned normal. A factor of its
        own, or a curve such as Basilisk's Kelly curve, counts as such an error, too.

    Raises
    ------
    ValueError
        If a normal is not a unit vector or a bound is negative.
    """

    def __init__(self, normals: ArrayLike, bound: float) -> None:
        self.normals = vector_rows("normals", normals)
        self.bound = bound
        self._solutions: dict[bytes, tuple[FloatArray, float] | None] = {}
        lengths = np.linalg.norm(self.normals, axis=1)
        wrong = np.flatnonzero(~(np.abs(lengths - 1.0) <= 1e-6))
        if len(wrong):
            raise ValueError(
                f"normals must be unit vectors within 1e-6; row {int(wrong[0])} has the length {lengths[wrong[0]]:.6g}"
            )
        require_not_negative("bound", bound)

    def direction(self, cosines: ArrayLike) -> tuple[FloatArray, float] | None:
        """Where the Sun is in body axes, and how far it may be off.

        Parameters
        ----------
        cosines : (m,) array_like
            What the sensors show.

        Returns
        -------
        tuple or None
            A unit vector (3,), and the bound of its angle from the Sun, rad, below π/2. None if fewer than three
            sensors see the Sun, as in eclipse, if their normals lie in a plane, or if the errors may be as long as what
            is seen.

        Raises
        ------
        ValueError
            If there is not one finite number for each normal.
        """
        shown = np.asarray(cosines, dtype=np.float64)
        if shown.shape != (len(self.normals),) or not np.isfinite(shown).all():
            raise ValueError(
                f"cosines must be {len(self.normals)} finite numbers, one for each normal, not {cosines!r}"
            )
        lit = shown > self.bound
        solution = self._solution(lit)
        if solution is None:
            return None
        inverse, least = solution
        seen = inverse @ shown[lit]
        length = float(np.linalg.norm(seen))
        error = (self.bound + _ROUNDING * float(shown.max())) * math.sqrt(np.count_nonzero(lit)) / least
        if not error < length:
            return None
        return seen / length, math.asin(error / length)

    def _solution(self, lit: NDArray[np.bool_]) -> tuple[FloatArray, float] | None:
        """Least squares for the sensors that see the Sun: the inverse, and the least singular value."""
        key = lit.tobytes()
        if key not in self._solutions:
            normals = self.normals[lit]
            least = float(np.linalg.svd(normals, compute_uv=False)[-1]) if len(normals) >= 3 else 0.0
            inverse = np.asarray(np.linalg.pinv(normals), dtype=np.float64)
            self._solutions[key] = (inverse, least) if least > 1e-6 else None
        return self._solutions[key]
