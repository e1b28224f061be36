"""`elliptude check`, as typed: what it lists, and that it sees units, orders and signs that were stated wrongly."""

import dataclasses
import json
import re
import textwrap
from pathlib import Path

import datasets
import numpy as np
import pytest
import tomlkit
from elliptude import cli
from elliptude.configuration import Configuration, read_configuration
from elliptude.estimation.check import check
from elliptude.io.files import FileError
from elliptude.logs import plausibility, read_log
from elliptude.logs.log import Log
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

G = 9.80665


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def recording(count=2000, step=0.01, speed=1.0, seed=0):
    """A body that turns by known rates, with an accelerometer and a magnetometer that are a little off."""
    rng = np.random.default_rng(seed)
    times = step * np.arange(count)
    rates = speed * np.column_stack([np.sin(1.3 * times), np.cos(0.7 * times), np.sin(0.4 * times + 1.0)])
    turns = Rotation.from_rotvec(0.5 * step * (rates[1:] + rates[:-1]))
    attitudes = [Rotation.from_rotvec([0.1, 0.2, 0.3])]
    for turn in turns:
        attitudes.append(attitudes[-1] * turn)
    attitudes = Rotation.concatenate(attitudes)
    up = attitudes.inv().apply([0.0, 0.0, G]) + 0.1 * rng.standard_normal((count, 3))
    field = attitudes.inv().apply([0.0, 20.0, -40.0]) + 0.5 * rng.standard_normal((count, 3))
    return {"t": times, "gyr": rates, "acc": up, "mag": field, "q": attitudes.as_quat(scalar_first=True)}


def tables(**changes):
    return {
        "time_column": "t",
        "reference_frame": "ENU",
        "flow": {
            "kind": "gyro",
            "columns": ["gyr[0]", "gyr[1]", "gyr[2]"],
            "unit": "rad/s",
            "noise_deg_per_s": 1.0,
        },
        "directions": [
            {
                "name": "up",
                "kind": "accelerometer",
                "columns": ["acc[0]", "acc[1]", "acc[2]"],
                "unit": "m/s^2",
                "bound_deg": 5.0,
            },
            {
                "name": "field",
                "kind": "magnetometer",
                "columns": ["mag[0]", "mag[1]", "mag[2]"],
                "unit": "uT",
                "reference_ut": [0.0, 20.0, -40.0],
                "bound_deg": 8.0,
            },
        ],
        "start": {"kind": "first_measurement", "bias_bound_deg_per_s": 0.1},
        "truth": {"attitude_columns": ["q[0]", "q[1]", "q[2]", "q[3]"], "label": "cameras"},
    } | changes


def files(tmp_path, arrays=None, configuration=None):
    np.savez(tmp_path / "log.npz", **(recording() if arrays is None else arrays))
    (tmp_path / "log.toml").write_text(tomlkit.dumps(tables() if configuration is None else configuration))
    return tmp_path / "log.npz", tmp_path / "log.toml"


def found(tmp_path, arrays=None, configuration=None):
    done = run("check", *files(tmp_path, arrays, configuration), "--json")
    report = json.loads(done.stdout)
    assert report["good"] == (done.exit_code == 0)
    return report, [f"{one['severity']}: {one['sensor']}: {one['message']}" for one in report["findings"]]


def rows_of(log, begin, end):
    """A piece of a log."""
    arrays = {name: value[begin:end] for name, value in vars(log).items() if isinstance(value, np.ndarray)}
    return dataclasses.replace(log, **arrays)


def test_a_log_without_faults(tmp_path):
    report, messages = found(tmp_path)
    assert messages == []
    gyro, up, field, attitude = report["sensors"]
    assert (gyro["name"], up["name"], field["name"], attitude["name"]) == ("the gyro", "up", "field", "true attitude")
    assert (up["unit"], up["rows"], up["measured"], up["empty"], up["gaps"]) == ("m/s^2", 2000, 2000, 0, 0)
    assert up["rate_hz"] == pytest.approx(100.0)
    assert (up["begin_s"], up["end_s"]) == pytest.approx((0.0, 19.99))
    np.testing.assert_allclose(up["highest"], recording()["acc"].max(axis=0), rtol=1e-12)
    assert field["median_norm"] == pytest.approx(np.hypot(20.0, 40.0), rel=0.01)
    text = run("check", tmp_path / "log.npz", tmp_path / "log.toml")
    assert text.exit_code == 0
    assert "0 errors, 0 warnings" in text.output
    assert "the gyro" in text.output


