"""The guaranteed filter: truths of continuous motions are in its sets, and what a user meets around it."""

import json
import pickle
import threading

import elliptude as el
import numpy as np
import pytest
from elliptude.simulation import potentials, scenarios
from elliptude.simulation import simulated as simulation
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

INERTIA = np.diag([1.0, 2.8, 2.0])
INSIDE = 1 + 1e-9


def body_flow(**settings) -> el.GuaranteedRigidBodyFlow:
    body = el.RigidBody(INERTIA)
    return el.GuaranteedRigidBodyFlow(body, el.GravityGradient(body, 1.0), **({"step": 0.01} | settings))


def start(angle: float = 0.1, rate: float = 0.1) -> el.StateEllipsoid:
    return el.StateEllipsoid(np.eye(3), [0.3, -0.2, 0.4], np.diag([angle**2] * 3 + [rate**2] * 3))


class Case:
    """A scenario, its flow, and simulated measurements with the truth beside them."""

    def __init__(self, name: str, noise: str = "inside", seed: int = 0, directions: str | None = None) -> None:
        self.scenario = scenarios.load(name)
        body = el.RigidBody(self.scenario.inertia_matrix)
        potential = self.scenario.potential
        match potential:
            case potentials.UniformGravity():
                core = el.UniformGravity(potential.mass, potential.gravity, potential.center_of_mass)
            case potentials.GravityGradient():
                core = el.GravityGradient(body, potential.orbit_rate)
            case _:
                core = el.FreeBody()
        self.flow = el.GuaranteedRigidBodyFlow(body, core, step=self.scenario.step)
        simulated = simulation.simulate(self.scenario, noise=noise, seed=seed, directions=directions)
        self.measurements = simulated.measurements
        self.bound, self.rate_bound = simulated.direction_bound, simulated.rate_bound

    @property
    def start(self) -> el.StateEllipsoid | None:
        estimate = self.scenario.estimate0
        if estimate.attitude == "first measurement":
            return None
        return el.StateEllipsoid(estimate.attitude.matrix(), estimate.rate, np.diag(estimate.P_diagonal))

    def rows(self, rows: slice = slice(None)) -> dict[str, object]:
        m = self.measurements
        return {
            "times": m.times[rows],
            "directions": m.directions[rows],
            "reference": m.references[rows],
            "bounds": self.bound,
            "angular_velocity": m.angular_velocities[rows],
            "rate_bound": self.rate_bound,
        }

    def at(self, k: int) -> dict[str, object]:
        m = self.measurements
        return {
            "directions": m.directions[k],
            "reference": m.references[k],
            "bounds": self.bound,
            "angular_velocity": m.angular_velocities[k],
            "rate_bound": self.rate_bound,
        }

    def forms(self, log: el.GuaranteedLog) -> np.ndarray:
        return log.forms(self.measurements.true_attitudes, self.measurements.true_angular_velocities)


@pytest.mark.parametrize("criterion", ["volume", "trace"])
@pytest.mark.parametrize("noise", simulation.NOISES)
@pytest.mark.parametrize("name", scenarios.names())
def test_the_truth_is_in_every_set(name: str, noise: str, criterion: str) -> None:
    for seed in range(2):
        case = Case(name, noise, seed)
        filter_ = el.GuaranteedFilter(case.flow, case.start, time=case.measurements.times[0], criterion=criterion)
        log = filter_.run(**case.rows())
        known = log.claims == 0
        assert known[-1]
        forms = case.forms(log)
        assert np.array_equal(np.isfinite(forms), known)
        assert (forms[known] <= INSIDE).all()
        assert np.array_equal(np.isnan(log.margins), ~log.updated)
        assert not log.dropped.any()


def test_a_log_in_one_call_is_its_rows_one_by_one() -> None:
    case = Case("orbit", seed=3)
    m = case.measurements
    whole = el.GuaranteedFilter(case.flow, case.start, time=m.times[0])
    log = whole.run(**case.rows())
    single = el.GuaranteedFilter(case.flow, case.start, time=m.times[0])
    for k, time in enumerate(m.times):
        single.predict(time)
        if log.updated[k]:
            update = single.update(**case.at(k))
            assert update.margin == log.margins[k]
            assert update.prediction_used == log.prediction_used[k]
            assert update.dropped == ()
        assert np.array_equal(single.ellipsoid.shape, log.shapes[k])
        assert np.array_equal(single.ellipsoid.attitude, log.attitudes[k])
        assert np.array_equal(single.ellipsoid.vector, log.vectors[k])
    assert whole.to_dict() == single.to_dict()


def test_extents_and_forms_of_a_log_are_those_of_its_ellipsoids() -> None:
    case = Case("orbit", seed=4)
    log = el.GuaranteedFilter(case.flow, None, time=case.measurements.times[0]).run(**case.rows())
    extents, exponential, forms = log.extents(), log.shapes_exponential(), case.forms(log)
    attitude_forms = log.forms(case.measurements.true_attitudes)
    for k in range(len(log.times)):
        if log.claims[k] == 2:
            assert np.isnan(forms[k])
            assert np.isnan(extents.largest_angles[k])
            assert np.isnan(exponential[k]).all()
            continue
        ellipsoid = el.StateEllipsoid(log.attitudes[k], log.vectors[k], log.shapes[k], chart="gibbs")
        extent = ellipsoid.extent()
        assert np.array_equal(extents.half_widths_body[k], extent.half_widths_body)
        assert np.array_equal(extents.half_widths_reference[k], extent.half_widths_reference)
        assert extents.largest_angles[k] == extent.largest_angle
        assert np.array_equal(exponential[k], ellipsoid.converted("exponential").shape)
        truth = case.measurements.true_attitudes[k]
        assert forms[k] == ellipsoid.quadratic_form(truth, case.measurements.true_angular_velocities[k])
        gamma = 2 * el.cayley_inverse(log.attitudes[k].T @ truth)
        expected = gamma @ np.linalg.solve(log.shapes[k, :3, :3], gamma)
        assert attitude_forms[k] == pytest.approx(expected, rel=1e-9)
    assert (log.claims == 2).sum() == (case.measurements.times[0] == 0)


# --- charts of state ellipsoids --------------------------------------------------------------------------------------


