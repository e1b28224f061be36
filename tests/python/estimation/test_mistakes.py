"""Mistakes of a user, as typed: whether he is told, where he sees it, and before he trusts a result."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
import tomlkit
from elliptude import cli
from elliptude.configuration import Configuration, rules
from elliptude.configuration.findings import suspicions
from elliptude.io import column_files, tables
from elliptude.logs.body_at_rest import axis_in_words, up_at_rest
from elliptude.logs.quaternion_readings import misread, readings
from elliptude.report.estimated.reading import read_run
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

G = 9.807
FIELD = np.array([0.0, 18.0, -41.0])


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def words(done):
    return " ".join(done.output.split())


def recording(duration=30.0, heading=0.0):
    """A sensor that lies with its y axis up for three seconds, and is then turned about by a hand."""
    rng = np.random.default_rng(7)
    times = np.arange(0.0, duration, 0.01)
    moving = np.clip(times - 3.5, 0.0, 1.0)[:, None]
    rates = moving * np.column_stack(
        [1.1 * np.sin(1.3 * times), 0.9 * np.cos(0.7 * times), 1.2 * np.sin(0.4 * times + 1.0)]
    )
    attitudes = [Rotation.from_euler("z", heading, degrees=True) * Rotation.from_euler("x", 90, degrees=True)]
    for step in Rotation.from_rotvec(0.005 * (rates[1:] + rates[:-1])):
        attitudes.append(attitudes[-1] * step)
    attitudes = Rotation.concatenate(attitudes)
    noise = rng.uniform(-1.0, 1.0, (3, len(times), 3))
    return {
        "t": times,
        "gyr": rates + 0.001 * noise[0],
        "acc": attitudes.inv().apply([0.0, 0.0, G]) + 0.03 * noise[1],
        "mag": attitudes.inv().apply(FIELD) + 0.2 * noise[2],
        "q": attitudes.as_quat(canonical=True, scalar_first=True),
    }


def columns(name, count=3):
    return [f"{name}[{i}]" for i in range(count)]


def by_rule(**changes):
    return {
        "time_column": "t",
        "rule": {"kind": "hand_held", "anchor_s": 4.0},
        "flow": {"kind": "gyro", "columns": columns("gyr")},
        "directions": [
            {"name": "up", "kind": "accelerometer", "columns": columns("acc"), "unit": "m/s^2"},
            {"name": "field", "kind": "magnetometer", "columns": columns("mag"), "unit": "uT"},
        ],
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
        "truth": {"attitude_columns": columns("q", 4), "label": "cameras", "error_deg": 0.5},
    } | changes


def by_sensor(**flow):
    return {
        "time_column": "t",
        "reference_frame": "ENU",
        "flow": {"kind": "gyro", "columns": columns("gyr"), "noise_deg_per_s": 1.0} | flow,
        "directions": [
            {
                "name": "up", "kind": "accelerometer", "columns": columns("acc"), "unit": "m/s^2",
                "bound_from": {"kind": "velocity_window", "windows_s": [1.0, 2.0], "velocity_m_per_s": 3.0},
            },
            {
                "name": "field", "kind": "magnetometer", "columns": columns("mag"), "unit": "uT",
                "reference_ut": FIELD.tolist(), "bound_from": {"kind": "field", "disturbance_ut": 5.0},
            },
        ],
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
    }  # fmt: skip


def files(folder, configuration, arrays=None):
    np.savez(folder / "log.npz", **(recording() if arrays is None else arrays))
    (folder / "log.toml").write_text(tomlkit.dumps(configuration))
    return folder / "log.npz", folder / "log.toml"


# --- axes -------------------------------------------------------------------------------------------------------------


def test_swapped_columns_are_refused_unless_told(tmp_path):
    configuration = by_rule()
    configuration["directions"][0]["columns"] = ["acc[1]", "acc[0]", "acc[2]"]
    log, config = files(tmp_path, configuration)
    done = run("estimate", log, "--config", config, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "up: its axes are not as stated" in words(done)
    # Back: x is the second column, y the first; the opposite of that is right-handed.
    assert 'axes = ["-y", "-x", "-z"]' in words(done)
    assert "the same with at_rest = 'down'" in words(done)
    assert "--ignore-implausible" in words(done)
    assert not (tmp_path / "out").exists()
    assert "its axes are not as stated" in words(run("check", log, config))
    # What it names is right: with it the log passes, and the truth is in all sets.
    configuration["directions"][0] |= {"axes": ["-y", "-x", "-z"], "at_rest": "down"}
    log, config = files(tmp_path, configuration)
    done = run("estimate", log, "--config", config, "--out", tmp_path / "right", "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["inside_share_of_unconditional_rows"] == 1.0
    assert json.loads(done.stdout)["implausible"] == []


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_what_was_gone_on_with_is_said(tmp_path, suffix):
    configuration = by_rule()
    configuration["directions"][1]["columns"] = ["mag[1]", "mag[0]", "mag[2]"]
    log, config = files(tmp_path, configuration)
    out, page = tmp_path / "out", tmp_path / "report.html"
    arguments = ["--config", config, "--out", out, "--format", suffix, "--report", page]
    done = run("estimate", log, *arguments, "--ignore-implausible")
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("gone on although implausible: field: its axes are not as stated")
    (said,) = json.loads((out / "summary.json").read_text())["implausible"]
    assert said.startswith("field: its axes are not as stated")
    if suffix == "csv":
        second = (out / "results.csv").read_text().splitlines()[1]
        assert second == f"# implausible, and gone on regardless: {said}"
    else:
        metadata = pyarrow.parquet.read_schema(out / "results.parquet").metadata
        assert metadata[b"elliptude notes"].decode() == f"implausible, and gone on regardless: {said}"
    assert read_run(out)[0].implausible == (said,)
    assert "implausible, gone on regardless" in page.read_text(encoding="utf-8")
    # So it is by the configuration's own key.
    log, config = files(tmp_path, configuration | {"implausible": "ignore"})
    done = run("estimate", log, "--config", config, "--out", tmp_path / "key", "--json")
    assert json.loads(done.stdout)["implausible"] == [said]


def test_bounds_are_not_proposed_for_wrong_axes(tmp_path):
    configuration = by_rule()
    configuration["flow"]["columns"] = ["gyr[0]", "gyr[2]", "gyr[1]"]
    for option in ("--out", "--rule"):
        done = run("bounds", *files(tmp_path, configuration), option, tmp_path / "new.toml")
        assert done.exit_code == 1
        assert "the gyro: its axes are not as stated" in words(done)
        assert 'columns = ["gyr[0]", "gyr[1]", "gyr[2]"]' in words(done)
        assert not (tmp_path / "new.toml").exists()
    # Its quantiles may be looked at.
    done = run("bounds", tmp_path / "log.npz", tmp_path / "log.toml")
    assert done.exit_code == 0, done.output
    assert "implausible: the gyro: its axes are not as stated" in words(done)


@pytest.mark.parametrize("wrong", ["up", "field", "reference"])
def test_a_sign_that_the_stated_references_contradict(tmp_path, wrong):
    """No turn tells it, but the field would point out of the ground where its reference points into it."""
    configuration = by_sensor()
    up, field = configuration["directions"]
    match wrong:
        case "up":
            up["at_rest"] = "down"
        case "field":
            field["axes"] = ["-x", "y", "-z"]
            field["columns"] = ["mag[0]", "mag[1]", "mag[2]"]
            arrays = recording()
            arrays["mag"] *= [1.0, -1.0, 1.0]  # so that all three have the other sign
        case _:  # the numbers of north, east, down
            field["reference_ut"] = (FIELD * [1.0, 1.0, -1.0]).tolist()
    log, config = files(tmp_path, configuration, arrays if wrong == "field" else None)
    for command in (
        ("check", log, config),
        ("estimate", log, "--config", config, "--out", tmp_path / "out"),
        ("bounds", log, config, "--out", tmp_path / "new.toml"),
    ):
        done = run(*command)
        assert done.exit_code == 1
        assert "field: its sign or that of 'up' is not as stated" in words(done), done.output
        assert f"at_rest = '{'up' if wrong == 'up' else 'down'}' for 'up'" in words(done)
    assert not (tmp_path / "out").exists()
    log, config = files(tmp_path, by_sensor())
    assert run("check", log, config).exit_code == 0


# --- which way is up --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("at_rest", "axis"), [("up", "+y"), ("down", "-y")])
def test_up_is_said_where_no_log_can_tell(tmp_path, at_rest, axis):
    configuration = by_rule()
    configuration["directions"][0]["at_rest"] = at_rest
    log, config = files(tmp_path, configuration)
    side = (
        "66 degrees below the horizontal, as north" if at_rest == "up" else "66 degrees above the horizontal, as south"
    )
    out = ("--out", tmp_path / "out", "--report", tmp_path / "report.html", "--force")
    for command in (
        ("bounds", log, config),
        ("check", log, config),
        ("estimate", log, "--config", config, *out),
    ):
        done = run(*command)
        assert f"the body's {axis} is up; the field points {side}" in words(done), done.output
    assert f"body&#x27;s {axis} is up" in (tmp_path / "report.html").read_text(encoding="utf-8")
    for command in (("bounds", log, config), ("check", log, config)):
        told = json.loads(run(*command, "--json").stdout)["up_at_rest"]
        np.testing.assert_allclose(told["up"], [0.0, 1.0 if at_rest == "up" else -1.0, 0.0], atol=0.01)


def test_up_in_words():
    assert axis_in_words(np.array([0.0, 0.0, -9.8])) == "-z"
    assert axis_in_words(np.array([9.8 * np.cos(0.2), 9.8 * np.sin(0.2), 0.0])) == "+x (11 degrees off)"
    assert axis_in_words(np.array([np.cos(0.02), np.sin(0.02), 0.0])) == "+x (1 degree off)"
    assert axis_in_words(np.array([1.0, -1.0, 0.0])) == "(0.71, -0.71, 0.00)"
    arrays = recording()
    still = up_at_rest(arrays["t"], arrays["gyr"], arrays["acc"], None)
    assert (still.begin_s, still.dip_deg) == (0.0, None)
    assert 3.0 < still.end_s < 4.1
    moving = arrays["t"] > 5.0
    assert up_at_rest(arrays["t"][moving], arrays["gyr"][moving], arrays["acc"][moving], None) is None


def test_a_rest_in_words_lasts():
    """Eight samples before a gap that hold still next to each other are no rest, nor are they with eight after it."""
    times = np.concatenate([0.01 * np.arange(8), 1.9 + 0.01 * np.arange(400)])
    rates = np.zeros((len(times), 3))
    forces = np.tile([9.8, 0.0, 0.0], (len(times), 1))
    forces[times > 1.0] = [0.0, 0.0, -9.8]
    found = up_at_rest(times, rates, forces, None)
    assert (found.begin_s, found.end_s) == (1.9, times[-1])
    assert "-z is up" in str(found)
    moving = times > 2.1
    rates[moving] += np.outer(np.sin(9.0 * times[moving]), [0.5, 0.0, 0.0])
    assert up_at_rest(times, rates, forces, None) is None
    assert up_at_rest(times[:1], rates[:1], forces[:1], None) is None


@pytest.mark.parametrize(
    ("rows", "said"),
    [(slice(None, None, 2), "samples are 0.02 s apart"), (slice(500, None), "the rule asks for 2 s")],
    ids=["too far apart", "no rest"],
)
def test_check_says_what_estimate_refuses(tmp_path, rows, said):
    """And `bounds`, of samples too far apart, that the rule's noise is not for them."""
    arrays = {name: array[rows] for name, array in recording().items()}
    log, config = files(tmp_path, by_rule(), arrays)
    checked, estimated = run("check", log, config), run("estimate", log, "--config", config, "--out", tmp_path / "out")
    assert (checked.exit_code, estimated.exit_code) == (1, 1)
    assert said in words(checked)
    assert said in words(estimated)
    assert "1 error, 0 warnings" in words(checked)
    proposed = words(run("bounds", log, "--like", "broad"))
    assert ("Fewer than 67 samples a second need statements of their own" in proposed) == ("apart" in said)


