"""Which rows of a recording are at rest, and what a sensor shows there in the mean."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.turns import running_sum
from elliptude.typing import FloatArray


class _Stillness(NamedTuple):
    """How still a sensor is in each of m pieces of N rows."""

    starts: NDArray[np.intp]
    """The row where each starts, shape (m,)."""
    piece: NDArray[np.intp]
    """To which each row belongs, shape (N,)."""
    counts: NDArray[np.intp]
    """How many rows each has, shape (m,)."""
    turning: FloatArray
    """The largest deviation of a rate from the mean, rad/s, shape (m,)."""
    mean_rates: FloatArray
    """The length of the mean rate, rad/s, shape (m,)."""
    shaking: FloatArray
    """The largest deviation of a specific force from the mean, m/s², shape (m,)."""


def rest_rows(
    times: ArrayLike,
    angular_velocities: ArrayLike,
    specific_forces: ArrayLike,
    *,
    duration: float,
    rate_deviation: float,
    rate: float,
    acceleration_deviation: float,
) -> NDArray[np.bool_]:
    """Rows at rest: the recording is cut into pieces, and all samples of a piece stay near its mean.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    angular_velocities, specific_forces : (N, 3) array
        rad/s and m/s².
    duration : float
        Length of a piece, s.
    rate_deviation, acceleration_deviation : float
        Largest deviation of a sample from the piece's mean, rad/s and m/s².
    rate : float
        Largest norm of the piece's mean, rad/s.

    Returns
    -------
    (N,) array of bool
        False in pieces with a missing row.
    """
    seen = _stillness(np.asarray(times, dtype=np.float64), angular_velocities, specific_forces, duration)
    resting = (seen.turning <= rate_deviation) & (seen.mean_rates <= rate) & (seen.shaking <= acceleration_deviation)
    rows: NDArray[np.bool_] = (resting & (seen.counts > 1))[seen.piece]
    return rows


def why_no_rest(
    times: ArrayLike,
    angular_velocities: ArrayLike,
    specific_forces: ArrayLike,
    *,
    duration: float,
    rate_deviation: float,
    rate: float,
    acceleration_deviation: float,
) -> str:
    """Which limit the piece fails that comes nearest to a rest, in words; arguments as for `rest_rows`."""
    stamps = np.asarray(times, dtype=np.float64)
    seen = _stillness(stamps, angular_velocities, specific_forces, duration)
    degrees = np.rad2deg(1.0)
    limits = (
        (
            seen.turning,
            rate_deviation,
            degrees,
            "the gyro deviates from its mean by {:.3g}, at most {:.3g} deg/s are a rest",
        ),
        (seen.mean_rates, rate, degrees, "the gyro's mean is {:.3g}, at most {:.3g} deg/s are a rest"),
        (
            seen.shaking,
            acceleration_deviation,
            1.0,
            "the specific force deviates by {:.3g}, at most {:.3g} m/s^2 are a rest",
        ),
    )
    ratios = np.array([values / most for values, most, _, _ in limits])
    ratios[:, (seen.counts < 2) | ~np.isfinite(ratios).all(axis=0)] = np.inf
    nearest = int(np.argmin(ratios.max(axis=0)))
    if not np.isfinite(ratios[:, nearest]).all():
        return f"no {duration:g} s have all samples"
    values, most, scale, words = limits[int(np.argmax(ratios[:, nearest]))]
    said = words.format(scale * values[nearest], scale * most)
    return f"in the quietest {duration:g} s, from {stamps[seen.starts[nearest]]:.6g} s on, {said}"


def noise_of(times: ArrayLike, values: ArrayLike, *, duration: float) -> float:
    """The standard deviation of a sensor's noise along an axis, from how samples differ from those beside them.

    Third differences of white noise have twenty times its variance, and next to nothing of a motion that is slow
    against the samples. The quietest fifth of the pieces counts.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    values : (N, 3) array
        NaN where nothing was measured.
    duration : float
        Length of a piece, s.

    Returns
    -------
    float
        In the unit of the values; 0 if there are too few samples.
    """
    stamps, rows = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if len(stamps) < 4:
        return 0.0
    squares = np.mean(np.diff(rows, n=3, axis=0) ** 2, axis=1) / 20.0
    starts, _, counts = _pieces(stamps[:-3], duration)
    there = np.isfinite(squares)
    found = np.add.reduceat(there.astype(np.intp), starts)
    enough = 2 * found > counts
    means = np.add.reduceat(np.where(there, squares, 0.0), starts)[enough] / found[enough]
    return float(np.sqrt(np.quantile(means, 0.2))) if len(means) else 0.0


def _stillness(
    stamps: FloatArray, angular_velocities: ArrayLike, specific_forces: ArrayLike, duration: float
) -> _Stillness:
    starts, piece, counts = _pieces(stamps, duration)
    turning, mean_rates = _deviations(angular_velocities, starts, piece, counts)
    shaking, _ = _deviations(specific_forces, starts, piece, counts)
    return _Stillness(starts, piece, counts, turning, mean_rates, shaking)


def _pieces(stamps: FloatArray, duration: float) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Where pieces start, to which each row belongs, and how many rows each has."""
    pieces = np.floor((stamps - stamps[0]) / duration + 1e-9).astype(np.intp)
    starts = np.flatnonzero(np.diff(pieces, prepend=-1))
    piece = np.cumsum(np.diff(pieces, prepend=-1) > 0) - 1
    return starts, piece, np.diff(starts, append=len(stamps))