def test_a_state_ellipsoid_in_the_gibbs_chart() -> None:
    rng = np.random.default_rng(1)
    root = 0.2 * rng.standard_normal((6, 6))
    center, vector = el.exp(rng.standard_normal(3)), rng.standard_normal(3)
    gibbs = el.StateEllipsoid(center, vector, root @ root.T, chart="gibbs")
    assert gibbs.chart == "gibbs"
    assert el.StateEllipsoid(center, vector, root @ root.T).chart == "exponential"
    x = rng.standard_normal((100, 6)) * 0.3
    attitudes = center @ el.cayley(x[:, :3] / 2)
    expected = np.sum(x * np.linalg.solve(gibbs.shape, x.T).T, axis=1)
    forms = gibbs.quadratic_form(attitudes, vector + x[:, 3:])
    np.testing.assert_allclose(forms, expected, rtol=1e-9)
    assert np.array_equal(gibbs.contains(attitudes, vector + x[:, 3:]), forms <= 1)
    for copy in (
        pickle.loads(pickle.dumps(gibbs)),
        el.StateEllipsoid.from_dict(json.loads(json.dumps(gibbs.to_dict()))),
    ):
        assert copy.to_dict() == gibbs.to_dict()
    old = gibbs.to_dict()
    del old["chart"]
    assert el.StateEllipsoid.from_dict(old).chart == "exponential"

    largest = np.sqrt(np.linalg.eigvalsh(gibbs.shape[:3, :3])[-1])
    assert gibbs.extent().largest_angle == pytest.approx(2 * np.arctan(largest / 2), rel=1e-12)

    # The boundary of each is in the other's conversion.
    boundary = rng.standard_normal((2000, 6))
    boundary = np.linalg.cholesky(gibbs.shape) @ (boundary / np.linalg.norm(boundary, axis=1)[:, None]).T
    states = center @ el.cayley(boundary[:3].T / 2), vector + boundary[3:].T
    exponential = gibbs.converted("exponential")
    assert exponential.chart == "exponential"
    assert exponential.contains(*states).all()
    states = center @ el.exp(boundary[:3].T), vector + boundary[3:].T
    assert el.StateEllipsoid(center, vector, gibbs.shape).converted("gibbs").contains(*states).all()
    assert gibbs.converted("gibbs").to_dict() == gibbs.to_dict()


def test_charts_that_do_not_do() -> None:
    with pytest.raises(ValueError, match="chart must be 'exponential' or 'gibbs', not 'cayley'"):
        el.StateEllipsoid(np.eye(3), np.zeros(3), np.eye(6), chart="cayley")
    with pytest.raises(ValueError, match="holds half turns"):
        el.StateEllipsoid(np.eye(3), np.zeros(3), 10 * np.eye(6)).converted("gibbs")
    body = el.RigidBody(INERTIA)
    with pytest.raises(ValueError, match="ellipsoid must be in the chart 'exponential'"):
        el.AttitudeFilter(
            el.RigidBodyFlow(body, step=0.1), el.StateEllipsoid(np.eye(3), np.zeros(3), np.eye(6), "gibbs")
        )


# --- inputs of the rigid body's flow ---------------------------------------------------------------------------------


def integrated(torque, time: float, attitude: np.ndarray, rate: np.ndarray, wheel: np.ndarray, inertia=INERTIA):
    """Euler's equations by SciPy: attitude and rate at `time`."""

    def motion(t: float, state: np.ndarray) -> np.ndarray:
        c, w = state[:9].reshape(3, 3), state[9:]
        turning = c @ el.hat(w)
        return np.concatenate(
            [turning.ravel(), np.linalg.solve(inertia, torque(t, c) - np.cross(w, inertia @ w + wheel))]
        )

    end = solve_ivp(
        motion, (0, time), np.concatenate([attitude.ravel(), rate]), method="DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]
    return el.project_to_rotation(end[:9].reshape(3, 3)), end[9:]


def test_every_input_of_a_prediction_moves_the_center_as_it_does_the_body() -> None:
    torque, wheel, gravity = np.array([0.2, -0.1, 0.3]), np.array([0.5, 0.1, -0.4]), np.array([0.0, 0.1, 0.2])
    body = el.RigidBody(INERTIA)
    orbit = el.exp([0.3, 0.2, 0.1])
    potential = el.SumPotential(
        [
            el.FreeBody(),
            el.SumPotential([el.UniformGravity(2.0, 3.0, gravity / 6), el.FreeBody()]),
            el.GravityGradient(el.RigidBody([1.0, 1.5, 0.9]), 0.7, orbit),
        ]
    )
    filter_ = el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(body, potential, step=0.01), start(1e-6, 1e-6))
    filter_.predict(1.5, control_torque=torque, wheel_momentum=wheel)

    def true_torque(time: float, attitude: np.ndarray) -> np.ndarray:
        return potential.torque(el.project_to_rotation(attitude), time) + torque

    ellipsoid = start()
    attitude, rate = integrated(true_torque, 1.5, ellipsoid.attitude, ellipsoid.vector, wheel)
    assert np.linalg.norm(el.log(filter_.ellipsoid.attitude.T @ attitude)) < 1e-9
    np.testing.assert_allclose(filter_.ellipsoid.vector, rate, atol=1e-9)
    assert filter_.ellipsoid.contains(attitude, rate)
    assert filter_.time == 1.5


@pytest.mark.parametrize("seed", range(5))
def test_the_unknown_torque_and_inertia_are_in_the_set(seed: int) -> None:
    rng = np.random.default_rng(seed)
    error = np.array([[0.02, 0.005, 0], [0.005, -0.01, 0.003], [0, 0.003, 0.01]])
    size = np.linalg.norm(error, 2)
    direction = rng.standard_normal(3)
    direction *= 0.05 / np.linalg.norm(direction)
    filter_ = el.GuaranteedFilter(
        el.GuaranteedRigidBodyFlow(
            el.RigidBody(INERTIA), step=0.02, unknown_torque=0.05 * (1 + 1e-9), inertia_error=size * (1 + 1e-9)
        ),
        start(0.05, 0.05),
    )
    before = filter_.ellipsoid
    filter_.predict(0.8)
    root = np.linalg.cholesky(before.shape)
    for _ in range(5):
        x = rng.standard_normal(6)
        x = root @ (x / np.linalg.norm(x))
        attitude, rate = integrated(
            lambda t, c: direction * np.cos(3 * t),
            0.8,
            before.attitude @ el.cayley(x[:3] / 2),
            before.vector + x[3:],
            np.zeros(3),
            INERTIA + error,
        )
        assert filter_.ellipsoid.contains(attitude, rate)


def test_what_is_not_known_makes_the_set_larger() -> None:
    volumes = []
    for settings in ({}, {"unknown_torque": 0.01}, {"unknown_torque": 1e-3 * np.eye(3)}, {"inertia_error": 0.05}):
        filter_ = el.GuaranteedFilter(body_flow(**settings), start())
        filter_.predict(0.5)
        volumes.append(np.linalg.slogdet(filter_.ellipsoid.shape)[1])
    assert volumes[0] < volumes[1] < volumes[2]
    assert volumes[0] < volumes[3]


# --- the gyro --------------------------------------------------------------------------------------------------------


