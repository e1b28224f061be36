"""The results of the guaranteed mode: a table, figures for the summary, and the measurements that were left out."""

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.angles.roll_pitch_yaw import roll_and_pitch, yaw
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.rules import hand_held
from elliptude.estimation import gaps
from elliptude.estimation.best import choice as best_estimates
from elliptude.estimation.best.choice import Best
from elliptude.estimation.containment import compare
from elliptude.estimation.direction_rows import turned_by_offset
from elliptude.estimation.guaranteed_run import GuaranteedRun, turned_to_start
from elliptude.estimation.questions import columns as answer_columns
from elliptude.estimation.questions.answers import Answers
from elliptude.estimation.vertical import Vertical
from elliptude.estimation.why_no_set import why_no_set
from elliptude.io import tables
from elliptude.io.column_files import Column
from elliptude.io.tables import Result, names_of_chosen
from elliptude.logs.log import Log
from elliptude.results import CLAIMS, AttitudeBounds
from elliptude.typing import FloatArray


def result_of(
    run: GuaranteedRun, configuration: Configuration, best: Best | None = None, answers: Answers | None = None
) -> Result:
    """The table of results, compared with the truth in the log.

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration
    best : Best, optional
        The estimate beside the sets.
    answers : Answers, optional
        What was asked of each row by itself.

    Returns
    -------
    Result

    Raises
    ------
    ValueError
        If the truth is too far off to be compared.
    """
    log, guaranteed = run.log, run.sets
    there = run.rows.angles < np.pi
    if not isinstance(configuration.flow, GyroFlow):
        there = np.column_stack([there, log.has_rate])
    names = list(run.sensors()[: there.shape[1]])
    dropped = guaranteed.dropped[:, : there.shape[1]]
    true_attitudes = log.true_attitudes
    if run.starts_heading and true_attitudes is not None:
        true_attitudes = turned_to_start(true_attitudes, run)
    # The filter's state is what is left of a gyro's bias; the table is of the bias.
    known = run.rows.bias
    true_vectors = log.true_vectors - known if configuration.estimates_vector and log.true_vectors is not None else None
    to_truth = turns_within(run, configuration, configuration.time_offset_of_truth, log.true_sampled)
    errors, forms = compare(guaranteed, true_attitudes, true_vectors, configuration.truth_error, to_truth)
    extents = guaranteed.extents()
    vectors, shapes, half_widths = guaranteed.vectors + known, guaranteed.shapes, extents.half_widths_body
    answered = answer_columns.columns_of(
        answers,
        guaranteed,
        true_attitudes,
        true_vectors if configuration.compares_vector and log.true_sampled is None else None,
        configuration.truth_error,
        to_truth,
    )
    if answered.get("vector_ranges") is not None:
        answered["vector_ranges"] = answered["vector_ranges"] + np.repeat(known, 2)
    if not configuration.estimates_vector:
        # The filter's vector is not the gyro's bias here.
        attitude = np.arange(6) < 3
        vectors = np.full_like(vectors, np.nan)
        shapes = np.where(attitude[:, None] & attitude, shapes, np.nan)
        half_widths = np.where(attitude, half_widths, np.nan)
    return Result(
        times=guaranteed.times,
        quaternions=tables.quaternions_from_attitudes(guaranteed.attitudes),
        vector="bias" if isinstance(configuration.flow, GyroFlow) else "rate",
        vectors=vectors,
        shapes=shapes,
        half_widths=half_widths,
        largest_angles=extents.largest_angles,
        used=names_of_chosen(names, there & ~dropped),
        refused=[""] * len(log.times),
        shares=np.full(len(log.times), np.nan),
        margins=guaranteed.margins,
        errors=errors,
        forms=forms,
        chart="gibbs",
        claims=[CLAIMS[claim] for claim in guaranteed.claims],
        prediction_used=np.where(np.isfinite(guaranteed.shapes[:, 0, 0]), guaranteed.prediction_used, np.nan),
        dropped=names_of_chosen(names, there & dropped),
        origin=log.counts_from,
        **_of_questions(run),
        **best_estimates.columns_of(best),
        **answered,
        clock_turns=turns_within(run, configuration, configuration.time_offset_of_rows),
    )