# --- statements -------------------------------------------------------------------------------------------------------


def suspicious(tmp_path, configuration, arrays=None):
    done = run("check", *files(tmp_path, configuration, arrays), "--json")
    assert done.exit_code == 0, done.output
    return [one["message"] for one in json.loads(done.stdout)["findings"] if "suspicious: " in one["message"]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"noise_deg_per_s": 1e-5, "earth_rate": "removed"},
            "noise_deg_per_s = 1e-05, 1.0e-05 of .*no small sensor is so good",
        ),
        ({"noise_deg_per_s": 1e9}, r"noise_deg_per_s = 1e\+09, 1e\+09 times"),
        ({"scale_error": 0.5}, "scale_error = 0.5, 25 times"),
        ({"bias_deg_per_s": 50.0}, "bias_deg_per_s = 50, 200 times"),
    ],
)
def test_suspicious_bounds_of_the_gyro(tmp_path, change, message):
    (one,) = suspicious(tmp_path, by_sensor(**change))
    assert re.search(message, one)
    assert suspicious(tmp_path, by_sensor()) == []
    assert suspicious(tmp_path, by_rule()) == []


def test_suspicious_bounds_of_vectors():
    configuration = by_sensor()
    configuration["directions"][0]["bound_from"]["velocity_m_per_s"] = 300.0
    configuration["directions"][1]["bound_from"]["disturbance_ut"] = 12.7
    up, field = suspicions.of_configuration(Configuration.model_validate(configuration))
    assert "no hand moves so fast" in str(up)
    assert "a magnet or steel near the sensor" in str(field)
    del configuration["directions"][1]["bound_from"]
    configuration["directions"][1] |= {"bound_deg": 80.0, "reference_error_deg": 15.0}
    (_, field) = suspicions.of_configuration(Configuration.model_validate(configuration))
    assert str(field) == "field: a bound of 80 degrees says next to nothing of where it points"


