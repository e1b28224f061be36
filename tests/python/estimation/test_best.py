"""The best estimate beside the set: whose it is, in which frame, how far it may be off, what it is compared with."""

import dataclasses
import json
import re
import sys

import numpy as np
import pytest
import tomlkit
from elliptude import cli, estimation
from elliptude.configuration import Configuration
from elliptude.configuration.references import from_enu, up
from elliptude.estimation.best import choice, vqf
from elliptude.io import column_files, tables
from elliptude.io.tables import Result
from elliptude.logs import Log
from elliptude.report.estimated.reading import read_run
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

GRAVITY = 9.80665
# µT, 20 of it horizontal, 10° east of north.
FIELD = np.array([20.0 * np.sin(np.deg2rad(10.0)), 20.0 * np.cos(np.deg2rad(10.0)), -40.0])
# rad; how far the directions may be off, and the rate in rad/s.
BOUND, NOISE = np.deg2rad(3.0), np.deg2rad(0.2)


@pytest.fixture(autouse=True)
def _vqf():
    pytest.importorskip("vqf")


def configured(frame="ENU", *, field=True, estimator=None, **changes):
    directions = [
        {"name": "up", "kind": "accelerometer", "columns": ["a", "b", "c"], "unit": "m/s^2"},
        {
            "name": "field",
            "kind": "magnetometer",
            "columns": ["d", "e", "f"],
            "unit": "uT",
            "reference_ut": from_enu(FIELD, frame).tolist(),
        },
    ][: 2 if field else 1]
    return Configuration.model_validate(
        {
            "reference_frame": frame,
            "flow": {
                "kind": "gyro",
                "columns": ["x", "y", "z"],
                "noise_deg_per_s": float(np.rad2deg(NOISE)),
                "bias_deg_per_s": 0.1,
                "longest_interval_s": 0.05,
            },
            "directions": [one | {"bound_deg": float(np.rad2deg(BOUND))} for one in directions],
            "estimator": {"mode": "guaranteed"} | (estimator or {}),
        }
        | changes
    )


def made(frame="ENU", *, times=None, field=True, seed=0):
    """A body that turns at some 30°/s, with noise within its bounds."""
    draws = np.random.default_rng(seed)
    times = 0.01 * np.arange(800) if times is None else times
    fine = np.linspace(times[0], times[-1], 20 * len(times))
    step = fine[1] - fine[0]

    def rate(t):
        return 0.5 * np.sin(np.outer(t, [0.7, 1.1, 0.3]) + np.array([0.3, 1.0, 2.0]))

    start = Rotation.from_matrix(from_enu(np.eye(3), frame).T) * Rotation.from_euler("ZYX", [1.0, 0.3, -0.4])
    attitudes = [start]
    for turn in Rotation.from_rotvec(step * rate(fine[:-1] + 0.5 * step)):
        attitudes.append(attitudes[-1] * turn)
    true = Rotation.concatenate([attitudes[i] for i in np.searchsorted(fine, times).clip(0, len(fine) - 1)])
    references = np.array([GRAVITY * up(frame), 1e-6 * from_enu(FIELD, frame)])[: 2 if field else 1]
    directions = np.stack([true.inv().apply(vector) for vector in references], axis=1)
    axes = draws.normal(size=directions.shape)
    axes -= directions * (np.sum(axes * directions, axis=2) / np.sum(directions**2, axis=2))[..., None]
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    lengths = np.linalg.norm(directions, axis=2, keepdims=True)
    directions = directions + np.tan(0.9 * BOUND) * draws.uniform(size=lengths.shape) * lengths * axes
    rates = rate(times) + 0.3 * NOISE * draws.uniform(-1.0, 1.0, (len(times), 3))
    return Log(times, directions, np.tile(references, (len(times), 1, 1)), rates=rates, true_attitudes=true.as_matrix())


def errors(quaternions, log, frame="ENU"):
    """Total, tilt, and heading about up of the truth from attitudes, rad; whatever it is where there is none."""
    true = Rotation.from_matrix(log.true_attitudes)
    known = np.isfinite(quaternions[:, :1])
    difference = true * Rotation.from_quat(np.where(known, quaternions, [0.0, 1.0, 0.0, 0.0]), scalar_first=True).inv()
    *v, w = difference.as_quat(canonical=True).T
    about = np.array(v).T @ up(frame)
    return difference.magnitude(), 2.0 * np.arccos(np.minimum(np.hypot(w, about), 1.0)), 2.0 * np.arctan2(about, w)


