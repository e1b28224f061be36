"""Figures of an estimation for ``summary.json``, gathered piece by piece: plain numbers, in degrees.

Shares and widths are over the rows with an update, because the rows between only carry the update on. The mean and
the largest attitude error are over all rows with a set and a known truth, as in `elliptude compare`.
"""

import platform
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, get_args

import numpy as np
import scipy
from numpy.typing import NDArray

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import Question
from elliptude.configuration.findings import suspicions
from elliptude.estimation import guaranteed_result
from elliptude.estimation.best import choice as best_estimates
from elliptude.estimation.best.choice import Best
from elliptude.estimation.gaps import Bridged
from elliptude.estimation.guaranteed_run import GuaranteedRun
from elliptude.estimation.questions.answers import Answers
from elliptude.io import column_files, tables
from elliptude.io.tables import Result
from elliptude.logs.plausibility import Heard
from elliptude.typing import FloatArray

SETTLED_UPDATE = 6
"""Means "from the 6th update on" leave out the effect of the start."""


class Summary:
    """The figures of a result. Its pieces are added once each, in their order."""

    def __init__(self) -> None:
        self._vector: tables.VectorName = "rate"
        self._rows = self._updates = self._refused = self._origin = 0
        self._half_widths = np.zeros(6)
        self._largest = _Statistics()
        self._angles = _Statistics()
        self._rates = _Statistics()
        self._is_compared = False
        self._inside_updates = _Share()
        self._inside_rows = _Share()
        self._inside_unconditional = _Share()
        self._largest_form = -np.inf
        self._best = _Mean()
        self._answers = {question: _Answered() for question in get_args(Question)}

    @property
    def inside_share(self) -> float | None:
        """The share of all rows whose truth is known that have it inside."""
        return self._inside_rows.value()

    def add(self, result: Result) -> None:
        """Take the next rows into account."""
        updated = np.array([bool(names) for names in result.used], dtype=np.bool_)
        rows = np.flatnonzero(updated & np.isfinite(result.largest_angles))
        settled = rows[max(SETTLED_UPDATE - 1 - self._updates, 0) :]
        self._vector, self._origin = result.vector, result.origin
        self._rows += len(result.times)
        self._updates += len(rows)
        self._refused += sum(bool(names) for names in result.refused)
        self._half_widths += np.rad2deg(result.half_widths[rows]).sum(axis=0)
        self._largest.add(np.rad2deg(result.largest_angles), rows, settled)
        for question, (answers, forms) in _answers_by_question(result).items():
            self._answers[question].add(answers, forms, result.claims)
        if result.errors is None or result.forms is None:
            return
        self._is_compared = True
        # The center's error at every row that has a set, as in `elliptude compare`.
        has_set = np.flatnonzero(np.isfinite(result.largest_angles))
        self._angles.add(np.rad2deg(np.linalg.norm(result.errors[:, :3], axis=1)), has_set, settled)
        self._rates.add(np.rad2deg(np.linalg.norm(result.errors[:, 3:], axis=1)), rows, settled)
        self._inside_updates.add(result.forms[rows])
        self._inside_rows.add(result.forms)
        self._largest_form = float(np.fmax.reduce(result.forms, initial=self._largest_form))
        if result.best_quaternions is not None:
            self._best.add(np.rad2deg(_best_errors(result)[has_set]))
        if result.claims is not None:
            self._inside_unconditional.add(result.forms[np.array(result.claims) == "unconditional"])

    def to_dict(
        self,
        configuration: Configuration,
        *,
        vector_is_compared: bool,
        elapsed: float,
        guaranteed: GuaranteedRun | None = None,
        bridged: Bridged | None = None,
        heard: Heard | None = None,
        best: Best | None = None,
        answers: Answers | None = None,
    ) -> dict[str, Any]:
        """The figures for ``summary.json``; None for what is not known.

        Parameters
        ----------
        configuration : Configuration
        vector_is_compared : bool
            Whether forms are of [ζ; δω], or of ζ alone.
        elapsed : float
            Time for the filter, s.
        guaranteed : GuaranteedRun, optional
            The run, in the guaranteed mode.
        bridged : Bridged, optional
            Gaps of the gyro, in the modes of first order.
        heard : Heard, optional
            What a check of the log found.
        best : Best, optional
            The estimate beside the sets, in the guaranteed mode.
        answers : Answers, optional
            What each row was asked by itself, in the guaranteed mode.

        Returns
        -------
        dict
        """
        heard = Heard() if heard is None else heard
        vector = "gyro_bias" if self._vector == "bias" else "angular_velocity"
        is_estimated = configuration.estimates_vector
        means = self._half_widths / max(self._updates, 1)
        summary: dict[str, Any] = {
            "elliptude": elliptude.__version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "table_version": column_files.VERSION,
            "mode": configuration.estimator.mode,
            "criterion": configuration.estimator.criterion,
            "reference_frame": configuration.frame,
            "time_origin_s": self._origin,
            "rows": self._rows,
            "updates": self._updates,
            "refused": self._refused,
            "elapsed_s": elapsed,
            "settled_from_update": SETTLED_UPDATE,
            "mean_half_width_attitude_deg": means[:3].tolist() if self._updates else None,
            f"mean_half_width_{vector}_deg_per_s": means[3:].tolist() if self._updates and is_estimated else None,
            "largest_angle_deg": self._largest.to_dict(),
            "bounds_from_recording": configuration.proposed_from,
            "implausible": [*map(str, heard.ignored)],
            "calibrated": configuration.corrected_sensors(),
            "calibrations_not_used": list(configuration.calibrations_not_used().values()),
            "suspicious_statements": [*map(str, [*suspicions.of_configuration(configuration), *heard.suspicious])],
            "up_at_rest": None if heard.up is None else asdict(heard.up) | {"in_words": str(heard.up)},
            "compared_with": None,
        }
        if self._is_compared:
            summary |= {
                "compared_with": configuration.truth.label if configuration.truth else "truth",
                "truth_error_deg": configuration.truth.error_deg if configuration.truth else 0.0,
                "compared": f"attitude and {vector}" if vector_is_compared else "attitude",
                "attitude_error_deg": self._angles.to_dict(),
                f"{vector}_error_deg_per_s": self._rates.to_dict(),
                "inside_share_of_updates": self._inside_updates.value(),
                "inside_share_of_rows": self._inside_rows.value(),
                "largest_form": self._largest_form if np.isfinite(self._largest_form) else None,
            }
        if bridged is not None:
            summary["gaps"] = bridged.summarize()
        if guaranteed is not None:
            summary |= guaranteed_result.summarize(guaranteed, configuration, answers)
            if answers is not None:
                summary["questions"] = {
                    name: self._answers[name].to_dict() for name in configuration.estimator.questions
                }
            summary["best"] = best_estimates.summarize(best)
            if best is not None and self._is_compared:
                summary["best"]["attitude_error_deg"] = {"mean": self._best.mean(), "max": self._best.maximum()}
            if best is not None:
                summary["best"]["in_words"] = best_estimates.in_words(summary["best"])
            if self._is_compared:
                summary |= {
                    "inside_share_of_unconditional_rows": self._inside_unconditional.value(),
                    "compared_unconditional_rows": self._inside_unconditional.known,
                }
        return summary


