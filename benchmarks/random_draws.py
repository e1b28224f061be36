"""What random configurations are made of: numbers of any size, and the tables of sensors that several kinds have."""

import math
from typing import Any

import numpy as np

Tables = dict[str, Any]
# Of a sensor's sample, m/s² or µT: with an error of zero the rounding of a file's numbers is a contradiction.
SMALLEST = 1e-9


class Drawn:
    """Numbers of a configuration."""

    def __init__(self, draws: np.random.Generator) -> None:
        self.draws = draws
        # How likely it is that an error is stated as something.
        self.share = float(draws.choice([0.15, 0.3, 0.7]))

    def maybe(self, chance: float | None = None) -> bool:
        """Whether something is stated."""
        return bool(self.draws.random() < (self.share if chance is None else chance))

    def size(self, least: float, most: float, chance: float | None = None) -> float:
        """A number of any size between these, or 0."""
        return self.among(least, most) if self.maybe(chance) else 0.0

    def among(self, least: float, most: float) -> float:
        """A number of any size between these."""
        return float(f"{math.exp(self.draws.uniform(math.log(least), math.log(most))):.4g}")

    def one(self, *values: Any) -> Any:
        """One of some values."""
        return values[int(self.draws.integers(len(values)))]


def estimator(of: Drawn, *, has_rule: bool) -> Tables:
    """The table of the estimator."""
    policies = ["raise", "drop_measurement", "drop_measurement", "restart"]
    table: Tables = {
        "mode": "guaranteed",
        "policy": of.one(*policies),
        "criterion": of.one("volume", "trace"),
        "best": of.one("center", "center", "vqf") if has_rule else "center",
    }
    if of.maybe(0.3):
        table["questions"] = ["reference_turns", "body_turns", "attitude"]
    return table


def sensor_of(name: str, kind: str, letter: str) -> Tables:
    """The first keys of an accelerometer or a magnetometer."""
    units = {"accelerometer": "m/s^2", "magnetometer": "uT"}
    return {"name": name, "kind": kind, "columns": [f"{letter}{axis}" for axis in "xyz"], "unit": units[kind]}


def error_of(of: Drawn, unit: str, sizes: tuple[float, float], chance: float | None = None) -> Tables:
    """The table of such a sensor's errors."""
    error: Tables = {f"error_{unit}": of.size(*sizes, chance) or SMALLEST}
    if of.maybe(0.5):
        error[f"averaged_error_{unit}"] = float(f"{error[f'error_{unit}'] * of.one(0.0, 0.1, 0.3, 1.0):.4g}")
        error["averaged_over_s"] = of.one(0.1, 0.5, 2.0)
    error["scale_error"] = of.size(1e-3, 0.1)
    error["misalignment_deg"] = of.size(0.01, 3.0)
    return error


def tracker(of: Drawn, number: int) -> Tables:
    """The table of a sensor that shows a direction."""
    letter = "pqr"[number]
    sensor: Tables = {"name": f"star{number}", "columns": [f"{letter}{axis}" for axis in "xyz"]}
    sensor["bound_deg"] = of.among(0.01, 10.0)
    if of.maybe(0.4):
        sensor["time_offset_bound_s"] = of.among(1e-4, 0.05)
    if of.maybe(0.5):
        sensor |= {"time_column": f"t{letter}", "time_unit": of.one("s", "ms"), "delay_s": of.one(0.0, 0.07, -0.01)}
    if of.maybe(0.3):
        sensor["reference_columns"] = [f"{letter}r{axis}" for axis in "xyz"]
        sensor["reference_rate_deg_per_s"] = of.size(1e-3, 5.0)
    else:
        sensor["reference"] = of.one([1.0, 0.2, 0.0], [0.1, -0.5, 2.0], [0.0, 1.0, 0.3])
    if of.maybe(0.2):
        sensor["reference_error_deg"] = of.among(0.01, 1.0)
    if of.maybe(0.2):
        sensor["alignment_error_deg"] = of.among(0.01, 1.0)
    if not {"reference_error_deg", "alignment_error_deg"} & sensor.keys() and of.maybe(0.2):
        square = math.radians(sensor.pop("bound_deg")) ** 2
        sensor["bound_rad2"] = [[square, 0.0, 0.0], [0.0, 0.25 * square, 0.0], [0.0, 0.0, square]]
    return sensor
