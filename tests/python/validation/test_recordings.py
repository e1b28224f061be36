"""Whole recordings within what a configuration states: nothing is wrong with them, and what is too small is noticed."""

import dataclasses
import itertools
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import elliptude
import numpy as np
import pytest
import tomlkit
from drawn_recordings import FIXED, GUARANTEED, STAR, require_noticed, smaller, without
from elliptude import cli, units
from elliptude.bounds import gyro as gyro_bounds
from elliptude.bounds import turns
from elliptude.bounds.carried import one_matrix
from elliptude.bounds.carried.steady_bias import SteadyBias
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.velocity import MeasuredVelocity, VelocityOfRows
from elliptude.bounds.windows import MotionBounds
from elliptude.configuration import rules
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.rules import apply
from elliptude.configuration.sensors import Direction, DirectionBase
from elliptude.estimation import direction_rows, guaranteed_run
from elliptude.estimation.given import filter_input
from elliptude.io.toml import validate
from elliptude.logs import channels
from elliptude.logs.log import Log
from elliptude.logs.rest_phase import ReferenceBounds
from elliptude.validation.recordings import trials
from elliptude.validation.recordings.drawing import draw_recording
from elliptude.validation.recordings.judging import Verdict
from elliptude.validation.recordings.trials import RecordingArguments, try_recording
from elliptude.validation.recordings.truth.turning import Turning
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))

from random_configurations import draw_configuration

GYRO = {"kind": "gyro", "columns": ["gx", "gy", "gz"], "longest_interval_s": 0.05, "noise_deg_per_s": 1e-6}
GYRO |= {"earth_rate": "removed"}
UP = {"name": "up", "kind": "accelerometer", "columns": ["ax", "ay", "az"], "unit": "m/s^2"}
FIELD = {"name": "field", "kind": "magnetometer", "columns": ["mx", "my", "mz"], "unit": "uT"}


def configured(flow, *directions, **more):
    tables = {"time_column": "t", "reference_frame": "ENU", "flow": GYRO | flow, "directions": list(directions)}
    tables["estimator"] = GUARANTEED
    return validate(Path("a test"), tables | more, Configuration)


