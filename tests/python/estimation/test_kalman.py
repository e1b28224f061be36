"""The Kalman filter beside the sets: noise from bounds, where it begins, what it leaves out, how good it is."""

import dataclasses
import json

import elliptude
import numpy as np
import pytest
import tomlkit
from elliptude import cli, estimation
from elliptude.configuration import Configuration
from elliptude.estimation.best import kalman, motions
from elliptude.estimation.guaranteed_run import run_guaranteed
from elliptude.io import column_files, tables
from elliptude.io.tables import Result
from elliptude.logs import Log
from elliptude.logs.log import log_of
from elliptude.simulation import scenarios, simulated
from elliptude.simulation.configured import configuration_tables
from elliptude.smoothing.smoother import smoothed_run
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

REFERENCES = np.array([[0.0, 0.0, 1.0], [0.0, 0.6, -0.8]])
STEP = 0.1


def gyro_configuration(bound, *, noise=0.0, bias=0.0, drift=0.0, policy="raise", **changes):
    """Two stars and a gyro, with bounds in rad and rad/s."""
    degrees = {"bound_deg": float(np.rad2deg(bound))}
    return Configuration.model_validate(
        {
            "flow": {
                "kind": "gyro",
                "columns": ["x", "y", "z"],
                "interval_rate": "first_sample",
                "noise_deg_per_s": float(np.rad2deg(noise)),
                "bias_deg_per_s": float(np.rad2deg(bias)),
                "drift_deg_per_s2": float(np.rad2deg(drift)),
                "estimate_bias": bias > 0.0,
            }
            | changes,
            "directions": [
                {"name": name, "columns": list(columns), "reference": reference.tolist()} | degrees
                for name, columns, reference in zip(("one", "two"), ("abc", "def"), REFERENCES, strict=True)
            ],
            "estimator": {"mode": "guaranteed", "policy": policy, "best": "kalman"},
        }
    )


def gyro_log(bound, *, noise=0.0, bias=0.0, count=60, seed=0):
    """A rate that is constant from row to row, and errors that are uniform in balls."""
    draws = np.random.default_rng(seed)

    def ball(radius, *shape):
        drawn = draws.normal(size=(*shape, 3))
        lengths = np.cbrt(draws.uniform(size=(*shape, 1)))
        return radius * lengths * drawn / np.linalg.norm(drawn, axis=-1, keepdims=True)

    rates = draws.normal(size=(count, 3))
    attitudes = [Rotation.random(rng=draws)]
    for rate in rates[:-1]:
        attitudes.append(attitudes[-1] * Rotation.from_rotvec(STEP * rate))
    true = Rotation.concatenate(attitudes)
    directions = np.stack(
        [(true * Rotation.from_rotvec(ball(bound, count))).inv().apply(reference) for reference in REFERENCES], axis=1
    )
    shown = rates + ball(bias) + ball(noise, count)
    times = STEP * np.arange(count)
    return Log(times, directions, np.tile(REFERENCES, (count, 1, 1)), rates=shown, true_attitudes=true.as_matrix())


def scenario_log(name="pendulum", *, bound_deg=7.0, noise="inside", seed=0, **flow):
    """Measurements of a scenario, and the configuration of the guaranteed mode for them."""
    scenario = scenarios.load(name)
    made = simulated.simulate(scenario, directions="three", bound_deg=bound_deg, noise=noise, seed=seed)
    fields = configuration_tables(scenario, made) | {"estimator": {"mode": "guaranteed"}}
    fields["flow"] |= flow
    if fields["start"]["kind"] == "first_measurement":
        del fields["start"]
    return log_of(made.measurements), Configuration.model_validate(fields)


def angles(attitudes, log):
    """How far attitudes are from the truth, degrees."""
    return np.rad2deg(Rotation.from_matrix(attitudes.swapaxes(1, 2) @ log.true_attitudes).magnitude())


def best_angles(found, log):
    """The errors of best estimate and center, after checking the bounds of the first."""
    best = Rotation.from_quat(found.best.quaternions, scalar_first=True).as_matrix()
    errors = angles(best, log)
    assert (errors <= np.rad2deg(found.best.errors.bounds[:, 0]) + 1e-9).all()
    return errors, angles(found.guaranteed.sets.attitudes, log)


# --- against least squares --------------------------------------------------------------------------------------------


