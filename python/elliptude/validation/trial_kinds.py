"""Kinds of trials besides honest logs: liars, gaps, thin sets, extreme bodies, and the filter's options.

A kind says where it makes sense, how it changes the motion and the first sets, and what it tells the filter of a trial,
including which of that is a lie. `elliptude.validation.trials` judges all kinds alike.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.simulation import simulated
from elliptude.typing import FloatArray
from elliptude.validation.adversary import SCENARIOS, Measured, Motion, Plant, Starts
from elliptude.validation.plants import GyroPlant, RigidBodyPlant
from elliptude.validation.thin_starts import thin, tiny

BODIES = tuple(name for name in SCENARIOS if name != "gyro")
LIE_SIZES = (1e-3, 1e300)
"""Range of lies that are added to an angle (rad) or a rate (rad/s); their logarithms are uniform."""
REGAIN_AFTER = (1, 3, 10)


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial as it was drawn, all honest."""

    of: Plant
    starts: Starts
    """First sets of all trials."""
    motion: Motion
    """Motion of all trials."""
    measured: Measured
    """Measurements of all trials."""
    number: int
    """Index of the trial."""

    @property
    def vectors(self) -> FloatArray:
        """The true rates or biases, rad/s, shape (U + 1, 3)."""
        vectors: FloatArray = self.motion.vectors[self.number]
        return vectors


@dataclass(frozen=True, eq=False)
class Told:
    """Everything that the filter of one trial is told: R rows in the order of arrival; the first has no measurement."""

    rows: NDArray[np.intp]
    """The update of the motion of each row, shape (R,). A row before its predecessor comes too late to be used."""
    directions: FloatArray
    """Body axes, NaN where none was measured, shape (R, m, 3)."""
    rates: FloatArray
    """Measured, or the gyro's sample at the row, for the interval that begins there, rad/s, shape (R, 3)."""
    lies: NDArray[np.bool_]
    """Which directions and, last, rates are further off than their bounds, shape (R, m + 1)."""
    attitude: FloatArray
    """The first set's center, the attitude, (3, 3)."""
    vector: FloatArray
    """The first set's center, the vector, rad/s, (3,)."""
    shape: FloatArray | None
    """P of the first set; None if the filter is not told a first set."""
    chart: str
    """Chart of the first set."""
    start_lies: bool
    """Whether the truth may not be in the first set."""
    options: dict[str, Any]
    """Options of the filter."""
    most_lies: int = 0
    """How many measurements of an update may be lies without harm to the filter's promise."""
    increments: FloatArray | None = None
    """Bounds of the angles by the gyro's errors, rad, shape (R,)."""


Tell = Callable[[Trial, np.random.Generator], Told]


def _same_plant(of: Plant, draws: np.random.Generator) -> Plant:
    return of


def _same_starts(of: Plant, starts: Starts, draws: np.random.Generator) -> Starts:
    return starts


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of trial."""

    tries: str
    """A description."""
    tell: Tell
    """A function that draws what the filter of a trial is told."""
    plant: Callable[[Plant, np.random.Generator], Plant] = _same_plant
    """A function that replaces the scenario's body or gyro, for the trials of a chunk."""
    starts: Callable[[Plant, Starts, np.random.Generator], Starts] = _same_starts
    """A function that replaces the first sets that were drawn."""
    scenarios: tuple[str, ...] = field(default=SCENARIOS)
    """Where the kind makes sense."""


# --- what is told -----------------------------------------------------------------------------------------------------


def _honest(trial: Trial, draws: np.random.Generator) -> Told:
    """All rows, as measured."""
    number, starts = trial.number, trial.starts
    directions = trial.measured.directions[number].copy()
    return Told(
        rows=np.arange(len(directions)),
        directions=directions,
        rates=trial.measured.rates[number].copy(),
        lies=np.zeros((len(directions), directions.shape[1] + 1), bool),
        attitude=starts.attitudes[number],
        vector=starts.vectors[number],
        shape=None if starts.from_measurement[number] else starts.shapes[number],
        chart=getattr(starts, "chart", "exponential"),
        start_lies=False,
        options={"policy": "drop_measurement"},
    )


