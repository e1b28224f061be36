"""How a rigid body moves under torques within what a configuration states, and what its log has of them."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

import elliptude
from elliptude.configuration.estimator import GivenStart
from elliptude.io.files import FileError
from elliptude.typing import FloatArray
from elliptude.validation.recordings.draw import Draw
from elliptude.validation.recordings.gyro_errors import AT_BOUND, unit_vector
from elliptude.validation.recordings.statements import StatedBody
from elliptude.validation.recordings.truth.tumbling import LONGEST_TURN, Inputs, RigidMotion, Tumbling, cross

# Slower and slower motions are tried until one keeps the largest rate.
_TRIES = 12


@dataclass(frozen=True, eq=False)
class Acting:
    """What acts on a body from each time of its grid to the next, shape (N - 1, 3) each."""

    control: FloatArray
    """N m, body axes."""
    momenta: FloatArray
    """Of wheels at the beginning, N m s."""
    changes: FloatArray
    """In a second, N m."""


@dataclass(frozen=True, eq=False)
class Moving:
    """A motion, and the columns of its log."""

    tumbling: Tumbling
    columns: dict[str, FloatArray]


def draw_body(of: Draw, first: float) -> Moving:
    """A motion of a rigid body, and the torques and momenta that its log has.

    Parameters
    ----------
    of : Draw
    first : float
        Time of the log's first row, s: a given start is of it.

    Returns
    -------
    Moving

    Raises
    ------
    FileError
        If no motion was found that is as slow as is stated.
    """
    body = of.stated.body
    assert body is not None
    acting, columns = _known(of, body)
    motion = RigidMotion(body.inertia + _inertia_error(body, of.draws), body.flow.potential)
    attitude, rate = _start(of, body)
    aim = _aim(of.kinds["torque"], of.draws)
    is_given = isinstance(of.stated.configuration.start, GivenStart)
    for attempt in range(_TRIES):
        tumbling = _follow(of, body, motion, acting, aim, first, (attitude, rate))
        fastest = np.linalg.norm(tumbling.states[:, 9:], axis=1).max()
        if fastest <= AT_BOUND * body.largest_rate:
            return Moving(tumbling, columns)
        rate = rate if is_given else 0.5 * rate
        acting = Acting(0.5 * acting.control, acting.momenta, acting.changes)
        columns |= {name: 0.5 * columns[name] for name in body.flow.control_torque_columns or ()}
        if attempt > _TRIES // 2:
            aim = _aim("none", of.draws)
    raise FileError("flow.largest_rate_deg_per_s: the torques turn the body faster in each motion that was tried")


def _start(of: Draw, body: StatedBody) -> tuple[FloatArray, FloatArray]:
    draws, start = of.draws, of.stated.configuration.start
    if isinstance(start, GivenStart):
        built = start.build()
        direction = draws.standard_normal(6)
        share = float(draws.choice([0.5, 1.0])) * AT_BOUND
        away = share * np.linalg.cholesky(built.shape) @ (direction / np.linalg.norm(direction))
        return built.attitude @ elliptude.cayley(0.5 * away[:3]), built.vector + away[3:]
    attitude = scipy.spatial.transform.Rotation.from_quat(draws.standard_normal(4)).as_matrix()
    if of.kinds["spin"] == "still":
        return attitude, np.zeros(3)
    axis = unit_vector(draws)
    if of.kinds["spin"] == "about an axis":
        axis = np.linalg.eigh(body.inertia)[1][:, int(draws.integers(3))] + 1e-3 * axis
    return attitude, of.rate * axis / np.linalg.norm(axis)


def _inertia_error(body: StatedBody, draws: np.random.Generator) -> FloatArray:
    """A symmetric matrix (3, 3) whose spectral norm is the bound, of which a body can be off."""
    for _ in range(20):
        axes = np.linalg.qr(draws.standard_normal((3, 3)))[0]
        sizes = draws.choice([-1.0, 0.0, 1.0], 3)
        off: FloatArray = AT_BOUND * body.flow.inertia_error_kg_m2 * (axes * sizes) @ axes.T
        moments = np.linalg.eigvalsh(body.inertia + off)
        if moments[0] > 0.0 and moments[0] + moments[1] > moments[2]:
            return off
    return np.zeros((3, 3))


# --- torques ----------------------------------------------------------------------------------------------------------


def _known(of: Draw, body: StatedBody) -> tuple[Acting, dict[str, FloatArray]]:
    """Control torques and wheels: a row's torque acts since the row before, and a momentum is that of its row."""
    flow, draws, at = body.flow, of.draws, np.flatnonzero(of.kept)
    columns: dict[str, FloatArray] = {}
    steps = np.arange(len(of.grid) - 1)
    # The row at which each step of the grid ends, or that comes after it.
    row = np.clip(np.searchsorted(at, steps, side="right"), 0, len(at) - 1)
    control, momenta = np.zeros((len(steps), 3)), np.zeros((len(steps), 3))
    changes = np.zeros_like(momenta)
    largest = float(np.linalg.eigvalsh(body.inertia)[2])
    if flow.control_torque_columns is not None:
        size = largest * of.rate**2 * 10.0 ** draws.uniform(-3.0, 0.0)
        torques = size * _some(of.kinds["control"], len(at), draws)
        columns |= dict(zip(flow.control_torque_columns, torques.T, strict=True))
        control = torques[row]
    if flow.wheel_momentum_columns is not None:
        size = largest * of.rate * 10.0 ** draws.uniform(-2.0, 0.5)
        shown = np.tile(size * unit_vector(draws), (len(at), 1))
        if flow.control_torque_columns is not None and np.isfinite(body.largest_rate):
            shown = shown + 0.05 * size * _some(of.kinds["wheels"], len(at), draws)
        columns |= dict(zip(flow.wheel_momentum_columns, shown.T, strict=True))
        momenta, changes = _between(of, shown, row)
    return Acting(control, momenta, changes), columns