def test_a_suspicious_rule():
    rule = rules.hand_held().model_dump(mode="json", exclude_none=True)
    assert suspicions.of_configuration(Configuration.model_validate(by_rule(rule={"kind": "stated"} | rule))) == []
    rule["magnetometer"]["disturbance_ut"] = 12.7
    rule["gyro"]["noise_deg_per_s"] = 0.0
    gyro, field = suspicions.of_configuration(Configuration.model_validate(by_rule(rule={"kind": "stated"} | rule)))
    assert "noise_deg_per_s = 0, against that of the rule for a sensor in the hand, 1: no small sensor" in str(gyro)
    assert "a magnet or steel near the sensor" in str(field)


def test_a_recording_longer_than_the_rules_are_for(tmp_path):
    """Ten minutes. Who states a drift, or more that is left of the bias, has said what is so."""
    arrays = recording(62.0)
    arrays["t"], arrays["gyr"] = 10.0 * arrays["t"], 0.1 * arrays["gyr"]
    rule = rules.hand_held().model_dump(mode="json", exclude_none=True)
    rule["gyro"] |= {"longest_interval_s": 0.2, "noise_deg_per_s": 5.0}
    said = "the recording lasts 10.3 minutes, and the numbers of the rules are for up to ten"
    log, config = files(tmp_path, by_rule(rule={"kind": "stated"} | rule), arrays)
    for command in (
        ("check", log, config),
        ("estimate", log, "--config", config, "--out", tmp_path / "out"),
    ):
        done = run(*command)
        assert words(done).count(said) == 1, done.output
    for bias, lasted, count in ((0.25, 601.0, 1), (0.25, 599.0, 0), (0.3, 601.0, 0)):
        assert len(suspicions.of_duration({"bias_deg_per_s": bias}, lasted)) == count
    rule["gyro"]["drift_deg_per_s2"] = 1e-4
    assert said not in words(run("check", *files(tmp_path, by_rule(rule={"kind": "stated"} | rule), arrays)))