class GyroMotion:
    """A turning body with a drifting gyro bias, whose samples err within the noise, and two measured directions."""

    noise, drift, bound, interval = 2e-3, 1e-4, 0.02, 0.1
    acceleration = 0.5 * 2.0 + 0.3 * 1.1  # of the rate below

    def __init__(self, seed: int, count: int = 60) -> None:
        rng = np.random.default_rng(seed)
        self.times = self.interval * np.arange(count)
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        bias_slope = rng.standard_normal(3)
        bias_slope *= self.drift / np.linalg.norm(bias_slope)

        def rate(t: float) -> np.ndarray:
            return np.array([0.5 * np.sin(2 * t), 0.3 * np.cos(1.1 * t), 0.2])

        def motion(t: float, c: np.ndarray) -> np.ndarray:
            return (c.reshape(3, 3) @ el.hat(rate(t))).ravel()

        solution = solve_ivp(
            motion, (0, self.times[-1]), np.eye(3).ravel(), t_eval=self.times, rtol=1e-11, atol=1e-12, method="DOP853"
        )
        self.attitudes = el.project_to_rotation(solution.y.T.reshape(-1, 3, 3))
        self.biases = 0.01 * axis + self.times[:, None] * bias_slope
        rates = np.array([rate(t) for t in self.times])
        errors = rng.standard_normal((count, 3))
        errors *= self.noise / np.linalg.norm(errors, axis=1)[:, None]
        self.samples = rates + self.biases + errors
        fine = 50
        mean = np.array(
            [np.mean([rate(t + self.interval * (j + 0.5) / fine) for j in range(fine)], axis=0) for t in self.times]
        )
        self.means = mean + self.biases + 0.5 * self.interval * bias_slope + 0.9 * errors
        self.reference = np.array([[1.0, 0, 0], [0, 0.6, 0.8]])
        turns = rng.standard_normal((count, 2, 3))
        turns *= self.bound / np.linalg.norm(turns, axis=2)[:, :, None]
        true = np.einsum("nji,mj->nmi", self.attitudes, self.reference)
        self.directions = Rotation.from_rotvec(turns.reshape(-1, 3)).apply(true.reshape(-1, 3)).reshape(true.shape)

    def rates(self, interval_rate: str) -> np.ndarray:
        match interval_rate:
            case "mean_of_ends":
                return 0.5 * (self.samples + np.roll(self.samples, -1, axis=0))
            case "first_sample":
                return self.samples
        return self.means


@pytest.mark.parametrize("interval_rate", ["mean_of_ends", "first_sample", "mean"])
@pytest.mark.parametrize("known_start", [True, False])
@pytest.mark.parametrize("criterion", ["volume", "trace"])
def test_attitude_and_bias_are_in_every_set_of_a_gyro(interval_rate: str, known_start: bool, criterion: str) -> None:
    for seed in range(3):
        motion = GyroMotion(seed)
        flow = el.GuaranteedGyroFlow(
            motion.noise * 1.001,
            motion.drift * 1.001,
            angular_acceleration=motion.acceleration,
            interval_rate=interval_rate,
        )
        begin = el.StateEllipsoid(np.eye(3), np.zeros(3), np.diag([0.01**2] * 3 + [0.02**2] * 3))
        settings = {"start": begin} if known_start else {"vector_bound": 0.02}
        settings["criterion"] = criterion
        filter_ = el.GuaranteedFilter(flow, **settings)
        directions = motion.directions.copy()
        directions[20:40] = np.nan  # the gyro alone
        directions[45:, 0] = np.nan  # one direction
        log = filter_.run(
            motion.times,
            directions=directions,
            reference=motion.reference,
            bounds=motion.bound * 1.001,
            gyro=motion.rates(interval_rate),
        )
        known = log.claims == 0
        assert known[:45].all()  # one direction leaves a turn free, which may grow to half turns
        assert (log.forms(motion.attitudes, motion.biases)[known] <= 1).all()
        assert not log.updated[20:40].any()
        single = el.GuaranteedFilter(flow, **settings)
        for k, time in enumerate(motion.times):
            single.predict(time, gyro=motion.rates(interval_rate)[max(k - 1, 0)])
            present = np.isfinite(directions[k, :, 0])
            if present.any():
                single.update(directions[k, present], motion.reference[present], motion.bound * 1.001)
            assert single.knows_attitude == known[k]
            if known[k]:
                assert np.array_equal(single.ellipsoid.shape, log.shapes[k])


def test_a_gyros_settings_and_inputs() -> None:
    def volume(increment=None, **settings) -> float:
        filter_ = el.GuaranteedFilter(el.GuaranteedGyroFlow(**({"noise": 1e-3} | settings)), start(0.01, 0.001))
        filter_.predict(0.5, gyro=[0.1, 0.2, 0.3], increment=increment)
        return np.linalg.slogdet(filter_.ellipsoid.shape)[1]

    plain = volume()
    assert volume(increment=0.0) < volume(increment=1e-4) < plain
    assert volume(drift=1e-3) > plain
    assert volume(scale=0.01) > plain
    mean, ends, first = (
        volume(angular_acceleration=0.1, interval_rate=kind) for kind in ("mean", "mean_of_ends", "first_sample")
    )
    assert plain < mean < ends < first
    assert volume(noise=1e-6 * np.eye(3)) == plain

    motion = GyroMotion(0, count=5)
    flow = el.GuaranteedGyroFlow(1e-3)
    whole = el.GuaranteedFilter(flow, start(0.01, 0.01))
    increments = np.array([1e-5, np.nan, 1e-6, 1e-5, np.nan])
    log = whole.run(motion.times, gyro=motion.samples, increment=increments)
    single = el.GuaranteedFilter(flow, start(0.01, 0.01))
    for k, time in enumerate(motion.times):
        j = max(k - 1, 0)
        single.predict(time, gyro=motion.samples[j], increment=None if np.isnan(increments[j]) else increments[j])
        assert np.array_equal(log.shapes[k], single.ellipsoid.shape)


# --- measurements ----------------------------------------------------------------------------------------------------


