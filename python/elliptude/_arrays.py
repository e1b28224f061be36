"""Arrays of others: NumPy's masked ones, and SciPy's ``Rotation``, which every attitude argument takes.

NumPy's own conversion of a masked array drops its mask and keeps the numbers below it. The core converts so, too. Here
every public function and method of it is wrapped: what is masked is NaN, which is what was not measured where a
function says so, and is refused elsewhere. So no mask is ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from elliptude import _core

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from elliptude.typing import AttitudeLike

# Lists of that many rows are looked through for masked arrays; longer ones are lists of numbers.
_MOST_LISTED = 1000


def unmasked(values: Any) -> Any:
    """The same, without masks: NaN where a number is masked.

    Parameters
    ----------
    values : Any
        What a function was given.

    Returns
    -------
    Any
        Anything but masked arrays, and lists with some, as it is.

    Raises
    ------
    TypeError
        If what is masked has no NaN, as a truth value.
    """
    if isinstance(values, np.ma.MaskedArray):
        if not np.ma.getmaskarray(values).any():
            return values.data
        if values.dtype.kind not in "iuf":
            raise TypeError(f"a masked array of {values.dtype}: something is masked, and has no NaN in its place")
        return np.ma.filled(values.astype(np.float64), np.nan)
    if type(values) in {list, tuple} and len(values) <= _MOST_LISTED:
        for one in values:
            if isinstance(one, np.ma.MaskedArray | list | tuple):
                return type(values)(unmasked(each) for each in values)
    return values


def _wrapped(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    @wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        for one in arguments:
            if isinstance(one, np.ma.MaskedArray | list | tuple):
                break
        else:
            for one in named.values():
                if isinstance(one, np.ma.MaskedArray | list | tuple):
                    break
            else:
                return function(*arguments, **named)
        return function(*map(unmasked, arguments), **{name: unmasked(one) for name, one in named.items()})

    call.__qualname__ = name  # by which it is pickled
    return call


def accept_masks(core: ModuleType) -> None:
    """Let the public functions and methods of a compiled module take masked arrays.

    Parameters
    ----------
    core : module
        Changed in its place, once.
    """
    for name, one in list(vars(core).items()):
        if name.startswith("_"):
            continue
        if isinstance(one, type):
            for method_name, method in list(vars(one).items()):
                if type(method).__name__ == "instancemethod" and (
                    not method_name.startswith("_") or method_name == "__init__"
                ):
                    setattr(one, method_name, _wrapped(method.__func__, f"{name}.{method_name}"))
        elif type(one).__name__ == "builtin_function_or_method":
            setattr(core, name, _wrapped(one, name))


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
