"""The sensors of a configuration: which columns, in which unit and axes, with what delay, reference and bound.

Directions, measured angular velocity and what to compare with; see ``docs/logs.md`` for each key.
"""

import math
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from elliptude import units
from elliptude.configuration.statements import (
    SUN_ERROR_DEG,
    SUN_RATE,
    AccelerationBound,
    AccelerometerError,
    AngleBound,
    FieldBound,
    MagnetometerError,
    RestPhase,
    SunByTime,
    VelocityWindowBound,
    WorldModel,
)
from elliptude.io.readers.text.dialect import Decimal, Delimiter, Stated
from elliptude.io.toml import (
    Angle,
    Column,
    Columns,
    FieldVector,
    Gravity,
    Matrix,
    Model,
    NonzeroVector,
    Number,
    Positive,
    PositiveSize,
    QuaternionColumns,
    Size,
    SizedBound,
    exactly_one,
    one_word,
)
from elliptude.typing import FloatArray

# A rotation in a file may have few digits.
_ROTATION_TOLERANCE = 1e-4


def _known_encoding(name: str) -> str:
    try:
        "a".encode(name)  # of an empty text Python does not even look for the name
    except (LookupError, UnicodeError) as error:
        raise ValueError("must be the name of an encoding, such as 'utf-8', 'utf-16' or 'latin-1'") from error
    return name


Encoding = Annotated[str, AfterValidator(_known_encoding)]


def _rotation(axes: tuple[str, str, str] | Matrix) -> tuple[str, str, str] | Matrix:
    matrix = _as_written(axes)
    deviation = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if deviation > _ROTATION_TOLERANCE or np.linalg.det(matrix) < 0.0:
        raise ValueError("must be a rotation: perpendicular axes of length 1, right-handed")
    return axes


def rotation_of_axes(axes: tuple[str, str, str] | Matrix) -> FloatArray:
    """The rotation (3, 3) that takes sensor axes to body axes: of a matrix, written with few digits, the nearest one.

    Parameters
    ----------
    axes : tuple of 3 str, or of 3 rows
        Such as ("y", "-x", "z"): the body's x is the sensor's y, its y the sensor's -x.

    Returns
    -------
    (3, 3) array
    """
    matrix = _as_written(axes)
    if isinstance(axes[0], str):
        return matrix
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right, dtype=np.float64)


def _as_written(axes: tuple[str, str, str] | Matrix) -> FloatArray:
    if isinstance(axes[0], str):
        matrix = np.zeros((3, 3))
        for row, name in zip(matrix, axes, strict=True):
            assert isinstance(name, str)
            row["xyz".index(name[-1])] = -1.0 if name[0] == "-" else 1.0
        return matrix
    return np.asarray(axes, dtype=np.float64)


AxisName = Literal["x", "y", "z", "-x", "-y", "-z", "+x", "+y", "+z"]
Axes = Annotated[tuple[AxisName, AxisName, AxisName] | Matrix, AfterValidator(_rotation)]
"""From sensor to body axes."""
ReferenceFrame: TypeAlias = Literal["ENU", "NED", "NWU", "J2000"]


class Csv(Model):
    """How a CSV file is written; what is left out is found out from the file."""

    delimiter: Delimiter | None = None
    decimal: Decimal | None = None
    encoding: Encoding | None = None
    # Whether the row below the header has units.
    units_row: bool | None = None
    # How many packets of Xsens there are in a second; in the place of what the file says.
    packet_rate_hz: PositiveSize | None = None

    def stated(self) -> Stated:
        """For the reader."""
        return Stated(self.delimiter, self.decimal, self.encoding, self.units_row, self.packet_rate_hz)


