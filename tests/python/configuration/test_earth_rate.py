"""The Earth's turn in a gyro whose mean over a rest is taken off: turned over, the sensor shows it the other way."""

import numpy as np
import pytest
from elliptude.calibration.calibrate import calibrate
from elliptude.configuration import Configuration
from elliptude.configuration.calibration import read_statements
from elliptude.configuration.rules import Rule, apply_rule, hand_held
from elliptude.logs.log import Log
from scipy.spatial.transform import Rotation

EARTH = np.deg2rad(360.0 / 86164.0905)
STEP = 0.01


def rule_of(bias, scale_error=0.0, **gyro):
    """A gyro of which nothing else is wrong."""
    tables = hand_held().model_dump(mode="json", exclude_none=True)
    tables["gyro"] |= {"noise_deg_per_s": 0.0, "bias_deg_per_s": bias, "scale_error": scale_error, "increment_deg": 1.0}
    return Rule.model_validate(tables | {"gyro": tables["gyro"] | gyro})


def turned_over(scale=0.0, angle=np.pi, latitude=0.0):
    """Times, what the gyro shows, the true rate against the Earth, and up, of a body that is turned after a rest."""
    times = STEP * np.arange(1000)
    rate = np.where((times > 4.0) & (times < 6.0), 0.5 * angle, 0.0)
    turned = np.concatenate([[0.0], np.cumsum(0.5 * STEP * (rate[1:] + rate[:-1]))])
    turned *= angle / max(turned[-1], 1e-300)
    axis = np.array([1.0, 0.0, 0.0])  # east, across the pole
    body = Rotation.from_rotvec(turned[:, None] * axis).inv()
    pole = EARTH * body.apply([0.0, np.cos(latitude), np.sin(latitude)])
    true = rate[:, None] * axis
    return times, (1.0 + scale) * (true + pole), true, body.apply([0.0, 0.0, 9.807])


def least_bias(scale_error):
    """The smallest bound of the bias that a rule is taken with, deg/s."""
    low, high = 0.0, 0.1
    while high - low > 1e-7:
        middle = 0.5 * (low + high)
        try:
            rule_of(middle, scale_error)
        except ValueError:
            low = middle
        else:
            high = middle
    return high


@pytest.mark.parametrize("scale_error", [0.0, 0.02, 0.2])
def test_attainment_of_the_earths_turn(scale_error):
    """It uses up the smallest bound that is taken, but for how much its number is rounded."""
    bias = least_bias(scale_error)
    times, rates, true, forces = turned_over(scale_error)
    found = apply_rule(rule_of(bias, scale_error), times, rates, forces)
    left = np.linalg.norm(rates - found.bias - (1.0 + scale_error) * true, axis=1)
    assert left.max() <= found.gyro.bias
    assert left.max() >= 0.994 * found.gyro.bias
    assert (np.linalg.norm(rates - found.bias - true, axis=1) <= found.gyro_noise + 1e-12).all()


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.5 * np.pi, np.pi])
@pytest.mark.parametrize("latitude", [0.0, 0.8, -1.4])
def test_less_of_it_is_left_after_smaller_turns(angle, latitude):
    times, rates, true, forces = turned_over(angle=angle, latitude=latitude)
    found = apply_rule(rule_of(0.0085), times, rates, forces)
    left = np.linalg.norm(rates - found.bias - true, axis=1)
    assert left.max() == pytest.approx(2.0 * EARTH * np.sin(0.5 * angle), abs=1e-12)


