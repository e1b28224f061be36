"""`elliptude.ahrs`: the numbers of the command line, from arrays; bad input; what people look at."""

import importlib.util
import re
import sys

import elliptude as el
import numpy as np
import pytest
import tomlkit
from elliptude import cli
from elliptude.configuration.rules import rule_for
from elliptude.io.tables import Result
from elliptude.monitoring import monitor
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

HAND = 'kind = "hand_held"\nanchor_s = 4.0\n'


def run(*arguments):
    done = CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output
    return done


def made(count=1200, rate=100.0, resting=300, seed=1):
    """A sensor that rests and is then turned: times, rad/s, m/s², µT, and its attitudes in ENU."""
    rng = np.random.default_rng(seed)
    times = np.arange(count) / rate
    moving = np.clip((np.arange(count) - resting) / 50.0, 0.0, 1.0)[:, None]
    rates = moving * np.column_stack([0.4 * np.sin(times), 0.5 * np.cos(0.7 * times), 0.3 * np.sin(0.3 * times)])
    attitudes = [np.eye(3)]
    for k in range(1, count):
        attitudes.append(attitudes[-1] @ el.exp(0.5 * (rates[k - 1] + rates[k]) / rate))
    attitudes = np.array(attitudes)
    forces = np.einsum("nji,j->ni", attitudes, [0.0, 0.0, 9.81]) + rng.uniform(-0.02, 0.02, (count, 3))
    fields = np.einsum("nji,j->ni", attitudes, [0.0, 20.0, -40.0]) + rng.uniform(-0.1, 0.1, (count, 3))
    return times, rates + rng.uniform(-1e-3, 1e-3, (count, 3)), forces, fields, attitudes


@pytest.fixture(scope="module")
def recording():
    return made()


@pytest.fixture(scope="module")
def by_hand(recording):
    times, rates, forces, fields, _ = recording
    return el.ahrs(times, rates, forces, fields, mag_unit="uT")


def write(path, times, rates, forces, fields=None):
    head = [
        "Time (s)",
        *(f"Gyroscope {axis} (rad/s)" for axis in "XYZ"),
        *(f"Accelerometer {axis} (m/s^2)" for axis in "XYZ"),
    ]
    columns = [times, *rates.T, *forces.T]
    if fields is not None:
        head += [f"Magnetometer {axis} (uT)" for axis in "XYZ"]
        columns += [*fields.T]
    rows = [
        ",".join("" if np.isnan(value) else repr(float(value)) for value in row) for row in zip(*columns, strict=True)
    ]
    path.write_text("\n".join([",".join(head), *rows]) + "\n")


def test_up_that_contradicts_what_the_gyro_carries_is_told():
    """The accelerometer is upside down from halfway on: a statement is proved wrong, which no other sensor shows."""
    times, rates, forces, _, _ = made(count=3000)
    sound = el.ahrs(times, rates, forces)
    assert not any("contradict" in note for note in sound.notes)
    upside_down = np.where(times[:, None] < 15.0, forces, -forces)
    wrong = el.ahrs(times, rates, upside_down, implausible="ignore")
    told = [note for note in wrong.notes if "contradict up as the gyro carries it" in note]
    assert len(told) == 1
    assert wrong.dropped["up"] >= 1
    assert "conditional" in wrong.up_claims


