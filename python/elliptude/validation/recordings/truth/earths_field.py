"""The Earth's field by IGRF's coefficients: the slope of its potential in axes fixed to the Earth.

`elliptude.configuration.references` takes the field from ppigrf, in spherical coordinates and by Legendre functions of
the colatitude. Here the potential is a sum of solid harmonics of x, y and z, by the recursions of L. E. Cunningham
(Celestial Mechanics 2, 1970), and its slope is that of the same sum in complex numbers: no coordinate is singular, and
the place is that of the ellipsoid without a geocentric latitude.
"""

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from elliptude.configuration.sensors import ReferenceFrame
from elliptude.configuration.statements import WorldModel
from elliptude.io.files import FileError
from elliptude.typing import FloatArray

# km: the radius that the coefficients are of; WGS84.
_RADIUS = 6371.2
_EQUATOR, _FLATTENING = 6378.137, 1.0 / 298.257223563
# Of a complex step: its square is nothing beside 1.
_STEP = 1e-100

Coefficients = dict[tuple[int, int], float]


def field_of(model: WorldModel, frame: ReferenceFrame) -> FloatArray:
    """The main field at a place and a date, µT, axes of a frame on the ground, shape (3,).

    Parameters
    ----------
    model : WorldModel
    frame : {"ENU", "NED", "NWU"}

    Returns
    -------
    (3,) array
    """
    latitude, longitude = math.radians(model.latitude_deg), math.radians(model.longitude_deg)
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    up = np.array(
        [
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        ]
    )
    north = np.cross(up, east)
    # Of the point below on the ellipsoid: its axes scaled to a ball, the normal is up.
    axes = _EQUATOR * np.array([1.0, 1.0, 1.0 - _FLATTENING])
    below = axes**2 * up / np.linalg.norm(axes * up)
    field = -1e-3 * _slope(below + 1e-3 * model.height_m * up, coefficients_at(model.date))
    rows = {"ENU": (east, north, up), "NED": (north, east, -up), "NWU": (north, -east, up)}[frame]
    return np.array(rows) @ field


def coefficients_at(date: datetime) -> Coefficients:
    """IGRF's coefficients in nT, on lines between their epochs: g of degree n and order m at (n, m), h at (n, −m)."""
    try:
        from ppigrf.ppigrf import shc_fn
    except ModuleNotFoundError as error:
        raise FileError("a reference of kind 'world_model' needs ppigrf: pip install 'elliptude[igrf]'") from error
    text = Path(shc_fn).read_text(encoding="utf-8")
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    epochs = [datetime(int(float(year)), 1, 1, tzinfo=UTC) for year in lines[1]]
    since = np.array([(epoch - date).total_seconds() for epoch in epochs])
    return {(int(n), int(m)): float(np.interp(0.0, since, list(map(float, of)))) for n, m, *of in lines[2:]}


def _slope(place: FloatArray, coefficients: Coefficients) -> FloatArray:
    """Of the potential at a place in km from the Earth's middle, nT, shape (3,)."""
    found = np.empty(3)
    for i in range(3):
        moved = place.astype(np.complex128)
        moved[i] += 1j * _STEP
        found[i] = _potential(moved / _RADIUS, coefficients).imag / _STEP * _RADIUS
    return found


def _potential(place: np.ndarray, coefficients: Coefficients) -> complex:
    """a Σ S (g V + h W), over a, V and W being r^(-n-1) P(z/r) cos mλ and sin mλ, S of Schmidt, lengths in radii."""
    x, y, z = place / (place @ place)
    shorter = 1.0 / (place @ place)
    most = max(n for n, _ in coefficients)
    total = 0.0 + 0.0j
    along = np.sqrt(shorter) * np.array([1.0, 0.0])
    for m in range(most + 1):
        if m > 0:
            along = (2 * m - 1) * np.array([x * along[0] - y * along[1], x * along[1] + y * along[0]])
        before, now = np.zeros(2), along
        for n in range(m, most + 1):
            if n > m:
                before, now = now, ((2 * n - 1) * z * now - (n + m - 1) * shorter * before) / (n - m)
            if n == 0:
                continue
            schmidt = math.sqrt((1 if m == 0 else 2) * math.factorial(n - m) / math.factorial(n + m))
            total += schmidt * coefficients[n, m] * now[0]
            total += schmidt * coefficients[n, -m] * now[1] if m > 0 else 0.0
    return complex(total)