def test_gaps_and_empty_rows(tmp_path):
    arrays = recording()
    arrays["t"] = arrays["t"] + np.where(np.arange(2000) >= 1000, 3.0, 0.0)
    arrays["mag"][100:150] = np.nan
    report, messages = found(tmp_path, arrays)
    assert report["sensors"][2]["empty"] == 50
    assert report["sensors"][2]["gaps"] == 2
    assert report["sensors"][0]["longest_step_s"] == pytest.approx(3.01)
    assert report["sensors"][0]["longest_step_at_s"] == pytest.approx(9.99)
    assert "warning: the gyro: a gap of 3.01 s after 9.990000 s" in messages


@pytest.mark.parametrize("noise", [1e-6, 1e-3, 0.05])
@pytest.mark.parametrize("scatter", [0.0, 5.0 / 3600.0])
def test_an_attitude_that_is_held(noise, scatter):
    """All of what the gyro shows is noise, as is stated, and the star trackers are right not to turn."""
    rng = np.random.default_rng(0)
    times = 0.1 * np.arange(600)
    stars = np.tile(np.eye(3)[:2], (600, 1, 1)) + np.radians(scatter) * rng.uniform(-0.5, 0.5, (600, 2, 3))
    log = Log(times, stars, np.tile(np.eye(3)[:2], (600, 1, 1)), np.radians(noise) * rng.uniform(-0.5, 0.5, (600, 3)))
    references = {"a": [1.0, 0.0, 0.0], "b": [0.0, 1.0, 0.0]}
    configuration = Configuration.model_validate(
        {
            "time_column": "t",
            "flow": {"kind": "gyro", "columns": ["p", "q", "r"], "noise_deg_per_s": 0.1},
            "directions": [
                {"name": name, "columns": ["x", "y", "z"], "reference": one, "bound_deg": 0.01}
                for name, one in references.items()
            ],
            "estimator": {"mode": "guaranteed"},
        }
    )
    assert plausibility.contradictions(log, configuration) == []


@pytest.mark.parametrize(
    ("array", "factor", "message"),
    [
        ("acc", 1.0 / G, "warning: up: its median norm is 1 m/s.2, which is not gravity .*; it would be in g"),
        ("acc", 1000.0 / G, "warning: up: its median norm is 1000 m/s.2, which is not gravity .*; it would be in mg"),
        ("mag", 1000.0, r"warning: field: its median norm is 4.47\de\+04 uT, .* it would be in nT"),
        ("mag", 0.01, r"warning: field: its median norm is 0.447. uT, .* it would be in G"),
        (
            "gyr",
            180.0 / np.pi,
            "error: up: turns 0.017.* times as far as the rate says, as if its degrees were declared",
        ),
        (
            "gyr",
            np.pi / 180.0,
            "error: field: turns 5.* times as far as the rate says, as if its radians were declared",
        ),
        ("gyr", -1.0, r'error: the gyro: its axes .* With columns = \["gyr\[0\]", .* axes = \["-x", "-z", "-y"\] '),
        ("t", 1000.0, "error: up: .* as if the unit of time .* were 1000 times smaller"),
        ("t", 1e-3, "error: up: .* as if the unit of time .* were 1000 times larger"),
        # In steps of 10,000 s a noise of 1 deg/s turns anything anywhere, so that nothing is sure.
        ("t", 1e6, "warning: up: .* as if the unit of time .* were a million times smaller"),
        ("t", 1e9, r"error: .*row 1002, column .t.: the time 1.001e.10 s: is its unit right. The steps are 1e.07 s"),
        ("q", 1.1, "warning: true attitude: quaternions are not of length 1"),
    ],
)
def test_units_that_do_not_fit(tmp_path, array, factor, message):
    arrays = recording()
    arrays[array] = factor * arrays[array]
    _, messages = found(tmp_path, arrays)
    assert any(re.match(message, one) for one in messages), messages


