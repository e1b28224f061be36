"""From a log and a configuration to a table of estimates with their bounds, and a summary.

The estimator sees the measurements alone. What the log knows of the truth is compared with the estimates afterwards.
"""

import platform
import re
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude import tables
from elliptude.configuration import Configuration, GivenStart, GyroFlow
from elliptude.logs import Log
from elliptude.results import FilterLog, FloatArray
from elliptude.tables import Results

SETTLED_UPDATE = 6
"""Means "from the 6th update on" leave out what is left of the start."""

_UPDATED, _REFUSED = 0, 2  # FilterLog.outcomes
# rad/s; the squares of larger ones are no numbers for a small set.
_LARGEST_ERROR = 1e50


@dataclass(frozen=True, eq=False)
class Estimation:
    """What came of a log."""

    results: Results
    vector_is_compared: bool
    """Whether the form is of [ζ; δω], or of ζ alone in the projection of the set because nothing else is known."""
    elapsed: float
    """The filter's time, s."""


def estimate(log: Log, configuration: Configuration) -> Estimation:
    """Run the filter over a log.

    Parameters
    ----------
    log : Log
    configuration : Configuration

    Returns
    -------
    Estimation

    Raises
    ------
    InconsistentMeasurement
        If sets do not meet and the configuration does not say to skip them.
    ValueError
        If no row can be the start, the log does not fit the filter, or the set or what it is compared with is beyond
        all numbers.
    """
    settings, flow = configuration.estimator, configuration.flow
    begin = time.perf_counter()
    directions, rates = log.directions, log.rates
    is_gyro = isinstance(flow, GyroFlow)
    from_measurement = not isinstance(configuration.start, GivenStart)
    if from_measurement:
        log = log.since(first_complete_row(log, configuration))
        directions, rates = log.directions, log.rates
        # The start says all that the first row does: it must not count twice.
        directions = directions.copy()
        directions[0] = np.nan
        if rates is not None and not is_gyro:
            rates = rates.copy()
            rates[0] = np.nan
    attitude_filter = elliptude.AttitudeFilter(
        flow.build(),
        _start(log, configuration),
        time=float(log.times[0]),
        mode=settings.mode,
        criterion=settings.criterion,
        weight=settings.weight(),
    )
    arguments: dict[str, Any] = {"on_inconsistent": settings.when_sets_do_not_meet}
    if configuration.directions:
        # Where nothing is measured the reference does not matter, but must be a number.
        references = np.where(np.isfinite(log.references), log.references, [1.0, 0.0, 0.0])
        bounds = np.array([sensor.bound() for sensor in configuration.directions])
        weights = np.array([sensor.weight for sensor in configuration.directions])
        arguments |= {"directions": directions, "reference": references, "bounds": bounds, "weights": weights}
    if isinstance(flow, GyroFlow):
        assert log.rates is not None
        arguments["gyro"] = interval_rates(log.rates) if flow.interval_rate == "mean_of_ends" else log.rates
    elif configuration.rate is not None:
        arguments |= {"angular_velocity": rates, "rate_bound": configuration.rate.bound()}
    if log.control_torques is not None:
        arguments["control_torque"] = log.control_torques
    try:
        filtered = attitude_filter.run(log.times, **arguments)
    except elliptude.InconsistentMeasurement as error:
        raise elliptude.InconsistentMeasurement(
            _with_place(error, log), error.margin, error.time, error.sensor
        ) from error
    except ValueError as error:
        raise ValueError(_with_place(error, log)) from error
    elapsed = time.perf_counter() - begin
    endless = ~np.isfinite(filtered.shapes).all(axis=(1, 2))
    if endless.any():
        at = log.times[np.argmax(endless)]
        raise ValueError(f"the set has grown beyond all numbers by {at:.6f} s: too long without a measurement")

    present = np.isfinite(log.directions[:, :, 0])
    if not is_gyro:
        rate_present = np.zeros(len(log.times), bool) if log.rates is None else np.isfinite(log.rates[:, 0])
        present = np.column_stack([present, rate_present])
    return Estimation(
        results=_results(log, configuration, filtered, present, from_measurement),
        vector_is_compared=log.true_vectors is not None,
        elapsed=elapsed,
    )


