"""What a multiplicative Kalman filter and the sets of the guaranteed run make of a log; theory, section 18.10.

The filter begins with a set of the run, leaves out what the run left out, and begins anew where that did.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.statements import VelocityWindowBound
from elliptude.estimation.best.motions import LEAST, Motion, motion_of
from elliptude.estimation.best.multiplicative_filter import MultiplicativeFilter
from elliptude.estimation.guaranteed_run import CONDITIONAL, GuaranteedRun
from elliptude.results import GuaranteedLog
from elliptude.typing import FloatArray

# A direction that may be further off than this counts for nothing, rad.
_NEXT_TO_NOTHING = 0.75 * np.pi
# No filter begins with a set that reaches further than this: such errors are not linear, rad.
_WIDEST = 1.0


@dataclass(frozen=True, eq=False)
class _Measured:
    """What is measured at each of N rows, without what the run left out."""

    directions: FloatArray
    """Zero where nothing is measured, shape (N, m, 3)."""
    references: FloatArray
    """Unit vectors, shape (N, m, 3)."""
    weights: FloatArray
    """Inverse variances, zero where nothing is measured, rad⁻², shape (N, m)."""
    rates: FloatArray
    """rad/s, zero where nothing is measured, shape (N, 3)."""
    has_rate: NDArray[np.bool_]
    """Shape (N,)."""
    rate_weight: FloatArray
    """The inverse of the rates' covariance, shape (3, 3)."""

    def expected_squares(self) -> FloatArray:
        """The mean of what `MultiplicativeFilter.update` returns at each row, if errors are as they are taken."""
        squares: FloatArray = 2.0 * (self.weights > 0.0).sum(axis=1) + 3.0 * self.has_rate
        return squares

    def update(self, estimate: MultiplicativeFilter, row: int) -> float:
        """Fuse what a row measured; the square of what was not expected."""
        rate = (self.rates[row], self.rate_weight) if self.has_rate[row] else ()
        return float(estimate.update(self.directions[row], self.references[row], self.weights[row], *rate))

    @staticmethod
    def of(run: GuaranteedRun, configuration: Configuration) -> "_Measured":
        """What a run's log measured."""
        rows, dropped, count = run.rows, run.sets.dropped, len(run.rows.names)
        with np.errstate(invalid="ignore"):
            counts = (rows.angles < _NEXT_TO_NOTHING) & ~dropped[:, :count]
        counts = counts & np.isfinite(rows.directions).all(axis=2)
        weights = np.zeros(rows.angles.shape)
        # Each error is uniform in a ball of rotation vectors.
        weights[counts] = 5.0 / np.maximum(rows.angles[counts], LEAST) ** 2
        has_rate, rates = np.zeros(len(weights), dtype=np.bool_), np.zeros((len(weights), 3))
        rate_weight = np.zeros((3, 3))
        if configuration.rate is not None:
            assert run.log.rates is not None
            has_rate = np.isfinite(run.log.rates).all(axis=1) & ~dropped[:, count]
            rates[has_rate] = run.log.rates[has_rate]
            rate_weight = np.asarray(
                np.linalg.inv(configuration.rate.bound() / 5.0 + LEAST**2 * np.eye(3)), dtype=np.float64
            )
        directions = np.where(counts[:, :, None], rows.directions, 0.0)
        references = rows.references / np.linalg.norm(rows.references, axis=2, keepdims=True)
        return _Measured(directions, references, weights, rates, has_rate, rate_weight)


@dataclass(frozen=True, eq=False)
class KalmanLog:
    """Estimates at N rows, after each; NaN where there is none."""

    attitudes: FloatArray
    """From body to reference axes, shape (N, 3, 3)."""
    vectors: FloatArray
    """Angular velocity or gyro bias, rad/s, body axes, shape (N, 3)."""
    covariances: FloatArray
    """Shape (N, 6, 6)."""
    begins: NDArray[np.bool_]
    """Rows where the filter began with a set, shape (N,)."""
    scales: FloatArray
    """By how much errors so far were larger than expected, in the square, shape (N,); 1 where they were not."""

    @staticmethod
    def empty(count: int) -> "KalmanLog":
        """So many rows without an estimate."""
        attitudes, vectors, covariances = (np.full((count, *shape), np.nan) for shape in ((3, 3), (3,), (6, 6)))
        return KalmanLog(attitudes, vectors, covariances, np.zeros(count, dtype=np.bool_), np.ones(count))

    def put(self, row: int, estimate: MultiplicativeFilter) -> None:
        """Take down the estimate of a row."""
        self.attitudes[row], self.vectors[row] = estimate.attitude, estimate.vector
        self.covariances[row] = estimate.covariance


