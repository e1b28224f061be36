"""All tables of a configuration, and what they say together: stamps, references, what a calibration leaves."""

import dataclasses
import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from elliptude import units
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.configuration.calibration import (
    AccelerometerCalibration,
    GyroCalibration,
    MagnetometerCalibration,
    StatedCalibration,
    calibrated_bounds,
    left_and_stated,
)
from elliptude.configuration.estimator import (
    Estimator,
    FirstMeasurementStart,
    GivenStart,
    HandHeldRule,
    RuleFile,
    StatedRule,
)
from elliptude.configuration.motion import GyroFlow, RigidBodyFlow
from elliptude.configuration.rules import Carried, Rule
from elliptude.configuration.sensors import (
    Accelerometer,
    AnyDirection,
    Csv,
    Magnetometer,
    Rate,
    ReferenceFrame,
    Timing,
    Truth,
    Velocity,
    rotation_of_axes,
)
from elliptude.io.readers.text.dialect import Stated
from elliptude.io.toml import Column, Model


class AllTables(Model):
    """What a configuration may state, whether it fits together or not."""

    time_column: Column = "time_s"
    time_unit: units.TimeUnit = "s"
    csv: Csv = Csv()
    timing: Timing = Timing()
    reference_frame: ReferenceFrame | None = None
    # What to do if sensors contradict one another as they do when a unit or an order is stated wrongly.
    implausible: Literal["refuse", "ignore"] = "refuse"
    flow: Annotated[RigidBodyFlow | GyroFlow, Field(discriminator="kind")]
    directions: tuple[AnyDirection, ...] = ()
    rate: Rate | None = None
    # For the windows of an accelerometer, by a rule or by `bound_from`.
    velocity: Velocity | None = None
    # The recording that the bounds are proposals from; removed once there is a reason for each.
    bounds_from_recording: str | None = None
    # Bounds of an inertial sensor by a rule for all recordings of its kind; the guaranteed mode alone.
    rule: Annotated[HandHeldRule | RuleFile | StatedRule, Field(discriminator="kind")] | None = None
    # Whose numbers are the usual ones where each sensor states its own bounds; a rule says it itself.
    carried: Carried | None = None
    # What `elliptude calibrate` found of the sensors: samples are corrected as they are read.
    calibration: StatedCalibration | None = None
    # The guaranteed mode starts from nothing if it is left out, or is of the kind first_measurement.
    start: Annotated[GivenStart | FirstMeasurementStart, Field(discriminator="kind")] | None = None
    estimator: Estimator = Estimator()
    truth: Truth | None = None

    def stated(self) -> Stated:
        """How its file is to be read."""
        return dataclasses.replace(self.csv.stated(), row_rate_hz=self.timing.row_rate_hz)

    @property
    def proposed_from(self) -> str | None:
        """The recording that the bounds are proposals from, here or in the file of a rule."""
        of_rule = None if self.rule is None else self.rule.rule().bounds_from_recording
        return self.bounds_from_recording or of_rule

    @property
    def frame(self) -> ReferenceFrame | None:
        """The reference frame, as stated or by a rule."""
        return self.reference_frame if self.rule is None else "ENU"

    @property
    def truth_error(self) -> float:
        """How far the truth may itself be off, rad."""
        return 0.0 if self.truth is None else math.radians(self.truth.error_deg)

    @property
    def estimates_vector(self) -> bool:
        """Whether angular velocity or gyro bias is estimated; the guaranteed mode may treat the bias as an error."""
        is_error = isinstance(self.flow, GyroFlow) and not self.flow.estimate_bias
        return not (is_error and self.estimator.mode == "guaranteed")

    @property
    def compares_vector(self) -> bool:
        """Whether forms include the vector, if its truth is known."""
        return self.estimates_vector and self.truth_error == 0.0 and self.time_offset_of_truth == 0.0

    @property
    def accelerometer(self) -> Accelerometer | None:
        """The first one among the directions."""
        return next((sensor for sensor in self.directions if isinstance(sensor, Accelerometer)), None)

    def time_offset_of(self, sensor: AnyDirection) -> float:
        """How far a direction's stamps may be off against the rows, which are at the gyro's times, s."""
        return sensor.time_offset_bound_s + self.time_offset_of_rows

    @property
    def time_offset_of_rows(self) -> float:
        """How far the stamps of rows, which are the gyro's, may be off against those of all others, s."""
        return self.flow.time_offset_bound_s if isinstance(self.flow, GyroFlow) else 0.0

    @property
    def time_offset_of_truth(self) -> float:
        """How far the stamps of what is compared with may be off against the rows, s."""
        return self.time_offset_of_rows + (0.0 if self.truth is None else self.truth.time_offset_bound_s)

    def correction_of(self, sensor: AnyDirection) -> AccelerometerCalibration | MagnetometerCalibration | None:
        """The calibration by which a sensor's samples are corrected, if there is one and it says more than is stated.

        Raises
        ------
        ValueError
            If it is of a sensor with these columns in another unit or other axes.
        """
        found = self._calibration_of(sensor)
        if found is None or not isinstance(sensor, Accelerometer | Magnetometer):
            return None
        # An angle is stated of samples as they are.
        by_angle = self.rule is None and (sensor.bound_from is None or sensor.bound_from.kind == "angle")
        return None if by_angle or calibrated_bounds(found, self._stated_bounds(sensor)) is None else found

    def sensor_bounds(self, sensor: Accelerometer | Magnetometer) -> VectorSensorBounds:
        """How far a sample may be off by the sensor itself: as stated, or as its calibration leaves it; m/s², µT."""
        stated, found = self._stated_bounds(sensor), self._calibration_of(sensor)
        left = None if found is None else calibrated_bounds(found, stated)
        return stated if left is None else left

    def gyro_correction(self) -> GyroCalibration | None:
        """The calibration by which a gyro's rates are corrected, if a rule states more than it leaves.

        Raises
        ------
        ValueError
            If it is of a gyro with these columns in another unit or other axes.
        """
        flow = self.flow
        if self.calibration is None or self.rule is None or not isinstance(flow, GyroFlow):
            return None
        for found in self.calibration.calibration().sensors:
            if isinstance(found, GyroCalibration) and found.columns == flow.columns:
                same_axes = np.array_equal(rotation_of_axes(found.axes), rotation_of_axes(flow.axes))
                if found.unit != flow.unit or not same_axes:
                    raise ValueError("calibration: the gyro was calibrated with another unit or other axes than it has")
                pays = found.corrects_scale() and found.scale_error < self.rule.rule().gyro.scale_error
                return found if pays else None
        return None

    def corrected_sensors(self) -> list[str]:
        """The names of the sensors whose samples are corrected by a calibration."""
        names = [] if self.gyro_correction() is None else ["the gyro"]
        return names + [sensor.name for sensor in self.directions if self.correction_of(sensor) is not None]

    def calibrations_not_used(self) -> dict[str, str]:
        """Of which sensors a calibration is not used, and why, in words: less is stated than it leaves."""
        said = {}
        says = "the rule says" if self.rule is not None else "sensor_error says"
        for sensor in self.directions:
            found = self._calibration_of(sensor)
            if found is None or not found.corrects() or self.correction_of(sensor) is not None:
                continue
            assert isinstance(sensor, Accelerometer | Magnetometer)
            unit, stated = "m/s^2" if sensor.kind == "accelerometer" else "µT", self._stated_bounds(sensor)
            left, own = left_and_stated(found, stated)
            why = f"it leaves {left:.3g} {unit}, {says} {own:.3g} {unit}"
            if left < own:
                why = "an angle is stated, of samples as they are"
            elif found.scale_error != stated.scale_error:
                why += ", with the scale errors"
            said[sensor.name] = f"the calibration of {sensor.name!r} is not used: {why}"
        flow, rule = self.flow, self.rule
        if isinstance(flow, GyroFlow) and rule is not None and self.calibration and self.gyro_correction() is None:
            for one in self.calibration.calibration().sensors:
                if isinstance(one, GyroCalibration) and one.columns == flow.columns and one.corrects_scale():
                    own = rule.rule().gyro.scale_error
                    why = f"it leaves a scale error of {one.scale_error:.3g}, the rule says {own:.3g}"
                    said["the gyro"] = f"the calibration of the gyro is not used: {why}"
        return said

    def calibrated_rule(self) -> Rule:
        """The rule, with what calibrations leave of the sensors' errors."""
        assert self.rule is not None
        rule = self.rule.rule()
        changes: dict[str, Model] = {}
        if (gyro := self.gyro_correction()) is not None:
            factor, told = gyro.noise_factor(), gyro.noise_deg_per_s is not None
            increments = (rule.gyro.increment_deg, gyro.increment_deg if told else rule.gyro.increment_deg)
            # The scale error that is left is beside the noise and the bias that the calibration was told.
            left = {
                "noise_deg_per_s": factor * max(rule.gyro.noise_deg_per_s, gyro.noise_deg_per_s or 0.0),
                "bias_deg_per_s": factor * max(rule.gyro.bias_deg_per_s, gyro.bias_deg_per_s or 0.0),
                "drift_deg_per_s2": factor * rule.gyro.drift_deg_per_s2,
                "increment_deg": None if None in increments else factor * max(one or 0.0 for one in increments),
                "scale_error": gyro.scale_error,
            }
            if told:  # of what noise turns by itself, and of changes of the bias, it was told nothing
                left |= {"noise_turn_deg": None, "noise_turn_growth_deg_per_s": None, "bias_change_deg_per_s": None}
            elif rule.gyro.bias_change_deg_per_s is not None:
                left["bias_change_deg_per_s"] = factor * rule.gyro.bias_change_deg_per_s
            changes["gyro"] = rule.gyro.model_copy(update=left)
        for sensor in self.directions:
            if not isinstance(sensor, Accelerometer | Magnetometer) or self.correction_of(sensor) is None:
                continue
            bounds, unit = self.sensor_bounds(sensor), "m_per_s2" if sensor.kind == "accelerometer" else "ut"
            table = rule.accelerometer if sensor.kind == "accelerometer" else rule.magnetometer
            if table is not None:
                errors = {f"error_{unit}": bounds.error, f"averaged_error_{unit}": bounds.averaged_error}
                errors |= {"averaged_over_s": bounds.averaged_over, "scale_error": bounds.scale_error}
                changes[sensor.kind] = table.model_copy(update=errors)
        return rule.model_copy(update=changes)

    def _calibration_of(self, sensor: AnyDirection) -> AccelerometerCalibration | MagnetometerCalibration | None:
        if self.calibration is None or not isinstance(sensor, Accelerometer | Magnetometer):
            return None
        for found in self.calibration.calibration().sensors:
            if not isinstance(found, GyroCalibration) and found.kind == sensor.kind and found.is_of(sensor):
                differs = found.why_not(sensor)
                if differs is not None:
                    raise ValueError(
                        f"calibration: {found.name!r} was calibrated with another {differs} than {sensor.name!r} has"
                    )
                return found
        return None

    def _stated_bounds(self, sensor: Accelerometer | Magnetometer) -> VectorSensorBounds:
        if self.rule is None:
            return sensor.sensor_error.bounds()
        rule = self.rule.rule()
        if isinstance(sensor, Accelerometer):
            return rule.accelerometer.sensor()
        return VectorSensorBounds() if rule.magnetometer is None else rule.magnetometer.sensor()