def test_every_measurement_makes_the_set_smaller_and_keeps_the_truth() -> None:
    rng = np.random.default_rng(7)
    truth = start().attitude @ el.exp([0.03, -0.02, 0.05]), start().vector + np.array([0.02, 0.03, -0.01])
    star = truth[0] @ el.exp([0.004, 0, -0.003])
    body = truth[0].T @ np.array([0, 1.0, 0])
    measurements = [
        {"directions": [body], "reference": [[0, 1, 0]], "bounds": 0.01},
        {"directions": [body], "reference": [[0, 2, 0]], "bounds": [1e-4 * np.eye(3)]},
        {"angular_velocity": truth[1] + [0.005, 0, 0], "rate_bound": 0.01},
        {"attitude": star, "attitude_bound": 0.0051},
        {"attitude": Rotation.from_matrix(star), "attitude_bound": 0.0051**2 * np.eye(3)},
    ]
    shapes = []
    for measurement in measurements:
        filter_ = el.GuaranteedFilter(body_flow(), start())
        before = np.linalg.slogdet(filter_.ellipsoid.shape)[1]
        update = filter_.update(**measurement)
        assert update.claim == "unconditional"
        assert update.prediction_used
        assert update.margin > 0
        assert np.linalg.slogdet(filter_.ellipsoid.shape)[1] < before - 0.5
        assert filter_.ellipsoid.contains(*truth)
        shapes.append(filter_.ellipsoid.shape)
    np.testing.assert_allclose(shapes[0], shapes[1], rtol=0, atol=1e-9)  # lengths of directions do not matter
    np.testing.assert_allclose(shapes[3], shapes[4], rtol=0, atol=1e-9)

    filter_ = el.GuaranteedFilter(body_flow(), start())
    h = rng.standard_normal((2, 6))
    center = filter_.ellipsoid
    x = np.concatenate([el.log(center.attitude.T @ truth[0]), truth[1] - center.vector])
    update = filter_.update_linear(h @ x + [0.001, 0.002], h, np.diag([2e-3, 3e-3]) ** 2)
    assert update.margin > 0
    assert filter_.ellipsoid.contains(*truth)
    with pytest.raises(el.InconsistentMeasurement):
        filter_.update_linear(h @ x + 5, h, np.diag([2e-3, 3e-3]) ** 2)


def test_a_filter_starts_from_nothing_when_it_can() -> None:
    case = Case("orbit", seed=5)
    filter_ = el.GuaranteedFilter(case.flow)
    assert (filter_.claim, filter_.knows_attitude, filter_.ellipsoid) == ("none", False, None)
    filter_.predict(case.measurements.times[1])
    at = case.at(1)
    one = at | {"directions": at["directions"][:1], "reference": at["reference"][:1]}
    update = filter_.update(**one)  # a direction is not enough, but the rate is remembered
    assert update.claim == "none"
    assert not filter_.knows_attitude
    stored = el.GuaranteedFilter.from_json(filter_.to_json())
    assert stored.to_dict() == filter_.to_dict()
    assert filter_.to_dict()["vector"] is not None
    without_rate = {k: v for k, v in at.items() if k not in ("angular_velocity", "rate_bound")}
    for some in (filter_, stored, pickle.loads(pickle.dumps(filter_))):
        update = some.update(**without_rate)
        assert update.claim == some.claim == "unconditional"
        assert not update.prediction_used
        truth = case.measurements.true_attitudes[1], case.measurements.true_angular_velocities[1]
        assert some.ellipsoid.chart == "gibbs"
        assert some.ellipsoid.contains(*truth)
    with pytest.raises(ValueError, match="the attitude is not known"):
        el.GuaranteedFilter(case.flow).update_linear([0.0], np.ones((1, 6)), [[1.0]])


def test_directions_that_contradict_each_other_where_nothing_tells_the_vector() -> None:
    references = np.array([[0.0, 0, 1], [0, 1, 0]])
    bounds = np.deg2rad([2.0, 5.0])
    for flow in (body_flow(), el.GuaranteedGyroFlow(noise=0.01)):
        filter_ = el.GuaranteedFilter(flow)
        assert filter_.update([[0.0, 0, 1], [0, 1, 0.05]], references, bounds).claim == "none"
        with pytest.raises(el.InconsistentMeasurement, match=r"compass.*margin -"):
            filter_.update([[0.0, 0, 1], [0, 0.9, 0.6]], references, bounds, sensors=["gravity", "compass"])
        for policy in ("drop_measurement", "restart"):
            update = el.GuaranteedFilter(flow, policy=policy).update([[0.0, 0, 1], [0, 0.9, 0.6]], references, bounds)
            assert update.dropped == (0, 1)
            assert update.claim == "none"


def test_rates_that_contradict_each_other_without_an_attitude() -> None:
    for policy in ("raise", "drop_measurement", "restart"):
        filter_ = el.GuaranteedFilter(body_flow(), policy=policy)
        assert filter_.update(angular_velocity=[1.0, 0, 0], rate_bound=0.1).claim == "none"
        before = filter_.to_dict()
        if policy == "raise":
            with pytest.raises(el.InconsistentMeasurement, match=r"angular_velocity.*margin -") as caught:
                filter_.update(angular_velocity=[2.0, 0, 0], rate_bound=0.1)
            assert caught.value.sensor == "angular_velocity"
            assert filter_.to_dict() == before
            continue
        update = filter_.update(angular_velocity=[2.0, 0, 0], rate_bound=0.1)
        assert update.dropped == (("angular_velocity",) if policy == "drop_measurement" else ())
        assert update.claim == "none"
        assert filter_.to_dict()["rests_on_drops"]
        copy = el.GuaranteedFilter.from_json(filter_.to_json())
        for some in (filter_, copy):
            update = some.update(np.eye(3), np.eye(3), 0.1)
            assert update.claim == "conditional"  # what it has of the rate rests on what was dropped


def test_a_prediction_that_grows_too_large_forgets_the_attitude() -> None:
    filter_ = el.GuaranteedFilter(body_flow(), start(0.5, 0.5))
    filter_.predict(30.0)
    assert (filter_.claim, filter_.ellipsoid) == ("none", None)
    assert filter_.time == 30.0
    log = filter_.run([31.0, 32.0])
    assert (log.claims == 2).all()
    assert np.isnan(log.shapes).all()
    assert not log.prediction_used.any()


@pytest.mark.parametrize("flow", [el.GuaranteedRigidBodyFlow, el.RigidBodyFlow])
def test_the_most_steps_of_a_prediction_are_a_setting(flow: type) -> None:
    body = el.RigidBody(np.diag([1.0, 2.0, 2.5]))
    assert flow(body, step=0.1).most_steps == 1_000_000
    few = flow(body, step=0.1, most_steps=10)
    assert pickle.loads(pickle.dumps(few)).most_steps == 10
    kind = el.GuaranteedFilter if flow is el.GuaranteedRigidBodyFlow else el.AttitudeFilter
    shape = 1e-6 * np.eye(6)
    chart = "gibbs" if kind is el.GuaranteedFilter else "exponential"
    filter_ = kind(few, el.StateEllipsoid(np.eye(3), np.zeros(3), shape, chart))
    filter_ = kind.from_dict(filter_.to_dict())
    assert filter_.flow.most_steps == 10
    filter_.predict(1.0)
    for later in (2.2, 1e15):
        with pytest.raises(ValueError, match="takes more than most_steps = 10 steps"):
            filter_.predict(later)
    assert filter_.time == 1.0
    with pytest.raises(ValueError, match="most_steps must be positive, but is 0"):
        flow(body, step=0.1, most_steps=0)


