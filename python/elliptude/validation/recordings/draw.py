"""What is drawn of a recording beside its motion: kinds of errors, how far stamps are off, when sensors are sampled."""

import math

import numpy as np
from numpy.typing import NDArray

from elliptude.typing import FloatArray
from elliptude.validation.recordings import gyro_errors, vector_errors
from elliptude.validation.recordings.gyro_errors import AT_BOUND
from elliptude.validation.recordings.statements import Stated, StatedBody
from elliptude.validation.recordings.truth.tumbling import RigidMotion

_MOST_ROWS = 3000
TORQUES = (
    "none",
    "in space",
    "in space",
    "in the body",
    "in the body",
    "along the rate",
    "against the rate",
    "across the rate",
    "alternating",
    "any",
)
"""Where the unknown torque on a rigid body points."""
MOMENTA = ("on lines", "at once", "late", "apart")
"""How the momentum of wheels goes from one of a log's values to the next."""
_KINDS: dict[str, tuple[str, ...]] = {
    "turns": gyro_errors.TURNS,
    "pauses": ("none", "some"),
    "ramps": ("at once", "slow"),
    "noise": (*gyro_errors.PATTERNS, "jitter"),
    "bias": gyro_errors.PATTERNS,
    "gyro scale": gyro_errors.MATRICES,
    "moves": vector_errors.MOTIONS,
    "force offset": (*gyro_errors.PATTERNS, "waves", "waves"),
    "force wobble": (*gyro_errors.PATTERNS, "jitter"),
    "force scale": gyro_errors.MATRICES,
    "field offset": (*gyro_errors.PATTERNS, "waves", "waves"),
    "field wobble": (*gyro_errors.PATTERNS, "jitter"),
    "field scale": gyro_errors.MATRICES,
    "disturbance": gyro_errors.PATTERNS,
    "directions": gyro_errors.PATTERNS,
    "velocity": (*gyro_errors.PATTERNS, "along the rate", "along the rate", "along the rate"),
    "stamps": ("even", "even", "uneven"),
    "lost": ("none", "none", "single", "runs"),
    "empty": ("none", "none", "some"),
    "spin": ("still", "any", "any", "any", "about an axis"),
    "torque": TORQUES,
    "control": ("none", "steady", "any", "any"),
    "wheels": ("steady", "any", "any"),
    "momentum": MOMENTA,
    "jitter": ("none", "none", "at the bound", "any"),
    "offsets": ("none", "early", "late", "apart", "apart", "any"),
}


