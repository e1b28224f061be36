"""Configurations at random for `elliptude validate --config`: each states some of what can be stated.

    python benchmarks/random_configurations.py --configurations 200 --trials 4 --seed 1 --out build/configurations

It tries each with recordings, and writes down the configurations of faults. Most errors of a configuration are zero:
what is left is then nearly attained, so that a term that is missing in a bound shows itself.
"""

import argparse
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.rules import rule_for
from elliptude.io.files import FileError
from elliptude.io.toml import validate
from elliptude.validation.recordings.judging import Verdict
from elliptude.validation.recordings.trials import RecordingArguments, try_recording
from random_bodies import draw_body
from random_calibrations import draw_calibration
from random_draws import SMALLEST, Drawn, Tables, error_of, estimator, sensor_of, tracker

# How many configurations of a seed have recordings of their own.
_MOST = 100_000


def draw_configuration(seed: Any) -> Tables:
    """The tables of a configuration of the guaranteed mode.

    Parameters
    ----------
    seed : int or SeedSequence

    Returns
    -------
    dict
        It may state what a configuration refuses; then there is nothing to try.
    """
    of = Drawn(np.random.default_rng(seed))
    kind = of.one("a rule", "a rule", "a rule", "a body", "a body", *["a gyro"] * 5)
    if kind == "a body":
        return draw_body(of)
    tables = _ruled(of) if kind == "a rule" else _stated(of)
    if of.maybe(0.3):
        tables["time_unit"] = of.one("ms", "ns")
    if of.maybe(0.3):
        tables["timing"] = tables.get("timing", {}) | {"origin": "first"}
    if of.maybe(0.3) and (calibration := draw_calibration(of, tables)):
        tables["calibration"] = calibration
    return tables


def _ruled(of: Drawn) -> Tables:
    """A configuration with a rule: one that comes with the package, or one with errors that are mostly none."""
    rule = rule_for(of.one("hand", "hand", "person", "drone", "car", "boat")).model_dump(mode="json", exclude_none=True)
    if of.maybe(0.7):
        rule = _changed_rule(of, rule)
    with_field = of.maybe(0.8)
    if not with_field:
        rule.pop("magnetometer", None)
    stated = {"kind": "stated"} | rule
    if of.maybe(0.6):
        stated["anchor_s"] = of.one(0.3, 1.0, 4.0)
    flow = {"kind": "gyro", "columns": ["gx", "gy", "gz"], "unit": of.one("rad/s", "deg/s")}
    directions = [sensor_of("up", "accelerometer", "a")]
    if with_field:
        directions.append(sensor_of("field", "magnetometer", "m"))
    if of.maybe(0.3):
        directions[0] |= {"unit": "g", "at_rest": "down"}
    for sensor in (flow, *directions):
        sensor |= {"axes": ["-z", "x", "-y"]} if of.maybe(0.3) else {}
    tables: Tables = {"time_column": "t", "rule": stated, "flow": flow, "directions": directions}
    if of.maybe(0.25):
        tables["velocity"] = _velocity(of)
    return tables | {"estimator": estimator(of, has_rule=True)}


def _changed_rule(of: Drawn, rule: Tables) -> Tables:
    gyro = rule["gyro"]
    for key in ("noise_deg_per_s", "bias_deg_per_s", "scale_error"):
        gyro[key] = gyro[key] if of.maybe() else 0.0
    gyro["drift_deg_per_s2"] = of.size(1e-3, 0.05)
    gyro.pop("bias_change_deg_per_s", None)
    if gyro["bias_deg_per_s"] > 0.0 and of.maybe(0.6):
        gyro["bias_change_deg_per_s"] = of.size(1e-3, 2.0, 0.8)
    gyro["earth_rate"] = "removed"
    if of.maybe(0.5):
        gyro.pop("increment_deg", None)
    if of.maybe(0.5):
        gyro |= {"noise_turn_deg": of.among(0.05, 1.0), "noise_turn_growth_deg_per_s": of.size(1e-3, 0.3)}
    for name, keys in (
        ("accelerometer", ("gravity_error_m_per_s2", "error_m_per_s2", "averaged_error_m_per_s2", "scale_error")),
        ("magnetometer", ("disturbance_ut", "error_ut", "averaged_error_ut", "scale_error")),
    ):
        for key in keys:
            rule[name][key] = rule[name][key] if of.maybe() else SMALLEST if key.startswith("error_") else 0.0
        rule[name]["time_offset_bound_s"] = of.size(1e-3, 0.03)
        rule[name].pop("time_offset_change_s", None)
        errors = "error_m_per_s2" if name == "accelerometer" else "error_ut"
        rule[name][f"averaged_{errors}"] = min(rule[name][f"averaged_{errors}"], rule[name][errors])
    if of.maybe(0.6):
        rule["accelerometer"]["time_offset_change_s"] = of.size(1e-4, 0.03)
    rule["magnetometer"]["disturbance_ut"] = min(rule["magnetometer"]["disturbance_ut"], 10.0)
    rule["magnetometer"]["delay_s"] = of.one(0.0, 0.01, 0.0137)
    rule["motion"]["velocity_m_per_s"] = of.size(0.1, 5.0, 0.5)
    rule["motion"]["position_m"] = of.size(0.1, 5.0, 0.5)
    rule["motion"]["row_at"] = of.one("middle", "end")
    rule["motion"]["windows_s"] = [of.one(0.3, 0.6, 1.0), of.one(2.0, 3.0), of.one(5.0, 8.0)]
    rule["rest"]["velocity_m_per_s"] = min(of.size(1e-3, 0.05), rule["motion"]["velocity_m_per_s"])
    if of.maybe():
        rule["rest"]["most_s"] = rule["rest"]["least_s"] + of.among(0.1, 3.0)
    return rule


