"""Gaps in the gyro: what its bounds do not speak of is bounded by the largest rate, or forgotten, and said."""

import dataclasses
import importlib.util
import json
from pathlib import Path

import elliptude
import numpy as np
import pytest
import tomlkit
from elliptude import estimation, logs
from elliptude.bounds.gyro import GyroBounds, covered_interval
from elliptude.bounds.stamps import time_offset_angles
from elliptude.configuration import Configuration
from elliptude.configuration.rules import apply_rule, hand_held
from elliptude.estimation import gaps
from elliptude.logs import Log
from elliptude.proposal import proposals
from elliptude.report.estimated.reading import read_run
from reference import so3
from scipy.spatial.transform import Rotation
from test_guaranteed_run import configured, gyro_log, run, so3_unit
from test_proposals import made


@pytest.fixture(scope="module")
def simulation():
    path = Path(__file__).parents[3] / "benchmarks" / "gaps.py"
    spec = importlib.util.spec_from_file_location("gaps_benchmark", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def without(log, *spans):
    """The log without the rows inside these spans, s."""
    keep = np.ones(len(log.times), dtype=bool)
    for begin, end in spans:
        keep &= (log.times <= begin) | (log.times >= end)
    arrays = {name: getattr(log, name) for name in ("times", "directions", "references", "rates", "true_attitudes")}
    return dataclasses.replace(log, **{name: values[keep] for name, values in arrays.items()})


def outside(estimated):
    claims = np.array(estimated.result.claims)
    return int(((claims == "unconditional") & (estimated.result.forms > 1.0)).sum())


# --- what a user does -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("knows_motion", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_bounds_then_estimate(simulation, tmp_path, seed, knows_motion):
    """As the campaign of benchmarks/gaps.py does at length."""
    found = simulation.attempt(seed, tmp_path, knows_motion=knows_motion)
    assert found["outside"] == 0
    assert found["unconditional"] + found["none"] > 0.9 * found["rows"]


@pytest.mark.parametrize("spans", [[(10.0, 1.9)], [(5.0 + 5.0 * k, 0.12 * 2.0**k) for k in range(6)]])
def test_commands(simulation, tmp_path, spans):
    simulated = simulation.simulate(3, spans)
    path = tmp_path / "log.npz"
    simulation.write(simulated, path)
    (tmp_path / "map.toml").write_text(tomlkit.dumps(simulation.tables(simulated)))
    config, out = tmp_path / "config.toml", tmp_path / "out"
    done = run("bounds", path, tmp_path / "map.toml", "--out", config)
    assert done.exit_code == 0, done.output
    text = config.read_text()
    assert "longest_interval_s = 0.015 # no guarantee: 1.5 times the usual interval" in text
    assert "largest_rate_deg_per_s = 2000.0 # no guarantee: " in text
    done = run("estimate", path, "--config", config, "--out", out, "--report", tmp_path / "report.html")
    assert done.exit_code == 0, done.output
    assert f"{len(spans)} gap" in done.output
    summary = json.loads((out / "summary.json").read_text())["gaps"]
    assert summary["count"] == len(spans)
    assert [round(one["time_s"]) for one in summary["listed"]] == [round(begin) for begin, _ in spans]
    # From the last sample before to the first one after.
    lengths = [one["duration_s"] for one in summary["listed"]]
    np.testing.assert_allclose(lengths, [length + 0.01 for _, length in spans], atol=0.011)
    assert all(line in done.output for line in summary["said"])
    assert summary["forgotten"] == len(spans)
    (found, _) = read_run(out)
    assert list(found.gaps) == summary["said"]
    assert "gaps in the gyro" in (tmp_path / "report.html").read_text()
    configuration = Configuration.model_validate(tomlkit.parse(text).unwrap())
    estimated = estimation.estimate(logs.read_log(path, configuration), configuration)
    forms = simulation.forms(estimated, simulated)
    unconditional = np.array(estimated.result.claims) == "unconditional"
    assert not (forms[unconditional] > 1.0).any()
    assert unconditional.mean() > 0.3


# --- paths through the filter -----------------------------------------------------------------------------------------

FLOWS = {
    "row by row": {},
    "bias estimated": {"bias_deg_per_s": 0.1, "estimate_bias": True},
    "mean of ends": {"interval_rate": "mean_of_ends", "noise_deg_per_s": 3.0},
    "anchors": {"interval_rate": "mean_of_ends", "noise_deg_per_s": 3.0, "anchor_s": 2.0},
}


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("stated", [{}, {"largest_rate_deg_per_s": 60.0}])
def test_a_gap_is_no_straight_line(flow, stated):
    """Rates of up to 50 °/s that come back to what they were in a gap: a straight line would be 40° off."""
    log = gyro_log(4, 160, noise=0.001)
    log.directions[1:, 1] = np.nan  # one direction alone: what is known of the heading is what the gyro keeps
    flow = {"noise_deg_per_s": np.rad2deg(0.001)} | FLOWS[flow] | stated
    whole = estimation.estimate(log, configured(flow, estimator={"mode": "guaranteed", "criterion": "trace"}))
    assert outside(whole) == 0
    assert np.array_equal(np.isfinite(whole.result.forms), np.ones(160, bool))
    assert whole.guaranteed.gaps == ()
    log = without(log, (3.0, 4.2), (6.0, 6.4))
    estimated = estimation.estimate(log, configured(flow, estimator={"mode": "guaranteed", "criterion": "trace"}))
    assert outside(estimated) == 0
    first, second = estimated.guaranteed.gaps
    assert (first.time, first.duration) == (pytest.approx(3.0), pytest.approx(1.2))
    np.testing.assert_allclose(estimated.result.shapes[:61], whole.result.shapes[:61], rtol=1e-9, atol=1e-15)
    if stated:
        assert first.turn == pytest.approx(np.deg2rad(72.0))
        assert first.rows_without_set == second.rows_without_set == 0
        assert first.after > first.before + 0.8 * first.turn
        assert (np.array(estimated.result.claims) == "unconditional").all()
    else:
        assert first.turn == np.pi
        assert first.rows_without_set == len(log.times) - 61
        assert second.rows_without_set == 0
        assert np.isnan(second.before)
        assert set(estimated.result.claims[61:]) == {"none"}
    if flow["noise_deg_per_s"] < 1.0:
        # What was done before: a line through the gap, which the direction contradicts.
        line = configured(flow | {"longest_interval_s": 10.0}, estimator={"mode": "guaranteed", "criterion": "trace"})
        with pytest.raises(elliptude.InconsistentMeasurement):
            estimation.estimate(log, line)


def test_a_turn_at_the_largest_rate_is_on_the_edge():
    draws = np.random.default_rng(5)
    times = np.array([0.0, 0.01, 0.02, 0.52])
    for anchors in ({}, {"anchor_s": 1.0}):
        worst = 0.0
        for _ in range(10):
            start = Rotation.random(rng=draws).as_matrix()
            turned = start @ so3.exp(0.5 * 2.0 * so3_unit(draws))
            log = Log(
                times=times,
                directions=np.full((4, 2, 3), np.nan),
                references=np.tile(np.eye(3)[:2], (4, 1, 1)),
                rates=np.zeros((4, 3)),
                true_attitudes=np.array([start, start, start, turned]),
            )
            quaternion = Rotation.from_matrix(start).as_quat(scalar_first=True).tolist()
            given = {"kind": "given", "attitude_qw_qx_qy_qz": quaternion, "P_diagonal": [1e-12] * 6}
            flow = {"noise_deg_per_s": 1e-6, "interval_rate": "mean_of_ends"} | anchors
            configuration = configured(flow | {"largest_rate_deg_per_s": np.rad2deg(2.0)}, start=given)
            estimated = estimation.estimate(log, configuration)
            assert np.nanmax(estimated.result.forms) <= 1.0
            worst = max(worst, estimated.result.forms[3])
        assert worst > 0.99


def test_a_gyro_with_stamps_of_its_own_loses_samples(tmp_path):
    """The other sensors' rows go on in the gap; between its samples the rate would be on a line."""
    times = np.arange(0.0, 10.0, 0.02)
    angle = 0.8 / 3.0 * (1.0 - np.cos(3.0 * times))
    turns = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0])
    gyro_times = times + 0.005
    keep = (gyro_times < 3.0) | (gyro_times > 4.9)
    gyro = np.column_stack([0.0 * times, 0.0 * times, 0.8 * np.sin(3.0 * gyro_times)])
    arrays = {"t": times, "one": turns.inv().apply([1.0, 0.0, 0.0]), "tg": gyro_times[keep], "g": gyro[keep]}
    np.savez(tmp_path / "log.npz", **arrays, q=turns.as_quat(scalar_first=True))
    given = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1e-6] * 6}
    flow = {"columns": [f"g[{i}]" for i in range(3)], "noise_deg_per_s": 0.5, "time_column": "tg", "time_unit": "s"}
    sensor = {"name": "one", "columns": [f"one[{i}]" for i in range(3)], "reference": [1.0, 0.0, 0.0]}
    base = {
        "time_column": "t",
        "flow": {"kind": "gyro"} | flow,
        "directions": [sensor | {"bound_deg": 120.0}],
        "start": given,
        "estimator": {"mode": "guaranteed"},
        "truth": {"attitude_columns": [f"q[{i}]" for i in range(4)]},
    }
    for more in ({}, {"largest_rate_deg_per_s": 50.0}, {"anchor_s": 1.0, "largest_rate_deg_per_s": 50.0}):
        configuration = Configuration.model_validate(base | {"flow": base["flow"] | more})
        log = logs.read_log(tmp_path / "log.npz", configuration)
        assert len(log.gyro_times) == keep.sum()
        estimated = estimation.estimate(log, configuration)
        assert outside(estimated) == 0
        (gap,) = estimated.guaranteed.gaps
        assert (gap.time, gap.duration) == (pytest.approx(2.985), pytest.approx(1.92))
        claims = np.array(estimated.result.claims)
        assert (claims[log.times < 2.9] == "unconditional").all()
        assert ((claims[log.times > 4.9] == "unconditional").any()) == bool(more)
    # The line: what was done before.
    line = Configuration.model_validate(base | {"flow": base["flow"] | {"longest_interval_s": 10.0}})
    assert outside(estimation.estimate(log, line)) > 50