@pytest.mark.parametrize("radius", [1e-320, 1e-170, 1e170, 1e300])
def test_a_bound_beyond_the_domain_does_not_count_as_zero(radius: float) -> None:
    with pytest.raises(ValueError, match=r"noise = .*: .*1e-138 to 1e137"):
        el.GuaranteedGyroFlow(radius)
    with pytest.raises(ValueError, match=r"unknown_torque = .*: .*1e-138 to 1e137"):
        body_flow(unknown_torque=radius)


def test_the_vectors_bound_helps() -> None:
    at = Case("orbit", seed=6).at(2)
    given = {k: at[k] for k in ("directions", "reference", "bounds")}
    nothing = el.GuaranteedFilter(body_flow())
    assert nothing.update(**given).claim == "none"  # no rate
    for bound, radius in (
        (4.0, 4.0),
        (16 * np.eye(3), 4.0),
        (([1.0, 0, 0], 3.0), 3.0),
        (([1.0, 0, 0], 9 * np.eye(3)), 3.0),
    ):
        bounded = el.GuaranteedFilter(body_flow(), vector_bound=bound)
        assert bounded.update(**given).claim == "unconditional"
        np.testing.assert_allclose(bounded.vector_bound[1], radius**2 * np.eye(3))
        np.testing.assert_allclose(bounded.vector_bound[0], [1.0 if isinstance(bound, tuple) else 0.0, 0, 0])
    known = el.GuaranteedFilter(body_flow(), start(0.1, 5.0), vector_bound=0.6)
    known.update()  # the bound alone; the smallest ellipsoid about a product of two balls is √2 times as wide
    # With shares (1 ± x)/2 of both, F is larger by -3 log(1 - x²), of which the search may leave 1e-3 (theory, 16.5).
    share = (1 - np.sqrt(1e-3 / 3)) / 2
    assert known.ellipsoid.extent().half_widths_body[3:].max() < 0.6 / np.sqrt(share)


# --- contradictions --------------------------------------------------------------------------------------------------


def flipped(case: Case, row: int, sensor: int) -> dict[str, object]:
    rows = case.rows()
    directions = rows["directions"].copy()
    directions[row, sensor] *= -1
    return rows | {"directions": directions}


def test_a_contradiction_names_row_time_sensor_and_margin() -> None:
    case = Case("orbit", seed=2)
    times = case.measurements.times
    for sensor in range(case.measurements.directions.shape[1]):
        filter_ = el.GuaranteedFilter(case.flow, case.start, time=times[0])
        with pytest.raises(
            el.InconsistentMeasurement, match=rf"^row 9: .*direction {sensor} at .* s .*margin -"
        ) as caught:
            filter_.run(**flipped(case, 9, sensor))
        assert caught.value.sensor == f"direction {sensor}"
        assert caught.value.time == times[9]
        assert caught.value.margin < 0
        assert filter_.time == times[9]  # predicted to the row
        good = el.GuaranteedFilter(case.flow, case.start, time=times[0])
        good.run(**case.rows(slice(9)))
        good.predict(times[9])
        assert filter_.to_dict() == good.to_dict()
        wrong = case.at(9)
        wrong["directions"] = flipped(case, 9, sensor)["directions"][9]
        names = ["sun", "earth", "magnetic field", "star"][: len(wrong["directions"])]
        with pytest.raises(el.InconsistentMeasurement) as caught:
            filter_.update(**wrong, sensors=names)
        assert caught.value.sensor == names[sensor]
        assert filter_.to_dict() == good.to_dict()
        with pytest.raises(el.InconsistentMeasurement) as caught:
            filter_.update(**(case.at(9) | {"angular_velocity": [9.0, 9, 9]}), sensors=[*names, "gyro"])
        assert caught.value.sensor == "gyro"


def test_a_wrong_sensor_is_dropped_by_name_and_the_claim_comes_back() -> None:
    case = Case("orbit", seed=2, directions="five")
    times = case.measurements.times
    filter_ = el.GuaranteedFilter(case.flow, case.start, time=times[0], policy="drop_measurement", regain_after=3)
    log = filter_.run(**flipped(case, 9, 1))
    dropped = np.zeros_like(log.dropped)
    dropped[9, 1] = True
    assert np.array_equal(log.dropped, dropped)
    assert log.margins[9] < 0
    assert (log.claims[:9] == 0).all()
    assert (log.claims[9:12] == 1).all()
    back = 12 + int(np.argmax(log.claims[12:] == 0))
    assert back <= 13  # later where the prediction had been given up when it was due
    assert (log.claims[back:] == 0).all()
    assert not log.prediction_used[back]
    assert (case.forms(log) <= INSIDE).all()
    wrong = case.at(9) | {"directions": flipped(case, 9, 1)["directions"][9]}
    names = ["sun", "earth", "magnetic field", "star", "moon"]
    for sensors, name in ((None, 1), (names, "earth")):
        some = el.GuaranteedFilter(case.flow, case.start, policy="drop_measurement")
        some.run(**case.rows(slice(9)))
        some.predict(times[9])
        update = some.update(**wrong, sensors=sensors)
        assert update.dropped == (name,)
        assert update.claim == some.claim == "conditional"
    some = el.GuaranteedFilter(case.flow, case.start, policy="drop_measurement")
    some.run(**case.rows(slice(9)))
    some.predict(times[9])
    assert some.update(**(case.at(9) | {"angular_velocity": [9.0, 9, 9]})).dropped == ("angular_velocity",)


def test_a_relaxed_filter_tolerates_a_wrong_sensor_without_being_told() -> None:
    case = Case("orbit", seed=2, directions="five")
    plain = el.GuaranteedFilter(case.flow, case.start, time=case.measurements.times[0])
    relaxed = el.GuaranteedFilter(
        case.flow, case.start, time=case.measurements.times[0], policy="relaxed", most_wrong=1
    )
    rows = flipped(case, 9, 1)
    log = relaxed.run(**rows)
    assert (log.claims == 0).all()
    assert (case.forms(log) <= INSIDE).all()
    assert log.dropped[9, 1]
    assert log.dropped.sum() == 1
    careless = plain.run(**case.rows())
    assert (np.linalg.det(log.shapes[1:]) >= np.linalg.det(careless.shapes[1:])).all()
    with pytest.raises(ValueError, match="at most 8 measurements at a time, but there are 9"):
        relaxed.update(np.tile([1.0, 0, 0], (9, 1)), np.tile([1.0, 0, 0], (9, 1)), 0.1)


