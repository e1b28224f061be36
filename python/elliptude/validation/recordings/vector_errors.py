"""What accelerometers, magnetometers and sensors of directions show, with errors that keep their bounds."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.turns import running_integral
from elliptude.typing import FloatArray
from elliptude.validation.recordings.gyro_errors import AT_BOUND, limited, matrix_within, pattern, unit_vector
from elliptude.validation.recordings.statements import StatedField, StatedForce, StatedRest

# Of vectors as they are drawn and written, as a share.
_ROUNDING = 16.0 * float(np.finfo(np.float64).eps)
MOTIONS = (
    "still",
    "back and forth",
    "back and forth",
    "back and forth",
    "bounces",
    "bounces",
    "steady",
    "waves",
    "any",
)


@dataclass(frozen=True, eq=False)
class Moved:
    """How an accelerometer moves: its acceleration is on lines between times."""

    times: FloatArray
    """s, shape (M,)."""
    accelerations: FloatArray
    """m/s², reference axes, shape (M, 3)."""
    velocities: FloatArray
    """m/s, shape (M, 3)."""

    @classmethod
    def by(cls, times: FloatArray, accelerations: FloatArray, start: FloatArray) -> "Moved":
        """From accelerations and the velocity (3,) at the first time."""
        steps = np.diff(times)[:, None]
        gained = np.cumsum(0.5 * steps * (accelerations[1:] + accelerations[:-1]), axis=0)
        return cls(times, accelerations, start + np.concatenate([np.zeros((1, 3)), gained]))

    def velocities_at(self, wanted: FloatArray) -> FloatArray:
        """Velocities at times within, m/s."""
        i = np.clip(np.searchsorted(self.times, wanted, side="right") - 1, 0, len(self.times) - 2)
        since, steps = (wanted - self.times[i])[:, None], np.diff(self.times)[i][:, None]
        change = (self.accelerations[i + 1] - self.accelerations[i]) / steps
        found: FloatArray = self.velocities[i] + since * self.accelerations[i] + 0.5 * since**2 * change
        return found

    def positions(self) -> FloatArray:
        """m, from the first one, shape (M, 3)."""
        steps, a = np.diff(self.times)[:, None], self.accelerations
        gained = steps * self.velocities[:-1] + steps**2 * (a[:-1] / 3.0 + a[1:] / 6.0)
        return np.concatenate([np.zeros((1, 3)), np.cumsum(gained, axis=0)])


# --- how the accelerometer moves --------------------------------------------------------------------------------------


def draw_motion(
    force: StatedForce,
    rest: StatedRest | None,
    times: FloatArray,
    first: float,
    more: float,
    kept: NDArray[np.bool_],
    kinds: dict[str, str],
    largest: float,
    draws: np.random.Generator,
) -> Moved:
    """A motion that keeps what is stated of it.

    Parameters
    ----------
    force : StatedForce
    rest : StatedRest, optional
        In which it moves no faster than that says.
    times : (M,) array
        s.
    first : float
        Time of the first row, s.
    more : float
        How far stamps may be off, s.
    kept : (M,) array of bool
        Where there are samples.
    kinds : dict
        Of the motion (``moves``).
    largest : float
        What is stated of the acceleration beside that, m/s².
    draws : numpy.random.Generator
    """
    level = unit_vector(draws)
    level[2] = 0.0 if draws.random() < 0.8 else level[2]
    level /= np.linalg.norm(level)
    motion = force.motion
    window = float(draws.choice([*force.windows, *[max(force.windows)] * 2])) if force.windows else 2.0
    window *= 1.01  # so that a window fits between two turns
    speed = motion.velocity if np.isfinite(motion.velocity) else 10.0 ** draws.uniform(0.0, 1.5)
    size = min(motion.acceleration, largest, 2.0 * speed / window, 16.0 * motion.position / window**2)
    first_row, last_row = np.flatnonzero(kept)[[0, -1]]
    if np.isfinite(motion.jerk) and not kept[first_row:last_row].all():
        size *= 1.3  # what is hidden while samples are lost may undo as much
    phase = draws.uniform(0.0, 2.0)
    kind = kinds["moves"]
    if kind == "back and forth":
        wanted = size * np.sign(np.sin(math.pi * (times / window + phase)))[:, None] * level
    elif kind == "bounces":
        # All the same way, and back within a few samples: it keeps to one side of its place.
        back = 2.0 * float(np.median(np.diff(times)))
        period = window + back
        since = np.mod(times / period + phase, 1.0) * period
        wanted = np.where(since < back, -size * window / back, size)[:, None] * level
    elif kind == "steady":
        wanted = size * np.tile(level, (len(times), 1))
    elif kind == "waves":
        wanted = size * np.sin(2.0 * math.pi * (times / window + phase))[:, None] * level
    elif kind == "any":
        wanted = size * limited(draws.standard_normal((len(times), 3)), 1.0)
    else:
        wanted = np.zeros((len(times), 3))
    start, quiet = np.zeros(3), np.zeros(len(times), dtype=np.bool_)
    if rest is not None:
        # What sensors show in a rest may be as much outside as stamps are off, and a line goes on to the next sample.
        more += 2.0 * float(np.median(np.diff(times)))
        if rest.shows is None:
            quiet = (times >= rest.begin - more) & (times <= rest.end + more)
            wanted[quiet] = 0.0
        else:
            quiet = times <= first + rest.end + more
            lasts = float(np.ptp(times[quiet]))
            slow = min(rest.velocity, speed)
            least = min(motion.acceleration, largest, 2.0 * slow / max(lasts, 1e-3))
            least = min(least, 0.2 * rest.shows.acceleration_deviation_m_per_s2)
            # It goes from one way to the other while it rests, and a rule finds whole pieces.
            wanted[times <= first + rest.end + more + rest.shows.duration_s] = 0.0
            wanted[quiet] = least * level * draws.choice([-1.0, 0.0, 1.0])
            start = -0.5 * lasts * wanted[0]
    _hide(wanted, kept, times, motion.jerk, quiet)
    wanted = _slewed(wanted, times, motion.jerk, force.sensor.error)
    return _within(wanted, times, start, quiet, force, rest, largest)


def _hide(
    wanted: FloatArray, kept: NDArray[np.bool_], times: FloatArray, jerk: float, quiet: NDArray[np.bool_]
) -> None:
    """While samples are lost, let the acceleration do less and come back, as fast as it may change."""
    if not np.isfinite(jerk):
        return
    for begin, end in itertools.pairwise(np.flatnonzero(kept).tolist()):
        if end == begin + 1 or quiet[begin : end + 1].any():
            continue
        inside = slice(begin + 1, end)
        away = jerk * np.minimum(times[inside] - times[begin], times[end] - times[inside])
        length = float(np.linalg.norm(wanted[begin]))
        wanted[inside] = wanted[begin] - (away[:, None] * wanted[begin] / length if length > 0.0 else 0.0)
        wanted[end] = wanted[begin]


def _slewed(wanted: FloatArray, times: FloatArray, jerk: float, quick: float) -> FloatArray:
    """Accelerations that follow others no faster than is stated."""
    if not np.isfinite(jerk):
        return wanted
    found = wanted.copy()
    for i, step in enumerate(np.diff(times)):
        change = wanted[i + 1] - found[i]
        length = float(np.linalg.norm(change))
        found[i + 1] = found[i] + change * min(1.0, AT_BOUND * jerk * step / length if length > 0.0 else 1.0)
    return found


def _within(
    wanted: FloatArray,
    times: FloatArray,
    start: FloatArray,
    quiet: NDArray[np.bool_],
    force: StatedForce,
    rest: StatedRest | None,
    largest: float,
) -> Moved:
    """The motion, less of it if it breaks what is stated of velocity and place."""
    motion, window = force.motion, max(force.windows, default=0.0)
    share = np.ones(len(times))
    for _ in range(120):
        moved = Moved.by(times, wanted * share[:, None], start)
        velocities = moved.velocities
        if rest is None:
            mean = running_integral(times, velocities)[-1] / (times[-1] - times[0])
            middle = 0.5 * (velocities.max(axis=0) + velocities.min(axis=0))
            # Of the speed alone the ends count, of the place that it does not drift.
            moved = Moved(times, moved.accelerations, velocities - (mean if np.isinf(motion.velocity) else middle))
            velocities = moved.velocities
        too_fast = bool(np.linalg.norm(velocities, axis=1).max() > motion.velocity * AT_BOUND)
        too_fast |= bool(np.linalg.norm(moved.accelerations, axis=1).max() > min(motion.acceleration, largest))
        if rest is not None:
            too_fast = too_fast or bool(
                np.linalg.norm(velocities[quiet], axis=1).max(initial=0.0) > rest.velocity * AT_BOUND + 1e-12
            )
        if not too_fast and _reach(moved, window) <= motion.position * AT_BOUND:
            return moved
        share *= 0.97
    return Moved.by(times, np.zeros_like(wanted), np.zeros(3))


def _reach(moved: Moved, window: float) -> float:
    """The radius of a ball that holds the places within any window, m; not the smallest."""
    if window == 0.0:
        return 0.0
    places, largest = moved.positions(), 0.0
    stride = max(len(places) // 400, 1)
    for i in range(0, len(places), stride):
        some = places[i : np.searchsorted(moved.times, moved.times[i] + window + stride * 0.05)]
        largest = max(largest, 0.5 * float(np.linalg.norm(np.ptp(some, axis=0))))
    return largest


# --- errors of sensors that show vectors ------------------------------------------------------------------------------


def shown_vectors(
    true: FloatArray,
    attitudes: FloatArray,
    times: FloatArray,
    sensor: VectorSensorBounds,
    sampling: FloatArray | None,
    kinds: dict[str, str],
    still: FloatArray,
    draws: np.random.Generator,
) -> FloatArray:
    """What a sensor shows of true vectors (N, 3), in body axes: M (I + K) x + e.

    Parameters
    ----------
    true : (N, 3) array
        Body axes.
    attitudes : (N, 3, 3) array
        Of the rows, from body to reference axes: means are of errors turned to these.
    times : (N,) array
        s.
    sensor : VectorSensorBounds
    sampling : (N, 3) array, optional
        The integral of the samples less that of the motion, up to each row, in reference axes; the averaged error has
        to cover it.
    kinds : dict
        Of the error, of the scale error and of what alternates.
    still : (N,) array
        How large what alternates may be at most: in a rest that shows itself less than the error.
    draws : numpy.random.Generator
    """
    matrix = np.eye(3) + matrix_within(sensor.scale_error, kinds["scale"], draws)
    turn = scipy.spatial.transform.Rotation.from_rotvec(sensor.misalignment * AT_BOUND * unit_vector(draws)).as_matrix()
    # What was drawn is rounded, and so are the numbers of a file.
    most = max(sensor.error - _ROUNDING * float(np.abs(true).max(initial=0.0)), 0.0)
    averaged = most if sensor.averaged_error is None else min(sensor.averaged_error, most)
    slow = averaged * pattern(kinds["offset"], attitudes, np.zeros_like(true), draws)
    if kinds["offset"] == "waves":
        # Means that are too short for the averaged error are larger.
        period, share = sensor.averaged_over * draws.uniform(0.5, 2.0), draws.choice([0.5, draws.uniform(0.2, 0.8)])
        first = np.mod(times / max(period, 1e-9) + draws.random(), 1.0) < share
        slow = np.where(first, most, -most)[:, None] * pattern("in space", attitudes, np.zeros_like(true), draws)
    if kinds["offset"] == "in the body" and draws.random() < 0.3:
        slow *= np.where(np.arange(len(times)) // max(int(len(times) // draws.integers(1, 9)), 1) % 2, 1.0, -1.0)[
            :, None
        ]
    # Of stamps that jitter: what the vector changes meanwhile.
    moving = np.gradient(true, axis=0) if kinds["wobble"] == "jitter" and len(true) > 1 else true
    quick = np.minimum(most - averaged, still)[:, None] * pattern(kinds["wobble"], attitudes, moving, draws)
    error = AT_BOUND * limited(limited(slow, still) + quick, most)
    drift = np.zeros_like(true) if sampling is None else sampling
    if sensor.averaged_error is not None or sampling is not None:
        error *= _largest_share(error, attitudes, times, drift, averaged, sensor.averaged_over)
    shown: FloatArray = true @ (turn @ matrix).T + error
    return shown


def _largest_share(
    error: FloatArray, attitudes: FloatArray, times: FloatArray, drift: FloatArray, averaged: float, over: float
) -> float:
    """How much of an error leaves all means over windows of a length or longer within their bound."""
    turned = np.einsum("nij,nj->ni", attitudes, error)
    sums = running_integral(times, turned)
    of_error, of_motion, lag = 0.0, 0.0, 1
    while lag < len(times):
        spans = times[lag:] - times[:-lag]
        long = spans >= over * (1.0 - 1e-9)
        if long.any():
            means = np.linalg.norm(sums[lag:] - sums[:-lag], axis=1)[long] / spans[long]
            moved = np.linalg.norm(drift[lag:] - drift[:-lag], axis=1)[long] / spans[long]
            of_error, of_motion = max(of_error, float(means.max())), max(of_motion, float(moved.max()))
        # Longer windows are no worse than those that they are made of.
        if long.all() and spans.min() > 2.5 * over:
            break
        lag += 1
    left = AT_BOUND * averaged - of_motion
    return min(1.0, max(left, 0.0) / of_error) if of_error > 0.0 else 1.0


def draw_disturbances(
    field: StatedField,
    rests: tuple[StatedRest, ...],
    times: FloatArray,
    first: float,
    delay: float,
    attitudes: FloatArray,
    kinds: dict[str, str],
    draws: np.random.Generator,
) -> FloatArray:
    """What is added to the reference field, µT, reference axes, shape (N, 3): in the mean nothing in a rest."""
    found = field.disturbance * AT_BOUND * _in_reference(kinds["disturbance"], attitudes, draws)
    for rest in rests:
        shown = rest.shows is not None
        begin, end = (first, first + rest.end) if shown else (rest.begin, rest.end)
        inside = (times <= end + 1.0) & ((times >= begin - 1.0) | shown)
        found[inside] = 0.0
        if not shown:
            continue  # which samples its mean is of depends on those that are lost: the field does not change
        # Of what the sensor shows in these rows: samples that are as late as the rule says.
        rows = times[(times + delay >= first - 1e-9) & (times + delay <= first + (1.0 + 1e-9) * rest.end)] + delay
        seen = np.abs((times + delay)[None, :] - (rows + delay)[:, None]).argmin(axis=1)
        change = np.zeros_like(found)
        most = min(rest.field_change, field.disturbance) * AT_BOUND * draws.choice([0.0, 0.5])
        change[seen] = np.where(np.arange(len(seen)) < 0.5 * len(seen), most, -most)[:, None] * unit_vector(draws)
        mean = running_integral(rows, change[seen])[-1] / (rows[-1] - rows[0])
        change[seen] -= mean
        found[seen] = change[seen]
    return found


def _in_reference(kind: str, attitudes: FloatArray, draws: np.random.Generator) -> FloatArray:
    """Vectors (N, 3) in reference axes, no longer than 1."""
    body = pattern(kind, attitudes, np.zeros((len(attitudes), 3)), draws)
    found: FloatArray = np.einsum("nij,nj->ni", attitudes, body)
    return found


# --- errors of directions ---------------------------------------------------------------------------------------------


def turned_away(
    directions: FloatArray,
    angle: FloatArray | float,
    attitudes: FloatArray,
    kinds: dict[str, str],
    draws: np.random.Generator,
) -> FloatArray:
    """Directions (N, 3) in body axes, turned away by at most an angle."""
    axes = pattern(kinds["offset"], attitudes, np.zeros_like(directions), draws)
    units = directions / np.linalg.norm(directions, axis=1)[:, None]
    across = axes - np.sum(axes * units, axis=1)[:, None] * units
    lengths = np.linalg.norm(across, axis=1)[:, None]
    # Across the direction, a turn by the whole angle.
    across = np.where(lengths > 1e-6, across / np.where(lengths > 1e-6, lengths, 1.0), 0.0) * (lengths > 1e-6)
    angles = np.broadcast_to(angle, len(units))[:, None]
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(AT_BOUND * angles * across).apply(directions))