@pytest.mark.parametrize("statements", ["hand", "recording", "file"])
@pytest.mark.parametrize("with_field", [True, False], ids=["field", "no field"])
def test_the_numbers_are_those_of_the_commands(tmp_path, recording, statements, with_field):
    times, rates, forces, fields, _ = recording
    fields = fields if with_field else None
    log, config, rule = tmp_path / "log.csv", tmp_path / "config.toml", tmp_path / "rule.toml"
    write(log, times, rates, forces, fields)
    run("bounds", log, "--out", config, "--rule", rule)
    if statements != "recording":
        # What was proposed, up to its rule; then the rule that is stated.
        text = config.read_text().split("\n[rule]\n")[0].replace('bounds_from_recording = "log.csv"', "#")
        stated = HAND if statements == "hand" else f'kind = "file"\nfile = "{rule}"\nanchor_s = 4.0\n'
        config.write_text(f"{text}\n[rule]\n{stated}")
    run("estimate", log, "--config", config, "--out", tmp_path / "result")
    expected = Result.read(tmp_path / "result" / "results.csv").columns()
    found = el.ahrs(
        times, rates, forces, fields, statements=rule if statements == "file" else statements, mag_unit="uT"
    )
    assert set(found.columns) == set(expected)
    for name, column in expected.items():
        if isinstance(column, np.ndarray) and column.dtype.kind == "f":
            np.testing.assert_array_equal(found.columns[name], column, err_msg=name)
        else:
            assert [word or None for word in found.columns[name]] == [word or None for word in column], name
    assert (found.claims != "none").mean() > 0.9
    assert found.are_proposals == (statements != "hand")
    # What another filter is judged by knows it, too.
    judged = monitor(found.sets, found.attitudes @ el.exp([2.5, 0.0, 0.0]))
    assert (judged.alarms.proved.any(), judged.alarms.conditional.any()) == (statements == "hand", statements != "hand")
    assert found.heading == ("from magnetic east" if with_field else "from the first row")


def test_times_since_1970_are_counted_as_the_commands_do(tmp_path, recording):
    times, rates, forces, fields, _ = recording
    log, config = tmp_path / "log.csv", tmp_path / "config.toml"
    write(log, 1_700_000_000.25 + times, rates, forces, fields)
    run("bounds", log, "--out", config)
    run("estimate", log, "--config", config, "--out", tmp_path / "result")
    expected = Result.read(tmp_path / "result" / "results.csv")
    found = el.ahrs(1_700_000_000.25 + times, rates, forces, fields, statements="recording", mag_unit="uT")
    np.testing.assert_array_equal(found.times, expected.times)
    np.testing.assert_array_equal(found.quaternions, expected.quaternions)
    assert found.times[0] == 0.25


@pytest.mark.parametrize("carried", ["person", "drone", "car", "boat"])
def test_how_a_sensor_is_carried_is_a_rule(tmp_path, carried):
    path = tmp_path / "rule.toml"
    path.write_text(tomlkit.dumps(rule_for(carried).model_dump(mode="json", exclude_none=True)))
    times, rates, forces, fields, _ = made(count=1500, resting=1100)  # a boat's rule asks for 10 s
    by_hand, named, read = (
        el.ahrs(times, rates, forces, fields, statements=one, mag_unit="uT") for one in ("hand", carried, path)
    )
    np.testing.assert_array_equal(named.quaternions, read.quaternions)
    np.testing.assert_array_equal(named.up_bounds, read.up_bounds)
    assert not named.are_proposals
    assert not np.array_equal(named.up_bounds, by_hand.up_bounds)


def test_an_acceleration_above_2_g_passes_if_the_user_says_so():
    """As at the wrist of somebody who runs: the refusal names the argument that lets it pass, and a note says it."""
    times, rates, forces, _, _ = made(count=600, resting=250)
    forces[250:] *= 3.0
    with pytest.raises(ValueError, match=r"acc: its median norm is 29\.\d+ m/s\^2, .*implausible='ignore'"):
        el.ahrs(times, rates, forces)
    found = el.ahrs(times, rates, forces, implausible="ignore")
    assert len(found) == 600
    assert any("acc: its median norm is 29" in note for note in found.notes)


def test_the_truth_is_within_all_that_is_claimed(recording, by_hand):
    attitudes = recording[-1]
    assert len(by_hand) == len(attitudes)
    assert (by_hand.claims == "unconditional").all()
    assert by_hand.contains(attitudes).all()
    true = Rotation.from_matrix(attitudes).as_euler("ZYX")[:, ::-1]
    middle = 0.5 * (by_hand.least_roll_pitch_yaw + by_hand.most_roll_pitch_yaw)
    half = 0.5 * (by_hand.most_roll_pitch_yaw - by_hand.least_roll_pitch_yaw)
    away = np.abs((true - middle + np.pi) % (2 * np.pi) - np.pi)
    assert (away <= half).all()
    assert (half.mean(axis=0) < np.deg2rad([30, 30, 90])).all()
    # And in the resting part the values are those of a sensor that lies flat, its y axis to the north.
    assert np.abs(by_hand.roll_pitch_yaw[:250]).max() < 0.02
    np.testing.assert_allclose(by_hand.attitudes[:250], np.tile(np.eye(3), (250, 1, 1)), atol=0.02)


