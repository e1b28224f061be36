"""Potentials that turn, in logs whose times count from a second of the file: where they point then."""

import math

import elliptude
import mpmath
import numpy as np
import pytest
from elliptude.configuration import Configuration, potentials
from elliptude.configuration.configuration import read_configuration
from elliptude.estimation.estimator import estimate
from elliptude.io.files import FileError
from elliptude.logs.conversion import convert_measurements
from elliptude.logs.log import read_log
from elliptude.smoothing.smoother import smoothed_run
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

INERTIA = np.array([1.0, 2.0, 2.5])
BODY = elliptude.RigidBody(np.diag(INERTIA))
MATRIX = [[0.3, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, -0.1]]
QUADRATIC = {"kind": "quadratic", "matrix_n_m": MATRIX, "direction": [0.0, 3.0, 0.4], "turn_rad_per_s": [0.3, 0.0, 0.0]}
ORBIT = {"kind": "gravity_gradient", "orbit_rate_rad_per_s": 0.6}
LINEAR = {"kind": "linear", "moment_n_m": [0.1, 0.2, 0.0], "direction": [2.0, 0.0, 0.0]}
LINEAR |= {"turn_rad_per_s": [0.0, 0.3, 0.1]}
POTENTIALS = {"orbit": ORBIT, "linear": LINEAR, "quadratic": QUADRATIC}
POTENTIALS["sum"] = {"kind": "sum", "potentials": [ORBIT, LINEAR | {"stated_at_s": 900.25}, QUADRATIC]}
MODEL = {"gravity_gradient": potentials.GravityGradient, "linear": potentials.LinearPotential}
MODEL |= {"quadratic": potentials.QuadraticPotential, "sum": potentials.SumPotential}


def built(potential, origin=0):
    return MODEL[potential["kind"]].model_validate(potential).build(BODY, origin)


def torque_at(potential, time, attitude, exact=float, since=0.0):
    """By the formulas of docs/logs.md, of a time of the file; the turn's angle in numbers of a type."""
    if potential["kind"] == "sum":
        return sum(torque_at(one, time, attitude, exact, since) for one in potential["potentials"])
    is_orbit = potential["kind"] == "gravity_gradient"
    turn = [0.0, 0.0, potential["orbit_rate_rad_per_s"]] if is_orbit else potential["turn_rad_per_s"]
    start = np.array([1.0, 0.0, 0.0] if is_orbit else potential["direction"])
    start /= np.linalg.norm(start)
    rate = sum(exact(component) ** 2 for component in turn) ** exact(0.5)
    angle = rate * (exact(time) + exact(since) - exact(potential.get("stated_at_s", 0.0)))
    cosine, sine = (math.cos(angle), math.sin(angle)) if exact is float else map(float, mpmath.cos_sin(angle))
    b = (cosine * start + sine * np.cross(np.array(turn) / float(rate), start)) @ attitude
    if potential["kind"] == "linear":
        return np.cross(potential["moment_n_m"], b)
    matrix = 3.0 * float(rate) ** 2 * np.diag(INERTIA) if is_orbit else np.array(potential["matrix_n_m"])
    return np.cross(b, matrix @ b)


@pytest.mark.parametrize("origin", [0, -3, 1200, 1_700_000_000])
@pytest.mark.parametrize("kind", ["orbit", "linear", "quadratic"])
def test_time_0_is_a_second_of_the_file(kind, origin):
    """Also where n t has few digits left as a double: the turn is right to rounding all the same."""
    attitude = Rotation.random(rng=1).as_matrix()
    for stated in ({}, {"stated_at_s": 0.3}, {"stated_at_s": -1e9}):
        potential = POTENTIALS[kind] | stated
        for since in (0.0, 2.5):
            found = built(potential, origin).torque(attitude, since)
            with mpmath.workdps(60):
                expected = torque_at(potential, origin, attitude, mpmath.mpf, since)
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=5e-15)


@pytest.mark.parametrize("turn", [1e-30, 1e30])
def test_turns_of_any_rate(turn):
    potential = LINEAR | {"direction": [0.0, 1.0, 0.0], "turn_rad_per_s": [0.0, 0.0, turn], "stated_at_s": -0.3}
    with mpmath.workdps(120):
        expected = torque_at(potential, 3, np.eye(3), mpmath.mpf)
    np.testing.assert_allclose(built(potential, 3).torque(np.eye(3), 0.0), expected, rtol=0.0, atol=1e-15)


# --- from the file to the sets ----------------------------------------------------------------------------------------


def motion(potential, times, seed=0):
    """A body's true attitudes and rates, in the file's time, by SciPy."""

    def change(time, state):
        attitude, rate = state[:9].reshape(3, 3), state[9:]
        acting = np.cross(INERTIA * rate, rate) + torque_at(potential, time, attitude)
        skew = np.array([[0.0, -rate[2], rate[1]], [rate[2], 0.0, -rate[0]], [-rate[1], rate[0], 0.0]])
        return np.concatenate([(attitude @ skew).ravel(), acting / INERTIA])

    start = np.concatenate([Rotation.random(rng=seed).as_matrix().ravel(), [0.3, -0.5, 0.4]])
    found = solve_ivp(change, times[[0, -1]], start, method="DOP853", t_eval=times, rtol=1e-12, atol=1e-13)
    return found.y[:9].T.reshape(-1, 3, 3), found.y[9:].T


