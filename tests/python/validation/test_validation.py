"""The harness that validates the filters: errors keep their bounds, the judge is right, escapes are found."""

import dataclasses
import itertools
import json

import guaranteed_stand_in
import mpmath
import numpy as np
import pytest
from elliptude import _core
from elliptude.validation import adversary, filter_runs, judge, monte_carlo, plants, tally
from elliptude.validation.adversary import Case
from elliptude.validation.filter_runs import Runs
from elliptude.validation.monte_carlo import Arguments
from reference import so3

LONG = np.longdouble
UPDATES = 8
NOTHING = np.empty((1, 4, 0))  # was asked


def angles(a, b):
    """Between vectors in extended precision, shape (...)."""
    a, b = np.broadcast_arrays(a.astype(LONG), b.astype(LONG))
    cross = np.stack([a[..., i - 2] * b[..., i - 1] - a[..., i - 1] * b[..., i - 2] for i in range(3)], axis=-1)
    return np.arctan2(np.sqrt((cross**2).sum(axis=-1)), (a * b).sum(axis=-1))


def drawn(case, seed=0, count=40):
    of, draws = plants.plant(case), np.random.default_rng(seed)
    starts = adversary.draw_starts(of, count, draws)
    return of, starts, adversary.draw_errors(of, case.noise, starts, UPDATES, draws), draws


