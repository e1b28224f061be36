"""What `elliptude.validation` tries the filters with: scenarios from any start, and errors that reach their bounds."""

from dataclasses import dataclass, fields
from typing import Any, Literal, Protocol, TypeAlias, get_args

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude import _core
from elliptude.simulation import simulated
from elliptude.typing import FloatArray

Noise: TypeAlias = Literal["inside", "perpendicular", "common", "alternating", "search"]
"""How errors are drawn.

``inside``: every error uniform in the ball of its bound.
``perpendicular``: on its sphere; a direction's perpendicular to it.
``common``: on its sphere; all directions of a time share theirs.
``alternating``: on its sphere, the same from update to update but for its sign.
``search``: errors and initial state are moved towards the largest form of the truth in the set, run after run.
"""
NOISES: tuple[Noise, ...] = get_args(Noise)
DIRECTIONS = ("two", "three", "five")
BOUNDS_DEG = (0.1, 1.0, 7.0, 20.0)
"""Bounds of a direction's error, and the same numbers per second of the rate's."""
DESCRIPTIONS = {
    "disturbed": "orbit, with an unknown torque of up to 0.01 N m beside the known ones",
    "free": "free body of any spin of up to 5 rad/s, an update each 0.1 s",
    "gyro": "gyro with bias, drift and a changing rate between its samples, an update each 0.1 s",
    "orbit": "gravity gradient, an update each tenth of an orbit",
    "pendulum": "3D pendulum from any attitude, an update each 0.1 s",
}
SCENARIOS = tuple(DESCRIPTIONS)

# What rounding adds to an error, rad and rad/s: errors reach their bounds up to this.
_ROUNDING = 1e-14
INSIDE = 1.0 - 1e-12


@dataclass(frozen=True)
class Case:
    """One combination of scenario, directions, bound, noise and kind of trial."""

    scenario: str
    directions: str
    bound_deg: float
    noise: Noise
    kind: str = "honest"
    """One of `elliptude.validation.trial_kinds.KINDS`, or ``honest``."""

    @property
    def name(self) -> str:
        """The case in words: "orbit three 7 inside", with the kind of trial if it is not ``honest``."""
        words = f"{self.scenario} {self.directions} {self.bound_deg:g} {self.noise}"
        return words if self.kind == "honest" else f"{words} {self.kind}"


