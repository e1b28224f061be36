"""Bounds proposed from recordings whose errors are known, and the rule for a sensor in the hand."""

import dataclasses
import functools
import json
import re
import tomllib
from importlib import resources

import numpy as np
import pytest
from datasets import needs_datasets
from elliptude import cli
from elliptude.configuration import rules
from elliptude.configuration.rules import apply_rule, hand_held, read_rule
from elliptude.io import tables
from elliptude.proposal import delays, proposals
from elliptude.proposal.proposals import Recording
from elliptude.proposal.vectors import angles_between as angle_between
from elliptude.proposal.vectors import propose_vector
from recordings import broad_recording
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
    found = propose_vector(vectors, np.ones(200, dtype=bool), attitudes.as_quat(scalar_first=True), [0.0, 0.0, 9.80665])
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
    assert recording.times[ruled.rest_at_start][-1] == pytest.approx(2.0)
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
    with pytest.raises(ValueError, match="the recording ends there"):
        apply_rule(hand_held(), *(array[:50] for array in arrays))
    for fields in (recording.fields, None):
        with pytest.raises(ValueError, match=r"further from gravity than the rule allows"):
            apply_rule(hand_held(), arrays[0], arrays[1], 1.2 * arrays[2], fields)


@needs_datasets
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


@needs_datasets
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


def test_rule(tmp_path, log):
    out = tmp_path / "rule.toml"
    done = run(log, "--like", "broad", "--rule", out)
    assert done.exit_code == 0, done.output
    assert "They are no guarantee" in done.output
    assert "with its reference attitude" in done.output
    rule = read_rule(out)
    proposed = proposals.propose(made())
    assert rule.gyro.noise_deg_per_s == pytest.approx(1.2 * np.rad2deg(proposed.gyro.noise.maximum), rel=0.01)
    assert rule.gyro.noise_deg_per_s >= 1.2 * np.rad2deg(proposed.gyro.noise.maximum)
    assert rule.motion == hand_held().motion
    assert "not seen in the recording" in out.read_text()
    assert run(log, "--like", "broad", "--rule", out).exit_code == 1
    assert run(log, "--like", "broad", "--rule", out, "--force", "--margin", "2").exit_code == 0
    assert read_rule(out).gyro.noise_deg_per_s == pytest.approx(2.0 * np.rad2deg(proposed.gyro.noise.maximum), rel=0.01)


def test_command_says_the_same_as_json(log):
    done = run(log, "--like", "broad", "--json")
    said = json.loads(done.stdout)
    assert "no guarantee" in said["note"]
    assert said["quantiles"]["gyro_noise_deg_per_s"]["50%"] == pytest.approx(0.154, rel=0.05)
    assert said["magnetometer_delay_s"]["delay"] == pytest.approx(0.0, abs=0.002)
    without = json.loads(run(log, "--like", "broad", "--json", "--no-reference").stdout)
    assert without["gyro_delay_s"] is None
    assert without["quantiles"]["accelerometer_angle_rest_deg"] is None


def test_no_quantile_is_called_a_guarantee(tmp_path, log):
    rule, out = tmp_path / "rule.toml", tmp_path / "out.toml"
    said = run(log, "--like", "broad", "--rule", rule, "--out", out)
    assert said.exit_code == 0, said.output
    for text in (said.output, rule.read_text(), out.read_text(), run("--help").output):
        words = text.lower().replace("\n", " ").replace("#", " ")
        for sentence in words.split("."):
            if re.search(r"\bguarantees?\b", sentence):  # "guaranteed" is the mode's name
                assert "no guarantee" in " ".join(sentence.split()) or "guarantee nothing" in " ".join(sentence.split())


