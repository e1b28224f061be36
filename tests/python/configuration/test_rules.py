"""Rules for how a sensor is carried: each number has a reason, and a motion within them stays within their bounds."""

import re

import numpy as np
import pytest
from elliptude.configuration import motion, rules, sensors
from elliptude.configuration.findings import suspicions
from elliptude.io.toml_faults import faults_in_words
from elliptude.proposal import proposals
from elliptude.proposal.proposed_rule import what_it_says
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

OTHERS = ("person", "drone", "car", "boat")

# Written down before any recording was compared with a reference attitude; nobody may tune them. Of what came later,
# the field in the rest and the length of means make bounds wider.
HAND = {
    "rest": {
        "duration_s": 0.5, "rate_deviation_deg_per_s": 1.0, "rate_deg_per_s": 5.0,
        "acceleration_deviation_m_per_s2": 0.5, "least_s": 2.0, "velocity_m_per_s": 0.05,
        "field_change_ut": 0.25,
    },
    "gyro": {
        "noise_deg_per_s": 1.0, "bias_deg_per_s": 0.25, "drift_deg_per_s2": 0.0, "scale_error": 0.02,
        "increment_deg": 0.2, "bias_change_deg_per_s": 0.23, "noise_turn_deg": 0.25,
        "noise_turn_growth_deg_per_s": 0.13, "longest_interval_s": 0.015, "largest_rate_deg_per_s": 2000.0,
        "largest_angular_acceleration_deg_per_s2": 60000.0,
    },
    "accelerometer": {
        "gravity_m_per_s2": 9.807, "gravity_error_m_per_s2": 0.027, "error_m_per_s2": 0.6,
        "averaged_error_m_per_s2": 0.2, "averaged_over_s": 0.5, "scale_error": 0.01, "time_offset_bound_s": 0.005,
        "time_offset_change_s": 0.0005,
    },
    "motion": {
        "velocity_m_per_s": 3.0, "position_m": 1.0, "largest_jerk_m_per_s3": 5000.0,
        "windows_s": [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0],
        "row_at": "middle",
    },
    "magnetometer": {
        "disturbance_ut": 5.0, "error_ut": 4.0, "averaged_error_ut": 1.3, "averaged_over_s": 0.5, "scale_error": 0.01,
        "window_s": 0.5, "delay_s": 0.010, "time_offset_bound_s": 0.010, "contradiction_voids": "recording",
    },
}  # fmt: skip


def test_the_hand_is_what_it_was():
    assert rules.hand_held().model_dump(mode="json", exclude_none=True) == HAND
    assert rules.rule_for("hand") == rules.hand_held()


@pytest.mark.parametrize("carried", ["hand", *OTHERS])
def test_each_number_has_a_reason(carried):
    rule = rules.rule_for(carried).model_dump(mode="json", exclude_none=True, exclude={"carried"})
    reasons = rules.reasons_for(carried)
    for name, table in rule.items():
        for key in table:
            assert len(reasons[name, key].split()) >= 3, (name, key)


@pytest.mark.parametrize("carried", OTHERS)
def test_a_preset_changes_what_depends_on_how_the_sensor_is_carried(carried):
    rule, hand = rules.rule_for(carried).model_dump(), rules.hand_held().model_dump()
    changed = {
        (name, key) for name, table in rule.items() if isinstance(table, dict) for key in table
        if table[key] != hand[name][key]
    }  # fmt: skip
    assert changed <= set(rules.carried_numbers())
    assert ("motion", "velocity_m_per_s") in changed
    assert rule["carried"] == carried
    # A vehicle's reasons are not a hand's.
    assert all(rules.reasons_for(carried)[place] != rules.reasons_for("hand").get(place) for place in changed - {
        ("motion", "windows_s")
    })  # fmt: skip
    assert not suspicions.of_rule(rules.rule_for(carried).model_dump(mode="json"), carried=carried)
    assert suspicions.of_rule(rules.rule_for(carried).model_dump(mode="json"))


def drive(seconds=120.0, top=40.0, level=4.0):
    """A car at 100 Hz: parked, then speeding up to ``top`` and braking, on a road that turns and climbs."""
    times = np.arange(0.0, seconds, 0.01)
    moving = np.clip((times - 5.0) / 2.0, 0.0, 1.0)
    speed = 0.5 * top * (1.0 - np.cos(2.0 * np.pi * (times - 5.0) / 40.0)) * (times > 5.0)
    yaw, pitch = 0.6 * np.sin(0.3 * (times - 5.0)) * moving**2, 0.08 * np.sin(0.2 * (times - 5.0)) * moving**2
    attitudes = Rotation.from_euler("zy", np.column_stack([yaw, -pitch]))
    velocity = attitudes.apply(np.column_stack([speed, 0.0 * speed, 0.0 * speed]))
    acceleration = np.gradient(velocity, times, axis=0)
    assert np.linalg.norm(velocity, axis=1).max() < 70.0
    assert np.linalg.norm(acceleration, axis=1).max() > level  # a hand's windows do not expect it for seconds
    turns = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec() / 0.01
    rates = np.concatenate([turns[:1], 0.5 * (turns[1:] + turns[:-1]), turns[-1:]])
    return times, rates, attitudes.inv().apply(acceleration + np.array([0.0, 0.0, 9.807])), attitudes


