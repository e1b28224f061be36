"""A sensor that shows its largest number for several samples on end: what is beyond it is not measured."""

import dataclasses

import numpy as np
import pytest
from elliptude.configuration.configuration import Configuration
from elliptude.logs.log import Log
from elliptude.logs.plausibility import Heard, plausible_pieces
from elliptude.logs.signals.saturation import Saturation

CONFIGURATION = Configuration.model_validate(
    {
        "time_column": "t",
        "reference_frame": "ENU",
        "flow": {"kind": "gyro", "columns": ["gx", "gy", "gz"], "noise_deg_per_s": 1.0},
        "directions": [
            {"name": "up", "kind": "accelerometer", "columns": ["ax", "ay", "az"], "unit": "m/s^2", "bound_deg": 5.0},
            {"name": "north", "columns": ["nx", "ny", "nz"], "reference": [0, 1, 0], "bound_deg": 5.0},
        ],
        "start": {"kind": "first_measurement", "bias_bound_deg_per_s": 1.0},
        "implausible": "ignore",
    }
)
RANGE = np.deg2rad(500.0)


FAST = np.deg2rad(700.0)


def shaken(largest=FAST, count=2000):
    """A body that is turned back and forth about z, with an accelerometer that shows up."""
    draws = np.random.default_rng(1)
    times = 0.005 * np.arange(count)
    rates = 0.01 * draws.normal(size=(count, 3))
    rates[:, 2] += largest * np.sin(2.0 * np.pi * 1.3 * times)
    directions = np.full((count, 2, 3), np.nan)
    directions[:, 0] = [0.0, 0.0, 9.81] + 0.05 * draws.normal(size=(count, 3))
    references = np.tile([[0.0, 0.0, 9.80665], [0.0, 1.0, 0.0]], (count, 1, 1))
    return Log(times=times, directions=directions, references=references, rates=rates)


def clipped(log, largest=RANGE):
    return dataclasses.replace(log, rates=np.clip(log.rates, -largest, largest))


def said(*pieces):
    saturation = Saturation(CONFIGURATION)
    for piece in pieces:
        saturation.add(piece)
    return [str(one) for one in saturation.found()]


def test_a_gyro_at_the_end_of_its_range():
    log = clipped(shaken())
    (found,) = said(log)
    assert found.startswith("the gyro: its largest number, 500 deg/s, in ")
    assert 0.8 < int(found.split()[8]) / (log.rates[:, 2] == RANGE).sum() <= 1.0
    backward = dataclasses.replace(log, rates=-log.rates)
    assert said(backward)[0].startswith("the gyro: its largest number, 500 deg/s")


def test_an_accelerometer_at_the_end_of_its_range():
    log = shaken()
    directions = log.directions.copy()
    directions[100:110, 0, 0] = -19.6133  # 2 g
    (found,) = said(dataclasses.replace(log, directions=directions))
    assert found.startswith("up: its largest number, 19.613 m/s², in 10 samples")


@pytest.mark.parametrize("largest", [FAST, np.deg2rad(50.0)])
def test_what_is_no_end_of_a_range(largest):
    assert said(shaken(largest)) == []
    # Peaks in a slow log, and a body that spins at one rate all the time.
    assert said(clipped(shaken(np.deg2rad(90.0)), np.deg2rad(80.0))) == []
    spinning = dataclasses.replace(shaken(), rates=np.tile([0.0, 0.0, 3.0], (2000, 1)))
    assert said(spinning) == []


def kept_in(step, values):
    return step * np.round(values / step)


@pytest.mark.parametrize("seed", range(10))
def test_peaks_in_coarse_digits_and_held_samples_are_no_end_of_a_range(seed):
    """They show their largest number several times on end, but are near it before and after; held samples are one."""
    draws = np.random.default_rng(seed)
    log = shaken(FAST * draws.uniform(0.3, 1.0), 8000)
    waves = np.sin(2.0 * np.pi * draws.uniform(0.3, 2.0, 4) * log.times[:, None] + 6.0 * draws.random(4)).sum(axis=1)
    rates = log.rates.copy()
    rates[:, 2] = 2.0 * waves
    forces = log.directions.copy()
    forces[:, 0, 2] += 2.0 * waves
    for digits, noise in ((np.deg2rad(1.0), 0.0), (np.deg2rad(1.0), 0.01), (np.deg2rad(0.06), 0.002)):
        coarse = kept_in(digits, rates + noise * draws.normal(size=rates.shape))
        assert said(dataclasses.replace(log, rates=coarse, directions=kept_in(0.3, forces))) == []
    held = np.arange(8000) // 4 * 4
    assert said(dataclasses.replace(log, rates=rates[held], directions=forces[held])) == []
    # The same motion, cut.
    top = 0.6 * np.abs(rates).max()
    assert len(said(clipped(dataclasses.replace(log, rates=kept_in(np.deg2rad(0.06), rates)), top))) == 1


def test_pieces_are_one_log():
    """The largest number of a piece is none of the log's, if others have larger ones."""
    low, high = clipped(shaken(), np.deg2rad(300.0)), shaken()
    assert len(said(low)) == 1
    assert said(low, high) == said(high, low) == []
    whole = clipped(shaken())
    top = int(np.argmax(whole.rates[:, 2])) + 2  # in the middle of a stay
    halves = [
        dataclasses.replace(
            whole, times=whole.times[part], rates=whole.rates[part], directions=whole.directions[part], references=None
        )
        for part in (slice(0, top), slice(top, None))
    ]
    assert said(*halves) == said(whole)


def test_rates_between_samples_do_not_count():
    """Where other sensors have rows, the rate is on a line between two equal samples."""
    log = shaken()
    rates = log.rates.copy()
    rates[100:106, 2] = 20.0
    filled = np.delete(log.times, [101, 102, 103, 104])
    assert len(said(dataclasses.replace(log, rates=rates))) == 1
    assert said(dataclasses.replace(log, rates=rates, gyro_times=filled)) == []


def test_it_is_heard_when_all_pieces_are_passed_on():
    heard = Heard()
    assert len(list(plausible_pieces(iter([clipped(shaken())]), CONFIGURATION, "log.csv", heard))) == 1
    assert [one.sensor for one in heard.suspicious] == ["the gyro"]