def test_questions_are_more_columns(recording, by_hand):
    times, rates, forces, fields, attitudes = recording
    found = el.ahrs(times, rates, forces, fields, mag_unit="uT", questions=["body_turns", "attitude"])
    for name, column in by_hand.columns.items():
        np.testing.assert_array_equal(found.columns[name], column, err_msg=name)
    new = set(found.columns) - set(by_hand.columns)
    assert {"turn_bx_from", "turn_bz_to", "own_qw", "own_P33"} <= new
    assert not any(name.startswith(("turn_e", "bias_x_")) for name in new)
    gibbs = 2.0 * el.cayley_inverse(found.attitudes.swapaxes(1, 2) @ attitudes)
    for axis, name in enumerate("xyz"):
        turned = 2.0 * np.arctan(0.5 * gibbs[:, axis])
        assert (found.columns[f"turn_b{name}_from"] <= turned).all()
        assert (turned <= found.columns[f"turn_b{name}_to"]).all()
    with pytest.raises(ValueError, match=r"questions: 'vector' is none of reference_turns, body_turns, attitude"):
        el.ahrs(times, rates, forces, fields, mag_unit="uT", questions=["vector"])


def test_units_and_kinds_of_arrays_do_not_matter(recording, by_hand):
    times, rates, forces, fields, _ = recording
    other = el.ahrs(
        list(times), np.rad2deg(rates), forces / 9.80665, fields * 1e-6, gyr_unit="deg/s", acc_unit="g", mag_unit="T"
    )
    np.testing.assert_allclose(other.quaternions, by_hand.quaternions, atol=1e-9)
    np.testing.assert_allclose(other.up_bounds, by_hand.up_bounds, atol=1e-9)


def test_frames_go_in_and_come_out(recording, by_hand):
    pandas = pytest.importorskip("pandas")
    times, rates, forces, fields, _ = recording
    frame = pandas.DataFrame(np.column_stack([times, rates, forces, fields]), columns=list("tabcdefghi"))
    found = el.ahrs(frame["t"], frame[list("abc")], frame[list("def")], frame[list("ghi")], mag_unit="uT")
    np.testing.assert_array_equal(found.quaternions, by_hand.quaternions)
    made = found.to_frame()
    assert list(made.columns) == list(found.columns)
    np.testing.assert_array_equal(made["roll_from"], found.least_roll_pitch_yaw[:, 0])
    assert set(made["claim"]) == {"unconditional"}
    stamps = pandas.to_datetime(1_700_000_000.0 + times, unit="s")
    dated = el.ahrs(stamps, rates, forces, fields, mag_unit="uT")
    np.testing.assert_allclose(dated.times, times, atol=1e-6)
    with pytest.raises(ValueError, match="library: 'excel', neither 'pandas' nor 'polars'"):
        found.to_frame("excel")


