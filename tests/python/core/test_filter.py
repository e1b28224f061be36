"""The filter against the NumPy reference, an equation a function, and what a user meets around it."""

import json
import pickle
import threading

import elliptude as el
import numpy as np
import pytest
from reference import filter as reference_filter
from reference import gyro as reference_gyro
from reference import measurement as reference_measurement
from reference import rigid_body as reference_body
from reference import so3 as reference_so3
from reference.ellipsoid import StateEllipsoid as ReferenceEllipsoid

INERTIA = np.diag([1.0, 2.8, 2.0])
STEP = 2 * np.pi / 300
BOUND = np.radians(7.0)


def body_flow(**settings) -> el.RigidBodyFlow:
    body = el.RigidBody(INERTIA)
    return el.RigidBodyFlow(body, el.GravityGradient(body, 1.0), step=STEP, **settings)


def start() -> el.StateEllipsoid:
    return el.StateEllipsoid(np.eye(3), [2.116, 0.5466, -0.8915], np.diag([4.934802] * 3 + [0.548311] * 3))


def in_ball(rng: np.random.Generator) -> np.ndarray:
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector) * rng.random() ** (1 / 3)


class Log:
    """Twenty measurements of scenario `orbit`, three directions."""

    def __init__(self, seed: int, count: int = 20) -> None:
        rng = np.random.default_rng(seed)
        body = el.RigidBody(INERTIA)
        integrator = el.Integrator(body, el.GravityGradient(body, 1.0), step=STEP / 2, order=8)
        truth = integrator.trajectory(el.exp([np.radians(105), 0, 0]), [2.316, 0.446, -0.591], 60 * count, every=60)
        self.times = truth.times[1:]
        self.attitudes = truth.attitudes[1:]
        self.rates_true = truth.angular_velocities[1:]
        self.reference = np.eye(3)
        self.directions = np.array(
            [[el.exp(BOUND * in_ball(rng)) @ c.T @ e for e in self.reference] for c in self.attitudes]
        )
        self.rates = np.array([w + BOUND * in_ball(rng) for w in self.rates_true])

    @property
    def measurements(self) -> dict[str, object]:
        return {
            "directions": self.directions,
            "reference": self.reference,
            "bounds": BOUND,
            "angular_velocity": self.rates,
            "rate_bound": BOUND,
        }

    def at(self, k: int) -> dict[str, object]:
        return self.measurements | {"directions": self.directions[k], "angular_velocity": self.rates[k]}


@pytest.mark.parametrize(("mode", "first_order"), [("paper", False), ("first_order", True)])
@pytest.mark.parametrize("weight", [None, np.diag([1.0, 1, 1, 0.2, 0.3, 0.4])])
def test_cycles_are_those_of_the_reference(mode: str, first_order: bool, weight: np.ndarray | None) -> None:
    log = Log(seed=3, count=4)
    body = reference_body.RigidBody(INERTIA, reference_body.GravityGradient(INERTIA, 1.0))
    criterion = "trace" if weight is None else "weighted_trace"
    filter_ = el.AttitudeFilter(body_flow(order=4), start(), mode=mode, criterion=criterion, weight=weight)
    expected = ReferenceEllipsoid(start().attitude, start().vector, start().shape)
    time = 0.0
    for k in range(4):
        filter_.predict(log.times[k])
        cycle = reference_filter.cycle(
            body,
            expected,
            time,
            STEP,
            30,
            reference_measurement.Measurement(
                log.reference,
                log.directions[k],
                np.ones(3),
                np.tile(BOUND**2 * np.eye(3), (3, 1, 1)),
                log.rates[k],
                BOUND**2 * np.eye(3),
            ),
            first_order,
            order=4,
            weight=weight,
        )
        predicted = cycle.prediction.ellipsoid
        np.testing.assert_allclose(filter_.attitude, predicted.attitude, atol=1e-9)
        np.testing.assert_allclose(filter_.shape, predicted.shape, rtol=0, atol=1e-8 * np.abs(predicted.shape).max())
        update = filter_.update(**log.at(k), diagnostics=True)
        expected, time = cycle.fusion.ellipsoid, log.times[k]
        # The reference finds its multiplier by golden section: the shape is right to about √ε of it.
        np.testing.assert_allclose(filter_.attitude, expected.attitude, atol=1e-6)
        np.testing.assert_allclose(filter_.vector, expected.angular_velocity, atol=1e-6)
        np.testing.assert_allclose(filter_.shape, expected.shape, rtol=0, atol=1e-6 * np.abs(expected.shape).max())
        assert update.share / (1 - update.share) == pytest.approx(cycle.fusion.multiplier, rel=1e-5)
        if not first_order:  # the reference has P^f before it is seen from the measured center, as the theorem has
            assert update.convergence.contraction == pytest.approx(cycle.convergence.contraction, rel=1e-5)
            assert update.convergence.flow_norm == pytest.approx(cycle.convergence.transition_norm, rel=1e-8)


