"""A filter of one direction: a cap of the sphere that holds it, whatever the heading does."""

import copy
import re

import elliptude as el
import numpy as np
import pytest
from elliptude.results import CLAIMS
from scipy.spatial.transform import Rotation

UP = np.array([0.0, 0.0, 1.0])


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def angle_between(first, second):
    return np.arctan2(np.linalg.norm(np.cross(first, second), axis=-1), np.sum(first * second, axis=-1))


def drawn_log(seed, rows=80):
    """A body that turns from anchors, each turn and each measurement off by up to its bound."""
    draws = np.random.default_rng(seed)
    truth = Rotation.concatenate([Rotation.random(rng=draws)] + [Rotation.random(rng=draws) for _ in range(rows - 1)])
    slow = Rotation.from_rotvec(np.cumsum(0.3 * draws.standard_normal((rows, 3)), axis=0))
    truth = slow if seed % 2 else truth  # half turns, too
    anchors = np.maximum(np.arange(rows) - 1, 0) // 5 * 5
    anchors[0] = -1
    bounds = 10.0 ** draws.uniform(-3.0, -0.7) * draws.uniform(0.2, 1.0, rows)
    off = Rotation.from_rotvec(
        unit(draws.standard_normal((rows, 3))) * (bounds * draws.choice([1.0, 0.5], rows))[:, None]
    )
    begin = truth[np.maximum(anchors, 0)]
    turns = (begin.inv() * truth * off.inv()).as_rotvec()
    angles = np.where(draws.uniform(size=rows) < 0.6, 10.0 ** draws.uniform(-2.0, 0.0, rows), np.nan)
    error = (
        unit(draws.standard_normal((rows, 3))) * np.nan_to_num(0.999 * angles * draws.choice([1.0, 0.3], rows))[:, None]
    )
    measured = Rotation.from_rotvec(error).apply(truth.inv().apply(UP))
    measured[np.isnan(angles)] = np.nan
    return truth, {"turns": turns, "turn_bounds": bounds, "anchors": anchors}, measured, angles


@pytest.mark.parametrize("policy", ["raise", "drop_measurement", "restart"])
def test_the_truth_is_in_the_cap(policy):
    worst = 0.0
    for seed in range(60):
        truth, turns, measured, angles = drawn_log(seed)
        follower = el.DirectionFilter(policy)
        log = follower.run_turns(**turns, directions=measured, bounds=angles)
        known = np.isfinite(log.angles)
        first = np.flatnonzero(np.isfinite(angles))[0]
        assert known[first:].any()
        assert not known[:first].any()
        assert (np.isfinite(log.directions).all(axis=1) == known).all()
        errors = angle_between(log.directions[known], truth.inv().apply(UP)[known])
        assert (errors <= log.angles[known]).all()
        worst = max(worst, (errors / log.angles[known]).max())
        assert (log.claims == np.where(known, CLAIMS.index("unconditional"), CLAIMS.index("none"))).all()
        assert not log.dropped.any()
        # Never worse than what was measured in the row.
        there = np.isfinite(angles)
        assert (log.angles[there] <= angles[there] + 1e-12).all()
    assert worst > 0.99


def test_a_heading_that_turns_by_anything_costs_nothing():
    """Turns about the direction itself leave the cap where it is."""
    follower = el.DirectionFilter()
    direction = unit(np.array([0.3, -0.5, 0.8]))
    follower.update(direction, 0.02)
    for turn in (0.1, 3.0, -100.0):
        follower.predict_turn(turn * direction, 0.0)
    assert follower.angle == pytest.approx(0.02, rel=1e-9)
    assert angle_between(follower.direction, direction) < 1e-12


def test_two_caps_have_a_smaller_one_in_common():
    """Circles of 0.1 and 0.2 whose centers are 0.2 apart: half the chord on which they meet."""
    follower = el.DirectionFilter()
    follower.update(UP, 0.1)
    update = follower.update([np.sin(0.2), 0.0, np.cos(0.2)], 0.2)
    assert update.prediction_used
    assert not update.contradicts
    # Both circles meet where cos(0.1) = z and cos(0.2) = z cos 0.2 + x sin 0.2.
    x = (np.cos(0.2) - np.cos(0.1) * np.cos(0.2)) / np.sin(0.2)
    y = np.sqrt(1.0 - np.cos(0.1) ** 2 - x**2)
    middle = unit(np.array([x, 0.0, np.cos(0.1)]))
    assert follower.angle == pytest.approx(np.arcsin(y), rel=1e-6)
    np.testing.assert_allclose(follower.direction, middle, atol=1e-6)