CASES = [
    Case(scenario, directions, bound, noise)
    for (scenario, directions), bound, noise in itertools.product(
        [("disturbed", "two"), ("free", "five"), ("gyro", "three"), ("orbit", "three"), ("pendulum", "two")],
        [0.001, 0.1, 20.0],
        adversary.NOISES,
    )
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_every_error_keeps_its_bound_rounding_included(case):
    of, starts, errors, draws = drawn(case)
    bound = LONG(of.bound)
    for _ in range(3 if case.noise == "search" else 1):
        motion = of.motion(starts, errors)
        measured = adversary.measure(of, motion, errors)
        true = np.einsum("tuji,mj->tumi", motion.attitudes.astype(LONG), of.reference.astype(LONG))
        between = angles(measured.directions[:, 1:], true[:, 1:])
        assert between.max() <= bound
        np.testing.assert_allclose(np.linalg.norm(measured.directions[:, 1:], axis=-1), 1.0, atol=1e-15)
        assert np.isnan(measured.directions[:, 0]).all()
        if of.has_gyro:
            samples = (measured.rates - motion.rates.astype(LONG) - motion.vectors)[:, :-1]
            between_samples = np.diff(motion.rates.astype(LONG), axis=1) / of.interval
            assert np.sqrt((between_samples**2).sum(axis=-1)).max() <= LONG(of.angular_acceleration)
            drifts = np.diff(motion.vectors.astype(LONG), axis=1) / of.interval
            assert np.sqrt((drifts**2).sum(axis=-1)).max() <= LONG(of.drift)
        else:
            assert np.isnan(measured.rates[:, 0]).all()
            samples = (motion.rates.astype(LONG) - measured.rates)[:, 1:]
        lengths = np.sqrt((samples**2).sum(axis=-1))
        assert lengths.max() <= bound
        if case.noise in ("perpendicular", "alternating"):
            assert between.min() > bound - 3e-14
        if case.noise not in ("inside", "search"):
            assert lengths.min() > bound - 3e-14
        # The first set, in the exponential chart.
        offsets = np.array(
            [
                np.append(so3.log(center.T @ true0), x - x0)
                for center, true0, x, x0 in zip(
                    starts.attitudes, motion.attitudes[:, 0], motion.vectors[:, 0], starts.vectors, strict=True
                )
            ]
        )
        forms = np.einsum("ti,tij,tj->t", offsets, np.linalg.inv(starts.shapes), offsets)
        assert forms.max() <= 1.0 + 3e-15 / of.bound
        if case.noise != "inside":
            assert forms.min() > 1.0 - 1e-3 or case.noise == "search"
        errors = adversary.propose(errors, draws)
        for name in ("directions", "rates", "inputs", "start"):
            assert np.linalg.norm(getattr(errors, name), axis=-1).max() <= 1.0 + 1e-15


def test_kinds_of_noise_are_what_they_say():
    of, starts, errors, _ = drawn(Case("orbit", "three", 7.0, "alternating"))
    np.testing.assert_allclose(errors.rates[:, 1:], -errors.rates[:, :-1], atol=1e-15)
    np.testing.assert_allclose(errors.inputs[:, 1:], -errors.inputs[:, :-1], atol=1e-15)
    motion = of.motion(starts, errors)
    true = np.einsum("tuji,mj->tumi", motion.attitudes[:, 1:], of.reference)
    np.testing.assert_allclose(np.sum(true * errors.directions, axis=-1), 0.0, atol=1e-9)
    of, starts, errors, _ = drawn(Case("orbit", "three", 7.0, "common"))
    np.testing.assert_array_equal(errors.directions[:, :, 1:], errors.directions[:, :, :-1])
    of, starts, errors, _ = drawn(Case("gyro", "three", 7.0, "inside"), count=400)
    assert not starts.from_measurement.any()
    lengths = np.linalg.norm(errors.start, axis=-1)
    np.testing.assert_allclose(np.mean(lengths**6), 0.5, atol=5 / np.sqrt(12 * 400))


def test_proposals_change_one_kind_of_thing_each():
    _, _, errors, draws = drawn(Case("orbit", "five", 7.0, "search"), count=300)
    moved = adversary.propose(errors, draws)
    seen = set()
    for trial in range(300):
        times, sensors = np.nonzero((moved.directions[trial] != errors.directions[trial]).any(axis=-1))
        start = (moved.start[trial] != errors.start[trial]).any()
        seen.add((len(set(times.tolist())), len(set(sensors.tolist())), start))
    assert {(UPDATES, 5, True), (1, 5, False), (UPDATES, 1, False), (0, 0, True)} <= seen
    assert {(times, 5, False) for times in range(1, UPDATES + 1)} <= seen


# --- the judge --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["guaranteed", "first_order"])
@pytest.mark.parametrize("scale", [1e-6, 0.1, 0.5])
def test_form_in_the_chart_of_the_set(mode, scale):
    rng = np.random.default_rng(4)
    center, vector = so3.exp(rng.standard_normal(3)), rng.standard_normal(3)
    root = scale * rng.standard_normal((6, 6))
    direction = rng.standard_normal((50, 6))
    offsets = (direction / np.linalg.norm(direction, axis=1, keepdims=True)) @ root.T  # the form is 1
    if mode == "guaranteed":  # γ = 2 tan(θ/2) n
        length = np.linalg.norm(offsets[:, :3], axis=1, keepdims=True)
        vectors = 2.0 * np.arctan(length / 2.0) / length * offsets[:, :3]
    else:
        vectors = offsets[:, :3]
        offsets = offsets[np.linalg.norm(vectors, axis=1) < 3.0]
        vectors = offsets[:, :3]
    count = len(vectors)
    true = np.array([[center, center @ so3.exp(v)] for v in vectors])
    runs = Runs(
        np.broadcast_to(center, (count, 1, 3, 3)),
        np.broadcast_to(vector, (count, 1, 3)),
        np.broadcast_to(root @ root.T, (count, 1, 6, 6)),
        np.ones((count, 1), bool),
        np.zeros((count, 1), np.uint8),
        NOTHING,
    )
    motion = adversary.Motion(true, np.zeros((count, 2, 3)), np.stack([0 * offsets[:, 3:], vector + offsets[:, 3:]], 1))
    np.testing.assert_allclose(filter_runs.forms(mode, runs, motion), 1.0, rtol=1e-9 + 1e-14 / scale)
    if mode == "first_order":
        ellipsoid = _core.StateEllipsoid(center, vector, root @ root.T)
        expected = ellipsoid.quadratic_form(motion.attitudes[:, 1], motion.vectors[:, 1])
        np.testing.assert_allclose(filter_runs.forms(mode, runs, motion)[:, 0], expected, rtol=1e-9 + 1e-14 / scale)


def test_form_of_thin_sets_near_the_edge():
    """Against exact arithmetic of the same numbers."""
    rng = np.random.default_rng(2)
    for _ in range(30):
        axes, _ = np.linalg.qr(rng.standard_normal((6, 6)))
        root = axes * 10.0 ** -rng.uniform(0.0, 5.0, 6)
        shape = root @ root.T
        shape = 0.5 * (shape + shape.T)
        shape_exactly = mpmath.matrix(shape.tolist())
        offset = np.concatenate([np.zeros(3), root[3:] @ rng.standard_normal(6)])
        with mpmath.workdps(60):
            column = mpmath.matrix(offset.tolist())
            offset /= float(mpmath.sqrt((column.T * (shape_exactly**-1) * column)[0]))
            column = mpmath.matrix(offset.tolist())
            expected = float((column.T * (shape_exactly**-1) * column)[0])
        assert abs(expected - 1.0) < 1e-6
        identity = np.broadcast_to(np.eye(3), (1, 2, 3, 3))
        runs = Runs(
            identity[:, 1:],
            np.zeros((1, 1, 3)),
            shape[None, None],
            np.ones((1, 1), bool),
            np.zeros((1, 1), np.uint8),
            NOTHING,
        )
        motion = adversary.Motion(identity, np.zeros((1, 2, 3)), np.broadcast_to(offset[3:], (1, 2, 3)))
        np.testing.assert_allclose(filter_runs.forms("guaranteed", runs, motion), expected, rtol=1e-8)


def test_sets_that_are_none_are_not_passed_over():
    claims = np.array([[filter_runs.HOLDS, filter_runs.HOLDS, filter_runs.REFUSED, filter_runs.HOLDS]], np.uint8)
    runs = Runs(
        *(np.zeros((1, 4, *rest)) for rest in ((3, 3), (3,), (6, 6))),
        used=np.zeros((1, 4), bool),
        claims=claims,
        answers=NOTHING,
    )
    runs.attitudes[:] = np.eye(3)
    runs.shapes[0, 0] = np.eye(6)
    runs.shapes[0, 1] = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1.0])
    runs.shapes[0, 2] = np.nan
    runs.shapes[0, 3] = np.eye(6)
    attitudes = np.broadcast_to(np.eye(3), (1, 5, 3, 3)).copy()
    attitudes[0, 4] = np.diag([1.0, -1.0, -1.0])
    motion = adversary.Motion(attitudes, np.zeros((1, 5, 3)), np.full((1, 5, 3), 0.1))
    values = filter_runs.forms("guaranteed", runs, motion)[0]
    np.testing.assert_allclose(values[0], 0.03)
    assert values[1] == np.inf
    assert np.isnan(values[2])
    assert values[3] == np.inf
    counted = tally.Tally()
    starts = adversary.Starts(*(np.zeros(1) for _ in range(4)), from_measurement=np.ones(1, bool))
    counted.add(starts, runs, values[None])
    counts = {"updates": 4, "escapes": 3, "refused": 1, "without_set": 0, "failed": 0, "predictions": 3, "used": 0}
    assert counted.counts == counts
    claims[:] = [filter_runs.WITHOUT_SET, filter_runs.FAILED, filter_runs.HOLDS, filter_runs.WITHOUT_SET]
    counted.add(starts, runs, values[None])
    assert counted.counts == {name: count * 2 for name, count in counts.items()} | {
        "escapes": 4,
        "refused": 1,
        "without_set": 2,
        "failed": 1,
    }
    assert counted.worst["form"] == np.inf
    json.dumps(counted.to_dict(), allow_nan=False)


