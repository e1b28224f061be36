"""Recordings that keep all that is stated, at its extremes too: no check refuses one."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
from elliptude.configuration import Configuration
from elliptude.io.files import FileError
from elliptude.io.toml import validate
from elliptude.logs import Log, plausibility
from elliptude.logs import log as logs
from elliptude.logs.axes.stated import Stated
from elliptude.validation.recordings.drawing import draw_recording
from elliptude.validation.recordings.trials import write_recording
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
from random_configurations import draw_configuration


def errors_of(log, configuration):
    return [str(one) for one in plausibility.contradictions(log, configuration) if one.severity == "error"]


def drawn(seed, number, trial, folder):
    tables = draw_configuration([seed, number])
    configuration = validate(Path("drawn"), tables, Configuration)
    recording = draw_recording(configuration, np.random.SeedSequence(100_000 * seed + number, spawn_key=(trial,)))
    write_recording(recording, folder / "log.csv")
    return logs.joined(list(logs.read_pieces(folder / "log.csv", configuration))), configuration


@pytest.mark.parametrize("first", range(0, 90, 6))
def test_drawn_recordings(tmp_path, first):
    """Of 600 that an earlier benchmark drew 12 were refused, mostly for a gyro that shows constants in its noise."""
    for number in range(first, first + 6):
        try:
            log, configuration = drawn(3, number, 0, tmp_path)
        except FileError:
            continue  # a configuration that is refused
        assert errors_of(log, configuration) == [], number


# --- one statement at its extreme -------------------------------------------------------------------------------------


def by_angles(angle, **flow):
    references = {"a": [1.0, 0.0, 0.0], "b": [0.0, 1.0, 0.0]}
    return Configuration.model_validate(
        {
            "time_column": "t",
            "flow": {"kind": "gyro", "columns": ["p", "q", "r"], "noise_deg_per_s": 0.5} | flow,
            "directions": [
                {"name": name, "columns": ["x", "y", "z"], "reference": one, "bound_deg": angle}
                for name, one in references.items()
            ],
            "estimator": {"mode": "guaranteed"},
        }
    )


def turned_directions(turns):
    """What stands still in the world, seen from a body with these attitudes."""
    return np.stack([turns.inv().apply(one) for one in np.eye(3)[:2]], axis=1)


TIMES = 0.05 * np.arange(600)
REFERENCES = np.tile(np.eye(3)[:2], (len(TIMES), 1, 1))


@pytest.mark.parametrize("shown", [0.0, np.deg2rad(0.5)])
def test_a_quantised_gyro_may_show_the_same_in_all_rows(shown):
    """The body turns by 15 degrees back and forth as slowly as the noise bound allows, and directions add theirs."""
    angle = np.deg2rad(13.0) * np.sin(np.deg2rad(0.499) / np.deg2rad(13.0) * TIMES)
    body = Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0]))
    wobble = Rotation.from_rotvec(np.outer(np.deg2rad(19.9) * np.sign(np.sin(3.0 * TIMES)), [0.0, 0.0, 1.0]))
    rates = np.tile([0.0, 0.0, shown], (len(TIMES), 1))
    configuration = by_angles(20.0, noise_deg_per_s=1.0)
    log = Log(TIMES, turned_directions(body * wobble), REFERENCES, rates)
    assert errors_of(log, configuration) == []
    # It is off where what the directions show is more than both.
    fast = Rotation.from_rotvec(np.outer(2.0 * np.sin(TIMES), [0.0, 0.0, 1.0]))
    (error,) = errors_of(Log(TIMES, turned_directions(fast), REFERENCES, rates), configuration)
    assert "is it off?" in error


@pytest.mark.parametrize("factor", [-1.0, 0.05, 57.0])
def test_a_direction_may_turn_by_its_own_bound(factor):
    """The body swings by a degree, and a direction that may be off by 60 swings otherwise."""
    swing = np.deg2rad(1.0) * np.sin(TIMES)
    shown = Rotation.from_rotvec(np.outer(factor * swing, [0.0, 0.0, 1.0]))
    rates = np.outer(np.deg2rad(1.0) * np.cos(TIMES), [0.0, 0.0, 1.0])
    log = Log(TIMES, turned_directions(shown), REFERENCES, rates)
    assert errors_of(log, by_angles(60.0, noise_deg_per_s=0.01)) == []
    if factor != 0.05:  # of a swing of one degree, not turning is within any bound
        assert errors_of(log, by_angles(0.01, noise_deg_per_s=0.01)) != []


def test_a_field_may_be_as_strong_as_is_stated():
    """The strongest of the Earth, the disturbance and the errors are more than 70 uT together."""
    configuration = Configuration.model_validate(
        {
            "time_column": "t",
            "reference_frame": "ENU",
            "flow": {"kind": "gyro", "columns": ["p", "q", "r"], "noise_deg_per_s": 0.5},
            "directions": [
                {
                    "name": "field",
                    "kind": "magnetometer",
                    "columns": ["x", "y", "z"],
                    "unit": "uT",
                    "reference_ut": [0.0, 20.0, -60.0],
                    "sensor_error": {"error_ut": 3.0, "scale_error": 0.1},
                    "bound_from": {"kind": "field", "disturbance_ut": 150.0},
                }
            ],
            "estimator": {"mode": "guaranteed"},
        }
    )
    for strength, count in ((240.0e-6, 0), (250.0e-6, 1)):
        fields = np.tile([[0.0, 0.0, -strength]], (len(TIMES), 1, 1))
        references = np.tile([[0.0, 20.0e-6, -60.0e-6]], (len(TIMES), 1, 1))
        log = Log(TIMES, fields, references, np.zeros((len(TIMES), 3)))
        assert len(errors_of(log, configuration)) == count


# --- each statement alone, at its bound: without it the log would prove a fault ---------------------------------------

Z = np.array([0.0, 0.0, 1.0])


def quotient_of(log, configuration, *before):
    stated = Stated(configuration)
    for piece in before:
        stated.rates(piece)
    return stated.quotient(log, "a")


def spun(angles, times=TIMES, rates=None, **changes):
    """A body that turned about its z axis by these angles, and rates about it: the angles' slopes, or others."""
    rates = np.gradient(angles, times) if rates is None else rates
    references = np.tile(np.eye(3)[:2], (len(times), 1, 1))
    log = Log(times, turned_directions(Rotation.from_rotvec(np.outer(angles, Z))), references, np.outer(rates, Z))
    return dataclasses.replace(log, **changes)


