"""Configurations at random of rigid bodies: potentials, torques, wheels, and what is stated of the inertia."""

import math

import numpy as np
from random_draws import SMALLEST, Drawn, Tables, error_of, estimator, sensor_of, tracker

# rad; of an attitude that is known next to exactly: its edge is still as far away as rounding of the truth is not.
_NEXT_TO_NOTHING = 1e-5


def draw_body(of: Drawn) -> Tables:
    """The tables of a configuration of a rigid body."""
    inertia, least, greatest = _inertia(of)
    rate = of.among(1e-3, 5.0)
    # What would turn the body as fast as that within a turn or so.
    torque = least * rate**2
    flow: Tables = {
        "kind": "rigid_body",
        "inertia_kg_m2": inertia,
        "step_s": float(f"{of.among(0.02, 0.3) / rate:.3g}"),
        "potential": _potential(of, rate, torque),
        "unknown_torque_n_m": of.size(1e-6 * torque, 0.03 * torque, 0.5),
        "inertia_error_kg_m2": of.size(1e-6 * least, 0.05 * least, 0.5),
    }
    if of.maybe(0.5):
        flow["control_torque_columns"] = ["ux", "uy", "uz"]
    if of.maybe(0.4):
        flow["wheel_momentum_columns"] = ["hx", "hy", "hz"]
    if of.maybe(0.6):
        flow["largest_rate_deg_per_s"] = float(f"{math.degrees(rate):.4g}")
    tables: Tables = {"time_column": "t", "reference_frame": of.one("ENU", "NED", "NWU"), "flow": flow}
    directions = [tracker(of, i) for i in range(int(of.one(1, 2, 2, 3)))]
    directions += [_vector_sensor(of, kind) for kind in ("accelerometer", "magnetometer") if of.maybe(0.3)]
    if "largest_rate_deg_per_s" not in flow:
        for sensor in directions:  # how far the body turns meanwhile is open
            sensor.pop("time_offset_bound_s", None)
    tables |= {"directions": directions, "estimator": estimator(of, has_rule=False)}
    if of.maybe(0.3):
        tables["estimator"]["questions"] = ["vector", "attitude"]
    if of.maybe(0.6) or "largest_rate_deg_per_s" not in flow:
        tables["rate"] = _rate(of, rate)
    if of.maybe(0.2):
        # Free of torques no component is larger later on, whatever the body.
        tables["start"] = _start(of, 0.3 * rate * math.sqrt(least / greatest))
    if of.maybe(0.5):
        tables["timing"] = {"origin": "first"}
    if "rate" not in tables and of.maybe(0.3):
        tables.setdefault("timing", {})["same_within_s"] = of.among(1e-4, 0.03)
    return tables


def _inertia(of: Drawn) -> tuple[list[float] | list[list[float]], float, float]:
    """Of a plate, a needle, a ball or anything else: three moments, or a matrix; its least and greatest moment."""
    spread = [of.one(1e-4, 0.03, 1.0), of.one(0.03, 1.0), 1.0]
    one, other, third = (of.among(1e-3, 1e3) * np.array(spread)).tolist()
    moments = [float(f"{moment:.6g}") for moment in (one + other + 1e-3 * third, one + third, other + third)]
    if of.maybe(0.5):
        return moments, min(moments), max(moments)
    axes = np.linalg.qr(of.draws.standard_normal((3, 3)))[0]
    matrix = (axes * moments) @ axes.T
    return (0.5 * (matrix + matrix.T)).tolist(), min(moments), max(moments)


def _potential(of: Drawn, rate: float, torque: float) -> Tables:
    if of.maybe(0.25):
        return {"kind": "sum", "potentials": [_term(of, rate, torque) for _ in range(int(of.one(1, 2, 3)))]}
    return _term(of, rate, torque)


