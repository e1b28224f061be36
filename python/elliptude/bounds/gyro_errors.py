"""How far a gyro may be off, at an instant, in a gap, and by noise that adds up.

Needs only NumPy; SI units and radians; rows are instants. Derivations and proofs: docs/theory.md, section 18.4.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.arguments import require_fraction, require_not_negative
from elliptude.bounds.turns import (
    lengths_of,
)
from elliptude.typing import FloatArray

# A set of points none of which are further apart than one is in a ball of this radius (Jung's theorem).
_RADIUS_OF_SET = math.sqrt(3.0 / 8.0)
TIMES_USUAL = 1.5
"""A gap is longer than this times the usual interval: one lost sample exceeds it, the ticks of a clock do not."""


_ROUNDED = 1e-9
_UNITS_OF_STAMPS = 4.0


def with_rounding(longest: float, times: FloatArray) -> float:
    """A longest interval, s, and what rounding of stamps and of their differences may add to one of that length.

    What is longer is a gap. Python and the core compare with this number, so that they agree.

    Parameters
    ----------
    longest : float
        s.
    times : (N,) array
        The stamps that intervals are between, s.
    """
    largest = float(np.abs(times[np.isfinite(times)]).max(initial=0.0))
    return longest * (1.0 + _ROUNDED) + _UNITS_OF_STAMPS * float(np.spacing(largest))


def usual_longest(intervals: FloatArray) -> float:
    """The longest interval that bounds cover for which none is stated, s; infinite without intervals."""
    return TIMES_USUAL * float(np.median(intervals)) if len(intervals) else np.inf


def covered_interval(times: FloatArray, stated: float | None) -> float:
    """The longest interval that a gyro's error bounds cover, `with_rounding`, s.

    Parameters
    ----------
    times : (N,) array
        Of its samples, s, increasing.
    stated : float or None
        What a configuration or a rule states. If None, bounds hold for the usual interval, and 1.5 times the median is
        the longest.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        If most of the intervals are longer than what is stated.
    """
    intervals = np.diff(times)
    if stated is None:
        return with_rounding(usual_longest(intervals), times)
    longest = with_rounding(stated, times)
    usual = float(np.median(intervals)) if len(intervals) else 0.0
    if usual > longest:
        raise ValueError(
            f"the gyro's samples are {usual:.6g} s apart, but its error bounds speak of at most {stated:.6g} s "
            "(longest_interval_s): state bounds that hold between these samples"
        )
    return longest


@dataclass(frozen=True)
class GyroErrors:
    """How far a gyro may be off: it shows (I + K) ω + b + v. Section 18.4.

    Parameters
    ----------
    noise : float
        Bound of ‖v‖ at every instant, rad/s.
    bias : float
        Bound of ‖b‖, what is left of the bias after the known one was subtracted, rad/s.
    drift : float
        How fast the bias changes, rad/s².
    scale_error : float
        Bound of the spectral norm of K, from 0 to below 1. K is one matrix for the whole recording.
    increment : float
        Bound of ‖∫ v dt‖ over any window, rad. Far less than ``noise`` times the window if the noise changes sign.
    noise_turn, noise_turn_growth : float
        How far the noise by itself turns an attitude away that is integrated over any window: at most the first, rad,
        and the second for each second, rad/s. It says more than ``increment`` where the body turns.
    longest_window : float
        The longest window that ``increment`` and ``noise_turn`` are stated for, s. A longer time is as many of them as
        it takes, (18.61).
    longest_interval : float
        Between samples, s: up to it ``noise`` includes what the rate does there. No bound above covers a longer one.
    largest_rate : float
        Bound of the true rate at every instant, rad/s, also in a longer interval. Infinite if unknown.
    angular_acceleration : float
        Bound of how fast the true rate changes, rad/s², but for a part of at most ``noise``: how far it leaves, in a
        longer interval, the mean of the samples around it. Infinite if unknown.
    bias_change : float
        How far the biases at two instants of a window, over which directions are averaged about a row in it, may differ
        beside the drift, rad/s. Infinite: as far as ``bias`` allows.
    """

    noise: float
    bias: float = 0.0
    drift: float = 0.0
    scale_error: float = 0.0
    increment: float = np.inf
    noise_turn: float = np.inf
    noise_turn_growth: float = 0.0
    longest_window: float = np.inf
    longest_interval: float = np.inf
    largest_rate: float = np.inf
    angular_acceleration: float = np.inf
    bias_change: float = np.inf

    def __post_init__(self) -> None:
        """Check."""
        for name in ("noise", "bias", "drift", "noise_turn_growth"):
            require_not_negative(name, getattr(self, name))
        require_fraction("scale_error", self.scale_error)
        if self.noise_turn_growth > 0.0 and np.isinf(self.noise_turn):
            raise ValueError("noise_turn_growth needs noise_turn, what it is added to")
        for name in ("longest_window", "longest_interval"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")
        for name in ("increment", "noise_turn", "largest_rate", "angular_acceleration", "bias_change"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must be at least 0, not {getattr(self, name)}")

    def with_more_noise(self, rate: float) -> Self:
        """Bounds of a gyro whose noise has another part of at most this, rad/s, which may keep its sign."""
        noise = self.noise + rate
        return replace(self, noise=noise, increment=np.inf, noise_turn=np.inf, noise_turn_growth=0.0)

    def lasting_noise(self, duration: float) -> float:
        """The largest rate, rad/s, that noise may have throughout every window of up to this duration, s; section 18.4.

        In axes that do not turn, in which an increment is the turn of such a noise, too.
        """
        lasting = [self.noise]
        longest = min(duration, self.longest_window)
        if np.isfinite(self.increment):
            lasting.append(self.increment / longest)
        if np.isfinite(self.noise_turn):
            lasting.append(self.noise_turn / longest + self.noise_turn_growth)
        return min(lasting)

    @property
    def is_steady(self) -> bool:
        """Whether more is known of the bias than how large it may be at any instant."""
        return self.bias > 0.0 and np.isfinite(self.bias_change)

    def unsteady_bias(self, duration: ArrayLike) -> FloatArray:
        """How far biases within windows of these lengths, s, are from one that stays, rad/s, (18.63)."""
        spread = self.bias_change + self.drift * np.asarray(duration, dtype=np.float64)
        radius: FloatArray = _RADIUS_OF_SET * spread
        return radius

    def gaps(self, times: FloatArray, angular_velocities: FloatArray) -> NDArray[np.bool_]:
        """Steps between rows that are longer than the noise bound speaks of.

        Parameters
        ----------
        times : (N,) array
            s, increasing.
        angular_velocities : (N, 3) array
            NaN where nothing was measured: both steps beside such a row are gaps.

        Returns
        -------
        (N - 1,) array of bool
        """
        missing = np.asarray(np.isnan(angular_velocities).any(axis=1))
        gaps: NDArray[np.bool_] = (np.diff(times) > self.longest_interval) | missing[1:] | missing[:-1]
        return gaps

    def turns_over_gaps(self, durations: ArrayLike) -> FloatArray:
        """How far the body may turn in gaps of these lengths (s), rad: the angle of a rotation is at most pi."""
        angles: FloatArray = np.minimum(self.largest_rate * np.asarray(durations, dtype=np.float64), np.pi)
        return angles

    def angles_across_gaps(
        self, durations: FloatArray, begin: FloatArray, end: FloatArray, elapsed: FloatArray
    ) -> FloatArray:
        """Bounds of the angle between the turn over a gap and one at the mean of the rates around it, (18.47).

        Parameters
        ----------
        durations : (M,) array
            Of the gaps, s.
        begin, end : (M, 3) array
            The measured rates where they begin and end, rad/s; NaN if there is none.
        elapsed : (M,) array
            The longest time between each gap and when the bias was known, s.

        Returns
        -------
        (M,) array
            rad; infinite or NaN where nothing is known.
        """
        if np.isinf(self.angular_acceleration):
            return np.full(len(durations), np.inf)
        # The error of the samples, and what the rate does beside its slow change.
        of_samples = self.rate_error(lengths_of(begin), elapsed) + self.rate_error(lengths_of(end), elapsed)
        error = 0.5 * of_samples + self.noise
        fastest = lengths_of(0.5 * (begin + end)) + error
        change = self.angular_acceleration * durations
        # From their mean the rate is half of that away at most, and a quarter in the mean; the axes turn meanwhile.
        turning = 0.25 * change * (1.0 + 0.5 * fastest * durations + 0.25 * change * durations)
        angles: FloatArray = durations * (error + self.noise + np.minimum(0.5 * change, turning))
        return angles

    def steady_error(self, angular_speeds: ArrayLike, elapsed: ArrayLike = 0.0) -> FloatArray:
        """Bound of the rate's error without the noise, (18.9): the part that does not average out.

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
        steady: FloatArray = (bias + self.scale_error * speeds) / (1.0 - self.scale_error)
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
        return self.noise / (1.0 - self.scale_error) + self.steady_error(angular_speeds, elapsed)

    def noise_angle(
        self,
        durations: FloatArray | float,
        turned: FloatArray | float,
        longest: FloatArray | float,
        length: FloatArray | float = 1.0,
    ) -> FloatArray:
        """Bound of the angle that noise turns an attitude away, (18.10), (18.56) and (18.61), or of a mean of them.

        Parameters
        ----------
        durations : (...) array
            s; or the mean of it times vectors' lengths.
        turned : (...) array
            The angle that the axes turn in which noise adds up, rad; or the mean of it times vectors' lengths.
        longest : (...) array
            The longest duration, s.
        length : (...) array
            The mean of those lengths, each as often as there are pieces without a gap.

        Returns
        -------
        (...) array
            rad, times the lengths' unit.
        """
        spans, rate = np.asarray(durations, dtype=np.float64), self.noise / (1.0 - self.scale_error)
        lengths, most = np.asarray(length, dtype=np.float64), np.asarray(longest, dtype=np.float64)
        piece = np.minimum(most, self.longest_window)
        # One window as long as it may be, and beside that any noise; or as many as it takes, at most T / L + 1.
        beside = rate * lengths * (most - piece)
        angle = np.minimum(rate * spans, self._of_pieces(spans, turned, lengths, piece) + beside)
        if np.isfinite(self.longest_window):
            angle = np.minimum(angle, self._of_pieces(spans, turned, lengths + spans / self.longest_window, piece))
        found: FloatArray = angle
        return found

    def _of_pieces(
        self, spans: FloatArray, turned: FloatArray | float, pieces: FloatArray, piece: FloatArray
    ) -> FloatArray:
        """What increment and turn by noise bound where they hold for pieces of that length (s), as many of them."""
        rate, angle = self.noise / (1.0 - self.scale_error), np.full_like(spans, np.inf)
        if np.isfinite(self.increment):
            angle = np.minimum(angle, self.swept_increment(turned, pieces) * (1.0 + 0.5 * rate * piece))
        if np.isfinite(self.noise_turn):
            angle = np.minimum(angle, self.noise_turn * pieces + self.noise_turn_growth * spans)
        return angle

    def swept_increment(self, turned: FloatArray | float, length: FloatArray | float = 1.0) -> FloatArray:
        """Bound of the noise's integral in axes that turn, (18.10), or of a mean of such integrals.

        Parameters
        ----------
        turned, length : (...) array
            As for `noise_angle`.

        Returns
        -------
        (...) array
            rad, times the lengths' unit; infinite without an increment.
        """
        angles, lengths = np.asarray(turned, dtype=np.float64), np.asarray(length, dtype=np.float64)
        increment = self.increment / (1.0 - self.scale_error)
        swept: FloatArray = increment * np.minimum(lengths + angles, _RADIUS_OF_SET * (2.0 * lengths + angles))
        return swept
