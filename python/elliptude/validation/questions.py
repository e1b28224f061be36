"""Asks the guaranteed filter each question that it answers, and compares the answers with the truth.

The truth's own quantities are computed here, from attitudes as matrices and geometry alone, in long double. They share
nothing with the core, which bounds the same quantities by Gibbs vectors.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.typing import FloatArray
from elliptude.validation.adversary import Measured, Motion, Plant
from elliptude.validation.judge import errors_of, forms_of
from elliptude.validation.plants import GyroPlant, guaranteed

OF_ATTITUDE = ("attitude", "body turns", "reference turns", "largest angle", "tilt", "heading", "angle")
OF_RATE, OF_BIAS = ("rate", "rate axes"), ("bias", "bias axes")
OF_DIRECTION = ("direction",)
QUESTIONS = (*OF_ATTITUDE, *OF_RATE, *OF_BIAS, *OF_DIRECTION)
"""What is asked after each update, see docs/validation.md."""

# Answers of one update, in this order: tilt, heading from and to, angle; half-widths along body axes (of attitude and
# vector) and along reference axes, and the largest angle in the set. All in rad or rad/s.
_TILT, _FROM, _TO, _ANGLE = range(4)
_BODY, _VECTOR, _REFERENCE, _LARGEST = slice(4, 7), slice(7, 10), slice(10, 13), 13
ANSWERS = 14
"""How many numbers an update is answered with."""
_LONG = np.longdouble


# --- the answers ------------------------------------------------------------------------------------------------------


def draw_vertical(of: Plant, draws: np.random.Generator) -> FloatArray:
    """Up in questions of tilt and heading: the first direction that is measured, or any other; shape (3,)."""
    # A generator of its own, so that errors are the same whatever is asked.
    own = draws.spawn(1)[0]
    anywhere: FloatArray = own.standard_normal(3)
    return of.reference[0] if own.random() < 0.5 else anywhere / np.linalg.norm(anywhere)


def answers_of_log(log: Any) -> FloatArray:
    """What a `GuaranteedLog` of n rows, with a vertical, answers; NaN without a set, shape (n, 14)."""
    answers: FloatArray = np.column_stack([log.question_bounds, *log.extents()])
    return answers


def answers_of_filter(of: Any, vertical: FloatArray) -> FloatArray:
    """What a `GuaranteedFilter` that has a set answers after its last update, shape (14,)."""
    bounds, extent = of.bounds(vertical), of.ellipsoid.extent()
    answers: FloatArray = np.concatenate(
        [bounds, extent.half_widths_body, extent.half_widths_reference, [extent.largest_angle]]
    )
    return answers


# --- the truth --------------------------------------------------------------------------------------------------------


def tilt_and_heading(centers: Any, true: Any, vertical: FloatArray) -> tuple[Any, Any]:
    """How far centers are tilted against true attitudes, and turned about the vertical after the tilt is taken away.

    Parameters
    ----------
    centers, true : (..., 3, 3) array
        From body to reference axes.
    vertical : (3,) array
        In reference axes.

    Returns
    -------
    tilt, heading : (...) array
        rad, in the precision of the attitudes. The heading is from the center to the truth.
    """
    up = vertical.astype(true.dtype)
    up = up / np.sqrt(np.sum(up**2))
    seen, truly_seen = up @ centers, up @ true
    tilt = np.arctan2(_norms(np.cross(seen, truly_seen)), np.sum(seen * truly_seen, axis=-1))
    # C Ĉᵀ = T S: S is the shortest turn of w, which is Ĉ times up as the true body sees it, to up; T is about up.
    tilted = (centers @ truly_seen[..., None])[..., 0]
    level = np.cross(up, np.eye(3, dtype=true.dtype)[np.argmin(np.abs(up))])
    level = level / np.sqrt(np.sum(level**2))
    # Sᵀ of a level vector: what the shortest turn from up to w makes of it.
    share = np.sum(tilted * level, axis=-1) / (1 + np.sum(tilted * up, axis=-1))
    before = level - share[..., None] * (up + tilted)
    after = (true @ centers.swapaxes(-1, -2) @ before[..., None])[..., 0]
    heading = np.arctan2(np.sum(after * np.cross(up, level), axis=-1), np.sum(after * level, axis=-1))
    return tilt, heading


def shares_of(
    of: Plant,
    centers: tuple[FloatArray, FloatArray],
    shapes: FloatArray,
    answers: FloatArray,
    truth: tuple[FloatArray, FloatArray],
    vertical: FloatArray,
) -> dict[str, FloatArray]:
    """How far the truth goes towards the end of each answer: 0 in its middle, 1 at its end, above 1 outside.

    Parameters
    ----------
    of : Plant
    centers : (..., 3, 3) and (..., 3) array
        Attitudes and vectors.
    shapes : (..., 6, 6) array
    answers : (..., 14) array
    truth : (..., 3, 3) and (..., 3) array
        Attitudes and vectors.
    vertical : (3,) array

    Returns
    -------
    dict of (...) array
        By question; of several axes the largest. NaN without a set.
    """
    precise = [array.astype(_LONG) for array in (*centers, *truth)]
    errors = errors_of("first_order", *precise)
    turns, offsets = errors[..., :3], errors[..., 3:]
    in_reference = (precise[0] @ turns[..., None])[..., 0]
    tilt, heading = tilt_and_heading(precise[0], precise[2], vertical)
    least, most = answers[..., _FROM].astype(_LONG), answers[..., _TO].astype(_LONG)
    whole = _norms(turns)
    attitude, vector = (
        np.sqrt(forms_of("guaranteed", *centers, shapes, *truth, part=part)) for part in (slice(0, 3), slice(3, 6))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = {
            "attitude": attitude,
            "body turns": _largest(turns, answers[..., _BODY]),
            "reference turns": _largest(in_reference, answers[..., _REFERENCE]),
            "largest angle": _share(whole, answers[..., _LARGEST]),
            "tilt": _share(tilt, answers[..., _TILT]),
            "heading": _share(np.abs(2 * heading - least - most), most - least),
            "angle": _share(whole, answers[..., _ANGLE]),
        }
        names = OF_BIAS if of.has_gyro else OF_RATE
        shares |= dict(zip(names, (vector, _largest(offsets, answers[..., _VECTOR])), strict=True))
    return {name: share.astype(np.float64) for name, share in shares.items()}


def direction_shares(of: GyroPlant, motion: Motion, measured: Measured) -> FloatArray:
    """The same of the cap of a `DirectionFilter` that follows the first direction, at all updates, shape (T, U).

    It knows of the bias only how large it may be. The body's turn in an interval is then that of a constant rate but
    for an angle of at most the integral of how far the true rate may be from that.
    """
    interval, updates = of.interval, motion.attitudes.shape[1] - 1
    shares = np.full((len(motion.attitudes), updates), np.nan)
    true = of.reference[0].astype(_LONG) @ motion.attitudes.astype(_LONG)
    for trial in range(len(shares)):
        bias = float(np.linalg.norm(motion.vectors[trial], axis=1).max())
        off = interval * (of.rate_bound + bias) + 0.5 * interval**2 * of.angular_acceleration
        turns = np.concatenate([np.zeros((1, 3)), interval * measured.rates[trial, :-1]])
        try:
            log = guaranteed("DirectionFilter")().run_turns(
                turns,
                # A millionth more covers the rounding of this sum.
                np.append(0.0, np.full(updates, (1.0 + 1e-6) * off)),
                anchors=np.arange(-1, updates),
                directions=measured.directions[trial, :, 0],
                bounds=np.full(updates + 1, of.bound),
            )
        except ValueError:  # true measurements were taken for contradictory
            shares[trial] = np.inf
            continue
        caps, seen = log.directions[1:].astype(_LONG), true[trial, 1:]
        angles = np.arctan2(_norms(np.cross(caps, seen)), np.sum(caps * seen, axis=-1))
        shares[trial] = _share(angles, log.angles[1:])
    return np.where(np.isnan(shares), np.inf, shares)


def _norms(vectors: Any) -> Any:
    return np.sqrt(np.sum(vectors**2, axis=-1))


def _share(errors: Any, bounds: Any) -> Any:
    """Errors over their bounds; infinite of a bound below zero, which holds nothing."""
    return np.where(bounds < 0, np.inf, errors / bounds)


def _largest(errors: Any, bounds: Any) -> Any:
    return np.max(_share(np.abs(errors), bounds), axis=-1)


# --- the counts -------------------------------------------------------------------------------------------------------


class QuestionTally:
    """Counts of each question over runs, with the largest share of its answer, and where that was."""

    def __init__(self) -> None:
        self.counts: dict[str, dict[str, Any]] = {}

    def add(self, shares: Mapping[str, FloatArray], judged: NDArray[np.bool_], first_trial: int) -> None:
        """Count answers.

        Parameters
        ----------
        shares : mapping of (T, U) array
        judged : (T, U) array of bool
            Where there is a set, which must answer: NaN is no answer, and escapes. All caps of a direction are judged.
        first_trial : int
            Number of the first of these trials.
        """
        for name, values in shares.items():
            asked = np.ones_like(judged) if name in OF_DIRECTION else judged
            values = np.where(asked, np.where(np.isnan(values), np.inf, values), -np.inf)
            counted = self.counts.setdefault(name, {"updates": 0, "escapes": 0, "largest": None})
            counted["updates"] += int(np.sum(asked))
            counted["escapes"] += int(np.sum(values > 1.0))
            if not asked.any():
                continue
            trial, update = np.unravel_index(np.argmax(values), values.shape)
            share = min(float(values[trial, update]), float(np.finfo(float).max))  # JSON has no infinity
            if counted["largest"] is None or share > counted["largest"]["share"]:
                counted["largest"] = {"share": share, "trial": first_trial + int(trial), "update": int(update) + 1}


def combine_questions(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The counts of several lots of runs, by question."""
    combined: dict[str, Any] = {}
    for name in QUESTIONS:
        of_name = [part[name] for part in parts if name in part]
        if of_name:
            largest = [one["largest"] for one in of_name if one["largest"] is not None]
            combined[name] = {key: sum(one[key] for one in of_name) for key in ("updates", "escapes")} | {
                "largest": max(largest, key=lambda one: one["share"], default=None)
            }
    return combined
