"""Bounds proposed from recordings whose errors are known, and the rule for a sensor in the hand."""

import dataclasses
import functools
import json
import tomllib

import numpy as np
import pytest
from elliptude import bound_rules, cli, proposals
from elliptude.bound_rules import apply_rule, hand_held, read_rule
from elliptude.proposals import Recording
from elliptude.proposals import angles_between as angle_between
from recordings import BROAD, broad_recording
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

STEP = 1.0 / 200.0
BIAS = np.deg2rad([0.3, -0.2, 0.1])
FIELD = np.array([0.0, 18.0, -42.0])


FINE = np.arange(-0.1, 40.1, STEP / 4.0)


def moving(t):
    """Rises smoothly from rest: at rest for the first five seconds and from 20 to 24."""
    return np.clip(t - 5.0, 0.0, 1.0) * np.clip(abs(t - 22.0) - 2.0, 0.0, 1.0)


def rate(t):
    wave = np.array([2.0 * np.sin(1.3 * t) + np.sin(7.0 * t), 1.5 * np.cos(2.1 * t), np.sin(0.7 * t + 1.0)])
    return (moving(t) * wave).T


@functools.cache
def fine_attitudes():
    attitudes = [Rotation.identity()]
    for turn in Rotation.from_rotvec(STEP / 4.0 * rate(FINE[:-1] + STEP / 8.0)):
        attitudes.append(attitudes[-1] * turn)
    return Rotation.concatenate(attitudes)


def attitude(t):
    return fine_attitudes()[np.clip(np.round((t + 0.1) / (STEP / 4.0)).astype(int), 0, len(FINE) - 1)]


def made(seed=0, *, gyro_late=0.0, field_late=0.0, scale=None):
    """Forty seconds of a sensor that is turned and moved as a hand does."""
    draws = np.random.default_rng(seed)
    times = np.arange(0.0, 40.0, STEP)
    acceleration = moving(times) * np.array([np.sin(6.0 * times), np.cos(5.0 * times), 0.5 * np.sin(9.0 * times)])
    forces = attitude(times).inv().apply(np.array([0.0, 0.0, 9.80665]) + acceleration.T)
    forces += 0.02 * draws.standard_normal(forces.shape)
    gyro = rate(times - gyro_late) @ (np.eye(3) if scale is None else np.eye(3) + scale).T + BIAS
    gyro += np.deg2rad(0.1) * draws.standard_normal(gyro.shape)
    fields = attitude(times - field_late).inv().apply(FIELD) + 0.2 * draws.standard_normal(gyro.shape)
    return Recording(times, gyro, forces, fields, attitude(times).as_quat(scalar_first=True))


def test_gyro():
    scale = np.array([[0.01, 0.0, 0.0], [0.0, -0.004, 0.003], [0.0, 0.0, 0.002]])
    proposed = proposals.propose(made(scale=scale))
    assert proposed.rest == pytest.approx(9.0 / 40.0, abs=0.04)
    np.testing.assert_allclose(proposed.gyro.bias, BIAS, atol=np.deg2rad(0.02))
    assert proposed.gyro.scale_error == pytest.approx(0.01, abs=0.001)
    # The norm of three normal numbers: median 1.538 σ.
    assert np.rad2deg(proposed.gyro.noise.half) == pytest.approx(0.1538, rel=0.05)
    turns = [proposed.gyro.window_angles[duration].maximum for duration in (1.0, 8.0)]
    assert 0.0 < turns[0] < turns[1] < np.deg2rad(15.0)


def test_accelerometer_and_magnetometer():
    proposed = proposals.propose(made())
    accelerometer, magnetometer = proposed.accelerometer, proposed.magnetometer
    np.testing.assert_allclose(magnetometer.reference, FIELD, atol=0.05)
    assert accelerometer.vector_rest.half == pytest.approx(0.02 * 1.538, rel=0.1)
    assert 1.0 < accelerometer.vector_moving.maximum < 1.6
    assert magnetometer.vector_moving.maximum < 1.5
    assert proposed.dip.maximum < np.deg2rad(3.0)
    without = proposals.propose(dataclasses.replace(made(), fields=None, attitudes=None))
    assert without.accelerometer.vector_rest is None
    assert without.accelerometer.norm_rest.half < 0.05
    assert without.magnetometer is None


def test_misalignment_is_found_where_poses_differ():
    draws = np.random.default_rng(1)
    attitudes = Rotation.random(200, random_state=2)
    turn = Rotation.from_rotvec([0.02, -0.03, 0.01])
    vectors = turn.inv().apply(attitudes.inv().apply([0.0, 0.0, 9.80665])) + 0.001 * draws.standard_normal((200, 3))
    found = proposals.propose_vector(
        vectors, np.ones(200, dtype=bool), attitudes.as_quat(scalar_first=True), [0.0, 0.0, 9.80665]
    )
    assert found.misalignment == pytest.approx(turn.magnitude(), rel=0.01)
    assert found.aligned_rest.maximum < 0.001
    assert found.angle_rest.half > 0.01