@dataclass(frozen=True, eq=False)
class Predictions:
    """What a Kalman filter knew of N rows before their measurements; NaN where it began."""

    transitions: FloatArray
    """Φ from the row before, shape (N, 6, 6)."""
    log: KalmanLog

    @staticmethod
    def empty(count: int) -> "Predictions":
        """So many rows without a prediction."""
        return Predictions(np.full((count, 6, 6), np.nan), KalmanLog.empty(count))

    def put(self, row: int, transition: FloatArray, estimate: MultiplicativeFilter) -> None:
        """Take down what the filter knows of a row before its measurements."""
        self.transitions[row] = transition
        self.log.put(row, estimate)


def why_not_kalman(configuration: Configuration) -> str | None:
    """What keeps the Kalman filter from a log, by what is stated of it; None if nothing does."""
    if configuration.rule is not None:
        return "the rule's directions are means over windows, and the Kalman filter takes their errors for independent"
    for one in configuration.directions:
        if isinstance(one.bound_from, VelocityWindowBound):
            return f"{one.name!r} is a mean over windows, and the Kalman filter takes its errors for independent"
    return None


@np.errstate(over="ignore", invalid="ignore")
def kalman_log(run: GuaranteedRun, configuration: Configuration, predictions: Predictions | None = None) -> KalmanLog:
    """What a multiplicative Kalman filter makes of the log as the run sees it, row by row from the rows before alone.

    Parameters
    ----------
    run : GuaranteedRun
        Not a smoothed one.
    configuration : Configuration
    predictions : Predictions, optional
        Empty ones, to be filled.

    Returns
    -------
    KalmanLog
    """
    sets, motion = run.sets, motion_of(run, configuration)
    measured = _Measured.of(run, configuration)
    expected, may_begin, must_begin = measured.expected_squares(), _may_begin(sets), _must_begin(sets)
    log = KalmanLog.empty(len(sets.times))
    estimate: MultiplicativeFilter | None = None
    # The set that it begins with counts as what was expected.
    found = of_all = 6.0
    for row in np.flatnonzero(np.isfinite(sets.shapes[:, 0, 0])).tolist():
        square = None
        if estimate is not None and not must_begin[row]:
            square = _carried(estimate, row, motion, measured if expected[row] > 0.0 else None, predictions)
        if square is None:
            estimate = _beginning(sets, motion, row) if may_begin[row] else None
            log.begins[row], found, of_all = estimate is not None, 6.0, 6.0
        else:
            found, of_all = found + square, of_all + expected[row]
        if estimate is not None:
            log.put(row, estimate)
            log.scales[row] = max(found / of_all, 1.0)
    return log


def _carried(
    estimate: MultiplicativeFilter,
    row: int,
    motion: Motion,
    measured: _Measured | None,
    predictions: Predictions | None,
) -> float | None:
    """Carry an estimate on to a row, and fuse what is measured there, if anything is.

    Returns
    -------
    float or None
        The square of what was not expected; None if the motion is not known, or not followed.
    """
    try:
        transition = motion.carry(estimate, row)
        if transition is None:
            return None
        if predictions is not None:
            predictions.put(row, transition, estimate)
        return 0.0 if measured is None else measured.update(estimate, row)
    except ValueError:  # numbers overflow, or the body turns too fast for its steps
        return None


