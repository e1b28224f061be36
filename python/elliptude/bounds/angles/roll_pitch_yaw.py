"""Roll, pitch and yaw with their bounds, from what is known of the vertical and of the heading; arrays in and out.

C = Rz(yaw) Ry(pitch) Rx(roll) takes body vectors to the reference frame, whose third axis e is up or down. Roll and
pitch follow from e in body axes alone. Where pitch may be ±90°, roll and yaw are not defined: their bounds are then
−π and π. Derivations: docs/theory.md, section 18.11.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elliptude.typing import FloatArray

# rad; covers rounding, 18.11.
_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)
# rad; pitch counts as ±90° if it may be this near.
_NEAR_VERTICAL = 1e-6


class Bounded(NamedTuple):
    """Angles of N rows in [−π, π], and between which ones the truth is; NaN where nothing is known."""

    value: FloatArray
    """rad, shape (N,)."""
    least: FloatArray
    """rad, shape (N,). The truth is between both ends up to whole turns; −π and π: anywhere. The value need not be."""
    most: FloatArray
    """rad, at least `least`, shape (N,)."""


def roll_and_pitch(thirds: FloatArray, angles: FloatArray) -> tuple[Bounded, Bounded]:
    """Roll and pitch if the reference frame's third axis is within an angle of a direction, (18.31), (18.32).

    Parameters
    ----------
    thirds : (N, 3) array
        The third reference axis in body axes: up in ENU and NWU, down in NED. Unit vectors; NaN where not known.
    angles : (N,) array
        How far it may be from there, rad.

    Returns
    -------
    roll, pitch : Bounded
    """
    wider = np.asarray(angles, dtype=np.float64) + _ROUNDING
    x, y, z = np.where(np.isfinite(wider)[:, None], thirds, np.nan).T
    pitch = np.arctan2(-x, np.hypot(y, z))
    roll = np.arctan2(y, z)
    least, most = np.maximum(pitch - wider, -0.5 * np.pi), np.minimum(pitch + wider, 0.5 * np.pi)
    off, level = np.full_like(pitch, np.pi), _is_level(pitch, wider)
    steep, shallow = np.abs(pitch[level]) + wider[level], np.abs(pitch[level]) - wider[level]
    off[level] = np.arctan2(np.sin(wider[level]), np.sqrt(np.cos(steep) * np.cos(shallow))) + _ROUNDING / np.cos(steep)
    return _about(roll, -off, off), Bounded(pitch, least, most)


def yaw(
    attitudes: FloatArray, tilts: FloatArray, turn_from: FloatArray, turn_to: FloatArray, *, is_up: bool
) -> Bounded:
    """Yaw if the truth is the estimate after a tilt and a turn about the vertical, (18.33), (18.34).

    Parameters
    ----------
    attitudes : (N, 3, 3) array
        Estimates, from body to reference axes; NaN where not known.
    tilts : (N,) array
        How far estimated up may be from true up, rad.
    turn_from, turn_to : (N,) array
        The turn about up from the estimate to the truth when the tilt is taken away, at least and at most, rad.
    is_up : bool
        Whether the reference frame's third axis is up; else it is down.

    Returns
    -------
    Bounded
    """
    forward = np.asarray(attitudes, dtype=np.float64)[:, :, 0]
    flat = np.hypot(forward[:, 0], forward[:, 1])
    elevation = np.arctan2(forward[:, 2], flat)
    if not is_up:
        turn_from, turn_to = -turn_to, -turn_from
    wider = np.asarray(tilts, dtype=np.float64) + _ROUNDING
    off = np.full_like(flat, np.pi)
    level = _is_level(elevation, wider)
    with np.errstate(divide="ignore", invalid="ignore"):
        steepness = forward[:, 2] / flat
    rounding = _ROUNDING / np.cos(np.abs(elevation[level]) + wider[level])
    off[level] = _azimuth_by_tilt(steepness[level], np.tan(0.5 * wider[level])) + rounding
    return _about(np.arctan2(forward[:, 1], forward[:, 0]), turn_from - off, turn_to + off)


def _is_level(elevation: FloatArray, angle: FloatArray) -> NDArray[np.bool_]:
    """Whether what is within an angle of this elevation is never vertical."""
    return np.abs(elevation) + angle < 0.5 * np.pi - _NEAR_VERTICAL


def _azimuth_by_tilt(steepness: FloatArray, reach: FloatArray) -> FloatArray:
    """How far turns about level axes change the azimuth of a vector at most, rad, shape (N,); (18.34).

    Parameters
    ----------
    steepness : (N,) array
        t, the tangent of the vector's elevation.
    reach : (N,) array
        τ, the tangent of half the largest turn.
    """
    t, squared = np.abs(steepness), reach**2
    slope = t * (1.0 - 3.0 * squared)
    product = squared * (1.0 + squared + 2.0 * t**2)
    root = np.sqrt(slope**2 + 8.0 * product)
    # The root of 2x² + slope x = product that is in the circle; both forms, as each cancels for one sign.
    x = np.where(slope > 0.0, 2.0 * product / (slope + root), 0.25 * (root - slope))
    x = np.clip(x, -reach, reach)
    y = np.sqrt(np.maximum(squared - x**2, 0.0))
    angle: FloatArray = np.arctan2(2.0 * y * (t + x), 1.0 - 2.0 * t * x - x**2 + y**2)
    return angle


def _about(value: FloatArray, least: FloatArray, most: FloatArray) -> Bounded:
    """An angle and the ends of its interval, given from it; the whole circle where they are a turn apart."""
    is_any = most - least >= 2.0 * np.pi
    known = np.isfinite(value) & np.isfinite(most - least)
    return Bounded(
        np.where(known, value, np.nan),
        np.where(known, np.where(is_any, -np.pi, value + least), np.nan),
        np.where(known, np.where(is_any, np.pi, value + most), np.nan),
    )
