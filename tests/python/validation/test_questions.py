"""Questions to the guaranteed filter: the truth's own quantities are right, and an answer too small is found."""

import dataclasses
import json

import elliptude
import numpy as np
import pytest
from elliptude.results import GuaranteedLog
from elliptude.validation import adversary, monte_carlo, plants, questions
from elliptude.validation.adversary import Case
from elliptude.validation.monte_carlo import Arguments
from elliptude.validation.questions import QUESTIONS, QuestionTally
from scipy.spatial.transform import Rotation

LESS = 0.97
"""What a wrong answer has of the right one."""


def asked(case, trials=60, updates=20, seed=0):
    """Counts of each question, over the trials of a case."""
    given = Arguments(mode="guaranteed", trials=trials, updates=updates, seed=seed, cases=(case,))
    done = {name: monte_carlo.validate_chunk(given, *rest) for name, *rest in monte_carlo.chunks(given)}
    return monte_carlo.summarize(given, done)["total"]["questions"]


# --- the truth --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1.0, 3.0])
def test_tilt_and_heading_are_those_that_were_turned_by(size):
    """A tilt, which is a turn about a level axis, and then a turn about up."""
    draws = np.random.default_rng(3)
    for _ in range(50):
        up, other = draws.standard_normal((2, 3))
        level = np.cross(up, other)
        tilt, heading = size * draws.random(), size * draws.uniform(-1.0, 1.0)
        center = Rotation.random(random_state=draws)
        turns = (
            Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)) for angle, axis in ((heading, up), (tilt, level))
        )
        about_up, about_level = turns
        true = about_up * about_level * center
        found = questions.tilt_and_heading(center.as_matrix(), true.as_matrix(), up)
        np.testing.assert_allclose(found, (tilt, heading), atol=3e-15 / np.cos(0.5 * tilt))


def test_shares_are_ratios_of_the_error_to_each_answer():
    draws = np.random.default_rng(5)
    up = np.array([0.0, 0.0, 1.0])
    for scenario in ("free", "gyro"):
        of = plants.plant(Case(scenario, "two", 1.0, "inside"))
        center = Rotation.random(random_state=draws)
        tilt, heading = 0.3, -0.2
        true = Rotation.from_rotvec(heading * up) * Rotation.from_rotvec([tilt, 0.0, 0.0]) * center
        turn = (center.inv() * true).as_rotvec()
        in_reference = (true * center.inv()).as_rotvec()
        gibbs = 2.0 * np.tan(0.5 * np.linalg.norm(turn)) / np.linalg.norm(turn) * turn
        offset = np.array([0.01, -0.04, 0.02])
        root = np.linalg.qr(draws.standard_normal((6, 6)))[0] * draws.uniform(0.5, 2.0, 6)
        shape = root @ root.T
        answers = np.concatenate([[0.4, -0.5, 0.2, 0.9], [0.7, 0.8, 0.9], [0.1, 0.08, 0.1], [0.6, 0.7, 0.5], [1.1]])
        shares = questions.shares_of(
            of,
            (center.as_matrix()[None], np.zeros((1, 3))),
            shape[None],
            answers[None],
            (true.as_matrix()[None], offset[None]),
            up,
        )
        expected = {
            "attitude": np.sqrt(gibbs @ np.linalg.inv(shape[:3, :3]) @ gibbs),
            "body turns": np.max(np.abs(turn) / [0.7, 0.8, 0.9]),
            "reference turns": np.max(np.abs(in_reference) / [0.6, 0.7, 0.5]),
            "largest angle": np.linalg.norm(turn) / 1.1,
            "tilt": tilt / 0.4,
            "heading": abs(heading - (0.2 - 0.5) / 2) / 0.35,
            "angle": np.linalg.norm(turn) / 0.9,
        }
        vector = "bias" if scenario == "gyro" else "rate"
        expected[vector] = np.sqrt(offset @ np.linalg.inv(shape[3:, 3:]) @ offset)
        expected[f"{vector} axes"] = 0.04 / 0.08
        assert set(shares) == set(expected)
        for name, share in expected.items():
            np.testing.assert_allclose(shares[name], [share], rtol=1e-12, err_msg=name)


def test_an_answer_below_zero_holds_no_truth():
    of = plants.plant(FREE)
    up = np.array([0.0, 0.0, 1.0])
    center = np.eye(3)[None], np.zeros((1, 3))
    true = Rotation.from_rotvec([[0.1, 0.2, 0.3]]).as_matrix(), np.full((1, 3), 0.1)
    # The heading's ends are the wrong way round.
    answers = np.concatenate([[-1.0, 1.0, -1.0, -1.0], np.full(10, -1.0)])
    shares = questions.shares_of(of, center, np.eye(6)[None], answers[None], true, up)
    for name, share in shares.items():
        assert np.isinf(share) == (name not in {"attitude", "rate"}), name


