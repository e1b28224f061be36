"""Simulated truth against conserved quantities and another integrator; errors against their bounds."""

import itertools

import numpy as np
import pytest
from elliptude.simulation import scenarios
from elliptude.simulation import simulated as simulation
from reference import integrator, rigid_body
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module", params=["free", "orbit", "pendulum"])
def scenario(request):
    return scenarios.load(request.param)


@pytest.fixture(scope="module")
def truth(scenario):
    return simulation.truth(scenario)


def reference_body(scenario):
    """The same body in the NumPy reference, which shares no code with the simulation."""
    inertia = scenario.inertia_matrix
    match scenario.potential:
        case scenarios.Free():
            potential = rigid_body.Free()
        case scenarios.UniformGravity(mass=mass, gravity=gravity, center_of_mass=center):
            potential = rigid_body.UniformGravity(mass, gravity, np.array(center))
        case scenarios.GravityGradient(orbit_rate=rate):
            potential = rigid_body.GravityGradient(inertia, rate)
    return rigid_body.RigidBody(inertia, potential)


def test_truth_starts_where_the_scenario_says(scenario, truth):
    np.testing.assert_allclose(truth.times, scenario.interval * np.arange(scenario.measurements + 1), rtol=1e-15)
    np.testing.assert_allclose(truth.attitudes[0], scenario.attitude0.matrix(), atol=1e-15)
    np.testing.assert_array_equal(truth.angular_velocities[0], scenario.rate0)
    identities = np.broadcast_to(np.eye(3), truth.attitudes.shape)
    np.testing.assert_allclose(truth.attitudes @ truth.attitudes.transpose(0, 2, 1), identities, atol=2e-15)
    assert np.all(np.linalg.det(truth.attitudes) > 0)


def test_truth_conserves_what_the_motion_conserves(scenario, truth):
    body = reference_body(scenario)
    states = [
        rigid_body.State(*state) for state in zip(truth.attitudes, truth.angular_velocities, truth.times, strict=True)
    ]
    energy = np.array([rigid_body.total_energy(body, state) for state in states])
    momentum = np.array([rigid_body.spatial_angular_momentum(body.inertia, state) for state in states])
    match scenario.potential:
        case scenarios.Free():
            conserved = np.column_stack([energy, momentum])
        case scenarios.UniformGravity():
            conserved = np.column_stack([energy, momentum[:, 2]])
        case scenarios.GravityGradient(orbit_rate=rate):  # the Jacobi integral
            conserved = (energy - rate * momentum[:, 2])[:, None]
    np.testing.assert_allclose(conserved, conserved[:1] + 0 * conserved, atol=1e-10)


def test_truth_is_that_of_another_integrator(scenario, truth):
    body = reference_body(scenario)
    state = rigid_body.State(scenario.attitude0.matrix(), np.array(scenario.rate0), 0.0)
    # Beyond 2 s the pendulum's and the free body's instability is what one would see.
    for i in range(1, 1 + int(min(2.0, 3 * scenario.interval) / scenario.interval)):
        state = integrator.integrate(body, state, scenario.interval / 20, 20, order=8)
        np.testing.assert_allclose(truth.attitudes[i], state.attitude, atol=1e-10)
        np.testing.assert_allclose(truth.angular_velocities[i], state.angular_velocity, atol=1e-9)


def errors(simulated):
    """True and measured directions where there are any, and v."""
    log = simulated.measurements
    measured = ~np.isnan(log.angular_velocities[:, 0])
    true = np.einsum("nji,nmj->nmi", log.true_attitudes, log.references)[measured]
    return true, log.directions[measured], (log.true_angular_velocities - log.angular_velocities)[measured]


@pytest.mark.parametrize(("noise", "degrees"), list(itertools.product(simulation.NOISES, [7.0, 0.1])))
def test_errors_keep_their_bounds(scenario, truth, noise, degrees):
    bound = np.deg2rad(degrees)
    beyond = 1 + 1e-12 + 4e-16 / bound
    for seed in range(10):
        simulated = simulation.measure(scenario, truth, seed=seed, directions="three", bound_deg=degrees, noise=noise)
        assert simulated.direction_bound == simulated.rate_bound == bound
        true, directions, rate_errors = errors(simulated)
        assert len(true) == scenario.measurements
        np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, atol=1e-15)
        angles = np.arctan2(np.linalg.norm(np.cross(directions, true), axis=-1), np.sum(directions * true, axis=-1))
        lengths = np.linalg.norm(rate_errors, axis=-1)
        assert angles.max() <= bound * beyond
        assert lengths.max() <= bound * beyond
        if noise == "perpendicular":
            np.testing.assert_allclose(angles, bound, rtol=1e-12 + 4e-16 / bound)
        if noise != "inside":
            np.testing.assert_allclose(lengths, bound, rtol=1e-12 + 4e-16 / bound)


