"""What was found of a recording's sensors: in sentences, as numbers, and as tables for a configuration."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from elliptude.calibration.gyro import GyroSet
from elliptude.calibration.vector_sensors import SensorSet, SensorStatements
from elliptude.configuration.calibration import (
    AccelerometerCalibration,
    AnyCalibration,
    GyroCalibration,
    MagnetometerCalibration,
)
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.rules import GyroRule
from elliptude.configuration.sensors import Accelerometer, Magnetometer
from elliptude.typing import FloatArray

# A component of the offset is not determined if this share or more of what was stated is still possible.
_UNDETERMINED = 0.9


@dataclass(frozen=True, eq=False)
class Found:
    """What a recording says of one sensor."""

    sensor: Accelerometer | Magnetometer
    stated: SensorStatements
    left: SensorSet
    proposed_offset: FloatArray | None
    """By least squares, for comparison; None without poses."""
    later_noise: float
    """Bound of the noise of a sample in the logs that the calibration is for."""
    later_averaged_noise: float
    """The same of a mean over a window."""

    @property
    def unit(self) -> str:
        """The unit of offset and errors."""
        return "m/s^2" if isinstance(self.sensor, Accelerometer) else "uT"

    @property
    def name(self) -> str:
        """What the configuration calls it."""
        return self.sensor.name

    @property
    def stated_scale_error(self) -> float:
        """Before the calibration."""
        return self.stated.scale_error

    def errors(self, noise: float, averaged_noise: float) -> tuple[float, float]:
        """Bounds of the error of a corrected sample and of a mean of them, without the scale error."""
        # What the matrix adds to noise turns with the sensor, so that only the single sample's bound holds for it.
        offset, stretched = self.left.offset_error, self.left.stretch * noise
        return offset + noise + stretched, offset + averaged_noise + stretched

    def here(self, duration: float) -> tuple[float, float]:
        """Those of the recording itself, of a mean over this time, s."""
        return self.errors(self.stated.noise, self.stated.mean_noise(duration))

    @property
    def later(self) -> tuple[float, float]:
        """Those of the logs that the calibration is for."""
        return self.errors(self.later_noise, self.later_averaged_noise)

    @property
    def undetermined(self) -> list[str]:
        """Which components of the offset the recording hardly shows."""
        halves = 0.5 * (self.left.highest - self.left.lowest)
        return [name for name, half in zip("xyz", halves, strict=True) if half >= _UNDETERMINED * self.stated.offset]

    @property
    def needed_disturbance(self) -> float | None:
        """What a field's disturbance must have been at least for the samples to agree with anything."""
        if not self.left.poses or not isinstance(self.sensor, Magnetometer):
            return None
        return max(self.stated.disturbance - self.left.spare, 0.0)

    def remarks(self) -> list[str]:
        """What a user should know, in sentences."""
        said = []
        if not self.left.poses:
            return [f"{self.sensor.name}: the recording has no pose of it that counts; it stays as stated"]
        if self.undetermined:
            said.append(
                f"{self.sensor.name}: {counted(self.left.poses, 'pose')} with errors as stated, which leave the offset "
                f"along {', '.join(self.undetermined)} undetermined: it stays within what was stated"
            )
        if self.needed_disturbance is not None:
            said.append(
                f"{self.sensor.name}: the field varies by at least {self.needed_disturbance:.2g} uT, "
                f"{self.stated.disturbance:g} is stated"
            )
            if self.stated.disturbance >= self.stated.offset and not self.left.is_correction:
                said.append(
                    f"{self.sensor.name}: a disturbance of {self.stated.disturbance:g} uT may hide any offset of "
                    f"{self.stated.offset:g} uT (docs/theory.md, 19.6): turn the sensor about one spot, away from "
                    "steel, and state what the field does there"
                )
        if not self.left.is_correction:
            said.append(f"{self.sensor.name}: nothing is corrected, the statement stands")
            return said
        left = self.left
        subtracted = ", ".join(f"{value:.3g}" for value in left.offset)
        said.append(
            f"{self.sensor.name}: from a sample ({subtracted}) {self.unit} is subtracted; the true offset is within "
            f"{left.offset_distance:.3g} of that, {self.stated.offset:g} was stated"
        )
        if np.any(left.matrix != np.eye(3)):
            rows = "; ".join(" ".join(f"{value:.5f}" for value in row) for row in left.matrix)
            said.append(
                f"{self.sensor.name}: then it is multiplied by the matrix ({rows}), which leaves a scale error of "
                f"{left.scale_error:.3g}, {self.stated.scale_error:g} was stated"
            )
        return said

    def figures(self) -> dict[str, Any]:
        """All of it as plain numbers."""
        left, stated = self.left, self.stated
        return {
            "name": self.sensor.name,
            "kind": self.sensor.kind,
            "unit": self.unit,
            "poses": left.poses,
            "offset": left.offset.tolist(),
            "matrix": left.matrix.tolist(),
            "offset_error": left.offset_error,
            "offset_distance": left.offset_distance,
            "stated_offset": stated.offset,
            "lowest_offset": left.lowest.tolist(),
            "highest_offset": left.highest.tolist(),
            "scale_error": left.scale_error,
            "stated_scale_error": stated.scale_error,
            "undetermined": self.undetermined,
            "proposed_offset": None if self.proposed_offset is None else self.proposed_offset.tolist(),
            "stated_disturbance": stated.disturbance,
            "least_disturbance": self.needed_disturbance,
            "remarks": self.remarks(),
        }

    def calibration(self) -> AnyCalibration:
        """The table for a configuration."""
        x, y, z = self.left.matrix.tolist()
        a, b, c = self.left.offset.tolist()
        sensor = self.sensor
        error, averaged_error = self.later
        same = {
            "name": sensor.name,
            "columns": sensor.columns,
            "axes": sensor.axes,
            "unit": sensor.unit,
            "matrix": (tuple(x), tuple(y), tuple(z)),
            "scale_error": self.left.scale_error,
            "poses": self.left.poses,
        }
        if isinstance(sensor, Accelerometer):
            return AccelerometerCalibration.model_validate(
                same
                | {
                    "kind": "accelerometer",
                    "at_rest": sensor.at_rest,
                    "offset_m_per_s2": (a, b, c),
                    "error_m_per_s2": error,
                    "averaged_error_m_per_s2": averaged_error,
                    "averaged_over_s": self.stated.averaged_over,
                }
            )
        return MagnetometerCalibration.model_validate(
            same
            | {
                "kind": "magnetometer",
                "offset_ut": (a, b, c),
                "error_ut": error,
                "averaged_error_ut": averaged_error,
                "averaged_over_s": self.stated.averaged_over,
            }
        )


