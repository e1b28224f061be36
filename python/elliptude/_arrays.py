"""Arrays of others: NumPy's masked ones, and SciPy's ``Rotation``, which every attitude argument takes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from elliptude import _core

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from elliptude.typing import AttitudeLike


def unmasked(values: Any) -> Any:
    """The same without a mask: NaN where a number is masked, as the core takes it.

    NumPy's own conversion drops a mask and keeps the numbers below it.

    Parameters
    ----------
    values : Any
        What a function was given.

    Returns
    -------
    Any
        Anything but masked arrays as it is.

    Raises
    ------
    TypeError
        If what is masked has no NaN, as a truth value.
    """
    if not isinstance(values, np.ma.MaskedArray):
        return values
    if not np.ma.getmaskarray(values).any():
        return values.data
    if values.dtype.kind not in "iuf":
        raise TypeError(f"a masked array of {values.dtype}: something is masked, and has no NaN in its place")
    return np.ma.filled(values.astype(np.float64), np.nan)


def to_scipy(attitude: AttitudeLike) -> Rotation:
    """One attitude or many as a SciPy ``Rotation``.

    Parameters
    ----------
    attitude : array_like, shape (3, 3) or (N, 3, 3)

    Returns
    -------
    scipy.spatial.transform.Rotation

    Raises
    ------
    ValueError
        If a matrix is not a rotation.
    ModuleNotFoundError
        If SciPy is not installed.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(_core.quaternion_from_rotation(attitude)[..., [1, 2, 3, 0]])
