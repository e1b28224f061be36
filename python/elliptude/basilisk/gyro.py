"""What the turns of an integrating gyro say about the mean of the angular velocity."""

import math

from elliptude.bounds.arguments import require_not_negative


def turn_rate_error(step: float, largest_rate: float, angular_acceleration: float) -> float:
    """How far a turn over the time it took is from the mean of the angular velocity meanwhile, (18.35).

    A gyro that integrates shows the rotation vector of the turn since its last sample, as Basilisk's `DRFramePlatform`
    does. If the axis moves in between, that vector is not the integral of the angular velocity. Add this to the noise
    of a `GuaranteedGyroFlow` whose `interval_rate` is 'mean'.

    Parameters
    ----------
    step : float
        Between samples, s.
    largest_rate : float
        Bound Ω of the angular velocity, rad/s.
    angular_acceleration : float
        Bound a of its derivative, rad/s².

    Returns
    -------
    float
        rad/s.

    Raises
    ------
    ValueError
        If an argument is negative or not finite, or the turn may be half a turn or more.
    """
    for name, value in (
        ("step", step),
        ("largest_rate", largest_rate),
        ("angular_acceleration", angular_acceleration),
    ):
        require_not_negative(name, value)
    if step == 0.0:
        return 0.0
    wander = angular_acceleration * step**2
    angle = 3.0 / 32.0 * largest_rate * step * wander + wander**2 / 18.0
    turn = largest_rate * step + angle
    if not turn < math.pi:
        raise ValueError(
            f"a step of {step} s at {largest_rate} rad/s must be less than half a turn, not {turn:.6g} rad"
        )
    half = 0.5 * turn
    return angle / step * (half / math.sin(half) if half > 0.0 else 1.0)