def test_rates_filled_in_between_samples_may_be_off_by_the_angular_acceleration():
    """A rate that turns back between two samples, in rows of another sensor: at its samples nothing is to be seen."""
    acceleration, period = 2.0, 0.4
    samples = period * np.arange(20)
    times = np.unique(np.round(np.concatenate([samples, np.arange(0.0, 7.6, 0.1)]), 9))
    fine = np.arange(0.0, 7.6 + 1e-9, 1e-3)
    phase = np.mod(fine, period)
    rate = acceleration * np.minimum(phase, period - phase)
    angle = np.concatenate([[0.0], np.cumsum(0.5e-3 * (rate[1:] + rate[:-1]))])
    true = Rotation.from_rotvec(np.interp(times, fine, angle)[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    log = Log(
        times=times,
        directions=np.full((len(times), 2, 3), np.nan),
        references=np.tile(np.eye(3)[:2], (len(times), 1, 1)),
        rates=np.zeros((len(times), 3)),
        gyro_times=samples,
        true_attitudes=true,
    )
    given = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1e-10] * 6}
    for interval_rate in ("mean_of_ends", "first_sample"):
        flow = {"noise_deg_per_s": 1e-6, "interval_rate": interval_rate}
        flow |= {"angular_acceleration_deg_per_s2": np.rad2deg(acceleration)}
        estimated = estimation.estimate(log, configured(flow, start=given))
        assert estimated.guaranteed.gaps == ()
        known = np.isfinite(estimated.result.forms)
        assert known.sum() > 8
        assert (estimated.result.forms[known] <= 1.0).all()
        # Without what is filled in the rows are the samples, and the bound is as it was.
        bare = dataclasses.replace(log, gyro_times=None)
        assert np.nanmax(estimation.estimate(bare, configured(flow, start=given)).result.forms[1:6]) > 1.0


