from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.typing import AttitudeLike

_Floats: TypeAlias = NDArray[np.float64]

def motion(
    times: ArrayLike,
    attitude: AttitudeLike,
    angular_velocity: ArrayLike,
    inertia: ArrayLike,
    *,
    weighted_center: ArrayLike | None = None,
    orbit_rate: float = 0.0,
    eccentricity: float = 0.0,
    wheel_momentum: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    precise: bool = False,
) -> tuple[_Floats, _Floats]: ...
def rotation(
    times: ArrayLike,
    attitude: AttitudeLike,
    angular_velocity: ArrayLike,
    angular_acceleration: ArrayLike,
    *,
    precise: bool = False,
) -> tuple[_Floats, _Floats]: ...