def test_declared_g_but_shown_in_si(tmp_path):
    configuration = tables()
    configuration["directions"][0]["unit"] = "g"
    _, messages = found(tmp_path, configuration=configuration)
    assert len(messages) == 1
    assert messages[0].endswith('g, which is not gravity (0.5 to 2 g); it would be in m/s^2: write unit = "m/s^2"')


@pytest.mark.parametrize(
    ("truth", "hint"),
    [
        ({"order": "xyzw"}, "as order = 'wxyz'"),
        ({"turns": "reference_to_body"}, "as turns = 'body_to_reference'"),
        ({"order": "xyzw", "turns": "reference_to_body"}, "as order = 'wxyz', turns = 'body_to_reference'"),
    ],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_reference_read_wrongly(tmp_path, truth, hint, seed):
    configuration = tables(truth=tables()["truth"] | truth)
    report, messages = found(tmp_path, recording(seed=seed), configuration)
    assert not report["good"]
    assert len(messages) == 1
    assert messages[0].startswith("error: cameras: turns ")
    words = " (q[0] is w, q[1] is x, q[2] is y, q[3] is z)", " (it takes vectors from body to reference axes)"
    for said in words:
        assert messages[0].count(said) == hint.count("order" if "q[0]" in said else "turns")
        messages[0] = messages[0].replace(said, "")
    assert messages[0].endswith(f"and as far when read {hint}")
    # `estimate` refuses it too, unless it is told to go on.
    log = tmp_path / "log.npz"
    done = run("estimate", log, "--config", tmp_path / "log.toml", "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "implausible = 'ignore'" in done.output.replace("\n", " ")
    assert not (tmp_path / "out").exists()
    _, ignoring = files(tmp_path, recording(seed=seed), configuration | {"implausible": "ignore"})
    ignored = read_configuration(ignoring)
    heard = plausibility.Heard()
    assert len(list(plausibility.plausible_pieces([read_log(log, ignored)], ignored, "log", heard))) == 1
    assert [str(one).startswith("cameras: turns ") for one in heard.ignored] == [True]


def test_a_reference_without_a_rate_is_compared_with_directions(tmp_path):
    flow = {"kind": "rigid_body", "inertia_kg_m2": [1.0, 1.0, 1.0], "step_s": 0.01}
    start = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1.0] * 6}
    assert found(tmp_path, configuration=tables(flow=flow, start=start))[1] == []
    swapped = tables(flow=flow, start=start, truth=tables()["truth"] | {"order": "xyzw"})
    _, messages = found(tmp_path, configuration=swapped)
    assert len(messages) == 1
    assert messages[0].startswith("error: cameras: takes the measured directions ")
    assert messages[0].endswith("when read as order = 'wxyz' (q[0] is w, q[1] is x, q[2] is y, q[3] is z)")


@pytest.mark.parametrize("speed", [0.0, 1e-4])
def test_nothing_is_concluded_from_a_log_that_does_not_turn(tmp_path, speed):
    arrays, configuration = recording(speed=speed), tables()
    del configuration["truth"]  # which is exact here
    for factor in (1.0, 180.0 / np.pi):
        assert found(tmp_path, arrays | {"gyr": factor * arrays["gyr"]}, configuration)[1] == []


@pytest.mark.parametrize(("bias", "noise"), [(1.0, 0.0), (4.5, 0.0), (4.5, 1.0)])
def test_a_bias_at_rest_is_no_turn(tmp_path, bias, noise):
    """A gyro on a table shows its bias, and 20 s of it add up to a right angle that no direction makes."""
    arrays, configuration = recording(speed=0.0), tables()
    del configuration["truth"]
    rng = np.random.default_rng(3)
    shown = np.deg2rad(bias) / np.sqrt(3.0) + np.deg2rad(0.05 * noise) * rng.standard_normal((2000, 3))
    at_rest = {"acc": [0.0, 0.0, G] + 0.01 * noise * rng.standard_normal((2000, 3)), "gyr": shown}
    at_rest["mag"] = [0.0, 20.0, -40.0] + 0.05 * noise * rng.standard_normal((2000, 3))
    assert found(tmp_path, arrays | at_rest, configuration)[1] == []
    in_degrees = at_rest | {"gyr": np.full((2000, 3), bias)}
    messages = found(tmp_path, arrays | in_degrees, configuration)[1]
    assert any("does not turn" in message or "more than most gyros" in message for message in messages)


