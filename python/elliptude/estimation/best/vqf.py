"""VQF's attitudes from a log's gyro, accelerometer and magnetometer, in the frame of the sets; theory, section 18.10.

D. Laidig, T. Seel: VQF, Information Fusion 91, 2023; the extra ``best``.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer, Magnetometer
from elliptude.estimation.guaranteed_run import GuaranteedRun
from elliptude.typing import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

# VQF begins anew after a gap of the gyro of more than this many of its median steps; within one, rates are
# interpolated.
_LONGEST_STEP = 10.0
# Tesla; VQF takes any unit, and is used with this one.
_MICROTESLA = 1e-6
# rad/s; VQF takes a gyro's bias for 0.5°/s at first, one standard deviation, and never more than 2°/s.
_OWN_BIAS = np.deg2rad(1.0)
# A reference field whose horizontal part is less than this share says nothing about north.
_LEAST_HORIZONTAL = 1e-6


def is_for_vqf(configuration: Configuration) -> bool:
    """Whether all that is measured is what VQF takes: gyro, accelerometer and, perhaps, magnetometer."""
    return _why_not_for_vqf(configuration) is None


def _why_not_for_vqf(configuration: Configuration) -> str | None:
    others = [one.name for one in configuration.directions if not isinstance(one, Accelerometer | Magnetometer)]
    if not isinstance(configuration.flow, GyroFlow) or configuration.accelerometer is None:
        return "vqf needs a gyro and an accelerometer"
    return f"vqf would leave out {others[0]!r}" if others else None


def why_not_vqf(configuration: Configuration) -> str | None:
    """What is missing for VQF; None if nothing is."""
    if (why := _why_not_for_vqf(configuration)) is not None:
        return why
    try:
        importlib.import_module("vqf")
    except ImportError:
        return "vqf is not installed: pip install 'elliptude[best]'"
    return None


def vqf_attitudes(run: GuaranteedRun, configuration: Configuration) -> FloatArray:
    """What VQF makes of the log as the run sees it, row by row from the rows before alone.

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration
        With a gyro and an accelerometer.

    Returns
    -------
    (N, 4) array
        (qw, qx, qy, qz) from body to reference axes; NaN before the first row with all sensors, after gaps of the
        gyro likewise, where there is no rate, and where the heading counts from nothing known.
    """
    log, rows = run.log, run.rows
    assert log.rates is not None
    assert rows.up is not None
    assert rows.up_column is not None
    rates, forces = log.rates - _known_bias(run, configuration), _sensor(run, configuration, Accelerometer)
    frames = _frames_of_field(run, configuration)
    fields = None if frames is None else _fields(run, configuration)
    quaternions = np.full((len(log.times), 4), np.nan)
    known = np.flatnonzero(np.isfinite(rates).all(axis=1))
    if len(known) < 2:
        return quaternions
    steps = np.diff(log.times[known])
    step = float(np.median(steps))
    for piece in np.split(known, np.flatnonzero(steps > _LONGEST_STEP * step) + 1):
        all_there = np.isfinite(forces[piece]).all(axis=1)
        if fields is not None:
            all_there &= np.isfinite(fields[piece]).all(axis=1)
        piece = piece[int(np.argmax(all_there)) :] if all_there.any() else piece[:0]
        if not len(piece):
            continue
        in_earth = _filtered(
            log.times[piece], step, rates[piece], forces[piece], None if fields is None else fields[piece]
        )
        usable = np.isfinite(in_earth).all(axis=1) & (np.linalg.norm(in_earth, axis=1) > 0.5)
        piece, earth = piece[usable], scipy.spatial.transform.Rotation.from_quat(in_earth[usable], scalar_first=True)
        if not len(piece):
            continue
        if frames is not None:
            # Mostly one frame, of a reference that stays.
            of_rows = frames[:1] if (frames == frames[0]).all() else frames[piece]
            attitudes = scipy.spatial.transform.Rotation.from_matrix(of_rows) * earth
        else:
            found = _with_heading_of_center(earth, piece, run)
            if found is None:
                continue
            attitudes = found
        quaternions[piece] = attitudes.as_quat(scalar_first=True)
    return quaternions


def _known_bias(run: GuaranteedRun, configuration: Configuration) -> FloatArray:
    """What is subtracted from the rates: a stated bias, or one that a rule found and VQF does not expect."""
    bias = run.rows.bias
    if configuration.rule is not None and float(np.linalg.norm(bias)) <= _OWN_BIAS:
        return np.zeros(3)
    return bias


def _sensor(run: GuaranteedRun, configuration: Configuration, kind: type[Accelerometer | Magnetometer]) -> FloatArray:
    """The vectors of the first sensor of a kind, in the log's unit, shape (N, 3)."""
    column = next(i for i, one in enumerate(configuration.directions) if isinstance(one, kind))
    return run.log.directions[:, column]