# --- what moves, and how it is measured -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of T trials with U updates of m directions, each in the unit ball of its bound."""

    directions: FloatArray
    """ν with b = exp(S(ν)) b̃, body axes, shape (T, U, m, 3)."""
    rates: FloatArray
    """Errors of the measured angular velocity or of the gyro, shape (T, U, 3)."""
    inputs: FloatArray
    """Inputs of the intervals: unknown torque, or angular acceleration and drift of the bias, shape (T, U, 2, 3)."""
    start: FloatArray
    """The true initial state in the first set, shape (T, 6)."""

    def of(self, rows: NDArray[np.intp]) -> "Errors":
        """The rows of some trials."""
        return Errors(*(getattr(self, field.name)[rows] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Starts:
    """The first sets of T trials, {Ĉ exp(S(ζ)), x̂ + δ : ‖L⁻¹[ζ; δ]‖ ≤ 1}."""

    attitudes: FloatArray
    """Ĉ, shape (T, 3, 3)."""
    vectors: FloatArray
    """x̂, angular velocities or gyro biases, rad/s, shape (T, 3)."""
    rates: FloatArray
    """The true angular velocities of trials whose vector is the bias, rad/s, shape (T, 3)."""
    roots: FloatArray
    """L, shape (T, 6, 6)."""
    from_measurement: NDArray[np.bool_]
    """Trials whose filter is not told the set, shape (T,)."""

    @property
    def shapes(self) -> FloatArray:
        """P = L Lᵀ, exactly symmetric."""
        shapes = self.roots @ self.roots.swapaxes(1, 2)
        symmetric: FloatArray = 0.5 * (shapes + shapes.swapaxes(1, 2))
        return symmetric

    def of(self, rows: NDArray[np.intp]) -> "Starts":
        """The rows of some trials."""
        return Starts(*(getattr(self, field.name)[rows] for field in fields(self)))

    def true_states(self, errors: Errors) -> tuple[FloatArray, FloatArray]:
        """Attitudes (T, 3, 3) and vectors (T, 3) at time 0."""
        offsets = np.einsum("tij,tj->ti", self.roots, INSIDE * errors.start)
        return self.attitudes @ _rotations(offsets[:, :3]), self.vectors + offsets[:, 3:]


@dataclass(frozen=True, eq=False)
class Motion:
    """The truth of T trials at time 0 and at the U updates."""

    attitudes: FloatArray
    """Body to reference, shape (T, U + 1, 3, 3)."""
    rates: FloatArray
    """Angular velocities, rad/s, body axes, shape (T, U + 1, 3)."""
    vectors: FloatArray
    """The vector that the filter estimates beside the attitude: rates or gyro biases, shape (T, U + 1, 3)."""


@dataclass(frozen=True, eq=False)
class Measured:
    """The measurements of T trials; row 0 is at time 0, where no direction is measured."""

    directions: FloatArray
    """Body axes, shape (T, U + 1, m, 3)."""
    rates: FloatArray
    """Angular velocities or gyro samples, rad/s, body axes, shape (T, U + 1, 3)."""


class Plant(Protocol):
    """A scenario with its bounds and flows."""

    @property
    def interval(self) -> float:
        """From update to update, s."""

    @property
    def reference(self) -> FloatArray:
        """Directions in reference axes, shape (m, 3)."""

    @property
    def bound(self) -> float:
        """Bound of a direction's error, rad."""

    @property
    def rate_bound(self) -> float:
        """Bound of the error of a measured rate or a gyro's sample, rad/s."""

    @property
    def has_gyro(self) -> bool:
        """Whether measured rates are the flow's input, not measurements."""

    @property
    def largest_rate(self) -> float:
        """Largest of the true initial rates, rad/s."""

    def motion(self, starts: Starts, errors: Errors) -> Motion:
        """The true motion."""

    def flow(self) -> _core.RigidBodyFlow | _core.GyroFlow:
        """The flow for the modes of first order."""

    def guaranteed_flow(self) -> Any:
        """The flow for the guaranteed mode."""


def measure(of: Plant, motion: Motion, errors: Errors) -> Measured:
    """Measurements with the given share of their bounds as errors.

    Parameters
    ----------
    of : Plant
    motion : Motion
    errors : Errors

    Returns
    -------
    Measured
        The angle between a true and a measured direction, and the length of a rate's error, are at most the bound,
        rounding included.
    """
    bound, rate_bound = (max(0.0, bound - _ROUNDING) for bound in (of.bound, of.rate_bound))
    true = _true_directions(of, motion)
    turned = np.einsum("tumij,tumi->tumj", _rotations(bound * errors.directions), true)
    nowhere = np.full((len(true), 1, *true.shape[2:]), np.nan)
    directions = np.concatenate([nowhere, turned], axis=1)
    if of.has_gyro:  # the sample of row k is for the interval that begins there
        rates = motion.rates + motion.vectors
        rates[:, :-1] += rate_bound * errors.rates
    else:
        rates = motion.rates.copy()
        rates[:, 0] = np.nan
        rates[:, 1:] -= rate_bound * errors.rates
    return Measured(directions, rates.astype(np.float64))


def _true_directions(of: Plant, motion: Motion) -> FloatArray:
    """Body axes, at the updates, shape (T, U, m, 3)."""
    true: FloatArray = np.einsum("tuji,mj->tumi", motion.attitudes[:, 1:], of.reference)
    return true


def _rotations(vectors: FloatArray) -> FloatArray:
    """exp(S(x)) of vectors (..., 3), by SciPy."""
    matrices: FloatArray = scipy.spatial.transform.Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return matrices.reshape(*vectors.shape, 3)


# --- what is drawn ----------------------------------------------------------------------------------------------------


def draw_starts(of: Plant, count: int, draws: np.random.Generator) -> Starts:
    """First sets with axes of any direction, half as long to twice as long as the bound; every second one is not told.

    A gyro's bias has no bound without a first set, so it is always told.
    """
    attitudes = scipy.spatial.transform.Rotation.from_quat(_normalized(draws.standard_normal((count, 4)))).as_matrix()
    rates = of.largest_rate * simulated.in_ball(draws, (count,))
    axes, _ = np.linalg.qr(draws.standard_normal((count, 6, 6)))
    lengths = of.bound * 2.0 ** draws.uniform(-1.0, 1.0, (count, 6))
    return Starts(
        attitudes=attitudes,
        vectors=of.bound * simulated.in_ball(draws, (count,)) if of.has_gyro else rates,
        rates=rates,
        roots=axes * lengths[:, None, :],
        from_measurement=np.zeros(count, bool) if of.has_gyro else np.arange(count) % 2 == 1,
    )


def draw_errors(of: Plant, noise: Noise, starts: Starts, updates: int, draws: np.random.Generator) -> Errors:
    """Errors of one kind; for ``search`` a mixture to begin with.

    Parameters
    ----------
    of : Plant
    noise : Noise
    starts : Starts
    updates : int
    draws : numpy.random.Generator

    Returns
    -------
    Errors
    """
    count, sensors = len(starts.vectors), len(of.reference)
    if noise == "inside":
        return Errors(
            directions=simulated.in_ball(draws, (count, updates, sensors)),
            rates=simulated.in_ball(draws, (count, updates)),
            inputs=simulated.in_ball(draws, (count, updates, 2)),
            start=_normalized(draws.standard_normal((count, 6))) * draws.random((count, 1)) ** (1.0 / 6.0),
        )
    # Over time the errors of a trial are drawn anew, stay the same, or only change sign.
    in_time = draws.integers(3, size=count)
    shared = draws.integers(2, size=count) == 1
    if noise != "search":
        in_time[:] = 2 if noise == "alternating" else 0
        shared[:] = noise == "common"
    signs = np.where((in_time == 2)[:, None], (-1.0) ** np.arange(updates), 1.0)

    def on_spheres(*items: int) -> FloatArray:
        drawn = simulated.on_sphere(draws, (count, updates, *items))
        each = (slice(None), slice(None), *(None for _ in items), None)
        return signs[each] * np.where((in_time == 0)[:, None][each], drawn, drawn[:, :1])

    rates, inputs, around = on_spheres(), on_spheres(2), on_spheres(sensors)
    start = _normalized(draws.standard_normal((count, 6)))
    true = _true_directions(of, of.motion(starts, Errors(np.zeros_like(around), rates, inputs, start)))
    directions = np.where(shared[:, None, None, None], around[:, :, :1], _normalized(np.cross(true, around)))
    return Errors(directions, rates, inputs, start)


def propose(errors: Errors, draws: np.random.Generator) -> Errors:
    """Errors near the given ones: each trial moves all of them, or those of one time, of one sensor or of the start.

    Parameters
    ----------
    errors : Errors
    draws : numpy.random.Generator

    Returns
    -------
    Errors
        Still in the unit balls; most changed ones are on their spheres.
    """
    count, updates, sensors, _ = errors.directions.shape
    what = draws.integers(5, size=(count, 1))
    everything, one_time, from_a_time, one_sensor, only_start = (what == kind for kind in range(5))
    time, sensor = draws.integers(updates, size=(count, 1)), draws.integers(sensors, size=(count, 1))
    times, of_sensors = np.arange(updates), np.arange(sensors)
    at = everything | (one_time & (times == time)) | (from_a_time & (times >= time))
    at_sensors = at[:, :, None] | (one_sensor & (of_sensors == sensor))[:, None, :]
    scales = 10.0 ** draws.uniform(-1.5, 0.3, count)
    goes_outside = draws.random((count,)) < 0.8

    def moved(old: FloatArray, chosen: NDArray[np.bool_]) -> FloatArray:
        each = (count,) + (1,) * (old.ndim - 1)
        steps = draws.standard_normal(old.shape)
        if old.ndim > 2:  # from a time on all alike, because errors that add up do the most
            steps = np.where(from_a_time.reshape(each), steps[:, :1], steps)
        new = old + scales.reshape(each) * steps
        length = np.linalg.norm(new, axis=-1, keepdims=True)
        new /= np.where(goes_outside.reshape(each), length, np.maximum(length, 1.0))
        return np.where(chosen[..., None], new, old)

    return Errors(
        directions=moved(errors.directions, at_sensors),
        rates=moved(errors.rates, at),
        inputs=moved(errors.inputs, at[:, :, None]),
        start=moved(errors.start, (everything | only_start)[:, 0]),
    )


def _normalized(vectors: FloatArray) -> FloatArray:
    normalized: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return normalized
