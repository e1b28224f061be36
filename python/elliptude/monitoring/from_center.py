"""From bounds of the center's tilt and heading to those of other attitudes: theory, section 18.8.

Tilts obey the triangle inequality on the sphere. Headings add up, but for half the excess of a spherical triangle.
"""

from typing import NamedTuple

import numpy as np

from elliptude.monitoring import arcs
from elliptude.monitoring.error_angles import ANGLE_ROUNDING
from elliptude.results import AttitudeBounds
from elliptude.typing import FloatArray


class FromCenter(NamedTuple):
    """What bounds about the centers say of n other attitudes, rad."""

    tilt: FloatArray
    """The largest angle between the two up directions, shape (n,)."""
    least_tilt: FloatArray
    """The least, shape (n,)."""
    headings: FloatArray
    """The turn about up from the attitude to the truth, as `elliptude.monitoring.arcs`, shape (n, 2)."""


def from_center(offsets: FloatArray, up: FloatArray, bounds: AttitudeBounds) -> FromCenter:
    """Bound the errors of attitudes by bounds of the centers' errors.

    Parameters
    ----------
    offsets : (n, 4) array
        Unit quaternions (w, x, y, z) of Ĉᵀ C₀: each attitude C₀ as seen from its center. Either sign.
    up : (n, 3) array
        Unit vectors up in the body axes of the centers, Ĉᵀe.
    bounds : AttitudeBounds
        Of the centers, by the same vertical, arrays of shape (n,); NaN where there is none.

    Returns
    -------
    FromCenter
    """
    w, v = offsets[:, 0], offsets[:, 1:]
    about = np.einsum("ni,ni->n", up, v)
    across, along = np.linalg.norm(np.cross(up, v), axis=1), np.hypot(w, about)
    away = 2.0 * np.arctan2(across, along)
    tilt = np.minimum(away + bounds.tilt + ANGLE_ROUNDING, np.pi)
    least_tilt = np.maximum(away - bounds.tilt - ANGLE_ROUNDING, 0.0)
    # (18.30), both angles enlarged by what rounding may do.
    of_center = np.tan(0.5 * np.minimum(bounds.tilt + ANGLE_ROUNDING, np.pi - ANGLE_ROUNDING))
    sine = of_center * np.tan(0.5 * np.minimum(away + ANGLE_ROUNDING, np.pi - ANGLE_ROUNDING)) * (1.0 + ANGLE_ROUNDING)
    slip = np.where(sine < 1.0, 2.0 * np.arcsin(np.minimum(sine, 1.0)), np.pi)
    rounding = ANGLE_ROUNDING / np.maximum(along, ANGLE_ROUNDING**2)
    half_width = 0.5 * (bounds.heading_to - bounds.heading_from) + slip + rounding
    # The twist from the attitude to the center, (18.29).
    twist = 2.0 * np.arctan2(-about, w)
    return FromCenter(tilt, least_tilt, arcs.arc(twist + 0.5 * (bounds.heading_from + bounds.heading_to), half_width))
