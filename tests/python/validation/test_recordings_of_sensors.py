"""Whole recordings of calibrated sensors, and of stamps that jitter: what is too small is noticed."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from drawn_recordings import FIXED, GUARANTEED, STAR, faults, require_noticed, smaller
from elliptude.bounds import windows
from elliptude.configuration import references, rules, tables
from elliptude.configuration.calibration import AccelerometerCalibration, GyroCalibration, MagnetometerCalibration
from elliptude.configuration.configuration import Configuration
from elliptude.estimation import direction_rows
from elliptude.estimation.given import filter_input
from elliptude.io.toml import validate
from elliptude.logs import channels
from elliptude.logs.log import read_log
from elliptude.validation.recordings import draw
from elliptude.validation.recordings.drawing import draw_recording
from elliptude.validation.recordings.trials import write_recording

GYRO = {"kind": "gyro", "columns": ["gx", "gy", "gz"], "longest_interval_s": 0.05, "noise_deg_per_s": 1e-6}
GYRO |= {"earth_rate": "removed"}
UP = {"name": "up", "kind": "accelerometer", "columns": ["ax", "ay", "az"], "unit": "g", "axes": ["y", "-x", "z"]}
UP |= {"at_rest": "down", "sensor_error": {"error_m_per_s2": 2.0, "scale_error": 0.2}}
FIELD = {"name": "field", "kind": "magnetometer", "columns": ["mx", "my", "mz"], "unit": "G"}
FIELD |= {"sensor_error": {"error_ut": 20.0, "scale_error": 0.3}, "reference_ut": [1.0, 20.0, -43.0]}
FIELD |= {"bound_from": {"kind": "field", "disturbance_ut": 0.0}}
STEADY = {"kind": "acceleration", "acceleration_m_per_s2": 0.0}
WINDOW = {"kind": "velocity_window", "windows_s": [2.0], "at": "middle", "velocity_m_per_s": 0.0}
MATRIX = [[1.1, 0.02, -0.05], [0.0, 0.95, 0.03], [0.04, 0.0, 0.9]]


def configured(flow, *directions, **more):
    tables = {"time_column": "t", "reference_frame": "ENU", "flow": GYRO | flow, "directions": list(directions)}
    return validate(Path("a test"), tables | {"estimator": GUARANTEED} | more, Configuration)


def calibrated(sensor, **left):
    """The calibration of one sensor."""
    of_vector = {"averaged_over_s": 0.5, "scale_error": 0.0}
    if sensor["kind"] == "accelerometer":
        found = of_vector | {"offset_m_per_s2": [0.3, -1.0, 0.5], "error_m_per_s2": 1e-9}
        found["averaged_error_m_per_s2"] = left.get("error_m_per_s2", 1e-9)
    elif sensor["kind"] == "magnetometer":
        found = of_vector | {"offset_ut": [20.0, 3.0, -9.0], "error_ut": 1e-9}
        found["averaged_error_ut"] = left.get("error_ut", 1e-9)
    else:
        found = {"name": "gyro", "scale_error": 0.0, "unit": "rad/s"}
    found |= {key: one for key, one in sensor.items() if key in {"name", "kind", "columns", "unit", "axes", "at_rest"}}
    return {"recording": "a test", "recording_sha256": "", "sensors": [found | {"matrix": MATRIX} | left]}


def force(bound=STEADY, **left):
    return configured({}, UP | {"bound_from": bound}, FIXED, calibration=calibrated(UP, **left))


def field(**left):
    return configured({}, FIELD, FIXED, calibration=calibrated(FIELD, **left))


def by_world_model():
    place = {"latitude_deg": -33.0, "longitude_deg": 151.0, "height_m": 300.0, "date": "2024-02-01T00:00:00Z"}
    exact = {key: one for key, one in FIELD.items() if key != "reference_ut"} | {"sensor_error": {"error_ut": 1e-9}}
    return configured({}, exact | {"reference": {"kind": "world_model"} | place}, FIXED | {"bound_deg": 1e-5}, STAR)


def ruled(of_gyro, **left):
    """A rule whose sensors are next to exact, but for a gyro that is calibrated."""
    rule = {"kind": "stated"} | rules.hand_held().model_dump(mode="json", exclude_none=True)
    rule["gyro"] = {"noise_deg_per_s": 0.01, "bias_deg_per_s": 0.0, "drift_deg_per_s2": 0.0, "scale_error": 0.2}
    rule["gyro"] |= {"earth_rate": "removed"} | of_gyro
    rule["motion"] |= {"velocity_m_per_s": 0.0, "position_m": 0.0, "windows_s": [2.0]}
    rule["rest"] |= {"velocity_m_per_s": 0.0}
    rule["accelerometer"] |= {"scale_error": 0.0, "error_m_per_s2": 1e-9, "averaged_error_m_per_s2": 0.0}
    rule["accelerometer"] |= {"gravity_error_m_per_s2": 0.0, "time_offset_bound_s": 0.0}
    rule["magnetometer"] |= {"scale_error": 0.0, "error_ut": 1e-9, "averaged_error_ut": 0.0, "disturbance_ut": 0.0}
    rule["magnetometer"] |= {"time_offset_bound_s": 0.0, "delay_s": 0.0}
    flow = {"kind": "gyro", "columns": ["gx", "gy", "gz"]}
    plain = [{"name": "up", "kind": "accelerometer", "columns": ["ax", "ay", "az"], "unit": "m/s^2"}]
    plain += [{"name": "field", "kind": "magnetometer", "columns": ["mx", "my", "mz"], "unit": "uT"}]
    tables = {"time_column": "t", "rule": rule, "flow": flow, "directions": plain, "estimator": GUARANTEED}
    return validate(Path("a test"), tables | {"calibration": calibrated(flow, **left)}, Configuration)


def only(monkeypatch, **kinds):
    """Let recordings be of these kinds."""
    every = draw._KINDS | {name: (kind,) for name, kind in kinds.items()}
    monkeypatch.setattr(draw, "_KINDS", every)


# --- what is drawn ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [force, field, lambda: ruled({})])
def test_calibrated_sensors_are_corrected(make):
    assert make().corrected_sensors()


def test_samples_are_those_that_a_calibration_corrects(tmp_path, monkeypatch):
    """By the formula of docs/calibrate.md, matrix (sample - offset): the specific force, to the bound that is left."""
    only(monkeypatch, **{"force offset": "in the body"})
    recording = draw_recording(force(error_m_per_s2=0.05), 3)
    columns, g = recording.columns, 9.80665
    a = np.column_stack([columns[name] for name in UP["columns"]])
    # The body's axes: [y, -x, z] of the sensor, which is down at rest.
    body = -g * np.column_stack([a[:, 1], -a[:, 0], a[:, 2]])
    known = np.isfinite(body[:, 0])
    corrected = (body[known] - [0.3, -1.0, 0.5]) @ np.array(MATRIX).T
    attitudes = recording.motion.attitudes(columns["t"][known])
    off = corrected - g * attitudes[:, 2]
    assert 0.045 < np.linalg.norm(off, axis=1).max() <= 0.05
    write_recording(recording, tmp_path / "log.csv")
    log = read_log(tmp_path / "log.csv", force(error_m_per_s2=0.05))
    np.testing.assert_allclose(log.directions[known, 0], corrected, rtol=0.0, atol=1e-12)


def test_stamps_jitter_within_their_bound(monkeypatch):
    """Each by its own, and the sensor shows what it would have shown then."""
    only(monkeypatch, jitter="at the bound", offsets="none", turns="spin", directions="none")
    recording = draw_recording(configured({}, FIXED | {"time_offset_bound_s": 0.02}, STAR), 1)
    times, truth = recording.columns["t"], np.array(FIXED["reference"]) / np.linalg.norm(FIXED["reference"])
    shown = np.column_stack([recording.columns[name] for name in FIXED["columns"]])
    shown /= np.linalg.norm(shown, axis=1)[:, None]
    away = [np.linalg.norm(shown - recording.motion.attitudes(times + late).transpose(0, 2, 1) @ truth, axis=1)
            for late in (-0.02, 0.02)]  # fmt: skip
    known = np.isfinite(shown[:, 0])
    assert np.minimum(*away)[known].max() < 1e-6
    assert min(one[known].max() for one in away) > 1e-3


# --- that a bound that is too small is noticed ------------------------------------------------------------------------


def less_is_left(monkeypatch, **shares):
    """Let less be left of errors by a calibration than it says."""
    whole = tables.calibrated_bounds

    def bounds(*given):
        found = whole(*given)
        changed = {name: share * getattr(found, name) for name, share in shares.items()}
        return dataclasses.replace(found, **changed)

    monkeypatch.setattr(tables, "calibrated_bounds", bounds)


def rule_with(monkeypatch, change):
    """Let the estimator have another calibrated rule."""
    whole = Configuration.calibrated_rule

    def rule(configuration):
        found = whole(configuration)
        return found.model_copy(update={"gyro": found.gyro.model_copy(update=change(found.gyro))})

    monkeypatch.setattr(Configuration, "calibrated_rule", rule)


def matrix_the_wrong_way(monkeypatch):
    whole = channels._corrected
    monkeypatch.setattr(channels, "_corrected", lambda convert, offset, matrix: whole(convert, offset, matrix.T))


def gyro_with_less_noise(monkeypatch):
    whole = filter_input.gyro_flow
    monkeypatch.setattr(
        filter_input, "gyro_flow", lambda gyro, flow: whole(dataclasses.replace(gyro, noise=0.8 * gyro.noise), flow)
    )


def samples_with_less_error(monkeypatch):
    whole = Configuration.sensor_bounds

    def bounds(*given):
        found = whole(*given)
        return dataclasses.replace(found, error=0.8 * found.error)

    monkeypatch.setattr(Configuration, "sensor_bounds", bounds)


def less_of_offsets(monkeypatch, **shares):
    """Let less of what offsets in time do to means be counted, whichever way it goes."""
    whole = windows.turns_within_offset

    def turns(*given):
        found = whole(*given)
        changed = {name: share * getattr(found, name) for name, share in shares.items()}
        return dataclasses.replace(found, angles=np.full_like(found.angles, np.pi), **changed)

    monkeypatch.setattr(windows, "turns_within_offset", turns)


def shifted(change):
    """An exact accelerometer whose stamps are off, and whose place is known."""
    bound = WINDOW | {"position_m": 0.0, "time_offset_change_s": change}
    plain = {"name": "up", "kind": "accelerometer", "columns": ["ax", "ay", "az"], "unit": "m/s^2"}
    return configured({}, plain | {"bound_from": bound, "time_offset_bound_s": 0.02}, FIXED)


def field_of_a_sphere(monkeypatch):
    """Let the Earth be round: of a latitude that is up to 0.2° off, the field up to 0.3°."""
    monkeypatch.setattr(references, "_POLE", references._EQUATOR)


def field_of_the_next_year(monkeypatch):
    whole = references.world_model_field
    monkeypatch.setattr(
        references,
        "world_model_field",
        lambda model, frame: whole(model.model_copy(update={"date": model.date.replace(year=2025)}), frame),
    )


WEAKENED = {
    "the Earth's field on the ellipsoid": (field_of_a_sphere, lambda: by_world_model()),
    "the date of the Earth's field": (field_of_the_next_year, lambda: by_world_model()),
    "an accelerometer's offset": (lambda m: smaller(m, AccelerometerCalibration, "offset", 0.99), force),
    "a magnetometer's offset": (lambda m: smaller(m, MagnetometerCalibration, "offset", 0.99), field),
    "a calibration's matrix": (matrix_the_wrong_way, force),
    "the offset that is left": (lambda m: less_is_left(m, error=0.8), lambda: force(error_m_per_s2=0.3)),
    "the mean that is left": (
        lambda m: less_is_left(m, averaged_error=0.8),
        lambda: force(WINDOW, error_m_per_s2=0.3, averaged_error_m_per_s2=0.1),
    ),
    "how long a mean is that is left": (
        lambda m: less_is_left(m, averaged_over=0.2),
        lambda: force(WINDOW, error_m_per_s2=0.3, averaged_error_m_per_s2=0.05, averaged_over_s=4.0),
        {"force offset": "waves", "force wobble": "none"},
    ),
    "the scale that is left": (lambda m: less_is_left(m, scale_error=0.8), lambda: field(scale_error=0.1)),
    "a gyro's matrix": (matrix_the_wrong_way, lambda: ruled({})),
    "the scale that is left of a gyro": (
        lambda m: rule_with(m, lambda gyro: {"scale_error": 0.5 * gyro.scale_error}),
        lambda: ruled({}, scale_error=0.05),
    ),
    "what a gyro's matrix makes of noise": (
        lambda m: m.setattr(GyroCalibration, "noise_factor", lambda _: 1.0),
        lambda: ruled({"noise_deg_per_s": 2.0}, matrix=[[1.3, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.0]]),
    ),
    "the noise that a gyro's calibration was told": (
        lambda m: rule_with(m, lambda gyro: {"noise_deg_per_s": 0.5 * gyro.noise_deg_per_s}),
        lambda: ruled({"noise_deg_per_s": 1.0}, noise_deg_per_s=2.0, bias_deg_per_s=0.0),
    ),
    "stamps that jitter": (
        lambda m: smaller(m, direction_rows, "time_offset_angles"),
        lambda: configured({}, FIXED | {"time_offset_bound_s": 0.02}, STAR),
        {"jitter": "any", "offsets": "none"},
    ),
    "an offset that all samples of a window share": (
        lambda m: less_of_offsets(m, common=0.8),
        lambda: shifted(0.002),
        {"offsets": "late", "turns": "spin"},
    ),
    "offsets of a window that change": (
        lambda m: less_of_offsets(m, others=0.5),
        lambda: shifted(0.03),
        {"offsets": "late", "turns": "spin"},
    ),
    "a gyro whose stamps jitter": (
        gyro_with_less_noise,
        lambda: configured({"noise_deg_per_s": 50.0}, FIXED, STAR),
        {"noise": "jitter", "turns": "spin"},
    ),
    "an accelerometer whose stamps jitter": (
        samples_with_less_error,
        lambda: configured(
            {},
            UP | {"bound_from": STEADY, "sensor_error": {"error_m_per_s2": 0.5, "averaged_error_m_per_s2": 0.2}},
            FIXED,
        ),
        {"force wobble": "jitter", "turns": "spin"},
    ),
}


@pytest.mark.parametrize("what", WEAKENED)
def test_a_bound_that_is_too_small_is_noticed(what, monkeypatch):
    weaken, make, *kinds = WEAKENED[what]
    for one in kinds:
        only(monkeypatch, **one)
    require_noticed(monkeypatch, weaken, make)


def test_nothing_is_wrong_with_a_calibration_that_says_less_than_is_stated():
    """Then samples are taken as they are."""
    whole = configured({}, UP | {"bound_from": STEADY, "sensor_error": {"error_m_per_s2": 0.1}}, FIXED)
    worse = whole.model_copy(update={"calibration": force(error_m_per_s2=0.2).calibration})
    assert not worse.corrected_sensors()
    assert not faults(worse, 3)
