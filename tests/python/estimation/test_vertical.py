"""What is known of the vertical: by sets, by a filter of its own, and where no heading is.

The bounds' attainment: the truth comes to the edge, so that no term is lost.
"""

import dataclasses
import json
from types import SimpleNamespace

import elliptude
import numpy as np
import pytest
import tomlkit
from elliptude import estimation, logs, smoothing
from elliptude.configuration import Configuration
from elliptude.estimation import guaranteed_result, guaranteed_run
from elliptude.estimation.vertical import Turns, contradictions_of_up, followed, vertical_of
from elliptude.io import tables
from elliptude.results import CLAIMS, DirectionLog, GuaranteedLog
from reference import so3
from scipy.spatial.transform import Rotation
from test_guaranteed_run import configured, gyro_log, recording, ruled, run, with_accelerometer
from test_proposals import made

UP = np.array([0.0, 0.0, 1.0])
UNCONDITIONAL, CONDITIONAL, NONE = range(3)


def angle_between(first, second):
    cross = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.arctan2(cross, np.sum(first * second, axis=-1))


# --- of one row -------------------------------------------------------------------------------------------------------


def one_row(*, attitude=None, tilt=0.1, claim=UNCONDITIONAL):
    """A log of one row whose set bounds the tilt."""
    attitude = np.eye(3) if attitude is None else attitude
    there = np.nan if claim == NONE else 1.0
    return GuaranteedLog(
        times=np.zeros(1),
        attitudes=there * attitude[None],
        vectors=np.zeros((1, 3)),
        shapes=there * np.eye(6)[None],
        claims=np.array([claim], np.uint8),
        prediction_used=np.ones(1, bool),
        updated=np.ones(1, bool),
        dropped=np.zeros((1, 3), bool),
        margins=np.ones(1),
        question_bounds=there * np.array([[tilt, -0.5, 0.4, 0.6]]),
    )


def seen(direction, angle, claim=UNCONDITIONAL):
    there = np.nan if claim == NONE else 1.0
    return DirectionLog(
        there * np.asarray(direction)[None], there * np.array([angle]), np.array([claim], np.uint8), np.zeros(1, bool)
    )


def test_the_tilt_by_the_followed_up():
    """The true up is as far from the followed one as it may be, on the side away from the estimated one."""
    measured = Rotation.from_rotvec([0.1, 0.0, 0.0]).apply(UP)
    found = vertical_of(one_row(tilt=0.3), seen(measured, 0.05), UP)
    assert found.tilt_bounds[0] == pytest.approx(0.15)
    np.testing.assert_allclose(found.directions[0], measured)
    assert found.angles[0] == pytest.approx(0.05)
    # A set that says more is not made worse, nor by how far the other is away.
    found = vertical_of(one_row(tilt=0.04), seen(measured, 0.05), UP)
    assert found.tilt_bounds[0] == pytest.approx(0.04)
    np.testing.assert_allclose(found.directions[0], UP)
    assert found.angles[0] == pytest.approx(0.04)


def test_the_estimated_up_is_in_body_axes():
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    reference = np.array([0.6, 0.0, -0.8])
    found = vertical_of(one_row(attitude=turn, tilt=0.2), None, reference)
    np.testing.assert_allclose(found.directions[0], turn.T @ reference, atol=1e-15)
    assert found.angles[0] == found.tilt_bounds[0] == 0.2


