"""Another filter's attitudes judged row by row: claims, caps, limits, alarms; and on a simulated log with its truth."""

import re
from dataclasses import replace
from pathlib import Path

import elliptude as el
import numpy as np
import pytest
from elliptude.monitoring import Limits, Sets, UpCaps, monitor
from scipy.spatial.transform import Rotation

PAGE = Path(__file__).parents[3] / "docs" / "monitor.md"
UP = np.array([0.0, 0.0, 1.0])


def sets_of(centers, widths, claims):
    """Balls of these half-angles about rotations."""
    shapes = (2.0 * np.tan(0.5 * np.asarray(widths))) ** 2
    quaternions = centers.as_quat(scalar_first=True)
    quaternions[np.isnan(shapes)] = np.nan
    shapes = shapes[:, None, None] * np.eye(3)
    return Sets(np.arange(len(shapes)) * 1.0, quaternions, shapes, np.array(claims, dtype=np.uint8))


@pytest.fixture
def three():
    """A set, a conditional one, and none."""
    centers = Rotation.random(3, rng=np.random.default_rng(2))
    return centers, sets_of(centers, [0.2, 0.2, np.nan], [0, 1, 2])


def test_claims_go_with_the_numbers(three):
    centers, sets = three
    off = Rotation.from_rotvec([0.5, 0.0, 0.0]) * centers
    found = monitor(sets, off, up=UP)
    np.testing.assert_allclose(found.bounds[:2, :2], 0.7, atol=1e-6)
    np.testing.assert_allclose(found.least[:2, :2], 0.3, atol=1e-6)
    assert np.isnan(found.bounds[2]).all()
    assert found.claims.tolist() == [[0] * 3, [1] * 3, [2] * 3]
    # A proof is by an unconditional claim alone.
    assert found.alarms.proved.tolist() == [[True, True, False], [False] * 3, [False] * 3]
    assert found.alarms.conditional.tolist() == [[False] * 3, [True, True, False], [False] * 3]
    figures = found.to_dict()
    assert (figures["rows_with_proof"], figures["first_proof_s"], figures["rows_with_alarm"]) == (1, 0.0, 1)
    assert figures["tilt"]["wrong_if_condition_holds"] == 1
    assert figures["tilt"]["without_bound"] == 1
    assert figures["tilt"]["largest_least_deg"] == pytest.approx(np.rad2deg(0.3), abs=1e-4)


def test_sets_by_proposals_prove_nothing(three):
    centers, sets = three
    off = Rotation.from_rotvec([0.5, 0.0, 0.0]) * centers
    caps = UpCaps(centers.inv().apply(UP), np.full(3, 0.01), np.zeros(3, dtype=np.uint8))
    stated = monitor(sets, off, up=UP, caps=caps, limits=Limits(tilt=1.0))
    found = monitor(replace(sets, are_proposals=True), off, up=UP, caps=caps, limits=Limits(tilt=1.0))
    np.testing.assert_array_equal(found.bounds, stated.bounds)
    np.testing.assert_array_equal(found.least, stated.least)
    assert stated.alarms.proved[:, 1].all()
    assert not found.alarms.proved.any()
    assert found.claims.tolist() == [[1, 1, 1], [1, 1, 1], [2, 1, 2]]
    assert found.alarms.over_limit[:, 1].all()


def test_a_limit_is_kept_only_by_an_unconditional_bound(three):
    centers, sets = three
    for limit, kept in ((0.21, True), (0.19, False)):
        over = monitor(sets, centers, up=UP, limits=Limits(total=limit)).alarms.over_limit
        # The second is bounded under a condition, the third not at all: neither shows that the limit is kept.
        assert over[:, 0].tolist() == [not kept, True, True]
        assert not over[:, 1:].any()


def test_rows_without_an_estimate_are_no_alarms(three):
    centers, sets = three
    quaternions = centers.as_quat(scalar_first=True)
    quaternions[0] = np.nan
    found = monitor(sets, quaternions, up=UP, limits=Limits(total=0.1, tilt=0.1))
    assert found.judged.tolist() == [False, True, True]
    assert found.alarms.over_limit[:, 0].tolist() == [False, True, True]
    assert np.isnan(found.bounds[0]).all()
    assert found.to_dict()["judged"] == 2


