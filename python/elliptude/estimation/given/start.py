"""The set that the guaranteed filter begins with, where one is given or follows from the first row."""

import numpy as np
import scipy

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import GivenStart
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation.direction_rows import DirectionRows
from elliptude.estimation.given.filter_input import NO_BIAS
from elliptude.typing import FloatArray


def first_set(configuration: Configuration, rows: DirectionRows) -> tuple[elliptude.StateEllipsoid | None, bool]:
    """The set at the first row, if one is given or follows; and whether the heading counts from there."""
    given = configuration.start
    if isinstance(given, GivenStart):
        flow = configuration.flow
        if not isinstance(flow, GyroFlow):
            return given.build(), False
        known = flow.known_bias()
        start = given.build(known)
        if flow.estimate_bias:  # the filter's state is what is left of it
            return elliptude.StateEllipsoid(start.attitude, start.vector - known, start.shape), False
        if given.rate_rad_per_s is not None and (start.vector.any() or known.any()):
            raise ValueError(
                "start.rate_rad_per_s: the bias is not estimated; flow.known_bias_deg_per_s is what is known of it, "
                "so leave it out"
            )
        return _without_bias(start.attitude, start.shape[:3, :3]), False
    heading_is_measured = any(
        np.isfinite(rows.angles[:, i]).any() for i in range(len(rows.names)) if i != rows.up_column
    )
    if configuration.rule is None or heading_is_measured:
        return None, False
    # Nothing determines the heading: it counts from the first row, by a turn about the reference frame's vertical that
    # makes the error of the first attitude perpendicular to up. Theory, section 18.6.
    up, angle = rows.directions[0, 0], float(rows.angles[0, 0])
    if not angle < np.pi:
        return None, False
    return _without_bias(_shortest_turn_to_vertical(up), _disc(up, angle)), True


def _disc(normal: FloatArray, radius: float) -> FloatArray:
    """A shape (3, 3) that holds a disc, nowhere so thin that rounding makes it indefinite; section 18.6."""
    # By rounding it may be flat within 16ε of its size, and the attitude across it off by 1e-14 rad.
    epsilon = float(np.finfo(np.float64).eps)
    thickness = 64.0 * epsilon * radius**2 + NO_BIAS**2
    shape: FloatArray = (1.0 + 1e-9) * (radius**2 * (np.eye(3) - np.outer(normal, normal)) + thickness * np.eye(3))
    return shape


def _without_bias(attitude: FloatArray, attitude_shape: FloatArray) -> elliptude.StateEllipsoid:
    shape = NO_BIAS**2 * np.eye(6)
    shape[:3, :3] += attitude_shape
    return elliptude.StateEllipsoid(attitude, np.zeros(3), shape)


def _shortest_turn_to_vertical(up: FloatArray) -> FloatArray:
    """The attitude (3, 3) that takes a unit vector in body axes to the third reference axis."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-15:  # of which the attitude may be off, as by rounding
        return np.eye(3) if up[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    turn = scipy.spatial.transform.Rotation.from_rotvec(np.arctan2(sine, up[2]) / sine * axis)
    return np.asarray(turn.as_matrix(), dtype=np.float64)
