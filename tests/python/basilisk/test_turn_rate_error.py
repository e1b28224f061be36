"""A turn's vector over its time is near the mean of the rate: motions integrated by SciPy."""

import numpy as np
import pytest
from elliptude.basilisk import turn_rate_error
from scipy.spatial.transform import Rotation

PIECES = 1000


def difference(rate, step):
    """Between the turn over `step` divided by it, and the mean of a rate that is given at instants (PIECES, 3)."""
    turns = Rotation.from_rotvec(rate * (step / PIECES))
    while len(turns) > 1:  # the product of all, in order
        if len(turns) % 2:
            turns = Rotation.concatenate([turns, Rotation.identity()])
        turns = turns[::2] * turns[1::2]
    return np.linalg.norm(turns[0].as_rotvec() / step - rate.mean(axis=0))


def motions(step, largest_rate, acceleration, random):
    """Rates that change as fast as they may: on a line, in circles, and at random."""
    time = (np.arange(PIECES) + 0.5) / PIECES * step
    for turns in (0, 1, 3):
        across, other = np.linalg.qr(random.normal(size=(3, 3)))[0][:2]
        if turns == 0:
            wander = acceleration * (time - step / 2)[:, None] * across
        else:
            frequency = 2 * np.pi * turns / step
            wander = (
                acceleration
                / frequency
                * (np.cos(frequency * time)[:, None] * across + np.sin(frequency * time)[:, None] * other)
            )
        mean = np.cross(across, other) * (largest_rate - np.linalg.norm(wander, axis=1).max())
        yield mean + wander
    pieces = np.repeat(random.normal(size=(20, 3)), PIECES // 20, axis=0)
    pieces *= acceleration / np.linalg.norm(pieces, axis=1, keepdims=True)
    wander = np.cumsum(pieces, axis=0) * step / PIECES
    wander -= wander.mean(axis=0)
    mean = random.normal(size=3)
    yield wander + mean / np.linalg.norm(mean) * (largest_rate - np.linalg.norm(wander, axis=1).max())


@pytest.mark.parametrize(
    ("step", "largest_rate", "acceleration"),
    [(1.0, 0.015, 1e-3), (0.5, 2.0, 1.0), (0.1, 10.0, 30.0), (1.0, 1.5, 1.0), (0.01, 3.0, 100.0)],
)
def test_the_difference_is_within_the_bound(step, largest_rate, acceleration):
    random = np.random.default_rng(5)
    bound = turn_rate_error(step, largest_rate, acceleration)
    shares = [
        difference(rate, step) / bound
        for _ in range(5)
        for rate in motions(step, largest_rate, acceleration, random)
        if np.linalg.norm(rate, axis=1).max() <= largest_rate * (1 + 1e-12)
    ]
    assert len(shares) > 10
    assert max(shares) <= 1.0
    assert max(shares) > 0.3  # not much more than can happen


def test_a_rate_that_does_not_change_is_the_turn():
    assert turn_rate_error(1.0, 0.5, 0.0) == 0.0
    assert turn_rate_error(0.0, 0.5, 1.0) == 0.0
    assert turn_rate_error(1.0, 0.0, 0.0) == 0.0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((-1.0, 0.1, 0.1), "step must be finite and at least 0, not -1.0"),
        ((1.0, np.nan, 0.1), "largest_rate must be finite and at least 0, not nan"),
        ((1.0, 0.1, np.inf), "angular_acceleration must be finite and at least 0, not inf"),
        ((1.0, 3.2, 0.0), "a step of 1.0 s at 3.2 rad/s must be less than half a turn, not 3.2 rad"),
    ],
)
def test_what_is_wrong_is_named(arguments, says):
    with pytest.raises(ValueError, match=says):
        turn_rate_error(*arguments)