@pytest.mark.parametrize("of_set", range(3))
@pytest.mark.parametrize("of_up", range(3))
def test_the_stronger_claim_counts(of_set, of_up):
    """A sharper bound that rests on more is no reason to give up the other."""
    measured = Rotation.from_rotvec([0.1, 0.0, 0.0]).apply(UP)
    for tilt, angle in ((0.01, 0.5), (0.5, 0.01)):
        found = vertical_of(one_row(tilt=tilt, claim=of_set), seen(measured, angle, of_up), UP)
        assert found.claims[0] == min(of_set, of_up)
        bounds = {of_set: tilt} if of_set < of_up else {of_up: angle} if of_up < of_set else {of_set: min(tilt, angle)}
        expected = bounds.get(min(of_set, of_up)) if min(of_set, of_up) != NONE else np.nan
        np.testing.assert_equal(found.angles[0], expected)
        assert np.isfinite(found.directions).all() == (found.claims[0] != NONE)
        if of_set == NONE:
            assert np.isnan(found.tilt_bounds[0])
        elif of_up < of_set:
            assert found.tilt_bounds[0] == pytest.approx(0.1 + angle)
        elif of_set < of_up:
            assert found.tilt_bounds[0] == tilt
        else:
            assert found.tilt_bounds[0] == pytest.approx(min(tilt, 0.1 + angle))


def test_without_a_vertical_nothing_is_said():
    assert vertical_of(one_row(), None, None) is None
    assert vertical_of(dataclasses.replace(one_row(), question_bounds=None), None, UP) is None


# --- followed over rows -----------------------------------------------------------------------------------------------


def rows_of_up(directions, angles, *, contradictions=()):
    return SimpleNamespace(
        names=("field", "up"),
        up=UP,
        up_column=1,
        directions=np.stack([np.full_like(directions, np.nan), directions], axis=1),
        angles=np.stack([np.full_like(angles, np.nan), angles], axis=1),
        contradictions=contradictions,
    )


def estimator(policy="drop_measurement"):
    return SimpleNamespace(estimator=SimpleNamespace(policy=policy, regain_after=10))


def still(count, angle=0.01):
    anchors = np.arange(count) - 1
    return Turns(anchors, np.zeros((count, 3)), np.full(count, angle))


def test_up_is_carried_by_turns():
    """Measured once; each turn may add its bound, all about one axis: the truth is at the edge."""
    count, angle = 20, 0.01
    directions = np.full((count, 3), np.nan)
    directions[0] = UP
    angles = np.where(np.arange(count) == 0, 0.02, np.nan)
    found = followed(estimator(), rows_of_up(directions, angles), still(count, angle))
    expected = 0.02 + angle * np.arange(count)
    np.testing.assert_allclose(found.angles, expected, rtol=1e-9)
    assert (found.claims == UNCONDITIONAL).all()
    truth = np.column_stack([np.zeros(count), -np.sin(expected), np.cos(expected)])
    assert (angle_between(found.directions, truth) <= found.angles).all()
    assert (angle_between(found.directions, truth) > 0.999 * found.angles).all()


def test_up_where_its_sensor_contradicts_itself_is_conditional():
    directions, angles = np.tile(UP, (5, 1)), np.full(5, 0.02)
    plain = followed(estimator(), rows_of_up(directions, angles), still(5))
    assert (plain.claims == UNCONDITIONAL).all()
    for sensor, claim in (("field", UNCONDITIONAL), ("up", CONDITIONAL)):
        rows = rows_of_up(directions, angles, contradictions=(SimpleNamespace(sensor=sensor),))
        found = followed(estimator(), rows, still(5))
        assert (found.claims == claim).all()
        np.testing.assert_array_equal(found.angles, plain.angles)


def test_up_that_cannot_be_followed():
    rows = rows_of_up(np.tile(UP, (5, 1)), np.full(5, 0.02))
    assert followed(estimator(), rows, None) is None
    assert followed(estimator("relaxed"), rows, still(5)) is None
    rows.up_column = None
    assert followed(estimator(), rows, still(5)) is None


def test_an_up_that_contradicts_is_dropped_or_raises():
    directions, angles = np.tile(UP, (8, 1)), np.full(8, 0.02)
    directions[4] = [1.0, 0.0, 0.0]
    rows = rows_of_up(directions, angles)
    found = followed(estimator(), rows, still(8))
    np.testing.assert_array_equal(found.dropped, np.arange(8) == 4)
    assert (found.claims[:4] == UNCONDITIONAL).all()
    assert (found.claims[4:] == CONDITIONAL).all()
    with pytest.raises(elliptude.InconsistentMeasurement) as caught:
        followed(estimator("raise"), rows, still(8))
    assert caught.value.row == 4