def test_bad_recordings(tmp_path):
    path = tmp_path / "log.npz"

    def said(*arguments):
        done = run(path, *arguments)
        assert done.exit_code == 1
        assert "Traceback" not in done.output
        return done.output.replace("\n", " ")

    like = ("--like", "broad")
    assert "no such file" in said(*like)
    path.write_bytes(b"")
    assert "not an NPZ file" in said(*like)
    np.savez(path, t=np.arange(5.0))
    assert "no column 'gyr[0]'" in said(*like)
    np.savez(path, t=np.arange(5.0), gyr=np.zeros((4, 3)))
    assert "have not the same rows" in said(*like)
    np.savez(path, t=np.array([0.0, 1.0, 1.0, 2.0]), gyr=np.zeros((4, 3)))
    assert "row 3" in said(*like)
    np.savez(path, t=np.arange(2.0), gyr=np.zeros((2, 3)))
    assert "fewer than 3" in said(*like)
    assert "do not state sensor, axis and unit" in said()
    assert run(path, "--like", "none").exit_code == 2
    assert run(path, "--gyro", "gyr[0],gyr[1],gyr[2]", "--time", "t").exit_code == 2
    assert run(path, "--gyro", "gyr[0],gyr[1]", "--gyro-unit", "rad/s", "--time", "t").exit_code == 2
    assert run(path, *like, "--time", "t").exit_code == 2


# --- a configuration to start from ------------------------------------------------------------------------------------

HEADER = ["Time (s)"] + [
    f"{sensor} {axis} ({unit})"
    for sensor, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g"), ("Magnetometer", "uT"))
    for axis in "XYZ"
]


def write_csv(path, header, *, gyro_scale=180.0 / np.pi, force_scale=1.0 / 9.80665):
    recording = made()
    rows = np.column_stack(
        [
            recording.times,
            gyro_scale * recording.angular_velocities,
            force_scale * recording.specific_forces,
            recording.fields,
        ]
    )
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=",".join(header), comments="")
    return path


def test_first_order_from_a_users_csv_to_results(tmp_path):
    log, config, out = write_csv(tmp_path / "log.csv", HEADER), tmp_path / "config.toml", tmp_path / "out"
    done = run(log, "--mode", "first_order", "--out", config)
    assert done.exit_code == 0, done.output
    assert "gyro: Gyroscope X, Gyroscope Y, Gyroscope Z (deg/s)" in done.output
    proposed = proposals.propose(dataclasses.replace(made(), attitudes=None))
    written = tomllib.loads(config.read_text())
    noise = proposed.gyro.noise.maximum + proposed.gyro.bias_spread.maximum
    assert written["flow"]["noise_deg_per_s"] == pytest.approx(1.2 * np.rad2deg(noise), rel=0.01)
    assert written["start"]["bias_bound_deg_per_s"] > np.rad2deg(np.linalg.norm(BIAS))
    reference = written["directions"][1]["reference"]
    assert 0.0 <= reference["from_s"] < reference["to_s"] <= 5.0
    for bounded in ("noise_deg_per_s", "bound_deg", "bias_bound_deg_per_s"):
        for line in config.read_text().splitlines():
            assert not line.startswith(bounded) or "times 1.2" in line
    arguments = ["estimate", str(log), "--config", str(config), "--out", str(out)]
    done = CliRunner().invoke(cli.make_app(), arguments)
    assert done.exit_code == 0, done.output
    results = tables.Result.read(out / "results.csv")
    # The field's horizontal part points north, so the attitudes are those of the recording.
    errors = Rotation.from_quat(results.quaternions, scalar_first=True).inv() * attitude(results.times)
    # Accelerations of up to 1.5 m/s² lean the vertical by up to 8.7 degrees.
    assert errors.magnitude().mean() < np.arctan(1.5 / 9.8)
    assert (errors.magnitude() <= results.largest_angles).all()


