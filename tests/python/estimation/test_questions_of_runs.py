"""Single questions to each row of a run: the truth is in the answers, which are sharper than the sets."""

import dataclasses
import json
from typing import get_args

import elliptude as el
import numpy as np
import pytest
import tomlkit
from datasets import broad, needs_datasets
from elliptude import cli, estimation, logs
from elliptude.configuration import Configuration
from elliptude.configuration.estimator import Question
from elliptude.estimation.guaranteed_run import run_guaranteed
from elliptude.estimation.questions import answers as asking
from elliptude.estimation.questions import columns as judging
from elliptude.estimation.questions.answers import Answers
from elliptude.io.tables import Result
from elliptude.logs import Log
from elliptude.report.estimated import picture
from elliptude.report.estimated.reading import read_run
from elliptude.report.page import notes
from elliptude.validation.questions import tilt_and_heading
from scipy.spatial.transform import Rotation
from test_guaranteed_run import REFERENCES, configured, gyro_log, recording, ruled, so3_unit
from typer.testing import CliRunner

QUESTIONS = get_args(Question)
OF_ATTITUDE = tuple(question for question in QUESTIONS if question != "vector")
BOUND, RATE_BOUND = 0.03, 0.02  # rad, rad/s
INERTIA = [1.0, 2.8, 2.0]


def body_log(seed=0, count=120, step=0.25, *, bound=BOUND, rate_bound=RATE_BOUND):
    """A free body, directions and rates whose errors use up their bounds; some rows have one direction, or nothing."""
    draws = np.random.default_rng(seed)
    start = 0.3 * draws.standard_normal(3)
    motion = el.Integrator(el.RigidBody(INERTIA), step=0.01, order=8).trajectory(
        Rotation.random(rng=draws).as_matrix(), start, steps=round(count * step / 0.01)
    )
    every = round(step / 0.01)
    attitudes, rates = motion.attitudes[::every][:count], motion.angular_velocities[::every][:count]
    seen = np.einsum("nji,mj->nmi", attitudes, REFERENCES)
    off = Rotation.from_rotvec(bound * np.array([so3_unit(draws) for _ in range(2 * count)]))
    directions = off.apply(seen.reshape(-1, 3)).reshape(count, 2, 3)
    directions[5::7, 0] = np.nan
    directions[3::11] = np.nan
    measured = rates + rate_bound * np.array([so3_unit(draws) for _ in range(count)])
    measured[3::11] = np.nan
    return Log(
        times=step * np.arange(count),
        directions=directions,
        references=np.tile(REFERENCES, (count, 1, 1)),
        rates=measured,
        true_attitudes=attitudes,
        true_vectors=rates,
    )


def body(questions=QUESTIONS, bound=BOUND, **settings):
    sensors = configured({"noise_deg_per_s": 1.0}, bound).model_dump(mode="json", exclude_unset=True)["directions"]
    return Configuration.model_validate(
        {
            "flow": {"kind": "rigid_body", "inertia_kg_m2": INERTIA, "step_s": 0.05, "order": 4},
            "directions": sensors,
            "rate": {"columns": ["p", "q", "r"], "bound_deg_per_s": np.rad2deg(RATE_BOUND)},
            "estimator": {"mode": "guaranteed", "questions": list(questions)} | settings,
        }
    )


def intervals(flat):
    return flat.reshape(-1, 3, 2)