def _bounded_vector(trial: Trial, told: Told, draws: np.random.Generator) -> Told:
    """With a bound of the vector that holds, up to three times too large; a gyro may then start from nothing."""
    largest = float(np.linalg.norm(trial.vectors, axis=1).max()) + 1e-12
    options = told.options | {"vector_bound": largest * draws.uniform(1.0, 3.0)}
    if trial.of.has_gyro and draws.random() < 0.5:
        return replace(told, options=options, shape=None)
    return replace(told, options=options)


def _lie(trial: Trial, told: Told, row: int, sensor: int, draws: np.random.Generator) -> None:
    """Make a direction or, for the last sensor, a rate wrong by an amount of any size."""
    of, number = trial.of, trial.number
    at, count = told.rows[row], told.directions.shape[1]
    size = math.exp(draws.uniform(*np.log(LIE_SIZES)))
    towards = simulated.on_sphere(draws, ())
    if sensor == count:
        told.rates[row] += size * towards
        true = trial.motion.rates[number, at].astype(np.float64) + (trial.vectors[at] if of.has_gyro else 0.0)
        with np.errstate(over="ignore"):
            told.lies[row, sensor] = not np.linalg.norm(told.rates[row] - true) <= of.rate_bound
        return
    true = of.reference[sensor] @ trial.motion.attitudes[number, at]
    if size < math.pi:
        across = np.cross(towards, told.directions[row, sensor])
        across *= size / np.linalg.norm(across)
        told.directions[row, sensor] = scipy.spatial.transform.Rotation.from_rotvec(across).apply(
            told.directions[row, sensor]
        )
    else:
        told.directions[row, sensor] = towards
    wrong = told.directions[row, sensor]
    angle = math.atan2(float(np.linalg.norm(np.cross(wrong, true))), float(wrong @ true))
    told.lies[row, sensor] = angle > of.bound


def _wrong_start(told: Told, draws: np.random.Generator) -> Told:
    """With a first set that is wrong in the attitude or in the vector."""
    size, towards = math.exp(draws.uniform(*np.log(LIE_SIZES))), simulated.on_sphere(draws, ())
    if draws.random() < 0.5:
        turn = scipy.spatial.transform.Rotation.from_rotvec(
            (size if size < math.pi else math.pi * draws.random()) * towards
        ).as_matrix()
        return replace(told, attitude=told.attitude @ turn, start_lies=True)
    return replace(told, vector=told.vector + size * towards, start_lies=True)


def _with_policy(trial: Trial, told: Told, draws: np.random.Generator) -> Told:
    """Any policy that goes on after a contradiction, and a number of updates after which a claim is regained."""
    last = len(told.rows) - 1
    choices = [after for after in REGAIN_AFTER if 3 * after <= last] or [1]
    policy = ("drop_measurement", "restart")[int(draws.integers(2))]
    regain_after = int(draws.choice(choices))
    return replace(told, options=told.options | {"policy": policy, "regain_after": regain_after})


def _one_liar(trial: Trial, draws: np.random.Generator) -> Told:
    told = _bounded_vector(trial, _with_policy(trial, _honest(trial, draws), draws), draws)
    sensors, last = told.lies.shape[1], len(told.rows) - 1
    sensor = int(draws.integers(sensors + (told.shape is not None)))
    if sensor == sensors:
        return _wrong_start(told, draws)
    # The last sample of a gyro belongs to no interval.
    first = 0 if trial.of.has_gyro and sensor == sensors - 1 else 1
    early = draws.random() < 0.3
    row = first if early else int(draws.integers(first, last + first))
    _lie(trial, told, row, sensor, draws)
    return told