def _stated(of: Drawn) -> Tables:
    """A configuration in which every sensor states its own bounds."""
    tables: Tables = {"time_column": "t", "reference_frame": of.one("ENU", "NED", "NWU"), "flow": _gyro(of)}
    directions, with_up = [], of.maybe(0.85)
    if with_up:
        directions.append(_accelerometer(of, tables))
    if of.maybe(0.75):
        directions.append(_magnetometer(of, with_up=with_up))
    for i in range(int(of.one(0, 1, 2)) if directions else 2):
        directions.append(tracker(of, i))
    tables["directions"] = directions
    tables["estimator"] = estimator(of, has_rule=False)
    references = [sensor["reference"] for sensor in directions if isinstance(sensor.get("reference"), dict)]
    if not any("declination_deg" in one for one in references) and of.maybe(0.15):
        tables["estimator"] |= {"policy": "relaxed", "most_wrong": 1}
    if not references and of.maybe(0.15):
        size, of_bias = of.among(1e-8, 1e-2), 1e-12
        if tables["flow"].get("estimate_bias"):
            of_bias = (of.among(1e-3, 1.0) * math.radians(tables["flow"]["bias_deg_per_s"])) ** 2
        shape = [size, size * of.one(1.0, 0.1), size, of_bias, of_bias, of_bias]
        tables["start"] = {"kind": "given", "attitude_qw_qx_qy_qz": [0.5, -0.3, 0.7, 0.4], "P_diagonal": shape}
    if any("time_column" in one for one in (*directions, tables.get("velocity", {}))) and of.maybe(0.4):
        # Not so much that samples of one sensor would share a row.
        longest = 0.2 * tables["flow"].get("longest_interval_s", 0.1)
        tables["timing"] = {"same_within_s": of.among(0.01, 1.0) * longest}
    if all("kind" not in sensor for sensor in directions) and of.maybe(0.5):
        tables["reference_frame"] = "J2000"
        directions[0].pop("reference_columns", None)
        directions[0].pop("reference_rate_deg_per_s", None)
        directions[0]["reference"] = {"kind": "sun", "time_zero": datetime(2020, 3, 1, tzinfo=UTC)}
    return tables


def _gyro(of: Drawn) -> Tables:
    flow: Tables = {
        "kind": "gyro",
        "columns": ["gx", "gy", "gz"],
        "unit": of.one("rad/s", "deg/s"),
        "interval_rate": of.one("mean_of_ends", "mean_of_ends", "mean_of_ends", "first_sample"),
        "noise_deg_per_s": of.size(1e-3, 5.0, 0.6) or 1e-6,
        "bias_deg_per_s": of.size(1e-3, 2.0, 0.6),
        "drift_deg_per_s2": of.size(1e-4, 0.1),
        "scale_error": of.size(1e-4, 0.1, 0.5),
        "known_bias_deg_per_s": of.one([0.0, 0.0, 0.0], [0.3, -2.0, 1.0]),
        "earth_rate": "removed",
    }
    if flow["bias_deg_per_s"] > 0.0 and of.maybe(0.3):
        flow["estimate_bias"] = True
    elif flow["bias_deg_per_s"] > 0.0 and of.maybe(0.6):
        flow["bias_change_deg_per_s"] = of.size(1e-3, 1.0, 0.8)
    if "estimate_bias" not in flow and flow["interval_rate"] == "mean_of_ends" and of.maybe(0.5):
        flow["anchor_s"] = of.one(0.3, 1.0, 4.0)
        if of.maybe(0.5):
            flow["increment_deg"] = of.among(0.01, 1.0)
        if of.maybe(0.5):
            flow |= {"noise_turn_deg": of.among(0.01, 1.0), "noise_turn_growth_deg_per_s": of.size(1e-3, 0.3)}
    if "anchor_s" not in flow and of.maybe(0.25):
        flow["angular_acceleration_deg_per_s2"] = of.among(10.0, 20000.0)
    if of.maybe(0.6):
        flow["longest_interval_s"] = of.one(0.01, 0.015, 0.05, 0.1)
    if of.maybe(0.5):
        flow["largest_rate_deg_per_s"] = of.among(50.0, 2000.0)
    if flow["interval_rate"] == "mean_of_ends" and of.maybe(0.4):
        flow["largest_angular_acceleration_deg_per_s2"] = of.among(100.0, 60000.0)
    if of.maybe(0.2):
        flow["axes"] = ["y", "-x", "z"]
    if of.maybe(0.2):
        flow["delay_s"] = of.one(0.02, -0.3)
    if of.maybe(0.2):
        flow["time_offset_bound_s"] = of.among(1e-4, 0.02)
    return flow