def test_a_filter_restarts_from_the_measurements_of_the_moment() -> None:
    case = Case("orbit", seed=2)
    wrong_start = el.StateEllipsoid(el.exp([2.0, 0, 0]), [5, 5, 5], 1e-4 * np.eye(6))
    filter_ = el.GuaranteedFilter(case.flow, wrong_start, time=case.measurements.times[1], policy="restart")
    update = filter_.update(**case.at(1))
    assert (update.claim, update.prediction_used) == ("conditional", False)
    assert update.margin < 0
    truth = case.measurements.true_attitudes[1], case.measurements.true_angular_velocities[1]
    assert filter_.ellipsoid.contains(*truth)


# --- logs ------------------------------------------------------------------------------------------------------------


def test_rows_and_bounds_that_were_not_measured() -> None:
    case = Case("orbit", seed=1)
    count, m = case.measurements.directions.shape[:2]
    rows = case.rows()
    bounds = np.full((count, m), case.bound)
    rate_bounds = np.full(count, case.rate_bound)
    bounds[5] = np.nan
    bounds[6, 0] = np.pi
    bounds[7] = 99.0
    rate_bounds[[5, 8]] = np.nan
    first = el.GuaranteedFilter(case.flow, case.start, time=case.measurements.times[0])
    by_bounds = first.run(**(rows | {"bounds": bounds, "rate_bound": rate_bounds}))
    directions, rates = rows["directions"].copy(), rows["angular_velocity"].copy()
    directions[5] = directions[6, 0] = directions[7] = np.nan
    rates[[5, 8]] = np.nan
    second = el.GuaranteedFilter(case.flow, case.start, time=case.measurements.times[0])
    by_rows = second.run(
        **(
            rows
            | {
                "directions": directions,
                "angular_velocity": rates,
                "bounds": np.full(m, case.bound),
                "rate_bound": case.rate_bound**2 * np.eye(3),
            }
        )
    )
    assert np.array_equal(by_bounds.shapes, by_rows.shapes, equal_nan=True)
    assert not by_bounds.updated[5]
    assert by_bounds.updated[6:].all()
    shapes = np.tile(case.bound**2 * np.eye(3), (m, 1, 1))
    third = el.GuaranteedFilter(case.flow, case.start, time=case.measurements.times[0])
    by_shapes = third.run(**(rows | {"directions": directions, "angular_velocity": rates, "bounds": shapes}))
    assert np.array_equal(by_shapes.shapes, by_rows.shapes, equal_nan=True)


def test_attitudes_and_inputs_of_a_log() -> None:
    rng = np.random.default_rng(3)
    times = np.linspace(0.1, 1, 10)
    torque, wheel = 0.1 * rng.standard_normal((10, 3)), 0.1 * rng.standard_normal((10, 3))
    whole = el.GuaranteedFilter(body_flow(), start())
    predicted = whole.run(times, control_torque=torque, wheel_momentum=wheel)
    stars = predicted.attitudes.copy()
    stars[4] = np.nan
    whole = el.GuaranteedFilter(body_flow(), start())
    log = whole.run(times, attitude=stars, attitude_bound=0.01, control_torque=torque, wheel_momentum=wheel[0])
    single = el.GuaranteedFilter(body_flow(), start())
    for k, time in enumerate(times):
        single.predict(time, control_torque=torque[k], wheel_momentum=wheel[0])
        if k != 4:
            single.update(attitude=stars[k], attitude_bound=0.01)
        assert np.array_equal(single.ellipsoid.shape, log.shapes[k])
    assert log.updated.tolist() == [k != 4 for k in range(10)]
    assert log.dropped.shape == (10, 2)


# --- storage ---------------------------------------------------------------------------------------------------------


def test_storing_keeps_every_bit() -> None:
    case = Case("orbit", seed=2)
    weight = np.diag([1.0, 1, 1, 0.3, 0.3, 0.3])
    filter_ = el.GuaranteedFilter(
        case.flow,
        case.start,
        time=case.measurements.times[0],
        criterion="weighted_trace",
        weight=weight,
        policy="drop_measurement",
        regain_after=7,
        vector_bound=([0.1, 0, 0], 9.0),
    )
    filter_.run(**(flipped(case, 9, 1) | {}))
    assert filter_.to_dict()["agreeing_updates"] > 0
    motion = GyroMotion(0, count=10)
    gyro = el.GuaranteedFilter(
        el.GuaranteedGyroFlow(1e-3, 1e-6, scale=0.1, angular_acceleration=0.2, interval_rate="mean"),
        vector_bound=0.1,
        policy="relaxed",
        most_wrong=2,
    )
    nothing = el.GuaranteedFilter(body_flow(unknown_torque=0.1, inertia_error=0.01), time=3.5)
    for some in (filter_, gyro, nothing):
        for copy in (pickle.loads(pickle.dumps(some)), el.GuaranteedFilter.from_json(some.to_json())):
            assert copy.to_dict() == some.to_dict()
            assert type(copy) is el.GuaranteedFilter
    copy = el.GuaranteedFilter.from_json(gyro.to_json())
    for some in (gyro, copy):
        some.run(
            motion.times, gyro=motion.samples, directions=motion.directions, reference=motion.reference, bounds=0.1
        )
    assert copy.to_dict() == gyro.to_dict()
    fields = filter_.to_dict()
    with pytest.raises(ValueError, match="format is 99"):
        el.GuaranteedFilter.from_dict(fields | {"format": 99})
    with pytest.raises(ValueError, match="agreeing_updates"):
        el.GuaranteedFilter.from_dict(fields | {"agreeing_updates": -1})
    with pytest.raises(ValueError, match="must be in the chart 'gibbs'"):
        el.GuaranteedFilter.from_dict(fields | {"ellipsoid": start().to_dict()})
    with pytest.raises(TypeError, match="dictionary, not list"):
        el.GuaranteedFilter.from_json("[]")
    del fields["policy"]
    with pytest.raises(ValueError, match="needs the key 'policy'"):
        el.GuaranteedFilter.from_dict(fields)
    for flow in (filter_.flow, gyro.flow):
        assert type(pickle.loads(pickle.dumps(flow))) is type(flow)


# --- settings and errors ---------------------------------------------------------------------------------------------


