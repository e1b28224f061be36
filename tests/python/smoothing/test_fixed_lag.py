"""Fixed lag: the truth is inside, no set is wider than the filter's, and none much wider than a whole window's."""

import dataclasses
import pickle

import elliptude as el
import numpy as np
import pytest
from elliptude import smoothing
from elliptude.configuration import Configuration
from elliptude.results import CLAIMS
from elliptude.smoothing import FixedLagSmoother
from reference import so3
from smoothing_inputs import gyro_configuration, gyro_log


def streamed(log, configuration, lag):
    """A smoothed run over a log, a smoother that was given its rows, and what the smoother's filter knew at each."""
    run = smoothing.smoothed_run(log, configuration)
    given = run.forward.given
    settings = configuration.estimator
    smoother = FixedLagSmoother(
        el.GuaranteedFilter(
            given.flow,
            run.forward.start,
            time=float(given.times[0]),
            criterion=settings.criterion,
            policy=settings.policy,
            vector_bound=given.vector_bound,
            estimate_vector=given.estimates_vector,
        ),
        lag,
    )
    known = []
    for k, time in enumerate(given.times):
        if k > 0:
            smoother.predict(float(time), gyro=given.motion["gyro"][k - 1])
        seen = np.isfinite(given.measured["directions"][k, :, 0])
        if seen.any():
            smoother.update(
                given.measured["directions"][k, seen],
                given.measured["reference"][k, seen],
                given.measured["bounds"][k, seen],
            )
        known.append(smoother.filter.ellipsoid)
    return run, smoother, known


def quiet(criterion="volume", *, estimates_bias=True):
    """A configuration for a gyro with little noise, so that what is learned later says something of what was before."""
    tables = gyro_configuration(estimator={"mode": "guaranteed", "criterion": criterion}).model_dump(exclude_unset=True)
    tables["flow"] |= {"noise_deg_per_s": np.rad2deg(0.0002), "estimate_bias": estimates_bias}
    return Configuration.model_validate(tables)


@pytest.mark.parametrize(("criterion", "share"), [("volume", 0.985), ("trace", 0.95)])
def test_the_last_rows_of_a_gyros_log(criterion, share):
    rows, lag = 120, 60
    log = gyro_log(count=rows, noise=0.0002)
    run, smoother, known = streamed(log, quiet(criterion), lag)
    assert smoother.moments == lag + 1
    # The filter is the one of the pass forward.
    np.testing.assert_array_equal(known[-1].shape, run.forward.sets.shapes[-1])
    angles, forward, whole = [], [], []
    for age in range(lag + 1):
        row = rows - 1 - age
        found = smoother.smoothed(age)
        assert found.time == log.times[row]
        assert found.claim == "unconditional"
        assert found.ellipsoid.quadratic_form(log.true_attitudes[row], log.true_vectors[row]) <= 1.0
        assert found.uses_future == (not np.array_equal(found.ellipsoid.shape, known[row].shape))
        away = log.true_vectors[row] - found.vector
        assert away @ np.linalg.solve(found.vector_shape, away) <= 1.0
        widths = [np.linalg.eigvalsh(shape)[-1] for shape in (found.vector_shape, known[row].shape[3:, 3:])]
        assert widths[0] <= widths[1] * (1.0 + 1e-12)
        angles.append(found.ellipsoid.extent().largest_angle)
        forward.append(known[row].extent().largest_angle)
        whole.append(run.sets.extents().largest_angles[row])
        assert angles[-1] <= forward[-1] * (1.0 + 1e-12)
    assert np.mean(angles) < share * np.mean(forward)
    assert np.mean(angles) < 1.03 * np.mean(whole)


