"""Bounds of tilt, heading and angle by themselves, against attitudes that satisfy all constraints."""

import elliptude as el
import numpy as np
import pytest
import scipy.optimize
from reference import attitude_bounds as reference
from reference import quadrics
from scipy.spatial.transform import Rotation

UP = np.array([0.0, 0.0, 1.0])
TINY = 1e-9


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def tilt_and_heading(center, attitude):
    """Tilt, heading and angle of an attitude as seen from another, by swing and twist in the frame."""
    turn = attitude * center.inv()
    twist = turn.as_quat(scalar_first=True)
    heading = 2.0 * np.arctan2(twist[..., 3], twist[..., 0])
    heading -= 2.0 * np.pi * np.round(heading / (2.0 * np.pi))
    moved = turn.apply(UP)
    tilt = np.arctan2(np.hypot(moved[..., 0], moved[..., 1]), moved[..., 2])
    return tilt, heading, turn.magnitude()


class Scene:
    """A filter with a set about some attitude that has seen directions within angles; the truth satisfies all."""

    def __init__(self, seed, count, size=None):
        draws = np.random.default_rng(seed)
        size = 10.0 ** draws.uniform(-2.0, -0.2) if size is None else size
        factor = draws.standard_normal((3, 3))
        shape = factor @ factor.T + 0.05 * np.eye(3)
        shape *= size**2 / np.linalg.eigvalsh(shape)[-1]
        prior = Rotation.random(rng=draws)
        ball = unit(draws.standard_normal(3)) * draws.uniform(0.0, 0.8)
        self.truth = prior * rotation(np.linalg.cholesky(shape) @ ball)
        self.references = unit(draws.standard_normal((count, 3)))
        self.angles = size * 10.0 ** draws.uniform(-0.7, 0.2, count)
        off = unit(draws.standard_normal((count, 3))) * (0.9 * self.angles * draws.uniform(0, 1, count))[:, None]
        self.bodies = np.array(
            [
                Rotation.from_rotvec(o).apply(self.truth.inv().apply(e))
                for o, e in zip(off, self.references, strict=True)
            ]
        ).reshape(count, 3)
        whole = TINY**2 * np.eye(6)
        whole[:3, :3] += shape
        self.prior, self.shape = prior, whole[:3, :3]
        start = el.StateEllipsoid(prior.as_matrix(), np.zeros(3), whole, chart="gibbs")
        self.filter = el.GuaranteedFilter(el.GuaranteedGyroFlow(0.01), start, vector_bound=TINY, estimate_vector=False)
        if count:
            self.filter.update(self.bodies, self.references, bounds=self.angles)
        self.center = Rotation.from_matrix(self.filter.ellipsoid.attitude)
        self.set = self.filter.ellipsoid.shape[:3, :3]

    def slacks(self, gamma):
        """How much is left to each constraint, of γ about the center of the set, shape (k, ...)."""
        attitude = self.center * rotation(gamma)
        about_prior = gibbs(self.prior.inv() * attitude)
        slacks = [1.0 - np.sum(about_prior @ np.linalg.inv(self.shape) * about_prior, axis=-1)]
        slacks.append(1.0 - np.sum(gamma @ np.linalg.inv(self.set) * gamma, axis=-1))
        for e, b, angle in zip(self.references, self.bodies, self.angles, strict=True):
            seen = attitude.inv().apply(e)
            slacks.append((np.sum(seen * unit(b), axis=-1) - np.cos(angle)) / (1.0 - np.cos(angle)))
        return np.array(slacks)

    def forms(self):
        """The constraints as quadrics, by the reference, of what the bounds use."""
        center = self.center.as_matrix()
        found = [quadrics.Quadric(np.linalg.inv(self.set), np.zeros(3), 1.0)]
        if len(self.angles):
            found.append(self.of_prior())
        found += [
            quadrics.cone(center, e, b, angle)
            for e, b, angle in zip(self.references, self.bodies, self.angles, strict=True)
        ]
        return [reference.slack_form(one) for one in found]

    def of_prior(self):
        """γ̃ᵀP⁻¹γ̃ ≤ 1 about the prior's center, of γ about the set's: w² − 4xᵀP⁻¹x of a product of quaternions."""
        to_prior = (self.prior.inv() * self.center).as_quat(scalar_first=True)
        w, x = to_prior[0], to_prior[1:]
        product = np.zeros((4, 4))
        product[0, 0], product[0, 1:], product[1:, 0] = w, -x, x
        product[1:, 1:] = w * np.eye(3) + np.cross(x, np.eye(3)).T  # x × y
        form = np.zeros((4, 4))
        form[0, 0], form[1:, 1:] = 1.0, -4.0 * np.linalg.inv(self.shape)
        return quadrics.of_quaternion(product.T @ form @ product)


