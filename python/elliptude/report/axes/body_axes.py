"""Where the body's axes may point: the image on the unit sphere of a set of attitudes.

A body axis e points along C e = Ĉ R(x) e in reference axes, where x runs through the ellipsoid xᵀP⁻¹x ≤ 1 of attitude
errors on the body side; R(x) = exp(S(x)) in the exponential chart, and in the Gibbs chart x = 2 tan(θ/2) n of the turn
by θ about n. Attitudes that differ by a turn about e itself share a direction: they form a curve in the ellipsoid, and
the directions at the rim of the image are those whose curve only touches the ellipsoid. There the curve's tangent k(x)
lies in the ellipsoid's tangent plane:

    xᵀ P⁻¹ k(x) = 0,    k(x) = e + x × e / 2 + c x × (x × e),   c = (1 - θ/2 cot θ/2) / θ²   (exponential, θ = ‖x‖),
                        k(x) = e + x × e / 2 + (x · e) x / 4                                 (Gibbs).

The first is the inverse right Jacobian of exp, times e; the second the derivative of a product of Gibbs vectors. With
x = L u, P = L Lᵀ and u on the unit sphere, to first order the rim is the great circle perpendicular to L⁻¹e. The exact
one is found on each meridian about that pole by bisection.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from elliptude.typing import Chart, FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

_BISECTIONS = 40
# Relative to the longest semi-axis: shorter ones are drawn as if they were this long.
_FLATTEST = 1e-6


def turns(errors: FloatArray, chart: Chart) -> Rotation:
    """The turns R(x) of errors (M, 3) in a chart."""
    if chart == "exponential":
        return scipy.spatial.transform.Rotation.from_rotvec(errors)
    # tan(θ/2) n, with 1 the unnormalised quaternion of the turn.
    return scipy.spatial.transform.Rotation.from_quat(
        np.column_stack([np.ones(len(errors)), 0.5 * errors]), scalar_first=True
    )


def axis_patches(
    attitudes: FloatArray,
    shapes: FloatArray,
    axis: int,
    *,
    chart: Chart = "exponential",
    meridians: int = 48,
    rings: int,
) -> FloatArray:
    """Directions that cover the image of each set, in rings from its rim to its middle.

    Parameters
    ----------
    attitudes : (N, 3, 3) array
        Centers Ĉ of the sets, from body to reference axes.
    shapes : (N, 3, 3) array
        P of the attitude error, rad².
    axis : {0, 1, 2}
        Which body axis.
    chart : {"exponential", "gibbs"}
        What the error's coordinates are.
    meridians : int
        Directions on each ring.
    rings : int
        1 for the rim alone.

    Returns
    -------
    (N, rings, meridians, 3) array
        Unit vectors in reference axes, the rim first. NaN if the set is not known, or so large that the image has no
        rim that every meridian meets, as where attitude errors reach half a turn in the exponential chart.
    """
    patches = np.full((len(attitudes), rings, meridians, 3), np.nan)
    known = np.flatnonzero(np.isfinite(attitudes).all(axis=(1, 2)) & np.isfinite(shapes).all(axis=(1, 2)))
    if len(known) == 0:
        return patches
    e = np.eye(3)[axis]
    variances, vectors = np.linalg.eigh(shapes[known])
    lengths = np.sqrt(np.maximum(variances, 0.0))
    lengths = np.maximum(lengths, np.maximum(_FLATTEST * lengths[:, -1:], 1e-12))
    root = (vectors * lengths[:, None, :]) @ vectors.swapaxes(1, 2)  # L
    inverse = (vectors / lengths[:, None, :]) @ vectors.swapaxes(1, 2)
    pole = inverse[:, :, axis] / np.linalg.norm(inverse[:, :, axis], axis=1, keepdims=True)
    first, second = perpendicular(pole)
    angles = np.linspace(0.0, 2.0 * np.pi, meridians, endpoint=False)
    across = first[:, None] * np.cos(angles)[:, None] + second[:, None] * np.sin(angles)[:, None]  # (K, meridians, 3)

    def errors(latitudes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points u of the unit sphere, and x = L u, (K, meridians, 3)."""
        u = np.cos(latitudes)[..., None] * across + np.sin(latitudes)[..., None] * pole[:, None]
        return u, u @ root  # L is symmetric

    def slope(latitudes: FloatArray) -> FloatArray:
        """xᵀ P⁻¹ k(x) = (L⁻¹ u) · k(x)."""
        u, x = errors(latitudes)
        return np.asarray(((u @ inverse) * _fibre_tangent(x, e, chart)).sum(axis=-1))

    low = np.full((len(known), meridians), -0.5 * np.pi)
    high = -low
    has_rim = ((slope(low) < 0.0) & (slope(high) > 0.0)).all(axis=1)
    if chart == "exponential":  # beyond half a turn the coordinates count attitudes twice
        has_rim &= lengths[:, -1] < np.pi
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        is_above = slope(middle) > 0.0
        low, high = np.where(is_above, low, middle), np.where(is_above, middle, high)
    rim = 0.5 * (low + high)
    for ring in range(rings):
        # Beyond the rim each direction is met once more, on the way out of the ellipsoid: this half covers the image.
        latitudes = rim + (0.5 * np.pi - rim) * (ring / max(rings - 1, 1))
        x = errors(latitudes)[1]
        directions = turns(x.reshape(-1, 3), chart).apply(e).reshape(x.shape)
        patches[known, ring] = directions @ attitudes[known].swapaxes(1, 2)
    patches[known[~has_rim]] = np.nan
    return patches


def axis_outlines(
    attitudes: FloatArray, shapes: FloatArray, axis: int, *, chart: Chart = "exponential", points: int = 96
) -> FloatArray:
    """The rim of the image of each set, as `axis_patches`, shape (N, points, 3)."""
    return axis_patches(attitudes, shapes, axis, chart=chart, meridians=points, rings=1)[:, 0]


def _fibre_tangent(x: FloatArray, e: FloatArray, chart: Chart) -> FloatArray:
    """k(x), shape (..., 3): how x changes when the attitude is turned about e."""
    turned = np.cross(x, e)
    if chart == "gibbs":
        return np.asarray(e + 0.5 * turned + 0.25 * (x @ e)[..., None] * x)
    squared = (x * x).sum(axis=-1, keepdims=True)
    half = 0.5 * np.sqrt(squared)
    with np.errstate(invalid="ignore", divide="ignore"):
        closed = (1.0 - half / np.tan(half)) / squared
    # The series where the closed form loses digits.
    factor = np.where(squared > 1e-4, closed, 1.0 / 12.0 + squared / 720.0)
    return np.asarray(e + 0.5 * turned + factor * np.cross(x, turned))


def perpendicular(unit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that complete each of (K, 3) to a right-handed frame."""
    least = np.eye(3)[np.argmin(np.abs(unit), axis=1)]
    first = np.cross(unit, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(unit, first)
