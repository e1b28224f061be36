"""Estimates from logs: against the NumPy reference, and what becomes of rows and sets that are at fault."""

import dataclasses
import json

import numpy as np
import pytest
from elliptude import InconsistentMeasurement, estimation, simulation
from elliptude.configuration import Configuration
from elliptude.io import tables
from elliptude.io.files import FileError
from elliptude.logs import log as logs
from elliptude.simulation import potentials, scenarios
from elliptude.simulation.configured import configuration_tables
from reference import ellipsoid, gyro, measurement, rigid_body, so3
from reference import filter as reference_filter
from scipy.spatial.transform import Rotation

# Both find the same minimum of a curve that is flat there, each in its own way.
MINIMUM = 1e-6


@pytest.fixture(scope="module")
def pendulum():
    scenario = scenarios.load("pendulum").model_copy(update={"measurements": 6})
    return scenario, simulation.simulate(scenario, directions="two", bound_deg=7.0, seed=3)


@pytest.fixture(scope="module")
def orbit():
    scenario = scenarios.load("orbit").model_copy(update={"measurements": 4})
    return scenario, simulation.simulate(scenario, directions="three", bound_deg=7.0, seed=3)


def configured(scenario, simulated, **changes):
    return Configuration.model_validate(configuration_tables(scenario, simulated) | changes)


def reference_body(scenario):
    inertia = scenario.inertia_matrix
    match scenario.potential:
        case potentials.UniformGravity(mass=mass, gravity=gravity, center_of_mass=center):
            return rigid_body.RigidBody(inertia, rigid_body.UniformGravity(mass, gravity, np.array(center)))
        case potentials.GravityGradient(orbit_rate=rate):
            return rigid_body.RigidBody(inertia, rigid_body.GravityGradient(inertia, rate))


def reference_estimates(scenario, simulated, start, first, mode):
    """The NumPy reference's ellipsoids of the rows from ``first`` on, with ``start`` the one before."""
    log = simulated.measurements
    m = len(log.sensors)
    bounds = np.tile(np.eye(3) * simulated.direction_bound**2, (m, 1, 1))
    rate_bound = np.eye(3) * simulated.rate_bound**2
    body, estimate, estimates = reference_body(scenario), start, []
    for k in range(first, len(log.times)):
        measured = measurement.Measurement(
            log.references[k], log.directions[k], np.ones(m), bounds, log.angular_velocities[k], rate_bound
        )
        cycle = reference_filter.cycle(
            body,
            estimate,
            log.times[k - 1],
            scenario.step,
            scenario.steps_between_measurements,
            measured,
            mode == "first_order",
            scenario.integrator_order,
        )
        estimate = cycle.fusion.ellipsoid
        estimates.append(estimate)
    return estimates


def assert_same(results, rows, estimates):
    for k, expected in zip(rows, estimates, strict=True):
        np.testing.assert_allclose(results.attitudes[k], expected.attitude, atol=MINIMUM)
        np.testing.assert_allclose(results.vectors[k], expected.angular_velocity, atol=MINIMUM)
        np.testing.assert_allclose(results.shapes[k], expected.shape, atol=MINIMUM * np.abs(expected.shape).max())


@pytest.mark.parametrize("mode", ["paper", "first_order"])
def test_from_the_first_measurement_as_the_reference(pendulum, mode):
    scenario, simulated = pendulum
    log = simulated.measurements
    estimated = estimation.estimate(logs.log_of(log), configured(scenario, simulated, estimator={"mode": mode}))
    bounds = np.tile(np.eye(3) * simulated.direction_bound**2, (2, 1, 1))
    rate_bound = np.eye(3) * simulated.rate_bound**2
    first = measurement.Measurement(
        log.references[0], log.directions[0], np.ones(2), bounds, log.angular_velocities[0], rate_bound
    )
    start = measurement.measured_ellipsoid(first)
    assert_same(estimated.result, [0], [start])
    assert estimated.result.used == ["direction1 direction2 rate"] * len(log.times)
    assert_same(estimated.result, range(1, 6), reference_estimates(scenario, simulated, start, 1, mode))


@pytest.mark.parametrize("mode", ["paper", "first_order"])
def test_from_a_given_set_as_the_reference(orbit, mode):
    scenario, simulated = orbit
    estimated = estimation.estimate(
        logs.log_of(simulated.measurements), configured(scenario, simulated, estimator={"mode": mode})
    )
    believed = scenario.estimate0
    start = ellipsoid.StateEllipsoid(np.eye(3), np.array(believed.rate), np.diag(believed.P_diagonal))
    assert_same(estimated.result, [0], [start])
    assert estimated.result.used[0] == ""
    assert np.isnan(estimated.result.shares[0])
    assert_same(estimated.result, range(1, 5), reference_estimates(scenario, simulated, start, 1, mode))


