"""Bounds of directions from averages over windows: of gravity if the motion is bounded, and of the magnetic field.

Needs only NumPy; SI units and radians; rows are instants. Derivations and proofs: docs/theory.md, section 18.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.arguments import increasing_times, require_not_negative, vector_rows
from elliptude.bounds.carried.frame import CarriedFrame
from elliptude.bounds.carried.one_matrix import OneMatrix
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import (
    EXACT_SENSOR,
    DirectionBounds,
    VectorSensorBounds,
    bounded_directions,
    radius_excess,
    rounded_up,
)
from elliptude.bounds.stamps import turns_within_offset
from elliptude.bounds.turns import lengths_of
from elliptude.bounds.velocity import MeasuredVelocity, VelocityOfRows
from elliptude.bounds.window_averages import Average, Piece, Place, Window, blocks
from elliptude.typing import FloatArray
from elliptude.units import STANDARD_GRAVITY

# Windows that the effect of a gyro's matrix is worked out for at once: what is summed then stays near the processor.
_AT_ONCE = 2048


@dataclass(frozen=True, eq=False)
class WindowBounds(DirectionBounds):
    """Directions from averages over windows."""

    durations: FloatArray
    """Length of the best window, s, shape (N,); NaN where there was none."""
    lengths: FloatArray
    """Length of the averaged vector, the sensor's unit, shape (N,)."""
    radii: FloatArray
    """How far the averaged vector may be from the true one, the sensor's unit, shape (N,)."""


