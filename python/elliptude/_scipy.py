"""Turns attitudes into SciPy's ``Rotation``. The other way needs nothing: every attitude argument takes one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elliptude._core import quaternion_from_rotation

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from elliptude.typing import AttitudeLike


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

    return Rotation.from_quat(quaternion_from_rotation(attitude)[..., [1, 2, 3, 0]])