def test_an_attached_magnet_is_named_by_bounds(tmp_path):
    """It turns with the body, so the field's length changes with the pose."""
    arrays = recording()
    told = json.loads(run("bounds", *files(tmp_path, by_rule(), arrays), "--json", "--no-reference").stdout)
    assert told["suspicious"] == []
    arrays["mag"] = arrays["mag"] + [15.0, 0.0, 0.0]
    told = run("bounds", *files(tmp_path, by_rule(), arrays), "--no-reference")
    assert "suspicious: magnetometer: proposed is disturbance_ut" in words(told)
    assert "as with a magnet or steel near the sensor or attached to it" in words(told)


def test_why_there_is_no_set(tmp_path):
    log, config = files(tmp_path, by_sensor(noise_deg_per_s=1e9))
    done = run("estimate", log, "--config", config, "--out", tmp_path / "out")
    assert done.exit_code == 1, done.output
    assert (
        f"{log}: no row has a set: the bounds of 'up' allow any direction, at every row; an attitude needs two "
        "directions at the same time, and no row has two that say something; the gyro may be off by 1e+09 deg/s, so "
        "that over one step of 0.01 s"
    ) in words(done)
    assert "suspicious: the gyro: stated is noise_deg_per_s = 1e+09" in words(done)
    log, config = files(tmp_path, by_sensor())
    done = run("estimate", log, "--config", config, "--out", tmp_path / "good", "--json")
    assert json.loads(done.stdout)["why_no_set"] == []