def assert_holds(found, log, frame="ENU"):
    """The bounds of every row, against the truth."""
    best = found.best
    rows = np.isfinite(best.errors.bounds[:, 0])
    total, tilt, heading = (values[rows] for values in errors(best.quaternions, log, frame))
    # This test's arc cosine has no digits below 1e-7.
    assert (total <= best.errors.bounds[rows, 0] + 1e-7).all()
    assert (tilt <= best.errors.bounds[rows, 1] + 1e-7).all()
    least, most = best.errors.headings[rows].T
    heading -= 2.0 * np.pi * np.round((heading - 0.5 * (least + most)) / (2.0 * np.pi))
    assert (least - 1e-9 <= heading).all()
    assert (heading <= most + 1e-9).all()
    return rows


@pytest.mark.parametrize("frame", ["ENU", "NED", "NWU"])
def test_it_is_vqfs_in_the_frame_of_the_log(frame):
    """North is where the field's reference says that magnetic north is."""
    log = made(frame)
    found = estimation.estimate(log, configured(frame))
    best = found.best
    assert best.is_estimated.all()
    assert best.why_center is None
    assert assert_holds(found, log, frame).all()
    total, _, _ = errors(best.quaternions, log, frame)
    assert np.rad2deg(total[200:]).mean() < 1.0
    center, _, _ = errors(found.result.quaternions, log, frame)
    summary = estimation.summarize(found, configured(frame))
    assert summary["best"]["from"] == "vqf"
    assert summary["best"]["attitude_error_deg"]["mean"] == pytest.approx(np.rad2deg(total).mean(), rel=1e-6)
    assert summary["attitude_error_deg"]["mean"] == pytest.approx(np.rad2deg(center).mean(), rel=1e-6)
    # Each bound is far from saying nothing.
    assert summary["best"]["bound_deg"]["max"] < 25.0
    assert summary["best"]["tilt_bound_deg"]["max"] < summary["best"]["bound_deg"]["max"]


def test_its_heading_counts_as_that_of_the_sets_where_nothing_measures_it():
    log = made(field=False)
    start = {
        "kind": "given",
        "attitude_qw_qx_qy_qz": Rotation.from_matrix(log.true_attitudes[0]).as_quat(scalar_first=True).tolist(),
        "P_diagonal": [0.01, 0.01, 0.01, 1e-6, 1e-6, 1e-6],
    }
    found = estimation.estimate(log, configured(field=False, start=start))
    best = found.best
    assert best.is_estimated.all()
    assert_holds(found, log)
    first, center = (
        Rotation.from_quat(values[0], scalar_first=True) for values in (best.quaternions, found.result.quaternions)
    )
    assert (first * center.inv()).as_quat()[2] == pytest.approx(0.0, abs=1e-9)
    assert np.rad2deg(errors(best.quaternions, log)[0][200:]).mean() < 2.0


def test_gaps_missing_samples_and_uneven_stamps():
    rng = np.random.default_rng(1)
    steps = 0.01 * rng.uniform(0.6, 1.4, 900)
    steps[300], steps[500] = 0.03, 0.5  # two samples are missing, and a gap
    log = made(times=np.cumsum(steps))
    directions, rates = log.directions.copy(), log.rates.copy()
    directions[rng.uniform(size=900) < 0.3, 1] = np.nan
    directions[rng.uniform(size=900) < 0.2, 0] = np.nan
    directions[:7, 1] = np.nan
    log = dataclasses.replace(log, directions=directions, rates=rates)
    found = estimation.estimate(log, configured(estimator={"policy": "drop_measurement"}))
    best = found.best
    # Not before both have been measured; after the gap it begins anew.
    first = np.flatnonzero(np.isfinite(log.directions[:, :, 0]).all(axis=1))
    assert np.argmax(best.is_estimated) == first[0]
    assert best.is_estimated[first[0] : 500].all()
    assert best.is_estimated[first[first >= 500][0] :].all()
    rows = assert_holds(found, log)
    assert np.rad2deg(errors(best.quaternions, log)[0][rows]).mean() < 2.0