def test_quaternions_matrices_and_rotations_are_one(three):
    centers, sets = three
    one, two, other = (
        monitor(sets, attitudes, up=-5.0 * UP).bounds
        for attitudes in (centers, centers.as_matrix(), -1.004 * centers.as_quat(scalar_first=True))
    )
    np.testing.assert_allclose(one, two, atol=1e-12)
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_a_cap_bounds_the_tilt_where_there_is_no_set(three):
    centers, sets = three
    seen = centers.inv().apply(UP)
    off = Rotation.from_rotvec([0.5, 0.0, 0.0]) * centers
    caps = UpCaps(3.0 * seen, np.full(3, 0.1), np.array([0, 0, 0], dtype=np.uint8))
    found = monitor(sets, off, up=UP, caps=caps)
    np.testing.assert_allclose(found.bounds[:, 1], 0.6, atol=1e-9)
    np.testing.assert_allclose(found.least[:, 1], 0.4, atol=1e-9)
    assert found.claims[:, 1].tolist() == [0, 0, 0]
    assert found.alarms.proved[:, 1].all()
    # The whole is still the set's, less what a smaller tilt leaves of it.
    assert found.claims[:, 0].tolist() == [0, 1, 2]
    parts = 2.0 * np.arccos(np.cos(0.3) * np.cos(0.5 * found.bounds[:2, 2]))
    np.testing.assert_allclose(found.bounds[:2, 0], np.minimum(0.7, parts), atol=1e-6)
    assert found.least[:2, 0] == pytest.approx(0.4, abs=1e-6)


@pytest.mark.parametrize(
    ("claim", "angle", "expected", "by"),
    [
        (0, 0.1, 0.1, 0),  # sharper than the set, with the same claim
        (0, 0.3, 0.2, 0),  # less sharp
        (1, 0.1, 0.2, 0),  # sharper under a condition: the unconditional bound stays
        (2, 0.1, 0.2, 0),
    ],
)
def test_of_the_strongest_claim_the_smallest_bound_counts(claim, angle, expected, by):
    centers = Rotation.random(1, rng=np.random.default_rng(5))
    caps = UpCaps(centers.inv().apply(UP), np.array([angle]), np.array([claim], dtype=np.uint8))
    found = monitor(sets_of(centers, [0.2], [0]), centers, up=UP, caps=caps)
    assert found.bounds[0, 1] == pytest.approx(expected, abs=1e-6)
    assert found.claims[0, 1] == by
    unconditional = UpCaps(caps.directions, caps.angles, np.array([0], dtype=np.uint8))
    found = monitor(sets_of(centers, [0.2], [1]), centers, up=UP, caps=unconditional)
    assert found.bounds[0, 1] == pytest.approx(angle, abs=1e-6)
    assert found.claims[0].tolist() == [1, 0, 1]


def test_a_free_heading_is_never_an_alarm(three):
    centers, sets = three
    turned = Rotation.from_rotvec([0.0, 0.0, 2.5]) * centers
    assert monitor(sets, turned, up=UP).alarms.proved[0].tolist() == [True, False, True]
    free = monitor(sets, turned, up=UP, heading="free")
    assert not free.alarms.proved.any()
    assert not free.alarms.conditional.any()
    assert free.questions == ("tilt",)
    assert free.bounds[0, 1] == pytest.approx(0.2, abs=1e-6)
    assert np.isnan(free.bounds[:, [0, 2]]).all()
    # A tilt is found whatever the heading is.
    tilted = turned * Rotation.from_rotvec(0.4 * np.array([1.0, 0.0, 0.0]))
    least = monitor(sets, tilted, up=UP, heading="free").least[0, 1]
    up, other = centers[0].inv().apply(UP), tilted[0].inv().apply(UP)
    assert least == pytest.approx(max(np.arccos(up @ other) - 0.2, 0.0), abs=1e-6)


def test_without_up_the_whole_alone_is_judged(three):
    centers, sets = three
    found = monitor(sets, centers)
    assert found.questions == ("total",)
    assert found.bounds[0, 0] == pytest.approx(0.2, abs=1e-6)
    assert found.to_dict()["tilt"] is None


