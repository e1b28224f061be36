"""From a recording to a report in two commands: configurations to start from, of the guaranteed mode above all."""

import dataclasses
import json
import re
import tomllib

import elliptude as el
import numpy as np
import pytest
import tomlkit
from datasets import broad, needs_datasets, xio
from elliptude import cli
from elliptude.bounds.turns import attitudes_from_rates
from elliptude.configuration import read_configuration, rules
from elliptude.configuration.rules import hand_held
from elliptude.io import tables
from elliptude.io.files import FileError
from elliptude.proposal import proposals
from elliptude.proposal.gyro import propose_gyro
from elliptude.proposal.proposals import Recording
from elliptude.proposal.starting import document
from elliptude.report import page as report
from scipy.spatial.transform import Rotation
from test_proposals import BIAS, FIELD, HEADER, STEP, attitude, made, write_csv
from typer.testing import CliRunner

MARGIN = 1.2
UP_HEADER = [
    "Time (s)",
    *(f"Gyroscope {axis} (rad/s)" for axis in "XYZ"),
    *(f"Accelerometer {axis} (m/s^2)" for axis in "XYZ"),
]


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def succeed(*arguments):
    done = run(*arguments)
    assert done.exit_code == 0, done.output
    # What takes long says so on the error stream.
    return done.stdout if "--json" in arguments else done.output


def refused(*arguments, exit_code=1):
    """What a command says that must not end well."""
    done = run(*arguments)
    assert done.exit_code == exit_code, done.output
    assert "Traceback" not in done.output
    return " ".join(done.output.split())


def write_npz(path, recording, *, rows=slice(None), **more):
    arrays = {
        "t": recording.times, "gyr": recording.angular_velocities, "acc": recording.specific_forces,
        "mag": recording.fields, "q_ref": recording.attitudes,
    }  # fmt: skip
    np.savez(path, **{name: array[rows] for name, array in arrays.items() if array is not None}, **more)
    return path


def forms(results, true):
    """γᵀ P⁻¹ γ with γ = 2 tan(θ/2) n of the true attitude from the estimated one, NaN without a set."""
    known = np.isfinite(results.quaternions[:, 0])
    errors = Rotation.from_quat(results.quaternions[known], scalar_first=True).inv() * true[known]
    vectors = errors.as_rotvec()
    angles = np.linalg.norm(vectors, axis=1, keepdims=True)
    gibbs = 2.0 * np.tan(0.5 * angles) * vectors / np.where(angles > 0.0, angles, 1.0)
    result = np.full(len(known), np.nan)
    inverses = np.linalg.inv(results.shapes[known, :3, :3])
    result[known] = np.einsum("ni,nij,nj->n", gibbs, inverses, gibbs)
    return result


def assert_every_number_says_from_what_it_comes(text):
    """Every proposed number, and so not those in lists of columns and of the reference attitude."""
    said = 0
    for line in text.splitlines():
        if re.match(r"\w+ = [-\d\[{]", line) and not re.match(r'\w+ = \["|error_deg', line):
            assert "# " in line, line
            comment = line.split("# ")[1]
            assert re.search(r"no guarantee|not seen in the recording|how often a prediction", comment), line
            said += 1
        if "maximum" in line and "shows a part" not in line:
            assert f"times {MARGIN:g}" in line
    assert said >= 8


def expected(maximum, standard=0.0):
    return pytest.approx(max(MARGIN * maximum, standard), rel=0.01)


# --- two commands -----------------------------------------------------------------------------------------------------


def test_from_a_users_csv_to_a_report_in_two_commands(tmp_path):
    log, config, out = write_csv(tmp_path / "my log.csv", HEADER), tmp_path / "config.toml", tmp_path / "out"
    said = succeed("bounds", log, "--out", config)
    assert "mode guaranteed" in said
    assert "elliptude estimate '" in said  # as a shell takes it
    page = out / "report.html"
    said = succeed("estimate", log, "--config", config, "--out", out, "--report", page)
    assert str(page) in said
    assert "unconditional" in page.read_text()

    results = tables.Result.read(out / "results.csv")
    assert results.claims == ("unconditional",) * len(results.times)
    true = attitude(results.times)
    # The field's horizontal part points north, and the recording's second axis does so too.
    assert np.nanmax(forms(results, true)) <= 1.0
    assert np.isfinite(forms(results, true)).all()
    # The test can fail: an attitude that is off by more than the bound of the heading.
    assert np.nanmax(forms(results, Rotation.from_rotvec([0.0, 0.0, 1.5]) * true)) > 1.0

    assert_every_number_says_from_what_it_comes(config.read_text())
    written = tomllib.loads(config.read_text())
    assert "start" not in written
    assert written["estimator"] == {"mode": "guaranteed", "policy": "drop_measurement", "criterion": "trace"}
    rule, standard = written["rule"], hand_held()
    recording = made()
    at_start = recording.times < 5.0
    rates = recording.angular_velocities - recording.angular_velocities[at_start].mean(axis=0)
    # At rest alone noise shows a part of itself, so that the number for sensors in the hand is not made smaller.
    assert np.rad2deg(MARGIN * np.linalg.norm(rates[at_start], axis=1).max()) < standard.gyro.noise_deg_per_s
    assert rule["gyro"]["noise_deg_per_s"] == standard.gyro.noise_deg_per_s
    assert rule["motion"]["velocity_m_per_s"] == standard.motion.velocity_m_per_s