class Timing(Model):
    """What to do about faulty time stamps and rows."""

    # Whatever is listed by `elliptude.logs.repair` is left out, and becomes a gap; nothing is refused for it.
    repair: bool = False

    # Rows of the same time: refused, or taken as one row, in which the first measurement of each sensor counts.
    repeated: Literal["refuse", "merge"] = "refuse"
    # Rows that are earlier than one before: refused, or left out.
    backward: Literal["refuse", "drop"] = "refuse"
    # NaN in a format with empty cells (CSV, Parquet): refused, or taken as empty. One component is enough then.
    not_a_number: Literal["refuse", "missing"] = "refuse"
    # The gyro's longest gap: a longer one is refused; within it, empty cells are bridged.
    largest_gap_s: PositiveSize | None = None
    # Stamps of different sensors that are this close make one row, at the first of them, after delays are subtracted.
    same_within_s: Size = 1e-9
    # Times as in the file, or from the whole second of the log's first stamp; left out, as in the file unless whole
    # numbers would lose digits as seconds.
    origin: Literal["file", "first"] | None = None
    # Rows in a second, of a file without times; none may be missing.
    row_rate_hz: Annotated[Positive, Field(le=1e6)] | None = None

    @model_validator(mode="after")
    def _counts_all_rows(self) -> Self:
        if self.repair and self.row_rate_hz is not None:
            raise ValueError("row_rate_hz: a repair leaves rows out, and times that are counted by rows would be wrong")
        return self

    def effective(self) -> Self:
        """The same with all that a repair implies: repeated rows are merged, NaN is missing."""
        return self.model_copy(update={"repeated": "merge", "not_a_number": "missing"}) if self.repair else self


class Timed(Model):
    """Columns with a time. The log's time column holds for all that do not name their own."""

    time_column: Column | None = None
    time_unit: units.TimeUnit | None = None
    # How much later than the measurement the stamp is: subtracted from it; of another clock perhaps since 1970.
    delay_s: Annotated[Number, Field(ge=-1e10, le=1e10)] = 0.0
    # How far else the stamps may be off, either way: for the bounds.
    time_offset_bound_s: Size = 0.0

    @model_validator(mode="after")
    def _has_a_clock(self) -> Self:
        if (self.time_column is None) != (self.time_unit is None):
            raise ValueError("time_column and time_unit belong together")
        return self


class DirectionBase(Timed):
    """What a direction needs whatever measures it. Rows without it are empty in the log."""

    name: Annotated[str, AfterValidator(one_word)]
    columns: Columns
    axes: Axes = ("x", "y", "z")
    bound_deg: Angle | None = None
    bound_rad2: Matrix | None = None
    bound_from: AngleBound | AccelerationBound | VelocityWindowBound | FieldBound | None = None
    # How far the reference direction and the sensor's axes may be off: they add to the bound. Left out, that of the Sun
    # by time is `SUN_ERROR_DEG`, that by a phase of rest what its sensors may be off there, of other references 0.
    reference_error_deg: Size | None = None
    alignment_error_deg: Size = 0.0
    weight: Positive = 1.0

    @model_validator(mode="after")
    def _has_one_bound(self) -> Self:
        if any(getattr(self, key) is not None for key in ("bound_deg", "bound_rad2", "bound_from")):
            exactly_one(self, "bound_deg", "bound_rad2", "bound_from")
        if self.bound_rad2 is not None and (self.reference_error_deg or self.alignment_error_deg):
            raise ValueError("reference_error_deg and alignment_error_deg add to an angle, not to bound_rad2")
        return self

    @property
    def added_angle(self) -> float:
        """What errors of reference and alignment add to the bound, rad."""
        of_reference = self._usual_reference_error if self.reference_error_deg is None else self.reference_error_deg
        return math.radians(of_reference + self.alignment_error_deg)

    @property
    def _usual_reference_error(self) -> float:
        """How far the reference direction may be off where that is not stated, degrees."""
        return 0.0

    @property
    def is_bound_by_angle(self) -> bool:
        """Whether what is stated is an angle, the same for every sample."""
        by_shape = self.bound_deg is not None or self.bound_rad2 is not None
        return by_shape or isinstance(self.bound_from, AngleBound)

    @property
    def reference_rate(self) -> float:
        """How fast the reference direction turns at most, in reference axes, rad/s."""
        return 0.0

    def require_complete(self) -> None:
        """Raise ValueError unless the sensor has its bound and its reference, as without a rule it must."""
        exactly_one(self, "bound_deg", "bound_rad2", "bound_from")

    def bound(self) -> FloatArray:
        """The shape (3, 3) of its error ellipsoid, rad², if it is the same for every sample.

        Raises
        ------
        ValueError
            If it is not.
        """
        if self.bound_rad2 is not None:
            return np.asarray(self.bound_rad2, dtype=np.float64)
        angle_deg = self.bound_from.angle_deg if isinstance(self.bound_from, AngleBound) else self.bound_deg
        if angle_deg is None:
            assert self.bound_from is not None
            why = f"its bound of kind {self.bound_from.kind!r} is another at each sample, which this mode does not take"
            raise ValueError(f"{self.name!r}: {why}; give bound_deg or bound_rad2")
        return np.eye(3) * (math.radians(angle_deg) + self.added_angle) ** 2