def _with_place(error: ValueError, log: Log) -> str:
    """The message with the place in the file, where it has the row of the arrays."""
    return re.sub(r"\bat row (\d+)", lambda match: f"at {log.place(int(match[1]))}", str(error))


def interval_rates(samples: FloatArray) -> FloatArray:
    """The rate from each sample to the next as the mean of the two, shape (N, 3); nothing follows the last one."""
    rates = samples.copy()
    rates[:-1] = 0.5 * (samples[:-1] + samples[1:])
    return rates


def first_complete_row(log: Log, configuration: Configuration) -> int:
    """The first row that can be the start: with two directions or more, and the rate where that is measured.

    Raises
    ------
    ValueError
        If there is none.
    """
    complete = np.isfinite(log.directions[:, :, 0]).sum(axis=1) >= 2
    if configuration.rate is not None:
        assert log.rates is not None
        complete &= np.isfinite(log.rates[:, 0])
    if not complete.any():
        rate = " and the rate" if configuration.rate is not None else ""
        raise ValueError(f"no row has two directions{rate}: there is no measurement to start from")
    return int(np.argmax(complete))


def _start(log: Log, configuration: Configuration) -> elliptude.StateEllipsoid:
    """The set at the log's first time."""
    start = configuration.start
    if isinstance(start, GivenStart):
        return start.build()
    sensors = configuration.directions
    there = np.flatnonzero(np.isfinite(log.directions[0, :, 0]))
    directions, references = log.directions[0, there], log.references[0, there]
    bounds = np.array([sensors[i].bound() for i in there])
    weights = np.array([sensors[i].weight for i in there])
    if configuration.rate is None:
        assert start.bias_bound_deg_per_s is not None
        attitude, attitude_shape = elliptude.measured_attitude(directions, references, bounds, weights)
        shape = np.zeros((6, 6))
        shape[:3, :3] = attitude_shape
        shape[3:, 3:] = np.eye(3) * np.deg2rad(start.bias_bound_deg_per_s) ** 2
        return elliptude.StateEllipsoid(attitude, np.zeros(3), shape)
    assert log.rates is not None
    return elliptude.measured_state(directions, references, bounds, log.rates[0], configuration.rate.bound(), weights)


def _results(
    log: Log, configuration: Configuration, filtered: FilterLog, present: NDArray[np.bool_], from_measurement: bool
) -> Results:
    names = [sensor.name for sensor in configuration.directions]
    if not isinstance(configuration.flow, GyroFlow):
        names.append("rate")
    refused = filtered.outcomes == _REFUSED
    used = ~refused
    shares = np.where(filtered.outcomes == _UPDATED, filtered.shares, np.nan)
    if from_measurement:
        shares[0] = 0.0
    errors, forms = compare(filtered, log.true_attitudes, log.true_vectors)
    return Results(
        times=filtered.times,
        quaternions=tables.quaternions_from_attitudes(filtered.attitudes),
        vector="bias" if isinstance(configuration.flow, GyroFlow) else "rate",
        vectors=filtered.vectors,
        shapes=filtered.shapes,
        half_widths=filtered.half_widths(),
        largest_angles=filtered.largest_angles(),
        used=_names(names, present & used[:, None]),
        refused=_names(names, present & refused[:, None]),
        shares=shares,
        margins=filtered.margins,
        errors=errors,
        forms=forms,
    )


def _names(names: list[str], chosen: NDArray[np.bool_]) -> list[str]:
    return [" ".join(name for name, is_chosen in zip(names, row, strict=True) if is_chosen) for row in chosen]