@pytest.mark.parametrize("late", [-0.02, 0.0, 0.0075, 0.03])
def test_delays_and_their_sign(late):
    proposed = proposals.propose(made(gyro_late=late))
    assert proposed.gyro_delay.delay == pytest.approx(late, abs=0.001)
    assert proposed.gyro_delay.scatter < 0.002
    proposed = proposals.propose(made(field_late=late))
    assert proposed.gyro_delay.delay == pytest.approx(0.0, abs=0.001)
    assert proposed.magnetometer_delay.delay == pytest.approx(late, abs=0.002)


def test_without_motion_there_is_no_delay():
    times = np.arange(0.0, 10.0, STEP)
    still = Recording(times, np.full((2000, 3), 1e-3), np.tile([0.0, 0.0, 9.8], (2000, 1)), np.tile(FIELD, (2000, 1)))
    proposed = proposals.propose(still)
    assert proposed.rest == 1.0
    assert proposed.magnetometer_delay is None
    assert proposed.gyro_delay is None
    assert proposed.accelerometer.norm_moving is None


# --- the rule ---------------------------------------------------------------------------------------------------------


def directions_of(ruled):
    return ((ruled.up, [0.0, 0.0, 1.0]), (ruled.field, ruled.field_reference), (ruled.east, [1.0, 0.0, 0.0]))


def ruled_by_hand_held(recording):
    return apply_rule(
        hand_held(), recording.times, recording.angular_velocities, recording.specific_forces, recording.fields
    )


@pytest.mark.parametrize("seed", range(3))
def test_rule_on_a_made_recording(seed):
    recording = made(seed, field_late=0.015)
    ruled = ruled_by_hand_held(recording)
    attitudes = Rotation.from_quat(recording.attitudes, scalar_first=True).inv()
    np.testing.assert_allclose(ruled.bias, BIAS, atol=np.deg2rad(0.05))
    assert 4.0 < recording.times[ruled.rest_at_start][-1] < 5.5
    for bounds, true in directions_of(ruled):
        measured = np.isfinite(bounds.angles)
        assert measured.mean() > 0.98
        assert not bounds.contradicted.any()
        assert (angle_between(bounds.directions, attitudes.apply(true)) <= bounds.angles)[measured].all()
    np.testing.assert_allclose(ruled.field_reference, FIELD / np.linalg.norm(FIELD), atol=0.02)
    assert np.median(np.rad2deg(ruled.up.angles)) < 15.0
    # The gyro of this recording has noise alone, and three of its standard deviations are 0.3 °/s.
    true = rate(recording.times)
    error = np.linalg.norm(recording.angular_velocities - ruled.bias - true, axis=1)
    assert (error <= ruled.gyro_noise).all()


def test_a_magnet_is_contradicted():
    recording = made()
    fields = recording.fields.copy()
    fields[4000:4400] *= 1.6
    arrays = (recording.times, recording.angular_velocities, recording.specific_forces, fields)
    ruled = apply_rule(hand_held(), *arrays)
    assert ruled.field.contradicted[4100:4300].all()
    assert not ruled.field.contradicted[:3900].any()
    assert not np.isfinite(ruled.field.angles).any()
    assert not np.isfinite(ruled.east.angles).any()
    rule = hand_held()
    magnetometer = rule.magnetometer.model_copy(update={"contradiction_voids": "row"})
    ruled = apply_rule(rule.model_copy(update={"magnetometer": magnetometer}), *arrays)
    np.testing.assert_array_equal(np.isnan(ruled.field.angles[100:-100]), ruled.field.contradicted[100:-100])


def test_directions_for_some_rows():
    recording = made()
    arrays = (recording.times, recording.angular_velocities, recording.specific_forces, recording.fields)
    all_rows, some = apply_rule(hand_held(), *arrays), apply_rule(hand_held(), *arrays, every=7)
    for name in ("up", "field", "east"):
        np.testing.assert_allclose(getattr(some, name).angles[::7], getattr(all_rows, name).angles[::7])
        assert np.isnan(getattr(some, name).angles[3::7]).all()


def test_rule_needs_a_rest():
    recording = made()
    arrays = (recording.times, recording.angular_velocities, recording.specific_forces)
    with pytest.raises(ValueError, match="starts with a rest of 0 s; the rule asks for 2 s"):
        apply_rule(hand_held(), *(array[1400:] for array in arrays))
    with pytest.raises(ValueError, match=r"further from gravity than the rule allows"):
        apply_rule(hand_held(), arrays[0], arrays[1], 1.2 * arrays[2], recording.fields)


