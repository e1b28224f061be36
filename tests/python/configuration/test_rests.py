"""What a rule takes from the rest at the start: means over time, of whole samples; a bias known at no instant."""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.rest import mean_acceleration_at_rest, mean_over_time
from elliptude.configuration.rules import after_rest, apply_rule, hand_held, moved_fields
from elliptude.configuration.rules.at_start import field_at_rest, reference_at_rest, up_at_rest
from scipy.spatial.transform import Rotation

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


# --- a body that turns in the rest, as the bound of the bias allows ---------------------------------------------------


SHARP = {
    "rest": {"least_s": 10.0, "velocity_m_per_s": 0.001, "field_change_ut": 0.0},
    "accelerometer": {
        "error_m_per_s2": 0.01,
        "averaged_error_m_per_s2": 1e-4,
        "scale_error": 0.0,
        "time_offset_bound_s": 0.0,
        "gravity_error_m_per_s2": 0.0,
    },
    "magnetometer": {
        "error_ut": 0.05,
        "averaged_error_ut": 0.001,
        "scale_error": 0.0,
        "delay_s": 0.0,
        "time_offset_bound_s": 0.0,
        "disturbance_ut": 0.01,
    },
}
"""Next to no errors, and a rest in which the body may turn by 2.5 degrees."""
IN_REST = 0.01 * np.arange(1001)
FURTHEST = np.deg2rad(2.5)


def sharp(**changes):
    return rule_with(**(SHARP | {table: SHARP[table] | numbers for table, numbers in changes.items()}))


def turned_in_rest(angles, axis, field=FIELD):
    """What exact sensors show of a body that is turned by angles (rad)."""
    attitudes = Rotation.from_rotvec(np.outer(angles, axis)).inv()
    return attitudes.apply(np.tile(UP, (len(angles), 1))), attitudes.apply(np.zeros((len(angles), 3)) + field)


@pytest.mark.parametrize("first", [0, 500, 900])
@pytest.mark.parametrize("seen", ["field", "up"])
def test_a_body_that_turns_slowly_in_the_rest(first, seen):
    """Where one sensor shows something in a part of it alone, that is the part that the other one counts in."""
    angles = np.append(FURTHEST * 0.096 * IN_REST, np.full(999, FURTHEST * 0.96))
    forces, fields = turned_in_rest(angles, [1.0, 0.0, 0.0])
    (fields if seen == "field" else forces)[:first] = np.nan
    times, rates = 0.01 * np.arange(2000), np.zeros((2000, 3))
    rates[:1001, 0] = FURTHEST * 0.096
    if seen == "up":  # without which there is no rest
        reference, error = reference_at_rest(sharp(), IN_REST, IN_REST, forces[:1001], IN_REST, fields[:1001])
        assert np.linalg.norm(reference - FIELD) <= error < 0.12
        return
    found = apply_rule(sharp(), times, rates, forces, fields)
    assert off_by(found) <= found.field_reference_error
    # To first order nothing is lost of 2 µT, by which the body turns.
    assert found.field_reference_error < 0.12
    assert not found.field.contradicted.any()


def test_means_of_other_instants_differ_by_what_the_body_turns():
    """The magnetometer is slower, and shows no run of rows: its few samples are of where the body was not for long."""
    angles = np.where(np.arange(1001) < 100, 0.0, FURTHEST)
    forces, fields = turned_in_rest(angles, [1.0, 0.0, 0.0])
    fields[(np.arange(1001) % 2 == 1) | (np.arange(1001) > 100)] = np.nan
    reference, error = reference_at_rest(sharp(), IN_REST, IN_REST, forces, IN_REST, fields)
    off = np.linalg.norm(reference - FIELD)
    assert 0.75 * error <= off <= error


@pytest.mark.parametrize("offset", ["accelerometer", "magnetometer"])
def test_means_of_shifted_times_differ_by_what_the_body_turns(offset):
    """The true times of one sensor are 1 s later, and so much of its mean is of where the body had not been before."""
    rule = sharp(**{offset: {"time_offset_bound_s": 1.0}})
    sign = 1.0 if offset == "magnetometer" else -1.0
    early, late = (np.where(since < IN_REST, FURTHEST, 0.0) for since in (9.0, 10.0))
    of_up, of_field = (late, early) if sign > 0.0 else (early, late)
    forces, fields = turned_in_rest(of_up, [1.0, 0.0, 0.0])[0], turned_in_rest(of_field, [1.0, 0.0, 0.0])[1]
    reference, error = reference_at_rest(rule, IN_REST, IN_REST, forces, IN_REST, fields)
    off = np.linalg.norm(reference - FIELD)
    assert 0.15 * error <= off <= error


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
def test_the_mean_of_attitudes_is_none(axis):
    """Half of the rest in one attitude, half in the other: along the axis the mean keeps its length, across it not."""
    forces, fields = turned_in_rest(np.where(np.arange(1001) < 501, 0.0, FURTHEST), axis)
    reference, error = reference_at_rest(sharp(), IN_REST, IN_REST, forces, IN_REST, fields)
    # The mean of two turns that are this far apart is shorter by the cosine of half of that.
    off = np.linalg.norm(reference - FIELD)
    assert 0.9 * (1.0 - np.cos(0.5 * FURTHEST)) * 43.0 <= off <= error