def test_every_way_to_name_columns_reads_the_same(tmp_path):
    plain = ["t", "wx", "wy", "wz", "ax", "ay", "az", "mx", "my", "mz"]
    stated = write_csv(tmp_path / "stated.csv", HEADER)
    named = write_csv(tmp_path / "named.csv", plain)
    radians = [name.replace("deg/s", "rad/s").replace("(g)", "[m/s²]").replace("uT", "µT") for name in HEADER]
    other = write_csv(tmp_path / "other.csv", radians, gyro_scale=1.0, force_scale=1.0)
    by_name = [
        "--time", "t", "--gyro", "wx,wy,wz", "--gyro-unit", "deg/s", "--accelerometer", "ax,ay,az",
        "--accelerometer-unit", "g", "--magnetometer", "mx,my,mz", "--magnetometer-unit", "uT",
    ]  # fmt: skip
    config = tmp_path / "mapping.toml"
    config.write_text(
        """
        time_column = "t"
        reference_frame = "NED"
        flow = { kind = "gyro", columns = ["wx", "wy", "wz"], unit = "deg/s" }
        directions = [
            { name = "a", kind = "accelerometer", columns = ["ax", "ay", "az"], unit = "g" },
            { name = "m", kind = "magnetometer", columns = ["mx", "my", "mz"], unit = "uT" },
        ]
        """
    )
    said = [
        json.loads(run(*arguments, "--json").stdout)["quantiles"]
        for arguments in ([stated], [named, *by_name], [other], [named, config])
    ]
    for one in said[1:]:
        for key, values in one.items():
            assert values == (None if values is None else pytest.approx(said[0][key], rel=1e-5)), key
    assert run(named).exit_code == 1
    # A unit that nobody knows is not read as another one.
    assert run(write_csv(tmp_path / "odd.csv", [name.replace("deg/s", "turns") for name in HEADER])).exit_code == 1


def test_the_reference_attitude_in_another_frame(tmp_path, log):
    """The same truth given in NED shows the same errors."""
    recording = made()
    to_ned = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    turned = to_ned * Rotation.from_quat(recording.attitudes, scalar_first=True)
    np.savez(
        tmp_path / "ned.npz", t=recording.times, gyr=recording.angular_velocities, acc=recording.specific_forces,
        mag=recording.fields, q=turned.as_quat(scalar_first=True),
    )  # fmt: skip
    config, out = tmp_path / "ned.toml", tmp_path / "out.toml"
    config.write_text(
        """
        time_column = "t"
        reference_frame = "NED"
        flow = { kind = "gyro", columns = ["gyr[0]", "gyr[1]", "gyr[2]"] }
        directions = [
            { name = "a", kind = "accelerometer", columns = ["acc[0]", "acc[1]", "acc[2]"], unit = "m/s^2" },
            { name = "m", kind = "magnetometer", columns = ["mag[0]", "mag[1]", "mag[2]"], unit = "uT" },
        ]
        truth = { attitude_columns = ["q[0]", "q[1]", "q[2]", "q[3]"] }
        """
    )
    enu = json.loads(run(log, "--like", "broad", "--json").stdout)["quantiles"]
    ned = json.loads(run(tmp_path / "ned.npz", config, "--json", "--out", out).stdout)["quantiles"]
    for key, values in ned.items():
        assert values == (None if values is None else pytest.approx(enu[key], rel=1e-6)), key
    field = tomllib.loads(out.read_text())["directions"][1]["reference_ut"]
    np.testing.assert_allclose(field, to_ned.apply(FIELD), atol=0.2)


def test_no_rest_a_magnetic_reference_from_medians(tmp_path):
    recording = made()
    rows = (recording.times > 7.0) & (recording.times < 19.0)
    columns = [recording.angular_velocities, recording.specific_forces, recording.fields]
    path = tmp_path / "log.npz"
    np.savez(path, t=recording.times[rows], gyr=columns[0][rows], acc=columns[1][rows], mag=columns[2][rows])
    done = run(path, "--like", "broad", "--out", tmp_path / "out.toml")
    assert done.exit_code == 0
    assert "No rest: " in done.output.replace("\n", " ")
    assert "medians of the whole recording, which has no rest" in (tmp_path / "out.toml").read_text()


def test_the_rule_is_valid_toml():
    assert isinstance(hand_held(), rules.Rule)
    assert tomllib.loads((resources.files("elliptude") / "data/bounds/hand_held.toml").read_text())


def test_a_stamp_far_ahead_costs_no_memory():
    """Pieces are as many as there are rows in, not as there are seconds."""
    times = np.append(0.01 * np.arange(1000), 9e9)
    rates = np.column_stack([np.sin(times), np.cos(0.7 * times), 0.3 * np.sin(2.0 * times)])
    turned = Rotation.from_rotvec(np.cumsum(0.01 * rates, axis=0)).inv().apply([0.0, 0.6, -0.8])
    delays.delay_of_vectors(times, turned, rates)
