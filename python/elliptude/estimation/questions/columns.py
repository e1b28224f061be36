"""Puts the answers of a run into its table, with whether the truth is in them; and their sizes into the summary."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.estimation.containment import attitude_forms, reach_of_turns
from elliptude.estimation.questions.answers import Answers
from elliptude.io import tables
from elliptude.results import GuaranteedLog
from elliptude.typing import FloatArray

_NEXT_TO_A_HALF_TURN = 1e-150


def columns_of(
    answers: Answers | None,
    sets: GuaranteedLog,
    true_attitudes: FloatArray | None,
    true_vectors: FloatArray | None,
    truth_error: float = 0.0,
    turned: FloatArray | None = None,
) -> dict[str, Any]:
    """What a `Result` says of the answers.

    Parameters
    ----------
    answers : Answers, optional
        Of N rows; None if nothing was asked.
    sets : GuaranteedLog
        With the centers that turns are from.
    true_attitudes : (N, 3, 3) array, optional
    true_vectors : (N, 3) array, optional
        Angular velocities or gyro biases.
    truth_error : float
        Angle by which the true attitudes may themselves be off, rad. A row is inside if an attitude is that is so near.
    turned : (N,) array, optional
        How far the body may turn between a row's moment and that of the truth beside it, rad.

    Returns
    -------
    dict
        Fields of `Result` by name.
    """
    if answers is None:
        return {}
    found: dict[str, Any] = {
        "turns_reference": _flat(answers.reference_turns),
        "turns_body": _flat(answers.body_turns),
        "vector_ranges": _flat(answers.vectors),
    }
    own = answers.own_attitudes, answers.own_shapes
    if own[0] is not None and own[1] is not None:
        found |= {"own_quaternions": tables.quaternions_from_attitudes(own[0]), "own_shapes": own[1]}
    if true_attitudes is not None:
        halves = _gibbs_between(sets.attitudes, true_attitudes)
        # Turns of C = Ĉ D in reference axes are those of D in the body's, seen from there.
        in_reference = (sets.attitudes @ halves[..., None])[..., 0]
        distance = truth_error + (np.zeros(len(halves)) if turned is None else reach_of_turns(2.0 * halves, turned))
        found["turns_reference_forms"] = _turn_forms(answers.reference_turns, in_reference, distance)
        found["turns_body_forms"] = _turn_forms(answers.body_turns, halves, distance)
        if own[0] is not None and own[1] is not None:
            found["own_forms"] = _own_forms(own[0], own[1], true_attitudes, truth_error, turned)
    if true_vectors is not None and answers.vectors is not None:
        found["vector_forms"] = _forms(answers.vectors, true_vectors)
    return found


def _flat(intervals: FloatArray | None) -> FloatArray | None:
    return None if intervals is None else intervals.reshape(len(intervals), 6)


def _gibbs_between(centers: FloatArray, true: FloatArray) -> FloatArray:
    """tan(θ/2) n of the turns from centers to the truth, body axes, shape (N, 3); NaN where either is."""
    known = np.isfinite(centers[:, 0, 0]) & np.isfinite(true[:, 0, 0])
    halves = np.full((len(centers), 3), np.nan)
    if known.any():
        turns = scipy.spatial.transform.Rotation.from_matrix(centers[known].swapaxes(1, 2) @ true[known])
        quaternions = turns.as_quat(canonical=True, scalar_first=True)
        # A half turn has none, and is far outside of any set.
        halves[known] = quaternions[:, 1:] / np.maximum(quaternions[:, :1], _NEXT_TO_A_HALF_TURN)
    return halves


def _turn_forms(turns: FloatArray | None, halves: FloatArray, distance: FloatArray) -> FloatArray | None:
    """Forms of the turns about three axes, (16.7): tan(ψ/2) is n · g, which attitudes within ε move by ε/2 and more."""
    if turns is None:
        return None
    least, most = (2.0 * np.arctan(halves + sign * 0.5 * distance[:, None]) for sign in (-1.0, 1.0))
    # The truth may be any of these turns; the one nearest to the middle is written.
    return _forms(turns, np.clip(turns.mean(axis=-1), least, most))


def _forms(intervals: FloatArray, true: FloatArray) -> FloatArray:
    """The largest square of how far the truth goes from the middle of an interval to its end, shape (N,)."""
    least, most = intervals[..., 0], intervals[..., 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        forms: FloatArray = ((2.0 * true - least - most) / (most - least)) ** 2
    # Whether it is inside does not hang on the rounding of the form.
    inside = (least <= true) & (true <= most)
    forms = np.where(inside, np.fmin(forms, 1.0), np.fmax(forms, np.nextafter(1.0, 2.0)))
    known = (np.isfinite(true) & np.isfinite(least)).all(axis=1)
    return np.where(known, forms.max(axis=1), np.nan)


def _own_forms(
    centers: FloatArray, shapes: FloatArray, true: FloatArray, truth_error: float, turned: FloatArray | None
) -> FloatArray:
    """γᵀ P⁻¹ γ of the truth in the attitude's own set, shape (N,)."""
    gammas = 2.0 * _gibbs_between(centers, true)
    known = np.isfinite(gammas[:, 0])
    forms = np.full(len(true), np.nan)
    distance = truth_error + (0.0 if turned is None else reach_of_turns(gammas[known], turned[known]))
    forms[known] = attitude_forms(gammas[known], shapes[known], distance)
    return forms


def sizes_of(answers: Answers | None, rows: NDArray[np.bool_], vector: str) -> dict[str, Any]:
    """Sizes of the answers at some rows for the summary, in degrees.

    Parameters
    ----------
    answers : Answers, optional
        Of N rows; None if nothing was asked.
    rows : (N,) array of bool
    vector : str
        What is estimated beside the attitude, as the summary calls it.

    Returns
    -------
    dict
        Mean and median of the half-widths about three axes, and of the largest angle in the attitude's own set.
    """
    if answers is None:
        return {}
    found: dict[str, Any] = {}
    for name, intervals in (
        ("reference_turn_half_width_deg", answers.reference_turns),
        ("body_turn_half_width_deg", answers.body_turns),
        (f"{vector}_half_width_deg_per_s", answers.vectors),
    ):
        if intervals is not None:
            found[name] = _centers(0.5 * np.rad2deg(intervals[rows, :, 1] - intervals[rows, :, 0]))
    if answers.own_shapes is not None:
        longest = np.sqrt(np.linalg.eigvalsh(answers.own_shapes[rows])[:, -1])
        found["own_largest_angle_deg"] = _centers(np.rad2deg(2.0 * np.arctan(0.5 * longest)))
    return found


def in_words(sizes: Mapping[str, Any]) -> str:
    """What `sizes_of` found, in words; empty if nothing was asked, or no row has a set."""
    names = {
        "reference_turn_half_width_deg": "half-widths about the reference axes {}",
        "body_turn_half_width_deg": "about the body axes {}",
        "angular_velocity_half_width_deg_per_s": "angular velocity {} per second",
        "gyro_bias_half_width_deg_per_s": "gyro bias {} per second",
        "own_largest_angle_deg": "the attitude's own set within {}",
    }
    said = []
    for key, words in names.items():
        if (mean := sizes.get(key, {}).get("mean")) is not None:
            said.append(words.format(", ".join(f"{one:.3g}" for one in np.atleast_1d(mean))))
    return "; ".join(said)


def _centers(values: FloatArray) -> dict[str, Any]:
    """Mean and median over rows; None without any."""
    if not len(values):
        return {"mean": None, "median": None}
    return {"mean": values.mean(axis=0).tolist(), "median": np.median(values, axis=0).tolist()}
