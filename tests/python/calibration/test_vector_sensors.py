"""Sets of a vector sensor's parameters: the true ones are in them, and what is said to be left is never exceeded."""

from dataclasses import replace

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.turns import attitudes_from_rates
from elliptude.calibration.parameter_sets import ParameterSet, covering_directions, small_ball
from elliptude.calibration.poses import poses_of, windows_of
from elliptude.calibration.vector_sensors import (
    ContradictionError,
    SensorStatements,
    offset_supports,
    proposal,
    sensor_set,
    stretch_error,
)
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

GYRO = GyroBounds(noise=0.01, bias=0.003, scale_error=0.01)


class Recorded:
    """A sensor that tumbles for a minute in a known field, with errors that use up their bounds."""

    def __init__(self, seed, stated, offset, stretch, adversary):
        rng = np.random.default_rng(seed)
        self.stated = stated
        self.times = np.arange(6000) / 100.0
        phases = rng.uniform(0.0, 6.28, 3)
        rates = 1.2 * np.stack(
            [np.sin(0.31 * self.times + p) + q for p, q in zip(phases, (0.3, -0.2, 0.1), strict=True)], 1
        )
        attitudes = attitudes_from_rates(np.diff(self.times), rates)
        self.strength = rng.uniform(stated.least, stated.greatest)
        field = rng.normal(size=3)
        field *= self.strength / np.linalg.norm(field)
        axis = rng.normal(size=3)
        turned = Rotation.from_rotvec(0.4 * stated.axes_error * axis / np.linalg.norm(axis)).as_matrix()
        self.sensor = (np.eye(3) + stretch) @ turned
        self.offset = offset
        disturbance = np.tile(adversary * stated.disturbance, (6000, 1))
        true = np.einsum("nji,j->ni", attitudes, field) + disturbance
        noise = np.tile(rng.normal(size=3), (6000, 1))
        noise *= stated.averaged_noise / np.linalg.norm(noise, axis=1, keepdims=True)
        self.vectors = true @ self.sensor.T + offset + noise
        # What the gyro shows is within its bounds of the truth.
        self.rates = rates * 1.008 + 0.002

    def poses(self):
        count = len(self.times)
        return poses_of(
            windows_of(self.times, 0.5), self.times, self.vectors, self.rates, np.zeros(count), GYRO,
            self.stated.axes_error, lambda _: self.stated.disturbance,
        )  # fmt: skip


def stated(**changes):
    numbers = {
        "offset": 2.0, "scale_error": 0.01, "noise": 0.3, "averaged_noise": 0.1, "least": 40.0, "greatest": 55.0,
        "disturbance": 0.3,
    }  # fmt: skip
    return SensorStatements(**(numbers | changes))


def symmetric(rng, size):
    matrix = rng.normal(size=(3, 3))
    matrix = matrix + matrix.T
    return size * matrix / np.linalg.norm(matrix, 2)


