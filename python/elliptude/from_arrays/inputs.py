"""Checks of the arrays that a user gives: NumPy's, lists, and columns of pandas or Polars. Messages name the place."""

from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude._arrays import unmasked
from elliptude.logs.alignment.batches import LARGEST_TIME_S, SHORTEST_VECTOR, without_direction
from elliptude.typing import FloatArray
from elliptude.units import SELDOM_S

# In the unit that is stated; no sensor shows more.
_LARGEST = 1e9


def times_of(time: Any) -> FloatArray:
    """Times in s, shape (N,); time stamps of dates are counted from the first one.

    Raises
    ------
    TypeError, ValueError
        If they are no times that increase; the message has the first place.
    """
    found = _dates(_array("time", time))
    if found.ndim != 1 or len(found) < 3:
        raise ValueError(f"time: shape {found.shape}, not (N,) with N at least 3")
    if found.dtype.kind in "mM":
        _refuse(np.asarray(np.isnat(found)), "time", found, "not a time")
        found = (found - found[0]) / np.timedelta64(1, "ns") * 1e-9
    times = _numbers("time", found)
    _refuse(~np.isfinite(times), "time", times, "not finite")
    back = np.diff(times, prepend=-np.inf) <= 0.0
    if back.any():
        k = int(np.argmax(back))
        before = f"time[{k - 1}], {float(times[k - 1])!r}"
        raise ValueError(f"time[{k}] is {float(times[k])!r}, not after {before}: times must increase")
    far = np.abs(times - (times[0] if abs(times[0]) <= LARGEST_TIME_S else 0.0)) > LARGEST_TIME_S
    if far.any():
        k = int(np.argmax(far))
        raise ValueError(unit_of_time(times) or f"time[{k}]: the time {times[k]:.6g} s: is its unit right?")
    return times


def unit_of_time(times: FloatArray) -> str:
    """The question whether times are in a smaller unit than seconds, if their steps are so long; else empty."""
    step = float(np.median(np.diff(times)))
    if step < SELDOM_S:
        return ""
    unit = "milliseconds" if step < 1e3 else "microseconds" if step < 1e6 else "nanoseconds"
    return f"time is in s, and its steps are {step:g} s (median): are they {unit}?"


def vectors_of(name: str, values: Any, unit: str, count: int, *, may_be_missing: bool) -> FloatArray:
    """A sensor's vectors, shape (N, 3); a row of NaN was not measured.

    Raises
    ------
    TypeError, ValueError
        If they are no such vectors; the message has the first place.
    """
    vectors = _numbers(name, _array(name, values))
    if vectors.shape != (count, 3):
        raise ValueError(f"{name}: shape {vectors.shape}, not ({count}, 3): a row for each time, and columns x, y, z")
    _refuse(np.abs(vectors) > _LARGEST, name, vectors, f"more than {_LARGEST:g} {unit} in size")
    missing: NDArray[np.bool_] = np.isnan(vectors)
    if not may_be_missing:
        _refuse(missing, name, vectors, "but the gyro is needed in every row: leave such rows out of all arrays")
    rows = np.asarray(missing.all(axis=1, keepdims=True))
    _refuse(missing & ~rows, name, vectors, "but other components of that row are numbers")
    if may_be_missing:
        _refuse((vectors == 0.0).all(axis=1), name, vectors, "without a direction: NaN is what was not measured")
        small = f"below {SHORTEST_VECTOR:g} {unit} in size: without a direction"
        _refuse(without_direction(vectors), name, vectors, small)
    if missing.all():
        raise ValueError(f"{name}: no row has numbers")
    return vectors


def _array(name: str, values: Any) -> NDArray[Any]:
    if isinstance(values, dict | str | bytes) or values is None:
        raise TypeError(f"{name}: {type(values).__name__}, not an array of numbers")
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "mM":
        values = np.where(np.ma.getmaskarray(values), np.array("NaT", values.dtype), values.data)
    values = unmasked(values)
    to_numpy = getattr(values, "to_numpy", None)
    if to_numpy is not None and getattr(getattr(values, "dtype", None), "tz", None) is not None:
        return np.asarray(to_numpy(dtype="datetime64[ns]"))  # pandas, with a time zone: as UTC
    try:
        return np.asarray(values if to_numpy is None else to_numpy())
    except ValueError as error:  # rows of different lengths
        raise TypeError(f"{name}: not an array of numbers: {error}") from error


def _dates(found: NDArray[Any]) -> NDArray[Any]:
    """Python's dates with a time, in UTC, as NumPy's; what is none as it is."""
    if found.dtype != object or found.ndim != 1 or not all(isinstance(one, datetime) for one in found):
        return found
    utc = [one if one.tzinfo is None else one.astimezone(UTC).replace(tzinfo=None) for one in found]
    return np.array(utc, dtype="datetime64[ns]")


def _numbers(name: str, found: NDArray[Any]) -> FloatArray:
    if found.dtype == object:
        numbers = np.empty(found.size)
        for i, one in enumerate(found.ravel()):
            try:
                numbers[i] = np.nan if one is None else float(one)
            except (TypeError, ValueError) as error:
                raise TypeError(f"{name}: an array with {one!r}, a {type(one).__name__}, not of numbers") from error
        return numbers.reshape(found.shape)
    if found.dtype.kind not in "iuf":
        raise TypeError(f"{name}: an array of {found.dtype}, not of numbers")
    return found.astype(np.float64)


def _refuse(bad: NDArray[np.bool_], name: str, values: NDArray[Any], fault: str) -> None:
    """Raise ValueError for the first place that is bad."""
    if bad.any():
        place = tuple(int(i) for i in np.argwhere(bad)[0])
        at = values[place]
        shown = f"{at:.6g}" if at.ndim == 0 and at.dtype.kind == "f" else str(at)
        raise ValueError(f"{name}[{', '.join(map(str, place))}] is {shown}, {fault}")
