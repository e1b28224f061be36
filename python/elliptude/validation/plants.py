"""Bodies and gyros for `elliptude.validation`: their true motion, and what a filter is told about it."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude import _core, _truth
from elliptude.simulation import scenarios
from elliptude.simulation.potentials import GravityGradient
from elliptude.simulation.scenarios import Scenario
from elliptude.typing import FloatArray
from elliptude.validation.adversary import INSIDE, Case, Errors, Motion, Plant, Starts

_LONG = np.longdouble


@dataclass(frozen=True, eq=False)
class RigidBodyPlant:
    """A scenario of `elliptude.simulation.scenarios`, from any initial state, perhaps with an unknown torque."""

    scenario: Scenario
    reference: FloatArray
    bound: float
    unknown_torque: float
    """N m."""
    added_orbit_rate: float = 0.0
    """Orbit rate of a gravity gradient beside the scenario's potential, rad/s; the filter knows it."""
    eccentricity: float = 0.0
    """Eccentricity of the true orbit. The filter takes it for a circle, and is told how far the torque may be off."""
    precise: bool = False
    """Whether to calculate the truth to the last digit of a double, which takes longer."""
    has_gyro: bool = False

    @property
    def interval(self) -> float:
        """s."""
        return self.scenario.interval

    @property
    def rate_bound(self) -> float:
        """rad/s."""
        return self.bound

    @property
    def largest_rate(self) -> float:
        """Largest rate at the start, rad/s."""
        return float(np.linalg.norm(self.scenario.rate0))

    def motion(self, starts: Starts, errors: Errors) -> Motion:
        """The continuous motion, the unknown torque constant from update to update."""
        attitudes, rates = starts.true_states(errors)
        potential = self.scenario.potential
        orbit_rate = potential.orbit_rate if isinstance(potential, GravityGradient) else self.added_orbit_rate
        attitudes, rates = _truth.motion(
            _times(self, errors),
            attitudes,
            rates,
            self.scenario.inertia_matrix,
            weighted_center=potential.weighted_center(),
            orbit_rate=orbit_rate,
            eccentricity=self.eccentricity,
            torque=INSIDE * self.unknown_torque * errors.inputs[:, :, 0],
            precise=self.precise,
        )
        return Motion(attitudes, rates, rates)

    @cached_property
    def _body(self) -> _core.RigidBody:
        return _core.RigidBody(self.scenario.inertia_matrix)

    @cached_property
    def _potential(self) -> _core.Potential:
        known = self.scenario.potential.configured().build(self._body)
        if self.added_orbit_rate == 0.0:
            return known
        return _core.SumPotential([known, _core.GravityGradient(self._body, self.added_orbit_rate)])

    @property
    def _whole_unknown_torque(self) -> float | None:
        return self.unknown_torque + self._eccentric_torque() or None

    def _eccentric_torque(self) -> float:
        """How far the torque on an eccentric orbit may differ from that on a circle, at any attitude, N m.

        3 n² r̂ × J r̂ is that of J less the middle of its moments, which is as large as half their difference D: the
        nearness s = (a/r)³ adds at most 3 n² (s − 1) D/2, and the direction, off by a chord c, at most 3 n² D c.
        """
        potential = self.scenario.potential
        if self.eccentricity == 0.0 or not isinstance(potential, GravityGradient):
            return 0.0
        e, moments = self.eccentricity, np.linalg.eigvalsh(self.scenario.inertia_matrix)
        nearness = (1.0 - e) ** -3
        eccentric = np.linspace(0.0, 2.0 * math.pi, 2001)
        half = 0.5 * eccentric
        true = 2.0 * np.arctan2(math.sqrt(1.0 + e) * np.sin(half), math.sqrt(1.0 - e) * np.cos(half))
        chord = 2.0 * np.sin(0.5 * np.abs(true - (eccentric - e * np.sin(eccentric)))).max()
        difference = moments[2] - moments[0]
        # A grid does not meet the maximum of the chord, but comes within its square of the spacing.
        return float(3.0 * potential.orbit_rate**2 * difference * (0.5 * (nearness - 1.0) + 1.001 * nearness * chord))

    def flow(self) -> _core.RigidBodyFlow:
        """The flow for the modes of first order."""
        return _core.RigidBodyFlow(
            self._body,
            self._potential,
            step=self.scenario.step,
            order=self.scenario.integrator_order,
            unknown_torque=self._whole_unknown_torque,
        )

    def guaranteed_flow(self) -> Any:
        """The flow for the guaranteed mode."""
        return guaranteed("GuaranteedRigidBodyFlow")(
            self._body, self._potential, step=self.scenario.step, unknown_torque=self._whole_unknown_torque
        )