def _best_errors(result: Result) -> FloatArray:
    """How far the best estimate is from the truth, rad, NaN where either is not known, shape (N,)."""
    assert result.errors is not None
    assert result.best_quaternions is not None
    angles = np.full(len(result.times), np.nan)
    turns = result.errors[:, :3]
    known = np.isfinite(turns).all(axis=1) & np.isfinite(result.best_quaternions[:, 0])
    if known.any():
        center, best = (
            scipy.spatial.transform.Rotation.from_quat(quaternions[known], scalar_first=True)
            for quaternions in (result.quaternions, result.best_quaternions)
        )
        angles[known] = (best.inv() * center * scipy.spatial.transform.Rotation.from_rotvec(turns[known])).magnitude()
    return angles


def _answers_by_question(result: Result) -> dict[Question, tuple[FloatArray | None, FloatArray | None]]:
    """The columns of a question's answers, and the forms of the truth in them; None for what is not there."""
    return {
        "reference_turns": (result.turns_reference, result.turns_reference_forms),
        "body_turns": (result.turns_body, result.turns_body_forms),
        "vector": (result.vector_ranges, result.vector_forms),
        "attitude": (result.own_quaternions, result.own_forms),
    }


class _Mean:
    """Mean and maximum of the finite values."""

    def __init__(self) -> None:
        self._sum, self._count, self._maximum = 0.0, 0, -np.inf

    def add(self, values: FloatArray) -> None:
        values = values[np.isfinite(values)]
        self._sum += float(values.sum())
        self._count += len(values)
        self._maximum = float(values.max(initial=self._maximum))

    def mean(self) -> float | None:
        return self._sum / self._count if self._count else None

    def maximum(self) -> float | None:
        return self._maximum if self._count else None


class _Statistics:
    """Statistics of all updates, of those after the start has settled, and of the last row."""

    def __init__(self) -> None:
        self._all, self._settled = _Mean(), _Mean()
        self._last: float | None = None

    def add(self, values: FloatArray, rows: NDArray[np.intp], settled: NDArray[np.intp]) -> None:
        self._all.add(values[rows])
        self._settled.add(values[settled])
        self._last = float(values[-1]) if np.isfinite(values[-1]) else None

    def to_dict(self) -> dict[str, float | None]:
        return {
            "mean": self._all.mean(),
            "max": self._all.maximum(),
            "mean_settled": self._settled.mean(),
            "max_settled": self._settled.maximum(),
            "last": self._last,
        }


class _Share:
    """How many of the known forms are at most 1."""

    def __init__(self) -> None:
        self._inside = self.known = 0

    def add(self, forms: FloatArray) -> None:
        known = forms[np.isfinite(forms)]
        self.known += len(known)
        self._inside += int((known <= 1.0).sum())

    def value(self) -> float | None:
        return self._inside / self.known if self.known else None


class _Answered:
    """How many rows answer a question, and how often the truth is in the answer."""

    def __init__(self) -> None:
        self._rows = 0
        self._inside, self._unconditional = _Share(), _Share()
        self._largest = _Mean()

    def add(self, answers: FloatArray | None, forms: FloatArray | None, claims: Sequence[str] | None) -> None:
        if answers is not None:
            self._rows += int(np.isfinite(answers[:, 0]).sum())
        if forms is not None:
            self._inside.add(forms)
            self._largest.add(forms)
            if claims is not None:
                self._unconditional.add(forms[np.array(claims) == "unconditional"])

    def to_dict(self) -> dict[str, float | None]:
        return {
            "rows": self._rows,
            "compared_rows": self._inside.known,
            "inside_share_of_rows": self._inside.value(),
            "compared_unconditional_rows": self._unconditional.known,
            "inside_share_of_unconditional_rows": self._unconditional.value(),
            "largest_form": self._largest.maximum(),
        }