def unit(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


CASES = {
    "offset": {},
    "hard iron": {"offset": 60.0, "scale_error": 0.02, "least": 49.0, "greatest": 50.0},
    "soft iron": {"offset": 20.0, "scale_error": 0.1, "least": 49.9, "greatest": 50.1, "misalignment": 0.002},
    "gravity": {"offset": 0.3, "scale_error": 0.02, "noise": 0.2, "averaged_noise": 0.01, "least": 9.79,
                "greatest": 9.83, "disturbance": 0.02, "misalignment": 0.001},
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", range(2))
def test_what_is_left_is_never_exceeded(case, seed):
    rng = np.random.default_rng(100 + seed)
    said = stated(**CASES[case])
    # A disturbance that turns with the body looks like an offset: nothing is worse.
    recorded = Recorded(seed, said, 0.9 * said.offset * unit(rng), symmetric(rng, 0.55 * said.scale_error), unit(rng))
    found = sensor_set(recorded.poses(), said)
    assert np.all(found.lowest <= recorded.offset)
    assert np.all(recorded.offset <= found.highest)
    assert found.offset_error <= said.offset
    true = said.greatest * np.array([unit(rng) for _ in range(500)])
    noise = said.noise * np.array([unit(rng) for _ in range(500)])
    corrected = (true @ recorded.sensor.T + recorded.offset + noise - found.offset) @ found.matrix.T
    error = np.linalg.norm(corrected - true, axis=1)
    bound = found.scale_error * said.greatest + found.offset_error + (1.0 + found.stretch) * said.noise
    assert error.max() <= bound
    # The polar factor of the sensor: what the set is of.
    left = np.linalg.norm(found.matrix @ (recorded.offset - found.offset))
    assert left <= found.offset_error
    assert np.linalg.norm(recorded.offset - found.offset) <= found.offset_distance


def test_the_bound_of_the_offset_is_attained_within_a_factor_of_two():
    """A disturbance that turns with the body moves the offset that fits best; both ends are in the set."""
    shares = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        said = stated(least=49.99, greatest=50.01, scale_error=0.0, offset=5.0)
        recorded = Recorded(seed, said, np.zeros(3), np.zeros((3, 3)), unit(rng))
        found = sensor_set(recorded.poses(), said)
        shares.append(np.linalg.norm(found.offset) / found.offset_error)
    assert max(shares) <= 1.0
    assert max(shares) >= 0.5


@pytest.mark.parametrize("scale_error", [0.3, 0.45])
def test_the_true_offset_is_as_near_as_is_said(scale_error):
    """What is left in a corrected sample is shorter than the offset itself is off, where the sensor shows too much."""
    rng = np.random.default_rng(16)
    vectors = np.array([unit(rng) for _ in range(60)])
    shown = 50.0 * np.concatenate([vectors, -vectors]) + np.array([0.4999, 0.0, 0.0])  # turns with the body
    changes = {"offset": 3.0, "scale_error": scale_error, "disturbance": 0.5, "misalignment": 0.0}
    poses = still((1.0 + scale_error) * shown, GyroBounds(noise=0.0), disturbance=0.5)
    found = sensor_set(poses, SensorStatements(**(NOTHING | changes)))
    assert np.linalg.norm(found.matrix @ found.offset) <= found.offset_error
    assert found.offset_error < np.linalg.norm(found.offset) <= found.offset_distance < changes["offset"]


def test_a_wrong_sign_of_the_correction_would_be_seen():
    said = stated(**CASES["hard iron"])
    recorded = Recorded(1, said, np.array([30.0, -20.0, 10.0]), np.zeros((3, 3)), np.array([1.0, 0.0, 0.0]))
    found = sensor_set(recorded.poses(), said)
    np.testing.assert_allclose(found.offset, recorded.offset, atol=2.0)
    assert found.offset_error < 3.0


def test_corrections_pay_where_they_can():
    rng = np.random.default_rng(5)
    said = stated(**CASES["soft iron"])
    recorded = Recorded(5, said, 10.0 * unit(rng), symmetric(rng, 0.08), 0.1 * unit(rng))
    found = sensor_set(recorded.poses(), said)
    assert not np.array_equal(found.matrix, np.eye(3))
    assert found.scale_error < 0.5 * said.scale_error


def test_what_is_not_shown_stays_as_stated():
    """A sensor that turns about one axis alone shows nothing of the offset along the field's part on that axis."""
    said = stated(disturbance=0.1, least=20.0, greatest=70.0)
    recorded = Recorded(2, said, np.array([0.5, -0.3, 0.2]), np.zeros((3, 3)), np.array([0.0, 1.0, 0.0]))
    still = sensor_set(recorded.poses()[:1], said)
    assert not still.is_correction
    assert still.offset_error == said.offset
    assert still.offset_distance == said.offset
    assert still.scale_error == said.scale_error
    np.testing.assert_array_equal(still.highest, said.offset)
    nothing = sensor_set([], said)
    assert nothing.poses == 0
    assert nothing.offset_error == said.offset


def test_a_disturbance_that_may_hide_the_offset_leaves_all_of_it():
    """(19.12): where the field may be off by more than the offset, no method finds the offset."""
    said = stated(disturbance=5.0)
    recorded = Recorded(3, said, np.array([0.5, -0.3, 0.2]), np.zeros((3, 3)), np.zeros(3))
    found = sensor_set(recorded.poses(), said)
    assert not found.is_correction
    assert found.offset_error == said.offset
    assert found.spare > 3.0


def test_samples_that_contradict_all_parameters_are_named():
    said = stated()
    recorded = Recorded(4, said, np.array([0.5, -0.3, 0.2]), np.zeros((3, 3)), np.zeros(3))
    recorded.vectors[2000:2100] *= 1.2
    with pytest.raises(ContradictionError, match=r"2\d\.\d\d to 2\d\.\d\d s.*disagree by at least [\d.]+"):
        sensor_set(recorded.poses(), said)


def test_a_stated_bound_that_is_too_small_is_a_contradiction_by_as_much():
    said = stated(offset=0.1, least=49.9, greatest=50.1)
    recorded = Recorded(6, said, np.array([3.0, 0.0, 0.0]), np.zeros((3, 3)), np.zeros(3))
    with pytest.raises(ContradictionError):
        sensor_set(recorded.poses(), said)


def test_the_proposal_is_within_what_is_stated():
    said = stated()
    recorded = Recorded(7, said, np.array([0.5, -0.3, 0.2]), np.zeros((3, 3)), np.zeros(3))
    theta = proposal(recorded.poses(), said)
    np.testing.assert_allclose(theta[:3], recorded.offset, atol=0.5)


def test_supports_are_proved_and_tight():
    rng = np.random.default_rng(8)
    for _ in range(20):
        rows, inside = rng.normal(size=(30, 5)), rng.uniform(-1.0, 1.0, 5)
        limits = rows @ inside + rng.uniform(0.0, 1.0, 30)
        found = ParameterSet(np.full(5, -2.0), np.full(5, 2.0), rows, limits)
        c = rng.normal(size=5)
        exact = -linprog(-c, A_ub=rows, b_ub=limits, bounds=(-2.0, 2.0)).fun
        assert exact - 1e-9 <= found.support(c) <= exact + 1e-6
        assert found.support(c) >= c @ inside


def test_an_empty_set_is_proved_to_be():
    rows = np.array([[1.0, 0.0], [-1.0, 0.0]])
    found = ParameterSet(np.full(2, -5.0), np.full(2, 5.0), rows, np.array([1.0, -3.0]))
    short = found.shortfall(0, np.ones(2))
    assert short.least == pytest.approx(1.0)
    assert short.least <= 1.0
    assert short.needed == pytest.approx(1.0)
    room = ParameterSet(np.full(2, -5.0), np.full(2, 5.0), rows, np.array([3.0, -1.0])).shortfall(0, np.ones(2))
    assert room.needed == pytest.approx(-1.0)


def test_directions_cover_the_sphere():
    directions, cosine = covering_directions()
    assert directions.shape == (162, 3)
    np.testing.assert_array_equal(directions[81:], -directions[:81])
    rng = np.random.default_rng(9)
    nearest = np.array([np.max(directions @ unit(rng)) for _ in range(20000)])
    assert cosine <= nearest.min() <= cosine + 0.002


def test_the_small_ball_holds_a_cloud():
    directions, cosine = covering_directions()
    rng = np.random.default_rng(10)
    points = np.array([3.0, -1.0, 0.0]) + rng.normal(size=(50, 3))
    center, radius = small_ball(directions, cosine, (points @ directions.T).max(axis=0))
    farthest = np.linalg.norm(points - center, axis=1).max()
    assert farthest <= radius <= 1.2 * farthest


def still(vectors, gyro, rates=None, axes_error=0.0, disturbance=0.0):
    """Poses in which the sensor shows one vector each for half a second, and the gyro these rates."""
    times = np.linspace(0.0, 0.5, 51)
    found = []
    for i, vector in enumerate(vectors):
        shown = np.tile(np.zeros(3) if rates is None else rates[i], (51, 1))
        found += poses_of(
            [slice(0, 51)],
            times,
            np.tile(vector, (51, 1)),
            shown,
            np.zeros(51),
            gyro,
            axes_error,
            lambda _: disturbance,
        )
    return found


NOTHING = {"offset": 0.0, "scale_error": 0.0, "noise": 0.0, "averaged_noise": 0.0, "least": 50.0, "greatest": 50.0,
           "disturbance": 0.0}  # fmt: skip


def edge(term):
    """Poses of which one error alone is as large as it is, and how that is stated, times a factor."""
    rng = np.random.default_rng(11)
    true = 50.0 * np.array([unit(rng) for _ in range(12)])
    exact = GyroBounds(noise=0.0)
    if term == "disturbance":
        return lambda x: (still(1.01 * true, exact, disturbance=0.5 * x), {"disturbance": 0.5 * x})
    if term == "disturbance, inward":
        return lambda x: (still(0.99 * true, exact, disturbance=0.5 * x), {"disturbance": 0.5 * x})
    if term == "averaged noise":
        return lambda x: (still(1.01 * true, exact), {"noise": 0.5 * x, "averaged_noise": 0.5 * x})
    if term == "offset":
        return lambda x: (still(true + np.array([0.3, 0.0, 0.4]), exact), {"offset": 0.5 * x})
    if term == "scale":
        return lambda x: (still(1.02 * true, exact), {"scale_error": 0.02 * x})
    if term == "scale, inward":
        return lambda x: (still(0.98 * true, exact), {"scale_error": 0.02 * x})
    if term == "soft iron":
        return lambda x: (still(true @ np.diag([1.05, 0.95, 1.0]), exact), {"scale_error": 0.05 * x})
    if term == "strength":
        return lambda x: (still(1.02 * true, exact), {"greatest": 50.0 + x})
    assert term == "turn"
    # The gyro says that the body turns across the vector: the mean is shorter by the square of the turn.
    across = np.cross(true, [0.3, 0.2, -0.5])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return lambda x: (still(true, GyroBounds(noise=0.0, bias=x), across), {})


TERMS = [
    "disturbance",
    "disturbance, inward",
    "averaged noise",
    "offset",
    "scale",
    "scale, inward",
    "strength",
    "turn",
    "soft iron",
]


@pytest.mark.parametrize("term", TERMS)
def test_each_term_holds_at_its_edge_and_is_needed(term):
    poses, at_edge = edge(term)(1.001)
    sensor_set(poses, SensorStatements(**(NOTHING | at_edge)))
    poses, below = edge(term)(0.9)
    with pytest.raises(ContradictionError):
        sensor_set(poses, SensorStatements(**(NOTHING | below)))


def test_a_disturbance_that_averages_out_does_not_in_a_frame_that_is_off():
    """It changes its sign with the frame's error, so that all of it points along the vector."""
    times = np.linspace(0.0, 0.5, 501)
    signs = np.sign(times - 0.25)
    vectors = np.array([50.0, 0.0, 0.0]) + 10.0 * signs[:, None] * np.array([0.0, -1.0, 0.0])
    rates = np.tile([0.0, 0.0, 0.08], (501, 1))

    def poses(bias):
        gyro = GyroBounds(noise=0.0, bias=bias)
        return poses_of([slice(0, 501)], times, vectors, rates, np.zeros(501), gyro, 0.0, lambda _: 0.0)

    sensor_set(poses(0.0801), SensorStatements(**(NOTHING | {"disturbance": 10.0})))
    with pytest.raises(ContradictionError):
        sensor_set(poses(0.07), SensorStatements(**(NOTHING | {"disturbance": 10.0})))


def test_noise_that_averages_out_does_not_in_a_frame_that_is_off():
    """A body at rest, and a gyro that is off by its bias: the noise has no mean where it is, but one in that frame."""
    times = np.linspace(0.0, 10.0, 1001)
    bias, strength, noise = np.deg2rad(0.25), 9.807, 0.4
    gyro = GyroBounds(noise=0.0, bias=bias)
    found = []
    for up in np.concatenate([np.eye(3), -np.eye(3)]):
        axis = np.roll(np.abs(up), 1)
        errors = -noise * np.sign(times - 5.0)[:, None] * np.cross(axis, up)
        assert np.linalg.norm(errors.mean(axis=0)) < 1e-12
        rates = np.tile(bias * axis, (1001, 1))
        found += poses_of(
            [slice(0, 1001)], times, strength * up + errors, rates, np.zeros(1001), gyro, 0.0, lambda _: 0.0
        )
    said = SensorStatements(
        offset=0.2, scale_error=1e-4, noise=noise, averaged_noise=1e-6, least=strength, greatest=strength,
        disturbance=0.0, averaged_over=10.0,
    )  # fmt: skip
    left = sensor_set(found, said)
    assert np.all(left.lowest <= 0.0)
    assert np.all(left.highest >= 0.0)
    # As much as the turns, 0.6 degrees in the mean, make of it: with half of that nothing agrees.
    with pytest.raises(ContradictionError):
        sensor_set(found, replace(said, noise=0.5 * noise))


def test_the_gyro_drifts_from_where_its_bias_was_known():
    """A body that stands still 500 s later: the carried frame turns by the drift."""
    times = np.append(0.0, 500.0 + np.linspace(0.0, 0.5, 501))
    vectors, rates = np.tile([0.0, 0.0, 9.8], (502, 1)), np.zeros((502, 3))
    drift = 1e-4
    gyro = GyroBounds(noise=0.0, bias=0.0, drift=drift)
    (pose,) = poses_of([slice(1, 502)], times, vectors, rates, np.zeros(502), gyro, 0.0, lambda _: 0.0)
    # The mean of |t| over half a second about the middle is an eighth of a second.
    assert pose.turn == pytest.approx(drift * 500.25 * 0.125, rel=1e-3)


def test_noise_that_averages_out_does_not_where_the_scale_is_off():
    """The body turns by half a turn, and the noise with it, so that P - I turns all of it into one direction."""
    times = np.linspace(0.0, 0.5, 1001)
    angles = 2.0 * np.pi * (times - 0.25)
    zero = np.zeros_like(angles)
    x, noise = np.array([50.0, 0.0, 0.0]), 0.5
    true = np.stack([50.0 * np.cos(angles), -50.0 * np.sin(angles), zero], axis=1)  # Rᵀ x
    errors = noise * np.stack([np.cos(angles), np.sin(angles), zero], axis=1)
    rates = np.tile([0.0, 0.0, 2.0 * np.pi], (1001, 1))
    kappa = 0.1 / 0.9
    sensor = np.diag([1.0 / (1.0 + kappa), 1.0 / (1.0 - kappa), 1.0])
    found = poses_of(
        [slice(0, 1001)],
        times,
        true @ sensor + errors,
        rates,
        np.zeros(1001),
        GyroBounds(noise=0.0),
        0.0,
        lambda _: 0.0,
    )
    mean = np.einsum("apq,pq->a", found[0].products, np.linalg.inv(sensor)) - x
    np.testing.assert_allclose(mean, [kappa * noise, 0.0, 0.0], atol=1e-3)
    rng = np.random.default_rng(12)
    found += still([50.0 * unit(rng) @ sensor for _ in range(20)], GyroBounds(noise=0.0))
    said = SensorStatements(**(NOTHING | {"noise": noise, "averaged_noise": 1e-3, "scale_error": 0.125}))
    sensor_set(found, said)


def one_parameter(offset, stretch):
    """The set that is one point: p, P - I and F."""
    entries = [stretch[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    theta = np.concatenate([offset, entries, [50.0]])
    return ParameterSet(theta, theta, np.zeros((0, 10)), np.zeros(0))


def test_offsets_are_counted_about_the_center():
    """uᵀ(p - P center), (19.8)."""
    rng = np.random.default_rng(13)
    directions, _ = covering_directions()
    for _ in range(3):
        offset, stretch, center = rng.normal(size=3), symmetric(rng, 0.2), 5.0 * rng.normal(size=3)
        expected = directions @ (offset - (np.eye(3) + stretch) @ center)
        np.testing.assert_allclose(
            offset_supports(one_parameter(offset, stretch), directions, center), expected, rtol=1e-9, atol=1e-9
        )


def test_the_error_of_a_stretch_covers_every_direction():
    """Also where the largest eigenvalue's vector is as far from all directions as it can be, (19.10)."""
    directions, cosine = covering_directions()
    rng = np.random.default_rng(14)
    vectors = np.array([unit(rng) for _ in range(3000)])
    far = vectors[np.argmin((vectors @ directions.T).max(axis=1))]
    stretch = 0.1 * (2.0 * np.outer(far, far) - np.eye(3))
    found = stretch_error(one_parameter(np.zeros(3), stretch), np.eye(3))
    assert 0.1 <= found <= 0.1 / (2.0 * cosine**2 - 1.0) * 1.001


def test_a_turn_of_the_axes_is_not_seen_and_is_counted():
    rng = np.random.default_rng(15)
    turn = Rotation.from_rotvec(0.05 * unit(rng)).as_matrix()
    vectors = 50.0 * np.array([unit(rng) for _ in range(30)])
    said = SensorStatements(**(NOTHING | {"scale_error": 0.12, "misalignment": 0.05}))
    found = sensor_set(still(vectors @ turn.T, GyroBounds(noise=0.0)), said)
    assert np.linalg.norm(found.matrix @ turn - np.eye(3), 2) <= found.scale_error < 0.06
