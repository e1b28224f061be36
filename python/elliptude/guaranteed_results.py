"""What the guaranteed mode gives of a log: a table of results, figures for the summary, and what was left out."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude import tables
from elliptude.bound_rules import hand_held
from elliptude.configuration import Configuration, GyroFlow
from elliptude.guaranteed_run import GuaranteedRun, turned_to_start
from elliptude.logs import Log
from elliptude.proposals import rest_rows
from elliptude.results import CLAIMS, FloatArray, GuaranteedLog
from elliptude.tables import Results, names_of_chosen


def results_of(run: GuaranteedRun, log: Log, configuration: Configuration) -> Results:
    """The table of results, compared with what the log knows of the truth.

    Parameters
    ----------
    run : GuaranteedRun
    log : Log
        What it is of.
    configuration : Configuration

    Returns
    -------
    Results
    """
    guaranteed, rows = run.log, run.rows
    truth_error = np.deg2rad(configuration.truth.error_deg) if configuration.truth is not None else 0.0
    true_attitudes = log.true_attitudes
    if run.starts_heading and true_attitudes is not None:
        true_attitudes = turned_to_start(true_attitudes, run)
    errors, forms = _compare(guaranteed, true_attitudes, log.true_vectors, truth_error)
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
    return Results(
        times=guaranteed.times,
        quaternions=tables.quaternions_from_attitudes(guaranteed.attitudes),
        vector="bias" if isinstance(configuration.flow, GyroFlow) else "rate",
        vectors=guaranteed.vectors,
        shapes=shapes,
        half_widths=np.sqrt(np.diagonal(shapes, axis1=1, axis2=2)),
        largest_angles=extents.largest_angles,
        used=names_of_chosen(names, there & ~dropped),
        refused=[""] * len(log.times),
        shares=np.full(len(log.times), np.nan),
        margins=guaranteed.margins,
        errors=errors,
        forms=forms,
        claims=[CLAIMS[claim] for claim in guaranteed.claims],
        prediction_used=np.where(has_set, guaranteed.prediction_used, np.nan),
        dropped=names_of_chosen(names, there & dropped),
        tilt_bounds=run.tilt_bounds,
    )


def resting_rows(log: Log, configuration: Configuration) -> NDArray[np.bool_] | None:
    """Rows at rest, by gyro and accelerometer, shape (N,); None without both."""
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


def _compare(
    guaranteed: GuaranteedLog,
    true_attitudes: FloatArray | None,
    true_vectors: FloatArray | None,
    truth_error: float,
) -> tuple[FloatArray | None, FloatArray | None]:
    """`estimation.compare`, where the set is one of the Gibbs chart, and the truth may itself be off."""
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


def summarize(
    results: Results, run: GuaranteedRun, resting: NDArray[np.bool_] | None, configuration: Configuration
) -> dict[str, Any]:
    """What the summary says beside that of the other modes: claims, sizes, what was left out; degrees.

    Parameters
    ----------
    results : Results
    run : GuaranteedRun
    resting : (N,) array of bool, optional
        Rows at rest, if that is known.
    configuration : Configuration

    Returns
    -------
    dict
    """
    guaranteed = run.log
    claims = np.asarray(guaranteed.claims)
    half_widths = np.rad2deg(guaranteed.extents().half_widths_reference)
    tilts = None if run.tilt_bounds is None else np.rad2deg(run.tilt_bounds)
    has_set = np.isfinite(half_widths[:, 0])
    parts: dict[str, NDArray[np.bool_]] = {"all": np.ones(len(claims), dtype=np.bool_)}
    if resting is not None:
        parts |= {"at_rest": resting, "moving": ~resting}
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


def dropped_columns(run: GuaranteedRun, log: Log) -> dict[str, Any]:
    """Every measurement that was left out, in order of time: time, place in the file, sensor, why, by how much.

    Parameters
    ----------
    run : GuaranteedRun
    log : Log
        What it is of.

    Returns
    -------
    dict of str to array or list of str
    """
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


def _means(values: FloatArray) -> list[float] | None:
    """Means down the columns."""
    return values.mean(axis=0).tolist() if len(values) else None


def _medians(values: FloatArray) -> list[float] | None:
    """Medians down the columns."""
    return np.median(values, axis=0).tolist() if len(values) else None


def _centers(values: FloatArray) -> dict[str, float] | None:
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {"mean": float(values.mean()), "median": float(np.median(values)), "max": float(values.max())}


def _share_inside(forms: FloatArray) -> float | None:
    known = forms[np.isfinite(forms)]
    return float(np.mean(known <= 1.0)) if len(known) else None