def assert_answers_hold(estimated, configuration, questions):
    """The truth is in every answer, no answer is wider than the set; means of half-widths by those of the sets."""
    result, sets = estimated.result, estimated.guaranteed.sets
    summary = estimation.summarize(estimated, configuration)
    assert set(summary["questions"]) == set(questions)
    for counted in summary["questions"].values():
        assert counted["rows"] == np.isfinite(result.largest_angles).sum()
        assert counted["compared_rows"] == counted["rows"]
        assert counted["inside_share_of_rows"] == 1.0
        assert 0.0 < counted["largest_form"] <= 1.0
    extents = sets.extents()
    ratios = {}
    for name, found, widths, middle in (
        ("reference_turns", result.turns_reference, extents.half_widths_reference, 0.0),
        ("body_turns", result.turns_body, extents.half_widths_body[:, :3], 0.0),
        ("vector", result.vector_ranges, extents.half_widths_body[:, 3:], sets.vectors),
    ):
        if name in questions:
            away = np.abs(intervals(found) - np.broadcast_to(middle, widths.shape)[..., None])
            assert (np.nan_to_num(away / widths[..., None]) <= 1.0 + 1e-9).all()
            ratios[name] = np.nanmean(0.5 * np.diff(intervals(found))[..., 0] / widths, axis=0)
    if "attitude" in questions:
        volumes = np.linalg.det(result.own_shapes) / np.linalg.det(sets.shapes[:, :3, :3])
        assert np.nanmax(volumes) <= 1.0
        ratios["attitude"] = np.nanmean(np.cbrt(np.sqrt(volumes)))
    return ratios


# --- truth inside -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_answers_of_a_body_hold_and_are_sharper(seed):
    configuration = body()
    estimated = estimation.estimate(body_log(seed), configuration)
    ratios = assert_answers_hold(estimated, configuration, QUESTIONS)
    assert ratios["reference_turns"].max() < 0.95
    assert ratios["body_turns"].max() < 0.95
    assert ratios["vector"].max() < 0.95
    assert ratios["attitude"] < 0.99


def test_errors_beyond_their_bounds_leave_the_answers():
    # The same errors, and a bound of half their size: the test above can fail, question by question.
    configuration = body(bound=0.5 * BOUND, policy="drop_measurement")
    estimated = estimation.estimate(body_log(), configuration)
    counted = estimation.summarize(estimated, configuration)["questions"]
    for question in OF_ATTITUDE:
        assert counted[question]["inside_share_of_rows"] < 1.0, question
        assert counted[question]["largest_form"] > 1.0


@pytest.mark.parametrize("flow", [{"estimate_bias": True}, {}, {"anchor_s": 1.0, "interval_rate": "mean_of_ends"}])
def test_answers_of_a_gyro_hold(flow):
    noise, bias = 0.01, 0.004
    log = gyro_log(3, noise=noise, bias=bias)
    log.directions[20:30] = np.nan
    log.directions[50::9, 1] = np.nan
    flow = flow | {
        # Rates are constant between samples here, and lines between them are off by half of their largest step.
        "noise_deg_per_s": np.rad2deg(noise + 0.5 * np.abs(np.diff(log.rates, axis=0)).sum(axis=1).max()),
        "bias_deg_per_s": np.rad2deg(bias),
    }
    questions = QUESTIONS if flow.get("estimate_bias") else OF_ATTITUDE
    configuration = configured(flow, estimator={"mode": "guaranteed", "questions": list(questions)})
    true_bias = (log.rates - log.rates) + np.nan
    estimated = estimation.estimate(dataclasses.replace(log, true_vectors=true_bias), configuration)
    counted = estimation.summarize(estimated, configuration)["questions"]
    assert all(counted[question]["inside_share_of_rows"] == 1.0 for question in OF_ATTITUDE)
    if "vector" in questions:
        assert counted["vector"]["rows"] == len(log.times)
        assert counted["vector"]["compared_rows"] == 0