def _several_liars(trial: Trial, draws: np.random.Generator) -> Told:
    """In the first half of the updates each measurement may lie, and so may the start."""
    told = _bounded_vector(trial, _with_policy(trial, _honest(trial, draws), draws), draws)
    share = draws.uniform(0.02, 0.3)
    sensors, rows = told.lies.shape[1], len(told.rows)
    for row in range(rows // 2):
        for sensor in range(sensors):
            measured = row > 0 or (trial.of.has_gyro and sensor == sensors - 1)
            if measured and draws.random() < share:
                _lie(trial, told, row, sensor, draws)
    if told.shape is not None and draws.random() < share:
        return _wrong_start(told, draws)
    return told


def _rows(told: Told, rows: NDArray[np.intp]) -> Told:
    """Those rows, in that order."""
    return replace(
        told, rows=told.rows[rows], directions=told.directions[rows], rates=told.rates[rows], lies=told.lies[rows]
    )


def _with_gaps(trial: Trial, draws: np.random.Generator) -> Told:
    """One to four gaps, of up to half of the time, in which nothing comes."""
    told = _bounded_vector(trial, _honest(trial, draws), draws) if draws.random() < 0.5 else _honest(trial, draws)
    kept = np.ones(len(told.rows), bool)
    for _ in range(int(draws.integers(1, 5))):
        begin = int(draws.integers(1, len(kept)))
        kept[begin : begin + int(draws.integers(1, max(2, len(kept) // 2)))] = False
    return _rows(told, np.flatnonzero(kept))


def _disordered(trial: Trial, draws: np.random.Generator) -> Told:
    """Rows and measurements are lost, rows come twice, and rows come after the next one."""
    told = _honest(trial, draws)
    if draws.random() < 0.5:
        told = _bounded_vector(trial, told, draws)
    rows = [0]
    for row in range(1, len(told.rows)):
        what = draws.random()
        if what < 0.15:
            continue
        rows += [row, row] if what < 0.3 else [row]
    for at in range(1, len(rows) - 1):
        if rows[at] != 0 and draws.random() < 0.1:
            rows[at], rows[at + 1] = rows[at + 1], rows[at]
    told = _rows(told, np.array(rows))
    told.directions[draws.random(told.directions.shape[:2]) < 0.15] = np.nan
    if not trial.of.has_gyro:
        told.rates[draws.random(len(rows)) < 0.15] = np.nan
    return told


def _seldom_measured(trial: Trial, draws: np.random.Generator) -> Told:
    """Nine of ten updates have no measurement, so that the rounding of predictions adds up."""
    told = _honest(trial, draws)
    seldom = draws.random(len(told.rows)) > 0.1
    told.directions[seldom] = np.nan
    if not trial.of.has_gyro:
        told.rates[seldom] = np.nan
    return told


def _with_increments(trial: Trial, draws: np.random.Generator) -> Told:
    """The flow is told a large noise, and for each interval how small it really was."""
    told = _honest(trial, draws)
    return replace(told, increments=np.full(len(told.rows), trial.of.rate_bound * trial.of.interval))


def _bias_not_estimated(trial: Trial, draws: np.random.Generator) -> Told:
    told = _bounded_vector(trial, _honest(trial, draws), draws)
    return replace(told, options=told.options | {"estimate_vector": False})


def _relaxed(trial: Trial, draws: np.random.Generator) -> Told:
    """As many measurements of each update as allowed may lie; some are true, so nothing should contradict."""
    told = _honest(trial, draws)
    sensors = told.lies.shape[1] - (1 if trial.of.has_gyro else 0)
    most = min(int(draws.integers(1, 3)), sensors - 1)
    share = draws.random()
    # Not tried: a start from one update of which some may be wrong, which needs many sensors.
    for row in range(1, len(told.rows)):
        for sensor in draws.permutation(sensors)[:most]:
            if draws.random() < share:
                _lie(trial, told, row, int(sensor), draws)
    return replace(told, options={"policy": "relaxed", "most_wrong": most}, most_lies=most)


# --- what moves -------------------------------------------------------------------------------------------------------


def _body(of: Plant, moments: list[float], draws: np.random.Generator) -> RigidBodyPlant:
    assert isinstance(of, RigidBodyPlant)
    inertia = tuple(tuple(row) for row in np.diag(draws.permutation(moments)).tolist())
    return replace(of, scenario=of.scenario.model_copy(update={"inertia": inertia}))


def _needle(of: Plant, draws: np.random.Generator) -> Plant:
    """One moment is up to 1e5 times smaller than the others, which differ as much as physics allows."""
    smallest = 10.0 ** -draws.uniform(1.0, 5.0)
    needle = _body(of, [smallest, 1.0, 1.0 + smallest * draws.random()], draws)
    # As large as for the scenario's body, although the body spins up about the needle.
    return replace(needle, unknown_torque=smallest * needle.unknown_torque)


def _nearly_spherical(of: Plant, draws: np.random.Generator) -> Plant:
    """Moments that differ by 1e-2 to 1e-14 of their size."""
    apart = 10.0 ** -draws.uniform(2.0, 14.0)
    return _body(of, [1.0, 1.0 + apart, 1.0 + apart * draws.random()], draws)


def _two_potentials(of: Plant, draws: np.random.Generator) -> Plant:
    assert isinstance(of, RigidBodyPlant)
    return replace(of, added_orbit_rate=draws.uniform(0.5, 3.0))


def _eccentric(of: Plant, draws: np.random.Generator) -> Plant:
    assert isinstance(of, RigidBodyPlant)
    return replace(of, eccentricity=10.0 ** draws.uniform(-4.0, -2.0))


def _exact(of: Plant, draws: np.random.Generator) -> Plant:
    """A gyro without errors at a constant rate, or a body whose torque is known, with truths to the last digit."""
    if isinstance(of, GyroPlant):
        return replace(of, rate_bound=0.0, noise=0.0, drift=0.0, angular_acceleration=0.0)
    assert isinstance(of, RigidBodyPlant)
    return replace(of, precise=True, unknown_torque=0.0)


def _exact_and_short(of: Plant, draws: np.random.Generator) -> Plant:
    """As `_exact`, a gyro with intervals of 1 ms to 0.1 s."""
    of = _exact(of, draws)
    return replace(of, interval=10.0 ** draws.uniform(-3.0, -1.0)) if isinstance(of, GyroPlant) else of


def _many_turns(of: Plant, draws: np.random.Generator) -> Plant:
    """Up to 1e4 rad in an interval of a gyro, up to 10 rad in one of a body."""
    of = _exact(of, draws)
    if isinstance(of, GyroPlant):
        return replace(of, largest_rate=10.0 ** draws.uniform(0.0, 4.0) / of.interval)
    assert isinstance(of, RigidBodyPlant)
    steps = of.scenario.steps_between_measurements * int(draws.integers(2, 21))
    return replace(of, scenario=of.scenario.model_copy(update={"steps_between_measurements": steps}))


def _much_noise(of: Plant, draws: np.random.Generator) -> Plant:
    assert isinstance(of, GyroPlant)
    return replace(of, noise=of.rate_bound * draws.uniform(1.0, 10.0))


def _any_bias(of: Plant, draws: np.random.Generator) -> Plant:
    """A bias that moves freely within an ellipsoid, which is all that the filter is told."""
    assert isinstance(of, GyroPlant)
    return replace(of, drift=of.rate_bound * 10.0 ** draws.uniform(-1.0, 1.5), tells_drift=False)


KINDS = {
    "liar": Kind("one lie of any size, at the start or later", _one_liar),
    "liars": Kind("several lies of any size, at the start and in the first half", _several_liars),
    "gaps": Kind("gaps of up to half of the time without any measurement", _with_gaps),
    "rows": Kind("rows and measurements are lost, rows come twice or late", _disordered),
    "thin": Kind(
        "first sets with one axis 1e-3 to 1e-8 times as long as another, seldom measured",
        _seldom_measured,
        plant=_exact_and_short,
        starts=thin,
        scenarios=("free", "gyro", "orbit", "pendulum"),
    ),
    "turns": Kind(
        "many turns in one interval, with first sets of 1e-8 to 1e-12 rad",
        _seldom_measured,
        plant=_many_turns,
        starts=tiny,
        scenarios=("free", "gyro"),
    ),
    "needle": Kind(
        "a body with one moment up to 1e5 times smaller than the others",
        _honest,
        plant=_needle,
        scenarios=("disturbed", "free", "orbit"),
    ),
    "spherical": Kind(
        "a body with moments that differ by 1e-2 to 1e-14 of their size",
        _honest,
        plant=_nearly_spherical,
        scenarios=("disturbed", "free", "orbit"),
    ),
    "potentials": Kind(
        "gravity and its gradient at once, as a sum of potentials",
        _honest,
        plant=_two_potentials,
        scenarios=("pendulum",),
    ),
    "eccentric": Kind(
        "an eccentric orbit that the filter takes for a circle, with the difference as an unknown torque",
        _honest,
        plant=_eccentric,
        scenarios=("disturbed", "orbit"),
    ),
    "increment": Kind(
        "a noisy gyro with a bound of the angle that its errors make in each interval",
        _with_increments,
        plant=_much_noise,
        scenarios=("gyro",),
    ),
    "bias": Kind(
        "a gyro's bias that is bounded and not estimated, and moves",
        _bias_not_estimated,
        plant=_any_bias,
        scenarios=("gyro",),
    ),
    "relaxed": Kind("one or two measurements of an update may be lies, and are", _relaxed),
}