@pytest.mark.parametrize(("factor", "said"), [(1.0, None), (180.0 / np.pi, "degrees"), (np.pi / 180.0, "radians")])
def test_a_wrong_unit_is_told_of_a_slow_turn_too(tmp_path, factor, said):
    """At 9 degrees/s all of the turn might be a bias, but a bias does not change as the turn does."""
    arrays, configuration = recording(speed=0.15), tables()
    del configuration["truth"]
    attitudes = Rotation.from_quat(arrays["q"], scalar_first=True)
    for name, vector in (("acc", [0.0, 0.0, G]), ("mag", [0.0, 20.0, -40.0])):
        exact = attitudes.inv().apply(vector)
        arrays[name] = exact + 0.2 * (arrays[name] - exact)
    arrays["gyr"] = factor * arrays["gyr"]
    messages = [one for one in found(tmp_path, arrays, configuration)[1] if one.startswith("error")]
    assert [f"as if its {said} were declared" in one for one in messages] == ([] if said is None else [True, True])


@pytest.mark.parametrize("factor", [180.0 / np.pi, np.pi / 180.0])
def test_a_wrong_unit_of_the_gyro_explains_what_does_not_turn_as_it_says(tmp_path, factor):
    """An accelerometer that is shaken turns less than the body, which against a wrong rate looks like wrong axes."""
    arrays, configuration = recording(), tables()
    del configuration["truth"]
    attitudes = Rotation.from_quat(arrays["q"], scalar_first=True)
    half = Rotation.from_rotvec(0.4 * (attitudes[0].inv() * attitudes).as_rotvec())
    arrays["acc"] = (attitudes[0] * half).inv().apply([0.0, 0.0, G])
    arrays["gyr"] = factor * arrays["gyr"]
    _, messages = found(tmp_path, arrays, configuration)
    assert [message for message in messages if "declared" in message], messages
    assert not [message for message in messages if "axes" in message], messages


@pytest.mark.parametrize(("shown", "said"), [(0.0, "0"), (0.02, "the same")])
def test_a_gyro_that_is_off(tmp_path, shown, said):
    arrays = recording()
    _, messages = found(tmp_path, arrays | {"gyr": np.full((2000, 3), shown)})
    off = f"error: the gyro: {said} in all of 2000 rows, though 'up' turns by up to "
    assert any(message.startswith(off) for message in messages), messages
    done = run("estimate", tmp_path / "log.npz", "--config", tmp_path / "log.toml", "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "is it off?" in done.output


def test_a_bias_in_motion_hides_no_wrong_unit(tmp_path):
    arrays, configuration = recording(), tables()
    del configuration["truth"]
    arrays["gyr"] = arrays["gyr"] + np.deg2rad([3.0, -2.0, 1.0])
    assert found(tmp_path, arrays, configuration)[1] == []
    _, messages = found(tmp_path, arrays | {"gyr": np.rad2deg(arrays["gyr"])}, configuration)
    assert any("as if its degrees were declared as radians" in message for message in messages), messages


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "nT"), (10.0, "mG"), (0.01, None)])
def test_a_field_too_strong_for_what_is_stated_in_microtesla(tmp_path, factor, unit):
    """5 uT of a field that is read 1000 times too strong are nothing, and its direction would be known too well."""
    arrays, configuration = recording(), tables()
    field = configuration["directions"][1]
    del field["bound_deg"]
    field["bound_from"] = {"kind": "field", "disturbance_ut": 5.0}
    field["reference_ut"] = [0.0, 20.0 * factor, -40.0 * factor]
    report, messages = found(tmp_path, arrays | {"mag": factor * arrays["mag"]}, configuration)
    assert report["good"] == (unit is None)
    if unit is not None:
        assert sum("its median norm is" in message for message in messages) == 1
        assert any(
            re.search(f"error: field: .* would be in {unit}: .*; its errors in µT as they count", one)
            for one in messages
        )
        done = run("estimate", tmp_path / "log.npz", "--config", tmp_path / "log.toml", "--out", tmp_path / "out")
        assert done.exit_code == 1
        assert f"it would be in {unit}" in done.output


