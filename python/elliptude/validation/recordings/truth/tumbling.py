"""True motions of rigid bodies: Euler's equations with potentials, wheels and torques, solved to rounding."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.configuration import potentials
from elliptude.typing import FloatArray

LONGEST_TURN = 0.25
"""A step turns no further, in each way that the motion changes, rad: its extrapolation is to rounding then."""
# Parts of a step by the midpoint rule, from which it is extrapolated: to the order 14.
_PARTS = (2, 4, 6, 8, 10, 12, 14)

Torque: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]
"""Of times (N,), s, and attitudes (N, 3, 3): torques in N m, body axes, shape (N, 3)."""


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a × b of the last axes; `numpy.cross` takes several times as long for few pairs."""
    found: FloatArray = a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
    return found


def torque_of(potential: potentials.Potential, inertia: FloatArray) -> Torque:
    """The torque of a potential on a body of this inertia (3, 3); theory, section 5.

    Parameters
    ----------
    potential : Potential
        As a configuration states it.
    inertia : (3, 3) array
        kg m².

    Returns
    -------
    Torque
    """
    if isinstance(potential, potentials.SumPotential):
        terms = [torque_of(one, inertia) for one in potential.potentials]
        return lambda times, attitudes: np.sum([term(times, attitudes) for term in terms], axis=0)
    if isinstance(potential, potentials.UniformGravity):
        weighted = potential.mass_kg * potential.gravity_m_per_s2 * np.array(potential.center_of_mass_m)
        return lambda times, attitudes: cross(weighted, attitudes[:, 2])
    if isinstance(potential, potentials.GravityGradient):
        n = potential.orbit_rate_rad_per_s
        seen = _seen(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, n]), potential.stated_at_s or 0.0)
        return _quadratic(3.0 * n**2 * inertia, seen)
    if isinstance(potential, potentials.LinearPotential):
        moment, seen = np.array(potential.moment_n_m), _seen_of(potential)
        return lambda times, attitudes: cross(moment, seen(times, attitudes))
    if isinstance(potential, potentials.QuadraticPotential):
        return _quadratic(np.array(potential.matrix_n_m), _seen_of(potential))
    return lambda times, attitudes: np.zeros((len(times), 3))


def _quadratic(matrix: FloatArray, seen: Torque) -> Torque:
    def torque(times: FloatArray, attitudes: FloatArray) -> FloatArray:
        b = seen(times, attitudes)
        return cross(b, b @ matrix.T)

    return torque


def _seen_of(potential: potentials.LinearPotential | potentials.QuadraticPotential) -> Torque:
    return _seen(np.array(potential.direction), np.array(potential.turn_rad_per_s), potential.stated_at_s or 0.0)


def _seen(direction: FloatArray, turn: FloatArray, stated_at: float) -> Torque:
    """The unit vector C'r(t) of a direction, stated for a time, that turns about an axis across it."""
    start, rate = direction / np.linalg.norm(direction), float(np.linalg.norm(turn))
    ahead = cross(turn / rate, start) if rate > 0.0 else np.zeros(3)

    def seen(times: FloatArray, attitudes: FloatArray) -> FloatArray:
        angles = rate * (times[:, None] - stated_at)
        found: FloatArray = np.einsum("ni,nij->nj", np.cos(angles) * start + np.sin(angles) * ahead, attitudes)
        return found

    return seen


@dataclass(frozen=True, eq=False)
class Inputs:
    """What acts on a body from one time to the next, for each of N times."""

    torques: FloatArray
    """All that does not follow from attitude and time, N m, body axes, shape (N, 3)."""
    momenta: FloatArray
    """Of wheels at the beginning, N m s, body axes, shape (N, 3)."""
    changes: FloatArray
    """What is added to these in a second, N m, shape (N, 3)."""

    def of(self, rows: NDArray[np.intp]) -> "Inputs":
        """Those of some rows."""
        return Inputs(self.torques[rows], self.momenta[rows], self.changes[rows])