@dataclass(frozen=True, eq=False)
class GyroPlant:
    """A gyro with noise, a drifting bias, and a rate that changes between its samples."""

    reference: FloatArray
    bound: float
    rate_bound: float
    """Bound of the errors of the gyro's samples, rad/s."""
    noise: float
    """The noise bound that the filter is told, rad/s."""
    drift: float
    """Bound of the rate of change of the bias, rad/s²."""
    interval: float = 0.1
    largest_rate: float = 1.0
    angular_acceleration: float = 1.0
    """rad/s²."""
    tells_drift: bool = True
    """Whether the filter is told that the bias drifts."""
    has_gyro: bool = True

    def motion(self, starts: Starts, errors: Errors) -> Motion:
        """Angular acceleration and drift are constant from sample to sample."""
        attitudes, biases = starts.true_states(errors)
        accelerations, drifts = np.moveaxis(INSIDE * errors.inputs, 2, 0)
        times = _times(self, errors)
        if self.angular_acceleration == 0.0:
            # The sample, not the rate, is a double: a gyro without errors has none in the last digit either.
            rate = (starts.rates + biases).astype(_LONG) - biases
            attitudes, rates = _turned(attitudes, rate, times), np.repeat(rate[:, None], len(times), axis=1)
        else:
            attitudes, rates = _truth.rotation(
                times, attitudes, starts.rates, self.angular_acceleration * accelerations
            )
        added = np.cumsum(self.interval * self.drift * drifts, axis=1)
        return Motion(attitudes, rates, biases[:, None] + np.pad(added, ((0, 0), (1, 0), (0, 0))))

    def flow(self) -> _core.GyroFlow:
        """The flow for the modes of first order: the sample's error is that of the interval's mean rate."""
        change = 0.5 * self.interval * (self.angular_acceleration + self.drift)
        return _core.GyroFlow(self.noise + change, self.drift)

    def guaranteed_flow(self) -> Any:
        """The flow for the guaranteed mode."""
        return guaranteed("GuaranteedGyroFlow")(
            noise=self.noise,
            drift=self.drift if self.tells_drift else 0.0,
            angular_acceleration=self.angular_acceleration,
            interval_rate="first_sample",
        )


_UNKNOWN_TORQUE = 0.01


def plant(case: Case, own: Scenario | None = None) -> Plant:
    """The body or gyro of a case.

    Parameters
    ----------
    case : Case
    own : Scenario, optional
        The scenario, with directions of its own, if it is not among those that are built in.

    Returns
    -------
    Plant
    """
    bound = math.radians(case.bound_deg)
    if own is not None:
        return RigidBodyPlant(own, np.array(own.directions[case.directions]), bound, 0.0)
    orbit = scenarios.load("orbit")
    reference = np.array(orbit.directions[case.directions])
    if case.scenario == "gyro":
        return GyroPlant(reference, bound, rate_bound=bound, noise=bound, drift=0.1 * bound)
    if case.scenario == "disturbed":
        return RigidBodyPlant(orbit, reference, bound, _UNKNOWN_TORQUE)
    return RigidBodyPlant(scenarios.load(case.scenario), reference, bound, 0.0)


def guaranteed(name: str) -> Any:
    """The class of the guaranteed mode with this name."""
    return getattr(elliptude, name)


def _times(of: Plant, errors: Errors) -> FloatArray:
    times: FloatArray = of.interval * np.arange(errors.rates.shape[1] + 1)
    return times


def _turned(attitudes: FloatArray, rates: Any, times: FloatArray) -> FloatArray:
    """C exp(S(t ω)) at all times, by Rodrigues' formula in long double: to the last digit for any number of turns."""
    speeds = np.sqrt(np.sum(rates**2, axis=1))
    axes = rates / np.where(speeds > 0.0, speeds, _LONG(1.0))[:, None]
    angles = (speeds[:, None] * times)[..., None, None]
    cross = np.zeros((len(rates), 3, 3), _LONG)
    for i in range(3):
        cross[:, i - 2, i - 1], cross[:, i - 1, i - 2] = -axes[:, i], axes[:, i]
    # The half angle, as 1 − cos loses digits.
    turns = np.eye(3) + np.sin(angles) * cross[:, None] + 2 * np.sin(angles / 2) ** 2 * (cross @ cross)[:, None]
    result: NDArray[np.float64] = (attitudes[:, None] @ turns).astype(np.float64)
    return result