def liar(rows=30):
    """A body at rest, up at each row within 0.02, and one row that shows down."""
    measured = np.tile(UP, (rows, 1))
    measured[10] = -UP
    turns = {"turns": np.zeros((rows, 3)), "turn_bounds": np.full(rows, 1e-3), "anchors": np.arange(rows) - 1}
    return turns, measured, np.full(rows, 0.02)


def test_a_lie_raises():
    turns, measured, angles = liar()
    follower = el.DirectionFilter()
    with pytest.raises(el.InconsistentMeasurement, match="farther apart than their bounds") as caught:
        follower.run_turns(**turns, directions=measured, bounds=angles)
    assert caught.value.row == 10
    # It is predicted to that row, and the user may go on.
    assert follower.claim == "unconditional"
    assert follower.angle == pytest.approx(0.021, rel=1e-6)
    follower.update(UP, 0.02)
    with pytest.raises(el.InconsistentMeasurement):
        follower.update(-UP, 0.02)
    follower.forget()
    follower.update(-UP, 0.02)
    assert follower.claim == "unconditional"


def test_a_lie_is_dropped():
    turns, measured, angles = liar()
    follower = el.DirectionFilter("drop_measurement", regain_after=5)
    log = follower.run_turns(**turns, directions=measured, bounds=angles)
    np.testing.assert_array_equal(np.flatnonzero(log.dropped), [10])
    assert (angle_between(log.directions, UP) <= log.angles).all()
    assert (log.claims[:10] == CLAIMS.index("unconditional")).all()
    assert log.claims[10] == CLAIMS.index("conditional")
    # Given up with the past, which may have been the lie: five updates have agreed.
    assert log.claims[10:].tolist() == [1] * 5 + [0] * 15
    assert follower.claim == "unconditional"


def test_a_lie_restarts():
    turns, measured, angles = liar()
    follower = el.DirectionFilter("restart", regain_after=5)
    log = follower.run_turns(**turns, directions=measured, bounds=angles)
    assert not log.dropped.any()
    assert angle_between(log.directions[10], -UP) <= log.angles[10]
    assert log.claims[10] == CLAIMS.index("conditional")
    assert (angle_between(log.directions[11:], UP) <= log.angles[11:]).all()
    assert log.claims[-1] == CLAIMS.index("unconditional")


@pytest.mark.parametrize("policy", ["raise", "drop_measurement"])
def test_a_log_is_what_its_rows_are(policy):
    _, turns, measured, angles = drawn_log(5)
    log = el.DirectionFilter(policy).run_turns(**turns, directions=measured, bounds=angles)
    before = here = Loop(policy)
    for row in range(len(angles)):
        if turns["anchors"][row] == row - 1:
            before = here
        here = before.copied()
        here.then(("predict_turn", turns["turns"][row], turns["turn_bounds"][row]))
        if np.isfinite(angles[row]):
            here.then(("update", measured[row], angles[row]))
        assert CLAIMS[log.claims[row]] == here.filter.claim
        if here.filter.direction is None:
            assert np.isnan(log.angles[row])
            assert here.filter.angle == np.pi
        else:
            np.testing.assert_array_equal(log.directions[row], here.filter.direction)
            assert log.angles[row] == here.filter.angle


class Loop:
    """A filter that is copied by doing again what was done to it."""

    def __init__(self, policy, calls=()):
        self.policy, self.calls = policy, []
        self.filter = el.DirectionFilter(policy)
        for call in calls:
            self.then(call)

    def then(self, call):
        name, *arguments = call
        getattr(self.filter, name)(*arguments)
        self.calls.append(call)

    def copied(self):
        return Loop(self.policy, copy.copy(self.calls))


