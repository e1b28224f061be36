"""Where the gyro's stamps may be off, attitudes with other stamps may be as far from the sets as the body turns."""

import json

import numpy as np
import pytest
import tomlkit
from elliptude import cli
from elliptude.estimation.containment import reach_of_turns
from elliptude.io.tables import Result
from elliptude.monitoring import Sets, monitor, widened
from elliptude.report.estimated.reading import read_run
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

OFFSET = 0.05
TIMES = np.round(np.arange(0.0, 6.001, 0.01), 6)
AXIS = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
UP = np.array([0.0, 0.0, 1.0])


def rates(times):
    """One quick turn, from 2 s to 4 s."""
    return 2.5 * np.sin(np.pi * np.clip(0.5 * (times - 2.0), 0.0, 1.0)) ** 2


def attitudes(times):
    s = np.clip(0.5 * (times - 2.0), 0.0, 1.0)
    return Rotation.from_rotvec((2.5 * (s - np.sin(2.0 * np.pi * s) / (2.0 * np.pi)))[:, None] * AXIS)


@pytest.fixture
def late_gyro(tmp_path):
    """A gyro's stamps are late, as is stated; those of the directions and of the truth are exact."""
    true = attitudes(TIMES)
    quaternions = true.as_quat(canonical=True, scalar_first=True)
    directions = np.column_stack([true.inv().apply([0.0, 0.0, 1.0]), true.inv().apply([1.0, 0.0, 0.0])])
    directions[(TIMES > 1.5) & (TIMES < 5.0)] = np.nan  # the gyro alone
    table = np.column_stack([TIMES, rates(TIMES - OFFSET)[:, None] * AXIS, directions, quaternions])
    lines = [",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in table]
    (tmp_path / "log.csv").write_text("time_s,gx,gy,gz,ax,ay,az,mx,my,mz,qw,qx,qy,qz\n" + "\n".join(lines) + "\n")
    of = {"bound_deg": 0.5}
    tables = {
        "reference_frame": "ENU",
        "flow": {
            "kind": "gyro",
            "columns": ["gx", "gy", "gz"],
            "noise_deg_per_s": 0.3,
            "time_offset_bound_s": OFFSET,
            "largest_rate_deg_per_s": 150.0,
        },
        "directions": [
            {"name": "up", "columns": ["ax", "ay", "az"], "reference": [0.0, 0.0, 1.0]} | of,
            {"name": "north", "columns": ["mx", "my", "mz"], "reference": [1.0, 0.0, 0.0]} | of,
        ],
        "truth": {"attitude_columns": ["qw", "qx", "qy", "qz"]},
        "estimator": {"mode": "guaranteed", "questions": ["reference_turns", "body_turns", "attitude"]},
    }
    (tmp_path / "config.toml").write_text(tomlkit.dumps(tables))
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def test_a_right_estimate_is_not_proved_wrong(late_gyro):
    log, config, result = (late_gyro / name for name in ("log.csv", "config.toml", "result"))
    for sets in ([log, "--config", config], [result, "--frame", "ENU"]):
        if sets[0] == result:
            assert run("estimate", log, "--config", config, "--out", result).exit_code == 0
        done = run("monitor", *sets, "--estimate", log, "--json")
        assert done.exit_code == 0, done.output
        found = json.loads(done.stdout)
        assert (found["judged"], found["rows_with_proof"]) == (len(TIMES), 0)
        assert 7.0 < found["turn_within_offset_deg"] < 8.0
        assert "up to 7." in run("monitor", *sets, "--estimate", log).output
    # How far an estimate can be off counts it too, and what is farther off is still proved wrong.
    wrong = Rotation.from_rotvec([np.deg2rad(40.0), 0.0, 0.0]) * attitudes(TIMES)
    rows = np.column_stack([TIMES, wrong.as_quat(scalar_first=True)]).tolist()
    (late_gyro / "wrong.csv").write_text(
        "time_s,qw,qx,qy,qz\n" + "\n".join(",".join(map(repr, row)) for row in rows) + "\n"
    )
    found = json.loads(run("monitor", result, "--estimate", late_gyro / "wrong.csv", "--json").stdout)
    assert found["rows_with_proof"] == len(TIMES)
    assert found["total"]["largest_least_deg"] < 40.0


def test_the_truth_of_the_log_is_inside(late_gyro):
    log, config, result = (late_gyro / name for name in ("log.csv", "config.toml", "result"))
    assert run("estimate", log, "--config", config, "--out", result).exit_code == 0
    table = Result.read(result / "results.csv")
    assert (table.forms <= 1.0).all()
    for forms in (table.turns_reference_forms, table.turns_body_forms, table.own_forms):
        assert (forms <= 1.0).all()
    summary = json.loads((result / "summary.json").read_text())
    assert summary["inside_share_of_unconditional_rows"] == 1.0
    compared = run("compare", result, log)
    assert compared.exit_code == 0, compared.output
    # Without the turn it is outside of many.
    read = read_run(result)[0]
    np.testing.assert_array_equal(read.clock_turns, table.clock_turns)
    x = 2.0 * np.tan(0.5 * np.linalg.norm(table.errors[:, :3], axis=1))
    assert (x > 2.0 * np.tan(0.5 * table.largest_angles)).sum() > 50


def test_without_such_an_offset_nothing_changes(late_gyro):
    text = (late_gyro / "config.toml").read_text()
    (late_gyro / "config.toml").write_text(text.replace(f"time_offset_bound_s = {OFFSET}\n", ""))
    assert run("estimate", late_gyro / "log.csv", "--config", late_gyro / "config.toml", "--out", late_gyro / "r")
    assert "turn_within_offset" not in (late_gyro / "r" / "results.csv").read_text()
    done = run("monitor", late_gyro / "r", "--estimate", late_gyro / "log.csv", "--json")
    assert json.loads(done.stdout)["rows_with_proof"] > 50
    assert json.loads(done.stdout)["turn_within_offset_deg"] is None


@pytest.mark.parametrize("most", [0.05, 0.5, 2.0])
def test_widened_bounds_hold_after_any_turn(most):
    draws = np.random.default_rng(5)
    n = 4000
    centers, judged = Rotation.random(n, rng=draws), Rotation.random(n, rng=draws)
    factors = draws.normal(size=(n, 3, 3)) * 0.4
    shapes = factors @ factors.swapaxes(1, 2) + 1e-3 * np.eye(3)
    directions = draws.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    gamma = (np.linalg.cholesky(shapes) @ directions[..., None])[..., 0]
    inside = centers * Rotation.from_quat(np.column_stack([np.ones(n), 0.5 * gamma]), scalar_first=True)
    sets = Sets(np.arange(n) * 1.0, centers.as_quat(scalar_first=True), shapes, np.zeros(n, dtype=np.uint8))
    turns = most * draws.random(n)
    axes = draws.normal(size=(n, 3))
    axes *= (turns / np.linalg.norm(axes, axis=1))[:, None]
    later = Rotation.from_rotvec(axes) * inside
    found = widened(monitor(sets, judged, up=UP), turns)
    off = (later * judged.inv()).as_quat(scalar_first=True)
    total = 2.0 * np.arccos(np.clip(np.abs(off[:, 0]), 0.0, 1.0))
    tilt = 2.0 * np.arccos(np.clip(np.hypot(off[:, 0], off[:, 3]), 0.0, 1.0))
    heading = 2.0 * np.arctan2(off[:, 3], off[:, 0])
    signed = (heading + np.pi) % (2.0 * np.pi) - np.pi
    for i, error in enumerate((total, tilt, np.abs(signed))):
        assert (error <= found.bounds[:, i] + 1e-7).all()
        assert (error >= found.least[:, i] - 1e-7).all()
    middle, half = found.headings.mean(axis=1), 0.5 * np.diff(found.headings, axis=1)[:, 0]
    assert (np.abs((signed - middle + np.pi) % (2.0 * np.pi) - np.pi) <= half + 1e-7).all()
    if most < 1.0:
        assert (found.least > 0.0).any(axis=0).all()


def test_nothing_known_of_the_turn_proves_nothing():
    centers = Rotation.identity(3)
    sets = Sets(np.arange(3.0), centers.as_quat(scalar_first=True), 1e-4 * np.array([np.eye(3)] * 3), np.zeros(3, "u1"))
    judged = Rotation.from_rotvec(np.tile([0.5, 0.0, 0.0], (3, 1)))
    found = monitor(sets, judged, up=UP)
    same = widened(found, np.zeros(3))
    np.testing.assert_array_equal(same.bounds, found.bounds)
    np.testing.assert_array_equal(same.least, found.least)
    unknown = widened(found, np.array([np.nan, np.pi, 0.1]))
    assert unknown.alarms.proved.any(axis=1).tolist() == [False, False, True]
    np.testing.assert_array_equal(unknown.bounds[:2], np.pi)


def test_the_reach_of_turns_is_not_exceeded():
    draws = np.random.default_rng(6)
    n = 5000
    first = Rotation.from_rotvec(draws.normal(size=(n, 3)))
    axes = draws.normal(size=(n, 3))
    turned = draws.random(n)
    second = first * Rotation.from_rotvec(axes * (turned / np.linalg.norm(axes, axis=1))[:, None])
    gammas = [2.0 * q[:, 1:] / q[:, :1] for q in (one.as_quat(scalar_first=True) for one in (first, second))]
    reach = reach_of_turns(gammas[0], turned)
    assert (np.linalg.norm(gammas[1] - gammas[0], axis=1) <= reach * (1.0 + 1e-9)).all()
    outward = reach_of_turns(np.array([[2.0 * np.tan(0.25), 0.0, 0.0]]), np.array([0.3]))
    np.testing.assert_allclose(outward, 2.0 * (np.tan(0.4) - np.tan(0.25)), rtol=1e-12)
    assert reach_of_turns(np.array([[1.0, 0.0, 0.0]]), np.array([np.pi])) == np.inf