def test_settings_come_back() -> None:
    body = el.RigidBody(INERTIA)
    flow = el.GuaranteedRigidBodyFlow(body, step=0.1, unknown_torque=0.2, inertia_error=0.3)
    assert flow.body == body
    assert isinstance(flow.potential, el.FreeBody)
    assert (flow.step, flow.inertia_error) == (0.1, 0.3)
    np.testing.assert_allclose(flow.unknown_torque, 0.04 * np.eye(3))
    gyro = el.GuaranteedGyroFlow(0.1, scale=0.2, angular_acceleration=0.3, interval_rate="first_sample")
    assert (gyro.scale, gyro.angular_acceleration, gyro.interval_rate) == (0.2, 0.3, "first_sample")
    np.testing.assert_allclose(gyro.noise, 0.01 * np.eye(3))
    assert not gyro.drift.any()
    filter_ = el.GuaranteedFilter(flow, time=2.0, policy="relaxed", most_wrong=2, regain_after=4)
    assert filter_.flow is flow
    assert (filter_.time, filter_.criterion, filter_.weight) == (2.0, "volume", None)
    assert (filter_.policy, filter_.most_wrong, filter_.regain_after) == ("relaxed", 2, 4)
    assert filter_.vector_bound is None


class Pendulum:
    """A potential written in Python."""

    def energy(self, attitude: np.ndarray, time: float) -> float:
        return 0.0

    def torque(self, attitude: np.ndarray, time: float) -> np.ndarray:
        return np.zeros(3)

    def torque_jacobian(self, attitude: np.ndarray, time: float) -> np.ndarray:
        return np.zeros((3, 3))


