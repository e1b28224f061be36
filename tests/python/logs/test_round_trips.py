"""What `elliptude convert --config` writes is all that `estimate` reads: from the table the same results follow."""

import dataclasses

import numpy as np
import pytest
import tomlkit
from elliptude import cli, estimation
from elliptude.configuration import Configuration, read_configuration
from elliptude.configuration.rules import rule_for
from elliptude.estimation.direction_rows import direction_rows
from elliptude.io.readers.open import open_log
from elliptude.io.tables import reference
from elliptude.logs import conversion, log
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

COUNT, STEP, G = 900, 0.02, 9.80665
UPDATES = {"mode": "guaranteed", "policy": "drop_measurement", "best": "center"}


def columns(name, count=3):
    return [f"{name}[{i}]" for i in range(count)]


def own(name):
    return {"time_column": f"{name}_t", "time_unit": "ms"}


def turning_body(**every):
    """At rest for 4 s, then turned slowly: arrays in odd units and axes, each sensor with its own stamps and gaps."""
    rng = np.random.default_rng(3)
    times = STEP * np.arange(COUNT)
    rates = np.where(times[:, None] > 4.0, [0.2, -0.1, 0.15] * np.sin(times - 4.0)[:, None], 0.0)
    attitudes = [Rotation.identity()]
    for turn in Rotation.from_rotvec(0.5 * STEP * (rates[1:] + rates[:-1])):
        attitudes.append(attitudes[-1] * turn)
    body = Rotation.concatenate(attitudes).inv()
    late = 0.003 * rng.random((6, COUNT))
    arrays = {"t": 1_000.0 * (times + 50.0), "gyr": np.rad2deg(rates) + np.array([0.1, 0.0, 0.0])}
    for k, name in enumerate(("gyr", "acc", "mag", "sun", "vel", "q")):
        arrays[f"{name}_t"] = 1_000.0 * (times + 50.0 + late[k])
    noise = 0.001 * rng.standard_normal((3, COUNT, 3))
    arrays["acc"] = -(body.apply([0.0, 0.0, 1.0]) + noise[0]) @ [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # g, down, turned
    arrays["mag"] = 1e3 * (body.apply([0.0, 20.0, -40.0]) + noise[1])
    arrays["sun"] = 3.0 * body.apply([1.0, 0.2, 0.0]) + noise[2]
    arrays["sun_ref"] = np.tile([1.0, 0.2, 0.0], (COUNT, 1))
    arrays["vel"] = 3.6 * 0.001 * rng.standard_normal((COUNT, 3))
    arrays["q"] = body.as_quat()  # xyzw, from reference to body axes
    arrays["bias"] = np.tile([0.1, 0.0, 0.0], (COUNT, 1))
    for name, step in ({"mag": 3, "sun": 5, "vel": 10, "q": 2, "gyr": 2} | every).items():
        left = np.arange(COUNT) % step != 0
        for one in {"q": ("q", "bias"), "sun": ("sun", "sun_ref")}.get(name, (name,)):
            arrays[one] = np.where(left[:, None], np.nan, arrays[one])
        arrays[f"{name}_t"][left] = np.nan
    return arrays


SKIPS = {"mode": "first_order", "when_sets_do_not_meet": "skip"}
TRUTH = {"attitude_columns": columns("q", 4), "order": "xyzw", "turns": "reference_to_body", "error_deg": 0.5}
UP = {"name": "up", "kind": "accelerometer", "columns": columns("acc"), "unit": "g", "at_rest": "down"}
UP |= {"axes": ["-y", "x", "z"]}
FIELD = {"name": "field", "kind": "magnetometer", "columns": columns("mag"), "unit": "nT"}
GYRO = {"kind": "gyro", "columns": columns("gyr"), "unit": "deg/s"}
STATED_GYRO = GYRO | {"noise_deg_per_s": 0.5, "longest_interval_s": 0.1, "known_bias_deg_per_s": [0.1, 0.0, 0.0]}
VELOCITY = {"columns": columns("vel"), "unit": "km/h", "error_m_per_s": 0.2, "largest_acceleration_m_per_s2": 2.0}


def gyro_tables(with_own_stamps):
    """All that a configuration of a gyro may read, with own stamps of different times in a row or none."""
    clocks = {name: own(name) | {"delay_s": 0.001} for name in ("acc", "mag", "sun", "vel", "q", "gyr")}
    clocks = {name: clock if with_own_stamps else {} for name, clock in clocks.items()}
    windows = {"kind": "velocity_window", "windows_s": [0.5], "gravity_error_m_per_s2": 0.05}
    phase = {"kind": "rest_phase", "from_s": 50.5, "to_s": 53.0, "declination_deg": 2.0, "velocity_m_per_s": 0.01}
    error = {"error_m_per_s2": 0.3, "scale_error": 0.01}
    directions = [
        UP | {"bound_from": windows, "sensor_error": error} | clocks["acc"],
        FIELD
        | {
            "reference": phase,
            "bound_from": {"kind": "field", "disturbance_ut": 2.0},
            "sensor_error": {"error_ut": 1.0},
        }
        | clocks["mag"],
        {"name": "sun", "columns": columns("sun"), "reference_columns": columns("sun_ref"), "bound_deg": 2.0}
        | {"reference_rate_deg_per_s": 0.0}
        | clocks["sun"],
    ]
    return {
        "time_column": "t",
        "time_unit": "ms",
        "reference_frame": "ENU",
        "timing": {"origin": "first", "same_within_s": 0.004} if with_own_stamps else {},
        "flow": STATED_GYRO | clocks["gyr"],
        "directions": directions,
        "velocity": VELOCITY | clocks["vel"],
        "estimator": UPDATES,
        "truth": TRUTH | {"vector_columns": columns("bias"), "vector_unit": "deg/s"} | clocks["q"],
    }


def without_stamps(arrays):
    """Rows in which the gyro's cells are empty are none of a log's without stamps of its own."""
    return {name: values[::2] for name, values in arrays.items() if not name.endswith("_t")}


def calibration(*sensors):
    return {"recording": "bench.csv", "recording_sha256": "0", "sensors": list(sensors)}


FORCE_CALIBRATION = {
    "name": "up", "kind": "accelerometer", "columns": UP["columns"], "axes": UP["axes"], "unit": "g", "at_rest": "down",
    "matrix": (1.001 * np.eye(3)).tolist(), "scale_error": 0.001, "offset_m_per_s2": [0.01, 0.0, -0.02],
    "error_m_per_s2": 0.15, "averaged_error_m_per_s2": 0.1,
}  # fmt: skip


def of_gyro():
    return without_stamps(turning_body()), gyro_tables(False)


def of_own_stamps():
    return turning_body(), gyro_tables(True)


def of_gyro_first_order():
    arrays, tables = of_own_stamps()
    directions = [{**one, "bound_deg": 10.0} for one in tables["directions"]]
    for one in directions:
        one.pop("bound_from", None)
    del tables["velocity"]
    tables["truth"] |= own("known") | {"attitude_columns": columns("known", 4)}
    del tables["truth"]["vector_columns"], tables["truth"]["vector_unit"]
    # A truth beside its rows is refused in this mode: it has rows of its own.
    arrays["known"] = np.where(np.arange(COUNT)[:, None] % 2 == 1, arrays["q"][[0]], np.nan)
    arrays["known_t"] = np.where(np.isfinite(arrays["known"][:, 0]), arrays["t"] + 10.0, np.nan)
    start = {"kind": "first_measurement", "bias_bound_deg_per_s": 0.1}
    return arrays, tables | {"directions": directions, "estimator": SKIPS, "start": start}


def of_calibrated():
    arrays, tables = of_own_stamps()
    return arrays, tables | {"calibration": calibration(FORCE_CALIBRATION)}


def of_rule():
    """With a calibration of the gyro and the accelerometer, a measured velocity, and stamps of the sensors' own."""
    arrays, tables = turning_body(mag=1, gyr=1), gyro_tables(True)
    gyro = {"name": "the gyro", "kind": "gyro", "columns": GYRO["columns"], "unit": "deg/s"}
    gyro |= {"matrix": (1.001 * np.eye(3)).tolist(), "scale_error": 0.001}
    rule = rule_for("hand").model_dump(mode="json", exclude_none=True) | {"kind": "stated", "anchor_s": 4.0}
    rule["gyro"]["longest_interval_s"] = 0.1
    rule["rest"]["least_s"] = 2.0
    return arrays, tables | {
        "rule": rule,
        "flow": GYRO | own("gyr"),
        "directions": [UP | own("acc"), FIELD | {"unit": "normalized", "unit_ut": 0.001} | own("mag")],
        "calibration": calibration(FORCE_CALIBRATION, gyro),
    }


def of_rigid_body():
    """With torques, wheels, a measured rate, and the Sun by time, whose bound makes it say little."""
    arrays = turning_body(mag=1, sun=2)
    arrays["wheels"], arrays["torque"] = np.zeros((COUNT, 3)), np.full((COUNT, 3), 1e-4)
    arrays["wheels"][:, 0] = 1e-3 * np.sin(arrays["t"] / 1_000.0)
    arrays["gyr"] -= [0.1, 0.0, 0.0]
    flow = {"kind": "rigid_body", "inertia_kg_m2": [0.2, 0.3, 0.25], "step_s": 0.005, "unknown_torque_n_m": 0.2}
    flow |= {"control_torque_columns": columns("torque"), "wheel_momentum_columns": columns("wheels")}
    moved = Rotation.from_rotvec([0.0, 0.0, 1.0]).as_matrix().tolist()
    sun = {"columns": columns("sun"), "bound_deg": 2.0}
    return arrays, {
        "time_column": "t",
        "time_unit": "ms",
        "reference_frame": "J2000",
        "flow": flow | {"largest_rate_deg_per_s": 40.0},
        "directions": [
            {"name": "sun", "reference_columns": columns("sun_ref")} | sun,
            {"name": "star", "columns": columns("mag"), "reference": [0.0, 20.0, -40.0], "bound_deg": 3.0},
            {"name": "moved", "axes": moved, "reference": {"kind": "sun", "time_zero": "2024-05-01T12:00:00Z"}}
            | sun
            | {"bound_deg": 170.0},
        ],
        "rate": {"columns": columns("gyr"), "unit": "deg/s", "axes": ["x", "y", "z"], "bound_deg_per_s": 1.0},
        "estimator": UPDATES,
        "truth": TRUTH,
    }


def of_rigid_body_first_order():
    arrays, tables = of_rigid_body()
    del tables["flow"]["wheel_momentum_columns"]
    start = {"kind": "first_measurement"}
    return arrays, tables | {"directions": tables["directions"][:2], "estimator": SKIPS, "start": start}


# Rounded anew are stamps beside those of rows, what a calibration leaves in other units, and a normalized sensor.
EXACT = (of_gyro, of_rigid_body, of_rigid_body_first_order)
ROUNDED = (of_own_stamps, of_gyro_first_order, of_calibrated, of_rule)
OF_TRUTH = {"errors", "forms", "turns_reference_forms", "turns_body_forms"}


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments], env={"COLUMNS": "200"})