def test_a_bias_that_is_left_to_its_bound():
    log = gyro_log(count=120, noise=0.0002)
    _, smoother, known = streamed(log, quiet(estimates_bias=False), 60)
    gains = 0
    for age in range(61):
        row = 119 - age
        found = smoother.smoothed(age).ellipsoid
        error = 2.0 * el.cayley_inverse(found.attitude.T @ log.true_attitudes[row])
        assert error @ np.linalg.solve(found.shape[:3, :3], error) <= 1.0
        np.testing.assert_array_equal(found.shape[3:], known[row].shape[3:])
        gains += found.extent().largest_angle < known[row].extent().largest_angle
    assert gains >= 15


def test_a_body_with_a_wheel_and_a_potential():
    body = el.RigidBody(np.diag([1.0, 2.0, 2.5]))
    orbit = so3.exp(np.array([0.3, -0.2, 0.5]))
    flow = el.GuaranteedRigidBodyFlow(body, el.GravityGradient(body, 0.4, orbit), step=0.05)
    start = el.StateEllipsoid(np.eye(3), np.array([0.2, -0.1, 0.3]), 1e-6 * np.eye(6), chart="gibbs")
    motion = {"control_torque": np.array([0.1, 0.0, -0.05]), "wheel_momentum": np.array([0.0, 0.3, 0.1])}
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, start, time=-0.7), 3)
    truth = start.attitude
    for k in range(2):
        smoother.predict(-0.7 + 0.2 * (k + 1), **motion)
    # The center of the predicted set is the motion of the first center, which is a state that is possible at both ends.
    last = smoother.filter.ellipsoid
    smoother.update(attitude=last.attitude, attitude_bound=1e-5)
    found = smoother.smoothed(2)
    assert found.uses_future
    assert found.ellipsoid.quadratic_form(truth, start.vector) <= 1.0
    assert found.ellipsoid.extent().largest_angle < 0.7 * start.extent().largest_angle
    np.testing.assert_array_equal(found.vector_shape, start.shape[3:, 3:])  # the set is wider there


def test_turns():
    flow = el.GuaranteedGyroFlow(0.0, interval_rate="mean")
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, vector_bound=0.01), 2)
    turn = np.array([0.3, 0.1, -0.4])
    smoother.predict_turn(1.0, turn, 0.001)
    attitude = so3.exp(turn)
    smoother.update(attitude=attitude, attitude_bound=1e-3)
    found = smoother.smoothed(1)
    assert found.claim == "unconditional"
    assert found.uses_future
    assert found.ellipsoid.quadratic_form(np.eye(3), np.zeros(3)) <= 1.0
    assert found.ellipsoid.extent().largest_angle < 0.05


def test_rows_before_the_first_set_get_one():
    log = gyro_log(count=40)
    directions = log.directions.copy()
    directions[:20] = np.nan
    _, smoother, known = streamed(dataclasses.replace(log, directions=directions), gyro_configuration(), 39)
    assert known[10] is None
    found = smoother.smoothed(29)
    assert found.claim == "unconditional"
    assert found.ellipsoid.quadratic_form(log.true_attitudes[10], log.true_vectors[10]) <= 1.0


def square(policy):
    """An attitude that fits the ellipsoid about a prediction, but to which no state of the beginning leads."""
    noise = np.diag([1e-4, 1e-12, 1e-12])
    shape = 1e-10 * np.eye(6)
    shape[1, 1] = 1e-4
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), shape, chart="gibbs")
    flow = el.GuaranteedGyroFlow(noise, interval_rate="mean")
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, start, policy=policy), 4)
    smoother.predict(1.0, gyro=np.zeros(3))
    report = smoother.update(attitude=so3.exp(np.array([0.013, 0.0, 0.0])), attitude_bound=1e-4)
    assert not report.dropped
    return smoother, start