def test_turns_solve_their_equation():
    draws = np.random.default_rng(1)
    times = np.cumsum(np.append(0.0, draws.uniform(0.05, 0.2, 5)))
    begins, ends = 5.0 * draws.normal(size=(2, 5, 3))
    turning = Turning(times, begins, ends)

    def change(time, attitude):
        x, y, z = turning.rates(np.array([time]))[0]
        return (attitude.reshape(3, 3) @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])).ravel()

    attitude = np.eye(3).ravel()
    for begin, end in itertools.pairwise(times):
        inside = end - 1e-15
        attitude = solve_ivp(change, (begin, inside), attitude, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    np.testing.assert_allclose(turning.attitudes(times[-1:])[0], attitude.reshape(3, 3), rtol=0.0, atol=1e-11)


def test_same_seeds_draw_the_same():
    configuration = validate(Path("a test"), draw_configuration(3), Configuration)
    one, other = (draw_recording(configuration, 5) for _ in range(2))
    for name, values in one.columns.items():
        np.testing.assert_array_equal(values, other.columns[name])


@pytest.mark.parametrize("number", range(16))
def test_nothing_is_wrong_with_random_configurations(number):
    configuration = validate(Path(f"configuration {number}"), draw_configuration([0, number]), Configuration)
    verdict = try_recording(RecordingArguments(configuration, 1, number), 0).verdict
    assert verdict.rows > 0
    assert (verdict.error, verdict.contradicted, verdict.outside, verdict.missing) == (None, 0, 0, 0)


def test_the_table_has_the_bias_of_the_gyro():
    flow = {"known_bias_deg_per_s": [0.3, -2.0, 1.0], "bias_deg_per_s": 0.05, "estimate_bias": True}
    questions = GUARANTEED | {"questions": ["vector"]}
    verdict = try_recording(RecordingArguments(configured(flow, FIXED, STAR, estimator=questions), 1, 0), 0).verdict
    assert verdict.answers["bias"]["answers"] > 0
    assert (verdict.contradicted, verdict.outside) == (0, 0)


# --- that a bound that is too small is noticed ------------------------------------------------------------------------

SMALL = {"error_m_per_s2": 1e-9}
RARE = {"time_column": "ts", "time_unit": "s"}
STARS = (FIXED | RARE, STAR | RARE)
WINDOW = {"kind": "velocity_window", "windows_s": [2.0], "at": "middle"}
STATED_FIELD = FIELD | {"reference_ut": [1.0, 20.0, -43.0], "sensor_error": {"error_ut": 1e-9}}
NO_DISTURBANCE = {"bound_from": {"kind": "field", "disturbance_ut": 0.0}}
REST = {"kind": "rest_phase", "from_s": 0.5, "to_s": 2.0, "declination_deg": 0.0, "velocity_m_per_s": 0.0}


def up(window=None, **more):
    return UP | {"sensor_error": SMALL, "bound_from": WINDOW | (window or {})} | more


STILL_UP = up({"velocity_m_per_s": 0.0})


def ruled(directions=(UP, FIELD), flow=None, beside=None, **tables):
    rule = {"kind": "stated"} | rules.hand_held().model_dump(mode="json", exclude_none=True)
    rule["gyro"] = {"noise_deg_per_s": 0.1, "bias_deg_per_s": 0.1, "drift_deg_per_s2": 0.0, "scale_error": 0.0}
    rule["motion"] |= {"velocity_m_per_s": 0.0, "position_m": 0.0, "windows_s": [2.0]}
    rule["rest"] |= {"velocity_m_per_s": 0.0}
    rule["accelerometer"] |= {"scale_error": 0.0, "error_m_per_s2": 1e-9, "averaged_error_m_per_s2": 0.0}
    rule["accelerometer"] |= {"gravity_error_m_per_s2": 0.0, "time_offset_bound_s": 0.0}
    rule["magnetometer"] |= {"scale_error": 0.0, "error_ut": 1e-9, "averaged_error_ut": 0.0, "disturbance_ut": 0.0}
    rule["magnetometer"] |= {"time_offset_bound_s": 0.0, "delay_s": 0.0}
    for name, table in tables.items():
        rule[name] |= table
    configuration = {"time_column": "t", "rule": rule, "directions": list(directions), "estimator": GUARANTEED}
    configuration["flow"] = {"kind": "gyro", "columns": ["gx", "gy", "gz"]} | (flow or {})
    return validate(Path("a test"), configuration | (beside or {}), Configuration)


VELOCITY = {"columns": ["u", "v", "w"], "unit": "km/h", "error_m_per_s": 0.5, "largest_acceleration_m_per_s2": 2.0}


def ruled_with_velocity(**more):
    """A rule that says next to nothing of the motion beside a measured velocity."""
    return ruled(
        beside={"velocity": VELOCITY | more}, motion={"velocity_m_per_s": 50.0, "position_m": 500.0, "windows_s": [2.0]}
    )


WEAKENED = {
    "a matrix that undoes itself": (
        lambda m: smaller(m, gyro_bounds, "largest_stretch", 0.5),
        lambda: configured({"scale_error": 0.05, "anchor_s": 1.0}, *STARS),
    ),
    "a matrix about a window": (
        lambda m: smaller(m, one_matrix, "nuclear_norms", 0.5),
        lambda: configured({"scale_error": 0.05}, STILL_UP, FIXED),
    ),
    "rates on lines that cone, from row to row": (
        lambda m: m.setattr(filter_input, "_coning_rate", lambda *_: 0.0),
        lambda: configured({}, *STARS),
    ),
    "what rates do between samples": (
        lambda m: m.setattr(GyroFlow, "off_the_line", lambda *_: 0.0),
        lambda: configured({"angular_acceleration_deg_per_s2": 2000.0}, *STARS),
    ),
    "errors that the rate makes larger": (
        lambda m: m.setattr(filter_input, "gyro_flow", _without_scale(filter_input.gyro_flow)),
        lambda: configured({"scale_error": 0.05}, *STARS),
    ),
    "the place in a window": (
        lambda m: smaller(m, MotionBounds, "mean_acceleration_triangular"),
        lambda: configured({}, up({"position_m": 1.0}), FIXED),
    ),
    "what nobody saw in a gap": (
        lambda m: smaller(m, MotionBounds, "unseen", 0.0),
        lambda: configured(
            {"largest_angular_acceleration_deg_per_s2": 10.0},
            up({"velocity_m_per_s": 0.1, "largest_jerk_m_per_s3": 20.0}),
            FIXED,
        ),
    ),
    "a measured velocity": (
        lambda m: smaller(m, VelocityOfRows, "mean_acceleration"),
        lambda: configured(
            {},
            up(),
            FIXED,
            velocity={"columns": ["u", "v", "w"], "error_m_per_s": 0.5, "largest_acceleration_m_per_s2": 2.0},
        ),
    ),
    "a rule's bias that drifts": (
        lambda m: m.setattr(apply, "after_rest", lambda gyro, times: gyro),
        lambda: ruled(gyro={"bias_deg_per_s": 0.0, "drift_deg_per_s2": 0.05}, rest={"least_s": 6.0}),
    ),
    "the speed in a window": (
        lambda m: smaller(m, MotionBounds, "mean_acceleration_uniform"),
        lambda: configured({}, up({"velocity_m_per_s": 1.0}), FIXED),
    ),
    "the error of a mean": (
        lambda m: smaller(m, VectorSensorBounds, "mean_error"),
        lambda: configured(
            {},
            up({"velocity_m_per_s": 0.0}, sensor_error={"error_m_per_s2": 0.5, "averaged_error_m_per_s2": 0.3}),
            FIXED,
        ),
    ),
    "the bias of a gyro": (
        lambda m: smaller(m, GyroBounds, "steady_error"),
        lambda: configured({"bias_deg_per_s": 1.0, "anchor_s": 1.0}, *STARS),
    ),
    "a bias that changes": (
        lambda m: smaller(m, GyroBounds, "unsteady_bias", 0.0),
        lambda: configured({"bias_deg_per_s": 1.0, "bias_change_deg_per_s": 2.0}, STILL_UP, STAR | RARE),
    ),
    "a bias that stays": (
        lambda m: smaller(m, SteadyBias, "turns", 0.1),
        lambda: configured({"bias_deg_per_s": 5.0, "bias_change_deg_per_s": 0.01}, STILL_UP, STAR | RARE),
    ),
    "the noise of a gyro": (
        lambda m: smaller(m, GyroBounds, "noise_angle"),
        lambda: configured({"noise_deg_per_s": 1.0, "anchor_s": 1.0}, *STARS),
    ),
    "what noise turns by itself": (
        lambda m: smaller(m, GyroBounds, "noise_angle", 0.8),
        lambda: configured({"noise_deg_per_s": 5.0, "noise_turn_deg": 0.5, "anchor_s": 2.0}, *STARS),
    ),
    "noise that turns with the body": (
        lambda m: smaller(m, GyroBounds, "swept_increment", 0.5),
        lambda: configured({"noise_deg_per_s": 5.0, "increment_deg": 0.5, "anchor_s": 2.0}, *STARS),
    ),
    "rates on lines that cone": (
        lambda m: [m.setattr(one, "coning_angles", lambda steps, rates: 0.0 * steps) for one in (gyro_bounds, turns)],
        lambda: configured({"anchor_s": 1.0}, STILL_UP, STATED_FIELD | NO_DISTURBANCE),
    ),
    "the largest rate in a gap": (
        lambda m: smaller(m, GyroBounds, "turns_over_gaps", 0.7),
        lambda: configured({"largest_rate_deg_per_s": 100.0, "anchor_s": 1.0}, *STARS),
    ),
    "offsets in time": (
        lambda m: smaller(m, direction_rows, "time_offset_angles"),
        lambda: configured({}, FIXED | {"time_offset_bound_s": 0.02}, STAR),
    ),
    "offsets of a gyro": (
        lambda m: without(m, Configuration, "time_offset_of_rows"),
        lambda: configured({"time_offset_bound_s": 0.02}, FIXED, STAR),
    ),
    "errors of axes and of a reference": (
        lambda m: without(m, DirectionBase, "added_angle"),
        lambda: configured({}, FIXED | {"alignment_error_deg": 1.0}, STAR),
    ),
    "a reference that moves": (
        lambda m: without(m, Direction, "reference_rate"),
        lambda: configured(
            {},
            {key: value for key, value in FIXED.items() if key != "reference"}
            | {"time_offset_bound_s": 0.5, "reference_columns": ["a", "b", "c"], "reference_rate_deg_per_s": 2.0},
            STAR,
        ),
    ),
    "a phase of rest as a reference": (
        lambda m: m.setattr(direction_rows, "reference_error", lambda *_: ReferenceBounds(0.0, 0.0)),
        lambda: configured(
            {}, STILL_UP, FIELD | {"reference": REST, "sensor_error": {"error_ut": 2.0}} | NO_DISTURBANCE
        ),
    ),
    "samples beside their rows": (
        lambda m: m.setattr(Log, "sampled", lambda *_: None),
        lambda: configured({}, FIXED | RARE, STAR, timing={"same_within_s": 0.01}),
    ),
    "a start of attitude and bias": (
        lambda m: m.setattr(guaranteed_run, "first_set", _smaller_set(guaranteed_run.first_set)),
        lambda: configured(
            {"bias_deg_per_s": 0.5, "estimate_bias": True, "known_bias_deg_per_s": [0.3, -2.0, 1.0]},
            FIXED | {"bound_deg": 1e-4},
            STAR | {"bound_deg": 1e-4},
            start={
                "kind": "given",
                "attitude_qw_qx_qy_qz": [0.5, -0.3, 0.7, 0.4],
                "P_diagonal": [1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6],
            },
        ),
    ),
    "a rule with a measured velocity": (
        lambda m: smaller(m, VelocityOfRows, "mean_acceleration"),
        ruled_with_velocity,
    ),
    "how late a rule's velocity may be": (
        lambda m: m.setattr(direction_rows, "MeasuredVelocity", lambda *given: MeasuredVelocity(*given[:4], 0.0)),
        lambda: ruled_with_velocity(error_m_per_s=1e-6, time_offset_bound_s=0.2),
    ),
    "a rule's velocity in another unit": (
        lambda m: other_unit(m, "VELOCITY", "km/h", 0.9),
        lambda: ruled_with_velocity(error_m_per_s=1e-6),
    ),
    "a rule's accelerometer in another unit": (
        lambda m: other_unit(m, "ACCELERATION", "g", 1.0001),
        lambda: ruled((UP | {"unit": "g"}, FIELD)),
    ),
    "a rule's gyro in another unit": (
        lambda m: other_unit(m, "ANGULAR_VELOCITY", "deg/s", 1.01),
        lambda: ruled(flow={"unit": "deg/s"}),
    ),
    "what a rule states in µT of a field in another unit": (
        lambda m: m.setattr(direction_rows, "_MICROTESLA", 0.8 * direction_rows._MICROTESLA),
        lambda: ruled((UP, FIELD | {"unit": "mG"}), magnetometer={"disturbance_ut": 5.0}),
    ),
    "a rule's reference field": (
        lambda m: m.setattr(apply, "reference_at_rest", _exact(apply.reference_at_rest)),
        lambda: ruled(magnetometer={"error_ut": 2.0, "averaged_error_ut": 2.0}),
    ),
}


def other_unit(monkeypatch, table, unit, factor):
    """Let a log be read as if a unit were this much larger; recordings are written with the right one."""
    wrong = {name: getattr(units, name) for name in ("ACCELERATION", "ANGULAR_VELOCITY", "VELOCITY")}
    wrong[table] = wrong[table] | {unit: factor * wrong[table][unit]}
    others = {name: getattr(units, name) for name in dir(units) if name not in wrong and not name.startswith("__")}
    monkeypatch.setattr(channels, "units", SimpleNamespace(**others, **wrong))


def _without_scale(whole):
    return lambda gyro, flow: whole(dataclasses.replace(gyro, scale_error=0.0), flow)


def _smaller_set(whole):
    def start(*given):
        found, starts_heading = whole(*given)
        return elliptude.StateEllipsoid(found.attitude, found.vector, 0.5 * found.shape), starts_heading

    return start


def _exact(whole):
    return lambda *given: (whole(*given)[0], 0.0)


@pytest.mark.parametrize("what", WEAKENED)
def test_a_bound_that_is_too_small_is_noticed(what, monkeypatch):
    require_noticed(monkeypatch, *WEAKENED[what])


# --- that an answer that is missing is noticed ------------------------------------------------------------------------


def test_rows_that_promise_an_answer_must_have_it():
    verdict = Verdict()
    verdict.add("up", np.array([0.5, np.nan, np.nan, np.inf]), np.array([True, True, False, True]))
    assert verdict.answers["up"] == {"answers": 2, "missing": 1, "outside": 1, "largest": {"share": 1e300, "row": 3}}
    assert Verdict(answers={"up": verdict.answers["up"] | {"outside": 0}}).is_fault


def lost(value):
    """The same with NaN in the place of its second half."""
    if value is None:
        return None
    found = np.array(value, dtype=np.float64)
    found[len(found) // 2 :] = np.nan
    return found


def without_some(monkeypatch, name):
    whole = trials.estimate

    def estimate(*given):
        found = whole(*given)
        return dataclasses.replace(
            found, result=dataclasses.replace(found.result, **{name: lost(getattr(found.result, name))})
        )

    monkeypatch.setattr(trials, "estimate", estimate)


def without_answers(monkeypatch, name):
    whole = trials.estimate

    def estimate(*given):
        found = whole(*given)
        kept = None if name is None else dataclasses.replace(found.answers, **{name: None})
        return dataclasses.replace(found, answers=kept)

    monkeypatch.setattr(trials, "estimate", estimate)


MISSING = {
    "largest angle": lambda m: without_some(m, "largest_angles"),
    "tilt": lambda m: without_some(m, "tilt_bounds"),
    "heading": lambda m: without_some(m, "headings"),
    "roll": lambda m: without_some(m, "roll_pitch_yaw"),
    "best": lambda m: without_some(m, "best_quaternions"),
    "tilt of best": lambda m: without_some(m, "best_tilt_bounds"),
    "heading of best": lambda m: without_some(m, "best_headings"),
    "bias": lambda m: without_some(m, "vectors"),
    "vector by itself": lambda m: without_some(m, "vector_ranges"),
    "turns in body": lambda m: without_answers(m, "body_turns"),
    "turns in reference": lambda m: without_answers(m, "reference_turns"),
    "attitude by itself": lambda m: without_answers(m, "own_shapes"),
    "questions": lambda m: without_answers(m, None),
}


@pytest.mark.parametrize("name", MISSING)
def test_an_answer_that_is_missing_is_noticed(name, monkeypatch):
    questions = GUARANTEED | {"questions": ["reference_turns", "body_turns", "vector", "attitude"]}
    flow = {"bias_deg_per_s": 0.05, "estimate_bias": True}
    force = UP | {"sensor_error": SMALL, "bound_from": {"kind": "acceleration", "acceleration_m_per_s2": 0.1}}
    arguments = RecordingArguments(configured(flow, force, FIXED, estimator=questions), 1, 0)
    whole = try_recording(arguments, 0).verdict
    assert not whole.is_fault
    assert name == "questions" or whole.answers[name]["answers"] > 0
    MISSING[name](monkeypatch)
    verdict = try_recording(arguments, 0).verdict
    assert verdict.answers[name]["missing"] > 0
    assert verdict.is_fault


# --- as typed ---------------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def written(folder, tables=None):
    file = folder / "config.toml"
    tables = tables or {"time_column": "t", "flow": GYRO, "directions": [FIXED, STAR]} | {"estimator": GUARANTEED}
    file.write_text(tomlkit.dumps(tables), encoding="utf-8")
    return file


def test_command_says_what_became_of_recordings(tmp_path):
    config, out = written(tmp_path), tmp_path / "out"
    typed = ["validate", "--config", config, "--out", out, "--trials", 2, "--processes", 1]
    done = run(*typed, "--json", "--keep-worst", tmp_path / "worst")
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary == json.loads((out / "summary.json").read_text())
    assert summary["total"]["rows"] > 0
    assert summary["faults"] == []
    assert {"set", "largest angle"} <= set(summary["answers"])
    # The same command goes on, and says the same.
    assert json.loads(run(*typed, "--json").stdout) == summary
    refused = run(*typed, "--seed", 1)
    assert refused.exit_code == 1
    again = run(
        "estimate", tmp_path / "worst/log.csv", "--config", tmp_path / "worst/config.toml", "--out", tmp_path / "found",
        "--ignore-implausible",
    )  # fmt: skip
    assert again.exit_code == 0, again.output
    assert "against truth" in again.output


def test_command_fails_if_a_bound_is_too_small(tmp_path, monkeypatch):
    weaken, _ = WEAKENED["errors of axes and of a reference"]
    weaken(monkeypatch)
    tables = {"time_column": "t", "flow": GYRO, "estimator": {"mode": "guaranteed", "policy": "drop_measurement"}}
    stars = [FIXED | {"alignment_error_deg": 1.0}, STAR]
    config = written(tmp_path, tables | {"directions": stars})
    done = run("validate", "--config", config, "--out", tmp_path / "out", "--trials", 8, "--processes", 1)
    assert done.exit_code == 1
    assert "trial" in done.stdout


def test_what_is_not_drawn_is_refused(tmp_path):
    body = {"kind": "rigid_body", "inertia_kg_m2": [1.0, 2.0, 2.5], "step_s": 0.1}
    rests = FIELD | {"reference": REST | {"to_s": 3.0}, "bound_deg": 1.0}
    down = UP | {"bound_deg": 1.0}
    tables = {"flow": body, "reference_frame": "ENU", "directions": [down, rests], "estimator": {"mode": "guaranteed"}}
    tables["directions"][1]["reference"] = {key: value for key, value in REST.items() if key != "velocity_m_per_s"}
    done = run("validate", "--config", written(tmp_path, tables), "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "directions.reference" in done.output
    done = run("validate", "--smooth", "--out", tmp_path / "out")
    assert done.exit_code == 2
