"""elliptude as the attitude estimator of a simulation in Basilisk: docs/basilisk.md.

`AttitudeEstimator` needs Basilisk (``pip install 'elliptude[basilisk]'``); conversions and Sun sensors need NumPy
alone.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from elliptude.basilisk.conversion import attitude_from_mrp, mrp_from_attitude
from elliptude.basilisk.gyro import turn_rate_error
from elliptude.basilisk.sun_sensors import SunSensors

if TYPE_CHECKING:
    from elliptude.basilisk.estimator import AttitudeEstimator

__all__ = ["AttitudeEstimator", "SunSensors", "attitude_from_mrp", "mrp_from_attitude", "turn_rate_error"]


def __getattr__(name: str) -> Any:
    """The estimator, imported when it is asked for: it is a module of Basilisk."""
    if name != "AttitudeEstimator":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return import_module("elliptude.basilisk.estimator").AttitudeEstimator
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"elliptude.basilisk.{name} needs {error.name}: pip install 'elliptude[basilisk]'", name=error.name
        ) from error