@pytest.mark.parametrize(
    ("gyro", "covers"),
    [
        ({"bias_deg_per_s": 0.0083}, False),
        ({"bias_deg_per_s": 0.0084}, True),
        ({"bias_deg_per_s": 0.0084, "scale_error": 0.01}, False),
        ({"bias_deg_per_s": 0.0085, "scale_error": 0.01}, True),
        ({"bias_deg_per_s": 0.0042, "noise_deg_per_s": 0.0041}, False),
        ({"bias_deg_per_s": 0.0042, "noise_deg_per_s": 0.0042}, True),
        ({"bias_deg_per_s": 0.0, "noise_deg_per_s": 0.0084}, True),
        ({"bias_deg_per_s": 0.0042, "earth_rate": "removed"}, True),
    ],
)
def test_a_rule_has_room_for_it_twice(gyro, covers):
    if covers:
        rule_of(**{"bias": 0.0} | gyro)
    else:
        with pytest.raises(ValueError, match=r"turned over since its rest by as much again.* leave no room"):
            rule_of(**{"bias": 0.0} | gyro)


def test_a_scale_error_shows_more_of_it_without_a_rest():
    tables = {"time_column": "t", "reference_frame": "ENU", "estimator": {"mode": "guaranteed"}}
    flow = {"kind": "gyro", "columns": ["a", "b", "c"], "noise_deg_per_s": 0.0042, "scale_error": 0.05}
    tables["directions"] = [{"name": "sun", "columns": ["d", "e", "f"], "reference": [1.0, 0.0, 0.0], "bound_deg": 7.0}]
    with pytest.raises(ValueError, match=r"with the scale error 0\.00441, for which its bounds leave no room"):
        Configuration.model_validate(tables | {"flow": flow})
    Configuration.model_validate(tables | {"flow": flow | {"noise_deg_per_s": 0.00442}})


def test_a_calibration_has_room_for_it():
    """Its statements of the gyro are in the place of the rule's."""
    columns = {"columns": ["a", "b", "c"]}
    stated = Configuration.model_validate(
        {
            "time_column": "t",
            "flow": {"kind": "gyro"} | columns,
            "directions": [{"name": "up", "kind": "accelerometer", "unit": "m/s^2"} | columns],
            "estimator": {"mode": "guaranteed"},
            "rule": {"kind": "hand_held"},
        }
    )
    times, rates, _, forces = turned_over()
    log = Log(times, forces[:, None], np.zeros((1000, 1, 3)), rates)
    statements = read_statements()
    gyro = {"noise_deg_per_s": 0.001, "bias_deg_per_s": 0.0042, "scale_error": 0.0, "increment_deg": 0.1}
    table = type(statements).model_fields["gyro"].annotation.__args__[0].model_validate(gyro)
    with pytest.raises(ValueError, match="leave no room"):
        calibrate(log, stated, statements.model_copy(update={"gyro": table}))


def test_a_change_of_the_bias_has_room_for_a_body_that_is_turned_over():
    """Twice what of the Earth's turn is in the bias changes from one pose to the other, and not what the noise has."""
    with pytest.raises(ValueError, match=r"bias_change_deg_per_s is 0\.008: add it there"):
        rule_of(0.1, bias_change_deg_per_s=0.008)
    rule_of(0.1, bias_change_deg_per_s=0.0084)
    rule_of(0.1, bias_change_deg_per_s=0.008, earth_rate="removed")
    with pytest.raises(ValueError, match="bias_change_deg_per_s is 0: add it there"):
        rule_of(0.1, bias_change_deg_per_s=0.0, noise_deg_per_s=0.0041)
    rule_of(0.1, bias_change_deg_per_s=0.0, noise_deg_per_s=0.0042, increment_deg=100.0, noise_turn_deg=100.0)


def test_windows_hold_where_the_earths_turn_uses_up_the_change():
    """Turned over within a window, with nothing else wrong."""
    times, rates, _, forces = turned_over(angle=np.pi)
    rule = rule_of(0.0084, bias_change_deg_per_s=0.0084)
    found = apply_rule(rule, times, rates, forces)
    turned = found.up.directions
    known = np.isfinite(found.up.angles)
    sines = np.linalg.norm(np.cross(turned, forces / 9.807), axis=1)
    assert (np.arcsin(np.minimum(sines, 1.0))[known] <= found.up.angles[known]).all()
