"""A multiplicative extended Kalman filter to compare with, for many runs at once.

The error is on the body side, C = Ĉ exp(S(ζ)), the state [ζ; δω] of a rigid body or [ζ; δβ] of a gyro with bias. A
rigid body is carried by the flow and its linearization that the other estimators have, so that they differ in nothing
but the estimator. Its motion is known exactly, so there is no process noise. Covariances are reset when the error goes
into the attitude. See Markley and Crassidis, Fundamentals of Spacecraft Attitude Determination and Control, 6.2.
"""

from dataclasses import dataclass

import elliptude as el
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class MultiplicativeFilter:
    """Estimates of N runs."""

    attitude: Array
    """Ĉ, body to reference, shape (N, 3, 3)."""
    vector: Array
    """ω̂ or β̂, rad/s, body axes, shape (N, 3)."""
    covariance: Array
    """Covariances of [ζ; δω] or [ζ; δβ], shape (N, 6, 6)."""

    def predict_rigid_body(self, integrator: el.Integrator, steps: int, time: float) -> None:
        """Some steps from `time` on."""
        flow = integrator.linearize(self.attitude, self.vector, steps=steps, time=time)
        self.attitude, self.vector = flow.attitude, flow.angular_velocity
        self.covariance = _symmetric(flow.state @ self.covariance @ flow.state.swapaxes(1, 2))

    def predict_gyro(self, sample: Array, interval: float, noise: float, drift: float) -> None:
        """Over an interval with the gyro's sample (N, 3) at its start.

        `noise` (rad/s) and `drift` (rad/s²) are standard deviations of each component, of what the interval's mean rate
        and the bias's rate of change differ by from what is assumed, independent from interval to interval.
        """
        turn = interval * (sample - self.vector)
        rotation, jacobian = el.exp(turn), interval * el.right_jacobian(turn)
        transition = np.tile(np.eye(6), (len(turn), 1, 1))
        transition[:, :3, :3] = rotation.swapaxes(1, 2)
        transition[:, :3, 3:] = -jacobian
        added = np.zeros_like(transition)
        added[:, :3, :3] = noise**2 * jacobian @ jacobian.swapaxes(1, 2)
        added[:, 3:, 3:] = (drift * interval) ** 2 * np.eye(3)
        self.attitude = self.attitude @ rotation
        self.covariance = _symmetric(transition @ self.covariance @ transition.swapaxes(1, 2) + added)

    def update(
        self,
        directions: Array,
        reference: Array,
        direction_deviation: float,
        rate: Array | None = None,
        rate_deviation: float = 0.0,
    ) -> None:
        """Fuse directions (N, m, 3) of reference directions (m, 3) and, of a rigid body, the angular velocity (N, 3).

        Deviations are standard deviations: of a direction's error (rad) about each axis across it, of each component of
        the rate (rad/s).
        """
        count, sensors, _ = directions.shape
        expected = np.einsum("nji,mj->nmi", self.attitude, reference)
        rows = 3 * sensors + (0 if rate is None else 3)
        h, residual = np.zeros((count, rows, 6)), np.empty((count, rows))
        # b = exp(−S(ζ)) b̂ = b̂ + b̂ × ζ to first order. Along b̂ nothing is measured, whatever noise is put there.
        h[:, : 3 * sensors, :3] = el.hat(expected).reshape(count, 3 * sensors, 3)
        residual[:, : 3 * sensors] = (directions - expected).reshape(count, -1)
        variances = np.full(rows, direction_deviation**2)
        if rate is not None:
            h[:, 3 * sensors :, 3:] = np.eye(3)
            residual[:, 3 * sensors :] = rate - self.vector
            variances[3 * sensors :] = rate_deviation**2
        innovation = h @ self.covariance @ h.swapaxes(1, 2) + np.diag(variances)
        gain = np.linalg.solve(innovation, h @ self.covariance).swapaxes(1, 2)
        error = np.einsum("nij,nj->ni", gain, residual)
        # Joseph's form.
        kept = np.eye(6) - gain @ h
        updated = kept @ self.covariance @ kept.swapaxes(1, 2) + (gain * variances) @ gain.swapaxes(1, 2)
        # exp(S(ζ)) = exp(S(ζ̂)) exp(S(ζ⁺)), so ζ⁺ = J_r(ζ̂) (ζ − ζ̂) to first order.
        reset = np.tile(np.eye(6), (count, 1, 1))
        reset[:, :3, :3] = el.right_jacobian(error[:, :3])
        self.attitude = self.attitude @ el.exp(error[:, :3])
        self.vector = self.vector + error[:, 3:]
        self.covariance = _symmetric(reset @ updated @ reset.swapaxes(1, 2))


def from_measurement(
    directions: Array, reference: Array, direction_deviation: float, rate: Array, rate_deviation: float
) -> MultiplicativeFilter:
    """Begin with what two or more directions (N, m, 3) and a rate (N, 3) say: Wahba's attitude and its covariance."""
    attitude = el.wahba(np.broadcast_to(reference, directions.shape), directions).attitude
    information = np.sum(np.eye(3) - directions[..., :, None] * directions[..., None, :], axis=1)
    covariance = np.zeros((len(rate), 6, 6))
    covariance[:, :3, :3] = direction_deviation**2 * np.linalg.inv(information)
    covariance[:, 3:, 3:] = rate_deviation**2 * np.eye(3)
    return MultiplicativeFilter(attitude, rate.copy(), covariance)


def _symmetric(matrices: Array) -> Array:
    return 0.5 * (matrices + matrices.swapaxes(1, 2))
