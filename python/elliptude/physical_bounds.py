"""Bounds of measured directions, from what is known of sensors and motion.

A datasheet, the speed of a hand, the size of a room: this module turns such knowledge into the angle that each measured
direction may be off. NumPy alone; SI units and radians; rows are instants. Derivations and proofs: docs/theory.md,
section 18.

Nothing is clipped in silence. Where data and stated bounds contradict each other, the row's angle is NaN (not measured)
and its `DirectionBounds.excess` says by how much; where a bound says nothing, the angle is pi.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.results import FloatArray

STANDARD_GRAVITY = 9.80665
"""m/s²."""

_BLOCK_ROWS = 1 << 16
_SQRT3 = math.sqrt(3.0)
_EPSILON = float(np.finfo(np.float64).eps)


# --- arguments --------------------------------------------------------------------------------------------------------


def _not_negative(name: str, value: float) -> None:
    if not 0.0 <= value < np.inf:
        raise ValueError(f"{name} must be finite and at least 0, not {value}")


def _fraction(name: str, value: float) -> None:
    if not 0.0 <= value < 1.0:
        raise ValueError(f"{name} must be from 0 to below 1, not {value}")


def _rows(name: str, values: ArrayLike, count: int | None = None) -> FloatArray:
    """An array (N, 3); a row that is not finite in any component becomes NaN in all."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or (count is not None and len(array) != count):
        raise ValueError(f"{name} must have shape ({'N' if count is None else count}, 3), not {array.shape}")
    return np.where(np.isfinite(array).all(axis=1, keepdims=True), array, np.nan)


