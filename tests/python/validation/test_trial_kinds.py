"""Kinds of trials beside honest logs: they are what they say, and each finds a filter that is wrong."""

import dataclasses
import itertools
import json
from types import SimpleNamespace

import elliptude
import mpmath
import numpy as np
import pytest
from elliptude import _core
from elliptude.validation import adversary, judge, plants, thin_starts, trials
from elliptude.validation.adversary import Case
from elliptude.validation.questions import ANSWERS
from elliptude.validation.trial_kinds import KINDS, Trial
from elliptude.validation.trials import CONDITIONAL, FAILED, NO_SET, TOO_LATE, UNCONDITIONAL, Outcome

PLACES = [(name, scenario) for name, kind in KINDS.items() for scenario in kind.scenarios]
FAULTS = ("escapes", "overclaimed", "refused", "failed", "stuck")


def tried(kind, scenario, bound=1.0, noise="perpendicular", count=24, updates=20, seed=0):
    case = Case(scenario, "three", bound, noise, kind)
    return trials.try_kind(case, count, updates, np.random.default_rng(seed))


def drawn(kind, scenario, bound=1.0, noise="perpendicular", count=24, updates=20, seed=0):
    """Each trial of a kind, as it is told."""
    case, draws = Case(scenario, "three", bound, noise, kind), np.random.default_rng(seed)
    of = KINDS[kind].plant(plants.plant(case), draws)
    starts = KINDS[kind].starts(of, adversary.draw_starts(of, count, draws), draws)
    errors = adversary.draw_errors(of, case.noise, starts, updates, draws)
    motion = of.motion(starts, errors)
    measured = adversary.measure(of, motion, errors)
    told = [KINDS[kind].tell(Trial(of, starts, motion, measured, n), draws) for n in range(count)]
    return of, starts, motion, measured, told


# --- the filter -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "scenario"), PLACES)
def test_the_filter_withstands_every_kind(kind, scenario):
    counts = tried(kind, scenario, count=12)
    assert {name: counts[name] for name in FAULTS} == dict.fromkeys(FAULTS, 0)
    assert counts["updates"] > 0
    assert counts["unconditional"] > 0
    json.dumps(counts, allow_nan=False)


class Smaller(elliptude.GuaranteedFilter):
    """A filter whose sets are half as wide as they should be."""

    def run(self, *arguments, **options):
        log = super().run(*arguments, **options)
        return dataclasses.replace(log, shapes=log.shapes / 4)


@pytest.mark.parametrize(("kind", "scenario"), PLACES)
def test_every_kind_finds_sets_that_are_too_small(monkeypatch, kind, scenario):
    monkeypatch.setattr(elliptude, "GuaranteedFilter", Smaller)
    assert tried(kind, scenario)["escapes"] > 0


@pytest.mark.parametrize("scenario", ["free", "gyro"])
@pytest.mark.parametrize("kind", ["liar", "liars"])
def test_a_filter_that_never_regains_is_stuck(monkeypatch, kind, scenario):
    class Never(elliptude.GuaranteedFilter):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options | {"regain_after": 10**6})

    monkeypatch.setattr(elliptude, "GuaranteedFilter", Never)
    counts = tried(kind, scenario, updates=40)
    assert counts["stuck"] > 0.3 * counts["liars"]


@pytest.mark.parametrize("scenario", ["free", "gyro"])
@pytest.mark.parametrize("kind", ["liar", "liars"])
def test_a_filter_that_claims_too_much_is_found(monkeypatch, kind, scenario):
    class Boasting(elliptude.GuaranteedFilter):
        def run(self, *arguments, **options):
            log = super().run(*arguments, **options)
            claims = np.where(log.claims == CONDITIONAL, UNCONDITIONAL, log.claims)
            return dataclasses.replace(log, claims=claims)

    monkeypatch.setattr(elliptude, "GuaranteedFilter", Boasting)
    assert tried(kind, scenario, updates=40)["overclaimed"] > 0


def test_a_filter_that_refuses_the_truth_is_found(monkeypatch):
    class Narrow(elliptude.GuaranteedFilter):
        """Takes half the bounds of what it is given."""

        def run(self, times, **options):
            return super().run(times, **options | {"bounds": 0.5 * options["bounds"]})

    monkeypatch.setattr(elliptude, "GuaranteedFilter", Narrow)
    counts = tried("gaps", "gyro", bound=7.0)
    assert counts["refused"] > 0
    assert counts["conditional"] > 0


