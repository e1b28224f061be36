"""Whole recordings of rigid bodies: the truth solves its equation, and what is too small is noticed."""

import dataclasses
from pathlib import Path

import elliptude
import numpy as np
import pytest
from drawn_recordings import FIXED, GUARANTEED, STAR, require_noticed, smaller
from elliptude.configuration import potentials
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import GivenStart
from elliptude.configuration.motion import RigidBodyFlow
from elliptude.configuration.sensors import Rate
from elliptude.estimation import direction_rows, guaranteed_run
from elliptude.estimation.given import filter_input
from elliptude.io.files import FileError
from elliptude.io.toml import validate
from elliptude.logs import channels
from elliptude.validation.recordings.drawing import draw_recording
from elliptude.validation.recordings.trials import RecordingArguments, keep, try_recording
from elliptude.validation.recordings.truth.tumbling import Inputs, RigidMotion, Tumbling
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

BODY = {"kind": "rigid_body", "inertia_kg_m2": [1.0, 2.0, 2.5], "step_s": 0.05}
RATE = {"columns": ["wx", "wy", "wz"], "bound_deg_per_s": 0.01}
CONTROL = {"control_torque_columns": ["ux", "uy", "uz"]}
WHEELS = {"wheel_momentum_columns": ["hx", "hy", "hz"]}
SLOW = {"largest_rate_deg_per_s": 30.0}
PENDULUM = {"kind": "uniform_gravity", "mass_kg": 1.0, "gravity_m_per_s2": 9.81, "center_of_mass_m": [0.1, 0.0, 0.3]}
ORBIT = {"kind": "gravity_gradient", "orbit_rate_rad_per_s": 0.1}
LINEAR = {"kind": "linear", "moment_n_m": [0.1, 0.2, 0.0], "direction": [2.0, 0.0, 0.0]}
LINEAR |= {"turn_rad_per_s": [0.0, 0.3, 0.1]}
QUADRATIC = {"kind": "quadratic", "direction": [0.0, 1.0, 1.0], "turn_rad_per_s": [0.2, 0.0, 0.0]}
QUADRATIC |= {"matrix_n_m": [[0.3, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, -0.1]]}
SUM = {"kind": "sum", "potentials": [PENDULUM, ORBIT, LINEAR, QUADRATIC]}


def body(flow=None, *directions, **more):
    """A configuration of a rigid body; with a measured rate, if nothing else is said."""
    tables = {"time_column": "t", "flow": BODY | (flow or {}), "directions": list(directions or (FIXED, STAR))}
    tables |= {"rate": RATE, "estimator": GUARANTEED} | more
    return validate(Path("a test"), {key: one for key, one in tables.items() if one is not None}, Configuration)