def test_rates_filled_in_between_samples_are_of_a_bias_that_has_drifted_since():
    """The body rests, and the bias that is estimated rises and falls between two samples: they show nothing of it."""
    drift, period = 0.1, 0.4
    samples = period * np.arange(20)
    times = np.unique(np.round(np.concatenate([samples, np.arange(0.0, 7.6, 0.1)]), 9))
    phase = np.mod(times + 1e-9, period)
    biases = np.outer(0.999 * drift * np.minimum(phase, period - phase), [1.0, 0.0, 0.0])
    log = Log(
        times=times,
        directions=np.full((len(times), 2, 3), np.nan),
        references=np.tile(np.eye(3)[:2], (len(times), 1, 1)),
        rates=np.zeros((len(times), 3)),
        gyro_times=samples,
        true_attitudes=np.tile(np.eye(3), (len(times), 1, 1)),
        true_vectors=biases,
    )
    given = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1e-10] * 6}
    for interval_rate in ("mean_of_ends", "first_sample"):
        flow = {"noise_deg_per_s": 1e-6, "interval_rate": interval_rate, "estimate_bias": True, "bias_deg_per_s": 0.01}
        flow |= {"drift_deg_per_s2": np.rad2deg(drift)}
        estimated = estimation.estimate(log, configured(flow, start=given))
        forms = estimated.guaranteed.sets.forms(log.true_attitudes, log.true_vectors)
        assert np.isfinite(forms).sum() > 8
        assert np.nanmax(forms) <= 1.0
        # A bias that is left to its bound is in it at every time, and needs no more.
        bounded = estimation.estimate(log, configured(flow | {"estimate_bias": False}, start=given))
        noise = np.linalg.eigvalsh(bounded.guaranteed.given.flow.noise)[-1]
        assert np.sqrt(noise) == pytest.approx(np.deg2rad(0.010001) + drift * 7.6)