def test_rows_without_a_measurement_say_nothing():
    count = 6
    turns = {"turns": np.zeros((count, 3)), "turn_bounds": np.full(count, 0.01), "anchors": np.arange(count) - 1}
    measured = np.full((count, 3), np.nan)
    log = el.DirectionFilter().run_turns(**turns, directions=measured, bounds=np.full(count, 0.1))
    assert (log.claims == CLAIMS.index("none")).all()
    assert np.isnan(log.angles).all()
    measured[1:] = UP
    angles = np.array([0.1, 0.1, np.nan, np.pi, 4.0, np.inf])
    log = el.DirectionFilter().run_turns(**turns, directions=measured, bounds=angles)
    np.testing.assert_allclose(log.angles[1:], 0.1 + 0.01 * np.arange(5), rtol=1e-9)
    # A turn of which nothing is known.
    turns["turn_bounds"][3] = np.inf
    log = el.DirectionFilter().run_turns(**turns, directions=measured, bounds=angles)
    assert np.isnan(log.angles[3:]).all()
    with pytest.raises(ValueError, match="turns must have the shape"):
        el.DirectionFilter().run_turns(
            np.zeros((0, 3)), np.zeros(0), anchors=np.zeros(0), directions=np.zeros((0, 3)), bounds=np.zeros(0)
        )


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("relaxed",), "policy 'relaxed' needs several measurements"),
        (("nonsense",), "policy must be one of"),
        (("raise", 0), "regain_after must be at least 1, but is 0"),
    ],
)
def test_settings_that_are_none(arguments, message):
    with pytest.raises(ValueError, match=message):
        el.DirectionFilter(*arguments)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (("predict_turn", [0.0, 0.0], 0.1), "turn"),
        (("predict_turn", [0.0, 0.0, np.nan], 0.1), "turn"),
        (("predict_turn", [0.0, 0.0, 0.0], -0.1), "turn_bound must not be negative, but is -0.1"),
        (("predict_turn", [0.0, 0.0, 0.0], np.nan), "turn_bound must not be negative, but is nan"),
        (("predict_turn", [0.0, 0.0, 0.0], [0.1, 0.2]), "turn_bound"),
        (("update", [0.0, 0.0, 0.0], 0.1), "direction"),
        (("update", [0.0, np.inf, 0.0], 0.1), "direction"),
        (("update", [0.0, 1.0], 0.1), "direction"),
        (("update", UP, -1e-3), "bound must not be negative, but is -0.001"),
        (("update", UP, np.nan), "bound must not be negative, but is nan"),
    ],
)
def test_arguments_that_are_none(call, message):
    follower = el.DirectionFilter()
    follower.update(UP, 0.1)
    name, *arguments = call
    with pytest.raises(ValueError, match=re.escape(message)):
        getattr(follower, name)(*arguments)
    assert follower.angle == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("name", "value", "row"),
    [
        ("turn_bounds", -0.1, 3),
        ("turn_bounds", np.nan, 5),
        ("directions", [0.0, 0.0, 0.0], 2),
        ("directions", [0.0, np.nan, 1.0], 6),
        ("directions", [0.0, np.inf, 1.0], 6),
        ("bounds", -0.1, 8),
    ],
)
def test_a_row_that_is_none_is_named(name, value, row):
    turns, measured, angles = liar()
    measured[10] = UP
    arguments = turns | {"directions": measured, "bounds": angles}
    arguments[name][row] = value
    follower = el.DirectionFilter()
    with pytest.raises(el.RowError, match=re.escape(f"{name}[{row}]")) as caught:
        follower.run_turns(**arguments)
    assert caught.value.row == row
    # As it was before the call.
    assert follower.claim == "none"


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_turn_that_is_none_is_named(value):
    turns, measured, angles = liar()
    turns["turns"][4, 1] = value
    with pytest.raises(ValueError, match=r"turns must be finite, but turns\[4, 1\]"):
        el.DirectionFilter().run_turns(**turns, directions=measured, bounds=angles)


@pytest.mark.parametrize("name", ["turns", "turn_bounds", "directions", "bounds", "anchors"])
def test_shapes_that_do_not_fit(name):
    turns, measured, angles = liar()
    arguments = turns | {"directions": measured, "bounds": angles}
    arguments[name] = arguments[name][:-1]
    with pytest.raises(ValueError, match=name if name != "turns" else "turn_bounds"):
        el.DirectionFilter().run_turns(**arguments)


def test_anchors_that_are_none():
    turns, measured, angles = liar()
    turns["anchors"][5] = 2
    with pytest.raises(ValueError, match=r"anchors\[5\] must be 4, the row before"):
        el.DirectionFilter().run_turns(**turns, directions=measured, bounds=angles)
