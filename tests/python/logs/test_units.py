"""Logs and statements in another unit than is stated: every command names the key and the unit that would be right."""

import functools
import re
from importlib import resources

import elliptude as el
import numpy as np
import pytest
import tomlkit
from elliptude import cli
from elliptude.configuration.configuration import read_configuration
from elliptude.logs.agreement.sizes import odd_step
from test_proposals import STEP, made
from typer.testing import CliRunner

GRAVITY = 9.80665
ROWS = round(9.0 / STEP)  # of which 5 s are a rest
AXES = {"gyr": ["gx", "gy", "gz"], "acc": ["ax", "ay", "az"], "mag": ["mx", "my", "mz"]}
STATED = {"t": "s", "gyr": "rad/s", "acc": "m/s^2", "mag": "uT"}
OPTIONS = {"t": "time", "gyr": "gyro", "acc": "accelerometer", "mag": "magnetometer"}


@functools.cache
def app():
    return cli.make_app()


def run(*arguments):
    done = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, " ".join(done.output.split())


def arrays(factors=None, *, still=False):
    """What sensors in a hand show, each multiplied; or the first second again and again."""
    recording = made()
    rows = np.arange(ROWS) % 200 if still else np.arange(ROWS)
    found = {
        "t": recording.times[:ROWS],
        "gyr": recording.angular_velocities[rows],
        "acc": recording.specific_forces[rows],
        "mag": recording.fields[rows],
    }
    return {name: values * (factors or {}).get(name, 1.0) for name, values in found.items()}


def written(folder, shown):
    log = folder / "log.csv"
    header = ",".join(["t", *(axis for axes in AXES.values() for axis in axes)])
    np.savetxt(log, np.column_stack(list(shown.values())), delimiter=",", header=header, comments="", fmt="%.9g")
    return log


def named(units=()):
    """The options of `bounds` that name columns and units."""
    units = STATED | dict(units)
    said = ["--time", "t", "--time-unit", units["t"]]
    for sensor, axes in AXES.items():
        said += [f"--{OPTIONS[sensor]}", ",".join(axes), f"--{OPTIONS[sensor]}-unit", units[sensor]]
    return said


def stated(folder, bounds="rule", units=(), reference=(0.0, 18.0, -42.0), **accelerometer):
    """A configuration: by the rule for a hand, sensor by sensor, by angles alone, and with the mode of first order."""
    units = STATED | dict(units)
    up = {"name": "up", "kind": "accelerometer", "columns": AXES["acc"], "unit": units["acc"]} | accelerometer
    field = {"name": "field", "kind": "magnetometer", "columns": AXES["mag"], "unit": units["mag"]}
    flow = {"kind": "gyro", "columns": AXES["gyr"], "unit": units["gyr"], "noise_deg_per_s": 1.0}
    tables = {
        "time_column": "t",
        "time_unit": units["t"],
        "reference_frame": "ENU",
        "flow": flow,
        "directions": [up, field],
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
    }
    if bounds == "rule":
        del flow["noise_deg_per_s"]
        tables["rule"] = {"kind": "hand_held"}
    else:
        field["reference_ut"] = list(reference)
    if bounds == "sensor":
        flow |= {"bias_deg_per_s": 1.0, "scale_error": 0.02}
        up |= {"bound_from": {"kind": "acceleration", "acceleration_m_per_s2": 2.0}}
        up |= {"sensor_error": {"error_m_per_s2": 0.6}}
        field |= {"bound_from": {"kind": "field", "disturbance_ut": 5.0}, "sensor_error": {"error_ut": 4.0}}
    if bounds in {"angle", "first"}:
        up |= {"bound_deg": 12.0}
        field |= {"bound_deg": 8.0}
    if bounds == "angle":
        flow |= {"bias_deg_per_s": 1.0}
    if bounds == "first":
        tables["estimator"] = {"mode": "first_order"}
        tables["start"] = {"kind": "first_measurement", "bias_bound_deg_per_s": 1.0}
    config = folder / f"{bounds}.toml"
    config.write_text(tomlkit.dumps(tables))
    return config