class RigidMotion:
    """How a body moves: J ω' = (J ω + h) × ω + M(t, C) + u.

    Parameters
    ----------
    inertia : (3, 3) array
        The true one, kg m².
    potential : Potential
    """

    def __init__(self, inertia: FloatArray, potential: potentials.Potential) -> None:
        self.inertia, self._inverse = inertia, np.linalg.inv(inertia)
        self._torque = torque_of(potential, inertia)

    def largest_torque(self) -> float:
        """What the potential's torque is at most at any attitude, about: the largest of some, N m."""
        some = scipy.spatial.transform.Rotation.random(200, rng=np.random.default_rng(0)).as_matrix()
        return float(np.linalg.norm(self._torque(np.zeros(200), some), axis=1).max())

    def pace(self, rate: float, torque: float, momentum: float) -> float:
        """How fast attitude and angular velocity change at most, 1/s, while nothing is larger than this."""
        moments = np.linalg.eigvalsh(self.inertia)
        return float(rate * moments[2] / moments[0] + momentum / moments[0] + np.sqrt(torque / moments[0]))

    def _change(self, times: FloatArray, since: FloatArray, states: FloatArray, inputs: Inputs) -> FloatArray:
        attitudes, rates = states[:, :9].reshape(-1, 3, 3), states[:, 9:]
        momenta = rates @ self.inertia + inputs.momenta + since[:, None] * inputs.changes
        torques = cross(momenta, rates) + self._torque(times, attitudes) + inputs.torques
        # Row by row of C: (C S(ω))ᵢ = cᵢ × ω.
        turned = cross(attitudes, rates[:, None, :]).reshape(-1, 9)
        return np.concatenate([turned, torques @ self._inverse], axis=1)

    def step(
        self, times: FloatArray, since: FloatArray, states: FloatArray, inputs: Inputs, spans: FloatArray
    ) -> FloatArray:
        """States behind one step each, by Gragg's midpoint rule, extrapolated (Hairer, Nørsett, Wanner, II.9).

        Parameters
        ----------
        times : (N,) array
            At which steps begin, s.
        since : (N,) array
            How long before that inputs begin, s.
        states : (N, 12) array
            Attitudes, row by row, and angular velocities, rad/s.
        inputs : Inputs
        spans : (N,) array
            How long steps are, s; of either sign.

        Returns
        -------
        (N, 12) array
        """
        table: list[FloatArray] = []
        first = self._change(times, since, states, inputs)
        for k, parts in enumerate(_PARTS):
            part = spans / parts
            before, now = states, states + part[:, None] * first
            for i in range(1, parts):
                change = self._change(times + i * part, since + i * part, now, inputs)
                before, now = now, before + 2.0 * part[:, None] * change
            row = [now]
            for j in range(1, k + 1):
                ratio = (parts / _PARTS[k - j]) ** 2
                row.append(row[-1] + (row[-1] - table[j - 1]) / (ratio - 1.0))
            table = row
        return table[-1]


class Tumbling:
    """The motion of a body through N knots, from which it is known at all times.

    Parameters
    ----------
    motion : RigidMotion
    times : (N,) array
        s, increasing.
    states : (N, 12) array
        As `RigidMotion.step`.
    inputs : Inputs
        From each knot to the next; those of the last one act on behind it.
    """

    def __init__(self, motion: RigidMotion, times: FloatArray, states: FloatArray, inputs: Inputs) -> None:
        self.times, self.states, self.motion, self.inputs = times, states, motion, inputs

    def _states(self, times: FloatArray) -> FloatArray:
        knot = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 1)
        begins = self.times[knot]
        return self.motion.step(begins, np.zeros_like(begins), self.states[knot], self.inputs.of(knot), times - begins)

    def attitudes(self, times: FloatArray) -> FloatArray:
        """From body to reference axes at times of any order, s, shape (..., 3, 3)."""
        matrices = self._states(times)[:, :9].reshape(-1, 3, 3)
        return np.asarray(scipy.spatial.transform.Rotation.from_matrix(matrices).as_matrix())

    def rates(self, times: FloatArray) -> FloatArray:
        """Angular velocities, rad/s, body axes."""
        return self._states(times)[:, 9:]