def test_an_accelerometer_that_does_not_show_gravity_is_no_error(tmp_path):
    """It accelerates all the time; the field confirms the rate."""
    arrays = recording()
    arrays["acc"] = arrays["acc"] + 20.0 * np.random.default_rng(5).standard_normal((2000, 3))
    assert found(tmp_path, arrays)[0]["good"]


@pytest.mark.parametrize(("array", "name"), [("gyr", "the gyro"), ("acc", "up"), ("mag", "field")])
def test_a_sensor_that_stops_or_gets_stuck(tmp_path, array, name):
    """It is named, with the row and the time; a rest at first, or a sensor slower than its stamps, is neither."""
    arrays = recording()
    arrays[array][1200:] = arrays[array][1200]
    _, messages = found(tmp_path, arrays)
    said = f"warning: {name}: shows the same from row 1201 (12.000000 s) on, to its end (800 samples): is it stuck?"
    assert said in messages
    # `estimate` says so too, and it is the same in pieces of any length.
    log, configuration = tmp_path / "log.npz", read_configuration(tmp_path / "log.toml")
    whole = read_log(log, configuration)
    for lengths in ((2000,), (700, 700, 600), (1200, 800), (1199, 2, 799), (1,) * 2000):
        heard, stops = plausibility.Heard(), np.cumsum(lengths)
        ends = zip(stops - lengths, stops, strict=True)
        pieces = [rows_of(whole, begin, end) for begin, end in ends]
        list(plausibility.plausible_pieces(pieces, configuration, "log", heard))
        assert said.removeprefix("warning: ") in map(str, heard.suspicious)
    arrays = recording()
    arrays[array][1200:1500] = arrays[array][1200]
    _, messages = found(tmp_path, arrays)
    assert (
        f"warning: {name}: shows the same from row 1201 (12.000000 s) on, for 2.99 s (300 samples): is it stuck?"
        in messages
    )
    arrays = recording()
    if array != "gyr":  # of which every row is needed
        arrays[array][1200:] = np.nan
        _, messages = found(tmp_path, arrays)
        assert f"warning: {name}: stops after row 1200 (11.990000 s); others go on for 8 s" in messages
    arrays = recording()
    arrays[array][:500] = arrays[array][0]
    slow = recording()
    slow[array] = slow[array][np.arange(2000) // 40 * 40]
    for one in (arrays, slow, recording()):
        _, messages = found(tmp_path, one)
        assert not [message for message in messages if "stuck" in message or "stops" in message]


def test_each_fault_is_listed(tmp_path):
    arrays = recording()
    arrays["acc"][7] = 0.0
    arrays["mag"][5] = np.inf
    report, messages = found(tmp_path, arrays)
    assert [sensor["name"] for sensor in report["sensors"]] == ["the gyro", "true attitude"]
    assert len(messages) == 2
    assert "row 8, column 'acc[0]': 'up' has no direction" in messages[0]
    assert "row 6, column 'mag[0]': not a finite number" in messages[1]
    text = run("check", tmp_path / "log.npz", tmp_path / "log.toml")
    assert text.exit_code == 1
    assert "2 errors" in text.output


def test_a_start_from_a_later_row_or_from_none(tmp_path):
    arrays = recording()
    arrays["mag"][:3] = np.nan
    report, messages = found(tmp_path, arrays)
    assert report["good"]
    assert messages == ["warning: start: 3 rows are left out: the first with two directions is row 4 (0.030000 s)"]
    configuration = tables()
    configuration["directions"][1]["delay_s"] = 0.005
    report, messages = found(tmp_path, configuration=configuration)
    assert not report["good"]
    assert messages == ["error: start: no row has two directions: there is no measurement to start from"]


def test_the_example_of_the_guide(tmp_path):
    """It is a configuration, and fits the recording whose columns it names."""
    guide = (Path(__file__).parents[3] / "docs" / "logs.md").read_text(encoding="utf-8")
    section = guide.split("## An example")[1].split("\n## ")[0]
    (tmp_path / "log.toml").write_text(textwrap.dedent(section))
    configuration = read_configuration(tmp_path / "log.toml")
    assert configuration.accelerometer.unit == "g"
    if datasets.FOLDER is not None:
        assert check(datasets.xio(), configuration).findings == []


def test_a_configuration_at_fault(tmp_path):
    log, configuration = files(tmp_path, configuration=tables(time_unit="minutes"))
    done = run("check", log, configuration)
    assert done.exit_code == 1
    assert "time_unit" in done.output
    assert "'minutes'" in done.output


# --- recordings -------------------------------------------------------------------------------------------------------


def broad_tables(**changes):
    columns = {"gyr": "gyr", "acc": "acc", "mag": "mag"}
    configuration = tables(timing={"not_a_number": "missing"}, **changes)
    configuration["flow"]["columns"] = [f"{columns['gyr']}[{i}]" for i in range(3)]
    configuration["flow"]["delay_s"] = 0.0035
    configuration["truth"] = {"attitude_columns": [f"q_ref[{i}]" for i in range(4)]} | changes.get("truth", {})
    return configuration


@datasets.needs_datasets
@pytest.mark.parametrize("trial", ["02", "05", "07", "24", "30"])
def test_broad(tmp_path, trial):
    (tmp_path / "log.toml").write_text(tomlkit.dumps(broad_tables()))
    report = check(datasets.broad(trial), read_configuration(tmp_path / "log.toml"))
    assert report.is_good, report.findings
    assert report.sensors[0].rate_hz == pytest.approx(285.714, rel=1e-4)
    for truth, hint in (({"order": "xyzw"}, "as order = 'wxyz'"), ({"turns": "reference_to_body"}, "as turns = 'bo")):
        (tmp_path / "log.toml").write_text(tomlkit.dumps(broad_tables(truth=truth)))
        (error,) = [
            finding
            for finding in check(datasets.broad(trial), read_configuration(tmp_path / "log.toml")).findings
            if finding.severity == "error"
        ]
        assert hint in error.message
    wrong = broad_tables()
    wrong["flow"]["unit"] = "deg/s"
    (tmp_path / "log.toml").write_text(tomlkit.dumps(wrong))
    configuration = read_configuration(tmp_path / "log.toml")
    for truth in (configuration.truth, None):
        read = configuration.model_copy(update={"truth": truth})
        with pytest.raises(FileError, match="as if its radians were declared as degrees"):
            next(plausibility.plausible_pieces([read_log(datasets.broad(trial), read)], read, "log"))


@datasets.needs_datasets
def test_a_users_csv(tmp_path):
    def triple(name, unit):
        return [f"{name} {axis} ({unit})" for axis in "XYZ"]

    configuration = tables(time_column="Time (s)")
    del configuration["truth"]
    configuration["flow"] |= {"columns": triple("Gyroscope", "deg/s"), "unit": "deg/s"}
    configuration["directions"][0] |= {"columns": triple("Accelerometer", "g"), "unit": "g"}
    configuration["directions"][1] |= {"columns": triple("Magnetometer", "uT")}
    (tmp_path / "log.toml").write_text(tomlkit.dumps(configuration))
    done = run("check", datasets.xio(), tmp_path / "log.toml", "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["findings"] == []
    assert report["sensors"][0]["measured"] == 13514
    assert report["sensors"][0]["longest_step_s"] == pytest.approx(0.0302, abs=1e-4)
    configuration["flow"]["unit"] = "rad/s"
    (tmp_path / "log.toml").write_text(tomlkit.dumps(configuration))
    done = run("estimate", datasets.xio(), "--config", tmp_path / "log.toml", "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "as if its degrees were declared as radians" in done.output.replace("\n", " ")


@datasets.needs_datasets
def test_fermi_with_its_scalar_last(tmp_path):
    configuration = tables(time_column="met_s")
    del configuration["reference_frame"], configuration["directions"]
    configuration["flow"] |= {"columns": ["wx", "wy", "wz"], "noise_deg_per_s": 0.01}
    configuration["start"] = {
        "kind": "given",
        "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0],
        "P_diagonal": [9.0] * 3 + [1e-9] * 3,
    }
    truth = {"attitude_columns": ["qx", "qy", "qz", "qw"], "order": "xyzw"}
    for order in ("xyzw", "wxyz"):
        configuration["truth"] = truth | {"order": order}
        (tmp_path / "log.toml").write_text(tomlkit.dumps(configuration))
        report = check(datasets.fermi(), read_configuration(tmp_path / "log.toml"))
        assert report.is_good == (order == "xyzw"), report.findings
    assert "as order = 'xyzw'" in report.findings[0].message