class Draw:
    """One recording in the making."""

    def __init__(self, stated: Stated, draws: np.random.Generator) -> None:
        self.stated, self.draws = stated, draws
        self.kinds = {name: str(draws.choice(kinds)) for name, kinds in _KINDS.items()}
        self.signs = self._signs()
        self.grid, self.kept = self._grid() if stated.body is None else self._grid_of(stated.body)
        self.first = float(self.grid[self.kept][0])

    def _second(self) -> float:
        """Where a log begins in its file's time, about, s: anywhere, if its times count from its own first second."""
        configuration = self.stated.configuration
        if configuration.timing.origin != "first" or any(rest.shows is None for rest in self.stated.rests):
            return 0.0
        # Of a later second stamps in other units and delays are rounded by more than errors are from their bounds.
        return float(self.draws.choice([0.0, 40.25]))

    def _signs(self) -> dict[str, float]:
        kind, draws = self.kinds["offsets"], self.draws
        names = ["the gyro", "the velocity", "rate", *(sensor.name for sensor in self.stated.directions)]
        signs = {"none": 0.0, "early": -1.0, "late": 1.0}
        if kind in signs:
            return dict.fromkeys(names, signs[kind])
        if kind == "apart":
            return {name: float(draws.choice([-1.0, 1.0])) for name in names}
        return {name: float(draws.uniform(-1.0, 1.0)) for name in names}

    def offset(self, name: str, own: float) -> float:
        """How far a sensor's stamps are off against the gyro's, s."""
        return AT_BOUND * (self.signs[name] * own + self.signs["the gyro"] * self.stated.gyro_offset)

    def offsets(self, name: str, own: float, count: int, *, is_averaged: bool) -> FloatArray:
        """The same sample by sample, shape (N,): where no mean is taken, each may have an offset of its own."""
        if self.kinds["jitter"] == "none" or is_averaged:
            return np.full(count, self.offset(name, own))
        signs = self.draws.choice([-1.0, 1.0], count)
        if self.kinds["jitter"] == "any":
            signs *= self.draws.random(count)
        return np.asarray(self.offset(name, 0.0) + AT_BOUND * own * signs)

    def changes(self, name: str, times: FloatArray) -> FloatArray:
        """How far the accelerometer's offsets are beside that of its windows, s, shape (N,): there and back.

        Of what turns alone: what an integral over time makes of them is an error of means.
        """
        most, period = 0.5 * AT_BOUND * self.stated.offset_change, 10.0 ** self.draws.uniform(-1.0, 0.5)
        beside = np.where(np.mod(times / period + self.draws.random(), 1.0) < 0.5, most, -most)
        # Together within the offset's bound.
        bound, own = AT_BOUND * self.stated.offset_of_force, self.signs[name] * AT_BOUND * self.stated.offset_of_force
        changes: FloatArray = np.clip(own + beside, -bound, bound) - own
        return changes

    @property
    def apart(self) -> float:
        """How far samples of a sensor are apart at least, s, so that none is put into the row of the one before."""
        return 4.0 * self.stated.configuration.timing.same_within_s

    @property
    def more(self) -> float:
        """How far any stamp may be off, and how late it may be, s."""
        offsets = [
            self.stated.offset_of(sensor) + abs(self.stated.delay_of(sensor)) for sensor in self.stated.directions
        ]
        velocity = self.stated.velocity
        offsets += [abs(self.stated.rate.delay_s)] if self.stated.rate is not None else []
        offsets += [velocity.time_offset_bound_s + abs(velocity.delay_s)] if velocity is not None else []
        return max(offsets, default=0.0) + self.stated.gyro_offset

    def _grid(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """When the gyro might be sampled, some time before and behind the log, and which of these it is."""
        stated, draws = self.stated, self.draws
        windows = stated.force.windows if stated.force is not None else ()
        step = float(draws.choice([0.01, 0.02, 0.04]))
        if stated.gyro.interval is not None:
            step = stated.gyro.interval * float(draws.choice([0.5, 0.65, 0.95]))
        if windows:
            step = min(step, min(windows) / 20.0)
        step = max(step, self.apart)
        rests = stated.rests
        begin = min([0.0, *(rest.begin - draws.uniform(0.0, 1.0) for rest in rests if rest.shows is None)])
        resting = max((rest.end - begin for rest in rests), default=0.0)
        window = stated.longest_window
        moving = draws.uniform(0.8, 2.0) * window if window <= 15.0 else draws.uniform(0.4, 1.1) * window
        lasts = resting + max(moving, 3.0) + 1.0
        lasts = min(lasts, max(_MOST_ROWS * step, resting + 2.0))
        pad = self.more + 10.0 * step
        count = math.ceil((lasts + 2.0 * pad) / step)
        grid = begin - pad + step * np.arange(count)
        if self.kinds["stamps"] == "uneven":
            grid += step * draws.uniform(-0.12, 0.12, count) if stated.gyro.interval is None else 0.0
        kept = (grid >= begin) & (grid <= begin + lasts)
        losable = kept & (grid > begin + resting + stated.longest_window * 0.2 + 0.6)
        if self.kinds["lost"] == "single":
            kept &= ~(losable & (draws.random(count) < 0.02))
        elif self.kinds["lost"] == "runs":
            for at in draws.choice(count, 3):
                kept[at : at + int(draws.integers(1, 12))] &= ~losable[at : at + int(draws.integers(1, 12))][:1].any()
        kept[np.flatnonzero((grid >= begin) & (grid <= begin + lasts))[[0, 1, -2, -1]]] = True
        return np.round(grid + self._second(), 7), kept

    def _grid_of(self, body: StatedBody) -> tuple[FloatArray, NDArray[np.bool_]]:
        """When a rigid body's log might have rows, some time before and behind it, and which of these it has."""
        draws = self.draws
        self.rate = 10.0 ** draws.uniform(-2.0, 0.5)
        if np.isfinite(body.largest_rate):
            self.rate = body.largest_rate * float(draws.choice([0.98, 10.0 ** draws.uniform(-2.0, -0.05)]))
        nominal = RigidMotion(body.inertia, body.flow.potential)
        turns = nominal.pace(self.rate, nominal.largest_torque() + body.flow.unknown_torque_n_m, 0.0)
        step = min(10.0 ** draws.uniform(-1.8, -0.3) / max(turns, 1e-6), 200.0 * body.flow.step_s)
        step = max(float(f"{step:.3g}"), 1e-4, self.apart)
        begin = float(draws.choice([0.0, 0.0, 37.5])) + self._second()
        lasts = step * int(draws.integers(30, 200))
        pad = self.more + 2.0 * step
        grid = begin - pad + step * np.arange(math.ceil((lasts + 2.0 * pad) / step))
        if self.kinds["stamps"] == "uneven":
            grid += step * draws.uniform(-0.3, 0.3, len(grid))
        kept = (grid >= begin) & (grid <= begin + lasts)
        if self.kinds["lost"] != "none":
            kept &= (draws.random(len(grid)) > 0.1) | (grid < begin + 3.0 * step)
        return np.round(grid, 7), kept


def own_stamps(of: Draw, delay: float) -> FloatArray:
    """Stamps of a clock that is not the gyro's: rarer or more often, even or not."""
    times = of.grid[of.kept]
    step = float(np.median(np.diff(times))) * of.draws.choice([0.7, 1.0, 3.3, 10.0, 37.0])
    if of.stated.rests:
        step = min(step, (of.stated.rests[0].end - of.stated.rests[0].begin) / 20.0)
    step = max(step, of.apart)
    # A file has a row for each stamp of its own clock, and what is beside that ends no later.
    count = max(min(int((times[-1] - times[0]) / step), len(times)), 1)
    stamps = times[0] + step * (np.arange(count) + of.draws.uniform(0.0, 1.0))
    stamps = stamps + step * of.draws.uniform(-0.2, 0.2, count) if of.kinds["stamps"] == "uneven" else stamps
    return np.asarray(np.round(stamps + delay, 7))