def rotation(gamma):
    gamma = np.asarray(gamma, dtype=np.float64)
    return Rotation.from_quat(
        np.concatenate([np.ones((*gamma.shape[:-1], 1)), 0.5 * gamma], axis=-1), scalar_first=True
    )


def gibbs(error):
    quaternion = error.as_quat(scalar_first=True)
    return 2.0 * quaternion[..., 1:] / quaternion[..., :1]


def farthest(scene, question, draws):
    """The largest answer that SLSQP finds, from several starts in the set."""
    best = 0.0
    inside = gibbs(scene.center.inv() * scene.truth)
    factor = np.linalg.cholesky(scene.set)

    def asked(y):
        return -question(tilt_and_heading(scene.center, scene.center * rotation(factor @ y)))

    starts = [np.linalg.solve(factor, inside), *(0.5 * draws.standard_normal((3, 3)))]
    for start in starts:
        found = scipy.optimize.minimize(
            asked,
            start,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda y: scene.slacks(factor @ y)},
            options={"maxiter": 80, "ftol": 1e-9},
        )
        if np.isfinite(found.x).all() and scene.slacks(factor @ found.x).min() >= -1e-8:
            best = max(best, -float(found.fun))
    return best


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_nothing_is_farther_off_and_something_nearly_as_far(count):
    shares = {"tilt": [], "heading": []}
    for seed in range(6):
        scene = Scene(100 * count + seed, count)
        bounds = scene.filter.bounds(3.0 * UP)
        draws = np.random.default_rng(seed)
        tilt, heading, angle = tilt_and_heading(scene.center, scene.truth)
        assert tilt <= bounds.tilt
        assert bounds.heading_from <= heading <= bounds.heading_to
        assert angle <= bounds.angle
        # SLSQP keeps constraints to 1e-8.
        allowed = 1.0 + 1e-6
        most = farthest(scene, lambda answers: answers[1], draws)
        assert most <= allowed * bounds.heading_to
        least = farthest(scene, lambda answers: -answers[1], draws)
        assert least <= -allowed * bounds.heading_from
        tilted = farthest(scene, lambda answers: answers[0], draws)
        assert tilted <= allowed * bounds.tilt
        shares["heading"].append(max(most, least) / bounds.heading)
        shares["tilt"].append(tilted / bounds.tilt)
    assert np.mean(shares["heading"]) >= 0.97
    # Several constraints leave the S-procedure a gap, which is wider for a square than for a single coordinate.
    assert np.mean(shares["tilt"]) >= (0.97 if count < 2 else 0.9)


def test_no_sampled_attitude_is_farther_off():
    draws = np.random.default_rng(4)
    inside = 0
    for seed in range(12):
        scene = Scene(seed, seed % 4)
        bounds = scene.filter.bounds(UP)
        ball = unit(draws.standard_normal((40_000, 3))) * np.cbrt(draws.uniform(size=(40_000, 1)))
        gamma = ball @ np.linalg.cholesky(scene.set).T
        gamma = gamma[(scene.slacks(gamma) >= 0.0).all(axis=0)]
        inside += len(gamma)
        tilt, heading, angle = tilt_and_heading(scene.center, scene.center * rotation(gamma))
        assert (tilt <= bounds.tilt).all()
        assert (heading <= bounds.heading_to).all()
        assert (heading >= bounds.heading_from).all()
        assert (angle <= bounds.angle).all()
    assert inside > 50_000


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_bounds_are_those_of_the_reference(count):
    """n·γ/2 = tan(ψ/2) and |γ⊥|²/4 = sin²(α/2)(1 + |γ|²/4), by another search for the multipliers; equation (16.5)."""
    for seed in range(4):
        scene = Scene(1000 + 100 * count + seed, count)
        bounds = scene.filter.bounds(UP)
        forms = scene.forms()
        n = scene.center.inv().apply(UP)
        one, along = np.diag([1.0, 0.0, 0.0, 0.0]), np.zeros((4, 4))
        along[0, 1:] = along[1:, 0] = 0.25 * n
        most = 2.0 * np.arctan(reference.least_multiple(along, one, forms))
        least = 2.0 * np.arctan(reference.least_multiple(-along, one, forms))
        across = np.zeros((4, 4))
        across[1:, 1:] = 0.25 * (np.eye(3) - np.outer(n, n))
        share = reference.least_multiple(across, np.diag([1.0, 0.25, 0.25, 0.25]), forms)
        larger = max(most, least)
        assert bounds.heading_to == pytest.approx(most, rel=0.01, abs=0.01 * larger)
        assert -bounds.heading_from == pytest.approx(least, rel=0.01, abs=0.01 * larger)
        assert bounds.tilt == pytest.approx(2.0 * np.arcsin(np.sqrt(share)), rel=0.01)