def test_sizes():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 2, 6, 6))
    shapes = root @ root.swapaxes(-1, -2)
    shapes[1, 1] = np.nan
    found = judge.sizes("paper", shapes)
    assert np.isnan(found[1, 1]).all()
    for i, j in ((0, 0), (3, 1)):
        p = shapes[i, j]
        angle = np.sqrt(np.linalg.eigvalsh(p[:3, :3])[-1])
        np.testing.assert_allclose(found[i, j], [np.trace(p), np.linalg.det(p) ** (1 / 12), angle], rtol=1e-9)
        of_gibbs = judge.sizes("guaranteed", shapes)[i, j]
        np.testing.assert_allclose(of_gibbs, [found[i, j, 0], found[i, j, 1], 2 * np.arctan(angle / 2)], rtol=1e-9)


# --- whole chunks -----------------------------------------------------------------------------------------------------


def arguments(case, mode, trials=30, updates=12, seed=0):
    return Arguments(mode=mode, trials=trials, updates=updates, seed=seed, cases=(case,))


def validated(case, mode, **options):
    given = arguments(case, mode, **options)
    return monte_carlo.summarize(
        given, {name: monte_carlo.validate_chunk(given, *rest) for name, *rest in monte_carlo.chunks(given)}
    )


@pytest.mark.parametrize("mode", ["paper", "first_order"])
@pytest.mark.parametrize("scenario", adversary.SCENARIOS)
def test_first_order_modes_hold_for_small_errors_well_inside(mode, scenario):
    total = validated(Case(scenario, "three", 0.1, "inside"), mode)["total"]
    assert total["updates"] == 360
    assert total["escapes"] == total["failed"] == 0
    assert 0.2 < total["worst_form"] < 1.0


@pytest.mark.parametrize("mode", ["paper", "first_order"])
@pytest.mark.parametrize("noise", ["perpendicular", "common", "alternating", "search"])
def test_escapes_of_the_first_order_modes_are_found(mode, noise):
    summary = validated(Case("orbit", "two", 20.0, noise), mode, trials=120, updates=20)
    assert summary["total"]["escapes"] > 0
    assert summary["total"]["worst_form"] > 1.0


