"""How far the attitudes may be off that follow from a gyro's rates.

Needs only NumPy; SI units and radians; rows are instants. Derivations and proofs: docs/theory.md, section 18.4.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.arguments import increasing_times, vector_rows
from elliptude.bounds.gyro_errors import (
    TIMES_USUAL,
    GyroErrors,
    covered_interval,
    usual_longest,
    with_rounding,
)
from elliptude.bounds.matrix_effects import largest_stretch, scale_effects
from elliptude.bounds.turns import (
    coning_angles,
    from_the_first,
    lengths_of,
    quaternions_from_rates,
    rotation_vectors,
    rotations_from_quaternions,
    running_integral,
)
from elliptude.typing import FloatArray

__all__ = [
    "TIMES_USUAL",
    "AnchoredTurns",
    "GyroBounds",
    "covered_interval",
    "usual_longest",
    "with_rounding",
]

_SQRT3 = math.sqrt(3.0)


@dataclass(frozen=True)
class GyroBounds(GyroErrors):
    """How far a gyro may be off, and the turns that follow from its rates. The parameters are those of `GyroErrors`."""

    def window_angle(self, times: ArrayLike, angular_velocities: ArrayLike, elapsed: ArrayLike = 0.0) -> float:
        """Bound of the angle by which the turn over all rows is off, (18.10); in a gap the turn counts as zero.

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
        stamps = increasing_times(times)
        rates = vector_rows("angular_velocities", angular_velocities, len(stamps))
        speeds = np.linalg.norm(rates, axis=1)
        errors = np.broadcast_to(self.steady_error(speeds, elapsed), speeds.shape)
        gaps = self.gaps(stamps, rates)
        angle = float(self.turns_over_gaps(np.diff(stamps)[gaps]).sum())
        ends = np.flatnonzero(gaps) + 1
        for first, stop in zip([0, *ends], [*ends, len(stamps)], strict=True):
            piece = slice(first, stop)
            duration = stamps[stop - 1] - stamps[first]
            angle += float(self.noise_angle(duration, np.trapezoid(speeds[piece], stamps[piece]), duration))
            angle += float(np.trapezoid(errors[piece], stamps[piece]))
            angle += float(coning_angles(np.diff(stamps[piece]), rates[piece]).sum())
        return angle

    def noise_rate(self, duration: float, turned: float) -> float:
        """The noise bound to give to one prediction that spans a window, (18.10), rad/s.

        Parameters
        ----------
        duration : float
            Length of the window, s.
        turned : float
            The angle that the measured rate turned in it, rad.

        Returns
        -------
        float
        """
        if not duration > 0.0:
            raise ValueError(f"duration must be positive, not {duration}")
        return float(self.noise_angle(duration, turned, duration)) / duration

    def anchored_turns(
        self,
        times: ArrayLike,
        angular_velocities: ArrayLike,
        duration: float,
        elapsed: ArrayLike | None = None,
        measured: ArrayLike | None = None,
    ) -> "AnchoredTurns":
        """Predictions that span a window, so that the increment bound helps, (18.12).

        Every row is reached from an anchor, the last one before it of rows about ``duration`` apart. Over a gap the row
        behind it is reached from the one before it, at the mean of their rates, if that says more than the largest rate
        does; otherwise the turn counts as zero, and may be any at the largest rate.

        Parameters
        ----------
        times : (N,) array
            s, increasing.
        angular_velocities : (N, 3) array
            Measured, the known bias subtracted, rad/s; NaN where nothing was.
        duration : float
            Between anchors, s.
        elapsed : (N,) array, optional
            Time between each row and when the bias was known, s; that was at the first row if left out.
        measured : (N,) array of bool, optional
            Rows in which anything else is measured. An anchor is one of these if there is any: what is measured in
            another row is not carried on.

        Returns
        -------
        AnchoredTurns
        """
        stamps = increasing_times(times)
        rates = vector_rows("angular_velocities", angular_velocities, len(stamps))
        if not 0.0 < duration < np.inf:
            raise ValueError(f"duration must be positive and finite, not {duration}")
        since = stamps - stamps[0] if elapsed is None else np.asarray(elapsed, dtype=np.float64)
        if since.shape != stamps.shape or not (since >= 0.0).all():
            raise ValueError(f"elapsed must be at least 0 at each of the {len(stamps)} rows")
        with_more = np.arange(len(stamps)) if measured is None else np.flatnonzero(np.asarray(measured, dtype=np.bool_))
        known = np.flatnonzero(np.isfinite(rates).all(axis=1))
        anchors = np.zeros(len(stamps), dtype=np.intp)
        mean_rates, noise = np.zeros((len(stamps), 3)), np.zeros(len(stamps))
        angles, angles_turned = np.zeros(len(stamps)), np.zeros(len(stamps))
        over_gap = np.zeros(len(stamps), dtype=np.bool_)
        over_gap[1:] = self.gaps(stamps, rates)
        gaps = np.flatnonzero(over_gap)
        anchor = 0
        while anchor < len(stamps) - 1:
            if over_gap[anchor + 1]:
                bridge = self._bridge(stamps, rates, since, anchor, known)
                row = anchor + 1 if bridge is None else bridge[0]
                gap = slice(anchor + 1, row + 1)
                spans = stamps[gap] - stamps[anchor]
                anchors[gap], noise[gap], angles[gap] = anchor, self.largest_rate, self.turns_over_gaps(spans)
                if bridge is not None:
                    _, mean_rates[row], angles[row] = bridge
                    angles_turned[row] = spans[-1] * np.linalg.norm(mean_rates[row])
                    noise[row] = _rate_of_angle(angles_turned[row], angles[row], spans[-1])
                anchor = row
                continue
            following = int(np.searchsorted(stamps, stamps[anchor] + duration * (1.0 + 1e-9), side="right")) - 1
            next_gap = int(np.searchsorted(gaps, anchor, side="right"))
            if next_gap < len(gaps):
                following = min(following, int(gaps[next_gap]) - 1)
            last = int(np.searchsorted(with_more, following, side="right")) - 1
            if last >= 0 and with_more[last] > anchor:
                following = int(with_more[last])
            piece = slice(anchor, max(following, anchor + 1) + 1)
            spans = stamps[piece] - stamps[anchor]
            with np.errstate(over="ignore", invalid="ignore"):
                speeds = lengths_of(rates[piece])
                known_for, turned = since[piece], running_integral(spans, speeds)
                coned = from_the_first(coning_angles(np.diff(spans), rates[piece]))
                errors = running_integral(spans, self.steady_error(speeds, known_for)) + coned
                errors += self.noise_angle(spans, turned, spans)
                quaternions = quaternions_from_rates(np.diff(stamps[piece]), rates[piece])
                turns = rotation_vectors(quaternions)
                effects, chords = scale_effects(
                    np.diff(stamps[piece]), rotations_from_quaternions(quaternions), rates[piece]
                )
                errors = np.minimum(
                    errors, self._angle_with_one_matrix(spans, known_for, turned, coned, effects, chords)
                )
            # If this overflows, the turn may be any.
            lost = ~(np.isfinite(turns).all(axis=1) & np.isfinite(errors) & np.isfinite(turned))
            turns[lost], errors[lost], turned[lost] = 0.0, np.pi, 0.0
            rows = slice(anchor + 1, piece.stop)
            anchors[rows], angles[rows], angles_turned[rows] = anchor, errors[1:], turned[1:]
            mean_rates[rows] = turns[1:] / spans[1:, None]
            noise[rows] = _rate_of_angle(lengths_of(turns[1:]), errors[1:], spans[1:])
            anchor = piece.stop - 1
        return AnchoredTurns(anchors, mean_rates, noise, angles, angles_turned, over_gap)

    def _bridge(
        self, stamps: FloatArray, rates: FloatArray, since: FloatArray, before: int, known: NDArray[np.intp]
    ) -> tuple[int, FloatArray, float] | None:
        """The row behind a gap, the mean of the rates around it, and how far that turn may be off.

        None if the largest rate says more: alone since the last row in the gap, in which something may be measured. The
        gap begins at row ``before``; rows in it are not among the ``known``, which have a rate.
        """
        place = int(np.searchsorted(known, before + 1))
        if np.isinf(self.angular_acceleration) or place == len(known):
            return None
        behind = int(known[place])
        span = float(stamps[behind] - stamps[before])
        with np.errstate(over="ignore", invalid="ignore"):
            rate = 0.5 * (rates[before] + rates[behind])
            around, longest = rates[[before, behind]], since[[before, behind]].max()
            angle = float(self.angles_across_gaps(np.array([span]), around[:1], around[1:], np.array([longest]))[0])
            turned = span * float(np.linalg.norm(rate))
        says_more = angle < self.turns_over_gaps(stamps[behind] - stamps[behind - 1]) and turned + angle < np.pi
        return (behind, rate, angle) if says_more else None

    def _angle_with_one_matrix(
        self,
        spans: FloatArray,
        elapsed: FloatArray,
        turned: FloatArray,
        coned: FloatArray,
        effects: FloatArray,
        chords: FloatArray,
    ) -> FloatArray:
        """Bound of the angle, (18.13): on the way back the scale error undoes itself."""
        # ω̃ - ω = K' ω̃ + (I - K')(b + v), K' = K (I + K)⁻¹.
        scale, other = self.scale_error / (1.0 - self.scale_error), 1.0 / (1.0 - self.scale_error)
        of_scale = scale * (_SQRT3 * largest_stretch(effects) + chords + coned * turned)
        second_order = 0.5 * np.maximum.accumulate(of_scale) * scale * turned
        of_bias = other * running_integral(spans, self.bias + self.drift * elapsed)
        # Noise adds up in the true axes, and these may turn by as much more as the rate is off.
        truly_turned = (1.0 + scale) * turned + of_bias + other * self.noise * spans
        of_noise = self.noise_angle(spans, truly_turned, spans)
        angle: FloatArray = of_scale + second_order + of_noise + of_bias + coned
        return angle


def _rate_of_angle(turned: FloatArray, angles: FloatArray, spans: FloatArray) -> FloatArray:
    """How far rates differ whose turns over these spans are within angles of one another, rad/s, (18.12)."""
    half = np.minimum(0.5 * (turned + angles), np.pi)
    rates: FloatArray = angles / np.sinc(half / np.pi) / spans
    return rates


@dataclass(frozen=True, eq=False)
class AnchoredTurns:
    """How each row's attitude follows from that of an earlier row, its anchor."""

    anchors: NDArray[np.intp]
    """Row of the anchor, shape (N,); 0 for the first row, which is its own anchor."""
    rates: FloatArray
    """The constant rate that turns the anchor's attitude into the row's, rad/s, shape (N, 3), at most pi in all."""
    noise: FloatArray
    """Bound of that rate's error, bias included, rad/s, shape (N,); enormous where the turn may be a whole one."""
    angles: FloatArray
    """Bound of the angle between this turn and the true one, without rounding, rad, shape (N,)."""
    turned: FloatArray
    """The integral of the measured rates' norm since the anchor, which rounding grows with, rad, shape (N,)."""
    over_gap: NDArray[np.bool_]
    """Whether the row is behind a gap or in one, so that no sample covers the time before it, shape (N,)."""
