"""An hour of Fermi: the recorded attitude inside at every sample, with bounds that were not made for it."""

import numpy as np
import pytest
from elliptude import estimation
from elliptude.bounds.gyro import GyroBounds
from elliptude.logs import log as logs
from elliptude.simulation import fermi
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def recorded():
    return fermi.telemetry()


def run(recorded, **options):
    log = logs.log_of(fermi.measurements(recorded, **options))
    return log, estimation.estimate(log, fermi.configuration()).result


@pytest.fixture(scope="module")
def sun_alone(recorded):
    return run(recorded, star_until=1)


@pytest.fixture(scope="module")
def with_star(recorded):
    return run(recorded)


def test_the_stretch_has_what_its_readme_says(recorded):
    steps = np.diff(recorded.met)
    assert len(recorded.met) == 3600
    assert recorded.met[-1] - recorded.met[0] == pytest.approx(3600, abs=1)
    np.testing.assert_allclose(np.sort(steps)[[0, -1]], [0.8, 2.0], atol=1e-5)
    np.testing.assert_allclose(np.sort(steps)[1:-1], 1.0, atol=1e-4)
    rates = np.rad2deg(np.linalg.norm(recorded.angular_velocities, axis=1))
    assert 0.36 < rates.max() < 0.37
    np.testing.assert_allclose(np.linalg.norm(recorded.quaternions, axis=1), 1.0, atol=1e-9)


def test_the_bound_of_the_rate_covers_what_it_stands_for(recorded):
    """The mean of two samples against the turn between the recorded attitudes: manoeuvres and gaps included."""
    attitudes = Rotation.from_quat(recorded.quaternions, scalar_first=True)
    turns = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec() / np.diff(recorded.met)[:, None]
    rates = logs.interval_rates(recorded.angular_velocities)[:-1]
    errors = np.rad2deg(np.linalg.norm(turns - rates, axis=1))
    assert errors.max() < 0.003
    assert fermi.configuration().flow.noise_deg_per_s == 0.005


def test_star_is_within_its_bound(recorded):
    log = fermi.measurements(recorded)
    attitudes = Rotation.from_quat(recorded.quaternions, scalar_first=True)
    star = attitudes.apply(log.directions[:, 1])
    angles = np.rad2deg(np.arccos(np.clip((star * log.references[:, 1]).sum(axis=1), -1.0, 1.0)))
    assert 0.9 < angles.max() <= fermi.STAR_BOUND_DEG
    again = fermi.measurements(recorded, seed=1)
    assert not np.array_equal(log.directions[:, 1], again.directions[:, 1])
    np.testing.assert_array_equal(log.directions[:, 0], again.directions[:, 0])


def test_sun_alone_knows_less_and_less_about_the_sun_line(sun_alone):
    log, results = sun_alone
    assert results.used[0] == "sun star"
    assert set(results.used[1:]) == {"sun"}
    assert (results.forms <= 1.0).all()
    about, across = np.rad2deg(fermi.half_widths_about(results, log.references[:, 0]))
    # Nothing bounds the turn about the Sun but the start and the rate: 0.005 deg/s, 18 degrees in an hour at the least.
    assert (np.diff(about[::100]) > 0).all()
    assert 18.0 < about[-1] < 35.0
    assert across.max() < 7.5


def test_a_second_direction_bounds_all_axes(with_star):
    log, results = with_star
    assert set(results.used) == {"sun star"}
    assert (results.forms <= 1.0).all()
    assert np.rad2deg(results.largest_angles).max() < 5.0
    about, across = fermi.half_widths_about(results, log.references[:, 0])
    np.testing.assert_array_less(np.maximum(about, across), results.largest_angles * (1 + 1e-9))


@pytest.mark.parametrize("seed", range(1, 6))
def test_other_draws_of_the_star(recorded, seed):
    _, results = run(recorded, seed=seed)
    assert (results.forms <= 1.0).all()
    assert np.rad2deg(results.largest_angles).max() < 5.0


def test_half_widths_about_a_line(with_star):
    """Against the support function, along the line and in many directions across it."""
    log, results = with_star
    about, across = fermi.half_widths_about(results, log.references[:, 0])
    for k in (0, 1000, 3599):
        line = results.attitudes[k].T @ log.references[k, 0]
        shape = results.shapes[k, :3, :3]
        assert about[k] == pytest.approx(np.sqrt(line @ shape @ line))
        first = np.linalg.svd(line[None])[2][1:]
        angles = np.linspace(0, np.pi, 1000)
        directions = np.cos(angles)[:, None] * first[0] + np.sin(angles)[:, None] * first[1]
        widths = np.sqrt(np.einsum("ni,ij,nj->n", directions, shape, directions))
        assert across[k] == pytest.approx(widths.max(), rel=1e-5)


def test_increment_bound_of_the_gyro():
    """Any window's noise integrates to at most 0.2°: the recorded turns hold, far within what 0.005 °/s would allow."""
    recorded = fermi.telemetry()
    attitudes = Rotation.from_quat(recorded.quaternions, scalar_first=True)
    per_sample = GyroBounds(noise=np.deg2rad(0.005))
    with_increments = GyroBounds(noise=np.deg2rad(0.005), increment=np.deg2rad(0.2))
    times = recorded.met - recorded.met[0]
    for duration, gain in ((16.0, 1.0), (256.0, 0.25), (1024.0, 0.1)):
        turns = with_increments.anchored_turns(times, recorded.angular_velocities, duration)
        rows = np.arange(1, len(times))
        spans = times[rows] - times[turns.anchors[rows]]
        shown = Rotation.from_rotvec(turns.rates[rows] * spans[:, None])
        true = attitudes[turns.anchors[rows]].inv() * attitudes[rows]
        bounds = turns.noise[rows] * spans
        assert ((shown.inv() * true).magnitude() <= bounds).all()
        linear = per_sample.anchored_turns(times, recorded.angular_velocities, duration).noise[rows] * spans
        whole = spans > 0.95 * duration
        assert (bounds <= linear * (1.0 + 1e-12)).all()
        # Where the spacecraft turns far within a window, less is gained.
        assert np.median(bounds[whole] / linear[whole]) <= gain