def test_a_part_that_is_larger_counts(tmp_path):
    recording = made()
    draws = np.random.default_rng(3)
    noise = np.deg2rad(0.35) * draws.uniform(-1.0, 1.0, recording.fields.shape)
    lengths = 1.0 + 0.2 * (abs(recording.times - 15.0) < 1.0)
    changed = dataclasses.replace(
        recording,
        angular_velocities=recording.angular_velocities + 3.0 * noise * (recording.times < 4.5)[:, None] / 3.0,
        fields=recording.fields * lengths[:, None],
        attitudes=None,
    )
    config = tmp_path / "config.toml"
    succeed("bounds", write_npz(tmp_path / "log.npz", changed), "--like", "broad", "--out", config, "--margin", "3")
    rule = tomllib.loads(config.read_text())["rule"]
    length = np.linalg.norm(changed.fields, axis=1)
    at_start = length[recording.times < 4.5].mean()
    assert rule["magnetometer"]["disturbance_ut"] == pytest.approx(3.0 * (length.max() - at_start), rel=0.02)
    assert rule["gyro"]["noise_deg_per_s"] > hand_held().gyro.noise_deg_per_s


def test_with_a_reference_what_is_seen_in_full_stands(tmp_path):
    recording = made(field_late=0.015)
    log, config, out = write_npz(tmp_path / "log.npz", recording), tmp_path / "config.toml", tmp_path / "out"
    succeed("bounds", log, "--like", "broad", "--out", config)
    assert_every_number_says_from_what_it_comes(config.read_text())
    rule = tomllib.loads(config.read_text())["rule"]
    true = Rotation.from_quat(recording.attitudes, scalar_first=True)
    resting = (recording.times < 4.9) | (abs(recording.times - 22.0) < 1.9)
    off = np.linalg.norm(recording.specific_forces - true.inv().apply([0.0, 0.0, 9.80665]), axis=1)
    assert rule["accelerometer"]["error_m_per_s2"] == expected(off[resting].max())
    assert rule["accelerometer"]["error_m_per_s2"] < hand_held().accelerometer.error_m_per_s2
    noise = np.linalg.norm(recording.angular_velocities - BIAS, axis=1)[resting].max()
    assert rule["gyro"]["noise_deg_per_s"] == pytest.approx(MARGIN * np.rad2deg(noise), rel=0.05)
    # Once the delay is taken out the field is off by its noise alone, 0.2 µT for an axis.
    assert rule["magnetometer"]["delay_s"] == pytest.approx(0.015, abs=0.002)
    assert 0.5 < rule["magnetometer"]["disturbance_ut"] < 2.0
    succeed("estimate", log, "--config", config, "--out", out)
    results = tables.Result.read(out / "results.csv")
    assert np.isfinite(results.forms).all()
    assert forms(results, true).max() <= 1.0


def test_without_a_magnetometer_the_heading_counts_from_the_first_row(tmp_path):
    recording = dataclasses.replace(made(), fields=None)
    log, config, out = write_npz(tmp_path / "log.npz", recording), tmp_path / "config.toml", tmp_path / "out"
    succeed("bounds", log, "--like", "broad", "--no-reference", "--out", config)
    written = tomllib.loads(config.read_text())
    assert written["estimator"]["criterion"] == "trace"
    assert "magnetometer" not in written["rule"]
    said = json.loads(succeed("estimate", log, "--config", config, "--out", out, "--json"))
    assert said["heading"] == "from the first row"
    assert said["inside_share_of_updates"] == 1.0
    # First order needs a second direction.
    assert "two directions" in refused(
        "bounds", log, "--like", "broad", "--mode", "first_order", "--out", out / "o.toml"
    )


# --- by sensor --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reference", ["--reference", "--no-reference"])
def test_without_a_rest_at_the_start_each_sensor_states_its_bounds(tmp_path, reference):
    recording = made()
    log = write_npz(tmp_path / "log.npz", recording, rows=recording.times > 3.5)
    config, out = tmp_path / "config.toml", tmp_path / "out"
    succeed("bounds", log, "--like", "broad", reference, "--out", config)
    text = config.read_text()
    assert_every_number_says_from_what_it_comes(text)
    assert "a rest of" in text
    assert "a rule asks for 2 s" in text
    written = tomllib.loads(text)
    assert "rule" not in written
    flow, (up, field) = written["flow"], written["directions"]
    np.testing.assert_allclose(np.deg2rad(flow["known_bias_deg_per_s"]), BIAS, atol=np.deg2rad(0.03))
    assert up["bound_from"]["kind"] == "velocity_window"
    assert field["bound_from"]["kind"] == "field"
    assert field["reference_error_deg"] > 0.0
    succeed("estimate", log, "--config", config, "--out", out)
    results = tables.Result.read(out / "results.csv")
    assert np.isfinite(results.forms).mean() > 0.95
    assert np.nanmax(forms(results, attitude(results.times))) <= 1.0


