"""First sets that are thin or tiny, so that rounding shows: of kinds of trials."""

from dataclasses import dataclass

import numpy as np
import scipy

from elliptude import _core
from elliptude.typing import FloatArray
from elliptude.validation.adversary import INSIDE, Errors, Plant, Starts
from elliptude.validation.judge import exact_root

CHOLESKY = 84.0 * float(np.finfo(np.float64).eps)
"""More than a Cholesky factorization of six rows loses of the diagonal (theory, section 17.8)."""


@dataclass(frozen=True, eq=False)
class ThinStarts(Starts):
    """First sets {Ĉ R(γ), x̂ + δ} in the Gibbs chart; their roots are those of P as stored in doubles."""

    told_shapes: FloatArray
    shares: FloatArray
    """How far out the truth may be, so that the rounding of its own numbers does not take it out, shape (T,)."""
    chart = "gibbs"

    @property
    def shapes(self) -> FloatArray:
        """P, shape (T, 6, 6)."""
        return self.told_shapes

    def true_states(self, errors: Errors) -> tuple[FloatArray, FloatArray]:
        """Attitudes (T, 3, 3) and vectors (T, 3) at time 0."""
        offsets = np.einsum("tij,tj->ti", self.roots, (INSIDE * self.shares)[:, None] * errors.start)
        gibbs = offsets[:, :3]
        length = np.linalg.norm(gibbs, axis=1, keepdims=True)
        vectors = gibbs * np.divide(2.0 * np.arctan(0.5 * length), length, out=np.ones_like(length), where=length > 0.0)
        return self.attitudes @ scipy.spatial.transform.Rotation.from_rotvec(
            vectors
        ).as_matrix(), self.vectors + offsets[:, 3:]


def thin_starts(
    of: Plant, starts: Starts, widest: FloatArray, ratios: FloatArray, draws: np.random.Generator
) -> Starts:
    """As wide as given, one axis thinner by the given ratio, the others between them.

    Axes have any direction in all six numbers, or in the attitude's three; the vector is then known better, a gyro's
    bias far better, so that it does not widen the attitude. A bias is small, too: its rounding must not take the truth
    out of a thin set.
    """
    count = len(starts.vectors)
    share = 1e-3 if of.has_gyro else 1.0
    shapes, roots, shares = np.empty((count, 6, 6)), np.empty((count, 6, 6)), np.empty(count)
    for trial in range(count):
        ratio, in_six = ratios[trial], draws.random() < 0.5
        while True:
            axes = np.zeros((6, 6))
            if in_six:
                lengths = widest[trial] * ratio ** draws.permutation([0.0, 1.0, *draws.random(4)])
                axes[:], _ = np.linalg.qr(draws.standard_normal((6, 6)))
            else:
                of_attitude = widest[trial] * ratio ** draws.permutation([0.0, 1.0, draws.random()])
                of_vector = share * of_attitude.min() * draws.uniform(0.5, 1.0, 3)
                lengths = np.concatenate([of_attitude, of_vector])
                axes[:3, :3], axes[3:, 3:] = (np.linalg.qr(draws.standard_normal((3, 3)))[0] for _ in range(2))
            root = axes * lengths
            shape = root @ root.T
            shape = 0.5 * (shape + shape.T)
            exact = exact_root(shape)
            if exact is not None and _can_be_factored(shape):
                break
            ratio *= 1.1  # rounding made it indefinite, or so nearly that a factorization in doubles stops
        shapes[trial], roots[trial] = shape, np.array(exact, np.float64)
        shares[trial] = max(0.0, 1.0 - 3e-15 / (lengths if in_six else lengths[:3]).min())
    return ThinStarts(
        attitudes=starts.attitudes,
        vectors=(1e-6 if of.has_gyro else 1.0) * starts.vectors,
        rates=starts.rates,
        roots=roots,
        from_measurement=np.zeros(count, bool),
        told_shapes=shapes,
        shares=shares,
    )


def _can_be_factored(shape: FloatArray) -> bool:
    """Whether a factorization in doubles must succeed, or the core's does.

    Of a shape that is not near to an indefinite one the core is not asked: it must not refuse that.
    """
    if exact_root(shape - CHOLESKY * np.diag(np.diag(shape))) is not None:
        return True
    try:
        _core.GuaranteedFilter(
            _core.GuaranteedGyroFlow(1.0), _core.StateEllipsoid(np.eye(3), np.zeros(3), shape, "gibbs")
        )
    except ValueError:
        return False
    return True


def thin(of: Plant, starts: Starts, draws: np.random.Generator) -> Starts:
    """Thin over wide from 1e-3 to 1e-8."""
    count = len(starts.vectors)
    return thin_starts(of, starts, np.full(count, of.bound), 10.0 ** -draws.uniform(3.0, 8.0, count), draws)


def tiny(of: Plant, starts: Starts, draws: np.random.Generator) -> Starts:
    """First sets of 1e-8 to 1e-12 rad, so that the rounding of their centers shows."""
    count = len(starts.vectors)
    return thin_starts(of, starts, 10.0 ** -draws.uniform(8.0, 12.0, count), 10.0 ** -draws.random(count), draws)
