"""One orbit in Basilisk: what is stated of it holds, the truth is in all sets, the controller relies on them."""

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("Basilisk", reason="no Basilisk: pip install 'elliptude[basilisk]'")

from Basilisk.architecture import bskLogging
from elliptude.basilisk import orbit
from elliptude.basilisk.orbit import Orbit
from scipy.spatial.transform import Rotation

ARC_SECOND = np.deg2rad(1.0 / 3600.0)


@pytest.fixture(scope="module", autouse=True)
def quiet():
    """Basilisk warns that errors are cut off at their bounds, which is what is wanted."""
    bskLogging.setDefaultLogLevel(bskLogging.BSK_ERROR)


@pytest.fixture(scope="module")
def flown():
    """The orbit, with recorders of the truth at each step of the dynamics and beside each sensor."""
    made = Orbit(step=0.1)
    state = made._spacecraft.scStateOutMsg
    recorders = {
        "motion": made._add("dynamics", state.recorder(), "motion", -2),
        "wheels": made._add("dynamics", made._wheels.rwSpeedOutMsg.recorder(), "wheel_speeds", -2),
        "tracker": made._add("tracker", made._tracker.sensorOutMsg.recorder(), "tracker_seen", -2),
        "tracker_truth": made._add("tracker", state.recorder(), "tracker_truth", -3),
        "gyro": made._add("gyro", made._gyro.sensorOutMsg.recorder(), "gyro_seen", -2),
        "gyro_truth": made._add("gyro", state.recorder(), "gyro_truth", -3),
        "sun": made._add("sun", made._sun_sensors.constellationOutMsg.recorder(), "sun_seen", -2),
        "sun_truth": made._add("sun", state.recorder(), "sun_truth", -3),
        "shadow": made._add("sun", made._shadow.recorder(), "shadow_then", -3),
    }
    made.execute()
    return made.recorded(), recorders


def test_the_truth_is_in_all_sets(flown):
    flight, _ = flown
    assert len(flight.times) == 5830
    assert flight.claims == ["unconditional"] * 5830
    assert flight.inside().all()
    forms = flight.forms()
    assert 0.2 < forms.max() < 1.0
    off = np.linalg.norm(flight.errors(), axis=1)
    assert (off <= flight.angles).all()
    np.testing.assert_allclose(
        off, (Rotation.from_matrix(flight.attitudes).inv() * Rotation.from_matrix(flight.true_attitudes)).magnitude(),
        atol=1e-12,
    )  # fmt: skip


def test_the_sets_are_as_small_as_the_page_says(flown):
    flight, _ = flown
    blind = (flight.times >= orbit.BLIND_FROM) & (flight.times <= orbit.BLIND_TO + orbit.TRACKER_STEP)
    assert np.median(flight.angles) == pytest.approx(115 * ARC_SECOND, rel=0.02)
    assert flight.angles[~blind].max() < 200 * ARC_SECOND
    assert flight.angles.max() == pytest.approx(4250 * ARC_SECOND, rel=0.02)


def test_the_controller_points_by_the_estimate(flown):
    flight, _ = flown
    settled = flight.pointing[:, 1][flight.pointing[:, 0] > 4000]
    assert flight.pointing[0, 1] > np.deg2rad(60.0)
    assert settled.max() < np.deg2rad(0.05)
    by_truth = Orbit(step=0.1, estimator=False)
    by_truth.execute(1500.0)
    # It does not do what it would do with the truth.
    with_truth = 4 * np.arctan(np.linalg.norm(by_truth._guidance.sigma_BR, axis=1))
    first = flight.pointing[: len(with_truth), 1]
    assert np.abs(first - with_truth).max() > 10 * ARC_SECOND
    assert np.abs(first - with_truth)[600:].max() < np.deg2rad(0.1)


def test_the_body_moves_no_faster_than_stated(flown):
    motion = flown[1]["motion"]
    assert np.linalg.norm(motion.omega_BN_B, axis=1).max() <= orbit.LARGEST_RATE
    assert np.linalg.norm(motion.omegaDot_BN_B, axis=1).max() <= orbit.largest_acceleration()
    step = np.diff(motion.omega_BN_B, axis=0) / 0.1
    assert 0.2 < np.linalg.norm(step, axis=1).max() / orbit.largest_acceleration() <= 1.0
    momenta = flown[1]["wheels"].wheelSpeeds[:, :3] * orbit.wheel_inertia()
    assert np.abs(momenta).max() <= orbit.WHEEL_MOMENTUM


def test_errors_are_within_their_bounds_and_reach_them(flown):
    seen = flown[1]
    tracker = Rotation.from_quat(seen["tracker"].qInrtl2Case[:, [1, 2, 3, 0]])
    errors = (tracker.inv() * Rotation.from_mrp(seen["tracker_truth"].sigma_BN)).as_rotvec()
    share = np.abs(errors).max(axis=0) / orbit.TRACKER_ERROR
    assert (share <= 1.0 + 1e-9).all()
    assert (share >= 0.999).all()
    attitudes = Rotation.from_mrp(seen["gyro_truth"].sigma_BN)
    turns = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec()
    errors = seen["gyro"].DRFramePlatform[1:] - turns - orbit.GYRO_BIAS * orbit.GYRO_STEP
    share = np.abs(errors).max(axis=0) / (orbit.GYRO_ERROR * orbit.GYRO_STEP)
    assert (share <= 1.0 + 1e-5).all()
    assert (share >= 0.999).all()
    assert np.linalg.norm(orbit.GYRO_BIAS) <= orbit.BIAS_BOUND
    suns = Rotation.from_mrp(seen["sun_truth"].sigma_BN).apply(orbit.SUN, inverse=True)
    true = np.maximum(suns @ orbit.SUN_NORMALS.T, 0.0) * seen["shadow"].shadowFactor[:, None]
    shown = seen["sun"].CosValue[:, :8]
    # Below zero nothing is shown; the Sun is farther from the spacecraft than from the Earth, or nearer.
    share = np.where(shown > 0.0, np.abs(shown - true), 0.0).max() / orbit.COSINE_ERROR
    assert 0.99 < share <= 1.0 + 2.0 * orbit.ORBIT_RADIUS / orbit.SUN_DISTANCE / orbit.COSINE_ERROR


@pytest.mark.parametrize("name", ["TRACKER_ERROR", "BIAS_BOUND"])
def test_with_bounds_that_do_not_hold_it_is_found_out(monkeypatch, name):
    """The estimator is told a fifth of a bound: measurements contradict, which stops the run."""
    made = Orbit.__new__(Orbit)
    add = Orbit._add_estimator

    def with_less(self):
        monkeypatch.setattr(orbit, name, getattr(orbit, name) / 5.0)
        return add(self)

    monkeypatch.setattr(Orbit, "_add_estimator", with_less)
    made.__init__(step=0.5)
    with pytest.raises(RuntimeError, match="UpdateState"):
        made.execute(1500.0)


def test_the_program_draws(tmp_path):
    out = tmp_path / "orbit.png"
    command = [sys.executable, "-m", "elliptude.basilisk", "--step", "0.5", "--out", out]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "truth inside: 5830" in done.stdout
    assert "WARNING" not in done.stdout
    assert out.stat().st_size > 50_000