def test_up_is_within_the_bounds_of_a_car():
    times, rates, forces, attitudes = drive()
    true = attitudes.inv().apply([0.0, 0.0, 1.0])

    def excess(carried):
        up = rules.apply_rule(rules.rule_for(carried), times, rates, forces, every=25).up
        off = np.arccos(np.clip(np.einsum("ni,ni->n", up.directions, true), -1.0, 1.0))
        known = np.isfinite(up.angles)
        return (off - up.angles)[known], known

    beyond, known = excess("car")
    assert known.sum() > 0.9 * len(times[::25])
    assert beyond.max() <= 1e-9
    # The test can fail: the numbers of a hand do not hold in a car.
    beyond, known = excess("hand")
    assert beyond.max(initial=0.0) > 0.0 or known.sum() < 0.5 * len(times[::25])


def test_a_stated_acceleration_sharpens_short_windows():
    """Who knows how the car is driven may say so: a hundredth of gravity is half a degree in any window."""
    times, rates, forces, _ = drive(seconds=40.0, top=1.0, level=0.05)
    car = rules.rule_for("car")
    motion = car.motion.model_copy(update={"acceleration_m_per_s2": 0.3})
    plain, sharper = (
        rules.apply_rule(one, times, rates, forces, every=100).up.angles[::100]
        for one in (car, car.model_copy(update={"motion": motion}))
    )
    moving = times[::100] > 8.0
    assert (sharper[moving] < 0.8 * plain[moving]).mean() > 0.8
    assert (sharper <= plain).all()


class Shown:
    """A recording with both sensors, in a field of 50 µT."""

    accelerometer = object()

    class magnetometer:
        magnitude = 50.0


def test_what_says_nothing_is_said():
    def said(carried, **motion):
        numbers = rules.rule_for(carried).model_dump(mode="json", exclude_none=True)
        numbers["motion"] |= motion
        return " ".join(what_it_says(numbers, Shown))

    assert "The magnetometer says nothing" in said("car")
    assert "The magnetometer says nothing" in said("boat")
    assert "may turn the field by 24 degrees" in said("drone")
    assert "Less than 7.1 s of an accelerometer that moves so say nothing" in said("drone")
    assert "No window is long enough for such a motion" in said("drone", windows_s=[2.0, 4.0])
    assert "say nothing" not in said("drone", acceleration_m_per_s2=2.0)


# --- the rest at the start --------------------------------------------------------------------------------------------


def smooth(carried, accelerations, rates):
    """What exact sensors show that move as smoothly as a rest; the body's axes are level, x along the road."""
    times = 0.01 * np.arange(3000)
    speeds = np.cumsum(np.interp(times, *accelerations)) * 0.01
    forces = np.stack([np.interp(times, *accelerations), np.zeros(3000), np.full(3000, 9.807)], axis=1)
    shown = np.stack([np.zeros(3000), np.zeros(3000), np.deg2rad(np.interp(times, *rates))], axis=1)
    rule = rules.rule_for(carried)
    assert speeds.max() < rule.motion.velocity_m_per_s
    return rule, times, shown, forces


@pytest.mark.parametrize("carried", ["hand", *OTHERS])
def test_a_smooth_start_is_no_longer_rest(carried):
    """Parked, then slowly faster and faster: each half second is as still as a rest, and up is not where it seems."""
    begin = rules.rule_for(carried).rest.least_s + 0.5
    stop = 12.0 if carried == "hand" else 14.0
    top = {"hand": 0.2, "person": 0.6}.get(carried, 2.0)
    accelerations = [0.0, begin, begin + 2.5, stop, stop + 2.0], [0.0, 0.0, top, top, 0.0]
    rule, times, shown, forces = smooth(carried, accelerations, ([0.0], [0.0]))
    ruled = rules.apply_rule(rule, times, shown, forces)
    assert times[ruled.rest_at_start][-1] <= rule.rest.least_s + 1e-9
    up = ruled.up
    off = np.arccos(np.clip(up.directions[:, 2], -1.0, 1.0))
    assert np.rad2deg(off.max()) > 0.5
    there = ~np.isnan(up.angles)
    assert (off <= up.angles)[there].all()
    assert not up.contradicted.any()


