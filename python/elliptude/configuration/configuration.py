"""What an estimation needs: which columns of a log are which sensors, how far each may be off, how the body moves.

A configuration is a TOML file. `read_configuration` checks it, and its errors name the file and the key at
fault. Keys name their units. An attitude takes body vectors to the reference frame, quaternions are (qw, qx, qy, qz),
and an error bound given as one angle is a ball's radius.

An example::

    [flow]
    kind = "rigid_body"
    inertia_kg_m2 = [0.13, 0.28, 0.17]
    step_s = 0.005
    order = 4
    potential = { kind = "uniform_gravity", mass_kg = 1.0, gravity_m_per_s2 = 9.81, center_of_mass_m = [0.0, 0.0, 0.3] }

    [[directions]]
    name = "sun"
    columns = ["sun_x", "sun_y", "sun_z"]
    reference = [1.0, 0.0, 0.0]
    bound_deg = 7.0

    [[directions]]
    name = "field"
    columns = ["field_x", "field_y", "field_z"]
    reference_columns = ["model_x", "model_y", "model_z"]
    bound_deg = 7.0

    [rate]
    columns = ["wx", "wy", "wz"]
    bound_deg_per_s = 7.0

    [start]
    kind = "first_measurement"

``docs/logs.md`` has what the log of a hand-held IMU also needs: units, axes, delays, gravity and the Earth's field as
reference directions, and bounds that come from motion.
"""

import dataclasses
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import Field, model_validator

from elliptude import units
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.configuration.calibration import (
    AccelerometerCalibration,
    CalibrationFile,
    GyroCalibration,
    MagnetometerCalibration,
    StatedCalibration,
    calibrated_bounds,
)
from elliptude.configuration.estimator import (
    BestEstimate,
    Estimator,
    FirstMeasurementStart,
    GivenStart,
    HandHeldRule,
    Question,
    RuleFile,
    StatedRule,
)
from elliptude.configuration.motion import EARTHS_FRAMES, GyroFlow, RigidBodyFlow
from elliptude.configuration.rest_reference import why_rest_is_open
from elliptude.configuration.rules import Carried, Rule
from elliptude.configuration.sensors import (
    Accelerometer,
    AnyDirection,
    Csv,
    Direction,
    Magnetometer,
    Rate,
    ReferenceFrame,
    Timing,
    Truth,
    Velocity,
    rotation_of_axes,
)
from elliptude.configuration.statements import RestPhase, SunByTime, VelocityWindowBound, WorldModel
from elliptude.io.files import FileError
from elliptude.io.readers.counted import ROW_TIME
from elliptude.io.readers.text.dialect import Stated
from elliptude.io.toml import (
    Column,
    Model,
    load_toml,
    validate,
)

_NAMES_OF_OTHERS = {
    "rate": "the measured angular velocity",
    "gyro": "the gyro",
    "velocity": "the measured velocity",
    "true_attitude": "the truth",
}
_SAID_OF_A_RULES_SENSOR = {
    "kind",
    "name",
    "columns",
    "unit",
    "unit_ut",
    "axes",
    "at_rest",
    "time_column",
    "time_unit",
}


