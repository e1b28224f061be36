"""How a body turns, and what a gyro shows of it with errors that keep their bounds."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.rest import mean_over_time
from elliptude.typing import FloatArray
from elliptude.validation.recordings.statements import Stated, StatedGyro, StatedRest
from elliptude.validation.recordings.truth.turning import Turning, share_of_noise_turn

# Within this share of a bound an error is at it: what is left covers the rounding of what was drawn.
AT_BOUND = 1.0 - 1e-9
TURNS = ("still", "spin", "spin", "coning", "coning", "waves", "reversals", "jumps")
PATTERNS = (
    "none",
    "in space",
    "in space",
    "in space",
    "in the body",
    "in the body",
    "along the rate",
    "across the rate",
    "alternating",
    "any",
)
MATRICES = ("none", "longer", "shorter", "turned", "one axis", "coupled")


@dataclass(frozen=True, eq=False)
class Shown:
    """What the gyro shows, and the truth behind it."""

    rates: FloatArray
    """Samples, rad/s, body axes, at the times that were kept, shape (N, 3)."""
    biases: FloatArray
    """True biases at these, less what is known of them, rad/s, shape (N, 3)."""
    turning: Turning


def unit_vector(draws: np.random.Generator) -> FloatArray:
    """Any direction, shape (3,)."""
    vector = draws.standard_normal(3)
    unit: FloatArray = vector / np.linalg.norm(vector)
    return unit


def limited(vectors: FloatArray, most: FloatArray | float) -> FloatArray:
    """Vectors (N, 3), the longer ones shortened to the bound."""
    lengths = np.linalg.norm(vectors, axis=1)
    shorter: FloatArray = vectors * np.minimum(1.0, most / np.where(lengths > 0.0, lengths, 1.0))[:, None]
    return shorter


def matrix_within(bound: float, kind: str, draws: np.random.Generator) -> FloatArray:
    """A matrix (3, 3) whose spectral norm is the bound, of a kind of `MATRICES`."""
    one, other = unit_vector(draws), unit_vector(draws)
    chosen = {
        "none": np.zeros((3, 3)),
        "longer": np.eye(3),
        "shorter": -np.eye(3),
        "turned": np.linalg.qr(draws.standard_normal((3, 3)))[0],
        "one axis": draws.choice([-1.0, 1.0]) * np.outer(one, one),
        "coupled": np.outer(one, other),
    }[kind]
    return bound * AT_BOUND * np.asarray(chosen)


def pattern(
    kind: str, attitudes: FloatArray, rates: FloatArray, draws: np.random.Generator, *, at_most: float = 1.0
) -> FloatArray:
    """Vectors (N, 3) in body axes, no longer than 1, of a kind of `PATTERNS`.

    Or "jitter": what a rate, over steps whose stamps are off by some time either way, seems to be more or less.
    """
    count, one = len(attitudes), unit_vector(draws)
    speeds = np.linalg.norm(rates, axis=1)[:, None]
    along = rates / np.where(speeds > 0.0, speeds, 1.0)
    if kind == "in space":
        found = np.einsum("nji,j->ni", attitudes, one)
    elif kind == "in the body":
        found = np.tile(one, (count, 1))
    elif kind == "along the rate":
        found = draws.choice([-1.0, 1.0]) * along
    elif kind == "across the rate":
        crossed = np.cross(along, np.einsum("nji,j->ni", attitudes, one))
        found = crossed / np.maximum(np.linalg.norm(crossed, axis=1), 1e-9)[:, None]
    elif kind == "alternating":
        found = np.einsum("nji,j->ni", attitudes, one) * np.where(np.arange(count) % 2, 1.0, -1.0)[:, None]
    elif kind == "any":
        found = limited(draws.standard_normal((count, 3)), 1.0)
    elif kind == "jitter":
        late = np.diff(draws.choice([-0.5, 0.5], count + 1))[:, None]
        found = late * rates / max(float(speeds.max(initial=0.0)), 1e-30)
    else:
        found = np.zeros((count, 3))
    return at_most * np.asarray(found)


def is_resting(times: FloatArray, rests: tuple[StatedRest, ...], first: float, more: float) -> NDArray[np.bool_]:
    """Times within a rest, which is longer by ``more`` on both sides; what comes before the first rest is one, too."""
    resting = np.zeros(len(times), dtype=np.bool_)
    for rest in rests:
        if rest.shows is None:
            resting |= (times >= rest.begin - more) & (times <= rest.end + more)
        else:
            # A rule finds it by whole pieces, of which it takes no more than is stated.
            resting |= times <= first + rest.end + more + rest.shows.duration_s
    # A rate is on a line from the last of these to the next.
    resting[1:] |= resting[:-1].copy()
    resting[:-1] |= resting[1:].copy()
    return resting


# --- how the body turns -----------------------------------------------------------------------------------------------


def draw_rates(
    kind: str, times: FloatArray, moves: FloatArray, gyro: StatedGyro, draws: np.random.Generator
) -> FloatArray:
    """Rates at times, rad/s, body axes, shape (N, 3): 0 where the body rests, and as fast as is stated at most."""
    one, other = unit_vector(draws), unit_vector(draws)
    third = np.cross(one, other)
    size = 10.0 ** draws.uniform(-1.5, 1.0)
    turn = 2.0 * math.pi * 10.0 ** draws.uniform(-1.0, 0.8) * times[:, None]
    if kind == "spin":
        rates = np.tile(size * one, (len(times), 1))
    elif kind == "coning":
        rates = size * (one * np.cos(turn) + third * np.sin(turn)) + draws.choice([0.0, size]) * other
    elif kind == "waves":
        rates = size * sum(
            draws.uniform(0.2, 1.0) * unit_vector(draws) * np.sin(draws.uniform(0.1, 1.0) * turn + draws.uniform(0, 6))
            for _ in range(3)
        )
    elif kind == "reversals":
        rates = size * one * np.sign(np.sin(turn)) + draws.choice([0.0, 0.3 * size]) * other
    elif kind == "jumps":
        rates = size * limited(draws.standard_normal((len(times), 3)), 1.0)
    else:
        rates = np.zeros((len(times), 3))
    rates = rates * moves[:, None]
    most = AT_BOUND * (gyro.bounds.largest_rate - gyro.noise_of_rate)
    if np.isfinite(most):
        rates = limited(rates, max(most, 0.0))
    return _as_smooth(rates, times, gyro)


def _as_smooth(rates: FloatArray, times: FloatArray, gyro: StatedGyro) -> FloatArray:
    """Rates that change no faster than is stated: all of them are smaller else."""
    stated = gyro.between if gyro.between > 0.0 else gyro.bounds.angular_acceleration
    if not np.isfinite(stated):
        return rates
    change = float((np.linalg.norm(np.diff(rates, axis=0), axis=1) / np.diff(times)).max(initial=0.0))
    return rates if change <= stated * AT_BOUND else rates * (stated * AT_BOUND / change)


# --- errors -----------------------------------------------------------------------------------------------------------


def draw_gyro(
    stated: Stated,
    times: FloatArray,
    kept: NDArray[np.bool_],
    more_rest: float,
    kinds: dict[str, str],
    draws: np.random.Generator,
    left: FloatArray | None = None,
) -> Shown:
    """A motion and a gyro's samples of it.

    Parameters
    ----------
    stated : Stated
    times : (M,) array
        s; samples might be here, and some before and behind the log.
    kept : (M,) array of bool
        Where they are.
    more_rest : float
        How much longer a rest of the body is on both sides than what sensors show of it, s.
    kinds : dict
        Of the motion (``turns``), noise, bias and scale error.
    draws : numpy.random.Generator
    left : (3,) array, optional
        What is left of an estimated bias at the log's first row, rad/s, if a start says what it may be.

    Returns
    -------
    Shown
    """
    gyro, bounds = stated.gyro, stated.gyro.bounds
    first = float(times[kept][0])
    resting = is_resting(times, stated.rests, first, more_rest)
    base = draw_rates(kinds["turns"], times, _moving(resting, times, kinds, draws), gyro, draws)
    at = np.flatnonzero(kept)
    longest = gyro.interval if gyro.interval is not None else 1.5 * float(np.median(np.diff(times[kept])))
    # Stamps are rounded: what is as long as this is on lines, whether it is taken for a gap or not.
    longest *= 1.0 + 1e-6
    steps = [(begin, end) for begin, end in itertools.pairwise(at.tolist()) if end > begin + 1]
    lost = [(begin, end) for begin, end in steps if times[end] - times[begin] <= longest]
    _fill_in(base, times, lost, gyro)
    for begin, end in steps:
        if times[end] - times[begin] > longest:
            _turn_in_gap(base, times, begin, end, gyro, draws)
    attitudes = Turning(times, base[:-1], base[1:]).attitudes(times)
    # A corrected sample has the scale error.
    shows = np.linalg.solve(gyro.correction, np.eye(3) + matrix_within(bounds.scale_error, kinds["scale"], draws))
    rested = first + max((rest.end for rest in stated.rests if rest.shows is not None), default=-math.inf)
    biases, drifts = _biases(gyro, kinds["bias"], times, attitudes, base, (first, rested), draws)
    if left is not None:
        biases = np.tile(left, (len(times), 1))
    at_samples, in_steps = _noise(gyro, kinds["noise"], times, attitudes, base, biases + drifts, resting, draws)
    undo = np.asarray(np.linalg.inv(shows), dtype=np.float64)
    if np.isfinite(bounds.noise_turn):
        _limit_noise_turn(at_samples, in_steps, times, base, undo, gyro)
    raw = gyro.known_bias
    for rest in stated.rests:
        if rest.shows is not None:
            raw = _shown_in_rest(rest, times, kept, biases, at_samples, gyro, draws)
            # What drifts is not hidden: the mean over the rest is that of its middle.
            drifts -= drifts[kept & (times <= first + (1.0 + 1e-9) * rest.end)].mean(axis=0)
    biases = biases + drifts
    for values in (biases, at_samples):
        _fill_in(values, times, lost, gyro)
    shown = base @ shows.T + raw + biases + at_samples
    begins, ends = base[:-1] - in_steps @ undo.T, base[1:] - in_steps @ undo.T
    if gyro.holds and gyro.between == 0.0:
        ends = begins.copy()
    if gyro.between > 0.0:
        return Shown(shown[at], biases[at], _with_tents(times, base, gyro, resting, draws))
    return Shown(shown[at], biases[at], Turning(times, begins, ends))


def _moving(
    resting: NDArray[np.bool_], times: FloatArray, kinds: dict[str, str], draws: np.random.Generator
) -> FloatArray:
    """1 where the body turns, 0 where it rests; in some logs with pauses beside those that are stated."""
    moves = np.where(resting, 0.0, 1.0)
    if kinds["pauses"] == "some":
        begin = draws.uniform(times[0], times[-1], 3)
        for one in begin:
            moves[(times >= one) & (times <= one + draws.uniform(0.2, 3.0))] = 0.0
    if kinds["ramps"] == "slow":
        step = float(np.median(np.diff(times)))
        width = max(int(draws.uniform(0.1, 1.0) / step), 1)
        risen = moves.copy()
        for i in range(1, len(risen)):
            risen[i] = min(moves[i], risen[i - 1] + 1.0 / width)
        moves = risen
    return moves


def _fill_in(values: FloatArray, times: FloatArray, lost: list[tuple[int, int]], gyro: StatedGyro) -> None:
    """Where samples are lost, but bounds hold across: what was there is on a line, or as the sample before says."""
    for begin, end in lost:
        share = ((times[begin + 1 : end] - times[begin]) / (times[end] - times[begin]))[:, None]
        share = np.zeros_like(share) if gyro.holds and gyro.between == 0.0 else share
        values[begin + 1 : end] = values[begin] + share * (values[end] - values[begin])


def _turn_in_gap(
    base: FloatArray, times: FloatArray, begin: int, end: int, gyro: StatedGyro, draws: np.random.Generator
) -> None:
    """In some gaps: as fast as is stated, or as far from the samples around it as the rate can change."""
    kind, bounds = draws.choice(["as before", "as fast", "as fast"]), gyro.bounds
    most = AT_BOUND * (bounds.largest_rate - gyro.noise_of_rate)
    if kind == "as before" or gyro.between > 0.0 or (np.isinf(bounds.angular_acceleration) and np.isinf(most)):
        return
    axis, inside = unit_vector(draws), slice(begin + 1, end)
    if np.isinf(bounds.angular_acceleration):
        base[inside] = max(most, 0.0) * axis
        return
    # Along a line from end to end, and away from it and back, no faster than is stated.
    span = times[end] - times[begin]
    change = (base[end] - base[begin]) / span
    slope = max(AT_BOUND * bounds.angular_acceleration - float(np.linalg.norm(change)), 0.0)
    since, left = times[inside] - times[begin], times[end] - times[inside]
    away = base[begin] + since[:, None] * change + slope * np.minimum(since, left)[:, None] * axis
    base[inside] = limited(away, max(most, 0.0)) if np.isfinite(most) else away


def _biases(
    gyro: StatedGyro,
    kind: str,
    times: FloatArray,
    attitudes: FloatArray,
    rates: FloatArray,
    known: tuple[float, float],
    draws: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """What is left of the bias when it is known, and how it drifts from there, rad/s, shape (M, 3) each.

    `known` is when the log begins, s, and until when a rest shows the bias, in which next to nothing is left of it.
    """
    since = np.maximum(times - known[0], 0.0)[:, None]
    drifts = gyro.bounds.drift * AT_BOUND * since * unit_vector(draws)
    if gyro.is_estimated:
        share = draws.choice([0.0, 0.5, 1.0])
        left = share * gyro.bounds.bias * AT_BOUND * np.tile(unit_vector(draws), (len(times), 1))
        return np.asarray(left), drifts
    most, shape = gyro.bounds.bias * AT_BOUND, pattern(kind, attitudes, rates, draws)
    if not gyro.bounds.is_steady:
        return most * shape, drifts
    change = min(gyro.bounds.bias_change * AT_BOUND, 2.0 * most)
    # Within a window what changes has this part of the change, and what it changes about moves by the rest.
    aside = 0.5 * change * float(draws.choice([0.5, 1.0]))
    moved = np.ones(len(times))
    if most > aside and np.isfinite(known[1]):
        window = 1.0 + 1e-6 + 2.0 * gyro.increment_over
        moved = np.clip((change - 2.0 * aside) / (most - aside) * (times - known[1]) / window, 0.0, 1.0)
    return (most - aside) * moved[:, None] * unit_vector(draws) + aside * shape, drifts


def _noise(
    gyro: StatedGyro,
    kind: str,
    times: FloatArray,
    attitudes: FloatArray,
    rates: FloatArray,
    biases: FloatArray,
    resting: NDArray[np.bool_],
    draws: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Noise of samples (M, 3), on lines between them, and in steps (M - 1, 3), that jumps at samples; rad/s.

    Together they are within the bound at every time, and their integral within the increment.
    """
    most = gyro.bounds.noise * AT_BOUND
    if gyro.holds:  # the bias goes on while the sample is held
        most = max(most - float(np.linalg.norm(np.diff(biases, axis=0), axis=1).max(initial=0.0)), 0.0)
    if np.isfinite(gyro.bounds.angular_acceleration):  # it is a part of the true rate, too
        most *= gyro.bounds.noise / gyro.noise_of_rate if gyro.bounds.noise > 0.0 else 0.0
    share = 1.0 if gyro.between > 0.0 else float(draws.choice([0.0, 0.0, 0.5, 1.0]))
    drawn = pattern(kind, attitudes, rates, draws)
    increment = gyro.bounds.increment * AT_BOUND
    rests = resting[:-1] | resting[1:]
    if np.isinf(increment):
        at_samples, in_steps = share * most * drawn, (1.0 - share) * most * drawn[:-1]
    else:
        at_samples, in_steps = _within_increment(drawn, times, most, increment, share, gyro.increment_over, draws)
    at_samples[resting], in_steps[rests] = 0.0, 0.0
    if np.isfinite(increment):
        reached = _largest_integral(times, at_samples, in_steps, gyro.increment_over)
        if reached > increment:
            at_samples, in_steps = at_samples * increment / reached, in_steps * increment / reached
    return at_samples, in_steps