# What is multiplied, in which units the result is declared, and what must be said.
ODD = {
    "g as m/s^2": ({"acc": 1 / GRAVITY}, {}, r'up: its median norm is 1 m/s\^2, .* in g: write unit = "g"'),
    "mg as m/s^2": ({"acc": 1e3 / GRAVITY}, {}, r'up: its median norm is 1000 m/s\^2, .* in mg: write unit = "mg"'),
    "m/s^2 as g": ({}, {"acc": "g"}, r'up: its median norm is 9\.8\d* g, .* in m/s\^2: write unit = "m/s\^2"'),
    "mm/s^2 as m/s^2": ({"acc": 1e3}, {}, r"in mm/s\^2, and only m/s\^2, g, mg can be stated: convert it"),
    "uT as T": ({}, {"mag": "T"}, r'field: its median norm is 45\.7\d* T, .* in uT: write unit = "uT"'),
    "uT as nT": ({}, {"mag": "nT"}, r'field: its median norm is 45\.7\d* nT, .* in uT: write unit = "uT"'),
    "T as uT": ({"mag": 1e-6}, {}, r'field: its median norm is 4\.57\d*e-05 uT, .* in T: write unit = "T"'),
    "G as uT": ({"mag": 1e-2}, {}, r'field: its median norm is 0\.457\d* uT, .* in G: write unit = "G"'),
    "normalized as uT": ({"mag": 1 / 45.7}, {}, 'about 1: write unit = "normalized", and in unit_ut how many µT 1 is'),
    "ms as s": ({"t": 1e3}, {}, 'the gyro: its samples are 5 s apart .* in ms: write time_unit = "ms"'),
    "us as s": ({"t": 1e6}, {}, 'apart .* in us: write time_unit = "us"'),
    "s as us": ({}, {"t": "us"}, 'the gyro: its samples are 5e-09 s apart .* in s: write time_unit = "s"'),
    "deg/s as rad/s": ({"gyr": 180 / np.pi}, {}, 'as if its degrees were declared .*: write flow.unit = "deg/s"'),
    "rad/s as deg/s": ({}, {"gyr": "deg/s"}, 'as if its radians were declared .*: write flow.unit = "rad/s"'),
}


def in_options(said):
    """As `bounds` says it whose options name columns and units."""
    said = said.replace("write flow.unit =", "say --gyro-unit").replace("write time_unit =", "say --time-unit")
    option = "--accelerometer-unit" if "m/s" in said else "--magnetometer-unit"
    return said.replace("write unit =", f"say {option}").replace('"', "").replace("in unit_ut", "by --field-ut")


def assert_said(said, output):
    assert re.search(said, output), output


# A gyro that is still shows its bias in either unit.
@pytest.mark.parametrize(
    ("name", "still"), [(name, still) for name in ODD for still in (False, True) if not still or "ad/s" not in name]
)
def test_bounds(tmp_path, name, still):
    """Of what is measured nothing is stated: it is suspicious, and a file is written all the same."""
    factors, units, said = ODD[name]
    log = written(tmp_path, arrays(factors, still=still))
    code, output = run("bounds", log, *named(units))
    assert code == 0, output
    assert_said(in_options(said), output)
    code, output = run("bounds", log, *named(units), "--out", tmp_path / "new.toml")
    assert_said(in_options(said), output)
    if "its median norm" in said:
        assert code == 0, output
        assert_said("suspicious: .*" + in_options(said), output)
        assert (tmp_path / "new.toml").exists()


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_an_acceleration_that_no_unit_explains_is_suspicious(tmp_path, factor):
    log = written(tmp_path, arrays({"acc": factor}))
    code, output = run("bounds", log, *named(), "--out", tmp_path / "new.toml")
    assert code == 0, output
    assert f"suspicious: up: its median norm is {'2.94' if factor < 1.0 else '29.4'}" in output
    assert ("without gravity" in output) == (factor < 1.0)


def test_bounds_refuse_what_their_user_states(tmp_path):
    """An accelerometer whose own bounds rule out what it shows, and a field above all that is stated."""
    for factors, said in (({"acc": 1e3 / GRAVITY}, 'write unit = "mg"'), ({"mag": 1e6}, "as they count allow at most")):
        log = written(tmp_path, arrays(factors))
        for bounds in ("rule", "sensor"):
            code, output = run("bounds", log, stated(tmp_path, bounds), "--out", tmp_path / "new.toml")
            assert code == 1, output
            assert said in output
            assert "--ignore-implausible of estimate" in output
        code, output = run("bounds", log, *named(), "--out", tmp_path / "new.toml")
        assert "--ignore-implausible" not in output
        (tmp_path / "new.toml").unlink(missing_ok=True)
        code, output = run("bounds", log, stated(tmp_path, "angle"), "--out", tmp_path / "new.toml")
        assert code == 0, output
        assert "suspicious: " in output
        (tmp_path / "new.toml").unlink()