def test_all_rows_together_against_least_squares():
    """The last row of the filter and all rows of the smoother are the least of all that is stated, for small errors."""
    bound, noise, bias, drift, count = 1e-4, 2e-4, 5e-4, 1e-3, 6
    log = gyro_log(bound, noise=noise, bias=bias, count=count, seed=1)
    configuration = gyro_configuration(bound, noise=noise, bias=bias, drift=drift)
    run = run_guaranteed(log, configuration)
    predictions = kalman.Predictions.empty(count)
    forward = kalman.kalman_log(run, configuration, predictions)
    assert forward.begins.tolist() == [True] + [False] * (count - 1)
    # It begins with what is uniform in the set, and in the ball of a noise that does not change.
    first = run.sets.shapes[0] / 8.0 + np.diag([0, 0, 0, 1, 1, 1]) * noise**2 / 5.0
    np.testing.assert_allclose(forward.covariances[0], first, rtol=1e-9, atol=1e-20)
    of_prior = np.linalg.inv(np.linalg.cholesky(first))

    def states(unknown):
        attitude = run.sets.attitudes[0] @ Rotation.from_rotvec(unknown[:3]).as_matrix()
        biases, attitudes = [run.sets.vectors[0] + unknown[3:6]], [attitude]
        for rate, of_rate, of_bias in zip(log.rates[:-1], *unknown[6:].reshape(2, -1, 3), strict=True):
            turn = Rotation.from_rotvec(STEP * (rate - biases[-1] - of_rate))
            attitudes.append(attitudes[-1] @ turn.as_matrix())
            biases.append(biases[-1] + STEP * of_bias)
        return np.array(attitudes), np.array(biases)

    def residuals(unknown):
        attitudes, _ = states(unknown)
        expected = np.einsum("nji,mj->nmi", attitudes[1:], REFERENCES)
        of_rates, of_biases = unknown[6:].reshape(2, -1)
        return np.concatenate(
            [
                of_prior @ unknown[:6],
                ((log.directions[1:] - expected) / (bound / np.sqrt(5.0))).ravel(),
                of_rates / (noise / np.sqrt(5.0)),
                of_biases / (drift / np.sqrt(5.0)),
            ]
        )

    found = least_squares(
        residuals, np.zeros(6 * count), xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=1e-4, diff_step=1e-6
    )
    attitudes, biases = states(found.x)

    def assert_near(one, rows):
        turns = Rotation.from_matrix(one.attitudes[rows].swapaxes(1, 2) @ attitudes[rows]).as_rotvec()
        np.testing.assert_allclose(turns, np.zeros_like(turns), atol=1e-7)
        np.testing.assert_allclose(one.vectors[rows], biases[rows], atol=1e-6)

    assert_near(forward, [-1])
    smoothed = kalman.smoothed(forward, predictions)
    assert_near(smoothed, np.arange(count))
    # The first row's covariance, too: the upper left block of the inverse of all that is known.
    inverse = np.linalg.inv(found.jac.T @ found.jac)[:6, :6]
    np.testing.assert_allclose(smoothed.covariances[0], inverse, atol=5e-3 * np.abs(inverse).max())
    assert np.trace(smoothed.covariances[0]) < 0.5 * np.trace(forward.covariances[0])


def test_between_filter_and_center_against_least_squares():
    """The least of two distances: from the estimate, by its covariance, and from the center, by the set's."""
    log, configuration = scenario_log(noise="perpendicular")
    run = run_guaranteed(log, configuration)
    filtered, found = kalman.kalman_log(run, configuration), kalman.kalman_attitudes(run, configuration)
    assert (filtered.scales[1:] > 1.0).all()
    for row in (1, 10, 59):
        offset = np.concatenate(
            [
                Rotation.from_matrix(filtered.attitudes[row].T @ run.sets.attitudes[row]).as_rotvec(),
                run.sets.vectors[row] - filtered.vectors[row],
            ]
        )
        of_filter = np.linalg.cholesky(np.linalg.inv(filtered.scales[row] * filtered.covariances[row])).T
        of_center = np.linalg.cholesky(np.linalg.inv(run.sets.shapes[row] / 48.0)).T
        stacked = np.concatenate([of_filter, of_center])
        wanted = np.concatenate([np.zeros(6), of_center @ offset])
        (error, *_) = np.linalg.lstsq(stacked, wanted)
        expected = filtered.attitudes[row] @ Rotation.from_rotvec(error[:3]).as_matrix()
        np.testing.assert_allclose(found[row], expected, atol=1e-9)


# --- noise from bounds ------------------------------------------------------------------------------------------------


def test_uniform_in_a_ball():
    draws = np.random.default_rng(0)
    drawn = draws.uniform(-0.3, 0.3, (400_000, 3))
    inside = drawn[np.linalg.norm(drawn, axis=1) <= 0.3]
    np.testing.assert_allclose(np.var(inside, axis=0), motions.uniform_variance(0.3), rtol=0.01)