def test_common_error_turns_all_directions_alike(scenario, truth):
    simulated = simulation.measure(scenario, truth, directions="three", bound_deg=7.0, noise="common")
    true, directions, _ = errors(simulated)
    turns = [Rotation.align_vectors(b, measured) for b, measured in zip(true, directions, strict=True)]
    np.testing.assert_allclose([turn.magnitude() for turn, _ in turns], np.deg2rad(7.0), rtol=1e-9)
    assert max(residual for _, residual in turns) < 1e-7


def test_inside_is_uniform():
    draws = np.random.default_rng(0)
    points = simulation.in_ball(draws, (20000,))
    radii = np.linalg.norm(points, axis=-1)
    assert radii.max() <= 1
    # A uniform ball: r³ is uniform, the mean is 0 and each coordinate has variance 1/5; five standard deviations.
    np.testing.assert_allclose(np.mean(radii**3), 1 / 2, atol=5 * np.sqrt(1 / 12 / 20000))
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=5 * np.sqrt(1 / 5 / 20000))
    np.testing.assert_allclose((points**2).mean(axis=0), 1 / 5, rtol=0.05)


def test_perpendicular_azimuth_is_uniform():
    toward = np.broadcast_to([0.0, 0.6, 0.8], (20000, 1, 3))
    nu, _ = simulation._unit_errors("perpendicular", toward, np.random.default_rng(0), np.random.default_rng(1))
    np.testing.assert_allclose(np.sum(nu * toward, axis=-1), 0, atol=1e-15)
    azimuth = np.arctan2(nu[:, 0] @ [0.0, 0.8, -0.6], nu[:, 0, 0])
    for multiple in (1, 2, 3):
        assert abs(np.mean(np.exp(1j * multiple * azimuth))) < 5 / np.sqrt(20000)


def test_draws_are_a_function_of_scenario_and_seed(scenario, truth):
    def draw(**options):
        return simulation.measure(scenario, truth, **options).measurements

    first, again, other = draw(seed=3), draw(seed=3), draw(seed=4)
    np.testing.assert_array_equal(first.directions, again.directions)
    np.testing.assert_array_equal(first.angular_velocities, again.angular_velocities)
    assert np.nanmin(np.abs(first.directions - other.directions)) > 0
    more = draw(seed=3, directions="three")
    np.testing.assert_array_equal(first.angular_velocities, more.angular_velocities)
    renamed = simulation.measure(scenario.model_copy(update={"name": "other"}), truth, seed=3).measurements
    assert np.nanmin(np.abs(first.directions - renamed.directions)) > 0
    small = draw(seed=3, bound_deg=0.7)
    np.testing.assert_allclose(
        10 * (small.angular_velocities - small.true_angular_velocities),
        first.angular_velocities - first.true_angular_velocities,
        atol=1e-13,
    )


def test_draws_stay_the_same():
    """The figures that are quoted stand on them."""
    simulated = simulation.simulate(scenarios.load("orbit"), seed=1, directions="three", bound_deg=7.0).measurements
    np.testing.assert_allclose(
        simulated.directions[1, 0], [0.8361886279968936, 0.5325622951449297, -0.13101900701286565], rtol=1e-9
    )
    np.testing.assert_allclose(
        simulated.angular_velocities[1], [2.1400236142495186, 0.16189288155137238, -1.0949157989594538], rtol=1e-9
    )


def test_log_begins_where_an_estimator_does():
    orbit = simulation.simulate(scenarios.load("orbit")).measurements
    assert orbit.times[0] == 0.0
    assert np.isnan(orbit.directions[0]).all()
    assert np.isnan(orbit.angular_velocities[0]).all()
    assert np.isfinite(orbit.directions[1:]).all()
    assert orbit.references.shape == (21, 2, 3)
    pendulum = simulation.simulate(scenarios.load("pendulum")).measurements
    assert pendulum.times[0] == pytest.approx(0.1)
    assert np.isfinite(pendulum.directions).all()
    assert len(pendulum.times) == 60


def test_wrong_choice_is_refused(scenario, truth):
    with pytest.raises(ValueError, match=r"directions: scenario .* has two, three.*, not 'four'"):
        simulation.measure(scenario, truth, directions="four")
    for degrees in (0.0, -1.0, 91.0, float("nan")):
        with pytest.raises(ValueError, match=r"bound_deg: .* is not above 0 and at most 90"):
            simulation.measure(scenario, truth, bound_deg=degrees)
    with pytest.raises(ValueError, match="non-negative"):
        simulation.measure(scenario, truth, seed=-1)


@pytest.mark.parametrize("changes", [{"rate0": (1e308, 0.0, 1e308)}, {"rate0": (1e200, 1e200, 0.0)}])
def test_a_motion_beyond_all_numbers_ends(changes):
    with pytest.raises(ArithmeticError, match="scenario orbit: the truth could not be integrated from 0 s"):
        simulation.truth(scenarios.load("orbit").model_copy(update=changes))
