"""Whose estimate stands beside the set: an attitude near the truth, and how far it may be off by the guaranteed run.

The center of a set is a poor estimate where what bounds the truth is lopsided. Where gyro, accelerometer and
magnetometer are all that is measured, VQF is a better one, a filter that is kept well; for a rigid body, and with
other sensors where it is asked for, a Kalman filter is. Neither has an influence on the sets.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation.best.kalman import kalman_attitudes, why_not_kalman
from elliptude.estimation.best.vqf import is_for_vqf, vqf_attitudes, why_not_vqf
from elliptude.estimation.guaranteed_run import GuaranteedRun
from elliptude.estimation.sizes_in_words import mean_and_most
from elliptude.io.tables import quaternions_from_attitudes
from elliptude.monitoring import Monitored, Sets, UpCaps, monitor, put_back
from elliptude.results import CLAIMS, AttitudeBounds
from elliptude.typing import FloatArray

Estimator: TypeAlias = Literal["vqf", "kalman", "center"]
"""Whose an estimate is: VQF's, the Kalman filter's, or the center of the set."""
_IN_WORDS = {"vqf": "vqf", "kalman": "a Kalman filter", "center": "the center of the set"}


@dataclass(frozen=True, eq=False)
class Best:
    """An estimate at each of N rows, and how far it may be off."""

    quaternions: FloatArray
    """(qw, qx, qy, qz) from body to reference axes, NaN where there is none, shape (N, 4)."""
    estimator: Estimator
    """Whose it is."""
    is_estimated: NDArray[np.bool_]
    """Whether it is that of VQF or of the Kalman filter; else it is the center of the set, shape (N,)."""
    put_back: NDArray[np.bool_]
    """Whether it was outside an unconditional set by stated bounds, and was moved onto its boundary, shape (N,)."""
    errors: Monitored
    """Bounds of its errors: total, tilt, heading; with claims."""
    why_center: str | None = None
    """Why it is the center, if another estimate would be the default."""


def best_estimate(run: GuaranteedRun, configuration: Configuration) -> Best | None:
    """An estimate as good as a filter without guarantee, and its bounds: theory, section 18.10.

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration
        The one of the run; its ``estimator.best`` says which estimate.

    Returns
    -------
    Best or None
        None if the configuration asks for none.

    Raises
    ------
    ValueError
        If the configuration asks for VQF or the Kalman filter, and that cannot be.
    """
    if configuration.estimator.best == "none":
        return None
    estimator, why = _estimator(configuration)
    sets, caps, up = sets_of(run)
    if estimator == "center":
        errors = monitor(sets, sets.quaternions, up=up, caps=caps)
        nowhere = np.zeros(len(sets.times), dtype=np.bool_)
        return Best(sets.quaternions, "center", nowhere, nowhere, errors, why)
    if estimator == "vqf":
        found = vqf_attitudes(run, configuration)
    else:
        found = quaternions_from_attitudes(kalman_attitudes(run, configuration))
    is_estimated = np.isfinite(found[:, 0])
    stated = replace(sets, are_proposals=configuration.proposed_from is not None)
    quaternions, moved = put_back(stated, np.where(is_estimated[:, None], found, sets.quaternions))
    # The sign is the one that the center has in the table.
    quaternions = np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)
    if estimator == "kalman" and not is_estimated.any():
        why = "no set is narrow enough for a Kalman filter to begin with"
    return Best(quaternions, estimator, is_estimated, moved, monitor(sets, quaternions, up=up, caps=caps), why)


def _estimator(configuration: Configuration) -> tuple[Estimator, str | None]:
    """Whose estimate it is, and why it is the center where the configuration does not ask for that."""
    wanted = configuration.estimator.best
    if wanted == "center":
        return "center", None
    is_vqf = is_for_vqf(configuration) if wanted is None else wanted == "vqf"
    why_not = why_not_vqf(configuration) if is_vqf else why_not_kalman(configuration)
    if wanted is None and not is_vqf and why_not is None and isinstance(configuration.flow, GyroFlow):
        # It takes three times as long as all else, and real errors are less independent than it takes them for.
        why_not = "a Kalman filter's with estimator.best = 'kalman'"
    if why_not is not None and wanted is not None:
        raise ValueError(f"estimator.best = {wanted!r}: {why_not}")
    if why_not is not None:
        return "center", why_not
    return "vqf" if is_vqf else "kalman", None


def sets_of(run: GuaranteedRun) -> tuple[Sets, UpCaps | None, FloatArray | None]:
    """A run's sets with all that it knows of tilt, heading and up, as `elliptude.monitoring.monitor` takes them.

    Parameters
    ----------
    run : GuaranteedRun

    Returns
    -------
    sets : Sets
    caps : UpCaps or None
    up : (3,) array or None
        In reference axes.
    """
    vertical, up, of_center = run.vertical, run.rows.up, run.sets.attitude_bounds
    sets = Sets.of(run.sets)
    if vertical is None or up is None or of_center is None:
        return sets, None, None
    # The tilt of the center is known by both, the sets and the vertical.
    bounds = AttitudeBounds(vertical.tilt_bounds, of_center.heading_from, of_center.heading_to, of_center.angle)
    return replace(sets, bounds=bounds, vertical=up), UpCaps(vertical.directions, vertical.angles, vertical.claims), up


def summarize(best: Best | None) -> dict[str, Any] | None:
    """Figures of the estimate for ``summary.json``, degrees; None without an estimate.

    Parameters
    ----------
    best : Best, optional

    Returns
    -------
    dict or None
    """
    if best is None:
        return None
    there = np.isfinite(best.quaternions[:, 0])
    other = "kalman" if best.estimator == "kalman" else "vqf"

    def figures(values: FloatArray) -> dict[str, float] | None:
        known = np.rad2deg(values[np.isfinite(values)])
        if not len(known):
            return None
        return {"mean": float(known.mean()), "median": float(np.median(known)), "max": float(known.max())}

    return {
        "from": best.estimator if best.is_estimated.any() else "center",
        "why_center": best.why_center,
        "rows": {
            other: int(best.is_estimated.sum()),
            "center": int((there & ~best.is_estimated).sum()),
        },
        "put_back": int(best.put_back.sum()),
        "bound_deg": figures(best.errors.bounds[:, 0]),
        "tilt_bound_deg": figures(best.errors.bounds[:, 1]),
        "heading_bound_deg": figures(best.errors.bounds[:, 2]),
        "attitude_error_deg": None,
    }


def in_words(summary: dict[str, Any]) -> str:
    """The figures of `summarize` in one line."""
    why = "" if summary["why_center"] is None else f" ({summary['why_center']})"
    whose = f"{_IN_WORDS[summary['from']]}{why}"
    words = [whose]
    # The center's bounds are those of the sets, which are said beside them.
    if summary["from"] != "center":
        named = (("within", "bound_deg"), ("its tilt within", "tilt_bound_deg"), ("its heading", "heading_bound_deg"))
        bounds = [
            f"{name} {mean_and_most(figure['mean'], figure['max'])}"
            for name, key in named
            if (figure := summary[key]) is not None
        ]
        words = [f"{whose}: {', '.join(bounds)} degrees: mean (at most)" if bounds else whose]
    if summary["put_back"]:
        words.append(f"put back into its set at {summary['put_back']} rows")
    error = summary["attitude_error_deg"]
    if error is not None and error["mean"] is not None:
        words.append(f"mean error {error['mean']:.3g} degrees")
    return "; ".join(words)


def columns_of(best: Best | None) -> dict[str, Any]:
    """What the table of results says of the estimate, as fields of `elliptude.io.tables.Result`."""
    if best is None:
        return {}
    there = np.isfinite(best.quaternions[:, 0])
    errors = best.errors
    has_up = len(errors.questions) > 1
    return {
        "best_quaternions": best.quaternions,
        "best_bounds": errors.bounds[:, 0],
        "best_from": np.where(there, np.where(best.is_estimated, best.estimator, "center"), "").tolist(),
        "best_put_back": np.where(there, best.put_back.astype(np.float64), np.nan),
        "best_tilt_bounds": errors.bounds[:, 1] if has_up else None,
        "best_headings": errors.headings if has_up else None,
        "best_tilt_claims": [CLAIMS[claim] for claim in errors.claims[:, 1]] if has_up else None,
    }