def turns_within(
    run: GuaranteedRun, configuration: Configuration, offset: float, sampled: FloatArray | None = None
) -> FloatArray | None:
    """How far the body may turn between the moments of rows and of what stands beside them, rad, shape (N,).

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration
    offset : float
        How far the stamps of the two may be off against one another, s.
    sampled : (N,) array, optional
        Stamps that are not those of the rows, s.

    Returns
    -------
    (N,) array, or None
        π where nothing bounds the turn; None where there is no time between the two.
    """
    if offset == 0.0 and sampled is None:
        return None
    flow = configuration.flow
    if isinstance(flow, GyroFlow):
        assert run.rows.gyro is not None
        log = gaps.without_rates_in_gaps(run.log, gaps.longest_interval(run.log, configuration))
        assert log.rates is not None
        turned = turned_by_offset(log, log.rates - run.rows.bias, offset, run.rows.gyro, flow, sampled)
        return np.where(np.isfinite(turned), np.minimum(turned, np.pi), np.pi)
    times = run.log.times
    away = np.full(len(times), offset) + (0.0 if sampled is None else np.abs(sampled - times))
    rate = np.inf if flow.largest_rate_deg_per_s is None else np.deg2rad(flow.largest_rate_deg_per_s)
    return np.where(away > 0.0, np.minimum(rate * np.where(away > 0.0, away, 1.0), np.pi), 0.0)


def _of_questions(run: GuaranteedRun) -> dict[str, Any]:
    """What the result says of tilt, heading and up by themselves."""
    bounds, vertical = run.sets.attitude_bounds, run.vertical
    if bounds is None or vertical is None:
        return {}
    return {
        "tilt_bounds": vertical.tilt_bounds,
        "headings": np.column_stack([bounds.heading_from, bounds.heading_to]),
        "ups": vertical.directions,
        "up_bounds": vertical.angles,
        "up_claims": [CLAIMS[claim] for claim in vertical.claims],
        "roll_pitch_yaw": _roll_pitch_yaw(run, vertical, bounds),
    }


def _roll_pitch_yaw(run: GuaranteedRun, vertical: Vertical, bounds: AttitudeBounds) -> FloatArray:
    """Roll and pitch from up, which may be known without an attitude, and yaw: angles with their ends, (N, 9)."""
    assert run.rows.up is not None
    is_up = bool(run.rows.up[2] > 0.0)
    roll, pitch = roll_and_pitch(vertical.directions if is_up else -vertical.directions, vertical.angles)
    # What rests on a stronger claim holds under that of the set, too, and may be wider.
    tilt = np.fmin(vertical.tilt_bounds, bounds.tilt)
    turned = yaw(run.sets.attitudes, tilt, bounds.heading_from, bounds.heading_to, is_up=is_up)
    return np.column_stack([*roll, *pitch, *turned])


def resting_rows(log: Log, configuration: Configuration) -> NDArray[np.bool_] | None:
    """Rows at rest, by gyro and accelerometer, shape (N,); None without both.

    Between two samples of the gyro, where other sensors have rows, it is as at the one before.
    """
    accelerometer = configuration.accelerometer
    if accelerometer is None or log.rates is None:
        return None
    rule = configuration.rule.rule() if configuration.rule is not None else hand_held()
    forces = log.directions[:, configuration.directions.index(accelerometer)]
    rows = np.arange(len(log.times)) if log.gyro_times is None else log.gyro_rows
    resting = rule.rest.rows(log.times[rows], log.rates[rows], forces[rows])
    before: NDArray[np.bool_] = resting[
        np.maximum(np.searchsorted(rows, np.arange(len(log.times)), side="right") - 1, 0)
    ]
    return before