def _some(kind: str, count: int, draws: np.random.Generator) -> FloatArray:
    """Vectors (N, 3), no longer than 1."""
    if kind == "none":
        return np.zeros((count, 3))
    if kind == "steady":
        return np.tile(unit_vector(draws), (count, 1))
    vectors = draws.standard_normal((count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def _between(of: Draw, shown: FloatArray, row: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Momenta in the grid's steps and their changes: each component between its values at the rows around."""
    times, rows = of.grid, of.grid[of.kept]
    before = np.maximum(row - 1, 0)
    inside = (times[:-1] >= rows[0]) & (times[:-1] < rows[-1])
    begin, end = np.where(inside[:, None], shown[before], shown[row]), shown[row]
    end = np.where((times[:-1] >= rows[-1])[:, None], shown[-1], end)
    kind = of.kinds["momentum"]
    if kind == "at once":
        return end, np.zeros_like(end)
    if kind == "late":
        return begin, np.zeros_like(begin)
    if kind == "apart":  # some components early, others late
        early = of.draws.random((len(row), 3)) < 0.5
        return np.where(early, end, begin), np.zeros_like(begin)
    span = np.where(inside, rows[row] - rows[before], 1.0)[:, None]
    changes = (end - begin) / span
    return begin + changes * np.where(inside, times[:-1] - rows[before], 0.0)[:, None], changes


Aim = Callable[[int, FloatArray, FloatArray], FloatArray]
"""Of a step's number, an attitude and an angular velocity: where a torque points, a vector of length 1 or 0."""


def _aim(kind: str, draws: np.random.Generator) -> Aim:
    one = unit_vector(draws)
    own = np.random.default_rng(int(draws.integers(2**32)))
    some = own.standard_normal((997, 3))
    some /= np.linalg.norm(some, axis=1)[:, None]

    def along(rate: FloatArray) -> FloatArray:
        length = float(np.linalg.norm(rate))
        return rate / length if length > 0.0 else one

    def across(attitude: FloatArray, rate: FloatArray) -> FloatArray:
        crossed = cross(along(rate), one @ attitude)
        return np.asarray(crossed / max(float(np.linalg.norm(crossed)), 1e-9))

    aims: dict[str, Aim] = {
        "none": lambda i, attitude, rate: np.zeros(3),
        "in space": lambda i, attitude, rate: one @ attitude,
        "in the body": lambda i, attitude, rate: one,
        "along the rate": lambda i, attitude, rate: along(rate),
        "against the rate": lambda i, attitude, rate: -along(rate),
        "across the rate": lambda i, attitude, rate: across(attitude, rate),
        "alternating": lambda i, attitude, rate: one @ attitude * (1.0 if i % 2 else -1.0),
        "any": lambda i, attitude, rate: some[i % len(some)],
    }
    return aims[kind]


# --- the motion -------------------------------------------------------------------------------------------------------


def _follow(
    of: Draw,
    body: StatedBody,
    motion: RigidMotion,
    acting: Acting,
    aim: Aim,
    first: float,
    start: tuple[FloatArray, FloatArray],
) -> Tumbling:
    """The motion through all of the grid, from a state at a time within it."""
    grid, state = of.grid, np.concatenate([start[0].ravel(), start[1]])
    begin = int(np.clip(np.searchsorted(grid, first, side="right") - 1, 0, len(grid) - 2))
    way = _Way(body, motion, acting, aim, grid)
    there = way.go(state, first, float(grid[begin + 1]), begin)
    for i in range(begin + 1, len(grid) - 1):
        there = way.go(there, float(grid[i]), float(grid[i + 1]), i)
    there = way.go(state, first, float(grid[begin]), begin)
    for i in range(begin - 1, -1, -1):
        there = way.go(there, float(grid[i + 1]), float(grid[i]), i)
    return way.tumbling()


class _Way:
    """Knots, found one after another, forward or backward in time."""

    def __init__(self, body: StatedBody, motion: RigidMotion, acting: Acting, aim: Aim, grid: FloatArray) -> None:
        self._body, self._motion, self._acting, self._aim, self._grid = body, motion, acting, aim, grid
        self._unknown = AT_BOUND * body.flow.unknown_torque_n_m
        self._largest_torque = motion.largest_torque()
        self._knots: list[tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]] = []

    def go(self, state: FloatArray, begin: float, end: float, i: int) -> FloatArray:
        """From a state at a time to another time within step ``i`` of the grid; the state there."""
        acting = self._acting
        control, change = acting.control[i], acting.changes[i]
        time = begin
        while time != end:
            momentum = acting.momenta[i] + (time - self._grid[i]) * change
            torque = control + self._unknown * self._points(state, end > begin)
            span = self._span(state, end - time, float(np.linalg.norm(control)), float(np.linalg.norm(momentum)))
            inputs = Inputs(torque[None], momentum[None], change[None])
            behind = self._motion.step(np.array([time]), np.zeros(1), state[None], inputs, np.array([span]))[0]
            exact = scipy.spatial.transform.Rotation.from_matrix(behind[:9].reshape(3, 3)).as_matrix()
            behind = np.concatenate([exact.ravel(), behind[9:]])
            then = end if span == end - time else time + span
            if end > begin:
                self._knots.append((time, state, torque, momentum, change))
            else:  # what acts is of the time from the earlier knot on
                self._knots.append((then, behind, torque, momentum + span * change, change))
            state, time = behind, then
        return state

    def _points(self, state: FloatArray, is_forward: bool) -> FloatArray:
        """Where the unknown torque points: against a rate that would soon be larger than is stated."""
        rate = state[9:]
        speed = float(np.linalg.norm(rate))
        if speed > 0.985 * self._body.largest_rate:
            return np.asarray((-1.0 if is_forward else 1.0) * rate / speed)
        return self._aim(len(self._knots), state[:9].reshape(3, 3), rate)

    def _span(self, state: FloatArray, left: float, control: float, momentum: float) -> float:
        """How far a step may go of what is left, s."""
        torque = self._largest_torque + self._unknown + control
        pace = self._motion.pace(float(np.linalg.norm(state[9:])), torque, momentum)
        parts = math.ceil(abs(left) * pace / LONGEST_TURN)
        return left / max(parts, 1)

    def tumbling(self) -> Tumbling:
        """The motion through all knots."""
        times, states, torques, momenta, changes = zip(*sorted(self._knots, key=lambda one: one[0]), strict=True)
        return Tumbling(
            self._motion,
            np.array(times),
            np.array(states),
            Inputs(np.array(torques), np.array(momenta), np.array(changes)),
        )