def written(folder, times, attitudes, rates):
    lines = ["t,px,py,pz,qx,qy,qz,wx,wy,wz"]
    for time, attitude, rate in zip(times, attitudes, rates, strict=True):
        seen = [*(attitude.T @ [1.0, 0.0, 0.0]), *(attitude.T @ [0.0, 0.0, 1.0]), *rate]
        lines.append(",".join([f"{round(1e9 * time)}", *map(repr, map(float, seen))]))
    (folder / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "log.csv"


def configuration(potential, **estimator):
    directions = [
        {"name": name, "columns": [f"{letter}{axis}" for axis in "xyz"], "reference": along, "bound_deg": 0.001}
        for name, letter, along in (("sun", "p", [1.0, 0.0, 0.0]), ("star", "q", [0.0, 0.0, 1.0]))
    ]
    return Configuration.model_validate(
        {
            "time_column": "t",
            "time_unit": "ns",
            "timing": {"origin": "first"},
            "flow": {
                "kind": "rigid_body",
                "inertia_kg_m2": INERTIA.tolist(),
                "step_s": 0.05,
                "order": 4,
                "potential": potential,
            },
            "directions": directions,
            "rate": {"columns": ["wx", "wy", "wz"], "bound_deg_per_s": 0.001},
            "estimator": estimator,
        }
        | ({} if estimator["mode"] == "guaranteed" else {"start": {"kind": "first_measurement"}})
    )


TIMES = 1000.5 + 0.25 * np.arange(24)
STATED = {name: one | {"stated_at_s": 900.25} for name, one in POTENTIALS.items() if name != "sum"}
STATED["sum"] = {
    "kind": "sum",
    "potentials": [ORBIT | {"stated_at_s": 0.0}, LINEAR | {"stated_at_s": 900.25}, QUADRATIC | {"stated_at_s": 0.0}],
}


@pytest.mark.parametrize("name", STATED)
def test_sets_of_a_log_that_counts_from_a_second_hold_the_truth(tmp_path, name):
    attitudes, rates = motion(STATED[name], TIMES)
    stated = configuration(STATED[name], mode="guaranteed")
    log = read_log(written(tmp_path, TIMES, attitudes, rates), stated)
    assert log.origin == 1000
    for run in (estimate(log, stated), estimate(log, stated, smoothed_run)):
        assert set(run.result.claims) == {"unconditional"}
        assert run.guaranteed.sets.forms(attitudes, rates).max() < 1.0
        assert run.result.half_widths.max() < 1e-4


@pytest.mark.parametrize("asked", [{"mode": "paper"}, {"mode": "guaranteed", "best": "kalman"}])
def test_estimates_are_those_of_a_log_that_counts_from_0(tmp_path, asked):
    """Of every kind: the same motion, but for the numbers of its stamps."""
    attitudes, rates = motion(STATED["sum"], TIMES)
    found = {}
    for since in (0, 1000):
        ahead = [dict(one) for one in STATED["sum"]["potentials"]]
        for one in ahead:
            one["stated_at_s"] += since - 1000
        stated = configuration({"kind": "sum", "potentials": ahead}, **asked)
        log = read_log(written(tmp_path, TIMES + (since - 1000), attitudes, rates), stated)
        found[since] = estimate(log, stated).result
    for name in ("quaternions", "half_widths", "best_quaternions"):
        one, other = (getattr(found[since], name) for since in (0, 1000))
        if one is not None:
            np.testing.assert_array_equal(one, other)


def test_a_table_has_the_potential_of_its_own_times(tmp_path):
    """The configuration that `convert` writes beside the table: both give the same sets."""
    attitudes, rates = motion(STATED["sum"], TIMES)
    stated = configuration(STATED["sum"], mode="guaranteed")
    file = written(tmp_path, TIMES, attitudes, rates)
    whole = estimate(read_log(file, stated), stated).result
    convert_measurements(file, tmp_path / "table.csv", stated, tmp_path / "table.toml")
    of_table = read_configuration(tmp_path / "table.toml")
    assert [one.stated_at_s for one in of_table.flow.potential.potentials] == [-1000.0, -99.75, -1000.0]
    again = estimate(read_log(tmp_path / "table.csv", of_table), of_table).result
    np.testing.assert_allclose(again.quaternions, whole.quaternions, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(again.half_widths, whole.half_widths, rtol=1e-9)


def test_a_table_whose_times_a_number_does_not_hold_is_refused(tmp_path):
    """0.1 s less 1000 s is no number of 53 digits: the angle would be another one."""
    potential = ORBIT | {"stated_at_s": 0.1}
    attitudes, rates = motion(potential, TIMES)
    stated = configuration(potential, mode="guaranteed")
    file = written(tmp_path, TIMES, attitudes, rates)
    with pytest.raises(FileError, match=r"flow\.potential\.stated_at_s"):
        convert_measurements(file, tmp_path / "table.csv", stated, tmp_path / "table.toml")
    assert not (tmp_path / "table.csv").exists()
