"""What counts as a rest, why nothing does, and how noisy a sensor is."""

import numpy as np
import pytest
from elliptude.bounds.rest import noise_of, rest_rows, why_no_rest

TIMES = np.arange(0.0, 10.0, 0.005)
LIMITS = {"duration": 0.5, "rate_deviation": 0.02, "rate": 0.1, "acceleration_deviation": 0.5}
DOWN = np.tile([0.0, 0.0, 9.8], (len(TIMES), 1))


def turning(size, frequency=1.0):
    return size * np.column_stack([np.sin(2.0 * np.pi * frequency * TIMES)] * 3) / np.sqrt(3.0)


@pytest.mark.parametrize("sigma", [1e-3, 0.02, 0.5])
def test_noise_is_found_beside_a_motion(sigma):
    noise = sigma * np.random.default_rng(1).standard_normal((len(TIMES), 3))
    # The quietest fifth of the pieces has a little less than the mean.
    for motion in (0.0, 20.0 * sigma):
        assert 0.85 * sigma < noise_of(TIMES, noise + turning(motion), duration=0.5) < 1.02 * sigma


def test_noise_of_a_part_with_gaps():
    noise = 0.1 * np.random.default_rng(2).standard_normal((len(TIMES), 3))
    noise[::150] = np.nan
    assert noise_of(TIMES[:2], noise[:2], duration=0.5) == 0.0
    assert 0.08 < noise_of(TIMES, noise, duration=0.5) < 0.102


@pytest.mark.parametrize(
    ("rates", "forces", "words"),
    [
        (turning(0.3), DOWN, "the gyro deviates from its mean by "),
        (turning(0.0) + 0.2, DOWN, "the gyro's mean is 19.8, at most 5.73 deg/s are a rest"),
        (turning(0.0), DOWN + turning(5.0), "the specific force deviates by "),
        (turning(0.0) * np.nan, DOWN, "no 0.5 s have all samples"),
    ],
)
def test_why_nothing_is_a_rest(rates, forces, words):
    assert not rest_rows(TIMES, rates, forces, **LIMITS).any()
    assert words in why_no_rest(TIMES, rates, forces, **LIMITS)


def test_the_quietest_piece_is_named():
    rates = turning(0.3)
    rates[800:900] *= 0.2
    said = why_no_rest(TIMES, rates, DOWN, **LIMITS)
    assert "in the quietest 0.5 s, from 4 s on" in said