def compare(
    filtered: FilterLog, true_attitudes: FloatArray | None, true_vectors: FloatArray | None
) -> tuple[FloatArray | None, FloatArray | None]:
    """How far the truth is from the estimates, and where in their sets.

    Parameters
    ----------
    filtered : FilterLog
        Of N rows.
    true_attitudes : (N, 3, 3) array, optional
    true_vectors : (N, 3) array, optional
        Angular velocities or gyro biases.

    Returns
    -------
    errors : (N, 6) array
        [ζ; δ], rad and rad/s; NaN where there is nothing to compare with. None without true attitudes.
    forms : (N,) array
        [ζ; δ]ᵀ P⁻¹ [ζ; δ], or ζᵀ P_ζζ⁻¹ ζ where δ is not known: at most 1 in the set, or in its projection on attitude.
    """
    if true_attitudes is None:
        return None, None
    count = len(filtered.times)
    errors = np.full((count, 6), np.nan)
    known = np.isfinite(true_attitudes[:, 0, 0])
    errors[known, :3] = elliptude.log(filtered.attitudes[known].swapaxes(1, 2) @ true_attitudes[known])
    if true_vectors is not None:
        errors[:, 3:] = true_vectors - filtered.vectors
    forms = np.full(count, np.nan)
    if np.nanmax(np.abs(errors), initial=0.0) > _LARGEST_ERROR:
        row = np.argmax((np.abs(errors) > _LARGEST_ERROR).any(axis=1))
        raise ValueError(
            f"what the estimate is compared with is {np.nanmax(np.abs(errors[row])):.3g} rad/s off at "
            f"{filtered.times[row]:.6f} s, more than {_LARGEST_ERROR:g} rad/s"
        )
    whole = known & np.isfinite(errors[:, 3])
    for rows, size in ((whole, 6), (known & ~whole, 3)):
        offsets = errors[rows, :size, None]
        forms[rows] = (offsets * np.linalg.solve(filtered.shapes[rows, :size, :size], offsets)).sum(axis=(1, 2))
    return errors, forms


def summarize(estimation: Estimation, configuration: Configuration) -> dict[str, Any]:
    """Figures of an estimation for ``summary.json``: plain numbers, in degrees, None for what is not known.

    Shares and errors are over the rows with an update, as what holds between them is the update's carried on.
    """
    results = estimation.results
    refused = np.array([bool(names) for names in results.refused])
    updated = np.array([bool(names) for names in results.used])
    rows = np.flatnonzero(updated)
    settled = rows[SETTLED_UPDATE - 1 :]
    half_widths, largest = np.rad2deg(results.half_widths), np.rad2deg(results.largest_angles)
    vector = "gyro_bias" if results.vector == "bias" else "angular_velocity"
    summary: dict[str, Any] = {
        "elliptude": elliptude.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "table_version": tables.VERSION,
        "mode": configuration.estimator.mode,
        "criterion": configuration.estimator.criterion,
        "rows": len(results.times),
        "updates": len(rows),
        "refused": int(refused.sum()),
        "elapsed_s": estimation.elapsed,
        "settled_from_update": SETTLED_UPDATE,
        "mean_half_width_attitude_deg": _means(half_widths[rows, :3]),
        f"mean_half_width_{vector}_deg_per_s": _means(half_widths[rows, 3:]),
        "largest_angle_deg": _statistics(largest, rows, settled),
        "compared_with": None,
    }
    if results.errors is not None and results.forms is not None:
        angles = np.rad2deg(np.linalg.norm(results.errors[:, :3], axis=1))
        rates = np.rad2deg(np.linalg.norm(results.errors[:, 3:], axis=1))
        summary |= {
            "compared_with": configuration.truth.label if configuration.truth else "truth",
            "compared": f"attitude and {vector}" if estimation.vector_is_compared else "attitude",
            "attitude_error_deg": _statistics(angles, rows, settled),
            f"{vector}_error_deg_per_s": _statistics(rates, rows, settled),
            "inside_share_of_updates": _share_inside(results.forms[rows]),
            "inside_share_of_rows": _share_inside(results.forms),
            "largest_form": _or_none(np.nanmax(results.forms)) if np.isfinite(results.forms).any() else None,
        }
    return summary


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _means(values: FloatArray) -> list[float] | None:
    """Means down the columns."""
    return values.mean(axis=0).tolist() if len(values) else None


def _statistics(values: FloatArray, rows: NDArray[np.intp], settled: NDArray[np.intp]) -> dict[str, float | None]:
    def of(some: FloatArray, function: Any) -> float | None:
        some = some[np.isfinite(some)]
        return float(function(some)) if len(some) else None

    return {
        "mean": of(values[rows], np.mean),
        "max": of(values[rows], np.max),
        "mean_settled": of(values[settled], np.mean),
        "max_settled": of(values[settled], np.max),
        "last": _or_none(values[-1]),
    }


def _share_inside(forms: FloatArray) -> float | None:
    known = forms[np.isfinite(forms)]
    return float(np.mean(known <= 1.0)) if len(known) else None
