"""The Kalman filter that the estimators are compared with must be a good one: consistent where its assumptions hold."""

import dataclasses
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from elliptude.validation import adversary, filter_runs, plants
from elliptude.validation.adversary import Case

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def comparison():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        spec = importlib.util.spec_from_file_location("compare_estimators", FOLDER / "compare_estimators.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        yield module


@pytest.mark.parametrize(("scenario", "directions"), [("orbit", "two"), ("pendulum", "three"), ("gyro", "three")])
def test_mekf_is_consistent_under_the_noise_that_it_is_told(comparison, scenario, directions):
    """Its form has the mean and the quantiles of χ² with six degrees of freedom."""
    # Small, as the motion stretches sets until what is linear is no longer so.
    case = Case(scenario, directions, 0.05, "inside")
    of, draws = plants.plant(case), np.random.default_rng(3)
    count, updates = 400, 20
    starts = adversary.draw_starts(of, count, draws)
    drawn = adversary.draw_errors(of, "inside", starts, updates, draws)
    normal = {
        field.name: draws.standard_normal(getattr(drawn, field.name).shape) / comparison.DEVIATIONS
        for field in dataclasses.fields(drawn)
    }
    if of.has_gyro:
        # What the filter takes for noise of the gyro is the noise alone, if the rate is steady and the bias too.
        normal["inputs"] = np.zeros_like(normal["inputs"])
        of = dataclasses.replace(of, angular_acceleration=0.0)
    errors = adversary.Errors(**normal)
    motion = of.motion(starts, errors)
    runs = comparison.kalman(of, starts, adversary.measure(of, motion, errors))
    values = filter_runs.forms("first_order", runs, motion)
    np.testing.assert_allclose(values[:, [0, 5, -1]].mean(axis=0), 6.0, atol=5 * np.sqrt(12 / count))
    outside = np.mean(values > comparison.REGIONS["MEKF 3σ"])
    np.testing.assert_allclose(outside, 0.1736, atol=0.04)
    assert np.mean(values > comparison.REGIONS["MEKF 99.73 %"]) < 0.008
    assert comparison.REGIONS["MEKF 99.73 %"] == pytest.approx(20.06, abs=0.01)


def test_table_and_picture(comparison, monkeypatch, tmp_path, capsys):
    picture = tmp_path / "picture.png"
    monkeypatch.setattr(sys, "argv", ["compare", "--trials", "3", "--picture", str(picture)])
    comparison.main()
    lines = capsys.readouterr().out.splitlines()
    names = ["paper", "first_order", "MEKF"]
    assert len(lines) >= 2 + 64 * 4
    assert all(sum(name in line for line in lines) >= 64 for name in names)
    assert picture.read_bytes().startswith(b"\x89PNG")
