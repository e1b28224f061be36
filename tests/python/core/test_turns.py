"""A turn that is known but for an angle: `predict_turn`, and a log from anchors by `run_turns`."""

import copy
import dataclasses
import re

import elliptude as el
import numpy as np
import pytest
from elliptude.results import CLAIMS
from scipy.spatial.transform import Rotation

FLOW = el.GuaranteedGyroFlow(0.01, 0.001)
REFERENCE = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])


def started(flow=FLOW, *, size=0.02, **settings):
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), size**2 * np.eye(6))
    return el.GuaranteedFilter(flow, start, **settings)


def gibbs(rotation):
    """Gibbs vector 2 tan(θ/2) n of a rotation."""
    x, y, z, w = rotation.as_quat()
    return 2.0 * np.array([x, y, z]) / w


def test_truth_is_in_the_set_and_reaches_its_edge():
    """Judged by SciPy's quaternions, apart from the core."""
    rng = np.random.default_rng(7)
    worst = 0.0
    for _ in range(100):
        size, angle = 10.0 ** rng.uniform(-4, -0.5), 10.0 ** rng.uniform(-4, 0.2)
        turn = rng.normal(size=3)
        bound = 0.01
        moved = started(size=size, vector_bound=bound, estimate_vector=False)
        moved.predict_turn(3.0, turn, angle)
        assert moved.time == 3.0
        center, shape = Rotation.from_matrix(moved.ellipsoid.attitude), moved.ellipsoid.shape[:3, :3]
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        before = Rotation.from_rotvec(2.0 * np.arctan(0.5 * size) * axis)
        known = Rotation.from_rotvec(turn)
        # On about the error's own axis, as seen from the turned body; and about any other.
        others = rng.normal(size=(20, 3))
        for added in (known.inv().apply(axis), *(others / np.linalg.norm(others, axis=1)[:, None])):
            error = gibbs(center.inv() * before * known * Rotation.from_rotvec(angle * added))
            worst = max(worst, form := error @ np.linalg.solve(shape, error))
            assert form <= 1.0
    assert worst > 0.98


def test_unknown_turn_is_that_over_a_gap():
    over_gap = started(el.GuaranteedGyroFlow(0.01, 0.001, largest_rate=0.25))
    over_gap.predict(2.0, gyro=np.full(3, np.nan))
    turned = started()
    turned.predict_turn(2.0, np.zeros(3), 0.5)
    np.testing.assert_allclose(turned.ellipsoid.shape, over_gap.ellipsoid.shape, rtol=1e-12, atol=1e-18)


def some_log(rng, rows=40):
    times = np.cumsum(rng.uniform(0.05, 0.2, rows)) - 0.05
    truth = Rotation.from_rotvec(np.cumsum(0.2 * rng.normal(size=(rows, 3)), axis=0))
    anchors = np.maximum(np.arange(rows) - 1, 0) // 8 * 8
    anchors[0] = -1
    begin = np.where(anchors < 0, 0, anchors)
    turns = (truth[begin].inv() * truth).as_rotvec()
    turns[0] = truth[0].as_rotvec()
    bounds = 1e-3 * (np.arange(rows) - anchors)
    directions = np.einsum("nji,mj->nmi", truth.as_matrix(), REFERENCE)
    angles = np.where(rng.uniform(size=(rows, 2)) < 0.7, 0.02, np.nan)
    return times, truth, {"turns": turns, "turn_bounds": bounds, "anchors": anchors}, directions, angles