@pytest.mark.parametrize("made", [*EXACT, *ROUNDED])
@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_the_table_gives_the_same_results(tmp_path, made, suffix, monkeypatch):
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", 50_000)
    arrays, tables = made()
    np.savez(tmp_path / "log.npz", **arrays)
    (tmp_path / "log.toml").write_text(tomlkit.dumps(tables))
    table, config = tmp_path / f"table{suffix}", tmp_path / "table.toml"
    done = run("convert", tmp_path / "log.npz", table, "--config", tmp_path / "log.toml", "--config-out", config)
    assert done.exit_code == 0, done.output
    found = []
    for file, stated in ((tmp_path / "log.npz", tmp_path / "log.toml"), (table, config)):
        configuration = read_configuration(stated)
        read = log.read_log(file, configuration)
        found.append((read, estimation.estimate(read, configuration).result))
    (first, expected), (second, result) = found
    known = expected.largest_angles if expected.up_bounds is None else expected.up_bounds
    assert np.isfinite(known).sum() > 100
    for name in ("offsets", "velocity_offsets", "rate_offsets", "true_offsets"):
        assert (getattr(first, name) is None) == (getattr(second, name) is None)
    tolerance = 1e-9 if made in ROUNDED else 0.0
    for field in dataclasses.fields(expected):
        one, other = getattr(expected, field.name), getattr(result, field.name)
        if isinstance(one, np.ndarray):
            within = 1e-6 if field.name in OF_TRUTH else tolerance
            np.testing.assert_allclose(other, one, rtol=within, atol=1e-3 * within, err_msg=field.name)
        elif field.name != "origin":
            assert one == other, field.name


