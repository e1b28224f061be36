"""A star tracker alone on a rigid body: why there is no set, and what has to be stated so that there is one."""

import json

import elliptude as el
import numpy as np
import pytest
import tomlkit
from elliptude import cli
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

STARS = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
RATE = 0.02  # rad/s, about a principal axis: the motion is known
TIMES = np.arange(0.0, 20.0, 0.5)
ATTITUDES = Rotation.from_rotvec(np.outer(TIMES, [0.0, 0.0, RATE]))


def star_tracker(tmp_path, bound_deg=0.05, policy="raise", stars=STARS, **flow):
    seen = np.stack([ATTITUDES.inv().apply(star) for star in stars], axis=1)
    log, config = tmp_path / "log.npz", tmp_path / "config.toml"
    np.savez(log, t=TIMES, stars=seen[:, 0], others=seen[:, 1], q=ATTITUDES.as_quat(scalar_first=True))
    directions = [
        {
            "name": name,
            "columns": [f"{name}[{i}]" for i in range(3)],
            "reference": star.tolist(),
            "bound_deg": bound_deg,
        }
        for name, star in zip(("stars", "others"), STARS, strict=True)
    ]
    config.write_text(
        tomlkit.dumps(
            {
                "time_column": "t",
                "flow": {"kind": "rigid_body", "inertia_kg_m2": [1.0, 2.0, 2.5], "step_s": 0.1} | flow,
                "directions": directions,
                "estimator": {"mode": "guaranteed", "policy": policy},
                "truth": {"attitude_columns": [f"q[{i}]" for i in range(4)], "order": "wxyz"},
            }
        ),
        encoding="utf-8",
    )
    arguments = ["estimate", str(log), "--config", str(config), "--out", str(tmp_path / "out")]
    told = CliRunner().invoke(cli.make_app(), [*arguments, "--json"])
    return told, CliRunner().invoke(cli.make_app(), [*arguments, "--force"])


def test_estimate_says_why_a_star_tracker_alone_has_no_set(tmp_path):
    done, in_words = star_tracker(tmp_path)
    assert done.exit_code == in_words.exit_code == 1, done.output
    (why,) = json.loads(done.stdout)["why_no_set"]
    assert "nothing bounds the angular velocity before the first set" in why
    assert "flow.largest_rate_deg_per_s" in why
    first = " ".join(in_words.output.split())
    assert f"{tmp_path / 'log.npz'}: no row has a set: the set holds the attitude and the angular velo" in first
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "dropped.csv",
        "estimate.png",
        "measured.csv",
        "results.csv",
        "summary.json",
    ]


def test_with_the_largest_rate_it_has_sets_that_hold_the_truth(tmp_path):
    done, _ = star_tracker(tmp_path, largest_rate_deg_per_s=3.0)
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary["why_no_set"] == []
    assert summary["claim_share_of_rows"]["unconditional"] == 1.0
    assert summary["inside_share_of_rows"] == 1.0


def body_filter(**settings):
    return el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(el.RigidBody(np.diag([1, 2, 2.5])), step=0.1), **settings)


def test_a_filter_says_why_it_has_no_set():
    alone = body_filter()
    update = alone.update(STARS, STARS, np.deg2rad([0.1, 0.1]))
    assert update.claim == alone.claim == "none"
    assert "nothing bounds the angular velocity" in alone.why_no_set
    assert "vector_bound" in alone.why_no_set
    alone.update(angular_velocity=[0, 0, RATE], rate_bound=0.01)
    assert "two directions" in alone.why_no_set
    alone.update(STARS, STARS, np.deg2rad([0.1, 0.1]))
    assert alone.claim == "unconditional"
    assert alone.why_no_set is None
    alone.forget()
    assert "nothing bounds" in alone.why_no_set

    bounded = body_filter(vector_bound=0.05)
    assert "two directions" in bounded.why_no_set
    bounded.update(STARS, STARS, np.deg2rad([0.1, 0.1]))
    assert bounded.why_no_set is None


@pytest.mark.parametrize("bound", [None, 0.01])
def test_a_gyro_filter_names_its_bias(bound):
    gyro = el.GuaranteedFilter(el.GuaranteedGyroFlow(0.01), vector_bound=bound)
    assert ("nothing bounds the gyro's bias" in gyro.why_no_set) == (bound is None)


def test_uneven_stamps_leave_windows_of_little_worth():
    rng = np.random.default_rng(1)
    times = 0.01 * np.arange(1500) + rng.uniform(-0.004, 0.004, 1500)
    rates = np.outer(np.sin(np.clip(times - 3.0, 0.0, None)), [0.5, 0.2, 0.1])
    attitudes = [np.eye(3)]
    for step, rate in zip(np.diff(times), 0.5 * (rates[1:] + rates[:-1]), strict=True):
        attitudes.append(attitudes[-1] @ el.exp(step * rate))
    forces = np.einsum("nji,j->ni", attitudes, [0.0, 0.0, 9.81])
    fields = np.einsum("nji,j->ni", attitudes, [0.0, 20.0, -40.0])
    found = el.ahrs(times, rates, forces, fields, mag_unit="uT", statements="recording")
    assert set(found.claims) == {"none"}
    assert "'up' is measured at no row" not in found.notes
    (why,) = [note for note in found.notes if note.startswith("the gyro has 86 gaps, intervals longer than 0.015")]
    assert "otherwise than it shows" in why
    assert "longest_interval_s" in why


def test_estimate_says_that_two_directions_are_too_wide_together(tmp_path):
    done, _ = star_tracker(tmp_path, bound_deg=120.0, largest_rate_deg_per_s=2.0)
    assert done.exit_code == 1, done.output
    (why,) = json.loads(done.stdout)["why_no_set"]
    assert why.startswith("'stars' is known within 120 deg and 'others' within 120 deg, 90 deg from one another")


def test_estimate_says_that_two_directions_contradict_one_another_at_every_row(tmp_path):
    stars = np.array([STARS[0], [0.6, 0.0, 0.8]])
    done, _ = star_tracker(tmp_path, stars=stars, policy="drop_measurement", largest_rate_deg_per_s=2.0)
    assert done.exit_code == 1, done.output
    summary = json.loads(done.stdout)
    assert summary["dropped_by_sensor"] == {"stars": len(TIMES), "others": len(TIMES)}
    (why,) = summary["why_no_set"]
    assert why.startswith("in each row with two directions they contradict one another or the prediction")