def test_a_filter_that_takes_late_rows_is_found(monkeypatch):
    class Careless(elliptude.GuaranteedFilter):
        def predict(self, *arguments, **options):
            pass

    monkeypatch.setattr(elliptude, "GuaranteedFilter", Careless)
    assert tried("rows", "gyro")["failed"] > 0


def test_a_filter_that_gives_up_is_found(monkeypatch):
    class Broken(elliptude.GuaranteedFilter):
        def run(self, *arguments, **options):
            raise ValueError("no")

        def predict(self, *arguments, **options):
            raise ValueError("no")

    monkeypatch.setattr(elliptude, "GuaranteedFilter", Broken)
    counts = tried("needle", "free")
    assert counts["failed"] == counts["updates"] == 24 * 20


def test_row_by_row_is_as_at_once(monkeypatch):
    """Where the filter refuses a row of many they are fed one by one, with the same result."""
    at_once = [tried(kind, scenario, updates=30) for kind, scenario in (("liar", "free"), ("rows", "gyro"))]
    monkeypatch.setattr(trials._Runner, "_at_once", lambda self, rows: False)
    assert [tried(kind, scenario, updates=30) for kind, scenario in (("liar", "free"), ("rows", "gyro"))] == at_once


def test_a_potential_of_ones_own_is_refused_by_the_guaranteed_flow():
    """It has no bounds of its torque, without which nothing is guaranteed; so no kind can try it."""

    class Own:
        def energy(self, time, attitude):
            return 0.0

        def torque(self, time, attitude):
            return np.zeros(3)

    with pytest.raises(TypeError, match=r"bounds of its torque|potential"):
        elliptude.GuaranteedRigidBodyFlow(_core.RigidBody(np.diag([1.0, 2.0, 2.5])), Own(), step=0.01)


# --- what is told -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "scenario"), PLACES)
def test_what_is_no_lie_keeps_its_bounds(kind, scenario):
    of, _starts, motion, _measured, told = drawn(kind, scenario)
    lies = 0
    for n, one in enumerate(told):
        attitudes, rates = motion.attitudes[n, one.rows], motion.rates[n, one.rows].astype(float)
        true = np.einsum("rji,mj->rmi", attitudes, of.reference)
        angles = np.arctan2(
            np.linalg.norm(np.cross(one.directions, true), axis=-1), np.sum(one.directions * true, axis=-1)
        )
        vectors = motion.vectors[n, one.rows]
        with np.errstate(over="ignore"):
            off = np.linalg.norm(one.rates - rates - (vectors if of.has_gyro else 0.0), axis=-1)
        wrong = np.column_stack([angles > of.bound + 1e-14, off > of.rate_bound + 1e-11])
        wrong[np.isnan(np.column_stack([angles, off]))] = False
        if of.has_gyro:  # the sample at the end is of no interval, and the rate changes within the last
            wrong[-1, -1] = one.lies[-1, -1]
        np.testing.assert_array_equal(wrong, one.lies)
        lies += int(one.lies.sum()) + one.start_lies
        assert kind != "bias" or not of.guaranteed_flow().drift.any()
        if "vector_bound" in one.options:
            assert np.linalg.norm(motion.vectors[n], axis=1).max() <= one.options["vector_bound"]
        assert one.lies.sum(axis=1).max() <= (1 if kind == "liar" else one.most_lies or 10)
    assert (lies > 0) == (kind in ("liar", "liars", "relaxed"))


def test_lies_are_anywhere_and_of_any_size():
    _of, _starts, motion, _measured, told = drawn("liar", "free", count=400, updates=30)
    where = {tuple(index) for one in told for index in np.argwhere(one.lies)}
    assert {row for row, _ in where} == set(range(1, 31))
    assert {sensor for _, sensor in where} == {0, 1, 2, 3}
    sizes = [
        float(np.abs(one.rates[row] - motion.rates[n, row]).max())
        for n, one in enumerate(told)
        for row, sensor in np.argwhere(one.lies)
        if sensor == 3
    ]
    assert min(sizes) < 1e3
    assert max(sizes) > 1e250
    assert {one.options["policy"] for one in told} == {"drop_measurement", "restart"}
    assert {one.options["regain_after"] for one in told} == {1, 3, 10}
    assert any(one.start_lies for one in told)


