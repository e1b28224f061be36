"""A start says what the gyro's bias is, the whole of it, as the tables of results do, beside a known bias too."""

import numpy as np
import pytest
from elliptude import estimation
from elliptude.configuration import Configuration
from elliptude.logs import Log

KNOWN_DEG = (1.0, -2.0, 0.5)
KNOWN = np.deg2rad(KNOWN_DEG)
WHOLE = KNOWN + np.array([0.002, 0.001, -0.001])
REFERENCES = np.array([[0.0, 0.0, 1.0], [0.0, 0.6, -0.8]])
COUNT = 21


def still(measured):
    directions = np.full((COUNT, 2, 3), np.nan)
    directions[measured] = REFERENCES
    return Log(
        times=np.linspace(0.0, 2.0, COUNT),
        directions=directions,
        references=np.tile(REFERENCES, (COUNT, 1, 1)),
        rates=np.tile(WHOLE, (COUNT, 1)),
        true_attitudes=np.tile(np.eye(3), (COUNT, 1, 1)),
        true_vectors=np.tile(WHOLE, (COUNT, 1)),
    )


def configured(start, *, mode="guaranteed", **flow):
    gyro = {"kind": "gyro", "columns": ["x", "y", "z"], "noise_deg_per_s": 1e-4, "known_bias_deg_per_s": KNOWN_DEG}
    sensors = [
        {"name": name, "columns": list(columns), "reference": reference.tolist(), "bound_deg": 1.0}
        for name, columns, reference in zip(("one", "two"), ("abc", "def"), REFERENCES, strict=True)
    ]
    return Configuration.model_validate(
        {"flow": gyro | flow, "directions": sensors, "start": start, "estimator": {"mode": mode}}
    )


def given(**more):
    diagonal = [1e-4] * 3 + [1e-6] * 3
    return {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": diagonal} | more


ESTIMATED = {"bias_deg_per_s": 1.0, "estimate_bias": True}


def test_the_start_is_of_the_whole_bias_as_the_table_is():
    stated = given(rate_rad_per_s=WHOLE.tolist(), P_diagonal=[1e-4] * 3 + [1e-10] * 3)
    found = estimation.estimate(still(np.zeros(COUNT, bool)), configured(stated, **ESTIMATED)).result
    np.testing.assert_allclose(found.vectors[0], WHOLE, atol=1e-12)
    assert found.forms.max() <= 1.0


@pytest.mark.parametrize("mode", ["guaranteed", "first_order"])
def test_a_start_that_says_nothing_of_the_bias_is_about_what_is_known_of_it(mode):
    flow = ESTIMATED if mode == "guaranteed" else {}
    found = estimation.estimate(still(np.zeros(COUNT, bool)), configured(given(), mode=mode, **flow)).result
    np.testing.assert_allclose(found.vectors[0], KNOWN, atol=1e-12)
    np.testing.assert_allclose(found.shapes[0, 3:, 3:], 1e-6 * np.eye(3), rtol=1e-4)


def test_a_start_by_the_first_measurement_is_about_what_is_known_of_the_bias():
    start = {"kind": "first_measurement", "bias_bound_deg_per_s": 0.2}
    found = estimation.estimate(still(np.ones(COUNT, bool)), configured(start, mode="first_order")).result
    np.testing.assert_allclose(found.vectors[0], KNOWN, atol=1e-12)
    np.testing.assert_allclose(found.vectors[-1], WHOLE, atol=np.deg2rad(0.2))


def test_a_bias_that_is_not_estimated_is_not_stated_twice():
    log = still(np.ones(COUNT, bool))
    flow = {"bias_deg_per_s": 1.0}
    estimation.estimate(log, configured(given(), **flow))
    for stated in (WHOLE.tolist(), [0.0, 0.0, 0.0]):
        with pytest.raises(ValueError, match=r"start\.rate_rad_per_s: the bias is not estimated"):
            estimation.estimate(log, configured(given(rate_rad_per_s=stated), **flow))


def test_a_start_that_the_bound_of_the_bias_excludes_names_its_keys():
    stated = given(rate_rad_per_s=[0.3, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"start\.rate_rad_per_s .* flow\.bias_deg_per_s .* 16\.32 .*known_bias"):
        estimation.estimate(still(np.ones(COUNT, bool)), configured(stated, **ESTIMATED))