def test_a_field_that_may_be_any_does_not_turn_it():
    """A short field in much disturbance: it may point anywhere, and the heading is kept from before."""
    log = made()
    directions = log.directions.copy()
    directions[300:, 1] = [20e-6, 0.0, 0.0]  # 70 µT may be added to the field's 45: any direction is possible
    steel = configured(
        directions=[
            configured().model_dump(exclude_none=True)["directions"][0],
            {
                "name": "field",
                "kind": "magnetometer",
                "columns": ["d", "e", "f"],
                "unit": "uT",
                "reference_ut": FIELD.tolist(),
                "bound_from": {"kind": "field", "disturbance_ut": 70.0},
            },
        ]
    )
    found = estimation.estimate(dataclasses.replace(log, directions=directions), steel)
    best = found.best
    assert best.is_estimated.all()
    assert np.rad2deg(errors(best.quaternions, log)[0][200:]).max() < 5.0


def test_rows_that_say_nothing_new():
    """A body at rest, all rows the same; and a log with one row of each."""
    log = made()
    still = dataclasses.replace(
        log,
        directions=np.tile(log.directions[:1], (800, 1, 1)),
        rates=np.zeros((800, 3)),
        true_attitudes=np.tile(log.true_attitudes[:1], (800, 1, 1)),
    )
    found = estimation.estimate(still, configured())
    assert_holds(found, still)
    assert np.rad2deg(errors(found.best.quaternions, still)[0]).max() < 6.0
    two = dataclasses.replace(
        still.since(798),
        times=np.array([0.0, 0.01]),
    )
    assert estimation.estimate(two, configured()).best.is_estimated.all()


def test_what_leaves_the_set_is_put_back_and_counted(monkeypatch):
    log = made(times=0.01 * np.arange(50))
    plain = estimation.estimate(log, configured())
    away = plain.best.quaternions.copy()
    # Beyond any of these sets.
    turned = Rotation.from_rotvec([0.0, 0.0, 1.0]) * Rotation.from_quat(away[::2], scalar_first=True)
    away[::2] = turned.as_quat(scalar_first=True)
    monkeypatch.setattr(choice, "vqf_attitudes", lambda *_: away)
    found = estimation.estimate(log, configured())
    assert found.best.put_back.tolist() == [True, False] * 25
    assert_holds(found, log)
    forms = found.guaranteed.sets.forms(Rotation.from_quat(found.best.quaternions, scalar_first=True).as_matrix())
    np.testing.assert_allclose(forms[::2], 1.0, atol=1e-6)
    assert (forms <= 1.0).all()
    assert found.result.best_put_back.sum() == 25
    assert estimation.summarize(found, configured())["best"]["put_back"] == 25
    # Proposals do not prove that it is none of the truth.
    kept = estimation.estimate(log, configured(bounds_from_recording="log.npz"))
    assert not kept.best.put_back.any()
    np.testing.assert_allclose(np.abs(np.einsum("ni,ni->n", kept.best.quaternions, away)), 1.0, atol=1e-12)
    # Its bounds are of the same claims as the sets in the table.
    np.testing.assert_array_equal(kept.best.errors.claims, found.best.errors.claims)


@pytest.mark.parametrize("asked", [None, "center"])
def test_without_vqf_it_is_the_center(monkeypatch, asked):
    if asked is None:
        monkeypatch.setitem(sys.modules, "vqf", None)
    log = made(times=0.01 * np.arange(50))
    configuration = configured(estimator={} if asked is None else {"best": asked})
    found = estimation.estimate(log, configuration)
    np.testing.assert_allclose(found.best.quaternions, found.result.quaternions, atol=1e-14)
    assert_holds(found, log)
    assert found.best.why_center == ("vqf is not installed: pip install 'elliptude[best]'" if asked is None else None)
    assert set(found.result.best_from) == {"center"}
    # About the center, the bounds are those of the run, or a little sharper by the set itself.
    headings, expected = found.best.errors.headings, found.result.headings
    assert (headings[:, 0] >= expected[:, 0] - 1e-9).all()
    assert (headings[:, 1] <= expected[:, 1] + 1e-9).all()
    np.testing.assert_allclose(headings, expected, rtol=0.01)
    assert (found.best.errors.bounds[:, 1] <= found.result.tilt_bounds + 1e-9).all()
    np.testing.assert_allclose(found.best.errors.bounds[:, 1], found.result.tilt_bounds, rtol=0.01)
    assert (found.best.errors.bounds[:, 0] <= found.result.largest_angles + 1e-6).all()


