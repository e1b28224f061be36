"""Basilisk's parameters of an attitude, by SciPy's: no Basilisk is needed."""

import numpy as np
import pytest
from elliptude.basilisk import attitude_from_mrp, mrp_from_attitude
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def attitudes():
    """Turns of all sizes, half turns and nearly whole ones among them."""
    axes = np.random.default_rng(3).normal(size=(200, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.concatenate([[0.0, 1e-12, np.pi - 1e-9, np.pi], np.linspace(0.01, np.pi, 196)])
    return Rotation.from_rotvec(axes * angles[:, None])


def test_parameters_are_those_of_scipy(attitudes):
    """SciPy's matrix of an attitude takes body vectors to N, as ours does; sigma_BN are its parameters."""
    np.testing.assert_allclose(attitude_from_mrp(attitudes.as_mrp()), attitudes.as_matrix(), atol=1e-14)


def test_there_and_back(attitudes):
    back = mrp_from_attitude(attitudes.as_matrix())
    assert (np.linalg.norm(back, axis=1) <= 1.0 + 1e-15).all()
    np.testing.assert_allclose(attitude_from_mrp(back), attitudes.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(back[4:-1], attitudes.as_mrp()[4:-1], atol=1e-12)  # at half turns both sets are as long
    np.testing.assert_array_equal(mrp_from_attitude(attitudes), back)


def test_a_known_attitude():
    """90° about z: the body's x axis is N's y axis, and sigma is tan 22.5° about z."""
    attitude = attitude_from_mrp([0.0, 0.0, np.tan(np.pi / 8)])
    np.testing.assert_allclose(attitude @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(mrp_from_attitude(attitude), [0.0, 0.0, np.tan(np.pi / 8)], atol=1e-15)


def test_both_sets_are_the_same_attitude(attitudes):
    inside = attitudes.as_mrp()[10:]
    outside = -inside / np.sum(inside**2, axis=1, keepdims=True)
    np.testing.assert_allclose(attitude_from_mrp(outside), attitude_from_mrp(inside), atol=1e-13)


@pytest.mark.parametrize("size", [1e-300, 1e160, 1e300])
def test_no_square_overflows(size):
    """A whole turn is none, and so is nearly none."""
    np.testing.assert_allclose(attitude_from_mrp([size, -size, size / 2]), np.eye(3), atol=1e-15)


def test_a_batch_has_its_shape():
    assert attitude_from_mrp(np.zeros((2, 5, 3))).shape == (2, 5, 3, 3)
    assert attitude_from_mrp(np.zeros((0, 3))).shape == (0, 3, 3)
    assert mrp_from_attitude(np.broadcast_to(np.eye(3), (2, 5, 3, 3))).shape == (2, 5, 3)


@pytest.mark.parametrize(
    ("sigma", "says"),
    [
        (0.0, r"sigma must have shape \(\.\.\., 3\), not \(\)"),
        ([1.0, 2.0], r"not \(2,\)"),
        ([np.nan, 0, 0], "sigma must be finite"),
    ],
)
def test_what_is_wrong_is_named(sigma, says):
    with pytest.raises(ValueError, match=says):
        attitude_from_mrp(sigma)