def test_a_gyro_that_integrates_gives_no_windows(tmp_path):
    mapping, config = tmp_path / "mapping.toml", tmp_path / "config.toml"
    mapping.write_text(
        """
        time_column = "t"
        reference_frame = "ENU"
        flow = { kind = "gyro", columns = ["gyr[0]", "gyr[1]", "gyr[2]"], interval_rate = "first_sample" }
        directions = [
            { name = "a", kind = "accelerometer", columns = ["acc[0]", "acc[1]", "acc[2]"], unit = "m/s^2" },
            { name = "m", kind = "magnetometer", columns = ["mag[0]", "mag[1]", "mag[2]"], unit = "uT" },
        ]
        """
    )
    succeed("bounds", write_npz(tmp_path / "log.npz", made()), mapping, "--out", config)
    assert read_configuration(config).accelerometer.bound_from.kind == "acceleration"


def test_slow_sensors_are_bounded_sample_by_sample(tmp_path):
    """Accelerometer and magnetometer in every fourth row, another frame, and a bound that is already there."""
    recording = made()
    columns = np.column_stack(
        [recording.times, recording.angular_velocities, recording.specific_forces, recording.fields]
    )
    log, mapping, config = tmp_path / "log.csv", tmp_path / "mapping.toml", tmp_path / "config.toml"
    with log.open("w") as file:
        file.write("t,wx,wy,wz,ax,ay,az,mx,my,mz\n")
        for k, row in enumerate(columns):
            cells = [f"{value:.9g}" for value in (row if k % 4 == 0 else row[:4])]
            file.write(",".join(cells + [""] * (10 - len(cells))) + "\n")
    mapping.write_text(
        """
        time_column = "t"
        reference_frame = "NWU"
        flow = { kind = "gyro", columns = ["wx", "wy", "wz"], noise_deg_per_s = 0.9 }
        directions = [
            { name = "a", kind = "accelerometer", columns = ["ax", "ay", "az"], unit = "m/s^2" },
            { name = "m", kind = "magnetometer", columns = ["mx", "my", "mz"], unit = "uT" },
        ]
        """
    )
    succeed("bounds", log, mapping, "--out", config)
    assert "sampled together in 25 % of the rows" in config.read_text()
    written = read_configuration(config)
    assert written.flow.noise_deg_per_s == 0.9
    lengths = np.linalg.norm(recording.specific_forces[::4], axis=1)
    up = written.accelerometer.bound_from
    assert up.kind == "acceleration"
    assert up.acceleration_m_per_s2 == expected(np.abs(lengths - 9.80665).max())
    succeed("estimate", log, "--config", config, "--out", tmp_path / "out")
    results = tables.Result.read(tmp_path / "out" / "results.csv")
    to_nwu = Rotation.from_matrix([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.isfinite(results.quaternions[:, 0]).mean() > 0.95
    assert np.nanmax(forms(results, to_nwu * attitude(results.times))) <= 1.0


def test_a_rule_that_is_there_stays(tmp_path):
    mapping, config = tmp_path / "mapping.toml", tmp_path / "config.toml"
    log = write_npz(tmp_path / "log.npz", made())
    mapping.write_text(
        """
        time_column = "t"
        rule = { kind = "hand_held" }
        flow = { kind = "gyro", columns = ["gyr[0]", "gyr[1]", "gyr[2]"] }
        directions = [{ name = "up", kind = "accelerometer", columns = ["acc[0]", "acc[1]", "acc[2]"], unit = "m/s^2" }]
        """
    )
    succeed("bounds", log, mapping, "--out", config)
    assert read_configuration(config).rule.kind == "hand_held"


# --- up alone ---------------------------------------------------------------------------------------------------------


def carried_by_hand(seed, *, bias, rest=(0.0, 0.0), seconds=40.0, rate=100.0):
    """A hand that moves within 1 m at less than 3 m/s, and turns; times, rad/s, m/s², and true up, body axes.

    The gyro's bias, deg/s, is about x; the sensor rests between two times, as a whole and nowhere else.
    """
    draws = np.random.default_rng(seed)
    times = np.arange(0.0, seconds, 1.0 / rate)
    begin, end = rest
    share = np.ones(len(times)) if begin == end else np.clip(np.maximum(begin - times, times - end), 0.0, 1.0)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # it comes to a rest smoothly
    phases = draws.uniform(0.0, 2.0 * np.pi, (2, 3))
    position = share[:, None] * 0.5 * np.sin(2.0 * np.outer(times, [1.0, 1.13, 0.8]) + phases[0])
    accelerations = np.gradient(np.gradient(position, times, axis=0), times, axis=0)
    true = share[:, None] * np.sin(np.outer(times, [1.0, 1.3, 0.7]) + phases[1]) * [1.5, 1.0, 2.0]
    turns = [Rotation.from_rotvec(draws.normal(size=3)).as_matrix()]
    for one in 0.5 * (true[1:] + true[:-1]) / rate:
        turns.append(turns[-1] @ Rotation.from_rotvec(one).as_matrix())
    turns = np.array(turns)
    forces = np.einsum("nji,nj->ni", turns, accelerations + np.array([0.0, 0.0, 9.807]))
    noise = draws.uniform(-1.0, 1.0, (2, len(times), 3))
    rates = true + np.deg2rad([bias, 0.0, 0.0]) + np.deg2rad(0.05) * noise[0]
    return times, rates, forces + 0.1 + 0.05 * noise[1], turns[:, 2]


def off_by(ups, true):
    return np.arctan2(np.linalg.norm(np.cross(ups, true), axis=1), np.einsum("ni,ni->n", ups, true))


@pytest.mark.parametrize(
    ("bias", "rest", "known"),
    [(4.8, (0.0, 0.0), False), (-4.0, (20.0, 24.5), True), (3.0, (20.0, 21.6), False)],
    ids=["no rest", "a rest in the middle", "a rest that is too short"],
)
def test_up_alone_without_a_rest_at_the_start(tmp_path, bias, rest, known):
    """A gyro and an accelerometer that move from the first row on: up at every row, the truth within its bound."""
    times, rates, forces, ups = carried_by_hand(1, bias=bias, rest=rest)
    log, config, out = tmp_path / "log.csv", tmp_path / "config.toml", tmp_path / "out"
    columns = np.column_stack([times, rates, forces]).round(9)
    np.savetxt(log, columns, "%.9f", ",", header=",".join(UP_HEADER), comments="")
    said = " ".join(succeed("bounds", log, "--out", config).split())
    assert "Up only, no heading" in said
    text = config.read_text()
    assert_every_number_says_from_what_it_comes(text)
    assert "# Up only, no heading" in text
    unseen = re.search(r"# Not seen here, so that each needs a reason: (.*)\.\n", text)[1].split(", ")
    assert {"bound_from.velocity_m_per_s", "bound_from.position_m", "flow.scale_error"} <= set(unseen)
    assert ("flow.bias_deg_per_s" in unseen) == (not known)
    assert not any("windows_s" in name or name.endswith(".at") for name in unseen)
    written = tomllib.loads(text)
    assert "rule" not in written
    rule, flow, (up,) = hand_held(), written["flow"], written["directions"]
    assert flow["bias_deg_per_s"] == (rule.gyro.bias_deg_per_s if known else rule.rest.rate_deg_per_s)
    assert ("known_bias_deg_per_s" in flow) == known
    assert up["bound_from"]["velocity_m_per_s"] == rule.motion.velocity_m_per_s
    assert tuple(up["bound_from"]["windows_s"]) == rule.motion.windows_s
    said = succeed("estimate", log, "--config", config, "--out", out)
    assert "up is known at 100 % of rows" in said
    results = tables.Result.read(out / "results.csv")
    assert set(results.up_claims) == {"unconditional"}
    assert (off_by(results.ups, ups) <= results.up_bounds).all()
    assert np.rad2deg(results.up_bounds.mean()) < (8.0 if known else 20.0)
    # And by one call, with the same numbers.
    found = el.ahrs(columns[:, 0], columns[:, 1:4], columns[:, 4:], statements="recording")
    np.testing.assert_allclose(found.up_bounds, results.up_bounds, rtol=1e-9)
    assert found.heading == "not known"
    note = next(note for note in found.notes if note.startswith("Up only, no heading"))
    assert f"a bias of at most {flow['bias_deg_per_s']:g} deg/s, at most 3 m/s, within 1 m" in note


def test_one_call_names_a_way_that_works():
    """What the rule for the hand refuses is not refused where its message leads to."""
    times, rates, forces, ups = carried_by_hand(3, bias=2.0)
    with pytest.raises(ValueError, match="statements='recording' takes bounds"):
        el.ahrs(times, rates, forces)
    found = el.ahrs(times, rates, forces, statements="recording")
    assert (off_by(found.ups, ups) <= found.up_bounds).all()


# --- what is measured -------------------------------------------------------------------------------------------------


def test_sums_at_rest():
    """A rate whose integral goes back and forth by a known angle, about two axes."""
    times = np.arange(0.0, 10.0, STEP)
    turned = np.deg2rad(0.05)
    rates = BIAS + turned * np.pi * np.column_stack([np.sin(2 * np.pi * times), np.cos(2 * np.pi * times), 0 * times])
    still = Recording(times, rates, np.tile([0.0, 0.0, 9.8], (len(times), 1)))
    found = proposals.propose(still).gyro.sums_rest
    assert found.count == 1
    # Each axis swings by 0.05 degrees; the box's diagonal is √2 times that.
    assert found.maximum == pytest.approx(np.sqrt(2.0) * turned, rel=0.01)


def test_where_nothing_turns_there_is_no_scale_error():
    """Against a reference that jitters, as all do; a fit would say that the gyro shows nothing of a turn."""
    draws = np.random.default_rng(4)
    times = np.arange(0.0, 20.0, STEP)
    count = len(times)
    jitter = Rotation.from_rotvec(np.deg2rad(0.05) * draws.standard_normal((count, 3))).as_quat(scalar_first=True)
    gyro = BIAS + np.deg2rad(0.1) * draws.standard_normal((count, 3))
    still = Recording(times, gyro, np.tile([0.0, 0.0, 9.8], (count, 1)), attitudes=jitter)
    assert proposals.propose(still).gyro.scale_error is None
    scaled = made(scale=0.01 * np.eye(3))
    assert proposals.propose(scaled).gyro.scale_error == pytest.approx(0.01, abs=0.002)


def turned_once(step=0.0025):
    """A quadrotor that stands, flips once about x and hardly about y and z, and stands: rates and attitudes."""
    times = np.arange(0.0, 6.6, step)
    about_x = 4.0 * np.exp(-(((times - 3.0) / 0.12) ** 2))
    rates = np.column_stack([about_x, 0.05 * about_x**2 / 4.0, 3e-5 * np.sin(times)])
    return times, rates, Rotation.from_matrix(attitudes_from_rates(np.diff(times), rates))


@pytest.mark.parametrize("late", [0.0, 0.5, -0.5])
def test_a_log_that_hardly_turns_shows_no_scale_error(late):
    """A gyro without any error but that a rate is that of the step's end or start: the fit said a third."""
    times, rates, true = turned_once()
    shown = np.column_stack([np.interp(times + late * 0.0025, times, one) for one in rates.T])
    forces = true.inv().apply([0.0, 0.0, 9.80665])
    recording = Recording(times, shown, forces, attitudes=true.as_quat(scalar_first=True))
    found = proposals.propose(recording).gyro.scale_error
    assert found is None or found < 0.005


@pytest.mark.parametrize("late", [0.5, -0.5])
def test_the_scale_error_of_rates_that_are_of_a_steps_end_or_start(late):
    recording = made(scale=np.diag([0.03, 0.0, 0.0]), gyro_late=late * STEP)
    # The delay is not taken out here, as it is less than a step.
    found = propose_gyro(
        recording.times, recording.angular_velocities, np.zeros(len(recording.times), bool), recording.attitudes
    )
    assert found.scale_error == pytest.approx(0.03, abs=0.002)


def test_what_differs_from_the_start():
    """Bias and field that are others in the second rest."""
    recording = made()
    later = recording.times > 15.0
    moved, shift = np.deg2rad([0.0, 0.2, 0.0]), np.array([3.0, 0.0, 0.0])
    changed = dataclasses.replace(
        recording,
        angular_velocities=recording.angular_velocities + later[:, None] * moved,
        fields=recording.fields + later[:, None] * attitude(recording.times).inv().apply(shift),
    )
    start = proposals.propose(changed).start
    assert start.duration == pytest.approx(5.0, abs=0.6)
    assert start.bias_moved.maximum == pytest.approx(np.deg2rad(0.2), rel=0.2)
    assert start.field_moved.maximum == pytest.approx(3.0, abs=1.2)
    without = proposals.propose(dataclasses.replace(changed, attitudes=None)).start
    lengths = np.linalg.norm([FIELD + shift, FIELD], axis=1)
    assert without.field_moved.maximum == pytest.approx(lengths[0] - lengths[1], abs=1.2)
    rows = slice(1400, None)
    moving = Recording(*(array[rows] for array in vars(recording).values() if isinstance(array, np.ndarray)))
    assert proposals.propose(moving).start is None


# --- what is refused --------------------------------------------------------------------------------------------------


def test_what_cannot_be_configured_is_not_written(tmp_path):
    recording = made()
    log, config, mapping = tmp_path / "log.npz", tmp_path / "config.toml", tmp_path / "mapping.toml"
    write_npz(log, recording, rows=recording.times > 7.0, other=recording.times[recording.times > 7.0] + 0.4 * STEP)
    like = ("bounds", log, "--like", "broad", "--out", config)
    text = """
        time_column = "t"
        reference_frame = "ENU"
        flow = { kind = "gyro", columns = ["gyr[0]", "gyr[1]", "gyr[2]"] }
        """
    accelerometer = '{ name = "a", kind = "accelerometer", columns = ["acc[0]", "acc[1]", "acc[2]"], unit = "m/s^2" }'
    mapping.write_text(text)
    assert "two directions" in refused("bounds", log, mapping, "--out", config)
    holds = text.replace("flow = {", 'flow = { interval_rate = "first_sample",')
    mapping.write_text(f"{holds}\ndirections = [{accelerometer}]")
    said = refused("bounds", log, mapping, "--out", config)
    assert "two directions" in said
    assert "interval_rate = 'mean_of_ends'" in said
    assert "a rest of 0 s, and a rule asks for 2 s" in said
    other = (
        '{ name = "m", kind = "magnetometer", columns = ["mag[0]", "mag[1]", "mag[2]"], unit = "uT", '
        'time_column = "other", time_unit = "s" }'
    )
    mapping.write_text(f"{text}\ndirections = [{accelerometer}, {other}]")
    succeed("bounds", log, mapping, "--out", config)
    near = tomllib.loads(config.read_text())
    assert near["timing"]["same_within_s"] == pytest.approx(0.45 * STEP, rel=0.05)
    assert near["directions"][0]["bound_from"]["kind"] == "velocity_window", "it is the magnetometer that is apart"
    assert near["directions"][0]["time_offset_bound_s"] == 0.005, "what is beside its row is known"
    config.unlink()
    mapping.write_text(
        f"{text}\ndirections = [{accelerometer}]\n[start]\nkind = 'first_measurement'\nbias_bound_deg_per_s = 1"
    )
    assert "start.bias_bound_deg_per_s is not for the guaranteed mode" in refused(
        "bounds", log, mapping, "--out", config
    )
    together = other.replace('"other", time_unit', '"t", time_unit')
    mapping.write_text(f"{text}\ndirections = [{accelerometer}, {together}]\n[estimator]\nmode='guaranteed'\nmost=2")
    assert "estimator.most" in refused("bounds", log, mapping, "--mode", "guaranteed", "--out", config)
    assert "--mode" in refused("bounds", log, mapping, "--mode", "first_order", "--out", config, exit_code=2)
    assert "--mode" in refused(*like, "--mode", "paper", exit_code=2)
    degrees = write_csv(tmp_path / "degrees.csv", [name.replace("deg/s", "rad/s") for name in HEADER])
    assert "degrees were declared as radians" in refused("bounds", degrees, "--out", config)
    degrees.unlink()
    assert "not written" in refused(*like[:-1], tmp_path / "nowhere" / "config.toml")
    assert not config.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.npz", "mapping.toml"]


def test_a_report_that_cannot_be_is_said_before_the_estimation(tmp_path, monkeypatch):
    log, config, out = write_csv(tmp_path / "log.csv", HEADER), tmp_path / "config.toml", tmp_path / "out"
    succeed("bounds", log, "--out", config)
    arguments = ("estimate", log, "--config", config, "--out", out, "--report")
    assert "no such file or folder" in refused(*arguments, tmp_path / "nowhere" / "report.html")
    (tmp_path / "there.html").touch()
    assert "--force" in refused(*arguments, tmp_path / "there.html")

    def missing():
        raise FileError("a report needs plotly")

    monkeypatch.setattr(report, "plotly_script", missing)
    assert "needs plotly" in refused(*arguments, tmp_path / "report.html")
    assert not out.exists()


# --- recordings -------------------------------------------------------------------------------------------------------


@needs_datasets
def test_two_commands_on_the_user_style_recording(tmp_path):
    config, out, page = tmp_path / "config.toml", tmp_path / "out", tmp_path / "report.html"
    succeed("bounds", xio(), "--out", config)
    assert_every_number_says_from_what_it_comes(config.read_text())
    arguments = ("estimate", xio(), "--config", config, "--out", out, "--report", page, "--json")
    said = json.loads(succeed(*arguments))
    assert said["mode"] == "guaranteed"
    assert said["rows"] > 13_000
    assert said["claim_share_of_rows"]["none"] < 0.05
    assert said["sizes"]["at_rest"]["tilt_bound_deg"]["mean"] < 5.0
    assert page.stat().st_size > 1e6


@needs_datasets
def test_first_order_on_the_user_style_recording(tmp_path):
    config = tmp_path / "config.toml"
    succeed("bounds", xio(), "--mode", "first_order", "--out", config)
    assert read_configuration(config).estimator.mode == "first_order"
    said = json.loads(succeed("estimate", xio(), "--config", config, "--out", tmp_path / "out", "--json"))
    assert said["rows"] > 13_000


@needs_datasets
@pytest.mark.parametrize("reference", ["--reference", "--no-reference"])
def test_a_recording_with_an_optical_attitude(tmp_path, reference):
    """With and without a look at the optical attitude it is in the sets; it may itself be off by 0.5 degrees."""
    config, out = tmp_path / "config.toml", tmp_path / "out"
    succeed("bounds", broad("02"), "--like", "broad", reference, "--out", config)
    assert read_configuration(config).truth_error == pytest.approx(np.deg2rad(0.5))
    said = json.loads(succeed("estimate", broad("02"), "--config", config, "--out", out, "--json"))
    assert said["compared_with"] == "the optical attitude"
    assert said["inside_share_of_updates"] >= 0.999
    assert said["claim_share_of_rows"]["unconditional"] >= 0.8
    assert said["sizes"]["at_rest"]["tilt_bound_deg"]["mean"] < 5.0


# --- how the sensor is carried ----------------------------------------------------------------------------------------


def test_how_the_sensor_is_carried_says_what_the_recording_does_not(tmp_path):
    log, config = write_npz(tmp_path / "log.npz", dataclasses.replace(made(), attitudes=None)), tmp_path / "car.toml"
    said = succeed("bounds", log, "--like", "broad", "--carried", "car", "--out", config)
    assert "by the rule for a sensor on a car (--carried hand" in said
    for words in ("motion.velocity_m_per_s", "250 km/h", "The magnetometer says nothing"):
        assert words in said
    written = tomllib.loads(config.read_text())["rule"]
    assert written["carried"] == "car"
    assert written["motion"]["velocity_m_per_s"] == 70.0
    assert "250 km/h, to which German makers limit their cars" in config.read_text()
    assert_every_number_says_from_what_it_comes(config.read_text())
    # What is usual for a car is not suspicious for a car.
    estimated = succeed("estimate", log, "--config", config, "--out", tmp_path / "out")
    assert "suspicious" not in estimated


def in_tenth_rows(path, *, cells, first):
    """A log whose last ``cells`` columns are empty but in every tenth row, from row ``first`` on."""
    log = write_csv(path, HEADER)
    header, *lines = log.read_text().splitlines()
    emptied = [",".join(line.split(",")[:-cells]) + "," * cells for line in lines]
    cut = [lines[i] if i % 10 == first else emptied[i] for i in range(len(lines))]
    log.write_text("\n".join([header, *cut]) + "\n")
    return log


def test_how_the_sensor_is_carried_is_stated_without_a_rule_too(tmp_path):
    """The magnetometer is in few rows, so that no rule can be used: a drone's numbers are compared with a drone's."""
    log = in_tenth_rows(tmp_path / "log.csv", cells=3, first=0)
    config, again = tmp_path / "drone.toml", tmp_path / "again.toml"
    succeed("bounds", log, "--carried", "drone", "--out", config)
    written = tomllib.loads(config.read_text())
    assert (written["carried"], "rule" in written) == ("drone", False)
    for command in (("check", log, config), ("estimate", log, "--config", config, "--out", tmp_path / "out")):
        assert "suspicious: " not in succeed(*command)
    # What is missing in a configuration is proposed for what it says, without the option.
    config.write_text(re.sub("noise_deg_per_s = .*", "", config.read_text()))
    assert "by the rule for a sensor on a drone" in succeed("bounds", log, config, "--out", again)
    assert tomllib.loads(again.read_text())["flow"]["noise_deg_per_s"] == 360.0
    # Where a rule can be used, it says that itself.
    ruled = tmp_path / "ruled.toml"
    whole = write_csv(tmp_path / "whole.csv", HEADER)
    given = {key: written[key] for key in ("time_column", "time_unit", "reference_frame", "carried") if key in written}
    keys = ("kind", "columns", "unit")
    given["flow"] = {key: written["flow"][key] for key in keys}
    given["directions"] = [{key: one[key] for key in ("name", *keys)} for one in written["directions"]]
    config.write_text(tomlkit.dumps(given))
    said = succeed("bounds", whole, config, "--out", ruled)
    assert "no rule can describe" not in said
    found = tomllib.loads(ruled.read_text())
    assert ("carried" in found, found["rule"]["carried"]) == (False, "drone")
    ruled.write_text('carried = "drone"\n' + ruled.read_text())
    assert "carried: is for the rule to say" in refused("check", whole, ruled)


def test_sensors_that_begin_apart_are_why_no_rule_can_be_used(tmp_path):
    """At its first row a recording whose sensors begin apart shows no rest, however long it rests."""
    log = in_tenth_rows(tmp_path / "log.csv", cells=6, first=3)
    said = succeed("bounds", log, "--out", tmp_path / "config.toml")
    assert "no rule can describe this recording: all sensors were sampled together in 10 % of the rows alone" in said


def test_statements_as_json(tmp_path):
    log = write_npz(tmp_path / "log.npz", made())
    summary = json.loads(succeed("bounds", log, "--like", "broad", "--carried", "boat", "--json"))
    statements = {(one["table"], one["key"]): one for one in summary["statements"]}
    assert summary["carried"] == "boat"
    assert statements["motion", "velocity_m_per_s"]["value"] == 30.0
    assert statements["motion", "velocity_m_per_s"]["reason"].startswith("50 knots")
    assert "rest of 5" in summary["why_no_rule"]  # a boat's rule asks for 10 s
    assert summary["what_they_say"]


def test_what_has_no_preset_is_refused_with_its_reason(tmp_path):
    log = write_npz(tmp_path / "log.npz", made())
    message = refused("bounds", log, "--like", "broad", "--carried", "spacecraft", exit_code=2)
    assert "in free fall" in message
    (tmp_path / "ruled.toml").write_text('[rule]\nkind = "hand_held"\n[flow]\nkind = "gyro"\ncolumns = ["x", "y", "z"]')
    message = refused("bounds", log, tmp_path / "ruled.toml", "--carried", "car", exit_code=2)
    assert "[rule] says all bounds" in message


def test_a_sensor_in_every_tenth_row_is_said(tmp_path):
    log = in_tenth_rows(tmp_path / "log.csv", cells=3, first=0)
    config, ruled = tmp_path / "config.toml", tmp_path / "ruled.toml"
    said = succeed("bounds", log, "--out", config)
    assert "no rule can describe this recording: all sensors were sampled together in 10 % of the rows alone" in said
    stated = tomllib.loads(config.read_text())
    succeed("estimate", log, "--config", config, "--out", tmp_path / "out")
    results = tables.Result.read(tmp_path / "out" / "results.csv")
    assert np.isfinite(results.largest_angles).any()
    stated["rule"] = {"kind": "hand_held"}
    stated["flow"] = {key: stated["flow"][key] for key in ("kind", "columns", "unit")}
    kept = ("name", "kind", "columns", "unit")
    stated["directions"] = [{key: one[key] for key in kept if key in one} for one in stated["directions"]]
    for name in ("bounds_from_recording", "start", "reference_frame"):
        stated.pop(name, None)
    ruled.write_text(tomlkit.dumps(stated))
    for arguments in (
        ("estimate", log, "--config", ruled, "--out", tmp_path / "none"),
        ("calibrate", log, ruled, "--out", tmp_path / "none.toml"),
    ):
        assert "this one was sampled in 10 % of the rows alone" in refused(*arguments)
    assert not (tmp_path / "none.toml").exists()


def test_the_rest_that_a_recording_has(tmp_path):
    """A longer one than usual counts as a whole; a shorter one where there is no other way to begin."""
    recording = made()
    config = tmp_path / "config.toml"
    log = write_npz(tmp_path / "log.npz", recording)
    succeed("bounds", log, "--like", "broad", "--out", config)
    rest = tomllib.loads(config.read_text())["rule"]["rest"]
    assert rest["least_s"] == 2.0
    assert 4.0 < rest["most_s"] < 5.5
    mapping = tmp_path / "mapping.toml"
    mapping.write_text(
        """
        time_column = "t"
        flow = { kind = "gyro", columns = ["gyr[0]", "gyr[1]", "gyr[2]"] }
        directions = [{ name = "up", kind = "accelerometer", columns = ["acc[0]", "acc[1]", "acc[2]"], unit = "m/s^2" }]
        reference_frame = "ENU"
        """
    )
    short = write_npz(tmp_path / "short.npz", recording, rows=recording.times > 3.5)
    out = tmp_path / "out"
    succeed("bounds", short, mapping, "--out", config, "--force")
    rule = tomllib.loads(config.read_text())["rule"]
    assert 0.5 <= rule["rest"]["least_s"] < 2.0
    assert rule["gyro"]["bias_deg_per_s"] > 0.25
    succeed("estimate", short, "--config", config, "--out", out)
    results = tables.Result.read(out / "results.csv")
    assert np.isfinite(results.up_bounds).mean() > 0.99


def test_a_reason_is_said_once(tmp_path):
    """In the file, in that of a rule and in the terminal; where it comes again, the name of the number that has it."""
    log, out, rule = tmp_path / "log.npz", tmp_path / "config.toml", tmp_path / "rule.toml"
    write_npz(log, made())
    said = succeed("bounds", log, "--like", "broad", "--out", out)
    succeed("bounds", log, "--like", "broad", "--rule", rule)
    for reason in filter(lambda one: len(one) > 40, rules.reasons_for("hand").values()):
        for text in (out.read_text(), rule.read_text()):
            assert text.count(reason) <= 1, reason
    assert out.read_text().count("the rule for a sensor in the hand") == 1
    again = "for the reason of gyro.largest_rate_deg_per_s"
    assert again in out.read_text()
    assert again in rule.read_text()
    assert "for the reason of" in " ".join(said.split())


def test_a_short_reason_is_said_again():
    once = document.Once(["a datasheet", "a reason that is much longer than the name of a number is"])
    assert once(("rule", "gyro", "noise"), "seen: a datasheet") == "seen: a datasheet"
    assert once(("rule", "gyro", "bias"), "seen: a datasheet") == "seen: a datasheet"
    long = "a reason that is much longer than the name of a number is"
    assert once(("a", "b"), f"part: {long}") == f"part: {long}"
    assert once(("c", "d"), long) == "for the reason of a.b"
    assert once(("a", "b"), long) == long
    assert once(("e", "f"), "of its own") == "of its own"


def test_the_numbers_to_check_are_those_of_the_file(tmp_path):
    """Without a rest each sensor states its own bounds, and what `bounds` lists is in the file, as it is there."""
    full = made()
    late = full.times >= 10.0
    log, out = tmp_path / "log.npz", tmp_path / "out.toml"
    write_npz(log, full, rows=late & (full.times < 30.0))
    said = succeed("bounds", log, "--like", "broad", "--no-reference", "--out", out)
    said = said[said.index("What sets will rest on") :]
    listed = dict(re.findall(r"^  (\S+) = (.*)$", said, re.M))
    file = tomllib.loads(out.read_text())
    assert "rule" not in file
    assert not any(name.startswith("rest.") for name in listed)
    assert {"flow.bias_deg_per_s", "up.sensor_error.error_m_per_s2", "up.bound_from.velocity_m_per_s"} <= listed.keys()
    sensors = {sensor["name"]: sensor for sensor in file["directions"]}
    for name, number in listed.items():
        place = file | sensors
        for key in name.split("."):
            place = place[key]
        values = place if isinstance(place, list) else [place]
        assert number == ", ".join(f"{value:g}" for value in values), name