def test_options_ask_for_the_unit_of_their_own_sensor(tmp_path):
    """No unit explains the accelerometer's length, and one explains the magnetometer's."""
    log = written(tmp_path, arrays({"acc": 0.3, "mag": 1e3}))
    code, output = run("bounds", log, *named())
    assert code == 0, output
    assert "up: its median norm is 2.94" in output
    assert_said("field: its median norm is 4.*it would be in nT: say --magnetometer-unit nT", output)
    assert "--accelerometer-unit" not in output


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize("bounds", ["rule", "sensor", "angle", "first"])
def test_estimate_and_check(tmp_path, name, bounds):
    factors, units, said = ODD[name]
    log, config = written(tmp_path, arrays(factors)), stated(tmp_path, bounds, units)
    code, output = run("check", log, config)
    assert_said(said, output)
    smooth = [] if bounds == "first" else ["--smooth"]
    refused, output = run("estimate", log, "--config", config, "--out", tmp_path / "out", *smooth)
    assert_said(said, output)
    # A suspicion is refused only with a proof; and what fails for another reason names it, too.
    assert ("suspicious: " in output) or refused
    if bounds in {"angle", "first"} and "its median norm" in said:
        assert not refused, output
    if bounds in {"rule", "sensor"} and name in {"mg as m/s^2", "m/s^2 as g", "uT as T", "g as m/s^2"}:
        assert code == refused == 1
        assert "If it is right as it is" in output


@pytest.mark.parametrize("name", [name for name, (_, units, _) in ODD.items() if "t" not in units])
def test_ahrs(name):
    factors, units, said = ODD[name]
    shown = list(arrays(factors).values())
    units = {f"{sensor}_unit": unit for sensor, unit in (STATED | units).items() if sensor != "t"}
    argument = "mag" if "field" in said or "normalized" in said else "acc"
    said = said.replace("up: ", "acc: ").replace("field: ", "mag: ").replace("the gyro: ", "gyr: ")
    said = said.replace("write unit = ", f"{argument}_unit=").replace("write flow.unit = ", "gyr_unit=")
    normalized = 'mag_unit="normalized", and in unit_ut how many µT 1 is'
    said = said.replace(normalized, 'mag_unit="uT", and multiply mag by the field of the place in µT')
    said = said.replace('in ms: write time_unit = "ms"', r"time is in s: are they milliseconds\?")
    said = said.replace('in us: write time_unit = "us"', r"time is in s: are they microseconds\?").replace('"', "'")
    for statements in ("hand", "recording"):
        try:
            notes = el.ahrs(*shown, statements=statements, **units).notes
        except ValueError as error:
            notes = (str(error),)
        assert_said(said, " ".join(notes))


@pytest.mark.parametrize(("factor", "back"), [(1e-6, "1e+06"), (1e6, "1e-06"), (1e-2, "100"), (1e3, "0.001")])
@pytest.mark.parametrize("bounds", ["sensor", "angle", "first"])
@pytest.mark.parametrize("unit", ["uT", "T"])
def test_a_reference_in_another_unit(tmp_path, factor, back, bounds, unit):
    """45.7 T where 45.7 µT are meant, of the log, of the reference, and of both."""
    reference = [0.0, 18.0 * factor, -42.0 * factor]
    config = stated(tmp_path, bounds, {"mag": unit}, reference)
    log = written(tmp_path, arrays())
    said = f"µT), times {back} it would be: write reference_ut = [0, 18, -42]".replace("), ", "); ")
    code, output = run("check", log, config)
    assert output.count(said) == 1
    refused, output = run("estimate", log, "--config", config, "--out", tmp_path / "out")
    assert said in output
    assert code == refused == (bounds == "sensor")
    assert (unit == "uT") != ('in uT: write unit = "uT"' in output)


def test_what_is_suspicious_is_in_the_report(tmp_path):
    log, page = written(tmp_path, arrays({"acc": 1 / GRAVITY})), tmp_path / "report.html"
    out = ("--out", tmp_path / "out", "--report", page)
    code, output = run("estimate", log, "--config", stated(tmp_path, "angle"), *out)
    assert code == 0, output
    text = page.read_text(encoding="utf-8")
    assert '<th scope="row">suspicious</th><td><span class="warn">up: its median norm is 1 m/s^2' in text


def test_gravity_in_g(tmp_path):
    said = "up: gravity_m_per_s2 = 1 is not that of the Earth, 9.7 to 9.9 m/s²; as a number in g it would be: write "
    log = written(tmp_path, arrays())
    for bounds in ("sensor", "angle"):
        config = stated(tmp_path, bounds, gravity_m_per_s2=1.0)
        refused, output = run("estimate", log, "--config", config, "--out", tmp_path / bounds)
        assert f"{said}gravity_m_per_s2 = 9.80665" in output
        assert refused == (bounds == "sensor")