def _fields(run: GuaranteedRun, configuration: Configuration) -> FloatArray:
    """The magnetometer's samples, µT, shape (N, 3); NaN where its bounds allow any direction, as in a car's steel."""
    fields = _sensor(run, configuration, Magnetometer) / _MICROTESLA
    says_nothing = run.rows.angles[:, _field_column(run, configuration)] >= np.pi
    return np.where(says_nothing[:, None], np.nan, fields)


def _field_column(run: GuaranteedRun, configuration: Configuration) -> int | None:
    """Where the first magnetometer is in the run's rows; None if it is not."""
    names = [one.name for one in configuration.directions if isinstance(one, Magnetometer)]
    return run.rows.names.index(names[0]) if names and names[0] in run.rows.names else None


def _frames_of_field(run: GuaranteedRun, configuration: Configuration) -> FloatArray | None:
    """What takes axes east, magnetic north, up to reference axes, (N, 3, 3); None if no field determines the heading.

    The field's reference says where magnetic north is, and with it the declination.
    """
    rows = run.rows
    assert rows.up is not None
    column = _field_column(run, configuration)
    if column is None or not (rows.angles[:, column] < np.pi).any():
        return None
    field = rows.references[:, column]
    north = field - np.outer(field @ rows.up, rows.up)
    lengths = np.linalg.norm(north, axis=1)
    if not (lengths > _LEAST_HORIZONTAL * np.linalg.norm(field, axis=1)).all():
        return None
    north = north / lengths[:, None]
    return np.stack([np.cross(north, rows.up), north, np.broadcast_to(rows.up, north.shape)], axis=2)


def _filtered(
    times: FloatArray, step: float, rates: FloatArray, forces: FloatArray, fields: FloatArray | None
) -> FloatArray:
    """VQF's quaternions at samples of a gyro, NaN where it has none, shape (n, 4).

    It takes regular samples. A step of another length turns by as much as its rate does in that time; where samples
    are missing, rates are interpolated. It leaves out accelerations and fields that are zero.
    """
    from vqf import VQF

    spans = np.diff(times, prepend=times[0] - step)
    parts = np.maximum(np.round(spans / step), 1.0).astype(np.intp)
    ends = np.cumsum(parts) - 1
    # Where in time each sample is, in samples of the log.
    rows = np.arange(len(times))
    at = np.interp(np.arange(ends[-1] + 1), ends, rows)
    samples = np.column_stack([np.interp(at, rows, column) for column in rates.T])
    samples *= np.repeat(spans / (parts * step), parts)[:, None]

    def placed(values: FloatArray) -> FloatArray:
        whole = np.zeros((len(samples), 3))
        there = np.isfinite(values).all(axis=1)
        whole[ends[there]] = values[there]
        return whole

    def period(values: FloatArray) -> float:
        there = times[np.isfinite(values).all(axis=1)]
        return float(np.median(np.diff(there))) if len(there) > 1 else step

    # What is not given is the gyro's.
    settings: dict[str, Any] = {"accTs": period(forces)}
    arguments = [samples, placed(forces)]
    if fields is not None:
        settings["magTs"] = period(fields)
        arguments.append(placed(fields))
    found = VQF(step, **settings).updateBatch(*(np.ascontiguousarray(values) for values in arguments))
    quaternions: FloatArray = found["quat6D" if fields is None else "quat9D"][ends]
    return quaternions


def _with_heading_of_center(earth: Rotation, piece: NDArray[np.intp], run: GuaranteedRun) -> Rotation | None:
    """Attitudes whose own heading counts from nothing, turned so that the first center differs by a tilt alone.

    None if there is no center, so that nothing says how the heading counts.
    """
    up = run.rows.up
    assert up is not None
    there = np.flatnonzero(np.isfinite(run.sets.attitudes[piece, 0, 0]))
    if not len(there):
        return None
    # Any frame whose third axis is up, then the turn about up that is missing.
    level = scipy.spatial.transform.Rotation.align_vectors(up[None], [[0.0, 0.0, 1.0]])[0] * earth
    center = scipy.spatial.transform.Rotation.from_matrix(run.sets.attitudes[piece[there[0]]])
    x, y, z, w = (center * level[int(there[0])].inv()).as_quat()
    return scipy.spatial.transform.Rotation.from_rotvec(2.0 * np.arctan2(np.array([x, y, z]) @ up, w) * up) * level