def test_a_bias_that_is_not_estimated_is_one_of_the_filter():
    """Its bound and that of the noise are balls in which what does not change is uniform; so is the scale's error."""
    log = gyro_log(0.01, noise=0.02)
    configuration = gyro_configuration(0.01, noise=0.02, drift=0.003, scale_error=0.1, estimate_bias=False)
    flow = configuration.flow.model_copy(update={"bias_deg_per_s": float(np.rad2deg(0.05))})
    configuration = configuration.model_copy(update={"flow": flow})
    run = run_guaranteed(log, configuration)
    found = kalman.kalman_log(run, configuration)
    usual = 0.1 * np.median(np.linalg.norm(log.rates, axis=1))
    constant = (0.02**2 + 0.05**2 + usual**2) / 5.0
    np.testing.assert_allclose(found.covariances[0, 3:, 3:], constant * np.eye(3), rtol=1e-9)
    np.testing.assert_allclose(found.covariances[0, :3, :3], run.sets.shapes[0, :3, :3] / 5.0, rtol=1e-9)
    np.testing.assert_array_equal(found.vectors[0], np.zeros(3))
    # What a step adds: predicted from a state without an error.
    motion, before = motions.motion_of(run, configuration), kalman.MultiplicativeFilter
    estimate = before(np.eye(3), np.zeros(3), np.zeros((6, 6)))
    motion.carry(estimate, 1)
    noise = 0.02**2 + (0.1 * np.linalg.norm(log.rates[0])) ** 2
    jacobian = STEP * elliptude.right_jacobian(STEP * log.rates[0])
    np.testing.assert_allclose(estimate.covariance[:3, :3], noise / 5.0 * jacobian @ jacobian.T, rtol=1e-9)
    np.testing.assert_allclose(estimate.covariance[3:, 3:], (STEP * 0.003) ** 2 / 5.0 * np.eye(3), rtol=1e-9)


@pytest.mark.parametrize("error", [{"unknown_torque_n_m": 0.02}, {"inertia_error_kg_m2": 0.001}], ids=["torque", "J"])
def test_what_an_unknown_torque_adds(error):
    """Uniform in its ball; an error of the inertia is a torque of ε (ω² + |ω'|)."""
    log, configuration = scenario_log(**error)
    estimate = kalman.MultiplicativeFilter(log.true_attitudes[3], log.true_vectors[3], np.zeros((6, 6)))
    run = run_guaranteed(log, configuration)
    motions.motion_of(run, configuration).carry(estimate, 4)
    inertia, omega, pull = np.diag([0.13, 0.28, 0.17]), log.true_vectors[3], 9.81 * log.true_attitudes[3, 2]
    bound = error.get("unknown_torque_n_m", 0.0)
    moment = np.cross(inertia @ omega, omega) + np.cross([0.0, 0.0, 0.3], pull)
    turning = np.linalg.norm(np.linalg.solve(inertia, moment))
    bound = bound or 0.001 * (omega @ omega + turning)
    body = elliptude.RigidBody(inertia)
    potential = elliptude.UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3])
    integrator = elliptude.Integrator(body, potential, step=0.005, order=4)
    effect = integrator.linearize(log.true_attitudes[3], omega, steps=20).control
    np.testing.assert_allclose(estimate.covariance, bound**2 / 5.0 * effect @ effect.T, rtol=1e-6, atol=1e-15)


def test_wheels():
    """A body with a wheel that is not accounted for goes astray; with it the estimate is good."""
    log, configuration = scenario_log(bound_deg=1.0)
    still = dataclasses.replace(log, wheel_momenta=np.zeros((60, 3)))
    run = run_guaranteed(log, configuration)
    plain = kalman.kalman_log(run, configuration)
    with_still = kalman.kalman_log(dataclasses.replace(run, log=still), configuration)
    assert angles(with_still.attitudes, log).mean() == pytest.approx(angles(plain.attitudes, log).mean(), rel=1e-6)
    turning = dataclasses.replace(log, wheel_momenta=np.tile([0.1, 0.2, 0.3], (60, 1)))
    astray = kalman.kalman_log(dataclasses.replace(run, log=turning), configuration)
    assert angles(astray.attitudes, log).mean() > 5.0 * angles(plain.attitudes, log).mean()


# --- where it begins, and what it leaves out --------------------------------------------------------------------------


