"""How a Kalman filter's state moves from row to row of a log, with noise from the stated bounds; theory, section 18.10.

An error within a bound counts as uniform in that ball or ellipsoid.
"""

import math
from typing import Literal, Protocol

import numpy as np

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow, RigidBodyFlow
from elliptude.estimation import gaps
from elliptude.estimation.best.multiplicative_filter import MultiplicativeFilter
from elliptude.estimation.given.filter_input import used_rates
from elliptude.estimation.guaranteed_run import GuaranteedRun
from elliptude.typing import FloatArray

# Nothing is taken to be known better than this, rad and rad/s.
LEAST = 1e-12


def uniform_variance(radius: float) -> float:
    """Variance of each component of an error that is uniform in a ball, (18.43).

    Parameters
    ----------
    radius : float
        Of the ball, in three dimensions.

    Returns
    -------
    float
    """
    return radius**2 / 5.0


class Motion(Protocol):
    """How the state goes from one row to the next."""

    dimension: int
    """How many coordinates the run's sets have: 6, or 3 if the vector is not estimated."""
    constant: FloatArray
    """Covariance (6, 6) of what the filter's state has beside that of the sets."""

    def carry(self, estimate: MultiplicativeFilter, row: int) -> FloatArray | None:
        """Carry an estimate on to a row from the one before: Φ, or None if the motion is not known."""


@np.errstate(over="ignore", invalid="ignore")
def motion_of(run: GuaranteedRun, configuration: Configuration) -> Motion:
    """How the state of a run moves.

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration

    Returns
    -------
    Motion
    """
    flow = configuration.flow
    if isinstance(flow, GyroFlow):
        return _Gyro(run, flow, configuration.estimates_vector and run.given.estimates_vector)
    return _Body(run, flow)


class _Gyro:
    """A gyro's rate. The bias of the state is all of its error that does not change."""

    def __init__(self, run: GuaranteedRun, flow: GyroFlow, estimates_bias: bool) -> None:
        gyro = run.rows.gyro
        assert gyro is not None
        log = gaps.without_rates_in_gaps(run.log, gyro.longest_interval)
        self._rates, self._steps = used_rates(log, flow, run.rows), np.diff(log.times)
        scale = gyro.scale_error * np.linalg.norm(self._rates, axis=1)
        noise = gyro.noise + flow.off_the_line(gyro.longest_interval)
        self._noise = np.sqrt(uniform_variance(noise) + scale**2 / 5.0)
        self._drift = math.sqrt(uniform_variance(gyro.drift))
        # The noise may be as constant as a bias, and the scale's error is where the rate is.
        known = scale[np.isfinite(scale)]
        constant = uniform_variance(gyro.noise) + uniform_variance(float(np.median(known)) if len(known) else 0.0)
        if not estimates_bias:
            constant += uniform_variance(gyro.bias)
        self.dimension = 6 if estimates_bias else 3
        self.constant = np.diag([0.0, 0.0, 0.0, constant, constant, constant])

    def carry(self, estimate: MultiplicativeFilter, row: int) -> FloatArray | None:
        """As in `Motion`."""
        rate = self._rates[row - 1]
        if math.isnan(rate[0]):
            return None
        return estimate.predict_gyro(rate, float(self._steps[row - 1]), float(self._noise[row - 1]), self._drift)


class _Body:
    """A rigid body under known torques and, perhaps, an unknown one, which is constant from row to row."""

    def __init__(self, run: GuaranteedRun, flow: RigidBodyFlow) -> None:
        self._times, self._controls, self._wheels = run.log.times, run.log.control_torques, run.log.wheel_momenta
        self._flow, bounds = flow.build(run.log.origin), flow.guaranteed()
        # The guaranteed run knows no order; with one of 2 its step may be too long.
        self._order: Literal[4, 6, 8] = 4 if flow.order == 2 else flow.order
        self._torque, self._inertia_error = np.asarray(bounds.unknown_torque) / 5.0, bounds.inertia_error
        self.dimension, self.constant = 6, np.zeros((6, 6))

    def carry(self, estimate: MultiplicativeFilter, row: int) -> FloatArray | None:
        """As in `Motion`."""
        begin, end = float(self._times[row - 1]), float(self._times[row])
        steps = max(math.ceil((end - begin) / self._flow.step * (1.0 - 1e-9)), 1)
        integrator = elliptude.Integrator(
            self._flow.body, self._flow.potential, step=(end - begin) / steps, order=self._order
        )
        control = np.zeros(3) if self._controls is None else self._controls[row]
        torque = self._torque + uniform_variance(self._of_inertia(estimate, begin, control)) * np.eye(3)
        if self._wheels is None:
            return estimate.predict_rigid_body(integrator, steps, begin, control, torque)
        return estimate.predict_with_wheels(integrator, steps, begin, control, torque, self._wheels[row])

    def _of_inertia(self, estimate: MultiplicativeFilter, time: float, control: FloatArray) -> float:
        """The torque that makes up for the error of the inertia, N m; section 17.5."""
        if not self._inertia_error:
            return 0.0
        body, rate = self._flow.body, estimate.vector
        known = np.asarray(self._flow.potential.torque(estimate.attitude, time), dtype=np.float64) + control
        torque = np.cross(body.inertia @ rate, rate) + known
        return self._inertia_error * float(rate @ rate + np.linalg.norm(body.inertia_inverse @ torque))