@pytest.mark.parametrize("scenario", ["free", "gyro", "orbit"])
def test_a_set_that_is_too_small_is_found_out(monkeypatch, scenario):
    case = Case(scenario, "three", 1.0, "perpendicular")
    guaranteed_stand_in.install(monkeypatch, scale=9.0)
    held = validated(case, "guaranteed")
    assert held["total"]["escapes"] == held["total"]["refused"] == held["total"]["failed"] == 0
    assert held["total"]["worst_form"] < 0.2
    guaranteed_stand_in.install(monkeypatch, scale=0.25)
    escaped = validated(case, "guaranteed")
    assert escaped["total"]["escapes"] > 0
    # The charts of the two modes differ by less than a percent at 1 degree.
    np.testing.assert_allclose(escaped["total"]["worst_form"] / held["total"]["worst_form"], 36.0, rtol=1e-9)
    first_order = validated(case, "first_order")
    np.testing.assert_allclose(9.0 * held["total"]["worst_form"], first_order["total"]["worst_form"], rtol=0.01)
    sizes = held["cases"][0]["sizes"]
    np.testing.assert_allclose(sizes["own"]["trace"] / sizes["paper"]["trace"], 9.0, rtol=1e-3)
    if scenario != "gyro":
        assert sizes["measured"]["trace"] > sizes["own"]["trace"]


@pytest.mark.parametrize(
    ("claim", "counted"),
    [
        ("unconditional", None),
        (0, None),
        ("conditional", "refused"),
        ("Claim.conditional", "refused"),
        (1, "refused"),
        ("none", "without_set"),
        (2, "without_set"),
    ],
)
def test_claims(monkeypatch, claim, counted):
    guaranteed_stand_in.install(monkeypatch, claim=claim)
    total = validated(Case("orbit", "two", 1.0, "inside"), "guaranteed")["total"]
    assert total["escapes"] == total["failed"] == 0
    for name in ("refused", "without_set"):
        assert total[name] == (total["updates"] if name == counted else 0)
    assert (total["worst_form"] is None) == (counted == "without_set")


def test_a_search_finds_more_than_chance(monkeypatch):
    """The same number of runs, with and without the climbing."""
    case = Case("gyro", "three", 1.0, "search")
    climbed = [validated(case, "first_order", trials=240, seed=n)["total"]["worst_form"] for n in range(3)]
    monkeypatch.setattr(monte_carlo, "SEARCH_DRAWN", 1.0)
    by_chance = [validated(case, "first_order", trials=240, seed=n)["total"]["worst_form"] for n in range(3)]
    assert np.mean(climbed) > np.mean(by_chance) + 0.02


def test_results_are_a_function_of_the_arguments(monkeypatch):
    monkeypatch.setattr(monte_carlo, "CHUNK_TRIALS", 20)
    for noise in ("alternating", "search"):
        case = Case("pendulum", "three", 7.0, noise)
        given = arguments(case, "first_order", trials=50, updates=6)
        names = [name for name, *_ in monte_carlo.chunks(given)]
        assert names == [f"pendulum three 7 {noise} {n}" for n in range(3)]
        backwards = {
            n: monte_carlo.validate_chunk(given, *rest) for n, *rest in reversed(list(monte_carlo.chunks(given)))
        }
        summary = validated(case, "first_order", trials=50, updates=6)
        assert summary == monte_carlo.summarize(given, json.loads(json.dumps(backwards)))
        assert summary["total"]["updates"] == 300
        other = validated(case, "first_order", trials=50, updates=6, seed=1)
        assert other["total"]["worst_form"] != summary["total"]["worst_form"]


def test_histogram_and_worst_agree_with_the_counts():
    (case,) = validated(Case("orbit", "two", 20.0, "alternating"), "paper")["cases"]
    assert sum(case["histogram"]) == case["updates"] - case["failed"] - case["without_set"]
    beyond = np.flatnonzero(judge.FORM_EDGES[:-1] > 0.999)
    assert sum(np.array(case["histogram"])[beyond]) == case["escapes"]
    assert 1 <= case["worst"]["update"] <= 12
    assert 0 <= case["worst"]["trial"] < 30


def test_a_run_that_gives_up_is_counted(monkeypatch):
    def refuse(*arguments, **options):
        raise ValueError("no")

    monkeypatch.setattr(filter_runs, "_first_order", refuse)
    summary = validated(Case("orbit", "two", 1.0, "inside"), "paper")
    assert summary["total"]["failed"] == summary["total"]["updates"] == 360
    assert summary["total"]["worst_form"] is None
    json.dumps(summary, allow_nan=False)


def test_every_case_has_a_plant():
    for scenario, directions in itertools.product(adversary.SCENARIOS, adversary.DIRECTIONS):
        of = plants.plant(Case(scenario, directions, 2.0, "inside"))
        assert len(of.reference) == {"two": 2, "three": 3, "five": 5}[directions]
        np.testing.assert_allclose(np.linalg.norm(of.reference, axis=1), 1.0, atol=1e-15)
        assert dataclasses.is_dataclass(of)