class Configuration(Model):
    """An estimation."""

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

    @model_validator(mode="before")
    @classmethod
    def _takes_times_by_rows(cls, given: Any) -> Any:
        timing = given.get("timing") if isinstance(given, dict) else None
        if not isinstance(timing, dict) or timing.get("row_rate_hz") is None:
            return given
        if given.get("time_column", ROW_TIME) != ROW_TIME:
            raise ValueError("timing.row_rate_hz is for a file without times: leave it or time_column out")
        return given | {"time_column": ROW_TIME, "time_unit": "s"}

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [direction.name for direction in self.directions]
        if len(set(names)) < len(names):
            raise ValueError("directions must have different names")
        for name, other in _NAMES_OF_OTHERS.items():
            if name in names:
                raise ValueError(f"directions: the name {name!r} is that of {other}")
        if self.rule is not None and self.estimator.mode != "guaranteed":
            raise ValueError("rule needs estimator.mode = 'guaranteed'")
        if self.start is None and self.estimator.mode != "guaranteed":
            raise ValueError("start: missing; the guaranteed mode alone needs none")
        from_first = self.start if isinstance(self.start, FirstMeasurementStart) else None
        is_guaranteed = self.estimator.mode == "guaranteed"
        if is_guaranteed and from_first is not None and from_first.bias_bound_deg_per_s is not None:
            raise ValueError(
                "start.bias_bound_deg_per_s is not for the guaranteed mode: flow.bias_deg_per_s bounds a gyro's bias"
            )
        self._require_answers()
        if not is_guaranteed and self.truth is not None and self.truth.time_offset_bound_s > 0.0:
            raise ValueError(
                "truth.time_offset_bound_s is for the guaranteed mode: in the others nothing bounds how far the body "
                "turns meanwhile. Leave it out, and state in truth.error_deg how far the truth may be off"
            )
        if isinstance(self.flow, GyroFlow) and self.rate is not None:
            raise ValueError("rate: the gyro of flow.kind = 'gyro' is its input; it cannot be a measurement too")
        if is_guaranteed or from_first is None:
            return self
        if isinstance(self.flow, GyroFlow):
            if from_first.bias_bound_deg_per_s is None:
                raise ValueError("start.bias_bound_deg_per_s is needed to start a gyro flow from the first measurement")
        elif self.rate is None:
            raise ValueError("start.kind = 'first_measurement' needs a rate beside the directions")
        elif from_first.bias_bound_deg_per_s is not None:
            raise ValueError("start.bias_bound_deg_per_s belongs to flow.kind = 'gyro'")
        if len(self.directions) < 2:
            raise ValueError("start.kind = 'first_measurement' needs two directions or more")
        return self

    @model_validator(mode="after")
    def _has_the_bounds_it_needs(self) -> Self:
        if self.rule is not None:
            self._require_what_a_rule_is_of()
            return self
        if self.velocity is not None and not any(
            isinstance(sensor.bound_from, VelocityWindowBound) for sensor in self.directions
        ):
            raise ValueError(
                "velocity: is for an accelerometer with bound_from.kind = 'velocity_window', or a rule; there is none"
            )
        if isinstance(self.flow, GyroFlow) and self.flow.noise_deg_per_s is None:
            raise ValueError("flow.noise_deg_per_s: missing")
        for i, sensor in enumerate(self.directions):
            try:
                sensor.require_complete()
            except ValueError as error:
                raise ValueError(f"directions[{i}]: {error}") from error
            self._require_how_fast_a_reference_moves(i, sensor)
            missing = why_rest_is_open(sensor, self.accelerometer)
            if missing is not None and self.estimator.mode == "guaranteed":
                raise ValueError(f"directions[{i}]: {missing}")
            if not isinstance(sensor.bound_from, VelocityWindowBound):
                continue
            needs = f"directions[{i}] ({sensor.name}): bound_from.kind = 'velocity_window' needs"
            if isinstance(self.flow, RigidBodyFlow):
                raise ValueError(
                    f"{needs} a gyro: windows carry a frame along with rates on lines, but torques turn a rigid body "
                    "between the measurements of its rate. Use bound_from.kind = 'acceleration' or bound_deg, or "
                    "flow.kind = 'gyro'"
                )
            if self.flow.interval_rate != "mean_of_ends":
                raise ValueError(
                    f"{needs} flow.interval_rate = 'mean_of_ends', as windows carry a frame along with rates on lines"
                )
            if not sensor.bound_from.bounds_motion and self.velocity is None:
                raise ValueError(
                    f"{needs} one or more of velocity_m_per_s, position_m, acceleration_m_per_s2, or a measured "
                    "[velocity]"
                )
        return self

    def _require_how_fast_a_reference_moves(self, i: int, sensor: AnyDirection) -> None:
        if self.estimator.mode != "guaranteed" or not isinstance(sensor, Direction):
            return
        moves = sensor.reference_columns is not None and sensor.reference_rate_deg_per_s is None
        if moves and self.time_offset_of(sensor) > 0.0:
            raise ValueError(
                f"directions[{i}] ({sensor.name}): reference_rate_deg_per_s: missing; with reference_columns a "
                "time_offset_bound_s, its own or the gyro's, needs how fast the reference turns at most, in reference "
                "axes (0 for stars)"
            )

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

    def _require_what_a_rule_is_of(self) -> None:
        if self.start is not None:
            raise ValueError("start: a rule says how a recording starts")
        if self.carried is not None:
            raise ValueError("carried: is for the rule to say")
        if self.estimator.policy == "relaxed":
            raise ValueError(
                "estimator.policy: 'relaxed' is not for a rule: it has one accelerometer and at most one magnetometer, "
                "and if either may be wrong, no attitude is left to begin with. Use 'drop_measurement' or 'restart'"
            )
        if self.reference_frame not in {None, "ENU"}:
            raise ValueError("reference_frame: a rule's is ENU, with magnetic north where the recording starts")
        given = self.flow.model_fields_set - _SAID_OF_A_RULES_SENSOR
        if not isinstance(self.flow, GyroFlow) or given:
            raise ValueError(
                "flow: a rule is of a gyro, kind = 'gyro'"
                if not isinstance(self.flow, GyroFlow)
                else f"flow.{min(given)}: is for the rule to say"
            )
        kinds = sorted(sensor.kind for sensor in self.directions)
        if kinds not in (["accelerometer"], ["accelerometer", "magnetometer"]):
            raise ValueError("directions: a rule is of one accelerometer and, if there is one, one magnetometer")
        for i, sensor in enumerate(self.directions):
            if given := sensor.model_fields_set - _SAID_OF_A_RULES_SENSOR:
                raise ValueError(f"directions[{i}].{min(given)}: is for the rule to say")

    @model_validator(mode="after")
    def _has_the_frame_it_needs(self) -> Self:
        for i, sensor in enumerate(self.directions):
            reference = sensor.reference if isinstance(sensor, Direction | Magnetometer) else None
            by_gravity = isinstance(reference, RestPhase) and reference.attitude_qw_qx_qy_qz is None
            if by_gravity and self.accelerometer is None:
                raise ValueError(f"directions[{i}]: a rest phase without an attitude needs an accelerometer")
            if by_gravity and self.estimator.policy == "relaxed":
                raise ValueError(
                    f"directions[{i}] ({sensor.name}).reference: a rest phase without an attitude takes up from the "
                    "accelerometer, so that this one sensor makes two measurements wrong, and estimator.policy = "
                    "'relaxed' counts each. State attitude_qw_qx_qy_qz, or reference_ut"
                )
            on_earth = (
                (self.rule is None and isinstance(sensor, Accelerometer))
                or isinstance(reference, WorldModel)
                or by_gravity
            )
            if on_earth and self.reference_frame not in EARTHS_FRAMES:
                raise ValueError(f"directions[{i}] ({sensor.name}) needs reference_frame = 'ENU', 'NED' or 'NWU'")
            if isinstance(reference, SunByTime) and self.reference_frame != "J2000":
                raise ValueError(f"directions[{i}] ({sensor.name}): the Sun by time needs reference_frame = 'J2000'")
        is_guaranteed = self.estimator.mode == "guaranteed" and self.rule is None
        if is_guaranteed and isinstance(self.flow, GyroFlow) and self.reference_frame in EARTHS_FRAMES:
            windows = [sensor.bound_from for sensor in self.directions]
            longest = [max(one.windows_s) for one in windows if isinstance(one, VelocityWindowBound)]
            self.flow.require_earth_rate(max(longest, default=0.0))
        return self

    def stated(self) -> Stated:
        """How its file is to be read."""
        return dataclasses.replace(self.csv.stated(), row_rate_hz=self.timing.row_rate_hz)

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

    def with_best(self, best: BestEstimate) -> Self:
        """The same with another choice of the estimate beside the sets."""
        return self.model_copy(update={"estimator": self.estimator.model_copy(update={"best": best})})

    def with_questions(self, questions: Sequence[str]) -> Self:
        """The same with other questions that each row of the guaranteed mode answers by itself.

        Raises
        ------
        ValueError
            If there is no such question, or the estimator does not answer it.
        """
        known: tuple[Question, ...] = get_args(Question)
        for name in questions:
            if name not in known:
                raise ValueError(f"questions: {name!r} is none of {', '.join(known)}")
        asking = self.estimator.model_copy(update={"questions": tuple(questions)})
        changed = self.model_copy(update={"estimator": asking})
        changed._require_answers()
        return changed

    def _require_answers(self) -> None:
        if self.estimator.questions and self.estimator.mode != "guaranteed":
            raise ValueError("estimator.questions: needs mode = 'guaranteed'")
        if "vector" in self.estimator.questions and not self.estimates_vector:
            raise ValueError(
                "estimator.questions: 'vector' asks for the gyro's bias, which is not estimated here but counts as an "
                "error (flow.estimate_bias)"
            )

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


