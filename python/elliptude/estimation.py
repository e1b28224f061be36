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
from elliptude.bound_rules import hand_held
from elliptude.configuration import Configuration, FirstMeasurementStart, GivenStart, GyroFlow
from elliptude.guaranteed_run import GuaranteedRun, run_guaranteed, turned_to_start
from elliptude.logs import Log, interval_rates
from elliptude.proposals import rest_rows
from elliptude.results import CLAIMS, FilterLog, FloatArray, GuaranteedLog
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
    guaranteed: GuaranteedRun | None = None
    """What the guaranteed mode did, in that mode."""
    resting: NDArray[np.bool_] | None = None
    """Rows at rest, by gyro and accelerometer, shape (N,); None where that is not known, and in the other modes."""


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
    if configuration.estimator.mode == "guaranteed":
        return _estimate_guaranteed(log, configuration)
    settings, flow = configuration.estimator, configuration.flow
    begin = time.perf_counter()
    directions, rates = log.directions, log.rates
    is_gyro = isinstance(flow, GyroFlow)
    from_measurement = isinstance(configuration.start, FirstMeasurementStart)
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


def _estimate_guaranteed(log: Log, configuration: Configuration) -> Estimation:
    begin = time.perf_counter()
    try:
        run = run_guaranteed(log, configuration)
    except elliptude.InconsistentMeasurement as error:
        raise elliptude.InconsistentMeasurement(
            _with_place(error, log), error.margin, error.time, error.sensor
        ) from error
    except ValueError as error:
        raise ValueError(_with_place(error, log)) from error
    elapsed = time.perf_counter() - begin
    guaranteed, rows = run.log, run.rows
    truth_error = np.deg2rad(configuration.truth.error_deg) if configuration.truth is not None else 0.0
    true_attitudes = log.true_attitudes
    if run.starts_heading and true_attitudes is not None:
        true_attitudes = turned_to_start(true_attitudes, run)
    errors, forms = _compare_guaranteed(guaranteed, true_attitudes, log.true_vectors, truth_error)
    extents = guaranteed.extents()
    shapes = guaranteed.shapes_exponential()
    sensors = run.sensors()
    there = rows.angles < np.pi
    if not isinstance(configuration.flow, GyroFlow):
        rate_there = np.zeros(len(log.times), bool) if log.rates is None else np.isfinite(log.rates[:, 0])
        there = np.column_stack([there, rate_there])
    names = list(sensors[: there.shape[1]])
    dropped = guaranteed.dropped[:, : there.shape[1]]
    has_set = np.isfinite(shapes[:, 0, 0])
    results = Results(
        times=guaranteed.times,
        quaternions=tables.quaternions_from_attitudes(guaranteed.attitudes),
        vector="bias" if isinstance(configuration.flow, GyroFlow) else "rate",
        vectors=guaranteed.vectors,
        shapes=shapes,
        half_widths=np.sqrt(np.diagonal(shapes, axis1=1, axis2=2)),
        largest_angles=extents.largest_angles,
        used=_names(names, there & ~dropped),
        refused=[""] * len(log.times),
        shares=np.full(len(log.times), np.nan),
        margins=guaranteed.margins,
        errors=errors,
        forms=forms,
        claims=[CLAIMS[claim] for claim in guaranteed.claims],
        prediction_used=np.where(has_set, guaranteed.prediction_used, np.nan),
        dropped=_names(names, there & dropped),
        tilt_bounds=run.tilt_bounds,
    )
    return Estimation(
        results=results,
        vector_is_compared=log.true_vectors is not None and truth_error == 0.0,
        elapsed=elapsed,
        guaranteed=run,
        resting=_resting(log, configuration),
    )


def _resting(log: Log, configuration: Configuration) -> NDArray[np.bool_] | None:
    accelerometer = configuration.accelerometer
    if accelerometer is None or log.rates is None:
        return None
    rule = configuration.rule.rule() if configuration.rule is not None else hand_held()
    return rest_rows(
        log.times,
        log.rates,
        log.directions[:, configuration.directions.index(accelerometer)],
        duration=rule.rest.duration_s,
        rate_deviation=np.deg2rad(rule.rest.rate_deviation_deg_per_s),
        rate=np.deg2rad(rule.rest.rate_deg_per_s),
        acceleration_deviation=rule.rest.acceleration_deviation_m_per_s2,
    )


def _compare_guaranteed(
    guaranteed: GuaranteedLog,
    true_attitudes: FloatArray | None,
    true_vectors: FloatArray | None,
    truth_error: float,
) -> tuple[FloatArray | None, FloatArray | None]:
    """`compare`, where the set is one of the Gibbs chart, and the truth may itself be off."""
    if true_attitudes is None:
        return None, None
    count = len(guaranteed.times)
    errors, forms = np.full((count, 6), np.nan), np.full(count, np.nan)
    known = np.isfinite(true_attitudes[:, 0, 0]) & np.isfinite(guaranteed.shapes[:, 0, 0])
    turns = guaranteed.attitudes[known].swapaxes(1, 2) @ true_attitudes[known]
    errors[known, :3] = elliptude.log(turns)
    if true_vectors is not None:
        errors[:, 3:] = true_vectors - guaranteed.vectors
    if truth_error == 0.0:
        whole = known & np.isfinite(errors[:, 3])
        forms[known] = guaranteed.forms(true_attitudes)[known]
        if true_vectors is not None:
            forms[whole] = guaranteed.forms(true_attitudes, true_vectors)[whole]
    else:
        gibbs = 2.0 * elliptude.cayley_inverse(turns)
        forms[known] = least_forms(gibbs, guaranteed.shapes[known, :3, :3], truth_error)
    return errors, forms