# --- the bounds -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", ["s", "ms", "us"])
@pytest.mark.parametrize("since", [0, 1_700_000_000])
def test_an_interval_as_long_as_the_longest_is_no_gap(unit, since):
    """Stamps as a file has them; their differences are rounded."""
    to_seconds = {"s": lambda us: us / 1e6, "ms": lambda us: (us // 1000) * 1e-3, "us": lambda us: us * 1e-6}[unit]
    times = to_seconds(since * 10**6 + np.cumsum([4000, *([10_000] * 40 + [15_000]) * 20]))
    steps = np.diff(times)
    assert (steps > 0.015).any()
    gyro = GyroBounds(0.1, longest_interval=covered_interval(times, 0.015))
    assert not gyro.gaps(times, np.zeros((len(times), 3))).any()
    # As the core sees them: one prediction after the other.
    assert (steps <= gyro.longest_interval).all()
    # A sample that is late by what a clock can say is a gap.
    late = times.copy()
    late[-1] += max(1e-7, 8.0 * np.spacing(times[-1]))
    assert gyro.gaps(late, np.zeros((len(times), 3))).sum() == 1
    # Without a statement, too, and if most steps are that long.
    unstated = GyroBounds(0.1, longest_interval=covered_interval(times, None))
    assert not unstated.gaps(times, np.zeros((len(times), 3))).any()
    even = to_seconds(since * 10**6 + 15_000 * np.arange(100))
    assert covered_interval(even, 0.015) >= np.diff(even).max()


def test_estimate_counts_no_gap_for_intervals_of_the_longest_length(tmp_path):
    log = gyro_log()
    step = float(np.median(np.diff(log.times)))
    thinned = np.ones(len(log.times), dtype=bool)
    thinned[3::7] = False
    arrays = ("times", "directions", "references", "rates", "true_attitudes")
    log = dataclasses.replace(log, **{name: getattr(log, name)[thinned] for name in arrays})
    longest = round(2.0 * step, 9)
    assert (np.diff(log.times) > longest).any()
    flow = {"noise_deg_per_s": 1.0, "longest_interval_s": longest}
    estimated = estimation.estimate(log, configured(flow))
    assert estimation.summarize(estimated, configured(flow))["gaps"]["count"] == 0
    assert estimation.summarize(estimated, configured(flow))["gaps"]["longest_interval_s"] == longest


def test_rows_without_a_set_to_the_end_are_not_until_there_is_one_again():
    log = gyro_log(4, 160, noise=0.001)
    log.directions[1:, 1] = np.nan
    log, configuration = without(log, (3.0, 4.2)), configured({"noise_deg_per_s": np.rad2deg(0.001)})
    estimated = estimation.estimate(log, configuration)
    (gap,) = estimated.guaranteed.gaps
    assert gap.is_for_good
    summary = gaps.summarize(estimated.guaranteed.gaps, estimated.guaranteed.rows.gyro)
    assert summary["set_again"] is summary["listed"][0]["set_again"] is False
    rows = len(log.times) - 61
    assert summary["said"][0].endswith(f"{rows} rows in all without a set; there is none again to the end")
    assert summary["said"][1].endswith(f"attitude forgotten, {rows} rows without a set; there is none again to the end")


def test_the_longest_interval():
    times = np.cumsum([0.0] + [0.01] * 9 + [0.3])
    assert covered_interval(times, None) == pytest.approx(0.015)
    assert covered_interval(times, 0.2) == pytest.approx(0.2)
    with pytest.raises(ValueError, match=r"samples are 0\.01 s apart, but its error bounds speak of at most 0\.005 s"):
        covered_interval(times, 0.005)
    for name, value in (("longest_interval", 0.0), ("longest_interval", np.nan), ("largest_rate", -1.0)):
        with pytest.raises(ValueError, match=f"{name} must be"):
            GyroBounds(0.1, **{name: value})
    made_up = made()
    slow = (made_up.times[::10], made_up.angular_velocities[::10], made_up.specific_forces[::10])
    with pytest.raises(ValueError, match=r"0\.05 s apart, but its error bounds speak of at most 0\.015 s"):
        apply_rule(hand_held(), *slow)


def test_turns_over_windows_and_gaps():
    """Half of a turn happens unseen."""
    gyro = GyroBounds(noise=0.01, longest_interval=0.015, largest_rate=2.0)
    times = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(1.5, 2.5, 0.01)])
    rates = np.tile([1.0, 0.0, 0.0], (200, 1))
    assert gyro.window_angle(times, rates) == pytest.approx(0.01 * 1.98 + 2.0 * 0.51)
    turns = gyro.anchored_turns(times, rates, 0.3)
    assert turns.over_gap.sum() == 1
    assert turns.over_gap[100]
    assert turns.anchors[100] == 99
    assert turns.angles[100] == pytest.approx(2.0 * 0.51)
    assert not turns.rates[100].any()
    spans = times - times[turns.anchors]
    others = ~turns.over_gap
    assert (turns.angles[others] <= 0.01 * spans[others] + 1e-12).all()
    np.testing.assert_allclose(turns.rates[others][1:], rates[others][1:])
    for duration in (0.3, 10.0):
        anchors = gyro.anchored_turns(times, rates, duration).anchors
        assert anchors[100] == 99
        assert (anchors[101:] >= 100).all()
    missing = rates.copy()
    missing[[50, 51]] = np.nan
    unknown = dataclasses.replace(gyro, largest_rate=np.inf).anchored_turns(times, missing, 0.3)
    assert np.flatnonzero(unknown.over_gap).tolist() == [50, 51, 52, 100]
    np.testing.assert_array_equal(unknown.angles[unknown.over_gap], np.pi)
    assert np.isfinite(unknown.angles).all()


