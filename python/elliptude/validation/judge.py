"""Judges whether the truth is in a set: by NumPy, in the set's own chart, with as many digits as needed."""

from decimal import Decimal, localcontext
from typing import Any, Literal, TypeAlias

import numpy as np

from elliptude.typing import FloatArray

Mode: TypeAlias = Literal["guaranteed", "first_order", "paper"]
FORM_EDGES = np.concatenate([[0.0], np.geomspace(1e-3, 1e2, 51), [np.inf]])
"""Edges of the histogram of forms."""
# More digits are used if the truth is this near to the edge, or if P, scaled, is this near to singular.
_NEAR_EDGE = 1e-2
_NEARLY_SINGULAR = 1e-9
_EXACT_DIGITS = 50


def forms_of(
    mode: Mode,
    attitudes: FloatArray,
    vectors: FloatArray,
    shapes: FloatArray,
    true_attitudes: FloatArray,
    true_vectors: FloatArray,
    *,
    part: slice = slice(None),
) -> FloatArray:
    """xᵀP⁻¹x of the truth, in the chart of the set: Gibbs for ``guaranteed``, exponential otherwise.

    Parameters
    ----------
    mode : Mode
    attitudes, vectors : (..., 3, 3), (..., 3) array
        The centers.
    shapes : (..., 6, 6) array
    true_attitudes, true_vectors : (..., 3, 3), (..., 3) array
    part : slice
        Which of the six numbers are asked about: of fewer, the projection of the set on them is judged.

    Returns
    -------
    (...) array
        At most 1 inside; infinite if P is not positive definite or the error is a half turn, NaN if there is no
        set.
    """
    arguments = (attitudes, vectors, true_attitudes, true_vectors)
    states, shapes = errors_of(mode, *arguments)[..., part], shapes[..., part, part]
    values = np.full(states.shape[:-1], np.nan)
    known = np.isfinite(shapes).all(axis=(-1, -2))
    scales, eigenvalues, axes = _scaled_eigenvalues(shapes[known])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        along = np.einsum("nij,ni->nj", axes, states[known] / scales)
        of_known = np.sum(along**2 / eigenvalues, axis=-1)
    values[known] = np.where(np.all(eigenvalues > 0.0, axis=-1) & np.isfinite(of_known), of_known, np.inf)
    # Thin sets cost digits: where that may matter, more of them are used.
    singular = np.zeros(values.shape, bool)
    singular[known] = eigenvalues[:, 0] < _NEARLY_SINGULAR
    for chosen, precisely in ((np.abs(values - 1.0) < _NEAR_EDGE, _precise_forms), (singular, _exact_forms)):
        if chosen.any():
            precise = errors_of(mode, *(array[chosen].astype(np.longdouble) for array in arguments))[..., part]
            values[chosen] = precisely(shapes[chosen].astype(np.longdouble), precise)
    return values


def exact_root(shape: FloatArray) -> list[list[Decimal]] | None:
    """L of P = L Lᵀ, lower triangular, to 50 digits; None if P, as given, is not positive definite.

    Parameters
    ----------
    shape : (n, n) array

    Returns
    -------
    list of lists, or None
    """
    with localcontext() as context:
        context.prec = _EXACT_DIGITS
        p = [[Decimal(x) for x in row] for row in shape.tolist()]
        root = [[Decimal(0)] * len(p) for _ in p]
        for i in range(len(p)):
            for j in range(i):
                root[i][j] = (p[i][j] - sum((root[i][k] * root[j][k] for k in range(j)), Decimal(0))) / root[j][j]
            pivot = p[i][i] - sum((x * x for x in root[i][:i]), Decimal(0))
            if not pivot > 0:
                return None
            root[i][i] = pivot.sqrt()
    return root