def test_what_the_run_left_out_is_left_out():
    log = gyro_log(0.01, noise=0.01)
    configuration = gyro_configuration(0.01, noise=0.01, bias=0.01, policy="drop_measurement")
    directions = log.directions.copy()
    axis = np.cross(directions[30, 1], directions[30, 0])
    directions[30, 1] = Rotation.from_rotvec(0.5 * axis / np.linalg.norm(axis)).apply(directions[30, 1])
    run = run_guaranteed(dataclasses.replace(log, directions=directions), configuration)
    assert np.argwhere(run.sets.dropped).tolist() == [[30, 1]]
    directions[30, 1] = np.nan
    without = run_guaranteed(dataclasses.replace(log, directions=directions), configuration)
    found, expected = (kalman.kalman_log(one, configuration) for one in (run, without))
    np.testing.assert_array_equal(found.attitudes[:40], expected.attitudes[:40])
    assert not found.begins[1:40].any()


def test_it_begins_anew_where_the_run_does():
    """The body is turned between two rows, and the run begins again from what is measured."""
    log = gyro_log(0.01, noise=0.01)
    configuration = gyro_configuration(0.01, noise=0.01, bias=0.01, policy="restart")
    turn = Rotation.from_rotvec([1.0, 0.5, 0.0]).as_matrix()
    directions, true = log.directions.copy(), log.true_attitudes.copy()
    directions[30:], true[30:] = directions[30:] @ turn, true[30:] @ turn
    log = dataclasses.replace(log, directions=directions, true_attitudes=true)
    run = run_guaranteed(log, configuration)
    found = kalman.kalman_log(run, configuration)
    assert found.begins[[0, 30]].all()
    np.testing.assert_array_equal(found.attitudes[30], run.sets.attitudes[30])
    assert angles(found.attitudes, log).max() < 2.0


def test_it_begins_anew_after_a_gap_of_the_gyro():
    log = gyro_log(0.01, noise=0.01)
    rates, directions = log.rates.copy(), log.directions.copy()
    rates[20:25], directions[20:28, 1] = np.nan, np.nan
    log = dataclasses.replace(log, rates=rates, directions=directions)
    configuration = gyro_configuration(0.01, noise=0.01)
    run = run_guaranteed(log, configuration)
    found = kalman.kalman_log(run, configuration)
    has_set = np.isfinite(run.sets.attitudes[:, 0, 0])
    assert not has_set.all()
    np.testing.assert_array_equal(np.isfinite(found.attitudes[:, 0, 0]), has_set)
    assert np.flatnonzero(found.begins).tolist() == [0, 28]
    whole = estimation.estimate(log, configuration)
    assert whole.best.is_estimated.tolist() == has_set.tolist()
    assert np.isnan(whole.best.quaternions[~has_set]).all()


def test_it_does_not_begin_with_a_set_that_is_too_wide():
    """The orbit's first set is half-way round the sphere; there the center counts."""
    log, configuration = scenario_log("orbit")
    found = estimation.estimate(log, configuration)
    assert found.best.is_estimated.tolist() == [False] + [True] * 20
    assert found.result.best_from == ["center"] + ["kalman"] * 20
    summary = estimation.summarize(found, configuration)["best"]
    assert summary["from"] == "kalman"
    assert summary["rows"] == {"kalman": 20, "center": 1}
    assert summary["in_words"].startswith("a Kalman filter: within ")


def test_it_says_that_all_sets_are_too_wide():
    log, configuration = gyro_log(1.0, noise=0.1), gyro_configuration(1.0, noise=0.1)
    found = estimation.estimate(log, configuration)
    assert not found.best.is_estimated.any()
    assert np.isfinite(found.best.errors.bounds[:, 0]).any()
    np.testing.assert_allclose(np.abs(found.best.quaternions), np.abs(found.result.quaternions), atol=1e-14)
    summary = estimation.summarize(found, configuration)["best"]
    why = "no set is narrow enough for a Kalman filter to begin with"
    assert summary["in_words"].startswith(f"the center of the set ({why}); mean error ")


def test_beside_a_gyro_it_is_there_for_the_asking():
    log = gyro_log(0.01, noise=0.01)
    configuration = gyro_configuration(0.01, noise=0.01)
    assert "kalman" in estimation.estimate(log, configuration).result.best_from
    silent = configuration.model_copy(update={"estimator": configuration.estimator.model_copy(update={"best": None})})
    found = estimation.estimate(log, silent)
    assert set(found.result.best_from) <= {"center", ""}
    summary = estimation.summarize(found, silent)["best"]
    assert summary["in_words"].startswith("the center of the set (a Kalman filter's with estimator.best = 'kalman')")