@needs_datasets
def test_answers_hold_on_a_real_recording(tmp_path):
    rows = slice(2500, 6500)  # at rest for 3 s, then turned by hand
    with np.load(broad("02")) as file:
        np.savez(tmp_path / "log.npz", **{name: file[name][rows] for name in ("t", "gyr", "acc", "mag", "q_ref")})
    truth = {"attitude_columns": [f"q_ref[{i}]" for i in range(4)], "error_deg": 0.5}
    configuration = Configuration.model_validate(ruled(truth=truth)).with_questions(OF_ATTITUDE)
    estimated = estimation.estimate(logs.read_log(tmp_path / "log.npz", configuration), configuration)
    assert (estimated.guaranteed.sets.claims == 0).all()
    assert estimated.guaranteed.given.turns is not None
    ratios = assert_answers_hold(estimated, configuration, OF_ATTITUDE)
    assert ratios["reference_turns"][:2].max() < 0.9
    # About up it is the heading, by another search.
    up, bounds = intervals(estimated.result.turns_reference)[:, 2], estimated.guaranteed.sets.attitude_bounds
    width = bounds.heading_to - bounds.heading_from
    assert (np.abs(up - np.column_stack([bounds.heading_from, bounds.heading_to])) <= 0.02 * width[:, None]).all()


# --- the judge --------------------------------------------------------------------------------------------------------


def test_the_truths_turns_are_those_of_geometry():
    configuration = body(("reference_turns", "body_turns"))
    log = body_log(5, count=60)
    sets = estimation.estimate(log, configuration).guaranteed.sets
    for axis in range(3):
        for of_body in (False, True):
            turn = np.array(
                [
                    float(tilt_and_heading(center, true, center[:, axis] if of_body else np.eye(3)[axis])[1])
                    for center, true in zip(sets.attitudes, log.true_attitudes, strict=True)
                ]
            )
            anywhere = np.tile([-3.0, 3.0], (60, 3, 1))
            for beyond, is_inside in ((-1e-9, True), (1e-9, False)):
                tight = anywhere.copy()
                tight[:, axis, 0] = turn - 0.1
                tight[:, axis, 1] = turn - beyond
                answers = Answers(**{"body_turns" if of_body else "reference_turns": tight})
                found = judging.columns_of(answers, sets, log.true_attitudes, None)
                forms = found["turns_body_forms" if of_body else "turns_reference_forms"]
                assert ((forms <= 1.0) == is_inside).all()


def test_a_truth_that_may_be_off_is_inside_if_any_so_near_is():
    sets = estimation.estimate(body_log(count=3), body(())).guaranteed.sets
    turned = sets.attitudes @ el.exp([0.0, 0.0, 0.1])
    answers = Answers(
        body_turns=np.tile([-0.09, 0.09], (3, 3, 1)),
        own_attitudes=sets.attitudes,
        own_shapes=np.tile(0.09**2 * np.eye(3), (3, 1, 1)),
    )
    for error, is_inside in ((0.0, False), (0.009, False), (0.0111, True)):
        found = judging.columns_of(answers, sets, turned, None, error)
        assert ((found["turns_body_forms"] <= 1.0) == is_inside).all(), error
        assert ((found["own_forms"] <= 1.0) == is_inside).all(), error


def test_a_truth_half_a_turn_away_is_outside_and_an_unknown_one_neither():
    sets = estimation.estimate(body_log(count=3), body(())).guaranteed.sets
    away = sets.attitudes @ np.diag([-1.0, -1.0, 1.0])
    away[1] = np.nan
    answers = Answers(
        body_turns=np.tile([-3.1, 3.1], (3, 3, 1)),
        own_attitudes=sets.attitudes,
        own_shapes=np.tile(np.eye(3), (3, 1, 1)),
    )
    found = judging.columns_of(answers, sets, away, None)
    for name in ("turns_body_forms", "own_forms"):
        assert np.isnan(found[name][1])
        assert (found[name][[0, 2]] > 1.0).all()


def test_the_own_set_is_about_a_center_of_its_own():
    sets = estimation.estimate(body_log(count=3), body(())).guaranteed.sets
    center = sets.attitudes @ el.exp([0.2, 0.0, 0.0])
    answers = Answers(own_attitudes=center, own_shapes=np.tile(0.1**2 * np.eye(3), (3, 1, 1)))
    for angle in (0.099, 0.101):
        true = center @ el.exp(2.0 * np.arctan(0.5 * angle) * np.array([0.6, 0.0, 0.8]))
        forms = judging.columns_of(answers, sets, true, None)["own_forms"]
        np.testing.assert_allclose(forms, (angle / 0.1) ** 2, rtol=1e-9)