def test_time_offsets_at_gaps():
    times = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(1.5, 2.0, 0.01)])
    rates = np.tile([0.1, 0.0, 0.0], (150, 1))
    gyro = GyroBounds(noise=0.0, longest_interval=0.015, largest_rate=3.0)
    angles = time_offset_angles(times, rates, 0.02, gyro=gyro)
    near = np.flatnonzero(angles > 0.0021)
    # At gaps, and where the stamps may be beyond the samples.
    assert near.tolist() == [0, 1, 98, 99, 100, 101, 148, 149]
    np.testing.assert_allclose(angles[near], 0.06)
    unknown = dataclasses.replace(gyro, largest_rate=np.inf)
    np.testing.assert_array_equal(time_offset_angles(times, rates, 0.02, gyro=unknown)[near], np.pi)
    rates[120] = np.nan
    np.testing.assert_allclose(time_offset_angles(times, rates, 0.02, gyro=gyro)[120], 0.06)


def test_a_rest_ends_at_a_gap():
    """The sensor is laid down in another pose in the gap: that is not the pose at the start."""
    made_up = made()
    times = made_up.times
    start = times < 3.0
    forces, fields = made_up.specific_forces.copy(), made_up.fields.copy()
    turn = Rotation.from_rotvec([0.6, 0.0, 0.0])
    later = start & (times >= 2.5)
    forces[later], fields[later] = turn.apply(forces[later]), turn.apply(fields[later])
    keep = (times <= 2.2) | (times >= 2.5)
    arrays = (times[keep], made_up.angular_velocities[keep], forces[keep], fields[keep])
    ruled = apply_rule(hand_held(), *arrays)
    assert times[ruled.rest_at_start.stop - 1] <= 2.2
    whole = (times, made_up.angular_velocities, made_up.specific_forces, made_up.fields)
    expected = apply_rule(hand_held(), *whole)
    np.testing.assert_allclose(ruled.field_reference, expected.field_reference, atol=0.01)
    proposed = proposals.propose(proposals.Recording(*arrays))
    begin, end = proposed.rests[0]
    assert (begin, end) == (0.0, pytest.approx(2.2, abs=0.02))


