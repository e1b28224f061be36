"""Which body axis was up at rest, and where the field pointed: in words, as no turn shows the sign of a vector."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elliptude import units
from elliptude.bounds.gyro import usual_longest, with_rounding
from elliptude.bounds.rest import rest_rows
from elliptude.configuration import rules
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.sensors import Magnetometer
from elliptude.logs.log import Log
from elliptude.typing import FloatArray

_MICROTESLA = units.FIELD["uT"]
# degrees; a direction nearer than this to a body axis is called that axis.
_NEAR_AN_AXIS = 30.0


@dataclass(frozen=True)
class UpAtRest:
    """What accelerometer and magnetometer show in the first rest of a recording that lasts."""

    begin_s: float
    end_s: float
    up: tuple[float, float, float]
    """Unit vector in body axes."""
    dip_deg: float | None
    """How far the field points below the horizontal; None without a magnetometer."""

    def __str__(self) -> str:
        """A sentence for a reader who knows how the body lay."""
        up = axis_in_words(np.array(self.up))
        # Stamps may count from 1970, and still say which seconds are meant.
        begin, end = (f"{round(time, 3):.13g}" for time in (self.begin_s, self.end_s))
        words = f"at rest ({begin} to {end} s) the body's {up} is up"
        if self.dip_deg is not None:
            side = ("below", "north") if self.dip_deg >= 0.0 else ("above", "south")
            words += (
                f"; the field points {abs(self.dip_deg):.0f} degrees {side[0]} the horizontal, as {side[1]} of the "
                "magnetic equator"
            )
        return words + ". No log can tell if that is turned upside down: compare it with how the body lay"


def axis_in_words(direction: FloatArray) -> str:
    """A direction (3,) as the nearest body axis, "+z" or "-x (12 degrees off)", or as a vector."""
    unit = direction / np.linalg.norm(direction)
    i = int(np.argmax(np.abs(unit)))
    across = float(np.linalg.norm(np.delete(unit, i)))
    off = float(np.rad2deg(np.arctan2(across, abs(unit[i]))))
    if off > _NEAR_AN_AXIS:
        return f"({', '.join(f'{value:.2f}' for value in unit)})"
    name = f"{'-' if unit[i] < 0.0 else '+'}{'xyz'[i]}"
    if off < 0.5:
        return name
    return f"{name} ({off:.0f} {'degree' if off < 1.5 else 'degrees'} off)"


def usual_limits() -> dict[str, float]:
    """What counts as a rest by the rule for a sensor in the hand, as `rest_rows` has it."""
    return rules.hand_held().rest.limits()


def resting(
    times: FloatArray, rates: FloatArray | None, forces: FloatArray, limits: dict[str, float] | None = None
) -> NDArray[np.bool_]:
    """Rows at rest, shape (N,), by the limits of `rest_rows`, or the usual ones; not those without a specific force."""
    result = np.zeros(len(times), dtype=np.bool_)
    there = np.isfinite(forces).all(axis=1)
    if rates is not None:
        there &= np.isfinite(rates).all(axis=1)
    if there.sum() < 2:
        return result
    shown = np.zeros_like(forces[there]) if rates is None else rates[there]
    result[there] = rest_rows(times[there], shown, forces[there], **(usual_limits() if limits is None else limits))
    return result


def up_at_rest(
    times: FloatArray,
    rates: FloatArray | None,
    forces: FloatArray,
    fields: FloatArray | None,
    limits: dict[str, float] | None = None,
) -> UpAtRest | None:
    """What the first rest shows that lasts as long as a piece in which a rest is looked for; None without one.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    rates : (N, 3) array, optional
        rad/s.
    forces : (N, 3) array
        m/s², body axes, up at rest as it was stated; rows may be NaN.
    fields : (N, 3) array, optional
        Body axes, any unit; rows may be NaN.
    limits : dict, optional
        What counts as a rest, as `rest_rows` has it; the usual if left out.

    Returns
    -------
    UpAtRest, optional
    """
    limits = usual_limits() if limits is None else limits
    there = np.flatnonzero(np.isfinite(forces).all(axis=1))
    rows = _first_rest(times, there, resting(times, rates, forces, limits)[there], limits["duration"])
    if rows is None:
        return None
    force = forces[rows].mean(axis=0)
    length = float(np.linalg.norm(force))
    if length == 0.0:
        return None
    up, dip = force / length, None
    if fields is not None:
        # Rows of the same time: another sensor may have stamps of its own.
        field = fields[rows[0] : rows[-1] + 1]
        field = field[np.isfinite(field).all(axis=1)]
        if len(field) and field.any():
            mean = field.mean(axis=0)
            dip = float(np.rad2deg(np.arctan2(-(mean @ up), np.linalg.norm(np.cross(mean, up)))))
    return UpAtRest(float(times[rows[0]]), float(times[rows[-1]]), (float(up[0]), float(up[1]), float(up[2])), dip)


def _first_rest(
    times: FloatArray, rows: NDArray[np.intp], still: NDArray[np.bool_], duration: float
) -> NDArray[np.intp] | None:
    """The rows of the first rest that lasts; None without one.

    A few samples before a gap, or at the end, hold still next to each other in a car that drives. In a gap of half a
    piece nobody knows what the body did.
    """
    if len(rows) < 2:
        return None
    steps = np.diff(times[rows])
    usual = float(np.median(steps))
    apart = np.append(steps > with_rounding(max(0.5 * duration, usual_longest(steps)), times), True)
    begin = still & np.append(True, ~still[:-1] | apart[:-1])
    end = still & np.append(~still[1:] | apart[:-1], True)
    for first, last in zip(np.flatnonzero(begin), np.flatnonzero(end), strict=True):
        # Pieces end between samples: the first and the last one are up to a step inside.
        if times[rows[last]] - times[rows[first]] + 2.0 * usual >= duration:
            return rows[first : last + 1]
    return None


def up_in_log(log: Log, configuration: Configuration) -> UpAtRest | None:
    """`up_at_rest` of a log with an accelerometer; times are the file's."""
    accelerometer = configuration.accelerometer
    if accelerometer is None:
        return None
    fields = None
    for i, sensor in enumerate(configuration.directions):
        if isinstance(sensor, Magnetometer):
            fields = log.directions[:, i]
            break
    # A rule for a noisier sensor says what counts as its rest.
    limits = None if configuration.rule is None else configuration.rule.rule().rest.limits()
    forces = log.directions[:, configuration.directions.index(accelerometer)]
    return up_at_rest(log.times + log.origin, log.rates, forces, fields, limits)