def test_bad_arguments(three):
    centers, sets = three
    quaternions = centers.as_quat(scalar_first=True)
    for attitudes, said in (
        (quaternions[:2], r"attitudes must have shape \(3, 3, 3\) or \(3, 4\), not \(2, 4\)"),
        (1.1 * quaternions, "the quaternion of row 0 is 1.1 long"),
        (0.0 * quaternions, "the quaternion of row 0 is 0 long"),
        (2.0 * centers.as_matrix(), "row 0 is not a rotation matrix"),
    ):
        with pytest.raises(ValueError, match=said):
            monitor(sets, attitudes, up=UP)
    with pytest.raises(ValueError, match="up must be three finite numbers"):
        monitor(sets, quaternions, up=[0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="up must be three finite numbers"):
        monitor(sets, quaternions, up=[0.0, np.nan, 1.0])
    with pytest.raises(ValueError, match="up: missing"):
        monitor(sets, quaternions, heading="free")
    with pytest.raises(ValueError, match="heading must be 'same' or 'free'"):
        monitor(sets, quaternions, up=UP, heading="none")
    with pytest.raises(ValueError, match="limit of heading: it is not judged, because the heading is free"):
        monitor(sets, quaternions, up=UP, heading="free", limits=Limits(heading=0.1))
    with pytest.raises(ValueError, match="limit of tilt: it is not judged, because there is no up"):
        monitor(sets, quaternions, limits=Limits(tilt=0.1))
    for bad in (-0.1, 4.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="limit of tilt must be from 0 to π"):
            Limits(tilt=bad)
    with pytest.raises(ValueError, match="caps must have"):
        monitor(sets, quaternions, up=UP, caps=UpCaps(np.ones((2, 3)), np.ones(2), np.zeros(2, np.uint8)))
    for directions, angle in ((np.ones((3, 3)), -0.1), (np.zeros((3, 3)), 0.1)):
        with pytest.raises(ValueError, match="angles must be at least 0, and directions not zero"):
            monitor(sets, quaternions, up=UP, caps=UpCaps(directions, np.full(3, angle), np.zeros(3, np.uint8)))
    with pytest.raises(ValueError, match="are not of 3 rows"):
        monitor(Sets(sets.times, sets.quaternions, sets.shapes[:2], sets.claims), quaternions)


def test_the_error_of_any_filter_on_a_simulated_log_is_within_its_bound():
    """Three directions with bounded errors, a gyro; estimates that are good, drift away, and are turned over."""
    rng = np.random.default_rng(8)
    n, step, bound = 200, 0.1, np.deg2rad(3.0)
    rates = np.array([0.2, -0.3, 0.4]) + 0.3 * rng.normal(size=(n, 3))
    turns = Rotation.from_rotvec(step * rates)
    attitudes = [Rotation.random(rng=rng)]
    for turn in turns[:-1]:
        attitudes.append(attitudes[-1] * turn)
    true = Rotation.concatenate(attitudes)
    references = np.eye(3)[:2]
    seen = np.stack([true.inv().apply(reference) for reference in references], axis=1)
    errors = rng.normal(size=(n, 2, 3))
    errors *= bound * rng.uniform(size=(n, 2, 1)) / np.linalg.norm(errors, axis=2, keepdims=True)
    measured = np.stack([Rotation.from_rotvec(errors[:, i]).apply(seen[:, i]) for i in range(2)], axis=1)
    measured[rng.uniform(size=(n, 2)) < 0.4] = np.nan
    flow = el.GuaranteedGyroFlow(noise=np.deg2rad(0.2))
    log = el.GuaranteedFilter(flow, vector_bound=np.deg2rad(0.1)).run(
        step * np.arange(n), gyro=rates, directions=measured, reference=references, bounds=np.full(2, bound)
    )
    assert (log.claims == 0).sum() > 0.8 * n
    drift = np.linspace(0.0, 1.0, n)[:, None] * [0.8, 0.0, 0.6]
    for turn in (np.zeros((n, 3)), 0.05 * rng.normal(size=(n, 3)), drift, np.tile([np.pi, 0.0, 0.0], (n, 1))):
        estimate = Rotation.from_rotvec(turn) * true
        found = monitor(log, estimate, up=UP)
        difference = (true * estimate.inv()).as_quat(scalar_first=True)
        w, x, y, z = np.abs(difference.T)
        actual = 2.0 * np.column_stack(
            [np.arccos(np.minimum(w, 1.0)), np.arctan2(np.hypot(x, y), np.hypot(w, z)), np.arctan2(z, w)]
        )
        rows = log.claims == 0
        assert (actual[rows, :2] <= found.bounds[rows, :2] + 1e-7).all()
        assert (actual[rows, :2] >= found.least[rows, :2] - 1e-7).all()
        if turn[0, 0] < 3.0:  # half a turn about x has any heading
            assert (actual[rows, 2] <= found.bounds[rows, 2] + 1e-7).all()
            assert (actual[rows, 2] >= found.least[rows, 2] - 1e-7).all()
    assert found.alarms.proved[rows, 1].all()
    assert not monitor(replace(log, are_proposals=True), estimate, up=UP).alarms.proved.any()
    good = monitor(log, true, up=UP)
    assert not good.alarms.proved.any()
    gone = monitor(log, Rotation.from_rotvec(drift) * true, up=UP).alarms.proved.any(axis=1)
    assert not gone[:5].any()
    assert gone[-5:][rows[-5:]].all()


def test_the_program_of_the_page_runs(capsys):
    (program,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    exec(compile(program, "docs/monitor.md", "exec"), {})
    all_proved, least = capsys.readouterr().out.split()
    assert all_proved == "True"
    assert 5.0 < float(least) < 10.0
