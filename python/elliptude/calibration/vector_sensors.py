"""The parameters of an accelerometer or a magnetometer that a recording leaves possible; docs/theory.md, section 19.

The sensor shows y = S z + b + e. Parameters are the symmetric P with S = P⁻¹Uᵀ, the offset p = P b and the length F of
the world's vector: θ = (p, P - I, F). The rotation U cannot be seen in lengths; it stays what is stated of it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.bounds.samples import mean_error
from elliptude.calibration.parameter_sets import ParameterSet, covering_directions, small_ball
from elliptude.calibration.poses import Pose
from elliptude.typing import FloatArray

PARAMETERS = 10
_SYMMETRIC = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_PASSES = 6
# A pass that leaves more than this share of the sizes before it is the last.
_HARDLY_SMALLER = 0.98
# Sums over up to 1e5 samples, of their lengths.
_SUM_ROUNDING = 1e-10
# Room that the inequalities need beyond rounding to be called a contradiction, of the vector's length.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class SensorStatements:
    """What is stated of a vector sensor and of the world while it is calibrated; one unit for all lengths."""

    offset: float
    """Bound of ‖b‖."""
    scale_error: float
    """Bound of ‖S - I‖, from 0 to below 1."""
    noise: float
    """Bound of ‖e‖ for each sample."""
    averaged_noise: float
    """Bound of ‖e‖ averaged over ``averaged_over`` (s) or more, turned into a common frame by the true attitudes.

    What a sum over samples differs by from the integral belongs to it, section 19.2.
    """
    least: float
    """The world's vector is at least this long; its length does not change in the recording."""
    greatest: float
    disturbance: float
    """How far what acts on the sensor may be from the world's vector at any instant."""
    misalignment: float = math.pi
    """Bound of U's angle, rad, if it is less than follows from the scale error."""
    averaged_over: float = 0.0

    def mean_noise(self, duration: float) -> float:
        """Bound of ‖e‖ averaged over a window of this length, s."""
        return float(mean_error(self.noise, self.averaged_noise, self.averaged_over, duration))

    @property
    def axes_error(self) -> float:
        """Bound of ‖U - I‖, section 19.1."""
        return min(
            2.0 * math.sin(0.5 * min(self.misalignment, math.pi)), 2.0 * self.scale_error / (2.0 - self.scale_error)
        )

    @property
    def inverse_scale_error(self) -> float:
        """κ, bound of ‖P - I‖."""
        return self.scale_error / (1.0 - self.scale_error)


class ContradictionError(ValueError):
    """No parameters agree with what is stated; the message says which samples say so, and by how much."""


@dataclass(frozen=True, eq=False)
class SensorSet:
    """What a recording leaves possible of a sensor: corrected samples P̂(y - b̂) are (I + K) z + e."""

    offset: FloatArray
    """b̂, to be subtracted, shape (3,)."""
    matrix: FloatArray
    """P̂, to be multiplied with, symmetric, shape (3, 3); the identity where that is as good."""
    offset_error: float
    """Bound of ‖P̂(b - b̂)‖, what is left of the offset in a corrected sample, (19.11)."""
    offset_distance: float
    """Bound of ‖b - b̂‖, how far the offset itself is from what is subtracted, (19.8)."""
    scale_error: float
    """Bound of ‖K‖, the sensor's turn against the body's axes included."""
    stretch: float
    """Bound of ‖P̂ - I‖, by which noise may grow."""
    lowest: FloatArray
    """Least value of each component of b, shape (3,)."""
    highest: FloatArray
    spare: float
    """Proved: stated smaller by more than this, a disturbance would have left nothing that agrees with the samples."""
    poses: int

    @property
    def is_correction(self) -> bool:
        """Whether there is anything to correct."""
        return bool(self.offset.any()) or not np.array_equal(self.matrix, np.eye(3))


def require_possible(times: FloatArray, vectors: FloatArray, stated: SensorStatements) -> None:
    """Refuse samples that no sensor within the statements shows; windows would only hide them among others."""
    if not len(times):
        return
    longest = (1.0 + stated.scale_error) * (stated.greatest + stated.disturbance) + stated.offset + stated.noise
    shortest = (1.0 - stated.scale_error) * (stated.least - stated.disturbance) - stated.offset - stated.noise
    # Squares of very large components overflow; one component alone is enough then.
    sizes = np.abs(vectors).max(axis=1)
    lengths = np.where(sizes > longest, sizes, np.linalg.norm(np.where(sizes[:, None] > longest, 0.0, vectors), axis=1))
    excess = np.fmax(np.maximum(lengths - longest, shortest - lengths) - 1e-10 * longest, 0.0)
    if excess.any():
        worst = int(np.argmax(excess))
        raise ContradictionError(
            f"no parameters agree with the sample at {times[worst]:.3f} s: it is {excess[worst]:.3g} too "
            f"{'long' if lengths[worst] > longest else 'short'} in"
        )


