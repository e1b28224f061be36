"""Questions of a smoothed run: the truth is in each answer, and an answer is no wider than what the passes say."""

import dataclasses

import elliptude as el
import numpy as np
import pytest
from elliptude import smoothing
from elliptude.configuration import Configuration
from elliptude.estimation.questions.answers import Answers, answers_of, answers_of_sets
from elliptude.logs import log_of
from elliptude.results import GuaranteedLog
from elliptude.simulation import scenarios
from elliptude.simulation import simulated as simulation
from elliptude.simulation.configured import configuration_tables
from elliptude.smoothing.questions import Answered, answers_of_both
from reference import so3
from smoothing_inputs import gyro_configuration, gyro_log

ALL = ("reference_turns", "body_turns", "vector", "attitude")


def asked(configuration, *, criterion="volume", questions=ALL):
    tables = configuration.model_dump(exclude_unset=True)
    tables["estimator"] |= {"questions": list(questions), "criterion": criterion}
    return Configuration.model_validate(tables)


def twists(turns, axes):
    """The angle of each turn's part about unit vectors (n, 3): twice that of its quaternion's projection."""
    quaternions = np.array([el.quaternion_from_rotation(turn) for turn in turns])
    angles = 2.0 * np.arctan2(np.einsum("ni,ni->n", quaternions[:, 1:], axes), quaternions[:, 0])
    return np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi


def assert_true(answers, sets, attitudes, vectors, rows):
    centers = sets.attitudes[rows]
    of_reference = attitudes[rows] @ centers.swapaxes(1, 2)
    of_body = centers.swapaxes(1, 2) @ attitudes[rows]
    for i, axis in enumerate(np.eye(3)):
        axes = np.tile(axis, (len(centers), 1))
        for ranges, turns in ((answers.reference_turns, of_reference), (answers.body_turns, of_body)):
            true = twists(turns, axes)
            assert (ranges[rows, i, 0] <= true + 1e-12).all()
            assert (true <= ranges[rows, i, 1] + 1e-12).all()
    if answers.vectors is not None:
        assert (answers.vectors[rows, :, 0] <= vectors[rows]).all()
        assert (vectors[rows] <= answers.vectors[rows, :, 1]).all()
    for k in np.flatnonzero(rows):
        gamma = 2.0 * el.cayley_inverse(answers.own_attitudes[k].T @ attitudes[k])
        assert gamma @ np.linalg.solve(answers.own_shapes[k], gamma) <= 1.0


def widths(ranges):
    return ranges[..., 1] - ranges[..., 0]


@pytest.mark.parametrize("criterion", ["volume", "trace"])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_gyros_log(seed, criterion):
    log, configuration = gyro_log(seed, noise=0.0004), asked(gyro_configuration(), criterion=criterion)
    found = smoothing.smooth(log, configuration)
    run, answers = found.guaranteed, found.answers
    rows = run.sets.claims < 2
    assert rows.all()
    assert_true(answers, run.sets, log.true_attitudes, log.true_vectors, rows)
    forward = answers_of(run.forward, configuration)
    # A vector's ranges have no center: they are no wider in any row.
    assert (widths(answers.vectors) <= widths(forward.vectors)).all()
    assert widths(answers.vectors).mean() < 0.9 * widths(forward.vectors).mean()
    size = np.linalg.det if criterion == "volume" else lambda shapes: np.trace(shapes, axis1=1, axis2=2)
    assert (size(answers.own_shapes) <= size(forward.own_shapes) * (1.0 + 1e-12)).all()
    # About the center of the pass forward a turn's range is no wider than forward; about another one than the set's.
    kept = (run.sets.attitudes == run.forward.sets.attitudes).all(axis=(1, 2))
    of_sets = answers_of_sets(run.sets, ALL)
    for name in ("reference_turns", "body_turns"):
        ranges = getattr(answers, name)
        assert (widths(ranges)[kept] <= widths(getattr(forward, name))[kept]).all()
        assert (widths(ranges) <= widths(getattr(of_sets, name))).all()
        assert widths(ranges).mean() < 0.97 * widths(getattr(forward, name)).mean()
        assert widths(ranges).mean() < 0.97 * widths(getattr(of_sets, name)).mean()


@pytest.mark.parametrize("name", ["orbit", "pendulum"])
def test_a_body(name):
    scenario = scenarios.load(name)
    simulated = simulation.simulate(scenario, noise="perpendicular", seed=1)
    tables = configuration_tables(scenario, simulated) | {"estimator": {"mode": "guaranteed"}}
    if tables["start"]["kind"] != "given":
        tables.pop("start")
    configuration = asked(Configuration.model_validate(tables))
    log = log_of(simulated.measurements)
    found = smoothing.smooth(log, configuration)
    run = found.guaranteed
    assert_true(found.answers, run.sets, log.true_attitudes, log.true_vectors, run.sets.claims < 2)
    assert found.result.vector_forms[1:].max() <= 1.0


def test_rows_that_one_pass_knows():
    """Those before the first directions are answered by the pass backward alone, about its own centers."""
    log = gyro_log(2)
    directions = log.directions.copy()
    directions[:60] = np.nan
    log = dataclasses.replace(log, directions=directions)
    configuration = asked(gyro_configuration())
    found = smoothing.smooth(log, configuration)
    run = found.guaranteed
    assert (run.forward.sets.claims[:60] == 2).all()
    assert (run.sets.claims[:60] == 0).all()
    assert_true(found.answers, run.sets, log.true_attitudes, log.true_vectors, run.sets.claims < 2)
    backward = answers_of(run.backward, configuration)
    np.testing.assert_array_equal(found.answers.reference_turns[:60], backward.reference_turns[::-1][:60])
    np.testing.assert_array_equal(found.answers.vectors[:60, :, 0], -backward.vectors[::-1][:60, :, 1])