def gyro_log(rng, count=8, noise=1e-3, bound=0.02):
    """Rates that change linearly between samples, and one direction that is missing from every third row."""
    times = np.cumsum(rng.uniform(0.5, 1.5, count))
    rates = 0.1 * rng.standard_normal((count, 3))
    attitudes = [so3.exp(rng.standard_normal(3))]
    for k in range(1, count):
        errors = noise * rng.uniform(-0.5, 0.5, 3)
        turn = (times[k] - times[k - 1]) * (0.5 * (rates[k - 1] + rates[k]) - errors)
        attitudes.append(attitudes[-1] @ so3.exp(turn))
    attitudes = np.array(attitudes)
    directions = np.array([so3.exp(bound * rng.uniform(-0.5, 0.5, 3)) @ c.T @ [0.0, 0.6, 0.8] for c in attitudes])
    directions[::3] = np.nan
    return logs.Log(
        times=times,
        directions=directions[:, None],
        references=np.tile([0.0, 0.6, 0.8], (count, 1, 1)),
        rates=rates,
        true_attitudes=attitudes,
    )


def test_gyro_as_the_reference():
    log = gyro_log(np.random.default_rng(4))
    noise, drift, bound = 0.06, 0.001, 1.2
    shape = np.diag([1e-2, 1e-2, 1e-2, 1e-4, 1e-4, 1e-4])
    quaternion = tables.quaternions_from_attitudes(log.true_attitudes[:1])[0]
    configuration = Configuration.model_validate(
        {
            "flow": {
                "kind": "gyro",
                "columns": ["wx", "wy", "wz"],
                "noise_deg_per_s": noise,
                "drift_deg_per_s2": drift,
            },
            "directions": [{"name": "sun", "columns": list("xyz"), "reference": [0.0, 0.6, 0.8], "bound_deg": bound}],
            "start": {"kind": "given", "attitude_qw_qx_qy_qz": quaternion.tolist(), "P": shape.tolist()},
        }
    )
    results = estimation.estimate(log, configuration).result

    state = gyro.GyroState(so3.rotation_from_quaternion(quaternion), np.zeros(3))
    for k in range(len(log.times)):
        if k > 0:
            h = log.times[k] - log.times[k - 1]
            rate = 0.5 * (log.rates[k - 1] + log.rates[k])
            noise_bound = np.eye(3) * np.deg2rad(noise) ** 2
            drift_bound = np.eye(3) * (h * np.deg2rad(drift)) ** 2
            state, shape = gyro.predict(state, shape, rate[None], h, noise_bound, drift_bound)
        if k % 3:
            predicted = ellipsoid.StateEllipsoid(state.attitude, state.bias, shape)
            body = log.directions[k, 0] / np.linalg.norm(log.directions[k, 0])
            linear = measurement.linear_direction(
                state.attitude, np.array([0.0, 0.6, 0.8]), body, np.eye(3) * np.deg2rad(bound) ** 2
            )
            fused = reference_filter.fuse_linear(predicted, linear, first_order=True).ellipsoid
            state, shape = gyro.GyroState(fused.attitude, fused.angular_velocity), fused.shape
        assert_same(results, [k], [ellipsoid.StateEllipsoid(state.attitude, state.bias, shape)])
        assert results.used[k] == ("sun" if k % 3 else "")
    assert results.vector == "bias"
    # Only attitude is known: its place is in the projection of the set.
    zeta = np.array([so3.log(a.T @ b) for a, b in zip(results.attitudes, log.true_attitudes, strict=True)])
    np.testing.assert_allclose(results.errors[:, :3], zeta, atol=1e-12)
    assert np.isnan(results.errors[:, 3:]).all()
    forms = [z @ np.linalg.solve(p[:3, :3], z) for z, p in zip(zeta, results.shapes, strict=True)]
    np.testing.assert_allclose(results.forms, forms, rtol=1e-9, atol=1e-20)
    assert (results.forms <= 1.0).all()


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_log_from_a_file(tmp_path, pendulum, suffix):
    scenario, simulated = pendulum
    file = tmp_path / f"log.{suffix}"
    simulated.measurements.write(file)
    configuration = configured(scenario, simulated)
    log, expected = logs.read_log(file, configuration), logs.log_of(simulated.measurements)
    for field in dataclasses.fields(logs.Log):
        value = getattr(expected, field.name)
        if field.name in {"rows", "file", "origin", "rests"}:
            continue
        if value is None:
            assert getattr(log, field.name) is None
        else:
            np.testing.assert_allclose(getattr(log, field.name), value, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(log.rows, np.arange(len(log.times)))
    assert log.place(2) == {"csv": f"line 5 ({log.times[2]:.6f} s)", "parquet": f"row 3 ({log.times[2]:.6f} s)"}[suffix]


def test_results_come_back_from_a_file(tmp_path, pendulum):
    scenario, simulated = pendulum
    results = estimation.estimate(logs.log_of(simulated.measurements), configured(scenario, simulated)).result
    results.write(tmp_path / "results.csv")
    again = tables.Result.read(tmp_path / "results.csv")
    np.testing.assert_array_equal(again.shapes, results.shapes)
    np.testing.assert_array_equal(again.forms, results.forms)
    assert list(again.used) == list(results.used)


def own_log(tmp_path, *rows):
    file = tmp_path / "own.csv"
    file.write_text("\n".join(["t,sx,sy,sz,ex,ey,ez,wx,wy,wz", *rows]) + "\n", encoding="utf-8")
    return file


def own_configuration(**changes):
    return Configuration.model_validate(
        {
            "time_column": "t",
            "flow": {"kind": "rigid_body", "inertia_kg_m2": [1.0, 1.0, 1.0], "step_s": 0.1},
            "directions": [
                {"name": "s", "columns": ["sx", "sy", "sz"], "reference_columns": ["ex", "ey", "ez"], "bound_deg": 1.0}
            ],
            "rate": {"columns": ["wx", "wy", "wz"], "unit": "deg/s", "bound_deg_per_s": 1.0},
            "start": {
                "kind": "given",
                "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0],
                "P_diagonal": [0.01, 0.01, 0.01, 0.01, 0.01, 0.01],
            },
        }
        | changes
    )


def test_sensors_that_come_and_go(tmp_path):
    file = own_log(
        tmp_path,
        "0,1,0,0,1,0,0,,,",
        "1,,,,,,,0,0,0",
        "2,,,,,,,,,",
        "3,1,0,0,1,0,0,90,0,0",
    )
    log = logs.read_log(file, own_configuration())
    np.testing.assert_allclose(log.rates[3], [np.pi / 2, 0, 0])
    with pytest.raises(InconsistentMeasurement, match=r"^line 5 \(3\.000000 s\): ") as caught:
        estimation.estimate(log, own_configuration())
    assert caught.value.time == 3.0
    skipping = own_configuration(estimator={"when_sets_do_not_meet": "skip"})
    estimated = estimation.estimate(log, skipping)
    assert estimated.result.used == ["s", "rate", "", ""]
    assert estimated.result.refused == ["", "", "", "s rate"]
    assert estimated.result.errors is None
    summary = estimation.summarize(estimated, skipping)
    assert (summary["rows"], summary["updates"], summary["refused"]) == (4, 2, 1)
    assert summary["compared_with"] is None
    assert "attitude_error_deg" not in summary
    json.dumps(summary, allow_nan=False)


def test_a_direction_needs_its_reference(tmp_path):
    file = own_log(tmp_path, "0,1,0,0,1,0,0,,,", "1,1,0,0,,,,,,")
    with pytest.raises(FileError, match=r"own\.csv: line 3, column 5 \(ex\): empty, but 's' is measured"):
        logs.read_log(file, own_configuration())


def test_a_column_that_is_not_there(tmp_path):
    file = own_log(tmp_path, "0,1,0,0,1,0,0,,,")
    with pytest.raises(FileError, match=r"no column 'true_w'"):
        logs.read_log(file, own_configuration(truth={"attitude_columns": ["true_w", "a", "b", "c"]}))


def test_a_start_that_the_first_rows_do_not_have(pendulum):
    scenario, simulated = pendulum
    log = logs.log_of(simulated.measurements)
    configuration = configured(scenario, simulated)
    directions, rates = log.directions.copy(), log.rates.copy()
    directions[0, 1] = np.nan
    rates[1] = np.nan
    results = estimation.estimate(dataclasses.replace(log, directions=directions, rates=rates), configuration).result
    np.testing.assert_array_equal(results.times, log.times[2:])
    expected = estimation.estimate(log.since(2), configuration).result
    np.testing.assert_array_equal(results.shapes, expected.shapes)
    directions[:, 0] = np.nan
    with pytest.raises(ValueError, match="no row has two directions and the rate"):
        estimation.estimate(dataclasses.replace(log, directions=directions), configuration)


def test_truth_that_may_itself_be_off(pendulum):
    """Against random truths so near to the one that is given."""
    scenario, simulated = pendulum
    log = logs.log_of(simulated.measurements)
    truth = configuration_tables(scenario, simulated)["truth"]
    error = 0.05
    off = configured(scenario, simulated, truth=truth | {"error_deg": np.rad2deg(error)})
    estimated = estimation.estimate(log, off)
    assert estimation.summarize(estimated, off)["compared"] == "attitude"
    rng = np.random.default_rng(4)
    turns = rng.standard_normal((20_000, 3))
    turns *= (error * np.cbrt(rng.random(20_000)) / np.linalg.norm(turns, axis=1))[:, None]
    errors = estimated.result.errors[:, :3]
    for zeta, shape, form in zip(errors, estimated.result.shapes[:, :3, :3], estimated.result.forms, strict=True):
        near = (Rotation.from_rotvec(zeta) * Rotation.from_rotvec(turns)).as_rotvec()
        best = np.einsum("ni,ni->n", near @ np.linalg.inv(shape), near).min()
        assert form >= best * (1.0 - 0.05) - 1e-3
        assert form <= zeta @ np.linalg.solve(shape, zeta)


def test_summary_counts_what_the_table_says(pendulum):
    scenario, simulated = pendulum
    configuration = configured(scenario, simulated)
    estimated = estimation.estimate(logs.log_of(simulated.measurements), configuration)
    summary = json.loads(json.dumps(estimation.summarize(estimated, configuration), allow_nan=False))
    results, log = estimated.result, simulated.measurements
    assert summary["updates"] == 6
    angles = [
        np.degrees(np.linalg.norm(so3.log(a.T @ b))) for a, b in zip(results.attitudes, log.true_attitudes, strict=True)
    ]
    assert summary["attitude_error_deg"]["mean"] == pytest.approx(np.mean(angles))
    assert summary["attitude_error_deg"]["max"] == pytest.approx(np.max(angles))
    assert summary["attitude_error_deg"]["mean_settled"] == pytest.approx(angles[5])
    errors = [
        ellipsoid.state_error(ellipsoid.StateEllipsoid(a, w, p), c, v)
        for a, w, p, c, v in zip(
            results.attitudes,
            results.vectors,
            results.shapes,
            log.true_attitudes,
            log.true_angular_velocities,
            strict=True,
        )
    ]
    np.testing.assert_allclose(results.errors, errors, atol=1e-12)
    inside = [e @ np.linalg.solve(p, e) <= 1 for e, p in zip(errors, results.shapes, strict=True)]
    assert summary["inside_share_of_updates"] == np.mean(inside)
    assert summary["compared"] == "attitude and angular_velocity"


def test_interval_rates():
    samples = np.array([[0.0, 1.0, 2.0], [2.0, 1.0, 0.0], [4.0, 4.0, 4.0]])
    np.testing.assert_array_equal(logs.interval_rates(samples), [[1.0, 1.0, 1.0], [3.0, 2.5, 2.0], [4.0, 4.0, 4.0]])


def test_first_sample_is_another_input():
    log = gyro_log(np.random.default_rng(5))
    rates = {"mean_of_ends": logs.interval_rates(log.rates), "first_sample": log.rates}
    for choice, expected in rates.items():
        flow = {"kind": "gyro", "columns": list("xyz"), "noise_deg_per_s": 0.1, "interval_rate": choice}
        start = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [0.1] * 6}
        configuration = Configuration.model_validate({"flow": flow, "start": start})
        found = estimation.estimate(dataclasses.replace(log, directions=log.directions[:, :0]), configuration).result
        turn = so3.exp((log.times[1] - log.times[0]) * expected[0])
        np.testing.assert_allclose(found.attitudes[1], turn, atol=1e-14)


def test_a_set_that_grows_beyond_all_numbers(orbit):
    scenario, simulated = orbit
    log = logs.log_of(simulated.measurements)
    log = dataclasses.replace(
        log,
        times=log.times.copy(),
        directions=np.full_like(log.directions, np.nan),
        rates=np.full_like(log.rates, np.nan),
    )
    log.times[-1] = 1e4
    with pytest.raises(ValueError, match=r"grown beyond all numbers.* by 10000"):
        estimation.estimate(log, configured(scenario, simulated))