def test_up_is_measured_or_anything_and_changes_no_error():
    of = plants.plant(Case("free", "three", 1.0, "inside"))
    ups = []
    for seed in range(40):
        draws, untouched = np.random.default_rng(seed), np.random.default_rng(seed)
        ups.append(questions.draw_vertical(of, draws))
        np.testing.assert_array_equal(draws.random(4), untouched.random(4))
    np.testing.assert_allclose(np.linalg.norm(ups, axis=1), 1.0, rtol=1e-15)
    measured = [np.array_equal(up, of.reference[0]) for up in ups]
    assert 10 < sum(measured) < 30


# --- answers that are too small ---------------------------------------------------------------------------------------

BOUNDS = {"tilt": [0], "heading": [1, 2], "angle": [3]}
EXTENTS = {
    "body turns": ("half_widths_body", slice(0, 3)),
    "rate axes": ("half_widths_body", slice(3, 6)),
    "bias axes": ("half_widths_body", slice(3, 6)),
    "reference turns": ("half_widths_reference", slice(0, 3)),
    "largest angle": ("largest_angles", slice(None)),
}
FREE = Case("free", "three", 1.0, "perpendicular")
# The attitude's own ellipsoid is not a part of a larger one there, so that its ends are reached.
BIAS = Case("gyro", "three", 1.0, "perpendicular", "bias")
GAPS = Case("free", "three", 7.0, "perpendicular", "gaps")
TURNS = Case("gyro", "three", 1.0, "perpendicular", "turns")
PLACES = [
    ("body turns", BIAS),
    ("reference turns", BIAS),
    ("largest angle", BIAS),
    ("tilt", FREE),
    ("tilt", BIAS),
    ("heading", FREE),
    ("heading", TURNS),
    ("angle", FREE),
    ("rate axes", GAPS),
    ("bias axes", TURNS),
]


def understate(monkeypatch, question, share=LESS):
    """A filter whose answer to one question is too small; its sets are right."""
    if question in BOUNDS:

        class Understating(elliptude.GuaranteedFilter):
            def run(self, *arguments, **options):
                log = super().run(*arguments, **options)
                if log.question_bounds is None:
                    return log
                bounds = log.question_bounds.copy()
                middle = bounds[:, BOUNDS[question]].mean(axis=1, keepdims=True) if question == "heading" else 0.0
                bounds[:, BOUNDS[question]] = middle + share * (bounds[:, BOUNDS[question]] - middle)
                return dataclasses.replace(log, question_bounds=bounds)

        monkeypatch.setattr(elliptude, "GuaranteedFilter", Understating)
        return
    right = GuaranteedLog.extents
    name, which = EXTENTS[question]

    def extents(log):
        values = getattr(right(log), name).copy()
        values.T[which] *= share
        return right(log)._replace(**{name: values})

    monkeypatch.setattr(GuaranteedLog, "extents", extents)


@pytest.mark.parametrize(("question", "case"), PLACES, ids=[f"{name} {case.name}" for name, case in PLACES])
def test_an_answer_that_is_a_few_percent_too_small_is_found(monkeypatch, question, case):
    right = asked(case)
    assert {name: counted["escapes"] for name, counted in right.items()} == dict.fromkeys(right, 0)
    assert right[question]["largest"]["share"] > LESS
    understate(monkeypatch, question)
    wrong = asked(case)
    assert wrong[question]["escapes"] > 0
    assert {name for name, counted in wrong.items() if counted["escapes"]} == {question}
    assert wrong[question]["largest"]["share"] == pytest.approx(right[question]["largest"]["share"] / LESS, rel=1e-9)


@pytest.mark.parametrize(("question", "case"), [("attitude", BIAS), ("rate", FREE), ("bias", TURNS)])
def test_a_part_of_the_set_that_is_too_small_is_found(monkeypatch, question, case):
    class Thinner(elliptude.GuaranteedFilter):
        def run(self, *arguments, **options):
            log = super().run(*arguments, **options)
            return dataclasses.replace(log, shapes=LESS**2 * log.shapes)

    assert asked(case)[question]["escapes"] == 0
    monkeypatch.setattr(elliptude, "GuaranteedFilter", Thinner)
    assert asked(case)[question]["escapes"] > 0


def test_a_cap_of_a_direction_that_is_too_small_is_found(monkeypatch):
    case = Case("gyro", "three", 1.0, "perpendicular")
    right = asked(case)["direction"]
    assert right["updates"] == 60 * 20
    assert right["escapes"] == 0

    class Smaller(elliptude.DirectionFilter):
        def run_turns(self, *arguments, **options):
            log = super().run_turns(*arguments, **options)
            return dataclasses.replace(log, angles=LESS * log.angles)

    monkeypatch.setattr(elliptude, "DirectionFilter", Smaller)
    assert asked(case)["direction"]["escapes"] > 0