def smoothed(log: KalmanLog, predictions: Predictions) -> KalmanLog:
    """The same from the rows after, too: the smoother of Rauch, Tung and Striebel, (18.46).

    Parameters
    ----------
    log : KalmanLog
    predictions : Predictions
        What the filter knew before each row's measurements.

    Returns
    -------
    KalmanLog
    """
    attitudes, vectors, covariances = log.attitudes.copy(), log.vectors.copy(), log.covariances.copy()
    found = KalmanLog(attitudes, vectors, covariances, log.begins, log.scales.copy())
    before = predictions.log
    followed = np.isfinite(predictions.transitions[1:, 0, 0]) & ~log.begins[1:]
    for row in np.flatnonzero(followed)[::-1].tolist():
        transition, predicted = predictions.transitions[row + 1], before.covariances[row + 1]
        gain = np.linalg.solve(predicted, transition @ log.covariances[row]).T
        error = np.empty(6)
        error[:3] = elliptude.log(before.attitudes[row + 1].T @ found.attitudes[row + 1])
        error[3:] = found.vectors[row + 1] - before.vectors[row + 1]
        estimate = MultiplicativeFilter(log.attitudes[row], log.vectors[row], log.covariances[row])
        less = gain @ (predicted - found.covariances[row + 1]) @ gain.T
        estimate.move(gain @ error, log.covariances[row] - less)
        found.put(row, estimate)
        found.scales[row] = found.scales[row + 1]
    return found


def _beginning(sets: GuaranteedLog, motion: Motion, row: int) -> MultiplicativeFilter:
    """The center of a set, with the covariance of what is uniform in it."""
    vector = sets.vectors[row] if motion.dimension == 6 else np.zeros(3)
    covariance = _shapes(sets, motion, np.array([row]))[0] / (motion.dimension + 2.0)
    return MultiplicativeFilter(sets.attitudes[row], vector, covariance + motion.constant + LEAST**2 * np.eye(6))


def _shapes(sets: GuaranteedLog, motion: Motion, rows: NDArray[np.intp]) -> FloatArray:
    """Shapes of sets, of the attitude alone if that is all that is estimated, (n, 6, 6)."""
    estimated = np.arange(6) < motion.dimension
    return np.where(estimated[:, None] & estimated, sets.shapes[rows], 0.0)


def _may_begin(sets: GuaranteedLog) -> NDArray[np.bool_]:
    """Rows with a set that does not reach too far."""
    may_begin = np.isfinite(sets.shapes[:, 0, 0])
    may_begin[may_begin] = np.linalg.eigvalsh(sets.shapes[may_begin, :3, :3])[:, -1] <= _WIDEST**2
    return may_begin


def _must_begin(sets: GuaranteedLog) -> NDArray[np.bool_]:
    """Rows where the run has a set anew: after none, or from the measurements alone after a contradiction."""
    has_set = np.isfinite(sets.shapes[:, 0, 0])
    before, doubted = np.zeros_like(has_set), np.zeros_like(has_set)
    before[1:], doubted[1:] = has_set[:-1], sets.claims[:-1] == CONDITIONAL
    with np.errstate(invalid="ignore"):
        doubted |= sets.margins < 0.0
    begins: NDArray[np.bool_] = has_set & (~before | (~sets.prediction_used & doubted))
    return begins


def kalman_attitudes(run: GuaranteedRun, configuration: Configuration) -> FloatArray:
    """The estimates of a Kalman filter, drawn to the centers of the sets by as much as these say, (18.45).

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration

    Returns
    -------
    (N, 3, 3) array
        From body to reference axes; NaN where there is no set, and before the first that is not too wide.
    """
    if run.forward is None:
        log = kalman_log(run, configuration)
    else:
        predictions = Predictions.empty(len(run.sets.times))
        log = smoothed(kalman_log(run.forward, configuration, predictions), predictions)
    motion = motion_of(run, configuration)
    attitudes = log.attitudes.copy()
    rows = np.flatnonzero(np.isfinite(attitudes[:, 0, 0]) & np.isfinite(run.sets.shapes[:, 0, 0]))
    covariances = log.scales[rows, None, None] * log.covariances[rows]
    n = motion.dimension
    # The set is between an ellipsoid and that ellipsoid made n times smaller: its middle, and uniform in that.
    of_center = (_shapes(run.sets, motion, rows) / (n * (n + 2.0)) + motion.constant)[:, :n, :n]
    offsets = np.zeros((len(rows), 6))
    offsets[:, :3] = elliptude.log(attitudes[rows].swapaxes(1, 2) @ run.sets.attitudes[rows])
    offsets[:, 3:] = run.sets.vectors[rows] - log.vectors[rows]
    of_filter = covariances[:, :n, :n]
    drawn = of_filter @ np.linalg.solve(of_filter + of_center, offsets[:, :n, None])
    attitudes[rows] = attitudes[rows] @ elliptude.exp(drawn[:, :3, 0])
    return attitudes