@pytest.mark.skipif(not BROAD.exists(), reason="the BROAD excerpts are not here")
@pytest.mark.parametrize("trial", ["02", "05", "07", "24", "30"])
def test_rule_on_broad(trial):
    """Against the optical attitude, which may itself be 0.5° off; the target is 99.9 %."""
    recording = broad_recording(trial)
    ruled = ruled_by_hand_held(recording)
    known = np.isfinite(recording.attitudes).all(axis=1)
    attitudes = Rotation.from_quat(np.where(known[:, None], recording.attitudes, [1, 0, 0, 0]), scalar_first=True).inv()
    for bounds, true in directions_of(ruled):
        rows = known & np.isfinite(bounds.angles)
        assert rows.sum() > 0.98 * known.sum()
        inside = angle_between(bounds.directions, attitudes.apply(true)) <= bounds.angles + np.deg2rad(0.5)
        assert inside[rows].mean() >= 0.999
    assert np.rad2deg(np.median(ruled.up.angles[ruled.rest_at_start])) < 5.0


@pytest.mark.skipif(not BROAD.exists(), reason="the BROAD excerpts are not here")
def test_delays_of_broad():
    """The dataset's README: the gyro one row (3.5 ms) late, the magnetometer about 15 ms."""
    proposed = proposals.propose(broad_recording("07"))
    assert proposed.gyro_delay.delay == pytest.approx(0.0035, abs=0.002)
    assert proposed.gyro_delay.delay + proposed.magnetometer_delay.delay == pytest.approx(0.015, abs=0.003)


# --- the command ------------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), ["bounds", *(str(argument) for argument in arguments)])


@pytest.fixture
def log(tmp_path):
    recording = made()
    path = tmp_path / "log.npz"
    np.savez(
        path, t=recording.times, gyr=recording.angular_velocities, acc=recording.specific_forces,
        mag=recording.fields, q_ref=recording.attitudes,
    )  # fmt: skip
    return path


def test_command(tmp_path, log):
    out = tmp_path / "rule.toml"
    done = run(log, "--out", out)
    assert done.exit_code == 0, done.output
    assert "They are no guarantee" in done.output
    assert "with its reference attitude" in done.output
    rule = read_rule(out)
    proposed = proposals.propose(made())
    assert rule.gyro.noise_deg_per_s == pytest.approx(1.2 * np.rad2deg(proposed.gyro.noise.maximum), rel=0.01)
    assert rule.gyro.noise_deg_per_s >= 1.2 * np.rad2deg(proposed.gyro.noise.maximum)
    assert rule.motion == hand_held().motion
    assert "not seen in the recording" in out.read_text()
    assert run(log, "--out", out).exit_code == 1
    assert run(log, "--out", out, "--force", "--margin", "2").exit_code == 0
    assert read_rule(out).gyro.noise_deg_per_s == pytest.approx(2.0 * np.rad2deg(proposed.gyro.noise.maximum), rel=0.01)


def test_command_says_the_same_as_json(log):
    done = run(log, "--json")
    said = json.loads(done.stdout)
    assert "no guarantee" in said["note"]
    assert said["quantiles"]["gyro_noise_deg_per_s"]["50%"] == pytest.approx(0.154, rel=0.05)
    assert said["magnetometer_delay_s"]["delay"] == pytest.approx(0.0, abs=0.002)
    without = json.loads(run(log, "--json", "--no-reference").stdout)
    assert without["gyro_delay_s"] is None
    assert without["quantiles"]["accelerometer_angle_rest_deg"] is None


def test_no_quantile_is_called_a_guarantee(tmp_path, log):
    out = tmp_path / "rule.toml"
    for text in (run(log, "--out", out).output, out.read_text(), run("--help").output):
        words = text.lower().replace("\n", " ")
        for sentence in words.split("."):
            if "guarantee" in sentence:
                assert "no guarantee" in " ".join(sentence.split()) or "guarantee nothing" in " ".join(sentence.split())


def test_bad_recordings(tmp_path):
    path = tmp_path / "log.npz"
    assert "No such file" in run(path).output
    path.write_bytes(b"")
    assert "not an NPZ file" in run(path).output
    np.savez(path, t=np.arange(5.0))
    assert "has no array gyr" in run(path).output
    np.savez(path, t=np.arange(5.0), gyr=np.zeros((4, 3)))
    assert "gyr must hold numbers, shape (N, 3)" in run(path).output.replace("\n", " ")
    np.savez(path, t=np.array([0.0, 1.0, 1.0, 2.0]), gyr=np.zeros((4, 3)))
    assert "row 2: its time is not after that of the row before" in run(path).output.replace("\n", " ")
    np.savez(path, t=np.arange(2.0), gyr=np.zeros((2, 3)))
    assert "fewer than 3" in run(path).output
    for done in (run(path), run(tmp_path / "none.csv")):
        assert done.exit_code == 1
        assert "Traceback" not in done.output


def test_the_rule_is_valid_toml():
    assert isinstance(hand_held(), bound_rules.Rule)
    assert tomllib.loads((bound_rules.resources.files("elliptude") / "data/bounds/hand_held.toml").read_text())