def test_a_past_and_a_future_that_contradict_one_another():
    smoother, _ = square("raise")
    with pytest.raises(el.InconsistentMeasurement):
        smoother.smoothed(1)
    assert not smoother.has_contradicted
    assert smoother.smoothed(0).claim == "unconditional"
    smoother, start = square("drop_measurement")
    assert smoother.smoothed(0).claim == "unconditional"
    found = smoother.smoothed(1)
    assert found.claim == "conditional"
    assert not found.uses_future
    np.testing.assert_array_equal(found.ellipsoid.shape, start.shape)
    assert smoother.has_contradicted
    assert smoother.smoothed(0).claim == "conditional"
    assert smoother.filter.claim == "unconditional"
    smoother.forget()
    assert not smoother.has_contradicted
    assert smoother.moments == 1
    assert smoother.smoothed(0).claim == CLAIMS[2]


def test_what_rests_on_a_dropped_measurement():
    flow = el.GuaranteedGyroFlow(0.001)
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, vector_bound=0.01, policy="drop_measurement"), 2)
    smoother.predict(1.0, gyro=np.zeros(3))
    references = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.8, 0.0]])
    seen = references.copy()
    seen[3] = [0.0, 0.6, 0.8]
    assert smoother.update(seen, references, 0.02).dropped
    assert smoother.filter.claim == "conditional"
    found = smoother.smoothed(1)
    assert found.claim == "conditional"
    assert found.uses_future


@pytest.mark.parametrize("noise", [0.03, 0.003])
def test_a_lie_that_is_found_out_late_makes_no_earlier_set_wrong(noise):
    """The set is wide when the lie comes, which fits: it is the next measurement that contradicts.

    By the smaller noise what is known after the dispute has nothing in common with the lie: that is no new one.
    """
    flow = el.GuaranteedGyroFlow(noise, interval_rate="mean")
    settings = {"policy": "drop_measurement", "regain_after": 1, "estimate_vector": False}
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, vector_bound=1e-5, **settings), 8)
    claims = []
    for time, angle, within in (
        (0, 0.01, 0.1),
        (1, 0.01, 0.1),
        (2, 0.09, 1e-3),
        (3, 0, 1e-3),
        (4, 0, 1e-3),
        (5, 0, 1e-3),
    ):
        if time > 0:
            smoother.predict(float(time), gyro=np.zeros(3))
        smoother.update(attitude=so3.exp(np.array([angle, 0.0, 0.0])), attitude_bound=within)
        claims.append(smoother.filter.claim)
        for age in range(time + 1):
            found = smoother.smoothed(age)
            if time > 2 and age != time - 2 and found.claim == "unconditional":
                error = so3.log(found.ellipsoid.attitude)
                assert np.linalg.norm(error) <= np.sqrt(found.ellipsoid.shape[0, 0]), (time, age)
        if time >= 2:
            assert smoother.smoothed(time).claim == "unconditional"
    assert claims == ["unconditional"] * 3 + ["conditional"] * 2 + ["unconditional"]
    assert not smoother.has_contradicted
    for age in range(6):
        found = smoother.smoothed(age)
        is_shown_to_lie = noise == 0.003 and age == 3
        assert found.claim == ("conditional" if is_shown_to_lie else "unconditional")
        if is_shown_to_lie or age != 3:
            assert np.linalg.norm(so3.log(found.ellipsoid.attitude)) <= np.sqrt(found.ellipsoid.shape[0, 0])


def test_a_contradiction_while_no_attitude_is_known_is_one():
    """The attitude is forgotten, the rate contradicts, and at the next update the claim is regained."""
    flow = el.GuaranteedRigidBodyFlow(el.RigidBody([1.0, 1.0, 1.0]), step=0.05)
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, policy="restart", regain_after=1), 8)
    rate = np.array([0.73, 0.0, 0.0])

    def seen(time, attitude=None, **measured):
        if time > 0.0:
            smoother.predict(time)
        if attitude is not None:
            measured |= {"attitude": so3.exp(attitude)}
        return smoother.update(**measured)

    seen(0.0, np.zeros(3), attitude_bound=0.028, angular_velocity=np.zeros(3), rate_bound=0.82)
    seen(0.1, np.zeros(3), attitude_bound=1e-3)  # a lie, which fits: the body has turned by 0.073 rad
    update = seen(1.23, angular_velocity=rate, rate_bound=0.01)
    assert smoother.filter.claim == "none"
    assert update.margin < 0.0
    seen(1.33, 1.33 * rate, attitude_bound=1e-3, angular_velocity=rate, rate_bound=0.25)
    assert smoother.filter.claim == "unconditional"
    found = smoother.smoothed(3)
    assert found.claim == "unconditional"
    assert found.ellipsoid.quadratic_form(np.eye(3), rate) <= 1.0


