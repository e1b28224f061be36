"""How two passes are combined: what is left of claims where a statement is wrong, and headings around the circle."""

from types import SimpleNamespace

import numpy as np
from elliptude.configuration import Configuration
from elliptude.estimation.vertical import vertical_of
from elliptude.monitoring import Sets
from elliptude.results import AttitudeBounds, DirectionLog, GuaranteedLog
from elliptude.smoothing.both import Passes, _narrowed, both_passes
from reference import so3

UP = np.array([0.0, 0.0, 1.0])
CONFIGURATION = Configuration.model_validate(
    {
        "reference_frame": "ENU",
        "flow": {"kind": "gyro", "columns": ["x", "y", "z"], "noise_deg_per_s": 1.0},
        "directions": [{"name": "up", "columns": ["a", "b", "c"], "reference": [0, 0, 1], "bound_deg": 1.0}],
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
    }
)


def sets(heading, half_widths, bounds, claim=0):
    """One row, with a center that is turned about up."""
    return GuaranteedLog(
        times=np.zeros(1),
        attitudes=so3.exp(heading * UP)[None],
        vectors=np.zeros((1, 3)),
        shapes=np.diag([*np.square(half_widths), 1e-18, 1e-18, 1e-18])[None],
        claims=np.array([claim], dtype=np.uint8),
        prediction_used=np.ones(1, dtype=bool),
        updated=np.ones(1, dtype=bool),
        dropped=np.zeros((1, 3), dtype=bool),
        margins=np.zeros(1),
        question_bounds=np.array([bounds]),
    )


def test_up_without_a_condition_takes_nothing_from_sets_that_are_proved_wrong():
    """The headings of the passes contradict one another; their caps of up do not, and alone bound it."""
    forward, backward = (sets(at, [0.01] * 3, [0.01, -0.01, 0.01, 0.02]) for at in (0.0, 1.0))
    caps = DirectionLog(UP[None], np.array([0.3]), np.zeros(1, dtype=np.uint8), np.zeros(1, dtype=bool))
    vertical = vertical_of(forward, caps, UP)
    assert vertical is not None
    assert vertical.angles[0] == 0.01
    run = SimpleNamespace(sets=forward, rows=SimpleNamespace(up=UP), caps=caps, vertical=vertical, starts_heading=False)
    found = both_passes(Passes(run, backward, caps), CONFIGURATION)
    assert found.disagreements.tolist() == [0]
    assert found.sets.claims.tolist() == [1]
    assert found.vertical.claims.tolist() == [0]
    assert 0.29 < found.vertical.angles[0] <= 0.3
    assert found.vertical.tilt_bounds[0] >= found.vertical.angles[0]


def test_a_heading_is_not_answered_worse_where_arcs_meet_twice():
    """What two long arcs have in common may be two pieces, and the shorter arc about them reach beyond half a turn."""
    forward = sets(0.0, [1e4] * 3, [np.pi, -3.0, 3.0, np.pi])
    bounds = AttitudeBounds(*np.array([[0.0], [-2.64], [2.64], [np.pi]]))
    other = sets(-1.64, [1e4] * 3, [0.0, -2.64, 2.64, np.pi])
    quaternion = np.array([[np.cos(0.82), 0.0, 0.0, -np.sin(0.82)]])
    source = Sets(other.times, quaternion, other.shapes[:, :3, :3], other.claims, bounds, UP)
    found = _narrowed(forward, [source], UP).attitude_bounds
    assert found is not None
    assert (found.heading_from[0], found.heading_to[0]) == (-3.0, 3.0)