def test_a_rest_phase_beyond_the_rows_is_refused(tmp_path):
    """From the rows alone another reference would follow."""
    arrays, tables = of_own_stamps()
    arrays["gyr"][:100] = arrays["gyr_t"][:100] = np.nan
    np.savez(tmp_path / "log.npz", **arrays)
    (tmp_path / "log.toml").write_text(tomlkit.dumps(tables))
    names = tmp_path / "log.npz", tmp_path / "table.csv", "--config", tmp_path / "log.toml"
    done = run("convert", *names, "--config-out", tmp_path / "table.toml")
    assert done.exit_code == 1
    assert "its rest phase from 50.5 s to 53 s reaches beyond the rows" in done.output
    assert sorted(one.name for one in tmp_path.iterdir()) == ["log.npz", "log.toml"]
    assert run("convert", *names).exit_code == 0


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_the_field_of_a_rule_is_that_of_the_sensors_own_stamps(tmp_path, suffix):
    """Its mean over the rest is over the times of its own samples, as `estimate` has it."""
    arrays, tables = of_rule()
    # A field that changes within the rest, whose samples are late where it is small.
    arrays["mag"][:, 1] += 2e3 * np.sin(arrays["t"] / 300.0)
    np.savez(tmp_path / "log.npz", **arrays)
    configuration = Configuration.model_validate(tables)
    table = tmp_path / f"table{suffix}"
    conversion.convert_measurements(tmp_path / "log.npz", table, configuration)
    file = open_log(table)
    (found,) = [
        np.array([batch[name].values[0] for name in reference("field")]) for batch in file.batches(reference("field"))
    ]
    rows = direction_rows(log.read_log(tmp_path / "log.npz", configuration), configuration)
    expected = rows.references[0, rows.names.index("field")]
    np.testing.assert_allclose(found, expected, atol=1e-14)