def test_no_window_that_bounds_are_proposed_from_reaches_over_a_gap():
    made_up = made()
    keep = (made_up.times < 15.0) | (made_up.times > 16.9)
    fields = {name: getattr(made_up, name) for name in ("times", "angular_velocities", "attitudes")}
    cut = proposals.Recording(**{name: values[keep] for name, values in fields.items()})
    found, whole = proposals.propose(cut).gyro, proposals.propose(made_up).gyro
    assert found.longest_interval == pytest.approx(1.5 * 0.005)
    assert found.window_angles[4.0].maximum < 1.2 * whole.window_angles[4.0].maximum
    assert found.unexplained.maximum < np.deg2rad(0.1)


def test_modes_of_first_order_say_what_they_bridge():
    log = gyro_log(2, 400)
    first_order = {
        "estimator": {"mode": "first_order", "when_sets_do_not_meet": "skip"},
        "start": {"kind": "first_measurement", "bias_bound_deg_per_s": 0.1},
    }
    configuration = configured({"noise_deg_per_s": 0.1}, **first_order)
    whole = estimation.estimate(log, configuration)
    assert estimation.summarize(whole, configuration)["gaps"]["said"] == []
    log = without(log, (3.0, 4.2), (6.0, 6.4))
    estimator = estimation.PieceEstimator(configuration)
    keep = [log.since(0), log.since(70)]
    arrays = ("times", "directions", "references", "rates", "true_attitudes")
    keep[0] = dataclasses.replace(log, **{name: getattr(log, name)[:70] for name in arrays})
    list(estimator.run(keep))
    for found in (estimator.bridged.summarize(), estimation.estimate(log, configuration).bridged.summarize()):
        assert found["count"] == 2
        assert found["total_s"] == pytest.approx(1.6)
        assert found["longest_interval_s"] == pytest.approx(0.075)
        (line,) = found["said"]
        assert line.startswith("2 gaps in the gyro, longer than 0.075 s (1.6 s in all, the longest 1.2 s from 3.0000 s")