def test_asked_for_and_not_there(monkeypatch):
    monkeypatch.setitem(sys.modules, "vqf", None)
    with pytest.raises(ValueError, match=r"estimator.best = 'vqf': vqf is not installed"):
        estimation.estimate(made(times=0.01 * np.arange(50)), configured(estimator={"best": "vqf"}))


def with_a_star():
    fields = configured().model_dump(mode="json", exclude_unset=True)
    fields["directions"][1] = {
        "name": "star",
        "columns": ["d", "e", "f"],
        "reference": FIELD.tolist(),
        "bound_deg": 3.0,
    }
    return Configuration.model_validate(fields)


def test_other_sensors_have_the_kalman_filters_if_they_ask():
    log = made(times=0.01 * np.arange(50))
    configuration = with_a_star()
    found = estimation.estimate(log, configuration)
    assert found.best.estimator == "center"
    assert found.best.why_center == "a Kalman filter's with estimator.best = 'kalman'"
    found = estimation.estimate(log, configuration.with_best("kalman"))
    assert found.best.estimator == "kalman"
    assert found.best.why_center is None
    assert found.best.is_estimated.all()
    assert_holds(found, log)
    assert vqf.why_not_vqf(configuration) == "vqf would leave out 'star'"
    of_a_body = Configuration.model_validate(fields_of_a_rigid_body())
    assert vqf.why_not_vqf(of_a_body) == "vqf needs a gyro and an accelerometer"
    with pytest.raises(ValueError, match=r"estimator\.best = 'vqf': vqf would leave out 'star'"):
        estimation.estimate(log, configuration.with_best("vqf"))


def test_the_kalman_filter_may_be_asked_for_in_vqfs_place():
    log = made()
    found = estimation.estimate(log, configured(estimator={"best": "kalman"}))
    assert found.best.estimator == "kalman"
    assert_holds(found, log)
    kalman, center = (np.rad2deg(errors(q, log)[0]).mean() for q in (found.best.quaternions, found.result.quaternions))
    assert kalman < 0.7 * center
    assert set(found.result.best_from) == {"kalman"}


def test_means_over_windows_are_not_for_the_kalman_filter():
    fields = with_a_star().model_dump(mode="json", exclude_unset=True)
    del fields["directions"][0]["bound_deg"]
    fields["directions"][0]["bound_from"] = {
        "kind": "velocity_window",
        "windows_s": [0.1],
        "acceleration_m_per_s2": 0.5,
    }
    configuration = Configuration.model_validate(fields)
    why = "'up' is a mean over windows, and the Kalman filter takes its errors for independent"
    found = estimation.estimate(made(times=0.01 * np.arange(50)), configuration)
    assert found.best.estimator == "center"
    assert found.best.why_center == why
    assert f"the center of the set ({why})" in estimation.summarize(found, configuration)["best"]["in_words"]
    with pytest.raises(ValueError, match=re.escape(f"estimator.best = 'kalman': {why}")):
        estimation.estimate(made(times=0.01 * np.arange(50)), configuration.with_best("kalman"))


def fields_of_a_rigid_body():
    fields = configured().model_dump(mode="json", exclude_unset=True)
    fields["flow"] = {"kind": "rigid_body", "step_s": 0.01, "inertia_kg_m2": [[1, 0, 0], [0, 2, 0], [0, 0, 2.5]]}
    return fields


def test_none_at_all():
    log = made(times=0.01 * np.arange(50))
    configuration = configured(estimator={"best": "none"})
    found = estimation.estimate(log, configuration)
    assert found.best is None
    assert found.result.best_quaternions is None
    assert estimation.summarize(found, configuration)["best"] is None


