"""What a rule takes from the rest at the start: means over time, of whole samples; a bias known at no instant."""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.rest import mean_over_time
from elliptude.configuration.rules import after_rest, apply_rule, hand_held, moved_fields

UP = np.array([0.0, 0.0, 9.807])
FIELD = np.array([0.0, 20.0, -43.0])


def rule_with(**changes):
    """The rule for the hand with other numbers in some tables."""
    rule = hand_held()
    return rule.model_copy(
        update={table: getattr(rule, table).model_copy(update=numbers) for table, numbers in changes.items()}
    )


def off_by(found, truth=FIELD):
    """How far the reference field points from the true one, as the length that its error must have at least, µT."""
    cosine = float(found.field_reference @ truth) / float(np.linalg.norm(truth))
    return float(np.linalg.norm(truth)) * np.sqrt(1.0 - min(cosine, 1.0) ** 2)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_few_samples_are_no_mean(sign):
    """Four of them, each as wrong as one may be, in a rest of two seconds."""
    times = 0.01 * np.arange(400)
    rule = rule_with(magnetometer={"averaged_error_ut": 0.1, "scale_error": 0.0}, accelerometer={"scale_error": 0.0})
    fields = np.tile(FIELD, (400, 1))
    fields[:200] = np.nan
    wrong = FIELD + sign * rule.magnetometer.error_ut * np.array([0.0, 43.0, 20.0]) / np.hypot(43.0, 20.0)
    fields[[20, 21, 22, 23]] = wrong
    found = apply_rule(rule, times, np.zeros((400, 3)), np.tile(UP, (400, 1)), fields)
    assert off_by(found) > 3.0
    assert off_by(found) <= found.field_reference_error
    # Whole samples of half a second are one.
    fields[:200] = FIELD + 0.09 * np.array([0.0, 1.0, 0.0])
    found = apply_rule(rule, times, np.zeros((400, 3)), np.tile(UP, (400, 1)), fields)
    assert off_by(found) <= found.field_reference_error < 3.0


def test_the_mean_is_one_over_time():
    """A sensor that is read more often while it speeds up one way: of that, no speed says how large its mean may be."""
    speed, quick, slow = 0.05, 5e-4 * np.arange(800), 0.4 + 0.01 * np.arange(161)
    times = np.concatenate([quick, slow, slow[-1] + 0.01 * np.arange(1, 200)])
    acceleration = np.where(times < 0.4, 2.0 * speed / 0.4, np.where(times < 2.0, -2.0 * speed / 1.6, 0.0))
    forces = UP + acceleration[:, None] * np.array([0.0, 1.0, 0.0])
    rule = rule_with(
        accelerometer={"averaged_error_m_per_s2": 0.01, "scale_error": 0.0, "gravity_error_m_per_s2": 0.0},
        magnetometer={"averaged_error_ut": 0.01, "scale_error": 0.0},
    )
    found = apply_rule(rule, times, np.zeros((len(times), 3)), forces, np.tile(FIELD, (len(times), 1)))
    assert off_by(found) <= found.field_reference_error < 0.5


def test_the_bias_of_a_rest_is_known_at_none_of_its_instants():
    """It is right in the middle, and off by half of the drift at both ends: the bound is attained at the first row."""
    times, drift = np.linspace(3.0, 13.0, 1001), 1e-3
    bias = drift * (times - 8.0)
    gyro = after_rest(GyroBounds(0.0, bias=1e-4, drift=drift), times)
    assert abs(bias[0] - bias.mean()) == pytest.approx(gyro.bias - 1e-4)
    later = np.linspace(3.0, 60.0, 500)
    left = np.abs(drift * (later - 8.0) - bias.mean())
    assert (left <= gyro.bias - 1e-4 + drift * (later - times[0]) + 1e-12).all()