def _accelerometer(of: Drawn, tables: Tables) -> Tables:
    flow = tables["flow"]
    sensor = sensor_of("up", "accelerometer", "a")
    sensor["unit"] = of.one("m/s^2", "g")
    kind = of.one("velocity_window", "velocity_window", "acceleration", "angle")
    if kind == "velocity_window" and flow["interval_rate"] != "mean_of_ends":
        kind = "acceleration"
    if of.maybe(0.5):
        sensor["time_offset_bound_s"] = of.among(1e-4, 0.05)
    if "delay_s" in flow:
        sensor["delay_s"] = flow["delay_s"]
    if of.maybe(0.2):
        sensor["alignment_error_deg"] = of.among(0.01, 1.0)
    if of.maybe(0.2):
        sensor["at_rest"] = "down"
    if kind == "angle":
        return sensor | {"bound_deg": of.among(0.1, 40.0)}
    sensor["sensor_error"] = error_of(of, "m_per_s2", (1e-3, 0.5))
    bound: Tables = {"kind": kind, "gravity_error_m_per_s2": of.size(1e-3, 0.05)}
    if kind == "acceleration":
        bound["acceleration_m_per_s2"] = of.size(1e-2, 5.0, 0.7)
        return sensor | {"bound_from": bound}
    bound["windows_s"] = sorted({of.one(0.2, 0.5, 1.0), of.one(0.5, 2.0), of.one(1.0, 4.0, 8.0)})
    bound["at"] = of.one("middle", "end")
    if of.maybe(0.6):
        bound["time_offset_change_s"] = of.size(1e-4, 0.05)
    with_velocity = of.maybe(0.3)
    stated = {
        "velocity_m_per_s": of.size(1e-2, 30.0, 0.7),
        "position_m": of.among(1e-2, 10.0),
        "acceleration_m_per_s2": of.size(1e-2, 5.0, 0.7),
    }
    chosen = [key for key in stated if of.maybe(0.4)]
    if not chosen and not with_velocity:
        chosen = ["velocity_m_per_s"]
    bound |= {key: stated[key] for key in chosen}
    if of.maybe(0.5):
        bound["largest_jerk_m_per_s3"] = of.among(1.0, 5000.0)
    if with_velocity:
        tables["velocity"] = _velocity(of)
    return sensor | {"bound_from": bound}


def _velocity(of: Drawn) -> Tables:
    velocity: Tables = {
        "columns": ["vn", "ve", "vd"],
        "error_m_per_s": of.size(1e-3, 1.0, 0.6),
        "largest_acceleration_m_per_s2": of.among(0.1, 20.0),
        "time_offset_bound_s": of.size(1e-3, 0.2),
    }
    if of.maybe(0.5):
        velocity |= {"time_column": "tv", "time_unit": of.one("s", "us"), "delay_s": of.one(0.0, 0.1)}
    return velocity