def test_summary_without_gaps():
    summary = gaps.summarize((), GyroBounds(0.1, longest_interval=0.01))
    assert (summary["count"], summary["said"], summary["largest_rate_deg_per_s"]) == (0, [], None)
    many = tuple(gaps.Gap(float(k), 0.1 + 0.001 * k, 0.2, 0.1, 0.3, 0) for k in range(300))
    summary = gaps.summarize(many, GyroBounds(0.1, longest_interval=0.01, largest_rate=2.0))
    assert len(summary["listed"]) == 200
    assert summary["listed"][0]["time_s"] == 100.0
    assert len(summary["said"]) == 7
    assert "295 more; summary.json lists 200" in summary["said"][-1]
    assert summary["said"][0].endswith(" °/s in them): the row behind each has a set")
    for rows, said in ((1, "1 row"), (7, "7 rows")):
        lost = (*many, gaps.Gap(301.0, 0.1, np.pi, 0.1, 0.3, rows))
        line = gaps.summarize(lost, GyroBounds(0.1, longest_interval=0.01))["said"][0]
        assert line.endswith(f": {said} in all until there is a set again")
    # Nor is the row behind a gap said to have a set where there was none before.
    for others, said in ((many, "1 of them"), ((), "each")):
        unknown = (*others, gaps.Gap(301.0, 0.1, np.pi, np.nan, np.nan, 0))
        line = gaps.summarize(unknown, GyroBounds(0.1, longest_interval=0.01))["said"][0]
        assert line.endswith(f": none of them ended a set; before {said} there was no set")
    json.dumps(summary, allow_nan=False)


# --- start from up alone ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sine", [0.0, 1e-16, 1e-15, 1e-14, 9e-13, 1e-9, 0.5])
@pytest.mark.parametrize("upright", [-1.0, 1.0])
def test_the_first_attitude_takes_up_to_the_vertical(sine, upright):
    """Within what the disc about it has room for, also where up is nearly the vertical or its opposite."""
    from elliptude.estimation.given.start import _shortest_turn_to_vertical

    up = np.array([0.6 * sine, 0.8 * sine, upright * np.sqrt(1.0 - sine**2)])
    assert np.linalg.norm(_shortest_turn_to_vertical(up) @ up - [0.0, 0.0, 1.0]) <= 2e-15


@pytest.mark.parametrize("angle_deg", [1e-3, 5.0, 10.0, 120.0])
def test_a_disc_of_attitudes_is_a_set(angle_deg):
    """Its shape was less than flat by rounding for a fifth to a half of all directions."""
    from elliptude.estimation.given.start import _disc, _without_bias

    draws = np.random.default_rng(1)
    angle = np.deg2rad(angle_deg)
    for _ in range(300):
        up = so3_unit(draws)
        start = _without_bias(np.eye(3), _disc(up, angle))
        filter_ = elliptude.GuaranteedFilter(
            elliptude.GuaranteedGyroFlow(1.0), start, vector_bound=1e-9, estimate_vector=False
        )
        assert filter_.knows_attitude
        across = np.cross(up, so3_unit(draws))
        error = angle * across / np.linalg.norm(across) + 1e-14 * so3_unit(draws)
        assert error @ np.linalg.solve(start.shape[:3, :3], error) <= 1.0
        assert np.sqrt(up @ start.shape[:3, :3] @ up) < 2e-9 + 2e-7 * angle