def least_forms(offsets: FloatArray, shapes: FloatArray, radius: float) -> FloatArray:
    """The least (x - e)ᵀ P⁻¹ (x - e) with ‖e‖ ≤ radius: at most 1 where a point so near to x is in the ellipsoid.

    With P = V diag(λ) Vᵀ and y = Vᵀ x, e = y/(1 + mλ) in these axes, where m makes its length the radius. In the Gibbs
    chart rotations that are an angle apart are at least so far apart, so that this errs on the side of outside.

    Parameters
    ----------
    offsets : (N, n) array
        x.
    shapes : (N, n, n) array
        P, positive definite.
    radius : float
        Positive.

    Returns
    -------
    (N,) array
    """
    values, vectors = np.linalg.eigh(shapes)
    y = np.einsum("nji,nj->ni", vectors, offsets)
    lengths = np.linalg.norm(y, axis=1)
    # At this m the length is at most the radius; the one sought is less.
    most = np.maximum(lengths / radius - 1.0, 0.0) / values[:, 0]
    low = np.zeros_like(most)
    for _ in range(200):
        middle = 0.5 * (low + most)
        is_long = np.linalg.norm(y / (1.0 + middle[:, None] * values), axis=1) > radius
        low, most = np.where(is_long, middle, low), np.where(is_long, most, middle)
    left = y * (1.0 - 1.0 / (1.0 + most[:, None] * values))
    forms: FloatArray = np.sum(left**2 / values, axis=1)
    return forms


def _with_place(error: ValueError, log: Log) -> str:
    """The message with the place in the file, where it has the row of the arrays."""
    return re.sub(r"\bat row (\d+)", lambda match: f"at {log.place(int(match[1]))}", str(error))


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
    assert start is not None  # the configuration's check
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
    updated = np.array([bool(names) for names in results.used]) & np.isfinite(results.largest_angles)
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
    if estimation.guaranteed is not None:
        summary |= _guaranteed_summary(estimation, estimation.guaranteed, configuration)
    return summary


def _guaranteed_summary(estimation: Estimation, run: GuaranteedRun, configuration: Configuration) -> dict[str, Any]:
    results, guaranteed = estimation.results, run.log
    claims = np.asarray(guaranteed.claims)
    half_widths = np.rad2deg(guaranteed.extents().half_widths_reference)
    tilts = None if run.tilt_bounds is None else np.rad2deg(run.tilt_bounds)
    has_set = np.isfinite(half_widths[:, 0])
    parts: dict[str, NDArray[np.bool_]] = {"all": np.ones(len(claims), dtype=np.bool_)}
    if estimation.resting is not None:
        parts |= {"at_rest": estimation.resting, "moving": ~estimation.resting}
    contradicted: dict[str, int] = {}
    for one in run.contradictions:
        contradicted[one.sensor] = contradicted.get(one.sensor, 0) + 1

    def over(rows: NDArray[np.bool_]) -> dict[str, Any]:
        some = half_widths[rows & has_set]
        return {
            "rows": int(rows.sum()),
            "with_set": len(some),
            "half_width_reference_deg": {"mean": _means(some), "median": _medians(some)},
            "tilt_bound_deg": None if tilts is None else _centers(tilts[rows & has_set]),
        }

    summary: dict[str, Any] = {
        "policy": configuration.estimator.policy,
        "claim_share_of_rows": {name: float(np.mean(claims == i)) for i, name in enumerate(CLAIMS)},
        "set_share_of_rows": float(has_set.mean()),
        "prediction_used_share_of_sets": float(guaranteed.prediction_used[has_set].mean()) if has_set.any() else None,
        "sizes": {name: over(rows) for name, rows in parts.items()},
        "heading": "from the first row" if run.starts_heading else "as referenced",
        "dropped_measurements": int(guaranteed.dropped.sum()),
        "contradicted_rows": contradicted,
        "void": list(run.rows.void),
    }
    if results.forms is not None:
        unconditional = results.forms[claims == 0]
        summary["inside_share_of_unconditional_rows"] = _share_inside(unconditional)
        summary["compared_unconditional_rows"] = int(np.isfinite(unconditional).sum())
    return summary


def dropped_columns(estimation: Estimation, log: Log) -> dict[str, Any]:
    """Every measurement that was left out, in order of time: time, place in the file, sensor, why, by how much.

    Parameters
    ----------
    estimation : Estimation
        Of the guaranteed mode.
    log : Log
        What it is of.

    Returns
    -------
    dict of str to array or list of str
    """
    run = estimation.guaranteed
    assert run is not None
    sensors = run.sensors()
    entries = [
        (int(row), sensors[column], "prediction", float(run.log.margins[row]), "")
        for row, column in np.argwhere(run.log.dropped)
    ]
    entries += [(one.row, one.sensor, "own_bound", one.excess, one.unit) for one in run.contradictions]
    entries.sort(key=lambda entry: entry[0])
    return {
        "time_s": np.array([log.times[row] for row, *_ in entries], dtype=np.float64),
        "place": [log.place_in_file(row) for row, *_ in entries],
        "sensor": [sensor for _, sensor, *_ in entries],
        "contradicts": [why for _, _, why, *_ in entries],
        "margin": np.array([-by if why == "own_bound" else by for *_, why, by, _ in entries], dtype=np.float64),
        "unit": [unit for *_, unit in entries],
    }


def _medians(values: FloatArray) -> list[float] | None:
    """Medians down the columns."""
    return np.median(values, axis=0).tolist() if len(values) else None


def _centers(values: FloatArray) -> dict[str, float] | None:
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {"mean": float(values.mean()), "median": float(np.median(values)), "max": float(values.max())}


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
