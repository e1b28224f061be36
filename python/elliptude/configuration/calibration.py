"""Calibrations of sensors as TOML: what `elliptude calibrate` starts from, what it writes, and what follows from it.

A calibration corrects a sensor's samples when a log is read, and says how far a corrected sample may still be off.
"""

import os
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from elliptude import units
from elliptude.bounds.samples import AVERAGED_OVER_S, VectorSensorBounds
from elliptude.configuration.sensors import Accelerometer, Axes, Magnetometer, rotation_of_axes
from elliptude.io.toml import Column, Columns, Matrix, Model, NotNegative, Number, Vector, read_toml
from elliptude.typing import FloatArray

Fraction = Annotated[Number, Field(ge=0, lt=0.5)]
# Squares and products of what is stated must stay far from what overflows.
Size = Annotated[Number, Field(ge=0, le=1e9)]
Over = Annotated[Number, Field(ge=0, le=1e9)]
Strength = Annotated[Number, Field(gt=0, le=1e9)]
STRONGEST_FIELD_UT = 5000.0
"""Small magnetometers show no more (AK8963: 4912), a hundred times the Earth's field."""
FieldSize = Annotated[Number, Field(ge=0, le=STRONGEST_FIELD_UT)]
FieldStrength = Annotated[Number, Field(gt=0, le=STRONGEST_FIELD_UT)]
Angle = Annotated[Number, Field(ge=0, le=180)]
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


# --- what is stated of a recording to calibrate from ------------------------------------------------------------------


class AccelerometerStatements(Model):
    """What is known of an accelerometer, and of its rests."""

    offset_m_per_s2: Size
    scale_error: Fraction
    misalignment_deg: Angle | None = None
    noise_m_per_s2: Size
    averaged_noise_m_per_s2: Size
    # The same for logs that the calibration is for: what moves or vibrates is noisier than what lies on a table.
    later_noise_m_per_s2: Size
    later_averaged_noise_m_per_s2: Size
    # How long the shortest mean is that both averaged ones are stated for.
    averaged_over_s: Over = AVERAGED_OVER_S
    rest_s: Strength
    velocity_m_per_s: Size
    acceleration_m_per_s2: Size


class MagnetometerStatements(Model):
    """What is known of a magnetometer, and of the field in which it is turned."""

    offset_ut: FieldSize
    scale_error: Fraction
    misalignment_deg: Angle | None = None
    noise_ut: FieldSize
    averaged_noise_ut: FieldSize
    later_noise_ut: FieldSize
    later_averaged_noise_ut: FieldSize
    averaged_over_s: Over = AVERAGED_OVER_S
    disturbance_ut: FieldSize
    strength_ut: tuple[FieldStrength, FieldStrength]

    @model_validator(mode="after")
    def _is_an_interval(self) -> Self:
        if self.strength_ut[0] > self.strength_ut[1]:
            raise ValueError("strength_ut must be the least and the greatest, in this order")
        return self


class GyroStatements(Model):
    """What is known of a gyro, if it is another than what the rule states."""

    noise_deg_per_s: Size
    bias_deg_per_s: Size
    scale_error: Fraction
    increment_deg: Strength | None = None


class CalibrationStatements(Model):
    """What is known of the sensors before they are calibrated, and of the recording that they are calibrated from."""

    accelerometer: AccelerometerStatements
    magnetometer: MagnetometerStatements
    gyro: GyroStatements | None = None


def read_statements(path: str | os.PathLike[str] | None = None) -> CalibrationStatements:
    """Read the statements in a TOML file; without one, those for a sensor in the hand.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML, or does not fit.
    """
    if path is not None:
        return read_toml(path, CalibrationStatements)
    with resources.as_file(resources.files("elliptude") / "data" / "calibration" / "hand_held.toml") as file:
        return read_toml(file, CalibrationStatements)


# --- what a calibration says ------------------------------------------------------------------------------------------