def _magnetometer(of: Drawn, *, with_up: bool) -> Tables:
    sensor = sensor_of("field", "magnetometer", "m")
    sensor["unit"] = of.one("uT", "G", "T")
    if of.maybe(0.3):
        sensor["time_offset_bound_s"] = of.among(1e-4, 0.05)
    if of.maybe(0.3):
        sensor |= {"time_column": "tm", "time_unit": of.one("s", "ms"), "delay_s": of.one(0.0, 0.02)}
    by_angle = of.maybe(0.2)
    kind = of.one("stated", "stated", "world_model", "rest_by_up", "rest_by_attitude")
    if kind == "rest_by_up" and not with_up:
        kind = "rest_by_attitude"
    if kind == "stated":
        sensor["reference_ut"] = of.one([1.0, 20.0, -43.0], [5.0, 1.0, 44.0], [-10.0, 30.0, 2.0])
        if of.maybe(0.3):
            sensor["reference_error_deg"] = of.among(0.1, 3.0)
    elif kind == "world_model":
        sensor["reference"] = {
            "kind": kind,
            "latitude_deg": float(of.draws.uniform(-85.0, 85.0)),
            "longitude_deg": float(of.draws.uniform(-180.0, 180.0)),
            "height_m": of.one(0.0, 8000.0, 5e5),
            "date": datetime(int(of.draws.integers(1990, 2030)), int(of.draws.integers(1, 13)), 17, tzinfo=UTC),
        }
    else:
        phase: Tables = {"kind": "rest_phase", "from_s": 0.5, "to_s": of.one(1.5, 3.0)}
        if kind == "rest_by_up":
            phase |= {"declination_deg": of.one(0.0, 5.0), "velocity_m_per_s": of.size(1e-3, 0.1)}
        else:
            phase |= {"attitude_qw_qx_qy_qz": [0.9, 0.1, -0.3, 0.2], "attitude_error_deg": of.size(0.1, 3.0)}
        sensor["reference"] = phase
    if of.maybe(0.2):
        sensor["alignment_error_deg"] = of.among(0.01, 1.0)
    if by_angle:
        return sensor | {"bound_deg": of.among(0.1, 20.0)}
    sensor["sensor_error"] = error_of(of, "ut", (1e-2, 3.0))
    sensor["bound_from"] = {"kind": "field", "disturbance_ut": of.size(1e-2, 8.0, 0.6)}
    if kind in ("stated", "world_model"):
        sensor["bound_from"]["strength_error_ut"] = of.size(0.1, 2.0)
    if of.maybe(0.1):
        sensor |= {"unit": "normalized", "unit_ut": 20.0}
    return sensor


class _Found:
    """What became of the recordings of all configurations."""

    def __init__(self) -> None:
        self.rows = self.unconditional = self.implausible = self.faults = 0
        self.not_drawn: list[str] = []
        self.largest: dict[str, tuple[float, int, int]] = {}

    def add(self, number: int, trial: int, verdict: Verdict) -> None:
        """Count a recording."""
        self.rows, self.unconditional = self.rows + verdict.rows, self.unconditional + verdict.unconditional
        self.implausible += verdict.implausible is not None
        self.faults += verdict.is_fault
        for name, one in verdict.answers.items():
            if one["largest"] is not None and one["largest"]["share"] > self.largest.get(name, (0.0,))[0]:
                self.largest[name] = one["largest"]["share"], number, trial

    def print(self) -> None:
        """Print the counts, and where the truth came nearest to the end of each answer."""
        print(
            f"{self.rows} rows, {self.unconditional} unconditional, {self.implausible} recordings implausible; "
            f"{self.faults} faults; {len(self.not_drawn)} recordings could not be drawn"
        )
        print("".join(f"  {one}\n" for one in self.not_drawn), end="")
        for name, (share, number, trial) in self.largest.items():
            print(f"  {name:24} {share:.6f}  configuration {number}, trial {trial}")


def try_configuration(number: int, seed: int, trials: int, *, smooth: bool, found: _Found) -> list[str]:
    """Try a configuration, and say what is wrong with its recordings."""
    tables = draw_configuration([seed, number])
    configuration = validate(Path(f"configuration {number}"), tables, Configuration)
    arguments = RecordingArguments(configuration, trials, _MOST * seed + number, smooth)
    said = []
    for trial in range(trials):
        try:
            tried = try_recording(arguments, trial)
        except FileError as error:  # nothing was found that keeps what is stated
            found.not_drawn.append(f"configuration {number}, trial {trial}: {error}")
            continue
        for verdict in filter(None, (tried.verdict, tried.smoothed)):
            found.add(number, trial, verdict)
            if verdict.is_fault:
                outside = {name: one for name, one in verdict.answers.items() if one["outside"] or one["missing"]}
                drawn = {name: kind for name, kind in tried.recording.kinds.items() if kind != "none"}
                said.append(
                    f"configuration {number}, trial {trial}: {verdict.contradicted} contradicted, {outside}, "
                    f"{verdict.error}; {drawn}"
                )
    return said


def _main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--configurations", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="the first one that is tried")
    parser.add_argument("--trials", type=int, default=2, help="recordings of each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--smooth", action="store_true")
    parser.add_argument("--out", type=Path, help="folder for the configurations of faults")
    given = parser.parse_args()
    found = _Found()
    for number in range(given.first, given.first + given.configurations):
        said = try_configuration(number, given.seed, given.trials, smooth=given.smooth, found=found)
        for one in said:
            print(one, flush=True)
        if said and given.out is not None:
            given.out.mkdir(parents=True, exist_ok=True)
            file = given.out / f"{given.seed}_{number}.toml"
            file.write_text(tomlkit.dumps(draw_configuration([given.seed, number])), encoding="utf-8")
    found.print()


if __name__ == "__main__":
    _main()