def test_a_smaller_set_that_reaches_farther_is_not_shown():
    """Thin about one axis, it is wider about the others: an ellipsoid of the least volume."""
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), np.diag([0.01] * 3 + [1e-10] * 3), chart="gibbs")
    smoother = FixedLagSmoother(el.GuaranteedFilter(el.GuaranteedGyroFlow(1e-6), start), 2)
    smoother.predict(1.0, gyro=np.zeros(3))
    smoother.update(attitude=np.eye(3), attitude_bound=np.diag([1e-6, 0.2, 0.2]))
    assert smoother.filter.ellipsoid.extent().largest_angle > start.extent().largest_angle
    found = smoother.smoothed(1)
    assert not found.uses_future
    np.testing.assert_array_equal(found.ellipsoid.shape, start.shape)


def test_what_is_refused():
    flow = el.GuaranteedGyroFlow(0.01)
    with pytest.raises(ValueError, match="at least one moment"):
        FixedLagSmoother(el.GuaranteedFilter(flow), 0)
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, vector_bound=0.1), 2)
    smoother.predict(0.0, gyro=np.zeros(3))
    assert smoother.moments == 1
    with pytest.raises(IndexError, match="1 moments"):
        smoother.smoothed(1)
    with pytest.raises(IndexError):
        smoother.smoothed(-1)
    with pytest.raises(ValueError, match="time"):
        smoother.predict(-1.0, gyro=np.zeros(3))
    assert smoother.moments == 1
    for time in range(1, 6):
        smoother.predict(float(time), gyro=np.zeros(3))
    assert smoother.moments == 3
    assert smoother.smoothed(2).time == 3.0


def test_turns_over_no_time_are_moments_of_their_own():
    """Two turns with one stamp, and then an attitude: it is brought back over both."""
    flow = el.GuaranteedGyroFlow(1e-4, interval_rate="mean")
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), np.diag([1e-2] * 3 + [1e-6] * 3), chart="gibbs")
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, start, vector_bound=1e-3), 4)
    attitude = np.eye(3)
    for turn in ([0.1, 0.0, 0.0], [0.05, 0.06, 0.0]):
        smoother.predict_turn(1.0, turn, 1e-4)
        attitude = attitude @ el.exp(turn)
    assert smoother.moments == 3
    smoother.update(attitude=attitude, attitude_bound=1e-3)
    first = smoother.smoothed(2)
    assert first.claim == "unconditional"
    assert first.uses_future
    assert first.ellipsoid.contains(np.eye(3), np.zeros(3))
    assert first.ellipsoid.extent().largest_angle < 2e-3


def require_refused(smoother, message):
    """Whatever needs the filter as the smoother left it says that it is not."""
    for call in (
        lambda: smoother.predict(3.0, gyro=[0.0, 0.0, 0.1]),
        lambda: smoother.predict_turn(3.0, [0.0, 0.0, 0.1], 0.01),
        lambda: smoother.update(np.eye(3), np.eye(3), 0.1),
        lambda: smoother.smoothed(0),
    ):
        with pytest.raises(ValueError, match=message):
            call()