@pytest.mark.parametrize("estimate_vector", [True, False])
def test_log_is_what_its_rows_are(estimate_vector):
    times, truth, turns, directions, angles = some_log(np.random.default_rng(3))
    arguments = {"vector_bound": 0.05, "estimate_vector": estimate_vector, "criterion": "volume"}
    whole = started(size=0.1, **arguments)
    log = whole.run_turns(times, **turns, directions=directions, reference=REFERENCE, bounds=angles, sensors=["a", "b"])
    before = here = started(size=0.1, **arguments)
    for k in range(len(times)):
        if turns["anchors"][k] == k - 1:
            before = copy.deepcopy(here)
        here = copy.deepcopy(before)
        here.predict_turn(times[k], turns["turns"][k], turns["turn_bounds"][k])
        there = np.isfinite(angles[k])
        if there.any():
            update = here.update(directions[k, there], REFERENCE[there], angles[k, there])
            assert update.margin == log.margins[k]
            assert update.prediction_used == log.prediction_used[k]
        np.testing.assert_array_equal(here.ellipsoid.attitude, log.attitudes[k])
        np.testing.assert_array_equal(here.ellipsoid.shape, log.shapes[k])
    np.testing.assert_array_equal(whole.ellipsoid.shape, here.ellipsoid.shape)
    assert whole.time == times[-1]
    assert (log.forms(truth.as_matrix()) <= 1.0).all()


def assert_same_log(one, other):
    for field in dataclasses.fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


@pytest.mark.parametrize("group", [1, 2, 8, 700, 10_000])
def test_threads_change_nothing(group):
    rows = 5000
    rng = np.random.default_rng(5)
    times, _, turns, directions, angles = some_log(rng, rows)
    turns["turns"] += 0.02 * rng.normal(size=(rows, 3))  # now and then it contradicts
    turns["anchors"] = np.maximum(np.arange(rows) - 1, 0) // group * group
    turns["anchors"][0] = -1
    turns["turn_bounds"] = np.full(rows, 0.01)
    rows_of = {"directions": directions, "reference": REFERENCE, "bounds": angles, "vertical": [0.0, 0.0, 1.0]}
    found = []
    for threads in (1, 2, 5, None):
        filter_ = started(vector_bound=0.05, estimate_vector=False, policy="drop_measurement")
        found.append((filter_.run_turns(times, **turns, **rows_of, threads=threads), filter_.to_dict()))
    assert len(np.unique(found[0][0].claims)) > 1
    for log, after in found[1:]:
        assert_same_log(log, found[0][0])
        assert after == found[0][1]


@pytest.mark.parametrize("threads", [1, 4])
@pytest.mark.parametrize("first_wrong", [2, 7, 8, 9, 3001, 4096])
def test_the_first_row_that_contradicts_is_named(first_wrong, threads):
    """Whether it is an anchor, one of the rows before the next, or one after others that contradict, too."""
    rows = 5000
    times, truth, turns, directions, _ = some_log(np.random.default_rng(6), rows)
    angles = np.full((rows, 2), 0.02)
    wrong = np.array([first_wrong, *range(first_wrong + 3, rows, 7)])
    directions[wrong, 1] = Rotation.from_rotvec([0.0, 0.0, 1.0]).apply(directions[wrong, 1])
    turned = truth[np.maximum(turns["anchors"], 0)].inv() * truth
    turns["turns"][1:] = turned.as_rotvec()[1:]
    filter_ = started(size=0.1, vector_bound=0.05, estimate_vector=False)
    rows_of = {"directions": directions, "reference": REFERENCE, "bounds": angles, "threads": threads}
    with pytest.raises(el.InconsistentMeasurement) as caught:
        filter_.run_turns(times, **turns, **rows_of)
    assert caught.value.row == first_wrong
    assert filter_.time == times[first_wrong]
    before = started(size=0.1, vector_bound=0.05, estimate_vector=False)
    last = (first_wrong - 1) // 8 * 8
    until = {name: value[: last + 1] for name, value in turns.items()}
    before.run_turns(
        times[: last + 1], **until, directions=directions[: last + 1], reference=REFERENCE, bounds=angles[: last + 1]
    )
    before.predict_turn(times[first_wrong], turns["turns"][first_wrong], turns["turn_bounds"][first_wrong])
    np.testing.assert_array_equal(filter_.ellipsoid.shape, before.ellipsoid.shape)