class SensorCalibration(Model):
    """A sensor by its columns and axes, and the matrix of its correction."""

    name: str
    columns: Columns
    axes: Axes = ("x", "y", "z")
    matrix: Matrix = IDENTITY
    # How far a corrected sample may be off by scale, axes that are not perpendicular, and the sensor's turn.
    scale_error: Annotated[NotNegative, Field(lt=1)]

    @model_validator(mode="after")
    def _can_be_undone(self) -> Self:
        if not np.linalg.det(np.asarray(self.matrix)) > 0.0:
            raise ValueError("matrix must have a positive determinant")
        return self

    def corrects_scale(self) -> bool:
        """Whether the matrix is another than the identity."""
        return self.matrix != IDENTITY


class VectorCalibration(SensorCalibration):
    """An accelerometer or a magnetometer: matrix (sample - offset), body axes."""

    poses: Annotated[int, Field(ge=0, le=1_000_000_000)] = 0

    def corrects(self) -> bool:
        """Whether samples change by it."""
        return self.corrects_scale() or bool(np.any(self.offset()))

    def offset(self) -> FloatArray:
        """What is subtracted from a sample, shape (3,), SI units."""
        raise NotImplementedError

    def is_of(self, sensor: Accelerometer | Magnetometer) -> bool:
        """Whether it is of this sensor."""
        return self.columns == sensor.columns

    def why_not(self, sensor: Accelerometer | Magnetometer) -> str | None:
        """What differs between a sensor of the same columns and the one that was calibrated."""
        if not np.array_equal(rotation_of_axes(self.axes), rotation_of_axes(sensor.axes)):
            return "axes"
        return None


class AccelerometerCalibration(VectorCalibration):
    """An accelerometer's."""

    kind: Literal["accelerometer"]
    unit: units.AccelerationUnit
    at_rest: Literal["up", "down"] = "up"
    offset_m_per_s2: Vector
    error_m_per_s2: NotNegative
    averaged_error_m_per_s2: NotNegative
    averaged_over_s: NotNegative = AVERAGED_OVER_S

    def why_not(self, sensor: Accelerometer | Magnetometer) -> str | None:
        """What differs between a sensor of the same columns and the one that was calibrated."""
        assert isinstance(sensor, Accelerometer)
        if (self.unit, self.at_rest) != (sensor.unit, sensor.at_rest):
            return "unit or at_rest"
        return super().why_not(sensor)

    def offset(self) -> FloatArray:
        """In SI units, shape (3,)."""
        return np.asarray(self.offset_m_per_s2, dtype=np.float64)

    def left(self) -> tuple[float, float]:
        """How far a corrected sample may be off by offset and noise, and the mean over a window."""
        return self.error_m_per_s2, self.averaged_error_m_per_s2


class MagnetometerCalibration(VectorCalibration):
    """A magnetometer's."""

    kind: Literal["magnetometer"]
    unit: units.FieldUnit
    offset_ut: Vector
    error_ut: NotNegative
    averaged_error_ut: NotNegative
    averaged_over_s: NotNegative = AVERAGED_OVER_S

    def why_not(self, sensor: Accelerometer | Magnetometer) -> str | None:
        """What differs between a sensor of the same columns and the one that was calibrated."""
        return "unit" if self.unit != sensor.unit else super().why_not(sensor)

    def offset(self) -> FloatArray:
        """In SI units, shape (3,)."""
        return units.FIELD["uT"] * np.asarray(self.offset_ut, dtype=np.float64)

    def left(self) -> tuple[float, float]:
        """How far a corrected sample may be off by offset and noise, and the mean over a window."""
        return self.error_ut, self.averaged_error_ut


