"""Where a configuration's reference directions come from: gravity, the Earth's field by model or by rest, the Sun.

Vectors are in the reference frame's axes: ENU east, north, up; NED north, east, down; NWU north, west, up; J2000 the
mean equator and equinox of that date. Where a world model or a declination is used, north is geographic north.
"""

from datetime import UTC, datetime

import numpy as np
import scipy

from elliptude.configuration import sun
from elliptude.configuration.sensors import ReferenceFrame
from elliptude.configuration.statements import RestPhase, SunByTime, WorldModel
from elliptude.io.files import FileError
from elliptude.typing import FloatArray

_UNIX_EPOCH_JD = 2_440_587.5
# Terrestrial time is ahead of UTC by 32.184 s and the leap seconds: 37 since 2017, 10 in 1972. In the 27 s that this
# may be wrong before 2017 the Sun moves 0.0003 degrees; the almanac formula is good to 0.01.
_TT_MINUS_UTC_S = 69.184

# WGS84, km.
_EQUATOR, _POLE = 6378.137, 6378.137 * (1.0 - 1.0 / 298.257223563)
# From a pole, at which ppigrf divides by zero: some tenth of a micrometre.
_NEXT_TO_POLE_DEG = 1e-12

# Rows are the axes of a frame in ENU.
_AXES: dict[ReferenceFrame, FloatArray] = {
    "ENU": np.eye(3),
    "NED": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NWU": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}


def from_enu(vector: FloatArray, frame: ReferenceFrame | None) -> FloatArray:
    """The components in a frame on the ground of a vector (..., 3) in ENU."""
    assert frame is not None
    assert frame in _AXES  # the configuration's check
    return np.asarray(vector @ _AXES[frame].T, dtype=np.float64)


def up(frame: ReferenceFrame | None) -> FloatArray:
    """The unit vector up, shape (3,)."""
    return from_enu(np.array([0.0, 0.0, 1.0]), frame)


def world_model_field(model: WorldModel, frame: ReferenceFrame | None) -> FloatArray:
    """The Earth's main field (3,) in T.

    Parameters
    ----------
    model : WorldModel
        Place and date; the height is above the WGS84 ellipsoid.
    frame : {"ENU", "NED", "NWU"}

    Returns
    -------
    (3,) array

    Raises
    ------
    FileError
        If ppigrf is not installed, or its coefficients are not of the date.
    """
    try:
        import ppigrf
        from ppigrf.ppigrf import read_shc, shc_fn
    except ModuleNotFoundError as error:
        raise FileError("a reference of kind 'world_model' needs ppigrf: pip install 'elliptude[igrf]'") from error
    date = model.date.astimezone(UTC).replace(tzinfo=None)
    # Beyond its coefficients ppigrf goes on with the last ones, and says so on the standard output alone.
    epochs = read_shc(shc_fn)[0].index
    if not epochs[0] <= date <= epochs[-1]:
        raise FileError(
            f"the world model has no field for {date:%Y-%m-%d}: its coefficients are of {epochs[0]:%Y-%m-%d} to "
            f"{epochs[-1]:%Y-%m-%d}. Newer ones come with a newer ppigrf; else state reference_ut"
        )
    # ppigrf's own way back from spherical coordinates to the ellipsoid is a series, good to some 1e-8 of the field.
    place, upward = _in_meridian(model)
    colatitude = np.rad2deg(np.arctan2(*place)).clip(_NEXT_TO_POLE_DEG, 180.0 - _NEXT_TO_POLE_DEG)
    radial, southward, eastward = (
        np.asarray(component).item()
        for component in ppigrf.igrf_gc(np.hypot(*place), colatitude, model.longitude_deg, date)
    )
    sine, cosine = np.sin(np.deg2rad(colatitude)), np.cos(np.deg2rad(colatitude))
    of_meridian = np.array([radial * sine + southward * cosine, radial * cosine - southward * sine])
    field = 1e-9 * np.array([eastward, of_meridian @ [-upward[1], upward[0]], of_meridian @ upward])
    if not np.isfinite(field).all():
        raise FileError(f"the world model has no field at {model.latitude_deg:g}, {model.longitude_deg:g} degrees")
    return from_enu(field, frame)


def _in_meridian(model: WorldModel) -> tuple[FloatArray, FloatArray]:
    """A place in km and the unit vector up, in the plane of its meridian: from the axis, and from the equator."""
    latitude, axes = np.deg2rad(model.latitude_deg), np.array([_EQUATOR, _POLE])
    upward = np.array([np.cos(latitude), np.sin(latitude)])
    below = axes**2 * upward / np.linalg.norm(axes * upward)
    return below + 1e-3 * model.height_m * upward, upward


def rest_field(
    phase: RestPhase, field: FloatArray, upward: FloatArray | None, frame: ReferenceFrame | None
) -> FloatArray:
    """The field in the reference frame from means over a phase of rest.

    Without an attitude: the part along up stays, the horizontal rest points to north turned east by the declination D,
    in ENU (h sin D, h cos D, u) with u = m·a/‖a‖ and h = √(‖m‖² − u²).

    Parameters
    ----------
    phase : RestPhase
    field : (3,) array
        The mean field m, body axes.
    upward : (3,) array, optional
        The mean specific force a, body axes; needed without an attitude.
    frame : {"ENU", "NED", "NWU"}, optional
        Needed without an attitude.

    Returns
    -------
    (3,) array
        As long as ``field``.
    """
    if phase.attitude_qw_qx_qy_qz is not None:
        return np.asarray(
            scipy.spatial.transform.Rotation.from_quat(phase.attitude_qw_qx_qy_qz, scalar_first=True).apply(field)
        )
    assert upward is not None
    assert phase.declination_deg is not None
    along = float(field @ upward / np.linalg.norm(upward))
    horizontal = float(np.linalg.norm(np.cross(upward / np.linalg.norm(upward), field)))
    declination = np.deg2rad(phase.declination_deg)
    return from_enu(np.array([horizontal * np.sin(declination), horizontal * np.cos(declination), along]), frame)


def sun_directions(reference: SunByTime, times: FloatArray) -> FloatArray:
    """Unit vectors (N, 3) to the Sun in J2000 axes, at times of the file's clock, s, shape (N,)."""
    seconds = (reference.time_zero - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() + _TT_MINUS_UTC_S
    return sun.sun_direction_j2000(_UNIX_EPOCH_JD + (seconds + times) / 86_400.0)