def test_anchor_without_an_attitude_leaves_the_rows_after_it_to_their_measurements():
    flow = el.GuaranteedFilter(FLOW, vector_bound=0.1)
    log = flow.run_turns(
        [0.0, 1.0, 2.0, 3.0],
        np.zeros((4, 3)),
        [0.0, 0.1, np.inf, 0.1],
        anchors=[-1, 0, 0, 0],
        directions=np.broadcast_to(REFERENCE, (4, 2, 3)),
        reference=REFERENCE,
        bounds=[[0.01, 0.01], [np.nan, np.nan], [np.nan, np.nan], [np.nan, np.nan]],
    )
    assert [CLAIMS[claim] for claim in log.claims] == [
        "unconditional",
        "unconditional",
        "none",
        "unconditional",
    ]


@pytest.mark.parametrize(
    ("time", "turn", "angle", "message"),
    [
        (-1.0, np.zeros(3), 0.1, "time must not go backwards, but is -1 s after 0 s"),
        (1.0, np.zeros(3), -0.1, "turn_bound must not be negative, but is -0.1 rad"),
        (1.0, np.zeros(3), np.nan, "turn_bound must not be negative, but is nan rad"),
        (1.0, [np.nan, 0, 0], 0.1, "turn must be finite"),
        (1.0, [1e300, 0, 0], 0.1, "turn is a turn of 1e+300 rad, of which nothing is left to be known"),
        (np.inf, np.zeros(3), 0.1, "time must be finite"),
    ],
)
def test_bad_turns_leave_the_filter_as_it_was(time, turn, angle, message):
    filter_ = started()
    with pytest.raises(ValueError, match=re.escape(message)):
        filter_.predict_turn(time, turn, angle)
    assert filter_.to_dict() == started().to_dict()


@pytest.mark.parametrize(
    ("change", "row", "message"),
    [
        ({"anchors": [-1, 0, 2, 2]}, None, "anchors[2] must be 1, the row before (-1: the filter as it is), or 0"),
        ({"anchors": [0, 0, 1, 1]}, None, "anchors[0] must be -1"),
        ({"anchors": [-1, 0, 0.5, 2]}, None, "anchors[2]"),
        ({"turn_bounds": [0.0, 0.1, -1.0, 0.1]}, 2, "turn_bounds[2] must not be negative"),
        ({"times": [0.0, 2.0, 1.0, 3.0], "anchors": [-1, 0, 1, 2]}, 2, "times must not go backwards, but times[2]"),
        ({"times": [0.0, 2.0, 1.0, 3.0]}, 2, "times must not go backwards, but times[2] is 1 s after 2 s"),
        ({"turns": np.full((4, 3), 1e300)}, 0, "turns[0] is a turn of"),
        ({"turns": np.zeros((3, 3))}, None, "turns"),
        ({"threads": 0}, None, "threads must be"),
    ],
)
def test_bad_logs_name_the_row(change, row, message):
    arguments = {"times": [0.0, 1.0, 2.0, 3.0], "turns": np.zeros((4, 3)), "turn_bounds": [0.0, 0.1, 0.1, 0.1]}
    arguments |= {"anchors": [-1, 0, 0, 0]} | change
    filter_ = started()
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        filter_.run_turns(arguments.pop("times"), **arguments)
    assert getattr(caught.value, "row", None) == row
    assert filter_.to_dict() == started().to_dict()


def test_turns_are_not_for_a_body():
    body = el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(el.RigidBody(np.diag([1.0, 2.0, 2.5])), step=0.1))
    with pytest.raises(TypeError, match="GuaranteedGyroFlow"):
        body.predict_turn(1.0, np.zeros(3), 0.1)
    with pytest.raises(TypeError, match="GuaranteedGyroFlow"):
        body.run_turns([0.0], np.zeros((1, 3)), [0.1], anchors=[-1])
