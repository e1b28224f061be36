"""The table of measurements and the table of results: what their columns are (``docs/tables.md``)."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.io.column_files import (
    Column,
    column_names,
    read_columns,
    stacked,
    symmetric,
    time_origin,
    write_columns,
)
from elliptude.typing import Chart, FloatArray

VectorName: TypeAlias = Literal["rate", "bias"]

QUATERNION = ("qw", "qx", "qy", "qz")
RATE = ("wx", "wy", "wz")
BIAS = ("bias_x", "bias_y", "bias_z")
_VECTORS: dict[VectorName, tuple[str, str, str]] = {"rate": RATE, "bias": BIAS}
MEASURED_RATE = ("rate_wx", "rate_wy", "rate_wz")
GYRO = ("gyro_wx", "gyro_wy", "gyro_wz")
VELOCITY = ("velocity_vx", "velocity_vy", "velocity_vz")
CONTROL_TORQUE = ("control_torque_x", "control_torque_y", "control_torque_z")
WHEEL_MOMENTUM = ("wheel_momentum_x", "wheel_momentum_y", "wheel_momentum_z")
_UPPER = np.triu_indices(6)
_SHAPE = tuple(f"P{i + 1}{j + 1}" for i, j in zip(*_UPPER, strict=True))
ATTITUDE_SHAPE = tuple(f"P{i + 1}{j + 1}" for i, j in zip(*np.triu_indices(3), strict=True))
ATTITUDE_HALF_WIDTHS = ("half_width_rx", "half_width_ry", "half_width_rz")
HEADINGS = ("heading_from", "heading_to")
UP = ("up_x", "up_y", "up_z")
BEST_QUATERNION = ("best_qw", "best_qx", "best_qy", "best_qz")
BEST_HEADINGS = ("best_heading_from", "best_heading_to")
ROLL_PITCH, YAW = (
    tuple(f"{angle}{end}" for angle in angles for end in ("", "_from", "_to"))
    for angles in (("roll", "pitch"), ("yaw",))
)
ATTITUDE_ERRORS = ("error_rx", "error_ry", "error_rz")
TURNS_REFERENCE, TURNS_BODY = (
    tuple(f"turn_{axes}{axis}_{end}" for axis in "xyz" for end in ("from", "to")) for axes in "eb"
)
OWN_QUATERNION = ("own_qw", "own_qx", "own_qy", "own_qz")
OWN_SHAPE = tuple(f"own_{name}" for name in ATTITUDE_SHAPE)
_ANSWER_FORMS = ("turn_e_form", "turn_b_form", "vector_form", "own_form")
_FORMS_OF_ANSWERS = ("turns_reference_forms", "turns_body_forms", "vector_forms", "own_forms")
_BEST = ("best_bound", "best_tilt_bound", "best_put_back")
_ANSWERS = (TURNS_REFERENCE, TURNS_BODY, OWN_QUATERNION, OWN_SHAPE)
_NUMBERS_OF_QUESTIONS = (
    "form",
    "prediction_used",
    "tilt_bound",
    "up_bound",
    "turn_within_offset",
    *_BEST,
    *_ANSWER_FORMS,
)
_TEXTS_OF_QUESTIONS = ("claim", "dropped", "chart", "up_claim", "best_tilt_claim", "best_from")


# --- what the tables hold ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Measurements:
    """A log of directions and rates, with the truth beside them where it is known."""

    times: FloatArray
    """s, strictly increasing, shape (N,)."""
    sensors: tuple[str, ...]
    """Names of the m direction sensors."""
    directions: FloatArray
    """Measured unit vectors, body axes, NaN where there was none, shape (N, m, 3)."""
    references: FloatArray
    """The same directions in reference axes, shape (N, m, 3)."""
    angular_velocities: FloatArray | None = None
    """Measured, rad/s, body axes, NaN where there was none, shape (N, 3)."""
    true_quaternions: FloatArray | None = None
    """(qw, qx, qy, qz) of the attitude from body to reference axes, shape (N, 4)."""
    true_angular_velocities: FloatArray | None = None
    """rad/s, body axes, shape (N, 3)."""

    @property
    def true_attitudes(self) -> FloatArray | None:
        """From body to reference axes, shape (N, 3, 3)."""
        return None if self.true_quaternions is None else attitudes_from_quaternions(self.true_quaternions)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a table of measurements, in whole or not at all.

        Parameters
        ----------
        path : path-like
            Ends in ``.csv`` or ``.parquet``.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        columns: dict[str, Column] = {"time_s": self.times}
        _add(columns, QUATERNION, self.true_quaternions)
        _add(columns, RATE, self.true_angular_velocities)
        for i, sensor in enumerate(self.sensors):
            _add(columns, measured(sensor), self.directions[:, i])
            _add(columns, reference(sensor), self.references[:, i])
        _add(columns, MEASURED_RATE, self.angular_velocities)
        write_columns(path, "measurements", columns)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Read a table of measurements.

        Parameters
        ----------
        path : path-like
            CSV, which may be compressed, or Parquet.

        Returns
        -------
        Measurements

        Raises
        ------
        FileError
            If it is not such a table; the message names file, line and column.
        """
        names = column_names(path, "measurements")
        sensors = tuple(name.removesuffix("_bx") for name in names if name.endswith("_bx"))
        directions = [measured(sensor) for sensor in sensors]
        references = [reference(sensor) for sensor in sensors]
        true_attitude = QUATERNION if QUATERNION[0] in names else ()
        true_rate = RATE if RATE[0] in names else ()
        rate = [MEASURED_RATE] if MEASURED_RATE[0] in names else []
        columns = read_columns(path, numbers=true_attitude + true_rate, optional=[*directions, *references, *rate])
        count = len(columns["time_s"])

        def together(triples: Sequence[tuple[str, ...]]) -> FloatArray:
            return np.array([stacked(columns, triple) for triple in triples]).reshape(-1, count, 3).transpose(1, 0, 2)

        return cls(
            times=columns["time_s"],
            sensors=sensors,
            directions=together(directions),
            references=together(references),
            angular_velocities=stacked(columns, MEASURED_RATE) if rate else None,
            true_quaternions=stacked(columns, QUATERNION) if true_attitude else None,
            true_angular_velocities=stacked(columns, RATE) if true_rate else None,
        )