def test_other_modes_have_none():
    with pytest.raises(ValueError, match="best needs mode = 'guaranteed'"):
        configured(estimator={"mode": "first_order", "best": "vqf"}, start={"kind": "first_measurement"})


# --- the command ------------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


@pytest.fixture
def files(tmp_path):
    log = made(times=0.01 * np.arange(100))
    columns = {"t": log.times} | {
        name: values
        for names, array in (("xyz", log.rates), ("abc", log.directions[:, 0]), ("def", 1e6 * log.directions[:, 1]))
        for name, values in zip(names, array.T, strict=True)
    }
    quaternions = Rotation.from_matrix(log.true_attitudes).as_quat(scalar_first=True)
    columns |= dict(zip(tables.QUATERNION, quaternions.T, strict=True))
    np.savez(tmp_path / "log.npz", **columns)
    fields = configured().model_dump(mode="json", exclude_unset=True)
    fields |= {"time_column": "t", "truth": {"attitude_columns": list(tables.QUATERNION), "label": "the truth"}}
    (tmp_path / "config.toml").write_text(tomlkit.dumps(fields))
    return tmp_path


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_command(files, suffix):
    out = files / "out"
    done = run("estimate", files / "log.npz", "--config", files / "config.toml", "--out", out, "--format", suffix)
    assert done.exit_code == 0, done.output
    assert "best estimate, vqf: within " in done.output
    summary = json.loads((out / "summary.json").read_text())
    assert summary["best"]["rows"] == {"vqf": 100, "center": 0}
    words = summary["best"]["in_words"]
    assert f"; mean error {summary['best']['attitude_error_deg']['mean']:.3g} degrees" in words
    assert f"  best estimate, {words}\n" in done.output
    assert read_run(out)[0].best == words
    table = Result.read(out / f"results.{suffix}")
    assert table.best_quaternions.shape == (100, 4)
    np.testing.assert_allclose(np.linalg.norm(table.best_quaternions, axis=1), 1.0)
    assert (table.best_headings[:, 0] <= table.best_headings[:, 1]).all()
    assert (table.best_tilt_bounds <= table.best_bounds + 1e-9).all()
    assert set(table.best_from) == {"vqf"}
    assert set(table.best_tilt_claims) == {"unconditional"}
    assert not table.best_put_back.any()
    # What monitor says of the same attitudes, from the table, is the same.
    estimate = files / "best.csv"
    header = "time_s,qw,qx,qy,qz"
    rows = np.column_stack([table.times, table.best_quaternions])
    np.savetxt(estimate, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    judged = files / "judged"
    assert run("monitor", out, "--estimate", estimate, "--out", judged).exit_code == 0
    monitored = column_files.read_columns(
        judged / "monitor.csv", numbers=("total_bound", "tilt_bound", "heading_bound")
    )
    np.testing.assert_allclose(monitored["total_bound"], table.best_bounds, atol=1e-9)
    np.testing.assert_allclose(monitored["tilt_bound"], table.best_tilt_bounds, atol=1e-9)
    np.testing.assert_allclose(monitored["heading_bound"], np.abs(table.best_headings).max(axis=1), atol=1e-9)


def test_options_of_the_command(files, monkeypatch):
    inputs = ("estimate", files / "log.npz", "--config", files / "config.toml")
    done = run(*inputs, "--out", files / "center", "--best", "center")
    assert "best estimate, the center of the set; mean error " in done.output
    assert done.exit_code == 0
    done = run(*inputs, "--out", files / "none", "--best", "none")
    assert "best estimate" not in done.output
    assert not any(
        name.startswith("best") for name in column_files.column_names(files / "none" / "results.csv", "results")
    )
    monkeypatch.setitem(sys.modules, "vqf", None)
    done = run(*inputs, "--out", files / "missing")
    assert "the center of the set (vqf is not installed: pip install 'elliptude[best]'); mean error" in done.output
    done = run(*inputs, "--out", files / "refused", "--best", "vqf")
    assert done.exit_code == 1
    assert "estimator.best = 'vqf': vqf is not installed" in done.output.replace("\n", " ")
    assert not (files / "refused").exists()