def test_vectors_are_judged_by_each_component():
    sets = estimation.estimate(body_log(count=4), body(())).guaranteed.sets
    answers = Answers(vectors=np.tile([[0.0, 1.0], [0.0, 2.0], [-1.0, 0.0]], (4, 1, 1)))
    true = np.array([[0.5, 1.0, -0.5], [0.75, 1.0, -0.5], [0.5, 2.1, -0.5], [0.5, np.nan, -0.5]])
    forms = judging.columns_of(answers, sets, None, true)["vector_forms"]
    np.testing.assert_allclose(forms, [0.0, 0.25, 1.1**2, np.nan], rtol=1e-12)


# --- the loop ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("criterion", ["volume", "trace"])
@pytest.mark.parametrize("policy", ["drop_measurement", "restart"])
def test_what_is_asked_changes_nothing_else(policy, criterion):
    log = body_log(2)
    log.directions[30, 0] = -log.directions[30, 0]  # contradicts
    plain = estimation.estimate(log, body((), policy=policy, criterion=criterion))
    asked = estimation.estimate(log, body(policy=policy, criterion=criterion))
    assert plain.guaranteed.sets.dropped.any() or policy == "restart"
    assert plain.answers is None
    columns = asked.result.columns()
    for name, column in plain.result.columns().items():
        np.testing.assert_array_equal(columns.pop(name), column, err_msg=name)
    new = {name.split("_")[0] for name in columns}
    assert new == {"turn", "wx", "wy", "wz", "own", "vector"}
    summary = estimation.summarize(plain, body(()))
    assert "questions" not in summary
    assert set(summary["sizes"]["all"]) == {
        "rows",
        "with_set",
        "half_width_reference_deg",
        "largest_angle_deg",
        "tilt_bound_deg",
        "heading_bound_deg",
        "up_bound_deg",
    }


def test_the_answers_are_those_of_a_program():
    log = body_log(1, count=40)
    answers = estimation.estimate(log, body()).answers
    flow = el.GuaranteedRigidBodyFlow(el.RigidBody(INERTIA), step=0.05)
    asked, own_sets = el.GuaranteedFilter(flow), 0
    for row, time in enumerate(log.times):
        asked.predict(time)
        there = np.isfinite(log.directions[row, :, 0])
        if np.isfinite(log.rates[row, 0]):
            seen = (log.directions[row, there], REFERENCES[there], BOUND)
            asked.update(*seen, angular_velocity=log.rates[row], rate_bound=RATE_BOUND)
        for axis in range(3):
            for found, answer in (
                (answers.reference_turns, asked.turn_about(asked.ellipsoid.attitude[axis])),
                (answers.body_turns, asked.turn_about(np.eye(3)[axis])),
                (answers.vectors, asked.vector_along(np.eye(3)[axis])),
            ):
                # Up to what a search leaves where the set says as much.
                np.testing.assert_allclose(found[row, axis], answer, atol=0.01 * (answer.most - answer.least))
        own = asked.attitude_set()
        np.testing.assert_allclose(answers.own_shapes[row], own.shape, rtol=0.0, atol=1e-9 * np.trace(own.shape))
        if np.linalg.det(own.shape) < 0.98 * np.linalg.det(asked.ellipsoid.shape[:3, :3]):
            np.testing.assert_allclose(answers.own_attitudes[row], own.attitude, rtol=0.0, atol=1e-9)
            own_sets += np.abs(own.attitude - asked.ellipsoid.attitude).max() > 1e-6
    assert own_sets > 20