@dataclass(frozen=True, eq=False)
class Result:
    """Estimates with their bounds. P is an ellipsoid's matrix, not a covariance; errors are on the body side.

    The guaranteed mode says more of each row; there numbers are NaN where no set is known.
    """

    times: FloatArray
    """s, strictly increasing, shape (N,)."""
    quaternions: FloatArray
    """(qw, qx, qy, qz) of the attitude from body to reference axes, shape (N, 4)."""
    vector: VectorName
    """What is estimated beside the attitude: the angular velocity or the gyro bias."""
    vectors: FloatArray
    """rad/s, body axes, shape (N, 3). NaN, with their bounds, for a bias that is not estimated."""
    shapes: FloatArray
    """P of [x; δω] or [x; δβ], x the attitude error in `chart`, rad² and rad²/s², shape (N, 6, 6)."""
    half_widths: FloatArray
    """How far [ζ; δω] or [ζ; δβ] reach along body axes, rad and rad/s, √P_ii if x is ζ, shape (N, 6)."""
    largest_angles: FloatArray
    """The largest ‖ζ‖ in the set, rad, shape (N,)."""
    used: Sequence[str]
    """The sensors that went into each row, with a space between their names."""
    refused: Sequence[str]
    """The sensors that did not meet the prediction, likewise."""
    shares: FloatArray
    """0 is the measurement alone, 1 the prediction alone, NaN where there was no update, shape (N,)."""
    margins: FloatArray
    """The least overlap of the sets that were fused, NaN where none were, shape (N,)."""
    errors: FloatArray | None = None
    """[ζ; δω] or [ζ; δβ] of the truth from the estimate, rad and rad/s, NaN where it is not known, shape (N, 6)."""
    forms: FloatArray | None = None
    """[x; δω]ᵀ P⁻¹ [x; δω] of the truth, at most 1 inside the set, NaN where it is not known, shape (N,)."""
    chart: Chart = "exponential"
    """Whether x is ζ, or γ = 2 tan(θ/2) n of the same turn, as in the guaranteed mode."""
    claims: Sequence[str] | None = None
    """What each set rests on: "unconditional", "conditional" or "none"; in the guaranteed mode, as the next three."""
    prediction_used: FloatArray | None = None
    """1 where the prediction went into the set, 0 where it did not, shape (N,)."""
    dropped: Sequence[str] | None = None
    """The sensors that were left out or proved wrong, with a space between their names."""
    tilt_bounds: FloatArray | None = None
    """Bound of the angle between estimated and true up, rad, shape (N,); None where up is not known."""
    headings: FloatArray | None = None
    """The turn about the vertical from the estimate to the truth, at least and at most, rad, shape (N, 2)."""
    ups: FloatArray | None = None
    """Up as well as it is known, unit vectors, body axes; also where no attitude is known, shape (N, 3)."""
    up_bounds: FloatArray | None = None
    """How far true up may be from there, rad, shape (N,)."""
    up_claims: Sequence[str] | None = None
    """What that rests on, in the words of ``claims``."""
    best_quaternions: FloatArray | None = None
    """(qw, qx, qy, qz) of the best estimate, which need not be the center of the set, shape (N, 4)."""
    best_bounds: FloatArray | None = None
    """How far it may be off, rad, shape (N,)."""
    best_tilt_bounds: FloatArray | None = None
    """Bound of the angle between its up and true up, rad, shape (N,)."""
    best_headings: FloatArray | None = None
    """The turn about the vertical from it to the truth, at least and at most, rad, modulo 2π, shape (N, 2)."""
    best_tilt_claims: Sequence[str] | None = None
    """What its bound of the tilt rests on, in the words of ``claims``, which are for the others."""
    best_from: Sequence[str] | None = None
    """Whose estimate it is: "vqf", "kalman", "center" or "" where there is none."""
    best_put_back: FloatArray | None = None
    """1 where it was outside the unconditional set, and was moved onto its boundary, else 0, shape (N,)."""
    roll_pitch_yaw: FloatArray | None = None
    """Roll, pitch and yaw of the third reference axis as `ups` has it, and of the attitude: each angle, and between
    which ones the truth is, rad, shape (N, 9), in the order of the columns; None where up is not known."""
    turns_reference: FloatArray | None = None
    """Between which angles the turn about each reference axis from the estimate to the truth is, rad, shape (N, 6).

    These and the following answer questions of their own, and are None if these were not asked.
    """
    turns_body: FloatArray | None = None
    """The same about each body axis, shape (N, 6)."""
    vector_ranges: FloatArray | None = None
    """Between what each component of the angular velocity or the gyro bias is, rad/s, body axes, shape (N, 6)."""
    own_quaternions: FloatArray | None = None
    """(qw, qx, qy, qz) of the center of the attitude's own set, shape (N, 4)."""
    own_shapes: FloatArray | None = None
    """P of γ = 2 tan(θ/2) n about that center, rad², shape (N, 3, 3)."""
    turns_reference_forms: FloatArray | None = None
    """At most 1 where the turns of the truth about the reference axes are within theirs, NaN where the truth is not
    known, shape (N,); this and the next three are None without a truth."""
    turns_body_forms: FloatArray | None = None
    """The same about the body axes, shape (N,)."""
    vector_forms: FloatArray | None = None
    """The same of the angular velocity or the gyro bias, shape (N,)."""
    own_forms: FloatArray | None = None
    """γᵀ P⁻¹ γ of the truth in the attitude's own set, shape (N,)."""
    clock_turns: FloatArray | None = None
    """How far the body may turn within the offset of the gyro's stamps, which the rows have, rad, shape (N,).

    Attitudes with other stamps may be as far from a row's set; None if no offset is stated.
    """
    origin: int = 0
    """The second of the recording's clock that the times count from."""

    @property
    def attitudes(self) -> FloatArray:
        """From body to reference axes, NaN where they are not known, shape (N, 3, 3)."""
        return attitudes_from_quaternions(self.quaternions)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a table of results, in whole or not at all.

        Parameters
        ----------
        path : path-like
            Ends in ``.csv`` or ``.parquet``.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        write_columns(path, "results", self.columns(), origin=self.origin)

    def columns(self) -> dict[str, Column]:
        """The table's columns by name."""
        vector = _VECTORS[self.vector]
        columns: dict[str, Column] = {"time_s": self.times}
        _add(columns, QUATERNION, self.quaternions)
        _add(columns, vector, self.vectors)
        _add(columns, _SHAPE, self.shapes[:, *_UPPER])
        _add(columns, _per_axis("half_width", vector), self.half_widths)
        columns |= {
            "largest_angle": self.largest_angles,
            "used": self.used,
            "refused": self.refused,
            "share": self.shares,
            "margin": self.margins,
        }
        _add(columns, _per_axis("error", vector), self.errors)
        _add(columns, ("form",), None if self.forms is None else self.forms[:, None])
        charts = None if self.chart == "exponential" else [self.chart] * len(self.times)
        texts = {"claim": self.claims, "dropped": self.dropped, "chart": charts, "up_claim": self.up_claims}
        texts |= {"best_tilt_claim": self.best_tilt_claims, "best_from": self.best_from}
        columns |= {name: values for name, values in texts.items() if values is not None}
        for name, values in (
            ("prediction_used", self.prediction_used),
            ("tilt_bound", self.tilt_bounds),
            ("up_bound", self.up_bounds),
            ("best_bound", self.best_bounds),
            ("best_tilt_bound", self.best_tilt_bounds),
            ("best_put_back", self.best_put_back),
            ("turn_within_offset", self.clock_turns),
            *zip(_ANSWER_FORMS, self._answer_forms(), strict=True),
        ):
            _add(columns, (name,), None if values is None else values[:, None])
        _add(columns, HEADINGS, self.headings)
        _add(columns, UP, self.ups)
        _add(columns, BEST_QUATERNION, self.best_quaternions)
        _add(columns, BEST_HEADINGS, self.best_headings)
        _add(columns, ROLL_PITCH + YAW, self.roll_pitch_yaw)
        _add(columns, TURNS_REFERENCE, self.turns_reference)
        _add(columns, TURNS_BODY, self.turns_body)
        _add(columns, vector_ranges(self.vector), self.vector_ranges)
        _add(columns, OWN_QUATERNION, self.own_quaternions)
        _add(columns, OWN_SHAPE, None if self.own_shapes is None else self.own_shapes[:, *np.triu_indices(3)])
        return columns

    def _answer_forms(self) -> tuple[FloatArray | None, ...]:
        return tuple(getattr(self, name) for name in _FORMS_OF_ANSWERS)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Read a table of results.

        Parameters
        ----------
        path : path-like
            CSV, which may be compressed, or Parquet.

        Returns
        -------
        Result

        Raises
        ------
        FileError
            If it is not such a table; the message names file, line and column.
        """
        names = column_names(path, "results")
        vector: VectorName = "bias" if "bias_x" in names else "rate"
        half_widths, errors = (_per_axis(what, _VECTORS[vector]) for what in ("half_width", "error"))
        with_errors = errors[0] in names
        of_attitude = (*QUATERNION, *ATTITUDE_SHAPE, *half_widths[:3], "largest_angle")
        of_vector = (*_VECTORS[vector], *(name for name in _SHAPE if name not in ATTITUDE_SHAPE), *half_widths[3:])
        # Without a set, which such a table says, there is no estimate, and a bias may be none.
        guaranteed = "claim" in names
        further: list[tuple[str, ...]] = [(name,) for name in _NUMBERS_OF_QUESTIONS if name in names]
        together = (HEADINGS, UP, BEST_QUATERNION, BEST_HEADINGS, ROLL_PITCH, YAW, *_ANSWERS, vector_ranges(vector))
        further += [several for several in together if several[0] in names]
        columns = read_columns(
            path,
            numbers=() if guaranteed else of_attitude + of_vector,
            # Where the truth is one of the attitude alone, so are the errors.
            optional=[("share",), ("margin",)]
            + [errors[:3], errors[3:]] * with_errors
            + further
            + [of_attitude, of_vector] * guaranteed,
            texts=("used", "refused", *(name for name in _TEXTS_OF_QUESTIONS if name in names)),
        )
        return cls(
            times=columns["time_s"],
            quaternions=stacked(columns, QUATERNION),
            vector=vector,
            vectors=stacked(columns, _VECTORS[vector]),
            shapes=symmetric(columns, _SHAPE),
            half_widths=stacked(columns, half_widths),
            largest_angles=columns["largest_angle"],
            used=tuple(columns["used"]),
            refused=tuple(columns["refused"]),
            shares=columns["share"],
            margins=columns["margin"],
            errors=stacked(columns, errors) if with_errors else None,
            forms=columns.get("form"),
            chart="gibbs" if "chart" in names and "gibbs" in columns["chart"] else "exponential",
            claims=tuple(columns["claim"]) if guaranteed else None,
            prediction_used=columns.get("prediction_used"),
            dropped=tuple(columns["dropped"]) if "dropped" in names else None,
            tilt_bounds=columns.get("tilt_bound"),
            headings=stacked(columns, HEADINGS) if HEADINGS[0] in names else None,
            ups=stacked(columns, UP) if UP[0] in names else None,
            up_bounds=columns.get("up_bound"),
            up_claims=tuple(columns["up_claim"]) if "up_claim" in names else None,
            best_quaternions=stacked(columns, BEST_QUATERNION) if BEST_QUATERNION[0] in names else None,
            best_bounds=columns.get("best_bound"),
            best_tilt_bounds=columns.get("best_tilt_bound"),
            best_headings=stacked(columns, BEST_HEADINGS) if BEST_HEADINGS[0] in names else None,
            best_tilt_claims=tuple(columns["best_tilt_claim"]) if "best_tilt_claim" in names else None,
            best_from=tuple(columns["best_from"]) if "best_from" in names else None,
            best_put_back=columns.get("best_put_back"),
            roll_pitch_yaw=stacked(columns, ROLL_PITCH + YAW) if YAW[0] in names else None,
            turns_reference=stacked_if_there(columns, TURNS_REFERENCE),
            turns_body=stacked_if_there(columns, TURNS_BODY),
            vector_ranges=stacked_if_there(columns, vector_ranges(vector)),
            own_quaternions=stacked_if_there(columns, OWN_QUATERNION),
            own_shapes=symmetric(columns, OWN_SHAPE) if OWN_SHAPE[0] in names else None,
            origin=time_origin(path),
            clock_turns=columns.get("turn_within_offset"),
            **{name: columns.get(column) for name, column in zip(_FORMS_OF_ANSWERS, _ANSWER_FORMS, strict=True)},
        )


def vector_ranges(vector: VectorName) -> tuple[str, ...]:
    """The columns of what each component of the angular velocity or the gyro bias is between."""
    return tuple(f"{name}_{end}" for name in _VECTORS[vector] for end in ("from", "to"))


def stacked_if_there(columns: Mapping[str, Any], names: tuple[str, ...]) -> FloatArray | None:
    """The columns as one array, shape (N, len(names)); None if the table does not have them."""
    return stacked(columns, names) if names[0] in columns else None


def quaternions_from_attitudes(attitudes: FloatArray) -> FloatArray:
    """(qw, qx, qy, qz) with qw ≥ 0, shape (N, 4), of rotations of shape (N, 3, 3); NaN where they are."""
    known = np.isfinite(attitudes[:, 0, 0])
    quaternions = np.full((len(attitudes), 4), np.nan)
    if known.any():
        quaternions[known] = scipy.spatial.transform.Rotation.from_matrix(attitudes[known]).as_quat(
            canonical=True, scalar_first=True
        )
    return quaternions


def attitudes_from_quaternions(quaternions: FloatArray) -> FloatArray:
    """Rotations, shape (N, 3, 3), of (qw, qx, qy, qz), shape (N, 4); NaN where they are."""
    known = np.isfinite(quaternions[:, 0])
    attitudes = np.full((len(quaternions), 3, 3), np.nan)
    if known.any():
        attitudes[known] = scipy.spatial.transform.Rotation.from_quat(quaternions[known], scalar_first=True).as_matrix()
    return attitudes


def measured(sensor: str) -> tuple[str, str, str]:
    """The columns of a measured direction, body axes."""
    return (f"{sensor}_bx", f"{sensor}_by", f"{sensor}_bz")


def reference(sensor: str) -> tuple[str, str, str]:
    """The columns of the same direction in reference axes."""
    return (f"{sensor}_ex", f"{sensor}_ey", f"{sensor}_ez")


def as_measured(sensor: str) -> tuple[str, str, str]:
    """The columns of what a sensor of a direction measured with its length, body axes."""
    return (f"{sensor}_mx", f"{sensor}_my", f"{sensor}_mz")


def moving_reference(sensor: str) -> tuple[str, str, str]:
    """The columns of a reference that moves, with its length."""
    return (f"{sensor}_rx", f"{sensor}_ry", f"{sensor}_rz")


def own_stamps(sensor: str) -> str:
    """The column of when a direction was measured, where that is not the time of its row."""
    return f"{sensor}_time_s"


def names_of_chosen(names: list[str], chosen: NDArray[np.bool_]) -> list[str]:
    """The names chosen in each row, a space between them; texts are made once for each choice that occurs."""
    codes = np.zeros(len(chosen), dtype=np.intp)
    texts = [""]
    for name, column in zip(names, chosen.T, strict=True):
        # Codes of what was chosen so far that go on with and without this name.
        found, codes = np.unique(2 * codes + column, return_inverse=True)
        texts = [f"{texts[code // 2]} {name}".strip() if code % 2 else texts[code // 2] for code in found]
    return [texts[code] for code in codes.tolist()]


def _per_axis(what: str, vector: tuple[str, str, str]) -> tuple[str, ...]:
    return tuple(f"{what}_{axis}" for axis in ("rx", "ry", "rz", *vector))


def _add(columns: dict[str, Column], names: Sequence[str], values: FloatArray | None) -> None:
    """Add the columns of ``values``, shape (N, len(names)), if there are any."""
    if values is not None:
        columns.update(zip(names, values.T, strict=True))