def test_proposed_bounds_are_no_guarantee(tmp_path):
    """100 % unconditional never stands beside it."""
    log, config = files(tmp_path, by_rule())
    del (tables := by_rule())["rule"], tables["estimator"]
    config.write_text(tomlkit.dumps(tables | {"reference_frame": "ENU"}))
    proposed, page = tmp_path / "proposed.toml", tmp_path / "report.html"
    done = run("bounds", log, config, "--out", proposed)
    assert done.exit_code == 0, done.output
    assert 'bounds_from_recording = "log.npz"' in proposed.read_text()
    done = run("estimate", log, "--config", proposed, "--out", tmp_path / "out", "--report", page)
    assert done.exit_code == 0, done.output
    assert " % have a set that holds if the proposed bounds do" in words(done)
    assert "no guarantee" in words(done)
    assert "unconditional" not in words(done)
    # The table says it by itself, too.
    assert (tmp_path / "out" / "results.csv").read_text().startswith("# elliptude results 1; bounds_from_recording = ")
    text = page.read_text(encoding="utf-8")
    assert " % have a set that holds if the proposed bounds do" in text
    assert "no guarantee" in text
    assert ">unconditional" not in text
    # With a reason for each bound the line goes, and the guarantee is spoken of.
    proposed.write_text(
        "\n".join(line for line in proposed.read_text().split("\n") if not line.startswith("bounds_from"))
    )
    done = run("estimate", log, "--config", proposed, "--out", tmp_path / "out", "--force")
    assert "the guarantee is unconditional 9" in words(done)
    assert "no guarantee" not in words(done)


def test_a_rule_says_where_it_is_from(tmp_path):
    log, config = files(tmp_path, by_rule())
    rule = tmp_path / "rule.toml"
    assert run("bounds", log, config, "--rule", rule).exit_code == 0
    assert rules.read_rule(rule).bounds_from_recording == "log.npz"
    config.write_text(tomlkit.dumps(by_rule(rule={"kind": "file", "file": "rule.toml", "anchor_s": 4.0})))
    done = run("estimate", log, "--config", config, "--out", tmp_path / "out")
    assert "the bounds are proposals from log.npz, so that the sets are no guarantee" in words(done)


# --- conversion -------------------------------------------------------------------------------------------------------


