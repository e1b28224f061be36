"""Roll, pitch and yaw in results: the truth is between their ends in every frame, while errors use up their bounds."""

import dataclasses

import numpy as np
import pytest
from elliptude import estimation
from elliptude.configuration import Configuration
from elliptude.configuration.references import from_enu
from scipy.spatial.transform import Rotation
from test_guaranteed_run import configured, gyro_log, with_accelerometer

NOISE, BOUND = 0.05, 0.1


def in_frame(log, frame):
    """The log with its references and truth in the axes of another frame; its own is ENU."""
    axes = from_enu(np.eye(3), frame).T
    return dataclasses.replace(log, references=log.references @ axes.T, true_attitudes=axes @ log.true_attitudes)


def estimated(log, frame, **changes):
    fields = with_accelerometer(
        configured({"noise_deg_per_s": np.rad2deg(NOISE)}, bound=BOUND), bound_deg=np.rad2deg(BOUND)
    )
    return estimation.estimate(log, Configuration.model_validate(fields | {"reference_frame": frame} | changes)).result


def inside(result, true_attitudes):
    """Whether roll, pitch and yaw of the truth are between their ends, shape (N, 3); NaN ends hold nothing."""
    true = Rotation.from_matrix(true_attitudes).as_euler("ZYX")[:, ::-1]
    least, most = result.roll_pitch_yaw[:, 1::3], result.roll_pitch_yaw[:, 2::3]
    away = np.abs((true - 0.5 * (least + most) + np.pi) % (2.0 * np.pi) - np.pi)
    return away <= 0.5 * (most - least)


@pytest.mark.parametrize("frame", ["ENU", "NED", "NWU"])
@pytest.mark.parametrize("seed", range(4))
def test_the_truth_is_between_the_ends(seed, frame):
    log = in_frame(gyro_log(seed, count=250, noise=NOISE, bound=BOUND), frame)
    result = estimated(log, frame)
    assert set(result.claims) == set(result.up_claims) == {"unconditional"}
    assert inside(result, log.true_attitudes).all()
    widths = result.roll_pitch_yaw[:, 2::3] - result.roll_pitch_yaw[:, 1::3]
    assert (np.median(widths, axis=0) < [0.7, 0.4, 0.8]).all()
    # A test that can fail: ends half as far from the middle leave the truth out.
    middle = 0.5 * (result.roll_pitch_yaw[:, 2::3] + result.roll_pitch_yaw[:, 1::3])
    half = np.stack([middle, middle - 0.1 * widths, middle + 0.1 * widths], axis=2).reshape(-1, 9)
    assert not inside(dataclasses.replace(result, roll_pitch_yaw=half), log.true_attitudes).all()


def test_the_values_are_those_of_up_and_of_the_attitude():
    log = in_frame(gyro_log(1, count=60, noise=NOISE, bound=BOUND), "NED")
    result = estimated(log, "NED")
    down = -result.ups
    values = result.roll_pitch_yaw[:, ::3]
    np.testing.assert_allclose(values[:, 0], np.arctan2(down[:, 1], down[:, 2]), atol=1e-12)
    np.testing.assert_allclose(values[:, 1], -np.arcsin(down[:, 0]), atol=1e-9)
    np.testing.assert_allclose(
        values[:, 2], Rotation.from_quat(result.quaternions, scalar_first=True).as_euler("ZYX")[:, 0], atol=1e-9
    )


def test_without_an_attitude_roll_and_pitch_are_known_and_yaw_is_not():
    log = gyro_log(2, count=60, noise=NOISE, bound=BOUND, measured=(0,))
    columns = {"kind": "gyro", "columns": ["x", "y", "z"]}
    # Rates that are constant within intervals are off the lines between samples, by less than the second term.
    flow = columns | {"interval_rate": "mean_of_ends", "noise_deg_per_s": np.rad2deg(NOISE + 0.1)}
    result = estimated(log, "ENU", flow=flow)
    assert set(result.claims) == {"none"}
    assert np.isnan(result.roll_pitch_yaw[:, 6:]).all()
    measured = np.isfinite(result.up_bounds)
    assert measured.any()
    assert np.isfinite(result.roll_pitch_yaw[measured, :6]).all()
    assert inside(result, log.true_attitudes)[measured, :2].all()


def test_without_an_accelerometer_there_are_no_such_columns():
    log = gyro_log(count=20, noise=NOISE)
    result = estimation.estimate(log, configured({"noise_deg_per_s": np.rad2deg(NOISE)})).result
    assert result.roll_pitch_yaw is None
    assert not {"roll", "yaw_from"} & set(result.columns())
