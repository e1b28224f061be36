"""From a log and a configuration to a table of estimates with their bounds, and a summary.

The estimator sees only the measurements. The truth in the log is compared with the estimates afterwards.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import GivenStart
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation import guaranteed_result
from elliptude.estimation.best.choice import Best, best_estimate
from elliptude.estimation.containment import compare
from elliptude.estimation.gaps import Bridged
from elliptude.estimation.guaranteed_run import GuaranteedRun, run_guaranteed
from elliptude.estimation.questions.answers import Answers, answers_of
from elliptude.estimation.summary import Summary
from elliptude.io import tables
from elliptude.io.background import ahead
from elliptude.io.tables import Result, names_of_chosen
from elliptude.logs import log as logs
from elliptude.logs.log import Log, interval_rates
from elliptude.results import FilterLog

Guaranteed: TypeAlias = Callable[[Log, Configuration], GuaranteedRun]
"""What makes a run in the guaranteed mode."""
Answering: TypeAlias = Callable[[GuaranteedRun, Configuration], Answers | None]
"""What answers a configuration's questions to such a run; None if it asks none."""
_UPDATED, _REFUSED = 0, 2  # FilterLog.outcomes


@dataclass(frozen=True, eq=False)
class Estimation:
    """The results of a log, and how they were found."""

    result: Result
    vector_is_compared: bool
    """Whether the form is that of [ζ; δω], or of ζ alone in the projection of the set, as nothing else is known."""
    elapsed: float
    """Time for filter and bounds, s."""
    guaranteed: GuaranteedRun | None = None
    """The run of the guaranteed filter, in that mode."""
    bridged: Bridged | None = None
    """Gaps of the gyro, in the modes of first order."""
    best: Best | None = None
    """The estimate beside the sets, in the guaranteed mode."""
    answers: Answers | None = None
    """What the configuration asks of each row by itself, in the guaranteed mode."""


def estimate(
    log: Log,
    configuration: Configuration,
    guaranteed: Guaranteed = run_guaranteed,
    answering: Answering = answers_of,
) -> Estimation:
    """Run the filter over a log.

    Parameters
    ----------
    log : Log
    configuration : Configuration
    guaranteed : callable
        What makes the run in the guaranteed mode.
    answering : callable
        What answers the configuration's questions to that run.

    Returns
    -------
    Estimation

    Raises
    ------
    InconsistentMeasurement
        If sets do not meet and the configuration does not say to skip them.
    ValueError
        If no row can be the start, the log does not fit the filter, or the set or what it is compared with is not
        finite.
    """
    estimator = PieceEstimator(configuration, guaranteed, answering)
    (result,) = estimator.run([log])
    return Estimation(
        result=result,
        vector_is_compared=estimator.vector_is_compared,
        elapsed=estimator.elapsed,
        guaranteed=estimator.guaranteed,
        bridged=estimator.bridged,
        best=estimator.best,
        answers=estimator.answers,
    )


