"""The figures of a run, as plain numbers."""

from dataclasses import replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.angles.about_axes import ErrorAxes
from elliptude.report.run import Run
from elliptude.results import CLAIMS
from elliptude.typing import FloatArray


def summarize(run: Run, label: str) -> dict[str, Any]:
    """The figures of a run: plain numbers; None for what is not known.

    Parameters
    ----------
    run : Run
    label : str
        What the run is compared with.

    Returns
    -------
    dict
        Angles in degrees, times in seconds.
    """
    known, count = run.known, len(run.times)
    reference, body = (replace(run, axes=axes).about_axes() for axes in get_args(ErrorAxes))
    widths, largest = np.rad2deg(body.half_widths[known]), np.rad2deg(run.largest_angles[known])
    about_reference = np.rad2deg(reference.half_widths[known])
    compared, escaped = run.compared, run.escaped & run.compared
    spells = run.refusal_spells()
    summary: dict[str, Any] = {
        "rows": count,
        "first_s": float(run.times[0]),
        "last_s": float(run.times[-1]),
        "median_rate_hz": float(1.0 / np.median(np.diff(run.times))) if count > 1 else None,
        "rows_with_a_set": int(known.sum()),
        "rows_with_an_update": sum(bool(names) for names in run.used),
        "claims": None if run.claims is None else {claim: int(run.claimed(claim).sum()) for claim in CLAIMS},
        "largest_angle_deg": _spread(largest),
        "half_width_deg": {axis: _spread(widths[:, i]) for i, axis in enumerate("xyz")},
        "half_width_reference_deg": {name: _spread(about_reference[:, i]) for i, name in enumerate(reference.names)},
        "axes": run.axes,
        "left_out": {
            what: sum(spell.measurements for spell in spells if spell.what == what) for what in ("dropped", "refused")
        },
        "heading_from_start": run.heading_from_start,
        "gaps": list(run.gaps),
        "smoothing": list(run.smoothing),
        "compared_with": label if compared.any() else None,
    }
    if run.dropped is None and run.listed is None:
        del summary["left_out"]["dropped"]
    if run.listed is not None:
        summary["left_out"]["own bound"] = sum(why == "own_bound" for why in run.listed.contradicts)
    summary |= _where_it_is_known(run)
    if compared.any():
        summary |= _against_the_reference(run, compared, escaped)
    return summary


def _where_it_is_known(run: Run) -> dict[str, Any]:
    """Figures that not every run has."""
    summary: dict[str, Any] = {}
    known = run.known
    if run.bounds_from_recording is not None:
        summary["bounds_from_recording"] = run.bounds_from_recording
    if run.implausible:
        summary["implausible"] = list(run.implausible)
    if run.suspicious:
        summary["suspicious"] = list(run.suspicious)
    if run.up_at_rest is not None:
        summary["up_at_rest"] = run.up_at_rest
    if run.best is not None:
        summary["best"] = run.best
    if run.void:
        summary["left_out_from_beginning_to_end"] = list(run.void)
    if run.tilt_bounds is not None:
        summary["tilt_bound_deg"] = _spread(np.rad2deg(run.tilt_bounds[known]))
    if run.heading_bounds is not None:
        summary["heading_bound_deg"] = _spread(np.rad2deg(run.heading_bounds[known]))
    if run.roll_pitch_yaw is not None:
        half_widths = 0.5 * np.rad2deg(run.roll_pitch_yaw[:, 2::3] - run.roll_pitch_yaw[:, 1::3])
        summary["angle_half_width_deg"] = dict(zip(("roll", "pitch", "yaw"), map(_spread, half_widths.T), strict=True))
    if run.up_bounds is not None:
        summary["up_bound_deg"] = _spread(np.rad2deg(run.up_bounds))
        summary["rows_with_up_alone"] = int(run.up_alone.sum())
    if run.prediction_used is not None:
        summary["prediction_used_rows"] = int((run.prediction_used[known] == 1.0).sum())
    return summary


def _against_the_reference(run: Run, compared: NDArray[np.bool_], escaped: NDArray[np.bool_]) -> dict[str, Any]:
    assert run.errors is not None
    return {
        "rows_compared": int(compared.sum()),
        "escapes": int(escaped.sum()),
        "first_escape_s": float(run.times[np.argmax(escaped)]) if escaped.any() else None,
        "escapes_by_claim": None
        if run.claims is None
        else {claim: int((escaped & run.claimed(claim)).sum()) for claim in CLAIMS},
        "reference_error_deg": float(np.rad2deg(run.reference_error)),
        "error_deg": _spread(np.rad2deg(np.linalg.norm(run.errors[compared], axis=1))),
    }


def _spread(values: FloatArray) -> dict[str, float] | None:
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {"median": float(np.median(values)), "mean": float(values.mean()), "largest": float(values.max())}
