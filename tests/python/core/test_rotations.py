"""Rotations: the C++ core against the NumPy reference and SciPy, batches, conversions."""

import elliptude
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from inputs import assert_close, direction, generators, rotation, scales
from reference import so3
from scipy.spatial.transform import Rotation

OF_A_VECTOR = [
    elliptude.hat,
    elliptude.exp,
    elliptude.cayley,
    elliptude.right_jacobian,
    elliptude.right_jacobian_inverse,
    elliptude.left_jacobian,
    elliptude.left_jacobian_inverse,
]
OF_A_ROTATION = [
    elliptude.vee,
    elliptude.log,
    elliptude.cayley_inverse,
    elliptude.renormalized,
    elliptude.project_to_rotation,
    elliptude.is_rotation,
    elliptude.quaternion_from_rotation,
]


@pytest.mark.parametrize("function", OF_A_VECTOR, ids=lambda f: f.__name__)
@given(rng=generators, scale=scales)
def test_function_of_a_vector(function, rng, scale):
    # Up to 6 rad, below the full turn where the inverse Jacobians end.
    vector = 6.0 * scale * direction(rng)
    assert_close(function(vector), getattr(so3, function.__name__)(vector))


@given(rng=generators, scale=scales)
def test_small_deviations_from_the_identity_keep_their_digits(rng, scale):
    vector = scale * direction(rng)
    for function in (elliptude.exp, elliptude.cayley, elliptude.right_jacobian, elliptude.left_jacobian_inverse):
        expected = getattr(so3, function.__name__)(vector)
        assert_close(elliptude.vee(function(vector)), so3.vee(expected))


@given(rng=generators, scale=scales)
def test_log_and_its_relatives(rng, scale):
    vector = 3.1 * scale * direction(rng)
    matrix = so3.exp(vector)
    assert_close(elliptude.log(matrix), so3.log(matrix))
    assert_close(elliptude.cayley_inverse(matrix), so3.cayley_inverse(matrix))
    assert_close(elliptude.vee(matrix), so3.vee(matrix))
    assert_close(elliptude.quaternion_from_rotation(matrix), so3.quaternion_from_rotation(matrix))


@given(rng=generators, exponent=st.floats(-16.0, -1.0))
def test_log_near_a_half_turn(rng, exponent):
    matrix = so3.exp((np.pi - 10.0**exponent) * direction(rng))
    vector, expected = elliptude.log(matrix), so3.log(matrix)
    # At the half turn both signs are right, and rounding chooses.
    assert_close(vector if vector @ expected > 0.0 else -vector, expected)
    assert np.linalg.norm(vector) <= np.pi * (1.0 + 1e-15)


@given(rng=generators, size=st.floats(-150.0, 150.0))
def test_quaternion_of_any_length(rng, size):
    quaternion = 10.0**size * direction(rng, 4)
    assert_close(elliptude.rotation_from_quaternion(quaternion), so3.rotation_from_quaternion(quaternion))


@given(rng=generators)
def test_nearest_rotation(rng):
    # Singular values from 0.1 to 10; both ways lose the digits that the smallest sum of two of them is short of.
    stretch = np.diag(rng.uniform(0.1, 10.0, 3))
    matrix = rotation(rng) @ rotation(rng).T @ stretch @ rotation(rng)
    assert_close(elliptude.project_to_rotation(matrix), so3.nearest_rotation(matrix))


@given(rng=generators)
def test_renormalized_rotation(rng):
    worn = rotation(rng) + 1e-9 * rng.uniform(-1.0, 1.0, (3, 3))
    renewed = elliptude.renormalized(worn)
    assert_close(renewed, so3.nearest_rotation(worn))
    assert np.max(np.abs(renewed.T @ renewed - np.eye(3))) < 1e-15


def test_is_rotation():
    assert elliptude.is_rotation(np.eye(3))
    assert not elliptude.is_rotation(-np.eye(3))
    assert not elliptude.is_rotation(np.full((3, 3), np.nan))
    assert not elliptude.is_rotation((1.0 + 1e-6) * np.eye(3))
    assert elliptude.is_rotation((1.0 + 1e-6) * np.eye(3), tolerance=1e-5)
    np.testing.assert_array_equal(elliptude.is_rotation([np.eye(3), 2.0 * np.eye(3)]), [True, False])


@pytest.mark.parametrize("function", OF_A_VECTOR, ids=lambda f: f.__name__)
@pytest.mark.parametrize("leading", [(0,), (5,), (2, 3), (2, 1, 3)])
def test_batch_of_vectors_is_the_loop(function, leading):
    rng = np.random.default_rng(1)
    vectors = rng.standard_normal((*leading, 3))
    batch = function(vectors)
    assert batch.shape == (*leading, 3, 3)
    assert batch.dtype == np.float64
    assert batch.flags.c_contiguous
    for index in np.ndindex(leading):
        np.testing.assert_array_equal(batch[index], function(vectors[index]))


@pytest.mark.parametrize("function", OF_A_ROTATION, ids=lambda f: f.__name__)
@pytest.mark.parametrize("leading", [(0,), (5,), (2, 3)])
def test_batch_of_rotations_is_the_loop(function, leading):
    rng = np.random.default_rng(2)
    rotations = elliptude.exp(rng.standard_normal((*leading, 3)))
    batch = function(rotations)
    assert batch.shape[: len(leading)] == leading
    for index in np.ndindex(leading):
        np.testing.assert_array_equal(batch[index], function(rotations[index]))


def test_memory_layout_and_type_do_not_matter():
    rng = np.random.default_rng(3)
    vectors = rng.standard_normal((4, 3))
    expected = elliptude.exp(vectors)
    np.testing.assert_array_equal(elliptude.exp(np.asfortranarray(vectors)), expected)
    np.testing.assert_array_equal(elliptude.exp(np.repeat(vectors, 2, axis=0)[::2]), expected)
    np.testing.assert_array_equal(elliptude.exp(vectors.tolist()), expected)
    np.testing.assert_array_equal(elliptude.exp(vectors.astype(">f8")), expected)
    np.testing.assert_array_equal(elliptude.exp(np.array([1, 0, 2])), elliptude.exp([1.0, 0.0, 2.0]))
    rotations = np.asfortranarray(expected[0])
    np.testing.assert_array_equal(elliptude.log(rotations), elliptude.log(expected[0]))


def test_input_is_not_changed():
    vector = np.array([1.0, 2.0, 3.0])
    vector.flags.writeable = False
    elliptude.exp(vector)


@given(rng=generators)
def test_scipy_goes_in_and_out(rng):
    vectors = rng.uniform(-1.5, 1.5, (4, 3))
    rotations = Rotation.from_rotvec(vectors)
    matrices = elliptude.exp(vectors)
    assert_close(matrices, rotations.as_matrix())
    assert_close(elliptude.log(rotations), vectors)
    assert_close(elliptude.log(rotations[0]), vectors[0])
    assert_close(elliptude.to_scipy(matrices).as_rotvec(), vectors)
    assert_close(elliptude.to_scipy(matrices[0]).as_rotvec(), vectors[0])
    assert_close(elliptude.to_scipy(rotations).as_matrix(), matrices)
    # SciPy's quaternions have the scalar last.
    quaternions = elliptude.quaternion_from_rotation(rotations)
    assert_close(quaternions, rotations.as_quat(canonical=True)[:, [3, 0, 1, 2]])
