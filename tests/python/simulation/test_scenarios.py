"""Scenarios: the built-in ones, one's own, and what is said of a wrong one."""

import numpy as np
import pytest
from elliptude.io.files import FileError
from elliptude.simulation import potentials, scenarios

OWN = """
inertia = [[2.0, 0.1, 0.0], [0.1, 3.0, 0.0], [0.0, 0.0, 2.5]]
potential = { kind = "free" }
attitude0 = { rotation_vector_deg = [0, 0, 90] }
rate0 = [0.1, 0, 0]
step = 0.1
steps_between_measurements = 10
measurements = 5
directions = { pair = [[2, 0, 0], [0, 3, 4]] }
bound_deg = [2]
estimate0 = { attitude = "first measurement" }
"""


def test_built_in_scenarios():
    assert scenarios.names() == ("free", "orbit", "pendulum")
    for name in scenarios.names():
        scenario = scenarios.load(name)
        assert scenario.name == name
        assert scenario.description
        assert scenario.bound_deg == (7.0, 1.0, 0.1)
        assert list(scenario.directions)[:2] == ["two", "three"]
        assert scenario.directions["three"] == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
        assert scenario.directions["two"] == scenario.directions["three"][:2]


def test_orbit_is_the_one_that_figures_are_quoted_for():
    orbit = scenarios.load("orbit")
    np.testing.assert_array_equal(orbit.inertia_matrix, np.diag([1.0, 2.8, 2.0]))
    assert isinstance(orbit.potential, potentials.GravityGradient)
    assert orbit.potential.orbit_rate == 1.0
    assert orbit.rate0 == (2.316, 0.446, -0.591)
    assert orbit.step == 2 * np.pi / 300
    assert orbit.interval * orbit.measurements == pytest.approx(4 * np.pi, rel=1e-15)
    cosine, sine = np.cos(np.deg2rad(105)), np.sin(np.deg2rad(105))
    about_x = [[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]]
    np.testing.assert_allclose(orbit.attitude0.matrix(), about_x, atol=1e-15)
    assert orbit.estimate0.attitude != "first measurement"
    np.testing.assert_array_equal(orbit.estimate0.attitude.matrix(), np.eye(3))
    assert orbit.estimate0.rate == (2.116, 0.5466, -0.8915)
    widths = np.repeat([2 * (np.pi / 2) ** 2, 2 * (np.pi / 6) ** 2], 3)
    np.testing.assert_allclose(orbit.estimate0.P_diagonal, widths, atol=1e-6)
    five = np.random.default_rng(9).standard_normal((3, 5))
    np.testing.assert_allclose(np.transpose(orbit.directions["five"]), five / np.linalg.norm(five, axis=0), atol=2e-16)


def test_pendulum_is_the_one_that_figures_are_quoted_for():
    pendulum = scenarios.load("pendulum")
    np.testing.assert_array_equal(pendulum.inertia_matrix, np.diag([0.13, 0.28, 0.17]))
    assert pendulum.potential == potentials.UniformGravity(
        kind="uniform_gravity", mass=1.0, gravity=9.81, center_of_mass=(0.0, 0.0, 0.3)
    )
    assert pendulum.attitude0.rotation_vector_deg == (120.0, 0.0, 0.0)
    assert pendulum.rate0 == (0.5, -0.5, 0.4)
    assert (pendulum.step, pendulum.steps_between_measurements, pendulum.measurements) == (0.005, 20, 60)
    assert pendulum.estimate0.attitude == "first measurement"


def test_own_scenario(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(OWN)
    for mine in (scenarios.load(file), scenarios.load(str(file))):
        assert mine.name == "mine"
        assert mine.inertia_matrix[0, 1] == 0.1
        np.testing.assert_allclose(mine.directions["pair"], [[1, 0, 0], [0, 0.6, 0.8]], rtol=1e-15)
    file.write_text('name = "ours"\n' + OWN)
    assert scenarios.load(file).name == "ours"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("step = 0.1", "", "step: missing"),
        ("step = 0.1", "stepp = 0.1", "stepp: no such key, did you mean 'step'"),
        ("step = 0.1", "step = -0.1", "step: must be more than 0"),
        ("step = 0.1", "step = nan", "step: must be finite"),
        ("step = 0.1", 'step = "0.1"', "step: must be a number"),
        ("step = 0.1", "step = true", "step: must be a number"),
        ("measurements = 5", "measurements = 5.5", "measurements: must be a whole number"),
        ("[0.1, 0, 0]", '[0.1, "fast", 0]', "rate0[1]: must be a number"),
        ("[0.1, 0, 0]", "[0.1, 0]", "rate0[2]: missing"),
        ('"free"', '"gravity_gradient"', "potential.orbit_rate: missing"),
        ('"free"', '"gravity_gradient", orbit_rate = -1', "potential.orbit_rate: must be more than 0"),
        ('"free"', '"magnetic"', "potential: kind must be 'free' or "),
        ("rotation_vector_deg", "euler_deg", "attitude0.rotation_vector_deg: missing"),
        ("[2, 0, 0]", "[0, 0, 0]", "directions.pair[0]: a direction must have a length"),
        ("[2, 0, 0], [0, 3, 4]", "", "directions.pair: must have at least 1 value"),
        ("bound_deg = [2]", "bound_deg = [100]", "bound_deg[0]: must be at most 90"),
        ('"first measurement"', '"identity"', "estimate0: an attitude needs rate and P_diagonal"),
        ('"first measurement"', '"guess"', "estimate0.attitude: must be 'first measurement'"),
        ("[0.1, 3.0, 0.0]", "[0.2, 3.0, 0.0]", "inertia: an inertia matrix is symmetric"),
        ("0.0, 2.5]", "0.0, 5.5]", "inertia: no body has these moments"),
        ("step = 0.1", "step = ", "line 6, column 8: not TOML: no value: numbers have a decimal point"),
    ],
)
def test_wrong_file_is_refused_by_name_and_key(tmp_path, old, new, message):
    file = tmp_path / "mine.toml"
    assert old in OWN
    file.write_text(OWN.replace(old, new, 1))
    with pytest.raises(FileError) as caught:
        scenarios.load(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_fault_is_named(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(OWN.replace("step = 0.1", "step = 0").replace("measurements = 5", "measurements = 0"))
    with pytest.raises(FileError, match=r"step: .*; measurements: "):
        scenarios.load(file)


def test_no_such_scenario(tmp_path):
    with pytest.raises(FileError, match="no scenario 'moon': there are free, orbit, pendulum"):
        scenarios.load("moon")
    with pytest.raises(FileError, match=r"none\.toml: no such file"):
        scenarios.load(tmp_path / "none.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileError, match="not UTF-8 text"):
        scenarios.load(binary)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", ["1e-300", "1e300"])
def test_a_direction_of_any_length(tmp_path, size):
    path = tmp_path / "own.toml"
    path.write_text(OWN.replace("[2, 0, 0]", f"[{size}, {size}, 0]"))
    np.testing.assert_allclose(scenarios.load(path).directions["pair"][0], [0.5**0.5, 0.5**0.5, 0.0], rtol=1e-15)


@pytest.mark.parametrize("key", ["measurements = 5", "steps_between_measurements = 10"])
def test_too_many(tmp_path, key):
    path = tmp_path / "own.toml"
    path.write_text(OWN.replace(key, f"{key.split()[0]} = 1000000000000"))
    with pytest.raises(FileError, match="at most 1000000, not 1000000000000"):
        scenarios.load(path)
