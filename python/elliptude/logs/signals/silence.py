"""Finds a sensor that stops before the others do, or that shows the same numbers from some row on."""

from collections.abc import Sequence

import numpy as np

from elliptude.logs.log import Log, Samples

# In median steps: one that has not been heard of for so long has stopped, or is stuck.
_SILENT = 20.0
# s; as short as this anything may be.
_LEAST_S = 1.0
# How many times longer than any other run of equal numbers one must be: coarse digits and rests have several.
_LONGER = 10


def silent_sensors(samples: Sequence[Samples], log: Log) -> list[tuple[str, str]]:
    """Names of sensors that stop or get stuck, and where, in words.

    Parameters
    ----------
    samples : sequence of Samples
    log : Log
        What they were put into: it knows the rows of the file.

    Returns
    -------
    list of pairs of str
    """
    found = []
    last = max((float(one.times[-1]) for one in samples if len(one.times)), default=0.0)
    for one in samples:
        if len(one.times) < 3:
            continue
        long = max(_SILENT * float(np.median(np.diff(one.times))), _LEAST_S)
        if last - one.times[-1] > long:
            where = _place(log, float(one.times[-1]))
            found.append((one.name, f"stops after {where}; others go on for {last - one.times[-1]:.4g} s"))
        if one.name == "the control torque":  # nobody turns the wheel all the time
            continue
        if (run := _stuck(one, long)) is not None:
            begin, end = run
            goes_on = f"for {one.times[end] - one.times[begin]:.4g} s" if end < len(one.times) - 1 else "to its end"
            said = (
                f"shows the same from {_place(log, float(one.times[begin]))} on, {goes_on} ({end - begin + 1} samples)"
            )
            found.append((one.name, f"{said}: is it stuck?"))
    return found


def _stuck(one: Samples, long: float) -> tuple[int, int] | None:
    """The first and the last sample of the longest run of equal ones, if it is out of the ordinary and not at first."""
    begins = np.flatnonzero(np.append(True, (one.values[1:] != one.values[:-1]).any(axis=1)))
    lengths = np.diff(np.append(begins, len(one.values)))
    order = np.argsort(lengths, kind="stable")
    longest = int(order[-1])
    begin, end = int(begins[longest]), int(begins[longest] + lengths[longest] - 1)
    usual = int(lengths[order[-2]]) if len(order) > 1 else 0
    # From its first sample on it may be at rest, or off: that is not half-way.
    if longest == 0 or lengths[longest] < _LONGER * usual or one.times[end] - one.times[begin] < long:
        return None
    return begin, end


def _place(log: Log, time: float) -> str:
    return log.place(int(np.clip(np.searchsorted(log.times, time - 1e-9), 0, len(log.times) - 1)))