class PieceEstimator:
    """A filter that goes through a log piece by piece, so that memory does not grow with the log.

    Its results for the pieces of `elliptude.logs.read_pieces` are together, up to rounding, what
    `estimate` makes of the whole log. The guaranteed mode joins the pieces first: its bounds come from windows, or
    follow from the whole log.
    """

    def __init__(
        self,
        configuration: Configuration,
        guaranteed: Guaranteed = run_guaranteed,
        answering: Answering = answers_of,
    ) -> None:
        self._configuration = configuration
        self._run_guaranteed = guaranteed
        self._answers_of = answering
        self._filter: elliptude.AttitudeFilter | None = None
        self._last: Log | None = None
        self.elapsed = 0.0
        """Time for filter and bounds, s, which may overlap; without reading."""
        self.vector_is_compared = False
        """As in `Estimation`, for the rows so far."""
        self.guaranteed: GuaranteedRun | None = None
        """As in `Estimation`, after the last row."""
        self.best: Best | None = None
        """As in `Estimation`, after the last row."""
        self.answers: Answers | None = None
        """As in `Estimation`, after the last row."""
        self.bridged = Bridged(configuration)
        """Gaps of the gyro so far, in the modes of first order."""

    def run(self, pieces: Iterable[Log]) -> Iterator[Result]:
        """Go through the pieces of a log.

        Parameters
        ----------
        pieces : iterable of Log
            The rows of each come after those of the one before.

        Yields
        ------
        Result
            The result of a piece's rows, from the start on.

        Raises
        ------
        InconsistentMeasurement, ValueError
            As `estimate`.
        """
        if self._configuration.estimator.mode == "guaranteed":
            yield self._take_whole(logs.joined(list(pieces)))
            return
        for filtered in ahead(self._filtered(pieces)):
            begin = time.perf_counter()
            result = _results(self._configuration, *filtered)
            self.elapsed += time.perf_counter() - begin
            yield result
        if self._filter is None:
            raise _no_start(self._configuration)

    def _take_whole(self, log: Log) -> Result:
        """The results of all rows, in the guaranteed mode."""
        begin = time.perf_counter()
        with _placed(log):
            self.guaranteed = self._run_guaranteed(log, self._configuration)
        self.best = best_estimate(self.guaranteed, self._configuration)
        self.answers = self._answers_of(self.guaranteed, self._configuration)
        result = guaranteed_result.result_of(self.guaranteed, self._configuration, self.best, self.answers)
        self.elapsed += time.perf_counter() - begin
        is_of_rows = log.true_vectors is not None and log.true_sampled is None
        self.vector_is_compared = is_of_rows and self._configuration.compares_vector
        return result

    def _filtered(self, pieces: Iterable[Log]) -> Iterator[tuple[Log, FilterLog, bool]]:
        """Rows, the filter's log of them, and whether the first is the start."""
        for piece in pieces:
            _require_truth_of_rows(piece, self._configuration)
            begin = time.perf_counter()
            self.bridged.add(piece)
            filtered = self._take(piece)
            self.elapsed += time.perf_counter() - begin
            self.vector_is_compared = piece.true_vectors is not None and self._configuration.compares_vector
            if filtered is not None:
                yield filtered

    def _take(self, log: Log) -> tuple[Log, FilterLog, bool] | None:
        """The next rows from the start on, or None before it."""
        configuration = self._configuration
        is_gyro = isinstance(configuration.flow, GyroFlow)
        starts_here = False
        if self._filter is None:
            if not isinstance(configuration.start, GivenStart):
                complete = _complete_rows(log, configuration)
                if not complete.any():
                    return None
                log, starts_here = log.since(int(np.argmax(complete))), True
            self._filter = _filter(log, configuration)
        # A gyro's step to the first of these rows begins at the last of those before.
        whole = log if self._last is None else logs.joined([self._last, log])
        directions, rates = whole.directions, whole.rates
        if starts_here or self._last is not None:
            # The start has all that the first row says, and a row of the piece before has been used: neither may
            # count twice.
            directions = directions.copy()
            directions[0] = np.nan
            if rates is not None and not is_gyro:
                rates = rates.copy()
                rates[0] = np.nan
        filtered = _run(self._filter, replace(whole, directions=directions, rates=rates), configuration)
        if self._last is not None:
            filtered = filtered.since(1)
        if is_gyro:
            self._last = log.since(len(log.times) - 1)
        endless = ~np.isfinite(filtered.shapes).all(axis=(1, 2))
        if endless.any():
            at = log.times[np.argmax(endless)]
            raise ValueError(f"the set has grown beyond all numbers by {at:.6f} s: too long without a measurement")
        return log, filtered, starts_here


def _require_truth_of_rows(log: Log, configuration: Configuration) -> None:
    """Refuse a truth of other times than its rows: in these modes nothing bounds how far the body turns in between."""
    if (sampled := log.true_sampled) is not None:
        moved = float(np.abs(sampled - log.times).max())
        raise ValueError(
            f"truth: timing.same_within_s moves its stamps by up to {moved:.3g} s, and nothing bounds how far the body "
            f"turns meanwhile in estimator.mode = {configuration.estimator.mode!r}: state less, so that each stamp has "
            "a row, or take the guaranteed mode, which counts that turn"
        )


def _filter(log: Log, configuration: Configuration) -> elliptude.AttitudeFilter:
    """The filter at the log's first time."""
    settings = configuration.estimator
    return elliptude.AttitudeFilter(
        configuration.flow.build(log.origin),
        _start(log, configuration),
        time=float(log.times[0]),
        mode=settings.mode,
        criterion=settings.criterion,
        weight=settings.weight(),
    )


def _run(attitude_filter: elliptude.AttitudeFilter, log: Log, configuration: Configuration) -> FilterLog:
    arguments: dict[str, Any] = {"on_inconsistent": configuration.estimator.when_sets_do_not_meet}
    if configuration.directions:
        # If nothing is measured, the reference does not matter, but must be finite.
        references = np.where(np.isfinite(log.references), log.references, [1.0, 0.0, 0.0])
        bounds = np.array([sensor.bound() for sensor in configuration.directions])
        weights = np.array([sensor.weight for sensor in configuration.directions])
        arguments |= {"directions": log.directions, "reference": references, "bounds": bounds, "weights": weights}
    flow = configuration.flow
    if isinstance(flow, GyroFlow):
        assert log.rates is not None
        arguments["gyro"] = interval_rates(log.rates) if flow.interval_rate == "mean_of_ends" else log.rates
    elif configuration.rate is not None:
        arguments |= {"angular_velocity": log.rates, "rate_bound": configuration.rate.bound()}
    if log.control_torques is not None:
        arguments["control_torque"] = log.control_torques
    with _placed(log):
        return attitude_filter.run(log.times, **arguments)