def _term(of: Drawn, rate: float, torque: float) -> Tables:
    kind = of.one("free", "uniform_gravity", "gravity_gradient", "linear", "quadratic")
    size, axis = of.among(1e-3, 0.05) * torque, of.draws.standard_normal(3)
    axis /= np.linalg.norm(axis)
    if kind == "uniform_gravity":
        arm = (size / 9.81 * axis).tolist()
        return {"kind": kind, "mass_kg": 1.0, "gravity_m_per_s2": 9.81, "center_of_mass_m": arm}
    if kind == "gravity_gradient":
        return {"kind": kind, "orbit_rate_rad_per_s": of.among(1e-3, 0.2) * rate} | _stated_at(of)
    if kind == "free":
        return {"kind": kind}
    direction = of.draws.standard_normal(3)
    turn = np.cross(direction, of.draws.standard_normal(3))
    turn *= (of.among(1e-3, 0.5) * rate if of.maybe(0.6) else 0.0) / np.linalg.norm(turn)
    table: Tables = {"kind": kind, "direction": direction.tolist(), "turn_rad_per_s": turn.tolist()} | _stated_at(of)
    if kind == "linear":
        return table | {"moment_n_m": (size * axis).tolist()}
    matrix = of.draws.standard_normal((3, 3))
    return table | {"matrix_n_m": (0.3 * size * (matrix + matrix.T)).tolist()}


def _stated_at(of: Drawn) -> Tables:
    return {"stated_at_s": of.one(0.0, -11.25, 86_437.5, 1e6)}


def _vector_sensor(of: Drawn, kind: str) -> Tables:
    if kind == "accelerometer":
        sensor = sensor_of("up", kind, "a") | {"sensor_error": error_of(of, "m_per_s2", (1e-3, 0.5))}
        bound = {"kind": "acceleration", "acceleration_m_per_s2": of.size(1e-2, 1.0, 0.5)}
        sensor["bound_from"] = bound | {"gravity_error_m_per_s2": of.size(1e-3, 0.05)}
    else:
        sensor = sensor_of("field", kind, "m") | {"sensor_error": error_of(of, "ut", (1e-2, 3.0))}
        sensor["reference_ut"] = of.one([1.0, 20.0, -43.0], [5.0, 1.0, 44.0])
        sensor["bound_from"] = {"kind": "field", "disturbance_ut": of.size(1e-2, 5.0, 0.5)}
    if of.maybe(0.3):
        sensor["time_offset_bound_s"] = of.among(1e-4, 0.05)
    return sensor


def _rate(of: Drawn, rate: float) -> Tables:
    table: Tables = {"columns": ["wx", "wy", "wz"], "unit": of.one("rad/s", "deg/s")}
    if of.maybe(0.3):
        table |= {"time_column": "tw", "time_unit": of.one("s", "ms"), "delay_s": of.one(0.0, 0.07)}
    size = of.size(1e-5, 0.1, 0.7) * rate or SMALLEST
    if of.maybe(0.7):
        return table | {"bound_deg_per_s": math.degrees(size)}
    axes = np.linalg.qr(of.draws.standard_normal((3, 3)))[0]
    matrix = size**2 * (axes * [1.0, of.one(1.0, 0.1), of.one(1.0, 0.01)]) @ axes.T
    return table | {"bound_rad2_per_s2": (0.5 * (matrix + matrix.T)).tolist()}


def _start(of: Drawn, rate: float) -> Tables:
    of_attitude, of_rate = of.among(_NEXT_TO_NOTHING, 0.3) ** 2, (of.among(1e-6, 0.05) * rate) ** 2
    about = of.draws.uniform(-1.0, 1.0, 3) * (rate if of.maybe(0.7) else 0.0)
    shape = [of_attitude, of_attitude * of.one(1.0, 0.01), of_attitude, of_rate, of_rate, of_rate * of.one(1.0, 0.1)]
    return {
        "kind": "given",
        "attitude_qw_qx_qy_qz": [0.5, -0.3, 0.7, 0.4],
        "rate_rad_per_s": about.tolist(),
        "P_diagonal": shape,
    }