def test_the_reference_of_a_rules_field_is_converted(tmp_path):
    """North and down, as the field is; not up, which stands there while nobody has looked at the rest."""
    log, config = files(tmp_path, by_rule())
    target = tmp_path / "measurements.csv"
    assert run("convert", log, target, "--config", config).exit_code == 0
    written = tables.Measurements.read(target)
    up, field = written.references[0]
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(field, FIELD / np.linalg.norm(FIELD), atol=0.01)
    assert np.ptp(written.references, axis=0).max() == 0.0
    # It is what the rule has for the estimator.
    arrays = recording()
    ruled = rules.apply_rule(rules.hand_held(), arrays["t"], arrays["gyr"], arrays["acc"], arrays["mag"], every=500)
    np.testing.assert_allclose(field, ruled.field_reference, atol=1e-12)
    # Without a rest nothing is known of it.
    late = {name: values[300:] for name, values in arrays.items()}
    done = run("convert", *files(tmp_path, by_rule(), late)[:1], tmp_path / "b.csv", "--config", config)
    assert done.exit_code == 1
    assert "the reference of the field is that of the rest at the start: the recording starts with a rest" in words(
        done
    )


# --- comparison -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def estimated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("estimated")
    log, config = files(folder, by_rule())
    done = run("estimate", log, "--config", config, "--out", folder / "out", "--json")
    assert done.exit_code == 0, done.output
    return folder, json.loads(done.stdout)


def reference(path: Path, rotations, times):
    quaternions = rotations.as_quat(canonical=True, scalar_first=True)
    column_files.write_columns(
        path, "measurements", {"time_s": times} | dict(zip(tables.QUATERNION, quaternions.T, strict=True))
    )
    return path


def test_one_mean_error(estimated):
    folder, said = estimated
    compared = json.loads(
        run("compare", folder / "out", folder / "log.npz", "--config", folder / "log.toml", "--json").stdout
    )
    assert compared["all"]["error_deg"]["mean"] == pytest.approx(said["attitude_error_deg"]["mean"], rel=1e-9)
    assert compared["all"]["error_deg"]["max"] == pytest.approx(said["attitude_error_deg"]["max"], rel=1e-9)
    assert compared["all"]["inside_share"] == said["inside_share_of_rows"] == 1.0
    assert compared["reference_misread"] is None