def sensor_set(poses: Sequence[Pose], stated: SensorStatements) -> SensorSet:
    """All parameters that agree with the poses and with what is stated.

    Raises
    ------
    ContradictionError
        If there are none.
    """
    if not poses:
        return _as_stated(stated, np.inf, 0)
    prior = _prior(stated)
    found, lowest, highest, theta = prior, prior.lowest, prior.highest, proposal(poses, stated)
    spare = np.inf
    for _ in range(_PASSES):
        rows, limits, whose = _slabs(poses, stated, theta, lowest, highest)
        found = ParameterSet(lowest, highest, prior.rows, prior.limits).within(rows, limits)
        short = found.shortfall(len(prior.limits), np.ones(len(limits)))
        if short.least > _ROUNDING * stated.greatest:
            raise ContradictionError(
                _contradiction(poses, np.bincount(whose, short.weights).astype(np.float64), short.least)
            )
        spare, before = -short.least, highest - lowest
        box = found.box()
        lowest, highest = np.maximum(lowest, box[0]), np.minimum(highest, box[1])
        theta = 0.5 * (lowest + highest)
        if ((highest - lowest)[:3] > _HARDLY_SMALLER * before[:3]).all():
            break
    known = _as_stated(stated, spare, len(poses))
    about = _offset_about(found, theta[:3])
    choices = [known, _corrected(found, about, np.eye(3), stated, known)]
    choices.append(_corrected(found, about, np.eye(3) + _matrix(theta[3:9]), stated, known))
    best = min(
        choices, key=lambda one: one.offset_error + one.scale_error * stated.greatest + one.stretch * stated.noise
    )
    return replace(best, lowest=choices[1].lowest, highest=choices[1].highest)


def proposal(poses: Sequence[Pose], stated: SensorStatements) -> FloatArray:
    """Parameters (p, P - I, F) by least squares, P = I: a point to expand about, nothing that is proved."""
    vectors = np.array([np.einsum("app->a", pose.products) for pose in poses])
    frames = np.array([pose.frame for pose in poses])

    def residuals(x: FloatArray) -> FloatArray:
        lengths = np.linalg.norm(vectors - frames @ x[:3], axis=1)
        # What the poses do not show stays near zero.
        weak = 1e-3 * np.append(x[:3], x[3] - 0.5 * (stated.least + stated.greatest))
        return np.concatenate([lengths - x[3], weak])

    start = np.append(np.zeros(3), 0.5 * (stated.least + stated.greatest))
    found = scipy.optimize.least_squares(residuals, start)
    offset, size = found.x[:3], float(np.linalg.norm(found.x[:3]))
    offset = offset * min(1.0, stated.offset / size) if size > 0.0 else offset
    return np.concatenate([offset, np.zeros(6), [np.clip(found.x[3], stated.least, stated.greatest)]])


def _as_stated(stated: SensorStatements, spare: float, poses: int) -> SensorSet:
    box = np.full(3, stated.offset)
    return SensorSet(
        offset=np.zeros(3),
        matrix=np.eye(3),
        offset_error=stated.offset,
        offset_distance=stated.offset,
        scale_error=stated.scale_error,
        stretch=0.0,
        lowest=-box,
        highest=box,
        spare=spare,
        poses=poses,
    )


def _prior(stated: SensorStatements) -> ParameterSet:
    """What is stated of the parameters, (19.1): P has its eigenvalues between 1/(1 + k) and 1/(1 - k)."""
    k, kappa = stated.scale_error, stated.inverse_scale_error
    largest = stated.offset / (1.0 - k) * (1.0 + 1e-12)
    directions, _ = covering_directions()
    size = np.concatenate([np.full(3, largest), np.full(6, kappa)])
    squares = np.array([_of_symmetric(u, u) for u in directions])
    offsets = np.zeros((len(directions), PARAMETERS))
    offsets[:, :3] = directions
    stretch = np.zeros((len(directions), PARAMETERS))
    stretch[:, 3:9] = squares
    return ParameterSet(
        np.append(-size, stated.least),
        np.append(size, stated.greatest),
        np.concatenate([offsets, stretch, -stretch]),
        np.repeat([largest, kappa, k / (1.0 + k)], len(directions)),
    )


def _of_symmetric(left: FloatArray, right: FloatArray) -> FloatArray:
    """The coefficients of the six entries of a symmetric M in leftᵀ M right."""
    entries = np.multiply.outer(left, right)
    return np.array([entries[i, j] + (entries[j, i] if i != j else 0.0) for i, j in _SYMMETRIC])