@dataclass(frozen=True, eq=False)
class FoundGyro:
    """What a recording says of its gyro."""

    flow: GyroFlow
    stated: GyroRule
    left: GyroSet
    name: str = "the gyro"

    def remarks(self) -> list[str]:
        """What a user should know, in sentences."""
        if not self.left.turns:
            return ["the gyro: the recording has no two rests with a turn between them; it stays as stated"]
        if not self.left.inverse.any():
            return [
                f"the gyro: {counted(self.left.turns, 'turn')} between rests, which add nothing to what is "
                "stated of it; nothing is corrected"
            ]
        rows = "; ".join(" ".join(f"{value:.5f}" for value in row) for row in self.left.matrix)
        return [
            f"the gyro: a rate is multiplied by the matrix ({rows}), which leaves a scale error of "
            f"{self.left.scale_error:.3g}, {self.stated.scale_error:g} was stated"
        ]

    def figures(self) -> dict[str, Any]:
        """All of it as plain numbers."""
        return {
            "name": self.name,
            "kind": "gyro",
            "turns": self.left.turns,
            "matrix": self.left.matrix.tolist(),
            "scale_error": self.left.scale_error,
            "stated_scale_error": self.stated_scale_error,
            "remarks": self.remarks(),
        }

    @property
    def stated_scale_error(self) -> float:
        """Before the calibration."""
        return self.stated.scale_error

    def calibration(self) -> AnyCalibration:
        """The table for a configuration."""
        return GyroCalibration.model_validate(
            {
                "kind": "gyro",
                "name": self.name,
                "columns": self.flow.columns,
                "axes": self.flow.axes,
                "unit": self.flow.unit,
                "matrix": tuple(map(tuple, self.left.matrix.tolist())),
                "scale_error": self.left.scale_error,
                "turns": self.left.turns,
                "noise_deg_per_s": self.stated.noise_deg_per_s,
                "bias_deg_per_s": self.stated.bias_deg_per_s,
                "increment_deg": self.stated.increment_deg,
            }
        )


def counted(number: int, thing: str) -> str:
    """A number of things in words: "1 pose", "2 poses"."""
    return f"{number} {thing}" + ("" if number == 1 else "s")
