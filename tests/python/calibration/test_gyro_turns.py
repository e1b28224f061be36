"""Sets of a gyro's scale and axes from turns between rests: the true ones are in them, and what is left holds."""

from itertools import pairwise

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.calibration.gyro import Turn, _slabs, gyro_set
from elliptude.calibration.vector_sensors import ContradictionError
from scipy.spatial.transform import Rotation

GOOD = GyroBounds(noise=2e-3, bias=5e-4, scale_error=0.02, increment=5e-4)


def unit(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def recorded(seed, gyro, scale, angle=0.005, count=30, size=3.0, noise_share=0.9):
    """Turns of about ``size`` radians about any axis, with errors that use up most of their bounds."""
    rng = np.random.default_rng(seed)
    turns = []
    for _ in range(count):
        duration = 2.0
        times = np.linspace(0.0, duration, 201)
        bell = np.sin(np.pi * times / duration) ** 2
        rates = size * (0.3 + 0.7 * rng.uniform()) * unit(rng) * bell[:, None]
        rates /= np.trapezoid(bell, times)
        true = Rotation.identity()
        for n in range(200):
            true = true * Rotation.from_rotvec(0.5 * (rates[n] + rates[n + 1]) * (times[1] - times[0]))
        up = unit(rng)
        after = true.inv().apply(up)

        def off(vector):
            axis = np.cross(vector, unit(rng))
            return Rotation.from_rotvec(noise_share * angle * axis / np.linalg.norm(axis)).apply(vector)

        noise = noise_share * gyro.increment * np.pi * np.cos(np.pi * times)[:, None] * unit(rng) / 2.0
        noise *= min(1.0, noise_share * gyro.noise / max(np.linalg.norm(noise, axis=1).max(), 1e-300))
        measured = rates @ (np.eye(3) + scale).T + noise_share * gyro.bias * unit(rng) + noise
        turns.append(Turn(times, measured, off(up), off(after), angle, angle, gyro.bias))
    return turns


@pytest.mark.parametrize("seed", range(3))
def test_the_true_scale_is_in_the_set(seed):
    rng = np.random.default_rng(50 + seed)
    scale = rng.normal(size=(3, 3))
    scale *= 0.9 * GOOD.scale_error / np.linalg.norm(scale, 2)
    found = gyro_set(recorded(seed, GOOD, scale), GOOD)
    inverse = scale @ np.linalg.inv(np.eye(3) + scale)
    assert np.all(found.lowest <= inverse)
    assert np.all(inverse <= found.highest)
    left = np.linalg.norm(found.matrix @ (np.eye(3) + scale) - np.eye(3), 2)
    assert left <= found.scale_error <= GOOD.scale_error
    assert found.turns == 30
    assert found.noise_factor >= np.linalg.norm(found.matrix, 2) or not found.inverse.any()


def test_turns_pay():
    scale = np.array([[0.015, 0.002, 0.0], [0.0, -0.01, 0.003], [0.002, 0.0, 0.012]])
    found = gyro_set(recorded(3, GOOD, scale, angle=0.002, count=40), GOOD)
    assert found.scale_error < 0.5 * GOOD.scale_error


def test_exact_measurements_leave_next_to_nothing():
    """All remainders are of second order: they vanish as the set shrinks."""
    exact = GyroBounds(noise=1e-9, bias=0.0, scale_error=0.02, increment=1e-9)
    scale = np.array([[0.01, 0.003, 0.0], [0.0, -0.01, 0.003], [0.002, 0.0, 0.012]])
    found = gyro_set(recorded(4, exact, scale, angle=1e-7), exact)
    assert found.scale_error < 2e-4
    left = np.linalg.norm(found.matrix @ (np.eye(3) + scale) - np.eye(3), 2)
    assert left <= found.scale_error


@pytest.mark.parametrize("scale", [0.0, -0.3])
def test_an_axis_that_goes_round_between_samples_is_in_the_bound(scale):
    """500 degrees a second, four times round in a second, 50 samples a second, between which rates are on lines.

    About the true scale nothing is off but the turns that are calculated from the means of the steps, (18.49).
    """
    times, speed, around = 0.02 * np.arange(101), np.deg2rad(500.0), 8.0 * np.pi
    rates = speed * np.column_stack([np.cos(around * times), np.sin(around * times), np.zeros(101)])
    true = Rotation.identity()
    for before, after in pairwise(rates / (1.0 + scale)):
        for share in (np.arange(40) + 0.5) / 40:
            true = true * Rotation.from_rotvec(((1.0 - share) * before + share * after) * 0.02 / 40)
    inverse = scale / (1.0 + scale) * np.eye(3)
    for up in np.eye(3):
        turn = Turn(times, rates, up, true.inv().apply(up), 0.0, 0.0, 0.0)
        rows, limits = _slabs(turn, GyroBounds(noise=0.0, scale_error=0.31), np.inf, inverse, 0.0)
        assert (rows @ inverse.ravel() <= limits).all()


def test_a_turn_bounds_what_it_shows_along_lines_that_differ():
    (turn,) = recorded(8, GOOD, np.zeros((3, 3)), count=1)
    rows, _ = _slabs(turn, GOOD, np.inf, np.zeros((3, 3)), 0.02)
    assert len(np.unique(rows.round(9), axis=0)) == len(rows) == 16


def test_few_or_coarse_turns_leave_what_is_stated():
    coarse = GyroBounds(noise=0.02, bias=0.005, scale_error=0.02, increment=0.004)
    found = gyro_set(recorded(5, coarse, np.zeros((3, 3)), angle=0.04, count=3), coarse)
    assert found.scale_error == 0.02
    assert found.noise_factor == 1.0
    np.testing.assert_array_equal(found.matrix, np.eye(3))
    assert gyro_set([], coarse).scale_error == 0.02


def test_a_scale_beyond_what_is_stated_is_a_contradiction():
    with pytest.raises(ContradictionError, match=r"0\.00 to 2\.00 s.*degrees apart"):
        gyro_set(recorded(6, GOOD, 0.08 * np.eye(3)), GOOD)


def test_rates_with_the_wrong_sign_are_a_contradiction():
    with pytest.raises(ContradictionError):
        gyro_set(recorded(7, GOOD, -2.0 * np.eye(3)), GOOD)


def test_noise_adds_up_beyond_the_windows_that_its_increment_is_stated_for():
    """Five windows in a row, in each of which the noise adds up to all that it may; nothing else is wrong."""
    gyro = GyroBounds(noise=1e-3, scale_error=1e-6, increment=5e-3)
    times = np.linspace(0.0, 60.0, 6001)
    rates = np.tile([0.999 * gyro.increment / 12.0, 0.0, 0.0], (6001, 1))
    up = np.array([0.0, 0.0, 1.0])
    turn = Turn(times, rates, up, up, 1e-6, 1e-6, 0.0)
    assert gyro_set([turn], gyro, 12.0).scale_error == 1e-6
    with pytest.raises(ContradictionError):
        gyro_set([turn], gyro)