def summarize(run: GuaranteedRun, configuration: Configuration, answers: Answers | None = None) -> dict[str, Any]:
    """Figures that only this mode adds to the summary: claims, sizes, what was left out; degrees."""
    vector = "gyro_bias" if isinstance(configuration.flow, GyroFlow) else "angular_velocity"
    extents = run.sets.extents()
    half_widths, largest = np.rad2deg(extents.half_widths_reference), np.rad2deg(extents.largest_angles)
    has_set = np.isfinite(half_widths[:, 0])
    parts: dict[str, NDArray[np.bool_]] = {"all": np.ones(len(has_set), dtype=np.bool_)}
    if (resting := resting_rows(run.log, configuration)) is not None:
        parts |= {"at_rest": resting, "moving": ~resting}

    def sizes(rows: NDArray[np.bool_]) -> dict[str, Any]:
        chosen = rows & has_set
        some, any_is = half_widths[chosen], bool(chosen.any())
        bounds, vertical = run.sets.attitude_bounds, run.vertical
        return {
            "rows": int(rows.sum()),
            "with_set": len(some),
            "half_width_reference_deg": {
                "mean": some.mean(axis=0).tolist() if any_is else None,
                "median": np.median(some, axis=0).tolist() if any_is else None,
                "max": some.max(axis=0).tolist() if any_is else None,
            },
            "largest_angle_deg": _centers(largest[chosen]),
            "tilt_bound_deg": None if vertical is None else _centers(np.rad2deg(vertical.tilt_bounds[chosen])),
            "heading_bound_deg": None if bounds is None else _centers(np.rad2deg(bounds.heading[chosen])),
            "up_bound_deg": None if vertical is None else _centers(np.rad2deg(vertical.angles[rows])),
        } | answer_columns.sizes_of(answers, chosen, vector)

    return {
        "policy": configuration.estimator.policy,
        "claim_share_of_rows": {name: float(np.mean(run.sets.claims == i)) for i, name in enumerate(CLAIMS)},
        "up_claim_share_of_rows": None
        if run.vertical is None
        else {name: float(np.mean(run.vertical.claims == i)) for i, name in enumerate(CLAIMS)},
        "set_share_of_rows": float(has_set.mean()),
        "prediction_used_share_of_sets": float(run.sets.prediction_used[has_set].mean()) if has_set.any() else None,
        "sizes": {name: sizes(rows) for name, rows in parts.items()},
        "tilt_beyond_set_rows": _tilt_beyond_set(run, extents.largest_angles),
        "heading": "from the first row" if run.starts_heading else "as referenced",
        "dropped_measurements": int(run.sets.dropped.sum()),
        "dropped_by_sensor": _dropped_by_sensor(run),
        "contradicted_rows": dict(Counter(one.sensor for one in run.contradictions)),
        "contradicted_up": contradicted_up(run),
        "void": list(run.rows.void),
        "gaps": gaps.summarize(run.gaps, run.rows.gyro),
        "why_no_set": why_no_set(run, configuration),
    }


def _dropped_by_sensor(run: GuaranteedRun) -> dict[str, int]:
    """How many measurements of each sensor were left out, for those of which any was."""
    counts = run.sets.dropped.sum(axis=0).tolist()
    return {name: count for name, count in zip(run.sensors(), counts, strict=False) if count}


def _tilt_beyond_set(run: GuaranteedRun, largest: FloatArray) -> int:
    """In how many rows the bound of the tilt, by a stronger claim than the set's, is above its largest angle."""
    if run.vertical is None:
        return 0
    return int(((run.vertical.claims < run.sets.claims) & (run.vertical.tilt_bounds > largest)).sum())


def contradicted_up(run: GuaranteedRun) -> dict[str, Any] | None:
    """How often a measured up contradicts what was followed of it, and that in words; None if it never does."""
    if not run.up_contradictions:
        return None
    first, rows = run.up_contradictions[0], len({one.row for one in run.up_contradictions})
    where = "1 row contradicts" if rows == 1 else f"{rows} rows contradict"
    time = f"{float(run.sets.times[first.row]):.6g}"
    return {
        "sensor": first.sensor,
        "rows": rows,
        "first_s": float(run.sets.times[first.row]),
        "said": f"{first.sensor}: {where} up as the gyro carries it, first at {time} s, by {first.excess:.3g} degrees: "
        "a statement about the accelerometer, the motion or the gyro is wrong, and rows before may rest on it too",
    }


def dropped_columns(run: GuaranteedRun) -> dict[str, Column]:
    """Every measurement that contradicts, in order of time: time, place in the file, sensor, what, by how much."""
    sensors = run.sensors()
    entries = [
        (int(row), sensors[column], "prediction", float(run.sets.margins[row]), "")
        for row, column in np.argwhere(run.sets.dropped)
    ]
    listed = {(row, sensor) for row, sensor, *_ in entries}
    entries += [(one.row, one.sensor, "own_bound", -one.excess, one.unit) for one in run.contradictions]
    entries += [
        (one.row, one.sensor, "prediction_of_up", -one.excess, one.unit)
        for one in run.up_contradictions
        if (one.row, one.sensor) not in listed
    ]
    entries.sort(key=lambda entry: entry[0])
    return {
        "time_s": np.array([run.sets.times[row] for row, *_ in entries], dtype=np.float64),
        "place": run.log.places_in_file([row for row, *_ in entries]),
        "sensor": [sensor for _, sensor, *_ in entries],
        "contradicts": [why for _, _, why, *_ in entries],
        "margin": np.array([margin for *_, margin, _ in entries], dtype=np.float64),
        "unit": [unit for *_, unit in entries],
    }


def _centers(values: FloatArray) -> dict[str, float] | None:
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {"mean": float(values.mean()), "median": float(np.median(values)), "max": float(values.max())}