def test_without_a_library_for_frames_the_message_names_both(by_hand, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(ModuleNotFoundError, match="pandas or polars"):
        by_hand.to_frame()
    if importlib.util.find_spec("polars") is None:
        with pytest.raises(ModuleNotFoundError, match="polars"):
            by_hand.to_frame("polars")


def test_what_is_not_installed_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "elliptude.from_arrays.ahrs", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'elliptude\[cli\]'"):
        el.ahrs(**GOOD)


def test_what_is_masked_was_not_measured(recording):
    times, rates, forces, fields, _ = recording
    mask = np.zeros(fields.shape, dtype=bool)
    mask[1::2] = True
    empty = np.where(mask, np.nan, fields)
    masked, found = (
        el.ahrs(times, rates, forces, one, mag_unit="uT") for one in (np.ma.array(fields, mask=mask), empty)
    )
    np.testing.assert_array_equal(masked.quaternions, found.quaternions)


def test_what_people_look_at(by_hand):
    line = repr(by_hand)
    assert "\n" not in line
    assert len(line) < 250
    assert re.search(r"1200 rows, 0 to 11.99 s; claims: unconditional 100 %", line)
    page = by_hand._repr_html_()
    assert page.count("<svg") == 3
    assert "nan" not in page
    assert len(page) < 200_000


def test_a_sensor_that_is_slower_has_empty_rows(recording):
    times, rates, forces, fields, _ = recording
    slow = fields.copy()
    slow[1::2] = np.nan
    found = el.ahrs(times, rates, forces, slow, mag_unit="uT")
    assert len(found) == len(times)


def changed(values, place, value):
    values = np.array(values, dtype=float)
    values[place] = value
    return values


TIMES, RATES, FORCES, FIELDS, _ = made(count=300)
GOOD = {"time": TIMES, "gyr": RATES, "acc": FORCES, "mag": FIELDS, "mag_unit": "uT"}


def test_a_field_that_no_statement_rules_out_is_suspicious(recording):
    """A tenth of the Earth's field, as in a shielded room: odd, but nothing that is stated contradicts it."""
    times, rates, forces, fields, _ = recording
    found = el.ahrs(times, rates, forces, 0.08 * fields, mag_unit="uT")
    assert any(
        re.match(r"suspicious: mag: its median norm is 3\.5\d+ uT, which is not the", one) for one in found.notes
    )
    assert (found.up_claims == "unconditional").all()


def test_an_acceleration_that_a_rule_states_is_suspicious(recording, tmp_path):
    """As on a centrifuge: above 2 g in the mean, and a rule that allows it."""
    times, rates, forces, _, _ = recording
    forces = forces.copy()
    forces[300:] *= 3.0
    rule = rule_for("hand").model_dump(mode="json", exclude_none=True)
    rule["motion"] |= {"velocity_m_per_s": 1e4, "position_m": 1e5}
    rule["accelerometer"]["scale_error"] = 0.9
    path = tmp_path / "centrifuge.toml"
    path.write_text(tomlkit.dumps(rule))
    found = el.ahrs(times, rates, forces, statements=path)
    assert any(note.startswith("suspicious: acc: its median norm is 29") for note in found.notes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"time": TIMES[:-1]}, r"gyr: shape \(300, 3\), not \(299, 3\)"),
        ({"time": TIMES[:, None]}, r"time: shape \(300, 1\), not \(N,\)"),
        ({"time": changed(TIMES, 7, 0.0)}, r"time\[7\] is 0\.0, not after time\[6\]"),
        ({"time": changed(TIMES, 7, np.nan)}, r"time\[7\] is nan, not finite"),
        ({"time": "now"}, "time: str, not an array"),
        ({"gyr": RATES[:, :2]}, r"gyr: shape \(300, 2\), not \(300, 3\)"),
        ({"gyr": changed(RATES, (5, 1), np.nan)}, r"gyr\[5, 1\] is nan, but the gyro is needed in every row"),
        ({"gyr": changed(RATES, (5, 1), np.inf)}, r"gyr\[5, 1\] is inf, more than 1e\+09 rad/s in size"),
        ({"gyr": None}, "gyr: NoneType, not an array"),
        ({"acc": changed(FORCES, (5, 1), 1e300)}, r"acc\[5, 1\] is 1e\+300, more than 1e\+09 m/s\^2 in size"),
        ({"acc": changed(FORCES, (5, 1), np.nan)}, r"acc\[5, 1\] is nan, but other components"),
        ({"acc": changed(FORCES, 5, 0.0)}, r"acc\[5\] is .*without a direction"),
        ({"acc": changed(FORCES, 5, 1e-200)}, r"acc\[5\] is .*below 1e-130 m/s\^2 in size: without a direction"),
        ({"acc": FORCES / 9.80665}, r"acc: its median norm is 1 m/s\^2, which is not gravity .*acc_unit='g'"),
        ({"acc": np.full((300, 3), np.nan)}, "acc: no row has numbers"),
        ({"acc": np.full((300, 3), "a")}, "acc: an array of <U1, not of numbers"),
        ({"mag_unit": "T"}, r"mag: its median norm is 44.* T, which is not the Earth's field .*mag_unit='uT'"),
        ({"mag_unit": "tesla"}, "mag_unit: 'tesla' is none of T, mT, G, mG, uT, nT"),
        ({"gyr_unit": "rpm"}, "gyr_unit: 'rpm' is none of rad/s, deg/s"),
        ({"gyr": [[1.0], [1.0, 2.0]]}, "gyr: not an array of numbers"),
        ({"statements": "/no/such/rule.toml"}, "/no/such/rule.toml"),
    ],
)
def test_bad_input_is_named(changes, said):
    arguments = GOOD | changes
    with pytest.raises((ValueError, TypeError), match=said) as caught:
        el.ahrs(**arguments)
    assert "\n" not in str(caught.value)


