"""Single questions to what an update leaves possible, against the reference, SciPy and sampled states."""

import elliptude as el
import numpy as np
import pytest
import scipy.optimize
from reference import quadrics
from reference import update_constraints as reference
from scipy.spatial.transform import Rotation

BOUND = np.deg2rad(7.0)  # of directions, rad, and of the rate, rad/s


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def rotation(gamma):
    gamma = np.asarray(gamma, dtype=np.float64)
    return Rotation.from_quat(
        np.concatenate([np.ones((*gamma.shape[:-1], 1)), 0.5 * gamma], axis=-1), scalar_first=True
    )


def gibbs(error):
    quaternion = error.as_quat(scalar_first=True)
    return 2.0 * quaternion[..., 1:] / quaternion[..., :1]


class Scene:
    """A body's filter, with attitude and rate mixed, that has seen directions and a rate; the truth satisfies all."""

    def __init__(self, seed, count=2):
        draws = np.random.default_rng(seed)
        factor = draws.standard_normal((6, 6))
        shape = factor @ factor.T + 0.1 * np.eye(6)
        widths = draws.uniform(0.1, 0.4, 6) / np.sqrt(np.diag(shape))
        self.shape = shape * np.outer(widths, widths)
        self.prior, self.rate = Rotation.random(rng=draws), draws.standard_normal(3)
        self.truth = np.linalg.cholesky(self.shape) @ (0.8 * unit(draws.standard_normal(6)) * draws.uniform())
        attitude = self.attitude(self.truth)
        self.references = unit(draws.standard_normal((count, 3)))
        off = BOUND * unit(draws.standard_normal((count, 3))) * 0.9 * draws.uniform(size=(count, 1))
        seen = attitude.inv().apply(self.references)
        self.bodies = np.array([Rotation.from_rotvec(o).apply(s) for o, s in zip(off, seen, strict=True)])
        self.measured = self.rate + self.truth[3:] + 0.9 * BOUND * unit(draws.standard_normal(3)) * draws.uniform()
        start = el.StateEllipsoid(self.prior.as_matrix(), self.rate, self.shape, chart="gibbs")
        self.filter = el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(el.RigidBody([1.0, 2.8, 2.0]), step=0.1), start)
        seen = (self.bodies, self.references, BOUND) if count else ()
        self.filter.update(*seen, angular_velocity=self.measured, rate_bound=BOUND)
        self.center = Rotation.from_matrix(self.filter.ellipsoid.attitude)

    def attitude(self, y):
        return self.prior * rotation(y[..., :3])

    def turned(self, y, axis):
        return 2.0 * np.arctan(0.5 * gibbs(self.center.inv() * self.attitude(y)) @ axis)

    def slacks(self, y):
        """How much is left to each constraint, of errors about the prior's center, shape (k, ...)."""
        slacks = [1.0 - np.sum(y @ np.linalg.inv(self.shape) * y, axis=-1)]
        attitude = self.attitude(y)
        for e, b in zip(self.references, self.bodies, strict=True):
            cosine = np.sum(attitude.inv().apply(e) * b, axis=-1)
            slacks.append((cosine - np.cos(BOUND)) / (1.0 - np.cos(BOUND)))
        slacks.append(1.0 - np.sum((self.rate + y[..., 3:] - self.measured) ** 2, axis=-1) / BOUND**2)
        return np.array(slacks)

    def constraints(self):
        center = self.prior.as_matrix()
        found = [quadrics.Quadric(np.linalg.inv(self.shape), np.zeros(6), 1.0)]
        for e, b in zip(self.references, self.bodies, strict=True):
            found.append(reference.of_attitude(quadrics.cone(center, e, b, BOUND)))
        found.append(reference.of_vector(self.measured - self.rate, BOUND**2 * np.eye(3)))
        return found

    def farthest(self, question, draws):
        """The largest answer that SLSQP finds, from several starts, among states that satisfy all."""
        best = -np.inf
        factor = np.linalg.cholesky(self.shape)
        for start in [self.truth, *(factor @ (0.3 * draws.standard_normal((6, 3)))).T]:
            found = scipy.optimize.minimize(
                lambda u: -question(factor @ u),
                np.linalg.solve(factor, start),
                method="SLSQP",
                constraints={"type": "ineq", "fun": lambda u: self.slacks(factor @ u)},
                options={"maxiter": 100, "ftol": 1e-10},
            )
            if np.isfinite(found.x).all() and self.slacks(factor @ found.x).min() >= -1e-8:
                best = max(best, -float(found.fun))
        return best


@pytest.mark.parametrize("count", [0, 2, 3])
def test_answers_are_those_of_the_reference(count):
    for seed in range(3):
        scene = Scene(10 * count + seed, count)
        draws = np.random.default_rng(seed)
        axis = unit(draws.standard_normal(3))
        constraints = scene.constraints()
        least, most = reference.turn_about(constraints, axis, gibbs(scene.prior.inv() * scene.center))
        turn = scene.filter.turn_about(2.0 * axis)
        assert turn == pytest.approx((least, most), abs=0.01 * (most - least))
        rate = scene.filter.vector_along(axis)
        least, most = reference.extent_along(constraints, np.concatenate([np.zeros(3), axis]), scene.truth)
        assert rate == pytest.approx((scene.rate @ axis + least, scene.rate @ axis + most), abs=0.01 * (most - least))