def test_directions_that_determine_no_attitude_have_no_diagnostics() -> None:
    log = Log(seed=3, count=1)
    measured = log.at(0)
    for chosen, there in (([0], False), ([0, 0], False), ([0, 1], True)):
        filter_ = el.AttitudeFilter(body_flow(), start())
        filter_.predict(log.times[0])
        given = measured | {"directions": log.directions[0][chosen], "reference": log.reference[chosen]}
        update = filter_.update(**given, diagnostics=True)
        assert (update.convergence is not None) is there


@pytest.mark.parametrize("first_order", [False, True])
def test_partial_measurements_are_those_of_the_reference(first_order: bool) -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        root = rng.standard_normal((6, 6)) * 0.05
        center = el.StateEllipsoid(el.exp(rng.standard_normal(3)), rng.standard_normal(3), root @ root.T)
        h = rng.standard_normal((2, 6))
        y = h @ (root @ rng.standard_normal(6)) * 0.3
        r = np.diag(rng.uniform(0.5, 1, 2)) * 1e-3
        filter_ = el.AttitudeFilter(body_flow(), center, mode="first_order" if first_order else "paper")
        filter_.update_linear(y, h, r)
        fused = reference_filter.fuse_linear(
            ReferenceEllipsoid(center.attitude, center.vector, center.shape),
            reference_measurement.LinearMeasurement(y, h, r),
            first_order,
        ).ellipsoid
        np.testing.assert_allclose(filter_.attitude, fused.attitude, atol=1e-6)
        np.testing.assert_allclose(filter_.shape, fused.shape, rtol=0, atol=1e-6 * np.abs(fused.shape).max())


def test_the_gyro_flow_is_that_of_the_reference() -> None:
    rng = np.random.default_rng(6)
    noise, drift = 1e-6 * np.diag([1.0, 2, 3]), 1e-10 * np.diag([3.0, 2, 1])
    shape = 1e-4 * np.eye(6)
    filter_ = el.AttitudeFilter(el.GyroFlow(noise, drift), el.StateEllipsoid(np.eye(3), [0.01, 0.02, 0.03], shape))
    state = reference_gyro.GyroState(np.eye(3), np.array([0.01, 0.02, 0.03]))
    for k in range(5):
        gyro, h = rng.standard_normal(3), rng.uniform(0.1, 0.5)
        filter_.predict(filter_.time + h, gyro=gyro)
        state, shape = reference_gyro.predict(state, shape, gyro[None], h, noise, h**2 * drift)
        np.testing.assert_allclose(filter_.attitude, state.attitude, atol=1e-13, err_msg=f"step {k}")
        np.testing.assert_allclose(filter_.shape, shape, rtol=0, atol=1e-13 * np.abs(shape).max())


