"""A multiplicative extended Kalman filter, for one run or for many at once; docs/theory.md, section 18.10.

The error is on the body side, C = Ĉ exp(S(ζ)); the state is [ζ; δω] of a rigid body or [ζ; δβ] of a gyro with bias. A
rigid body is carried by the variational integrator and its linearization. Covariances are reset when the error goes
into the attitude. See Markley and Crassidis, Fundamentals of Spacecraft Attitude Determination and Control, 6.2.
"""

from dataclasses import dataclass

import numpy as np
import scipy

import elliptude
from elliptude.typing import FloatArray

_IDENTITY = np.eye(6)
_THREE = np.eye(3)


@dataclass
class MultiplicativeFilter:
    """Estimates of runs; the dots in shapes are the runs, and there are none for a single one."""

    attitude: FloatArray
    """Ĉ, body to reference, shape (..., 3, 3)."""
    vector: FloatArray
    """ω̂ or β̂, rad/s, body axes, shape (..., 3)."""
    covariance: FloatArray
    """P of [ζ; δω] or [ζ; δβ], shape (..., 6, 6)."""

    def predict_gyro(self, sample: FloatArray, interval: float, noise: float, drift: float) -> FloatArray:
        """Carry on over an interval in which the gyro shows a rate, (18.40).

        Parameters
        ----------
        sample : (..., 3) array
            rad/s.
        interval : float
            s.
        noise, drift : float
            Standard deviations of each component of the rate's error (rad/s) and of how fast the bias changes
            (rad/s²), independent from interval to interval.

        Returns
        -------
        (..., 6, 6) array
            Φ, the effect of the error before on the error after.
        """
        turn = interval * (sample - self.vector)
        rotation, jacobian = elliptude.exp(turn), interval * elliptude.right_jacobian(turn)
        transition = np.zeros(self.covariance.shape)
        transition[..., :3, :3] = rotation.swapaxes(-1, -2)
        transition[..., :3, 3:] = -jacobian
        transition[..., 3:, 3:] = _THREE
        carried = _congruence(transition, self.covariance)
        carried[..., :3, :3] += noise**2 * _product(jacobian, jacobian.swapaxes(-1, -2))
        carried[..., 3:, 3:] += (drift * interval) ** 2 * _THREE
        self.attitude = _product(self.attitude, rotation)
        self.covariance = carried
        return transition

    def predict_rigid_body(
        self,
        integrator: elliptude.Integrator,
        steps: int,
        time: float,
        control_torque: FloatArray | None = None,
        torque_covariance: FloatArray | None = None,
    ) -> FloatArray:
        """Carry on by some steps from ``time`` (s) on, (18.41).

        Parameters
        ----------
        integrator : Integrator
        steps : int
        time : float
        control_torque : (3,) array, optional
            N m, body axes.
        torque_covariance : (3, 3) array, optional
            Of an unknown torque, which is constant in this time, (N m)².

        Returns
        -------
        (..., 6, 6) array
            Φ, the effect of the error before on the error after.
        """
        flow = integrator.linearize(self.attitude, self.vector, steps=steps, time=time, control_torque=control_torque)
        self._take_up(flow.attitude, flow.angular_velocity, flow.state, flow.control, torque_covariance)
        return flow.state

    def predict_with_wheels(
        self,
        integrator: elliptude.Integrator,
        steps: int,
        time: float,
        control_torque: FloatArray,
        torque_covariance: FloatArray,
        momentum: FloatArray,
    ) -> FloatArray:
        """As `predict_rigid_body`, for a single run with the momentum of wheels (3,) in the body, N m s, (18.41).

        A wheel's torque h × ω is taken at the middle of each step.
        """
        attitude, rate, cross = self.attitude, self.vector, elliptude.hat(momentum)
        transition, control = _IDENTITY, np.zeros((6, 3))
        for step in range(steps):
            at, middle = time + step * integrator.step_length, rate
            for _ in range(2):
                torque = control_torque + cross @ middle
                flow = integrator.linearize(attitude, rate, time=at, control_torque=torque)
                middle = 0.5 * (rate + flow.angular_velocity)
            # What turns the middle's rate turns the wheel's torque there, which turns the rate at the end.
            of_torque = flow.control @ np.linalg.inv(_THREE - 0.5 * cross @ flow.control[3:])
            of_step = flow.state + 0.5 * of_torque @ cross @ (_IDENTITY[3:] + flow.state[3:])
            transition, control = of_step @ transition, of_step @ control + of_torque
            attitude, rate = flow.attitude, flow.angular_velocity
        self._take_up(attitude, rate, transition, control, torque_covariance)
        return transition

    def update(
        self,
        directions: FloatArray,
        references: FloatArray,
        weights: FloatArray,
        rate: FloatArray | None = None,
        rate_weight: FloatArray | None = None,
    ) -> FloatArray:
        """Fuse measured directions and, of a rigid body, a measured angular velocity, (18.42).

        Parameters
        ----------
        directions : (..., m, 3) array
            Unit vectors, body axes; finite also where the weight is 0.
        references : (m, 3) array
            The same in reference axes, also unit vectors.
        weights : (..., m) array
            The inverse of the variance of a direction's error about each axis across it, rad⁻²; 0 leaves it out.
        rate : (..., 3) array, optional
            rad/s, body axes.
        rate_weight : (3, 3) array, optional
            The inverse of its covariance.

        Returns
        -------
        (...) array
            The normalized square of what was not expected: two for each direction and three for the rate, on average.
        """
        expected = _product(references, self.attitude)
        weighted = weights[..., None] * expected
        information = np.zeros(self.covariance.shape)
        gradient = np.zeros(self.covariance.shape[:-1])
        # b = exp(−S(ζ)) b̂ = b̂ + b̂ × ζ to first order: H = S(b̂), HᵀH = I − b̂ b̂ᵀ, and Hᵀ(b − b̂) = b × b̂.
        information[..., :3, :3] = weights.sum(axis=-1)[..., None, None] * _THREE
        information[..., :3, :3] -= _product(expected.swapaxes(-1, -2), weighted)
        products = _product(weighted.swapaxes(-1, -2), directions)
        gradient[..., :3] = elliptude.vee(products - products.swapaxes(-1, -2))
        difference = directions - expected
        squares = (weights[..., None] * difference * difference).sum(axis=(-1, -2))
        if rate is not None:
            assert rate_weight is not None
            unexpected = rate - self.vector
            information[..., 3:, 3:] = rate_weight
            gradient[..., 3:] = unexpected @ rate_weight
            squares = squares + (gradient[..., 3:] * unexpected).sum(axis=-1)
        updated = _solved(_IDENTITY + _product(self.covariance, information), self.covariance)
        error = (updated @ gradient[..., None])[..., 0]
        self.move(error, updated)
        return np.asarray(squares - (error * gradient).sum(axis=-1))

    def move(self, error: FloatArray, covariance: FloatArray) -> None:
        """Take up an error (..., 6); the covariance (..., 6, 6) is that of what is left of it."""
        # exp(S(ζ)) = exp(S(ζ̂)) exp(S(ζ⁺)), so ζ⁺ = J_r(ζ̂) (ζ − ζ̂) to first order.
        reset = np.zeros(covariance.shape)
        reset[..., :3, :3] = elliptude.right_jacobian(error[..., :3])
        reset[..., 3:, 3:] = _THREE
        self.attitude = _product(self.attitude, elliptude.exp(error[..., :3]))
        self.vector = self.vector + error[..., 3:]
        self.covariance = _congruence(reset, covariance)

    def _take_up(
        self,
        attitude: FloatArray,
        vector: FloatArray,
        transition: FloatArray,
        control: FloatArray,
        torque_covariance: FloatArray | None,
    ) -> None:
        self.attitude, self.vector = attitude, vector
        self.covariance = _congruence(transition, self.covariance)
        if torque_covariance is not None:
            self.covariance += _congruence(control, torque_covariance)


# A single run has matrices of two dimensions, for which NumPy's general functions take most of the time.


def _product(one: FloatArray, other: FloatArray) -> FloatArray:
    product: FloatArray = one.dot(other) if one.ndim == other.ndim == 2 else one @ other
    return product


def _congruence(matrix: FloatArray, symmetric: FloatArray) -> FloatArray:
    """M S Mᵀ, exactly symmetric."""
    image = _product(_product(matrix, symmetric), matrix.swapaxes(-1, -2))
    half: FloatArray = 0.5 * (image + image.swapaxes(-1, -2))
    return half


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions of systems that are never singular."""
    if matrix.ndim == 2:
        return np.asarray(scipy.linalg.lapack.dgesv(matrix, right)[2], dtype=np.float64)
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