@pytest.mark.parametrize("criterion", ["volume", "trace"])
def test_the_own_set_is_as_small_as_the_references(criterion):
    for seed in range(2):
        scene = Scene(40 + seed)
        own = scene.filter.attitude_set(criterion)
        center, shape = reference.own_set(scene.constraints(), criterion, scene.truth)
        size = (lambda p: np.cbrt(np.linalg.det(p))) if criterion == "volume" else np.trace
        # About its own center the reference's shape is turned and stretched, and a little of second order.
        g = 0.5 * center
        onto = (np.eye(3) - np.cross(g, np.eye(3)).T) / (1.0 + g @ g)
        assert size(own.shape) == pytest.approx(size(onto @ shape @ onto.T), rel=0.05)
        assert size(own.shape) < size(scene.filter.ellipsoid.shape[:3, :3])


@pytest.mark.parametrize("seed", range(6))
def test_nothing_is_farther_and_something_nearly_as_far(seed):
    scene = Scene(70 + seed, 2 + seed % 2)
    draws = np.random.default_rng(seed)
    axis = unit(draws.standard_normal(3))
    turn, rate = scene.filter.turn_about(axis), scene.filter.vector_along(axis)
    slip = 1e-6  # SLSQP keeps constraints to 1e-8
    most = scene.farthest(lambda y: scene.turned(y, axis), draws)
    least = -scene.farthest(lambda y: -scene.turned(y, axis), draws)
    assert turn.least - slip <= least < most <= turn.most + slip
    assert turn.most - turn.least <= 1.03 * (most - least)
    most = scene.farthest(lambda y: (scene.rate + y[3:]) @ axis, draws)
    least = -scene.farthest(lambda y: -(scene.rate + y[3:]) @ axis, draws)
    assert rate.least - slip <= least < most <= rate.most + slip
    assert rate.most - rate.least <= 1.03 * (most - least)


def test_no_sampled_state_is_outside():
    inside = 0
    for seed in range(8):
        scene = Scene(90 + seed)
        draws = np.random.default_rng(seed)
        axis = unit(draws.standard_normal(3))
        turn, rate = scene.filter.turn_about(axis), scene.filter.vector_along(axis)
        ball = unit(draws.standard_normal((200_000, 6))) * draws.uniform(size=(200_000, 1)) ** (1.0 / 6.0)
        y = ball @ np.linalg.cholesky(scene.shape).T
        y = np.vstack([scene.truth, y[(scene.slacks(y) >= 0.0).all(axis=0)]])
        inside += len(y)
        turned, rates = scene.turned(y, axis), (scene.rate + y[:, 3:]) @ axis
        assert ((turn.least <= turned) & (turned <= turn.most)).all()
        assert ((rate.least <= rates) & (rates <= rate.most)).all()
        for criterion in ("volume", "trace"):
            own = scene.filter.attitude_set(criterion)
            gamma = gibbs(Rotation.from_matrix(own.attitude).inv() * scene.attitude(y))
            assert (np.sum(gamma @ np.linalg.inv(own.shape) * gamma, axis=1) <= 1.0 + 1e-9).all()
    assert inside > 2000


def test_after_a_prediction_the_answers_are_the_sets():
    scene = Scene(3)
    before = scene.filter.turn_about([0, 0, 1])
    scene.filter.predict(0.0)
    after = scene.filter.turn_about([0, 0, 1])
    half = 2.0 * np.arctan(0.5 * np.sqrt(scene.filter.ellipsoid.shape[2, 2]))
    assert after == pytest.approx((-half, half), rel=0.01)
    assert before.most - before.least < after.most - after.least


def test_a_bias_that_is_only_bounded_keeps_its_bound():
    flow = el.GuaranteedGyroFlow(0.01)
    known = el.GuaranteedFilter(flow, vector_bound=([0.1, 0.0, 0.0], 0.02), estimate_vector=False)
    known.update([[0, 0, 1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0]], [0.1, 0.2])
    assert known.vector_along([1, 0, 0]) == pytest.approx((0.08, 0.12), rel=0.01)
    bounds = known.bounds([0, 0, 1])
    center = Rotation.from_matrix(known.ellipsoid.attitude)
    turn = known.turn_about(center.inv().apply([0, 0, 1]))
    assert turn == pytest.approx((bounds.heading_from, bounds.heading_to), rel=0.01)


def test_without_an_attitude_there_is_no_answer():
    empty = el.GuaranteedFilter(el.GuaranteedGyroFlow(0.01), vector_bound=0.1)
    assert empty.turn_about([0, 0, 1]) is None
    assert empty.vector_along([0, 0, 1]) is None
    assert empty.attitude_set() is None


@pytest.mark.parametrize("wrong", [[0.0, 0.0, 0.0], [0.0, np.nan, 1.0], [1.0, 0.0], "up"])
def test_an_axis_that_is_none(wrong):
    scene = Scene(1)
    with pytest.raises((ValueError, TypeError), match="axis"):
        scene.filter.turn_about(wrong)
    with pytest.raises((ValueError, TypeError), match="direction"):
        scene.filter.vector_along(wrong)


def test_a_criterion_that_is_none():
    with pytest.raises(ValueError, match=r"criterion must be 'volume' or 'trace', not 'weight'"):
        Scene(1).filter.attitude_set("weight")
