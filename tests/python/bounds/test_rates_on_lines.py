"""What a rate on straight lines between samples turns beside its mean in each step. Theory, (18.49) and (18.50)."""

import itertools

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.matrix_effects import chord_errors, scale_effects
from elliptude.bounds.turns import attitudes_from_rates, coning_angles
from elliptude.bounds.windows import MotionBounds, gravity_bounds_over_windows
from inputs import angle_between
from scipy.spatial.transform import Rotation


def turn_on_a_line(step, begin, end, pieces=4000):
    """The turn of a rate on the line from one vector to another, in many pieces of one rate each."""
    middles = (np.arange(pieces) + 0.5) / pieces
    rates = begin + np.outer(middles, end - begin)
    total = Rotation.identity()
    for vector in step / pieces * rates:
        total = total * Rotation.from_rotvec(vector)
    return total


@pytest.mark.parametrize("seed", range(40))
def test_one_step(seed):
    draws = np.random.default_rng(seed)
    step = 10.0 ** draws.uniform(-3.0, -0.3)
    begin, end = (draws.uniform(0.2, 2.0) / step * 0.5 * one / np.linalg.norm(one) for one in draws.normal(size=(2, 3)))
    mean = Rotation.from_rotvec(0.5 * step * (begin + end))
    off = (mean.inv() * turn_on_a_line(step, begin, end)).magnitude()
    (bound,) = coning_angles(np.array([step]), np.stack([begin, end]))
    assert off <= bound * (1.0 + 1e-6)
    assert off >= 0.5 * bound


def test_a_short_step_attains_it():
    step, begin, end = 0.01, np.array([5.0, 0.0, 0.0]), np.array([5.0, 1.0, 0.0])
    off = (Rotation.from_rotvec(0.5 * step * (begin + end)).inv() * turn_on_a_line(step, begin, end)).magnitude()
    (bound,) = coning_angles(np.array([step]), np.stack([begin, end]))
    assert 0.998 * bound <= off <= bound


@pytest.mark.parametrize("seed", range(20))
def test_the_integral_with_a_matrix(seed):
    """∫ C K ω on the line, against the chord that `scale_effects` takes; C begins as it is carried."""
    draws = np.random.default_rng(seed)
    step, pieces = 0.05, 2000
    begin, end = draws.normal(scale=draws.uniform(1.0, 12.0), size=(2, 3))
    matrix = np.linalg.qr(draws.normal(size=(3, 3)))[0]
    carried, exact = Rotation.identity(), np.zeros(3)
    for share in (np.arange(pieces) + 0.5) / pieces:
        rate = begin + share * (end - begin)
        half = Rotation.from_rotvec(0.5 * step / pieces * rate)
        exact += step / pieces * (carried * half).apply(matrix @ rate)
        carried = carried * half * half
    rates, steps = np.stack([begin, end]), np.array([step])
    effects, _ = scale_effects(steps, attitudes_from_rates(steps, rates), rates)
    off = np.linalg.norm(effects[-1] @ matrix.ravel() - exact)
    turned = step * 0.5 * np.linalg.norm(begin + end)
    assert off <= chord_errors(steps, rates)[0] + coning_angles(steps, rates)[0] * turned + 1e-9


CONE, ROUND, STEP = np.deg2rad(500.0), 2.0 * np.pi * 4.0, 0.02


def coning():
    """Exact samples of a rate whose axis goes round, and the attitudes if it is on lines between them."""
    times = STEP * np.arange(101)
    rates = CONE * np.stack([np.cos(ROUND * times), np.sin(ROUND * times), np.zeros(101)], axis=1)
    true = [Rotation.identity()]
    for begin, end in itertools.pairwise(rates):
        true.append(true[-1] * turn_on_a_line(STEP, begin, end, 200))
    return times, rates, Rotation.concatenate(true)


@pytest.mark.parametrize("scale_error", [0.0, 1e-9])
def test_turns_from_anchors(scale_error):
    times, rates, true = coning()
    gyro = GyroBounds(0.0, scale_error=scale_error)
    turns = gyro.anchored_turns(times, rates, 1.0)
    spans = times - times[turns.anchors]
    shown = Rotation.from_rotvec(turns.rates * spans[:, None])
    off = ((true[turns.anchors].inv() * true).inv() * shown).magnitude()
    assert (off <= turns.angles + 1e-9).all()
    assert off[50] >= 0.9 * turns.angles[50]
    whole = Rotation.from_matrix(attitudes_from_rates(np.diff(times), rates)[-1])
    assert gyro.window_angle(times, rates) >= (true[-1].inv() * whole).magnitude()


@pytest.mark.parametrize("scale_error", [0.0, 1e-9])
@pytest.mark.parametrize("at", ["end", "middle"])
def test_means_over_windows(at, scale_error):
    """An exact accelerometer at rest in its place: all of the error is that of the frame that is carried along."""
    times, rates, true = coning()
    forces = true.inv().apply([0.0, 0.0, 9.80665])
    bounds = gravity_bounds_over_windows(
        times,
        forces,
        rates,
        [0.5],
        motion=MotionBounds(acceleration=0.0),
        gyro=GyroBounds(0.0, scale_error=scale_error),
        at=at,
    )
    ups = true.inv().apply([0.0, 0.0, 1.0])
    off = np.array([angle_between(*pair) for pair in zip(bounds.directions, ups, strict=True)])
    assert not bounds.contradicted.any()
    there = ~np.isnan(bounds.angles)
    assert (off[there] <= bounds.angles[there]).all()
    assert off[50] >= (0.2 if at == "end" else 0.02) * bounds.angles[50]