def test_a_field_that_changes_while_the_body_turns():
    """It is off its mean one way in one attitude, and the other way in the other."""
    change = 3.0
    rule = sharp(rest={"field_change_ut": change}, magnetometer={"disturbance_ut": 5.0})
    first = np.arange(1000) < 500
    way = np.where(first, 1.0, -1.0)[:, None] * np.array([0.0, 43.0, 20.0]) / np.hypot(43.0, 20.0)
    forces, fields = turned_in_rest(np.where(first, 0.0, FURTHEST), [1.0, 0.0, 0.0], FIELD + change * way)
    times = 0.01 * np.arange(1000) * 1000 / 999
    reference, error = reference_at_rest(rule, times, times, forces, times, fields)
    still = reference_at_rest(
        rule, times, times, forces, times, turned_in_rest(np.where(first, 0.0, FURTHEST), [1.0, 0.0, 0.0])[1]
    )[0]
    assert np.linalg.norm(reference - still) >= 0.45 * change * FURTHEST
    assert np.linalg.norm(reference - FIELD) <= error


@pytest.mark.parametrize("change", [0.0, 3.0])
def test_what_turning_takes_of_the_field_alone(change):
    """Up is known exactly, half of the rest is to the left of it and half to the right, and so may the field change."""
    times, sides = 0.01 * np.arange(1000), np.where(np.arange(1000) < 500, -1.0, 1.0)
    way = sides[:, None] * np.array([0.0, 43.0, 20.0]) / np.hypot(43.0, 20.0)
    fields = turned_in_rest(0.5 * FURTHEST * sides, [1.0, 0.0, 0.0], FIELD + change * way)[1]
    up = up_at_rest(sharp(), times, np.tile(UP, (1000, 1)))._replace(tilt=0.0)
    rule, still = (sharp(rest={"field_change_ut": by}, magnetometer={"disturbance_ut": 5.0}) for by in (change, 0.0))
    reference, error = field_at_rest(rule, up, times, fields, FURTHEST)
    off = np.linalg.norm(reference - FIELD)
    assert off <= error
    if change:
        assert field_at_rest(still, up, times, fields, FURTHEST)[1] < off
    else:
        assert field_at_rest(rule, up, times, fields, 0.0)[1] < off


def test_a_specific_force_is_short_where_the_body_turns():
    """As short as the cosine of half of the turn makes it, gravity being known: no contradiction."""
    forces = turned_in_rest(np.where(np.arange(1001) < 501, 0.0, FURTHEST), [1.0, 0.0, 0.0])[0]
    assert 9.807 - np.linalg.norm(forces.mean(axis=0)) > 5.0 * 3e-4
    up_at_rest(sharp(), IN_REST, forces, FURTHEST)
    with pytest.raises(ValueError, match="further from gravity than the rule allows"):
        up_at_rest(sharp(), IN_REST, forces, 0.0)


def test_a_rest_may_have_been_shorter_than_its_stamps_say():
    # Of 1.02 s by stamps that are off by 10 ms each: a steady 2 m/s² from -1 to 1 m/s.
    assert mean_acceleration_at_rest(1.0, 1.02, 0.01) == pytest.approx(2.0)
    assert mean_acceleration_at_rest(1.0, 1.02, 0.6) == np.inf
    assert mean_acceleration_at_rest(1.0, 1.0, 0.0) == 2.0


def test_a_rest_that_its_stamps_make_longer():
    """The speed goes from one way to the other in the time that is left if stamps drift by the offset either way."""
    speed, offset = 0.05, 0.4
    rule = sharp(rest={"velocity_m_per_s": speed}, accelerometer={"time_offset_bound_s": offset})
    acceleration = 2.0 * speed / (10.0 - 2.0 * offset)
    found = up_at_rest(rule, IN_REST, np.tile([0.0, acceleration, 9.807], (1001, 1)))
    assert acceleration / 9.807 <= found.tilt <= 1.02 * acceleration / 9.807 + 1e-4