def test_signs_of_the_heading_by_hand():
    """The center is the identity; north is seen 0.2 rad to the side of a truth that is turned about up by as much."""
    truth = Rotation.from_rotvec([0.0, 0.0, 0.2])
    estimate = el.StateEllipsoid(np.eye(3), np.zeros(3), np.diag([0.25] * 3 + [TINY**2] * 3), chart="gibbs")
    known = el.GuaranteedFilter(el.GuaranteedGyroFlow(0.01), estimate, vector_bound=TINY, estimate_vector=False)
    alone = known.bounds(UP)
    assert -alone.heading_from == pytest.approx(2.0 * np.arctan(0.25), rel=0.01)
    assert alone.heading_to == pytest.approx(2.0 * np.arctan(0.25), rel=0.01)
    north = np.array([1.0, 0.0, 0.0])
    known.update([truth.inv().apply(UP), truth.inv().apply(north)], [UP, north], bounds=[1e-3, 0.05])
    bounds = known.bounds(UP)
    # Whatever the new center is, the truth's heading and the edges of the cone are counted from it.
    center = Rotation.from_matrix(known.ellipsoid.attitude)
    _, heading, _ = tilt_and_heading(center, Rotation.identity())
    assert heading + 0.15 == pytest.approx(bounds.heading_from, abs=2e-3)
    assert heading + 0.25 == pytest.approx(bounds.heading_to, abs=2e-3)
    # About down everything turns the other way.
    down = known.bounds(-UP)
    assert down.heading_from == pytest.approx(-bounds.heading_to, rel=0.01)
    assert down.heading_to == pytest.approx(-bounds.heading_from, rel=0.01)


def test_without_an_attitude_there_is_no_answer():
    empty = el.GuaranteedFilter(el.GuaranteedGyroFlow(0.01), vector_bound=0.1)
    assert empty.bounds(UP) is None
    scene = Scene(1, 2)
    scene.filter.forget()
    assert scene.filter.bounds(UP) is None


@pytest.mark.parametrize("vertical", [[0.0, 0.0, 0.0], [0.0, np.nan, 1.0], [np.inf, 0.0, 1.0], [1.0, 0.0], "up"])
def test_a_vertical_that_is_none(vertical):
    with pytest.raises((ValueError, TypeError), match="vertical"):
        Scene(1, 2).filter.bounds(vertical)


def test_rows_of_a_log_are_what_single_updates_say():
    draws = np.random.default_rng(8)
    count = 30
    truth = Rotation.from_rotvec(np.cumsum(0.1 * draws.standard_normal((count, 3)), axis=0))
    turns = np.concatenate([[truth[0].as_rotvec()], (truth[:-1].inv() * truth[1:]).as_rotvec()])
    references = np.array([UP, [1.0, 0.0, 0.0]])
    bodies = np.einsum("nji,mj->nmi", truth.as_matrix(), references)
    angles = np.where(draws.uniform(size=(count, 2)) < 0.6, [0.05, 0.3], np.nan)
    times = np.arange(1.0, count + 1.0)

    def begun():
        start = el.StateEllipsoid(np.eye(3), np.zeros(3), np.diag([0.04] * 3 + [TINY**2] * 3), chart="gibbs")
        return el.GuaranteedFilter(el.GuaranteedGyroFlow(0.01), start, vector_bound=TINY, estimate_vector=False)

    arguments = {"anchors": np.arange(count) - 1, "directions": bodies, "reference": references, "bounds": angles}
    log = begun().run_turns(times, turns, np.full(count, 0.01), vertical=UP, **arguments)
    assert begun().run_turns(times, turns, np.full(count, 0.01), **arguments).attitude_bounds is None
    single = begun()
    for row in range(count):
        single.predict_turn(times[row], turns[row], 0.01)
        there = np.isfinite(angles[row])
        if there.any():
            single.update(bodies[row][there], references[there], bounds=angles[row][there])
        np.testing.assert_allclose(log.question_bounds[row], single.bounds(UP), rtol=1e-12)
    tilt, heading, angle = tilt_and_heading(Rotation.from_matrix(log.attitudes), truth)
    bounds = log.attitude_bounds
    assert (tilt <= bounds.tilt).all()
    assert ((bounds.heading_from <= heading) & (heading <= bounds.heading_to)).all()
    assert (angle <= bounds.angle).all()
    np.testing.assert_array_equal(bounds.heading, np.maximum(-bounds.heading_from, bounds.heading_to))