def _exact_forms(shapes: Any, states: Any) -> Any:
    """`_precise_forms` in 50 digits."""
    values = np.full(len(shapes), np.inf)
    for n, (shape, state) in enumerate(zip(shapes, states, strict=True)):
        root = exact_root(shape.astype(np.float64))
        if root is None or not np.isfinite(state).all():
            continue
        with localcontext() as context:
            context.prec = _EXACT_DIGITS
            white: list[Decimal] = []
            for i, row in enumerate(root):
                upper = float(state[i])
                x = Decimal(upper) + Decimal(float(state[i] - upper))
                white.append((x - sum((row[k] * white[k] for k in range(i)), Decimal(0))) / row[i])
            values[n] = float(sum((x * x for x in white), Decimal(0)))
    return values


def errors_of(mode: Mode, attitudes: Any, vectors: Any, true_attitudes: Any, true_vectors: Any) -> Any:
    """Errors (..., 6) in the chart of the mode, in the precision of the arguments."""
    error = attitudes.swapaxes(-1, -2) @ true_attitudes
    skew = error - error.swapaxes(-1, -2)
    # tan(θ/2) n = (R − Rᵀ)^∨ / (1 + tr R)
    with np.errstate(divide="ignore", invalid="ignore"):
        tangent = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1) / (
            1 + np.trace(error, axis1=-2, axis2=-1)[..., None]
        )
        length = np.sqrt(np.sum(tangent**2, axis=-1, keepdims=True))
        ratio = np.ones_like(length)
        if mode != "guaranteed":
            np.divide(np.arctan(length), length, out=ratio, where=length > 0)
    return np.concatenate([2 * ratio * tangent, true_vectors - vectors], axis=-1)


def _precise_forms(shapes: Any, states: Any) -> Any:
    """xᵀP⁻¹x of (n, k, k) and (n, k) by Cholesky's method, in the precision of the arguments."""
    root, white = np.zeros_like(shapes), np.zeros_like(states)
    with np.errstate(invalid="ignore"):
        for i in range(states.shape[-1]):
            for j in range(i):
                rest = shapes[:, i, j] - np.sum(root[:, i, :j] * root[:, j, :j], axis=1)
                root[:, i, j] = rest / root[:, j, j]
            root[:, i, i] = np.sqrt(shapes[:, i, i] - np.sum(root[:, i, :i] ** 2, axis=1))
            white[:, i] = (states[:, i] - np.sum(root[:, i, :i] * white[:, :i], axis=1)) / root[:, i, i]
        result = np.sum(white**2, axis=1)
    return np.where(np.isfinite(result), result, np.inf)


def sizes(mode: Mode, shapes: FloatArray) -> FloatArray:
    """Trace, radius of the ball of the same volume, and largest angle (rad) of sets; NaN where there is none.

    Parameters
    ----------
    mode : Mode
    shapes : (..., 6, 6) array

    Returns
    -------
    (..., 3) array
    """
    result = np.full((*shapes.shape[:-2], 3), np.nan)
    known = np.isfinite(shapes).all(axis=(-1, -2))
    some = shapes[known]
    scales, eigenvalues, _ = _scaled_eigenvalues(some)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.exp((np.log(eigenvalues).sum(axis=-1) + 2.0 * np.log(scales).sum(axis=-1)) / 12.0)
        extent = np.sqrt(np.linalg.eigvalsh(some[:, :3, :3])[:, -1])
    angle = 2.0 * np.arctan(0.5 * extent) if mode == "guaranteed" else extent
    result[known] = np.column_stack([np.trace(some, axis1=-2, axis2=-1), radius, angle])
    return result


def _scaled_eigenvalues(shapes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Half-widths d (n, 6), then eigenvalues and eigenvectors of P with rows and columns divided by them."""
    scales = np.sqrt(np.abs(np.diagonal(shapes, axis1=-2, axis2=-1)))
    scales = np.where(scales > 0.0, scales, 1.0)
    eigenvalues, axes = np.linalg.eigh(shapes / (scales[:, :, None] * scales[:, None, :]))
    return scales, eigenvalues, axes
