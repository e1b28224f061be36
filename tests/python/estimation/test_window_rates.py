"""Windows carry a frame along with the gyro: what the rate does between its samples is part of their bound."""

import numpy as np
import pytest
from elliptude.configuration import Configuration
from elliptude.estimation.direction_rows import direction_rows
from elliptude.logs.log import read_log
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665
STEP, ACCELERATION = 0.02, np.deg2rad(360.0)


def configuration(**flow):
    def columns(name):
        return [f"{name}[{i}]" for i in range(3)]

    window = {"kind": "velocity_window", "windows_s": [4.0], "position_m": 0.0, "velocity_m_per_s": 0.0}
    return {
        "time_column": "t",
        "reference_frame": "ENU",
        "flow": {"kind": "gyro", "columns": columns("gyr"), "noise_deg_per_s": 0.01} | flow,
        "directions": [
            {"name": "up", "kind": "accelerometer", "columns": columns("acc"), "bound_from": window, "unit": "m/s^2"}
        ],
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
    }


def with_place(table, place):
    table["directions"][0]["bound_from"]["at"] = place
    return table


@pytest.mark.parametrize("place", ["end", "middle"])
def test_a_rate_that_moves_between_its_samples(tmp_path, place):
    """It is zero at each sample and rises to a peak between two: the body turns, and the gyro shows nothing."""
    times = STEP * np.arange(400)
    attitudes = Rotation.from_rotvec(np.outer(0.25 * ACCELERATION * STEP * times, [1.0, 0.0, 0.0]))
    forces = attitudes.inv().apply([0.0, 0.0, GRAVITY])
    np.savez(tmp_path / "log.npz", t=times, gyr=np.zeros((400, 3)), acc=forces)
    table = with_place(configuration(angular_acceleration_deg_per_s2=np.rad2deg(ACCELERATION) * (1 + 1e-9)), place)
    fitted = Configuration.model_validate(table)
    rows = direction_rows(read_log(tmp_path / "log.npz", fitted), fitted)
    up = attitudes.inv().apply([0.0, 0.0, 1.0])
    errors = np.arctan2(
        np.linalg.norm(np.cross(rows.directions[:, 0], up), axis=1), (rows.directions[:, 0] * up).sum(axis=1)
    )
    assert not rows.contradictions
    bounded = np.isfinite(rows.angles[:, 0])
    assert bounded.sum() > 100
    assert (errors <= rows.angles[:, 0])[bounded].all()


@pytest.mark.parametrize("within", [0.0, 0.45 * STEP])
def test_rows_of_another_sensor_break_no_window(tmp_path, within):
    """A magnetometer has stamps of its own, and some make a row with the gyro's. Up is as well known as without it."""
    random = np.random.default_rng(4)
    times = STEP * np.arange(600)
    rates = np.deg2rad(40.0) * np.column_stack([np.sin(0.7 * times), np.cos(0.9 * times), np.sin(1.1 * times)])
    own = np.arange(0.05, times[-1], 0.0871)
    forces = random.normal([0.0, 0.0, GRAVITY], 0.01, (600, 3))
    arrays = {"t": times, "gyr": rates, "acc": forces}
    np.savez(tmp_path / "log.npz", **arrays, other=own, mag=np.tile([20.0, 0.0, -40.0], (len(own), 1)))
    alone = configuration()
    alone["directions"][0]["bound_from"] |= {"velocity_m_per_s": 9.0, "position_m": 5.0}
    field = {"name": "m", "kind": "magnetometer", "columns": [f"mag[{i}]" for i in range(3)], "unit": "uT"}
    field |= {"time_column": "other", "time_unit": "s", "reference_ut": [0.0, 20.0, -40.0], "bound_deg": 5.0}
    with_field = alone | {"directions": [*alone["directions"], field], "timing": {"same_within_s": within}}
    found = []
    for table in (alone, with_field):
        fitted = Configuration.model_validate(table)
        log = read_log(tmp_path / "log.npz", fitted)
        rows = direction_rows(log, fitted)
        sampled = np.isin(log.times, times)
        assert sampled.sum() == len(times)
        found.append((rows.directions[sampled, 0], rows.angles[sampled, 0]))
        assert np.isnan(rows.angles[~sampled, 0]).all()
    assert np.isfinite(found[0][1]).mean() > 0.5
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-9)


def test_windows_need_rates_on_lines():
    with pytest.raises(
        ValueError, match=r"directions\[0\] \(up\): bound_from.kind = 'velocity_window' needs flow.inte"
    ):
        Configuration.model_validate(configuration(interval_rate="first_sample"))