def _deviations(
    vectors: ArrayLike, starts: NDArray[np.intp], piece: NDArray[np.intp], counts: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """In each piece, the largest distance of a sample from the mean, and the length of the mean."""
    values = np.asarray(vectors, dtype=np.float64)
    means = np.add.reduceat(values, starts, axis=0) / counts[:, None]
    deviations: FloatArray = np.maximum.reduceat(np.linalg.norm(values - means[piece], axis=1), starts)
    lengths: FloatArray = np.linalg.norm(means, axis=1)
    return deviations, lengths


def mean_over_time(times: FloatArray, vectors: FloatArray) -> FloatArray:
    """The mean over time of vectors on lines between rows, however far these are apart; of one row, the row.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    vectors : (N, 3) array

    Returns
    -------
    (3,) array
    """
    duration = float(times[-1] - times[0])
    mean: FloatArray = running_sum(np.diff(times), vectors)[-1] / duration if duration > 0.0 else vectors[0]
    return mean


def mean_at_rest(
    times: FloatArray, vectors: FloatArray, sensor: VectorSensorBounds, *, longest_step: float = np.inf
) -> tuple[FloatArray, float, float]:
    """A sensor's mean over time, over the longest run of rows that all have it; its error, and how long the run is.

    Where that run is too short for the mean's error to be stated, the mean of all samples, each with its own error.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    vectors : (N, 3) array
        NaN where the sensor shows nothing.
    sensor : VectorSensorBounds
        In the vectors' unit.
    longest_step : float
        From one row of a run to the next, s: a longer one ends it, as samples were lost there.
    """
    there = np.asarray(np.isfinite(vectors).all(axis=1))
    run = longest_run(times, there, longest_step=longest_step)
    if not there.any():
        return np.full(3, np.nan), sensor.error, 0.0
    lasted = float(times[run][-1] - times[run][0])
    if not lasted > 0.0:
        return vectors[there].mean(axis=0), sensor.error, 0.0
    mean, error = mean_over_time(times[run], vectors[run]), float(sensor.mean_error(lasted))
    # As many additions lose of the mean.
    lost = float(np.finfo(np.float64).eps) * (len(vectors) + 20.0) * float(np.linalg.norm(mean))
    return mean, error + lost, lasted


def longest_run(times: FloatArray, there: NDArray[np.bool_], *, longest_step: float = np.inf) -> slice:
    """The longest run of rows that are all there, with steps (s) of at most that length; no rows if none is there."""
    runs = np.cumsum(np.diff(times, prepend=times[:1]) > longest_step) * 2 + there
    firsts = np.flatnonzero(np.diff(runs, prepend=-1))
    firsts, lasts = firsts[there[firsts]], (np.append(firsts[1:], len(times)) - 1)[there[firsts]]
    if not len(firsts):
        return slice(0, 0)
    longest = int(np.argmax(times[lasts] - times[firsts]))
    return slice(int(firsts[longest]), int(lasts[longest]) + 1)


def mean_acceleration_at_rest(speed: float, lasted: float, time_offset: float) -> float:
    """Bound of the mean acceleration over a rest by its speed, m/s², (18.64); infinite where no time may be left.

    Parameters
    ----------
    speed : float
        At any time, m/s.
    lasted : float
        By the stamps, s. Truly it may have been shorter, by twice the offset.
    time_offset : float
        Bound of a stamp's, s.
    """
    least = lasted - 2.0 * time_offset
    return 2.0 * speed / least if least > 0.0 else np.inf