def still(**changes):
    return spun(np.zeros(len(TIMES)), **changes)


def test_an_increment_is_stated_for_no_longer_than_windows():
    """0.25 degrees in each second are no more than 0.25 degrees in any window of a second."""
    stated = {"noise_deg_per_s": 5.0, "increment_deg": 0.25, "anchor_s": 1.0}
    log = spun(np.zeros(len(TIMES)), rates=np.deg2rad(np.full(len(TIMES), 0.2499)))
    assert 0.3 < quotient_of(log, by_angles(0.01, **stated)) <= 1.0
    turned = {"noise_deg_per_s": 5.0, "noise_turn_deg": 0.25, "anchor_s": 1.0}
    assert 0.7 < quotient_of(log, by_angles(0.01, **turned)) <= 1.0
    assert quotient_of(log, by_angles(0.01, **stated | {"anchor_s": 100.0})) > 1.0


def test_a_rate_that_holds_leaves_its_line():
    # A sample that differs: on lines half of it is before and half behind, what holds has all of it behind.
    rates = np.where(np.arange(len(TIMES)) % 100 < 50, 1.0, -1.0)
    rates[::100] = 20.0
    angles = np.concatenate([[0.0], np.cumsum(rates[:-1] * np.diff(TIMES))])
    log = spun(angles, rates=rates)
    held = by_angles(0.01, noise_deg_per_s=0.01, interval_rate="first_sample")
    assert quotient_of(log, held) <= 1.0
    assert quotient_of(log, by_angles(0.01, noise_deg_per_s=0.01)) > 1.0


def test_an_acceleration_between_samples_leaves_the_line():
    """Between two samples the rate rises and falls: at half of the acceleration times the step beside it at most."""
    size = 0.249 * np.deg2rad(100.0) * 0.05
    log = spun(size * TIMES, rates=np.zeros(len(TIMES)))
    assert quotient_of(log, by_angles(0.01, noise_deg_per_s=1e-3, angular_acceleration_deg_per_s2=100.0)) <= 1.0
    assert quotient_of(log, by_angles(0.01, noise_deg_per_s=1e-3)) > 1.0


def test_any_turn_in_a_gap():
    """Four samples were lost, while the body turned by a right angle."""
    angles = np.where(TIMES < 15.0, 0.0, 0.5 * np.pi)
    kept = (TIMES < 15.0) | (TIMES > 15.19)
    log = spun(angles[kept], TIMES[kept], np.zeros(kept.sum()))
    assert quotient_of(log, by_angles(0.01, noise_deg_per_s=0.01)) <= 1.0
    assert quotient_of(log, by_angles(0.01, noise_deg_per_s=0.01, longest_interval_s=0.3)) > 1.0


def test_a_bias_drifts_from_the_recordings_first_row_on():
    first, late = still(), spun(np.zeros(len(TIMES)), TIMES + 1000.0, np.full(len(TIMES), np.deg2rad(0.9)))
    drifting = by_angles(0.01, noise_deg_per_s=1e-3, drift_deg_per_s2=1e-3)
    assert quotient_of(late, drifting, first) <= 1.0
    assert quotient_of(late, drifting) > 1.0


@pytest.mark.parametrize("key", ["bound_deg", "reference_error_deg", "alignment_error_deg"])
def test_angles_of_a_direction(key):
    """It points by all of the angle to one side first, and to the other then."""
    swing = np.deg2rad(9.99) * np.where(TIMES < 15.0, 1.0, -1.0)
    configuration = by_angles(0.01, noise_deg_per_s=1e-3)
    (first, *_) = configuration.directions
    changed = first.model_copy(update={key: 10.0})
    log = spun(swing, rates=np.zeros(len(TIMES)))
    assert 0.9 < quotient_of(log, configuration.model_copy(update={"directions": [changed]})) <= 1.0
    assert quotient_of(log, configuration) > 1.0


def test_a_reference_that_moves():
    moves = Rotation.from_rotvec(np.outer(0.2 * TIMES / TIMES[-1], Z))
    seen = np.stack([moves.apply(one) for one in np.eye(3)[:2]], axis=1)
    assert 0.2 < quotient_of(still(directions=seen, references=seen), by_angles(0.01, noise_deg_per_s=1e-3)) <= 1.0
    assert quotient_of(still(directions=seen), by_angles(0.01, noise_deg_per_s=1e-3)) > 1.0


def test_a_body_of_which_only_torques_are_stated_proves_nothing():
    tables = by_angles(0.01).model_dump(mode="json", exclude_unset=True)
    tables["flow"] = {"kind": "rigid_body", "inertia_kg_m2": [1.0, 2.0, 3.0], "step_s": 0.01}
    tables |= {"rate": {"columns": ["p", "q", "r"], "bound_deg_per_s": 0.01}}
    log = spun(TIMES, rates=-np.ones(len(TIMES)))
    findings = plausibility.contradictions(log, Configuration.model_validate(tables))
    assert [one.severity for one in findings] == ["warning"] * len(findings)
    assert findings