@pytest.mark.parametrize("policy", ["drop_measurement", "restart"])
def test_what_contradicts_up_is_named_with_the_angle_that_is_missing(policy):
    """Up turns by 0.3 rad in a step that the gyro says is 0.1 rad about the same axis, within 0.01 rad."""
    directions, angles = np.tile(UP, (8, 1)), np.full(8, 0.02)
    directions[4:] = Rotation.from_rotvec([-0.3, 0.0, 0.0]).apply(UP)
    turns = still(8)
    turns.vectors[4] = [0.1, 0.0, 0.0]
    rows = rows_of_up(directions, angles)
    up = followed(estimator(policy), rows, turns)
    assert (up.claims[3], up.claims[4]) == (UNCONDITIONAL, CONDITIONAL)
    found = contradictions_of_up(rows, turns, up)
    assert (found[0].row, found[0].sensor, found[0].unit) == (4, "up", "deg")
    assert found[0].excess == pytest.approx(np.rad2deg(0.2 - 0.02 - up.angles[3] - 0.01))
    # What restarts has only one that contradicts; the other goes on to expect what was.
    assert len(found) == {"restart": 1, "drop_measurement": 4}[policy]
    directions[4:] = Rotation.from_rotvec([-0.13, 0.0, 0.0]).apply(UP)
    rows = rows_of_up(directions, angles)
    assert contradictions_of_up(rows, turns, followed(estimator(policy), rows, turns)) == []
    assert contradictions_of_up(rows, turns, None) == contradictions_of_up(rows, None, up) == []


def up_that_jumps():
    """Up of a gyro's log, which is measured 0.5 rad off from half of its rows on."""
    log = lines_log()
    half = log.times > np.median(log.times)
    directions = log.directions.copy()
    directions[half, 0] = Rotation.from_rotvec([0.5, 0.0, 0.0]).apply(directions[half, 0])
    fields = with_accelerometer(configured({"noise_deg_per_s": 1.0, "interval_rate": "mean_of_ends"}), bound_deg=1.5)
    fields["estimator"] = {"mode": "guaranteed", "policy": "drop_measurement"}
    return dataclasses.replace(log, directions=directions), Configuration.model_validate(fields)


@pytest.mark.parametrize("estimated_by", [estimation.estimate, smoothing.smooth])
def test_a_statement_that_is_proved_wrong_by_up_alone_is_reported(estimated_by):
    """There is no set that could contradict: what is followed of up is all that shows it."""
    log, configuration = up_that_jumps()
    done = estimated_by(log, configuration)
    run = done.guaranteed
    assert not run.sets.dropped.any()
    columns = guaranteed_result.dropped_columns(run)
    first = int(np.argmax(log.times > np.median(log.times)))
    first += int(np.argmax(np.isfinite(log.directions[first:, 0, 0])))
    rows = [one.row for one in run.up_contradictions]
    assert rows == sorted(set(rows))
    assert first in rows
    assert (rows[0] == first) == (estimated_by is estimation.estimate)
    np.testing.assert_array_equal(columns["time_s"], log.times[rows])
    assert set(columns["sensor"]) == {run.rows.names[run.rows.up_column]}
    assert set(columns["contradicts"]) == {"prediction_of_up"}
    assert (columns["margin"] < 0.0).all()
    summary = guaranteed_result.summarize(run, configuration)["contradicted_up"]
    assert summary["rows"] == len(rows)
    assert summary["first_s"] == log.times[rows[0]]
    assert f"{len(rows)} rows contradict up as the gyro carries it" in summary["said"]
    assert "is wrong, and rows before may rest on it too" in summary["said"]
    untouched = estimation.estimate(lines_log(), configuration).guaranteed
    assert guaranteed_result.contradicted_up(untouched) is None
    assert guaranteed_result.dropped_columns(untouched)["sensor"] == []


# --- what the sets have left out --------------------------------------------------------------------------------------