def test_torques_wheels_and_a_start_are_those_of_the_run():
    log, draws = body_log(4, count=40), np.random.default_rng(0)
    torques, wheels = 1e-3 * draws.standard_normal((2, 40, 3))
    log = dataclasses.replace(log, control_torques=torques, wheel_momenta=wheels)
    quaternion = Rotation.from_matrix(log.true_attitudes[0]).as_quat(scalar_first=True)
    start = {"kind": "given", "attitude_qw_qx_qy_qz": quaternion.tolist(), "P_diagonal": [0.04] * 3 + [0.25] * 3}
    fields = body(QUESTIONS, policy="drop_measurement").model_dump(mode="json", exclude_unset=True)
    fields["flow"]["largest_rate_deg_per_s"] = 60.0
    configuration = Configuration.model_validate(fields | {"start": start})
    # The centers are compared row by row: a filter with other input would be elsewhere.
    answers = estimation.estimate(log, configuration).answers
    assert np.isfinite(answers.reference_turns).all()


def test_a_second_filter_elsewhere_is_noticed():
    configuration = body()
    run = run_guaranteed(body_log(count=12), configuration)
    other = dataclasses.replace(run.given, measured=run.given.measured | {"rate_bound": 2.0 * RATE_BOUND})
    with pytest.raises(AssertionError, match="the second filter is not where the first one was"):
        asking.answers_of(dataclasses.replace(run, given=other), configuration)


def test_only_what_is_asked_is_answered():
    for question in QUESTIONS:
        answers = estimation.estimate(body_log(count=5), body((question,))).answers
        there = {field.name for field in dataclasses.fields(answers) if getattr(answers, field.name) is not None}
        expected = {"vector": {"vectors"}, "attitude": {"own_attitudes", "own_shapes"}}.get(question, {question})
        assert there == expected


def test_where_a_search_finds_no_bound_the_set_stands(monkeypatch):
    configuration = body()
    run = run_guaranteed(body_log(count=12), configuration)

    def unbounded(*_):
        raise ValueError("rounding leaves no bound")

    class Filter(el.GuaranteedFilter):
        turn_about = vector_along = attitude_set = unbounded

    monkeypatch.setattr(asking.elliptude, "GuaranteedFilter", Filter)
    monkeypatch.setattr("elliptude.estimation.guaranteed_run.elliptude.GuaranteedFilter", Filter)
    answers = asking.answers_of(run, configuration)
    extents = run.sets.extents()
    np.testing.assert_allclose(answers.reference_turns[..., 1], extents.half_widths_reference, rtol=1e-12)
    np.testing.assert_allclose(-answers.body_turns[..., 0], extents.half_widths_body[:, :3], rtol=1e-12)
    np.testing.assert_allclose(
        answers.vectors[..., 1], run.sets.vectors + extents.half_widths_body[:, 3:], rtol=1e-12, atol=1e-15
    )
    np.testing.assert_array_equal(answers.own_shapes, run.sets.shapes[:, :3, :3])


# --- files and commands -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_table_is_read_as_it_was_written(tmp_path, suffix):
    result = estimation.estimate(body_log(count=20), body()).result
    result.write(tmp_path / f"results{suffix}")
    read = Result.read(tmp_path / f"results{suffix}")
    for field in dataclasses.fields(Result):
        if field.name.startswith(("turns", "vector_", "own")):
            assert getattr(result, field.name) is not None
            np.testing.assert_array_equal(getattr(read, field.name), getattr(result, field.name), err_msg=field.name)
    run, _ = read_run(tmp_path / f"results{suffix}")
    for axes, turns in (("reference", result.turns_reference), ("body", result.turns_body)):
        shown = dataclasses.replace(run, axes=axes).about_axes()
        assert shown.is_asked
        np.testing.assert_array_equal(shown.half_widths, np.abs(intervals(turns)).max(axis=2))
        assert (np.abs(shown.errors) <= shown.half_widths).all()
        assert "answer each axis by itself" in notes.bands_note(dataclasses.replace(run, axes=axes))
        drawn = picture._error_columns(result, axes, None, False)
        np.testing.assert_allclose(drawn[0].bounds, np.rad2deg(shown.half_widths))
        assert (drawn[1].bounds <= np.rad2deg(result.half_widths[:, 3:]) * (1.0 + 1e-9)).all()
        assert (np.abs(drawn[1].errors) <= drawn[1].bounds).all()
    assert "by itself" not in notes.bands_note(dataclasses.replace(run, turns_reference=None))


