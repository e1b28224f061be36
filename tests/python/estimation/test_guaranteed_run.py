"""The guaranteed mode of an estimation: containment, claims, what is dropped, tables, real recordings."""

import dataclasses
import importlib.util
import json
from pathlib import Path

import elliptude
import numpy as np
import pytest
import tomlkit
from datasets import FOLDER, broad, needs_datasets, xio
from elliptude import cli, estimation, logs
from elliptude.bounds.gyro import GyroBounds
from elliptude.configuration import Configuration
from elliptude.configuration.rules import hand_held
from elliptude.estimation import containment, guaranteed_result
from elliptude.estimation.direction_rows import direction_rows
from elliptude.io import tables
from elliptude.logs import Log
from elliptude.simulation import fermi
from inputs import turning_body
from reference import so3
from scipy.spatial.transform import Rotation
from test_proposals import made
from typer.testing import CliRunner

GRAVITY = 9.80665
REFERENCES = np.array([[0.0, 0.0, 1.0], [0.0, 0.6, -0.8]])


def gyro_log(
    seed=0, count=400, step=0.05, *, bound=0.02, noise=0.0, bias=0.0, scale=0.0, increment=None, measured=(0, 1)
):
    """A log whose errors use up their bounds: rates constant within intervals, so that nothing happens between samples.

    With an increment the noise alternates so that it integrates to no more.
    """
    draws = np.random.default_rng(seed)
    times = step * np.arange(count)
    true, attitudes = turning_body(draws, times)
    k = scale * Rotation.random(rng=draws).as_matrix()
    axis = so3_unit(draws)
    if increment is None:
        noises = noise * np.array([so3_unit(draws) for _ in times])
    else:
        # In one direction for as long as its integral may grow, then back.
        half = max(int(increment / (noise * step)), 1)
        noises = noise * np.where(np.arange(count) // half % 2, -1.0, 1.0)[:, None] * axis
    rates = true + true @ k.T + bias * axis + noises
    directions = np.full((count, 2, 3), np.nan)
    for i in measured:
        directions[:, i] = [so3.exp(bound * so3_unit(draws)) @ c.T @ REFERENCES[i] for c in attitudes]
    return Log(
        times=times,
        directions=directions,
        references=np.tile(REFERENCES, (count, 1, 1)),
        rates=rates,
        true_attitudes=attitudes,
    )


def so3_unit(draws):
    vector = draws.standard_normal(3)
    return vector / np.linalg.norm(vector)


def configured(flow=None, bound=0.02, **changes):
    sensors = [
        {"name": name, "columns": list(columns), "reference": reference.tolist(), "bound_deg": np.rad2deg(bound)}
        for name, columns, reference in zip(("one", "two"), ("abc", "def"), REFERENCES, strict=True)
    ]
    base = {
        "flow": {"kind": "gyro", "columns": ["x", "y", "z"], "interval_rate": "first_sample"} | (flow or {}),
        "directions": sensors,
        "estimator": {"mode": "guaranteed"},
    }
    return Configuration.model_validate(base | changes)


def with_accelerometer(configuration, **its_bound):
    """The configuration's fields, with an accelerometer as the first sensor."""
    fields = configuration.model_dump(mode="json", exclude_unset=True)
    fields["reference_frame"] = "ENU"
    fields["directions"][0] = {
        "name": "up",
        "kind": "accelerometer",
        "columns": ["a", "b", "c"],
        "unit": "m/s^2",
    } | its_bound
    return fields


def assert_holds(estimated, share=1.0):
    forms = estimated.result.forms
    assert np.isfinite(forms).mean() >= share
    assert np.nanmax(forms) <= 1.0
    return forms


# --- row by row -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("estimate_bias", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_truth_is_inside_where_errors_use_up_their_bounds(seed, estimate_bias):
    noise, bias, scale = 0.01, 0.004, 0.02
    log = gyro_log(seed, noise=noise, bias=bias, scale=scale)
    flow = {
        "noise_deg_per_s": np.rad2deg(noise),
        "bias_deg_per_s": np.rad2deg(bias),
        "scale_error": scale,
        "estimate_bias": estimate_bias,
    }
    estimated = estimation.estimate(log, configured(flow))
    forms = assert_holds(estimated)
    assert (estimated.guaranteed.sets.claims == 0).all()
    assert estimated.guaranteed.sets.prediction_used.mean() > 0.5
    # The same errors, and a bound that leaves them out: the test can fail.
    small = flow | {"noise_deg_per_s": 1e-6, "bias_deg_per_s": 1e-9, "scale_error": 0.0}
    loose = configured(small, estimator={"mode": "guaranteed", "policy": "drop_measurement"})
    wrong = estimation.estimate(log, loose)
    assert np.nanmax(wrong.result.forms) > max(1.0, forms.max())


def test_bias_that_is_not_estimated_makes_sets_smaller():
    log = gyro_log(noise=0.01)
    flow = {"noise_deg_per_s": np.rad2deg(0.01), "bias_deg_per_s": 1e-7}
    without = estimation.estimate(log, configured(flow)).result
    with_bias = estimation.estimate(log, configured(flow | {"estimate_bias": True})).result
    ratio = np.linalg.det(without.shapes[:, :3, :3]) / np.linalg.det(with_bias.shapes[:, :3, :3])
    # The volume of three dimensions in a sum for six is 2^(3/2) times larger where the measurements alone count.
    assert ratio[0] == pytest.approx(0.125, rel=0.05)
    assert ratio.max() < 0.5


def test_bias_that_is_not_estimated_is_not_in_the_results(tmp_path):
    log = gyro_log(noise=0.01)
    log = dataclasses.replace(log, true_vectors=np.full((len(log.times), 3), 1e-3))
    flow = {"noise_deg_per_s": np.rad2deg(0.01), "bias_deg_per_s": 0.2}
    estimated = estimation.estimate(log, configured(flow))
    assert_holds(estimated)
    assert not estimated.vector_is_compared
    assert np.isnan(estimated.result.vectors).all()
    assert np.isnan(estimated.result.half_widths[:, 3:]).all()
    summary = estimation.summarize(estimated, configured(flow))
    assert summary["mean_half_width_gyro_bias_deg_per_s"] is None
    json.dumps(summary, allow_nan=False)
    estimated.result.write(tmp_path / "results.csv")
    back = tables.Result.read(tmp_path / "results.csv")
    np.testing.assert_array_equal(back.shapes, estimated.result.shapes)
    np.testing.assert_array_equal(back.half_widths, estimated.result.half_widths)
    estimated = estimation.estimate(log, configured(flow | {"estimate_bias": True}))
    assert_holds(estimated)
    assert estimated.vector_is_compared


def test_filter_keeps_whether_it_estimates():
    flow = elliptude.GuaranteedGyroFlow(0.01)
    kept = elliptude.GuaranteedFilter(flow, vector_bound=1e-9, estimate_vector=False)
    assert not elliptude.GuaranteedFilter.from_json(kept.to_json()).estimate_vector
    with pytest.raises(ValueError, match="needs vector_bound"):
        elliptude.GuaranteedFilter(flow, estimate_vector=False)
    body = elliptude.GuaranteedRigidBodyFlow(elliptude.RigidBody(np.diag([1.0, 1.0, 1.0])), step=0.1)
    with pytest.raises(TypeError, match="estimate_vector"):
        elliptude.GuaranteedFilter(body, vector_bound=1.0, estimate_vector=False)


def test_reference_and_alignment_errors_add_to_the_bound():
    log = gyro_log(bound=0.05, noise=0.001)
    flow = {"noise_deg_per_s": np.rad2deg(0.001)}
    base = configured(flow, bound=0.02)
    tables = base.model_dump(mode="json", exclude_unset=True)
    for sensor in tables["directions"]:
        sensor |= {"reference_error_deg": np.rad2deg(0.01), "alignment_error_deg": np.rad2deg(0.021)}
    enough = Configuration.model_validate(tables)
    np.testing.assert_allclose(direction_rows(log, enough).angles, 0.051)
    np.testing.assert_allclose(enough.directions[0].bound(), 0.051**2 * np.eye(3))
    assert_holds(estimation.estimate(log, enough))


def test_time_offsets_add_the_turn():
    log = gyro_log(noise=0.001)
    tables = configured({"noise_deg_per_s": np.rad2deg(0.001)}).model_dump(mode="json", exclude_unset=True)
    tables["directions"][0]["time_offset_bound_s"] = 0.01
    tables["flow"]["time_offset_bound_s"] = 0.02
    rows = direction_rows(log, Configuration.model_validate(tables))
    fastest = np.linalg.norm(log.rates, axis=1)
    within = slice(1, -1)  # beyond the first and the last sample nothing is known
    assert (rows.angles[[0, -1]] == np.pi).all()
    assert (rows.angles[within, 0] >= 0.02 + 0.03 * fastest[within]).all()
    assert (rows.angles[within, 0] <= 0.02 + 0.03 * (fastest.max() + 0.002)).all()
    assert (rows.angles[within, 1] >= 0.02 + 0.02 * fastest[within]).all()


# --- anchors ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_increments(seed):
    """One direction after the start: what is known about it is what the gyro keeps."""
    noise, increment = 0.02, 0.01
    log = gyro_log(seed, 600, noise=noise, increment=increment)
    log.directions[1:, 1] = np.nan
    # The rates of the log are constant within intervals; as a mean of ends they come from these samples.
    steps = np.diff(log.times)
    quaternions = Rotation.from_matrix(log.true_attitudes)
    true = (quaternions[:-1].inv() * quaternions[1:]).as_rotvec() / steps[:, None]
    errors = log.rates[:-1] - true
    integrals = np.cumsum(steps[:, None] * errors, axis=0)
    spread = np.linalg.norm(integrals[:, None] - integrals[None], axis=2).max()
    assert spread <= 1.0001 * increment
    mean_of_ends = {"interval_rate": "mean_of_ends", "noise_deg_per_s": np.rad2deg(noise)}
    samples = np.concatenate([log.rates[:1], log.rates])[: len(log.rates)]
    log = dataclasses.replace(log, rates=_samples_whose_means_are(log.rates, samples))
    estimates = {}
    for name, flow in (
        ("linear", {"anchor_s": 10.0}),
        ("increment", {"anchor_s": 10.0, "increment_deg": np.rad2deg(increment)}),
    ):
        configuration = configured(mean_of_ends | flow, estimator={"mode": "guaranteed", "criterion": "trace"})
        estimated = estimation.estimate(log, configuration)
        assert_holds(estimated)
        estimates[name] = estimated.result.largest_angles
    assert estimates["increment"][-1] < 0.5 * estimates["linear"][-1]


def _samples_whose_means_are(interval_rates, guess):
    """Samples with (ω_k + ω_{k+1})/2 as given."""
    samples = guess.copy()
    for k in range(len(samples) - 1):
        samples[k + 1] = 2.0 * interval_rates[k] - samples[k]
    return samples


def test_a_turn_by_any_angle_is_inside_its_ball():
    """(18.15) to its end: the true turn is as far from the integrated one as it may be, about any axis."""
    draws = np.random.default_rng(5)
    gyro = GyroBounds(noise=0.03)
    times = np.array([0.0, 1.0])
    for _ in range(20):
        rate = 2.0 * so3_unit(draws)
        rows = np.array([rate, rate])
        turns = gyro.anchored_turns(times, rows, 1.0)
        assert turns.angles[1] == pytest.approx(0.03)
        true = Rotation.random(rng=draws).as_matrix()
        after = true @ so3.exp(rate) @ so3.exp(turns.angles[1] * so3_unit(draws))
        start = elliptude.StateEllipsoid(true, np.zeros(3), 1e-12 * np.eye(6))
        log = Log(
            times=times,
            directions=np.full((2, 2, 3), np.nan),
            references=np.tile(REFERENCES, (2, 1, 1)),
            rates=rows,
            true_attitudes=np.array([true, after]),
        )
        quaternion = tables.quaternions_from_attitudes(start.attitude[None])[0]
        given = {"kind": "given", "attitude_qw_qx_qy_qz": quaternion.tolist(), "P_diagonal": [1e-12] * 6}
        flow = {"noise_deg_per_s": np.rad2deg(0.03), "anchor_s": 1.0, "interval_rate": "mean_of_ends"}
        estimated = estimation.estimate(log, configured(flow, start=given))
        assert 0.9 < estimated.result.forms[1] <= 1.0


# --- contradictions ---------------------------------------------------------------------------------------------------


def test_what_contradicts_its_own_bound_takes_the_claim_away():
    log = gyro_log(noise=0.001)
    forces = GRAVITY * log.directions[:, 0]
    forces[100] *= 1.5
    log.directions[:, 0] = forces
    base = with_accelerometer(
        configured({"noise_deg_per_s": np.rad2deg(0.001)}),
        bound_from={"kind": "acceleration", "acceleration_m_per_s2": 1.0},
    )
    dropping = base | {"estimator": {"mode": "guaranteed", "policy": "drop_measurement"}}
    estimated = estimation.estimate(log, Configuration.model_validate(dropping))
    assert_holds(estimated)
    assert set(estimated.result.claims) == {"conditional"}
    (found,) = estimated.guaranteed.contradictions
    assert (found.row, found.sensor, found.unit) == (100, "up", "m/s^2")
    assert found.excess == pytest.approx(0.5 * GRAVITY - 1.0, abs=1e-6)
    assert estimated.result.used[100] == "two"
    columns = guaranteed_result.dropped_columns(estimated.guaranteed)
    assert columns["sensor"] == ["up"]
    assert columns["contradicts"] == ["own_bound"]
    assert columns["margin"][0] == pytest.approx(-found.excess)
    with pytest.raises(
        elliptude.InconsistentMeasurement, match=r"^5\.000000 s: 'up' contradicts its own bounds by 3\.9"
    ):
        estimation.estimate(log, Configuration.model_validate(base))


def test_tilt_bounds_hold_and_use_the_measured_up():
    log = gyro_log(noise=0.01, bound=0.1)
    log.directions[:, 0] *= GRAVITY
    base = with_accelerometer(configured({"noise_deg_per_s": np.rad2deg(0.01)}, bound=0.1), bound_deg=np.rad2deg(0.1))
    estimated = estimation.estimate(log, Configuration.model_validate(base))
    cosines = np.einsum("ni,ni->n", estimated.result.attitudes[:, 2], log.true_attitudes[:, 2])
    tilts = np.arccos(np.clip(cosines, -1.0, 1.0))
    bounds = estimated.result.tilt_bounds
    assert (tilts <= bounds).all()
    reference_widths = estimated.guaranteed.sets.extents().half_widths_reference[:, :2]
    assert (bounds <= 1.0001 * np.linalg.norm(reference_widths, axis=1)).all()
    assert bounds.max() < 0.25


@pytest.mark.parametrize("policy", ["drop_measurement", "restart"])
def test_dropped_measurements_are_listed(policy):
    log = gyro_log(noise=0.001)
    log.directions[200, 1] = so3.exp(np.array([0.5, 0.0, 0.0])) @ log.directions[200, 1]
    flow = {"noise_deg_per_s": np.rad2deg(0.001)}
    estimated = estimation.estimate(log, configured(flow, estimator={"mode": "guaranteed", "policy": policy}))
    assert_holds(estimated)
    assert estimated.result.dropped[200] != ""
    assert estimated.result.claims[199] == "unconditional"
    assert estimated.result.claims[200] == "conditional"
    columns = guaranteed_result.dropped_columns(estimated.guaranteed)
    counts = guaranteed_result.summarize(estimated.guaranteed, configured(flow))["dropped_by_sensor"]
    assert counts == {name: list(columns["sensor"]).count(name) for name in set(columns["sensor"])}
    assert columns["time_s"][0] == pytest.approx(10.0)
    assert columns["contradicts"][0] == "prediction"
    with pytest.raises(elliptude.InconsistentMeasurement, match=r"10\.000000 s: the measurement of two"):
        estimation.estimate(log, configured(flow))
    anchored = configured(
        flow | {"anchor_s": 1.0, "interval_rate": "mean_of_ends", "noise_deg_per_s": 3.0},
        estimator={"mode": "guaranteed", "policy": policy},
    )
    results = estimation.estimate(log, anchored).result
    assert results.dropped[200] != ""
    # The row is an anchor, and those that are reached from it rest on the same.
    assert results.claims[199] == "unconditional"
    assert set(results.claims[200:220]) == {"conditional"}


# --- truth that is itself uncertain -----------------------------------------------------------------------------------


def test_least_forms():
    draws = np.random.default_rng(7)
    factors = draws.standard_normal((30, 3, 3))
    shapes = factors @ factors.transpose(0, 2, 1) + 0.01 * np.eye(3)
    offsets = 3.0 * draws.standard_normal((30, 3))
    radius = 0.7
    found = containment.least_forms(offsets, shapes, radius)
    trials = draws.standard_normal((200_000, 3))
    trials *= (radius * np.cbrt(draws.random(200_000)) / np.linalg.norm(trials, axis=1))[:, None]
    for offset, shape, form in zip(offsets, shapes, found, strict=True):
        left = offset - trials
        best = np.einsum("ni,ni->n", left @ np.linalg.inv(shape), left).min()
        assert form <= best * (1.0 + 1e-9)
        assert form >= best * 0.9 - 1e-3
    np.testing.assert_array_equal(containment.least_forms(offsets[:1] * 1e-3, shapes[:1], radius), 0.0)


# --- a rule -----------------------------------------------------------------------------------------------------------


def ruled(**changes):
    return {
        "time_column": "t",
        "rule": {"kind": "hand_held", "anchor_s": 4.0},
        "flow": {"kind": "gyro", "columns": [f"gyr[{i}]" for i in range(3)], "unit": "rad/s"},
        "directions": [
            {
                "name": "up",
                "kind": "accelerometer",
                "columns": [f"acc[{i}]" for i in range(3)],
                "unit": "m/s^2",
            },
            {"name": "field", "kind": "magnetometer", "columns": [f"mag[{i}]" for i in range(3)], "unit": "uT"},
        ],
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
        "truth": {"attitude_columns": [f"q_ref[{i}]" for i in range(4)]},
    } | changes


def recording(folder, **changes):
    made_up = made(field_late=0.012)
    arrays = {
        "t": made_up.times,
        "gyr": made_up.angular_velocities,
        "acc": made_up.specific_forces,
        "mag": made_up.fields,
        "q_ref": made_up.attitudes,
    } | changes
    path = folder / "log.npz"
    np.savez(path, **arrays)
    return path


def estimated_by_rule(path, **changes):
    configuration = Configuration.model_validate(ruled(**changes))
    log = logs.read_log(path, configuration)
    return estimation.estimate(log, configuration), configuration


@pytest.mark.parametrize("rule", [{"kind": "hand_held", "anchor_s": 4.0}, {"kind": "hand_held"}])
def test_rule(tmp_path, rule):
    estimated, configuration = estimated_by_rule(recording(tmp_path), rule=rule)
    assert_holds(estimated, 0.98)
    summary = estimation.summarize(estimated, configuration)
    assert summary["claim_share_of_rows"]["unconditional"] > 0.98
    assert summary["inside_share_of_unconditional_rows"] == 1.0
    assert summary["sizes"]["at_rest"]["tilt_bound_deg"]["mean"] < 5.0
    assert 0.2 < guaranteed_result.resting_rows(estimated.guaranteed.log, configuration).mean() < 0.25
    json.dumps(summary, allow_nan=False)


def test_without_a_heading_it_counts_from_the_first_row(tmp_path):
    path = recording(tmp_path)
    configuration = Configuration.model_validate(ruled(directions=ruled()["directions"][:1]))
    estimated = estimation.estimate(logs.read_log(path, configuration), configuration)
    assert estimated.guaranteed.starts_heading
    assert_holds(estimated, 0.5)
    assert estimated.result.claims[0] == "unconditional"
    # A magnet: the field is void for the whole recording, and no claim is unconditional any more.
    made_up = made(field_late=0.012)
    fields = made_up.fields.copy()
    fields[4000:4400] *= 1.6
    estimated, configuration = estimated_by_rule(recording(tmp_path, mag=fields))
    assert estimated.guaranteed.starts_heading
    assert set(estimated.guaranteed.rows.void) == {"field", "east"}
    assert "unconditional" not in estimated.result.claims
    assert_holds(estimated, 0.5)
    summary = estimation.summarize(estimated, configuration)
    assert summary["contradicted_rows"]["field"] >= 200
    assert summary["heading"] == "from the first row"


def test_rule_in_a_file_or_stated(tmp_path):
    path = recording(tmp_path)
    rule = ruled()["rule"] | elliptude_rule()
    stated, _ = estimated_by_rule(path, rule=rule | {"kind": "stated"})
    expected, _ = estimated_by_rule(path)
    np.testing.assert_array_equal(stated.result.shapes, expected.result.shapes)


def elliptude_rule():
    return hand_held().model_dump(mode="json", exclude_none=True)


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_command(tmp_path, suffix):
    made_up = made(field_late=0.012)
    fields = made_up.fields.copy()
    fields[4000:4400] *= 1.6
    path = recording(tmp_path, mag=fields)
    (tmp_path / "rule.toml").write_text(tomlkit.dumps(elliptude_rule()))
    (tmp_path / "config.toml").write_text(
        tomlkit.dumps(ruled(rule={"kind": "file", "file": "rule.toml", "anchor_s": 4.0}))
    )
    out = tmp_path / "out"
    done = run("estimate", path, "--config", tmp_path / "config.toml", "--out", out, "--format", suffix)
    assert done.exit_code == 0, done.output
    assert "the guarantee is unconditional 0 %" in done.output
    assert "rows contradict its stated bounds; left out for the whole recording" in done.output
    assert {file.name for file in out.iterdir()} == {
        f"results.{suffix}",
        "dropped.csv",
        "measured.csv",
        "estimate.png",
        "summary.json",
    }
    results = tables.Result.read(out / f"results.{suffix}")
    assert set(results.claims) <= {"conditional", "none"}
    lost = np.array(results.claims) == "none"
    assert (np.isnan(results.quaternions[:, 0]) == lost).all()
    assert (np.isnan(results.shapes[:, 0, 0]) == lost).all()
    assert np.isfinite(results.tilt_bounds[~lost]).all()
    lines = (out / "dropped.csv").read_text().splitlines()
    assert lines[0] == "# elliptude dropped 1"
    assert lines[1] == "time_s,place,sensor,contradicts,margin,unit"
    assert lines[2].split(",")[2:4] == ["field", "own_bound"]
    assert len(lines) == 2 + sum(json.loads((out / "summary.json").read_text())["contradicted_rows"].values())
    done = run("estimate", path, "--config", tmp_path / "config.toml", "--out", out)
    assert done.exit_code == 1
    assert "--force" in done.output


def test_compare_and_report_read_the_table(tmp_path):
    wrong = made(field_late=0.012).attitudes.copy()
    turned = Rotation.from_euler("z", 2.5) * Rotation.from_quat(wrong[2000:2500], scalar_first=True)
    wrong[2000:2500] = turned.as_quat(scalar_first=True)
    path = recording(tmp_path, q_ref=wrong)
    (tmp_path / "config.toml").write_text(tomlkit.dumps(ruled()))
    out = tmp_path / "out"
    assert run("estimate", path, "--config", tmp_path / "config.toml", "--out", out).exit_code == 0
    results = tables.Result.read(out / "results.csv")
    assert results.chart == "gibbs"
    known = np.isfinite(results.forms)
    assert 0.0 < np.mean(results.forms[known] <= 1.0) < 1.0
    done = run("compare", out, path, "--config", tmp_path / "config.toml", "--json")
    assert done.exit_code == 1  # the reference is wrong
    figures = json.loads(done.stdout)["by_claim"]["unconditional"]
    chosen = known & (np.array(results.claims) == "unconditional")
    assert figures["inside"] == (results.forms[chosen] <= 1.0).sum()
    assert figures["compared"] == chosen.sum()
    widths = np.rad2deg(results.half_widths[chosen, :3])
    np.testing.assert_allclose(figures["half_width_body_deg"]["max"], widths.max(axis=0), rtol=1e-9)
    assert widths.max() < 180.0
    done = run("report", out, "--out", tmp_path / "report.html")
    assert done.exit_code == 0, done.output
    assert f"outside the set at {(results.forms[known] > 1.0).sum()} of {known.sum()} rows" in done.output


RELAXED = {"mode": "guaranteed", "policy": "relaxed", "most_wrong": 1}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"estimator": {"mode": "first_order"}}, "rule needs estimator.mode = 'guaranteed'"),
        ({"reference_frame": "NED"}, "reference_frame: a rule's is ENU"),
        (
            {"start": {"kind": "given", "attitude_qw_qx_qy_qz": [1, 0, 0, 0.0], "P_diagonal": [1.0] * 6}},
            "start: a rule",
        ),
        ({"directions": ruled()["directions"][1:]}, "one accelerometer"),
        ({"directions": [ruled()["directions"][0] | {"bound_deg": 3.0}]}, "directions[0].bound_deg: is for the rule"),
        ({"flow": ruled()["flow"] | {"noise_deg_per_s": 3.0}}, "flow.noise_deg_per_s: is for the rule"),
        ({"estimator": {"mode": "guaranteed", "when_sets_do_not_meet": "skip"}}, "when_sets_do_not_meet is not of"),
        ({"rule": {"kind": "hand_held"}, "estimator": {"policy": "restart"}}, "policy needs mode = 'guaranteed'"),
        ({"estimator": {"mode": "guaranteed", "most_wrong": 1}}, "most_wrong"),
        # One of two sensors is left, from which no attitude begins; nor does a start from the other one hold.
        ({"estimator": RELAXED}, "estimator.policy: 'relaxed' is not for a rule"),
        ({"estimator": RELAXED, "directions": ruled()["directions"][:1]}, "'relaxed' is not for a rule"),
        ({"estimator": RELAXED | {"most_wrong": 2}, "rule": {"kind": "hand_held"}}, "'relaxed' is not for a rule"),
    ],
)
def test_what_does_not_go_together(changes, message):
    with pytest.raises(ValueError, match="validation error") as caught:
        Configuration.model_validate(ruled(**changes))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("flow", "message"),
    [
        ({"noise_deg_per_s": 1.0, "increment_deg": 1.0}, "increment_deg needs anchor_s"),
        ({"noise_deg_per_s": 1.0, "anchor_s": 1.0}, "interval_rate = 'mean_of_ends'"),
        ({"noise_deg_per_s": 1.0, "estimate_bias": True}, "estimate_bias needs bias_deg_per_s"),
        ({}, "flow.noise_deg_per_s: missing"),
    ],
)
def test_flows_that_lack_something(flow, message):
    with pytest.raises(ValueError, match=message):
        configured(flow)


