"""Poses of a sensor: means over windows in a frame that the gyro carries along; docs/theory.md, section 19.2."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.turns import attitudes_from_rates, coning_angles, from_the_first, running_sum
from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Pose:
    """What a window says: v = T:P - Np is a vector of the world's length, but for errors, (19.2)."""

    begin: float
    """s."""
    end: float
    """s."""
    products: FloatArray
    """T, the mean of the carried frame times each sample, shape (3, 3, 3): v gets T[a, p, q] P[p, q]."""
    frame: FloatArray
    """N, the mean of the carried frame, shape (3, 3)."""
    length: float
    """Mean of the samples' lengths."""
    turn: float
    """Mean of the angles by which the carried frame may be off, rad."""
    squared_turn: float
    """Mean of their squares, rad²."""
    mean_disturbance: float
    """How far the mean over the window of what acts on the sensor may be from the world's vector."""


def pose_of(
    times: FloatArray,
    vectors: FloatArray,
    rates: FloatArray,
    turned_by_offset: FloatArray,
    gyro: GyroBounds,
    axes_error: float,
    mean_disturbance: float,
    bias_known: float,
    sampled: FloatArray | None = None,
) -> Pose:
    """The pose of a window; the frame is that of its middle.

    Parameters
    ----------
    times : (n,) array
        s, increasing, at least two.
    vectors : (n, 3) array
        What the sensor shows.
    rates : (n, 3) array
        rad/s, the bias subtracted.
    turned_by_offset : (n,) array
        How far the body may turn within the error of a sample's stamp, rad.
    gyro : GyroBounds
        Of the rates.
    axes_error : float
        How far the sensor's axes may be turned against the gyro's, 2 sin(ψ/2).
    mean_disturbance : float
    bias_known : float
        When the gyro's bias was known, s, from where on it drifts.
    sampled : (n,) array, optional
        When the sensor was sampled, s, if it has stamps of its own.
    """
    steps = np.diff(times)
    own = times if sampled is None else sampled
    between = np.diff(own)
    weights = np.zeros(len(times))
    weights[:-1] += 0.5 * between
    weights[1:] += 0.5 * between
    weights /= weights.sum()
    attitudes = attitudes_from_rates(steps, rates)
    middle = len(times) // 2
    carried = np.einsum("ji,njk->nik", attitudes[middle], attitudes)
    speeds = np.linalg.norm(rates, axis=1)
    turned = np.abs(_from(middle, running_sum(steps, speeds)))
    errors = running_sum(steps, gyro.steady_error(speeds, times - bias_known))
    steady = np.abs(_from(middle, errors + from_the_first(coning_angles(steps, rates))))
    duration = np.abs(times - times[middle])
    # By the gyro, (18.9); by the sensor's axes, (19.3); by the stamps, (18.8). Of the world's vector it counts to
    # second order only, of what is not that, a disturbance and noise, to first order.
    off = steady + gyro.noise / (1.0 - gyro.scale_error) * duration
    off += axes_error * turned + turned_by_offset + 64.0 * _EPSILON * (len(times) + turned)
    return Pose(
        begin=float(own[0]),
        end=float(own[-1]),
        products=np.einsum("n,nij,nk->ijk", weights, carried, vectors),
        frame=np.einsum("n,nij->ij", weights, carried),
        length=float(weights @ np.linalg.norm(vectors, axis=1)),
        turn=float(weights @ off),
        squared_turn=float(weights @ off**2),
        mean_disturbance=mean_disturbance,
    )


def _from(middle: int, values: FloatArray) -> FloatArray:
    difference: FloatArray = values - values[middle]
    return difference


def poses_of(
    windows: Iterable[slice],
    times: FloatArray,
    vectors: FloatArray,
    rates: FloatArray,
    turned_by_offset: FloatArray,
    gyro: GyroBounds,
    axes_error: float,
    mean_disturbance: Callable[[float], float],
    sampled: FloatArray | None = None,
) -> list[Pose]:
    """The poses of some windows, without those in which a sample is missing or the gyro has a gap.

    ``mean_disturbance`` is that of a window by its length in seconds. The gyro's bias was known at the first time.
    ``sampled`` are the sensor's own stamps (N,), s, if they are not those of the rows.
    """
    known = np.isfinite(vectors).all(axis=1) & np.isfinite(rates).all(axis=1) & np.isfinite(turned_by_offset)
    found = []
    for rows in windows:
        own = times[rows] if sampled is None else sampled[rows]
        if (
            rows.stop - rows.start < 2
            or not own[-1] > own[0]
            or not known[rows].all()
            or gyro.gaps(times[rows], rates[rows]).any()
        ):
            continue
        mean = mean_disturbance(float(own[-1] - own[0]))
        found.append(
            pose_of(
                times[rows],
                vectors[rows],
                rates[rows],
                turned_by_offset[rows],
                gyro,
                axes_error,
                mean,
                bias_known=float(times[0]),
                sampled=None if sampled is None else own,
            )
        )
    return found


def windows_of(times: FloatArray, duration: float) -> list[slice]:
    """Whole windows of a length, one after the other."""
    count = int(np.floor((times[-1] - times[0]) / duration + 1e-9))
    edges = np.searchsorted(times, times[0] + duration * np.arange(count + 1) - 1e-9 * duration)
    # Both ends, which two windows share: one without its last step would be shorter than it is said to be.
    return [slice(int(a), min(int(b) + 1, len(times))) for a, b in pairwise(edges)]