def _matrix(entries: FloatArray) -> FloatArray:
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(_SYMMETRIC, entries, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def _slabs(
    poses: Sequence[Pose], stated: SensorStatements, about: FloatArray, lowest: FloatArray, highest: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Two inequalities for each pose, (19.4) and (19.5), and whose they are.

    ``about`` is where lengths are expanded; the box holds all parameters that are possible.
    """
    reach = np.maximum(highest - about, about - lowest)
    kappa = stated.inverse_scale_error
    entries = np.linalg.norm(reach[3:9] * [1.0, 1.0, 1.0, np.sqrt(2.0), np.sqrt(2.0), np.sqrt(2.0)])
    stretch_reach = min(float(entries), kappa + float(np.linalg.norm(_matrix(about[3:9]))))
    offset_reach = float(np.linalg.norm(reach[:3]))
    stretch = np.eye(3) + _matrix(about[3:9])
    rows, limits, whose = [], [], []
    for i, pose in enumerate(poses):
        vector = np.einsum("apq,pq->a", pose.products, stretch) - pose.frame @ about[:3]
        length = float(np.linalg.norm(vector))
        if not length > 0.0:
            continue
        u = vector / length
        products = np.einsum("a,apq->pq", u, pose.products)
        along = np.zeros(PARAMETERS)
        along[:3] = -(u @ pose.frame)
        along[3:9] = [products[p, q] + (products[q, p] if p != q else 0.0) for p, q in _SYMMETRIC]
        at_identity = float(np.trace(products))
        error = pose.mean_disturbance + stated.disturbance * pose.turn + stated.mean_noise(pose.end - pose.begin)
        # What averages out where the body truly is does not in a frame that is off, nor where the scale is.
        error += stated.noise * (pose.turn + kappa)
        error += _SUM_ROUNDING * (pose.length + stated.offset + stated.greatest)
        strength = np.zeros(PARAMETERS)
        strength[9] = 1.0
        rows.append(along - strength)
        limits.append(error - at_identity)
        whose.append(i)
        reach_of_vector = stretch_reach * pose.length + offset_reach
        if reach_of_vector < length:
            bent = 0.5 * reach_of_vector**2 / (length - reach_of_vector)
            rows.append((1.0 - 0.5 * pose.squared_turn) * strength - along)
            limits.append(error + bent + at_identity)
            whose.append(i)
    return np.array(rows).reshape(-1, PARAMETERS), np.array(limits), np.array(whose, dtype=np.intp)


def _offset_about(found: ParameterSet, start: FloatArray) -> FloatArray:
    """An offset b̂ in the middle of those that are possible."""
    directions, cosine = covering_directions()
    shift, _ = small_ball(directions, cosine, offset_supports(found, directions, start))
    middle: FloatArray = start + shift
    return middle


def _corrected(
    found: ParameterSet, offset: FloatArray, matrix: FloatArray, stated: SensorStatements, known: SensorSet
) -> SensorSet:
    """What is left after a correction by P̂ and b̂, (19.8) to (19.11)."""
    directions, cosine = covering_directions()
    k = stated.scale_error
    reach = max(float(offset_supports(found, directions, offset).max()), 0.0) / cosine
    stretch = float(np.abs(np.linalg.eigvalsh(matrix - np.eye(3))).max()) * (1.0 + 1e-12)
    distance = (1.0 + k) * reach
    if stretch == 0.0:
        scale, error = k, distance
    else:
        left = (1.0 + k) * stretch_error(found, matrix)
        scale, error = left + stated.axes_error, (1.0 + left) * reach
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    sides = np.minimum(offset_supports(found, axes, offset), reach) + k * reach
    return replace(
        known,
        offset=offset,
        matrix=matrix,
        offset_error=error,
        offset_distance=distance,
        scale_error=scale,
        stretch=stretch,
        lowest=np.maximum(offset - sides[3:], known.lowest),
        highest=np.minimum(offset + sides[:3], known.highest),
    )


def stretch_error(found: ParameterSet, matrix: FloatArray) -> float:
    """An upper bound of ‖P - P̂‖ over the set, (19.10)."""
    directions, cosine = covering_directions()
    largest = 0.0
    for u in directions[: len(directions) // 2]:
        along = np.zeros(PARAMETERS)
        along[3:9] = _of_symmetric(u, u)
        there = float(u @ matrix @ u) - 1.0
        largest = max(largest, found.support(along) - there, found.support(-along) + there)
    return largest / (2.0 * cosine**2 - 1.0)


def offset_supports(found: ParameterSet, directions: FloatArray, center: FloatArray) -> FloatArray:
    """Upper bounds of uᵀ(p - P center) for each direction u."""
    values = []
    for u in directions:
        along = np.zeros(PARAMETERS)
        along[:3] = u
        along[3:9] = -_of_symmetric(u, center)
        values.append(found.support(along) - float(u @ center))
    return np.array(values)


def _contradiction(poses: Sequence[Pose], weights: FloatArray, least: float) -> str:
    worst = [int(i) for i in np.argsort(-weights)[:4] if weights[i] > 0.0]
    places = ", ".join(f"{poses[i].begin:.2f} to {poses[i].end:.2f} s" for i in sorted(worst))
    return f"no parameters agree with the samples at {places}: they disagree by at least {least:.3g}"