def test_what_is_implausible_is_told_and_can_be_ignored(recording):
    times, rates, forces, fields, _ = recording
    turned = forces[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    with pytest.raises(ValueError, match="axes"):
        el.ahrs(times, rates, turned, fields, mag_unit="uT", statements="recording")
    found = el.ahrs(times, rates, turned, fields, mag_unit="uT", statements="recording", implausible="ignore")
    assert any("axes" in note for note in found.notes)
    with pytest.raises(ValueError, match="implausible: 'maybe', neither 'refuse' nor 'ignore'"):
        el.ahrs(times, rates, turned, fields, mag_unit="uT", implausible="maybe")


def test_a_recording_without_a_rest_needs_other_statements(recording):
    moving = [values[400:] for values in recording[:4]]
    with pytest.raises(ValueError, match=r"statements='hand': the recording starts with a rest of .* s; .*'recording'"):
        el.ahrs(*moving, mag_unit="uT")


def test_a_wrong_unit_of_the_gyro_is_told(recording):
    times, rates, forces, fields, _ = recording
    with pytest.raises(ValueError, match=r"degrees|radians"):
        el.ahrs(times, np.rad2deg(rates), forces, fields, mag_unit="uT")


def test_dates_with_a_time_zone_are_times(recording):
    pandas = pytest.importorskip("pandas")
    times, *sensors, _ = recording
    zoned = pandas.to_datetime(1.7e9 + times, unit="s", utc=True).tz_convert("Europe/Berlin")
    expected = el.ahrs(zoned.tz_convert("UTC").tz_localize(None), *sensors, mag_unit="uT")
    for time in (zoned, pandas.Series(zoned), list(zoned), zoned.to_pydatetime()):
        found = el.ahrs(time, *sensors, mag_unit="uT")
        np.testing.assert_allclose(found.times, expected.times, rtol=0, atol=1e-6)
        np.testing.assert_allclose(found.quaternions, expected.quaternions, rtol=0, atol=1e-4)


def test_a_rotation_of_scipy_is_an_attitude(recording, by_hand):
    attitudes = recording[-1]
    inside = by_hand.contains(Rotation.from_matrix(attitudes))
    assert inside.all()
    np.testing.assert_array_equal(inside, by_hand.contains(attitudes))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"gyr_unit": ["rad/s"]}, "gyr_unit: ['rad/s'] is none of rad/s, deg/s"),
        ({"statements": None}, "statements: None is none of 'hand'"),
        ({"questions": None}, "questions: None, not a list of words: reference_turns, body_turns, attitude"),
        ({"time": [object()] * 1200}, "time: an array with <object"),
        ({"acc": np.full((1200, 3), "up", dtype=object)}, "acc: an array with 'up', a str, not of numbers"),
    ],
)
def test_what_is_of_a_wrong_type_is_named(recording, changes, said):
    times, gyr, acc, mag, _ = recording
    arguments = {"time": times, "gyr": gyr, "acc": acc, "mag": mag, "mag_unit": "uT"} | changes
    with pytest.raises((TypeError, ValueError), match=re.escape(said)):
        el.ahrs(**arguments)