class Direction(DirectionBase):
    """A direction measured in body axes, and the same one in reference axes. Its length says nothing."""

    kind: Literal["direction"] = "direction"
    reference: NonzeroVector | SunByTime | None = None
    reference_columns: Columns | None = None
    # How fast the reference in the columns turns at most, in reference axes: it moves while a stamp is off.
    reference_rate_deg_per_s: Size | None = None
    bound_from: AngleBound | None = None

    @model_validator(mode="after")
    def _has_a_reference(self) -> Self:
        exactly_one(self, "reference", "reference_columns")
        if self.reference_rate_deg_per_s is not None and self.reference_columns is None:
            raise ValueError("reference_rate_deg_per_s: is of reference_columns; how fast the Sun moves is known")
        return self

    @property
    def _usual_reference_error(self) -> float:
        return SUN_ERROR_DEG if isinstance(self.reference, SunByTime) else 0.0

    @property
    def reference_rate(self) -> float:
        """How fast the reference direction turns at most, in reference axes, rad/s."""
        if isinstance(self.reference, SunByTime):
            return SUN_RATE
        return math.radians(self.reference_rate_deg_per_s or 0.0)


class Accelerometer(DirectionBase):
    """A direction that is up while the body does not accelerate: at rest an accelerometer shows +g upwards."""

    kind: Literal["accelerometer"]
    unit: units.AccelerationUnit
    # Which way its vector points at rest: "down" is for drivers that report the opposite, and its sign is reversed.
    at_rest: Literal["up", "down"] = "up"
    gravity_m_per_s2: Gravity = units.STANDARD_GRAVITY
    sensor_error: AccelerometerError = AccelerometerError()
    bound_from: Annotated[AngleBound | AccelerationBound | VelocityWindowBound, Field(discriminator="kind")] | None = (
        None
    )