def test_a_log_in_one_call_is_its_rows_one_by_one() -> None:
    log = Log(seed=0)
    whole = el.AttitudeFilter(body_flow(order=4), start())
    result = whole.run(log.times, **log.measurements)
    single = el.AttitudeFilter(body_flow(order=4), start())
    for k, time in enumerate(log.times):
        single.predict(time)
        update = single.update(**log.at(k))
        assert np.array_equal(result.shapes[k], single.shape)
        assert np.array_equal(result.attitudes[k], single.attitude)
        assert result.shares[k] == update.share
        assert result.margins[k] == update.margin
    assert np.array_equal(whole.shape, single.shape)
    assert result.used.all()
    assert (result.outcomes == 0).all()
    inside = el.StateEllipsoid(result.attitudes[-1], result.vectors[-1], result.shapes[-1])
    assert inside.contains(log.attitudes[-1], log.rates_true[-1])
    np.testing.assert_allclose(result.half_widths()[-1], whole.extent().half_widths_body, rtol=1e-12)
    np.testing.assert_allclose(result.largest_angles()[-1], whole.extent().largest_angle, rtol=1e-12)


def test_absent_rows_are_predicted_only_and_single_sensors_used_alone() -> None:
    log = Log(seed=1)
    directions, rates = log.directions.copy(), log.rates.copy()
    directions[5], rates[5] = np.nan, np.nan  # nothing
    directions[6] = np.nan  # the rate alone
    rates[7] = np.nan  # directions alone
    directions[8, :2] = np.nan  # one direction and the rate
    filter_ = el.AttitudeFilter(body_flow(order=4), start())
    result = filter_.run(log.times, **(log.measurements | {"directions": directions, "angular_velocity": rates}))
    assert result.outcomes[5] == 1
    assert np.isnan(result.margins[5])
    assert (result.outcomes[6:] == 0).all()
    assert result.used[5:9].tolist() == [
        [False] * 4,
        [False] * 3 + [True],
        [True] * 3 + [False],
        [False] * 2 + [True] * 2,
    ]
    for k in range(20):
        ellipsoid = el.StateEllipsoid(result.attitudes[k], result.vectors[k], result.shapes[k])
        assert ellipsoid.contains(log.attitudes[k], log.rates_true[k])


def test_a_contradiction_names_time_sensor_and_margin_and_leaves_the_filter() -> None:
    log = Log(seed=2)
    filter_ = el.AttitudeFilter(body_flow(order=4), start())
    filter_.run(
        log.times[:10],
        **{k: v[:10] if k in ("directions", "angular_velocity") else v for k, v in log.measurements.items()},
    )
    before = filter_.to_dict()
    with pytest.raises(el.InconsistentMeasurement, match=r"star.*margin -") as caught:
        filter_.update(**(log.at(9) | {"angular_velocity": log.rates[9] + 3}), sensor="star")
    assert caught.value.time == log.times[9]
    assert caught.value.sensor == "star"
    assert caught.value.margin < 0
    assert filter_.to_dict() == before

    rates = log.rates.copy()
    rates[12] += 3
    wrong = log.measurements | {"angular_velocity": rates}
    rest = {k: v[10:] if k in ("directions", "angular_velocity") else v for k, v in wrong.items()}
    with pytest.raises(el.InconsistentMeasurement, match="row 2"):
        filter_.run(log.times[10:], **rest)
    assert filter_.to_dict() == before
    result = filter_.run(log.times[10:], **rest, on_inconsistent="skip")
    assert result.outcomes.tolist() == [0, 0, 2] + [0] * 7
    assert not result.used[2].any()
    assert result.margins[2] < 0