@pytest.mark.parametrize("statements", ["hand", "recording"])
def test_a_strong_field_that_is_the_same_everywhere_is_no_wrong_unit(recording, statements):
    """860 µT, as in a coil: disturbances are counted from the field of the rest, and no other unit explains it."""
    times, rates, forces, fields, _ = recording
    result = el.ahrs(times, rates, forces, 860.0 / np.hypot(20.0, 40.0) * fields, mag_unit="uT", statements=statements)
    assert not any("as they count" in note for note in result.notes)


@pytest.mark.parametrize(("factor", "stated", "meant"), [(1.0, "T", "uT"), (1e-6, "uT", "T"), (1e3, "uT", "nT")])
def test_a_unit_is_asked_of_its_own_sensor(recording, factor, stated, meant):
    """No unit explains the accelerometer's length, and one explains the magnetometer's, suspicious or refused."""
    times, rates, forces, fields, _ = recording
    with pytest.raises(ValueError, match="mag: its median norm") as error:
        el.ahrs(times, rates, 0.3 * forces, factor * fields, mag_unit=stated)
    assert "acc: its median norm" in str(error.value)
    assert f"mag_unit='{meant}'" in str(error.value)
    assert "acc_unit=" not in str(error.value)


def test_a_field_that_is_refused_names_its_limit(recording):
    """As a gyro's, an accelerometer's and every other refusal: argument, value, limit, each with its unit."""
    times, rates, forces, fields, _ = recording
    rule = rule_for("hand").magnetometer
    most = (1.0 + rule.scale_error) * (70.0 + rule.disturbance_ut) + rule.error_ut
    for factor, unit, number, limit in (
        (1e3, "uT", "4.47", f"{most:.4g} uT"),
        (1.0, "T", "44.7", f"{most * 1e-6:.4g} T"),
    ):
        said = rf"mag: its median norm is {number}\S* {unit}, .*; its errors in µT as they count allow at most "
        said += rf"{re.escape(limit)}, beside the Earth's 70 µT"
        with pytest.raises(ValueError, match=said):
            el.ahrs(times, rates, forces, factor * fields, mag_unit=unit)


@pytest.mark.parametrize(
    ("gravity", "implausible", "count"), [(1.0, "refuse", 2), (1.0, "ignore", 2), (19.0, "ignore", 1)]
)
def test_what_a_rule_states_is_named_as_its_file_has_it(recording, tmp_path, gravity, implausible, count):
    """And once, although the log rules it out and it is odd by itself, before what the log shows because of it."""
    rule = rule_for("hand").model_dump(mode="json", exclude_none=True)
    rule["accelerometer"]["gravity_m_per_s2"] = gravity
    path = tmp_path / "rule.toml"
    path.write_text(tomlkit.dumps(rule))
    with pytest.raises(ValueError, match=rf"acc: accelerometer\.gravity_m_per_s2 = {gravity:g} is not") as error:
        el.ahrs(*recording[:4], mag_unit="uT", statements=path, implausible=implausible)
    said = str(error.value)
    assert said.count("gravity_m_per_s2") == count
    assert ("acc: its median norm is 9.8" in said.partition("gravity_m_per_s2")[2]) == (gravity == 1.0)
    assert "rule." not in said


def test_wrong_axes_are_mended_by_what_is_advised(recording):
    """It is an expression of the array, as no argument states axes."""
    times, rates, forces, fields, _ = recording
    with pytest.raises(ValueError, match=r"mag: its axes are not as stated.* What fits is mag\[:, ") as error:
        el.ahrs(times, rates, forces, fields[:, [1, 0, 2]] * [1, -1, 1], mag_unit="uT")
    assert "axes = " not in str(error.value)
    swapped = {"mag": fields[:, [1, 0, 2]] * [1, -1, 1]}
    advised = str(error.value).partition("What fits is ")[2].partition(" (")[0]
    np.testing.assert_array_equal(eval(advised, swapped), fields)
    with pytest.raises(ValueError, match=r"gyr: its axes are not as stated.* With .*-gyr"):
        el.ahrs(times, -rates, forces, fields, mag_unit="uT")