@pytest.mark.parametrize("carried", ["hand", *OTHERS])
def test_a_smooth_turn_is_no_bias(carried):
    """A level turn that comes up within seconds, slower than what an uncalibrated gyro may show at rest."""
    begin = rules.rule_for(carried).rest.least_s + 0.5
    rule, times, shown, forces = smooth(carried, ([0.0], [0.0]), ([0.0, begin, begin + 5.0], [0.0, 0.0, 4.0]))
    ruled = rules.apply_rule(rule, times, shown, forces)
    np.testing.assert_allclose(ruled.bias, 0.0, atol=1e-12)


def test_why_a_rest_is_too_short_is_said_of_what_comes_after_it():
    rule, times, shown, forces = smooth("hand", ([0.0], [0.0]), ([0.0], [0.0]))
    shown[100:, 2] = np.deg2rad(3.0) * np.where(np.arange(2900) // 10 % 2, 1.0, -1.0)
    said = r"a rest of 0.99 s; the rule asks for 2 s: in the quietest 0.5 s, from 1 s on, the gyro deviates"
    with pytest.raises(ValueError, match=said):
        rules.apply_rule(rule, times, shown, forces)


def test_a_gap_that_ends_the_rest_is_named():
    """Not what the sensor shows after it, which may be a rest too."""
    rule, times, shown, forces = smooth("hand", ([0.0], [0.0]), ([0.0], [0.0]))
    times = times + 0.4 * (np.arange(len(times)) > 0)
    with pytest.raises(
        ValueError, match=r"a rest of 0 s; the rule asks for 2 s: the gyro has a gap of 0.41 s after 0 s"
    ):
        rules.apply_rule(rule, times, shown, forces)
    start = proposals.propose(proposals.Recording(times, shown, forces))
    assert start.rest_ends == "a gap of 0.41 s after 0 s"
    whole = proposals.propose(proposals.Recording(times[1:], shown[1:], forces[1:]))
    assert whole.rest_ends == "the recording ends there"
    shown[100:, 2] = np.deg2rad(3.0) * np.where(np.arange(2900) // 10 % 2, 1.0, -1.0)
    moved = proposals.propose(proposals.Recording(times[1:], shown[1:], forces[1:]))
    assert "the gyro deviates from its mean" in moved.rest_ends


def test_every_number_of_a_rule_has_a_limit_and_the_message_says_it():
    """A number that nobody means would overflow somewhere inside, where no message names its key."""
    whole = rules.hand_held().model_dump(mode="json", exclude_none=True, exclude={"carried"})
    tried = 0
    for table, numbers in whole.items():
        for key, value in numbers.items():
            if not isinstance(value, float | list):
                continue
            huge = [*value[:-1], 1e300] if isinstance(value, list) else 1e300
            changed = whole | {table: numbers | {key: huge}}
            with pytest.raises(ValidationError) as error:
                rules.Rule.model_validate(changed)
            said = faults_in_words(error.value, changed, rules.Rule)
            assert re.fullmatch(
                rf"{table}\.{key}(\[\d\])?: must be (at most|less than) [\de+]+, not .*1e\+300\]?", said
            ), said
            tried += 1
    assert tried >= 30


@pytest.mark.parametrize("delay", [1e300, -1e300, 1000.5])
def test_a_delay_of_a_rule_is_no_other_clock(delay):
    whole = rules.hand_held().model_dump(mode="json", exclude_none=True, exclude={"carried"})
    changed = whole | {"magnetometer": whole["magnetometer"] | {"delay_s": delay}}
    with pytest.raises(ValidationError, match=r"magnetometer\.delay_s"):
        rules.Rule.model_validate(changed)


@pytest.mark.parametrize(
    "kind",
    [
        motion.GyroFlow,
        sensors.Timed,
        sensors.AccelerationBound,
        sensors.VelocityWindowBound,
        sensors.FieldBound,
        sensors.AccelerometerError,
        sensors.MagnetometerError,
        *(one.annotation for one in rules.Rule.model_fields.values() if isinstance(one.annotation, type)),
    ],
)
def test_no_bound_of_a_sensor_is_without_a_limit(kind):
    checked_by_its_square = {"noise_deg_per_s", "drift_deg_per_s2"} if kind is motion.GyroFlow else set()
    for key, said in kind.model_json_schema().get("properties", {}).items():
        one = next((part for part in said.get("anyOf", [said]) if part.get("type") == "number"), None)
        if one is not None and key not in checked_by_its_square:
            assert one.keys() & {"maximum", "exclusiveMaximum"}, key


def test_the_rule_of_the_package_is_read_once():
    assert rules.hand_held() is rules.hand_held()
