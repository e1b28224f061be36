"""What is found, in the words of a configuration, of the options of `bounds`, and of the arguments of `ahrs`."""

import itertools

import numpy as np
import pytest
from elliptude.cli.columns import OPTIONS, words_of
from elliptude.configuration.findings.finding import KEYS, Axes, Finding, Key, Name, Remedy, TurnedRound
from elliptude.from_arrays.arguments import ARGUMENTS


def unit(of, stated, meant, *fitting):
    return Remedy(Key(of, "unit"), stated, meant, fitting)


GRAVITY = Key("rule", "accelerometer.gravity_m_per_s2")
REFERENCE = Key("magnetometer", "reference_ut")


@pytest.mark.parametrize(
    ("said", "by_keys", "by_options", "by_arguments"),
    [
        (
            unit("accelerometer", "m/s^2", "g", "g", "mg"),
            'it would be in g or mg: write unit = "g"',
            "it would be in g or mg: say --accelerometer-unit g",
            "it would be in g or mg: acc_unit='g'",
        ),
        (
            ("as if its degrees were declared as radians: ", unit("gyro", "rad/s", "deg/s")),
            'as if its degrees were declared as radians: write flow.unit = "deg/s"',
            "as if its degrees were declared as radians: say --gyro-unit deg/s",
            "as if its degrees were declared as radians: gyr_unit='deg/s'",
        ),
        (
            unit("magnetometer", "uT", "normalized"),
            'write unit = "normalized", and in unit_ut how many µT 1 is',
            "say --magnetometer-unit normalized, and by --field-ut how many µT 1 is",
            "mag_unit='uT', and multiply mag by the field of the place in µT",
        ),
        (
            unit("magnetometer", "normalized", "uT", "uT"),
            'it would be in uT: write unit = "uT", without unit_ut',
            "it would be in uT: say --magnetometer-unit uT, without --field-ut",
            "it would be in uT: mag_unit='uT'",
        ),
        (
            Remedy(Key("time", "time_unit"), "s", "ms", ("ms",)),
            'it would be in ms: write time_unit = "ms"',
            "it would be in ms: say --time-unit ms",
            "time is in s: are they milliseconds?",
        ),
        (
            (GRAVITY, " = 1; in g it would be: ", Remedy(GRAVITY, 1.0, 9.80665)),
            "rule.accelerometer.gravity_m_per_s2 = 1; in g it would be: "
            "write rule.accelerometer.gravity_m_per_s2 = 9.80665",
            "rule.accelerometer.gravity_m_per_s2 = 1; in g it would be: "
            "write rule.accelerometer.gravity_m_per_s2 = 9.80665",
            "accelerometer.gravity_m_per_s2 = 1; in g it would be: write accelerometer.gravity_m_per_s2 = 9.80665",
        ),
        (
            (REFERENCE, " is long: ", Remedy(REFERENCE, (0.0, 18e3, -42e3), (0.0, 18.0, -42.0))),
            "reference_ut is long: write reference_ut = [0, 18, -42]",
            "reference_ut is long: write reference_ut = [0, 18, -42]",
            "the reference that is made of it is long: is mag_unit right?",
        ),
        (("though ", Name("acc"), " turns"), "though 'acc' turns", "though 'acc' turns", "though acc turns"),
        (TurnedRound("down"), "at_rest = 'down'", "at_rest = 'down'", "-acc"),
    ],
)
def test_each_says_it_in_its_own_words(said, by_keys, by_options, by_arguments):
    assert [words(said) for words in (KEYS, OPTIONS, ARGUMENTS)] == [by_keys, by_options, by_arguments]


def test_units_of_a_header_are_stated_by_options_only_beside_columns(tmp_path):
    remedy = unit("gyro", "rad/s", "deg/s")
    by_name = {"gyroscope": ("gx,gy,gz", "rad/s"), "magnetometer": (None, None)}
    assert words_of(None, by_name)(remedy) == "say --gyro-unit deg/s"
    by_header = dict.fromkeys(by_name, (None, None))
    assert words_of(None, by_header)(remedy) == "name the columns by options, and say --gyro-unit deg/s"
    assert words_of(tmp_path, by_header) is KEYS


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
@pytest.mark.parametrize("signs", list(itertools.product((1.0, -1.0), repeat=3)))
def test_axes_as_an_array_are_those_of_the_matrix(order, signs):
    """What is advised is executed: the columns of an array become the body's axes."""
    matrix = np.diag(signs)[:, list(order)]
    advised = ARGUMENTS(Axes("magnetometer", ("a", "b", "c"), tuple(map(tuple, matrix.tolist()))))
    mag = np.random.default_rng(5).standard_normal((4, 3))
    np.testing.assert_array_equal(eval(advised, {"mag": mag}), mag @ matrix.T)


def test_sensors_are_named_before_what_is_said_of_them():
    found = Finding("error", "the gyro", "0 in all rows")
    assert [found.in_words(words) for words in (KEYS, OPTIONS, ARGUMENTS)] == [
        "the gyro: 0 in all rows",
        "the gyro: 0 in all rows",
        "gyr: 0 in all rows",
    ]
    assert str(Finding("error", "", "no rows")) == "no rows"


def test_what_says_the_same_is_the_same_as_sure_or_not():
    found = Finding("error", "up", ("its unit: ", unit("accelerometer", "m/s^2", "g")))
    assert found == Finding("warning", "up", ("its unit: ", unit("accelerometer", "m/s^2", "g")))
    assert len({found, Finding("warning", *(found.sensor, found.said))}) == 1
    assert found != Finding("error", "up", ("its unit: ", unit("accelerometer", "m/s^2", "mg")))
    assert found != Finding("error", "field", found.said)
    assert found != str(found)