@contextmanager
def _placed(log: Log) -> Iterator[None]:
    """Put the place in the file into the messages of errors of a row."""
    try:
        yield
    except (elliptude.InconsistentMeasurement, elliptude.RowError) as error:
        if error.row is None:
            raise
        raise error.at(log.place(error.row)) from error


def first_complete_row(log: Log, configuration: Configuration) -> int:
    """The first row that can be the start: with two directions or more, and the rate if it is measured.

    Raises
    ------
    ValueError
        If there is none.
    """
    complete = _complete_rows(log, configuration)
    if not complete.any():
        raise _no_start(configuration)
    return int(np.argmax(complete))


def _complete_rows(log: Log, configuration: Configuration) -> NDArray[np.bool_]:
    complete: NDArray[np.bool_] = np.isfinite(log.directions[:, :, 0]).sum(axis=1) >= 2
    if configuration.rate is not None:
        assert log.rates is not None
        complete &= np.isfinite(log.rates[:, 0])
    return complete


def _no_start(configuration: Configuration) -> ValueError:
    """The error if no row of a log can be the start."""
    rate = " and the rate" if configuration.rate is not None else ""
    return ValueError(f"no row has two directions{rate}: there is no measurement to start from")


def _start(log: Log, configuration: Configuration) -> elliptude.StateEllipsoid:
    """The set at the log's first time."""
    start, flow = configuration.start, configuration.flow
    known_bias = flow.known_bias() if isinstance(flow, GyroFlow) else None
    if isinstance(start, GivenStart):
        return start.build(known_bias)
    assert start is not None  # the configuration's check
    sensors = configuration.directions
    there = np.flatnonzero(np.isfinite(log.directions[0, :, 0]))
    directions, references = log.directions[0, there], log.references[0, there]
    bounds = np.array([sensors[i].bound() for i in there])
    weights = np.array([sensors[i].weight for i in there])
    if known_bias is not None:
        assert start.bias_bound_deg_per_s is not None
        attitude, attitude_shape = elliptude.measured_attitude(directions, references, bounds, weights)
        shape = np.zeros((6, 6))
        shape[:3, :3] = attitude_shape
        shape[3:, 3:] = np.eye(3) * np.deg2rad(start.bias_bound_deg_per_s) ** 2
        return elliptude.StateEllipsoid(attitude, known_bias, shape)
    assert configuration.rate is not None
    assert log.rates is not None
    return elliptude.measured_state(directions, references, bounds, log.rates[0], configuration.rate.bound(), weights)


def _results(configuration: Configuration, log: Log, filtered: FilterLog, starts_here: bool) -> Result:
    names = [sensor.name for sensor in configuration.directions]
    present = np.isfinite(log.directions[:, :, 0])
    if not isinstance(configuration.flow, GyroFlow):
        names.append("rate")
        present = np.column_stack([present, log.has_rate])
    refused = filtered.outcomes == _REFUSED
    shares = np.where(filtered.outcomes == _UPDATED, filtered.shares, np.nan)
    if starts_here:
        shares[0] = 0.0
    errors, forms = compare(filtered, log.true_attitudes, log.true_vectors, configuration.truth_error)
    return Result(
        times=filtered.times,
        quaternions=tables.quaternions_from_attitudes(filtered.attitudes),
        vector="bias" if isinstance(configuration.flow, GyroFlow) else "rate",
        vectors=filtered.vectors,
        shapes=filtered.shapes,
        half_widths=filtered.half_widths(),
        largest_angles=filtered.largest_angles(),
        used=names_of_chosen(names, present & ~refused[:, None]),
        refused=names_of_chosen(names, present & refused[:, None]),
        shares=shares,
        margins=filtered.margins,
        errors=errors,
        forms=forms,
        origin=log.counts_from,
    )


def summarize(estimation: Estimation, configuration: Configuration) -> dict[str, Any]:
    """Figures of an estimation for ``summary.json``: see `elliptude.estimation.summary`."""
    summary = Summary()
    summary.add(estimation.result)
    return summary.to_dict(
        configuration,
        vector_is_compared=estimation.vector_is_compared,
        elapsed=estimation.elapsed,
        guaranteed=estimation.guaranteed,
        bridged=estimation.bridged,
        best=estimation.best,
        answers=estimation.answers,
    )