def read_configuration(path: str | os.PathLike[str]) -> Configuration:
    """Read the configuration in a TOML file.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML, or does not fit; with the file and every key at fault.
    """
    tables = load_toml(path)
    if "flow" not in tables and tables.keys() >= {"rest", "motion"}:
        raise FileError(
            f"{path}: a rule for bounds, and no configuration; one names it by [rule] with kind = 'file' and file = "
            f"{str(path)!r} (docs/logs.md), and `elliptude bounds LOG --out FILE` writes one"
        )
    configuration = validate(path, tables, Configuration)
    if isinstance(configuration.calibration, CalibrationFile):
        found = configuration.calibration.beside(path)
        found.calibration()
        configuration = configuration.model_copy(update={"calibration": found})
    if configuration.calibration is not None:
        try:
            used = [configuration._calibration_of(sensor) for sensor in configuration.directions]
            configuration.gyro_correction()
        except ValueError as error:
            raise FileError(f"{path}: {error}") from error
        if not any(used):
            columns = "; ".join(", ".join(one.columns) for one in configuration.calibration.calibration().sensors)
            raise FileError(f"{path}: calibration: of no sensor of this configuration, but of {columns}")
    if not isinstance(configuration.rule, RuleFile):
        return configuration
    beside = configuration.rule.model_copy(update={"file": str(Path(path).parent / configuration.rule.file)})
    try:
        beside.rule()
    except FileError as error:
        raise FileError(f"{path}: rule.file: {error}") from error
    return configuration.model_copy(update={"rule": beside})