def test_rows_are_lost_repeated_and_late():
    told = drawn("rows", "gyro", count=60)[-1]
    steps = np.concatenate([np.diff(one.rows) for one in told])
    assert {-1, 0, 1, 2} <= set(steps.tolist())
    assert all(np.isnan(one.directions[1:]).any() for one in told)
    outcome = trials.try_kind(Case("gyro", "three", 1.0, "perpendicular", "rows"), 60, 20, np.random.default_rng(0))
    late = int(np.sum(steps < 0))
    assert outcome["updates"] == sum(len(one.rows) - 1 for one in told) - late


def test_gaps_are_long():
    longest = [int(np.diff(one.rows).max(initial=1)) for one in drawn("gaps", "free", count=60)[-1]]
    assert max(longest) >= 10


@pytest.mark.parametrize("scenario", KINDS["thin"].scenarios)
def test_thin_sets_are_thin_and_hold_the_truth_at_their_edge(scenario):
    of, starts, motion, _measured, _told = drawn("thin", scenario, bound=20.0, count=60)
    thinnest = []
    for n in range(60):
        shape = starts.shapes[n]
        assert (shape == shape.T).all()
        gibbs, offset = _gibbs(starts.attitudes[n].T @ motion.attitudes[n, 0]), motion.vectors[n, 0] - starts.vectors[n]
        with mpmath.workdps(40):
            exact = mpmath.matrix(shape.tolist())
            state = mpmath.matrix([*gibbs, *(mpmath.mpf(x) for x in offset)])
            form = (state.T * (exact**-1) * state)[0]
            values = mpmath.eigsy(mpmath.matrix(shape[:3, :3].tolist()), eigvals_only=True)
            thinnest.append(float(mpmath.sqrt(min(values) / max(values))))
        assert 0.99 < form <= 1
    assert min(thinnest) < 3e-8
    assert of.interval > 0


def test_a_thin_set_that_the_filter_takes_for_flat_is_not_drawn():
    """Of thin/wide 1e-8 about one in a thousand, whose trial could not begin."""
    draws = np.random.default_rng(4)
    of = KINDS["thin"].plant(plants.plant(Case("pendulum", "three", 7.0, "common", "thin")), draws)
    starts = adversary.draw_starts(of, 1000, draws)
    thin = thin_starts.thin_starts(of, starts, np.full(1000, of.bound), np.full(1000, 1e-8), draws)
    flow = elliptude.GuaranteedGyroFlow(1.0)
    for shape in thin.shapes:
        elliptude.GuaranteedFilter(flow, elliptude.StateEllipsoid(np.eye(3), np.zeros(3), shape, "gibbs"))


def _gibbs(rotation):
    """2 tan(θ/2) n, in the digits of mpmath."""
    with mpmath.workdps(40):
        r = mpmath.matrix(rotation.tolist())
        trace = 1 + r[0, 0] + r[1, 1] + r[2, 2]
        return [2 * (r[j, i] - r[i, j]) / trace for i, j in ((1, 2), (2, 0), (0, 1))]


def test_bodies_of_the_extremes():
    for kind, low, high in (("needle", 10.0, 1e5), ("spherical", 1.0, 1.01)):
        ratios = []
        for seed in range(40):
            moments = np.linalg.eigvalsh(drawn(kind, "free", count=1, seed=seed)[0].scenario.inertia_matrix)
            assert moments[2] <= moments[0] + moments[1]
            ratios.append(moments[2] / moments[0])
        assert min(ratios) >= low - 1e-9
        assert max(ratios) <= high * 1.01
        assert max(ratios) > 1.0 + 0.1 * (high - 1.0) or kind == "needle"
        assert kind != "needle" or max(ratios) > 1e4


def test_the_torque_of_an_eccentric_orbit_keeps_its_bound():
    rng = np.random.default_rng(0)
    largest = 0.0
    for eccentricity in (1e-4, 1e-3, 1e-2):
        of = dataclasses.replace(plants.plant(Case("orbit", "two", 1.0, "inside")), eccentricity=eccentricity)
        bound, inertia = of._eccentric_torque(), of.scenario.inertia_matrix
        for mean in np.linspace(0.0, 2.0 * np.pi, 100):
            anomaly = mean
            for _ in range(20):
                anomaly = mean + eccentricity * np.sin(anomaly)
            radius = 1.0 - eccentricity * np.cos(anomaly)
            true = np.arctan2(np.sqrt(1 - eccentricity**2) * np.sin(anomaly), np.cos(anomaly) - eccentricity)
            frames = np.linalg.qr(rng.standard_normal((50, 3, 3)))[0]
            torques = [
                3.0 * nearness * np.cross(r, r @ inertia)
                for nearness, angle in ((radius**-3, true), (1.0, mean))
                for r in [frames @ np.array([np.cos(angle), np.sin(angle), 0.0])]
            ]
            largest = max(largest, np.linalg.norm(torques[0] - torques[1], axis=1).max() / bound)
    assert 0.3 < largest <= 1.0