def test_an_odd_statement_of_a_rule_is_noted(recording, tmp_path):
    """As `estimate` says it; by the table that the file has, in the words of arguments."""
    rule = rule_for("hand").model_dump(mode="json", exclude_none=True)
    rule["gyro"]["noise_deg_per_s"] = 1e-6
    path = tmp_path / "rule.toml"
    path.write_text(tomlkit.dumps(rule))
    notes = el.ahrs(*recording[:4], mag_unit="uT", statements=path).notes
    assert sum(note.startswith("suspicious: gyr: ") and "noise_deg_per_s" in note for note in notes) == 1


def test_a_reference_that_nobody_stated_is_no_argument(recording):
    """Without a rest `bounds` makes it of the magnetometer's numbers."""
    times, rates, forces, fields, _ = (values[400:] for values in recording)
    with pytest.raises(ValueError, match=r"in nT: mag_unit='nT'.* made of it is 4\.\d+e\+04 µT long") as error:
        el.ahrs(times, rates, forces, 1e3 * fields, mag_unit="uT", statements="recording")
    assert "reference_ut" not in str(error.value)
    assert "is mag_unit right?" in str(error.value)


def test_a_gyro_that_is_stuck_is_named_beside_the_sensor_that_seems_wrong():
    """Where it stopped the magnetometer turns on, and not as the gyro says."""
    times, rates, forces, fields, _ = made(count=3000)
    rates[800:] = rates[800]
    with pytest.raises(ValueError, match=r"mag: does not turn .* Suspicious: gyr: shows the same from row 800"):
        el.ahrs(times, rates, forces, fields, mag_unit="uT")


def test_directions_are_called_as_the_arguments_are(recording):
    """Wherever a message comes from."""
    times, rates, forces, fields, _ = recording
    found = el.ahrs(times, rates, 1e3 * forces, fields, mag_unit="uT", statements="recording", implausible="ignore")
    assert any("'acc' contradicts its own bounds" in note for note in found.notes)
    assert not any("'up'" in note for note in found.notes)
    # Tables are those of the commands.
    assert "up" in found.dropped
    assert set(" ".join(found.columns["used"]).split()) <= {"up", "field", "east"}


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_times_that_are_no_seconds_are_named(factor, unit):
    still = np.ones((2000, 1))
    with pytest.raises(ValueError, match=rf"time is in s.*: are they {unit}\?"):
        el.ahrs(0.01 * factor * np.arange(2000), still * [0.0, 0.0, 0.0], still * [0.0, 0.0, 9.81])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("k", "time"), [(0, -1e300), (0, -2e10), (1999, 1e300), (1999, 1e17), (1999, 1.7e9 + 2e10)])
@pytest.mark.parametrize("begin", [0.0, 1.7e9])
def test_a_stamp_that_is_no_time(k, time, begin):
    still, times = np.ones((2000, 1)), begin + 0.01 * np.arange(2000)
    times[k] = time
    with pytest.raises(ValueError, match=rf"time\[{k}\]: the time {re.escape(f'{time:.6g}')} s: is its unit right\?"):
        el.ahrs(times, still * [0.0, 0.0, 0.0], still * [0.0, 0.0, 9.81])


def test_what_contradicts_is_said_in_arguments(recording):
    times, rates, forces, fields, _ = recording
    with pytest.raises(
        ValueError, match=r"acc: turns .* as if its degrees were declared as radians: gyr_unit='deg/s'"
    ) as raised:
        el.ahrs(times, np.rad2deg(rates), forces, fields, mag_unit="uT")
    said = str(raised.value)
    assert said.endswith("If it is right as it is: implausible='ignore'")
    assert "configuration" not in said
    with pytest.raises(
        ValueError, match=r"gyr: 0 in all of .* though acc turns by up to .*: is it off\? If it is right"
    ):
        el.ahrs(times, 0.0 * rates, forces, fields, mag_unit="uT")