@dataclass(frozen=True)
class MotionBounds:
    """Bounds of how the sensor moves; unknown ones are infinite.

    Parameters
    ----------
    velocity : float
        Bound of the speed at every instant, m/s, in any frame that does not accelerate.
    position : float
        Radius of a ball that the sensor does not leave during a window, m; the ball may be another for another window.
    acceleration : float
        Bound of the linear acceleration at every instant, m/s².
    jerk : float
        How fast that changes at most, m/s³, but for a part no larger than the accelerometer's error: what it may do
        while samples are lost.
    """

    velocity: float = np.inf
    position: float = np.inf
    acceleration: float = np.inf
    jerk: float = np.inf

    def __post_init__(self) -> None:
        """Check."""
        for name in ("velocity", "position", "acceleration", "jerk"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must be at least 0, not {getattr(self, name)}")

    def mean_acceleration_uniform(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Bound of the mean acceleration over [-before, after], (18.5), m/s²; over no time a speed bounds nothing."""
        return np.minimum(self.acceleration, _over(2.0 * self.velocity, before + after))

    def mean_acceleration_triangular(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Bound of the mean weighted by a triangle over [-before, after] with its top at 0, (18.6), m/s²."""
        from_velocity = _over(4.0 * self.velocity, before + after)
        from_position = _over(4.0 * self.position, before * after)
        return np.minimum(self.acceleration, np.minimum(from_velocity, from_position))

    def unseen(self, window: Window, error: float, *, triangular: bool, drift: float = 0.0) -> FloatArray:
        """Bound of how far the mean of samples is from that of the motion because of gaps, (18.54), m/s².

        Where no jerk is stated no window reaches across a gap.

        Parameters
        ----------
        window : Window
        error : float
            Of a sample: what of the acceleration may change faster than by the jerk is no larger, m/s².
        triangular : bool
            Whether weights rise to a top and fall; they are equal otherwise.
        drift : float
            How far offsets of stamps drift within a window at most, s: a gap is as much longer than they say, (18.64).

        Returns
        -------
        (M,) array
        """
        spans = window.before + window.after
        peak = (2.0 if triangular else 1.0) / spans
        share = 1.0 / 3.0 if triangular else 0.25
        jerk = self.jerk * (1.0 + drift / spans)
        by_jerk = share * jerk * window.gaps.squares if np.isfinite(self.jerk) else 0.0
        # What changes faster may be one way in the samples around a gap, and the other way in it.
        unseen: FloatArray = peak * (by_jerk + 2.0 * error * window.gaps.time)
        return unseen


def _over(moved: float, spans: FloatArray) -> FloatArray:
    """What was moved by, over spans; infinite where these are none."""
    quotients: FloatArray = np.divide(moved, spans, out=np.full_like(spans, np.inf), where=~(spans <= 0.0))
    return quotients


def _of_motion(window: Window, drift: float) -> tuple[FloatArray, FloatArray]:
    """Before the top and after it, s, how long windows are in the motion's time at least if stamps drift, (18.64)."""
    # What is left of a window that may be no time at all is rounding.
    share = np.maximum(1.0 - (1.0 + 1e-9) * drift / (window.before + window.after), 0.0)
    return share * window.before, share * window.after


def gravity_bounds_over_windows(
    times: ArrayLike,
    specific_forces: ArrayLike,
    angular_velocities: ArrayLike,
    durations: Sequence[float],
    *,
    motion: MotionBounds,
    gyro: GyroBounds,
    sensor: VectorSensorBounds = EXACT_SENSOR,
    gravity: float = STANDARD_GRAVITY,
    gravity_error: float = 0.0,
    time_offset: float = 0.0,
    time_offset_change: float = np.inf,
    at: Place = "end",
    maximum_step: float = np.inf,
    every: int = 1,
    velocity: MeasuredVelocity | None = None,
    sampled: ArrayLike | None = None,
) -> WindowBounds:
    """Up, from specific forces averaged over windows in a frame that the gyro carries along, (18.5) to (18.7).

    The mean linear acceleration is small if the speed or the place is bounded: 2v/T in a window of T with
    equal weights, 16p/T² with weights like a triangle. Where the velocity was measured at both ends it is known. The
    gyro's error over the window adds to it. All windows are tried and, row by row, the one with the smallest bound is
    returned; a row where any of them contradicts the bounds is contradicted.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    specific_forces : (N, 3) array
        m/s², body axes; at rest it points up. NaN where there was no sample.
    angular_velocities : (N, 3) array
        rad/s, body axes, the bias known at the first row subtracted; NaN where there was no sample. The gyro's error is
        that of the rates used: in a step the mean of its ends.
    durations : sequence of float
        Lengths of the windows, s. At the ends of the recording they are as long as it allows, with the row not in the
        middle.
    motion : MotionBounds
    gyro : GyroBounds
    sensor : VectorSensorBounds
        The accelerometer's.
    gravity, gravity_error : float
        m/s².
    time_offset : float
        Bound of the accelerometer's time against the gyro's, s.
    time_offset_change : float
        How far that drifts within a window at most, s, from its first sample to its last, steadily, as it does between
        two clocks of different rates; a window is as much shorter for what bounds the motion, (18.64). What differs
        from sample to sample beside that is jitter: it has to be in the sensor's ``averaged_error``. What one offset
        does to all samples nearly goes away in a window in which the body turns there and back, (18.60).
    at : {"end", "middle"}
        ``"end"`` uses no later sample; ``"middle"`` halves the gyro's error, for a recording or a delay of T/2.
    maximum_step : float
        A longer step between rows, s, is a gap, as rows with NaN are, and as one is that ``gyro`` does not cover.
        Windows reach across it if ``gyro`` says how the rate changes in one, and ``motion`` how the acceleration does.
    every : int
        Only rows whose index is a multiple of this get a bound, which saves time; the others are not measured.
    velocity : MeasuredVelocity, optional
        Measured velocities, (18.48).
    sampled : (N,) array, optional
        When each specific force was measured, s, if it has a stamp of its own beside its row's, (18.58).

    Returns
    -------
    WindowBounds
        The bounds of the direction up in body axes at each row.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    drift = min(time_offset_change, 2.0 * time_offset)

    def uniform(window: Window) -> FloatArray:
        mean = motion.mean_acceleration_uniform(*_of_motion(window, drift))
        return mean + motion.unseen(window, sensor.error, triangular=False, drift=drift)

    def triangular(window: Window) -> FloatArray:
        mean = motion.mean_acceleration_triangular(*_of_motion(window, drift))
        return mean + motion.unseen(window, sensor.error, triangular=True, drift=drift)

    def measured(known: VelocityOfRows, window: Window) -> FloatArray:
        mean = known.mean_acceleration(window, np.add(*_of_motion(window, drift)))
        return mean + motion.unseen(window, sensor.error, triangular=False, drift=drift)

    of_velocity = None if velocity is None else (velocity, measured)
    return _over_windows(
        times, specific_forces, angular_velocities, durations, (uniform, triangular), gyro, sensor, gravity,
        gravity_error, (time_offset, time_offset_change), sampled, at, maximum_step, every, of_velocity,
        across_gaps=np.isfinite(motion.jerk),
    )  # fmt: skip


def field_bounds_over_windows(
    times: ArrayLike,
    fields: ArrayLike,
    angular_velocities: ArrayLike,
    durations: Sequence[float],
    *,
    disturbance: float,
    gyro: GyroBounds,
    strength: float,
    strength_error: float = 0.0,
    sensor: VectorSensorBounds = EXACT_SENSOR,
    time_offset: float = 0.0,
    at: Place = "end",
    maximum_step: float = np.inf,
    every: int = 1,
    sampled: ArrayLike | None = None,
) -> WindowBounds:
    """The reference field's direction, averaged over windows in a frame that the gyro carries along.

    A disturbance does not average out, noise does: this is worth its cost if the sensor's ``averaged_error`` is
    well below its ``error``. Arguments are those of `gravity_bounds_over_windows` and `magnetometer_bounds`.

    Returns
    -------
    WindowBounds
        The bounds of the reference field's direction in body axes at each row.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    require_not_negative("disturbance", disturbance)

    def constant(window: Window) -> FloatArray:
        return np.full_like(window.before, disturbance)

    return _over_windows(
        times, fields, angular_velocities, durations, (constant,), gyro, sensor, strength, strength_error,
        (time_offset, np.inf), sampled, at, maximum_step, every,
    )  # fmt: skip


def cross_bounds(
    up: DirectionBounds, field: WindowBounds, reference: ArrayLike, *, in_plane_error: float
) -> DirectionBounds:
    """The direction of field × up: horizontal, and east if the horizontal field points north, (18.14), (18.55).

    It says about the heading what the field says, without the error in the plane of up and the field.

    Parameters
    ----------
    up, field : DirectionBounds, WindowBounds
        N rows each.
    reference : (3,) array
        The reference field, the unit of ``field``, in axes whose third is up.
    in_plane_error : float
        How far the reference field may be off within the plane that it spans with up; it is part of ``field.radii``.

    Returns
    -------
    DirectionBounds
        Rows where either is not measured are not measured.
    """
    vector = np.asarray(reference, dtype=np.float64)
    horizontal, strength = float(np.linalg.norm(vector[:2])), float(np.linalg.norm(vector))
    require_not_negative("in_plane_error", in_plane_error)
    if not in_plane_error < horizontal:
        raise ValueError(f"in_plane_error must be below the horizontal field {horizontal}, not {in_plane_error}")
    crossed = np.cross(field.lengths[:, None] * field.directions, up.directions)
    missing = np.isnan(up.angles) | np.isnan(field.angles)
    crossed[missing] = np.nan
    of_field = field.radii - in_plane_error
    of_tilt = 2.0 * (strength + in_plane_error) * np.sin(0.5 * up.angles)
    whole = bounded_directions(crossed, of_field + of_tilt, horizontal, in_plane_error, 1.0, 0.0)
    # In the plane across the measured up a tilt brings in the vertical field, and takes of the horizontal one.
    tilt = np.minimum(up.angles, 0.5 * np.pi)
    vertical, length = abs(float(vector[2])) + in_plane_error, horizontal + in_plane_error
    of_tilt = np.where(tilt < up.angles, np.inf, vertical * np.sin(tilt) + length * 2.0 * np.sin(0.5 * tilt) ** 2)
    level = bounded_directions(crossed, of_field + of_tilt, horizontal, in_plane_error, 1.0, 0.0)
    halves = np.sin(0.5 * level.angles) ** 2 + np.sin(0.5 * up.angles) ** 2
    out_of_level = 2.0 * np.arcsin(np.sqrt(np.minimum(halves, 1.0)))
    excess = np.maximum(whole.excess, level.excess)
    return DirectionBounds(
        whole.directions, np.where(excess > 0.0, np.nan, np.minimum(whole.angles, out_of_level)), excess
    )


MeanOffset = Callable[[Window], FloatArray]
_OffsetOfVelocity = tuple[MeasuredVelocity, Callable[[VelocityOfRows, Window], FloatArray]]


def _over_windows(
    times: ArrayLike,
    vectors: ArrayLike,
    angular_velocities: ArrayLike,
    durations: Sequence[float],
    offsets: tuple[MeanOffset, ...],
    gyro: GyroBounds,
    sensor: VectorSensorBounds,
    magnitude: float,
    magnitude_error: float,
    time_offset: tuple[float, float],
    sampled: ArrayLike | None,
    at: Place,
    maximum_step: float,
    every: int,
    of_velocity: _OffsetOfVelocity | None = None,
    *,
    across_gaps: bool = True,
) -> WindowBounds:
    """Bounds from means over windows: with equal weights and, if there is a second offset, weights like a triangle.

    With equal weights, too, over windows that begin and end where a velocity was measured.
    """
    stamps = increasing_times(times)
    count = len(stamps)
    rows, rates = vector_rows("vectors", vectors, count), vector_rows("angular_velocities", angular_velocities, count)
    if not len(durations) or not all(np.isfinite(duration) and duration > 0.0 for duration in durations):
        raise ValueError(f"durations must be positive and finite, not {list(durations)}")
    if at not in ("end", "middle"):
        raise ValueError(f"at must be 'end' or 'middle', not {at!r}")
    if every < 1:
        raise ValueError(f"every must be at least 1, not {every}")
    in_gaps = replace(gyro, longest_interval=min(gyro.longest_interval, maximum_step))
    own = _own_stamps(sampled, stamps, rows)
    turns = turns_within_offset(stamps, rates, rows, own, *time_offset, in_gaps)
    # Rows of the gyro, gaps between them, and rows among them with a sample.
    of_gyro = np.flatnonzero(~np.isnan(rates).any(axis=1))
    gaps = (np.diff(of_gyro) > 1) | (np.diff(stamps[of_gyro]) > in_gaps.longest_interval)
    measured = np.flatnonzero(~(np.isnan(rows).any(axis=1) | np.isnan(turns.angles))[of_gyro])
    samples = of_gyro[measured]
    known = None if of_velocity is None else of_velocity[0].at_rows(own[samples], at, time_offset[0])

    best = _Best(count, magnitude - magnitude_error, magnitude + magnitude_error)
    errors = _Errors.of(sensor)
    # About a row one matrix, or one bias, undoes a part of what it does; section 18.12.
    undoes = at == "middle" and (gyro.scale_error > 0.0 or gyro.is_steady)
    for block, needed in blocks(own[samples], max(durations), at):
        first, stop = measured[needed][0], measured[needed][-1] + 1
        carrying = of_gyro[first:stop]
        frame = CarriedFrame(stamps[carrying], rates[carrying], gaps[first : stop - 1], gyro, stamps[0])
        there = samples[needed]
        piece = Piece(
            frame, measured[needed] - first, own[there], rows[there], turns.take(there), gyro,
            away=float(np.abs(own - stamps)[there].max()), across_gaps=across_gaps,
        )  # fmt: skip
        reach = 0.5 * max(durations)
        matrix = OneMatrix(piece, gyro) if undoes else None
        here = np.flatnonzero(there % every == 0)
        here = here[(here >= block.start - needed.start) & (here < block.stop - needed.start)]
        wanted = there[here]
        given = None
        if of_velocity is not None and known is not None:
            given = known.take(needed), of_velocity[1]
        for window, means in _tried(piece, here, durations, at, (own[samples[0]], own[samples[-1]]), offsets, given):
            averages = piece.averages(window, triangular=len(means) > 1)
            for i, (average, offset) in enumerate(zip(averages, means, strict=True)):
                others = errors.of_mean(average, window, offset, triangular=i > 0)
                radius = average.turn + others
                if matrix is not None:
                    is_near = np.maximum(window.before, window.after) <= reach * (1.0 + 1e-6)
                    worth = np.flatnonzero(is_near & (others + average.by_stamps < np.fmin(best.radii[wanted], radius)))
                    for some in np.array_split(worth, -(-len(worth) // _AT_ONCE)) if len(worth) else ():
                        below = np.fmin(best.radii[wanted[some]], radius[some]) - others[some]
                        by_turns = matrix.turns(window, average, some, below, triangular=i > 0)
                        radius[some] = np.fmin(radius[some], by_turns + others[some])
                best.take(wanted, window, average, radius)
        # From the common frame to the body axes of each row.
        best.means[wanted] = np.einsum("nji,nj->ni", piece.attitudes[here], best.means[wanted])
    found = bounded_directions(best.means, best.radii, magnitude, magnitude_error, 1.0, 0.0)
    excess = np.maximum(best.excess, found.excess)
    angles = np.where(excess > 0.0, np.nan, found.angles)
    return WindowBounds(found.directions, angles, excess, best.durations, lengths_of(best.means), best.radii)


def _own_stamps(sampled: ArrayLike | None, stamps: FloatArray, vectors: FloatArray) -> FloatArray:
    """When each vector was measured, s: where nothing else is said, at its row."""
    if sampled is None:
        return stamps
    own = np.asarray(sampled, dtype=np.float64)
    if own.shape != stamps.shape:
        raise ValueError(f"sampled must have one time for each of {len(stamps)} rows, not shape {own.shape}")
    if not (np.diff(own[np.isfinite(vectors).all(axis=1)]) >= 0.0).all():
        raise ValueError("sampled must not decrease from one sample to the next")
    return own


def _tried(
    piece: Piece,
    rows: NDArray[np.intp],
    durations: Sequence[float],
    at: Place,
    ends: tuple[float, float],
    offsets: tuple[MeanOffset, ...],
    given: tuple[VelocityOfRows, Callable[[VelocityOfRows, Window], FloatArray]] | None,
) -> Iterator[tuple[Window, tuple[MeanOffset, ...]]]:
    """Windows of the rows, and what may be in the means over them, with equal weights and with a triangle's.

    The longest first: where other errors alone make a shorter one wider, its turns need no second look.
    """
    for duration in sorted(durations, reverse=True):
        window = piece.window(rows, duration, at, ends)
        yield window, offsets
        if given is not None:
            velocity, measured = given
            yield piece.between(*velocity.ends(window), rows, at), (partial(measured, velocity),)


@dataclass(frozen=True)
class _Errors:
    """What a sensor's own errors do to a mean."""

    scale: float
    """Largest error as a share of a sample's true length."""
    sensor: VectorSensorBounds

    @classmethod
    def of(cls, sensor: VectorSensorBounds) -> "_Errors":
        # A scale error and a misalignment act on every sample: k (‖f‖ + e) in the mean, where ‖f‖ is measured.
        scale = sensor.scale_error + 2.0 * float(np.sin(0.5 * min(sensor.misalignment, np.pi)))
        if scale >= 1.0:
            raise ValueError(f"misalignment and scale_error leave nothing of the sensor: {scale} of its length")
        return cls(scale, sensor)

    def of_mean(self, average: Average, window: Window, offset: MeanOffset, *, triangular: bool) -> FloatArray:
        """All of (18.7) but what turns do, with what rounding does."""
        with np.errstate(invalid="ignore", divide="ignore"):
            skews = window.after - window.before if triangular else None
            spans, gaps = window.before + window.after, window.gaps
            own = self.sensor.mean_error(spans, skews)
            peaks = (2.0 if triangular else 1.0) / spans
            across = self.sensor.mean_error_across_gaps(peaks, gaps.count, gaps.time)
            own = np.where(gaps.count > 0.0, across, own)
            own = own + self.scale * (average.length + self.sensor.error) / (1.0 - self.scale)
            errors: FloatArray = own + offset(window) + average.rounding / (1.0 - self.scale)
        return errors


class _Best:
    """Row by row the mean with the smallest radius so far, and how far any mean contradicts its own."""

    def __init__(self, count: int, least: float, greatest: float) -> None:
        self.means, self.radii = np.full((count, 3), np.nan), np.full(count, np.inf)
        self.durations, self.excess = np.full(count, np.nan), np.zeros(count)
        self._least, self._greatest = least, greatest

    def take(self, wanted: NDArray[np.intp], window: Window, average: Average, radius: FloatArray) -> None:
        """Take means of some rows, each over its window."""
        lengths = lengths_of(average.mean)
        # NaN where there is no window: no excess, and not better.
        rounded = rounded_up(radius, lengths, self._greatest)
        self.excess[wanted] = np.maximum(
            self.excess[wanted], radius_excess(lengths, self._least, self._greatest, rounded)
        )
        better = radius <= self.radii[wanted]
        target = wanted[better]
        self.means[target], self.radii[target] = average.mean[better], radius[better]
        self.durations[target] = window.before[better] + window.after[better]