def _times(values: ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not len(array):
        raise ValueError(f"times must have shape (N,) with at least one row, not {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"times must be finite; row {int(np.flatnonzero(~np.isfinite(array))[0])} is not")
    backward = np.flatnonzero(np.diff(array) <= 0.0)
    if len(backward):
        raise ValueError(f"times must increase; row {int(backward[0]) + 1} does not")
    return array


# --- what goes in and comes out ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DirectionBounds:
    """A direction per row, in body axes, and the angle within which the true one lies."""

    directions: FloatArray
    """Unit vectors, shape (N, 3); NaN where nothing was measured."""
    angles: FloatArray
    """rad, shape (N,). NaN: not measured, or contradicted. pi: the bounds say nothing."""
    excess: FloatArray
    """By how much a norm contradicts the stated bounds, in the sensor's unit, shape (N,); 0 where it does not."""

    @property
    def contradicted(self) -> NDArray[np.bool_]:
        """Rows that prove a stated bound wrong, shape (N,)."""
        return self.excess > 0.0

    @property
    def informative(self) -> NDArray[np.bool_]:
        """Rows that say something, shape (N,)."""
        return self.angles < np.pi


@dataclass(frozen=True, eq=False)
class WindowBounds(DirectionBounds):
    """Directions from averages over windows."""

    durations: FloatArray
    """Of the window that was best, s, shape (N,); NaN where there was none."""
    lengths: FloatArray
    """Of the averaged vector, the sensor's unit, shape (N,)."""
    radii: FloatArray
    """How far the averaged vector may be from the true one, the sensor's unit, shape (N,)."""


@dataclass(frozen=True)
class VectorSensorBounds:
    """What an accelerometer or magnetometer may be off: it shows (I + K) x + e instead of the true vector x.

    Parameters
    ----------
    error : float
        Of ‖e‖ for each sample: bias, noise, hard iron; the sensor's unit.
    scale_error : float
        Of the spectral norm of K: scale, soft iron, axes not perpendicular; from 0 to below 1.
    misalignment : float
        Of the angle between its axes and the body's (the gyro's), rad.
    averaged_error : float, optional
        Of the norm of e's mean over a window, turned into a common frame; ``error`` if left out. It may be smaller, as
        noise averages out. It also covers sampling: the mean of the samples less that of the motion between them.
    """

    error: float = 0.0
    scale_error: float = 0.0
    misalignment: float = 0.0
    averaged_error: float | None = None

    def __post_init__(self) -> None:
        """Check."""
        _not_negative("error", self.error)
        _not_negative("misalignment", self.misalignment)
        _fraction("scale_error", self.scale_error)
        if self.averaged_error is not None:
            _not_negative("averaged_error", self.averaged_error)


@dataclass(frozen=True)
class GyroBounds:
    """What a gyro may be off: it shows (I + K) ω + b + v. Section 18.4.

    Parameters
    ----------
    noise : float
        Of ‖v‖ at every instant, rad/s.
    bias : float
        Of ‖b‖, what is left of the bias after the known one was subtracted, rad/s.
    drift : float
        How fast the bias changes, rad/s².
    scale_error : float
        Of the spectral norm of K, from 0 to below 1. K is one matrix for the whole recording.
    increment : float
        Of ‖∫ v dt‖ over any window, rad. Far less than ``noise`` times the window where the noise changes sign.
    """

    noise: float
    bias: float = 0.0
    drift: float = 0.0
    scale_error: float = 0.0
    increment: float = np.inf

    def __post_init__(self) -> None:
        """Check."""
        for name in ("noise", "bias", "drift"):
            _not_negative(name, getattr(self, name))
        _fraction("scale_error", self.scale_error)
        if not self.increment >= 0.0:
            raise ValueError(f"increment must be at least 0, not {self.increment}")

    def steady_error(self, angular_speeds: ArrayLike, elapsed: ArrayLike = 0.0) -> FloatArray:
        """Bound of the rate's error without the noise, (18.9): what does not average out.

        Parameters
        ----------
        angular_speeds : (...) array
            Norms of measured rates, rad/s.
        elapsed : (...) array
            Time since the bias was known, s.

        Returns
        -------
        (...) array
            rad/s.
        """
        bias = self.bias + self.drift * np.asarray(elapsed, dtype=np.float64)
        speeds = np.asarray(angular_speeds, dtype=np.float64)
        steady: FloatArray = bias + self.scale_error * (speeds + bias + self.noise) / (1.0 - self.scale_error)
        return steady

    def rate_error(self, angular_speeds: ArrayLike, elapsed: ArrayLike = 0.0) -> FloatArray:
        """Bound of the rate's error at an instant, (18.9): over a step h it turns a prediction by at most h times this.

        Parameters
        ----------
        angular_speeds : (...) array
            Norms of measured rates, rad/s.
        elapsed : (...) array
            Time since the bias was known, s.

        Returns
        -------
        (...) array
            rad/s.
        """
        return self.noise + self.steady_error(angular_speeds, elapsed)

    def window_angle(self, times: ArrayLike, angular_velocities: ArrayLike, elapsed: ArrayLike = 0.0) -> float:
        """Bound of the angle by which the turn over all rows is off, (18.10).

        Parameters
        ----------
        times : (N,) array
            s, increasing.
        angular_velocities : (N, 3) array
            Measured, rad/s.
        elapsed : (N,) array
            Time since the bias was known, s.

        Returns
        -------
        float
            rad.
        """
        stamps, rates = _times(times), _rows("angular_velocities", angular_velocities, len(np.atleast_1d(times)))
        speeds = np.linalg.norm(rates, axis=1)
        duration = stamps[-1] - stamps[0]
        return float(
            self._noise_angle(duration, np.trapezoid(speeds, stamps), duration)
            + np.trapezoid(self.steady_error(speeds, elapsed), stamps)
        )

    def noise_rate(self, duration: float, turned: float) -> float:
        """The noise bound to give to one prediction that spans a window, (18.10), rad/s.

        Parameters
        ----------
        duration : float
            Of the window, s.
        turned : float
            The angle that the measured rate turned in it, rad.

        Returns
        -------
        float
        """
        if not duration > 0.0:
            raise ValueError(f"duration must be positive, not {duration}")
        return float(self._noise_angle(duration, turned, duration)) / duration

    def anchored_turns(self, times: ArrayLike, angular_velocities: ArrayLike, duration: float) -> "AnchoredTurns":
        """Predictions that span a window, so that the increment bound is worth something, (18.12).

        Every row is reached from an anchor, the last one before it of rows about ``duration`` apart.

        Parameters
        ----------
        times : (N,) array
            s, increasing; the bias was known at the first.
        angular_velocities : (N, 3) array
            Measured, the known bias subtracted, rad/s.
        duration : float
            Between anchors, s.

        Returns
        -------
        AnchoredTurns
        """
        stamps = _times(times)
        rates = _rows("angular_velocities", angular_velocities, len(stamps))
        if not 0.0 < duration < np.inf:
            raise ValueError(f"duration must be positive and finite, not {duration}")
        anchors = np.zeros(len(stamps), dtype=np.intp)
        mean_rates, noise = np.zeros((len(stamps), 3)), np.zeros(len(stamps))
        angles = np.zeros(len(stamps))
        anchor = 0
        while anchor < len(stamps) - 1:
            following = int(np.searchsorted(stamps, stamps[anchor] + duration * (1.0 + 1e-9), side="right")) - 1
            piece = slice(anchor, max(following, anchor + 1) + 1)
            spans = stamps[piece] - stamps[anchor]
            speeds = np.linalg.norm(rates[piece], axis=1)
            elapsed, turned = stamps[piece] - stamps[0], _running_integral(spans, speeds)
            errors = _running_integral(spans, self.steady_error(speeds, elapsed))
            errors += self._noise_angle(spans, turned, spans)
            quaternions = quaternions_from_rates(np.diff(spans), rates[piece])
            turns = _rotation_vectors(quaternions)
            by_matrix = _running_integral(spans, _scale_effects(rotations_from_quaternions(quaternions), rates[piece]))
            errors = np.minimum(errors, self._angle_with_one_matrix(spans, elapsed, turned, by_matrix))
            # Rotations within an angle of one another have rotation vectors that differ by more, (18.12).
            half = np.minimum(0.5 * (np.linalg.norm(turns, axis=1) + errors), np.pi)
            rows = slice(anchor + 1, piece.stop)
            anchors[rows], angles[rows] = anchor, errors[1:]
            mean_rates[rows] = turns[1:] / spans[1:, None]
            noise[rows] = errors[1:] / np.sinc(half[1:] / np.pi) / spans[1:]
            anchor = piece.stop - 1
        return AnchoredTurns(anchors, mean_rates, noise, angles)

    def _angle_with_one_matrix(
        self, spans: FloatArray, elapsed: FloatArray, turned: FloatArray, by_matrix: FloatArray
    ) -> FloatArray:
        """Bound of the angle, (18.13): the scale error of the turn back undoes that of the turn there."""
        # ω̃ - ω = K' ω̃ + (I - K')(b + v), K' = K (I + K)⁻¹.
        scale, other = self.scale_error / (1.0 - self.scale_error), 1.0 / (1.0 - self.scale_error)
        of_scale = _SQRT3 * scale * _largest_stretch(by_matrix)
        of_noise = other * np.minimum(self.noise * spans, self.increment * (1.0 + turned))
        farthest = np.maximum.accumulate(of_scale + of_noise)
        second_order = 0.5 * farthest * (scale * turned + other * self.noise * spans)
        of_bias = other * _running_integral(spans, self.bias + self.drift * elapsed)
        angle: FloatArray = of_scale + of_noise + second_order + of_bias
        return angle

    def _noise_angle(self, duration: FloatArray | float, turned: FloatArray | float, longest: float) -> FloatArray:
        """Either of two bounds, the smaller: linear in time, or from the increment."""
        linear = self.noise * np.asarray(duration, dtype=np.float64)
        if np.isinf(self.increment):
            return linear
        return np.minimum(linear, self._increment_angle(turned, longest))

    def _increment_angle(self, turned: FloatArray | float, longest: FloatArray | float) -> FloatArray:
        swept = self.increment * (1.0 + np.asarray(turned, dtype=np.float64))
        angle: FloatArray = swept * (1.0 + 0.5 * self.noise * np.asarray(longest, dtype=np.float64))
        return angle


@dataclass(frozen=True, eq=False)
class AnchoredTurns:
    """How each row's attitude follows from that of an earlier row, its anchor."""

    anchors: NDArray[np.intp]
    """Row of the anchor, shape (N,); 0 for the first row, which is its own."""
    rates: FloatArray
    """The constant rate that turns the anchor's attitude into the row's, rad/s, shape (N, 3), at most pi in all."""
    noise: FloatArray
    """Bound of that rate's error, bias included, rad/s, shape (N,); enormous where the turn may be a whole one."""
    angles: FloatArray
    """Bound of the angle between this turn and the true one, rad, shape (N,)."""


@dataclass(frozen=True)
class MotionBounds:
    """How the sensor's place moves; what is not known is infinite.

    Parameters
    ----------
    velocity : float
        Bound of the speed at every instant, m/s. In any frame that does not accelerate.
    position : float
        Radius of a ball that the sensor does not leave during a window, m; the ball may be another for another window.
    acceleration : float
        Bound of the linear acceleration at every instant, m/s².
    """

    velocity: float = np.inf
    position: float = np.inf
    acceleration: float = np.inf

    def __post_init__(self) -> None:
        """Check."""
        for name in ("velocity", "position", "acceleration"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must be at least 0, not {getattr(self, name)}")

    def mean_acceleration_uniform(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Bound of the mean acceleration over [-before, after], (18.5), m/s²."""
        return np.minimum(self.acceleration, 2.0 * self.velocity / (before + after))

    def mean_acceleration_triangular(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Bound of the mean weighted by a triangle over [-before, after] with its top at 0, (18.6), m/s²."""
        from_velocity = 4.0 * self.velocity / (before + after)
        from_position = 4.0 * self.position / (before * after)
        return np.minimum(self.acceleration, np.minimum(from_velocity, from_position))


# --- one sample -------------------------------------------------------------------------------------------------------


def angle_to_center(
    lengths: ArrayLike, magnitude: ArrayLike, radius: ArrayLike, magnitude_error: ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Largest angle between x and y where ‖x - y‖ ≤ radius, ‖y‖ = lengths and ‖x‖ within magnitude ± error, (18.2).

    Parameters
    ----------
    lengths : (...) array
        ‖y‖, at least 0. NaN: not measured.
    magnitude : (...) array
        Of x, positive.
    radius : (...) array
        At least 0.
    magnitude_error : (...) array
        At least 0, below the magnitude.

    Returns
    -------
    angles : (...) array
        rad, at most pi. NaN where not measured or where no x exists.
    excess : (...) array
        0 where an x exists; else by how much the radius falls short.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    y, m, r, dm = np.broadcast_arrays(
        *(np.asarray(array, dtype=np.float64) for array in (lengths, magnitude, radius, magnitude_error))
    )
    if np.any(y < 0.0):
        raise ValueError(f"lengths must be at least 0, not {np.nanmin(y)}")
    if not np.all(r >= 0.0):
        raise ValueError("radius must be at least 0 and a number")
    if not np.all((dm >= 0.0) & (dm < m) & np.isfinite(m)):
        raise ValueError("magnitude must be finite and positive, and magnitude_error from 0 to below it")
    least, greatest = m - dm, m + dm
    r = _rounded_up(r, y, greatest)
    excess = _excess(y, least, greatest, r)
    # The angle is largest where x is tangent to the ball, or at the end of the range of ‖x‖ next to that.
    tangent = np.sqrt(np.maximum((y - r) * (y + r), 0.0))
    x = np.clip(tangent, least, greatest)
    difference = np.abs(y - x)
    with np.errstate(invalid="ignore", divide="ignore"):
        squared_sine = (r - difference) * (r + difference) / (4.0 * x * y)
    squared_sine = np.where((y == 0.0) | np.isinf(r), 1.0, squared_sine)
    angles = 2.0 * np.arcsin(np.sqrt(np.clip(squared_sine, 0.0, 1.0)))
    return np.where(np.isnan(y) | (excess > 0.0), np.nan, angles), excess


def _rounded_up(radius: FloatArray, lengths: FloatArray, magnitude: FloatArray | float) -> FloatArray:
    """The radius with what rounding may have done to the lengths."""
    rounded: FloatArray = radius + 4.0 * _EPSILON * (lengths + magnitude)
    return rounded


def _excess(
    lengths: FloatArray, least: FloatArray | float, greatest: FloatArray | float, radius: FloatArray
) -> FloatArray:
    """By how much a radius is too small for any length from least to greatest; 0 where it is not."""
    excess: FloatArray = np.fmax(np.maximum(lengths - greatest, least - lengths) - radius, 0.0)
    return excess


def _bounded_directions(
    vectors: FloatArray,
    radii: ArrayLike,
    magnitude: ArrayLike,
    magnitude_error: ArrayLike,
    stretch: float,
    added_angle: FloatArray | float,
) -> DirectionBounds:
    """Directions of vectors y, where the true vector lies within ``radii`` of ``stretch`` y."""
    lengths = np.linalg.norm(vectors, axis=1)
    angles, excess = angle_to_center(
        stretch * lengths, magnitude, np.where(np.isnan(lengths), 0.0, radii), magnitude_error
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        directions = vectors / lengths[:, None]
    angles = np.minimum(angles + added_angle, np.pi)
    return DirectionBounds(directions, np.where(lengths > 0.0, angles, np.nan), excess)


def _sensor_ball(lengths: FloatArray, sensor: VectorSensorBounds) -> tuple[float, FloatArray]:
    """The ball that holds the true vector of a measured one y, (18.3): about ``stretch`` y, and its radius."""
    k = sensor.scale_error
    return 1.0 / (1.0 - k * k), k * lengths / (1.0 - k * k) + sensor.error / (1.0 - k)


def accelerometer_bounds(
    specific_forces: ArrayLike,
    acceleration: ArrayLike,
    *,
    gravity: ArrayLike = STANDARD_GRAVITY,
    gravity_error: ArrayLike = 0.0,
    sensor: VectorSensorBounds = VectorSensorBounds(),
    time_offset: ArrayLike = 0.0,
) -> DirectionBounds:
    """How far each sample's direction may be from up, where the linear acceleration is bounded, (18.1) to (18.3).

    Parameters
    ----------
    specific_forces : (N, 3) array
        m/s², body axes; at rest it points up. A row with NaN was not measured.
    acceleration : float or (N,) array
        Bound α of the linear acceleration, m/s².
    gravity, gravity_error : float or (N,) array
        m/s².
    sensor : VectorSensorBounds
        The accelerometer's own errors.
    time_offset : float or (N,) array
        What `time_offset_angles` gives, rad.

    Returns
    -------
    DirectionBounds
        Of the direction up. A row whose norm differs from gravity by more than the bounds allow is contradicted.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    return _of_samples("specific_forces", specific_forces, acceleration, gravity, gravity_error, sensor, time_offset)


def magnetometer_bounds(
    fields: ArrayLike,
    disturbance: ArrayLike,
    *,
    strength: ArrayLike,
    strength_error: ArrayLike = 0.0,
    sensor: VectorSensorBounds = VectorSensorBounds(),
    time_offset: ArrayLike = 0.0,
) -> DirectionBounds:
    """How far each sample's direction may be from the reference field's, where the disturbance is bounded.

    The geometry is that of `accelerometer_bounds`: the field at the sensor is the reference field plus a vector of at
    most ``disturbance``. How far the reference vector itself may be off belongs there too, or, as far as only its
    length is in doubt, in ``strength_error``.

    Parameters
    ----------
    fields : (N, 3) array
        Body axes, any unit. A row with NaN was not measured.
    disturbance : float or (N,) array
        The fields' unit, as all below.
    strength, strength_error : float or (N,) array
        Length of the reference field.
    sensor : VectorSensorBounds
        The magnetometer's own errors: hard iron and noise are its error, soft iron and scale its scale error.
    time_offset : float or (N,) array
        What `time_offset_angles` gives, rad.

    Returns
    -------
    DirectionBounds
        Of the reference field's direction.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    return _of_samples("fields", fields, disturbance, strength, strength_error, sensor, time_offset)


def _of_samples(
    name: str,
    vectors: ArrayLike,
    offset: ArrayLike,
    magnitude: ArrayLike,
    magnitude_error: ArrayLike,
    sensor: VectorSensorBounds,
    time_offset: ArrayLike,
) -> DirectionBounds:
    rows = _rows(name, vectors)
    stretch, radii = _sensor_ball(np.linalg.norm(rows, axis=1), sensor)
    return _bounded_directions(
        rows,
        radii + np.asarray(offset, dtype=np.float64),
        magnitude,
        magnitude_error,
        stretch,
        sensor.misalignment + np.asarray(time_offset, dtype=np.float64),
    )


def angle_excess(first: DirectionBounds, second: DirectionBounds, angle: float, angle_error: float = 0.0) -> FloatArray:
    """By how much the measured angle between two directions contradicts their bounds, (18.4).

    With up and the magnetic field this is the test of the dip: the angle between up and the field is 90° plus the dip.

    Parameters
    ----------
    first, second : DirectionBounds
        N rows each.
    angle : float
        Between the two reference directions, rad.
    angle_error : float
        How far that may be off, rad.

    Returns
    -------
    (N,) array
        rad; positive proves that a bound is wrong, 0 where the two agree or one was not measured.
    """
    across = np.linalg.norm(np.cross(first.directions, second.directions), axis=1)
    along = np.einsum("ni,ni->n", first.directions, second.directions)
    measured = np.arctan2(across, along)
    excess: FloatArray = np.fmax(np.abs(measured - angle) - angle_error - first.angles - second.angles, 0.0)
    return excess


def cross_bounds(
    up: DirectionBounds, field: WindowBounds, reference: ArrayLike, *, in_plane_error: float
) -> DirectionBounds:
    """The direction of field × up: horizontal, and east if the horizontal field points north, (18.14).

    It says of the heading what the field says, without what is in doubt only in the plane of up and the field.

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
    _not_negative("in_plane_error", in_plane_error)
    if not in_plane_error < horizontal:
        raise ValueError(f"in_plane_error must be below the horizontal field {horizontal}, not {in_plane_error}")
    crossed = np.cross(field.lengths[:, None] * field.directions, up.directions)
    missing = np.isnan(up.angles) | np.isnan(field.angles)
    crossed[missing] = np.nan
    radii = field.radii - in_plane_error + 2.0 * (strength + in_plane_error) * np.sin(0.5 * up.angles)
    return _bounded_directions(crossed, radii, horizontal, in_plane_error, 1.0, 0.0)


# --- time -------------------------------------------------------------------------------------------------------------


def time_offset_angles(
    times: ArrayLike,
    angular_velocities: ArrayLike,
    offset: float,
    *,
    gyro: GyroBounds | None = None,
    angular_acceleration: float = 0.0,
) -> FloatArray:
    """How far a direction in body axes may turn between the time on the stamp and the true one, (18.8).

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    angular_velocities : (N, 3) array
        Measured, rad/s, body axes.
    offset : float
        Bound τ of the difference between stamp and true time, s.
    gyro : GyroBounds, optional
        Of the measured rates; exact if left out.
    angular_acceleration : float
        Bound between samples, rad/s². With 0 the rate between two samples is at most the larger of them.

    Returns
    -------
    (N,) array
        rad; NaN where a rate is missing near the row. Before the first and after the last row the rate counts as
        that of the row, changing by the angular acceleration.
    """
    _not_negative("offset", offset)
    _not_negative("angular_acceleration", angular_acceleration)
    stamps = _times(times)
    speeds = np.linalg.norm(_rows("angular_velocities", angular_velocities, len(stamps)), axis=1)
    if offset == 0.0:
        return np.zeros_like(stamps)
    if gyro is not None:
        speeds = speeds + gyro.rate_error(speeds)
    # The samples on both sides of the interval too: between two samples the rate is bounded by both.
    first = np.maximum(np.searchsorted(stamps, stamps - offset, side="right") - 1, 0)
    last = np.minimum(np.searchsorted(stamps, stamps + offset, side="left"), len(stamps) - 1)
    steps = np.append(np.diff(stamps), 0.0)
    between = 0.5 * angular_acceleration * np.maximum(_range_maximum(steps, first, last), offset)
    angles: FloatArray = np.minimum(offset * (_range_maximum(speeds, first, last) + between), np.pi)
    return angles


def _range_maximum(values: FloatArray, first: NDArray[np.intp], last: NDArray[np.intp]) -> FloatArray:
    """The largest of values[first..last], each: two overlapping powers of two make up any range."""
    counts = last - first + 1
    result = np.empty_like(values)
    table, width = values, 1
    while True:
        rows = (counts >= width) & (counts < 2 * width)
        result[rows] = np.maximum(table[first[rows]], table[last[rows] - width + 1])
        if counts.max() < 2 * width:
            return result
        table = np.maximum(table[:-width], table[width:])
        width *= 2


def shift(times: ArrayLike, values: ArrayLike, delay: float) -> tuple[FloatArray, FloatArray]:
    """Put late values where they belong: row n gets the values whose stamp is nearest to its time plus the delay.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    values : (N, ...) array
        With stamps ``times``, late by ``delay``: they show what was true at their stamp less the delay.
    delay : float
        s; negative where values are early.

    Returns
    -------
    shifted : (N, ...) array
        NaN where no value lies within the recording.
    left : (N,) array
        How far the chosen value's time is from the row's, s: to be added to the time offset bound.
    """
    stamps, numbers = _times(times), np.asarray(values, dtype=np.float64)
    wanted = stamps + delay
    after = np.clip(np.searchsorted(stamps, wanted), 1, max(len(stamps) - 1, 1))
    if len(stamps) == 1:
        nearest = np.zeros(1, dtype=np.intp)
    else:
        nearest = np.where(wanted - stamps[after - 1] <= stamps[after] - wanted, after - 1, after)
    left = np.abs(stamps[nearest] - wanted)
    shifted = numbers[nearest].copy()
    shifted[(wanted < stamps[0]) | (wanted > stamps[-1])] = np.nan
    return shifted, left


# --- windows ----------------------------------------------------------------------------------------------------------

Place = Literal["end", "middle"]
"""Where in its window a row lies."""


def gravity_bounds_over_windows(
    times: ArrayLike,
    specific_forces: ArrayLike,
    angular_velocities: ArrayLike,
    durations: Sequence[float],
    *,
    motion: MotionBounds,
    gyro: GyroBounds,
    sensor: VectorSensorBounds = VectorSensorBounds(),
    gravity: float = STANDARD_GRAVITY,
    gravity_error: float = 0.0,
    time_offset: float = 0.0,
    at: Place = "end",
    maximum_step: float = np.inf,
    every: int = 1,
) -> WindowBounds:
    """Up, from specific forces averaged over windows in a frame that the gyro carries along, (18.5) to (18.7).

    In the mean the linear acceleration is small where the speed or the place is bounded: 2v/T in a window of T with
    equal weights, 16p/T² with weights like a triangle. Against that stands the gyro's error over the window. All
    windows are tried and, row by row, the one with the smallest bound is returned; a row where any of them contradicts
    the bounds is contradicted.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    specific_forces : (N, 3) array
        m/s², body axes; at rest it points up. No window reaches over a row with NaN.
    angular_velocities : (N, 3) array
        rad/s, body axes, the bias known at the first row subtracted. The gyro's error is that of the rates used: in a
        step the mean of its ends.
    durations : sequence of float
        Of the windows, s. At the recording's ends they are as long as it allows.
    motion : MotionBounds
    gyro : GyroBounds
    sensor : VectorSensorBounds
        The accelerometer's.
    gravity, gravity_error : float
        m/s².
    time_offset : float
        Bound of the accelerometer's time against the gyro's, s.
    at : {"end", "middle"}
        ``"end"`` uses no later sample; ``"middle"`` halves the gyro's error, for a recording or a delay of T/2.
    maximum_step : float
        No window reaches over a longer step between rows, s.
    every : int
        Only each row whose index is a multiple of this gets a bound, which saves time; the others are not measured.

    Returns
    -------
    WindowBounds
        Of the direction up in body axes at each row.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    shapes = (motion.mean_acceleration_uniform, motion.mean_acceleration_triangular)
    return _over_windows(
        times, specific_forces, angular_velocities, durations, shapes, gyro, sensor, gravity, gravity_error,
        time_offset, at, maximum_step, every,
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
    sensor: VectorSensorBounds = VectorSensorBounds(),
    time_offset: float = 0.0,
    at: Place = "end",
    maximum_step: float = np.inf,
    every: int = 1,
) -> WindowBounds:
    """The reference field's direction, averaged over windows in a frame that the gyro carries along.

    A disturbance does not average out, noise does: this is worth its price where the sensor's ``averaged_error`` is
    well below its ``error``. Arguments are those of `gravity_bounds_over_windows` and `magnetometer_bounds`.

    Returns
    -------
    WindowBounds
        Of the reference field's direction in body axes at each row.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    _not_negative("disturbance", disturbance)

    def constant(before: FloatArray, after: FloatArray) -> FloatArray:
        return np.full_like(before, disturbance)

    return _over_windows(
        times, fields, angular_velocities, durations, (constant,), gyro, sensor, strength, strength_error,
        time_offset, at, maximum_step, every,
    )  # fmt: skip


MeanOffset = Callable[[FloatArray, FloatArray], FloatArray]


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
    time_offset: float,
    at: Place,
    maximum_step: float,
    every: int,
) -> WindowBounds:
    """The offsets are those of equal weights and, if there is a second one, of weights like a triangle."""
    stamps = _times(times)
    count = len(stamps)
    rows, rates = _rows("vectors", vectors, count), _rows("angular_velocities", angular_velocities, count)
    if not len(durations) or not all(np.isfinite(duration) and duration > 0.0 for duration in durations):
        raise ValueError(f"durations must be positive and finite, not {list(durations)}")
    if at not in ("end", "middle"):
        raise ValueError(f"at must be 'end' or 'middle', not {at!r}")
    if every < 1:
        raise ValueError(f"every must be at least 1, not {every}")
    turned_by_offset = time_offset_angles(stamps, rates, time_offset, gyro=gyro)

    means, radii = np.full((count, 3), np.nan), np.full(count, np.inf)
    best, excess = np.full(count, np.nan), np.zeros(count)
    # A scale error and a misalignment act on every sample: k (‖f‖ + e) in the mean, where ‖f‖ is measured.
    scale = sensor.scale_error + 2.0 * np.sin(0.5 * min(sensor.misalignment, np.pi))
    if scale >= 1.0:
        raise ValueError(f"misalignment and scale_error leave nothing of the sensor: {scale} of its length")
    mean_error = sensor.error if sensor.averaged_error is None else sensor.averaged_error
    least, greatest = magnitude - magnitude_error, magnitude + magnitude_error
    for block, needed in _blocks(stamps, max(durations), at):
        piece = _Piece(
            stamps[needed], rows[needed], rates[needed], turned_by_offset[needed], gyro, stamps[0], maximum_step
        )
        wanted = np.arange(-(-block.start // every) * every, block.stop, every)
        here = wanted - needed.start
        for duration in durations:
            window = piece.window(here, duration, at)
            span = window.before + window.after
            for average, offset in zip(piece.averages(window, triangular=len(offsets) > 1), offsets, strict=True):
                with np.errstate(invalid="ignore", divide="ignore"):
                    radius = average.turn + mean_error + scale * (average.length + sensor.error) / (1.0 - scale)
                    radius += offset(window.before, window.after)
                lengths = np.linalg.norm(average.mean, axis=1)
                # NaN where there is no window: no excess, and not better.
                excess[wanted] = np.maximum(
                    excess[wanted], _excess(lengths, least, greatest, _rounded_up(radius, lengths, greatest))
                )
                better = radius <= radii[wanted]
                target = wanted[better]
                means[target], radii[target], best[target] = average.mean[better], radius[better], span[better]
        # From the common frame to the body axes of each row.
        means[wanted] = np.einsum("nji,nj->ni", piece.attitudes[here], means[wanted])
    found = _bounded_directions(means, radii, magnitude, magnitude_error, 1.0, 0.0)
    excess = np.maximum(excess, found.excess)
    angles = np.where(excess > 0.0, np.nan, found.angles)
    return WindowBounds(found.directions, angles, excess, best, np.linalg.norm(means, axis=1), radii)


def _blocks(times: FloatArray, longest: float, at: Place) -> Iterator[tuple[slice, slice]]:
    """Rows in pieces, each with the rows that its windows reach: memory stays bounded, and so do running sums."""
    for start in range(0, len(times), _BLOCK_ROWS):
        stop = min(start + _BLOCK_ROWS, len(times))
        reach = longest * (1.0 + 1e-6)
        before, after = (0.5 * reach, 0.5 * reach) if at == "middle" else (reach, 0.0)
        first = int(np.searchsorted(times, times[start] - before))
        last = int(np.searchsorted(times, times[stop - 1] + after, side="right"))
        yield slice(start, stop), slice(first, last)


@dataclass(frozen=True, eq=False)
class _Window:
    """Indices of windows: where they begin, the top of a triangle, where they end, and the row that they are for."""

    start: NDArray[np.intp]
    top: NDArray[np.intp]
    stop: NDArray[np.intp]
    row: NDArray[np.intp]
    before: FloatArray
    """From the beginning to the top, s; NaN where the window is not whole."""
    after: FloatArray
    """From the top to the end, s."""


@dataclass(frozen=True, eq=False)
class _Average:
    """Weighted means over windows."""

    mean: FloatArray
    """Of the vector, in the common frame."""
    length: FloatArray
    """Of the vectors' lengths."""
    turn: FloatArray
    """Of the lengths times the bound of the turn's error between sample and row."""


class _Piece:
    """Running integrals of a piece of a recording, from which weighted means over windows are differences."""

    def __init__(
        self,
        times: FloatArray,
        vectors: FloatArray,
        rates: FloatArray,
        turned_by_offset: FloatArray,
        gyro: GyroBounds,
        bias_known: float,
        maximum_step: float,
    ) -> None:
        self._times = times
        self._gyro = gyro
        missing = np.isnan(vectors).any(axis=1) | np.isnan(rates).any(axis=1) | np.isnan(turned_by_offset)
        vectors, rates = np.where(missing[:, None], 0.0, vectors), np.where(missing[:, None], 0.0, rates)
        steps = np.diff(times)
        self._missing_rows = np.concatenate([[0], np.cumsum(missing)])
        self._long_steps = np.concatenate([[0], np.cumsum(steps > maximum_step)])
        self.attitudes = attitudes_from_rates(steps, rates)
        self._elapsed = times - times[0]
        speeds = np.linalg.norm(rates, axis=1)
        lengths = np.linalg.norm(vectors, axis=1)
        self._steady = _running_integral(times, gyro.steady_error(speeds, times - bias_known))
        self._turned = _running_integral(times, speeds)
        in_common_frame = np.einsum("nij,nj->ni", self.attitudes, vectors)
        # Columns: the vector, ‖f‖, and ‖f‖ times what bounds its turn: steady error, angle turned, time, offset.
        weights = lengths[:, None] * np.column_stack(
            [
                np.ones_like(times),
                self._steady,
                self._turned,
                self._elapsed,
                np.where(missing, 0.0, turned_by_offset),
            ]
        )
        self._once = _running_integral(times, np.column_stack([in_common_frame, weights]))
        self._twice = _running_integral(times, self._once)

    def window(self, rows: NDArray[np.intp], duration: float, at: Place) -> _Window:
        times, here = self._times, self._times[rows]
        slack = 1e-9 * duration
        if at == "middle":
            start = np.searchsorted(times, here - 0.5 * duration - slack)
            stop = np.searchsorted(times, here + 0.5 * duration + slack, side="right") - 1
            top = rows
        else:
            start, stop = np.searchsorted(times, here - duration - slack), rows
            middle = 0.5 * (times[start] + times[stop])
            top = np.searchsorted(times, middle)
        missing = self._missing_rows[stop + 1] - self._missing_rows[start]
        long_steps = self._long_steps[stop] - self._long_steps[start]
        whole = (stop > start) & (missing == 0) & (long_steps == 0)
        before = np.where(whole, times[top] - times[start], np.nan)
        return _Window(start, top, stop, rows, before, times[stop] - times[top])

    def averages(self, window: _Window, *, triangular: bool) -> Iterator[_Average]:
        """With equal weights, then with those of a triangle."""
        before, after = window.before[:, None], window.after[:, None]
        span = before + after
        once = self._once[window.top]
        below, above = once - self._once[window.start], self._once[window.stop] - once
        yield self._average(window, below / span, above / span)
        if triangular:
            twice = self._twice[window.top]
            with np.errstate(invalid="ignore", divide="ignore"):
                below = once - (twice - self._twice[window.start]) / before
                above = (self._twice[window.stop] - twice) / after - once
            yield self._average(window, 2.0 * below / span, 2.0 * above / span)

    def _average(self, window: _Window, rising: FloatArray, falling: FloatArray) -> _Average:
        both = rising + falling
        row, at_top = window.row, window.row == window.top

        # The mean of ‖f‖ times the steady error, angle or time between each sample and the row. The row is at the top
        # or at the end, so that each side of the top lies on one side of the row.
        def between(column: int, running: FloatArray) -> FloatArray:
            at_row = running[row]
            before_row = at_row * rising[:, 3] - rising[:, column]
            after_row = falling[:, column] - at_row * falling[:, 3]
            return np.maximum(before_row + np.where(at_top, after_row, -after_row), 0.0)

        noise = self._gyro.noise * between(6, self._elapsed)
        if np.isfinite(self._gyro.increment):
            longest = np.where(at_top, np.maximum(window.before, window.after), window.before + window.after)
            swept = self._gyro.increment * (both[:, 3] + between(5, self._turned))
            noise = np.minimum(noise, swept * (1.0 + 0.5 * self._gyro.noise * longest))
        return _Average(both[:, :3], both[:, 3], between(4, self._steady) + noise + both[:, 7])


def _running_integral(times: FloatArray, values: FloatArray) -> FloatArray:
    """By the trapezoidal rule, along the first axis."""
    steps = np.diff(times).reshape(-1, *(1,) * (values.ndim - 1))
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(0.5 * steps * (values[1:] + values[:-1]), axis=0)])


def attitudes_from_rates(steps: FloatArray, rates: FloatArray) -> FloatArray:
    """Attitudes from the first row's body axes, the rate in a step the mean of its ends.

    Parameters
    ----------
    steps : (N - 1,) array
        s.
    rates : (N, 3) array
        rad/s, body axes.

    Returns
    -------
    (N, 3, 3) array
        From each row's body axes to those of the first.
    """
    return rotations_from_quaternions(quaternions_from_rates(steps, rates))


def rotations_from_quaternions(quaternions: FloatArray) -> FloatArray:
    """Rotation matrices (N, 3, 3) of unit quaternions (qw, qx, qy, qz)."""
    w, x, y, z = quaternions.T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )


def _scale_effects(attitudes: FloatArray, rates: FloatArray) -> FloatArray:
    """The matrices (N, 3, 9) that take the entries of K' to C K' ω."""
    effects: FloatArray = attitudes[:, :, :, None] * rates[:, None, None, :]
    return effects.reshape(-1, 3, 9)


def _largest_stretch(matrices: FloatArray) -> FloatArray:
    """Largest singular values of matrices (N, 3, 9); NaN where an entry is."""
    squares = matrices @ matrices.transpose(0, 2, 1)
    missing = np.isnan(np.einsum("nii->n", squares))
    values = np.linalg.eigvalsh(np.where(missing[:, None, None], 0.0, squares))[:, -1]
    return np.where(missing, np.nan, np.sqrt(np.maximum(values, 0.0)))


def quaternions_from_rates(steps: FloatArray, rates: FloatArray) -> FloatArray:
    """What `attitudes_from_rates` gives, as quaternions (qw, qx, qy, qz), shape (N, 4)."""
    turns = 0.5 * steps[:, None] * (rates[1:] + rates[:-1])
    angles = np.linalg.norm(turns, axis=1)
    quaternions = np.zeros((len(rates), 4))
    quaternions[0, 0] = 1.0
    quaternions[1:, 0] = np.cos(0.5 * angles)
    quaternions[1:, 1:] = 0.5 * np.sinc(angles / (2.0 * np.pi))[:, None] * turns
    # Products of all that came before: along the rows of a square first, then down its last column.
    width = math.isqrt(len(rates) - 1) + 1
    padding = np.zeros((-len(rates) % width, 4))
    square = np.concatenate([quaternions, padding]).reshape(-1, width, 4)
    for column in range(1, width):
        square[:, column] = _quaternion_product(square[:, column - 1], square[:, column])
    for row in range(1, len(square)):
        square[row] = _quaternion_product(square[row - 1, -1:], square[row])
    products = square.reshape(-1, 4)[: len(rates)]
    unit: FloatArray = products / np.linalg.norm(products, axis=1)[:, None]
    return unit


def _rotation_vectors(quaternions: FloatArray) -> FloatArray:
    """Of the shorter way round."""
    signs = np.where(quaternions[:, :1] < 0.0, -1.0, 1.0)
    vectors = signs * quaternions[:, 1:]
    sines = np.linalg.norm(vectors, axis=1)
    angles = 2.0 * np.arctan2(sines, np.abs(quaternions[:, 0]))
    factors = np.where(sines > 0.0, angles / np.where(sines > 0.0, sines, 1.0), 2.0)
    return factors[:, None] * vectors


def _quaternion_product(a: FloatArray, b: FloatArray) -> FloatArray:
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=1,
    )
