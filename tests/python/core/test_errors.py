"""What is wrong is told by the argument's name, the value and the limit."""

import pickle

import elliptude
import numpy as np
import pytest
from elliptude import (
    Ellipsoid,
    GradientPotential,
    GravityGradient,
    Integrator,
    Quadric,
    RigidBody,
    SumPotential,
    UniformGravity,
)

I = np.eye(3)  # noqa: E741
NAN, INF = np.nan, np.inf
BODY = RigidBody([0.13, 0.28, 0.17])
BALL = Ellipsoid(np.zeros(3), I)
DISC = Ellipsoid(np.zeros(3), np.diag([1.0, 1.0, 0.0]))
SEGMENT = Ellipsoid(np.zeros(3), np.diag([0.0, 1.0, 0.0]))
INTEGRATOR = Integrator(BODY, step=0.002)
AXIS = [1.0, 0.0, 0.0]

VALUE_ERRORS = {
    # numbers and shapes
    "NaN": (lambda: elliptude.exp([1.0, NAN, 0.0]), r"rotation_vector must be finite, but rotation_vector\[1\] is nan"),
    "infinity in a batch": (
        lambda: elliptude.log([I, [AXIS, AXIS, [0.0, INF, 0.0]]]),
        r"rotation must be finite, but rotation\[1, 2, 1\] is inf",
    ),
    "shape of a vector": (
        lambda: elliptude.exp([1, 2]),
        r"rotation_vector must have the shape \(\.\.\., 3\), not \(2,\)",
    ),
    "shape of a matrix": (lambda: elliptude.log(AXIS), r"rotation must have the shape \(\.\.\., 3, 3\), not \(3,\)"),
    "ragged": (lambda: elliptude.exp([[1, 2, 3], [1]]), "rotation_vector is not an array"),
    "too large to square": (
        lambda: elliptude.cayley([1e200, 0, 0]),
        r"gibbs_vector must be shorter than 1e154.*1e\+200",
    ),
    # rotations
    "not orthogonal": (
        lambda: elliptude.log([I, 2.0 * I]),
        r"rotation\[1\] must be a rotation, but an entry of CᵀC − I is 3 in size \(limit 1\.49011612e-08\)",
    ),
    "reflection": (lambda: elliptude.log(-I), "rotation must be a rotation, but its determinant is -1, not 1"),
    "half turn": (lambda: elliptude.cayley_inverse(np.diag([1, -1, -1])), "rotation is a half turn"),
    "full turn": (
        lambda: elliptude.right_jacobian_inverse([[0, 0, 1], [0, 0, 7]]),
        r"rotation_vector\[1\] must be shorter than a full turn, 2π rad, but its length is 7",
    ),
    "zero quaternion": (lambda: elliptude.rotation_from_quaternion([0, 0, 0, 0]), "quaternion must not be zero"),
    "no nearest rotation": (
        lambda: elliptude.project_to_rotation([I, np.diag([1, 1, -2])]),
        r"matrix\[1\] has no nearest rotation: its determinant must be positive .* but is -2",
    ),
    "negative tolerance": (lambda: elliptude.is_rotation(I, -0.5), "tolerance must not be negative, but is -0.5"),
    "to SciPy": (lambda: elliptude.to_scipy(2.0 * I), "rotation must be a rotation"),
    # ellipsoids
    "dimension of a center": (
        lambda: Ellipsoid(np.zeros(7), np.eye(7)),
        "center has dimension 7; supported are 1 to 6",
    ),
    "no dimension": (lambda: Ellipsoid([], np.zeros((0, 0))), r"center must have the shape \(n,\), not \(0,\)"),
    "shape of a shape": (lambda: Ellipsoid([0, 0], I), r"shape must have the shape \(2, 2\), not \(3, 3\)"),
    "not symmetric": (
        lambda: Ellipsoid([0, 0], [[1, 2], [0, 1]]),
        r"shape must be symmetric, but shape\[1, 0\] is 0 and shape\[0, 1\] is 2",
    ),
    "negative eigenvalue": (
        lambda: Ellipsoid([0, 0], [[1, 2], [2, 1]]),
        "shape must be positive semidefinite, but its smallest eigenvalue is -1",
    ),
    "shape of points": (lambda: BALL.contains([1, 2]), r"points must have the shape \(\.\.\., 3\), not \(2,\)"),
    "volume of a disc": (DISC.log_volume, "shape must be positive definite: a flat ellipsoid has no volume"),
    "surface of a disc": (lambda: DISC.sample(1, surface=True), "the shortest semi-axis is 0"),
    "negative count": (lambda: BALL.sample(-1), "count must not be negative, but is -1"),
    "image's shape": (lambda: BALL.affine_image(np.eye(2)), r"transform must have the shape \(n, 3\), not \(2, 2\)"),
    "image's dimension": (lambda: BALL.affine_image(np.zeros((7, 3))), "transform has dimension 7"),
    "shift's shape": (lambda: BALL.affine_image(I, [1, 2]), r"shift must have the shape \(3,\), not \(2,\)"),
    "index": (lambda: BALL.projection([0, 3]), "indices must be from 0 to 2, but hold 3"),
    "index twice": (lambda: BALL.projection([1, 1]), "indices must differ, but 1 is there twice"),
    "no index": (lambda: BALL.projection([]), "indices has dimension 0"),
    "criterion": (
        lambda: elliptude.minimal_sum([BALL], criterion="size"),  # type: ignore[arg-type]
        "criterion must be 'trace' or 'volume', not 'size'",
    ),
    "weight": (
        lambda: elliptude.minimal_sum([BALL], weight=np.diag([1, 1, -3])),
        "weight must be positive definite, but its smallest eigenvalue is -3",
    ),
    "weight of a volume": (lambda: elliptude.minimal_sum([BALL], "volume", I), "weight belongs to criterion 'trace'"),
    "nothing to add": (lambda: elliptude.minimal_sum([]), "ellipsoids must be 1 to 64 in number, not 0"),
    "too much to add": (lambda: elliptude.minimal_sum([BALL] * 65), "ellipsoids must be 1 to 64 in number, not 65"),
    "dimensions to add": (
        lambda: elliptude.minimal_sum([BALL, Ellipsoid([0], [[1]])]),
        r"ellipsoids\[1\] has dimension 1, ellipsoids\[0\] has 3",
    ),
    "volume of a flat sum": (lambda: elliptude.minimal_sum([DISC], "volume"), "ellipsoids have a flat sum"),
    "dimensions to intersect": (
        lambda: elliptude.minimal_intersection(BALL, Ellipsoid([0], [[1]])),
        "second has dimension 1, first has 3",
    ),
    "both flat": (lambda: elliptude.minimal_intersection(DISC, SEGMENT), "first and second are both flat"),
    "both flat, margin": (
        lambda: elliptude.overlap_margin(SEGMENT, Ellipsoid(AXIS, SEGMENT.shape)),
        "first and second are both flat",
    ),
    "quadric not symmetric": (lambda: Quadric([[1, 2], [0, 1]], [0, 0], 1), "a must be symmetric"),
    "quadric's number": (lambda: Quadric(I, AXIS, [1, 2]), r"c must have the shape \(\) of a number, not \(2,\)"),
    "unbounded": (
        lambda: Quadric.slab(AXIS, 0, 1).to_ellipsoid(),
        "a must be positive definite, but its smallest eigenvalue is 0",
    ),
    "flat as a quadric": (lambda: Quadric.from_ellipsoid(DISC), "ellipsoid must not be flat"),
    "zero normal": (lambda: Quadric.slab([0, 0, 0], 0, 1), "normal must not be zero, but its length is 0"),
    "negative width": (lambda: Quadric.slab(AXIS, 0, -2), "half_width must not be negative, but is -2"),
    # bodies and potentials
    "triangle inequality": (
        lambda: RigidBody([1, 1, 3]),
        "inertia breaks the triangle inequality: of the principal moments 3, 1, 1 kg m² .* sum of the others, 2",
    ),
    "negative moment": (lambda: RigidBody([1, -1, 3]), "inertia must be positive definite, .* moments are 3, 1, -1"),
    "inertia not symmetric": (
        lambda: RigidBody([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
        r"inertia must be symmetric, but inertia\[1, 0\] is 0 and inertia\[0, 1\] is 0.5",
    ),
    "inertia's shape": (lambda: RigidBody(3.0), r"inertia must have the shape \(3, 3\), or \(3,\) .* not \(\)"),
    "negative mass": (lambda: UniformGravity(-1, 9.81, AXIS), "mass must not be negative, but is -1"),
    "negative gravity": (lambda: UniformGravity(1, -9.81, AXIS), "gravity must not be negative, but is -9.81"),
    "center of mass": (lambda: UniformGravity(1, 9.81, [1]), r"center_of_mass must have the shape \(3,\), not \(1,\)"),
    "orbit rate": (lambda: GravityGradient(BODY, -0.1), "orbit_rate must not be negative, but is -0.1"),
    "orbit": (lambda: GravityGradient(BODY, 0.1, 2 * I), "orbit must be a rotation"),
    "no terms": (lambda: SumPotential([]), "potentials must hold at least one"),
    "negative bound": (
        lambda: GradientPotential(lambda c, t: 0.0, lambda c, t: I, -1.0),
        "torque_curvature_bound must not be negative, but is -1",
    ),
    # the integrator
    "negative step": (lambda: Integrator(BODY, step=-0.1), "step must be positive, but is -0.1 s"),
    "step NaN": (lambda: Integrator(BODY, step=NAN), "step must be finite, but step is nan"),
    "order": (
        lambda: Integrator(BODY, step=0.1, order=3),  # type: ignore[arg-type]
        "order must be 2, 4, 6 or 8, but is 3",
    ),
    "attitude": (lambda: INTEGRATOR.step(2 * I, AXIS), "attitude must be a rotation"),
    "angular velocity": (lambda: INTEGRATOR.step(I, [NAN, 0, 0]), r"angular_velocity\[0\] is nan"),
    "batches": (
        lambda: INTEGRATOR.step([I, I], np.zeros((3, 3))),
        r"angular_velocity has the batch shape \(3,\), which does not fit that of attitude, \(2,\)",
    ),
    "too fast": (
        lambda: INTEGRATOR.step(I, [[0, 0, 0], [1e4, 0, 0]]),
        r"step 0\.002 s is too long for item \[1\]: .* angular velocity is 10000 rad/s",
    ),
    "too fast on the way": (
        lambda: INTEGRATOR.trajectory(I, AXIS, 10, control_torque=[[0, 0, 0]] * 5 + [[1e6, 0, 0]] * 5),
        r"step 0\.002 s is too long after 5 steps",
    ),
    "too fast to linearize": (lambda: INTEGRATOR.linearize(I, [1e4, 0, 0]), r"step 0\.002 s is too long"),
    "no steps": (lambda: INTEGRATOR.trajectory(I, AXIS, 0), "steps must be at least 1, but is 0"),
    "no steps to linearize": (lambda: INTEGRATOR.linearize(I, AXIS, steps=-2), "steps must be at least 1, but is -2"),
    "every": (lambda: INTEGRATOR.trajectory(I, AXIS, 10, every=3), "every must divide steps, .* is 3 for 10 steps"),
    "controls": (
        lambda: INTEGRATOR.trajectory(I, AXIS, 10, control_torque=np.zeros((9, 3))),
        r"control_torque must have the shape \(3,\) or \(steps, 3\) = \(10, 3\), not \(9, 3\)",
    ),
    "one attitude": (
        lambda: INTEGRATOR.trajectory([I, I], AXIS, 2),
        r"attitude must have the shape \(3, 3\), not \(2, 3, 3\)",
    ),
    "momentum": (
        lambda: elliptude.relative_attitude(BODY, 0.1, [AXIS, [50, 0, 0]]),
        r"step 0\.1 s is too long for momentum\[[01]\], whose length is",
    ),
    "form": (
        lambda: elliptude.relative_attitude(BODY, 0.1, AXIS, form="euler"),  # type: ignore[arg-type]
        "form must be 'cayley' or 'exponential', not 'euler'",
    ),
    # directions
    "zero direction": (
        lambda: elliptude.wahba(I, [I, [AXIS, [0, 0, 0], AXIS]]),
        r"body\[1, 1\] must be a direction, but its length is 0",
    ),
    "collinear": (
        lambda: elliptude.wahba([AXIS, AXIS], [[AXIS, [0, 1, 0]], [AXIS, AXIS]]),
        r"body\[[01]\] does not determine the attitude",
    ),
    "numbers of directions": (
        lambda: elliptude.wahba(I, I[:2]),
        r"reference must have the shape \(\.\.\., 2, 3\), not \(3, 3\)",
    ),
    "no directions": (lambda: elliptude.wahba(np.zeros((0, 3)), np.zeros((0, 3))), r"body must have the shape"),
    "negative weight": (
        lambda: elliptude.wahba(I, I, [1, -1, 1]),
        r"weights must not be negative, but weights\[1\] is -1",
    ),
    "no weight": (lambda: elliptude.wahba(I, I, [0, 0, 0]), "weights must not be all zero"),
    "method": (
        lambda: elliptude.wahba(I, I, method="quest"),  # type: ignore[arg-type]
        "method must be 'svd', 'foam', 'davenport' or 'qr', not 'quest'",
    ),
    "improper profile": (lambda: elliptude.wahba(I, np.diag([1, 1, -1]), method="qr"), "det L is -1"),
    "no cross product": (lambda: elliptude.add_cross_product([AXIS, AXIS], I[:2]), "reference or body are collinear"),
}


@pytest.mark.parametrize("what", VALUE_ERRORS)
def test_value_errors(what):
    call, message = VALUE_ERRORS[what]
    with pytest.raises(ValueError, match=message) as caught:
        call()
    assert not isinstance(caught.value, elliptude.InconsistentMeasurement)


TYPE_ERRORS = {
    "text": (lambda: elliptude.exp(["a", "b", "c"]), "rotation_vector must hold real numbers, not <U1"),
    "complex": (lambda: elliptude.exp([1j, 0, 0]), "rotation_vector must hold real numbers, not complex128"),
    "objects": (lambda: elliptude.exp([None, 1, 2]), "rotation_vector must hold real numbers, not object"),
    "truth values": (lambda: elliptude.exp([True, False, True]), "rotation_vector must hold real numbers, not bool"),
    "nothing": (lambda: elliptude.log(None), "rotation must hold real numbers"),
    "no potential": (
        lambda: Integrator(BODY, 3, step=0.1),
        r"potential must be a potential, but int has no method energy",
    ),
    "no term": (lambda: SumPotential([UniformGravity(1, 1, AXIS), 3]), r"potentials\[1\] must be a potential"),
    "no function": (lambda: GradientPotential(3, lambda c, t: I), "energy must be a function"),
    "fraction of steps": (lambda: INTEGRATOR.trajectory(I, AXIS, 2.5), "steps must be an integer"),
    "second set": (
        lambda: elliptude.minimal_intersection(BALL, I),
        "second must be an Ellipsoid or a Quadric, not numpy.ndarray",
    ),
}


@pytest.mark.parametrize("what", TYPE_ERRORS)
def test_type_errors(what):
    call, message = TYPE_ERRORS[what]
    with pytest.raises(TypeError, match=message):
        call()


INCONSISTENT = {
    "ellipsoids": (
        lambda: elliptude.minimal_intersection(BALL, Ellipsoid([2.2, 0, 0], I)),
        -0.21,
        "overlap margin is -0.21",
    ),
    "ellipsoid and slab": (
        lambda: elliptude.minimal_intersection(BALL, Quadric.slab(AXIS, 3, 1)),
        NAN,
        "no common point",
    ),
    "quadric": (lambda: Quadric(I, [0, 0, 0], -2).to_ellipsoid(), -2.0, "largest slack is -2"),
}


@pytest.mark.parametrize("what", INCONSISTENT)
def test_inconsistent_sets(what):
    call, margin, message = INCONSISTENT[what]
    with pytest.raises(elliptude.InconsistentMeasurement, match=message) as caught:
        call()
    assert isinstance(caught.value, ValueError)
    assert caught.value.margin == pytest.approx(margin, rel=1e-9, nan_ok=True)
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value)
    assert again.margin == pytest.approx(margin, rel=1e-9, nan_ok=True)


def test_rotations_that_are_nearly_one_are_taken():
    worn = I + 1e-9
    np.testing.assert_allclose(elliptude.renormalized(worn), elliptude.project_to_rotation(worn), atol=1e-15)
    elliptude.log(worn)
