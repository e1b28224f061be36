"""Attitude errors about reference axes: against SciPy's turns, points of the sets, and the core's own half-widths."""

import elliptude
import numpy as np
import pytest
from elliptude.bounds.angles.about_axes import about_axes, half_widths_along
from scipy.spatial.transform import Rotation


def made(count, size, seed=1):
    """Attitudes and shapes whose longest semi-axis is of this size."""
    rng = np.random.default_rng(seed)
    factors = rng.standard_normal((count, 3, 3)) * 10.0 ** rng.uniform(-1.0, 0.0, (count, 1, 3))
    shapes = factors @ factors.swapaxes(1, 2)
    shapes *= size**2 / np.linalg.eigvalsh(shapes)[:, -1:, None]
    return Rotation.random(count, rng=rng).as_matrix(), shapes


def turns_of(points, chart):
    """The turns whose coordinates in a chart these are."""
    if chart == "exponential":
        return Rotation.from_rotvec(points)
    return Rotation.from_quat(np.column_stack([np.ones(len(points)), 0.5 * points]), scalar_first=True)


@pytest.mark.parametrize("chart", ["exponential", "gibbs"])
@pytest.mark.parametrize("size", [0.01, 0.5, 2.5])
def test_no_attitude_of_the_set_is_further_about_a_reference_axis(chart, size):
    """Turns from Ĉ to attitudes on the boundary, as rotation vectors in reference axes, by SciPy."""
    attitudes, shapes = made(6, size)
    shown = about_axes("reference", attitudes, shapes, chart, np.full((6, 3), np.nan), None)
    points = np.random.default_rng(2).standard_normal((4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    for attitude, shape, widths in zip(attitudes, shapes, shown.half_widths, strict=True):
        center = Rotation.from_matrix(attitude)
        boundary = points @ np.linalg.cholesky(shape).T
        reach = np.abs((center * turns_of(boundary, chart) * center.inv()).as_rotvec()).max(axis=0)
        assert (reach <= widths * (1.0 + 1e-12)).all()
        # In the Gibbs chart a point that is far along the axis and farther across it has a shorter ζ.
        assert (reach >= widths * (0.98 if chart == "exponential" else {0.01: 0.98, 0.5: 0.9, 2.5: 0.5}[size])).all()


@pytest.mark.parametrize("chart", ["exponential", "gibbs"])
def test_as_the_core(chart):
    attitudes, shapes = made(20, 1.3, seed=4)
    widths = half_widths_along(attitudes, shapes, chart)
    for attitude, shape, width in zip(attitudes, shapes, widths, strict=True):
        whole = np.eye(6)
        whole[:3, :3] = shape
        extent = elliptude.StateEllipsoid(attitude, np.zeros(3), whole, chart=chart).extent()
        np.testing.assert_allclose(width, extent.half_widths_reference, rtol=1e-12)


def test_errors_are_turns_in_reference_axes():
    """C = Ĉ exp(S(ζ)) is exp(S(η)) Ĉ with the η that is returned."""
    attitudes, shapes = made(10, 1.0)
    errors = np.random.default_rng(3).standard_normal((10, 3))
    errors[4] = np.nan
    shown = about_axes("reference", attitudes, shapes, "exponential", np.zeros((10, 3)), errors)
    known = np.arange(10) != 4
    np.testing.assert_allclose(
        elliptude.exp(shown.errors[known]) @ attitudes[known],
        attitudes[known] @ elliptude.exp(errors[known]),
        atol=1e-12,
    )
    assert np.isnan(shown.errors[4]).all()
    own = about_axes("body", attitudes, shapes, "exponential", np.zeros((10, 3)), errors)
    assert own.errors is errors
    assert own.names == ("x", "y", "z")


@pytest.mark.parametrize(
    ("frame", "from_start", "names", "phrase"),
    [
        ("ENU", False, ("east", "north", "up"), "about east, north and up"),
        ("NED", False, ("north", "east", "down"), "about north, east and down"),
        ("NWU", True, ("X", "Y", "up"), "about X, Y and up"),
        ("J2000", False, ("X", "Y", "Z"), "about the reference axes"),
        (None, True, ("X", "Y", "Z"), "about the reference axes"),
    ],
)
def test_axes_have_names_where_they_are_known(frame, from_start, names, phrase):
    nothing = np.full((1, 3, 3), np.nan)
    shown = about_axes(
        "reference", nothing, nothing, "gibbs", nothing[0], None, frame=frame, heading_from_start=from_start
    )
    assert (shown.names, shown.phrase, shown.errors) == (names, phrase, None)
    assert np.isnan(shown.half_widths).all()
