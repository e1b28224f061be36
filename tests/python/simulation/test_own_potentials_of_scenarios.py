"""Linear and quadratic potentials in scenarios and configurations, beside the built-in ones that are the same."""

import elliptude as el
import numpy as np
import pytest
from elliptude import cli, simulation
from elliptude.configuration import potentials as configured
from elliptude.simulation import potentials, scenarios
from inputs import rotation
from pydantic import TypeAdapter, ValidationError
from typer.testing import CliRunner

BODY = el.RigidBody([0.13, 0.28, 0.17])
OWN = {
    "pendulum": potentials.LinearPotential(kind="linear", moment=(0.0, 0.0, 9.81 * 0.3), direction=(0.0, 0.0, 2.0)),
    "orbit": None,  # made of the scenario's inertia and rate
}


def own_scenario(name):
    scenario = scenarios.load(name)
    potential = OWN[name]
    if potential is None:
        rate = scenario.potential.orbit_rate
        matrix = 3.0 * rate**2 * scenario.inertia_matrix
        potential = potentials.QuadraticPotential(
            kind="quadratic",
            matrix=tuple(map(tuple, matrix.tolist())),
            direction=(1.0, 0.0, 0.0),
            turn=(0.0, 0.0, rate),
        )
    return scenario, scenario.model_copy(update={"potential": potential, "measurements": 3})


@pytest.mark.parametrize("name", ["pendulum", "orbit"])
def test_the_truth_is_that_of_the_built_in_potential(name):
    scenario, own = own_scenario(name)
    expected = simulation.truth(scenario.model_copy(update={"measurements": 3}))
    found = simulation.truth(own)
    np.testing.assert_allclose(found.attitudes, expected.attitudes, atol=1e-11)
    rng = np.random.default_rng(2)
    torque = own.potential.torque(own.inertia_matrix)
    built = own.potential.configured().build(BODY)
    for time in (0.0, 3.0):
        attitude = rotation(rng)
        np.testing.assert_allclose(torque(time, attitude), built.torque(attitude, time), atol=1e-12)
    with pytest.raises(ValueError, match="no truth of it"):
        own.potential.weighted_center()


def test_a_sum_in_a_configuration():
    table = {
        "kind": "sum",
        "potentials": [
            {"kind": "uniform_gravity", "mass_kg": 1.0, "gravity_m_per_s2": 9.8, "center_of_mass_m": [0, 0, 0.1]},
            {"kind": "linear", "moment_n_m": [1e-5, 0, 0], "direction": [0, 1, 0], "turn_rad_per_s": [0, 0, 1e-3]},
        ],
    }
    built = TypeAdapter(configured.Potential).validate_python(table, strict=False).build(BODY)
    assert isinstance(built, el.SumPotential)
    attitude = rotation(np.random.default_rng(0))
    expected = el.UniformGravity(1.0, 9.8, [0, 0, 0.1]).torque(attitude) + el.LinearPotential(
        [1e-5, 0, 0], [0, 1, 0], [0, 0, 1e-3]
    ).torque(attitude, 7.0)
    np.testing.assert_allclose(built.torque(attitude, 7.0), expected, atol=1e-15)


@pytest.mark.parametrize("module", [potentials, configured])
def test_what_cannot_be_is_named(module):
    names = ("moment", "turn", "matrix") if module is potentials else ("moment_n_m", "turn_rad_per_s", "matrix_n_m")
    linear = {"kind": "linear", names[0]: [1.0, 0.0, 0.0], "direction": [1.0, 0.0, 0.0]}
    adapter = TypeAdapter(module.Potential)
    with pytest.raises(ValidationError, match="at right angles"):
        adapter.validate_python(linear | {names[1]: [1.0, 0.0, 0.0]})
    with pytest.raises(ValidationError, match="direction"):
        adapter.validate_python(linear | {"direction": [0.0, 0.0, 0.0]})
    lopsided = [[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    with pytest.raises(ValidationError, match=r"symmetric|matrix"):
        adapter.validate_python({"kind": "quadratic", names[2]: lopsided, "direction": [1.0, 0.0, 0.0]})


def test_simulate_and_estimate_a_dipole(tmp_path):
    file = tmp_path / "dipole.toml"
    file.write_text(
        """
inertia = [2.0, 3.0, 2.5]
potential = { kind = "linear", moment = [0.0, 0.5, 0.1], direction = [0, 0, 3], turn = [0.2, 0, 0] }
attitude0 = { rotation_vector_deg = [0, 0, 90] }
rate0 = [0.1, 0, 0]
step = 0.05
steps_between_measurements = 10
measurements = 6
directions = { pair = [[2, 0, 0], [0, 3, 4]] }
bound_deg = [2]
estimate0 = { attitude = "first measurement" }
""",
        encoding="utf-8",
    )
    run = CliRunner()
    made = run.invoke(cli.make_app(), ["simulate", str(file), "--out", str(tmp_path / "made")])
    assert made.exit_code == 0, made.output
    config = next((tmp_path / "made").rglob("*.toml"))
    text = config.read_text(encoding="utf-8")
    assert 'kind = "linear"' in text
    text = text.replace('[start]\nkind = "first_measurement"\n', "") + '\n[estimator]\nmode = "guaranteed"\n'
    config.write_text(text, encoding="utf-8")
    log = next(iter((tmp_path / "made").rglob("*.csv")))
    done = run.invoke(
        cli.make_app(), ["estimate", str(log), "--config", str(config), "--out", str(tmp_path / "out"), "--json"]
    )
    assert done.exit_code == 0, done.output
    assert '"inside_share_of_rows": 1.0' in done.stdout