def test_a_direction_that_is_refused_has_escaped(monkeypatch):
    class Refusing(elliptude.DirectionFilter):
        def run_turns(self, *arguments, bounds, **options):
            return super().run_turns(*arguments, bounds=0.1 * bounds, **options)

    monkeypatch.setattr(elliptude, "DirectionFilter", Refusing)
    assert asked(Case("gyro", "three", 1.0, "perpendicular"))["direction"]["escapes"] > 60


def test_row_by_row_the_answers_are_the_same():
    of = plants.plant(FREE)
    draws = np.random.default_rng(0)
    starts = adversary.draw_starts(of, 1, draws)
    errors = adversary.draw_errors(of, "perpendicular", starts, 6, draws)
    measured = adversary.measure(of, of.motion(starts, errors), errors)
    up, times = questions.draw_vertical(of, draws), of.interval * np.arange(7.0)

    def begun():
        start = elliptude.StateEllipsoid(starts.attitudes[0], starts.vectors[0], starts.shapes[0])
        return elliptude.GuaranteedFilter(of.guaranteed_flow(), start)

    bounds = {"reference": of.reference, "bounds": of.bound, "rate_bound": of.bound}
    log = begun().run(
        times, directions=measured.directions[0], angular_velocity=measured.rates[0], vertical=up, **bounds
    )
    single = begun()
    for row in range(1, 7):
        single.predict(times[row])
        single.update(measured.directions[0, row], angular_velocity=measured.rates[0, row], **bounds)
        found = questions.answers_of_filter(single, up)
        np.testing.assert_allclose(found, questions.answers_of_log(log)[row], rtol=1e-12)


# --- the counts -------------------------------------------------------------------------------------------------------


def test_counts():
    tally = QuestionTally()
    judged = np.array([[True, True, False], [True, True, True]])
    shares = {"tilt": np.array([[0.5, 0.9, np.nan], [0.2, 1.01, 0.3]])}
    tally.add(shares, judged, 10)
    largest = {"share": 1.01, "trial": 11, "update": 2}
    assert tally.counts == {"tilt": {"updates": 5, "escapes": 1, "largest": largest}}
    # A set without an answer.
    tally.add({"tilt": np.full((2, 3), np.nan)}, judged, 12)
    assert tally.counts["tilt"]["escapes"] == 6
    assert tally.counts["tilt"]["largest"]["trial"] == 12
    json.dumps(tally.counts, allow_nan=False)
    none = QuestionTally()
    none.add({"heading": np.full((2, 3), np.nan)}, np.zeros((2, 3), bool), 0)
    parts = [tally.counts, {"tilt": {"updates": 3, "escapes": 0, "largest": largest}}, none.counts]
    combined = questions.combine_questions(parts)
    assert combined["tilt"]["updates"] == 13
    assert combined["tilt"]["escapes"] == 6
    assert combined["tilt"]["largest"]["share"] > 1e300
    assert combined["heading"] == {"updates": 0, "escapes": 0, "largest": None}
    assert list(combined) == ["tilt", "heading"]


def test_every_question_is_asked_and_placed():
    found = {}
    for scenario in ("free", "gyro"):
        case = Case(scenario, "two", 7.0, "common")
        counted = asked(case, trials=4, updates=3)
        for of_name in counted.values():
            assert of_name["updates"] == 12
            largest = of_name["largest"]
            assert (largest["chunk"], largest["case"]) == (0, case.name)
            assert 0 <= largest["trial"] < 4
            assert 1 <= largest["update"] <= 3
        found |= counted
    assert set(found) == set(QUESTIONS)


def test_other_modes_are_not_asked(monkeypatch):
    given = Arguments(mode="paper", trials=3, updates=3, seed=0, cases=(FREE,))
    done = {name: monte_carlo.validate_chunk(given, *rest) for name, *rest in monte_carlo.chunks(given)}
    assert "questions" not in monte_carlo.summarize(given, done)["total"]


@pytest.mark.parametrize("question", ["body turns", "largest angle", "bias"])
def test_a_search_climbs_a_single_question(monkeypatch, question):
    """The same number of runs, with and without the climbing."""
    case = Case("gyro", "three", 1.0, "search")
    all_heights = monte_carlo._heights
    place = 1 + [*asked(case, trials=1, updates=1)].index(question)
    monkeypatch.setattr(monte_carlo, "_heights", lambda *arguments: all_heights(*arguments)[[place]])

    def reached():
        return np.mean([asked(case, trials=240, updates=6, seed=n)[question]["largest"]["share"] for n in range(4)])

    climbed = reached()
    monkeypatch.setattr(monte_carlo, "SEARCH_DRAWN", 1.0)
    assert climbed > reached() + 0.02
