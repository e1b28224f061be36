"""The rule for a sensor on a person: its reasons, and a walker and a runner whose true attitudes are known."""

import re

import elliptude as el
import numpy as np
import pytest
from elliptude import cli
from elliptude.configuration import rules
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

FINE = 1e-3
PERSON = rules.rule_for("person")
# Steps a second, m/s, how long turning back takes (s), and the swing of arm or thigh: degrees, m.
GAITS = {
    "walking wrist": (1.9, 1.7, 1.0, 30.0, 0.7),
    "running wrist": (2.9, 3.7, 1.5, 45.0, 0.35),
    "walking thigh": (1.9, 1.7, 1.0, 22.0, 0.35),
    "running back": (2.9, 3.7, 1.5, 0.0, 0.1),
}


def rising(x):
    """From 0 to 1, without a jump of the acceleration."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def rocking(times, begins, degrees, frequency):
    """An angle that each strike of a heel shakes, which fades within some swings."""
    angle = np.zeros_like(times)
    for begin in begins:
        since = np.maximum(times - begin, 0.0)
        angle += rising(3.0 * frequency * since) * np.exp(-6.0 * since) * np.sin(2.0 * np.pi * frequency * since)
    return np.deg2rad(degrees) * angle / max(np.abs(angle).max(), 1e-9)


def gait(name, seconds=24.0):
    """Times at 1 kHz, attitudes, velocities and accelerations: stands for 4 s, goes, turns back twice, stands."""
    steps, speed, turning, swing, length = GAITS[name]
    times = np.arange(0.0, seconds, FINE)
    going = rising((times - 4.0) / 1.5) * (1.0 - rising((times - seconds + 3.0) / 1.5))
    yaw = np.pi * (rising((times - 9.0) / turning) - rising((times - 15.0) / turning)) + 0.3 * going * np.sin(
        0.5 * times
    )
    phase = np.pi * steps * times
    strikes = np.arange(4.0, seconds - 2.0, 1.0 / steps)
    trunk = Rotation.from_euler("zyx", np.stack([yaw, 0.05 * going, 0.05 * going * np.sin(phase)], axis=1))
    arm = trunk * Rotation.from_euler("y", np.deg2rad(swing) * (going * np.sin(phase))[:, None])
    rocks = rocking(times, strikes, 0.5, 20.0)[:, None] * np.array([0.6, 0.0, 0.8])
    attitudes = arm * Rotation.from_rotvec(rocks) * Rotation.from_euler("xyz", [0.3, -0.2, 0.5])
    ahead = speed * going
    places = np.cumsum(np.stack([ahead * np.cos(yaw), ahead * np.sin(yaw), 0.0 * yaw], axis=1), axis=0) * FINE
    places[:, 2] += 0.03 * going * np.cos(2.0 * phase)
    places[:, 2] += 0.2 * rocking(times, strikes, 0.5, 20.0)  # 2 mm, 3 g
    places += arm.apply([0.0, 0.0, -length])
    velocities = np.gradient(places, FINE, axis=0)
    return times, attitudes, velocities, np.gradient(velocities, FINE, axis=0)


def rates_of(attitudes):
    turns = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec() / FINE
    return np.concatenate([turns[:1], 0.5 * (turns[1:] + turns[:-1]), turns[-1:]])


def summed_up(rates):
    """Attitudes from rates, one a millisecond, from one after the other to the last."""
    quaternions = Rotation.from_rotvec(FINE * rates).as_quat()
    # Products of all from the first, by doubling.
    products = np.concatenate([[[0.0, 0.0, 0.0, 1.0]], quaternions])
    distance = 1
    while distance < len(products):
        earlier = Rotation.from_quat(products[:-distance])
        later = Rotation.from_quat(products[distance:])
        products = np.concatenate([products[:distance], (earlier * later).as_quat()])
        distance *= 2
    return Rotation.from_quat(products)


def filtered(vectors, step_ms):
    """The mean over the interval about each instant, as a filter leaves it."""
    return np.stack([np.convolve(axis, np.full(step_ms, 1.0 / step_ms), "same") for axis in vectors.T], axis=1)


def shown(name, step_ms=20, seed=1):
    """What sensors show whose errors are at the bounds: times, rad/s, m/s², µT, and the true attitudes."""
    rng = np.random.default_rng(seed)
    times, attitudes, _, accelerations = gait(name)
    there = slice(step_ms, -step_ms, step_ms)
    exact = filtered(rates_of(attitudes), step_ms)[there]
    forces = filtered(attitudes.inv().apply(accelerations + np.array([0.0, 0.0, 9.807])), step_ms)[there]
    times, world = times[there], attitudes[there].inv()
    after = np.clip((times - 3.0) / 0.5, 0.0, 1.0)[:, None]

    def unit(axes=3):
        vector = np.append(rng.normal(size=axes), np.zeros(3 - axes))
        return vector / np.linalg.norm(vector)

    def matrix(error):
        left, _, right = np.linalg.svd(rng.normal(size=(3, 3)))
        return np.eye(3) + error * left @ right

    everywhere = np.ones((len(times), 1))
    bias = np.deg2rad(0.999 * PERSON.gyro.bias_deg_per_s) * world.apply(everywhere * unit())
    rates = exact @ matrix(PERSON.gyro.scale_error).T + after * bias
    forces = forces @ matrix(PERSON.accelerometer.scale_error).T
    # The mean error stands across gravity, wherever the sensor turns.
    forces += 0.999 * PERSON.accelerometer.averaged_error_m_per_s2 * world.apply(after * unit(2))
    disturbance = 0.999 * PERSON.magnetometer.disturbance_ut * after * unit()
    fields = world.apply(np.array([0.0, 30.0, -30.0]) + disturbance) @ matrix(PERSON.magnetometer.scale_error).T
    return times, rates, forces, fields, attitudes[there]


# --- the reasons ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step_ms", [20, 25])
@pytest.mark.parametrize("name", GAITS)
def test_lines_between_samples_leave_out_no_more_than_is_stated(name, step_ms):
    times, attitudes, _, _ = gait(name)
    rates = rates_of(attitudes)
    samples = filtered(rates, step_ms)
    for first in range(step_ms, 2 * step_ms, 5):
        there = slice(first, -step_ms, step_ms)
        lines = np.stack([np.interp(times, times[there], samples[there, axis]) for axis in range(3)], axis=1)
        last = first + step_ms * (len(times[there]) - 1)
        off = (lines - rates)[first:last]
        assert np.rad2deg(np.linalg.norm(off, axis=1).max()) < PERSON.gyro.noise_deg_per_s - 1.0
        sums = np.rad2deg(np.cumsum(off, axis=0)[::20]) * FINE
        apart = np.linalg.norm(sums[:, None] - sums[None], axis=2)
        away = np.abs(np.subtract.outer(np.arange(len(sums)), np.arange(len(sums))))
        assert apart[away < 600].max() < 2.3  # 12 s
        # The turn by what lines leave out, and nothing else.
        turned = summed_up(lines[first:last]) * attitudes[first : last + 1].inv()
        turned = turned[::20]
        for step in (5, 15, 50, 150, 300, 600):
            turns = np.rad2deg((turned[step:] * turned[:-step].inv()).magnitude())
            growth = PERSON.gyro.noise_turn_growth_deg_per_s * 0.02 * step
            assert turns.max() < PERSON.gyro.noise_turn_deg - 0.2 + growth


@pytest.mark.parametrize("name", GAITS)
def test_half_of_what_the_velocity_changes_by_is_as_stated(name):
    _, _, velocities, _ = gait(name)
    speeds = velocities[::20]
    assert 0.5 * np.linalg.norm(speeds[:, None] - speeds[None], axis=2).max() < PERSON.motion.velocity_m_per_s


def test_the_swing_of_an_arm_is_within_the_largest_angular_acceleration():
    amplitude, angular_frequency = 45.0, 2.0 * np.pi * 1.5
    assert 2.0 * amplitude * angular_frequency**2 <= PERSON.gyro.largest_angular_acceleration_deg_per_s2
    # A line over 25 ms, three times; the whole rocking; the sensor.
    beside = 3.0 * amplitude * angular_frequency**3 * 0.025**2 / 8.0
    assert beside + 0.5 * 2.0 * np.pi * 20.0 + 1.0 <= PERSON.gyro.noise_deg_per_s


# --- the guarantee ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step_ms", [10, 20])
@pytest.mark.parametrize("name", GAITS)
def test_up_is_within_the_bounds(name, step_ms):
    times, rates, forces, _, attitudes = shown(name, step_ms)
    true = attitudes.inv().apply([0.0, 0.0, 1.0])
    up = rules.apply_rule(PERSON, times, rates, forces).up
    off = np.arccos(np.clip(np.einsum("ni,ni->n", up.directions, true), -1.0, 1.0))
    assert not up.contradicted.any()
    assert (off <= up.angles).all()
    # It says something: not every row of a runner, but all of somebody who walks.
    assert np.rad2deg(np.median(up.angles)) < (110.0 if "running wrist" in name else 80.0)


@pytest.mark.parametrize("name", GAITS)
def test_up_is_within_the_bounds_where_samples_were_lost(name):
    recorded = shown(name)
    kept = np.random.default_rng(5).uniform(size=len(recorded[0])) > 0.04 * (recorded[0] > 3.0)
    times, rates, forces, _, attitudes = (values[kept] for values in recorded)
    assert np.diff(times).max() > PERSON.gyro.longest_interval_s
    up = rules.apply_rule(PERSON, times, rates, forces).up
    true = attitudes.inv().apply([0.0, 0.0, 1.0])
    off = np.arccos(np.clip(np.einsum("ni,ni->n", up.directions, true), -1.0, 1.0))
    known = np.isfinite(up.angles)
    assert known.mean() > 0.9
    assert not up.contradicted.any()
    assert (off <= up.angles)[known].all()


def test_the_numbers_of_a_hand_do_not_hold_on_a_runner():
    """The tests here can fail."""
    times, rates, forces, _, attitudes = shown("running back", 10)
    up = rules.apply_rule(rules.hand_held(), times, rates, forces).up
    off = np.arccos(np.clip(np.einsum("ni,ni->n", up.directions, attitudes.inv().apply([0.0, 0.0, 1.0])), -1.0, 1.0))
    assert up.contradicted.any() or (off > up.angles).any()


@pytest.mark.parametrize("name", GAITS)
@pytest.mark.parametrize("seed", [1, 2])
def test_sets_hold_the_truth_wherever_they_claim_to(name, seed):
    times, rates, forces, fields, attitudes = shown(name, seed=seed)
    found = el.ahrs(times, rates, forces, fields, statements="person", mag_unit="uT")
    matrices = attitudes.as_matrix()
    claimed = found.claims == "unconditional"
    assert claimed[:200].all()  # it stands
    assert found.contains(matrices)[claimed].all()
    off = np.arccos(np.clip(np.einsum("ni,ni->n", found.ups, matrices[:, 2]), -1.0, 1.0))
    up_claimed = found.up_claims == "unconditional"
    assert up_claimed.mean() > 0.9
    assert (off <= found.up_bounds)[up_claimed].all()


# --- logs of watches --------------------------------------------------------------------------------------------------


def test_fifty_samples_a_second_are_served_and_twenty_five_are_not(tmp_path):
    def said(step_ms):
        times, rates, forces, _, _ = shown("walking wrist", step_ms)
        log = tmp_path / f"{step_ms}.csv"
        head = ["Time (s)", *(f"Gyroscope {axis} (rad/s)" for axis in "XYZ")]
        head += [f"Accelerometer {axis} (m/s^2)" for axis in "XYZ"]
        np.savetxt(log, np.column_stack([times, rates, forces]), delimiter=",", header=",".join(head), comments="")
        asked = ["bounds", str(log), "--carried", "person", "--out", str(tmp_path / f"{step_ms}.toml")]
        done = CliRunner().invoke(cli.make_app(), [*asked, "--force"])
        assert done.exit_code == 0, done.output
        return re.sub(r"\s+", " ", done.output)

    assert "Less than 1.4 s of an accelerometer that moves so say nothing about up" in said(20)
    assert "need statements of their own" not in said(20)
    slow = said(40)
    assert "by the rule for a sensor on a person" in slow
    assert "Fewer than 40 samples a second need statements of their own" in slow
    times, rates, forces, _, _ = shown("walking wrist", 40)
    with pytest.raises(ValueError, match=r"0\.04 s apart, but its error bounds speak of at most 0\.025 s"):
        el.ahrs(times, rates, forces, statements="person")