def estimated_sets(count, left_out=(), past=()):
    """Sets that have left out the measured up at some rows, and their past at others."""
    margins, dropped = np.ones(count), np.zeros((count, 4), bool)
    margins[[*left_out, *past]] = -1.0
    dropped[list(left_out), 1] = True
    return SimpleNamespace(margins=margins, dropped=dropped)


def anchored(count, step):
    """Each row from the last multiple of a step before it."""
    rows = np.arange(count)
    return Turns(np.where(rows > 0, (rows - 1) // step * step, -1), np.zeros((count, 3)), np.full(count, 1e-3))


@pytest.mark.parametrize("kind", ["left_out", "past"])
def test_up_that_rests_on_what_the_sets_have_left_out_is_conditional(kind):
    """From the row on, until as many updates have agreed; it is then what was measured there, and nothing else."""
    rows = rows_of_up(np.tile(UP, (30, 1)), np.where(np.arange(30) == 3, 0.01, 0.02))
    plain = followed(estimator(), rows, still(30, 1e-4))
    found = followed(estimator(), rows, still(30, 1e-4), estimated_sets(30, **{kind: [5]}))
    np.testing.assert_array_equal(found.claims == CONDITIONAL, (np.arange(30) >= 5) & (np.arange(30) < 15))
    np.testing.assert_array_equal(found.angles[:15], plain.angles[:15])
    assert plain.angles[15] < 0.012
    assert found.angles[15] == pytest.approx(0.02)
    # What another sensor was left out for does not count.
    other = estimated_sets(30)
    other.margins[5], other.dropped[5, 0] = -1.0, True
    assert (followed(estimator(), rows, still(30, 1e-4), other).claims == UNCONDITIONAL).all()


def test_a_dispute_of_up_begins_again_with_each_contradiction():
    directions, angles = np.tile(UP, (50, 1)), np.full(50, 0.02)
    found = followed(estimator(), rows_of_up(directions, angles), still(50, 1e-4), estimated_sets(50, [5, 10], [18]))
    np.testing.assert_array_equal(np.flatnonzero(found.claims == CONDITIONAL), np.arange(5, 28))
    # Rows without a measured up agree with nothing.
    angles[20:30] = np.nan
    found = followed(estimator(), rows_of_up(directions, angles), still(50, 1e-4), estimated_sets(50, [5, 10], [18]))
    np.testing.assert_array_equal(np.flatnonzero(found.claims == CONDITIONAL), np.arange(5, 38))
    # A contradiction of its own is one, too: of row 24, which it has got over ten updates later.
    angles[:] = 0.02
    directions[24] = [1.0, 0.0, 0.0]
    found = followed(estimator(), rows_of_up(directions, angles), still(50, 1e-4), estimated_sets(50, [18]))
    np.testing.assert_array_equal(np.flatnonzero(found.claims == CONDITIONAL), np.arange(18, 34))
    # Where nothing is known any more, nothing rests on what was left out.
    turns = still(50, 1e-4)
    turns.angles[21], angles[21] = np.inf, np.nan
    directions[24] = UP
    found = followed(estimator(), rows_of_up(directions, angles), turns, estimated_sets(50, [18]))
    assert found.claims[18:23].tolist() == [CONDITIONAL] * 3 + [NONE, UNCONDITIONAL]


def test_a_dispute_of_up_between_anchors():
    """Sets that go from row to row have carried on what contradicts; sets from the same anchors have not."""
    rows = rows_of_up(np.tile(UP, (60, 1)), np.full(60, 0.02))
    turns, settings = anchored(60, 5), estimator()
    settings.estimator.regain_after = 3
    for from_anchors, left_out, conditional in (
        (False, 12, np.arange(12, 25)),
        (True, 12, [12]),
        (True, 10, np.arange(10, 25)),
    ):
        sets = estimated_sets(60, [left_out])
        found = followed(settings, rows, turns, sets, from_anchors=from_anchors)
        np.testing.assert_array_equal(np.flatnonzero(found.claims == CONDITIONAL), conditional)


@pytest.mark.parametrize("policy", ["drop_measurement", "restart"])
@pytest.mark.parametrize("estimated_by", [estimation.estimate, smoothing.smooth])
@pytest.mark.parametrize("stars", [0, 2])
def test_a_wrong_up_that_the_sets_leave_out_is_nowhere_unconditional(policy, estimated_by, stars):
    """Up is 8 degrees off at one row, within 2 by its bound; what the gyro has carried there is wide enough to meet it.

    Two stars contradict it; where they are seen before it alone, the past does.
    """
    times, lie = 0.1 * np.arange(100), 30
    references = np.eye(3)[[2, 0, 1]]
    directions = np.full((100, 3, 3), np.nan)
    directions[::10] = references
    directions[lie, 0] = so3.exp(np.radians([8.0, 0.0, 0.0])) @ references[0]
    directions[lie, 1 + stars :] = np.nan
    log = logs.Log(
        times=times, directions=directions, references=np.tile(references, (100, 1, 1)), rates=np.zeros((100, 3))
    )
    fields = with_accelerometer(
        configured({"noise_deg_per_s": 6.0 if stars else 5.0, "interval_rate": "mean_of_ends"}), bound_deg=2.0
    )
    sensors = [
        {"name": name, "columns": ["a", "b", "c"], "reference": reference.tolist(), "bound_deg": 0.2}
        for name, reference in zip("pq", references[1:], strict=True)
    ]
    fields |= {
        "directions": fields["directions"][:1] + sensors,
        "estimator": {"mode": "guaranteed", "policy": policy, "regain_after": 3, "best": "center"},
    }
    estimated = estimated_by(log, Configuration.model_validate(fields))
    result, caps = estimated.result, estimated.guaranteed.caps
    assert (angle_between(caps.directions, UP) > caps.angles + 1e-9).any()
    unconditional = np.array(result.up_claims) == "unconditional"
    assert (angle_between(result.ups, UP) <= result.up_bounds + 1e-9)[unconditional].all()
    assert (angle_between(caps.directions, UP) <= caps.angles + 1e-9)[caps.claims == UNCONDITIONAL].all()
    assert not unconditional[lie]
    assert unconditional[:20].all()
    assert unconditional[60 if stars else 70 :].all()


# --- from a gyro ------------------------------------------------------------------------------------------------------


def lines_log(seed=0):
    """A gyro whose rate is on lines between samples, and up seen at some rows only."""
    log = gyro_log(seed, noise=0.0)
    means = 0.5 * (log.rates[1:] + log.rates[:-1])
    step = float(log.times[1] - log.times[0])
    attitudes = [np.eye(3)]
    for rate in means:
        attitudes.append(attitudes[-1] @ so3.exp(step * rate))
    attitudes = np.array(attitudes)
    draws = np.random.default_rng(seed)
    directions = np.full_like(log.directions, np.nan)
    for row in range(0, len(log.times), 20):
        axis = draws.standard_normal(3)
        off = so3.exp(0.02 * axis / np.linalg.norm(axis))
        directions[row, 0] = 9.80665 * off @ attitudes[row].T @ UP
    return dataclasses.replace(log, directions=directions, true_attitudes=attitudes)


@pytest.mark.parametrize("anchor", [None, 1.0])
def test_up_without_any_heading(anchor):
    """One direction alone: no attitude at any row, and up at all of them."""
    log = lines_log()
    flow = {"noise_deg_per_s": 1.0, "interval_rate": "mean_of_ends"} | ({"anchor_s": anchor} if anchor else {})
    fields = with_accelerometer(configured(flow), bound_deg=np.rad2deg(0.02))
    estimated = estimation.estimate(log, Configuration.model_validate(fields))
    result = estimated.result
    assert set(result.claims) == {"none"}
    assert set(result.up_claims) == {"unconditional"}
    assert np.isnan(result.tilt_bounds).all()
    errors = angle_between(result.ups, log.true_attitudes[:, 2])
    assert (errors <= result.up_bounds).all()
    assert result.up_bounds.max() < 0.02 + np.deg2rad(1.0) + 0.01  # a second at the noise, and steps of rotations


def test_motion_between_samples_counts():
    """An angular acceleration that the noise does not hold makes turns less sure; half of it over the longest step."""
    log = lines_log()
    sharp, _ = (turns_of(log, {"angular_acceleration_deg_per_s2": value}) for value in (0.0, 40.0))
    wide = turns_of(log, {"angular_acceleration_deg_per_s2": 40.0})
    spans = log.times - log.times[np.maximum(wide.anchors, 0)]
    longest = 1.5 * float(np.median(np.diff(log.times)))
    added = 0.5 * np.deg2rad(40.0) * longest * spans
    np.testing.assert_allclose(wide.angles - sharp.angles, added, rtol=1e-6, atol=1e-12)


def turns_of(log, changes, **more):
    configuration = Configuration.model_validate(
        with_accelerometer(
            configured({"noise_deg_per_s": 1.0, "interval_rate": "mean_of_ends"} | changes), bound_deg=2.0
        )
    )
    rows = guaranteed_run.direction_rows(log, configuration)
    return guaranteed_run.turns_of(log.times, log.rates, configuration, rows)


def test_a_gyro_that_holds_its_rate_has_no_turns():
    """Its rate is not on lines between samples, which is what a turn over many samples counts on."""
    log = lines_log()
    assert turns_of(log, {"interval_rate": "first_sample"}) is None


# --- recordings -------------------------------------------------------------------------------------------------------


def fields_with_a_magnet():
    fields = made(field_late=0.012).fields.copy()
    fields[4000:4400] *= 1.6
    return fields


@pytest.mark.parametrize("case", ["no magnetometer", "magnetometer void", "lost heading"])
def test_up_is_known_in_every_row_of_a_recording(tmp_path, case):
    changes, configuration = {}, ruled()
    if case != "magnetometer void":
        configuration = ruled(directions=ruled()["directions"][:1])
    else:
        changes["mag"] = fields_with_a_magnet()
    left, lost = np.arange(4800), case == "lost heading"
    if lost:
        # Half a second is missing: the body may have turned by anything, and nothing says where north was.
        left = np.delete(left, slice(3000, 3100))
    whole = np.load(recording(tmp_path, **changes))
    path = recording(tmp_path, **{name: whole[name][left] for name in whole})
    (tmp_path / "config.toml").write_text(tomlkit.dumps(configuration))
    parsed = Configuration.model_validate(configuration)
    log = logs.read_log(path, parsed)
    done = run("estimate", path, "--config", tmp_path / "config.toml", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "bound of the tilt  " in done.output
    assert "the heading: it counts from the first row" in done.output
    result = tables.Result.read(tmp_path / "out" / "results.csv")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert len(result.times) == len(log.times)
    no_attitude = np.isnan(result.quaternions[:, 0])
    assert (no_attitude == (np.array(result.claims) == "none")).all()
    assert no_attitude[3000:].all() == lost
    known = np.isfinite(result.up_bounds)
    assert (known == (np.array(result.up_claims) != "none")).all()
    assert (np.isfinite(result.ups).all(axis=1) == known).all()
    assert known.all()
    assert summary["up_claim_share_of_rows"]["none"] == 0.0
    assert set(result.up_claims) == {"unconditional"}
    errors = angle_between(result.ups, log.true_attitudes[:, 2])
    assert (errors <= result.up_bounds).all()
    assert np.median(result.up_bounds) < np.deg2rad(20.0)
    tilts = angle_between(result.attitudes[~no_attitude][:, 2], log.true_attitudes[~no_attitude][:, 2])
    assert (tilts <= result.tilt_bounds[~no_attitude]).all()
    assert np.isnan(result.tilt_bounds[no_attitude]).all()
    assert np.isnan(result.headings[no_attitude]).all()
    if no_attitude.any():
        assert "up is known at 100 % of rows, unconditionally at 100 %" in done.output
    assert set(CLAIMS) >= set(result.up_claims)