@pytest.mark.parametrize("bounds", ["sensor", "angle"])
@pytest.mark.parametrize("is_reversed", [False, True])
def test_what_is_stated_of_gravity_comes_before_what_follows_from_it(tmp_path, bounds, is_reversed):
    """Gravity in g, and a field as in a coil: the magnetometer contradicts too, as up is not what it should be."""
    log = written(tmp_path, arrays({"mag": 20.0}))
    config = stated(tmp_path, bounds, reference=(0.0, 18e3, -42e3), gravity_m_per_s2=1.0)
    tables = tomlkit.parse(config.read_text()).unwrap()
    if is_reversed:
        tables["directions"].reverse()
    config.write_text(tomlkit.dumps(tables))
    for command in (("check", log, config), ("estimate", log, "--config", config, "--out", tmp_path / "out")):
        _, output = run(*command)
        said = ["gravity_m_per_s2 = 1 is", "reference_ut is", "up: its median norm is", "field: its median norm is"]
        places = [output.index(one) for one in said]
        assert places[0] == min(places), output
        assert places[1] < min(places[2:]), output


def test_degrees_of_a_gyro_at_rest(tmp_path):
    """Its bias of 0.368 deg/s would be 21 deg/s, by which nothing turns."""
    said = 'does not turn as the rate says, 21.* in the mean; in deg/s that would be 0.36.*: {} "?deg/s'
    log = written(tmp_path, arrays({"gyr": 180 / np.pi}, still=True))
    code, output = run("bounds", log, *named())
    assert code == 0, output
    assert_said(said.format("say --gyro-unit").replace('"?', ""), output)
    for bounds in ("rule", "sensor", "angle", "first"):
        _, output = run("estimate", log, "--config", stated(tmp_path, bounds), "--out", tmp_path / bounds)
        assert_said(said.format("write flow.unit ="), output)
    # As it is, nothing is said.
    log = written(tmp_path, arrays(still=True))
    for bounds in ("rule", "sensor", "angle", "first"):
        _, output = run("check", log, stated(tmp_path, bounds))
        assert "0 errors, 0 warnings" in output


def test_steps_that_somebody_states_are_not_odd(tmp_path):
    """A gyro that is read once in five seconds, with bounds for that."""
    log = written(tmp_path, arrays({"t": 1e3}, still=True))
    config = stated(tmp_path, "angle")
    tables = tomlkit.parse(config.read_text())
    assert "its samples are 5 s apart" in run("check", log, config)[1]
    tables["flow"]["longest_interval_s"] = 6.0
    config.write_text(tomlkit.dumps(tables))
    assert "apart (median)" not in run("check", log, config)[1]
    tables["bounds_from_recording"] = "log.csv"  # then it is the recording that says it
    config.write_text(tomlkit.dumps(tables))
    assert "its samples are 5 s apart" in run("check", log, config)[1]


def test_nanoseconds_as_seconds(tmp_path):
    """Such a time is refused where it is read."""
    log = written(tmp_path, arrays({"t": 1e10}))
    said = 'is its unit right? The steps are 5e+07 s (median); they would be in ns: write time_unit = "ns"'
    assert said in run("bounds", log, *named())[1]
    for bounds in ("rule", "angle"):
        assert said in run("check", log, stated(tmp_path, bounds))[1]
        assert said in run("estimate", log, "--config", stated(tmp_path, bounds), "--out", tmp_path / "out")[1]


def test_a_spacecraft_is_read_once_in_a_second():
    """Beside no accelerometer, that is; and nothing is read once in a microsecond."""
    folder = resources.files("elliptude") / "data" / "fermi"
    configuration = read_configuration(str(folder / "estimate.toml"))
    assert odd_step(np.full(10, 1.0), configuration) == ""
    assert "less than 2.8e-05 s" in odd_step(np.full(10, 1e-6), configuration)
    # 100 Hz read as ms, however the stamps are rounded; the fastest gyro is read at 32 kHz.
    assert odd_step(np.full(10, np.nextafter(1e-5, 1.0)), configuration)
    assert odd_step(np.full(10, 1.0 / 32000.0), configuration) == ""


@pytest.mark.parametrize("factor", [2.5, 5.0, 10.0, 20.0, 30.0])
def test_stamps_that_are_too_near_are_suspicious(tmp_path, factor):
    """A wrong unit, or a rate of rows that is too high: noise is large beside each step's turn."""
    log = written(tmp_path, arrays({"t": 1.0 / factor}))
    config = tmp_path / "config.toml"
    status, said = run("bounds", log, *named(), "--out", config)
    assert status == 0
    times = re.search(r"suspicious: field: turns ([\d.]+) times as far as the rate says, as if its stamps were", said)
    assert float(times[1]) == pytest.approx(factor, rel=0.1)
    assert "warning: field: turns" in run("check", log, config)[1]
