"""Bounds of measured directions, from what is known about sensors and motion: see `elliptude.bounds.samples`."""

from elliptude.bounds.samples import (
    EXACT_SENSOR,
    DirectionBounds,
    VectorSensorBounds,
    accelerometer_bounds,
    angle_excess,
    angle_to_center,
    bounded_directions,
    magnetometer_bounds,
    radius_excess,
    rounded_up,
)

__all__ = [
    "EXACT_SENSOR",
    "DirectionBounds",
    "VectorSensorBounds",
    "accelerometer_bounds",
    "angle_excess",
    "angle_to_center",
    "bounded_directions",
    "magnetometer_bounds",
    "radius_excess",
    "rounded_up",
]