# --- how good it is ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "most"), [("orbit", 0.8), ("pendulum", 0.75), ("free", 0.85)])
def test_better_than_the_center_with_errors_inside_the_bounds(name, most):
    errors = np.zeros(2)
    for seed in range(4):
        log, configuration = scenario_log(name, seed=seed)
        found = estimation.estimate(log, configuration)
        best, center = best_angles(found, log)
        errors += best[1:].mean(), center[1:].mean()
    assert errors[0] < most * errors[1]


@pytest.mark.parametrize("noise", ["perpendicular", "common"])
def test_near_the_center_with_errors_at_the_bounds(noise):
    """These make sets so small that no filter is as good as their centers."""
    errors, raw = np.zeros(2), 0.0
    for seed in range(4):
        log, configuration = scenario_log("free", noise=noise, seed=seed)
        found = estimation.estimate(log, configuration)
        best, center = best_angles(found, log)
        errors += best.mean(), center.mean()
        raw += angles(kalman.kalman_log(found.guaranteed, configuration).attitudes, log).mean()
    assert errors[0] < 1.25 * errors[1]
    assert errors[0] < 0.8 * raw


def test_errors_larger_than_uniform_are_seen():
    """Their squares are 5/2 and 5/3 of those of the uniform ones."""
    scales = {}
    for noise in ("inside", "perpendicular", "common"):
        log, configuration = scenario_log(noise=noise, bound_deg=1.0)
        scales[noise] = kalman.kalman_log(run_guaranteed(log, configuration), configuration).scales[-1]
    assert scales["inside"] < 1.1
    # Three directions in two and a rate in three components of nine.
    assert scales["perpendicular"] == pytest.approx((6 * 5 / 2 + 3 * 5 / 3) / 9, rel=0.1)
    assert scales["common"] == pytest.approx(5 / 3, rel=0.15)


def test_smoothed_sets_have_a_smoothed_estimate():
    errors = np.zeros(4)
    for seed in range(3):
        log, configuration = scenario_log("free", seed=seed)
        smooth = estimation.estimate(log, configuration, smoothed_run)
        forward = estimation.estimate(log, configuration)
        errors += [one.mean() for found in (smooth, forward) for one in best_angles(found, log)]
    assert errors[0] < 0.6 * errors[1]
    assert errors[0] < 0.6 * errors[2]
    assert errors[1] < errors[3]


# --- the commands -----------------------------------------------------------------------------------------------------


def run_command(*arguments):
    done = CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture
def folder(tmp_path):
    run_command("simulate", "pendulum", "--out", tmp_path)
    fields = tomlkit.parse((tmp_path / "estimate.toml").read_text())
    del fields["start"]
    fields["estimator"] = {"mode": "guaranteed"}
    (tmp_path / "estimate.toml").write_text(tomlkit.dumps(fields))
    return tmp_path


def test_commands_say_that_it_is_a_kalman_filter(folder):
    inputs = ("estimate", folder / "measurements.csv", "--config", folder / "estimate.toml")
    page = folder / "report.html"
    said = run_command(*inputs, "--out", folder / "out", "--report", page)
    summary = json.loads((folder / "out" / "summary.json").read_text())["best"]
    assert f"best estimate, {summary['in_words']}" in said
    assert summary["in_words"].startswith("a Kalman filter: within ")
    assert "; mean error " in summary["in_words"]
    assert summary["rows"] == {"kalman": 60, "center": 0}
    assert summary["in_words"] in page.read_text()
    table = Result.read(folder / "out" / "results.csv")
    assert list(table.best_from) == ["kalman"] * 60
    assert run_command(*inputs, "--out", folder / "smooth", "--smooth").count("a Kalman filter") == 1
    # What monitor says of the same attitudes is the same.
    estimate = folder / "best.csv"
    rows = np.column_stack([table.times, table.best_quaternions])
    header = ",".join(("time_s", *tables.QUATERNION))
    np.savetxt(estimate, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    run_command("monitor", folder / "out", "--estimate", estimate, "--out", folder / "judged")
    judged = column_files.read_columns(folder / "judged" / "monitor.csv", numbers=("total_bound",))
    np.testing.assert_allclose(judged["total_bound"], table.best_bounds, atol=1e-9)
    assert "best estimate, a Kalman filter" in run_command(*inputs, "--out", folder / "asked", "--best", "kalman")
    said = run_command(*inputs, "--out", folder / "center", "--best", "center")
    assert "best estimate, the center of the set; mean error " in said