class Magnetometer(DirectionBase):
    """The direction of the Earth's field. The reference vector's length, in µT, is its strength."""

    kind: Literal["magnetometer"]
    unit: units.MagnetometerUnit
    # How many µT a normalized sensor's 1 is, at least: what is stated in µT then covers its errors.
    unit_ut: Annotated[Positive, Field(le=1000.0)] | None = None
    reference_ut: FieldVector | None = None
    reference: Annotated[WorldModel | RestPhase, Field(discriminator="kind")] | None = None
    sensor_error: MagnetometerError = MagnetometerError()
    bound_from: Annotated[AngleBound | FieldBound, Field(discriminator="kind")] | None = None

    @model_validator(mode="after")
    def _has_one_reference(self) -> Self:
        if self.reference is not None or self.reference_ut is not None:
            exactly_one(self, "reference", "reference_ut")
        return self

    @model_validator(mode="after")
    def _says_what_its_unit_is(self) -> Self:
        if (self.unit == "normalized") != (self.unit_ut is not None):
            raise ValueError("unit = 'normalized' and unit_ut, how many µT one unit is at least, belong together")
        measured_by_itself = self.reference_ut is None and not isinstance(self.reference, WorldModel)
        by_length = isinstance(self.bound_from, FieldBound) and not measured_by_itself
        if self.unit == "normalized" and by_length and "scale_error" not in self.sensor_error.model_fields_set:
            raise ValueError(
                "sensor_error.scale_error: missing; the reference is in µT and the sensor is normalized: state how far "
                "unit_ut may be off, as a share"
            )
        return self

    @property
    def tesla(self) -> float:
        """How many tesla one unit is."""
        if self.unit == "normalized":
            assert self.unit_ut is not None  # the model's check
            return units.FIELD["uT"] * self.unit_ut
        return units.FIELD[self.unit]

    def require_complete(self) -> None:
        """Raise ValueError unless the sensor has its bound and its reference, as without a rule it must."""
        super().require_complete()
        exactly_one(self, "reference", "reference_ut")


def _direction_kind(table: Any) -> str:
    return str(table.get("kind", "direction")) if isinstance(table, dict) else str(getattr(table, "kind", "direction"))


AnyDirection: TypeAlias = Annotated[
    Annotated[Direction, Tag("direction")]
    | Annotated[Accelerometer, Tag("accelerometer")]
    | Annotated[Magnetometer, Tag("magnetometer")],
    Discriminator(_direction_kind),
]


class Rate(Timed):
    """A measured angular velocity. Rows without it are empty in the log."""

    columns: Columns
    unit: units.AngularVelocityUnit = "rad/s"
    axes: Axes = ("x", "y", "z")
    bound_deg_per_s: SizedBound | None = None
    bound_rad2_per_s2: Matrix | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        exactly_one(self, "bound_deg_per_s", "bound_rad2_per_s2")
        if self.time_offset_bound_s > 0.0:
            bound = "bound_deg_per_s" if self.bound_rad2_per_s2 is None else "bound_rad2_per_s2"
            raise ValueError(
                "time_offset_bound_s: is not for a measured rate, as torques may change it by any amount: add to "
                f"rate.{bound} how much the rate changes in that time, and leave it out"
            )
        return self

    def bound(self) -> FloatArray:
        """The shape (3, 3) of its error ellipsoid, (rad/s)²."""
        if self.bound_deg_per_s is not None:
            return np.eye(3) * math.radians(self.bound_deg_per_s) ** 2
        return np.asarray(self.bound_rad2_per_s2, dtype=np.float64)


class Velocity(Timed):
    """A measured velocity, as of a receiver of satellites: it says how much of a specific force is acceleration.

    The axes are any that do not turn, as north, east and down. Rows without it are empty in the log.
    """

    columns: Columns
    unit: units.VelocityUnit = "m/s"
    # The length of its error at the time on the stamp, of where the accelerometer is.
    error_m_per_s: Annotated[Size, Field(le=1e6)]
    # How fast the velocity changes at most: between a stamp and a row, and while a stamp is off.
    largest_acceleration_m_per_s2: Annotated[Size, Field(le=1e6)]


class Truth(Timed):
    """What the log has to compare with; the estimator never sees it. ``label`` names it in figures."""

    attitude_columns: QuaternionColumns
    # In which order attitude_columns names them, and whether they turn vectors from body to reference axes or back.
    order: Literal["wxyz", "xyzw"] = "wxyz"
    turns: Literal["body_to_reference", "reference_to_body"] = "body_to_reference"
    vector_columns: Columns | None = None
    vector_unit: units.AngularVelocityUnit = "rad/s"
    label: str = "truth"
    # How far it may itself be off: it counts as inside if an attitude that near to it is.
    error_deg: Size = 0.0