def test_storing_keeps_every_bit() -> None:
    log = Log(seed=4)
    weight = np.diag([1.0, 1, 1, 0.3, 0.3, 0.3])
    filter_ = el.AttitudeFilter(body_flow(order=4), start(), criterion="weighted_trace", weight=weight, mode="paper")
    filter_.run(
        log.times[:5],
        **{k: v[:5] if k in ("directions", "angular_velocity") else v for k, v in log.measurements.items()},
    )
    filter_.predict(log.times[5])
    for copy in (pickle.loads(pickle.dumps(filter_)), el.AttitudeFilter.from_json(filter_.to_json())):
        assert copy.to_dict() == filter_.to_dict()
        copy.update(**log.at(5))
    gyro = el.AttitudeFilter(el.GyroFlow(1e-3, 1e-6), start(), time=7.5)
    assert el.AttitudeFilter.from_json(gyro.to_json()).to_dict() == gyro.to_dict()
    fields = json.loads(gyro.to_json()) | {"format": 99}
    with pytest.raises(ValueError, match="format is 99"):
        el.AttitudeFilter.from_dict(fields)
    ellipsoid = filter_.ellipsoid
    assert pickle.loads(pickle.dumps(ellipsoid)).to_dict() == ellipsoid.to_dict()


class Pendulum:
    """A potential written in Python."""

    def __init__(self, fail_at: float = np.inf) -> None:
        self.fail_at = fail_at

    def energy(self, attitude: np.ndarray, time: float) -> float:
        return -0.3 * 9.81 * attitude[2, 2]

    def torque(self, attitude: np.ndarray, time: float) -> np.ndarray:
        if time > self.fail_at:
            raise RuntimeError("no torque any more")
        return 0.3 * 9.81 * np.cross([0, 0, 1], attitude[2])

    def torque_jacobian(self, attitude: np.ndarray, time: float) -> np.ndarray:
        return 0.3 * 9.81 * reference_so3.hat(np.array([0.0, 0, 1])) @ reference_so3.hat(attitude[2])


def test_a_potential_written_in_python_serves_the_filter_and_its_exception_comes_out() -> None:
    body = el.RigidBody([0.13, 0.28, 0.17])
    own = el.AttitudeFilter(el.RigidBodyFlow(body, Pendulum(), step=0.005), start())
    core = el.AttitudeFilter(el.RigidBodyFlow(body, el.UniformGravity(1, 9.81, [0, 0, 0.3]), step=0.005), start())
    own.predict(0.1)
    core.predict(0.1)
    np.testing.assert_allclose(own.shape, core.shape, rtol=1e-12)
    failing = el.AttitudeFilter(el.RigidBodyFlow(body, Pendulum(fail_at=0.05), step=0.005), start())
    with pytest.raises(RuntimeError, match="no torque any more"):
        failing.predict(0.1)
    assert failing.time == 0
    failing.predict(0.04)  # and it goes on
    with pytest.raises(TypeError, match="Pendulum cannot be stored as JSON"):
        own.to_json()
    assert pickle.loads(pickle.dumps(own)).time == own.time