def command(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


def test_command(tmp_path):
    (tmp_path / "config.toml").write_text(tomlkit.dumps(ruled()))
    common = ("estimate", recording(tmp_path), "--config", tmp_path / "config.toml")
    plain = command(*common, "--out", tmp_path / "plain")
    assert plain.exit_code == 0, plain.output
    assert "asked by itself" not in plain.output
    asked = command(*common, "--out", tmp_path / "asked", "--questions", "attitude, reference_turns")
    assert asked.exit_code == 0, asked.output
    assert "asked one by one: half-widths about the reference axes" in asked.output
    assert "the attitude's own set within" in asked.output
    summary, before = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("asked", "plain"))
    assert list(summary["questions"]) == ["reference_turns", "attitude"]
    assert summary["questions"]["reference_turns"]["inside_share_of_unconditional_rows"] == 1.0
    for part, sizes in summary["sizes"].items():
        if sizes["with_set"]:
            own = sizes["reference_turn_half_width_deg"]["mean"]
            assert (np.array(own) <= np.array(before["sizes"][part]["half_width_reference_deg"]["mean"])).all()
    found = Result.read(tmp_path / "asked" / "results.csv")
    assert found.turns_body is None
    assert found.vector_ranges is None
    assert np.nanmax(found.own_forms) <= 1.0
    smoothed = command(*common, "--out", tmp_path / "smoothed", "--questions", "attitude, reference_turns", "--smooth")
    assert smoothed.exit_code == 0, smoothed.output
    both = Result.read(tmp_path / "smoothed" / "results.csv")
    assert np.nanmax(both.own_forms) <= 1.0
    assert np.nanmax(both.turns_reference_forms) <= 1.0
    volumes = [np.linalg.det(one.own_shapes) for one in (both, found)]
    assert (volumes[0] <= volumes[1] * (1.0 + 1e-12)).all()
    assert volumes[0].mean() < 0.999 * volumes[1].mean()


@pytest.mark.parametrize(
    ("options", "changes", "code", "message"),
    [
        (("--questions", "turns"), {}, 2, "'turns' is none of reference_turns, body_turns, vector, attitude"),
        (("--questions", "vector"), {}, 1, "'vector' asks for the gyro's bias, which is not estimated"),
        ((), {"questions": ["vector"]}, 1, "'vector' asks for the gyro's bias"),
        ((), {"mode": "first_order", "questions": ["attitude"]}, 1, "questions needs mode = 'guaranteed'"),
    ],
)
def test_what_is_not_answered_is_refused(tmp_path, options, changes, code, message):
    config = ruled()
    config["estimator"] = {"mode": "guaranteed"} | changes
    (tmp_path / "config.toml").write_text(tomlkit.dumps(config))
    done = command(
        "estimate", recording(tmp_path), "--config", tmp_path / "config.toml", "--out", tmp_path / "out", *options
    )
    assert done.exit_code == code, done.output
    assert message in " ".join(done.output.replace("│", " ").split())


def test_questions_need_the_guaranteed_mode():
    other = Configuration.model_validate(
        configured({"noise_deg_per_s": 1.0}).model_dump(exclude_unset=True)
        | {
            "estimator": {"mode": "first_order"},
            "flow": {"kind": "gyro", "columns": ["x", "y", "z"], "noise_deg_per_s": 1.0},
            "start": {"kind": "first_measurement", "bias_bound_deg_per_s": 1.0},
        }
    )
    with pytest.raises(ValueError, match=r"estimator\.questions: needs mode = 'guaranteed'"):
        other.with_questions(["attitude"])