def test_one_mean_error_where_rows_have_no_update(tmp_path):
    """The first row, and those between measurements, count as they do in `compare`."""
    arrays = recording()
    for name in ("acc", "mag"):
        arrays[name][np.arange(len(arrays["t"])) % 5 > 0] = np.nan
    configuration = by_sensor()
    for sensor, bound in zip(configuration["directions"], (5.0, 8.0), strict=True):
        del sensor["bound_from"]
        sensor["bound_deg"] = bound
    configuration["truth"] = by_rule()["truth"]
    start = {"kind": "given", "attitude_qw_qx_qy_qz": [0.7, 0.7, 0.2, 0.0], "P_diagonal": [0.5] * 3 + [1e-6] * 3}
    first_order = {"mode": "first_order", "when_sets_do_not_meet": "skip"}
    log, config = files(tmp_path, configuration | {"start": start, "estimator": first_order}, arrays)
    done = run("estimate", log, "--config", config, "--out", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert said["updates"] < said["rows"]
    compared = json.loads(run("compare", tmp_path / "out", log, "--config", config, "--json").stdout)
    assert compared["all"]["error_deg"]["mean"] == pytest.approx(said["attitude_error_deg"]["mean"], rel=1e-6)
    assert compared["all"]["inside_share"] == pytest.approx(said["inside_share_of_rows"])


def test_a_heading_that_counts_from_the_first_row(tmp_path):
    """Without a magnetometer nothing tells it; `estimate` and `compare` count it from there."""
    configuration = by_rule()
    del configuration["directions"][1]
    log, config = files(tmp_path, configuration, recording(heading=139.0))
    done = run("estimate", log, "--config", config, "--out", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert said["heading"] == "from the first row"
    done = run("compare", tmp_path / "out", log, "--config", config, "--json")
    assert done.exit_code == 0, done.output
    compared = json.loads(done.stdout)
    assert compared["all"]["error_deg"]["mean"] == pytest.approx(said["attitude_error_deg"]["mean"], rel=1e-6)
    assert compared["all"]["inside_share"] == said["inside_share_of_rows"] == 1.0
    late = recording(heading=139.0)
    path = reference(tmp_path / "late.csv", Rotation.from_quat(late["q"][5:], scalar_first=True), late["t"][5:])
    done = run("compare", tmp_path / "out", path)
    assert done.exit_code == 1
    assert "the heading counts from the first row" in words(done)


def test_files_of_another_kind(estimated):
    """A folder of results in the place of its table, a log in the place of attitudes or of results."""
    folder, _ = estimated
    (folder / "log.csv").write_text("t,gx,gy,gz\n0,0,0,0\n")
    for command in (
        ("compare", folder / "out", folder / "out"),
        ("monitor", folder / "out", "--estimate", folder / "out"),
    ):
        assert "a folder, name the table in it: " in words(run(*command))
    for command in (
        ("compare", folder / "out", folder / "log.csv"),
        ("monitor", folder / "out", "--estimate", folder / "log.csv"),
    ):
        said = words(run(*command))
        assert (
            "no column 'time_s', so no table with time_s,qw,qx,qy,qz; the columns are t, gx, gy, gz. A config" in said
        )
        assert "--config of compare, --estimate-config of monitor" in said
    for command in (
        ("monitor", folder / "log.csv", "--estimate", folder / "out" / "results.csv"),
        ("report", folder / "log.csv", "--out", folder / "report.html"),
    ):
        assert "so no table of results, as `elliptude estimate` writes it" in words(run(*command))


@pytest.mark.parametrize(
    ("read", "hint"),
    [
        (lambda q: q.inv(), "turns = 'reference_to_body' (it takes vectors from reference to body axes)"),
        (
            lambda q: Rotation.from_quat(q.as_quat(), scalar_first=True),
            "order = 'xyzw' (qw is x, qx is y, qy is z, qz is w)",
        ),
        # Headers qx,qy,qz,qw above w, x, y, z.
        (
            lambda q: Rotation.from_quat(q.as_quat(scalar_first=True)),
            "attitude_columns = ['qx', 'qy', 'qz', 'qw'] (qw is z, qx is w, qy is x, qz is y)",
        ),
        (
            lambda q: Rotation.from_quat(q.inv().as_quat(scalar_first=True)),
            "attitude_columns = ['qx', 'qy', 'qz', 'qw'] (qw is z, qx is w, qy is x, qz is y), turns = "
            "'reference_to_body' (it takes vectors from reference to body axes)",
        ),
    ],
)
def test_a_misread_reference(estimated, read, hint):
    """As its inverse, scalar last, or under the wrong headers; in a table, and in another frame, where only turns tell.

    What is proposed is what mends it, and `monitor` says the same.
    """
    folder, _ = estimated
    arrays = recording()
    true = Rotation.from_quat(arrays["q"], scalar_first=True)
    for frame in (Rotation.identity(), Rotation.from_euler("z", 100, degrees=True)):
        path = reference(folder / "misread.csv", read(frame * true), arrays["t"])
        done = run("compare", folder / "out", path)
        assert done.exit_code == 1
        assert f"as far when read as {hint}: its quaternions are not as declared" in words(done)
        assert hint in json.loads(run("compare", folder / "out", path, "--json").stdout.strip())["reference_misread"]
        judged = run("monitor", folder / "out", "--estimate", path, "--heading-free")
        assert judged.exit_code == 1
        assert f"when read as {hint}: its quaternions are not as declared; [truth] of a configuration" in words(judged)
    said = tomllib.loads(re.sub(r" \([^)]*\)", "", hint).replace(", turns", "\nturns"))
    columns = {"attitude_columns": ["qw", "qx", "qy", "qz"]}
    truth = by_rule() | {"time_column": "time_s", "truth": columns | said}
    (folder / "said.toml").write_text(tomlkit.dumps(truth))
    path = reference(folder / "misread.csv", read(true), arrays["t"])
    done = run("compare", folder / "out", path, "--config", folder / "said.toml")
    assert done.exit_code == 0, done.output


def test_a_misread_reference_of_few_rows(estimated):
    """Too few turns to tell; but it is far off, and near when read as its inverse."""
    folder, _ = estimated
    arrays = recording()
    rows = np.arange(300, 1500, 120)
    true = Rotation.from_quat(arrays["q"][rows], scalar_first=True)
    path = reference(folder / "few.csv", true.inv(), arrays["t"][rows])
    done = run("compare", folder / "out", path)
    assert done.exit_code == 1
    assert "off from the estimate (median), and" in words(done)
    assert "when read as turns = 'reference_to_body'" in words(done)
    path = reference(folder / "few.csv", true, arrays["t"][rows])
    assert run("compare", folder / "out", path).exit_code == 0


def test_attitudes_that_turn_otherwise_are_not_misread():
    """A random walk fits no reading; and what does not turn tells nothing."""
    some = Rotation.random(200, rng=np.random.default_rng(0))
    turns = 0.1 * np.random.default_rng(1).standard_normal((100, 3))
    choices = readings("wxyz", "body_to_reference", ["a", "b", "c", "d"])
    found = misread(some[:100], some[100:], turns, choices)
    assert found is None or found.fitting is None
    assert misread(some[:100], some[:100], 0.0 * turns, choices) is None
    assert misread(some[:100], some[:100] * Rotation.from_rotvec(turns), turns, choices) is None
    inverse = misread(some[:100].inv(), (some[:100] * Rotation.from_rotvec(turns)).inv(), turns, choices)
    assert inverse.fitting == "as turns = 'reference_to_body' (it takes vectors from reference to body axes)"


# --- an accelerometer in another unit ---------------------------------------------------------------------------------


def test_an_accelerometer_in_another_unit_is_named_before_the_field_that_it_voids(tmp_path):
    """Its header says g, and it shows m/s²: also once the unit is mended, but not what was proposed with it."""
    sensors = recording()
    header = ["Time (s)", *(f"Gyroscope {axis} (rad/s)" for axis in "XYZ")]
    header += [*(f"Accelerometer {axis} (g)" for axis in "XYZ"), *(f"Magnetometer {axis} (uT)" for axis in "XYZ")]
    log, config, out = tmp_path / "log.csv", tmp_path / "log.toml", tmp_path / "out"
    rows = np.column_stack([sensors[name] for name in ("t", "gyr", "acc", "mag")])
    np.savetxt(log, rows, delimiter=",", header=",".join(header), comments="")
    assert run("bounds", log, "--out", config).exit_code == 0
    done = run("estimate", log, "--config", config, "--out", out)
    assert done.exit_code == 1
    named = "'up' shows 96.2 m/s^2, 9.81 times gravity: is its unit right?"
    assert words(done).index(named) < words(done).index("the magnetometer")
    assert "run `elliptude bounds` again" in words(done)
    config.write_text(config.read_text().replace('unit = "g"', 'unit = "m/s^2"'))
    done = run("estimate", log, "--config", config, "--out", out)
    assert done.exit_code == 1
    said = words(done)
    assert "times gravity" not in said
    assert said.index("is more than gravity, so that up may be anywhere") < said.index("the magnetometer")
    assert "run `elliptude bounds` again" in said
    checked = words(run("check", log, config))
    assert "averaged_error_m_per_s2 = 104" in checked
    assert checked.count("run `elliptude bounds` again") == 3
    # And that helps.
    assert run("bounds", log, "--out", config, "--force", *NAMED).exit_code == 0
    assert run("estimate", log, "--config", config, "--out", out).exit_code == 0


NAMED = [
    *("--time", "Time (s)", "--gyro", "Gyroscope X (rad/s),Gyroscope Y (rad/s),Gyroscope Z (rad/s)"),
    *("--accelerometer", "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)"),
    *("--magnetometer", "Magnetometer X (uT),Magnetometer Y (uT),Magnetometer Z (uT)"),
    *("--gyro-unit", "rad/s", "--accelerometer-unit", "m/s^2", "--magnetometer-unit", "uT"),
]
