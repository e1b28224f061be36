"""Bounds of measured directions, from what is known about sensors and motion.

A datasheet, the speed of a hand, the size of a room: such knowledge becomes the angle that each measured direction may
be off: from single samples here, from averages over windows in `elliptude.bounds.windows`. Bounds of a gyro are in
`elliptude.bounds.gyro`, of time stamps in `elliptude.bounds.stamps`. Needs only NumPy; SI units and radians; rows
are instants. Derivations and proofs: docs/theory.md, section 18.

Nothing is clipped silently. If data and stated bounds contradict each other, the row's angle is NaN (not measured)
and its `DirectionBounds.excess` says by how much; if a bound says nothing, the angle is pi.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.arguments import require_fraction, require_not_negative, vector_rows
from elliptude.typing import FloatArray
from elliptude.units import STANDARD_GRAVITY

_EPSILON = float(np.finfo(np.float64).eps)


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


AVERAGED_OVER_S = 0.5
"""The shortest window, s, that configurations and rules state the error of a mean for, if they say no other."""


@dataclass(frozen=True)
class VectorSensorBounds:
    """How far an accelerometer or magnetometer may be off: it shows (I + K) x + e instead of the true vector x.

    Parameters
    ----------
    error : float
        Bound of ‖e‖ for each sample: bias, noise, hard iron; the sensor's unit.
    scale_error : float
        Bound of the spectral norm of K: scale, soft iron, axes not perpendicular; from 0 to below 1.
    misalignment : float
        Bound of the angle between its axes and the body's (the gyro's), rad.
    averaged_error : float, optional
        Bound of ‖e‖ averaged over a window, turned into a common frame; ``error`` if left out. It may be smaller, as
        noise averages out. It also covers sampling: the mean of the samples less that of the motion between them.
    averaged_over : float
        The shortest window that ``averaged_error`` is stated for, with equal weights, s.
    """

    error: float = 0.0
    scale_error: float = 0.0
    misalignment: float = 0.0
    averaged_error: float | None = None
    averaged_over: float = 0.0

    def __post_init__(self) -> None:
        """Check."""
        require_not_negative("averaged_over", self.averaged_over)
        require_not_negative("error", self.error)
        require_not_negative("misalignment", self.misalignment)
        require_fraction("scale_error", self.scale_error)
        if self.averaged_error is not None:
            require_not_negative("averaged_error", self.averaged_error)

    def mean_error(self, durations: ArrayLike, skews: ArrayLike | None = None) -> FloatArray:
        """Bound of the mean error over windows of these lengths, as the function `mean_error`."""
        averaged = self.error if self.averaged_error is None else self.averaged_error
        return mean_error(self.error, averaged, self.averaged_over, durations, skews)

    def mean_error_across_gaps(self, peaks: ArrayLike, gaps: ArrayLike, lost: ArrayLike) -> FloatArray:
        """Bound of the mean error over windows that reach across gaps between samples, (18.53).

        Parameters
        ----------
        peaks : (...) array
            The largest weight, 1/s; the weights rise to it and fall, or are equal.
        gaps : (...) array
            How many gaps there are in the window.
        lost : (...) array
            How long they are together, s.

        Returns
        -------
        (...) array
            Of the mean of what was sampled, in which a gap's value is on the line between the samples around it.
        """
        peaks, gaps, lost = (np.asarray(array, dtype=np.float64) for array in (peaks, gaps, lost))
        if self.averaged_error is None or self.averaged_error >= self.error:
            return np.full(peaks.shape, self.error if self.averaged_error is None else self.averaged_error)
        # What pieces, each too short for a mean, may add to the mean's bound times the length of all.
        short = self.averaged_over * (self.error**2 - self.averaged_error**2) / (2.0 * self.error)
        more = (gaps + 1.0) * short + lost * (self.error - self.averaged_error)
        bound: FloatArray = np.minimum(self.error, self.averaged_error + peaks * more)
        return bound


def mean_error(
    error: float, averaged: float, averaged_over: float, durations: ArrayLike, skews: ArrayLike | None = None
) -> FloatArray:
    """Bound of a mean over windows, from that of a sample and that of means over windows that are no shorter, (18.51).

    A shorter window is a part of such a one. A triangle is a mixture of windows with equal weights about its top, short
    ones too; and, if its sides are equal, of windows that are half as long as it.

    Parameters
    ----------
    error : float
        ε, of each sample.
    averaged : float
        Of the mean, with equal weights, over any window of ``averaged_over`` or more.
    averaged_over : float
        T₀, s.
    durations : (...) array
        s; NaN where there is no window.
    skews : (...) array, optional
        For weights that rise to a top within the window and fall to its ends, on lines: how much longer one side is
        than the other, s. For equal weights it is left out.

    Returns
    -------
    (...) array
    """
    lengths = np.asarray(durations, dtype=np.float64)
    if averaged >= error or averaged_over == 0.0:  # it may cover sampling, which no sample's own bound does
        return np.where(np.isnan(lengths), np.nan, averaged)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        ratio = averaged_over / lengths
        if skews is None:
            return np.where(ratio <= 1.0, averaged, np.minimum(error, ratio * (averaged + error) - error))
        # The part of the mixture that is so short that a sample's bound is as good.
        short = ratio * (averaged + error) / (2.0 * error)
        between = 2.0 * ratio * (averaged + error) - error - 2.0 * error * short**2
        long = averaged + ratio**2 * (error - averaged) * (error + averaged) / (2.0 * error)
        about_top: FloatArray = np.where(ratio <= 1.0, long, np.where(short < 1.0, between, error))
        as_halves = np.where(ratio <= 0.5, averaged + error * np.abs(skews) / lengths, np.inf)
        return np.where(np.isnan(lengths), np.nan, np.minimum(about_top, as_halves))


EXACT_SENSOR = VectorSensorBounds()


# --- one sample -------------------------------------------------------------------------------------------------------


def angle_to_center(
    lengths: ArrayLike, magnitude: ArrayLike, radius: ArrayLike, magnitude_error: ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Largest angle between x and y if ‖x - y‖ ≤ radius, ‖y‖ = lengths and ‖x‖ is within magnitude ± error, (18.2).

    Parameters
    ----------
    lengths : (...) array
        ‖y‖, at least 0. NaN: not measured.
    magnitude : (...) array
        ‖x‖, positive.
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
    excess = radius_excess(y, least, greatest, rounded_up(r, y, greatest))
    # In a unit that is about the magnitude squares neither grow nor vanish; powers of two change no digit.
    exponent = -np.frexp(m)[1]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        y, r, least, greatest = (np.ldexp(length, exponent) for length in (y, r, least, greatest))
        r = rounded_up(r, y, greatest)
        # The angle is largest where x is tangent to the ball, or at the end of the range of ‖x‖ next to that.
        tangent = np.sqrt(np.maximum((y - r) * (y + r), 0.0))
        x = np.clip(tangent, least, greatest)
        difference = np.abs(y - x)
        squared_sine = (r - difference) * (r + difference) / (4.0 * x * y)
    squared_sine = np.where((y == 0.0) | np.isinf(r), 1.0, squared_sine)
    angles = 2.0 * np.arcsin(np.sqrt(np.clip(squared_sine, 0.0, 1.0)))
    return np.where(np.isnan(y) | (excess > 0.0), np.nan, angles), excess


def rounded_up(radius: FloatArray, lengths: FloatArray, magnitude: FloatArray | float) -> FloatArray:
    """The radius, enlarged by what rounding may have done to the lengths."""
    rounded: FloatArray = radius + 4.0 * _EPSILON * (lengths + magnitude)
    return rounded


def radius_excess(
    lengths: FloatArray, least: FloatArray | float, greatest: FloatArray | float, radius: FloatArray
) -> FloatArray:
    """By how much a radius is too small for any length from least to greatest; 0 where it is not."""
    excess: FloatArray = np.fmax(np.maximum(lengths - greatest, least - lengths) - radius, 0.0)
    return excess


def bounded_directions(
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
    sensor: VectorSensorBounds = EXACT_SENSOR,
    time_offset: ArrayLike = 0.0,
) -> DirectionBounds:
    """How far each sample's direction may be from up if the linear acceleration is bounded, (18.1) to (18.3).

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
        What `time_offset_angles` returns, rad.

    Returns
    -------
    DirectionBounds
        Bounds of the direction up. A row whose norm differs from gravity by more than they allow is contradicted.

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
    sensor: VectorSensorBounds = EXACT_SENSOR,
    time_offset: ArrayLike = 0.0,
) -> DirectionBounds:
    """How far each sample's direction may be from the reference field's if the disturbance is bounded.

    The geometry is that of `accelerometer_bounds`: the field at the sensor is the reference field plus a vector of at
    most ``disturbance``. This includes how far the reference vector itself may be off; if only its
    length is in doubt, that belongs in ``strength_error``.

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
        What `time_offset_angles` returns, rad.

    Returns
    -------
    DirectionBounds
        The bounds of the reference field's direction.

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
    rows = vector_rows(name, vectors)
    stretch, radii = _sensor_ball(np.linalg.norm(rows, axis=1), sensor)
    return bounded_directions(
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
