"""Calibrations at random, for sensors of a configuration: offsets and matrices of any kind, and what they leave."""

import numpy as np
from random_draws import Drawn, Tables

_OFFSET = {"accelerometer": ("offset_m_per_s2", "m_per_s2", 1.0), "magnetometer": ("offset_ut", "ut", 30.0)}


def draw_calibration(of: Drawn, tables: Tables) -> Tables:
    """A calibration of some sensors of a configuration, which leaves less of their errors than is stated."""
    rule = tables.get("rule")
    sensors = []
    for sensor in tables["directions"]:
        kind = sensor.get("kind")
        stated = rule[kind] if rule is not None and kind in _OFFSET else sensor.get("sensor_error")
        if kind in _OFFSET and stated is not None and sensor["unit"] != "normalized" and of.maybe(0.8):
            sensors.append(_of_vectors(of, sensor, stated))
    if rule is not None and of.maybe(0.6):
        sensors.append(_of_gyro(of, tables["flow"], rule["gyro"]))
    return {"recording": "drawn", "recording_sha256": "", "sensors": sensors} if sensors else {}


def _same(sensor: Tables) -> Tables:
    return {key: sensor[key] for key in ("name", "kind", "columns", "unit", "axes", "at_rest") if key in sensor}


def _matrix(of: Drawn) -> list[list[float]]:
    """Of no scales at all, of scales alone, or of axes that are not perpendicular, and turned."""
    if of.maybe(0.2):
        return np.eye(3).tolist()
    size = of.among(1e-3, 0.15)
    off = np.diag(of.draws.uniform(-1.0, 1.0, 3)) if of.maybe(0.4) else of.draws.uniform(-0.5, 0.5, (3, 3))
    return (np.eye(3) + size * off).tolist()


def _of_vectors(of: Drawn, sensor: Tables, stated: Tables) -> Tables:
    key, unit, size = _OFFSET[sensor["kind"]]
    error = stated.get(f"error_{unit}", 0.0) * of.one(0.1, 0.5, 0.9)
    averaged = min(error, stated.get(f"averaged_error_{unit}", error)) * of.one(0.1, 0.5, 0.9)
    return _same(sensor) | {
        key: (of.size(0.01, 1.0, 0.8) * size * of.draws.standard_normal(3)).tolist(),
        "matrix": _matrix(of),
        f"error_{unit}": error,
        f"averaged_error_{unit}": averaged,
        "averaged_over_s": stated.get("averaged_over_s", 0.5) * of.one(0.5, 1.0, 2.0),
        "scale_error": stated.get("scale_error", 0.0) * of.one(0.0, 0.3, 0.9),
    }


def _of_gyro(of: Drawn, flow: Tables, stated: Tables) -> Tables:
    table = _same(flow) | {"name": "gyro", "matrix": _matrix(of)}
    table["scale_error"] = stated["scale_error"] * of.one(0.0, 0.3, 0.9)
    if of.maybe(0.4):
        table["noise_deg_per_s"] = stated["noise_deg_per_s"] * of.one(0.5, 2.0)
        table["bias_deg_per_s"] = stated["bias_deg_per_s"] * of.one(0.5, 2.0)
        if stated.get("increment_deg") is not None and of.maybe(0.7):
            table["increment_deg"] = stated["increment_deg"] * of.one(0.5, 2.0)
    return table