def test_a_gyro_of_constant_rate_turns_by_its_closed_form():
    of, starts, motion, measured, _told = drawn("turns", "gyro", count=5)
    assert of.largest_rate * of.interval > 1.0
    for n, row in itertools.product(range(5), (1, 20)):
        with mpmath.workdps(50):
            pairs = zip(measured.rates[n, 0], motion.vectors[n, 0], strict=True)
            rate = [mpmath.mpf(float(sample)) - mpmath.mpf(float(bias)) for sample, bias in pairs]
            speed = mpmath.sqrt(sum(x * x for x in rate))
            angle, axis = speed * mpmath.mpf(float(of.interval * row)), [x / speed for x in rate]
            hat = mpmath.matrix([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
            turn = mpmath.eye(3) + mpmath.sin(angle) * hat + (1 - mpmath.cos(angle)) * hat * hat
            expected = mpmath.matrix(motion.attitudes[n, 0].tolist()) * turn
            off = max(abs(expected[i, j] - float(motion.attitudes[n, row, i, j])) for i in range(3) for j in range(3))
        assert off < 3e-16 + 1e-19 * angle
    assert starts.from_measurement.sum() == 0


# --- the judge --------------------------------------------------------------------------------------------------------


def test_forms_of_nearly_singular_sets():
    rng = np.random.default_rng(1)
    for _ in range(5):
        lengths = 10.0 ** -np.array([0.3, 1.0, 2.0, 4.0, 6.0, 7.5])
        axes = np.linalg.qr(rng.standard_normal((6, 6)))[0]
        shape = (axes * lengths**2) @ axes.T
        shape = 0.5 * (shape + shape.T) + 1e-15 * np.eye(6)
        offset = np.concatenate([np.zeros(3), 1e-3 * rng.standard_normal(3)])
        with mpmath.workdps(60):
            column = mpmath.matrix(offset.tolist())
            expected = float((column.T * (mpmath.matrix(shape.tolist()) ** -1) * column)[0])
        form = judge.forms_of(
            "guaranteed", np.eye(3)[None], np.zeros((1, 3)), shape[None], np.eye(3)[None], offset[None, 3:]
        )
        np.testing.assert_allclose(form, expected, rtol=1e-12)
    assert judge.exact_root(np.diag([1.0, -1.0])) is None
    assert judge.exact_root(np.ones((2, 2))) is None
    np.testing.assert_allclose(np.array(judge.exact_root(np.array([[4.0, 2.0], [2.0, 5.0]])), float), [[2, 0], [1, 2]])


def story(claims, *, contradicted=(), dropped=(), lies=(), start_lies=False, gyro=False, regain_after=2, most_lies=0):
    """A told log with two directions and a rate, and what a filter made of it; claims by their first letters."""
    count = len(claims)
    of = SimpleNamespace(has_gyro=gyro)
    told = drawn("liar", "gyro", count=1, updates=count - 1)[-1][0]
    marks = [np.zeros((count, 3), bool) for _ in range(2)]
    for mark, places in zip(marks, (lies, dropped), strict=True):
        for row, sensor in places:
            mark[row, sensor] = True
    told = dataclasses.replace(
        told,
        lies=marks[0],
        start_lies=start_lies,
        options={"regain_after": regain_after},
        most_lies=most_lies,
        shape=np.eye(6),
    )
    where = np.zeros(count, bool)
    where[list(contradicted)] = True
    nothing = np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan), np.full((count, 6, 6), np.nan)
    codes = {"u": UNCONDITIONAL, "c": CONDITIONAL, "n": NO_SET, "f": FAILED, "l": TOO_LATE}
    outcome = Outcome(
        *nothing,
        claims=np.array([codes[claim] for claim in claims], np.uint8),
        dropped=marks[1],
        contradicted=where,
        refused=np.zeros(count, bool),
        forgotten=np.zeros(count, bool),
        answers=np.full((count, ANSWERS), np.nan),
    )
    return of, told, outcome


@pytest.mark.parametrize(
    ("of_story", "resting", "refused"),
    [
        # A lie that is dropped does no harm; one that is kept is in the set until the claim is regained.
        ({"claims": "uucccu", "contradicted": [2], "dropped": [(2, 1)], "lies": [(2, 1)]}, "", ""),
        ({"claims": "uuuccu", "contradicted": [3], "dropped": [(3, 0)], "lies": [(2, 1)]}, "234", ""),
        ({"claims": "uuccuu", "contradicted": [2], "dropped": [(2, 0)], "lies": [(2, 1)]}, "23", ""),
        ({"claims": "uuccuu", "contradicted": [2], "lies": [(4, 1)]}, "45", "2"),
        ({"claims": "uuccu", "contradicted": [2], "start_lies": True}, "0123", ""),
        # A true one is refused.
        ({"claims": "uuccu", "contradicted": [2], "dropped": [(2, 0)]}, "", "2"),
        ({"claims": "uuccu", "contradicted": [2], "dropped": [(2, 0), (2, 1)], "lies": [(2, 1)]}, "", "2"),
        (
            {
                "claims": "uuccu",
                "contradicted": [2],
                "dropped": [(2, i) for i in range(3)],
                "lies": [(2, i) for i in range(3)],
            },
            "",
            "",
        ),
        ({"claims": "unccu", "contradicted": [1], "dropped": [(1, 0), (1, 1)], "lies": [(1, 1)]}, "", ""),
        ({"claims": "unccu", "contradicted": [1], "dropped": [(1, 0), (1, 1)]}, "", "1"),
        # A gyro's sample is of the interval after it.
        ({"claims": "uuuu", "lies": [(1, 2)], "gyro": True}, "23", ""),
        ({"claims": "uuluu", "lies": [(1, 2)], "gyro": True}, "34", ""),
        # Relaxed: some may lie; what is dropped must have.
        ({"claims": "uuu", "lies": [(1, 0), (2, 1)], "most_lies": 1}, "", ""),
        ({"claims": "uuu", "lies": [(1, 0), (1, 1)], "most_lies": 1}, "12", ""),
        ({"claims": "uuu", "lies": [(1, 0)], "dropped": [(1, 0), (2, 0)], "most_lies": 1}, "", "2"),
    ],
)
def test_what_a_set_rests_on(of_story, resting, refused):
    found = trials.rests_on_lies(*story(**of_story))
    assert ["".join(map(str, np.flatnonzero(where))) for where in found] == [resting, refused]


@pytest.mark.parametrize(
    ("of_story", "rows"),
    [
        ({"claims": "uuccu", "contradicted": [2]}, ""),
        ({"claims": "uucuu", "contradicted": [2]}, "3"),
        ({"claims": "uuuuu", "contradicted": [2]}, "23"),
        ({"claims": "uuccu", "contradicted": [2], "regain_after": 3}, "4"),
        ({"claims": "uuccu", "contradicted": [2], "most_lies": 1}, ""),
        ({"claims": "unuuu", "contradicted": [1]}, ""),
    ],
)
def test_claims_that_are_too_large(of_story, rows):
    _of, told, outcome = story(**of_story)
    told = dataclasses.replace(told, directions=np.ones((len(told.lies), 2, 3)))
    assert "".join(map(str, np.flatnonzero(trials.overclaimed(told, outcome)))) == rows


@pytest.mark.parametrize(
    ("of_story", "outside", "expected"),
    [
        ({"claims": "uuccuuuuu", "contradicted": [2], "lies": [(2, 0)]}, "", (2, False)),
        ({"claims": "uuccuuuuu", "contradicted": [2], "lies": [(1, 0)]}, "1", (2, False)),
        ({"claims": "uuccccccc", "contradicted": [2], "lies": [(2, 0)]}, "", (None, True)),
        ({"claims": "uuccuuuuu", "contradicted": [2], "lies": [(2, 0)]}, "8", (None, True)),
        ({"claims": "uucc", "contradicted": [2], "lies": [(2, 0)]}, "", (None, False)),
        ({"claims": "uuuuccccc", "contradicted": [4], "lies": [(4, 0)], "regain_after": 3}, "", (None, False)),
        ({"claims": "uuuuuuuuu", "lies": [(2, 0)]}, "234", (None, False)),
        ({"claims": "uuccuuuuu", "contradicted": [2]}, "", (None, False)),
        ({"claims": "ufffff", "start_lies": True}, "", (None, True)),
    ],
)
def test_recovery(of_story, outside, expected):
    _of, told, outcome = story(**of_story)
    inside = outcome.claims <= CONDITIONAL
    inside[[int(row) for row in outside]] = False
    assert trials.recovery(told, outcome, inside) == expected