GRAVITY = el.UniformGravity(1, 9.81, [0, 0, 0.1])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: body_flow(step=0.0), "step must be positive, but is 0 s"),
        (lambda: body_flow(step=np.nan), "step must be finite"),
        (lambda: body_flow(unknown_torque=-1.0), "unknown_torque must not be negative, but is -1"),
        (lambda: body_flow(inertia_error=-1.0), "inertia_error must not be negative, but is -1"),
        (lambda: body_flow(inertia_error=1.0), "inertia_error must be below the least principal moment, 1 kg"),
        (
            lambda: el.GuaranteedRigidBodyFlow(el.RigidBody(INERTIA), Pendulum(), step=0.1),
            "potential offers no bounds of its torque.*UniformGravity.*StatedTorque",
        ),
        (
            lambda: el.GuaranteedRigidBodyFlow(el.RigidBody(INERTIA), el.SumPotential([GRAVITY, Pendulum()]), step=0.1),
            "potential offers no bounds",
        ),
        (
            lambda: el.GuaranteedRigidBodyFlow(el.RigidBody(INERTIA), el.SumPotential([GRAVITY] * 9), step=0.1),
            "a sum of at most 8 potentials",
        ),
        (lambda: el.GuaranteedGyroFlow(-1.0), "noise must not be negative, but is -1"),
        (lambda: el.GuaranteedGyroFlow(1.0, -1.0), "drift must not be negative, but is -1"),
        (lambda: el.GuaranteedGyroFlow(1.0, scale=-1.0), "scale must not be negative, but is -1"),
        (
            lambda: el.GuaranteedGyroFlow(1.0, angular_acceleration=-1.0),
            "angular_acceleration must not be negative, but is -1",
        ),
        (lambda: el.GuaranteedGyroFlow(1.0, interval_rate="last"), "interval_rate must be .*, not 'last'"),
        (lambda: el.GuaranteedFilter(body_flow(), start(4.0)), "start holds half turns"),
        (lambda: el.GuaranteedFilter(body_flow(), start(0.0)), "start must have a positive definite shape"),
        (lambda: el.GuaranteedFilter(body_flow(), time=np.inf), "time must be finite"),
        (lambda: el.GuaranteedFilter(body_flow(), criterion="area"), "criterion must be"),
        (lambda: el.GuaranteedFilter(body_flow(), criterion="weighted_trace"), "needs weight"),
        (lambda: el.GuaranteedFilter(body_flow(), policy="skip"), "policy must be one of 'raise'.* not 'skip'"),
        (lambda: el.GuaranteedFilter(body_flow(), policy="relaxed", most_wrong=3), "most_wrong must be 0, 1 or 2"),
        (lambda: el.GuaranteedFilter(body_flow(), most_wrong=1), "most_wrong goes with policy 'relaxed'"),
        (lambda: el.GuaranteedFilter(body_flow(), regain_after=0), "regain_after must be at least 1, but is 0"),
        (lambda: el.GuaranteedFilter(body_flow(), vector_bound=0.0), "vector_bound must be positive"),
        (
            lambda: el.GuaranteedFilter(body_flow(), vector_bound=([0, 0], 1.0)),
            r"vector_bound\[0\] must have the shape",
        ),
        (lambda: el.GuaranteedFilter(body_flow(), vector_bound=(1.0,)), "vector_bound must be a bound or a pair"),
    ],
)
def test_what_makes_no_filter_is_refused_by_name(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
    with pytest.raises(TypeError, match="flow must be a GuaranteedRigidBodyFlow or a GuaranteedGyroFlow"):
        el.GuaranteedFilter(el.GyroFlow(1.0))


def measurement() -> dict[str, object]:
    return {
        "directions": np.eye(3),
        "reference": np.eye(3),
        "bounds": 0.3,
        "angular_velocity": start().vector,
        "rate_bound": 0.1,
    }


def log_of(count: int = 3) -> dict[str, object]:
    m = measurement()
    return m | {
        "times": np.arange(1, count + 1) / 10,
        "directions": np.tile(m["directions"], (count, 1, 1)),
        "angular_velocity": np.tile(m["angular_velocity"], (count, 1)),
    }


def changed(values: object, place: object, value: float) -> np.ndarray:
    array = np.array(values, dtype=float)
    array[place] = value
    return array


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda f, m, g: f.predict(-1.0), ValueError, "time must not go backwards"),
        (lambda f, m, g: f.predict(1e9), ValueError, "takes more than most_steps = 1000000 steps"),
        (lambda f, m, g: f.predict(np.nan), ValueError, "time must be finite"),
        (lambda f, m, g: f.predict(1.0, control_torque=[0, np.inf, 0]), ValueError, "control_torque must be finite"),
        (lambda f, m, g: f.predict(1.0, wheel_momentum=[0, 0]), ValueError, "wheel_momentum must have the shape"),
        (lambda f, m, g: f.predict(1.0, gyro=[0, 0, 0]), TypeError, "gyro is the input of a GuaranteedGyroFlow"),
        (lambda f, m, g: f.predict(1.0, increment=0.1), TypeError, "increment is the input of a GuaranteedGyroFlow"),
        (lambda f, m, g: g.predict(1.0), TypeError, "needs gyro"),
        (lambda f, m, g: g.predict(1.0, gyro=[0, 0, 0], control_torque=[0, 0, 0]), TypeError, "control_torque is an"),
        (lambda f, m, g: g.predict(1.0, gyro=[0, 0, 0], increment=-1.0), ValueError, "increment must not be negative"),
        (lambda f, m, g: g.update(**m), TypeError, "angular_velocity cannot update a GuaranteedGyroFlow"),
        (lambda f, m, g: f.update(), ValueError, "update needs directions, angular_velocity or attitude"),
        (lambda f, m, g: f.update(**(m | {"reference": None})), ValueError, "directions need reference and bounds"),
        (lambda f, m, g: f.update(**(m | {"rate_bound": None})), ValueError, "angular_velocity needs rate_bound"),
        (lambda f, m, g: f.update(attitude=np.eye(3)), ValueError, "attitude needs attitude_bound"),
        (lambda f, m, g: f.update(**(m | {"bounds": 0.0})), ValueError, "bounds must be positive, but is 0"),
        (lambda f, m, g: f.update(**(m | {"bounds": np.nan})), ValueError, "bounds must be finite"),
        (lambda f, m, g: f.update(**(m | {"bounds": 3.2})), ValueError, "bounds must be below pi"),
        (lambda f, m, g: f.update(**(m | {"bounds": [0.1, -1, 0.1]})), ValueError, r"bounds\[1\] must be positive"),
        (lambda f, m, g: f.update(**(m | {"rate_bound": 0.0})), ValueError, "rate_bound must be positive"),
        (
            lambda f, m, g: f.update(attitude=np.eye(3), attitude_bound=4.0),
            ValueError,
            "attitude_bound must be below pi",
        ),
        (
            lambda f, m, g: f.update(attitude=2 * np.eye(3), attitude_bound=0.1),
            ValueError,
            "attitude must be a rotation",
        ),
        (
            lambda f, m, g: f.update(**(m | {"directions": np.zeros((3, 3))})),
            ValueError,
            r"directions\[0\] has no length",
        ),
        (lambda f, m, g: f.update(np.ones((33, 3)), np.ones((33, 3)), 0.1), ValueError, "1 to 32, not 33"),
        (lambda f, m, g: f.update(**m, sensors=["a"]), ValueError, "sensors must name the 3 directions"),
        (lambda f, m, g: f.update(**m, sensors="abc"), TypeError, "not one str"),
        (lambda f, m, g: f.update(**m, sensors=[1, 2, 3]), TypeError, "sensors must hold names, not int"),
        (lambda f, m, g: f.update_linear([0.0], np.zeros((1, 5)), [[1.0]]), ValueError, r"h must have the shape"),
        (lambda f, m, g: f.run([0.0, 1.0, 0.5]), ValueError, r"times\[2\] is 0.5 s after 1 s"),
        (lambda f, m, g: f.run([0.0, np.nan]), ValueError, "times must be finite"),
        (
            lambda f, m, g: f.run([0.1], control_torque=np.zeros((2, 3))),
            ValueError,
            "control_torque must have the shape",
        ),
        (lambda f, m, g: g.run([0.1], gyro=np.zeros((1, 3))), ValueError, r"times\[0\] must be the filter's time, 0 s"),
        (
            lambda f, m, g: g.run([0.0, 0.1], gyro=np.zeros((2, 3)), increment=[-1.0, 0]),
            ValueError,
            r"increment\[0\] must not be negative",
        ),
        (
            lambda f, m, g: f.run(**(log_of() | {"bounds": np.full((3, 3), 0.1) * [1, 1, -1]})),
            ValueError,
            r"bounds\[0, 2\] must be positive .* but is -0.1",
        ),
        (lambda f, m, g: f.run(**(log_of() | {"bounds": [0.1, 0.1]})), ValueError, "bounds must be a number or have"),
        (lambda f, m, g: f.run(**(log_of() | {"rate_bound": [0.1, 0, 1]})), ValueError, r"rate_bound\[1\] must be pos"),
        (
            lambda f, m, g: f.run(**(log_of() | {"directions": changed(log_of()["directions"], (1, 2, 0), np.nan)})),
            ValueError,
            r"directions\[1, 2\] must be finite, or all NaN",
        ),
        (
            lambda f, m, g: f.run(**(log_of() | {"angular_velocity": changed([start().vector] * 3, (2, 0), np.nan)})),
            ValueError,
            r"angular_velocity\[2\] must be finite, or all NaN",
        ),
        (
            lambda f, m, g: f.run(**(log_of() | {"reference": changed(np.eye(3), 1, np.nan)})),
            ValueError,
            r"reference\[1\] must be finite where",
        ),
        (
            lambda f, m, g: f.run([0.1, 0.2], attitude=np.array([np.eye(3), 2 * np.eye(3)]), attitude_bound=0.1),
            ValueError,
            r"attitude\[1\] must be a rotation",
        ),
        (
            lambda f, m, g: el.GuaranteedFilter(body_flow(step=50.0), start()).predict(50.0),
            ValueError,
            "step of the flow is too long",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(call, error, message: str) -> None:
    filter_ = el.GuaranteedFilter(body_flow(), start())
    gyro = el.GuaranteedFilter(el.GuaranteedGyroFlow(1e-3), start())
    before = filter_.to_dict(), gyro.to_dict()
    with pytest.raises(error, match=message):
        call(filter_, measurement(), gyro)
    assert (filter_.to_dict(), gyro.to_dict()) == before


def test_a_filter_refuses_two_threads_at_once() -> None:
    filter_ = el.GuaranteedFilter(body_flow(step=1e-4), start(1e-9, 1e-9))
    thread = threading.Thread(target=filter_.predict, args=(20.0,))
    thread.start()
    refused = 0
    while thread.is_alive():
        try:
            filter_.predict(0.0)
        except RuntimeError:
            refused += 1
        except ValueError:
            break  # the other one has come to its end
    thread.join()
    assert refused > 0
    assert filter_.time == 20.0


def test_the_inertias_error_moves_the_gravity_gradient() -> None:
    """All that moves a body at rest is the gradient, of an inertia that is not the sphere's that is assumed."""
    error = np.array([[0.0, 0.02, 0], [0.02, 0, 0], [0, 0, 0]])
    size = np.linalg.norm(error, 2)
    inertia = np.eye(3)
    body = el.RigidBody(inertia)
    begin = el.StateEllipsoid(np.eye(3), np.zeros(3), 1e-4 * np.eye(6))
    for potential in (el.GravityGradient(body, 1.0), el.SumPotential([el.GravityGradient(body, 1.0), el.FreeBody()])):
        flow = el.GuaranteedRigidBodyFlow(body, potential, step=0.01, inertia_error=size * (1 + 1e-9))
        filter_ = el.GuaranteedFilter(flow, begin)
        filter_.predict(0.4)

        def torque(time: float, attitude: np.ndarray) -> np.ndarray:
            radial = np.cos(time) * attitude[0] + np.sin(time) * attitude[1]
            return 3 * np.cross(radial, (inertia + error) @ radial)

        attitude, rate = integrated(torque, 0.4, np.eye(3), np.zeros(3), np.zeros(3), inertia + error)
        assert filter_.ellipsoid.contains(attitude, rate)