def _limit_noise_turn(
    at_samples: FloatArray,
    in_steps: FloatArray,
    times: FloatArray,
    base: FloatArray,
    undo: FloatArray,
    gyro: StatedGyro,
) -> None:
    """Make noise smaller, as long as it turns further by itself than is stated."""
    while True:
        hidden, shown = in_steps @ undo.T, at_samples @ undo.T
        true = Turning(times, base[:-1] - hidden, base[1:] - hidden)
        with_noise = Turning(times, base[:-1] + shown[:-1], base[1:] + shown[1:])
        share = share_of_noise_turn(times, true, with_noise, gyro.bounds, gyro.increment_over)
        if share <= AT_BOUND:
            return
        at_samples *= 0.999 * AT_BOUND / share
        in_steps *= 0.999 * AT_BOUND / share


def _within_increment(
    drawn: FloatArray,
    times: FloatArray,
    most: float,
    increment: float,
    share: float,
    over: float,
    draws: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    if share == 1.0:
        return most * drawn, np.zeros((len(drawn) - 1, 3))
    if draws.random() < 0.4:
        # As if it were a bias, for as long as the increment is stated.
        return np.zeros_like(drawn), min(most, increment / max(over, 1e-9)) * drawn[:-1]
    # Its integral goes where the pattern says, as fast as the noise lets it.
    integral, steps = np.zeros(3), np.diff(times)
    in_steps = np.empty((len(steps), 3))
    for i, step in enumerate(steps):
        change = 0.5 * increment * drawn[i] - integral
        length = float(np.linalg.norm(change))
        change *= min(1.0, most * step / length) if length > 0.0 else 0.0
        integral = integral + change
        in_steps[i] = change / step
    return np.zeros_like(drawn), in_steps


def _largest_integral(times: FloatArray, at_samples: FloatArray, in_steps: FloatArray, over: float) -> float:
    """The largest integral of noise over a window of at most ``over``, rad."""
    steps = np.diff(times)[:, None]
    sums = np.concatenate(
        [np.zeros((1, 3)), np.cumsum(steps * (in_steps + 0.5 * (at_samples[1:] + at_samples[:-1])), 0)]
    )
    largest, lag = 0.0, 1
    while lag < len(times) and float((times[lag:] - times[:-lag]).min()) <= over:
        largest = max(largest, float(np.linalg.norm(sums[lag:] - sums[:-lag], axis=1).max()))
        lag += 1
    return largest


def _shown_in_rest(
    rest: StatedRest,
    times: FloatArray,
    kept: NDArray[np.bool_],
    biases: FloatArray,
    at_samples: FloatArray,
    gyro: StatedGyro,
    draws: np.random.Generator,
) -> FloatArray:
    """The bias that a rest shows in the mean, rad/s, shape (3,); changes noise there so that it is that mean.

    The body does not turn, so that samples are the bias and noise; what is left of the bias is hidden by noise there.
    """
    assert rest.shows is not None
    first = float(times[kept][0])
    rows = (times <= first + (1.0 + 1e-9) * rest.end) & (times >= first)
    # What is corrected shows the rest.
    deviation = math.radians(rest.shows.rate_deviation_deg_per_s) / gyro.stretch
    most = min(gyro.bounds.noise * AT_BOUND, 0.8 * deviation)
    hidden = min(0.5 * most, 0.4 * gyro.bounds.increment / rest.end, gyro.bounds.bias)
    inside = (times <= first + rest.end) | (times < first)
    biases[inside] = limited(biases[inside], hidden)
    wobble = np.where(np.arange(len(times)) % 2, 1.0, -1.0)[:, None] * (most - hidden) * unit_vector(draws)
    at_samples[rows] = wobble[rows]
    shown = kept & rows
    at_samples[rows] -= mean_over_time(times[shown], (biases + at_samples)[shown])
    at_samples[rows] = limited(at_samples[rows], gyro.bounds.noise * AT_BOUND)
    largest = math.radians(rest.shows.rate_deg_per_s) / gyro.stretch
    raw: FloatArray = 0.8 * largest * draws.random() * unit_vector(draws)
    return raw


def _with_tents(
    times: FloatArray, base: FloatArray, gyro: StatedGyro, resting: NDArray[np.bool_], draws: np.random.Generator
) -> Turning:
    """A motion whose rate leaves the line between two samples as fast as it may, there and back."""
    steps = np.diff(times)
    slopes = np.linalg.norm(np.diff(base, axis=0), axis=1) / steps
    heights = 0.5 * steps * np.maximum(gyro.between * AT_BOUND - slopes, 0.0)
    heights[resting[:-1] | resting[1:]] = 0.0
    heights = np.minimum(heights, max(0.0, gyro.bounds.largest_rate - np.linalg.norm(base, axis=1).max()))
    middle = 0.5 * (base[1:] + base[:-1]) + heights[:, None] * unit_vector(draws) * draws.choice([-1.0, 1.0])
    knots, rates = np.empty(2 * len(times) - 1), np.empty((2 * len(times) - 1, 3))
    knots[::2], knots[1::2] = times, 0.5 * (times[1:] + times[:-1])
    rates[::2], rates[1::2] = base, middle
    return Turning(knots, rates[:-1], rates[1:])