def test_the_bias_is_a_mean_over_time_however_far_rows_are_apart():
    """A thousand rows in the second second, ten in the first: the mean over rows is of the second alone."""
    drift, least = np.deg2rad(0.1), 2.0
    times = np.concatenate([0.1 * np.arange(10), 1.0 + 0.001 * np.arange(1000), 2.0 + 0.01 * np.arange(400)])
    rule = rule_with(gyro={"drift_deg_per_s2": 0.1, "bias_deg_per_s": 1e-6, "longest_interval_s": 0.11})
    rates = np.outer(drift * times, [1.0, 0.0, 0.0])
    found = apply_rule(rule, times, rates, np.tile(UP, (len(times), 1)))
    assert times[found.rest_at_start][-1] == pytest.approx(least)
    assert found.bias[0] == pytest.approx(0.5 * drift * least, rel=1e-6)
    # What is left of it at the first row is within what is stated, and comes to it.
    assert np.linalg.norm(found.bias) == pytest.approx(found.gyro.bias, rel=1e-3)
    assert np.linalg.norm(found.bias) <= found.gyro.bias


def test_the_heading_of_a_still_body_whose_bias_drifts():
    """The rates are the drift alone; the heading that they add up to is within the bound of the turns."""
    times, drift = 0.01 * np.arange(2000), np.deg2rad(0.1)
    rates = np.outer(drift * times, [0.0, 0.0, 1.0])
    rule = rule_with(rest={"least_s": 5.0}, gyro={"bias_deg_per_s": 1e-3, "drift_deg_per_s2": 0.1, "scale_error": 0.0})
    found = apply_rule(rule, times, rates, np.tile(UP, (2000, 1)), np.tile(FIELD, (2000, 1)))
    left = np.abs(rates[:, 2] - found.bias[2])
    assert (left <= found.gyro.bias + found.gyro.drift * (times - times[0]) + 1e-12).all()


@pytest.mark.parametrize("change", [None, 0.5, 4.0])
def test_the_field_of_a_rest_changes_by_what_is_stated(change):
    """The reference is its mean; in one half of the rest it is as far from that to one side as it may be."""
    times = 0.01 * np.arange(600)
    rule = rule_with(
        rest={"field_change_ut": change}, magnetometer={"averaged_error_ut": 0.0, "error_ut": 0.0, "scale_error": 0.0}
    )
    stated = rule.magnetometer.disturbance_ut if change is None else change
    way = np.where(times < 1.0, 1.0, -1.0)[:, None] * np.array([1.0, 0.0, 0.0])
    fields = FIELD + 0.999 * stated * way
    found = apply_rule(rule, times, np.zeros((600, 3)), np.tile(UP, (600, 1)), fields)
    cosines = found.field.directions @ (FIELD / np.linalg.norm(FIELD))
    known = np.isfinite(found.field.angles) & (times < 2.0)
    assert known.mean() > 0.3
    assert (np.arccos(np.clip(cosines[known], -1.0, 1.0)) <= found.field.angles[known]).all()


def test_a_delay_of_uneven_rows_keeps_the_samples_own_times():
    """A mean is over the time that samples show: rows' times weigh a sample by an interval that is not its own."""
    steps = np.where(np.arange(300) % 20 < 10, 0.002, 0.018)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    delay = 0.1
    shown = times - delay  # each sample tells when it was true, which in the mean is the middle
    fields = FIELD + np.outer(shown, [1.0, 0.0, 0.0])
    stated = rule_with(magnetometer={"delay_s": delay, "time_offset_bound_s": 0.001}).magnetometer
    moved = moved_fields(stated, times, fields, None, 0.03)
    there = np.isfinite(moved.values[:, 0])
    assert there.sum() > 250
    np.testing.assert_allclose(moved.sampled[there], moved.values[there, 0], atol=1e-12)
    assert np.abs(moved.sampled - times)[there].max() > 0.001  # which is no part of the offset then
    assert moved.offset == 0.001
    mean = mean_over_time(moved.sampled[there], moved.values[there])
    assert mean[0] == pytest.approx(0.5 * (moved.sampled[there][0] + moved.sampled[there][-1]), abs=1e-9)