def cross_matrix(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@pytest.mark.parametrize("seed", range(3))
def test_motions_solve_their_equation(seed):
    """With SciPy's own method, and torques that are the slopes of the potentials' energies."""
    draws = np.random.default_rng(seed)
    flow = body({"potential": SUM}).flow
    inertia = Rotation.random(rng=draws).as_matrix()
    inertia = inertia @ np.diag([1.0, 2.0, 2.5]) @ inertia.T
    motion = RigidMotion(inertia, flow.potential)
    torque, momentum, change = 0.1 * draws.standard_normal((3, 3))
    weighted, n = 9.81 * np.array([0.1, 0.0, 0.3]), 0.1
    matrix = np.array(QUADRATIC["matrix_n_m"])

    def unit(direction, turn, time):
        return Rotation.from_rotvec(time * np.array(turn)).apply(np.array(direction) / np.linalg.norm(direction))

    def energy(time, attitude):
        radial = attitude.T @ unit([1.0, 0.0, 0.0], [0.0, 0.0, n], time)
        linear = attitude.T @ unit(LINEAR["direction"], LINEAR["turn_rad_per_s"], time)
        quadratic = attitude.T @ unit(QUADRATIC["direction"], QUADRATIC["turn_rad_per_s"], time)
        of_linear = -np.array(LINEAR["moment_n_m"]) @ linear
        of_pendulum = -weighted @ attitude.T @ [0.0, 0.0, 1.0]
        return of_pendulum + of_linear + 1.5 * n**2 * radial @ inertia @ radial + 0.5 * quadratic @ matrix @ quadratic

    attitude, some = Rotation.random(rng=draws).as_matrix(), 1e-5 * np.eye(3)
    slopes = [
        energy(0.7, attitude @ Rotation.from_rotvec(-one).as_matrix())
        - energy(0.7, attitude @ Rotation.from_rotvec(one).as_matrix())
        for one in some
    ]
    found = motion._torque(np.array([0.7]), attitude[None])[0]
    np.testing.assert_allclose(found, np.array(slopes) / 2e-5, rtol=0.0, atol=1e-9)

    def change_of(time, state):
        turned, rate = state[:9].reshape(3, 3), state[9:]
        held = inertia @ rate + momentum + (time - 1.0) * change
        acting = np.cross(held, rate) + motion._torque(np.array([time]), turned[None])[0] + torque
        return np.concatenate([(turned @ cross_matrix(rate)).ravel(), np.linalg.solve(inertia, acting)])

    state = np.concatenate([attitude.ravel(), draws.standard_normal(3)])
    inputs = Inputs(torque[None], momentum[None], change[None])
    tumbling = Tumbling(motion, np.array([1.0]), state[None], inputs)
    for span in (0.02, -0.02, 0.05):
        expected = solve_ivp(change_of, (1.0, 1.0 + span), state, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        at = np.array([1.0 + span])
        np.testing.assert_allclose(tumbling.attitudes(at)[0].ravel(), expected[:9], rtol=0.0, atol=3e-14)
        np.testing.assert_allclose(tumbling.rates(at)[0], expected[9:], rtol=0.0, atol=3e-14)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_drawn_is_one_motion(seed):
    """From knot to knot, over all of a recording: a knot is where the one before leads to."""
    flow = {"unknown_torque_n_m": 0.01, "inertia_error_kg_m2": 0.1, "potential": SUM} | CONTROL | WHEELS | SLOW
    recording = draw_recording(body(flow | {"largest_rate_deg_per_s": 200.0}), seed)
    motion = recording.motion
    assert len(motion.times) > 30
    behind = motion.motion.step(
        motion.times[:-1],
        np.zeros(len(motion.times) - 1),
        motion.states[:-1],
        motion.inputs.of(np.arange(len(motion.times) - 1)),
        np.diff(motion.times),
    )
    np.testing.assert_allclose(behind, motion.states[1:], rtol=0.0, atol=1e-12 * (1.0 + np.abs(behind).max()))


def test_statements_of_a_body_are_kept():
    flow = {"unknown_torque_n_m": 0.01, "inertia_error_kg_m2": 0.1} | SLOW
    for seed in range(6):
        motion = draw_recording(body(flow), seed).motion
        torques = np.linalg.norm(motion.inputs.torques, axis=1)
        assert torques.max() <= 0.01
        assert np.linalg.norm(motion.states[:, 9:], axis=1).max() <= np.deg2rad(30.0)
        assert np.linalg.norm(motion.motion.inertia - np.diag([1.0, 2.0, 2.5]), 2) <= 0.1


def test_a_motion_that_torques_make_too_fast_is_refused():
    with pytest.raises(FileError, match="largest_rate_deg_per_s"):
        draw_recording(body({"potential": PENDULUM, "largest_rate_deg_per_s": 1e-3}), 0)


def test_a_recording_of_a_body_can_be_kept(tmp_path):
    arguments = RecordingArguments(body({"unknown_torque_n_m": 0.01}), 1, 0)
    file = keep(arguments, 0, tmp_path)
    assert "true_qw" in file.read_text().splitlines()[0]
    verdict = try_recording(arguments, 0).verdict
    assert {"set", "set with rate", "rate"} <= verdict.answers.keys()


# --- that a bound that is too small is noticed ------------------------------------------------------------------------


def flow_with(monkeypatch, **changed):
    """Let the filter be told another statement of the body than the recording keeps."""
    whole = RigidBodyFlow.guaranteed
    monkeypatch.setattr(RigidBodyFlow, "guaranteed", lambda flow, *more: whole(flow.model_copy(update=changed), *more))


def of_the_files_time_0(monkeypatch):
    """Let a potential point where it would if times counted from the file's time 0."""
    whole = RigidBodyFlow.guaranteed
    monkeypatch.setattr(RigidBodyFlow, "guaranteed", lambda flow, of_wheels, origin: whole(flow, of_wheels))


def measured_with(monkeypatch, share):
    whole = Rate.bound
    monkeypatch.setattr(Rate, "bound", lambda rate: share * whole(rate))


def started_with(monkeypatch, share):
    whole = GivenStart.build

    def build(start):
        found = whole(start)
        return elliptude.StateEllipsoid(found.attitude, found.vector, share * found.shape)

    monkeypatch.setattr(guaranteed_run, "first_set", lambda given, rows: (build(given.start), False))


def torques_before_their_row(monkeypatch):
    whole = channels._of_motion

    def changed(configuration):
        found = whole(configuration)
        for _, channel in found:
            channel.fill = "previous"
        return found

    monkeypatch.setattr(channels, "_of_motion", changed)


def slower_input(monkeypatch):
    whole = guaranteed_run.filter_input

    def changed(*given):
        found = whole(*given)
        return dataclasses.replace(found, vector_bound=0.8 * found.vector_bound)

    monkeypatch.setattr(guaranteed_run, "filter_input", changed)


def wheels_with_less(monkeypatch):
    whole = guaranteed_run.filter_input

    def changed(*given):
        found = whole(*given)
        return dataclasses.replace(found, motion={name: 0.999 * one for name, one in found.motion.items()})

    monkeypatch.setattr(guaranteed_run, "filter_input", changed)


RARE = {"time_column": "ts", "time_unit": "s"}
WEAKENED = {
    "an unknown torque": (
        lambda m: flow_with(m, unknown_torque_n_m=0.009),
        lambda: body({"unknown_torque_n_m": 0.01}),
    ),
    "an error of the inertia": (
        lambda m: flow_with(m, inertia_error_kg_m2=0.0),
        lambda: body({"inertia_error_kg_m2": 0.05}),
    ),
    "the inertia in a gravity gradient": (
        lambda m: flow_with(m, inertia_error_kg_m2=0.0),
        lambda: body({"inertia_error_kg_m2": 0.05, "potential": ORBIT} | SLOW),
    ),
    "a potential": (
        lambda m: flow_with(m, potential=potentials.UniformGravity(**(PENDULUM | {"mass_kg": 0.999}))),
        lambda: body({"potential": PENDULUM}),
    ),
    "where a potential points": (
        lambda m: flow_with(m, potential=potentials.LinearPotential(**(LINEAR | {"turn_rad_per_s": [0.0, 0.0, 0.0]}))),
        lambda: body({"potential": LINEAR}),
    ),
    "since when a potential turns": (
        of_the_files_time_0,
        lambda: body(
            {"potential": ORBIT | {"stated_at_s": -11.25}} | SLOW,
            timing={"origin": "first"},
        ),
    ),
    "a wheel's momentum": (
        wheels_with_less,
        lambda: body(WHEELS),
    ),
    "a wheel whose momentum changes": (
        lambda m: m.setattr(filter_input, "_torque_of_wheels", lambda *_: 0.0),
        lambda: body(CONTROL | WHEELS | SLOW),
    ),
    "since when a torque acts": (
        torques_before_their_row,
        lambda: body(CONTROL, FIXED | RARE, STAR | RARE),
    ),
    "the bound of a rate": (lambda m: measured_with(m, 0.8), body),
    "an ellipsoid of a rate": (
        lambda m: measured_with(m, 0.8),
        lambda: body(rate={"columns": RATE["columns"], "bound_rad2_per_s2": np.diag([1e-6, 1e-8, 1e-7]).tolist()}),
    ),
    "the largest rate": (slower_input, lambda: body(SLOW | {"largest_rate_deg_per_s": 60.0}, rate=None)),
    "an offset in time": (
        lambda m: smaller(m, direction_rows, "_turned_by_offset", 0.5),
        lambda: body(SLOW, FIXED | {"time_offset_bound_s": 0.02}, STAR),
    ),
    "a given start": (
        lambda m: started_with(m, 0.5),
        lambda: body(
            {},
            rate=None,
            start={"kind": "given", "attitude_qw_qx_qy_qz": [0.5, -0.3, 0.7, 0.4], "P_diagonal": [1e-8] * 6},
        ),
    ),
}


@pytest.mark.parametrize("what", WEAKENED)
def test_a_bound_that_is_too_small_is_noticed(what, monkeypatch):
    require_noticed(monkeypatch, *WEAKENED[what])