def pair(draws, distance):
    """A truth, and two passes of one row that hold it at the edge of their answers, with centers so far apart."""
    truth = so3.exp(draws.standard_normal(3))

    def of(size):
        shape = size**2 * np.diag(draws.uniform(0.01, 1.0, 3))
        turn = so3.exp(draws.standard_normal(3))
        shape = turn @ shape @ turn.T
        gamma = draws.standard_normal(3)
        gamma *= draws.uniform(0.9, 0.999) / np.sqrt(gamma @ np.linalg.solve(shape, gamma))
        center = truth @ so3.cayley(0.5 * gamma).T
        whole = np.zeros((1, 6, 6))
        whole[0, :3, :3], whole[0, 3:, 3:] = shape, np.eye(3)
        no = np.zeros(1, dtype=bool)
        sets = GuaranteedLog(
            np.zeros(1), center[None], np.zeros((1, 3)), whole, np.zeros(1, np.uint8), ~no, ~no,
            np.zeros((1, 4), dtype=bool), np.zeros(1),
        )  # fmt: skip
        ranges = []
        for turns in (truth @ center.T, center.T @ truth):
            true = np.array([twists(turns[None], axis[None])[0] for axis in np.eye(3)])
            # The truth is at one end.
            away = size * draws.uniform(1e-9, 0.1, (3, 2)) * np.where(draws.random(3) < 0.5, [[0], [1]], [[1], [0]]).T
            ranges.append(true[:, None] + away * [-1.0, 1.0])
        return sets, Answers(
            ranges[0][None], ranges[1][None], np.tile([-1.0, 1.0], (1, 3, 1)), center[None], shape[None]
        )

    return truth, of(distance), of(distance)


@dataclasses.dataclass
class Shown:
    """The sets of a smoothed run."""

    sets: GuaranteedLog


@pytest.mark.parametrize("size", [1e-3, 0.1, 0.6])
def test_answers_about_one_center_become_answers_about_another(size):
    """Where only the other pass counts, its answers are carried to the first one's center: the truth stays in them."""
    draws = np.random.default_rng(int(1e4 * size))
    configuration = asked(gyro_configuration(), questions=ALL[:2])
    yes, no = np.ones(1, dtype=bool), np.zeros(1, dtype=bool)
    narrowed = 0
    for _ in range(60):
        truth, (sets, answers), (others, of_other) = pair(draws, size)
        first, second = Answered(sets, answers, no), Answered(others, of_other, yes)
        found = answers_of_both(Shown(sets), first, second, configuration)
        own = answers_of_sets(sets, ALL[:2])
        for name, turn in (
            ("reference_turns", truth @ sets.attitudes[0].T),
            ("body_turns", sets.attitudes[0].T @ truth),
        ):
            ranges = getattr(found, name)[0]
            true = np.array([twists(turn[None], axis[None])[0] for axis in np.eye(3)])
            assert (ranges[:, 0] <= true + 1e-12).all()
            assert (true <= ranges[:, 1] + 1e-12).all()
            narrowed += (widths(ranges) < 0.8 * widths(getattr(own, name)[0])).sum()
    assert narrowed > 60


def test_a_pass_that_a_row_does_not_rest_on_says_nothing():
    """Whatever it answers, such as after it has met a contradiction; where the row rests on it, it does count."""
    draws = np.random.default_rng(5)
    _, (sets, answers), (others, of_other) = pair(draws, 0.1)
    little = Answers(*(np.zeros((1, 3, 2)),) * 3, sets.attitudes, 1e-12 * np.eye(3)[None])
    configuration = asked(gyro_configuration())

    def found(of_first, counts):
        first = Answered(sets, of_first, np.array([counts]))
        second = Answered(others, of_other, np.array([not counts]))
        both = answers_of_both(Shown(sets), first, second, configuration)
        return [getattr(both, field.name) for field in dataclasses.fields(both)]

    for one, other, counted in zip(found(answers, False), found(little, False), found(little, True), strict=True):
        np.testing.assert_array_equal(one, other)
        assert not np.array_equal(one, counted) or one is counted


@pytest.mark.parametrize("criterion", ["volume", "trace"])
def test_the_attitude_by_itself_is_in_what_both_leave(criterion):
    draws = np.random.default_rng(7)
    yes = np.ones(1, dtype=bool)
    size = np.linalg.det if criterion == "volume" else np.trace
    smaller = 0
    for _ in range(30):
        truth, (sets, answers), (others, of_other) = pair(draws, 0.2)
        configuration = asked(gyro_configuration(), criterion=criterion, questions=("attitude",))
        found = answers_of_both(
            Shown(sets), Answered(sets, answers, yes), Answered(others, of_other, yes), configuration
        )
        gamma = 2.0 * el.cayley_inverse(found.own_attitudes[0].T @ truth)
        assert gamma @ np.linalg.solve(found.own_shapes[0], gamma) <= 1.0
        least = min(size(answers.own_shapes[0]), size(of_other.own_shapes[0]))
        assert size(found.own_shapes[0]) <= least
        smaller += size(found.own_shapes[0]) < 0.95 * least
    assert smaller > 10