def test_a_filter_that_was_predicted_by_itself_is_refused():
    flow = el.GuaranteedGyroFlow(1e-4, interval_rate="mean")
    filter_ = el.GuaranteedFilter(flow, vector_bound=1e-3)
    smoother = FixedLagSmoother(filter_, 4)
    smoother.predict(1.0, gyro=[0.0, 0.0, 0.1])
    filter_.predict(2.0, gyro=[0.0, 0.0, 0.1])
    require_refused(smoother, r"filter is at 2\.000000 s, but its smoother left it at 1\.000000 s")


@pytest.mark.parametrize(
    "use",
    [
        lambda filter_: filter_.forget(),
        lambda filter_: filter_.update(attitude=np.eye(3), attitude_bound=1e-3),
        lambda filter_: filter_.update(attitude=np.eye(3), attitude_bound=0.1),
        lambda filter_: filter_.update_linear([0.0], [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]], [[1e-6]]),
        lambda filter_: filter_.predict_turn(1.0, [0.0, 0.0, 0.1], 1e-3),
    ],
    ids=["forget", "update", "update that leaves the set", "linear update", "turn over no time"],
)
def test_a_filter_that_others_used_at_the_same_time_is_refused(use):
    flow = el.GuaranteedGyroFlow(1e-4, interval_rate="mean")
    filter_ = el.GuaranteedFilter(flow, vector_bound=1e-3)
    smoother = FixedLagSmoother(filter_, 4)
    smoother.predict(1.0, gyro=[0.0, 0.0, 0.1])
    smoother.update(attitude=np.eye(3), attitude_bound=1e-2)
    use(filter_)
    require_refused(smoother, r"filter is not as its smoother left it at 1\.000000 s")
    smoother.forget()
    assert smoother.moments == 1
    smoother.predict(3.0, gyro=[0.0, 0.0, 0.1])


def test_a_filter_is_as_it_was_left_after_an_update_that_raises():
    smoother, _ = square("raise")
    known = smoother.filter.ellipsoid
    with pytest.raises(el.InconsistentMeasurement):
        smoother.update(attitude=so3.exp(np.array([1.0, 0.0, 0.0])), attitude_bound=1e-4)
    assert smoother.smoothed(0).ellipsoid == known


def stored_without(monkeypatch, smoother, *names):
    """The smoother as pickle brings it back if it was stored before it had some of its fields."""
    kept = {name: value for name, value in smoother.__getstate__().items() if name not in names}
    with monkeypatch.context() as patch:
        patch.setattr(FixedLagSmoother, "__getstate__", lambda _: kept)
        return pickle.loads(pickle.dumps(smoother))


def test_a_smoother_that_was_stored_before_it_looked_at_its_filter_goes_on(monkeypatch):
    smoother, _ = square("drop_measurement")
    old = stored_without(monkeypatch, smoother, "_left")
    for one in (smoother, old):
        one.predict(9.0, gyro=[0.0, 0.0, 0.1])
    assert old.smoothed(1).ellipsoid == smoother.smoothed(1).ellipsoid
    assert pickle.loads(pickle.dumps(old)).smoothed(1).ellipsoid == old.smoothed(1).ellipsoid


def test_one_whose_filter_others_had_used_is_refused(monkeypatch):
    """Its moments lead to another set: the smoother had not noticed when it was stored."""
    smoother, _ = square("drop_measurement")
    smoother.filter.update(attitude=np.eye(3), attitude_bound=1e-3)
    old = stored_without(monkeypatch, smoother, "_left")
    with pytest.raises(ValueError, match="filter is not as its smoother left it"):
        old.smoothed(1)
    old.forget()
    assert old.moments == 1


def test_one_that_lacks_more_is_refused(monkeypatch):
    smoother, _ = square("drop_measurement")
    with pytest.raises(ValueError, match="another version of elliptude stored: it has no '_has_contradicted'"):
        stored_without(monkeypatch, smoother, "_left", "_has_contradicted")
    del vars(smoother._moments[0])["contradictions"]
    with pytest.raises(ValueError, match="another version of elliptude stored: it has no 'contradictions'"):
        stored_without(monkeypatch, smoother, "_left")