def test_a_filter_refuses_two_threads_at_once() -> None:
    entered, leave = threading.Event(), threading.Event()

    class Waiting(Pendulum):
        def torque(self, attitude: np.ndarray, time: float) -> np.ndarray:
            entered.set()
            leave.wait(10)
            return super().torque(attitude, time)

    filter_ = el.AttitudeFilter(el.RigidBodyFlow(el.RigidBody(INERTIA), Waiting(), step=0.01), start())
    thread = threading.Thread(target=filter_.predict, args=(0.01,))
    thread.start()
    assert entered.wait(10)
    with pytest.raises(RuntimeError, match="in use by another thread"):
        filter_.predict(0.01)
    leave.set()
    thread.join()
    assert filter_.time == 0.01


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda f, m: f.predict(-1.0), ValueError, "time must not go backwards"),
        (lambda f, m: f.predict(np.nan), ValueError, "time must be finite"),
        (lambda f, m: f.predict(1.0, gyro=[0, 0, 0]), TypeError, "gyro is the input of a GyroFlow"),
        (lambda f, m: f.predict(1.0, control_torque=[0, 0]), ValueError, r"control_torque must have the shape \(3,\)"),
        (lambda f, m: f.update(), ValueError, "needs directions, angular_velocity or both"),
        (lambda f, m: f.update(**(m | {"bounds": 0.0})), ValueError, "bounds must be positive, but is 0"),
        (lambda f, m: f.update(**(m | {"bounds": [0.1, -0.1, 0.1]})), ValueError, r"bounds\[1\] must be positive"),
        (
            lambda f, m: f.update(**(m | {"bounds": [0.1, 0.1]})),
            ValueError,
            "bounds must be a number or",
        ),
        (lambda f, m: f.update(**(m | {"rate_bound": None})), ValueError, "angular_velocity needs rate_bound"),
        (
            lambda f, m: f.update(**(m | {"reference": np.eye(2)})),
            ValueError,
            r"reference must have the shape \(3, 3\)",
        ),
        (lambda f, m: f.update(**(m | {"directions": np.zeros((3, 3))})), ValueError, r"directions\[0\] has no length"),
        (lambda f, m: f.update(**(m | {"weights": [1, 0, 1]})), ValueError, r"weights\[1\] is 0"),
        (lambda f, m: f.update_attitude(2 * np.eye(3), 0.1), ValueError, "attitude must be a rotation"),
        (lambda f, m: f.update_linear([0.0], np.zeros((1, 5)), [[1.0]]), ValueError, r"h must have the shape \(1, 6\)"),
        (lambda f, m: f.angular_velocity_estimate([0, 0, 0]), TypeError, "is for a GyroFlow"),
        (lambda f, m: f.run([0.0, 1.0, 0.5]), ValueError, r"times\[2\] is 0.5 s after 1 s"),
        (lambda f, m: f.run([0.0], on_inconsistent="ignore"), ValueError, "on_inconsistent must be"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(call, error, message) -> None:
    filter_ = el.AttitudeFilter(body_flow(), start())
    before = filter_.to_dict()
    with pytest.raises(error, match=message):
        call(filter_, Log(seed=0, count=1).at(0))
    assert filter_.to_dict() == before


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: el.AttitudeFilter(body_flow(), start(), mode="exact"), "mode must be"),
        (lambda: el.AttitudeFilter(body_flow(), start(), criterion="area"), "criterion must be"),
        (lambda: el.AttitudeFilter(body_flow(), start(), criterion="weighted_trace"), "needs weight"),
        (lambda: el.AttitudeFilter(body_flow(), start(), weight=np.eye(6)), "weight goes with criterion"),
        (lambda: body_flow(order=3), "order must be 2, 4, 6 or 8, but is 3"),
        (lambda: el.RigidBodyFlow(el.RigidBody(INERTIA), step=0.0), "step must be positive, but is 0"),
        (lambda: body_flow(unknown_torque=-1.0), "unknown_torque must not be negative, but is -1"),
        (lambda: el.GyroFlow(-1.0), "noise must not be negative"),
        (lambda: el.StateEllipsoid(np.eye(3), np.zeros(3), -np.eye(6)), "shape: the matrix is not positive definite"),
    ],
)
def test_what_makes_no_filter_is_refused_by_name(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_the_gyro_flow_gives_the_rate_with_its_bound() -> None:
    filter_ = el.AttitudeFilter(
        el.GyroFlow(1e-3), el.StateEllipsoid(np.eye(3), [0.1, 0, 0], np.diag([1e-4] * 3 + [4e-6] * 3))
    )
    rate = filter_.angular_velocity_estimate([1.0, 2.0, 3.0])
    np.testing.assert_allclose(rate.center, [0.9, 2, 3])
    np.testing.assert_allclose(rate.half_widths(), 3e-3, rtol=1e-12)  # 2e-3 of the bias and 1e-3 of the noise


def test_what_is_no_stored_filter() -> None:
    fields = el.AttitudeFilter(body_flow(), start()).to_dict()
    del fields["mode"]
    with pytest.raises(ValueError, match="needs the key 'mode'"):
        el.AttitudeFilter.from_dict(fields)
    with pytest.raises(TypeError, match="dictionary, not list"):
        el.AttitudeFilter.from_json("[]")