class GyroCalibration(SensorCalibration):
    """A gyro: matrix times sample, body axes. Its bias is that of a rest, in each recording anew."""

    kind: Literal["gyro"]
    unit: units.AngularVelocityUnit
    turns: Annotated[int, Field(ge=0, le=1_000_000_000)] = 0
    # What was stated beside the scale error while it was calibrated; as in the rule if it is left out.
    noise_deg_per_s: NotNegative | None = None
    bias_deg_per_s: NotNegative | None = None
    increment_deg: Annotated[Number, Field(gt=0)] | None = None

    def noise_factor(self) -> float:
        """What the matrix makes of noise and bias, at most."""
        return float(np.linalg.norm(np.asarray(self.matrix), 2)) * (1.0 + 1e-12) if self.corrects_scale() else 1.0


AnyCalibration: TypeAlias = Annotated[
    AccelerometerCalibration | MagnetometerCalibration | GyroCalibration, Field(discriminator="kind")
]
# Only to weigh a scale error against an offset: which of two statements says more.
_USUAL_LENGTH = {"accelerometer": units.STANDARD_GRAVITY, "magnetometer": 50.0}


class Calibration(Model):
    """What was found from a recording, sensor by sensor."""

    recording: str
    recording_sha256: str
    sensors: tuple[AnyCalibration, ...]

    @model_validator(mode="after")
    def _has_a_sensor_once(self) -> Self:
        columns = [one.columns for one in self.sensors]
        for i, one in enumerate(columns):
            if one in columns[:i]:
                raise ValueError(
                    f"sensors: [{columns.index(one)}] and [{i}] are of the same columns, {', '.join(one)}; a "
                    "sensor has one table"
                )
        return self

    def calibration(self) -> Self:
        """The tables themselves."""
        return self


class CalibrationDocument(Model):
    """The file that `elliptude calibrate` writes."""

    calibration: Calibration


class CalibrationFile(Model):
    """A calibration in a file of its own, which a relative name finds beside the configuration."""

    file: Column

    def calibration(self) -> Calibration:
        """The tables in the file.

        Raises
        ------
        FileError
            If the file cannot be read or does not fit.
        """
        return read_toml(self.file, CalibrationDocument).calibration

    def beside(self, path: str | os.PathLike[str]) -> Self:
        """The same, found from the folder of a configuration."""
        return self.model_copy(update={"file": str(Path(path).parent / self.file)})


def _in_a_file(table: Any) -> str:
    is_file = "file" in table if isinstance(table, dict) else isinstance(table, CalibrationFile)
    return "file" if is_file else "table"


StatedCalibration: TypeAlias = Annotated[
    Annotated[Calibration, Tag("table")] | Annotated[CalibrationFile, Tag("file")], Discriminator(_in_a_file)
]


def left_and_stated(
    found: AccelerometerCalibration | MagnetometerCalibration, stated: VectorSensorBounds
) -> tuple[float, float]:
    """How far a mean of corrected samples may be off, and of samples as they are by a statement, m/s² or µT.

    With what the scale errors make of the usual length, if they differ.
    """
    _, averaged = found.left()
    stated_average = stated.error if stated.averaged_error is None else stated.averaged_error
    if found.scale_error == stated.scale_error:
        return averaged, stated_average
    length = _USUAL_LENGTH[found.kind]
    return averaged + found.scale_error * length, stated_average + stated.scale_error * length


def calibrated_bounds(
    found: AccelerometerCalibration | MagnetometerCalibration, stated: VectorSensorBounds
) -> VectorSensorBounds | None:
    """How far a corrected sample may be off; None if nothing is corrected, or an uncorrected one may be less far off.

    What is scale and what is offset or noise is for a statement to say, and the calibration's own are used together: a
    smaller scale error that is stated beside other offsets and noise is of another way to take the sensor apart.
    """
    if not found.corrects():
        return None
    error, averaged = found.left()
    left, own = left_and_stated(found, stated)
    if not left < own:
        return None
    return VectorSensorBounds(error, found.scale_error, stated.misalignment, averaged, found.averaged_over_s)