# --- real recordings --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real_recordings():
    path = Path(__file__).parents[3] / "benchmarks" / "real_recordings.py"
    spec = importlib.util.spec_from_file_location("real_recordings", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@needs_datasets
@pytest.mark.parametrize("trial", ["02", "05", "07", "24", "30"])
def test_broad(real_recordings, trial):
    assert broad(trial).exists()
    estimated = real_recordings.broad(FOLDER / "broad", trial)
    summary = estimation.summarize(estimated, real_recordings.broad_configuration())
    assert summary["inside_share_of_unconditional_rows"] >= 0.999
    if trial in {"02", "05"}:
        assert summary["claim_share_of_rows"]["unconditional"] >= 0.8
        assert summary["compared_unconditional_rows"] > 0.8 * summary["rows"]
    at_rest = summary["sizes"]["at_rest"]
    assert max(at_rest["half_width_reference_deg"]["mean"][:2]) <= 5.0
    assert at_rest["tilt_bound_deg"]["mean"] <= min(at_rest["half_width_reference_deg"]["mean"][:2])


@needs_datasets
def test_fermi_for_four_hours(real_recordings):
    (path,) = (FOLDER / "fermi-gbm-poshist").glob("*.csv.gz")
    log, sun = real_recordings.fermi_log(path)
    widths = []
    for increment in (None, real_recordings.FERMI_INCREMENT_DEG):
        estimated = estimation.estimate(log, real_recordings.fermi_configuration(increment))
        assert np.nanmax(estimated.result.forms) <= 1.0
        assert np.isfinite(estimated.result.forms).all()
        widths.append(fermi.half_widths_about(estimated.result, sun)[0].mean())
    assert widths[1] <= widths[0] / 3.0


@needs_datasets
def test_a_users_csv(tmp_path):
    """Its magnetometer contradicts the rule: attitude from the rest at the start, with a conditional claim.

    Ten times two samples are lost, in each of which a hand may turn by 60°: the heading is lost at the third of them.
    """
    columns = {
        "flow": ("Gyroscope", "deg/s", "deg/s"),
        "up": ("Accelerometer", "g", "g"),
        "field": ("Magnetometer", "uT", "uT"),
    }
    names = {key: [f"{name} {axis} ({unit})" for axis in "XYZ"] for key, (name, unit, _) in columns.items()}
    config = ruled(time_column="Time (s)")
    del config["truth"]
    config["flow"] |= {"columns": names["flow"], "unit": "deg/s"}
    for sensor in config["directions"]:
        sensor |= {"columns": names[sensor["name"]], "unit": columns[sensor["name"]][2]}
    (tmp_path / "config.toml").write_text(tomlkit.dumps(config))
    done = run("estimate", xio(), "--config", tmp_path / "config.toml", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["contradicted_rows"]["field"] == 11
    assert summary["claim_share_of_rows"]["unconditional"] == 0.0
    found = summary["gaps"]
    assert found["count"] == 10
    assert [one["rows_without_set"] for one in found["listed"]][:2] == [0, 0]
    third = found["listed"][2]["time_s"]
    results = tables.Result.read(tmp_path / "out" / "results.csv")
    assert (np.array(results.claims)[results.times <= third] == "conditional").all()
